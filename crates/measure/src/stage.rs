//! A scene under view samples, and what a technique makes of it.

use std::time::Instant;

use antumbra_gpu::{
    Counters, Frame, Gpu, MeshSet, PassTimes, Recorder, SampleImage, Technique, Timer, ViewCamera,
    ViewSamples, read_f32_texture,
};
use antumbra_reference::{Tracer, Truth, TruthOptions, ViewSample};
use antumbra_scene::{Bounds, Camera, Emission, Light, Scene, Triangles};
use glam::{DVec3, Vec3};

use crate::MeasureError;

/// A scene seen at its view samples, ready for any light and any technique.
#[derive(Debug)]
pub struct Stage {
    /// The scene's triangles, relative to its origin.
    pub triangles: Triangles,
    /// The same on the GPU.
    pub meshes: MeshSet,
    /// The view samples on the GPU.
    pub samples: ViewSamples,
    /// The same on the CPU.
    pub image: SampleImage,
    camera: Option<ViewCamera>,
    tracer: Tracer,
}

/// One technique's answer on a stage under a light.
#[derive(Clone, Debug, Default)]
pub struct Shot {
    /// Visibility of each view sample, row by row.
    pub visibility: Vec<f32>,
    /// GPU times of each repetition, pass by pass; empty where the device has no timestamps.
    pub passes: Vec<PassTimes>,
    /// GPU milliseconds of each repetition: the sum of its passes, or the wall clock around its submission
    /// where the device has no timestamps, or is a processor.
    pub gpu_ms: Vec<f64>,
    /// CPU milliseconds of each repetition to prepare and record.
    pub cpu_ms: Vec<f64>,
    /// Work counters.
    pub counters: Counters,
    /// Bytes of GPU memory held.
    pub bytes: u64,
}

/// Samples a row of a stage that was given its samples.
const ROW: usize = 256;

/// Passes of one recording that a shot can time.
const TIMED_PASSES: u32 = 64;

impl Stage {
    /// Uploads the scene and draws its view samples for a view of `width` x `height`.
    ///
    /// # Errors
    /// A faulty scene, or a size that the device cannot do.
    pub fn new(
        gpu: &Gpu,
        scene: &Scene,
        camera: Camera,
        width: u32,
        height: u32,
    ) -> Result<Self, MeasureError> {
        let aspect = f64::from(width) / f64::from(height);
        let clip = camera.view_projection(scene.origin(), aspect);
        let view = ViewCamera { clip, eye: camera.eye - scene.origin() };
        Self::seen_by(gpu, scene, &view, width, height)
    }

    /// As [`Stage::new`], for a camera with reversed depth, near at 1, of any other kind; its matrix and eye are
    /// relative to [`Scene::origin`].
    ///
    /// # Errors
    /// As [`Stage::new`].
    pub fn seen_by(
        gpu: &Gpu,
        scene: &Scene,
        camera: &ViewCamera,
        width: u32,
        height: u32,
    ) -> Result<Self, MeasureError> {
        let triangles = scene.triangles(scene.origin())?;
        let tracer = Tracer::new(&triangles)?;
        let meshes = MeshSet::from_triangles(gpu, &triangles)?;
        let samples = ViewSamples::new(gpu, width, height)?;
        let image = SampleImage { width, height, positions: Vec::new(), normals: Vec::new() };
        let mut stage = Self { triangles, meshes, samples, image, camera: None, tracer };
        stage.look(gpu, camera)?;
        Ok(stage)
    }

    /// Draws what another camera sees in place of the view samples; see [`Stage::seen_by`].
    ///
    /// # Errors
    /// A failed allocation, or a lost device.
    pub fn look(&mut self, gpu: &Gpu, camera: &ViewCamera) -> Result<(), MeasureError> {
        let (width, height) = self.samples.size();
        let depth = gpu.create_texture(
            "view size",
            &wgpu::TextureDescriptor {
                label: Some("camera depth"),
                size: wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
                mip_level_count: 1,
                sample_count: 1,
                dimension: wgpu::TextureDimension::D2,
                format: wgpu::TextureFormat::Depth32Float,
                usage: wgpu::TextureUsages::RENDER_ATTACHMENT,
                view_formats: &[],
            },
        )?;
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        self.meshes.encode_view_samples(
            gpu,
            &mut Recorder::new(&mut encoder),
            camera,
            &depth.create_view(&Default::default()),
            &self.samples,
        );
        gpu.queue.submit([encoder.finish()]);
        self.image = self.samples.read(gpu)?;
        self.camera = Some(*camera);
        Ok(())
    }

    /// Uploads the scene and takes `points` (relative to [`Scene::origin`]) for its view samples, in
    /// order; the last row is filled up with pixels that show no surface.
    ///
    /// # Errors
    /// A faulty scene, or no points.
    pub fn at_points(
        gpu: &Gpu,
        scene: &Scene,
        points: &[ViewSample],
    ) -> Result<Self, MeasureError> {
        let rows = points.len().div_ceil(ROW);
        Self::at_samples(gpu, scene, points, (ROW as u32, rows as u32), None)
    }

    /// Uploads the scene and takes `points` (relative to [`Scene::origin`]), one a pixel of a view of `size`, for
    /// what `camera` sees: the scene itself may be hidden from it.
    ///
    /// # Errors
    /// A faulty scene, or a view without pixels.
    pub fn seen(
        gpu: &Gpu,
        scene: &Scene,
        camera: &Camera,
        size: (u32, u32),
        points: &[ViewSample],
    ) -> Result<Self, MeasureError> {
        Self::at_samples(gpu, scene, points, size, Some(camera))
    }

    fn at_samples(
        gpu: &Gpu,
        scene: &Scene,
        points: &[ViewSample],
        (width, height): (u32, u32),
        camera: Option<&Camera>,
    ) -> Result<Self, MeasureError> {
        let triangles = scene.triangles(scene.origin())?;
        let tracer = Tracer::new(&triangles)?;
        let meshes = MeshSet::from_triangles(gpu, &triangles)?;
        let samples = ViewSamples::new(gpu, width, height)?;
        let mut positions: Vec<Vec3> = points.iter().map(|p| p.position).collect();
        let mut normals: Vec<Vec3> = points.iter().map(|p| p.normal).collect();
        let pixels = width as usize * height as usize;
        positions.resize(pixels, Vec3::ZERO);
        normals.resize(pixels, Vec3::ZERO);
        let objects = objects_at(&triangles, &positions);
        samples.write_with_objects(gpu, &positions, &normals, &objects)?;
        let image = SampleImage { width, height, positions, normals };
        let camera = camera.map(|camera| meshes.view_camera(camera, (width, height)));
        Ok(Self { triangles, meshes, samples, image, camera, tracer })
    }

    /// Tells techniques that `camera` sees the view samples, which stay what they are; with `None`, that they are
    /// points of another kind.
    pub fn set_camera(&mut self, camera: Option<ViewCamera>) {
        self.camera = camera;
    }

    /// The frame of this stage under `light`.
    #[must_use]
    pub fn frame<'a>(&'a self, light: &'a Light) -> Frame<'a> {
        Frame {
            samples: &self.samples,
            camera: self.camera,
            light,
            casters: &self.meshes,
            origin: self.triangles.origin,
        }
    }

    /// The camera that sees the view samples, where there is one.
    #[must_use]
    pub fn camera(&self) -> Option<&ViewCamera> {
        self.camera.as_ref()
    }

    /// The ray tracer over the stage's triangles.
    #[must_use]
    pub fn tracer(&self) -> &Tracer {
        &self.tracer
    }

    /// The view samples as the reference takes them.
    #[must_use]
    pub fn view_samples(&self) -> Vec<ViewSample> {
        let pairs = self.image.positions.iter().zip(&self.image.normals);
        pairs.map(|(&position, &normal)| ViewSample { position, normal }).collect()
    }

    /// True visibility of every view sample.
    #[must_use]
    pub fn truth(&self, light: &Light, options: &TruthOptions) -> Truth {
        self.truth_of(light, None, options)
    }

    /// As [`Stage::truth`], of a rectangle or a disc that is brighter here than there.
    #[must_use]
    pub fn truth_of(
        &self,
        light: &Light,
        emission: Option<&Emission>,
        options: &TruthOptions,
    ) -> Truth {
        self.tracer.truth_of(light, emission, &self.view_samples(), options)
    }

    /// Runs `technique` once to warm up and then `repeat` times, and reads its answer back.
    ///
    /// # Errors
    /// A light or setting that the technique refuses, a lost device, or any error that wgpu reports.
    pub fn shoot(
        &self,
        gpu: &Gpu,
        light: &Light,
        technique: &mut dyn Technique,
        repeat: u32,
    ) -> Result<Shot, MeasureError> {
        let mut session = self.session(gpu)?;
        let mut shot = Shot::default();
        session.repeat(gpu, light, technique, &mut shot, false)?;
        for _ in 0..repeat {
            session.repeat(gpu, light, technique, &mut shot, true)?;
        }
        session.conclude(gpu, technique, &mut shot)?;
        Ok(shot)
    }

    /// Room for repeated runs, so that the repetitions of several techniques can be interleaved.
    ///
    /// # Errors
    /// A failed allocation.
    pub fn session(&self, gpu: &Gpu) -> Result<Session<'_>, MeasureError> {
        let target = self.samples.visibility_target(gpu)?;
        let view = target.create_view(&Default::default());
        Ok(Session { stage: self, target, view, timer: Timer::new(gpu, TIMED_PASSES) })
    }
}

/// The instance on which each point lies, or `None` for a point off all of them.
fn objects_at(triangles: &Triangles, points: &[Vec3]) -> Vec<Option<u32>> {
    let corners = |t: &[u32; 3]| t.map(|i| triangles.positions[i as usize].as_dvec3());
    let boxes: Vec<Bounds> = triangles
        .instances
        .iter()
        .map(|range| Bounds::of(triangles.triangles[range.clone()].iter().flat_map(corners)))
        .collect();
    let object = |point: &Vec3| {
        let p = point.as_dvec3();
        // Points are rounded to f32: 16 of its steps of the largest coordinate around.
        let off = |b: &Bounds| 1e-6 * b.min.abs().max(b.max.abs()).max(p.abs()).max_element();
        let mut around = boxes.iter().enumerate().filter(|(_, b)| {
            let off = off(b);
            p.cmpge(b.min - off).all() && p.cmple(b.max + off).all()
        });
        match (around.next(), around.next()) {
            (None, _) => None,
            (Some((object, _)), None) => Some(object as u32),
            // The boxes overlap: that of the plane nearest to the point among the triangles that hold it.
            (Some(first), Some(second)) => {
                let candidates =
                    [first, second].into_iter().chain(around).map(|(object, _)| object);
                let distance = |object: &usize| {
                    let range = triangles.instances[*object].clone();
                    triangles.triangles[range]
                        .iter()
                        .map(|t| distance(corners(t), p))
                        .fold(f64::INFINITY, f64::min)
                };
                candidates.min_by(|a, b| distance(a).total_cmp(&distance(b))).map(|o| o as u32)
            }
        }
    };
    points.iter().map(object).collect()
}

/// Distance of `p` from a triangle.
fn distance([a, b, c]: [DVec3; 3], p: DVec3) -> f64 {
    let n = (b - a).cross(c - a);
    let inner = |from: DVec3, to: DVec3| (to - from).cross(p - from).dot(n) >= 0.0;
    if inner(a, b) && inner(b, c) && inner(c, a) {
        return (p - a).dot(n.normalize_or_zero()).abs();
    }
    let segment = |from: DVec3, to: DVec3| {
        let side = to - from;
        let along = (p - from).dot(side) / side.length_squared().max(f64::MIN_POSITIVE);
        p.distance(from + side * along.clamp(0.0, 1.0))
    };
    segment(a, b).min(segment(b, c)).min(segment(c, a))
}

/// A visibility target and a timer on a stage.
#[derive(Debug)]
pub struct Session<'a> {
    stage: &'a Stage,
    target: wgpu::Texture,
    view: wgpu::TextureView,
    timer: Option<Timer>,
}

impl Session<'_> {
    /// Runs `technique` once; with `keep`, its times are added to `shot`.
    ///
    /// # Errors
    /// As [`Stage::shoot`].
    pub fn repeat(
        &mut self,
        gpu: &Gpu,
        light: &Light,
        technique: &mut dyn Technique,
        shot: &mut Shot,
        keep: bool,
    ) -> Result<(), MeasureError> {
        let frame = self.stage.frame(light);
        let begin = Instant::now();
        technique.prepare(gpu, &frame)?;
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        let mut recorder = Recorder::timed(&mut encoder, self.timer.as_mut());
        technique.encode(gpu, &frame, &mut recorder, &self.view)?;
        if let Some(timer) = &self.timer {
            timer.finish(&mut encoder);
        }
        let commands = encoder.finish();
        let recorded = Instant::now();
        gpu.queue.submit([commands]);
        gpu.wait()?;
        let wall_ms = recorded.elapsed().as_secs_f64() * 1e3;
        let passes = self.timer.as_mut().map(|t| t.read(gpu)).transpose()?;
        if keep {
            shot.cpu_ms.push((recorded - begin).as_secs_f64() * 1e3);
            // A processor that plays the GPU takes timestamps where it rasterises: between two of them a compute pass
            // takes no time at all.
            let timed = passes.as_ref().filter(|_| gpu.info.device_type != wgpu::DeviceType::Cpu);
            shot.gpu_ms.push(timed.map_or(wall_ms, PassTimes::total_ms));
            shot.passes.extend(passes);
        }
        Ok(())
    }

    /// Visibility of the last run, row by row.
    ///
    /// # Errors
    /// A lost device.
    pub fn visibility(&self, gpu: &Gpu) -> Result<Vec<f32>, MeasureError> {
        Ok(read_f32_texture(gpu, &self.target, 0)?)
    }

    /// Reads what `technique` left, which ran last: visibility, counters and bytes. Of the last of several runs, what it
    /// kept of those before counts as kept.
    ///
    /// # Errors
    /// A lost device.
    pub fn conclude(
        &self,
        gpu: &Gpu,
        technique: &dyn Technique,
        shot: &mut Shot,
    ) -> Result<(), MeasureError> {
        shot.visibility = self.visibility(gpu)?;
        shot.counters = technique.read_counters(gpu)?;
        shot.bytes = technique.bytes();
        Ok(())
    }
}

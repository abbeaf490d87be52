//! Casters in slices: an image of each, and its table of sums.

use antumbra_gpu::{
    Anchor, Beyond, BindGroupCache, BlurShader, Counters, Frame, Gpu, GpuError, LayerJob, Layers,
    LightView, Pyramid, PyramidKind, Recorder, Sat, SatNumbers, SatShader, ViewCamera, bind,
    entries, light_view_layout, read_buffer,
};
use antumbra_map::{BodyBoxes, DepthConvention, Fitting, ShadowMap, Sight, Store};
use antumbra_scene::Bounds;
use glam::{DMat4, DVec2, DVec3, DVec4, Mat4};

use crate::occlusion::{MAX_SLICES, OcclusionTextures, Placement, Prefilter};
use crate::offset::Offset;
use crate::store::{AreaLight, VIEWS};
use crate::twin::View;
use crate::twin::occlusion::{fade_length, planes};

const CS: wgpu::ShaderStages = wgpu::ShaderStages::COMPUTE;

/// `Slices` of `soft/occlusion.wesl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, bytemuck::Pod, bytemuck::Zeroable)]
struct ViewSlices {
    light: [f32; 4],
    planes: [[f32; 4]; MAX_SLICES as usize],
}

/// One slice to draw.
#[derive(Clone, Copy, Debug)]
struct Slice {
    clip: Mat4,
    /// Half-spaces between its planes.
    volume: [DVec4; 2],
}

/// Images and tables of slices, in bind groups 1 and 2; of a light without an extent a plain map.
#[derive(Debug)]
pub(crate) struct SliceStore {
    config: OcclusionTextures,
    layout: wgpu::BindGroupLayout,
    tally: Option<wgpu::Buffer>,
    light: wgpu::Buffer,
    slices: wgpu::Buffer,
    matrices: wgpu::Buffer,
    matrix_group: wgpu::BindGroup,
    stride: u32,
    images: Option<Layers>,
    averages: Averages,
    jobs: Vec<LayerJob>,
    drawn: Vec<Slice>,
    boxes: BodyBoxes,
    nothing: wgpu::TextureView,
    group: BindGroupCache<wgpu::TextureView>,
    is_hard: bool,
    counters: Counters,
}

/// What averages the images.
#[derive(Debug)]
enum Averages {
    Table(Box<Sat>),
    Levels(Box<Pyramid>),
}

/// What there are too many of: N-buffers have log2(side) + 1 images a slice, a table one.
const INSTEAD_OF_A_TABLE: &str = "images of slices averaged in place of prefilter `table`";

impl Averages {
    fn new(gpu: &Gpu, prefilter: Prefilter) -> Result<Self, GpuError> {
        const TEXEL: &str = "soft::covered";
        let levels = |kind| -> Result<Self, GpuError> {
            let shader = BlurShader {
                texel: TEXEL,
                mean: "gpu::mean::arithmetic",
                slots: Vec::new(),
                format: wgpu::TextureFormat::R32Float,
            };
            Ok(Self::Levels(Box::new(Pyramid::new(gpu, kind, &shader)?)))
        };
        match prefilter {
            Prefilter::Table => {
                let shader = SatShader {
                    texel: TEXEL,
                    slots: Vec::new(),
                    channels: 1,
                    numbers: SatNumbers::Fixed { bits: 1 },
                };
                Ok(Self::Table(Box::new(Sat::new(gpu, &shader)?)))
            }
            Prefilter::NBuffer => levels(PyramidKind::NBuffer(Anchor::Middle, Beyond::Zero)),
            Prefilter::Mip => levels(PyramidKind::Mip),
        }
    }

    fn prepare(&mut self, gpu: &Gpu, images: &Layers, jobs: &[LayerJob]) -> Result<(), GpuError> {
        match self {
            Self::Table(sat) => sat.prepare(gpu, &images.whole, images.texture.width(), jobs),
            Self::Levels(levels) => {
                let made = levels.prepare(gpu, &images.whole, images.texture.width(), jobs);
                made.map_err(|error| match error {
                    GpuError::OutOfMemory { bytes, .. } => {
                        GpuError::OutOfMemory { what: INSTEAD_OF_A_TABLE, bytes }
                    }
                    GpuError::Limit { asked, limit, .. } => {
                        GpuError::Limit { what: INSTEAD_OF_A_TABLE, asked, limit }
                    }
                    other => other,
                })
            }
        }
    }

    fn encode(&self, recorder: &mut Recorder<'_>) {
        match self {
            Self::Table(sat) => sat.encode(recorder, "soft/sum"),
            Self::Levels(levels) => levels.encode(recorder, "soft/levels"),
        }
    }

    fn view(&self) -> Option<&wgpu::TextureView> {
        match self {
            Self::Table(sat) => sat.view(),
            Self::Levels(levels) => levels.stack_view().or(levels.mips_view()),
        }
    }

    fn texels(&self) -> u64 {
        match self {
            Self::Table(sat) => sat.texels(),
            Self::Levels(levels) => levels.texels(),
        }
    }

    fn bytes(&self) -> u64 {
        match self {
            Self::Table(sat) => sat.bytes(),
            Self::Levels(levels) => levels.bytes(),
        }
    }
}

impl SliceStore {
    pub(crate) fn new(gpu: &Gpu, config: &OcclusionTextures) -> Result<Self, GpuError> {
        let mut all =
            vec![entries::storage(0, CS), entries::storage(1, CS), entries::texels(2, CS, true)];
        if config.tally {
            all.push(entries::write_storage(3, CS));
        }
        let layout = gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("slices"),
            entries: &all,
        });
        let storage = wgpu::BufferUsages::STORAGE;
        let tally = || gpu.buffer("tally", &[0; 16], storage | wgpu::BufferUsages::COPY_SRC);
        let alignment = gpu.device.limits().min_uniform_buffer_offset_alignment;
        let stride = alignment.max(size_of::<Mat4>() as u32);
        let matrices = gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("slices"),
            size: u64::from(stride * config.slices) * VIEWS as u64,
            usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let matrix_group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("slices"),
            layout: &light_view_layout(&gpu.device),
            entries: &[wgpu::BindGroupEntry {
                binding: 0,
                resource: wgpu::BindingResource::Buffer(wgpu::BufferBinding {
                    buffer: &matrices,
                    offset: 0,
                    size: wgpu::BufferSize::new(size_of::<Mat4>() as u64),
                }),
            }],
        });
        Ok(Self {
            config: *config,
            layout,
            tally: config.tally.then(tally),
            light: gpu.buffer("area light", &[0; size_of::<AreaLight>()], storage),
            slices: gpu.buffer("slices", &[0; VIEWS * size_of::<ViewSlices>()], storage),
            matrices,
            matrix_group,
            stride,
            images: None,
            averages: Averages::new(gpu, config.prefilter)?,
            jobs: Vec::new(),
            drawn: Vec::new(),
            boxes: BodyBoxes::default(),
            nothing: images(gpu, 1, 1)?.whole,
            group: BindGroupCache::default(),
            is_hard: true,
            counters: Counters::new(),
        })
    }

    /// The slices of each view with casters, for the shader and to be drawn.
    fn place(&mut self, frame: &Frame<'_>, map: &ShadowMap) -> Vec<ViewSlices> {
        let light = frame.light;
        let center = light.position().map_or(DVec3::ZERO, |p| p - frame.origin);
        let mut receivers = Vec::<Bounds>::new();
        if !frame.casters.bodies(&mut |body| receivers.extend(body.parts)) {
            receivers.clear();
        }
        let region = self.boxes.visible_region(frame);
        let sight = region.as_ref().map(|region| Sight { region, casters: self.boxes.casters() });
        let fitting = Fitting {
            origin: frame.origin,
            size: map.size(),
            guard: map.guard(),
            receivers: false,
            grid: 1,
        };
        let looked_at = match (self.config.placement, frame.camera) {
            (Placement::Seen | Placement::Error, Some(camera)) => {
                looked_at(&camera, &receivers, frame.origin)
            }
            _ => Vec::new(),
        };
        let mut all = Vec::new();
        let clips = map.views().iter().enumerate();
        let clips = clips.filter_map(|(number, view)| Some((number, view.clip?)));
        for (number, clip) in clips.take(VIEWS) {
            let view = View::new(&clip, f64::from(map.size()), light);
            let (axis, parallel) = (view.z, !view.perspective);
            let along = |p: DVec3| axis.dot(p - center);
            let ends = |points: &[DVec3]| span(points.iter().map(|p| along(*p)));
            let (mut near, mut far) = ends(map.hull());
            // What matters for what is seen: slices elsewhere would be wasted.
            let served = Offset::served(light, number, frame.origin);
            let needed = sight.as_ref().and_then(|s| s.needed(light, &served, |_| 0.0, &fitting));
            if let Some(needed) = &needed {
                (near, far) = in_steps((near, far), ends(&needed.casters));
            }
            // Where the first slice begins: no caster behind the light hides any of it. Planes lie a ten-thousandth of the way
            // off at least.
            let first = if parallel { near } else { near.max(0.0) };
            let near = if parallel { near } else { near.max(1e-4 * far) };
            let extent = map.hull().iter().map(|p| p.distance(map.hull()[0])).fold(0.0, f64::max);
            // A sheet parallel to the light has slices of a thickness, too. What lies on the last plane is before it.
            let range = (far - near).max(1e-3 * extent).max(1e-9);
            let far = near + range * (1.0 + 1e-4);
            let farthest = match &needed {
                Some(needed) => ends(&needed.receivers).1,
                None => {
                    let corners = receivers.iter().flat_map(|b| [b.min, b.max]);
                    span(corners.map(|p| along(p - frame.origin))).1
                }
            };
            let farthest = if farthest.is_finite() { farthest } else { far + 0.25 * range };
            // Errors at a contact are without bounds.
            let receiver = farthest.max(far + 0.02 * range);
            let placement = self.config.placement;
            let served = |p: &&DVec3| served.iter().all(|s| s.truncate().dot(**p) + s.w >= 0.0);
            let seen: Vec<f64> = looked_at.iter().filter(served).map(|p| along(*p)).collect();
            let count = self.config.slices;
            let found = planes((near, far), receiver, count, placement, &seen, parallel);
            let stand_off = if parallel { 0.0 } else { clip.row(3).dot(center.extend(1.0)) };
            let mut slices: ViewSlices = bytemuck::Zeroable::zeroed();
            slices.light = center.extend(stand_off).as_vec4().to_array();
            for (k, plane) in found.iter().enumerate() {
                let thickness = fade_length(near, &found, k);
                let fade = f64::from(self.config.fade)
                    * thickness.max(blurred_gap(&view, *plane, stand_off).min(range));
                let over = if fade > 0.0 { 1.0 / fade } else { 0.0 };
                slices.planes[k] = [*plane as f32, over as f32, 0.0, 0.0];
                // With the slice before it, which it succeeds.
                let begin = if self.config.successor { k.saturating_sub(1) } else { k };
                let from = if begin == 0 { first } else { found[begin - 1] };
                // Slices share a little, so that nothing falls between them by rounding: a few units of the last place of
                // 32-bit floats, 2^-23, of distances from where they are seen.
                let little = 1e-5 * (plane - from) + 1e-6 * (stand_off + plane.abs() + extent);
                // Seen from behind the light, all before it may be drawn; from its centre, what is not at it.
                let least = match parallel {
                    true => f64::NEG_INFINITY,
                    false if stand_off > 0.1 * near => 0.0,
                    false => 0.5 * near,
                };
                let (from, to) = ((from - little).max(least), plane + little);
                let off = axis.dot(center);
                self.drawn.push(Slice {
                    clip: between(&clip, (axis, off), stand_off, (from, to), parallel).as_mat4(),
                    volume: [axis.extend(-off - from), (-axis).extend(off + to)],
                });
            }
            all.push(slices);
        }
        all
    }
}

/// Where `camera` looks, relative to `origin`: 16 x 16 points on the nearest of the boxes `bodies` (world space).
fn looked_at(camera: &ViewCamera, bodies: &[Bounds], origin: DVec3) -> Vec<DVec3> {
    const SIDE: i32 = 16;
    let back = camera.clip.inverse();
    let eye = camera.eye;
    let hit = |i: i32| {
        let at = |k: i32| (2.0 * f64::from(k) + 1.0) / f64::from(SIDE) - 1.0;
        let towards = back.project_point3(DVec3::new(at(i % SIDE), at(i / SIDE), 0.5)) - eye;
        // Where the ray enters a box, or leaves that which the eye is in.
        let meets = |b: &Bounds| {
            let (a, b) = ((b.min - origin - eye) / towards, (b.max - origin - eye) / towards);
            let (enter, leave) = (a.min(b).max_element(), a.max(b).min_element());
            let t = if enter > 0.0 { enter } else { leave };
            (enter <= leave && leave > 0.0).then_some(t)
        };
        let nearest = bodies.iter().filter_map(meets).fold(f64::INFINITY, f64::min);
        let p = eye + towards * nearest;
        p.is_finite().then_some(p)
    };
    (0..SIDE * SIDE).filter_map(hit).collect()
}

/// How far behind a plane the light's window on it is a texel wide. Where a surface passes through the plane, its own texels
/// are known to half of one on either side, and hide up to all of a window that is smaller.
fn blurred_gap(view: &View, plane: f64, stand_off: f64) -> f64 {
    let flat = (view.u.abs() + view.v.abs()).truncate().max(DVec2::splat(view.radius));
    let across = (2.0 * flat * view.texels).max_element();
    if view.perspective {
        // Of `across` / (plane + stand_off) texels the share gap / (plane + gap) is seen.
        let share = (plane + stand_off) / across;
        if share < 1.0 { plane * share / (1.0 - share) } else { f64::INFINITY }
    } else {
        1.0 / across
    }
}

/// The interval that `values` span.
fn span(values: impl Iterator<Item = f64>) -> (f64, f64) {
    values.fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), v| (lo.min(v), hi.max(v)))
}

/// `part` of the interval `all`, widened to eighths to sixteenths of itself, so that slices stand still while the camera
/// moves a little.
fn in_steps(all: (f64, f64), part: (f64, f64)) -> (f64, f64) {
    let range = all.1 - all.0;
    let step = range * ((part.1 - part.0) / range).log2().floor().exp2() / 8.0;
    // A part without a thickness has no steps.
    let has_steps = step > 1e-6 * range;
    if !has_steps {
        return part;
    }
    let at = |z: f64| (z - all.0) / step;
    ((all.0 + at(part.0).floor() * step).max(all.0), (all.0 + at(part.1).ceil() * step).min(all.1))
}

/// The matrix of a view with near and far planes at those distances from the light's plane; `off` is the distance of that
/// plane from the origin along `axis`.
fn between(
    clip: &DMat4,
    (axis, off): (DVec3, f64),
    stand_off: f64,
    (from, to): (f64, f64),
    parallel: bool,
) -> DMat4 {
    let w = clip.row(3);
    let depth = if parallel {
        // (to - z) / (to - from) of the distance z along the axis.
        (-axis).extend(to + off) / (to - from)
    } else {
        // a + b / w: 1 at the near plane and 0 at the far one.
        let (from, to) = (from + stand_off, to + stand_off);
        (w * -from + DVec4::W * (from * to)) / (to - from)
    };
    DMat4::from_cols(clip.row(0), clip.row(1), depth, w).transpose()
}

impl Store for SliceStore {
    fn prepare(&mut self, gpu: &Gpu, frame: &Frame<'_>, map: &ShadowMap) -> Result<(), GpuError> {
        self.is_hard = frame.light.is_hard();
        self.jobs.clear();
        self.drawn.clear();
        if let Some(tally) = &self.tally {
            gpu.queue.write_buffer(tally, 0, &[0; 16]);
        }
        let light = AreaLight::new(frame.light, map);
        gpu.queue.write_buffer(&self.light, 0, bytemuck::bytes_of(&light));
        if !self.is_hard && map.view().is_some() {
            let slices = self.place(frame, map);
            gpu.queue.write_buffer(&self.slices, 0, bytemuck::cast_slice(&slices));
            let layers = self.drawn.len() as u32;
            let images = match self.images.take() {
                Some(images) if images.has_room(map.size(), layers as usize) => images,
                _ => {
                    let limit = gpu.device.limits().max_texture_array_layers;
                    if layers > limit {
                        let (asked, limit) = (layers.into(), limit.into());
                        return Err(GpuError::Limit { what: "slices of all views", asked, limit });
                    }
                    images(gpu, map.size(), layers)?
                }
            };
            let job = |source| LayerJob { source, ..LayerJob::default() };
            self.jobs.extend((0..layers).map(job));
            self.averages.prepare(gpu, &images, &self.jobs)?;
            self.images = Some(images);
            for (i, slice) in self.drawn.iter().enumerate() {
                let offset = i as u64 * u64::from(self.stride);
                let matrix = slice.clip.to_cols_array();
                gpu.queue.write_buffer(&self.matrices, offset, bytemuck::bytes_of(&matrix));
            }
        }
        let depths = map.view().filter(|_| self.is_hard).unwrap_or(&self.nothing).clone();
        self.group.get(depths, |depths| {
            let mut all = vec![
                bind::buffer(0, &self.light),
                bind::buffer(1, &self.slices),
                bind::texture(2, depths),
            ];
            all.extend(self.tally.as_ref().map(|tally| bind::buffer(3, tally)));
            gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("slices"),
                layout: &self.layout,
                entries: &all,
            })
        });
        Ok(())
    }

    fn encode(
        &mut self,
        _gpu: &Gpu,
        frame: &Frame<'_>,
        map: &ShadowMap,
        recorder: &mut Recorder<'_>,
    ) -> Result<(), GpuError> {
        let convention = DepthConvention::REVERSED_F32;
        let (mut passes, mut draws, mut triangles) = (0, 0, 0);
        let mut draw = |view: &LightView<'_>, layer: &wgpu::TextureView, name: &'static str| {
            let mut pass = recorder.depth_pass(name, layer, convention.clear());
            let drawn = frame.casters.draw(view, &mut pass);
            passes += 1;
            draws += drawn.draws;
            triangles += drawn.triangles;
        };
        if self.is_hard {
            for (view, layer) in map.light_views(frame).zip(map.layer_views()) {
                draw(&view, layer, "map/depth");
            }
        } else if let Some(images) = &self.images {
            for (i, (slice, layer)) in self.drawn.iter().zip(&images.each).enumerate() {
                let view = LightView {
                    clip: slice.clip,
                    bind_group: &self.matrix_group,
                    offset: i as u32 * self.stride,
                    format: ShadowMap::FORMAT,
                    order: convention.order(),
                    light: frame.light,
                    origin: frame.origin,
                    volume: &slice.volume,
                    receivers: false,
                };
                draw(&view, layer, "soft/slice");
            }
        }
        if !self.jobs.is_empty() {
            self.averages.encode(recorder);
        }
        let texels = passes * u64::from(map.size()).pow(2);
        let sums = if self.jobs.is_empty() { 0 } else { self.averages.texels() };
        self.counters = Counters::from([
            ("map_passes", passes),
            ("map_draws", draws),
            ("map_triangles", triangles),
            ("map_texels", texels),
            ("map_lights_skipped", u64::from(passes == 0)),
            ("store_texels", sums),
        ]);
        Ok(())
    }

    fn draws(&self) -> bool {
        true
    }

    fn group_layout(&self) -> Option<&wgpu::BindGroupLayout> {
        Some(&self.layout)
    }

    fn group(&self) -> Option<&wgpu::BindGroup> {
        self.group.kept()
    }

    fn view(&self) -> Option<&wgpu::TextureView> {
        self.averages.view()
    }

    fn counters(&self) -> Counters {
        self.counters.clone()
    }

    fn read_counters(&self, gpu: &Gpu) -> Result<Counters, GpuError> {
        let mut counters = self.counters();
        if let Some(tally) = &self.tally {
            let counts: Vec<u32> = bytemuck::pod_collect_to_vec(&read_buffer(gpu, tally, 16)?);
            let names = ["windows_skipped", "windows_looked_up"];
            counters.extend(names.into_iter().zip(counts.into_iter().map(u64::from)));
        }
        Ok(counters)
    }

    fn bytes(&self) -> u64 {
        self.images.as_ref().map_or(0, Layers::bytes)
            + self.averages.bytes()
            + self.light.size()
            + self.tally.as_ref().map_or(0, wgpu::Buffer::size)
            + self.slices.size()
            + self.matrices.size()
    }
}

fn images(gpu: &Gpu, size: u32, count: u32) -> Result<Layers, GpuError> {
    let usage = wgpu::TextureUsages::RENDER_ATTACHMENT;
    Layers::new(gpu, "slices", ShadowMap::FORMAT, (size, count), usage)
}

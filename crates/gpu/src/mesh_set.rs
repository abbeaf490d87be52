//! A ready-made set of meshes: casters for the light, and view samples for the camera.

mod cutouts;
mod parts;
mod pipelines;
mod sheets;
mod textures;

use std::ops::Range;
use std::sync::OnceLock;

use antumbra_scene::{Bounds, Camera, Light, MeshError, Scene, Triangles};
use glam::{DVec3, DVec4, Vec3, Vec4};

use crate::record::depth_attachment;
use crate::{
    CasterBody, CasterClusters, CasterEdges, CasterTriangles, Casters, Drawn, Edges, Gpu, GpuError,
    LightView, ListedTriangles, Recorder, TranslucentTriangles, ViewCamera, ViewSamples, bind,
    read_buffer,
};
use cutouts::Cutouts;
use parts::{Part, cluster_records, objects, parts};
use pipelines::{depth_pipeline, samples_layout, samples_pipeline};
use sheets::Sheets;

/// The triangles of a scene on the GPU.
#[derive(Debug)]
pub struct MeshSet {
    parts: Vec<Part>,
    origin: DVec3,
    positions: wgpu::Buffer,
    indices: wgpu::Buffer,
    objects: wgpu::Buffer,
    vertices: u32,
    triangles: u32,
    depth: wgpu::RenderPipeline,
    samples: wgpu::RenderPipeline,
    /// What it takes to draw triangles with holes, where there are any.
    cutouts: Option<Cutouts>,
    /// What lets light through, where there is any: neither drawn nor seen.
    sheets: Option<Sheets>,
    camera: wgpu::Buffer,
    camera_group: wgpu::BindGroup,
    cull: bool,
    /// Made when first asked for.
    edges: OnceLock<CasterEdges>,
    clusters: OnceLock<wgpu::Buffer>,
}

/// Bytes of an indexed indirect draw.
const INDIRECT_DRAW: u64 = 20;

#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
struct CameraUniform {
    clip: [[f32; 4]; 4],
    eye: [f32; 4],
}

impl MeshSet {
    /// Uploads the triangles of `scene`, relative to its [`Scene::origin`].
    ///
    /// # Errors
    /// Faulty meshes, or more data than the device takes in one buffer.
    pub fn new(gpu: &Gpu, scene: &Scene) -> Result<Self, GpuError> {
        let triangles =
            scene.triangles(scene.origin()).map_err(|e: MeshError| GpuError::Invalid {
                what: "scene",
                value: e.to_string(),
                fix: "repair the mesh; scene files are checked when loaded",
            })?;
        Self::from_triangles(gpu, &triangles)
    }

    /// Uploads triangles. Within an instance they are reordered, so that neighbours in space are neighbours in the index
    /// buffer and can be culled together.
    ///
    /// # Errors
    /// A position that is not finite, an index out of range, a cut-out or opacity without its data, or more data than the device
    /// takes in one buffer.
    pub fn from_triangles(gpu: &Gpu, triangles: &Triangles) -> Result<Self, GpuError> {
        let device = &gpu.device;
        let limit =
            device.limits().max_storage_buffer_binding_size.min(device.limits().max_buffer_size);
        for asked in [triangles.positions.len() * 12, triangles.triangles.len() * 12] {
            if asked as u64 > limit {
                return Err(GpuError::Limit {
                    what: "bytes of geometry",
                    asked: asked as u64,
                    limit,
                });
            }
        }
        if let Some(p) = triangles.positions.iter().find(|p| !p.is_finite()) {
            return Err(GpuError::Invalid {
                what: "vertex position",
                value: p.to_string(),
                fix: "leave out triangles whose corners are not finite",
            });
        }
        let count = triangles.positions.len();
        if let Some(t) = triangles.triangles.iter().find(|t| t.iter().any(|&i| i as usize >= count))
        {
            return Err(GpuError::Invalid {
                what: "vertex index",
                value: format!("{t:?}, of {count} vertices"),
                fix: "let indices be below the number of positions",
            });
        }
        let buffer = |label, contents: &[u8], usage| {
            // A buffer may not be empty; four bytes that nothing draws.
            let contents = if contents.is_empty() { &[0; 4] } else { contents };
            let always = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC;
            gpu.buffer(label, contents, usage | always)
        };
        let positions = buffer(
            "positions",
            bytemuck::cast_slice(&triangles.positions),
            wgpu::BufferUsages::VERTEX,
        );
        let sheets = Sheets::new(gpu, triangles)?;
        let triangles = &*triangles.opaque();
        let samples_layout = samples_layout(gpu);
        let cutouts = Cutouts::new(gpu, triangles, &samples_layout)?;
        let (parts, order) = parts(triangles);
        let indices = buffer("indices", bytemuck::cast_slice(&order), wgpu::BufferUsages::INDEX);
        let objects = buffer(
            "objects",
            bytemuck::cast_slice(&objects(triangles)),
            wgpu::BufferUsages::empty(),
        );
        let camera = device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("camera"),
            size: size_of::<CameraUniform>() as u64,
            usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let camera_group = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("view samples"),
            layout: &samples_layout,
            entries: &[
                bind::buffer(0, &camera),
                bind::buffer(1, &positions),
                bind::buffer(2, &indices),
                bind::buffer(3, &objects),
            ],
        });
        Ok(Self {
            parts,
            origin: triangles.origin,
            positions,
            indices,
            objects,
            vertices: triangles.positions.len() as u32,
            triangles: triangles.triangles.len() as u32,
            depth: depth_pipeline(gpu, None)?,
            samples: samples_pipeline(gpu, &samples_layout, None)?,
            cutouts,
            sheets,
            camera,
            camera_group,
            cull: true,
            edges: OnceLock::new(),
            clusters: OnceLock::new(),
        })
    }

    /// With `false`, every triangle is drawn into every light view, and views are fitted to all of them, floors and
    /// what is out of sight included. Culling only changes how much a texel covers. For proving it.
    pub fn set_culling(&mut self, cull: bool) {
        self.cull = cull;
    }

    /// Positions relative to [`MeshSet::origin`], and triangles in the order in which the GPU holds them: that of
    /// their clusters, instance by instance. Read back, since no copy is kept: it waits.
    ///
    /// # Errors
    /// A lost device, or any error that wgpu reported since the last check.
    pub fn geometry(&self, gpu: &Gpu) -> Result<(Vec<Vec3>, Vec<[u32; 3]>), GpuError> {
        let read = |buffer, count: u32| match count {
            0 => Ok(Vec::new()),
            count => read_buffer(gpu, buffer, u64::from(count) * 12),
        };
        let positions = read(&self.positions, self.vertices)?;
        let triangles = read(&self.indices, self.triangles)?;
        // Bytes read back need not be aligned as what they stand for.
        Ok((
            positions.chunks_exact(12).map(bytemuck::pod_read_unaligned).collect(),
            triangles.chunks_exact(12).map(bytemuck::pod_read_unaligned).collect(),
        ))
    }

    /// World position of the zero of the uploaded positions, metres.
    #[must_use]
    pub fn origin(&self) -> DVec3 {
        self.origin
    }

    /// `camera` over a view of `size` pixels, relative to the origin of these meshes.
    #[must_use]
    pub fn view_camera(&self, camera: &Camera, size: (u32, u32)) -> ViewCamera {
        let aspect = f64::from(size.0) / f64::from(size.1);
        ViewCamera {
            clip: camera.view_projection(self.origin, aspect),
            eye: camera.eye - self.origin,
        }
    }

    /// Draws what `camera` sees into `samples`. `depth` is scratch of the same size and of format
    /// `Depth32Float`.
    ///
    /// The positions lie on their triangles to within rounding, so their error bound is 0 (a pixel's centre that the
    /// rasteriser's snap puts beyond an edge gives the edge's nearest point); each sample
    /// says which instance it lies on.
    pub fn encode_view_samples(
        &self,
        gpu: &Gpu,
        recorder: &mut Recorder<'_>,
        camera: &ViewCamera,
        depth: &wgpu::TextureView,
        samples: &ViewSamples,
    ) {
        let uniform = CameraUniform {
            clip: camera.clip.as_mat4().to_cols_array_2d(),
            eye: camera.homogeneous_eye().as_vec4().to_array(),
        };
        gpu.queue.write_buffer(&self.camera, 0, bytemuck::bytes_of(&uniform));
        let target = |view| {
            Some(wgpu::RenderPassColorAttachment {
                view,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations {
                    load: wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT),
                    store: wgpu::StoreOp::Store,
                },
            })
        };
        let mut pass = recorder.render_pass(
            "gpu/view_samples",
            &[target(&samples.positions_view), target(&samples.normals_view)],
            Some(depth_attachment(depth, 0.0)),
        );
        pass.set_bind_group(0, &self.camera_group, &[]);
        pass.set_pipeline(&self.samples);
        self.each_run(|part| !part.cut, |range| pass.draw(range, 0..1));
        if let Some(cutouts) = &self.cutouts {
            pass.set_pipeline(&cutouts.samples);
            pass.set_bind_group(1, &cutouts.group, &[]);
            self.each_run(|part| part.cut, |range| pass.draw(range, 0..1));
        }
    }

    /// The parts that can shadow something under `light`.
    fn casting(&self, light: &Light) -> impl Iterator<Item = &Part> {
        self.parts.iter().filter(self.can_cast(light))
    }

    fn can_cast(&self, light: &Light) -> impl Fn(&&Part) -> bool {
        let (cull, light) = (self.cull, *light);
        move |part| !cull || part.body().can_cast(&light)
    }

    /// Calls `visit` with the ranges of the index buffer that can shadow something in `view`, of those parts that `which`
    /// keeps. Clusters that follow one another are one range.
    fn runs(
        &self,
        view: &LightView<'_>,
        which: impl Fn(&Part) -> bool,
        visit: impl FnMut(Range<u32>),
    ) {
        let matters = self.matters(view);
        let parts = self.parts.iter().filter(|part| which(part) && matters(part));
        let clusters = parts.flat_map(Part::clusters);
        let clusters = clusters.filter(|(_, bounds)| self.is_seen(view, bounds));
        join(clusters.map(|(indices, _)| indices.clone()), visit);
    }

    /// Whether something within `bounds` can shadow something in `view`.
    fn is_seen(&self, view: &LightView<'_>, bounds: &Bounds) -> bool {
        !(self.cull && outside(view, bounds))
    }

    /// Whether something of a part is to be drawn into `view`.
    fn matters<'a>(&'a self, view: &'a LightView<'_>) -> impl Fn(&Part) -> bool + 'a {
        let casts = self.can_cast(view.light);
        move |part| (view.receivers || casts(&part)) && self.is_seen(view, &part.bounds)
    }

    /// Calls `visit` with the ranges of the index buffer of the parts that `which` keeps.
    fn each_run(&self, which: impl Fn(&Part) -> bool, visit: impl FnMut(Range<u32>)) {
        join(self.parts.iter().filter(|part| which(part)).map(|part| part.indices.clone()), visit);
    }
}

impl Casters for MeshSet {
    fn hull(&self, light: &Light, visit: &mut dyn FnMut(DVec3)) {
        for part in self.casting(light) {
            for corner in part.bounds.corners() {
                visit(corner);
            }
        }
    }

    /// Without culling the answer is no, so that all is drawn.
    fn bodies(&self, visit: &mut dyn FnMut(&CasterBody<'_>)) -> bool {
        self.parts.iter().for_each(|part| visit(&part.body()));
        self.cull
    }

    fn draw(&self, view: &LightView<'_>, pass: &mut wgpu::RenderPass<'_>) -> Drawn {
        let mut drawn = Drawn::default();
        let mut draw = |pass: &mut wgpu::RenderPass<'_>, range: Range<u32>| {
            drawn.draws += 1;
            drawn.triangles += u64::from((range.end - range.start) / 3);
            pass.draw_indexed(range, 0, 0..1);
        };
        pass.set_pipeline(&self.depth);
        pass.set_bind_group(0, view.bind_group, &[view.offset]);
        pass.set_vertex_buffer(0, self.positions.slice(..));
        pass.set_index_buffer(self.indices.slice(..), wgpu::IndexFormat::Uint32);
        self.runs(view, |part| !part.cut, |range| draw(pass, range));
        if let Some(cutouts) = &self.cutouts {
            pass.set_pipeline(&cutouts.depth);
            pass.set_bind_group(1, &cutouts.group, &[]);
            pass.set_vertex_buffer(1, cutouts.coordinates.slice(..));
            self.runs(view, |part| part.cut, |range| draw(pass, range));
        }
        drawn
    }

    fn triangles(&self) -> Option<CasterTriangles<'_>> {
        Some(CasterTriangles {
            positions: &self.positions,
            indices: &self.indices,
            objects: &self.objects,
            vertices: self.vertices,
            triangles: self.triangles,
        })
    }

    fn translucent(&self) -> Option<TranslucentTriangles<'_>> {
        self.sheets.as_ref().map(|sheets| sheets.triangles(&self.positions, self.vertices))
    }

    fn edges(&self, gpu: &Gpu) -> Result<Option<&CasterEdges>, GpuError> {
        if let Some(made) = self.edges.get() {
            return Ok(Some(made));
        }
        let (positions, triangles) = self.geometry(gpu)?;
        let made = CasterEdges::new(gpu, &Edges::new(&positions, &triangles))?;
        Ok(Some(self.edges.get_or_init(|| made)))
    }

    fn clusters(&self, gpu: &Gpu) -> Option<CasterClusters<'_>> {
        let clusters = self.clusters.get_or_init(|| {
            let records = cluster_records(&self.parts, self.origin);
            gpu.buffer("clusters", bytemuck::cast_slice(&records), wgpu::BufferUsages::STORAGE)
        });
        let whole = self.parts.iter().filter(|part| !part.cut);
        Some(CasterClusters {
            clusters,
            indices: &self.indices,
            count: self.parts.iter().map(|part| part.clusters.len() as u32).sum(),
            indices_count: self.parts.iter().map(|part| part.indices.len() as u32).sum(),
            holes: whole.map(|part| part.indices.len() as u32).sum(),
        })
    }

    fn kept_clusters(&self, view: &LightView<'_>, visit: &mut dyn FnMut(Range<u32>)) {
        let matters = self.matters(view);
        let mut first = 0;
        for part in &self.parts {
            if matters(part) {
                for (i, bounds) in part.boxes.iter().enumerate() {
                    if self.is_seen(view, bounds) {
                        visit(first + i as u32..first + i as u32 + 1);
                    }
                }
            }
            first += part.clusters.len() as u32;
        }
    }

    fn draw_listed(
        &self,
        view: &LightView<'_>,
        list: &ListedTriangles<'_>,
        pass: &mut wgpu::RenderPass<'_>,
    ) -> u64 {
        pass.set_pipeline(&self.depth);
        pass.set_bind_group(0, view.bind_group, &[view.offset]);
        pass.set_vertex_buffer(0, self.positions.slice(..));
        pass.set_index_buffer(list.indices.slice(..), wgpu::IndexFormat::Uint32);
        pass.draw_indexed_indirect(list.draws, list.offset);
        let Some(cutouts) = &self.cutouts else {
            return 1;
        };
        pass.set_pipeline(&cutouts.depth);
        pass.set_bind_group(1, &cutouts.group, &[]);
        pass.set_vertex_buffer(1, cutouts.coordinates.slice(..));
        pass.draw_indexed_indirect(list.draws, list.offset + INDIRECT_DRAW);
        2
    }

    fn ranges(&self, view: &LightView<'_>, visit: &mut dyn FnMut(Range<u32>)) {
        self.runs(view, |_| true, |range| visit(range.start / 3..range.end / 3));
    }
}

/// Calls `visit` with `ranges`, those that follow one another as one.
fn join(ranges: impl Iterator<Item = Range<u32>>, mut visit: impl FnMut(Range<u32>)) {
    let mut run = 0..0;
    for range in ranges {
        if run.end != range.start {
            let done = std::mem::replace(&mut run, range.clone());
            if !done.is_empty() {
                visit(done);
            }
        }
        run.end = range.end;
    }
    if !run.is_empty() {
        visit(run);
    }
}

/// Whether the whole box lies beyond one plane of the clip volume, or of the volume that matters. Near and far do
/// not count: what lies between the light and its near plane is the fit's business.
fn outside(view: &LightView<'_>, bounds: &Bounds) -> bool {
    let corners = bounds.corners().map(|c| c - view.origin);
    let clipped = corners.map(|c| view.clip * c.as_vec3().extend(1.0));
    let beyond: [fn(&Vec4) -> bool; 5] =
        [|c| c.x > c.w, |c| -c.x > c.w, |c| c.y > c.w, |c| -c.y > c.w, |c| c.w <= 0.0];
    let behind = |plane: &DVec4| corners.iter().all(|c| plane.truncate().dot(*c) + plane.w < 0.0);
    beyond.iter().any(|plane| clipped.iter().all(plane)) || view.volume.iter().any(behind)
}

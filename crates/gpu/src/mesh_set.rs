//! A ready-made set of meshes: casters for the light, and view samples for the camera.

use std::ops::Range;
use std::sync::OnceLock;

use antumbra_scene::{Bounds, Camera, Light, MeshError, Scene, Triangles};
use glam::{DVec3, DVec4, Vec3, Vec4};

use crate::record::depth_attachment;
use crate::{
    CasterBody, CasterEdges, CasterTriangles, Casters, Drawn, Edges, Gpu, GpuError, LightView,
    Recorder, ViewCamera, ViewSamples, bind, entries, light_view_layout,
};

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
    camera: wgpu::Buffer,
    camera_group: wgpu::BindGroup,
    cull: bool,
    /// Positions and triangles, for the edges, which are made when first asked for.
    geometry: (Vec<Vec3>, Vec<[u32; 3]>),
    edges: OnceLock<CasterEdges>,
}

/// One instance of the scene.
#[derive(Clone, Debug)]
struct Part {
    /// Its range in the index buffer.
    indices: Range<u32>,
    /// World-space box.
    bounds: Bounds,
    /// Its triangles in groups, in the order of the index buffer.
    clusters: Vec<Cluster>,
    /// For a flat part that bounds the scene: its plane (xyz unit normal, w offset), the rest of the
    /// scene on the positive side.
    floor: Option<DVec4>,
}

/// Triangles of one instance that lie near one another.
#[derive(Clone, Debug)]
struct Cluster {
    /// Their range in the index buffer.
    indices: Range<u32>,
    /// World-space box.
    bounds: Bounds,
}

/// Most triangles of a cluster. Smaller ones cull more and cost more boxes to test: a mesh of 200,000 triangles has
/// some 8000 of them.
const CLUSTER: usize = 32;

#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
struct CameraUniform {
    clip: [[f32; 4]; 4],
    eye: [f32; 4],
}

/// Depth format of casters' passes.
const DEPTH: wgpu::TextureFormat = wgpu::TextureFormat::Depth32Float;

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

    /// Uploads triangles whose positions are finite and whose indices are in range. Within an instance they are
    /// reordered, so that neighbours in space are neighbours in the index buffer and can be culled together.
    ///
    /// # Errors
    /// More data than the device takes in one buffer.
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
        let buffer = |label, contents: &[u8], usage| {
            // A buffer may not be empty; four bytes that nothing draws.
            let contents = if contents.is_empty() { &[0; 4] } else { contents };
            gpu.buffer(label, contents, usage | wgpu::BufferUsages::STORAGE)
        };
        let positions = buffer(
            "positions",
            bytemuck::cast_slice(&triangles.positions),
            wgpu::BufferUsages::VERTEX,
        );
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
        let (samples, camera_layout) = samples_pipeline(gpu)?;
        let camera_group = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("view samples"),
            layout: &camera_layout,
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
            depth: depth_pipeline(gpu)?,
            samples,
            camera,
            camera_group,
            cull: true,
            geometry: (triangles.positions.clone(), order),
            edges: OnceLock::new(),
        })
    }

    /// With `false`, every triangle is drawn into every light view, and views are fitted to all of them, floors and
    /// what is out of sight included. Culling only changes how much a texel covers. For proving it.
    pub fn set_culling(&mut self, cull: bool) {
        self.cull = cull;
    }

    /// Positions relative to [`MeshSet::origin`], and triangles in the order in which the GPU holds them: that of
    /// their clusters, instance by instance.
    #[must_use]
    pub fn geometry(&self) -> (&[Vec3], &[[u32; 3]]) {
        (&self.geometry.0, &self.geometry.1)
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
            eye: camera.eye.as_vec3().extend(1.0).to_array(),
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
        pass.set_pipeline(&self.samples);
        pass.set_bind_group(0, &self.camera_group, &[]);
        pass.draw(0..self.parts.last().map_or(0, |p| p.indices.end), 0..1);
    }

    /// The parts that can shadow something under `light`.
    fn casting(&self, light: &Light) -> impl Iterator<Item = &Part> {
        self.parts.iter().filter(self.can_cast(light))
    }

    fn can_cast(&self, light: &Light) -> impl Fn(&&Part) -> bool {
        let light = *light;
        let lies_below = move |floor: &DVec4| match light {
            // A wide sun that dips below the floor's plane still only lights it from behind.
            Light::Directional { direction, .. } => direction.dot(floor.truncate()) <= 0.0,
            _ => light.position().is_some_and(|p| p.dot(floor.truncate()) + floor.w >= 0.0),
        };
        let cull = self.cull;
        move |part| !(cull && part.floor.as_ref().is_some_and(lies_below))
    }

    /// Calls `visit` with the ranges of the index buffer that can shadow something in `view`. Clusters that follow
    /// one another are one range.
    fn runs(&self, view: &LightView<'_>, mut visit: impl FnMut(Range<u32>)) {
        let seen = |bounds: &Bounds| !(self.cull && outside(view, bounds));
        let casts = self.can_cast(view.light);
        let matters = |part: &&Part| (view.receivers || casts(part)) && seen(&part.bounds);
        let mut run = 0..0;
        for part in self.parts.iter().filter(matters) {
            for cluster in part.clusters.iter().filter(|cluster| seen(&cluster.bounds)) {
                if run.end != cluster.indices.start {
                    let done = std::mem::replace(&mut run, cluster.indices.clone());
                    if !done.is_empty() {
                        visit(done);
                    }
                }
                run.end = cluster.indices.end;
            }
        }
        if !run.is_empty() {
            visit(run);
        }
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

    fn boxes(&self, light: &Light, visit: &mut dyn FnMut(Bounds)) {
        for cluster in self.casting(light).flat_map(|part| &part.clusters) {
            visit(cluster.bounds);
        }
    }

    fn receivers(&self, visit: &mut dyn FnMut(Bounds)) -> bool {
        if self.cull {
            self.parts.iter().flat_map(|part| &part.clusters).for_each(|c| visit(c.bounds));
        }
        self.cull
    }

    fn draw(&self, view: &LightView<'_>, pass: &mut wgpu::RenderPass<'_>) -> Drawn {
        let mut drawn = Drawn::default();
        pass.set_pipeline(&self.depth);
        pass.set_bind_group(0, view.bind_group, &[view.offset]);
        pass.set_vertex_buffer(0, self.positions.slice(..));
        pass.set_index_buffer(self.indices.slice(..), wgpu::IndexFormat::Uint32);
        self.runs(view, |range| {
            drawn.draws += 1;
            drawn.triangles += u64::from((range.end - range.start) / 3);
            pass.draw_indexed(range, 0, 0..1);
        });
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

    fn bodies(&self, visit: &mut dyn FnMut(&CasterBody)) {
        for part in &self.parts {
            visit(&CasterBody { bounds: part.bounds, floor: part.floor });
        }
    }

    fn edges(&self, gpu: &Gpu) -> Result<Option<&CasterEdges>, GpuError> {
        if let Some(made) = self.edges.get() {
            return Ok(Some(made));
        }
        let (positions, triangles) = &self.geometry;
        let made = CasterEdges::new(gpu, &Edges::new(positions, triangles))?;
        Ok(Some(self.edges.get_or_init(|| made)))
    }

    fn ranges(&self, view: &LightView<'_>, visit: &mut dyn FnMut(Range<u32>)) {
        self.runs(view, |range| visit(range.start / 3..range.end / 3));
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

/// The number of the instance to which each triangle belongs.
fn objects(triangles: &Triangles) -> Vec<u32> {
    let mut objects = vec![0; triangles.triangles.len()];
    for (object, range) in triangles.instances.iter().enumerate() {
        objects[range.clone()].fill(object as u32);
    }
    objects
}

/// The instances of `triangles`, and the triangles in the order of their clusters.
fn parts(triangles: &Triangles) -> (Vec<Part>, Vec<[u32; 3]>) {
    let place = |i: u32| triangles.positions[i as usize].as_dvec3() + triangles.origin;
    let mut order = triangles.triangles.clone();
    let mut parts = Vec::new();
    for range in triangles.instances.iter().filter(|range| !range.is_empty()) {
        let mut clusters = Vec::new();
        split(&mut order[range.clone()], range.start, &place, &mut clusters);
        let bounds = clusters.iter().fold(Bounds::EMPTY, |all, c| all.union(c.bounds));
        let indices = range.start as u32 * 3..range.end as u32 * 3;
        parts.push(Part { indices, bounds, clusters, floor: None });
    }
    for i in 0..parts.len() {
        parts[i].floor = floor_plane(triangles, &parts, i);
    }
    (parts, order)
}

/// Splits `triangles`, the first of which is number `first`, into clusters: in halves by their middles along the
/// longest side of the box around these.
fn split(
    triangles: &mut [[u32; 3]],
    first: usize,
    place: &impl Fn(u32) -> DVec3,
    clusters: &mut Vec<Cluster>,
) {
    if triangles.len() <= CLUSTER {
        let indices = first as u32 * 3..(first + triangles.len()) as u32 * 3;
        let bounds = Bounds::of(triangles.iter().flatten().map(|i| place(*i)));
        clusters.push(Cluster { indices, bounds });
        return;
    }
    let middle = |t: &[u32; 3]| t.iter().map(|i| place(*i)).sum::<DVec3>();
    let spread = Bounds::of(triangles.iter().map(middle));
    let axis = (spread.max - spread.min).max_position();
    let half = triangles.len() / 2;
    // Ties are broken by the vertices, so that the order is that of the triangles and no chance's.
    triangles.sort_by(|s, t| middle(s)[axis].total_cmp(&middle(t)[axis]).then(s.cmp(t)));
    let (low, high) = triangles.split_at_mut(half);
    split(low, first, place, clusters);
    split(high, first + half, place, clusters);
}

/// The plane of part `i`, when the part is flat and no other part reaches below it.
///
/// Such a part hides nothing from a light on its upper side: whatever it could shadow lies below it. The
/// part is taken as flat only when its vertices share a plane exactly, which an axis-aligned ground does;
/// a rotated one merely costs a draw.
fn floor_plane(triangles: &Triangles, parts: &[Part], i: usize) -> Option<DVec4> {
    let range = (parts[i].indices.start / 3) as usize..(parts[i].indices.end / 3) as usize;
    let point = |index: u32| triangles.positions[index as usize].as_dvec3() + triangles.origin;
    let first = triangles.triangles[range.clone()].iter().find_map(|t| {
        let [a, b, c] = t.map(point);
        let n = (b - a).cross(c - a).normalize_or_zero();
        (n != DVec3::ZERO).then(|| n.extend(-n.dot(a)))
    })?;
    let side = |p: DVec3| p.dot(first.truncate()) + first.w;
    if triangles.triangles[range].iter().flatten().any(|&v| side(point(v)) != 0.0) {
        return None;
    }
    let others = || {
        let rest = parts.iter().enumerate().filter(move |(j, _)| *j != i);
        rest.flat_map(|(_, part)| part.bounds.corners()).map(side)
    };
    if others().all(|s| s >= 0.0) {
        Some(first)
    } else if others().all(|s| s <= 0.0) {
        Some(-first)
    } else {
        None
    }
}

fn depth_pipeline(gpu: &Gpu) -> Result<wgpu::RenderPipeline, GpuError> {
    let device = &gpu.device;
    let module = gpu.shader("light depth", antumbra_shaders::link("gpu::light_depth", &[])?);
    Ok(device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some("light depth"),
        layout: Some(&device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some("light depth"),
            bind_group_layouts: &[Some(&light_view_layout(device))],
            immediate_size: 0,
        })),
        vertex: wgpu::VertexState {
            module: &module,
            entry_point: Some("vertex"),
            compilation_options: Default::default(),
            buffers: &[Some(wgpu::VertexBufferLayout {
                array_stride: 12,
                step_mode: wgpu::VertexStepMode::Vertex,
                attributes: &wgpu::vertex_attr_array![0 => Float32x3],
            })],
        },
        primitive: wgpu::PrimitiveState::default(),
        depth_stencil: Some(reversed_depth()),
        multisample: Default::default(),
        fragment: None,
        multiview_mask: None,
        cache: None,
    }))
}

fn samples_pipeline(gpu: &Gpu) -> Result<(wgpu::RenderPipeline, wgpu::BindGroupLayout), GpuError> {
    const VS: wgpu::ShaderStages = wgpu::ShaderStages::VERTEX;
    let device = &gpu.device;
    let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: Some("view samples"),
        entries: &[
            entries::uniform(0, VS | wgpu::ShaderStages::FRAGMENT),
            entries::storage(1, VS),
            entries::storage(2, VS),
            entries::storage(3, VS),
        ],
    });
    let module = gpu.shader("view samples", antumbra_shaders::link("gpu::view_samples", &[])?);
    let target = Some(wgpu::ColorTargetState::from(ViewSamples::FORMAT));
    let pipeline = device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some("view samples"),
        layout: Some(&device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some("view samples"),
            bind_group_layouts: &[Some(&layout)],
            immediate_size: 0,
        })),
        vertex: wgpu::VertexState {
            module: &module,
            entry_point: Some("vertex"),
            compilation_options: Default::default(),
            buffers: &[],
        },
        primitive: wgpu::PrimitiveState::default(),
        depth_stencil: Some(reversed_depth()),
        multisample: Default::default(),
        fragment: Some(wgpu::FragmentState {
            module: &module,
            entry_point: Some("fragment"),
            compilation_options: Default::default(),
            targets: &[target.clone(), target],
        }),
        multiview_mask: None,
        cache: None,
    });
    Ok((pipeline, layout))
}

/// Reversed depth keeps its precision far away: `f32` steps shrink towards 0.
fn reversed_depth() -> wgpu::DepthStencilState {
    wgpu::DepthStencilState {
        format: DEPTH,
        depth_write_enabled: Some(true),
        depth_compare: Some(wgpu::CompareFunction::Greater),
        stencil: Default::default(),
        bias: Default::default(),
    }
}

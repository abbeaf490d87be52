//! Draws triangles into charts of directions: the depth passes of curved layouts.

use antumbra_gpu::{BindGroupCache, CasterTriangles, Casters, Drawn, Gpu, GpuError, bind, entries};
use glam::Mat4;

use crate::{Drawing, Layout, ShadowMap};

/// The depth pass of a layout whose casters are not drawn by a matrix.
#[derive(Debug)]
pub(crate) struct ChartPass {
    layout: Layout,
    pipeline: wgpu::RenderPipeline,
    group_layout: wgpu::BindGroupLayout,
    group: BindGroupCache<[wgpu::Buffer; 3]>,
    bound: Option<wgpu::BindGroup>,
}

impl ChartPass {
    pub(crate) fn new(gpu: &Gpu, layout: &Layout) -> Result<Self, GpuError> {
        const VS: wgpu::ShaderStages = wgpu::ShaderStages::VERTEX;
        let device = &gpu.device;
        let (label, root) = match layout.drawing {
            Drawing::Warped => ("map/warped", "map::warped"),
            _ => ("map/traced", "map::traced"),
        };
        let group_layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some(label),
            entries: &[
                wgpu::BindGroupLayoutEntry {
                    binding: 0,
                    visibility: wgpu::ShaderStages::VERTEX_FRAGMENT,
                    ty: wgpu::BindingType::Buffer {
                        ty: wgpu::BufferBindingType::Uniform,
                        has_dynamic_offset: true,
                        min_binding_size: wgpu::BufferSize::new(size_of::<Mat4>() as u64),
                    },
                    count: None,
                },
                entries::storage(1, VS),
                entries::storage(2, VS),
            ],
        });
        let shader = gpu.shader(label, antumbra_shaders::link(root, &layout.slots)?);
        let pipeline = device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some(label),
            layout: Some(&device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
                label: Some(label),
                bind_group_layouts: &[Some(&group_layout)],
                immediate_size: 0,
            })),
            vertex: wgpu::VertexState {
                module: &shader,
                entry_point: Some("vertex"),
                compilation_options: Default::default(),
                buffers: &[],
            },
            primitive: wgpu::PrimitiveState::default(),
            depth_stencil: Some(wgpu::DepthStencilState {
                format: ShadowMap::FORMAT,
                depth_write_enabled: Some(true),
                depth_compare: Some(wgpu::CompareFunction::Greater),
                stencil: Default::default(),
                bias: Default::default(),
            }),
            multisample: Default::default(),
            fragment: Some(wgpu::FragmentState {
                module: &shader,
                entry_point: Some("fragment"),
                compilation_options: Default::default(),
                targets: &[],
            }),
            multiview_mask: None,
            cache: None,
        });
        Ok(Self {
            layout: layout.clone(),
            pipeline,
            group_layout,
            group: BindGroupCache::default(),
            bound: None,
        })
    }

    /// Whether this is the pass of `layout`.
    pub(crate) fn serves(&self, layout: &Layout) -> bool {
        self.layout == *layout
    }

    /// Binds what [`ChartPass::draw`] draws: triangles, and the matrices of the views.
    pub(crate) fn bind(
        &mut self,
        gpu: &Gpu,
        triangles: &CasterTriangles<'_>,
        matrices: &wgpu::Buffer,
    ) {
        let key = [matrices, triangles.positions, triangles.indices].map(Clone::clone);
        let group = self.group.get(key, |[matrices, positions, indices]| {
            gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("chart"),
                layout: &self.group_layout,
                entries: &[
                    wgpu::BindGroupEntry {
                        binding: 0,
                        resource: wgpu::BindingResource::Buffer(wgpu::BufferBinding {
                            buffer: matrices,
                            offset: 0,
                            size: wgpu::BufferSize::new(size_of::<Mat4>() as u64),
                        }),
                    },
                    bind::buffer(1, positions),
                    bind::buffer(2, indices),
                ],
            })
        });
        self.bound = Some(group.clone());
    }

    /// Draws all triangles into `pass`, through the matrix at `offset`.
    pub(crate) fn draw(
        &self,
        triangles: &CasterTriangles<'_>,
        offset: u32,
        pass: &mut wgpu::RenderPass<'_>,
    ) -> Drawn {
        let Some(group) = &self.bound else { return Drawn::default() };
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, group, &[offset]);
        let vertices = if self.layout.drawing == Drawing::Warped { 3 } else { 6 };
        pass.draw(0..vertices * triangles.triangles, 0..1);
        Drawn { draws: 1, triangles: triangles.triangles.into() }
    }
}

/// The triangles that a curved layout draws.
pub(crate) fn triangles_of(casters: &dyn Casters) -> Result<CasterTriangles<'_>, GpuError> {
    casters.triangles().ok_or_else(|| GpuError::Invalid {
        what: "casters",
        value: "without triangles".to_owned(),
        fix: "implement `Casters::triangles`, or choose the cube or the tetrahedron, which need none",
    })
}

//! Pipelines, and the bind groups that they share.

use antumbra_gpu::{BindGroupCache, Gpu, GpuError, bind, entries};
use antumbra_map::ShadowMap;
use antumbra_shaders::module;

/// Something that a bind group holds.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Bound {
    Buffer(wgpu::Buffer),
    Texture(wgpu::TextureView),
}

impl From<&wgpu::Buffer> for Bound {
    fn from(buffer: &wgpu::Buffer) -> Self {
        Self::Buffer(buffer.clone())
    }
}

impl From<&wgpu::TextureView> for Bound {
    fn from(view: &wgpu::TextureView) -> Self {
        Self::Texture(view.clone())
    }
}

/// A layout with the bind group made of it last.
#[derive(Debug)]
pub(super) struct Group {
    pub(super) layout: wgpu::BindGroupLayout,
    made: BindGroupCache<Vec<Bound>>,
}

impl Group {
    fn new(gpu: &Gpu, label: &str, entries: &[wgpu::BindGroupLayoutEntry]) -> Self {
        let layout = gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some(label),
            entries,
        });
        Self { layout, made: BindGroupCache::default() }
    }

    /// The bind group of these, in the order of their bindings.
    pub(super) fn of<const N: usize>(&mut self, gpu: &Gpu, bound: [Bound; N]) -> wgpu::BindGroup {
        let layout = &self.layout;
        let group = self.made.get(bound.to_vec(), |bound| {
            let entries: Vec<_> = (0..)
                .zip(bound)
                .map(|(i, bound)| match bound {
                    Bound::Buffer(buffer) => bind::buffer(i, buffer),
                    Bound::Texture(view) => bind::texture(i, view),
                })
                .collect();
            gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("sampling/matched"),
                layout,
                entries: &entries,
            })
        });
        group.clone()
    }

    /// The bind group made last.
    pub(super) fn kept(&self) -> Option<&wgpu::BindGroup> {
        self.made.kept()
    }
}

/// The passes.
#[derive(Debug)]
pub(super) struct Passes {
    pub(super) requests: Group,
    pub(super) pages: Group,
    pub(super) casters: Group,
    pub(super) views: Group,
    pub(super) drawing: Group,
    pub(super) lookups: Group,
    pub(super) slot_layout: wgpu::BindGroupLayout,
    pub(super) request: wgpu::ComputePipeline,
    pub(super) gather: wgpu::ComputePipeline,
    pub(super) weigh: wgpu::ComputePipeline,
    pub(super) assign: wgpu::ComputePipeline,
    pub(super) occupy: wgpu::ComputePipeline,
    pub(super) count: wgpu::ComputePipeline,
    pub(super) plan: wgpu::ComputePipeline,
    pub(super) list: wgpu::ComputePipeline,
    pub(super) wipe: wgpu::RenderPipeline,
    pub(super) draw: wgpu::RenderPipeline,
}

impl Passes {
    /// `select` is the module that names a point's face.
    pub(super) fn new(gpu: &Gpu, select: &'static str) -> Result<Self, GpuError> {
        use entries::{storage, texels, uniform, write_storage};
        const CS: wgpu::ShaderStages = wgpu::ShaderStages::COMPUTE;
        const VS: wgpu::ShaderStages = wgpu::ShaderStages::VERTEX;
        let written = |binding| write_storage(binding, CS);
        let mut entries_of_requests =
            vec![uniform(0, CS), texels(1, CS, false), texels(2, CS, false)];
        entries_of_requests.extend((3..=7).map(written));
        let requests = Group::new(gpu, "requests", &entries_of_requests);
        let mut entries_of_pages = vec![uniform(0, CS)];
        entries_of_pages.extend((1..=6).map(written));
        entries_of_pages.extend([storage(7, CS), written(8)]);
        let pages = Group::new(gpu, "pages", &entries_of_pages);
        let casters = Group::new(
            gpu,
            "casters on pages",
            &[
                uniform(0, CS),
                written(1),
                storage(2, CS),
                written(3),
                storage(4, CS),
                storage(5, CS),
                storage(6, CS),
                written(7),
            ],
        );
        let mut entries_of_drawing = vec![uniform(0, VS)];
        entries_of_drawing.extend((1..=5).map(|binding| storage(binding, VS)));
        let drawing = Group::new(gpu, "drawing of pages", &entries_of_drawing);
        let lookups = Group::new(
            gpu,
            "lookups in pages",
            &[uniform(0, CS), storage(1, CS), storage(2, CS), storage(3, CS)],
        );
        let views = Group::new(gpu, "views", &[storage(0, CS)]);
        let slot_layout = gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("slot"),
            entries: &[wgpu::BindGroupLayoutEntry {
                binding: 0,
                visibility: VS,
                ty: wgpu::BindingType::Buffer {
                    ty: wgpu::BufferBindingType::Uniform,
                    has_dynamic_offset: true,
                    min_binding_size: wgpu::BufferSize::new(16),
                },
                count: None,
            }],
        });
        let slots = [module("layout", select)];
        let shader = |root: &'static str| {
            Ok::<_, GpuError>(gpu.shader(root, antumbra_shaders::link(root, &slots)?))
        };
        let compute = |module: &_, entry, group: &Group| {
            gpu.compute_pipeline("sampling/matched", module, entry, &[&group.layout])
        };
        let in_views = |module: &_, entry, group: &Group| {
            let layouts = [&group.layout, &views.layout];
            gpu.compute_pipeline("sampling/matched", module, entry, &layouts)
        };
        let of_requests = shader("sampling::matched_request")?;
        let of_pages = shader("sampling::matched_pages")?;
        let of_casters = shader("sampling::matched_casters")?;
        let drawn = shader("sampling::matched_draw")?;
        let layout = gpu.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some("pages"),
            bind_group_layouts: &[Some(&drawing.layout), Some(&slot_layout)],
            immediate_size: 0,
        });
        Ok(Self {
            request: in_views(&of_requests, "request", &requests),
            gather: compute(&of_pages, "gather", &pages),
            weigh: compute(&of_pages, "weigh", &pages),
            assign: compute(&of_pages, "assign", &pages),
            plan: compute(&of_pages, "plan", &pages),
            occupy: compute(&of_casters, "occupy", &casters),
            count: compute(&of_casters, "count", &casters),
            list: compute(&of_casters, "list", &casters),
            wipe: depth(gpu, &layout, &drawn, "wipe", wgpu::CompareFunction::Always),
            draw: depth(gpu, &layout, &drawn, "vertex", wgpu::CompareFunction::Greater),
            requests,
            pages,
            casters,
            views,
            drawing,
            lookups,
            slot_layout,
        })
    }
}

/// A pipeline that draws both faces of triangles, depth alone.
fn depth(
    gpu: &Gpu,
    layout: &wgpu::PipelineLayout,
    module: &wgpu::ShaderModule,
    entry_point: &str,
    compare: wgpu::CompareFunction,
) -> wgpu::RenderPipeline {
    gpu.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some("pages"),
        layout: Some(layout),
        vertex: wgpu::VertexState {
            module,
            entry_point: Some(entry_point),
            compilation_options: Default::default(),
            buffers: &[],
        },
        primitive: wgpu::PrimitiveState::default(),
        depth_stencil: Some(wgpu::DepthStencilState {
            format: ShadowMap::FORMAT,
            depth_write_enabled: Some(true),
            depth_compare: Some(compare),
            stencil: Default::default(),
            bias: Default::default(),
        }),
        multisample: Default::default(),
        fragment: None,
        multiview_mask: None,
        cache: None,
    })
}

//! How the passes over faces are set up.

use antumbra_gpu::{Gpu, entries};

use super::{Counter, DOUBTS, STENCIL};

pub(super) fn draw_layout(gpu: &Gpu) -> wgpu::BindGroupLayout {
    const VS: wgpu::ShaderStages = wgpu::ShaderStages::VERTEX;
    const FS: wgpu::ShaderStages = wgpu::ShaderStages::FRAGMENT;
    gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: Some("volume count"),
        entries: &[
            entries::uniform(0, VS | FS),
            // Fragments of cast caps ask for their triangle again.
            entries::storage(1, VS | FS),
            entries::storage(2, VS | FS),
            entries::storage(3, VS),
            entries::storage(4, VS),
            // Of what size the picture is, the vertices ask.
            entries::texels(5, VS | FS, false),
            entries::texels(6, FS, false),
            entries::write_storage(7, FS),
            entries::storage(8, VS),
            entries::write_storage(9, FS),
        ],
    })
}

pub(super) fn resolve_layout(gpu: &Gpu) -> wgpu::BindGroupLayout {
    const CS: wgpu::ShaderStages = wgpu::ShaderStages::COMPUTE;
    gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: Some("volume resolve"),
        entries: &[
            entries::uniform(0, CS),
            entries::texels(1, CS, false),
            entries::texels(2, CS, false),
            entries::storage(3, CS),
            entries::storage(4, CS),
            entries::integers(5, CS),
            entries::write_texture(6, CS, wgpu::TextureFormat::R32Float),
        ],
    })
}

/// What a face does to the stencil: see `around` in `volume/outline.wesl`.
pub(super) fn stencil_state(counter: Counter) -> wgpu::StencilState {
    use wgpu::StencilOperation::{DecrementWrap, IncrementWrap};
    if counter == Counter::Wide {
        return wgpu::StencilState::default();
    }
    // Wrapping, so that the order does not matter.
    let step = |pass_op| wgpu::StencilFaceState {
        compare: wgpu::CompareFunction::Always,
        pass_op,
        ..wgpu::StencilFaceState::IGNORE
    };
    wgpu::StencilState {
        front: step(DecrementWrap),
        back: step(IncrementWrap),
        read_mask: 0xff,
        write_mask: 0xff,
    }
}

pub(super) fn faces_pipeline(
    gpu: &Gpu,
    module: &wgpu::ShaderModule,
    layout: &wgpu::PipelineLayout,
    stencil: wgpu::StencilState,
    vertex: &'static str,
    fragment: &'static str,
) -> wgpu::RenderPipeline {
    let add = wgpu::BlendComponent {
        src_factor: wgpu::BlendFactor::One,
        dst_factor: wgpu::BlendFactor::One,
        operation: wgpu::BlendOperation::Add,
    };
    gpu.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some(vertex),
        layout: Some(layout),
        vertex: wgpu::VertexState {
            module,
            entry_point: Some(vertex),
            compilation_options: Default::default(),
            buffers: &[],
        },
        primitive: wgpu::PrimitiveState::default(),
        depth_stencil: Some(wgpu::DepthStencilState {
            format: STENCIL,
            depth_write_enabled: None,
            depth_compare: None,
            stencil,
            bias: Default::default(),
        }),
        multisample: Default::default(),
        fragment: Some(wgpu::FragmentState {
            module,
            entry_point: Some(fragment),
            compilation_options: Default::default(),
            // With the stencil, what is certain passes too, and adds no doubt.
            targets: &[Some(wgpu::ColorTargetState {
                format: DOUBTS,
                blend: Some(wgpu::BlendState { color: add, alpha: add }),
                write_mask: wgpu::ColorWrites::ALL,
            })],
        }),
        multiview_mask: None,
        cache: None,
    })
}

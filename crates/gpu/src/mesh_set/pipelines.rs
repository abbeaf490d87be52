//! The passes that draw a mesh set, over whole triangles and over those with holes.

use crate::{Gpu, GpuError, ViewSamples, entries, light_view_layout};

/// Depth format of casters' passes.
const DEPTH: wgpu::TextureFormat = wgpu::TextureFormat::Depth32Float;

/// Depth as the light sees it; with the layout of the cut-outs' group, of triangles with holes, whose second vertex buffer
/// is that of their texture coordinates.
pub(super) fn depth_pipeline(
    gpu: &Gpu,
    cut: Option<&wgpu::BindGroupLayout>,
) -> Result<wgpu::RenderPipeline, GpuError> {
    let device = &gpu.device;
    let root = if cut.is_some() { "gpu::light_depth_cut" } else { "gpu::light_depth" };
    let module = gpu.shader("light depth", antumbra_shaders::link(root, &[])?);
    let view = light_view_layout(device);
    let groups = [Some(&view), cut];
    let positions = wgpu::VertexBufferLayout {
        array_stride: 12,
        step_mode: wgpu::VertexStepMode::Vertex,
        attributes: &wgpu::vertex_attr_array![0 => Float32x3],
    };
    let coordinates = wgpu::VertexBufferLayout {
        attributes: &wgpu::vertex_attr_array![1 => Float32x2, 2 => Uint32],
        ..positions.clone()
    };
    let buffers = [Some(positions), Some(coordinates)];
    let used = if cut.is_some() { 2 } else { 1 };
    Ok(device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some("light depth"),
        layout: Some(&device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some("light depth"),
            bind_group_layouts: &groups[..used],
            immediate_size: 0,
        })),
        vertex: wgpu::VertexState {
            module: &module,
            entry_point: Some("vertex"),
            compilation_options: Default::default(),
            buffers: &buffers[..used],
        },
        primitive: wgpu::PrimitiveState::default(),
        depth_stencil: Some(reversed_depth()),
        multisample: Default::default(),
        fragment: cut.map(|_| wgpu::FragmentState {
            module: &module,
            entry_point: Some("fragment"),
            compilation_options: Default::default(),
            targets: &[],
        }),
        multiview_mask: None,
        cache: None,
    }))
}

/// The bind group of the view samples' pass.
pub(super) fn samples_layout(gpu: &Gpu) -> wgpu::BindGroupLayout {
    const VS: wgpu::ShaderStages = wgpu::ShaderStages::VERTEX;
    gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: Some("view samples"),
        entries: &[
            entries::uniform(0, VS | wgpu::ShaderStages::FRAGMENT),
            entries::storage(1, VS),
            entries::storage(2, VS),
            entries::storage(3, VS),
        ],
    })
}

/// View samples; with the layout of the cut-outs' group, of triangles with holes.
pub(super) fn samples_pipeline(
    gpu: &Gpu,
    layout: &wgpu::BindGroupLayout,
    cut: Option<&wgpu::BindGroupLayout>,
) -> Result<wgpu::RenderPipeline, GpuError> {
    let device = &gpu.device;
    let root = if cut.is_some() { "gpu::view_samples_cut" } else { "gpu::view_samples" };
    let module = gpu.shader("view samples", antumbra_shaders::link(root, &[])?);
    let groups = [Some(layout), cut];
    let used = if cut.is_some() { 2 } else { 1 };
    let target = Some(wgpu::ColorTargetState::from(ViewSamples::FORMAT));
    Ok(device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some("view samples"),
        layout: Some(&device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some("view samples"),
            bind_group_layouts: &groups[..used],
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
    }))
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

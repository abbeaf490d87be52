//! Depth of casters drawn from their triangles, for maps that need more than [`Casters::draw`] promises:
//! only some faces, a polygon offset, or depths that a later pass finds again bit for bit.

use antumbra_gpu::{CasterTriangles, Casters, Drawn, Gpu, GpuError, LightView, light_view_layout};

use crate::ShadowMap;

/// Which faces of the casters are drawn. A face's front is the side from which its corners run
/// counter-clockwise.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Faces {
    /// All of them, whichever way they are wound.
    #[default]
    Both,
    /// Those whose front looks away from the light.
    Back,
}

/// What the hardware adds to each depth that it stores (`glPolygonOffset`): `factor` m + `units` r, away from
/// the light, with m the triangle's change of depth across a texel along the steeper axis, and r the smallest
/// step of depth at the triangle's nearest vertex, 2^(exponent - 23) for 32-bit float.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PolygonOffset {
    /// Factor on the slope.
    pub factor: f32,
    /// Steps of depth.
    pub units: i32,
}

/// A depth pass over [`Casters::triangles`].
#[derive(Debug)]
pub struct CasterDepth {
    pipeline: wgpu::RenderPipeline,
}

impl CasterDepth {
    /// Builds the pass.
    ///
    /// # Errors
    /// A shader that does not link (a fault of this library).
    pub fn new(gpu: &Gpu, faces: Faces, offset: PolygonOffset) -> Result<Self, GpuError> {
        let device = &gpu.device;
        let module = gpu.shader("light depth", antumbra_shaders::link("gpu::light_depth", &[])?);
        let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some("caster depth"),
            bind_group_layouts: &[Some(&light_view_layout(device))],
            immediate_size: 0,
        });
        // Reversed depth: away from the light is less.
        let bias = wgpu::DepthBiasState {
            constant: offset.units.saturating_neg(),
            slope_scale: -offset.factor,
            clamp: 0.0,
        };
        let pipeline = device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            primitive: wgpu::PrimitiveState {
                cull_mode: match faces {
                    Faces::Both => None,
                    Faces::Back => Some(wgpu::Face::Front),
                },
                ..Default::default()
            },
            depth_stencil: Some(wgpu::DepthStencilState { bias, ..nearest() }),
            ..pipeline("caster depth", &layout, &module, None)
        });
        Ok(Self { pipeline })
    }

    /// Draws what casts into `view`.
    pub(crate) fn draw(
        &self,
        casters: &dyn Casters,
        triangles: &CasterTriangles<'_>,
        view: &LightView<'_>,
        pass: &mut wgpu::RenderPass<'_>,
    ) -> Drawn {
        pass.set_pipeline(&self.pipeline);
        draw(casters, triangles, view, pass)
    }
}

/// The casters' triangles.
///
/// # Errors
/// Casters that keep them to themselves.
pub(crate) fn triangles(casters: &dyn Casters) -> Result<CasterTriangles<'_>, GpuError> {
    casters.triangles().ok_or_else(|| GpuError::Invalid {
        what: "casters",
        value: "without triangles".to_owned(),
        fix: "implement `Casters::triangles`, or use a technique that needs only their depth, such as map/plain",
    })
}

/// The start of a pipeline over the casters' triangles; both faces, the nearest depth.
pub(crate) fn pipeline<'a>(
    label: &'a str,
    layout: &'a wgpu::PipelineLayout,
    module: &'a wgpu::ShaderModule,
    fragment: Option<wgpu::FragmentState<'a>>,
) -> wgpu::RenderPipelineDescriptor<'a> {
    const POSITIONS: Option<wgpu::VertexBufferLayout<'static>> = Some(wgpu::VertexBufferLayout {
        array_stride: 12,
        step_mode: wgpu::VertexStepMode::Vertex,
        attributes: &[wgpu::VertexAttribute {
            format: wgpu::VertexFormat::Float32x3,
            offset: 0,
            shader_location: 0,
        }],
    });
    wgpu::RenderPipelineDescriptor {
        label: Some(label),
        layout: Some(layout),
        vertex: wgpu::VertexState {
            module,
            entry_point: Some("vertex"),
            compilation_options: Default::default(),
            buffers: &[POSITIONS],
        },
        primitive: wgpu::PrimitiveState::default(),
        depth_stencil: Some(nearest()),
        multisample: Default::default(),
        fragment,
        multiview_mask: None,
        cache: None,
    }
}

/// Keeps the nearest depth; reversed.
fn nearest() -> wgpu::DepthStencilState {
    wgpu::DepthStencilState {
        format: ShadowMap::FORMAT,
        depth_write_enabled: Some(true),
        depth_compare: Some(wgpu::CompareFunction::Greater),
        stencil: Default::default(),
        bias: Default::default(),
    }
}

/// Draws what casts into `view`, with the pass's pipeline already set.
pub(crate) fn draw(
    casters: &dyn Casters,
    triangles: &CasterTriangles<'_>,
    view: &LightView<'_>,
    pass: &mut wgpu::RenderPass<'_>,
) -> Drawn {
    let mut drawn = Drawn::default();
    pass.set_bind_group(0, view.bind_group, &[view.offset]);
    pass.set_vertex_buffer(0, triangles.positions.slice(..));
    pass.set_index_buffer(triangles.indices.slice(..), wgpu::IndexFormat::Uint32);
    casters.ranges(view, &mut |range| {
        drawn.draws += 1;
        drawn.triangles += u64::from(range.end - range.start);
        pass.draw_indexed(3 * range.start..3 * range.end, 0, 0..1);
    });
    drawn
}

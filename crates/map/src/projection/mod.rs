//! Projection shadows: casters thrown onto planes, without a depth map.
//!
//! [`Planar`] flattens the casters' triangles onto the plane and draws them from the camera; [`ShadowTexture`] draws
//! them from the light into a mask that is read where the plane is; [`DiscShadows`] puts a disc under each body. All
//! three shadow planes only: those given, or the floors that the casters name. On everything else a surface is in
//! its own shadow where it faces away from the light, and lit where it does not.

mod disc;
pub(crate) mod expectation;
mod planar;
mod plane;
mod shadow_texture;
pub mod twin;

pub use disc::{DiscShadows, DiscTechnique};
pub use planar::{Planar, PlanarTechnique};
pub use plane::{Plane, planar_projection};
pub use shadow_texture::{ShadowTexture, ShadowTextureTechnique};

use antumbra_gpu::{CasterTriangles, Frame, Gpu, GpuError};
use glam::DVec4;
use plane::Receiver;

/// `Receiver` of `map/receiver.wesl`.
#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
struct ReceiverUniform {
    plane: [f32; 4],
    tolerance: f32,
    first: u32,
    count: u32,
    unused: u32,
}

impl ReceiverUniform {
    fn new(receiver: &Receiver, first: usize, count: usize) -> Self {
        let (plane, tolerance) = receiver.uniform();
        Self { plane, tolerance, first: first as u32, count: count as u32, unused: 0 }
    }
}

/// `Casting` of `map/receiver.wesl`.
#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
struct CastingUniform {
    light: [f32; 4],
    receivers: u32,
    unused: [u32; 3],
}

impl CastingUniform {
    fn new(light: DVec4, receivers: usize) -> Self {
        let light = light.as_vec4().to_array();
        Self { light, receivers: receivers as u32, unused: [0; 3] }
    }
}

/// A buffer that grows with what is written into it.
#[derive(Debug)]
struct Table {
    label: &'static str,
    usage: wgpu::BufferUsages,
    buffer: wgpu::Buffer,
}

impl Table {
    fn new(gpu: &Gpu, label: &'static str, usage: wgpu::BufferUsages) -> Self {
        Self { label, usage, buffer: Self::make(gpu, label, usage, 256) }
    }

    fn make(gpu: &Gpu, label: &str, usage: wgpu::BufferUsages, size: u64) -> wgpu::Buffer {
        gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some(label),
            size,
            usage: usage | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        })
    }

    /// Writes `list` to the front. The buffer is a new one when the list is longer than any before.
    ///
    /// # Errors
    /// A list longer than a buffer may be.
    fn write<T: bytemuck::Pod>(&mut self, gpu: &Gpu, list: &[T]) -> Result<(), GpuError> {
        let bytes: &[u8] = bytemuck::cast_slice(list);
        let asked = bytes.len() as u64;
        let limit = gpu.device.limits().max_storage_buffer_binding_size;
        if asked > limit {
            return Err(GpuError::Limit {
                what: "bytes of shadow casters on planes",
                asked,
                limit,
            });
        }
        if asked > self.buffer.size() {
            let size = asked.next_power_of_two().min(limit);
            self.buffer = Self::make(gpu, self.label, self.usage, size);
        }
        if !bytes.is_empty() {
            gpu.queue.write_buffer(&self.buffer, 0, bytes);
        }
        Ok(())
    }
}

/// The error of a frame that was not prepared.
fn unprepared() -> GpuError {
    GpuError::Invalid {
        what: "frame",
        value: "not prepared".to_owned(),
        fix: "call `prepare` with this frame before `encode`",
    }
}

/// The casters' triangles.
///
/// # Errors
/// Casters that keep theirs to themselves.
fn triangles<'a>(frame: &Frame<'a>) -> Result<CasterTriangles<'a>, GpuError> {
    frame.casters.triangles().ok_or_else(|| GpuError::Invalid {
        what: "casters",
        value: "without triangles".to_owned(),
        fix: "implement `Casters::triangles`, or choose a shadow map, which only draws them",
    })
}

/// The vertex buffer of [`CasterTriangles::positions`].
const VERTICES: wgpu::VertexBufferLayout<'static> = wgpu::VertexBufferLayout {
    array_stride: 12,
    step_mode: wgpu::VertexStepMode::Vertex,
    attributes: &[wgpu::VertexAttribute {
        format: wgpu::VertexFormat::Float32x3,
        offset: 0,
        shader_location: 0,
    }],
};

/// Format of masks: 1 lit, 0 dark.
const MASK: wgpu::TextureFormat = wgpu::TextureFormat::R8Unorm;

/// A render target that is cleared to white, lit, or kept.
fn mask_target(
    view: &wgpu::TextureView,
    clear: bool,
) -> Option<wgpu::RenderPassColorAttachment<'_>> {
    let load = if clear { wgpu::LoadOp::Clear(wgpu::Color::WHITE) } else { wgpu::LoadOp::Load };
    Some(wgpu::RenderPassColorAttachment {
        view,
        depth_slice: None,
        resolve_target: None,
        ops: wgpu::Operations { load, store: wgpu::StoreOp::Store },
    })
}

/// A pipeline that draws into a mask, without depth, both faces of every triangle.
fn mask_pipeline(
    gpu: &Gpu,
    label: &str,
    module: &wgpu::ShaderModule,
    (vertex, fragment): (&str, &str),
    buffers: &[Option<wgpu::VertexBufferLayout<'_>>],
    group: &wgpu::BindGroupLayout,
) -> wgpu::RenderPipeline {
    let device = &gpu.device;
    device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some(label),
        layout: Some(&device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some(label),
            bind_group_layouts: &[Some(group)],
            immediate_size: 0,
        })),
        vertex: wgpu::VertexState {
            module,
            entry_point: Some(vertex),
            compilation_options: Default::default(),
            buffers,
        },
        primitive: wgpu::PrimitiveState::default(),
        depth_stencil: None,
        multisample: Default::default(),
        fragment: Some(wgpu::FragmentState {
            module,
            entry_point: Some(fragment),
            compilation_options: Default::default(),
            targets: &[Some(MASK.into())],
        }),
        multiview_mask: None,
        cache: None,
    })
}

/// A compute pipeline over view samples, entry point `resolve`.
fn resolve_pipeline(
    gpu: &Gpu,
    label: &str,
    module: &wgpu::ShaderModule,
    groups: &[Option<&wgpu::BindGroupLayout>],
) -> wgpu::ComputePipeline {
    let device = &gpu.device;
    device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: Some(label),
        layout: Some(&device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some(label),
            bind_group_layouts: groups,
            immediate_size: 0,
        })),
        module,
        entry_point: Some("resolve"),
        compilation_options: Default::default(),
        cache: None,
    })
}

//! The camera, for estimators whose kernel is the pixel's footprint in the map.

use antumbra_gpu::{BindGroupCache, Frame, Gpu, ViewCamera, ViewSamples, bind, entries};
use glam::{DVec4, Mat4};

/// Layout of `Eye` in `filter/interleaved_mean.wesl`, and, but for the light, in `filter/footprint.wesl`.
#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
pub(crate) struct EyeUniform {
    clip: [f32; 16],
    view: [f32; 4],
    light: [f32; 4],
}

impl EyeUniform {
    pub(crate) fn new(camera: Option<&ViewCamera>, samples: &ViewSamples, light: DVec4) -> Self {
        let (width, height) = samples.size();
        let clip = camera.map_or(Mat4::ZERO, |camera| camera.clip.as_mat4());
        let there = if camera.is_some() { 1.0 } else { 0.0 };
        Self {
            clip: clip.to_cols_array(),
            view: [0.5 * width as f32, 0.5 * height as f32, there, 0.0],
            light: light.as_vec4().to_array(),
        }
    }

    pub(crate) fn buffer(gpu: &Gpu) -> wgpu::Buffer {
        gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("camera"),
            size: size_of::<Self>() as u64,
            usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        })
    }
}

/// Bind group 2 of `filter/footprint.wesl`: the camera and what it sees. Without a camera every footprint is 0.
#[derive(Debug)]
pub(crate) struct Eye {
    layout: wgpu::BindGroupLayout,
    uniform: wgpu::Buffer,
    group: BindGroupCache<[wgpu::TextureView; 2]>,
}

impl Eye {
    pub(crate) fn new(gpu: &Gpu) -> Self {
        const CS: wgpu::ShaderStages = wgpu::ShaderStages::COMPUTE;
        let layout = gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("camera"),
            entries: &[
                entries::uniform(0, CS),
                entries::texels(1, CS, false),
                entries::texels(2, CS, false),
            ],
        });
        Self { layout, uniform: EyeUniform::buffer(gpu), group: BindGroupCache::default() }
    }

    pub(crate) fn prepare(&mut self, gpu: &Gpu, frame: &Frame<'_>) {
        let uniform = EyeUniform::new(frame.camera.as_ref(), frame.samples, DVec4::ZERO);
        gpu.queue.write_buffer(&self.uniform, 0, bytemuck::bytes_of(&uniform));
        let key = [frame.samples.positions_view.clone(), frame.samples.normals_view.clone()];
        self.group.get(key, |[positions, normals]| {
            gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("camera"),
                layout: &self.layout,
                entries: &[
                    bind::buffer(0, &self.uniform),
                    bind::texture(1, positions),
                    bind::texture(2, normals),
                ],
            })
        });
    }

    pub(crate) fn layout(&self) -> &wgpu::BindGroupLayout {
        &self.layout
    }

    pub(crate) fn group(&self) -> Option<&wgpu::BindGroup> {
        self.group.kept()
    }

    pub(crate) fn bytes(&self) -> u64 {
        self.uniform.size()
    }
}

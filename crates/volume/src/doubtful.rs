//! The pass that asks the triangles themselves for the samples whose counts rounding might decide.

use antumbra_gpu::{
    BindGroupCache, CasterTriangles, Gpu, GpuError, Recorder, ViewSamples, bind, entries,
};
use glam::Vec4;

use crate::batches::Batches;
use crate::count::{Counter, Eye};
use crate::triangles::MakeUniform;

/// The pass; `volume/doubtful.wesl`.
#[derive(Debug)]
pub(crate) struct Doubtful {
    pipeline: wgpu::ComputePipeline,
    layout: wgpu::BindGroupLayout,
    uniform: wgpu::Buffer,
    pub(crate) batches: Batches,
    group: BindGroupCache<([wgpu::Buffer; 6], [wgpu::TextureView; 4])>,
}

impl Doubtful {
    /// Builds the pass.
    ///
    /// # Errors
    /// A shader that does not link (a fault of this library).
    pub(crate) fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        const CS: wgpu::ShaderStages = wgpu::ShaderStages::COMPUTE;
        let layout = gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("volume/doubtful"),
            entries: &[
                entries::uniform(0, CS),
                entries::storage(1, CS),
                entries::storage(2, CS),
                entries::texels(3, CS, false),
                entries::texels(4, CS, false),
                entries::write_texture(5, CS, wgpu::TextureFormat::R32Float),
                entries::texels(6, CS, false),
                entries::write_storage(7, CS),
                entries::storage(8, CS),
                entries::storage(9, CS),
                entries::write_storage(10, CS),
            ],
        });
        let wgsl = antumbra_shaders::link("volume::doubtful", &[])?;
        let module = gpu.shader("volume/doubtful", wgsl);
        let pipeline = gpu.compute_pipeline("volume/doubtful", &module, "ask_doubtful", &[&layout]);
        let uniform = gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("volume/doubtful"),
            size: size_of::<MakeUniform>() as u64,
            usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let batches = Batches::new(gpu, false)?;
        Ok(Self { pipeline, layout, uniform, batches, group: BindGroupCache::default() })
    }

    /// Uploads what the pass needs to know.
    ///
    /// # Errors
    /// A failed allocation.
    pub(crate) fn prepare(
        &mut self,
        gpu: &Gpu,
        triangles: u32,
        light: Vec4,
        eye: Eye,
        counter: Counter,
        contact: f32,
    ) -> Result<(), GpuError> {
        self.batches.prepare(gpu, triangles, light)?;
        let mask = match counter {
            Counter::Wide => 0,
            Counter::Stencil => 0xff,
        };
        let uniform = MakeUniform {
            light: light.to_array(),
            eye: [0.0, 0.0, 0.0, contact],
            how: [triangles, mask, (eye != Eye::Apart).into(), (eye == Eye::Added).into()],
        };
        gpu.queue.write_buffer(&self.uniform, 0, bytemuck::bytes_of(&uniform));
        Ok(())
    }

    /// Records the pass: corrects `counts` and `visibility` where there are `doubts`.
    pub(crate) fn encode(
        &mut self,
        gpu: &Gpu,
        recorder: &mut Recorder<'_>,
        triangles: &CasterTriangles<'_>,
        samples: &ViewSamples,
        [counts, eye_count]: [&wgpu::Buffer; 2],
        [doubts, visibility]: [&wgpu::TextureView; 2],
    ) {
        self.batches.encode(gpu, recorder, triangles);
        let [boxes, asked] = self.batches.buffers();
        let buffers = [triangles.positions, triangles.indices, counts, eye_count, boxes, asked]
            .map(Clone::clone);
        let views = [&samples.positions_view, &samples.normals_view, visibility, doubts];
        let key = (buffers, views.map(Clone::clone));
        let group = self.group.get(key, |(buffers, views)| {
            gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("volume/doubtful"),
                layout: &self.layout,
                entries: &[
                    bind::buffer(0, &self.uniform),
                    bind::buffer(1, &buffers[0]),
                    bind::buffer(2, &buffers[1]),
                    bind::texture(3, &views[0]),
                    bind::texture(4, &views[1]),
                    bind::texture(5, &views[2]),
                    bind::texture(6, &views[3]),
                    bind::buffer(7, &buffers[2]),
                    bind::buffer(8, &buffers[3]),
                    bind::buffer(9, &buffers[4]),
                    bind::buffer(10, &buffers[5]),
                ],
            })
        });
        let (width, height) = samples.size();
        let mut pass = recorder.compute_pass("volume/doubtful");
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, group, &[]);
        pass.dispatch_workgroups(width.div_ceil(8), height.div_ceil(8), 1);
    }
}

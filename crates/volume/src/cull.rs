//! The pass that leaves away the volumes of triangles that shadow nothing in view.

use antumbra_gpu::{
    BindGroupCache, CasterTriangles, Gpu, GpuError, Recorder, ViewSamples, bind, entries,
    read_buffer,
};
use glam::Vec4;

use crate::VolumeFaces;
use crate::receivers::{Receivers, storage};
use crate::triangles::{MakeUniform, dispatch};

/// The pass; `volume/cull.wesl`.
#[derive(Debug)]
pub(crate) struct Cull {
    receivers: Receivers,
    pipeline: wgpu::ComputePipeline,
    layouts: [wgpu::BindGroupLayout; 2],
    uniform: wgpu::Buffer,
    left: wgpu::Buffer,
    groups: (BindGroupCache<[wgpu::Buffer; 4]>, BindGroupCache<[wgpu::Buffer; 2]>),
    dispatch: [u32; 2],
}

impl Cull {
    /// Builds the pass.
    ///
    /// # Errors
    /// A shader that does not link (a fault of this library).
    pub(crate) fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        const CS: wgpu::ShaderStages = wgpu::ShaderStages::COMPUTE;
        let layout = |entries: &[wgpu::BindGroupLayoutEntry]| {
            gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
                label: Some("volume/cull"),
                entries,
            })
        };
        let layouts = [
            layout(&[
                entries::uniform(0, CS),
                entries::storage(1, CS),
                entries::storage(2, CS),
                entries::write_storage(3, CS),
                entries::write_storage(4, CS),
                entries::write_storage(5, CS),
            ]),
            layout(&[entries::storage(2, CS), entries::storage(3, CS)]),
        ];
        let module = gpu.shader("volume/cull", antumbra_shaders::link("volume::cull", &[])?);
        let pipeline =
            gpu.compute_pipeline("volume/cull", &module, "cull_volumes", &layouts.each_ref());
        let uniform = gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("volume/cull"),
            size: size_of::<MakeUniform>() as u64,
            usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        Ok(Self {
            receivers: Receivers::new(gpu)?,
            pipeline,
            layouts,
            uniform,
            left: storage(gpu, "volumes left", 4)?,
            groups: Default::default(),
            dispatch: [0; 2],
        })
    }

    /// Uploads what the pass needs to know.
    ///
    /// # Errors
    /// A failed allocation.
    pub(crate) fn prepare(
        &mut self,
        gpu: &Gpu,
        samples: &ViewSamples,
        triangles: u32,
        light: Vec4,
        reach: f32,
    ) -> Result<(), GpuError> {
        self.receivers.prepare(gpu, Some(samples), light, reach)?;
        let row;
        (self.dispatch, row) = dispatch(gpu, triangles);
        let (width, height) = samples.size();
        let uniform = MakeUniform {
            light: light.to_array(),
            eye: [0.0; 4],
            how: [triangles, width, row, height],
        };
        gpu.queue.write_buffer(&self.uniform, 0, bytemuck::bytes_of(&uniform));
        Ok(())
    }

    /// Records the pass over `faces`, of one volume for each triangle.
    pub(crate) fn encode(
        &mut self,
        gpu: &Gpu,
        recorder: &mut Recorder<'_>,
        triangles: &CasterTriangles<'_>,
        faces: &VolumeFaces,
    ) {
        recorder.encoder.clear_buffer(&self.left, 0, None);
        let make = |layout: &wgpu::BindGroupLayout, entries: &[wgpu::BindGroupEntry<'_>]| {
            gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("volume/cull"),
                layout,
                entries,
            })
        };
        let key = [triangles.positions, triangles.indices, &faces.sides, &faces.caps];
        let own = self.groups.0.get(key.map(Clone::clone), |[positions, indices, sides, caps]| {
            make(
                &self.layouts[0],
                &[
                    bind::buffer(0, &self.uniform),
                    bind::buffer(1, positions),
                    bind::buffer(2, indices),
                    bind::buffer(3, sides),
                    bind::buffer(4, caps),
                    bind::buffer(5, &self.left),
                ],
            )
        });
        let boxes =
            self.groups.1.get(self.receivers.boxes().map(Clone::clone), |[fine, coarse]| {
                make(&self.layouts[1], &[bind::buffer(2, fine), bind::buffer(3, coarse)])
            });
        let mut pass = recorder.compute_pass("volume/cull");
        self.receivers.encode(&mut pass);
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, own, &[]);
        pass.set_bind_group(1, boxes, &[]);
        pass.dispatch_workgroups(self.dispatch[0], self.dispatch[1], 1);
    }

    /// How many volumes were left in the last submitted frame. Waits.
    ///
    /// # Errors
    /// A lost device.
    pub(crate) fn read_left(&self, gpu: &Gpu) -> Result<u64, GpuError> {
        let bytes = read_buffer(gpu, &self.left, 4)?;
        Ok(bytemuck::pod_read_unaligned::<u32>(&bytes).into())
    }

    /// Bytes of GPU memory held.
    pub(crate) fn bytes(&self) -> u64 {
        self.receivers.bytes() + self.left.size()
    }
}

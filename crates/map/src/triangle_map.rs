//! A map of the nearest triangle behind each texel, as a store.

use antumbra_gpu::{BindGroupCache, Counters, Frame, Gpu, GpuError, Recorder, bind, entries};

use crate::{ShadowMap, Store, TriangleNames};

/// The store of triangle numbers ([`TriangleNames`]).
/// It draws the casters itself, with the map for its depth, and lends the triangles and the view samples to
/// the estimator (`map/triangles.wesl`).
#[derive(Debug)]
pub struct TriangleMap {
    names: TriangleNames,
    read_layout: wgpu::BindGroupLayout,
    read_group: BindGroupCache<Read>,
    light: wgpu::Buffer,
}

/// Resources of the estimator's bind group.
type Read = ([wgpu::Buffer; 3], [wgpu::TextureView; 2]);

impl TriangleMap {
    /// Builds the pass.
    ///
    /// # Errors
    /// A shader that does not link (a fault of this library).
    pub fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        const CS: wgpu::ShaderStages = wgpu::ShaderStages::COMPUTE;
        let device = &gpu.device;
        let read_layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("triangles to look up"),
            entries: &[
                entries::storage(0, CS),
                entries::storage(1, CS),
                entries::storage(2, CS),
                entries::texels(3, CS, false),
                entries::texels(4, CS, false),
                entries::uniform(5, CS),
            ],
        });
        let light = device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("light"),
            size: size_of::<[f32; 4]>() as u64,
            usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let names = TriangleNames::new(gpu)?;
        Ok(Self { names, read_layout, read_group: BindGroupCache::default(), light })
    }
}

impl Store for TriangleMap {
    fn prepare(&mut self, gpu: &Gpu, frame: &Frame<'_>, map: &ShadowMap) -> Result<(), GpuError> {
        let triangles = self.names.prepare(gpu, frame, map)?;
        if let Some(view) = map.views().first() {
            let light = view.light.as_vec4().to_array();
            gpu.queue.write_buffer(&self.light, 0, bytemuck::bytes_of(&light));
        }
        let device = &gpu.device;
        let buffers = [triangles.positions, triangles.indices, triangles.objects].map(Clone::clone);
        let samples =
            [&frame.samples.positions_view, &frame.samples.normals_view].map(Clone::clone);
        self.read_group.get((buffers, samples), |(buffers, samples)| {
            device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("triangles to look up"),
                layout: &self.read_layout,
                entries: &[
                    bind::buffer(0, &buffers[0]),
                    bind::buffer(1, &buffers[1]),
                    bind::buffer(2, &buffers[2]),
                    bind::texture(3, &samples[0]),
                    bind::texture(4, &samples[1]),
                    bind::buffer(5, &self.light),
                ],
            })
        });
        Ok(())
    }

    fn encode(
        &mut self,
        gpu: &Gpu,
        frame: &Frame<'_>,
        map: &ShadowMap,
        recorder: &mut Recorder<'_>,
    ) -> Result<(), GpuError> {
        self.names.encode(gpu, frame, map, recorder, wgpu::StoreOp::Discard)
    }

    fn view(&self) -> Option<&wgpu::TextureView> {
        self.names.view()
    }

    fn draws(&self) -> bool {
        true
    }

    fn group_layout(&self) -> Option<&wgpu::BindGroupLayout> {
        Some(&self.read_layout)
    }

    fn group(&self) -> Option<&wgpu::BindGroup> {
        self.read_group.kept()
    }

    fn counters(&self) -> Counters {
        self.names.counters().clone()
    }

    fn bytes(&self) -> u64 {
        self.names.bytes()
    }
}

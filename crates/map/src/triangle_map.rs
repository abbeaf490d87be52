//! A map of the nearest triangle behind each texel, as a store.

use antumbra_gpu::{
    BindGroupCache, Counters, Frame, Gpu, GpuError, Layers, Recorder, bind, entries,
    light_view_layout,
};

use crate::{DepthConvention, ShadowMap, Store, caster_depth};

/// The store of triangle numbers, `R32Uint`: 1 + the triangle's place in [`antumbra_gpu::CasterTriangles`], or 0.
/// It draws the casters itself, with the map for its depth, and lends the triangles and the view samples to
/// the estimator (`map/triangles.wesl`).
#[derive(Debug)]
pub struct TriangleMap {
    pipeline: wgpu::RenderPipeline,
    drawn_layout: wgpu::BindGroupLayout,
    drawn_group: BindGroupCache<[wgpu::Buffer; 2]>,
    read_layout: wgpu::BindGroupLayout,
    read_group: BindGroupCache<Read>,
    light: wgpu::Buffer,
    kept: Option<Layers>,
    counters: Counters,
}

/// Resources of the estimator's bind group.
type Read = ([wgpu::Buffer; 3], [wgpu::TextureView; 2]);

impl TriangleMap {
    const FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::R32Uint;

    /// Builds the pass.
    ///
    /// # Errors
    /// A shader that does not link (a fault of this library).
    pub fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        const VS: wgpu::ShaderStages = wgpu::ShaderStages::VERTEX;
        const CS: wgpu::ShaderStages = wgpu::ShaderStages::COMPUTE;
        let device = &gpu.device;
        let drawn_layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("triangles to draw"),
            entries: &[entries::storage(0, VS), entries::storage(1, VS)],
        });
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
        let module = gpu.shader("triangle map", antumbra_shaders::link("map::draw_ids", &[])?);
        let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some("triangle map"),
            bind_group_layouts: &[Some(&light_view_layout(device)), Some(&drawn_layout)],
            immediate_size: 0,
        });
        let target = [Some(wgpu::ColorTargetState::from(Self::FORMAT))];
        let fragment = wgpu::FragmentState {
            module: &module,
            entry_point: Some("fragment"),
            compilation_options: Default::default(),
            targets: &target,
        };
        let mut pipeline = caster_depth::pipeline("triangle map", &layout, &module, Some(fragment));
        // Vertices are fetched by number, which is what names a triangle without an optional feature.
        pipeline.vertex.buffers = &[];
        let light = device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("light"),
            size: size_of::<[f32; 4]>() as u64,
            usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        Ok(Self {
            pipeline: device.create_render_pipeline(&pipeline),
            drawn_layout,
            drawn_group: BindGroupCache::default(),
            read_layout,
            read_group: BindGroupCache::default(),
            light,
            kept: None,
            counters: Counters::new(),
        })
    }
}

impl Store for TriangleMap {
    fn prepare(&mut self, gpu: &Gpu, frame: &Frame<'_>, map: &ShadowMap) -> Result<(), GpuError> {
        let triangles = caster_depth::triangles(frame.casters)?;
        let layers = map.layer_views().len();
        if layers > 0 && self.kept.as_ref().is_none_or(|k| k.each.len() < layers) {
            let usage = wgpu::TextureUsages::RENDER_ATTACHMENT;
            let count = (map.size(), layers as u32);
            self.kept = Some(Layers::new(gpu, "triangle map", Self::FORMAT, count, usage)?);
        }
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
        let triangles = caster_depth::triangles(frame.casters)?;
        let key = [triangles.positions, triangles.indices].map(Clone::clone);
        let group = self.drawn_group.get(key, |[positions, indices]| {
            gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("triangles to draw"),
                layout: &self.drawn_layout,
                entries: &[bind::buffer(0, positions), bind::buffer(1, indices)],
            })
        });
        let (mut passes, mut draws, mut count) = (0, 0, 0);
        let each = self.kept.as_ref().map_or(&[][..], |k| &k.each);
        let layers = map.layer_views().iter().zip(each);
        for (view, (depth, ids)) in map.light_views(frame).zip(layers) {
            let color = wgpu::RenderPassColorAttachment {
                view: ids,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations {
                    load: wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT),
                    store: wgpu::StoreOp::Store,
                },
            };
            let depth = wgpu::RenderPassDepthStencilAttachment {
                view: depth,
                depth_ops: Some(wgpu::Operations {
                    load: wgpu::LoadOp::Clear(DepthConvention::REVERSED_F32.clear()),
                    store: wgpu::StoreOp::Discard,
                }),
                stencil_ops: None,
            };
            let mut pass = recorder.render_pass("map/triangles", &[Some(color)], Some(depth));
            pass.set_pipeline(&self.pipeline);
            pass.set_bind_group(0, view.bind_group, &[view.offset]);
            pass.set_bind_group(1, group, &[]);
            frame.casters.ranges(&view, &mut |range| {
                draws += 1;
                count += u64::from(range.end - range.start);
                pass.draw(3 * range.start..3 * range.end, 0..1);
            });
            passes += 1;
        }
        let texels = passes * u64::from(map.size()).pow(2);
        self.counters = Counters::from([
            ("map_passes", passes),
            ("map_draws", draws),
            ("map_triangles", count),
            ("map_texels", texels),
        ]);
        Ok(())
    }

    fn view(&self) -> Option<&wgpu::TextureView> {
        self.kept.as_ref().map(|k| &k.whole)
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
        self.counters.clone()
    }

    fn bytes(&self) -> u64 {
        self.kept.as_ref().map_or(0, Layers::bytes)
    }
}

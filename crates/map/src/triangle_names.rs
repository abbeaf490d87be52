//! The nearest triangle behind each texel of a map, by number: a support pass.

use antumbra_gpu::{
    BindGroupCache, CasterTriangles, Counters, Frame, Gpu, GpuError, Layers, Recorder, bind,
    entries, light_view_layout,
};

use crate::{DepthConvention, ShadowMap, caster_depth};

/// Draws the casters' triangles with their numbers, `R32Uint`: 1 + the triangle's place in
/// [`antumbra_gpu::CasterTriangles`], or 0. 4 bytes a texel.
#[derive(Debug)]
pub struct TriangleNames {
    pipeline: wgpu::RenderPipeline,
    layout: wgpu::BindGroupLayout,
    group: BindGroupCache<[wgpu::Buffer; 2]>,
    kept: Option<Layers>,
    counters: Counters,
}

impl TriangleNames {
    const FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::R32Uint;

    /// Builds the pass.
    ///
    /// # Errors
    /// A shader that does not link (a fault of this library).
    pub fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        const VS: wgpu::ShaderStages = wgpu::ShaderStages::VERTEX;
        let device = &gpu.device;
        let drawn_layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("triangles to draw"),
            entries: &[entries::storage(0, VS), entries::storage(1, VS)],
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
        Ok(Self {
            pipeline: device.create_render_pipeline(&pipeline),
            layout: drawn_layout,
            group: BindGroupCache::default(),
            kept: None,
            counters: Counters::new(),
        })
    }

    /// Makes room for a layer for each of the map's; returns the triangles that names are of.
    ///
    /// # Errors
    /// Casters that keep their triangles to themselves, or a texture that the device cannot make.
    pub fn prepare<'a>(
        &mut self,
        gpu: &Gpu,
        frame: &Frame<'a>,
        map: &ShadowMap,
    ) -> Result<CasterTriangles<'a>, GpuError> {
        let triangles = caster_depth::triangles(frame.casters)?;
        let layers = map.layer_views().len();
        if layers > 0 && self.kept.as_ref().is_none_or(|k| k.each.len() < layers) {
            let usage = wgpu::TextureUsages::RENDER_ATTACHMENT;
            let count = (map.size(), layers as u32);
            self.kept = Some(Layers::new(gpu, "triangle map", Self::FORMAT, count, usage)?);
        }
        Ok(triangles)
    }

    /// Draws names into the pass's own layers and depths into the map's, which are kept where `depth` says so.
    ///
    /// # Errors
    /// Casters that keep their triangles to themselves.
    pub fn encode(
        &mut self,
        gpu: &Gpu,
        frame: &Frame<'_>,
        map: &ShadowMap,
        recorder: &mut Recorder<'_>,
        depth: wgpu::StoreOp,
    ) -> Result<(), GpuError> {
        let triangles = caster_depth::triangles(frame.casters)?;
        let key = [triangles.positions, triangles.indices].map(Clone::clone);
        let group = self.group.get(key, |[positions, indices]| {
            gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("triangles to draw"),
                layout: &self.layout,
                entries: &[bind::buffer(0, positions), bind::buffer(1, indices)],
            })
        });
        let (mut passes, mut draws, mut count) = (0, 0, 0);
        let each = self.kept.as_ref().map_or(&[][..], |k| &k.each);
        let layers = map.layer_views().iter().zip(each);
        for (view, (depths, names)) in map.light_views(frame).zip(layers) {
            let color = wgpu::RenderPassColorAttachment {
                view: names,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations {
                    load: wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT),
                    store: wgpu::StoreOp::Store,
                },
            };
            let depths = wgpu::RenderPassDepthStencilAttachment {
                view: depths,
                depth_ops: Some(wgpu::Operations {
                    load: wgpu::LoadOp::Clear(DepthConvention::REVERSED_F32.clear()),
                    store: depth,
                }),
                stencil_ops: None,
            };
            let mut pass = recorder.render_pass("map/triangles", &[Some(color)], Some(depths));
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

    /// All layers, once there are casters.
    #[must_use]
    pub fn view(&self) -> Option<&wgpu::TextureView> {
        self.kept.as_ref().map(|k| &k.whole)
    }

    /// Work of the last frame.
    #[must_use]
    pub fn counters(&self) -> &Counters {
        &self.counters
    }

    /// Memory of the layers.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        self.kept.as_ref().map_or(0, Layers::bytes)
    }
}

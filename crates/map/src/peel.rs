//! Depth peeling: the second, third, .. surface behind each texel (Everitt 2001).

use antumbra_gpu::{
    BindGroupCache, Counters, Frame, Gpu, GpuError, Layers, Recorder, bind, entries,
    light_view_layout,
};

use crate::shadow_map::depth_layers;
use crate::{DepthConvention, ShadowMap, caster_depth};

/// The depth layers behind the first, which is the map itself, drawn by [`ShadowMap::encode_triangles`] without
/// a polygon offset.
///
/// Layer i + 1 is the nearest depth strictly beyond layer i. Both come of the same vertices by the same
/// invariant expression, so the comparison needs no tolerance: no surface comes twice, and none is skipped,
/// but surfaces of equal depth are one.
#[derive(Debug)]
pub struct DepthPeel {
    pipeline: wgpu::RenderPipeline,
    before_layout: wgpu::BindGroupLayout,
    deeper: usize,
    layers: Vec<Layers>,
    groups: Vec<BindGroupCache<wgpu::TextureView>>,
    counters: Counters,
}

impl DepthPeel {
    /// Builds the pass for `deeper` layers behind the first. Each costs one more pass over the casters and a
    /// texture as large as the map.
    ///
    /// # Errors
    /// A shader that does not link (a fault of this library).
    pub fn new(gpu: &Gpu, deeper: u32) -> Result<Self, GpuError> {
        let device = &gpu.device;
        let before_layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("peel"),
            entries: &[entries::texels(0, wgpu::ShaderStages::FRAGMENT, false)],
        });
        let module = gpu.shader("peel", antumbra_shaders::link("map::peel", &[])?);
        let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some("peel"),
            bind_group_layouts: &[Some(&light_view_layout(device)), Some(&before_layout)],
            immediate_size: 0,
        });
        let fragment = wgpu::FragmentState {
            module: &module,
            entry_point: Some("fragment"),
            compilation_options: Default::default(),
            targets: &[],
        };
        let pipeline = device.create_render_pipeline(&caster_depth::pipeline(
            "peel",
            &layout,
            &module,
            Some(fragment),
        ));
        Ok(Self {
            pipeline,
            before_layout,
            deeper: deeper as usize,
            layers: Vec::new(),
            groups: Vec::new(),
            counters: Counters::new(),
        })
    }

    /// Makes the layers that `map`, which is prepared for `frame`, needs.
    ///
    /// # Errors
    /// Casters that keep their triangles to themselves, or a failed allocation.
    pub fn prepare(
        &mut self,
        gpu: &Gpu,
        frame: &Frame<'_>,
        map: &ShadowMap,
    ) -> Result<(), GpuError> {
        caster_depth::triangles(frame.casters)?;
        let count = map.layer_views().len();
        if count > 0 && self.layers.first().is_none_or(|l| l.each.len() < count) {
            self.layers.clear();
            for _ in 0..self.deeper {
                self.layers.push(depth_layers(gpu, map.size(), count as u32)?);
            }
            self.groups.resize_with(self.deeper * count, BindGroupCache::default);
        }
        Ok(())
    }

    /// Records the passes, one a layer and view, behind those of the map.
    ///
    /// # Errors
    /// Casters that keep their triangles to themselves.
    pub fn encode(
        &mut self,
        gpu: &Gpu,
        frame: &Frame<'_>,
        map: &ShadowMap,
        recorder: &mut Recorder<'_>,
    ) -> Result<(), GpuError> {
        let triangles = caster_depth::triangles(frame.casters)?;
        let clear = DepthConvention::REVERSED_F32.clear();
        let (mut passes, mut count) = (0, 0);
        let mut groups = self.groups.iter_mut();
        for (depth, layers) in self.layers.iter().enumerate() {
            let before = if depth == 0 { map.layer_views() } else { &self.layers[depth - 1].each };
            let views = map.light_views(frame).zip(before).zip(&layers.each);
            for (((view, before), target), group) in views.zip(&mut groups) {
                let group = group.get(before.clone(), |before| {
                    gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
                        label: Some("peel"),
                        layout: &self.before_layout,
                        entries: &[bind::texture(0, before)],
                    })
                });
                let mut pass = recorder.depth_pass("map/peel", target, clear);
                pass.set_pipeline(&self.pipeline);
                pass.set_bind_group(1, group, &[]);
                let drawn = caster_depth::draw(frame.casters, &triangles, &view, &mut pass);
                passes += 1;
                count += drawn.triangles;
            }
        }
        self.counters = Counters::from([("peel_passes", passes), ("peel_triangles", count)]);
        Ok(())
    }

    /// The layer `depth` + 1, counted from the map's as 0: its texture and a `D2Array` view of it, once it has
    /// been needed.
    #[must_use]
    pub fn layer(&self, depth: usize) -> Option<(&wgpu::Texture, &wgpu::TextureView)> {
        self.layers.get(depth).map(|l| (&l.texture, &l.whole))
    }

    /// Work of the last [`DepthPeel::encode`].
    #[must_use]
    pub fn counters(&self) -> &Counters {
        &self.counters
    }

    /// Bytes of GPU memory held.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        self.layers.iter().map(Layers::bytes).sum()
    }
}

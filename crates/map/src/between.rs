//! Virtual occluders between the first two depth layers, as a store: nothing lies there, so nothing is
//! compared with itself.

use antumbra_gpu::{
    BindGroupCache, Counters, Frame, Gpu, GpuError, Layers, Recorder, bind, entries,
};
use glam::{DMat4, DVec3, DVec4};

use crate::{DepthPeel, ShadowMap, Store};

/// How depth relates to distance in one layer of a map; `Metric` of `map/between.wesl`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Metric {
    /// Whether depth is inverse to distance (positional lights) rather than affine (directional ones).
    pub inverse: bool,
    /// Depth just beyond the farthest caster: what stands for a second layer where there is none.
    pub far: f64,
    /// Depth z moved away from the light by the limit is z `scale` - `shift`.
    pub scale: f64,
    /// Depth.
    pub shift: f64,
}

impl Metric {
    /// The metric of the view `clip` (reversed depth) of `size` texels a side over casters whose convex hull is
    /// that of `hull`, both relative to the frame's origin; `limit` is in texels, infinite for none.
    ///
    /// A texel's side in metres is that of its longer one: `s` everywhere under a directional light, `k` times
    /// the distance along the view's axis under a positional one. With z' the depth `limit` texels farther,
    ///
    /// - directional: z' = z - `limit` s |dz/dd|;
    /// - positional: z = near / d and d' = d + `limit` k d, so z' = z / (1 + `limit` k).
    #[must_use]
    pub fn new(clip: &DMat4, size: f64, hull: &[DVec3], limit: f64) -> Self {
        let row = |i: usize| clip.row(i).truncate();
        let forward = row(3);
        let inverse = forward != DVec3::ZERO;
        // Across the axis only: an off-centre window shears.
        let across = |i: usize| {
            let axis = forward.normalize_or_zero();
            (row(i) - row(i).dot(axis) * axis).length()
        };
        let side = 2.0 / (size * across(0).min(across(1)));
        // 16 steps of f32, so that the farthest caster is before it whatever rounding does to its vertices.
        let pad = 1.0 - 2f64.powi(-20);
        let depths = hull.iter().map(|p| *clip * p.extend(1.0)).filter(|c: &DVec4| c.w > 0.0);
        let farthest = depths.map(|c| c.z / c.w).fold(f64::INFINITY, f64::min);
        let far = match inverse {
            // Directional views end just beyond the farthest caster already.
            false => 0.0,
            true if farthest.is_finite() => farthest.max(0.0) * pad,
            true => 0.0,
        };
        let (scale, shift) = match (inverse, limit.is_finite()) {
            (_, false) => (0.0, 0.0),
            (true, true) => (1.0 / (1.0 + limit * side), 0.0),
            (false, true) => (1.0, limit * side * row(2).length()),
        };
        Self { inverse, far, scale, shift }
    }

    fn uniform(&self) -> [f32; 4] {
        let inverse = if self.inverse { 1.0 } else { 0.0 };
        [inverse, self.far as f32, self.scale as f32, self.shift as f32]
    }
}

/// The store of virtual occluders, `R32Float`, in the map's depth.
#[derive(Debug)]
pub struct Between {
    limit: f64,
    peel: DepthPeel,
    pipeline: wgpu::ComputePipeline,
    layout: wgpu::BindGroupLayout,
    group: BindGroupCache<[wgpu::TextureView; 3]>,
    kept: Option<Kept>,
    hull: Vec<DVec3>,
    counters: Counters,
}

#[derive(Debug)]
struct Kept {
    metrics: wgpu::Buffer,
    layers: Layers,
}

impl Between {
    /// Halfway between the layers, but at most `limit` texels (their side at the first layer, >= 0) behind the
    /// first; infinite for no limit.
    ///
    /// # Errors
    /// A shader that does not link (a fault of this library).
    pub fn new(gpu: &Gpu, limit: f64) -> Result<Self, GpuError> {
        const CS: wgpu::ShaderStages = wgpu::ShaderStages::COMPUTE;
        let device = &gpu.device;
        let mut output = entries::write_texture(3, CS, wgpu::TextureFormat::R32Float);
        if let wgpu::BindingType::StorageTexture { view_dimension, .. } = &mut output.ty {
            *view_dimension = wgpu::TextureViewDimension::D2Array;
        }
        let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("between"),
            entries: &[
                entries::storage(0, CS),
                entries::texels(1, CS, true),
                entries::texels(2, CS, true),
                output,
            ],
        });
        let module = gpu.shader("between", antumbra_shaders::link("map::between", &[])?);
        let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some("between"),
            layout: Some(&device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
                label: Some("between"),
                bind_group_layouts: &[Some(&layout)],
                immediate_size: 0,
            })),
            module: &module,
            entry_point: Some("combine"),
            compilation_options: Default::default(),
            cache: None,
        });
        Ok(Self {
            limit,
            peel: DepthPeel::new(gpu, 1)?,
            pipeline,
            layout,
            group: BindGroupCache::default(),
            kept: None,
            hull: Vec::new(),
            counters: Counters::new(),
        })
    }

    /// The second layer, once it has been needed.
    #[must_use]
    pub fn second(&self) -> Option<&wgpu::Texture> {
        self.peel.layer(0).map(|(texture, _)| texture)
    }

    /// The virtual occluders, once they have been needed.
    #[must_use]
    pub fn texture(&self) -> Option<&wgpu::Texture> {
        self.kept.as_ref().map(|k| &k.layers.texture)
    }
}

impl Kept {
    fn new(gpu: &Gpu, size: u32, count: u32) -> Result<Self, GpuError> {
        let usage = wgpu::TextureUsages::STORAGE_BINDING | wgpu::TextureUsages::COPY_SRC;
        let format = wgpu::TextureFormat::R32Float;
        let layers = Layers::new(gpu, "virtual occluders", format, (size, count), usage)?;
        let metrics = gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("metrics"),
            size: u64::from(count) * size_of::<[f32; 4]>() as u64,
            usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        Ok(Self { metrics, layers })
    }
}

impl Store for Between {
    fn prepare(&mut self, gpu: &Gpu, frame: &Frame<'_>, map: &ShadowMap) -> Result<(), GpuError> {
        self.peel.prepare(gpu, frame, map)?;
        let layers = map.layer_views().len() as u32;
        if layers > 0 && self.kept.as_ref().is_none_or(|k| k.layers.each.len() < layers as usize) {
            self.kept = Some(Kept::new(gpu, map.size(), layers)?);
        }
        self.hull.clear();
        let hull = &mut self.hull;
        frame.casters.hull(frame.light, &mut |p| hull.push(p - frame.origin));
        if let Some(kept) = &self.kept {
            let size = f64::from(map.size());
            for (layer, clip) in map.views().iter().filter_map(|v| v.clip).enumerate() {
                let metric = Metric::new(&clip, size, &self.hull, self.limit).uniform();
                let offset = layer as u64 * size_of_val(&metric) as u64;
                gpu.queue.write_buffer(&kept.metrics, offset, bytemuck::bytes_of(&metric));
            }
        }
        Ok(())
    }

    fn encode(
        &mut self,
        gpu: &Gpu,
        frame: &Frame<'_>,
        map: &ShadowMap,
        recorder: &mut Recorder<'_>,
    ) -> Result<(), GpuError> {
        self.peel.encode(gpu, frame, map, recorder)?;
        self.counters = self.peel.counters().clone();
        let (Some(first), Some((_, second)), Some(kept)) =
            (map.view(), self.peel.layer(0), &self.kept)
        else {
            return Ok(());
        };
        let key = [first.clone(), second.clone(), kept.layers.whole.clone()];
        let group = self.group.get(key, |[first, second, output]| {
            gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("between"),
                layout: &self.layout,
                entries: &[
                    bind::buffer(0, &kept.metrics),
                    bind::texture(1, first),
                    bind::texture(2, second),
                    bind::texture(3, output),
                ],
            })
        });
        let layers = map.views().iter().filter(|v| v.clip.is_some()).count() as u32;
        let groups = map.size().div_ceil(8);
        let mut pass = recorder.compute_pass("map/between");
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, group, &[]);
        pass.dispatch_workgroups(groups, groups, layers);
        let texels = u64::from(layers) * u64::from(map.size()).pow(2);
        self.counters.insert("store_texels", texels);
        Ok(())
    }

    fn view(&self) -> Option<&wgpu::TextureView> {
        self.kept.as_ref().map(|k| &k.layers.whole)
    }

    fn counters(&self) -> Counters {
        self.counters.clone()
    }

    fn bytes(&self) -> u64 {
        let kept = self.kept.as_ref().map_or(0, |k| k.layers.bytes() + k.metrics.size());
        self.peel.bytes() + kept
    }
}

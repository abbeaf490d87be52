//! Percentage-closer filtering with the taps shared out among the pixels of a block.

use antumbra_gpu::{
    BindGroupCache, Counters, Expectation, Frame, Gpu, GpuError, Recorder, Technique,
    TechniqueConfig, bind, entries,
};
use antumbra_map::{Estimator, MapConfig, MapRead, MapTechnique};
use antumbra_shaders::{Slot, link, module, poisson_constants, source};
use glam::DVec4;
use serde::{Deserialize, Serialize};

use crate::expectation::joined;
use crate::eye::EyeUniform;
use crate::kernel::poisson_disc;
use crate::prefilter::check;

/// PCF by interleaved sampling (Keller, Heidrich 2001): each pixel of a block takes another part of a large set of taps,
/// and the mean over the block around a pixel, of those that show the same surface, joins them.
///
/// Without a camera, pixels are no neighbours: every sample then takes all taps.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Interleaved {
    /// The shadow map.
    pub map: MapConfig,
    /// Pixels a side of the block, 2 to 4, default 4. Cost: `block`² reads of neighbours a sample, (`block` + 1)²
    /// for an even one; what changes within
    /// as many pixels is blurred.
    pub block: u32,
    /// Taps of a pixel, 1 to 16, default 4: 64 in all with the default block. Cost: one compare each.
    pub taps: u32,
    /// Radius of the disc, texels, 0 to 31, default 2.5.
    pub radius: f32,
    /// How far off the pixel's plane a neighbour may lie to count 1/e, share of its distance, 0.001 to 1, default 0.1.
    pub flatness: f32,
}

impl Default for Interleaved {
    fn default() -> Self {
        Self { map: MapConfig::default(), block: 4, taps: 4, radius: 2.5, flatness: 0.1 }
    }
}

impl Interleaved {
    fn checked(&self) -> Result<(), GpuError> {
        for (what, value, range, fix) in [
            ("block", self.block, 2..=4, "use 2 to 4 pixels"),
            ("taps", self.taps, 1..=16, "use 1 to 16 taps"),
        ] {
            if !range.contains(&value) {
                return Err(GpuError::Invalid { what, value: value.to_string(), fix });
            }
        }
        check("radius", self.radius, 0.0..=31.0, "use a radius of 0 to 31 texels")?;
        check("flatness", self.flatness, 0.001..=1.0, "use 0.001 to 1 of the distance")
    }

    /// All taps: points in the unit disc, those of a part one after the other. A part takes each so-many-th of a Poisson
    /// disc's, which come in an order of ever smaller gaps.
    #[must_use]
    pub fn points(&self) -> Vec<[f32; 2]> {
        let parts = self.block * self.block;
        let all = poisson_disc(parts * self.taps);
        let order = (0..parts).flat_map(|part| (0..self.taps).map(move |i| part + parts * i));
        order.map(|i| all[i as usize]).collect()
    }

    fn one_of(&self, parts: u32) -> Result<Estimator, GpuError> {
        self.checked()?;
        let points = poisson_constants(&self.points(), self.radius);
        let (block, taps) = (self.block, self.taps);
        let config = format!(
            "{points}\nconst BLOCK: u32 = {block}u;\nconst TAPS: i32 = {taps};\nconst PARTS: i32 = {parts};"
        );
        Ok(Estimator {
            slots: vec![
                module("store", "common::depth_map"),
                module("estimator", "filter::interleaved"),
                source("config", config),
            ],
            read: MapRead::Texels,
            radius: self.radius + 0.5,
            reach: 0.0,
            fetches: taps * parts,
        })
    }

    /// The estimator of a pixel's own part, for any layout.
    ///
    /// # Errors
    /// A setting out of range.
    pub fn part(&self) -> Result<Estimator, GpuError> {
        self.one_of(1)
    }

    /// The estimator of all parts at every sample.
    ///
    /// # Errors
    /// A setting out of range.
    pub fn whole(&self) -> Result<Estimator, GpuError> {
        self.one_of(self.block * self.block)
    }

    fn join_config(&self) -> Slot {
        let (block, flatness) = (self.block, self.flatness);
        source(
            "config",
            format!("const BLOCK: i32 = {block};\nconst FLATNESS: f32 = {flatness:?};"),
        )
    }
}

impl TechniqueConfig for Interleaved {
    fn build(&self, gpu: &Gpu) -> Result<Box<dyn Technique>, GpuError> {
        Ok(Box::new(Joined {
            config: *self,
            taps: MapTechnique::new(gpu, &self.map, self.part()?)?,
            joins: true,
            join: Join::new(gpu, self)?,
        }))
    }

    fn set_map_size(&mut self, size: u32) {
        self.map.size = size;
    }

    fn expectation(&self, case: &str) -> Option<Expectation> {
        joined(&self.map, &self.whole().ok()?, self.block / 2, case)
    }
}

/// Interleaved parts and what joins them; or all parts at once where there is no camera.
#[derive(Debug)]
struct Joined {
    config: Interleaved,
    /// Each pixel's own part, or all of them.
    taps: MapTechnique,
    joins: bool,
    join: Join,
}

impl Technique for Joined {
    fn prepare(&mut self, gpu: &Gpu, frame: &Frame<'_>) -> Result<(), GpuError> {
        if self.joins != frame.camera.is_some() {
            self.joins = frame.camera.is_some();
            let estimator = if self.joins { self.config.part() } else { self.config.whole() };
            self.taps = MapTechnique::new(gpu, &self.config.map, estimator?)?;
        }
        self.taps.prepare(gpu, frame)?;
        if !self.joins {
            return Ok(());
        }
        // All views of a light hold the same.
        let light = self.taps.map().views().first().map_or(DVec4::ZERO, |view| view.light);
        self.join.prepare(gpu, frame, light)
    }

    fn encode(
        &mut self,
        gpu: &Gpu,
        frame: &Frame<'_>,
        recorder: &mut Recorder<'_>,
        visibility: &wgpu::TextureView,
    ) -> Result<(), GpuError> {
        match &self.join.parts {
            Some((_, parts)) if self.joins => {
                let parts = parts.clone();
                self.taps.encode(gpu, frame, recorder, &parts)?;
                self.join.encode(gpu, frame, recorder, &parts, visibility);
                Ok(())
            }
            _ => self.taps.encode(gpu, frame, recorder, visibility),
        }
    }

    fn counters(&self) -> Counters {
        let mut counters = self.taps.counters();
        if self.joins {
            let samples = counters.get("view_samples").copied().unwrap_or(0);
            counters
                .insert("neighbours", samples * u64::from(2 * (self.config.block / 2) + 1).pow(2));
        }
        counters
    }

    fn bytes(&self) -> u64 {
        self.taps.bytes() + self.join.bytes()
    }
}

/// The pass that joins parts.
#[derive(Debug)]
struct Join {
    layout: wgpu::BindGroupLayout,
    pipeline: wgpu::ComputePipeline,
    uniform: Option<wgpu::Buffer>,
    parts: Option<(wgpu::Texture, wgpu::TextureView)>,
    group: BindGroupCache<[wgpu::TextureView; 4]>,
}

impl Join {
    fn new(gpu: &Gpu, config: &Interleaved) -> Result<Self, GpuError> {
        const CS: wgpu::ShaderStages = wgpu::ShaderStages::COMPUTE;
        let layout = gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("interleaved"),
            entries: &[
                entries::uniform(0, CS),
                entries::texels(1, CS, false),
                entries::texels(2, CS, false),
                entries::texels(3, CS, false),
                entries::write_texture(4, CS, wgpu::TextureFormat::R32Float),
            ],
        });
        let wgsl = link("filter::interleaved_mean", &[config.join_config()])?;
        let module = gpu.shader("interleaved", wgsl);
        let pipeline = gpu.compute_pipeline("interleaved", &module, "join", &[&layout]);
        let group = BindGroupCache::default();
        Ok(Self { layout, pipeline, uniform: None, parts: None, group })
    }

    fn prepare(&mut self, gpu: &Gpu, frame: &Frame<'_>, light: DVec4) -> Result<(), GpuError> {
        let size = |t: &wgpu::Texture| (t.width(), t.height());
        if self.parts.as_ref().is_none_or(|(t, _)| size(t) != frame.samples.size()) {
            let texture = frame.samples.visibility_target(gpu)?;
            let view = texture.create_view(&Default::default());
            self.parts = Some((texture, view));
        }
        let uniform = self.uniform.get_or_insert_with(|| EyeUniform::buffer(gpu));
        let eye = EyeUniform::new(frame.camera.as_ref(), frame.samples, light);
        gpu.queue.write_buffer(uniform, 0, bytemuck::bytes_of(&eye));
        Ok(())
    }

    fn encode(
        &mut self,
        gpu: &Gpu,
        frame: &Frame<'_>,
        recorder: &mut Recorder<'_>,
        parts: &wgpu::TextureView,
        visibility: &wgpu::TextureView,
    ) {
        let Some(uniform) = &self.uniform else { return };
        let samples = frame.samples;
        let key = [
            samples.positions_view.clone(),
            samples.normals_view.clone(),
            parts.clone(),
            visibility.clone(),
        ];
        let group = self.group.get(key, |[positions, normals, parts, output]| {
            gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("interleaved"),
                layout: &self.layout,
                entries: &[
                    bind::buffer(0, uniform),
                    bind::texture(1, positions),
                    bind::texture(2, normals),
                    bind::texture(3, parts),
                    bind::texture(4, output),
                ],
            })
        });
        let (width, height) = samples.size();
        let mut pass = recorder.compute_pass("filter/interleaved");
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, group, &[]);
        pass.dispatch_workgroups(width.div_ceil(8), height.div_ceil(8), 1);
    }

    fn bytes(&self) -> u64 {
        let parts = |(t, _): &(wgpu::Texture, _)| 4 * u64::from(t.width()) * u64::from(t.height());
        self.parts.as_ref().map_or(0, parts) + self.uniform.as_ref().map_or(0, wgpu::Buffer::size)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_out_of_range_are_refused_with_a_fix() {
        assert!(Interleaved::default().part().is_ok(), "the defaults");
        for config in [
            Interleaved { block: 1, ..Interleaved::default() },
            Interleaved { block: 5, ..Interleaved::default() },
            Interleaved { taps: 0, ..Interleaved::default() },
            Interleaved { radius: f32::NAN, ..Interleaved::default() },
            Interleaved { flatness: 0.0, ..Interleaved::default() },
        ] {
            assert!(matches!(config.whole(), Err(GpuError::Invalid { .. })), "{config:?}");
        }
    }

    #[test]
    fn parts_share_out_every_point_once() {
        let config = Interleaved { block: 3, taps: 2, ..Interleaved::default() };
        let key = |p: &[f32; 2]| p.map(f32::to_bits);
        let mut shared: Vec<_> = config.points().iter().map(key).collect();
        let mut all: Vec<_> = poisson_disc(18).iter().map(key).collect();
        shared.sort_unstable();
        all.sort_unstable();
        assert_eq!(shared, all, "the points of a Poisson disc");
    }
}

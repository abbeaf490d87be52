//! Kernels that filter a store ahead of the lookup, and the store that results.

use antumbra_gpu::{
    Blur, BlurJob, BlurShader, Counters, Frame, Gpu, GpuError, MAX_BLUR_RADIUS, Recorder,
    blur_rounding,
};
use antumbra_map::{Estimator, MapConfig, MapRead, MapTechnique, ShadowMap, Store};
use antumbra_shaders::{Slot, module, source};
use serde::{Deserialize, Serialize};

use crate::beside::Depth;

/// Shape of a separable kernel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Shape {
    /// Equal weights. With the lookup's interpolation it is the kernel of
    /// [`PcfBilinearGrid`](crate::PcfBilinearGrid) with `side` 2 `radius` + 1.
    Box,
    /// exp(-d² / (2 s²)) with s = (`radius` + 1/2) / 2, cut off at `radius`.
    #[default]
    Gaussian,
}

/// The kernel by which a store is filtered when the map is drawn; the lookup interpolates between texels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Prefilter {
    /// Shape, default Gaussian.
    pub shape: Shape,
    /// Radius, texels, 0 to 31, default 2. Cost: 2 (2 `radius` + 1) multiply-adds a texel of the map and
    /// nothing a sample; a sample moves towards the light by up to `radius` + 1 texels of its slope.
    pub radius: u32,
}

/// Largest radius of any kernel, texels; filters that go through it texel by texel have a lower limit.
const LARGEST: u32 = 127;

impl Default for Prefilter {
    fn default() -> Self {
        Self { shape: Shape::Gaussian, radius: 2 }
    }
}

impl Prefilter {
    /// Weights of the texels from -radius to radius; their sum is 1.
    #[must_use]
    pub fn weights(&self) -> Vec<f64> {
        let radius = i64::from(self.radius.min(LARGEST));
        let deviation = 0.5 * (radius as f64 + 0.5);
        let weight = |d: i64| match self.shape {
            Shape::Box => 1.0,
            Shape::Gaussian => (-0.5 * (d as f64 / deviation).powi(2)).exp(),
        };
        let sum: f64 = (-radius..=radius).map(weight).sum();
        (-radius..=radius).map(|d| weight(d) / sum).collect()
    }

    /// Weight of texel `i` of the 2 `radius` + 2 an axis that a lookup reaches, interpolation included;
    /// conventions of [`crate::kernel`], with the offset `radius` + 1/2.
    #[must_use]
    pub fn lookup_weight(&self, i: u32, fraction: f64) -> f64 {
        let weights = self.weights();
        let at =
            |k: i64| usize::try_from(k).ok().and_then(|k| weights.get(k)).copied().unwrap_or(0.0);
        let i = i64::from(i);
        (1.0 - fraction) * at(i) + fraction * at(i - 1)
    }

    /// Largest distance from the sample to the centre of a texel of the lookup, texels.
    #[must_use]
    pub fn reach(&self) -> f64 {
        f64::from(self.radius) + 1.0
    }

    /// Mean square of the distances per axis of the filter's texels from their middle one, texels².
    #[must_use]
    pub fn square(&self) -> f64 {
        let weights = self.weights();
        let radius = (weights.len() / 2) as f64;
        weights.iter().enumerate().map(|(i, w)| w * (i as f64 - radius).powi(2)).sum()
    }

    /// Largest root mean square of the distances per axis of the lookup's texels from the sample, texels:
    /// interpolation at the fraction a adds a (1 - a) to the filter's square.
    #[must_use]
    pub fn spread(&self) -> f64 {
        (self.square() + 0.25).sqrt()
    }

    /// Bound on the rounding of a looked-up value relative to the largest in the kernel: of the blur, and 3
    /// roundings for each of two interpolations.
    #[must_use]
    pub fn rounding(&self) -> f64 {
        blur_rounding(self.radius) + 6.0 * 2f64.powi(-24)
    }

    /// # Errors
    /// A radius out of range.
    pub(crate) fn validate(&self) -> Result<(), GpuError> {
        if self.radius <= MAX_BLUR_RADIUS {
            return Ok(());
        }
        let (what, fix) = ("filter.radius", "use 0 to 31 texels");
        Err(GpuError::Invalid { what, value: self.radius.to_string(), fix })
    }
}

/// Checks a setting.
pub(crate) fn check(
    what: &'static str,
    value: f32,
    range: std::ops::RangeInclusive<f32>,
    fix: &'static str,
) -> Result<(), GpuError> {
    // NaN is in no range.
    if range.contains(&value) {
        return Ok(());
    }
    Err(GpuError::Invalid { what, value: value.to_string(), fix })
}

/// How a filtered store is made and read: the shader modules and the constants that both sides share.
#[derive(Clone, Debug)]
pub(crate) struct Recipe {
    pub(crate) filter: Prefilter,
    /// Module for the slot `texel` of the blur.
    pub(crate) texel: &'static str,
    /// Module for the slot `encoding`.
    pub(crate) encoding: &'static str,
    pub(crate) mean: &'static str,
    pub(crate) format: wgpu::TextureFormat,
    /// Module for the slot `store` of the lookup.
    pub(crate) store: &'static str,
    pub(crate) estimator: &'static str,
    /// Constants of the technique: names and values.
    pub(crate) constants: Vec<(&'static str, Constant)>,
    /// What each layer of the map becomes: one layer for each of these parameters.
    pub(crate) slices: Vec<[f32; 2]>,
    /// Fetches a sample.
    pub(crate) fetches: u32,
    /// Whether the lookup reads the depth map too, as binding 0 of group 2.
    pub(crate) reads_depth: bool,
    /// Constants that are no numbers.
    pub(crate) arrays: String,
    /// More modules of the lookup.
    pub(crate) modules: Vec<Slot>,
    /// Whether the lookup counts (`filter/tally.wesl`), as binding 1 of group 2.
    pub(crate) tally: bool,
}

/// A constant of a shader.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Constant {
    Float(f64),
    Int(u32),
    Bool(bool),
}

/// The module of constants, for the slot `config`.
pub(crate) fn constants(all: &[(&str, Constant)]) -> Slot {
    source("config", constant_lines(all))
}

fn constant_lines(all: &[(&str, Constant)]) -> String {
    let line = |(name, value): &(&str, Constant)| match value {
        Constant::Float(value) => format!("const {name}: f32 = {:?};\n", *value as f32),
        Constant::Int(value) => format!("const {name}: i32 = {value};\n"),
        Constant::Bool(value) => format!("const {name}: bool = {value};\n"),
    };
    all.iter().map(line).collect()
}

impl Recipe {
    pub(crate) fn new(
        filter: Prefilter,
        encoding: &'static str,
        format: wgpu::TextureFormat,
        estimator: &'static str,
        constants: Vec<(&'static str, Constant)>,
    ) -> Self {
        Self {
            filter,
            texel: "filter::from_depth",
            encoding,
            mean: "gpu::mean::arithmetic",
            format,
            store: "filter::texels",
            estimator,
            constants,
            slices: vec![[0.0; 2]],
            fetches: 4,
            reads_depth: false,
            arrays: String::new(),
            modules: Vec::new(),
            tally: false,
        }
    }

    fn config(&self) -> Slot {
        let common = [
            ("REACH", Constant::Float(self.filter.reach())),
            ("SQUARE", Constant::Float(self.filter.square())),
        ];
        let text = constant_lines(&common) + &constant_lines(&self.constants) + &self.arrays;
        source("config", text)
    }

    pub(crate) fn estimator(&self) -> Estimator {
        let unsigned = self.format == wgpu::TextureFormat::Rg32Uint;
        let mut slots =
            vec![module("store", self.store), module("estimator", self.estimator), self.config()];
        slots.extend(self.modules.iter().cloned());
        Estimator {
            slots,
            read: if unsigned { MapRead::Unsigned } else { MapRead::Texels },
            radius: self.filter.reach() as f32,
            // References of a filtered store have their own slack (`filter/receiver.wesl`).
            reach: 0.0,
            fetches: self.fetches,
        }
    }

    pub(crate) fn technique(&self, gpu: &Gpu, map: &MapConfig) -> Result<MapTechnique, GpuError> {
        MapTechnique::with_store(gpu, map, self.estimator(), self.store(gpu)?)
    }

    fn store(&self, gpu: &Gpu) -> Result<Box<dyn Store>, GpuError> {
        let shader = BlurShader {
            texel: self.texel,
            mean: self.mean,
            slots: vec![module("encoding", self.encoding), self.config()],
            format: self.format,
        };
        let blur = Blur::new(gpu, &shader, &self.filter.weights())?;
        let depth = self.reads_depth.then(|| Depth::new(gpu, self.tally));
        let (slices, taps) = (self.slices.clone(), 2 * self.filter.radius + 1);
        Ok(Box::new(Filtered { blur, slices, jobs: Vec::new(), depth, taps }))
    }
}

/// Encoded depth, filtered.
#[derive(Debug)]
struct Filtered {
    blur: Blur,
    slices: Vec<[f32; 2]>,
    jobs: Vec<BlurJob>,
    depth: Option<Depth>,
    /// Texels that each texel of a pass is made of.
    taps: u32,
}

impl Filtered {
    fn counters_of(&self, texels: u64) -> Counters {
        let texels = if self.jobs.is_empty() { 0 } else { texels };
        Counters::from([
            ("store_layers", self.jobs.len() as u64),
            ("store_texels", texels),
            ("store_taps", texels * u64::from(self.taps)),
        ])
    }
}

impl Store for Filtered {
    fn prepare(&mut self, gpu: &Gpu, _frame: &Frame<'_>, map: &ShadowMap) -> Result<(), GpuError> {
        self.jobs.clear();
        if let Some(depth) = &mut self.depth {
            depth.prepare(gpu, map.view())?;
        }
        let Some(view) = map.view() else { return Ok(()) };
        for (layer, linear) in map.linear_depths().iter().enumerate() {
            let coefficients = linear.coefficients.map(|c| c as f32);
            let job = |[a, b]: [f32; 2]| BlurJob {
                source: layer as u32,
                parameters: [coefficients, [a, b, 0.0, linear.last_caster as f32]],
            };
            self.jobs.extend(self.slices.iter().copied().map(job));
        }
        self.blur.prepare(gpu, view, map.size(), &self.jobs)
    }

    fn encode(
        &mut self,
        gpu: &Gpu,
        _frame: &Frame<'_>,
        map: &ShadowMap,
        recorder: &mut Recorder<'_>,
    ) -> Result<(), GpuError> {
        if !self.jobs.is_empty() {
            self.blur.encode_gated(gpu, recorder, "filter/blur", map.drawn());
        }
        Ok(())
    }

    fn needs_receivers(&self) -> bool {
        true
    }

    fn group_layout(&self) -> Option<&wgpu::BindGroupLayout> {
        self.depth.as_ref().map(Depth::layout)
    }

    fn group(&self) -> Option<&wgpu::BindGroup> {
        self.depth.as_ref().and_then(Depth::group)
    }

    fn view(&self) -> Option<&wgpu::TextureView> {
        self.blur.view()
    }

    fn counters(&self) -> Counters {
        self.counters_of(self.blur.texels())
    }

    fn read_counters(&self, gpu: &Gpu) -> Result<Counters, GpuError> {
        let mut counters = self.counters_of(self.blur.read_texels(gpu)?);
        if let Some(depth) = &self.depth {
            counters.extend(depth.counts(gpu)?);
        }
        Ok(counters)
    }

    fn bytes(&self) -> u64 {
        self.blur.bytes() + self.depth.as_ref().map_or(0, Depth::bytes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernel::Separable;

    fn filters() -> impl Iterator<Item = Prefilter> {
        let shapes = [Shape::Box, Shape::Gaussian];
        shapes
            .into_iter()
            .flat_map(|shape| [0, 1, 2, 7, 31].map(|radius| Prefilter { shape, radius }))
    }

    #[test]
    fn weights_of_a_lookup_add_to_one_and_lie_within_the_reach_and_spread() {
        for filter in filters() {
            for step in 0..100 {
                let fraction = f64::from(step) / 100.0;
                let texels = 2 * filter.radius + 2;
                let weight = |i| filter.lookup_weight(i, fraction);
                let sum: f64 = (0..texels).map(weight).sum();
                assert!((sum - 1.0).abs() < 1e-12, "{filter:?} at {fraction}: {sum}");
                // Texel i has its centre i - radius - fraction from the sample.
                let offset = |i: u32| f64::from(i) - f64::from(filter.radius) - fraction;
                let reach = (0..texels).filter(|i| weight(*i) > 0.0).map(|i| offset(i).abs());
                assert!(reach.fold(0.0, f64::max) <= filter.reach(), "{filter:?} at {fraction}");
                let square: f64 = (0..texels).map(|i| weight(i) * offset(i).powi(2)).sum();
                let spread = square.sqrt();
                assert!(spread <= filter.spread() + 1e-12, "{filter:?} at {fraction}: {spread}");
                let mean: f64 = (0..texels).map(|i| weight(i) * offset(i)).sum();
                assert!(mean.abs() < 1e-12, "{filter:?} at {fraction}: off centre by {mean}");
            }
        }
    }

    #[test]
    fn an_interpolated_box_is_the_grid_of_bilinear_taps() {
        for radius in [0, 1, 3] {
            let filter = Prefilter { shape: Shape::Box, radius };
            let grid = Separable::Tent { side: 2 * radius + 1 };
            for step in 0..50 {
                let fraction = f64::from(step) / 50.0;
                for i in 0..grid.texels() {
                    let (a, b) = (filter.lookup_weight(i, fraction), grid.weight(i, fraction));
                    assert!((a - b).abs() < 1e-14, "radius {radius}, texel {i}: {a}, not {b}");
                }
            }
        }
    }

    #[test]
    fn a_radius_out_of_range_is_refused() {
        let filter = Prefilter { radius: 32, ..Prefilter::default() };
        assert!(filter.validate().is_err(), "32 texels");
        assert!(Prefilter { radius: 31, ..filter }.validate().is_ok(), "31 texels");
    }
}

//! Kernels that filter a store ahead of the lookup, and the store that results.

use antumbra_gpu::{
    Blur, BlurJob, BlurShader, Counters, Frame, Gpu, GpuError, LayerJob, MAX_BLUR_RADIUS, Pyramid,
    PyramidKind, Recorder, blur_rounding,
};
use antumbra_map::{Estimator, MapConfig, MapRead, MapTechnique, ShadowMap, Store};
use antumbra_shaders::{Slot, module, source};
use serde::{Deserialize, Serialize};

use crate::beside::Depth;
use crate::eye::Eye;
use crate::vsm::U;

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
    /// Radius, texels of the store, 0 to 31, default 2. Cost: 2 (2 `radius` + 1) multiply-adds a texel and
    /// nothing a sample; a sample moves towards the light by up to `radius` + 1 texels of its slope.
    pub radius: u32,
    /// Texels of the map, a side, whose mean a texel of the store is: 1, 2 or 4, default 1. They are encoded before they
    /// are averaged, as multisampled colours are. The map's side must be a multiple. The store is as many times smaller,
    /// squared, and so is what filtering it costs; edges lie as exactly as the map's, not the store's, texels allow.
    pub samples: u32,
    /// Whether lookups grow with the pixel's footprint in the map, so that a minified map does not alias. Default no.
    pub footprint: Option<Footprint>,
}

/// Anisotropic lookups into a mipmap of the store (as EXT_texture_filter_anisotropic, 1999, defines them): several in a row
/// along the longer side of the pixel's footprint, of as many texels as its shorter side has, or its longer where that has
/// more than `lookups` of these. Without a camera, and where the map is magnified, the store is read as it is.
///
/// Cost: 7/3 of the store's memory, 8 fetches a lookup. A sample moves towards the light by as many more texels of its
/// slope as its kernel is wider. A map whose side is an odd multiple of 2^k has no levels beyond k.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Footprint {
    /// Longest footprint that is filtered in full, texels of the store: a power of two, 2 to 64, default 16. The map keeps
    /// a guard band of up to one and a half times as much around the casters.
    pub largest: u32,
    /// Most lookups in a row, 1 to 16, default 8; 1 is isotropic.
    pub lookups: u32,
}

/// Most lookups in a row. Sums over them end here also for settings that nobody has checked yet.
const MOST_LOOKUPS: u32 = 16;

impl Default for Footprint {
    fn default() -> Self {
        Self { largest: 16, lookups: 8 }
    }
}

impl Footprint {
    /// How much farther than without a lookup may reach, texels of the store. With n in a row of a footprint of w, they are
    /// up to (1 - 1/n) w / 2 to either side; a texel of the level l that holds one of them is up to 2^l from it and has
    /// half of its own 2^l texels beyond its centre.
    fn growth(self) -> f64 {
        let largest = f64::from(self.largest);
        let of = |n: u32| {
            let level = (largest / f64::from(n)).log2().ceil().max(0.0);
            0.5 * largest * (1.0 - 1.0 / f64::from(n)) + 1.5 * level.exp2() - 1.5
        };
        (1..=self.lookups.min(MOST_LOOKUPS)).map(of).fold(0.0, f64::max)
    }

    /// Bound on the mean square of the distances that a lookup adds to those of the filter's texels, an axis, texels of the
    /// store, squared.
    fn square(self) -> f64 {
        let largest = f64::from(self.largest);
        let of = |n: u32| {
            let level = (largest / f64::from(n)).log2().ceil().max(0.0);
            (level.exp2().powi(2) - 1.0) / 12.0
                + 0.25 * level.exp2().powi(2)
                + largest.powi(2) / 12.0 * (1.0 - f64::from(n).powi(-2))
        };
        (1..=self.lookups.min(MOST_LOOKUPS)).map(of).fold(0.0, f64::max)
    }

    /// Bound on what levels and lookups round, relative to the largest value: a level is a mean of 4, a lookup one of 8,
    /// whose weights are products of three, and they have a mean.
    fn rounding(self) -> f64 {
        let levels = 5.0 * f64::from(self.largest).log2();
        U * (levels + 12.0 + f64::from(self.lookups) + 2.0)
    }

    fn validate(self) -> Result<(), GpuError> {
        let invalid =
            |what, value: u32, fix| Err(GpuError::Invalid { what, value: value.to_string(), fix });
        if !self.largest.is_power_of_two() || !(2..=64).contains(&self.largest) {
            return invalid("filter.footprint.largest", self.largest, "use 2, 4, 8 .. 64 texels");
        }
        if !(1..=MOST_LOOKUPS).contains(&self.lookups) {
            return invalid("filter.footprint.lookups", self.lookups, "use 1 to 16");
        }
        Ok(())
    }
}

/// Largest radius of any kernel, texels; filters that go through it texel by texel have a lower limit.
const LARGEST: u32 = 127;

impl Default for Prefilter {
    fn default() -> Self {
        Self { shape: Shape::Gaussian, radius: 2, samples: 1, footprint: None }
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

    /// Largest distance from the sample to the centre of a texel of the map that a lookup reaches, texels of the map.
    #[must_use]
    pub fn reach(&self) -> f64 {
        let growth = self.footprint.map_or(0.0, Footprint::growth);
        f64::from(self.samples) * (self.least_reach() + growth)
    }

    /// The same of a lookup that no footprint widens, in texels of the store.
    fn least_reach(&self) -> f64 {
        f64::from(self.radius) + 1.0 + 0.5 * (1.0 - f64::from(self.samples).recip())
    }

    /// Mean square of the distances per axis of the filter's texels, those of the map, from the middle, texels of the store,
    /// squared.
    #[must_use]
    pub fn square(&self) -> f64 {
        let weights = self.weights();
        let radius = (weights.len() / 2) as f64;
        let of_texels: f64 =
            weights.iter().enumerate().map(|(i, w)| w * (i as f64 - radius).powi(2)).sum();
        of_texels + (1.0 - f64::from(self.samples).powi(-2)) / 12.0
    }

    /// Largest root mean square of the distances per axis of the lookup's texels from the sample, texels of the map:
    /// interpolation at the fraction a adds a (1 - a) to the filter's square. Footprints are left out.
    #[must_use]
    pub fn spread(&self) -> f64 {
        f64::from(self.samples) * (self.square() + 0.25).sqrt()
    }

    /// The same, of the widest footprint.
    pub(crate) fn widest_spread(&self) -> f64 {
        let read = self.footprint.map_or(0.25, Footprint::square);
        f64::from(self.samples) * (self.square() + read).sqrt()
    }

    /// Bound on the rounding of a looked-up value relative to the largest in the kernel: of a texel's samples, of the
    /// blur, and of interpolation by weights that are products, with their sum.
    #[must_use]
    pub fn rounding(&self) -> f64 {
        let samples = self.samples * self.samples;
        let sampled = if samples > 1 { f64::from(samples + 1) * U } else { 0.0 };
        let read = self.footprint.map_or(6.0 * U, Footprint::rounding);
        sampled + blur_rounding(self.radius) + read
    }

    /// Means beside those of the blur's two passes and of one lookup.
    pub(crate) fn more_means(&self) -> f64 {
        let levels = self.footprint.map_or(0.0, |f| f64::from(f.largest).log2() + 1.0);
        levels + if self.samples > 1 { 1.0 } else { 0.0 }
    }

    /// Side of the store of a map of `size` texels a side.
    ///
    /// # Errors
    /// A side that is no multiple of `samples`.
    fn side(&self, size: u32) -> Result<u32, GpuError> {
        if size.is_multiple_of(self.samples) {
            return Ok(size / self.samples);
        }
        let (what, fix) = ("filter.samples", "use a map whose side is a multiple of it");
        Err(GpuError::Invalid { what, value: format!("{} of {size} texels", self.samples), fix })
    }

    /// # Errors
    /// A radius out of range.
    pub(crate) fn validate(&self) -> Result<(), GpuError> {
        if self.radius > MAX_BLUR_RADIUS {
            let (what, fix) = ("filter.radius", "use 0 to 31 texels");
            return Err(GpuError::Invalid { what, value: self.radius.to_string(), fix });
        }
        if !matches!(self.samples, 1 | 2 | 4) {
            let (what, fix) = ("filter.samples", "use 1, 2 or 4");
            return Err(GpuError::Invalid { what, value: self.samples.to_string(), fix });
        }
        self.footprint.map_or(Ok(()), Footprint::validate)
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
        let mut common = vec![
            ("REACH", Constant::Float(self.filter.least_reach())),
            ("SQUARE", Constant::Float(self.filter.square())),
            ("SAMPLES", Constant::Int(self.filter.samples)),
        ];
        if let Some(Footprint { largest, lookups }) = self.filter.footprint {
            common.extend([
                ("LARGEST", Constant::Float(largest.into())),
                ("LOOKUPS", Constant::Float(lookups.into())),
            ]);
        }
        let text = constant_lines(&common) + &constant_lines(&self.constants) + &self.arrays;
        source("config", text)
    }

    pub(crate) fn estimator(&self) -> Estimator {
        let unsigned = self.format == wgpu::TextureFormat::Rg32Uint;
        let store = if self.filter.footprint.is_some() { "filter::mipmapped" } else { self.store };
        let mut slots = vec![
            module("store", store),
            module("mean", self.mean),
            module("estimator", self.estimator),
            self.config(),
        ];
        slots.extend(self.modules.iter().cloned());
        Estimator {
            slots,
            read: if unsigned { MapRead::Unsigned } else { MapRead::Texels },
            radius: self.filter.reach() as f32,
            // References of a filtered store have their own slack (`filter/receiver.wesl`).
            reach: 0.0,
            fetches: self.fetches * self.filter.footprint.map_or(1, |f| 2 * f.lookups),
        }
    }

    /// # Errors
    /// A footprint or samples for a store that has no such lookup.
    fn validate(&self, map: &MapConfig) -> Result<(), GpuError> {
        use wgpu::TextureFormat::{Rg32Uint, Rgba8Unorm};
        let invalid = |what, fix| Err(GpuError::Invalid { what, value: "on".to_owned(), fix });
        let quantised = matches!(self.format, Rg32Uint | Rgba8Unorm);
        if self.filter.footprint.is_some() && (quantised || self.reads_depth) {
            let fix = "leave it out, or use a store of 32-bit floats without a fallback";
            return invalid("filter.footprint", fix);
        }
        if self.filter.samples > 1 && self.reads_depth {
            return invalid("filter.samples", "use 1 with a fallback, which reads the map itself");
        }
        self.filter.side(map.size).map(|_| ())
    }

    pub(crate) fn technique(&self, gpu: &Gpu, map: &MapConfig) -> Result<MapTechnique, GpuError> {
        self.validate(map)?;
        MapTechnique::with_store(gpu, map, self.estimator(), self.store(gpu)?)
    }

    fn store(&self, gpu: &Gpu) -> Result<Box<dyn Store>, GpuError> {
        let one_by_one = self.filter.samples == 1;
        let shader = BlurShader {
            texel: if one_by_one { self.texel } else { "filter::from_samples" },
            mean: self.mean,
            slots: vec![
                module("sampled", self.texel),
                module("encoding", self.encoding),
                self.config(),
            ],
            format: self.format,
        };
        let mips = match self.filter.footprint {
            None => None,
            Some(_) => Some(Mips::new(gpu, self.mean, self.config(), self.format)?),
        };
        Ok(Box::new(Filtered {
            filter: self.filter,
            blur: Blur::new(gpu, &shader, &self.filter.weights())?,
            slices: self.slices.clone(),
            jobs: Vec::new(),
            depth: self.reads_depth.then(|| Depth::new(gpu, self.tally)),
            mips,
        }))
    }
}

/// Encoded depth, filtered.
#[derive(Debug)]
struct Filtered {
    filter: Prefilter,
    blur: Blur,
    slices: Vec<[f32; 2]>,
    jobs: Vec<BlurJob>,
    depth: Option<Depth>,
    mips: Option<Mips>,
}

/// The filtered store with means of its texels, and the camera whose pixels' footprints are looked up in it.
#[derive(Debug)]
struct Mips {
    pyramid: Pyramid,
    eye: Eye,
    jobs: Vec<LayerJob>,
}

impl Mips {
    fn new(
        gpu: &Gpu,
        mean: &'static str,
        config: Slot,
        format: wgpu::TextureFormat,
    ) -> Result<Self, GpuError> {
        let texel = "gpu::stored_texel";
        let shader = BlurShader { texel, mean, slots: vec![config], format };
        let pyramid = Pyramid::new(gpu, PyramidKind::Mip, &shader)?;
        Ok(Self { pyramid, eye: Eye::new(gpu), jobs: Vec::new() })
    }

    fn prepare(
        &mut self,
        gpu: &Gpu,
        frame: &Frame<'_>,
        filtered: Option<&wgpu::TextureView>,
        (side, layers): (u32, usize),
    ) -> Result<(), GpuError> {
        self.eye.prepare(gpu, frame);
        self.jobs.clear();
        let Some(filtered) = filtered else { return Ok(()) };
        self.jobs
            .extend((0..layers as u32).map(|source| LayerJob { source, ..Default::default() }));
        self.pyramid.prepare(gpu, filtered, side, &self.jobs)
    }
}

impl Filtered {
    fn counters_of(&self, blurred: u64) -> Counters {
        let layers = self.jobs.len() as u64;
        let blurred = if layers == 0 { 0 } else { blurred };
        // Half of what a blur writes is on the way. The mipmap's first level is copied, all others are of 4 texels.
        let halved = match &self.mips {
            Some(mips) if layers > 0 => mips.pyramid.texels().saturating_sub(blurred / 2),
            _ => 0,
        };
        let copied = if self.mips.is_some() { blurred / 2 } else { 0 };
        // A texel's samples are put together once.
        let samples =
            if self.filter.samples > 1 { u64::from(self.filter.samples).pow(2) } else { 0 };
        let taps = u64::from(2 * self.filter.radius + 1);
        Counters::from([
            ("store_layers", layers),
            ("store_texels", blurred + copied + halved),
            ("store_taps", blurred * taps + blurred / 2 * samples + copied + 4 * halved),
        ])
    }
}

impl Store for Filtered {
    fn prepare(&mut self, gpu: &Gpu, frame: &Frame<'_>, map: &ShadowMap) -> Result<(), GpuError> {
        self.jobs.clear();
        if let Some(depth) = &mut self.depth {
            depth.prepare(gpu, map.view())?;
        }
        let Some(view) = map.view() else {
            return match &mut self.mips {
                Some(mips) => mips.prepare(gpu, frame, None, (0, 0)),
                None => Ok(()),
            };
        };
        for (layer, linear) in map.linear_depths().iter().enumerate() {
            let coefficients = linear.coefficients.map(|c| c as f32);
            let job = |[a, b]: [f32; 2]| BlurJob {
                source: layer as u32,
                parameters: [coefficients, [a, b, 0.0, linear.last_caster as f32]],
            };
            self.jobs.extend(self.slices.iter().copied().map(job));
        }
        let side = self.filter.side(map.size())?;
        self.blur.prepare(gpu, view, side, &self.jobs)?;
        if let Some(mips) = &mut self.mips {
            mips.prepare(gpu, frame, self.blur.view(), (side, self.jobs.len()))?;
        }
        Ok(())
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
        if let Some(mips) = self.mips.as_ref().filter(|mips| !mips.jobs.is_empty()) {
            mips.pyramid.encode(recorder, "filter/mipmap");
        }
        Ok(())
    }

    fn needs_receivers(&self) -> bool {
        true
    }

    fn grid(&self) -> u32 {
        self.filter.samples * self.filter.footprint.map_or(1, |footprint| footprint.largest)
    }

    fn group_layout(&self) -> Option<&wgpu::BindGroupLayout> {
        let camera = self.mips.as_ref().map(|mips| mips.eye.layout());
        camera.or_else(|| self.depth.as_ref().map(Depth::layout))
    }

    fn group(&self) -> Option<&wgpu::BindGroup> {
        let camera = self.mips.as_ref().and_then(|mips| mips.eye.group());
        camera.or_else(|| self.depth.as_ref().and_then(Depth::group))
    }

    fn view(&self) -> Option<&wgpu::TextureView> {
        match &self.mips {
            Some(mips) => mips.pyramid.mips_view(),
            None => self.blur.view(),
        }
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
        let mips = self.mips.as_ref().map_or(0, |mips| mips.pyramid.bytes() + mips.eye.bytes());
        self.blur.bytes() + self.depth.as_ref().map_or(0, Depth::bytes) + mips
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernel::Separable;

    fn filters() -> impl Iterator<Item = Prefilter> {
        let shapes = [Shape::Box, Shape::Gaussian];
        shapes.into_iter().flat_map(|shape| {
            [0, 1, 2, 7, 31].map(|radius| Prefilter { shape, radius, ..Default::default() })
        })
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
            let filter = Prefilter { shape: Shape::Box, radius, ..Prefilter::default() };
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

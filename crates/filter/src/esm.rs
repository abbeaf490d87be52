//! Exponential and exponential variance shadow maps.

use antumbra_gpu::{Expectation, Gpu, GpuError, Technique, TechniqueConfig};
use antumbra_map::{Estimator, MapConfig, MapTechnique};
use antumbra_shaders::module;
use serde::{Deserialize, Serialize};

use crate::expectation::{Bound, expectation};
use crate::prefilter::{Constant, Prefilter, Recipe, check};
use crate::vsm::{U, check_cut};

/// Exponential shadow maps (Annen, Mertens, Seidel, Flerackers, Kautz 2008): exp(c (z - z~)) stands for the
/// comparison, and its first factor filters. Filtered in the logarithm (Salvi 2008), so that no c overflows.
/// 4 bytes a texel.
///
/// A receiver at g behind all casters of the kernel is lit by exp(-c g); one texel deeper than the receiver
/// may light all of it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Esm {
    /// The shadow map.
    pub map: MapConfig,
    /// The kernel.
    pub filter: Prefilter,
    /// c, per depth range, 1 to 1000, default 80 as published. Larger leaks less at contacts, and makes of one
    /// deep texel more.
    pub sharpness: f32,
    /// What is done about texels behind the receiver, default nothing.
    pub fallback: Fallback,
    /// Counts on the GPU, for measurements, the lookups (`esm_lookups`) and those that ask texels one by one
    /// (`esm_one_by_one`). Default false; there are none where `fallback` is never.
    pub tally: bool,
}

/// Where an exponential shadow map asks the texels of the kernel one by one, each exponential cut off at 1, since
/// something in the kernel lies behind the receiver (Annen et al. 2008). Costs 4 bytes a texel, and there (2 radius + 2)²
/// fetches a sample; rough ground has it nearly everywhere.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Fallback {
    /// Nowhere: a few deep texels light the whole kernel.
    #[default]
    Never,
    /// Where the filtered exponential tells, being above 1. Misses deep texels that near ones outweigh.
    Overflow,
    /// Wherever a texel of the kernel lies behind the receiver, by the largest depth of every kernel. Slopes count too.
    Deeper,
}

/// Exponential variance shadow maps (Lauritzen, McCool 2008): variance shadow maps of two warps of depth, exp(c+ x)
/// and -exp(-c- x) with x = 2 z - 1, of which the lesser bound counts. 16 bytes a texel, or 8 for the first alone.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Evsm {
    /// The shadow map.
    pub map: MapConfig,
    /// The kernel.
    pub filter: Prefilter,
    /// c+, 0.01 to 42, default 40: its square must fit a 32-bit float. Larger leaks less between casters.
    pub positive: f32,
    /// c-, 0.01 to 42, default 5. It guards receivers with something far behind them in the kernel.
    pub negative: f32,
    /// Whether the second warp is kept, default true; without it half of the memory and less of the safety.
    pub both: bool,
    /// Standard deviation of depth that counts as none, share of the depth range, 0 to 1, default 2.5e-5: the
    /// share (2 c `deviation`)² = 4e-6 of a warped variance is 5 times what a filter in f32 rounds off it, and
    /// all that leaks far behind a caster.
    pub deviation: f32,
    /// Visibility below which all is dark, what is above being stretched to fill: 0 to 0.99, default 0.
    pub cut: f32,
}

impl Default for Esm {
    fn default() -> Self {
        Self {
            map: MapConfig::default(),
            filter: Prefilter::default(),
            sharpness: 80.0,
            fallback: Fallback::Never,
            tally: false,
        }
    }
}

impl Default for Evsm {
    fn default() -> Self {
        Self {
            map: MapConfig::default(),
            filter: Prefilter::default(),
            positive: 40.0,
            negative: 5.0,
            both: true,
            deviation: 2.5e-5,
            cut: 0.0,
        }
    }
}

impl Esm {
    fn recipe(&self) -> Result<Recipe, GpuError> {
        self.filter.validate()?;
        check("sharpness", self.sharpness, 1.0..=1000.0, "use 1 to 1000")?;
        // The logarithm turns a relative error of the mean of exponentials into 1 / c as much of depth.
        // exp(-a) is exact to 3 + 2 a units of 2u, of which exp(-a) leaves 3.2 at most; of the filter's and the lookup's
        // means each term is scaled once for each later one that is larger at most; and the logarithm of each of the two
        // and of the lookup is exact to 3 units of the sum, or 2^-21 where that is near 1 (WGSL, 17.6).
        let logarithms = 3.0 + self.filter.more_means();
        let relative = logarithms * 2f64.powi(-21) + 8.0 * self.filter.rounding();
        let rounding = relative / f64::from(self.sharpness) + 8.0 * U;
        let constants = vec![
            ("SHARPNESS", Constant::Float(self.sharpness.into())),
            ("ROUNDING", Constant::Float(rounding)),
        ];
        let format = wgpu::TextureFormat::R32Float;
        let encoding = "filter::encoding::depth";
        let mut recipe = Recipe::new(self.filter, encoding, format, "filter::esm", constants);
        recipe.mean = "gpu::mean::exponential";
        if self.fallback != Fallback::Never {
            recipe.encoding = "filter::encoding::depth_twice";
            recipe.mean = "gpu::mean::exponential_and_largest";
            recipe.format = wgpu::TextureFormat::Rg32Float;
            recipe.estimator = "filter::esm_fallback";
            recipe.reads_depth = true;
            recipe.tally = self.tally;
            if !self.tally {
                recipe.modules.push(module("filter::tally", "filter::no_tally"));
            }
            // At this depth behind the receiver an exponential is 1.01.
            let margin = 1.01f64.ln() / f64::from(self.sharpness);
            let texels = 2 * self.filter.radius + 2;
            recipe.constants.extend([
                ("MARGIN", Constant::Float(margin + rounding)),
                ("ALL", Constant::Bool(self.fallback == Fallback::Deeper)),
                ("TEXELS", Constant::Int(texels)),
            ]);
            let weights = self.filter.weights();
            let padded: Vec<String> = std::iter::once(&0.0)
                .chain(&weights)
                .chain([&0.0])
                .map(|w| format!("{:?}", *w as f32))
                .collect();
            let count = padded.len();
            recipe.arrays =
                format!("const WEIGHTS = array<f32, {count}>({});\n", padded.join(", "));
            recipe.fetches = 8 + texels * texels;
        }
        Ok(recipe)
    }

    /// The estimator, for any layout.
    ///
    /// # Errors
    /// A setting out of range.
    pub fn estimator(&self) -> Result<Estimator, GpuError> {
        Ok(self.recipe()?.estimator())
    }

    /// The technique, with its map and store at hand.
    ///
    /// # Errors
    /// A setting out of range or beyond the device's limits.
    pub fn technique(&self, gpu: &Gpu) -> Result<MapTechnique, GpuError> {
        self.recipe()?.technique(gpu, &self.map)
    }
}

impl Evsm {
    fn recipe(&self) -> Result<Recipe, GpuError> {
        const FIX: &str = "use 0.01 to 42";
        self.filter.validate()?;
        check("positive", self.positive, 0.01..=42.0, FIX)?;
        check("negative", self.negative, 0.01..=42.0, FIX)?;
        check("deviation", self.deviation, 0.0..=1.0, "use 0 to 1 of the depth range")?;
        check_cut(self.cut)?;
        // A relative error of the warp is one of depth, divided by the exponent's slope 2 c. exp(a) is exact to
        // 3 + 2 |a| units of 2u, on both sides; the argument c (2 z - 1) to 2u c.
        let rounding = |c: f32| {
            let c = f64::from(c);
            let exponentials = 2.0 * ((3.0 + 2.0 * c) * 2.0 * U + 2.0 * U * c);
            (self.filter.rounding() + exponentials) / (2.0 * c)
        };
        let constants = vec![
            ("POSITIVE", Constant::Float(self.positive.into())),
            ("NEGATIVE", Constant::Float(self.negative.into())),
            ("BOTH", Constant::Bool(self.both)),
            ("DEVIATION", Constant::Float(self.deviation.into())),
            ("CUT", Constant::Float(self.cut.into())),
            ("ROUNDING", Constant::Float(rounding(self.positive))),
            ("NEGATIVE_ROUNDING", Constant::Float(rounding(self.negative))),
        ];
        let format = if self.both {
            wgpu::TextureFormat::Rgba32Float
        } else {
            wgpu::TextureFormat::Rg32Float
        };
        let encoding = "filter::encoding::warped";
        Ok(Recipe::new(self.filter, encoding, format, "filter::evsm", constants))
    }

    /// The estimator, for any layout.
    ///
    /// # Errors
    /// A setting out of range.
    pub fn estimator(&self) -> Result<Estimator, GpuError> {
        Ok(self.recipe()?.estimator())
    }

    /// The technique, with its map and store at hand.
    ///
    /// # Errors
    /// A setting out of range or beyond the device's limits.
    pub fn technique(&self, gpu: &Gpu) -> Result<MapTechnique, GpuError> {
        self.recipe()?.technique(gpu, &self.map)
    }
}

impl TechniqueConfig for Esm {
    fn build(&self, gpu: &Gpu) -> Result<Box<dyn Technique>, GpuError> {
        Ok(Box::new(self.technique(gpu)?))
    }

    fn set_map_size(&mut self, size: u32) {
        self.map.size = size;
    }

    fn expectation(&self, case: &str) -> Option<Expectation> {
        let bound = Bound::Exponential { sharpness: self.sharpness.into() };
        expectation(&self.map, &self.filter, bound, case)
    }
}

impl TechniqueConfig for Evsm {
    fn build(&self, gpu: &Gpu) -> Result<Box<dyn Technique>, GpuError> {
        Ok(Box::new(self.technique(gpu)?))
    }

    fn set_map_size(&mut self, size: u32) {
        self.map.size = size;
    }

    fn expectation(&self, case: &str) -> Option<Expectation> {
        let (positive, deviation) = (self.positive.into(), self.deviation.into());
        let bound = Bound::Warps { positive, deviation };
        expectation(&self.map, &self.filter, bound, case)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_out_of_range_are_refused_with_a_fix() {
        assert!(Esm::default().estimator().is_ok(), "the defaults");
        assert!(Evsm::default().estimator().is_ok(), "the defaults");
        for sharpness in [0.0, -80.0, f32::NAN, f32::INFINITY] {
            assert!(Esm { sharpness, ..Esm::default() }.estimator().is_err(), "{sharpness}");
        }
        for config in [
            Evsm { positive: 44.4, ..Evsm::default() },
            Evsm { negative: 0.0, ..Evsm::default() },
            Evsm { deviation: -1.0, ..Evsm::default() },
            Evsm { cut: f32::NAN, ..Evsm::default() },
        ] {
            assert!(matches!(config.estimator(), Err(GpuError::Invalid { .. })), "{config:?}");
        }
    }
}

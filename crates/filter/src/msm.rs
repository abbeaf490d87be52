//! Moment shadow maps.

use antumbra_gpu::{Expectation, Gpu, GpuError, Technique, TechniqueConfig};
use antumbra_map::{Estimator, MapConfig, MapTechnique};
use serde::{Deserialize, Serialize};

use crate::expectation::{Bound, expectation};
use crate::prefilter::{Constant, Prefilter, Recipe, check};
use crate::vsm::{U, check_cut};

/// Moment shadow maps (Peters, Klein 2015; Peters, Muenstermann, Wetzstein, Klein 2017): four moments of depth
/// bound visibility from above, as sharply as four moments can. 16 bytes a texel, or 8 quantised.
///
/// Exact where the kernel holds two depths, however many casters there are in all; leaks where it holds three.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Msm {
    /// The shadow map.
    pub map: MapConfig,
    /// The kernel.
    pub filter: Prefilter,
    /// Whether moments are kept at 16 bits a channel: half of the memory, forty times the leak at contacts.
    /// Default false; both were published.
    pub quantised: bool,
    /// Share of the moments that is replaced by those of a distribution far from degenerate, 0 to 0.1; `None`,
    /// the default, for what the store's rounding asks for: 6e-5 at 16 bits as published; in 32-bit floats
    /// as much as the filter may round, and 1e-6 at least; three times that with `ends`.
    pub moment_bias: Option<f32>,
    /// Whether the bound is that of depths within the range (the Hausdorff moment problem) and not of any (Hamburger's).
    /// Default false, as is usual; with it a fifth less leaks, for about twice the arithmetic of a lookup.
    pub ends: bool,
    /// Visibility below which all is dark, what is above being stretched to fill: 0 to 0.99, default 0.
    pub cut: f32,
}

impl Default for Msm {
    fn default() -> Self {
        Self {
            map: MapConfig::default(),
            filter: Prefilter::default(),
            quantised: false,
            moment_bias: None,
            ends: false,
            cut: 0.0,
        }
    }
}

impl Msm {
    /// The share of the moments that is replaced.
    #[must_use]
    pub fn effective_moment_bias(&self) -> f64 {
        let derived = if self.quantised { 6e-5 } else { self.filter.rounding().max(1e-6) };
        let share = if self.ends { 3.0 * derived } else { derived };
        self.moment_bias.map_or(share, f64::from)
    }

    /// Second and fourth moment of what is mixed in; the first and third are 0. As published (Peters et al. 2017), which is
    /// masses at -1, 0 and 1. Within the ends of the range that is a single point, of which no moments but those of
    /// degenerate distributions come; so with `ends` they are those of an even distribution.
    #[must_use]
    pub fn moment_target(&self) -> [f64; 2] {
        match (self.ends, self.quantised) {
            (true, _) => [1.0 / 3.0, 0.2],
            (false, true) => [0.628; 2],
            (false, false) => [0.375; 2],
        }
    }

    fn recipe(&self) -> Result<Recipe, GpuError> {
        self.filter.validate()?;
        let bias = self.effective_moment_bias() as f32;
        check("moment_bias", bias, 0.0..=0.1, "use 0 to 0.1, or none for the derived bias")?;
        check_cut(self.cut)?;
        let [second, fourth] = self.moment_target();
        let constants = vec![
            ("MOMENT_BIAS", Constant::Float(bias.into())),
            ("SECOND_TARGET", Constant::Float(second)),
            ("FOURTH_TARGET", Constant::Float(fourth)),
            ("ENDS", Constant::Bool(self.ends)),
            ("CUT", Constant::Float(self.cut.into())),
            // Of depth on both sides; the moments' rounding is the bias's affair.
            ("ROUNDING", Constant::Float(4.0 * U)),
        ];
        let (encoding, format, store) = if self.quantised {
            let format = wgpu::TextureFormat::Rg32Uint;
            ("filter::encoding::moments_16", format, "filter::texels_16")
        } else {
            let format = wgpu::TextureFormat::Rgba32Float;
            ("filter::encoding::moments", format, "filter::texels")
        };
        let mut recipe = Recipe::new(self.filter, encoding, format, "filter::msm", constants);
        recipe.store = store;
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

impl TechniqueConfig for Msm {
    fn build(&self, gpu: &Gpu) -> Result<Box<dyn Technique>, GpuError> {
        Ok(Box::new(self.technique(gpu)?))
    }

    fn set_map_size(&mut self, size: u32) {
        self.map.size = size;
    }

    fn expectation(&self, case: &str) -> Option<Expectation> {
        let bound = Bound::Moments { bias: self.effective_moment_bias() };
        expectation(&self.map, &self.filter, bound, case)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_out_of_range_are_refused_with_a_fix() {
        assert!(Msm::default().estimator().is_ok(), "the defaults");
        for config in [
            Msm { moment_bias: Some(f32::NAN), ..Msm::default() },
            Msm { moment_bias: Some(-1e-6), ..Msm::default() },
            Msm { cut: 1.5, ..Msm::default() },
        ] {
            assert!(matches!(config.estimator(), Err(GpuError::Invalid { .. })), "{config:?}");
        }
    }
}

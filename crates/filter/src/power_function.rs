//! Shadow maps with a power function for the distribution of depths.

use antumbra_gpu::{Expectation, Gpu, GpuError, Technique, TechniqueConfig};
use antumbra_map::{Estimator, MapConfig, MapTechnique, expectation as of_a_depth_map};
use serde::{Deserialize, Serialize};

use crate::prefilter::{Constant, Prefilter, Recipe, check};
use crate::vsm::U;

/// Shadow maps that take the depths in a kernel for distributed by a power function with their first two moments (after
/// Gumbau, Szirmay-Kalos, Sbert, Sellés 2011; the fit is derived here). 8 bytes a texel, as a variance shadow map.
///
/// No bound: a little more than a deviation behind the mean of its casters a receiver is exactly dark, so that stacked
/// casters leak half as much as by variance; and penumbrae are too dark, half in shadow by two thirds.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PowerFunction {
    /// The shadow map.
    pub map: MapConfig,
    /// The kernel.
    pub filter: Prefilter,
    /// Least standard deviation of depth, share of the depth range, 1e-4 to 1, default 1e-3: what lies as far behind its
    /// caster is dark.
    pub deviation: f32,
    /// How far before the nearest caster the distribution begins, depth ranges, 0.01 to 100, default 1. The less, the
    /// lighter are penumbrae under the nearest casters, and the more leaks under them.
    pub before: f32,
}

impl Default for PowerFunction {
    fn default() -> Self {
        Self {
            map: MapConfig::default(),
            filter: Prefilter::default(),
            deviation: 1e-3,
            before: 1.0,
        }
    }
}

impl PowerFunction {
    fn recipe(&self) -> Result<Recipe, GpuError> {
        self.filter.validate()?;
        check("deviation", self.deviation, 1e-4..=1.0, "use 1e-4 to 1 of the depth range")?;
        check("before", self.before, 0.01..=100.0, "use 0.01 to 100 depth ranges")?;
        // As for a variance shadow map, and the sums with `before`, on both sides.
        let rounding = 0.5 * self.filter.rounding() + U + 4.0 * U * (1.0 + f64::from(self.before));
        let constants = vec![
            ("LEAST_VARIANCE", Constant::Float(f64::from(self.deviation).powi(2))),
            ("BEFORE", Constant::Float(self.before.into())),
            ("ROUNDING", Constant::Float(rounding)),
        ];
        let (encoding, format) = ("filter::encoding::variance", wgpu::TextureFormat::Rg32Float);
        Ok(Recipe::new(self.filter, encoding, format, "filter::power_function", constants))
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

impl TechniqueConfig for PowerFunction {
    fn build(&self, gpu: &Gpu) -> Result<Box<dyn Technique>, GpuError> {
        Ok(Box::new(self.technique(gpu)?))
    }

    fn set_map_size(&mut self, size: u32) {
        self.map.size = size;
    }

    fn expectation(&self, case: &str) -> Option<Expectation> {
        // A surface by itself is lit, since its mean is no nearer than the reference; of the rest it is not said.
        let known = ["lone receivers", "HC-03"];
        let is_known = known.iter().any(|name| case.starts_with(name));
        is_known.then(|| of_a_depth_map(&self.map, &self.estimator().ok()?, case)).flatten()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_out_of_range_are_refused_with_a_fix() {
        assert!(PowerFunction::default().estimator().is_ok(), "the defaults");
        for config in [
            PowerFunction { deviation: 0.0, ..PowerFunction::default() },
            PowerFunction { deviation: f32::NAN, ..PowerFunction::default() },
            PowerFunction { before: 0.0, ..PowerFunction::default() },
            PowerFunction {
                filter: Prefilter { radius: 32, ..Prefilter::default() },
                ..PowerFunction::default()
            },
        ] {
            assert!(matches!(config.estimator(), Err(GpuError::Invalid { .. })), "{config:?}");
        }
    }
}

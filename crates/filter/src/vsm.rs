//! Variance shadow maps.

use antumbra_gpu::{Expectation, Gpu, GpuError, Technique, TechniqueConfig};
use antumbra_map::{Estimator, MapConfig, MapTechnique};
use serde::{Deserialize, Serialize};

use crate::expectation::{Bound, expectation};
use crate::prefilter::{Constant, Prefilter, Recipe, check};

/// Variance shadow maps (Donnelly, Lauritzen 2006): the first two moments of depth, filtered like any texture,
/// bound visibility from above by Chebyshev's inequality. 8 bytes a texel.
///
/// Exact where a flat caster shadows a flat receiver parallel to it; where casters overlap, light leaks by up to
/// 1 / (1 + 2 r)² with r the receiver's distance from the farther caster relative to that between casters.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Vsm {
    /// The shadow map.
    pub map: MapConfig,
    /// The kernel.
    pub filter: Prefilter,
    /// Least standard deviation of depth, share of the depth range, 0 to 1, default 1e-3. It covers the
    /// variance's cancellation (about 1e-7 of the range's square); a receiver as far behind a caster is still
    /// half lit.
    pub deviation: f32,
    /// Adds the depth's own spread within a texel to its variance, from the differences to its neighbours
    /// (Lauritzen 2007), default false: the receiver's plane needs no such help. More light, never less; 4 more
    /// fetches a texel.
    pub slope_moment: bool,
    /// Visibility below which all is dark, what is above being stretched to fill (Lauritzen 2007): 0 to 0.99,
    /// default 0, the published bound. 0.1 to 0.3 hides most leaks and thins penumbrae.
    pub cut: f32,
}

impl Default for Vsm {
    fn default() -> Self {
        Self {
            map: MapConfig::default(),
            filter: Prefilter::default(),
            deviation: 1e-3,
            slope_moment: false,
            cut: 0.0,
        }
    }
}

/// Unit roundoff of f32.
pub(crate) const U: f64 = 1.0 / 16_777_216.0;

pub(crate) fn check_cut(cut: f32) -> Result<(), GpuError> {
    check("cut", cut, 0.0..=0.99, "use a visibility of 0 to 0.99")
}

impl Vsm {
    fn recipe(&self) -> Result<Recipe, GpuError> {
        self.filter.validate()?;
        check("deviation", self.deviation, 0.0..=1.0, "use 0 to 1 of the depth range")?;
        check_cut(self.cut)?;
        // Depth about the middle, at most 1/2: rounded by the filter, and by 1/2 u each on both sides.
        let rounding = 0.5 * self.filter.rounding() + U;
        let constants = vec![
            ("LEAST_VARIANCE", Constant::Float(f64::from(self.deviation).powi(2))),
            ("CUT", Constant::Float(self.cut.into())),
            ("ROUNDING", Constant::Float(rounding)),
        ];
        let format = wgpu::TextureFormat::Rg32Float;
        let encoding = "filter::encoding::variance";
        let mut recipe = Recipe::new(self.filter, encoding, format, "filter::vsm", constants);
        if self.slope_moment {
            recipe.texel = "filter::from_depth_slope";
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

impl TechniqueConfig for Vsm {
    fn build(&self, gpu: &Gpu) -> Result<Box<dyn Technique>, GpuError> {
        Ok(Box::new(self.technique(gpu)?))
    }

    fn set_map_size(&mut self, size: u32) {
        self.map.size = size;
    }

    fn expectation(&self, case: &str) -> Option<Expectation> {
        let bound = Bound::Variance { deviation: self.deviation.into() };
        expectation(&self.map, &self.filter, bound, case)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_out_of_range_are_refused_with_a_fix() {
        assert!(Vsm::default().estimator().is_ok(), "the defaults");
        for config in [
            Vsm { deviation: f32::NAN, ..Vsm::default() },
            Vsm { deviation: -1e-3, ..Vsm::default() },
            Vsm { cut: 1.0, ..Vsm::default() },
            Vsm { filter: Prefilter { radius: 32, ..Prefilter::default() }, ..Vsm::default() },
        ] {
            let refused = config.estimator();
            assert!(matches!(refused, Err(GpuError::Invalid { .. })), "{config:?}");
        }
    }
}

//! What not to do: filter depth, and compare then. Kept so that measurements have something bad to find.

use antumbra_gpu::{Expectation, Gpu, GpuError, Technique, TechniqueConfig};
use antumbra_map::{Estimator, MapConfig, MapTechnique};
use serde::{Deserialize, Serialize};

use crate::expectation::of_level_casters;
use crate::prefilter::{Constant, Prefilter, Recipe, check};
use crate::vsm::U;

/// A blurred depth map (*Real-Time Shadows* 5.1.2): the answer is still 0 or 1, so nothing is smoothed, and every shadow
/// grows by the kernel's radius, since a mean of two depths lies before the farther. For comparison only.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct BlurredDepth {
    /// The shadow map.
    pub map: MapConfig,
    /// The kernel.
    pub filter: Prefilter,
}

/// Blurred depth with a soft comparison (Luft, Deussen 2006), made for the look of watercolours: smooth, and arbitrarily
/// wrong where casters overlap. For comparison, and for that look.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SoftComparison {
    /// The shadow map.
    pub map: MapConfig,
    /// The kernel.
    pub filter: Prefilter,
    /// How far before the receiver the blurred depth leaves it in the dark, share of the depth range, above 0 to 1,
    /// default 0.1 (none is published).
    pub width: f32,
}

impl Default for SoftComparison {
    fn default() -> Self {
        Self { map: MapConfig::default(), filter: Prefilter::default(), width: 0.1 }
    }
}

fn recipe(
    filter: Prefilter,
    estimator: &'static str,
    mut constants: Vec<(&'static str, Constant)>,
) -> Result<Recipe, GpuError> {
    filter.validate()?;
    constants.push(("ROUNDING", Constant::Float(filter.rounding() + U)));
    let format = wgpu::TextureFormat::R32Float;
    Ok(Recipe::new(filter, "filter::encoding::depth", format, estimator, constants))
}

/// Where a blurred depth is as good as a map, nothing being there to be mixed, and of which cases something is known.
fn expected(map: &MapConfig, estimator: &Estimator, case: &str) -> Option<Expectation> {
    // A kernel over one's own plane has the plane's depth for its mean, or a farther one.
    if case == "HC-10 triangles below a texel" {
        return Some(Expectation::Holds { bound: 0.0 });
    }
    of_level_casters(map, estimator, case)
}

impl BlurredDepth {
    fn recipe(&self) -> Result<Recipe, GpuError> {
        recipe(self.filter, "filter::blurred_depth", Vec::new())
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

impl TechniqueConfig for BlurredDepth {
    fn build(&self, gpu: &Gpu) -> Result<Box<dyn Technique>, GpuError> {
        Ok(Box::new(self.technique(gpu)?))
    }

    fn set_map_size(&mut self, size: u32) {
        self.map.size = size;
    }

    fn expectation(&self, case: &str) -> Option<Expectation> {
        expected(&self.map, &self.estimator().ok()?, case)
    }
}

impl SoftComparison {
    fn recipe(&self) -> Result<Recipe, GpuError> {
        check("width", self.width, 1e-6..=1.0, "use more than 0 to 1 of the depth range")?;
        let constants = vec![("WIDTH", Constant::Float(self.width.into()))];
        recipe(self.filter, "filter::soft_comparison", constants)
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

impl TechniqueConfig for SoftComparison {
    fn build(&self, gpu: &Gpu) -> Result<Box<dyn Technique>, GpuError> {
        Ok(Box::new(self.technique(gpu)?))
    }

    fn set_map_size(&mut self, size: u32) {
        self.map.size = size;
    }

    fn expectation(&self, case: &str) -> Option<Expectation> {
        expected(&self.map, &self.estimator().ok()?, case)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_out_of_range_are_refused_with_a_fix() {
        assert!(BlurredDepth::default().estimator().is_ok(), "the defaults");
        assert!(SoftComparison::default().estimator().is_ok(), "the defaults");
        for width in [0.0, -0.1, 2.0, f32::NAN] {
            let config = SoftComparison { width, ..SoftComparison::default() };
            assert!(matches!(config.estimator(), Err(GpuError::Invalid { .. })), "{width}");
        }
        let filter = Prefilter { radius: 32, ..Prefilter::default() };
        assert!(BlurredDepth { filter, ..BlurredDepth::default() }.estimator().is_err(), "radius");
    }
}

//! Single-sample soft shadows by a search of the map.

use antumbra_gpu::{Expectation, Gpu, GpuError, Technique, TechniqueConfig};
use antumbra_map::{Estimator, MapConfig};
use serde::{Deserialize, Serialize};

use crate::pcss::build_by;
use crate::{Facing, Window, expectation};

/// Single-sample soft shadows (Brabec, Seidel 2002): the distance in the map to the nearest texel of which the other is true,
/// hidden or lit, in penumbrae of the occluder there. Exact behind one straight edge; where several occluders count, the
/// nearest alone.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RadialSearch {
    /// The shadow map. In the place of the published object ids, which take away all self-shadowing, texels within the bias
    /// cone hide nothing, here as in any filter.
    pub map: MapConfig,
    /// The search. Every texel of the window is looked at, up to the square of its budget: the published radius is the
    /// window's.
    pub window: Window,
}

impl RadialSearch {
    /// # Errors
    /// A setting out of range.
    fn estimator(&self) -> Result<Estimator, GpuError> {
        self.window.validate()?;
        Ok(self.window.estimator("soft::radial", Vec::new(), "", self.window.budget.pow(2)))
    }
}

impl TechniqueConfig for RadialSearch {
    fn build(&self, gpu: &Gpu) -> Result<Box<dyn Technique>, GpuError> {
        // The nearest lit texel may lie beyond the casters that matter.
        let facing = Facing { hard: self.map.omni, whole: true };
        build_by(gpu, &self.map, facing, self.estimator()?, &self.window)
    }

    fn set_map_size(&mut self, size: u32) {
        self.map.size = size;
    }

    fn expectation(&self, case: &str) -> Option<Expectation> {
        expectation::of_search(&self.map, self.window.reach, case)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn windows_out_of_range_are_refused_with_a_fix() {
        for budget in [0, 3, 129] {
            let window = Window { budget, ..Window::default() };
            let wrong = RadialSearch { window, ..RadialSearch::default() };
            assert!(wrong.estimator().is_err(), "{wrong:?}");
        }
        assert!(RadialSearch::default().estimator().is_ok(), "the defaults");
    }
}

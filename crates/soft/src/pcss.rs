//! Percentage-closer soft shadows.

use antumbra_gpu::{Expectation, Gpu, GpuError, Technique, TechniqueConfig};
use antumbra_map::{Estimator, MapConfig, MapTechnique};
use serde::{Deserialize, Serialize};

use crate::window::Window;
use crate::{Facing, expectation, store::AreaStore};

/// Percentage-closer soft shadows (Fernando 2005): the mean distance of what is nearer than the receiver within the search
/// window says how wide the penumbra is, and so how wide a window to filter.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Pcss {
    /// The shadow map. Texels within the bias cone are no blockers, here as in any filter.
    pub map: MapConfig,
    /// The search for blockers.
    pub window: Window,
    /// Taps of the blocker search, 0 to 256, default 32; 0 looks at every texel of the window. Of blockers that cover the
    /// share c of the window n taps find nothing with a chance of (1 - c)^n. Cost: one fetch each.
    pub search: u32,
    /// Taps of the filter, 0 to 256, default 64; 0 weighs every texel of the window. Cost: one compare each.
    pub filter: u32,
    /// How much less a blocker counts at the border of the search window than at its middle, 0 to 1, default 0, as published:
    /// with 1 the weight falls to none with the square of the distance, so that contacts are not outvoted (Burley 2006).
    pub centre: f32,
    /// A receiver that does not see the light's centre takes the distance of what hides that for the occluder's, and others
    /// search, as fractional discs do (Valient, de Boer 2004); default false, a mean for all. The width of a penumbra
    /// jumps at the hard shadow's edge where occluders lie at several depths.
    pub own: bool,
    /// Turns taps by an angle that differs from pixel to pixel, default true: noise instead of bands.
    pub turn: bool,
}

impl Default for Pcss {
    fn default() -> Self {
        Self {
            map: MapConfig::default(),
            window: Window::default(),
            search: 32,
            filter: 64,
            centre: 0.0,
            own: false,
            turn: true,
        }
    }
}

/// Most taps: more than any frame affords.
const MAX_TAPS: u32 = 256;

impl Pcss {
    /// The estimator, which runs with the store of this crate only.
    ///
    /// # Errors
    /// A setting out of range.
    fn estimator(&self) -> Result<Estimator, GpuError> {
        self.window.validate()?;
        for (what, taps) in [("search", self.search), ("filter", self.filter)] {
            if taps > MAX_TAPS {
                let fix = "use 0 to 256 taps; 0 takes every texel";
                return Err(GpuError::Invalid { what, value: taps.to_string(), fix });
            }
        }
        if !(0.0..=1.0).contains(&self.centre) {
            let (value, fix) = (self.centre.to_string(), "use 0 to 1");
            return Err(GpuError::Invalid { what: "centre", value, fix });
        }
        let constants = format!(
            "const SEARCH: i32 = {};\nconst FILTER: i32 = {};\nconst CENTRE: f32 = {:?};\nconst OWN: bool = {};\nconst TURN: bool = {};\n",
            self.search, self.filter, self.centre, self.own, self.turn,
        );
        let all = self.window.budget.pow(2);
        let fetches = [self.search, self.filter].map(|taps| if taps == 0 { all } else { taps });
        Ok(self.window.estimator("soft::pcss", Vec::new(), &constants, fetches.iter().sum()))
    }
}

impl TechniqueConfig for Pcss {
    fn build(&self, gpu: &Gpu) -> Result<Box<dyn Technique>, GpuError> {
        build(gpu, &self.map, self.estimator()?, &self.window)
    }

    fn set_map_size(&mut self, size: u32) {
        self.map.size = size;
    }

    fn expectation(&self, case: &str) -> Option<Expectation> {
        expectation::expectation(&self.map, case)
    }
}

/// The technique of an estimator of this crate.
pub(crate) fn build(
    gpu: &Gpu,
    map: &MapConfig,
    estimator: Estimator,
    window: &Window,
) -> Result<Box<dyn Technique>, GpuError> {
    let store = Box::new(AreaStore::new(gpu, window)?);
    let arrange = Box::new(Facing { hard: map.omni });
    Ok(Box::new(MapTechnique::arranged_with_store(gpu, map, estimator, arrange, store)?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_out_of_range_are_refused_with_a_fix() {
        let window = |budget| Window { budget, ..Window::default() };
        for wrong in [
            Pcss { search: 257, ..Pcss::default() },
            Pcss { filter: u32::MAX, ..Pcss::default() },
            Pcss { centre: -0.1, ..Pcss::default() },
            Pcss { centre: f32::NAN, ..Pcss::default() },
            Pcss { window: window(3), ..Pcss::default() },
            Pcss { window: window(129), ..Pcss::default() },
        ] {
            assert!(wrong.estimator().is_err(), "{wrong:?}");
        }
        assert!(Pcss::default().estimator().is_ok(), "the defaults");
    }
}

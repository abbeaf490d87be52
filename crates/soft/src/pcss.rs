//! Percentage-closer soft shadows.

use antumbra_gpu::{Expectation, Gpu, GpuError, Technique, TechniqueConfig};
use antumbra_map::{Estimator, MapConfig, MapTechnique};
use serde::{Deserialize, Serialize};

use crate::expectation::{self, Accuracy, HANDED_OVER};
use crate::window::{Window, check_map};
use crate::{Facing, store::AreaStore};

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

/// Share of a rectangle of light that 32 taps of the search may miss, and by how much the share of 64 taps of the filter may be
/// off, behind a rectangle: of Hammersley's points on a torus, as a test finds.
const MISSED: f64 = 3.0 / 32.0;
const COUNTED: f64 = 4.0 / 64.0;

impl Pcss {
    /// The larger of the two, for as many taps as there are.
    fn off(&self, missed: f64, counted: f64) -> f64 {
        let of = |taps: u32, usual: f64, off: f64| {
            if taps == 0 { 0.0 } else { off * usual / f64::from(taps) }
        };
        of(self.search, 32.0, missed).max(of(self.filter, 64.0, counted))
    }

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
        // Behind one plate the search finds its depth, but for shares that all of its taps miss; and the filter counts.
        let off = self.off(MISSED, COUNTED);
        let edge = self.off(0.0, 1.0 / 64.0);
        let accuracy = Accuracy {
            apart: off,
            contact: off,
            edge: 2.0 * edge,
            named: self.window.reach,
            rise: HANDED_OVER,
            ..Accuracy::of(&self.map)
        };
        expectation::over_a_map(&self.map, &accuracy, case)
    }
}

/// The technique of an estimator of this crate.
pub(crate) fn build(
    gpu: &Gpu,
    map: &MapConfig,
    estimator: Estimator,
    window: &Window,
) -> Result<Box<dyn Technique>, GpuError> {
    let facing = Facing { hard: map.omni, whole: false };
    build_by(gpu, map, facing, estimator, window)
}

/// The technique of an estimator of this crate over the views of `facing`.
pub(crate) fn build_by(
    gpu: &Gpu,
    map: &MapConfig,
    facing: Facing,
    estimator: Estimator,
    window: &Window,
) -> Result<Box<dyn Technique>, GpuError> {
    check_map(map, window.hierarchy)?;
    let store = Box::new(AreaStore::new(gpu, window)?);
    let arrange = Box::new(facing);
    Ok(Box::new(MapTechnique::arranged_with_store(gpu, map, estimator, arrange, store)?))
}

#[cfg(test)]
mod tests {
    use antumbra_scene::Light;
    use glam::{DMat4, DVec2, DVec3, DVec4};

    use super::*;
    use crate::twin::View;
    use crate::twin::techniques::tap;

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

    #[test]
    fn taps_count_the_share_behind_a_rectangle_as_well_as_is_said() {
        let light = Light::Rect { center: DVec3::ZERO, half_u: DVec3::X, half_v: DVec3::Y };
        let clip = DMat4::from_cols(DVec4::X, DVec4::Y, DVec4::new(0.0, 0.0, 0.0, -1.0), DVec4::Z);
        let seen = View::new(&clip, 64.0, &light).seen(DVec2::splat(32.0), 0.1);
        // Multiples of the plastic numbers' inverses (Roberts 2018).
        let unit = |i: u32, k: i32| (f64::from(i) * 0.856_674_883_854_503_f64.powi(k)).fract();
        let (mut missed, mut off): (f64, f64) = (0.0, 0.0);
        for turn in 0..200 {
            let noise = f64::from(turn) / 200.0;
            let taps =
                [32, 64].map(|n| (0..n).map(|i| tap(&seen, i, n, noise)).collect::<Vec<_>>());
            for i in 0..300 {
                let side = |k| {
                    let (a, b) = (3.0 * unit(i, k) - 1.5, 3.0 * unit(i, k + 1) - 1.5);
                    (a.min(b).clamp(-1.0, 1.0), a.max(b).clamp(-1.0, 1.0))
                };
                let (x, y) = (side(1), side(3));
                let share = (x.1 - x.0) * (y.1 - y.0) / 4.0;
                let inside = |t: &&DVec2| x.0 <= t.x && t.x < x.1 && y.0 <= t.y && t.y < y.1;
                let [few, many] = [0, 1].map(|k| taps[k].iter().filter(inside).count());
                off = off.max((many as f64 / 64.0 - share).abs());
                missed = missed.max(if few == 0 { share } else { 0.0 });
            }
        }
        assert!(off <= COUNTED && missed <= MISSED, "off by {off}, missed {missed}");
        // The control: no better than it is said to be by more than half.
        assert!(off > 0.5 * COUNTED && missed > 0.5 * MISSED, "off by {off}, missed {missed}");
    }
}

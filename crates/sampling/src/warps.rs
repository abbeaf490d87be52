//! Warped shadow maps: one map, with texels where the eye is near.

use antumbra_gpu::{Expectation, Frame, Gpu, GpuError, Technique, TechniqueConfig};
use antumbra_map::{Arrange, FittedView, Fitting, Layout, Plain, SeenView, Sight};
use antumbra_scene::Light;
use glam::DVec3;
use serde::{Deserialize, Serialize};

use crate::warp_fit::{Shine, pyramid, warped};
use crate::{Eye, Rule, over_map};

/// Light space perspective shadow maps (Wimmer, Scherzer, Purgathofer 2004): the map is warped by a perspective that
/// looks the way the eye does, but from farther off, so that errors near and far are the same.
///
/// Serves directional and spot lights, and each face of a point light's cube. Where the light shines along the view
/// there is nothing to gain, and the map is as without a warp.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Lispsm<E = Plain> {
    /// The technique over the map, by default the plain test.
    pub of: E,
    /// Depth beyond the nearest visible receiver from which on texels matter, metres, >= 0, default 0 (Lloyd 2007).
    /// What is nearer gets larger texels and leaves more to the rest.
    pub near_offset: f64,
    /// Depth before the farthest visible receiver up to which texels matter, metres, >= 0, default 0.
    pub far_offset: f64,
    /// Weakens the warp where the light is aslant (Lloyd 2007), default true.
    pub falloff: bool,
    /// Tries the strengths of a whole range instead of the derived one, default false. Some milliseconds a frame.
    pub search: bool,
    /// Falls back to a weaker warp, or to none, where that needs fewer texels, default true: the published strength
    /// alone needs up to 12 times as many as no warp does, at 8 degrees between light and view and depths of 1 to 1000.
    pub guard: bool,
}

/// Trapezoidal shadow maps (Martin, Tan 2004): the same warp, as strong as it takes to give a part of the view its
/// share of the map.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Tsm<E = Plain> {
    /// The technique over the map, by default the plain test.
    pub of: E,
    /// Share of the map for what is nearer than `focus`, above 0 and below 1, published 0.8.
    pub share: f64,
    /// Share of the view's length, as the light sees it, that is near: above 0 and below 1, default 0.25. (The source
    /// leaves it to the scene.) At `share` and more there is no warp.
    pub focus: f64,
    /// As [`Lispsm::guard`].
    pub guard: bool,
}

/// Perspective shadow maps (Stamminger, Drettakis 2002): the view's own perspective for a warp. Every strip across the
/// view is as wide in the map as on the screen, at the price of few rows for what is far.
///
/// Under light from overhead this is the published map; under other light the published one takes the light into the
/// view's perspective as a point, and this one keeps it parallel.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Psm<E = Plain> {
    /// The technique over the map, by default the plain test.
    pub of: E,
    /// As [`Lispsm::guard`].
    pub guard: bool,
}

impl<E: Default> Default for Lispsm<E> {
    fn default() -> Self {
        Self {
            of: E::default(),
            near_offset: 0.0,
            far_offset: 0.0,
            falloff: true,
            search: false,
            guard: true,
        }
    }
}

impl<E: Default> Default for Tsm<E> {
    fn default() -> Self {
        Self { of: E::default(), share: 0.8, focus: 0.25, guard: true }
    }
}

impl<E: Default> Default for Psm<E> {
    fn default() -> Self {
        Self { of: E::default(), guard: true }
    }
}

impl<E> Lispsm<E> {
    /// Warps what `others` fits.
    ///
    /// # Errors
    /// A setting out of range.
    pub fn arrange(&self, others: Box<dyn Arrange>) -> Result<Box<dyn Arrange>, GpuError> {
        for (what, value) in [("near offset", self.near_offset), ("far offset", self.far_offset)] {
            if !(value >= 0.0 && value.is_finite()) {
                let fix = "use a distance in metres of at least 0";
                return Err(GpuError::Invalid { what, value: value.to_string(), fix });
            }
        }
        let &Self { near_offset, far_offset, falloff, .. } = self;
        let rule = if self.search {
            Rule::Search
        } else {
            Rule::Balanced { near_offset, far_offset, falloff }
        };
        Ok(Box::new(Warping { rule, guard: self.guard || self.search, others }))
    }
}

impl<E> Tsm<E> {
    /// Warps what `others` fits.
    ///
    /// # Errors
    /// A setting out of range.
    pub fn arrange(&self, others: Box<dyn Arrange>) -> Result<Box<dyn Arrange>, GpuError> {
        for (what, value) in [("share of the map", self.share), ("focus", self.focus)] {
            if !(value > 0.0 && value < 1.0) {
                let fix = "use a share above 0 and below 1";
                return Err(GpuError::Invalid { what, value: value.to_string(), fix });
            }
        }
        let rule = Rule::Trapezoid { share: self.share, focus: self.focus };
        Ok(Box::new(Warping { rule, guard: self.guard, others }))
    }
}

impl<E> Psm<E> {
    /// Warps what `others` fits.
    #[must_use]
    pub fn arrange(&self, others: Box<dyn Arrange>) -> Box<dyn Arrange> {
        Box::new(Warping { rule: Rule::Perspective, guard: self.guard, others })
    }
}

impl<E: TechniqueConfig> TechniqueConfig for Lispsm<E> {
    fn build(&self, gpu: &Gpu) -> Result<Box<dyn Technique>, GpuError> {
        over_map(gpu, &self.of, |others| self.arrange(others))
    }

    fn set_map_size(&mut self, size: u32) {
        self.of.set_map_size(size);
    }

    fn expectation(&self, case: &str) -> Option<Expectation> {
        expectation(&self.of, case)
    }
}

impl<E: TechniqueConfig> TechniqueConfig for Tsm<E> {
    fn build(&self, gpu: &Gpu) -> Result<Box<dyn Technique>, GpuError> {
        over_map(gpu, &self.of, |others| self.arrange(others))
    }

    fn set_map_size(&mut self, size: u32) {
        self.of.set_map_size(size);
    }

    fn expectation(&self, case: &str) -> Option<Expectation> {
        expectation(&self.of, case)
    }
}

impl<E: TechniqueConfig> TechniqueConfig for Psm<E> {
    fn build(&self, gpu: &Gpu) -> Result<Box<dyn Technique>, GpuError> {
        over_map(gpu, &self.of, |others| Ok(self.arrange(others)))
    }

    fn set_map_size(&mut self, size: u32) {
        self.of.set_map_size(size);
    }

    fn expectation(&self, case: &str) -> Option<Expectation> {
        expectation(&self.of, case)
    }
}

/// Without a camera a warped map is as the technique's own; with one, texels are counted in pixels, not in metres, so
/// that bounds in metres say nothing.
fn expectation(of: &dyn TechniqueConfig, case: &str) -> Option<Expectation> {
    const IN_METRES: [&str; 6] = [
        "HC-02 in view",
        "HC-23 light at the eye",
        "HC-25 caster out of sight",
        "HC-39 creeping camera",
        // Both judge what is far by texels of a uniform map, which at 200 m and 700 m are finer than warped ones.
        "K11 gap of depths",
        "K17 edge across splits",
    ];
    if IN_METRES.contains(&case) {
        return None;
    }
    of.expectation(case)
}

/// The arrangement of warped maps.
#[derive(Debug)]
struct Warping {
    rule: Rule,
    guard: bool,
    others: Box<dyn Arrange>,
}

impl Warping {
    /// The light's views as they project before they are warped, and the half-spaces of what each may show; in the
    /// order of the layout.
    fn views(light: &Light, hull: &[DVec3], fitting: &Fitting) -> Vec<(Shine, Vec<glam::DVec4>)> {
        let from = |position: DVec3, back: DVec3, tan_limit: f64| {
            let position = position - fitting.origin;
            (Shine::From { position, back }, pyramid(position, back, tan_limit))
        };
        match *light {
            Light::Directional { direction, .. } => {
                let to_light = -direction.normalize();
                let along = hull.iter().map(|p| to_light.dot(*p - fitting.origin));
                let (lo, hi) = along
                    .fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), v| (lo.min(v), hi.max(v)));
                // As of a map that is not warped: beyond all casters, by more than rounding.
                let farthest = hull.iter().map(|p| p.distance(fitting.origin)).fold(0.0, f64::max);
                let pad = (hi - lo) * 2f64.powi(-12) + farthest.max(hi - lo) * 2f64.powi(-20);
                let pad = pad.max(f64::from(f32::MIN_POSITIVE));
                vec![(Shine::Parallel { to_light, depths: (hi + pad, lo - pad) }, Vec::new())]
            }
            Light::Spot { position, direction, outer_angle } => {
                vec![from(position, -direction.normalize(), outer_angle.tan())]
            }
            _ => {
                let center = light.position().unwrap_or(fitting.origin);
                [DVec3::X, -DVec3::X, DVec3::Y, -DVec3::Y, DVec3::Z, -DVec3::Z]
                    .map(|axis| from(center, -axis, 1.0))
                    .to_vec()
            }
        }
    }
}

impl Arrange for Warping {
    fn layout(&self, light: &Light) -> Layout {
        self.others.layout(light)
    }

    fn fit(
        &self,
        frame: &Frame<'_>,
        hull: &[DVec3],
        sight: Option<&Sight<'_>>,
        fitting: &Fitting,
    ) -> Result<Vec<SeenView>, GpuError> {
        let light = frame.light;
        let mut fitted = self.others.fit(frame, hull, sight, fitting)?;
        let eye = frame.camera.as_ref().and_then(Eye::new);
        // Only views that a matrix gives, one a direction, can be warped.
        let known = self.others.layout(light) == Layout::of(light) && fitting.usable() >= 1.0;
        let Some((eye, sight)) = eye.zip(sight).filter(|_| known && !hull.is_empty()) else {
            return Ok(fitted);
        };
        let views = Self::views(light, hull, fitting);
        for (uniform, (shine, cone)) in fitted.iter_mut().zip(views) {
            let Some(clip) = uniform.view.clip else { continue };
            let warped = warped(light, shine, &cone, &eye, sight, fitting, &self.rule, self.guard);
            if let Some(warped) = warped.filter(|w| !self.guard || w.is_better_than(&clip)) {
                let view = FittedView { clip: Some(warped.clip), ..uniform.view };
                *uniform = SeenView { view, volume: warped.volume, ends: None };
            }
        }
        Ok(fitted)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_out_of_range_are_refused_with_a_fix() {
        let others = || Box::new(antumbra_map::Omni::Cube);
        let (lispsm, tsm) = (Lispsm::<Plain>::default(), Tsm::<Plain>::default());
        assert!(lispsm.arrange(others()).is_ok() && tsm.arrange(others()).is_ok(), "the defaults");
        for config in [
            Lispsm { near_offset: -1.0, ..lispsm },
            Lispsm { far_offset: f64::NAN, ..lispsm },
            Lispsm { near_offset: f64::INFINITY, ..lispsm },
        ] {
            let refused = config.arrange(others());
            assert!(matches!(refused, Err(GpuError::Invalid { .. })), "{config:?}");
        }
        for config in [
            Tsm { share: 0.0, ..tsm },
            Tsm { share: 1.0, ..tsm },
            Tsm { focus: f64::NAN, ..tsm },
            Tsm { focus: 1.5, ..tsm },
        ] {
            let refused = config.arrange(others());
            assert!(matches!(refused, Err(GpuError::Invalid { .. })), "{config:?}");
        }
    }
}

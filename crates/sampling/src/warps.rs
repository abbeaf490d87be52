//! Warped shadow maps: one map, with texels where the eye is near.

use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, SQRT_2};

use antumbra_gpu::{Expectation, Frame, Gpu, GpuError, Technique, TechniqueConfig};
use antumbra_map::{Arrange, FittedView, Fitting, Layout, Plain, SeenView, Sight};
use antumbra_scene::Light;
use glam::DVec3;
use serde::{Deserialize, Serialize};

use crate::warp_fit::{Shine, pyramid, warped};
use crate::{Eye, Line, Rule, over_map};

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
        Ok(Box::new(Warping { rule: self.rule(), guard: self.guard || self.search, others }))
    }

    fn rule(&self) -> Rule {
        let &Self { near_offset, far_offset, falloff, .. } = self;
        if self.search { Rule::Search } else { Rule::Balanced { near_offset, far_offset, falloff } }
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
        Ok(Box::new(Warping { rule: self.rule(), guard: self.guard, others }))
    }

    fn rule(&self) -> Rule {
        Rule::Trapezoid { share: self.share, focus: self.focus }
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
        expectation(&self.rule(), &self.of, case)
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
        expectation(&self.rule(), &self.of, case)
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
        expectation(&Rule::Perspective, &self.of, case)
    }
}

/// Nearest and farthest depth that is seen, metres, in the cases that count texels of a map over all casters and have a
/// camera.
fn seen(case: &str) -> Option<(f64, f64)> {
    Some(match case {
        // From the near plane to the floor, straight below.
        "HC-02 in view" | "HC-25 caster out of sight" => (0.1, 5.0),
        "HC-23 light at the eye"
        | "HC-23 lamp at the eye, in view"
        | "HC-23 light in the near plane" => (0.1, 6.0),
        "HC-17 beyond the far plane" => (0.1, 50.0),
        "HC-39 creeping camera" => (10.0, 12.0),
        // From 4.5 m above the floor, at 45 degrees; casters are lower than 2 m.
        "HC-19 three and four triangles on an edge"
        | "HC-20 winding without a side"
        | "HC-22 vertex on an edge" => (3.0, 20.0),
        "K1 plates of one size" | "K2 tilted suns" => (1.0, 120.0),
        "K4 facing wall" => (1.0, 20.0),
        "K4 side wall" | "K16 pile-up" => (1.0, 100.0),
        "K6 skyline" => (1.0, 920.0),
        "K11 gap of depths" => (1.0, 1000.0),
        "K17 edge across splits" => (1.0, 250.0),
        "K19 odd triangles" => (2.0, 14.0),
        "K20 long horizon" => (0.1, 10_000.0),
        _ => return None,
    })
}

/// What holds of a technique over a map, `of`, over a warped one. Without a camera that is the same.
///
/// A warp of strength e makes texels at its far end longer than those of an even map by 1 + e, and none more than that; the
/// map is turned after the eye, so that boxes of casters are wider in it, by the square root of 2 at most. The strength that
/// a rule gives is greatest across the light, and the guard takes a weaker one.
fn expectation(rule: &Rule, of: &dyn TechniqueConfig, case: &str) -> Option<Expectation> {
    let Some(ends) = seen(case) else { return of.expectation(case) };
    let line = Line { ends, seen: ends, tilt: FRAC_PI_2, half_fov: FRAC_PI_4 };
    let stretch = SQRT_2 * (1.0 + rule.strength(&line));
    // Windows that follow the camera move as those that turn with it: texels are others in each frame.
    let moving = case == "HC-39 creeping camera";
    let of = of.expectation(if moving { "K15 turning camera" } else { case })?;
    Some(match of {
        Expectation::Holds { bound } => Expectation::Holds { bound: bound * stretch },
        Expectation::KnownLimit { at_least, at_most, because } => {
            Expectation::KnownLimit { at_least, at_most: at_most * stretch, because }
        }
        refused @ Expectation::Refuses { .. } => refused,
    })
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

//! How strongly to warp a map.
//!
//! A perspective warp takes the place `x` along the map, 0 at its near side and 1 at its far one, to
//! t(x) = (1 + e) x / (1 + e x), and makes the map 1 + e x times as wide there. Its *strength* e is the map's length
//! over the distance n of the centre of projection, which the literature gives: e = 0 is the uniform map exactly,
//! nothing is infinite, and no small difference of large numbers is taken.

use serde::{Deserialize, Serialize};

/// What a rule for the strength goes by.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Line {
    /// Depths, from the eye, at the map's near and far side along a line through the nearest receiver, parallel to the
    /// map (Wimmer, Scherzer, Purgathofer 2004, as corrected by Scherzer 2005), metres.
    pub ends: (f64, f64),
    /// Depths of the nearest and the farthest visible receiver, metres.
    pub seen: (f64, f64),
    /// Angle between the view axis and the light's direction or its opposite, whichever is less, radians.
    pub tilt: f64,
    /// Half the vertical field of view, radians.
    pub half_fov: f64,
}

/// A rule for the strength of a warp.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "by", rename_all = "kebab-case", deny_unknown_fields)]
pub enum Rule {
    /// The error along the map is the same at both ends of the line (Wimmer, Scherzer, Purgathofer 2004).
    Balanced {
        /// Depth beyond the nearest receiver from which on the error counts, metres, >= 0.
        near_offset: f64,
        /// Depth before the farthest receiver up to which it counts, metres, >= 0.
        far_offset: f64,
        /// Less where the light is aslant (Lloyd 2007).
        falloff: bool,
    },
    /// A place of the view gets its share of the map (Martin, Tan 2004).
    Trapezoid {
        /// Share of the map before that place, in (0, 1).
        share: f64,
        /// The place, as a share of the view's length as the light sees it, in (0, 1).
        focus: f64,
    },
    /// The view's own perspective (Stamminger, Drettakis 2002).
    Perspective,
    /// Whatever needs the fewest texels, by trial (Lloyd 2007).
    Search,
}

impl Default for Rule {
    fn default() -> Self {
        Self::Balanced { near_offset: 0.0, far_offset: 0.0, falloff: true }
    }
}

/// Strengths tried by [`Rule::Search`].
const TRIALS: u32 = 48;

impl Rule {
    /// The rule's strength, finite and >= 0; for [`Rule::Search`] the view's own, the strongest that is tried.
    #[must_use]
    pub fn strength(&self, line: &Line) -> f64 {
        let (z0, z1) = line.ends;
        if !(z0 > 0.0 && z1 > z0 && z1.is_finite()) {
            return 0.0;
        }
        let own = (z1 - z0) / z0;
        match *self {
            Self::Balanced { near_offset, far_offset, falloff } => {
                let strength = balanced(line, near_offset, far_offset);
                if falloff {
                    strength * (1.0 + shaping(line.tilt, line.half_fov))
                } else {
                    strength
                }
            }
            Self::Trapezoid { share, focus } => {
                ((share - focus) / ((1.0 - share) * focus)).clamp(0.0, own)
            }
            Self::Perspective | Self::Search => own,
        }
    }

    /// The strengths to choose from where none may be worse than no warp.
    pub(crate) fn trials(&self, line: &Line) -> Vec<f64> {
        let strength = self.strength(line);
        match self {
            Self::Search => {
                // Evenly by ratio, from what changes no texel by more than a thousandth.
                let step = |i: u32| 1e-3 * (strength / 1e-3).powf(f64::from(i) / f64::from(TRIALS));
                (0..=TRIALS).map(step).filter(|e| *e <= strength).chain([0.0]).collect()
            }
            _ => [1.0, 0.5, 0.25, 0.125, 0.0].map(|share| strength * share).to_vec(),
        }
    }
}

/// The strength with equal errors at the ends of the depths from `near_offset` beyond the nearest to `far_offset`
/// before the farthest (Lloyd 2007, 5.1.8, 5.1.9): e = (z1 - z0) / (z0 + sqrt(zp zq)), which for no offsets is
/// sqrt(z1 / z0) - 1.
///
/// Once the offset is large this is no longer the least: then n = offset / (2 - 3 offset / length), and beyond two
/// thirds of the length no warp is better than any.
fn balanced(line: &Line, near_offset: f64, far_offset: f64) -> f64 {
    let (z0, z1) = line.ends;
    let (near, far) = line.seen;
    let from = (near + near_offset).max(z0);
    let to = (far - far_offset).min(z1).max(from);
    let length = far - near;
    if near_offset > 0.0 && 3.0 * near_offset >= 2.0 * length {
        return 0.0;
    }
    let late =
        if near_offset > 0.0 { near_offset / (2.0 - 3.0 * near_offset / length) } else { 0.0 };
    (z1 - z0) / (z0 + (from * to).sqrt()).max(late)
}

/// The shaping parameter of Lloyd (2007, 5.1.2.1): -1 is no warp, 0 the balanced one.
///
/// Up to a third of half the field of view from the view axis there is nothing to gain; a view whose side is parallel
/// to the light, at half the field of view, takes little.
fn shaping(tilt: f64, half_fov: f64) -> f64 {
    const AT_SIDE: f64 = -0.2;
    let right = std::f64::consts::FRAC_PI_2;
    let (a, b) = (half_fov / 3.0, half_fov);
    let c = b + 0.3 * (right - b);
    if tilt < a {
        -1.0
    } else if tilt < b {
        -1.0 + (AT_SIDE + 1.0) * (tilt - a) / (b - a)
    } else if tilt < c {
        AT_SIDE - AT_SIDE * (right * (tilt - b) / (c - b)).sin()
    } else {
        0.0
    }
}

/// The place t, in [0, 1], that a warp of strength `e` gives to `x`.
#[must_use]
pub fn warp(e: f64, x: f64) -> f64 {
    (1.0 + e) * x / (1.0 + e * x)
}

/// The inverse of [`warp`].
#[must_use]
pub fn unwarp(e: f64, t: f64) -> f64 {
    t / ((1.0 + e) - e * t)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Light from overhead.
    fn overhead(near: f64, far: f64) -> Line {
        let tilt = std::f64::consts::FRAC_PI_2;
        Line { ends: (near, far), seen: (near, far), tilt, half_fov: 0.5_f64.atan() }
    }

    fn rule(near_offset: f64) -> Rule {
        Rule::Balanced { near_offset, far_offset: 0.0, falloff: true }
    }

    #[test]
    fn the_balanced_strength_is_the_published_one() {
        // n = z_n + sqrt(z_n z_f) = 4.16228, 11, 32.6228, 10.1 of lengths 9, 99, 999, 999.9.
        for (near, far, n, strength) in [
            (1.0, 10.0, 4.16228, 2.16228),
            (1.0, 100.0, 11.0, 9.0),
            (1.0, 1000.0, 32.6228, 30.6228),
            (0.1, 1000.0, 10.1, 99.0),
        ] {
            let e = Rule::default().strength(&overhead(near, far));
            assert!((e / strength - 1.0).abs() < 1e-5, "{e}, not {strength}");
            assert!(((far - near) / e / n - 1.0).abs() < 1e-5, "the centre of projection");
        }
    }

    /// The storage factor over the depths from `from`, of a view as wide as it is far, under light from overhead.
    fn storage(e: f64, near: f64, far: f64, from: f64) -> f64 {
        let (length, steps) = (far - near, 20_000);
        let (mut s, mut t) = (0.0_f64, 0.0_f64);
        // Must hold both ends.
        let first = near.max(far / (1.0 + e));
        for i in 0..=steps {
            let z = from + (far - from) * f64::from(i) / f64::from(steps);
            let w = 1.0 + e * (z - near) / length;
            t = t.max(length * w * w / (1.0 + e) / z);
            s = s.max(first * w / z);
        }
        s * t
    }

    #[test]
    fn a_pseudo_near_plane_needs_the_texels_it_was_derived_for() {
        for (offset, least, n) in [
            (2.0, 36.60, f64::NAN),
            (9.0, 12.63, f64::NAN),
            (30.0, 4.884, f64::NAN),
            (50.0, 3.244, 103.1),
            (65.0, 2.271, 2145.0),
        ] {
            let e = rule(offset).strength(&overhead(1.0, 100.0));
            let s = storage(e, 1.0, 100.0, 1.0 + offset);
            assert!((s / least - 1.0).abs() < 1e-3, "offset {offset}: {s}, not {least}");
            assert!(
                n.is_nan() || (99.0 / e / n - 1.0).abs() < 1e-3,
                "offset {offset}: {}",
                99.0 / e
            );
        }
        assert_eq!(rule(66.1).strength(&overhead(1.0, 100.0)), 0.0, "two thirds of the length");
    }

    #[test]
    fn the_trapezoid_puts_its_focus_where_it_is_asked_to() {
        let trapezoid = Rule::Trapezoid { share: 0.8, focus: 0.25 };
        let e = trapezoid.strength(&overhead(1.0, 1000.0));
        assert!((warp(e, 0.25) - 0.8).abs() < 1e-12, "{e}");
        // Martin and Tan's distance of the centre, with their xi = -0.6.
        let (length, focus, xi) = (1.0, 0.25, -0.6);
        let n = length * focus * (1.0 + xi) / (length - 2.0 * focus - length * xi);
        assert!((1.0 / e - n).abs() < 1e-12, "{} for {n}", 1.0 / e);
        let beyond = Rule::Trapezoid { share: 0.8, focus: 0.9 };
        assert_eq!(beyond.strength(&overhead(1.0, 1000.0)), 0.0, "a focus beyond its share");
        let narrow = Rule::Trapezoid { share: 0.8, focus: 1e-9 };
        assert_eq!(narrow.strength(&overhead(1.0, 3.0)), 2.0, "no stronger than the view's own");
    }

    #[test]
    fn the_falloff_has_its_published_corners() {
        let half = 30_f64.to_radians();
        let at = |degrees: f64| shaping(degrees.to_radians(), half);
        assert_eq!(at(9.9), -1.0, "none up to a third of half the field of view");
        assert!((at(30.0) + 0.2).abs() < 1e-9 && (at(29.999) + 0.2).abs() < 1e-3, "the side");
        assert!(at(48.0).abs() < 1e-9 && at(47.99) < 0.0 && at(90.0) == 0.0, "in full");
    }

    proptest! {
        #[test]
        fn the_warp_is_monotone_and_unwarps(e in 0.0..1e5f64, x in 0.0..1.0f64, y in 0.0..1.0f64) {
            prop_assert!((unwarp(e, warp(e, x)) - x).abs() < 1e-9);
            prop_assert!((warp(e, x) < warp(e, y)) == (x < y) || (x - y).abs() < 1e-12);
            prop_assert_eq!((warp(e, 0.0), warp(0.0, x)), (0.0, x));
            prop_assert!((warp(e, 1.0) - 1.0).abs() < 1e-15);
        }

        #[test]
        fn strengths_are_finite_and_balance_the_ends(
            near in 1e-3..1e3f64, ratio in 1.0..1e6f64, tilt in 0.0..1.6f64,
        ) {
            let line = Line { tilt, ..overhead(near, near * ratio) };
            let rules = [Rule::default(), rule(near), Rule::Trapezoid { share: 0.8, focus: 0.25 },
                Rule::Perspective, Rule::Search];
            for rule in rules {
                for e in rule.trials(&line) {
                    prop_assert!(e >= 0.0 && e.is_finite(), "{:?}: {}", rule, e);
                }
            }
            let even = Rule::Balanced { near_offset: 0.0, far_offset: 0.0, falloff: false };
            let e = even.strength(&line);
            // (1 + e x)^2 / z at both ends.
            let (first, last) = (1.0 / near, (1.0 + e) * (1.0 + e) / (near * ratio));
            prop_assert!((first / last - 1.0).abs() < 1e-9);
        }
    }

    #[test]
    fn lines_that_lead_nowhere_are_not_warped() {
        for ends in
            [(1.0, 1.0), (2.0, 1.0), (0.0, 1.0), (-1.0, 5.0), (f64::NAN, 1.0), (1.0, f64::INFINITY)]
        {
            let line = Line { ends, ..overhead(1.0, 2.0) };
            for rule in [Rule::default(), Rule::Perspective, Rule::Search] {
                assert_eq!(rule.strength(&line), 0.0, "{rule:?} along {ends:?}");
            }
        }
    }
}

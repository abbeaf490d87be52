//! What theory says of shadow volumes on each hard case.
//!
//! The cases and their numbers are those of `antumbra_measure::stability::CASES`; a case is right at 0.

use antumbra_gpu::Expectation;
use antumbra_gpu::Expectation::{Holds, KnownLimit, Refuses};

use crate::Counter;

/// Volumes that are not drawn but asked: right to within rounding on all cases.
pub(crate) fn triangle(case: &str) -> Option<Expectation> {
    Some(match case {
        // An edge is where it is to within rounding of positions: 1e-6 of 20 m, and a map of 4096 texels over 2 m has
        // 2000 a metre.
        "HC-01 A, point light"
        | "HC-01 B, sun overhead"
        | "HC-01 C, slanting sun"
        | "HC-01 B, turned 30 degrees"
        | "HC-02 light amid the caster" => Holds { bound: 0.05 },
        "HC-04 thin wall" | "HC-05 cube" => Holds { bound: 0.05 },
        _ if is_odd(case).is_some() => Holds { bound: 0.05 },
        _ => return is_seen(case).or_else(|| is_given(case)).map(|_| Holds { bound: 0.0 }),
    })
}

/// The cases whose samples a camera sees.
fn is_seen(case: &str) -> Option<()> {
    matches!(
        case,
        "lone receivers, directional"
            | "lone receivers, spot"
            | "lone receivers, point"
            | "HC-03 grazing plane"
            | "HC-03 grazing plane, diagonal"
            | "HC-14 far from the origin"
            | "HC-15 eye in shadow"
            | "HC-16 boundary near the eye"
            | "HC-16 boundary through the eye"
            | "HC-17 beyond the far plane"
            | "HC-18 sheets"
            | "HC-18 256 sheets"
            | "HC-21 light in the plane"
            | "HC-23 lamp at the eye, in view"
            | "HC-23 light in the near plane"
            | "HC-24 lamp in a cube, in view"
            | "HC-24 light at a corner"
            | "HC-25 caster not seen"
    )
    .then_some(())
}

/// The cases of odd topology, which a camera sees too: how far from the shadow's edge anything is wrong.
fn is_odd(case: &str) -> Option<()> {
    matches!(
        case,
        "HC-19 three and four triangles on an edge"
            | "HC-20 winding without a side"
            | "HC-22 vertex on an edge"
    )
    .then_some(())
}

/// The cases whose samples are points without a camera.
fn is_given(case: &str) -> Option<()> {
    matches!(
        case,
        "HC-01 A, point light"
            | "HC-01 B, sun overhead"
            | "HC-01 C, slanting sun"
            | "HC-01 B, turned 30 degrees"
            | "HC-02 light amid the caster"
            | "HC-04 thin wall"
            | "HC-05 cube"
            | "HC-13 depth precision"
            | "HC-13 depth precision, near caster"
            | "HC-31 wire below a texel"
            | "HC-40 casters out of view"
    )
    .then_some(())
}

/// Volumes counted behind the sample.
pub(crate) fn z_fail(counter: Counter, case: &str) -> Option<Expectation> {
    if is_given(case).is_some() {
        return Some(Refuses { because: "the case's samples are points that no camera sees" });
    }
    if is_odd(case).is_some() {
        // Snapping moves edges by sqrt(2) / 256 pixel. Of 256 pixels over 45 degrees, 12 m off and seen at 15 degrees, one
        // is 0.15 m of floor, which makes 0.9 mm; and a map of 1024 texels over 2 m has one every 2 mm.
        return Some(Holds { bound: 0.5 });
    }
    is_seen(case)?;
    Some(match (case, counter) {
        ("HC-18 256 sheets", Counter::Stencil) => {
            shares_of_dark("a stencil of 8 bits counts modulo 256: 256 volumes are as none")
        }
        _ => Holds { bound: 0.0 },
    })
}

/// All that should be dark is lit, which is a part of the picture.
fn shares_of_dark(because: &'static str) -> Expectation {
    KnownLimit { at_least: 0.02, at_most: 0.9, because }
}

/// Volumes counted in front of the sample from 0.
pub(crate) fn z_pass(counter: Counter, near_caps: bool, case: &str) -> Option<Expectation> {
    let all = |because| KnownLimit { at_least: 1.0, at_most: 1.0, because };
    Some(match case {
        "HC-15 eye in shadow" | "HC-16 boundary near the eye" | "HC-24 lamp in a cube, in view" => {
            all("the eye is in a volume, and all counts are one too low")
        }
        "HC-16 boundary through the eye" => boundary(),
        "HC-25 caster not seen" if !near_caps => {
            shares_of_dark("lines of sight enter the volume through the caster, which is not drawn")
        }
        _ => return z_fail(counter, case),
    })
}

fn boundary() -> Expectation {
    KnownLimit {
        at_least: 0.2,
        at_most: 0.8,
        because: "with the eye in the plane of a volume's side one number cannot serve both halves of the picture",
    }
}

/// Volumes counted in front of the sample from the eye's own count.
pub(crate) fn eye_counter(counter: Counter, case: &str) -> Option<Expectation> {
    Some(match case {
        "HC-16 boundary through the eye" => boundary(),
        _ => return z_fail(counter, case),
    })
}

/// Volumes counted in front of the sample from the near plane's counts.
pub(crate) fn zp_plus(counter: Counter, case: &str) -> Option<Expectation> {
    z_fail(counter, case)
}

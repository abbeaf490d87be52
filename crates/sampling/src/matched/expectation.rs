//! What theory says of resolution-matched pages on each hard case.
//!
//! The cases and their numbers are those of `antumbra_measure::stability::CASES`; a case is right at 0.

use antumbra_gpu::Expectation;
use antumbra_gpu::Expectation::{Holds, KnownLimit};
use antumbra_map::Estimator;

use super::ResolutionMatched;

/// Where samples are points without a camera, all ask for the finest level and become coarser until they fit: at worst to
/// the resolution of a plain map of the atlas's size. So what holds of that holds here, and of other lights, which such a
/// map serves. Where a camera looks, a texel may be as large as a pixel.
pub(super) fn matched(config: &ResolutionMatched, case: &str) -> Option<Expectation> {
    let map = config.layout().ok()?;
    let plain = antumbra_map::expectation(&config.map, &Estimator::nearest(), case);
    let size = f64::from(config.map.size);
    // Texels a side of the finest level.
    let finest = f64::from(map.page * map.table);
    Some(match case {
        "HC-19 three and four triangles on an edge" => Holds { bound: as_seen(plain?, 6.0, size) },
        "HC-20 winding without a side" => Holds { bound: as_seen(plain?, 7.2, size) },
        "HC-22 vertex on an edge" => Holds { bound: as_seen(plain?, 2.0, size) },
        // What is looked at lies under the wire, so that the pages of it fit. Once the wire, 0.4 texels of a plain map
        // at 30 degrees to the rows, is wider than a texel is across it, some texel's centre lies in it everywhere.
        "HC-31 wire below a texel"
            if 0.4 * 22.5_f64.to_radians().cos() * finest / size
                > 30_f64.to_radians().sin() + 30_f64.to_radians().cos() =>
        {
            Holds { bound: 0.0 }
        }
        // As much as the camera moves a frame, 3 mm an axis, and a step of the window more, which is 14 m wide and
        // fitted in steps of 9 %, edges move: of a floor with 6 m of outline in every 9 m^2. Twice that for which points
        // lie in so narrow a strip, of 2^14.
        "HC-39 creeping camera" => KnownLimit {
            at_least: 14.0 / finest / 3.0,
            at_most: 2.0
                * (6.0 / 9.0 * std::f64::consts::SQRT_2 * (0.003 + 16.0 / finest) + 2f64.powi(-14)),
            because: "the window moves in whole texels of the finest level, and so those of coarser levels by a part \
                      of theirs",
        },
        _ => return antumbra_map::without_holes(case).or(plain),
    })
}

/// How far off a sample may be in the views of bodies over a floor, texels of a map of `size` over `width` metres of
/// casters, given how far it may be where texels are those of the plain map.
///
/// A pixel of the 256 x 256 under 45 degrees, with the eye 4.5 m above the floor, covers there the area (2 tan 22.5° / 256)^2
/// d^3 / 4.5 m, d being the depth: at 1.2 m behind the middle, where shadows end, 8.92 m. A texel covers no more. Where the
/// atlas has no room for that, it has for the finest requests at the plain map's resolution; and those from
/// 5 m on, where the view begins, to 8.92 m lie within two levels.
fn as_seen(plain: Expectation, width: f64, size: f64) -> f64 {
    let bound = match plain {
        Holds { bound } => bound,
        _ => f64::INFINITY,
    };
    let side = 2.0 * 22.5_f64.to_radians().tan() / 256.0;
    let pixel = side * (8.92_f64.powi(3) / 4.5).sqrt();
    bound * (pixel / (width / size)).max(4.0)
}

//! What theory says of resolution-matched pages on each hard case.
//!
//! The cases and their numbers are those of `antumbra_measure::stability::CASES`; a case is right at 0.

use antumbra_gpu::Expectation;
use antumbra_gpu::Expectation::Holds;

use super::{ResolutionMatched, window};

/// What holds of a technique over a plain map, `of`, over pages in an atlas of `size` texels a side, where that is known.
///
/// Where samples are points without a camera, all ask for the finest level and become coarser until they fit: at worst to
/// the resolution of a map of the atlas's size, less borders, over a window that is wider by so much as windows are that
/// stand still.
pub(super) fn matched(
    config: &ResolutionMatched<()>,
    size: Option<u32>,
    of: Option<Expectation>,
    case: &str,
) -> Option<Expectation> {
    // Of the finest level, at least: borders take no more than a quarter of a page's side.
    let finest =
        0.75 * f64::from(config.page.min(size.unwrap_or(256) / 16)) * f64::from(config.table);
    let coarser = window::share(finest) / 0.75;
    Some(match case {
        "HC-01 B, sun overhead"
        | "HC-01 C, slanting sun"
        | "HC-01 B, turned 30 degrees"
        | "HC-04 thin wall"
        | "HC-05 cube"
        | "HC-25 caster out of sight" => Holds { bound: coarser * bound(of?) },
        "HC-19 three and four triangles on an edge"
        | "HC-20 winding without a side"
        | "HC-22 vertex on an edge" => {
            let width = match case {
                "HC-19 three and four triangles on an edge" => 6.0,
                "HC-20 winding without a side" => 7.2,
                _ => 2.0,
            };
            let displacement = f64::from(config.displacement);
            Holds { bound: as_seen(bound(of?) * coarser, displacement, width / f64::from(size?)) }
        }
        "HC-17 beyond the far plane"
        | "HC-23 lamp at the eye, in view"
        | "HC-23 light in the near plane"
        | "K1 plates of one size"
        | "K2 tilted suns"
        | "K4 facing wall"
        | "K4 side wall"
        | "K6 skyline"
        | "K11 gap of depths"
        | "K16 pile-up"
        | "K17 edge across splits"
        | "K19 odd triangles"
        | "K20 long horizon" => {
            let (pixel, side) = longest_pixel(case)?;
            let displaced = (f64::from(config.displacement) + 1.0 / 128.0) * pixel;
            Holds { bound: (displaced / (side / f64::from(size?))).max(bound(of?) * coarser) }
        }
        // Points without a camera ask for the finest level, and pages become coarser one after another until they fit: those at
        // the seams may have texels twice as large as those elsewhere, or the other way round.
        "HC-11 seams of a cube"
        | "HC-11 seams of a tetrahedron"
        | "HC-11 seams of an isocube"
        | "HC-11 seams of a paraboloid" => Holds { bound: 2.0 * (1.0 + bound(of?)) - 1.0 },
        // What is looked at lies under the wire, of whose pages the atlas holds those of the second finest level. Once
        // the wire, 0.4 texels of a plain map at 30 degrees to the rows, is wider than a texel is across it, some texel's
        // centre lies in it everywhere.
        "HC-31 wire below a texel"
            if 0.4 * 22.5_f64.to_radians().cos() * 0.5 * finest / coarser / f64::from(size?)
                > 30_f64.to_radians().sin() + 30_f64.to_radians().cos() =>
        {
            Holds { bound: 0.0 }
        }
        "HC-31 wire below a texel" => return None,
        // The window knows nothing of the camera, which looks straight down: every sample keeps its level, too.
        "HC-39 creeping camera" => Holds { bound: 0.0 },
        // A face of a cube is not fitted to the caster. Of the level at which a square's pages fit into the 8 x 8 or more of
        // the atlas, two a side are wasted at the square's border, and levels come in steps of two.
        "HC-01 A, point light" | "HC-23 light at the eye" => {
            Holds { bound: bound(of?) / (0.75 * 0.5 * (1.0 - 2.0 / 8.0)) }
        }
        // Of six faces of M x M pages the atlas holds all for 6 M^2 of its number, in steps of two, less borders: texels of
        // 2 / M sides, where 1 is a face's half width. That is 3 m of the triangle at most, and an ideal texel 2 m of it
        // over the map's side.
        "HC-02 light amid the caster" | "HC-02 in view" => {
            Holds { bound: bound(of?) * 2.0 * 6f64.sqrt() / (0.75 * 0.5) * 3.0 / 2.0 }
        }
        _ => return antumbra_map::without_holes(case).or(of),
    })
}

/// The longest side of what a pixel sees of a receiver, and the side of the map that the case counts texels of, metres.
///
/// Of 128 rows over an angle of 2 a, one at a depth z is 2 tan a / 128 of z wide, and on a floor or a wall h beside the eye
/// z / h as long.
fn longest_pixel(case: &str) -> Option<(f64, f64)> {
    let beside = |z: f64, h: f64, tan: f64| 2.0 * tan / 128.0 * z * z / h;
    Some(match case {
        // Of 64 rows: over 15 degrees, 49 m off, and straight down from 6 m.
        "HC-17 beyond the far plane" => (2.0 * 7.5_f64.to_radians().tan() / 64.0 * 49.0, 8.5),
        "HC-23 lamp at the eye, in view" | "HC-23 light in the near plane" => (12.0 / 64.0, 3.0),
        "K1 plates of one size" => (beside(98.0, 1.7, 0.5), 89.8),
        "K2 tilted suns" => (beside(98.0, 1.7, 0.5), 45.9),
        "K4 facing wall" => (20.0 / 128.0, 20.0),
        "K4 side wall" => (beside(100.0, 2.0, 0.5), 99.0),
        "K6 skyline" => (20.0 / 128.0, 920.0),
        "K11 gap of depths" => (beside(800.0, 60.0, 1.0), 900.0),
        "K16 pile-up" => (beside(100.0, 1.7, 0.5), 99.0),
        "K17 edge across splits" => (beside(250.0, 1.7, 0.5), 210.0),
        "K19 odd triangles" => (beside(9.0, 6.0, 1.0), 3.0),
        // The last row that ends on the floor sees it at 435 m.
        "K20 long horizon" => (435.0, 8400.0),
        _ => return None,
    })
}

fn bound(expectation: Expectation) -> f64 {
    match expectation {
        Holds { bound } => bound,
        _ => f64::INFINITY,
    }
}

/// How far off a sample may be in the views of bodies over a floor, texels of `texel` metres, given how far it may be
/// where the window's texels are those of a plain map.
///
/// A pixel of the 256 x 256 under 45 degrees, with the eye 4.5 m above the floor, is there no longer than 2 tan 22.5° / 256
/// times d^2 / 4.5 m, d being the depth: at 1.2 m behind the middle, where shadows end, 8.92 m. Edges are displaced by a
/// part of it, and by what the rasteriser moves them. Where the atlas has no room for that, it has for all levels from half
/// of the plain map's resolution on, which take a quarter of it and, above, less than a third of that.
fn as_seen(plain: f64, displacement: f64, texel: f64) -> f64 {
    let side = 2.0 * 22.5_f64.to_radians().tan() / 256.0;
    let pixel = side * 8.92_f64.powi(2) / 4.5;
    ((displacement + 1.0 / 128.0) * pixel / texel).max(2.0 * plain)
}

//! What theory says of the techniques of `triangles.rs`.

use std::f64::consts::{SQRT_2, TAU};

use antumbra_gpu::Expectation;

use super::depth_map;
use crate::{Estimator, ObjectId, PolygonId, TriangleDepth};
use Expectation::{Holds, KnownLimit};

/// Ideal texels a texel of the map: the guard band of a kernel of `reach` texels around its own, and one more,
/// at each side.
fn texel(size: u32, reach: u32) -> f64 {
    let size = f64::from(size);
    size / (size - 2.0 * (2.0 + f64::from(reach))).max(1.0)
}

/// The plain map's, of a kernel that reaches as far.
fn plain(size: u32, reach: u32, case: &str) -> Option<Expectation> {
    if let Some(whole) = super::without_holes(case) {
        return Some(whole);
    }
    depth_map(
        crate::Omni::default(),
        &Estimator { radius: 0.5 + reach as f32, ..Estimator::nearest() },
        size,
        case,
    )
}

/// HC-09 where identity is compared: along box 2's edges above box 1, a texel's centre can lie on the other box. A
/// texel, of 2 m of map, at either edge of its 0.2 m, is a share of 20 / size of at most half of the samples.
fn halo(size: u32, reach: u32) -> f64 {
    10.0 * texel(size, reach) / f64::from(size)
}

pub(crate) fn object_id(config: &ObjectId, case: &str) -> Option<Expectation> {
    Some(match case {
        // The plates are two objects, whatever their depths.
        "HC-13 depth precision, near caster" => Holds { bound: 0.0 },
        "HC-09 boxes in each other" => Holds { bound: halo(config.size, 0) },
        // All else that is lit is one convex object, or none that casts.
        _ => return plain(config.size, 0, case),
    })
}

pub(crate) fn polygon_id(config: &PolygonId, case: &str) -> Option<Expectation> {
    let size = f64::from(config.size);
    let texel = texel(config.size, config.reach);
    let alone = config.reach == 0;
    // Where two triangles meet along a line, each of its texels names one of them.
    let along_edges = |at_least: f64, at_most: f64| KnownLimit {
        at_least: if alone { at_least } else { f64::MIN_POSITIVE },
        at_most,
        because: "a texel that two triangles share names one of them, and the other is dark",
    };
    Some(match case {
        // A sample's texel names another triangle with the probability of its edges' length an area times a
        // quarter of a texel, the mean distance of an offset within a texel across an edge. 2560 equal
        // triangles on pi / 4 of a map have 2.0 sqrt(2560 / (pi / 4)) = 114 map sides of edge on the map: 29 / size
        // on the sphere, a quarter of the samples, half as much where few of it are seen; more at its limb and
        // on the cylinder's thin sides.
        "lone receivers, directional" | "lone receivers, spot" | "lone receivers, point" => {
            along_edges(0.5 * 0.25 * 29.0 / size, 50.0 / size)
        }
        // One line of at most `size` texels, wrong in half of each; the camera may see thrice as much of it.
        "HC-03 grazing plane" if alone => along_edges(f64::MIN_POSITIVE, 1.5 * texel / size),
        // The line runs along the light, at the map's middle, where texels meet.
        "HC-03 grazing plane, diagonal" if alone => Holds { bound: 1.5 * texel / size },
        // The farthest sample from the limb is the sphere's middle, 0.5 m, of 1.366 m. Dark ones lie as near to it as there are
        // samples for: on the 2560 lit triangles of 1.6 m^2 in all there are 89 m of edges a square metre, beside which a
        // quarter of a texel is dark (as above), and 16 samples a triangle, 26000 a square metre. A disc of radius r has pi r^2
        // of them; that none of 9 expected ones is there has the odds e^-9.
        "HC-08 sphere's limb" => {
            let metre = size / (60_f64.to_radians().sin() + 0.5);
            let dark = 89.0 * 0.25 / metre * 26000.0;
            let nearest = (9.0 / (std::f64::consts::PI * dark)).sqrt();
            along_edges((0.5 - nearest).max(0.0) * metre, 0.5 * metre)
        }
        "HC-09 boxes in each other" if alone => {
            along_edges(f64::MIN_POSITIVE, 2.0 * halo(config.size, config.reach))
        }
        "HC-09 boxes in each other" => Holds { bound: 2.0 * halo(config.size, config.reach) },
        // Eight triangles an ideal texel, of which it names one: that which holds its centre, and lies in it, so that no
        // neighbour names another. Four deviations of the mean of as many coin flips as there are samples, 2^14.
        "HC-10 triangles below a texel" => {
            let lit = 1.0 / (8.0 * texel * texel);
            let chance = 4.0 * (lit * (1.0 - lit)).sqrt() / 128.0;
            KnownLimit {
                at_least: 1.0 - lit - chance,
                at_most: 1.0 - lit + chance,
                because: "of eight triangles a texel names one, and seven are dark",
            }
        }
        // The front plate's line, half of a texel wide at most, of a plate as wide as the map; half the samples.
        "HC-13 depth precision" if alone => along_edges(f64::MIN_POSITIVE, 0.5 * texel / size),
        // The same, where positions 500 m from the origin are known to a millimetre, which is a texel.
        "HC-13 depth precision, near caster" => Holds { bound: 0.5 * texel / size },
        // The diagonal of the wall, which ends in corners 6.4 m from the shadow, of 8.5 m.
        "HC-17 beyond the far plane" if alone => along_edges(f64::MIN_POSITIVE, 6.4 / (8.5 / size)),
        // The same of a plate at 9 m, in a map as wide as the quad is at 1 m.
        "HC-38 depth along a long edge" if alone => {
            along_edges(f64::MIN_POSITIVE, SQRT_2 * 9.0 * texel / size)
        }
        // The wall's two triangles meet across all of its 60 m; an ideal map is 920 m wide.
        "K6 skyline" if alone => along_edges(f64::MIN_POSITIVE, 60.0 / (920.0 / size)),
        _ => return plain(config.size, config.reach, case),
    })
}

/// K18: how far from the fan's middle samples are looked at, metres.
const FAN_SEEN: f64 = 1.3;

pub(crate) fn triangle_depth(config: &TriangleDepth, case: &str) -> Option<Expectation> {
    let size = f64::from(config.size);
    let texel = texel(config.size, config.reach);
    Some(match case {
        "HC-01 A, point light" | "HC-01 B, sun overhead" | "HC-01 C, slanting sun"
            if config.reach > 0 =>
        {
            // Every sample has a texel nearby that the square fills, and the rest is the ray's: positions of
            // 10 m are rounded by 1e-6 m.
            Holds { bound: 1e-5 * size }
        }
        // Near a tip, or an edge that leaves the texels' rows, the nearest texel may show nothing.
        "HC-01 B, turned 30 degrees" | "HC-02 light amid the caster" => {
            Holds { bound: 1.5 * texel }
        }
        // Distances of planes, to the rounding of positions.
        "HC-13 depth precision, near caster" => Holds { bound: 0.0 },
        "HC-31 wire below a texel" => wire(size, texel, config.reach),
        // At most all of the bars' fifth is lit, but for what samples see of it.
        "K5 far fence" => KnownLimit {
            at_least: f64::MIN_POSITIVE,
            at_most: 0.2 + 4.0 * 0.4 / 128.0,
            because: "the triangle that a ray meets counts only where a texel's centre falls on it",
        },
        // A triangle is known where it holds a texel's centre, which it surely does where it is wider than a texel's diagonal:
        // a 64th of a turn, so far from the middle. The fan is 4 m wide.
        "K18 fan" => {
            let wide = SQRT_2 * 4.0 * texel / size / (TAU / 64.0);
            Holds { bound: (wide / FAN_SEEN).min(1.0) }
        }
        _ => return plain(config.size, config.reach, case),
    })
}

/// HC-31: the ray under the wire's axis meets the edge of its two upper sides. Of each side's two triangles only
/// one has that edge, and across the wire it is on average half as wide as the side.
fn wire(size: f64, texel: f64, reach: u32) -> Expectation {
    let cos = 30_f64.to_radians().cos();
    // Both together, texels: sides are sin 45 degrees of the wire's half thickness of 0.2 texels wide.
    let width = 45_f64.to_radians().sin() * 0.2;
    let uneven = 4.0 / (2.8 / 20.48 * size);
    // Texels' centres lie across the wire at most (2 reach + 1) / cos 30 to a texel, and those of one texel are
    // spread at most that densely.
    let most = width * f64::from(2 * reach + 1) / cos;
    KnownLimit {
        at_least: 1.0 - most * (1.0 + uneven),
        at_most: 1.0 - width / texel / cos * (1.0 - uneven),
        because: "the triangle that a ray meets counts only where a texel's centre falls on it",
    }
}

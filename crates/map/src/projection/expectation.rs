//! What theory says of projection shadows on each hard case.

use antumbra_gpu::Expectation;
use antumbra_gpu::Expectation::{Holds, KnownLimit, Refuses};

use super::ShadowTexture;
use crate::{Estimator, MapConfig};

/// Planar shadows, drawn from the camera.
pub(super) fn planar(case: &str) -> Option<Expectation> {
    Some(match case {
        // There is no plane to shadow, or nothing above it.
        "lone receivers, directional"
        | "lone receivers, spot"
        | "lone receivers, point"
        | "HC-03 grazing plane"
        | "HC-03 grazing plane, diagonal" => Holds { bound: 0.0 },
        "HC-14 far from the origin" | "HC-28 downstairs" => Holds { bound: 0.0 },
        // The rasteriser decides at the view samples themselves. It moves an edge by 1/256 pixel an axis, and
        // the rounding of the flattened corners by at most as much again; a pixel is a texel of the cases' map.
        "HC-02 in view" | "HC-23 light at the eye" | "HC-25 caster out of sight" => {
            Holds { bound: std::f64::consts::SQRT_2 * 2.0 / 256.0 }
        }
        // Its texels are the pixels of the view.
        "HC-22 T-junction" => Holds { bound: isolated(0.0, 192.0 * 2.73 / 1.2) },
        "HC-24 light at a vertex" | "HC-24 light in a cube" | "HC-24 light on the floor" => {
            Holds { bound: 0.0 }
        }
        "HC-01 A, point light"
        | "HC-01 B, sun overhead"
        | "HC-01 C, slanting sun"
        | "HC-01 B, turned 30 degrees"
        | "HC-02 light amid the caster"
        | "HC-04 thin wall"
        | "HC-05 cube"
        | "HC-13 depth precision"
        | "HC-13 depth precision, near caster"
        | "HC-06 open sheet"
        | "HC-07 post under a lid"
        | "HC-08 sphere's limb"
        | "HC-09 boxes in each other"
        | "HC-10 triangles below a texel"
        | "HC-11 seams of a cube"
        | "HC-11 seams of a tetrahedron"
        | "HC-11 seams of an isocube"
        | "HC-11 seams of a paraboloid"
        | "HC-12 two triangles below the light"
        | "HC-31 wire below a texel"
        | "HC-35 checker"
        | "HC-35 checker of texels"
        | "HC-38 depth along a long edge"
        | "HC-36 panes"
        | "K18 fan"
        | "area light of no size"
        | "area light of any size"
        | "area light, contact"
        | "area light, caster at it"
        | "area light, passing ball"
        | "area light, sinking plate"
        | "HC-40 casters out of view" => Refuses {
            because: "flattened casters are drawn from the camera, and the case's samples have none",
        },
        // Floors in view, decided at the view samples themselves; a map of 1024 texels over 2 m has one every 2 mm, which
        // is what an edge moves on the floor.
        "HC-19 three and four triangles on an edge"
        | "HC-20 winding without a side"
        | "HC-22 vertex on an edge" => Holds { bound: 1.0 },
        "HC-15 eye in shadow"
        | "HC-16 boundary near the eye"
        | "HC-16 boundary through the eye"
        | "HC-18 sheets"
        | "HC-18 256 sheets"
        | "HC-21 light in the plane"
        | "HC-24 lamp in a cube, in view"
        | "HC-24 light at a corner"
        | "HC-25 caster not seen" => Holds { bound: 0.0 },
        // A pixel of 0.19 m moves by as little.
        "HC-23 lamp at the eye, in view" | "HC-23 light in the near plane" => {
            Holds { bound: std::f64::consts::SQRT_2 * 2.0 / 256.0 * 0.19 * LARGEST / 3.0 }
        }
        "HC-39 creeping camera" => drawn_from_the_camera(),
        "HC-17 beyond the far plane" => beyond_the_cube(LARGEST),
        _ => return None,
    })
}

/// HC-17 where the wall does not receive, as planes that do not bound the scene do not: what is seen of the cube's shadow
/// there is lit.
///
/// The eye sees the wall past the cube's back from x = 3 - 2 (49 / 46) = 0.87 m on, and the shadow ends at
/// 52 / 47 = 1.11 m. Samples lie 0.2 m apart, so that one column of them is there.
/// In texels of a map of `size`.
fn beyond_the_cube(size: f64) -> Expectation {
    KnownLimit {
        at_least: f64::MIN_POSITIVE,
        at_most: 0.24 / 8.5 * size,
        because: "only planes that bound the scene receive, and the wall stands on the floor amid it",
    }
}

/// Texels a side of the largest map that anybody measures these with, which have none: WebGPU's default limit. A test
/// holds HC-17 to metres.
const LARGEST: f64 = 8192.0;

/// HC-23, the light in the near plane, where all of the plate's shadow that is seen is lit: a strip of 0.14 m past the
/// plate, of a shadow of 3 m, in which one column of samples 0.19 m apart may lie. In texels of a map of `size`.
pub(crate) fn beside_the_plate(size: f64) -> Expectation {
    Holds { bound: 0.14 / 3.0 * size }
}

/// HC-39, whose samples are the same in each frame.
fn drawn_from_the_camera() -> Expectation {
    KnownLimit {
        at_least: f64::MIN_POSITIVE,
        at_most: 1.0,
        because: "shadows are drawn from the camera for its own pixels, and the case's samples stand still",
    }
}

/// HC-22: the rasteriser leaves at most a sliver of 2/256 texel open along the junction, on which a texel's centre
/// falls in one of 128 rows. What is left is isolated: at most every eighth texel of a line across the view of 1.2 m,
/// for a map of `size` texels over 2.73 m. A kernel spreads each over the samples within its radius.
pub(crate) fn isolated(radius: f64, size: f64) -> f64 {
    let (view, texel) = (1.2_f64, 2.73 / size);
    let texels = std::f64::consts::SQRT_2 * view / texel / 8.0;
    texels * (texel / view).powi(2) * (2.0 * radius + 1.0).powi(2)
}

/// Shadow textures. A mask above a plane says at each texel what a depth map that is compared with the plane says.
pub(super) fn shadow_texture(config: &ShadowTexture, case: &str) -> Option<Expectation> {
    match case {
        "HC-17 beyond the far plane" => Some(beyond_the_cube(config.size.into())),
        "HC-13 depth precision, near caster" => Some(KnownLimit {
            at_least: 0.5,
            at_most: 0.5,
            because: "only planes that bound the scene receive, and the rear plate is amid it: half of the samples",
        }),
        // Every other square is a hole that is not: half of what is judged, to four deviations of 2^13 coin flips
        // (9216 of 2^14 samples are judged, or more).
        "HC-35 checker" | "HC-35 checker of texels" => Some(half_of_a_checker(
            "casters are drawn from their triangles, without the holes in them",
        )),
        "HC-07 post under a lid" | "HC-38 depth along a long edge" => Some(KnownLimit {
            at_least: 0.5,
            at_most: 0.5,
            because: "only planes that bound the scene receive: not the post or the plate, half of the samples",
        }),
        _ => {
            let map = MapConfig { size: config.size, ..MapConfig::default() };
            let estimator = Estimator { radius: config.radius(), ..Estimator::nearest() };
            crate::expectation(&map, &estimator, case)
        }
    }
}

/// HC-35 where holes make no difference: half of what is judged, whatever is said of it.
fn half_of_a_checker(because: &'static str) -> Expectation {
    let deviations = 4.0 * 0.5 / 90.0;
    KnownLimit { at_least: 0.5 - deviations, at_most: 0.5 + deviations, because }
}

/// Disc shadows with their default settings.
pub(super) fn disc(case: &str) -> Option<Expectation> {
    // A disc is not the caster's shape: wrong by a part of the caster's size, which the cases count in texels of a
    // map around it. An eighth of the caster is 8 texels of a map of 64, the least that anybody measures with.
    let shapeless = KnownLimit {
        at_least: 8.0,
        at_most: f64::INFINITY,
        because: "a disc is not the caster's shape, and is wrong by a share of the caster's size",
    };
    Some(match case {
        // There is no plane to shadow, or no body on it.
        "lone receivers, directional"
        | "lone receivers, spot"
        | "lone receivers, point"
        | "HC-03 grazing plane"
        | "HC-03 grazing plane, diagonal" => Holds { bound: 0.0 },
        "HC-14 far from the origin" | "HC-28 downstairs" => Holds { bound: 0.0 },
        "HC-01 A, point light"
        | "HC-01 B, sun overhead"
        | "HC-01 C, slanting sun"
        | "HC-01 B, turned 30 degrees"
        | "HC-02 light amid the caster"
        | "HC-04 thin wall"
        | "HC-02 in view"
        | "HC-23 light at the eye"
        | "HC-25 caster out of sight" => shapeless,
        // The disc's centre is at the cube's foot.
        "HC-05 cube" => Holds { bound: 0.0 },
        // The rear plate is dark up to 3/4 of the disc, which fits into the plate, of whose samples the outermost
        // are at 4/5: 1 - pi (3/4)^2 / (8/5)^2 = 0.310 are lit, of half the samples.
        "HC-13 depth precision" => KnownLimit {
            at_least: 0.15,
            at_most: 0.16,
            because: "the corners of a square plate stand out of its disc",
        },
        "HC-13 depth precision, near caster" => KnownLimit {
            at_least: 0.5,
            at_most: 0.5,
            because: "only planes that bound the scene receive, and the rear plate is amid it: half of the samples",
        },
        // T-junctions are no matter to bounds. The box of the plate, turned by 30 degrees, is 2.73 m wide, and its
        // disc fully dark within 0.683 m of the middle: all of the 1.2 m x 1.2 m in view but its corners,
        // 0.683^2 (pi - 4 acos(0.6 / 0.683)) + 4 * 0.6 sqrt(0.683^2 - 0.6^2) = 1.319 of 1.44 m2.
        "HC-22 T-junction" => KnownLimit {
            at_least: 0.08,
            at_most: 0.088,
            because: "the corners of a square plate stand out of the dark part of its disc",
        },
        "HC-24 light at a vertex" | "HC-24 light on the floor" => Holds { bound: 0.0 },
        // The cube's middle is 0.2 m below the light, 1.2 m above the floor: the disc of 0.5 m becomes 3 m, dark up
        // to 2.25 m, on 10 m x 10 m.
        "HC-24 light in a cube" => KnownLimit {
            at_least: 0.82,
            at_most: 0.86,
            because: "a disc ends, where the shadow around a light in a box does not",
        },
        "HC-31 wire below a texel" => KnownLimit {
            at_least: 0.35,
            at_most: 0.40,
            because: "the wire's disc has the area of its box, and the wire stands out of it at both ends",
        },
        // The cubes' discs are fully dark and end within the bands that the case leaves out.
        "HC-40 casters out of view" => Holds { bound: 0.0 },
        "HC-20 winding without a side" | "HC-22 vertex on an edge" => shapeless,
        // A disc comes nearer to triangles that stand upright around an edge: a thirtieth of the caster.
        "HC-19 three and four triangles on an edge" => KnownLimit {
            at_least: 2.0,
            at_most: f64::INFINITY,
            because: "a disc is not the caster's shape, and is wrong by a share of the caster's size",
        },
        "HC-06 open sheet"
        | "HC-09 boxes in each other"
        | "HC-15 eye in shadow"
        | "HC-16 boundary near the eye"
        | "HC-16 boundary through the eye"
        | "HC-18 sheets"
        | "HC-18 256 sheets"
        | "HC-25 caster not seen" => KnownLimit {
            at_least: f64::MIN_POSITIVE,
            at_most: 1.0,
            because: "a disc is not the caster's shape, and is wrong on a share of the picture",
        },
        "HC-24 lamp in a cube, in view" => KnownLimit {
            at_least: f64::MIN_POSITIVE,
            at_most: 1.0,
            because: "a disc ends, where the shadow around a light in a box does not",
        },
        "HC-07 post under a lid" | "HC-38 depth along a long edge" => KnownLimit {
            at_least: 0.5,
            at_most: 0.5,
            because: "only planes that bound the scene receive: not the post or the plate, half of the samples",
        },
        "HC-17 beyond the far plane" => beyond_the_cube(LARGEST),
        // The disc is fully dark up to half of the shadow's width, and light where the eye sees past the plate.
        "HC-23 light in the near plane" => beside_the_plate(LARGEST),
        "HC-35 checker" => half_of_a_checker("a disc knows nothing of holes"),
        // A card of 1 m by 1 m at 45 degrees has a disc of R^2 = 0.5 * 0.35 m2, full to R / 2 and then smooth: 0.2875 times
        // 2 pi R^2 of darkness on 1.41 m2, or 0.226. What is left out, 8 texels at each side, is lit: of a map of 64, the
        // least that anybody measures with, it is 7 / 16, and the rest 0.40 dark. To four deviations, as for maps.
        "HC-35 checker of texels" => KnownLimit {
            at_least: 0.5 - 0.226 * 16.0 / 9.0 - 4.0 * 0.5 / 128.0,
            at_most: 0.5 - 0.226 + 4.0 * 0.5 / 128.0,
            because: "a disc is as dark as it is, whatever share of the caster is there",
        },
        // No plane receives what nothing casts, and under the square of 40 m all that is looked at is dark.
        "HC-08 sphere's limb"
        | "HC-10 triangles below a texel"
        | "HC-12 two triangles below the light"
        | "HC-21 light in the plane"
        | "HC-23 lamp at the eye, in view"
        | "HC-24 light at a corner" => Holds { bound: 0.0 },
        // A disc knows no seams; a tenth is left to chance, as for maps.
        "HC-11 seams of a cube"
        | "HC-11 seams of a tetrahedron"
        | "HC-11 seams of an isocube"
        | "HC-11 seams of a paraboloid" => Holds { bound: 0.1 },
        "HC-39 creeping camera" => Holds { bound: 0.0 },
        _ => return None,
    })
}

//! What theory says of the techniques of `self_shadowing.rs`. Where they share the plain map's lookup and
//! nothing else matters, its expectation is theirs.

use antumbra_gpu::{Expectation, SUBPIXEL_STEP};

use super::{depth_map, without_holes};
use crate::projection::expectation::beside_the_plate;
use crate::{DualLayers, Estimator, Midpoint, NormalOffset, SecondDepth, SecondSurface, SlopeBias};
use Expectation::{Holds, KnownLimit};

/// Ideal texels a texel of the map: the guard band takes two at each side.
fn texel(size: u32) -> f64 {
    let size = f64::from(size);
    size / (size - 4.0).max(1.0)
}

/// On cases where nothing that is lit casts towards what is looked at, the ways around self-shadowing have nothing to do.
fn plain(size: u32, case: &str) -> Option<Expectation> {
    depth_map(crate::Omni::default(), &Estimator::nearest(), size, case)
}

/// The plain map's bound on `case`, and so many texels more.
fn wider(size: u32, case: &str, more: f64) -> Option<Expectation> {
    match plain(size, case)? {
        Holds { bound } => Some(Holds { bound: bound + more * texel(size) }),
        other => Some(other),
    }
}

pub(crate) fn second_depth(config: &SecondDepth, case: &str) -> Option<Expectation> {
    let size = f64::from(config.size);
    let texel = texel(config.size);
    let without = |at_least: f64, at_most: f64| KnownLimit {
        at_least,
        at_most,
        because: "a single sheet whose front faces the light has no second surface",
    };
    // The whole shadow is missing: the sample farthest from the edge is wrong, to within a quarter for the
    // few that lie in the middle.
    let missing = |farthest: f64| without(0.75 * farthest, farthest);
    let half_wrong = without(0.5, 0.5);
    // All that is in shadow is lit, a part of the picture or of the samples.
    let some_wrong = without(f64::MIN_POSITIVE, 1.0);
    Some(match case {
        // Front and back of an acute edge can both turn away from the light on the way to it; then a texel's
        // back face is nearer than a front within a texel of the limb. Of the four bodies the tetrahedron has
        // such edges: at most the 4 sides of the map in length, on half its area at least.
        "lone receivers, directional" | "lone receivers, spot" | "lone receivers, point" => {
            Holds { bound: 2.0 * texel / size }
        }
        // Half the square's side.
        "HC-01 A, point light" | "HC-01 B, sun overhead" | "HC-01 C, slanting sun" => {
            missing(0.5 * size)
        }
        "HC-01 B, turned 30 degrees" => {
            let (sin, cos) = 30_f64.to_radians().sin_cos();
            missing(0.5 * size / (sin + cos))
        }
        // The floor ends where the light at 1 m shines past the triangle at 0.8 m, 0.3 m above its lower edge.
        "HC-02 light amid the caster" => missing(0.15 * size),
        "HC-06 open sheet"
        | "HC-07 post under a lid"
        | "HC-13 depth precision"
        | "HC-13 depth precision, near caster"
        | "HC-38 depth along a long edge" => half_wrong,
        // Of what is all in the shadow of one sheet all is lit, and in a box only the light's own far side is seen.
        "HC-22 T-junction" | "HC-24 light in a cube" | "HC-24 lamp in a cube, in view"
            if config.surface == SecondSurface::SecondLayer =>
        {
            without(1.0, 1.0)
        }
        // Without a shadow, all of the light comes through where four fifths should.
        "K5 far fence" if config.surface == SecondSurface::SecondLayer => without(0.19, 0.21),
        "K18 fan" => without(1.0, 1.0),
        // Below a triangle that is there three times lies the floor; one of the three turns its back to the sun.
        "K19 odd triangles" if config.surface == SecondSurface::SecondLayer => {
            without(f64::MIN_POSITIVE, size)
        }
        // Below the first of many sheets lies the second.
        "HC-18 sheets" | "HC-18 256 sheets" if config.surface == SecondSurface::SecondLayer => {
            Holds { bound: 0.0 }
        }
        "HC-12 two triangles below the light"
        | "HC-15 eye in shadow"
        | "HC-16 boundary near the eye"
        | "HC-16 boundary through the eye"
        | "HC-18 sheets"
        | "HC-18 256 sheets"
        | "HC-25 caster not seen" => some_wrong,
        // No second layer lies below a lone triangle.
        "K7 crossing triangle" if config.surface == SecondSurface::SecondLayer => some_wrong,
        // All of what is seen of the shadow is missing.
        "HC-23 light in the near plane" => beside_the_plate(size),
        // As above, of shadows that are narrower than the map, at samples that lie where the pixels do.
        "HC-02 in view"
        | "HC-23 light at the eye"
        | "HC-25 caster out of sight"
        | "HC-19 three and four triangles on an edge"
        | "HC-20 winding without a side"
        | "HC-22 vertex on an edge" => without(texel, size),
        "HC-04 thin wall" | "HC-05 cube" => {
            // A bias of b metres of depth opens b cos 45 degrees of floor, of 2.01 m or 2 m a map.
            let side = if case.starts_with("HC-04") { 2.01 } else { 2.0 };
            let leak = f64::from(config.bias) * std::f64::consts::FRAC_1_SQRT_2 / side * size;
            // The texel's centre lies up to a texel off.
            if leak > texel {
                KnownLimit {
                    at_least: leak - texel,
                    at_most: leak + texel,
                    because: "a constant bias moves the floor behind a body in front of its far side",
                }
            } else {
                return wider(config.size, case, leak);
            }
        }
        // As far as the bias leaks behind a metre and a half of boxes, of a floor of 15 square metres.
        "HC-09 boxes in each other" => Holds { bound: 0.1 * f64::from(config.bias) },
        // The limb, as above, of obtuse edges.
        "HC-08 sphere's limb" => Holds { bound: limb(size, texel) },
        // A lone floor has no second surface; the rest have closed bodies.
        _ => return without_holes(case).or_else(|| plain(config.size, case)),
    })
}

pub(crate) fn midpoint(config: &Midpoint, case: &str) -> Option<Expectation> {
    virtual_occluder(config.size, f64::INFINITY, case)
}

pub(crate) fn dual_layers(config: &DualLayers, case: &str) -> Option<Expectation> {
    virtual_occluder(config.size, config.limit.into(), case)
}

/// An occluder halfway between two layers, at most `limit` texels behind the first.
fn virtual_occluder(map_size: u32, limit: f64, case: &str) -> Option<Expectation> {
    let size = f64::from(map_size);
    let texel = texel(map_size);
    // A plane's depth changes by up to half its slope along each of a texel's axes.
    let steep = |slope: f64| 0.5 * slope > limit;
    Some(match case {
        "lone receivers, directional" | "lone receivers, spot" | "lone receivers, point" => {
            // Of a sphere's lit half, the part steeper than the limit, where of an evenly spread offset u a
            // share 1/2 - limit / tan a is farther from the light than the occluder, is
            // c / 2 - limit (1 - sqrt(1 - c^2)), c = cos a at the limit.
            let c = if limit.is_finite() { 1.0 / (1.0 + 4.0 * limit * limit).sqrt() } else { 0.0 };
            let share = if c > 0.0 { 0.5 * c - limit * (1.0 - (1.0 - c * c).sqrt()) } else { 0.0 };
            // Of a sphere's lit half, as much as sqrt(2 w) lies within a share w of its radius from the limb:
            // here the half diagonal of a texel.
            let limb = (2.0 * 0.75 * texel * 2.0 / size).sqrt();
            if share > 0.0 {
                KnownLimit {
                    // Flat bodies may have no steep side, and the sphere may show its shallow one. A test holds the share
                    // to that which the samples' own planes have, and to chance.
                    at_least: share / 16.0,
                    // Offsets along two axes add up.
                    at_most: 2.0 * share + limb,
                    because: "where the surface is steeper than the limit allows for, a texel's centre hides \
                              what lies farther off in the texel",
                }
            } else {
                KnownLimit {
                    at_least: f64::MIN_POSITIVE,
                    at_most: limb,
                    because: "at the limb front and back converge, and what is halfway between them with them",
                }
            }
        }
        "HC-03 grazing plane" | "HC-03 grazing plane, diagonal" if steep(plane_slope(5.0)) => {
            KnownLimit {
                at_least: f64::MIN_POSITIVE,
                at_most: 0.5,
                because: "the plane is steeper than the limit allows for",
            }
        }
        // Where nothing lies behind the first layer, the map's far end stands for it: the last rows of texels
        // before it are too near. A row is a share 1 / size of the floor, the farther end of what is seen.
        "HC-03 grazing plane"
        | "HC-03 grazing plane, diagonal"
        | "HC-10 triangles below a texel" => Holds { bound: 2.0 * texel / size },
        // The far edges of the tops are limbs. Of a metre of top, a fifth of the samples, a texel takes up to
        // 1 / sin 40 degrees of the 2 m that the map holds.
        "HC-09 boxes in each other" => Holds { bound: 0.2 * 3.2 * texel / size },
        // Lid at 9 m, end of the casters at 0 m: the occluder is at 4.5 m, and 1.5 of the post's 6 m, which are
        // half of what is judged, stand above it. A limit of texels stays near the lid.
        "HC-07 post under a lid" if !limit.is_finite() => KnownLimit {
            at_least: 0.12,
            at_most: 0.13,
            because: "what stands in the upper half of the space between the two layers is lit",
        },
        // Nothing lies behind the square, so that the map's end stands for it, 28 m off at the square's corners: halfway
        // there the occluder is farther than the floor of which all is dark, a half of what is looked at.
        "HC-12 two triangles below the light" => KnownLimit {
            at_least: f64::MIN_POSITIVE,
            at_most: 0.5,
            because: "the end of the map stands for a second layer, and halfway to it lies beyond the floor",
        },
        // The same behind the fence's bars: at most all of their fifth is lit.
        "K5 far fence" if !limit.is_finite() => KnownLimit {
            at_least: f64::MIN_POSITIVE,
            at_most: 0.2 + 4.0 * 0.4 / 128.0,
            because: "the end of the map stands for a second layer, and halfway to it lies beyond the floor",
        },
        "HC-08 sphere's limb" => {
            if limit.is_finite() {
                limb_of_steep(size, texel, limit)
            } else {
                Holds { bound: limb(size, texel) }
            }
        }
        _ => return without_holes(case).or_else(|| plain(map_size, case)),
    })
}

/// Depth by which a floor lit at `elevation` degrees changes along a texel, in sides of the texel's longer one.
/// The map is fitted to the floor, so the texel is as much shorter as the floor is foreshortened.
fn plane_slope(elevation: f64) -> f64 {
    elevation.to_radians().cos()
}

/// HC-08: how far from the limb, in texels, a sample lies at most whose texel shows something else than its facet.
///
/// What a texel shows at its centre differs from what it shows at the sample only across the outline, on which an edge
/// between a lit facet and an unlit one lies, and they are a diagonal apart at most: sqrt 2 texels, of which the shorter side
/// is half a metre's share less than the longer; 2 cover it. No point of a facet is farther than 0.0478 radians from its
/// normal (of an icosahedron's, each divided in four four times). So points of such an edge are as near as that to being
/// seen edge-on, and to the sphere's surface: 0.5 m times the square of its cosine from the axis.
fn limb(size: f64, texel: f64) -> f64 {
    let long = 60_f64.to_radians().cos() + 60_f64.to_radians().sin();
    2.0 * texel + 0.5 * 0.0478_f64.sin().powi(2) * size / long
}

/// HC-08 with occluders at most `limit` texels behind a surface: acne wherever a sphere is steeper.
///
/// The sun is at 60 degrees; texels are 1 by cos 60 + sin 60 = 1.366 units. Along the longer side, acne needs
/// tan a > 2 limit; along the diagonal, tan a sqrt(1 + 1.366^2) / 2 > 1.366 limit. At the angle a, the limb is
/// 0.5 m (1 - sin a) away, of which a map of `size` texels has `size` / 1.366 m.
fn limb_of_steep(size: f64, texel: f64, limit: f64) -> Expectation {
    let long = 60_f64.to_radians().cos() + 60_f64.to_radians().sin();
    let away = |tan: f64| 0.5 * (1.0 - tan / (1.0 + tan * tan).sqrt()) * size / long;
    let along_diagonal = 2.0 * limit * long / (1.0 + long * long).sqrt();
    KnownLimit {
        at_least: (away(2.0 * limit) - limb(size, texel)).max(f64::MIN_POSITIVE),
        at_most: away(along_diagonal) + limb(size, texel),
        because: "where the sphere is steeper than the limit allows for, it hides itself",
    }
}

pub(crate) fn slope_bias(config: &SlopeBias, case: &str) -> Option<Expectation> {
    let size = f64::from(config.size);
    let factor = f64::from(config.factor);
    // Half the slope along each axis, and the rasteriser's step.
    if factor < 1.0 + 2.0 * f64::from(SUBPIXEL_STEP) {
        return None;
    }
    Some(match case {
        // A facet within 1.5 degrees of edge-on beside one that is 7.5 degrees (of 48 sides) less steep: half its
        // slope along each axis is more than `factor` times the neighbour's. Of a lit half, sin 1.5 degrees; a
        // smaller factor makes it as much more.
        "lone receivers, directional" | "lone receivers, spot" | "lone receivers, point" => {
            Holds { bound: 1.5_f64.to_radians().sin() * 2.5 / factor }
        }
        "HC-01 C, slanting sun" => KnownLimit {
            at_least: factor - 1.0,
            at_most: (factor + 0.5 + 0.5) * texel(config.size),
            because: "the map's depths end with the farthest caster, and what is pushed beyond the end is not \
                      there",
        },
        // Along a ray at 45 degrees, depth between a wall's front and the floor grows by sqrt(2) a metre of
        // floor; `factor` texels of sqrt(1/2) each are hidden on the first `factor` / 2.
        "HC-04 thin wall" | "HC-05 cube" => return wider(config.size, case, 0.5 * factor),
        "HC-08 sphere's limb" => Holds { bound: limb(size, texel(config.size)) },
        // As under HC-01's slanting sun, which is one of the lights; and sheets that slope beyond the map's end.
        "HC-25 caster out of sight" | "HC-20 winding without a side" => {
            return wider(config.size, case, factor);
        }
        // Nothing at the lookup, and steps that are relative to the depth: what the plain map lacks here.
        "HC-13 depth precision, near caster" => Holds { bound: 0.0 },
        "HC-31 wire below a texel" => {
            let Some(KnownLimit { at_least, at_most, .. }) = plain(config.size, case) else {
                return None;
            };
            // Two of the wire's upper four sides slope by tan 22.5 degrees and make up sin 45 degrees of its
            // width; the map is 20.48 m wide and ends 5 cm below the wire's axis.
            let push = factor * 22.5_f64.to_radians().tan() * 20.48 / size;
            let kept = if push < 0.05 { 45_f64.to_radians().sin() } else { 0.0 };
            KnownLimit {
                at_least,
                at_most: 1.0 - kept * (1.0 - at_most),
                because: "a caster thinner than a texel has steep sides, which are pushed beyond the map's end",
            }
        }
        _ => return without_holes(case).or_else(|| plain(config.size, case)),
    })
}

pub(crate) fn normal_offset(config: &NormalOffset, case: &str) -> Option<Expectation> {
    let offset = f64::from(config.offset);
    // What `NormalOffset::offset` derives.
    if offset < std::f64::consts::SQRT_2 * (0.5 + f64::from(SUBPIXEL_STEP)) {
        return None;
    }
    // Convex bodies lie behind their tangent planes, above which the receiver is lifted by more than a plane
    // rises within a texel; so nothing shadows itself, as with the receiver's plane. To the side the lookup
    // moves by `offset` sin^2 a texels, seen up to 45 degrees askew in the caster's plane.
    wider(
        config.size,
        case,
        match case {
            "HC-01 A, point light"
            | "HC-01 C, slanting sun"
            | "HC-02 light amid the caster"
            | "HC-02 in view"
            | "HC-04 thin wall"
            | "HC-05 cube"
            | "HC-23 light at the eye"
            | "HC-25 caster out of sight" => std::f64::consts::SQRT_2 * offset,
            // Of which the number is what the light sees itself.
            "K2 tilted suns" => offset,
            _ => 0.0,
        },
    )
}

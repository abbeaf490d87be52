//! What theory says of techniques over a depth map on each hard case.
//!
//! The cases and their numbers are those of `antumbra_measure::stability::CASES`; a case is right at 0.

pub(crate) mod self_shadowing;
pub(crate) mod triangles;

use antumbra_gpu::Expectation;

use crate::projection::expectation::isolated;
use crate::{Estimator, MapConfig, Omni};

/// What theory says, on the hard case named `case`, of a technique that compares the receiver's plane with a
/// depth map fitted to the casters; `None` for a case that is not known here.
#[must_use]
pub fn expectation(map: &MapConfig, estimator: &Estimator, case: &str) -> Option<Expectation> {
    if map.omni == Omni::WarpedParaboloid && case == "lone receivers, point" {
        // How much of a receiver its own edges hide, drawn straight: nobody has said.
        return None;
    }
    let in_charts =
        matches!(map.omni, Omni::Isocube | Omni::DualParaboloid | Omni::WarpedParaboloid);
    let in_view = ["HC-02 in view", "HC-23 light at the eye", "HC-25 caster out of sight"];
    if (in_charts || map.omni == Omni::Tetrahedron) && in_view.contains(&case) {
        // Charts are not fitted to what is seen, and a tetrahedron's views are fitted obliquely: how large texels are there
        // nobody has said.
        return None;
    }
    if map.objects > 0
        && (case.starts_with("HC-31") || case.starts_with("HC-39") || case.starts_with("K15"))
    {
        // Said of the texels of one map around all casters: those of single objects are finer, and as many as objects.
        return None;
    }
    around(map, estimator, case).or_else(|| depth_map(map.omni, estimator, map.size, case))
}

/// HC-35 for maps that are drawn from triangles: of half a floor the answer is wrong, all of it or none being dark.
#[must_use]
pub fn without_holes(case: &str) -> Option<Expectation> {
    case.starts_with("HC-35").then_some(Expectation::KnownLimit {
        at_least: 0.45,
        at_most: 0.55,
        because: "the map is drawn from triangles, which know nothing of holes",
    })
}

/// Cases of point lights, where layouts other than the cube differ from it.
fn around(map: &MapConfig, estimator: &Estimator, case: &str) -> Option<Expectation> {
    use Expectation::{Holds, KnownLimit};
    if map.omni == Omni::Cube {
        return None;
    }
    let (radius, size) = (f64::from(estimator.radius), f64::from(map.size));
    let guard = radius.ceil() as u32 + 1;
    let band = size / (size - 2.0 * f64::from(guard)).max(1.0);
    let half_width = Omni::half_width(map.size, guard);
    // A map that is not fitted to the one caster: its largest texel, radians times the map's side. A tetrahedron's
    // view is 2 x 3.08 wide, in tangents of angles; a unit of chart is an angle of up to the chart's `STRETCH`.
    let texel = match map.omni {
        Omni::Isocube => 2.0 * half_width * 1.2,
        Omni::DualParaboloid | Omni::WarpedParaboloid => 2.0 * half_width * 2.0,
        Omni::Cube | Omni::Tetrahedron => 2.0 * 3.077 * band,
    };
    let reach = std::f64::consts::SQRT_2 * (radius + 1.0 / 256.0) * texel;
    // Straight edges are off by up to an eighth of the square of the longest edge's angle, in units of the chart.
    let off = |angle: f64| match map.omni {
        Omni::WarpedParaboloid => 0.125 * angle * angle * 2.0 * size,
        _ => 0.0,
    };
    Some(match case {
        // An angle is 4.5 m of the caster's plane at its corners, 4.2 m off and 19 degrees aslant, and an ideal
        // texel 2 m of it over the map's side; its edges span 0.48.
        "HC-01 A, point light" | "HC-23 light at the eye" | "HC-25 caster out of sight" => {
            Holds { bound: (reach + off(0.48)) * 4.5 / 2.0 }
        }
        // The same on a wall 53 m off, of which the casters, whose edges span 0.22, fill 8.5 m.
        "HC-17 beyond the far plane" => Holds { bound: (reach + off(0.22)) * 53.0 / 8.5 },
        // And on a floor 6.5 m off, of which the plate, whose edges span 0.72, hides 3 m.
        "HC-23 lamp at the eye, in view" | "HC-23 light in the near plane" => {
            Holds { bound: (reach + off(0.72)) * 6.5 / 3.0 }
        }
        // The same for a triangle up to 2.5 m off and 36 degrees aslant, whose edges span up to 0.93.
        "HC-02 light amid the caster" => Holds { bound: (reach + off(0.93)) * 3.0 / 2.0 },
        "HC-12 two triangles below the light" if map.omni == Omni::WarpedParaboloid => KnownLimit {
            at_least: 0.5,
            at_most: 0.5,
            because: "only vertices are where they belong: all of the square is drawn at its corners' distance of \
                      28 m, farther than the floor, which is lit",
        },
        _ => return None,
    })
}

/// HC-11, on seams that are a layout's own or another's.
///
/// Guard bands hold what kernels reach, so an own seam is no edge: a tenth is left to what is random of two means
/// over the same receivers. Another's seam lies anywhere, and there an edge's error goes with the side of the
/// texels, whose greatest and least differ by a factor: a cube's by 3, the square of 3^-1/2 being the change of a
/// tangent from a face's middle to its corner, and by as much as they get narrower; a tetrahedron's by 0.309^-2;
/// an isocube's from 0.585 to 1.1 radians a unit of chart; a paraboloid's by 2.
fn seams(omni: Omni, own: bool) -> f64 {
    let factor = match omni {
        _ if own => 1.0,
        Omni::Cube => 3.0,
        Omni::Tetrahedron => 0.309_f64.powi(-2),
        Omni::Isocube => 1.1 / 0.585,
        Omni::DualParaboloid | Omni::WarpedParaboloid => 2.0,
    };
    factor - 1.0 + 0.1
}

/// Techniques that compare the receiver's plane with a depth map fitted to the casters, of `size` texels a
/// side.
fn depth_map(omni: Omni, estimator: &Estimator, size: u32, case: &str) -> Option<Expectation> {
    use Expectation::Holds;
    let (radius, size) = (f64::from(estimator.radius), f64::from(size));
    // The map keeps a guard band of the kernel's radius and one texel around the casters, which makes its
    // texels larger than those of the ideal map that the cases count in.
    let texel = size / (size - 2.0 * (radius.ceil() + 1.0)).max(1.0);
    // A sample is decided by texel centres up to `radius` away an axis, and these by where the rasteriser
    // puts the caster's edge, to 1/256 texel.
    let reach = std::f64::consts::SQRT_2 * (radius + 1.0 / 256.0) * texel;
    // At a contact the nearest texel's centre lies up to a texel on the wrong side, and the bias of its
    // slope another; a kernel reaches `radius` farther.
    let gap = (2.0 + radius) * texel;
    Some(match case {
        // The receiver's own plane gives every texel its depth, and rounding is bounded.
        "lone receivers, directional"
        | "lone receivers, spot"
        | "lone receivers, point"
        | "HC-03 grazing plane"
        | "HC-03 grazing plane, diagonal" => Holds { bound: 0.0 },
        "HC-01 A, point light"
        | "HC-01 B, sun overhead"
        | "HC-01 C, slanting sun"
        | "HC-01 B, turned 30 degrees"
        | "HC-02 light amid the caster"
        | "HC-02 in view"
        | "HC-23 light at the eye"
        | "HC-25 caster out of sight"
        | "HC-19 three and four triangles on an edge"
        | "HC-20 winding without a side"
        | "HC-22 vertex on an edge" => Holds { bound: reach },
        // The window follows what is seen in steps, and its texels are up to an eighth of an octave larger.
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
        | "K20 long horizon" => Holds { bound: reach * 0.125_f64.exp2() },
        "HC-04 thin wall" | "HC-05 cube" => Holds { bound: gap },
        // Reversed float depth keeps 1 part in 2^23 of the distance, and the lookup's rounding is bounded relative
        // to it; the case needs 1 in 10000.
        "HC-13 depth precision" | "HC-13 depth precision, near caster" => Holds { bound: 0.0 },
        "HC-11 seams of a cube" => Holds { bound: seams(omni, omni == Omni::Cube) },
        "HC-11 seams of a tetrahedron" => Holds { bound: seams(omni, omni == Omni::Tetrahedron) },
        "HC-11 seams of an isocube" => Holds { bound: seams(omni, omni == Omni::Isocube) },
        "HC-11 seams of a paraboloid" => {
            let own = matches!(omni, Omni::DualParaboloid | Omni::WarpedParaboloid);
            Holds { bound: seams(omni, own) }
        }
        // Perspective keeps lines straight and depths on them right; charts are traced texel by texel.
        "HC-12 two triangles below the light" | "HC-38 depth along a long edge" => {
            Holds { bound: 0.0 }
        }
        // The nearest depth is a caster's wherever one is drawn, open or closed; a convex body lies behind its
        // tangent planes; and where bodies meet, all that is judged lies beyond the kernel.
        "HC-06 open sheet"
        | "HC-07 post under a lid"
        | "HC-08 sphere's limb"
        | "HC-09 boxes in each other"
        | "HC-10 triangles below a texel" => Holds { bound: 0.0 },
        // All f32 positions are relative to an origin near the scene.
        "HC-14 far from the origin" => Holds { bound: 0.0 },
        // Casters beyond the hull of what is seen and the light move no window, and are behind every receiver.
        "HC-28 downstairs" => Holds { bound: 0.0 },
        // A map knows neither eye nor near plane nor far plane, nor how many casters lie upon one another.
        "HC-15 eye in shadow"
        | "HC-16 boundary near the eye"
        | "HC-16 boundary through the eye"
        | "HC-18 sheets"
        | "HC-18 256 sheets"
        | "HC-25 caster not seen" => Holds { bound: 0.0 },
        // A map is fitted to what casts on what is seen, wherever either is, and however much or little that is.
        "K3 light along the view"
        | "K7 slab behind the camera"
        | "K7 crossing triangle"
        | "K8 spot lights in view"
        | "K9 nothing in view"
        | "K10 flat depth" => Holds { bound: 0.0 },
        // Neighbours share their edge's texels, and positions are relative to an origin near the scene.
        "K14 eight thousand kilometres" | "K18 fan" => Holds { bound: 0.0 },
        // Seen edge-on, a triangle covers no texel.
        "HC-21 light in the plane" | "HC-24 light at a corner" => Holds { bound: 0.0 },
        "HC-24 lamp in a cube, in view" => Holds { bound: 0.0 },
        "HC-31 wire below a texel" => wire(radius, size, texel),
        "K5 far fence" => Holds { bound: fence(reach, size) },
        // Holes are drawn as such.
        "HC-35 checker" => Holds { bound: 0.0 },
        "HC-35 checker of texels" => Holds { bound: checker(radius, size) },
        "HC-22 T-junction" => Holds { bound: isolated(radius, size) },
        // Edge-on or above the light a caster hides nothing below; around it, everything.
        "HC-24 light at a vertex" | "HC-24 light in a cube" | "HC-24 light on the floor" => {
            Holds { bound: 0.0 }
        }
        // The window moves in whole texels, so that an edge moves by what the rasteriser rounds, 1/256 texel an axis.
        "HC-39 creeping camera" => Holds { bound: moved(1.0 / 256.0, texel, size) },
        // What is seen grows as the camera turns, and now and then takes the texels to the next step: all are others.
        "K15 turning camera" => Holds { bound: moved(1.0, texel, size) },
        // The map is fitted to what can shadow the receivers, wherever that is.
        "HC-40 casters out of view" => Holds { bound: 0.0 },
        _ => return None,
    })
}

/// HC-39 and K15: the mean change of visibility where edges move by up to `shift` texels an axis, in a map that has
/// texels of `texel` ideal ones.
///
/// Of the floor, 6 m of outline lie in every 9 m^2; a texel covers what is seen, 14 m, in steps of 9 % and with the
/// window's own step. As many samples again for the chance of which points lie in so narrow a strip, of 2^14.
fn moved(shift: f64, texel: f64, size: f64) -> f64 {
    let strip = std::f64::consts::SQRT_2 * shift * (14.0 * 1.09 * (texel + 1.0 / size) / size);
    2.0 * (6.0 / 9.0 * strip + 2f64.powi(-14))
}

/// HC-35, squares as large as ideal texels: how far the mean visibility may be off a half.
///
/// Along an axis, texels and squares go in step but for the guard bands, over which the texels gain on the squares. So
/// the signs of what texels see alternate but for as many repetitions as the bands are wide and one for where the first
/// texel falls, and add up to no more than that and the last; of both axes together, the square of it counts. What the
/// samples, 2^14, do not see of that is random: four deviations of a mean of coin flips.
fn checker(radius: f64, size: f64) -> f64 {
    let repetitions = 2.0 * (radius.ceil() + 1.0) + 2.0;
    0.5 * (repetitions / size).powi(2) + 4.0 * 0.5 / 128.0
}

/// K5: how far the mean visibility behind the fence may be off four fifths.
///
/// As the light sees it the fence is 69 m long, and the strip of floor that is looked at 70 m by 0.85 m. Whether a texel's
/// centre lies on a bar is as random as a coin that falls on one side in four of five throws, and so is whether a sample
/// does: four deviations of either mean. Next to the strip's ends, where texels lie beyond the shadow, a fifth is missing.
fn fence(reach: f64, size: f64) -> f64 {
    let texel = 69.0 / size;
    let texels = 70.0 * 0.85 / (texel * texel);
    4.0 * 0.4 / texels.sqrt() + 4.0 * 0.4 / 128.0 + 0.2 * (2.0 * reach * texel / 0.85).min(1.0)
}

/// HC-31: a wire 0.4 ideal texels thick at 30 degrees to the texels' rows, seen under its axis.
///
/// A texel is in the map only if its centre lies within half a thickness of the axis, so what is seen is
/// 1 - w f, with w the wire's thickness in texels and f the density, across the wire, of the kernel about the
/// sample, at 0. One texel, whose centre lies anywhere within half a texel an axis, has f = 1 / cos 30:
/// the most that any kernel has. The least of all that fall off from the middle has the one that is even
/// over the whole reach to either side, radius (cos 30 + sin 30).
fn wire(radius: f64, size: f64, texel: f64) -> Expectation {
    let (sin, cos) = 30_f64.to_radians().sin_cos();
    // The wire is a prism of 8 sides, which from the side is up to a factor cos 22.5 thinner; the map's
    // texels are larger than ideal ones.
    let (thick, thin) = (0.4, 0.4 * 22.5_f64.to_radians().cos() / texel);
    // What is hidden is a mean over the columns of texels that 2.8 m of wire cross, of a map of 20.48 m,
    // at phases that are spread evenly to within one or two columns. In a column it is at most about twice
    // the mean.
    let uneven = 4.0 / (2.8 / 20.48 * size);
    Expectation::KnownLimit {
        at_least: 1.0 - thick / cos * (1.0 + uneven),
        at_most: 1.0 - thin / (2.0 * radius * (sin + cos)) * (1.0 - uneven),
        because: "a caster thinner than a texel is in the map only where a texel's centre falls on it",
    }
}

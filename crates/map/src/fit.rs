//! Light cameras, fitted to the casters in f64.
//!
//! Only casters need to be in the map: a receiver outside its window is lit, and a receiver beyond its far
//! end is compared with the far end. So the window is the casters' extent seen from the light, cut to the
//! light's cone or cube face, plus a guard band for the filter kernel.

use antumbra_gpu::GpuError;
use antumbra_scene::Light;
use glam::{DMat3, DMat4, DVec2, DVec3, DVec4};

/// What a fit needs to know about the map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fitting {
    /// World position of the zero of all `f32` positions, metres.
    pub origin: DVec3,
    /// Side of a layer, texels, >= 1.
    pub size: u32,
    /// Width of the band around the casters that stays free of them, texels: the kernel's radius and one
    /// more. On a map too small for it the band shrinks to what leaves one texel.
    pub guard: u32,
}

/// A fitted view of a light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FittedView {
    /// Points relative to the origin to clip space, reversed depth, or what else the layout's projection makes
    /// of a matrix; `None` where no caster falls into the view.
    pub clip: Option<DMat4>,
    /// xyz position relative to the origin and w = 1, or the unit direction towards the light and w = 0.
    pub light: DVec4,
}

/// A caster nearer to a positional light than this share of the farthest caster's distance is cut off when
/// the light stands amid the casters. Reversed float depth keeps its relative precision whatever the near
/// plane, so the share only has to be far below any distance that matters: 2^-14 is 6 mm at 100 m.
pub(crate) const NEAREST_SHARE: f64 = 1.0 / 16384.0;

/// Fits the views of [`crate::Layout::of`] `light` to casters whose convex hull is that of `hull` (world space).
///
/// # Errors
/// A light with non-finite numbers, a zero direction, or a cone that is not within (0, 90) degrees.
pub fn fit(light: &Light, hull: &[DVec3], fitting: &Fitting) -> Result<Vec<FittedView>, GpuError> {
    validate(light)?;
    let points: Vec<DVec3> = hull.iter().map(|p| *p - fitting.origin).collect();
    let place = |p: DVec3| (p - fitting.origin).extend(1.0);
    Ok(match *light {
        Light::Directional { direction, .. } => {
            let to_light = -direction.normalize();
            let clip = orthographic(to_light, &points, fitting);
            vec![FittedView { clip, light: to_light.extend(0.0) }]
        }
        Light::Spot { position, direction, outer_angle } => {
            let basis = basis(-direction.normalize());
            let light = place(position);
            let clip = perspective(
                light.truncate(),
                basis,
                DVec2::splat(outer_angle.tan()),
                &points,
                fitting,
            );
            vec![FittedView { clip, light }]
        }
        Light::Point { position: center }
        | Light::Sphere { center, .. }
        | Light::Rect { center, .. }
        | Light::Disc { center, .. } => {
            let light = place(center);
            let face = |axis: DVec3| {
                let clip =
                    perspective(light.truncate(), basis(-axis), DVec2::ONE, &points, fitting);
                FittedView { clip, light }
            };
            [DVec3::X, -DVec3::X, DVec3::Y, -DVec3::Y, DVec3::Z, -DVec3::Z].map(face).to_vec()
        }
    })
}

pub(crate) fn validate(light: &Light) -> Result<(), GpuError> {
    let invalid = |what, value: String, fix| Err(GpuError::Invalid { what, value, fix });
    if let Light::Directional { direction, .. } | Light::Spot { direction, .. } = *light
        && !(direction.is_finite() && direction.length_squared() > 0.0)
    {
        let fix = "give a finite direction that is not zero";
        return invalid("direction of the light", direction.to_string(), fix);
    }
    if let Some(position) = light.position()
        && !position.is_finite()
    {
        let fix = "give a finite position";
        return invalid("position of the light", position.to_string(), fix);
    }
    if let Light::Spot { outer_angle, .. } = *light
        && !(outer_angle > 0.0 && outer_angle < std::f64::consts::FRAC_PI_2)
    {
        let fix = "use a half angle between 0 and 90 degrees, or a point light";
        return invalid("outer angle of the spot light", outer_angle.to_string(), fix);
    }
    Ok(())
}

/// Rows of a right-handed light basis: right, up, and `back`, the unit vector towards the light.
fn basis(back: DVec3) -> DMat3 {
    let a = back.abs();
    let up = if a.x <= a.y && a.x <= a.z {
        DVec3::X
    } else if a.y <= a.z {
        DVec3::Y
    } else {
        DVec3::Z
    };
    let right = up.cross(back).normalize();
    DMat3::from_cols(right, back.cross(right), back).transpose()
}

/// The interval that `values` span.
fn span(values: impl Iterator<Item = f64>) -> (f64, f64) {
    values.fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), v| (lo.min(v), hi.max(v)))
}

/// Widens [lo, hi], which casters fill, by the guard band on both sides.
fn with_guard((lo, hi): (f64, f64), least: f64, fitting: &Fitting) -> (f64, f64) {
    let (size, guard) = (f64::from(fitting.size), f64::from(fitting.guard));
    let half = (0.5 * (hi - lo)).max(least) * size / (size - 2.0 * guard).max(1.0);
    let middle = 0.5 * (lo + hi);
    (middle - half, middle + half)
}

fn orthographic(to_light: DVec3, points: &[DVec3], fitting: &Fitting) -> Option<DMat4> {
    if points.is_empty() {
        return None;
    }
    let basis = basis(to_light);
    let axis = |i: usize| span(points.iter().map(|p| basis.row(i).dot(*p)));
    let (x, y, z) = (axis(0), axis(1), axis(2));
    let extent = (x.1 - x.0).max(y.1 - y.0).max(z.1 - z.0);
    let farthest = points.iter().map(|p| p.length()).fold(0.0, f64::max);
    // A flat or distant set still needs a window and a depth range that f32 resolves: 2^-20 of the
    // coordinates is 16 of their steps.
    let least = (extent.max(farthest) * 2f64.powi(-20)).max(f64::from(f32::MIN_POSITIVE));
    let (left, right) = with_guard(x, least, fitting);
    let (bottom, top) = with_guard(y, least, fitting);
    // The nearest caster must not be clipped nor the farthest be mistaken for an empty texel, so the range
    // reaches beyond both by more than the rounding of a transformed vertex.
    let pad = (z.1 - z.0) * 2f64.powi(-12) + least;
    let (far, near) = (z.0 - pad, z.1 + pad);
    let scale = DVec3::new(2.0 / (right - left), 2.0 / (top - bottom), 1.0 / (near - far));
    let shift = DVec3::new(
        -(right + left) / (right - left),
        -(top + bottom) / (top - bottom),
        -far / (near - far),
    );
    let linear = DMat3::from_diagonal(scale) * basis;
    Some(DMat4::from_mat3_translation(linear, shift))
}

/// A perspective view from `eye` down -z of `basis`, at most `tan_limit` wide on either side, with infinite
/// reversed depth: z = near / distance, which f32 keeps to a relative 2^-24 at every distance.
pub(crate) fn perspective(
    eye: DVec3,
    basis: DMat3,
    tan_limit: DVec2,
    points: &[DVec3],
    fitting: &Fitting,
) -> Option<DMat4> {
    let local: Vec<DVec3> = points.iter().map(|p| basis * (*p - eye)).collect();
    let (nearest, farthest) = span(local.iter().map(|p| -p.z));
    if local.is_empty() || farthest <= 0.0 {
        return None;
    }
    let near = (nearest * (1.0 - 2f64.powi(-8))).max(farthest * NEAREST_SHARE);
    // With every point in front of the eye the hull's projection is the projections' hull.
    let window = |i: usize| {
        let tan_limit = tan_limit[i];
        let (lo, hi) = if nearest >= near {
            span(local.iter().map(|p| p[i] / -p.z))
        } else {
            (-tan_limit, tan_limit)
        };
        let (lo, hi) = (lo.max(-tan_limit), hi.min(tan_limit));
        let least = tan_limit * 2f64.powi(-20);
        (lo <= hi).then(|| with_guard((lo, hi), least, fitting))
    };
    let ((left, right), (bottom, top)) = (window(0)?, window(1)?);
    let projection = DMat4::from_cols(
        DVec4::new(2.0 / (right - left), 0.0, 0.0, 0.0),
        DVec4::new(0.0, 2.0 / (top - bottom), 0.0, 0.0),
        DVec4::new((right + left) / (right - left), (top + bottom) / (top - bottom), 0.0, -1.0),
        DVec4::new(0.0, 0.0, near, 0.0),
    );
    Some(projection * DMat4::from_mat3_translation(basis, basis * -eye))
}

#[cfg(test)]
mod tests {
    use super::*;

    const FITTING: Fitting = Fitting { origin: DVec3::ZERO, size: 256, guard: 2 };

    fn cube_corners(center: DVec3, half: f64) -> Vec<DVec3> {
        (0..8)
            .map(|i| {
                let sign = |bit: usize| if i >> bit & 1 == 0 { -1.0 } else { 1.0 };
                center + half * DVec3::new(sign(0), sign(1), sign(2))
            })
            .collect()
    }

    fn lights() -> Vec<Light> {
        vec![
            Light::Directional { direction: DVec3::NEG_Y, angular_diameter: 0.0 },
            Light::Directional { direction: DVec3::new(0.3, -1.0, 0.2), angular_diameter: 0.0 },
            Light::Spot { position: DVec3::Y * 9.0, direction: DVec3::NEG_Y, outer_angle: 0.7 },
            Light::Point { position: DVec3::new(0.1, 0.2, 0.3) },
            Light::Point { position: DVec3::new(0.0, 7.0, 1.0) },
        ]
    }

    #[test]
    fn every_caster_in_reach_lands_inside_the_guard_band() {
        let points = cube_corners(DVec3::ZERO, 1.0);
        let inner = 1.0 - 2.0 * f64::from(FITTING.guard) / f64::from(FITTING.size) + 1e-12;
        for light in lights() {
            let views = fit(&light, &points, &FITTING).expect("the light is valid");
            for p in &points {
                let seen = views.iter().filter_map(|v| v.clip).any(|clip| {
                    let c = clip * p.extend(1.0);
                    c.w > 0.0
                        && c.x.abs() <= c.w * inner
                        && c.y.abs() <= c.w * inner
                        && c.z > 0.0
                        && c.z < c.w
                });
                assert!(seen, "{light:?} misses the caster corner {p}");
            }
        }
    }

    #[test]
    fn depth_decreases_away_from_the_light() {
        for light in lights() {
            let views =
                fit(&light, &cube_corners(DVec3::ZERO, 1.0), &FITTING).expect("valid light");
            let view = views.iter().find(|v| v.clip.is_some()).expect("a view with casters");
            let clip = view.clip.expect("a view with casters");
            let away = match light {
                Light::Directional { direction, .. } => direction,
                _ => -clip.row(3).truncate() * -1.0,
            };
            let depth = |p: DVec3| clip.project_point3(p).z;
            let p = view.light.truncate() * view.light.w + away.normalize() * 5.0;
            assert!(depth(p) > depth(p + away), "{light:?} has no reversed depth");
        }
    }

    #[test]
    fn a_light_without_casters_needs_no_view() {
        for light in lights() {
            let views = fit(&light, &[], &FITTING).expect("the light is valid");
            assert!(views.iter().all(|v| v.clip.is_none()), "{light:?} has a view of nothing");
        }
    }

    #[test]
    fn casters_outside_the_cone_or_behind_the_light_need_no_view() {
        let spot = Light::Spot { position: DVec3::ZERO, direction: DVec3::NEG_Y, outer_angle: 0.3 };
        for center in [DVec3::new(9.0, -3.0, 0.0), DVec3::Y * 5.0] {
            let views = fit(&spot, &cube_corners(center, 1.0), &FITTING).expect("valid light");
            assert_eq!(views[0].clip, None, "casters at {center} cannot be seen");
        }
    }

    #[test]
    fn bad_lights_are_refused_with_a_reason() {
        let bad = [
            Light::Directional { direction: DVec3::ZERO, angular_diameter: 0.0 },
            Light::Directional { direction: DVec3::NAN, angular_diameter: 0.0 },
            Light::Point { position: DVec3::INFINITY },
            Light::Spot { position: DVec3::ZERO, direction: DVec3::X, outer_angle: 1.6 },
            Light::Spot { position: DVec3::ZERO, direction: DVec3::X, outer_angle: 0.0 },
        ];
        for light in bad {
            let refused = fit(&light, &cube_corners(DVec3::ZERO, 1.0), &FITTING);
            assert!(matches!(refused, Err(GpuError::Invalid { .. })), "{light:?} passed");
        }
    }

    #[test]
    fn degenerate_casters_still_give_finite_views() {
        for light in lights() {
            for points in [vec![DVec3::ZERO], vec![DVec3::ZERO, DVec3::X], vec![DVec3::splat(1e6)]]
            {
                for size in [1, 2, 8192] {
                    let fitting = Fitting { size, ..FITTING };
                    for view in fit(&light, &points, &fitting).expect("valid light") {
                        let finite = view.clip.is_none_or(|c| c.as_mat4().is_finite());
                        assert!(finite, "{light:?} over {points:?}: {view:?}");
                    }
                }
            }
        }
    }
}

//! The window that a virtual map covers: all casters under the light, wherever the camera is.
//!
//! Pages last as long as their window does. So the window knows nothing of the camera, and stands on a grid about the
//! frame's origin: its sides grow in steps and move in sixteenths of themselves, and casters that move within it leave it
//! as it is. What
//! a window around all casters is too coarse for, finer levels make up: pages that nobody asks for cost nothing.

use antumbra_map::{FittedView, basis};
use antumbra_scene::Light;
use glam::{DMat3, DMat4, DVec3, DVec4};

/// Steps of a window's size per doubling: 9 % are lost at most.
const STEPS: f64 = 8.0;
/// Places of a window per its own width.
const PLACES: f64 = 16.0;
/// Texels around the casters that stay free of them: one for what the rasteriser moves, one for a sample at the border.
const GUARD: f64 = 2.0;
/// A caster nearer to a positional light than this share of the farthest one's distance is cut off where the light stands
/// amid the casters: 6 mm at 100 m. Reversed float depth keeps its relative precision whatever the near plane.
const NEAREST_SHARE: f64 = 1.0 / 16384.0;

/// The window of a directional or spot light over casters whose convex hull is that of `hull` (world space), for a virtual
/// map of `texels` a side. Its matrix takes points relative to `origin`; there is none without a caster. `None` for
/// lights that shine all around.
#[must_use]
pub fn window(light: &Light, hull: &[DVec3], origin: DVec3, texels: u32) -> Option<FittedView> {
    match *light {
        Light::Directional { direction, .. } => {
            let to_light = -direction.normalize();
            let clip = (!hull.is_empty()).then(|| parallel(to_light, hull, origin, texels));
            Some(FittedView { clip, light: to_light.extend(0.0) })
        }
        Light::Spot { position, direction, outer_angle } => {
            let basis = basis(-direction.normalize());
            let clip = cone(position, &basis, outer_angle.tan(), hull, origin);
            Some(FittedView { clip, light: (position - origin).extend(1.0) })
        }
        _ => None,
    }
}

/// How much wider than the casters a window is at most.
pub(super) fn largest_share(texels: f64) -> f64 {
    (1.0 / STEPS).exp2() / free_share(GUARD / texels)
}

/// What is left of a window for casters wherever it stands, given its guard band.
fn free_share(guard: f64) -> f64 {
    (1.0 - 1.0 / PLACES - 2.0 * guard).max(1.0 / PLACES)
}

/// An interval that holds [lo, hi] and the share `guard` of its own width to either side: of a width in steps, at a
/// multiple of a sixteenth of it.
fn stand((lo, hi): (f64, f64), least: f64, guard: f64) -> (f64, f64) {
    let needed = (hi - lo).max(least) / free_share(guard);
    let width = ((needed.log2() * STEPS).ceil() / STEPS).exp2();
    let place = width / PLACES;
    let begin = ((lo - guard * width) / place).floor() * place;
    (begin, begin + width)
}

fn span(values: impl Iterator<Item = f64>) -> (f64, f64) {
    values.fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), v| (lo.min(v), hi.max(v)))
}

fn parallel(to_light: DVec3, hull: &[DVec3], origin: DVec3, texels: u32) -> DMat4 {
    let basis = basis(to_light);
    let axes = [0, 1, 2].map(|i| span(hull.iter().map(|p| basis.row(i).dot(*p - origin))));
    let extent = axes.iter().map(|a| a.1 - a.0).fold(0.0, f64::max);
    let farthest = hull.iter().map(|p| p.distance(origin)).fold(0.0, f64::max);
    // A flat or distant set still needs a window that f32 resolves: 2^-20 of the coordinates is 16 of their steps.
    let least = (extent.max(farthest) * 2f64.powi(-20)).max(f64::from(f32::MIN_POSITIVE));
    let aside = |i: usize| stand(axes[i], least, GUARD / f64::from(texels));
    let ((left, right), (bottom, top)) = (aside(0), aside(1));
    // No caster may be clipped nor be mistaken for an empty texel, whatever rounding makes of it.
    let pad = (axes[2].1 - axes[2].0) * 2f64.powi(-12) + least;
    let (far, near) = stand((axes[2].0 - pad, axes[2].1 + pad), least, 0.0);
    let scale = DVec3::new(2.0 / (right - left), 2.0 / (top - bottom), 1.0 / (near - far));
    let offset = DVec3::new(right + left, top + bottom, far) * DVec3::new(0.5, 0.5, 1.0);
    let linear = DMat3::from_diagonal(scale) * basis;
    DMat4::from_mat3_translation(linear, -offset * scale)
}

/// All of a cone, whose width does not depend on casters, with infinite reversed depth near / distance.
fn cone(eye: DVec3, basis: &DMat3, tan_limit: f64, hull: &[DVec3], origin: DVec3) -> Option<DMat4> {
    let (nearest, farthest) = span(hull.iter().map(|p| basis.row(2).dot(eye - *p)));
    if hull.is_empty() || farthest <= 0.0 {
        return None;
    }
    // A power of two, so that it stays where it is while casters move.
    let near = (nearest * (1.0 - 2f64.powi(-8))).max(farthest * NEAREST_SHARE);
    let projection = DMat4::from_cols(
        DVec4::X / tan_limit,
        DVec4::Y / tan_limit,
        -DVec4::W,
        DVec4::Z * near.log2().floor().exp2(),
    );
    Some(projection * DMat4::from_mat3_translation(*basis, *basis * (origin - eye)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn corners(center: DVec3, half: DVec3) -> Vec<DVec3> {
        let side = |bit: i32| if bit == 0 { -1.0 } else { 1.0 };
        (0..8).map(|i| center + half * DVec3::new(side(i & 1), side(i & 2), side(i & 4))).collect()
    }

    fn lights() -> [Light; 3] {
        [
            Light::Directional { direction: DVec3::new(0.4, -1.0, 0.3), angular_diameter: 0.0 },
            Light::Directional { direction: DVec3::NEG_Y, angular_diameter: 0.0 },
            Light::Spot {
                position: DVec3::new(0.0, 40.0, 0.0),
                direction: DVec3::new(0.1, -1.0, 0.0),
                outer_angle: 0.7,
            },
        ]
    }

    #[test]
    fn all_casters_lie_in_the_window_with_room_for_the_guard_band() {
        for light in lights() {
            for k in 0..50 {
                let k = f64::from(k);
                let half = DVec3::new(1.0 + 0.3 * k, 0.0, 5.0);
                let center = DVec3::new(7.3 * (k * 0.7).sin(), 1.0, 0.9 * (k * 1.3).cos());
                let (hull, origin) = (corners(center, half), DVec3::new(3.0, -2.0, 0.1 * k));
                let view = window(&light, &hull, origin, 1024).expect("a window");
                let clip = view.clip.expect("casters");
                let places: Vec<DVec3> =
                    hull.iter().map(|p| clip.project_point3(*p - origin)).collect();
                let depths = span(places.iter().map(|p| p.z));
                assert!(depths.0 > 0.0 && depths.1 < 1.0, "{light:?}, {k}: {depths:?}");
                let Light::Directional { .. } = light else { continue };
                for axis in 0..2 {
                    let (lo, hi) = span(places.iter().map(|p| p[axis]));
                    // Two texels of 1024, in normalised coordinates.
                    let inner = 1.0 - 4.0 / 1024.0 + 1e-12;
                    assert!(lo >= -inner && hi <= inner, "{light:?}, {k}: {lo} to {hi}");
                    let least = 2.0 / largest_share(1024.0) - 1e-9;
                    assert!(hi - lo >= least, "{light:?}, {k}: {lo} to {hi} is a waste");
                }
            }
        }
    }

    #[test]
    fn the_window_stands_still_while_casters_move_within_it() {
        for light in lights() {
            let at = |shift: f64| {
                let hull = corners(DVec3::new(2.0 + shift, 1.0, 0.5), DVec3::new(5.0, 1.0, 6.0));
                window(&light, &hull, DVec3::ZERO, 4096)
                    .and_then(|view| view.clip)
                    .expect("casters")
            };
            let still = at(0.0);
            assert_eq!(at(0.01), still, "{light:?}: a centimetre");
            // The control: casters that leave the window take it with them.
            let Light::Directional { .. } = light else { continue };
            assert_ne!(at(30.0), still, "{light:?}: farther off");
        }
    }

    #[test]
    fn lights_all_around_have_none_and_no_casters_no_matrix() {
        let point = Light::Point { position: DVec3::ZERO };
        assert_eq!(window(&point, &[DVec3::X], DVec3::ZERO, 64), None, "a point light");
        for light in lights() {
            let view = window(&light, &[], DVec3::ZERO, 64).expect("a window");
            assert_eq!(view.clip, None, "{light:?}");
        }
    }
}

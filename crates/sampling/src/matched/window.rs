//! The window that a virtual map covers: all casters under the light, wherever the camera is.
//!
//! Pages last as long as their window does. So the window knows nothing of the camera, has room around the casters, and
//! stays where it is until they leave it. What a window around all casters is too coarse for, finer levels make up: pages
//! that nobody asks for cost nothing.

use antumbra_map::{FittedView, SeenView, basis};
use antumbra_scene::Light;
use glam::{DMat3, DMat4, DVec3, DVec4};

/// Steps of a cone's far end per doubling.
const STEPS: f64 = 8.0;
/// Room for casters to move in, to either side, as a share of their extent: what their movement costs in resolution, at once,
/// or in pages drawn anew, time and again.
const ROOM: f64 = 1.0 / 16.0;
/// Texels around the casters that stay free of them: one for what the rasteriser moves, one for a sample at the border.
const GUARD: f64 = 2.0;
/// A caster nearer to a positional light than this share of the farthest one's distance is cut off where the light stands
/// amid the casters: 6 mm at 100 m. Reversed float depth keeps its relative precision whatever the near plane.
const NEAREST_SHARE: f64 = 1.0 / 16384.0;

/// The windows of a light over casters whose convex hull is that of `hull` (world space), for a virtual map of `texels` a
/// side: one of a directional or spot light, six faces of a cube of the others. Their matrices take points relative to
/// `origin`. With `receivers`, what only receives is drawn, too: depth then goes on behind the last caster. `standing` is
/// what the frame before left, and is kept up.
#[must_use]
pub fn windows(
    light: &Light,
    hull: &[DVec3],
    origin: DVec3,
    texels: u32,
    receivers: bool,
    standing: &mut Standing,
) -> Vec<SeenView> {
    let tan_limit = match *light {
        Light::Directional { direction, .. } => {
            let to_light = -direction.normalize();
            return vec![parallel(to_light, hull, origin, texels, receivers, standing)];
        }
        Light::Spot { outer_angle, .. } => outer_angle.tan(),
        // What rounding puts beyond a seam is still in the face.
        _ => 1.0 + 2.0 * GUARD / f64::from(texels),
    };
    let (eye, axes) = match *light {
        Light::Spot { position, direction, .. } => (position, vec![direction.normalize()]),
        _ => {
            let axes = [DVec3::X, -DVec3::X, DVec3::Y, -DVec3::Y, DVec3::Z, -DVec3::Z];
            (light.position().unwrap_or_default(), axes.to_vec())
        }
    };
    cones(eye, &axes, tan_limit, hull, origin, receivers)
}

/// The window of the frame before: under parallel light its intervals across and along the light, metres from the origin.
#[derive(Clone, Copy, Debug, Default)]
pub struct Standing {
    to_light: DVec3,
    intervals: [(f64, f64); 3],
}

/// How much wider than the casters a new window is.
pub(super) fn share(texels: f64) -> f64 {
    1.0 + 2.0 * ROOM + 2.0 * guard(texels)
}

/// The guard band, as a share of the casters' extent.
fn guard(texels: f64) -> f64 {
    GUARD * (1.0 + 2.0 * ROOM) / (texels - 2.0 * GUARD).max(1.0)
}

/// The interval that was kept, where it still holds [lo, hi] with the share `guard` to either side and is not twice as wide as
/// a new one; or else a new one, with room.
fn stand(kept: (f64, f64), (lo, hi): (f64, f64), least: f64, guard: f64) -> (f64, f64) {
    let extent = (hi - lo).max(least);
    let (middle, half) = (0.5 * (lo + hi), 0.5 * extent);
    let around =
        |share: f64| (middle - half * (1.0 + 2.0 * share), middle + half * (1.0 + 2.0 * share));
    let (needed, new) = (around(guard), around(ROOM + guard));
    let holds = kept.0 <= needed.0 && needed.1 <= kept.1;
    let wide = kept.1 - kept.0 > 2.0 * (new.1 - new.0);
    if holds && !wide { kept } else { new }
}

fn span(values: impl Iterator<Item = f64>) -> (f64, f64) {
    values.fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), v| (lo.min(v), hi.max(v)))
}

/// The next step at or above `x`.
fn step_up(x: f64) -> f64 {
    ((x.log2() * STEPS).ceil() / STEPS).exp2()
}

fn seen(light: DVec4, fit: Option<(DMat4, [DVec3; 2])>) -> SeenView {
    let (clip, ends) = fit.unzip();
    // Where casters end is not told from where receivers do.
    let ends = ends.map(|[near, far]: [DVec3; 2]| [near, far, far]);
    SeenView { view: FittedView { clip, light }, volume: Vec::new(), ends }
}

fn parallel(
    to_light: DVec3,
    hull: &[DVec3],
    origin: DVec3,
    texels: u32,
    receivers: bool,
    standing: &mut Standing,
) -> SeenView {
    let light = to_light.extend(0.0);
    if hull.is_empty() {
        return seen(light, None);
    }
    let basis = basis(to_light);
    let axes = [0, 1, 2].map(|i| span(hull.iter().map(|p| basis.row(i).dot(*p - origin))));
    let extent = axes.iter().map(|a| a.1 - a.0).fold(0.0, f64::max);
    let farthest = hull.iter().map(|p| p.distance(origin)).fold(0.0, f64::max);
    // A flat or distant set still needs a window that f32 resolves: 2^-20 of the coordinates is 16 of their steps.
    let least = (extent.max(farthest) * 2f64.powi(-20)).max(f64::from(f32::MIN_POSITIVE));
    if standing.to_light != to_light {
        *standing = Standing { to_light, ..Standing::default() };
    }
    let kept = standing.intervals;
    let aside = |i: usize| stand(kept[i], axes[i], least, guard(f64::from(texels)));
    let ((left, right), (bottom, top)) = (aside(0), aside(1));
    // No caster may be clipped nor be mistaken for an empty texel, whatever rounding makes of it.
    let pad = (axes[2].1 - axes[2].0) * 2f64.powi(-12) + least;
    let (mut far, near) = stand(kept[2], (axes[2].0 - pad, axes[2].1 + pad), least, 0.0);
    standing.intervals = [(left, right), (bottom, top), (far, near)];
    if receivers {
        // As far again, or as the window is wide.
        far -= (near - far).max(right - left);
    }
    let scale = DVec3::new(2.0 / (right - left), 2.0 / (top - bottom), 1.0 / (near - far));
    let offset = DVec3::new(right + left, top + bottom, 2.0 * far) * 0.5;
    let linear = DMat3::from_diagonal(scale) * basis;
    let clip = DMat4::from_mat3_translation(linear, -offset * scale);
    seen(light, Some((clip, [near, far].map(|z| to_light * z))))
}

/// All of each cone, whose width does not depend on casters, with infinite reversed depth near / distance. Near and far are
/// the same of all, so that pages of all may share a store, and in steps, so that they stay where they are while casters
/// move.
fn cones(
    eye: DVec3,
    axes: &[DVec3],
    tan_limit: f64,
    hull: &[DVec3],
    origin: DVec3,
    receivers: bool,
) -> Vec<SeenView> {
    let spans: Vec<(f64, f64)> =
        axes.iter().map(|axis| span(hull.iter().map(|p| axis.dot(*p - eye)))).collect();
    let in_front = || spans.iter().filter(|span| span.1 > 0.0);
    let farthest = step_up(in_front().map(|span| span.1).fold(0.0, f64::max));
    let nearest = in_front().map(|span| span.0 * (1.0 - 2f64.powi(-8))).fold(farthest, f64::min);
    let near = nearest.max(farthest * NEAREST_SHARE).log2().floor().exp2();
    let last = if receivers { farthest * (1.0 + (2.0 * tan_limit).max(1.0)) } else { farthest };
    let view = |(axis, span): (&DVec3, &(f64, f64))| {
        let light = (eye - origin).extend(1.0);
        if span.1 <= 0.0 {
            return seen(light, None);
        }
        let basis = basis(-*axis);
        let projection = DMat4::from_cols(
            DVec4::X / tan_limit,
            DVec4::Y / tan_limit,
            -DVec4::W,
            DVec4::Z * near,
        );
        let clip = projection * DMat4::from_mat3_translation(basis, basis * (origin - eye));
        let ends = [near, last].map(|distance| eye - origin + *axis * distance);
        seen(light, Some((clip, ends)))
    };
    axes.iter().zip(&spans).map(view).collect()
}

#[cfg(test)]
mod tests {
    use antumbra_map::{DepthConvention, LinearDepth};

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

    fn window(
        light: &Light,
        hull: &[DVec3],
        texels: u32,
        standing: &mut Standing,
    ) -> Option<DMat4> {
        windows(light, hull, DVec3::new(3.0, -2.0, 0.1), texels, false, standing)[0].view.clip
    }

    #[test]
    fn all_casters_lie_in_the_window_with_room_for_the_guard_band() {
        for light in lights() {
            let mut standing = Standing::default();
            for k in 0..50 {
                let k = f64::from(k);
                let half = DVec3::new(1.0 + 0.3 * k, 0.0, 5.0);
                let center = DVec3::new(7.3 * (k * 0.7).sin(), 1.0, 0.9 * (k * 1.3).cos());
                let (hull, origin) = (corners(center, half), DVec3::new(3.0, -2.0, 0.1));
                let clip = window(&light, &hull, 1024, &mut standing).expect("casters");
                let places: Vec<DVec3> =
                    hull.iter().map(|p| clip.project_point3(*p - origin)).collect();
                let depths = span(places.iter().map(|p| p.z));
                assert!(depths.0 > 0.0 && depths.1 < 1.0, "{light:?}, {k}: {depths:?}");
                let Light::Directional { .. } = light else { continue };
                for axis in 0..2 {
                    let (lo, hi) = span(places.iter().map(|p| p[axis]));
                    // Two texels of 1024, in normalised coordinates, of a window that may be kept at twice the size.
                    let inner = 1.0 - 1.9 / 1024.0;
                    assert!(lo >= -inner && hi <= inner, "{light:?}, {k}: {lo} to {hi}");
                    let least = 1.0 / share(1024.0) - 1e-9;
                    assert!(hi - lo >= least, "{light:?}, {k}: {lo} to {hi} is a waste");
                }
            }
        }
    }

    #[test]
    fn the_window_stands_still_while_casters_move_within_it() {
        for light in lights() {
            let at = |shift: f64, standing: &mut Standing| {
                let hull = corners(DVec3::new(2.0 + shift, 1.0, 0.5), DVec3::new(5.0, 1.0, 6.0));
                window(&light, &hull, 4096, standing).expect("casters")
            };
            let mut standing = Standing::default();
            let still = at(0.0, &mut standing);
            for shift in [0.01, 0.3, -0.3, 0.0] {
                assert_eq!(at(shift, &mut standing), still, "{light:?}: by {shift} m");
            }
            // The control: casters that leave the window take it with them.
            let Light::Directional { .. } = light else { continue };
            assert_ne!(at(3.0, &mut standing), still, "{light:?}: by 3 m");
        }
    }

    #[test]
    fn receivers_lie_between_the_ends_which_all_faces_share() {
        let hull = corners(DVec3::new(0.5, 2.0, 0.0), DVec3::new(3.0, 2.0, 4.0));
        let mut all = lights().to_vec();
        all.push(Light::Point { position: DVec3::new(0.2, 6.0, 0.1) });
        for light in all {
            for receivers in [false, true] {
                let views =
                    windows(&light, &hull, DVec3::ONE, 512, receivers, &mut Standing::default());
                let linear: Vec<LinearDepth> = views
                    .iter()
                    .filter_map(|seen| {
                        let convention = DepthConvention::REVERSED_F32;
                        Some(LinearDepth::new(&seen.view.clip?, &seen.ends?, convention))
                    })
                    .collect();
                for depth in &linear {
                    let off = (0..4)
                        .map(|i| (depth.coefficients[i] - linear[0].coefficients[i]).abs())
                        .fold(0.0, f64::max);
                    assert!(off < 1e-9, "{light:?}: faces differ by {off}");
                }
                let [near, _, far] = views.iter().find_map(|seen| seen.ends).expect("casters");
                let reach = (near - far).length();
                assert!(receivers == (reach > 12.0), "{light:?}, {receivers}: {reach} m");
            }
        }
    }

    #[test]
    fn without_casters_there_is_no_matrix() {
        for light in lights() {
            assert_eq!(window(&light, &[], 64, &mut Standing::default()), None, "{light:?}");
        }
        let point = Light::Point { position: DVec3::ZERO };
        let mut standing = Standing::default();
        let views = windows(&point, &[DVec3::X], DVec3::ZERO, 64, false, &mut standing);
        let faces: Vec<bool> = views.iter().map(|seen| seen.view.clip.is_some()).collect();
        assert_eq!(faces, [true, false, false, false, false, false], "a caster at +x");
    }
}

//! From the depth of a map to depth that is linear in distance, which filterable stores need.

use glam::{DMat4, DVec3};

use crate::DepthConvention;

/// Linear depth in [0, 1] as a function of the map's depth d: (x d + y) / (z d + w), clamped, where the
/// denominator is positive, else 1. An empty texel has 1. The twin of `common/linear_depth.wesl`.
///
/// A map keeps depth as the projection gives it, in perspective near / distance, of which means and squares
/// say nothing about distances. Linear depth is distance along the view's axis (the face's axis, for a
/// cube; not the distance from the light, which would bend planes that the axis keeps straight), 0 at the
/// nearest caster. It reaches 1 behind the farthest caster by as much as the casters are deep or the window
/// is wide there, whichever is more. Empty texels count as there. Where receivers are not drawn, so does every one
/// beyond the last caster: a kernel over an empty neighbourhood sees the receiver's own depth, as if it had been
/// drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LinearDepth {
    /// x, y, z, w.
    pub coefficients: [f64; 4],
    /// The depth of an empty texel.
    pub empty: f64,
    /// Linear depth beyond which nothing is drawn: the farthest caster's and 2^-10 more, which is far more than
    /// rounding makes of it and less than any shadow shows; 1 where receivers are drawn.
    pub last: f64,
    /// Linear depth behind which nothing casts: as `last` without receivers; 1 where that is not known.
    pub last_caster: f64,
}

const BEYOND: f64 = 1.0 / 1024.0;

impl LinearDepth {
    /// The function for the projection `clip`, whose depth is one of distance along its axis alone (any orthographic or
    /// perspective camera, of infinite range or not, that is not oblique), or that warps parallel light, where depth
    /// is linear along each ray and is taken as it is; over casters whose
    /// convex hull is that of `hull`, in the space that `clip` takes.
    #[must_use]
    pub fn new(clip: &DMat4, hull: &[DVec3], convention: DepthConvention) -> Self {
        Self::over(clip, hull, convention, end)
    }

    /// The function that is 0 at the first and 1 at the last of three points along the view's axis, between which all
    /// lies that is drawn, what only receives shadows included; casters lie before the second.
    #[must_use]
    pub fn between(clip: &DMat4, ends: &[DVec3; 3], convention: DepthConvention) -> Self {
        let [near, casters, far] = *ends;
        let linear = Self::over(clip, &[near, far], convention, |_, far, _| far);
        let d = clip.project_point3(casters).z;
        let last_caster = (linear.of(d) + BEYOND).min(1.0);
        Self { last: 1.0, last_caster, ..linear }
    }

    /// `end` gives the depth that becomes 1, of the nearest, the farthest and the window's width there.
    fn over(
        clip: &DMat4,
        hull: &[DVec3],
        convention: DepthConvention,
        end: impl Fn(f64, f64, f64) -> f64,
    ) -> Self {
        let (depth, across, w) = (clip.row(2), clip.row(0).truncate(), clip.row(3));
        let axis = w.truncate();
        let empty = f64::from(convention.clear());
        if axis == DVec3::ZERO {
            let order = f64::from(convention.order());
            let depths = hull.iter().map(|p| order * depth.dot(p.extend(1.0)));
            let (near, far) = span(depths);
            // 2 of normalised coordinates across, in metres, times depth a metre.
            let width = 2.0 / across.length() * depth.truncate().length();
            let range = end(near, far, width) - near;
            let last = (far - near) / range + BEYOND;
            return Self {
                coefficients: [order, -near, 0.0, range],
                empty,
                last,
                last_caster: last,
            };
        }
        // Depth is a + b / w.
        let a = depth.truncate().dot(axis) / axis.length_squared();
        let b = depth.w - a * w.w;
        let aslant = depth.truncate() - a * axis;
        if aslant.length() > 1e-6 * depth.truncate().length() {
            // From the near end to behind the far one by as much.
            let order = f64::from(convention.order());
            let near = (order * convention.nearest()).min(order * empty);
            return Self {
                coefficients: [order, -near, 0.0, 2.0],
                empty,
                last: 0.5 + BEYOND,
                last_caster: 1.0,
            };
        }
        // Casters nearer than the near plane are cut off.
        let first = convention.nearest();
        let plane = b / (first - a);
        let (near, far) = span(hull.iter().map(|p| w.dot(p.extend(1.0)).max(plane)));
        let aside = across - axis * (across.dot(axis) / axis.length_squared());
        let width = 2.0 * far / aside.length();
        let range = end(near, far, width) - near;
        let sign = b.signum();
        let last = (far - near) / range + BEYOND;
        Self {
            coefficients: [-near, b + near * a, range, -a * range].map(|c| c * sign),
            empty,
            last,
            last_caster: last,
        }
    }

    /// The function for a curved view from `eye`, whose depth is `near` over the distance from the light: linear in
    /// that distance.
    #[must_use]
    pub fn radial(near: f64, eye: DVec3, hull: &[DVec3]) -> Self {
        let (first, last) = span(hull.iter().map(|p| p.distance(eye).max(near)));
        // A window as wide as what it shows is deep.
        let range = end(first, last, 2.0 * last) - first;
        let last = (last - first) / range + BEYOND;
        Self { coefficients: [-first, near, range, 0.0], empty: 0.0, last, last_caster: last }
    }

    /// The same function for a map that holds receivers too: nothing needs to be put where it is not.
    #[must_use]
    pub fn with_receivers(self) -> Self {
        Self { last: 1.0, ..self }
    }

    /// Linear depth of a texel that holds `d`.
    #[must_use]
    pub fn of_texel(&self, d: f64) -> f64 {
        if d == self.empty { 1.0 } else { self.of(d) }
    }

    /// Linear depth of the depth `d`, which for a receiver may lie beyond the map's.
    #[must_use]
    pub fn of(&self, d: f64) -> f64 {
        let [x, y, z, w] = self.coefficients;
        let denominator = z * d + w;
        if denominator > 0.0 { ((x * d + y) / denominator).clamp(0.0, 1.0) } else { 1.0 }
    }
}

fn span(values: impl Iterator<Item = f64>) -> (f64, f64) {
    values.fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), v| (lo.min(v), hi.max(v)))
}

fn end(near: f64, far: f64, width: f64) -> f64 {
    far + (far - near).max(width)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Fitting, fit};
    use antumbra_scene::Light;
    use glam::DVec4;

    /// Depth a + b / w of a perspective, as engines make them: forward, reversed, infinite.
    fn perspective(near: f64, far: f64, reversed: bool) -> DMat4 {
        let (a, b) = match (reversed, far.is_finite()) {
            (false, true) => (far / (far - near), -near * far / (far - near)),
            (false, false) => (1.0, -near),
            (true, true) => (-near / (far - near), near * far / (far - near)),
            (true, false) => (0.0, near),
        };
        DMat4::from_cols_array_2d(&[
            [1.5, 0.0, 0.0, 0.0],
            [0.0, 1.5, 0.0, 0.0],
            [0.1, 0.2, -a, -1.0],
            [0.0, 0.0, b, 0.0],
        ])
    }

    #[test]
    fn linear_depth_is_affine_in_distance_for_every_projection() {
        let hull = [DVec3::new(0.0, 0.0, -3.0), DVec3::new(1.0, 1.0, -8.0)];
        for (far, reversed) in
            [(50.0, false), (f64::INFINITY, false), (50.0, true), (f64::INFINITY, true)]
        {
            let clip = perspective(0.5, far, reversed);
            let convention = DepthConvention { reversed, step: 0.0 };
            let linear = LinearDepth::new(&clip, &hull, convention);
            // The window is 2 / 1.5 of the distance 8 m wide, more than the casters are deep.
            let end = 8.0 + 2.0 / 1.5 * 8.0;
            for distance in [0.6, 3.0, 4.7, 8.0, 15.0, end, 40.0] {
                let d = clip.project_point3(DVec3::new(0.3, 0.1, -distance)).z;
                let expected = ((distance - 3.0) / (end - 3.0)).clamp(0.0, 1.0);
                let found = linear.of(d);
                assert!((found - expected).abs() < 1e-12, "{distance} m: {found}, not {expected}");
            }
            let empty = linear.of_texel(f64::from(convention.clear()));
            assert_eq!(empty, 1.0, "an empty texel of far {far}, reversed {reversed}");
        }
    }

    #[test]
    fn the_last_caster_lies_where_it_is_between_the_ends() {
        let at = |distance: f64| DVec3::new(0.0, 0.0, -distance);
        let ends = [at(3.0), at(5.0), at(11.0)];
        let eye = DVec3::new(0.1, 0.2, 20.0);
        // Depth 1 at a distance of 3, 0 at 11.
        let parallel = DMat4::from_translation(DVec3::Z * 11.0 / 8.0)
            * DMat4::from_scale(DVec3::new(1.0, 1.0, 1.0 / 8.0));
        for clip in [perspective(0.5, f64::INFINITY, true), parallel] {
            let linear = LinearDepth::between(&clip, &ends, DepthConvention::REVERSED_F32);
            let of = |p: DVec3| linear.of(clip.project_point3(p).z);
            assert!(of(ends[0]).abs() < 1e-12 && (of(ends[2]) - 1.0).abs() < 1e-12, "{clip}");
            assert!((linear.last_caster - 0.25 - BEYOND).abs() < 1e-12, "{}", linear.last_caster);
            assert_eq!(linear.last, 1.0, "receivers are drawn up to the end");
        }
        // Of casters alone it is where the others say that nothing is drawn any more; round a curved view, too.
        let linear = LinearDepth::radial(0.5, eye, &[eye + at(3.0), eye + at(5.0)]);
        assert_eq!(linear.with_receivers().last_caster, linear.last, "radial");
        let warped = DMat4::from_cols_array_2d(&[
            [1.0, 0.0, 0.0, 0.0],
            [0.0, 1.0, 0.3, -1.0],
            [0.0, 0.0, 1.0, 0.0],
            [0.0, 0.0, 0.0, 1.0],
        ]);
        let linear = LinearDepth::new(&warped, &ends, DepthConvention::REVERSED_F32);
        assert_eq!(linear.last_caster, 1.0, "not known where depth is no distance along the axis");
    }

    #[test]
    fn fitted_lights_have_the_nearest_caster_at_0_and_room_behind_the_farthest() {
        let hull: Vec<DVec3> = (0..8)
            .map(|i| DVec3::new(f64::from(i & 1), f64::from(i >> 1 & 1), f64::from(i >> 2)))
            .collect();
        let mut views_checked = 0;
        let flat: Vec<DVec3> = hull.iter().map(|p| p.with_y(0.0)).collect();
        for light in [
            Light::Directional { direction: DVec3::NEG_Y, angular_diameter: 0.0 },
            Light::Directional { direction: DVec3::new(0.4, -1.0, 0.2), angular_diameter: 0.0 },
            Light::Point { position: DVec3::new(0.5, 4.0, 0.5) },
        ] {
            for hull in [&hull, &flat] {
                let fitting =
                    Fitting { origin: DVec3::ZERO, size: 64, guard: 2, receivers: false, grid: 1 };
                let views = fit(&light, hull, &fitting).expect("a valid light");
                for clip in views.iter().filter_map(|v| v.clip) {
                    let linear = LinearDepth::new(&clip, hull, DepthConvention::REVERSED_F32);
                    assert_eq!(linear.of_texel(0.0), 1.0, "{light:?}: an empty texel");
                    // Faces of a cube that the casters straddle hold none of their corners.
                    let inside = |c: DVec4| c.w > 0.0 && c.truncate().abs().max_element() <= c.w;
                    let seen = hull.iter().map(|p| clip * p.extend(1.0)).filter(|c| inside(*c));
                    let depths: Vec<f64> = seen.map(|c| linear.of(c.z / c.w)).collect();
                    if depths.len() < hull.len() {
                        continue;
                    }
                    views_checked += 1;
                    let (least, most) = span(depths.into_iter());
                    assert!(least.abs() < 1e-9, "{light:?}: the nearest caster at {least}");
                    assert!(most <= 0.5 + 1e-9, "{light:?}: the farthest caster at {most}");
                }
            }
        }
        assert_eq!(views_checked, 6, "one view for each light and hull");
    }
}

//! How finely a shadow map must sample: the error of a texel under the beams of eye and light, and how many texels a
//! parametrisation needs (Lloyd 2007; Lloyd, Govindaraju, Quammen, Molnar, Manocha 2008; *Real-Time Shadows* 3.2).
//!
//! All of it is for a map whose t runs along the view axis and whose s runs across it, so that a texel's sides follow
//! from one beam each. For any other map, measure.

use glam::DVec2;

/// The part of space that a camera sees.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ViewFrustum {
    /// Tangent of half the vertical field of view, > 0.
    pub tan_half: f64,
    /// Width over height of the picture, > 0.
    pub aspect: f64,
    /// Distance of the near plane along the view axis, metres, > 0.
    pub near: f64,
    /// Distance of the far plane, metres, > `near`.
    pub far: f64,
}

/// A point of a surface, as the beams of a pixel and of a texel meet there. Angles are in the plane of view axis and
/// t; x is the component across it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Meeting {
    /// Distance from the eye along the view axis, metres.
    pub depth: f64,
    /// Cosine of the angle between the view axis and the direction to the pixel.
    pub eye_axis: f64,
    /// Cosine of the angle between the eye's beam and the surface's normal.
    pub eye_normal: f64,
    /// Cosine of the angle between the light's axis and the direction to the texel; 1 for parallel light.
    pub light_axis: f64,
    /// Cosine of the angle between the light's beam and the surface's normal.
    pub light_normal: f64,
    /// Distance from the light along its axis in units of that of the light's near plane; 1 for parallel light.
    pub light_depth: f64,
}

/// Widths on the surface, metres: x across the view axis, y along it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Beams {
    /// Of the eye's beam through one pixel (eq. 3.5, 3.6).
    pub pixel: DVec2,
    /// Of the light's beam through one texel (eq. 3.7, 3.8).
    pub texel: DVec2,
}

impl Meeting {
    /// The beams of one of `pixels` of the camera's picture and of one of `texels` of a map, over which the light's
    /// near plane is spread by `spread` metres a unit of (s, t): (du/ds, dv/dt).
    #[must_use]
    pub fn beams(&self, view: &ViewFrustum, pixels: DVec2, spread: DVec2, texels: DVec2) -> Beams {
        let height = 2.0 * view.tan_half * self.depth;
        let pixel =
            DVec2::new(view.aspect * height, height * self.eye_axis / self.eye_normal) / pixels;
        let obliquity = DVec2::new(1.0, self.light_axis / self.light_normal);
        Beams { pixel, texel: spread / texels * self.light_depth * obliquity }
    }

    /// The share of the error along t that comes from the surface's orientation: cos(psi_j) / cos(psi_t). No
    /// parametrisation of the map takes it away.
    #[must_use]
    pub fn projection_error(&self) -> f64 {
        self.eye_normal / self.light_normal
    }
}

impl Beams {
    /// Sampling error (m_s, m_t): the sides of a texel in pixels (eq. 3.9, 3.10).
    #[must_use]
    pub fn error(&self) -> DVec2 {
        self.texel / self.pixel
    }

    /// Perspective error: the sampling error without what the orientation of the surface adds (eq. 3.11, 3.12).
    #[must_use]
    pub fn perspective_error(&self, meeting: &Meeting) -> DVec2 {
        self.error() / DVec2::new(1.0, meeting.projection_error())
    }
}

/// How a map's t is spread over the view axis, and its s across it, under parallel light from overhead.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Parametrisation {
    /// Evenly.
    Uniform,
    /// By a perspective projection whose centre lies `near` metres (> 0) before the near plane of the view.
    Perspective {
        /// Distance from the centre of projection to the view's near plane, metres.
        near: f64,
    },
    /// By the logarithm of depth, which no projection does: the optimum.
    Logarithmic,
}

/// Number of texels along s and t, each in units of the pixels of the picture across and down, that keep the
/// perspective error at 1 or below.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StorageFactor {
    /// (r_s / r_i) M_s.
    pub s: f64,
    /// (r_t / r_j) M_t.
    pub t: f64,
}

impl StorageFactor {
    /// Texels needed a pixel of the picture, for maps of any shape (eq. 3.15).
    #[must_use]
    pub fn texels(&self) -> f64 {
        self.s * self.t
    }

    /// The same for square maps over a square picture: the larger of both counts for both.
    #[must_use]
    pub fn square_texels(&self) -> f64 {
        self.s.max(self.t).powi(2)
    }
}

/// Depths at which a maximum over the view is looked for, besides its ends: errors are smooth, with one extremum at
/// most between the ends, and a maximum of relative curvature c between steps of relative width w is missed by c w² /
/// 8, below 10^-6.
const STEPS: u32 = 4096;

impl ViewFrustum {
    /// Length of the view along its axis, metres.
    fn length(&self) -> f64 {
        self.far - self.near
    }

    /// Width of the view at `depth`, metres.
    fn width(&self, depth: f64) -> f64 {
        2.0 * self.aspect * self.tan_half * depth
    }

    /// (du/ds, dv/dt) of a map over the whole view at `depth`, metres.
    #[must_use]
    pub fn spread(&self, map: Parametrisation, depth: f64) -> DVec2 {
        match map {
            Parametrisation::Uniform => DVec2::new(self.width(self.far), self.length()),
            Parametrisation::Perspective { near } => {
                // t = (1 + e) x / (1 + e x) for x from 0 to 1 along the axis, with e the strength; the width of
                // the map at x is that at 0 times 1 + e x, and must hold the view's at both ends.
                let strength = self.length() / near;
                let at = 1.0 + strength * (depth - self.near) / self.length();
                let first = self.width(self.near).max(self.width(self.far) / (1.0 + strength));
                DVec2::new(first * at, self.length() * at * at / (1.0 + strength))
            }
            Parametrisation::Logarithmic => {
                DVec2::new(self.width(depth), depth * (self.far / self.near).ln())
            }
        }
    }

    /// Perspective error, in units of (r_i / r_s, r_j / r_t), at `depth` metres, seen at the angle of cosine
    /// `eye_axis` to the view axis. The literature on warping takes the axis itself, 1.
    #[must_use]
    pub fn perspective_error(&self, map: Parametrisation, depth: f64, eye_axis: f64) -> DVec2 {
        // The orientation cancels: any surface that both beams meet will do.
        let meeting = Meeting {
            depth,
            eye_axis,
            eye_normal: 1.0,
            light_axis: 1.0,
            light_normal: 1.0,
            light_depth: 1.0,
        };
        let beams = meeting.beams(self, DVec2::ONE, self.spread(map, depth), DVec2::ONE);
        beams.perspective_error(&meeting)
    }

    /// Texels that the map needs: the largest perspective errors over the view (eq. 3.13 to 3.15), for pixels up to
    /// the angle of cosine `eye_axis` from the view axis: 1 for the axis alone, as in the literature on warping, or
    /// [`ViewFrustum::edge`] for all of the picture.
    #[must_use]
    pub fn storage_factor(&self, map: Parametrisation, eye_axis: f64) -> StorageFactor {
        let depth = |i: u32| {
            // Evenly by ratio: errors go by the ratio of depths.
            let ratio = self.far / self.near;
            if i == STEPS {
                self.far
            } else {
                self.near * ratio.powf(f64::from(i) / f64::from(STEPS))
            }
        };
        let errors = (0..=STEPS).map(|i| self.perspective_error(map, depth(i), eye_axis));
        let most = errors.fold(DVec2::ZERO, DVec2::max);
        StorageFactor { s: most.x, t: most.y }
    }

    /// Cosine of the angle between the view axis and the upper edge of the picture.
    #[must_use]
    pub fn edge(&self) -> f64 {
        1.0 / 1.0_f64.hypot(self.tan_half)
    }

    /// The perspective parametrisation whose largest error along the view is least: near + sqrt(near far), where it
    /// is the same at both ends (Wimmer, Scherzer, Purgathofer 2004).
    #[must_use]
    pub fn best_warp(&self) -> Parametrisation {
        Parametrisation::Perspective { near: self.near + (self.near * self.far).sqrt() }
    }

    /// The view cut into `count` parts whose ends are in one ratio.
    pub fn parts(&self, count: u32) -> impl Iterator<Item = Self> + '_ {
        let end = move |i: u32| {
            if i == count {
                self.far
            } else {
                self.near * (self.far / self.near).powf(f64::from(i) / f64::from(count))
            }
        };
        (0..count).map(move |i| Self { near: end(i), far: end(i + 1), ..*self })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The view of the published figures: as wide and as high at its near plane as that is far.
    fn view(near: f64, far: f64) -> ViewFrustum {
        ViewFrustum { tan_half: 0.5, aspect: 1.0, near, far }
    }

    /// To the digits given.
    fn close(found: f64, expected: f64, digits: f64) -> bool {
        (found - expected).abs() <= 0.5 * digits * expected.abs()
    }

    #[test]
    fn storage_factors_are_those_of_the_literature() {
        for (near, far, uniform, perspective, decades) in [
            (1.0, 10.0, 90.0, 9.0, 1.0),
            (1.0, 100.0, 9_900.0, 99.0, 2.0),
            (1.0, 1000.0, 999_000.0, 999.0, 3.0),
            (0.1, 1000.0, 99_990_000.0, 9_999.0, 4.0),
        ] {
            let view = view(near, far);
            let texels = |map| view.storage_factor(map, 1.0).texels();
            assert!(close(texels(Parametrisation::Uniform), uniform, 1e-12), "uniform to {far}");
            // 6.908 texels a pixel for the three decades from 1 m to 1 km.
            let logarithmic = decades * std::f64::consts::LN_10;
            assert!(
                close(texels(Parametrisation::Logarithmic), logarithmic, 1e-12),
                "log to {far}"
            );
            // Any centre between the eye and the best one needs as many.
            for share in [0.0, 0.3, 1.0] {
                let near = view.near + share * (view.near * view.far).sqrt();
                let found = texels(Parametrisation::Perspective { near });
                assert!(close(found, perspective, 1e-9), "{near} to {far}: {found}");
            }
        }
    }

    #[test]
    fn the_best_warp_has_the_least_error_along_the_view() {
        for (near, far, warp, s, t) in [
            (1.0, 10.0, 4.162_28, 3.162_28, 2.846_05),
            (1.0, 100.0, 11.0, 10.0, 9.9),
            (1.0, 1000.0, 32.622_8, 31.622_8, 31.591_2),
            (0.1, 1000.0, 10.1, 100.0, 99.99),
        ] {
            let view = view(near, far);
            let best = view.best_warp();
            let Parametrisation::Perspective { near } = best else { panic!("a warp") };
            let factor = view.storage_factor(best, 1.0);
            assert!(close(near, warp, 1e-5), "{near} to {far}");
            assert!(close(factor.s, s, 1e-5) && close(factor.t, t, 1e-5), "{factor:?} to {far}");
            for other in [0.5, 0.9, 1.1, 2.0] {
                let other = Parametrisation::Perspective { near: near * other };
                assert!(view.storage_factor(other, 1.0).t > factor.t, "{other:?}");
            }
        }
        let error = view(1.0, 100.0).perspective_error(
            Parametrisation::Perspective { near: 11.0 },
            10.0,
            1.0,
        );
        assert!(close(error.y, 3.272_727, 1e-6) && close(error.x, 1.818_182, 1e-6), "{error}");
    }

    #[test]
    fn off_the_axis_pixels_are_narrower_and_need_more_texels() {
        let degrees = |angle: f64, far| ViewFrustum {
            tan_half: (0.5 * angle).to_radians().tan(),
            aspect: 1.0,
            near: 1.0,
            far,
        };
        // far (far - near) / (2 near^2 sin(half angle)).
        for (angle, far, texels) in [(60.0, 100.0, 9_900.0), (90.0, 1000.0, 706_400.0)] {
            let view = degrees(angle, far);
            let found = view.storage_factor(Parametrisation::Uniform, view.edge()).texels();
            assert!(close(found, texels, 1e-4), "{angle} degrees: {found}");
        }
    }

    #[test]
    fn parts_with_ends_in_one_ratio_need_less_in_sum() {
        let sum = |far, count, map: fn(&ViewFrustum) -> Parametrisation| -> f64 {
            view(1.0, far)
                .parts(count)
                .map(|part| part.storage_factor(map(&part), 1.0).texels())
                .sum()
        };
        let uniform = |far, count| sum(far, count, |_| Parametrisation::Uniform);
        let warped = |far, count| sum(far, count, ViewFrustum::best_warp);
        for (count, u, w) in [
            (1, 9900.0, 99.0),
            (2, 180.0, 18.0),
            (3, 50.708_3, 10.924_8),
            (4, 27.350_9, 8.649_11),
            (8, 11.072_0, 6.226_24),
        ] {
            assert!(close(uniform(100.0, count), u, 1e-5), "{count} uniform parts");
            assert!(close(warped(100.0, count), w, 1e-5), "{count} warped parts");
        }
        for (count, u, w) in [
            (1, 999_000.0, 999.0),
            (2, 1936.75, 61.245_6),
            (3, 270.0, 27.0),
            (4, 103.997, 18.493_7),
            (8, 26.016_3, 10.971_0),
        ] {
            assert!(close(uniform(1000.0, count), u, 1e-5), "{count} uniform parts to 1000");
            assert!(close(warped(1000.0, count), w, 1e-5), "{count} warped parts to 1000");
        }
        // Ever more parts come to the logarithm.
        let limit = warped(100.0, 4096);
        assert!((limit - 100f64.ln()).abs() < 1e-2, "{limit}");
    }

    #[test]
    fn chosen_resolutions_leave_no_error_above_one() {
        let view = view(1.0, 100.0);
        for map in [Parametrisation::Uniform, view.best_warp(), Parametrisation::Logarithmic] {
            let factor = view.storage_factor(map, 1.0);
            let pixels = DVec2::new(640.0, 480.0);
            let texels = pixels * DVec2::new(factor.s, factor.t);
            let mut most = 0.0_f64;
            for i in 0..100_000 {
                let depth = 1.0 + 99.0 * f64::from(i) / 99_999.0;
                let error = view.perspective_error(map, depth, 1.0) * pixels / texels;
                most = most.max(error.max_element());
            }
            assert!((1.0 - 1e-6..=1.0 + 1e-6).contains(&most), "{map:?}: {most}");
        }
    }

    /// HC-29: the ground 1 m below the eye, 60 degrees, 1000 pixels, light from overhead on 2000 texels over depths 1
    /// to 50.
    #[test]
    fn the_ground_of_hc29_has_the_errors_of_the_closed_form() {
        let view =
            ViewFrustum { tan_half: 30_f64.to_radians().tan(), aspect: 1.0, near: 1.0, far: 50.0 };
        for (depth, expected) in [(2.0, 5.304_4), (5.0, 0.848_70), (20.0, 0.053_044)] {
            let meeting = ground(depth);
            let spread = view.spread(Parametrisation::Uniform, depth);
            let beams = meeting.beams(&view, DVec2::splat(1000.0), spread, DVec2::splat(2000.0));
            assert!(close(beams.error().y, expected, 2e-5), "{depth} m: {}", beams.error().y);
        }
    }

    /// A point of level ground 1 m below the eye.
    fn ground(depth: f64) -> Meeting {
        let distance = depth.hypot(1.0);
        Meeting {
            depth,
            eye_axis: depth / distance,
            eye_normal: 1.0 / distance,
            light_axis: 1.0,
            light_normal: 1.0,
            light_depth: 1.0,
        }
    }

    #[test]
    fn turning_the_surface_changes_the_error_and_leaves_the_perspective_error() {
        let view = view(1.0, 50.0);
        let beams = |meeting: &Meeting| {
            let spread = view.spread(Parametrisation::Uniform, meeting.depth);
            meeting.beams(&view, DVec2::splat(1000.0), spread, DVec2::splat(2000.0))
        };
        let flat = ground(5.0);
        let reference = beams(&flat).perspective_error(&flat);
        let mut last = 0.0;
        for degrees in [0.0, 30.0, 60.0, 85.0, 89.9_f64] {
            // Turned about the line across the view, the normal leaves the light's direction, which is up, for the
            // eye's.
            let tilt = degrees.to_radians();
            let eye = (1.0 / 5.0_f64).atan();
            let turned = Meeting {
                light_normal: tilt.cos(),
                eye_normal: (std::f64::consts::FRAC_PI_2 - eye - tilt).cos(),
                ..flat
            };
            let found = beams(&turned).perspective_error(&turned);
            assert!(
                (found - reference).abs().max_element() < 1e-12 * reference.y,
                "{degrees} degrees"
            );
            let error = beams(&turned).error().y;
            assert!(error > last, "{degrees} degrees: {error} after {last}");
            last = error;
        }
        assert!(last > 500.0 * reference.y * 0.9, "without bound towards 90 degrees: {last}");
        // HC-03: light at 5 degrees.
        let grazing = Meeting { light_normal: 85_f64.to_radians().cos(), eye_normal: 1.0, ..flat };
        assert!(close(grazing.projection_error(), 11.47, 1e-3), "{}", grazing.projection_error());
    }
}

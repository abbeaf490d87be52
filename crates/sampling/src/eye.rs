//! The camera as fits take it: where its eye is, what it sees at a depth, and the sphere around a slice of that.

use antumbra_gpu::ViewCamera;
use glam::{DMat3, DVec3, DVec4};

/// A perspective camera, read from its matrix; positions are relative to the frame's origin, metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Eye {
    /// The eye.
    pub position: DVec3,
    /// Unit view axis.
    pub forward: DVec3,
    /// Unit vector upwards in the picture.
    pub up: DVec3,
    /// Depth of the near plane, > 0.
    pub near: f64,
    /// Depth of the far plane, which may be infinite.
    pub far: f64,
    /// Offsets from the eye of the picture's corners at depth 1.
    pub corners: [DVec3; 4],
}

impl Eye {
    /// `None` for a camera that has no eye (an orthographic one: its pixels are the same everywhere, so that there is
    /// nothing to slice or to warp) or whose matrix is no projection.
    #[must_use]
    pub fn new(camera: &ViewCamera) -> Option<Self> {
        let [x, y, z, w] = [0, 1, 2, 3].map(|i| camera.clip.row(i));
        let scale = w.truncate().length();
        let forward = w.truncate() / scale;
        // Points with the given x, y and w of clip space.
        let plane =
            DMat3::from_cols(x.truncate(), y.truncate(), w.truncate()).transpose().inverse();
        let at = |x1: f64, y1: f64, w1: f64| plane * DVec3::new(x1 - x.w, y1 - y.w, w1 - w.w);
        let position = at(0.0, 0.0, 0.0);
        let corners = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)]
            .map(|(i, j)| at(i * scale, j * scale, scale) - position);
        // Depth at which the axis crosses a plane of clip space, before the eye if it does.
        let crossing = |p: DVec4| {
            let depth = -p.dot(position.extend(1.0)) / p.truncate().dot(forward);
            if depth > 0.0 && depth.is_finite() { depth } else { f64::INFINITY }
        };
        let (a, b) = (crossing(z), crossing(w - z));
        let up = (corners[2] + corners[3] - corners[0] - corners[1]).normalize();
        let eye = Self { position, forward, up, near: a.min(b), far: a.max(b), corners };
        let finite = forward.is_finite() && up.is_finite() && position.is_finite();
        (finite && eye.near.is_finite()).then_some(eye)
    }

    /// Depth of `p`, metres.
    #[must_use]
    pub fn depth(&self, p: DVec3) -> f64 {
        self.forward.dot(p - self.position)
    }

    /// The half-space of points at depth `depth` and more (`beyond`) or less.
    #[must_use]
    pub fn half_space(&self, depth: f64, beyond: bool) -> DVec4 {
        let plane = self.forward.extend(-self.forward.dot(self.position) - depth);
        if beyond { plane } else { -plane }
    }

    /// Centre and radius of the smallest sphere on the picture's middle line that holds all that is seen between the
    /// depths `near` and `far`. Its radius does not depend on where the camera looks, so neither does the scale of a
    /// window around it.
    #[must_use]
    pub fn sphere(&self, near: f64, far: f64) -> (DVec3, f64) {
        let middle = self.corners.iter().sum::<DVec3>() / 4.0;
        // With the corners at distance k d from the middle at depth d (the farthest corner's k counts): the distances
        // to a centre at depth c are sqrt((d - c)^2 l + k^2 d^2) for d near and far, with l the square of the middle
        // line's length a unit of depth. They are equal at c = (far + near) (l + k^2) / 2 l; beyond far, the far end
        // alone decides. (For the symmetric camera: Real-Time Shadows 4.1 after Valient 2008.)
        let length2 = middle.length_squared();
        // (An oblique picture's corners are not square to its middle line; the radius below has the last word.)
        let k2 = self.corners.iter().map(|c| c.distance_squared(middle)).fold(0.0, f64::max);
        let depth = (0.5 * (far + near) * (length2 + k2) / length2).min(far);
        let center = self.position + middle * depth;
        let radius = [near, far]
            .iter()
            .flat_map(|d| self.corners.map(|c| (self.position + c * *d).distance(center)))
            .fold(0.0, f64::max);
        (center, radius)
    }
}

#[cfg(test)]
mod tests {
    use antumbra_scene::Camera;
    use glam::{DMat4, DQuat};
    use proptest::prelude::*;

    use super::*;

    fn camera(eye: DVec3, target: DVec3, fov_y: f64, near: f64) -> Camera {
        Camera { eye, target, up: DVec3::Y, fov_y, near }
    }

    fn read(camera: &Camera, aspect: f64) -> Eye {
        let clip = camera.view_projection(DVec3::ZERO, aspect);
        Eye::new(&ViewCamera { clip, eye: camera.eye }).expect("a perspective camera")
    }

    /// Conventional perspective: near 0, far 1.
    fn finite(camera: &Camera, aspect: f64, far: f64) -> ViewCamera {
        let n = camera.near;
        let t = 1.0 / (0.5 * camera.fov_y).tan();
        let projection = DMat4::from_cols(
            DVec4::new(t / aspect, 0.0, 0.0, 0.0),
            DVec4::new(0.0, t, 0.0, 0.0),
            DVec4::new(0.0, 0.0, far / (n - far), -1.0),
            DVec4::new(0.0, 0.0, n * far / (n - far), 0.0),
        );
        ViewCamera { clip: projection * camera.view(), eye: camera.eye }
    }

    #[test]
    fn a_cameras_numbers_come_back_from_its_matrix() {
        let seen = camera(DVec3::new(3.0, 1.7, -2.0), DVec3::new(5.0, 1.0, -9.0), 1.1, 0.25);
        let eye = read(&seen, 1.5);
        assert!(eye.position.distance(seen.eye) < 1e-12, "{eye:?}");
        assert!(eye.forward.distance(seen.forward()) < 1e-12, "{eye:?}");
        assert!((eye.near - 0.25).abs() < 1e-12 && eye.far == f64::INFINITY, "{eye:?}");
        assert!((eye.corners[2] - eye.corners[3]).length() > 1.49 * 2.0 * 0.55_f64.tan(), "wide");
        let eye = Eye::new(&finite(&seen, 1.5, 80.0)).expect("a perspective camera");
        assert!((eye.near - 0.25).abs() < 1e-10 && (eye.far - 80.0).abs() < 1e-6, "{eye:?}");
        // Scaled by any number it is the same projection.
        let scaled = ViewCamera { clip: finite(&seen, 1.5, 80.0).clip * 7.0, eye: seen.eye };
        let again = Eye::new(&scaled).expect("a perspective camera");
        assert!(
            (again.near - eye.near).abs() < 1e-10 && again.up.distance(eye.up) < 1e-12,
            "scaled"
        );
    }

    #[test]
    fn what_is_no_perspective_has_no_eye() {
        let orthographic = DMat4::from_scale(DVec3::new(0.1, 0.1, 0.01));
        for clip in [orthographic, DMat4::NAN, DMat4::ZERO] {
            assert_eq!(Eye::new(&ViewCamera { clip, eye: DVec3::ZERO }), None, "{clip}");
        }
    }

    #[test]
    fn the_sphere_of_a_slice_is_that_of_the_closed_form() {
        for (near, far, tan, aspect) in [
            (1.0, 4.0, 0.5, 1.0),
            (1.0, 1.2, 0.5, 1.78),
            (0.1, 30.0, 0.577, 1.78),
            (2.0, 2.0, 1.2, 1.0),
        ] {
            let fov_y = 2.0 * f64::atan(tan);
            let (center, radius) =
                read(&camera(DVec3::ZERO, -DVec3::Z, fov_y, 0.1), aspect).sphere(near, far);
            let k2 = tan * tan * (1.0 + aspect * aspect);
            let (z, r) = if k2 * (far + near) >= far - near {
                (far, far * k2.sqrt())
            } else {
                let (sum, difference) = (far + near, far - near);
                let r2 = difference * difference
                    + 2.0 * (far * far + near * near) * k2
                    + sum * sum * k2 * k2;
                (0.5 * sum * (1.0 + k2), 0.5 * r2.sqrt())
            };
            assert!((center + z * DVec3::Z).length() < 1e-9, "{center} for {z}");
            assert!((radius - r).abs() < 1e-9 * r, "{radius} for {r}");
        }
    }

    proptest! {
        #[test]
        fn the_sphere_holds_the_slice_and_does_not_turn(
            turn in [-1.0..1.0f64, -1.0..1.0f64, -1.0..1.0f64],
            fov_y in 0.2..2.6f64, near in 0.01..10.0f64, ratio in 1.0..100.0f64,
        ) {
            let straight = camera(DVec3::ZERO, -DVec3::Z, fov_y, 0.1);
            let turned = camera(DVec3::ZERO, DQuat::from_scaled_axis(turn.into()) * -DVec3::Z, fov_y, 0.1);
            let far = near * ratio;
            let ((_, r0), eye) = (read(&straight, 1.5).sphere(near, far), read(&turned, 1.5));
            let (center, radius) = eye.sphere(near, far);
            prop_assert!((radius - r0).abs() < 1e-9 * r0);
            for corner in eye.corners {
                for depth in [near, 0.5 * (near + far), far] {
                    let p = eye.position + corner * depth;
                    prop_assert!(p.distance(center) <= radius * (1.0 + 1e-12));
                    prop_assert!((eye.depth(p) - depth).abs() < 1e-9 * depth);
                }
            }
        }
    }
}

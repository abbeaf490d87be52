//! A perspective camera with an infinite, reversed depth range.

use glam::dcamera::rh::{proj, view};
use glam::{DMat4, DVec3};
use serde::{Deserialize, Serialize};

/// A perspective camera, given by where it stands and what it looks at.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Camera {
    /// Position of the eye, metres, world space.
    pub eye: DVec3,
    /// A point that the camera looks at, metres, world space; must differ from `eye`.
    pub target: DVec3,
    /// The direction that shows upwards in the picture; need not be normalised or orthogonal.
    pub up: DVec3,
    /// Vertical field of view, radians, in (0, pi).
    pub fov_y: f64,
    /// Distance of the near plane along the view axis, metres, > 0.
    pub near: f64,
}

impl Camera {
    /// World to view: right-handed, looking along -z, with the eye at the origin.
    ///
    /// Where `up` is parallel to the view axis, the world axis least aligned with it takes its place.
    #[must_use]
    pub fn view(&self) -> DMat4 {
        view::look_to_mat4(self.eye, self.forward(), self.stable_up())
    }

    /// View to clip: depth 1 at the near plane and 0 at infinity (reversed, infinite), y up.
    #[must_use]
    pub fn projection(&self, aspect: f64) -> DMat4 {
        proj::directx::perspective_infinite_reverse(self.fov_y, aspect, self.near)
    }

    /// Points relative to `origin` (world space, metres) to clip space. `aspect` is width / height.
    #[must_use]
    pub fn view_projection(&self, origin: DVec3, aspect: f64) -> DMat4 {
        let view = view::look_to_mat4(self.eye - origin, self.forward(), self.stable_up());
        self.projection(aspect) * view
    }

    /// Unit view direction, world space.
    #[must_use]
    pub fn forward(&self) -> DVec3 {
        (self.target - self.eye).normalize_or(DVec3::NEG_Z)
    }

    /// The unit direction through the point (`x`, `y`) of the picture, both in [0, 1], y down.
    #[must_use]
    pub fn ray_direction(&self, x: f64, y: f64, aspect: f64) -> DVec3 {
        let half = (0.5 * self.fov_y).tan();
        let view = DVec3::new((2.0 * x - 1.0) * half * aspect, (1.0 - 2.0 * y) * half, -1.0);
        self.view().inverse().transform_vector3(view).normalize()
    }

    /// The same camera moved by `offset`, metres, world space.
    #[must_use]
    pub fn translated(self, offset: DVec3) -> Self {
        Self { eye: self.eye + offset, target: self.target + offset, ..self }
    }

    fn stable_up(&self) -> DVec3 {
        let forward = self.forward();
        let up = self.up.normalize_or_zero();
        // 1e-6 rad: below it the cross product keeps fewer than half of f64's digits.
        if up.cross(forward).length() > 1e-6 { up } else { least_aligned_axis(forward) }
    }
}

/// The world axis that makes the largest angle with `direction`.
pub(crate) fn least_aligned_axis(direction: DVec3) -> DVec3 {
    let a = direction.abs();
    if a.x <= a.y && a.x <= a.z {
        DVec3::X
    } else if a.y <= a.z {
        DVec3::Y
    } else {
        DVec3::Z
    }
}

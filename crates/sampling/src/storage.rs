//! How many texels a map needs, measured on its matrix.

use glam::{DMat4, DVec2, DVec3, DVec4};

use crate::Eye;

/// Points of a convex body at which errors are measured.
///
/// Along a straight line error is an affine function squared over an affine one, but for the factor of the pixel's
/// angle, hence convex, and largest at an end. So corners count, and a few places between any two for that factor.
#[derive(Clone, Debug, PartialEq)]
pub struct Body {
    points: Vec<DVec3>,
}

/// Places between two corners.
const BETWEEN: u32 = 3;

impl Body {
    /// The body around `corners`, of which some may be the same.
    #[must_use]
    pub fn new(corners: &[DVec3]) -> Self {
        let mut points: Vec<DVec3> = Vec::new();
        for p in corners {
            if !points.contains(p) {
                points.push(*p);
            }
        }
        let count = points.len();
        for i in 0..count {
            for j in 0..i {
                let (a, b) = (points[i], points[j]);
                points.extend(
                    (1..=BETWEEN).map(|k| a.lerp(b, f64::from(k) / f64::from(BETWEEN + 1))),
                );
            }
        }
        Self { points }
    }

    /// The largest perspective errors of a map with the matrix `clip` over the body, in units of pixels a texel for a
    /// map of one texel and a picture of one pixel, 1 m wide at 1 m: (M_s, M_t) of *Real-Time Shadows* 3.2.4, whose
    /// product is the storage factor. Infinite where the map does not show all of the body.
    ///
    /// `light`: xyz position and w = 1, or direction towards it and w = 0.
    #[must_use]
    pub fn errors(&self, clip: &DMat4, light: DVec4, eye: &Eye) -> DVec2 {
        self.points.iter().fold(DVec2::ZERO, |most, p| most.max(error(clip, light, eye, *p)))
    }

    /// The storage factor: texels a pixel.
    #[must_use]
    pub fn storage(&self, clip: &DMat4, light: DVec4, eye: &Eye) -> f64 {
        let m = self.errors(clip, light, eye);
        m.x * m.y
    }
}

/// A texel's side along s, and its height along t across that, square to the light's ray through `p`, over the size of
/// a pixel there.
fn error(clip: &DMat4, light: DVec4, eye: &Eye, p: DVec3) -> DVec2 {
    let c = *clip * p.extend(1.0);
    if c.w <= 0.0 {
        return DVec2::INFINITY;
    }
    let ray = (light.truncate() - light.w * p).normalize_or(DVec3::Y);
    let (a, b) = ray.any_orthonormal_pair();
    // Change of (s, t), half that of normalised coordinates.
    let along = |d: DVec3| {
        let e = *clip * d.extend(0.0);
        0.5 * (e.truncate() - c.truncate() / c.w * e.w).truncate() / c.w
    };
    let (da, db) = (along(a), along(b));
    let det = da.perp_dot(db).abs();
    // The column of the inverse that is one step of s, and one over the gradient of t.
    let side = DVec2::new(da.y, db.y).length();
    let texel = DVec2::new(side / det, 1.0 / side);
    // A pixel is as wide as its depth, and foreshortened up and down towards the picture's edge.
    let depth = eye.depth(p).max(eye.near * 1e-3);
    let height = eye.up.dot(p - eye.position);
    let axis = depth / depth.hypot(height);
    let error = texel / DVec2::new(depth, depth * axis);
    if error.is_finite() { error } else { DVec2::INFINITY }
}

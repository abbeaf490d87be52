//! How far a light reaches, and in which part of the picture (attenuation limits: Lengyel 2002; McGuire, Hughes, Egan,
//! Kilgard and Everitt 2003).

use glam::{DMat4, DVec3, DVec4};

/// Half of the smallest step of an 8-bit display that takes linear values.
pub const LINEAR_STEP: f64 = 0.5 / 255.0;

/// Half of the smallest step of an 8-bit sRGB display, at its dark end, where its curve has the slope 12.92.
pub const SRGB_STEP: f64 = 0.5 / 255.0 / 12.92;

/// A lamp of intensity `i` lights a surface at the distance r with i / (constant + linear r + quadratic r²).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Attenuation {
    /// Without unit, >= 0.
    pub constant: f64,
    /// In 1 / metre, >= 0.
    pub linear: f64,
    /// In 1 / metre², >= 0.
    pub quadratic: f64,
}

impl Attenuation {
    /// That of a point: the square of the distance.
    pub const SQUARE: Self = Self { constant: 0.0, linear: 0.0, quadratic: 1.0 };

    /// The distance, metres, from which on a lamp adds less than `step`, as [`LINEAR_STEP`] or [`SRGB_STEP`] over the
    /// exposure: the error of leaving it out. Many lamps' errors add up. 0 where it never adds as much; infinite where it
    /// always does.
    #[must_use]
    pub fn reach(&self, intensity: f64, step: f64) -> f64 {
        let excess = intensity / step - self.constant;
        if excess <= 0.0 {
            return 0.0;
        }
        // The positive root of quadratic r² + linear r = excess, in the form that divides by no difference.
        let root = (self.linear * self.linear + 4.0 * self.quadratic * excess).sqrt();
        2.0 * excess / (self.linear + root)
    }
}

/// Pixels, of a picture of `size`, that may show a sphere: x, y, width and height. `clip`: the camera's matrix, any. All of it
/// where the sphere reaches behind the eye.
///
/// A plane p is tangent to the sphere of center c (homogeneous) and radius r where (p . c)² = r² |p.xyz|². Those through
/// a column x of the picture are `row_x - x row_w` of the matrix, so that the columns between which the sphere lies are
/// the roots of a square equation; in the form of Sigg, Weyrich, Botsch and Gross 2006 for Lengyel's rectangle.
#[must_use]
pub fn scissor(center: DVec3, radius: f64, clip: DMat4, size: (u32, u32)) -> [u32; 4] {
    let rows = clip.transpose();
    let center = center.extend(1.0);
    let product = |p: DVec4, q: DVec4| {
        p.dot(center) * q.dot(center) - radius * radius * p.truncate().dot(q.truncate())
    };
    let w = rows.w_axis;
    let a = product(w, w);
    let whole = [0, 0, size.0, size.1];
    if a <= 0.0 {
        return whole;
    }
    if w.dot(center) < 0.0 {
        return [0; 4];
    }
    // Between the roots, and a pixel more for rounding.
    let range = |row: DVec4, pixels: u32, sign: f64| {
        let b = product(row, w);
        let root = (b * b - a * product(row, row)).max(0.0).sqrt();
        let [from, to] = [b - root, b + root].map(|x| 0.5 + 0.5 * sign * x / a);
        let limit = f64::from(pixels);
        let pixel = |at: f64, more: f64| (at * limit + more).clamp(0.0, limit);
        let (first, end) = (pixel(from.min(to), -1.0).floor(), pixel(from.max(to), 1.0).ceil());
        (first as u32, (end - first) as u32)
    };
    // Rows of pixels run downwards.
    let (x, width) = range(rows.x_axis, size.0, 1.0);
    let (y, height) = range(rows.y_axis, size.1, -1.0);
    [x, y, width, height]
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn what_is_farther_than_the_reach_adds_less_than_a_step() {
        let faint = Attenuation { constant: 1.0, linear: 0.3, quadratic: 0.2 };
        for (attenuation, intensity) in [(Attenuation::SQUARE, 3.0), (faint, 10.0)] {
            for step in [LINEAR_STEP, SRGB_STEP] {
                let r = attenuation.reach(intensity, step);
                let Attenuation { constant, linear, quadratic } = attenuation;
                let light = intensity / (constant + linear * r + quadratic * r * r);
                assert!((light / step - 1.0).abs() < 1e-12, "{light} at {r}, not {step}");
            }
        }
        assert_eq!(Attenuation::SQUARE.reach(4.0, 1.0), 2.0, "the root of 4");
        assert_eq!(faint.reach(1e-9, LINEAR_STEP), 0.0, "too faint");
        let endless = Attenuation { constant: 1.0, linear: 0.0, quadratic: 0.0 };
        assert_eq!(endless.reach(1.0, LINEAR_STEP), f64::INFINITY, "without attenuation");
    }

    /// A perspective camera at the origin that looks along -z, with reversed depth without end.
    fn camera(cot: f64) -> DMat4 {
        DMat4::from_cols(DVec4::X * cot, DVec4::Y * cot, -DVec4::W, 0.1 * DVec4::Z)
    }

    proptest! {
        /// All that a sphere's surface shows is in its rectangle; of a sphere in the picture's middle the rectangle is
        /// tight to two pixels a side.
        #[test]
        fn a_sphere_is_in_its_scissor(
            x in -9.0..9.0_f64, y in -9.0..9.0_f64, z in -20.0..5.0_f64,
            radius in 0.1..4.0_f64, cot in 0.7..3.0_f64,
        ) {
            let (center, clip, size) = (DVec3::new(x, y, z), camera(cot), (320, 200));
            let [left, top, width, height] = scissor(center, radius, clip, size);
            let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
            let behind = z > -radius;
            for i in 0..4000_i32 {
                // A spiral over the sphere.
                let (up, turn) = (f64::from(i) / 2000.0 - 0.9998, 2.399_963 * f64::from(i));
                let flat = (1.0 - up * up).sqrt();
                let p = center + radius * DVec3::new(flat * turn.cos(), up, flat * turn.sin());
                let at = clip * p.extend(1.0);
                if at.w <= 1e-6 {
                    continue;
                }
                let pixel = DVec3::new(160.0 + 160.0 * at.x / at.w, 100.0 - 100.0 * at.y / at.w, 0.0);
                (low, high) = (low.min(pixel), high.max(pixel));
                let inside = (0.0..320.0).contains(&pixel.x) && (0.0..200.0).contains(&pixel.y);
                if inside {
                    let right = (f64::from(left)..=f64::from(left + width)).contains(&pixel.x);
                    let below = (f64::from(top)..=f64::from(top + height)).contains(&pixel.y);
                    prop_assert!(right && below, "{pixel} of {center}, {radius}");
                }
            }
            // The spiral's 4000 points come within a fiftieth of the radius of every extreme.
            if !behind && low.x > 0.0 && high.x < 320.0 {
                let slack = 4.0 + 0.05 * (high.x - low.x);
                prop_assert!(f64::from(width) < high.x - low.x + slack, "{width} columns of {center}");
            }
        }
    }
}

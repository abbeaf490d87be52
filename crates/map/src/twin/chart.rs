//! Charts of directions in f64: the twins of `map/paraboloid.wesl` and `map/isocube.wesl`, and how evenly they and
//! the perspective views spread their texels.

use std::f64::consts::FRAC_PI_4;

use glam::{DVec2, DVec3};

/// A map between directions and the plane.
pub trait Chart {
    /// Chart coordinates of the direction of `v`, which need not be a unit vector.
    fn to_chart(&self, v: DVec3) -> DVec2;

    /// The unit vector at `c`.
    fn direction_at(&self, c: DVec2) -> DVec3;

    /// Solid angle of a unit of chart area at `c`, steradians.
    fn solid_angle(&self, c: DVec2) -> f64 {
        let step = 1e-5;
        let q = |dx: f64, dy: f64| self.direction_at(c + DVec2::new(dx, dy));
        let (du, dv) = (q(step, 0.0) - q(-step, 0.0), q(0.0, step) - q(0.0, -step));
        du.cross(dv).length() / (4.0 * step * step)
    }
}

/// The hemisphere around +z on the unit disc, as a paraboloid mirror shows it (Heidrich, Seidel 1998).
#[derive(Clone, Copy, Debug)]
pub struct Paraboloid;

impl Chart for Paraboloid {
    fn to_chart(&self, v: DVec3) -> DVec2 {
        v.truncate() / (v.length() + v.z)
    }

    fn direction_at(&self, c: DVec2) -> DVec3 {
        let k = c.length_squared();
        (2.0 * c).extend(1.0 - k) / (1.0 + k)
    }
}

/// A sixth of the sphere on [-1, 1]², equal areas on equal areas (after Wan, Wong, Leung 2007).
#[derive(Clone, Copy, Debug)]
pub enum Isocube {
    /// Around +z, |y| <= 2/3: longitude and height.
    Belt,
    /// Around the pole +z, z >= 2/3: squares about the pole.
    Cap,
}

impl Chart for Isocube {
    fn to_chart(&self, v: DVec3) -> DVec2 {
        match self {
            Self::Belt => DVec2::new(v.x.atan2(v.z) / FRAC_PI_4, 1.5 * v.y / v.length()),
            Self::Cap => {
                let axis = nearest_axis(v.truncate());
                let u = DVec2::new(axis.dot(v.truncate()), axis.perp_dot(v.truncate()));
                let r = v.length();
                let rho = (3.0 / (r * (r + v.z))).sqrt() * v.truncate().length();
                axis.rotate(rho * DVec2::new(1.0, u.y.atan2(u.x) / FRAC_PI_4))
            }
        }
    }

    fn direction_at(&self, c: DVec2) -> DVec3 {
        match self {
            Self::Belt => {
                let y = c.y / 1.5;
                let (sin, cos) = (FRAC_PI_4 * c.x).sin_cos();
                let level = (1.0 - y * y).sqrt();
                DVec3::new(level * sin, y, level * cos)
            }
            Self::Cap => {
                let axis = nearest_axis(c);
                let u = DVec2::new(axis.dot(c), axis.perp_dot(c));
                if u.x == 0.0 {
                    return DVec3::Z;
                }
                let third = u.x * u.x / 3.0;
                let direction = axis.rotate(DVec2::from_angle(FRAC_PI_4 * u.y / u.x));
                (direction * (third * (2.0 - third)).sqrt()).extend(1.0 - third)
            }
        }
    }
}

/// The nearest of the unit vectors x, y, -x, -y.
fn nearest_axis(c: DVec2) -> DVec2 {
    if c.x.abs() >= c.y.abs() {
        DVec2::new(1.0_f64.copysign(c.x), 0.0)
    } else {
        DVec2::new(0.0, 1.0_f64.copysign(c.y))
    }
}

/// A perspective view: the plane z = 1, coordinates -1 to 1 for tangents up to `tangents` either way.
#[derive(Clone, Copy, Debug)]
pub struct Perspective {
    /// Tangents of half the view's width and height.
    pub tangents: DVec2,
}

impl Chart for Perspective {
    fn to_chart(&self, v: DVec3) -> DVec2 {
        v.truncate() / v.z / self.tangents
    }

    fn direction_at(&self, c: DVec2) -> DVec3 {
        (c * self.tangents).extend(1.0).normalize()
    }
}

/// The view of one face of the tetrahedron, and the directions of the face's corners in it, the first at the top.
#[must_use]
pub fn tetrahedron() -> (Perspective, [DVec3; 3]) {
    let (basis, tangents) = crate::omni::tetrahedron_face(0);
    let flip = DVec3::new(1.0, 1.0, -1.0);
    let corners = crate::omni::tetrahedron_corners(0).map(|c| (basis * c) * flip);
    (Perspective { tangents }, corners)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Points of [-1, 1]², off its diagonals and axes.
    fn square() -> impl Iterator<Item = DVec2> {
        const SIDE: usize = 61;
        (0..SIDE * SIDE).map(|i| {
            let at = |k: usize| (k as f64 + 0.4737) / SIDE as f64 * 2.0 - 1.0;
            DVec2::new(at(i % SIDE), at(i / SIDE) + 1e-3)
        })
    }

    fn extremes(values: impl Iterator<Item = f64>) -> (f64, f64) {
        values.fold((f64::INFINITY, 0.0), |(lo, hi), v| (lo.min(v), hi.max(v)))
    }

    #[test]
    fn directions_survive_the_way_there_and_back() {
        let charts: [&dyn Chart; 4] = [
            &Paraboloid,
            &Isocube::Belt,
            &Isocube::Cap,
            &Perspective { tangents: DVec2::new(3.0, 1.9) },
        ];
        for (k, chart) in charts.iter().enumerate() {
            for c in square().map(|c| 1.39 * c) {
                let back = chart.to_chart(7.0 * chart.direction_at(c));
                assert!(back.abs_diff_eq(c, 1e-12), "chart {k}: {c} comes back as {back}");
            }
        }
    }

    #[test]
    fn texels_of_the_isocube_all_have_the_same_solid_angle() {
        let sixth = 4.0 * std::f64::consts::PI / 6.0;
        for chart in [Isocube::Belt, Isocube::Cap] {
            // 4 units of chart a sixth of the sphere.
            let (least, most) = extremes(square().map(|c| chart.solid_angle(c) * 4.0 / sixth));
            assert!((least - 1.0).abs() < 1e-4, "{chart:?}: {least}");
            assert!((most - 1.0).abs() < 1e-4, "{chart:?}: {most}");
        }
    }

    #[test]
    fn texels_of_the_others_differ_by_the_published_factors() {
        let disc = || square().filter(|c| c.length() <= 1.0);
        let at = |chart: &dyn Chart, c: DVec2| chart.solid_angle(c);
        // 4 in the middle, 1 on the rim (Brabec, Annen, Seidel 2002).
        let (least, most) = extremes(disc().map(|c| at(&Paraboloid, c)));
        assert!(least >= 1.0 - 1e-6 && most <= 4.0 + 1e-6, "paraboloid: {least} to {most}");
        assert!((at(&Paraboloid, DVec2::ZERO) - 4.0).abs() < 1e-6, "in the middle");
        assert!((at(&Paraboloid, DVec2::Y) - 1.0).abs() < 1e-6, "on the rim");
        // A cube's face: (1 + x² + y²)^(-3/2), 3^1.5 from middle to corner.
        let face = Perspective { tangents: DVec2::ONE };
        let ratio = at(&face, DVec2::ZERO) / at(&face, DVec2::ONE);
        assert!((ratio - 27f64.sqrt()).abs() < 1e-5, "cube: {ratio}");
        // A tetrahedron's: the cube of the cosine, 0.265 at the lower corners, 71.99 degrees to the side and 62.63
        // down.
        let (view, corners) = tetrahedron();
        let share = |v: DVec3| at(&view, view.to_chart(v)) / at(&view, DVec2::ZERO);
        for corner in corners {
            let inside = view.to_chart(corner).abs().max_element() <= 1.0 + 1e-12 && corner.z > 0.0;
            assert!(inside, "a corner of the face lies outside its view: {corner}");
            assert!((share(corner) - corner.z.powi(3)).abs() < 1e-6, "the cube of the cosine");
        }
        let least = corners.map(share).into_iter().fold(1.0, f64::min);
        assert!((least - 0.019).abs() < 5e-4, "tetrahedron: {least}");
    }
}

//! Convex polygons in the plane: clipping, area, and area within the unit disc.

use glam::DVec2;

/// The half-plane `s x + t y + constant >= 0`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Line {
    pub(super) s: f64,
    pub(super) t: f64,
    pub(super) constant: f64,
}

impl Line {
    /// Positive inside, zero on the line.
    pub(super) fn at(&self, x: f64, y: f64) -> f64 {
        self.s * x + self.t * y + self.constant
    }
}

/// A convex polygon, anticlockwise; empty where nothing is left of it.
#[derive(Clone, Debug)]
pub(super) struct Polygon(pub(super) Vec<DVec2>);

impl Polygon {
    /// [-1, 1]².
    pub(super) fn square() -> Self {
        Self([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)].map(DVec2::from).to_vec())
    }

    /// Keeps the part inside the line (Sutherland and Hodgman 1974).
    pub(super) fn clip(&mut self, line: Line) {
        let mut kept = Vec::with_capacity(self.0.len() + 1);
        for (a, b) in self.edges() {
            let (fa, fb) = (line.at(a.x, a.y), line.at(b.x, b.y));
            if fa >= 0.0 {
                kept.push(a);
            }
            if (fa >= 0.0) != (fb >= 0.0) {
                kept.push(a + (b - a) * (fa / (fa - fb)));
            }
        }
        self.0 = kept;
    }

    /// The shoelace formula.
    pub(super) fn area(&self) -> f64 {
        0.5 * self.edges().map(|(a, b)| a.perp_dot(b)).sum::<f64>().max(0.0)
    }

    /// Area of the part within the unit disc: each edge makes a triangle with the centre, whose part
    /// within the disc is a triangle where the edge is inside and a circular sector where it is out.
    pub(super) fn area_in_unit_disc(&self) -> f64 {
        self.edges().map(|(a, b)| triangle_in_disc(a, b)).sum::<f64>().max(0.0)
    }

    pub(super) fn edges(&self) -> impl Iterator<Item = (DVec2, DVec2)> {
        self.0.iter().copied().zip(self.0.iter().copied().cycle().skip(1))
    }
}

/// Signed area of the triangle (0, a, b) within the unit disc.
fn triangle_in_disc(a: DVec2, b: DVec2) -> f64 {
    let sector = |from: DVec2, to: DVec2| 0.5 * from.perp_dot(to).atan2(from.dot(to));
    let along = b - a;
    let length2 = along.length_squared();
    if length2 == 0.0 {
        return 0.0;
    }
    // Where |a + t (b - a)| = 1: half a chord before and after the foot of the perpendicular.
    let foot = -a.dot(along) / length2;
    let distance = a.perp_dot(along) / length2.sqrt();
    let half2 = (1.0 - distance) * (1.0 + distance) / length2;
    if half2 <= 0.0 {
        return sector(a, b);
    }
    let half = half2.sqrt();
    let (enter, leave) = ((foot - half).clamp(0.0, 1.0), (foot + half).clamp(0.0, 1.0));
    if enter >= leave {
        return sector(a, b);
    }
    let (first, last) = (a + along * enter, a + along * leave);
    sector(a, first) + 0.5 * first.perp_dot(last) + sector(last, b)
}

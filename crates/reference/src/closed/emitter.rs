//! Lights as flat shapes relative to a receiver point.

use antumbra_scene::Light;
use glam::DVec3;

use super::area::{Line, Polygon};

/// The shape of a light in its own parameters (s, t).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Shape {
    /// The origin only.
    Point,
    /// [-1, 1]².
    Square,
    /// The unit disc.
    Disc,
}

impl Shape {
    /// Area of the whole shape.
    pub(super) fn area(self) -> f64 {
        match self {
            Self::Point => 0.0,
            Self::Square => 4.0,
            Self::Disc => std::f64::consts::PI,
        }
    }

    /// Area of the shape's part within a polygon that lies in [-1, 1]².
    pub(super) fn area_within(self, polygon: &Polygon) -> f64 {
        match self {
            Self::Point => 0.0,
            Self::Square => polygon.area(),
            Self::Disc => polygon.area_in_unit_disc(),
        }
    }
}

/// The points `center + s u + t v` of a light relative to a receiver point.
pub(super) struct Emitter {
    pub(super) shape: Shape,
    pub(super) center: DVec3,
    pub(super) u: DVec3,
    pub(super) v: DVec3,
    /// Whether the points are directions towards a light at infinity.
    pub(super) infinite: bool,
}

impl Emitter {
    pub(super) fn new(light: &Light, p: DVec3) -> Self {
        let disc = |center: DVec3, u, v| Self { shape: Shape::Disc, center, u, v, infinite: false };
        let mut emitter = match *light {
            Light::Directional { direction, angular_diameter } => {
                let to_light = (-direction).normalize_or_zero();
                let (u, v) = facing_disc(to_light, (0.5 * angular_diameter).tan());
                Self { infinite: true, ..disc(to_light, u, v) }
            }
            Light::Point { position } | Light::Spot { position, .. } => {
                disc(position - p, DVec3::ZERO, DVec3::ZERO)
            }
            Light::Sphere { center, radius } => {
                let to_light = center - p;
                let (u, v) = facing_disc(to_light.normalize_or(DVec3::Y), radius);
                disc(to_light, u, v)
            }
            Light::Rect { center, half_u, half_v } => {
                let mut square = disc(center - p, half_u, half_v);
                square.shape = Shape::Square;
                square.widen_line();
                square
            }
            Light::Disc { center, radius, axis_u, axis_v } => {
                disc(center - p, axis_u * radius, axis_v * radius)
            }
        };
        if light.is_hard() {
            emitter.shape = Shape::Point;
        }
        emitter
    }

    pub(super) fn is_finite(&self) -> bool {
        self.center.is_finite() && self.u.is_finite() && self.v.is_finite()
    }

    /// The half-plane of the light's parameters in which `normal . d + offset >= 0`.
    pub(super) fn line(&self, normal: DVec3, offset: f64) -> Line {
        Line {
            s: normal.dot(self.u),
            t: normal.dot(self.v),
            constant: normal.dot(self.center) + offset,
        }
    }

    /// Gives a rectangle with one side of length zero a width of 2⁻⁴⁰ of the other, so that it has
    /// an area; the share of it that is hidden changes by no more than that order.
    fn widen_line(&mut self) {
        let width = 1.0 / (1_u64 << 40) as f64;
        if self.u == DVec3::ZERO && self.v != DVec3::ZERO {
            self.u = self.v.any_orthogonal_vector().normalize() * self.v.length() * width;
        } else if self.v == DVec3::ZERO && self.u != DVec3::ZERO {
            self.v = self.u.any_orthogonal_vector().normalize() * self.u.length() * width;
        }
    }
}

/// Two radii that span the disc perpendicular to the unit vector `axis`.
fn facing_disc(axis: DVec3, radius: f64) -> (DVec3, DVec3) {
    let (u, v) = axis.any_orthonormal_pair();
    (u * radius, v * radius)
}

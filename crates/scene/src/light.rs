//! The six kinds of light and the geometry of their emitting shapes.

use glam::{DVec2, DVec3};
use serde::{Deserialize, Serialize};

use crate::camera::least_aligned_axis;

/// A light, in world space. Only its shape matters to shadows; intensity is left to shading.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "lowercase")]
pub enum Light {
    /// Parallel light from infinitely far away.
    Directional {
        /// The unit direction in which the light travels.
        direction: DVec3,
        /// Apparent diameter of the disc of directions, radians, in [0, pi); 0 is a sharp sun.
        angular_diameter: f64,
    },
    /// A point that shines in all directions.
    Point {
        /// Position, metres.
        position: DVec3,
    },
    /// A point that shines into a cone.
    Spot {
        /// Position, metres.
        position: DVec3,
        /// Unit axis of the cone, away from the light.
        direction: DVec3,
        /// Half opening angle of the cone, radians, in (0, pi / 2).
        outer_angle: f64,
    },
    /// A sphere that shines outwards.
    Sphere {
        /// Centre, metres.
        center: DVec3,
        /// Radius, metres, >= 0.
        radius: f64,
    },
    /// A rectangle that shines to both sides.
    Rect {
        /// Centre, metres.
        center: DVec3,
        /// Half of one side, metres.
        half_u: DVec3,
        /// Half of the other side, metres, orthogonal to `half_u`.
        half_v: DVec3,
    },
    /// A disc that shines to both sides.
    Disc {
        /// Centre, metres.
        center: DVec3,
        /// Radius, metres, >= 0.
        radius: f64,
        /// Unit vector in the disc's plane.
        axis_u: DVec3,
        /// Unit vector in the disc's plane, orthogonal to `axis_u`.
        axis_v: DVec3,
    },
}

/// The kind of a [`Light`], without its numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum LightKind {
    /// [`Light::Directional`]
    Directional,
    /// [`Light::Point`]
    Point,
    /// [`Light::Spot`]
    Spot,
    /// [`Light::Sphere`]
    Sphere,
    /// [`Light::Rect`]
    Rect,
    /// [`Light::Disc`]
    Disc,
}

impl LightKind {
    /// All kinds, in the order of the documentation.
    pub const ALL: [Self; 6] =
        [Self::Directional, Self::Spot, Self::Point, Self::Sphere, Self::Rect, Self::Disc];

    /// The lower-case name used in files and on the command line.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Directional => "directional",
            Self::Point => "point",
            Self::Spot => "spot",
            Self::Sphere => "sphere",
            Self::Rect => "rect",
            Self::Disc => "disc",
        }
    }

    /// The kind of that [`name`](Self::name).
    #[must_use]
    pub fn by_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.name() == name)
    }
}

impl Light {
    /// Sunlight from `elevation` above the horizon and `azimuth` around the y axis, measured from +z
    /// towards +x; the sun appears `angular_diameter` wide. All in radians.
    #[must_use]
    pub fn sun(elevation: f64, azimuth: f64, angular_diameter: f64) -> Self {
        Self::Directional { direction: -towards_sky(elevation, azimuth), angular_diameter }
    }

    /// The same light moved by `offset`, metres, world space.
    #[must_use]
    pub fn translated(mut self, offset: DVec3) -> Self {
        match &mut self {
            Self::Directional { .. } => {}
            Self::Point { position } | Self::Spot { position, .. } => *position += offset,
            Self::Sphere { center, .. } | Self::Rect { center, .. } | Self::Disc { center, .. } => {
                *center += offset;
            }
        }
        self
    }

    /// The light's kind.
    #[must_use]
    pub fn kind(&self) -> LightKind {
        match self {
            Self::Directional { .. } => LightKind::Directional,
            Self::Point { .. } => LightKind::Point,
            Self::Spot { .. } => LightKind::Spot,
            Self::Sphere { .. } => LightKind::Sphere,
            Self::Rect { .. } => LightKind::Rect,
            Self::Disc { .. } => LightKind::Disc,
        }
    }

    /// Whether the light has no extent, so that visibility is 0 or 1.
    #[must_use]
    pub fn is_hard(&self) -> bool {
        match *self {
            Self::Directional { angular_diameter, .. } => angular_diameter == 0.0,
            Self::Point { .. } | Self::Spot { .. } => true,
            Self::Sphere { radius, .. } | Self::Disc { radius, .. } => radius == 0.0,
            Self::Rect { half_u, half_v, .. } => half_u == DVec3::ZERO && half_v == DVec3::ZERO,
        }
    }

    /// The centre of the emitting shape, or `None` for a directional light.
    #[must_use]
    pub fn position(&self) -> Option<DVec3> {
        match *self {
            Self::Directional { .. } => None,
            Self::Point { position } | Self::Spot { position, .. } => Some(position),
            Self::Sphere { center, .. } | Self::Rect { center, .. } | Self::Disc { center, .. } => {
                Some(center)
            }
        }
    }

    /// The vector from `p` (world space) to the light's point at `sample` in the unit square, whose
    /// uniform distribution gives a uniform one over the light's area: the disc facing `p` for a sphere, the
    /// disc of directions for a wide sun. Its length is the distance to the point; for a directional
    /// light it is a unit vector and the distance is infinite.
    #[must_use]
    pub fn towards(&self, p: DVec3, sample: DVec2) -> DVec3 {
        let s = self.place(sample);
        match *self {
            Self::Directional { direction, angular_diameter } => {
                let to_light = -direction;
                let radius = (0.5 * angular_diameter).tan();
                let (u, v) = basis(to_light);
                let d = s * radius;
                (to_light + u * d.x + v * d.y).normalize()
            }
            Self::Point { position } | Self::Spot { position, .. } => position - p,
            Self::Sphere { center, radius } => {
                let axis = (center - p).normalize_or(DVec3::Y);
                let (u, v) = basis(axis);
                let d = s * radius;
                center - p + u * d.x + v * d.y
            }
            Self::Rect { center, half_u, half_v } => center - p + half_u * s.x + half_v * s.y,
            Self::Disc { center, radius, axis_u, axis_v } => {
                let d = s * radius;
                center - p + axis_u * d.x + axis_v * d.y
            }
        }
    }

    /// The same point in the light's own coordinates: in [-1, 1]² along the halves of a rectangle's sides, in the unit disc for
    /// what is round. A sphere's turn with `p`.
    #[must_use]
    pub fn place(&self, sample: DVec2) -> DVec2 {
        match self {
            Self::Rect { .. } => sample * 2.0 - 1.0,
            _ => square_to_disc(sample),
        }
    }
}

/// The unit direction at `elevation` above the horizon and `azimuth` around the y axis, measured
/// from +z towards +x, in radians.
pub(crate) fn towards_sky(elevation: f64, azimuth: f64) -> DVec3 {
    let (sin_e, cos_e) = elevation.sin_cos();
    let (sin_a, cos_a) = azimuth.sin_cos();
    DVec3::new(cos_e * sin_a, sin_e, cos_e * cos_a)
}

/// Two unit vectors that with the unit vector `axis` make a right-handed orthonormal basis.
pub(crate) fn basis(axis: DVec3) -> (DVec3, DVec3) {
    let u = least_aligned_axis(axis).cross(axis).normalize();
    (u, axis.cross(u))
}

/// The concentric map from the unit square to the unit disc, which keeps ratios of area
/// (Shirley and Chiu 1997).
fn square_to_disc(s: DVec2) -> DVec2 {
    let c = s * 2.0 - 1.0;
    if c == DVec2::ZERO {
        return c;
    }
    let (radius, angle) = if c.x.abs() > c.y.abs() {
        (c.x, std::f64::consts::FRAC_PI_4 * (c.y / c.x))
    } else {
        (c.y, std::f64::consts::FRAC_PI_2 - std::f64::consts::FRAC_PI_4 * (c.x / c.y))
    };
    radius * DVec2::from_angle(angle)
}

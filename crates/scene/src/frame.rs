//! Where to put a camera, a light and a ground when a scene brings none.
//!
//! Everything follows from one sphere, that around the box of the scene's geometry, so that a thimble
//! and a town are framed alike. The ground that [`Scene::add_ground`] adds does not count.

use glam::{DAffine3, DVec3};

use crate::generate::shapes;
use crate::light::{basis, towards_sky};
use crate::{Bounds, Camera, Light, LightKind, Scene};

/// Vertical field of view of a framing camera: close to how a picture on a desk is looked at.
const FOV_Y: f64 = std::f64::consts::FRAC_PI_4;

/// Room around what is framed: a 20th of its size.
const MARGIN: f64 = 1.05;

/// Half of the side of an added ground, in radii of the scene. A shadow of the scene's top under the
/// placed sun ends within 1 / tan(50 degrees) < 0.84 heights of its foot, and a height is at most
/// two radii; six leave room for a sun as low as atan(2 / 5) = 22 degrees.
pub(crate) const GROUND_RADII: f64 = 6.0;

/// The sphere that placement goes by.
struct Sphere {
    center: DVec3,
    radius: f64,
}

impl Sphere {
    fn around(bounds: Bounds) -> Self {
        if bounds.is_empty() {
            return Self { center: DVec3::ZERO, radius: 1.0 };
        }
        let (center, radius) = (bounds.center(), bounds.radius());
        // Below 2^-40 of its distance from the world's origin a scene is a point: f64 could place a
        // camera around it with 13 bits only. It is then framed as if it were a metre in size.
        let smallest = center.length() * (-40.0_f64).exp2();
        if radius > smallest { Self { center, radius } } else { Self { center, radius: 1.0 } }
    }
}

/// Towards the placed directional, spot and area lights: 50 degrees high, and to the left of the
/// framing camera by 75 degrees, so that shadows fall sideways in the picture and onto no axis.
fn towards_light() -> DVec3 {
    towards_sky(50_f64.to_radians(), -40_f64.to_radians())
}

impl Scene {
    /// The box around all triangles but those of an added ground, world space; around everything
    /// where there is nothing but the ground.
    #[must_use]
    pub fn subject_bounds(&self) -> Bounds {
        let subject = (self.instances.iter().enumerate())
            .filter(|&(index, _)| Some(index) != self.ground)
            .fold(Bounds::EMPTY, |b, (_, instance)| b.union(self.instance_bounds(instance)));
        if subject.is_empty() { self.bounds() } else { subject }
    }

    /// A camera that shows the whole of [`subject_bounds`](Self::subject_bounds) in three-quarter
    /// view, from 30 degrees above, in any picture at least as wide as high.
    ///
    /// The sphere of radius r touches the cone of half angle fov / 2 around the view axis when the
    /// eye is r / sin(fov / 2) away from its centre; a 20th more is left as margin. The near plane is
    /// r / 20 away: well before the sphere, and before a ground that passes under the eye.
    #[must_use]
    pub fn framing_camera(&self) -> Camera {
        let Sphere { center, radius } = Sphere::around(self.subject_bounds());
        let distance = MARGIN * radius / (0.5 * FOV_Y).sin();
        Camera {
            eye: center + distance * towards_sky(30_f64.to_radians(), 35_f64.to_radians()),
            target: center,
            up: DVec3::Y,
            fov_y: FOV_Y,
            near: radius / 20.0,
        }
    }

    /// The scene's own camera, or else the [framing camera](Self::framing_camera).
    #[must_use]
    pub fn camera_or_framing(&self) -> Camera {
        self.camera.unwrap_or_else(|| self.framing_camera())
    }

    /// A light of the given kind, placed from [`subject_bounds`](Self::subject_bounds) with radius r
    /// and centre c:
    ///
    /// - directional: from 50 degrees above the horizon, off the axes, without size;
    /// - spot: in the same direction from c, 3 r away, aimed at c, its cone around the whole sphere:
    ///   half angle asin(r / 3 r) with r taken a 20th larger;
    /// - point: r / 2 above the top of the box, so never inside geometry, a quarter of r off the
    ///   middle so that the shadows of symmetric scenes are not symmetric;
    /// - sphere, rectangle, disc: 2 r from c in the direction of the sun, facing c; radius r / 5, or
    ///   half sides r / 4 and r / 6. A blocker at c then casts a penumbra d (2 r / 5) / 2 r = d / 5
    ///   wide (sphere, disc) onto a receiver at a distance d behind it.
    #[must_use]
    pub fn place_light(&self, kind: LightKind) -> Light {
        let bounds = self.subject_bounds();
        let Sphere { center, radius } = Sphere::around(bounds);
        let outwards = towards_light();
        let (u, v) = basis(outwards);
        let area_center = center + 2.0 * radius * outwards;
        match kind {
            LightKind::Directional => {
                Light::Directional { direction: -outwards, angular_diameter: 0.0 }
            }
            LightKind::Spot => Light::Spot {
                position: center + 3.0 * radius * outwards,
                direction: -outwards,
                outer_angle: (MARGIN / 3.0).asin(),
            },
            LightKind::Point => {
                let top = if bounds.is_empty() { center.y } else { bounds.max.y };
                let aside = 0.25 * radius * DVec3::new(outwards.x, 0.0, outwards.z).normalize();
                let over = DVec3::new(center.x, top + 0.5 * radius, center.z);
                Light::Point { position: over + aside }
            }
            LightKind::Sphere => Light::Sphere { center: area_center, radius: radius / 5.0 },
            LightKind::Rect => Light::Rect {
                center: area_center,
                half_u: u * (radius / 4.0),
                half_v: v * (radius / 6.0),
            },
            LightKind::Disc => {
                Light::Disc { center: area_center, radius: radius / 5.0, axis_u: u, axis_v: v }
            }
        }
    }

    /// The scene's first light of the given kind, or else a [placed one](Self::place_light).
    #[must_use]
    pub fn light_or_placed(&self, kind: LightKind) -> Light {
        let own = self.lights.iter().copied().find(|light| light.kind() == kind);
        own.unwrap_or_else(|| self.place_light(kind))
    }

    /// Adds a level square under the scene: at the lowest y of its bounds, centred under their
    /// centre, six bounding radii to each side. Does nothing where a ground was added before.
    pub fn add_ground(&mut self) {
        let bounds = self.subject_bounds();
        let Sphere { center, radius } = Sphere::around(bounds);
        let height = if bounds.is_empty() { center.y } else { bounds.min.y };
        self.add_ground_at(height, GROUND_RADII * radius);
    }

    /// [`add_ground`](Self::add_ground) with its height (world y) and half size in metres given.
    pub fn add_ground_at(&mut self, height: f64, half_size: f64) {
        if self.ground.is_some() {
            return;
        }
        let center = Sphere::around(self.subject_bounds()).center;
        self.ground = Some(self.instances.len());
        self.add(
            shapes::floor(half_size).named("ground"),
            DAffine3::from_translation(DVec3::new(center.x, height, center.z)),
        );
    }
}

//! Samples that are known to be deep in shadow or far out in light: whether a shadow is there at all.

use antumbra_gpu::{Gpu, Technique};
use antumbra_reference::ViewSample;
use antumbra_scene::generate::{self, shapes};
use antumbra_scene::{Light, Mesh, Scene};
use glam::{DAffine3, DVec2, DVec3, Vec3};

use super::unit_cube;
use crate::{MeasureError, Stage};

/// Samples of each part whose truth is known.
const SAMPLES: usize = 1 << 13;

/// A scene under a light, with points whose visibility is known.
pub(super) struct Known {
    scene: Scene,
    light: Light,
    /// Point and normal, world space, and whether the point is lit.
    points: Vec<(DVec3, DVec3, bool)>,
}

impl Known {
    pub(super) fn wrong_share(
        &self,
        gpu: &Gpu,
        technique: &mut dyn Technique,
    ) -> Result<f64, MeasureError> {
        let origin = self.scene.origin();
        let samples: Vec<ViewSample> = self
            .points
            .iter()
            .map(|(p, n, _)| ViewSample { position: (*p - origin).as_vec3(), normal: n.as_vec3() })
            .collect();
        let stage = Stage::at_points(gpu, &self.scene, &samples)?;
        let shot = stage.shoot(gpu, &self.light, technique, 0)?;
        let wrong = |((.., lit), v): &(&(DVec3, DVec3, bool), &f32)| (**v > 0.5) != *lit;
        let count = self.points.iter().zip(&shot.visibility).filter(wrong).count();
        Ok(count as f64 / self.points.len() as f64)
    }
}

/// HC-13: two plates facing a spot light at the origin, at 500 m and 500.05 m. With `more`, casters at 0.1 m
/// and 1000 m within the cone, beside the plates as the light sees them, leave a fit of the depth range
/// nothing to gain.
///
/// The plates are a millimetre a texel wide, so that all that biases and kernels do to the side, in texels,
/// is small beside the 5 cm between them, and depth alone decides.
pub(super) fn plates(more: bool, map_size: u32) -> Known {
    let half = 0.0005 * f64::from(map_size);
    // The plate of half side `scale * half * distance / 500` around the direction (x half / 500, 0, -1).
    let plate = |x: f64, distance: f64, scale: f64| {
        let unit = half * distance / 500.0;
        let center = DVec3::new(x * unit, 0.0, -distance);
        shapes::quad(center, scale * unit * DVec3::X, scale * unit * DVec3::Y)
    };
    let mut scene = Scene::default();
    let mut points = Vec::new();
    // As single precision has them, so that the samples lie on the plates.
    for (distance, lit) in [(500.0, true), (f64::from(500.05_f32), false)] {
        scene.add(plate(0.0, distance, 1.0), DAffine3::IDENTITY);
        // The outer fifth is left to the shadow's edge.
        points.extend(unit_cube(SAMPLES).map(|[a, b, _]| {
            let aside = DVec2::new(2.0 * a - 1.0, 2.0 * b - 1.0) * (0.8 * half);
            (aside.extend(-distance), DVec3::Z, lit)
        }));
    }
    if more {
        scene.add(plate(1.3, 0.1, 0.1), DAffine3::IDENTITY);
        scene.add(plate(-1.3, 1000.0, 0.1), DAffine3::IDENTITY);
    }
    let direction = DVec3::NEG_Z;
    let light = Light::Spot { position: DVec3::ZERO, direction, outer_angle: half / 250.0 };
    Known { scene, light, points }
}

/// HC-12: a point light 1 m above a square of 40 m, which is two triangles, and 3 m above a floor of 60 m, all of
/// which lies in its shadow. Of the floor and the square, the inner 20 m are looked at.
pub(super) fn wide_square() -> Known {
    let square = shapes::quad(DVec3::NEG_Y, 20.0 * DVec3::X, 20.0 * DVec3::Z);
    let mut scene = Scene::default();
    scene.add(square, DAffine3::IDENTITY);
    scene.add(shapes::floor(30.0), DAffine3::from_translation(-3.0 * DVec3::Y));
    let points = unit_cube(SAMPLES).flat_map(|[a, b, _]| {
        let aside = DVec3::new(2.0 * a - 1.0, 0.0, 2.0 * b - 1.0) * 10.0;
        [(-1.0, true), (-3.0, false)].map(|(y, lit)| (aside.with_y(y), DVec3::Y, lit))
    });
    Known { points: points.collect(), scene, light: Light::Point { position: DVec3::ZERO } }
}

/// HC-38: a spot light at the origin towards -z, and a quad that rises from 1 m before it to 9 m, always half as
/// wide as it is far. The ray along -z meets it at 1.8 m; half way between its ends, as distances go, are 5 m. Of
/// two plates at 3 m one lies behind it and one below.
pub(super) fn long_edge() -> Known {
    let mut scene = Scene::default();
    let quad = Mesh {
        name: "rising quad".to_owned(),
        positions: vec![
            Vec3::new(-0.5, -0.5, -1.0),
            Vec3::new(0.5, -0.5, -1.0),
            Vec3::new(4.5, 4.5, -9.0),
            Vec3::new(-4.5, 4.5, -9.0),
        ],
        triangles: vec![[0, 1, 2], [0, 2, 3]],
    };
    scene.add(quad, DAffine3::IDENTITY);
    let mut points = Vec::new();
    for (y, lit) in [(0.0, false), (-2.2, true)] {
        let center = DVec3::new(0.0, y, -3.0);
        scene.add(shapes::quad(center, 0.1 * DVec3::X, 0.1 * DVec3::Y), DAffine3::IDENTITY);
        // The outer fifth is left to the plate's own edge.
        points.extend(unit_cube(SAMPLES).map(|[a, b, _]| {
            let aside = DVec2::new(2.0 * a - 1.0, 2.0 * b - 1.0) * 0.08;
            (center + aside.extend(0.0), DVec3::Z, lit)
        }));
    }
    let (position, direction) = (DVec3::ZERO, DVec3::NEG_Z);
    let light = Light::Spot { position, direction, outer_angle: std::f64::consts::FRAC_PI_4 };
    Known { scene, light, points }
}

/// A level disc of points around the origin, between two radii, facing up.
fn ring(inner: f64, outer: f64, lit: bool) -> impl Iterator<Item = (DVec3, DVec3, bool)> {
    unit_cube(SAMPLES).map(move |[a, b, _]| {
        let (sin, cos) = (std::f64::consts::TAU * a).sin_cos();
        let radius = (inner * inner + b * (outer * outer - inner * inner)).sqrt();
        (DVec3::new(sin, 0.0, cos) * radius, DVec3::Y, lit)
    })
}

/// The sun straight overhead.
fn overhead() -> Light {
    Light::Directional { direction: DVec3::NEG_Y, angular_diameter: 0.0 }
}

/// HC-06: HC-01's square under the sun overhead, a single sheet whose front faces the light.
pub(super) fn sheet() -> Known {
    let scene = generate::rectangle_over_plane(&Default::default());
    // The square's shadow holds a circle of 1 m, and is held by one of sqrt(2) m.
    let points = ring(0.0, 0.8, false).chain(ring(1.8, 5.0, true)).collect();
    Known { scene, light: overhead(), points }
}

/// HC-07: a sheet of 4 m at 9 m, and under its middle, where four texels meet, a post a tenth of a texel thick
/// up to 6 m. The post is looked at along its axis, and the floor where the sun overhead reaches it.
pub(super) fn post_under_lid(map_size: u32) -> Known {
    let half = 0.5 * 0.1 * 4.0 / f64::from(map_size);
    let mut scene = Scene::default();
    scene.add(shapes::floor(10.0), DAffine3::IDENTITY);
    scene.add(shapes::quad(9.0 * DVec3::Y, 2.0 * DVec3::Z, 2.0 * DVec3::X), DAffine3::IDENTITY);
    let post = shapes::cuboid(DVec3::new(-half, 0.0, -half), DVec3::new(half, 6.0, half));
    scene.add(post, DAffine3::IDENTITY);
    let along_post = unit_cube(SAMPLES).map(|[a, ..]| (6.0 * a * DVec3::Y, DVec3::Y, false));
    // The lid is held by a circle of sqrt(8) m.
    let points = along_post.chain(ring(3.2, 6.0, true)).collect();
    Known { scene, light: overhead(), points }
}

/// HC-40: the camera stands at (0, 1.7, 0) and looks along -z at an empty floor; the sun shines over its
/// shoulder at 45 degrees past two cubes of 2 m that it does not see, 10 m and 30 m up.
pub(super) fn cubes_out_of_view() -> Known {
    let to_light = DVec3::new(0.0, 1.0, 1.0);
    let mut scene = Scene::default();
    scene.add(shapes::floor(12.0), DAffine3::IDENTITY);
    let mut points = Vec::new();
    for (x, height) in [(-3.0, 10.0), (3.0, 30.0)] {
        let shadow = DVec3::new(x, 0.0, -6.0);
        let center = shadow + to_light * height;
        scene.add(shapes::cuboid(center - DVec3::ONE, center + DVec3::ONE), DAffine3::IDENTITY);
        points.extend(unit_cube(SAMPLES).flat_map(|[a, b, _]| {
            let (sin, cos) = (std::f64::consts::TAU * a).sin_cos();
            let aside = DVec3::new(sin, 0.0, cos);
            // A ray that passes the centre by less than 1 m meets the cube; one that passes it by more
            // than sqrt(3) m, sqrt(6) m along this floor, does not.
            let dark = shadow + aside * (0.5 * b.sqrt());
            let lit = shadow + aside * (3.0 + b);
            [(dark, DVec3::Y, false), (lit, DVec3::Y, true)]
        }));
    }
    Known { scene, light: Light::sun(45_f64.to_radians(), 0.0, 0.0), points }
}

//! One caster over a plane, contact, grazing light, lone convex bodies.

use std::f64::consts::{FRAC_1_SQRT_2, FRAC_PI_4};

use glam::{DAffine3, DVec3};

use super::{empty, look, shapes};
use crate::{Light, Mesh, Scene};

/// Half side of the floor of HC-01 to HC-05 and HC-08: they stand on 20 m x 20 m.
const FLOOR_HALF: f64 = 10.0;

pub(super) fn over_floor(name: &str, caster: Mesh) -> Scene {
    let mut scene = empty(name);
    scene.add(shapes::floor(FLOOR_HALF), DAffine3::IDENTITY);
    scene.add(caster, DAffine3::IDENTITY);
    scene.camera = Some(look([3.0, 6.5, 8.0], [0.0, 0.8, 0.0], 0.1));
    scene
}

/// The lights of HC-01, in the order C, B, A: from (1, 1, 0), straight down, a point at (0, 6, 0).
pub(super) fn lights_of_hc01() -> Vec<Light> {
    vec![
        Light::Directional {
            direction: DVec3::new(-FRAC_1_SQRT_2, -FRAC_1_SQRT_2, 0.0),
            angular_diameter: 0.0,
        },
        Light::Directional { direction: DVec3::NEG_Y, angular_diameter: 0.0 },
        Light::Point { position: DVec3::new(0.0, 6.0, 0.0) },
    ]
}

/// Numbers of [`half_plane_over_plane`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HalfPlaneOverPlane {
    /// Height of the half-plane above the floor, metres, > 0. Default 2.
    pub height: f64,
    /// How far it extends from its edge and to both sides, metres. Default 100.
    pub extent: f64,
}

impl Default for HalfPlaneOverPlane {
    fn default() -> Self {
        Self { height: 2.0, extent: 100.0 }
    }
}

/// The half-plane x <= 0 over the floor y = 0, |x|, |z| <= 10; its edge is the z axis, raised.
///
/// With the default extent its other edges shadow no floor point under any light at least
/// atan(2 / 90) = 1.3 degrees high. Lights: those of HC-01.
#[must_use]
pub fn half_plane_over_plane(numbers: &HalfPlaneOverPlane) -> Scene {
    let HalfPlaneOverPlane { height, extent } = *numbers;
    let center = DVec3::new(-0.5 * extent, height, 0.0);
    let sheet = shapes::quad(center, extent * DVec3::Z, 0.5 * extent * DVec3::X);
    let mut scene = over_floor("half-plane", sheet.named("half-plane"));
    scene.camera = Some(look([7.0, 4.0, 7.0], [-1.5, 0.5, 0.0], 0.1));
    scene.lights = lights_of_hc01();
    scene
}

/// Numbers of [`rectangle_over_plane`]; the defaults are those of HC-01.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RectOverPlane {
    /// Height of the rectangle above the floor, metres, > 0. Default 2.
    pub height: f64,
    /// Half of its side along x, metres, > 0. Default 1.
    pub half_x: f64,
    /// Half of its side along z, metres, > 0. Default 1.
    pub half_z: f64,
}

impl Default for RectOverPlane {
    fn default() -> Self {
        Self { height: 2.0, half_x: 1.0, half_z: 1.0 }
    }
}

/// HC-01: a level rectangle over the middle of the floor y = 0, |x|, |z| <= 10.
///
/// Lights, and the shadow of the default rectangle on the floor: from (1, 1, 0): x in \[-3, -1\],
/// |z| <= 1; straight down: |x|, |z| <= 1; point at (0, 6, 0): |x|, |z| <= 1.5.
#[must_use]
pub fn rectangle_over_plane(numbers: &RectOverPlane) -> Scene {
    let center = numbers.height * DVec3::Y;
    let sheet = shapes::quad(center, numbers.half_z * DVec3::Z, numbers.half_x * DVec3::X);
    let mut scene = over_floor("rectangle", sheet.named("rectangle"));
    scene.lights = lights_of_hc01();
    scene
}

/// Numbers of [`disc_over_plane`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DiscOverPlane {
    /// Height of the disc above the floor, metres, > 0. Default 2.
    pub height: f64,
    /// Radius, metres, > 0. Default 1.
    pub radius: f64,
    /// Triangles of the fan. Default 256: its edge is within radius (1 - cos(pi / 256)) = 0.08 mm
    /// of the circle.
    pub segments: u32,
}

impl Default for DiscOverPlane {
    fn default() -> Self {
        Self { height: 2.0, radius: 1.0, segments: 256 }
    }
}

/// A level disc over the middle of the floor y = 0, |x|, |z| <= 10, with the lights of HC-01.
#[must_use]
pub fn disc_over_plane(numbers: &DiscOverPlane) -> Scene {
    let disc = shapes::disc(numbers.height * DVec3::Y, numbers.radius, numbers.segments);
    let mut scene = over_floor("disc", disc);
    scene.lights = lights_of_hc01();
    scene
}

/// Numbers of [`sphere_over_plane`]; the defaults are those of HC-08.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SphereOverPlane {
    /// Height of the centre above the floor, metres. Default 1.
    pub height: f64,
    /// Radius, metres, > 0. Default 0.5.
    pub radius: f64,
    /// Subdivisions of the icosahedron. Default 4: 5,120 triangles.
    pub subdivisions: u32,
}

impl Default for SphereOverPlane {
    fn default() -> Self {
        Self { height: 1.0, radius: 0.5, subdivisions: 4 }
    }
}

/// HC-08: a sphere over the middle of the floor y = 0, |x|, |z| <= 10. Lights: the sun at 60 degrees
/// over +x, then the point light of HC-01.
#[must_use]
pub fn sphere_over_plane(numbers: &SphereOverPlane) -> Scene {
    let mut sphere = shapes::icosphere(numbers.subdivisions, numbers.radius).named("sphere");
    // Moved in f64 and rounded once more: within an ulp of the moved f32 vertex, and the mesh's own
    // space then is the world, as in all scenes of this file.
    for p in &mut sphere.positions {
        *p = (p.as_dvec3() + numbers.height * DVec3::Y).as_vec3();
    }
    let mut scene = over_floor("sphere", sphere);
    scene.camera = Some(look([1.5, 3.0, 4.0], [-0.3, 0.5, 0.0], 0.1));
    scene.lights = vec![
        Light::sun(60_f64.to_radians(), 90_f64.to_radians(), 0.0),
        Light::Point { position: DVec3::new(0.0, 6.0, 0.0) },
    ];
    scene
}

/// HC-03: nothing but the floor y = 0, |x|, |z| <= 10, lit from 5 degrees above the horizon at
/// `azimuth`, radians around y from +z towards +x. All of it is lit.
///
/// A map of 1024 x 1024 over 20 m x 20 m across the light has texels of 0.0195 m, within half of
/// which the floor's depth changes by 0.0195 / 2 / tan(5 degrees) = 0.112 m.
#[must_use]
pub fn grazing_plane(azimuth: f64) -> Scene {
    let diagonal = azimuth != 0.0;
    let mut scene = empty(if diagonal { "grazing-plane-diagonal" } else { "grazing-plane" });
    scene.add(shapes::floor(FLOOR_HALF), DAffine3::IDENTITY);
    scene.camera = Some(look([6.0, 5.0, 12.0], [0.0, 0.0, 0.0], 0.1));
    scene.lights = vec![Light::sun(5_f64.to_radians(), azimuth, 0.0)];
    scene
}

/// HC-04: a wall 4 m wide, 2 m high, 0.01 m thick stands on the floor across the z axis; the sun
/// shines from 45 degrees above the horizon over +z, at right angles to the wall.
///
/// The shadow covers |x| <= 2 from the wall's foot at z = -0.005 to z = -2.005. A bias of b metres
/// of light depth leaks a strip b cos(45 degrees), less the wall's 0.01, wide: 0.0607 for 0.1.
#[must_use]
pub fn thin_wall() -> Scene {
    let wall = shapes::cuboid(DVec3::new(-2.0, 0.0, -0.005), DVec3::new(2.0, 2.0, 0.005));
    let mut scene = over_floor("thin-wall", wall.named("wall"));
    scene.camera = Some(look([4.0, 4.0, -6.0], [0.0, 0.5, -1.0], 0.1));
    scene.lights = vec![Light::sun(FRAC_PI_4, 0.0, 0.0)];
    scene
}

/// HC-05: a unit cube stands on the middle of the floor, the sun 45 degrees high over +z.
///
/// The shadow on the floor covers |x| <= 0.5 from the cube's foot at z = -0.5 to z = -1.5. A map of
/// back faces with a bias of b leaks b cos(45 degrees) there: 0.0707 for 0.1.
#[must_use]
pub fn cube_on_floor() -> Scene {
    let cube = shapes::cuboid(DVec3::new(-0.5, 0.0, -0.5), DVec3::new(0.5, 1.0, 0.5));
    let mut scene = over_floor("cube", cube.named("cube"));
    scene.camera = Some(look([2.5, 2.5, -3.5], [0.0, 0.4, -0.4], 0.1));
    scene.lights = vec![Light::sun(FRAC_PI_4, 0.0, 0.0)];
    scene
}

/// A body alone, seen and lit as placed from its bounds.
pub(super) fn lone(mesh: Mesh) -> Scene {
    let mut scene = empty(&format!("convex-{}", convex_name(&mesh.name)));
    scene.add(mesh, DAffine3::IDENTITY);
    scene.camera = Some(scene.framing_camera());
    scene.lights = vec![scene.place_light(crate::LightKind::Directional)];
    scene
}

fn convex_name(shape: &str) -> &str {
    match shape {
        "icosphere" => "sphere",
        "cuboid" => "cube",
        other => other,
    }
}

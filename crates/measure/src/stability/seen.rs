//! Cases at the pixels of a camera that looks straight down at the floor and sees nothing else, for techniques that
//! draw from the camera as well as for those that do not.

use antumbra_gpu::{Gpu, Technique};
use antumbra_reference::ViewSample;
use antumbra_scene::generate::{self, shapes};
use antumbra_scene::{Camera, Light, Mesh, Scene};
use glam::{DAffine3, DVec3, Vec3};

use super::edge::{self, FlatCaster, cast};
use crate::{MeasureError, Stage};

/// Side of the view, samples.
const VIEW: u32 = 192;
/// Distance of the near plane, metres.
const NEAR: f64 = 0.1;

/// A camera `height` metres above the floor's point `center`, whose pixels are `pixel` metres wide there.
fn camera_above(center: DVec3, height: f64, pixel: f64) -> Camera {
    let half = 0.5 * f64::from(VIEW) * pixel;
    Camera {
        eye: center + height * DVec3::Y,
        target: center,
        up: DVec3::NEG_Z,
        fov_y: 2.0 * (half / height).atan(),
        near: NEAR,
    }
}

/// The floor at the pixels of `camera`, through whatever is in between.
fn stage(gpu: &Gpu, scene: &Scene, camera: &Camera) -> Result<Stage, MeasureError> {
    let origin = scene.origin();
    let side = f64::from(VIEW);
    let floor = |i: u32| {
        let (x, y) = (f64::from(i % VIEW) + 0.5, f64::from(i / VIEW) + 0.5);
        let ray = camera.ray_direction(x / side, y / side, 1.0);
        let p = (camera.eye - ray * (camera.eye.y / ray.y)).with_y(0.0);
        ViewSample { position: (p - origin).as_vec3(), normal: Vec3::Y }
    };
    let points: Vec<ViewSample> = (0..VIEW * VIEW).map(floor).collect();
    Stage::seen(gpu, scene, camera, (VIEW, VIEW), &points)
}

/// The farthest wrong sample around the shadow of the caster's first corner.
fn around_the_corner(
    gpu: &Gpu,
    technique: &mut dyn Technique,
    caster: &FlatCaster,
) -> Result<f64, MeasureError> {
    let corner = cast(&caster.light, caster.corners[0]).unwrap_or_default();
    let camera = camera_above(corner, 5.0, caster.texel);
    let stage = stage(gpu, &caster.scene, &camera)?;
    caster.farthest_wrong_of(gpu, technique, &stage, &caster.light)
}

/// HC-02, at pixels.
pub(super) fn rising_triangle(
    gpu: &Gpu,
    technique: &mut dyn Technique,
    map_size: u32,
) -> Result<f64, MeasureError> {
    around_the_corner(gpu, technique, &edge::rising_triangle(map_size))
}

/// HC-25: the worst of HC-01's three lights.
pub(super) fn through_the_caster(
    gpu: &Gpu,
    technique: &mut dyn Technique,
    map_size: u32,
) -> Result<f64, MeasureError> {
    let mut farthest = 0.0_f64;
    for light in 0..3 {
        let caster = edge::square(light, map_size);
        farthest = farthest.max(around_the_corner(gpu, technique, &caster)?);
    }
    Ok(farthest)
}

/// HC-23: the camera 6 m above the shadow of a corner, the light at its eye and on its near plane.
pub(super) fn light_at_the_eye(
    gpu: &Gpu,
    technique: &mut dyn Technique,
    map_size: u32,
) -> Result<f64, MeasureError> {
    let caster = edge::square(2, map_size);
    let camera = camera_above(caster.corners[0].with_y(0.0), 6.0, caster.texel);
    let stage = stage(gpu, &caster.scene, &camera)?;
    let mut farthest = 0.0_f64;
    for position in [camera.eye, camera.eye + NEAR * camera.forward()] {
        let light = Light::Point { position };
        farthest = farthest.max(caster.farthest_wrong_of(gpu, technique, &stage, &light)?);
    }
    Ok(farthest)
}

/// HC-22: HC-01's square, turned by 30 degrees, of a quad for x < 0 and two for x > 0, whose common corner lies
/// on the middle of the first one's edge; exactly, and 1e-7 m above. The view is 1.2 m wide, all of it in shadow.
pub(super) fn t_junction(
    gpu: &Gpu,
    technique: &mut dyn Technique,
    map_size: u32,
) -> Result<f64, MeasureError> {
    let mut caster = edge::turned_square(map_size);
    let turn = DAffine3::from_rotation_y(30_f64.to_radians());
    let (mut deep, mut lit) = (0_usize, 0_usize);
    for up in [0.0, 1e-7] {
        let mut scene = Scene::default();
        scene.add(shapes::floor(10.0), DAffine3::IDENTITY);
        scene.add(plate(up), turn);
        caster.scene = scene;
        let camera = camera_above(DVec3::ZERO, 5.0, 1.2 / f64::from(VIEW));
        let stage = stage(gpu, &caster.scene, &camera)?;
        let shot = stage.shoot(gpu, &caster.light, technique, 0)?;
        for (sample, v) in stage.view_samples().iter().zip(&shot.visibility) {
            let p = stage.triangles.origin + sample.position.as_dvec3();
            // 8 texels are more than the kernels in use reach.
            if caster.margin(&caster.light, p) > 8.0 * caster.texel {
                deep += 1;
                lit += usize::from(*v != 0.0);
            }
        }
    }
    Ok(lit as f64 / deep as f64)
}

fn plate(up: f64) -> Mesh {
    let corner = |x: f64, y: f64, z: f64| DVec3::new(x, 2.0 + y, z).as_vec3();
    let positions = vec![
        // The left half, one quad.
        corner(-1.0, 0.0, -1.0),
        corner(0.0, 0.0, -1.0),
        corner(0.0, 0.0, 1.0),
        corner(-1.0, 0.0, 1.0),
        // The right half, two.
        corner(0.0, 0.0, -1.0),
        corner(1.0, 0.0, -1.0),
        corner(1.0, 0.0, 0.0),
        corner(0.0, up, 0.0),
        corner(1.0, 0.0, 1.0),
        corner(0.0, 0.0, 1.0),
    ];
    let triangles = vec![[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7], [7, 6, 8], [7, 8, 9]];
    Mesh { name: "plate".to_owned(), positions, triangles }
}

/// Share of the floor's samples, of 10 m x 10 m, whose visibility is not `right`.
fn share_of_floor(
    gpu: &Gpu,
    technique: &mut dyn Technique,
    scene: &Scene,
    position: DVec3,
    right: fn(f32) -> bool,
) -> Result<f64, MeasureError> {
    let camera = camera_above(DVec3::ZERO, 5.0, 10.0 / f64::from(VIEW));
    let stage = stage(gpu, scene, &camera)?;
    let shot = stage.shoot(gpu, &Light::Point { position }, technique, 0)?;
    // Asked this way round, NaN is wrong.
    let count = shot.visibility.iter().filter(|v| !right(**v)).count();
    Ok(count as f64 / shot.visibility.len() as f64)
}

/// HC-24: the light at a corner of HC-01's square.
pub(super) fn light_at_a_vertex(
    gpu: &Gpu,
    technique: &mut dyn Technique,
) -> Result<f64, MeasureError> {
    let scene = generate::rectangle_over_plane(&Default::default());
    share_of_floor(gpu, technique, &scene, DVec3::new(1.0, 2.0, 1.0), |v| v >= 1.0)
}

/// HC-24: the light in a closed cube of 1 m half a metre above the floor, 0.2 m above its middle.
pub(super) fn light_in_a_cube(
    gpu: &Gpu,
    technique: &mut dyn Technique,
) -> Result<f64, MeasureError> {
    let mut scene = Scene::default();
    scene.add(shapes::floor(10.0), DAffine3::IDENTITY);
    let cube = shapes::cuboid(DVec3::new(-0.5, 0.5, -0.5), DVec3::new(0.5, 1.5, 0.5));
    scene.add(cube, DAffine3::IDENTITY);
    share_of_floor(gpu, technique, &scene, DVec3::new(0.0, 1.2, 0.0), |v| v <= 0.5)
}

/// HC-24: the light 1e-6 m above the floor of HC-01.
pub(super) fn light_on_the_floor(
    gpu: &Gpu,
    technique: &mut dyn Technique,
) -> Result<f64, MeasureError> {
    let scene = generate::rectangle_over_plane(&Default::default());
    share_of_floor(gpu, technique, &scene, DVec3::new(0.3, 1e-6, 0.2), |v| v >= 1.0)
}

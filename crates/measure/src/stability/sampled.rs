//! Cases that are hard on where a map's samples go: views deep and shallow, empty and with gaps, casters far outside of
//! them, lights along them and in them.

use antumbra_gpu::{Gpu, Technique};
use antumbra_reference::ViewSample;
use antumbra_scene::generate::shapes;
use antumbra_scene::{Camera, Light, Mesh, Scene};
use glam::{DAffine3, DVec3, Vec3};

use super::topology::farthest_wrong_under;
use super::viewed::{BAND, Viewed, camera};
use crate::{MeasureError, Stage};

/// Side of the view, samples.
const VIEW: u32 = 128;

fn sun(direction: DVec3) -> Light {
    Light::Directional { direction: direction.normalize(), angular_diameter: 0.0 }
}

/// Looks along -z from a man's height, 53 degrees wide.
fn ahead(near: f64) -> Camera {
    let eye = DVec3::new(0.0, 1.7, 0.0);
    Camera { eye, target: eye - DVec3::Z, up: DVec3::Y, fov_y: 2.0 * 0.5_f64.atan(), near }
}

/// A square plate of a millimetre, a closed body, whose upper side is level.
fn level(center: DVec3, half: f64) -> Mesh {
    let corner = DVec3::new(half, 0.0, half);
    shapes::cuboid(center - corner - 1e-3 * DVec3::Y, center + corner)
}

/// The same, whose front faces +z.
fn upright(center: DVec3, half: f64) -> Mesh {
    let corner = DVec3::new(half, half, 0.0);
    shapes::cuboid(center - corner - 1e-3 * DVec3::Z, center + corner)
}

/// A wall in the plane z, facing +z.
fn wall(z: f64, half: f64) -> Mesh {
    shapes::quad(z * DVec3::Z, half * DVec3::X, half * DVec3::Y)
}

/// A floor, and level plates close above it, each `ratio` times as far as the one before from 4 m on, that cover the
/// same share of the picture each.
fn plates(floor: f64, ratio: f64, count: i32) -> Scene {
    let mut scene = Scene::default();
    scene.add(shapes::floor(floor), DAffine3::IDENTITY);
    for k in 0..count {
        let z = 4.0 * ratio.powi(k);
        let x = if k % 2 == 0 { 0.25 * z } else { -0.25 * z };
        scene.add(level(DVec3::new(x, 0.4, -z), 0.03 * z), DAffine3::IDENTITY);
    }
    scene
}

/// The worst of `scene` under suns of these directions, as [`farthest_wrong_under`].
fn worst(
    gpu: &Gpu,
    technique: &mut dyn Technique,
    (scene, camera): (&Scene, Camera),
    suns: &[DVec3],
    map_size: u32,
) -> Result<f64, MeasureError> {
    let stage = Stage::new(gpu, scene, camera, VIEW, VIEW)?;
    let mut worst = 0.0_f64;
    for direction in suns {
        let light = sun(*direction);
        let found = farthest_wrong_under(gpu, technique, (scene, &stage), &light, map_size)?;
        // NaN, where nothing was judged, is worst.
        worst = if found <= worst { worst } else { found };
    }
    Ok(worst)
}

/// K1: plates from 4 m to 91 m, of 6 % of the picture's width each, under a sun overhead.
pub(super) fn constant_plates(
    gpu: &Gpu,
    technique: &mut dyn Technique,
    map_size: u32,
) -> Result<f64, MeasureError> {
    let scene = plates(120.0, 1.25, 15);
    worst(gpu, technique, (&scene, ahead(1.0)), &[DVec3::NEG_Y], map_size)
}

/// K2: the same under suns from behind the camera and from before it, down to 5 degrees above the floor.
pub(super) fn tilted_suns(
    gpu: &Gpu,
    technique: &mut dyn Technique,
    map_size: u32,
) -> Result<f64, MeasureError> {
    let scene = plates(120.0, 1.25, 15);
    let suns = [60.0, 25.0, 5.0_f64, 155.0, 175.0].map(|tilt| {
        let (sin, cos) = tilt.to_radians().sin_cos();
        DVec3::new(0.0, -sin, -cos)
    });
    worst(gpu, technique, (&scene, ahead(1.0)), &suns, map_size)
}

/// K17: the edge of one plate, 210 m long, runs away from the eye through every slice of depth.
pub(super) fn edge_across_splits(
    gpu: &Gpu,
    technique: &mut dyn Technique,
    map_size: u32,
) -> Result<f64, MeasureError> {
    let mut scene = Scene::default();
    scene.add(shapes::floor(250.0), DAffine3::IDENTITY);
    let plate = shapes::cuboid(DVec3::new(0.0, 2.999, -200.0), DVec3::new(200.0, 3.0, 10.0));
    scene.add(plate, DAffine3::IDENTITY);
    worst(gpu, technique, (&scene, ahead(1.0)), &[DVec3::NEG_Y], map_size)
}

/// K20: a near plane of 10 cm, and plates to 8 km on a floor of 10 km.
pub(super) fn long_horizon(
    gpu: &Gpu,
    technique: &mut dyn Technique,
    map_size: u32,
) -> Result<f64, MeasureError> {
    let scene = plates(10_000.0, 2.0, 12);
    worst(gpu, technique, (&scene, ahead(0.1)), &[DVec3::NEG_Y], map_size)
}

/// Whether points of the plane across `axis` through `center` are lit that a square of half side `half` about `center`
/// shadows, judged outside a band around its edge and up to `most` from the centre.
fn square_shadow(
    axis: DVec3,
    center: DVec3,
    (half, band, most): (f64, f64, f64),
) -> impl Fn(DVec3, Vec3) -> Option<bool> {
    move |p, n| {
        let offset = p - center;
        let in_plane = offset.dot(axis).abs() < 1e-3 * most && n.as_dvec3().dot(axis) > 0.9;
        let aside = (offset - axis * offset.dot(axis)).abs().max_element();
        let judged = in_plane && (aside - half).abs() > band && aside < most;
        judged.then_some(aside > half)
    }
}

/// Looks at a scene from `eye` towards `target`, 90 degrees wide.
fn look(
    gpu: &Gpu,
    technique: &mut dyn Technique,
    (scene, light): (&Scene, &Light),
    (eye, target, near): (DVec3, DVec3, f64),
    lit: &dyn Fn(DVec3, Vec3) -> Option<bool>,
) -> Result<f64, MeasureError> {
    let camera = camera(eye, target, near);
    Viewed { scene, light, camera, far: f64::INFINITY, lit }.wrong_share(gpu, technique)
}

/// K3: a plate before a wall, with the sun at the viewer's back, and a hundredth of a degree off.
pub(super) fn light_along_the_view(
    gpu: &Gpu,
    technique: &mut dyn Technique,
    map_size: u32,
) -> Result<f64, MeasureError> {
    let mut scene = Scene::default();
    scene.add(wall(-20.0, 30.0), DAffine3::IDENTITY);
    scene.add(upright(-10.0 * DVec3::Z, 1.0), DAffine3::IDENTITY);
    let mut worst = 0.0_f64;
    for degrees in [0.0_f64, 0.01, -0.01] {
        let direction = DVec3::new(0.0, -degrees.to_radians().tan(), -1.0);
        let center = DVec3::new(0.0, 10.0 * direction.y, -20.0);
        let band = BAND * 2.0 / f64::from(map_size);
        let lit = square_shadow(DVec3::Z, center, (1.0, band, 15.0));
        // Aside, to see past the plate.
        let views = (DVec3::new(4.0, 0.0, 0.0), DVec3::new(4.0, 0.0, -1.0), 0.1);
        worst = worst.max(look(gpu, technique, (&scene, &sun(direction)), views, &lit)?);
    }
    Ok(worst)
}

/// K7: a slab of 200 m, 300 m up and 150 m behind the camera, shadows the floor before it.
pub(super) fn slab_behind(
    gpu: &Gpu,
    technique: &mut dyn Technique,
    map_size: u32,
) -> Result<f64, MeasureError> {
    let mut scene = Scene::default();
    scene.add(shapes::floor(300.0), DAffine3::IDENTITY);
    scene.add(level(DVec3::new(0.0, 300.0, 150.0), 100.0), DAffine3::IDENTITY);
    let light = sun(DVec3::new(0.0, -1.0, -0.5));
    let band = BAND * 200.0 / f64::from(map_size);
    let lit = square_shadow(DVec3::Y, DVec3::ZERO, (100.0, band, 250.0));
    let views = (DVec3::new(0.0, 60.0, 0.0), DVec3::new(0.0, 20.0, -60.0), 1.0);
    look(gpu, technique, (&scene, &light), views, &lit)
}

/// K7: one triangle of 1 km that crosses the eye's plane and every slice of depth, from close above the floor to 800 m.
pub(super) fn crossing_triangle(
    gpu: &Gpu,
    technique: &mut dyn Technique,
    map_size: u32,
) -> Result<f64, MeasureError> {
    let mut scene = Scene::default();
    scene.add(shapes::floor(150.0), DAffine3::IDENTITY);
    let positions = [[-500.0, 0.5, -10.0], [500.0, 0.5, -10.0], [0.0, 800.0, 500.0]];
    let positions = positions.map(Vec3::from_array).to_vec();
    let triangle = Mesh { name: "triangle".to_owned(), positions, triangles: vec![[0, 1, 2]] };
    scene.add(triangle, DAffine3::IDENTITY);
    // What casts and receives is 300 m wide.
    let band = BAND * 300.0 / f64::from(map_size);
    let lit = |p: DVec3, n: Vec3| {
        let judged = p.y.abs() < 1e-3 && n.y > 0.9 && (p.z + 10.0).abs() > band;
        judged.then_some(p.z < -10.0)
    };
    let views = (DVec3::new(0.0, 10.0, 60.0), DVec3::new(0.0, 5.0, 40.0), 1.0);
    look(gpu, technique, (&scene, &sun(DVec3::NEG_Y)), views, &lit)
}

/// K8: spot lights that shine at the viewer, from behind, away ahead, and down from above; half of what is seen may lie
/// behind the light. Each has a plate before it whose shadow on the floor is twice as large.
pub(super) fn spots(
    gpu: &Gpu,
    technique: &mut dyn Technique,
    map_size: u32,
) -> Result<f64, MeasureError> {
    let mut worst = 0.0_f64;
    for (position, direction, plate_z, half) in [
        (DVec3::new(0.0, 3.0, -20.0), DVec3::new(0.0, -0.15, 1.0), -12.0, 1.0),
        (DVec3::new(0.0, 3.0, 5.0), DVec3::new(0.0, -0.1, -1.0), -3.0, 1.0),
        (DVec3::new(0.0, 3.0, -20.0), DVec3::new(0.0, -0.15, -1.0), -26.0, 1.0),
        (DVec3::new(0.0, 40.0, -50.0), DVec3::NEG_Y, -46.0, 4.0),
    ] {
        let mut scene = Scene::default();
        scene.add(shapes::floor(60.0), DAffine3::IDENTITY);
        let plate = DVec3::new(0.0, 0.5 * position.y, plate_z);
        scene.add(level(plate, half), DAffine3::IDENTITY);
        let light = Light::Spot {
            position,
            direction: direction.normalize(),
            outer_angle: 45_f64.to_radians(),
        };
        let center = (2.0 * plate - position).with_y(0.0);
        // In perspective some of the map's texels are larger than others: by less than 2.
        let band = BAND * 4.0 * half / f64::from(map_size) * 2.0;
        let lit = square_shadow(DVec3::Y, center, (2.0 * half, band, 3.8 * half));
        let eye = DVec3::new(0.0, 4.0, 0.0);
        worst = worst.max(look(gpu, technique, (&scene, &light), (eye, center, 0.1), &lit)?);
    }
    Ok(worst)
}

/// K9: the camera looks up and sees nothing; then one pixel of it sees one dark point.
pub(super) fn nothing_in_view(
    gpu: &Gpu,
    technique: &mut dyn Technique,
) -> Result<f64, MeasureError> {
    let mut scene = Scene::default();
    scene.add(shapes::floor(50.0), DAffine3::IDENTITY);
    scene.add(level(DVec3::new(0.0, 2.0, -8.0), 2.0), DAffine3::IDENTITY);
    let up = Camera { target: DVec3::new(0.0, 60.0, -10.0), ..ahead(1.0) };
    let sky = Stage::new(gpu, &scene, up, 8, 8)?.shoot(gpu, &sun(DVec3::NEG_Y), technique, 0)?;
    let dark = [ViewSample { position: Vec3::new(0.0, 0.0, -8.0), normal: Vec3::Y }];
    let one = Stage::seen(gpu, &scene, &ahead(1.0), (8, 8), &dark)?;
    let one = one.shoot(gpu, &sun(DVec3::NEG_Y), technique, 0)?;
    let off = |v: &&f32| **v != 1.0;
    let wrong = sky.visibility.iter().filter(off).count()
        + one.visibility[1..].iter().filter(off).count()
        + usize::from(one.visibility[0] != 0.0);
    Ok(wrong as f64 / 128.0)
}

/// K10: one wall fills the picture, so that all depths are the same; what shadows it is out of view.
pub(super) fn flat_depth(
    gpu: &Gpu,
    technique: &mut dyn Technique,
    map_size: u32,
) -> Result<f64, MeasureError> {
    let mut scene = Scene::default();
    scene.add(wall(-10.0, 40.0), DAffine3::IDENTITY);
    scene.add(upright(DVec3::new(12.0, 0.0, -5.0), 2.0), DAffine3::IDENTITY);
    let light = sun(DVec3::new(-12.0, 0.0, -5.0));
    let band = BAND * 4.0 / f64::from(map_size);
    let lit = square_shadow(DVec3::Z, DVec3::new(0.0, 0.0, -10.0), (2.0, band, 9.0));
    look(gpu, technique, (&scene, &light), (DVec3::ZERO, DVec3::NEG_Z, 0.1), &lit)
}

/// K11: a thing in the hand at 1.1 m, and a landscape from 400 m to 1000 m with a plate of 200 m above.
pub(super) fn depth_gap(
    gpu: &Gpu,
    technique: &mut dyn Technique,
    map_size: u32,
) -> Result<f64, MeasureError> {
    let mut scene = Scene::default();
    let center = DVec3::new(0.0, -60.0, -700.0);
    scene.add(shapes::quad(center, 300.0 * DVec3::Z, 600.0 * DVec3::X), DAffine3::IDENTITY);
    scene.add(level(center + 50.0 * DVec3::Y, 100.0), DAffine3::IDENTITY);
    let hand = DVec3::new(0.3, -0.3, -1.2);
    scene.add(shapes::cuboid(hand - 0.1, hand + 0.1), DAffine3::IDENTITY);
    // As the sun sees them, hand and plate are 900 m apart at most.
    let band = BAND * 900.0 / f64::from(map_size);
    let lit = square_shadow(DVec3::Y, center, (100.0, band, 290.0));
    let views = (DVec3::ZERO, DVec3::new(0.0, -60.0, -600.0), 0.1);
    look(gpu, technique, (&scene, &sun(DVec3::NEG_Y)), views, &lit)
}

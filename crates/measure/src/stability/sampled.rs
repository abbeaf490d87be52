//! Cases that are hard on where a map's samples go: views deep and shallow, empty and with gaps, casters far outside of
//! them, lights along them and in them.

use std::f64::consts::TAU;

use antumbra_gpu::{Gpu, Technique};
use antumbra_reference::ViewSample;
use antumbra_scene::generate::shapes;
use antumbra_scene::{Camera, Light, Mesh, Scene};
use glam::{DAffine3, DVec3, Vec3};

use super::topology::{farthest_wrong_under, is_floor};
use super::unit_cube;
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
    wall_between(z * DVec3::Z, half * DVec3::X, half * DVec3::Y)
}

/// A wall of these half sides, facing along their cross product.
fn wall_between(center: DVec3, half_u: DVec3, half_v: DVec3) -> Mesh {
    shapes::quad(center, half_u, half_v).named("wall")
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
    let suns = suns.iter().map(|direction| {
        let judged = (map_size, is_floor as fn(DVec3, Vec3) -> bool);
        farthest_wrong_under(gpu, technique, (scene, &stage), &sun(*direction), judged)
    });
    largest(suns)
}

/// The largest; NaN, where nothing was judged, is larger than all.
fn largest(numbers: impl Iterator<Item = Result<f64, MeasureError>>) -> Result<f64, MeasureError> {
    let mut largest = 0.0_f64;
    for number in numbers {
        let number = number?;
        largest = if number <= largest { largest } else { number };
    }
    Ok(largest)
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

/// K4 a: a wall that faces the viewer, half a degree off the light, under a plate 2 cm deep: across the light a texel is
/// what it is, down the wall 115 times as long.
pub(super) fn facing_wall(
    gpu: &Gpu,
    technique: &mut dyn Technique,
    map_size: u32,
) -> Result<f64, MeasureError> {
    let (sin, cos) = 0.5_f64.to_radians().sin_cos();
    let mut scene = Scene::default();
    let wall = wall_between(DVec3::new(0.0, 4.0, -20.0), 10.0 * DVec3::X, 4.0 * DVec3::Y);
    scene.add(wall, DAffine3::IDENTITY);
    let plate = shapes::cuboid(DVec3::new(-10.0, 8.999, -19.97), DVec3::new(10.0, 9.0, -19.95));
    scene.add(plate, DAffine3::IDENTITY);
    let is_wall = |p: DVec3, n: Vec3| n == Vec3::Z && p.y < 8.5;
    edge_on(gpu, technique, &scene, DVec3::new(0.0, -cos, -sin), (map_size, is_wall))
}

/// K4 b: the same for a wall beside the viewer that runs away from him.
pub(super) fn side_wall(
    gpu: &Gpu,
    technique: &mut dyn Technique,
    map_size: u32,
) -> Result<f64, MeasureError> {
    let (sin, cos) = 0.5_f64.to_radians().sin_cos();
    let is_wall = |p: DVec3, n: Vec3| n == Vec3::NEG_X && p.y < 4.1;
    edge_on(gpu, technique, &beside_a_wall(), DVec3::new(sin, -cos, 0.0), (map_size, is_wall))
}

/// K16: the light shines along that wall, whose samples fall into one column of the map. The floor is judged: on the
/// wall light and shadow are one.
pub(super) fn pile_up(
    gpu: &Gpu,
    technique: &mut dyn Technique,
    map_size: u32,
) -> Result<f64, MeasureError> {
    let mut scene = beside_a_wall();
    scene.add(shapes::floor(120.0), DAffine3::IDENTITY);
    edge_on(gpu, technique, &scene, DVec3::NEG_Y, (map_size, is_floor))
}

/// A wall from 1 m to 100 m away, 2 m to the right, that faces left, and above it a plate of its length and 1.5 cm.
fn beside_a_wall() -> Scene {
    let mut scene = Scene::default();
    let wall = wall_between(DVec3::new(2.0, 2.0, -50.5), 49.5 * DVec3::Z, 2.0 * DVec3::Y);
    scene.add(wall, DAffine3::IDENTITY);
    let plate = shapes::cuboid(DVec3::new(1.97, 4.499, -100.0), DVec3::new(1.985, 4.5, -1.0));
    scene.add(plate, DAffine3::IDENTITY);
    scene
}

fn edge_on(
    gpu: &Gpu,
    technique: &mut dyn Technique,
    scene: &Scene,
    direction: DVec3,
    judged: (u32, fn(DVec3, Vec3) -> bool),
) -> Result<f64, MeasureError> {
    let stage = Stage::new(gpu, scene, ahead(1.0), VIEW, VIEW)?;
    farthest_wrong_under(gpu, technique, (scene, &stage), &sun(direction), judged)
}

/// K5: the mean visibility behind a fence of bars of 2 cm every 10 cm, 80 m away and 2 m high, less the four fifths that
/// lie between the bars.
pub(super) fn far_fence(gpu: &Gpu, technique: &mut dyn Technique) -> Result<f64, MeasureError> {
    let mut scene = Scene::default();
    scene.add(shapes::floor(120.0), DAffine3::IDENTITY);
    let mut fence = Mesh { name: "fence".to_owned(), ..Mesh::default() };
    for bar in -400..=400 {
        let x = 0.1 * f64::from(bar);
        // Just above the floor, so that points of it are clearly none of the fence's.
        let bar = shapes::quad(DVec3::new(x, 1.001, -80.0), 0.01 * DVec3::X, DVec3::Y);
        let first = fence.positions.len() as u32;
        fence.triangles.extend(bar.triangles.iter().map(|t| t.map(|corner| first + corner)));
        fence.positions.extend(bar.positions);
    }
    scene.add(fence, DAffine3::IDENTITY);
    let light = sun(DVec3::new(0.5, -std::f64::consts::FRAC_1_SQRT_2, 0.5));
    let points: Vec<_> = unit_cube(SIDE * SIDE)
        .map(|[a, b, _]| DVec3::new(70.0 * a - 35.0, 0.0, -79.9 + 1.2 * b) - scene.origin())
        .map(|p| ViewSample { position: p.as_vec3(), normal: Vec3::Y })
        .collect();
    let size = (SIDE as u32, SIDE as u32);
    let stage = Stage::seen(gpu, &scene, &ahead(1.0), size, &points)?;
    let visibility = stage.shoot(gpu, &light, technique, 0)?.visibility;
    let mean = visibility.iter().map(|v| f64::from(*v)).sum::<f64>() / points.len() as f64;
    Ok((mean - 0.8).abs())
}

/// Side of the square of samples that K5 and K18 take.
const SIDE: usize = 128;

/// K6: as the viewer walks past a wall with a gap, towers 900 m off come into view and go. Plates before the wall throw
/// their shadows on it.
pub(super) fn skyline(
    gpu: &Gpu,
    technique: &mut dyn Technique,
    map_size: u32,
) -> Result<f64, MeasureError> {
    let mut scene = Scene::default();
    for (left, right) in [(-30.0, 4.0), (6.0, 30.0)] {
        let (middle, half) = (0.5 * (left + right), 0.5 * (right - left));
        let part = wall_between(DVec3::new(middle, 7.5, -20.0), half * DVec3::X, 7.5 * DVec3::Y);
        scene.add(part, DAffine3::IDENTITY);
    }
    for k in 0..10 {
        let corner = DVec3::new(100.0 * f64::from(k) - 460.0, 0.0, -920.0);
        let tower = shapes::cuboid(corner, corner + DVec3::new(20.0, 80.0, 20.0));
        scene.add(tower, DAffine3::IDENTITY);
    }
    for k in 0..8 {
        let center = DVec3::new(5.0 * f64::from(k) - 17.0, 6.0, -19.0);
        scene.add(upright(center, 1.0), DAffine3::IDENTITY);
    }
    let light = sun(DVec3::new(0.2, -1.0, -1.0));
    let steps = [-10.0, 0.0, 5.0].map(|x| {
        let mut camera = ahead(1.0);
        camera.eye.x = x;
        camera.target.x = x;
        let stage = Stage::new(gpu, &scene, camera, VIEW, VIEW)?;
        let judged: (_, fn(DVec3, Vec3) -> bool) =
            (map_size, |p, n| n == Vec3::Z && (p.z + 20.0).abs() < 1e-4);
        farthest_wrong_under(gpu, technique, (&scene, &stage), &light, judged)
    });
    largest(steps.into_iter())
}

/// K14: the share of K1's samples that change when all of it moves by 1000 and by 8000 kilometres, in steps of the grid on
/// which origins lie ([`Scene::origin`]).
pub(super) fn far_away(gpu: &Gpu, technique: &mut dyn Technique) -> Result<f64, MeasureError> {
    let scene = plates(120.0, 1.25, 15);
    let mut shoot = |offset: DVec3| -> Result<Vec<f32>, MeasureError> {
        let mut camera = ahead(1.0);
        camera.eye += offset;
        camera.target += offset;
        let stage = Stage::new(gpu, &scene.translated(offset), camera, VIEW, VIEW)?;
        Ok(stage.shoot(gpu, &sun(DVec3::NEG_Y), technique, 0)?.visibility)
    };
    let here = shoot(DVec3::ZERO)?;
    largest([20, 23].into_iter().map(|power| {
        let metres = 2f64.powi(power);
        let there = shoot(DVec3::new(metres, 0.0, metres))?;
        let changed = here.iter().zip(&there).filter(|(a, b)| a != b).count();
        Ok(changed as f64 / here.len() as f64)
    }))
}

/// K18: the share of lit samples under a fan of 64 triangles around a vertex, most of them on the shadow of an edge
/// between two, under six suns a degree apart.
pub(super) fn fan(gpu: &Gpu, technique: &mut dyn Technique) -> Result<f64, MeasureError> {
    let mut scene = Scene::default();
    scene.add(shapes::floor(4.0), DAffine3::IDENTITY);
    scene.add(shapes::disc(DVec3::Y, 2.0, 64), DAffine3::IDENTITY);
    let suns = (0..6).map(|degrees| {
        let (sin, cos) = f64::from(degrees).to_radians().sin_cos();
        let direction = DVec3::new(0.3 * cos, -1.0, 0.3 * sin);
        // From the middle towards the rim and the edges between the triangles, up to where a kernel reaches beyond.
        let under = |i: usize| {
            let (sin, cos) = (TAU * (i / SIDE) as f64 / 64.0).sin_cos();
            let out = DVec3::new(sin, 0.0, cos) * (1.3 * (i % SIDE) as f64 / SIDE as f64);
            let position = DVec3::Y + direction + out - scene.origin();
            ViewSample { position: position.as_vec3(), normal: Vec3::Y }
        };
        let points: Vec<_> = (0..64 * SIDE).map(under).collect();
        let stage = Stage::at_points(gpu, &scene, &points)?;
        let visibility = stage.shoot(gpu, &sun(direction), technique, 0)?.visibility;
        // Asked this way round, NaN is wrong.
        let dark = visibility[..points.len()].iter().filter(|v| **v <= 0.5).count();
        Ok((points.len() - dark) as f64 / points.len() as f64)
    });
    largest(suns)
}

/// K19: triangles that are points and lines, that are there twice and once more the other way round, and that the sun
/// sees edge-on.
pub(super) fn odd_triangles(
    gpu: &Gpu,
    technique: &mut dyn Technique,
    map_size: u32,
) -> Result<f64, MeasureError> {
    let mut scene = Scene::default();
    scene.add(shapes::floor(6.0), DAffine3::IDENTITY);
    let positions = [
        [0.0, 1.0, 0.0],
        [1.0, 1.0, 0.0],
        [2.0, 1.0, 0.0],
        [1.0, 1.5, 1.0],
        [-1.0, 0.5, -1.0],
        [-1.0, 2.0, -1.0],
        [0.5, 4.0, 0.25],
    ];
    let mesh = Mesh {
        name: "odd triangles".to_owned(),
        positions: positions.map(Vec3::from_array).to_vec(),
        triangles: vec![[0, 0, 0], [0, 1, 2], [0, 2, 3], [0, 2, 3], [0, 3, 2], [4, 5, 6]],
    };
    scene.add(mesh, DAffine3::IDENTITY);
    let eye = DVec3::new(0.0, 6.0, 6.0);
    worst(gpu, technique, (&scene, camera(eye, DVec3::ZERO, 0.1)), &[DVec3::NEG_Y], map_size)
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
    let landscape = shapes::quad(center, 300.0 * DVec3::Z, 600.0 * DVec3::X).named("floor");
    scene.add(landscape, DAffine3::IDENTITY);
    scene.add(level(center + 50.0 * DVec3::Y, 100.0), DAffine3::IDENTITY);
    let hand = DVec3::new(0.3, -0.3, -1.2);
    scene.add(shapes::cuboid(hand - 0.1, hand + 0.1), DAffine3::IDENTITY);
    let seen = camera(DVec3::ZERO, DVec3::new(0.0, -60.0, -600.0), 0.1);
    let stage = Stage::new(gpu, &scene, seen, VIEW, VIEW)?;
    let judged: (_, fn(DVec3, Vec3) -> bool) = (map_size, |p, n| n == Vec3::Y && p.y < -59.0);
    farthest_wrong_under(gpu, technique, (&scene, &stage), &sun(DVec3::NEG_Y), judged)
}

//! Lights with an extent: of no size and larger than the scene, with casters at the receiver and at the light, and casters
//! that move.
//!
//! A texel counts for all that it covers or for nothing, and techniques look at every so-manieth texel of large windows, so
//! that silhouettes are known to a 64th of the map at best: what such a step explains is no error here. The map is that of
//! all casters, floor and all, as the light's centre sees them.

use antumbra_gpu::{Gpu, Technique};
use antumbra_reference::closed::{Occluder, visibility};
use antumbra_reference::{TruthOptions, ViewSample};
use antumbra_scene::generate::shapes;
use antumbra_scene::{Light, Scene};
use glam::{DAffine3, DVec3, Vec3};

use super::{edge, unit_cube};
use crate::{MeasureError, Stage};

/// Of the map, what a silhouette may be off by.
const STEP: f64 = 1.0 / 64.0;

/// A square light of half size `half`, `height` above the origin, that faces down.
fn square_light(height: f64, half: f64) -> Light {
    Light::Rect { center: DVec3::Y * height, half_u: DVec3::X * half, half_v: DVec3::NEG_Z * half }
}

fn on_floor(p: &DVec3) -> ViewSample {
    ViewSample { position: p.as_vec3(), normal: Vec3::Y }
}

/// Distance of `found` from the interval between two numbers; NaN stays NaN.
fn beyond(found: f32, a: f64, b: f64) -> f64 {
    let found = f64::from(found);
    if found.is_nan() { found } else { (a.min(b) - found).max(found - a.max(b)).max(0.0) }
}

/// The larger, or NaN.
fn worse(a: f64, b: f64) -> f64 {
    if b > a || b.is_nan() { b } else { a }
}

/// The square of HC-01 under lights of each kind that have no size: the distance of the farthest wrong sample from the
/// hard shadow's edge, ideal texels.
pub(super) fn of_no_size(
    gpu: &Gpu,
    technique: &mut dyn Technique,
    map_size: u32,
) -> Result<f64, MeasureError> {
    let caster = edge::square(2, map_size);
    let stage = caster.stage(gpu)?;
    let center = caster.light.position().unwrap_or(DVec3::Y);
    let (x, z) = (DVec3::X, DVec3::Z);
    let lights = [
        Light::Rect { center, half_u: DVec3::ZERO, half_v: DVec3::ZERO },
        Light::Disc { center, radius: 0.0, axis_u: x, axis_v: z },
        Light::Sphere { center, radius: 0.0 },
    ];
    let mut farthest = 0.0;
    for light in lights {
        let found = caster.farthest_wrong_of(gpu, technique, &stage, &light)?;
        farthest = worse(farthest, found);
    }
    Ok(farthest)
}

/// A level square of 2 m, 2 m above a floor of 8 m, under square lights 6 m above it whose half sides go from 1 mm to
/// 100 m. The largest error of visibility beyond that of a square a step larger or smaller.
pub(super) fn of_any_size(gpu: &Gpu, technique: &mut dyn Technique) -> Result<f64, MeasureError> {
    let (height, above, floor) = (6.0, 2.0, 4.0);
    let mut scene = Scene::default();
    scene.add(shapes::floor(floor), DAffine3::IDENTITY);
    scene.add(shapes::quad(DVec3::Y * above, DVec3::Z, DVec3::X), DAffine3::IDENTITY);
    let points: Vec<DVec3> = unit_cube(1 << 9)
        .map(|[a, b, _]| DVec3::new(2.0 * a - 1.0, 0.0, 2.0 * b - 1.0) * floor)
        .collect();
    let samples: Vec<ViewSample> = points.iter().map(on_floor).collect();
    let stage = Stage::at_points(gpu, &scene, &samples)?;
    let step = STEP * 2.0 * floor * (height - above) / height;
    let square =
        |half: f64| Occluder::rectangle(DVec3::Y * above, DVec3::Z * half, DVec3::X * half);
    let (small, large) = (square(1.0 - step), square(1.0 + step));
    let mut worst = 0.0;
    for half in [1e-3, 0.1, 1.0, 10.0, 100.0] {
        let light = square_light(height, half);
        let shot = stage.shoot(gpu, &light, technique, 0)?;
        for (p, v) in points.iter().zip(&shot.visibility) {
            let bounds = [&small, &large].map(|square| visibility(square, &light, *p));
            worst = worse(worst, beyond(*v, bounds[0], bounds[1]));
        }
    }
    Ok(worst)
}

/// A box of 1 m on a floor, 10 m below a square light of half size 1: at d from its side 0.25 + 4.5 d of the light is seen. The
/// largest error within 0.17 m of the box, beyond that of a box a step wider or narrower.
pub(super) fn contact(gpu: &Gpu, technique: &mut dyn Technique) -> Result<f64, MeasureError> {
    let (height, floor) = (10.0, 0.8);
    let mut scene = Scene::default();
    scene.add(shapes::floor(floor), DAffine3::IDENTITY);
    let corner = DVec3::new(0.5, 1.0, 0.5);
    scene.add(shapes::cuboid(-corner.with_y(0.0), corner), DAffine3::IDENTITY);
    // Rays to the light pass the box's top within 0.1 m of the receiver, along the side.
    let distances: Vec<f64> = unit_cube(1 << 8).map(|[a, ..]| 0.002 + 0.168 * a).collect();
    let samples: Vec<ViewSample> = distances
        .iter()
        .zip(unit_cube(1 << 8))
        .map(|(d, [_, b, _])| on_floor(&DVec3::new(0.5 + d, 0.0, 0.6 * b - 0.3)))
        .collect();
    let stage = Stage::at_points(gpu, &scene, &samples)?;
    let step = STEP * 2.0 * floor * (height - corner.y) / height;
    let truth = |d: f64| (0.25 + 4.5 * d).clamp(0.0, 1.0);
    let shot = stage.shoot(gpu, &square_light(height, 1.0), technique, 0)?;
    let errors = distances.iter().zip(&shot.visibility);
    Ok(errors.fold(0.0, |worst, (d, v)| worse(worst, beyond(*v, truth(d - step), truth(d + step)))))
}

/// A plate a tenth of a millimetre below a square light and larger than it hides all of it from the floor: the mean
/// visibility.
pub(super) fn at_the_light(gpu: &Gpu, technique: &mut dyn Technique) -> Result<f64, MeasureError> {
    let mut scene = Scene::default();
    scene.add(shapes::floor(4.0), DAffine3::IDENTITY);
    let center = DVec3::Y * (10.0 - 1e-4);
    scene.add(shapes::quad(center, DVec3::Z * 1.5, DVec3::X * 1.5), DAffine3::IDENTITY);
    let samples: Vec<ViewSample> = unit_cube(1 << 8)
        .map(|[a, b, _]| on_floor(&(DVec3::new(2.0 * a - 1.0, 0.0, 2.0 * b - 1.0) * 3.0)))
        .collect();
    let stage = Stage::at_points(gpu, &scene, &samples)?;
    let shot = stage.shoot(gpu, &square_light(10.0, 1.0), technique, 0)?;
    let sum: f64 = shot.visibility[..samples.len()].iter().map(|v| f64::from(*v)).sum();
    Ok(sum / samples.len() as f64)
}

/// Frames of what moves.
const FRAMES: u32 = 13;

/// Points on the floor across what moves.
fn across() -> Vec<DVec3> {
    (0..32).map(|i| DVec3::new(-2.4 + 4.8 / 31.0 * f64::from(i), 0.0, 0.05)).collect()
}

/// The largest second difference, over three frames, of the error at any of [`across`]: `casters` adds what is there at a
/// time from 0 to 1, `truth` tells the visibility then.
fn flicker(
    gpu: &Gpu,
    technique: &mut dyn Technique,
    casters: impl Fn(&mut Scene, f64),
    truth: impl Fn(&Stage, &Light, f64) -> Vec<f64>,
) -> Result<f64, MeasureError> {
    let light = square_light(10.0, 1.0);
    let samples: Vec<ViewSample> = across().iter().map(on_floor).collect();
    let mut errors: Vec<Vec<f64>> = Vec::new();
    for frame in 0..FRAMES {
        let t = f64::from(frame) / f64::from(FRAMES - 1);
        let mut scene = Scene::default();
        scene.add(shapes::floor(3.0), DAffine3::IDENTITY);
        casters(&mut scene, t);
        let stage = Stage::at_points(gpu, &scene, &samples)?;
        let shot = stage.shoot(gpu, &light, technique, 0)?;
        let pairs = shot.visibility.iter().zip(truth(&stage, &light, t));
        errors.push(pairs.map(|(found, truth)| f64::from(*found) - truth).collect());
    }
    let second = |three: &[Vec<f64>], i: usize| three[0][i] - 2.0 * three[1][i] + three[2][i];
    let all = errors.windows(3).flat_map(|three| (0..samples.len()).map(move |i| second(three, i)));
    Ok(all.fold(0.0, |worst, difference| worse(worst, difference.abs())))
}

/// A ball of 0.2 m, 2 m below the light, passes before a plate 4 m further down, 63 mm a frame.
pub(super) fn passing_ball(gpu: &Gpu, technique: &mut dyn Technique) -> Result<f64, MeasureError> {
    let casters = |scene: &mut Scene, t: f64| {
        let (x, z) = (DVec3::X * 0.5, DVec3::Z * 0.5);
        scene.add(shapes::quad(DVec3::Y * 4.0, z, x), DAffine3::IDENTITY);
        let place = DVec3::new(0.0635 * f64::from(FRAMES - 1) * (t - 0.5), 8.0, 0.0);
        scene.add(shapes::icosphere(3, 0.2), DAffine3::from_translation(place));
    };
    flicker(gpu, technique, casters, |stage, light, _| {
        let options = TruthOptions { light_samples: 4096, ..TruthOptions::default() };
        stage.truth(light, &options).visibility.iter().map(|v| f64::from(*v)).collect()
    })
}

/// A plate of 2 m sinks from 4.9 m to 5.1 m below the light.
pub(super) fn sinking_plate(gpu: &Gpu, technique: &mut dyn Technique) -> Result<f64, MeasureError> {
    let center = |t: f64| DVec3::Y * (5.1 - 0.2 * t);
    let casters = |scene: &mut Scene, t: f64| {
        scene.add(shapes::quad(center(t), DVec3::Z, DVec3::X), DAffine3::IDENTITY);
    };
    flicker(gpu, technique, casters, |_, light, t| {
        let plate = Occluder::rectangle(center(t), DVec3::Z, DVec3::X);
        across().iter().map(|p| visibility(&plate, light, *p)).collect()
    })
}

//! Samples that stand still while the camera moves: a map fitted to what is seen must not swim under them.

use antumbra_gpu::{Gpu, Technique};
use antumbra_reference::ViewSample;
use antumbra_scene::generate::shapes;
use antumbra_scene::{Camera, Light, Scene};
use glam::{DAffine3, DVec3, Vec3};

use super::unit_cube;
use crate::{MeasureError, Stage};

/// Samples on the floor.
const SAMPLES: usize = 1 << 14;

/// Frames, each a step after the one before.
const FRAMES: u32 = 24;

/// Metres that the camera moves a frame.
const STEP: f64 = 0.003;

/// HC-39: a camera 12 m above a field of boxes creeps along it. The largest mean change of visibility from one
/// frame to the next, over floor samples that it sees in all of them.
///
/// Cubes of 1 m hang 1 m above the floor, every 3 m; the sun stands at 45 degrees, so that each casts a shadow of
/// 1 m by 2 m. The field reaches far beyond what is seen, so that a fit to all casters differs from one to what
/// the camera sees, which is 14 m wide.
pub(super) fn creeping_camera(
    gpu: &Gpu,
    technique: &mut dyn Technique,
) -> Result<f64, MeasureError> {
    moving_camera(gpu, technique, |frame| {
        let target = DVec3::new(STEP, 0.0, STEP) * frame;
        (target + 12.0 * DVec3::Y, target)
    })
}

/// K15: the same with a camera that turns where it is, by a hundredth of a degree a frame.
pub(super) fn turning_camera(
    gpu: &Gpu,
    technique: &mut dyn Technique,
) -> Result<f64, MeasureError> {
    moving_camera(gpu, technique, |frame| {
        let target = DVec3::new(12.0 * (0.01_f64.to_radians() * frame).tan(), 0.0, 0.0);
        (12.0 * DVec3::Y, target)
    })
}

/// The largest mean change from one frame to the next, for a camera whose eye and target `place` gives a frame.
fn moving_camera(
    gpu: &Gpu,
    technique: &mut dyn Technique,
    place: impl Fn(f64) -> (DVec3, DVec3),
) -> Result<f64, MeasureError> {
    let mut scene = Scene::default();
    scene.add(shapes::floor(40.0), DAffine3::IDENTITY);
    for (x, z) in (-10..=10).flat_map(|x| (-10..=10).map(move |z| (f64::from(x), f64::from(z)))) {
        let center = DVec3::new(3.0 * x, 1.5, 3.0 * z);
        scene.add(shapes::cuboid(center - 0.5, center + 0.5), DAffine3::IDENTITY);
    }
    let light = Light::sun(45_f64.to_radians(), 0.3, 0.0);
    let points: Vec<ViewSample> = unit_cube(SAMPLES)
        .map(|[a, b, _]| DVec3::new(2.0 * a - 1.0, 0.0, 2.0 * b - 1.0) * 4.0)
        .map(|p| ViewSample { position: p.as_vec3(), normal: Vec3::Y })
        .collect();
    let mut stage = Stage::at_points(gpu, &scene, &points)?;
    let (mut before, mut largest) = (None::<Vec<f32>>, 0.0_f64);
    for frame in 0..FRAMES {
        let (eye, target) = place(frame.into());
        let camera =
            Camera { eye, target, up: DVec3::NEG_Z, fov_y: 60_f64.to_radians(), near: 0.1 };
        stage.set_camera(Some(stage.meshes.view_camera(&camera, (1, 1))));
        let visibility = stage.shoot(gpu, &light, technique, 0)?.visibility;
        if let Some(before) = before {
            let pairs = before.iter().zip(&visibility).take(SAMPLES);
            let change: f64 = pairs.map(|(a, b)| f64::from((a - b).abs())).sum();
            largest = largest.max(change / SAMPLES as f64);
        }
        before = Some(visibility);
    }
    Ok(largest)
}

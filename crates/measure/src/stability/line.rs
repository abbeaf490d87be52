//! Samples along one line of the floor: contact with the caster, and the shadow of a wire.

use antumbra_gpu::{Gpu, Technique};
use antumbra_reference::{ViewSample, contact_gap};
use antumbra_scene::generate::{self, shapes};
use antumbra_scene::{Light, Scene};
use glam::{DAffine3, DVec3, Vec3};

use crate::{MeasureError, Stage};

/// Samples on the line: at least 4 a texel of a map of 4096.
const SAMPLES: usize = 1 << 14;

/// Visibility at the floor points `place(t)`, t ascending in (0, 1), and those t.
fn visibility_along(
    gpu: &Gpu,
    scene: &Scene,
    light: &Light,
    technique: &mut dyn Technique,
    place: impl Fn(f64) -> DVec3,
) -> Result<(Vec<f64>, Vec<f32>), MeasureError> {
    let along: Vec<f64> = (0..SAMPLES).map(|i| (i as f64 + 0.5) / SAMPLES as f64).collect();
    let floor = |t: &f64| ViewSample { position: place(*t).as_vec3(), normal: Vec3::Y };
    let points: Vec<ViewSample> = along.iter().map(floor).collect();
    let stage = Stage::at_points(gpu, scene, &points)?;
    let mut visibility = stage.shoot(gpu, light, technique, 0)?.visibility;
    visibility.truncate(SAMPLES);
    Ok((along, visibility))
}

/// The gap between a caster's foot at z = `foot` and its shadow towards -z, in texels of `texel` metres of
/// floor. The shadow is at least a metre long, and the first metre is looked at.
fn gap(
    gpu: &Gpu,
    technique: &mut dyn Technique,
    scene: &Scene,
    foot: f64,
    texel: f64,
) -> Result<f64, MeasureError> {
    // Off the middle, where no texel's edge runs along the line.
    let place = |t: f64| DVec3::new(0.1, 0.0, foot - t);
    let (metres, visibility) = visibility_along(gpu, scene, &scene.lights[0], technique, place)?;
    Ok(contact_gap(&metres, &visibility, &vec![0.0; SAMPLES], texel)?)
}

/// HC-04. The wall and its shadow at 45 degrees: 2 m of height and 0.01 m of thickness.
pub(super) fn thin_wall(
    gpu: &Gpu,
    technique: &mut dyn Technique,
    map_size: u32,
) -> Result<f64, MeasureError> {
    gap(gpu, technique, &generate::thin_wall(), -0.005, 2.01 / f64::from(map_size))
}

/// HC-05. The cube and its shadow at 45 degrees: 1 m of height and 1 m of depth.
pub(super) fn cube(
    gpu: &Gpu,
    technique: &mut dyn Technique,
    map_size: u32,
) -> Result<f64, MeasureError> {
    gap(gpu, technique, &generate::cube_on_floor(), -0.5, 2.0 / f64::from(map_size))
}

/// HC-31: mean visibility on the floor under the axis of a wire 0.4 texels thick. Everything there is in
/// shadow.
///
/// The sun stands overhead and the wire runs at 30 degrees to the map's axes; two small cubes at opposite
/// corners hold the map to 20.48 m, so that a map of 1024 has the case's texel of 0.02 m.
pub(super) fn wire(
    gpu: &Gpu,
    technique: &mut dyn Technique,
    map_size: u32,
) -> Result<f64, MeasureError> {
    const HALF_EXTENT: f64 = 10.24;
    let radius = 0.2 * 2.0 * HALF_EXTENT / f64::from(map_size);
    let (sin, cos) = 30_f64.to_radians().sin_cos();
    let half = 2.0 * DVec3::new(cos, 0.0, sin);
    let mut scene = Scene::default();
    scene.add(shapes::floor(1.5 * HALF_EXTENT), DAffine3::IDENTITY);
    scene.add(
        shapes::frustum(DVec3::Y - half, DVec3::Y + half, radius, radius, 8),
        DAffine3::IDENTITY,
    );
    for sign in [-1.0, 1.0] {
        // 10 cm a side, the outer corner at the map's.
        let center = DVec3::new(sign, 0.0, sign) * (HALF_EXTENT - 0.05) + DVec3::Y;
        let half = DVec3::splat(0.05);
        scene.add(shapes::cuboid(center - half, center + half), DAffine3::IDENTITY);
    }
    let light = Light::Directional { direction: DVec3::NEG_Y, angular_diameter: 0.0 };
    // Less 40 cm at either end, so that kernels do not reach beyond the wire.
    let place = |t: f64| half * ((2.0 * t - 1.0) * 0.8);
    let (_, visibility) = visibility_along(gpu, &scene, &light, technique, place)?;
    Ok(visibility.iter().map(|v| f64::from(*v)).sum::<f64>() / SAMPLES as f64)
}

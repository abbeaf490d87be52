//! Flat casters over a floor: how far from the shadow's edge anything on the floor is wrong.

use antumbra_gpu::{Gpu, Technique};
use antumbra_map::basis;
use antumbra_reference::closed::{Occluder, shadow_margin};
use antumbra_reference::{SampleClass, TruthOptions};
use antumbra_scene::{Instance, Light, Scene};
use glam::{DVec2, DVec3, Vec3};

use crate::{MeasureError, Stage};

/// Side of the view, samples.
const VIEW: u32 = 256;
/// As for the flat casters of `edge`: a filter's weights add up to 1 within this.
const ROUNDING: f64 = 1e-5;

/// The largest distance, as the light sees it, of a wrong sample of the floor from the shadow's edge, texels, with the
/// sun overhead; 0 where nothing is wrong.
pub(super) fn farthest_wrong(
    gpu: &Gpu,
    technique: &mut dyn Technique,
    scene: &Scene,
    map_size: u32,
) -> Result<f64, MeasureError> {
    let stage = Stage::new(gpu, scene, scene.camera_or_framing(), VIEW, VIEW)?;
    let overhead = Light::Directional { direction: DVec3::NEG_Y, angular_diameter: 0.0 };
    farthest_wrong_under(gpu, technique, (scene, &stage), &overhead, (map_size, is_floor))
}

/// Whether a point with this normal is one of the floor.
pub(super) fn is_floor(p: DVec3, n: Vec3) -> bool {
    n == Vec3::Y && p.y == 0.0
}

/// The same under any sun, at those of a stage's samples that lie on a receiver, one that is called floor or wall.
pub(super) fn farthest_wrong_under(
    gpu: &Gpu,
    technique: &mut dyn Technique,
    (scene, stage): (&Scene, &Stage),
    light: &Light,
    (map_size, is_receiver): (u32, fn(DVec3, Vec3) -> bool),
) -> Result<f64, MeasureError> {
    let texel = ideal_side(scene, light) / f64::from(map_size);
    let shot = stage.shoot(gpu, light, technique, 0)?;
    let truth = stage.truth(light, &TruthOptions { ties: true, ..TruthOptions::default() });
    let triangles = occluders(scene, light);
    let (mut farthest, mut judged) = (0.0_f64, 0);
    for (i, sample) in stage.view_samples().iter().enumerate() {
        let p = stage.triangles.origin + sample.position.as_dvec3();
        if !is_receiver(p, sample.normal) || truth.class[i] != SampleClass::Counted {
            continue;
        }
        judged += 1;
        let right = (shot.visibility[i] - truth.visibility[i]).abs() <= ROUNDING as f32;
        // Asked this way round, NaN is wrong.
        if !right {
            // Inside the shadow of one triangle one is at least as far inside that of all.
            let margins = triangles.iter().map(|t| shadow_margin(t, light, p));
            farthest = farthest.max(margins.fold(f64::NEG_INFINITY, f64::max).abs());
        }
    }
    Ok(if judged == 0 { f64::NAN } else { farthest / texel })
}

/// What casts.
fn casters(scene: &Scene) -> impl Iterator<Item = &Instance> {
    scene.instances.iter().filter(|i| i.name != "floor" && i.name != "wall")
}

/// The longer side of the boxes around the casters, as the sun sees them, metres.
fn ideal_side(scene: &Scene, light: &Light) -> f64 {
    let rows = basis(light.towards(DVec3::ZERO, DVec2::splat(0.5)).normalize());
    let corners: Vec<DVec3> =
        casters(scene).flat_map(|i| scene.instance_bounds(i).corners()).collect();
    let side = |i: usize| {
        let places = corners.iter().map(|p| rows.row(i).dot(*p));
        let none = (f64::INFINITY, f64::NEG_INFINITY);
        let (lo, hi) = places.fold(none, |(lo, hi), v| (lo.min(v), hi.max(v)));
        hi - lo
    };
    side(0).max(side(1))
}

/// The casters' triangles that the sun does not see edge-on: those shadow nothing.
fn occluders(scene: &Scene, sun: &Light) -> Vec<Occluder> {
    let to_light = sun.towards(DVec3::ZERO, DVec2::splat(0.5));
    let triangles = casters(scene).flat_map(|instance| {
        let mesh = &scene.meshes[instance.mesh];
        let corner =
            |i: u32| instance.transform.transform_point3(mesh.positions[i as usize].as_dvec3());
        mesh.triangles.iter().map(move |t| t.map(corner))
    });
    triangles
        .filter(|[a, b, c]| (*b - *a).cross(*c - *a).dot(to_light) != 0.0)
        .map(|c| Occluder::ConvexPolygon(c.to_vec()))
        .collect()
}

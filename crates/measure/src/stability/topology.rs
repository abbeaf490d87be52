//! Casters that are no closed bodies, over a floor: how far from the shadow's edge anything on the floor is wrong.

use antumbra_gpu::{Gpu, Technique};
use antumbra_reference::closed::{Occluder, shadow_margin};
use antumbra_reference::{SampleClass, TruthOptions};
use antumbra_scene::{Bounds, Light, Scene};
use glam::{DVec3, Vec3};

use crate::{MeasureError, Stage};

/// Side of the view, samples.
const VIEW: u32 = 256;
/// As for the flat casters of `edge`: a filter's weights add up to 1 within this.
const ROUNDING: f64 = 1e-5;

/// The distance, as the light sees it, of the farthest wrong sample of the floor from the shadow's edge, texels,
/// with the sun overhead; 0 where nothing is wrong.
pub(super) fn farthest_wrong(
    gpu: &Gpu,
    technique: &mut dyn Technique,
    scene: &Scene,
    map_size: u32,
) -> Result<f64, MeasureError> {
    let light = Light::Directional { direction: DVec3::NEG_Y, angular_diameter: 0.0 };
    let casters = scene.instances.iter().filter(|instance| instance.name != "floor");
    let bounds = casters.fold(Bounds::EMPTY, |b, i| b.union(scene.instance_bounds(i)));
    let size = bounds.max - bounds.min;
    let texel = size.x.max(size.z) / f64::from(map_size);
    let stage = Stage::new(gpu, scene, scene.camera_or_framing(), VIEW, VIEW)?;
    let shot = stage.shoot(gpu, &light, technique, 0)?;
    let truth = stage.truth(&light, &TruthOptions { ties: true, ..TruthOptions::default() });
    let triangles = occluders(&stage);
    let (mut farthest, mut judged) = (0.0_f64, 0);
    for (i, sample) in stage.view_samples().iter().enumerate() {
        let on_floor = sample.normal == Vec3::Y && sample.position.y == 0.0;
        if !on_floor || truth.class[i] != SampleClass::Counted {
            continue;
        }
        judged += 1;
        let right = (shot.visibility[i] - truth.visibility[i]).abs() <= ROUNDING as f32;
        // Asked this way round, NaN is wrong.
        if !right {
            // Inside the shadow of one triangle one is at least as far inside that of all.
            let p = stage.triangles.origin + sample.position.as_dvec3();
            let margins = triangles.iter().map(|t| shadow_margin(t, &light, p));
            farthest = farthest.max(margins.fold(f64::NEG_INFINITY, f64::max).abs());
        }
    }
    Ok(if judged == 0 { f64::NAN } else { farthest / texel })
}

/// The casters' triangles that the sun overhead does not see edge-on: those shadow nothing.
fn occluders(stage: &Stage) -> Vec<Occluder> {
    let all = &stage.triangles;
    let corner = |i: u32| all.origin + all.positions[i as usize].as_dvec3();
    let corners = all.triangles.iter().map(|t| t.map(corner));
    corners
        .filter(|c| c.iter().any(|p| p.y > 0.0))
        .filter(|[a, b, c]| (*b - *a).cross(*c - *a).y != 0.0)
        .map(|c| Occluder::ConvexPolygon(c.to_vec()))
        .collect()
}

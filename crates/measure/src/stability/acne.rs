//! Cases seen by a camera: false shadow on lone receivers, and independence of where the scene stands.

use antumbra_gpu::{Gpu, Technique};
use antumbra_scene::{Light, LightKind, Scene, generate};
use glam::{DVec2, DVec3, Vec3};

use crate::{MeasureError, Stage};

/// Side of the view, samples.
const VIEW: u32 = 192;

/// A stage on which every body casts, floors included: they would otherwise be culled, and with them
/// the false shadow that is looked for.
fn stage(gpu: &Gpu, scene: &Scene) -> Result<Stage, MeasureError> {
    let mut stage = Stage::new(gpu, scene, scene.camera_or_framing(), VIEW, VIEW)?;
    stage.meshes.set_culling(false);
    Ok(stage)
}

/// Samples that face the light, and how many of them are not fully lit.
#[derive(Default)]
struct Count {
    facing: usize,
    dark: usize,
}

impl Count {
    fn add(
        &mut self,
        gpu: &Gpu,
        stage: &Stage,
        light: &Light,
        technique: &mut dyn Technique,
    ) -> Result<(), MeasureError> {
        let shot = stage.shoot(gpu, light, technique, 0)?;
        for (sample, v) in stage.view_samples().iter().zip(&shot.visibility) {
            if sample.normal == Vec3::ZERO {
                continue;
            }
            let p = stage.triangles.origin + sample.position.as_dvec3();
            let to_light = light.towards(p, DVec2::splat(0.5)).normalize();
            // Of a face seen edge-on by the light, the sign of the cosine is rounding's: 1e-4 is far
            // beyond that, and still within 0.006 degrees of the edge.
            if sample.normal.as_dvec3().dot(to_light) > 1e-4 {
                self.facing += 1;
                self.dark += usize::from(*v < 1.0);
            }
        }
        Ok(())
    }

    fn rate(&self) -> f64 {
        self.dark as f64 / self.facing as f64
    }
}

/// False shadow on the four convex bodies, each alone.
pub(super) fn lone_receivers(
    gpu: &Gpu,
    technique: &mut dyn Technique,
    kind: LightKind,
) -> Result<f64, MeasureError> {
    let mut count = Count::default();
    for (_, build, _) in generate::CONVEX {
        let scene = build();
        count.add(gpu, &stage(gpu, &scene)?, &scene.place_light(kind), technique)?;
    }
    Ok(count.rate())
}

/// False shadow on HC-03's floor.
pub(super) fn grazing_plane(
    gpu: &Gpu,
    technique: &mut dyn Technique,
    azimuth: f64,
) -> Result<f64, MeasureError> {
    let scene = generate::grazing_plane(azimuth);
    let mut count = Count::default();
    count.add(gpu, &stage(gpu, &scene)?, &scene.lights[0], technique)?;
    Ok(count.rate())
}

/// HC-14: the share of samples of HC-01 and HC-03 that change when the scene moves far out.
pub(super) fn moved(gpu: &Gpu, technique: &mut dyn Technique) -> Result<f64, MeasureError> {
    let offset = DVec3::new(1e5, 0.0, 1e5);
    let (mut changed, mut all) = (0, 0);
    for scene in [generate::rectangle_over_plane(&Default::default()), generate::grazing_plane(0.0)]
    {
        let there = scene.translated(offset);
        let (home_stage, there_stage) = (stage(gpu, &scene)?, stage(gpu, &there)?);
        for (home, away) in scene.lights.iter().zip(&there.lights) {
            let before = home_stage.shoot(gpu, home, technique, 0)?.visibility;
            let after = there_stage.shoot(gpu, away, technique, 0)?.visibility;
            changed += before.iter().zip(&after).filter(|(a, b)| a != b).count();
            all += before.len();
        }
    }
    Ok(changed as f64 / all as f64)
}

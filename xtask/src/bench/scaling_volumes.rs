//! Shadow volumes against what they are made of: a sphere in more and more triangles, whose silhouette grows as the square
//! root of their number.

use antumbra::Config;
use antumbra::volume::Silhouette;
use antumbra_gpu::Gpu;
use antumbra_measure::Stage;
use antumbra_reference::TruthOptions;
use antumbra_scene::generate::shapes;
use antumbra_scene::{Light, Scene};
use glam::{DAffine3, DVec3};
use indicatif::ProgressBar;

use super::plan::{Entry, Plan};
use super::scaling::{point, shoot};
use crate::results::ScalingCurve;

/// How often the triangles of an icosahedron are divided in four: 80 to 20,480 of them.
const DIVISIONS: std::ops::RangeInclusive<u32> = 1..=5;
const PARAMETERS: [&str; 2] = ["triangles", "silhouette_sides"];

fn entries(plan: &Plan) -> Vec<&Entry> {
    plan.techniques.iter().filter(|entry| entry.config.id().starts_with("volume/")).collect()
}

/// Steps of the progress bar.
pub(super) fn steps(plan: &Plan) -> usize {
    plan.lights.len() * DIVISIONS.count() * entries(plan).len()
}

/// A sphere above a floor.
fn scene(divisions: u32) -> Scene {
    let mut scene = Scene::default();
    scene.add(shapes::floor(5.0), DAffine3::IDENTITY);
    scene.add(shapes::icosphere(divisions, 1.0), DAffine3::from_translation(1.3 * DVec3::Y));
    scene
}

/// The sides that silhouettes leave of all volumes.
fn silhouette_sides(gpu: &Gpu, stage: &Stage, light: &Light) -> anyhow::Result<u32> {
    let config = Silhouette { culling: false, ..Silhouette::default() };
    let mut technique = config.technique(gpu)?;
    let shot = stage.shoot(gpu, light, &mut technique, 0)?;
    Ok(u32::try_from(shot.counters["volume_sides"])?)
}

/// Measures the curves of the plan's shadow volumes.
pub(super) fn measure(
    gpu: &Gpu,
    plan: &Plan,
    progress: &ProgressBar,
) -> anyhow::Result<Vec<ScalingCurve>> {
    let entries = entries(plan);
    if entries.is_empty() {
        return Ok(Vec::new());
    }
    let [width, height] = plan.settings.size;
    let options = TruthOptions { ties: true, ..TruthOptions::default() };
    let configs: Vec<Config> = entries.iter().map(|entry| entry.config.clone()).collect();
    let mut curves = Vec::new();
    for kind in &plan.lights {
        // The camera and the light are those of the coarsest sphere.
        let first = scene(*DIVISIONS.start());
        let (camera, light) = (first.camera_or_framing(), first.light_or_placed(*kind));
        let mut group: Vec<ScalingCurve> = PARAMETERS
            .iter()
            .flat_map(|parameter| {
                entries.iter().map(|entry| ScalingCurve {
                    scene: "sphere, divided".to_owned(),
                    light,
                    technique: entry.name.clone(),
                    parameter: (*parameter).to_owned(),
                    points: Vec::new(),
                })
            })
            .collect();
        for divisions in DIVISIONS {
            progress.set_message(format!("sphere, divided · {} · {divisions}", kind.name()));
            let scene = scene(divisions);
            let stage = Stage::new(gpu, &scene, camera, width, height)?;
            let truth = stage.truth(&light, &options);
            let values =
                [u32::try_from(scene.triangle_count())?, silhouette_sides(gpu, &stage, &light)?];
            let shots = shoot(gpu, plan, &stage, &light, &configs)?;
            for (i, curve) in group.iter_mut().enumerate() {
                let shot = &shots[i % shots.len()];
                curve.points.push(point(values[i / shots.len()], shot, &truth, width)?);
            }
            progress.inc(entries.len() as u64);
        }
        curves.extend(group);
    }
    Ok(curves)
}

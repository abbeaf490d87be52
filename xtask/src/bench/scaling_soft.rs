//! Soft shadows against what they may cost: the light's size, the samples in penumbrae, the texels of a window; and the passes
//! that make their stores against sides and doublings.

use antumbra::Config;
use antumbra_gpu::{Gpu, PassTimes};
use antumbra_measure::{Shot, Stage};
use antumbra_reference::{SampleClass, Truth, TruthOptions};
use antumbra_scene::{Light, generate};
use antumbra_soft::Widths;
use anyhow::Context as _;
use indicatif::ProgressBar;

use super::plan::{Entry, Plan};
use super::scaling::{point, shoot};
use crate::results::{ScalingCurve, ScalingPoint, Spread};

/// The generated scene: a curved caster over a plane, all of whose shadow is seen.
const SCENE: &str = "sphere";

/// Sides of the light, per cent of those that the scene has: 16-fold.
const LIGHT_SIDES: [u32; 5] = [25, 50, 100, 200, 400];

/// Sides of the view, samples: those in penumbrae grow with the square.
const VIEW_SIDES: [u32; 4] = [64, 128, 256, 512];

/// Most texels a side of a window that are looked at.
const BUDGETS: [u32; 5] = [8, 16, 32, 64, 128];

/// Sides of occlusion textures, as in table 1 of Eisemann, Decoret 2008.
const PREFILTER_SIDES: [u32; 3] = [256, 512, 1024];

/// Passes of a shadow-width map, as in table 1 of Kirsch, Doellner 2003.
const DOUBLINGS: [u32; 6] = [1, 2, 4, 6, 8, 10];

/// A store's passes, whose time is the curve's, against a parameter.
struct StorePasses {
    parameter: &'static str,
    values: &'static [u32],
    passes: &'static [&'static str],
    /// Sets the parameter; whether the technique has it.
    set: fn(&mut Config, u32) -> bool,
}

const STORES: [StorePasses; 2] = [
    StorePasses {
        parameter: "prefilter_side",
        values: &PREFILTER_SIDES,
        passes: &["soft/sum", "soft/levels"],
        set: |config, side| match config {
            Config::OcclusionTextures(settings) => {
                settings.map.size = side;
                true
            }
            _ => false,
        },
    },
    StorePasses {
        parameter: "doublings",
        values: &DOUBLINGS,
        passes: &["soft/widths"],
        set: |config, count| match config {
            Config::SingleSample(settings) if settings.widths == Widths::Doubling => {
                settings.doublings = count;
                true
            }
            _ => false,
        },
    },
];

impl StorePasses {
    fn entries<'a>(&self, entries: &[&'a Entry]) -> Vec<&'a Entry> {
        entries.iter().copied().filter(|e| (self.set)(&mut e.config.clone(), 1)).collect()
    }

    /// The median over repetitions of the passes' time, milliseconds.
    fn time(&self, shot: &Shot) -> Option<f64> {
        let of = |times: &PassTimes| {
            let passes = times.passes.iter().filter(|pass| self.passes.contains(&pass.name));
            passes.map(|pass| pass.ms).sum()
        };
        Spread::of(&shot.passes.iter().map(of).collect::<Vec<f64>>()).map(|spread| spread.median)
    }
}

fn entries(plan: &Plan) -> Vec<&Entry> {
    plan.techniques.iter().filter(|entry| entry.config.id().starts_with("soft/")).collect()
}

/// Those of the lights that have an extent.
fn lights(plan: &Plan) -> anyhow::Result<Vec<Light>> {
    let scene = generate::by_name(SCENE).context("the scene is not there")?;
    let all = plan.lights.iter().map(|kind| scene.light_or_placed(*kind));
    Ok(all.filter(|light| !light.is_hard()).collect())
}

/// Steps of the progress bar.
pub(super) fn steps(plan: &Plan) -> usize {
    let windows = entries(plan).iter().filter(|entry| has_budget(&entry.config)).count();
    let whole = LIGHT_SIDES.len() + VIEW_SIDES.len();
    let stores = STORES.iter().map(|s| s.values.len() * s.entries(&entries(plan)).len());
    lights(plan).map_or(0, |lights| lights.len())
        * (whole * entries(plan).len() + BUDGETS.len() * windows + stores.sum::<usize>())
}

/// The light with sides so many per cent as long.
fn scaled(light: &Light, per_cent: u32) -> Light {
    let by = f64::from(per_cent) / 100.0;
    match *light {
        Light::Directional { direction, angular_diameter } => {
            let tangent = (0.5 * angular_diameter).tan() * by;
            Light::Directional { direction, angular_diameter: 2.0 * tangent.atan() }
        }
        Light::Sphere { center, radius } => Light::Sphere { center, radius: radius * by },
        Light::Disc { center, radius, axis_u, axis_v } => {
            Light::Disc { center, radius: radius * by, axis_u, axis_v }
        }
        Light::Rect { center, half_u, half_v } => {
            Light::Rect { center, half_u: half_u * by, half_v: half_v * by }
        }
        Light::Point { .. } | Light::Spot { .. } => *light,
    }
}

/// Sets the most texels a side of the window; whether the technique has such.
fn set_budget(config: &mut Config, budget: u32) -> bool {
    let window = match config {
        Config::Pcss(settings) => &mut settings.window,
        Config::BackProjection(settings) => &mut settings.window,
        Config::Bitmask(settings) => &mut settings.window,
        Config::RadialSearch(settings) => &mut settings.window,
        _ => return false,
    };
    window.budget = budget;
    true
}

fn has_budget(config: &Config) -> bool {
    set_budget(&mut config.clone(), 64)
}

fn in_penumbra(truth: &Truth) -> u32 {
    let both = truth.visibility.iter().zip(&truth.class);
    both.filter(|(v, class)| **class == SampleClass::Counted && **v > 0.0 && **v < 1.0).count()
        as u32
}

/// Measures the curves of the plan's soft shadows.
pub(super) fn measure(
    gpu: &Gpu,
    plan: &Plan,
    progress: &ProgressBar,
) -> anyhow::Result<Vec<ScalingCurve>> {
    let entries = entries(plan);
    let mut curves = Vec::new();
    if entries.is_empty() {
        return Ok(curves);
    }
    let scene = generate::by_name(SCENE).context("the scene is not there")?;
    let camera = scene.camera_or_framing();
    let options =
        TruthOptions { light_samples: plan.settings.light_samples, ..TruthOptions::default() };
    let [width, height] = plan.settings.size;
    let stage = Stage::new(gpu, &scene, camera, width, height)?;
    let configs = |entries: &[&Entry]| -> Vec<Config> {
        entries.iter().map(|entry| entry.config.clone()).collect()
    };
    for light in lights(plan)? {
        let start = |parameter: &str, entries: &[&Entry]| -> Vec<ScalingCurve> {
            let curve = |entry: &&Entry| ScalingCurve {
                scene: SCENE.to_owned(),
                light,
                technique: entry.name.clone(),
                parameter: parameter.to_owned(),
                points: Vec::new(),
            };
            entries.iter().map(curve).collect()
        };

        let mut group = start("light_side_percent", &entries);
        for value in LIGHT_SIDES {
            progress.set_message(format!("{SCENE} · light {value} %"));
            let light = scaled(&light, value);
            let truth = stage.truth(&light, &options);
            let shots = shoot(gpu, plan, &stage, &light, &configs(&entries))?;
            for (curve, shot) in group.iter_mut().zip(&shots) {
                curve.points.push(point(value, shot, &truth, width)?);
            }
            progress.inc(entries.len() as u64);
        }
        curves.append(&mut group);

        let mut group = start("penumbra_samples", &entries);
        for side in VIEW_SIDES {
            progress.set_message(format!("{SCENE} · {side} x {side} samples"));
            let stage = Stage::new(gpu, &scene, camera, side, side)?;
            let truth = stage.truth(&light, &options);
            let shots = shoot(gpu, plan, &stage, &light, &configs(&entries))?;
            for (curve, shot) in group.iter_mut().zip(&shots) {
                curve.points.push(point(in_penumbra(&truth), shot, &truth, side)?);
            }
            progress.inc(entries.len() as u64);
        }
        curves.append(&mut group);

        let windowed: Vec<&Entry> =
            entries.iter().copied().filter(|entry| has_budget(&entry.config)).collect();
        let mut group = start("window_budget", &windowed);
        let truth = stage.truth(&light, &options);
        for value in BUDGETS {
            progress.set_message(format!("{SCENE} · windows of {value} texels"));
            let mut configs = configs(&windowed);
            configs.iter_mut().for_each(|config| {
                set_budget(config, value);
            });
            let shots = shoot(gpu, plan, &stage, &light, &configs)?;
            for (curve, shot) in group.iter_mut().zip(&shots) {
                curve.points.push(point(value, shot, &truth, width)?);
            }
            progress.inc(windowed.len() as u64);
        }
        curves.append(&mut group);

        for store in &STORES {
            let stored = store.entries(&entries);
            let mut group = start(store.parameter, &stored);
            for value in store.values {
                progress.set_message(format!("{SCENE} · {} {value}", store.parameter));
                let mut configs = configs(&stored);
                configs.iter_mut().for_each(|config| {
                    (store.set)(config, *value);
                });
                let shots = shoot(gpu, plan, &stage, &light, &configs)?;
                for (curve, shot) in group.iter_mut().zip(&shots) {
                    let gpu_ms = store.time(shot);
                    let all = point(*value, shot, &truth, width)?;
                    curve.points.push(ScalingPoint { gpu_ms, ..all });
                }
                progress.inc(stored.len() as u64);
            }
            curves.append(&mut group);
        }
    }
    Ok(curves)
}

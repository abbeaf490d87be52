//! The scaling suite: error and time against the size of the map, against the radius of a filter, of soft shadows against
//! lights, views and windows, and of shadow volumes against what they are made of.

use std::slice;

use antumbra::Config;
use antumbra_gpu::{Gpu, GpuError};
use antumbra_measure::{MeasureError, Shot, Stage};
use antumbra_reference::{Comparison, Truth, TruthOptions};
use antumbra_scene::Light;
use antumbra_scene::generate::{HalfPlaneOverPlane, half_plane_over_plane, street};
use anyhow::Context as _;
use glam::DAffine3;
use indicatif::ProgressBar;

use super::plan::{Entry, PLACED, Plan, QUICK_TECHNIQUES, Subject};
use super::{kernels, scaling_soft, scaling_volumes};
use crate::results::{ScalingCurve, ScalingPoint, Spread};

/// Sides of the map, texels.
const MAP_SIZES: [u32; 6] = [128, 256, 512, 1024, 2048, 4096];

/// One parameter of some techniques, and its values.
pub(super) struct Sweep {
    pub(super) parameter: &'static str,
    pub(super) values: &'static [u32],
    pub(super) set: fn(&mut Config, u32),
    pub(super) entries: Vec<Entry>,
}

fn has_map(entry: &Entry) -> bool {
    let mut sized = entry.config.clone();
    MAP_SIZES.iter().any(|size| {
        sized.set_map_size(*size);
        sized != entry.config
    })
}

fn sweeps(plan: &Plan, subject: &Subject) -> Vec<Sweep> {
    let wanted = |e: &&Entry| subject.only.is_empty() || subject.only.contains(&e.name.as_str());
    let techniques: Vec<Entry> = plan.techniques.iter().filter(wanted).cloned().collect();
    let map_size = Sweep {
        parameter: "map_size",
        values: &MAP_SIZES,
        set: |config, size| config.set_map_size(size),
        // The others would be the same at every size, which is shown where it is asked for.
        entries: techniques
            .into_iter()
            .filter(|entry| has_map(entry) || subject.only.contains(&entry.name.as_str()))
            .filter(|entry| !kernels::is_only_here(entry))
            .collect(),
    };
    // Kernels are compared on the scene of filters.
    let kernels = (subject.only != PLACED).then(|| kernels::sweep(plan));
    [map_size].into_iter().chain(kernels).filter(|s| !s.entries.is_empty()).collect()
}

/// The scenes where none is asked for, each with its own of the `default` techniques, or with all that are asked for.
///
/// One straight shadow edge, for filters: the caster is 10 m deep, not 100, because the map is fitted to it, and turned
/// by 20 degrees, because an edge along the texels' rows would have no error at all where the fit lays it between two of
/// them, as it does at the window's border. And a street, seen along its length, for what puts a map's samples where
/// they are seen.
pub(super) fn subjects(default: bool) -> Vec<Subject> {
    let numbers = HalfPlaneOverPlane { extent: 10.0, ..HalfPlaneOverPlane::default() };
    let mut scene = half_plane_over_plane(&numbers);
    for instance in scene.instances.iter_mut().filter(|i| i.name == "half-plane") {
        instance.transform = DAffine3::from_rotation_y(20_f64.to_radians());
    }
    vec![
        Subject {
            name: "half-plane, 10 m, turned".to_owned(),
            slug: "half-plane-turned".to_owned(),
            scene,
            only: if default { &QUICK_TECHNIQUES } else { &[] },
        },
        Subject {
            name: "street".to_owned(),
            slug: "street".to_owned(),
            scene: street(),
            only: if default { &PLACED } else { &[] },
        },
    ]
}

/// Steps of the progress bar.
pub(super) fn steps(plan: &Plan) -> usize {
    let points = |sweep: &Sweep| sweep.values.len() * sweep.entries.len();
    let of = |subject| sweeps(plan, subject).iter().map(points).sum::<usize>();
    plan.lights.len() * plan.scenes.iter().map(of).sum::<usize>()
        + scaling_soft::steps(plan)
        + scaling_volumes::steps(plan)
}

/// Measures every curve of the plan.
pub(super) fn measure(
    gpu: &Gpu,
    plan: &Plan,
    progress: &ProgressBar,
) -> anyhow::Result<Vec<ScalingCurve>> {
    let [width, height] = plan.settings.size;
    let options = TruthOptions {
        light_samples: plan.settings.light_samples,
        ties: true,
        ..TruthOptions::default()
    };
    let mut curves = Vec::new();
    for subject in &plan.scenes {
        let camera = subject.scene.camera_or_framing();
        let stage = Stage::new(gpu, &subject.scene, camera, width, height)
            .with_context(|| subject.name.clone())?;
        for kind in &plan.lights {
            let light = subject.scene.light_or_placed(*kind);
            let truth = stage.truth(&light, &options);
            for sweep in sweeps(plan, subject) {
                let what = format!("{} · {} · {}", subject.name, kind.name(), sweep.parameter);
                progress.set_message(what.clone());
                let mut group: Vec<ScalingCurve> = sweep
                    .entries
                    .iter()
                    .map(|entry| ScalingCurve {
                        scene: subject.name.clone(),
                        light,
                        technique: entry.name.clone(),
                        parameter: sweep.parameter.to_owned(),
                        points: Vec::new(),
                    })
                    .collect();
                for value in sweep.values {
                    let mut configs: Vec<Config> =
                        sweep.entries.iter().map(|e| e.config.clone()).collect();
                    configs.iter_mut().for_each(|config| (sweep.set)(config, *value));
                    let shots = shoot_what_fits(gpu, plan, &stage, &light, &configs)
                        .with_context(|| format!("{what} {value}"))?;
                    for (curve, shot) in group.iter_mut().zip(&shots) {
                        match shot {
                            Some(shot) => curve.points.push(point(*value, shot, &truth, width)?),
                            None => progress.println(format!(
                                "{} ends before {} {value}: the device has no memory for it",
                                curve.technique, curve.parameter
                            )),
                        }
                        progress.inc(1);
                    }
                }
                curves.extend(group);
            }
        }
    }
    curves.extend(scaling_soft::measure(gpu, plan, progress)?);
    curves.extend(scaling_volumes::measure(gpu, plan, progress)?);
    Ok(curves)
}

/// Runs the techniques in turn, again and again, so that whatever else the machine does hits all alike.
pub(super) fn shoot(
    gpu: &Gpu,
    plan: &Plan,
    stage: &Stage,
    light: &Light,
    configs: &[Config],
) -> anyhow::Result<Vec<Shot>> {
    let mut session = stage.session(gpu)?;
    let mut techniques = configs.iter().map(|c| c.build(gpu)).collect::<Result<Vec<_>, _>>()?;
    let mut shots = vec![Shot::default(); techniques.len()];
    for round in 0..=plan.settings.repeat {
        for (technique, shot) in techniques.iter_mut().zip(&mut shots) {
            // The first round warms up: pipelines compile on first use.
            session.repeat(gpu, light, technique.as_mut(), shot, round > 0)?;
            if round == plan.settings.repeat {
                session.conclude(gpu, technique.as_ref(), shot)?;
            }
        }
    }
    Ok(shots)
}

/// As [`shoot`], with nothing for techniques that the device has no memory for.
fn shoot_what_fits(
    gpu: &Gpu,
    plan: &Plan,
    stage: &Stage,
    light: &Light,
    configs: &[Config],
) -> anyhow::Result<Vec<Option<Shot>>> {
    let alone = |config: &Config| match shoot(gpu, plan, stage, light, slice::from_ref(config)) {
        Ok(mut shots) => Ok(shots.pop()),
        Err(error) if lacks_memory(&error) => Ok(None),
        Err(error) => Err(error),
    };
    match shoot(gpu, plan, stage, light, configs) {
        Ok(shots) => Ok(shots.into_iter().map(Some).collect()),
        Err(error) if lacks_memory(&error) => configs.iter().map(alone).collect(),
        Err(error) => Err(error),
    }
}

fn lacks_memory(error: &anyhow::Error) -> bool {
    let of_gpu = match error.downcast_ref::<MeasureError>() {
        Some(MeasureError::Gpu(error)) => Some(error),
        _ => error.downcast_ref::<GpuError>(),
    };
    matches!(of_gpu, Some(GpuError::OutOfMemory { .. }))
}

pub(super) fn point(
    value: u32,
    shot: &Shot,
    truth: &Truth,
    width: u32,
) -> anyhow::Result<ScalingPoint> {
    let comparison = Comparison {
        estimate: &shot.visibility,
        reference: &truth.visibility,
        classes: &truth.class,
        width: width as usize,
    };
    let metrics = comparison.metrics()?;
    Ok(ScalingPoint {
        value: value.into(),
        mean_abs: Some(metrics.mean_abs),
        rmse: Some(metrics.rmse),
        gpu_ms: Spread::of(&shot.gpu_ms).map(|s| s.median),
        bytes: Some(shot.bytes),
        work: shot.counters.iter().map(|(name, count)| ((*name).to_owned(), *count)).collect(),
    })
}

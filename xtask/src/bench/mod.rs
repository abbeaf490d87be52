//! `cargo xtask bench`: techniques against ground truth.

mod group;
mod images;
mod kernels;
mod plan;
mod scaling;
mod scaling_soft;
mod scaling_volumes;
mod stability;

use std::time::Instant;

use antumbra_gpu::{Gpu, GpuOptions};
use anyhow::Context as _;
use indicatif::{ProgressBar, ProgressStyle};

use crate::args::{BenchArgs, Suite};
use crate::outcome;
use crate::results::{Adapter, Results, SCHEMA};

use plan::Plan;

/// Runs the bench as asked.
pub(crate) fn run(args: BenchArgs) -> anyhow::Result<()> {
    if args.list {
        plan::list();
        return Ok(());
    }
    let start = Instant::now();
    // Unknown names and unreadable files are found before anything is measured.
    let plan = Plan::new(&args)?;
    let gpu = Gpu::new(&GpuOptions { adapter: args.adapter.clone() })?;
    let adapter = Adapter::from(&gpu.info);
    println!("{} ({}, {})", adapter.name, adapter.backend, adapter.driver_info);
    std::fs::create_dir_all(&args.out)
        .with_context(|| format!("cannot make the directory {}", args.out.display()))?;

    let steps = match args.suite {
        Suite::Quick | Suite::Full => plan.scenes.len() * plan.lights.len() * plan.techniques.len(),
        Suite::Stability => stability::steps(&plan),
        Suite::Scaling => scaling::steps(&plan),
    };
    let progress = ProgressBar::new(steps as u64);
    progress.set_style(ProgressStyle::with_template("{bar:30} {pos}/{len} {elapsed} {msg}")?);
    let mut results = Results {
        schema: SCHEMA,
        adapter,
        settings: plan.settings.clone(),
        runs: Vec::new(),
        stability: Vec::new(),
        scaling: Vec::new(),
    };
    match args.suite {
        Suite::Quick | Suite::Full => {
            for subject in &plan.scenes {
                let runs = group::measure_scene(&gpu, &plan, subject, &args.out, &progress)?;
                results.runs.extend(runs);
            }
        }
        Suite::Stability => results.stability = stability::measure(&gpu, &plan, &progress),
        Suite::Scaling => results.scaling = scaling::measure(&gpu, &plan, &progress)?,
    }
    progress.finish_and_clear();

    println!("{steps} measurements in {:.0} s", start.elapsed().as_secs_f64());
    outcome::conclude(&results, &args.out, args.baseline.as_deref())
}

#[cfg(test)]
mod tests {
    use antumbra_scene::LightKind;

    use super::*;
    use crate::args::Size;

    #[test]
    fn rows_count_a_still_frame() {
        let args = BenchArgs {
            scene: vec!["street".into()],
            light: vec![LightKind::Directional],
            technique: vec!["sampling/matched".into()],
            size: Some(Size { width: 64, height: 64 }),
            map_size: Some(512),
            repeat: Some(1),
            ..Default::default()
        };
        let plan = Plan::new(&args).expect("a plan");
        let gpu = Gpu::new(&GpuOptions::default()).expect("a device");
        let out = tempfile::tempdir().expect("temporary directory");
        let subject = &plan.scenes[0];
        let runs = group::measure_scene(&gpu, &plan, subject, out.path(), &ProgressBar::hidden());
        let of_rows = runs.expect("measured")[0].work.clone();
        let scene = &subject.scene;
        let (camera, light) =
            (scene.camera_or_framing(), scene.light_or_placed(LightKind::Directional));
        let stage = antumbra_measure::Stage::new(&gpu, scene, camera, 64, 64).expect("a stage");
        let configs = [plan.techniques[0].config.clone()];
        let shots = scaling::shoot(&gpu, &plan, &stage, &light, &configs).expect("measured");
        let of_points =
            shots[0].counters.iter().map(|(name, n)| ((*name).to_owned(), *n)).collect();
        for work in [of_rows, of_points] {
            assert!(work["pages_requested"] > 0, "{work:?}");
            let pages = (work["pages_rendered"], work["pages_reused"]);
            assert_eq!(pages, (0, work["pages_in_use"]), "all pages are kept");
        }
    }
}

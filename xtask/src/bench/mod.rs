//! `cargo xtask bench`: techniques against ground truth.

mod group;
mod images;
mod kernels;
mod plan;
mod scaling;
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

//! `cargo xtask bench`: techniques against ground truth.

mod group;
mod images;
mod plan;

use std::time::Instant;

use antumbra_gpu::{Gpu, GpuOptions};
use anyhow::Context as _;
use indicatif::{ProgressBar, ProgressStyle};

use crate::args::BenchArgs;
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

    let steps = plan.scenes.len() * plan.lights.len() * plan.techniques.len();
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
    for subject in &plan.scenes {
        results.runs.extend(group::measure_scene(&gpu, &plan, subject, &args.out, &progress)?);
    }
    progress.finish_and_clear();

    println!("{} runs in {:.0} s", results.runs.len(), start.elapsed().as_secs_f64());
    outcome::conclude(&results, &args.out, args.baseline.as_deref())
}

//! The stability suite: every hard case against what the table of verdicts says of each technique.

use antumbra_gpu::{Expectation, Gpu};
use antumbra_measure::MeasureError;
use antumbra_measure::stability::{CASES, Case};
use indicatif::ProgressBar;

use super::plan::{Entry, Plan};
use crate::results::{Expected, StabilityCase};

/// Steps of the progress bar.
pub(super) fn steps(plan: &Plan) -> usize {
    CASES.len() * plan.techniques.len()
}

/// Runs all techniques of the plan on all hard cases.
pub(super) fn measure(gpu: &Gpu, plan: &Plan, progress: &ProgressBar) -> Vec<StabilityCase> {
    let mut cases = Vec::new();
    for case in CASES {
        progress.set_message(case.name);
        for entry in &plan.techniques {
            cases.push(judge(gpu, case, entry, plan.settings.map_size));
            progress.inc(1);
        }
    }
    cases
}

fn judge(gpu: &Gpu, case: &Case, entry: &Entry, map_size: u32) -> StabilityCase {
    let (expected, at_least, bound, reason) = match entry.config.expectation(case.name) {
        Some(Expectation::Holds { bound }) => (Expected::Holds, None, Some(bound), ""),
        Some(Expectation::KnownLimit { at_least, at_most, because }) => {
            (Expected::KnownLimit, Some(at_least), Some(at_most), because)
        }
        Some(Expectation::Refuses { because }) => (Expected::Refuses, None, None, because),
        None => (Expected::Unsaid, None, None, "nobody has said yet what to expect"),
    };
    let mut judged = StabilityCase {
        case: case.name.to_owned(),
        about: case.about.to_owned(),
        number: case.number.to_owned(),
        technique: entry.name.clone(),
        expected,
        reason: reason.to_owned(),
        at_least,
        bound,
        measured: None,
        pass: Some(false),
    };
    let measured = entry.config.build(gpu).map_err(MeasureError::from);
    match measured.and_then(|mut technique| case.measure(gpu, technique.as_mut(), map_size)) {
        Ok(number) => {
            judged.measured = number.is_finite().then_some(number);
            let expectation = entry.config.expectation(case.name);
            judged.pass = expectation.map(|e| e.is_met_by(number));
        }
        Err(_) if expected == Expected::Refuses => judged.pass = Some(true),
        Err(error) => judged.reason = error.to_string(),
    }
    judged
}

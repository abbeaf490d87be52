//! Comparison with an earlier `results.json`: what got worse beyond noise.
//!
//! Visibility is bit-identical from run to run on one adapter, so there any error that grows by
//! more than rounding is a regression; another adapter rasterises differently and gets a wider
//! allowance. Times are compared as ratios to the plain map of the same run, and only flagged when
//! the spreads of the two measurements are apart.

use std::fmt;
use std::path::Path;

use anyhow::{Context as _, bail};

use crate::columns::{self, Unit};
use crate::results::{Results, Run, Status, describe_light};

/// The metrics that may not grow.
const ERRORS: [&str; 11] = [
    "mean_abs",
    "rmse",
    "leak",
    "over_shadow",
    "p95",
    "p99",
    "max",
    "bad_fraction",
    "penumbra_rmse",
    "acne_rate",
    "flip",
];

/// How much an error may grow before it counts as a regression: `relative * old + absolute`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Allowance {
    relative: f64,
    absolute: f64,
}

impl Allowance {
    /// Deterministic: no more than the rounding of sums over samples in another order.
    const SAME_ADAPTER: Self = Self { relative: 0.0, absolute: 1e-6 };
    /// Another rasteriser places edges and rounds depth differently.
    const OTHER_ADAPTER: Self = Self { relative: 0.1, absolute: 1e-6 };

    fn exceeded(self, old: f64, new: f64) -> bool {
        new > old + self.relative * old.abs() + self.absolute
    }
}

/// The outcome of a comparison.
#[derive(Clone, Debug)]
pub(crate) struct Comparison {
    /// What got worse, in the order of the earlier runs.
    pub(crate) regressions: Vec<Regression>,
    /// Runs found on both sides.
    pub(crate) compared: usize,
    /// Runs that the earlier results do not have.
    pub(crate) added: usize,
    /// Earlier and present adapter, where they differ.
    pub(crate) adapters: Option<(String, String)>,
    /// What errors were allowed to grow by.
    pub(crate) allowance: Allowance,
}

/// One thing that got worse.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Regression {
    /// `scene, light, technique`.
    pub(crate) run: String,
    /// What about it.
    pub(crate) change: Change,
}

/// How a run got worse.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Change {
    /// The earlier results have it, the present ones do not.
    Missing,
    /// It was measured and now fails or is skipped.
    Status(Status),
    /// A number that was measured is not any more.
    NotMeasured(&'static str),
    /// An error grew by more than the allowance.
    Error { metric: &'static str, old: f64, new: f64 },
    /// The GPU time over that of the plain map grew beyond both spreads.
    Time { old: f64, new: f64 },
    /// It holds more memory.
    Bytes { old: u64, new: u64 },
}

/// Compares `new` with the results in the file `baseline`. A file that cannot be read, holds no run
/// or was made with other settings is an error: it would compare nothing.
pub(crate) fn compare_with_file(baseline: &Path, new: &Results) -> anyhow::Result<Comparison> {
    let old = Results::read(baseline).context("cannot use the baseline")?;
    compare(&old, new).with_context(|| format!("cannot use the baseline {}", baseline.display()))
}

/// Compares two results.
pub(crate) fn compare(old: &Results, new: &Results) -> anyhow::Result<Comparison> {
    if old.runs.is_empty() {
        bail!("it holds no run");
    }
    let shape = |r: &Results| (r.settings.size, r.settings.map_size, r.settings.light_samples);
    if shape(old) != shape(new) {
        bail!(
            "it was made with size, map size and light samples {:?}, these results with {:?}",
            shape(old),
            shape(new)
        );
    }
    let same_adapter = old.adapter == new.adapter;
    let allowance = if same_adapter { Allowance::SAME_ADAPTER } else { Allowance::OTHER_ADAPTER };
    let mut regressions = Vec::new();
    let mut compared = 0;
    for before in &old.runs {
        let changes = match new.runs.iter().find(|r| same_run(r, before)) {
            Some(after) => {
                compared += 1;
                changes(before, after, allowance, same_adapter)
            }
            None => vec![Change::Missing],
        };
        let light = describe_light(&before.light);
        let run = format!("{}, {light}, {}", before.scene, before.technique);
        regressions.extend(changes.into_iter().map(|c| Regression { run: run.clone(), change: c }));
    }
    let added =
        new.runs.iter().filter(|r| !old.runs.iter().any(|before| same_run(r, before))).count();
    let adapters = (!same_adapter).then(|| (old.adapter.name.clone(), new.adapter.name.clone()));
    Ok(Comparison { regressions, compared, added, adapters, allowance })
}

fn same_run(a: &Run, b: &Run) -> bool {
    a.technique == b.technique && a.scene == b.scene && a.light == b.light && a.config == b.config
}

fn changes(old: &Run, new: &Run, allowance: Allowance, same_adapter: bool) -> Vec<Change> {
    if old.status != Status::Ok {
        return Vec::new();
    }
    if new.status != Status::Ok {
        return vec![Change::Status(new.status.clone())];
    }
    let mut changes = Vec::new();
    for column in ERRORS.iter().filter_map(|id| columns::metric(id)) {
        match (column.value(old), column.value(new)) {
            (Some(old), Some(new)) if allowance.exceeded(old, new) => {
                changes.push(Change::Error { metric: column.id, old, new });
            }
            (Some(_), None) => changes.push(Change::NotMeasured(column.id)),
            _ => {}
        }
    }
    match (ratio(old), ratio(new)) {
        (Some([_, old_median, old_max]), Some([new_min, new_median, _])) if new_min > old_max => {
            changes.push(Change::Time { old: old_median, new: new_median });
        }
        (Some(_), None) => changes.push(Change::NotMeasured("ratio_to_plain")),
        _ => {}
    }
    // Another driver aligns and pads differently.
    if let (Some(old), Some(new), true) = (old.bytes, new.bytes, same_adapter)
        && new > old
    {
        changes.push(Change::Bytes { old, new });
    }
    changes
}

/// The ratio to the plain map's time at the shortest, median and longest repetition.
fn ratio(run: &Run) -> Option<[f64; 3]> {
    let time = run.time.as_ref()?;
    let ratio = time.ratio_to_plain?;
    let spread = time.gpu_ms.filter(|s| s.median > 0.0)?;
    Some([ratio * spread.min / spread.median, ratio, ratio * spread.max / spread.median])
}

impl fmt::Display for Change {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Missing => f.write_str("is missing"),
            Self::Status(status) => write!(f, "was ok, now {status}"),
            Self::NotMeasured(metric) => write!(f, "{metric} is not measured any more"),
            Self::Error { metric, old, new } => {
                write!(f, "{metric} grew from {old:.3e} to {new:.3e}")
            }
            Self::Time { old, new } => {
                write!(f, "GPU time over map/plain grew from {old:.2} to {new:.2}")
            }
            Self::Bytes { old, new } => {
                let show = |bytes: u64| Unit::Bytes.show(bytes as f64);
                write!(f, "memory grew from {} to {}", show(*old), show(*new))
            }
        }
    }
}

impl fmt::Display for Comparison {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some((old, new)) = &self.adapters {
            writeln!(f, "The baseline was made on another adapter ({old}, now {new}).")?;
        }
        let Allowance { relative, absolute } = self.allowance;
        writeln!(
            f,
            "Compared {} runs with the baseline ({} are new); errors may grow by {} % + {absolute:.0e}.",
            self.compared,
            self.added,
            100.0 * relative,
        )?;
        for regression in &self.regressions {
            writeln!(f, "  REGRESSION {}: {}", regression.run, regression.change)?;
        }
        match self.regressions.len() {
            0 => write!(f, "No regression."),
            1 => write!(f, "1 regression."),
            n => write!(f, "{n} regressions."),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::results::{Spread, Time};
    use crate::sample;
    use antumbra_reference::Metrics;

    /// The change found when one run of the sample results is worsened by `worsen`.
    fn changes_after(worsen: impl FnOnce(&mut Run)) -> Vec<Change> {
        let old = sample::results();
        let mut new = old.clone();
        worsen(&mut new.runs[1]);
        let comparison = compare(&old, &new).expect("comparable");
        comparison.regressions.into_iter().map(|r| r.change).collect()
    }

    fn error(run: &mut Run) -> &mut Metrics {
        run.error.as_mut().expect("the sample run has an error")
    }

    fn time(run: &mut Run) -> &mut Time {
        run.time.as_mut().expect("the sample run has a time")
    }

    /// Sets one metric of a run through its JSON, by name.
    fn set_metric(run: &mut Run, metric: &str, value: Option<f64>) {
        let mut json = serde_json::to_value(error(run)).expect("serialises");
        json[metric] = value.into();
        *error(run) = serde_json::from_value(json).expect("deserialises");
    }

    #[test]
    fn identical_results_have_no_regression() {
        assert_eq!(changes_after(|_| {}), [], "nothing changed");
    }

    #[test]
    fn survives_a_round_trip_through_the_file() {
        let dir = tempfile::tempdir().expect("temporary directory");
        let results = sample::results();
        results.write(dir.path()).expect("written");
        let comparison =
            compare_with_file(&dir.path().join("results.json"), &results).expect("comparable");
        assert_eq!(comparison.regressions, [], "every float comes back from the file unchanged");
        assert_eq!(comparison.compared, results.runs.len(), "every run is found again");
    }

    #[test]
    fn each_error_that_grows_is_flagged_alone() {
        for metric in ERRORS {
            let column = columns::metric(metric).expect("a column of that name");
            let old = column.value(&sample::results().runs[1]).expect("the sample measures it");
            let found = changes_after(|run| set_metric(run, metric, Some(old + 2e-6)));
            assert_eq!(found, [Change::Error { metric, old, new: old + 2e-6 }], "{metric} grew");
            let found = changes_after(|run| set_metric(run, metric, Some(old + 5e-7)));
            assert_eq!(found, [], "{metric} within rounding");
            let found = changes_after(|run| set_metric(run, metric, Some(0.5 * old)));
            assert_eq!(found, [], "{metric} got better");
        }
        // The others are there whenever any error is.
        for metric in ["penumbra_rmse", "acne_rate", "flip"] {
            let found = changes_after(|run| set_metric(run, metric, None));
            assert_eq!(found, [Change::NotMeasured(metric)], "{metric} vanished");
        }
    }

    #[test]
    fn time_is_flagged_only_beyond_both_spreads() {
        // The sample's ratio is 1.5 with a spread of [0.9, 1.2] times its median.
        let slower = |factor: f64| {
            changes_after(|run| {
                let time = time(run);
                time.ratio_to_plain = time.ratio_to_plain.map(|r| r * factor);
                time.gpu_ms = time.gpu_ms.map(|s| Spread {
                    median: s.median * factor,
                    min: s.min * factor,
                    max: s.max * factor,
                });
            })
        };
        assert_eq!(slower(1.3), [], "the spreads overlap");
        assert_eq!(slower(1.4), [Change::Time { old: 1.5, new: 1.5 * 1.4 }], "1.4 * 0.9 > 1.2");
        assert_eq!(slower(0.5), [], "faster");
        let lost = changes_after(|run| time(run).ratio_to_plain = None);
        assert_eq!(lost, [Change::NotMeasured("ratio_to_plain")], "not timed any more");
    }

    #[test]
    fn missing_failed_and_bigger_runs_are_flagged() {
        let old = sample::results();
        let mut new = old.clone();
        new.runs.remove(1);
        let comparison = compare(&old, &new).expect("comparable");
        assert_eq!(comparison.regressions.len(), 1, "one run is gone");
        assert_eq!(comparison.regressions[0].change, Change::Missing, "and said to be missing");

        let status = Status::Failed("device lost".to_owned());
        let found = changes_after(|run| run.status = status.clone());
        assert_eq!(found, [Change::Status(status)], "a failed run is one regression, not many");

        let bytes = old.runs[1].bytes.expect("the sample has bytes");
        let found = changes_after(|run| run.bytes = Some(bytes + 1));
        assert_eq!(found, [Change::Bytes { old: bytes, new: bytes + 1 }], "memory grew");

        let found = changes_after(|run| run.config = serde_json::json!({ "other": true }));
        assert_eq!(found, [Change::Missing], "another config is another run");
    }

    #[test]
    fn another_adapter_gets_ten_per_cent_and_is_named() {
        let old = sample::results();
        let grown = |factor: f64| {
            let mut new = old.clone();
            new.adapter.name = "Other GPU".to_owned();
            let e = error(&mut new.runs[1]);
            e.rmse *= factor;
            compare(&old, &new).expect("comparable")
        };
        assert_eq!(grown(1.09).regressions, [], "within ten per cent");
        assert_eq!(grown(1.11).regressions.len(), 1, "beyond ten per cent");
        assert!(grown(1.0).to_string().contains("Other GPU"), "says that the adapter differs");
    }

    #[test]
    fn a_baseline_that_compares_nothing_is_an_error() {
        let dir = tempfile::tempdir().expect("temporary directory");
        let new = sample::results();
        let fails = |path: &Path, what: &str| {
            let error = compare_with_file(path, &new).expect_err(what);
            let message = format!("{error:#}");
            assert!(message.contains("baseline"), "{what}: {message}");
            message
        };
        let path = dir.path().join("results.json");
        assert!(fails(&path, "missing").contains("results.json"), "names the missing file");
        std::fs::write(&path, "{\"schema\": 1, \"runs\": [").expect("written");
        fails(&path, "corrupt");
        std::fs::write(&path, "{\"schema\": 99}").expect("written");
        assert!(fails(&path, "another schema").contains("99"), "says which schema it found");

        let empty = Results { runs: Vec::new(), ..sample::results() };
        empty.write(dir.path()).expect("written");
        fails(&path, "no runs");
        let mut other_size = sample::results();
        other_size.settings.size = [8, 8];
        other_size.write(dir.path()).expect("written");
        fails(&path, "other settings");
    }
}

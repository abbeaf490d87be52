//! What a finished bench leaves behind: files, the terminal's table, and the verdict of the
//! comparison with a baseline.

use std::path::Path;

use anyhow::bail;

use crate::results::{Results, Status};
use crate::{baseline, report, table};

/// Writes `results.json`, `results.csv` and `index.html` into `out`, which must exist and hold the
/// raw images, prints the table, and compares with `baseline` if there is one. A failed run, a hard
/// case that is not as expected or a regression is an error, after everything is written.
pub(crate) fn conclude(
    results: &Results,
    out: &Path,
    baseline: Option<&Path>,
) -> anyhow::Result<()> {
    // Read before `out` is written: the baseline may lie there.
    let comparison = baseline.map(|b| baseline::compare_with_file(b, results)).transpose();
    results.write(out)?;
    report::write(out, results)?;
    print!("{}", table::render(results));
    println!("Wrote {}", out.join("index.html").display());

    let comparison = comparison?;
    if let Some(comparison) = &comparison {
        println!("{comparison}");
    }
    let regressions = comparison.map_or(0, |c| c.regressions.len());
    let failed = results.runs.iter().filter(|r| matches!(r.status, Status::Failed(_))).count();
    let surprising = results.stability.iter().filter(|c| c.is_surprise()).count();
    let verdict: Vec<String> = [
        (failed, "failed runs"),
        (surprising, "hard cases not as expected"),
        (regressions, "regressions against the baseline"),
    ]
    .into_iter()
    .filter(|(n, _)| *n > 0)
    .map(|(n, what)| format!("{what}: {n}"))
    .collect();
    if !verdict.is_empty() {
        bail!(verdict.join(", "));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample;

    /// The sample results without its failures.
    fn good() -> Results {
        let mut results = sample::results();
        results.runs.retain(|r| !matches!(r.status, Status::Failed(_)));
        results.stability.retain(|c| !c.is_surprise());
        results
    }

    #[test]
    fn writes_everything_and_passes_against_itself() {
        let dir = tempfile::tempdir().expect("temporary directory");
        conclude(&good(), dir.path(), None).expect("nothing wrong");
        for name in ["results.json", "results.csv", "index.html"] {
            assert!(dir.path().join(name).is_file(), "{name} is there");
        }
        let json = dir.path().join("results.json");
        conclude(&good(), dir.path(), Some(&json)).expect("no regression against itself");
    }

    #[test]
    fn a_baseline_in_the_output_directory_is_read_before_it_is_overwritten() {
        let dir = tempfile::tempdir().expect("temporary directory");
        conclude(&good(), dir.path(), None).expect("nothing wrong");
        let mut worse = good();
        let error = worse.runs[0].error.as_mut().expect("the sample has an error");
        error.rmse *= 2.0;
        let json = dir.path().join("results.json");
        let error = conclude(&worse, dir.path(), Some(&json)).expect_err("the RMSE doubled");
        assert_eq!(error.to_string(), "regressions against the baseline: 1", "one, and no more");
    }

    #[test]
    fn failures_fail_after_everything_is_written() {
        let dir = tempfile::tempdir().expect("temporary directory");
        let error = conclude(&sample::results(), dir.path(), None).expect_err("the sample fails");
        assert_eq!(
            error.to_string(),
            "failed runs: 1, hard cases not as expected: 1",
            "says what went wrong"
        );
        assert!(dir.path().join("index.html").is_file(), "the page is there to look at");
        let missing = dir.path().join("missing.json");
        let error = conclude(&good(), dir.path(), Some(&missing)).expect_err("no baseline");
        assert!(format!("{error:#}").contains("missing.json"), "{error:#}");
    }

    #[test]
    fn csv_has_a_row_per_run_and_empty_cells_for_what_was_not_measured() {
        let dir = tempfile::tempdir().expect("temporary directory");
        let results = sample::results();
        results.write(dir.path()).expect("written");
        let mut csv = csv::Reader::from_path(dir.path().join("results.csv")).expect("readable");
        let header = csv.headers().expect("a header").clone();
        let column = |name: &str| {
            header.iter().position(|h| h == name).unwrap_or_else(|| panic!("no column {name}"))
        };
        let (rmse, fetches, config) =
            (column("rmse"), column("work.fetches"), column("config_json"));
        let rows: Vec<_> = csv.records().map(|r| r.expect("a row of the same length")).collect();
        assert_eq!(rows.len(), results.runs.len(), "a row per run");
        for (row, run) in rows.iter().zip(&results.runs) {
            let expected = run.error.as_ref().map(|e| e.rmse.to_string()).unwrap_or_default();
            assert_eq!(row[rmse], expected, "RMSE of {}", run.technique);
            let expected = run.work.get("fetches").map(u64::to_string).unwrap_or_default();
            assert_eq!(row[fetches], expected, "fetches of {}", run.technique);
            assert_eq!(row[config], run.config.to_string(), "config of {}", run.technique);
        }
    }
}

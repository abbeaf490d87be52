//! `index.html`: one page without any outside reference, made from `results.json` and the raw images
//! that it names.

mod page;
mod pictures;
mod plot;

use std::path::Path;

use anyhow::Context as _;

pub(crate) use plot::number;

use crate::results::{Results, Run};

/// Runs of one scene side by side, from the raw images in `dir`: shaded, and the signed error below.
pub(crate) fn sheet(dir: &Path, runs: &[&Run]) -> anyhow::Result<image::RgbImage> {
    pictures::sheet(dir, runs)
}

/// `cargo xtask report DIR`: writes the page again from the results in `dir`.
pub(crate) fn run(dir: &Path) -> anyhow::Result<()> {
    let results = Results::read(&dir.join("results.json"))?;
    write(dir, &results)?;
    println!("Wrote {}", dir.join("index.html").display());
    Ok(())
}

/// Writes `index.html` into `dir`, where the raw images of `results` lie already. An image that
/// `results` names and that is not there is an error.
pub(crate) fn write(dir: &Path, results: &Results) -> anyhow::Result<()> {
    let html = page::render(results, dir)?;
    let path = dir.join("index.html");
    std::fs::write(&path, html).with_context(|| format!("cannot write {}", path.display()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample;

    #[test]
    fn page_is_self_contained_and_escapes_names() {
        let dir = tempfile::tempdir().expect("temporary directory");
        let mut results = sample::with_pictures(dir.path()).expect("pictures written");
        for run in &mut results.runs {
            run.scene = run.scene.replace("street", "<script>alert(\"&\")</script>");
        }
        write(dir.path(), &results).expect("page written");
        let html = std::fs::read_to_string(dir.path().join("index.html")).expect("page read");
        assert!(!html.contains("<script>alert"), "a scene's name is text, not markup");
        assert!(html.contains("&lt;script&gt;alert"), "and is shown as it is");
        let outside = html.replace("http://www.w3.org/2000/svg", "");
        assert!(!outside.contains("http://"), "no request leaves the page");
        assert!(!outside.contains("https://"), "no request leaves the page");
        assert!(!outside.contains("@import"), "no style sheet from elsewhere");
        assert!(html.contains("data:image/png;base64,"), "pictures are inside");
        for heading in ["Stability", "Scaling", "Speed against error"] {
            assert!(html.contains(heading), "section {heading}");
        }
    }

    #[test]
    fn sections_without_data_are_left_out_and_the_page_is_deterministic() {
        let dir = tempfile::tempdir().expect("temporary directory");
        let mut results = sample::results();
        results.stability.clear();
        results.scaling.clear();
        let html = page::render(&results, dir.path()).expect("rendered");
        assert!(!html.contains("Stability"), "no empty matrix");
        assert!(!html.contains("Scaling"), "no empty curves");
        assert_eq!(html, page::render(&results, dir.path()).expect("rendered"), "same twice");
    }

    #[test]
    fn a_missing_picture_is_an_error_that_names_it() {
        let dir = tempfile::tempdir().expect("temporary directory");
        let results = sample::with_pictures(dir.path()).expect("pictures written");
        let name = results.runs[0].files.reference.clone().expect("the sample has a reference");
        std::fs::remove_file(dir.path().join(&name)).expect("removed");
        let error = write(dir.path(), &results).expect_err("the truth is missing");
        assert!(format!("{error:#}").contains(&name), "{error:#}");
    }

    #[test]
    fn report_reads_what_the_bench_wrote() {
        let dir = tempfile::tempdir().expect("temporary directory");
        let results = sample::with_pictures(dir.path()).expect("pictures written");
        results.write(dir.path()).expect("written");
        run(dir.path()).expect("page written");
        assert!(dir.path().join("index.html").is_file(), "the page is there");
        assert!(run(&dir.path().join("nowhere")).is_err(), "no results, no page");
    }

    /// `cargo test -p xtask -- --ignored` leaves a page of made-up numbers in `target/sample-report`.
    #[test]
    #[ignore = "writes a page for people to look at"]
    fn sample_page() {
        let dir = Path::new(env!("CARGO_MANIFEST_DIR")).join("../target/sample-report");
        std::fs::create_dir_all(&dir).expect("directory");
        let results = sample::with_pictures(&dir).expect("pictures written");
        results.write(&dir).expect("written");
        run(&dir).expect("page written");
    }
}

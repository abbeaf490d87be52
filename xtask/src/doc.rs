//! `cargo xtask doc`: what is measured on the pages of the documentation.
//!
//! A page holds pairs of marks, between which a table of committed results stands, or a picture:
//!
//! ```text
//! <!-- measured file=results/quick.json scene=tree,street light=directional technique=map/plain -->
//! <!-- /measured -->
//!
//! <!-- scaled file=results/soft-scaling.json parameter=light_side_percent light=rect -->
//! <!-- /scaled -->
//!
//! <!-- pictured scene=tree light=directional technique=map/plain,filter/vsm size=192x192 map=1024 -->
//! <!-- /pictured -->
//! ```
//!
//! `file` is relative to `docs`. `scene`, `light` and `technique` are lists; a table without one shows all. With a list
//! `across` of columns and work counters, by their names in the CSV file, each scene and technique is one row, all lights
//! side by side. A page has one picture, under the page's name in `docs/images`.

mod mark;
mod picture;
mod scaled;

use std::path::{Path, PathBuf};

use antumbra_scene::{LightKind, generate};
use anyhow::{Context as _, bail, ensure};
use clap::ValueEnum as _;

use crate::args::{BenchArgs, Size, Suite};
use crate::bench;
use crate::columns;
use crate::results::{Results, Run, Status, describe_light};

use mark::Mark;

/// The columns of a page's table.
const COLUMNS: [&str; 8] = [
    "mean_abs",
    "rmse",
    "leak",
    "over_shadow",
    "bad_fraction",
    "acne_rate",
    "ratio_to_plain",
    "bytes",
];

/// Writes the tables anew; with `check`, fails where one differs instead.
pub(crate) fn run(check: bool) -> anyhow::Result<()> {
    let docs = docs();
    let mut tables = 0;
    for page in pages(&docs)? {
        let text = read(&page)?;
        let (fresh, count) =
            filled(&text, &page, &docs).with_context(|| format!("in {}", page.display()))?;
        tables += count;
        if fresh != text {
            ensure!(!check, "{} is out of date; run `cargo xtask doc`", page.display());
            std::fs::write(&page, fresh)
                .with_context(|| format!("cannot write {}", page.display()))?;
        }
    }
    println!("{tables} tables and pictures in the documentation are up to date");
    Ok(())
}

/// Draws the pictures of the pages whose name contains one of `names`, or of all.
pub(crate) fn draw(names: &[String]) -> anyhow::Result<()> {
    let docs = docs();
    for page in pages(&docs)? {
        let stem = page.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        if names.is_empty() || names.iter().any(|name| stem.contains(name)) {
            mark::replaced(&read(&page)?, |mark| {
                if mark.kind == "pictured" {
                    picture::draw(mark, &picture::path(&docs, &page))?;
                }
                Ok(String::new())
            })
            .with_context(|| format!("in {}", page.display()))?;
        }
    }
    Ok(())
}

fn docs() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs")
}

fn pages(docs: &Path) -> anyhow::Result<Vec<PathBuf>> {
    let mut pages = vec![docs.join("../README.md")];
    collect(docs, &mut pages)?;
    Ok(pages)
}

fn read(page: &Path) -> anyhow::Result<String> {
    std::fs::read_to_string(page).with_context(|| format!("cannot read {}", page.display()))
}

/// Runs the bench behind committed results again and puts the new ones in their place, without the raw images. Scenes
/// from files that are not here keep what was measured.
pub(crate) fn measure(file: &Path) -> anyhow::Result<()> {
    let old = Results::read(file)?;
    let settings = &old.settings;
    let [width, height] = settings.size;
    let Ok(suite) = Suite::from_str(&settings.suite, false) else {
        bail!("{} is of the unknown suite `{}`", file.display(), settings.suite)
    };
    let is_here = |scene: &str| generate::by_name(scene).is_some() || Path::new(scene).exists();
    let (here, away): (Vec<Run>, Vec<Run>) =
        old.runs.iter().cloned().partition(|run| is_here(&run.scene));
    ensure!(!here.is_empty(), "none of the scenes of {} is here", file.display());
    let out = std::env::temp_dir().join(format!("antumbra-measure-{}", std::process::id()));
    bench::run(BenchArgs {
        scene: in_order(here.iter().map(|run| run.scene.clone())),
        ground: settings.ground,
        light: in_order(here.iter().map(|run| run.light.kind())),
        technique: in_order(here.iter().map(|run| run.technique.clone())),
        size: Some(Size { width, height }),
        map_size: Some(settings.map_size),
        light_samples: Some(settings.light_samples),
        repeat: Some(settings.repeat),
        suite,
        out: out.clone(),
        ..Default::default()
    })?;
    let mut new = Results::read(&out.join("results.json"))?;
    // What is left behind in a temporary directory does no harm.
    let _ = std::fs::remove_dir_all(&out);
    for run in &mut new.runs {
        run.files = Default::default();
    }
    new.runs.extend(away);
    let text = serde_json::to_string_pretty(&new).context("cannot serialise the results")?;
    std::fs::write(file, text + "\n").with_context(|| format!("cannot write {}", file.display()))
}

/// Each item once, in order of first appearance.
fn in_order<T: PartialEq>(items: impl Iterator<Item = T>) -> Vec<T> {
    items.fold(Vec::new(), |mut list, item| {
        if !list.contains(&item) {
            list.push(item);
        }
        list
    })
}

fn collect(folder: &Path, pages: &mut Vec<PathBuf>) -> anyhow::Result<()> {
    let entries =
        std::fs::read_dir(folder).with_context(|| format!("cannot read {}", folder.display()))?;
    let mut paths = entries.map(|e| Ok(e?.path())).collect::<std::io::Result<Vec<_>>>()?;
    paths.sort();
    for path in paths {
        if path.is_dir() {
            collect(&path, pages)?;
        } else if path.extension().is_some_and(|e| e == "md") {
            pages.push(path);
        }
    }
    Ok(())
}

/// The page with what its marks ask for, and their number.
fn filled(text: &str, page: &Path, docs: &Path) -> anyhow::Result<(String, usize)> {
    mark::replaced(text, |mark| match mark.kind {
        "measured" => table(mark, docs),
        "scaled" => scaled::table(mark, docs),
        "pictured" => picture::caption(mark, &picture::path(docs, page)),
        other => bail!("`{other}` is no kind of mark; there are measured, scaled and pictured"),
    })
}

fn table(mark: &Mark<'_>, docs: &Path) -> anyhow::Result<String> {
    mark.knows(&["file", "scene", "light", "technique", "across"])?;
    let file = mark.get("file").map(|file| docs.join(file));
    let [scenes, lights, techniques] = ["scene", "light", "technique"].map(|key| mark.list(key));
    let Some(file) = file else { bail!("names no file") };
    let results = Results::read(&file)?;
    let among =
        |list: &Option<Vec<&str>>, name: &str| list.as_ref().is_none_or(|l| l.contains(&name));
    let wanted = |run: &&Run| {
        among(&scenes, &run.scene)
            && among(&lights, run.light.kind().name())
            && among(&techniques, &run.technique)
    };
    let runs: Vec<&Run> = results.runs.iter().filter(wanted).collect();
    ensure!(!runs.is_empty(), "selects no run of {}", file.display());

    for run in &runs {
        ensure!(run.status == Status::Ok, "{} on {}: {}", run.technique, run.scene, run.status);
    }
    let mut text = match mark.list("across") {
        None => one_by_one(&runs),
        Some(ids) => side_by_side(&runs, &ids)?,
    };
    let [width, height] = results.settings.size;
    text += &format!(
        "\n{}, {}; view {width} x {height}, map {}².\n\n",
        results.adapter.name, results.adapter.driver_info, results.settings.map_size
    );
    Ok(text)
}

/// A row for each run.
fn one_by_one(runs: &[&Run]) -> String {
    let shown: Vec<_> = COLUMNS.iter().filter_map(|id| columns::metric(id)).collect();
    let titles: Vec<_> = shown.iter().map(|c| c.title).collect();
    let mut text = format!("\n| scene | light | technique | {} |\n", titles.join(" | "));
    text += &format!("|---|---|---|{}\n", "--:|".repeat(shown.len()));
    for run in runs {
        let cells: Vec<String> = shown.iter().map(|c| cell(c, run)).collect();
        let light = describe_light(&run.light);
        text +=
            &format!("| {} | {light} | `{}` | {} |\n", run.scene, run.technique, cells.join(" | "));
    }
    text
}

/// A row for each scene and technique, with the columns and counters `ids` under each light.
fn side_by_side(runs: &[&Run], ids: &[&str]) -> anyhow::Result<String> {
    for id in ids {
        let known = columns::metric(id).is_some() || runs.iter().any(|r| r.work.contains_key(*id));
        ensure!(known, "no column or counter `{id}`");
    }
    let title =
        |id: &str| columns::metric(id).map_or_else(|| id.replace('_', " "), |c| c.title.to_owned());
    let show = |id: &str, run: &Run| match columns::metric(id) {
        Some(column) => cell(column, run),
        None => run.work.get(id).map_or_else(|| "–".to_owned(), u64::to_string),
    };
    let lights = in_order(runs.iter().map(|run| run.light.kind()));
    let rows = in_order(runs.iter().map(|run| (&run.scene, &run.technique)));
    let titles = lights.iter().flat_map(|kind| ids.iter().map(move |id| (kind, id)));
    let titles: Vec<_> =
        titles.map(|(kind, id)| format!("{}, {}", kind.name(), title(id))).collect();
    let mut text = format!("\n| scene | technique | {} |\n", titles.join(" | "));
    text += &format!("|---|---|{}\n", "--:|".repeat(titles.len()));
    for row in rows {
        let under = |kind: &LightKind| {
            let is_it =
                |run: &&&Run| (&run.scene, &run.technique) == row && run.light.kind() == *kind;
            let run = runs.iter().find(is_it);
            let cell = |id: &&str| run.map_or_else(|| "–".to_owned(), |run| show(id, run));
            ids.iter().map(cell).collect::<Vec<_>>()
        };
        let cells: Vec<String> = lights.iter().flat_map(under).collect();
        text += &format!("| {} | `{}` | {} |\n", row.0, row.1, cells.join(" | "));
    }
    Ok(text)
}

fn cell(column: &columns::Column, run: &Run) -> String {
    column.value(run).map_or_else(|| "–".to_owned(), |v| column.unit.show(v))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample;

    fn page(dir: &Path, mark: &str) -> anyhow::Result<(String, usize)> {
        let mut results = sample::results();
        results.runs.retain(|r| r.status == Status::Ok);
        results.write(dir)?;
        let text = format!("before\n{mark}\nold\n<!-- /measured -->\nafter\n");
        filled(&text, Path::new("page.md"), dir)
    }

    #[test]
    fn tables_are_filled_and_filling_again_changes_nothing() {
        let dir = tempfile::tempdir().expect("temporary directory");
        let mark = "<!-- measured file=results.json -->";
        let (text, count) = page(dir.path(), mark).expect("filled");
        assert_eq!(count, 1, "one table");
        assert!(!text.contains("\nold\n"), "the old table is gone");
        assert!(text.starts_with("before\n") && text.ends_with("after\n"), "the rest stays");
        let again = filled(&text, Path::new("page.md"), dir.path()).expect("filled").0;
        assert_eq!(again, text, "idempotent");
    }

    #[test]
    fn lights_stand_side_by_side_where_columns_are_named() {
        let dir = tempfile::tempdir().expect("temporary directory");
        let mark = "<!-- measured file=results.json technique=map/plain across=rmse,leak -->";
        let (text, _) = page(dir.path(), mark).expect("filled");
        let title = "| scene | technique | spot, RMSE | spot, leak | directional, RMSE | directional, leak |";
        assert!(text.contains(title), "{text}");
        assert!(text.contains("| half-plane | `map/plain` |"), "{text}");
        assert!(text.contains("| – | – |"), "what was not measured is a dash: {text}");
    }

    #[test]
    fn curves_are_tables_of_time_and_error() {
        let dir = tempfile::tempdir().expect("temporary directory");
        let mark = "<!-- scaled file=results.json parameter=map_size technique=map/plain -->";
        let (text, _) = page(
            dir.path(),
            &format!("{mark}\n<!-- /scaled -->\n<!-- measured file=results.json -->"),
        )
        .expect("filled");
        assert!(text.contains("| map size | 256 | 512 | 1024 | 2048 | 4096 |"), "{text}");
        assert!(text.contains("| `map/plain` | 1.00, 0.1083 | "), "{text}");
        assert!(!text.contains("`filter/pcf-grid` | 1.00"), "one technique: {text}");
    }

    #[test]
    fn marks_that_select_nothing_or_say_nonsense_are_errors() {
        let dir = tempfile::tempdir().expect("temporary directory");
        for mark in [
            "<!-- measured file=results.json scene=nowhere -->",
            "<!-- measured file=missing.json -->",
            "<!-- measured scene=street -->",
            "<!-- measured file=results.json colour=red -->",
            "<!-- measured file=results.json across=colour -->",
        ] {
            assert!(page(dir.path(), mark).is_err(), "{mark}");
        }
        for mark in [
            "<!-- scaled file=results.json -->",
            "<!-- scaled file=results.json parameter=colour -->",
        ] {
            let text = format!("{mark}\n<!-- /scaled -->\n");
            assert!(filled(&text, Path::new("page.md"), dir.path()).is_err(), "{mark}");
        }
    }

    #[test]
    fn a_picture_that_nobody_drew_is_an_error() {
        let dir = tempfile::tempdir().expect("temporary directory");
        let text =
            "<!-- pictured scene=tree light=spot technique=map/plain -->\n<!-- /pictured -->\n";
        let fill = || filled(text, Path::new("docs/page.md"), dir.path());
        assert!(fill().is_err(), "no picture yet");
        std::fs::create_dir(dir.path().join("images")).expect("a directory");
        std::fs::write(dir.path().join("images/page.png"), []).expect("a file");
        let (text, _) = fill().expect("a picture");
        assert!(text.contains("(../images/page.png)"), "{text}");
    }
}

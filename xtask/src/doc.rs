//! `cargo xtask doc`: the measured tables of the documentation, made from committed results.
//!
//! A page holds a pair of marks, between which the table stands:
//!
//! ```text
//! <!-- measured file=results/quick.json scene=tree,street light=directional technique=map/plain -->
//! <!-- /measured -->
//! ```
//!
//! `file` is relative to `docs`. `scene`, `light` and `technique` are lists; without one, all are shown.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail, ensure};
use clap::ValueEnum as _;

use crate::args::{BenchArgs, Size, Suite};
use crate::bench;
use crate::columns;
use crate::results::{Results, Run, Status, describe_light};

const BEGIN: &str = "<!-- measured ";
const END: &str = "<!-- /measured -->";
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
    let docs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs");
    let mut pages = vec![docs.join("../README.md")];
    collect(&docs, &mut pages)?;
    let mut tables = 0;
    for page in pages {
        let text = std::fs::read_to_string(&page)
            .with_context(|| format!("cannot read {}", page.display()))?;
        let (fresh, count) =
            filled(&text, &docs).with_context(|| format!("in {}", page.display()))?;
        tables += count;
        if fresh != text {
            ensure!(!check, "{} is out of date; run `cargo xtask doc`", page.display());
            std::fs::write(&page, fresh)
                .with_context(|| format!("cannot write {}", page.display()))?;
        }
    }
    println!("{tables} tables in the documentation are those of the committed results");
    Ok(())
}

/// Runs the bench behind committed results again and puts the new ones in their place, without the raw images.
pub(crate) fn measure(file: &Path) -> anyhow::Result<()> {
    let old = Results::read(file)?;
    let settings = &old.settings;
    let [width, height] = settings.size;
    let Ok(suite) = Suite::from_str(&settings.suite, false) else {
        bail!("{} is of the unknown suite `{}`", file.display(), settings.suite)
    };
    let out = std::env::temp_dir().join(format!("antumbra-measure-{}", std::process::id()));
    bench::run(BenchArgs {
        scene: in_order(old.runs.iter().map(|run| run.scene.clone())),
        light: in_order(old.runs.iter().map(|run| run.light.kind())),
        technique: in_order(old.runs.iter().map(|run| run.technique.clone())),
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

/// The page with its tables filled, and their number.
fn filled(text: &str, docs: &Path) -> anyhow::Result<(String, usize)> {
    let (mut out, mut rest, mut count) = (String::new(), text, 0);
    // A mark stands at the beginning of a line; elsewhere it is only spoken of.
    while let Some(at) = rest
        .match_indices(BEGIN)
        .map(|(i, _)| i)
        .find(|&i| i == 0 || rest.as_bytes()[i - 1] == b'\n')
    {
        let line = rest[at..].find('\n').map_or(rest.len(), |n| at + n);
        let mark = rest[at..line].trim();
        let Some(end) = rest[line..].find(END) else { bail!("`{mark}` has no `{END}`") };
        out += &rest[..line];
        out += &format!("\n{}", table(mark, docs)?);
        rest = &rest[line + end..];
        count += 1;
    }
    Ok((out + rest, count))
}

fn table(mark: &str, docs: &Path) -> anyhow::Result<String> {
    let inner = mark.trim_start_matches(BEGIN).trim_end_matches("-->");
    let (mut file, mut scenes, mut lights, mut techniques) = (None, None, None, None);
    for pair in inner.split_whitespace() {
        let Some((key, value)) = pair.split_once('=') else { bail!("`{pair}` is not key=value") };
        let list = || Some(value.split(',').map(str::to_owned).collect::<Vec<_>>());
        match key {
            "file" => file = Some(docs.join(value)),
            "scene" => scenes = list(),
            "light" => lights = list(),
            "technique" => techniques = list(),
            _ => bail!("unknown key `{key}`; there are file, scene, light, technique"),
        }
    }
    let Some(file) = file else { bail!("`{mark}` names no file") };
    let results = Results::read(&file)?;
    let among = |list: &Option<Vec<String>>, name: &str| {
        list.as_ref().is_none_or(|l| l.iter().any(|n| n == name))
    };
    let wanted = |run: &&Run| {
        among(&scenes, &run.scene)
            && among(&lights, run.light.kind().name())
            && among(&techniques, &run.technique)
    };
    let runs: Vec<&Run> = results.runs.iter().filter(wanted).collect();
    ensure!(!runs.is_empty(), "`{mark}` selects no run of {}", file.display());

    let shown: Vec<_> = COLUMNS.iter().filter_map(|id| columns::metric(id)).collect();
    let titles: Vec<_> = shown.iter().map(|c| c.title).collect();
    let mut text = format!("\n| scene | light | technique | {} |\n", titles.join(" | "));
    text += &format!("|---|---|---|{}\n", "--:|".repeat(shown.len()));
    for run in runs {
        ensure!(run.status == Status::Ok, "{} on {}: {}", run.technique, run.scene, run.status);
        let cells: Vec<String> = shown
            .iter()
            .map(|c| c.value(run).map_or_else(|| "–".to_owned(), |v| c.unit.show(v)))
            .collect();
        let light = describe_light(&run.light);
        text +=
            &format!("| {} | {light} | `{}` | {} |\n", run.scene, run.technique, cells.join(" | "));
    }
    let [width, height] = results.settings.size;
    text += &format!(
        "\n{}, {}; view {width} x {height}, map {}².\n\n",
        results.adapter.name, results.adapter.driver_info, results.settings.map_size
    );
    Ok(text)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample;

    fn page(dir: &Path, mark: &str) -> anyhow::Result<(String, usize)> {
        let mut results = sample::results();
        results.runs.retain(|r| r.status == Status::Ok);
        results.write(dir)?;
        filled(&format!("before\n{mark}\nold\n{END}\nafter\n"), dir)
    }

    #[test]
    fn tables_are_filled_and_filling_again_changes_nothing() {
        let dir = tempfile::tempdir().expect("temporary directory");
        let mark = "<!-- measured file=results.json -->";
        let (text, count) = page(dir.path(), mark).expect("filled");
        assert_eq!(count, 1, "one table");
        assert!(!text.contains("\nold\n"), "the old table is gone");
        assert!(text.starts_with("before\n") && text.ends_with("after\n"), "the rest stays");
        assert_eq!(filled(&text, dir.path()).expect("filled").0, text, "idempotent");
    }

    #[test]
    fn marks_that_select_nothing_or_say_nonsense_are_errors() {
        let dir = tempfile::tempdir().expect("temporary directory");
        for mark in [
            "<!-- measured file=results.json scene=nowhere -->",
            "<!-- measured file=missing.json -->",
            "<!-- measured scene=street -->",
            "<!-- measured file=results.json colour=red -->",
        ] {
            assert!(page(dir.path(), mark).is_err(), "{mark}");
        }
        assert!(filled("<!-- measured file=x -->\n", dir.path()).is_err(), "no end");
    }
}

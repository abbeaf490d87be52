//! The terminal's table: one group per scene and light, one row per technique.

use comfy_table::{Cell, CellAlignment, ContentArrangement, Table, presets};

use crate::columns::{self, Column};
use crate::results::{Results, Status, describe_light};

/// The columns that fit a terminal of 120 characters; the page shows all.
const BRIEF: [&str; 9] = [
    "mean_abs",
    "rmse",
    "leak",
    "over_shadow",
    "bad_fraction",
    "acne_rate",
    "gpu_ms",
    "ratio_to_plain",
    "bytes",
];

/// The table as text.
pub(crate) fn render(results: &Results) -> String {
    let columns: Vec<&Column> = BRIEF.iter().filter_map(|id| columns::metric(id)).collect();
    let mut text = String::new();
    for group in results.groups() {
        let mut table = Table::new();
        table.load_style(presets::UTF8_FULL_CONDENSED);
        table.set_content_arrangement(ContentArrangement::Disabled);
        let titles = columns.iter().map(|c| c.title);
        table.set_header(std::iter::once("technique").chain(titles));
        for run in &group {
            let mut row = vec![Cell::new(&run.technique)];
            if run.status == Status::Ok {
                row.extend(columns.iter().map(|c| {
                    let text = c.value(run).map_or_else(|| "–".to_owned(), |v| c.unit.show(v));
                    Cell::new(text).set_alignment(CellAlignment::Right)
                }));
            }
            table.add_row(row);
        }
        text += &format!("{} · {}\n{table}\n", group[0].scene, describe_light(&group[0].light));
        for run in group.iter().filter(|r| r.status != Status::Ok) {
            text += &format!("  {}: {}\n", run.technique, run.status);
        }
        text.push('\n');
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample;

    #[test]
    fn every_run_has_a_row_and_failures_say_why() {
        let results = sample::results();
        let text = render(&results);
        for run in &results.runs {
            assert!(text.contains(&run.technique), "{} in\n{text}", run.technique);
        }
        assert!(text.contains("skipped: "), "the reason stands under the table:\n{text}");
        let widest = text.lines().map(|l| l.chars().count()).max().unwrap_or(0);
        assert!(widest <= 120, "the table is {widest} characters wide");
    }
}

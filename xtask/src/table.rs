//! The terminal's tables: runs by scene and light, one row per technique; hard cases, one row each; scaling
//! curves, one row per technique.

use comfy_table::{Cell, CellAlignment, ContentArrangement, Table, presets};

use crate::columns::{self, Column, Unit};
use crate::report::number;
use crate::results::{
    Expected, Results, ScalingCurve, ScalingPoint, StabilityCase, Status, describe_light,
};

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

/// The tables as text.
pub(crate) fn render(results: &Results) -> String {
    runs(results) + &stability(&results.stability) + &scaling(&results.scaling)
}

fn empty_table() -> Table {
    let mut table = Table::new();
    table.load_style(presets::UTF8_FULL_CONDENSED);
    table.set_content_arrangement(ContentArrangement::Disabled);
    table
}

fn right(text: impl ToString) -> Cell {
    Cell::new(text).set_alignment(CellAlignment::Right)
}

fn runs(results: &Results) -> String {
    let columns: Vec<&Column> = BRIEF.iter().filter_map(|id| columns::metric(id)).collect();
    let mut text = String::new();
    for group in results.groups() {
        let mut table = empty_table();
        let titles = columns.iter().map(|c| c.title);
        table.set_header(std::iter::once("technique").chain(titles));
        for run in &group {
            let mut row = vec![Cell::new(&run.technique)];
            if run.status == Status::Ok {
                row.extend(columns.iter().map(|c| {
                    right(c.value(run).map_or_else(|| "–".to_owned(), |v| c.unit.show(v)))
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

/// How many techniques hold, fail as known, and fail, case by case; the page has the whole matrix.
fn stability(cases: &[StabilityCase]) -> String {
    if cases.is_empty() {
        return String::new();
    }
    let mut table = empty_table();
    table.set_header([
        "case",
        "hold",
        "known limit",
        "refused",
        "not judged",
        "FAILED",
        "measured",
    ]);
    for group in cases.chunk_by(|a, b| a.case == b.case) {
        let count = |expected: Expected| {
            let is = |c: &&StabilityCase| !c.is_surprise() && c.expected == expected;
            match group.iter().filter(is).count() {
                0 => String::new(),
                some => some.to_string(),
            }
        };
        let measured = group.iter().filter_map(|c| c.measured);
        let (low, high) = measured.fold((f64::INFINITY, 0.0_f64), |(l, h), v| (l.min(v), h.max(v)));
        let range =
            if low < high { format!("{} – {}", number(low), number(high)) } else { number(high) };
        table.add_row([
            Cell::new(&group[0].case),
            right(count(Expected::Holds)),
            right(count(Expected::KnownLimit)),
            right(count(Expected::Refuses)),
            right(count(Expected::Unsaid)),
            right(group.iter().filter(|c| c.is_surprise()).count()),
            right(range),
        ]);
    }
    let mut text = format!("Hard cases, techniques each\n{table}\n");
    for case in cases.iter().filter(|c| c.is_surprise()) {
        let shown = |v: Option<f64>| v.map_or_else(|| "–".to_owned(), number);
        text += &format!(
            "  FAILED {}, {}: {} {}, expected {} to {}. {}\n",
            case.case,
            case.technique,
            case.number,
            shown(case.measured),
            number(case.at_least.unwrap_or(0.0)),
            shown(case.bound),
            case.reason
        );
    }
    text + "\n"
}

/// Mean absolute error and GPU time of each group of curves.
fn scaling(curves: &[ScalingCurve]) -> String {
    type Show = fn(&ScalingPoint) -> Option<String>;
    let values: [(&str, Show); 2] = [
        ("mean abs", |p| p.mean_abs.map(|v| format!("{v:.2e}"))),
        ("GPU time", |p| p.gpu_ms.map(|v| Unit::Milliseconds.show(v))),
    ];
    let same = |a: &ScalingCurve, b: &ScalingCurve| {
        a.scene == b.scene && a.light == b.light && a.parameter == b.parameter
    };
    let mut text = String::new();
    for group in curves.chunk_by(same) {
        let first = &group[0];
        let (light, parameter) = (describe_light(&first.light), first.parameter.replace('_', " "));
        for (what, show) in values {
            let mut table = empty_table();
            let heads = first.points.iter().map(|p| right(number(p.value)));
            let corner = Cell::new(format!("{what} at {parameter}"));
            table.set_header(std::iter::once(corner).chain(heads));
            for curve in group {
                let cells = curve.points.iter().map(|p| right(show(p).unwrap_or("–".to_owned())));
                table.add_row(std::iter::once(Cell::new(&curve.technique)).chain(cells));
            }
            text += &format!("{} · {light}\n{table}\n", first.scene);
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

    #[test]
    fn every_hard_case_has_a_row_and_surprises_say_what_was_expected() {
        let results = sample::results();
        let text = stability(&results.stability);
        for case in &results.stability {
            assert!(text.contains(&case.case), "{} in\n{text}", case.case);
        }
        let surprises = text.lines().filter(|l| l.trim().starts_with("FAILED")).count();
        assert_eq!(surprises, 1, "the sample has one surprise:\n{text}");
        assert!(text.contains("0.82, expected 0 to 0.01"), "it is explained:\n{text}");
    }

    #[test]
    fn every_curve_has_a_row_in_both_tables() {
        let results = sample::results();
        let text = scaling(&results.scaling);
        for curve in &results.scaling {
            assert_eq!(text.matches(&curve.technique).count(), 2, "{}:\n{text}", curve.technique);
        }
        let widest = text.lines().map(|l| l.chars().count()).max().unwrap_or(0);
        assert!(widest <= 120, "the table is {widest} characters wide");
    }
}

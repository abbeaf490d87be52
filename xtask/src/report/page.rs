//! The page's markup. `maud` escapes every text that goes in.

use std::collections::BTreeSet;
use std::path::Path;

use maud::{DOCTYPE, Markup, PreEscaped, html};

use crate::columns::{Column, METRICS, Unit};
use crate::report::number;
use crate::report::pictures::{NO_SAMPLE, Pictures, Strip};
use crate::report::plot::{self, Curve, Mark};
use crate::results::{
    Expected, Results, Run, ScalingCurve, ScalingPoint, StabilityCase, Status, describe_light,
};

const STYLE: &str = include_str!("style.css");
const SCRIPT: &str = include_str!("script.js");

/// The whole page.
pub(super) fn render(results: &Results, dir: &Path) -> anyhow::Result<String> {
    let groups = results.groups();
    let mut pictures = Pictures::new(dir);
    let sections = groups
        .iter()
        .enumerate()
        .map(|(i, group)| group_section(i, group, &mut pictures))
        .collect::<anyhow::Result<Vec<_>>>()?;
    let scaling = scaling_section(&results.scaling)?;
    let page = html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                meta name="color-scheme" content="light dark";
                title { "Antumbra bench · " (results.adapter.name) }
                style { (PreEscaped(STYLE)) }
            }
            body {
                header {
                    h1 { "Antumbra bench" }
                    p { "Shadow techniques, speed against error, measured against ground truth." }
                    (facts(results))
                }
                nav aria-label="Sections" {
                    @for (i, group) in groups.iter().enumerate() {
                        a href={ "#g" (i) } { (group[0].scene) " · " (describe_light(&group[0].light)) }
                    }
                    @if !results.stability.is_empty() { a href="#stability" { "Stability" } }
                    @if !results.scaling.is_empty() { a href="#scaling" { "Scaling" } }
                }
                main {
                    @for section in &sections { (section) }
                    @if !results.stability.is_empty() { (stability_section(&results.stability)) }
                    (scaling)
                }
                dialog aria-label="Picture, enlarged" { form method="dialog" { button { img alt=""; } } }
                script { (PreEscaped(SCRIPT)) }
            }
        }
    };
    Ok(page.into_string())
}

/// What ran it, and with which settings.
fn facts(results: &Results) -> Markup {
    let (adapter, settings) = (&results.adapter, &results.settings);
    let driver = [adapter.driver.as_str(), adapter.driver_info.as_str()].join(" ");
    let facts = [
        ("Adapter", adapter.name.clone()),
        ("Type", adapter.device_type.clone()),
        ("API", adapter.backend.clone()),
        ("Driver", driver.trim().to_owned()),
        ("Suite", settings.suite.clone()),
        ("View", format!("{} × {}", settings.size[0], settings.size[1])),
        ("Shadow map", format!("{0} × {0}", settings.map_size)),
        ("Light samples", settings.light_samples.to_string()),
        ("Repetitions", settings.repeat.to_string()),
    ];
    html! {
        dl.facts {
            @for (name, value) in facts {
                @if !value.is_empty() { div { dt { (name) } dd { (value) } } }
            }
        }
    }
}

/// One scene under one light: plot, table, pictures.
fn group_section(
    index: usize,
    group: &[&Run],
    pictures: &mut Pictures<'_>,
) -> anyhow::Result<Markup> {
    let marks: Vec<Mark<'_>> = group.iter().filter_map(|run| mark(run)).collect();
    let front: Vec<&Mark<'_>> = plot::pareto_front(&marks).into_iter().map(|i| &marks[i]).collect();
    let strips = group
        .iter()
        .map(|run| Ok((*run, pictures.strip(&run.files)?)))
        .collect::<anyhow::Result<Vec<_>>>()?;
    let light = describe_light(&group[0].light);
    Ok(html! {
        section id={ "g" (index) } {
            h2 { (group[0].scene) " " span.light { (light) } }
            (truth(group))
            @if marks.is_empty() {
                p.note { "No technique has both a time and an error here, so there is no plot." }
            } @else {
                div.overview {
                    figure {
                        figcaption { "Speed against error" span { "down and left is better" } }
                        (plot::speed_error(&marks)?)
                    }
                    aside {
                        h3 { "Pareto front" }
                        p { "Nothing measured here is both faster and more accurate than these." }
                        ol {
                            @for mark in &front {
                                li {
                                    b { (mark.label) }
                                    span { (number(mark.gpu_ms)) " ms · error " (number(mark.error)) }
                                }
                            }
                        }
                    }
                }
            }
            (table(group, &front))
            (picture_strips(&strips))
        }
    })
}

fn mark(run: &Run) -> Option<Mark<'_>> {
    let gpu_ms = run.time.as_ref()?.gpu_ms?.median;
    let error = run.error.as_ref()?.mean_abs;
    let drawable = gpu_ms > 0.0 && gpu_ms.is_finite() && error.is_finite();
    drawable.then_some(Mark { label: &run.technique, gpu_ms, error })
}

/// What the errors are measured against.
fn truth(group: &[&Run]) -> Markup {
    let Some(truth) = group.iter().find_map(|run| run.reference.as_ref()) else {
        return html! {};
    };
    html! {
        p.note {
            "Reference: " (truth.kind) ", " (truth.light_samples)
            @if truth.light_samples == 1 { " light sample" } @else { " light samples" }
            @if let Some(error) = truth.error_estimate { ", estimated RMSE " (number(error)) }
            "."
        }
    }
}

/// The shortest and longest repetition stand in the cell of the median.
fn has_own_column(column: &Column) -> bool {
    !matches!(column.id, "gpu_ms_min" | "gpu_ms_max")
}

fn table(group: &[&Run], front: &[&Mark<'_>]) -> Markup {
    let columns: Vec<&Column> = METRICS.iter().filter(|c| has_own_column(c)).collect();
    let counters: BTreeSet<&String> = group.iter().flat_map(|run| run.work.keys()).collect();
    let heading = |title: &str, help: &str, class: &str| {
        html! { th scope="col" class=(class) { button title=(help) { (title) } } }
    };
    html! {
        div.scroll tabindex="0" role="region" aria-label="Measurements" {
            table.sortable {
                thead { tr {
                    (heading("technique", "family/name; ◆ = on the Pareto front", "text"))
                    (heading("status", "how the run ended", "text"))
                    @for c in &columns { (heading(c.title, c.help, "")) }
                    @for name in &counters { (heading(&name.replace('_', " "), "work counter", "work")) }
                } }
                tbody {
                    @for run in group {
                        tr {
                            th scope="row" {
                                (run.technique)
                                @if front.iter().any(|m| m.label == run.technique) {
                                    span.front title="on the Pareto front" { " ◆" }
                                }
                            }
                            td.text title=(run.status) { (status(&run.status)) }
                            @for c in &columns { (metric_cell(c, run)) }
                            @for name in &counters {
                                (cell(run.work.get(*name).map(|n| (*n as f64, grouped(*n)))))
                            }
                        }
                    }
                }
            }
        }
        details {
            summary { "Configs, light and files" }
            dl.configs {
                dt { "light" }
                dd { code { (serde_json::to_string(&group[0].light).unwrap_or_default()) } }
                @for run in group {
                    dt { (run.technique) }
                    dd {
                        code { (run.config) }
                        @for file in [&run.files.visibility, &run.files.reference, &run.files.position, &run.files.normal, &run.files.mesh].into_iter().flatten() {
                            " " a href=(file) { (file) }
                        }
                    }
                }
            }
        }
    }
}

fn status(status: &Status) -> Markup {
    let (class, word) = match status {
        Status::Ok => return html! { span.ok { "ok" } },
        Status::Failed(why) => ("failed", why),
        Status::Skipped(why) => ("skipped", why),
    };
    html! { span class=(class) { (class) } ": " (word) }
}

fn metric_cell(column: &Column, run: &Run) -> Markup {
    let Some(value) = column.value(run) else {
        return cell(None);
    };
    let shown = match (column.unit, run.time.as_ref().and_then(|t| t.gpu_ms)) {
        (Unit::Count, _) => grouped(value as u64),
        (unit, Some(spread)) if column.id == "gpu_ms" => {
            let show = |v| unit.show(v);
            format!("{} [{} – {}]", show(value), show(spread.min), show(spread.max))
        }
        (unit, _) => unit.show(value),
    };
    cell(Some((value, shown)))
}

fn cell(value: Option<(f64, String)>) -> Markup {
    match value {
        Some((value, shown)) => html! { td data-v=(value) { (shown) } },
        None => html! { td.none { "–" } },
    }
}

/// A count with narrow spaces between thousands.
fn grouped(count: u64) -> String {
    let digits = count.to_string();
    let mut text = String::new();
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            text.push('\u{202f}');
        }
        text.push(digit);
    }
    text
}

fn picture_strips(strips: &[(&Run, Strip)]) -> Markup {
    let reference = strips.iter().find_map(|(_, s)| s.reference.as_ref());
    let no_sample = NO_SAMPLE.map(|c| c.to_string()).join(",");
    let shown: Vec<_> = strips
        .iter()
        .filter(|(_, s)| s.visibility.is_some() || s.error.is_some() || s.shaded.is_some())
        .collect();
    if shown.is_empty() {
        return html! {};
    }
    html! {
        h3 { "Pictures" }
        p.legend {
            span { i style="background:#000" {} "shadow" }
            span { i style="background:#fff" {} "lit" }
            span { i style={ "background:rgb(" (no_sample) ")" } {} "no sample, or not counted" }
            span { i.scale {} "error, from too dark (over-shadow) over right to too light (leak); strength ∝ √|error|" }
            span { i style="background:#969696" {} "not counted" }
        }
        div.strips {
            @for (run, strip) in shown {
                article.strip {
                    h4 { (run.technique)
                        @if let Some(e) = run.error.as_ref().map(|e| e.mean_abs) {
                            span { "mean abs " (number(e)) }
                        }
                    }
                    div.row {
                        (picture(reference, "reference", run))
                        (picture(strip.visibility.as_ref(), "technique", run))
                        (picture(strip.error.as_ref(), "signed error", run))
                        (picture(strip.shaded.as_ref(), "shaded", run))
                    }
                }
            }
        }
    }
}

fn picture(uri: Option<&String>, what: &str, run: &Run) -> Markup {
    let Some(uri) = uri else {
        return html! {};
    };
    html! {
        figure {
            button.zoom aria-label={ "Enlarge: " (what) ", " (run.technique) } {
                img src=(uri) alt={ (what) " of " (run.technique) " on " (run.scene) } loading="lazy";
            }
            figcaption { (what) }
        }
    }
}

/// Technique against hard case.
fn stability_section(cases: &[StabilityCase]) -> Markup {
    let rows = in_order(cases.iter().map(|c| c.case.as_str()));
    let columns = in_order(cases.iter().map(|c| c.technique.as_str()));
    let failed = cases.iter().filter(|c| c.is_surprise()).count();
    let find =
        |row: &str, column: &str| cases.iter().find(|c| c.case == row && c.technique == column);
    html! {
        section #stability {
            h2 { "Stability" }
            p.note {
                (cases.len()) " cases, "
                @if failed == 0 { "all as expected." }
                @else { b.failed { (failed) " not as expected." } }
            }
            div.scroll tabindex="0" role="region" aria-label="Stability matrix" {
                table.matrix {
                    thead { tr {
                        th scope="col" { "case" }
                        @for column in &columns { th scope="col" { (column) } }
                    } }
                    tbody {
                        @for row in &rows {
                            tr {
                                @let case = cases.iter().find(|c| c.case == *row);
                                th scope="row" {
                                    (row)
                                    @if let Some(case) = case {
                                        span.about { (case.about) }
                                        span.about { i { (case.number) } }
                                    }
                                }
                                @for column in &columns {
                                    @match find(row, column) {
                                        Some(case) => { (stability_cell(case)) }
                                        None => { td.none { "–" } }
                                    }
                                }
                            }
                        }
                    }
                }
            }
        }
    }
}

fn stability_cell(case: &StabilityCase) -> Markup {
    let (class, word) = match (case.pass, case.expected) {
        (Some(false), _) => ("failed", "FAILED"),
        (None, _) | (_, Expected::Unsaid) => ("none", "not judged"),
        (_, Expected::Holds) => ("ok", "holds"),
        (_, Expected::KnownLimit) => ("limit", "known limit"),
        (_, Expected::Refuses) => ("limit", "refused"),
    };
    let measured = case.measured.map_or_else(|| "–".to_owned(), number);
    let allowed = match (case.at_least, case.bound) {
        (Some(low), Some(high)) => format!(" in [{}, {}]", number(low), number(high)),
        (None, Some(high)) => format!(" ≤ {}", number(high)),
        _ => String::new(),
    };
    let allowed = if case.is_surprise() { format!(", not{allowed}") } else { allowed };
    html! {
        td class=(class) {
            b { (word) }
            " " span.measured title="measured, and what is expected" { (measured) (allowed) }
            @if !case.reason.is_empty() { span.reason { (case.reason) } }
        }
    }
}

/// What a scaling plot shows of a point.
type ValueOf = fn(&ScalingPoint) -> Option<f64>;

/// Curves of error and time, one pair of plots per scene, light and parameter.
fn scaling_section(curves: &[ScalingCurve]) -> anyhow::Result<Markup> {
    if curves.is_empty() {
        return Ok(html! {});
    }
    let mut groups: Vec<Vec<&ScalingCurve>> = Vec::new();
    for curve in curves {
        let same = |c: &ScalingCurve| {
            c.scene == curve.scene && c.light == curve.light && c.parameter == curve.parameter
        };
        match groups.iter_mut().find(|g| same(g[0])) {
            Some(group) => group.push(curve),
            None => groups.push(vec![curve]),
        }
    }
    Ok(html! {
        section #scaling {
            h2 { "Scaling" }
            @for group in &groups { (scaling_group(group)?) }
        }
    })
}

fn scaling_group(group: &[&ScalingCurve]) -> anyhow::Result<Markup> {
    let parameter = group[0].parameter.replace('_', " ");
    let plots: [(&str, ValueOf); 2] =
        [("mean absolute error", |p| p.mean_abs), ("GPU time, ms", |p| p.gpu_ms)];
    Ok(html! {
        h3 { (group[0].scene) " " span.light { (describe_light(&group[0].light)) } " against " (parameter) }
        p.legend {
            @for (i, curve) in group.iter().enumerate() {
                span {
                    svg.key viewBox="0 0 36 8" { g class=(plot::look(i)) { polyline points="0,4 36,4" {} } }
                    (curve.technique)
                }
            }
        }
        div.plots {
            @for (title, value) in plots {
                @let curves: Vec<Curve<'_>> = group.iter().enumerate().map(|(number, curve)| Curve {
                    label: &curve.technique,
                    points: curve.points.iter().filter_map(|p| Some((p.value, value(p)?))).collect(),
                    number,
                }).collect();
                figure { figcaption { (title) } (plot::curves(&curves, &parameter, title)?) }
            }
        }
    })
}

/// The distinct names, in order of first appearance.
fn in_order<'a>(names: impl Iterator<Item = &'a str>) -> Vec<&'a str> {
    let mut distinct = Vec::new();
    for name in names {
        if !distinct.contains(&name) {
            distinct.push(name);
        }
    }
    distinct
}

//! SVG plots with logarithmic axes. Axes, ticks and grid are `plotters`'; the marks are laid over
//! them, so that the page's style sheet colours them and each has a tooltip.

use std::ops::Range;

use anyhow::anyhow;
use maud::{Markup, PreEscaped, html};
use plotters::coord::combinators::WithKeyPoints;
use plotters::prelude::{
    BindKeyPoints as _, ChartBuilder, IntoDrawingArea as _, IntoLogRange as _, LogCoord, SVGBackend,
};
use plotters::style::{RGBColor, TRANSPARENT};

/// One technique in the plot of speed against error.
pub(super) struct Mark<'a> {
    pub(super) label: &'a str,
    pub(super) gpu_ms: f64,
    pub(super) error: f64,
}

/// One curve of a scaling plot.
pub(super) struct Curve<'a> {
    pub(super) label: &'a str,
    /// Parameter and value, by increasing parameter.
    pub(super) points: Vec<(f64, f64)>,
    /// Its number, by which it has one of the page's colours and dashes.
    pub(super) number: usize,
}

/// How many colours the page has for curves, and how many dashes for those that share one.
const COLOURS: usize = 8;
const DASHES: usize = 6;

/// Classes of the curve with this number.
pub(super) fn look(number: usize) -> String {
    format!("curve c{} d{}", number % COLOURS, number / COLOURS % DASHES)
}

/// Indices of the marks that no other beats in both speed and error, fastest first.
pub(super) fn pareto_front(marks: &[Mark<'_>]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..marks.len()).collect();
    order.sort_by(|&a, &b| {
        let key = |i: usize| (marks[i].gpu_ms, marks[i].error);
        key(a).partial_cmp(&key(b)).unwrap_or(std::cmp::Ordering::Equal)
    });
    let mut best = f64::INFINITY;
    order.retain(|&i| {
        let better = marks[i].error < best;
        best = best.min(marks[i].error);
        better
    });
    order
}

/// Mean absolute error against GPU time, the Pareto front highlighted.
pub(super) fn speed_error(marks: &[Mark<'_>]) -> anyhow::Result<Markup> {
    let x = Axis::covering(marks.iter().map(|m| m.gpu_ms));
    let y = Axis::covering(marks.iter().map(|m| m.error));
    let front = pareto_front(marks);
    let title = format!(
        "Mean absolute error against GPU time of {} techniques; on the Pareto front: {}.",
        marks.len(),
        front.iter().map(|&i| marks[i].label).collect::<Vec<_>>().join(", ")
    );
    let frame =
        Frame { size: (680, 430), x, y, x_title: "GPU time, ms", y_title: "mean absolute error" };
    frame.draw(&title, |at| {
        let points: Vec<(f64, f64)> = marks.iter().map(|m| at(m.gpu_ms, m.error)).collect();
        let steps = staircase(&front, &points);
        let labels = place_labels(marks, &points, &steps, frame.size);
        html! {
            polyline.front points=(path(&steps)) {}
            @for (i, mark) in marks.iter().enumerate() {
                @let class = if front.contains(&i) { "mark best" } else { "mark" };
                g class=(class) tabindex="0" {
                    title { (mark.label) ": " (number(mark.gpu_ms)) " ms, error " (number(mark.error)) }
                    circle cx=(points[i].0) cy=(points[i].1) r="5.5" {}
                    text x=(labels[i].x) y=(labels[i].y) text-anchor=(labels[i].anchor) { (mark.label) }
                }
            }
        }
    })
}

/// Curves of `y_title` against `x_title`.
pub(super) fn curves(curves: &[Curve<'_>], x_title: &str, y_title: &str) -> anyhow::Result<Markup> {
    let all = || curves.iter().flat_map(|c| c.points.iter());
    let x = Axis::covering(all().map(|p| p.0));
    let y = Axis::covering(all().map(|p| p.1));
    let title = format!("{y_title} against {x_title}");
    let frame = Frame { size: (520, 340), x, y, x_title, y_title };
    frame.draw(&title, |at| {
        html! {
            @for curve in curves {
                @let points: Vec<(f64, f64)> = curve.points.iter().map(|p| at(p.0, p.1)).collect();
                g class=(look(curve.number)) {
                    polyline points=(path(&points)) {}
                    @for (point, value) in points.iter().zip(&curve.points) {
                        circle cx=(point.0) cy=(point.1) r="3.5" {
                            title { (curve.label) ": " (number(value.1)) " at " (number(value.0)) }
                        }
                    }
                }
            }
        }
    })
}

/// A number of a plot, short.
pub(crate) fn number(value: f64) -> String {
    if value == 0.0 {
        "0".to_owned()
    } else if (1e-3..1e5).contains(&value.abs()) {
        // Three significant digits, without zeros at the end.
        let digits = (2 - value.abs().log10().floor() as i32).max(0) as usize;
        let text = format!("{value:.digits$}");
        if text.contains('.') {
            text.trim_end_matches('0').trim_end_matches('.').to_owned()
        } else {
            text
        }
    } else {
        format!("{value:.0e}")
    }
}

/// A logarithmic axis. Zero has no place on it, so values of zero are drawn on the line `zero`, a
/// step below the smallest positive value.
struct Axis {
    range: Range<f64>,
    zero: Option<f64>,
}

impl Axis {
    /// An axis with room around all `values`, which are not negative.
    fn covering(values: impl Iterator<Item = f64> + Clone) -> Self {
        let positive = values.clone().filter(|v| *v > 0.0);
        let (mut low, mut high) =
            positive.fold((f64::INFINITY, 0.0_f64), |(l, h), v| (l.min(v), h.max(v)));
        if high == 0.0 {
            (low, high) = (1e-4, 1.0);
        }
        // At least a factor of four in all, so that ticks have numbers to stand at.
        let widen = (4.0 / (high / low)).max(1.0).sqrt() * (high / low).powf(0.06).max(1.15);
        (low, high) = (low / widen, high * widen);
        let zero = values.clone().any(|v| v <= 0.0).then_some(low / (high / low).powf(0.08));
        if let Some(zero) = zero {
            low = zero / (high / zero).powf(0.05);
        }
        Self { range: low..high, zero }
    }

    /// The axis with ticks at 1, 2 and 5 times powers of ten, or at these powers alone if that is
    /// enough.
    fn coordinates(&self) -> WithKeyPoints<LogCoord<f64>> {
        // A tick at the line of zeros, or below, would contradict it.
        let lowest = self.zero.map_or(self.range.start, |z| 1.2 * z);
        let decades = lowest.log10().floor() as i32..=self.range.end.log10().ceil() as i32;
        let ticks = |steps: &[f64]| -> Vec<f64> {
            let all = decades.clone().flat_map(|d| steps.iter().map(move |s| s * 10_f64.powi(d)));
            all.filter(|t| (lowest..=self.range.end).contains(t)).collect()
        };
        let powers = ticks(&[1.0]);
        let chosen = if powers.len() > 3 { powers } else { ticks(&[1.0, 2.0, 5.0]) };
        self.range.clone().log_scale().with_key_points(chosen)
    }

    /// Where `value` is drawn.
    fn place(&self, value: f64) -> f64 {
        if value > 0.0 { value } else { self.zero.unwrap_or(self.range.start) }
    }
}

/// Axes, ticks and grid of a plot.
struct Frame<'a> {
    size: (u32, u32),
    x: Axis,
    y: Axis,
    x_title: &'a str,
    y_title: &'a str,
}

impl Frame<'_> {
    /// Draws the frame and the marks over it; `marks` is given where a pair of values lies.
    fn draw(
        &self,
        title: &str,
        marks: impl FnOnce(&dyn Fn(f64, f64) -> (f64, f64)) -> Markup,
    ) -> anyhow::Result<Markup> {
        let mut svg = String::new();
        let overlay = {
            let root = SVGBackend::with_string(&mut svg, self.size).into_drawing_area();
            // The style sheet replaces the colours; they only have to be there.
            let grid = RGBColor(200, 200, 200);
            let mut chart = ChartBuilder::on(&root)
                .margin(10)
                .margin_right(16)
                .x_label_area_size(44)
                .y_label_area_size(64)
                .build_cartesian_2d(self.x.coordinates(), self.y.coordinates())
                .map_err(|e| anyhow!("cannot lay out a plot: {e}"))?;
            chart
                .configure_mesh()
                .x_desc(self.x_title)
                .y_desc(self.y_title)
                .x_label_formatter(&|v| number(*v))
                .y_label_formatter(&|v| number(*v))
                .x_labels(8)
                .y_labels(8)
                .axis_style(grid)
                .bold_line_style(grid)
                .light_line_style(TRANSPARENT)
                .draw()
                .map_err(|e| anyhow!("cannot draw a plot: {e}"))?;
            let at = |x: f64, y: f64| {
                let (px, py) = chart.backend_coord(&(self.x.place(x), self.y.place(y)));
                (f64::from(px), f64::from(py))
            };
            let overlay = html! {
                @if let Some(zero) = self.y.zero {
                    @let (left, y) = at(self.x.range.start, zero);
                    @let (right, _) = at(self.x.range.end, zero);
                    line.zero x1=(left) y1=(y) x2=(right) y2=(y) {}
                    text.zero x=(left - 8.0) y=(y + 4.0) { "0" }
                }
                (marks(&at))
            };
            root.present().map_err(|e| anyhow!("cannot draw a plot: {e}"))?;
            overlay
        };
        // The backend writes `<svg …>` with a fixed size, and closes it.
        let inner = svg.split_once('>').map_or("", |(_, rest)| rest);
        let inner = inner.trim_end().trim_end_matches("</svg>");
        let (width, height) = self.size;
        Ok(html! {
            svg.plot viewBox={ "0 0 " (width) " " (height) } role="img" aria-label=(title) {
                (PreEscaped(inner)) (overlay)
            }
        })
    }
}

/// SVG's list of points.
fn path(points: &[(f64, f64)]) -> String {
    points.iter().map(|(x, y)| format!("{x},{y}")).collect::<Vec<_>>().join(" ")
}

/// The front as steps: to be better one must lie below and left of them.
fn staircase(front: &[usize], points: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let mut steps: Vec<(f64, f64)> = Vec::new();
    for &i in front {
        if let Some(&(_, y)) = steps.last() {
            steps.push((points[i].0, y));
        }
        steps.push(points[i]);
    }
    steps
}

/// A label's anchor point and which part of the label lies there.
struct Label {
    x: f64,
    y: f64,
    anchor: &'static str,
}

/// Places each mark's label where it covers no mark, no part of the front's `steps` and no label
/// that was placed before: beside, above or below the mark, and further off if it must.
fn place_labels(
    marks: &[Mark<'_>],
    points: &[(f64, f64)],
    steps: &[(f64, f64)],
    size: (u32, u32),
) -> Vec<Label> {
    // Bold glyphs of common sans-serif faces at 12 px are 7.2 px wide on average.
    const GLYPH: f64 = 7.2;
    const HEIGHT: f64 = 13.0;
    let around = |a: &(f64, f64), b: &(f64, f64), r: f64| {
        [a.0.min(b.0) - r, a.1.min(b.1) - r, a.0.max(b.0) + r, a.1.max(b.1) + r]
    };
    let overlaps =
        |a: &[f64; 4], b: &[f64; 4]| a[0] < b[2] && b[0] < a[2] && a[1] < b[3] && b[1] < a[3];
    let mut taken: Vec<[f64; 4]> = points.iter().map(|p| around(p, p, 6.0)).collect();
    taken.extend(steps.windows(2).map(|s| around(&s[0], &s[1], 1.0)));
    let bounds = [70.0, 4.0, f64::from(size.0) - 4.0, f64::from(size.1) - 56.0];
    let inside = |b: &[f64; 4]| {
        b[0] >= bounds[0] && b[1] >= bounds[1] && b[2] <= bounds[2] && b[3] <= bounds[3]
    };
    let place = |(mark, &(x, y)): (&Mark<'_>, &(f64, f64))| {
        let width = GLYPH * mark.label.chars().count() as f64;
        let mut candidates = Vec::new();
        for ring in 0..5 {
            let up = HEIGHT * f64::from(ring);
            let label = |x, y, anchor| Label { x, y, anchor };
            candidates.extend([
                label(x + 9.0, y + 4.0 - up, "start"),
                label(x + 6.0, y - 7.0 - up, "start"),
                label(x - 9.0, y + 4.0 + up, "end"),
                label(x - 6.0, y + 15.0 + up, "end"),
                label(x + 9.0, y + 15.0 + up, "start"),
                label(x, y - 10.0 - up, "middle"),
                label(x, y + 18.0 + up, "middle"),
            ]);
        }
        let area = |label: &Label| {
            let left = match label.anchor {
                "start" => label.x,
                "end" => label.x - width,
                _ => label.x - 0.5 * width,
            };
            [left, label.y - HEIGHT + 3.0, left + width, label.y + 3.0]
        };
        let free = |label: &Label| {
            let area = area(label);
            inside(&area) && !taken.iter().any(|t| overlaps(t, &area))
        };
        let chosen = candidates.swap_remove(candidates.iter().position(free).unwrap_or(0));
        taken.push(area(&chosen));
        chosen
    };
    marks.iter().zip(points).map(place).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mark(gpu_ms: f64, error: f64) -> Mark<'static> {
        Mark { label: "t", gpu_ms, error }
    }

    #[test]
    fn front_holds_what_nothing_beats() {
        let marks =
            [mark(2.0, 0.1), mark(1.0, 0.2), mark(3.0, 0.15), mark(2.5, 0.0), mark(1.0, 0.3)];
        assert_eq!(pareto_front(&marks), [1, 0, 3], "fastest first, each with less error");
        assert!(pareto_front(&[]).is_empty(), "nothing, no front");
    }

    #[test]
    fn zero_gets_a_place_below_all_others() {
        let axis = Axis::covering([0.0, 1e-3, 0.5].into_iter());
        let zero = axis.place(0.0);
        assert!(axis.range.contains(&zero), "{zero} lies in {:?}", axis.range);
        assert!(zero < 1e-3, "{zero} is less than every positive value");
        assert!(axis.range.contains(&1e-3), "all values lie on the axis");
        let none = Axis::covering([0.0].into_iter());
        assert!(none.range.contains(&none.place(0.0)), "only zeros still make an axis");
        let single = Axis::covering([0.25].into_iter());
        assert!(single.range.start < 0.25 && single.range.end > 0.25, "one value has room around");
    }

    #[test]
    fn plots_draw_with_any_number_of_marks() {
        for n in [0, 1, 40] {
            let marks: Vec<Mark<'_>> = (0..n).map(|i| mark(1.0, f64::from(i) * 0.0)).collect();
            let svg = speed_error(&marks).expect("drawn").into_string();
            assert_eq!(svg.matches("<circle").count(), n as usize, "one circle per mark");
            assert!(!svg.contains("NaN"), "every coordinate is a number");
        }
    }

    #[test]
    fn numbers_are_short() {
        for (value, text) in [
            (0.0, "0"),
            (1024.0, "1024"),
            (0.25, "0.25"),
            (12.345, "12.3"),
            (1e-5, "1e-5"),
            (100.0, "100"),
        ] {
            assert_eq!(number(value), text, "{value}");
        }
    }
}

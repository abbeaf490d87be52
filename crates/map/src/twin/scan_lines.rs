//! The cutting of rows into spans, `map/scan_lines.wesl`, in the same `f32` arithmetic.

use crate::Span;

/// The spans of a row of depths, each texel's depth being off by at most `absolute` + `relative` times itself, and
/// never larger than it was.
#[must_use]
pub fn cut(row: &[f32], absolute: f32, relative: f32) -> Vec<Span> {
    const ROUNDOFF: f32 = 5.960_464_5e-8;
    let mut spans: Vec<Span> = Vec::new();
    let (mut low, mut high) = (0.0, 0.0);
    for (s, &z) in row.iter().enumerate() {
        let allowed = absolute + relative * z;
        if let Some(span) = spans.last_mut() {
            let k = (s as u32 - span.start) as f32;
            let lower = (z - 0.75 * allowed - span.depth) / k;
            let upper = (z - 0.25 * allowed - span.depth) / k;
            let (least, most) =
                if k == 1.0 { (lower, upper) } else { (lower.max(low), upper.min(high)) };
            let rounding = 8.0 * ROUNDOFF * (span.depth.abs() + z + allowed);
            if least <= most && rounding <= 0.25 * allowed {
                (low, high) = (least, most);
                span.slope = 0.5 * (low + high);
                continue;
            }
        }
        spans.push(Span { start: s as u32, depth: z - 0.5 * allowed, slope: 0.0 });
    }
    spans
}

/// The depth of texel `s` by the row's spans, `map/scan_line_map.wesl`.
#[must_use]
pub fn depth_at(spans: &[Span], s: u32) -> f32 {
    let next = spans.partition_point(|span| span.start <= s);
    let span = spans[next - 1];
    span.depth + span.slope * (s - span.start) as f32
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Rows as casters make them: planes side by side with gaps between, rounded to `f32`.
    fn row() -> impl Strategy<Value = Vec<f32>> {
        let piece = (1..80usize, 0.0..1.0f32, -0.01..0.01f32, any::<bool>());
        prop::collection::vec(piece, 1..12).prop_map(|pieces| {
            let plane = |(n, z, slope, there): (usize, f32, f32, bool)| {
                (0..n)
                    .map(move |k| if there { (z + slope * k as f32).clamp(0.0, 1.0) } else { 0.0 })
            };
            pieces.into_iter().flat_map(plane).collect()
        })
    }

    proptest! {
        /// Nothing gets nearer to the light, and nothing farther than is allowed.
        #[test]
        fn depth_is_kept_within_the_band(
            row in row(),
            absolute in prop_oneof![Just(0.0f32), 1e-7..1e-2f32],
            relative in prop_oneof![Just(0.0f32), 1e-7..1e-2f32],
        ) {
            let spans = cut(&row, absolute, relative);
            prop_assert!(spans.windows(2).all(|w| w[0].start < w[1].start) && spans[0].start == 0);
            for (s, z) in row.iter().enumerate() {
                let off = f64::from(*z) - f64::from(depth_at(&spans, s as u32));
                let allowed = f64::from(absolute) + f64::from(relative) * f64::from(*z);
                prop_assert!(off >= 0.0 && off <= allowed, "texel {s}: off by {off}, not {allowed}");
            }
        }
    }

    #[test]
    fn planes_are_one_span_each_and_what_is_cut_needs_its_tolerance() {
        let plane = |k: usize| 0.3 + 0.001 * k as f32;
        let row: Vec<f32> = (0..300).map(|k| if k < 200 { plane(k) } else { 0.0 }).collect();
        let starts = |t| cut(&row, t, 0.0).iter().map(|span| span.start).collect::<Vec<_>>();
        assert_eq!(starts(2f32.powi(-16)), [0, 200], "a plane, and nothing");
        assert_eq!(starts(0.0).len(), 201, "bit by bit, only nothing is a span");
    }
}

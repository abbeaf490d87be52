//! The measured columns, once for every table: terminal, CSV and page.

use antumbra_reference::Metrics;

use crate::results::{Run, Spread, Time};

/// One measured column.
pub(crate) struct Column {
    /// Name in the CSV file.
    pub(crate) id: &'static str,
    /// Heading in tables for people.
    pub(crate) title: &'static str,
    /// What it is, for a tooltip.
    pub(crate) help: &'static str,
    /// How people read it.
    pub(crate) unit: Unit,
    /// The number it shows.
    source: Source,
}

/// Where in a run a column's number stands.
enum Source {
    Error(fn(&Metrics) -> Option<f64>),
    Count(fn(&Metrics) -> usize),
    Gpu(fn(&Spread) -> f64),
    Time(fn(&Time) -> Option<f64>),
    Bytes,
}

/// How a number is written for people.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Unit {
    /// An error of visibility, from 0 to 1.
    Visibility,
    /// A fraction of samples, shown as per cent.
    Percent,
    /// Milliseconds.
    Milliseconds,
    /// A multiple of the plain map's cost.
    Ratio,
    /// Bytes.
    Bytes,
    /// A count.
    Count,
}

const fn column(
    id: &'static str,
    title: &'static str,
    help: &'static str,
    unit: Unit,
    source: Source,
) -> Column {
    Column { id, title, help, unit, source }
}

/// All measured columns but the work counters, in reading order.
#[rustfmt::skip]
pub(crate) const METRICS: &[Column] = {
    use Source::{Bytes, Count, Error, Gpu};
    use Unit::{Milliseconds, Percent, Ratio, Visibility};
    &[
        column("mean_abs", "mean abs", "mean absolute error of visibility", Visibility, Error(|e| Some(e.mean_abs))),
        column("rmse", "RMSE", "root mean square error of visibility", Visibility, Error(|e| Some(e.rmse))),
        column("leak", "leak", "mean of the positive error: too light", Visibility, Error(|e| Some(e.leak))),
        column("over_shadow", "over-shadow", "mean of the negative error: too dark", Visibility, Error(|e| Some(e.over_shadow))),
        column("p95", "p95", "95th percentile of the absolute error", Visibility, Error(|e| Some(e.p95))),
        column("p99", "p99", "99th percentile of the absolute error", Visibility, Error(|e| Some(e.p99))),
        column("max", "max", "largest absolute error", Visibility, Error(|e| Some(e.max))),
        column("bad_fraction", "bad", "samples that are off by more than 0.1", Percent, Error(|e| Some(e.bad_fraction))),
        column("penumbra_rmse", "penumbra RMSE", "RMSE where the truth is partly lit", Visibility, Error(|e| e.penumbra_rmse)),
        column("acne_rate", "acne", "unoccluded samples shown in shadow", Percent, Error(|e| e.acne_rate)),
        column("flip", "FLIP", "mean FLIP difference of the shaded pictures", Visibility, Error(|e| e.flip)),
        column("gpu_ms", "GPU ms", "GPU time of one frame's shadows, median", Milliseconds, Gpu(|s| s.median)),
        column("gpu_ms_min", "GPU min", "GPU time, shortest repetition", Milliseconds, Gpu(|s| s.min)),
        column("gpu_ms_max", "GPU max", "GPU time, longest repetition", Milliseconds, Gpu(|s| s.max)),
        column("ratio_to_plain", "× plain", "GPU time over that of map/plain", Ratio, Source::Time(|t| t.ratio_to_plain)),
        column("cpu_ms", "CPU ms", "CPU time to record one frame's commands", Milliseconds, Source::Time(|t| t.cpu_ms)),
        column("bytes", "memory", "GPU memory that the technique holds", Unit::Bytes, Bytes),
        column("view_samples", "samples", "view samples that count", Unit::Count, Count(|e| e.view_samples)),
        column("excluded_facing", "facing away", "view samples that face away from the light", Unit::Count, Count(|e| e.excluded_facing)),
        column("outside_light", "outside light", "view samples outside the light's cone", Unit::Count, Count(|e| e.outside_light)),
        column("ties", "ties", "view samples within the tie band", Unit::Count, Count(|e| e.ties)),
    ]
};

impl Column {
    /// The number of this column in `run`, `None` where it was not measured.
    pub(crate) fn value(&self, run: &Run) -> Option<f64> {
        let (error, time) = (run.error.as_ref(), run.time.as_ref());
        match self.source {
            Source::Error(get) => error.and_then(get),
            Source::Count(get) => error.map(|e| get(e) as f64),
            Source::Gpu(get) => time.and_then(|t| t.gpu_ms.as_ref()).map(get),
            Source::Time(get) => time.and_then(get),
            Source::Bytes => run.bytes.map(|b| b as f64),
        }
    }
}

/// The column named `id`.
pub(crate) fn metric(id: &str) -> Option<&'static Column> {
    METRICS.iter().find(|c| c.id == id)
}

impl Unit {
    /// The number as people read it.
    pub(crate) fn show(self, value: f64) -> String {
        match self {
            Self::Visibility if value == 0.0 => "0".to_owned(),
            Self::Visibility if value.abs() < 5e-5 => format!("{value:.1e}"),
            Self::Visibility => format!("{value:.4}"),
            Self::Percent if value == 0.0 => "0 %".to_owned(),
            Self::Percent if value.abs() < 5e-5 => format!("{:.0e} %", 100.0 * value),
            Self::Percent => format!("{:.2} %", 100.0 * value),
            Self::Milliseconds if value < 0.1 => format!("{value:.4}"),
            Self::Milliseconds if value < 10.0 => format!("{value:.3}"),
            Self::Milliseconds => format!("{value:.1}"),
            Self::Ratio => format!("{value:.2}"),
            Self::Bytes if value < 1024.0 => format!("{value} B"),
            Self::Bytes if value < 1024.0 * 1024.0 => format!("{:.1} KiB", value / 1024.0),
            Self::Bytes => format!("{:.1} MiB", value / (1024.0 * 1024.0)),
            Self::Count => format!("{value}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn small_errors_stay_visible_and_zero_is_plain() {
        assert_eq!(Unit::Visibility.show(0.0), "0", "exact results read as 0");
        assert_eq!(Unit::Visibility.show(2e-6), "2.0e-6", "a small error is not rounded to 0");
        assert_eq!(Unit::Percent.show(1e-6), "1e-4 %", "a rare error is not rounded to 0 %");
        assert_eq!(Unit::Bytes.show(4.0 * 1024.0 * 1024.0), "4.0 MiB", "bytes in binary units");
    }

    #[test]
    fn column_names_are_unique() {
        for (i, c) in METRICS.iter().enumerate() {
            assert!(METRICS[..i].iter().all(|d| d.id != c.id), "two columns are named {}", c.id);
        }
    }
}

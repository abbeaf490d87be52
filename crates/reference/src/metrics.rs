//! Error figures of an estimated visibility against the reference at the same view samples.
//!
//! The error of a sample is `e = estimate - reference`, taken in `f64`. All means run over the
//! samples of class [`SampleClass::Counted`], in order, so that equal inputs give equal figures to
//! the last bit. Faulty input gives an error that names the first fault, never a number.

use serde::{Deserialize, Serialize};

use crate::sample::SampleClass;

/// A sample is *off* where its error exceeds this in magnitude.
pub const BAD_ERROR: f64 = 0.1;

/// A lit sample shows *acne* where its estimate falls below this.
pub const ACNE_BELOW: f32 = 0.9;

/// Acne is looked for only at samples farther than this from any shadow, Chebyshev distance in
/// pixels; nearer ones may rightly be darkened by a filter.
pub const ACNE_CLEARANCE: usize = 8;

/// Visibility above which [`contact_gap`] takes a sample as lit.
pub const LIT_ABOVE: f32 = 0.5;

/// Visibilities between which the width of a penumbra is measured.
pub const PENUMBRA_LEVELS: [f64; 2] = [0.05, 0.95];

/// Input from which no figure can be computed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum MetricError {
    /// Two inputs that go together differ in length.
    #[error("{found} {what} for {expected} estimates; give one for each")]
    LengthMismatch {
        /// The input that does not fit.
        what: &'static str,
        /// Number of estimates.
        expected: usize,
        /// Length of the other input.
        found: usize,
    },
    /// The samples do not fill an image of the stated width.
    #[error(
        "{samples} samples do not fill rows of {width}; give the width of the picture they come from"
    )]
    Width {
        /// Number of samples.
        samples: usize,
        /// Stated width, pixels.
        width: usize,
    },
    /// No sample is counted, so that there is nothing to average.
    #[error("no counted sample; choose a view in which surfaces face the light")]
    Empty,
    /// An estimate is no visibility.
    #[error("estimate {value} of sample {index} is not within [0, 1]; the technique is at fault")]
    Estimate {
        /// Index of the first such sample.
        index: usize,
        /// Its value.
        value: f32,
    },
    /// A reference is no visibility.
    #[error(
        "reference {value} of sample {index} is not within [0, 1]; the ground truth is at fault"
    )]
    Reference {
        /// Index of the first such sample.
        index: usize,
        /// Its value.
        value: f32,
    },
    /// Positions along a line are not finite, or not in ascending order from zero.
    #[error("position {index} on the line is not finite or not beyond the one before it")]
    Position {
        /// Index of the first such position.
        index: usize,
    },
    /// A texel has no usable size.
    #[error("a texel of {size} metres; give its positive size")]
    Texel {
        /// The size given.
        size: f64,
    },
    /// A profile does not lead from shadow to light.
    #[error("the {profile} does not cross from below {low} to above {high}; lay the line across the whole penumbra", low = PENUMBRA_LEVELS[0], high = PENUMBRA_LEVELS[1])]
    NoPenumbra {
        /// Which profile.
        profile: &'static str,
    },
}

/// The figures of one comparison. Field names are those of the JSON output.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Metrics {
    /// Samples that entered the figures.
    pub view_samples: usize,
    /// Samples left out because their surface faces away from the whole light.
    pub excluded_facing: usize,
    /// Samples left out because they lie outside the light's cone.
    pub outside_light: usize,
    /// Samples left out because the truth is a matter of rounding there.
    pub ties: usize,
    /// Mean of e; leak minus over-shadow.
    pub mean_signed: f64,
    /// Mean of |e|; leak plus over-shadow.
    pub mean_abs: f64,
    /// Root of the mean of e².
    pub rmse: f64,
    /// Mean of max(e, 0): too light.
    pub leak: f64,
    /// Mean of max(-e, 0): too dark.
    pub over_shadow: f64,
    /// 95th percentile of |e|, nearest rank: the smallest |e| that 95 % of the samples do not exceed.
    pub p95: f64,
    /// 99th percentile of |e|, nearest rank.
    pub p99: f64,
    /// Largest |e|.
    pub max: f64,
    /// Share of samples with |e| > [`BAD_ERROR`].
    pub bad_fraction: f64,
    /// Root of the mean of e² over the samples with 0 < reference < 1; none without such samples.
    pub penumbra_rmse: Option<f64>,
    /// Share of samples with an estimate below [`ACNE_BELOW`] among those with reference 1 and more
    /// than [`ACNE_CLEARANCE`] pixels from any counted or tied sample with a reference below 1; none
    /// without such samples.
    pub acne_rate: Option<f64>,
    /// FLIP of the shaded picture, for whoever renders it to fill in.
    pub flip: Option<f64>,
}

/// An estimate beside its reference, row by row of a picture.
#[derive(Clone, Copy, Debug)]
pub struct Comparison<'a> {
    /// The technique's visibility for each sample, in [0, 1]; ignored where the class is
    /// [`SampleClass::Missing`].
    pub estimate: &'a [f32],
    /// The true visibility for each sample, in [0, 1]; read for counted and tied samples only.
    pub reference: &'a [f32],
    /// What each sample is.
    pub classes: &'a [SampleClass],
    /// Width of the picture, pixels; samples that form no picture may use their number.
    pub width: usize,
}

impl Comparison<'_> {
    /// All figures, `flip` left open.
    ///
    /// # Errors
    /// Lengths or width that do not fit, values outside [0, 1] (non-finite ones among them), or no
    /// counted sample.
    pub fn metrics(&self) -> Result<Metrics, MetricError> {
        self.validate()?;
        let errors: Vec<f64> = self.counted().map(|i| self.error(i)).collect();
        if errors.is_empty() {
            return Err(MetricError::Empty);
        }
        let mean =
            |f: fn(f64) -> f64| errors.iter().map(|&e| f(e)).sum::<f64>() / errors.len() as f64;
        let in_penumbra = |&i: &usize| self.reference[i] > 0.0 && self.reference[i] < 1.0;
        let penumbra = mean_of(self.counted().filter(in_penumbra).map(|i| self.error(i).powi(2)));
        let mut magnitudes: Vec<f64> = errors.iter().map(|e| e.abs()).collect();
        magnitudes.sort_unstable_by(f64::total_cmp);
        Ok(Metrics {
            view_samples: errors.len(),
            excluded_facing: self.number_of(SampleClass::FacingAway),
            outside_light: self.number_of(SampleClass::OutsideLight),
            ties: self.number_of(SampleClass::Tie),
            mean_signed: mean(|e| e),
            mean_abs: mean(f64::abs),
            rmse: mean(|e| e * e).sqrt(),
            leak: mean(|e| e.max(0.0)),
            over_shadow: mean(|e| (-e).max(0.0)),
            p95: nearest_rank(&magnitudes, 95),
            p99: nearest_rank(&magnitudes, 99),
            max: nearest_rank(&magnitudes, 100),
            bad_fraction: mean(|e| if e.abs() > BAD_ERROR { 1.0 } else { 0.0 }),
            penumbra_rmse: penumbra.map(f64::sqrt),
            acne_rate: self.acne_rate(),
            flip: None,
        })
    }

    fn validate(&self) -> Result<(), MetricError> {
        let expected = self.estimate.len();
        let others = [("references", self.reference.len()), ("classes", self.classes.len())];
        for (what, found) in others {
            if found != expected {
                return Err(MetricError::LengthMismatch { what, expected, found });
            }
        }
        if expected == 0 {
            return Err(MetricError::Empty);
        }
        if self.width == 0 || !expected.is_multiple_of(self.width) {
            return Err(MetricError::Width { samples: expected, width: self.width });
        }
        for (index, class) in self.classes.iter().enumerate() {
            let (estimate, reference) = (self.estimate[index], self.reference[index]);
            if *class != SampleClass::Missing && !is_visibility(estimate) {
                return Err(MetricError::Estimate { index, value: estimate });
            }
            if self.has_reference(index) && !is_visibility(reference) {
                return Err(MetricError::Reference { index, value: reference });
            }
        }
        Ok(())
    }

    fn counted(&self) -> impl Iterator<Item = usize> {
        (0..self.classes.len()).filter(|&i| self.classes[i] == SampleClass::Counted)
    }

    fn number_of(&self, class: SampleClass) -> usize {
        self.classes.iter().filter(|&&c| c == class).count()
    }

    fn has_reference(&self, index: usize) -> bool {
        matches!(self.classes[index], SampleClass::Counted | SampleClass::Tie)
    }

    fn error(&self, index: usize) -> f64 {
        f64::from(self.estimate[index]) - f64::from(self.reference[index])
    }

    fn acne_rate(&self) -> Option<f64> {
        let shadowed: Vec<bool> = (0..self.reference.len())
            .map(|i| self.has_reference(i) && self.reference[i] < 1.0)
            .collect();
        let near_shadow = dilate(&shadowed, self.width, ACNE_CLEARANCE);
        mean_of(
            self.counted()
                .filter(|&i| !near_shadow[i])
                .map(|i| if self.estimate[i] < ACNE_BELOW { 1.0 } else { 0.0 }),
        )
    }
}

/// Mean of |e(after) - e(before)| over the samples counted in both of two frames: what flickers when
/// the camera or the light moves by less than a texel.
///
/// Sample i of one frame is compared with sample i of the other.
///
/// # Errors
/// As [`Comparison::metrics`], for either frame, or for frames of different size.
pub fn temporal_error(before: &Comparison, after: &Comparison) -> Result<f64, MetricError> {
    before.validate()?;
    after.validate()?;
    let (expected, found) = (before.estimate.len(), after.estimate.len());
    if expected != found {
        return Err(MetricError::LengthMismatch {
            what: "samples of the later frame",
            expected,
            found,
        });
    }
    let in_both = before.counted().filter(|&i| after.classes[i] == SampleClass::Counted);
    mean_of(in_both.map(|i| (after.error(i) - before.error(i)).abs())).ok_or(MetricError::Empty)
}

/// Width of the penumbra on a line from shadow into light or back, in the unit of `positions`.
///
/// Taken between the outermost crossings of 5 % and 95 % on the piecewise linear profile: the last
/// crossing of 95 % as seen from the dark end, less the first one of 5 %, so that ripples widen it.
/// Divided by the difference of the levels, so that a linear penumbra gives its full width.
///
/// # Errors
/// Lengths that differ, values outside [0, 1], positions not ascending, or a profile that does not
/// lead from below 5 % at one end to above 95 % at the other.
pub fn penumbra_width(positions: &[f64], visibility: &[f32]) -> Result<f64, MetricError> {
    width_of(positions, visibility, "profile")
}

/// Penumbra width of the estimate less that of the reference, in the unit of `positions`: positive
/// where the technique's penumbra is too wide.
///
/// # Errors
/// As [`penumbra_width`], for either profile.
pub fn penumbra_width_error(
    positions: &[f64],
    estimate: &[f32],
    reference: &[f32],
) -> Result<f64, MetricError> {
    Ok(width_of(positions, estimate, "estimated profile")?
        - width_of(positions, reference, "reference profile")?)
}

fn width_of(
    positions: &[f64],
    visibility: &[f32],
    profile: &'static str,
) -> Result<f64, MetricError> {
    check_line(positions, visibility, f64::NEG_INFINITY)?;
    let [low, high] = PENUMBRA_LEVELS;
    let mut points: Vec<(f64, f64)> =
        positions.iter().zip(visibility).map(|(&x, &v)| (x, f64::from(v))).collect();
    if let [(_, first), .., (_, last)] = points[..]
        && first > last
    {
        points.reverse();
    }
    let ends = points.first().zip(points.last());
    if ends.is_none_or(|(dark, light)| dark.1 >= low || light.1 <= high) {
        return Err(MetricError::NoPenumbra { profile });
    }
    let crossing = |level: f64| {
        move |w: &[(f64, f64)]| {
            let ((x0, v0), (x1, v1)) = (w[0], w[1]);
            (v0 < level && v1 >= level).then(|| x0 + (x1 - x0) * (level - v0) / (v1 - v0))
        }
    };
    let start = points.windows(2).find_map(crossing(low));
    let end = points.windows(2).rev().find_map(crossing(high));
    match (start, end) {
        (Some(start), Some(end)) => Ok((end - start).abs() / (high - low)),
        _ => Err(MetricError::NoPenumbra { profile }),
    }
}

/// Length of the lit strip between an object and its shadow, in texels.
///
/// `distances` (metres, ascending from 0) run from the point of contact into the shadow. From the
/// contact outwards, samples that are lit in the estimate (above [`LIT_ABOVE`]) and dark in the truth
/// belong to the gap; the first other sample ends it. A sample stands for the line up to half way to
/// its neighbours, the first one from the contact on.
///
/// # Errors
/// Lengths that differ, no sample, values outside [0, 1], distances negative or not ascending, or a
/// texel size that is not positive and finite.
pub fn contact_gap(
    distances: &[f64],
    estimate: &[f32],
    reference: &[f32],
    texel: f64,
) -> Result<f64, MetricError> {
    check_line(distances, estimate, 0.0)?;
    let (expected, found) = (estimate.len(), reference.len());
    if found != expected {
        return Err(MetricError::LengthMismatch { what: "references", expected, found });
    }
    if let Some((index, &value)) = reference.iter().enumerate().find(|(_, v)| !is_visibility(**v)) {
        return Err(MetricError::Reference { index, value });
    }
    if !(texel > 0.0 && texel.is_finite()) {
        return Err(MetricError::Texel { size: texel });
    }
    let is_gap = |i: &usize| estimate[*i] > LIT_ABOVE && reference[*i] <= LIT_ABOVE;
    let length = match (0..expected).take_while(is_gap).last() {
        None => 0.0,
        Some(last) if last + 1 == expected => distances[last],
        Some(last) => 0.5 * (distances[last] + distances[last + 1]),
    };
    Ok(length / texel)
}

/// Positions finite and ascending from `from`, one estimate for each, at least one.
fn check_line(positions: &[f64], estimate: &[f32], from: f64) -> Result<(), MetricError> {
    let (expected, found) = (estimate.len(), positions.len());
    if found != expected {
        return Err(MetricError::LengthMismatch { what: "positions", expected, found });
    }
    if expected == 0 {
        return Err(MetricError::Empty);
    }
    for (index, &x) in positions.iter().enumerate() {
        let after = if index == 0 { x >= from } else { x > positions[index - 1] };
        if !(after && x.is_finite()) {
            return Err(MetricError::Position { index });
        }
    }
    match estimate.iter().enumerate().find(|(_, v)| !is_visibility(**v)) {
        Some((index, &value)) => Err(MetricError::Estimate { index, value }),
        None => Ok(()),
    }
}

fn is_visibility(v: f32) -> bool {
    (0.0..=1.0).contains(&v)
}

fn mean_of(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (sum, number) = values.fold((0.0, 0_usize), |(sum, n), v| (sum + v, n + 1));
    (number > 0).then(|| sum / number as f64)
}

/// The value of rank ceil(percent / 100 n), counted from 1, of ascending values.
fn nearest_rank(ascending: &[f64], percent: usize) -> f64 {
    ascending[(ascending.len() * percent).div_ceil(100) - 1]
}

/// Marks every pixel within `radius` (Chebyshev) of a marked one: along the rows, then the columns.
fn dilate(marked: &[bool], width: usize, radius: usize) -> Vec<bool> {
    let height = marked.len() / width;
    let mut rows = vec![false; marked.len()];
    for y in 0..height {
        spread(marked, &mut rows, y * width, 1, width, radius);
    }
    let mut out = vec![false; marked.len()];
    for x in 0..width {
        spread(&rows, &mut out, x, width, height, radius);
    }
    out
}

/// One line of `dilate`: `number` pixels from `start` on, `stride` apart.
fn spread(
    from: &[bool],
    to: &mut [bool],
    start: usize,
    stride: usize,
    number: usize,
    radius: usize,
) {
    let mut done = 0;
    for i in (0..number).filter(|i| from[start + i * stride]) {
        for j in done.max(i.saturating_sub(radius))..(i + radius + 1).min(number) {
            to[start + j * stride] = true;
        }
        done = (i + radius + 1).min(number);
    }
}

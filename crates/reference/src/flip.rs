//! FLIP: the difference a viewer notices when two pictures alternate in place.
//!
//! LDR-FLIP of Andersson, Nilsson, Akenine-Möller, Oskarsson, Åström and Fairchild 2020, "FLIP: A
//! Difference Evaluator for Alternating Images" (Proc. ACM Comput. Graph. Interact. Tech. 3(2)), here
//! "the paper"; constants carry its names. Two pipelines meet in the last step:
//!
//! * colour: blur each opponent channel by the eye's contrast sensitivity, then take the distance of
//!   the colours in a perceptually uniform space, redistributed to [0, 1];
//! * feature: the difference of edge and of point strength in the luminance.
//!
//! The error is `colour^(1 - feature)`. Every filter is a sum of products of one-dimensional kernels, so
//! that each costs two passes. Outside the picture its border pixels are repeated, as in the authors'
//! implementation, with which this one agrees but for rounding: theirs works in `f32`, this one in
//! `f64`, which matters where both pictures look the same next to a feature that differs (figures in
//! `tests/flip.rs`).

use std::f64::consts::{FRAC_1_SQRT_2, PI};
use std::ops::RangeInclusive;

use glam::{DMat3, DVec3};
use rayon::prelude::*;

/// Pixels per degree of visual angle that published figures assume, 67: a screen 3840 pixels and 0.7 m
/// wide seen from 0.7 m, the default of the authors' tool.
pub const FLIP_PIXELS_PER_DEGREE: f64 = pixels_per_degree(0.7, 3840.0, 0.7).round();

/// Pixels per degree that [`flip()`] accepts: below, no feature spans a pixel; above, the filters outgrow
/// any picture.
pub const FLIP_PIXELS_PER_DEGREE_RANGE: RangeInclusive<f64> = 1.0..=1000.0;

/// A term `(a, b)` of the contrast sensitivity: at f cycles per degree, `a exp(-b f²)`; hence, at x
/// degrees, `a sqrt(pi / b) exp(-pi² x² / b)`. Values from the paper's table of the filters.
type Term = (f64, f64);

/// Contrast sensitivity of the achromatic channel (its second term is zero).
const ACHROMATIC: &[Term] = &[(1.0, 0.0047)];
/// Contrast sensitivity of the red-green channel (its second term is zero).
const RED_GREEN: &[Term] = &[(1.0, 0.0053)];
/// Contrast sensitivity of the blue-yellow channel.
const BLUE_YELLOW: &[Term] = &[(34.1, 0.04), (13.5, 0.025)];
/// Largest b of all terms, which sets the common radius of the blurs.
const WIDEST_B: f64 = 0.04;

/// Exponent that compresses colour distances (the paper's q_c).
const QC: f64 = 0.7;
/// Share of the largest compressed distance that maps to [`PT`] (the paper's p_c).
const PC: f64 = 0.4;
/// Error to which that share maps; what lies above is squeezed into the rest (the paper's p_t).
const PT: f64 = 0.95;
/// Width of the feature detectors, degrees (the paper's w); their deviation is half of it.
const W: f64 = 0.082;
/// Exponent that lifts feature differences (the paper's q_f).
const QF: f64 = 0.5;

/// The picture of the differences and its summary.
#[derive(Clone, Debug, PartialEq)]
pub struct FlipResult {
    /// Mean of `map`, the single figure the authors recommend.
    pub mean: f64,
    /// Error of each pixel, from 0 (no difference seen) to 1, in the order of the input.
    pub map: Vec<f32>,
}

/// Input that [`flip()`] cannot compare.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum FlipError {
    /// The pictures have no pixels.
    #[error("the pictures are empty; give at least one pixel")]
    Empty,
    /// The pictures differ in size.
    #[error("{test} test pixels for {reference} reference pixels; render both at one size")]
    LengthMismatch {
        /// Pixels of the reference picture.
        reference: usize,
        /// Pixels of the test picture.
        test: usize,
    },
    /// The pixels do not fill rows of the stated width.
    #[error("{pixels} pixels do not fill rows of {width}; give the width of the pictures")]
    Width {
        /// Pixels of each picture.
        pixels: usize,
        /// Stated width, pixels.
        width: usize,
    },
    /// A pixel is no sRGB colour.
    #[error(
        "{picture} pixel {index} is {value:?}, not within [0, 1]; tone-map and clamp before comparing"
    )]
    Pixel {
        /// Which picture, "reference" or "test".
        picture: &'static str,
        /// Index of the first such pixel.
        index: usize,
        /// Its value.
        value: [f32; 3],
    },
    /// The viewing condition is outside [`FLIP_PIXELS_PER_DEGREE_RANGE`].
    #[error(
        "{value} pixels per degree are not within [{}, {}]; a common screen has 67",
        FLIP_PIXELS_PER_DEGREE_RANGE.start(),
        FLIP_PIXELS_PER_DEGREE_RANGE.end()
    )]
    PixelsPerDegree {
        /// The value given.
        value: f64,
    },
}

/// Pixels per degree of visual angle in the middle of a screen `width` metres and `resolution` pixels
/// wide, seen from `distance` metres.
pub const fn pixels_per_degree(distance: f64, resolution: f64, width: f64) -> f64 {
    distance * (resolution / width) * (PI / 180.0)
}

/// Compares two pictures `width` pixels wide as an observer who flips between them would.
///
/// Pixels are sRGB-encoded in [0, 1], row by row. [`FLIP_PIXELS_PER_DEGREE`] is the usual viewing
/// condition; fewer pixels per degree mean a closer look, to which more shows. Exchanging the pictures
/// changes nothing.
///
/// Cost: 640 multiplications a pixel at 67 pixels per degree, growing with these; rows are worked in
/// parallel, and the result does not depend on the number of threads.
///
/// ```
/// use antumbra_reference::{FLIP_PIXELS_PER_DEGREE, flip};
///
/// let (grey, mut spot) = (vec![[0.5; 3]; 32 * 32], vec![[0.5; 3]; 32 * 32]);
/// spot[16 * 32 + 16] = [1.0; 3];
/// let difference = flip(&grey, &spot, 32, FLIP_PIXELS_PER_DEGREE)?;
/// assert!(difference.map[16 * 32 + 16] > 0.3 && difference.mean < 0.05);
/// # Ok::<(), antumbra_reference::FlipError>(())
/// ```
///
/// # Errors
/// Empty pictures, sizes that do not fit, values outside [0, 1] (non-finite ones among them), or
/// pixels per degree outside [`FLIP_PIXELS_PER_DEGREE_RANGE`].
pub fn flip(
    reference: &[[f32; 3]],
    test: &[[f32; 3]],
    width: usize,
    pixels_per_degree: f64,
) -> Result<FlipResult, FlipError> {
    validate(reference, test, width, pixels_per_degree)?;
    let reference = Percept::new(reference, width, pixels_per_degree);
    let test = Percept::new(test, width, pixels_per_degree);
    let largest = largest_distance();
    let map: Vec<f32> = (0..reference.colours.len())
        .into_par_iter()
        .map(|i| {
            let distance = hyab(reference.colours[i], test.colours[i]).powf(QC);
            let colour = redistribute(distance, largest);
            let edge = (reference.edges[i] - test.edges[i]).abs();
            let point = (reference.points[i] - test.points[i]).abs();
            let feature = (FRAC_1_SQRT_2 * edge.max(point)).powf(QF);
            colour.powf(1.0 - feature) as f32
        })
        .collect();
    let mean = map.iter().map(|&error| f64::from(error)).sum::<f64>() / map.len() as f64;
    Ok(FlipResult { mean, map })
}

fn validate(
    reference: &[[f32; 3]],
    test: &[[f32; 3]],
    width: usize,
    pixels_per_degree: f64,
) -> Result<(), FlipError> {
    let pixels = reference.len();
    if test.len() != pixels {
        return Err(FlipError::LengthMismatch { reference: pixels, test: test.len() });
    }
    if pixels == 0 {
        return Err(FlipError::Empty);
    }
    if width == 0 || !pixels.is_multiple_of(width) {
        return Err(FlipError::Width { pixels, width });
    }
    if !FLIP_PIXELS_PER_DEGREE_RANGE.contains(&pixels_per_degree) {
        return Err(FlipError::PixelsPerDegree { value: pixels_per_degree });
    }
    for (picture, image) in [("reference", reference), ("test", test)] {
        let fault = image.iter().position(|c| c.iter().any(|v| !(0.0..=1.0).contains(v)));
        if let Some(index) = fault {
            return Err(FlipError::Pixel { picture, index, value: image[index] });
        }
    }
    Ok(())
}

/// What a picture gives to see, pixel by pixel.
struct Percept {
    /// Colours that remain after the blur of the eye, L*a*b* with Hunt's effect.
    colours: Vec<DVec3>,
    /// Strength of edges.
    edges: Vec<f64>,
    /// Strength of points.
    points: Vec<f64>,
}

impl Percept {
    fn new(image: &[[f32; 3]], width: usize, pixels_per_degree: f64) -> Self {
        let xyz: Vec<DVec3> = image.par_iter().map(|&pixel| relative_xyz(linear(pixel))).collect();
        let plane = |f: fn(&DVec3) -> f64| xyz.iter().map(f).collect::<Vec<f64>>();
        let blur = |plane, terms| blur(plane, width, terms, pixels_per_degree);
        let y = blur(plane(|c| opponent(*c).x), ACHROMATIC);
        let cx = blur(plane(|c| opponent(*c).y), RED_GREEN);
        let cz = blur(plane(|c| opponent(*c).z), BLUE_YELLOW);
        let from_xyz = linear_from_relative_xyz();
        let colours = (0..image.len())
            .into_par_iter()
            .map(|i| {
                let visible = from_xyz * inverse_opponent(DVec3::new(y[i], cx[i], cz[i]));
                hunt(lab(relative_xyz(visible.clamp(DVec3::ZERO, DVec3::ONE))))
            })
            .collect();
        let luminance = plane(|c| c.y);
        let [gaussian, first, second] = detectors(pixels_per_degree);
        Self {
            colours,
            edges: feature(&luminance, width, &gaussian, &first),
            points: feature(&luminance, width, &gaussian, &second),
        }
    }
}

/// Decodes sRGB (IEC 61966-2-1).
fn linear(pixel: [f32; 3]) -> DVec3 {
    DVec3::from_array(pixel.map(|value| {
        let value = f64::from(value);
        if value <= 0.04045 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) }
    }))
}

/// XYZ of linear sRGB, from the primaries and white of the standard; the authors' rational numbers.
const XYZ_FROM_LINEAR: DMat3 = DMat3::from_cols(
    DVec3::new(10135552.0 / 24577794.0, 2613072.0 / 12288897.0, 1425312.0 / 73733382.0),
    DVec3::new(8788810.0 / 24577794.0, 8788810.0 / 12288897.0, 8788810.0 / 73733382.0),
    DVec3::new(4435075.0 / 24577794.0, 887015.0 / 12288897.0, 70074185.0 / 73733382.0),
);

/// XYZ as shares of the white's, which is (1, 1, 1) in linear sRGB.
fn relative_xyz(linear: DVec3) -> DVec3 {
    XYZ_FROM_LINEAR * linear / (XYZ_FROM_LINEAR * DVec3::ONE)
}

fn linear_from_relative_xyz() -> DMat3 {
    XYZ_FROM_LINEAR.inverse() * DMat3::from_diagonal(XYZ_FROM_LINEAR * DVec3::ONE)
}

/// YCxCz of a relative XYZ: as L*a*b*, but linear, so that blurring it blurs light.
fn opponent(xyz: DVec3) -> DVec3 {
    DVec3::new(116.0 * xyz.y - 16.0, 500.0 * (xyz.x - xyz.y), 200.0 * (xyz.y - xyz.z))
}

fn inverse_opponent(ycxcz: DVec3) -> DVec3 {
    let y = (ycxcz.x + 16.0) / 116.0;
    DVec3::new(y + ycxcz.y / 500.0, y, y - ycxcz.z / 200.0)
}

/// L*a*b* of a relative XYZ (CIE 1976).
fn lab(xyz: DVec3) -> DVec3 {
    const DELTA: f64 = 6.0 / 29.0;
    opponent(DVec3::from_array(xyz.to_array().map(|t| {
        if t > DELTA * DELTA * DELTA { t.cbrt() } else { t / (3.0 * DELTA * DELTA) + 4.0 / 29.0 }
    })))
}

/// Scales the chroma by the lightness: colours look more colourful in bright light (Hunt 1952).
fn hunt(lab: DVec3) -> DVec3 {
    lab * DVec3::new(1.0, 0.01 * lab.x, 0.01 * lab.x)
}

/// Distance for large colour differences (Abasi, Amani Tehran and Fairchild 2019).
fn hyab(a: DVec3, b: DVec3) -> f64 {
    let d = a - b;
    d.x.abs() + (d.y * d.y + d.z * d.z).sqrt()
}

/// Largest compressed distance of two sRGB colours: green to blue.
fn largest_distance() -> f64 {
    let seen = |linear| hunt(lab(relative_xyz(linear)));
    hyab(seen(DVec3::Y), seen(DVec3::Z)).powf(QC)
}

/// Maps compressed distances to [0, 1]: [0, PC largest] to [0, PT], the rest above.
fn redistribute(distance: f64, largest: f64) -> f64 {
    let knee = PC * largest;
    if distance < knee {
        distance * PT / knee
    } else {
        PT + (distance - knee) / (largest - knee) * (1.0 - PT)
    }
}

/// Blurs a channel by its contrast sensitivity, a sum of Gaussians normalised as a whole over a square
/// of three deviations of the widest.
fn blur(plane: Vec<f64>, width: usize, terms: &[Term], pixels_per_degree: f64) -> Vec<f64> {
    let radius = (3.0 * (WIDEST_B / (2.0 * PI * PI)).sqrt() * pixels_per_degree).ceil() as i32;
    let mut blurred = vec![0.0; plane.len()];
    let mut total = 0.0;
    for &(a, b) in terms {
        let degrees = |i| f64::from(i) / pixels_per_degree;
        let mut kernel: Vec<f64> =
            (-radius..=radius).map(|i| (-(PI * degrees(i)).powi(2) / b).exp()).collect();
        let sum: f64 = kernel.iter().sum();
        kernel.iter_mut().for_each(|k| *k /= sum);
        let weight = a * (PI / b).sqrt() * sum * sum;
        total += weight;
        let part = convolve(&plane, width, &kernel, &kernel);
        blurred.iter_mut().zip(part).for_each(|(all, part)| *all += weight * part);
    }
    blurred.iter_mut().for_each(|all| *all /= total);
    blurred
}

/// A Gaussian of deviation W/2 and its first and second derivative, over three deviations. The first
/// sums to 1, the others to 1 over their positive and to -1 over their negative weights.
fn detectors(pixels_per_degree: f64) -> [Vec<f64>; 3] {
    let deviation = 0.5 * W * pixels_per_degree;
    let radius = (3.0 * deviation).ceil() as i32;
    let sampled = |shape: &dyn Fn(f64) -> f64| {
        let gaussian = |x: f64| (-x * x / (2.0 * deviation * deviation)).exp();
        let kernel: Vec<f64> =
            (-radius..=radius).map(f64::from).map(|x| shape(x) * gaussian(x)).collect();
        let positive: f64 = kernel.iter().filter(|k| **k > 0.0).sum();
        let negative: f64 = -kernel.iter().filter(|k| **k < 0.0).sum::<f64>();
        let side = |k: f64| if k > 0.0 { positive } else { negative };
        kernel.iter().map(|&k| if k == 0.0 { 0.0 } else { k / side(k) }).collect()
    };
    [sampled(&|_| 1.0), sampled(&|x| -x), sampled(&|x| (x / deviation).powi(2) - 1.0)]
}

/// Length of the vector of a derivative along x and along y.
fn feature(luminance: &[f64], width: usize, gaussian: &[f64], derivative: &[f64]) -> Vec<f64> {
    let along_x = convolve(luminance, width, derivative, gaussian);
    let along_y = convolve(luminance, width, gaussian, derivative);
    along_x.iter().zip(along_y).map(|(x, y)| (x * x + y * y).sqrt()).collect()
}

/// Weighs the neighbours along the row by `across` and along the column by `down`, kernels of odd
/// length; the pixels of the border are repeated outwards. (A correlation: kernels are not mirrored,
/// which the length of a derivative does not notice.)
fn convolve(plane: &[f64], width: usize, across: &[f64], down: &[f64]) -> Vec<f64> {
    // Both passes add whole rows, tap by tap, which the compiler turns into vector instructions.
    fn accumulate(row: &mut [f64], weight: f64, source: &[f64]) {
        row.iter_mut().zip(source).for_each(|(sum, value)| *sum += weight * value);
    }
    let mut rows = vec![0.0; plane.len()];
    rows.par_chunks_mut(width).zip(plane.par_chunks(width)).for_each(|(row, source)| {
        let radius = across.len() / 2;
        let mut padded = vec![source[0]; radius];
        padded.extend_from_slice(source);
        padded.resize(width + 2 * radius, source[width - 1]);
        for (tap, &weight) in across.iter().enumerate() {
            accumulate(row, weight, &padded[tap..]);
        }
    });
    let mut sums = vec![0.0; plane.len()];
    sums.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
        let last = plane.len() / width - 1;
        for (tap, &weight) in down.iter().enumerate() {
            let from = (y + tap).saturating_sub(down.len() / 2).min(last) * width;
            accumulate(row, weight, &rows[from..from + width]);
        }
    });
    sums
}

//! The bounds of `shaders/filter` in f64: their truth in tests.
//!
//! A *window* is what a kernel sees: depths with weights that add to 1. Depths grow away from the light, in
//! [0, 1]; visibility is the weight of those at the receiver's depth or beyond. Every bound takes filtered
//! numbers, so that filtering first and last can be compared.

use crate::Footprint;

/// A depth and its weight.
pub type Window<'a> = &'a [(f64, f64)];

/// Weighted mean of `f` over a window.
#[must_use]
pub fn mean(window: Window<'_>, f: impl Fn(f64) -> f64) -> f64 {
    window.iter().map(|(z, weight)| weight * f(*z)).sum()
}

/// Percentage-closer filtering (Reeves, Salesin, Cook 1987): what all the others bound.
#[must_use]
pub fn pcf(window: Window<'_>, z: f64) -> f64 {
    mean(window, |depth| if depth >= z { 1.0 } else { 0.0 })
}

/// `chebyshev` of `filter/chebyshev.wesl`.
#[must_use]
pub fn chebyshev(mean: f64, square: f64, least: f64, z: f64) -> f64 {
    if z <= mean {
        return 1.0;
    }
    let variance = (square - mean * mean).max(least);
    variance / (variance + (z - mean).powi(2))
}

/// `cut_tail` of `filter/chebyshev.wesl`.
#[must_use]
pub fn cut_tail(visibility: f64, cut: f64) -> f64 {
    ((visibility - cut) / (1.0 - cut)).clamp(0.0, 1.0)
}

/// Variance shadow map with the least `deviation`, `filter/vsm.wesl`.
#[must_use]
pub fn vsm(window: Window<'_>, deviation: f64, z: f64) -> f64 {
    let (m1, m2) = (mean(window, |d| d - 0.5), mean(window, |d| (d - 0.5).powi(2)));
    chebyshev(m1, m2, deviation.powi(2), z - 0.5)
}

/// `layer_depth` of `filter/encoding/layered.wesl`.
#[must_use]
pub fn layer_depth(z: f64, [start, inverse]: [f64; 2]) -> f64 {
    ((z - start) * inverse).clamp(0.0, 1.0)
}

/// One slice of a layered variance shadow map, `filter/lvsm.wesl`; `z` lies in the slice.
#[must_use]
pub fn layer(window: Window<'_>, slice: [f64; 2], deviation: f64, z: f64) -> f64 {
    let warped: Vec<(f64, f64)> =
        window.iter().map(|(d, w)| (layer_depth(*d, slice), *w)).collect();
    vsm(&warped, deviation, layer_depth(z, slice))
}

/// Exponential shadow map of `sharpness` c, `filter/esm.wesl`, filtered in the logarithm.
#[must_use]
pub fn esm(window: Window<'_>, sharpness: f64, z: f64) -> f64 {
    (sharpness * (log_mean(window, sharpness) - z)).min(0.0).exp()
}

/// ln(E[exp(c z)]) / c, `gpu/mean/exponential.wesl`.
#[must_use]
pub fn log_mean(window: Window<'_>, c: f64) -> f64 {
    let largest = window.iter().map(|(z, _)| *z).fold(0.0, f64::max);
    largest + mean(window, |z| (c * (z - largest)).exp()).ln() / c
}

/// The bound of the first warp, exp(c x) with x = 2 z - 1, `filter/evsm.wesl`.
#[must_use]
pub fn positive_warp(window: Window<'_>, c: f64, deviation: f64, z: f64) -> f64 {
    let warp = |z: f64| (c * (2.0 * z - 1.0)).exp();
    warped(window, warp, c, deviation, z)
}

/// The bound of the second warp, -exp(-c x).
#[must_use]
pub fn negative_warp(window: Window<'_>, c: f64, deviation: f64, z: f64) -> f64 {
    let warp = |z: f64| -(-c * (2.0 * z - 1.0)).exp();
    warped(window, warp, c, deviation, z)
}

fn warped(window: Window<'_>, warp: impl Fn(f64) -> f64, c: f64, deviation: f64, z: f64) -> f64 {
    let w = warp(z);
    let least = (2.0 * c * deviation * w).powi(2);
    chebyshev(mean(window, &warp), mean(window, |z| warp(z).powi(2)), least, w)
}

/// Moments of signed depth 2 z - 1, `filter/encoding/moments.wesl`.
#[must_use]
pub fn moments(window: Window<'_>) -> [f64; 4] {
    [1, 2, 3, 4].map(|power| mean(window, |z| (2.0 * z - 1.0).powi(power)))
}

/// Moments with the share `bias` replaced by those of (0, target, 0, target), `filter/msm.wesl`.
#[must_use]
pub fn biased(b: [f64; 4], bias: f64, target: f64) -> [f64; 4] {
    biased_to(b, bias, [target, target])
}

/// As [`biased`], with a second and a fourth moment of their own.
#[must_use]
pub fn biased_to(b: [f64; 4], bias: f64, [second, fourth]: [f64; 2]) -> [f64; 4] {
    let towards = [0.0, second, 0.0, fourth];
    [0, 1, 2, 3].map(|i| (1.0 - bias) * b[i] + bias * towards[i])
}

/// `hamburger` of `filter/moment_bounds.wesl`: the least share nearer than signed depth `zf`.
#[must_use]
pub fn hamburger(b: [f64; 4], zf: f64) -> f64 {
    match other_nodes(b, zf) {
        None => two_moments(b, zf),
        Some(roots) => three_nodes(b, zf, roots),
    }
}

/// `hausdorff` of `filter/moment_bounds.wesl`: as [`hamburger`], of distributions within [-1, 1].
#[must_use]
pub fn hausdorff(b: [f64; 4], zf: f64) -> f64 {
    if zf <= -1.0 {
        return 0.0;
    }
    match other_nodes(b, zf) {
        Some([z2, z3]) if z2 >= -1.0 && z3 <= 1.0 => three_nodes(b, zf, [z2, z3]),
        _ => both_ends(b, zf),
    }
}

fn both_ends([b1, b2, b3, b4]: [f64; 4], zf: f64) -> f64 {
    let (mass, u1, u2) = ((1.0 - b2).max(SMALLEST), b1 - b3, b2 - b4);
    let mean = u1 / mass;
    let variance = ((u2 - u1 * mean) / mass).max(0.0);
    let d = zf - mean;
    let total = (variance + d * d).max(SMALLEST);
    let own = mass * variance / (total * (1.0 + zf));
    let room = if d > 0.0 { 1.0 - mean } else { 1.0 + mean };
    let free = mass * d.abs().powi(3) / (total * (room * d.abs() + variance).max(SMALLEST));
    0.5 * (1.0 - b1 - own + if d > 0.0 { free } else { -free })
}

const SMALLEST: f64 = 1e-30;

fn other_nodes([b1, b2, b3, b4]: [f64; 4], zf: f64) -> Option<[f64; 2]> {
    let d2 = (b2 - b1 * b1).max(SMALLEST);
    let l32d2 = b3 - b1 * b2;
    let d3d2 = ((b4 - b2 * b2) * d2 - l32d2 * l32d2).max(SMALLEST);
    let l32 = l32d2 / d2;
    let mut c1 = zf - b1;
    let c2 = (zf * zf - b2 - l32 * c1) * d2 / d3d2;
    c1 = c1 / d2 - l32 * c2;
    let c0 = 1.0 - c1 * b1 - c2 * b2;
    if c2.abs() * 1e9 <= c1.abs() + c0.abs() {
        return None;
    }
    let (p, q) = (c1 / c2, c0 / c2);
    let r = (0.25 * p * p - q).max(0.0).sqrt();
    Some([-0.5 * p - r, -0.5 * p + r])
}

fn three_nodes([b1, b2, ..]: [f64; 4], zf: f64, [z2, z3]: [f64; 2]) -> f64 {
    if zf <= z2 {
        0.0
    } else if zf <= z3 {
        (zf * z3 - b1 * (zf + z3) + b2) / ((z3 - z2) * (zf - z2))
    } else {
        1.0 - (z2 * z3 - b1 * (z2 + z3) + b2) / ((zf - z2) * (zf - z3))
    }
}

fn two_moments(b: [f64; 4], zf: f64) -> f64 {
    1.0 - chebyshev(b[0], b[1], 0.0, zf)
}

/// Moment shadow map, `filter/msm.wesl`.
#[must_use]
pub fn msm(window: Window<'_>, bias: f64, target: f64, z: f64) -> f64 {
    let hidden = hamburger(biased(moments(window), bias, target), 2.0 * z - 1.0);
    1.0 - ((hidden - bias) / (1.0 - bias)).clamp(0.0, 1.0)
}

/// The affine map of moments of signed depth to [0, 1]^4, `filter/encoding/moments_16.wesl` (Peters et al.
/// 2017).
#[must_use]
pub fn encode_16([m1, m2, m3, m4]: [f64; 4]) -> [f64; 4] {
    let root = 3f64.sqrt();
    [
        1.5 * m1 - 2.0 * m3 + 0.5,
        4.0 * (m2 - m4),
        0.5 * root * m1 - 2.0 / 9.0 * root * m3 + 0.5,
        0.5 * (m2 + m4),
    ]
}

/// The inverse of [`encode_16`].
#[must_use]
pub fn decode_16([q1, q2, q3, q4]: [f64; 4]) -> [f64; 4] {
    let (a, d, root) = (q1 - 0.5, q3 - 0.5, 3f64.sqrt());
    [-a / 3.0 + root * d, 0.125 * q2 + q4, -0.75 * a + 0.75 * root * d, q4 - 0.125 * q2]
}

/// Weights of the texels along an axis under a box from `first` to `last` (continuous texel coordinates, at least 1
/// apart), each by its part inside: the first texel and the weights from it on, which add to 1. A window of a summed-area
/// table, `gpu/sat_window.wesl`.
#[must_use]
pub fn coverage(first: f64, last: f64) -> (i64, Vec<f64>) {
    let begin = first.floor();
    let count = (last.ceil() - begin) as usize;
    let weight = |k: usize| {
        let at = begin + k as f64;
        (last.min(at + 1.0) - first.max(at)) / (last - first)
    };
    (begin as i64, (0..count).map(weight).collect())
}

/// Bound on the root mean square distance, from the middle of a box of half side `half`, of the centres of the texels
/// under it, an axis: that of the box itself, and the half texel between a point and the centre of its texel.
#[must_use]
pub fn coverage_spread(half: f64) -> f64 {
    half / 3f64.sqrt() + 0.5
}

/// Lookups in a mipmap over a pixel's footprint, `filter/mipmapped.wesl`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Probe {
    /// From one lookup to the next, texels.
    pub step: [f64; 2],
    /// Lookups in a row.
    pub count: u32,
    /// The level that is read, between two of them: the finer where it is whole.
    pub level: f64,
}

impl Probe {
    /// For a footprint whose sides are `sides`, texels, in an image of `size` texels a side.
    #[must_use]
    pub fn new(sides: [[f64; 2]; 2], footprint: Footprint, size: u32) -> Self {
        let [a, b] = sides.map(|[x, y]| x.hypot(y));
        let (along, longer) = if a >= b { (sides[0], a) } else { (sides[1], b) };
        let most = longer.min(footprint.largest.into());
        let count = (most / a.min(b).max(1.0)).ceil().clamp(1.0, footprint.lookups.into());
        let levels = footprint.largest.ilog2().min(size.trailing_zeros());
        let level = (most / count).max(1.0).log2().clamp(0.0, levels.into());
        let step = along.map(|c| c * most / longer.max(1.0) / count);
        Self { step, count: count as u32, level }
    }

    /// Texels of the image and their weights, which add to 1, of the lookup at `texel` (continuous texel coordinates). The
    /// image goes on beyond its border.
    #[must_use]
    pub fn weights(&self, texel: [f64; 2]) -> Vec<([i64; 2], f64)> {
        let coarser = self.level.fract();
        let mut all = Vec::new();
        for i in 0..self.count {
            let from_middle = f64::from(i) - 0.5 * f64::from(self.count - 1);
            let at = [0, 1].map(|axis| texel[axis] + from_middle * self.step[axis]);
            for (level, share) in
                [(self.level as i32, 1.0 - coarser), (self.level as i32 + 1, coarser)]
            {
                if share > 0.0 {
                    all.extend(level_weights(at, level, share / f64::from(self.count)));
                }
            }
        }
        all
    }
}

/// Texels of the image under a bilinear lookup at `texel` in a level, and their weights, which add to `share`.
fn level_weights(texel: [f64; 2], level: i32, share: f64) -> impl Iterator<Item = ([i64; 2], f64)> {
    let side = 2f64.powi(level);
    let axis = |t: f64| {
        let first = (t / side - 0.5).floor();
        let fraction = t / side - 0.5 - first;
        let span = side as i64;
        // Two texels of the level, each of `side` texels of the image.
        (0..2 * span).map(move |k| {
            let weight = if k < span { 1.0 - fraction } else { fraction };
            (first as i64 * span + k, weight / side)
        })
    };
    let columns: Vec<_> = axis(texel[0]).collect();
    axis(texel[1]).flat_map(move |(y, b)| {
        let row: Vec<_> = columns.iter().map(|(x, a)| ([*x, y], a * b * share)).collect();
        row
    })
}

/// The step as a series of `order` waves of period 2, `filter/fourier.wesl`: 0 where `t` < 0, 1 where it is > 0, and 1/2
/// between (Annen et al. 2007); coefficients are multiplied by exp(-`damping` (k / order)²).
#[must_use]
pub fn fourier_step(t: f64, order: u32, damping: f64) -> f64 {
    let terms = (1..=order).map(|k| {
        let c = std::f64::consts::PI * (2.0 * f64::from(k) - 1.0);
        let share = f64::from(k) / f64::from(order);
        (c * t).sin() / c * (-damping * share * share).exp()
    });
    0.5 + 2.0 * terms.sum::<f64>()
}

/// Settings of a convolution shadow map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Waves {
    /// Number of waves.
    pub order: u32,
    /// Damping of the coefficients.
    pub damping: f64,
    /// Room between the two ends of the range, shares of it.
    pub margin: f64,
    /// Share of the range by which the receiver is moved towards the light.
    pub offset: f64,
    /// Factor on the series.
    pub scale: f64,
}

/// Convolution shadow map, `filter/convolution.wesl`: the waves filtered first, then put together.
#[must_use]
pub fn convolution(window: Window<'_>, waves: &Waves, z: f64) -> f64 {
    let squeeze = (1.0 + waves.margin).recip();
    let own = squeeze * (z - waves.offset);
    let terms = (1..=waves.order).map(|k| {
        let c = std::f64::consts::PI * (2.0 * f64::from(k) - 1.0);
        let share = f64::from(k) / f64::from(waves.order);
        let sine = mean(window, |z| (c * squeeze * z).sin());
        let cosine = mean(window, |z| (c * squeeze * z).cos());
        let damped = 2.0 / c * (-waves.damping * share * share).exp();
        damped * ((c * own).cos() * sine - (c * own).sin() * cosine)
    });
    (waves.scale * (0.5 + terms.sum::<f64>())).clamp(0.0, 1.0)
}

/// Exponentials cut off at 1 one by one, what `filter/esm_fallback.wesl` falls back to.
#[must_use]
pub fn clamped_esm(window: Window<'_>, sharpness: f64, z: f64) -> f64 {
    mean(window, |depth| (sharpness * (depth - z)).min(0.0).exp())
}

/// The least and the largest depth of a window, compared, `filter/multiple_depth.wesl`; with `own`, a third between them.
#[must_use]
pub fn multiple_depth(window: Window<'_>, own: Option<f64>, z: f64) -> f64 {
    let ends = window.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(least, most), (d, _)| {
        (least.min(*d), most.max(*d))
    });
    let depths: Vec<f64> = [ends.0, ends.1].into_iter().chain(own).collect();
    depths.iter().filter(|depth| **depth >= z).count() as f64 / depths.len() as f64
}

/// Blurred depth, compared, `filter/blurred_depth.wesl`.
#[must_use]
pub fn blurred_depth(window: Window<'_>, z: f64) -> f64 {
    if mean(window, |depth| depth) >= z { 1.0 } else { 0.0 }
}

/// Blurred depth, compared softly over `width`, `filter/soft_comparison.wesl`.
#[must_use]
pub fn soft_comparison(window: Window<'_>, width: f64, z: f64) -> f64 {
    let x = ((mean(window, |depth| depth) - z) / width + 1.0).clamp(0.0, 1.0);
    x * x * (3.0 - 2.0 * x)
}

/// The distribution P(x) = (x / b)^q on [0, b] with a mean above 0 and a variance: q and b, `filter/power_function.wesl`.
#[must_use]
pub fn power_fit(mean: f64, variance: f64) -> [f64; 2] {
    let k = mean * mean / variance;
    let q = k / ((1.0 + k).sqrt() + 1.0);
    [q, mean + mean / q]
}

/// Depths as if they were so distributed from `before` the range on: the share beyond the receiver of what lies at the
/// mean or beyond, `filter/power_function.wesl`.
#[must_use]
pub fn power_function(window: Window<'_>, deviation: f64, before: f64, z: f64) -> f64 {
    let (m1, m2) = (mean(window, |d| d - 0.5), mean(window, |d| (d - 0.5).powi(2)));
    let (middle, z) = (m1 + 0.5 + before, z + before);
    let [q, b] = power_fit(middle, (m2 - m1 * m1).max(deviation.powi(2)));
    if z <= middle {
        1.0
    } else if z >= b {
        0.0
    } else {
        (1.0 - (z / b).powf(q)) / (1.0 - (middle / b).powf(q))
    }
}

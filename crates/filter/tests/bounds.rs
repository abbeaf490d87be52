//! The bounds in exact arithmetic: what they bound, how far they leak, and the published numbers.
//!
//! "Exact" is f64. A variance is then off by some 1e-16, which Chebyshev's bound divides by v + d²; a Hankel
//! matrix whose least eigenvalue is e loses 1e-16 / e. Tolerances say which.

use antumbra_filter::twin::{
    Waves, biased, blurred_depth, chebyshev, clamped_esm, convolution, coverage, coverage_spread,
    cut_tail, decode_16, encode_16, esm, fourier_step, hamburger, layer, log_mean, mean, moments,
    msm, multiple_depth, negative_warp, pcf, positive_warp, soft_comparison, vsm,
};

/// SplitMix64 (Steele, Lea, Flood 2014), as numbers in [0, 1).
struct Random(u64);

impl Random {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 * 0.5f64.powi(53)
    }

    fn below(&mut self, count: usize) -> usize {
        (self.next() * count as f64) as usize
    }

    /// 1 to `most` depths with weights that add to 1: spread out, in clusters, or at the ends of the range.
    fn window(&mut self, most: usize) -> Vec<(f64, f64)> {
        let count = 1 + self.below(most);
        let kind = self.below(3);
        let centers = [self.next(), self.next()];
        let width = 10f64.powf(-4.0 * self.next());
        let mut window: Vec<(f64, f64)> = (0..count)
            .map(|i| {
                let depth = match kind {
                    0 => self.next(),
                    1 => (centers[i % 2] + width * (self.next() - 0.5)).clamp(0.0, 1.0),
                    _ => [0.0, 1.0, centers[0], centers[1]][i % 4],
                };
                (depth, if self.below(3) == 0 { 1.0 } else { self.next() + 1e-3 })
            })
            .collect();
        let sum: f64 = window.iter().map(|(_, w)| w).sum();
        window.iter_mut().for_each(|(_, w)| *w /= sum);
        window
    }

    /// A receiver anywhere, or close to one of the window's depths.
    fn receiver(&mut self, window: &[(f64, f64)]) -> f64 {
        if self.below(2) == 0 {
            return self.next();
        }
        let (depth, _) = window[self.below(window.len())];
        (depth + 10f64.powf(-4.0 * self.next()) * (self.next() - 0.3)).clamp(0.0, 1.0)
    }
}

const DEVIATION: f64 = 1e-3;

/// Every bound with its published settings, and what f64 rounds off it.
fn bounds(window: &[(f64, f64)], z: f64) -> Vec<(&'static str, f64, f64)> {
    let (positive, negative) =
        (positive_warp(window, 40.0, 5e-5, z), negative_warp(window, 5.0, 5e-5, z));
    // Least v + d²: the floor's variance. A warped floor is (2 c b)² of W²; c+ = 40, b = 5e-5: 1.6e-5.
    let bias = |alpha: f64| 1e-14 / alpha;
    vec![
        ("vsm", vsm(window, DEVIATION, z), 1e-15 / DEVIATION.powi(2)),
        ("esm", esm(window, 80.0, z), 1e-12),
        ("evsm, first warp", positive, 1e-10),
        // c- = 5, b = 5e-5: (2 c b)² = 2.5e-7.
        ("evsm", positive.min(negative), 1e-8),
        ("msm", msm(window, 1e-6, 0.375, z), bias(1e-6)),
        ("msm, 16 bits", msm(window, 6e-5, 0.628, z), bias(6e-5)),
    ]
}

#[test]
fn no_bound_is_below_percentage_closer_filtering() {
    let mut random = Random(4);
    let mut leaks = 0;
    for _ in 0..200_000 {
        let window = random.window(8);
        let z = random.receiver(&window);
        let truth = pcf(&window, z);
        for (name, v, rounding) in bounds(&window, z) {
            assert!((0.0..=1.0).contains(&v), "{name} {v} on {window:?} at {z}");
            assert!(v >= truth - rounding, "{name} {v} < {truth} on {window:?} at {z}");
            leaks += usize::from(v > truth + 0.01);
        }
    }
    assert!(leaks > 100_000, "windows so simple that the bounds are exact: {leaks} leaks");
}

#[test]
fn a_tail_cut_falls_below_and_that_is_noticed() {
    let mut random = Random(5);
    let below = (0..10_000).filter(|_| {
        let window = random.window(8);
        let z = random.receiver(&window);
        cut_tail(vsm(&window, DEVIATION, z), 0.2) < pcf(&window, z) - 0.01
    });
    assert!(below.count() > 500, "bleeding reduction keeps the bound?");
    // Half in shadow, exactly: (1/2 - e) / (1 - e) is left of it.
    let half = [(0.3, 0.5), (0.7, 0.5)];
    assert!((cut_tail(vsm(&half, 0.0, 0.7), 0.2) - 0.375).abs() < 1e-12, "the cut of one half");
    assert_eq!(cut_tail(0.3, 0.0), 0.3, "no cut");
}

#[test]
fn four_moments_bound_more_sharply_than_two() {
    let mut random = Random(6);
    let (mut total, mut sharper) = (0, 0);
    while total < 100_000 {
        // Apart by 0.05 and heavy by 0.05, so that the Hankel matrix is far from singular in f64.
        let count = 3 + random.below(3);
        let mut depths: Vec<f64> = (0..count).map(|_| random.next()).collect();
        depths.sort_by(f64::total_cmp);
        if depths.windows(2).any(|p| p[1] - p[0] < 0.05) {
            continue;
        }
        let weights: Vec<f64> = depths.iter().map(|_| 0.05 + random.next()).collect();
        let sum: f64 = weights.iter().sum();
        let window: Vec<(f64, f64)> =
            depths.into_iter().zip(weights.into_iter().map(|w| w / sum)).collect();
        let z = random.next();
        if window.iter().any(|(d, _)| (d - z).abs() < 1e-3) {
            continue;
        }
        total += 1;
        let b = moments(&window);
        let two = 1.0 - chebyshev(b[0], b[1], 0.0, 2.0 * z - 1.0);
        let four = hamburger(b, 2.0 * z - 1.0);
        let truth = 1.0 - pcf(&window, z);
        let chain = [two, four, truth];
        let ordered = chain.windows(2).all(|p| p[0] <= p[1] + 1e-6);
        assert!(ordered, "{chain:?} on {window:?} at {z}");
        sharper += usize::from(four > two + 0.01);
    }
    assert!(2 * sharper > total, "sharper by a hundredth in {sharper} of {total} windows");
}

/// Depths 0.2 and 0.6, or 0.2, 0.4 and 0.6, of equal weight, all before the receiver: the truth is 0.
const TWO: [(f64, f64); 2] = [(0.2, 0.5), (0.6, 0.5)];
const THREE: [(f64, f64); 3] = [(0.2, 1.0 / 3.0), (0.4, 1.0 / 3.0), (0.6, 1.0 / 3.0)];

fn close(found: f64, expected: f64, digits: f64, what: &str) {
    assert!(
        (found - expected).abs() <= digits * expected.abs() + 1e-9,
        "{what}: {found}, not {expected}"
    );
}

#[test]
fn two_layers_leak_as_computed() {
    // In multi-precision: receiver, variance, both warps (40 and 5), exponential (80).
    for (z, variance, first, second, exponential) in [
        (0.61, 0.475624, 0.0774595, 0.498228, 0.224664),
        (0.65, 0.390244, 8.54e-5, 0.492713, 0.00915782),
        (0.70, 0.307692, 2.81e-8, 0.488345, 1.677e-4),
        (0.80, 0.2, 3.2e-15, 0.484128, 5.6e-8),
        (0.95, 0.116788, 1.2e-25, 0.482233, 3.5e-13),
    ] {
        let what = format!("receiver at {z}");
        close(vsm(&TWO, 0.0, z), variance, 5e-6, &what);
        close(positive_warp(&TWO, 40.0, 0.0, z), first, 0.02, &what);
        close(negative_warp(&TWO, 5.0, 0.0, z), second, 5e-6, &what);
        close(esm(&TWO, 80.0, z), exponential, 0.02, &what);
        // Two depths are exact; a bias of 1e-9, which keeps the matrix regular, leaks 1e-9 times the range's
        // square by the gap's, 4e-4 of it at least.
        let four = msm(&TWO, 1e-9, 0.375, z);
        assert!(four < 1e-5, "{what}: {four}");
    }
}

#[test]
fn three_layers_leak_as_computed() {
    for (z, variance, warped, exponential, exact, signed) in [
        (0.61, 0.376825, 0.0584384, 0.149776, 0.285020, 0.285027),
        (0.65, 0.299065, 7.55e-5, 0.00610521, 0.143780, 0.143786),
        (0.70, 0.228571, 2.50e-8, 1.118e-4, 0.0638723, 0.0638760),
        (0.80, 0.142857, 2.8e-15, 3.8e-8, 0.0175439, 0.0175450),
    ] {
        let what = format!("receiver at {z}");
        close(vsm(&THREE, 0.0, z), variance, 5e-6, &what);
        let evsm = positive_warp(&THREE, 40.0, 0.0, z).min(negative_warp(&THREE, 5.0, 0.0, z));
        close(evsm, warped, 0.02, &what);
        close(esm(&THREE, 80.0, z), exponential, 0.02, &what);
        let lit = |bias: f64| 1.0 - hamburger(biased(moments(&THREE), bias, 0.375), 2.0 * z - 1.0);
        close(lit(0.0), exact, 5e-6, &what);
        close(lit(1e-6), signed, 5e-6, &what);
    }
}

#[test]
fn contact_leaks_as_computed() {
    // One caster at 0.5 covers all; the receiver is g behind.
    for (g, variance, warped, exponential, float, short) in [
        (0.0003, 0.917, 0.0270, 0.976, 0.510, 0.991),
        (0.001, 0.5, 0.00247, 0.923, 0.0857, 0.904),
        (0.003, 0.1, 2.7e-4, 0.787, 0.0103, 0.511),
        (0.01, 0.0099, 2.3e-5, 0.449, 9.4e-4, 0.0861),
        (0.03, 0.0011, 2e-6, 0.0907, 1.0e-4, 0.0103),
        (0.1, 1e-4, 8e-8, 3.4e-4, 9.0e-6, 9.1e-4),
    ] {
        let (window, z) = ([(0.5, 1.0)], 0.5 + g);
        let what = format!("a gap of {g}");
        close(vsm(&window, 1e-3, z), variance, 0.02, &what);
        let evsm = positive_warp(&window, 40.0, 5e-5, z).min(negative_warp(&window, 5.0, 5e-5, z));
        close(evsm, warped, 0.05, &what);
        close(esm(&window, 80.0, z), exponential, 0.02, &what);
        let lit = |bias: f64, target: f64| {
            1.0 - hamburger(biased(moments(&window), bias, target), 2.0 * z - 1.0)
        };
        close(lit(1e-6, 0.375), float, 0.05, &what);
        close(lit(6e-5, 0.628), short, 0.03, &what);
    }
}

#[test]
fn the_worst_variance_leak_is_one_over_1_plus_2r_squared() {
    // Near caster at a with weight f, far caster b over everything, receiver c: r = (c - b) / (b - a).
    for (a, b, c) in [(0.2, 0.6, 0.64), (0.2, 0.6, 0.7), (0.2, 0.6, 0.8), (0.1, 0.5, 0.9)] {
        let r: f64 = (c - b) / (b - a);
        let leak = |f: f64| vsm(&[(a, f), (b, 1.0 - f)], 0.0, c);
        let closed = |f: f64| f * (1.0 - f) / (f * (1.0 - f) + (r + f).powi(2));
        let mut worst = 0.0;
        for step in 1..1000 {
            let f = f64::from(step) / 1000.0;
            assert!((leak(f) - closed(f)).abs() < 1e-12, "f = {f}, r = {r}");
            worst = f64::max(worst, leak(f));
        }
        let expected = (1.0 + 2.0 * r).powi(-2);
        assert!((leak(r / (1.0 + 2.0 * r)) - expected).abs() < 1e-12, "where it is worst, r = {r}");
        assert!(worst <= expected + 1e-12 && worst > expected - 1e-4, "r = {r}: {worst}");
        // A cut there removes it, just below it does not.
        let at = leak(r / (1.0 + 2.0 * r));
        assert!(cut_tail(at, expected + 1e-9) == 0.0 && cut_tail(at, expected - 1e-3) > 0.0, "cut");
    }
}

#[test]
fn a_flat_caster_over_a_parallel_receiver_is_exact() {
    for step in 1..20 {
        let f = f64::from(step) / 20.0;
        let window = [(0.3, f), (0.7, 1.0 - f)];
        close(vsm(&window, 0.0, 0.7), 1.0 - f, 1e-12, "vsm");
        close(positive_warp(&window, 40.0, 0.0, 0.7), 1.0 - f, 1e-9, "first warp");
        close(negative_warp(&window, 5.0, 0.0, 0.7), 1.0 - f, 1e-9, "second warp");
        let four = 1.0 - hamburger(biased(moments(&window), 1e-9, 0.375), 0.4);
        close(four, 1.0 - f, 1e-5, "msm");
        // ESM: + f exp(-c gap), which is 1e-14 here.
        close(esm(&window, 80.0, 0.7), 1.0 - f + f * (-80.0f64 * 0.4).exp(), 1e-12, "esm");
    }
}

#[test]
fn a_receiver_that_is_not_in_the_map_leaks_as_computed() {
    // Caster at 0.3 with weight f, nothing behind it but the far end, receiver at 0.7.
    let window = |f: f64| [(0.3, f), (1.0, 1.0 - f)];
    assert_eq!(vsm(&window(3.0 / 7.0 - 1e-9), 0.0, 0.7), 1.0, "up to 3/7 all is lit");
    close(vsm(&window(0.6), 0.0, 0.7), 0.891, 1e-3, "vsm, 0.4 in truth");
    assert_eq!(esm(&window(0.99), 80.0, 0.7), 1.0, "esm");
    let four = 1.0 - hamburger(biased(moments(&window(0.6)), 1e-9, 0.375), 0.4);
    close(four, 0.4, 1e-5, "two depths are exact for four moments");
}

#[test]
fn a_cliff_behind_the_receiver_leaks_as_computed() {
    // In the dark at 0.7 under a slab at 0.3, with 21 % of the kernel over a cliff at 0.95.
    let window = [(0.3, 0.79), (0.95, 0.21)];
    close(pcf(&window, 0.7), 0.21, 1e-12, "pcf");
    close(1.0 - hamburger(biased(moments(&window), 1e-9, 0.375), 0.4), 0.21, 1e-4, "msm");
    close(vsm(&window, 0.0, 0.7), 0.502, 2e-3, "vsm");
    assert_eq!(esm(&window, 80.0, 0.7), 1.0, "esm");
    let (first, second) =
        (positive_warp(&window, 40.0, 0.0, 0.7), negative_warp(&window, 5.0, 0.0, 0.7));
    assert_eq!(first, 1.0, "the first warp alone is lost");
    close(second, 0.217, 5e-3, "the second saves it");
}

#[test]
fn a_sloped_receiver_without_bias_loses_five_eighteenths() {
    // Depths even over [z - h, z + h]: variance sees nothing, four moments hide 5/18, whatever h.
    for h in [0.05, 0.1, 0.2] {
        let n = 4000;
        let depth = |i: i32| 0.5 + h * (2.0 * (f64::from(i) + 0.5) / f64::from(n) - 1.0);
        let window: Vec<(f64, f64)> = (0..n).map(|i| (depth(i), 1.0 / f64::from(n))).collect();
        close(vsm(&window, 0.0, 0.5 - 1e-12), 1.0, 1e-9, "vsm");
        let hidden = hamburger(moments(&window), 0.0);
        close(hidden, 5.0 / 18.0, 1e-3, "msm");
    }
}

#[test]
fn visibility_does_not_grow_with_the_receivers_depth() {
    let mut random = Random(7);
    for _ in 0..2000 {
        let window = random.window(6);
        let mut before: Option<Vec<(&str, f64, f64)>> = None;
        for step in 0..=50 {
            let now = bounds(&window, f64::from(step) / 50.0);
            for (a, b) in before.iter().flatten().zip(&now) {
                assert!(b.1 <= a.1 + a.2 + 1e-9, "{} rises on {window:?} at {step}", a.0);
            }
            before = Some(now);
        }
    }
}

#[test]
fn a_warp_without_curvature_is_plain_variance() {
    let window = [(0.2, 0.3), (0.5, 0.3), (0.8, 0.4)];
    let flat = positive_warp(&window, 0.01, 0.0, 0.85);
    assert!((flat - vsm(&window, 0.0, 0.85)).abs() < 0.01, "{flat}");
}

#[test]
fn the_16_bit_map_of_moments_fills_the_unit_cube_and_is_undone() {
    let mut random = Random(8);
    let (mut least, mut most) = ([1.0f64; 4], [0.0f64; 4]);
    for _ in 0..20_000 {
        let window = random.window(6);
        let b = moments(&window);
        let q = encode_16(b);
        let rest =
            least.iter_mut().zip(&mut most).zip(q.into_iter().zip(b.into_iter().zip(decode_16(q))));
        for ((least, most), (q, (b, back))) in rest {
            assert!((-1e-12..=1.0 + 1e-12).contains(&q), "channel {q} of {window:?}");
            (*least, *most) = (least.min(q), most.max(q));
            assert!((back - b).abs() < 1e-14, "round trip of {b}: {back}");
        }
    }
    for (least, most) in least.iter().zip(&most) {
        assert!(most - least > 0.9, "a channel spans {least} to {most}");
    }
    // The mistake of ports: the matrix of odd moments transposed (1.5, -2; 0.866, -0.385).
    let [m1, _, m3, _] = moments(&[(0.9, 1.0)]);
    let wrong = -2.0 * m1 - 2.0 / 9.0 * 3f64.sqrt() * m3 + 0.5;
    assert!(!(0.0..=1.0).contains(&wrong), "transposed: {wrong}");
}

#[test]
fn weights_are_a_measure() {
    // A doubled weight is a sample twice.
    let once = [(0.2, 2.0 / 3.0), (0.7, 1.0 / 3.0)];
    let twice = [(0.2, 1.0 / 3.0), (0.2, 1.0 / 3.0), (0.7, 1.0 / 3.0)];
    assert_eq!(mean(&once, |z| z), mean(&twice, |z| z), "means");
    for (a, b) in bounds(&once, 0.6).iter().zip(bounds(&twice, 0.6)) {
        assert!((a.1 - b.1).abs() < 1e-9, "{}: {} and {}", a.0, a.1, b.1);
    }
}

#[test]
fn a_layer_leaks_only_between_the_casters_in_it() {
    let slice = |from: f64, to: f64| [from, (to - from).recip()];
    // Near caster 0.2 with the weight f, far caster 0.6, receiver 0.7.
    let worst = |slice: [f64; 2], deviation: f64| {
        let leaks = (1..1000).map(|i| {
            let f = f64::from(i) / 1000.0;
            layer(&[(0.2, f), (0.6, 1.0 - f)], slice, deviation, 0.7)
        });
        leaks.fold(0.0, f64::max)
    };
    assert!((worst(slice(0.0, 1.0), 0.0) - 1.0 / 2.25).abs() < 1e-4, "all in one layer: r = 1/4");
    // A bound at 0.4 moves the near caster there: r = 1/2.
    assert!((worst(slice(0.4, 1.0), 0.0) - 0.25).abs() < 1e-4, "the near caster before the layer");
    // A bound between far caster and receiver leaves what the least deviation leaks, 0.05 of 0.35 away.
    let apart = worst(slice(0.65, 1.0), 1e-3);
    let expected = 1e-6 / (1e-6 + (0.05f64 / 0.35).powi(2));
    assert!((apart - expected).abs() < 1e-9, "{apart}, not {expected}");
    // One layer is a variance shadow map, and a layer never falls below the comparisons.
    let mut random = Random(10);
    for _ in 0..50_000 {
        let window = random.window(8);
        let z = random.receiver(&window);
        let whole = layer(&window, slice(0.0, 1.0), 1e-3, z);
        assert_eq!(whole, vsm(&window, 1e-3, z), "one layer on {window:?} at {z}");
        let from = z * random.next();
        let to = z + (1.0 - z) * random.next();
        if to - from > 1e-3 {
            let v = layer(&window, slice(from, to), 1e-3, z);
            assert!(v >= pcf(&window, z) - 1e-9, "{v} on {window:?} at {z} in {from} to {to}");
        }
    }
}

#[test]
fn a_window_of_a_table_is_a_measure_about_where_it_is_said_to_be() {
    let mut random = Random(11);
    for _ in 0..20_000 {
        let half = 0.5 + 15.0 * random.next();
        let center = 40.0 * random.next();
        let (begin, weights) = coverage(center - half, center + half);
        let sum: f64 = weights.iter().sum();
        assert!((sum - 1.0).abs() < 1e-12 && weights.iter().all(|w| *w >= 0.0), "{weights:?}");
        let square: f64 = weights
            .iter()
            .enumerate()
            .map(|(k, w)| w * (begin as f64 + k as f64 + 0.5 - center).powi(2))
            .sum();
        let bound = coverage_spread(half);
        assert!(square.sqrt() <= bound, "{} at {center} +- {half}, not {bound}", square.sqrt());
    }
    // 2 radius + 1 texels are the grid of as many bilinear taps.
    let (begin, weights) = coverage(7.3 - 2.5, 7.3 + 2.5);
    assert_eq!(begin, 4, "the first texel");
    for (weight, expected) in weights.iter().zip([0.04, 0.2, 0.2, 0.2, 0.2, 0.16]) {
        assert!((weight - expected).abs() < 1e-12, "{weights:?}");
    }
}

#[test]
fn variance_of_any_window_of_a_table_of_integers_is_a_bound() {
    let mut random = Random(12);
    let side = 24usize;
    let mut leaks = 0;
    for round in 0..400 {
        let kind = random.below(2);
        let levels = [random.next(), random.next(), random.next()];
        let depths: Vec<f64> = (0..side * side)
            .map(|_| if kind == 0 { random.next() } else { levels[random.below(3)] })
            .collect();
        for _ in 0..20 {
            let mut edges = || {
                let length = 1.0 + (side as f64 - 2.0) * random.next();
                let first = (side as f64 - length) * random.next();
                coverage(first, first + length)
            };
            let ((x, across), (y, down)) = (edges(), edges());
            let mut window = Vec::new();
            for (j, v) in down.iter().enumerate() {
                for (i, u) in across.iter().enumerate() {
                    let at = (y as usize + j) * side + x as usize + i;
                    window.extend(depths.get(at).map(|z| (*z, u * v)));
                }
            }
            let z = random.receiver(&window);
            let truth = pcf(&window, z);
            let exact = vsm(&window, DEVIATION, z);
            assert!(exact >= truth - 1e-9, "{exact} < {truth} in round {round}");
            leaks += usize::from(exact > truth + 0.01);
            // Depth and the square of signed depth at so many bits: a mean is off by half a step, a variance by 5/8 of one.
            for bits in [12, 16, 20, 24] {
                let scale = f64::from((1u32 << bits) - 1);
                let fixed = |v: f64| (v * scale).round() / scale;
                let m1 = mean(&window, fixed) - 0.5;
                let m2 = 0.25 * mean(&window, |z| fixed((2.0 * z - 1.0).powi(2)));
                let (e1, e2) = (mean(&window, |z| z) - 0.5, mean(&window, |z| (z - 0.5).powi(2)));
                assert!((m1 - e1).abs() <= 0.5 / scale + 1e-15, "{bits} bits: the mean");
                let off = ((m2 - m1 * m1) - (e2 - e1 * e1)).abs();
                assert!(off <= 0.625 / scale + 1e-14, "{bits} bits: a variance is off by {off}");
                // With the receiver moved by the mean's error, the bound holds but for the variance's over the least.
                let v = chebyshev(m1, m2, DEVIATION.powi(2), z - 0.5 - 0.5 / scale);
                let allowed = 0.625 / scale / DEVIATION.powi(2) + 1e-9;
                assert!(v >= truth - allowed, "{bits} bits: {v} < {truth}");
            }
        }
    }
    assert!(leaks > 1000, "windows so simple that the bound is exact: {leaks} leaks");
}

/// Waves as published first: all of the period, no scale, no offset.
fn plain_waves(order: u32, damping: f64) -> Waves {
    Waves { order, damping, margin: 0.0, offset: 0.0, scale: 1.0 }
}

#[test]
fn waves_filter_first_or_last_and_ring() {
    let mut random = Random(13);
    for _ in 0..2000 {
        let window = random.window(6);
        let z = random.next();
        for order in [4, 16] {
            let waves = plain_waves(order, 1.0);
            let last = mean(&window, |depth| fourier_step(depth - z, order, 1.0));
            let first = convolution(&window, &waves, z);
            assert!((first - last.clamp(0.0, 1.0)).abs() < 1e-12, "{first}, not {last}");
        }
    }
    for order in [4u32, 8, 16] {
        let m = f64::from(order);
        assert_eq!(fourier_step(0.0, order, 0.0), 0.5, "level with the receiver");
        let h = 1e-6;
        let slope = (fourier_step(h, order, 0.0) - fourier_step(-h, order, 0.0)) / (2.0 * h);
        assert!((slope - 2.0 * m).abs() < 1e-4 * m, "order {order}: a slope of {slope}");
        // The first crest, half a wave of the last from the step, and Gibbs's height.
        let crest = fourier_step(0.5 / m, order, 0.0) - 1.0;
        assert!((0.0896..=0.0922).contains(&crest), "order {order}: a crest of {crest}");
    }
    // Damping takes the crest down.
    for (order, damping, expected) in
        [(8, 1.0, 1.004), (16, 1.0, 1.013), (8, 2.0, 0.993), (16, 2.0, 0.999)]
    {
        let crests = (1..2000).map(|i| fourier_step(0.5 * f64::from(i) / 2000.0, order, damping));
        let crest = crests.fold(0.0, f64::max);
        assert!((crest - expected).abs() < 1.5e-3, "{order}, {damping}: {crest}, not {expected}");
    }
    // And the root mean square distance from the step falls with the root of the order.
    for (order, expected) in [(4, 0.133), (8, 0.090), (16, 0.062)] {
        let n = 40_000;
        let square = |i: i32| {
            let t = (2.0 * (f64::from(i) + 0.5) / f64::from(n)) - 1.0;
            let step = if t > 0.0 { 1.0 } else { 0.0 };
            (fourier_step(t, order, 1.0) - step).powi(2)
        };
        let rms = ((0..n).map(square).sum::<f64>() / f64::from(n)).sqrt();
        assert!((rms - expected).abs() < 2e-3, "order {order}: {rms}, not {expected}");
    }
}

#[test]
fn waves_are_no_bound_and_come_round_again() {
    let mut random = Random(14);
    let (mut below, mut above) = (0, 0);
    for _ in 0..10_000 {
        let window = random.window(8);
        let z = random.receiver(&window);
        let (v, truth) = (convolution(&window, &plain_waves(16, 1.0), z), pcf(&window, z));
        below += usize::from(v < truth - 0.05);
        above += usize::from(v > truth + 0.05);
    }
    assert!(below > 1000 && above > 1000, "{below} darker and {above} lighter");
    // An occluder at one end of the range and the receiver at the other, d short of a period apart: 0 in truth.
    for (order, expected) in [
        (4, [0.484, 0.460, 0.420, 0.342]),
        (8, [0.468, 0.420, 0.342, 0.197]),
        (16, [0.436, 0.342, 0.197, 0.0]),
    ] {
        for (d, expected) in [0.002, 0.005, 0.01, 0.02].into_iter().zip(expected) {
            let window = [(0.5 * d, 1.0)];
            let v = convolution(&window, &plain_waves(order, 0.0), 1.0 - 0.5 * d);
            assert!((v - expected).abs() < 6e-4, "order {order}, {d}: {v}, not {expected}");
            let doubled = Waves { scale: 2.0, ..plain_waves(order, 0.0) };
            let twice = convolution(&window, &doubled, 1.0 - 0.5 * d);
            assert!((twice - 2.0 * v).abs() < 1e-12, "the scale doubles it: {twice}");
            // With room of 1 / order between the ends it is the ringing that is left.
            let room = Waves { margin: 1.0 / f64::from(order), ..plain_waves(order, 1.0) };
            let v = convolution(&window, &room, 1.0 - 0.5 * d);
            assert!(v < 0.06, "order {order}, {d}: {v} with room");
        }
    }
    // Level with the receiver the scale makes of 1/2 what it should be.
    let level = Waves { scale: 2.0, margin: 1.0 / 16.0, ..plain_waves(16, 1.0) };
    for z in [0.1, 0.5, 0.999] {
        assert!((convolution(&[(z, 1.0)], &level, z) - 1.0).abs() < 1e-12, "a plane at {z}");
    }
}

#[test]
fn exponentials_cut_off_one_by_one_lie_between_comparisons_and_their_mean() {
    let mut random = Random(15);
    let (mut deeper, mut overflow, mut repaired) = (0, 0, 0);
    for _ in 0..100_000 {
        let window = random.window(8);
        let z = random.receiver(&window);
        let (truth, one_by_one, together) =
            (pcf(&window, z), clamped_esm(&window, 80.0, z), esm(&window, 80.0, z));
        assert!(one_by_one >= truth - 1e-12 && one_by_one <= together + 1e-12, "{window:?} at {z}");
        // What the mean tells, the largest depth tells too.
        let margin = 1.01f64.ln() / 80.0;
        let tells = log_mean(&window, 80.0) > z + margin;
        let is_deeper = window.iter().any(|(depth, _)| *depth > z + margin);
        assert!(is_deeper || !tells, "the mean of {window:?} is above {z}, none of it is");
        deeper += usize::from(is_deeper);
        overflow += usize::from(tells);
        repaired += usize::from(together > one_by_one + 0.1);
        // Without a deeper one the mean is exact but for the margin.
        if !is_deeper {
            assert!(together <= 1.01 * one_by_one + 1e-9, "{together}, {one_by_one}");
        }
    }
    assert!(
        overflow > 1000 && overflow < deeper && repaired > 1000,
        "{overflow} {deeper} {repaired}"
    );
    // The cliff: 1 becomes what comparisons say and exp(-c g).
    let window = [(0.3, 0.79), (0.95, 0.21)];
    assert_eq!(esm(&window, 80.0, 0.7), 1.0, "together");
    let expected = 0.21 + 0.79 * (-32.0f64).exp();
    assert!((clamped_esm(&window, 80.0, 0.7) - expected).abs() < 1e-12, "one by one");
}

#[test]
fn depth_filtered_before_the_comparison_is_no_filter() {
    // Half a kernel on a slab at 0.3, the receiver at 0.7: any share of the slab is all of it.
    for f in [0.01, 0.5, 0.99] {
        let window = [(0.3, f), (0.7, 1.0 - f)];
        assert_eq!(blurred_depth(&window, 0.7), 0.0, "{f} of the slab");
    }
    assert_eq!(blurred_depth(&[(0.7, 1.0)], 0.7), 1.0, "none of it");
    // Softly, the same share is darker the farther the slab is off: comparisons do not know that distance.
    let soft = |a: f64| soft_comparison(&[(a, 0.25), (0.7, 0.75)], 0.1, 0.7);
    assert!(soft(0.65) > 0.9 && soft(0.3) == 0.0, "{} and {}", soft(0.65), soft(0.3));
    let mut random = Random(16);
    let (mut below, mut above) = (0, 0);
    for _ in 0..10_000 {
        let window = random.window(8);
        let z = random.receiver(&window);
        let (v, truth) = (soft_comparison(&window, 0.1, z), pcf(&window, z));
        below += usize::from(v < truth - 0.3);
        above += usize::from(v > truth + 0.3);
    }
    assert!(below > 500 && above > 500, "wrong both ways: {below} darker, {above} lighter");
}

#[test]
fn the_ends_of_a_kernel_tell_all_from_none() {
    let mut random = Random(17);
    let mut greys = 0;
    for _ in 0..50_000 {
        let window = random.window(8);
        let z = random.receiver(&window);
        let (truth, own) = (pcf(&window, z), window[random.below(window.len())].0);
        for v in [multiple_depth(&window, None, z), multiple_depth(&window, Some(own), z)] {
            assert_eq!(v == 1.0, window.iter().all(|(depth, _)| *depth >= z), "{window:?} at {z}");
            assert_eq!(v == 0.0, window.iter().all(|(depth, _)| *depth < z), "{window:?} at {z}");
            greys += usize::from(v > 0.0 && v < 1.0 && (v - truth).abs() > 0.25);
        }
    }
    assert!(greys > 1000, "the proportion does not matter, yet {greys} are far off");
}

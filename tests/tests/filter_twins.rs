//! Lookups of filtered stores against their f64 twins, on random windows.

use antumbra_filter::twin;
use antumbra_gpu::{Gpu, bind, read_buffer};
use antumbra_shaders::{MODULES, Slot, link_source, module, source};
use antumbra_tests::{Random, gpu};

/// Unit roundoff of f32.
const U: f64 = 1.0 / 16_777_216.0;

/// Depths and weights of a kernel, and a receiver.
const DEPTHS: usize = 7;

#[repr(C)]
#[derive(Clone, Copy, Debug, bytemuck::Pod, bytemuck::Zeroable)]
struct Case {
    window: [[f32; 2]; DEPTHS],
    /// The receiver, and 0.
    receiver: [f32; 2],
}

impl Case {
    fn random(random: &mut Random) -> Self {
        let count = 1 + random.below(DEPTHS);
        let kind = random.below(3);
        let centers = [random.unit(), random.unit()];
        let width = 10f64.powf(-5.0 * random.unit());
        let mut window = [[0.0f32; 2]; DEPTHS];
        let mut sum = 0.0;
        for (i, entry) in window.iter_mut().enumerate().take(count) {
            let depth = match kind {
                0 => random.unit(),
                1 => (centers[i % 2] + width * (random.unit() - 0.5)).clamp(0.0, 1.0),
                _ => [0.0, 1.0, centers[0], centers[1]][i % 4],
            };
            let weight = if random.below(3) == 0 { 1.0 } else { random.unit() + 1e-3 };
            sum += weight;
            *entry = [depth as f32, weight as f32];
        }
        window.iter_mut().for_each(|e| e[1] = (f64::from(e[1]) / sum) as f32);
        let z = if random.below(2) == 0 {
            random.unit() as f32
        } else {
            let near = f64::from(window[random.below(count)][0]);
            (near + 10f64.powf(-5.0 * random.unit()) * (random.unit() - 0.3)).clamp(0.0, 1.0) as f32
        };
        Self { window, receiver: [z, 0.0] }
    }

    /// The window in f64, scaled to the weight 1 that f32 missed.
    fn exact(&self) -> Vec<(f64, f64)> {
        let sum: f64 = self.window.iter().map(|e| f64::from(e[1])).sum();
        let entries = self.window.iter().filter(|e| e[1] > 0.0);
        entries.map(|e| (f64::from(e[0]), f64::from(e[1]) / sum)).collect()
    }
}

const BOUNDS: &str = "
import package::filter::chebyshev::{chebyshev};
import package::filter::moment_bounds::{hamburger, hausdorff};
import package::filter::encoding::warped::{warp};
import package::filter::encoding::variance::{two_powers};
import package::filter::encoding::moments::{four_powers};
import package::filter::encoding::moments_16::{pack, decode};
import package::filter::evsm::{warped_bound};
import package::filter::esm::{exponential};
import package::filter::encoding::layered::{layer_depth};
import package::filter::fourier::{wave, term};
import package::filter::power_function::{power_function};
import package::gpu::mean::exponential::{begin, add, end};
import package::config::{LEAST_VARIANCE, SHARPNESS, POSITIVE, NEGATIVE, FLOAT_BIAS, SHORT_BIAS, STEP};
import package::config::{ORDER, BEFORE};

struct Case { window: array<vec2f, 7>, receiver: vec2f }

@group(0) @binding(0) var<storage, read> cases: array<Case>;
@group(0) @binding(1) var<storage, read_write> found: array<array<vec4f, 6>>;

fn lit(hidden: f32, bias: f32) -> f32 {
    return 1.0 - clamp((hidden - bias) / (1.0 - bias), 0.0, 1.0);
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= arrayLength(&cases) { return; }
    var m2 = vec4f(0.0);
    var warped = vec4f(0.0);
    var m4 = vec4f(0.0);
    var q = vec4f(0.0);
    var logarithm = begin();
    for (var i = 0; i < 7; i++) {
        let e = cases[id.x].window[i];
        if e.y > 0.0 {
            m2 += e.y * two_powers(e.x - 0.5);
            let w = warp(e.x);
            warped += e.y * vec4f(w.x, w.x * w.x, w.y, w.y * w.y);
            m4 += e.y * four_powers(2.0 * e.x - 1.0);
            q += e.y * pack(four_powers(2.0 * e.x - 1.0));
            logarithm = add(logarithm, e.y, vec4f(e.x));
        }
    }
    let z = cases[id.x].receiver.x;
    let zf = 2.0 * (z - STEP) - 1.0;
    let quantised = vec4f(unpack2x16unorm(pack2x16unorm(q.xy)), unpack2x16unorm(pack2x16unorm(q.zw)));
    let float = mix(m4, vec4f(0.0, 0.375, 0.0, 0.375), FLOAT_BIAS);
    let short = mix(decode(quantised), vec4f(0.0, 0.628, 0.0, 0.628), SHORT_BIAS);
    found[id.x][0] = vec4f(
        chebyshev(m2.x, m2.y, LEAST_VARIANCE, z - 0.5),
        exponential(end(logarithm).x, z, SHARPNESS),
        warped_bound(warped.xy, warp(z).x, POSITIVE),
        warped_bound(warped.zw, warp(z).y, NEGATIVE),
    );
    let float_ends = mix(m4, vec4f(0.0, 1.0 / 3.0, 0.0, 0.2), 3.0 * FLOAT_BIAS);
    let short_ends = mix(decode(quantised), vec4f(0.0, 1.0 / 3.0, 0.0, 0.2), 3.0 * SHORT_BIAS);
    found[id.x][1] = vec4f(
        lit(hamburger(float, zf), FLOAT_BIAS),
        lit(hamburger(short, zf), SHORT_BIAS),
        lit(hausdorff(float_ends, zf), 3.0 * FLOAT_BIAS),
        lit(hausdorff(short_ends, zf), 3.0 * SHORT_BIAS),
    );
    // One layer, from 1/4 to 3/4 of the range; sixteen waves; exponentials one by one; a power function.
    var layer = vec2f(0.0);
    var series = 0.5;
    var one_by_one = 0.0;
    var weight = 0.0;
    for (var i = 0; i < 7; i++) {
        let e = cases[id.x].window[i];
        layer += e.y * two_powers(layer_depth(e.x, 0.25, 2.0) - 0.5).xy;
        one_by_one += e.y * exponential(e.x, z, SHARPNESS);
        weight += e.y;
    }
    for (var k = 1.0; k <= ORDER; k += 1.0) {
        var waves = vec2f(0.0);
        for (var i = 0; i < 7; i++) {
            let e = cases[id.x].window[i];
            waves += e.y * wave(e.x, k);
        }
        series += term(k, waves, wave(z, k));
    }
    found[id.x][2] = vec4f(
        chebyshev(layer.x, layer.y, LEAST_VARIANCE, layer_depth(z, 0.25, 2.0) - 0.5),
        clamp(series, 0.0, 1.0),
        one_by_one / weight,
        power_function(m2.x + 0.5 + BEFORE, max(m2.y - m2.x * m2.x, LEAST_VARIANCE), z + BEFORE),
    );
    found[id.x][3] = pack(four_powers(2.0 * z - 1.0));
    // What is solved, before anything is cut off it; and the packed means, with what 16 bits make of them.
    found[id.x][4] = vec4f(
        hamburger(float, zf),
        hamburger(short, zf),
        hausdorff(float_ends, zf),
        hausdorff(short_ends, zf),
    );
    found[id.x][5] = q;
}";

/// What the receiver is moved by before four moments judge it, as `Msm` does.
const STEP: f64 = 4.0 * U;
const FLOAT_BIAS: f64 = 1e-6;
const SHORT_BIAS: f64 = 6e-5;

/// Variance, exponential, both warps; four moments at 32 and at 16 bits, and the same with the range's ends; a layer, waves,
/// exponentials one by one, a power function; the receiver's four packed powers; four moments again, as solved; and the
/// packed means. `mutant` stands in for a module.
fn on_gpu(gpu: &Gpu, cases: &[Case], mutant: Option<Slot>) -> Vec<[f32; 24]> {
    let config = format!(
        "const LEAST_VARIANCE: f32 = 1e-6;\nconst SHARPNESS: f32 = 80.0;\nconst POSITIVE: f32 = 40.0;\n\
         const NEGATIVE: f32 = 5.0;\nconst DEVIATION: f32 = 5e-5;\nconst CUT: f32 = 0.0;\n\
         const ROUNDING: f32 = 0.0;\nconst NEGATIVE_ROUNDING: f32 = 0.0;\nconst BOTH: bool = true;\n\
         const REACH: f32 = 1.0;\nconst SQUARE: f32 = 1.0;\nconst STEP: f32 = {STEP:?};\n\
         const FLOAT_BIAS: f32 = {FLOAT_BIAS:?};\nconst SHORT_BIAS: f32 = {SHORT_BIAS:?};\n\
         const ORDER: f32 = 16.0;\nconst SQUEEZE: f32 = 0.9;\nconst DAMPING: f32 = 1.0;\nconst BEFORE: f32 = 1.0;\n"
    );
    let mut slots = vec![
        module("store", "filter::texels"),
        module("mean", "gpu::mean::arithmetic"),
        source("config", config),
    ];
    slots.extend(mutant);
    let wgsl = link_source("tests::bounds", BOUNDS, &slots).expect("it links");
    let pipeline = gpu.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: Some("bounds"),
        layout: None,
        module: &gpu.shader("bounds", wgsl),
        entry_point: Some("main"),
        compilation_options: Default::default(),
        cache: None,
    });
    let storage = wgpu::BufferUsages::STORAGE;
    let given = gpu.buffer("cases", bytemuck::cast_slice(cases), storage);
    let zeros = vec![0u8; cases.len() * 96];
    let found = gpu.buffer("found", &zeros, storage | wgpu::BufferUsages::COPY_SRC);
    let group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: Some("bounds"),
        layout: &pipeline.get_bind_group_layout(0),
        entries: &[bind::buffer(0, &given), bind::buffer(1, &found)],
    });
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    let mut pass = encoder.begin_compute_pass(&Default::default());
    pass.set_pipeline(&pipeline);
    pass.set_bind_group(0, &group, &[]);
    pass.dispatch_workgroups((cases.len() as u32).div_ceil(64), 1, 1);
    drop(pass);
    gpu.queue.submit([encoder.finish()]);
    let bytes = read_buffer(gpu, &found, zeros.len() as u64).expect("read back");
    bytemuck::pod_collect_to_vec(&bytes)
}

#[test]
fn bounds_agree_with_their_twins_and_moments_are_never_lost() {
    let gpu = gpu();
    let mut random = Random(9);
    let cases: Vec<Case> = (0..400_000).map(|_| Case::random(&mut random)).collect();
    let found = on_gpu(&gpu, &cases, None);
    let (mut sharp, mut worst, mut over) = ([0usize; 4], [0f64; 4], [0f64; 4]);
    let (mut leaks, mut solved) = ([0f64; 4], [0f64; 4]);
    let mut touching = [0usize; 4];
    for (case, found) in cases.iter().zip(&found) {
        let (window, z) = (case.exact(), f64::from(case.receiver[0]));
        for v in &found[..12] {
            assert!((0.0..=1.0).contains(v), "{found:?} on {case:?}");
        }
        // With n terms a mean is off by (n + 2) u of its largest term; weights miss the sum 1 by n u.
        let n = 2.0 * DEPTHS as f64 + 2.0;
        // The variance by the mean square's error and twice the mean's; over v + d², of which the bound is a share.
        let bound = |m1: f64, m2: f64, least: f64, w: f64, scale: f64, e: f64| {
            let (variance, d) = ((m2 - m1 * m1).max(least), (w - m1).max(0.0));
            let numerator = 3.0 * e * scale * scale + 2.0 * d * 2.0 * e * scale;
            2.0 * numerator / (variance + d * d) + 8.0 * U
        };
        let m = |f: &dyn Fn(f64) -> f64| twin::mean(&window, f);
        let (m1, m2) = (m(&|z| z - 0.5), m(&|z| (z - 0.5).powi(2)));
        // exp is off by its argument's rounding, c u, and by a few units of its own; WGSL would allow 3 + 2 c.
        let warped = |sign: f64, c: f64| {
            let warp = move |z: f64| sign * (sign * c * (2.0 * z - 1.0)).exp();
            let (m1, m2, w) = (m(&warp), m(&|z| warp(z).powi(2)), warp(z));
            let scale = window.iter().map(|(z, _)| warp(*z).abs()).fold(w.abs(), f64::max);
            bound(m1, m2, (2.0 * c * 5e-5 * w).powi(2), w, scale, (n + 4.0 * c + 8.0) * U)
        };
        let exact = [
            (twin::vsm(&window, 1e-3, z), bound(m1, m2, 1e-6, z - 0.5, 0.5, n * U)),
            (twin::esm(&window, 80.0, z), 1e-4),
            (twin::positive_warp(&window, 40.0, 5e-5, z), warped(1.0, 40.0)),
            (twin::negative_warp(&window, 5.0, 5e-5, z), warped(-1.0, 5.0)),
        ];
        for (i, (expected, tolerance)) in exact.into_iter().enumerate() {
            let error = (f64::from(found[i]) - expected).abs();
            assert!(
                error <= tolerance,
                "{i}: {} for {expected} +- {tolerance}, {case:?}",
                found[i]
            );
            worst[i] = worst[i].max(error / tolerance);
            sharp[i] += usize::from(tolerance < 1e-3);
        }
        let truth = twin::pcf(&window, z);
        // Nor is any bound below comparisons, by more than what is rounded; of the two warps neither.
        for (i, (_, tolerance)) in exact.into_iter().enumerate() {
            let below = truth - f64::from(found[i]);
            assert!(below <= tolerance, "{i}: {below} below comparisons, {case:?}");
            touching[i] += usize::from(below.abs() <= tolerance && truth > 0.0 && truth < 1.0);
        }
        for ((over, leak), v) in over.iter_mut().zip(&mut leaks).zip(&found[4..8]) {
            *over = over.max(truth - f64::from(*v));
            *leak += (f64::from(*v) - truth).max(0.0) / cases.len() as f64;
        }
        // A clamp would make a number of what is none.
        for (solved, hidden) in solved.iter_mut().zip(&found[16..20]) {
            assert!(hidden.is_finite(), "{found:?} on {case:?}");
            *solved = solved.max(f64::from(hidden.clamp(0.0, 1.0)) - (1.0 - truth));
        }
    }
    // Where a bound is sharp, less would show.
    assert!(touching.iter().all(|count| *count > 1000), "sharp in {touching:?} cases only");
    // Tolerances that let everything pass would prove nothing.
    for (i, sharp) in sharp.iter().enumerate() {
        assert!(4 * sharp > cases.len(), "bound {i} is held to 1e-3 in {sharp} cases only");
        assert!(worst[i] > 1e-4, "bound {i} is off by {} of its tolerance at most", worst[i]);
    }
    // What four moments hide of a lit receiver is at most the share that is mixed in, of which a part lies nearer than it: at
    // 32 and 16 bits 5e-7 and 3.5e-5 are published. That share is given back, and nothing is left to hide. Weights of f32
    // miss the sum 1 by single steps of 2^-24.
    let biases = [FLOAT_BIAS, SHORT_BIAS, 3.0 * FLOAT_BIAS, 3.0 * SHORT_BIAS];
    for ((over, solved), bias) in over.into_iter().zip(solved).zip(biases) {
        assert!(solved <= bias + 16.0 * U, "{solved} is hidden, with a bias of {bias}");
        assert!(over <= 16.0 * U, "moments over-shadow by {over}, with a bias of {bias}");
    }
    // The ends of the range are worth a fifth of what leaks.
    for [any, within] in [[leaks[0], leaks[2]], [leaks[1], leaks[3]]] {
        assert!(within < 0.85 * any, "{within} leaks within the range, {any} without an end");
    }
}

#[test]
fn what_is_no_bound_agrees_with_its_twin() {
    let gpu = gpu();
    let mut random = Random(10);
    let cases: Vec<Case> = (0..100_000).map(|_| Case::random(&mut random)).collect();
    let waves = twin::Waves {
        order: 16,
        damping: 1.0,
        margin: 0.9f64.recip() - 1.0,
        offset: 0.0,
        scale: 1.0,
    };
    // Means are off by (n + 2) u of their largest term, weights by n u.
    let e = 2.0 * (2.0 * DEPTHS as f64 + 2.0) * U;
    let (mut worst, mut sharp, mut broken) = ([0f64; 5], 0, [0usize; 2]);
    for (case, found) in cases.iter().zip(on_gpu(&gpu, &cases, None)) {
        let (window, z) = (case.exact(), f64::from(case.receiver[0]));
        for v in &found[8..12] {
            assert!((0.0..=1.0).contains(v), "{found:?} on {case:?}");
        }
        let found = found.map(f64::from);
        let m = |f: &dyn Fn(f64) -> f64| twin::mean(&window, f);
        let warp = |z: f64| twin::layer_depth(z, [0.25, 2.0]) - 0.5;
        let (m1, m2) = (m(&warp), m(&|z| warp(z).powi(2)));
        let (variance, d) = ((m2 - m1 * m1).max(1e-6), (warp(z) - m1).max(0.0));
        let layer = twin::layer(&window, [0.25, 2.0], 1e-3, z);
        let chebyshev = 2.0 * (3.0 * e * 0.25 + 4.0 * d * e * 0.5) / (variance + d * d) + 8.0 * U;
        // A power function falls by 1 over a deviation or less, and as the logarithm's error, 2^-21 near 1 in WGSL and a
        // few units of 2u here, times the exponent; by as much as the variance's error moves its end.
        let (m1, m2) = (m(&|z| z - 0.5), m(&|z| (z - 0.5).powi(2)));
        let variance = (m2 - m1 * m1).max(1e-6);
        let [q, b] = twin::power_fit(m1 + 1.5, variance);
        let moved = 0.25 * 3.0 * e / variance + (q / b) * 8.0 * e;
        let power = 4.0 * (moved + q * 2f64.powi(-21));
        let expected = [
            (layer, chebyshev),
            // Sines are exact to 2^-11 in WGSL, on both sides, with weights that add to 2.
            (twin::convolution(&window, &waves, z), 4.0 * 2f64.powi(-11)),
            // exp(-a), with a below 80 for any but nothing, is exact to 3 + 2 a units.
            (twin::clamped_esm(&window, 80.0, z), 80.0 * 8.0 * U + e),
            (twin::power_function(&window, 1e-3, 1.0, z), power),
        ];
        for (i, (expected, tolerance)) in expected.into_iter().enumerate() {
            let error = (found[8 + i] - expected).abs();
            assert!(
                error <= tolerance,
                "{i}: {} for {expected} +- {tolerance}, {case:?}",
                found[8 + i]
            );
            worst[i] = worst[i].max(error / tolerance);
            sharp += usize::from(i == 3 && tolerance < 0.02);
        }
        let truth = twin::pcf(&window, z);
        // The control of bounds: waves are none, neither is variance whose tail is cut.
        let cut = twin::cut_tail(found[0], 0.2);
        broken[0] += usize::from(found[9] < truth - 0.05);
        broken[1] += usize::from(cut < truth - 0.05);
        let x = 2.0 * z - 1.0;
        let packed = twin::encode_16([x, x * x, x.powi(3), x.powi(4)]);
        for (v, expected) in found[12..].iter().zip(packed) {
            worst[4] = worst[4].max((v - expected).abs() / (16.0 * U));
        }
    }
    assert!(broken.iter().all(|count| *count > 1000), "below comparisons in {broken:?} cases");
    assert!(worst[4] <= 1.0, "packed moments are off by {} of their rounding", worst[4]);
    assert!(worst.iter().all(|w| *w > 1e-4), "tolerances that prove nothing: {worst:?}");
    assert!(4 * sharp > cases.len(), "a power function is held to 0.02 in {sharp} cases only");
}

/// How far packed means leave [0, 1], and what four moments at 16 bits hide of lit receivers.
fn of_packed(cases: &[Case], found: &[[f32; 24]]) -> [f64; 2] {
    let outside = |q: &f32| (f64::from(*q) - 1.0).max(-f64::from(*q));
    let packed = found.iter().flat_map(|f| f[20..].iter().map(outside)).fold(0.0, f64::max);
    let pairs = cases.iter().zip(found);
    let over = pairs.map(|(case, found)| {
        let truth = twin::pcf(&case.exact(), f64::from(case.receiver[0]));
        truth - f64::from(found[5])
    });
    [packed, over.fold(0.0, f64::max)]
}

#[test]
fn the_matrix_of_packed_moments_transposed_is_caught() {
    let gpu = gpu();
    let mut random = Random(11);
    let cases: Vec<Case> = (0..100_000).map(|_| Case::random(&mut random)).collect();
    let [packed, over] = of_packed(&cases, &on_gpu(&gpu, &cases, None));
    // Seven terms of up to 4, rounded.
    assert!(packed <= 64.0 * U, "packed means leave the unit interval by {packed}");
    assert!(over <= 16.0 * U, "{over} is hidden");
    // The classic mistake of ports: rows for columns, of the matrix of odd moments and of its inverse, so that one still
    // undoes the other.
    const PATH: &str = "filter::encoding::moments_16";
    let (_, right) = MODULES.iter().find(|(path, _)| *path == PATH).expect("the module");
    let transposed = [
        ("1.5 * m.x - 2.0 * m.z + 0.5", "1.5 * m.x + 0.8660254 * m.z + 0.5"),
        ("0.8660254 * m.x - 0.38490018 * m.z + 0.5", "-2.0 * m.x - 0.38490018 * m.z + 0.5"),
        ("-a / 3.0 + 1.7320508 * d", "-a / 3.0 - 0.75 * d"),
        ("-0.75 * a + 1.2990381 * d", "1.7320508 * a + 1.2990381 * d"),
    ];
    let mutant = transposed.iter().fold((*right).to_owned(), |text, (row, column)| {
        assert!(text.contains(row), "no `{row}` in the module");
        text.replace(row, column)
    });
    let [packed, over] = of_packed(&cases, &on_gpu(&gpu, &cases, Some(source(PATH, mutant))));
    assert!(packed > 1.0 && over > 0.5, "transposed: {packed} beyond the interval, {over} hidden");
}

//! Filterable stores on the GPU: the bounds against their f64 twins, the store against a blur on the CPU, and
//! the scenes whose leaks have a closed form.

use antumbra_filter::{
    Convolution, Esm, Evsm, Fallback, Lvsm, Msm, PcfAdaptive, PcfBilinearGrid, Prefilter, Savsm,
    Shape, Vsm, twin,
};
use antumbra_gpu::{
    Blur, BlurJob, BlurShader, Gpu, Recorder, TechniqueConfig, bind, blur_rounding, read_buffer,
    read_f32_texture,
};
use antumbra_map::{Bias, Estimator, MapConfig, MapTechnique};
use antumbra_measure::Stage;
use antumbra_reference::ViewSample;
use antumbra_scene::generate::shapes;
use antumbra_scene::{Light, LightKind, generate};
use antumbra_shaders::{link_source, module};
use antumbra_tests::{gpu, image};
use glam::{DAffine3, DVec3, Vec3};

#[path = "shared/slabs.rs"]
mod slabs;

use slabs::{FLOOR, across, overhead, settings, slabs};

/// Unit roundoff of f32.
const U: f64 = 1.0 / 16_777_216.0;

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
}

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
        let centers = [random.next(), random.next()];
        let width = 10f64.powf(-5.0 * random.next());
        let mut window = [[0.0f32; 2]; DEPTHS];
        let mut sum = 0.0;
        for (i, entry) in window.iter_mut().enumerate().take(count) {
            let depth = match kind {
                0 => random.next(),
                1 => (centers[i % 2] + width * (random.next() - 0.5)).clamp(0.0, 1.0),
                _ => [0.0, 1.0, centers[0], centers[1]][i % 4],
            };
            let weight = if random.below(3) == 0 { 1.0 } else { random.next() + 1e-3 };
            sum += weight;
            *entry = [depth as f32, weight as f32];
        }
        window.iter_mut().for_each(|e| e[1] = (f64::from(e[1]) / sum) as f32);
        let z = if random.below(2) == 0 {
            random.next() as f32
        } else {
            let near = f64::from(window[random.below(count)][0]);
            (near + 10f64.powf(-5.0 * random.next()) * (random.next() - 0.3)).clamp(0.0, 1.0) as f32
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
import package::filter::moment_bounds::{hamburger};
import package::filter::encoding::warped::{warp};
import package::filter::encoding::variance::{two_powers};
import package::filter::encoding::moments::{four_powers};
import package::filter::encoding::moments_16::{pack, decode};
import package::filter::evsm::{warped_bound};
import package::filter::esm::{exponential};
import package::gpu::mean::exponential::{begin, add, end};
import package::config::{LEAST_VARIANCE, SHARPNESS, POSITIVE, NEGATIVE, FLOAT_BIAS, SHORT_BIAS, STEP};

struct Case { window: array<vec2f, 7>, receiver: vec2f }

@group(0) @binding(0) var<storage, read> cases: array<Case>;
@group(0) @binding(1) var<storage, read_write> found: array<array<vec4f, 2>>;

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
    found[id.x][1] =
        vec4f(lit(hamburger(float, zf), FLOAT_BIAS), lit(hamburger(short, zf), SHORT_BIAS), 0.0, 0.0);
}";

/// What the receiver is moved by before four moments judge it, as `Msm` does.
const STEP: f64 = 4.0 * U;
const FLOAT_BIAS: f64 = 1e-6;
const SHORT_BIAS: f64 = 6e-5;

/// Variance, exponential, both warps; four moments at 32 and at 16 bits.
fn on_gpu(gpu: &Gpu, cases: &[Case]) -> Vec<[f32; 8]> {
    let config = format!(
        "const LEAST_VARIANCE: f32 = 1e-6;\nconst SHARPNESS: f32 = 80.0;\nconst POSITIVE: f32 = 40.0;\n\
         const NEGATIVE: f32 = 5.0;\nconst DEVIATION: f32 = 5e-5;\nconst CUT: f32 = 0.0;\n\
         const ROUNDING: f32 = 0.0;\nconst NEGATIVE_ROUNDING: f32 = 0.0;\nconst BOTH: bool = true;\n\
         const RADIUS: f32 = 1.0;\nconst SPREAD: f32 = 1.0;\nconst STEP: f32 = {STEP:?};\n\
         const FLOAT_BIAS: f32 = {FLOAT_BIAS:?};\nconst SHORT_BIAS: f32 = {SHORT_BIAS:?};\n"
    );
    let slots = [module("store", "filter::texels"), antumbra_shaders::source("config", config)];
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
    let zeros = vec![0u8; cases.len() * 32];
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
    let found = on_gpu(&gpu, &cases);
    let (mut sharp, mut worst, mut over) = ([0usize; 4], [0f64; 4], [0f64; 2]);
    for (case, found) in cases.iter().zip(&found) {
        let (window, z) = (case.exact(), f64::from(case.receiver[0]));
        for v in found {
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
        for (over, v) in over.iter_mut().zip(&found[4..]) {
            *over = over.max(truth - f64::from(*v));
        }
    }
    // Tolerances that let everything pass would prove nothing.
    for (i, sharp) in sharp.iter().enumerate() {
        assert!(4 * sharp > cases.len(), "bound {i} is held to 1e-3 in {sharp} cases only");
        assert!(worst[i] > 1e-4, "bound {i} is off by {} of its tolerance at most", worst[i]);
    }
    // What four moments hide of a lit receiver: published for these biases are 5e-7 and 3.5e-5, in single steps
    // of 2^-24 more where a weight of f32 misses the sum 1.
    for (over, bias) in over.into_iter().zip([FLOAT_BIAS, SHORT_BIAS]) {
        assert!(over <= bias + 16.0 * U, "moments over-shadow by {over}, with a bias of {bias}");
    }
}

#[test]
fn two_slabs_leak_on_the_gpu_as_in_closed_form() {
    let gpu = gpu();
    let (map, filter) = settings();
    // One slab over half, one over all, and the floor 1 m below: r = 1 / 4, the truth 0. A third caster, below the
    // floor and under the second, keeps the floor among the casters' depths.
    let scene = slabs(&[(8.0, -5.0, 0.0), (4.0, -5.0, 5.0), (2.0, 4.0, 5.0)]);
    let most =
        |config: &dyn TechniqueConfig| across(&gpu, &scene, config).into_iter().fold(0.0, f32::max);
    let variance = most(&Vsm { map, filter, ..Vsm::default() });
    // Weights come in steps of less than 1/17, near a maximum that is flat: 1 % below it at a step beside.
    // The least variance adds 1e-6 to one of 0.004.
    assert!((0.435..=0.446).contains(&variance), "1 / (1 + 2 r)^2 = 0.444, not {variance}");
    let table = Savsm { map, radius: 8.0, follow_pixels: false, ..Savsm::default() };
    let tabled = most(&table);
    assert!((tabled - variance).abs() < 1e-3, "a table of the same: {tabled}, not {variance}");
    let cut = most(&Vsm { map, filter, cut: 0.45, ..Vsm::default() });
    assert_eq!(cut, 0.0, "a cut above the leak");
    // The share of the range that a metre is, g, says the rest.
    let points = [ViewSample { position: Vec3::new(0.2, FLOOR as f32, 0.0), normal: Vec3::Y }];
    let stage = Stage::at_points(&gpu, &scene, &points).expect("a stage");
    let mut technique = Vsm { map, filter, ..Vsm::default() }.technique(&gpu).expect("valid");
    stage.shoot(&gpu, &overhead(), &mut technique, 0).expect("a shot");
    let clip = technique.map().views()[0].clip.expect("a view with casters");
    let linear = technique.map().linear_depths()[0];
    let z = |y: f64| linear.of(clip.project_point3(y * DVec3::Y).z);
    let g = z(3.0) - z(4.0);
    assert!(z(3.0) < linear.last && g > 0.03, "the floor is among the casters, {g} behind one");
    // Two depths are exact but for the bias. Rounding is within it, and may add as much again.
    for (quantised, target) in [(false, 0.375), (true, 0.628)] {
        let config = Msm { map, filter, quantised, ..Msm::default() };
        let bias = config.effective_moment_bias();
        let leak = |f: f64| twin::msm(&[(z(8.0), f), (z(4.0), 1.0 - f)], bias, target, z(3.0));
        let expected = (1..100).map(|i| leak(f64::from(i) / 100.0)).fold(0.0, f64::max);
        let found = f64::from(most(&config));
        assert!((0.5 * expected..=2.0 * expected).contains(&found), "{found}, not {expected}");
        assert!(expected < 0.5 * f64::from(variance), "{expected} is no gain over {variance}");
    }
    let warped = (2.0 * (80.0 * g).exp() - 1.0).powi(-2) + (80.0f64 * 2.5e-5).powi(2);
    let evsm = f64::from(most(&Evsm { map, filter, ..Evsm::default() }));
    assert!(evsm <= 1.01 * warped, "both warps: {evsm}, at most {warped}");
    // Under the second slab alone.
    let exponential = (-80.0 * g).exp();
    let esm = f64::from(most(&Esm { map, filter, ..Esm::default() }));
    assert!((esm - exponential).abs() < 0.01 * exponential, "{esm}, not {exponential}");
}

#[test]
fn a_floor_that_casts_nothing_is_in_the_map_all_the_same() {
    let gpu = gpu();
    let (map, filter) = settings();
    // As above without the third caster: the floor lies beyond the last one, and leaks as much.
    let scene = slabs(&[(8.0, -5.0, 0.0), (4.0, -5.0, 5.0)]);
    let found = across(&gpu, &scene, &Vsm { map, filter, ..Vsm::default() });
    let most = found.into_iter().fold(0.0, f32::max);
    assert!((0.435..=0.446).contains(&most), "1 / (1 + 2 r)^2 = 0.444, not {most}");
    // A slab over half, and another far below the floor: were it not for the floor's own depth, all but the
    // innermost of the shadow's rim would be lit.
    let scene = slabs(&[(4.0, -5.0, 0.0), (-20.0, 4.0, 5.0)]);
    let rim = across(&gpu, &scene, &Vsm { map, filter, ..Vsm::default() });
    let exact = across(&gpu, &scene, &PcfBilinearGrid { map, side: 17 });
    let off = rim.iter().zip(&exact).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    // The least variance, 1e-6 of the range's square, beside that of two depths, w (1 - w) / 33^2 with w in steps
    // of 1/17.
    assert!(off < 0.02, "{off}");
}

#[test]
fn an_edge_over_a_parallel_floor_is_the_kernels_own_profile() {
    let gpu = gpu();
    let (map, filter) = settings();
    let scene = slabs(&[(7.0, -5.0, 0.0), (7.0, 4.0, 5.0)]);
    // The same kernel of texels compared one by one.
    let exact = across(&gpu, &scene, &PcfBilinearGrid { map, side: 17 });
    let soft = exact.iter().filter(|v| (0.05..0.95).contains(*v)).count();
    assert!(soft > 200, "{soft} samples in the penumbra");
    let box_of_17 = Savsm { map, radius: 8.0, follow_pixels: false, ..Savsm::default() };
    let configs: [(&str, &dyn TechniqueConfig, f64); 7] = [
        // A floor of 1e-6 on a variance and a gap of 0.01 and more.
        ("vsm", &Vsm { map, filter, ..Vsm::default() }, 1e-3),
        ("savsm", &box_of_17, 1e-3),
        // One by one where a texel lies behind the receiver, as the far end does beyond the slabs.
        ("esm, deeper", &Esm { map, filter, fallback: Fallback::Deeper, ..Esm::default() }, 1e-3),
        ("esm", &Esm { map, filter, ..Esm::default() }, 1e-3),
        ("evsm", &Evsm { map, filter, ..Evsm::default() }, 1e-3),
        ("msm", &Msm { map, filter, ..Msm::default() }, 1e-3),
        // A bias of 6e-5 on a signed gap of 0.5.
        ("msm 16", &Msm { map, filter, quantised: true, ..Msm::default() }, 5e-3),
    ];
    for (name, config, tolerance) in configs {
        let found = across(&gpu, &scene, config);
        for (i, (v, expected)) in found.iter().zip(&exact).enumerate() {
            let error = f64::from((v - expected).abs());
            assert!(error <= tolerance, "{name}: {v} for {expected} at sample {i}");
        }
    }
}

#[test]
fn no_store_is_darker_than_the_same_kernel_of_comparisons() {
    let gpu = gpu();
    let mut scene = generate::sphere_over_plane(&Default::default());
    let cuboid = shapes::cuboid(DVec3::new(0.6, 0.0, -0.9), DVec3::new(1.0, 0.8, -0.5));
    scene.add(cuboid, DAffine3::from_rotation_y(0.3));
    let stage = Stage::new(&gpu, &scene, scene.camera_or_framing(), 192, 192).expect("a stage");
    // One reference depth for the whole kernel on both sides, moved by the kernel's radius of slope.
    let bias = Bias { receiver_plane: false, cone: 0.0, ..Bias::default() };
    let map = MapConfig { size: 256, bias, ..MapConfig::default() };
    let filter = Prefilter { shape: Shape::Box, radius: 1 };
    // Rounding of a variance, 5e-7 of the range's square, over the least one: 1e-2 squared. For warps, 4e-6 of
    // the warp's square over (80 x 1e-3)^2, and (10 x 1e-2)^2. For moments, the bias.
    let savsm = Savsm { map, radius: 1.0, follow_pixels: false, ..Savsm::default() };
    let fallback = |fallback| Esm { map, filter, fallback, ..Esm::default() };
    let configs: [(&str, &dyn TechniqueConfig, f32); 9] = [
        ("vsm", &Vsm { map, filter, deviation: 1e-2, ..Vsm::default() }, 5e-3),
        // Sixteen windows joined in f32: 1.5e-6 of the range's square.
        ("savsm", &Savsm { deviation: 1e-2, ..savsm }, 1.5e-2),
        ("esm, overflow", &fallback(Fallback::Overflow), 1e-4),
        ("esm, deeper", &fallback(Fallback::Deeper), 1e-4),
        ("lvsm", &Lvsm { map, filter, deviation: 1e-2, ..Lvsm::default() }, 5e-3),
        ("esm", &Esm { map, filter, ..Esm::default() }, 1e-4),
        ("evsm", &Evsm { map, filter, deviation: 1e-2, ..Evsm::default() }, 1e-3),
        ("msm", &Msm { map, filter, ..Msm::default() }, 1e-4),
        ("msm 16", &Msm { map, filter, quantised: true, ..Msm::default() }, 1e-4),
    ];
    for kind in [LightKind::Directional, LightKind::Spot, LightKind::Point] {
        let light = scene.place_light(kind);
        let shoot = |config: &dyn TechniqueConfig| {
            let mut technique = config.build(&gpu).expect("a valid config");
            stage.shoot(&gpu, &light, technique.as_mut(), 0).expect("a shot").visibility
        };
        let compared = shoot(&PcfBilinearGrid { map, side: 3 });
        for (name, config, rounding) in configs {
            let found = shoot(config);
            let below = found.iter().zip(&compared).map(|(v, pcf)| pcf - v).fold(0.0, f32::max);
            assert!(below <= rounding, "{name}, {kind:?}: darker by {below}");
        }
        // The control: a cut is no bound.
        let cut = shoot(&Vsm { map, filter, cut: 0.3, ..Vsm::default() });
        let below = cut.iter().zip(&compared).map(|(v, pcf)| pcf - v).fold(0.0, f32::max);
        assert!(below > 0.05, "{kind:?}: a cut of 0.3 passes for a bound, {below}");
        // And waves are none: they ring, and half of what is level with its caster is lost without a scale.
        let waves = shoot(&Convolution { map, filter, scale: 1.0, ..Convolution::default() });
        let below = waves.iter().zip(&compared).map(|(v, pcf)| pcf - v).fold(0.0, f32::max);
        assert!(below > 0.3, "{kind:?}: waves pass for a bound, {below}");
    }
}

#[test]
fn layers_part_casters_on_the_gpu() {
    let gpu = gpu();
    let (map, filter) = settings();
    // As in `two_slabs_leak`; the range is about 22 m from 8 m on, so that with 16 layers the slab at 4 m and the
    // floor at 3 m share one that begins behind the slab at 8 m: it counts as at the layer's front.
    let scene = slabs(&[(8.0, -5.0, 0.0), (4.0, -5.0, 5.0), (2.0, 4.0, 5.0)]);
    let most = |layers| {
        let found = across(&gpu, &scene, &Lvsm { map, filter, layers, ..Lvsm::default() });
        found.into_iter().fold(0.0, f32::max)
    };
    let (one, many) = (most(1), most(16));
    assert!((0.435..=0.446).contains(&one), "one layer is a variance shadow map: {one}");
    assert!(many < 0.25, "16 layers leave {many}");
}

#[test]
fn an_adaptive_disc_errs_only_where_its_rim_agrees() {
    let gpu = gpu();
    let mut scene = generate::sphere_over_plane(&Default::default());
    let cuboid = shapes::cuboid(DVec3::new(0.6, 0.0, -0.9), DVec3::new(1.0, 0.8, -0.5));
    scene.add(cuboid, DAffine3::from_rotation_y(0.3));
    let stage = Stage::new(&gpu, &scene, scene.camera_or_framing(), 256, 256).expect("a stage");
    let light = scene.place_light(LightKind::Directional);
    let map = MapConfig { size: 128, ..MapConfig::default() };
    let shoot = |exhaustive| {
        let config = PcfAdaptive { map, exhaustive, ..PcfAdaptive::default() };
        let mut technique = config.build(&gpu).expect("a valid config");
        stage.shoot(&gpu, &light, technique.as_mut(), 0).expect("a shot").visibility
    };
    let (adaptive, all) = (shoot(false), shoot(true));
    let penumbra = all.iter().filter(|v| (0.01..0.99).contains(*v)).count();
    assert!(penumbra > 300, "{penumbra} samples in the penumbra");
    let mut missed = 0;
    for (a, b) in adaptive.iter().zip(&all) {
        assert!(*a == *b || *a == 0.0 || *a == 1.0, "{a}, not {b}, where the rim disagrees");
        missed += usize::from(a != b);
    }
    assert!(100 * missed < all.len(), "{missed} of {} samples", all.len());
    assert!(missed > 0, "the rim stands for all that it surrounds?");
}

#[test]
fn a_store_is_the_filtered_map() {
    const SIZE: usize = 96;
    let gpu = gpu();
    let scene = generate::sphere_over_plane(&Default::default());
    let stage = Stage::new(&gpu, &scene, scene.camera_or_framing(), 32, 32).expect("a stage");
    let map = MapConfig { size: SIZE as u32, ..MapConfig::default() };
    for kind in [LightKind::Directional, LightKind::Spot] {
        let light = scene.place_light(kind);
        for radius in [0, 2, 5] {
            let filter = Prefilter { radius, ..Prefilter::default() };
            let config = Vsm { map, filter, ..Vsm::default() };
            let (store, depth, linear) = store_and_map(&gpu, &stage, &light, &config);
            let last = SIZE as i64 - 1;
            let weights = filter.weights();
            let blurred = |x: i64, y: i64, f: &dyn Fn(f64) -> f64| {
                let reach = i64::from(radius);
                let mut sum = 0.0;
                for j in -reach..=reach {
                    for i in -reach..=reach {
                        let (x, y) = ((x + i).clamp(0, last), (y + j).clamp(0, last));
                        let z = linear.of_texel(f64::from(depth[y as usize * SIZE + x as usize]));
                        let (a, b) = ((i + reach) as usize, (j + reach) as usize);
                        sum += weights[a] * weights[b] * f(z - 0.5);
                    }
                }
                sum
            };
            // Linear depth is off by 5u of the sum of its numerator's terms, over the denominator; the filter by
            // its own rounding.
            let [a, b, c, d] = linear.coefficients;
            let largest = depth.iter().filter(|v| **v > 0.0).map(|v| {
                let v = f64::from(*v);
                ((a * v).abs() + b.abs()) / (c * v + d)
            });
            let tolerance = 0.5 * blur_rounding(radius) + 5.0 * U * largest.fold(1.0, f64::max);
            let mut varied = 0;
            for y in 0..SIZE as i64 {
                for x in 0..SIZE as i64 {
                    let at = 2 * (y as usize * SIZE + x as usize);
                    let (m1, m2) = (blurred(x, y, &|z| z), blurred(x, y, &|z| z * z));
                    let (e1, e2) =
                        ((f64::from(store[at]) - m1).abs(), (f64::from(store[at + 1]) - m2).abs());
                    assert!(e1 <= tolerance && e2 <= tolerance, "{kind:?}, {radius}: {e1}, {e2}");
                    varied += usize::from(m2 - m1 * m1 > 1e-4);
                }
            }
            assert!(varied > 50 || radius == 0, "{kind:?}, {radius}: {varied} texels with an edge");
        }
    }
}

/// The store's and the map's first layer, and its linear depth.
fn store_and_map(
    gpu: &Gpu,
    stage: &Stage,
    light: &Light,
    config: &Vsm,
) -> (Vec<f32>, Vec<f32>, antumbra_map::LinearDepth) {
    let mut technique = config.technique(gpu).expect("a valid config");
    stage.shoot(gpu, light, &mut technique, 0).expect("a shot");
    let store = technique.store().and_then(|s| s.view()).expect("a store").texture().clone();
    let store = read_f32_texture(gpu, &store, 0).expect("read back");
    let map = technique.map().texture().expect("a map with casters");
    let depth = read_f32_texture(gpu, map, 0).expect("read back");
    (store, depth, technique.map().linear_depths()[0])
}

#[test]
fn depths_that_are_no_numbers_or_out_of_range_enter_no_store() {
    const SIZE: u32 = 64;
    let gpu = gpu();
    let mut texels = vec![0.5f32; (SIZE * SIZE) as usize];
    let bad = [f32::NAN, -f32::NAN, f32::INFINITY, f32::NEG_INFINITY, -5.0, 7.0, 1e38, 1e-42];
    for (i, value) in bad.into_iter().enumerate() {
        texels[(20 * SIZE) as usize + 4 * i + 16] = value;
    }
    let view = image(&gpu, SIZE, &texels);
    // Infinite reversed perspective with its near plane at 1 m, linear from 1 m to 4 m.
    let linear = [-1.0, 1.0, 3.0, 0.0];
    for (encoding, sharpness) in
        [("variance", 80), ("warped", 80), ("moments", 80), ("depth", 80), ("depth", 1000)]
    {
        let config = format!(
            "const POSITIVE: f32 = 40.0;\nconst NEGATIVE: f32 = 5.0;\n\
             const SHARPNESS: f32 = {sharpness}.0;"
        );
        let shader = BlurShader {
            texel: "filter::from_depth",
            mean: if encoding == "depth" {
                "gpu::mean::exponential"
            } else {
                "gpu::mean::arithmetic"
            },
            slots: vec![
                (
                    "encoding".into(),
                    antumbra_shaders::Binding::Module(
                        format!("filter::encoding::{encoding}").into(),
                    ),
                ),
                antumbra_shaders::source("config", config),
            ],
            format: wgpu::TextureFormat::Rgba32Float,
        };
        let mut blur = Blur::new(&gpu, &shader, &[1.0, 2.0, 1.0]).expect("a valid blur");
        let job = BlurJob { source: 0, parameters: [linear, [0.0; 4]] };
        blur.prepare(&gpu, &view, SIZE, &[job]).expect("room");
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        blur.encode(&mut Recorder::new(&mut encoder), "test");
        gpu.queue.submit([encoder.finish()]);
        let out = read_f32_texture(&gpu, blur.texture().expect("made"), 0).expect("read back");
        let largest = (40f32.exp()).powi(2) * 1.001;
        assert!(out.iter().all(|v| v.is_finite() && v.abs() <= largest), "{encoding}: not finite");
        // A texel away from all of them is as if they were not there.
        let (clean, there) = (&out[..4], &out[(40 * SIZE as usize + 16) * 4..][..4]);
        assert_eq!(clean, there, "{encoding}: a texel beyond the kernel");
    }
    assert_eq!(gpu.check(), Ok(()), "errors on the device");
}

#[test]
fn a_texel_knows_the_spread_of_its_own_slope_but_no_outline() {
    const SIZE: u32 = 64;
    // A multiple of 256 bytes a row; a step of 2^-9 a texel is exact.
    const STEP: f32 = 1.0 / 512.0;
    let gpu = gpu();
    // Linear depth 1 - d: a ramp along x, with a cliff of 1/4 in the middle.
    let ramp = |x: u32| 0.25 + STEP * x as f32 + if x < SIZE / 2 { 0.0 } else { 0.25 };
    let texels: Vec<f32> = (0..SIZE * SIZE).map(|i| 1.0 - ramp(i % SIZE)).collect();
    let view = image(&gpu, SIZE, &texels);
    let shader = BlurShader {
        texel: "filter::from_depth_slope",
        mean: "gpu::mean::arithmetic",
        slots: vec![module("encoding", "filter::encoding::variance")],
        format: wgpu::TextureFormat::Rg32Float,
    };
    let mut blur = Blur::new(&gpu, &shader, &[1.0]).expect("a valid blur");
    let job = BlurJob { source: 0, parameters: [[-1.0, 1.0, 0.0, 1.0], [0.0; 4]] };
    blur.prepare(&gpu, &view, SIZE, &[job]).expect("room");
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    blur.encode(&mut Recorder::new(&mut encoder), "test");
    gpu.queue.submit([encoder.finish()]);
    let out = read_f32_texture(&gpu, blur.texture().expect("made"), 0).expect("read back");
    // Texels at the border see no difference to one side; those at the cliff take the other side's.
    for x in 1..SIZE - 1 {
        let at = 2 * (10 * SIZE + x) as usize;
        let variance = f64::from(out[at + 1]) - f64::from(out[at]).powi(2);
        let expected = f64::from(STEP).powi(2) / 4.0;
        // The square, below 1/4, is rounded twice.
        assert!((variance - expected).abs() <= U, "{variance} at {x}, not {expected}");
    }
}

#[test]
fn unusable_blurs_are_refused_with_a_fix() {
    let gpu = gpu();
    let shader = |format| BlurShader {
        texel: "gpu::stored_texel",
        mean: "gpu::mean::arithmetic",
        slots: Vec::new(),
        format,
    };
    let float = wgpu::TextureFormat::R32Float;
    for weights in [vec![], vec![1.0, 1.0], vec![1.0; 65], vec![-1.0], vec![f64::NAN], vec![0.0]] {
        assert!(Blur::new(&gpu, &shader(float), &weights).is_err(), "{weights:?}");
    }
    let depth = wgpu::TextureFormat::Depth32Float;
    assert!(Blur::new(&gpu, &shader(depth), &[1.0]).is_err(), "a depth format");
    assert_eq!(gpu.check(), Ok(()), "nothing reached wgpu");
}

#[test]
fn work_does_not_grow_with_the_kernel_and_memory_is_as_stated() {
    const SIZE: u64 = 256;
    let gpu = gpu();
    let scene = generate::sphere_over_plane(&Default::default());
    let stage = Stage::new(&gpu, &scene, scene.camera_or_framing(), 64, 64).expect("a stage");
    let light = scene.place_light(LightKind::Directional);
    let map = MapConfig { size: SIZE as u32, ..MapConfig::default() };
    for radius in [0, 2, 15] {
        let filter = Prefilter { radius, ..Prefilter::default() };
        // Bytes a texel of the store and of what lies between the passes.
        let configs: [(&dyn TechniqueConfig, u64); 6] = [
            (&Vsm { map, filter, ..Vsm::default() }, 8 + 8),
            (&Esm { map, filter, ..Esm::default() }, 4 + 4),
            (&Evsm { map, filter, ..Evsm::default() }, 16 + 16),
            (&Evsm { map, filter, both: false, ..Evsm::default() }, 8 + 8),
            (&Msm { map, filter, quantised: true, ..Msm::default() }, 8 + 16),
            (&Msm { map, filter, ..Msm::default() }, 16 + 16),
        ];
        for (config, bytes) in configs {
            let mut technique = config.build(&gpu).expect("a valid config");
            let shot = stage.shoot(&gpu, &light, technique.as_mut(), 0).expect("a shot");
            assert_eq!(shot.counters["fetches"], 64 * 64 * 4, "fetches at {radius}");
            assert_eq!(shot.counters["store_layers"], 1, "layers at {radius}");
            assert_eq!(shot.counters["store_texels"], 2 * SIZE * SIZE, "texels at {radius}");
            let mut plain =
                MapTechnique::new(&gpu, &map, Estimator::nearest()).expect("a valid config");
            let map_bytes = stage.shoot(&gpu, &light, &mut plain, 0).expect("a shot").bytes;
            let store = shot.bytes - map_bytes;
            assert!((0..4096).contains(&(store - bytes * SIZE * SIZE)), "{store} bytes");
        }
    }
}

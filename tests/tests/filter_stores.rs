//! The stores of filters: what they hold against a blur on the CPU, what enters none, and what they cost.

use antumbra_filter::{
    BlurredDepth, Convolution, Esm, Evsm, Fallback, Lvsm, Msm, MultipleDepth, PowerFunction,
    Prefilter, Savsm, SoftComparison, Table, Vsm,
};
use antumbra_gpu::{
    Blur, BlurJob, BlurShader, Gpu, Recorder, TechniqueConfig, blur_rounding, read_f32_texture,
};
use antumbra_map::{Estimator, MapConfig, MapTechnique};
use antumbra_measure::Stage;
use antumbra_scene::{Light, LightKind, generate};
use antumbra_shaders::module;
use antumbra_tests::{gpu, image};

/// Unit roundoff of f32.
const U: f64 = 1.0 / 16_777_216.0;

#[test]
fn a_store_is_the_filtered_map() {
    const SIZE: usize = 96;
    let gpu = gpu();
    let scene = generate::sphere_over_plane(&Default::default());
    let stage = Stage::new(&gpu, &scene, scene.camera_or_framing(), 32, 32).expect("a stage");
    let map = MapConfig { size: SIZE as u32, ..MapConfig::default() };
    for kind in [LightKind::Directional, LightKind::Spot] {
        let light = scene.place_light(kind);
        for (radius, samples) in [(0, 1), (2, 1), (5, 1), (2, 2), (1, 4)] {
            let filter = Prefilter { radius, samples, ..Prefilter::default() };
            let config = Vsm { map, filter, ..Vsm::default() };
            let (store, depth, linear) = store_and_map(&gpu, &stage, &light, &config);
            let side = SIZE as i64 / i64::from(samples);
            let last = side - 1;
            let weights = filter.weights();
            // The mean over the texels of the map that are one of the store.
            let of_samples = |[x, y]: [i64; 2], f: &dyn Fn(f64) -> f64| {
                let n = i64::from(samples);
                let one = |k: i64| {
                    let at = (n * y + k / n) as usize * SIZE + (n * x + k % n) as usize;
                    let z = linear.of_texel(f64::from(depth[at]));
                    f(if z > linear.last_caster { 0.5 } else { z - 0.5 })
                };
                (0..n * n).map(one).sum::<f64>() / (n * n) as f64
            };
            let blurred = |x: i64, y: i64, f: &dyn Fn(f64) -> f64| {
                let reach = i64::from(radius);
                let mut sum = 0.0;
                for j in -reach..=reach {
                    for i in -reach..=reach {
                        let (x, y) = ((x + i).clamp(0, last), (y + j).clamp(0, last));
                        let (a, b) = ((i + reach) as usize, (j + reach) as usize);
                        sum += weights[a] * weights[b] * of_samples([x, y], f);
                    }
                }
                sum
            };
            let terms = f64::from(samples * samples) + 1.0;
            // Linear depth is off by 5u of the sum of its numerator's terms, over the denominator; the filter by
            // its own rounding.
            let [a, b, c, d] = linear.coefficients;
            let largest = depth.iter().filter(|v| **v > 0.0).map(|v| {
                let v = f64::from(*v);
                ((a * v).abs() + b.abs()) / (c * v + d)
            });
            let filtered = blur_rounding(radius) + terms * U;
            let tolerance = 0.5 * filtered + 5.0 * U * largest.fold(1.0, f64::max);
            let mut varied = 0;
            for y in 0..side {
                for x in 0..side {
                    let at = 2 * (y * side + x) as usize;
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
        let job = BlurJob { source: 0, parameters: [linear, [0.0, 0.0, 0.0, 1.0]] };
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
    let job = BlurJob { source: 0, parameters: [[-1.0, 1.0, 0.0, 1.0], [0.0, 0.0, 0.0, 1.0]] };
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

/// What a store costs: bytes a texel that lookups read and that lie between the passes, layers a layer of the map, and
/// fetches of a lookup.
struct Cost {
    stored: u64,
    between: u64,
    layers: u64,
    fetches: u64,
}

#[test]
fn work_and_memory_are_as_stated_and_only_filters_know_their_radius() {
    const SIZE: u64 = 256;
    let gpu = gpu();
    let scene = generate::sphere_over_plane(&Default::default());
    let stage = Stage::new(&gpu, &scene, scene.camera_or_framing(), 64, 64).expect("a stage");
    let light = scene.place_light(LightKind::Directional);
    let map = MapConfig { size: SIZE as u32, ..MapConfig::default() };
    let mut plain = MapTechnique::new(&gpu, &map, Estimator::nearest()).expect("a valid config");
    let map_bytes = stage.shoot(&gpu, &light, &mut plain, 0).expect("a shot").bytes;
    let cost = |stored, between, layers, fetches| Cost { stored, between, layers, fetches };
    for radius in [0, 2, 15] {
        let filter = Prefilter { radius, ..Prefilter::default() };
        let waves =
            |order, quantised| Convolution { map, filter, order, quantised, ..Default::default() };
        let (bytes, more_bytes, floats) = (waves(8, true), waves(16, true), waves(16, false));
        let layered = Lvsm { map, filter, layers: 4, ..Lvsm::default() };
        let squares = MultipleDepth { map, radius, depths: 2, n_buffer: true };
        // A layer holds two waves, and lies between passes in floats. An N-buffer's levels are made in place, 9 for 256
        // texels.
        let table = Savsm { map, radius: radius as f32, follow_pixels: false, ..Savsm::default() };
        let table_of_floats = Savsm { table: Table::Float, ..table };
        // What the mean does not tell is asked texel by texel.
        let side = 2 * radius + 2;
        let deeper = Esm { map, filter, fallback: Fallback::Deeper, ..Esm::default() };
        let configs: [(&str, &dyn TechniqueConfig, Cost); 18] = [
            ("vsm", &Vsm { map, filter, ..Vsm::default() }, cost(8, 8, 1, 4)),
            ("lvsm", &layered, cost(4 * 8, 8, 4, 4)),
            ("esm", &Esm { map, filter, ..Esm::default() }, cost(4, 4, 1, 4)),
            ("esm, largest depth", &deeper, cost(8, 8, 1, u64::from(8 + side * side))),
            ("blurred depth", &BlurredDepth { map, filter }, cost(4, 4, 1, 4)),
            ("soft", &SoftComparison { map, filter, ..Default::default() }, cost(4, 4, 1, 4)),
            ("evsm", &Evsm { map, filter, ..Evsm::default() }, cost(16, 16, 1, 4)),
            ("evsm 2", &Evsm { map, filter, both: false, ..Evsm::default() }, cost(8, 8, 1, 4)),
            ("msm 16", &Msm { map, filter, quantised: true, ..Msm::default() }, cost(8, 16, 1, 4)),
            ("msm", &Msm { map, filter, ..Msm::default() }, cost(16, 16, 1, 4)),
            ("power", &PowerFunction { map, filter, ..PowerFunction::default() }, cost(8, 8, 1, 4)),
            ("8 waves in bytes", &bytes, cost(16, 16, 4, 16)),
            ("16 waves in bytes", &more_bytes, cost(8 * 4, 16, 8, 32)),
            ("16 waves", &floats, cost(8 * 16, 16, 8, 32)),
            ("ends", &MultipleDepth { n_buffer: false, ..squares }, cost(8, 8, 1, 1)),
            ("N-buffer", &squares, cost(9 * 8, 0, 1, 4)),
            ("table", &table, cost(8, 8, 1, 16)),
            ("table of floats", &table_of_floats, cost(8, 8, 1, 16)),
        ];
        for (name, config, cost) in configs {
            let mut technique = config.build(&gpu).expect("a valid config");
            let shot = stage.shoot(&gpu, &light, technique.as_mut(), 0).expect("a shot");
            let of = |name: &str| shot.counters[name];
            assert_eq!(of("fetches"), 64 * 64 * cost.fetches, "{name}, {radius}: fetches");
            assert_eq!(of("store_layers"), cost.layers, "{name}, {radius}: layers");
            let texels = SIZE * SIZE;
            let (passes, taps) = match cost {
                // Level by level, each of four texels of the one before.
                Cost { between: 0, .. } => (9, 4 * 9 - 3),
                Cost { fetches: 16, layers: 1, .. } => (2, 2 * 2),
                _ => (2 * cost.layers, 2 * cost.layers * (2 * u64::from(radius) + 1)),
            };
            assert_eq!(of("store_texels"), passes * texels, "{name}, {radius}: texels");
            assert_eq!(of("store_taps"), taps * texels, "{name}, {radius}: taps");
            let store = shot.bytes - map_bytes;
            let stated = (cost.stored + cost.between) * texels;
            assert!(
                (0..16384).contains(&(store - stated)),
                "{name}, {radius}: {store}, not {stated}"
            );
        }
    }
}

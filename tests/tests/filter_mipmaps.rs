//! Lookups over a pixel's footprint in a mipmapped store, on the GPU against their f64 twin.

use antumbra_filter::{Esm, Fallback, Footprint, Msm, Prefilter, Vsm, twin::Probe};
use antumbra_gpu::{
    BlurShader, Gpu, GpuError, LayerJob, Pyramid, PyramidKind, Recorder, TechniqueConfig, bind,
    read_buffer,
};
use antumbra_map::{Estimator, MapConfig, MapTechnique};
use antumbra_measure::Stage;
use antumbra_scene::{LightKind, generate};
use antumbra_shaders::{link_source, module, source};
use antumbra_tests::{Random, gpu, image};

/// Unit roundoff of f32.
const U: f64 = 1.0 / 16_777_216.0;

/// Texels of the image, a side.
const SIZE: u32 = 64;

/// Of the filter that went before, in texels: nothing.
const REACH: f64 = 1.0;

const LOOKUPS: &str = "
import package::common::lookup::{Lookup};
import package::filter::mipmapped::{Map, probe_of, fetch};
import package::filter::footprint::{queries};

@group(0) @binding(1) var<storage, read_write> found: array<array<vec4f, 2>>;
@group(0) @binding(2) var map: Map;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= arrayLength(&found) { return; }
    var at: Lookup;
    at.texel = queries[id.x].texel;
    let probe = probe_of(map, at, id.xy);
    found[id.x][0] = vec4f(fetch(map, at, probe).x, probe.kernel.middle, select(0.0, 1.0, probe.kernel.cut));
    found[id.x][1] = vec4f(probe.kernel.reach, probe.kernel.square);
}";

/// Stands in for the camera: footprints are given.
const GIVEN: &str = "
struct Query {
    sides: mat2x2f,
    texel: vec2f,
}

@group(0) @binding(0) var<storage, read> queries: array<Query>;

fn footprint(pixel: vec2u, size: vec2f) -> mat2x2f {
    return queries[pixel.x].sides;
}";

/// Two sides of a footprint, and where in the image it lies.
type Query = [f32; 6];

/// What an image's mipmap holds over footprints: value, middle, cut, reach and square.
fn lookups(gpu: &Gpu, texels: &[f32], footprint: Footprint, queries: &[Query]) -> Vec<[f32; 8]> {
    let format = wgpu::TextureFormat::R32Float;
    let mean = "gpu::mean::arithmetic";
    let shader = BlurShader { texel: "gpu::stored_texel", mean, slots: Vec::new(), format };
    let mut pyramid = Pyramid::new(gpu, PyramidKind::Mip, &shader).expect("a valid pyramid");
    pyramid.prepare(gpu, &image(gpu, SIZE, texels), SIZE, &[LayerJob::default()]).expect("room");
    let config = format!(
        "const REACH: f32 = {REACH:?};\nconst SQUARE: f32 = 0.0;\nconst LARGEST: f32 = {:?};\n\
         const LOOKUPS: f32 = {:?};\n",
        footprint.largest as f32, footprint.lookups as f32
    );
    let slots = [
        module("mean", mean),
        source("config", config),
        source("filter::footprint", GIVEN.to_owned()),
    ];
    let wgsl = link_source("tests::lookups", LOOKUPS, &slots).expect("it links");
    let pipeline = gpu.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: Some("lookups"),
        layout: None,
        module: &gpu.shader("lookups", wgsl),
        entry_point: Some("main"),
        compilation_options: Default::default(),
        cache: None,
    });
    let storage = wgpu::BufferUsages::STORAGE;
    let given = gpu.buffer("queries", bytemuck::cast_slice(queries), storage);
    let bytes = (queries.len() * 32) as u64;
    let zeros = vec![0; bytes as usize];
    let found = gpu.buffer("found", &zeros, storage | wgpu::BufferUsages::COPY_SRC);
    let map = pyramid.mips_view().expect("levels");
    let group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: Some("lookups"),
        layout: &pipeline.get_bind_group_layout(0),
        entries: &[bind::buffer(0, &given), bind::buffer(1, &found), bind::texture(2, map)],
    });
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    let mut recorder = Recorder::new(&mut encoder);
    pyramid.encode(&mut recorder, "test");
    let mut pass = recorder.compute_pass("lookups");
    pass.set_pipeline(&pipeline);
    pass.set_bind_group(0, &group, &[]);
    pass.dispatch_workgroups((queries.len() as u32).div_ceil(64), 1, 1);
    drop(pass);
    gpu.queue.submit([encoder.finish()]);
    bytemuck::pod_collect_to_vec(&read_buffer(gpu, &found, bytes).expect("read back"))
}

/// Footprints from a thousandth of a texel to many times the image, of any shape, within the image and at its border.
fn queries(random: &mut Random, count: usize) -> Vec<Query> {
    let mut vector = |longest: f64| {
        let (angle, length) = (std::f64::consts::TAU * random.unit(), random.unit());
        let length = longest * (length * 12.0).exp2() / 4096.0;
        [length * angle.cos(), length * angle.sin()]
    };
    let sides: Vec<_> = (0..count).map(|_| [vector(100.0), vector(30.0)]).collect();
    let texel = |random: &mut Random| (f64::from(SIZE) * random.unit()) as f32;
    let query = |[a, b]: [[f64; 2]; 2]| {
        let [x, y] = [texel(random), texel(random)];
        [a[0] as f32, a[1] as f32, b[0] as f32, b[1] as f32, x, y]
    };
    sides.into_iter().map(query).collect()
}

#[test]
fn lookups_over_footprints_are_those_of_their_twin_and_know_their_kernel() {
    let gpu = gpu();
    let mut random = Random(5);
    let texels: Vec<f32> = (0..SIZE * SIZE).map(|_| random.unit() as f32).collect();
    let queries = queries(&mut random, 100_000);
    for footprint in [Footprint::default(), Footprint { largest: 8, lookups: 1 }] {
        let found = lookups(&gpu, &texels, footprint, &queries);
        let filter = Prefilter { radius: 0, footprint: Some(footprint), ..Prefilter::default() };
        let mut compared = [0; 4];
        for (query, found) in queries.iter().zip(&found) {
            let [ax, ay, bx, by, x, y] = query.map(f64::from);
            let probe = Probe::new([[ax, ay], [bx, by]], footprint, SIZE);
            let found = found.map(f64::from);
            // The number of lookups is what rounding could change by one.
            let [a, b] = [ax.hypot(ay), bx.hypot(by)];
            let ratio = a.max(b).min(footprint.largest.into()) / a.min(b).max(1.0);
            if (ratio - ratio.round()).abs() < 1e-5 && ratio > 1.5 {
                continue;
            }
            let weights = probe.weights([x, y]);
            let last = i64::from(SIZE) - 1;
            let value = |[i, j]: [i64; 2]| {
                f64::from(texels[(j.clamp(0, last) * (last + 1) + i.clamp(0, last)) as usize])
            };
            let sum: f64 = weights.iter().map(|(_, w)| w).sum();
            assert!((sum - 1.0).abs() < 1e-12, "weights of {probe:?} add to {sum}");
            let inside = weights.iter().all(|(at, _)| at.iter().all(|i| (0..=last).contains(i)));
            // Beyond the border texels of a level repeat, not those of the image.
            if inside {
                let expected: f64 = weights.iter().map(|(at, w)| w * value(*at)).sum();
                // A coordinate is rounded 4 times at a magnitude of up to 1.5 images, and moves a mean by no more than as
                // many texels on either axis. The level is off by what a logarithm may be (WGSL, 17.6), 2^-21.
                let moved = 2.0 * 4.0 * 1.5 * f64::from(SIZE) * U;
                let tolerance = moved + 2f64.powi(-21) + filter.rounding();
                let error = (found[0] - expected).abs();
                assert!(error <= tolerance, "{query:?}: off by {error}, more than {tolerance}");
            }
            for axis in 0..2 {
                let offset = |at: &[i64; 2]| at[axis] as f64 + 0.5 - [x, y][axis];
                let moment =
                    |n: i32| weights.iter().map(|(at, w)| w * offset(at).powi(n)).sum::<f64>();
                let (mean, square) = (moment(1), moment(2));
                assert!(mean.abs() < 1e-9, "{probe:?} lies {mean} beside");
                let (reach, claimed) = (found[4 + axis], found[6 + axis]);
                let slack = 1e-5 * (1.0 + claimed);
                assert!(square <= claimed + slack, "{query:?}: {square}, not {claimed}");
                let farthest =
                    weights.iter().map(|(at, w)| if *w > 1e-12 { offset(at).abs() } else { 0.0 });
                let farthest = farthest.fold(0.0, f64::max);
                assert!(farthest <= reach + 1e-4, "{query:?}: reaches {farthest}, not {reach}");
                assert!(reach <= filter.reach() + 1e-4, "{query:?}: {reach} of {}", filter.reach());
            }
            assert!(inside || found[3] == 1.0, "{query:?} is cut and does not know");
            compared[0] += usize::from(inside);
            compared[1] += usize::from(inside && probe.count > 1);
            compared[2] += usize::from(inside && probe.level > 1.0);
            compared[3] += usize::from(!inside);
        }
        let most = [20_000, if footprint.lookups > 1 { 3_000 } else { 0 }, 1_000, 1_000];
        for (count, least) in compared.into_iter().zip(most) {
            assert!(count >= least, "{footprint:?}: {compared:?}");
        }
    }
}

#[test]
fn where_a_map_is_magnified_a_lookup_is_bilinear() {
    let gpu = gpu();
    let mut random = Random(6);
    let texels: Vec<f32> = (0..SIZE * SIZE).map(|_| random.unit() as f32).collect();
    let small = |q: Query| [0.3 * q[0] / 100.0, 0.0, 0.0, q[3] / 100.0, q[4], q[5]];
    let queries: Vec<Query> = queries(&mut random, 10_000).into_iter().map(small).collect();
    let found = lookups(&gpu, &texels, Footprint::default(), &queries);
    let plain: Vec<Query> = queries.iter().map(|q| [0.0, 0.0, 0.0, 0.0, q[4], q[5]]).collect();
    let expected = lookups(&gpu, &texels, Footprint { largest: 2, lookups: 1 }, &plain);
    assert_eq!(found, expected, "footprints below a texel");
}

#[test]
fn settings_that_a_store_cannot_serve_are_refused_with_a_fix() {
    let gpu = gpu();
    let refused = |result: Result<_, GpuError>, what: &str| match result.map(|_| ()) {
        Err(GpuError::Invalid { what: found, fix, .. }) => {
            assert_eq!(found, what);
            assert!(!fix.is_empty(), "{what} has no fix");
        }
        other => panic!("{what}: {other:?}"),
    };
    let of = |filter| Msm { filter, ..Msm::default() }.technique(&gpu);
    let none = Prefilter::default();
    let grown = |footprint| Prefilter { footprint: Some(footprint), ..none };
    assert!(of(grown(Footprint::default())).is_ok(), "the defaults");
    for largest in [0, 1, 3, 128, u32::MAX] {
        let footprint = Footprint { largest, ..Footprint::default() };
        refused(of(grown(footprint)), "filter.footprint.largest");
    }
    for lookups in [0, 17, u32::MAX] {
        let footprint = Footprint { lookups, ..Footprint::default() };
        refused(of(grown(footprint)), "filter.footprint.lookups");
        // What theory says is asked of settings that nobody has checked.
        let _ = Msm { filter: grown(footprint), ..Msm::default() }.expectation("HC-04 thin wall");
    }
    for samples in [0, 3, 8] {
        refused(of(Prefilter { samples, ..none }), "filter.samples");
    }
    let quantised = Msm { quantised: true, filter: grown(Footprint::default()), ..Msm::default() };
    refused(quantised.technique(&gpu), "filter.footprint");
    let odd = MapConfig { size: 333, ..MapConfig::default() };
    let filter = Prefilter { samples: 2, ..none };
    refused(Msm { map: odd, filter, ..Msm::default() }.technique(&gpu), "filter.samples");
    let fallback = Fallback::Deeper;
    refused(Esm { filter, fallback, ..Esm::default() }.technique(&gpu), "filter.samples");
    let filter = grown(Footprint::default());
    refused(Esm { filter, fallback, ..Esm::default() }.technique(&gpu), "filter.footprint");
}

#[test]
fn samples_shrink_a_store_and_levels_add_a_third() {
    const SIDE: u64 = 256;
    let gpu = gpu();
    let scene = generate::sphere_over_plane(&Default::default());
    let stage = Stage::new(&gpu, &scene, scene.camera_or_framing(), 64, 64).expect("a stage");
    let light = scene.place_light(LightKind::Directional);
    let map = MapConfig { size: SIDE as u32, ..MapConfig::default() };
    let shoot = |technique: &mut MapTechnique| {
        let shot = stage.shoot(&gpu, &light, technique, 0).expect("a shot");
        (shot.counters, shot.bytes)
    };
    let mut plain = MapTechnique::new(&gpu, &map, Estimator::nearest()).expect("a valid config");
    let (_, map_bytes) = shoot(&mut plain);
    let of = |filter| {
        let config = Vsm { map, filter, ..Vsm::default() };
        let (counters, bytes) = shoot(&mut config.technique(&gpu).expect("a valid config"));
        let work = ["store_texels", "store_taps", "fetches"].map(|name| counters[name]);
        (work, bytes - map_bytes)
    };
    let filter = Prefilter::default();
    let taps = 2 * u64::from(filter.radius) + 1;
    let close = |found: u64, stated: u64| (stated..stated + 16384).contains(&found);
    for samples in [2, 4] {
        let texels = (SIDE / samples).pow(2);
        let (work, bytes) = of(Prefilter { samples: samples as u32, ..filter });
        let stated = [2 * texels, 2 * texels * taps + texels * samples * samples, 4 * 64 * 64];
        assert_eq!(work, stated, "{samples} samples a side");
        assert!(close(bytes, 16 * texels), "{samples} samples a side: {bytes} bytes");
    }
    let texels = SIDE * SIDE;
    // Levels of 128, 64 .. 1.
    let halved = (texels - 1) / 3;
    let footprint = Footprint::default();
    let (work, bytes) = of(Prefilter { footprint: Some(footprint), ..filter });
    let lookups = u64::from(footprint.lookups);
    let stated =
        [3 * texels + halved, 2 * texels * taps + texels + 4 * halved, 8 * lookups * 64 * 64];
    assert_eq!(work, stated, "with levels");
    assert!(close(bytes, 16 * texels + 8 * (texels + halved)), "with levels: {bytes} bytes");
}

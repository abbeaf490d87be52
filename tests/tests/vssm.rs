//! Variance soft shadow mapping: its twin, exact behind one plate, and what two moments cannot tell.

use crate::shared::area;

use antumbra::Config;
use antumbra_gpu::{Gpu, bind, read_buffer, wgpu};
use antumbra_map::{Bias, MapConfig, Plain};
use antumbra_reference::{SampleClass, TruthOptions};
use antumbra_scene::{Light, generate};
use antumbra_shaders::{link_source, module, source};
use antumbra_soft::twin::View;
use antumbra_soft::twin::techniques::{Map, Receiver};
use antumbra_soft::twin::vssm::Table;
use antumbra_soft::{Hierarchy, Pcss, Vssm};
use antumbra_tests::{Random, gpu};
use area::{below_a_square_light, bodies, lights, map, plate, seen, shoot, shots};
use glam::{DMat4, DVec2, DVec3, DVec4};

fn vssm(size: u32) -> Vssm {
    Vssm { map: map(size), ..Vssm::default() }
}

#[test]
fn behind_one_plate_the_answer_is_the_closed_form() {
    let gpu = gpu();
    let center = DVec3::new(0.0, 4.0, 0.0);
    let (x, z) = (DVec3::X, DVec3::Z);
    for light in [
        Light::Rect { center, half_u: x * 0.5, half_v: z * 0.3 },
        Light::Disc { center, radius: 0.5, axis_u: x, axis_v: z },
        Light::Sphere { center, radius: 0.5 },
        Light::Directional { direction: DVec3::NEG_Y, angular_diameter: 0.3 },
    ] {
        let plate = plate(&gpu, light, 1.6);
        for size in [512, 1024] {
            let (rmse, width) = plate.errors(&gpu, &Config::Vssm(vssm(size)));
            assert!(rmse <= 0.01, "map {size} under {light:?}: RMSE {rmse}");
            assert!(width.abs() <= 0.03, "map {size} under {light:?}: width off by {width}");
        }
        // The control: a floor on the variance that is a third of the depth range.
        let blurred = Vssm { deviation: 0.3, ..vssm(512) };
        let (rmse, _) = plate.errors(&gpu, &Config::Vssm(blurred));
        assert!(rmse > 0.03, "a floor on the variance under {light:?}: RMSE {rmse}");
    }
}

#[test]
fn what_two_moments_cannot_tell_stays_untold() {
    let gpu = gpu();
    let at = |sheets: &[(f64, f64, f64)], x, config| {
        below_a_square_light(&gpu, sheets, x, &Config::Vssm(config))
    };
    let open = Vssm { umbra: false, ..vssm(512) };
    // Light slips between two half-planes of different depth: 0.4375, which the light's centre does not see.
    let slit = [(-50.0, 0.0, 2.0), (0.0, 50.0, 8.0)];
    // A cone lets some of the farther one count as the receiver's own surface, and so keeps it from being taken for umbra.
    let bias = Bias { cone: 0.0, ..Bias::default() };
    let umbra = Vssm { map: MapConfig { bias, ..map(512) }, ..Vssm::default() };
    let found = at(&slit, -0.5, umbra);
    assert!(found < 0.02, "slit, taken for umbra: {found}");
    let found = at(&slit, -0.5, open);
    assert!(found < 0.3, "slit, by moments: {found}");
    // One strip in another's shadow: 0 is true, and the hidden one is not in the map.
    let hidden = [(-0.2, 0.2, 2.0), (-0.35, 0.35, 8.0)];
    let found = at(&hidden, 0.0, open);
    assert!(found > 0.4, "hidden: {found}");
    // One sheet alone is exact: the ramp 1/2 + x / 2 behind x < 0 at half the distance.
    for x in [-0.8, -0.5, 0.0, 0.3, 0.8] {
        let found = at(&[(-8.0, 0.0, 5.0)], x, open);
        let truth = 0.5 + 0.5 * x as f32;
        assert!((found - truth).abs() < 0.02, "a half-plane at {x}: {found}, not {truth}");
    }
}

#[test]
fn a_light_without_an_extent_gives_the_plain_maps_answer() {
    let gpu = gpu();
    let stage = seen(&gpu, &bodies(), 64);
    let all = lights(0.0);
    let pairs = || all.iter().map(|light| (&stage, light));
    let plain = shots(&gpu, &Config::Plain(Plain { map: map(128) }), pairs());
    let found = shots(&gpu, &Config::Vssm(vssm(128)), pairs());
    for ((found, plain), light) in found.iter().zip(&plain).zip(&all) {
        let other = found.0.iter().zip(&plain.0).filter(|(a, b)| a != b).count();
        assert_eq!(other, 0, "of {} under {light:?}", plain.0.len());
    }
    // The control: an extent shows.
    let soft = shoot(&gpu, &stage, &lights(0.5)[1], &Config::Vssm(vssm(128)));
    assert!(soft.iter().any(|v| *v > 0.0 && *v < 1.0), "no penumbra");
}

#[test]
fn lights_of_any_size_give_numbers_from_0_to_1_for_as_many_fetches() {
    let gpu = gpu();
    let stage = seen(&gpu, &bodies(), 32);
    let mut all: Vec<Light> = [1e-7, 1e-3, 0.3, 4.0, 100.0].into_iter().flat_map(lights).collect();
    all.sort_by_key(|light| light.position().is_none());
    let found = shots(&gpu, &Config::Vssm(vssm(64)), all.iter().map(|light| (&stage, light)));
    for ((found, counters), light) in found.iter().zip(&all) {
        let wrong = found.iter().find(|v| !(0.0..=1.0).contains(*v));
        assert_eq!(wrong, None, "under {light:?}");
        assert_eq!(counters["fetches"], 32 * 32 * 32, "under {light:?}");
    }
}

#[test]
fn a_lone_convex_body_shadows_nothing() {
    let gpu = gpu();
    let options = TruthOptions { light_samples: 64, ..TruthOptions::default() };
    let mut judged = 0;
    for name in ["convex-sphere", "convex-cube"] {
        let stage = seen(&gpu, &generate::by_name(name).expect("a scene"), 40);
        let mut all: Vec<Light> = [0.05, 1.0].into_iter().flat_map(lights).collect();
        all.sort_by_key(|light| light.position().is_none());
        let pairs = all.iter().map(|light| (&stage, light));
        for ((found, _), light) in shots(&gpu, &Config::Vssm(vssm(128)), pairs).iter().zip(&all) {
            let truth = stage.truth(light, &options);
            let is_lit =
                |i: &usize| truth.class[*i] == SampleClass::Counted && truth.visibility[*i] == 1.0;
            let lit: Vec<f32> = (0..found.len()).filter(is_lit).map(|i| found[i]).collect();
            judged += lit.len();
            let acne = lit.iter().filter(|v| **v < 0.95).count();
            assert_eq!(acne, 0, "{name}: of {} samples under {light:?}", lit.len());
        }
    }
    assert!(judged > 3_000, "{judged} samples");
}

#[test]
fn it_errs_no_more_than_taps_do() {
    let gpu = gpu();
    let half = 0.6;
    let light = Light::Rect {
        center: DVec3::new(0.5, 6.0, 0.5),
        half_u: DVec3::X * half,
        half_v: DVec3::Z * half,
    };
    let stage = seen(&gpu, &generate::by_name("sphere").expect("a scene"), 96);
    let options = TruthOptions { light_samples: 256, ..TruthOptions::default() };
    let truth = stage.truth(&light, &options);
    let error = |config: &Config| {
        let found = shoot(&gpu, &stage, &light, config);
        let counted = |i: &usize| truth.class[*i] == SampleClass::Counted;
        let squares: Vec<f64> = (0..found.len())
            .filter(counted)
            .map(|i| f64::from(found[i] - truth.visibility[i]).powi(2))
            .collect();
        (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
    };
    let found = error(&Config::Vssm(vssm(512)));
    let taps = error(&Config::Pcss(Pcss { map: map(512), ..Pcss::default() }));
    assert!(found < 1.5 * taps, "VSSM {found}, PCSS {taps}");
}

const SIZE: i32 = 48;

/// A map that is a formula: layers of slats and a slope.
fn formula(x: i32, y: i32) -> f64 {
    match (x / 5 + y / 7) % 4 {
        0 => 0.5,
        1 => 0.25 + f64::from(x) / 1024.0,
        2 => 0.125 + f64::from(y) / 2048.0,
        _ => 0.0,
    }
}

/// The store with that formula in the map's place, and the table in a buffer.
const FORMULA: &str = "
import package::config::{SCALE};
alias Map = i32;
alias Sampler = i32;
alias Sum = vec2u;
@group(0) @binding(1) var<storage, read> table: array<vec2u>;
fn sum_before(map: Map, at: vec2i, layer: i32) -> Sum {
    let last = min(at, vec2i(48)) - 1;
    if any(last < vec2i(0)) {
        return Sum();
    }
    return table[last.x + 48 * last.y];
}
fn number(sum: Sum) -> vec4f {
    return vec4f(vec2f(sum), 0.0, 0.0);
}
fn moments(mean: vec4f) -> vec2f {
    return vec2f(mean.x / SCALE - 0.5, 0.25 * mean.y / SCALE);
}
";

const VISIBILITY: &str = "
import package::common::lookup::{Lookup};
import package::soft::area::{seen};
import package::estimator::{visibility};

@group(0) @binding(0) var<storage, read> receivers: array<vec4f>;
@group(0) @binding(2) var<storage, read_write> found: array<f32>;
@group(0) @binding(3) var<storage, read> linear: array<vec4f>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if id.x < arrayLength(&receivers) {
        let r = receivers[id.x];
        var at: Lookup;
        at.texel = r.xy;
        at.depth = r.z;
        at.gradient = vec2f(r.w, -0.5 * r.w);
        at.order = -1.0;
        at.linear = linear[0];
        at.last = 1.0;
        found[id.x] = visibility(0, at, seen(0, r.xy, r.z), vec2u(0));
    }
}";

/// `AreaLight` of `soft/area.wesl` with one view.
fn upload(view: &View, kind: f32) -> Vec<f32> {
    let mut data = vec![0f32; 20];
    let mut put = |v: DVec3, w: f64| {
        data.extend([v.x as f32, v.y as f32, v.z as f32, w as f32]);
    };
    put(view.x, view.texels.x);
    put(view.y, view.texels.y);
    put(view.z, if view.perspective { 1.0 } else { 0.0 });
    put(view.u, f64::from(kind));
    put(view.v, view.radius);
    put(DVec3::new(view.a, view.b, view.nearest), 0.0);
    put(view.centre.extend(0.0), 0.0);
    data
}

/// Visibility of each receiver by the shader.
fn shade(
    gpu: &Gpu,
    config: &str,
    table: &Table<'_>,
    light: &[f32],
    receivers: &[[f32; 4]],
) -> Vec<f32> {
    let slots = [
        source("store", FORMULA),
        source("common::depth_map", "alias Map = i32;\nalias Sampler = i32;"),
        module("estimator", "soft::vssm"),
        module("soft::bounds", "soft::no_bounds"),
        module("soft::tally", "soft::no_tally"),
        source("config", config.to_owned()),
    ];
    let mut wgsl = link_source("tests::vssm", VISIBILITY, &slots).expect("it links");
    wgsl.push_str(
        "
fn stored(texel: vec2i) -> f32 {
    let k = (texel.x / 5 + texel.y / 7) % 4;
    if k == 0 { return 0.5; }
    if k == 1 { return 0.25 + f32(texel.x) / 1024.0; }
    if k == 2 { return 0.125 + f32(texel.y) / 2048.0; }
    return 0.0;
}",
    );
    for (from, to) in [
        ("vec2i(textureDimensions(map))", "vec2i(48)"),
        ("vec2f(textureDimensions(map))", "vec2f(48.0)"),
        ("vec2f(textureDimensions(table))", "vec2f(48.0)"),
        ("textureLoad(map, texel, at.layer, 0).x", "stored(texel)"),
    ] {
        wgsl = wgsl.replace(from, to);
    }
    let pipeline = gpu.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: Some("vssm twin"),
        layout: None,
        module: &gpu.shader("vssm twin", wgsl),
        entry_point: Some("main"),
        compilation_options: Default::default(),
        cache: None,
    });
    let storage = wgpu::BufferUsages::STORAGE;
    let linear = table.linear.map(|c| c as f32);
    let result = 4 * receivers.len();
    let given = gpu.buffer("receivers", bytemuck::cast_slice(receivers), storage);
    let sums = gpu.buffer("table", bytemuck::cast_slice(&table.integers()), storage);
    let copied = storage | wgpu::BufferUsages::COPY_SRC;
    let found = gpu.buffer("found", &vec![0; result], copied);
    let linear = gpu.buffer("linear", bytemuck::cast_slice(&linear), storage);
    let light = gpu.buffer("light", bytemuck::cast_slice(light), storage);
    let group = |index, buffers: &[&wgpu::Buffer]| {
        let entries: Vec<_> =
            buffers.iter().enumerate().map(|(i, b)| bind::buffer(i as u32, b)).collect();
        gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("vssm twin"),
            layout: &pipeline.get_bind_group_layout(index),
            entries: &entries,
        })
    };
    let groups = [group(0, &[&given, &sums, &found, &linear]), group(2, &[&light])];
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    let mut pass = encoder.begin_compute_pass(&Default::default());
    pass.set_pipeline(&pipeline);
    pass.set_bind_group(0, &groups[0], &[]);
    pass.set_bind_group(2, &groups[1], &[]);
    pass.dispatch_workgroups(receivers.len().div_ceil(64) as u32, 1, 1);
    drop(pass);
    gpu.queue.submit([encoder.finish()]);
    bytemuck::pod_collect_to_vec(&read_buffer(gpu, &found, result as u64).expect("read back"))
}

#[test]
fn the_shader_is_its_twin_under_every_light() {
    const COUNT: u32 = 512;
    let gpu = gpu();
    let center = DVec3::ZERO;
    let tilted = DVec3::new(0.5, 0.1, 0.3);
    let aslant = tilted.cross(DVec3::new(0.1, 0.2, 0.9));
    let (x, y) = (DVec3::X, DVec3::Y);
    for (light, kind) in [
        (Light::Rect { center, half_u: x * 0.7, half_v: y * 0.4 }, 1.0),
        (Light::Rect { center, half_u: tilted, half_v: aslant }, 1.0),
        (Light::Disc { center, radius: 0.5, axis_u: x, axis_v: y }, 2.0),
        (Light::Sphere { center, radius: 0.6 }, 3.0),
        (Light::Directional { direction: DVec3::NEG_Z, angular_diameter: 0.4 }, 2.0),
    ] {
        let parallel = light.position().is_none();
        // 8 m wide and 10 m deep, or 90 degrees wide with the near plane at 1. Linear depth: from 1 to 9 m off, or from the
        // near plane to 8 m.
        let (clip, linear) = if parallel {
            let clip = DMat4::from_diagonal(DVec4::new(0.25, 0.25, 0.1, 1.0))
                * DMat4::from_translation(DVec3::new(0.1, 0.0, 10.0));
            (clip, [-1.0, 1.0, 0.0, 1.0])
        } else {
            let z = DVec4::new(0.0, 0.0, 0.0, -1.0);
            (DMat4::from_cols(DVec4::X, DVec4::Y, z, DVec4::Z), [-1.0, 1.0, 15.0, 0.0])
        };
        let view = View::new(&clip, f64::from(SIZE), &light);
        let config = Vssm {
            hierarchy: Hierarchy::None,
            umbra: false,
            map: map(SIZE as u32),
            ..Vssm::default()
        };
        let scale = config.numbers().scale();
        let table = Table::new(Map { size: SIZE, depth: &formula }, linear, scale);
        let mut random = Random(9);
        let receivers: Vec<[f32; 4]> = (0..COUNT)
            .map(|_| {
                let [x, y] = [0; 2].map(|_| (random.unit() * 60.0 - 6.0) as f32);
                let depth = (0.08 + 0.34 * random.unit()) as f32;
                [x, y, depth, (0.002 * random.unit()) as f32]
            })
            .collect();
        let rounding = 0.5 / scale + 25.0 * 0.5f64.powi(24);
        let constants = format!(
            "const HIERARCHY: bool = false;\nconst UMBRA: bool = false;\nconst BUDGET: i32 = 64;\n\
             const PARTS: i32 = 4;\nconst STRIPS: i32 = 8;\nconst LEAST_VARIANCE: f32 = 1e-6;\n\
             const SCALE: f32 = {scale:?};\nconst MOST: f32 = 511.0;\nconst ROUNDING: f32 = {rounding:?};\n"
        );
        let found = shade(&gpu, &constants, &table, &upload(&view, kind), &receivers);
        let exact: Vec<f64> = receivers
            .iter()
            .map(|r| {
                let [x, y, depth, g] = r.map(f64::from);
                let light = view.seen(DVec2::new(x, y), depth);
                let gradient = DVec2::new(g, -0.5 * g);
                let receiver = Receiver { light, depth, gradient, cone: DVec2::ZERO };
                table.visibility(&receiver, &config, rounding)
            })
            .collect();
        // P = v / (v + d^2) moves with d by at most 1 / sqrt(v) >= 1 / deviation times the roundings of depth, some 1e-6 of
        // the range: 1e-3; and the second window moves with the first's answer.
        let off: Vec<f64> =
            found.iter().zip(&exact).map(|(a, b)| (f64::from(*a) - b).abs()).collect();
        let worst = off.iter().copied().fold(0.0, f64::max);
        let far = off.iter().filter(|d| **d > 3e-3).count();
        let soft = exact.iter().filter(|v| **v > 0.0 && **v < 1.0).count();
        // A part whose mean lies within rounding of the receiver is divided by one and not by the other.
        assert!(far <= COUNT as usize / 30, "{far} differ under {light:?}, by up to {worst}");
        assert!(soft > COUNT as usize / 20, "only {soft} receivers in penumbra");
    }
}

//! The shaders of soft shadows against their f64 twins, over maps made up for the purpose.

use antumbra_gpu::{Gpu, bind, read_buffer};
use antumbra_scene::Light;
use antumbra_shaders::{Slot, link_source, module, source};
use antumbra_soft::twin::mask::Mask;
use antumbra_soft::twin::techniques::{Map, Receiver};
use antumbra_soft::twin::{Seen, View};
use antumbra_soft::{
    Bitmask, Hierarchy, Occluders, Pattern, Pcss, Samples, SingleSample, WidthLookup, Window,
};
use antumbra_tests::{Random, gpu};
use glam::{DMat4, DVec2, DVec3, DVec4};

/// Runs a shader with the entry point `main` over `count` threads: storage buffers in group 0, the light or what else there is
/// at its bindings in group 2; gives back the last buffer of group 0.
fn run(
    gpu: &Gpu,
    wgsl: String,
    given: &[&[u8]],
    result: usize,
    beside: &[(u32, &[u8])],
    count: u32,
) -> Vec<u8> {
    let pipeline = gpu.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: Some("soft twin"),
        layout: None,
        module: &gpu.shader("soft twin", wgsl),
        entry_point: Some("main"),
        compilation_options: Default::default(),
        cache: None,
    });
    let storage = wgpu::BufferUsages::STORAGE;
    let buffers: Vec<wgpu::Buffer> =
        given.iter().map(|bytes| gpu.buffer("given", bytes, storage)).collect();
    let found = gpu.buffer("found", &vec![0; result], storage | wgpu::BufferUsages::COPY_SRC);
    let mut entries: Vec<_> =
        buffers.iter().enumerate().map(|(i, buffer)| bind::buffer(i as u32, buffer)).collect();
    entries.push(bind::buffer(buffers.len() as u32, &found));
    let group = |index, entries: &[wgpu::BindGroupEntry<'_>]| {
        gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("soft twin"),
            layout: &pipeline.get_bind_group_layout(index),
            entries,
        })
    };
    let first = group(0, &entries);
    let beside: Vec<(u32, wgpu::Buffer)> = beside
        .iter()
        .map(|(binding, bytes)| (*binding, gpu.buffer("beside", bytes, storage)))
        .collect();
    let beside: Vec<_> = beside.iter().map(|(at, buffer)| bind::buffer(*at, buffer)).collect();
    let second = if beside.is_empty() { None } else { Some(group(2, &beside)) };
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    let mut pass = encoder.begin_compute_pass(&Default::default());
    pass.set_pipeline(&pipeline);
    pass.set_bind_group(0, &first, &[]);
    if let Some(second) = &second {
        pass.set_bind_group(2, second, &[]);
    }
    pass.dispatch_workgroups(count.div_ceil(64), 1, 1);
    drop(pass);
    gpu.queue.submit([encoder.finish()]);
    read_buffer(gpu, &found, result as u64).expect("read back")
}

const RECTANGLES: &str = "
import package::soft::mask::{Mask, WORDS, add_rectangle};

@group(0) @binding(0) var<storage, read> rectangles: array<vec4f>;
@group(0) @binding(1) var<storage, read_write> found: array<u32>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if id.x < arrayLength(&rectangles) {
        let r = rectangles[id.x];
        var mask = Mask();
        add_rectangle(&mask, r.xy, r.zw);
        for (var i = 0; i < 4 * WORDS; i++) {
            found[i32(id.x) * 4 * WORDS + i] = mask[i % WORDS][i / WORDS];
        }
    }
}";

#[test]
fn masks_of_a_million_rectangles_are_bit_for_bit_those_of_the_twin() {
    let gpu = gpu();
    let mut random = Random(11);
    for (samples, count) in
        [(Samples::S64, 200_000), (Samples::S256, 700_000), (Samples::S1024, 100_000)]
    {
        let config = source("config", samples.constants());
        let wgsl = link_source("tests::rectangles", RECTANGLES, &[config]).expect("it links");
        let words = Mask::new(samples).words.len();
        // Anywhere, on samples and tile borders, empty and turned inside out.
        let mut corner = || {
            let t = random.unit();
            let value = match (random.unit() * 3.0) as u32 {
                0 => (t * 128.0).floor() / 128.0,
                1 => t * 3.0 - 1.0,
                _ => t,
            };
            value as f32
        };
        for batch in 0..count / 50_000 {
            let rectangles: Vec<[f32; 4]> = (0..50_000).map(|_| [0; 4].map(|_| corner())).collect();
            let given = bytemuck::cast_slice(&rectangles);
            let bytes = run(&gpu, wgsl.clone(), &[given], 50_000 * words * 4, &[], 50_000);
            let found: Vec<u32> = bytemuck::pod_collect_to_vec(&bytes);
            for (r, found) in rectangles.iter().zip(found.chunks(words)) {
                let [x0, y0, x1, y1] = r.map(f64::from);
                let mut mask = Mask::new(samples);
                mask.add_rectangle(DVec2::new(x0, y0), DVec2::new(x1, y1));
                assert_eq!(found, mask.words, "{samples:?}, batch {batch}: {r:?}");
            }
        }
    }
}

#[test]
fn masks_of_any_pattern_are_bit_for_bit_those_of_its_samples_one_by_one() {
    const COUNT: usize = 20_000;
    let gpu = gpu();
    let mut random = Random(17);
    // Whatever is given: few points, on a line, on a grid, twice the same, not a multiple of a word.
    let few = vec![[0.25, 0.5], [0.75, 0.5], [0.75, 0.5], [0.0, 0.999]];
    let grid = (0..256).map(|i| [0.0625 * (i % 16) as f32, 0.0625 * (i / 16) as f32]).collect();
    let loose = (0..300).map(|_| [0; 2].map(|_| random.unit() as f32 * 0.999)).collect();
    let patterns = [
        (Pattern::Jittered, Samples::S1024),
        (Pattern::Hammersley, Samples::S256),
        (Pattern::Poisson, Samples::S64),
        (Pattern::Points(few), Samples::S64),
        (Pattern::Points(grid), Samples::S64),
        (Pattern::Points(loose), Samples::S64),
    ];
    for (pattern, samples) in patterns {
        let tables = pattern.tables(samples).expect("a valid pattern").expect("not of tiles");
        let slots = [
            source("config", tables.constants.clone()),
            module("soft::mask", "soft::pattern_mask"),
        ];
        let wgsl = link_source("tests::rectangles", RECTANGLES, &slots).expect("it links");
        let points = pattern.points(samples).expect("a valid pattern").expect("not of tiles");
        let words = 4 * points.len().div_ceil(128).next_power_of_two();
        // Anywhere, on samples, beyond the light, empty and turned inside out.
        let mut corner = |axis: usize| {
            let t = random.unit() as f32;
            match (random.unit() * 3.0) as u32 {
                0 => points[(t * points.len() as f32) as usize % points.len()][axis],
                1 => t * 3.0 - 1.0,
                _ => t,
            }
        };
        let rectangles: Vec<[f32; 4]> = (0..COUNT).map(|_| [0, 1, 0, 1].map(&mut corner)).collect();
        let given = bytemuck::cast_slice(&rectangles);
        let group = (9, bytemuck::cast_slice(&tables.data));
        let bytes = run(&gpu, wgsl, &[given], COUNT * words * 4, &[group], COUNT as u32);
        let found: Vec<u32> = bytemuck::pod_collect_to_vec(&bytes);
        let mut marked = 0;
        for (r, found) in rectangles.iter().zip(found.chunks(words)) {
            // The shader's test has its words by lane, then by vector.
            let bit = |i: usize| {
                let (vector, lane) = (i / 128, (i / 32) % 4);
                found[lane * (words / 4) + vector] >> (i % 32) & 1 == 1
            };
            for (i, [x, y]) in points.iter().enumerate() {
                let inside = r[0] <= *x && *x < r[2] && r[1] <= *y && *y < r[3];
                assert_eq!(bit(i), inside, "{pattern:?}: sample {i} of {r:?}");
                marked += u32::from(inside);
            }
            let bits: u32 = found.iter().map(|word| word.count_ones()).sum();
            assert!(bits as usize <= points.len(), "bits of no sample: {r:?}");
        }
        assert!(marked > 1000, "{pattern:?}: {marked}, the control");
    }
}

const SIZE: i32 = 48;

const VISIBILITY: &str = "
import package::common::lookup::{Lookup};
import package::soft::area::{seen};
import package::estimator::{visibility};

@group(0) @binding(0) var<storage, read> receivers: array<vec4f>;
@group(0) @binding(1) var<storage, read_write> found: array<f32>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if id.x < arrayLength(&receivers) {
        let r = receivers[id.x];
        var at: Lookup;
        at.texel = r.xy;
        at.depth = r.z;
        at.order = -1.0;
        found[id.x] = visibility(0, at, seen(0, r.xy, r.z), vec2u(0));
    }
}";

/// A map that is a formula, in the place of the texture: layers of slats and a slope, which the twin has too.
const FORMULA: &str = "
import package::common::lookup::{Lookup, reference};
alias Map = i32;
alias Sampler = i32;
fn lit(map: Map, at: Lookup, texel: vec2i) -> f32 {
    return select(0.0, 1.0, at.order * (stored(texel) - reference(at, vec2f(texel) + 0.5)) >= 0.0);
}
";

fn formula(x: i32, y: i32) -> f64 {
    match (x / 5 + y / 7) % 4 {
        0 => 0.5,
        1 => 0.25 + f64::from(x) / 1024.0,
        2 => 0.125 + f64::from(y) / 2048.0,
        _ => 0.0,
    }
}

/// `AreaLight` of `soft/area.wesl` with one view.
fn upload(view: &View, kind: f32) -> Vec<u8> {
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
    bytemuck::cast_slice(&data).to_vec()
}

/// Lights of every shape, level and tilted, and their shape's number.
fn lights() -> [(Light, f32); 5] {
    let center = DVec3::ZERO;
    let tilted = DVec3::new(0.5, 0.1, 0.3);
    [
        (Light::Rect { center, half_u: DVec3::X * 0.7, half_v: DVec3::Y * 0.4 }, 1.0),
        (
            Light::Rect { center, half_u: tilted, half_v: tilted.cross(DVec3::new(0.1, 0.2, 0.9)) },
            1.0,
        ),
        (Light::Disc { center, radius: 0.5, axis_u: DVec3::X, axis_v: DVec3::Y }, 2.0),
        (Light::Sphere { center, radius: 0.6 }, 3.0),
        (Light::Directional { direction: DVec3::NEG_Z, angular_diameter: 0.4 }, 2.0),
    ]
}

fn clip(light: &Light) -> DMat4 {
    if matches!(light, Light::Directional { .. }) {
        // 8 m wide, 10 m deep, reversed.
        return DMat4::from_diagonal(DVec4::new(0.25, 0.25, 0.1, 1.0))
            * DMat4::from_translation(DVec3::new(0.1, 0.0, 10.0));
    }
    // 90 degrees wide, near plane at 1.
    DMat4::from_cols(DVec4::X, DVec4::Y, DVec4::new(0.0, 0.0, 0.0, -1.0), DVec4::Z)
}

/// Visibility of each receiver (texel, depth) by the shader with those slots.
fn shade(gpu: &Gpu, slots: &[Slot], view: &View, kind: f32, receivers: &[[f32; 4]]) -> Vec<f32> {
    let mut wgsl = link_source("tests::visibility", VISIBILITY, slots).expect("it links");
    // The estimators read the map by textureLoad and ask for its size; the formula stands in for both.
    let stored = "
fn stored(texel: vec2i) -> f32 {
    let k = (texel.x / 5 + texel.y / 7) % 4;
    if k == 0 { return 0.5; }
    if k == 1 { return 0.25 + f32(texel.x) / 1024.0; }
    if k == 2 { return 0.125 + f32(texel.y) / 2048.0; }
    return 0.0;
}";
    wgsl.push_str(stored);
    for (from, to) in [
        ("vec2i(textureDimensions(map))", format!("vec2i({SIZE})")),
        ("textureLoad(map, texel, at.layer, 0).x", "stored(texel)".to_owned()),
    ] {
        wgsl = wgsl.replace(from, &to);
    }
    let given = bytemuck::cast_slice(receivers);
    let light = upload(view, kind);
    let bytes =
        run(gpu, wgsl, &[given], receivers.len() * 4, &[(0, &light)], receivers.len() as u32);
    bytemuck::pod_collect_to_vec(&bytes)
}

#[test]
fn estimators_agree_with_their_twins_under_every_light() {
    const COUNT: usize = 512;
    let gpu = gpu();
    let mut random = Random(5);
    let window =
        Window { hierarchy: Hierarchy::None, umbra: false, budget: 64, reach: 0, tally: false };
    for (light, kind) in lights() {
        let view = View::new(&clip(&light), f64::from(SIZE), &light);
        let receivers: Vec<[f32; 4]> = (0..COUNT)
            .map(|_| {
                let [x, y] = [0; 2].map(|_| (random.unit() * 60.0 - 6.0) as f32);
                [x, y, (0.02 + 0.4 * random.unit()) as f32, 0.0]
            })
            .collect();
        let twins: Vec<Receiver> = receivers
            .iter()
            .map(|r| {
                let [x, y, depth, _] = r.map(f64::from);
                let light = view.seen(DVec2::new(x, y), depth);
                Receiver { light, depth, gradient: DVec2::ZERO, cone: DVec2::ZERO }
            })
            .collect();
        let map = Map { size: SIZE, depth: &formula };
        let base = |path, constants: String| {
            let head = "const HIERARCHY: bool = false;\nconst UMBRA: bool = false;\nconst BUDGET: i32 = 64;\n";
            vec![
                source("common::depth_map", FORMULA),
                module("estimator", path),
                module("soft::bounds", "soft::no_bounds"),
                module("soft::tally", "soft::no_tally"),
                source("config", head.to_owned() + &constants),
            ]
        };
        // Areas are sums of up to 2304 terms of at most 1, each off by a few roundings of coordinates of up to 16 lights.
        let compare = |name: &str, found: &[f32], exact: &[f64], close: f64, allowed: usize| {
            let off: Vec<f64> =
                found.iter().zip(exact).map(|(a, b)| (f64::from(*a) - b).abs()).collect();
            let worst = off.iter().copied().fold(0.0, f64::max);
            let far = off.iter().filter(|d| **d > close).count();
            let soft = exact.iter().filter(|v| **v > 0.0 && **v < 1.0).count();
            assert!(far <= allowed, "{name} under {light:?}: {far} differ, by up to {worst}");
            assert!(soft > COUNT / 20, "{name}: only {soft} receivers in penumbra");
        };
        let slots = base("soft::back_projection", String::new());
        let found = shade(&gpu, &slots, &view, kind, &receivers);
        let exact: Vec<f64> =
            twins.iter().map(|at| (1.0 - map.back_projection(at, 64)).max(0.0)).collect();
        compare("areas", &found, &exact, 1e-3, 0);
        for occluders in Occluders::ALL {
            let config = Bitmask { window, occluders, ..Bitmask::default() };
            let (close, tris) =
                (occluders == Occluders::ClosedMicropatch, occluders == Occluders::Microtri);
            let path = match occluders {
                Occluders::Micropatch | Occluders::ClosedMicropatch => "soft::micropatch",
                Occluders::Microquad => "soft::microquad",
                _ => "soft::exact_microquad",
            };
            let constants = config.samples.constants()
                + &format!(
                    "const CLOSE: bool = {close};\nconst TRIS: bool = {tris};\nconst DEEPER: i32 = 0;\n"
                );
            let mut slots = base("soft::bitmask", constants);
            slots.push(module("occluders", path));
            slots.push(module("soft::deeper", "soft::no_deeper"));
            let found = shade(&gpu, &slots, &view, kind, &receivers);
            let exact: Vec<f64> = twins
                .iter()
                .map(|at| {
                    let (mask, all) = map.bitmask(at, &config);
                    1.0 - f64::from(mask.count_in(&all)) / f64::from(all.count())
                })
                .collect();
            // A side of one of up to 100 occluders within 1e-5 of one of 32 lines of samples turns 8 of them: one receiver
            // in 30 at most, by as much.
            compare(&format!("{occluders:?}"), &found, &exact, 1e-6, COUNT / 30);
        }
        for (taps, own) in [(0, false), (64, false), (64, true)] {
            let (search, filter, turn) = (taps, taps, false);
            let config = Pcss { window, search, filter, own, turn, ..Pcss::default() };
            let constants = format!(
                "const SEARCH: i32 = {taps};\nconst FILTER: i32 = {taps};\nconst CENTRE: f32 = 0.0;\nconst OWN: bool = {own};\nconst TURN: bool = false;\n"
            );
            let slots = base("soft::pcss", constants);
            let found = shade(&gpu, &slots, &view, kind, &receivers);
            let exact: Vec<f64> = twins.iter().map(|at| map.pcss(at, &config, 0.0).0).collect();
            // A tap, or the middle of a block, within rounding of a border falls to the other side.
            compare(&format!("PCSS, {taps} taps, own {own}"), &found, &exact, 1e-4, COUNT / 30);
        }
        let found = shade(&gpu, &base("soft::radial", String::new()), &view, kind, &receivers);
        let exact: Vec<f64> = twins.iter().map(|at| map.radial(at)).collect();
        // Of texels equally far off but for rounding either may be the nearest.
        compare("radial search", &found, &exact, 1e-4, COUNT / 30);
        for lookup in [WidthLookup::Texel, WidthLookup::Linear, WidthLookup::Border] {
            let config = SingleSample { lookup, scale: 0.5, ..SingleSample::default() };
            let constants = format!(
                "const LINEAR: bool = {};\nconst BORDER: bool = {};\nconst SCALE: f32 = 0.5;\nconst BIAS: f32 = 0.05;\n",
                lookup != WidthLookup::Texel,
                lookup == WidthLookup::Border,
            );
            let mut slots = base("soft::width", constants);
            let width = "fn width_in(texel: vec2i, layer: i32) -> f32 { return f32((3 * texel.x + 5 * texel.y) % 7); }";
            slots.push(source("soft::width_map", width));
            let found = shade(&gpu, &slots, &view, kind, &receivers);
            let width = |x: i32, y: i32| f64::from((3 * x + 5 * y) % 7);
            let exact: Vec<f64> =
                twins.iter().map(|at| map.single_sample(at, &config, &width)).collect();
            compare(&format!("single sample, {lookup:?}"), &found, &exact, 1e-4, 0);
        }
    }
}

const NAMED: &str = "
import package::soft::area::{seen};
import package::soft::mask::{Mask, WORDS};
import package::soft::named_triangles::{
    add_triangle_of, half_plane, in_view, receiver_from_light, triangle_near
};

/// Texel and depth; normal; place relative to the light.
@group(0) @binding(0) var<storage, read> receivers: array<vec4f>;
@group(0) @binding(1) var<storage, read_write> found: array<u32>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if 3u * id.x < arrayLength(&receivers) {
        let r = receivers[3u * id.x];
        var light = seen(0, r.xy, r.z);
        light.n = receivers[3u * id.x + 1u].xyz;
        light.from_centre = receivers[3u * id.x + 2u].xyz;
        let from_light = receiver_from_light(light);
        let horizon = half_plane(light, from_light, in_view(light, light.n));
        var mask = Mask();
        _ = add_triangle_of(&mask, light, from_light, horizon, triangle_near(light, id.x));
        for (var i = 0; i < 4 * WORDS; i++) {
            found[i32(id.x) * 4 * WORDS + i] = mask[i % WORDS][i / WORDS];
        }
    }
}";

/// A receiver and a triangle, relative to it.
struct Near {
    texel: [f32; 3],
    normal: DVec3,
    corners: [DVec3; 3],
}

/// The half-planes of what the triangle hides above the receiver's horizon, each with how far off rounding may have it. With
/// u = 2^-24 a cross product of a and b is off by 4 u |a| |b| along each axis, and a part along it of a way of length d, whose
/// terms are as long, by 8 u d |a| |b|, for the sides of the light too; normals, whose length is divided by, by as much
/// over that length.
fn planes(light: &Seen, near: &Near) -> Option<[(DVec3, f64); 5]> {
    const ROUNDOFF: f64 = 1.0 / (1u64 << 24) as f64;
    let [a, b, c] = near.corners.map(|corner| light.in_view(corner));
    let [ab, bc, ca, before] = light.hidden_by([a, b, c])?;
    let way = light.receiver_from_light().length() + light.lo.length() + light.hi.length() + 1.0;
    let off = 64.0 * ROUNDOFF * way;
    let of = |p: DVec3, q: DVec3| off * p.length() * q.length();
    let (u, v) = (b - a, c - a);
    let slant = u.length() * v.length() / u.cross(v).length();
    let horizon = light.half_plane(light.in_view(near.normal));
    Some([(ab, of(a, b)), (bc, of(b, c)), (ca, of(c, a)), (before, off * slant), (horizon, off)])
}

#[test]
fn what_a_named_triangle_hides_is_what_the_twins_half_planes_hold() {
    const COUNT: usize = 25_000;
    let gpu = gpu();
    let mut random = Random(31);
    let config = source("config", Samples::S256.constants() + "const REACH: i32 = 2;\n");
    let wgsl = link_source("tests::named", NAMED, &[config]).expect("it links");
    // The control: an edge the other way round.
    let wrong = wgsl.replace("cross(near.b, near.c)", "cross(near.c, near.b)");
    assert_ne!(wgsl, wrong, "the control's edge");
    for (light, kind) in lights() {
        let view = View::new(&clip(&light), f64::from(SIZE), &light);
        let all: Vec<Near> = (0..COUNT)
            .map(|_| {
                let place = |random: &mut Random| (random.unit() * f64::from(SIZE)) as f32;
                let texel =
                    [place(&mut random), place(&mut random), (0.1 + 0.4 * random.unit()) as f32];
                // Around the receiver, from as near as nothing, before and behind it.
                let far = 4.0f64.powi(-(random.below(6) as i32));
                let corners = [0; 3].map(|_| (far * random.vector()).as_vec3().as_dvec3());
                Near { texel, normal: random.vector().normalize(), corners }
            })
            .collect();
        let receivers: Vec<[f32; 4]> = all
            .iter()
            .flat_map(|near| {
                let [x, y, depth] = near.texel;
                let seen = view.seen(DVec2::new(x.into(), y.into()), depth.into());
                let [p, q, r] = seen.receiver_from_light().to_array();
                let place = view.x * p + view.y * q + view.z * r;
                let four = |v: DVec3| v.as_vec3().extend(0.0).to_array();
                [[x, y, depth, 0.0], four(near.normal), four(place)]
            })
            .collect();
        let vertices: Vec<f32> =
            all.iter().flat_map(|n| n.corners).flat_map(|c| c.as_vec3().to_array()).collect();
        let indices: Vec<u32> = (0..3 * COUNT as u32).collect();
        let off = |wgsl: &str| -> (usize, usize) {
            let upload = upload(&view, kind);
            let bytes = run(
                &gpu,
                wgsl.to_owned(),
                &[bytemuck::cast_slice(&receivers)],
                COUNT * 8 * 4,
                &[
                    (0, &upload),
                    (11, bytemuck::cast_slice(&vertices)),
                    (12, bytemuck::cast_slice(&indices)),
                ],
                COUNT as u32,
            );
            let found: Vec<u32> = bytemuck::pod_collect_to_vec(&bytes);
            let (mut wrong, mut hidden) = (0, 0);
            for (near, words) in all.iter().zip(found.chunks(8)) {
                let [x, y, depth] = near.texel.map(f64::from);
                let seen = view.seen(DVec2::new(x, y), depth);
                let near = Near { normal: near.normal.as_vec3().as_dvec3(), ..*near };
                let planes = planes(&seen, &near);
                let mut mask = Mask::new(Samples::S256);
                mask.words.copy_from_slice(words);
                for (s, column, row, at) in mask.samples() {
                    let values =
                        planes.map(|p| p.map(|(g, off)| (g.truncate().dot(at) + g.z, off)));
                    let sure =
                        values.is_none_or(|v| v.iter().all(|(value, off)| value.abs() > *off));
                    let inside = values.is_some_and(|v| v.iter().all(|(value, _)| *value >= 0.0));
                    let mut one = Mask::new(Samples::S256);
                    one.add_sample(s, column, row);
                    hidden += usize::from(inside);
                    wrong += usize::from(sure && (mask.count_in(&one) == 1) != inside);
                }
            }
            (wrong, hidden)
        };
        let (found, hidden) = off(&wgsl);
        assert_eq!(found, 0, "{light:?}: samples that are off, of {hidden} hidden ones");
        assert!(hidden > 100_000, "{light:?}: the trial is not an idle one: {hidden}");
        assert!(off(&wrong).0 > 10_000, "{light:?}: the control");
    }
}

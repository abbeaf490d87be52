//! Windows of summed-area tables on the GPU against their f64 twins.

use antumbra_filter::twin;
use antumbra_gpu::{
    Gpu, LayerJob, Recorder, Sat, SatNumbers, SatShader, bind, read_buffer, sat_rounding,
};
use antumbra_shaders::{link_source, module};
use antumbra_tests::{Random, gpu, image};

/// Unit roundoff of f32.
const U: f64 = 1.0 / 16_777_216.0;

const WINDOWS: &str = "
import package::gpu::sat_window::{window_around, window_mean_over, window_spread};
import package::store::{Map, moments};

@group(0) @binding(0) var<storage, read> queries: array<vec4f>;
@group(0) @binding(1) var<storage, read_write> found: array<array<vec4f, 2>>;
@group(0) @binding(2) var table: Map;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= arrayLength(&queries) { return; }
    let q = queries[id.x];
    let window = window_around(q.xy, q.zw);
    found[id.x][0] = vec4f(moments(window_mean_over(table, window, 0)), 0.0, 0.0);
    found[id.x][1] = window_spread(window, q.xy);
}";

/// What tables say of windows around points, by their half sides.
fn windows_on_gpu(
    gpu: &Gpu,
    table: &Sat,
    numbers: SatNumbers,
    queries: &[[f32; 4]],
) -> Vec<[f32; 8]> {
    let store = match numbers {
        SatNumbers::Fixed { .. } => "filter::table_fixed",
        SatNumbers::Float => "filter::table_float",
    };
    let config = format!("const SCALE: f32 = {:?};", numbers.scale() as f32);
    let slots = [module("store", store), antumbra_shaders::source("config", config)];
    let wgsl = link_source("tests::windows", WINDOWS, &slots).expect("it links");
    let pipeline = gpu.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: Some("windows"),
        layout: None,
        module: &gpu.shader("windows", wgsl),
        entry_point: Some("main"),
        compilation_options: Default::default(),
        cache: None,
    });
    let storage = wgpu::BufferUsages::STORAGE;
    let given = gpu.buffer("queries", bytemuck::cast_slice(queries), storage);
    let zeros = vec![0u8; queries.len() * 32];
    let found = gpu.buffer("found", &zeros, storage | wgpu::BufferUsages::COPY_SRC);
    let view = table.view().expect("made");
    let group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: Some("windows"),
        layout: &pipeline.get_bind_group_layout(0),
        entries: &[bind::buffer(0, &given), bind::buffer(1, &found), bind::texture(2, view)],
    });
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    let mut pass = encoder.begin_compute_pass(&Default::default());
    pass.set_pipeline(&pipeline);
    pass.set_bind_group(0, &group, &[]);
    pass.dispatch_workgroups((queries.len() as u32).div_ceil(64), 1, 1);
    drop(pass);
    gpu.queue.submit([encoder.finish()]);
    let bytes = read_buffer(gpu, &found, zeros.len() as u64).expect("read back");
    bytemuck::pod_collect_to_vec(&bytes)
}

#[test]
fn windows_of_a_table_are_the_twins_and_see_its_border_repeated() {
    const SIZE: i64 = 40;
    const MOST: f64 = 9.0;
    let gpu = gpu();
    let mut random = Random(11);
    // Depth, and the square of signed depth, as they are kept in integers; about the middle in floats.
    let depths: Vec<f32> = (0..SIZE * SIZE).map(|_| random.unit() as f32).collect();
    let queries: Vec<[f32; 4]> = (0..100_000)
        .map(|_| {
            let mut center = || (SIZE as f64 + 8.0) * random.unit() - 4.0;
            let at = [center(), center()];
            let half = [0.5 + (MOST - 0.5) * random.unit(), 0.5 + (MOST - 0.5) * random.unit()];
            [at[0], at[1], half[0], half[1]].map(|v| v as f32)
        })
        .collect();
    let fixed = SatNumbers::fixed(2 * MOST as u32 + 2);
    for numbers in [fixed, SatNumbers::Float] {
        let value = |z: f32| match numbers {
            SatNumbers::Fixed { .. } => [z, (2.0 * z - 1.0).powi(2)],
            SatNumbers::Float => [z - 0.5, (z - 0.5).powi(2)],
        };
        let values: Vec<f32> = depths.iter().flat_map(|z| value(*z)).collect();
        let shader =
            SatShader { texel: "gpu::stored_texel", slots: Vec::new(), channels: 2, numbers };
        let mut table = Sat::new(&gpu, &shader).expect("a valid table");
        let source = image(&gpu, SIZE as u32, &values);
        table.prepare(&gpu, &source, SIZE as u32, &[LayerJob::default()]).expect("room");
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        table.encode(&mut Recorder::new(&mut encoder), "test");
        gpu.queue.submit([encoder.finish()]);
        // Half a step of a value, and what joining sixteen windows rounds; of floats, what sums of the whole table lose,
        // over a window's texel at least.
        let tolerance = match numbers {
            SatNumbers::Fixed { .. } => 0.5 / numbers.scale() + 40.0 * U,
            SatNumbers::Float => 16.0 * sat_rounding(SIZE as u32) * 0.5 * (SIZE * SIZE) as f64,
        };
        let (mut worst, mut beyond) = ([0f64; 2], 0);
        let found = windows_on_gpu(&gpu, &table, numbers, &queries);
        for (query, found) in queries.iter().zip(found) {
            let [x, y, a, b] = query.map(f64::from);
            let axis = |center: f64, half: f64| twin::coverage(center - half, center + half);
            let ((left, across), (top, down)) = (axis(x, a), axis(y, b));
            let (mut m1, mut m2) = (0.0, 0.0);
            for (j, v) in down.iter().enumerate() {
                for (i, u) in across.iter().enumerate() {
                    let clamped = |k: i64| k.clamp(0, SIZE - 1);
                    let at = clamped(top + j as i64) * SIZE + clamped(left + i as i64);
                    let z = f64::from(depths[at as usize]) - 0.5;
                    m1 += u * v * z;
                    m2 += u * v * z * z;
                }
            }
            let spread = |first: i64, weights: &[f64], center: f64| {
                let offsets =
                    weights.iter().zip(first..).map(|(w, k)| (*w, k as f64 + 0.5 - center));
                offsets.fold([0.0; 2], |[mean, square], (w, d)| [mean + w * d, square + w * d * d])
            };
            let [dx, xx] = spread(left, &across, x);
            let [dy, yy] = spread(top, &down, y);
            // A window's own edge is rounded to 2^-24 of the coordinate, which is a part of a texel less or more.
            let edge = 4.0 * 64.0 * U;
            for (v, expected) in found[..2].iter().zip([m1, m2]) {
                worst[0] = worst[0].max((f64::from(*v) - expected).abs() / (tolerance + edge));
            }
            for (v, expected) in found[4..].iter().zip([dx, dy, xx, yy]) {
                let error = (f64::from(*v) - expected).abs();
                worst[1] = worst[1].max(error / (edge * 2.0 * MOST * MOST));
            }
            let cut = |c: f64, h: f64| c < h || c > SIZE as f64 - h;
            beyond += usize::from(cut(x, a) || cut(y, b));
        }
        assert!(worst.iter().all(|w| *w <= 1.0), "{numbers:?}: off by {worst:?} of the bound");
        assert!(worst[0] > 1e-3, "{numbers:?}: off by {worst:?} of the bound: it proves nothing");
        assert!(beyond > 10_000, "{beyond} windows reach beyond the border");
    }
}

//! What a filtering sampler would gain a filterable store: one fetch in the place of four, where the device filters 32-bit
//! floats. GPU time by timestamps; where the device has none, or cannot filter, there is nothing to measure.

use std::time::Duration;

use antumbra_gpu::{Gpu, GpuOptions, Recorder, Timer, bind};
use criterion::{Criterion, criterion_group, criterion_main};

const SIZE: u32 = 1024;

/// As `filter/texels.wesl`.
const BY_HAND: &str = "
fn lookup(at: vec2f) -> vec4f {
    let first = floor(at - 0.5);
    let f = at - 0.5 - first;
    let i = vec2i(first);
    let row0 = mix(texel(i), texel(i + vec2i(1, 0)), f.x);
    let row1 = mix(texel(i + vec2i(0, 1)), texel(i + vec2i(1, 1)), f.x);
    return mix(row0, row1, f.y);
}

fn texel(at: vec2i) -> vec4f {
    let last = vec2i(textureDimensions(map)) - vec2i(1);
    return textureLoad(map, clamp(at, vec2i(0), last), 0, 0);
}";

const BY_SAMPLER: &str = "
@group(0) @binding(2) var filtering: sampler;

fn lookup(at: vec2f) -> vec4f {
    return textureSampleLevel(map, filtering, at / vec2f(textureDimensions(map)), 0, 0.0);
}";

/// A million lookups, next to each other as those of pixels are.
const MAIN: &str = "
@group(0) @binding(0) var map: texture_2d_array<f32>;
@group(0) @binding(1) var<storage, read_write> found: array<vec4f>;

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3u) {
    found[id.y * 1024u + id.x] = lookup(vec2f(id.xy) * 0.97 + vec2f(0.31, 0.17));
}";

fn lookups(c: &mut Criterion) {
    let gpu = Gpu::new(&GpuOptions::default()).expect("a GPU adapter");
    let timer = Timer::new(&gpu, 1);
    let filters = gpu.device.features().contains(wgpu::Features::FLOAT32_FILTERABLE);
    let Some(mut timer) = timer.filter(|_| filters) else { return };
    let sampler = gpu.device.create_sampler(&wgpu::SamplerDescriptor {
        mag_filter: wgpu::FilterMode::Linear,
        min_filter: wgpu::FilterMode::Linear,
        ..Default::default()
    });
    let zeros = vec![0u8; 16 * (SIZE * SIZE) as usize];
    let found = gpu.buffer("found", &zeros, wgpu::BufferUsages::STORAGE);
    let mut group = c.benchmark_group("lookup");
    group.sample_size(20);
    for format in [
        wgpu::TextureFormat::R32Float,
        wgpu::TextureFormat::Rg32Float,
        wgpu::TextureFormat::Rgba32Float,
    ] {
        let descriptor = wgpu::TextureDescriptor {
            label: Some("store"),
            size: wgpu::Extent3d { width: SIZE, height: SIZE, depth_or_array_layers: 1 },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format,
            usage: wgpu::TextureUsages::TEXTURE_BINDING,
            view_formats: &[],
        };
        let view = gpu.create_texture("store", &descriptor).expect("room").create_view(
            &wgpu::TextureViewDescriptor {
                dimension: Some(wgpu::TextureViewDimension::D2Array),
                ..Default::default()
            },
        );
        for (name, lookup) in [("by hand", BY_HAND), ("by sampler", BY_SAMPLER)] {
            let pipeline = gpu.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                label: Some("lookups"),
                layout: None,
                module: &gpu.shader("lookups", MAIN.to_owned() + lookup),
                entry_point: Some("main"),
                compilation_options: Default::default(),
                cache: None,
            });
            let mut entries = vec![bind::texture(0, &view), bind::buffer(1, &found)];
            if name == "by sampler" {
                entries.push(bind::sampler(2, &sampler));
            }
            let bound = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("lookups"),
                layout: &pipeline.get_bind_group_layout(0),
                entries: &entries,
            });
            let mut run = || {
                let mut encoder = gpu.device.create_command_encoder(&Default::default());
                let mut recorder = Recorder::timed(&mut encoder, Some(&mut timer));
                let mut pass = recorder.compute_pass("lookups");
                pass.set_pipeline(&pipeline);
                pass.set_bind_group(0, &bound, &[]);
                pass.dispatch_workgroups(SIZE / 8, SIZE / 8, 1);
                drop(pass);
                timer.finish(&mut encoder);
                gpu.queue.submit([encoder.finish()]);
                timer.read(&gpu).expect("times").total_ms()
            };
            group.bench_function(format!("{format:?}, {name}"), |b| {
                b.iter_custom(|times| {
                    Duration::from_secs_f64((0..times).map(|_| run()).sum::<f64>() * 1e-3)
                });
            });
        }
    }
    group.finish();
}

criterion_group!(benches, lookups);
criterion_main!(benches);

//! Bounds of depth from pyramids on the GPU against searches on the CPU: none leaves a texel of a window out.

use antumbra_gpu::{
    Anchor, Beyond, BlurShader, Gpu, LayerJob, Pyramid, PyramidKind, bind, read_buffer, wgpu,
};
use antumbra_shaders::{link_source, module};
use antumbra_tests::{Random, gpu, submit};

const LAYERS: u32 = 5;

/// Neighbouring threads ask for windows of other sizes in other layers.
const QUERIES: &str = "
import package::soft::bounds::{bounds};

struct Query { window: vec4i, layer: vec4i }

@group(0) @binding(0) var map: texture_2d_array<f32>;
@group(0) @binding(1) var<storage, read> queries: array<Query>;
@group(0) @binding(2) var<storage, read_write> found: array<vec2f>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if id.x < arrayLength(&queries) {
        let query = queries[id.x];
        found[id.x] = bounds(map, query.layer.x, query.window.xy, query.window.zw);
    }
}";

/// Texels [x0, x1) x [y0, y1), and a layer.
#[repr(C)]
#[derive(Clone, Copy, Debug, bytemuck::Pod, bytemuck::Zeroable)]
struct Query {
    window: [i32; 4],
    layer: [i32; 4],
}

/// Where a side of a window begins and ends, short ones as often as long ones.
fn span(random: &mut Random, size: u32) -> (i32, i32) {
    let most = 1 << random.below(7);
    let length = 1 + random.below(most).min(size as usize - 1);
    let first = random.below(size as usize - length + 1);
    (first as i32, (first + length) as i32)
}

/// Layers of depths.
fn layers(gpu: &Gpu, size: u32, values: &[f32]) -> wgpu::TextureView {
    let descriptor = wgpu::TextureDescriptor {
        label: Some("depths"),
        size: wgpu::Extent3d { width: size, height: size, depth_or_array_layers: LAYERS },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: wgpu::TextureFormat::R32Float,
        usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
        view_formats: &[],
    };
    let texture = gpu.create_texture("depths", &descriptor).expect("room");
    let layout = wgpu::TexelCopyBufferLayout {
        offset: 0,
        bytes_per_row: Some(4 * size),
        rows_per_image: Some(size),
    };
    let bytes = bytemuck::cast_slice(values);
    gpu.queue.write_texture(texture.as_image_copy(), bytes, layout, texture.size());
    texture.create_view(&wgpu::TextureViewDescriptor {
        dimension: Some(wgpu::TextureViewDimension::D2Array),
        ..Default::default()
    })
}

/// Greatest and least depth of each window, by the pyramid `kind` of what `texel` makes of the map, and the module `lookup`.
fn ask(
    gpu: &Gpu,
    map: (&wgpu::TextureView, u32),
    (kind, texel, lookup): (PyramidKind, &'static str, &'static str),
    queries: &[Query],
) -> Vec<[f32; 2]> {
    let mean = "gpu::mean::min_max";
    let format = wgpu::TextureFormat::Rg32Float;
    let shader = BlurShader { texel, mean, slots: Vec::new(), format };
    let mut pyramid = Pyramid::new(gpu, kind, &shader).expect("a valid pyramid");
    let jobs: Vec<LayerJob> =
        (0..LAYERS).map(|source| LayerJob { source, ..LayerJob::default() }).collect();
    let halved = texel == "soft::four_texels";
    pyramid.prepare(gpu, map.0, map.1 >> u32::from(halved), &jobs).expect("room");
    let mut slots = vec![module("store", "common::depth_map")];
    if lookup != "soft::bounds" {
        slots.push(module("soft::bounds", lookup));
    }
    let wgsl = link_source("tests::queries", QUERIES, &slots).expect("it links");
    let pipeline = gpu.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: Some("queries"),
        layout: None,
        module: &gpu.shader("queries", wgsl),
        entry_point: Some("main"),
        compilation_options: Default::default(),
        cache: None,
    });
    let storage = wgpu::BufferUsages::STORAGE;
    let given = gpu.buffer("queries", bytemuck::cast_slice(queries), storage);
    let size = queries.len() * size_of::<[f32; 2]>();
    let found = gpu.buffer("found", &vec![0; size], storage | wgpu::BufferUsages::COPY_SRC);
    let group = |index, entries: &[wgpu::BindGroupEntry<'_>]| {
        gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("queries"),
            layout: &pipeline.get_bind_group_layout(index),
            entries,
        })
    };
    let first =
        group(0, &[bind::texture(0, map.0), bind::buffer(1, &given), bind::buffer(2, &found)]);
    let all = [pyramid.mips_view(), pyramid.stack_view()].into_iter().flatten();
    let bound: Vec<_> =
        all.zip([1, 4]).map(|(view, binding)| bind::texture(binding, view)).collect();
    let second = group(2, &bound);
    submit(gpu, |recorder| {
        pyramid.encode(recorder, "test");
        let mut pass = recorder.compute_pass("queries");
        pass.set_pipeline(&pipeline);
        pass.set_bind_group(0, &first, &[]);
        pass.set_bind_group(2, &second, &[]);
        pass.dispatch_workgroups((queries.len() as u32).div_ceil(64), 1, 1);
    });
    let bytes = read_buffer(gpu, &found, size as u64).expect("read back");
    bytemuck::pod_collect_to_vec(&bytes)
}

#[test]
fn windows_of_any_size_in_any_layer_are_bounded_wherever_they_lie() {
    let gpu = gpu();
    let mut random = Random(3);
    let (anchor, beyond) = (Anchor::Corner, Beyond::Repeat);
    // The windows that a lookup may look at, beside its own texels: as many times its longer side, and some texels more.
    let kinds = [
        (PyramidKind::Mip, "soft::four_texels", "soft::bounds", (4, 0)),
        (
            PyramidKind::NBuffer(anchor, beyond),
            "soft::one_texel",
            "soft::bounds_multiscale",
            (1, 0),
        ),
        (
            PyramidKind::YMap { mips: 2, anchor, beyond },
            "soft::four_texels",
            "soft::bounds_y",
            (1, 6),
        ),
    ];
    for size in [64u32, 100] {
        let texels = (LAYERS * size * size) as usize;
        // From 0 to 1, each layer in a range of its own.
        let values: Vec<f32> = (0..texels)
            .map(|i| {
                let within = random.below(1 << 20) as f64 / 2e6;
                ((i / (size * size) as usize) as f64 + within) as f32 / LAYERS as f32
            })
            .collect();
        let queries: Vec<Query> = (0..20_000)
            .map(|_| {
                let ((x0, x1), (y0, y1)) = (span(&mut random, size), span(&mut random, size));
                let layer = random.below(LAYERS as usize) as i32;
                Query { window: [x0, y0, x1, y1], layer: [layer, 0, 0, 0] }
            })
            .collect();
        // Greatest and least depth around a window.
        let brute = |query: &Query, layer: i32, around: i32| {
            let [x0, y0, x1, y1] = query.window;
            let cut = |v: i32| v.clamp(0, size as i32) as usize;
            let (x, y) = (cut(x0 - around)..cut(x1 + around), cut(y0 - around)..cut(y1 + around));
            let at =
                move |x: usize, y: usize| (layer as usize * size as usize + y) * size as usize + x;
            let all = y.flat_map(|y| x.clone().map(move |x| at(x, y))).map(|i| values[i]);
            all.fold([f32::MIN, f32::MAX], |[most, least], v| [most.max(v), least.min(v)])
        };
        let view = layers(&gpu, size, &values);
        for (kind, texel, lookup, (times, more)) in kinds {
            let found = ask(&gpu, (&view, size), (kind, texel, lookup), &queries);
            let mut elsewhere = 0;
            for (query, found) in queries.iter().zip(&found) {
                let layer = query.layer[0];
                let [x0, y0, x1, y1] = query.window;
                let longer = (x1 - x0).max(y1 - y0);
                let within = brute(query, layer, 0);
                // Squares that reach beyond the shorter side on one side of it only, where a border is near.
                let around = brute(query, layer, times * longer + more);
                let holds = |w: [f32; 2]| found[0] >= w[0] && found[1] <= w[1];
                assert!(holds(within), "{lookup}, {size}: {query:?} has {within:?}, not {found:?}");
                let tight = found[0] <= around[0] && found[1] >= around[1];
                assert!(tight, "{lookup}, {size}: {query:?} has {around:?} around, not {found:?}");
                let exact = lookup == "soft::bounds_multiscale" && x1 - x0 == y1 - y0;
                assert!(!exact || *found == within, "{query:?} has {within:?}, not {found:?}");
                elsewhere += u32::from(holds(brute(query, (layer + 1) % LAYERS as i32, 0)));
            }
            // The control: bounds of one layer are none of the next.
            assert_eq!(elsewhere, 0, "{lookup}, {size}: the layers are alike");
        }
    }
    assert_eq!(gpu.check(), Ok(()), "no error from wgpu");
}

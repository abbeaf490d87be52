//! Summed-area tables, mipmaps and N-buffers on the GPU against sums and searches on the CPU.

use antumbra_gpu::{
    Anchor, Beyond, BlurShader, Gpu, LayerJob, Pyramid, PyramidKind, Recorder, Sat, SatNumbers,
    SatShader, bind, read_buffer, read_f32_level, read_f32_texture, read_u32_texture, sat_rounding,
    wgpu,
};
use antumbra_shaders::{link_source, source};
use antumbra_tests::{Random, gpu, image};

/// Unit roundoff of f32.
const U: f64 = 1.0 / 16_777_216.0;

fn sat(gpu: &Gpu, channels: u32, numbers: SatNumbers, size: u32, values: &[f32]) -> wgpu::Texture {
    let shader = SatShader { texel: "gpu::stored_texel", slots: Vec::new(), channels, numbers };
    let mut sat = Sat::new(gpu, &shader).expect("a valid table");
    sat.prepare(gpu, &image(gpu, size, values), size, &[LayerJob::default()]).expect("room");
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    sat.encode(&mut Recorder::new(&mut encoder), "test");
    gpu.queue.submit([encoder.finish()]);
    assert_eq!(sat.texels(), 2 * u64::from(size).pow(2), "texels written");
    sat.texture().expect("made").clone()
}

/// The difference of four numbers of a table, for the texels from (x0, y0) to (x1, y1), both included.
fn window(table: &[u32], size: usize, [x0, y0, x1, y1]: [usize; 4]) -> u32 {
    let at = |x: usize, y: usize| {
        if x == 0 || y == 0 { 0 } else { table[(y - 1) * size + x - 1] }
    };
    at(x1 + 1, y1 + 1)
        .wrapping_sub(at(x0, y1 + 1))
        .wrapping_sub(at(x1 + 1, y0))
        .wrapping_add(at(x0, y0))
}

/// Two ends of a span of up to `most` of `size`.
fn span(random: &mut Random, size: u32, most: u32) -> (usize, usize) {
    let length = random.below(most.min(size) as usize) as u32;
    let first = random.below((size - length) as usize);
    (first, first + length as usize)
}

#[test]
fn windows_of_an_integer_table_are_exact_also_after_it_has_wrapped() {
    let gpu = gpu();
    let mut random = Random(1);
    // One texel, sides that no workgroup divides, and one whose sums exceed 2^32 by a factor of 2^8.
    for (size, most, ones) in
        [(1, 1, false), (3, 3, false), (65, 64, false), (300, 64, false), (1024, 64, true)]
    {
        let numbers = SatNumbers::fixed(most);
        let values: Vec<f32> =
            (0..size * size).map(|_| if ones { 1.0 } else { random.unit() as f32 }).collect();
        let table = read_u32_texture(&gpu, &sat(&gpu, 1, numbers, size, &values), 0).expect("read");
        let scale = numbers.scale() as f32;
        let side = size as usize;
        // Rounded as the shader rounds, half to even.
        let integers: Vec<u64> =
            values.iter().map(|v| (v * scale).round_ties_even() as u64).collect();
        // The whole table, modulo 2^32.
        let mut above = vec![0u64; side];
        for y in 0..side {
            let mut row = 0;
            for x in 0..side {
                row += integers[y * side + x];
                above[x] += row;
                assert_eq!(table[y * side + x], above[x] as u32, "{size}: sum at {x}, {y}");
            }
        }
        assert!(!ones || above[side - 1] > 1 << 39, "no sum of {size} wraps");
        // And windows, from a table of whole numbers.
        let whole: Vec<u64> = {
            let mut whole = vec![0u64; side * side];
            for y in 0..side {
                let mut row = 0;
                for x in 0..side {
                    row += integers[y * side + x];
                    whole[y * side + x] = row + if y > 0 { whole[(y - 1) * side + x] } else { 0 };
                }
            }
            whole
        };
        let exact = |[x0, y0, x1, y1]: [usize; 4]| {
            let at = |x: usize, y: usize| {
                if x == 0 || y == 0 { 0 } else { whole[(y - 1) * side + x - 1] }
            };
            at(x1 + 1, y1 + 1) + at(x0, y0) - at(x0, y1 + 1) - at(x1 + 1, y0)
        };
        for _ in 0..100_000 {
            let ((x0, x1), (y0, y1)) =
                (span(&mut random, size, most), span(&mut random, size, most));
            let rectangle = [x0, y0, x1, y1];
            let found = u64::from(window(&table, side, rectangle));
            assert_eq!(found, exact(rectangle), "{size}: {rectangle:?}");
        }
        // The control: a window beyond the stated one is wrong where its sum exceeds 2^32.
        if ones {
            let all = [0, 0, side - 1, side - 1];
            assert_ne!(u64::from(window(&table, side, all)), exact(all), "all of {size}");
        }
    }
    assert_eq!(gpu.check(), Ok(()), "no error from wgpu");
}

#[test]
fn sums_of_floats_are_off_by_their_bound_at_most_and_constant_planes_show_it() {
    let gpu = gpu();
    let mut random = Random(2);
    for size in [64u32, 512] {
        // Depths about the middle, and their squares.
        let values: Vec<f32> = (0..size * size)
            .flat_map(|_| {
                let x = 0.1 + 0.2 * random.unit() as f32;
                [x, x * x]
            })
            .collect();
        let texture = sat(&gpu, 2, SatNumbers::Float, size, &values);
        let table = read_f32_texture(&gpu, &texture, 0).expect("read");
        let side = size as usize;
        let mut above = vec![[0.0f64; 2]; side];
        let mut worst = 0.0f64;
        for y in 0..side {
            let mut row = [0.0; 2];
            for (x, above) in above.iter_mut().enumerate() {
                for c in 0..2 {
                    let i = 2 * (y * side + x) + c;
                    row[c] += f64::from(values[i]);
                    above[c] += row[c];
                    let error = (f64::from(table[i]) - above[c]).abs() / above[c];
                    worst = worst.max(error / sat_rounding(size));
                }
            }
        }
        assert!(worst <= 1.0, "{size}: off by {worst} of the bound");
        assert!(worst > 1e-3, "{size}: off by {worst} of the bound: it proves nothing");
    }
    // A plane at 0.999 of the range, in windows of 2 x 2 in the corner that is farthest from the first texel: floats
    // see relief, integers none.
    const SIZE: u32 = 512;
    let side = SIZE as usize;
    let corner = |x: usize, y: usize| [x, y, x + 1, y + 1];
    let windows = || (side - 64..side - 1).flat_map(|y| (side - 64..side - 1).map(move |x| (x, y)));
    let plane = vec![0.499f32; side * side];
    let table = read_f32_texture(&gpu, &sat(&gpu, 1, SatNumbers::Float, SIZE, &plane), 0);
    let table = table.expect("read");
    let at = |x: usize, y: usize| f64::from(table[(y - 1) * side + x - 1]);
    let off = windows()
        .map(|(x, y)| {
            let [x0, y0, x1, y1] = corner(x, y);
            let sum = at(x1 + 1, y1 + 1) - at(x0, y1 + 1) - at(x1 + 1, y0) + at(x0, y0);
            (0.25 * sum - 0.499).abs()
        })
        .fold(0.0, f64::max);
    assert!(off > 1e-4, "floats see a plane as flat as {off}");
    let numbers = SatNumbers::fixed(4);
    let plane = vec![0.999f32; side * side];
    let table = read_u32_texture(&gpu, &sat(&gpu, 1, numbers, SIZE, &plane), 0).expect("read");
    let one = (0.999f32 * numbers.scale() as f32).round_ties_even() as u32;
    for (x, y) in windows() {
        assert_eq!(window(&table, side, corner(x, y)), 4 * one, "at {x}, {y}");
    }
}

#[test]
fn unusable_tables_and_pyramids_are_refused_with_a_fix() {
    let gpu = gpu();
    let table = |channels, numbers| {
        let shader = SatShader { texel: "gpu::stored_texel", slots: Vec::new(), channels, numbers };
        Sat::new(&gpu, &shader)
    };
    assert!(table(3, SatNumbers::Float).is_err(), "three channels");
    assert!(table(1, SatNumbers::Fixed { bits: 0 }).is_err(), "no bits");
    assert!(table(1, SatNumbers::Fixed { bits: 25 }).is_err(), "more bits than a float's");
    let y_map = PyramidKind::YMap { mips: 0, anchor: Anchor::Corner, beyond: Beyond::Repeat };
    assert!(Pyramid::new(&gpu, y_map, &averages(1)).is_err(), "a Y map without a level");
    let mut integers = averages(1);
    integers.format = wgpu::TextureFormat::Rg32Uint;
    assert!(Pyramid::new(&gpu, PyramidKind::Mip, &integers).is_err(), "integers");
    assert_eq!(gpu.check(), Ok(()), "nothing reached wgpu");
}

fn averages(channels: u32) -> BlurShader {
    use wgpu::TextureFormat::{R32Float, Rg32Float};
    BlurShader {
        texel: "gpu::stored_texel",
        mean: "gpu::mean::arithmetic",
        slots: Vec::new(),
        format: if channels == 1 { R32Float } else { Rg32Float },
    }
}

fn extremes() -> BlurShader {
    BlurShader { mean: "gpu::mean::min_max", ..averages(2) }
}

fn pyramid(gpu: &Gpu, kind: PyramidKind, shader: &BlurShader, size: u32, v: &[f32]) -> Pyramid {
    let mut pyramid = Pyramid::new(gpu, kind, shader).expect("a valid pyramid");
    pyramid.prepare(gpu, &image(gpu, size, v), size, &[LayerJob::default()]).expect("room");
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    pyramid.encode(&mut Recorder::new(&mut encoder), "test");
    gpu.queue.submit([encoder.finish()]);
    pyramid
}

/// Whole numbers, whose means over powers of two up to 64 x 64 texels are exact in f32: 11 bits and 12 more.
fn whole_numbers(random: &mut Random, size: u32) -> Vec<f32> {
    (0..size * size).map(|_| random.below(2048) as f32).collect()
}

/// The least, the largest and the sum of texels from (x, y) on, `side` a side; beyond the border as `beyond` says for the
/// sum, and left out of the others.
fn brute(values: &[f32], size: i64, (x, y): (i64, i64), side: i64, beyond: Beyond) -> [f64; 3] {
    let mut found = [f64::INFINITY, f64::NEG_INFINITY, 0.0];
    for (i, j) in (x..x + side).flat_map(|i| (y..y + side).map(move |j| (i, j))) {
        let inside = (0..size).contains(&i) && (0..size).contains(&j);
        let (ci, cj) = (i.clamp(0, size - 1), j.clamp(0, size - 1));
        let v = f64::from(values[(cj * size + ci) as usize]);
        if inside {
            found[0] = found[0].min(v);
            found[1] = found[1].max(v);
        }
        if inside || beyond == Beyond::Repeat {
            found[2] += v;
        }
    }
    found
}

#[test]
fn an_n_buffer_holds_every_window_of_a_power_of_two() {
    let gpu = gpu();
    let mut random = Random(3);
    for size in [64u32, 50] {
        let values = whole_numbers(&mut random, size);
        let twice: Vec<f32> = values.iter().flat_map(|v| [*v, *v]).collect();
        let side = i64::from(size);
        for anchor in [Anchor::Corner, Anchor::Middle] {
            for beyond in [Beyond::Repeat, Beyond::Zero] {
                let kind = PyramidKind::NBuffer(anchor, beyond);
                let means = pyramid(&gpu, kind, &averages(1), size, &values);
                let ends = pyramid(&gpu, kind, &extremes(), size, &twice);
                assert_eq!(means.levels(), 6 + u32::from(size == 64), "levels of {size}");
                let bytes = 4 * u64::from(size).pow(2) * u64::from(means.levels());
                assert!((bytes..bytes + 4096).contains(&means.bytes()), "{size}: bytes");
                for level in 0..means.levels() {
                    let read = |p: &Pyramid| {
                        read_f32_texture(&gpu, p.stack().expect("a stack"), level).expect("read")
                    };
                    let (mean, range) = (read(&means), read(&ends));
                    let wide = 1i64 << level;
                    let back = if anchor == Anchor::Middle { wide / 2 } else { 0 };
                    for (x, y) in (0..side).flat_map(|y| (0..side).map(move |x| (x, y))) {
                        let at = (y * side + x) as usize;
                        let first = (x - back, y - back);
                        let [least, most, sum] = brute(&values, side, first, wide, beyond);
                        // Where all beyond is left out; zeros would count among the least.
                        if beyond == Beyond::Repeat {
                            let found = [range[2 * at], range[2 * at + 1]].map(f64::from);
                            assert_eq!(
                                found,
                                [least, most],
                                "{size}, {anchor:?}, {level}: {x} {y}"
                            );
                        }
                        let inside = |a: i64| a >= 0 && a + wide <= side;
                        if anchor == Anchor::Corner || (inside(first.0) && inside(first.1)) {
                            let expected = sum / (wide * wide) as f64;
                            let found = f64::from(mean[at]);
                            assert_eq!(found, expected, "{size}, {kind:?}, {level}: {x} {y}");
                        }
                    }
                }
            }
        }
    }
}

#[test]
fn a_mipmap_leaves_nothing_out() {
    let gpu = gpu();
    let mut random = Random(4);
    for size in [64u32, 50, 1] {
        let values = whole_numbers(&mut random, size);
        let twice: Vec<f32> = values.iter().flat_map(|v| [*v, *v]).collect();
        let means = pyramid(&gpu, PyramidKind::Mip, &averages(1), size, &values);
        let ends = pyramid(&gpu, PyramidKind::Mip, &extremes(), size, &twice);
        let levels = size.ilog2() + 1;
        let mut total = 0;
        for level in 0..levels {
            let read = |p: &Pyramid| {
                read_f32_level(&gpu, p.mips().expect("a mipmap"), 0, level).expect("read")
            };
            let (mean, range) = (read(&means), read(&ends));
            let side = (size >> level).max(1);
            assert_eq!(mean.len() as u32, side * side, "{size}: texels of level {level}");
            total += side * side;
            let wide = i64::from(1u32 << level);
            if size.is_power_of_two() {
                for (x, y) in (0..side).flat_map(|y| (0..side).map(move |x| (x, y))) {
                    let first = (i64::from(x) * wide, i64::from(y) * wide);
                    let [least, most, sum] =
                        brute(&values, i64::from(size), first, wide, Beyond::Repeat);
                    let at = (y * side + x) as usize;
                    assert_eq!(f64::from(mean[at]), sum / (wide * wide) as f64, "level {level}");
                    let found = [range[2 * at], range[2 * at + 1]].map(f64::from);
                    assert_eq!(found, [least, most], "level {level}");
                }
            }
            // Whatever the side, no texel is lost.
            let all = |f: fn(f32, f32) -> f32, v: &mut dyn Iterator<Item = f32>| v.reduce(f);
            let lows = &mut range.iter().step_by(2).copied();
            let highs = &mut range.iter().skip(1).step_by(2).copied();
            let values = || values.iter().copied();
            assert_eq!(all(f32::min, lows), all(f32::min, &mut values()), "{size}: least");
            assert_eq!(all(f32::max, highs), all(f32::max, &mut values()), "{size}: largest");
        }
        assert_eq!(means.texels(), u64::from(total), "{size}: texels written");
    }
}

#[test]
fn a_y_map_is_an_n_buffer_over_a_mip_level_in_the_stated_memory() {
    const SIZE: u32 = 64;
    let gpu = gpu();
    let values = whole_numbers(&mut Random(5), SIZE);
    for mips in [1u32, 2, 3, 7, 20] {
        let kind = PyramidKind::YMap { mips, anchor: Anchor::Corner, beyond: Beyond::Zero };
        let map = pyramid(&gpu, kind, &averages(1), SIZE, &values);
        // N² (sum of 4^-i over the mip levels + (log2 N + 1 - mips) 4^(1 - mips)) texels.
        let j = mips.min(7);
        let texels: u64 = (0..j).map(|i| u64::from(SIZE >> i).pow(2)).sum::<u64>()
            + u64::from(7 - j) * u64::from(SIZE >> (j - 1)).pow(2);
        assert_eq!(map.texels(), texels, "{mips} mip levels");
        let mip = pyramid(&gpu, PyramidKind::Mip, &averages(1), SIZE, &values);
        let level = read_f32_level(&gpu, mip.mips().expect("a mipmap"), 0, j - 1).expect("read");
        let side = SIZE >> (j - 1);
        let stack = map.stack().expect("a stack");
        assert_eq!((stack.width(), map.levels()), (side, 8 - j), "{mips}: the stack");
        for i in 0..map.levels() {
            let found = read_f32_texture(&gpu, stack, i).expect("read");
            for (x, y) in (0..side).flat_map(|y| (0..side).map(move |x| (x, y))) {
                let first = (i64::from(x), i64::from(y));
                let [.., sum] = brute(&level, i64::from(side), first, 1 << i, Beyond::Zero);
                let expected = sum / f64::from(1u32 << (2 * i));
                let found = f64::from(found[(y * side + x) as usize]);
                assert_eq!(found, expected, "{mips}: level {i} at {x}, {y}");
            }
        }
        assert_eq!(map.mips().map_or(0, wgpu::Texture::mip_level_count), j - 1, "{mips}: mips");
    }
}

/// Images of one channel as the layers of an array.
fn layered(gpu: &Gpu, size: u32, layers: &[Vec<f32>]) -> wgpu::TextureView {
    let descriptor = wgpu::TextureDescriptor {
        label: Some("images"),
        size: wgpu::Extent3d {
            width: size,
            height: size,
            depth_or_array_layers: layers.len() as u32,
        },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: wgpu::TextureFormat::R32Float,
        usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
        view_formats: &[],
    };
    let texture = gpu.create_texture("images", &descriptor).expect("room");
    gpu.queue.write_texture(
        texture.as_image_copy(),
        bytemuck::cast_slice(&layers.concat()),
        wgpu::TexelCopyBufferLayout {
            offset: 0,
            bytes_per_row: Some(4 * size),
            rows_per_image: Some(size),
        },
        texture.size(),
    );
    texture.create_view(&wgpu::TextureViewDescriptor {
        dimension: Some(wgpu::TextureViewDimension::D2Array),
        ..Default::default()
    })
}

#[test]
fn each_layer_has_levels_of_its_own_and_room_is_kept() {
    const SIZE: u32 = 16;
    let gpu = gpu();
    let images: Vec<Vec<f32>> =
        (7..10).map(|seed| whole_numbers(&mut Random(seed), SIZE)).collect();
    let source = layered(&gpu, SIZE, &images);
    let jobs = [2u32, 0, 1].map(|source| LayerJob { source, ..LayerJob::default() });
    for kind in [
        PyramidKind::Mip,
        PyramidKind::NBuffer(Anchor::Corner, Beyond::Repeat),
        PyramidKind::YMap { mips: 3, anchor: Anchor::Middle, beyond: Beyond::Zero },
    ] {
        let mut several = Pyramid::new(&gpu, kind, &averages(1)).expect("a valid pyramid");
        let mut kept = None;
        // Fewer layers than before leave the others alone.
        for count in [3usize, 2, 3] {
            several.prepare(&gpu, &source, SIZE, &jobs[..count]).expect("room");
            let mut encoder = gpu.device.create_command_encoder(&Default::default());
            several.encode(&mut Recorder::new(&mut encoder), "test");
            gpu.queue.submit([encoder.finish()]);
            let bytes = several.bytes();
            assert_eq!(*kept.get_or_insert(bytes), bytes, "{kind:?}: {count} layers");
        }
        for (index, job) in jobs.iter().enumerate() {
            let (index, values) = (index as u32, &images[job.source as usize]);
            let one = pyramid(&gpu, kind, &averages(1), SIZE, values);
            for level in 0..one.levels() {
                let read = |p: &Pyramid, layer| {
                    read_f32_texture(&gpu, p.stack().expect("a stack"), layer).expect("read")
                };
                let layer = index * one.levels() + level;
                assert_eq!(read(&several, layer), read(&one, level), "{kind:?}: {index}, {level}");
            }
            for level in 0..one.mips().map_or(0, wgpu::Texture::mip_level_count) {
                let read = |p: &Pyramid, layer| {
                    let mips = p.mips().expect("a mipmap");
                    read_f32_level(&gpu, mips, layer, level).expect("read")
                };
                assert_eq!(read(&several, index), read(&one, 0), "{kind:?}: {index}, mip {level}");
            }
        }
    }
    assert_eq!(gpu.check(), Ok(()), "no error from wgpu");
}

const QUERIES: &str = "
import package::gpu::nbuffer_window::{window_range, window_average};
import package::config::{LEVELS};

@group(0) @binding(0) var<storage, read> queries: array<vec4f>;
@group(0) @binding(1) var<storage, read_write> found: array<vec4f>;
@group(0) @binding(2) var stack: texture_2d_array<f32>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= arrayLength(&queries) { return; }
    let q = queries[id.x];
    // With a side below 0, a rectangle.
    if LEVELS == 0 {
        found[id.x] = vec4f(window_range(stack, 0, vec2i(q.xy), vec2i(q.zw)), 0.0, 0.0);
    } else {
        found[id.x] = window_average(stack, 0, max(LEVELS, 2), q.xy, q.z);
    }
}";

/// Answers of `gpu/nbuffer_window.wesl`: ranges where `levels` is 0, else averages.
fn ask(gpu: &Gpu, pyramid: &Pyramid, levels: u32, queries: &[[f32; 4]]) -> Vec<[f32; 4]> {
    let slots = [source("config", format!("const LEVELS: i32 = {levels};"))];
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
    let zeros = vec![0u8; queries.len() * 16];
    let found = gpu.buffer("found", &zeros, storage | wgpu::BufferUsages::COPY_SRC);
    let view = pyramid.stack_view().expect("a stack");
    let group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: Some("queries"),
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
fn ranges_of_any_rectangle_are_exact() {
    const SIZE: u32 = 50;
    let gpu = gpu();
    let mut random = Random(6);
    let values = whole_numbers(&mut random, SIZE);
    let twice: Vec<f32> = values.iter().flat_map(|v| [*v, *v]).collect();
    let kind = PyramidKind::NBuffer(Anchor::Corner, Beyond::Repeat);
    let ends = pyramid(&gpu, kind, &extremes(), SIZE, &twice);
    let mut queries: Vec<[f32; 4]> = (0..4000)
        .map(|_| {
            let ((x0, x1), (y0, y1)) =
                (span(&mut random, SIZE, SIZE), span(&mut random, SIZE, SIZE));
            [x0, y0, x1, y1].map(|v| v as f32)
        })
        .collect();
    // Cut to the image.
    queries.extend([[-9.0, -3.0, 4.0, 80.0], [0.0, 0.0, 49.0, 49.0], [49.0, 0.0, 49.0, 49.0]]);
    for (query, found) in queries.iter().zip(ask(&gpu, &ends, 0, &queries)) {
        let cut = query.map(|v| v.clamp(0.0, 49.0) as usize);
        let [x0, y0, x1, y1] = cut;
        let texels = || (y0..=y1).flat_map(|y| (x0..=x1).map(move |x| (x, y)));
        let values = || texels().map(|(x, y)| values[y * SIZE as usize + x]);
        let least = values().fold(f32::INFINITY, f32::min);
        let most = values().fold(f32::NEG_INFINITY, f32::max);
        assert_eq!([found[0], found[1]], [least, most], "{query:?}");
    }
}

#[test]
fn averages_between_powers_of_two_are_off_by_a_sixteenth_at_a_straight_edge() {
    const SIZE: u32 = 128;
    let gpu = gpu();
    let half: Vec<f32> =
        (0..SIZE * SIZE).map(|i| if i % SIZE < SIZE / 2 { 1.0 } else { 0.0 }).collect();
    let kind = PyramidKind::NBuffer(Anchor::Middle, Beyond::Repeat);
    let means = pyramid(&gpu, kind, &averages(1), SIZE, &half);
    let mut queries = Vec::new();
    for side in 16..=32 {
        queries.extend((40..=88).map(|x| [x as f32, 64.0, side as f32, 0.0]));
    }
    let mut worst = 0.0f64;
    for (query, found) in queries.iter().zip(ask(&gpu, &means, means.levels(), &queries)) {
        let (x, side) = (f64::from(query[0]), f64::from(query[2]));
        let exact = ((64.0 - x) / side + 0.5).clamp(0.0, 1.0);
        let error = (f64::from(found[0]) - exact).abs();
        assert!(side != 16.0 && side != 32.0 || error < 16.0 * U, "{query:?}: off by {error}");
        worst = worst.max(error);
    }
    // (1 - t) box_L + t box_2L against a box of L (1 + t): at the rim of the latter t (1 - t) / 4, nowhere more.
    assert!((worst - 0.0625).abs() < 16.0 * U, "off by {worst} at most");
}

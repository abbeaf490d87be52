//! Proof, on the live device, of what the library relies on.
//!
//! Drivers do not always do what their flags say. So nothing here is taken from a flag. Each check draws or dispatches into a
//! texture of a few texels and compares what comes back with what must.

use std::fmt;

use serde::{Deserialize, Serialize};

use crate::{Gpu, GpuError, SUBPIXEL_STEP, bind, read_buffer, read_f32_texture};

mod stand;

use stand::{Draw, Stand, layer, quad, quad_of, whole};

/// What a device was found to do.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Probe {
    /// Name of the adapter.
    pub adapter: String,
    /// Name and version of its driver.
    pub driver: String,
    /// One entry for each property, always the same ones in the same order.
    pub checks: Vec<Check>,
}

/// One property.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Check {
    /// What is checked (`depth load`).
    pub name: String,
    /// The outcome.
    pub verdict: Verdict,
    /// What was measured, or what went wrong, in words.
    pub measured: String,
}

/// Outcome of a check.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Verdict {
    /// The device does it.
    Holds,
    /// The device does something else: results of the library cannot be trusted on it.
    Fails,
    /// The device was created without the optional feature.
    Absent,
}

impl Probe {
    /// Whether no check fails; optional features may be absent.
    #[must_use]
    pub fn all_hold(&self) -> bool {
        self.checks.iter().all(|c| c.verdict != Verdict::Fails)
    }

    /// The check of that name.
    #[must_use]
    pub fn find(&self, name: &str) -> Option<&Check> {
        self.checks.iter().find(|c| c.name == name)
    }
}

impl fmt::Display for Probe {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{} ({})", self.adapter, self.driver)?;
        for Check { name, verdict, measured } in &self.checks {
            writeln!(f, "  {:<6} {name}: {measured}", format!("{verdict:?}").to_lowercase())?;
        }
        Ok(())
    }
}

/// Examines the device, in about a second on a software one. Waits.
///
/// Works on every device, also one with WebGPU's default limits and no features, and leaves its error
/// handlers alone: errors that wgpu reports during a check are that check's failure.
///
/// # Errors
/// [`GpuError::DeviceLost`]. Whatever else goes wrong is the failure of one check.
pub fn probe(gpu: &Gpu) -> Result<Probe, GpuError> {
    let stand = Stand::new(gpu)?;
    let mut checks = Vec::new();
    for (name, run) in CHECKS {
        let Finding { verdict, measured } = scoped(gpu, || run(&stand))?;
        checks.push(Check { name: (*name).to_owned(), verdict, measured });
    }
    let driver = format!("{} {}", gpu.info.driver, gpu.info.driver_info);
    Ok(Probe { adapter: gpu.info.name.clone(), driver: driver.trim().to_owned(), checks })
}

/// Outcome of a check, before it has its name.
struct Finding {
    verdict: Verdict,
    measured: String,
}

type Run = fn(&Stand<'_>) -> Result<Finding, GpuError>;

const CHECKS: &[(&str, Run)] = &[
    ("depth load", depth_load),
    ("depth precision", depth_precision),
    ("array layers", array_layers),
    ("reversed depth", reversed_depth),
    ("nearest comparison", nearest_comparison),
    ("linear comparison", linear_comparison),
    ("r32float storage", r32float_storage),
    ("sub-pixel grid of edges", edge_grid),
    ("sub-pixel grid of depth", depth_grid),
    ("depth clamp", depth_clamp),
    ("f32 filtering", f32_filtering),
    ("timestamps", timestamps),
    ("multiview", multiview),
];

/// Runs a check; what wgpu reports meanwhile makes it fail.
fn scoped(gpu: &Gpu, run: impl FnOnce() -> Result<Finding, GpuError>) -> Result<Finding, GpuError> {
    let filters = [
        wgpu::ErrorFilter::Validation,
        wgpu::ErrorFilter::OutOfMemory,
        wgpu::ErrorFilter::Internal,
    ];
    let scopes = filters.map(|filter| gpu.device.push_error_scope(filter));
    let outcome = run();
    let mut reported = None;
    // The last one pushed is the first to go.
    for scope in scopes.into_iter().rev() {
        reported = pollster::block_on(scope.pop()).or(reported);
    }
    let fault = match (outcome, reported) {
        (Err(lost @ GpuError::DeviceLost { .. }), _) => return Err(lost),
        (Ok(finding), None) => return Ok(finding),
        (_, Some(fault)) => fault.to_string(),
        (Err(fault), None) => fault.to_string(),
    };
    Ok(Finding { verdict: Verdict::Fails, measured: fault })
}

/// Holds where all values are within `tolerance` of the expected ones; else names the first that is not.
fn compare(expected: &[f32], got: &[f32], tolerance: f32, holds: impl Into<String>) -> Finding {
    let fails = |measured| Finding { verdict: Verdict::Fails, measured };
    if expected.len() != got.len() {
        return fails(format!("{} values instead of {}", got.len(), expected.len()));
    }
    // Not a number is within nothing.
    let within = |(e, g): (&f32, &f32)| (e - g).abs() <= tolerance;
    match expected.iter().zip(got).position(|pair| !within(pair)) {
        None => Finding { verdict: Verdict::Holds, measured: holds.into() },
        Some(i) => fails(format!("value {i} is {} instead of {}", got[i], expected[i])),
    }
}

fn absent(feature: &str) -> Finding {
    Finding { verdict: Verdict::Absent, measured: format!("{feature} is not enabled") }
}

/// One depth a texel of a 4 x 4 target: neighbours in f32 near 1, 1/2 and 2^-20, and thirds.
const DEPTHS: [f32; 16] = {
    const U: f32 = f32::EPSILON / 2.0;
    const S: f32 = 1.0 / 1_048_576.0;
    [
        1.0,
        1.0 - U,
        1.0 - 2.0 * U,
        0.5,
        0.5 + U,
        0.5 - U / 2.0,
        S,
        S * (1.0 + 2.0 * U),
        S * (1.0 - U),
        1.0 / 3.0,
        2.0 / 3.0,
        0.125,
        0.0625,
        0.1,
        1e-3,
        1e-10,
    ]
};

/// A 4 x 4 depth texture with a quad of each of [`DEPTHS`] drawn over its texel.
fn drawn_depths(stand: &Stand<'_>) -> Result<wgpu::Texture, GpuError> {
    let texture = stand.depth([4, 4], 1)?;
    let texel = |i: usize| {
        let (x, y) = ((i % 4) as f32, (i / 4) as f32);
        quad([4, 4], [x, x + 1.0], [y, y + 1.0], DEPTHS[i])
    };
    let corners: Vec<_> = (0..16).flat_map(texel).collect();
    stand.draw(&layer(&texture, 0), &corners, &Draw::default());
    Ok(texture)
}

/// Depth bound as `texture_2d_array<f32>` and read texel by texel is what a copy gives.
fn depth_load(stand: &Stand<'_>) -> Result<Finding, GpuError> {
    let texture = drawn_depths(stand)?;
    let copied = read_f32_texture(stand.gpu, &texture, 0)?;
    let cleared = copied.iter().all(|d| *d == 0.0);
    if cleared {
        let measured = "nothing was drawn, or copies of depth are empty".to_owned();
        return Ok(Finding { verdict: Verdict::Fails, measured });
    }
    Ok(compare(&copied, &stand.load(&texture)?, 0.0, "textureLoad gives the copied bits"))
}

/// Drawn depth is kept with the 24 bits of f32, also near 0.
fn depth_precision(stand: &Stand<'_>) -> Result<Finding, GpuError> {
    let got = stand.load(&drawn_depths(stand)?)?;
    let relative: Vec<f32> = got.iter().zip(DEPTHS).map(|(g, e)| g / e).collect();
    let worst = relative.iter().map(|r| (r - 1.0).abs()).fold(0.0, f32::max);
    let measured = if worst == 0.0 {
        "every f32 is kept exactly".to_owned()
    } else {
        format!("relative error up to 2^{:.1}", worst.log2())
    };
    Ok(compare(&[1.0; 16], &relative, f32::EPSILON, measured))
}

/// What is drawn into a layer lands there and nowhere else.
fn array_layers(stand: &Stand<'_>) -> Result<Finding, GpuError> {
    const LAYERS: u32 = 6;
    let texture = stand.depth([2, 2], LAYERS)?;
    for k in 0..LAYERS {
        stand.draw(&layer(&texture, k), &[], &Draw::default());
    }
    let mut expected = vec![0.0; 4 * LAYERS as usize];
    for k in 0..LAYERS {
        let z = (k + 1) as f32 / 8.0;
        let how = Draw {
            load: wgpu::LoadOp::Load,
            compare: wgpu::CompareFunction::Always,
            ..Draw::default()
        };
        stand.draw(&layer(&texture, k), &quad([2, 2], [0.0, 2.0], [0.0, 2.0], z), &how);
        expected[4 * k as usize..][..4].fill(z);
        let finding = compare(&expected, &stand.load(&texture)?, 0.0, "6 layers, each its own");
        if finding.verdict != Verdict::Holds || k + 1 == LAYERS {
            return Ok(finding);
        }
    }
    Ok(absent("an array of layers"))
}

/// With `Greater` and a clear value of 0 the nearest of three quads stays, in any order.
fn reversed_depth(stand: &Stand<'_>) -> Result<Finding, GpuError> {
    let texture = stand.depth([4, 1], 1)?;
    let mut corners = Vec::new();
    let orders = [[0.25, 0.75, 0.5], [0.75, 0.5, 0.25], [0.5, 0.25, 0.75]];
    for (i, order) in orders.iter().enumerate() {
        let x = i as f32;
        corners.extend(order.iter().flat_map(|z| quad([4, 1], [x, x + 1.0], [0.0, 1.0], *z)));
    }
    stand.draw(&layer(&texture, 0), &corners, &Draw::default());
    let expected = [0.75, 0.75, 0.75, 0.0];
    Ok(compare(&expected, &stand.load(&texture)?, 0.0, "the largest depth stays, 0 where empty"))
}

/// A 2 x 1 depth texture holding 1/4 and 3/4.
fn quarter_and_three(stand: &Stand<'_>) -> Result<wgpu::Texture, GpuError> {
    let texture = stand.depth([2, 1], 1)?;
    let mut corners = quad([2, 1], [0.0, 1.0], [0.0, 1.0], 0.25).to_vec();
    corners.extend(quad([2, 1], [1.0, 2.0], [0.0, 1.0], 0.75));
    stand.draw(&layer(&texture, 0), &corners, &Draw::default());
    Ok(texture)
}

fn compared(
    stand: &Stand<'_>,
    filter: wgpu::FilterMode,
    places: &[[f32; 4]],
) -> Result<Vec<f32>, GpuError> {
    let texture = quarter_and_three(stand)?;
    let sampler = stand.gpu.device.create_sampler(&wgpu::SamplerDescriptor {
        mag_filter: filter,
        min_filter: filter,
        compare: Some(wgpu::CompareFunction::GreaterEqual),
        ..Default::default()
    });
    let view = whole(&texture);
    let resources = [bind::texture(2, &view), bind::sampler(3, &sampler)];
    stand.at_places("compare", places, &resources)
}

/// A nearest comparison sampler gives 1 where the reference is not below the texel, else 0.
fn nearest_comparison(stand: &Stand<'_>) -> Result<Finding, GpuError> {
    let references =
        [(0.25f32.next_down(), 0.75f32.next_down()), (0.25, 0.75), (1.0, 1.0), (0.0, 0.0)];
    let places: Vec<[f32; 4]> =
        references.iter().flat_map(|(a, b)| [[0.25, 0.5, *a, 0.0], [0.75, 0.5, *b, 0.0]]).collect();
    let got = compared(stand, wgpu::FilterMode::Nearest, &places)?;
    let expected = [0.0, 0.0, 1.0, 1.0, 1.0, 1.0, 0.0, 0.0];
    Ok(compare(&expected, &got, 0.0, "exact, also at equality and one f32 below it"))
}

/// Steps into which the distance between two texels is divided to measure weights.
const WEIGHT_STEPS: u16 = 4096;
/// Largest error of a filter weight that the library's hardware filters assume: half a step of 6 fractional
/// bits. Direct3D requires 8, Vulkan only 4.
const WEIGHT_TOLERANCE: f32 = 1.0 / 128.0;

/// Fractions f in [0, 1], and the places at f of the way from the first of two texels to the second.
fn across_two_texels() -> (Vec<f32>, Vec<[f32; 4]>) {
    let fractions = (0..=WEIGHT_STEPS).map(|k| f32::from(k) / f32::from(WEIGHT_STEPS));
    fractions.map(|f| (f, [0.25 + 0.5 * f, 0.5, 0.5, 0.0])).unzip()
}

fn weights(expected: &[f32], got: &[f32]) -> Finding {
    let worst = expected.iter().zip(got).map(|(e, g)| (e - g).abs()).fold(0.0, f32::max);
    // Values that differ by less than a quarter of the finest step looked for are the same level.
    let steps = got.windows(2).filter(|w| (w[1] - w[0]).abs() > 0.25 / f32::from(WEIGHT_STEPS));
    let bits = (steps.count().max(1) as f32).log2().round();
    let at_least = if bits >= f32::from(WEIGHT_STEPS).log2() { "at least " } else { "" };
    let measured =
        format!("weights have {at_least}{bits} fractional bits, error up to {worst:.1e}");
    compare(expected, got, WEIGHT_TOLERANCE, measured)
}

/// A linear comparison sampler compares first and interpolates then.
fn linear_comparison(stand: &Stand<'_>) -> Result<Finding, GpuError> {
    let (fractions, places) = across_two_texels();
    let got = compared(stand, wgpu::FilterMode::Linear, &places)?;
    let expected: Vec<f32> = fractions.iter().map(|f| 1.0 - f).collect();
    Ok(weights(&expected, &got))
}

/// Values stored into an `R32Float` texture read back bit by bit.
fn r32float_storage(stand: &Stand<'_>) -> Result<Finding, GpuError> {
    let texture = stand.texture(wgpu::TextureFormat::R32Float, [4, 4], 1)?;
    let values = DEPTHS.map(|d| 0.5 - d);
    stand.store(&texture, &values);
    let got = read_f32_texture(stand.gpu, &texture, 0)?;
    Ok(compare(&values, &got, 0.0, "exact"))
}

/// Offsets by which vertices are displaced, in units of 1/1024 pixel: 1/16 pixel in all, 16 of the steps
/// that are assumed.
const OFFSETS: u16 = 64;

/// Judges where vertices displaced by `offset[k]` pixels were found to be drawn, known to `resolution`.
fn displacements(offsets: &[f32], found: &[f32], resolution: f32) -> Finding {
    let pairs = || offsets.iter().zip(found);
    let worst = pairs().map(|(o, f)| (o - f).abs()).fold(0.0, f32::max);
    let jumps = found.windows(2).map(|w| (w[1] - w[0]).abs());
    let step = jumps.fold(0.0, f32::max);
    // Without a grid each offset shows: jumps are those of the offsets.
    let finest = offsets.windows(2).map(|w| w[1] - w[0]).fold(0.0, f32::max);
    let grid = if step <= finest + 2.0 * resolution {
        format!("none, or finer than 1/{:.0} pixel", 1.0 / finest)
    } else {
        format!("1/{:.0} pixel", 1.0 / step)
    };
    let measured = format!(
        "grid {grid}, moves up to {:.2} of the assumed step of 1/{:.0}",
        worst / SUBPIXEL_STEP,
        1.0 / SUBPIXEL_STEP
    );
    compare(offsets, found, SUBPIXEL_STEP + resolution, measured)
}

/// Vertices move by at most [`SUBPIXEL_STEP`] before edges are drawn.
///
/// Column k shows an edge that leans by 1/16 pixel over 256 rows and is displaced by k / 1024 pixel; it
/// passes the pixels' centres at row 4 k. The number of rows covered tells where it was drawn, to 1/4096
/// pixel. Its vertices lean by a whole number of steps, so that both snap alike.
fn edge_grid(stand: &Stand<'_>) -> Result<Finding, GpuError> {
    const SIZE: [u32; 2] = [2 * OFFSETS as u32, 256];
    const LEAN: f32 = 1.0 / 16.0;
    let texture = stand.depth(SIZE, 1)?;
    let offsets: Vec<f32> = (0..OFFSETS).map(|k| f32::from(k) / 1024.0).collect();
    let column = |(k, offset): (usize, &f32)| {
        let (left, right) = (2.0 * k as f32 + 0.5 + offset, 2.0 * k as f32 + 2.0);
        let bottom = SIZE[1] as f32;
        let corners =
            [[left, 0.0, 0.5], [right, 0.0, 0.5], [left - LEAN, bottom, 0.5], [right, bottom, 0.5]];
        quad_of(SIZE, corners)
    };
    let corners: Vec<_> = offsets.iter().enumerate().flat_map(column).collect();
    stand.draw(&layer(&texture, 0), &corners, &Draw::default());
    let texels = stand.load(&texture)?;
    let per_row = LEAN / SIZE[1] as f32;
    let found: Vec<f32> = (0..usize::from(OFFSETS))
        .map(|k| {
            let empty = texels.chunks(SIZE[0] as usize).filter(|row| row[2 * k] == 0.0).count();
            empty as f32 * per_row
        })
        .collect();
    Ok(displacements(&offsets, &found, per_row))
}

/// Vertices move by at most [`SUBPIXEL_STEP`] before depth is interpolated.
///
/// Each of 64 quads of 4 x 4 pixels carries a ramp of depth from 0 to 1 and is displaced along it by k / 1024
/// pixel; the depth at a pixel's centre tells by how much the ramp was moved.
fn depth_grid(stand: &Stand<'_>) -> Result<Finding, GpuError> {
    const SIZE: [u32; 2] = [4 * OFFSETS as u32, 4];
    let offsets: Vec<f32> = (0..OFFSETS).map(|k| f32::from(k) / 1024.0).collect();
    let mut worst: Option<Finding> = None;
    for along_x in [true, false] {
        let texture = stand.depth(SIZE, 1)?;
        let ramp = |(k, offset): (usize, &f32)| {
            let x = 4.0 * k as f32;
            let corner = |i: f32, j: f32| {
                if along_x {
                    [x + 4.0 * i + offset, 4.0 * j, i]
                } else {
                    [x + 4.0 * i, 4.0 * j + offset, j]
                }
            };
            quad_of(SIZE, [corner(0.0, 0.0), corner(1.0, 0.0), corner(0.0, 1.0), corner(1.0, 1.0)])
        };
        let corners: Vec<_> = offsets.iter().enumerate().flat_map(ramp).collect();
        stand.draw(&layer(&texture, 0), &corners, &Draw::default());
        let texels = stand.load(&texture)?;
        // The pixel at (1, 1) of each quad: its centre is 1.5 pixels down the ramp.
        let depth = |k: usize| texels[SIZE[0] as usize + 4 * k + 1];
        let found: Vec<f32> = (0..offsets.len()).map(|k| 1.5 - 4.0 * depth(k)).collect();
        // A pixel of depth is 1/4; its rounding, 8 u of 1 at most, is 32 u of a pixel.
        let finding = displacements(&offsets, &found, 32.0 * f32::EPSILON);
        if worst.as_ref().is_none_or(|w| w.verdict == Verdict::Holds) {
            worst = Some(finding);
        }
    }
    Ok(worst.unwrap_or_else(|| absent("a direction")))
}

/// Casters before the near plane are drawn at its depth when depth is not clipped, and only then.
fn depth_clamp(stand: &Stand<'_>) -> Result<Finding, GpuError> {
    if !stand.gpu.device.features().contains(wgpu::Features::DEPTH_CLIP_CONTROL) {
        return Ok(absent("DEPTH_CLIP_CONTROL"));
    }
    let mut got = Vec::new();
    for unclipped in [true, false] {
        let texture = stand.depth([2, 1], 1)?;
        let mut corners = quad([2, 1], [0.0, 1.0], [0.0, 1.0], 1.5).to_vec();
        corners.extend(quad([2, 1], [1.0, 2.0], [0.0, 1.0], -0.5));
        let how = Draw {
            load: wgpu::LoadOp::Clear(0.5),
            compare: wgpu::CompareFunction::Always,
            unclipped,
            ..Draw::default()
        };
        stand.draw(&layer(&texture, 0), &corners, &how);
        got.extend(stand.load(&texture)?);
    }
    Ok(compare(&[1.0, 0.0, 0.5, 0.5], &got, 0.0, "clamps to [0, 1] when asked, else clips"))
}

/// `R32Float` can be filtered.
fn f32_filtering(stand: &Stand<'_>) -> Result<Finding, GpuError> {
    if !stand.gpu.device.features().contains(wgpu::Features::FLOAT32_FILTERABLE) {
        return Ok(absent("FLOAT32_FILTERABLE"));
    }
    let texture = stand.texture(wgpu::TextureFormat::R32Float, [2, 1], 1)?;
    stand.gpu.queue.write_texture(
        texture.as_image_copy(),
        bytemuck::cast_slice(&[0.0f32, 1.0]),
        wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: None, rows_per_image: None },
        texture.size(),
    );
    let sampler = stand.gpu.device.create_sampler(&wgpu::SamplerDescriptor {
        mag_filter: wgpu::FilterMode::Linear,
        min_filter: wgpu::FilterMode::Linear,
        ..Default::default()
    });
    let (fractions, places) = across_two_texels();
    let view = texture.create_view(&Default::default());
    let resources = [bind::texture(2, &view), bind::sampler(3, &sampler)];
    Ok(weights(&fractions, &stand.at_places("filter_linear", &places, &resources)?))
}

/// Timestamps around two passes that depend on each other rise, and a pass takes time.
fn timestamps(stand: &Stand<'_>) -> Result<Finding, GpuError> {
    let Gpu { device, queue, .. } = stand.gpu;
    if !device.features().contains(wgpu::Features::TIMESTAMP_QUERY) {
        return Ok(absent("TIMESTAMP_QUERY"));
    }
    const SIDE: f32 = 512.0;
    let size = [SIDE as u32; 2];
    let texture = stand.depth(size, 1)?;
    let corners: Vec<_> =
        (1..=32).flat_map(|i| quad(size, [0.0, SIDE], [0.0, SIDE], i as f32 / 64.0)).collect();
    let query_set = device.create_query_set(&wgpu::QuerySetDescriptor {
        label: Some("probe"),
        ty: wgpu::QueryType::Timestamp,
        count: 4,
    });
    for first in [0, 2] {
        let stamps = wgpu::RenderPassTimestampWrites {
            query_set: &query_set,
            beginning_of_pass_write_index: Some(first),
            end_of_pass_write_index: Some(first + 1),
        };
        let load = if first == 0 { wgpu::LoadOp::Clear(0.0) } else { wgpu::LoadOp::Load };
        let how = Draw { load, stamps: Some(stamps), ..Draw::default() };
        stand.draw(&layer(&texture, 0), &corners, &how);
    }
    let resolved = device.create_buffer(&wgpu::BufferDescriptor {
        label: Some("probe"),
        size: 32,
        usage: wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC,
        mapped_at_creation: false,
    });
    let mut encoder = device.create_command_encoder(&Default::default());
    encoder.resolve_query_set(&query_set, 0..4, &resolved, 0);
    queue.submit([encoder.finish()]);
    let ticks: Vec<u64> = bytemuck::pod_collect_to_vec(&read_buffer(stand.gpu, &resolved, 32)?);
    // The second pass may begin before the first ends, but not before it begins.
    let rises = ticks[0] < ticks[1] && ticks[2] < ticks[3];
    let in_order = ticks[0] <= ticks[2] && ticks[1] <= ticks[3];
    let ms_per_tick = f64::from(queue.get_timestamp_period()) * 1e-6;
    if !(rises && in_order && ms_per_tick > 0.0) {
        let measured = format!("ticks of two passes: {ticks:?}, {ms_per_tick} ms each");
        return Ok(Finding { verdict: Verdict::Fails, measured });
    }
    let ms = |a: usize| (ticks[a + 1] - ticks[a]) as f64 * ms_per_tick;
    let measured = format!("rising; two passes took {:.3} and {:.3} ms", ms(0), ms(2));
    Ok(Finding { verdict: Verdict::Holds, measured })
}

/// One multiview pass draws into both layers. The vertex shader does not ask which view it draws.
fn multiview(stand: &Stand<'_>) -> Result<Finding, GpuError> {
    if !stand.gpu.device.features().contains(wgpu::Features::MULTIVIEW) {
        return Ok(absent("MULTIVIEW"));
    }
    let texture = stand.depth([2, 2], 2)?;
    for k in 0..2 {
        stand.draw(&layer(&texture, k), &[], &Draw::default());
    }
    let how = Draw {
        load: wgpu::LoadOp::Load,
        views: std::num::NonZeroU32::new(0b11),
        ..Draw::default()
    };
    stand.draw(&whole(&texture), &quad([2, 2], [0.0, 2.0], [0.0, 2.0], 0.5), &how);
    Ok(compare(
        &[0.5; 8],
        &stand.load(&texture)?,
        0.0,
        "one pass over two views draws into both layers",
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn verdict(finding: &Finding) -> Verdict {
        finding.verdict
    }

    #[test]
    fn the_comparison_notices_wrong_values() {
        let expected = [0.0, 0.5, 1.0];
        assert_eq!(verdict(&compare(&expected, &expected, 0.0, "")), Verdict::Holds, "equal");
        let wrong: [&[f32]; 4] =
            [&[0.0, 0.5], &[], &[0.0, 0.5f32.next_up(), 1.0], &[0.0, f32::NAN, 1.0]];
        for got in wrong {
            let finding = compare(&expected, got, 0.0, "");
            assert_eq!(verdict(&finding), Verdict::Fails, "{got:?} passed");
        }
        let finding = compare(&expected, &[0.0, 0.5, 0.9], 0.05, "");
        assert_eq!(finding.measured, "value 2 is 0.9 instead of 1", "the message");
    }

    #[test]
    fn coarse_weights_are_measured_and_refused() {
        let (exact, _) = across_two_texels();
        for (bits, passes) in [(4, false), (5, false), (6, true), (8, true), (12, true)] {
            let levels = f32::from(1u16 << bits);
            let got: Vec<f32> = exact.iter().map(|f| (f * levels).round() / levels).collect();
            let finding = weights(&exact, &got);
            assert_eq!(verdict(&finding) == Verdict::Holds, passes, "{bits} bits");
            let found = format!("{bits} fractional bits");
            assert!(!passes || finding.measured.contains(&found), "{}", finding.measured);
        }
    }

    #[test]
    fn coarse_grids_are_measured_and_refused() {
        let offsets: Vec<f32> = (0..OFFSETS).map(|k| f32::from(k) / 1024.0).collect();
        // By truncation a vertex moves by up to a step, by rounding by half of one.
        let snapped = |grid: f32, round: fn(f32) -> f32| -> Finding {
            let found: Vec<f32> = offsets.iter().map(|o| round(o * grid) / grid).collect();
            displacements(&offsets, &found, 1e-6)
        };
        for (grid, by_truncation, by_rounding) in
            [(16.0, false, false), (64.0, false, false), (128.0, false, true), (256.0, true, true)]
        {
            let (truncated, rounded) = (snapped(grid, f32::floor), snapped(grid, f32::round));
            assert_eq!(verdict(&truncated) == Verdict::Holds, by_truncation, "1/{grid} truncated");
            assert_eq!(verdict(&rounded) == Verdict::Holds, by_rounding, "1/{grid} rounded");
        }
        let fine = snapped(256.0, f32::round);
        assert!(fine.measured.contains("grid 1/256 pixel"), "{}", fine.measured);
    }
}

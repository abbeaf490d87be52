//! Shaders against their f64 twins: where a receiver lies in a map, and the percentage-closer filters.
//!
//! With u = 2^-24 and S_i = sum_j |m_ij p_j|, a row of a product has error <= 4 u S_i in f32, and dividing two
//! of them x = a / w gives u (4 S_a + 4 |x| S_w) / |w| + 2 u |x|. The matrix and the point are the same f32 on
//! both sides and add nothing.

use antumbra_filter::kernel::Separable;
use antumbra_filter::{PcfBilinearGrid, PcfCastano, PcfCubic, PcfGrid, PcfHardware};
use antumbra_gpu::{Gpu, SUBPIXEL_STEP, bind, read_buffer, read_f32_texture};
use antumbra_map::{
    Bias, DepthConvention, Estimator, FittedView, Fitting, MapConfig, MapRead, MapTechnique,
    ShadowView, fit, twin,
};
use antumbra_measure::Stage;
use antumbra_scene::{Light, LightKind, generate};
use antumbra_tests::{Random, gpu};
use glam::{DMat2, DMat4, DVec2, DVec3, DVec4, Vec3, Vec4};

/// Unit roundoff of f32.
const U: f64 = 1.0 / 16_777_216.0;

/// The bounds of `receiver_slack` in f64, and what else of a lookup the twin leaves out.
struct Bounds {
    /// Error of a texel coordinate computed in f32, texels.
    texel: DVec2,
    /// Rounding of both sides of a comparison: the shader's slack for `Bias::constant` = 1.
    rounding: f64,
}

fn bounds(clip: &DMat4, size: f64, p: DVec3, at: &twin::Lookup) -> Bounds {
    let c = *clip * p.extend(1.0);
    let ndc = c.truncate() / c.w;
    let a = p.abs();
    let sums: DVec4 = clip.x_axis.abs() * a.x
        + clip.y_axis.abs() * a.y
        + clip.z_axis.abs() * a.z
        + clip.w_axis.abs();
    let error =
        |factor: f64| U * (factor * (sums.truncate() + ndc.abs() * sums.w) / c.w + 2.0 * ndc.abs());
    // (1 + x) / 2 size: three more roundings of numbers up to `size`.
    let texel = error(4.0).truncate() * 0.5 * size + 3.0 * U * size;
    let g = at.gradient.abs();
    let e = error(9.0);
    let rounding = e.z + g.dot(e.truncate() * 0.5 * size + 6.0 * U * size) + 6.0 * U * ndc.z.abs();
    Bounds { texel, rounding }
}

/// What the shader says of a receiver: texel, depth, the bias cone's rise at [`STEP`] texels, gradient.
struct Located {
    texel: DVec2,
    depth: f64,
    rise: f64,
    gradient: DVec2,
}

/// Texels.
const STEP: DVec2 = DVec2::new(2.0, -3.0);

const LOCATE: &str = "
import package::common::lookup::{ShadowView, locate, rise};

@group(0) @binding(0) var<storage, read> view: ShadowView;
// Position and size of the map, then normal.
@group(0) @binding(1) var<storage, read> receivers: array<vec4f>;
@group(0) @binding(2) var<storage, read_write> found: array<vec4f>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3u) {
    let i = 2u * id.x;
    if i < arrayLength(&receivers) {
        let p = receivers[i];
        let at = locate(view, vec2f(p.w), p.xyz, receivers[i + 1u].xyz, 0.0);
        found[i] = vec4f(at.texel, at.depth, rise(at, vec2f(2.0, -3.0)));
        found[i + 1u] = vec4f(at.gradient, 0.0, 0.0);
    }
}";

struct Locator {
    pipeline: wgpu::ComputePipeline,
}

impl Locator {
    fn new(gpu: &Gpu) -> Self {
        let wgsl = antumbra_shaders::link_source("tests::locate", LOCATE, &[]).expect("it links");
        let pipeline = gpu.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some("locate"),
            layout: None,
            module: &gpu.shader("locate", wgsl),
            entry_point: Some("main"),
            compilation_options: Default::default(),
            cache: None,
        });
        Self { pipeline }
    }

    fn locate(
        &self,
        gpu: &Gpu,
        view: &ShadowView,
        size: u32,
        receivers: &[(Vec3, Vec3)],
    ) -> Vec<Located> {
        let input: Vec<Vec4> =
            receivers.iter().flat_map(|(p, n)| [p.extend(size as f32), n.extend(0.0)]).collect();
        let storage = wgpu::BufferUsages::STORAGE;
        let view = gpu.buffer("view", bytemuck::bytes_of(view), storage);
        let given = gpu.buffer("receivers", bytemuck::cast_slice(&input), storage);
        let zeros = vec![0u8; input.len() * 16];
        let found = gpu.buffer("found", &zeros, storage | wgpu::BufferUsages::COPY_SRC);
        let group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("locate"),
            layout: &self.pipeline.get_bind_group_layout(0),
            entries: &[bind::buffer(0, &view), bind::buffer(1, &given), bind::buffer(2, &found)],
        });
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        let mut pass = encoder.begin_compute_pass(&Default::default());
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &group, &[]);
        pass.dispatch_workgroups((receivers.len() as u32).div_ceil(64), 1, 1);
        drop(pass);
        gpu.queue.submit([encoder.finish()]);
        let bytes = read_buffer(gpu, &found, zeros.len() as u64).expect("read back");
        let values: Vec<[f32; 8]> = bytemuck::pod_collect_to_vec(&bytes);
        let located = |v: &[f32; 8]| {
            let [s, t, depth, rise, gs, gt, _, _] = v.map(f64::from);
            Located { texel: DVec2::new(s, t), depth, rise, gradient: DVec2::new(gs, gt) }
        };
        values.iter().map(located).collect()
    }
}

/// Fitted views of boxes, and the sizes of their maps.
fn views() -> Vec<(FittedView, u32)> {
    let lights = |center: DVec3, half: f64| {
        let directional = |x, y, z| Light::Directional {
            direction: DVec3::new(x, y, z).normalize(),
            angular_diameter: 0.0,
        };
        let above = center + half * DVec3::new(0.5, 4.0, -0.7);
        [
            directional(0.0, -1.0, 0.0),
            directional(0.4, -1.0, 0.3),
            directional(-3.0, -1.0, 2.0),
            Light::Spot {
                position: above,
                direction: DVec3::new(-0.1, -1.0, 0.2),
                outer_angle: 0.5,
            },
            Light::Point { position: above },
            Light::Point { position: center + half * DVec3::new(0.1, 0.2, -0.1) },
        ]
    };
    let mut all = Vec::new();
    for (center, half) in
        [(DVec3::ZERO, 1.0), (DVec3::new(40.0, -3.0, 25.0), 2.0), (DVec3::splat(3e-3), 1e-3)]
    {
        let corners = antumbra_scene::Bounds { min: center - half, max: center + half }.corners();
        for light in lights(center, half) {
            for size in [64, 2048] {
                let fitting =
                    Fitting { origin: DVec3::ZERO, size, guard: 3, receivers: false, grid: 1 };
                for view in fit(&light, &corners, &fitting).expect("a valid light") {
                    if view.clip.is_some() {
                        all.push((view, size));
                    }
                }
            }
        }
    }
    all
}

#[test]
fn locate_agrees_with_its_twin_within_the_derived_slack() {
    const PER_VIEW: usize = 4000;
    let gpu = gpu();
    let locator = Locator::new(&gpu);
    let estimator = Estimator::nearest();
    let convention = DepthConvention::REVERSED_F32;
    let mut random = Random(1);
    let (mut total, mut beyond_none, mut beyond_slack) = (0, 0, 0);
    let (mut worst_slack, mut worst_rounding, mut worst_texel) = (0f64, 0f64, 0f64);
    for (fitted, size) in views() {
        // The matrix that both the map's vertices and the lookups are transformed by.
        let clip = fitted.clip.expect("a view with casters").as_mat4().as_dmat4();
        let world = clip.inverse();
        let mut receivers = Vec::new();
        while receivers.len() < PER_VIEW {
            // Anywhere in the view, from its near end to 50 times as far in perspective.
            let ndc = random.vector() * DVec3::new(1.0, 1.0, 0.49) + DVec3::new(0.0, 0.0, 0.51);
            let p = world.project_point3(ndc).as_vec3();
            let n = random.vector().normalize().as_vec3();
            let to_light = fitted.light.truncate() - fitted.light.w * p.as_dvec3();
            // The direction to a near light is known to the rounding of the product that gives it. Nearer
            // to edge-on than that, or than a thousandth of a radian, the plane is the rounding's.
            let sums =
                p.as_dvec3().abs().element_sum() + fitted.light.truncate().abs().element_sum();
            let direction = 8.0 * U * fitted.light.w * sums / to_light.length();
            if n.as_dvec3().dot(to_light.normalize()) > 1e-3 + direction {
                receivers.push((p, n));
            }
        }
        let bias = |constant: f32, slope: f32| {
            let bias = Bias { constant, slope, cone: 0.0, ..Bias::default() };
            ShadowView::new(&clip, fitted.light, 0, convention, &bias, &estimator)
        };
        let plain = locator.locate(&gpu, &bias(0.0, 0.0), size, &receivers);
        let biased = locator.locate(&gpu, &bias(1.0, 1.0), size, &receivers);
        for (((p, n), plain), biased) in receivers.iter().zip(&plain).zip(&biased) {
            let size = f64::from(size);
            let exact = twin::locate(&clip, size, p.as_dvec3(), n.as_dvec3());
            let bounds = bounds(&clip, size, p.as_dvec3(), &exact);
            let off = (plain.texel - exact.texel).abs();
            worst_texel = worst_texel.max((off / bounds.texel).max_element());
            // The reference of the texel that holds the sample, in both.
            let texel = plain.texel.floor() + 0.5;
            let reference = plain.depth + plain.gradient.dot(texel - plain.texel);
            let truth = exact.depth + exact.gradient.dot(texel - exact.texel);
            let error = (reference - truth).abs();
            // Reversed depth: the slack adds to depth. It is a difference of two rounded numbers.
            let slack = biased.depth - plain.depth + 2.0 * U * plain.depth.abs();
            worst_slack = worst_slack.max(error / slack);
            worst_rounding = worst_rounding.max(error / bounds.rounding);
            total += 1;
            beyond_none += usize::from(error > 0.0);
            beyond_slack += usize::from(error > slack);
        }
    }
    assert!(total >= 100_000, "{total} receivers");
    assert!(worst_texel <= 1.0, "texel coordinates are off by {worst_texel} of the bound");
    assert_eq!(beyond_slack, 0, "of {total} references differ by more than the slack");
    // The control: without slack most comparisons of a surface with itself could go wrong.
    assert!(2 * beyond_none > total, "only {beyond_none} of {total} differ at all");
    // And the bound is no blank cheque.
    assert!(worst_slack > 1e-3, "the largest difference is only {worst_slack} of the slack");
}

#[test]
fn the_bias_cone_is_as_steep_in_all_directions_and_all_over_a_view() {
    const PER_VIEW: usize = 500;
    let gpu = gpu();
    let locator = Locator::new(&gpu);
    let (convention, estimator) = (DepthConvention::REVERSED_F32, Estimator::nearest());
    let mut random = Random(3);
    let (mut judged, mut worst, mut upright) = (0, 0f64, 0f64);
    for (fitted, size) in views() {
        let clip = fitted.clip.expect("a view with casters").as_mat4().as_dmat4();
        let world = clip.inverse();
        let receivers: Vec<(Vec3, Vec3)> = (0..PER_VIEW)
            .map(|_| {
                let ndc = random.vector() * DVec3::new(1.0, 1.0, 0.4) + DVec3::new(0.0, 0.0, 0.6);
                let p = world.project_point3(ndc);
                let to_light = (fitted.light.truncate() - fitted.light.w * p).normalize();
                (p.as_vec3(), (to_light + 0.5 * random.vector().normalize()).normalize().as_vec3())
            })
            .collect();
        let bias = Bias::default();
        let view = ShadowView::new(&clip, fitted.light, 0, convention, &bias, &estimator);
        let found = locator.locate(&gpu, &view, size, &receivers);
        for ((p, n), found) in receivers.iter().zip(&found) {
            let (p, n) = (p.as_dvec3(), n.as_dvec3());
            // So near to the light the ray's direction is known to a ten-thousandth only.
            let light = fitted.light.truncate();
            let sums = p.abs().element_sum() + light.abs().element_sum();
            if 8.0 * U * fitted.light.w * sums > 1e-4 * (light - p).length() {
                continue;
            }
            let cone = exact(&fitted, f64::from(size), p, n, &estimator).cone;
            let rise = cone.rise(STEP);
            judged += 1;
            worst = worst.max((found.rise - rise).abs() / rise);
            // The control: texels taken for rectangles.
            let sides = DVec2::new(cone.texels[0].length(), cone.texels[1].length());
            upright = upright.max((cone.slope * (STEP / sides).length() - rise).abs() / rise);
        }
    }
    assert!(judged > 5000, "{judged} receivers");
    assert!(worst < 1e-3, "the rise is off by {worst} of itself");
    assert!(upright > 0.1, "no view has texels that lean: {upright}");
}

#[test]
fn a_normal_offset_moves_the_receiver_as_its_twin_says() {
    const PER_VIEW: usize = 500;
    const OFFSET: f32 = 3.0;
    let gpu = gpu();
    let locator = Locator::new(&gpu);
    let convention = DepthConvention::REVERSED_F32;
    let mut random = Random(2);
    let (mut moved, mut worst) = (0, 0f64);
    for (fitted, size) in views() {
        let clip = fitted.clip.expect("a view with casters").as_mat4().as_dmat4();
        let world = clip.inverse();
        let receivers: Vec<(Vec3, Vec3)> = (0..PER_VIEW)
            .map(|_| {
                let ndc = random.vector() * DVec3::new(1.0, 1.0, 0.4) + DVec3::new(0.0, 0.0, 0.6);
                let n = random.vector().normalize();
                (world.project_point3(ndc).as_vec3(), n.as_vec3())
            })
            .collect();
        let view = |normal: f32| {
            let bias = Bias { normal, ..Bias::NONE };
            ShadowView::new(&clip, fitted.light, 0, convention, &bias, &Estimator::nearest())
        };
        let still = locator.locate(&gpu, &view(0.0), size, &receivers);
        let found = locator.locate(&gpu, &view(OFFSET), size, &receivers);
        for (((p, n), still), found) in receivers.iter().zip(&still).zip(&found) {
            let (p, n, size) = (p.as_dvec3(), n.as_dvec3(), f64::from(size));
            let to_light = fitted.light.as_vec4().as_dvec4().truncate();
            let away = twin::normal_offset(&clip, to_light, size, p, n) * f64::from(OFFSET);
            let exact = twin::locate(&clip, size, p + n * away, n);
            // The moved point is rounded, as a view sample is; the offset, some 3 texels at most, to 32 u.
            let bound = 2.0 * bounds(&clip, size, p + n * away, &exact).texel + 96.0 * U * size;
            worst = worst.max(((found.texel - exact.texel).abs() / bound).max_element());
            moved += usize::from((found.texel - still.texel).length() > 0.5);
        }
    }
    assert!(worst <= 1.0, "off by {worst} of the bound");
    assert!(moved > 1000, "only {moved} receivers move by more than half a texel");
}

/// A lookup in f64 with everything that `locate` adds to the twin's.
struct Exact {
    at: twin::Lookup,
    bounds: Bounds,
    slack: f64,
    cone: Cone,
}

/// The bias cone at a receiver.
struct Cone {
    /// Depth a metre across the ray.
    slope: f64,
    /// Gradients of the texel coordinates, across the ray.
    texels: [DVec3; 2],
}

impl Cone {
    /// Its rise `offset` texels from the receiver: that of the step across the ray which moves a point by so many.
    fn rise(&self, offset: DVec2) -> f64 {
        let [a, b] = self.texels;
        // The step is s a + t b.
        let gram = DMat2::from_cols_array(&[a.dot(a), a.dot(b), a.dot(b), b.dot(b)]);
        let by = gram.inverse() * offset;
        self.slope * (by.x * a + by.y * b).length()
    }
}

/// Position and direction to the light of a receiver; the estimator under the default bias.
fn exact(view: &FittedView, size: f64, p: DVec3, n: DVec3, estimator: &Estimator) -> Exact {
    let clip = view.clip.expect("a view with casters").as_mat4().as_dmat4();
    let at = twin::locate(&clip, size, p, n);
    let bounds = bounds(&clip, size, p, &at);
    let c = clip * p.extend(1.0);
    let ndc = c.truncate() / c.w;
    let along = |d: DVec3| {
        let c_d = clip * d.extend(0.0);
        (c_d.truncate() - ndc * c_d.w) / c.w
    };
    let light = view.light.as_vec4().as_dvec4();
    let to_light = (light.truncate() - light.w * p).normalize();
    let across =
        |i: usize| (clip.row(i).truncate() - ndc[i] * clip.row(3).truncate()) / c.w * 0.5 * size;
    let texels = [across(0), -across(1)];
    let bias = Bias::default();
    let slope = f64::from(bias.cone) * along(to_light).z.abs();
    let cone = slope / DVec2::new(texels[0].length(), texels[1].length());
    let g = at.gradient.abs();
    let reach = f64::from(estimator.reach);
    let slack = bounds.rounding
        + (reach + f64::from(SUBPIXEL_STEP)) * (g.x + g.y)
        + 0.5 * reach * (cone.x + cone.y);
    let cosine = n.dot(to_light).max(1e-4);
    let tangent = ((1.0 - cosine * cosine).max(0.0).sqrt() / cosine).max(1.0);
    let cone = Cone { slope: slope * 0.5 * (tangent + 1.0 / tangent), texels };
    Exact { at, bounds, slack, cone }
}

impl Exact {
    /// The depth compared with the texel around `center`; reversed depth, not clamped.
    fn reference(&self, center: DVec2) -> f64 {
        let offset = center - self.at.texel;
        self.at.depth + self.slack + self.at.gradient.dot(offset) + self.cone.rise(offset)
    }
}

/// Brute-force visibility of a sample, and whether rounding could decide a comparison or the choice of
/// texels. With `one_reference` all texels are compared with the depth at the sample.
struct Brute<'a> {
    kernel: Separable,
    map: &'a [f32],
    size: usize,
    one_reference: bool,
}

impl Brute<'_> {
    fn visibility(&self, exact: &Exact) -> (f64, bool) {
        let last = self.size as i64 - 1;
        let start = exact.at.texel - self.kernel.offset();
        let first = start.floor();
        let fraction = start - first;
        let near_line = |f: f64, e: f64| f <= e || f >= 1.0 - e;
        // A kernel of equal weights jumps where its first texel changes; the others are continuous, and
        // of those texels that come in or go only the weight 0 is affected.
        let mut unsure = near_line(fraction.x, exact.bounds.texel.x)
            || near_line(fraction.y, exact.bounds.texel.y);
        let mut sum = 0.0;
        for j in 0..self.kernel.texels() {
            for i in 0..self.kernel.texels() {
                let texel = first + DVec2::new(f64::from(i), f64::from(j));
                let x = (texel.x as i64).clamp(0, last) as usize;
                let y = (texel.y as i64).clamp(0, last) as usize;
                let stored = f64::from(self.map[y * self.size + x]);
                let center = if self.one_reference { exact.at.texel } else { texel + 0.5 };
                let reference = exact.reference(center);
                let weight = self.kernel.weight(i, fraction.x) * self.kernel.weight(j, fraction.y);
                unsure |= weight > 0.0 && (stored - reference).abs() <= exact.bounds.rounding;
                if stored <= reference.clamp(0.0, 1.0) {
                    sum += weight;
                }
            }
        }
        (sum, unsure)
    }
}

/// Outcome of comparing a filter on the GPU with brute force.
#[derive(Debug, Default)]
struct Agreement {
    samples: usize,
    penumbra: usize,
    unsure: usize,
    /// Samples that differ by more than the tolerance.
    wrong: usize,
    worst: f64,
}

fn agreement(
    gpu: &Gpu,
    stage: &Stage,
    light: &Light,
    estimator: &Estimator,
    kernel: Separable,
    tolerance: f64,
) -> Agreement {
    const SIZE: u32 = 256;
    let config = MapConfig { size: SIZE, ..MapConfig::default() };
    let mut technique = MapTechnique::new(gpu, &config, estimator.clone()).expect("valid");
    let shot = stage.shoot(gpu, light, &mut technique, 0).expect("a shot");
    let view = technique.map().views()[0];
    let map = technique.map().texture().expect("a map with casters");
    let map = read_f32_texture(gpu, map, 0).expect("read back");
    let brute = Brute {
        kernel,
        map: &map,
        size: SIZE as usize,
        one_reference: estimator.read == MapRead::Comparison,
    };
    let mut found = Agreement::default();
    let clip = view.clip.expect("a view with casters").as_mat4().as_dmat4();
    for (sample, v) in stage.view_samples().iter().zip(&shot.visibility) {
        let (p, n) = (sample.position.as_dvec3(), sample.normal.as_dvec3());
        let c = clip * p.extend(1.0);
        let to_light = view.light.truncate() - view.light.w * p;
        // Away from the light and the map's border, where rounding decides another question.
        let margin = c.w * (1.0 - 1e-5);
        let inside = c.w > 0.0 && c.x.abs() <= margin && c.y.abs() <= margin;
        if n == DVec3::ZERO || n.dot(to_light.normalize()) < 1e-3 || !inside {
            continue;
        }
        let exact = exact(&view, f64::from(SIZE), p, n, estimator);
        let (expected, unsure) = brute.visibility(&exact);
        found.samples += 1;
        found.penumbra += usize::from(expected > 1e-9 && expected < 1.0 - 1e-9);
        found.unsure += usize::from(unsure);
        let error = (f64::from(*v) - expected).abs();
        // A weight changes by at most 1 a texel an axis, and sums round: 64 roundings, most of them of
        // numbers far below 1.
        let bound = 2.0 * exact.bounds.texel.element_sum() + 64.0 * U + tolerance;
        if !unsure {
            found.worst = found.worst.max(error);
            found.wrong += usize::from(error > bound);
        }
    }
    found
}

fn stage_and_lights(gpu: &Gpu) -> (Stage, Vec<Light>) {
    let mut scene = generate::sphere_over_plane(&Default::default());
    scene.add(
        generate::shapes::cuboid(DVec3::new(0.6, 0.0, -0.9), DVec3::new(1.0, 0.8, -0.5)),
        glam::DAffine3::from_rotation_y(0.3),
    );
    let stage = Stage::new(gpu, &scene, scene.camera_or_framing(), 256, 256).expect("a stage");
    let light = |kind| scene.place_light(kind);
    let lights = vec![light(LightKind::Directional), light(LightKind::Spot)];
    (stage, lights)
}

#[test]
fn separable_filters_agree_with_brute_force() {
    let gpu = gpu();
    let (stage, lights) = stage_and_lights(&gpu);
    let valid = "a valid config";
    let mut filters = vec![
        (Estimator::nearest(), Separable::Box { side: 1 }),
        (PcfCubic::default().estimator(), Separable::Cubic),
        (PcfHardware::default().estimator(), Separable::Tent { side: 1 }),
    ];
    for side in [2, 3, 7] {
        let estimator = PcfGrid { side, ..Default::default() }.estimator().expect(valid);
        filters.push((estimator, Separable::Box { side }));
    }
    for side in [1, 3, 4] {
        let estimator = PcfBilinearGrid { side, ..Default::default() }.estimator().expect(valid);
        filters.push((estimator, Separable::Tent { side }));
    }
    for side in [3, 5, 7] {
        let estimator = PcfCastano { side, ..Default::default() }.estimator().expect(valid);
        filters.push((estimator, Separable::Castano { side }));
    }
    for light in &lights {
        for (estimator, kernel) in &filters {
            let found = agreement(&gpu, &stage, light, estimator, *kernel, 0.0);
            assert!(found.samples > 4000, "{kernel:?}: {found:?}");
            assert!(found.penumbra > 50 || kernel.texels() == 1, "{kernel:?}: {found:?}");
            assert_eq!(found.wrong, 0, "{kernel:?} under {light:?}: {found:?}");
            // One in a hundred: a kernel of 64 texels has as many chances to be close.
            assert!(100 * found.unsure <= found.samples, "{kernel:?}: {found:?}");
        }
    }
}

#[test]
fn the_comparison_notices_another_kernel() {
    let gpu = gpu();
    let (stage, lights) = stage_and_lights(&gpu);
    let three = PcfGrid { side: 3, ..Default::default() }.estimator().expect("a valid config");
    for kernel in [
        Separable::Box { side: 2 },
        Separable::Box { side: 5 },
        Separable::Tent { side: 3 },
        Separable::Castano { side: 3 },
    ] {
        let found = agreement(&gpu, &stage, &lights[0], &three, kernel, 0.0);
        assert!(2 * found.wrong > found.penumbra, "{kernel:?} passes for a 3 x 3 box: {found:?}");
    }
}

#[test]
fn comparison_by_the_sampler_is_bilinear_within_a_128th() {
    let gpu = gpu();
    let (stage, lights) = stage_and_lights(&gpu);
    let hardware = PcfHardware { comparison: true, ..Default::default() }.estimator();
    for light in &lights {
        let kernel = Separable::Tent { side: 1 };
        let found = agreement(&gpu, &stage, light, &hardware, kernel, 1.0 / 128.0);
        assert!(found.penumbra > 50, "{found:?}");
        assert_eq!(found.wrong, 0, "{found:?}");
        assert!(100 * found.unsure <= found.samples, "{found:?}");
    }
}

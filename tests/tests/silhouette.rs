//! Silhouettes on the GPU: against their twins in f64, and as shadows against the truth.

use antumbra_gpu::{
    Casters, Drawn, Edges, Expectation, Frame, Gpu, GpuError, LightView, Technique,
    TechniqueConfig as _, bind, read_buffer, wgpu,
};
use antumbra_measure::stability::CASES;
use antumbra_measure::{MeasureError, Stage};
use antumbra_reference::{SampleClass, Truth, TruthOptions};
use antumbra_scene::generate::{self, shapes};
use antumbra_scene::{Camera, Light, LightKind, Scene};
use antumbra_tests::{Random, gpu};
use antumbra_volume::silhouette::twin::{determinant, magnitude, may_shadow, weights};
use antumbra_volume::silhouette::{Counted, Meshes, Silhouette};
use antumbra_volume::{Counter, Savings, Side, homogeneous_light};
use glam::{DAffine3, DVec3, Vec3, Vec4};

const HARD: [LightKind; 3] = [LightKind::Directional, LightKind::Spot, LightKind::Point];

/// Unit roundoff of f32.
const U: f64 = 1.0 / 16_777_216.0;

fn stage(gpu: &Gpu, scene: &Scene, side: u32) -> Stage {
    Stage::new(gpu, scene, scene.camera_or_framing(), side, side).expect("a stage")
}

fn shoot(gpu: &Gpu, stage: &Stage, light: &Light, config: &Silhouette) -> Vec<f32> {
    let mut technique = config.build(gpu).expect("a valid config");
    stage.shoot(gpu, light, technique.as_mut(), 0).expect("a shot").visibility
}

/// Every value of every option, and those that have to do with one another together.
fn configs() -> [Silhouette; 4] {
    let usual = Silhouette::default();
    let savings = Savings { litmap: 64, ..Savings::ALL };
    [
        Silhouette { culling: false, ..usual },
        Silhouette { counter: Counter::Stencil, savings, ..usual },
        Silhouette { meshes: Meshes::Mixed, method: Counted::Choose, ..usual },
        Silhouette { meshes: Meshes::Mixed, counter: Counter::Stencil, ..usual },
    ]
}

fn techniques(gpu: &Gpu) -> Vec<(Silhouette, Box<dyn Technique>)> {
    configs().into_iter().map(|c| (c, c.build(gpu).expect("a valid config"))).collect()
}

/// How many samples that count are not as in the truth, and how many count.
fn wrong(stage: &Stage, light: &Light, visibility: &[f32]) -> (usize, usize) {
    let options = TruthOptions { ties: true, ..TruthOptions::default() };
    wrong_against(&stage.truth(light, &options), visibility)
}

fn wrong_against(truth: &Truth, visibility: &[f32]) -> (usize, usize) {
    let counted = (0..visibility.len()).filter(|i| truth.class[*i] == SampleClass::Counted);
    let differs = |i: &usize| visibility[*i] != truth.visibility[*i];
    (counted.clone().filter(differs).count(), counted.count())
}

/// Which side a triangle shows the light, and what is left over each edge, on every generated scene.
#[test]
fn triangles_show_the_side_that_they_show_and_edges_weigh_what_they_weigh() {
    let gpu = gpu();
    let config = Silhouette { culling: false, ..Silhouette::default() };
    let mut technique = config.technique(&gpu).expect("a valid config");
    let mut certain = 0;
    for (name, make, _) in generate::ALL {
        let scene = make();
        let stage = stage(&gpu, &scene, 8);
        let (positions, triangles) = stage.meshes.geometry(&gpu).expect("read back");
        let edges = Edges::new(&positions, &triangles);
        for kind in HARD {
            let light = scene.place_light(kind);
            stage.shoot(&gpu, &light, &mut technique, 0).expect("a shot");
            let casters = technique.silhouettes().read_casters(&gpu).expect("read back");
            let lit = homogeneous_light(&stage.frame(&light)).as_dvec4();
            for (triangle, k) in triangles.iter().zip(&casters) {
                let corners = triangle.map(|i| positions[i as usize].as_dvec3());
                let [a, b, c] = corners;
                let exact = determinant(lit, corners);
                // What f32 cannot tell: the shader's bound of 8 u, taken at any of the corners, as much again for
                // the error itself, and the rounding of the bound.
                let turned = [[a, b, c], [b, c, a], [c, a, b]];
                let scale = turned.map(|t| magnitude(lit, t)).into_iter().fold(0.0, f64::max);
                let unclear = exact.abs() <= 17.0 * U * scale;
                let right = f64::from(*k) * exact > 0.0;
                assert!(
                    right || (*k == 0 && unclear),
                    "{name}, {kind:?}: {k} for {exact} of {scale}"
                );
                certain += usize::from(*k != 0);
            }
            let found = technique.silhouettes().read_weights(&gpu).expect("read back");
            let expected: Vec<[i32; 2]> =
                weights(&edges, &casters).into_iter().map(|w| [w, 0]).collect();
            assert!(found == expected, "{name}, {kind:?}: other weights");
            let [sides, caps, _] = technique.silhouettes().read_sizes(&gpu).expect("read back");
            let count = expected.iter().filter(|w| w[0] != 0).count();
            assert_eq!(sides, count as u64, "{name}, {kind:?}: sides in the list");
            let count = casters.iter().filter(|k| **k != 0).count();
            assert_eq!(caps, count as u64, "{name}, {kind:?}: caps in the list");
        }
    }
    assert!(certain > 10_000, "only {certain} triangles show the light a side");
}

#[test]
fn shadows_are_right_on_every_generated_scene() {
    let gpu = gpu();
    let mut faults = Vec::new();
    let mut techniques = techniques(&gpu);
    let options = TruthOptions { ties: true, ..TruthOptions::default() };
    for (index, (name, make, _)) in generate::ALL.iter().chain(generate::CONVEX).enumerate() {
        let scene = make();
        let stage = stage(&gpu, &scene, 64);
        let large = scene.triangle_count() > 10_000;
        for (turn, kind) in HARD.into_iter().enumerate() {
            // Scenes of tens of thousands of triangles take seconds: one light for each of them.
            if large && turn != index % 3 {
                continue;
            }
            let light = scene.light_or_placed(kind);
            let truth = stage.truth(&light, &options);
            // Each scene with all of them, each under another of the lights.
            for (config, technique) in techniques.iter_mut().skip((index + turn) % 2).step_by(2) {
                let shot = stage.shoot(&gpu, &light, technique.as_mut(), 0).expect("a shot");
                let (wrong, all) = wrong_against(&truth, &shot.visibility);
                if wrong > 0 {
                    faults.push(format!("{name}, {kind:?}, {config:?}: {wrong} of {all} wrong"));
                }
                // Asking all triangles is what samples are spared. Grass, thousands of blades whose sides all cross
                // the lines of sight below the ground, comes nearest: one in ten.
                let doubtful = shot.counters["doubtful_samples"];
                if doubtful * 5 > all as u64 {
                    faults.push(format!("{name}, {kind:?}, {config:?}: {doubtful} of {all} asked"));
                }
            }
        }
    }
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

#[test]
fn a_shadow_of_another_light_is_wrong() {
    let gpu = gpu();
    let scene = generate::unorientable();
    let stage = stage(&gpu, &scene, 96);
    let other = shoot(&gpu, &stage, &scene.lights[1], &Silhouette::default());
    let (noticed, all) = wrong(&stage, &scene.lights[0], &other);
    assert!(noticed * 50 > all, "{noticed} of {all} samples notice");
}

/// HC-24: the light in a closed cube darkens the world outside, and lights all inside.
#[test]
fn a_closed_body_around_the_light_keeps_its_light() {
    let gpu = gpu();
    let mut scene = Scene::default();
    scene.add(shapes::floor(6.0), DAffine3::IDENTITY);
    scene.add(
        shapes::cuboid(DVec3::new(-1.0, 0.5, -1.0), DVec3::new(1.0, 2.5, 1.0)),
        DAffine3::IDENTITY,
    );
    let light = Light::Point { position: DVec3::new(0.1, 1.6, 0.2) };
    let mut techniques = techniques(&gpu);
    for eye in [DVec3::new(0.0, 4.0, 9.0), DVec3::new(0.7, 1.2, 0.6)] {
        let camera =
            Camera { eye, target: DVec3::new(0.0, 0.7, 0.0), up: DVec3::Y, fov_y: 1.0, near: 0.05 };
        let stage = Stage::new(&gpu, &scene, camera, 96, 96).expect("a stage");
        for (config, technique) in &mut techniques {
            let shot = stage.shoot(&gpu, &light, technique.as_mut(), 0).expect("a shot");
            let (wrong, all) = wrong(&stage, &light, &shot.visibility);
            assert!(wrong == 0 && all > 0, "{config:?} from {eye}: {wrong} of {all} wrong");
        }
    }
}

#[test]
fn closed_bodies_need_half_the_caps_and_the_same_sides() {
    let gpu = gpu();
    let mut scene = Scene::default();
    scene.add(shapes::icosphere(4, 1.0), DAffine3::IDENTITY);
    let stage = stage(&gpu, &scene, 64);
    let light = scene.place_light(LightKind::Point);
    let shot = |meshes| {
        let config = Silhouette { meshes, ..Silhouette::default() };
        let mut technique = config.build(&gpu).expect("a valid config");
        stage.shoot(&gpu, &light, technique.as_mut(), 0).expect("a shot")
    };
    let (soup, closed) = (shot(Meshes::Soup), shot(Meshes::Watertight));
    assert_eq!(soup.visibility, closed.visibility, "the same shadow");
    assert_eq!(soup.counters["volume_sides"], closed.counters["volume_sides"], "one silhouette");
    let caps = soup.counters["volume_caps"];
    assert!(closed.counters["volume_caps"] < caps * 6 / 10, "{closed:?} of {caps} caps");
    // A sphere of n triangles has a silhouette of about sqrt(n) edges: here about pi sqrt(5120 / 5) / 2.
    let sides = soup.counters["volume_sides"];
    assert!((40..400).contains(&sides), "{sides} sides of {} edges", soup.counters["edges"]);
}

#[test]
fn casters_that_are_not_as_was_said_are_refused() {
    let gpu = gpu();
    let refusal = |scene: &Scene, meshes| {
        let stage = stage(&gpu, scene, 8);
        let config = Silhouette { meshes, ..Silhouette::default() };
        let mut technique = config.build(&gpu).expect("a valid config");
        technique.prepare(&gpu, &stage.frame(&scene.place_light(LightKind::Point)))
    };
    let sheet = generate::rectangle_over_plane(&Default::default());
    let pages = generate::non_manifold();
    let mut ball = Scene::default();
    ball.add(shapes::icosphere(1, 1.0), DAffine3::IDENTITY);
    for (scene, meshes, fine) in [
        (&sheet, Meshes::Manifold, true),
        (&sheet, Meshes::Watertight, false),
        (&pages, Meshes::Manifold, false),
        (&pages, Meshes::Mixed, true),
        (&ball, Meshes::Manifold, true),
        (&ball, Meshes::Watertight, true),
    ] {
        match refusal(scene, meshes) {
            Ok(()) => assert!(fine, "{}, {meshes:?} passed", scene.name),
            Err(GpuError::Invalid { what: "casters", .. }) => {
                assert!(!fine, "{}, {meshes:?} was refused", scene.name);
            }
            Err(other) => panic!("{}, {meshes:?}: {other}", scene.name),
        }
    }
}

/// Casters whose triangles are known and whose edges are not.
struct WithoutEdges<'a>(&'a dyn Casters);

impl Casters for WithoutEdges<'_> {
    fn hull(&self, light: &Light, visit: &mut dyn FnMut(DVec3)) {
        self.0.hull(light, visit);
    }

    fn draw(&self, view: &LightView<'_>, pass: &mut wgpu::RenderPass<'_>) -> Drawn {
        self.0.draw(view, pass)
    }

    fn triangles(&self) -> Option<antumbra_gpu::CasterTriangles<'_>> {
        self.0.triangles()
    }
}

#[test]
fn casters_without_edges_are_refused_and_nothing_casts_nothing() {
    let gpu = gpu();
    let scene = generate::cube_on_floor();
    let stage = stage(&gpu, &scene, 16);
    let mut technique = Silhouette::default().technique(&gpu).expect("a valid config");
    let light = scene.lights[0];
    let casters = WithoutEdges(&stage.meshes);
    let frame = Frame { casters: &casters, ..stage.frame(&light) };
    let refused = technique.prepare(&gpu, &frame);
    assert!(matches!(refused, Err(GpuError::Invalid { what: "casters", .. })), "{refused:?}");
    // Of one degenerate triangle and of none.
    let mut empty = Scene::default();
    for triangles in [Vec::new(), vec![[0, 1, 1]]] {
        let mut mesh = shapes::floor(1.0);
        mesh.triangles = triangles;
        empty.add(mesh, DAffine3::IDENTITY);
        let none = Stage::new(&gpu, &empty, scene.camera_or_framing(), 16, 16);
        // The ray tracer may have nothing to say of a scene without triangles.
        let Ok(none) = none else { continue };
        let shot = none.shoot(&gpu, &light, &mut technique, 0).expect("a shot");
        assert!(shot.visibility.iter().all(|v| *v == 1.0), "all lit");
        assert_eq!(shot.counters["volume_sides"], 0, "no sides");
    }
}

#[test]
fn two_runs_make_the_same_lists() {
    let gpu = gpu();
    let scene = generate::tree(&Default::default());
    let stage = stage(&gpu, &scene, 32);
    let light = scene.place_light(LightKind::Point);
    let lists = || {
        let mut technique = Silhouette::default().technique(&gpu).expect("a valid config");
        stage.shoot(&gpu, &light, &mut technique, 1).expect("a shot");
        let [sides, caps, _] = technique.silhouettes().read_sizes(&gpu).expect("read back");
        let faces = technique.faces().expect("faces");
        let read = |buffer, size| read_buffer(&gpu, buffer, size).expect("read back");
        (
            read(&faces.sides, size_of::<Side>() as u64 * sides),
            read(&faces.caps, 12 * caps),
            read(&faces.draws, 32),
        )
    };
    let first = lists();
    assert!(!first.0.is_empty() && !first.1.is_empty(), "there are faces");
    assert!(first == lists(), "another order");
}

const MAY_SHADOW: &str = "
import package::volume::reach::{Box, may_shadow};

// Light; caster: lowest and highest corner; receiver likewise.
@group(0) @binding(0) var<storage, read> cases: array<vec4f>;
@group(0) @binding(1) var<storage, read_write> answers: array<u32>;

fn box_at(i: u32) -> Box {
    return Box(cases[i].xyz, 0.0, cases[i + 1u].xyz, 0.0);
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3u) {
    let i = 5u * id.x;
    if id.x < arrayLength(&answers) {
        answers[id.x] = select(0u, 1u, may_shadow(cases[i], box_at(i + 1u), box_at(i + 3u)));
    }
}";

/// A light, the corners of a caster's box and those of a receiver's.
struct MayShadow {
    light: Vec4,
    caster: [Vec3; 2],
    receiver: [Vec3; 2],
}

impl MayShadow {
    fn twin(&self, larger: f64) -> bool {
        let [caster, receiver] = [self.caster, self.receiver].map(|b| b.map(|p| p.as_dvec3()));
        may_shadow(self.light.as_dvec4(), caster, receiver, larger)
    }
}

/// Numbers in [-1, 1).
struct Numbers(Random);

impl Numbers {
    fn next(&mut self) -> f32 {
        (self.0.bits() >> 40) as f32 / 8_388_608.0 - 1.0
    }

    fn vector(&mut self) -> Vec3 {
        Vec3::new(self.next(), self.next(), self.next())
    }

    /// A box around `center` with sides over three decades.
    fn around(&mut self, center: Vec3) -> [Vec3; 2] {
        let mut side = || 10_f32.powf(1.5 * self.next() - 1.0);
        let half = Vec3::new(side(), side(), side());
        [center - half, center + half]
    }

    /// A caster more or less between a receiver and the light.
    fn may_shadow(&mut self, point: bool) -> MayShadow {
        let r = self.vector() * 10.0;
        let (light, along) = if point {
            let p = self.vector() * 10.0;
            (p.extend(1.0), r.lerp(p, self.next() * 1.2))
        } else {
            let d = self.vector().normalize_or(Vec3::Y);
            (d.extend(0.0), r + d * self.next() * 10.0)
        };
        let c = along + self.vector() * 2.0;
        MayShadow { light, caster: self.around(c), receiver: self.around(r) }
    }
}

fn may_shadow_on_the_gpu(gpu: &Gpu, cases: &[MayShadow]) -> Vec<bool> {
    let flat: Vec<Vec4> = cases
        .iter()
        .flat_map(|m| {
            let [[a, b], [c, d]] = [m.caster, m.receiver].map(|b| b.map(|p| p.extend(0.0)));
            [m.light, a, b, c, d]
        })
        .collect();
    let wgsl =
        antumbra_shaders::link_source("tests::may_shadow", MAY_SHADOW, &[]).expect("it links");
    let pipeline = gpu.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: Some("may shadow"),
        layout: None,
        module: &gpu.shader("may shadow", wgsl),
        entry_point: Some("main"),
        compilation_options: Default::default(),
        cache: None,
    });
    let storage = wgpu::BufferUsages::STORAGE;
    let input = gpu.buffer("cases", bytemuck::cast_slice(&flat), storage);
    let answers = vec![2_u32; cases.len()];
    let output = gpu.buffer(
        "answers",
        bytemuck::cast_slice(&answers),
        storage | wgpu::BufferUsages::COPY_SRC,
    );
    let group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: None,
        layout: &pipeline.get_bind_group_layout(0),
        entries: &[bind::buffer(0, &input), bind::buffer(1, &output)],
    });
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    let mut pass = encoder.begin_compute_pass(&Default::default());
    pass.set_pipeline(&pipeline);
    pass.set_bind_group(0, &group, &[]);
    pass.dispatch_workgroups((cases.len() as u32).div_ceil(64), 1, 1);
    drop(pass);
    gpu.queue.submit([encoder.finish()]);
    let bytes = read_buffer(gpu, &output, 4 * cases.len() as u64).expect("read back");
    bytemuck::cast_slice::<u8, u32>(&bytes).iter().map(|a| *a == 1).collect()
}

/// The shader must not say no where the twin says yes, nor yes where the twin says no of spheres a 50th larger: the
/// shader's radii are larger by a 1024th, and its slack of 32u in a cosine, at most sqrt(64u) = 2e-3 in an angle, is
/// less than a 50th of the angle of most. Few may be kept for nothing.
#[test]
fn what_may_shadow_is_never_missed_and_little_else_is_kept() {
    let gpu = gpu();
    let mut random = Numbers(Random(1));
    let cases: Vec<_> = (0..100_000).map(|i| random.may_shadow(i % 2 == 0)).collect();
    let answers = may_shadow_on_the_gpu(&gpu, &cases);
    let (mut yes, mut needless) = (0, 0);
    for (case, answer) in cases.iter().zip(answers) {
        assert!(
            answer || !case.twin(1.0),
            "missed: {:?}",
            (case.light, case.caster, case.receiver)
        );
        yes += usize::from(answer);
        needless += usize::from(answer && !case.twin(1.02));
    }
    assert!((10_000..90_000).contains(&yes), "both answers occur: {yes} yes");
    assert!(needless < 100, "{needless} of {yes} kept for nothing");
}

/// Boxes at random against rays: what the twin says no to, no ray finds.
#[test]
fn no_ray_meets_a_caster_that_may_not_shadow() {
    let mut random = Numbers(Random(3));
    let (mut refused, mut met) = (0, 0);
    for i in 0..200_000 {
        let case = random.may_shadow(i % 2 == 0);
        let inside = |[low, high]: [Vec3; 2], at: Vec3| low + (high - low) * (0.5 * at + 0.5);
        let p = inside(case.receiver, random.vector()).as_dvec3();
        let light = case.light.as_dvec4();
        let way = light.truncate() - light.w * p;
        // Where the ray enters and leaves the three slabs of the caster's box.
        let [low, high] = case.caster.map(|c| (c.as_dvec3() - p) / way);
        let end = if light.w == 1.0 { 1.0 } else { f64::INFINITY };
        let enters = low.min(high).max_element().max(0.0);
        let leaves = low.max(high).min_element().min(end);
        let (may, hit) = (case.twin(1.0), enters < leaves);
        assert!(may || !hit, "{:?}, from {p}", (case.light, case.caster, case.receiver));
        refused += usize::from(!may);
        met += usize::from(hit);
    }
    assert!(refused > 10_000 && met > 2_000, "{refused} refused, {met} met");
}

/// HC-28: upstairs, nothing of the thousand cubes downstairs is drawn.
#[test]
fn what_shadows_nothing_in_view_is_left_away_and_changes_nothing() {
    let gpu = gpu();
    let [mut plain, mut culling] = [false, true].map(|culling| {
        let config = Silhouette { culling, ..Silhouette::default() };
        config.build(&gpu).expect("a valid config")
    });
    for (scene, most) in [
        (generate::two_storeys(true), 0.05),
        (generate::poles(30, false), 1.0),
        (generate::poles(30, true), 1.0),
        (generate::street(), 1.0),
    ] {
        let stage = stage(&gpu, &scene, 128);
        let lights = [scene.lights[0], scene.place_light(LightKind::Point)];
        for (i, light) in lights.into_iter().enumerate() {
            let [all, culled] = [&mut plain, &mut culling]
                .map(|technique| stage.shoot(&gpu, &light, technique.as_mut(), 0).expect("a shot"));
            assert!(all.visibility == culled.visibility, "{}: culling changes bits", scene.name);
            let (wrong, judged) = wrong(&stage, &light, &culled.visibility);
            assert!(wrong == 0 && judged > 0, "{}: {wrong} of {judged} wrong", scene.name);
            let (before, after) =
                (all.counters["casting_bodies"], culled.counters["casting_bodies"]);
            assert_eq!(before, all.counters["bodies"], "{}: all cast", scene.name);
            assert!(after > 0 && after <= before, "{}: {after} of {before}", scene.name);
            if i == 0 {
                let share = after as f64 / before as f64;
                assert!(share <= most, "{}: {after} of {before} bodies cast", scene.name);
            }
        }
    }
}

#[test]
fn hard_cases_are_as_expected() {
    let gpu = gpu();
    let mut surprises = Vec::new();
    for (config, mut technique) in techniques(&gpu) {
        for case in CASES {
            let Some(expected) = config.expectation(case.name) else { continue };
            let measured = case.measure(&gpu, technique.as_mut(), 1024);
            let as_expected = match (&measured, &expected) {
                (Err(MeasureError::Gpu(_)), Expectation::Refuses { .. }) => true,
                (Ok(number), _) => expected.is_met_by(*number),
                (Err(_), _) => false,
            };
            if !as_expected {
                let case = case.name;
                surprises.push(format!("{case}, {config:?}: {measured:?}, not {expected:?}"));
            }
        }
    }
    assert!(surprises.is_empty(), "not as expected:\n{}", surprises.join("\n"));
}

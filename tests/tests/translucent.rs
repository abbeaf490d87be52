//! Casters that let light through: `volume/translucent` against the tracer and against what is known of single sheets.

use std::sync::Arc;

use antumbra::Config;
use antumbra_filter::PcfCastano;
use antumbra_gpu::{Casters, Gpu, TechniqueConfig as _, bind, read_buffer};
use antumbra_map::{MapConfig, Plain};
use antumbra_measure::stability::Case;
use antumbra_measure::{Shot, Stage};
use antumbra_reference::{SampleClass, TruthOptions};
use antumbra_scene::generate::{self, shapes};
use antumbra_scene::{AlphaMap, Camera, Light, LightKind, Opacity, Scene, Wrap};
use antumbra_tests::gpu;
use antumbra_volume::{Silhouette, Translucent, Triangle, twin};
use glam::{DAffine3, DVec3, Vec2};

const KINDS: [LightKind; 3] = [LightKind::Directional, LightKind::Spot, LightKind::Point];

fn stage(gpu: &Gpu, scene: &Scene, camera: Camera) -> Stage {
    Stage::new(gpu, scene, camera, 128, 128).expect("a stage")
}

fn over<E: antumbra_gpu::TechniqueConfig>(gpu: &Gpu, stage: &Stage, light: &Light, of: E) -> Shot {
    let mut technique = Translucent { of }.build(gpu).expect("a valid config");
    stage.shoot(gpu, light, technique.as_mut(), 0).expect("a shot")
}

/// Counted samples whose visibility is off by more than `by`, and those that some sheet weakens.
fn wrong(stage: &Stage, light: &Light, visibility: &[f32], by: f32) -> (usize, usize) {
    let truth = stage.truth(light, &TruthOptions { ties: true, ..Default::default() });
    let counted = (0..visibility.len()).filter(|&i| truth.class[i] == SampleClass::Counted);
    let (mut off, mut weakened) = (0, 0);
    for i in counted {
        let right = (visibility[i] - truth.visibility[i]).abs() <= by;
        off += usize::from(!right);
        weakened += usize::from(truth.visibility[i] > 0.0 && truth.visibility[i] < 1.0);
    }
    (off, weakened)
}

/// The truth's rays begin 32 u of 10 m above the floor, 2e-5 m, which moves what they meet by as much times the light's
/// slope, up to 1.5 here; positions are rounded to 16 u, 1e-5 m. Across a bar's edge alpha rises by 1 in a texel of
/// 4 m / 96, so that 4e-5 m are 1e-3; what the sum of logarithms adds is below 1e-5 (`expectation::translucent`).
const TOLERANCE: f32 = 1e-3;

#[test]
fn light_through_panes_and_painted_glass_is_that_of_the_tracer() {
    let gpu = gpu();
    for (name, make, _) in generate::TRANSLUCENT {
        let scene = make();
        for kind in KINDS {
            let light = scene.light_or_placed(kind);
            let framing = scene.camera_or_framing();
            // From behind and from below the panes, too.
            let behind = Camera { eye: DVec3::new(2.5, 0.6, 4.5), target: DVec3::ZERO, ..framing };
            for camera in [framing, behind] {
                let stage = stage(&gpu, &scene, camera);
                let shot = over(&gpu, &stage, &light, Silhouette::default());
                let (off, weakened) = wrong(&stage, &light, &shot.visibility, TOLERANCE);
                assert_eq!(off, 0, "{name}, {kind:?}, {:?}: wrong samples", camera.eye);
                assert!(weakened > 100, "{name}, {kind:?}: {weakened} samples behind glass");
                let triangles = shot.counters["translucent_triangles"];
                assert!(triangles > 0 && shot.counters["asked_translucent"] > 0, "{triangles}");
            }
        }
        // The controls: without the pass, and with a light aside.
        let light = scene.light_or_placed(LightKind::Directional);
        let stage = stage(&gpu, &scene, scene.camera_or_framing());
        let mut opaque = Silhouette::default().build(&gpu).expect("a valid config");
        let alone = stage.shoot(&gpu, &light, opaque.as_mut(), 0).expect("a shot");
        assert!(wrong(&stage, &light, &alone.visibility, TOLERANCE).0 > 100, "{name}: all lit");
        let Light::Directional { direction, .. } = light else { panic!("a sun") };
        let direction = (direction + 0.05 * DVec3::X).normalize();
        let aside = Light::Directional { direction, angular_diameter: 0.0 };
        let moved = over(&gpu, &stage, &aside, Silhouette::default());
        assert!(wrong(&stage, &light, &moved.visibility, TOLERANCE).0 > 100, "{name}: another sun");
    }
}

/// A floor and a wavy sheet over it of `side` x `side` squares, with a texture all over it.
fn sheet(side: u32, alpha: AlphaMap, factor: f32) -> Scene {
    let mut scene = Scene { name: "sheet".to_owned(), ..Scene::default() };
    scene.add(shapes::floor(6.0), DAffine3::IDENTITY);
    let mut mesh = shapes::quad(DVec3::ZERO, DVec3::X, DVec3::Z).named("sheet");
    let place = |i: u32| Vec2::new((i % (side + 1)) as f32, (i / (side + 1)) as f32) / side as f32;
    let count = (side + 1) * (side + 1);
    mesh.positions = (0..count)
        .map(|i| {
            let at = 4.0 * place(i) - 2.0;
            glam::Vec3::new(at.x, 1.5 + 0.3 * (3.0 * at.x).sin() * (2.0 * at.y).cos(), at.y)
        })
        .collect();
    mesh.triangles = (0..side * side)
        .flat_map(|i| {
            let a = i / side * (side + 1) + i % side;
            [[a, a + 1, a + side + 1], [a + 1, a + side + 2, a + side + 1]]
        })
        .collect();
    let uv = (0..count).map(|i| 2.0 * place(i)).collect();
    scene.opacities.insert(1, Arc::new(Opacity { uv, alpha: Arc::new(alpha), factor }));
    scene.add(mesh, DAffine3::IDENTITY);
    scene
}

fn cloth(nearest: bool) -> AlphaMap {
    let texels = (0..64).map(|i: u32| (i * 37 % 256) as u8).collect();
    AlphaMap { width: 8, height: 8, texels, wrap: [Wrap::Mirror; 2], nearest }
}

#[test]
fn no_triangle_of_a_sheet_counts_twice_and_the_order_of_triangles_changes_no_bit() {
    let gpu = gpu();
    // 1800 triangles: many batches.
    let scene = sheet(30, cloth(false), 0.9);
    let mut turned = scene.clone();
    turned.meshes[1].triangles.reverse();
    for kind in KINDS {
        let light = scene.place_light(kind);
        let camera = scene.camera_or_framing();
        let [one, other] = [&scene, &turned].map(|s| stage(&gpu, s, camera));
        let shots = [&one, &other].map(|s| over(&gpu, s, &light, Triangle::default()).visibility);
        assert!(shots[0] == shots[1], "{kind:?}: bits depend on the order");
        let (off, weakened) = wrong(&one, &light, &shots[0], TOLERANCE);
        assert_eq!(off, 0, "{kind:?}: wrong samples");
        assert!(weakened > 200, "{kind:?}: {weakened} samples behind the sheet");
    }
}

#[test]
fn opacity_0_is_no_caster_and_opacity_1_is_an_opaque_one() {
    let gpu = gpu();
    let full = AlphaMap { width: 1, height: 1, texels: vec![255], ..AlphaMap::default() };
    for kind in KINDS {
        let mut opaque = sheet(6, full.clone(), 1.0);
        opaque.opacities.clear();
        let (light, camera) = (opaque.place_light(kind), opaque.camera_or_framing());
        let shoot = |factor: f32| {
            let scene = sheet(6, full.clone(), factor);
            let stage = stage(&gpu, &scene, camera);
            over(&gpu, &stage, &light, Triangle::default()).visibility
        };
        // The opaque sheet is in view; samples of the floor are compared.
        let mut floor = opaque.clone();
        floor.instances.truncate(1);
        let seen = stage(&gpu, &floor, camera).view_samples();
        let whole = Stage::at_points(&gpu, &opaque, &seen).expect("a stage");
        let mut triangle = Triangle::default().build(&gpu).expect("a valid config");
        let expected = whole.shoot(&gpu, &light, triangle.as_mut(), 0).expect("a shot").visibility;
        let found = shoot(1.0);
        assert!(found.len() <= expected.len() && found == expected[..found.len()], "{kind:?}");
        assert!(found.contains(&0.0), "{kind:?}: a shadow");
        assert!(shoot(0.0).iter().all(|v| *v == 1.0), "{kind:?}: a shadow of nothing");
    }
}

#[test]
fn sheets_are_weighed_as_expected_over_every_kind_of_technique() {
    let gpu = gpu();
    let case = Case::by_name("HC-36 panes").expect("a case of that name");
    let map = MapConfig { size: 256, ..MapConfig::default() };
    for of in [
        Config::Plain(Plain { map }),
        Config::PcfCastano(PcfCastano { map, ..PcfCastano::default() }),
        Config::VolumeTriangle(Triangle::default()),
        Config::Pcss(Default::default()),
    ] {
        let config = Config::Translucent(Translucent { of: Box::new(of) });
        let mut technique = config.build(&gpu).expect("a valid config");
        let off = case.measure(&gpu, technique.as_mut(), 256).expect("measured");
        let expected = config.expectation(case.name).expect("an expectation");
        assert!(expected.is_met_by(off), "{config:?}: {off}, not {expected:?}");
    }
    // The control: what knows no sheets leaves all the light.
    let mut plain = Plain { map }.build(&gpu).expect("a valid config");
    let off = case.measure(&gpu, plain.as_mut(), 256).expect("measured");
    assert_eq!(off, 1.0 - 0.5_f64.powi(10), "without a look at sheets");
}

#[test]
fn a_scene_without_sheets_has_no_pass_and_the_other_techniques_bits() {
    let gpu = gpu();
    let scene = generate::cube_on_floor();
    let stage = stage(&gpu, &scene, scene.camera_or_framing());
    assert!(stage.meshes.translucent().is_none(), "nothing lets light through");
    let light = scene.lights[0];
    let mut plain = Plain::default().build(&gpu).expect("a valid config");
    let alone = stage.shoot(&gpu, &light, plain.as_mut(), 1).expect("a shot");
    let mut both = Translucent { of: Plain::default() }.build(&gpu).expect("a valid config");
    let shot = stage.shoot(&gpu, &light, both.as_mut(), 1).expect("a shot");
    assert_eq!(shot.visibility, alone.visibility, "other bits");
    assert_eq!(shot.bytes, alone.bytes, "memory for nothing");
    let passes = |shot: &Shot| shot.passes[0].passes.len();
    assert_eq!(passes(&shot), passes(&alone), "a pass for nothing");
}

const LOGARITHMS: &str = "
import package::volume::translucent::{left_by, powers_kept};

@group(0) @binding(0) var<storage, read> opacities: array<f32>;
@group(0) @binding(1) var<storage, read_write> found: array<vec2u>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if id.x < arrayLength(&opacities) {
        let powers = powers_kept(opacities[id.x]);
        found[id.x] = vec2u(powers, bitcast<u32>(left_by(powers)));
    }
}";

#[test]
fn logarithms_are_their_twins_and_the_light_that_they_stand_for() {
    const COUNT: u32 = 1 << 17;
    let gpu = gpu();
    let wgsl = antumbra_shaders::link_source("tests::logarithms", LOGARITHMS, &[]).expect("links");
    let pipeline = gpu.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: Some("logarithms"),
        layout: None,
        module: &gpu.shader("logarithms", wgsl),
        entry_point: Some("main"),
        compilation_options: Default::default(),
        cache: None,
    });
    // All opacities of a texture of 8 bits are among them, and both ends.
    let opacities: Vec<f32> = (0..=COUNT).map(|i| i as f32 / COUNT as f32).collect();
    let storage = wgpu::BufferUsages::STORAGE;
    let given = gpu.buffer("opacities", bytemuck::cast_slice(&opacities), storage);
    let zeros = vec![0_u8; opacities.len() * 8];
    let out = gpu.buffer("found", &zeros, storage | wgpu::BufferUsages::COPY_SRC);
    let group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: Some("logarithms"),
        layout: &pipeline.get_bind_group_layout(0),
        entries: &[bind::buffer(0, &given), bind::buffer(1, &out)],
    });
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    let mut pass = encoder.begin_compute_pass(&Default::default());
    pass.set_pipeline(&pipeline);
    pass.set_bind_group(0, &group, &[]);
    pass.dispatch_workgroups((opacities.len() as u32).div_ceil(64), 1, 1);
    drop(pass);
    gpu.queue.submit([encoder.finish()]);
    let bytes = read_buffer(&gpu, &out, zeros.len() as u64).expect("read back");
    let found: Vec<[u32; 2]> = bytemuck::pod_collect_to_vec(&bytes);
    let mut last = 0;
    for (&opacity, [powers, left]) in opacities.iter().zip(&found) {
        // A step for rounding to one; of `log2`, 2^-21 below 2, and 3 ulp above: 17 of these are 2^-20 at most.
        let expected = twin::powers_kept(opacity);
        assert!(powers.abs_diff(expected) <= 2, "{opacity}: {powers} steps, not {expected}");
        assert!(*powers >= last, "{opacity}: less is kept than of less");
        last = *powers;
        // WGSL allows `exp2` 3 + 2 |x| ulp, five below a power of two.
        let (left, exact) =
            (f64::from(f32::from_bits(*left)), f64::from(twin::light_left(*powers)));
        assert!((left - exact).abs() <= 6.0 * exact * 2f64.powi(-23), "{powers}: {left}, {exact}");
        // Two steps of 2^-20 of a power are 2 ln 2 / 2^20 of the light.
        let through = 1.0 - f64::from(opacity);
        assert!((left - through).abs() <= 2e-6 * through, "{opacity}: {left} left");
    }
    assert_eq!(found[COUNT as usize / 2], [1 << 20, 0.5_f32.to_bits()], "a half");
    assert_eq!(found[0], [0, 1_f32.to_bits()], "nothing kept");
    assert_eq!(f32::from_bits(found[COUNT as usize][1]), 0.0, "all kept");
}

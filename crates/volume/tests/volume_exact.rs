//! Shadow volumes against ray-traced truth, sample by sample.
//!
//! Rasterisers snap vertices to 1/256 pixel, so that the edges of a volume are drawn up to eta = sqrt(2) / 256 pixel aside,
//! and a line of sight is taken past an edge on the wrong side. Mostly nothing comes of it: faces that meet at an edge
//! move together. A wrong sample is excused if, for some volume, the f64 twin of the count goes wrong as well when the line
//! is drawn up to eta aside.

use antumbra_gpu::{Gpu, GpuOptions, TechniqueConfig};
use antumbra_measure::Stage;
use antumbra_reference::{SampleClass, TruthOptions};
use antumbra_scene::{Camera, Light, LightKind, Scene, generate};
use antumbra_volume::{
    Auto, Counter, EyeCounter, Triangle, ZFail, ZpPlus, homogeneous_light, twin,
};
use glam::{DVec2, DVec3};

fn gpu() -> Gpu {
    Gpu::new(&GpuOptions::default()).unwrap_or_else(|e| panic!("{e}"))
}

const VIEW: u32 = 128;
const LIGHTS: [LightKind; 3] = [LightKind::Directional, LightKind::Spot, LightKind::Point];
const TIES: TruthOptions = TruthOptions {
    light_samples: 256,
    ties: true,
    tie_distance: 1e-5,
    position_error: 1.0 / (1 << 21) as f64,
    seed: 0,
};

/// What became of a comparison.
#[derive(Clone, Copy, Debug, Default)]
struct Score {
    /// Samples that face the light and are no ties.
    counted: usize,
    /// Those of them in shadow.
    dark: usize,
    /// Those of them that are wrong.
    wrong: usize,
    /// Those of the wrong ones that snapping does not explain.
    unexplained: usize,
}

/// Whether the count of some triangle's volume for sample `i` depends on where the line of sight is drawn.
fn depends_on_snapping(stage: &Stage, light: &Light, i: usize) -> bool {
    let frame = stage.frame(light);
    let camera = frame.camera.expect("a camera");
    let (p, n) = (stage.image.positions[i].as_dvec3(), stage.image.normals[i].as_dvec3());
    let ndc = camera.clip.project_point3(p);
    let inverse = camera.clip.inverse();
    let eta = std::f64::consts::SQRT_2 / 256.0;
    let beside = |angle: f64, aside: f64| {
        let step = DVec2::from_angle(angle) * (2.0 / f64::from(VIEW) * aside);
        inverse.project_point3(ndc + step.extend(0.0))
    };
    // Triangles in whose plane the sample lies are left out.
    let cosine = n.dot((camera.eye - p).normalize()).abs().max(1.0 / 16.0);
    let off = 1.01 * beside(0.25 * std::f64::consts::PI, eta).distance(p) / cosine;
    let ways: Vec<DVec3> = (0..64)
        .map(|k| (f64::from(k % 16) * std::f64::consts::PI / 8.0, f64::from(k / 16 + 1) / 4.0))
        .map(|(angle, part)| beside(angle, part * eta) - camera.eye)
        .collect();
    let at = homogeneous_light(&frame).as_dvec4();
    stage.triangles.triangles.iter().any(|t| {
        let corners = t.map(|v| stage.triangles.positions[v as usize].as_dvec3());
        let Some(volume) = twin::Volume::new(at, corners) else {
            return false;
        };
        let inside = volume.contains(p);
        if volume.distances(p)[3].abs() <= off {
            return inside;
        }
        ways.iter().any(|way| volume.count_behind(camera.eye, *way, p) != i32::from(inside))
    })
}

fn score(stage: &Stage, light: &Light, visibility: &[f32]) -> Score {
    let truth = stage.truth(light, &TIES);
    let mut score = Score::default();
    for (i, (v, t)) in visibility.iter().zip(&truth.visibility).enumerate() {
        if truth.class[i] != SampleClass::Counted {
            continue;
        }
        score.counted += 1;
        score.dark += usize::from(*t == 0.0);
        if v == t {
            continue;
        }
        score.wrong += 1;
        score.unexplained += usize::from(!depends_on_snapping(stage, light, i));
    }
    score
}

fn stage(gpu: &Gpu, scene: &Scene, camera: Camera) -> Stage {
    Stage::new(gpu, scene, camera, VIEW, VIEW).expect("a stage")
}

fn shoot(gpu: &Gpu, stage: &Stage, light: &Light, config: &dyn TechniqueConfig) -> Score {
    let mut technique = config.build(gpu).expect("a valid config");
    let shot = stage.shoot(gpu, light, technique.as_mut(), 0).expect("a shot");
    score(stage, light, &shot.visibility)
}

#[test]
fn counting_is_exact_on_generated_scenes() {
    let gpu = gpu();
    let mut faults = Vec::new();
    let (z_fail, eye_counter) = (ZFail::default(), EyeCounter::default());
    let (auto, zp_plus) = (Auto::default(), ZpPlus::default());
    for (index, (name, build, _)) in generate::ALL.iter().enumerate() {
        // Blades and strands of a few pixels' width: slow, and a picture of edges alone.
        if ["grass", "hair"].contains(name) {
            continue;
        }
        let scene = build();
        let stage = stage(&gpu, &scene, scene.camera_or_framing());
        let large = scene.triangle_count() > 10_000;
        for (turn, kind) in LIGHTS.into_iter().enumerate() {
            // Scenes of tens of thousands of triangles take seconds: one light for each of them.
            if large && turn != index % 3 {
                continue;
            }
            let light = scene.light_or_placed(kind);
            // The product of tiles and triangles is too much for the large ones.
            if !large {
                let exact = shoot(&gpu, &stage, &light, &Triangle::default());
                assert!(exact.counted > 1000, "{name}, {kind:?}: {exact:?}");
                if exact.wrong > 0 {
                    faults.push(format!("{name}, {kind:?}, containment: {exact:?}"));
                }
            }
            let others = ["rectangle", "fence", "street"].contains(name);
            let mut counted: Vec<&dyn TechniqueConfig> = vec![&z_fail];
            if others {
                counted.extend([&eye_counter as &dyn TechniqueConfig, &auto, &zp_plus]);
            }
            for (i, config) in counted.into_iter().enumerate() {
                let score = shoot(&gpu, &stage, &light, config);
                if score.unexplained > 0 || score.wrong * 1000 > score.counted {
                    faults.push(format!("{name}, {kind:?}, {i}: {score:?}"));
                }
            }
        }
    }
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

#[test]
fn few_samples_depend_on_snapping() {
    let gpu = gpu();
    let scene = generate::by_name("cube").expect("a scene");
    let stage = stage(&gpu, &scene, scene.camera_or_framing());
    let light = scene.light_or_placed(LightKind::Point);
    let all = stage.image.positions.len();
    let some = (0..all).step_by(16);
    let there = some.filter(|&i| stage.image.normals[i] != glam::Vec3::ZERO);
    let count = there.filter(|&i| depends_on_snapping(&stage, &light, i)).count();
    assert!(count * 16 * 200 < all, "{count} of {all} / 16 samples are excused from the start");
}

#[test]
fn a_light_a_hundredth_of_the_scene_aside_is_found_out() {
    let gpu = gpu();
    let scene = generate::by_name("cube").expect("a scene");
    let stage = stage(&gpu, &scene, scene.camera_or_framing());
    let light = scene.light_or_placed(LightKind::Point);
    let aside = light.translated(DVec3::X * 0.01 * scene.bounds().radius());
    let mut technique = ZFail::default().technique(&gpu).expect("a technique");
    let shot = stage.shoot(&gpu, &aside, &mut technique, 0).expect("a shot");
    let score = score(&stage, &light, &shot.visibility);
    assert!(score.unexplained > 10, "{score:?}");
}

#[test]
fn the_stencil_counts_as_the_wide_counter_does() {
    let gpu = gpu();
    for name in ["cube", "hall", "wires"] {
        let scene = generate::by_name(name).expect("a scene");
        let stage = stage(&gpu, &scene, scene.camera_or_framing());
        for kind in LIGHTS {
            let light = scene.light_or_placed(kind);
            let [wide, stencil] = [Counter::Wide, Counter::Stencil].map(|counter| {
                let mut technique = ZFail { counter }.technique(&gpu).expect("a technique");
                stage.shoot(&gpu, &light, &mut technique, 0).expect("a shot").visibility
            });
            assert!(wide == stencil, "{name}, {kind:?}");
            assert!(wide.contains(&0.0) && wide.contains(&1.0), "{name}, {kind:?}: no shadow");
        }
    }
}

/// A camera in a shadow: off the surface of a sample that is dark, towards the viewer, if that is still dark.
fn camera_in_shadow(stage: &Stage, light: &Light, like: Camera) -> Option<Camera> {
    let truth = stage.truth(light, &TIES);
    let dark = |i: &usize| truth.class[*i] == SampleClass::Counted && truth.visibility[*i] == 0.0;
    let origin = stage.triangles.origin;
    (0..truth.visibility.len()).filter(dark).step_by(37).find_map(|i| {
        let (p, n) = (stage.image.positions[i].as_dvec3(), stage.image.normals[i].as_dvec3());
        let eye = p + n * (5.0 * like.near);
        let way = light.towards(eye + origin, DVec2::splat(0.5));
        let end = light.position().map_or(f32::INFINITY, |_| 1.0);
        let hidden = stage.tracer().occluded(eye.as_vec3(), way.as_vec3(), end);
        let sideways = n.any_orthonormal_vector() - 0.4 * n;
        hidden.then(|| Camera { eye: eye + origin, target: eye + origin + sideways, ..like })
    })
}

#[test]
fn counting_is_exact_from_eyes_in_shadow_and_overhead() {
    let gpu = gpu();
    let mut in_shadow = 0;
    for name in ["rectangle", "sphere", "thin-wall", "fence", "hall", "street"] {
        let scene = generate::by_name(name).expect("a scene");
        let first = scene.camera_or_framing();
        let light = scene.light_or_placed(LightKind::Point);
        let inside = camera_in_shadow(&stage(&gpu, &scene, first), &light, first);
        in_shadow += usize::from(inside.is_some());
        let up = DVec3::Y * 0.8 * first.eye.distance(first.target);
        let above = Camera { eye: first.target + up + DVec3::new(0.13, 0.0, 0.07), ..first };
        for camera in inside.into_iter().chain([above]) {
            let stage = stage(&gpu, &scene, camera);
            for config in [&ZFail::default() as &dyn TechniqueConfig, &Auto::default()] {
                let score = shoot(&gpu, &stage, &light, config);
                assert_eq!(score.unexplained, 0, "{name}, {camera:?}: {score:?}");
                assert!(score.wrong * 1000 <= score.counted, "{name}, {camera:?}: {score:?}");
            }
        }
    }
    assert!(in_shadow >= 5, "{in_shadow} eyes in shadow");
}

#[test]
fn counting_stays_exact_while_camera_and_light_move() {
    let gpu = gpu();
    let scene = generate::by_name("thin-wall").expect("a scene");
    let first = scene.camera_or_framing();
    let sun = |turn: f64| Light::sun(0.7 + 0.3 * turn, 1.0 + 2.0 * turn, 0.0);
    let mut technique = ZFail::default().technique(&gpu).expect("a technique");
    let mut dark = 0;
    for frame in 0..20 {
        let turn = f64::from(frame) / 20.0;
        let (sin, cos) = (2.1 * turn).sin_cos();
        let arm = first.eye - first.target;
        let turned = DVec3::new(cos * arm.x - sin * arm.z, arm.y, sin * arm.x + cos * arm.z);
        let stage = stage(&gpu, &scene, Camera { eye: first.target + turned, ..first });
        let light = sun(turn);
        let shot = stage.shoot(&gpu, &light, &mut technique, 0).expect("a shot");
        let score = score(&stage, &light, &shot.visibility);
        dark += score.dark;
        assert_eq!(score.unexplained, 0, "frame {frame}: {score:?}");
        assert!(score.wrong <= 2, "frame {frame}: {score:?}");
    }
    // The wall is seen, or lit, edge-on in some of them.
    assert!(dark > 2000, "{dark} samples in shadow in all frames");
}

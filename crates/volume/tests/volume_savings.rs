//! What is saved of drawing volumes changes no bit, and saves what it says.

use antumbra_gpu::{Gpu, GpuOptions, TechniqueConfig};
use antumbra_measure::Stage;
use antumbra_scene::{Camera, Light, LightKind, generate};
use antumbra_volume::silhouette::{Counted, Meshes};
use antumbra_volume::{Auto, Counter, EyeCounter, Savings, Silhouette, ZFail, ZPass};
use glam::DVec3;

fn gpu() -> Gpu {
    Gpu::new(&GpuOptions::default()).unwrap_or_else(|e| panic!("{e}"))
}

const NONE: Savings =
    Savings { window: false, slices: 1, near: false, far: false, range: None, tally: true };

/// Each saving on its own, and all.
fn savings() -> [(&'static str, Savings); 5] {
    [
        ("window", Savings { window: true, ..NONE }),
        ("slices", Savings { window: true, slices: 16, ..NONE }),
        ("near", Savings { near: true, ..NONE }),
        ("far", Savings { far: true, ..NONE }),
        ("all", Savings { tally: true, ..Savings::ALL }),
    ]
}

/// The techniques that save, with the given savings.
fn configs(savings: Savings) -> Vec<(&'static str, Box<dyn TechniqueConfig>)> {
    let stencil = Counter::Stencil;
    let mixed = Silhouette { meshes: Meshes::Mixed, savings, ..Silhouette::default() };
    vec![
        ("z-fail", Box::new(ZFail { savings, ..ZFail::default() })),
        ("z-fail, stencil", Box::new(ZFail { counter: stencil, savings, ..ZFail::default() })),
        ("z-pass", Box::new(ZPass { near_caps: true, savings, ..ZPass::default() })),
        ("counter", Box::new(EyeCounter { savings, ..EyeCounter::default() })),
        ("auto", Box::new(Auto { savings, ..Auto::default() })),
        ("silhouette", Box::new(Silhouette { savings, ..Silhouette::default() })),
        ("silhouette, stencil", Box::new(Silhouette { counter: stencil, ..mixed })),
        ("silhouette, choose", Box::new(Silhouette { method: Counted::Choose, ..mixed })),
    ]
}

/// Visibility, and the fragments that it cost.
fn shoot(gpu: &Gpu, stage: &Stage, light: &Light, config: &dyn TechniqueConfig) -> (Vec<f32>, u64) {
    let mut technique = config.build(gpu).expect("a valid config");
    let shot = stage.shoot(gpu, light, technique.as_mut(), 0).expect("a shot");
    (shot.visibility, shot.counters["volume_fragments"])
}

#[test]
fn no_saving_changes_a_bit() {
    let gpu = gpu();
    let lights = [LightKind::Directional, LightKind::Spot, LightKind::Point];
    let mut dark = 0;
    for (index, (name, build, _)) in generate::ALL.iter().enumerate() {
        let scene = build();
        let large = scene.triangle_count() > 10_000;
        let stage = Stage::new(&gpu, &scene, scene.camera_or_framing(), 64, 48).expect("a stage");
        for (turn, kind) in lights.into_iter().enumerate() {
            if turn != index % 3 && (large || turn != (index + 1) % 3) {
                continue;
            }
            let light = scene.light_or_placed(kind);
            let plain = configs(NONE);
            let all = configs(Savings { tally: true, ..Savings::ALL });
            for ((technique, plain), (_, saved)) in plain.into_iter().zip(all) {
                if large && technique != "z-fail" && technique != "silhouette" {
                    continue;
                }
                let (plain, before) = shoot(&gpu, &stage, &light, plain.as_ref());
                let (saved, after) = shoot(&gpu, &stage, &light, saved.as_ref());
                let other = plain.iter().zip(&saved).filter(|(a, b)| a != b).count();
                dark += plain.iter().filter(|v| **v == 0.0).count();
                assert!(other == 0, "{name}, {kind:?}, {technique}: {other} samples differ");
                println!("{name}, {kind:?}, {technique}: {before} -> {after}");
            }
        }
    }
    assert!(dark > 10_000, "{dark} dark samples");
}

#[test]
fn each_saving_changes_nothing_and_saves() {
    let gpu = gpu();
    let street = generate::street();
    let poles = generate::poles(12, false);
    let hall = generate::hall();
    for (scene, kind) in [
        (&street, LightKind::Directional),
        (&poles, LightKind::Directional),
        (&hall, LightKind::Point),
    ] {
        let camera = scene.camera_or_framing();
        let up = DVec3::Y * 0.8 * camera.eye.distance(camera.target);
        let above = Camera { eye: camera.target + up + DVec3::new(0.13, 0.0, 0.07), ..camera };
        for (place, camera) in [("first", camera), ("above", above)] {
            let stage = Stage::new(&gpu, scene, camera, 128, 128).expect("a stage");
            let light = scene.light_or_placed(kind);
            for (i, (technique, plain)) in configs(NONE).into_iter().enumerate() {
                let (plain, before) = shoot(&gpu, &stage, &light, plain.as_ref());
                let mut line = format!("{} {place} {technique}: {before}", scene.name);
                for (saving, savings) in savings() {
                    let (_, saved) = &configs(savings)[i];
                    let (saved, after) = shoot(&gpu, &stage, &light, saved.as_ref());
                    assert!(plain == saved, "{}, {technique}, {saving}: other bits", scene.name);
                    line += &format!(" {saving} {:.2}", before as f64 / after.max(1) as f64);
                }
                println!("{line}");
            }
        }
    }
}

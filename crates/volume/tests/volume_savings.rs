//! What is saved of drawing volumes changes no bit, and saves what it says.

use antumbra_gpu::{Gpu, GpuOptions, Technique, TechniqueConfig};
use antumbra_measure::Stage;
use antumbra_scene::{Camera, Light, LightKind, generate};
use antumbra_volume::silhouette::{Counted, Meshes};
use antumbra_volume::{Auto, Counter, EyeCounter, Savings, Silhouette, ZFail, ZPass};
use glam::DVec3;

fn gpu() -> Gpu {
    Gpu::new(&GpuOptions::default()).unwrap_or_else(|e| panic!("{e}"))
}

const NONE: Savings = Savings { window: false, slices: 1, near: false, far: false, tally: true };
const ALL: Savings = Savings { tally: true, ..Savings::ALL };

/// The techniques that save, with the given savings; the first two are one volume a triangle, and silhouettes.
fn techniques(gpu: &Gpu, savings: Savings) -> Vec<Box<dyn Technique>> {
    let mixed = Silhouette { meshes: Meshes::Mixed, savings, ..Silhouette::default() };
    let configs: [&dyn TechniqueConfig; 7] = [
        &ZFail { savings, ..ZFail::default() },
        &Silhouette { savings, ..Silhouette::default() },
        &ZPass { near_caps: true, savings, ..ZPass::default() },
        &EyeCounter { savings, ..EyeCounter::default() },
        &Auto { savings, ..Auto::default() },
        &Silhouette { counter: Counter::Stencil, ..mixed },
        &Silhouette { method: Counted::Choose, ..mixed },
    ];
    configs.into_iter().map(|c| c.build(gpu).expect("a valid config")).collect()
}

/// Visibility, and the fragments that it cost.
fn shoot(
    gpu: &Gpu,
    stage: &Stage,
    light: &Light,
    technique: &mut Box<dyn Technique>,
) -> (Vec<f32>, u64) {
    let shot = stage.shoot(gpu, light, technique.as_mut(), 0).expect("a shot");
    (shot.visibility, shot.counters["volume_fragments"])
}

#[test]
fn no_saving_changes_a_bit() {
    let gpu = gpu();
    let lights = [LightKind::Directional, LightKind::Spot, LightKind::Point];
    let (mut plain, mut saving) = (techniques(&gpu, NONE), techniques(&gpu, ALL));
    let mut dark = 0;
    for (index, (name, build, _)) in generate::ALL.iter().enumerate() {
        let scene = build();
        let stage = Stage::new(&gpu, &scene, scene.camera_or_framing(), 48, 36).expect("a stage");
        let light = scene.light_or_placed(lights[index % 3]);
        // Of tens of thousands of triangles, silhouettes alone take no seconds.
        let which = match scene.triangle_count() {
            ..10_000 if ["thin-wall", "fence"].contains(name) => 0..plain.len(),
            ..10_000 => 0..2,
            _ => 1..2,
        };
        for i in which {
            let (visibility, _) = shoot(&gpu, &stage, &light, &mut plain[i]);
            let (saved, _) = shoot(&gpu, &stage, &light, &mut saving[i]);
            let other = visibility.iter().zip(&saved).filter(|(a, b)| a != b).count();
            dark += visibility.iter().filter(|v| **v == 0.0).count();
            assert!(other == 0, "{name}, {light:?}, technique {i}: {other} samples differ");
        }
    }
    assert!(dark > 3_000, "{dark} dark samples");
}

#[test]
fn each_saving_changes_nothing_and_saves() {
    let gpu = gpu();
    let scene = generate::street();
    let first = scene.camera_or_framing();
    let up = DVec3::Y * 0.8 * first.eye.distance(first.target);
    let above = Camera { eye: first.target + up + DVec3::new(0.13, 0.0, 0.07), ..first };
    let light = scene.light_or_placed(LightKind::Directional);
    let stages = [first, above].map(|c| Stage::new(&gpu, &scene, c, 128, 128).expect("a stage"));
    // How much of one volume a triangle is left to be drawn.
    let mut least = Vec::new();
    for savings in [
        NONE,
        Savings { window: true, ..NONE },
        Savings { window: true, slices: 16, ..NONE },
        Savings { near: true, ..NONE },
        Savings { far: true, ..NONE },
        ALL,
    ] {
        let mut all = techniques(&gpu, savings);
        least.push(
            stages.each_ref().map(|stage| [0, 1].map(|i| shoot(&gpu, stage, &light, &mut all[i]))),
        );
    }
    let plain = &least[0];
    for (saving, found) in least.iter().enumerate().skip(1) {
        for (view, pair) in found.iter().enumerate() {
            for (i, (visibility, _)) in pair.iter().enumerate() {
                let (same, _) = &plain[view][i];
                assert!(visibility == same, "saving {saving}, view {view}: other bits");
            }
            assert!(pair[0].1 < plain[view][0].1, "saving {saving}, view {view} saves nothing");
        }
    }
    let (before, after) = (plain[0][0].1, least[5][0][0].1);
    assert!(before > 3 * after, "all together: {before} fragments, then {after}");
}

/// Bands of a view of more than 512 pixels are wider than the blocks that are asked, here of 32 columns and 16 rows.
#[test]
fn bands_of_many_blocks_change_nothing() {
    let gpu = gpu();
    let scene = generate::by_name("cube").expect("a scene");
    let camera = scene.camera_or_framing();
    let stage = Stage::new(&gpu, &scene, camera, 640, 200).expect("a stage");
    let light = scene.light_or_placed(LightKind::Point);
    let [plain, saved] = [NONE, Savings { window: true, slices: 16, ..NONE }].map(|savings| {
        let mut technique = ZFail { savings, ..ZFail::default() }.build(&gpu).expect("valid");
        shoot(&gpu, &stage, &light, &mut technique)
    });
    assert!(plain.0 == saved.0 && plain.0.contains(&0.0), "other bits, or no shadow");
    // A window leaves out nothing but pixels: one ends in the view.
    assert!(saved.1 < plain.1, "{} fragments, then {}", plain.1, saved.1);
}

#[test]
fn slices_that_are_none_are_refused() {
    let savings = Savings { window: true, slices: 17, ..NONE };
    let error = ZFail { savings, ..ZFail::default() }.build(&gpu()).err().expect("17 slices");
    assert!(error.to_string().contains("1 to 16"), "{error}");
}

//! View-sample mapping: exact at any resolution of its grid, against ray-traced truth and volumes asked one by one.

use antumbra_gpu::{Gpu, TechniqueConfig as _};
use antumbra_measure::{Shot, Stage};
use antumbra_reference::{SampleClass, TruthOptions};
use antumbra_sampling::ViewSampleMapping;
use antumbra_scene::generate;
use antumbra_scene::{Light, LightKind, Scene};
use antumbra_tests::gpu;
use antumbra_volume::Triangle;

const LIGHTS: [LightKind; 3] = [LightKind::Directional, LightKind::Spot, LightKind::Point];
const TIES: TruthOptions = TruthOptions {
    light_samples: 1,
    ties: true,
    tie_distance: 1e-5,
    position_error: 1.0 / (1 << 21) as f64,
    seed: 0,
};

fn stage(gpu: &Gpu, scene: &Scene, side: u32) -> Stage {
    Stage::new(gpu, scene, scene.camera_or_framing(), side, side).expect("a stage")
}

fn shoot(gpu: &Gpu, stage: &Stage, light: &Light, buckets: u32) -> Shot {
    let mut technique = ViewSampleMapping { buckets }.build(gpu).expect("a valid config");
    stage.shoot(gpu, light, technique.as_mut(), 0).expect("a shot")
}

/// Samples that count, those of them that are dark, and those that are wrong.
fn score(stage: &Stage, light: &Light, visibility: &[f32]) -> (usize, usize, usize) {
    let truth = stage.truth(light, &TIES);
    let counted: Vec<usize> =
        (0..visibility.len()).filter(|&i| truth.class[i] == SampleClass::Counted).collect();
    let dark = counted.iter().filter(|&&i| truth.visibility[i] == 0.0).count();
    let wrong = counted.iter().filter(|&&i| truth.visibility[i] != visibility[i]).count();
    (counted.len(), dark, wrong)
}

#[test]
fn no_sample_is_wrong_on_any_generated_scene() {
    let gpu = gpu();
    let mut faults = Vec::new();
    for (name, build, _) in generate::ALL {
        let scene = build();
        let stage = stage(&gpu, &scene, 128);
        for kind in LIGHTS {
            let light = scene.light_or_placed(kind);
            let shot = shoot(&gpu, &stage, &light, 32);
            let (counted, dark, wrong) = score(&stage, &light, &shot.visibility);
            println!("{name} {kind:?}: {counted} counted, {dark} dark, {wrong} wrong, {:?}", shot.counters);
            if wrong > 0 {
                faults.push(format!("{name}, {kind:?}: {wrong} of {counted}"));
            }
        }
    }
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

#[test]
fn the_grid_changes_nothing() {
    let gpu = gpu();
    for name in ["cube", "fence", "tree", "hall", "sphere"] {
        let scene = generate::by_name(name).expect("a scene");
        let stage = stage(&gpu, &scene, 64);
        for kind in LIGHTS {
            let light = scene.light_or_placed(kind);
            let mut asked = Triangle::default().build(&gpu).expect("built");
            let asked = stage.shoot(&gpu, &light, asked.as_mut(), 0).expect("a shot").visibility;
            for buckets in [1, 2, 3, 32, 256, 1024] {
                let found = shoot(&gpu, &stage, &light, buckets).visibility;
                let off = found.iter().zip(&asked).filter(|(a, b)| a != b).count();
                assert_eq!(off, 0, "{name}, {kind:?}, {buckets} buckets a side");
            }
        }
    }
}

#[test]
fn debug_terrain() {
    use glam::DVec3;
    let gpu = gpu();
    let scene = generate::by_name("terrain").expect("a scene");
    let stage = stage(&gpu, &scene, 128);
    for kind in LIGHTS {
        let light = scene.light_or_placed(kind);
        let shot = shoot(&gpu, &stage, &light, 32);
        let mut asked = Triangle::default().build(&gpu).expect("built");
        let asked = stage.shoot(&gpu, &light, asked.as_mut(), 0).expect("a shot").visibility;
        let truth = stage.truth(&light, &TIES);
        let at = antumbra_volume::homogeneous_light(&stage.frame(&light)).as_dvec4();
        for i in 0..truth.visibility.len() {
            if truth.class[i] == SampleClass::Counted && truth.visibility[i] != shot.visibility[i] {
                let p = stage.image.positions[i].as_dvec3();
                println!("{kind:?} {i} p {p} n {} truth {} found {} oracle {}", stage.image.normals[i], truth.visibility[i], shot.visibility[i], asked[i]);
                for t in &stage.triangles.triangles {
                    let c = t.map(|v| stage.triangles.positions[v as usize].as_dvec3());
                    if let Some(v) = antumbra_volume::twin::Volume::new(at, c) {
                        let d = v.distances(p);
                        if d.iter().all(|d| *d < 1e-5) {
                            println!("  triangle {c:?} distances {d:?} n {}", (c[1]-c[0]).cross(c[2]-c[0]).normalize());
                        }
                    }
                }
            }
        }
        let _ = DVec3::ZERO;
    }
}

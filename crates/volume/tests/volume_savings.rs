//! What is saved of drawing volumes changes no bit, and saves what it says.

use antumbra_gpu::{Gpu, GpuOptions, Technique, TechniqueConfig};
use antumbra_measure::Stage;
use antumbra_reference::ViewSample;
use antumbra_scene::generate::{self, shapes};
use antumbra_scene::{Camera, Light, LightKind, Scene};
use antumbra_volume::silhouette::{Counted, Meshes};
use antumbra_volume::{Auto, Counter, EyeCounter, Savings, Silhouette, ZFail, ZPass};
use glam::{DAffine3, DVec3};

fn gpu() -> Gpu {
    Gpu::new(&GpuOptions::default()).unwrap_or_else(|e| panic!("{e}"))
}

/// Nothing saved, all saved, and a map of what the camera sees for finding out; each counts its fragments.
const NONE: Savings = Savings {
    window: false,
    slices: 1,
    near: false,
    far: false,
    litmap: 0,
    hidden: false,
    reach: None,
    tally: true,
};
const ALL: Savings = Savings { tally: true, ..Savings::ALL };

/// The first of the techniques that save, with the given savings: one volume a triangle, silhouettes, and others.
fn techniques(gpu: &Gpu, savings: Savings, count: usize) -> Vec<Box<dyn Technique>> {
    let mixed = Silhouette { meshes: Meshes::Mixed, savings, ..Silhouette::default() };
    let configs: [&dyn TechniqueConfig; EVERY] = [
        &ZFail { savings, ..ZFail::default() },
        &Silhouette { savings, ..Silhouette::default() },
        &ZPass { near_caps: true, savings, ..ZPass::default() },
        &EyeCounter { savings, ..EyeCounter::default() },
        &Auto { savings, ..Auto::default() },
        &Silhouette { counter: Counter::Stencil, ..mixed },
        &Silhouette { method: Counted::Choose, ..mixed },
    ];
    configs.into_iter().take(count).map(|c| c.build(gpu).expect("a valid config")).collect()
}

/// All of the techniques that save.
const EVERY: usize = 7;

/// Visibility, and the fragments that it cost.
fn shoot(
    gpu: &Gpu,
    stage: &Stage,
    light: &Light,
    technique: &mut Box<dyn Technique>,
) -> (Vec<f32>, u64) {
    let shot = stage.shoot(gpu, light, technique.as_mut(), 0).expect("a shot");
    let fragments = shot.counters.get("volume_fragments").copied().unwrap_or(0);
    (shot.visibility, fragments)
}

#[test]
fn no_saving_changes_a_bit() {
    let gpu = gpu();
    let lights = [LightKind::Directional, LightKind::Spot, LightKind::Point];
    // To count fragments takes more time than all else here.
    let [mut plain, mut saving] =
        [NONE, ALL].map(|savings| techniques(&gpu, Savings { tally: false, ..savings }, EVERY));
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
    let window = Savings { window: true, ..NONE };
    let litmap = Savings { litmap: 128, ..window };
    let hidden = Savings { hidden: true, ..litmap };
    for savings in [
        NONE,
        window,
        Savings { slices: 16, ..window },
        Savings { near: true, ..NONE },
        Savings { far: true, ..NONE },
        litmap,
        hidden,
        ALL,
    ] {
        let mut all = techniques(&gpu, savings, 2);
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
    let fragments = |saving: usize| least[saving][0].each_ref().map(|(_, count)| *count);
    let [before, window, litmap, hidden, all] = [0, 1, 5, 6, 7].map(fragments);
    assert!(before[0] > 5 * all[0], "all together: {before:?} fragments, then {all:?}");
    for i in [0, 1] {
        let what = ["triangles", "silhouettes"][i];
        assert!(litmap[i] < window[i], "{what}: a litmap leaves {litmap:?} of {window:?}");
        assert!(hidden[i] < litmap[i], "{what}: hidden casters leave {hidden:?} of {litmap:?}");
    }
}

/// Bands, here of 7 columns and 2 rows, do not begin where the blocks do that are asked, of 16 x 16 pixels.
#[test]
fn bands_that_cross_blocks_change_nothing() {
    let gpu = gpu();
    let scene = generate::by_name("cube").expect("a scene");
    let camera = scene.camera_or_framing();
    let stage = Stage::new(&gpu, &scene, camera, 208, 60).expect("a stage");
    let light = scene.light_or_placed(LightKind::Point);
    let [plain, saved] = [NONE, Savings { window: true, slices: 16, ..NONE }].map(|savings| {
        let mut technique = ZFail { savings, ..ZFail::default() }.build(&gpu).expect("valid");
        shoot(&gpu, &stage, &light, &mut technique)
    });
    assert!(plain.0 == saved.0 && plain.0.contains(&0.0), "other bits, or no shadow");
    // A window leaves out nothing but pixels: one ends in the view.
    assert!(saved.1 < plain.1, "{} fragments, then {}", plain.1, saved.1);
}

/// 900 poles stand behind a wall, as the light sees them: the wall and the floor alone have volumes.
#[test]
fn what_is_hidden_from_the_light_casts_nothing() {
    let gpu = gpu();
    let light = generate::poles(2, true).lights[0];
    let litmap = Savings { litmap: 128, ..Savings::WINDOW };
    let [mut open, mut hidden] =
        [litmap, Savings { hidden: true, ..litmap }].map(|savings| techniques(&gpu, savings, 2));
    for wall in [false, true] {
        let scene = generate::poles(30, wall);
        let camera = scene.camera_or_framing();
        let stage = Stage::new(&gpu, &scene, camera, 64, 64).expect("a stage");
        for i in [0, 1] {
            let [all, left] = [&mut open[i], &mut hidden[i]]
                .map(|t| stage.shoot(&gpu, &light, t.as_mut(), 0).expect("a shot"));
            assert!(all.visibility == left.visibility, "wall {wall}, technique {i}: other bits");
            if i == 0 {
                // Batches of 64 triangles, each of which has boxes of 16 x 16 pixels to ask.
                let (asked, batches) = (all.counters["asked_boxes"], all.counters["volumes"] / 64);
                assert!(asked > 0 && asked * 2 < batches * 16, "{asked} boxes, {batches} batches");
            }
            let [all, left] = [all, left].map(|shot| shot.counters["casting_volumes"]);
            // Of a floor and a wall there are 14 triangles, or two bodies.
            let (few, many) = ([14, 2][i], [1000, 100][i]);
            assert!(all > many, "wall {wall}, technique {i}: {all} volumes");
            assert_eq!(left <= few, wall, "wall {wall}, technique {i}: {left} of {all} volumes");
        }
    }
}

/// Whether a sample is nearer to the lamp than its reach, surely so or surely not.
fn is_within(light: &Light, sample: &ViewSample, origin: DVec3, reach: f64) -> Option<bool> {
    let way = light.position().expect("a lamp") - origin - sample.position.as_dvec3();
    let far = way.length() - reach;
    (far.abs() > 1e-5 * reach).then_some(far < 0.0)
}

#[test]
fn a_reach_changes_nothing_within_and_leaves_all_beyond_it_lit() {
    let gpu = gpu();
    let mut scene = Scene::default();
    scene.add(shapes::floor(6.0), DAffine3::IDENTITY);
    let (low, high) = (DVec3::new(-1.0, 0.5, -1.0), DVec3::new(0.0, 1.5, 0.0));
    scene.add(shapes::cuboid(low, high), DAffine3::IDENTITY);
    scene.add(shapes::icosphere(1, 0.5), DAffine3::from_translation(DVec3::new(1.2, 0.6, 0.4)));
    let (lamp, reach) = (DVec3::new(0.3, 3.0, 0.2), 4.0);
    let (direction, outer_angle) = (DVec3::new(0.1, -1.0, 0.2).normalize(), 1.4);
    // From where all that the lamp reaches is in view, and from below the cuboid, in its shadow.
    let (eye, target) = (DVec3::new(0.0, 5.0, 11.0), DVec3::ZERO);
    let first = Camera { eye, target, up: DVec3::Y, fov_y: 0.9, near: 0.05 };
    let (eye, target) = (DVec3::new(-0.5, 0.25, -0.5), DVec3::new(2.0, 0.0, 2.0));
    let low = Camera { eye, target, ..first };
    let with = |savings: Savings| Savings { reach: Some(reach), tally: true, ..savings };
    let [mut plain, mut cut, mut all] =
        [NONE, with(NONE), with(ALL)].map(|savings| techniques(&gpu, savings, 4));
    let (mut dark, mut beyond) = (0, 0);
    for (i, camera) in [first, low].into_iter().enumerate() {
        let stage = Stage::new(&gpu, &scene, camera, 64, 64).expect("a stage");
        let (spot, point) = (
            Light::Spot { position: lamp, direction, outer_angle },
            Light::Point { position: lamp },
        );
        let light = [spot, point][i];
        let samples = stage.view_samples();
        let origin = stage.triangles.origin;
        for t in 0..plain.len() {
            // Before an eye in shadow z-pass is wrong, and other counts are wrong otherwise.
            if (i, t) == (1, 2) {
                continue;
            }
            let (whole, before) = shoot(&gpu, &stage, &light, &mut plain[t]);
            for (name, technique) in [("alone", &mut cut[t]), ("with all", &mut all[t])] {
                let (near, after) = shoot(&gpu, &stage, &light, technique);
                for ((sample, whole), near) in samples.iter().zip(&whole).zip(&near) {
                    let p = sample.position.as_dvec3();
                    let towards = lamp - origin - p;
                    let facing = sample.normal.as_dvec3().dot(towards) > 1e-4 * towards.length();
                    let Some(within) = is_within(&light, sample, origin, reach) else { continue };
                    let expected = if within || !facing { *whole } else { 1.0 };
                    assert_eq!(*near, expected, "{name}, technique {t}, {camera:?}: at {p}");
                    dark += usize::from(within && *whole == 0.0);
                    beyond += usize::from(!within && *whole == 0.0 && facing);
                }
                // From within its reach, the picture as a whole may show its light.
                let most = if i == 0 { before - 1 } else { before };
                assert!(after <= most, "{name}, technique {t}: {after} of {before} fragments");
            }
        }
    }
    assert!(dark > 500 && beyond > 30, "{dark} in shadow, {beyond} freed of it");
}

#[test]
fn savings_that_are_none_are_refused() {
    let gpu = gpu();
    for (savings, fix) in [
        (Savings { window: true, slices: 17, ..NONE }, "1 to 16"),
        (Savings { litmap: 100, ..NONE }, "power of two"),
        (Savings { litmap: 2048, ..NONE }, "1024"),
        (Savings { hidden: true, ..NONE }, "litmap"),
        (Savings { reach: Some(0.0), ..NONE }, "above 0"),
        (Savings { reach: Some(f64::NAN), ..NONE }, "above 0"),
    ] {
        let error = ZFail { savings, ..ZFail::default() }.build(&gpu).err().expect("no savings");
        assert!(error.to_string().contains(fix), "{savings:?}: {error}");
    }
}

//! Shadow volumes against ray-traced truth, sample by sample: none may be wrong that is not within the truth's own
//! tolerance of a shadow's edge.

use antumbra_gpu::{Gpu, GpuOptions, Technique, TechniqueConfig};
use antumbra_measure::Stage;
use antumbra_reference::{SampleClass, Truth, TruthOptions};
use antumbra_scene::{Camera, Light, LightKind, LoadOptions, Scene, generate, load};
use antumbra_volume::{Auto, Counter, EyeCounter, Savings, Silhouette, Triangle, ZFail, ZpPlus};
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

/// What became of comparisons.
#[derive(Clone, Copy, Debug, Default)]
struct Score {
    /// Samples that face the light and are no ties.
    counted: usize,
    /// Those of them in shadow.
    dark: usize,
    /// Those of them that are wrong.
    wrong: usize,
    /// Samples that face the light and are ties.
    aside: usize,
}

impl Score {
    fn add(&mut self, truth: &Truth, visibility: &[f32]) {
        for ((v, t), class) in visibility.iter().zip(&truth.visibility).zip(&truth.class) {
            self.aside += usize::from(*class == SampleClass::Tie);
            if *class == SampleClass::Counted {
                self.counted += 1;
                self.dark += usize::from(*t == 0.0);
                self.wrong += usize::from(v != t);
            }
        }
    }
}

fn score(stage: &Stage, light: &Light, visibility: &[f32]) -> Score {
    let mut score = Score::default();
    score.add(&stage.truth(light, &TIES), visibility);
    score
}

fn stage(gpu: &Gpu, scene: &Scene, camera: Camera) -> Stage {
    Stage::new(gpu, scene, camera, VIEW, VIEW).expect("a stage")
}

fn build<const N: usize>(gpu: &Gpu, configs: [&dyn TechniqueConfig; N]) -> [Box<dyn Technique>; N] {
    configs.map(|config| config.build(gpu).expect("a valid config"))
}

fn shoot(gpu: &Gpu, stage: &Stage, light: &Light, technique: &mut dyn Technique) -> Vec<f32> {
    stage.shoot(gpu, light, technique, 0).expect("a shot").visibility
}

#[test]
fn counting_is_exact_on_generated_scenes() {
    let gpu = gpu();
    let mut faults = Vec::new();
    let names = ["z-fail", "counter", "triangle", "auto", "zp-plus"];
    let mut techniques = build(
        &gpu,
        [
            &ZFail::default(),
            &EyeCounter::default(),
            &Triangle::default(),
            &Auto::default(),
            &ZpPlus::default(),
        ],
    );
    for (index, (name, build, _)) in generate::ALL.iter().enumerate() {
        let scene = build();
        let large = scene.triangle_count() > 10_000;
        let camera = scene.camera_or_framing();
        let stage = Stage::new(&gpu, &scene, camera, 64, 64).expect("a stage");
        for (turn, kind) in LIGHTS.into_iter().enumerate() {
            // Scenes of tens of thousands of triangles take seconds: one light for each of them.
            if large && turn != index % 3 {
                continue;
            }
            let light = scene.light_or_placed(kind);
            // The product of tiles and triangles is too much for the large ones.
            let few = ["rectangle", "fence", "street"].contains(name);
            let count = if few { 5 } else { 3 - usize::from(large) };
            let truth = stage.truth(&light, &TIES);
            for (technique, built) in names.iter().zip(&mut techniques).take(count) {
                let mut score = Score::default();
                score.add(&truth, &shoot(&gpu, &stage, &light, built.as_mut()));
                assert!(score.counted > 200, "{name}, {kind:?}: {score:?}");
                if score.wrong > 0 {
                    faults.push(format!("{name}, {kind:?}, {technique}: {score:?}"));
                }
            }
        }
    }
    assert!(faults.is_empty(), "{}", faults.join("\n"));
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
    assert!(score.wrong > 10, "{score:?}");
}

#[test]
fn the_stencil_counts_as_the_wide_counter_does() {
    let gpu = gpu();
    let mut techniques = [Counter::Wide, Counter::Stencil]
        .map(|counter| ZFail { counter, ..ZFail::default() }.technique(&gpu).expect("a technique"));
    for name in ["cube", "hall", "wires"] {
        let scene = generate::by_name(name).expect("a scene");
        let stage = stage(&gpu, &scene, scene.camera_or_framing());
        for kind in LIGHTS {
            let light = scene.light_or_placed(kind);
            let [wide, stencil] =
                techniques.each_mut().map(|technique| shoot(&gpu, &stage, &light, technique));
            assert!(wide == stencil, "{name}, {kind:?}");
            assert!(wide.contains(&0.0) && wide.contains(&1.0), "{name}, {kind:?}: no shadow");
        }
    }
}

#[test]
fn volumes_of_nothing_in_view_are_left_away_and_change_nothing() {
    let gpu = gpu();
    // Windows leave away by themselves what culling would.
    let (counter, savings) = (Counter::default(), Savings::default());
    let mut z_fail = build(
        &gpu,
        [&ZFail { counter, culling: false, savings }, &ZFail { counter, culling: true, savings }],
    );
    let mut auto = build(
        &gpu,
        [&Auto { counter, culling: false, savings }, &Auto { counter, culling: true, savings }],
    );
    // Upstairs, nothing of the thousand cubes downstairs matters.
    for (scene, most) in [(generate::two_storeys(true), 0.05), (generate::poles(30, false), 1.0)] {
        let stage = stage(&gpu, &scene, scene.camera_or_framing());
        let light = scene.lights[0];
        for pair in [&mut z_fail, &mut auto] {
            let [all, left] = pair
                .each_mut()
                .map(|technique| stage.shoot(&gpu, &light, technique.as_mut(), 0).expect("a shot"));
            assert!(all.visibility == left.visibility, "{}: other bits", scene.name);
            let (casting, of) = (left.counters["casting_volumes"], all.counters["volumes"]);
            assert!(casting > 0 && casting <= of, "{}: {casting} of {of}", scene.name);
            let share = casting as f64 / of as f64;
            assert!(share <= most, "{}: {casting} of {of} volumes cast", scene.name);
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

/// Above what is looked at, a little aside.
fn camera_above(like: Camera) -> Camera {
    let up = DVec3::Y * 0.8 * like.eye.distance(like.target);
    Camera { eye: like.target + up + DVec3::new(0.13, 0.0, 0.07), ..like }
}

#[test]
fn counting_is_exact_from_eyes_in_shadow_and_overhead() {
    let gpu = gpu();
    let mut techniques = build(
        &gpu,
        [
            &ZFail::default(),
            &Auto::default(),
            &EyeCounter::default(),
            &ZpPlus::default(),
            &Silhouette::default(),
            &ZFail { savings: Savings::ALL, ..ZFail::default() },
            &EyeCounter { savings: Savings::ALL, ..EyeCounter::default() },
            &Silhouette { savings: Savings::ALL, ..Silhouette::default() },
        ],
    );
    let mut in_shadow = 0;
    for name in ["rectangle", "sphere", "thin-wall", "fence", "hall", "street"] {
        let scene = generate::by_name(name).expect("a scene");
        let first = scene.camera_or_framing();
        let light = scene.light_or_placed(LightKind::Point);
        let inside = camera_in_shadow(&stage(&gpu, &scene, first), &light, first);
        in_shadow += usize::from(inside.is_some());
        for camera in inside.into_iter().chain([camera_above(first)]) {
            let stage = stage(&gpu, &scene, camera);
            let truth = stage.truth(&light, &TIES);
            for technique in &mut techniques {
                let mut score = Score::default();
                score.add(&truth, &shoot(&gpu, &stage, &light, technique.as_mut()));
                assert_eq!(score.wrong, 0, "{name}, {camera:?}: {score:?}");
            }
        }
    }
    assert!(in_shadow >= 5, "{in_shadow} eyes in shadow");
}

/// Every hard light and three cameras, one of them in a shadow: what z-fail, ++ZP and edge counters score over them, and the
/// number of eyes in shadow that see samples that count.
fn scores(gpu: &Gpu, scene: &Scene) -> ([Score; 3], usize) {
    let first = scene.camera_or_framing();
    let mut techniques =
        build(gpu, [&ZFail::default(), &EyeCounter::default(), &Silhouette::default()]);
    let seen = stage(gpu, scene, first);
    let (mut scores, mut in_shadow) = ([Score::default(); 3], 0);
    for kind in LIGHTS {
        let light = scene.light_or_placed(kind);
        let inside = camera_in_shadow(&seen, &light, first);
        let around = [Some(first), Some(camera_above(first)), inside];
        for (i, camera) in around.into_iter().enumerate().filter_map(|(i, c)| Some((i, c?))) {
            let stage = stage(gpu, scene, camera);
            let truth = stage.truth(&light, &TIES);
            // An eye that sees nothing that could be wrong is none.
            in_shadow += usize::from(i == 2 && truth.class.contains(&SampleClass::Counted));
            for (sum, technique) in scores.iter_mut().zip(&mut techniques) {
                sum.add(&truth, &shoot(gpu, &stage, &light, technique.as_mut()));
            }
        }
    }
    (scores, in_shadow)
}

#[test]
fn meshes_that_bound_no_body_are_exact_from_everywhere() {
    let gpu = gpu();
    for scene in [generate::non_manifold(), generate::unorientable()] {
        let (scores, in_shadow) = scores(&gpu, &scene);
        assert_eq!(in_shadow, 3, "{}: eyes in shadow", scene.name);
        for score in scores {
            assert!(score.wrong == 0 && score.dark > 1000, "{}: {score:?}", scene.name);
        }
    }
}

/// The same of the files in the folder that the environment variable `ANTUMBRA_MODELS` names, each on a ground. Their scores
/// are left in `exactness.md` among cargo's temporary files of the target directory.
#[test]
#[ignore = "needs models"]
fn models_are_exact_from_everywhere() {
    let folder = std::env::var_os("ANTUMBRA_MODELS").expect("ANTUMBRA_MODELS names a folder");
    let mut files: Vec<_> = std::fs::read_dir(folder)
        .expect("a folder")
        .map(|entry| entry.expect("an entry").path())
        .filter(|path| path.extension().is_some_and(|e| ["obj", "glb"].iter().any(|k| *k == e)))
        .collect();
    files.sort_by_key(|path| path.metadata().map_or(0, |m| m.len()));
    let gpu = gpu();
    let mut table = String::from(
        "| model | triangles | eyes in shadow | technique | samples | in shadow | set aside | wrong |\n\
         |---|--:|--:|---|--:|--:|--:|--:|\n",
    );
    let mut wrong = 0;
    for path in files {
        let (mut scene, _) = load(&path, &LoadOptions::default()).expect("a scene");
        scene.add_ground();
        let (scores, eyes) = scores(&gpu, &scene);
        let (name, triangles) = (&scene.name, scene.triangle_count());
        for (technique, Score { counted, dark, aside, wrong: faults }) in
            ["z-fail", "counter", "silhouette"].into_iter().zip(scores)
        {
            table += &format!(
                "| {name} | {triangles} | {eyes} | `volume/{technique}` | {counted} | {dark} | {aside} | {faults} |\n"
            );
            wrong += faults;
        }
        std::fs::write(concat!(env!("CARGO_TARGET_TMPDIR"), "/exactness.md"), &table)
            .expect("written");
    }
    assert_eq!(wrong, 0, "{table}");
}

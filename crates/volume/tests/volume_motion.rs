//! Shadow volumes in motion, and before eyes at infinity: exact in every frame.

use antumbra_gpu::{Gpu, GpuOptions, Technique, TechniqueConfig, ViewCamera};
use antumbra_measure::{Shot, Stage};
use antumbra_reference::{SampleClass, TruthOptions};
use antumbra_scene::generate::shapes;
use antumbra_scene::{Camera, Light, Scene};
use antumbra_volume::{Auto, EyeCounter, Savings, Silhouette, ZFail, ZPass};
use glam::{DAffine3, DMat4, DVec2, DVec3, DVec4};

fn gpu() -> Gpu {
    Gpu::new(&GpuOptions::default()).unwrap_or_else(|e| panic!("{e}"))
}

/// A floor with a closed body on it, one above it, an open sheet that leans, and a ball.
fn scene() -> Scene {
    let mut scene = Scene::default();
    scene.add(shapes::floor(5.0), DAffine3::IDENTITY);
    scene.add(
        shapes::cuboid(DVec3::new(-1.6, 0.0, -0.9), DVec3::new(-0.8, 1.3, 0.2)),
        DAffine3::IDENTITY,
    );
    scene.add(shapes::quad(ROOF, 0.9 * DVec3::Z, 1.1 * DVec3::X), DAffine3::IDENTITY);
    scene.add(
        shapes::quad(DVec3::new(1.4, 0.7, 0.5), DVec3::new(0.3, 0.7, 0.1), DVec3::Z),
        DAffine3::IDENTITY,
    );
    scene.add(shapes::icosphere(1, 0.5), DAffine3::from_translation(DVec3::new(0.3, 0.5, -1.5)));
    scene
}

/// The middle of the sheet above the floor.
const ROOF: DVec3 = DVec3::new(0.1, 1.9, 0.2);

/// A light on its way around the scene, once each as a sun, a spot and a point.
fn light(turn: f64) -> Light {
    let (sin, cos) = (6.0 * turn).sin_cos();
    let position = DVec3::new(3.0 * cos, 4.2 + 0.7 * sin, 2.6 * sin);
    let direction = (ROOF - position).normalize();
    match (3.0 * turn) as u32 {
        0 => Light::Directional { direction, angular_diameter: 0.0 },
        1 => Light::Spot { position, direction, outer_angle: 0.9 },
        _ => Light::Point { position },
    }
}

/// Cameras on their ways: around the scene, above it, and in the shadow of the roof.
fn cameras(turn: f64, light: &Light) -> [Camera; 3] {
    let (sin, cos) = (4.0 * turn).sin_cos();
    let around = Camera {
        eye: DVec3::new(5.0 * cos, 2.0 + sin, 5.0 * sin),
        target: DVec3::new(0.0, 0.6, 0.0),
        up: DVec3::Y,
        fov_y: 0.9,
        near: 0.05,
    };
    let above = Camera { eye: DVec3::new(cos, 6.5 - turn, 0.7 * sin), ..around };
    let down = -light.towards(ROOF, DVec2::splat(0.5)).normalize();
    let eye = ROOF + down * (0.3 + 0.4 * turn);
    let inside = Camera { eye, target: eye + DVec3::new(sin, -0.6, cos), ..around };
    [around, above, inside]
}

/// Samples that count of a view, those of them in shadow, and for each technique those that are wrong.
fn score(
    gpu: &Gpu,
    stage: &Stage,
    light: &Light,
    techniques: &mut [(&str, Box<dyn Technique>)],
) -> (usize, usize, Vec<usize>) {
    let truth = stage.truth(light, &TruthOptions { ties: true, ..TruthOptions::default() });
    let counted = || (0..truth.class.len()).filter(|i| truth.class[*i] == SampleClass::Counted);
    let mut session = stage.session(gpu).expect("a session");
    let wrong = techniques
        .iter_mut()
        .map(|(_, technique)| {
            let mut shot = Shot::default();
            session.repeat(gpu, light, technique.as_mut(), &mut shot, false).expect("a shot");
            let found = session.visibility(gpu).expect("read back");
            counted().filter(|i| found[*i] != truth.visibility[*i]).count()
        })
        .collect();
    let dark = counted().filter(|i| truth.visibility[*i] == 0.0).count();
    (counted().count(), dark, wrong)
}

fn build<'a>(
    gpu: &Gpu,
    configs: &[(&'a str, &dyn TechniqueConfig)],
) -> Vec<(&'a str, Box<dyn Technique>)> {
    configs.iter().map(|(name, c)| (*name, c.build(gpu).expect("a valid config"))).collect()
}

/// Frames at `side` x `side`, by techniques that go on from one to the next; in turn from one of the cameras, or from `all`.
fn frames_are_exact(side: u32, frames: usize, all: bool) {
    let gpu = gpu();
    let scene = scene();
    let savings = Savings { litmap: 64, ..Savings::ALL };
    let configs: [(&str, &dyn TechniqueConfig); 5] = [
        ("z-fail", &ZFail::default()),
        ("z-fail, all saved", &ZFail { savings, ..ZFail::default() }),
        ("counter", &EyeCounter::default()),
        ("silhouette", &Silhouette::default()),
        ("silhouette, all saved", &Silhouette { savings, ..Silhouette::default() }),
    ];
    let mut techniques = build(&gpu, &configs);
    let first = cameras(0.0, &light(0.0))[0];
    let mut stage = Stage::new(&gpu, &scene, first, side, side).expect("a stage");
    let mut seen = [[0; 2]; 3];
    for frame in 0..frames {
        let turn = frame as f64 / frames as f64;
        let light = light(turn);
        let eyes = cameras(turn, &light);
        let from = (eyes[2].eye - stage.triangles.origin).as_vec3();
        let way = light.towards(eyes[2].eye, DVec2::splat(0.5)).as_vec3();
        let end = light.position().map_or(f32::INFINITY, |_| 1.0);
        assert!(stage.tracer().occluded(from, way, end), "frame {frame}: an eye in light");
        for (i, camera) in eyes.iter().enumerate().filter(|(i, _)| all || *i == frame % 3) {
            let view = stage.meshes.view_camera(camera, (side, side));
            stage.look(&gpu, &view).expect("a view");
            let (counted, dark, wrong) = score(&gpu, &stage, &light, &mut techniques);
            assert!(
                wrong.iter().all(|wrong| *wrong == 0),
                "frame {frame}, {camera:?}, {light:?}: {wrong:?} of {counted} wrong"
            );
            seen[i][0] += counted;
            seen[i][1] += dark;
        }
    }
    for [counted, dark] in seen {
        assert!(counted > dark && dark * 20 > counted, "{dark} of {counted} in shadow");
    }
}

#[test]
fn sixty_frames_of_moving_cameras_and_lights_are_exact() {
    frames_are_exact(32, 60, false);
}

#[test]
#[ignore = "minutes: more of the same at more samples, and each from all cameras"]
fn two_thousand_frames_are_exact() {
    frames_are_exact(128, 2000, true);
}

/// An orthographic camera that sees `half` metres around `target` from `back` of it, `reach` metres deep: depth 1 near, 0
/// far, or the other way round if `forward`.
fn orthographic(target: DVec3, back: DVec3, half: f64, reach: f64) -> ViewCamera {
    let z = back.normalize();
    let x = DVec3::Y.cross(z).normalize();
    let y = z.cross(x);
    let row = |axis: DVec3, scale: f64, offset: f64| {
        (axis * scale).extend(offset - scale * axis.dot(target))
    };
    let clip = DMat4::from_cols(
        row(x, 1.0 / half, 0.0),
        row(y, 1.0 / half, 0.0),
        row(z, 0.5 / reach, 0.5),
        DVec4::W,
    )
    .transpose();
    ViewCamera { clip, eye: target + z * reach }
}

#[test]
fn parallel_lines_of_sight_are_exact_too() {
    let gpu = gpu();
    let scene = scene();
    let savings = Savings { litmap: 64, ..Savings::ALL };
    let configs: [(&str, &dyn TechniqueConfig); 6] = [
        ("z-fail", &ZFail::default()),
        ("z-fail, clamped", &ZFail { savings, ..ZFail::default() }),
        ("auto", &Auto::default()),
        ("counter", &EyeCounter::default()),
        ("silhouette", &Silhouette::default()),
        ("silhouette, clamped", &Silhouette { savings, ..Silhouette::default() }),
    ];
    let mut techniques = build(&gpu, &configs);
    let mut z_pass = build(
        &gpu,
        &[("z-pass", &ZPass { near_caps: true, ..ZPass::default() } as &dyn TechniqueConfig)],
    );
    let target = DVec3::new(0.0, 0.6, 0.0);
    let first = orthographic(target, DVec3::new(1.0, 0.8, 0.6), 2.5, 12.0);
    let mut stage = Stage::seen_by(&gpu, &scene, &first, 40, 40).expect("a stage");
    let origin = stage.triangles.origin;
    let mut all = [0; 2];
    for step in 0..6 {
        let light = light(f64::from(step) / 6.0);
        let towards = light.towards(target, DVec2::splat(0.5)).normalize();
        // From aside, from above, over the floor, along the light, and nearly along it.
        let backs = [
            DVec3::new(1.0, 0.8, 0.6),
            DVec3::new(0.03, 1.0, 0.02),
            DVec3::new(-0.7, 0.05, 1.0),
            towards,
            towards + 0.02 * DVec3::X,
        ];
        for back in backs {
            stage.look(&gpu, &orthographic(target - origin, back, 2.5, 12.0)).expect("a view");
            let (counted, dark, wrong) = score(&gpu, &stage, &light, &mut techniques);
            assert!(
                wrong.iter().all(|wrong| *wrong == 0),
                "{light:?} from {back}: {wrong:?} of {counted} wrong"
            );
            all[0] += counted;
            all[1] += dark;
            // Volumes under parallel light hold no other end than that of the light's rays.
            if light.position().is_none() && back.angle_between(towards) > 0.3 {
                let (counted, _, wrong) = score(&gpu, &stage, &light, &mut z_pass);
                assert_eq!(wrong, [0], "z-pass, {light:?} from {back}: of {counted}");
            }
        }
    }
    assert!(all[1] * 20 > all[0], "{all:?} samples in shadow");
}

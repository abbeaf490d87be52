//! Only what matters is drawn and fitted to, and nothing that is seen changes by it.

use crate::shared::on_plane;

use std::collections::HashMap;

use antumbra_filter::{PcfCastano, PcfHardware};
use antumbra_gpu::{
    CasterBody, CasterTriangles, Casters, Counters, Drawn, Frame, Gpu, LightView, MeshSet,
    Recorder, Technique, read_f32_texture,
};
use antumbra_map::{Estimator, FittedView, MapConfig, MapTechnique};
use antumbra_measure::Stage;
use antumbra_reference::{Comparison, Metrics, SampleClass, Truth, TruthOptions};
use antumbra_scene::generate::shapes;
use antumbra_scene::{Camera, Light, LightKind, Scene, generate};
use antumbra_tests::gpu;
use glam::{DAffine3, DVec3, Vec3};
use on_plane::{texel, view_of};

const MAP: u32 = 1024;

fn plain(gpu: &Gpu, size: u32) -> MapTechnique {
    MapTechnique::plain(gpu, &MapConfig { size, ..MapConfig::default() }).expect("a valid config")
}

/// Techniques, and the sides of their kernels in texels.
fn techniques(gpu: &Gpu) -> Vec<(u32, MapTechnique)> {
    let map = MapConfig { size: MAP, ..MapConfig::default() };
    let castano = PcfCastano { map, side: 7, ..Default::default() };
    let estimators = [
        (1, Estimator::nearest()),
        (2, PcfHardware { map, ..Default::default() }.estimator()),
        (7, castano.estimator().expect("a valid side")),
    ];
    let technique = |estimator| MapTechnique::new(gpu, &map, estimator).expect("a valid config");
    estimators.map(|(side, estimator)| (side, technique(estimator))).into()
}

fn run(gpu: &Gpu, frame: &Frame<'_>, technique: &mut dyn Technique) -> (Vec<f32>, Counters) {
    let target = frame.samples.visibility_target(gpu).expect("a target");
    let view = target.create_view(&Default::default());
    technique.prepare(gpu, frame).expect("prepared");
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    technique.encode(gpu, frame, &mut Recorder::new(&mut encoder), &view).expect("encoded");
    gpu.queue.submit([encoder.finish()]);
    (read_f32_texture(gpu, &target, 0).expect("read back"), technique.counters())
}

/// Fits like `fitted`, but draws all that `all` has.
struct Unculled<'a> {
    fitted: &'a MeshSet,
    all: &'a MeshSet,
}

impl Casters for Unculled<'_> {
    fn hull(&self, light: &Light, visit: &mut dyn FnMut(DVec3)) {
        self.fitted.hull(light, visit);
    }

    fn bodies(&self, visit: &mut dyn FnMut(&CasterBody<'_>)) -> bool {
        self.fitted.bodies(visit)
    }

    fn draw(&self, view: &LightView<'_>, pass: &mut wgpu::RenderPass<'_>) -> Drawn {
        self.all.draw(view, pass)
    }

    fn triangles(&self) -> Option<CasterTriangles<'_>> {
        self.all.triangles()
    }
}

fn look(eye: [f64; 3], target: [f64; 3]) -> Camera {
    let fov_y = std::f64::consts::FRAC_PI_3;
    Camera { eye: eye.into(), target: target.into(), up: DVec3::Y, fov_y, near: 0.05 }
}

/// Street-level views of the street, whose houses stand at |x| >= 7 and |z| <= 200.
fn street_views() -> Vec<Camera> {
    vec![
        // Across the street, along the kerb, and from an alley's mouth back over the shoulder.
        look([2.0, 1.7, 20.0], [-7.0, 2.5, 14.0]),
        look([-4.0, 1.7, -60.0], [7.0, 2.0, -48.0]),
        look([5.0, 1.7, 100.0], [-7.0, 1.0, 104.0]),
    ]
}

fn street_lights() -> Vec<Light> {
    let lamp = DVec3::new(4.0, 6.5, 17.0);
    vec![
        generate::street().lights[0],
        Light::Spot { position: lamp, direction: DVec3::new(-0.5, -1.0, 0.0), outer_angle: 0.8 },
        Light::Point { position: lamp },
    ]
}

#[test]
fn culling_draws_a_third_of_the_street_and_changes_no_bit() {
    let gpu = gpu();
    let scene = generate::street();
    // All but the ground, which is no caster: drawn, it would darken the crease at its houses' feet.
    let mut houses = scene.clone();
    houses.instances.remove(0);
    let mut everything = MeshSet::new(&gpu, &houses).expect("a valid scene");
    everything.set_culling(false);
    assert_eq!(everything.origin(), scene.origin(), "the same origin");
    for camera in street_views() {
        let stage = Stage::new(&gpu, &scene, camera, 160, 120).expect("a stage");
        for light in street_lights() {
            let frame = stage.frame(&light);
            let unculled = Unculled { fitted: &stage.meshes, all: &everything };
            for (side, mut technique) in techniques(&gpu) {
                let (few, work) = run(&gpu, &frame, &mut technique);
                let all = Frame { casters: &unculled, ..frame };
                let (full, full_work) = run(&gpu, &all, &mut technique);
                let changed = few.iter().zip(&full).filter(|(a, b)| a != b).count();
                assert_eq!(
                    changed, 0,
                    "{light:?} from {}, {side} x {side}: culling is seen",
                    camera.eye
                );
                let (few, full) = (work["map_triangles"], full_work["map_triangles"]);
                assert!(
                    3 * few <= full,
                    "{light:?} from {}: {few} triangles of {full}",
                    camera.eye
                );
            }
        }
    }
}

/// The control of the test above: casters that are culled for one camera are missed by another.
#[test]
fn culling_for_another_camera_is_seen() {
    let gpu = gpu();
    let scene = generate::street();
    let [here, there, ..] = street_views()[..] else { panic!("two views") };
    let mut stage = Stage::new(&gpu, &scene, here, 160, 120).expect("a stage");
    let light = scene.lights[0];
    let right = run(&gpu, &stage.frame(&light), &mut plain(&gpu, MAP)).0;
    stage.set_camera(Some(stage.meshes.view_camera(&there, (160, 120))));
    let wrong = run(&gpu, &stage.frame(&light), &mut plain(&gpu, MAP)).0;
    assert!(right != wrong, "shadows do not depend on what is drawn");
}

fn metrics(stage: &Stage, truth: &Truth, visibility: &[f32]) -> Metrics {
    let comparison = Comparison {
        estimate: visibility,
        reference: &truth.visibility,
        classes: &truth.class,
        width: stage.image.width as usize,
    };
    comparison.metrics().expect("comparable")
}

/// Samples within a shadow of more than `clearance` pixels to all sides that are lit all the same.
fn lost(stage: &Stage, truth: &Truth, visibility: &[f32], clearance: i64) -> usize {
    let (width, height) = (i64::from(stage.image.width), i64::from(stage.image.height));
    let dark = |x: i64, y: i64| {
        let i = (y * width + x) as usize;
        (0..width).contains(&x)
            && (0..height).contains(&y)
            && truth.class[i] == SampleClass::Counted
            && truth.visibility[i] == 0.0
    };
    let deep = |x: i64, y: i64| {
        let around = -clearance..=clearance;
        around.clone().all(|dy| around.clone().all(|dx| dark(x + dx, y + dy)))
    };
    let lit = |x: i64, y: i64| visibility[(y * width + x) as usize] > 0.5;
    (0..width)
        .flat_map(|x| (0..height).map(move |y| (x, y)))
        .filter(|&(x, y)| deep(x, y) && lit(x, y))
        .count()
}

#[test]
fn a_window_fitted_to_what_is_seen_loses_no_shadow_and_is_no_coarser() {
    let gpu = gpu();
    let mut caught = 0;
    for name in ["street", "hall", "cube", "sphere", "terrain"] {
        let scene = generate::by_name(name).expect("a generated scene");
        let camera = scene.camera_or_framing();
        let mut stage = Stage::new(&gpu, &scene, camera, 128, 128).expect("a stage");
        let seen = stage.frame(&scene.place_light(LightKind::Point)).camera;
        for kind in LightKind::ALL {
            let light = scene.place_light(kind);
            // Against the light's middle, which is what the map knows.
            let hard = match light {
                Light::Directional { direction, .. } => {
                    Light::Directional { direction, angular_diameter: 0.0 }
                }
                Light::Spot { .. } => light,
                _ => Light::Point { position: light.position().expect("a place") },
            };
            let truth = stage.truth(&hard, &TruthOptions::default());
            let mut technique = plain(&gpu, 512);
            let mut shoot = |camera| {
                stage.set_camera(camera);
                let seen = run(&gpu, &stage.frame(&light), &mut technique).0;
                (seen, clump(&stage, technique.map().views(), 512))
            };
            let ((wide, _), (tight, clump)) = (shoot(None), shoot(seen));
            let lost = (lost(&stage, &truth, &wide, 2), lost(&stage, &truth, &tight, 2));
            assert!(lost.1 <= lost.0, "{name}, {light:?}: {lost:?} samples lost, wide and tight");
            // Of the same resolution or a better one; where the texels' centres fall is chance. Samples in one texel are
            // wrong together: a count of `clump` times so many texels, whose variance is `clump` times the count.
            let off = |v: &[f32]| {
                let metrics = metrics(&stage, &truth, v);
                metrics.mean_abs * metrics.view_samples as f64
            };
            let chance = |a: f64, b: f64| 4.0 * (clump * (a + b)).sqrt();
            let [wide, tight] = [wide, tight].map(|v| off(&v));
            let most = wide + chance(wide, tight);
            assert!(tight <= most, "{name}, {light:?}: {tight}, wide {wide}, to {most}");
            // The control: texels of four times the side.
            let coarse = off(&run(&gpu, &stage.frame(&light), &mut plain(&gpu, 128)).0);
            caught += usize::from(coarse > wide + chance(wide, coarse));
        }
    }
    assert!(caught > 0, "coarse windows pass");
}

/// Samples that share a texel, in the mean over the samples.
fn clump(stage: &Stage, views: &[FittedView], size: u32) -> f64 {
    let mut texels: HashMap<[i64; 3], usize> = HashMap::new();
    for sample in stage.view_samples().iter().filter(|sample| sample.normal != Vec3::ZERO) {
        let p = sample.position.as_dvec3();
        let view = view_of(views, p);
        if let Some((clip, light)) = view.and_then(|view| Some((view.clip?, view.light))) {
            let t = texel(&clip, p, size).floor();
            // Faces of a cube by the axis along which they look.
            let axis = (p - light.truncate()).abs().max_position() as i64;
            *texels.entry([axis, t.x as i64, t.y as i64]).or_default() += 1;
        }
    }
    let all: usize = texels.values().sum();
    let squares: usize = texels.values().map(|n| n * n).sum();
    squares as f64 / all.max(1) as f64
}

/// HC-40, through a camera: it looks at an empty floor, the sun behind it, past cubes it does not see.
#[test]
fn casters_behind_the_camera_and_high_above_shadow_the_floor_in_view() {
    let gpu = gpu();
    let to_light = DVec3::new(0.0, 1.0, 1.0);
    let mut scene = Scene::default();
    scene.add(shapes::quad(DVec3::ZERO, 30.0 * DVec3::Z, 30.0 * DVec3::X), DAffine3::IDENTITY);
    for (x, height) in [(-3.0, 10.0), (3.0, 30.0)] {
        let center = DVec3::new(x, 0.0, -6.0) + to_light * height;
        scene.add(shapes::cuboid(center - DVec3::ONE, center + DVec3::ONE), DAffine3::IDENTITY);
    }
    // And one that matters to nobody.
    let aside = DVec3::new(-20.0, 3.0, 10.0);
    scene.add(shapes::cuboid(aside - DVec3::ONE, aside + DVec3::ONE), DAffine3::IDENTITY);
    let camera = look([0.0, 1.7, 0.0], [0.0, 0.0, -6.0]);
    let stage = Stage::new(&gpu, &scene, camera, 128, 128).expect("a stage");
    let light = Light::sun(45_f64.to_radians(), 0.0, 0.0);
    let truth = stage.truth(&light, &TruthOptions::default());
    let (visibility, work) = run(&gpu, &stage.frame(&light), &mut plain(&gpu, MAP));
    let dark = truth.visibility.iter().filter(|v| **v == 0.0).count();
    assert!(dark > 500, "{dark} samples in shadow");
    let metrics = metrics(&stage, &truth, &visibility);
    assert!(metrics.mean_abs < 0.01, "error {}", metrics.mean_abs);
    assert_eq!(work["map_triangles"], 24, "two cubes matter");
}

#[test]
fn a_light_that_reaches_nothing_visible_draws_and_allocates_nothing() {
    let gpu = gpu();
    let scene = generate::street();
    let stage = Stage::new(&gpu, &scene, street_views()[0], 64, 48).expect("a stage");
    let far = DVec3::new(0.0, 5.0, -150.0);
    let unseen = [
        // A cone on a part of the street that is out of sight, and one into the sky.
        Light::Spot { position: far, direction: DVec3::NEG_Y, outer_angle: 0.5 },
        Light::Spot {
            position: DVec3::new(0.0, 40.0, 17.0),
            direction: DVec3::Y,
            outer_angle: 0.5,
        },
    ];
    for light in unseen {
        let mut technique = plain(&gpu, MAP);
        let (_, work) = run(&gpu, &stage.frame(&light), &mut technique);
        assert_eq!(work["map_lights_skipped"], 1, "{light:?} is skipped");
        assert_eq!((work["map_passes"], work["map_draws"]), (0, 0), "{light:?} draws");
        assert!(technique.bytes() <= 6 * 256, "{light:?}: {} bytes", technique.bytes());
    }
    let (_, work) = run(&gpu, &stage.frame(&scene.lights[0]), &mut plain(&gpu, MAP));
    assert_eq!(work["map_lights_skipped"], 0, "the sun is not");
}

/// HC-37: 64 lights on a grid of 4 m in a corridor with the camera inside. Those that are skipped shadow nothing
/// that is seen, and those that do shadow something do it as well as without culling.
#[test]
fn of_the_lights_of_a_corridor_only_those_without_visible_shadows_are_skipped() {
    let gpu = gpu();
    let mut scene = Scene::default();
    scene.add(shapes::quad(DVec3::ZERO, 130.0 * DVec3::Z, 3.0 * DVec3::X), DAffine3::IDENTITY);
    for number in 0..64 {
        let center =
            DVec3::new(if number % 2 == 0 { 1.0 } else { -1.0 }, 0.5, -4.0 * f64::from(number));
        let half = DVec3::new(0.3, 0.5, 0.3);
        scene.add(shapes::cuboid(center - half, center + half), DAffine3::IDENTITY);
    }
    let camera = look([0.0, 1.7, -100.0], [0.5, 0.0, -104.0]);
    let stage = Stage::new(&gpu, &scene, camera, 96, 96).expect("a stage");
    let mut technique = plain(&gpu, 256);
    let (mut skipped, mut shadowing) = (0, 0);
    for number in 0..64 {
        // A lamp under the ceiling whose cone is 5 m wide on the floor.
        let position = DVec3::new(0.0, 2.8, -4.0 * f64::from(number) - 2.0);
        let light = Light::Spot { position, direction: DVec3::NEG_Y, outer_angle: 1.06 };
        let truth = stage.truth(&light, &TruthOptions::default());
        let counted = |i: &usize| truth.class[*i] == SampleClass::Counted;
        let dark = (0..truth.class.len()).filter(counted).filter(|i| truth.visibility[*i] == 0.0);
        let dark = dark.count();
        let (visibility, work) = run(&gpu, &stage.frame(&light), &mut technique);
        if work["map_lights_skipped"] == 1 {
            skipped += 1;
            assert_eq!(dark, 0, "light {number} is skipped and shadows {dark} samples");
        } else if dark > 0 {
            shadowing += 1;
            let metrics = metrics(&stage, &truth, &visibility);
            assert!(metrics.mean_abs < 0.05, "light {number}: error {}", metrics.mean_abs);
        }
    }
    assert!(skipped >= 24, "only {skipped} of 64 lights are skipped");
    assert!(shadowing >= 2, "only {shadowing} lights shadow something visible");
}

/// HC-14 of HC-17: the cube's shadow on a wall, from a lamp behind the camera, 141 km out.
#[test]
fn a_shadow_far_off_is_the_same_far_from_the_origin() {
    let gpu = gpu();
    let offset = DVec3::new(1e5, 0.0, 1e5);
    let mut scene = Scene::default();
    scene.add(shapes::floor(60.0), DAffine3::IDENTITY);
    let cube = shapes::cuboid(DVec3::new(-1.0, 0.0, -46.0), DVec3::new(1.0, 2.0, -44.0));
    scene.add(cube, DAffine3::IDENTITY);
    let wall = shapes::quad(DVec3::new(0.0, 4.0, -49.0), 4.0 * DVec3::X, 4.0 * DVec3::Y);
    scene.add(wall, DAffine3::IDENTITY);
    let fov_y = 15_f64.to_radians();
    scene.camera = Some(Camera { fov_y, ..look([3.0, 2.0, 0.0], [0.0, 2.0, -49.0]) });
    let light = Light::Point { position: DVec3::new(0.0, 5.0, 3.0) };
    let seen = |scene: &Scene, light: &Light, technique: &mut MapTechnique| {
        let camera = scene.camera_or_framing();
        let stage = Stage::new(&gpu, scene, camera, 128, 128).expect("a stage");
        run(&gpu, &stage.frame(light), technique).0
    };
    let (there, moved) = (scene.translated(offset), light.translated(offset));
    for (side, mut technique) in techniques(&gpu) {
        let home = seen(&scene, &light, &mut technique);
        assert!(home.contains(&0.0), "a shadow is seen");
        // The origin of so large a scene moves in steps of 128 m, of which 1e5 m is no multiple. So all roundings are
        // others, and a sample within as much of a shadow's edge may change sides: of 16384, 4 may.
        let away = seen(&there, &moved, &mut technique);
        let differing = |other: &[f32]| {
            home.iter().zip(other).filter(|(a, b)| (*a - *b).abs() > 1.0 / 256.0).count()
        };
        let differ = differing(&away);
        assert!(differ <= 4, "{side} x {side}: {differ} samples differ");
        // The control: a lamp that is off by a metre, and its shadow by a decimetre.
        let astray = moved.translated(DVec3::X);
        let differ = differing(&seen(&there, &astray, &mut technique));
        assert!(differ > 8, "{side} x {side}: goes unnoticed but for {differ} samples");
    }
}

#[test]
fn a_light_at_the_eye_or_of_no_size_is_served() {
    let gpu = gpu();
    let scene = generate::street();
    let camera = street_views()[0];
    let stage = Stage::new(&gpu, &scene, camera, 64, 48).expect("a stage");
    // Whatever the eye sees is lit by a light there, but for what is edge-on and within a texel of an edge.
    let light = Light::Point { position: camera.eye };
    let truth = stage.truth(&light, &TruthOptions::default());
    let (visibility, _) = run(&gpu, &stage.frame(&light), &mut plain(&gpu, MAP));
    let metrics = metrics(&stage, &truth, &visibility);
    assert!(metrics.mean_abs < 0.01, "a light at the eye: error {}", metrics.mean_abs);

    let center = DVec3::new(1.0, 3.0, 12.0);
    let point = run(&gpu, &stage.frame(&Light::Point { position: center }), &mut plain(&gpu, 256));
    let sphere = Light::Sphere { center, radius: 0.0 };
    let sphere = run(&gpu, &stage.frame(&sphere), &mut plain(&gpu, 256));
    assert_eq!(point, sphere, "a sphere without size is a point");
}

#[test]
fn the_smallest_and_the_largest_map_serve_what_is_seen() {
    let gpu = gpu();
    let scene = generate::cube_on_floor();
    let camera = scene.camera_or_framing();
    let stage = Stage::new(&gpu, &scene, camera, 64, 64).expect("a stage");
    let light = scene.lights[0];
    let truth = stage.truth(&light, &TruthOptions::default());
    // WebGPU guarantees 8192; a device that has more is not asked for gigabytes.
    for (size, bound) in [(1, 1.0), (8192, 2e-3)] {
        let (visibility, work) = run(&gpu, &stage.frame(&light), &mut plain(&gpu, size));
        assert_eq!(work["map_texels"], u64::from(size).pow(2), "the map's size");
        let error = metrics(&stage, &truth, &visibility).mean_abs;
        assert!(error <= bound, "size {size}: error {error}");
    }
}

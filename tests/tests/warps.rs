//! Warped maps: error curves that theory gives, never worse than no warp, and any technique under any light.

use antumbra::{Config, catalogue};
use antumbra_gpu::{Gpu, Technique, TechniqueConfig};
use antumbra_map::{MapConfig, MapTechnique, Plain};
use antumbra_measure::Stage;
use antumbra_reference::sampling::{Parametrisation, ViewFrustum};
use antumbra_reference::{SampleClass, TruthOptions};
use antumbra_sampling::{Lispsm, Psm, Tsm};
use antumbra_scene::generate::shapes;
use antumbra_scene::{Camera, Light, LightKind, Scene};
use antumbra_tests::gpu;
use glam::{DAffine3, DVec2, DVec3};

const MAP: u32 = 512;
const SIDE: u32 = 128;

/// The warps with their defaults, by name.
fn configs(map: MapConfig) -> Vec<(&'static str, Box<dyn TechniqueConfig>)> {
    let of = Plain { map };
    vec![
        ("lispsm", Box::new(Lispsm { of, ..Default::default() })),
        ("search", Box::new(Lispsm { of, search: true, ..Default::default() })),
        ("tsm", Box::new(Tsm { of, ..Default::default() })),
        ("psm", Box::new(Psm { of, ..Default::default() })),
    ]
}

fn map() -> MapConfig {
    MapConfig { size: MAP, ..MapConfig::default() }
}

/// As what it is: over the plain test, of which the views can be asked.
fn lispsm(gpu: &Gpu, config: &Lispsm<()>, size: u32) -> MapTechnique {
    MapTechnique::plain(gpu, &MapConfig { size, ..map() })
        .expect("a valid config")
        .rearranged(|others| config.arrange(others))
        .expect("valid settings")
}

fn psm(gpu: &Gpu, guard: bool) -> MapTechnique {
    MapTechnique::plain(gpu, &map())
        .expect("a valid config")
        .rearranged(|others| Ok(Psm { of: (), guard }.arrange(others)))
        .expect("valid settings")
}

/// Looks along -z over a ground that is seen from 1.7 m before it on, with walls and posts as casters.
fn ahead() -> Camera {
    let eye = DVec3::new(0.0, 1.7, 0.0);
    Camera { eye, target: eye - DVec3::Z, up: DVec3::Y, fov_y: 2.0 * 0.5_f64.atan(), near: 1.0 }
}

fn walls_and_posts() -> Scene {
    let mut scene = Scene::default();
    scene.add(shapes::floor(100.0), DAffine3::IDENTITY);
    let mut add = |min: DVec3, max: DVec3| {
        scene.add(shapes::cuboid(min, max), DAffine3::IDENTITY);
    };
    for (x, z, w, h) in
        [(-8.0, -10.0, 10.0, 6.0), (10.0, -40.0, 20.0, 12.0), (0.0, -95.0, 60.0, 30.0)]
    {
        add(DVec3::new(x - 0.5 * w, 0.0, z - 0.1), DVec3::new(x + 0.5 * w, h, z));
    }
    for k in 1..46 {
        let z = -2.0 * f64::from(k);
        add(DVec3::new(-0.05, 0.0, z - 0.05), DVec3::new(0.05, 2.0, z + 0.05));
    }
    scene
}

fn sun(tilt: f64) -> Light {
    // From behind the viewer at 0, from overhead at a right angle.
    let tilt = tilt.to_radians();
    let direction = DVec3::new(0.0, -tilt.sin(), -tilt.cos());
    Light::Directional { direction, angular_diameter: 0.0 }
}

fn shoot(gpu: &Gpu, stage: &Stage, light: &Light, technique: &mut dyn Technique) -> Vec<f32> {
    stage.shoot(gpu, light, technique, 0).expect("a shot").visibility
}

/// Mean error of the visible floor beside the truth.
fn error(stage: &Stage, light: &Light, found: &[f32]) -> f64 {
    let truth = stage.truth(light, &TruthOptions::default());
    let judged = (0..found.len()).filter(|i| truth.class[*i] == SampleClass::Counted);
    let (sum, count) = judged.fold((0.0, 0.0), |(sum, count), i| {
        (sum + f64::from((found[i] - truth.visibility[i]).abs()), count + 1.0)
    });
    sum / count
}

/// The error of a texel at the ground under light from overhead is that of the theory, along the whole view.
///
/// Casters cover all that is seen, so that the map is fitted to a view from where the ground comes into it to the far
/// wall: to depths of 3.4 m to 60 m.
#[test]
fn error_curves_are_those_of_theory() {
    let gpu = gpu();
    let mut scene = Scene::default();
    scene.add(shapes::floor(58.3), DAffine3::IDENTITY);
    // A lid over everything, which the camera sees through from below; it casts on the whole ground.
    scene.add(
        shapes::cuboid(DVec3::new(-58.3, 90.0, -58.3), DVec3::new(58.3, 90.1, 58.3)),
        DAffine3::IDENTITY,
    );
    let stage = Stage::new(&gpu, &scene, ahead(), SIDE, SIDE).expect("a stage");
    let camera = stage.camera().expect("a camera").clip;
    let light = sun(90.0);
    for (strong, mut technique) in [
        (false, lispsm(&gpu, &Lispsm { guard: false, ..Default::default() }, MAP)),
        (true, psm(&gpu, false)),
    ] {
        shoot(&gpu, &stage, &light, &mut technique);
        let map = technique.map();
        let clip = map.views()[0].clip.expect("a lid casts");
        let sampling =
            stage.sampling(&gpu, map.arrange().layout(&light), map.views(), MAP).expect("measured");
        // Depths over which t goes from one border to the other, and the strength between them, from the matrix.
        let w = |z: f64| (clip * DVec3::new(0.0, 0.0, -z).extend(1.0)).w;
        let place = |z: f64| {
            let c = clip * DVec3::new(0.0, 0.0, -z).extend(1.0);
            0.5 + 0.5 * c.y / c.w
        };
        let end = |t: f64| {
            let (mut lo, mut hi) = (1e-3, 1e3);
            for _ in 0..200 {
                let middle = 0.5 * (lo + hi);
                if place(middle) < t { lo = middle } else { hi = middle }
            }
            lo
        };
        let (near, far) = (end(0.0), end(1.0));
        let strength = w(far) / w(near) - 1.0;
        // The rules are given the nearest and the farthest receiver: those of a view from there to there.
        let expected = if strong { far / near - 1.0 } else { (far / near).sqrt() - 1.0 };
        assert!(
            (strength / expected - 1.0).abs() < 0.05,
            "strength {strength}, not {expected} ({near} to {far})"
        );
        let view = ViewFrustum { tan_half: 0.5, aspect: 1.0, near, far };
        let warp = Parametrisation::Perspective { near: (far - near) / strength };
        let mut compared = 0;
        for (sample, sides) in stage.view_samples().iter().zip(&sampling.sides) {
            let p = sample.position.as_dvec3();
            if sides.max_element() == 0.0 || p.y.abs() > 1e-3 || p.x.abs() > 0.005 * -p.z {
                continue;
            }
            let z = (camera * p.extend(1.0)).w;
            let pixels = f64::from(SIDE) / f64::from(MAP);
            let perspective = view.perspective_error(warp, z, 1.0) * pixels;
            // On a ground that is seen from 1.7 m above.
            let expected = DVec2::new(perspective.x, perspective.y * 1.7 / z);
            // s goes across: the map is no wider than what is seen of the ground, whose sides lean inwards, or as the
            // theory has it. Its guard band is 1 of 512.
            let off = (sides.as_dvec2() / expected - 1.0).abs();
            assert!(off.max_element() < 0.02, "{sides} at {z} m, not {expected}");
            compared += 1;
        }
        assert!(compared > 100, "{compared} samples");
    }
}

#[test]
fn a_warp_is_never_worse_than_none_whatever_the_lights_tilt() {
    let gpu = gpu();
    let stage = Stage::new(&gpu, &walls_and_posts(), ahead(), SIDE, SIDE).expect("a stage");
    let plain: &dyn TechniqueConfig = &Plain { map: map() };
    let mut gained = 0.0;
    let tilts = [90.0, 75.0, 60.0, 45.0, 30.0, 20.0, 10.0, 5.0, 2.0, 0.5, 0.01, 0.0];
    for tilt in tilts.iter().flat_map(|t| [*t, 180.0 - t]) {
        let light = sun(tilt);
        let uniform = shoot(&gpu, &stage, &light, plain.build(&gpu).expect("valid").as_mut());
        for (name, config) in configs(map()) {
            let found = shoot(&gpu, &stage, &light, config.build(&gpu).expect("valid").as_mut());
            assert!(
                found.iter().all(|v| (0.0..=1.0).contains(v)),
                "{name} at {tilt}: no visibility"
            );
            if f64::to_radians(tilt).sin() < 0.0175 {
                assert_eq!(found, uniform, "{name} at {tilt} degrees: not the map without a warp");
                continue;
            }
            let (with, without) = (error(&stage, &light, &found), error(&stage, &light, &uniform));
            // What is guarded is the largest error; the mean may be a little more.
            assert!(
                with <= 1.25 * without + 1e-3,
                "{name} at {tilt}: {with} warped, {without} not"
            );
            if tilt == 60.0 && name == "lispsm" {
                gained = without / with;
            }
        }
    }
    assert!(gained > 1.5, "{gained} times better");
}

#[test]
fn every_kind_of_light_is_served_and_none_worse() {
    let gpu = gpu();
    let scene = walls_and_posts();
    let stage = Stage::new(&gpu, &scene, ahead(), SIDE, SIDE).expect("a stage");
    let plain: &dyn TechniqueConfig = &Plain { map: map() };
    let spot = |position: DVec3, direction: DVec3| Light::Spot {
        position,
        direction: direction.normalize(),
        outer_angle: 0.785,
    };
    let lights = [
        spot(DVec3::new(0.0, 3.0, -20.0), DVec3::new(0.0, -0.15, 1.0)),
        spot(DVec3::new(0.0, 3.0, 5.0), DVec3::new(0.0, -0.1, -1.0)),
        spot(DVec3::new(0.0, 3.0, -20.0), DVec3::new(0.0, -0.15, -1.0)),
        spot(DVec3::new(0.0, 40.0, -50.0), DVec3::NEG_Y),
        Light::Point { position: DVec3::new(1.0, 8.0, -12.0) },
        Light::Point { position: DVec3::new(3.0, 30.0, -30.0) },
        scene.place_light(LightKind::Sphere),
    ];
    for light in lights {
        let uniform = shoot(&gpu, &stage, &light, plain.build(&gpu).expect("valid").as_mut());
        let hard = match light {
            Light::Sphere { center, .. } => Light::Point { position: center },
            light => light,
        };
        for (name, config) in configs(map()) {
            let found = shoot(&gpu, &stage, &light, config.build(&gpu).expect("valid").as_mut());
            assert!(found.iter().all(|v| (0.0..=1.0).contains(v)), "{name}: no visibility");
            let (with, without) = (error(&stage, &hard, &found), error(&stage, &hard, &uniform));
            assert!(
                with <= 1.25 * without + 2e-3,
                "{name} under {light:?}: {with} warped, {without} not"
            );
        }
    }
}

#[test]
fn lone_bodies_do_not_shadow_themselves_in_warped_maps() {
    let gpu = gpu();
    let scene = antumbra_scene::generate::CONVEX;
    for (name, make, _) in scene {
        let scene = make();
        let stage =
            Stage::new(&gpu, &scene, scene.camera_or_framing(), SIDE, SIDE).expect("a stage");
        for kind in [LightKind::Directional, LightKind::Spot, LightKind::Point] {
            let light = scene.place_light(kind);
            let truth = stage.truth(&light, &TruthOptions::default());
            for technique in [
                &mut lispsm(&gpu, &Lispsm { guard: false, ..Default::default() }, MAP),
                &mut psm(&gpu, false),
            ] {
                let found = shoot(&gpu, &stage, &light, technique);
                let wrong = (0..found.len())
                    .filter(|i| {
                        truth.class[*i] == SampleClass::Counted && truth.visibility[*i] == 1.0
                    })
                    .filter(|i| found[*i] < 1.0)
                    .count();
                assert_eq!(wrong, 0, "{name} under {light:?}");
            }
        }
    }
}

#[test]
fn every_technique_over_a_map_runs_warped() {
    let gpu = gpu();
    let stage = Stage::new(&gpu, &walls_and_posts(), ahead(), 96, 96).expect("a stage");
    let light = sun(70.0);
    let mut over = 0;
    for mut of in catalogue() {
        of.set_map_size(256);
        let id = of.id();
        if of.id().starts_with("sampling/") {
            continue;
        }
        let warped = Config::Lispsm(Lispsm { of: Box::new(of.clone()), ..Default::default() });
        let Ok(mut warped) = warped.build(&gpu) else {
            let outside = ["map/planar", "map/shadow-texture", "map/disc", "filter/interleaved"];
            assert!(outside.contains(&id) || id.starts_with("volume/"), "{id} was refused");
            continue;
        };
        let found = shoot(&gpu, &stage, &light, warped.as_mut());
        let single = shoot(&gpu, &stage, &light, of.build(&gpu).expect("valid").as_mut());
        let (with, without) = (error(&stage, &light, &found), error(&stage, &light, &single));
        // Ids and offsets are right to a texel, which is larger far off.
        assert!(with <= 1.5 * without + 2e-3, "{id}: {with} warped, {without} not");
        over += 1;
    }
    assert!(over >= 15, "{over} techniques over a map");
}

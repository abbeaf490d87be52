//! The counts themselves: that of each sample is the number of volumes that contain it, from wherever it is seen.

use antumbra_gpu::{
    Gpu, GpuError, GpuOptions, MeshSet, Technique, TechniqueConfig, ViewCamera, read_buffer,
};
use antumbra_measure::{MeasureError, Stage};
use antumbra_reference::ViewSample;
use antumbra_scene::generate::{self, shapes};
use antumbra_scene::{Camera, Light, LightKind, Scene};
use antumbra_volume::{
    Auto, Counter, EyeCounter, Silhouette, Triangle, VolumeTechnique, ZFail, ZPass, ZpPlus,
    homogeneous_light, twin,
};
use glam::{DAffine3, DMat4, DVec3, DVec4, Vec3};
use proptest::prelude::*;

fn gpu() -> Gpu {
    Gpu::new(&GpuOptions::default()).unwrap_or_else(|e| panic!("{e}"))
}

const VIEW: u32 = 128;

fn stage(gpu: &Gpu, scene: &Scene, camera: Camera) -> Stage {
    Stage::new(gpu, scene, camera, VIEW, VIEW).expect("a stage")
}

fn counts(gpu: &Gpu, stage: &Stage, light: &Light, technique: &mut VolumeTechnique) -> Vec<i32> {
    stage.shoot(gpu, light, technique, 0).expect("a shot");
    let buffer = technique.counts().expect("wide counters");
    let bytes = read_buffer(gpu, buffer, buffer.size()).expect("read back");
    bytemuck::pod_collect_to_vec(&bytes)
}

fn corners(stage: &Stage) -> impl Iterator<Item = [DVec3; 3]> {
    let point = |i: u32| stage.triangles.positions[i as usize].as_dvec3();
    stage.triangles.triangles.iter().map(move |t| t.map(point))
}

/// The samples that face the light.
fn facing(stage: &Stage, light: DVec4) -> impl Iterator<Item = (usize, ViewSample)> {
    let faces = move |s: &ViewSample| {
        let p = s.position.as_dvec3();
        s.normal.as_dvec3().dot(light.truncate() - p * light.w) > 0.0
    };
    stage.view_samples().into_iter().enumerate().filter(move |(_, s)| faces(s))
}

/// The scenes and eyes of these tests: eyes in light, in shadow, and high above.
fn views() -> Vec<(&'static str, Scene, Light, [Camera; 3])> {
    ["rectangle", "thin-wall", "sphere"]
        .into_iter()
        .flat_map(|name| {
            [LightKind::Directional, LightKind::Spot, LightKind::Point].map(|kind| {
                let scene = generate::by_name(name).expect("a scene");
                let light = scene.light_or_placed(kind);
                let camera = scene.camera_or_framing();
                // Behind the caster as the light sees it: three quarters of the way from it to the floor.
                let middle = match name {
                    "rectangle" => DVec3::new(0.11, 2.0, 0.07),
                    "sphere" => DVec3::new(0.01, 1.0, 0.02),
                    _ => DVec3::new(0.02, 0.9, 0.01),
                };
                let way = -light.towards(middle, glam::DVec2::splat(0.5)).normalize();
                let eye = middle + way * (0.75 * middle.y / -way.y);
                let inside = Camera { eye, target: eye + DVec3::new(1.0, -0.3, -0.4), ..camera };
                let above =
                    Camera { eye: DVec3::new(0.3, 9.0, 0.2), target: DVec3::ZERO, ..camera };
                (name, scene, light, [camera, inside, above])
            })
        })
        .collect()
}

#[test]
fn a_count_behind_the_sample_is_the_number_of_volumes_around_it() {
    let gpu = gpu();
    let mut z_fail = ZFail::default().technique(&gpu).expect("built");
    let mut compared = 0;
    for (name, scene, light, cameras) in views() {
        for camera in cameras {
            let stage = stage(&gpu, &scene, camera);
            let found = counts(&gpu, &stage, &light, &mut z_fail);
            let at = homogeneous_light(&stage.frame(&light)).as_dvec4();
            let volumes: Vec<twin::Volume> =
                corners(&stage).filter_map(|t| twin::Volume::new(at, t)).collect();
            for (i, sample) in facing(&stage, at).step_by(29) {
                let p = sample.position.as_dvec3();
                let mut inside = 0;
                // A sample near an edge of a volume, within what rasterisation moves it, has no certain number.
                let mut certain = true;
                for volume in &volumes {
                    let d = volume.distances(p);
                    let near = 2e-3;
                    let sides = d[0].max(d[1]).max(d[2]);
                    inside += i32::from(sides <= 0.0 && d[3] < -near);
                    certain &= sides.abs() > near || d[3] > near;
                }
                if certain {
                    compared += 1;
                    assert_eq!(found[i], inside, "{name}, {light:?}, {camera:?}, sample {i}: {p}");
                }
            }
        }
    }
    assert!(compared > 3_000, "{compared} samples compared");
}

#[test]
fn counts_behind_and_in_front_differ_by_the_eyes_own() {
    let gpu = gpu();
    let mut z_fail = ZFail::default().technique(&gpu).expect("built");
    let z_pass = ZPass { near_caps: true, ..ZPass::default() };
    let mut z_pass = z_pass.technique(&gpu).expect("built");
    let mut auto = Auto::default().technique(&gpu).expect("built");
    let mut around = Vec::new();
    for (name, scene, light, cameras) in views() {
        for camera in cameras {
            let stage = stage(&gpu, &scene, camera);
            let at = homogeneous_light(&stage.frame(&light)).as_dvec4();
            let eye = twin::count(at, corners(&stage), camera.eye - stage.triangles.origin) as i32;
            around.push(eye);
            let behind = counts(&gpu, &stage, &light, &mut z_fail);
            let in_front = counts(&gpu, &stage, &light, &mut z_pass);
            let chosen = counts(&gpu, &stage, &light, &mut auto);
            for (i, _) in facing(&stage, at) {
                let place = || format!("{name}, {light:?}, {camera:?}, sample {i}");
                assert_eq!(behind[i] - in_front[i], eye, "{}", place());
                assert_eq!(behind[i], chosen[i], "{}", place());
            }
        }
    }
    let in_shadow = around.iter().filter(|n| **n > 0).count();
    assert!(in_shadow >= 9 && in_shadow < around.len(), "eyes in volumes: {around:?}");
}

/// One of two ways at random: SplitMix64 (Steele, Lea, Flood 2014).
fn coin(seed: u64, pixel: usize, object: usize) -> bool {
    let mut z = seed ^ ((pixel as u64) << 32 | object as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    (z ^ (z >> 31)) & 1 == 0
}

/// Split planes (Laine 2005) choose for each object and pixel which faces to count. Whatever they choose, the number is the
/// same, but for objects whose volume contains the eye, of which only what is behind counts.
#[test]
fn any_split_image_gives_the_same_counts() {
    let gpu = gpu();
    let mut z_fail = ZFail::default().technique(&gpu).expect("built");
    let z_pass = ZPass { near_caps: true, ..ZPass::default() };
    let mut z_pass = z_pass.technique(&gpu).expect("built");
    let mut scene = Scene::default();
    for x in [-1.2, 0.0, 1.2] {
        let low = DVec3::new(x, 0.8, -0.3);
        scene.add(shapes::cuboid(low, low + DVec3::splat(0.7)), DAffine3::IDENTITY);
    }
    scene.add(shapes::icosphere(1, 0.5), DAffine3::from_translation(DVec3::new(0.4, 2.2, 0.1)));
    scene.add(shapes::floor(6.0), DAffine3::IDENTITY);
    let inside = DVec3::new(0.31, 0.5, 0.04);
    let mut otherwise = 0;
    for light in [
        Light::Directional { direction: DVec3::new(0.1, -1.0, 0.2), angular_diameter: 0.0 },
        Light::Point { position: DVec3::new(0.2, 5.0, 0.3) },
    ] {
        for eye in [DVec3::new(2.0, 3.0, 5.0), inside] {
            let camera =
                Camera { eye, target: DVec3::new(1.0, 0.0, -1.0), ..scene.framing_camera() };
            let mut stage = stage(&gpu, &scene, camera);
            let at = homogeneous_light(&stage.frame(&light)).as_dvec4();
            let samples: Vec<usize> = facing(&stage, at).map(|(i, _)| i).collect();
            let whole = counts(&gpu, &stage, &light, &mut z_fail);
            let all = stage.triangles.clone();
            let objects: Vec<[Vec<i32>; 2]> = all
                .instances
                .iter()
                .map(|range| {
                    stage.triangles.triangles = all.triangles[range.clone()].to_vec();
                    stage.triangles.instances = std::iter::once(0..range.len()).collect();
                    stage.meshes =
                        MeshSet::from_triangles(&gpu, &stage.triangles).expect("an object");
                    let behind = counts(&gpu, &stage, &light, &mut z_fail);
                    let in_front = counts(&gpu, &stage, &light, &mut z_pass);
                    let around = twin::count(at, corners(&stage), camera.eye - all.origin);
                    otherwise += usize::from(around > 0 && in_front != behind);
                    [behind.clone(), if around > 0 { behind } else { in_front }]
                })
                .collect();
            proptest!(ProptestConfig::with_cases(32), |(seed: u64)| {
                for i in samples.iter().copied() {
                    let counted = |(o, ways): (usize, &[Vec<i32>; 2])| ways[usize::from(coin(seed, i, o))][i];
                    let sum: i32 = objects.iter().enumerate().map(counted).sum();
                    prop_assert_eq!(sum, whole[i], "{:?}, eye {}, sample {}", light, eye, i);
                }
            });
        }
    }
    assert_eq!(otherwise, 4, "objects around the eye count otherwise in front");
}

/// A stack of level squares of two triangles each.
fn sheets(count: u32) -> Scene {
    let mut scene = Scene::default();
    scene.add(shapes::floor(6.0), DAffine3::IDENTITY);
    for i in 0..count {
        let center = DVec3::Y * (2.0 + 0.01 * f64::from(i));
        scene.add(shapes::quad(center, DVec3::Z, DVec3::X), DAffine3::IDENTITY);
    }
    scene
}

#[test]
fn the_wide_counter_goes_on_where_the_stencil_starts_anew() {
    let gpu = gpu();
    let light = Light::Directional { direction: DVec3::NEG_Y, angular_diameter: 0.0 };
    let [mut wide, mut stencil] = [Counter::Wide, Counter::Stencil]
        .map(|counter| ZFail { counter, ..ZFail::default() }.technique(&gpu).expect("built"));
    for count in [255, 256, 257, 300] {
        let scene = sheets(count);
        let camera = Camera { eye: DVec3::new(1.7, 1.5, 2.0), ..scene.framing_camera() };
        let camera = Camera { target: DVec3::ZERO, ..camera };
        let stage = stage(&gpu, &scene, camera);
        let found = counts(&gpu, &stage, &light, &mut wide);
        let under = |p: Vec3| {
            p.y == 0.0
                && p.x.abs().max(p.z.abs()) < 0.99
                && (p.x - p.z).abs() > 0.01
                && (p.x + p.z).abs() > 0.01
        };
        let shot = stage.shoot(&gpu, &light, &mut stencil, 0).expect("a shot");
        let dark: Vec<usize> = (0..found.len())
            .filter(|&i| stage.image.normals[i] != Vec3::ZERO && under(stage.image.positions[i]))
            .collect();
        assert!(dark.len() > 500, "{} samples below the sheets", dark.len());
        for i in dark {
            assert_eq!(found[i], count as i32, "{count} sheets, sample {i}");
            assert_eq!(shot.visibility[i] == 1.0, count % 256 == 0, "{count} sheets in 8 bits");
        }
    }
}

#[test]
fn what_a_technique_cannot_serve_it_refuses_with_a_remedy() {
    let gpu = gpu();
    let scene = generate::by_name("cube").expect("a scene");
    let light = scene.light_or_placed(LightKind::Point);
    let sample = ViewSample { position: Vec3::new(0.2, 0.0, 1.0), normal: Vec3::Y };
    let stage = Stage::at_points(&gpu, &scene, &[sample]).expect("a stage");
    let configs: [&dyn TechniqueConfig; 6] = [
        &ZFail::default(),
        &Silhouette::default(),
        &ZPass::default(),
        &EyeCounter::default(),
        &ZpPlus::default(),
        &Auto::default(),
    ];
    for config in configs.iter() {
        let mut technique = config.build(&gpu).expect("built");
        let error = stage.shoot(&gpu, &light, technique.as_mut(), 0).expect_err("no camera");
        assert!(
            matches!(&error, MeasureError::Gpu(GpuError::Invalid { what: "camera", .. })),
            "{error}"
        );
        assert!(error.to_string().contains("volume/triangle"), "{error}");
    }
    // Parallel lines of sight, straight down: there is a near plane, but no eye from which ZP+ could see it.
    let clip = DMat4::from_rows(
        DVec4::new(0.5, 0.0, 0.0, 0.0),
        DVec4::new(0.0, 0.0, -0.5, 0.0),
        DVec4::new(0.0, 0.05, 0.0, 0.5),
        DVec4::W,
    );
    let view = ViewCamera { clip, eye: DVec3::new(0.3, 10.0, 0.2) };
    let mut parallel = Stage::seen_by(&gpu, &scene, &view, 16, 16).expect("a stage");
    let mut technique = ZpPlus::default().build(&gpu).expect("built");
    let error = parallel.shoot(&gpu, &light, technique.as_mut(), 0).expect_err("no eye");
    let text = error.to_string();
    assert!(text.contains("orthographic") && text.contains("volume/counter"), "{text}");
    // A camera that shows nothing.
    let flat = DMat4::from_rows(DVec4::X, DVec4::X, DVec4::Y, DVec4::W);
    parallel.set_camera(Some(ViewCamera { clip: flat, ..view }));
    let mut technique = ZFail::default().build(&gpu).expect("built");
    let error = parallel.shoot(&gpu, &light, technique.as_mut(), 0).expect_err("no picture");
    assert!(error.to_string().contains("invertible"), "{error}");
    let wide = Light::Spot { position: 4.0 * DVec3::Y, direction: DVec3::NEG_Y, outer_angle: 1.8 };
    for config in configs.iter().chain(&[&Triangle::default() as &dyn TechniqueConfig]) {
        let mut technique = config.build(&gpu).expect("built");
        let error = stage.shoot(&gpu, &wide, technique.as_mut(), 0).expect_err("no cone");
        assert!(error.to_string().contains("point light"), "{error}");
    }
    let mut asked = Triangle::default().build(&gpu).expect("built");
    stage.shoot(&gpu, &light, asked.as_mut(), 0).expect("needs no camera");
    let dark: &mut dyn Technique = asked.as_mut();
    let bad = Light::Point { position: DVec3::NAN };
    let error = stage.shoot(&gpu, &bad, dark, 0).expect_err("no light");
    assert!(error.to_string().contains("finite position"), "{error}");
}

//! View samples from an engine's depth buffer.

use antumbra::{Config, catalogue};
use antumbra_gpu::{
    DepthCamera, DepthSamples, Expectation, Frame, Gpu, ViewSamples, read_f32_texture,
};
use antumbra_measure::Stage;
use antumbra_scene::{Light, LightKind, Scene, generate};
use antumbra_tests::{gpu, submit, texture};
use glam::{DVec2, Vec3};
fn scene() -> Scene {
    generate::sphere_over_plane(&Default::default())
}

fn stage(gpu: &Gpu, scene: &Scene, side: u32) -> Stage {
    Stage::new(gpu, scene, scene.camera_or_framing(), side, side).expect("a stage")
}

/// View samples from the depth that a stage's camera sees, with or without its normals.
fn samples_from_depth(gpu: &Gpu, scene: &Scene, stage: &Stage, with_normals: bool) -> ViewSamples {
    let (width, height) = stage.samples.size();
    let depth = texture(gpu, wgpu::TextureFormat::Depth32Float, width, 1);
    let depth = depth.create_view(&Default::default());
    let scratch = ViewSamples::new(gpu, width, height).expect("a valid size");
    let samples = ViewSamples::new(gpu, width, height).expect("a valid size");
    let pass = DepthSamples::new(gpu).expect("the pass");
    let view = stage.meshes.view_camera(&scene.camera_or_framing(), (width, height));
    let camera = DepthCamera { view, background: 0.0 };
    submit(gpu, |recorder| {
        stage.meshes.encode_view_samples(gpu, recorder, &view, &depth, &scratch);
        let normals = with_normals.then_some(&stage.samples.normals_view);
        pass.encode(gpu, recorder, &camera, &depth, normals, &samples).expect("a valid camera");
    });
    samples
}

#[test]
fn positions_from_depth_lie_within_their_bound_of_the_surface() {
    let gpu = gpu();
    let cube = generate::by_name("convex-cube").expect("a scene of that name");
    // Through a lens of long focal length a pixel is as small as rounding.
    let mut through_a_telescope = scene();
    through_a_telescope.name = "far sphere".to_owned();
    through_a_telescope.camera = through_a_telescope.camera.map(|mut camera| {
        camera.eye = camera.target + 300.0 * (camera.eye - camera.target);
        camera.fov_y /= 300.0;
        camera
    });
    for scene in [scene(), cube, through_a_telescope] {
        for side in [64, 512] {
            let stage = stage(&gpu, &scene, side);
            let samples = samples_from_depth(&gpu, &scene, &stage, true);
            let found = samples.read(&gpu).expect("read back");
            let bounds = read_f32_texture(&gpu, &samples.normals, 0).expect("read back");
            let mut worst = 0f64;
            let mut seen = 0;
            for (i, n) in stage.image.normals.iter().enumerate() {
                let there = *n != Vec3::ZERO;
                assert_eq!(found.normals[i] != Vec3::ZERO, there, "pixel {i}: surface or none");
                if there {
                    // The rastered position lies on its triangle's plane.
                    let off = (found.positions[i] - stage.image.positions[i]).as_dvec3();
                    let bound = f64::from(bounds[4 * i + 3]);
                    worst = worst.max(n.as_dvec3().dot(off).abs() / bound);
                    seen += 1;
                }
            }
            assert!(seen > 1000, "{seen} pixels show a surface");
            assert!(worst <= 1.0, "{}, {side}: {worst} of the stated bound", scene.name);
        }
    }
}

/// Samples that face the light, and how many of them are not fully lit.
fn acne(
    samples: &ViewSamples,
    gpu: &Gpu,
    stage: &Stage,
    light: &Light,
    v: &[f32],
) -> (usize, usize) {
    let image = samples.read(gpu).expect("read back");
    let mut counts = (0, 0);
    for ((p, n), v) in image.positions.iter().zip(&image.normals).zip(v) {
        let p = stage.triangles.origin + p.as_dvec3();
        let to_light = light.towards(p, DVec2::splat(0.5)).normalize();
        if *n != Vec3::ZERO && n.as_dvec3().dot(to_light) > 1e-4 {
            counts.0 += 1;
            counts.1 += usize::from(*v < 1.0);
        }
    }
    counts
}

/// Whether theory promises as much, of samples that a depth buffer gives: they do not know their object.
fn is_free_of_acne(config: &Config) -> bool {
    let holds = config.expectation("lone receivers, directional")
        == Some(Expectation::Holds { bound: 0.0 });
    holds && !matches!(config, Config::ObjectId(_))
}

/// Whether the technique draws a shadow map: then its size can be set.
fn has_map(config: &Config) -> bool {
    let mut other = config.clone();
    other.set_map_size(77);
    other != *config
}

#[test]
fn lone_receivers_seen_through_a_depth_buffer_have_no_acne() {
    let gpu = gpu();
    let (mut seen, mut with_given, mut with_own) = (0, 0, 0);
    let mut techniques: Vec<_> = catalogue()
        .into_iter()
        .filter(has_map)
        .filter(is_free_of_acne)
        .map(|mut config| {
            config.set_map_size(512);
            config.build(&gpu).expect("a valid config")
        })
        .collect();
    for (name, build, _) in generate::CONVEX {
        let scene = build();
        let mut stage = stage(&gpu, &scene, 192);
        stage.meshes.set_culling(false);
        for with_normals in [true, false] {
            let samples = samples_from_depth(&gpu, &scene, &stage, with_normals);
            let kinds = [LightKind::Directional, LightKind::Spot, LightKind::Point];
            for (turn, kind) in kinds.into_iter().enumerate() {
                let light = scene.place_light(kind);
                for technique in techniques.iter_mut().skip(turn).step_by(3) {
                    let frame = Frame { samples: &samples, ..stage.frame(&light) };
                    let target = samples.visibility_target(&gpu).expect("a target");
                    let view = target.create_view(&Default::default());
                    technique.prepare(&gpu, &frame).expect("prepared");
                    submit(&gpu, |recorder| {
                        technique.encode(&gpu, &frame, recorder, &view).expect("encoded");
                    });
                    let v = read_f32_texture(&gpu, &target, 0).expect("read back");
                    let (facing, dark) = acne(&samples, &gpu, &stage, &light, &v);
                    assert!(facing > 0, "{name}: no sample faces the light");
                    if with_normals {
                        with_given += dark;
                    } else {
                        seen += facing;
                        with_own += dark;
                    }
                }
            }
        }
    }
    assert_eq!(with_given, 0, "samples in false shadow with normals given");
    // A face seen 2 pixels wide lends a normal that is not its own: the facets of the sphere towards its rim.
    let rate = with_own as f64 / seen as f64;
    assert!(rate <= 5e-3, "{rate} of the samples are in false shadow with normals from depth");
}

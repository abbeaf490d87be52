//! Projection shadows: flattened casters, shadow textures and discs, against rays and against their f64 twins.

use antumbra_gpu::{
    CasterTriangles, Casters, Drawn, Frame, Gpu, GpuError, LightView, Recorder, Technique,
    TechniqueConfig, read_f32_texture,
};
use antumbra_map::projection::{ShadowTextureTechnique, twin};
use antumbra_map::{DiscShadows, MapConfig, MapTechnique, Planar, Plane, ShadowTexture};
use antumbra_measure::Stage;
use antumbra_measure::stability::Case;
use antumbra_reference::{SampleClass, Truth, TruthOptions, ViewSample};
use antumbra_scene::generate::{self, shapes};
use antumbra_scene::{Camera, Light, Scene};
use antumbra_tests::gpu;
use glam::{DAffine3, DVec3, Vec3};

const VIEW: u32 = 192;

fn stage(gpu: &Gpu, scene: &Scene, camera: Camera) -> Stage {
    Stage::new(gpu, scene, camera, VIEW, VIEW).expect("a stage")
}

fn shoot(gpu: &Gpu, stage: &Stage, light: &Light, config: &dyn TechniqueConfig) -> Vec<f32> {
    let mut technique = config.build(gpu).expect("a valid config");
    stage.shoot(gpu, light, technique.as_mut(), 0).expect("a shot").visibility
}

/// Samples that lie on the plane `normal . x + offset = 0`, which is level with an axis, and face the light.
fn on_plane(stage: &Stage, truth: &Truth, plane: &Plane) -> Vec<usize> {
    let on = |(i, s): (usize, &ViewSample)| {
        let p = stage.triangles.origin + s.position.as_dvec3();
        let there = s.normal != Vec3::ZERO
            && (plane.normal.dot(p) + plane.offset).abs() < 1e-6
            && s.normal.as_dvec3().dot(plane.normal).abs() > 0.99;
        (there && truth.class[i] == SampleClass::Counted).then_some(i)
    };
    stage.view_samples().iter().enumerate().filter_map(on).collect()
}

/// Where the visibility of samples on planes differs from the rays', and how many samples the edge of a shadow
/// passes by, nearer than the next pixel.
struct Outcome {
    /// Samples compared, dark ones among them.
    samples: usize,
    dark: usize,
    /// Samples at the edge of a shadow, and wrong ones among them.
    edge: usize,
    wrong_at_edge: usize,
    /// Other wrong samples.
    wrong: usize,
}

fn compare(stage: &Stage, truth: &Truth, samples: &[usize], visibility: &[f32]) -> Outcome {
    let (width, height) = (stage.image.width as isize, stage.image.height as isize);
    let edge = |i: usize| {
        let (x, y) = (i as isize % width, i as isize / width);
        [(-1, 0), (1, 0), (0, -1), (0, 1)].iter().any(|(dx, dy)| {
            let (x, y) = (x + dx, y + dy);
            let there = (0..width).contains(&x) && (0..height).contains(&y);
            there && truth.visibility[(y * width + x) as usize] != truth.visibility[i]
        })
    };
    let mut out = Outcome { samples: samples.len(), dark: 0, edge: 0, wrong_at_edge: 0, wrong: 0 };
    for &i in samples {
        assert!((0.0..=1.0).contains(&visibility[i]), "visibility {}", visibility[i]);
        let (edge, wrong) = (edge(i), visibility[i] != truth.visibility[i]);
        out.dark += usize::from(truth.visibility[i] == 0.0);
        out.edge += usize::from(edge);
        out.wrong_at_edge += usize::from(edge && wrong);
        out.wrong += usize::from(!edge && wrong);
    }
    out
}

/// Flattened casters decide at the samples themselves. The rasteriser moves an edge by at most 1/256 pixel an axis
/// and rounding by less; of the pixels that an edge passes at a distance spread evenly up to a pixel it decides at
/// most one in 64 wrongly.
fn assert_exact(outcome: &Outcome, what: &str) {
    assert!(outcome.dark > 50 && outcome.samples > 4 * outcome.dark / 3, "{what}: nothing to see");
    assert_eq!(outcome.wrong, 0, "{what}: wrong samples off any edge");
    let allowed = outcome.edge / 64 + 1;
    assert!(
        outcome.wrong_at_edge <= allowed,
        "{what}: {} of {}",
        outcome.wrong_at_edge,
        outcome.edge
    );
}

const FLOOR: Plane = Plane { normal: DVec3::Y, offset: 0.0 };

/// A sphere and a turned box over a floor.
fn scene() -> Scene {
    let mut scene = generate::sphere_over_plane(&Default::default());
    scene.add(
        shapes::cuboid(DVec3::new(0.6, 0.0, -0.9), DVec3::new(1.0, 0.8, -0.5)),
        DAffine3::from_rotation_y(0.3),
    );
    scene
}

fn hard_lights() -> [Light; 3] {
    [
        Light::sun(50_f64.to_radians(), 0.7, 0.0),
        Light::Spot {
            position: DVec3::new(1.0, 6.0, 2.0),
            direction: DVec3::new(-0.1, -1.0, -0.3).normalize(),
            outer_angle: 1.2,
        },
        // Amid the casters: the sphere reaches above it.
        Light::Point { position: DVec3::new(-1.2, 1.0, 0.3) },
    ]
}

#[test]
fn flattened_casters_are_exact_on_the_floor_and_leave_the_rest_alone() {
    let gpu = gpu();
    let scene = scene();
    let stage = stage(&gpu, &scene, scene.camera_or_framing());
    for light in hard_lights() {
        let truth = stage.truth(&light, &TruthOptions::default());
        let visibility = shoot(&gpu, &stage, &light, &Planar::default());
        let floor = on_plane(&stage, &truth, &FLOOR);
        assert_exact(&compare(&stage, &truth, &floor, &visibility), &format!("{light:?}"));
        for (i, sample) in stage.view_samples().iter().enumerate() {
            let p = stage.triangles.origin + sample.position.as_dvec3();
            if sample.normal == Vec3::ZERO || p.y.abs() < 1e-6 {
                continue;
            }
            let facing = sample.normal.as_dvec3().dot(light.towards(p, glam::DVec2::splat(0.5)));
            if facing.abs() > 1e-4 {
                let expected = if facing > 0.0 { 1.0 } else { 0.0 };
                assert_eq!(visibility[i], expected, "{light:?}: a sample off the plane at {p}");
            }
        }
        // The control: the shadows of another light.
        let other = shoot(&gpu, &stage, &light.translated(DVec3::X), &Planar::default());
        if light.position().is_some() {
            let outcome = compare(&stage, &truth, &floor, &other);
            assert!(outcome.wrong > 100, "{light:?}: another light's shadows pass");
        }
    }
}

/// A floor, a wall that the camera sees in front of a part of the floor's shadow, and a box that shadows both.
fn corner() -> (Scene, Camera, [Plane; 2]) {
    let mut scene = Scene::default();
    scene.add(shapes::floor(4.0), DAffine3::IDENTITY);
    scene.add(
        shapes::quad(DVec3::new(-4.0, 2.0, 0.0), 2.0 * DVec3::Y, 4.0 * DVec3::Z),
        DAffine3::IDENTITY,
    );
    scene.add(
        shapes::cuboid(DVec3::new(-2.5, 0.5, -1.0), DVec3::new(-1.5, 2.0, 1.0)),
        DAffine3::IDENTITY,
    );
    let camera = Camera {
        eye: DVec3::new(3.5, 3.0, 5.0),
        target: DVec3::new(-2.0, 0.5, 0.0),
        up: DVec3::Y,
        fov_y: 0.9,
        near: 0.1,
    };
    let wall = Plane::through(DVec3::new(-4.0, 0.0, 0.0), DVec3::X);
    (scene, camera, [FLOOR, wall])
}

#[test]
fn each_of_two_planes_gets_its_own_shadow_and_no_other() {
    let gpu = gpu();
    let (scene, camera, planes) = corner();
    let stage = stage(&gpu, &scene, camera);
    let given = Planar { planes: planes.to_vec() };
    for light in [
        Light::Directional {
            direction: DVec3::new(-1.0, -0.8, -0.2).normalize(),
            angular_diameter: 0.0,
        },
        Light::Point { position: DVec3::new(1.0, 3.0, 0.5) },
    ] {
        let truth = stage.truth(&light, &TruthOptions::default());
        let found = shoot(&gpu, &stage, &light, &Planar::default());
        for plane in &planes {
            let samples = on_plane(&stage, &truth, plane);
            assert_exact(
                &compare(&stage, &truth, &samples, &found),
                &format!("{plane:?}, {light:?}"),
            );
        }
        assert!(shoot(&gpu, &stage, &light, &given) == found, "{light:?}: planes given and found");
        let floor_alone = Planar { planes: vec![FLOOR] };
        let visibility = shoot(&gpu, &stage, &light, &floor_alone);
        for i in on_plane(&stage, &truth, &planes[1]) {
            assert_eq!(visibility[i], 1.0, "{light:?}: the wall receives, and was not asked to");
        }
    }
}

#[test]
fn shadows_neither_fight_nor_darken_twice_at_any_elevation_of_the_camera() {
    let gpu = gpu();
    let mut scene = Scene::default();
    scene.add(shapes::floor(400.0), DAffine3::IDENTITY);
    // 300 sheets: one darkening each would be 300, and a counter of 8 bits back to 44.
    for i in 0..300 {
        let center = DVec3::Y * (20.0 + 0.1 * f64::from(i));
        scene.add(shapes::quad(center, 100.0 * DVec3::Z, 100.0 * DVec3::X), DAffine3::IDENTITY);
    }
    let light = Light::Directional { direction: DVec3::NEG_Y, angular_diameter: 0.0 };
    let mut stages = 0;
    for elevation in [1.0, 10.0, 45.0, 89.0_f64] {
        let (sin, cos) = elevation.to_radians().sin_cos();
        let eye = 1000.0 * DVec3::new(0.3 * cos, sin, cos);
        let camera = Camera { eye, target: DVec3::ZERO, up: DVec3::Y, fov_y: 0.4, near: 0.1 };
        // The floor alone, seen through the sheets.
        let side = f64::from(VIEW);
        let floor = |i: u32| {
            let (x, y) = (f64::from(i % VIEW) + 0.5, f64::from(i / VIEW) + 0.5);
            let ray = camera.ray_direction(x / side, y / side, 1.0);
            let p = (camera.eye - ray * (camera.eye.y / ray.y)).with_y(0.0);
            let there = ray.y < 0.0 && p.abs().max_element() < 400.0;
            let normal = if there { Vec3::Y } else { Vec3::ZERO };
            ViewSample { position: (p - scene.origin()).as_vec3(), normal }
        };
        let points: Vec<ViewSample> = (0..VIEW * VIEW).map(floor).collect();
        let stage = Stage::seen(&gpu, &scene, &camera, (VIEW, VIEW), &points).expect("a stage");
        let visibility = shoot(&gpu, &stage, &light, &Planar::default());
        // A pixel is 0.4 / 192 of the distance high and 1 / sin as long on the floor, of which 1/256 is the
        // rasteriser's; the rounding of f32 coordinates of 1000 m in a picture of 400 m is 1/300 pixel more.
        let allowed = 1400.0 * 0.4 / side / sin / 100.0;
        let (mut dark, mut off) = (0, 0);
        for (point, v) in points.iter().zip(&visibility).filter(|(p, _)| p.normal != Vec3::ZERO) {
            let p = scene.origin() + point.position.as_dvec3();
            let inside = 100.0 - p.x.abs().max(p.z.abs());
            dark += usize::from(inside > 0.0);
            let right = *v == if inside > 0.0 { 0.0 } else { 1.0 };
            off += usize::from(!right && inside.abs() > allowed);
        }
        assert!(dark > 100, "{elevation} degrees: {dark} samples in shadow");
        assert_eq!(off, 0, "{elevation} degrees: wrong samples");
        stages += 1;
    }
    assert_eq!(stages, 4, "all elevations");
}

#[test]
fn a_light_that_rises_past_a_corner_never_flashes() {
    let gpu = gpu();
    let mut scene = Scene::default();
    scene.add(shapes::floor(10.0), DAffine3::IDENTITY);
    let pole = shapes::cuboid(DVec3::new(-0.5, 0.5, -2.5), DVec3::new(0.5, 2.0, -2.0));
    scene.add(pole, DAffine3::from_rotation_y(0.2));
    let camera = Camera {
        eye: DVec3::new(2.0, 7.0, 8.0),
        target: DVec3::ZERO,
        up: DVec3::Y,
        fov_y: 1.0,
        near: 0.1,
    };
    let stage = stage(&gpu, &scene, camera);
    let mut shadows = 0;
    for step in 0..40 {
        // Past 0.5 m and 2 m, also exactly.
        let light = Light::Point { position: DVec3::Y * (0.25 + 0.05 * f64::from(step)) };
        let truth = stage.truth(&light, &TruthOptions::default());
        let visibility = shoot(&gpu, &stage, &light, &Planar::default());
        let samples = on_plane(&stage, &truth, &FLOOR);
        let outcome = compare(&stage, &truth, &samples, &visibility);
        assert_eq!(outcome.wrong, 0, "light at {light:?}");
        assert!(outcome.wrong_at_edge <= outcome.edge / 64 + 1, "light at {light:?}");
        shadows += usize::from(outcome.dark > 50);
    }
    assert!(shadows > 20, "{shadows} lights with a shadow");
}

#[test]
fn a_shadow_texture_is_the_flattened_shadow_to_a_texel_and_converges() {
    let gpu = gpu();
    let scene = scene();
    let stage = stage(&gpu, &scene, scene.camera_or_framing());
    for light in hard_lights() {
        let truth = stage.truth(&light, &TruthOptions::default());
        let exact = shoot(&gpu, &stage, &light, &Planar::default());
        let floor = on_plane(&stage, &truth, &FLOOR);
        let error = |config: &ShadowTexture| {
            let mask = shoot(&gpu, &stage, &light, config);
            floor.iter().map(|&i| f64::from((mask[i] - exact[i]).abs())).sum::<f64>()
        };
        for linear in [false, true] {
            let at = |size| error(&ShadowTexture { size, linear, ..ShadowTexture::default() });
            let (coarse, fine) = (at(256), at(1024));
            assert!(
                coarse > 1.0,
                "{light:?}: {coarse} samples off at 256 texels, a texture without texels"
            );
            // The area along the edge that is decided by another texel falls with the texel's side: by 4, within a
            // factor of 2 for the edge's phases.
            assert!(fine < 0.5 * coarse, "{light:?}, linear {linear}: {coarse}, then {fine}");
        }
    }
}

#[test]
fn shadow_textures_shadow_two_planes_from_one_light() {
    let gpu = gpu();
    let (scene, camera, planes) = corner();
    let stage = stage(&gpu, &scene, camera);
    let light = Light::Point { position: DVec3::new(1.0, 3.0, 0.5) };
    let truth = stage.truth(&light, &TruthOptions::default());
    let config = ShadowTexture { size: 1024, linear: false, ..ShadowTexture::default() };
    let visibility = shoot(&gpu, &stage, &light, &config);
    for plane in &planes {
        let outcome = compare(&stage, &truth, &on_plane(&stage, &truth, plane), &visibility);
        assert!(outcome.dark > 50, "{plane:?}: no shadow");
        // A texel is finer than a pixel here, so that only pixels at an edge are off.
        assert_eq!(outcome.wrong, 0, "{plane:?}");
    }
}

/// The first layer of a technique's mask, drawn for HC-01 B.
fn mask_of(gpu: &Gpu, config: &ShadowTexture) -> Vec<u8> {
    let scene = generate::rectangle_over_plane(&Default::default());
    let stage = stage(gpu, &scene, scene.camera_or_framing());
    let light = Light::Directional { direction: DVec3::NEG_Y, angular_diameter: 0.0 };
    let mut technique = ShadowTextureTechnique::new(gpu, config).expect("a valid config");
    stage.shoot(gpu, &light, &mut technique, 0).expect("a shot");
    let texture = technique.mask();
    let (side, row) = (texture.width(), texture.width().next_multiple_of(256));
    let buffer = gpu.device.create_buffer(&wgpu::BufferDescriptor {
        label: None,
        size: u64::from(row) * u64::from(side),
        usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::COPY_SRC,
        mapped_at_creation: false,
    });
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    encoder.copy_texture_to_buffer(
        texture.as_image_copy(),
        wgpu::TexelCopyBufferInfo {
            buffer: &buffer,
            layout: wgpu::TexelCopyBufferLayout {
                offset: 0,
                bytes_per_row: Some(row),
                rows_per_image: None,
            },
        },
        wgpu::Extent3d { width: side, height: side, depth_or_array_layers: 1 },
    );
    gpu.queue.submit([encoder.finish()]);
    let bytes = antumbra_gpu::read_buffer(gpu, &buffer, buffer.size()).expect("read back");
    bytes.chunks(row as usize).flat_map(|r| r[..side as usize].to_vec()).collect()
}

#[test]
fn blur_is_a_gaussian_and_keeps_the_shadows_area() {
    let gpu = gpu();
    let (size, sigma) = (128_u32, 2.5_f32);
    let usual = ShadowTexture { size, ..ShadowTexture::default() };
    let blurred = mask_of(&gpu, &ShadowTexture { blur: sigma, ..usual.clone() });
    let weights = twin::blur_weights(f64::from(sigma));
    let radius = (weights.len() / 2) as i32;
    // The unblurred mask: the square fills the window but for the guard band of kernel, interpolation and rounding.
    let guard = (radius + 2) as u32;
    let inside = |i: i32| i >= guard as i32 && i < (size - guard) as i32;
    let profile = |i: i32| -> f64 {
        let taps = (-radius..=radius).zip(&weights);
        taps.map(|(o, w)| if inside(i + o) { *w } else { 0.0 }).sum()
    };
    let mut area = 0.0;
    for y in 0..size as i32 {
        for x in 0..size as i32 {
            let dark = 1.0 - f64::from(blurred[(y * size as i32 + x) as usize]) / 255.0;
            area += dark;
            let expected = profile(x) * profile(y);
            // Either pass rounds to half a step of 255; the weights add up to 1, so that nothing grows. exp and the
            // sums in f32 add a hundredth of a step.
            assert!((dark - expected).abs() <= 1.02 / 255.0, "at {x}, {y}: {dark}, not {expected}");
        }
    }
    let square = f64::from((size - 2 * guard).pow(2));
    // Rounding in either pass is at most half a step, and only where the mask is neither 0 nor 1: within the radius
    // of the edge to both sides.
    let border =
        f64::from(4 * (size - 2 * guard) * 2 * radius as u32 + 4 * (2 * radius as u32).pow(2));
    assert!((area - square).abs() <= border / 255.0, "area {area}, not {square}");
    let sharp = mask_of(&gpu, &usual);
    assert!(sharp.iter().all(|v| *v == 0 || *v == 255), "without a blur the mask is binary");
}

#[test]
fn discs_are_where_and_as_dark_as_their_twin_says() {
    let gpu = gpu();
    let scene = scene();
    let stage = stage(&gpu, &scene, scene.camera_or_framing());
    let config =
        DiscShadows { growth: 0.2, fade: 0.5, opacity: 0.8, inner: 0.3, ..DiscShadows::default() };
    for light in hard_lights() {
        let visibility = shoot(&gpu, &stage, &light, &config);
        let origin = stage.triangles.origin;
        let light_vector = match light {
            Light::Directional { direction, .. } => (-direction).extend(0.0),
            _ => light.position().expect("a position").extend(1.0),
        };
        let mut discs = Vec::new();
        stage.meshes.bodies(&mut |body| {
            if body.floor.is_none() {
                discs.extend(config.disc(body, DVec3::Y.extend(0.0), light_vector));
            }
        });
        assert!(!discs.is_empty(), "{light:?}: no discs");
        let mut darkened = 0;
        for (sample, v) in stage.view_samples().iter().zip(&visibility) {
            let p = origin + sample.position.as_dvec3();
            if sample.normal != Vec3::Y || p.y.abs() > 1e-6 {
                continue;
            }
            let dark = discs.iter().map(|d| {
                twin::darkness(p.distance(d.center), d.radius, d.opacity, f64::from(config.inner))
            });
            let expected = 1.0 - dark.fold(0.0, f64::max);
            // Distance and radius are rounded to 2^-24 of 10 m, a few times; the steepest ramp is 1.5 / (0.7 radius).
            assert!(
                (f64::from(*v) - expected).abs() < 2e-5,
                "{light:?} at {p}: {v}, not {expected}"
            );
            darkened += usize::from(expected < 0.9);
        }
        assert!(darkened > 50, "{light:?}: {darkened} samples in a disc");
    }
}

/// Casters that say nothing of their bodies, and of their triangles only where asked to.
struct Secretive<'a> {
    casters: &'a dyn Casters,
    triangles: bool,
}

impl Casters for Secretive<'_> {
    fn hull(&self, light: &Light, visit: &mut dyn FnMut(DVec3)) {
        self.casters.hull(light, visit);
    }

    fn draw(&self, view: &LightView<'_>, pass: &mut wgpu::RenderPass<'_>) -> Drawn {
        self.casters.draw(view, pass)
    }

    fn triangles(&self) -> Option<CasterTriangles<'_>> {
        self.casters.triangles().filter(|_| self.triangles)
    }
}

fn run(gpu: &Gpu, frame: &Frame<'_>, technique: &mut dyn Technique) -> Result<Vec<f32>, GpuError> {
    let target = frame.samples.visibility_target(gpu)?;
    technique.prepare(gpu, frame)?;
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    let view = target.create_view(&Default::default());
    technique.encode(gpu, frame, &mut Recorder::new(&mut encoder), &view)?;
    gpu.queue.submit([encoder.finish()]);
    read_f32_texture(gpu, &target, 0)
}

#[test]
fn what_a_frame_lacks_is_refused_with_a_fix_and_discs_need_neither() {
    let gpu = gpu();
    let scene = scene();
    let stage = stage(&gpu, &scene, scene.camera_or_framing());
    let light = hard_lights()[0];
    let whole = stage.frame(&light);
    let secretive = Secretive { casters: &stage.meshes, triangles: false };
    let no_triangles = Frame { casters: &secretive, ..whole };
    let no_camera = Frame { camera: None, ..whole };
    let mut planar = Planar::default().build(&gpu).expect("a valid config");
    let mut mask = ShadowTexture::default().build(&gpu).expect("a valid config");
    let mut disc = DiscShadows::default().build(&gpu).expect("a valid config");
    let what = |result: Result<Vec<f32>, GpuError>| match result {
        Err(GpuError::Invalid { what, .. }) => what,
        other => panic!("{other:?}"),
    };
    assert_eq!(what(run(&gpu, &no_camera, planar.as_mut())), "camera of the frame", "planar");
    assert_eq!(what(run(&gpu, &no_triangles, planar.as_mut())), "casters", "planar");
    assert_eq!(what(run(&gpu, &no_triangles, mask.as_mut())), "casters", "shadow texture");
    assert!(run(&gpu, &no_camera, mask.as_mut()).is_ok(), "a shadow texture needs no camera");
    assert!(run(&gpu, &no_camera, disc.as_mut()).is_ok(), "discs need no camera");
    assert!(run(&gpu, &no_triangles, disc.as_mut()).is_ok(), "discs need no triangles");
    // And the refused technique recovers.
    assert!(run(&gpu, &whole, planar.as_mut()).is_ok(), "planar");
    assert_eq!(gpu.check(), Ok(()), "nothing reached wgpu");
}

#[test]
fn casters_that_name_no_floor_get_shadows_on_the_planes_given() {
    let gpu = gpu();
    let scene = scene();
    let stage = stage(&gpu, &scene, scene.camera_or_framing());
    let secretive = Secretive { casters: &stage.meshes, triangles: true };
    for light in hard_lights() {
        let whole = stage.frame(&light);
        let frame = Frame { casters: &secretive, ..whole };
        let shadows = |frame: &Frame<'_>, config: &dyn TechniqueConfig| {
            let mut technique = config.build(&gpu).expect("a valid config");
            run(&gpu, frame, technique.as_mut()).expect("shadows")
        };
        // The same floor by other numbers.
        let planes = vec![Plane { normal: DVec3::Y * -3.0, offset: 0.0 }];
        let planar = Planar { planes: planes.clone() };
        let found = shadows(&whole, &Planar::default());
        assert!(shadows(&frame, &planar) == found, "{light:?}: planar");
        assert!(shadows(&frame, &Planar::default()) != found, "{light:?}: shadows on no plane");
        let mask = ShadowTexture { size: 512, planes, ..ShadowTexture::default() };
        let usual = ShadowTexture { size: 512, ..ShadowTexture::default() };
        assert!(shadows(&frame, &mask) == shadows(&whole, &usual), "{light:?}: shadow texture");
    }
}

/// HC-17. Of the cube's shadow on a wall that does not receive, the eye sees what lies past the cube's back, from 0.87 m on, up
/// to 1.11 m: a strip of 0.24 m, of casters that are 8.5 m as the light sees them, whatever a map's texels are.
#[test]
fn of_a_wall_that_does_not_receive_the_strip_in_sight_is_wrong_at_any_map_size() {
    let gpu = gpu();
    let case = Case::by_name("HC-17 beyond the far plane").expect("a case of that name");
    for size in [128, 1024, 2048] {
        let mut found = Vec::new();
        let discs = DiscShadows::default();
        let texture = ShadowTexture { size, ..ShadowTexture::default() };
        let all: [&dyn TechniqueConfig; 3] = [&Planar::default(), &discs, &texture];
        for config in all {
            let mut technique = config.build(&gpu).expect("a valid config");
            let texels = case.measure(&gpu, technique.as_mut(), size).expect("measured");
            found.push(texels * 8.5 / f64::from(size));
            let expected = config.expectation(case.name).expect("an expectation");
            assert!(expected.is_met_by(texels), "{size}: {texels}, not {expected:?}");
        }
        // Samples are 0.2 m apart, so that a column lies somewhere in the strip.
        assert!(found.iter().all(|m| (0.04..0.24).contains(m)), "{size}: {found:?} m");
    }
    // The control: a map shadows the wall, and is wrong within its texels only.
    let size = 1024;
    let map = MapConfig { size, ..MapConfig::default() };
    let mut map = MapTechnique::plain(&gpu, &map).expect("a valid config");
    let texels = case.measure(&gpu, &mut map, size).expect("measured");
    assert!(texels * 8.5 / f64::from(size) < 0.04, "{texels} texels");
}

#[test]
fn settings_out_of_range_are_refused() {
    let gpu = gpu();
    let none = Plane { normal: DVec3::ZERO, offset: 1.0 };
    let planar = Planar { planes: vec![none] }.build(&gpu).map(|_| ());
    assert!(matches!(planar, Err(GpuError::Invalid { what: "receiving plane", .. })), "{planar:?}");
    for blur in [-1.0, f32::NAN, 65.0] {
        let refused = ShadowTexture { blur, ..ShadowTexture::default() }.build(&gpu).map(|_| ());
        assert!(
            matches!(refused, Err(GpuError::Invalid { what: "blur", .. })),
            "{blur}: {refused:?}"
        );
    }
}

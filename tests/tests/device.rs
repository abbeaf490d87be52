//! The library on a caller's device, and what it says to a caller's mistakes.

use antumbra::{Config, catalogue};
use antumbra_gpu::{
    DepthCamera, DepthSamples, Gpu, GpuError, GpuOptions, MeshSet, Technique, ViewCamera,
    ViewSamples,
};
use antumbra_map::{
    Bias, DepthConvention, Estimator, Layout, MapConfig, MapTechnique, Resolve, ShadowView,
};
use antumbra_measure::Stage;
use antumbra_scene::{Light, LightKind, Scene, Triangles, generate};
use antumbra_tests::{gpu, one_in, submit, texture};

use glam::{DMat4, DVec3, DVec4, Vec3};
/// A device as a caller makes it, with nothing beyond WebGPU's defaults, on the adapter of the other tests. An
/// error that wgpu reports on it and nobody catches is a panic.
fn callers_device() -> Gpu {
    let name = gpu().info.name;
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
    let adapters = pollster::block_on(instance.enumerate_adapters(wgpu::Backends::all()));
    let adapter = adapters.into_iter().find(|a| a.get_info().name == name).expect("an adapter");
    let (device, queue) = pollster::block_on(adapter.request_device(&wgpu::DeviceDescriptor {
        required_features: wgpu::Features::empty(),
        required_limits: wgpu::Limits::default(),
        ..Default::default()
    }))
    .expect("a device");
    Gpu::from_device(device, queue)
}

fn scene() -> Scene {
    generate::sphere_over_plane(&Default::default())
}

/// Every technique, with maps whose size is no matter here.
fn small() -> Vec<Config> {
    let mut all = catalogue();
    for config in &mut all {
        config.set_map_size(128);
    }
    all
}

/// A light for each layout of a map. The other kinds are served as a point light is.
const EACH_LAYOUT: [LightKind; 3] = [LightKind::Directional, LightKind::Spot, LightKind::Sphere];

fn stage(gpu: &Gpu, scene: &Scene, side: u32) -> Stage {
    Stage::new(gpu, scene, scene.camera_or_framing(), side, side).expect("a stage")
}

fn shoot(gpu: &Gpu, stage: &Stage, light: &Light, technique: &mut dyn Technique) -> Vec<f32> {
    stage.shoot(gpu, light, technique, 0).expect("a shot").visibility
}

#[test]
fn every_technique_runs_on_a_callers_device_with_default_limits_and_no_features() {
    let (own, guest) = (gpu(), callers_device());
    let scene = scene();
    let (at_home, abroad) = (stage(&own, &scene, 96), stage(&guest, &scene, 96));
    for (turn, kind) in EACH_LAYOUT.into_iter().enumerate() {
        let light = scene.place_light(kind);
        for config in one_in(3, turn, small()) {
            let mut here = config.build(&own).expect("a valid config");
            let mut there = config.build(&guest).expect("a valid config");
            let expected = shoot(&own, &at_home, &light, here.as_mut());
            let found = shoot(&guest, &abroad, &light, there.as_mut());
            assert!(found == expected, "{config:?}, {kind:?}: another answer on a bare device");
        }
    }
    assert_eq!(own.check(), Ok(()), "errors on the own device");
}

/// Whether the technique draws a shadow map: then its size can be set.
fn has_map(config: &Config) -> bool {
    let mut other = config.clone();
    other.set_map_size(77);
    other != *config
}

#[test]
fn maps_of_one_or_two_texels_give_finite_visibility() {
    let gpu = gpu();
    let scene = scene();
    let stage = stage(&gpu, &scene, 64);
    for size in [1, 2, 3] {
        for (turn, kind) in EACH_LAYOUT.into_iter().enumerate() {
            let light = scene.place_light(kind);
            for mut config in one_in(3, turn, catalogue()) {
                config.set_map_size(size);
                let mut technique = config.build(&gpu).expect("a valid size");
                let visibility = shoot(&gpu, &stage, &light, technique.as_mut());
                let fine = visibility.iter().all(|v| (0.0..=1.0).contains(v));
                assert!(fine, "{config:?}, {kind:?}: visibility out of range");
            }
        }
    }
    assert_eq!(gpu.check(), Ok(()), "errors on the device");
}

#[test]
fn unusable_settings_are_refused_with_a_fix() {
    let gpu = gpu();
    let limit = gpu.device.limits().max_texture_dimension_2d;
    for mut config in catalogue().into_iter().filter(has_map) {
        let mut build = |size| {
            config.set_map_size(size);
            config.build(&gpu).map(|_| ())
        };
        let none = build(0);
        assert!(matches!(none, Err(GpuError::Invalid { what: "map size", .. })), "{none:?}");
        for size in [limit + 1, u32::MAX] {
            let huge = build(size);
            let expected =
                GpuError::Limit { what: "map size", asked: size.into(), limit: limit.into() };
            assert_eq!(huge, Err(expected), "a map of {size} texels a side");
        }
    }
    for number in [f32::NAN, f32::INFINITY, -1.0] {
        let usual = Bias::default();
        for bias in [
            Bias { slope: number, ..usual },
            Bias { cone: number, ..usual },
            Bias { constant: number, ..usual },
        ] {
            let refused =
                MapTechnique::plain(&gpu, &MapConfig { size: 64, bias, ..MapConfig::default() })
                    .map(|_| ());
            assert!(matches!(refused, Err(GpuError::Invalid { .. })), "{bias:?}: {refused:?}");
        }
    }
    assert_eq!(gpu.check(), Ok(()), "nothing reached wgpu");
}

#[test]
fn unusable_lights_and_unprepared_frames_are_refused_with_a_fix() {
    let gpu = gpu();
    let scene = scene();
    let stage = stage(&gpu, &scene, 8);
    let up = DVec3::Y * 5.0;
    let unusable = [
        Light::Directional { direction: DVec3::ZERO, angular_diameter: 0.0 },
        Light::Directional { direction: DVec3::NAN, angular_diameter: 0.0 },
        Light::Point { position: DVec3::INFINITY },
        Light::Spot { position: up, direction: DVec3::NEG_Y, outer_angle: 2.0 },
        Light::Sphere { center: DVec3::NAN, radius: 1.0 },
    ];
    let usual = scene.place_light(LightKind::Point);
    let target = stage.samples.visibility_target(&gpu).expect("a target");
    let view = target.create_view(&Default::default());
    for config in small() {
        let mut technique = config.build(&gpu).expect("a valid config");
        submit(&gpu, |recorder| {
            let refused = technique.encode(&gpu, &stage.frame(&usual), recorder, &view);
            let named = matches!(refused, Err(GpuError::Invalid { what: "frame", .. }));
            assert!(named, "{config:?}, not prepared: {refused:?}");
        });
        for light in &unusable {
            let refused = technique.prepare(&gpu, &stage.frame(light));
            assert!(matches!(refused, Err(GpuError::Invalid { .. })), "{light:?}: {refused:?}");
        }
        // And the technique recovers.
        let visibility = shoot(&gpu, &stage, &usual, technique.as_mut());
        assert_eq!(visibility.len(), 64, "{config:?}: a frame after the refused ones");
    }
}

#[test]
fn view_samples_of_a_wrong_size_are_refused() {
    let gpu = gpu();
    for (width, height) in [(0, 4), (4, 0), (0, 0)] {
        let refused = ViewSamples::new(&gpu, width, height).map(|_| ());
        assert!(matches!(refused, Err(GpuError::Invalid { .. })), "{width}x{height}: {refused:?}");
    }
    let beyond = gpu.device.limits().max_texture_dimension_2d + 1;
    let refused = ViewSamples::new(&gpu, beyond, 1).map(|_| ());
    assert!(matches!(refused, Err(GpuError::Limit { .. })), "{beyond} wide: {refused:?}");
    let samples = ViewSamples::new(&gpu, 2, 2).expect("a valid size");
    for (positions, normals) in [(3, 4), (4, 3), (0, 0), (5, 5)] {
        let refused = samples.write(&gpu, &vec![Vec3::ZERO; positions], &vec![Vec3::Y; normals]);
        let named = matches!(refused, Err(GpuError::Invalid { .. }));
        assert!(named, "{positions} positions, {normals} normals: {refused:?}");
    }
    assert_eq!(gpu.check(), Ok(()), "nothing reached wgpu");
}

#[test]
fn textures_beyond_a_limit_are_refused_before_they_are_asked_for() {
    let gpu = callers_device();
    let limits = gpu.device.limits();
    let descriptor = |width, layers| wgpu::TextureDescriptor {
        label: None,
        size: wgpu::Extent3d { width, height: 1, depth_or_array_layers: layers },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: wgpu::TextureFormat::R8Unorm,
        usage: wgpu::TextureUsages::TEXTURE_BINDING,
        view_formats: &[],
    };
    let (side, layers) = (limits.max_texture_dimension_2d, limits.max_texture_array_layers);
    assert!(gpu.create_texture("test", &descriptor(side, 1)).is_ok(), "the limit itself");
    for (width, count) in [(side + 1, 1), (1, layers + 1), (u32::MAX, u32::MAX)] {
        let refused = gpu.create_texture("test", &descriptor(width, count)).map(|_| ());
        let named = matches!(refused, Err(GpuError::Limit { .. }));
        assert!(named, "{width} wide, {count} layers: {refused:?}");
    }
    // The largest map of six layers that this device's limits allow; it is not allocated before a frame.
    let map = MapConfig { size: side, ..MapConfig::default() };
    assert!(MapTechnique::plain(&gpu, &map).is_ok(), "a map of the largest size");
}

#[test]
fn an_unknown_adapter_is_an_error_that_lists_those_there_are() {
    let there = gpu().info.name;
    let options = GpuOptions { adapter: Some("no adapter is called so".to_owned()) };
    let error = Gpu::new(&options).expect_err("there is no such adapter");
    let text = error.to_string();
    assert!(text.contains("no adapter is called so") && text.contains(&there), "{text}");
    assert!(text.contains("mesa-vulkan-drivers"), "the fix: {text}");
}

#[test]
fn a_camera_that_cannot_be_inverted_is_refused() {
    let gpu = gpu();
    let samples = ViewSamples::new(&gpu, 4, 4).expect("a valid size");
    let pass = DepthSamples::new(&gpu).expect("the pass");
    let depth = texture(&gpu, wgpu::TextureFormat::Depth32Float, 4, 1);
    let depth = depth.create_view(&Default::default());
    for clip in [DMat4::ZERO, DMat4::NAN] {
        let view = ViewCamera { clip, eye: DVec3::ZERO };
        let camera = DepthCamera { view, background: 0.0 };
        submit(&gpu, |recorder| {
            let refused = pass.encode(&gpu, recorder, &camera, &depth, None, &samples);
            assert!(matches!(refused, Err(GpuError::Invalid { .. })), "{clip}: {refused:?}");
        });
    }
}

#[test]
fn a_wrong_number_of_views_is_refused() {
    let gpu = gpu();
    let estimator = Estimator::nearest();
    let convention = DepthConvention::REVERSED_F32;
    for (layout, count) in [(Layout::single(), 6), (Layout::cube(), 1), (Layout::cube(), 0)] {
        let resolve = Resolve::new(&gpu, &layout, &estimator, convention).expect("it links");
        let refused = resolve.set_views(&gpu, &vec![ShadowView::empty(DVec4::Y); count]);
        assert!(matches!(refused, Err(GpuError::Invalid { .. })), "{layout:?}, {count}");
    }
}

#[test]
fn meshes_that_are_beyond_a_buffer_are_refused() {
    // Default limits: 128 MiB a storage buffer, 11.2 million vertices.
    let gpu = callers_device();
    let limit = gpu.device.limits().max_storage_buffer_binding_size;
    let triangles = Triangles {
        positions: vec![Vec3::ZERO; (limit / 12 + 1) as usize],
        ..Triangles::default()
    };
    let refused = MeshSet::from_triangles(&gpu, &triangles).map(|_| ());
    assert!(matches!(refused, Err(GpuError::Limit { .. })), "{refused:?}");
}

#[test]
fn vertices_that_are_not_finite_are_refused_with_a_fix() {
    let gpu = gpu();
    let whole = scene().triangles(DVec3::ZERO).expect("a valid scene");
    assert!(MeshSet::from_triangles(&gpu, &whole).is_ok(), "the scene as it is");
    for number in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        let mut triangles = whole.clone();
        triangles.positions[3].y = number;
        let refused = MeshSet::from_triangles(&gpu, &triangles).map(|_| ());
        let named = matches!(refused, Err(GpuError::Invalid { what: "vertex position", .. }));
        assert!(named, "{number}: {refused:?}");
        let mut scene = scene();
        scene.meshes[0].positions[0].x = number;
        let refused = MeshSet::new(&gpu, &scene).map(|_| ());
        assert!(matches!(refused, Err(GpuError::Invalid { .. })), "{number}: {refused:?}");
    }
    let mut triangles = whole;
    triangles.triangles[0][1] = triangles.positions.len() as u32;
    let refused = MeshSet::from_triangles(&gpu, &triangles).map(|_| ());
    assert!(matches!(refused, Err(GpuError::Invalid { what: "vertex index", .. })), "{refused:?}");
    assert_eq!(gpu.check(), Ok(()), "nothing reached wgpu");
}

//! The library as a guest: on a caller's device, with a caller's depth, in a caller's shader; and what it says
//! to a caller's mistakes.

use antumbra::{Config, catalogue};
use antumbra_filter::{PcfCastano, PcfGrid, PcfHardware};
use antumbra_gpu::{
    DepthCamera, DepthSamples, Expectation, Frame, Gpu, GpuError, GpuOptions, MeshSet, Recorder,
    Technique, ViewCamera, ViewSamples, bind, read_f32_texture,
};
use antumbra_map::{
    Bias, DepthConvention, Estimator, FittedView, Layout, MapConfig, MapRead, MapTechnique,
    Resolve, ShadowView,
};
use antumbra_measure::Stage;
use antumbra_scene::{Light, LightKind, Scene, Triangles, generate};
use antumbra_shaders::{link_functions, source};
use antumbra_tests::gpu;
use glam::{DMat4, DVec2, DVec3, DVec4, Vec3};

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

/// A light for each layout of a map. The other kinds are served as a point light is.
const EACH_LAYOUT: [LightKind; 3] = [LightKind::Directional, LightKind::Spot, LightKind::Sphere];

fn stage(gpu: &Gpu, scene: &Scene, side: u32) -> Stage {
    Stage::new(gpu, scene, scene.camera_or_framing(), side, side).expect("a stage")
}

fn shoot(gpu: &Gpu, stage: &Stage, light: &Light, technique: &mut dyn Technique) -> Vec<f32> {
    stage.shoot(gpu, light, technique, 0).expect("a shot").visibility
}

fn submit(gpu: &Gpu, record: impl FnOnce(&mut Recorder<'_>)) {
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    record(&mut Recorder::new(&mut encoder));
    gpu.queue.submit([encoder.finish()]);
}

#[test]
fn every_technique_runs_on_a_callers_device_with_default_limits_and_no_features() {
    let (own, guest) = (gpu(), callers_device());
    let scene = scene();
    let (at_home, abroad) = (stage(&own, &scene, 96), stage(&guest, &scene, 96));
    for kind in EACH_LAYOUT {
        let light = scene.place_light(kind);
        for config in catalogue() {
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
        for kind in EACH_LAYOUT {
            let light = scene.place_light(kind);
            for mut config in catalogue() {
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
fn unusable_lights_are_refused_with_a_fix() {
    let gpu = gpu();
    let scene = scene();
    let stage = stage(&gpu, &scene, 8);
    let up = DVec3::Y * 5.0;
    for light in [
        Light::Directional { direction: DVec3::ZERO, angular_diameter: 0.0 },
        Light::Directional { direction: DVec3::NAN, angular_diameter: 0.0 },
        Light::Point { position: DVec3::INFINITY },
        Light::Spot { position: up, direction: DVec3::NEG_Y, outer_angle: 2.0 },
        Light::Sphere { center: DVec3::NAN, radius: 1.0 },
    ] {
        for config in catalogue() {
            let mut technique = config.build(&gpu).expect("a valid config");
            let refused = technique.prepare(&gpu, &stage.frame(&light));
            assert!(matches!(refused, Err(GpuError::Invalid { .. })), "{light:?}: {refused:?}");
        }
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
fn an_unprepared_frame_is_refused() {
    let gpu = gpu();
    let scene = scene();
    let stage = stage(&gpu, &scene, 8);
    let light = scene.place_light(LightKind::Point);
    let target = stage.samples.visibility_target(&gpu).expect("a target");
    let view = target.create_view(&Default::default());
    for config in catalogue() {
        let mut technique = config.build(&gpu).expect("a valid config");
        submit(&gpu, |recorder| {
            let refused = technique.encode(&gpu, &stage.frame(&light), recorder, &view);
            let named = matches!(refused, Err(GpuError::Invalid { what: "frame", .. }));
            assert!(named, "{config:?}: {refused:?}");
        });
        // And the technique recovers.
        let visibility = shoot(&gpu, &stage, &light, technique.as_mut());
        assert_eq!(visibility.len(), 64, "{config:?}: a frame after the refused one");
    }
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

/// A texture to draw into and to read from.
fn texture(gpu: &Gpu, format: wgpu::TextureFormat, side: u32, layers: u32) -> wgpu::Texture {
    gpu.device.create_texture(&wgpu::TextureDescriptor {
        label: Some("the caller's"),
        size: wgpu::Extent3d { width: side, height: side, depth_or_array_layers: layers },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage: wgpu::TextureUsages::RENDER_ATTACHMENT
            | wgpu::TextureUsages::TEXTURE_BINDING
            | wgpu::TextureUsages::COPY_SRC,
        view_formats: &[],
    })
}

/// An engine's own shadow map: forward depth, `LessEqual`, cleared to 1.
fn draw_forward_map(
    gpu: &Gpu,
    triangles: &Triangles,
    clips: &[DMat4],
    format: wgpu::TextureFormat,
    side: u32,
) -> wgpu::Texture {
    const SHADER: &str = "
        @group(0) @binding(0) var<uniform> clip: mat4x4f;
        @vertex fn main(@location(0) p: vec3f) -> @builtin(position) vec4f {
            return clip * vec4f(p, 1.0);
        }";
    let module = gpu.shader("engine", SHADER.to_owned());
    let pipeline = gpu.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some("engine"),
        layout: None,
        vertex: wgpu::VertexState {
            module: &module,
            entry_point: Some("main"),
            compilation_options: Default::default(),
            buffers: &[Some(wgpu::VertexBufferLayout {
                array_stride: 12,
                step_mode: wgpu::VertexStepMode::Vertex,
                attributes: &wgpu::vertex_attr_array![0 => Float32x3],
            })],
        },
        primitive: wgpu::PrimitiveState::default(),
        depth_stencil: Some(wgpu::DepthStencilState {
            format,
            depth_write_enabled: Some(true),
            depth_compare: Some(wgpu::CompareFunction::LessEqual),
            stencil: Default::default(),
            bias: Default::default(),
        }),
        multisample: Default::default(),
        fragment: None,
        multiview_mask: None,
        cache: None,
    });
    let positions = bytemuck::cast_slice(&triangles.positions);
    let positions = gpu.buffer("positions", positions, wgpu::BufferUsages::VERTEX);
    let indices: &[u32] = triangles.triangles.as_flattened();
    let index_buffer =
        gpu.buffer("indices", bytemuck::cast_slice(indices), wgpu::BufferUsages::INDEX);
    let map = texture(gpu, format, side, clips.len() as u32);
    for (layer, clip) in clips.iter().enumerate() {
        let matrix = clip.as_mat4();
        let uniform = gpu.buffer("clip", bytemuck::bytes_of(&matrix), wgpu::BufferUsages::UNIFORM);
        let group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: None,
            layout: &pipeline.get_bind_group_layout(0),
            entries: &[bind::buffer(0, &uniform)],
        });
        let view = map.create_view(&wgpu::TextureViewDescriptor {
            dimension: Some(wgpu::TextureViewDimension::D2),
            base_array_layer: layer as u32,
            array_layer_count: Some(1),
            ..Default::default()
        });
        submit(gpu, |recorder| {
            let mut pass = recorder.depth_pass("engine", &view, 1.0);
            pass.set_pipeline(&pipeline);
            pass.set_bind_group(0, &group, &[]);
            pass.set_vertex_buffer(0, positions.slice(..));
            pass.set_index_buffer(index_buffer.slice(..), wgpu::IndexFormat::Uint32);
            pass.draw_indexed(0..indices.len() as u32, 0, 0..1);
        });
    }
    map
}

/// The same projection with forward depth: z becomes w - z.
fn forward(clip: &DMat4) -> DMat4 {
    let flip = DMat4::from_cols(DVec4::X, DVec4::Y, DVec4::NEG_Z, DVec4::new(0.0, 0.0, 1.0, 1.0));
    flip * *clip
}

/// Views as an engine describes its own map, layer by layer.
fn shadow_views(
    views: &[FittedView],
    convention: DepthConvention,
    estimator: &Estimator,
) -> Vec<ShadowView> {
    let mut layer = 0;
    let mut describe = |view: &FittedView| {
        let Some(clip) = view.clip else { return ShadowView::empty(view.light) };
        let clip = if convention.reversed { clip } else { forward(&clip) };
        layer += 1;
        ShadowView::new(&clip, view.light, layer - 1, convention, &Bias::default(), estimator)
    };
    views.iter().map(&mut describe).collect()
}

fn whole(texture: &wgpu::Texture) -> wgpu::TextureView {
    texture.create_view(&wgpu::TextureViewDescriptor {
        dimension: Some(wgpu::TextureViewDimension::D2Array),
        ..Default::default()
    })
}

#[test]
fn a_forward_depth_map_of_the_callers_gives_the_same_shadows() {
    const SIDE: u32 = 512;
    let gpu = gpu();
    let scene = scene();
    let mut stage = stage(&gpu, &scene, 128);
    // Both maps hold everything.
    stage.meshes.set_culling(false);
    let map = MapConfig { size: SIDE, ..MapConfig::default() };
    let estimators = [
        Estimator::nearest(),
        PcfGrid::default().estimator().expect("valid"),
        PcfHardware::default().estimator(),
    ];
    let f32_forward = DepthConvention { reversed: false, step: f32::EPSILON * 0.5 };
    let u16_forward = DepthConvention { reversed: false, step: 1.0 / 65536.0 };
    let (float, short) = (wgpu::TextureFormat::Depth32Float, wgpu::TextureFormat::Depth16Unorm);
    // Of 16384 pixels, how many may differ by more than 1/256: f32 rounds elsewhere near 1 than near 0, and a
    // step of 2^-16 over the 28 m of depth that the floor takes is 0.4 mm of bias where the sphere's shadow
    // begins. On Mesa's software device none does.
    for (kind, format, convention, allowed) in [
        (LightKind::Directional, float, f32_forward, 4),
        (LightKind::Spot, float, f32_forward, 4),
        (LightKind::Point, float, f32_forward, 4),
        (LightKind::Directional, short, u16_forward, 16),
    ] {
        let light = scene.place_light(kind);
        for estimator in &estimators {
            let mut technique =
                MapTechnique::new(&gpu, &map, estimator.clone()).expect("a valid config");
            let expected = shoot(&gpu, &stage, &light, &mut technique);
            let views = technique.map().views();
            let clips: Vec<DMat4> =
                views.iter().filter_map(|v| v.clip.as_ref()).map(forward).collect();
            let theirs = draw_forward_map(&gpu, &stage.triangles, &clips, format, SIDE);

            let layout = Layout::of(&light);
            let mut resolve = Resolve::new(&gpu, &layout, estimator, convention).expect("it links");
            resolve.set_views(&gpu, &shadow_views(views, convention, estimator)).expect("views");
            let target = stage.samples.visibility_target(&gpu).expect("a target");
            let view = target.create_view(&Default::default());
            submit(&gpu, |recorder| {
                resolve.encode(&gpu, recorder, &stage.samples, &whole(&theirs), &view);
            });
            let found = read_f32_texture(&gpu, &target, 0).expect("read back");
            let differ =
                found.iter().zip(&expected).filter(|(a, b)| (*a - *b).abs() > 1.0 / 256.0).count();
            let dark = expected.iter().filter(|v| **v == 0.0).count();
            assert!(dark > 100, "{kind:?}: {dark} samples in shadow");
            assert!(differ <= allowed, "{kind:?}, {format:?}, {estimator:?}: {differ} pixels");
            // The control: the same map taken for a reversed one.
            let mistaken = DepthConvention { reversed: true, ..convention };
            resolve.set_views(&gpu, &shadow_views(views, mistaken, estimator)).expect("views");
            submit(&gpu, |recorder| {
                resolve.encode(&gpu, recorder, &stage.samples, &whole(&theirs), &view);
            });
            let found = read_f32_texture(&gpu, &target, 0).expect("read back");
            let differ = found.iter().zip(&expected).filter(|(a, b)| a != b).count();
            assert!(differ > 100, "{kind:?}: a map of the wrong convention goes unnoticed");
        }
    }
    assert_eq!(gpu.check(), Ok(()), "errors on the device");
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

#[test]
fn lone_receivers_seen_through_a_depth_buffer_have_no_acne() {
    let gpu = gpu();
    let (mut seen, mut with_given, mut with_own) = (0, 0, 0);
    for (name, build, _) in generate::CONVEX {
        let scene = build();
        let mut stage = stage(&gpu, &scene, 192);
        stage.meshes.set_culling(false);
        for with_normals in [true, false] {
            let samples = samples_from_depth(&gpu, &scene, &stage, with_normals);
            for kind in [LightKind::Directional, LightKind::Spot, LightKind::Point] {
                let light = scene.place_light(kind);
                {
                    for mut config in
                        catalogue().into_iter().filter(has_map).filter(is_free_of_acne)
                    {
                        config.set_map_size(512);
                        let mut technique = config.build(&gpu).expect("a valid config");
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
    }
    assert_eq!(with_given, 0, "samples in false shadow with normals given");
    // A face seen 2 pixels wide lends a normal that is not its own: the facets of the sphere towards its rim.
    let rate = with_own as f64 / seen as f64;
    assert!(rate <= 5e-3, "{rate} of the samples are in false shadow with normals from depth");
}

/// Where the engine keeps the light's views.
const VIEWS: &str = "
import package::common::lookup::{ShadowView};
@group(0) @binding(2) var<storage, read> views: array<ShadowView>;
fn view_at(i: i32) -> ShadowView {
    return views[i];
}";

const FORWARD: &str = "
@group(0) @binding(0) var positions: texture_2d<f32>;
@group(0) @binding(1) var normals: texture_2d<f32>;
@group(0) @binding(3) var map: MAP;
@group(0) @binding(4) var compare: sampler_comparison;

@vertex
fn corner(@builtin(vertex_index) i: u32) -> @builtin(position) vec4f {
    return vec4f(f32(i & 1u) * 4.0 - 1.0, f32(i >> 1u) * 4.0 - 1.0, 0.5, 1.0);
}

@fragment
fn shade(@builtin(position) at: vec4f) -> @location(0) f32 {
    let pixel = vec2i(at.xy);
    let p = textureLoad(positions, pixel, 0);
    let n = textureLoad(normals, pixel, 0);
    if p.w == 0.0 {
        return 1.0;
    }
    return shadow(map, compare, view_of(p.xyz), p.xyz, n.xyz, n.w, vec2u(pixel));
}";

/// A forward renderer of the test's own: a fragment shader with the library's functions pasted in.
fn forward_render(
    gpu: &Gpu,
    stage: &Stage,
    technique: &MapTechnique,
    estimator: &Estimator,
    layout: Layout,
) -> Vec<f32> {
    let mut slots = estimator.slots.clone();
    slots.extend(layout.slots);
    slots.push(source("map::views", VIEWS));
    let library = link_functions("map::shadow", &slots, &["view_of", "shadow"]).expect("it links");
    let map_type = if estimator.read == MapRead::Comparison {
        "texture_depth_2d_array"
    } else {
        "texture_2d_array<f32>"
    };
    let shader = gpu.shader("engine", format!("{library}\n{}", FORWARD.replace("MAP", map_type)));
    let side = stage.samples.size().0;
    let target = texture(gpu, wgpu::TextureFormat::R32Float, side, 1);
    let pipeline = gpu.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some("engine"),
        layout: None,
        vertex: wgpu::VertexState {
            module: &shader,
            entry_point: Some("corner"),
            compilation_options: Default::default(),
            buffers: &[],
        },
        primitive: wgpu::PrimitiveState::default(),
        depth_stencil: None,
        multisample: Default::default(),
        fragment: Some(wgpu::FragmentState {
            module: &shader,
            entry_point: Some("shade"),
            compilation_options: Default::default(),
            targets: &[Some(target.format().into())],
        }),
        multiview_mask: None,
        cache: None,
    });
    let convention = DepthConvention::REVERSED_F32;
    let views = shadow_views(technique.map().views(), convention, estimator);
    let views = gpu.buffer("views", bytemuck::cast_slice(&views), wgpu::BufferUsages::STORAGE);
    let sampler = gpu.device.create_sampler(&wgpu::SamplerDescriptor {
        mag_filter: wgpu::FilterMode::Linear,
        min_filter: wgpu::FilterMode::Linear,
        compare: Some(convention.compare()),
        ..Default::default()
    });
    let entries = [
        bind::texture(0, &stage.samples.positions_view),
        bind::texture(1, &stage.samples.normals_view),
        bind::buffer(2, &views),
        bind::texture(3, technique.map().view().expect("a map with casters")),
        bind::sampler(4, &sampler),
    ];
    let group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: Some("engine"),
        layout: &pipeline.get_bind_group_layout(0),
        entries: &entries,
    });
    submit(gpu, |recorder| {
        let view = target.create_view(&Default::default());
        let attachment = wgpu::RenderPassColorAttachment {
            view: &view,
            depth_slice: None,
            resolve_target: None,
            ops: wgpu::Operations::default(),
        };
        let mut pass = recorder.render_pass("engine", &[Some(attachment)], None);
        pass.set_pipeline(&pipeline);
        pass.set_bind_group(0, &group, &[]);
        pass.draw(0..3, 0..1);
    });
    read_f32_texture(gpu, &target, 0).expect("read back")
}

#[test]
fn a_forward_renderer_gets_the_same_bits_from_the_shader_functions() {
    let gpu = gpu();
    let scene = scene();
    let stage = stage(&gpu, &scene, 128);
    let map = MapConfig { size: 512, ..MapConfig::default() };
    let valid = "a valid config";
    let castano = |hardware| PcfCastano { hardware, ..Default::default() }.estimator();
    let estimators = [
        Estimator::nearest(),
        PcfHardware::default().estimator(),
        PcfGrid::default().estimator().expect(valid),
        castano(false).expect(valid),
        castano(true).expect(valid),
        antumbra_filter::PcfPoisson::default().estimator().expect(valid),
    ];
    for kind in [LightKind::Directional, LightKind::Point] {
        let light = scene.place_light(kind);
        for estimator in &estimators {
            let mut technique = MapTechnique::new(&gpu, &map, estimator.clone()).expect(valid);
            let expected = shoot(&gpu, &stage, &light, &mut technique);
            let layout = Layout::of(&light);
            let found = forward_render(&gpu, &stage, &technique, estimator, layout);
            let dark = expected.iter().filter(|v| **v < 1.0).count();
            assert!(dark > 100, "{kind:?}: {dark} samples in shadow");
            let differ = found.iter().zip(&expected).filter(|(a, b)| a.to_bits() != b.to_bits());
            assert_eq!(differ.count(), 0, "{kind:?}, {estimator:?}: fragments differ from compute");
        }
    }
    assert_eq!(gpu.check(), Ok(()), "errors on the device");
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

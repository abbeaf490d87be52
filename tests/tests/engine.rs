//! The library as a guest in an engine: with the engine's depth map, and in its shader.

use antumbra_filter::{PcfCastano, PcfGrid, PcfHardware};
use antumbra_gpu::{Gpu, Technique, bind, entries, read_f32_texture};
use antumbra_map::{
    Bias, DepthConvention, Estimator, FittedView, Layout, MapConfig, MapRead, MapTechnique,
    Resolve, ShadowView,
};
use antumbra_measure::Stage;
use antumbra_scene::{Light, LightKind, Scene, Triangles, generate};
use antumbra_shaders::{link_functions, source};
use antumbra_tests::{gpu, submit, texture};
use glam::{DMat4, DVec4};
fn scene() -> Scene {
    generate::sphere_over_plane(&Default::default())
}

fn stage(gpu: &Gpu, scene: &Scene, side: u32) -> Stage {
    Stage::new(gpu, scene, scene.camera_or_framing(), side, side).expect("a stage")
}

fn shoot(gpu: &Gpu, stage: &Stage, light: &Light, technique: &mut dyn Technique) -> Vec<f32> {
    stage.shoot(gpu, light, technique, 0).expect("a shot").visibility
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
        PcfHardware { comparison: true, ..Default::default() }.estimator(),
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
@group(0) @binding(4) var filtering: SAMPLER;

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
    return shadow(map, filtering, view_of(p.xyz), p.xyz, n.xyz, n.w, vec2u(pixel));
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
    let convention = DepthConvention::REVERSED_F32;
    const FS: wgpu::ShaderStages = wgpu::ShaderStages::FRAGMENT;
    let (map, map_entry) = match estimator.read {
        MapRead::Comparison => ("texture_depth_2d_array", entries::depth_array(3, FS)),
        _ => ("texture_2d_array<f32>", entries::texels(3, FS, true)),
    };
    let (sampler, sampler_entry, filter, compare) = match estimator.read {
        MapRead::Gathered => {
            ("sampler", entries::nearest_sampler(4, FS), wgpu::FilterMode::Nearest, None)
        }
        _ => {
            let (entry, compare) = (entries::comparison_sampler(4, FS), convention.compare());
            ("sampler_comparison", entry, wgpu::FilterMode::Linear, Some(compare))
        }
    };
    let main = FORWARD.replace("MAP", map).replace("SAMPLER", sampler);
    let shader = gpu.shader("engine", format!("{library}\n{main}"));
    let side = stage.samples.size().0;
    let target = texture(gpu, wgpu::TextureFormat::R32Float, side, 1);
    let group_layout = gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: Some("engine"),
        entries: &[
            entries::texels(0, FS, false),
            entries::texels(1, FS, false),
            entries::storage(2, FS),
            map_entry,
            sampler_entry,
        ],
    });
    let pipeline = gpu.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some("engine"),
        layout: Some(&gpu.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some("engine"),
            bind_group_layouts: &[Some(&group_layout)],
            immediate_size: 0,
        })),
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
    let views = shadow_views(technique.map().views(), convention, estimator);
    let views = gpu.buffer("views", bytemuck::cast_slice(&views), wgpu::BufferUsages::STORAGE);
    let sampler = gpu.device.create_sampler(&wgpu::SamplerDescriptor {
        mag_filter: filter,
        min_filter: filter,
        compare,
        ..Default::default()
    });
    let bound = [
        bind::texture(0, &stage.samples.positions_view),
        bind::texture(1, &stage.samples.normals_view),
        bind::buffer(2, &views),
        bind::texture(3, technique.map().view().expect("a map with casters")),
        bind::sampler(4, &sampler),
    ];
    let group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: Some("engine"),
        layout: &group_layout,
        entries: &bound,
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
        PcfHardware { comparison: true, ..Default::default() }.estimator(),
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

//! Layouts for lights that shine all around, each under every estimator: right where the cube is, seamless, and
//! what is particular to charts.

#[path = "omni/room.rs"]
mod room;
#[path = "omni/seams.rs"]
mod seams;

use antumbra::Config;
use antumbra_filter::{PcfBilinearGrid, PcfCastano, PcfGrid, PcfHardware, PcfPoisson};
use antumbra_gpu::{
    CasterTriangles, Casters, Counters, Drawn, Frame, Gpu, GpuError, LightView, MeshSet, Recorder,
    Technique, bind, light_view_layout, read_buffer, read_f32_texture,
};
use antumbra_map::twin::chart::{Chart, Isocube, Paraboloid};
use antumbra_map::{
    Arrange as _, Bias, DepthConvention, Estimator, Fitting, Layout, MapConfig, MapTechnique, Omni,
    Plain, ShadowView,
};
use antumbra_measure::Stage;
use antumbra_measure::stability::Case;
use antumbra_reference::{SampleClass, Truth, TruthOptions, ViewSample};
use antumbra_scene::{Light, LightKind, Scene, generate};
use antumbra_tests::{gpu, one_in};
use glam::{DAffine3, DVec2, DVec3, Vec3, Vec4};

/// The layouts whose edges are where they belong.
const EXACT: [Omni; 4] = [Omni::Cube, Omni::Tetrahedron, Omni::Isocube, Omni::DualParaboloid];

/// Every estimator over `omni`.
fn estimators(omni: Omni, size: u32) -> Vec<Config> {
    let map = MapConfig { size, omni, ..MapConfig::default() };
    let castano = |side, hardware| Config::PcfCastano(PcfCastano { map, side, hardware });
    vec![
        Config::Plain(Plain { map }),
        Config::PcfHardware(PcfHardware { map, ..Default::default() }),
        Config::PcfGrid(PcfGrid { map, side: 7 }),
        Config::PcfGrid(PcfGrid { map, side: 2 }),
        Config::PcfBilinearGrid(PcfBilinearGrid { map, side: 3 }),
        castano(5, false),
        castano(7, true),
        Config::PcfPoisson(PcfPoisson { map, ..PcfPoisson::default() }),
    ]
}

fn shoot(gpu: &Gpu, stage: &Stage, light: &Light, config: &Config) -> Vec<f32> {
    let mut technique = config.build(gpu).expect("a valid config");
    stage.shoot(gpu, light, technique.as_mut(), 0).expect("a shot").visibility
}

/// A closed room of 10 m about a light at 0, and in it bodies on all sides.
fn room() -> Scene {
    let mut scene = Scene { name: "room".to_owned(), ..Scene::default() };
    scene.add(generate::shapes::cuboid(DVec3::splat(-5.0), DVec3::splat(5.0)), DAffine3::IDENTITY);
    for (i, direction) in directions(60).enumerate() {
        let center = direction * (2.0 + 0.02 * i as f64);
        let half = DVec3::splat(0.15);
        let turn = DAffine3::from_translation(center) * DAffine3::from_rotation_y(i as f64);
        scene.add(generate::shapes::cuboid(-half, half), turn);
    }
    scene
}

/// Directions spread evenly (Fibonacci's lattice).
fn directions(count: usize) -> impl Iterator<Item = DVec3> {
    (0..count).map(move |i| {
        let y = 1.0 - (2.0 * i as f64 + 1.0) / count as f64;
        let turn = i as f64 * std::f64::consts::PI * (5f64.sqrt() - 1.0);
        let level = (1.0 - y * y).sqrt();
        DVec3::new(level * turn.cos(), y, level * turn.sin())
    })
}

/// Where the ray along `direction` from the light at 0 meets the room, and the wall's normal.
fn on_wall(direction: DVec3) -> ViewSample {
    let a = direction.abs();
    let position = direction * (5.0 / a.max_element());
    let normal = if a.x >= a.y && a.x >= a.z {
        -direction.x.signum() * DVec3::X
    } else if a.y >= a.z {
        -direction.y.signum() * DVec3::Y
    } else {
        -direction.z.signum() * DVec3::Z
    };
    ViewSample { position: position.as_vec3(), normal: normal.as_vec3() }
}

/// Samples all over the walls of [`room`], and which of them lie farther than `margin`, in radians as seen from the
/// light, from where the truth changes and from the next wall: towards the room's corners the crease between two
/// walls is steeper, as the light sees it, than the bias cone, whatever the layout.
fn walls(gpu: &Gpu, margin: f64) -> (Stage, Truth, Vec<bool>) {
    // A right-angled corner that comes within 0.025 spans 0.02 of the circle of 0.035: two of these points.
    const RING: usize = 24;
    let scene = room();
    let middles: Vec<DVec3> = directions(4000).collect();
    let samples: Vec<ViewSample> = middles
        .iter()
        .flat_map(|d| {
            let (u, v) = d.any_orthonormal_pair();
            let ring = (0..RING).map(move |k| {
                let (sin, cos) = (k as f64 * std::f64::consts::TAU / RING as f64).sin_cos();
                on_wall((*d + margin * (cos * u + sin * v)).normalize())
            });
            std::iter::once(on_wall(*d)).chain(ring)
        })
        .collect();
    let stage = Stage::at_points(gpu, &scene, &samples).expect("a stage");
    let light = Light::Point { position: DVec3::ZERO };
    let truth = stage.truth(&light, &TruthOptions::default());
    let clear = (0..samples.len())
        .map(|i| {
            let ring = i / (RING + 1) * (RING + 1);
            i == ring
                && truth.class[i] == SampleClass::Counted
                && (ring..=ring + RING).all(|j| {
                    truth.visibility[j] == truth.visibility[i]
                        && samples[j].normal == samples[i].normal
                })
        })
        .collect();
    (stage, truth, clear)
}

#[test]
fn every_estimator_over_every_layout_is_right_away_from_shadow_edges() {
    let gpu = gpu();
    // The widest kernel reaches 4 texels an axis, and a paraboloid's texel is up to 4 / 1024 wide, a tetrahedron's
    // 6.2 / 1024 across: 0.034.
    let (stage, truth, clear) = walls(&gpu, 0.035);
    let light = Light::Point { position: DVec3::ZERO };
    let count = |v: f32| (0..clear.len()).filter(|&i| clear[i] && truth.visibility[i] == v).count();
    assert!(count(0.0) > 100 && count(1.0) > 1500, "{} dark, {} lit", count(0.0), count(1.0));
    let wrong = |visibility: &[f32]| {
        (0..clear.len())
            .filter(|&i| clear[i] && (visibility[i] - truth.visibility[i]).abs() > 1e-6)
            .count()
    };
    for omni in EXACT {
        for config in estimators(omni, 1024) {
            let visibility = shoot(&gpu, &stage, &light, &config);
            assert_eq!(wrong(&visibility), 0, "{config:?}: wrong samples");
        }
    }
    // The control: a light 70 cm aside.
    let aside = light.translated(DVec3::splat(0.4));
    for omni in EXACT {
        let moved = shoot(&gpu, &stage, &aside, &estimators(omni, 1024)[0]);
        assert!(wrong(&moved) > 50, "{omni:?}: another light's shadows pass: {}", wrong(&moved));
    }
    assert_eq!(gpu.check(), Ok(()), "errors on the device");
}

#[test]
fn lone_receivers_have_no_false_shadow_in_any_layout() {
    let gpu = gpu();
    let case = Case::by_name("lone receivers, point").expect("a case of that name");
    for omni in EXACT {
        for (size, few) in [(128, false), (1024, true)] {
            let all = estimators(omni, size);
            let some = if few { 3 } else { all.len() };
            for config in all.into_iter().take(some) {
                let mut technique = config.build(&gpu).expect("a valid config");
                let rate = case.measure(&gpu, technique.as_mut(), size).expect("measured");
                assert_eq!(rate, 0.0, "{config:?}: false shadow");
            }
        }
    }
}

#[test]
fn tiny_maps_give_finite_visibility_in_every_layout() {
    let gpu = gpu();
    let scene = generate::sphere_over_plane(&Default::default());
    let stage = Stage::new(&gpu, &scene, scene.camera_or_framing(), 64, 64).expect("a stage");
    let light = scene.place_light(LightKind::Point);
    for omni in Omni::ALL {
        for size in [1, 2, 8] {
            for config in estimators(omni, size).into_iter().take(3) {
                let visibility = shoot(&gpu, &stage, &light, &config);
                let fine = visibility.iter().all(|v| (0.0..=1.0).contains(v));
                assert!(fine, "{config:?}: visibility out of range");
            }
        }
    }
    assert_eq!(gpu.check(), Ok(()), "errors on the device");
}

/// Casters that keep their triangles to themselves.
struct Shy<'a>(&'a MeshSet);

impl Casters for Shy<'_> {
    fn hull(&self, light: &Light, visit: &mut dyn FnMut(DVec3)) {
        self.0.hull(light, visit);
    }

    fn draw(&self, view: &LightView<'_>, pass: &mut wgpu::RenderPass<'_>) -> Drawn {
        self.0.draw(view, pass)
    }

    fn triangles(&self) -> Option<CasterTriangles<'_>> {
        None
    }
}

#[test]
fn charts_refuse_casters_without_triangles_and_say_what_to_do() {
    let gpu = gpu();
    let scene = generate::sphere_over_plane(&Default::default());
    let stage = Stage::new(&gpu, &scene, scene.camera_or_framing(), 16, 16).expect("a stage");
    let (point, spot) = (scene.place_light(LightKind::Point), scene.place_light(LightKind::Spot));
    let shy = Shy(&stage.meshes);
    for omni in Omni::ALL {
        let map = MapConfig { size: 64, omni, ..MapConfig::default() };
        let mut technique = MapTechnique::plain(&gpu, &map).expect("a valid config");
        let charts = !matches!(omni, Omni::Cube | Omni::Tetrahedron);
        let refused = technique.prepare(&gpu, &Frame { casters: &shy, ..stage.frame(&point) });
        assert_eq!(matches!(refused, Err(GpuError::Invalid { .. })), charts, "{refused:?}");
        // One view needs none, and what was refused may be given later.
        let single = technique.prepare(&gpu, &Frame { casters: &shy, ..stage.frame(&spot) });
        assert_eq!(single, Ok(()), "{omni:?}: a spot light");
        assert_eq!(technique.prepare(&gpu, &stage.frame(&point)), Ok(()), "{omni:?}: recovers");
    }
}

#[test]
fn a_steady_frame_allocates_nothing_and_views_without_casters_have_no_layer() {
    let gpu = gpu();
    let scene = generate::sphere_over_plane(&Default::default());
    let stage = Stage::new(&gpu, &scene, scene.camera_or_framing(), 32, 32).expect("a stage");
    // High above: all casters are below it.
    let light = Light::Point { position: DVec3::new(0.3, 30.0, 0.2) };
    for (omni, most) in [
        (Omni::Tetrahedron, 2),
        (Omni::Isocube, 1),
        (Omni::DualParaboloid, 1),
        (Omni::WarpedParaboloid, 1),
    ] {
        let map = MapConfig { size: 256, omni, ..MapConfig::default() };
        let mut technique = MapTechnique::plain(&gpu, &map).expect("a valid config");
        stage.shoot(&gpu, &light, &mut technique, 0).expect("a shot");
        let (bytes, texture) = (technique.bytes(), technique.map().texture().cloned());
        let layers = texture.as_ref().map_or(0, wgpu::Texture::depth_or_array_layers);
        assert!((1..=most).contains(&layers), "{omni:?}: {layers} layers");
        let counters = technique.counters();
        assert_eq!(counters["map_passes"], u64::from(layers), "{omni:?}: passes");
        stage.shoot(&gpu, &light, &mut technique, 0).expect("a shot");
        assert_eq!(technique.bytes(), bytes, "{omni:?}: bytes");
        assert_eq!(technique.map().texture(), texture.as_ref(), "{omni:?}: the texture");
    }
}

/// The hard cases of point lights.
const CASES_AROUND: [&str; 8] = [
    "HC-01 A, point light",
    "HC-02 light amid the caster",
    "HC-11 seams of a cube",
    "HC-11 seams of a tetrahedron",
    "HC-11 seams of an isocube",
    "HC-11 seams of a paraboloid",
    "HC-12 two triangles below the light",
    "HC-14 far from the origin",
];

#[test]
fn hard_cases_of_point_lights_are_as_expected_in_every_layout() {
    let gpu = gpu();
    let size = 1024;
    let mut surprises = Vec::new();
    for (first, name) in CASES_AROUND.into_iter().enumerate() {
        let case = Case::by_name(name).unwrap_or_else(|| panic!("a case named {name}"));
        for (turn, omni) in Omni::ALL.into_iter().enumerate() {
            let three = estimators(omni, size).into_iter().take(3).collect();
            for config in one_in(3, first + turn, three) {
                let expected = config.expectation(name).expect("an expectation");
                let mut technique = config.build(&gpu).expect("a valid config");
                let measured = case.measure(&gpu, technique.as_mut(), size).expect("measured");
                if !expected.is_met_by(measured) {
                    surprises.push(format!("{name}, {config:?}: {measured}, not {expected:?}"));
                }
            }
        }
    }
    assert!(surprises.is_empty(), "not as expected:\n{}", surprises.join("\n"));
}

const CHARTS: &str = "
import package::common::lookup::{ShadowView, locate, inside};

@group(0) @binding(0) var<storage, read> view: ShadowView;
// Position and side of the map, then normal.
@group(0) @binding(1) var<storage, read> receivers: array<vec4f>;
@group(0) @binding(2) var<storage, read_write> found: array<vec4f>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3u) {
    let i = 2u * id.x;
    if i < arrayLength(&receivers) {
        let p = receivers[i];
        let at = locate(view, vec2f(p.w), p.xyz, receivers[i + 1u].xyz, 0.0);
        // The plane's depth two texels away.
        let there = depth_on_plane(at, at.texel + vec2f(2.0, -1.0));
        found[i] = vec4f(at.texel, at.depth, there);
        found[i + 1u] = vec4f(at.gradient, select(0.0, 1.0, inside(view, p.xyz)), 0.0);
    }
}";

/// What the shader says of receivers: for each, texel, depth, the plane's depth at (2, -1) texels from it, gradient
/// and whether it is inside.
fn locate(gpu: &Gpu, layout: &Layout, view: &ShadowView, receivers: &[[Vec4; 2]]) -> Vec<[f32; 8]> {
    let text = CHARTS.replace(
        "@group(0) @binding(0)",
        "import package::common::projection::{depth_on_plane};\n@group(0) @binding(0)",
    );
    let wgsl = antumbra_shaders::link_source("tests::charts", &text, &layout.slots).expect("links");
    let pipeline = gpu.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: Some("charts"),
        layout: None,
        module: &gpu.shader("charts", wgsl),
        entry_point: Some("main"),
        compilation_options: Default::default(),
        cache: None,
    });
    let storage = wgpu::BufferUsages::STORAGE;
    let view = gpu.buffer("view", bytemuck::bytes_of(view), storage);
    let given = gpu.buffer("receivers", bytemuck::cast_slice(receivers), storage);
    let zeros = vec![0u8; receivers.len() * 32];
    let found = gpu.buffer("found", &zeros, storage | wgpu::BufferUsages::COPY_SRC);
    let group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: Some("charts"),
        layout: &pipeline.get_bind_group_layout(0),
        entries: &[bind::buffer(0, &view), bind::buffer(1, &given), bind::buffer(2, &found)],
    });
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    let mut pass = encoder.begin_compute_pass(&Default::default());
    pass.set_pipeline(&pipeline);
    pass.set_bind_group(0, &group, &[]);
    pass.dispatch_workgroups((receivers.len() as u32).div_ceil(64), 1, 1);
    drop(pass);
    gpu.queue.submit([encoder.finish()]);
    let bytes = read_buffer(gpu, &found, zeros.len() as u64).expect("read back");
    bytemuck::pod_collect_to_vec(&bytes)
}

#[test]
fn charts_agree_with_their_twins_and_planes_with_rays() {
    const SIZE: u32 = 512;
    let gpu = gpu();
    let center = DVec3::new(0.3, -0.2, 0.1);
    let light = Light::Point { position: center };
    let hull: Vec<DVec3> = directions(50).map(|d| center + 4.0 * d).collect();
    let scene = generate::sphere_over_plane(&Default::default());
    let stage = Stage::new(&gpu, &scene, scene.camera_or_framing(), 8, 8).expect("a stage");
    let frame = Frame { origin: DVec3::ZERO, ..stage.frame(&light) };
    let fitting = Fitting { origin: DVec3::ZERO, size: SIZE, guard: 3, receivers: false, grid: 1 };
    // No slack: what is compared is the plane itself.
    let bias = Bias { slope: 0.0, cone: 0.0, constant: 0.0, ..Bias::default() };
    let (mut texels, mut depths, mut gradients, mut control) = (0f64, 0f64, 0f64, 0);
    for omni in [Omni::Isocube, Omni::DualParaboloid] {
        let layout = omni.layout(&light);
        let views = omni.fit(&frame, &hull, None, &fitting).expect("a valid light");
        assert_eq!(views.len(), layout.views, "as many views as the layout says");
        for (k, fitted) in views.iter().enumerate() {
            let clip = fitted.view.clip.expect("casters on all sides").as_mat4();
            let chart: &dyn Chart = match (omni, k) {
                (Omni::Isocube, 2 | 3) => &Isocube::Cap,
                (Omni::Isocube, _) => &Isocube::Belt,
                _ => &Paraboloid,
            };
            let half_width = Omni::half_width(SIZE, 3);
            let to_texel = |c: DVec2| {
                (DVec2::splat(0.5) + DVec2::new(0.5, -0.5) * c / half_width) * f64::from(SIZE)
            };
            let from_texel =
                |t: DVec2| (t / f64::from(SIZE) - 0.5) * DVec2::new(2.0, -2.0) * half_width;
            let frame_of = clip.as_dmat4();
            let local = |p: Vec3| (frame_of * p.as_dvec3().extend(1.0)).truncate();
            let near = frame_of.w_axis.w;
            let mut receivers = Vec::new();
            for (i, d) in directions(3000).enumerate() {
                let p = (center + d * (1.0 + 0.002 * i as f64)).as_vec3();
                let v = local(p);
                let c = chart.to_chart(v);
                let tilted = (-d + 0.9 * d.any_orthonormal_vector()).normalize().as_vec3();
                // What the chart holds, the paraboloid's other side left out.
                if v.z > -0.1 * v.length() && c.abs().max_element() < 0.99 {
                    receivers.push((p, tilted));
                }
            }
            assert!(receivers.len() > 300, "{omni:?}, {k}: {} receivers", receivers.len());
            let packed: Vec<[Vec4; 2]> =
                receivers.iter().map(|(p, n)| [p.extend(SIZE as f32), n.extend(0.0)]).collect();
            let convention = DepthConvention::REVERSED_F32;
            let estimator = Estimator::nearest();
            let light_at = center.extend(1.0);
            let view = ShadowView::new(&frame_of, light_at, 0, convention, &bias, &estimator);
            let found = locate(&gpu, &layout, &view, &packed);
            for ((p, n), found) in receivers.iter().zip(&found) {
                let v = local(*p);
                let n = (frame_of * n.as_dvec3().extend(0.0)).truncate();
                let depth = |q: DVec3| near * n.dot(q) / n.dot(v);
                let texel = to_texel(chart.to_chart(v));
                let [s, t, z, there, gs, gt, inside, _] = found.map(f64::from);
                assert_eq!(inside, 1.0, "{omni:?}, {k}: {p} is inside");
                texels = texels.max((DVec2::new(s, t) - texel).abs().max_element());
                let here = near / v.length();
                depths = depths.max((z - here).abs() / here);
                let at = |d: DVec2| depth(chart.direction_at(from_texel(texel + d)));
                let exact = at(DVec2::new(2.0, -1.0));
                depths = depths.max((there - exact).abs() / here);
                control += usize::from((exact - here).abs() > 1e-4 * here);
                // Off the lines on which a cap's squares have corners.
                let c = from_texel(texel);
                if !matches!(k, 2 | 3) || (c.x.abs() - c.y.abs()).abs() > 0.05 {
                    let step = 1e-3;
                    let slope = DVec2::new(
                        at(DVec2::X * step) - at(-DVec2::X * step),
                        at(DVec2::Y * step) - at(-DVec2::Y * step),
                    ) / (2.0 * step);
                    let off = (DVec2::new(gs, gt) - slope).abs().max_element();
                    gradients = gradients.max(off / (slope.length() + 1e-6 * here));
                }
            }
        }
    }
    // A texel coordinate of up to 512 is a few tens of roundings of 2^-24 of it; a relative depth some tens of
    // roundings over the cosine between ray and normal, 0.74; a gradient the quotient of such.
    assert!(texels < 64.0 * 512.0 / 16_777_216.0, "texels off by {texels}");
    assert!(depths < 64.0 / 16_777_216.0, "depths off by {depths}");
    assert!(gradients < 1e-3, "gradients off by {gradients}");
    // The control: two texels away the plane is elsewhere.
    assert!(control > 3000, "{control} planes notice two texels");
}

/// A depth pass whose map holds the distance interpolated linearly over the screen, as it is when it is written for
/// each vertex; or, `right`, interpolated as perspective asks and written for each fragment.
fn linear_depth(gpu: &Gpu, right: bool) -> wgpu::RenderPipeline {
    let kind = if right { "perspective" } else { "linear" };
    let text = format!(
        "@group(0) @binding(0) var<uniform> clip: mat4x4f;
            struct Moved {{
                @builtin(position) position: vec4f,
                @location(0) @interpolate({kind}) distance: f32,
                @location(1) @interpolate(flat) near: f32,
            }}
            @vertex fn vertex(@location(0) p: vec3f) -> Moved {{
                let c = clip * vec4f(p, 1.0);
                // Clip z is the near distance everywhere: depth is near / distance.
                return Moved(c, c.w, c.z);
            }}
            @fragment fn fragment(in: Moved) -> @builtin(frag_depth) f32 {{
                return in.near / in.distance;
            }}"
    );
    let shader = gpu.shader("linear depth", text);
    let layout = gpu.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: Some("linear depth"),
        bind_group_layouts: &[Some(&light_view_layout(&gpu.device))],
        immediate_size: 0,
    });
    gpu.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some("linear depth"),
        layout: Some(&layout),
        vertex: wgpu::VertexState {
            module: &shader,
            entry_point: Some("vertex"),
            compilation_options: Default::default(),
            buffers: &[Some(wgpu::VertexBufferLayout {
                array_stride: 12,
                step_mode: wgpu::VertexStepMode::Vertex,
                attributes: &wgpu::vertex_attr_array![0 => Float32x3],
            })],
        },
        primitive: wgpu::PrimitiveState::default(),
        depth_stencil: Some(wgpu::DepthStencilState {
            format: wgpu::TextureFormat::Depth32Float,
            depth_write_enabled: Some(true),
            depth_compare: Some(wgpu::CompareFunction::Greater),
            stencil: Default::default(),
            bias: Default::default(),
        }),
        multisample: Default::default(),
        fragment: Some(wgpu::FragmentState {
            module: &shader,
            entry_point: Some("fragment"),
            compilation_options: Default::default(),
            targets: &[],
        }),
        multiview_mask: None,
        cache: None,
    })
}

/// Casters drawn by another pass.
struct DrawnBy<'a> {
    casters: &'a dyn Casters,
    pipeline: &'a wgpu::RenderPipeline,
}

impl Casters for DrawnBy<'_> {
    fn hull(&self, light: &Light, visit: &mut dyn FnMut(DVec3)) {
        self.casters.hull(light, visit);
    }

    fn draw(&self, view: &LightView<'_>, pass: &mut wgpu::RenderPass<'_>) -> Drawn {
        let triangles = self.casters.triangles().expect("a mesh set's");
        pass.set_pipeline(self.pipeline);
        pass.set_bind_group(0, view.bind_group, &[view.offset]);
        pass.set_vertex_buffer(0, triangles.positions.slice(..));
        pass.set_index_buffer(triangles.indices.slice(..), wgpu::IndexFormat::Uint32);
        pass.draw_indexed(0..3 * triangles.triangles, 0, 0..1);
        Drawn { draws: 1, triangles: triangles.triangles.into() }
    }
}

/// The plain map over casters drawn by another pass.
struct PlainDrawnBy {
    map: MapTechnique,
    pipeline: wgpu::RenderPipeline,
}

impl Technique for PlainDrawnBy {
    fn prepare(&mut self, gpu: &Gpu, frame: &Frame<'_>) -> Result<(), GpuError> {
        let casters = DrawnBy { casters: frame.casters, pipeline: &self.pipeline };
        self.map.prepare(gpu, &Frame { casters: &casters, ..*frame })
    }

    fn encode(
        &mut self,
        gpu: &Gpu,
        frame: &Frame<'_>,
        recorder: &mut Recorder<'_>,
        visibility: &wgpu::TextureView,
    ) -> Result<(), GpuError> {
        let casters = DrawnBy { casters: frame.casters, pipeline: &self.pipeline };
        self.map.encode(gpu, &Frame { casters: &casters, ..*frame }, recorder, visibility)
    }

    fn counters(&self) -> Counters {
        self.map.counters()
    }

    fn bytes(&self) -> u64 {
        self.map.bytes()
    }
}

/// HC-38. Along the screen, an edge from d0 to d1 has at its middle the distance 2 d0 d1 / (d0 + d1), 1.8 m of 1 m
/// and 9 m; a distance written for each vertex says (d0 + d1) / 2 = 5 m, farther than what it hides.
#[test]
fn distance_written_for_each_vertex_loses_a_shadow_and_for_each_fragment_does_not() {
    const SIZE: u32 = 256;
    let gpu = gpu();
    let case = Case::by_name("HC-38 depth along a long edge").expect("a case of that name");
    for (right, wrong, distance) in [(true, 0.0, 1.8), (false, 0.5, 5.0)] {
        let map = MapConfig { size: SIZE, ..MapConfig::default() };
        let mut technique = PlainDrawnBy {
            map: MapTechnique::plain(&gpu, &map).expect("a valid config"),
            pipeline: linear_depth(&gpu, right),
        };
        let measured = case.measure(&gpu, &mut technique, SIZE).expect("measured");
        assert_eq!(measured, wrong, "for each fragment: {right}");
        let map = technique.map.map();
        let texels = read_f32_texture(&gpu, map.texture().expect("a map"), 0).expect("read back");
        let clip = map.views()[0].clip.expect("casters in view");
        // Beside the plate, which is nearer than 5 m, at the same height on the quad.
        let ndc = clip.project_point3(DVec3::new(0.1, 0.0, -1.0));
        let texel = (DVec2::splat(0.5) + DVec2::new(0.5, -0.5) * ndc.truncate()) * f64::from(SIZE);
        let stored = texels[texel.y as usize * SIZE as usize + texel.x as usize];
        let found = (clip * DVec3::ZERO.extend(1.0)).z / f64::from(stored);
        // A texel is up to 1 part in 100 of the way from end to end.
        assert!((found - distance).abs() < 0.01 * 8.0, "{found} m stored, not {distance} m");
    }
}

//! The maps that keep a surface from shadowing itself: what is in their texels, and what follows of it.

use crate::shared::on_plane::view_of;

use antumbra::Config;
use antumbra_gpu::{Casters, Drawn, Frame, Gpu, LightView, Recorder, read_f32_texture};
use antumbra_map::{
    Between, Bias, CasterDepth, DualLayers, Faces, MapConfig, Metric, Midpoint, Omni, Plain,
    PolygonOffset, SecondDepth, SecondSurface, ShadowMap, SlopeBias, Store, twin,
};
use antumbra_measure::Stage;
use antumbra_measure::stability::Case;
use antumbra_reference::ViewSample;
use antumbra_scene::generate::{self, shapes};
use antumbra_scene::{Light, LightKind, Scene};
use antumbra_tests::gpu;
use glam::{DAffine3, DMat4, DVec2, DVec3};

/// Unit roundoff of f32.
const U: f64 = 1.0 / 16_777_216.0;

/// Side of a map, texels.
const SIZE: u32 = 128;

fn stage(gpu: &Gpu) -> (Stage, [Light; 3]) {
    let mut scene = generate::sphere_over_plane(&Default::default());
    scene.add(
        shapes::cuboid(DVec3::new(0.6, 0.0, -0.9), DVec3::new(1.0, 0.8, -0.5)),
        DAffine3::from_rotation_y(0.3),
    );
    let sheet = shapes::quad(DVec3::new(-0.8, 1.6, 0.2), DVec3::Z * 0.4, DVec3::new(0.4, 0.2, 0.0));
    scene.add(sheet, DAffine3::IDENTITY);
    let stage = Stage::new(gpu, &scene, scene.camera_or_framing(), 128, 128).expect("a stage");
    let lights = [LightKind::Directional, LightKind::Spot, LightKind::Point];
    (stage, lights.map(|kind| scene.place_light(kind)))
}

/// One layer of a map: its matrix and metric, and the depths of the two layers and of the occluder.
struct Texels {
    metric: Metric,
    first: Vec<f32>,
    second: Vec<f32>,
    between: Vec<f32>,
}

fn texels(gpu: &Gpu, stage: &Stage, light: &Light, limit: f64) -> Vec<Texels> {
    let frame = stage.frame(light);
    let mut map = ShadowMap::new(gpu, SIZE, 2, Box::new(Omni::Cube)).expect("a valid size");
    let depth = CasterDepth::new(gpu, Faces::Both, PolygonOffset::default()).expect("it links");
    let mut store = Between::new(gpu, limit).expect("it links");
    map.prepare(gpu, &frame).expect("prepared");
    store.prepare(gpu, &frame, &map).expect("prepared");
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    let mut recorder = Recorder::new(&mut encoder);
    map.encode_triangles(&frame, &mut recorder, &depth).expect("encoded");
    store.encode(gpu, &frame, &map, &mut recorder).expect("encoded");
    gpu.queue.submit([encoder.finish()]);
    let mut hull = Vec::new();
    frame.casters.hull(light, &mut |p| hull.push(p - frame.origin));
    let views = map.views().iter().filter_map(|v| v.clip).enumerate();
    let read = |texture: Option<&wgpu::Texture>, layer: usize| {
        read_f32_texture(gpu, texture.expect("a map with casters"), layer as u32).expect("read")
    };
    views
        .map(|(layer, clip)| Texels {
            metric: Metric::new(&clip, f64::from(SIZE), &hull, limit),
            first: read(map.texture(), layer),
            second: read(store.second(), layer),
            between: read(store.texture(), layer),
        })
        .collect()
}

#[test]
fn the_occluder_lies_between_the_layers_and_where_its_twin_says() {
    let gpu = gpu();
    let (stage, lights) = stage(&gpu);
    for light in &lights {
        for limit in [f64::INFINITY, 0.0, 0.866, 20.0] {
            let (mut both, mut one, mut limited) = (0u32, 0u32, 0u32);
            for layer in texels(&gpu, &stage, light, limit) {
                let columns = layer.first.iter().zip(&layer.second).zip(&layer.between);
                for ((&z1, &z2), &z) in columns {
                    if z1 == 0.0 {
                        assert_eq!(z, 0.0, "nothing where no caster is");
                        continue;
                    }
                    both += u32::from(z2 > 0.0);
                    one += u32::from(z2 == 0.0);
                    assert!(z2 <= z && z <= z1, "{z1}, {z2}: {z} is not between");
                    let exact = twin::occluder(&layer.metric, z1.into(), z2.into());
                    // Four roundings of at most 2 z1, and those of the metric's three numbers.
                    let error = (f64::from(z) - exact).abs();
                    assert!(error <= 12.0 * U * f64::from(z1), "{z1}, {z2}: {z}, not {exact}");
                    let middle = Metric { scale: 0.0, shift: 0.0, ..layer.metric };
                    limited += u32::from(exact > twin::occluder(&middle, z1.into(), z2.into()));
                    if limit == 0.0 {
                        assert_eq!(z, z1, "no farther than the first layer");
                    }
                }
            }
            assert!(both > 200, "{light:?}: only {both} texels have two layers");
            let sheets = one > 20 || !matches!(light, Light::Directional { .. });
            assert!(sheets, "{light:?}: only {one} texels have one layer");
            // The control: a limit of a texel binds nearly everywhere, none nowhere.
            let binds = f64::from(limited) / f64::from(both + one);
            let expected =
                if limit.is_finite() { limit > 1.0 || binds > 0.9 } else { binds == 0.0 };
            assert!(expected, "{light:?}: a limit of {limit} binds in {binds} of the texels");
        }
    }
}

#[test]
fn halfway_is_measured_in_distance() {
    // Two sheets at 2 m and 6 m from a spot light: the occluder is at 4 m, where 1 / 4 is no mean of 1 / 2 and
    // 1 / 6.
    let gpu = gpu();
    let mut scene = Scene::default();
    for distance in [2.0, 6.0] {
        let half = 0.4 * distance;
        let sheet = shapes::quad(-distance * DVec3::Z, half * DVec3::X, half * DVec3::Y);
        scene.add(sheet, DAffine3::IDENTITY);
    }
    let mut stage = Stage::new(&gpu, &scene, scene.framing_camera(), 8, 8).expect("a stage");
    stage.meshes.set_culling(false);
    let light = Light::Spot { position: DVec3::ZERO, direction: DVec3::NEG_Z, outer_angle: 0.3 };
    let middle = (SIZE * SIZE / 2 + SIZE / 2) as usize;
    let layer = &texels(&gpu, &stage, &light, f64::INFINITY)[0];
    // Depth is near / distance.
    let near = 2.0 * f64::from(layer.first[middle]);
    let distance = |z: f32| near / f64::from(z);
    assert!((distance(layer.second[middle]) - 6.0).abs() < 1e-5, "the second sheet");
    assert!((distance(layer.between[middle]) - 4.0).abs() < 1e-5, "halfway");
    // A limit of 10 texels, each a share of 2 tan / size of the distance: the guard band is two texels a side.
    let layer = &texels(&gpu, &stage, &light, 10.0)[0];
    let side = 2.0 * 0.3_f64.tan() / f64::from(SIZE - 4);
    let expected = 2.0 * (1.0 + 10.0 * side);
    let found = distance(layer.between[middle]);
    assert!((found - expected).abs() < 1e-4, "{found}, not {expected}");
}

fn visibility(gpu: &Gpu, stage: &Stage, light: &Light, config: &Config) -> Vec<f32> {
    let mut config = config.clone();
    config.set_map_size(SIZE);
    let mut technique = config.build(gpu).expect("a valid config");
    stage.shoot(gpu, light, technique.as_mut(), 0).expect("a shot").visibility
}

#[test]
fn a_limit_moves_dual_layers_from_the_unbiased_map_to_the_midpoint() {
    let gpu = gpu();
    let (stage, lights) = stage(&gpu);
    for light in &lights {
        let dual = |limit| {
            let config = DualLayers { limit, ..Default::default() };
            visibility(&gpu, &stage, light, &Config::DualLayers(config))
        };
        let bias = Bias::ROUNDING;
        let plain = Config::Plain(Plain { map: MapConfig { bias, ..Default::default() } });
        assert_eq!(dual(0.0), visibility(&gpu, &stage, light, &plain), "{light:?}: no limit");
        let midpoint = Config::Midpoint(Midpoint::default());
        let midpoint = visibility(&gpu, &stage, light, &midpoint);
        assert_eq!(dual(1e30), midpoint, "{light:?}: a limit beyond everything");
        // The test is a threshold on one depth: what a nearer occluder lights, a farther one does, so a limit's
        // leaks are among the midpoint's, and the midpoint's acne among the limit's.
        let mut before = dual(0.0);
        for limit in [0.5, 1.0, 4.0, 1e30] {
            let after = dual(limit);
            let darker = before.iter().zip(&after).filter(|(b, a)| a < b).count();
            let lighter = before.iter().zip(&after).filter(|(b, a)| a > b).count();
            assert_eq!(darker, 0, "{light:?}: a limit of {limit} texels darkens samples");
            assert!(lighter > 0 || limit > 1.0, "{light:?}: a limit of {limit} changes nothing");
            before = after;
        }
    }
}

/// Of the samples of the four convex bodies that face the light: the share that is not fully lit, and the share whose own plane
/// hides them at a texel's centre beyond `limit`, the mean over all places of the sample in its texel; and how many face it.
fn dark_and_due(gpu: &Gpu, kind: LightKind, config: &Config, limit: f64) -> [f64; 3] {
    const STEPS: i32 = 16;
    let (mut facing, mut dark, mut due) = (0.0, 0.0, 0.0);
    for (_, build, _) in generate::CONVEX {
        let scene = build();
        let camera = scene.camera_or_framing();
        let mut stage = Stage::new(gpu, &scene, camera, 128, 128).expect("a stage");
        stage.meshes.set_culling(false);
        let light = scene.place_light(kind);
        let found = visibility(gpu, &stage, &light, config);
        let frame = stage.frame(&light);
        let mut map = ShadowMap::new(gpu, SIZE, 2, Box::new(Omni::Cube)).expect("a valid size");
        map.prepare(gpu, &frame).expect("prepared");
        let mut hull = Vec::new();
        frame.casters.hull(&light, &mut |p| hull.push(p - frame.origin));
        for (sample, v) in stage.view_samples().iter().zip(&found) {
            let (p, n) = (sample.position.as_dvec3(), sample.normal.as_dvec3());
            let to_light = light.towards(p + frame.origin, DVec2::splat(0.5)).normalize();
            if n.dot(to_light) <= 1e-4 {
                continue;
            }
            let clip = view_of(map.views(), p).and_then(|v| v.clip).expect("casters in view");
            let metric = Metric::new(&clip, f64::from(SIZE), &hull, limit);
            let at = twin::locate(&clip, f64::from(SIZE), p, n);
            let step = |i: i32| (f64::from(i % STEPS) + 0.5) / f64::from(STEPS) - 0.5;
            let hides = |i: &i32| {
                let first = at.depth + at.gradient.dot(DVec2::new(step(*i), step(*i / STEPS)));
                // Reversed depth: nearer is more.
                twin::occluder(&metric, first, 0.0) > at.depth
            };
            let count = (0..STEPS * STEPS).filter(hides).count();
            due += count as f64 / f64::from(STEPS * STEPS);
            dark += f64::from(u8::from(*v < 1.0));
            facing += 1.0;
        }
    }
    [dark / facing, due / facing, facing]
}

#[test]
fn on_lone_bodies_dual_layers_darken_what_is_steeper_than_the_limit() {
    let gpu = gpu();
    for kind in [LightKind::Directional, LightKind::Spot, LightKind::Point] {
        let dual = DualLayers::default();
        let config = Config::DualLayers(dual);
        let [dark, due, facing] = dark_and_due(&gpu, kind, &config, dual.limit.into());
        // Where front and back converge the midpoint is nearer than the limit, and darkens what it darkens alone.
        let [limb, ..] = dark_and_due(&gpu, kind, &Config::Midpoint(Midpoint::default()), 1.0);
        let chance = 4.0 * (due * (1.0 - due) / facing).sqrt();
        let expected = due - chance..due + limb + chance;
        assert!(expected.contains(&dark), "{kind:?}: {dark} are dark, not {expected:?}");
        // The control: without the limit nearly nothing is dark, and that is told apart.
        assert!(!expected.contains(&limb), "{kind:?}: {limb} passes as {expected:?}");
    }
}

#[test]
fn the_polygon_offset_is_that_of_the_formula() {
    let gpu = gpu();
    // Planes of several slopes, in both directions, over the same square.
    for (x, z) in [(0.0, 0.0), (0.7, 0.0), (0.0, -1.5), (0.8, 0.8), (3.0, 1.0)] {
        let mut scene = Scene::default();
        let sheet = shapes::quad(DVec3::ZERO, DVec3::new(0.0, z, 1.0), DVec3::new(1.0, x, 0.0));
        scene.add(sheet, DAffine3::IDENTITY);
        // Holds the map's range open beyond the sheet.
        scene.add(shapes::quad(-30.0 * DVec3::Y, DVec3::Z, DVec3::X), DAffine3::IDENTITY);
        let mut stage = Stage::new(&gpu, &scene, scene.framing_camera(), 8, 8).expect("a stage");
        stage.meshes.set_culling(false);
        let light = Light::Directional { direction: DVec3::NEG_Y, angular_diameter: 0.0 };
        let frame = stage.frame(&light);
        let draw = |offset: PolygonOffset| -> (DMat4, Vec<f32>) {
            let mut map =
                ShadowMap::new(&gpu, SIZE, 2, Box::new(Omni::Cube)).expect("a valid size");
            let depth = CasterDepth::new(&gpu, Faces::Both, offset).expect("it links");
            map.prepare(&gpu, &frame).expect("prepared");
            let mut encoder = gpu.device.create_command_encoder(&Default::default());
            let mut recorder = Recorder::new(&mut encoder);
            map.encode_triangles(&frame, &mut recorder, &depth).expect("encoded");
            gpu.queue.submit([encoder.finish()]);
            let clip = map.views()[0].clip.expect("a view with casters");
            let texture = map.texture().expect("a map with casters");
            (clip, read_f32_texture(&gpu, texture, 0).expect("read"))
        };
        let (clip, bare) = draw(PolygonOffset::default());
        // Change of depth a texel along the axes.
        let side = 2.0 / f64::from(SIZE - 4);
        let per_metre = clip.row(2).truncate().length();
        let (gx, gz) = (x * side * per_metre, z * side * per_metre);
        let steeper = gx.abs().max(gz.abs());
        let gradient = gx.hypot(gz);
        let nearest = bare.iter().copied().fold(0.0, f32::max);
        // The vertices reach as far beyond the outermost centres as half a texel is deep.
        let exponent = (f64::from(nearest) + 0.5 * (gx.abs() + gz.abs())).log2().floor();
        for (factor, units) in [(0.0, 10), (2.5, 0), (2.5, 10), (1.0, 1000)] {
            let (_, pushed) = draw(PolygonOffset { factor, units });
            let step = 2f64.powf(exponent - 23.0);
            let constant = f64::from(units) * step;
            let f = f64::from(factor);
            // Hardware may take the steeper axis or the gradient's length; depths are rounded to a step.
            let least = f * steeper * (1.0 - 1e-3) + constant - 4.0 * step;
            let most = f * gradient * (1.0 + 1e-3) + constant + 4.0 * step;
            for (bare, pushed) in bare.iter().zip(&pushed).filter(|(bare, _)| **bare > 0.5) {
                let push = f64::from(*bare) - f64::from(*pushed);
                assert!(
                    (least..=most).contains(&push),
                    "slopes {x}, {z}, {factor}, {units}: {push}, not {least} to {most}"
                );
            }
        }
    }
}

#[test]
fn a_bias_in_metres_leaks_as_far_as_geometry_says() {
    let gpu = gpu();
    let size = 1024;
    let gap = |case: &str, config: Config| {
        let mut config = config;
        config.set_map_size(size);
        let mut technique = config.build(&gpu).expect("a valid config");
        let case = Case::by_name(case).expect("a case of that name");
        case.measure(&gpu, technique.as_mut(), size).expect("measured") / f64::from(size)
    };
    // 0.1 m of depth at 45 degrees are 0.0707 m of floor, behind a wall of 0.01 m or a cube's far side; to
    // within the texel.
    let bias = Bias { metres: 0.1, ..Bias::ROUNDING };
    let wall = gap(
        "HC-04 thin wall",
        Config::Plain(Plain { map: MapConfig { size, bias, ..Default::default() } }),
    );
    let texel = 2.01 / f64::from(size);
    assert!((wall * 2.01 - 0.0607).abs() <= texel, "{} m behind the wall", wall * 2.01);
    for surface in [SecondSurface::BackFaces, SecondSurface::SecondLayer] {
        let config = SecondDepth { bias: 0.1, surface, ..Default::default() };
        let cube = gap("HC-05 cube", Config::SecondDepth(config)) * 2.0;
        assert!((cube - 0.0707).abs() <= texel, "{cube} m behind the cube, {surface:?}");
    }
}

/// HC-34: an icosahedron under smooth normals. Where a facet turns away from the sun and the smooth normal does not, truth
/// and the plain map say shadow; a map of back faces holds the very facet, half of which is farther than its texel's
/// centre and dark, and half lit.
#[test]
fn under_smooth_normals_back_faces_shadow_themselves() {
    let gpu = gpu();
    let body = shapes::icosphere(0, 1.0);
    let light = Light::sun(30_f64.to_radians(), 0.4, 0.0);
    let to_light = light.towards(DVec3::ZERO, DVec2::splat(0.5));
    let mut samples = Vec::new();
    for triangle in &body.triangles {
        let [a, b, c] = triangle.map(|i| body.positions[i as usize].as_dvec3());
        if (b - a).cross(c - a).normalize().dot(to_light) > -0.05 {
            continue;
        }
        for i in 1..60 {
            for j in 1..60 - i {
                let p = a + (b - a) * (f64::from(i) / 60.0) + (c - a) * (f64::from(j) / 60.0);
                if p.normalize().dot(to_light) > 0.05 {
                    let (position, normal) = (p.as_vec3(), p.normalize().as_vec3());
                    samples.push(ViewSample { position, normal });
                }
            }
        }
    }
    assert!(samples.len() > 300, "{} samples between the terminators", samples.len());
    let mut scene = Scene::default();
    scene.add(body, DAffine3::IDENTITY);
    let stage = Stage::at_points(&gpu, &scene, &samples).expect("a stage");
    let dark = |config: Config| {
        let mut technique = config.build(&gpu).expect("a valid config");
        let seen = stage.shoot(&gpu, &light, technique.as_mut(), 0).expect("a shot").visibility;
        seen[..samples.len()].iter().filter(|v| **v < 0.5).count() as f64 / samples.len() as f64
    };
    let size = 512;
    let plain = dark(Config::Plain(Plain { map: MapConfig { size, ..Default::default() } }));
    let back = dark(Config::SecondDepth(SecondDepth { size, ..Default::default() }));
    // To four deviations of as many coin flips.
    let chance = 2.0 / (samples.len() as f64).sqrt();
    assert!((back - 0.5).abs() <= chance, "{back} of back faces in shadow, to {chance}");
    assert!(plain > 0.5 + chance, "{plain} in shadow by the plain map");
}

#[test]
fn settings_out_of_range_are_refused_with_a_fix() {
    let gpu = gpu();
    let mut bad = Vec::new();
    for number in [-1.0, f32::NAN, f32::INFINITY] {
        bad.extend([
            Config::SecondDepth(SecondDepth { bias: number, ..Default::default() }),
            Config::DualLayers(DualLayers { limit: number, ..Default::default() }),
            Config::SlopeBias(SlopeBias { factor: number, ..Default::default() }),
            Config::NormalOffset(antumbra_map::NormalOffset {
                offset: number,
                ..Default::default()
            }),
        ]);
    }
    bad.push(Config::SlopeBias(SlopeBias { units: -1, ..Default::default() }));
    bad.push(Config::Midpoint(Midpoint { size: 0 }));
    for config in bad {
        let error = config.build(&gpu).err().map(|e| e.to_string());
        assert!(error.is_some_and(|e| e.contains("use ")), "{config:?} passed");
    }
}

/// Casters that keep their triangles to themselves.
struct Reticent<'a>(&'a dyn Casters);

impl Casters for Reticent<'_> {
    fn hull(&self, light: &Light, visit: &mut dyn FnMut(DVec3)) {
        self.0.hull(light, visit);
    }

    fn draw(&self, view: &LightView<'_>, pass: &mut wgpu::RenderPass<'_>) -> Drawn {
        self.0.draw(view, pass)
    }
}

#[test]
fn casters_without_triangles_are_refused_where_they_are_needed() {
    let gpu = gpu();
    let (stage, lights) = stage(&gpu);
    let reticent = Reticent(&stage.meshes);
    let frame = Frame { casters: &reticent, ..stage.frame(&lights[0]) };
    let needs = |config: Config| {
        let mut technique = config.build(&gpu).expect("a valid config");
        technique.prepare(&gpu, &frame).err().map(|e| e.to_string())
    };
    let second = SecondDepth { surface: SecondSurface::SecondLayer, ..Default::default() };
    for config in [
        Config::SecondDepth(SecondDepth::default()),
        Config::SecondDepth(second),
        Config::Midpoint(Midpoint::default()),
        Config::DualLayers(DualLayers::default()),
        Config::SlopeBias(SlopeBias::default()),
    ] {
        let error = needs(config.clone());
        assert!(error.is_some_and(|e| e.contains("map/plain")), "{config:?} says no fix");
    }
    assert_eq!(needs(Config::NormalOffset(Default::default())), None, "needs only depth");
}

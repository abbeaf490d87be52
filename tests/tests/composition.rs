//! Every technique over every light: sane values, seams, culling, empty scenes, repeatability, scale.

use antumbra::{Config, catalogue};
use antumbra_filter::{PcfBilinearGrid, PcfCastano, PcfGrid, PcfPoisson};
use antumbra_gpu::{
    Expectation, Frame, Gpu, MeshSet, Recorder, Technique, ViewSamples, read_f32_texture,
};
use antumbra_map::{MapConfig, MapTechnique, Plain};
use antumbra_measure::Stage;
use antumbra_reference::{SampleClass, Tracer, TruthOptions, ViewSample};
use antumbra_sampling::{Cascades, Lispsm, Sdsm, Select};
use antumbra_scene::{Light, LightKind, Scene, generate};
use antumbra_tests::{gpu, one_in};
use antumbra_volume::Translucent;
use glam::{DAffine3, DVec2, DVec3, Vec3};

/// Techniques that shadow planes alone, or by bounds alone: not right on any receiver.
const PLANES_ONLY: [&str; 3] = ["map/planar", "map/shadow-texture", "map/disc"];

/// All techniques that shadow any receiver, and the variants that differ in more than numbers, on maps of `size`
/// texels, or half of it for filtered stores.
fn techniques(size: u32) -> Vec<Config> {
    let mut all = every_technique(size);
    all.retain(|config| !PLANES_ONLY.contains(&config.id()));
    all
}

/// The same and those for planes.
fn every_technique(size: u32) -> Vec<Config> {
    let mut all = catalogue();
    all.extend([
        Config::PcfGrid(PcfGrid { side: 2, ..Default::default() }),
        Config::PcfGrid(PcfGrid { side: 7, ..Default::default() }),
        Config::PcfBilinearGrid(PcfBilinearGrid { side: 1, ..Default::default() }),
        Config::PcfCastano(PcfCastano { side: 3, ..Default::default() }),
        Config::PcfCastano(PcfCastano { side: 7, hardware: true, ..Default::default() }),
        Config::PcfPoisson(PcfPoisson { taps: 1, radius: 0.0, ..Default::default() }),
    ]);
    all.extend(placed());
    for config in &mut all {
        // A texel of a filtered store costs a kernel of taps, whether a sample looks at it or not.
        config.set_map_size(if is_filtered(config) { size / 2 } else { size });
    }
    all
}

/// Filters whose samples cascades and warps place.
fn placed() -> Vec<Config> {
    let evsm = Box::new(Config::Evsm(Default::default()));
    let pcf = Box::new(Config::PcfCastano(Default::default()));
    let msm = Box::new(Config::Msm(Default::default()));
    vec![
        Config::Cascades(cascades(evsm.clone())),
        Config::Cascades(Cascades { select: Select::Depth, ..cascades(pcf.clone()) }),
        Config::Sdsm(Sdsm { of: msm, count: 3, clusters: true, ..Default::default() }),
        Config::Lispsm(lispsm(evsm)),
        Config::Lispsm(lispsm(pcf)),
    ]
}

fn cascades<E>(of: E) -> Cascades<E> {
    let Cascades { count, splits, select, blend, fit, .. } = Cascades::<Plain>::default();
    Cascades { of, count, splits, select, blend, fit }
}

fn lispsm<E>(of: E) -> Lispsm<E> {
    let Lispsm { near_offset, far_offset, falloff, search, guard, .. } = Lispsm::<Plain>::default();
    Lispsm { of, near_offset, far_offset, falloff, search, guard }
}

/// What places its samples is no matter for what a technique is.
fn inner(config: &Config) -> &Config {
    match config {
        Config::Cascades(Cascades { of, .. })
        | Config::Sdsm(Sdsm { of, .. })
        | Config::Lispsm(Lispsm { of, .. })
        | Config::Translucent(Translucent { of }) => inner(of),
        other => other,
    }
}

/// The same without those that by design have acne or cast no shadow of an open sheet: tests of their own say
/// what holds of them.
fn sound_techniques(size: u32) -> Vec<Config> {
    let holds = |config: &Config, case| match config.expectation(case) {
        Some(Expectation::Holds { bound }) => bound == 0.0,
        _ => false,
    };
    let sound = |config: &Config| {
        holds(config, "lone receivers, directional") && holds(config, "HC-06 open sheet")
    };
    techniques(size).into_iter().filter(sound).collect()
}

/// Whether the technique draws a shadow map: then its size can be set.
fn has_map(config: &Config) -> bool {
    let mut other = config.clone();
    other.set_map_size(77);
    other != *config
}

/// A sphere and a turned box over a floor: a crease, a contact, a curved and a detached shadow.
fn scene() -> Scene {
    let mut scene = generate::sphere_over_plane(&Default::default());
    scene.add(
        generate::shapes::cuboid(DVec3::new(0.6, 0.0, -0.9), DVec3::new(1.0, 0.8, -0.5)),
        DAffine3::from_rotation_y(0.3),
    );
    scene
}

/// A light of each kind, placed from the scene without its floor, so that shadows are not all over the picture.
fn every_light(scene: &Scene) -> Vec<Light> {
    let mut casters = scene.clone();
    casters.instances.remove(0);
    LightKind::ALL.into_iter().map(|kind| casters.place_light(kind)).collect()
}

/// A light for each layout of a map; the other kinds are served as a point light is.
fn lights(scene: &Scene) -> Vec<Light> {
    let of_a_kind = |light: &Light| {
        matches!(light.kind(), LightKind::Directional | LightKind::Spot | LightKind::Sphere)
    };
    every_light(scene).into_iter().filter(of_a_kind).collect()
}

fn stage(gpu: &Gpu, scene: &Scene) -> Stage {
    Stage::new(gpu, scene, scene.camera_or_framing(), 128, 128).expect("a stage")
}

fn shoot(gpu: &Gpu, stage: &Stage, light: &Light, config: &Config) -> Vec<f32> {
    let mut technique = config.build(gpu).expect("a valid config");
    stage.shoot(gpu, light, technique.as_mut(), 0).expect("a shot").visibility
}

/// The point or direction that stands for the light in a shadow map.
fn hard(light: &Light) -> Light {
    match *light {
        Light::Directional { direction, .. } => {
            Light::Directional { direction, angular_diameter: 0.0 }
        }
        Light::Point { .. } | Light::Spot { .. } => *light,
        Light::Sphere { center, .. } | Light::Rect { center, .. } | Light::Disc { center, .. } => {
            Light::Point { position: center }
        }
    }
}

/// Whether the technique filters its map ahead of the lookup.
fn is_filtered(config: &Config) -> bool {
    let others = [
        "filter/convolution",
        "filter/multiple-depth",
        "filter/blurred-depth",
        "filter/soft-comparison",
    ];
    is_bound(config) || others.contains(&inner(config).id())
}

/// Whether the technique bounds visibility from above: lit samples are lit, dark ones close behind their casters or
/// under several of them leak.
fn is_bound(config: &Config) -> bool {
    matches!(
        inner(config),
        Config::Vsm(_)
            | Config::Lvsm(_)
            | Config::Savsm(_)
            | Config::Esm(_)
            | Config::Evsm(_)
            | Config::Msm(_)
    )
}

#[test]
fn every_technique_is_right_away_from_shadow_boundaries_under_every_light() {
    // Pixels this near to a change of the truth are left out: 4 pixels are 12 cm on the floor, a kernel of
    // 7 texels on the cube's face 4 cm.
    const BAND: isize = 4;
    // A bound that leaks more counts; of the dark samples 1 in 20 may, at the foot of the box: exponentials leak a
    // tenth at 3 % of the depth range, some 3 m here, behind a caster.
    const LEAK: f32 = 0.1;
    let gpu = gpu();
    let scene = scene();
    let stage = stage(&gpu, &scene);
    let (width, height) = (stage.image.width as isize, stage.image.height as isize);
    let samples = stage.view_samples();
    let wrong = scene.place_light(LightKind::Point).translated(DVec3::X);
    for (turn, light) in every_light(&scene).into_iter().enumerate() {
        let kind = light.kind();
        let light_point = hard(&light);
        let truth = stage.truth(&light_point, &TruthOptions::default());
        let inner = |i: usize| {
            let (x, y) = (i as isize % width, i as isize / width);
            truth.class[i] == SampleClass::Counted
                && (-BAND..=BAND).flat_map(|dy| (-BAND..=BAND).map(move |dx| (x + dx, y + dy))).all(
                    |(x, y)| {
                        let there = (0..width).contains(&x) && (0..height).contains(&y);
                        !there || truth.visibility[(y * width + x) as usize] == truth.visibility[i]
                    },
                )
        };
        let inner: Vec<bool> = (0..samples.len()).map(inner).collect();
        let count =
            |v: f32| (0..samples.len()).filter(|&i| inner[i] && truth.visibility[i] == v).count();
        assert!(
            count(0.0) > 50 && count(1.0) > 1000,
            "{kind:?}: {} dark, {} lit",
            count(0.0),
            count(1.0)
        );
        for config in one_in(3, turn, sound_techniques(1024)) {
            // Soft shadows of an area light are not those of its centre.
            let shown = if config.id().starts_with("soft/") { &light_point } else { &light };
            let visibility = shoot(&gpu, &stage, shown, &config);
            let (mut off, mut leaky) = (0, 0);
            for (i, (v, sample)) in visibility.iter().zip(&samples).enumerate() {
                assert!((0.0..=1.0).contains(v), "{config:?}, {kind:?}: visibility {v}");
                if sample.normal == Vec3::ZERO {
                    assert_eq!(*v, 1.0, "{config:?}, {kind:?}: an empty pixel");
                    continue;
                }
                let p = stage.triangles.origin + sample.position.as_dvec3();
                let to_light = light_point.towards(p, DVec2::splat(0.5)).normalize();
                if sample.normal.as_dvec3().dot(to_light) < -1e-4 {
                    assert_eq!(*v, 0.0, "{config:?}, {kind:?}: a sample that faces away");
                }
                let error = v - truth.visibility[i];
                if is_bound(&config) && error > 0.0 {
                    leaky += usize::from(inner[i] && error > LEAK);
                } else {
                    off += usize::from(inner[i] && error.abs() > 1e-6);
                }
            }
            assert_eq!(off, 0, "{config:?}, {kind:?}: samples off inside shadow or light");
            assert!(
                20 * leaky <= count(0.0),
                "{config:?}, {kind:?}: of {} dark samples {leaky} are lit by {LEAK}",
                count(0.0)
            );
        }
        // The control: another light's answer.
        let other = shoot(&gpu, &stage, &wrong, &catalogue()[0]);
        let off = (0..samples.len()).filter(|&i| inner[i] && other[i] != truth.visibility[i]);
        assert!(off.count() > 100, "{kind:?}: another light's shadows pass as its own");
    }
}

/// HC-11: a closed room with the light at its centre and poles around it, at 0, 45, .. degrees. Faces of a
/// cube map meet along the room's edges, on which the shadows of four poles fall; those of the other four
/// cross the edges to floor and ceiling.
fn room_with_poles() -> Scene {
    let mut scene = Scene { name: "room".to_owned(), ..Scene::default() };
    scene.add(generate::shapes::cuboid(DVec3::splat(-5.0), DVec3::splat(5.0)), DAffine3::IDENTITY);
    for k in 0..8 {
        let azimuth = f64::from(k) * std::f64::consts::FRAC_PI_4;
        let foot = DVec3::new(2.0 * azimuth.cos(), -5.0, 2.0 * azimuth.sin());
        let pole = generate::shapes::cylinder(0.05, 10.0, 32);
        scene.add(pole, DAffine3::from_translation(foot));
    }
    scene.camera = Some(antumbra_scene::Camera {
        eye: DVec3::new(-4.0, 1.0, -3.0),
        target: DVec3::new(5.0, 0.0, 5.0),
        up: DVec3::Y,
        fov_y: 1.2,
        near: 0.1,
    });
    scene
}

#[test]
fn seams_of_the_cube_are_no_worse_than_the_middle_of_its_faces() {
    // Receivers on the walls, 3 degrees to either side of each pole's shadow, at all heights: the same length
    // of shadow edge at seams and elsewhere.
    const AROUND: u32 = 192;
    const HEIGHTS: u32 = 160;
    let gpu = gpu();
    let scene = room_with_poles();
    let meshes = MeshSet::new(&gpu, &scene).expect("a valid scene");
    let triangles = scene.triangles(scene.origin()).expect("a valid scene");
    let tracer = Tracer::new(&triangles).expect("a valid scene");
    let light = Light::Point { position: DVec3::ZERO };
    let (width, height) = (8 * AROUND, HEIGHTS);
    let mut receivers = Vec::new();
    for j in 0..height {
        for i in 0..width {
            let pole = f64::from(i / AROUND) * std::f64::consts::FRAC_PI_4;
            let share = (f64::from(i % AROUND) + 0.5) / f64::from(AROUND) * 2.0 - 1.0;
            let azimuth = pole + share * 3f64.to_radians();
            let ray = DVec3::new(azimuth.cos(), 0.0, azimuth.sin());
            let y = 5.0 * ((f64::from(j) + 0.5) / f64::from(height) * 2.0 - 1.0);
            let position = (ray * (5.0 / ray.abs().max_element())).with_y(y);
            let normal = if ray.x.abs() > ray.z.abs() {
                -ray.x.signum() * DVec3::X
            } else {
                -ray.z.signum() * DVec3::Z
            };
            receivers.push(ViewSample { position: position.as_vec3(), normal: normal.as_vec3() });
        }
    }
    let truth = tracer.truth(&light, &receivers, &TruthOptions::default());
    let samples = ViewSamples::new(&gpu, width, height).expect("a valid size");
    let positions: Vec<Vec3> = receivers.iter().map(|r| r.position).collect();
    let normals: Vec<Vec3> = receivers.iter().map(|r| r.normal).collect();
    samples.write(&gpu, &positions, &normals).expect("lists that fit");
    let frame = Frame {
        samples: &samples,
        camera: None,
        light: &light,
        casters: &meshes,
        origin: meshes.origin(),
    };
    // What `map/triangle-depth` misses, slivers at the poles' limbs, depends on how they are seen.
    // The pages that fit have texels of 10 m / 960, of which the shadows of poles on the axes are 24 wide to within 1/100,
    // so that there is no error to compare with; `matched.rs` compares pages on a cube's faces, and their borders, with maps.
    let of_texels = |config: &Config| {
        !matches!(config, Config::TriangleDepth(_) | Config::ResolutionMatched(_))
    };
    for config in sound_techniques(1024).into_iter().filter(of_texels) {
        let mut technique = config.build(&gpu).expect("a valid config");
        let visibility = run(&gpu, &frame, technique.as_mut());
        let mean = |counts: &dyn Fn(usize, f32) -> bool| {
            let errors: Vec<f64> = (0..receivers.len())
                .filter(|&i| counts(i / AROUND as usize % 8, receivers[i].position.y.abs()))
                .map(|i| f64::from((visibility[i] - truth.visibility[i]).abs()))
                .collect();
            assert!(errors.len() > 1000, "{} receivers in a part of the wall", errors.len());
            errors.iter().sum::<f64>() / errors.len() as f64
        };
        let elsewhere = mean(&|pole, y| pole % 2 == 0 && y < 4.5);
        // A texel is 1 cm on the wall: the last 3 cm before an edge are within a few of them.
        let upright = mean(&|pole, y| pole % 2 == 1 && y < 4.5);
        let level = mean(&|pole, y| pole % 2 == 0 && y > 4.9);
        let corners = mean(&|pole, y| pole % 2 == 1 && y > 4.9);
        for (name, seam) in [("upright", upright), ("level", level), ("corner", corners)] {
            assert!(
                seam <= 1.1 * elsewhere,
                "{config:?}: {seam} at {name} seams, else {elsewhere}"
            );
        }
        // Those that ask the triangles have no texels, and no error.
        let is_exact = matches!(config, Config::ViewSampleMapping(_) | Config::VolumeTriangle(_));
        let is_edge = if is_exact { elsewhere == 0.0 } else { elsewhere > 1e-4 };
        assert!(is_edge, "{config:?}: an error of {elsewhere} is no shadow edge's");
    }
}

/// Prepares, encodes, submits and reads the visibility.
fn run(gpu: &Gpu, frame: &Frame<'_>, technique: &mut dyn Technique) -> Vec<f32> {
    let target = frame.samples.visibility_target(gpu).expect("a target");
    technique.prepare(gpu, frame).expect("prepared");
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    let view = target.create_view(&Default::default());
    technique.encode(gpu, frame, &mut Recorder::new(&mut encoder), &view).expect("encoded");
    gpu.queue.submit([encoder.finish()]);
    read_f32_texture(gpu, &target, 0).expect("read back")
}

#[test]
fn culling_saves_draws_and_changes_nothing() {
    let gpu = gpu();
    let scene = room_with_poles();
    let mut stage = stage(&gpu, &scene);
    // What the camera sees narrows the fit, which is another matter.
    stage.set_camera(None);
    let lights = [
        Light::Point { position: DVec3::new(0.3, 0.5, -0.2) },
        Light::Spot { position: DVec3::ZERO, direction: DVec3::X, outer_angle: 0.6 },
    ];
    for (turn, light) in lights.iter().enumerate() {
        for config in one_in(2, turn, techniques(512)).filter(has_map) {
            let mut shots = Vec::new();
            for cull in [true, false] {
                stage.meshes.set_culling(cull);
                let mut technique = config.build(&gpu).expect("a valid config");
                shots.push(stage.shoot(&gpu, light, technique.as_mut(), 0).expect("a shot"));
            }
            assert_eq!(shots[0].visibility, shots[1].visibility, "{config:?}");
            let [culled, all] = [0, 1].map(|i: usize| shots[i].counters["map_triangles"]);
            assert!(culled < all, "{config:?}: {culled} triangles with culling, {all} without");
        }
    }
}

#[test]
fn a_floor_under_the_light_is_culled_and_shadows_stay_where_they_are() {
    let gpu = gpu();
    let scene = scene();
    let mut stage = stage(&gpu, &scene);
    for light in lights(&scene) {
        let mut shots = Vec::new();
        for cull in [true, false] {
            stage.meshes.set_culling(cull);
            let map = MapConfig { size: 2048, ..MapConfig::default() };
            let mut technique = MapTechnique::plain(&gpu, &map).expect("a valid config");
            shots.push(stage.shoot(&gpu, &light, &mut technique, 0).expect("a shot"));
        }
        assert!(
            shots[0].counters["map_triangles"] < shots[1].counters["map_triangles"],
            "{light:?}: the floor is drawn"
        );
        // With the floor in it a map's window is larger and its texels are others, so that pixels along
        // the shadows' edges differ.
        let pairs = shots[0].visibility.iter().zip(&shots[1].visibility);
        let differ = pairs.filter(|(a, b)| a != b).count();
        assert!(50 * differ < shots[0].visibility.len(), "{light:?}: {differ} pixels differ");
    }
}

#[test]
fn without_casters_all_is_lit_and_nothing_is_allocated_or_drawn() {
    let gpu = gpu();
    let floor_only = generate::grazing_plane(0.0);
    for scene in [Scene::default(), floor_only] {
        let meshes = MeshSet::new(&gpu, &scene).expect("a valid scene");
        let samples = ViewSamples::new(&gpu, 16, 16).expect("a valid size");
        let positions: Vec<Vec3> = (0..256)
            .map(|i| Vec3::new((i % 16) as f32 - 8.0, 0.0, (i / 16) as f32 - 8.0))
            .collect();
        samples.write(&gpu, &positions, &[Vec3::Y; 256]).expect("lists that fit");
        for (turn, kind) in LightKind::ALL.into_iter().enumerate() {
            let light = generate::cube_on_floor().place_light(kind);
            let frame = Frame {
                samples: &samples,
                camera: None,
                light: &light,
                casters: &meshes,
                origin: meshes.origin(),
            };
            for config in one_in(3, turn, techniques(1024)).filter(has_map) {
                let mut technique = config.build(&gpu).expect("a valid config");
                let visibility = run(&gpu, &frame, technique.as_mut());
                assert!(visibility.iter().all(|v| *v == 1.0), "{config:?}, {kind:?}: not all lit");
                let counters = technique.counters();
                assert_eq!(counters["map_draws"], 0, "{config:?}, {kind:?}: draws");
                assert_eq!(counters["map_passes"], 0, "{config:?}, {kind:?}: passes");
                // Matrices, uniforms and tables of fixed length, and no layer of 4 MiB, nor one of a 64th of that.
                assert!(technique.bytes() < 65536, "{config:?}: {} bytes", technique.bytes());
            }
        }
    }
}

#[test]
fn runs_are_bit_identical_also_on_a_new_device() {
    let results: Vec<Vec<Vec<f32>>> = (0..2)
        .map(|_| {
            let gpu = gpu();
            let scene = scene();
            let stage = stage(&gpu, &scene);
            let mut all = Vec::new();
            for (turn, light) in lights(&scene).into_iter().enumerate() {
                for config in one_in(3, turn, every_technique(256)) {
                    let first = shoot(&gpu, &stage, &light, &config);
                    let second = shoot(&gpu, &stage, &light, &config);
                    assert!(first == second, "{config:?}, {light:?}: two runs differ");
                    all.push(first);
                }
            }
            all
        })
        .collect();
    assert!(results[0] == results[1], "two devices differ");
}

#[test]
fn a_steady_frame_allocates_nothing() {
    let gpu = gpu();
    let scene = scene();
    let stage = stage(&gpu, &scene);
    let map = MapConfig { size: 512, ..MapConfig::default() };
    let estimator = PcfGrid::default().estimator().expect("a valid config");
    let grid = MapTechnique::new(&gpu, &map, estimator).expect("a valid config");
    let plain = MapTechnique::plain(&gpu, &map).expect("a valid config");
    for mut technique in [grid, plain] {
        for light in lights(&scene) {
            let frame = stage.frame(&light);
            run(&gpu, &frame, &mut technique);
            let (bytes, texture) = (technique.bytes(), technique.map().texture().cloned());
            assert!(texture.is_some() && bytes >= 512 * 512 * 4, "{light:?}: {bytes} bytes");
            run(&gpu, &frame, &mut technique);
            assert_eq!(technique.bytes(), bytes, "{light:?}: bytes");
            assert_eq!(technique.map().texture(), texture.as_ref(), "{light:?}: the texture");
        }
    }
    // Every technique, by its bytes.
    for (turn, light) in lights(&scene).into_iter().enumerate() {
        for config in one_in(3, turn, every_technique(256)) {
            let mut technique = config.build(&gpu).expect("a valid config");
            let frame = stage.frame(&light);
            run(&gpu, &frame, technique.as_mut());
            let bytes = technique.bytes();
            run(&gpu, &frame, technique.as_mut());
            assert_eq!(technique.bytes(), bytes, "{config:?}, {light:?}: bytes");
        }
    }
}

/// Number of pixels whose visibility differs by more than 1/256, at most, and the technique, one in three of all.
fn differing(
    gpu: &Gpu,
    turn: usize,
    a: (&Stage, &Light),
    b: (&Stage, &Light),
) -> (usize, &'static str) {
    let counts = one_in(3, turn, every_technique(256)).map(|config| {
        let pair = shoot(gpu, a.0, a.1, &config).into_iter().zip(shoot(gpu, b.0, b.1, &config));
        (pair.filter(|(a, b)| (a - b).abs() > 1.0 / 256.0).count(), config.id())
    });
    counts.max().unwrap_or_default()
}

#[test]
fn far_from_the_origin_masks_are_the_same() {
    let gpu = gpu();
    let scene = scene();
    let offset = DVec3::new(1e5, 0.0, 1e5);
    let (near, far) = (stage(&gpu, &scene), stage(&gpu, &scene.translated(offset)));
    assert_eq!(far.triangles.origin, offset, "the grid of origins holds the offset exactly");
    for (turn, light) in lights(&scene).into_iter().enumerate() {
        let moved = light.translated(offset);
        let (differ, id) = differing(&gpu, turn, (&near, &light), (&far, &moved));
        assert_eq!(differ, 0, "{id}, {light:?}: pixels differ after a move of 141 km");
    }
    // The control: a light that did not come along to the centimetre.
    let light = scene.place_light(LightKind::Point);
    let astray = light.translated(offset + 0.01 * DVec3::X);
    let (differ, _) = differing(&gpu, 0, (&near, &light), (&far, &astray));
    assert!(differ > 0, "a light that is off by 1 cm goes unnoticed");
}

#[test]
fn masks_do_not_depend_on_the_unit_of_length() {
    let gpu = gpu();
    let scene = scene();
    let one = stage(&gpu, &scene);
    for scale in [1e-3, 1e3] {
        let other = stage(&gpu, &scaled(&scene, scale));
        for (turn, light) in lights(&scene).into_iter().enumerate() {
            let there = (&other, &scaled_light(&light, scale));
            let (differ, id) = differing(&gpu, turn, (&one, &light), there);
            // All roundings are others: the camera's raster moves by 2^-24 of the picture, and a sample within
            // as much of a shadow's or an object's edge may change sides. Of 16384 pixels, 4 may.
            assert!(differ <= 4, "{id}, {light:?} x {scale}: {differ} pixels differ");
        }
    }
}

fn scaled(scene: &Scene, by: f64) -> Scene {
    let mut scaled = scene.clone();
    for instance in &mut scaled.instances {
        instance.transform = DAffine3::from_scale(DVec3::splat(by)) * instance.transform;
    }
    scaled.camera = scaled.camera.map(|mut camera| {
        camera.eye *= by;
        camera.target *= by;
        camera.near *= by;
        camera
    });
    scaled
}

fn scaled_light(light: &Light, by: f64) -> Light {
    let mut scaled = *light;
    match &mut scaled {
        Light::Directional { .. } => {}
        Light::Point { position } | Light::Spot { position, .. } => *position *= by,
        Light::Sphere { center, radius } | Light::Disc { center, radius, .. } => {
            *center *= by;
            *radius *= by;
        }
        Light::Rect { center, half_u, half_v } => {
            *center *= by;
            *half_u *= by;
            *half_v *= by;
        }
    }
    scaled
}

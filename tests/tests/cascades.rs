//! Cascades: selection, splits that do not show, casters that are kept, shadows that stand still, and any technique.

use antumbra::{Config, catalogue};
use antumbra_gpu::{Gpu, GpuError, Technique, TechniqueConfig};
use antumbra_map::{FittedView, MapConfig, MapTechnique, Plain, TexelOnScreen};
use antumbra_measure::Stage;
use antumbra_reference::{SampleClass, TruthOptions, ViewSample};
use antumbra_sampling::twin::{Choice, choose};
use antumbra_sampling::{CascadeFit, Cascades, Lispsm, Psm, Sdsm, Select, Splits, Tsm};
use antumbra_scene::generate::{self, shapes};
use antumbra_scene::{Camera, Light, Scene};
use antumbra_tests::gpu;
use glam::{DAffine3, DVec2, DVec3, Vec3};

const MAP: u32 = 512;

fn built(gpu: &Gpu, config: &Cascades<()>, size: u32) -> MapTechnique {
    MapTechnique::plain(gpu, &MapConfig { size, ..MapConfig::default() })
        .expect("a valid config")
        .rearranged(|others| config.arrange(others))
        .expect("valid settings")
}

fn cascades() -> Cascades<()> {
    Cascades::default()
}

/// Looks along -z, from a man's height.
fn ahead() -> Camera {
    let eye = DVec3::new(0.0, 1.7, 0.0);
    Camera { eye, target: eye - DVec3::Z, up: DVec3::Y, fov_y: 2.0 * 0.5_f64.atan(), near: 1.0 }
}

fn overhead() -> Light {
    Light::Directional { direction: DVec3::NEG_Y, angular_diameter: 0.0 }
}

fn plate(scene: &mut Scene, min: DVec3, max: DVec3) {
    scene.add(shapes::cuboid(min, max), DAffine3::IDENTITY);
}

/// A ground, and plates above it that cover the same share of the picture each, to 90 m.
fn plates() -> Scene {
    let mut scene = Scene::default();
    scene.add(shapes::floor(120.0), DAffine3::IDENTITY);
    for k in 0..15 {
        let z = 4.0 * 1.25_f64.powi(k);
        let x = if k % 2 == 0 { 0.25 * z } else { -0.25 * z };
        let (center, half) = (DVec3::new(x, 0.4, -z), 0.03 * z);
        plate(
            &mut scene,
            center - DVec3::new(half, 0.01, half),
            center + DVec3::new(half, 0.0, half),
        );
    }
    scene
}

fn on_floor(points: impl Iterator<Item = DVec3>) -> Vec<ViewSample> {
    points.map(|p| ViewSample { position: p.as_vec3(), normal: Vec3::Y }).collect()
}

/// Evenly spread numbers (Roberts 2018).
fn spread(count: usize) -> impl Iterator<Item = DVec2> {
    let g = DVec2::new(0.754_877_666_246_692_8, 0.569_840_290_998_053_3);
    (1..=count).map(move |i| (g * i as f64).fract())
}

/// Points of the floor that `camera` sees, from 3 m to 80 m, as many a depth.
fn seen_floor(count: usize) -> Vec<ViewSample> {
    on_floor(spread(count).map(|u| {
        let z = 3.5 * (80.0_f64 / 3.5).powf(u.y);
        DVec3::new((u.x - 0.5) * 0.95 * z, 0.0, -z)
    }))
}

/// All selections and fits.
fn variants() -> Vec<Cascades<()>> {
    let mut all = Vec::new();
    for select in [Select::Map, Select::Depth] {
        for fit in [CascadeFit::Steady, CascadeFit::Tight, CascadeFit::Warped] {
            all.push(Cascades { select, fit, ..cascades() });
        }
    }
    all
}

#[test]
fn the_chosen_cascade_is_that_of_the_twin() {
    let gpu = gpu();
    let scene = plates();
    let stage = Stage::new(&gpu, &scene, ahead(), 128, 128).expect("a stage");
    let light = Light::sun(1.0, 0.4, 0.0);
    let camera = *stage.camera().expect("a camera");
    for config in variants() {
        let config = Cascades { splits: Splits::Logarithmic, ..config };
        let mut technique = built(&gpu, &config, MAP);
        stage.shoot(&gpu, &light, &mut technique, 0).expect("a shot");
        let map = technique.map();
        let layout = map.arrange().layout(&light);
        let sampling = stage.sampling(&gpu, layout, map.views(), MAP).expect("measured");
        let (mut compared, mut each) = (0, [0; 4]);
        for (sample, sides) in stage.view_samples().iter().zip(&sampling.sides) {
            let (p, n) = (sample.position.as_dvec3(), sample.normal.as_dvec3());
            if sides.max_element() == 0.0 {
                continue;
            }
            // The choice may differ within rounding of a border; there either is right.
            let beside = |d: f64| choose(config.select, 4, map.views(), p + d * DVec3::ONE).first;
            let choice = beside(0.0);
            if beside(1e-3) != choice || beside(-1e-3) != choice {
                continue;
            }
            let clip = map.views()[choice].clip.expect("a cascade that is looked up");
            let twin =
                TexelOnScreen::new(&camera.clip, DVec2::splat(128.0), &clip, MAP.into(), p, n);
            let off = (sides.as_dvec2() - twin.sides()).abs().max_element();
            // Cascades differ by tens of percent, roundings by far less.
            assert!(
                off <= 0.01 * twin.sides().max_element(),
                "{config:?} at {p}: {sides}, not {}",
                twin.sides()
            );
            compared += 1;
            each[choice] += 1;
        }
        assert!(compared > 4000, "{config:?}: {compared} compared");
        assert!(each.iter().filter(|n| **n > 100).count() >= 3, "{config:?}: {each:?}");
    }
}

#[test]
fn by_map_texels_are_never_larger_than_by_depth_and_more_cascades_make_them_smaller() {
    let gpu = gpu();
    let scene = plates();
    let stage = Stage::new(&gpu, &scene, ahead(), 128, 128).expect("a stage");
    let light = Light::sun(0.9, 0.4, 0.0);
    let median = |config: &Cascades<()>| {
        let mut technique = built(&gpu, config, MAP);
        stage.shoot(&gpu, &light, &mut technique, 0).expect("a shot");
        let map = technique.map();
        let layout = map.arrange().layout(&light);
        let sampling = stage.sampling(&gpu, layout, map.views(), MAP).expect("measured");
        [0.5, 0.9, 0.99].map(|share| sampling.quantile(share).expect("samples"))
    };
    for fit in [CascadeFit::Steady, CascadeFit::Tight] {
        let [by_map, by_depth] = [Select::Map, Select::Depth]
            .map(|select| median(&Cascades { select, fit, ..cascades() }));
        for (map, depth) in by_map.iter().zip(by_depth) {
            // A tight window may be wider than that of the slice behind it.
            let slack = if fit == CascadeFit::Tight { 1.01 } else { 1.0001 };
            assert!(*map <= depth * slack, "{fit:?}: {by_map:?} by map, {by_depth:?} by depth");
        }
        let by_count = [1, 2, 4, 8].map(|count| median(&Cascades { count, fit, ..cascades() }));
        // Two slices may both be as wide as all that casts.
        for pair in by_count.windows(2) {
            assert!(pair[1][1] <= pair[0][1], "{fit:?}: {by_count:?}");
        }
        assert!(by_count[3][1] < 0.5 * by_count[0][1], "{fit:?}: {by_count:?}");
    }
}

/// Visibility at the stage's samples.
fn shoot(gpu: &Gpu, stage: &Stage, light: &Light, technique: &mut dyn Technique) -> Vec<f32> {
    stage.shoot(gpu, light, technique, 0).expect("a shot").visibility
}

/// A long plate whose border, turned by 0.3 about the y axis, goes away from the eye.
fn edge_turn() -> glam::DQuat {
    glam::DQuat::from_rotation_y(0.3)
}

#[test]
fn a_straight_edge_is_no_worse_at_a_split_than_elsewhere() {
    let gpu = gpu();
    let turn = edge_turn();
    let mut scene = Scene::default();
    scene.add(shapes::floor(160.0), DAffine3::IDENTITY);
    scene.add(
        shapes::cuboid(DVec3::new(0.0, 3.0, -150.0), DVec3::new(100.0, 3.1, 10.0)),
        DAffine3::from_quat(turn),
    );
    // Off the edge by up to 2 % of the depth to either side.
    let samples: Vec<(f64, DVec3)> = spread(1 << 16)
        .map(|u| {
            let z = 3.5 * (90.0_f64 / 3.5).powf(u.y);
            let x = (u.x - 0.5) * 0.04 * z;
            (x, turn * DVec3::new(x, 0.0, -z))
        })
        .collect();
    let eye = DVec3::new(0.0, 1.7, 0.0);
    let camera = Camera { eye, target: eye - turn * DVec3::Z, ..ahead() };
    let points = on_floor(samples.iter().map(|s| s.1));
    let stage = Stage::seen(&gpu, &scene, &camera, (256, 256), &points).expect("a stage");
    for select in [Select::Map, Select::Depth] {
        for fit in [CascadeFit::Steady, CascadeFit::Tight] {
            let config = Cascades { select, fit, splits: Splits::Logarithmic, ..cascades() };
            let mut technique = built(&gpu, &config, MAP);
            let found = shoot(&gpu, &stage, &overhead(), &mut technique);
            let views = technique.map().views().to_vec();
            // Error in metres of the floor across the edge, a cascade; and where two are blended, by the coarser.
            let (mut whole, mut blended) = ([(0.0, 0.0); 4], [(0.0, 0.0); 4]);
            for ((x, p), v) in samples.iter().zip(&found) {
                let truth = if *x > 0.0 { 0.0 } else { 1.0 };
                let wrong = (f64::from(*v) - truth).abs() * 0.04 * p.length();
                let Choice { first, second, .. } = choose(select, 4, &views, *p);
                let kept = if first == second { &mut whole[first] } else { &mut blended[second] };
                *kept = (kept.0 + wrong, kept.1 + 1.0);
            }
            let mean = |sums: (f64, f64)| sums.0 / sums.1;
            let mut bands = 0;
            for i in 1..4 {
                if blended[i].1 < 500.0 || whole[i].1 < 500.0 {
                    continue;
                }
                bands += 1;
                let (at, elsewhere) = (mean(blended[i]), mean(whole[i]));
                assert!(
                    at <= 1.1 * elsewhere,
                    "{config:?}, cascade {i}: {at} m at its split, {elsewhere} m elsewhere"
                );
                assert!(elsewhere > 0.0, "{config:?}: an edge without a texel");
            }
            assert!(bands >= 2, "{config:?}: {bands} splits seen");
        }
    }
}

/// Share of the samples, not near a shadow's edge, that are off by more than half.
fn wrong_share(
    gpu: &Gpu,
    stage: &Stage,
    light: &Light,
    technique: &mut dyn Technique,
    near: f64,
) -> f64 {
    let found = shoot(gpu, stage, light, technique);
    let samples = stage.view_samples();
    let truth = stage.tracer().truth(light, &samples, &TruthOptions::default());
    let around = (0..24).map(|k| {
        let (angle, radius) =
            (f64::from(k % 8) * std::f64::consts::FRAC_PI_4, f64::from(1 + k / 8) / 3.0);
        DVec3::new(angle.cos(), 0.0, angle.sin()) * (radius * near)
    });
    let beside: Vec<Vec<f32>> = around
        .map(|d| {
            let moved: Vec<ViewSample> = samples
                .iter()
                .map(|s| ViewSample { position: s.position + d.as_vec3(), ..*s })
                .collect();
            stage.tracer().truth(light, &moved, &TruthOptions::default()).visibility
        })
        .collect();
    let (mut wrong, mut all) = (0, 0);
    for i in 0..samples.len() {
        let at = truth.visibility[i];
        if truth.class[i] != SampleClass::Counted || beside.iter().any(|b| b[i] != at) {
            continue;
        }
        all += 1;
        wrong += usize::from((found[i] - at).abs() > 0.5);
    }
    assert!(all > 1000, "only {all} samples judged");
    f64::from(wrong as u32) / f64::from(all as u32)
}

#[test]
fn casters_far_outside_of_the_view_are_kept() {
    let gpu = gpu();
    // A slab high above and behind, and a triangle of 1 km that crosses every slice and the eye's plane.
    let mut slab = plates();
    plate(&mut slab, DVec3::new(-100.0, 299.5, 50.0), DVec3::new(100.0, 300.5, 250.0));
    let slanting = Light::Directional {
        direction: DVec3::new(0.0, -1.0, -0.5).normalize(),
        angular_diameter: 0.0,
    };
    let mut triangle = plates();
    triangle.add(
        antumbra_scene::Mesh {
            positions: vec![
                Vec3::new(-500.0, 0.5, -10.0),
                Vec3::new(500.0, 0.5, -10.0),
                Vec3::new(0.0, 800.0, 500.0),
            ],
            triangles: vec![[0, 1, 2]],
            name: String::new(),
        },
        DAffine3::IDENTITY,
    );
    for (scene, light) in [(slab, slanting), (triangle, overhead())] {
        let stage =
            Stage::seen(&gpu, &scene, &ahead(), (64, 64), &seen_floor(4096)).expect("a stage");
        let dark = stage.truth(&light, &TruthOptions::default());
        let share = dark.visibility.iter().filter(|v| **v == 0.0).count();
        assert!(share > 1000, "the casters shadow {share} samples");
        for config in variants() {
            let mut technique = built(&gpu, &config, MAP);
            let wrong = wrong_share(&gpu, &stage, &light, &mut technique, 2.0);
            assert!(wrong == 0.0, "{config:?}: {wrong} of the samples");
        }
        let of = Plain { map: MapConfig { size: MAP, ..MapConfig::default() } };
        let others: [&dyn TechniqueConfig; 5] = [
            &Sdsm { of, ..Default::default() },
            &Sdsm { of, clusters: true, ..Default::default() },
            &Lispsm { of, ..Default::default() },
            &Tsm { of, ..Default::default() },
            &Psm { of, ..Default::default() },
        ];
        for (number, config) in others.into_iter().enumerate() {
            let mut technique = config.build(&gpu).expect("a valid config");
            let wrong = wrong_share(&gpu, &stage, &light, technique.as_mut(), 2.0);
            assert!(wrong == 0.0, "{number}: {wrong} of the samples");
        }
    }
}

/// Cubes over a floor.
fn field() -> Scene {
    let mut scene = Scene::default();
    scene.add(shapes::floor(60.0), DAffine3::IDENTITY);
    for (x, z) in (-8..=8).flat_map(|x| (-8..=8).map(move |z| (f64::from(x), f64::from(z)))) {
        let center = DVec3::new(5.0 * x + 0.7 * z, 1.5, 5.0 * z);
        plate(&mut scene, center - 0.5, center + 0.5);
    }
    scene
}

/// Largest number of samples in view that change from a frame to the next while they stay in one cascade, and how many
/// do stay.
fn flicker(
    gpu: &Gpu,
    offset: DVec3,
    config: &Cascades<()>,
    camera: impl Fn(u32) -> Camera,
) -> (usize, usize) {
    let mut scene = field();
    for instance in &mut scene.instances {
        instance.transform.translation += offset;
    }
    let origin = scene.origin();
    let points = on_floor(spread(1 << 14).map(|u| {
        let p = (u - 0.5) * 24.0;
        DVec3::new(p.x, 0.0, p.y - 14.0) + offset - origin
    }));
    let mut stage = Stage::at_points(gpu, &scene, &points).expect("a stage");
    let light = Light::sun(0.8, 0.3, 0.0);
    let count = config.count as usize;
    let mut technique = built(gpu, config, 1024);
    let mut before: Option<(Vec<f32>, Vec<Option<Choice>>)> = None;
    let (mut most, mut least) = (0, usize::MAX);
    for frame in 0..12 {
        let view = stage.meshes.view_camera(&camera(frame).translated(offset), (64, 64));
        stage.set_camera(Some(view));
        let found = shoot(gpu, &stage, &light, &mut technique);
        let views = technique.map().views();
        // Of what is out of view, casters may be left out.
        let choice = |s: &ViewSample| {
            let p = s.position.as_dvec3();
            let c = view.clip * p.extend(1.0);
            let seen = c.w > 0.0 && c.truncate().truncate().abs().max_element() <= c.w;
            seen.then(|| choose(config.select, count, views, p)).filter(|c| c.weight == 1.0)
        };
        let choices: Vec<Option<Choice>> = points.iter().map(choice).collect();
        if let Some((was, were)) = &before {
            let stay = |i: &usize| were[*i].is_some() && were[*i] == choices[*i];
            let kept: Vec<usize> = (0..points.len()).filter(stay).collect();
            most = most.max(kept.iter().filter(|i| was[**i] != found[**i]).count());
            least = least.min(kept.len());
        }
        before = Some((found, choices));
    }
    (most, least)
}

fn turning(frame: u32) -> Camera {
    let angle = 0.013 * f64::from(frame);
    let eye = DVec3::new(0.0, 6.0, 6.0);
    let target = eye + DVec3::new(angle.sin(), -0.35, -angle.cos());
    Camera { eye, target, up: DVec3::Y, fov_y: 1.2, near: 0.5 }
}

fn creeping(frame: u32) -> Camera {
    // 0.37 of the finest cascade's texels, about.
    let along = f64::from(frame) * 0.37 * 0.015;
    turning(0).translated(DVec3::new(along, 0.0, 0.4 * along))
}

#[test]
fn shadows_stand_still_while_the_camera_turns_and_creeps() {
    let gpu = gpu();
    for offset in [DVec3::ZERO, DVec3::new(1e6, 0.0, 1e6)] {
        for select in [Select::Map, Select::Depth] {
            for count in [1, 4] {
                let config = Cascades { select, count, ..cascades() };
                for (name, camera) in
                    [("turns", turning as fn(u32) -> Camera), ("creeps", creeping)]
                {
                    let (changed, kept) = flicker(&gpu, offset, &config, camera);
                    assert!(kept > 4000, "{config:?}: {kept} samples stay in their cascade");
                    assert_eq!(changed, 0, "{config:?} at {offset}: the camera {name}");
                }
            }
        }
    }
}

/// The control of the test above.
#[test]
fn shadows_swim_in_windows_that_follow_what_is_seen() {
    let gpu = gpu();
    let config = Cascades { fit: CascadeFit::Warped, ..cascades() };
    let (changed, _) = flicker(&gpu, DVec3::ZERO, &config, turning);
    assert!(changed > 4, "{changed} samples");
}

#[test]
fn every_technique_over_a_map_runs_over_cascades_and_the_others_are_refused() {
    let gpu = gpu();
    let scene = field();
    let stage = Stage::new(&gpu, &scene, turning(0), 96, 96).expect("a stage");
    let light = Light::sun(0.8, 0.3, 0.0);
    let truth = stage.truth(&light, &TruthOptions::default());
    let error = |config: &Config| -> Option<f64> {
        let mut technique = config.build(&gpu).ok()?;
        let found = shoot(&gpu, &stage, &light, technique.as_mut());
        assert!(found.iter().all(|v| (0.0..=1.0).contains(v)), "{}: no visibility", config.id());
        let judged = (0..found.len()).filter(|i| truth.class[*i] == SampleClass::Counted);
        let (sum, count) = judged.fold((0.0, 0.0), |(sum, count), i| {
            (sum + f64::from((found[i] - truth.visibility[i]).abs()), count + 1.0)
        });
        Some(sum / count)
    };
    let mut over = 0;
    for mut of in catalogue().into_iter().filter(|of| !of.id().starts_with("sampling/")) {
        of.set_map_size(256);
        let of = Box::new(of);
        let cascaded = Config::Cascades(Cascades {
            of: of.clone(),
            count: 4,
            splits: Splits::default(),
            select: Select::Map,
            blend: 0.1,
            fit: CascadeFit::Steady,
        });
        // Joined taps are a pass of their own behind the map's.
        let outside = ["map/planar", "map/shadow-texture", "map/disc", "filter/interleaved"];
        if outside.contains(&of.id()) || of.id().starts_with("volume/") {
            let refused = cascaded.build(&gpu).err();
            assert!(matches!(refused, Some(GpuError::Invalid { .. })), "{} was taken", of.id());
            continue;
        }
        let single = error(&of).expect("a valid config");
        let cascades = error(&cascaded).unwrap_or_else(|| panic!("{} over cascades", of.id()));
        over += 1;
        // Bounds gain less: of what they leak most does not go with the texel. What averages depths before it compares
        // is wrong by its kernel: finer texels do not help it, and not to be much worse is all that is asked.
        let averages = ["filter/blurred-depth", "filter/soft-comparison"].contains(&of.id());
        let most = if averages { 1.1 } else { 0.9 };
        assert!(
            cascades < most * single,
            "{}: {cascades} with cascades, {single} without",
            of.id()
        );
    }
    assert!(over >= 15, "{over} techniques over a map");
}

#[test]
fn without_a_camera_or_with_nothing_in_view_there_is_one_map_or_none() {
    let gpu = gpu();
    let scene = field();
    let light = Light::sun(0.8, 0.3, 0.0);
    let points = seen_floor(1024);
    let plain: &dyn TechniqueConfig =
        &Plain { map: MapConfig { size: MAP, ..MapConfig::default() } };
    let stage = Stage::at_points(&gpu, &scene, &points).expect("a stage");
    let single = shoot(&gpu, &stage, &light, plain.build(&gpu).expect("valid").as_mut());
    for config in variants() {
        let mut technique = built(&gpu, &config, MAP);
        assert_eq!(shoot(&gpu, &stage, &light, &mut technique), single, "{config:?}: no camera");
        let filled = |views: &[FittedView]| views.iter().filter(|v| v.clip.is_some()).count();
        assert_eq!(filled(technique.map().views()), 1, "{config:?}: one map");
        // Looking up, nothing is seen: no map, no pass, and an answer all the same.
        let up = Camera { target: DVec3::new(0.0, 50.0, -1.0), ..ahead() };
        let stage = Stage::new(&gpu, &scene, up, 32, 32).expect("a stage");
        let sky = shoot(&gpu, &stage, &light, &mut technique);
        assert!(sky.iter().all(|v| *v == 1.0), "{config:?}: sky");
        // One wall that fills the picture: a depth range of no length.
        let mut wall = Scene::default();
        plate(&mut wall, DVec3::new(-40.0, -40.0, -10.1), DVec3::new(40.0, 40.0, -10.0));
        let stage = Stage::new(&gpu, &wall, ahead(), 32, 32).expect("a stage");
        let lit = shoot(&gpu, &stage, &Light::sun(0.3, 0.2, 0.0), &mut technique);
        assert!(lit.iter().all(|v| *v == 1.0), "{config:?}: a wall");
        assert!(
            technique.map().views().iter().filter_map(|v| v.clip).all(|c| c.is_finite()),
            "{config:?}"
        );
    }
}

#[test]
fn generated_scenes_are_as_right_as_with_one_map_under_every_light() {
    let gpu = gpu();
    let scene = generate::sphere_over_plane(&Default::default());
    let stage = Stage::new(&gpu, &scene, scene.camera_or_framing(), 96, 96).expect("a stage");
    for light in antumbra_scene::LightKind::ALL.map(|kind| scene.place_light(kind)) {
        let plain: &dyn TechniqueConfig =
            &Plain { map: MapConfig { size: MAP, ..MapConfig::default() } };
        let single = shoot(&gpu, &stage, &light, plain.build(&gpu).expect("valid").as_mut());
        for config in variants() {
            let found = shoot(&gpu, &stage, &light, &mut built(&gpu, &config, MAP));
            let off = found.iter().zip(&single).filter(|(a, b)| (*a - *b).abs() > 0.5).count();
            // Only edges may differ.
            assert!(off < 200, "{config:?} under {light:?}: {off} of {} samples", found.len());
            if light.position().is_some() {
                assert_eq!(found, single, "{config:?}: lights of a place have no cascades");
            }
        }
    }
}

/// A scene no wider than the last cascades is shared out among them: their texels are finer than those of one map that
/// is fitted to what is seen, and no camera moves them.
#[test]
fn cascades_that_would_be_the_same_share_their_window_out() {
    let gpu = gpu();
    let scene = generate::by_name("tree").expect("a generated scene");
    let stage = Stage::new(&gpu, &scene, scene.camera_or_framing(), 128, 128).expect("a stage");
    let light = scene.place_light(antumbra_scene::LightKind::Directional);
    let measured = |technique: &mut MapTechnique| {
        stage.shoot(&gpu, &light, technique, 0).expect("a shot");
        let map = technique.map();
        let layout = map.arrange().layout(&light);
        let sampling = stage.sampling(&gpu, layout, map.views(), MAP).expect("measured");
        [0.5, 0.9, 0.99].map(|share| sampling.quantile(share).expect("samples"))
    };
    let map = MapConfig { size: MAP, ..MapConfig::default() };
    let single = measured(&mut MapTechnique::plain(&gpu, &map).expect("a valid config"));
    let mut before = [f32::INFINITY; 3];
    for count in [1, 2, 4, 8] {
        let mut technique = built(&gpu, &Cascades { count, ..cascades() }, MAP);
        let found = measured(&mut technique);
        assert!((0..3).all(|i| found[i] <= before[i]), "{count}: {found:?}, before {before:?}");
        before = found;
        // Every point that casters may shadow is in some window, a kernel's reach off its border.
        let views = technique.map().views();
        let border = views[count as usize].light.x;
        let hull = technique.map().hull();
        let inner = |p: DVec3| {
            views[..count as usize].iter().filter_map(|v| v.clip).any(|clip| {
                let c = clip * p.extend(1.0);
                c.x.abs().max(c.y.abs()) <= border * (1.0 + 1e-9)
            })
        };
        let center = hull.iter().sum::<DVec3>() / hull.len() as f64;
        for u in spread(2000) {
            let p = center.lerp(hull[(u.x * hull.len() as f64) as usize % hull.len()], u.y);
            assert!(inner(p), "{count}: {p} is nowhere");
        }
        if count >= 4 {
            assert!(
                (0..3).all(|i| found[i] < single[i]),
                "{count} cascades: {found:?}, one map {single:?}"
            );
        }
    }
}

/// As above, with a scene that is so small that all cascades are tiles of one window.
#[test]
fn shadows_stand_still_in_tiles() {
    let gpu = gpu();
    for count in [2, 4, 8] {
        let far = |frame: u32| turning(frame).translated(DVec3::new(0.0, 60.0, 90.0));
        let config = Cascades { count, splits: Splits::Practical { weight: 0.0 }, ..cascades() };
        let (changed, kept) = flicker(&gpu, DVec3::ZERO, &config, far);
        assert!(kept > 4000, "{count}: {kept} samples stay in their cascade");
        assert_eq!(changed, 0, "{count} cascades");
    }
}

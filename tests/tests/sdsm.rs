//! Cascades measured on the GPU: windows against brute force, gaps in depth, and views of nothing.

use antumbra::Config;
use antumbra_gpu::{Gpu, Technique, read_buffer};
use antumbra_map::{FittedView, MapConfig, MapTechnique};
use antumbra_measure::{Sampling, Stage};
use antumbra_reference::{SampleClass, TruthOptions, ViewSample};
use antumbra_sampling::{Cascades, Sdsm, Select};
use antumbra_scene::generate::shapes;
use antumbra_scene::{Camera, Light, Scene};
use antumbra_tests::gpu;
use glam::{DAffine3, DMat4, DVec2, DVec3, Mat4, Vec3};

const MAP: u32 = 512;
const SIDE: u32 = 128;

fn plain(gpu: &Gpu) -> MapTechnique {
    let map = MapConfig { size: MAP, ..MapConfig::default() };
    MapTechnique::plain(gpu, &map).expect("a valid config")
}

fn measured(gpu: &Gpu, config: &Sdsm<()>) -> MapTechnique {
    plain(gpu).rearranged(|others| config.arrange(others)).expect("valid settings")
}

fn camera(near: f64) -> Camera {
    let eye = DVec3::new(0.0, 1.7, 0.0);
    Camera { eye, target: eye - DVec3::Z, up: DVec3::Y, fov_y: 2.0 * 0.5_f64.atan(), near }
}

fn sun() -> Light {
    Light::sun(0.9, 0.4, 0.0)
}

fn cuboid(scene: &mut Scene, center: DVec3, half: DVec3) {
    scene.add(shapes::cuboid(center - half, center + half), DAffine3::IDENTITY);
}

/// Boxes from 5 m to 80 m on a ground.
fn boxes() -> Scene {
    let mut scene = Scene::default();
    scene.add(shapes::floor(100.0), DAffine3::IDENTITY);
    for k in 0..14 {
        let z = 5.0 * 1.24_f64.powi(k);
        let half = DVec3::splat(0.06 * z);
        cuboid(
            &mut scene,
            DVec3::new(if k % 2 == 0 { 0.2 * z } else { -0.2 * z }, half.y, -z),
            half,
        );
    }
    scene
}

/// The views as the GPU has made them, with what follows them.
fn read_views(gpu: &Gpu, technique: &MapTechnique, count: usize) -> Vec<FittedView> {
    let views = technique.map().views();
    let buffer = technique.resolve().expect("prepared").views();
    let bytes = read_buffer(gpu, buffer, buffer.size()).expect("read back");
    let stride = bytes.len() / views.len();
    let drawn_by = technique.map().matrices();
    let matrices = read_buffer(gpu, drawn_by.0, drawn_by.0.size()).expect("read back");
    let matrix = |bytes: &[u8]| -> Mat4 { bytemuck::pod_read_unaligned(&bytes[..64]) };
    let mut read = views.to_vec();
    for i in 0..count {
        let clip = matrix(&bytes[i * stride..]);
        assert_eq!(clip, matrix(&matrices[i * drawn_by.1 as usize..]), "drawn as it is looked up");
        // Of a slice without a sample, the matrix that puts everything outside.
        let clip = clip.as_dmat4();
        read[i].clip = (clip.row(0).truncate() != DVec3::ZERO).then_some(clip);
    }
    read
}

fn sampling(gpu: &Gpu, stage: &Stage, technique: &MapTechnique, views: &[FittedView]) -> Sampling {
    let layout = technique.map().arrange().layout(&sun());
    stage.sampling(gpu, layout, views, MAP).expect("measured")
}

fn shoot(gpu: &Gpu, stage: &Stage, technique: &mut dyn Technique) -> Vec<f32> {
    stage.shoot(gpu, &sun(), technique, 0).expect("a shot").visibility
}

/// Unit axes of the map, from its matrix, and per axis the border and the texel in metres.
fn window(clip: &DMat4, axis: usize) -> (DVec3, f64, f64) {
    let row = clip.row(axis);
    let scale = row.truncate().length();
    let texel = 2.0 / (f64::from(MAP) * scale);
    (row.truncate() / scale, (-1.0 - row.w) / scale, texel)
}

#[test]
fn windows_are_those_of_brute_force() {
    let gpu = gpu();
    let scene = boxes();
    let stage = Stage::new(&gpu, &scene, camera(0.05), SIDE, SIDE).expect("a stage");
    let view = stage.camera().expect("a camera").clip;
    let config = Sdsm::default();
    let mut technique = measured(&gpu, &config);
    shoot(&gpu, &stage, &mut technique);
    let views = read_views(&gpu, &technique, 4);
    let hull = technique.map().hull();
    // Samples that casters may shadow, by depth.
    let first = views[0].clip.expect("samples in the first slice");
    let axes = [0, 1].map(|i| window(&first, i).0);
    let casters = axes.map(|a| {
        let along = hull.iter().map(|p| a.dot(*p));
        along.fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), v| (lo.min(v), hi.max(v)))
    });
    let samples: Vec<(f64, DVec2)> = stage
        .view_samples()
        .iter()
        .filter(|s| s.normal != Vec3::ZERO)
        .map(|s| s.position.as_dvec3())
        .map(|p| ((view * p.extend(1.0)).w, DVec2::new(axes[0].dot(p), axes[1].dot(p))))
        .filter(|(_, at)| (0..2).all(|i| at[i] >= casters[i].0 && at[i] <= casters[i].1))
        .collect();
    let depths = samples.iter().map(|s| s.0);
    let (near, far) = depths.fold((f64::INFINITY, 0.0_f64), |(lo, hi), z| (lo.min(z), hi.max(z)));
    assert!(near > 3.0 && far < 100.0, "{near} to {far}, not from the near plane on");
    let mut checked = 0;
    for (slice, view) in views.iter().take(4).enumerate() {
        let end = |i: usize| near * (far / near).powf(i as f64 / 4.0);
        // A sample may be on either side of an end that it is on.
        let within = |slack: f64| {
            samples
                .iter()
                .filter(move |(z, _)| {
                    *z >= end(slice) * (1.0 + slack) && *z < end(slice + 1) * (1.0 - slack)
                })
                .map(|s| s.1)
        };
        let clip = view.clip.expect("samples in every slice");
        let guard = f64::from(technique.map().guard());
        for i in 0..2 {
            let (axis, left, texel) = window(&clip, i);
            assert!(axis.distance(axes[i]) < 1e-6, "the same axes");
            let span = |slack: f64| {
                within(slack)
                    .map(|at| at[i])
                    .fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), v| (lo.min(v), hi.max(v)))
            };
            let (inner, outer) = (span(1e-5), span(-1e-5));
            let size = f64::from(MAP);
            // Rounded places, and a hundredth of a texel for the matrix.
            let off = 0.01 * texel;
            assert!(
                inner.0 >= left + guard * texel - off,
                "slice {slice}: {} before {left}",
                inner.0
            );
            assert!(
                inner.1 <= left + (size - guard) * texel + off,
                "slice {slice}: {} after",
                inner.1
            );
            // No wider than it takes, to a step.
            let needed = (outer.1 - outer.0) / (size - 2.0 * guard - 1.0);
            let most = needed * 2f64.powf(0.125) * 1.001;
            assert!(
                texel <= most && texel >= needed * 0.99,
                "slice {slice}: texels of {texel}, {needed} needed"
            );
            // Unless all that casts is no wider.
            let all = (casters[i].1 - casters[i].0) / (size - 2.0 * guard - 1.0);
            let on_grid = texel < 0.999 * all;
            assert!(
                !on_grid || outer.0 <= left + (guard + 1.0) * texel + off,
                "slice {slice}: the border is off"
            );
            checked += 1;
        }
    }
    assert_eq!(checked, 8, "all windows");
}

#[test]
fn texels_are_smaller_than_those_of_cascades_that_know_only_the_scene() {
    let gpu = gpu();
    let scene = boxes();
    let stage = Stage::new(&gpu, &scene, camera(0.05), SIDE, SIDE).expect("a stage");
    let quantiles =
        |sampling: Sampling| [0.5, 0.9, 0.99].map(|q| sampling.quantile(q).expect("samples"));
    let mut technique = measured(&gpu, &Sdsm::default());
    let sdsm_image = shoot(&gpu, &stage, &mut technique);
    let sdsm = quantiles(sampling(&gpu, &stage, &technique, &read_views(&gpu, &technique, 4)));
    let mut technique =
        plain(&gpu).rearranged(|others| Cascades::<()>::default().arrange(others)).expect("valid");
    let steady_image = shoot(&gpu, &stage, &mut technique);
    let steady = quantiles(sampling(&gpu, &stage, &technique, technique.map().views()));
    assert!((0..3).all(|i| sdsm[i] < 0.8 * steady[i]), "{sdsm:?} beside {steady:?}");
    let error = |found: &[f32]| {
        let truth = stage.truth(&sun(), &TruthOptions::default());
        let judged = (0..found.len()).filter(|i| truth.class[*i] == SampleClass::Counted);
        judged.map(|i| f64::from((found[i] - truth.visibility[i]).abs())).sum::<f64>()
    };
    let (measured, fixed) = (error(&sdsm_image), error(&steady_image));
    assert!(measured < fixed, "{measured} beside {fixed}");
}

/// A thing in the hand at 1.1 m, and a landscape from 400 m to 1000 m.
fn gap() -> (Scene, Camera) {
    let mut scene = Scene::default();
    let slope = DAffine3::from_rotation_x(0.35);
    scene.add(
        shapes::cuboid(DVec3::new(-600.0, -1.0, -450.0), DVec3::new(600.0, 0.0, 450.0)),
        DAffine3::from_translation(DVec3::new(0.0, -60.0, -700.0)) * slope,
    );
    for k in 0..60 {
        let t = f64::from(k);
        let at = slope.transform_point3(DVec3::new(
            (t * 0.618).fract() * 500.0 - 250.0,
            8.0,
            (t * 0.414).fract() * 700.0 - 350.0,
        ));
        cuboid(&mut scene, at + DVec3::new(0.0, -60.0, -700.0), DVec3::splat(8.0));
    }
    cuboid(&mut scene, DVec3::new(0.2, -0.2, -1.2), DVec3::splat(0.1));
    let camera =
        Camera { eye: DVec3::ZERO, target: -DVec3::Z, up: DVec3::Y, fov_y: 0.9, near: 0.1 };
    (scene, camera)
}

#[test]
fn clusters_spend_no_cascade_on_a_gap() {
    let gpu = gpu();
    let (scene, camera) = gap();
    let stage = Stage::new(&gpu, &scene, camera, SIDE, SIDE).expect("a stage");
    let view = stage.camera().expect("a camera").clip;
    let depths: Vec<f64> = stage
        .view_samples()
        .iter()
        .filter(|s| s.normal != Vec3::ZERO)
        .map(|s| (view * s.position.as_dvec3().extend(1.0)).w)
        .collect();
    assert!(depths.iter().all(|z| *z < 2.0 || *z > 300.0), "a gap");
    let filled = |clusters: bool| {
        let mut technique = measured(&gpu, &Sdsm { clusters, tiles: false, ..Sdsm::default() });
        shoot(&gpu, &stage, &mut technique);
        let views = read_views(&gpu, &technique, 4);
        let used = views.iter().take(4).filter(|v| v.clip.is_some()).count();
        let far = sampling(&gpu, &stage, &technique, &views).quantile(0.5).expect("samples");
        (used, far)
    };
    let (logarithmic, clustered) = (filled(false), filled(true));
    assert!(logarithmic.0 <= 2, "{} cascades on a range with a gap", logarithmic.0);
    assert_eq!(clustered.0, 4, "all cascades have samples");
    assert!(
        clustered.1 < 0.8 * logarithmic.1,
        "{} with clusters, {} without",
        clustered.1,
        logarithmic.1
    );
}

#[test]
fn no_sample_one_sample_and_one_depth_are_served() {
    let gpu = gpu();
    let scene = boxes();
    for clusters in [false, true] {
        let mut technique = measured(&gpu, &Sdsm { clusters, ..Sdsm::default() });
        // The sky.
        let up = Camera { target: DVec3::new(0.0, 50.0, -1.0), ..camera(0.05) };
        let stage = Stage::new(&gpu, &scene, up, 32, 32).expect("a stage");
        assert!(shoot(&gpu, &stage, &mut technique).iter().all(|v| *v == 1.0), "sky");
        // One sample, behind the first box and in its shadow.
        let truth = |stage: &Stage| stage.truth(&sun(), &TruthOptions::default()).visibility;
        let towards = sun().towards(DVec3::ZERO, DVec2::splat(0.5));
        let under = DVec3::new(1.0, 0.3, -5.0) - towards * (0.3 / towards.y);
        let point = ViewSample { position: under.as_vec3(), normal: Vec3::Y };
        let stage = Stage::seen(&gpu, &scene, &camera(0.05), (1, 1), &[point]).expect("a stage");
        assert_eq!(truth(&stage), [0.0], "in shadow");
        assert_eq!(shoot(&gpu, &stage, &mut technique), [0.0], "one sample");
        // A wall that fills the picture.
        let mut wall = Scene::default();
        cuboid(&mut wall, DVec3::new(0.0, 0.0, -10.05), DVec3::new(40.0, 40.0, 0.05));
        let stage = Stage::new(&gpu, &wall, camera(0.05), 32, 32).expect("a stage");
        let found = shoot(&gpu, &stage, &mut technique);
        let off = found.iter().zip(truth(&stage)).filter(|(a, b)| (*a - b).abs() > 0.5).count();
        assert_eq!(off, 0, "a wall");
        // And after all that the first scene as if nothing had been.
        let stage = Stage::new(&gpu, &scene, camera(0.05), SIDE, SIDE).expect("a stage");
        let again = shoot(&gpu, &stage, &mut technique);
        let fresh = shoot(&gpu, &stage, &mut measured(&gpu, &Sdsm { clusters, ..Sdsm::default() }));
        assert_eq!(again, fresh, "a frame leaves nothing behind");
    }
}

#[test]
fn filters_stores_and_ids_run_over_measured_cascades() {
    let gpu = gpu();
    let mut scene = Scene::default();
    scene.add(shapes::floor(60.0), DAffine3::IDENTITY);
    for (x, z) in (-8..=8).flat_map(|x| (-8..=8).map(move |z| (f64::from(x), f64::from(z)))) {
        cuboid(&mut scene, DVec3::new(5.0 * x + 0.7 * z, 1.5, 5.0 * z), DVec3::splat(0.5));
    }
    let eye = DVec3::new(0.0, 6.0, 6.0);
    let seen = Camera { eye, target: eye - DVec3::new(0.0, 0.35, 1.0), fov_y: 1.2, ..camera(0.05) };
    let stage = Stage::new(&gpu, &scene, seen, 96, 96).expect("a stage");
    let truth = stage.truth(&sun(), &TruthOptions::default());
    let error = |config: &Config| {
        let found = shoot(&gpu, &stage, config.build(&gpu).expect("a valid config").as_mut());
        assert!(found.iter().all(|v| (0.0..=1.0).contains(v)), "{}: no visibility", config.id());
        let judged = (0..found.len()).filter(|i| truth.class[*i] == SampleClass::Counted);
        judged.map(|i| f64::from((found[i] - truth.visibility[i]).abs())).sum::<f64>()
    };
    for id in [
        "map/plain",
        "map/midpoint",
        "map/object-id",
        "filter/pcf-castano",
        "filter/vsm",
        "filter/msm",
    ] {
        let mut of: Config =
            serde_json::from_str(&format!(r#"{{ "technique": "{id}" }}"#)).expect("known");
        of.set_map_size(256);
        let over = Config::Sdsm(Sdsm { of: Box::new(of.clone()), ..Default::default() });
        let (with, without) = (error(&over), error(&of));
        assert!(with < 0.8 * without, "{id}: {with} with measured cascades, {without} without");
    }
}

/// Root of the mean square of the error.
fn rmse(stage: &Stage, found: &[f32]) -> f64 {
    let truth = stage.truth(&sun(), &TruthOptions::default());
    let judged = (0..found.len()).filter(|i| truth.class[*i] == SampleClass::Counted);
    let (sum, count) = judged.fold((0.0, 0.0), |(sum, count), i| {
        (sum + f64::from(found[i] - truth.visibility[i]).powi(2), count + 1.0)
    });
    f64::sqrt(sum / count)
}

#[test]
fn with_a_gap_errors_are_smaller_than_those_of_practical_splits_of_as_many_bytes() {
    let gpu = gpu();
    let (scene, camera) = gap();
    let stage = Stage::new(&gpu, &scene, camera, SIDE, SIDE).expect("a stage");
    // By map, cascades that see everything share the scene out in tiles and none is left for what is in the hand.
    let by_depth = Cascades::<()> { select: Select::Depth, ..Default::default() };
    let mut steady = plain(&gpu).rearranged(|others| by_depth.arrange(others)).expect("valid");
    let practical = rmse(&stage, &shoot(&gpu, &stage, &mut steady));
    assert!(practical > 0.01, "{practical}: edges to be wrong at");
    for clusters in [false, true] {
        let run = |tiles| {
            let mut technique = measured(&gpu, &Sdsm { clusters, tiles, ..Sdsm::default() });
            let error = rmse(&stage, &shoot(&gpu, &stage, &mut technique));
            let bytes = [technique.map().bytes(), steady.map().bytes()];
            assert!(bytes[0] <= 4 * u64::from(MAP * MAP) * 4 + 4096, "{bytes:?}");
            error
        };
        let (slices, tiles) = (run(false), run(true));
        assert!(slices < practical, "{slices} measured (clusters: {clusters}), {practical}");
        // Even cuts leave two cascades empty, which share the landscape out with the third.
        let most = if clusters { slices } else { 0.9 * slices };
        assert!(tiles <= most, "{tiles} in tiles (clusters: {clusters}), {slices}");
    }
}

/// From high above, every slice of depths is as wide as the scene.
#[test]
fn slices_that_see_the_same_share_it_out_in_tiles() {
    let gpu = gpu();
    let scene = boxes();
    let above = Camera { eye: DVec3::new(0.0, 150.0, -20.0), up: DVec3::NEG_Z, ..camera(0.05) };
    let above = Camera { target: DVec3::new(0.0, 0.0, -50.0), ..above };
    let stage = Stage::new(&gpu, &scene, above, SIDE, SIDE).expect("a stage");
    let run = |tiles| {
        let mut technique = measured(&gpu, &Sdsm { tiles, ..Sdsm::default() });
        shoot(&gpu, &stage, &mut technique);
        let views = read_views(&gpu, &technique, 4);
        let texel = sampling(&gpu, &stage, &technique, &views).quantile(0.5).expect("samples");
        let clips: Vec<DMat4> = views.iter().take(4).filter_map(|v| v.clip).collect();
        (texel, clips, technique)
    };
    let ((in_slices, ..), (in_tiles, clips, technique)) = (run(false), run(true));
    assert!(in_tiles < 0.8 * in_slices, "{in_tiles} in tiles, {in_slices} in slices");
    let texels: Vec<[f64; 2]> =
        clips.iter().map(|clip| [0, 1].map(|axis| window(clip, axis).2)).collect();
    assert!(texels.len() > 1 && texels.iter().all(|t| *t == texels[0]), "{texels:?}");
    // All that may be shadowed is in a tile, within its guard band.
    let axes = [0, 1].map(|i| window(&clips[0], i).0);
    let along = |p: DVec3| DVec2::new(axes[0].dot(p), axes[1].dot(p));
    let hull: Vec<DVec2> = technique.map().hull().iter().map(|p| along(*p)).collect();
    let lo = hull.iter().copied().fold(DVec2::INFINITY, DVec2::min);
    let hi = hull.iter().copied().fold(DVec2::NEG_INFINITY, DVec2::max);
    // Less a hundredth of a texel, for rounding.
    let within = 1.0 - 2.0 * (f64::from(technique.map().guard()) - 0.01) / f64::from(MAP);
    let mut judged = 0;
    for sample in stage.view_samples().iter().filter(|s| s.normal != Vec3::ZERO) {
        let p = sample.position.as_dvec3();
        let at = along(p);
        if at.cmpge(lo).all() && at.cmple(hi).all() {
            judged += 1;
            let holds = |clip: &&DMat4| {
                (**clip * p.extend(1.0)).truncate().truncate().abs().max_element() <= within
            };
            assert!(clips.iter().any(|clip| holds(&clip)), "{p} is in no tile");
        }
    }
    assert!(judged > 1000, "{judged} samples");
}

#[test]
fn casters_beside_a_window_are_not_drawn_and_that_is_not_seen() {
    let gpu = gpu();
    let scene = antumbra_scene::generate::street();
    let eye = DVec3::new(1.0, 1.7, 190.0);
    let seen = Camera { eye, target: DVec3::new(0.0, 1.5, 100.0), ..camera(0.05) };
    let stage = Stage::new(&gpu, &scene, seen, SIDE, SIDE).expect("a stage");
    for id in ["map/plain", "map/object-id", "filter/pcf-castano", "filter/evsm", "filter/msm"] {
        let mut of: Config =
            serde_json::from_str(&format!(r#"{{ "technique": "{id}" }}"#)).expect("known");
        of.set_map_size(256);
        let run = |cull: bool| {
            let config =
                Config::Sdsm(Sdsm { of: Box::new(of.clone()), cull, ..Default::default() });
            let mut technique = config.build(&gpu).expect("a valid config");
            let shot = stage.shoot(&gpu, &sun(), technique.as_mut(), 0).expect("a shot");
            (shot.visibility, shot.counters["map_triangles"])
        };
        let ((few, drawn), (all, whole)) = (run(true), run(false));
        assert!(few.iter().zip(&all).all(|(a, b)| a.to_bits() == b.to_bits()), "{id}: it is seen");
        // Object ids are drawn from triangles of their own.
        if id == "map/object-id" {
            assert_eq!(drawn, whole, "{id}");
        } else {
            assert!(2 * drawn < whole, "{id}: {drawn} of {whole} triangles");
        }
    }
}

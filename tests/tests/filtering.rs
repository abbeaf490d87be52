//! Filterable stores on scenes whose leaks have a closed form.

use antumbra_filter::{
    Convolution, Esm, Evsm, Fallback, Lvsm, Msm, PcfAdaptive, PcfBilinearGrid, Prefilter, Savsm,
    Shape, Vsm, twin,
};
use antumbra_gpu::TechniqueConfig;
use antumbra_map::{Bias, MapConfig};
use antumbra_measure::Stage;
use antumbra_reference::ViewSample;
use antumbra_scene::generate::shapes;
use antumbra_scene::{LightKind, generate};
use antumbra_tests::gpu;
use glam::{DAffine3, DVec3, Vec3};

use crate::shared::slabs;

use slabs::{FLOOR, across, overhead, settings, slabs};

#[test]
fn two_slabs_leak_on_the_gpu_as_in_closed_form() {
    let gpu = gpu();
    let (map, filter) = settings();
    // One slab over half, one over all, and the floor 1 m below: r = 1 / 4, the truth 0. A third caster, below the
    // floor and under the second, keeps the floor among the casters' depths.
    let scene = slabs(&[(8.0, -5.0, 0.0), (4.0, -5.0, 5.0), (2.0, 4.0, 5.0)]);
    let most =
        |config: &dyn TechniqueConfig| across(&gpu, &scene, config).into_iter().fold(0.0, f32::max);
    let variance = most(&Vsm { map, filter, ..Vsm::default() });
    // Weights come in steps of less than 1/17, near a maximum that is flat: 1 % below it at a step beside.
    // The least variance adds 1e-6 to one of 0.004.
    assert!((0.435..=0.446).contains(&variance), "1 / (1 + 2 r)^2 = 0.444, not {variance}");
    let table = Savsm { map, radius: 8.0, follow_pixels: false, ..Savsm::default() };
    let tabled = most(&table);
    assert!((tabled - variance).abs() < 1e-3, "a table of the same: {tabled}, not {variance}");
    let cut = most(&Vsm { map, filter, cut: 0.45, ..Vsm::default() });
    assert_eq!(cut, 0.0, "a cut above the leak");
    // The share of the range that a metre is, g, says the rest.
    let points = [ViewSample { position: Vec3::new(0.2, FLOOR as f32, 0.0), normal: Vec3::Y }];
    let stage = Stage::at_points(&gpu, &scene, &points).expect("a stage");
    let mut technique = Vsm { map, filter, ..Vsm::default() }.technique(&gpu).expect("valid");
    stage.shoot(&gpu, &overhead(), &mut technique, 0).expect("a shot");
    let clip = technique.map().views()[0].clip.expect("a view with casters");
    let linear = technique.map().linear_depths()[0];
    let z = |y: f64| linear.of(clip.project_point3(y * DVec3::Y).z);
    let g = z(3.0) - z(4.0);
    assert!(z(3.0) < linear.last && g > 0.03, "the floor is among the casters, {g} behind one");
    // Two depths are exact but for the bias. Rounding is within it, and may add as much again.
    for (quantised, target) in [(false, 0.375), (true, 0.628)] {
        let config = Msm { map, filter, quantised, ..Msm::default() };
        let bias = config.effective_moment_bias();
        let leak = |f: f64| twin::msm(&[(z(8.0), f), (z(4.0), 1.0 - f)], bias, target, z(3.0));
        let expected = (1..100).map(|i| leak(f64::from(i) / 100.0)).fold(0.0, f64::max);
        let found = f64::from(most(&config));
        assert!((0.5 * expected..=2.0 * expected).contains(&found), "{found}, not {expected}");
        assert!(expected < 0.5 * f64::from(variance), "{expected} is no gain over {variance}");
    }
    let warped = (2.0 * (80.0 * g).exp() - 1.0).powi(-2) + (80.0f64 * 2.5e-5).powi(2);
    let evsm = f64::from(most(&Evsm { map, filter, ..Evsm::default() }));
    assert!(evsm <= 1.01 * warped, "both warps: {evsm}, at most {warped}");
    // Under the second slab alone.
    let exponential = (-80.0 * g).exp();
    let esm = f64::from(most(&Esm { map, filter, ..Esm::default() }));
    assert!((esm - exponential).abs() < 0.01 * exponential, "{esm}, not {exponential}");
}

#[test]
fn a_floor_that_casts_nothing_is_in_the_map_all_the_same() {
    let gpu = gpu();
    let (map, filter) = settings();
    // As above without the third caster: the floor lies behind the last one, and so counts as at the range's end.
    let scene = slabs(&[(8.0, -5.0, 0.0), (4.0, -5.0, 5.0)]);
    let config = Vsm { map, filter, ..Vsm::default() };
    let most = across(&gpu, &scene, &config).into_iter().fold(0.0, f32::max);
    let points = [ViewSample { position: Vec3::new(0.2, FLOOR as f32, 0.0), normal: Vec3::Y }];
    let stage = Stage::at_points(&gpu, &scene, &points).expect("a stage");
    let mut technique = config.technique(&gpu).expect("valid");
    stage.shoot(&gpu, &overhead(), &mut technique, 0).expect("a shot");
    let clip = technique.map().views()[0].clip.expect("a view with casters");
    let linear = technique.map().linear_depths()[0];
    let z = |y: f64| linear.of(clip.project_point3((y - scene.origin().y) * DVec3::Y).z);
    assert!(z(FLOOR) > linear.last_caster && z(4.0) < linear.last_caster, "{linear:?}");
    let r = (1.0 - z(4.0)) / (z(4.0) - z(8.0));
    let expected = (1.0 + 2.0 * r).powi(-2);
    // Weights and the least variance as in `two_slabs_leak_on_the_gpu_as_in_closed_form`.
    let share = f64::from(most) / expected;
    assert!((0.975..=1.005).contains(&share), "1 / (1 + 2 r)^2 = {expected}, not {most}");
    assert!(expected < 0.444, "{expected} is no gain over the floor's own depth");
    // A slab over half, and another far below the floor: were it not for the floor's own depth, all but the
    // innermost of the shadow's rim would be lit.
    let scene = slabs(&[(4.0, -5.0, 0.0), (-20.0, 4.0, 5.0)]);
    let rim = across(&gpu, &scene, &Vsm { map, filter, ..Vsm::default() });
    let exact = across(&gpu, &scene, &PcfBilinearGrid { map, side: 17 });
    let off = rim.iter().zip(&exact).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    // The least variance, 1e-6 of the range's square, beside that of two depths, w (1 - w) / 33^2 with w in steps
    // of 1/17.
    assert!(off < 0.02, "{off}");
}

#[test]
fn an_edge_over_a_parallel_floor_is_the_kernels_own_profile() {
    let gpu = gpu();
    let (map, filter) = settings();
    let scene = slabs(&[(7.0, -5.0, 0.0), (7.0, 4.0, 5.0)]);
    // The same kernel of texels compared one by one.
    let exact = across(&gpu, &scene, &PcfBilinearGrid { map, side: 17 });
    let soft = exact.iter().filter(|v| (0.05..0.95).contains(*v)).count();
    assert!(soft > 200, "{soft} samples in the penumbra");
    let box_of_17 = Savsm { map, radius: 8.0, follow_pixels: false, ..Savsm::default() };
    let configs: [(&str, &dyn TechniqueConfig, f64); 7] = [
        // A floor of 1e-6 on a variance and a gap of 0.01 and more.
        ("vsm", &Vsm { map, filter, ..Vsm::default() }, 1e-3),
        ("savsm", &box_of_17, 1e-3),
        // One by one where a texel lies behind the receiver, as the far end does beyond the slabs.
        ("esm, deeper", &Esm { map, filter, fallback: Fallback::Deeper, ..Esm::default() }, 1e-3),
        ("esm", &Esm { map, filter, ..Esm::default() }, 1e-3),
        ("evsm", &Evsm { map, filter, ..Evsm::default() }, 1e-3),
        ("msm", &Msm { map, filter, ..Msm::default() }, 1e-3),
        // A bias of 6e-5 on a signed gap of 0.5.
        ("msm 16", &Msm { map, filter, quantised: true, ..Msm::default() }, 5e-3),
    ];
    for (name, config, tolerance) in configs {
        let found = across(&gpu, &scene, config);
        for (i, (v, expected)) in found.iter().zip(&exact).enumerate() {
            let error = f64::from((v - expected).abs());
            assert!(error <= tolerance, "{name}: {v} for {expected} at sample {i}");
        }
    }
}

#[test]
fn no_store_is_darker_than_the_same_kernel_of_comparisons() {
    let gpu = gpu();
    let mut scene = generate::sphere_over_plane(&Default::default());
    let cuboid = shapes::cuboid(DVec3::new(0.6, 0.0, -0.9), DVec3::new(1.0, 0.8, -0.5));
    scene.add(cuboid, DAffine3::from_rotation_y(0.3));
    let stage = Stage::new(&gpu, &scene, scene.camera_or_framing(), 192, 192).expect("a stage");
    // One reference depth for the whole kernel on both sides, moved by the kernel's radius of slope.
    let bias = Bias { receiver_plane: false, cone: 0.0, ..Bias::default() };
    let map = MapConfig { size: 256, bias, ..MapConfig::default() };
    let filter = Prefilter { shape: Shape::Box, radius: 1, ..Prefilter::default() };
    // Rounding of a variance, 5e-7 of the range's square, over the least one: 1e-2 squared. For warps, 4e-6 of
    // the warp's square over (80 x 1e-3)^2, and (10 x 1e-2)^2. For moments, the bias.
    let savsm = Savsm { map, radius: 1.0, follow_pixels: false, ..Savsm::default() };
    let fallback = |fallback| Esm { map, filter, fallback, ..Esm::default() };
    let configs: [(&str, &dyn TechniqueConfig, f32); 9] = [
        ("vsm", &Vsm { map, filter, deviation: 1e-2, ..Vsm::default() }, 5e-3),
        // Sixteen windows joined in f32: 1.5e-6 of the range's square.
        ("savsm", &Savsm { deviation: 1e-2, ..savsm }, 1.5e-2),
        ("esm, overflow", &fallback(Fallback::Overflow), 1e-4),
        ("esm, deeper", &fallback(Fallback::Deeper), 1e-4),
        ("lvsm", &Lvsm { map, filter, deviation: 1e-2, ..Lvsm::default() }, 5e-3),
        ("esm", &Esm { map, filter, ..Esm::default() }, 1e-4),
        ("evsm", &Evsm { map, filter, deviation: 1e-2, ..Evsm::default() }, 1e-3),
        ("msm", &Msm { map, filter, ..Msm::default() }, 1e-4),
        ("msm 16", &Msm { map, filter, quantised: true, ..Msm::default() }, 1e-4),
    ];
    for kind in [LightKind::Directional, LightKind::Spot, LightKind::Point] {
        let light = scene.place_light(kind);
        let shoot = |config: &dyn TechniqueConfig| {
            let mut technique = config.build(&gpu).expect("a valid config");
            stage.shoot(&gpu, &light, technique.as_mut(), 0).expect("a shot").visibility
        };
        let compared = shoot(&PcfBilinearGrid { map, side: 3 });
        for (name, config, rounding) in configs {
            let found = shoot(config);
            let below = found.iter().zip(&compared).map(|(v, pcf)| pcf - v).fold(0.0, f32::max);
            assert!(below <= rounding, "{name}, {kind:?}: darker by {below}");
        }
        // The control: a cut is no bound.
        let cut = shoot(&Vsm { map, filter, cut: 0.3, ..Vsm::default() });
        let below = cut.iter().zip(&compared).map(|(v, pcf)| pcf - v).fold(0.0, f32::max);
        assert!(below > 0.05, "{kind:?}: a cut of 0.3 passes for a bound, {below}");
        // And waves are none: they ring, and half of what is level with its caster is lost without a scale.
        let waves = shoot(&Convolution { map, filter, scale: 1.0, ..Convolution::default() });
        let below = waves.iter().zip(&compared).map(|(v, pcf)| pcf - v).fold(0.0, f32::max);
        assert!(below > 0.3, "{kind:?}: waves pass for a bound, {below}");
    }
}

#[test]
fn layers_part_casters_on_the_gpu() {
    let gpu = gpu();
    let (map, filter) = settings();
    // As in `two_slabs_leak`; the range is about 22 m from 8 m on, so that with 16 layers the slab at 4 m and the
    // floor at 3 m share one that begins behind the slab at 8 m: it counts as at the layer's front.
    let scene = slabs(&[(8.0, -5.0, 0.0), (4.0, -5.0, 5.0), (2.0, 4.0, 5.0)]);
    let most = |layers| {
        let found = across(&gpu, &scene, &Lvsm { map, filter, layers, ..Lvsm::default() });
        found.into_iter().fold(0.0, f32::max)
    };
    let (one, many) = (most(1), most(16));
    assert!((0.435..=0.446).contains(&one), "one layer is a variance shadow map: {one}");
    assert!(many < 0.25, "16 layers leave {many}");
}

#[test]
fn an_adaptive_disc_errs_only_where_its_rim_agrees() {
    let gpu = gpu();
    let mut scene = generate::sphere_over_plane(&Default::default());
    let cuboid = shapes::cuboid(DVec3::new(0.6, 0.0, -0.9), DVec3::new(1.0, 0.8, -0.5));
    scene.add(cuboid, DAffine3::from_rotation_y(0.3));
    let stage = Stage::new(&gpu, &scene, scene.camera_or_framing(), 256, 256).expect("a stage");
    let light = scene.place_light(LightKind::Directional);
    let map = MapConfig { size: 128, ..MapConfig::default() };
    let shoot = |exhaustive| {
        let config = PcfAdaptive { map, exhaustive, ..PcfAdaptive::default() };
        let mut technique = config.build(&gpu).expect("a valid config");
        stage.shoot(&gpu, &light, technique.as_mut(), 0).expect("a shot").visibility
    };
    let (adaptive, all) = (shoot(false), shoot(true));
    let penumbra = all.iter().filter(|v| (0.01..0.99).contains(*v)).count();
    assert!(penumbra > 300, "{penumbra} samples in the penumbra");
    let mut missed = 0;
    for (a, b) in adaptive.iter().zip(&all) {
        assert!(*a == *b || *a == 0.0 || *a == 1.0, "{a}, not {b}, where the rim disagrees");
        missed += usize::from(a != b);
    }
    assert!(100 * missed < all.len(), "{missed} of {} samples", all.len());
    assert!(missed > 0, "the rim stands for all that it surrounds?");
}

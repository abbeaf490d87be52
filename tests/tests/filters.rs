//! Filters that ring, and filters that fail: on scenes with known numbers.

use antumbra::{Config, catalogue};
use antumbra_filter::{
    BlurredDepth, Convolution, Esm, Evsm, Fallback, Msm, MultipleDepth, PcfAdaptive,
    PcfBilinearGrid, PcfFootprint, PcfGrid, PowerFunction, Prefilter, Savsm, Shape, SoftComparison,
    Vsm, twin,
};
use antumbra_gpu::{Gpu, TechniqueConfig};
use antumbra_map::{MapConfig, Plain};
use antumbra_measure::Stage;
use antumbra_reference::ViewSample;
use antumbra_scene::generate::{self, shapes};
use antumbra_scene::{Camera, Light, LightKind, Scene};
use antumbra_tests::gpu;
use glam::{DAffine3, DVec3, Vec3};

use crate::shared::slabs;

use slabs::{FLOOR, across, overhead, places, settings, slabs};

/// A sphere and a turned box over a floor.
fn sphere_and_box() -> Scene {
    let mut scene = generate::sphere_over_plane(&Default::default());
    let cuboid = shapes::cuboid(DVec3::new(0.6, 0.0, -0.9), DVec3::new(1.0, 0.8, -0.5));
    scene.add(cuboid, DAffine3::from_rotation_y(0.3));
    scene
}

fn shoot(gpu: &Gpu, stage: &Stage, light: &Light, config: &dyn TechniqueConfig) -> Vec<f32> {
    let mut technique = config.build(gpu).expect("a valid config");
    stage.shoot(gpu, light, technique.as_mut(), 0).expect("a shot").visibility
}

fn most(values: &[f32]) -> f32 {
    values.iter().copied().fold(0.0, f32::max)
}

/// Depth that a store holds of the height `y` in a map of `scene` under the overhead sun.
fn depth_at(
    gpu: &Gpu,
    scene: &Scene,
    (map, filter): (MapConfig, Prefilter),
) -> impl Fn(f64) -> f64 {
    let origin = scene.origin();
    let points = [ViewSample { position: Vec3::ZERO, normal: Vec3::Y }];
    let stage = Stage::at_points(gpu, scene, &points).expect("a stage");
    // The window, and with it the range, depends on the kernel's reach.
    let mut technique = Vsm { map, filter, ..Vsm::default() }.technique(gpu).expect("valid");
    stage.shoot(gpu, &overhead(), &mut technique, 0).expect("a shot");
    let clip = technique.map().views()[0].clip.expect("a view with casters");
    let linear = technique.map().linear_depths()[0];
    move |y| {
        let z = linear.of(clip.project_point3(y * DVec3::Y - origin).z);
        if z > linear.last_caster { 1.0 } else { z }
    }
}

#[test]
fn waves_filter_as_their_twin_says_and_come_round_again() {
    let gpu = gpu();
    let (map, filter) = settings();
    // One slab over half of a floor that is farther behind it than the window is wide: depths 0 and 1.
    let scene = slabs(&[(14.0, -5.0, 0.0), (14.0, 4.0, 5.0)]);
    let exact = across(&gpu, &scene, &PcfBilinearGrid { map, side: 17 });
    for (order, golden) in [
        (4, [0.484, 0.460, 0.420, 0.342]),
        (8, [0.468, 0.420, 0.342, 0.197]),
        (16, [0.436, 0.342, 0.197, 0.0]),
    ] {
        for (d, expected) in [0.002, 0.005, 0.01, 0.02].into_iter().zip(golden) {
            // Squeezed into 1 / (1 + margin) of half of a period, the ends are d of it from being neighbours.
            let config = Convolution {
                map,
                filter,
                order,
                damping: 0.0,
                scale: 1.0,
                margin: Some(d / (1.0 - d)),
                quantised: false,
                ..Convolution::default()
            };
            let found = across(&gpu, &scene, &config);
            let waves = twin::Waves {
                order,
                damping: 0.0,
                margin: f64::from(d / (1.0 - d)),
                offset: 0.0,
                scale: 1.0,
            };
            // Sine and cosine are exact to 2^-11 in WGSL, and so are those of the receiver, beside what the filter rounds.
            // Of the k-th term that makes sqrt 2 / c_k times twice as much; and the receiver is moved by twice their sum over
            // the series' greatest slope, for which that is a change of twice the sum at most.
            let channel = 2.0 * 2f64.powi(-11) + filter.rounding();
            let error: f64 = (1..=order)
                .map(|k| std::f64::consts::PI * (2.0 * f64::from(k) - 1.0))
                .map(|c| 2.0 / c * std::f64::consts::SQRT_2 * channel)
                .sum();
            let tolerance = 3.0 * error + 8.0 * f64::from(order) * 2f64.powi(-24);
            // What is published has three digits.
            let digits = 5e-4;
            for (i, (v, pcf)) in found.iter().zip(&exact).enumerate() {
                let f = 1.0 - f64::from(*pcf);
                let twin = twin::convolution(&[(0.0, f), (1.0, 1.0 - f)], &waves, 1.0);
                let error = (f64::from(*v) - twin).abs();
                assert!(error < tolerance, "order {order}, {d}: {v}, not {twin} at {i}");
            }
            let dark = f64::from(found[0]);
            assert!((dark - expected).abs() < tolerance + digits, "order {order}, {d}: {dark}");
        }
    }
    // With the default room nothing comes round.
    let dark = across(&gpu, &scene, &Convolution { map, filter, ..Convolution::default() })[0];
    assert!(dark < 0.05, "{dark} behind a slab");
}

#[test]
fn stored_bytes_of_waves_are_off_by_a_two_hundredth() {
    let gpu = gpu();
    let (map, filter) = settings();
    let scene = slabs(&[(7.0, -5.0, 0.0), (7.0, 4.0, 5.0)]);
    for order in [4, 16] {
        let waves = Convolution { map, filter, order, scale: 1.0, ..Convolution::default() };
        let bytes = across(&gpu, &scene, &waves);
        let floats = across(&gpu, &scene, &Convolution { quantised: false, ..waves });
        let off = bytes.iter().zip(&floats).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        // And the receivers are moved by different amounts, up to the same.
        assert!(off > 1e-5 && off < 0.02, "order {order}: off by {off}");
    }
}

/// Slabs over a floor at 0, which keeps all of them in the map; points are looked at where the floor usually is.
fn floating(layers: &[(f64, f64, f64)]) -> Scene {
    let mut scene = Scene::default();
    scene.add(shapes::floor(8.0), DAffine3::IDENTITY);
    for (y, from, to) in layers.iter().copied() {
        let center = DVec3::new(0.5 * (from + to), y, 0.0);
        let half = 0.5 * (to - from);
        scene.add(shapes::quad(center, 5.0 * DVec3::Z, half * DVec3::X), DAffine3::IDENTITY);
    }
    scene
}

#[test]
fn a_cliff_lights_exponentials_and_the_fallback_repairs_them() {
    let gpu = gpu();
    let (map, filter) = settings();
    // A dark point beside a cliff: a slab over a floor that ends at x = 0, a lower one beyond, and one at the end of the
    // map.
    let layers = [(7.0, -5.0, 0.04), (7.0, 4.0, 5.0), (FLOOR, -5.0, 0.0), (0.5, 0.0, 5.0)];
    let scene = floating(&layers);
    let z = depth_at(&gpu, &scene, (map, filter));
    let gap = z(FLOOR) - z(7.0);
    let exact = across(&gpu, &scene, &PcfBilinearGrid { map, side: 17 });
    // The truth in the slab's shadow is 0; the kernel sees a fifth of cliff.
    let at = places().position(|x| x > -0.05).expect("a place");
    assert!((0.15..0.27).contains(&exact[at]), "{} of the kernel is cliff", exact[at]);
    let esm = Esm { map, filter, ..Esm::default() };
    let of = |fallback, sharpness| across(&gpu, &scene, &Esm { fallback, sharpness, ..esm });
    let plain = of(Fallback::Never, 80.0);
    assert_eq!(plain[at], 1.0, "exponentials alone");
    for fallback in [Fallback::Overflow, Fallback::Deeper] {
        let repaired = of(fallback, 80.0);
        let leak = (-80.0 * gap).exp() as f32 + 1e-4;
        for i in 0..at {
            let (v, pcf) = (repaired[i], exact[i]);
            assert!(v >= pcf - 1e-4 && v <= pcf + leak, "{fallback:?}: {v}, not {pcf}, at {i}");
        }
    }
    // Blunt exponentials: the near ones outweigh the deep one, which only the largest depth gives away.
    let blunt = 8.0;
    let [overflow, deeper] = [Fallback::Overflow, Fallback::Deeper].map(|f| of(f, blunt)[at]);
    let expected = exact[at] + (1.0 - exact[at]) * (-f64::from(blunt) * gap).exp() as f32;
    assert!((deeper - expected).abs() < 1e-3, "{deeper}, not {expected}");
    assert!(overflow > deeper + 0.2, "the mean tells after all: {overflow}, and {deeper}");
    // Looked at one by one are the places whose kernel reaches the cliff beside the slab, 8 texels and one of interpolation, of
    // 1/492 to 1.1/492 of the slabs' 10 m, and the texel in which the cliff begins.
    let points: Vec<ViewSample> = places()
        .map(|x| {
            let position = DVec3::new(x, FLOOR, 0.013) - scene.origin();
            ViewSample { position: position.as_vec3(), normal: Vec3::Y }
        })
        .collect();
    let stage = Stage::at_points(&gpu, &scene, &points).expect("a stage");
    let tallied = Esm { fallback: Fallback::Deeper, tally: true, ..esm };
    let mut technique = tallied.build(&gpu).expect("a valid config");
    stage.shoot(&gpu, &overhead(), technique.as_mut(), 0).expect("a shot");
    let asked = technique.read_counters(&gpu).expect("counters")["esm_one_by_one"];
    let beyond =
        |texels: f64| places().filter(|x| *x > 0.04 - texels * 10.0 / 492.0).count() as u64;
    assert!((beyond(8.0)..=beyond(11.0)).contains(&asked), "{asked} of {} places", points.len());
    // The other bounds, as computed from the same weights: two moments lose half, four nothing, and the second warp
    // saves the first.
    let f = 1.0 - f64::from(exact[at]);
    let window = [(z(7.0), f), (z(0.5), 1.0 - f)];
    let receiver = z(FLOOR);
    for (name, config, expected) in [
        (
            "vsm",
            &Vsm { map, filter, ..Vsm::default() } as &dyn TechniqueConfig,
            twin::vsm(&window, 1e-3, receiver),
        ),
        (
            "evsm",
            &Evsm { map, filter, ..Evsm::default() },
            twin::positive_warp(&window, 40.0, 2.5e-5, receiver)
                .min(twin::negative_warp(&window, 5.0, 2.5e-5, receiver)),
        ),
        ("msm", &Msm { map, filter, ..Msm::default() }, 1.0 - f),
    ] {
        let found = f64::from(across(&gpu, &scene, config)[at]);
        assert!((found - expected).abs() < 5e-3, "{name}: {found}, not {expected}");
    }
}

#[test]
fn lookups_that_ask_texel_by_texel_are_counted_where_asked_for() {
    let gpu = gpu();
    let scene = sphere_and_box();
    let stage = Stage::new(&gpu, &scene, scene.camera_or_framing(), 96, 96).expect("a stage");
    let light = scene.place_light(LightKind::Directional);
    let map = MapConfig { size: 256, ..MapConfig::default() };
    let shoot = |fallback, tally| {
        let config = Esm { map, fallback, tally, ..Esm::default() };
        let mut technique = config.build(&gpu).expect("a valid config");
        let mut shots = [0, 1].map(|_| {
            stage.shoot(&gpu, &light, technique.as_mut(), 0).expect("a shot");
            technique.read_counters(&gpu).expect("counters")
        });
        let found = stage.shoot(&gpu, &light, technique.as_mut(), 0).expect("a shot").visibility;
        shots.sort_by_key(|counters| counters.len());
        assert_eq!(shots[0], shots[1], "{fallback:?}: a frame counts for itself");
        (found, shots[0].clone())
    };
    let counts = |fallback| {
        let ((silent, none), (counted, counters)) = (shoot(fallback, false), shoot(fallback, true));
        assert_eq!(silent, counted, "{fallback:?}: counting changes nothing");
        assert!(!none.contains_key("esm_lookups"), "{fallback:?}: counted unasked");
        [counters["esm_lookups"], counters["esm_one_by_one"]]
    };
    let ([all, overflow], [same, deeper]) = (counts(Fallback::Overflow), counts(Fallback::Deeper));
    assert_eq!(all, same, "lookups");
    // As many samples as lie before the map and face the sun.
    assert!(all > 500 && all < 96 * 96, "{all} lookups");
    // What the mean tells, the largest depth tells too.
    assert!(0 < overflow && overflow < deeper && deeper <= all, "{overflow} {deeper} of {all}");
    // Nothing falls back where nothing is to be fallen back to.
    let (_, never) = shoot(Fallback::Never, true);
    assert!(!never.contains_key("esm_lookups"), "no fallback, no count: {never:?}");
}

#[test]
fn contacts_leak_as_exponentials_say() {
    let gpu = gpu();
    let (map, _) = settings();
    let filter = Prefilter { shape: Shape::Box, radius: 1, ..Prefilter::default() };
    // Slabs side by side, each a little higher than the one before, over a floor that a caster below keeps in range.
    let gaps = [0.001, 0.003, 0.01, 0.03, 0.1, 0.3, 1.0, 3.0];
    let mut layers: Vec<(f64, f64, f64)> = gaps
        .iter()
        .enumerate()
        .map(|(i, g)| (FLOOR + g, -3.2 + 0.8 * i as f64, -2.4 + 0.8 * i as f64))
        .collect();
    layers.extend([(2.0, 4.0, 5.0), (7.0, -5.0, -4.0)]);
    let scene = slabs(&layers);
    let z = depth_at(&gpu, &scene, (map, filter));
    let points: Vec<ViewSample> = (0..gaps.len())
        .map(|i| {
            let position = DVec3::new(-2.8 + 0.8 * i as f64, FLOOR, 0.013) - scene.origin();
            ViewSample { position: position.as_vec3(), normal: Vec3::Y }
        })
        .collect();
    let stage = Stage::at_points(&gpu, &scene, &points).expect("a stage");
    let esm = shoot(&gpu, &stage, &overhead(), &Esm { map, filter, ..Esm::default() });
    let evsm = shoot(&gpu, &stage, &overhead(), &Evsm { map, filter, ..Evsm::default() });
    let msm = shoot(&gpu, &stage, &overhead(), &Msm { map, filter, ..Msm::default() });
    let vsm = shoot(&gpu, &stage, &overhead(), &Vsm { map, filter, ..Vsm::default() });
    for (i, g) in gaps.into_iter().enumerate() {
        let gap = z(FLOOR) - z(FLOOR + g);
        let exponential = (-80.0 * gap).exp();
        // Depths are off by a few 2^-24, which the exponent multiplies by 80; the receiver moves by ten times that.
        let error = (f64::from(esm[i]) - exponential).abs();
        assert!(error <= 1e-3 * exponential + 1e-6, "{g} m: {}, not {exponential}", esm[i]);
        let variance = 1e-6 / (1e-6 + gap * gap);
        let error = (f64::from(vsm[i]) - variance).abs();
        assert!(error <= 0.02, "{g} m: {}, not {variance}", vsm[i]);
        let window = [(z(FLOOR + g), 1.0)];
        let warped = twin::positive_warp(&window, 40.0, 2.5e-5, z(FLOOR));
        let error = (f64::from(evsm[i]) - warped).abs();
        // What a filter rounds off a warped variance is a fifth of the least one.
        assert!(error <= 0.2 * warped + 1e-5, "{g} m: {}, not {warped}, by two warps", evsm[i]);
        // Four moments with a bias of some 1e-6, beside which what is rounded off them is as much again.
        let bias = Msm { filter, ..Msm::default() }.effective_moment_bias();
        let most = twin::msm(&window, 2.0 * bias, 0.375, z(FLOOR));
        assert!(f64::from(msm[i]) <= most, "{g} m: {}, not {most}, by four moments", msm[i]);
    }
}

#[test]
fn three_slabs_leak_as_computed() {
    let gpu = gpu();
    let (map, _) = settings();
    let filter = Prefilter { shape: Shape::Box, radius: 9, ..Prefilter::default() };
    // Depths in steps of 2 m and the floor 1 m on, as 0.2, 0.4, 0.6 and 0.7: two and four moments do not know the
    // scale. The last slab keeps the floor in range.
    let layers = [(8.0, -5.0, -0.1), (6.0, -5.0, 0.1), (4.0, -5.0, 5.0), (2.0, 4.0, 5.0)];
    let scene = slabs(&layers);
    let z = depth_at(&gpu, &scene, (map, filter));
    let at = places().position(|x| x > 0.0).expect("a place");
    // Weights by percentage-closer filtering of each slab alone: another range of depth, and the same window, which is the
    // floor's 16 m since the last slab lies below it.
    let share = |to: f64| {
        let half = slabs(&[(8.0, -5.0, to), (2.0, 4.0, 5.0)]);
        1.0 - f64::from(across(&gpu, &half, &PcfBilinearGrid { map, side: 19 })[at])
    };
    let (first, second) = (share(-0.1), share(0.1));
    assert!((first - 1.0 / 3.0).abs() < 0.02 && (second - 2.0 / 3.0).abs() < 0.02, "thirds");
    let window = [(z(8.0), first), (z(6.0), second - first), (z(4.0), 1.0 - second)];
    let vsm = twin::vsm(&window, 1e-3, z(FLOOR));
    let msm = twin::msm(&window, 1e-6, 0.375, z(FLOOR));
    assert!((vsm - 0.229).abs() < 0.01 && (msm - 0.0639).abs() < 0.01, "{vsm} and {msm}");
    let found = |config: &dyn TechniqueConfig| f64::from(across(&gpu, &scene, config)[at]);
    let by_two = found(&Vsm { map, filter, ..Vsm::default() });
    assert!((by_two - vsm).abs() < 2e-3, "{by_two} by two moments, not {vsm}");
    let by_four = found(&Msm { map, filter, ..Msm::default() });
    assert!((by_four - msm).abs() < 5e-3, "{by_four} by four moments, not {msm}");
    let table = Savsm { map, radius: 9.0, follow_pixels: false, ..Savsm::default() };
    let by_table = found(&table);
    assert!((by_table - by_two).abs() < 1e-3, "{by_table} by a table, not {by_two}");
}

#[test]
fn a_floor_among_the_casters_that_is_not_drawn_leaks_as_computed() {
    let gpu = gpu();
    let (map, filter) = settings();
    // The kernel sees the slab and the floor below; the receiver lies between and is not in the map.
    let scene = floating(&[(7.0, -5.0, 0.0), (7.0, 4.0, 5.0), (2.0, 4.0, 5.0)]);
    let z = depth_at(&gpu, &scene, (map, filter));
    let exact = across(&gpu, &scene, &PcfBilinearGrid { map, side: 17 });
    let vsm = across(&gpu, &scene, &Vsm { map, filter, ..Vsm::default() });
    let msm = across(&gpu, &scene, &Msm { map, filter, ..Msm::default() });
    let waves = Convolution { map, filter, quantised: false, scale: 1.0, ..Convolution::default() };
    let convolution = across(&gpu, &scene, &waves);
    let mut worst = 0.0f64;
    for (i, pcf) in exact.iter().enumerate() {
        let f = 1.0 - f64::from(*pcf);
        let expected = twin::vsm(&[(z(7.0), f), (z(0.0), 1.0 - f)], 1e-3, z(FLOOR));
        let found = f64::from(vsm[i]);
        assert!((found - expected).abs() < 2e-3, "{found}, not {expected} at {f}");
        worst = worst.max(found - f64::from(*pcf));
        assert!((msm[i] - pcf).abs() < 2e-3, "four moments: {}, not {pcf}", msm[i]);
        assert!((convolution[i] - pcf).abs() < 0.1, "waves: {}, not {pcf}", convolution[i]);
    }
    assert!(worst > 0.4, "variance leaks {worst} at most");
}

#[test]
fn a_power_function_is_too_dark_and_hardly_leaks() {
    let gpu = gpu();
    let (map, filter) = settings();
    let power = PowerFunction { map, filter, ..PowerFunction::default() };
    // One slab over a floor among the casters: its profile is that of its twin, and below that of the kernel.
    let scene = slabs(&[(7.0, -5.0, 0.0), (2.0, 4.0, 5.0)]);
    let z = depth_at(&gpu, &scene, (map, filter));
    let exact = across(&gpu, &scene, &PcfBilinearGrid { map, side: 17 });
    let found = across(&gpu, &scene, &power);
    let mut darkest = 0.0f64;
    for (i, (v, pcf)) in found.iter().zip(&exact).enumerate() {
        let f = 1.0 - f64::from(*pcf);
        let twin = twin::power_function(&[(z(7.0), f), (z(FLOOR), 1.0 - f)], 1e-3, 1.0, z(FLOOR));
        let error = (f64::from(*v) - twin).abs();
        // Nearly all of the kernel on the floor, the last of it decides; and all but rounding on the slab.
        assert!(error < 5e-3 || f < 0.01, "{v}, not {twin}, at {i}: {f} of the slab");
        assert!(*v <= pcf + 5e-3, "{v} at {i}, {pcf} by comparisons");
        darkest = darkest.max(f64::from(pcf - v));
    }
    assert!(darkest > 0.2, "too dark by {darkest} at most");
    // Two slabs, behind which variance leaks 0.44.
    let scene = slabs(&[(8.0, -5.0, 0.0), (4.0, -5.0, 5.0), (2.0, 4.0, 5.0)]);
    let leak = most(&across(&gpu, &scene, &power));
    let variance = most(&across(&gpu, &scene, &Vsm { map, filter, ..Vsm::default() }));
    assert!(leak < 0.6 * variance, "{leak} leaks, {variance} by variance");
}

#[test]
fn blurred_depth_is_hard_and_too_large() {
    let gpu = gpu();
    let (map, filter) = settings();
    let scene = slabs(&[(7.0, -5.0, 0.0), (7.0, 4.0, 5.0)]);
    let exact = across(&gpu, &scene, &PcfBilinearGrid { map, side: 17 });
    let found = across(&gpu, &scene, &BlurredDepth { map, filter });
    assert!(found.iter().all(|v| *v == 0.0 || *v == 1.0), "hard");
    // The shadow ends where the kernel leaves the slab, not where half of it does.
    let end = found.iter().position(|v| *v == 1.0).expect("lit somewhere");
    let rim = exact.iter().position(|v| *v == 1.0).expect("lit somewhere");
    assert!(end.abs_diff(rim) <= 2, "the shadow ends at {end}, the kernel at {rim}");
    assert!(exact[end] > 0.99, "{} of the kernel is lit there", exact[end]);
    // Compared softly it is smooth; but stacked slabs lighten their shadow, which is 0 in truth.
    let soft = SoftComparison { map, filter, ..SoftComparison::default() };
    let found = across(&gpu, &scene, &soft);
    let steps = found.windows(2).map(|p| (p[1] - p[0]).abs()).fold(0.0, f32::max);
    assert!(steps < 0.05, "a step of {steps}");
    let stacked = slabs(&[(8.0, -5.0, 0.0), (3.05, -5.0, 5.0), (2.0, 4.0, 5.0)]);
    let found = across(&gpu, &stacked, &soft);
    assert!(most(&found) > 0.5, "{} behind two slabs", most(&found));
}

#[test]
fn a_hole_of_one_texel_lights_as_much_as_it_is_large() {
    let gpu = gpu();
    let (map, _) = settings();
    // A slab with a hole of two texels or so, under which the floor is looked at in steps of a fifth of a texel.
    let hole = 0.02;
    let mut scene = slabs(&[(7.0, -5.0, -hole), (7.0, hole, 5.0)]);
    for z in [-1.0, 1.0] {
        let (half, center) = (0.5 * (5.0 - hole), z * (0.5 * (5.0 + hole)));
        let center = DVec3::new(0.0, 7.0, center);
        scene.add(shapes::quad(center, half * DVec3::Z, hole * DVec3::X), DAffine3::IDENTITY);
    }
    let step = 0.004;
    let points: Vec<ViewSample> = (0..200 * 200)
        .map(|i| {
            let (x, z) = (f64::from(i % 200) - 99.5, f64::from(i / 200) - 99.5);
            let position = DVec3::new(x * step, FLOOR, z * step) - scene.origin();
            ViewSample { position: position.as_vec3(), normal: Vec3::Y }
        })
        .collect();
    let stage = Stage::at_points(&gpu, &scene, &points).expect("a stage");
    let energy = |config: &dyn TechniqueConfig| {
        let found = shoot(&gpu, &stage, &overhead(), config);
        f64::from(found[..points.len()].iter().sum::<f32>()) * step * step
    };
    // What texels there are of the hole, by the plain map.
    let plain = energy(&Plain { map });
    assert!(plain > 0.0 && plain < 9e-3, "a hole of {plain} square metres");
    let filtered = energy(&PcfBilinearGrid { map, side: 9 });
    // Samples are a fifth of a texel apart: an edge's area is known to as much.
    assert!((filtered - plain).abs() < 0.25 * plain, "{filtered} of {plain}");
    let footprint = energy(&PcfFootprint { map, ..PcfFootprint::default() });
    assert!((footprint - plain).abs() < 0.25 * plain, "{footprint} of {plain}");
    // The rim of a disc all around it is dark.
    let adaptive = energy(&PcfAdaptive { map, radius: 8.0, ..PcfAdaptive::default() });
    let all = PcfAdaptive { map, radius: 8.0, exhaustive: true, ..PcfAdaptive::default() };
    let all = energy(&all);
    assert!((all - plain).abs() < 0.25 * plain, "{all} of {plain} by all taps");
    assert!(adaptive < 0.5 * all, "the rim finds the hole: {adaptive} of {all}");
}

#[test]
fn a_wall_lit_all_but_edge_on_gives_numbers() {
    let gpu = gpu();
    let mut scene = Scene::default();
    scene.add(shapes::floor(4.0), DAffine3::IDENTITY);
    scene.add(shapes::quad(2.0 * DVec3::Y, DVec3::Y, 2.0 * DVec3::Z), DAffine3::IDENTITY);
    let camera = Camera {
        eye: DVec3::new(3.0, 2.0, 1.0),
        target: 1.5 * DVec3::Y,
        up: DVec3::Y,
        fov_y: 1.0,
        near: 0.1,
    };
    let stage = Stage::new(&gpu, &scene, camera, 64, 64).expect("a stage");
    for degrees in [1.0f64, 0.1, 0.001] {
        let (sin, cos) = degrees.to_radians().sin_cos();
        let direction = DVec3::new(-sin, -cos, 0.0);
        let light = Light::Directional { direction, angular_diameter: 0.0 };
        for mut config in catalogue().into_iter().filter(|c| c.id().starts_with("filter/")) {
            config.set_map_size(128);
            let found = shoot(&gpu, &stage, &light, config.settings());
            let sane = found.iter().all(|v| (0.0..=1.0).contains(v));
            assert!(sane, "{}, {degrees} degrees", config.id());
        }
        let fallback = Esm { fallback: Fallback::Deeper, ..Esm::default() };
        let mut config = Config::Esm(fallback);
        config.set_map_size(128);
        let found = shoot(&gpu, &stage, &light, config.settings());
        assert!(found.iter().all(|v| (0.0..=1.0).contains(v)), "fallback, {degrees} degrees");
    }
}

#[test]
fn the_least_and_the_largest_depth_are_all_or_none_where_all_or_none_is_lit() {
    let gpu = gpu();
    let (map, _) = settings();
    let scene = slabs(&[(7.0, -5.0, 0.0), (7.0, 4.0, 5.0)]);
    let exact = across(&gpu, &scene, &PcfGrid { map, side: 17 });
    for depths in [2, 3] {
        let config = MultipleDepth { map, radius: 8, depths, n_buffer: false };
        let found = across(&gpu, &scene, &config);
        // Four windows that overlap say the same as going through all texels.
        let overlaid = across(&gpu, &scene, &MultipleDepth { n_buffer: true, ..config });
        assert_eq!(found, overlaid, "an N-buffer");
        let levels = f64::from(depths);
        let mut greys = 0;
        for (i, (v, pcf)) in found.iter().zip(&exact).enumerate() {
            // Windows differ in their guard bands by less than a texel, some 25 samples.
            let around = |f: &dyn Fn(f32) -> bool| {
                exact[i.saturating_sub(30)..(i + 30).min(exact.len())].iter().all(|p| f(*p))
            };
            assert!(!around(&|p| p == 1.0) || *v == 1.0, "{depths}: {v} for {pcf} at {i}");
            assert!(!around(&|p| p == 0.0) || *v == 0.0, "{depths}: {v} for {pcf} at {i}");
            let level = f64::from(*v) * levels;
            assert!((level - level.round()).abs() < 1e-6, "{depths}: a grey of {v}");
            greys += usize::from(*v > 0.0 && *v < 1.0);
        }
        assert!(greys > 200, "{depths}: {greys} greys");
    }
}

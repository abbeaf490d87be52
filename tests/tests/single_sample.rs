//! Soft shadows from a single light sample: widths bit for bit, hard where the light has no extent, what theory says of
//! them, and work that depends on the map alone.

use crate::shared::area;

use antumbra::Config;
use antumbra_gpu::{Gpu, Recorder, TechniqueConfig as _, read_f32_texture};
use antumbra_map::{Bias, MapConfig, Plain};
use antumbra_measure::Stage;
use antumbra_reference::{SampleClass, TruthOptions, ViewSample};
use antumbra_scene::{Camera, Light, Mesh, Scene, generate};
use antumbra_soft::{RadialSearch, SingleSample, WidthLookup, WidthMap, Widths, twin};
use antumbra_tests::{gpu, image};
use area::{below_a_square_light, bodies, lights, map, plate, seen, shoot, shots};
use glam::{DAffine3, DVec2, DVec3, Vec3};

/// The technique at its defaults, on a map of that side.
fn single(size: u32) -> SingleSample {
    SingleSample { map: map(size), ..SingleSample::default() }
}

/// Without the published bias, by exact distances.
fn exact(size: u32) -> SingleSample {
    SingleSample { bias: 0.0, widths: Widths::Euclidean, ..single(size) }
}

/// The hard shadow of the same map.
fn hard(size: u32) -> SingleSample {
    SingleSample { scale: 1e30, lookup: WidthLookup::Texel, ..exact(size) }
}

/// Both techniques and every way of one of them.
fn techniques(size: u32) -> Vec<Config> {
    let base = single(size);
    let of = |config| Config::SingleSample(config);
    vec![
        of(base),
        of(SingleSample { neighbours: 3, lookup: WidthLookup::Texel, ..base }),
        of(SingleSample { neighbours: 8, lookup: WidthLookup::Linear, ..base }),
        of(SingleSample { widths: Widths::CityBlock, ..base }),
        of(SingleSample { widths: Widths::Euclidean, back: true, ..base }),
        Config::RadialSearch(RadialSearch { map: map(size), ..RadialSearch::default() }),
    ]
}

/// A sun that stands overhead, and the tangent of its half width.
fn sun(tangent: f64) -> Light {
    Light::Directional { direction: DVec3::NEG_Y, angular_diameter: 2.0 * tangent.atan() }
}

/// A floor at the height 0 under these bodies.
fn over_a_floor(half: f64, bodies: impl IntoIterator<Item = (Mesh, DVec3)>) -> Scene {
    let mut scene = Scene { name: "over a floor".to_owned(), ..Scene::default() };
    scene.add(generate::shapes::floor(half), DAffine3::IDENTITY);
    for (mesh, place) in bodies {
        scene.add(mesh, DAffine3::from_translation(place));
    }
    scene
}

/// A level plate of those half sides around the origin.
fn sheet(x: f64, z: f64) -> Mesh {
    generate::shapes::quad(DVec3::ZERO, DVec3::Z * z, DVec3::X * x)
}

/// A stage of points on the floor.
fn on_the_floor(gpu: &Gpu, scene: &Scene, points: impl IntoIterator<Item = DVec2>) -> Stage {
    let sample = |p: DVec2| ViewSample {
        position: (DVec3::new(p.x, 0.0, p.y) - scene.origin()).as_vec3(),
        normal: Vec3::Y,
    };
    let samples: Vec<ViewSample> = points.into_iter().map(sample).collect();
    Stage::at_points(gpu, scene, &samples).expect("a stage")
}

#[test]
fn widths_on_the_gpu_are_the_twins_bit_for_bit() {
    const SIZE: u32 = 45;
    const DOUBLINGS: u32 = 5;
    let gpu = gpu();
    let blocked: Vec<bool> = (0..SIZE * SIZE)
        .map(|i| {
            let (x, y) = (i64::from(i % SIZE), i64::from(i / SIZE));
            let body = (x - 18).pow(2) + (y - 25).pow(2) < 300 || x > 38 || (x + y) % 40 < 4;
            body && (x * 7 + y * 13) % 61 != 0
        })
        .collect();
    let depths: Vec<f32> = blocked.iter().map(|b| if *b { 0.25 } else { 0.0 }).collect();
    let source = image(&gpu, SIZE, &depths);
    for sides in [DVec2::ONE, DVec2::new(1.375, 1.0)] {
        let found = |config: &SingleSample| {
            let mut widths = WidthMap::new(&gpu, config).expect("a valid config");
            widths.prepare(&gpu, &source, SIZE, &[sides], DOUBLINGS).expect("room");
            let mut encoder = gpu.device.create_command_encoder(&Default::default());
            widths.encode(&mut Recorder::new(&mut encoder), "widths");
            gpu.queue.submit([encoder.finish()]);
            read_f32_texture(&gpu, widths.texture().expect("widths"), 0).expect("read back")
        };
        let expected = |config: &SingleSample| -> Vec<f32> {
            let widths = twin::width::width_map(config, DOUBLINGS, &blocked, sides);
            widths.iter().map(|w| *w as f32).collect()
        };
        for neighbours in [3, 4, 6, 8] {
            let config = SingleSample { neighbours, ..SingleSample::default() };
            let found = found(&config);
            assert_eq!(found, expected(&config), "{neighbours} neighbours, sides {sides}");
            // The control: other steps.
            let other = SingleSample { neighbours: if neighbours == 3 { 4 } else { 3 }, ..config };
            assert_ne!(found, expected(&other), "{neighbours} neighbours by others' steps");
        }
        let city = SingleSample { widths: Widths::CityBlock, ..SingleSample::default() };
        assert_eq!(found(&city), expected(&city), "along rows and columns, sides {sides}");
        let plane = SingleSample { widths: Widths::Euclidean, ..SingleSample::default() };
        for (a, b) in found(&plane).iter().zip(expected(&plane)) {
            // Two squares and their sum are rounded once each, which the root halves; the root may be off by 4.5 units
            // of the last place, and the twin is rounded.
            assert!((a - b).abs() <= 7.0 * f32::EPSILON * b, "in the plane: {a}, not {b}");
        }
    }
}

#[test]
fn a_light_without_an_extent_gives_the_plain_maps_bits() {
    let gpu = gpu();
    let stage = seen(&gpu, &bodies(), 64);
    let position = DVec3::new(0.4, 5.0, -0.3);
    let spot = Light::Spot { position, direction: DVec3::NEG_Y, outer_angle: 0.6 };
    let all: Vec<Light> =
        lights(0.0).into_iter().chain([Light::Point { position }, spot]).collect();
    let pairs = || all.iter().map(|light| (&stage, light));
    let plain = shots(&gpu, &Config::Plain(Plain { map: map(128) }), pairs());
    for config in techniques(128) {
        for ((found, (plain, _)), light) in
            shots(&gpu, &config, pairs()).iter().zip(&plain).zip(&all)
        {
            assert!(plain.contains(&0.0) && plain.contains(&1.0), "light and shadow");
            assert_eq!(&found.0, plain, "{config:?} under {light:?}");
        }
        // The control: an extent shows.
        let soft = shoot(&gpu, &stage, &lights(0.5)[1], &config);
        assert!(soft.iter().any(|v| *v > 0.0 && *v < 1.0), "{config:?} has no penumbra");
    }
}

#[test]
fn shadows_are_no_larger_than_the_hard_one_and_all_numbers_are_shares() {
    let gpu = gpu();
    let stage = seen(&gpu, &bodies(), 64);
    let all: Vec<Light> = [1e-7, 0.3, 100.0].into_iter().flat_map(lights).collect();
    let pairs = || all.iter().map(|light| (&stage, light));
    let shadow = shots(&gpu, &Config::SingleSample(hard(128)), pairs());
    let (mut lit, mut lighter) = (0, 0);
    for config in techniques(128) {
        let is_inner = match &config {
            Config::SingleSample(c) => c.lookup != WidthLookup::Linear,
            _ => false,
        };
        for ((found, shadow), light) in shots(&gpu, &config, pairs()).iter().zip(&shadow).zip(&all)
        {
            for (found, shadow) in found.0.iter().zip(&shadow.0) {
                assert!((0.0..=1.0).contains(found), "{found} by {config:?} under {light:?}");
                if is_inner {
                    assert!(found >= shadow, "{found}, {shadow} by {config:?} under {light:?}");
                    assert!(*shadow == 0.0 || found == shadow, "lit is lit: {found}, {shadow}");
                    lit += usize::from(*shadow > 0.0);
                    lighter += usize::from(found > shadow);
                }
            }
        }
    }
    assert!(lit > 10_000 && lighter > 500, "{lit} lit samples, {lighter} in penumbrae");
}

/// Visibility in the middle of the shadow of a strip |x| <= `half` at the height 5, of a square light of half size 1 at 10.
fn below_a_strip(gpu: &Gpu, half: f64, config: &SingleSample) -> f32 {
    let scene = over_a_floor(12.0, [(sheet(half, 2.0), DVec3::Y * 5.0)]);
    let stage = on_the_floor(gpu, &scene, [DVec2::ZERO]);
    let light = Light::Rect { center: DVec3::Y * 10.0, half_u: DVec3::X, half_v: DVec3::Z };
    shoot(gpu, &stage, &light, &Config::SingleSample(*config))[0]
}

#[test]
fn the_middle_of_a_strip_is_right_and_that_of_a_disc_too_dark() {
    let gpu = gpu();
    for widths in [Widths::Euclidean, Widths::CityBlock, Widths::Doubling] {
        for neighbours in if widths == Widths::Doubling { vec![3, 4, 6, 8] } else { vec![6] } {
            // The strip hides 2 half of the light's half size, whose penumbra is 1 / 5 - 1 / 10 of a slope.
            for (half, truth) in [(0.25, 0.5), (0.125, 0.75), (0.5, 0.0)] {
                let config = SingleSample { neighbours, widths, ..exact(256) };
                let found = below_a_strip(&gpu, half, &config);
                // The strip is 250 texels wide, and 16 times as long: half a side of a texel of mean size is 2 of them.
                assert!((found - truth).abs() < 0.02, "{found}, not {truth}: {config:?}");
            }
        }
    }
    // A ball of radius 0.1 whose top is 6 m above the floor, under a sun of 0.05: 1 - 0.1 / 0.3, for 1 - (0.1 / 0.3)^2.
    let ball = generate::shapes::icosphere(4, 0.1);
    let scene = over_a_floor(4.0, [(ball, DVec3::Y * 5.9)]);
    let stage = on_the_floor(&gpu, &scene, [DVec2::ZERO]);
    let found = shoot(&gpu, &stage, &sun(0.05), &Config::SingleSample(exact(256)))[0];
    assert!((found - 2.0 / 3.0).abs() < 0.01, "below a small ball: {found}");
    let options = TruthOptions { light_samples: 4096, ..TruthOptions::default() };
    let truth = stage.truth(&sun(0.05), &options).visibility[0];
    // The ball's silhouette lies 0.1 m below its top.
    assert!((truth - (1.0 - (0.1f32 / 0.295).powi(2))).abs() < 0.01, "the truth: {truth}");
}

/// Behind a straight edge under a square light, with the distance t in halves of the penumbra from its middle, truth is
/// (1 + t) / 2. The hard shadow is off by (1 - |t|) / 2 on either side. A light of scale s is off by as much outside, and inside
/// by (1 - t) / 2 less (1 - s t) or all that is left: for s = 1 by the same again, and for s = 2 by less.
#[test]
fn behind_a_straight_edge_it_errs_as_much_as_the_hard_shadow_and_the_search_not_at_all() {
    let gpu = gpu();
    let center = DVec3::Y * 4.0;
    let light = Light::Rect { center, half_u: DVec3::X * 0.5, half_v: DVec3::Z * 0.5 };
    let edge = plate(&gpu, light, 1.6);
    let error = |config: SingleSample| edge.errors(&gpu, &Config::SingleSample(config)).0;
    let shadow = error(hard(1024));
    let single = error(exact(1024));
    assert!((single / shadow - 1.0).abs() < 0.03, "{single}, hard {shadow}");
    // Of the squares 1/12 outside, and inside ((1/2)^3 + (1/4)^3) / 4.5 + 1/96.
    let harder = error(SingleSample { scale: 2.0, ..exact(1024) });
    let squares: f64 = 1.0 / 12.0 + (0.125 + 0.015_625) / 4.5 + 1.0 / 96.0;
    let expected = (squares / (1.0 / 6.0)).sqrt();
    assert!((harder / shadow - expected).abs() < 0.03, "{harder}, hard {shadow}, {expected}");

    let search = Config::RadialSearch(RadialSearch { map: map(1024), ..Default::default() });
    let (rmse, width) = edge.errors(&gpu, &search);
    assert!(rmse <= 0.01 && width.abs() <= 0.03, "the search: RMSE {rmse}, width {width}");
    // Round lights' penumbrae are no straight ramps, and so this is off by up to 0.055, about 0.04 in the root mean square.
    let disc = Light::Disc { center, radius: 0.5, axis_u: DVec3::X, axis_v: DVec3::Z };
    let ball = Light::Sphere { center, radius: 0.5 };
    for light in [disc, ball, sun(0.15)] {
        let (rmse, _) = plate(&gpu, light, 1.6).errors(&gpu, &search);
        assert!(rmse > 0.01 && rmse <= 0.04, "the search under {light:?}: RMSE {rmse}");
    }
}

/// What one sample of the light knows of several occluders: what hides its centre, and where that ends.
#[test]
fn several_occluders_are_taken_for_the_one_that_hides_the_centre() {
    let gpu = gpu();
    // Without a cone, within which the lower of two sheets hides nothing.
    let bias = Bias { cone: 0.0, ..Bias::default() };
    let map = MapConfig { bias, ..map(1024) };
    let config = Config::SingleSample(SingleSample { map, ..exact(1024) });
    let search = Config::RadialSearch(RadialSearch { map, ..Default::default() });
    for (sheets, x, truth, single, searched) in [
        // A wire of 0.04: 0.05 of a light 2 wide is hidden. To the search its shadow is one of two edges.
        (&[(-0.02, 0.02, 2.0)][..], 0.0, 0.975, 0.975, 0.4875),
        // One strip in another's shadow, which together hide all.
        (&[(-0.2, 0.2, 2.0), (-0.35, 0.35, 8.0)], 0.0, 0.0, 0.75, 0.375),
        // A slit between two half-planes that the centre does not see.
        (&[(-50.0, 0.0, 2.0), (0.0, 50.0, 8.0)], -0.5, 0.4375, 0.0, 0.0),
        // Beside the light, and beside it and before it.
        (&[(1.2, 3.0, 2.0), (0.4, 3.0, 8.0)], 0.0, 1.0, 1.0, 1.0),
        (&[(-0.4, 0.4, 8.0), (1.4, 1.8, 2.0)], 0.0, 0.0, 0.0, 0.0),
    ] {
        let found = [&config, &search].map(|c| below_a_square_light(&gpu, sheets, x, c));
        let near = |found: f32, expected: f32| (found - expected).abs() < 0.03;
        assert!(near(found[0], single), "{sheets:?}, truth {truth}: {found:?}, not {single}");
        assert!(near(found[1], searched), "{sheets:?}, truth {truth}: {found:?}, not {searched}");
    }
}

#[test]
fn interpolated_depth_and_width_jump_at_the_border_of_a_coarse_shadow() {
    let gpu = gpu();
    // 2 m high on a map of 64 texels: half the penumbra is 0.2 m, and a texel 0.03 m.
    let scene = over_a_floor(4.0, [(sheet(1.0, 1.0), DVec3::Y * 2.0)]);
    let along = |i: u32| 0.7 + 0.45 * f64::from(i) / 1024.0;
    let stage = on_the_floor(&gpu, &scene, (0..1024).map(|i| DVec2::new(along(i), 0.013)));
    let jump = |lookup| {
        let config = Config::SingleSample(SingleSample { lookup, ..exact(64) });
        let found = shoot(&gpu, &stage, &sun(0.1), &config);
        let steps = found[..1024].windows(2).map(|pair| (pair[1] - pair[0]).abs());
        steps.fold(0.0, f32::max)
    };
    // One texel of 2 / 61 over 0.2, where width and depth fall to nothing together; half of it on average over others.
    let linear = jump(WidthLookup::Linear);
    assert!((linear - 0.16).abs() < 0.02, "interpolated both: {linear}");
    assert!(jump(WidthLookup::Texel) > 0.1, "a texel's own");
    // As steep as the ramp is, 0.45 / 1024 over 0.2.
    let border = jump(WidthLookup::Border);
    assert!(border < 0.004, "to the border: {border}");
}

#[test]
fn far_sides_make_a_shadow_as_hard_within_another_as_beside_it() {
    let gpu = gpu();
    let low = || (sheet(1.0, 1.0), DVec3::Y);
    // Within the lower plate's outline, so that widths stay the same.
    let high = (sheet(0.24, 0.3), DVec3::new(0.74, 2.0, 0.0));
    let point = [DVec2::new(0.95, 0.013)];
    let alone = on_the_floor(&gpu, &over_a_floor(3.0, [low()]), point);
    let both = on_the_floor(&gpu, &over_a_floor(3.0, [low(), high]), point);
    let light = |stage: &Stage, back| {
        let config = Config::SingleSample(SingleSample { back, ..exact(512) });
        shoot(&gpu, stage, &sun(0.1), &config)[0]
    };
    // 0.05 inside of 0.1, and of 0.2 below the upper plate.
    let near = |found: f32, expected: f32| assert!((found - expected).abs() < 0.03, "{found}");
    near(light(&alone, false), 0.5);
    near(light(&alone, true), 0.5);
    near(light(&both, false), 0.75);
    near(light(&both, true), 0.5);
}

#[test]
fn casters_around_the_light_on_all_sides_leave_the_hard_shadow() {
    // The width map knows no lit texel: the published method wants one plane behind all casters.
    let gpu = gpu();
    let walls = generate::shapes::cuboid(DVec3::new(-4.0, -0.5, -4.0), DVec3::new(4.0, 4.0, 4.0));
    let scene = over_a_floor(3.0, [(walls, DVec3::ZERO), (sheet(0.5, 0.5), DVec3::Y)]);
    let points = (0..512).map(|i| DVec2::new(f64::from(i) / 256.0 - 1.0, 0.013));
    let stage = on_the_floor(&gpu, &scene, points);
    let center = DVec3::Y * 3.0;
    let light = Light::Rect { center, half_u: DVec3::X * 0.3, half_v: DVec3::Z * 0.3 };
    let soft = |config| shoot(&gpu, &stage, &light, &config)[..512].to_vec();
    let single = soft(Config::SingleSample(single(256)));
    let partial = |all: &[f32]| all.iter().filter(|v| **v > 0.01 && **v < 0.99).count();
    assert_eq!(partial(&single), 0, "no penumbra");
    assert!(single.contains(&0.0) && single.contains(&1.0), "light and shadow");
    let search = RadialSearch { map: map(256), ..RadialSearch::default() };
    assert!(partial(&soft(Config::RadialSearch(search))) > 50, "the search has one");
}

#[test]
fn a_lone_convex_body_has_no_shadow_on_itself() {
    let gpu = gpu();
    let stages: Vec<Stage> = generate::CONVEX
        .iter()
        .map(|(name, ..)| seen(&gpu, &generate::by_name(name).expect("a scene"), 40))
        .collect();
    let all = || [0.05, 1.0].into_iter().flat_map(lights);
    let mut cases: Vec<(&Stage, Light)> =
        stages.iter().flat_map(|stage| all().map(move |light| (stage, light))).collect();
    cases.sort_by_key(|(_, light)| light.position().is_none());
    // 64 rays that all arrive leave the horizon a share of the light of 1/64 or so.
    let options = TruthOptions { light_samples: 64, ..TruthOptions::default() };
    let truths: Vec<_> = cases.iter().map(|(stage, light)| stage.truth(light, &options)).collect();
    let mut judged = 0;
    for config in [0, 2, 5].map(|i| techniques(128).remove(i)) {
        let found = shots(&gpu, &config, cases.iter().map(|(stage, light)| (*stage, light)));
        for (((found, _), truth), (_, light)) in found.iter().zip(&truths).zip(&cases) {
            let is_lit =
                |i: &usize| truth.class[*i] == SampleClass::Counted && truth.visibility[*i] == 1.0;
            for i in (0..found.len()).filter(is_lit) {
                assert!(found[i] >= 0.95, "{} by {config:?} under {light:?}", found[i]);
                judged += 1;
            }
        }
    }
    assert!(judged > 20_000, "{judged} samples");
}

#[test]
fn faces_of_the_turned_cube_meet_without_a_seam() {
    let gpu = gpu();
    // Faces change 2 m beside the light's foot. A plate lies across.
    let scene = over_a_floor(8.0, [(sheet(0.9, 0.7), DVec3::new(1.2, 0.8, 0.3))]);
    let pairs = (0..512).flat_map(|i| {
        let z = 4.0 * f64::from(i) / 512.0 - 2.0;
        [DVec2::new(1.999, z), DVec2::new(2.001, z)]
    });
    let stage = on_the_floor(&gpu, &scene, pairs);
    let center = DVec3::Y * 2.0;
    for light in [
        Light::Rect { center, half_u: DVec3::X * 0.3, half_v: DVec3::Z * 0.3 },
        Light::Disc { center, radius: 0.3, axis_u: DVec3::X, axis_v: DVec3::Z },
        Light::Sphere { center, radius: 0.3 },
    ] {
        for config in [Config::SingleSample(exact(512)), techniques(512).remove(5)] {
            let found = shoot(&gpu, &stage, &light, &config);
            let pairs = found[..1024].chunks(2);
            let partial = pairs.clone().filter(|p| p[0] > 0.02 && p[0] < 0.98).count();
            let off: f32 = pairs.map(|p| (p[0] - p[1]).abs()).sum::<f32>() / 512.0;
            assert!(partial > 20, "{config:?} under {light:?}: {partial} pairs in penumbra");
            assert!(off < 0.02, "{config:?} under {light:?}: {off} across the seam");
        }
    }
}

#[test]
fn work_is_affine_in_the_doublings_and_independent_of_triangles_and_samples() {
    const SIZE: u64 = 256;
    let gpu = gpu();
    let counters = |subdivisions, side, config: &SingleSample, tangent| {
        let ball = generate::shapes::icosphere(subdivisions, 0.5);
        let stage = seen(&gpu, &over_a_floor(4.0, [(ball, DVec3::Y * 2.0)]), side);
        let mut technique = config.build(&gpu).expect("a valid config");
        stage.shoot(&gpu, &sun(tangent), technique.as_mut(), 0).expect("a shot").counters
    };
    for doublings in 1..=8 {
        let config = SingleSample { doublings, ..single(SIZE as u32) };
        let found = [(0, 32), (4, 32), (4, 64)].map(|(n, side)| counters(n, side, &config, 0.1));
        for counters in &found {
            assert_eq!(counters["store_passes"], u64::from(doublings), "one pass each");
            assert_eq!(counters["store_texels"], u64::from(doublings) * SIZE * SIZE, "texels");
        }
        assert!(found[1]["map_triangles"] > 100 * found[0]["map_triangles"], "the control");
    }
    // By default as many as the penumbra asks for: half of one of 0.25 m and more in texels of 4 mm.
    let passes = |tangent| counters(1, 32, &single(SIZE as u32), tangent)["store_passes"];
    let [narrow, wide] = [0.004, 0.1].map(passes);
    assert!(narrow < wide && (5..=7).contains(&wide), "{narrow}, {wide} doublings");
    let hard = counters(1, 32, &single(SIZE as u32), 0.0);
    assert_eq!(hard["store_texels"], 0, "none for a light without an extent");
}

/// Times of the passes that make the width map, by doublings, neighbours and side: Table 1 of the paper, which is affine in
/// the doublings and grows with the texels.
#[test]
#[ignore = "measures time, for the technique's page: run it alone, with --nocapture"]
#[allow(clippy::print_stdout, reason = "the table is what it is for")]
fn times_of_the_width_map() {
    let gpu = gpu();
    let ball = generate::shapes::icosphere(4, 0.5);
    let stage = seen(&gpu, &over_a_floor(4.0, [(ball, DVec3::Y * 2.0)]), 64);
    let median = |config: &SingleSample| {
        let mut technique = config.build(&gpu).expect("a valid config");
        let shot = stage.shoot(&gpu, &sun(0.1), technique.as_mut(), 9).expect("a shot");
        let pass = |times: &antumbra_gpu::PassTimes| {
            times.passes.iter().filter(|p| p.name == "soft/widths").map(|p| p.ms).sum::<f64>()
        };
        let mut all: Vec<f64> = shot.passes.iter().map(pass).collect();
        all.sort_by(f64::total_cmp);
        all[all.len() / 2]
    };
    for size in [128, 256, 512, 1024] {
        let of = |widths, neighbours, doublings| {
            median(&SingleSample { widths, neighbours, doublings, ..single(size) })
        };
        for neighbours in [3, 6] {
            let times = [2, 4, 6, 8].map(|k| of(Widths::Doubling, neighbours, k));
            println!(
                "{size} texels, {neighbours} neighbours, 2, 4, 6, 8 doublings: {times:.2?} ms"
            );
        }
        let others = [Widths::CityBlock, Widths::Euclidean].map(|widths| of(widths, 6, 0));
        println!("{size} texels, city block and Euclidean: {others:.2?} ms");
    }
}

#[test]
fn cascades_hold_them_and_warps_are_refused_with_a_fix() {
    let gpu = gpu();
    let stage = seen(&gpu, &bodies(), 48);
    let light = Light::Directional {
        direction: DVec3::new(0.3, -1.0, 0.2).normalize(),
        angular_diameter: 0.1,
    };
    let of = || Box::new(Config::SingleSample(single(128)));
    let cascades = antumbra_sampling::Cascades { of: of(), ..Default::default() };
    let found = shoot(&gpu, &stage, &light, &Config::Cascades(cascades));
    assert!(found.iter().any(|v| *v > 0.05 && *v < 0.95), "a penumbra over cascades");
    // Seen along the floor, across the light.
    let camera = Camera {
        eye: DVec3::new(0.0, 0.6, 4.5),
        target: DVec3::Y * 0.5,
        up: DVec3::Y,
        fov_y: 0.8,
        near: 0.1,
    };
    let stage = Stage::new(&gpu, &bodies(), camera, 48, 48).expect("a stage");
    let lispsm = antumbra_sampling::Lispsm { of: of(), guard: false, ..Default::default() };
    let mut technique = Config::Lispsm(lispsm).build(&gpu).expect("a valid config");
    let refused = stage.shoot(&gpu, &light, technique.as_mut(), 0).err().map(|e| e.to_string());
    let fix = "use one map or cascades";
    assert!(refused.as_ref().is_some_and(|e| e.contains(fix)), "a warped map: {refused:?}");
}

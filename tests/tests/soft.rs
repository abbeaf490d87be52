//! Soft shadows from maps: hard where the light has no extent, exact behind one plate, finite always, and each
//! technique's own faults.

use crate::shared::area;

use antumbra::Config;
use antumbra_filter::PcfGrid;
use antumbra_gpu::Counters;
use antumbra_map::{Bias, MapConfig, Plain};
use antumbra_measure::Stage;
use antumbra_reference::{SampleClass, Truth, TruthOptions, ViewSample};
use antumbra_sampling::{CascadeFit, Cascades, Select, Splits};
use antumbra_scene::{Light, Scene, generate};
use antumbra_soft::{
    BackProjection, Bitmask, Hierarchy, Occluders, OcclusionTextures, Pattern, Pcss, Samples, Vssm,
    Window,
};
use antumbra_tests::gpu;
use area::{below_a_square_light, bodies, lights, map, mean, plate, seen, shoot, shots};
use glam::{DAffine3, DVec3, Vec3};

/// Every technique, at its defaults and at its most exact.
fn techniques(size: u32, window: Window) -> Vec<Config> {
    let map = map(size);
    let mask = |occluders, samples| {
        Config::Bitmask(Bitmask { map, window, samples, occluders, ..Bitmask::default() })
    };
    vec![
        Config::Pcss(Pcss { map, window, ..Pcss::default() }),
        Config::Pcss(Pcss { map, window, search: 0, filter: 0, ..Pcss::default() }),
        Config::BackProjection(BackProjection { map, window }),
        mask(Occluders::Micropatch, Samples::S256),
        mask(Occluders::ClosedMicropatch, Samples::S64),
        mask(Occluders::Microquad, Samples::S256),
        mask(Occluders::ExactMicroquad, Samples::S1024),
        mask(Occluders::Microtri, Samples::S256),
    ]
}

#[test]
fn a_light_without_an_extent_gives_the_plain_maps_bits() {
    let gpu = gpu();
    let stage = seen(&gpu, &bodies(), 64);
    let point = Light::Point { position: DVec3::new(0.4, 5.0, -0.3) };
    let spot = Light::Spot {
        position: DVec3::new(0.4, 5.0, -0.3),
        direction: DVec3::NEG_Y,
        outer_angle: 0.6,
    };
    let all: Vec<Light> = lights(0.0).into_iter().chain([point, spot]).collect();
    let pairs = || all.iter().map(|light| (&stage, light));
    let plain = shots(&gpu, &Config::Plain(Plain { map: map(128) }), pairs());
    for (plain, _) in &plain {
        assert!(plain.contains(&0.0) && plain.contains(&1.0), "light and shadow");
    }
    for config in techniques(128, Window::default()) {
        for ((found, (plain, _)), light) in
            shots(&gpu, &config, pairs()).iter().zip(&plain).zip(&all)
        {
            assert_eq!(&found.0, plain, "{config:?} under {light:?}");
        }
        // The control: an extent shows.
        let soft = shoot(&gpu, &stage, &lights(0.5)[1], &config);
        assert!(soft.iter().any(|v| *v > 0.0 && *v < 1.0), "{config:?} has no penumbra");
    }
}

#[test]
fn behind_one_plate_all_are_the_closed_form() {
    let gpu = gpu();
    let rect = Light::Rect {
        center: DVec3::new(0.0, 4.0, 0.0),
        half_u: DVec3::X * 0.5,
        half_v: DVec3::Z * 0.3,
    };
    let disc = Light::Disc {
        center: DVec3::new(0.0, 4.0, 0.0),
        radius: 0.5,
        axis_u: DVec3::X,
        axis_v: DVec3::Z,
    };
    let ball = Light::Sphere { center: DVec3::new(0.0, 4.0, 0.0), radius: 0.5 };
    let sun = Light::Directional { direction: DVec3::NEG_Y, angular_diameter: 0.3 };
    let map = map(1024);
    let window = Window { budget: 128, ..Window::default() };
    let mask = |samples| {
        let occluders = Occluders::Micropatch;
        Config::Bitmask(Bitmask { map, window, samples, occluders, ..Bitmask::default() })
    };
    let over = |pattern| {
        let (samples, occluders) = (Samples::S1024, Occluders::Micropatch);
        let rest = Bitmask::default();
        Config::Bitmask(Bitmask { map, window, samples, pattern, occluders, ..rest })
    };
    for light in [rect, disc, ball, sun] {
        let plate = plate(&gpu, light, 1.6);
        for (name, config) in [
            ("pcss", Config::Pcss(Pcss { map, window, search: 0, filter: 0, ..Pcss::default() })),
            ("pcss, 256 taps", Config::Pcss(Pcss { map, window, filter: 256, ..Pcss::default() })),
            ("back projection", Config::BackProjection(BackProjection { map, window })),
            ("bitmask", mask(Samples::S256)),
            ("bitmask, 1024", mask(Samples::S1024)),
            ("bitmask, jittered", over(Pattern::Jittered)),
            ("bitmask, Hammersley", over(Pattern::Hammersley)),
            ("bitmask, Poisson", over(Pattern::Poisson)),
        ] {
            let (rmse, width) = plate.errors(&gpu, &config);
            assert!(rmse <= 0.01, "{name} under {light:?}: RMSE {rmse}");
            assert!(width.abs() <= 0.03, "{name} under {light:?}: width off by {width}");
        }
        // The control: a kernel that does not know how wide the penumbra is.
        let fixed = Config::PcfGrid(PcfGrid { map, side: 7 });
        let (rmse, _) = plate.errors(&gpu, &fixed);
        assert!(rmse > 0.05, "a fixed kernel under {light:?}: RMSE {rmse}");
    }
}

#[test]
fn what_theory_says_of_two_sheets_holds_from_casters_to_visibility() {
    let gpu = gpu();
    let window = |umbra| Window { umbra, budget: 128, ..Window::default() };
    let areas =
        |umbra| Config::BackProjection(BackProjection { map: map(1024), window: window(umbra) });
    let mask = |occluders, umbra| {
        let window = window(umbra);
        Config::Bitmask(Bitmask { map: map(1024), window, occluders, ..Bitmask::default() })
    };
    // Windows of up to 400 texels in blocks of 4, of up to 2 / 256 of slope: k 10 / 8 2 / 256 a side.
    let near = |found: f32, truth: f32, what: &str| {
        assert!((found - truth).abs() < 0.04, "{what}: {found}, not {truth}");
    };
    // A slit between surfaces of different depth, which the light's centre does not see.
    let slit = [(-50.0, 0.0, 2.0), (0.0, 50.0, 8.0)];
    near(below_a_square_light(&gpu, &slit, -0.5, &areas(false)), 0.4375, "slit, areas");
    let patches = mask(Occluders::Micropatch, false);
    near(below_a_square_light(&gpu, &slit, -0.5, &patches), 0.4375, "slit, micropatches");
    // With the cone not all of the far sheet counts as nearer than the receiver, and it is seen even so.
    near(below_a_square_light(&gpu, &slit, -0.5, &areas(true)), 0.4375, "slit, areas, with umbra");
    let bias = Bias { cone: 0.0, ..Bias::default() };
    let umbra = Config::BackProjection(BackProjection {
        map: MapConfig { bias, ..map(1024) },
        window: window(true),
    });
    near(below_a_square_light(&gpu, &slit, -0.5, &umbra), 0.0, "slit, taken for umbra");
    let quads = mask(Occluders::Microquad, false);
    for occluders in [Occluders::ClosedMicropatch, Occluders::Microquad] {
        let no_cone = Config::Bitmask(Bitmask {
            map: MapConfig { bias, ..map(1024) },
            window: window(false),
            occluders,
            ..Bitmask::default()
        });
        let found = below_a_square_light(&gpu, &slit, -0.5, &no_cone);
        near(found, 0.0, "slit, without gaps");
    }
    // Beside the light, and beside it and before it.
    let beside = [(1.2, 3.0, 2.0), (0.4, 3.0, 8.0)];
    near(below_a_square_light(&gpu, &beside, 0.0, &areas(true)), 1.0, "beside, areas");
    let before = [(-0.4, 0.4, 8.0), (1.4, 1.8, 2.0)];
    near(below_a_square_light(&gpu, &before, 0.0, &areas(true)), 0.0, "before, areas");
    near(below_a_square_light(&gpu, &before, 0.0, &quads), 0.0, "before, microquads");
    // One in another's shadow: 0 is true.
    let hidden = [(-0.2, 0.2, 2.0), (-0.35, 0.35, 8.0)];
    near(below_a_square_light(&gpu, &hidden, 0.0, &areas(true)), 0.75, "hidden, areas");
    // And joined: what both hide, and what either does.
    let both = [(-50.0, 0.0, 4.0), (-50.0, 0.0, 6.0)];
    near(below_a_square_light(&gpu, &both, 0.0, &quads), 0.5, "both, microquads");
    let either = [(-50.0, 0.0, 4.0), (0.0, 50.0, 6.0)];
    near(below_a_square_light(&gpu, &either, 0.0, &quads), 0.0, "either, microquads");
}

#[test]
fn faces_of_the_turned_cube_meet_without_a_seam() {
    const SIDE: i32 = 96;
    let gpu = gpu();
    // A low light: on the floor faces change along a square of 2 m about it, turned as the light is, and bodies stand on it.
    let mut scene = Scene { name: "seams".to_owned(), ..Scene::default() };
    scene.add(generate::shapes::floor(6.0), DAffine3::IDENTITY);
    for i in 0..12 {
        let angle = f64::from(i) * std::f64::consts::TAU / 12.0;
        let place = DVec3::new(1.3 * angle.cos(), 0.6 + 0.05 * f64::from(i), 1.3 * angle.sin());
        let half = DVec3::splat(0.14);
        let turn = DAffine3::from_translation(place) * DAffine3::from_rotation_y(angle);
        scene.add(generate::shapes::cuboid(-half, half), turn);
    }
    let origin = scene.origin();
    let place = |i: i32| (f64::from(i) + 0.5) * 7.0 / f64::from(SIDE) - 3.5;
    let points: Vec<DVec3> =
        (0..SIDE * SIDE).map(|i| DVec3::new(place(i % SIDE), 0.0, place(i / SIDE))).collect();
    let samples: Vec<ViewSample> = points
        .iter()
        .map(|p| ViewSample { position: (*p - origin).as_vec3(), normal: Vec3::Y })
        .collect();
    let stage = Stage::at_points(&gpu, &scene, &samples).expect("a stage");
    let center = DVec3::Y * 2.0;
    let all = [
        Light::Rect { center, half_u: DVec3::X * 0.2, half_v: DVec3::Z * 0.3 },
        Light::Disc { center, radius: 0.25, axis_u: DVec3::X, axis_v: DVec3::Z },
        Light::Sphere { center, radius: 0.2 },
    ];
    let options = TruthOptions { light_samples: 256, ..TruthOptions::default() };
    let truths: Vec<_> = all.iter().map(|light| stage.truth(light, &options)).collect();
    for config in techniques(512, Window::default()) {
        let found = shots(&gpu, &config, all.iter().map(|light| (&stage, light)));
        for (((found, _), truth), light) in found.iter().zip(&truths).zip(&all) {
            // Mean error within a tenth of a metre of the seam, and within two on either side of that: what a seam adds of its own
            // shows in the former alone.
            let mut errors = [Vec::new(), Vec::new()];
            for (i, p) in points.iter().enumerate() {
                let from_seam = (p.x.abs().max(p.z.abs()) - 2.0).abs();
                if from_seam < 0.3 && truth.class[i] == SampleClass::Counted {
                    let side = usize::from(from_seam >= 0.1);
                    errors[side].push(f64::from((found[i] - truth.visibility[i]).abs()));
                }
            }
            let [(near, by), (far, or_by)] = errors.each_ref().map(|errors| mean(errors));
            assert!(errors[0].len() > 300 && far > 0.0, "{} samples", errors[0].len());
            // Samples as they happen to fall on either side: beyond four standard errors once in 30 000 times.
            assert!(
                near < far + 4.0 * by.hypot(or_by),
                "{config:?} under {light:?}: {near} +- {by} at the seam, {far} +- {or_by} elsewhere"
            );
            assert!(far < 0.05, "{config:?} under {light:?}: {far} everywhere");
        }
    }
}

#[test]
fn bounds_of_depth_change_no_answer_and_leave_the_penumbra_to_evaluate() {
    let gpu = gpu();
    let stage = seen(&gpu, &bodies(), 64);
    let window = |hierarchy, umbra| Window { hierarchy, umbra, tally: true, ..Window::default() };
    let all = lights(0.3);
    let pairs = || all.iter().map(|light| (&stage, light));
    let kinds = [Hierarchy::Mip, Hierarchy::Y, Hierarchy::Multiscale];
    for without in techniques(128, window(Hierarchy::None, false)) {
        let plain = shots(&gpu, &without, pairs());
        // Of one technique all kinds, since they differ in nothing else.
        let kinds =
            if matches!(without, Config::BackProjection(_)) { &kinds[..] } else { &kinds[..1] };
        for kind in kinds {
            let mut with = without.clone();
            match &mut with {
                Config::BackProjection(config) => config.window.hierarchy = *kind,
                Config::Bitmask(config) => config.window.hierarchy = *kind,
                // Taps of a search lie elsewhere in a narrower window, and its mean is another.
                _ => continue,
            }
            for ((a, b), light) in shots(&gpu, &with, pairs()).iter().zip(&plain).zip(&all) {
                assert_eq!(a.0, b.0, "{with:?} under {light:?}");
            }
        }
    }
    let areas = |hierarchy| {
        let window = window(hierarchy, hierarchy != Hierarchy::None);
        let config = Config::BackProjection(BackProjection { map: map(128), window });
        shots(&gpu, &config, pairs())
    };
    let without = areas(Hierarchy::None);
    let each = kinds.map(areas);
    for (i, light) in all.iter().enumerate() {
        let options = TruthOptions { light_samples: 64, ..TruthOptions::default() };
        let truth = stage.truth(light, &options);
        let penumbra = truth.visibility.iter().filter(|v| **v > 0.0 && **v < 1.0).count() as u64;
        let count = |of: &Vec<(Vec<f32>, Counters)>, name: &str| of[i].1[name];
        let [mip, y, multiscale] = [0, 1, 2].map(|k| count(&each[k], "samples_penumbra"));
        assert!(multiscale >= penumbra / 2, "the penumbra is evaluated under {light:?}");
        assert!(
            mip < count(&without, "samples_penumbra")
                && count(&each[0], "occluders") < count(&without, "occluders"),
            "and little else: {:?}, {:?}",
            each[0][i].1,
            without[i].1
        );
        // Tighter bounds leave less; a Y map is as tight but for what its fourfold texels hold beside the window.
        assert!(multiscale <= y && y <= mip, "{multiscale}, {y}, {mip} under {light:?}");
        let [mip, y, multiscale] = [0, 1, 2].map(|k| count(&each[k], "occluders"));
        assert!(multiscale <= y && y <= mip, "{multiscale}, {y}, {mip} occluders under {light:?}");
        assert!(multiscale < mip, "{multiscale}, {mip} occluders under {light:?}");
    }
    let looked_at = |shots: &[(Vec<f32>, Counters)]| -> u64 {
        shots.iter().map(|(_, counters)| counters["occluders"]).sum()
    };
    // The near plane, which is fitted to the casters that matter, leaves the pyramid a quarter to save at least.
    let all = [looked_at(&without), looked_at(&each[0])];
    assert!(4 * all[1] < 3 * all[0], "occluders looked at: {all:?}");
    // Without a camera views are as wide as all casters: there it leaves a tenth. A sun's windows grow with the depth range and
    // not beyond it: of these it spares least. And what it leaves depends on what casts, not on the near plane.
    let mut unfitted = seen(&gpu, &bodies(), 64);
    unfitted.set_camera(None);
    let wide = [Hierarchy::None, Hierarchy::Mip].map(|hierarchy| {
        let window = window(hierarchy, hierarchy != Hierarchy::None);
        let config = Config::BackProjection(BackProjection { map: map(128), window });
        let found = shots(&gpu, &config, lights(0.3).iter().map(|light| (&unfitted, light)));
        found.iter().map(|(_, counters)| counters["occluders"]).collect::<Vec<u64>>()
    });
    for (i, light) in lights(0.3).iter().enumerate() {
        let [brute, pyramid] = [wide[0][i], wide[1][i]];
        let is_sun = matches!(light, Light::Directional { .. });
        // Eighths of what brute force looks at that may be left.
        let most = if is_sun { 5 } else { 1 };
        assert!(8 * pyramid < most * brute, "occluders looked at without a camera: {wide:?}");
        let fitted = each[0][i].1["occluders"];
        assert!(
            fitted <= pyramid,
            "a fitted view looks at more under {light:?}: {fitted}, {wide:?}"
        );
    }
}

#[test]
fn lights_of_any_size_near_and_far_give_numbers_from_0_to_1() {
    let gpu = gpu();
    let mut scene = bodies();
    // A sheet that touches the light, and one that touches the floor.
    let at_light = generate::shapes::quad(DVec3::new(0.4, 5.0, -0.3), DVec3::X * 0.1, DVec3::Z);
    scene.add(at_light, DAffine3::IDENTITY);
    let on_floor = generate::shapes::quad(DVec3::ZERO, DVec3::X * 0.5, DVec3::Y * 0.5);
    scene.add(on_floor, DAffine3::IDENTITY);
    let stage = seen(&gpu, &scene, 32);
    let mut all: Vec<Light> = [1e-7, 1e-3, 0.3, 4.0, 100.0].into_iter().flat_map(lights).collect();
    // Those of one layout after another, so that passes are compiled but twice.
    all.sort_by_key(|light| light.position().is_none());
    for config in techniques(64, Window { budget: 16, ..Window::default() }) {
        let found = shots(&gpu, &config, all.iter().map(|light| (&stage, light)));
        for ((found, _), light) in found.iter().zip(&all) {
            let wrong = found.iter().find(|v| !(0.0..=1.0).contains(*v));
            assert_eq!(wrong, None, "{config:?} under {light:?}");
        }
    }
}

#[test]
fn a_lone_convex_body_shadows_nothing() {
    let gpu = gpu();
    let stages: Vec<Stage> =
        ["convex-sphere", "convex-cube", "convex-tetrahedron", "convex-cylinder"]
            .map(|name| seen(&gpu, &generate::by_name(name).expect("a scene"), 40))
            .into();
    let mut cases: Vec<(&Stage, Light)> = Vec::new();
    for stage in &stages {
        cases.extend([0.05, 1.0].into_iter().flat_map(lights).map(|light| (stage, light)));
    }
    cases.sort_by_key(|(_, light)| light.position().is_none());
    // 64 rays that all arrive leave the horizon a share of the light of 1/64 or so.
    let options = TruthOptions { light_samples: 64, ..TruthOptions::default() };
    let truths: Vec<_> = cases.iter().map(|(stage, light)| stage.truth(light, &options)).collect();
    let mut judged = 0;
    for config in techniques(128, Window::default()) {
        let found = shots(&gpu, &config, cases.iter().map(|(stage, light)| (*stage, light)));
        for (((found, _), truth), (_, light)) in found.iter().zip(&truths).zip(&cases) {
            let is_lit =
                |i: &usize| truth.class[*i] == SampleClass::Counted && truth.visibility[*i] == 1.0;
            let lit: Vec<f32> = (0..found.len()).filter(is_lit).map(|i| found[i]).collect();
            judged += lit.len();
            let acne = lit.iter().filter(|v| **v < 0.95).count();
            assert_eq!(acne, 0, "of {} samples: {config:?} under {light:?}", lit.len());
        }
    }
    assert!(judged > 50_000, "{judged} samples");
}

/// Squared errors of the samples that see a part of the light.
fn squares_in_penumbra(found: &[f32], truth: &Truth) -> Vec<f64> {
    let in_penumbra = |i: &usize| {
        let t = truth.visibility[*i];
        truth.class[*i] == SampleClass::Counted && t > 0.0 && t < 1.0
    };
    let all = (0..found.len()).filter(in_penumbra);
    all.map(|i| f64::from(found[i] - truth.visibility[i]).powi(2)).collect()
}

/// Root of their mean.
fn in_penumbra(found: &[f32], truth: &Truth) -> f64 {
    mean(&squares_in_penumbra(found, truth)).0.sqrt()
}

#[test]
fn the_more_a_technique_knows_the_less_it_errs_in_penumbrae() {
    let gpu = gpu();
    let light = Light::Rect {
        center: DVec3::new(0.5, 6.0, 0.5),
        half_u: DVec3::X * 0.6,
        half_v: DVec3::Z * 0.6,
    };
    for name in ["sphere", "tree"] {
        let scene = generate::by_name(name).expect("a scene");
        let stage = seen(&gpu, &scene, 96);
        let truth =
            stage.truth(&light, &TruthOptions { light_samples: 1024, ..TruthOptions::default() });
        let map = map(512);
        let window = Window::default();
        let mask =
            |occluders| Config::Bitmask(Bitmask { map, window, occluders, ..Bitmask::default() });
        let squares =
            |config: &Config| squares_in_penumbra(&shoot(&gpu, &stage, &light, config), &truth);
        let error = |config: &Config| mean(&squares(config)).0.sqrt();
        let [fixed, varied] = [
            squares(&Config::PcfGrid(PcfGrid { map, side: 5 })),
            squares(&Config::Pcss(Pcss { map, ..Pcss::default() })),
        ];
        // Sample by sample, whose mean is no accident of four standard errors.
        let gains: Vec<f64> = fixed.iter().zip(&varied).map(|(a, b)| a - b).collect();
        let (gain, by) = mean(&gains);
        assert!(gain > 4.0 * by, "{name}: PCSS errs less than a fixed kernel by {gain} +- {by}");
        let errors = [
            mean(&varied).0.sqrt(),
            error(&Config::BackProjection(BackProjection { map, window })),
            error(&mask(Occluders::Micropatch)),
            error(&mask(Occluders::ClosedMicropatch)),
            error(&mask(Occluders::Microquad)),
            error(&mask(Occluders::ExactMicroquad)),
            error(&mask(Occluders::Microtri)),
        ];
        let [pcss, areas, patches, closed, quads, exact, tris] = errors;
        if name == "sphere" {
            assert!(pcss > areas, "PCSS {pcss}, areas {areas}");
            // Smooth surfaces: whatever closes the gaps wins.
            assert!(pcss > patches && patches > quads && patches > closed, "{errors:?}");
            assert!(patches > exact && patches > tris, "{errors:?}");
        } else {
            // Leaves and twigs about as wide as a texel: quads lose them, and the more so the less is kept. What overlaps there
            // counts more than once for areas, so that they are no better than PCSS.
            assert!(closed < patches && tris < exact, "{errors:?}");
        }
    }
}

#[test]
fn quads_lose_half_a_block_at_silhouettes_and_patches_leak_as_much_whatever_a_block_is() {
    const BUDGETS: [u32; 4] = [8, 16, 32, 64];
    let gpu = gpu();
    let stage = seen(&gpu, &generate::by_name("sphere").expect("a scene"), 96);
    let light = Light::Rect {
        center: DVec3::new(0.5, 6.0, 0.5),
        half_u: DVec3::X * 0.6,
        half_v: DVec3::Z * 0.6,
    };
    let options = TruthOptions { light_samples: 1024, ..TruthOptions::default() };
    let truth = stage.truth(&light, &options);
    let errors = |occluders, layers| {
        BUDGETS.map(|budget| {
            let window = Window { budget, ..Window::default() };
            let rest = Bitmask::default();
            let config = Bitmask { map: map(1024), window, occluders, layers, ..rest };
            let found = shoot(&gpu, &stage, &light, &Config::Bitmask(config));
            in_penumbra(&found, &truth)
        })
    };
    let quads = errors(Occluders::Microquad, 2);
    let patches = errors(Occluders::Micropatch, 1);
    // Half a block at each border: with each doubling half of the error, but for that of samples, and of the texels.
    assert!(quads.windows(2).all(|e| e[1] < e[0] / 1.4), "quads {quads:?}");
    assert!(quads[3] < quads[0] / 5.0, "quads {quads:?}");
    // A surface that recedes leaves the same share open between texels of any size.
    let (least, most) = patches.iter().fold((f64::MAX, 0.0), |(a, b), e| (e.min(a), e.max(b)));
    assert!(most < 1.3 * least, "patches {patches:?}");
    // So that quads are worse where blocks are coarse, and better where they are fine.
    assert!(quads[0] > patches[0] && quads[3] < 0.5 * patches[3], "{quads:?}, {patches:?}");
}

#[test]
fn empty_texels_hide_no_wide_sun_from_receivers_beyond_the_maps_end() {
    let gpu = gpu();
    // A ball high above the floor: the map ends with it.
    let mut scene = Scene { name: "ball".to_owned(), ..Scene::default() };
    scene.add(generate::shapes::floor(8.0), DAffine3::IDENTITY);
    let ball = generate::shapes::icosphere(3, 0.5);
    scene.add(ball, DAffine3::from_translation(DVec3::Y * 3.0));
    let stage = seen(&gpu, &scene, 64);
    let light = Light::Directional {
        direction: DVec3::new(0.3, -1.0, 0.2).normalize(),
        angular_diameter: 0.15,
    };
    let truth = stage.truth(&light, &TruthOptions { light_samples: 64, ..TruthOptions::default() });
    for config in techniques(256, Window::default()) {
        let found = shoot(&gpu, &stage, &light, &config);
        let dark = (0..found.len())
            .filter(|i| truth.class[*i] == SampleClass::Counted && truth.visibility[*i] == 1.0)
            .filter(|i| found[*i] < 0.5)
            .count();
        assert_eq!(dark, 0, "lit samples are dark by {config:?}");
    }
}

#[test]
fn soft_shadows_run_over_cascades_hard_and_wide() {
    let gpu = gpu();
    let stage = seen(&gpu, &bodies(), 48);
    let all = [0.0, 0.1].map(|angular_diameter| Light::Directional {
        direction: DVec3::new(0.3, -1.0, 0.2).normalize(),
        angular_diameter,
    });
    let error = |found: &[f32], light: &Light| {
        let options = TruthOptions { light_samples: 64, ..TruthOptions::default() };
        let truth = stage.truth(light, &options);
        let counted = (0..found.len()).filter(|i| truth.class[*i] == SampleClass::Counted);
        let off = counted.map(|i| f64::from((found[i] - truth.visibility[i]).abs()));
        off.sum::<f64>() / found.len() as f64
    };
    // One estimator of each kind: the rest are other occluders, whose windows are the same.
    let mut configs: Vec<Config> =
        techniques(128, Window::default()).into_iter().step_by(2).collect();
    configs.push(Config::Vssm(Vssm { map: map(128), ..Vssm::default() }));
    configs.push(Config::OcclusionTextures(OcclusionTextures {
        map: map(128),
        ..OcclusionTextures::default()
    }));
    for of in configs {
        let over = Config::Cascades(Cascades {
            of: Box::new(of.clone()),
            count: 4,
            splits: Splits::default(),
            select: Select::Map,
            blend: 0.1,
            fit: CascadeFit::Steady,
        });
        for light in &all {
            let (single, cascaded) =
                (shoot(&gpu, &stage, light, &of), shoot(&gpu, &stage, light, &over));
            let (single, cascaded) = (error(&single, light), error(&cascaded, light));
            // Windows end with their cascade, and of what lies beyond nothing is known.
            assert!(cascaded < single + 0.02, "{of:?} under {light:?}: {cascaded}, {single}");
        }
    }
}

//! Filters whose kernel is the pixel's, filters that ring, and filters that fail: on scenes with known numbers.

use antumbra::{Config, catalogue};
use antumbra_filter::{
    BlurredDepth, Convolution, Esm, Evsm, Fallback, Interleaved, Msm, MultipleDepth, PcfAdaptive,
    PcfBilinearGrid, PcfFootprint, PcfGrid, Prefilter, Savsm, Shape, SoftComparison, Table, Vsm,
    twin,
};
use antumbra_gpu::{Gpu, TechniqueConfig};
use antumbra_map::{Bias, MapConfig, MapTechnique, Plain};
use antumbra_measure::Stage;
use antumbra_reference::{TruthOptions, ViewSample};
use antumbra_scene::generate::{self, shapes};
use antumbra_scene::{Camera, Light, LightKind, Scene};
use antumbra_tests::gpu;
use glam::{DAffine3, DVec3, Vec3};

#[path = "shared/slabs.rs"]
mod slabs;

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

/// Linear depth of the height `y` in a map of `scene` under the overhead sun.
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
    move |y| linear.of(clip.project_point3(y * DVec3::Y - origin).z)
}

fn most(values: &[f32]) -> f32 {
    values.iter().copied().fold(0.0, f32::max)
}

/// Mean absolute difference.
fn difference(a: &[f32], b: &[f32]) -> f64 {
    let sum: f64 = a.iter().zip(b).map(|(a, b)| f64::from((a - b).abs())).sum();
    sum / a.len() as f64
}

#[test]
fn a_table_is_a_blurred_map_whatever_the_radius() {
    let gpu = gpu();
    let scene = sphere_and_box();
    let stage = Stage::new(&gpu, &scene, scene.camera_or_framing(), 96, 96).expect("a stage");
    // The cone is allowed by this very window's spread, and by a blur's largest one.
    let bias = Bias { cone: 0.0, ..Bias::default() };
    let map = MapConfig { size: 200, bias, ..MapConfig::default() };
    let mut soft = 0;
    for kind in [LightKind::Directional, LightKind::Spot, LightKind::Point] {
        let light = scene.place_light(kind);
        for radius in [0, 1, 5, 15] {
            // A variance of 0.01 at least, so that what is rounded off moments, 2e-6 of the range's square, moves
            // visibility by 4e-4 at most: the store's half as much again.
            let deviation = 0.1;
            let filter = Prefilter { shape: Shape::Box, radius };
            let blurred =
                shoot(&gpu, &stage, &light, &Vsm { map, filter, deviation, ..Vsm::default() });
            let table = Savsm {
                map,
                radius: radius as f32,
                follow_pixels: false,
                deviation,
                ..Savsm::default()
            };
            let mut technique = table.technique(&gpu).expect("a valid config");
            let shot = stage.shoot(&gpu, &light, &mut technique, 0).expect("a shot");
            assert_eq!(shot.counters["fetches"], 96 * 96 * 16, "reads at a radius of {radius}");
            // A window ends at the map's border, beyond which a blur repeats the border's texels.
            let reach = f64::from(radius) + 1.0;
            let at_border = |p: Vec3| {
                technique.map().views().iter().filter_map(|view| view.clip).any(|clip| {
                    let c = clip * p.as_dvec3().extend(1.0);
                    let ndc = c.truncate().truncate() / c.w;
                    c.w > 0.0
                        && ((1.0 - ndc.abs()) * 0.5 * f64::from(map.size)).min_element() < reach
                })
            };
            let pairs = blurred.iter().zip(&shot.visibility).zip(&stage.image.positions);
            let inner = pairs.filter(|(_, p)| !at_border(**p));
            let off = inner.map(|((a, b), _)| (a - b).abs()).fold(0.0, f32::max);
            assert!(off <= 6e-4, "{kind:?}, {radius}: off by {off}");
            soft += blurred.iter().filter(|v| (0.3..0.95).contains(*v)).count();
        }
    }
    assert!(soft > 300, "{soft} samples between light and dark");
    // The control: another box.
    let light = scene.place_light(LightKind::Directional);
    let of =
        |radius| Savsm { map, radius, follow_pixels: false, deviation: 0.1, ..Savsm::default() };
    let [a, b] = [2.0, 2.5].map(|r| shoot(&gpu, &stage, &light, &of(r)));
    let off = a.iter().zip(&b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(off > 0.01, "a box of 6 texels passes for one of 5: {off}");
}

#[test]
fn a_table_of_integers_keeps_a_plane_flat_where_floats_do_not() {
    let gpu = gpu();
    // Lit floor far from a slab, and a floor in the map.
    let scene = slabs(&[(7.0, -5.0, -4.0), (3.0 - 1e-3, -5.0, 5.0)]);
    let bias = Bias { cone: 0.0, ..Bias::default() };
    let map = MapConfig { size: 1024, bias, ..MapConfig::default() };
    let dark = |table| {
        let config = Savsm { map, radius: 1.0, follow_pixels: false, table, ..Savsm::default() };
        let points: Vec<ViewSample> = (0..4096)
            .map(|i| {
                let (x, z) = (f64::from(i % 64) / 64.0, f64::from(i / 64) / 64.0);
                let position = DVec3::new(3.5 + x, FLOOR, 3.5 + z) - scene.origin();
                ViewSample { position: position.as_vec3(), normal: Vec3::Y }
            })
            .collect();
        let stage = Stage::at_points(&gpu, &scene, &points).expect("a stage");
        let found = shoot(&gpu, &stage, &overhead(), &config);
        found[..4096].iter().filter(|v| **v < 1.0).count()
    };
    assert_eq!(dark(Table::Fixed), 0, "integers");
    let noisy = dark(Table::Float);
    assert!(noisy > 100, "floats see no relief: {noisy} samples");
}

/// Slats of 0.1 m every 0.4 m at a height of 1 m over a floor of 20 m, under an overhead sun, and a camera below them that
/// looks across them to the horizon.
fn slatted() -> (Scene, Camera) {
    let mut scene = Scene::default();
    scene.add(shapes::floor(10.0), DAffine3::IDENTITY);
    for i in 0..50 {
        let center = DVec3::new(0.0, 1.0, -10.0 + 0.4 * f64::from(i) + 0.2);
        scene.add(shapes::quad(center, 0.05 * DVec3::Z, 10.0 * DVec3::X), DAffine3::IDENTITY);
    }
    let camera = Camera {
        eye: DVec3::new(0.03, 0.8, 9.0),
        target: DVec3::new(0.4, 0.0, -1.0),
        up: DVec3::Y,
        fov_y: 60_f64.to_radians(),
        near: 0.05,
    };
    (scene, camera)
}

/// The truth of a view, each pixel the mean of `n` x `n` points of the surface behind it; and whether all of these lie on
/// the floor.
fn supersampled(gpu: &Gpu, scene: &Scene, camera: Camera, side: u32, n: u32) -> Vec<(f32, bool)> {
    let fine = Stage::new(gpu, scene, camera, side * n, side * n).expect("a stage");
    let truth = fine.truth(&overhead(), &TruthOptions::default()).visibility;
    let pixel = |x: u32, y: u32| {
        let points = (0..n * n).map(|k| ((y * n + k / n) * side * n + x * n + k % n) as usize);
        let on_floor = points.clone().all(|i| fine.image.normals[i].y > 0.9);
        let mean = points.map(|i| truth[i]).sum::<f32>() / (n * n) as f32;
        (mean, on_floor)
    };
    (0..side * side).map(|i| pixel(i % side, i / side)).collect()
}

#[test]
fn kernels_of_the_pixels_size_do_not_alias() {
    const SIDE: u32 = 64;
    let gpu = gpu();
    let (scene, camera) = slatted();
    let truth = supersampled(&gpu, &scene, camera, SIDE, 8);
    let stage = Stage::new(&gpu, &scene, camera, SIDE, SIDE).expect("a stage");
    let floor: Vec<usize> = (0..truth.len()).filter(|i| truth[*i].1).collect();
    assert!(floor.len() > 800, "{} pixels of floor", floor.len());
    let errors = |config: &dyn TechniqueConfig| {
        let found = shoot(&gpu, &stage, &overhead(), config);
        let pick = |v: &dyn Fn(usize) -> f32| floor.iter().map(|i| v(*i)).collect::<Vec<_>>();
        difference(&pick(&|i| found[i]), &pick(&|i| truth[i].0))
    };
    let map = |size| MapConfig { size, ..MapConfig::default() };
    let reconstructed = errors(&PcfBilinearGrid { map: map(1024), side: 1 });
    let footprint = |size, largest| errors(&PcfFootprint { map: map(size), largest });
    let found = footprint(1024, 48.0);
    // Up to 20 texels a pixel at the far end of the floor.
    assert!(found < 0.35 * reconstructed, "{found}, and {reconstructed} by one texel's tent");
    // A finer map makes it better still: what is left is the map's own error.
    let coarse = footprint(256, 12.0);
    assert!(found < coarse, "{found} with 1024 texels, {coarse} with 256");
    // The same footprints as boxes of a table. Slats are level with one another and the floor is parallel: two depths,
    // so Chebyshev's bound is exact.
    // The bias cone of windows so wide would reach from the floor to the slats.
    let bias = Bias { cone: 0.0, ..Bias::default() };
    let map = MapConfig { bias, ..map(1024) };
    let table = Savsm { map, largest: 31.0, ..Savsm::default() };
    let boxes = errors(&table);
    assert!(boxes < 0.5 * reconstructed, "{boxes}, and {reconstructed} by one texel's tent");
    let fixed = errors(&Savsm { follow_pixels: false, ..table });
    assert!(boxes < 0.6 * fixed, "{boxes}, and {fixed} by two texels whatever the pixel");
}

#[test]
fn without_a_camera_or_magnified_a_footprint_is_a_texels() {
    let gpu = gpu();
    let (map, _) = settings();
    let scene = slabs(&[(7.0, -5.0, 0.0), (7.0, 4.0, 5.0)]);
    let found = across(&gpu, &scene, &PcfFootprint { map, ..PcfFootprint::default() });
    // The profile of exp(-2 d²) - exp(-2), d in texels of 10 / 512 m and a little, is wider than a texel and narrower
    // than two on either side.
    let soft = found.iter().filter(|v| (0.001..0.999).contains(*v)).count();
    let texel = 10.0 / 500.0 / (0.8 / 1024.0);
    assert!((texel..2.2 * texel).contains(&(soft as f64)), "{soft} samples, {texel} a texel");
    let rises = found.windows(2).filter(|p| p[1] < p[0] - 1e-6).count();
    assert_eq!(rises, 0, "the profile falls");
}

#[test]
fn a_pixels_parts_join_to_the_whole_on_one_surface() {
    const SIDE: u32 = 24;
    let gpu = gpu();
    let scene = sphere_and_box();
    let light = scene.place_light(LightKind::Directional);
    let camera = scene.camera_or_framing();
    let view = Stage::new(&gpu, &scene, camera, 192, 192).expect("a stage");
    let map = MapConfig { size: 64, ..MapConfig::default() };
    for (block, taps) in [(2, 4), (3, 2), (4, 4)] {
        let config = Interleaved { map, block, taps, ..Interleaved::default() };
        let full = MapTechnique::new(&gpu, &map, config.whole().expect("valid")).expect("valid");
        let mut full = full;
        let whole = view.shoot(&gpu, &light, &mut full, 0).expect("a shot").visibility;
        // Points in the penumbra, each at all pixels of a square of 8.
        let samples = view.view_samples();
        let picked: Vec<usize> =
            (0..samples.len()).filter(|i| (0.1..0.9).contains(&whole[*i])).step_by(8).collect();
        assert!(picked.len() >= 9, "{} samples in the penumbra", picked.len());
        let of = |x: u32, y: u32| picked[(y / 8 * 3 + x / 8) as usize];
        let points: Vec<ViewSample> =
            (0..SIDE * SIDE).map(|i| samples[of(i % SIDE, i / SIDE)]).collect();
        let same = Stage::seen(&gpu, &scene, &camera, (SIDE, SIDE), &points).expect("a stage");
        let joined = shoot(&gpu, &same, &light, &config);
        let mut parts_differ = 0;
        let mut part = MapTechnique::new(&gpu, &map, config.part().expect("valid")).expect("valid");
        let parts = same.shoot(&gpu, &light, &mut part, 0).expect("a shot").visibility;
        for i in 0..SIDE * SIDE {
            let (x, y) = (i % SIDE, i / SIDE);
            // Where the block around the pixel lies in its own square.
            if (2..5).contains(&(x % 8)) && (2..5).contains(&(y % 8)) {
                let (v, expected) = (joined[i as usize], whole[of(x, y)]);
                assert!((v - expected).abs() < 1e-6, "{block}, {taps}: {v}, not {expected}");
                parts_differ += usize::from((parts[i as usize] - expected).abs() > 0.05);
            }
        }
        assert!(parts_differ > 20, "every part is the whole? {parts_differ} differ");
        // In the picture itself it is the whole but for what changes within a block.
        let mut technique = config.build(&gpu).expect("a valid config");
        let shot = view.shoot(&gpu, &light, technique.as_mut(), 0).expect("a shot");
        let off = difference(&shot.visibility, &whole);
        let mut part = MapTechnique::new(&gpu, &map, config.part().expect("valid")).expect("valid");
        let alone = view.shoot(&gpu, &light, &mut part, 0).expect("a shot").visibility;
        let noise = difference(&alone, &whole);
        assert!(off < noise, "{block}, {taps}: off by {off}, a part alone by {noise}");
        assert_eq!(shot.counters["fetches"], 192 * 192 * u64::from(taps), "fetches");
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
            // Sines are exact to 2^-11 in WGSL, on both sides, and the receiver is moved by as much over the slope;
            // an order of 16 adds these up with weights that come to 2.
            let tolerance = 0.012;
            for (i, (v, pcf)) in found.iter().zip(&exact).enumerate() {
                let f = 1.0 - f64::from(*pcf);
                let twin = twin::convolution(&[(0.0, f), (1.0, 1.0 - f)], &waves, 1.0);
                let error = (f64::from(*v) - twin).abs();
                assert!(error < tolerance, "order {order}, {d}: {v}, not {twin} at {i}");
            }
            let dark = f64::from(found[0]);
            assert!((dark - expected).abs() < tolerance, "order {order}, {d}: {dark}");
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
fn contacts_leak_as_exponentials_say() {
    let gpu = gpu();
    let (map, _) = settings();
    let filter = Prefilter { shape: Shape::Box, radius: 1 };
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
        // Four moments with a bias of some 1e-6: at a hundredth of the range next to nothing.
        assert!(gap < 0.01 || msm[i] < 2e-3, "{g} m: {} by four moments", msm[i]);
    }
}

#[test]
fn three_slabs_leak_as_computed() {
    let gpu = gpu();
    let (map, _) = settings();
    let filter = Prefilter { shape: Shape::Box, radius: 9 };
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
fn a_turning_sun_changes_no_filtered_light_but_at_edges() {
    let gpu = gpu();
    let scene = slabs(&[(7.0, -5.0, 0.0), (2.9, -5.0, 5.0)]);
    let map = MapConfig { size: 1024, ..MapConfig::default() };
    // Lit floor away from the slab's shadow.
    let points: Vec<ViewSample> = (0..4096)
        .map(|i| {
            let (x, z) = (f64::from(i % 64) / 32.0, f64::from(i / 64) / 16.0);
            let position = DVec3::new(2.0 + x, FLOOR, z - 2.0) - scene.origin();
            ViewSample { position: position.as_vec3(), normal: Vec3::Y }
        })
        .collect();
    let stage = Stage::at_points(&gpu, &scene, &points).expect("a stage");
    let change = |config: &dyn TechniqueConfig| {
        let mut technique = config.build(&gpu).expect("a valid config");
        let mut before: Option<Vec<f32>> = None;
        let mut largest = 0.0f64;
        for frame in 0..6 {
            let (sin, cos) = (0.1 * f64::from(frame)).to_radians().sin_cos();
            let direction = DVec3::new(sin, -cos, 0.0);
            let light = Light::Directional { direction, angular_diameter: 0.0 };
            let shot = stage.shoot(&gpu, &light, technique.as_mut(), 0).expect("a shot");
            if let Some(before) = &before {
                largest = largest.max(difference(before, &shot.visibility));
            }
            before = Some(shot.visibility);
        }
        largest
    };
    let table = Savsm { map, radius: 1.0, follow_pixels: false, ..Savsm::default() };
    assert_eq!(change(&table), 0.0, "integers");
    let floats = change(&Savsm { table: Table::Float, ..table });
    assert!(floats > 1e-3, "the speckle of floats stands still: {floats}");
}

#[test]
fn the_least_and_the_largest_depth_are_all_or_none_where_all_or_none_is_lit() {
    let gpu = gpu();
    let (map, _) = settings();
    let scene = slabs(&[(7.0, -5.0, 0.0), (7.0, 4.0, 5.0)]);
    let exact = across(&gpu, &scene, &PcfGrid { map, side: 17 });
    for depths in [2, 3] {
        let config = MultipleDepth { map, radius: 8, depths };
        let found = across(&gpu, &scene, &config);
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

#[test]
fn windows_lose_nothing_between_large_coordinates() {
    let gpu = gpu();
    let scene = slabs(&[(14.0, -5.0, 5.0)]);
    let points: Vec<ViewSample> = (0..65536)
        .map(|i| {
            let (x, z) = (f64::from(i % 256) / 256.0, f64::from(i / 256) / 256.0);
            let position = DVec3::new(9.0 * x - 4.5, FLOOR, 9.0 * z - 4.5) - scene.origin();
            ViewSample { position: position.as_vec3(), normal: Vec3::Y }
        })
        .collect();
    let stage = Stage::at_points(&gpu, &scene, &points).expect("a stage");
    for size in [256, 2048] {
        let config = Savsm { map: MapConfig { size, ..MapConfig::default() }, ..Savsm::default() };
        let found = most(&shoot(&gpu, &stage, &overhead(), &config));
        // The floor is farther behind the one caster than the range is long, so that the least variance leaks 1e-6. What is
        // rounded off another of 0 is 20 roundings of both of its parts, 1/4 each: 6e-7.
        assert!((0.9e-6..2e-6).contains(&found), "{size} texels: {found} in full shadow");
    }
}

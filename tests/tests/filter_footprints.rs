//! Filters whose kernel is a window of any size or the pixel's own.

use antumbra_filter::{
    Esm, Evsm, Footprint, Interleaved, Msm, PcfBilinearGrid, PcfFootprint, Prefilter, Savsm, Shape,
    Table, Vsm,
};
use antumbra_gpu::{Gpu, GpuError, TechniqueConfig};
use antumbra_map::{Bias, MapConfig, MapTechnique};
use antumbra_measure::Stage;
use antumbra_reference::{TruthOptions, ViewSample};
use antumbra_scene::generate::{self, shapes};
use antumbra_scene::{Camera, Light, LightKind, Scene};
use antumbra_tests::gpu;
use glam::{DAffine3, DVec3, Vec3};

use crate::shared::slabs;

use slabs::{FLOOR, across, overhead, settings, slabs};

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
    let map = MapConfig { size: 200, ..MapConfig::default() };
    let (mut soft, mut at_the_border) = (0, 0);
    for kind in [LightKind::Directional, LightKind::Spot, LightKind::Point] {
        let light = scene.place_light(kind);
        for radius in [0, 1, 5, 15] {
            // A variance of 0.01 at least, so that what is rounded off moments, 2e-6 of the range's square, moves
            // visibility by 4e-4 at most: the store's half as much again.
            let deviation = 0.1;
            let filter = Prefilter { shape: Shape::Box, radius, ..Prefilter::default() };
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
            let off = blurred.iter().zip(&shot.visibility).map(|(a, b)| (a - b).abs());
            let off = off.fold(0.0, f32::max);
            assert!(off <= 6e-4, "{kind:?}, {radius}: off by {off}");
            // Windows that reach beyond the map's border see it repeated, as a blur does.
            let reach = f64::from(radius) + 1.0;
            let at_border = |p: Vec3| {
                technique.map().views().iter().filter_map(|view| view.clip).any(|clip| {
                    let c = clip * p.as_dvec3().extend(1.0);
                    let ndc = c.truncate().truncate() / c.w;
                    let inside = (1.0 - ndc.abs()) * 0.5 * f64::from(map.size);
                    c.w > 0.0 && (0.0..reach).contains(&inside.min_element())
                })
            };
            at_the_border += stage.image.positions.iter().filter(|p| at_border(**p)).count();
            soft += blurred.iter().filter(|v| (0.3..0.95).contains(*v)).count();
        }
    }
    assert!(soft > 300, "{soft} samples between light and dark");
    assert!(at_the_border > 300, "{at_the_border} samples at a map's border");
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
    // so Chebyshev's bound is exact. The bias cone of windows so wide reaches from the floor to the slats, but behind
    // these nothing casts.
    let table = Savsm { map: map(1024), largest: 31.0, ..Savsm::default() };
    let boxes = errors(&table);
    assert!(boxes < 0.5 * reconstructed, "{boxes}, and {reconstructed} by one texel's tent");
    let fixed = errors(&Savsm { follow_pixels: false, ..table });
    assert!(boxes < 0.6 * fixed, "{boxes}, and {fixed} by two texels whatever the pixel");
    // And as rows of lookups in a mipmap, of any store.
    let followed = |footprint| Prefilter { radius: 0, footprint, ..Prefilter::default() };
    let [one, eight] = [1, 8].map(|lookups| Some(Footprint { largest: 32, lookups }));
    let map = map(1024);
    let variance = |footprint| errors(&Vsm { map, filter: followed(footprint), ..Vsm::default() });
    let moments = |footprint| errors(&Msm { map, filter: followed(footprint), ..Msm::default() });
    let warped = |footprint| errors(&Evsm { map, filter: followed(footprint), ..Evsm::default() });
    for (name, [isotropic, in_a_row, fixed]) in [
        ("variance", [one, eight, None].map(variance)),
        ("moments", [one, eight, None].map(moments)),
        ("warps", [one, eight, None].map(warped)),
    ] {
        // A square that holds the footprint is several times as large.
        assert!(isotropic < 0.5 * fixed, "{name}: {isotropic}, and {fixed} without");
        assert!(in_a_row < 0.6 * isotropic, "{name}: {in_a_row}, and {isotropic} by one lookup");
    }
}

/// A slab's edge over a floor under a sun that turns: a store's texel knows the edge to half of a sample.
#[test]
fn edges_lie_as_exactly_as_samples_not_texels_allow() {
    let gpu = gpu();
    let scene = slabs(&[(7.0, -5.0, 0.0), (2.9, -5.0, 5.0)]);
    let origin = scene.origin();
    let place = |i: usize| DVec3::new(-0.5 + 1.5 * i as f64 / 256.0, FLOOR, 0.013) - origin;
    let sample = |i| ViewSample { position: place(i).as_vec3(), normal: Vec3::Y };
    let points: Vec<ViewSample> = (0..256).map(sample).collect();
    let stage = Stage::at_points(&gpu, &scene, &points).expect("a stage");
    let bias = Bias { cone: 0.0, ..Bias::default() };
    let map = MapConfig { size: 512, bias, ..MapConfig::default() };
    // The most that a sample is off, beyond what the floor's slope explains.
    let worst = |samples: u32| {
        let filter = Prefilter { radius: 0, samples, ..Prefilter::default() };
        let mut technique =
            Vsm { map, filter, ..Vsm::default() }.technique(&gpu).expect("a valid config");
        let mut worst = 0.0f64;
        for frame in 0..40 {
            let (sin, cos) = (0.1 * f64::from(frame)).to_radians().sin_cos();
            let direction = DVec3::new(sin, -cos, 0.0);
            let light = Light::Directional { direction, angular_diameter: 0.0 };
            let found = stage.shoot(&gpu, &light, &mut technique, 0).expect("a shot").visibility;
            let clip = technique.map().views()[0].clip.expect("a view with casters");
            // Texels of the store along the axis across the edge, from the map's middle.
            let side = f64::from(map.size / samples);
            let texel = |p: DVec3| 0.5 * side * clip.project_point3(p).truncate();
            let edge = texel(7.0 * DVec3::Y - origin);
            let metre = texel(DVec3::new(1.0, 7.0, 0.0) - origin) - edge;
            let axis = usize::from(metre.y.abs() > metre.x.abs());
            let (edge, metre) = (edge[axis], metre[axis]);
            // The lit part of the store's texel `j`, and of the two that a lookup is between.
            let lit = |j: f64| if metre > 0.0 { j + 1.0 - edge } else { edge - j }.clamp(0.0, 1.0);
            let expected = |t: f64| {
                let first = (t - 0.5).floor();
                let fraction = t - 0.5 - first;
                (1.0 - fraction) * lit(first) + fraction * lit(first + 1.0)
            };
            // As in the next test but one, of a kernel two texels wide.
            let deeper = 0.5 * 2.0 / 2.0 / metre.abs() * (sin / cos) / 4.0;
            for (i, v) in found[..points.len()].iter().enumerate() {
                let off = (f64::from(*v) - expected(texel(place(i))[axis])).abs();
                worst = worst.max(off - deeper);
            }
        }
        worst
    };
    // The texel that the edge cuts is known to half of a sample, whose corners snap to 1/256, and counts in full at most.
    // What else two depths leak is 1e-4 and less.
    let bound = |samples: f64| 0.5 / samples + 1.0 / 256.0 + 1e-4;
    let [one, two, four] = [1, 2, 4].map(worst);
    assert!(one <= bound(1.0) && two <= bound(2.0) && four <= bound(4.0), "{one}, {two}, {four}");
    assert!(one > bound(2.0) && two > bound(4.0), "the control: {one} and {two} of few samples");
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

/// A slab's edge 4 m over the floor, under a sun that turns by 0.1 degrees a frame: visibility is the part of the kernel on
/// the lit side of the edge, which a map knows to half a texel.
#[test]
fn under_a_turning_sun_edges_move_by_what_a_texel_is_off() {
    const FRAMES: usize = 60;
    const TEXELS: f64 = 17.0;
    let gpu = gpu();
    let scene = slabs(&[(7.0, -5.0, 0.0), (2.9, -5.0, 5.0)]);
    let origin = scene.origin();
    let (map, filter) = settings();
    let place = |i: usize| DVec3::new(-0.5 + 1.5 * i as f64 / 256.0, FLOOR, 0.013) - origin;
    let sample = |i| ViewSample { position: place(i).as_vec3(), normal: Vec3::Y };
    let points: Vec<ViewSample> = (0..256).map(sample).collect();
    let stage = Stage::at_points(&gpu, &scene, &points).expect("a stage");
    let check = |name: &str, leaks: bool, technique: Result<MapTechnique, GpuError>| {
        let mut technique = technique.expect("a valid config");
        // For each frame: what is found, what it should be, and how far off it may be.
        let mut frames: Vec<(Vec<f64>, Vec<f64>, f64)> = Vec::new();
        for frame in 0..FRAMES {
            let (sin, cos) = (0.1 * frame as f64).to_radians().sin_cos();
            let direction = DVec3::new(sin, -cos, 0.0);
            let light = Light::Directional { direction, angular_diameter: 0.0 };
            let found = stage.shoot(&gpu, &light, &mut technique, 0).expect("a shot").visibility;
            let clip = technique.map().views()[0].clip.expect("a view with casters");
            let texel = |p: DVec3| 0.5 * f64::from(map.size) * clip.project_point3(p).truncate();
            // Along the slab's edge nothing changes.
            let edge = texel(7.0 * DVec3::Y - origin);
            let metre = texel(DVec3::new(1.0, 7.0, 0.0) - origin) - edge;
            let across = metre.normalize();
            let part = |i| (0.5 + across.dot(texel(place(i)) - edge) / TEXELS).clamp(0.0, 1.0);
            // A texel counts as a whole, and corners snap to 1/256 of one. To moments the floor slopes: of a part f of the
            // kernel on the slab, what is on the floor lies f / 2 kernels to the side in the mean, and so much deeper, e of
            // the gap. Chebyshev's bound is (1 - f) (1 + 2 e) then. What else they leak is 1e-4 and less.
            let deeper = TEXELS / 2.0 / metre.length() * (sin / cos) / 4.0;
            let bound = (0.5 + 1.0 / 256.0) / TEXELS + 2.0 * 0.25 * deeper + 1e-4;
            let found = found[..points.len()].iter().map(|v| f64::from(*v)).collect();
            frames.push((found, (0..points.len()).map(part).collect(), bound));
        }
        let (mut swims, mut late) = (0.0f64, 0.0f64);
        for (k, (found, parts, bound)) in frames.iter().enumerate() {
            for (i, (v, part)) in found.iter().zip(parts).enumerate() {
                assert!(v - part >= -bound, "{name}, frame {k}: {v} at {i}, not {part}");
                assert!(leaks || v - part <= *bound, "{name}, frame {k}: {v} at {i}, not {part}");
                if let Some((before, was, _)) = k.checked_sub(1).map(|k| &frames[k]) {
                    swims = swims.max(((v - before[i]) - (part - was[i])).abs());
                }
                // The control: the edge where it was eight frames ago, 56 mm of some 33 mm a texel.
                if let Some((_, was, bound)) = k.checked_sub(8).map(|k| &frames[k]) {
                    late = late.max((v - was[i]).abs() - bound);
                }
            }
        }
        let most = 2.0 * frames.iter().map(|frame| frame.2).fold(0.0, f64::max);
        assert!(leaks || swims <= most, "{name} swims by {swims}, not {most}");
        assert!(swims > 0.01 && late > 0.0, "{name}: nothing moves: {swims}, {late}");
    };
    let grid = PcfBilinearGrid { map, side: 17 };
    check("pcf", false, MapTechnique::new(&gpu, &map, grid.estimator().expect("valid")));
    check("vsm", false, Vsm { map, filter, ..Vsm::default() }.technique(&gpu));
    let table = Savsm { map, radius: 8.0, follow_pixels: false, ..Savsm::default() };
    check("savsm", false, table.technique(&gpu));
    // Others make more of a slope, and of that only light.
    check("esm", true, Esm { map, filter, ..Esm::default() }.technique(&gpu));
    check("evsm", true, Evsm { map, filter, ..Evsm::default() }.technique(&gpu));
    check("msm", true, Msm { map, filter, ..Msm::default() }.technique(&gpu));
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

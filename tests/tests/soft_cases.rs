//! Cases of the literature on the GPU: what windows at three depths, a tilted plate and a column look like
//! to each technique.

use crate::shared::area;

use antumbra::Config;
use antumbra_gpu::Gpu;
use antumbra_map::{Bias, MapConfig};
use antumbra_measure::Stage;
use antumbra_reference::ViewSample;
use antumbra_scene::{Light, Scene, generate};
use antumbra_soft::twin::occlusion::{Slices, planes};
use antumbra_soft::{
    Bitmask, Fusion, Hierarchy, Occluders, OcclusionTextures, Pcss, Placement, Samples, Vssm,
    Window,
};
use antumbra_tests::gpu;
use area::{map, shoot};
use glam::{DAffine3, DVec2, DVec3, Vec3};

/// Without a cone, a pyramid or a verdict of umbra, so that every texel is looked at.
fn bare(size: u32) -> (MapConfig, Window) {
    let bias = Bias { cone: 0.0, ..Bias::default() };
    let window =
        Window { hierarchy: Hierarchy::None, umbra: false, budget: 128, reach: 0, tally: false };
    (MapConfig { bias, ..map(size) }, window)
}

fn mask(size: u32, occluders: Occluders) -> Config {
    let (map, window) = bare(size);
    let samples = Samples::S1024;
    Config::Bitmask(Bitmask { map, window, samples, occluders, ..Bitmask::default() })
}

/// Visibility of a square light of half size 1 at 0 from the points (x, 0) of a floor 10 m below it, half of whose side is
/// `FLOOR`. Quadrilaterals have their middle at (x, depth) and one half side along (x, depth); the other is along z.
fn below(
    gpu: &Gpu,
    quads: &[(DVec2, DVec2)],
    at: impl Iterator<Item = f64>,
    config: &Config,
) -> Vec<f64> {
    let mut scene = Scene { name: "case".to_owned(), ..Scene::default() };
    let floor = generate::shapes::quad(DVec3::Y * -10.0, DVec3::Z * FLOOR, DVec3::X * FLOOR);
    scene.add(floor, DAffine3::IDENTITY);
    let place = |p: DVec2| DVec3::new(p.x, -p.y, 0.0);
    for (middle, half) in quads {
        let quad = generate::shapes::quad(place(*middle), DVec3::Z * 50.0, place(*half));
        scene.add(quad, DAffine3::IDENTITY);
    }
    let origin = scene.origin();
    let samples: Vec<ViewSample> = at
        .map(|x| ViewSample {
            position: (DVec3::new(x, -10.0, 0.0) - origin).as_vec3(),
            normal: Vec3::Y,
        })
        .collect();
    let stage = Stage::at_points(gpu, &scene, &samples).expect("a stage");
    let light = Light::Rect { center: DVec3::ZERO, half_u: DVec3::X, half_v: DVec3::Z };
    let found = shoot(gpu, &stage, &light, config);
    found[..samples.len()].iter().map(|v| f64::from(*v)).collect()
}

const FLOOR: f64 = 60.0;

/// A level strip from one x to another.
fn strip(from: f64, to: f64, depth: f64) -> (DVec2, DVec2) {
    (DVec2::new(0.5 * (from + to), depth), DVec2::new(0.5 * (to - from), 0.0))
}

/// Slope of a texel of a map without a camera: as wide as the view, which reaches as far beyond 45 degrees as the light is
/// wide, `nearest` metres off; two texels on either side stay free.
fn texel(size: u32, nearest: f64) -> f64 {
    2.0 * (1.0 + 2.0 / nearest).min(3.0) / f64::from(size - 4)
}

#[test]
fn of_a_window_at_three_depths_pcss_counts_the_share_and_moments_let_light_through() {
    let gpu = gpu();
    // Of each period 30 % at z = 2 and 65 % at z = 8. The mean depth of these is 6.1; two periods are the window there.
    let mean = (0.3 * 2.0 + 0.65 * 8.0) / 0.95;
    let period = 1.0 / mean - 0.1;
    let quads: Vec<_> = (-8..8)
        .flat_map(|i| {
            let at = |share: f64| (f64::from(i) + share) * period;
            [strip(2.0 * at(0.0), 2.0 * at(0.3), 2.0), strip(8.0 * at(0.3), 8.0 * at(0.95), 8.0)]
        })
        .collect();
    let (map, window) = bare(2048);
    let pcss = Config::Pcss(Pcss { map, window, search: 0, filter: 0, ..Pcss::default() });
    let (hierarchy, umbra) = (Hierarchy::None, false);
    let vssm = Config::Vssm(Vssm { map, hierarchy, umbra, ..Vssm::default() });
    let at = || (0..64).map(|i| f64::from(i) / 64.0 * 10.0 * period);
    let average = |found: Vec<f64>| found.iter().sum::<f64>() / found.len() as f64;
    let (share, bound) =
        (average(below(&gpu, &quads, at(), &pcss)), average(below(&gpu, &quads, at(), &vssm)));
    // Of a window of 64 texels or more, blocks of the search and texels at both ends are off by one.
    assert!((share - 0.05).abs() < 0.02, "PCSS has {share}");
    // The bound of the mean and the spread of all three: 2.86^2 2 / ... = 0.372 where the window holds whole periods.
    let moments =
        |power: i32| 0.3 * 2f64.powi(power) + 0.65 * 8f64.powi(power) + 0.05 * 10f64.powi(power);
    let (variance, gap) = (moments(2) - moments(1).powi(2), 10.0 - moments(1));
    let expected = variance / (variance + gap * gap);
    assert!((expected - 0.372).abs() < 1e-3, "Chebyshev's bound is {expected}");
    assert!((bound - expected).abs() < 0.05, "moments have {bound}, not {expected}");
}

#[test]
fn a_tilted_plate_leaks_through_patches_as_much_as_texels_lie_apart() {
    let gpu = gpu();
    let size = 512;
    let plate = [(DVec2::new(0.0, 5.0), DVec2::new(2.0, 2.0))];
    // Its lower edge, at (2, 7), falls on the light; the other one does not.
    let edge = |x: f64| (20.0 - 7.0 * x) / 3.0;
    let truth = |x: f64| 0.5 * (1.0 - edge(x).clamp(-1.0, 1.0));
    let across = || (0..64).map(|i| 2.45 + 0.8 * f64::from(i) / 63.0);
    for occluders in [Occluders::ClosedMicropatch, Occluders::ExactMicroquad, Occluders::Microtri] {
        let found = below(&gpu, &plate, across(), &mask(size, occluders));
        let off = found.iter().zip(across()).map(|(v, x)| (v - truth(x)).abs()).fold(0.0, f64::max);
        // An edge is off by a texel, 7 m off, seen on a light 2 m wide at 10 / 3 of its size; and samples by a 64th.
        let bound = 7.0 * texel(size, 3.0) * 10.0 / 3.0 / 2.0 + 1.0 / 64.0;
        assert!(off < bound, "{occluders:?}: off by {off}, at most {bound}");
    }
    // Behind the middle all is hidden. On the side of the point that is seen straight ahead (l = 0) where the plate is farther
    // a step from texel to texel, ds, is longer than a texel as it is seen, c: the share 1 - c / ds of the light gets through.
    let inner = || (0..256).map(|i| 0.5 + f64::from(i) / 256.0);
    let theory = |x: f64| {
        let at = |m: f64| 5.0 / (1.0 - m);
        let on_light = |m: f64| at(m) * (10.0 * m - x) / (10.0 - at(m));
        let steps = 20_000;
        let slope = |i: i32| -0.5 + f64::from(i) / f64::from(steps);
        (0..steps)
            .map(|i| {
                let (m, l) = (slope(i), on_light(slope(i)));
                let step = (on_light(slope(i + 1)) - l) * f64::from(steps);
                let patch = 10.0 * at(m) / (10.0 - at(m));
                let open = (1.0 - patch / step).max(0.0);
                if l.abs() <= 1.0 { 0.5 * open * step / f64::from(steps) } else { 0.0 }
            })
            .sum::<f64>()
    };
    let average = |values: &mut dyn Iterator<Item = f64>| values.sum::<f64>() / 256.0;
    let expected = average(&mut inner().map(theory));
    let leak = |occluders| {
        let found = below(&gpu, &plate, inner(), &mask(size, occluders));
        average(&mut found.into_iter())
    };
    let found = leak(Occluders::Micropatch);
    // 64 columns of samples for some ten gaps: a quarter of 2.5 samples in the mean of 256 points.
    assert!(
        expected > 0.01 && (found - expected).abs() < 0.25 * expected,
        "{found}, not {expected}"
    );
    for occluders in [Occluders::ClosedMicropatch, Occluders::Microquad, Occluders::ExactMicroquad]
    {
        let found = leak(occluders);
        assert!(found == 0.0, "{occluders:?} leak {found}");
    }
}

#[test]
fn a_column_from_2_to_8_hides_what_its_near_end_does_and_slices_of_it_count_again_and_again() {
    let gpu = gpu();
    let column = [
        strip(-0.5, 0.5, 2.0),
        strip(-0.5, 0.5, 8.0),
        (DVec2::new(-0.5, 5.0), DVec2::new(0.0, 3.0)),
        (DVec2::new(0.5, 5.0), DVec2::new(0.0, 3.0)),
    ];
    let points = [1.0, 2.0, 3.0];
    // Behind the near end's edge. At x = 1 the light's other border looks past that end, at the wall, of which the centre sees
    // nothing.
    let truth =
        points.map(|x| 0.5 * (1.0 - (5.0 - 2.0 * x) / 8.0) + if x == 1.0 { 0.0625 } else { 0.0 });
    for occluders in [Occluders::Micropatch, Occluders::ClosedMicropatch, Occluders::Microquad] {
        let found = below(&gpu, &column, points.into_iter(), &mask(1024, occluders));
        for (found, truth) in found.iter().zip(truth) {
            // A texel 2 m off, or a block of two, at 10 / 8 of its size on a light of 2 m; samples by a 64th.
            let bound = 2.0 * 2.0 * texel(1024, 2.0) * 10.0 / 8.0 / 2.0 + 1.0 / 64.0;
            assert!(
                (found - truth).abs() < bound,
                "{occluders:?}: {found}, not {truth} +- {bound}"
            );
        }
    }
    // Slices of all that is drawn, the floor too, seen from where the pyramid through the light's outline holds it.
    let stand_off = 10.0 / (FLOOR - 1.0);
    let mut left = Vec::new();
    for count in [4, 8, 16, 32] {
        let planes =
            planes((2.0, 2.0 + 8.0 * (1.0 + 1e-4)), 10.0, count, Placement::Uniform, &[], false);
        let covered = |k: usize, center: DVec2, half: DVec2| {
            let begin = if k == 0 { 0.0 } else { planes[k - 1] };
            let end = planes[k];
            // As wide as where it begins to be in the slice; its far end is the wider the farther in that lies.
            let onto = |z: f64| 0.5 * (end + stand_off) / (z + stand_off);
            let wall = |from: f64, to: f64| if from < to { onto(from) - onto(to) } else { 0.0 };
            let (from, to) = (f64::max(begin, 2.0), f64::min(end, 8.0));
            if from >= to {
                return 0.0;
            }
            let filled = begin < 2.0 || (begin < 8.0 && end >= 8.0);
            let outer = onto(from);
            let inner = if filled { 0.0 } else { outer - wall(from, to) };
            let inner = if begin < 8.0 && end >= 8.0 && begin >= 2.0 { 0.0 } else { inner };
            let (lo, hi) = (center.x - half.x, center.x + half.x);
            let part = |a: f64, b: f64| (b.min(hi) - a.max(lo)).max(0.0);
            (part(-outer, -inner) + part(inner, outer)) / (2.0 * half.x)
        };
        let (half, fusion) = (DVec2::ONE, Fusion::Product);
        let slices = Slices {
            planes: &planes,
            near: 2.0,
            half,
            parallel: false,
            fade: 1.0,
            fusion,
            covered: &covered,
        };
        let config = OcclusionTextures { map: map(2048), slices: count, ..Default::default() };
        let found = below(&gpu, &column, [2.0].into_iter(), &Config::OcclusionTextures(config));
        let expected = slices.visibility(DVec3::new(2.0, 0.0, 10.0));
        left.push((found[0], expected));
    }
    // The image, as wide as the floor, knows an edge in a slice to half of 120 m / 2048: of windows 2 (10 - z) / 10 wide.
    for ((found, expected), count) in left.iter().zip([4, 8, 16, 32]) {
        let texel = 2.0 * FLOOR / 2048.0;
        let bound: f64 = (0..count)
            .map(|k| 2.0 + 8.0 * f64::from(k + 1) / f64::from(count))
            .filter(|z| *z < 9.0)
            .map(|z| 2.0 * 0.5 * texel * z / 10.0 / (2.0 - 0.2 * z))
            .sum();
        assert!(
            (found - expected).abs() < bound,
            "{count} slices: {found}, not {expected} +- {bound}"
        );
    }
}

/// Mean visibility, and the least, at points below 64 strips at the depth 5, one in four times their width.
fn below_strips(gpu: &Gpu, width: f64, wide: bool, config: &Config) -> (f64, f64) {
    let at = |i: i32| 5.0 * width * f64::from(i);
    let mut quads: Vec<_> = (-32..32).map(|i| strip(at(4 * i), at(4 * i + 1), 5.0)).collect();
    if wide {
        // Sheets beyond the view's widest, 1.4, to both sides: as wide it is.
        quads.extend([strip(-8.0, -7.5, 5.0), strip(7.5, 8.0, 5.0)]);
    }
    let found = below(gpu, &quads, (0..128).map(|i| 0.002 * f64::from(i)), config);
    let mean = found.iter().sum::<f64>() / found.len() as f64;
    (mean, found.into_iter().fold(1.0, f64::min))
}

#[test]
fn quads_lose_a_texel_of_every_strip_and_patches_keep_its_share() {
    let gpu = gpu();
    let texel = texel(1024, 5.0);
    // Windows of 73 texels, one by one. A strip of w texels holds w texels' centres in the mean, of which quads span all but
    // one: nothing of strips that are no wider than a texel. Widths of which no few strips begin at the same part of a texel.
    for width in [63.0 / 64.0, 1.47, 3.03] {
        let expected = 1.0 - 0.25 * (width - 1.0_f64).max(0.0) / width;
        for occluders in [Occluders::Microquad, Occluders::ExactMicroquad] {
            let config = mask(1024, occluders);
            let (mean, least) = below_strips(&gpu, width * texel, true, &config);
            // The light holds 6 strips or more: half of one more or less, of a quarter of all, and samples by a 64th.
            let off = 0.5 * 0.25 / 6.0 + 1.0 / 64.0;
            let what = format!("{width} texels, {occluders:?}");
            assert!((mean - expected).abs() <= off, "{what}: {mean}, not {expected} +- {off}");
            assert!(width > 1.0 || least == 1.0, "{what}: {least}, not 1");
        }
        let patches = mask(1024, Occluders::Micropatch);
        let (mean, least) = below_strips(&gpu, width * texel, true, &patches);
        assert!((mean - 0.75).abs() < 0.04, "{width} texels, patches: {mean}, not 0.75");
        assert!(least < 0.75, "{width} texels, patches: {least}, the control");
    }
    // What looks like strips that quads should lose and do not: a map fitted to the strips, which span 253 of their widths, has
    // finer texels, of which a block of the window holds some, and a strip is wider than such a block.
    let quads = mask(1024, Occluders::Microquad);
    let strip = 63.0 / 64.0 * texel;
    let (mean, _) = below_strips(&gpu, strip, false, &quads);
    let fitted = 253.0 * strip / 1020.0;
    let block = fitted * (2.0 * (1.0 / 5.0 - 0.1) / fitted / 128.0).ceil();
    assert!(block < strip, "blocks of {block} for strips of {strip}");
    let expected = 1.0 - 0.25 * (strip / block - 1.0) / (strip / block);
    assert!((mean - expected).abs() < 0.02, "a map fitted to the strips: {mean}, not {expected}");
}

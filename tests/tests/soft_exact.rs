//! Sheets below a square light, on which theory says what each technique sees: numbers of the technique, right or wrong.

use crate::shared::area;

use antumbra::Config;
use antumbra_map::{Bias, MapConfig, MapTechnique};
use antumbra_scene::{Emission, Light};
use antumbra_soft::twin::occlusion::{Slices, planes};
use antumbra_soft::{
    BackProjection, Bitmask, Fusion, Hierarchy, Occluders, OcclusionTextures, Pattern, Pcss,
    Placement, Samples, Vssm, Window,
};
use antumbra_tests::gpu;
use area::{along_a_floor, below_a_square_light, bodies, map, seen};
use glam::{DVec2, DVec3};

/// A sheet, endless across: from x, to x, and its depth below the light, of half size 1 at 0. The receiver is at the depth 10.
type Sheet = (f64, f64, f64);

/// Points on the light, or slopes, by which integrals are taken: the midpoint rule is off by one step at each edge.
const STEPS: i32 = 40_000;

fn grid(from: f64, to: f64) -> impl Iterator<Item = f64> {
    (0..STEPS).map(move |i| from + (to - from) * (f64::from(i) + 0.5) / f64::from(STEPS))
}

fn share(from: f64, to: f64, holds: impl Fn(f64) -> bool) -> f64 {
    grid(from, to).filter(|t| holds(*t)).count() as f64 / f64::from(STEPS)
}

/// Depth of the nearest sheet along a slope from the light's centre; the floor's if there is none.
fn nearest(sheets: &[Sheet], slope: f64) -> f64 {
    let hit = |(from, to, z): &&Sheet| *from <= slope * z && slope * z < *to;
    sheets.iter().filter(hit).map(|s| s.2).fold(10.0, f64::min)
}

/// Whether a sheet hides the point l of the light from (x, 10): any of them, or one that is among the first `layers` along
/// the ray from the light's centre through the point where it does.
fn hides(sheets: &[Sheet], sheet: &Sheet, x: f64, l: f64, layers: usize) -> bool {
    let (from, to, z) = *sheet;
    let q = l + (x - l) * z / 10.0;
    let before = |s: &&Sheet| s.2 < z && s.0 <= q * s.2 / z && q * s.2 / z < s.1;
    from <= q && q < to && sheets.iter().filter(before).count() < layers
}

/// What is seen behind what the first `layers` show, joined.
fn joined(sheets: &[Sheet], x: f64, layers: usize) -> f64 {
    share(-1.0, 1.0, |l| !sheets.iter().any(|s| hides(sheets, s, x, l, layers)))
}

/// The same for the first layer, added.
fn added(sheets: &[Sheet], x: f64) -> f64 {
    let hidden = |s: &Sheet| share(-1.0, 1.0, |l| hides(sheets, s, x, l, 1));
    (1.0 - sheets.iter().map(hidden).sum::<f64>()).max(0.0)
}

/// Slopes of the window at the depth z.
fn window(x: f64, z: f64) -> (f64, f64) {
    let half = 1.0 / z - 0.1;
    (0.1 * x - half, 0.1 * x + half)
}

/// Percentage-closer soft shadows, with a near plane at `near`.
fn closer(sheets: &[Sheet], x: f64, near: f64) -> f64 {
    let (from, to) = window(x, near);
    let blockers: Vec<f64> =
        grid(from, to).map(|m| nearest(sheets, m)).filter(|z| *z < 10.0).collect();
    if blockers.is_empty() {
        return 1.0;
    }
    let (from, to) = window(x, blockers.iter().sum::<f64>() / blockers.len() as f64);
    share(from, to, |m| nearest(sheets, m) >= 10.0)
}

/// The same by two moments of each window.
fn by_moments(sheets: &[Sheet], x: f64, near: f64) -> f64 {
    let lit = |(from, to): (f64, f64)| {
        let all: Vec<f64> = grid(from, to).map(|m| nearest(sheets, m)).collect();
        let mean = all.iter().sum::<f64>() / all.len() as f64;
        let variance = all.iter().map(|z| (z - mean).powi(2)).sum::<f64>() / all.len() as f64;
        let gap = (10.0 - mean).powi(2);
        (if gap > 0.0 { variance / (variance + gap) } else { 1.0 }, mean)
    };
    let (open, mean) = lit(window(x, near));
    if open > 1.0 - 1e-4 {
        return 1.0;
    }
    lit(window(x, (mean - open * 10.0) / (1.0 - open))).0
}

/// Half side of the floor.
const FLOOR: f64 = 60.0;

/// Slices of all casters, floor and all, as a product; seen from where the pyramid through the light's outline holds them.
fn sliced(sheets: &[Sheet], x: f64, count: u32) -> f64 {
    let near = sheets.iter().map(|s| s.2).fold(10.0, f64::min);
    let far = near + (10.0 - near) * (1.0 + 1e-4);
    let planes = planes((near, far), 10.0, count, Placement::Uniform, &[], false);
    let stand_off = 10.0 / (FLOOR - 1.0);
    let covered = |k: usize, center: DVec2, half: DVec2| {
        let begin = if k == 0 { 0.0 } else { planes[k - 1] };
        let of = |(from, to, z): &Sheet| {
            if *z <= begin || *z > planes[k] {
                return 0.0;
            }
            let onto = (planes[k] + stand_off) / (z + stand_off);
            let (lo, hi) = (from * onto, to * onto);
            (hi.min(center.x + half.x) - lo.max(center.x - half.x)).max(0.0) / (2.0 * half.x)
        };
        sheets.iter().map(of).sum::<f64>().min(1.0)
    };
    let (half, fusion) = (DVec2::ONE, Fusion::Product);
    let covered = &covered;
    let slices =
        Slices { planes: &planes, near, half, parallel: false, fade: 1.0, fusion, covered };
    slices.visibility(DVec3::new(x, 0.0, 10.0))
}

const BEHIND: [Sheet; 2] = [(-50.0, 0.0, 4.0), (-50.0, 0.0, 6.0)];
const BESIDE: [Sheet; 2] = [(-50.0, 0.0, 4.0), (0.0, 50.0, 6.0)];
const HIDDEN: [Sheet; 2] = [(-0.2, 0.2, 2.0), (-0.35, 0.35, 8.0)];
const SLIT: [Sheet; 2] = [(-50.0, 0.0, 2.0), (0.0, 50.0, 8.0)];
/// With a sheet that nobody sees, so that the near plane lies at 1.
const LIT: [Sheet; 3] = [(1.2, 3.0, 2.0), (0.4, 3.0, 8.0), (2.8, 2.9, 1.0)];
const DARK: [Sheet; 3] = [(-0.4, 0.4, 8.0), (1.4, 1.8, 2.0), (2.8, 2.9, 1.0)];

/// Two gratings that hide complementary halves of the light from below its middle.
fn gratings() -> Vec<Sheet> {
    let near = (-10..10).map(|i| (0.15 * f64::from(i), 0.15 * f64::from(i) + 0.075, 4.0));
    let far = (-15..15).map(|i| (0.1 * f64::from(i) + 0.05, 0.1 * f64::from(i) + 0.1, 6.0));
    near.chain(far).collect()
}

#[test]
fn theory_has_the_published_numbers() {
    let near = |found: f64, expected: f64| {
        assert!((found - expected).abs() < 1e-3, "{found}, not {expected}");
    };
    // The truth: all layers.
    for (sheets, x, truth) in [
        (&BEHIND[..], 0.0, 0.5),
        (&BESIDE, 0.0, 0.0),
        (&HIDDEN, 0.0, 0.0),
        (&HIDDEN, 0.3, 0.225),
        (&HIDDEN, 0.5, 0.4375),
        (&SLIT, -0.5, 0.4375),
        (&LIT, 0.0, 1.0),
        (&DARK, 0.0, 0.0),
        (&gratings(), 0.0, 0.0),
    ] {
        near(joined(sheets, x, 9), truth);
    }
    near(closer(&LIT, 0.0, 1.0), 0.762);
    near(closer(&DARK, 0.0, 1.0), 0.667);
    near(joined(&HIDDEN, 0.0, 1), 0.75);
    near(joined(&HIDDEN, 0.5, 1), 0.75);
    near(joined(&SLIT, -0.5, 1), 0.4375);
    near(added(&SLIT, -0.5), 0.4375);
}

#[test]
fn every_technique_gives_the_number_that_theory_says() {
    let gpu = gpu();
    let bias = Bias { cone: 0.0, ..Bias::default() };
    let map = MapConfig { bias, ..map(2048) };
    let window =
        Window { hierarchy: Hierarchy::None, umbra: false, budget: 128, reach: 0, tally: false };
    let mask = |occluders, layers| {
        let samples = Samples::S1024;
        Config::Bitmask(Bitmask { map, window, samples, occluders, layers, ..Bitmask::default() })
    };
    let pcss = Config::Pcss(Pcss { map, window, search: 0, filter: 0, ..Pcss::default() });
    let areas = Config::BackProjection(BackProjection { map, window });
    let (hierarchy, umbra) = (Hierarchy::None, false);
    let vssm = Config::Vssm(Vssm { map, hierarchy, umbra, ..Vssm::default() });
    let textures = OcclusionTextures {
        map: MapConfig { size: 2048, ..map },
        slices: 16,
        ..Default::default()
    };
    let textures = Config::OcclusionTextures(textures);
    let slit = |sheets: &[Sheet]| sheets == SLIT;
    let mut wrong = Vec::new();
    for (name, sheets, places) in [
        ("behind", &BEHIND[..], &[0.0][..]),
        ("beside", &BESIDE, &[0.0]),
        ("hidden", &HIDDEN, &[0.0, 0.3, 0.5]),
        ("slit", &SLIT, &[-0.5]),
        ("lit", &LIT, &[0.0]),
        ("dark", &DARK, &[0.0]),
    ] {
        let near = sheets.iter().map(|s| s.2).fold(10.0, f64::min);
        // What an edge at each depth that falls on the light moves, an amount of slope.
        let edges = |x: f64, slope: f64| -> f64 {
            let on_light = |(e, z): &(f64, f64)| ((10.0 * e - z * x) / (10.0 - z)).abs() < 1.0;
            let all = sheets.iter().flat_map(|(from, to, z)| [(*from, *z), (*to, *z)]);
            all.filter(on_light).map(|(_, z)| slope * 10.0 * z / (10.0 - z) / 2.0).sum()
        };
        // The view reaches as far beyond 45 degrees as the light is wide, as far off as the nearest sheet is: at most to 3.
        let texel = 2.0 * (1.0 + 2.0 / near).min(3.0) / 2048.0;
        let block = texel * (2.0 * (1.0 / near - 0.1) / texel / 128.0).ceil();
        // Of an image, as wide as the floor is.
        let flat = |z: f64| (10.0 - z) / 10.0 * 2.0 * FLOOR / 2048.0;
        let image: f64 = sheets.iter().map(|s| 0.1 * flat(s.2) / (2.0 - 0.2 * s.2)).sum();
        // Blocks count by their middle, quads from middle to middle.
        let patches = |x: f64| edges(x, 0.5 * block) + 0.01;
        let quads = |x: f64| edges(x, block) + 0.01;
        let mut check = |what: &str,
                         config: &Config,
                         expected: &dyn Fn(f64) -> f64,
                         off: &dyn Fn(f64) -> f64| {
            let all = along_a_floor(&gpu, sheets, places, config);
            for (x, found) in places.iter().zip(all) {
                let (found, expected, off) = (f64::from(found), expected(*x), off(*x));
                if (found - expected).abs() > off {
                    let what = format!("{name} at {x}, {what}");
                    wrong.push(format!("{what}: {found}, not {expected} +- {off}"));
                }
            }
        };
        // The mean depth is off by a block of 6 m in the window's width, and the filter's window with it.
        check("PCSS", &pcss, &|x| closer(sheets, x, near), &|_| 0.04);
        check("areas", &areas, &|x| added(sheets, x), &patches);
        check("micropatches", &mask(Occluders::Micropatch, 1), &|x| joined(sheets, x, 1), &patches);
        check("two layers", &mask(Occluders::Micropatch, 2), &|x| joined(sheets, x, 2), &patches);
        // Surfaces of quads span slits.
        let closed = |x, layers| if slit(sheets) { 0.0 } else { joined(sheets, x, layers) };
        check("microquads", &mask(Occluders::Microquad, 1), &|x| closed(x, 1), &quads);
        check("two layers of quads", &mask(Occluders::Microquad, 2), &|x| closed(x, 2), &quads);
        check("moments", &vssm, &|x| by_moments(sheets, x, near), &|_| 0.04);
        check("slices", &textures, &|x| sliced(sheets, x, 16), &|_| image + 0.02);
    }
    assert!(wrong.is_empty(), "not as theory says:\n{}", wrong.join("\n"));
}

#[test]
fn parts_of_a_light_each_with_its_map_come_to_what_hides_it() {
    let gpu = gpu();
    let bias = Bias { cone: 0.0, ..Bias::default() };
    let map = MapConfig { bias, ..map(1024) };
    let window = Window { umbra: false, budget: 128, ..Window::default() };
    // What the centre of each part along x sees of what hides it, in the part's own coordinates.
    let theory = |x: f64, count: u32| {
        let n = f64::from(count);
        let part = |k: u32| {
            let middle = (2.0 * f64::from(k) + 1.0) / n - 1.0;
            share(-1.0 / n, 1.0 / n, |l| {
                let hidden = |(from, to, z): &Sheet| {
                    let at = |l: f64| l + (x - l) * z / 10.0;
                    let q = at(middle + l);
                    // Before it along the ray from the part's centre through that point.
                    let slope = (q - middle) / z;
                    let before = |s: &&Sheet| {
                        let q = middle + slope * s.2;
                        s.2 < *z && s.0 <= q && q < s.1
                    };
                    *from <= q && q < *to && !HIDDEN.iter().any(|s| before(&s))
                };
                !HIDDEN.iter().any(hidden)
            })
        };
        (0..count).map(part).sum::<f64>() / n
    };
    for x in [0.0, 0.3, 0.5] {
        let truth = joined(&HIDDEN, x, 9);
        let mut errors = Vec::new();
        for count in [1, 2, 4] {
            let (samples, occluders, parts) = (Samples::S256, Occluders::Micropatch, [count, 1]);
            let config = Bitmask { map, window, samples, occluders, parts, ..Bitmask::default() };
            let found = f64::from(below_a_square_light(&gpu, &HIDDEN, x, &Config::Bitmask(config)));
            let expected = theory(x, count);
            // As for the light as a whole, of up to four edges; see above.
            let off = 0.04;
            assert!(
                (found - expected).abs() < off,
                "{count} parts at {x}: {found}, not {expected} +- {off}"
            );
            errors.push((found - truth).abs());
        }
        assert!(errors[2] < 0.5 * errors[0], "at {x}: {errors:?} do not fall");
    }
    // Other lights are whole.
    let stage = seen(&gpu, &bodies(), 32);
    let config = |parts| Config::Bitmask(Bitmask { map, parts, ..Bitmask::default() });
    let ball = Light::Sphere { center: DVec3::new(0.4, 5.0, -0.3), radius: 0.5 };
    let [one, four] =
        [[1, 1], [2, 2]].map(|parts| area::shoot(&gpu, &stage, &ball, &config(parts)));
    assert_eq!(one, four, "a sphere");
}

#[test]
fn gratings_that_hide_all_the_light_are_whole_in_two_layers_only() {
    let gpu = gpu();
    let sheets = gratings();
    let bias = Bias { cone: 0.0, ..Bias::default() };
    let map = MapConfig { bias, ..map(2048) };
    let window = Window { umbra: false, budget: 128, ..Window::default() };
    let mask = |layers| {
        let (samples, occluders) = (Samples::S1024, Occluders::Micropatch);
        Config::Bitmask(Bitmask { map, window, samples, occluders, layers, ..Bitmask::default() })
    };
    let at = |config: &Config| f64::from(below_a_square_light(&gpu, &sheets, 0.0, config));
    let (one, two) = (at(&mask(1)), at(&mask(2)));
    // What one layer shows has a closed form; strips are 6 and 3 blocks wide, so that much of each is rounding.
    let expected = joined(&sheets, 0.0, 1);
    assert!((one - expected).abs() < 0.1, "one layer: {one}, not {expected}");
    assert!(two < 0.5 * one, "two layers: {two}, one: {one}");
}

#[test]
fn settings_that_a_soft_shadow_cannot_use_are_refused_with_a_fix() {
    let gpu = gpu();
    let objects = MapConfig { objects: 4, ..map(64) };
    let masked = MapConfig { receiver_mask: true, ..map(64) };
    let small = Window { hierarchy: Hierarchy::Y, ..Window::default() };
    let all = |map: MapConfig| {
        vec![
            Config::Pcss(Pcss { map, ..Pcss::default() }),
            Config::BackProjection(BackProjection { map, ..BackProjection::default() }),
            Config::Bitmask(Bitmask { map, ..Bitmask::default() }),
            Config::Bitmask(Bitmask { map, layers: 2, ..Bitmask::default() }),
            Config::Bitmask(Bitmask { map, parts: [2, 1], ..Bitmask::default() }),
            Config::Vssm(Vssm { map, ..Vssm::default() }),
            Config::OcclusionTextures(OcclusionTextures { map, ..Default::default() }),
        ]
    };
    let refuses = |config: &Config, fix: &str| {
        let error = config.build(&gpu).err().map(|e| e.to_string()).unwrap_or_default();
        assert!(error.contains(fix), "{config:?}: `{error}` says nothing of `{fix}`");
    };
    for config in all(objects) {
        refuses(&config, "leave `objects` at 0");
    }
    for config in all(masked) {
        refuses(&config, "leave `receiver_mask` off");
    }
    refuses(
        &Config::BackProjection(BackProjection { map: map(4), window: small }),
        "at least 8 texels",
    );
    for layers in [0, 5] {
        refuses(&Config::Bitmask(Bitmask { layers, ..Bitmask::default() }), "use 1 to 4");
    }
    for parts in [[0, 1], [1, 9]] {
        refuses(&Config::Bitmask(Bitmask { parts, ..Bitmask::default() }), "use 1 to 8");
    }
    let (pattern, occluders) = (Pattern::Hammersley, Occluders::Microtri);
    let triangles = Bitmask { pattern, occluders, ..Bitmask::default() };
    refuses(&Config::Bitmask(triangles), "which mark rectangles");
    let (emission, parts) = (Emission::new(1, 1, &[1.0]).ok(), [2, 2]);
    let both = Bitmask { emission, parts, ..Bitmask::default() };
    refuses(&Config::Bitmask(both), "`emission` out");
    // The control: without them all are built, and so is a plain map with them.
    for config in all(map(64)) {
        assert!(config.build(&gpu).is_ok(), "{config:?}");
    }
    assert!(MapTechnique::plain(&gpu, &objects).is_ok(), "maps of single objects");
}

#[test]
fn layers_change_nothing_without_an_extent_and_only_darken_with_one() {
    let gpu = gpu();
    let stage = seen(&gpu, &bodies(), 48);
    let mask = |layers| Config::Bitmask(Bitmask { map: map(128), layers, ..Bitmask::default() });
    let center = DVec3::new(0.4, 5.0, -0.3);
    let rect = |half: f64| Light::Rect { center, half_u: DVec3::X * half, half_v: DVec3::Z * half };
    for half in [0.0, 0.8] {
        let [one, two, four] =
            [1, 2, 4].map(|layers| area::shoot(&gpu, &stage, &rect(half), &mask(layers)));
        let lighter = |a: &[f32], b: &[f32]| a.iter().zip(b).filter(|(a, b)| a > b).count();
        assert_eq!(lighter(&two, &one), 0, "two layers let more light through");
        assert_eq!(lighter(&four, &two), 0, "four layers let more light through");
        let darker = lighter(&one, &two);
        assert_eq!(half > 0.0, darker > 0, "{darker} samples are darker with two layers");
    }
}

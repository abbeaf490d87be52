//! The cases that theory decides: a square light of half size 1 at z = 0, receivers at z = 10, a map of 1024 texels a
//! side that covers 90 degrees from the light's centre, near plane at z = 1. Strips are endless in y.

use antumbra_scene::Light;
use glam::{DMat4, DVec2, DVec3, DVec4};

use super::techniques::{Map, Receiver};
use super::{Seen, View};
use crate::{Bitmask, Hierarchy, Occluders, Pcss, Samples, Window};

const SIZE: i32 = 1024;
const EVERY_TEXEL: Window =
    Window { hierarchy: Hierarchy::None, umbra: false, budget: 1024, reach: 0, tally: false };

/// Light travels down -z of the clip matrix; z of these cases is its distance.
fn clip() -> DMat4 {
    DMat4::from_cols(DVec4::X, DVec4::Y, DVec4::new(0.0, 0.0, 0.0, -1.0), DVec4::Z)
}

fn light(half: f64) -> Light {
    Light::Rect { center: DVec3::ZERO, half_u: DVec3::X * half, half_v: DVec3::Y * half }
}

fn view(half: f64) -> View {
    View::new(&clip(), f64::from(SIZE), &light(half))
}

/// The receiver at (x, 0, z), level, and with nothing of a bias.
fn receiver(half: f64, x: f64, z: f64) -> Receiver {
    let (view, depth) = (view(half), 1.0 / z);
    let seen = view.seen(DVec2::new(512.0 * (1.0 + x / z), 512.0), depth);
    Receiver { light: seen, depth, gradient: DVec2::ZERO, cone: DVec2::ZERO }
}

/// A strip: from, to, and its distance as a function of x, as a line in the plane.
#[derive(Clone, Copy)]
struct Strip {
    from: f64,
    to: f64,
    z: f64,
}

fn strip(from: f64, to: f64, z: f64) -> Strip {
    Strip { from, to, z }
}

/// Reversed depth of each column: that of the nearest strip at the texels' centres; 0 where there is none.
fn columns(strips: &[Strip]) -> Vec<f64> {
    (0..SIZE)
        .map(|column| {
            let m = (f64::from(column) + 0.5) / 512.0 - 1.0;
            let hit = |s: &&Strip| s.from <= m * s.z && m * s.z < s.to;
            strips.iter().filter(hit).map(|s| 1.0 / s.z).fold(0.0, f64::max)
        })
        .collect()
}

fn pcss() -> Pcss {
    Pcss { search: 0, filter: 0, window: EVERY_TEXEL, ..Pcss::default() }
}

fn bitmask(occluders: Occluders) -> Bitmask {
    Bitmask { occluders, window: EVERY_TEXEL, ..Bitmask::default() }
}

/// What each technique sees of the light from (x, 0, 10).
struct Answers {
    pcss: f64,
    blockers: Option<f64>,
    areas: f64,
    patches: f64,
    closed: f64,
    quads: f64,
}

fn visible(map: &Map<'_>, receiver: &Receiver, config: &Bitmask) -> f64 {
    let (mask, all) = map.bitmask(receiver, config);
    1.0 - f64::from(mask.count_in(&all)) / f64::from(all.count())
}

fn answers(strips: &[Strip], half: f64, x: f64) -> Answers {
    let columns = columns(strips);
    let depth = |column: i32, _: i32| columns[column as usize];
    let map = Map { size: SIZE, depth: &depth };
    let at = receiver(half, x, 10.0);
    let (pcss, blockers) = map.pcss(&at, &pcss(), 0.0);
    let mask = |occluders| visible(&map, &at, &bitmask(occluders));
    Answers {
        pcss,
        blockers,
        areas: (1.0 - map.back_projection(&at, 1024)).max(0.0),
        patches: mask(Occluders::Micropatch),
        closed: mask(Occluders::ClosedMicropatch),
        quads: mask(Occluders::Microquad),
    }
}

/// What an edge that is off by a texel at the distance z changes: k dm / 2 h, with k = z z_p / (z_p - z) and dm = 2 / 1024.
fn texel(z: f64) -> f64 {
    z * 10.0 / (10.0 - z) * 2.0 / 1024.0 / 2.0
}

/// What 256 samples make of an axis-aligned edge, each.
const EDGE: f64 = 1.0 / 64.0;

#[track_caller]
fn near(found: f64, expected: f64, tolerance: f64) {
    assert!((found - expected).abs() <= tolerance, "{found}, not {expected} +- {tolerance}");
}

#[test]
fn a_half_plane_gives_the_linear_ramp_with_all_of_them() {
    for x in [-0.9, -0.5, -0.13, 0.0, 0.4, 0.77] {
        let a = answers(&[strip(-8.0, 0.0, 5.0)], 1.0, x);
        let truth = 0.5 + x / 2.0;
        near(a.pcss, truth, texel(5.0));
        near(a.areas, truth, texel(5.0));
        near(a.patches, truth, texel(5.0) + EDGE);
        near(a.closed, truth, texel(5.0) + EDGE);
        // Half a texel less on each side.
        near(a.quads, truth, 1.5 * texel(5.0) + EDGE);
        near(a.blockers.expect("blockers"), 5.0, 1e-12);
    }
}

#[test]
fn a_square_plate_gives_the_product_of_its_overlaps() {
    let depth = |x: i32, y: i32| {
        let at = |i: i32| ((f64::from(i) + 0.5) / 512.0 - 1.0) * 5.0;
        if at(x).abs() < 0.5 && at(y).abs() < 0.5 { 0.2 } else { 0.0 }
    };
    let map = Map { size: SIZE, depth: &depth };
    for (x, z) in [(0.0, 10.0), (0.7, 10.0), (1.4, 10.0), (0.3, 7.0)] {
        let at = receiver(1.0, x, z);
        let overlap = |p: f64| {
            let l = |a: f64| (z * a - 5.0 * p) / (z - 5.0);
            (l(0.5).min(1.0) - l(-0.5).max(-1.0)).max(0.0)
        };
        let truth = 1.0 - overlap(x) * overlap(0.0) / 4.0;
        // Two edges an axis.
        let off = 4.0 * (z * 5.0 / (z - 5.0)) / 1024.0;
        near(map.pcss(&at, &pcss(), 0.0).0, truth, off);
        near(1.0 - map.back_projection(&at, 1024), truth, off);
        near(visible(&map, &at, &bitmask(Occluders::Micropatch)), truth, off + 4.0 * EDGE);
    }
}

#[test]
fn pcss_counts_what_lies_beside_the_light_and_back_projection_does_not() {
    let lit = answers(&[strip(1.2, 3.0, 2.0), strip(0.4, 3.0, 8.0)], 1.0, 0.0);
    // Fernando's estimate has a closed form: slopes 0.6 to 0.9 at 2 and 0.05 to 0.375 at 8 in the search window of 0.9,
    // a mean distance of 5.12, and a filter window of 1 / 5.12 - 1 / 10 = 0.0953, of which 0.0453 is hidden on one side.
    let mean: f64 = (2.0 * 0.3 + 8.0 * 0.325) / 0.625;
    let window = 1.0 / mean - 0.1;
    let expected = 1.0 - (window - 0.05) / (2.0 * window);
    near(expected, 0.762, 1e-3);
    // Strips' edges are off by up to half a texel of 1 / 512 a slope; the mean by 6 times that over 0.625.
    near(lit.blockers.expect("blockers"), mean, 6.0 * 2.0 / 1024.0 / 0.625);
    near(lit.pcss, expected, 0.03);
    near(lit.areas, 1.0, 1e-12);
    near(lit.patches, 1.0, 0.0);
    near(lit.quads, 1.0, 0.0);

    let dark = answers(&[strip(-0.4, 0.4, 8.0), strip(1.4, 1.8, 2.0)], 1.0, 0.0);
    near(dark.blockers.expect("blockers"), 4.0 * 8.0 / 8.0, 0.1);
    // 2 (0.2) and 8 (0.1): a mean of 4, a window of 0.15, of which 0.05 a side is hidden.
    near(dark.pcss, 2.0 / 3.0, 0.02);
    near(dark.areas, 0.0, 1e-12);
    near(dark.patches, 0.0, 0.0);
}

#[test]
fn what_the_centre_of_the_light_does_not_see_does_not_count() {
    // The near strip hides a quarter of the light, and the rest is hidden by one that lies in its shadow.
    let a = answers(&[strip(-0.2, 0.2, 2.0), strip(-0.35, 0.35, 8.0)], 1.0, 0.0);
    for found in [a.pcss, a.areas, a.patches] {
        near(found, 0.75, 2.0 * texel(2.0) + 2.0 * EDGE);
    }
}

#[test]
fn own_occluders_change_nothing_at_one_depth_and_jump_at_the_edge_between_several() {
    let own = Pcss { own: true, ..pcss() };
    let visible = |strips: &[Strip], x: f64, config: &Pcss| {
        let columns = columns(strips);
        let depth = |column: i32, _: i32| columns[column as usize];
        Map { size: SIZE, depth: &depth }.pcss(&receiver(1.0, x, 10.0), config, 0.0).0
    };
    let one = [strip(-8.0, 0.0, 5.0)];
    for x in [-0.9, -0.3, -0.02, 0.02, 0.3, 0.9] {
        near(visible(&one, x, &own), visible(&one, x, &pcss()), 1e-12);
    }
    // Two depths that meet at the slope -0.1: at x < -1 what hides the centre lies at 2, and the search finds both.
    let two = [strip(-8.0, -0.2, 2.0), strip(-8.0, 0.0, 8.0)];
    let jump = |config: &Pcss| visible(&two, 0.005, config) - visible(&two, -0.005, config);
    let smooth = jump(&pcss()).abs();
    assert!(smooth < 0.02, "a mean of all is continuous: {smooth}");
    assert!(jump(&own).abs() > 2.0 * smooth, "{} at the hard edge, {smooth}", jump(&own));
}

#[test]
fn a_strip_under_a_large_light_hides_its_share_and_taps_miss_it() {
    // |x| <= 0.1 at z = 5 hides 0.4 of 10.
    let columns = columns(&[strip(-0.1, 0.1, 5.0)]);
    let depth = |column: i32, _: i32| columns[column as usize];
    let map = Map { size: SIZE, depth: &depth };
    let at = receiver(5.0, 0.0, 10.0);
    let off = 2.0 * texel(5.0) / 5.0;
    near(1.0 - map.back_projection(&at, 1024), 0.96, off);
    near(visible(&map, &at, &bitmask(Occluders::Micropatch)), 0.96, off + 2.0 * EDGE);
    near(map.pcss(&at, &pcss(), 0.0).0, 0.96, off);
    // The strip is 0.04 of slope wide in a search window of 9: 32 taps see one column of it or none.
    let taps = Pcss { search: 32, filter: 64, ..pcss() };
    let found: Vec<f64> = (0..500).map(|i| map.pcss(&at, &taps, f64::from(i) / 500.0).0).collect();
    let missed = found.iter().filter(|v| **v == 1.0).count();
    // 32 columns of taps, 9 / 32 apart: one of them falls into 0.04 with a chance of 0.142, and its tap into the map, 2 of 9,
    // with 0.222. So 484 of 500, and four times the root of 16 either way.
    assert!((468..500).contains(&missed), "{missed} of 500 miss the strip");
}

#[test]
fn the_noise_of_taps_is_known_and_falls_with_their_number() {
    let columns = columns(&[strip(-8.0, 0.0, 5.0)]);
    let depth = |column: i32, _: i32| columns[column as usize];
    let map = Map { size: SIZE, depth: &depth };
    let deviation = |filter: u32| {
        let config = Pcss { search: 32, filter, ..pcss() };
        let mut square = 0.0;
        for i in 0..400 {
            let x = 0.004 * f64::from(i) - 0.8;
            let (v, _) = map.pcss(&receiver(1.0, x, 10.0), &config, f64::from(i) * 0.618_034 % 1.0);
            square += (v - 0.5 - 0.5 * x).powi(2) / 400.0;
        }
        square.sqrt()
    };
    let [few, usual, many] = [16, 64, 256].map(deviation);
    // Hammersley's points along an axis: a count is off by one at most, uniformly: 1 / (n sqrt(12)); and the distance that the
    // search finds is exact. Measured: 0.0255, 0.0064 and 0.0016.
    for (found, taps) in [(few, 16.0), (usual, 64.0), (many, 256.0)] {
        assert!(found <= 1.5 / (taps * 12f64.sqrt()) + texel(5.0), "{taps} taps: {found}");
    }
    assert!(few > usual && usual > many, "{few} {usual} {many}");
}

#[test]
fn light_between_surfaces_of_different_depth_is_seen_by_patches_that_are_not_closed() {
    let strips = [strip(-50.0, 0.0, 2.0), strip(0.0, 50.0, 8.0)];
    let a = answers(&strips, 1.0, -0.5);
    // The truth. The far plane hides l > 2, none of the light, the near one l < 0.125.
    near(a.patches, 0.4375, texel(2.0) + EDGE);
    near(a.areas, 0.4375, texel(2.0));
    near(a.closed, 0.0, 0.0);
    near(a.quads, 0.0, 0.0);
}

#[test]
fn occluders_are_joined_by_masks_and_added_by_areas() {
    // What both hide, and what neither does: the far one lies in the near one's shadow but for what shows beside it.
    let joined = answers(&[strip(-50.0, 0.0, 4.0), strip(-50.0, 0.0, 6.0)], 1.0, 0.0);
    near(joined.patches, 0.5, texel(4.0) + EDGE);
    let both = answers(&[strip(-50.0, 0.0, 4.0), strip(0.0, 50.0, 6.0)], 1.0, 0.0);
    near(both.patches, 0.0, texel(6.0) + EDGE);
    near(both.areas, 0.0, texel(6.0));
}

#[test]
fn a_column_from_2_to_8_hides_what_its_near_end_does() {
    // Seen from the centre its sides lie behind its front, |x| <= 0.5 at z = 2, which hides most from beside, too. At x = 1
    // the far end also hides a sixteenth on the other side, which no map from the centre knows: 0.3125 is true.
    for (x, truth) in [(1.0, 0.375), (2.0, 0.4375), (3.0, 0.5625)] {
        let a = answers(&[strip(-0.5, 0.5, 2.0)], 1.0, x);
        near(a.areas, truth, 2.0 * texel(2.0));
        near(a.pcss, truth, 2.0 * texel(2.0));
        near(a.patches, truth, 2.0 * texel(2.0) + EDGE);
        near(a.quads, truth, 3.0 * texel(2.0) + EDGE);
    }
}

#[test]
fn pcss_of_a_window_at_three_depths_is_the_share_at_the_receivers() {
    // In every 20 columns 6 at z = 2, 13 at 8 and one empty, where a Chebyshev bound gives 0.372.
    let depth = |column: i32, _: i32| match column % 20 {
        0..6 => 0.5,
        6..19 => 0.125,
        _ => 0.0,
    };
    let map = Map { size: SIZE, depth: &depth };
    let (v, blockers) = map.pcss(&receiver(1.0, 0.0, 10.0), &pcss(), 0.0);
    let mean: f64 = (0.3 * 2.0 + 0.65 * 8.0) / 0.95;
    // 921 columns hold 46 periods, the last one in part.
    near(blockers.expect("blockers"), mean, 0.02);
    // A window of 512 (1 / mean - 0.1) 2 = 65 columns holds 3.3 periods: an empty column more or less.
    near(v, 0.05, 1.0 / 65.0);
}

#[test]
fn a_box_on_the_floor_keeps_its_shadow_at_the_contact() {
    // |x| <= 0.5 from z = 9 to the receiver at 10. The top, seen from the centre, hides all of its sides.
    let columns = columns(&[strip(-0.5, 0.5, 9.0)]);
    let depth = |column: i32, _: i32| columns[column as usize];
    let map = Map { size: SIZE, depth: &depth };
    for d in [0.01, 0.02, 0.05, 0.1] {
        let at = receiver(1.0, 0.5 + d, 10.0);
        // The top hides l < (10 0.5 - 9 (0.5 + d)) / 1 = 0.5 - 9 d.
        let truth = 0.25 + 4.5 * d;
        near(1.0 - map.back_projection(&at, 1024), truth, texel(9.0));
        near(map.pcss(&at, &pcss(), 0.0).0, truth, texel(9.0));
        let mask = |occluders| visible(&map, &at, &bitmask(occluders));
        near(mask(Occluders::Micropatch), truth, texel(9.0) + EDGE);
        near(mask(Occluders::Microquad), truth, 1.5 * texel(9.0) + EDGE);
    }
}

#[test]
fn strips_of_one_texel_are_lost_by_quads_and_kept_by_patches() {
    // 32 of them, one texel wide every four.
    let strips: Vec<Strip> = (0..32)
        .map(|i| {
            let m = f64::from(4 * (i - 16)) / 512.0;
            strip(5.0 * m, 5.0 * (m + 1.0 / 512.0), 5.0)
        })
        .collect();
    let mut mean = 0.0;
    for i in 0..16 {
        let a = answers(&strips, 1.0, 0.013 * f64::from(i));
        // The light holds 25.6 periods, of which the last may be a strip or not.
        near(a.areas, 0.75, 0.75 / 25.6);
        near(a.quads, 1.0, 0.0);
        assert!(a.closed <= a.patches, "closing hides more");
        mean += a.patches / 16.0;
    }
    // Strips of 0.31 of a step between samples catch some or none: an eighth of what is hidden more or less for one receiver,
    // and as much less for 16.
    near(mean, 0.75, 0.03);
}

#[test]
fn a_tilted_plate_leaks_through_patches_that_are_not_closed() {
    // z = 5 + x for x in [-2, 2]: m = x / (5 + x).
    let columns: Vec<f64> = (0..SIZE)
        .map(|column| {
            let m = (f64::from(column) + 0.5) / 512.0 - 1.0;
            let x = 5.0 * m / (1.0 - m);
            if x.abs() <= 2.0 { 1.0 / (5.0 + x) } else { 0.0 }
        })
        .collect();
    let depth = |column: i32, _: i32| columns[column as usize];
    let map = Map { size: SIZE, depth: &depth };
    let at = receiver(1.0, 0.0, 10.0);
    // From (0, 0, 10) the plate spans l from 10 (-2) / 7 to 10 2 / 3: all of the light.
    let mask = |occluders| visible(&map, &at, &bitmask(occluders));
    for closed in [
        Occluders::ClosedMicropatch,
        Occluders::Microquad,
        Occluders::ExactMicroquad,
        Occluders::Microtri,
    ] {
        near(mask(closed), 0.0, 0.0);
    }
    // Unfilled patches leave slits on the side that recedes, and overlap on the other, where areas count twice.
    let hidden = map.back_projection(&at, 1024);
    assert!((hidden - 1.0).abs() < 0.05, "{hidden}");
}

#[test]
fn the_window_is_that_of_the_formula_and_points_come_back_to_where_they_were() {
    let at: Seen = receiver(1.0, 2.0, 10.0).light;
    for z in [1.5, 5.0, 9.0, 9.999] {
        let [lo, hi] = at.window(1.0 / z);
        let half = 512.0 * (1.0 / z - 1.0 / 10.0);
        near((hi - lo).x, 2.0 * half, 1e-9);
        near((hi - lo).y, 2.0 * half, 1e-9);
        // The light's corner through an occluder's plane.
        near(at.project_back(hi, 1.0 / z).x, 1.0, 1e-9);
    }
    // A light that is not parallel to the map, and one that faces the receiver.
    let tilted = Light::Rect {
        center: DVec3::ZERO,
        half_u: DVec3::new(0.6, 0.0, 0.8),
        half_v: DVec3::new(0.0, 1.5, 0.0),
    };
    let ball = Light::Sphere { center: DVec3::ZERO, radius: 1.3 };
    for light in [tilted, ball] {
        let view = View::new(&clip(), f64::from(SIZE), &light);
        let p = DVec3::new(2.0, -1.0, -10.0);
        let texel = DVec2::new(512.0 * (1.0 + 0.2), 512.0 * (1.0 + 0.1));
        let seen = view.seen(texel, 0.1);
        for s in [DVec2::new(0.3, -0.5), DVec2::new(-0.6, 0.7), DVec2::ZERO] {
            near(seen.on_light(seen.on_plane(s)).distance(s), 0.0, 1e-12);
            // The same point by hand: from p through the light's point to the plane z = 0.
            if let Light::Rect { half_u, half_v, .. } = light {
                let l = half_u * s.x + half_v * s.y;
                let on_plane = p + (l - p) * (p.z / (p.z - l.z));
                let expected = DVec2::new(on_plane.x, -on_plane.y);
                near(seen.on_plane(s).distance(expected), 0.0, 1e-12);
            }
        }
    }
}

#[test]
fn light_of_any_size_gives_numbers_from_0_to_1() {
    for half in [1e-6, 1e-3, 0.1, 1.0, 30.0, 1e4] {
        for (z, x) in [(0.5, 0.0), (1.0, 0.0), (1.001, 0.1), (5.0, 0.0), (9.9999, 0.3)] {
            let columns = columns(&[strip(-8.0, 0.0, 1.0001), strip(0.0, 0.4, 9.9999)]);
            let depth = |column: i32, _: i32| columns[column as usize];
            let map = Map { size: SIZE, depth: &depth };
            let at = receiver(half, x, z);
            let budget = Window { budget: 64, ..EVERY_TEXEL };
            let config = Pcss { window: budget, ..pcss() };
            let mask = Bitmask { window: budget, ..bitmask(Occluders::ClosedMicropatch) };
            for v in [
                map.pcss(&at, &config, 0.0).0,
                (1.0 - map.back_projection(&at, 64)).max(0.0),
                visible(&map, &at, &mask),
            ] {
                assert!((0.0..=1.0).contains(&v), "{v} of a light of {half} at {z}");
            }
        }
    }
}

#[test]
fn samples_converge_with_their_number() {
    let columns = columns(&[strip(-8.0, 0.1, 5.0)]);
    let depth = |column: i32, _: i32| columns[column as usize];
    let map = Map { size: SIZE, depth: &depth };
    let error = |samples: Samples| {
        let config = Bitmask { samples, ..bitmask(Occluders::Micropatch) };
        (0..40).fold(0f64, |worst, i| {
            let at = receiver(1.0, f64::from(i) * 0.04 - 0.7, 10.0);
            let exact = 1.0 - map.back_projection(&at, 1024);
            worst.max((visible(&map, &at, &config) - exact).abs())
        })
    };
    // An edge is off by half a step of 4 n positions an axis.
    for (samples, tiles) in [(Samples::S64, 4.0), (Samples::S256, 8.0), (Samples::S1024, 16.0)] {
        let worst = error(samples);
        assert!(worst <= 0.5 / (4.0 * tiles) + 1e-9, "{samples:?}: {worst}");
    }
}

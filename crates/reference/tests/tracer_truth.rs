//! Traced visibility against shadows that are known in closed form.

use antumbra_reference::{SampleClass, Tracer, Truth, TruthOptions, ViewSample};
use antumbra_scene::{Light, Triangles};
use glam::{DVec3, Vec3};

/// Numbers in [0, 1): the golden ratio's multiples, modulo 1, from the bits of a multiplied counter.
fn unit(i: u64, dimension: u64) -> f64 {
    let x = (i + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15)
        ^ (dimension + 1).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((x ^ (x >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
}

/// Axis-aligned rectangles [x0, x1, y, z0, z1] above a floor.
fn scene(rectangles: &[[f32; 5]]) -> Tracer {
    let mut list = Triangles::default();
    for &[x0, x1, y, z0, z1] in rectangles {
        let n = list.positions.len() as u32;
        list.positions
            .extend([(x0, z0), (x1, z0), (x1, z1), (x0, z1)].map(|(x, z)| Vec3::new(x, y, z)));
        list.triangles.extend([[n, n + 1, n + 2], [n, n + 2, n + 3]]);
    }
    Tracer::new(&list).expect("valid triangles")
}

const FLOOR: [f32; 5] = [-8.0, 8.0, 0.0, -8.0, 8.0];

/// Samples on the floor, |x| and |z| below `half`.
fn floor(count: u64, half: f64) -> Vec<ViewSample> {
    (0..count)
        .map(|i| {
            let at = |d| ((2.0 * unit(i, d) - 1.0) * half) as f32;
            ViewSample { position: Vec3::new(at(0), 0.0, at(1)), normal: Vec3::Y }
        })
        .collect()
}

const POINT: Light = Light::Point { position: DVec3::new(0.0, 6.0, 0.0) };
const DOWN: Light = Light::Directional { direction: DVec3::NEG_Y, angular_diameter: 0.0 };

/// Disagreements of a hard shadow with the square |x|, |z| <= `half`, the number of ties, and the
/// greatest distance of a tie from the square's outline.
fn against_square(truth: &Truth, samples: &[ViewSample], half: f32) -> (usize, usize, f32) {
    let (mut wrong, mut ties, mut furthest) = (0, 0, 0.0_f32);
    for ((sample, &visibility), &class) in samples.iter().zip(&truth.visibility).zip(&truth.class) {
        let reach = sample.position.x.abs().max(sample.position.z.abs());
        match class {
            SampleClass::Counted => wrong += usize::from((visibility == 0.0) != (reach <= half)),
            SampleClass::Tie => {
                ties += 1;
                furthest = furthest.max((reach - half).abs());
            }
            _ => wrong += 1,
        }
    }
    (wrong, ties, furthest)
}

#[test]
fn hard_shadows_of_a_square_are_exact() {
    let tracer = scene(&[FLOOR, [-1.0, 1.0, 2.0, -1.0, 1.0]]);
    let options = TruthOptions { ties: true, ..TruthOptions::default() };
    let samples = floor(1_000_000, 2.5);
    for (light, half) in [(POINT, 1.5), (DOWN, 1.0)] {
        let truth = tracer.truth(&light, &samples, &options);
        let (wrong, ties, furthest) = against_square(&truth, &samples, half);
        assert_eq!(wrong, 0, "{light:?}: wrong samples outside the tie band");
        // 1e-5 of the radius 11.4, and the offset's share.
        assert!(ties > 0 && furthest < 3e-4, "{light:?}: {ties} ties up to {furthest} m away");
        assert!(ties < 1000, "{light:?}: {ties} ties");
    }
}

#[test]
fn comparison_with_the_square_notices_a_shift() {
    let tracer = scene(&[FLOOR, [-0.99, 1.01, 2.0, -1.0, 1.0]]);
    let options = TruthOptions { ties: true, ..TruthOptions::default() };
    let samples = floor(100_000, 2.5);
    let (wrong, ..) = against_square(&tracer.truth(&DOWN, &samples, &options), &samples, 1.0);
    assert!(wrong > 100, "an occluder shifted by a hundredth changed {wrong} samples");
}

/// A light of width 1 at height 4 over the edge x = 0 of a half-plane at height 2: V rises linearly
/// over the width 1 * 2 / (4 - 2) = 1, from x = -0.5 to 0.5.
fn penumbra(samples: u32, seed: u64, shift: f32) -> (f64, f64) {
    let tracer = scene(&[FLOOR, [-90.0, shift, 2.0, -90.0, 90.0]]);
    let light = Light::Rect {
        center: DVec3::new(0.0, 4.0, 0.0),
        // Turned, so that the edge crosses the light's sides at an angle; the width across it is that
        // of the distribution of |cos a| s + |sin a| t: see `across`.
        half_u: 0.5 * DVec3::new(TURN.cos(), 0.0, TURN.sin()),
        half_v: 0.5 * DVec3::new(-TURN.sin(), 0.0, TURN.cos()),
    };
    let view = floor(4000, 0.45);
    let options = TruthOptions { light_samples: samples, seed, ..TruthOptions::default() };
    let truth = tracer.truth(&light, &view, &options);
    let squares: f64 = view
        .iter()
        .zip(&truth.visibility)
        // The light's point at offset q is seen if the ray passes the edge: (x + q) / 2 > 0.
        .map(|(s, &v)| (f64::from(v) - across(f64::from(s.position.x))).powi(2))
        .sum();
    ((squares / view.len() as f64).sqrt(), truth.error_estimate)
}

/// The light's turn about its normal, radians.
const TURN: f64 = 0.4;

/// The fraction of the turned unit square with a coordinate above -x: the integral of a trapezium.
fn across(x: f64) -> f64 {
    let (a, b) = (TURN.cos(), TURN.sin());
    // Integral of max(0, t)^2 / 2 differences: the distribution function of a s + b t.
    let ramp = |t: f64| 0.5 * t.max(0.0).powi(2);
    let half = 0.5 * (a + b);
    (ramp(x + half) - ramp(x + half - a) - ramp(x + half - b) + ramp(x + half - a - b)) / (a * b)
}

#[test]
fn area_light_error_is_small_estimated_and_falls_fast() {
    let (coarse, _) = penumbra(64, 0, 0.0);
    let (fine, estimate) = penumbra(1024, 0, 0.0);
    assert!(fine <= 2e-3, "RMSE {fine} with 1024 samples");
    let order = (coarse / fine).log2() / 4.0;
    // The exact order is 0.75; 0.73 leaves room for the spread of 4000 samples' RMSE, about 1% each.
    assert!(order >= 0.73, "the error falls as n^-{order}");
    assert!(
        estimate >= fine && estimate <= 1.6 * fine,
        "estimate {estimate} of an error of {fine}"
    );
    let (shifted, _) = penumbra(1024, 0, 0.02);
    assert!(shifted > 5.0 * fine, "a shifted occluder went unnoticed: {shifted} against {fine}");
}

#[test]
fn truth_does_not_depend_on_the_number_of_threads() {
    let tracer = scene(&[FLOOR, [-1.0, 1.0, 2.0, -1.0, 1.0]]);
    let light = Light::Sphere { center: DVec3::new(0.0, 6.0, 0.0), radius: 0.5 };
    let view = floor(3000, 2.5);
    let run = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
        let truth = pool.install(|| tracer.truth(&light, &view, &TruthOptions::default()));
        (truth.visibility, truth.class, truth.error_estimate, truth.rays)
    };
    let one = run(1);
    assert_eq!(one, run(2), "two threads");
    assert_eq!(one, run(5), "five threads");
}

#[test]
fn lights_and_samples_are_classed() {
    let tracer = scene(&[FLOOR]);
    let up = ViewSample { position: Vec3::ZERO, normal: Vec3::Y };
    let class = |light: Light, sample: ViewSample| {
        let truth = tracer.truth(&light, &[sample], &TruthOptions::default());
        (truth.class[0], truth.visibility[0])
    };
    assert_eq!(class(POINT, up), (SampleClass::Counted, 1.0), "lit");
    let down = ViewSample { normal: Vec3::NEG_Y, ..up };
    assert_eq!(class(POINT, down), (SampleClass::FacingAway, 0.0), "seen from below");
    let none = ViewSample { normal: Vec3::ZERO, ..up };
    assert_eq!(class(POINT, none).0, SampleClass::Missing, "no surface");
    let nan = ViewSample { position: Vec3::NAN, ..up };
    assert_eq!(class(POINT, nan).0, SampleClass::Missing, "no position");
    let spot = Light::Spot {
        position: DVec3::new(3.0, 3.0, 0.0),
        direction: DVec3::NEG_Y,
        outer_angle: 0.7,
    };
    assert_eq!(class(spot, up), (SampleClass::OutsideLight, 1.0), "45 degrees off a cone of 40");
    // A sphere cut in half by the tangent plane: the lower half is hidden by the receiver.
    let sphere = Light::Sphere { center: DVec3::new(3.0, 0.0, 0.0), radius: 1.0 };
    let (seen, visibility) = class(sphere, up);
    assert_eq!(seen, SampleClass::Counted, "half above the horizon");
    assert!((visibility - 0.5).abs() < 0.02, "half of the sphere is visible, not {visibility}");
}

#[test]
fn surfaces_hide_neither_themselves_nor_their_light() {
    // A floor and a lamp at a place where coordinates are coarse, lit at all angles.
    for offset in [0.0, 300.0, 1e5] {
        let mut list = Triangles::default();
        let quad = |list: &mut Triangles, half: f32, y: f32| {
            let n = list.positions.len() as u32;
            list.positions.extend([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)].map(
                |(x, z)| {
                    // Tilted, so that no coordinate is constant.
                    Vec3::new(
                        x * half + offset,
                        y + 0.3 * x * half + 0.1 * z * half,
                        z * half - offset,
                    )
                },
            ));
            list.triangles.extend([[n, n + 1, n + 2], [n, n + 2, n + 3]]);
        };
        quad(&mut list, 8.0, 0.0);
        quad(&mut list, 1.0, 3.0);
        let tracer = Tracer::new(&list).expect("valid triangles");
        let floor: Vec<Vec3> = list.positions[..4].to_vec();
        let normal = (floor[1] - floor[0]).cross(floor[3] - floor[0]).normalize();
        let normal = normal * normal.y.signum();
        let samples: Vec<ViewSample> = (0..20_000)
            .map(|i| {
                let (s, t) = (unit(i, 0) as f32, unit(i, 1) as f32);
                let position = floor[0] + (floor[1] - floor[0]) * s + (floor[3] - floor[0]) * t;
                ViewSample { position, normal }
            })
            .collect();
        let lamp = |i: usize| list.positions[4 + i].as_dvec3();
        let light = Light::Rect {
            center: 0.5 * (lamp(0) + lamp(2)),
            half_u: 0.5 * (lamp(1) - lamp(0)),
            half_v: 0.5 * (lamp(3) - lamp(0)),
        };
        let options = TruthOptions { light_samples: 16, ..TruthOptions::default() };
        let truth = tracer.truth(&light, &samples, &options);
        let dark = truth.visibility.iter().filter(|&&v| v < 1.0).count();
        assert_eq!(dark, 0, "offset {offset}: samples that do not see all of the lamp");
    }
}

//! Traced visibility against the closed forms, on every generated scene that has one and on a tilted
//! polygon.

#![allow(clippy::print_stdout, reason = "the figures are read with --nocapture")]

use std::f64::consts::PI;

use antumbra_reference::closed::{Occluder, is_tie, visibility};
use antumbra_reference::{SampleClass, Tracer, TruthOptions, ViewSample};
use antumbra_scene::{Light, Scene, Triangles, generate};
use glam::{DVec3, Vec3, dvec3};
use rayon::prelude::*;

/// SplitMix64 (Steele, Lea and Flood 2014), as a number in [0, 1).
fn unit(state: &mut u64) -> f64 {
    *state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let x = (*state ^ (*state >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((x ^ (x >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
}

/// A caster over the floor y = 0, traced and in closed form.
struct Case {
    name: &'static str,
    tracer: Tracer,
    occluder: Occluder,
}

impl Case {
    /// Of a scene whose caster is its second object; `outline` picks the caster's outline from its
    /// vertices.
    fn of(name: &'static str, scene: &Scene, outline: impl Fn(&[DVec3]) -> Occluder) -> Self {
        let triangles = scene.triangles(DVec3::ZERO).expect("a valid scene");
        let floor = 4;
        let caster: Vec<DVec3> =
            triangles.positions[floor..].iter().map(|p| p.as_dvec3()).collect();
        let tracer = Tracer::new(&triangles).expect("valid triangles");
        Self { name, tracer, occluder: outline(&caster) }
    }

    fn all() -> [Self; 4] {
        let polygon = |corners: &[DVec3]| Occluder::ConvexPolygon(corners.to_vec());
        let edge =
            Occluder::HalfPlane { point: DVec3::Y * 2.0, normal: DVec3::Y, inward: DVec3::NEG_X };
        let mut tilted = Triangles::default();
        tilted.positions.extend(
            [(-10.0, -10.0), (10.0, -10.0), (10.0, 10.0), (-10.0, 10.0)]
                .map(|(x, z)| Vec3::new(x, 0.0, z)),
        );
        // In the plane y = 2 + x / 2 + z / 4, with corners that are exact.
        let corners = [(-1.0, -0.5), (0.25, -1.0), (1.0, 0.0), (0.5, 1.0), (-0.75, 0.75)]
            .map(|(x, z)| Vec3::new(x, 2.0 + 0.5 * x + 0.25 * z, z));
        tilted.positions.extend(corners);
        tilted.triangles = vec![[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7], [4, 7, 8]];
        [
            Self::of("half-plane", &generate::half_plane_over_plane(&Default::default()), |_| {
                edge.clone()
            }),
            Self::of("rectangle", &generate::rectangle_over_plane(&Default::default()), polygon),
            // The first vertex is the centre of the fan.
            Self::of("disc", &generate::disc_over_plane(&Default::default()), |c| polygon(&c[1..])),
            Self {
                name: "tilted polygon",
                tracer: Tracer::new(&tilted).expect("valid triangles"),
                occluder: polygon(&corners.map(|p| p.as_dvec3())),
            },
        ]
    }

    /// The occluder moved along x, metres.
    fn shifted(&self, by: f64) -> Occluder {
        let by = DVec3::X * by;
        match self.occluder.clone() {
            Occluder::ConvexPolygon(corners) => {
                Occluder::ConvexPolygon(corners.into_iter().map(|p| p + by).collect())
            }
            Occluder::HalfPlane { point, normal, inward } => {
                Occluder::HalfPlane { point: point + by, normal, inward }
            }
            Occluder::Disc { center, normal, radius } => {
                Occluder::Disc { center: center + by, normal, radius }
            }
        }
    }
}

fn on_floor(state: &mut u64) -> ViewSample {
    let mut at = || (8.0 * unit(state) - 4.0) as f32;
    ViewSample { position: Vec3::new(at(), 0.0, at()), normal: Vec3::Y }
}

/// Lights parallel to the floor and tilted ones, all of them above it.
fn wide_lights() -> [(&'static str, Light); 7] {
    let center = dvec3(0.3, 6.0, -0.2);
    let axis = dvec3(0.3, -1.0, 0.2).normalize();
    let (u, v) = axis.any_orthonormal_pair();
    let disc = |axis_u, axis_v| Light::Disc { center, radius: 0.7, axis_u, axis_v };
    let sun = |direction| Light::Directional { direction, angular_diameter: 0.2 };
    [
        ("level rect", Light::Rect { center, half_u: DVec3::X * 0.8, half_v: DVec3::Z * 0.5 }),
        ("tilted rect", Light::Rect { center, half_u: u * 0.8, half_v: v * 0.5 }),
        ("level disc", disc(DVec3::X, DVec3::Z)),
        ("tilted disc", disc(u, v)),
        ("sphere", Light::Sphere { center, radius: 0.6 }),
        ("sun above", sun(DVec3::NEG_Y)),
        ("sun aslant", sun(axis)),
    ]
}

/// Points in the penumbra, and a quarter as many beside it, with their visibilities.
fn receivers(occluder: &Occluder, light: &Light, count: usize) -> (Vec<ViewSample>, Vec<f64>) {
    let (mut inside, mut outside) = (Vec::new(), Vec::new());
    for round in 0..100_u64 {
        let candidates: Vec<(ViewSample, f64)> = (0..4096)
            .into_par_iter()
            .map(|i| {
                let sample = on_floor(&mut ((4096 * round + i) << 20));
                (sample, visibility(occluder, light, sample.position.as_dvec3()))
            })
            .collect();
        for candidate in candidates {
            if candidate.1 > 0.0 && candidate.1 < 1.0 {
                inside.push(candidate);
            } else {
                outside.push(candidate);
            }
        }
        if inside.len() >= count && outside.len() >= count / 4 {
            break;
        }
    }
    inside.into_iter().take(count).chain(outside.into_iter().take(count / 4)).unzip()
}

/// Squared errors of the traced visibilities.
fn squares(tracer: &Tracer, light: &Light, view: &[ViewSample], exact: &[f64], n: u32) -> Vec<f64> {
    // Another seed for every n: independent errors, as the regression assumes.
    let options = TruthOptions { light_samples: n, seed: n.into(), ..TruthOptions::default() };
    let truth = tracer.truth(light, view, &options);
    truth.visibility.iter().zip(exact).map(|(&v, e)| (f64::from(v) - e).powi(2)).collect()
}

fn rms(squares: impl ExactSizeIterator<Item = f64>) -> f64 {
    let count = squares.len() as f64;
    (squares.sum::<f64>() / count).sqrt()
}

/// Light samples of the regression, and their binary logarithms about the mean.
const COUNTS: [u32; 4] = [64, 256, 1024, 4096];
const ABSCISSAE: [f64; 4] = [-3.0, -1.0, 1.0, 3.0];

/// Batches of points, whose spread tells the uncertainty of the order.
const BATCHES: usize = 16;

/// The order of convergence by least squares of log RMSE over log n, and its standard error: each
/// batch of points gives an order; the spread of independent orders over the root of their number.
fn order(errors: &[Vec<f64>; 4]) -> (f64, f64) {
    let slope = |values: [f64; 4]| {
        let products = ABSCISSAE.iter().zip(values).map(|(x, e)| x * e.log2());
        -products.sum::<f64>() / ABSCISSAE.iter().map(|x| x * x).sum::<f64>()
    };
    let whole = slope(std::array::from_fn(|i| rms(errors[i].iter().copied())));
    let batches: Vec<f64> = (0..BATCHES)
        .map(|b| {
            slope(std::array::from_fn(|i| {
                let batch: Vec<f64> = errors[i].iter().copied().skip(b).step_by(BATCHES).collect();
                rms(batch.into_iter())
            }))
        })
        .collect();
    let mean = batches.iter().sum::<f64>() / BATCHES as f64;
    let variance = batches.iter().map(|o| (o - mean).powi(2)).sum::<f64>() / (BATCHES - 1) as f64;
    (whole, (variance / BATCHES as f64).sqrt())
}

/// The exact order is 0.75 where the edge crosses the light at any angle, so that half of the measured
/// ones lie below it. What must hold is that the measurement does not contradict 0.75: no pair by more
/// than three standard errors (28 true ones do so once in 26 such tests; the numbers here are fixed),
/// and their mean not by more than two. Edges along the strata of a level rectangle converge with
/// order 1 and are left out of the mean. A standard error is about 0.01; should it ever be so large
/// that everything passes, 0.70 holds regardless. Independent random points have 0.5.
#[test]
fn penumbrae_of_all_area_lights_converge_to_the_closed_form() {
    let (mut orders, mut variance, mut points) = (0.0, 0.0, 0);
    let cases = Case::all();
    for case in &cases {
        for (name, light) in &wide_lights() {
            let (view, exact) = receivers(&case.occluder, light, 600);
            assert_eq!(view.len(), 750, "{} under {name}: few points in the penumbra", case.name);
            let errors = COUNTS.map(|n| squares(&case.tracer, light, &view, &exact, n));
            let error = rms(errors[2].iter().copied());
            let (order, sigma) = order(&errors);
            println!(
                "{} under {name}: RMSE {error:.2e}, order {order:.3} +- {sigma:.3}",
                case.name
            );
            let what =
                format!("{} under {name}: RMSE {error}, order {order} +- {sigma}", case.name);
            assert!(error <= 2e-3, "{what}");
            assert!(order >= 0.70 && order + 3.0 * sigma >= 0.75, "{what}");
            if order < 0.9 {
                (orders, variance, points) = (orders + order, variance + sigma * sigma, points + 1);
            }

            // Controls: a light 2 cm aside and another occluder are no truth for these points.
            let moved = match *light {
                Light::Directional { direction, angular_diameter } => {
                    let direction = (direction + DVec3::X * 0.01).normalize();
                    Light::Directional { direction, angular_diameter }
                }
                _ => light.translated(DVec3::X * 0.02),
            };
            let wrong =
                rms(squares(&case.tracer, &moved, &view[..600], &exact[..600], 1024).into_iter());
            assert!(wrong > 2e-3, "{what}: not noticed that the light moved, {wrong}");
            let other = if case.name == "rectangle" { &cases[2] } else { &cases[1] };
            let wrong =
                rms(squares(&other.tracer, light, &view[..600], &exact[..600], 1024).into_iter());
            assert!(wrong > 2e-2, "{what}: not noticed that it is a {}, {wrong}", other.name);
        }
    }
    assert!(points >= 24, "only {points} pairs of the expected order");
    let count = f64::from(points);
    let (mean, sigma) = (orders / count, variance.sqrt() / count);
    println!("mean order {mean:.4} +- {sigma:.4}");
    assert!(mean + 2.0 * sigma >= 0.75, "mean order {mean} +- {sigma}");
}

/// Between the polygon and its circle lies a ring of width radius (1 - cos(pi / n)). From a point of
/// the floor it is seen enlarged, by the ratio of heights, on a level light. The part of a convex curve
/// within a disc is no longer than the disc's rim, 2 pi r; so the ring covers at most the share
/// 2 pi r width / (pi r^2) of the light.
#[test]
fn the_disc_of_the_scene_is_as_far_from_a_disc_as_its_segments_say() {
    let numbers = generate::DiscOverPlane::default();
    let polygon = &Case::all()[2].occluder;
    let disc = Occluder::Disc {
        center: DVec3::Y * numbers.height,
        normal: DVec3::Y,
        radius: numbers.radius,
    };
    let (_, light) = wide_lights()[2];
    let Light::Disc { center, radius, .. } = light else { unreachable!("the level disc") };
    let sagitta = numbers.radius * (1.0 - (PI / f64::from(numbers.segments)).cos());
    let bound = 2.0 * sagitta * center.y / numbers.height / radius;
    let (view, exact) = receivers(polygon, &light, 2400);
    let mut furthest = 0.0_f64;
    for (sample, v) in view.iter().zip(exact) {
        let less = v - visibility(&disc, &light, sample.position.as_dvec3());
        // Vertices are rounded to f32: 2^-24 of their coordinates, seen enlarged.
        assert!(less > -1e-6 && less < bound + 1e-6, "{less} beyond {bound} at {sample:?}");
        furthest = furthest.max(less);
    }
    println!("the polygon hides at most {furthest:.2e} less than the disc; bound {bound:.2e}");
    assert!(furthest > 0.1 * bound, "{furthest}: the polygon is no disc, and that shows");
}

/// What the centre of a light sees past an occluder. A polygon of many corners takes long: away from
/// its rim, by more than four times what it differs from its circle, the circle answers.
fn seen_by_hard(occluder: &Occluder, light: &Light) -> impl Fn(DVec3) -> f64 + Sync {
    let circle = match occluder {
        Occluder::ConvexPolygon(corners) if corners.len() > 16 => {
            let count = corners.len() as f64;
            let center = corners.iter().sum::<DVec3>() / count;
            let radius = center.distance(corners[0]);
            let normal = (corners[0] - center).cross(corners[1] - center);
            let difference = radius * (1.0 - (PI / count).cos());
            Some((Occluder::Disc { center, normal, radius }, 4.0 * difference))
        }
        _ => None,
    };
    let (occluder, light) = (occluder.clone(), *light);
    move |p| match &circle {
        Some((circle, near)) if !is_tie(circle, &light, p, *near) => visibility(circle, &light, p),
        _ => visibility(&occluder, &light, p),
    }
}

/// Disagreements outside the tie band, and ties, among `count` random samples of the floor.
fn hard(case: &Case, occluder: &Occluder, traced: &Light, light: &Light, count: u64) -> [usize; 2] {
    let band = TruthOptions::default().tie_distance * f64::from(case.tracer.radius());
    let view: Vec<ViewSample> =
        (0..count).into_par_iter().map(|i| on_floor(&mut (i << 20))).collect();
    let truth = case.tracer.truth(traced, &view, &TruthOptions::default());
    let exact = seen_by_hard(occluder, light);
    view.par_iter()
        .enumerate()
        .map(|(i, sample)| {
            let p = sample.position.as_dvec3();
            let counted = truth.class[i] == SampleClass::Counted;
            if counted && exact(p) != f64::from(truth.visibility[i]) {
                let tie = is_tie(occluder, light, p, band);
                [usize::from(!tie), usize::from(tie)]
            } else {
                // Ties that came out right are estimated from every sixteenth sample.
                let tie = counted && i % 16 == 0 && is_tie(occluder, light, p, band);
                [0, 16 * usize::from(tie)]
            }
        })
        .reduce(|| [0; 2], |a, b| [a[0] + b[0], a[1] + b[1]])
}

/// The tie band is that of the truth: 1e-5 of the scene's radius, 0.14 mm for all but the half-plane
/// (1.1 mm, for its 100 m).
#[test]
fn hard_shadows_agree_with_the_closed_form_but_for_ties() {
    let position = dvec3(0.3, 6.0, -0.2);
    let sun = |direction: DVec3| Light::Directional { direction, angular_diameter: 0.0 };
    let lights = [
        ("point", Light::Point { position }, Light::Point { position: position + DVec3::X * 0.05 }),
        ("sun above", sun(DVec3::NEG_Y), sun(dvec3(0.01, -1.0, 0.0).normalize())),
        (
            "sun aslant",
            sun(dvec3(0.4, -1.0, 0.2).normalize()),
            sun(dvec3(0.41, -1.0, 0.2).normalize()),
        ),
        (
            "spot",
            Light::Spot { position, direction: DVec3::NEG_Y, outer_angle: 0.6 },
            Light::Spot {
                position: position + DVec3::X * 0.05,
                direction: DVec3::NEG_Y,
                outer_angle: 0.6,
            },
        ),
    ];
    let cases = Case::all();
    for case in &cases {
        for (name, light, moved) in &lights {
            let what = format!("{} under {name}", case.name);
            let count = 1_000_000;
            let [wrong, ties] = hard(case, &case.occluder, light, light, count);
            println!("{what}: {wrong} disagreements, about {ties} ties in {count}");
            assert_eq!(wrong, 0, "{what}: disagreements outside the tie band");
            assert!(ties < count as usize / 1000, "{what}: {ties} ties");

            let band = TruthOptions::default().tie_distance * f64::from(case.tracer.radius());
            let shifted = case.shifted(10.0 * band);
            let [wrong, _] = hard(case, &shifted, light, light, 100_000);
            assert!(wrong > 0, "{what}: a shift by ten tie bands went unnoticed");
            let [wrong, _] = hard(case, &case.occluder, moved, light, 100_000);
            assert!(wrong > 0, "{what}: a moved light went unnoticed");
            let other = if case.name == "rectangle" { &cases[2] } else { &cases[1] };
            let [wrong, _] = hard(case, &other.occluder, light, light, 100_000);
            assert!(wrong > 0, "{what}: the occluder of {} went unnoticed", other.name);
        }
    }
}

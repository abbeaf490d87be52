//! Closed forms against sampling of the light, and their laws, on seeded random configurations.

use antumbra_reference::closed::{Occluder, is_tie, visibility, visibility_above_horizon};
use antumbra_scene::Light;
use glam::{DVec2, DVec3, dvec2, dvec3};

/// SplitMix64 (Steele, Lea and Flood 2014).
struct Random(u64);

impl Random {
    fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    fn direction(&mut self) -> DVec3 {
        let y = self.between(-1.0, 1.0);
        let a = self.between(0.0, std::f64::consts::TAU);
        dvec3(a.cos() * (1.0 - y * y).sqrt(), y, a.sin() * (1.0 - y * y).sqrt())
    }

    fn near(&mut self, center: DVec3, reach: f64) -> DVec3 {
        center + self.direction() * reach * self.unit().cbrt()
    }

    /// Area lights about (0, 6, 0) of any orientation, and wide suns.
    fn light(&mut self, kind: usize) -> Light {
        let center = self.near(DVec3::Y * 6.0, 1.5);
        let axis = self.direction();
        let (axis_u, axis_v) = axis.any_orthonormal_pair();
        let radius = self.between(0.3, 2.0);
        match kind {
            0 => Light::Rect {
                center,
                half_u: axis_u * radius,
                half_v: axis_v * self.between(0.1, 2.0),
            },
            1 => Light::Disc { center, radius, axis_u, axis_v },
            2 => Light::Sphere { center, radius },
            _ => Light::Directional {
                direction: -self.near(DVec3::Y, 0.6).normalize(),
                angular_diameter: self.between(0.05, 1.5),
            },
        }
    }

    /// Occluders about the way from the floor to the light, of any orientation.
    fn occluder(&mut self, kind: usize) -> Occluder {
        let center = self.near(DVec3::Y * 3.0, 2.5);
        let normal = self.direction();
        let (u, v) = normal.any_orthonormal_pair();
        let radius = self.between(0.2, 1.5);
        let along = |a: f64| u * a.cos() + v * a.sin();
        let turn = self.between(0.0, 6.0);
        match kind {
            0 => Occluder::HalfPlane { point: center, normal: normal * 2.0, inward: along(turn) },
            1 => Occluder::rectangle(
                center,
                along(turn) * radius,
                along(turn + std::f64::consts::FRAC_PI_2) * 0.7,
            ),
            2 => {
                // Corners on a circle at ascending angles: convex.
                let n = 3 + (self.unit() * 6.0) as usize;
                let mut angles: Vec<f64> =
                    (0..n).map(|_| self.between(0.0, std::f64::consts::TAU)).collect();
                angles.sort_by(f64::total_cmp);
                Occluder::ConvexPolygon(
                    angles.iter().map(|&a| center + along(a) * radius).collect(),
                )
            }
            _ => Occluder::Disc { center, normal: normal * 0.5, radius },
        }
    }
}

/// Whether the ray from `p` along `d` (to its end for a light at a finite distance) meets the
/// occluder: intersect with the plane, then look whether the point is inside.
fn blocks(occluder: &Occluder, p: DVec3, d: DVec3, finite: bool) -> bool {
    let (origin, normal) = match occluder {
        Occluder::HalfPlane { point, normal, .. } => (*point, *normal),
        Occluder::Disc { center, normal, .. } => (*center, *normal),
        Occluder::ConvexPolygon(c) => (c[0], (c[1] - c[0]).cross(c[2] - c[0])),
    };
    let t = normal.dot(origin - p) / normal.dot(d);
    if !(t > 0.0 && (!finite || t < 1.0)) {
        return false;
    }
    let hit = p + d * t;
    match occluder {
        Occluder::HalfPlane { point, inward, .. } => inward.dot(hit - *point) >= 0.0,
        Occluder::Disc { center, radius, .. } => hit.distance(*center) <= *radius,
        Occluder::ConvexPolygon(c) => {
            let side = |i: usize| normal.dot((c[(i + 1) % c.len()] - c[i]).cross(hit - c[i]));
            (0..c.len()).all(|i| side(i) >= 0.0) || (0..c.len()).all(|i| side(i) <= 0.0)
        }
    }
}

const GRID: usize = 512;

/// Mean over a jittered grid of light samples.
fn sampled(
    occluder: &Occluder,
    light: &Light,
    p: DVec3,
    normal: DVec3,
    random: &mut Random,
) -> f64 {
    let finite = light.position().is_some();
    let mut seen = 0_u32;
    for i in 0..GRID {
        for j in 0..GRID {
            let jitter = dvec2(random.unit(), random.unit());
            let sample: DVec2 = (dvec2(i as f64, j as f64) + jitter) / GRID as f64;
            let d = light.towards(p, sample);
            seen += u32::from(normal.dot(d) >= 0.0 && !blocks(occluder, p, d, finite));
        }
    }
    f64::from(seen) / (GRID * GRID) as f64
}

/// What a jittered grid of n² samples keeps within, but for one case in 1e9.
///
/// Only cells that the boundary of the visible part crosses have any spread. The boundary consists of
/// at most three convex curves (occluder, its plane, the horizon); each crosses at most 4 n cells of
/// the unit square, at most four times as many after the map to a disc, whose four wedges each may
/// cut it anew. With K = 48 n cells of one sample in {0, 1} each, Hoeffding (1963) bounds the
/// probability of an error of the mean beyond t by 2 exp(-2 t² n⁴ / K).
fn sampling_bound() -> f64 {
    let n = GRID as f64;
    (48.0 * n * 0.5 * (2e9_f64).ln()).sqrt() / (n * n)
}

#[test]
fn every_pair_of_occluder_and_light_agrees_with_sampling() {
    let mut random = Random(1);
    let (mut worst, mut sum, mut controls, mut seen) = (0.0_f64, 0.0, 0, 0);
    for kind in 0..16 {
        let (mut tried, mut partly) = (0, 0);
        while partly < 6 && tried < 2000 {
            tried += 1;
            let (light, occluder) = (random.light(kind / 4), random.occluder(kind % 4));
            let p = dvec3(random.between(-2.0, 2.0), 0.0, random.between(-2.0, 2.0));
            let normal = DVec3::Y + random.direction() * 0.9;
            let v = visibility_above_horizon(&occluder, &light, p, normal);
            assert!((0.0..=1.0).contains(&v), "{v} is no visibility");
            if v == 0.0 || v == 1.0 {
                continue;
            }
            partly += 1;
            let s = sampled(&occluder, &light, p, normal, &mut random);
            let error = (v - s).abs();
            assert!(
                error < sampling_bound(),
                "closed {v}, sampled {s}: {occluder:?} {light:?} {p} {normal}"
            );
            (worst, sum) = (worst.max(error), sum + error);
            // Control: the comparison tells another occluder apart.
            let other = random.occluder((kind + 1) % 4);
            let w = visibility_above_horizon(&other, &light, p, normal);
            controls += i32::from((w - s).abs() > sampling_bound());
            seen += 1;
        }
        assert_eq!(partly, 6, "pair {kind} is hardly ever in the penumbra");
    }
    assert!(controls > seen / 2, "only {controls} of {seen} wrong occluders were noticed");
    // The bound is far from tight: the mean error of a jittered grid is about n^-1.5 = 8.6e-5.
    let mean = sum / f64::from(seen);
    assert!(mean < 1.0e-4, "mean difference {mean}, largest {worst}");
}

#[test]
fn fully_seen_and_hidden_lights_are_exactly_so() {
    let mut random = Random(2);
    let mut found = [0; 2];
    for i in 0..4000 {
        let (light, occluder) = (random.light(i % 4), random.occluder(i / 4 % 4));
        let p = dvec3(random.between(-2.0, 2.0), 0.0, random.between(-2.0, 2.0));
        let v = visibility(&occluder, &light, p);
        let sees =
            |s: DVec2| !blocks(&occluder, p, light.towards(p, s), light.position().is_some());
        let samples: Vec<bool> = (0..64)
            .map(|k| sees(dvec2((f64::from(k % 8) + 0.5) / 8.0, (f64::from(k / 8) + 0.5) / 8.0)))
            .collect();
        if v == 0.0 {
            found[0] += 1;
            assert!(samples.iter().all(|s| !s), "hidden, yet seen: {occluder:?} {light:?} {p}");
        } else if v == 1.0 {
            found[1] += 1;
            assert!(samples.iter().all(|&s| s), "seen, yet hidden: {occluder:?} {light:?} {p}");
        }
    }
    assert!(found.iter().all(|&n| n > 100), "both occur: {found:?}");
}

#[test]
fn a_growing_occluder_never_lets_more_through() {
    let mut random = Random(3);
    let mut strictly = 0;
    for i in 0..4000 {
        let light = random.light(i % 4);
        let p = dvec3(random.between(-2.0, 2.0), 0.0, random.between(-2.0, 2.0));
        let small = random.occluder(1 + i / 4 % 3);
        let large = match &small {
            Occluder::Disc { center, normal, radius } => {
                Occluder::Disc { center: *center, normal: *normal, radius: radius * 1.3 }
            }
            Occluder::ConvexPolygon(c) => {
                let o = c.iter().sum::<DVec3>() / c.len() as f64;
                Occluder::ConvexPolygon(c.iter().map(|&x| o + (x - o) * 1.3).collect())
            }
            half @ Occluder::HalfPlane { .. } => half.clone(),
        };
        let (v, w) = (visibility(&small, &light, p), visibility(&large, &light, p));
        assert!(w <= v + 1e-12, "{v} grows to {w}: {small:?} {light:?} {p}");
        strictly += i32::from(w < v);
    }
    assert!(strictly > 400, "only {strictly} cases changed at all");
}

#[test]
fn the_parts_of_an_occluder_hide_together_what_the_whole_hides() {
    let mut random = Random(4);
    let mut partly = 0;
    for i in 0..4000 {
        let light = random.light(i % 4);
        let p = dvec3(random.between(-2.0, 2.0), 0.0, random.between(-2.0, 2.0));
        let whole = random.occluder(2);
        let Occluder::ConvexPolygon(c) = &whole else { panic!("kind 2 is a polygon") };
        // A fan, each part's corners listed the other way round.
        let hidden = |o: &Occluder| 1.0 - visibility(o, &light, p);
        let parts: f64 = (1..c.len() - 1)
            .map(|k| hidden(&Occluder::ConvexPolygon(vec![c[k + 1], c[k], c[0]])))
            .sum();
        assert!((parts - hidden(&whole)).abs() < 1e-11, "{parts} {whole:?} {light:?} {p}");
        partly += i32::from(parts > 0.0 && parts < 1.0);
    }
    assert!(partly > 400, "only {partly} cases in the penumbra");
}

#[test]
fn a_half_plane_and_its_complement_hide_the_light_once() {
    let mut random = Random(5);
    for i in 0..2000 {
        let light = random.light(i % 3);
        let p = dvec3(random.between(-2.0, 2.0), 0.0, random.between(-2.0, 2.0));
        let Occluder::HalfPlane { point, normal, inward } = random.occluder(0) else {
            panic!("kind 0 is a half-plane")
        };
        let hidden = |inward: DVec3, point: DVec3| {
            1.0 - visibility(&Occluder::HalfPlane { point, normal, inward }, &light, p)
        };
        // The whole plane: its edge moved beyond the reach of any segment.
        let both = hidden(inward, point) + hidden(-inward, point);
        let whole = hidden(inward, point - inward * 1e3);
        assert!((both - whole).abs() < 1e-11, "{both} {whole} {light:?} {p}");
    }
}

#[test]
fn hard_lights_agree_with_their_rays_outside_the_tie_band() {
    let mut random = Random(6);
    let (mut ties, mut dark) = (0, 0);
    for i in 0..40_000 {
        let light = if i % 2 == 0 {
            Light::Point { position: random.near(DVec3::Y * 6.0, 1.5) }
        } else {
            Light::Directional { direction: random.direction(), angular_diameter: 0.0 }
        };
        let occluder = random.occluder(i / 2 % 4);
        let p = random.near(DVec3::Y, 2.0);
        let d = light.towards(p, DVec2::splat(0.5));
        let v = visibility(&occluder, &light, p);
        assert!(v == 0.0 || v == 1.0, "{v} between hidden and seen");
        if is_tie(&occluder, &light, p, 1e-9) {
            ties += 1;
            continue;
        }
        let blocked = blocks(&occluder, p, d, light.position().is_some());
        assert_eq!(v == 0.0, blocked, "{occluder:?} {light:?} {p}");
        dark += i32::from(blocked);
        // The tie band is what it says: a smaller movement changes nothing.
        let q = p + random.direction() * 1e-4;
        if !is_tie(&occluder, &light, p, 1.01e-4) {
            assert_eq!(visibility(&occluder, &light, q), v, "{occluder:?} {light:?} {p} {q}");
        }
    }
    assert!(ties < 5, "{ties} ties at random");
    assert!(dark > 1000, "only {dark} in shadow");
}

/// Occluders of sizes and distances over eight orders of magnitude, and lights likewise.
fn adversarial(random: &mut Random, kind: usize) -> (Occluder, Light, DVec3) {
    let occluder = random.occluder(kind % 4);
    let light = random.light(kind / 4 % 4);
    let p = random.near(DVec3::ZERO, 3.0);
    let scale = 10_f64.powf(random.between(-4.0, 4.0));
    let size = 10_f64.powf(random.between(-4.0, 4.0));
    let place = |x: DVec3| p + (x - p) * scale;
    let occluder = match occluder {
        Occluder::HalfPlane { point, normal, inward } => {
            Occluder::HalfPlane { point: place(point), normal, inward }
        }
        Occluder::ConvexPolygon(c) => {
            let grown = c.iter().map(|&x| c[0] + (x - c[0]) * size);
            Occluder::ConvexPolygon(grown.map(place).collect())
        }
        Occluder::Disc { center, normal, radius } => {
            Occluder::Disc { center: place(center), normal, radius: radius * size * scale }
        }
    };
    (occluder, light, p)
}

#[test]
fn the_two_sides_of_any_horizon_make_up_the_whole() {
    let mut random = Random(7);
    let (mut partly, mut worst) = (0, 0.0_f64);
    for i in 0..40_000 {
        let (occluder, light, p) = adversarial(&mut random, i);
        let normal = light.towards(p, DVec2::splat(0.5)).cross(random.direction());
        let side = |n: DVec3| visibility_above_horizon(&occluder, &light, p, n);
        let (whole, halves) = (visibility(&occluder, &light, p), side(normal) + side(-normal));
        let error = (whole - halves).abs();
        assert!(error < 4e-12, "{whole} {halves}: {occluder:?} {light:?} {p} {normal}");
        worst = worst.max(error);
        partly += i32::from(whole > 0.0 && whole < 1.0);
    }
    assert!(partly > 5000, "only {partly} cases in the penumbra, largest difference {worst}");
}

#[test]
fn a_light_is_the_mean_of_its_quarters() {
    let mut random = Random(8);
    let mut partly = 0;
    for i in 0..20_000 {
        let (occluder, light, p) = adversarial(&mut random, i % 4);
        let Light::Rect { center, half_u, half_v } = light else { panic!("kind 0 is a rectangle") };
        let quarter = |s: f64, t: f64| {
            let (half_u, half_v) = (half_u * 0.5, half_v * 0.5);
            let center = center + half_u * s + half_v * t;
            visibility(&occluder, &Light::Rect { center, half_u, half_v }, p)
        };
        let mean = 0.25
            * (quarter(1.0, 1.0) + quarter(1.0, -1.0) + quarter(-1.0, 1.0) + quarter(-1.0, -1.0));
        let whole = visibility(&occluder, &light, p);
        assert!((whole - mean).abs() < 4e-12, "{whole} {mean}: {occluder:?} {light:?} {p}");
        partly += i32::from(whole > 0.0 && whole < 1.0);
    }
    assert!(partly > 2000, "only {partly} cases in the penumbra");
}

#[test]
fn powers_of_two_scale_a_scene_without_a_trace() {
    let mut random = Random(9);
    for i in 0..4000 {
        let (occluder, p) = (random.occluder(1 + 2 * (i % 2)), random.near(DVec3::ZERO, 2.0));
        let (light, k) = (random.light(i / 2 % 3), 1024.0);
        let large_light = match light {
            Light::Rect { center, half_u, half_v } => {
                Light::Rect { center: center * k, half_u: half_u * k, half_v: half_v * k }
            }
            Light::Disc { center, radius, axis_u, axis_v } => {
                Light::Disc { center: center * k, radius: radius * k, axis_u, axis_v }
            }
            Light::Sphere { center, radius } => {
                Light::Sphere { center: center * k, radius: radius * k }
            }
            other => other,
        };
        let large = match &occluder {
            Occluder::ConvexPolygon(c) => {
                Occluder::ConvexPolygon(c.iter().map(|&x| x * k).collect())
            }
            Occluder::Disc { center, normal, radius } => {
                Occluder::Disc { center: *center * k, normal: *normal, radius: radius * k }
            }
            half @ Occluder::HalfPlane { .. } => half.clone(),
        };
        let (v, w) = (visibility(&occluder, &light, p), visibility(&large, &large_light, p * k));
        assert_eq!(v, w, "{occluder:?} {light:?} {p}");
    }
}

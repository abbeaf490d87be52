//! Triangles with holes: against closed forms, against every triangle by itself, and against whole ones.

use std::sync::Arc;

use antumbra_reference::closed::{Occluder, is_tie, visibility};
use antumbra_reference::{
    Instructions, Ray, SampleClass, TraceError, Tracer, TruthOptions, ViewSample,
};
use antumbra_scene::generate::{LeafCard, leaf_card};
use antumbra_scene::{AlphaMap, CutInstance, Cutout, Triangles, Wrap};
use glam::{DVec3, Vec2, Vec3};

/// SplitMix64 (Steele, Lea and Flood 2014), as a number in [0, 1).
fn unit(state: &mut u64) -> f32 {
    *state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let x = (*state ^ (*state >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((x ^ (x >> 31)) >> 40) as f32 / (1 << 24) as f32
}

fn vector(state: &mut u64) -> Vec3 {
    Vec3::from_array(std::array::from_fn(|_| 2.0 * unit(state) - 1.0))
}

#[test]
fn a_card_hides_what_the_disc_on_it_hides() {
    let numbers = LeafCard::default();
    let scene = leaf_card(&numbers);
    let mut whole = scene.clone();
    whole.cutouts.clear();
    let [scene_list, whole_list] =
        [&scene, &whole].map(|s| s.triangles(DVec3::ZERO).expect("a valid scene"));
    let [tracer, control] = [&scene_list, &whole_list].map(|t| Tracer::new(t).expect("valid"));
    let disc = Occluder::Disc {
        center: numbers.height * DVec3::Y,
        normal: DVec3::Y,
        radius: numbers.radius * numbers.half,
    };
    let place =
        |i: u32, j: u32| Vec3::new(i as f32, 0.0, j as f32) * 0.03 - Vec3::new(4.0, 0.0, 3.0);
    let samples: Vec<ViewSample> = (0..200)
        .flat_map(|i| (0..200).map(move |j| place(i, j)))
        .map(|position| ViewSample { position, normal: Vec3::Y })
        .collect();
    // The rays start 1e-5 of the scene's size above the floor, which moves a shadow by as much.
    let tolerance = numbers.accuracy() + 1e-4;
    for light in &scene.lights {
        let wrong = |tracer: &Tracer| {
            let truth = tracer.truth(light, &samples, &TruthOptions::default());
            let mut dark = 0;
            let wrong =
                samples.iter().zip(truth.visibility).zip(truth.class).filter(|((s, v), class)| {
                    let p = s.position.as_dvec3();
                    let known = visibility(&disc, light, p);
                    dark += u32::from(known == 0.0);
                    *class == SampleClass::Counted
                        && !is_tie(&disc, light, p, tolerance)
                        && f64::from(*v) != known
                });
            (wrong.count(), dark)
        };
        let (errors, dark) = wrong(&tracer);
        assert_eq!(errors, 0, "{light:?}");
        assert!(dark > 1000, "{light:?}: {dark} samples in shadow");
        assert!(wrong(&control).0 > 300, "{light:?}: the corners of a whole card are not missed");
    }
}

/// Random triangles in eight instances, every other of them cut out by a random texture.
fn soup(state: &mut u64, alpha: &AlphaMap) -> Triangles {
    let mut list = Triangles::default();
    for instance in 0..8 {
        let first = list.triangles.len();
        let first_vertex = list.positions.len() as u32;
        for _ in 0..60 {
            let (center, n) = (3.0 * vector(state), list.positions.len() as u32);
            list.positions.extend((0..3).map(|_| center + vector(state)));
            list.triangles.push([n, n + 1, n + 2]);
        }
        list.instances.push(first..list.triangles.len());
        if instance % 2 == 1 {
            let uv = (0..180).map(|_| Vec2::new(unit(state), unit(state)) * 3.0 - 1.0).collect();
            let cutout = Cutout { uv, alpha: Arc::new(alpha.clone()), cutoff: 127.5 };
            let cutout = Arc::new(cutout);
            list.cuts.push(CutInstance { instance, first_vertex, cutout });
        }
    }
    list
}

fn rays(state: &mut u64, count: usize) -> Vec<Ray> {
    (0..count)
        .map(|_| Ray { origin: 4.0 * vector(state), direction: vector(state), t_max: 6.0 })
        .collect()
}

/// What a ray meets first, by trying every triangle in `f64`; `None` where rounding may decide.
fn by_hand(list: &Triangles, ray: &Ray) -> Option<Option<usize>> {
    let (o, d) = (ray.origin.as_dvec3(), ray.direction.as_dvec3());
    let mut first = (f64::from(ray.t_max), None);
    for (triangle, corners) in list.triangles.iter().enumerate() {
        let [a, b, c] = corners.map(|i| list.positions[i as usize].as_dvec3());
        let n = (b - a).cross(c - a);
        let t = n.dot(a - o) / n.dot(d);
        let p = o + d * t;
        let weights = [(b, c), (c, a), (a, b)].map(|(s, e)| n.dot((e - s).cross(p - s)) / n.dot(n));
        let least = weights.into_iter().fold(f64::INFINITY, f64::min);
        if t <= -1e-4 || t >= first.0 + 1e-4 || least < -1e-4 {
            continue;
        }
        if least < 1e-4 || t.abs() < 1e-4 || (t - first.0).abs() < 1e-4 {
            return None;
        }
        let cut = list.cuts.iter().find(|cut| list.instances[cut.instance].contains(&triangle));
        if let Some(CutInstance { first_vertex, cutout, .. }) = cut {
            let uv = corners.map(|i| cutout.uv[(i - first_vertex) as usize]);
            let at: Vec2 = uv.iter().zip(weights).map(|(uv, w)| *uv * w as f32).sum();
            // A texel of at most 255 lies 1/8 from the next: 1e-3 of alpha more than covers the rounding.
            let off = cutout.alpha.at(at) - cutout.cutoff;
            if off.abs() < 0.5 {
                return None;
            }
            if off < 0.0 {
                continue;
            }
        }
        first = (t, Some(triangle));
    }
    Some(first.1)
}

#[test]
fn holes_are_seen_through_and_nothing_else_is() {
    let mut state = 5;
    let texels = (0..64).map(|_| (255.0 * unit(&mut state)) as u8).collect();
    let alpha = AlphaMap {
        width: 8,
        height: 8,
        texels,
        wrap: [Wrap::Mirror, Wrap::Repeat],
        nearest: false,
    };
    let list = soup(&mut state, &alpha);
    let tracer = Tracer::new(&list).expect("valid triangles");
    let mut whole = list.clone();
    whole.cuts.clear();
    let control = Tracer::new(&whole).expect("valid triangles");
    let rays = rays(&mut state, 4000);
    let all = tracer.occluded_all(&rays);
    let (mut judged, mut through) = (0, 0);
    for (ray, blocked) in rays.iter().zip(all) {
        assert_eq!(blocked, tracer.occluded(ray.origin, ray.direction, ray.t_max), "{ray:?} alone");
        for level in [Instructions::Portable, Instructions::Avx2] {
            let other = tracer.clone().at_most(level);
            assert_eq!(blocked, other.occluded(ray.origin, ray.direction, ray.t_max), "{level:?}");
        }
        let hit = tracer.closest(ray).map(|hit| hit.triangle as usize);
        assert_eq!(blocked, hit.is_some(), "{ray:?}: any and closest");
        if let Some(known) = by_hand(&list, ray) {
            judged += 1;
            assert_eq!(hit, known, "{ray:?}");
        }
        through += u32::from(!blocked && control.occluded(ray.origin, ray.direction, ray.t_max));
    }
    assert!(judged > 3000, "{judged} rays judged");
    assert!(through > 200, "{through} rays pass through holes");
}

#[test]
fn a_cut_out_without_a_hole_is_whole() {
    let mut state = 9;
    let full = AlphaMap { width: 1, height: 1, texels: vec![255], ..AlphaMap::default() };
    let list = soup(&mut state, &full);
    let mut whole = list.clone();
    whole.cuts.clear();
    let [cut, whole] = [&list, &whole].map(|list| Tracer::new(list).expect("valid triangles"));
    let rays = rays(&mut state, 4000);
    assert_eq!(cut.occluded_all(&rays), whole.occluded_all(&rays), "any");
    for ray in &rays {
        assert_eq!(cut.closest(ray), whole.closest(ray), "{ray:?}");
    }
}

#[test]
fn a_cut_out_without_its_data_is_refused() {
    let mut state = 1;
    let full = AlphaMap { width: 1, height: 1, texels: vec![255], ..AlphaMap::default() };
    let sound = soup(&mut state, &full);
    let broken: [fn(&mut CutInstance); 4] = [
        |cut| cut.instance = 99,
        |cut| cut.first_vertex += 1,
        |cut| Arc::make_mut(&mut cut.cutout).uv.truncate(3),
        |cut| Arc::make_mut(&mut cut.cutout).alpha = Arc::default(),
    ];
    for (number, damage) in broken.into_iter().enumerate() {
        let mut list = sound.clone();
        damage(&mut list.cuts[0]);
        let fault = Tracer::new(&list).expect_err("a fault");
        assert!(matches!(fault, TraceError::Cutout { .. }), "{number}: {fault}");
    }
}

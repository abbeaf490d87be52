//! What translucent triangles let through: against products over every triangle by itself, and closed forms.

use std::sync::Arc;

use antumbra_reference::{Ray, SampleClass, TraceError, Tracer, TruthOptions, ViewSample};
use antumbra_scene::generate::{self, shapes};
use antumbra_scene::{AlphaMap, Light, Opacity, Scene, TranslucentInstance, Triangles, Wrap};
use glam::{DAffine3, DVec3, Vec2, Vec3};

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

/// Random triangles in eight instances, every other of them translucent by a random texture.
fn soup(state: &mut u64) -> Triangles {
    let texels = (0..64).map(|_| (255.0 * unit(state)) as u8).collect();
    let alpha =
        Arc::new(AlphaMap { width: 8, height: 8, texels, wrap: [Wrap::Mirror; 2], nearest: false });
    let mut list = Triangles::default();
    for instance in 0..8 {
        let (first, first_vertex) = (list.triangles.len(), list.positions.len() as u32);
        for _ in 0..if instance % 2 == 1 { 60 } else { 4 } {
            let (center, n) = (3.0 * vector(state), list.positions.len() as u32);
            list.positions.extend((0..3).map(|_| center + vector(state)));
            list.triangles.push([n, n + 1, n + 2]);
        }
        list.instances.push(first..list.triangles.len());
        if instance % 2 == 1 {
            let uv = (0..180).map(|_| Vec2::new(unit(state), unit(state)) * 3.0 - 1.0).collect();
            let opacity = Arc::new(Opacity { uv, alpha: alpha.clone(), factor: 0.8 });
            list.translucent.push(TranslucentInstance { instance, first_vertex, opacity });
        }
    }
    list
}

/// What gets along a ray, by trying every triangle in `f64`, and how many let some of it through; `None` where rounding
/// may decide.
fn by_hand(list: &Triangles, ray: &Ray) -> Option<(f64, u32)> {
    let (o, d) = (ray.origin.as_dvec3(), ray.direction.as_dvec3());
    let (mut share, mut sheets) = (1.0, 0);
    for (triangle, corners) in list.triangles.iter().enumerate() {
        let [a, b, c] = corners.map(|i| list.positions[i as usize].as_dvec3());
        let n = (b - a).cross(c - a);
        let t = n.dot(a - o) / n.dot(d);
        let p = o + d * t;
        let weights = [(b, c), (c, a), (a, b)].map(|(s, e)| n.dot((e - s).cross(p - s)) / n.dot(n));
        let least = weights.into_iter().fold(f64::INFINITY, f64::min);
        if t <= -1e-4 || t >= f64::from(ray.t_max) + 1e-4 || least < -1e-4 {
            continue;
        }
        if least < 1e-4 || t.abs() < 1e-4 || (t - f64::from(ray.t_max)).abs() < 1e-4 {
            return None;
        }
        let sheet =
            list.translucent.iter().find(|s| list.instances[s.instance].contains(&triangle));
        let Some(TranslucentInstance { first_vertex, opacity, .. }) = sheet else {
            return Some((0.0, sheets));
        };
        let uv = corners.map(|i| opacity.uv[(i - first_vertex) as usize]);
        let at: Vec2 = uv.iter().zip(weights).map(|(uv, w)| *uv * w as f32).sum();
        share *= 1.0 - f64::from(opacity.at(at));
        sheets += 1;
    }
    Some((share, sheets))
}

#[test]
fn rays_through_a_soup_keep_the_product_of_what_all_sheets_let_through() {
    let mut state = 1;
    let list = soup(&mut state);
    let tracer = Tracer::new(&list).expect("valid");
    let (mut several, mut dark, mut free) = (0, 0, 0);
    for _ in 0..20_000 {
        let ray =
            Ray { origin: 4.0 * vector(&mut state), direction: vector(&mut state), t_max: 6.0 };
        let Some((share, sheets)) = by_hand(&list, &ray) else { continue };
        let found = tracer.transmittance(&ray);
        // Texture coordinates are rounded to 2^-24 of up to 2, 2^-20 of a texel, whose alpha is at most 1 from the next.
        assert!(
            (found - share).abs() < 1e-5 * f64::from(sheets + 1),
            "{ray:?}: {found}, not {share}"
        );
        dark += u32::from(share == 0.0);
        free += u32::from(sheets == 0 && share == 1.0);
        several += u32::from(sheets > 1 && share > 0.0);
    }
    assert!(
        several > 500 && dark > 500 && free > 500,
        "{several} through, {dark} dark, {free} free"
    );
}

/// A pane of the given opacity, 1 m over the middle of a floor.
fn pane(opacity: f32) -> Scene {
    let mut scene = Scene::default();
    scene.add(shapes::floor(5.0), DAffine3::IDENTITY);
    let pane = shapes::quad(DVec3::Y, DVec3::X, DVec3::Z);
    scene.opacities.insert(1, Arc::new(Opacity::uniform(opacity, pane.positions.len())));
    scene.add(pane, DAffine3::IDENTITY);
    scene
}

#[test]
fn opacity_0_is_no_caster_and_opacity_1_an_opaque_one_under_every_light() {
    let samples: Vec<ViewSample> = (0..40)
        .flat_map(|i| (0..40).map(move |j| Vec3::new(i as f32 - 19.7, 0.0, j as f32 - 19.6) * 0.11))
        .map(|position| ViewSample { position, normal: Vec3::Y })
        .collect();
    let truth = |scene: &Scene, light: &Light| {
        let tracer = Tracer::new(&scene.triangles(DVec3::ZERO).expect("valid")).expect("valid");
        tracer.truth(light, &samples, &TruthOptions { light_samples: 64, ..Default::default() })
    };
    let without = generate::grazing_plane(0.0);
    let mut opaque = pane(1.0);
    opaque.opacities.clear();
    for light in [
        Light::Directional { direction: DVec3::new(0.2, -1.0, 0.1), angular_diameter: 0.0 },
        Light::Point { position: DVec3::new(0.4, 3.0, 0.3) },
        Light::Sphere { center: DVec3::new(0.4, 3.0, 0.3), radius: 0.4 },
    ] {
        let whole = truth(&opaque, &light).visibility;
        assert_eq!(truth(&pane(1.0), &light).visibility, whole, "{light:?}: all is kept");
        let lit = truth(&without, &light).visibility;
        assert_eq!(truth(&pane(0.0), &light).visibility, lit, "{light:?}: nothing is kept");
        for (half, whole) in truth(&pane(0.5), &light).visibility.iter().zip(whole) {
            assert_eq!(*half, 0.5 + 0.5 * whole, "{light:?}: a half is kept");
        }
    }
}

#[test]
fn a_pane_has_ties_at_its_edge_where_enough_is_kept() {
    let light = Light::Directional { direction: DVec3::NEG_Y, angular_diameter: 0.0 };
    let sample = |x: f32| ViewSample { position: Vec3::new(x, 0.0, 0.1), normal: Vec3::Y };
    let classes = |opacity| {
        let tracer = Tracer::new(&pane(opacity).triangles(DVec3::ZERO).expect("valid"));
        let options = TruthOptions { ties: true, tie_distance: 1e-3, ..Default::default() };
        tracer.expect("valid").truth(&light, &[sample(0.5), sample(1.001)], &options).class
    };
    assert_eq!(classes(0.5), [SampleClass::Counted, SampleClass::Tie], "at the edge of a half");
    assert_eq!(classes(0.005), [SampleClass::Counted; 2], "at that of nearly nothing");
}

#[test]
fn opacities_without_their_data_are_refused() {
    let list = pane(0.5).triangles(DVec3::ZERO).expect("valid");
    let with = |opacity: Opacity| {
        let mut list = list.clone();
        list.translucent[0].opacity = Arc::new(opacity);
        Tracer::new(&list).map(|_| ()).expect_err("a fault")
    };
    let short = with(Opacity::uniform(0.5, 3));
    assert!(matches!(short, TraceError::Opacity { triangle: 2 | 3 }), "{short:?}");
    let empty = with(Opacity { alpha: Arc::default(), ..Opacity::uniform(0.5, 4) });
    assert_eq!(empty, TraceError::Opacity { triangle: 0 }, "without a texture");
}

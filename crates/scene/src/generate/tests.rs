use std::collections::{HashMap, HashSet};
use std::hash::{DefaultHasher, Hash, Hasher};

use glam::{DVec2, DVec3};

use super::*;
use crate::{Bounds, Light, LightKind, Mesh};

/// Meshes of the generated scenes that are sheets by intent; all others must be closed.
const SHEETS: [&str; 17] = [
    "pane",
    "dark pane",
    "window",
    "card",
    "floor",
    "ground",
    "half-plane",
    "rectangle",
    "disc",
    "leaves",
    "grass",
    "hair",
    "terrain",
    "pages",
    "triangle",
    "quad",
    "moebius",
];

fn entries() -> impl Iterator<Item = &'static Entry> {
    ALL.iter().chain(CONVEX).chain(CUT_OUT).chain(TRANSLUCENT)
}

/// Whether every edge is shared by exactly two triangles, in opposite directions.
fn is_closed(mesh: &Mesh) -> bool {
    let mut edges = HashMap::new();
    for t in &mesh.triangles {
        for i in 0..3 {
            *edges.entry((t[i], t[(i + 1) % 3])).or_insert(0) += 1;
        }
    }
    edges.iter().all(|(&(a, b), &count)| count == 1 && edges.contains_key(&(b, a)))
}

fn corners(mesh: &Mesh) -> impl Iterator<Item = [DVec3; 3]> {
    mesh.triangles.iter().map(|t| t.map(|i| mesh.positions[i as usize].as_dvec3()))
}

/// By the divergence theorem; positive when triangles turn counter-clockwise seen from outside.
fn volume(mesh: &Mesh) -> f64 {
    corners(mesh).map(|[a, b, c]| a.dot(b.cross(c)) / 6.0).sum()
}

struct World(Vec<[DVec3; 3]>);

impl World {
    fn of(scene: &Scene) -> Self {
        let all = scene.triangles(DVec3::ZERO).expect("generated scenes are valid");
        let corner = |i: u32| all.positions[i as usize].as_dvec3();
        Self(all.triangles.iter().map(|t| t.map(corner)).collect())
    }

    /// Distance to the first triangle along a ray (Moeller and Trumbore 1997).
    fn hit(&self, from: DVec3, direction: DVec3) -> Option<f64> {
        let mut nearest: Option<f64> = None;
        for &[a, b, c] in &self.0 {
            let (e1, e2) = (b - a, c - a);
            let p = direction.cross(e2);
            let det = e1.dot(p);
            if det == 0.0 {
                continue;
            }
            let s = from - a;
            let u = s.dot(p) / det;
            let q = s.cross(e1);
            let v = direction.dot(q) / det;
            let t = e2.dot(q) / det;
            if u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t > 0.0 {
                nearest = Some(nearest.map_or(t, |n| n.min(t)));
            }
        }
        nearest
    }

    fn sees_light(&self, p: DVec3, light: &Light) -> bool {
        let to_light = light.towards(p, DVec2::splat(0.5));
        let end = if light.kind() == LightKind::Directional { f64::INFINITY } else { 1.0 };
        self.hit(p + 1e-6 * to_light, to_light).is_none_or(|t| t >= end)
    }
}

#[test]
fn scenes_are_registered_under_their_own_names() {
    let mut seen = HashSet::new();
    for (name, make, what) in entries() {
        assert!(seen.insert(*name), "{name} is registered twice");
        assert_eq!(make().name, *name, "the registry and the scene disagree");
        assert!(!what.is_empty(), "{name} does not say what it tests");
        assert!(by_name(name).is_some(), "{name} is not found by its name");
    }
    assert!(by_name("no such scene").is_none(), "an unknown name must give nothing");
}

#[test]
fn scenes_have_a_camera_a_sun_from_above_and_a_sensible_size() {
    for (name, make, _) in entries() {
        let scene = make();
        assert!(scene.camera.is_some(), "{name} has no camera");
        let Light::Directional { direction, .. } = scene.light_or_placed(LightKind::Directional)
        else {
            panic!("{name}: asked for a directional light");
        };
        assert!(scene.lights.iter().any(|l| l.kind() == LightKind::Directional), "{name}: no sun");
        assert!(direction.y < 0.0, "{name} is lit from below");
        assert!((direction.length() - 1.0).abs() < 1e-12, "{name}: direction is no unit vector");
        let count = scene.triangle_count();
        let expected = match *name {
            "tree" | "grass" | "hair" | "terrain" => 10_000..=60_000,
            _ => 1..=10_000,
        };
        assert!(expected.contains(&count), "{name} has {count} triangles, not {expected:?}");
    }
}

#[test]
fn scenes_are_the_same_at_every_call() {
    let hash = |scene: &Scene| {
        let mut hasher = DefaultHasher::new();
        let all = scene.triangles(scene.origin()).expect("generated scenes are valid");
        for p in &all.positions {
            p.to_array().map(f32::to_bits).hash(&mut hasher);
        }
        all.triangles.hash(&mut hasher);
        hasher.finish()
    };
    for (name, make, _) in entries() {
        assert_eq!(hash(&make()), hash(&make()), "{name} differs between two calls");
    }
    let other = tree(&Tree { seed: 2, ..Tree::default() });
    assert_ne!(hash(&other), hash(&tree(&Tree::default())), "the seed has no effect");
}

#[test]
fn no_triangle_is_degenerate_in_f32_world_space() {
    for (name, make, _) in entries() {
        for (number, [a, b, c]) in World::of(&make()).0.into_iter().enumerate() {
            let area = 0.5 * (b - a).cross(c - a).length();
            assert!(area > 0.0, "{name}: triangle {number} has no area");
        }
    }
}

#[test]
fn bodies_are_closed_and_turned_outwards() {
    for (name, make, _) in entries() {
        for mesh in make().meshes {
            if SHEETS.contains(&mesh.name.as_str()) && *name != "street" || mesh.name == "ground" {
                continue;
            }
            assert!(is_closed(&mesh), "{name}: {} has an open edge", mesh.name);
            assert!(volume(&mesh) > 0.0, "{name}: {} is inside out", mesh.name);
        }
    }
    assert!(!is_closed(&shapes::floor(1.0)), "a sheet must not count as closed");
}

#[test]
fn shapes_have_the_size_they_state() {
    let close = |a: f64, b: f64, tolerance: f64| (a - b).abs() <= tolerance * b;
    // f32 vertices: a relative error of 2^-24 in each of three factors, and sums of it.
    const ROUNDING: f64 = 1e-6;
    let cuboid = shapes::cuboid(DVec3::ZERO, DVec3::new(1.0, 2.0, 3.0));
    assert!(close(volume(&cuboid), 6.0, ROUNDING), "cuboid: {}", volume(&cuboid));
    // A tetrahedron fills a third of the cube whose corners it has; radius 2 makes its side this.
    let side = 4.0 / 3_f64.sqrt();
    let tetrahedron = shapes::tetrahedron(2.0);
    let third = side.powi(3) / 3.0;
    assert!(close(volume(&tetrahedron), third, ROUNDING), "not {third} but a {tetrahedron:?}");
    let cylinder = shapes::cylinder(1.0, 2.0, 48);
    let polygon = 24.0 * (std::f64::consts::TAU / 48.0).sin();
    assert!(close(volume(&cylinder), 2.0 * polygon, ROUNDING), "cylinder: {}", volume(&cylinder));
    let sphere = shapes::icosphere(4, 0.5);
    assert_eq!(sphere.triangles.len(), 5120, "four subdivisions of an icosahedron");
    let ball = 4.0 / 3.0 * std::f64::consts::PI * 0.125;
    assert!(volume(&sphere) < ball, "an inscribed sphere is smaller than the ball");
    assert!(close(volume(&sphere), ball, 0.01), "sphere: {}", volume(&sphere));
    for p in &sphere.positions {
        assert!((p.as_dvec3().length() - 0.5).abs() < 1e-7, "a vertex off the sphere: {p}");
    }
    assert_eq!(shapes::disc(DVec3::ZERO, 1.0, 0).triangles.len(), 3, "counts are raised to 3");
}

#[test]
fn convex_bodies_are_convex() {
    for (name, make, _) in CONVEX {
        let scene = make();
        let size = scene.bounds().radius();
        for mesh in &scene.meshes {
            for [a, b, c] in corners(mesh) {
                let normal = (b - a).cross(c - a).normalize();
                // A vertex moves by 2^-24 of its size when rounded, the plane through three others
                // by that times the ratio of distance to edge, here below 50.
                let outside = |p: &glam::Vec3| normal.dot(p.as_dvec3() - a) > 50.0 * size * 6e-8;
                assert!(!mesh.positions.iter().any(outside), "{name}: a vertex beyond a face");
            }
        }
    }
}

#[test]
fn cameras_see_lit_geometry_and_a_shadow() {
    const GRID: u32 = 14;
    for (name, make, _) in entries() {
        let scene = make();
        let world = World::of(&scene);
        let (camera, sun) =
            (scene.camera_or_framing(), scene.light_or_placed(LightKind::Directional));
        let (mut hits, mut lit) = (0, 0);
        for i in 0..GRID * GRID {
            let at = |n: u32| (f64::from(n) + 0.5) / f64::from(GRID);
            let ray = camera.ray_direction(at(i % GRID), at(i / GRID), 16.0 / 9.0);
            let Some(t) = world.hit(camera.eye, ray) else {
                continue;
            };
            assert!(t * ray.dot(camera.forward()) > camera.near, "{name}: the near plane cuts");
            hits += 1;
            let p = camera.eye + (t - 1e-6) * ray;
            lit += u32::from(world.sees_light(p, &sun));
        }
        let rays = GRID * GRID;
        assert!(10 * hits >= rays, "{name}: {hits} of {rays} rays meet geometry");
        assert!(lit > 0, "{name}: nothing seen is lit");
        // Nothing shadows the bare plane, and so few rays miss the thin shadows of wires.
        if !name.starts_with("grazing") && *name != "wires" {
            assert!(lit < hits, "{name}: nothing seen is in shadow or turned away");
        }
    }
}

#[test]
fn shadows_lie_where_the_cases_state() {
    let shadow = |scene: &Scene, light: usize, x: f64, z: f64| {
        !World::of(scene).sees_light(DVec3::new(x, 0.0, z), &scene.lights[light])
    };
    let rectangle = rectangle_over_plane(&RectOverPlane::default());
    // Edges of the shadow along x, per light: from (1, 1, 0), straight down, the point.
    for (light, from, to, half_z) in
        [(0, -3.0, -1.0, 1.0), (1, -1.0, 1.0, 1.0), (2, -1.5, 1.5, 1.5)]
    {
        for (x, z, inside) in [
            (from + 0.01, 0.3, true),
            (to - 0.01, 0.3, true),
            (from - 0.01, 0.3, false),
            (to + 0.01, 0.3, false),
            (0.5 * (from + to), half_z - 0.01, true),
            (0.5 * (from + to), half_z + 0.01, false),
        ] {
            let found = shadow(&rectangle, light, x, z);
            assert_eq!(found, inside, "HC-01, light {light}: floor point ({x}, {z})");
        }
    }
    let (wall, cube) = (thin_wall(), cube_on_floor());
    for (z, inside) in [(-0.006, true), (-1.9, true), (-2.01, false), (0.006, false)] {
        assert_eq!(shadow(&wall, 0, 0.3, z), inside, "HC-04: floor at z = {z}");
    }
    for (z, inside) in [(-0.501, true), (-1.49, true), (-1.51, false), (0.501, false)] {
        assert_eq!(shadow(&cube, 0, 0.3, z), inside, "HC-05: floor at z = {z}");
    }
    let half = half_plane_over_plane(&HalfPlaneOverPlane::default());
    for (x, inside) in [(-9.9, true), (-2.01, true), (-1.99, false), (9.0, false)] {
        assert_eq!(shadow(&half, 0, x, 4.3), inside, "half-plane: floor at x = {x}");
    }
    for azimuth in [0.0, 0.3, std::f64::consts::FRAC_PI_4] {
        let plane = grazing_plane(azimuth);
        assert!(!shadow(&plane, 0, 1.3, -2.1), "HC-03: everything is lit");
        let to_light = plane.lights[0].towards(DVec3::ZERO, DVec2::splat(0.5));
        assert!((to_light.y - 5_f64.to_radians().sin()).abs() < 1e-12, "HC-03: 5 degrees high");
    }
}

#[test]
fn sizes_are_as_stated() {
    let size = |name: &str| {
        let Bounds { min, max } = by_name(name).expect("a registered scene").bounds();
        max - min
    };
    assert_eq!(size("rectangle"), DVec3::new(20.0, 2.0, 20.0), "HC-01");
    assert_eq!(size("grazing-plane"), DVec3::new(20.0, 0.0, 20.0), "HC-03");
    assert_eq!(size("thin-wall"), DVec3::new(20.0, 2.0, 20.0), "HC-04");
    assert_eq!(size("cube"), DVec3::new(20.0, 1.0, 20.0), "HC-05");
    assert!(size("street").z > 400.0, "the street is several hundred metres long");
    let tree = size("tree");
    assert!((4.0..9.0).contains(&tree.y), "the tree is about 6 m high, not {}", tree.y);
    let map = ThinCasters::default();
    assert_eq!(map.texel(), 20.0 / 1024.0, "the texel that thickness is counted in");
    for (mesh, texels) in fence(&map, &THICKNESSES).meshes[1..].iter().zip(THICKNESSES) {
        let thick = mesh.bounds().max.z - mesh.bounds().min.z;
        assert!((thick / map.texel() - texels).abs() < 1e-5, "a picket of {texels}: {thick} m");
    }
}

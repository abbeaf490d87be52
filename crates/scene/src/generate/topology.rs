//! Casters whose triangles do not hang together as those of a closed body do.

use std::f64::consts::TAU;

use glam::{DAffine3, DVec3, Vec3};

use super::{empty, look, shapes};
use crate::{Light, Mesh, Scene};

fn mesh(name: &str, positions: Vec<Vec3>, triangles: Vec<[u32; 3]>) -> Mesh {
    Mesh { name: name.to_owned(), positions, triangles }
}

/// Triangles that share the edge from (0, 1, -1) to (0, 1, 1), at even angles around it, all running along it
/// from its first end to its second; 1 m wide.
#[must_use]
pub fn pages(count: u32) -> Mesh {
    let mut positions = vec![Vec3::new(0.0, 1.0, -1.0), Vec3::new(0.0, 1.0, 1.0)];
    positions.extend((0..count).map(|i| {
        let (sin, cos) = (TAU * f64::from(i) / f64::from(count)).sin_cos();
        DVec3::new(cos, 1.0 + sin, 0.0).as_vec3()
    }));
    mesh("pages", positions, (0..count).map(|i| [0, 1, 2 + i]).collect())
}

/// HC-19: three pages on one edge, a triangle on its own, and four pages on one edge, over a floor.
#[must_use]
pub fn non_manifold() -> Scene {
    let mut scene = empty("non-manifold");
    scene.add(shapes::floor(10.0), DAffine3::IDENTITY);
    let up = |x: f64| DAffine3::from_translation(DVec3::new(x, 1.0, 0.0));
    scene.add(pages(3), up(-3.0));
    scene.add(pages(1).named("triangle"), up(0.0));
    scene.add(pages(4), up(3.0));
    with_view(scene)
}

/// A Moebius strip of `quads` quads around the y axis: middle circle of `radius`, `width` wide, half a turn. Its
/// triangles are wound alike but where the ends meet.
#[must_use]
pub fn moebius(quads: u32, radius: f64, width: f64) -> Mesh {
    let n = quads.max(3);
    let point = |i: u32, side: f64| {
        let turn = TAU * f64::from(i) / f64::from(n);
        let (sin, cos) = (0.5 * turn).sin_cos();
        let out = radius + side * 0.5 * width * cos;
        DVec3::new(out * turn.sin(), side * 0.5 * width * sin, out * turn.cos()).as_vec3()
    };
    let positions = (0..n).flat_map(|i| [point(i, -1.0), point(i, 1.0)]).collect();
    let triangles = (0..n)
        .flat_map(|i| {
            let (a, b) = (2 * i, 2 * i + 1);
            // After half a turn the sides have changed places.
            let (c, d) = if i + 1 < n { (a + 2, b + 2) } else { (1, 0) };
            [[a, c, b], [c, d, b]]
        })
        .collect();
    mesh("moebius", positions, triangles)
}

/// HC-20: a square whose two triangles are wound against each other, and a Moebius strip of 64 quads, radius
/// 1 m, width 0.4 m, over a floor.
#[must_use]
pub fn unorientable() -> Scene {
    let mut scene = empty("unorientable");
    scene.add(shapes::floor(10.0), DAffine3::IDENTITY);
    let mut square = shapes::quad(2.0 * DVec3::Y, DVec3::Z, DVec3::X);
    if let Some(second) = square.triangles.get_mut(1) {
        second.reverse();
    }
    scene.add(square, DAffine3::from_translation(DVec3::new(-2.5, 0.0, 0.0)));
    scene.add(
        moebius(64, 1.0, 0.4).named("moebius"),
        DAffine3::from_translation(DVec3::new(2.5, 1.5, 0.0)),
    );
    with_view(scene)
}

/// HC-22: a plate of 2 m, half a metre up, whose left half is one quad and whose right half is two, the vertex
/// between those lying on the middle of the left half's edge, displaced upwards by `offset`.
#[must_use]
pub fn t_junction(offset: f32) -> Scene {
    let positions = [
        [-1.0, 0.0, -1.0],
        [-1.0, 0.0, 1.0],
        [0.0, 0.0, 1.0],
        [0.0, 0.0, -1.0],
        [0.0, offset, 0.0],
        [1.0, 0.0, 1.0],
        [1.0, 0.0, 0.0],
        [1.0, 0.0, -1.0],
    ];
    let triangles = vec![[0, 1, 2], [0, 2, 3], [4, 2, 5], [4, 5, 6], [3, 4, 6], [3, 6, 7]];
    let plate =
        mesh("plate", positions.map(|[x, y, z]| Vec3::new(x, y + 0.5, z)).into(), triangles);
    let mut scene = empty("t-junction");
    scene.add(shapes::floor(10.0), DAffine3::IDENTITY);
    scene.add(plate, DAffine3::IDENTITY);
    with_view(scene)
}

/// A view from the south and above, a slanting sun, a lamp, and one straight overhead.
fn with_view(mut scene: Scene) -> Scene {
    scene.camera = Some(look([0.0, 4.5, 6.5], [0.0, 0.3, -0.5], 0.1));
    scene.lights = vec![
        Light::sun(50_f64.to_radians(), 0.6, 0.0),
        Light::Point { position: DVec3::new(1.0, 6.0, 2.0) },
        Light::Directional { direction: DVec3::NEG_Y, angular_diameter: 0.0 },
    ];
    scene
}

/// HC-26: poles of 8 sides, radius 2 cm, height 1 m, `side` x `side` of them 0.5 m apart on a floor; the camera
/// stands before them, 1.7 m high, and looks towards a sun 8 degrees high. With `wall`, HC-27: a wall of 80 m x
/// 20 m between the sun and all of them.
#[must_use]
pub fn poles(side: u32, wall: bool) -> Scene {
    let reach = 0.25 * f64::from(side);
    let mut scene = empty(if wall { "poles-behind-wall" } else { "poles" });
    scene.add(shapes::floor(60.0), DAffine3::IDENTITY);
    let mut all = Mesh::default().named("poles");
    for i in 0..side * side {
        let at = |i: u32| 0.5 * (f64::from(i) + 0.5) - reach;
        let foot = DVec3::new(at(i % side), 0.0, at(i / side));
        all.append(&shapes::frustum(foot, foot + DVec3::Y, 0.02, 0.02, 8));
    }
    scene.add(all, DAffine3::IDENTITY);
    if wall {
        let (low, high) =
            (DVec3::new(-40.0, 0.0, -reach - 1.5), DVec3::new(40.0, 20.0, -reach - 1.0));
        scene.add(shapes::cuboid(low, high).named("wall"), DAffine3::IDENTITY);
    }
    let eye = reach + 3.0;
    scene.camera = Some(look([0.0, 1.7, eye], [0.0, 0.8, eye - 6.0], 0.1));
    // From -z, where the camera looks.
    scene.lights = vec![Light::sun(8_f64.to_radians(), std::f64::consts::PI, 0.0)];
    scene
}

/// HC-28: two storeys, slabs of 20 m x 20 m x 0.3 m at 0 m and 3 m, the upper with a stair hole; 1000 cubes on the
/// lower one; a lamp and the camera upstairs.
#[must_use]
pub fn two_storeys(cubes: bool) -> Scene {
    let mut scene = empty("two-storeys");
    let slab = |low: [f64; 2], high: [f64; 2], y: f64| {
        shapes::cuboid(DVec3::new(low[0], y - 0.3, low[1]), DVec3::new(high[0], y, high[1]))
    };
    scene.add(slab([-10.0, -10.0], [10.0, 10.0], 0.0).named("ground"), DAffine3::IDENTITY);
    // Four slabs around a hole from (6, 6) to (9, 8).
    for (name, low, high) in [
        ("west", [-10.0, -10.0], [6.0, 10.0]),
        ("east", [9.0, -10.0], [10.0, 10.0]),
        ("north", [6.0, -10.0], [9.0, 6.0]),
        ("south", [6.0, 8.0], [9.0, 10.0]),
    ] {
        scene.add(slab(low, high, 3.0).named(name), DAffine3::IDENTITY);
    }
    scene.add(
        shapes::cuboid(DVec3::new(-1.0, 3.0, -4.0), DVec3::new(1.0, 4.0, -3.0)).named("crate"),
        DAffine3::IDENTITY,
    );
    if cubes {
        for i in 0..1000_u32 {
            let (x, z) = (f64::from(i % 40) * 0.45 - 9.0, f64::from(i / 40) * 0.7 - 9.0);
            let low = DVec3::new(x, 0.0, z);
            scene.add(
                shapes::cuboid(low, low + DVec3::splat(0.3)).named("cube"),
                DAffine3::IDENTITY,
            );
        }
    }
    scene.camera = Some(look([0.0, 4.7, 6.0], [0.0, 3.2, -3.0], 0.1));
    scene.lights = vec![Light::Point { position: DVec3::new(0.0, 5.5, 0.0) }];
    scene
}

//! Simple shapes. Counter-clockwise seen from outside (closed shapes) or from above (flat ones).
//!
//! Arguments are metres in `f64`; vertices are rounded once, at the end. Counts below the least that
//! makes the shape are raised to it.

use std::collections::HashMap;
use std::f64::consts::TAU;

use glam::DVec3;

use crate::Mesh;
use crate::light::basis;

fn mesh(name: &str, positions: &[DVec3], triangles: Vec<[u32; 3]>) -> Mesh {
    Mesh {
        name: name.to_owned(),
        positions: positions.iter().map(|p| p.as_vec3()).collect(),
        triangles,
    }
}

/// A parallelogram of two triangles around `center`; its normal is `half_u` x `half_v`.
#[must_use]
pub fn quad(center: DVec3, half_u: DVec3, half_v: DVec3) -> Mesh {
    let corners = [-half_u - half_v, half_u - half_v, half_u + half_v, half_v - half_u];
    mesh("quad", &corners.map(|c| center + c), vec![[0, 1, 2], [0, 2, 3]])
}

/// A level square around the origin at y = 0, normal up, `half` to each side.
#[must_use]
pub fn floor(half: f64) -> Mesh {
    quad(DVec3::ZERO, half * DVec3::Z, half * DVec3::X).named("floor")
}

/// A level disc around `center`, normal up: a fan of `segments` (at least 3) triangles, whose edge
/// lies within radius (1 - cos(pi / segments)) of the circle.
#[must_use]
pub fn disc(center: DVec3, radius: f64, segments: u32) -> Mesh {
    let n = segments.max(3);
    let mut positions = vec![center];
    positions.extend((0..n).map(|i| {
        let (sin, cos) = (TAU * f64::from(i) / f64::from(n)).sin_cos();
        center + radius * DVec3::new(sin, 0.0, cos)
    }));
    mesh("disc", &positions, (0..n).map(|i| [0, 1 + i, 1 + (i + 1) % n]).collect())
}

/// The box between two corners, closed; `min` below `max` on every axis.
#[must_use]
pub fn cuboid(min: DVec3, max: DVec3) -> Mesh {
    hexahedron(crate::Bounds { min, max }.corners()).named("cuboid")
}

/// A closed body with the corners of a box: corner i lies at the far side along the first, second and
/// third direction where bit 0, 1 and 2 of i are set; the directions are right-handed.
#[must_use]
pub fn hexahedron(corners: [DVec3; 8]) -> Mesh {
    const FACES: [[u32; 4]; 6] =
        [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
    let halves = |[a, b, c, d]: [u32; 4]| [[a, b, c], [a, c, d]];
    mesh("hexahedron", &corners, FACES.into_iter().flat_map(halves).collect())
}

/// A regular tetrahedron around the origin with its corners at `radius`.
#[must_use]
pub fn tetrahedron(radius: f64) -> Mesh {
    let corner = |x, y, z| DVec3::new(x, y, z) * (radius / 3_f64.sqrt());
    mesh(
        "tetrahedron",
        &[
            corner(1.0, 1.0, 1.0),
            corner(1.0, -1.0, -1.0),
            corner(-1.0, 1.0, -1.0),
            corner(-1.0, -1.0, 1.0),
        ],
        vec![[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]],
    )
}

/// A sphere around the origin: an icosahedron whose triangles are split in four `subdivisions` times
/// (at most 8), all vertices at `radius`; 20 x 4^subdivisions triangles.
#[must_use]
pub fn icosphere(subdivisions: u32, radius: f64) -> Mesh {
    // The icosahedron's corners are those of three golden rectangles.
    let g = 0.5 * (1.0 + 5_f64.sqrt());
    let mut points: Vec<DVec3> = [
        (-1.0, g, 0.0),
        (1.0, g, 0.0),
        (-1.0, -g, 0.0),
        (1.0, -g, 0.0),
        (0.0, -1.0, g),
        (0.0, 1.0, g),
        (0.0, -1.0, -g),
        (0.0, 1.0, -g),
        (g, 0.0, -1.0),
        (g, 0.0, 1.0),
        (-g, 0.0, -1.0),
        (-g, 0.0, 1.0),
    ]
    .into_iter()
    .map(|(x, y, z)| DVec3::new(x, y, z).normalize())
    .collect();
    let mut triangles = vec![
        [0, 11, 5],
        [0, 5, 1],
        [0, 1, 7],
        [0, 7, 10],
        [0, 10, 11],
        [1, 5, 9],
        [5, 11, 4],
        [11, 10, 2],
        [10, 7, 6],
        [7, 1, 8],
        [3, 9, 4],
        [3, 4, 2],
        [3, 2, 6],
        [3, 6, 8],
        [3, 8, 9],
        [4, 9, 5],
        [2, 4, 11],
        [6, 2, 10],
        [8, 6, 7],
        [9, 8, 1],
    ];
    for _ in 0..subdivisions.min(8) {
        let mut middles = HashMap::new();
        let mut middle = |a: u32, b: u32| {
            *middles.entry((a.min(b), a.max(b))).or_insert_with(|| {
                points.push((points[a as usize] + points[b as usize]).normalize());
                points.len() as u32 - 1
            })
        };
        triangles = triangles
            .into_iter()
            .flat_map(|[a, b, c]| {
                let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
                [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
            })
            .collect();
    }
    let points: Vec<DVec3> = points.into_iter().map(|p| p * radius).collect();
    mesh("icosphere", &points, triangles)
}

/// A closed upright cylinder on y = 0 around the y axis with `segments` (at least 3) sides, whose
/// edges lie at `radius`.
#[must_use]
pub fn cylinder(radius: f64, height: f64, segments: u32) -> Mesh {
    frustum(DVec3::ZERO, height * DVec3::Y, radius, radius, segments).named("cylinder")
}

/// A closed round bar from `from` to `to`, two different points, with its radius (> 0) at either end
/// and `segments` (at least 3) sides.
#[must_use]
pub fn frustum(from: DVec3, to: DVec3, radius_from: f64, radius_to: f64, segments: u32) -> Mesh {
    let n = segments.max(3);
    let (u, v) = basis((to - from).normalize_or(DVec3::Y));
    let ring = |center: DVec3, radius: f64| {
        (0..n).map(move |i| {
            let (sin, cos) = (TAU * f64::from(i) / f64::from(n)).sin_cos();
            center + radius * (cos * u + sin * v)
        })
    };
    let positions: Vec<DVec3> = ring(from, radius_from).chain(ring(to, radius_to)).collect();
    let mut triangles = Vec::new();
    for i in 0..n {
        let j = (i + 1) % n;
        triangles.extend([[i, j, n + j], [i, n + j, n + i]]);
    }
    for i in 1..n - 1 {
        triangles.extend([[0, i + 1, i], [n, n + i, n + i + 1]]);
    }
    mesh("frustum", &positions, triangles)
}

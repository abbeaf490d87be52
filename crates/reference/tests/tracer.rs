//! The ray tracer against brute force, against geometry that must not leak, and against itself.

use std::time::Instant;

use antumbra_reference::{Instructions, LARGEST_COORDINATE, Ray, TraceError, Tracer};
use antumbra_scene::Triangles;
use glam::{DMat3, DQuat, DVec3, Vec3};

/// SplitMix64 (Steele, Lea and Flood 2014).
struct Random(u64);

impl Random {
    fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let x = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        x ^ (x >> 31)
    }
    /// In [0, 1).
    fn unit(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1_u64 << 53) as f64
    }
    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }
    fn below(&mut self, n: usize) -> usize {
        (self.bits() % n as u64) as usize
    }
    fn vector(&mut self) -> DVec3 {
        DVec3::from_array(std::array::from_fn(|_| self.between(-1.0, 1.0)))
    }
    fn direction(&mut self) -> DVec3 {
        loop {
            let v = self.vector();
            if v.length() <= 1.0 && v.length() > 0.1 {
                return v.normalize();
            }
        }
    }
    /// +-10^U(-6, 6).
    fn wild(&mut self) -> f64 {
        let size = 10.0_f64.powf(self.between(-6.0, 6.0));
        if self.bits() & 1 == 0 { size } else { -size }
    }
}

fn list(positions: Vec<Vec3>, triangles: Vec<[u32; 3]>) -> Triangles {
    Triangles { positions, triangles, ..Triangles::default() }
}

fn tracer(triangles: &Triangles) -> Tracer {
    Tracer::new(triangles).expect("valid triangles")
}

/// An icosahedron, each triangle divided into four `levels` times.
fn icosphere(levels: u32) -> (Vec<DVec3>, Vec<[u32; 3]>) {
    let g = (1.0 + 5.0_f64.sqrt()) / 2.0;
    let mut points: Vec<DVec3> = Vec::new();
    for (a, b) in [(1.0, g), (1.0, -g), (-1.0, g), (-1.0, -g)] {
        points.extend([DVec3::new(0.0, a, b), DVec3::new(a, b, 0.0), DVec3::new(b, 0.0, a)]);
    }
    // Faces: all triples at mutual distance 2, the length of an edge.
    let near = |i: usize, j: usize| (points[i].distance(points[j]) - 2.0).abs() < 1e-9;
    let mut faces = Vec::new();
    for i in 0..12 {
        for j in i + 1..12 {
            for k in j + 1..12 {
                if near(i, j) && near(j, k) && near(i, k) {
                    faces.push([i as u32, j as u32, k as u32]);
                }
            }
        }
    }
    for _ in 0..levels {
        let mut middles = std::collections::HashMap::new();
        let mut next = Vec::new();
        for [a, b, c] in faces {
            let mut middle = |i: u32, j: u32| {
                *middles.entry((i.min(j), i.max(j))).or_insert_with(|| {
                    points.push(0.5 * (points[i as usize] + points[j as usize]));
                    points.len() as u32 - 1
                })
            };
            let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
            next.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
        }
        faces = next;
    }
    (points.into_iter().map(DVec3::normalize).collect(), faces)
}

/// How a ray in `f64` relates to a triangle, by a margin of relative size `margin`.
#[derive(Clone, Copy, PartialEq, Debug)]
enum Sure {
    Hit,
    Miss,
    Unknown,
}

/// Brute force in `f64`: the triangle is met if the ray's line passes all edges on one side. Where
/// rounding the corners to `margin` of the largest coordinate could change the answer it is unknown.
fn brute(corners: [DVec3; 3], ray: &Ray, margin: f64) -> Sure {
    let (o, d) = (ray.origin.as_dvec3(), ray.direction.as_dvec3());
    let d = d.normalize();
    let end = f64::from(ray.t_max) * ray.direction.as_dvec3().length();
    let [a, b, c] = corners.map(|p| p - o);
    let size = [a, b, c].iter().map(|p| p.length()).fold(o.length(), f64::max);
    let e = margin * size;
    // Distance of the line from each edge's line, signed, times the edge's length.
    let sides = [d.dot(b.cross(a)), d.dot(c.cross(b)), d.dot(a.cross(c))];
    let slack = [a, b, c].iter().map(|p| p.length()).fold(0.0, f64::max) * 4.0 * e;
    let all = |f: &dyn Fn(f64) -> bool| sides.iter().all(|&s| f(s));
    let any = |f: &dyn Fn(f64) -> bool| sides.iter().any(|&s| f(s));
    if any(&|s| s > slack) && any(&|s| s < -slack) {
        return Sure::Miss;
    }
    let low = a.dot(d).min(b.dot(d)).min(c.dot(d));
    let high = a.dot(d).max(b.dot(d)).max(c.dot(d));
    if high < -e || low > end + e {
        return Sure::Miss;
    }
    if !(all(&|s| s > slack) || all(&|s| s < -slack)) {
        return Sure::Unknown;
    }
    let normal = (b - a).cross(c - a).normalize();
    let t = normal.dot(a) / normal.dot(d);
    let blur = 8.0 * e / normal.dot(d).abs();
    if t > blur && t < end - blur {
        Sure::Hit
    } else if t < -blur || t > end + blur {
        Sure::Miss
    } else {
        Sure::Unknown
    }
}

/// Compares a tracer with brute force; gives disagreements, agreements on a hit and on a miss.
fn compare(tracer: &Tracer, triangles: &Triangles, rays: &[Ray]) -> [usize; 3] {
    let corners: Vec<[DVec3; 3]> = triangles
        .triangles
        .iter()
        .map(|t| t.map(|i| triangles.positions[i as usize].as_dvec3()))
        .collect();
    let mut counts = [0; 3];
    for ray in rays {
        // 2^-20: 16 roundings, as many as the tracer's own boxes allow for.
        let answers = corners.iter().map(|&c| brute(c, ray, 1.0 / f64::from(1 << 20)));
        let (mut hit, mut unknown) = (false, false);
        for answer in answers {
            hit |= answer == Sure::Hit;
            unknown |= answer == Sure::Unknown;
        }
        if unknown && !hit {
            continue;
        }
        let ours = tracer.occluded(ray.origin, ray.direction, ray.t_max);
        counts[if ours != hit { 0 } else { 2 - usize::from(hit) }] += 1;
    }
    counts
}

fn soup(random: &mut Random, count: usize, wild: bool) -> Triangles {
    let mut positions = Vec::new();
    for _ in 0..count {
        let at = random.vector();
        let size = if wild { 10.0_f64.powf(random.between(-3.0, 0.5)) } else { 0.3 };
        for _ in 0..3 {
            positions.push((at + size * random.vector()).as_vec3());
        }
        if wild && random.below(4) == 0 {
            // A sliver: the third corner near the middle of the first two.
            let n = positions.len();
            let middle = 0.5 * (positions[n - 3] + positions[n - 2]);
            positions[n - 1] = middle + 1e-4 * random.vector().as_vec3();
        }
    }
    let triangles = (0..count as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    list(positions, triangles)
}

fn rays(random: &mut Random, count: usize) -> Vec<Ray> {
    (0..count)
        .map(|i| {
            let mut direction = random.vector();
            if i % 5 == 0 {
                direction[random.below(3)] = 0.0;
            }
            if i % 11 == 0 {
                direction = DVec3::AXES[random.below(3)];
            }
            let t_max = if i % 3 == 0 { f32::INFINITY } else { random.between(0.01, 2.0) as f32 };
            let length = 10.0_f64.powf(random.between(-6.0, 6.0));
            Ray {
                origin: (1.5 * random.vector()).as_vec3(),
                direction: (direction * length).as_vec3(),
                t_max: (f64::from(t_max) / length) as f32,
            }
        })
        .collect()
}

#[test]
fn agrees_with_brute_force_on_random_soups() {
    let mut random = Random(1);
    let mut sum = [0; 3];
    for round in 0..40 {
        let count = [1, 2, 3, 7, 8, 9, 30, 200][round % 8];
        let triangles = soup(&mut random, count, round % 2 == 1);
        let tracer = tracer(&triangles);
        let counts = compare(&tracer, &triangles, &rays(&mut random, 4000));
        for (s, c) in sum.iter_mut().zip(counts) {
            *s += c;
        }
    }
    assert_eq!(sum[0], 0, "disagreements with brute force ({sum:?})");
    assert!(sum[1] > 10_000 && sum[2] > 10_000, "too few decided rays: {sum:?}");
}

#[test]
fn comparison_with_brute_force_notices_a_moved_triangle() {
    let mut random = Random(2);
    let triangles = soup(&mut random, 8, false);
    let mut moved = triangles.clone();
    for p in &mut moved.positions[..3] {
        p.x += 0.01;
    }
    let counts = compare(&tracer(&moved), &triangles, &rays(&mut random, 20_000));
    assert!(counts[0] > 0, "a triangle moved by a hundredth went unnoticed: {counts:?}");
}

/// Rays from the middle that leave a closed mesh, aimed everywhere, at its corners and at its edges.
fn leaks(
    tracer: &Tracer,
    points: &[Vec3],
    faces: &[[u32; 3]],
    random: &mut Random,
    count: usize,
) -> usize {
    let middle = points.iter().map(|p| p.as_dvec3()).sum::<DVec3>() / points.len() as f64;
    let mut leaks = 0;
    for i in 0..count {
        let origin = middle.as_vec3();
        let face = faces[random.below(faces.len())].map(|i| points[i as usize]);
        let direction = match i % 4 {
            0 => face[0] - origin,
            1 => 0.5 * (face[0] + face[1]) - origin,
            2 => face[0].lerp(face[1], random.unit() as f32) - origin,
            _ => {
                let (a, b) = (random.unit(), random.unit());
                let inside = face[0]
                    + (face[1] - face[0]) * a as f32 * 0.5
                    + (face[2] - face[0]) * b as f32 * 0.5;
                inside - origin
            }
        };
        if direction != Vec3::ZERO && !tracer.occluded(origin, direction, f32::INFINITY) {
            leaks += 1;
        }
    }
    leaks
}

#[test]
fn closed_meshes_do_not_leak_at_any_size_and_place() {
    let mut random = Random(3);
    let mut rays = 0;
    for round in 0..300 {
        let (points, faces) = icosphere(round % 4);
        // Convex and starlike about the middle whatever the linear map; flat ones give slivers.
        let turn =
            DMat3::from_quat(DQuat::from_axis_angle(random.direction(), random.between(0.0, 6.0)));
        let size = random.wild().abs();
        let flat =
            DVec3::new(size, size * random.between(1e-3, 1.0), size * random.between(0.1, 1.0));
        // Up to a thousand sizes away from zero: ten of the 24 bits go to the offset.
        let offset = random.vector() * size * 10.0_f64.powf(random.between(-3.0, 2.0));
        let points: Vec<Vec3> =
            points.iter().map(|&p| (turn * (flat * p) + offset).as_vec3()).collect();
        let tracer = tracer(&list(points.clone(), faces.clone()));
        let count = 4000;
        let lost = leaks(&tracer, &points, &faces, &mut random, count);
        assert_eq!(lost, 0, "round {round}: {lost} of {count} rays left a closed mesh");
        rays += count;
    }
    assert!(rays >= 1_000_000, "only {rays} rays");
}

#[test]
fn coordinates_of_all_magnitudes_do_not_leak() {
    // Tetrahedra whose corners have coordinates +-10^U(-6, 6); the ray starts inside, aims at
    // corners and edges. Only where the start is inside by more than rounding.
    let mut random = Random(4);
    let faces = [[0, 1, 2], [0, 1, 3], [0, 2, 3], [1, 2, 3]];
    let mut used = 0;
    while used < 3000 {
        let points: Vec<Vec3> = (0..4)
            .map(|_| Vec3::new(random.wild() as f32, random.wild() as f32, random.wild() as f32))
            .collect();
        let p: Vec<DVec3> = points.iter().map(|p| p.as_dvec3()).collect();
        let middle = p.iter().sum::<DVec3>() / 4.0;
        let size = p.iter().map(|p| p.length()).fold(0.0, f64::max);
        let volume = (p[1] - p[0]).cross(p[2] - p[0]).dot(p[3] - p[0]).abs();
        // Height of the middle above the largest face, at least: volume / (4 size^2).
        if volume < 1e-4 * size.powi(3) || middle.length() > size {
            continue;
        }
        used += 1;
        let tracer = tracer(&list(points.clone(), faces.to_vec()));
        let lost = leaks(&tracer, &points, &faces, &mut random, 200);
        assert_eq!(lost, 0, "{points:?}: {lost} rays left a tetrahedron");
    }
}

#[test]
fn a_missing_triangle_leaks() {
    let mut random = Random(5);
    let (points, mut faces) = icosphere(2);
    let points: Vec<Vec3> = points.iter().map(|p| p.as_vec3()).collect();
    let all = faces.clone();
    faces.remove(100);
    let lost = leaks(&tracer(&list(points.clone(), faces)), &points, &all, &mut random, 20_000);
    assert!(lost > 0, "a hole went unnoticed");
}

#[test]
fn rays_through_the_edges_and_corners_of_a_grid_are_blocked() {
    // A plane of 32 x 32 squares, rays aimed exactly at corners and middles of edges, and straight.
    let n = 32_u32;
    let mut random = Random(6);
    let (mut points, mut faces) = (Vec::new(), Vec::new());
    for j in 0..=n {
        for i in 0..=n {
            points.push(Vec3::new(i as f32 / 3.0, 0.7, j as f32 / 7.0));
        }
    }
    for j in 0..n {
        for i in 0..n {
            let a = j * (n + 1) + i;
            faces.extend([[a, a + 1, a + n + 1], [a + 1, a + n + 2, a + n + 1]]);
        }
    }
    let tracer = tracer(&list(points.clone(), faces));
    for _ in 0..100_000 {
        let (i, j) = (1 + random.below(n as usize - 1), 1 + random.below(n as usize - 1));
        let target = points[j * (n as usize + 1) + i];
        let straight = Vec3::new(target.x, random.between(1.0, 9.0) as f32, target.z);
        assert!(tracer.occluded(straight, Vec3::NEG_Y, f32::INFINITY), "straight down to {target}");
        let origin = (random.vector() * 5.0 + DVec3::Y * 6.0).as_vec3();
        assert!(tracer.occluded(origin, target - origin, 2.0), "from {origin} to {target}");
    }
}

#[test]
fn answers_do_not_depend_on_the_processor_or_the_batch() {
    let mut random = Random(7);
    for wild in [false, true] {
        let triangles = soup(&mut random, 500, wild);
        let tracer = tracer(&triangles);
        let portable = tracer.clone().at_most(Instructions::Portable);
        // Not a multiple of any batch.
        let rays = rays(&mut random, 100_003);
        let single =
            |tracer: &Tracer, ray: &Ray| tracer.occluded(ray.origin, ray.direction, ray.t_max);
        let expected: Vec<bool> = rays.iter().map(|ray| single(&portable, ray)).collect();
        for instructions in [Instructions::Portable, Instructions::Avx2, Instructions::Avx512] {
            let tracer = tracer.clone().at_most(instructions);
            let each: Vec<bool> = rays.iter().map(|ray| single(&tracer, ray)).collect();
            assert_eq!(each, expected, "any hit, {:?}", tracer.instructions());
            assert_eq!(tracer.occluded_all(&rays), expected, "batch, {:?}", tracer.instructions());
            for ray in &rays[..20_000] {
                assert_eq!(tracer.closest(ray), portable.closest(ray), "closest hit of {ray:?}");
            }
        }
    }
}

#[test]
fn closest_hit_agrees_with_any_hit() {
    let mut random = Random(8);
    let triangles = soup(&mut random, 100, true);
    let tracer = tracer(&triangles);
    for ray in rays(&mut random, 50_000) {
        let hit = tracer.closest(&ray);
        assert_eq!(hit.is_some(), tracer.occluded(ray.origin, ray.direction, ray.t_max), "{ray:?}");
        if let Some(hit) = hit {
            assert!(hit.t <= ray.t_max, "{hit:?} beyond the end of {ray:?}");
            let nearer = 0.999 * hit.t;
            assert!(
                !tracer.occluded(ray.origin, ray.direction, nearer),
                "{hit:?} is not the first"
            );
            let further = 1.001 * hit.t;
            assert!(tracer.occluded(ray.origin, ray.direction, further), "{hit:?} is not there");
        }
    }
}

#[test]
fn the_segment_is_open() {
    let square = list(
        vec![Vec3::ZERO, Vec3::X, Vec3::Z, Vec3::new(1.0, 0.0, 1.0)],
        vec![[0, 1, 2], [2, 1, 3]],
    );
    let tracer = tracer(&square);
    let above = Vec3::new(0.25, 2.0, 0.5);
    let on = Vec3::new(0.25, 0.0, 0.5);
    assert!(!tracer.occluded(above, Vec3::NEG_Y, 2.0), "ends on the square");
    assert!(tracer.occluded(above, Vec3::NEG_Y, 2.0_f32.next_up()), "ends just behind it");
    assert!(!tracer.occluded(on, Vec3::Y, f32::INFINITY), "starts on the square");
    assert!(!tracer.occluded(above, Vec3::Y, f32::INFINITY), "turns its back to it");
    assert!(tracer.occluded(-above + 2.0 * on, Vec3::Y, 3.0), "comes from below");
    assert!(!tracer.occluded(above, Vec3::ZERO, f32::INFINITY), "has no direction");
    assert!(!tracer.occluded(above, Vec3::NAN, f32::INFINITY), "has no number for a direction");
    assert!(!tracer.occluded(above, Vec3::NEG_Y, 0.0), "has no length");
    assert!(!tracer.occluded(above, Vec3::NEG_Y, f32::NAN), "has no number for a length");
}

#[test]
fn empty_degenerate_and_stacked_scenes_are_fine() {
    let nothing = tracer(&Triangles::default());
    assert!(!nothing.occluded(Vec3::ZERO, Vec3::X, f32::INFINITY), "an empty scene blocks nothing");
    assert_eq!((nothing.extent(), nothing.radius()), (0.0, 0.0), "of no size");

    let points = vec![Vec3::ZERO, Vec3::X, Vec3::new(2.0, 0.0, 0.0), Vec3::Y];
    let flat = tracer(&list(points.clone(), vec![[0, 1, 2], [0, 0, 1], [3, 3, 3]]));
    let from = Vec3::new(0.5, 0.5, 3.0);
    assert!(
        !flat.occluded(from, Vec3::NEG_Z, 9.0),
        "triangles without area block nothing beside them"
    );

    let stacked = tracer(&list(points, vec![[0, 2, 3]; 1_000_000]));
    assert!(stacked.occluded(Vec3::new(0.5, 0.3, 3.0), Vec3::NEG_Z, 9.0), "hits the stack");
    assert!(!stacked.occluded(Vec3::new(1.5, 1.0, 3.0), Vec3::NEG_Z, 9.0), "passes the stack");
}

#[test]
fn boxes_inside_each_other_cost_no_more_than_a_grid() {
    const COUNT: usize = 200_000;
    let build = |corners: &dyn Fn(usize) -> [Vec3; 3]| {
        let positions = (0..COUNT).flat_map(corners).collect();
        let triangles = (0..COUNT as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        let triangles = list(positions, triangles);
        let start = Instant::now();
        (tracer(&triangles), start.elapsed())
    };
    let (_, grid) = build(&|i| {
        let corner = Vec3::new((i % 447) as f32, 0.0, (i / 447) as f32);
        [corner, corner + Vec3::X, corner + Vec3::Z]
    });
    // Layers x + y + z = size, each in a box from 0 to its size.
    let size = |i: usize| 1.0 + i as f32 / COUNT as f32;
    let (tracer, nested) = build(&|i| [Vec3::X, Vec3::Y, Vec3::Z].map(|axis| axis * size(i)));
    // Less than the grid on a quiet machine; a pass per layer would take a thousand times as long.
    assert!(nested < 10 * grid, "{nested:?} for nested boxes, {grid:?} for a grid");
    for i in (0..COUNT - 1).step_by(997) {
        let between = Vec3::ONE * ((size(i) + size(i + 1)) / 6.0);
        let first = |direction: Vec3| {
            tracer.closest(&Ray { origin: between, direction, t_max: 1.0 }).map(|hit| hit.triangle)
        };
        assert_eq!(first(Vec3::ONE), Some(i as u32 + 1), "the layer after {i}");
        assert_eq!(first(-Vec3::ONE), Some(i as u32), "the layer before {i}");
    }
    assert!(!tracer.occluded(Vec3::ZERO, Vec3::ONE, 0.333), "before the first layer");
    assert!(!tracer.occluded(Vec3::ONE * 0.667, Vec3::ONE, 9.0), "after the last layer");
}

#[test]
fn faulty_triangles_are_refused() {
    let points = vec![Vec3::ZERO, Vec3::X, Vec3::new(0.0, f32::NAN, 0.0), Vec3::Y * 2e12];
    let vertices = points.len();
    for (bad, error) in [
        ([0, 1, 2], TraceError::Position { triangle: 1 }),
        ([0, 1, 3], TraceError::Position { triangle: 1 }),
        ([0, 1, 4], TraceError::IndexOutOfRange { triangle: 1, vertices }),
    ] {
        let result = Tracer::new(&list(points.clone(), vec![[0, 1, 1], bad]));
        assert_eq!(result.err(), Some(error), "triangle {bad:?}");
    }
}

#[test]
fn the_largest_and_very_small_scenes_work() {
    for size in [LARGEST_COORDINATE, 1e6, 1.0, 1e-6, 1e-15] {
        let triangle = list(vec![Vec3::X * size, Vec3::Y * size, Vec3::Z * size], vec![[0, 1, 2]]);
        let tracer = tracer(&triangle);
        let corner = Vec3::ZERO;
        assert!(tracer.occluded(corner, Vec3::ONE, f32::INFINITY), "size {size}: hit");
        assert!(tracer.occluded(corner, Vec3::ONE * size, 0.34), "size {size}: hit at a third");
        assert!(!tracer.occluded(corner, Vec3::ONE * size, 0.33), "size {size}: ends before");
        assert!(!tracer.occluded(corner, -Vec3::ONE, f32::INFINITY), "size {size}: behind");
        assert!(!tracer.occluded(corner, Vec3::new(1.0, 1.0, -1.0), 1e30), "size {size}: beside");
    }
}

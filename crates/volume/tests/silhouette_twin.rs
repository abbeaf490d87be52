//! Silhouettes by edge counters, in f64, against the containment of points in the volume of each triangle.

use antumbra_gpu::Edges;
use antumbra_scene::generate::{self, shapes};
use antumbra_scene::{Mesh, Triangles};
use antumbra_volume::silhouette::twin::{
    cap_crossing, contains, determinant, side_crossing, weights,
};
use glam::{DVec3, DVec4, Vec3};

/// SplitMix64 (Steele, Lea, Flood 2014), as numbers in [-1, 1).
struct Random(u64);

impl Random {
    fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    fn next(&mut self) -> f64 {
        (self.bits() >> 11) as f64 * 0.5f64.powi(52) - 1.0
    }

    fn vector(&mut self) -> DVec3 {
        DVec3::new(self.next(), self.next(), self.next())
    }
}

/// A mesh under a light.
struct Lit {
    corners: Vec<[DVec3; 3]>,
    ends: Vec<[DVec3; 2]>,
    sides: Vec<i32>,
    weights: Vec<i32>,
    light: DVec4,
}

impl Lit {
    fn new(positions: &[Vec3], triangles: &[[u32; 3]], light: DVec4) -> Self {
        let point = |i: u32| positions[i as usize].as_dvec3();
        let corners: Vec<_> = triangles.iter().map(|t| t.map(point)).collect();
        let side = |c: &[DVec3; 3]| match determinant(light, *c) {
            d if d > 0.0 => 1,
            d if d < 0.0 => -1,
            _ => 0,
        };
        let sides: Vec<i32> = corners.iter().map(side).collect();
        let edges = Edges::new(positions, triangles);
        let ends = edges.vertices.iter().map(|e| e.map(point)).collect();
        Self { weights: weights(&edges, &sides), corners, ends, sides, light }
    }

    fn of(mesh: &Mesh, light: DVec4) -> Self {
        Self::new(&mesh.positions, &mesh.triangles, light)
    }

    /// Volumes around `p`: the truth.
    fn around(&self, p: DVec3) -> i32 {
        self.corners.iter().map(|c| i32::from(contains(self.light, *c, p))).sum()
    }

    /// The change of that from `from` to `to`, by what silhouettes and caps say.
    fn change(&self, from: DVec3, to: DVec3) -> i32 {
        let sides = self.ends.iter().zip(&self.weights).filter(|(_, w)| **w != 0);
        let caps = self.corners.iter().zip(&self.sides).filter(|(_, s)| **s != 0);
        sides.map(|(e, w)| w * side_crossing(self.light, *e, from, to)).sum::<i32>()
            + caps.map(|(c, s)| cap_crossing(*s, *c, from, to)).sum::<i32>()
    }

    /// A point behind one of the triangles that cast, as the light sees it.
    fn behind(&self, random: &mut Random) -> DVec3 {
        let casting = self.corners.iter().zip(&self.sides).filter(|(_, side)| **side != 0);
        let corners: Vec<_> = casting.map(|(corners, _)| *corners).collect();
        if corners.is_empty() {
            return random.vector();
        }
        let [a, b, c] = corners[random.bits() as usize % corners.len()];
        let (u, v) = (random.next().abs(), random.next().abs());
        let q = a + (b - a) * u * 0.5 + (c - a) * v * 0.5;
        q + (self.light.w * q - self.light.truncate()) * random.next().abs()
    }

    fn silhouette(&self) -> usize {
        self.weights.iter().filter(|w| **w != 0).count()
    }
}

fn lights(random: &mut Random) -> [DVec4; 2] {
    let far = (random.vector() * 4.0).extend(1.0);
    [far, random.vector().normalize().extend(0.0)]
}

/// Compares between random points and points behind triangles, and gives how many of them tell anything.
fn check(name: &str, mesh: &Mesh, random: &mut Random, pairs: usize) -> usize {
    let mut seen = 0;
    for light in lights(random) {
        let lit = Lit::of(mesh, light);
        for _ in 0..pairs {
            let (eye, p) = (random.vector() * 3.0, lit.behind(random));
            let truth = lit.around(p) - lit.around(eye);
            assert_eq!(lit.change(eye, p), truth, "{name}, light {light}, from {eye} to {p}");
            seen += usize::from(truth != 0);
        }
    }
    seen
}

#[test]
fn on_random_soups_silhouettes_count_the_volumes_around_every_point() {
    let mut random = Random(7);
    let mut seen = 0;
    for round in 0..200 {
        // Nine triangles over eight vertices share edges in every way, and wind as they like.
        let positions = (0..8).map(|_| random.vector().as_vec3()).collect();
        let corner = |random: &mut Random| (random.bits() % 8) as u32;
        let triangles = (0..9).map(|_| [0; 3].map(|_| corner(&mut random))).collect();
        let soup = Mesh { name: String::new(), positions, triangles };
        seen += check(&format!("soup {round}"), &soup, &mut random, 20);
    }
    assert!(seen > 2000, "only {seen} of 8000 pairs of points tell anything");
}

#[test]
fn on_open_twisted_and_branching_meshes_too() {
    let mut random = Random(8);
    let mut hemisphere = shapes::icosphere(2, 1.0);
    let above = |t: &[u32; 3]| t.iter().all(|&i| hemisphere.positions[i as usize].y >= 0.0);
    hemisphere.triangles = hemisphere.triangles.iter().copied().filter(above).collect();
    for (name, mesh) in [
        ("three pages", generate::pages(3)),
        ("four pages", generate::pages(4)),
        ("a triangle", generate::pages(1)),
        ("a Moebius strip", generate::moebius(64, 1.0, 0.4)),
        ("a hemisphere", hemisphere),
        ("a sphere", shapes::icosphere(2, 1.0)),
    ] {
        let seen = check(name, &mesh, &mut random, 1000);
        assert!(seen > 100, "{name}: only {seen} of 2000 pairs of points tell anything");
    }
}

#[test]
fn a_wrong_weight_is_noticed() {
    let mut random = Random(9);
    let mut lit = Lit::of(&generate::pages(3), DVec4::new(3.0, 4.0, 0.5, 1.0));
    lit.weights[0] -= 1;
    let pairs = (0..2000).map(|_| (random.vector() * 3.0, random.vector() * 3.0));
    let wrong =
        pairs.filter(|(a, b)| lit.change(*a, *b) != lit.around(*b) - lit.around(*a)).count();
    assert!(wrong > 10, "only {wrong} of 2000 ways notice a weight that is off by one");
}

#[test]
fn weights_are_those_of_the_rule() {
    let light = DVec4::new(0.3, 10.0, 0.2, 1.0);
    let by_weight = |lit: &Lit| {
        let mut count = std::collections::BTreeMap::new();
        lit.weights.iter().for_each(|w| *count.entry(w.abs()).or_insert(0) += 1);
        count.into_iter().collect::<Vec<_>>()
    };
    // A sheet: its diagonal cancels, its border counts once.
    assert_eq!(by_weight(&Lit::of(&shapes::floor(1.0), light)), [(0, 1), (1, 4)], "a sheet");
    // A closed body: its silhouette counts twice and all else cancels.
    let sphere = Lit::of(&shapes::icosphere(2, 1.0), light);
    let count = by_weight(&sphere);
    assert_eq!(count.iter().map(|c| c.0).collect::<Vec<_>>(), [0, 2], "a closed body");
    assert_eq!(sphere.silhouette(), count[1].1, "the silhouette is what counts");
    // Two triangles at one place, wound against each other: one sheet, twice.
    let mut double = generate::pages(1);
    double.triangles.push([2, 1, 0]);
    assert_eq!(by_weight(&Lit::of(&double, light)), [(2, 3)], "a double sheet");
}

/// HC-19: the number of triangles around the spine that show the light one side or the other decides the weight
/// of the spine.
#[test]
fn three_pages_give_their_spine_an_odd_weight_under_every_light() {
    for step in 0..12 {
        // Off the pages' planes, which stand at multiples of 30 degrees.
        let azimuth = (f64::from(step) * 30.0 + 10.0).to_radians();
        let light = DVec4::new(azimuth.cos(), azimuth.sin(), 0.1, 0.0).normalize_or_zero();
        let light = DVec4::new(light.x, light.y, light.z, 0.0);
        for (pages, expected) in [(3, [1, 1]), (4, [0, 0]), (1, [1, 1])] {
            let lit = Lit::of(&generate::pages(pages), light);
            // A page at angle t shows its front where the light is within 180 degrees ahead of it.
            let sum: f64 = (0..pages)
                .map(|i| std::f64::consts::TAU * f64::from(i) / f64::from(pages))
                .map(|t| (azimuth - t).sin().signum())
                .sum();
            assert_eq!(lit.weights[0], sum as i32, "{pages} pages at {azimuth}");
            assert_eq!(lit.weights[0].abs(), expected[0], "{pages} pages at {azimuth}");
        }
    }
}

/// The sides of all volumes together are closed: at every vertex as much arrives as leaves.
#[test]
fn weights_balance_at_every_vertex() {
    let mut random = Random(10);
    for entry in generate::ALL {
        let scene = (entry.1)();
        let Triangles { positions, triangles, .. } =
            scene.triangles(scene.origin()).expect("a sound scene");
        if triangles.len() > 20_000 {
            continue;
        }
        let edges = Edges::new(&positions, &triangles);
        for light in lights(&mut random) {
            let lit = Lit::new(&positions, &triangles, light);
            let mut balance = vec![0; positions.len()];
            for ([from, to], weight) in edges.vertices.iter().zip(&lit.weights) {
                balance[*from as usize] -= weight;
                balance[*to as usize] += weight;
            }
            assert!(balance.iter().all(|b| *b == 0), "{}: silhouettes are open", entry.0);
        }
    }
}

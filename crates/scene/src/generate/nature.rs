//! A tree, grass, hair, terrain.

use std::f64::consts::{PI, TAU};

use glam::{DAffine3, DVec3};

use super::random::Random;
use super::{empty, look, shapes};
use crate::light::{basis, towards_sky};
use crate::{Light, Mesh, Scene};

/// Numbers of [`tree`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Tree {
    /// Generations of branches after the trunk, at most 8. Default 6.
    pub generations: u32,
    /// Branches that a branch ends in, at most 4. Default 3: 3^6 = 729 twigs.
    pub branches: u32,
    /// Leaves around the end of each twig. Default 12.
    pub leaves: u32,
    /// Seed of the random directions. Default 1.
    pub seed: u64,
}

impl Default for Tree {
    fn default() -> Self {
        Self { generations: 6, branches: 3, leaves: 12, seed: 1 }
    }
}

/// A fractal tree about 6 m high on a floor: closed six-sided branches, each 0.68 of its parent in
/// length and half of it in thickness at its far end, and square leaves of two triangles.
#[must_use]
pub fn tree(numbers: &Tree) -> Scene {
    let mut random = Random(numbers.seed);
    let mut wood = Mesh::default().named("wood");
    let mut leaves = Mesh::default().named("leaves");
    let numbers = Tree {
        generations: numbers.generations.min(8),
        branches: numbers.branches.min(4),
        ..*numbers
    };
    // Start, direction, length, radius, generation.
    let mut growing = vec![(DVec3::ZERO, DVec3::Y, 2.0, 0.15, 0)];
    while let Some((start, direction, length, radius, generation)) = growing.pop() {
        let end = start + length * direction;
        // Half as thick at a child's far end as at its parent's: a factor of sqrt(1/2) a branch.
        let tip = radius * 0.5_f64.sqrt();
        wood.append(&shapes::frustum(start, end, radius, tip, 6));
        if generation == numbers.generations {
            for _ in 0..numbers.leaves {
                leaves.append(&leaf(end, length, &mut random));
            }
            continue;
        }
        let (u, v) = basis(direction);
        let turn = random.between(0.0, TAU);
        for branch in 0..numbers.branches {
            let around = turn + TAU * f64::from(branch) / f64::from(numbers.branches);
            let spread = random.between(0.45, 0.75);
            let sideways = around.cos() * u + around.sin() * v;
            let out = spread.cos() * direction + spread.sin() * sideways;
            let shorter = 0.68 * length * random.between(0.9, 1.1);
            growing.push((end, out.normalize(), shorter, tip, generation + 1));
        }
    }
    let mut scene = empty("tree");
    scene.add(shapes::floor(12.0), DAffine3::IDENTITY);
    scene.add(wood, DAffine3::IDENTITY);
    if !leaves.triangles.is_empty() {
        scene.add(leaves, DAffine3::IDENTITY);
    }
    scene.camera = Some(look([6.0, 5.0, 11.0], [0.5, 2.2, 0.0], 0.1));
    scene.lights = vec![Light::sun(50_f64.to_radians(), -40_f64.to_radians(), 0.0)];
    scene
}

/// A square of 8 cm within a ball around the twig's end, turned any way.
fn leaf(end: DVec3, reach: f64, random: &mut Random) -> Mesh {
    let (normal, offset) = (random_direction(random), random_direction(random));
    let (u, v) = basis(normal);
    shapes::quad(end + reach * random.unit() * offset, 0.04 * u, 0.04 * v)
}

/// Uniform over the sphere: its zones of equal height have equal area (Archimedes).
fn random_direction(random: &mut Random) -> DVec3 {
    let y = random.between(-1.0, 1.0);
    towards_sky(y.asin(), random.between(0.0, TAU))
}

/// Numbers of [`grass`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grass {
    /// Number of blades, 5 triangles each. Default 8000.
    pub blades: u32,
    /// Half side of the square they grow on, metres. Default 2: 500 blades a square metre.
    pub half: f64,
    /// Seed of places and shapes. Default 2.
    pub seed: u64,
}

impl Default for Grass {
    fn default() -> Self {
        Self { blades: 8000, half: 2.0, seed: 2 }
    }
}

/// A field of bent, pointed blades, 0.2 m to 0.4 m long and 6 mm to 10 mm wide, on a floor.
#[must_use]
pub fn grass(numbers: &Grass) -> Scene {
    let mut random = Random(numbers.seed);
    let mut field = Mesh::default().named("grass");
    for _ in 0..numbers.blades {
        let x = random.between(-numbers.half, numbers.half);
        let z = random.between(-numbers.half, numbers.half);
        let length = random.between(0.2, 0.4);
        let half_width = random.between(0.003, 0.005);
        let lean = towards_sky(0.0, random.between(0.0, TAU));
        let side = lean.cross(DVec3::Y);
        let bend = random.between(0.1, 0.6);
        // A circular arc that starts upright and turns by `bend` in each third.
        let mut rib = vec![DVec3::new(x, 0.0, z)];
        for third in 0..3 {
            let angle = bend * f64::from(third);
            let step = length / 3.0 * (angle.cos() * DVec3::Y + angle.sin() * lean);
            rib.push(rib[third as usize] + step);
        }
        let widths = [half_width, 0.9 * half_width, 0.6 * half_width, 0.0];
        field.append(&ribbon(&rib, |i| widths[i] * side));
    }
    let mut scene = empty("grass");
    scene.add(shapes::floor(2.0 * numbers.half), DAffine3::IDENTITY);
    scene.add(field, DAffine3::IDENTITY);
    let away = numbers.half / 2.0;
    scene.camera = Some(look([away, 1.2 * away, 3.2 * away], [0.0, 0.1, 0.4 * away], 0.02));
    scene.lights = vec![Light::sun(40_f64.to_radians(), -60_f64.to_radians(), 0.0)];
    scene
}

/// Quads along `rib`, `half(i)` to both sides of its i-th point; where the last has no width, the
/// ribbon ends in a triangle.
fn ribbon(rib: &[DVec3], half: impl Fn(usize) -> DVec3) -> Mesh {
    let mut mesh = Mesh::default();
    for (i, &p) in rib.iter().enumerate() {
        let half = half(i);
        let here = mesh.positions.len() as u32;
        if half == DVec3::ZERO {
            mesh.positions.push(p.as_vec3());
            mesh.triangles.push([here - 2, here - 1, here]);
            break;
        }
        mesh.positions.extend([(p - half).as_vec3(), (p + half).as_vec3()]);
        if i > 0 {
            mesh.triangles.extend([[here - 2, here - 1, here + 1], [here - 2, here + 1, here]]);
        }
    }
    mesh
}

/// Numbers of [`hair`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hair {
    /// Number of ribbons. Default 900.
    pub strands: u32,
    /// Quads along each. Default 16: 28,800 triangles.
    pub segments: u32,
    /// Width of a ribbon, metres. Default 0.002, several real hairs.
    pub width: f64,
    /// Seed of directions and curls. Default 3.
    pub seed: u64,
}

impl Default for Hair {
    fn default() -> Self {
        Self { strands: 900, segments: 16, width: 0.002, seed: 3 }
    }
}

/// Ribbons 0.25 m long, grown from the upper part of a ball of radius 0.1 m and bent down by their
/// weight around it, over a floor.
#[must_use]
pub fn hair(numbers: &Hair) -> Scene {
    const HEAD: f64 = 0.1;
    const LENGTH: f64 = 0.25;
    let mut random = Random(numbers.seed);
    let center = DVec3::new(0.0, 0.35, 0.0);
    let segments = numbers.segments.max(1);
    let step = LENGTH / f64::from(segments);
    let mut strands = Mesh::default().named("hair");
    for _ in 0..numbers.strands {
        // From straight up to 10 degrees above the horizon.
        let height = random.between(10_f64.to_radians().sin(), 1.0).asin();
        let out = towards_sky(height, random.between(0.0, TAU));
        let side = out.cross(random_direction(&mut random)).normalize_or(basis(out).0);
        // A strand turns from its root's direction to straight down at its own rate, and its layer
        // keeps it off the head by up to 2 cm.
        let weight = random.between(30.0, 60.0) * step;
        let clearance = HEAD + random.between(0.001, 0.02);
        let mut rib = vec![center + HEAD * out];
        let mut direction = out;
        for i in 0..segments as usize {
            direction = (direction + weight * DVec3::NEG_Y).normalize_or(DVec3::NEG_Y);
            let next = rib[i] + step * direction;
            let from_center = next - center;
            let distance = from_center.length();
            rib.push(if distance < clearance {
                center + from_center * (clearance / distance)
            } else {
                next
            });
        }
        strands.append(&ribbon(&rib, |_| 0.5 * numbers.width * side));
    }
    let mut scene = empty("hair");
    scene.add(shapes::floor(1.0), DAffine3::IDENTITY);
    scene.add(shapes::icosphere(3, HEAD).named("head"), DAffine3::from_translation(center));
    scene.add(strands, DAffine3::IDENTITY);
    scene.camera = Some(look([0.35, 0.6, 0.75], [0.03, 0.25, 0.0], 0.01));
    scene.lights = vec![Light::sun(50_f64.to_radians(), -40_f64.to_radians(), 0.0)];
    scene
}

/// Numbers of [`terrain`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Terrain {
    /// Quads along one side, at most 2048. Default 128: 32,768 triangles.
    pub cells: u32,
    /// Half side of the square, metres. Default 100.
    pub half: f64,
    /// Height above and depth below the mean that no hill or valley reaches, metres. Default 30.
    pub height: f64,
    /// Seed of the hills. Default 4.
    pub seed: u64,
}

impl Default for Terrain {
    fn default() -> Self {
        Self { cells: 128, half: 100.0, height: 30.0, seed: 4 }
    }
}

/// Hills as one mesh over a square, under a sun 25 degrees high: a sum of six octaves of smooth
/// value noise, each half as long and a third as high (2^-1.5) as the one before.
#[must_use]
pub fn terrain(numbers: &Terrain) -> Scene {
    let cells = numbers.cells.clamp(1, 2048);
    let at = |i: u32| (2.0 * f64::from(i) / f64::from(cells) - 1.0) * numbers.half;
    let mut mesh = Mesh::default().named("terrain");
    for row in 0..=cells {
        for column in 0..=cells {
            let (u, v) = (f64::from(column) / f64::from(cells), f64::from(row) / f64::from(cells));
            let y = numbers.height * hills(u, v, numbers.seed);
            mesh.positions.push(DVec3::new(at(column), y, at(row)).as_vec3());
        }
    }
    for row in 0..cells {
        for column in 0..cells {
            let here = row * (cells + 1) + column;
            let below = here + cells + 1;
            mesh.triangles.extend([[here, below, below + 1], [here, below + 1, here + 1]]);
        }
    }
    let mut scene = empty("terrain");
    scene.add(mesh, DAffine3::IDENTITY);
    let half = numbers.half;
    let eye = [0.6 * half, 1.1 * numbers.height + 0.4 * half, 1.4 * half];
    scene.camera = Some(look(eye, [0.0, 0.0, 0.0], 0.005 * half));
    scene.lights = vec![Light::sun(25_f64.to_radians(), -70_f64.to_radians(), 0.0)];
    scene
}

/// The sum of six octaves at (u, v) in the unit square, in (-1, 1); four of the largest hills along
/// a side. Each octave is half as long and 2^-1.5 as high as the one before, so that slopes lessen
/// with size; the factor makes the sum of all heights less than 1.
fn hills(u: f64, v: f64, seed: u64) -> f64 {
    let ratio = (-1.5_f64).exp2();
    (0..6)
        .map(|octave| {
            let scale = 4.0 * f64::from(1 << octave);
            let noise = value_noise(scale * u, scale * v, seed.wrapping_add(octave as u64));
            (1.0 - ratio) * ratio.powi(octave) * noise
        })
        .sum()
}

/// Random values in [-1, 1) on the integer lattice, joined by half a cosine wave along each axis.
fn value_noise(x: f64, y: f64, seed: u64) -> f64 {
    let corner = |i: f64, j: f64| {
        // The mixing step of SplitMix64 spreads neighbouring lattice points over all values.
        let lattice = (i as u64) << 32 | (j as u64);
        Random(Random(lattice ^ seed << 56).bits()).between(-1.0, 1.0)
    };
    let (i, j) = (x.floor(), y.floor());
    let blend = |t: f64, a: f64, b: f64| a + (b - a) * 0.5 * (1.0 - (PI * t).cos());
    let near = blend(x - i, corner(i, j), corner(i + 1.0, j));
    let far = blend(x - i, corner(i, j + 1.0), corner(i + 1.0, j + 1.0));
    blend(y - j, near, far)
}

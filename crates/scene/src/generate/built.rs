//! Architecture: an arcade hall and a street.

use std::f64::consts::PI;

use glam::{DAffine3, DVec3};

use super::random::Random;
use super::{empty, look, shapes};
use crate::{Light, Mesh, Scene};

fn block(min: [f64; 3], max: [f64; 3]) -> Mesh {
    shapes::cuboid(DVec3::from_array(min), DVec3::from_array(max))
}

/// A hall 40 m long, 12 m wide, 7 m high, with two rows of columns and arches along it, closed walls,
/// and a roof with openings over its nave.
///
/// Columns stand at x = +-3, every 4 m from z = -18 to 18: base and capital 0.8 m wide, shaft of
/// radius 0.3 m, top at 4 m. Arches between them have an inner radius of 1.6 m, an outer of 2 m, and
/// carry beams up to the roof at 7 m. The roof's openings are |x| <= 2.5 wide and 2 m long, every 4 m.
/// The sun stands 65 degrees high; a point light hangs in the nave.
#[must_use]
pub fn hall() -> Scene {
    let mut scene = empty("hall");
    scene.add(block([-6.5, -0.3, -20.5], [6.5, 0.0, 20.5]).named("floor"), DAffine3::IDENTITY);

    let mut walls = Mesh::default().named("walls");
    for (min, max) in [
        ([-6.5, 0.0, -20.5], [-6.0, 7.0, 20.5]),
        ([6.0, 0.0, -20.5], [6.5, 7.0, 20.5]),
        ([-6.0, 0.0, -20.5], [6.0, 7.0, -20.0]),
        ([-6.0, 0.0, 20.0], [6.0, 7.0, 20.5]),
    ] {
        walls.append(&block(min, max));
    }
    scene.add(walls, DAffine3::IDENTITY);

    // Closed over the aisles; over the nave bars of 2 m, at z = -20 .. -18, -16 .. -14, and so on.
    let mut roof = Mesh::default().named("roof");
    roof.append(&block([-6.5, 7.0, -20.5], [-2.5, 7.3, 20.5]));
    roof.append(&block([2.5, 7.0, -20.5], [6.5, 7.3, 20.5]));
    for bar in 0..10 {
        let z = 4.0 * f64::from(bar) - 20.0;
        roof.append(&block([-2.5, 7.0, z], [2.5, 7.3, z + 2.0]));
    }
    scene.add(roof, DAffine3::IDENTITY);

    let column = column();
    let (shared, arch) = (scene.meshes.len(), arch());
    scene.meshes.extend([column, arch]);
    for x in [-3.0, 3.0] {
        for number in 0..10 {
            let z = 4.0 * f64::from(number) - 18.0;
            place(&mut scene, shared, "column", DVec3::new(x, 0.0, z));
            if number < 9 {
                place(&mut scene, shared + 1, "arch", DVec3::new(x, 4.0, z + 2.0));
            }
        }
        let beam = block([x - 0.3, 6.0, -20.0], [x + 0.3, 7.0, 20.0]).named("beam");
        scene.add(beam, DAffine3::IDENTITY);
    }
    scene.camera = Some(look([1.2, 1.7, 18.5], [-0.6, 2.2, 0.0], 0.1));
    scene.lights = vec![
        Light::sun(65_f64.to_radians(), 60_f64.to_radians(), 0.0),
        Light::Point { position: DVec3::new(0.5, 4.5, 2.5) },
    ];
    scene
}

fn place(scene: &mut Scene, mesh: usize, name: &str, at: DVec3) {
    let transform = DAffine3::from_translation(at);
    scene.instances.push(crate::Instance { name: name.to_owned(), mesh, transform });
}

fn column() -> Mesh {
    let mut column = Mesh::default().named("column");
    column.append(&block([-0.4, 0.0, -0.4], [0.4, 0.3, 0.4]));
    let (foot, head) = (DVec3::new(0.0, 0.3, 0.0), DVec3::new(0.0, 3.7, 0.0));
    column.append(&shapes::frustum(foot, head, 0.3, 0.27, 24));
    column.append(&block([-0.4, 3.7, -0.4], [0.4, 4.0, 0.4]));
    column
}

/// Half a ring around the x axis, upwards, in twelve closed stones.
fn arch() -> Mesh {
    const STONES: u32 = 12;
    let mut arch = Mesh::default().named("arch");
    for stone in 0..STONES {
        let angle = |i: u32| PI * f64::from(i) / f64::from(STONES);
        let corners = std::array::from_fn(|i| {
            let (sin, cos) = angle(stone + (i as u32 >> 2 & 1)).sin_cos();
            let radius = if i & 2 == 0 { 1.6 } else { 2.0 };
            let x = if i & 1 == 0 { 0.3 } else { -0.3 };
            DVec3::new(x, radius * sin, radius * cos)
        });
        arch.append(&shapes::hexahedron(corners));
    }
    arch
}

/// A straight street, 400 m of houses on both sides of 14 m, seen from its middle at a height of
/// 1.7 m; lamp posts of radius 6 cm every 25 m and parked cars of two boxes give it casters of every
/// size. The sun stands 40 degrees high behind the camera and to its right, so that a house of height h
/// shadows h sin(25 degrees) / tan(40 degrees) = h / 2 of the street's width.
#[must_use]
pub fn street() -> Scene {
    const LENGTH: f64 = 400.0;
    let mut random = Random(5);
    let mut scene = empty("street");
    let ground = shapes::quad(DVec3::ZERO, 0.55 * LENGTH * DVec3::Z, 40.0 * DVec3::X);
    scene.add(ground.named("ground"), DAffine3::IDENTITY);
    let post = shapes::cylinder(0.06, 6.0, 12).named("lamp post");
    let shared = scene.meshes.len();
    scene.meshes.extend([post, car()]);
    for side in [-1.0, 1.0] {
        let mut houses = Mesh::default().named("houses");
        let mut z = -0.5 * LENGTH;
        while z < 0.5 * LENGTH - 8.0 {
            let end = (z + random.between(8.0, 20.0)).min(0.5 * LENGTH);
            let depth = random.between(9.0, 14.0);
            let height = random.between(6.0, 24.0);
            let (near, far) = (7.0 * side, (7.0 + depth) * side);
            houses.append(&block([near.min(far), 0.0, z], [near.max(far), height, end]));
            // Every fourth gap is an alley through which the sun reaches the street.
            z = end + if random.unit() < 0.25 { 3.0 } else { 0.0 };
        }
        scene.add(houses, DAffine3::IDENTITY);
        for number in 0..16 {
            let at = 25.0 * f64::from(number) - 0.5 * LENGTH + 12.5;
            place(&mut scene, shared, "lamp post", DVec3::new(5.2 * side, 0.0, at));
            if random.unit() < 0.7 {
                let along = random.between(4.0, 20.0);
                place(&mut scene, shared + 1, "car", DVec3::new(3.8 * side, 0.0, at + along));
            }
        }
    }
    let near_end = 0.5 * LENGTH - 5.0;
    scene.camera = Some(look([0.0, 1.7, near_end], [0.0, 3.0, near_end - 30.0], 0.1));
    scene.lights = vec![Light::sun(40_f64.to_radians(), 25_f64.to_radians(), 0.0)];
    scene
}

/// A body on a gap of 0.25 m above the street, and a cabin.
fn car() -> Mesh {
    let mut car = block([-0.9, 0.25, -2.2], [0.9, 0.9, 2.2]).named("car");
    car.append(&block([-0.75, 0.9, -1.2], [0.75, 1.45, 1.0]));
    car
}

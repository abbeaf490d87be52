//! HC-28: what goes on downstairs is nothing to the shadows upstairs.

use antumbra_gpu::{Gpu, Technique};
use antumbra_scene::generate::shapes;
use antumbra_scene::{Camera, Light, Scene};
use glam::{DAffine3, DVec3};

use super::unit_cube;
use crate::{MeasureError, Stage};

/// Side of the view, samples.
const VIEW: u32 = 128;
/// Cubes downstairs.
const CUBES: usize = 1000;
/// Height of the upper floor, metres.
const UPSTAIRS: f64 = 3.15;

/// Two floors of 20 m and 0.3 m thick around the heights 0 and 3, with a hole for stairs in the upper one; posts
/// upstairs, and cubes downstairs if it is `full`.
fn house(full: bool) -> Scene {
    let mut scene = Scene::default();
    let mut slab = |y: f64, low: [f64; 2], high: [f64; 2]| {
        let low = DVec3::new(low[0], y - 0.15, low[1]);
        let high = DVec3::new(high[0], y + 0.15, high[1]);
        scene.add(shapes::cuboid(low, high), DAffine3::IDENTITY);
    };
    slab(0.0, [-10.0, -10.0], [10.0, 10.0]);
    slab(3.0, [-10.0, -10.0], [6.0, 10.0]);
    slab(3.0, [9.0, -10.0], [10.0, 10.0]);
    slab(3.0, [6.0, -10.0], [9.0, -1.5]);
    slab(3.0, [6.0, 1.5], [9.0, 10.0]);
    for [a, b, c] in unit_cube(12) {
        let foot = DVec3::new(12.0 * a - 8.0, UPSTAIRS, 16.0 * b - 8.0);
        let top = DVec3::new(0.4, 0.5 + c, 0.4);
        scene.add(shapes::cuboid(foot, foot + top), DAffine3::IDENTITY);
    }
    if full {
        for [a, b, c] in unit_cube(CUBES) {
            let low = DVec3::new(18.0 * a - 9.0, 0.15 + 2.3 * b, 18.0 * c - 9.0);
            scene.add(shapes::cuboid(low, low + 0.3), DAffine3::IDENTITY);
        }
    }
    scene
}

/// The share of the samples upstairs that the cubes downstairs change, under a lamp upstairs.
pub(super) fn downstairs(gpu: &Gpu, technique: &mut dyn Technique) -> Result<f64, MeasureError> {
    let camera = Camera {
        eye: DVec3::new(-9.0, UPSTAIRS + 1.7, 9.0),
        target: DVec3::new(0.0, UPSTAIRS, 0.0),
        up: DVec3::Y,
        fov_y: 60_f64.to_radians(),
        near: 0.05,
    };
    let light = Light::Point { position: DVec3::new(0.0, 5.5, 0.0) };
    let mut shoot = |full| {
        let stage = Stage::new(gpu, &house(full), camera, VIEW, VIEW)?;
        let seen = stage.shoot(gpu, &light, technique, 0)?.visibility;
        let heights = stage.image.positions.iter().zip(&stage.image.normals);
        let upstairs = heights.map(|(p, n)| {
            let height = stage.triangles.origin.y + f64::from(p.y);
            n.length_squared() > 0.0 && height > UPSTAIRS - 1e-3
        });
        Ok::<_, MeasureError>(upstairs.zip(seen).collect::<Vec<_>>())
    };
    let (full, empty) = (shoot(true)?, shoot(false)?);
    let upstairs = || full.iter().zip(&empty).filter(|((a, _), (b, _))| *a && *b);
    let changed = upstairs().filter(|((_, a), (_, b))| a != b).count();
    Ok(changed as f64 / upstairs().count() as f64)
}

//! Casters about as thick as a texel.

use glam::{DAffine3, DVec3};

use super::{empty, look, shapes};
use crate::{Light, Mesh, Scene};

/// Thicknesses that the scenes show side by side, texels, from left (-x) to right.
pub const THICKNESSES: [f64; 7] = [0.3, 0.5, 0.7, 1.0, 1.5, 2.0, 3.0];

/// Half side of the floor.
const FLOOR_HALF: f64 = 10.0;

/// The shadow map that thicknesses are counted in.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ThinCasters {
    /// Texels along one side of the map. Default 1024.
    pub map_size: u32,
    /// Width of what the map covers, across the light, metres. Default 20. It makes a texel of
    /// 20 / 1024 = 0.0195 m.
    pub extent: f64,
}

impl Default for ThinCasters {
    fn default() -> Self {
        Self { map_size: 1024, extent: 20.0 }
    }
}

impl ThinCasters {
    /// Side of a texel, metres.
    #[must_use]
    pub fn texel(&self) -> f64 {
        self.extent / f64::from(self.map_size)
    }
}

fn stage(name: &str) -> Scene {
    let mut scene = empty(name);
    scene.add(shapes::floor(FLOOR_HALF), DAffine3::IDENTITY);
    scene.camera = Some(look([3.0, 6.5, 13.0], [0.0, 0.3, 0.5], 0.1));
    // Over -z, so that shadows fall towards the camera, and 20 degrees off the axis.
    scene.lights = vec![Light::sun(45_f64.to_radians(), 160_f64.to_radians(), 0.0)];
    scene
}

/// Picket fences 1 m high on a floor, one panel 2 m wide for each of `thicknesses` (texels, > 0), in
/// a row along x. Pickets are square bars as far apart as they are thick, so that each panel hides
/// half of the light that comes straight at it. A bar across the light is a texel wide where its
/// thickness is 1.
#[must_use]
pub fn fence(map: &ThinCasters, thicknesses: &[f64]) -> Scene {
    const WIDTH: f64 = 2.0;
    const GAP: f64 = 0.5;
    let mut scene = stage("fence");
    let row = thicknesses.len() as f64 * (WIDTH + GAP) - GAP;
    // The whole row of the registered scene, 17 m, in a square picture.
    scene.camera = Some(look([0.0, 8.0, 18.0], [0.0, 0.0, 1.0], 0.1));
    for (number, &texels) in thicknesses.iter().enumerate() {
        let thick = texels * map.texel();
        let left = number as f64 * (WIDTH + GAP) - 0.5 * row;
        let mut panel = Mesh::default().named(format!("pickets of {texels} texels"));
        let pickets = (0.5 * WIDTH / thick) as u32;
        for picket in 0..pickets {
            let x = left + 2.0 * thick * f64::from(picket);
            panel.append(&shapes::cuboid(
                DVec3::new(x, 0.0, -0.5 * thick),
                DVec3::new(x + thick, 1.0, 0.5 * thick),
            ));
        }
        scene.add(panel, DAffine3::IDENTITY);
    }
    scene
}

/// Wires 4 m long, 1 m above a floor at 30 degrees to the x axis, 1 m apart along z, one for each of
/// `thicknesses`: its diameter in texels, > 0. Each is a prism of 8 sides around the axis.
#[must_use]
pub fn wires(map: &ThinCasters, thicknesses: &[f64]) -> Scene {
    let mut scene = stage("wires");
    let (sin, cos) = 30_f64.to_radians().sin_cos();
    let half = 2.0 * DVec3::new(cos, 0.0, sin);
    for (number, &texels) in thicknesses.iter().enumerate() {
        let radius = 0.5 * texels * map.texel();
        let z = number as f64 - 0.5 * (thicknesses.len() as f64 - 1.0);
        let middle = DVec3::new(0.0, 1.0, z);
        let wire = shapes::frustum(middle - half, middle + half, radius, radius, 8);
        scene.add(wire.named(format!("wire of {texels} texels")), DAffine3::IDENTITY);
    }
    scene
}

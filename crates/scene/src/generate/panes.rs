//! Casters that let a part of the light through.

use std::sync::Arc;

use glam::{DAffine3, DVec3, Vec2};

use super::{empty, look, shapes};
use crate::{AlphaMap, Light, Mesh, Opacity, Scene, Wrap};

/// Sheets of [`panes`] that each halve the light.
pub const PANES: usize = 10;

/// Adds `mesh`, which lets light through.
fn add(scene: &mut Scene, mesh: Mesh, opacity: Opacity) {
    scene.opacities.insert(scene.meshes.len(), Arc::new(opacity));
    scene.add(mesh, DAffine3::IDENTITY);
}

/// HC-36: ten level panes of opacity 1/2 over the floor y = 0, |x|, |z| <= 10, at heights of 1 m and every 10 cm above, and
/// beside them one of opacity 0.999 at 1 m. Pane k, from 0, covers k - 5 < x < 5 and |z| < 1, so that a sun overhead comes
/// through k + 1 of them where k - 5 < x < k - 4; the other one covers |x| < 1 and 2 < z < 4. The first light is that
/// sun.
#[must_use]
pub fn panes() -> Scene {
    let mut scene = empty("panes");
    scene.add(shapes::floor(10.0), DAffine3::IDENTITY);
    for k in 0..PANES {
        let low = k as f64 - 5.0;
        let center = DVec3::new(0.5 * (low + 5.0), 1.0 + 0.1 * k as f64, 0.0);
        let pane = shapes::quad(center, 0.5 * (5.0 - low) * DVec3::X, DVec3::Z).named("pane");
        let opacity = Opacity::uniform(0.5, pane.positions.len());
        add(&mut scene, pane, opacity);
    }
    let dark = shapes::quad(DVec3::new(0.0, 1.0, 3.0), DVec3::X, DVec3::Z).named("dark pane");
    let opacity = Opacity::uniform(0.999, dark.positions.len());
    add(&mut scene, dark, opacity);
    scene.camera = Some(look([0.0, 9.0, 9.0], [0.0, 0.0, 0.5], 0.1));
    scene.lights = vec![Light::Directional { direction: DVec3::NEG_Y, angular_diameter: 0.0 }];
    scene
}

/// Texels of the glass of [`stained_glass`] a side.
const GLASS: u32 = 96;

/// A window in a wall at z = 0, of 4 m by 4 m, with panes of glass of several opacities in a net of lead, and behind it
/// (z > 0) a floor with an opaque ball and a bottle, whose glass weakens the light where it enters and where it leaves.
/// The sun comes through the window.
#[must_use]
pub fn stained_glass() -> Scene {
    let mut scene = empty("stained-glass");
    scene.add(shapes::floor(10.0), DAffine3::IDENTITY);
    for side in [-1.0, 1.0] {
        let wall = shapes::cuboid(DVec3::new(2.0, 0.0, -0.2), DVec3::new(6.0, 5.5, 0.0));
        scene.add(wall, DAffine3::from_translation(DVec3::X * (4.0 * side - 4.0)));
    }
    let lintel = shapes::cuboid(DVec3::new(-2.0, 4.5, -0.2), DVec3::new(2.0, 5.5, 0.0));
    scene.add(lintel, DAffine3::IDENTITY);
    // Twelve by twelve lozenges of glass between bars of a texel, and around them a frame.
    let texel = |i: u32| -> u8 {
        let (x, y) = (i % GLASS, i / GLASS);
        let (along, across) = (x + y, x + GLASS - y);
        let bar = along % 16 == 0 || across % 16 == 0;
        let frame = x.min(y).min(GLASS - 1 - x).min(GLASS - 1 - y) < 2;
        // Opacities of 1/8 to 7/8 in no order that the eye would find.
        let pane = (5 * (along / 16) + 3 * (across / 16)) % 7 + 1;
        if bar || frame { 255 } else { (pane * 32 - 1) as u8 }
    };
    let alpha = AlphaMap {
        width: GLASS,
        height: GLASS,
        texels: (0..GLASS * GLASS).map(texel).collect(),
        wrap: [Wrap::Clamp; 2],
        nearest: false,
    };
    let glass = shapes::quad(DVec3::new(0.0, 2.5, -0.1), 2.0 * DVec3::X, 2.0 * DVec3::Y);
    let uv = vec![Vec2::Y, Vec2::ONE, Vec2::X, Vec2::ZERO];
    add(&mut scene, glass.named("window"), Opacity { uv, alpha: Arc::new(alpha), factor: 1.0 });
    let ball = shapes::icosphere(4, 0.5).named("ball");
    scene.add(ball, DAffine3::from_translation(DVec3::new(-1.2, 0.5, 3.2)));
    let bottle = shapes::cylinder(0.35, 1.4, 64).named("bottle");
    scene
        .opacities
        .insert(scene.meshes.len(), Arc::new(Opacity::uniform(0.3, bottle.positions.len())));
    scene.add(bottle, DAffine3::from_translation(DVec3::new(1.1, 0.0, 2.6)));
    scene.camera = Some(look([0.5, 6.5, 12.5], [0.0, 1.0, 3.0], 0.1));
    let direction = DVec3::new(0.15, -0.8, 1.0).normalize();
    scene.lights = vec![Light::Directional { direction, angular_diameter: 0.0 }];
    scene
}

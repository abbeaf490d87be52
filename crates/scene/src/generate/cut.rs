//! Casters with holes.

use std::sync::Arc;

use glam::{DAffine3, DVec2, DVec3, Vec2};

use super::basic::{lights_of_hc01, over_floor};
use super::{empty, look, shapes};
use crate::{AlphaMap, Cutout, Light, Scene, Wrap};

/// Texture coordinates of the corners of [`shapes::quad`]: u along `half_u`, v along `half_v`.
fn quad_uv() -> Vec<Vec2> {
    vec![Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y]
}

/// Alpha by the texel's middle, both coordinates in [-1, 1].
fn painted(side: u32, alpha: impl Fn(DVec2) -> f64) -> AlphaMap {
    let middle = |i: u32| (2.0 * f64::from(i) + 1.0) / f64::from(side) - 1.0;
    let texels = (0..side)
        .flat_map(|y| (0..side).map(move |x| DVec2::new(middle(x), middle(y))))
        .map(|p| (255.0 * alpha(p)).round().clamp(0.0, 255.0) as u8)
        .collect();
    AlphaMap { width: side, height: side, texels, wrap: [Wrap::Clamp; 2], nearest: false }
}

/// Numbers of [`leaf_card`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LeafCard {
    /// Height of the card above the floor, metres, > 0. Default 2.
    pub height: f64,
    /// Half of the card's side, metres, > 0. Default 1.
    pub half: f64,
    /// Radius of the leaf on it, as a share of `half`, in (0, 1). Default 0.8.
    pub radius: f64,
    /// Texels a side of its alpha. Default 256.
    pub texels: u32,
}

impl Default for LeafCard {
    fn default() -> Self {
        Self { height: 2.0, half: 1.0, radius: 0.8, texels: 256 }
    }
}

impl LeafCard {
    /// Texels over which alpha falls from 1 to 0: alpha is a distance from the edge, so that what is interpolated
    /// between texels is round.
    const BAND: f64 = 16.0;

    /// Bound on the distance of the leaf's edge from the circle, metres.
    ///
    /// Alpha is rounded to half of 1/255 at most, which is `BAND` / 510 texels. The distance from the middle is
    /// convex with second derivatives that add up to 1 / distance, so a bilinear mean over texels of side h exceeds it
    /// by up to h^2 / 8 of that, and never falls below it.
    #[must_use]
    pub fn accuracy(&self) -> f64 {
        let texel = 2.0 * self.half / f64::from(self.texels);
        Self::BAND / 510.0 * texel + texel * texel / (8.0 * self.half * self.radius)
    }
}

/// A level card over the middle of the floor y = 0, |x|, |z| <= 10, of which a disc is there: a leaf, whose shadow has a
/// closed form. Lights as those of HC-01.
#[must_use]
pub fn leaf_card(numbers: &LeafCard) -> Scene {
    let LeafCard { height, half, radius, texels } = *numbers;
    let band = 2.0 * LeafCard::BAND / f64::from(texels);
    let card = shapes::quad(height * DVec3::Y, half * DVec3::Z, half * DVec3::X);
    let mut scene = over_floor("leaf-card", card.named("card"));
    let alpha = Arc::new(painted(texels, |p| 0.5 + (radius - p.length()) / band));
    scene.cutouts.insert(1, Arc::new(Cutout { uv: quad_uv(), alpha, cutoff: 127.5 }));
    scene.lights = lights_of_hc01();
    scene
}

/// HC-35: a card of 1 m that faces a sun 45 degrees high, cut into `cells` x `cells` squares of which every other is there,
/// 5 m before the floor y = 0, |x|, |z| <= 10, as the light goes.
#[must_use]
pub fn checker_card(cells: u32) -> Scene {
    let mut scene = empty("checker-card");
    let to_light = DVec3::new(0.0, 1.0, 1.0).normalize();
    scene.add(shapes::floor(10.0), DAffine3::IDENTITY);
    let card = shapes::quad(5.0 * to_light, 0.5 * DVec3::X, 0.5 * to_light.cross(DVec3::X));
    scene.add(card.named("card"), DAffine3::IDENTITY);
    let texels =
        (0..cells).flat_map(|y| (0..cells).map(move |x| if (x + y) % 2 == 0 { 255 } else { 0 }));
    let alpha = Arc::new(AlphaMap {
        width: cells,
        height: cells,
        texels: texels.collect(),
        wrap: [Wrap::Clamp; 2],
        nearest: true,
    });
    scene.cutouts.insert(1, Arc::new(Cutout { uv: quad_uv(), alpha, cutoff: 127.5 }));
    scene.camera = Some(look([1.2, 2.5, 1.8], [0.0, 0.0, 0.0], 0.1));
    scene.lights = vec![Light::Directional { direction: -to_light, angular_diameter: 0.0 }];
    scene
}

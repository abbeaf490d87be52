//! The maths of `shaders/soft` in f64: its truth in tests.

pub mod coverage;
pub mod mask;
mod named;
pub mod occlusion;
pub mod techniques;
pub mod vssm;
pub mod width;

use antumbra_scene::Light;
use glam::{DMat2, DMat4, DVec2, DVec3};

use crate::facing::{axes, half_sides};

/// A view of the map, as `AreaView` of `soft/area.wesl`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// Axes of the light plane along which texels count up.
    pub x: DVec3,
    /// See `x`.
    pub y: DVec3,
    /// Axis of the view, away from the light.
    pub z: DVec3,
    /// Texels a unit of slope in perspective, or a metre.
    pub texels: DVec2,
    /// Texel at which the view's axis lies, in perspective.
    pub centre: DVec2,
    /// Whether rays meet.
    pub perspective: bool,
    /// Depth is a + b / z in perspective, a - b z in parallel light.
    pub a: f64,
    /// See `a`.
    pub b: f64,
    /// Depth of the near plane.
    pub nearest: f64,
    /// Half of one side of the light along x, y and z, metres.
    pub u: DVec3,
    /// Half of the other side.
    pub v: DVec3,
    /// Radius of a sphere, else 0.
    pub radius: f64,
    /// Whether the light is a disc or a sphere.
    pub round: bool,
}

impl View {
    /// The view `clip`, whose depth is reversed, of a map with `size` texels a side, from the centre of `light`.
    #[must_use]
    pub fn new(clip: &DMat4, size: f64, light: &Light) -> Self {
        let [across, down, depth, w] = [0, 1, 2, 3].map(|i| clip.row(i));
        let axis = w.truncate();
        let half = DVec2::splat(0.5 * size);
        let perspective = axis != DVec3::ZERO;
        let (x, y, z, texels, centre, a, b);
        if perspective {
            // ndc = slope factor + offset; the offset is the part of a row along the axis.
            let square = axis.length_squared();
            let offset = |row: glam::DVec4| row.truncate().dot(axis) / square;
            let aside = |row: glam::DVec4| row.truncate() - axis * offset(row);
            z = axis.normalize();
            (x, y) = (aside(across).normalize(), -aside(down).normalize());
            texels =
                half * DVec2::new(aside(across).length(), aside(down).length()) / axis.length();
            centre = half * DVec2::new(1.0 + offset(across), 1.0 - offset(down));
            a = offset(depth);
            b = (depth.w - a * w.w) / axis.length();
        } else {
            let toward = depth.truncate();
            z = -toward.normalize();
            (x, y) = (across.truncate().normalize(), -down.truncate().normalize());
            texels = half * DVec2::new(across.truncate().length(), down.truncate().length());
            centre = DVec2::ZERO;
            (a, b) = (depth.w, toward.length());
        }
        let radius = match *light {
            Light::Sphere { radius, .. } => radius,
            _ => 0.0,
        };
        // Sides along an axis have no other part, but for rounding.
        let along = |half: DVec3| {
            let v = DVec3::new(half.dot(x), half.dot(y), half.dot(z));
            let least = 1e-9 * half.length();
            DVec3::from_array(v.to_array().map(|c| if c.abs() < least { 0.0 } else { c }))
        };
        let [u, v] = match light {
            // Level with the map, whatever its own axes.
            Light::Directional { .. } => half_sides(light).map(|half| half.length()),
            _ => [0.0; 2],
        };
        let [half_u, half_v] = half_sides(light);
        let parallel = matches!(light, Light::Directional { .. });
        Self {
            x,
            y,
            z,
            texels,
            centre,
            perspective,
            a,
            b,
            nearest: 1.0,
            u: if parallel { DVec3::X * u } else { along(half_u) },
            v: if parallel { DVec3::Y * v } else { along(half_v) },
            radius,
            round: !matches!(light, Light::Rect { .. }),
        }
    }

    /// `seen` of `soft/area.wesl`.
    #[must_use]
    pub fn seen(&self, texel: DVec2, depth: f64) -> Seen {
        let p = if self.perspective { 1.0 } else { 0.0 };
        let m = (texel - self.centre) / self.texels * p;
        let (mut u, mut v) = (self.u, self.v);
        if self.radius > 0.0 {
            let out = m.try_normalize().unwrap_or(DVec2::X);
            let cosine = 1.0 / (1.0 + m.length_squared()).sqrt();
            u = self.radius * DVec3::new(-out.y, out.x, 0.0);
            v = self.radius * cosine * out.extend(-m.length());
        }
        let tilted = DVec2::new(u.z, v.z) * p;
        let shape = DMat2::from_cols(u.truncate() - m * tilted.x, v.truncate() - m * tilted.y);
        let tilt = tilted * (depth - self.a) / self.b;
        let mut seen = Seen {
            texel,
            depth,
            scale: self.texels / self.b,
            shape,
            inverse: shape.inverse(),
            tilt,
            lo: DVec2::ZERO,
            hi: DVec2::ZERO,
            round: self.round,
            is_box: false,
            view: *self,
        };
        if seen.round {
            let rows = shape.transpose();
            let half = DVec2::new(rows.x_axis.length(), rows.y_axis.length());
            seen.hi = half / (1.0 - tilt.length()).max(LEAST);
            seen.lo = -seen.hi;
        } else {
            let corners = [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)]
                .map(|(x, y)| seen.on_plane(DVec2::new(x, y)));
            seen.lo = corners.into_iter().fold(corners[0], DVec2::min);
            seen.hi = corners.into_iter().fold(corners[0], DVec2::max);
            let level = tilt == DVec2::ZERO && shape.x_axis.y == 0.0 && shape.y_axis.x == 0.0;
            seen.is_box = level;
        }
        seen
    }
}

/// How near a light may come to the receiver's plane parallel to the map, as a share of the receiver's distance.
const LEAST: f64 = 0.25;

/// The light as one receiver sees it, as `Seen` of `soft/area.wesl`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Seen {
    /// Texel of the receiver.
    pub texel: DVec2,
    /// Depth of the receiver.
    pub depth: f64,
    /// Texels a metre of light and a unit of depth.
    pub scale: DVec2,
    /// Points of the light to the light plane, but for the tilt.
    pub shape: DMat2,
    /// The inverse.
    pub inverse: DMat2,
    /// How the light is tilted.
    pub tilt: DVec2,
    /// Low corner of a box around the light, metres.
    pub lo: DVec2,
    /// High corner.
    pub hi: DVec2,
    /// Whether the light is round.
    pub round: bool,
    /// Whether it is the box.
    pub is_box: bool,
    /// The view.
    pub view: View,
}

impl Seen {
    /// `on_plane` of `soft/area.wesl`.
    #[must_use]
    pub fn on_plane(&self, s: DVec2) -> DVec2 {
        self.shape * s / (1.0 - self.tilt.dot(s)).max(LEAST)
    }

    /// `on_light` of `soft/area.wesl`.
    #[must_use]
    pub fn on_light(&self, l: DVec2) -> DVec2 {
        let s = self.inverse * l;
        s / (1.0 + self.tilt.dot(s)).max(1e-3)
    }

    /// `on_shape` of `soft/area.wesl`.
    #[must_use]
    pub fn on_shape(&self, s: DVec2) -> bool {
        if self.round { s.length_squared() <= 1.0 } else { s.abs().max_element() <= 1.0 }
    }

    /// `window` of `soft/area.wesl`: low and high corner, texels. The one formula of all windows.
    #[must_use]
    pub fn window(&self, depth: f64) -> [DVec2; 2] {
        let scale = self.scale * (depth - self.depth);
        [self.texel + self.lo * scale, self.texel + self.hi * scale]
    }

    /// `project_back` of `soft/area.wesl`.
    #[must_use]
    pub fn project_back(&self, texel: DVec2, stored: f64) -> DVec2 {
        let l = (texel - self.texel) / (self.scale * (stored - self.depth));
        let far = 16.0 * (self.hi - self.lo);
        l.clamp(-far, far)
    }

    /// `distance_of` of `soft/area.wesl`.
    #[must_use]
    pub fn distance_of(&self, depth: f64) -> f64 {
        let reciprocal = (depth - self.view.a) / self.view.b;
        if self.view.perspective { 1.0 / reciprocal } else { -reciprocal }
    }

    /// `depth_of` of `soft/area.wesl`.
    #[must_use]
    pub fn depth_of(&self, distance: f64) -> f64 {
        let reciprocal = if self.view.perspective { 1.0 / distance } else { -distance };
        self.view.a + self.view.b * reciprocal
    }
}

/// The unit axes of a light, which a turned cube has.
#[must_use]
pub fn light_axes(light: &Light) -> [DVec3; 3] {
    axes(light)
}

/// Seeded numbers in [0, 1) for tests: SplitMix64 (Steele, Lea, Flood 2014).
#[cfg(test)]
fn random(state: &mut u64) -> f64 {
    *state = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
    let mut z = *state;
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    ((z ^ (z >> 31)) >> 11) as f64 * 0.5f64.powi(53)
}

#[cfg(test)]
mod tests;

//! The lookup of `common/lookup.wesl` in f64: its truth in tests.

pub mod chart;
pub mod scan_lines;

use glam::{DMat4, DVec2, DVec3};

/// Where a receiver lies in a view, without slack.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lookup {
    /// Continuous texel coordinates.
    pub texel: DVec2,
    /// Depth at `texel`.
    pub depth: f64,
    /// Change of the receiver plane's depth per texel.
    pub gradient: DVec2,
}

/// Locates the receiver at `p` with normal `n` in the view `clip` of `size` texels a side.
#[must_use]
pub fn locate(clip: &DMat4, size: f64, p: DVec3, n: DVec3) -> Lookup {
    let c = *clip * p.extend(1.0);
    let ndc = c.truncate() / c.w;
    // The receiver's plane as a covector in clip space (planes map by the inverse transpose): depth is
    // affine on it, z = -(a x + b y + d) / c.
    let plane = clip.inverse().transpose() * n.extend(-n.dot(p));
    let per_ndc = DVec2::new(-plane.x / plane.z, -plane.y / plane.z);
    Lookup {
        texel: (DVec2::splat(0.5) + DVec2::new(0.5, -0.5) * ndc.truncate()) * size,
        depth: ndc.z,
        gradient: per_ndc * DVec2::new(2.0, -2.0) / size,
    }
}

/// The distance, metres, by which a receiver at `p` with unit normal `n` is moved along it for an offset of one
/// texel's side; `to_light` is the direction towards a directional light.
#[must_use]
pub fn normal_offset(clip: &DMat4, to_light: DVec3, size: f64, p: DVec3, n: DVec3) -> f64 {
    let w = clip.row(3);
    let axis = if w.truncate() == DVec3::ZERO { to_light } else { w.truncate() }.normalize();
    let across = |i: usize| clip.row(i).truncate().reject_from(axis).length();
    let side = 2.0 * w.dot(p.extend(1.0)) / (size * across(0).min(across(1)));
    side * n.cross(axis).length()
}

/// The virtual occluder of `map/between.wesl`: reversed depths of the first two layers, 0 where there is none.
#[must_use]
pub fn occluder(metric: &crate::Metric, z1: f64, z2: f64) -> f64 {
    if z1 == 0.0 {
        return 0.0;
    }
    let behind = z2.max(metric.far).min(z1);
    let middle = match metric.inverse {
        // Halfway between the distances 1 / z.
        true if behind > 0.0 => 1.0 / (0.5 * (1.0 / z1 + 1.0 / behind)),
        true => 0.0,
        false => 0.5 * (z1 + behind),
    };
    middle.max(z1 * metric.scale - metric.shift)
}

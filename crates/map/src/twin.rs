//! The lookup of `common/lookup.wesl` in f64: its truth in tests.

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

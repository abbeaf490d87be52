//! From a lookup to visibility: which shader modules do it, and what the rest must know about them.

use antumbra_shaders::{Slot, module};

/// An estimator over a depth map: shader modules for the slots of `map::resolve`.
#[derive(Clone, Debug, PartialEq)]
pub struct Estimator {
    /// Bindings of the slots `store`, `estimator` and whatever the estimator imports.
    pub slots: Vec<Slot>,
    /// Whether the map is read through a comparison sampler (`texture_depth_2d_array`) rather than
    /// texel by texel (`texture_2d_array<f32>`).
    pub comparison_sampler: bool,
    /// Largest distance per axis, in texels, from the sample to the centre of a texel it compares with.
    /// Also the width of the guard band around the casters.
    pub radius: f32,
    /// Largest distance per axis, in texels, from the point at which a reference depth is taken to the
    /// centre of a texel compared with it, given the receiver's plane: 0 for texel-by-texel reads, 1 for
    /// bilinear comparison.
    pub reach: f32,
    /// Fetches a view sample.
    pub fetches: u32,
}

impl Estimator {
    /// One texel, one comparison (Williams 1978).
    #[must_use]
    pub fn nearest() -> Self {
        Self {
            slots: vec![module("store", "common::depth_map"), module("estimator", "map::nearest")],
            comparison_sampler: false,
            radius: 0.5,
            reach: 0.0,
            fetches: 1,
        }
    }
}

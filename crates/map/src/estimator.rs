//! From a lookup to visibility: which shader modules do it, and what the rest must know about them.

use antumbra_shaders::{Slot, module};

/// How an estimator reads its map: the type of the texture and of the sampler beside it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum MapRead {
    /// Depth, through a comparison sampler with bilinear filter (`texture_depth_2d_array`).
    Comparison,
    /// Floats, texel by texel (`texture_2d_array<f32>`, of any float format or depth).
    Texels,
    /// Depth, four texels a fetch (`texture_2d_array<f32>` and `textureGather`).
    Gathered,
    /// Unsigned integers, texel by texel (`texture_2d_array<u32>`).
    Unsigned,
}

/// An estimator over a depth map: shader modules for the slots of `map::resolve`.
#[derive(Clone, Debug, PartialEq)]
pub struct Estimator {
    /// Bindings of the slots `store`, `estimator` and whatever the estimator imports.
    pub slots: Vec<Slot>,
    /// How it reads the map, or what is made of it; agrees with the aliases `Map` and `Sampler` of the module
    /// in the slot `store`.
    pub read: MapRead,
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
            read: MapRead::Texels,
            radius: 0.5,
            reach: 0.0,
            fetches: 1,
        }
    }
}

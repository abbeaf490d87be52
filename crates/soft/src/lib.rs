//! Soft shadows of area lights from what the light's centre sees: percentage-closer soft shadows, by taps and by moments,
//! back projection and occlusion bitmasks; from how deep in the centre's shadow a point lies, by a shadow-width map or a
//! search; and from images of slices of the casters: occlusion textures.
//!
//! The former ask one question: which texels of the map lie between a receiver and the light. An occluder at the
//! distance z from the light's plane does so within a window of half size `h (1/z - 1/z_p)`, in slopes, around a receiver
//! at z_p with a light of half size h. That formula is in `soft/area.wesl`, once, and its twin in [`twin::View`];
//! `soft/search.wesl` finds the window, and the techniques differ in what they make of the texels in it.
//!
//! The map is drawn by the layouts and passes of [`antumbra_map`], from the centre of the light; [`Facing`] turns a cube so
//! that two of its faces are parallel to a rectangle or a disc. A light without an extent gives the plain shadow map's
//! answer, bit for bit.

mod back_projection;
mod bitmask;
mod bounding;
mod deeper;
mod expectation;
mod facing;
mod named;
mod occlusion;
mod offset;
mod pattern;
mod pcss;
mod radial_search;
mod single_sample;
mod slices;
mod split;
mod store;
mod table;
pub mod twin;
mod vssm;
mod width_map;
mod width_store;
mod window;

pub use back_projection::BackProjection;
pub use bitmask::{Bitmask, Occluders, Samples};
pub use facing::Facing;
pub use occlusion::{Fusion, OcclusionTextures, Placement, Prefilter};
pub use pattern::{Pattern, PatternTables};
pub use pcss::Pcss;
pub use radial_search::RadialSearch;
pub use single_sample::{SingleSample, WidthLookup, Widths};
pub use vssm::Vssm;
pub use width_map::WidthMap;
pub use window::{Hierarchy, Window};

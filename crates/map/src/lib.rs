//! Shadow-map core: light cameras, depth passes, layouts, bias, and the plain shadow test.
//!
//! A shadow map is put together from three parts that know nothing of one another. The *layout*
//! ([`Layout`], fitted by an [`Arrange`]) says into which view of the map a point falls; the *store* is the
//! depth texture, or what a [`Store`] makes of it; the *estimator* ([`Estimator`]) turns a lookup into
//! visibility. [`ShadowMap`] owns layout and store and
//! draws the casters; [`Resolve`] links a layout with an estimator and works on any depth map, also one
//! that the application draws; [`MapTechnique`] is both together behind [`antumbra_gpu::Technique`].
//! [`projection`] shadows planes without a depth map. [`SamplingError`] measures how many pixels a texel spans.
//!
//! Nothing needs tuning: the receiver's own plane gives each texel its reference depth, and what remains
//! is a rounding bound that the shader derives per sample (`common/lookup.wesl`).

mod between;
mod bias;
mod caster_depth;
mod chart_pass;
mod estimator;
mod expectation;
mod fit;
mod layout;
mod linear;
mod omni;
mod peel;
mod per_object;
pub mod projection;
mod receiver_mask;
mod resolve;
mod sampling_error;
mod scan_lines;
mod self_shadowing;
mod shadow_map;
mod store;
mod technique;
mod triangle_map;
mod triangle_names;
mod triangles;
pub mod twin;
mod view;
mod visible;

pub use between::{Between, Metric};
pub use bias::Bias;
pub use caster_depth::{CasterDepth, Faces, PolygonOffset};
pub use estimator::{Estimator, MapRead};
pub use expectation::{expectation, without_holes};
pub use fit::{
    FittedView, Fitting, Needed, SeenView, Sight, basis, cone, fit, fit_perspective, fit_seen,
    fit_wide, fit_wide_sun,
};
pub use layout::{Arrange, Drawing, Layout, Refit};
pub use linear::LinearDepth;
pub use omni::Omni;
pub use peel::DepthPeel;
pub use per_object::{MOST_OBJECT_MAPS, PerObject};
pub use projection::{DiscShadows, Planar, Plane, ShadowTexture};
pub use resolve::Resolve;
pub use sampling_error::{SamplingError, TexelOnScreen};
pub use scan_lines::{ScanLineStore, ScanLines, Span};
pub use self_shadowing::{
    DualLayers, Midpoint, NormalOffset, SecondDepth, SecondSurface, SlopeBias,
};
pub use shadow_map::ShadowMap;
pub use store::Store;
pub use technique::{MapConfig, MapTechnique, Plain};
pub use triangle_map::TriangleMap;
pub use triangle_names::TriangleNames;
pub use triangles::{ObjectId, PolygonId, TriangleDepth};
pub use view::{DepthConvention, ShadowView};
pub use visible::{BodyBoxes, VisibleRegion};

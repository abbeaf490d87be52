//! Where a shadow map puts its texels: warps, cascades, pages that match the view's resolution, and maps whose samples
//! are the view's own.
//!
//! What is a layout here ([`antumbra_map::Arrange`]) serves every estimator and every store.

pub mod view_samples;

pub use view_samples::{ViewSampleMap, ViewSampleMapping};

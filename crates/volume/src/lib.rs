//! Geometric shadow volumes: exact hard shadows for any mesh, without a shadow map (Crow 1977).
//!
//! A point is in shadow if it lies in the *shadow volume* of some triangle: the part of space behind the
//! triangle as the light sees it. Whether a view sample does is found by counting the volumes' faces along
//! a line from it (Heidmann 1991).

mod auto;
mod batches;
mod clamp;
mod containment;
mod count;
mod cull;
mod doubtful;
mod expectation;
mod eye_counter;
mod faces;
mod light;
mod litmap;
pub mod reach;
mod receivers;
mod savings;
pub mod silhouette;
mod technique;
mod translucent;
mod triangles;
pub mod twin;
mod z_fail;
mod z_pass;
mod zp_plus;

pub use auto::Auto;
pub use containment::{Containment, Triangle};
pub use count::Counter;
pub use eye_counter::EyeCounter;
pub use faces::{COUNT_IN_FRONT, Cap, Side, VolumeFaces};
pub use light::homogeneous_light;
pub use savings::Savings;
pub use silhouette::Silhouette;
pub use technique::VolumeTechnique;
pub use translucent::Translucent;
pub use triangles::{Method, TriangleFaces};
pub use z_fail::ZFail;
pub use z_pass::ZPass;
pub use zp_plus::ZpPlus;

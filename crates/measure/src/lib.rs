//! Runs shadow techniques on scenes and sets them beside the truth.
//!
//! A [`Stage`] is a scene under view samples: casters and a ray tracer over the same triangles. On a
//! stage, a light has a truth ([`Stage::truth`]), and a technique has a [`Shot`]: its visibility at the
//! very view samples at which the truth is taken, so that only shadow error is measured, with its times,
//! counters and bytes; a map has a sampling error ([`Stage::sampling`]). [`stability`] holds the hard cases.

mod sampling;
pub mod stability;
mod stage;

use antumbra_gpu::GpuError;
use antumbra_reference::{MetricError, TraceError};
use antumbra_scene::MeshError;

pub use sampling::Sampling;
pub use stage::{Session, Shot, Stage};

/// What can keep a stage from being set or a shot from being taken.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum MeasureError {
    /// The device or a technique refused.
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// The scene's meshes are faulty.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// The ray tracer refused the scene.
    #[error(transparent)]
    Trace(#[from] TraceError),
    /// The technique's answer is no visibility.
    #[error(transparent)]
    Metric(#[from] MetricError),
}

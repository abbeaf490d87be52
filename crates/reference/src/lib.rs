//! Ground truth for shadows: ray-traced and closed-form visibility, and the error metrics.

pub mod closed;
mod flip;
mod metrics;
mod sample;
pub mod sampling;
mod tracer;
mod truth;

pub use flip::{
    FLIP_PIXELS_PER_DEGREE, FLIP_PIXELS_PER_DEGREE_RANGE, FlipError, FlipResult, flip,
    pixels_per_degree,
};
pub use metrics::{
    ACNE_BELOW, ACNE_CLEARANCE, BAD_ERROR, Comparison, LIT_ABOVE, MetricError, Metrics,
    PENUMBRA_LEVELS, contact_gap, penumbra_width, penumbra_width_error, temporal_error,
};
pub use sample::{SampleClass, ViewSample};
pub use tracer::{Hit, Instructions, LARGEST_COORDINATE, Ray, TraceError, Tracer};
pub use truth::{Truth, TruthOptions};

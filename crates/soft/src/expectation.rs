//! What theory says of soft shadows on each hard case.

use antumbra_gpu::Expectation;
use antumbra_map::{Estimator, MapConfig};

/// The hard cases have lights without an extent, under which every technique here is the plain shadow map, bit for bit.
pub(crate) fn expectation(map: &MapConfig, case: &str) -> Option<Expectation> {
    antumbra_map::expectation(map, &Estimator::nearest(), case)
}

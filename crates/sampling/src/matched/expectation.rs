//! What theory says of resolution-matched pages on each hard case.
//!
//! The cases and their numbers are those of `antumbra_measure::stability::CASES`; a case is right at 0.

use antumbra_gpu::Expectation;
use antumbra_map::{Estimator, MapConfig};

/// Where samples are points without a camera, all ask for the finest level and become coarser until they fit: at worst to
/// the resolution of a plain map of the atlas's size. So what holds of that holds here.
pub(super) fn matched(map: &MapConfig, case: &str) -> Option<Expectation> {
    antumbra_map::expectation(map, &Estimator::nearest(), case)
}

//! Techniques that only say where another's samples go.

use std::any::Any;

use antumbra_gpu::{Gpu, GpuError, Technique, TechniqueConfig};
use antumbra_map::{Arrange, MapTechnique};

/// Builds `of`, which must be a technique over a shadow map.
pub(crate) fn map_technique(
    gpu: &Gpu,
    of: &dyn TechniqueConfig,
) -> Result<Box<MapTechnique>, GpuError> {
    let technique: Box<dyn Any> = of.build(gpu)?;
    technique.downcast().map_err(|_| GpuError::Invalid {
        what: "technique `of`",
        value: "one that is not over a shadow map".to_owned(),
        fix: "choose one that looks up a shadow map, such as map/plain or any of filter/",
    })
}

/// Builds `of`, which must be a technique over a shadow map, with the arrangement that `arrange` makes of its own.
pub(crate) fn over_map(
    gpu: &Gpu,
    of: &dyn TechniqueConfig,
    arrange: impl FnOnce(Box<dyn Arrange>) -> Result<Box<dyn Arrange>, GpuError>,
) -> Result<Box<dyn Technique>, GpuError> {
    Ok(Box::new(map_technique(gpu, of)?.rearranged(arrange)?))
}

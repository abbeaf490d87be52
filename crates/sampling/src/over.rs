//! Techniques that only say where another's samples go.

use std::any::Any;

use antumbra_gpu::{Gpu, GpuError, Technique, TechniqueConfig};
use antumbra_map::{Arrange, MapTechnique};

/// Builds `of`, which must be a technique over a shadow map, with the arrangement that `arrange` makes of its own.
pub(crate) fn over_map(
    gpu: &Gpu,
    of: &dyn TechniqueConfig,
    arrange: impl FnOnce(Box<dyn Arrange>) -> Result<Box<dyn Arrange>, GpuError>,
) -> Result<Box<dyn Technique>, GpuError> {
    let technique: Box<dyn Any> = of.build(gpu)?;
    let Ok(technique) = technique.downcast::<MapTechnique>() else {
        return Err(GpuError::Invalid {
            what: "technique `of`",
            value: "one that is not over a shadow map".to_owned(),
            fix: "choose one that looks up a shadow map, such as map/plain or any of filter/",
        });
    };
    Ok(Box::new(technique.rearranged(arrange)?))
}

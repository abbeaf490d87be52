//! Multiple-depth shadow maps.

use antumbra_gpu::{Expectation, Gpu, GpuError, Technique, TechniqueConfig};
use antumbra_map::{Estimator, MapConfig, MapTechnique, expectation as of_a_depth_map};
use antumbra_shaders::module;
use serde::{Deserialize, Serialize};

use crate::expectation::of_level_casters;
use crate::nbuffer::Ranges;
use crate::prefilter::{Constant, Prefilter, Recipe, Shape};
use crate::vsm::U;

/// Multiple-depth shadow maps (Pagot, Comba, de Oliveira 2004): of the depths in a kernel the least and the largest stand
/// for all, found once a map, so that a lookup compares two or three. 8 bytes a texel.
///
/// Exactly 1 where every texel of the kernel is lit and exactly 0 where none is; what lies between has one or two greys,
/// whatever the proportion.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct MultipleDepth {
    /// The shadow map.
    pub map: MapConfig,
    /// Radius of the kernel, texels, 0 to 31, default 1: a kernel of 2 `radius` + 1 texels a side. Cost: as many steps an
    /// axis and texel of the map.
    pub radius: u32,
    /// Depths that are kept, 2 or 3, default 3: the least, the largest, and the texel's own between them.
    pub depths: u32,
    /// Whether the two are kept for squares of every power of two (an N-buffer), of which four cover any kernel. Default
    /// false. Takes as long whatever the radius, of up to 127 texels then, for as many times the memory as the map's side
    /// has bits.
    pub n_buffer: bool,
}

impl Default for MultipleDepth {
    fn default() -> Self {
        Self { map: MapConfig::default(), radius: 1, depths: 3, n_buffer: false }
    }
}

impl MultipleDepth {
    fn recipe(&self) -> Result<Recipe, GpuError> {
        let filter = Prefilter { shape: Shape::Box, radius: self.radius, ..Prefilter::default() };
        match self.n_buffer {
            true if self.radius > 127 => {
                let (what, fix) = ("radius", "use 0 to 127 texels");
                return Err(GpuError::Invalid { what, value: self.radius.to_string(), fix });
            }
            true => {}
            false => filter.validate()?,
        }
        if !(2..=3).contains(&self.depths) {
            let (what, fix) = ("depths", "use 2 or 3");
            return Err(GpuError::Invalid { what, value: self.depths.to_string(), fix });
        }
        let constants = vec![
            ("OWN", Constant::Bool(self.depths == 3)),
            // Of depth, on both sides.
            ("ROUNDING", Constant::Float(4.0 * U)),
            ("AROUND", Constant::Int(self.radius)),
        ];
        let (encoding, format) = ("filter::encoding::depth_twice", wgpu::TextureFormat::Rg32Float);
        let mut recipe = Recipe::new(filter, encoding, format, "filter::multiple_depth", constants);
        recipe.mean = "gpu::mean::min_max";
        recipe.reads_depth = true;
        recipe.fetches = self.depths - 1;
        if self.n_buffer {
            recipe.modules.push(module("filter::ends", "filter::ends_nbuffer"));
            recipe.fetches += 3;
        }
        Ok(recipe)
    }

    /// The estimator, for any layout.
    ///
    /// # Errors
    /// A setting out of range.
    pub fn estimator(&self) -> Result<Estimator, GpuError> {
        Ok(self.recipe()?.estimator())
    }

    /// The technique, with its map and store at hand.
    ///
    /// # Errors
    /// A setting out of range or beyond the device's limits.
    pub fn technique(&self, gpu: &Gpu) -> Result<MapTechnique, GpuError> {
        let recipe = self.recipe()?;
        if self.n_buffer {
            let store = Box::new(Ranges::new(gpu)?);
            return MapTechnique::with_store(gpu, &self.map, recipe.estimator(), store);
        }
        recipe.technique(gpu, &self.map)
    }
}

impl TechniqueConfig for MultipleDepth {
    fn build(&self, gpu: &Gpu) -> Result<Box<dyn Technique>, GpuError> {
        Ok(Box::new(self.technique(gpu)?))
    }

    fn set_map_size(&mut self, size: u32) {
        self.map.size = size;
    }

    fn expectation(&self, case: &str) -> Option<Expectation> {
        // Comparisons of depths within the kernel: at level receivers and edges it is a kernel like others. Where walls
        // meet, or linear depth is coarse, it is not said yet.
        let known = ["HC-01", "HC-02 light", "HC-10", "HC-14"];
        let estimator = self.estimator().ok()?;
        if known.iter().any(|name| case.starts_with(name)) {
            return of_a_depth_map(&self.map, &estimator, case);
        }
        of_level_casters(&self.map, &estimator, case)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_out_of_range_are_refused_with_a_fix() {
        assert!(MultipleDepth::default().estimator().is_ok(), "the defaults");
        for config in [
            MultipleDepth { depths: 1, ..MultipleDepth::default() },
            MultipleDepth { depths: 4, ..MultipleDepth::default() },
            MultipleDepth { radius: 32, ..MultipleDepth::default() },
            MultipleDepth { radius: 128, n_buffer: true, ..MultipleDepth::default() },
        ] {
            assert!(matches!(config.estimator(), Err(GpuError::Invalid { .. })), "{config:?}");
        }
    }
}

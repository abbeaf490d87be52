//! Techniques over a map of triangles: what a texel names is compared by identity, or met by a ray.

use antumbra_gpu::{Expectation, Gpu, GpuError, Technique, TechniqueConfig};
use antumbra_shaders::{Slot, module, source};
use serde::{Deserialize, Serialize};

use crate::expectation::triangles as expected;
use crate::{Bias, Estimator, MapConfig, MapRead, MapTechnique, TriangleMap};

/// Polygon identifiers (Hourcade, Nicolas 1985): a receiver is lit where its texel shows the polygon that it
/// lies on, or none. No depth is compared, so there is no bias; but triangles shadow their neighbours along
/// shared edges, and where they are smaller than a texel nearly everything is dark.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PolygonId {
    /// Side of the map (of one face, for a cube), texels; 1 to the device's limit (at least 8192), default
    /// 2048. Memory, twice that of a plain map, and fill cost grow with its square.
    pub size: u32,
    /// Texels around its own, a side, in which a receiver looks for its polygon, 0 to 8, default 0. 1 mends shared
    /// edges and leaks a texel at contacts. Cost: (2 `reach` + 1)² triangles a sample.
    pub reach: u32,
}

/// Object identifiers (Dietrich 2001; Forsyth 2007): a receiver is lit where its texel shows its own object, or
/// none. An object never shadows itself, rightly or wrongly.
///
/// Which object a view sample lies on, [`antumbra_gpu::ViewSamples`] says; samples that do not know are lit
/// where their texel shows the very triangle they lie on.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ObjectId {
    /// Side of the map (of one face, for a cube), texels; 1 to the device's limit (at least 8192), default
    /// 2048. Memory, twice that of a plain map, and fill cost grow with its square.
    pub size: u32,
}

/// Reconstructed triangles (Dai, Yang, Feng 2008): the receiver's own ray to the light meets the triangles that
/// the texels around it name, or not. Depths and edges are exact where the occluder is among them; one that no
/// texel nearby shows is missed.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TriangleDepth {
    /// Side of the map (of one face, for a cube), texels; 1 to the device's limit (at least 8192), default
    /// 2048. Memory, twice that of a plain map, and fill cost grow with its square.
    pub size: u32,
    /// Texels around its own, a side, whose triangles are tried, 0 to 8, default 1. Cost: (2 `reach` + 1)²
    /// triangles a sample.
    pub reach: u32,
}

const SIZE: u32 = 2048;
/// Largest reach: 17 x 17 triangles a sample; a larger value is surely a mistake.
const MAX_REACH: u32 = 8;

impl Default for PolygonId {
    fn default() -> Self {
        Self { size: SIZE, reach: 0 }
    }
}

impl Default for ObjectId {
    fn default() -> Self {
        Self { size: SIZE }
    }
}

impl Default for TriangleDepth {
    fn default() -> Self {
        Self { size: SIZE, reach: 1 }
    }
}

impl TechniqueConfig for PolygonId {
    fn build(&self, gpu: &Gpu) -> Result<Box<dyn Technique>, GpuError> {
        build(gpu, self.size, "map::polygon_id", check(self.reach)?)
    }

    fn set_map_size(&mut self, size: u32) {
        self.size = size;
    }

    fn expectation(&self, case: &str) -> Option<Expectation> {
        expected::polygon_id(self, case)
    }
}

impl TechniqueConfig for ObjectId {
    fn build(&self, gpu: &Gpu) -> Result<Box<dyn Technique>, GpuError> {
        build(gpu, self.size, "map::object_id", 0)
    }

    fn set_map_size(&mut self, size: u32) {
        self.size = size;
    }

    fn expectation(&self, case: &str) -> Option<Expectation> {
        expected::object_id(self, case)
    }
}

impl TechniqueConfig for TriangleDepth {
    fn build(&self, gpu: &Gpu) -> Result<Box<dyn Technique>, GpuError> {
        build(gpu, self.size, "map::triangle_depth", check(self.reach)?)
    }

    fn set_map_size(&mut self, size: u32) {
        self.size = size;
    }

    fn expectation(&self, case: &str) -> Option<Expectation> {
        expected::triangle_depth(self, case)
    }
}

fn check(reach: u32) -> Result<u32, GpuError> {
    if reach <= MAX_REACH {
        return Ok(reach);
    }
    let fix = "use 0 to 8 texels";
    Err(GpuError::Invalid { what: "reach", value: reach.to_string(), fix })
}

/// The estimator of the shader module `path` over a map of triangles.
fn estimator(path: &'static str, reach: u32) -> Estimator {
    let radius: Slot = source("config", format!("const RADIUS: i32 = {reach};"));
    Estimator {
        slots: vec![module("store", "map::triangles"), module("estimator", path), radius],
        read: MapRead::Unsigned,
        radius: 0.5 + reach as f32,
        reach: 0.0,
        fetches: (2 * reach + 1).pow(2),
    }
}

fn build(
    gpu: &Gpu,
    size: u32,
    path: &'static str,
    reach: u32,
) -> Result<Box<dyn Technique>, GpuError> {
    let config = MapConfig { size, bias: Bias::ROUNDING, ..MapConfig::default() };
    let store = Box::new(TriangleMap::new(gpu)?);
    Ok(Box::new(MapTechnique::with_store(gpu, &config, estimator(path, reach), store)?))
}

//! Soft shadow mapping: areas of back-projected texels, added up.

use antumbra_gpu::{Expectation, Gpu, GpuError, Technique, TechniqueConfig};
use antumbra_map::MapConfig;
use serde::{Deserialize, Serialize};

use crate::expectation::{self, Accuracy};
use crate::pcss::build;
use crate::window::Window;

/// Soft shadow mapping (Guennebaud, Barthe, Paulin 2006; Atty et al. 2006): texels nearer than the receiver are projected
/// back onto the light as rectangles, and the areas that they hide add up.
///
/// Exact areas for all lights: what a rectangle hides of a disc, or of a light that is not parallel to the map, is the area
/// of a quadrilateral in the light's own coordinates.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct BackProjection {
    /// The shadow map.
    pub map: MapConfig,
    /// The search for occluders. Cost: one fetch and one projection a texel of the window.
    pub window: Window,
}

impl TechniqueConfig for BackProjection {
    fn build(&self, gpu: &Gpu) -> Result<Box<dyn Technique>, GpuError> {
        let fetches = self.window.budget.saturating_pow(2);
        let estimator = self.window.estimator("soft::back_projection", Vec::new(), "", fetches);
        build(gpu, &self.map, estimator, &self.window)
    }

    fn set_map_size(&mut self, size: u32) {
        self.map.size = size;
    }

    fn expectation(&self, case: &str) -> Option<Expectation> {
        let accuracy = Accuracy { named: self.window.reach, ..Accuracy::of(&self.map) };
        expectation::over_a_map(&self.map, &accuracy, case)
    }
}

//! How a technique looks for occluders.

use antumbra_gpu::GpuError;
use antumbra_map::{Estimator, MapRead};
use antumbra_shaders::{Slot, module, source};
use serde::{Deserialize, Serialize};

/// The search for texels that may hide some of the light.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Window {
    /// Narrows the window, and finds what is lit for certain, by a pyramid of least and greatest depths (Guennebaud,
    /// Barthe, Paulin 2006). Default true; changes no answer. Costs 8/3 of the map's memory and a pass over it.
    pub hierarchy: bool,
    /// Takes a receiver for dark where all texels of its window are nearer than it, without asking whether light slips
    /// between them. Default true, as published; needs `hierarchy`.
    pub umbra: bool,
    /// Most texels a side of a window that are looked at, 4 to 128, default 64: of larger windows one texel stands for
    /// a block. Cost: up to its square in fetches a sample.
    pub budget: u32,
    /// Counts on the GPU what becomes of samples, for measurements. Default false.
    pub tally: bool,
}

impl Default for Window {
    fn default() -> Self {
        Self { hierarchy: true, umbra: true, budget: 64, tally: false }
    }
}

impl Window {
    /// # Errors
    /// A budget out of range.
    pub(crate) fn validate(&self) -> Result<(), GpuError> {
        // Mesa's software device ends the loops of a shader after 65535 turns together: twice the square of 128 are less.
        if (4..=128).contains(&self.budget) {
            return Ok(());
        }
        let (what, fix) = ("window.budget", "use 4 to 128 texels");
        Err(GpuError::Invalid { what, value: self.budget.to_string(), fix })
    }

    /// The estimator in the module `path` over the depth map, with the given further slots and constants.
    pub(crate) fn estimator(
        &self,
        path: &'static str,
        slots: Vec<Slot>,
        constants: &str,
        fetches: u32,
    ) -> Estimator {
        self.estimator_over("common::depth_map", path, slots, constants, fetches)
    }

    /// As [`Window::estimator`], with the store in the module `store`, which has the depth map, too.
    pub(crate) fn estimator_over(
        &self,
        store: &'static str,
        path: &'static str,
        slots: Vec<Slot>,
        constants: &str,
        fetches: u32,
    ) -> Estimator {
        let config = format!(
            "const HIERARCHY: bool = {};\nconst UMBRA: bool = {};\nconst BUDGET: i32 = {};\n{constants}",
            self.hierarchy, self.umbra, self.budget,
        );
        let mut all = vec![
            module("store", store),
            module("map::through", "soft::through"),
            module("estimator", path),
            source("config", config),
        ];
        if !self.hierarchy {
            all.push(module("soft::bounds", "soft::no_bounds"));
        }
        if !self.tally {
            all.push(module("soft::tally", "soft::no_tally"));
        }
        all.extend(slots);
        // As the plain map's, since a light without an extent has its answer. Beyond the casters the map needs no room: what
        // lies outside of it is empty.
        Estimator { slots: all, read: MapRead::Texels, radius: 0.5, reach: 0.0, fetches }
    }
}

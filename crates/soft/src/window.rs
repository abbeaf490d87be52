//! How a technique looks for occluders.

use antumbra_gpu::GpuError;
use antumbra_map::{Estimator, MapConfig, MapRead};
use antumbra_shaders::{Slot, module, source};
use serde::{Deserialize, Serialize};

use crate::Samples;

/// What knows the least and the greatest depth of a window. None changes an answer but [`Window::umbra`]'s; the tighter its
/// bounds the fewer receivers and texels are left to be looked at.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Hierarchy {
    /// Nothing.
    None,
    /// A mipmap, the hierarchical shadow map (Guennebaud, Barthe, Paulin 2006): four windows at multiples of their side, which
    /// together may be up to four times as long as asked. 2 2/3 bytes a texel of the map.
    #[default]
    Mip,
    /// The multiscale shadow map (Schwarz, Stamminger 2007): windows at every texel, exact for squares. 8 bytes a texel and
    /// level: 88 for a map of 1024.
    Multiscale,
    /// The Y shadow map (Schwarz, Stamminger 2008): windows at every fourth texel. 7.5 bytes a texel for a map of 1024. For maps
    /// of at least 8 texels a side.
    Y,
}

/// The search for texels that may hide some of the light.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Window {
    /// Narrows the window, and finds what is lit for certain. Default a mipmap. Costs a pass over the map.
    pub hierarchy: Hierarchy,
    /// Takes a receiver for dark where all texels of its window are nearer than it, without asking whether light slips
    /// between them. Default true, as published; needs `hierarchy`.
    pub umbra: bool,
    /// Most texels a side of a window that are looked at, 4 to 128, default 64: of larger windows one texel stands for
    /// a block. Cost: up to its square in fetches a sample.
    pub budget: u32,
    /// Texels around its own, a side, whose triangles a receiver meets as they are, 0 to 4, default 0: none. The map knows a
    /// contact no finer than a texel; the triangle that a texel names is exact (after Dai, Yang, Feng 2008), here for every
    /// sample of the light. For casters whose triangles are known; cut-outs count as whole. Cost: (2 `reach` + 1)² fetches
    /// a sample and some 200 operations for each triangle above it, 4 bytes a texel.
    pub reach: u32,
    /// Counts on the GPU what becomes of samples, for measurements. Default false.
    pub tally: bool,
}

impl Default for Window {
    fn default() -> Self {
        Self { hierarchy: Hierarchy::Mip, umbra: true, budget: 64, reach: 0, tally: false }
    }
}

/// Refuses what views from a light with an extent do not have, before anything is made.
///
/// # Errors
/// Maps for single objects, or a map too small for the hierarchy.
pub(crate) fn check_map(map: &MapConfig, hierarchy: Hierarchy) -> Result<(), GpuError> {
    let invalid = |what, value, fix| Err(GpuError::Invalid { what, value, fix });
    if map.objects != 0 {
        let value = format!("{} under a soft shadow", map.objects);
        let fix =
            "leave `objects` at 0: what hides a part of the light may lie in any object's map";
        return invalid("maps of single objects", value, fix);
    }
    if hierarchy == Hierarchy::Y && map.size < 8 {
        let fix = "use a map of at least 8 texels a side, or another hierarchy";
        return invalid("size under a Y map", map.size.to_string(), fix);
    }
    Ok(())
}

impl Window {
    /// # Errors
    /// A budget or a reach out of range.
    pub(crate) fn validate(&self) -> Result<(), GpuError> {
        let invalid =
            |what, value: u32, fix| Err(GpuError::Invalid { what, value: value.to_string(), fix });
        // Mesa's software device ends the loops of a shader after 65535 turns together: twice the square of 128 are less.
        if !(4..=128).contains(&self.budget) {
            return invalid("window.budget", self.budget, "use 4 to 128 texels");
        }
        if self.reach > 4 {
            return invalid("window.reach", self.reach, "use 0 to 4 texels");
        }
        Ok(())
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

    /// As [`Window::estimator`], with the store in the module `store`, which has the depth map, too. Named triangles bound what
    /// the estimator says from above.
    pub(crate) fn estimator_over(
        &self,
        store: &'static str,
        path: &'static str,
        mut slots: Vec<Slot>,
        constants: &str,
        fetches: u32,
    ) -> Estimator {
        if self.reach == 0 {
            return self.masking_estimator(store, path, slots, constants, fetches);
        }
        slots.push(module("soft::contacts", "soft::named_contacts"));
        let constants = constants.to_owned() + &Samples::S256.constants();
        self.masking_estimator(store, path, slots, &constants, fetches)
    }

    /// As [`Window::estimator_over`], for an estimator that has masks itself, and marks in them what triangles hide.
    pub(crate) fn masking_estimator(
        &self,
        store: &'static str,
        path: &'static str,
        slots: Vec<Slot>,
        constants: &str,
        fetches: u32,
    ) -> Estimator {
        let config = format!(
            "const HIERARCHY: bool = {};\nconst UMBRA: bool = {};\nconst BUDGET: i32 = {};\nconst REACH: i32 = {};\n{constants}",
            self.hierarchy != Hierarchy::None,
            self.umbra,
            self.budget,
            self.reach,
        );
        let mut all = vec![
            module("store", store),
            module("map::through", "soft::through"),
            module("estimator", path),
            source("config", config),
        ];
        match self.hierarchy {
            Hierarchy::None => all.push(module("soft::bounds", "soft::no_bounds")),
            Hierarchy::Mip => {}
            Hierarchy::Multiscale => all.push(module("soft::bounds", "soft::bounds_multiscale")),
            Hierarchy::Y => all.push(module("soft::bounds", "soft::bounds_y")),
        }
        if !self.tally {
            all.push(module("soft::tally", "soft::no_tally"));
        }
        if self.reach > 0 {
            all.push(module("soft::named", "soft::named_triangles"));
        }
        all.extend(slots);
        // As the plain map's, since a light without an extent has its answer. Beyond the casters the map needs no room: what
        // lies outside of it is empty.
        Estimator { slots: all, read: MapRead::Texels, radius: 0.5, reach: 0.0, fetches }
    }
}

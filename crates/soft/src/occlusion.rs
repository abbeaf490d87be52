//! Occlusion textures.

use antumbra_gpu::{Expectation, Gpu, GpuError, Technique, TechniqueConfig};
use antumbra_map::{Estimator, MapConfig, MapRead, MapTechnique};
use antumbra_shaders::{module, source};
use serde::{Deserialize, Serialize};

use crate::expectation;
use crate::offset::Offset;
use crate::slices::SliceStore;
use crate::window::{Hierarchy, check_map};

/// How the shares that slices hide are put together.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Fusion {
    /// As if they hid points of the light independently of one another: right for leaves (Eisemann, Décoret 2006).
    #[default]
    Product,
    /// As if none hid what another hides: the darkest.
    Sum,
    /// As if the most hiding slice hid all that is hidden: the lightest.
    Max,
}

/// Where slices lie.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Placement {
    /// At equal distances, as published.
    Uniform,
    /// Half as dense as that, and the other half right before what the camera looks at, which is where a shadow needs its
    /// caster in a slice of its own. At equal distances where there is no camera. Cost: 256 rays to the boxes of bodies, on
    /// the CPU.
    #[default]
    Seen,
    /// So that what is flattened in them errs least, in the mean square over depths of casters and over what the camera looks
    /// at behind these. Where there is no camera, for the farthest receiver, or, where receivers are not known either, one a
    /// quarter beyond the casters. Cost: as `seen`, and some 0.3 ms a view on the CPU.
    Error,
}

/// What gives the covered share of a box.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Prefilter {
    /// A summed-area table: exact. 8 bytes a texel of a slice, and 4 for as long as it is made.
    #[default]
    Table,
    /// An N-buffer, the published choice: exact for squares of powers of two. 4 bytes a texel and level: 40 at 512 texels. Not
    /// for spheres, which would have more layers than textures have.
    NBuffer,
    /// A mipmap: 5 1/3 bytes a texel, and blocks that show.
    Mip,
}

/// Occlusion textures (Eisemann, Décoret 2006; 2008): casters in slices parallel to the light, whether the light's centre
/// sees them or not, and of each slice the share that hides the light, from a table of sums. Takes as long whatever the light's
/// size.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct OcclusionTextures {
    /// Side and layout; each slice of each view is an image of that side, default 512 texels. The bias is for lights
    /// without an extent.
    pub map: MapConfig,
    /// Slices, 1 to 32, default 8, as many as published tests have at most twice. Cost: a pass over the casters in it and a
    /// table each, and 16 fetches a sample.
    pub slices: u32,
    /// Where they lie.
    pub placement: Placement,
    /// How they are put together.
    pub fusion: Fusion,
    /// How they are averaged.
    pub prefilter: Prefilter,
    /// Draws what lies in a slice into the next one, too, so that thin surfaces that cut through several have no gaps between
    /// (section 3.4). Default false: umbrae grow.
    pub successor: bool,
    /// How far behind a slice its shadow has its full strength, in slices, 0 to 1, default 1: a receiver is not shadowed by its
    /// own slice, and by the one before as much as it lies behind it. Less gives harder contacts and seams. Slices thinner than
    /// where the light is seen through one texel of the image fade over that distance instead.
    pub fade: f32,
    /// Whether slices are seen from behind the light, default true, or from its centre.
    pub offset: bool,
    /// Boxes that stand for a round light, 1 to 16, default 8; 1 is the square around it. Cost: 16 fetches a slice
    /// each.
    pub strips: u32,
    /// Leaves out the slices of which the light's window is empty, which 4 fetches tell of a table, and what is left when all
    /// light is hidden. Default true; changes no answer.
    pub skip: bool,
    /// Counts on the GPU the windows that are skipped and those that are looked up, for measurements. Default false.
    pub tally: bool,
}

impl Default for OcclusionTextures {
    fn default() -> Self {
        Self {
            map: MapConfig { size: 512, ..MapConfig::default() },
            slices: 8,
            placement: Placement::default(),
            fusion: Fusion::default(),
            prefilter: Prefilter::default(),
            successor: false,
            fade: 1.0,
            offset: true,
            strips: 8,
            skip: true,
            tally: false,
        }
    }
}

/// Most slices, those of an array in `soft/occlusion.wesl`.
pub(crate) const MAX_SLICES: u32 = 32;

impl OcclusionTextures {
    /// # Errors
    /// A setting out of range.
    fn estimator(&self) -> Result<Estimator, GpuError> {
        let invalid = |what, value: String, fix| Err(GpuError::Invalid { what, value, fix });
        if !(1..=MAX_SLICES).contains(&self.slices) {
            return invalid("slices", self.slices.to_string(), "use 1 to 32");
        }
        if !(1..=16).contains(&self.strips) {
            return invalid("strips", self.strips.to_string(), "use 1 to 16");
        }
        if !(0.0..=1.0).contains(&self.fade) {
            return invalid("fade", self.fade.to_string(), "use 0 to 1 slices");
        }
        let fusion = match self.fusion {
            Fusion::Product => 0,
            Fusion::Sum => 1,
            Fusion::Max => 2,
        };
        let config = format!(
            "const SLICES: i32 = {};\nconst STRIPS: i32 = {};\nconst FUSION: i32 = {fusion};\nconst SKIP: bool = {};\n",
            self.slices, self.strips, self.skip,
        );
        let (store, prefilter, read) = match self.prefilter {
            Prefilter::Table => ("soft::slice_table", "soft::covered_table", MapRead::Unsigned),
            Prefilter::NBuffer | Prefilter::Mip => {
                ("soft::slice_levels", "soft::covered_levels", MapRead::Texels)
            }
        };
        let mut slots = vec![
            module("store", store),
            module("map::through", "soft::occlusion"),
            module("prefilter", prefilter),
            source("config", config),
            module(
                "soft::tally",
                if self.tally { "soft::window_tally" } else { "soft::no_window_tally" },
            ),
        ];
        match self.prefilter {
            Prefilter::Table => {}
            Prefilter::NBuffer => slots.push(module("level_mean", "soft::square_nbuffer")),
            Prefilter::Mip => slots.push(module("level_mean", "soft::square_mip")),
        }
        Ok(Estimator { slots, read, radius: 0.5, reach: 0.0, fetches: 16 * self.slices })
    }
}

impl TechniqueConfig for OcclusionTextures {
    fn build(&self, gpu: &Gpu) -> Result<Box<dyn Technique>, GpuError> {
        let estimator = self.estimator()?;
        check_map(&self.map, Hierarchy::None)?;
        let store = Box::new(SliceStore::new(gpu, self)?);
        let arrange = Box::new(Offset { hard: self.map.omni, offset: self.offset });
        Ok(Box::new(MapTechnique::arranged_with_store(gpu, &self.map, estimator, arrange, store)?))
    }

    fn set_map_size(&mut self, size: u32) {
        self.map.size = size;
    }

    fn expectation(&self, case: &str) -> Option<Expectation> {
        // Slices are no thicker than this many at equal distances.
        let count =
            f64::from(self.slices) * if self.placement == Placement::Seen { 0.5 } else { 1.0 };
        expectation::of_slices(&self.map, count, case)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_out_of_range_are_refused_with_a_fix() {
        let good = OcclusionTextures::default();
        for wrong in [
            OcclusionTextures { slices: 0, ..good },
            OcclusionTextures { slices: 33, ..good },
            OcclusionTextures { strips: 0, ..good },
            OcclusionTextures { fade: -0.5, ..good },
            OcclusionTextures { fade: f32::NAN, ..good },
        ] {
            assert!(wrong.estimator().is_err(), "{wrong:?}");
        }
        assert!(good.estimator().is_ok(), "the defaults");
    }
}

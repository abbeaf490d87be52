//! Soft shadows from a single light sample.

use antumbra_gpu::{Expectation, Gpu, GpuError, Technique, TechniqueConfig};
use antumbra_map::{Estimator, MapConfig, MapRead, MapTechnique};
use antumbra_shaders::{module, source};
use serde::{Deserialize, Serialize};

use crate::width_store::WidthStore;
use crate::{Facing, expectation};

/// How far it is from a texel in shadow to the nearest lit one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Widths {
    /// By steps to neighbours, each pass's twice as far as the last one's: the published form for graphics hardware. Too
    /// wide between the directions of the neighbours.
    #[default]
    Doubling,
    /// Along rows and columns, by four sweeps: the published form for processors. Too wide by up to sqrt(2). One thread a
    /// line, in as many passes whatever the widths.
    CityBlock,
    /// The distance itself: two sweeps, and a search of each column that takes longer the wider shadows are, and no longer
    /// than the widest penumbra asks for.
    Euclidean,
}

/// How depth and width are read between texels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum WidthLookup {
    /// As the texel has them.
    Texel,
    /// Both interpolated: what a linear filter gives, as published for coarse maps (section 5). Jumps at the shadow's border
    /// where the receiver is near.
    Linear,
    /// Width interpolated and measured to the border of the lit texel, depth as the texel has it: 1 at the border.
    #[default]
    Border,
}

/// Soft shadows from a single light sample (Kirsch, Döllner 2003): a second map says how deep inside the shadow each texel
/// lies, and that in proportion to how far behind its occluder a point lies says how dark it is. A fake with an inner
/// penumbra only: what the light's centre sees is lit. One lookup a sample; the second map costs passes over texels, whatever
/// the casters. 8 bytes a texel beside the map.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SingleSample {
    /// The shadow map.
    pub map: MapConfig,
    /// How widths are measured.
    pub widths: Widths,
    /// Neighbours of a texel that doubling looks at, 3, 4, 6 or 8, default 6 as in the paper's figures (its table has 3, too).
    /// Cost: one fetch a texel and pass each.
    pub neighbours: u32,
    /// Passes of doubling, 0 to 14: widths up to 2^n - 1 texels, and what is deeper inside is dark. Default 0: as many as the
    /// light's widest penumbra needs. Cost: each alike. Euclidean widths are searched for as far.
    pub doublings: u32,
    /// Counts shadow depth from the casters' far sides, for casters that lie one above the other: the shadow of the lower
    /// one is then as hard within the other's as beside it. Default false. Not for casters that shadow themselves. Costs a
    /// second pass over the casters and 4 bytes a texel.
    pub back: bool,
    /// How the maps are read between texels.
    pub lookup: WidthLookup,
    /// How fast light falls with width over depth, more than 0, default 1: of a full light to none over half the penumbra
    /// of a straight edge, from its middle inwards. Published as 1 in arbitrary units; greater is harder.
    pub scale: f32,
    /// What is added to the light there, 0 to 1, default 0.05 as published, against artefacts at the shadow's border.
    pub bias: f32,
}

impl Default for SingleSample {
    fn default() -> Self {
        Self {
            map: MapConfig::default(),
            widths: Widths::default(),
            neighbours: 6,
            doublings: 0,
            back: false,
            lookup: WidthLookup::default(),
            scale: 1.0,
            bias: 0.05,
        }
    }
}

impl SingleSample {
    /// # Errors
    /// A setting out of range.
    pub(crate) fn validate(&self) -> Result<(), GpuError> {
        let invalid = |what, value: String, fix| Err(GpuError::Invalid { what, value, fix });
        if ![3, 4, 6, 8].contains(&self.neighbours) {
            return invalid("neighbours", self.neighbours.to_string(), "use 3, 4, 6 or 8");
        }
        if self.doublings > crate::twin::width::MAX_DOUBLINGS {
            let fix = "use 1 to 14, or 0 for as many as the light needs";
            return invalid("doublings", self.doublings.to_string(), fix);
        }
        if !(self.scale > 0.0 && self.scale.is_finite()) {
            return invalid("scale", self.scale.to_string(), "use a number greater than 0");
        }
        if !(0.0..=1.0).contains(&self.bias) {
            return invalid("bias", self.bias.to_string(), "use 0 to 1");
        }
        Ok(())
    }

    /// # Errors
    /// A setting out of range.
    fn estimator(&self) -> Result<Estimator, GpuError> {
        self.validate()?;
        let config = format!(
            "const LINEAR: bool = {};\nconst BORDER: bool = {};\nconst SCALE: f32 = {:?};\nconst BIAS: f32 = {:?};\n",
            self.lookup != WidthLookup::Texel,
            self.lookup == WidthLookup::Border,
            self.scale,
            self.bias,
        );
        let mut slots = vec![
            module("store", "common::depth_map"),
            module("map::through", "soft::through"),
            module("estimator", "soft::width"),
            source("config", config),
        ];
        let mut fetches = match self.lookup {
            WidthLookup::Texel => 2,
            WidthLookup::Border => 5,
            WidthLookup::Linear => 8,
        };
        if self.back {
            slots.push(module("soft::width_depth", "soft::width_depth_back"));
            fetches += if self.lookup == WidthLookup::Linear { 4 } else { 1 };
        }
        Ok(Estimator { slots, read: MapRead::Texels, radius: 0.5, reach: 0.0, fetches })
    }
}

impl TechniqueConfig for SingleSample {
    fn build(&self, gpu: &Gpu) -> Result<Box<dyn Technique>, GpuError> {
        let estimator = self.estimator()?;
        let store = Box::new(WidthStore::new(gpu, self)?);
        let arrange = Box::new(Facing { hard: self.map.omni, whole: true });
        Ok(Box::new(MapTechnique::arranged_with_store(gpu, &self.map, estimator, arrange, store)?))
    }

    fn set_map_size(&mut self, size: u32) {
        self.map.size = size;
    }

    fn expectation(&self, case: &str) -> Option<Expectation> {
        expectation::of_widths(&self.map, f64::from(self.scale), f64::from(self.bias), case)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_out_of_range_are_refused_with_a_fix() {
        let good = SingleSample::default();
        for wrong in [
            SingleSample { neighbours: 0, ..good },
            SingleSample { neighbours: 5, ..good },
            SingleSample { doublings: 15, ..good },
            SingleSample { scale: 0.0, ..good },
            SingleSample { scale: f32::INFINITY, ..good },
            SingleSample { scale: f32::NAN, ..good },
            SingleSample { bias: -0.1, ..good },
            SingleSample { bias: f32::NAN, ..good },
        ] {
            assert!(wrong.estimator().is_err(), "{wrong:?}");
        }
        assert!(good.estimator().is_ok(), "the defaults");
    }
}

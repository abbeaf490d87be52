//! Percentage-closer filtering over each pixel's own footprint in the map.

use antumbra_gpu::{
    Counters, Expectation, Frame, Gpu, GpuError, Recorder, Technique, TechniqueConfig,
};
use antumbra_map::{Estimator, MapConfig, MapRead, MapTechnique, ShadowMap, Store};
use antumbra_shaders::module;
use serde::{Deserialize, Serialize};

use crate::expectation::compared;
use crate::eye::Eye;
use crate::prefilter::{Constant, check, constants};

/// PCF over the pixel's footprint: the right kernel for a minified map, and the measure for all that filters ahead. Its
/// cost has no bound but `largest`.
///
/// An elliptical Gaussian (Heckbert 1989) of standard deviation 1/2 pixel, joined with one of 1/2 texel that reconstructs
/// a magnified map. Without a camera it is the latter.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PcfFootprint {
    /// The shadow map.
    pub map: MapConfig,
    /// How far the kernel may reach, texels an axis, 1 to 64, default 8: footprints of up to 16 texels a pixel are
    /// filtered in full. Cost: a compare for each texel of the footprint, up to (2 `largest` + 1)² a sample.
    pub largest: f32,
}

impl Default for PcfFootprint {
    fn default() -> Self {
        Self { map: MapConfig::default(), largest: 8.0 }
    }
}

impl PcfFootprint {
    /// The estimator, for any layout. It reads the camera in bind group 2.
    ///
    /// # Errors
    /// A reach out of range.
    pub fn estimator(&self) -> Result<Estimator, GpuError> {
        check("largest", self.largest, 1.0..=64.0, "use 1 to 64 texels")?;
        Ok(Estimator {
            slots: vec![
                module("store", "common::depth_map"),
                module("estimator", "filter::pcf_footprint"),
                constants(&[("MOST", Constant::Float(self.largest.into()))]),
            ],
            read: MapRead::Texels,
            radius: self.largest,
            reach: 0.0,
            fetches: (2 * self.largest.ceil() as u32 + 1).pow(2),
        })
    }

    /// The technique, with its map at hand.
    ///
    /// # Errors
    /// A reach out of range, or a size beyond the device's limits.
    pub fn technique(&self, gpu: &Gpu) -> Result<MapTechnique, GpuError> {
        let seen = Box::new(Seen { eye: Eye::new(gpu), map: None });
        MapTechnique::with_store(gpu, &self.map, self.estimator()?, seen)
    }
}

impl TechniqueConfig for PcfFootprint {
    fn build(&self, gpu: &Gpu) -> Result<Box<dyn Technique>, GpuError> {
        Ok(Box::new(self.technique(gpu)?))
    }

    fn set_map_size(&mut self, size: u32) {
        self.map.size = size;
    }

    fn expectation(&self, case: &str) -> Option<Expectation> {
        let usual = compared(&self.map, &self.estimator().ok()?, case)?;
        Some(match usual {
            // At a texel's size the kernel is far narrower than its reach, and no wider than one texel's own.
            Expectation::KnownLimit { at_least, because, .. } if case.starts_with("HC-31") => {
                Expectation::KnownLimit { at_least, at_most: 1.0, because }
            }
            _ => usual,
        })
    }
}

/// The map as it is, and the camera beside it.
#[derive(Debug)]
struct Seen {
    eye: Eye,
    map: Option<wgpu::TextureView>,
}

impl Store for Seen {
    fn prepare(&mut self, gpu: &Gpu, frame: &Frame<'_>, map: &ShadowMap) -> Result<(), GpuError> {
        self.eye.prepare(gpu, frame);
        self.map = map.view().cloned();
        Ok(())
    }

    fn encode(
        &mut self,
        _gpu: &Gpu,
        _frame: &Frame<'_>,
        _map: &ShadowMap,
        _recorder: &mut Recorder<'_>,
    ) -> Result<(), GpuError> {
        Ok(())
    }

    fn group_layout(&self) -> Option<&wgpu::BindGroupLayout> {
        Some(self.eye.layout())
    }

    fn group(&self) -> Option<&wgpu::BindGroup> {
        self.eye.group()
    }

    fn view(&self) -> Option<&wgpu::TextureView> {
        self.map.as_ref()
    }

    fn counters(&self) -> Counters {
        Counters::new()
    }

    fn bytes(&self) -> u64 {
        self.eye.bytes()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_reach_out_of_range_is_refused_with_a_fix() {
        assert!(PcfFootprint::default().estimator().is_ok(), "the default");
        for largest in [0.5, 65.0, f32::NAN] {
            let config = PcfFootprint { largest, ..PcfFootprint::default() };
            assert!(matches!(config.estimator(), Err(GpuError::Invalid { .. })), "{largest}");
        }
    }
}

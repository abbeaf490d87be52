//! Real-time shadow techniques on wgpu, measured against ground truth.
//!
//! The facade over the technique crates: one config ([`Config`]), one entry point ([`Config::build`]), and
//! the list of everything there is ([`catalogue`]). Each technique crate can be used without it.
//!
//! The caller owns device, encoder and frame; a technique records its passes:
//!
//! ```no_run
//! use antumbra::Config;
//! use antumbra::gpu::{Frame, Gpu, MeshSet, Recorder, ViewSamples, wgpu};
//! use antumbra::scene::{Camera, LightKind, LoadOptions, load};
//!
//! # fn example(device: wgpu::Device, queue: wgpu::Queue, depth: wgpu::TextureView)
//! # -> Result<(), Box<dyn std::error::Error>> {
//! let gpu = Gpu::from_device(device, queue);
//! let (scene, _) = load("town.glb".as_ref(), &LoadOptions::default())?;
//! let camera: Camera = scene.camera_or_framing();
//! let light = scene.light_or_placed(LightKind::Directional);
//!
//! // What casts shadows, and what the camera sees. An engine brings its own: `Casters`, `DepthSamples`.
//! let meshes = MeshSet::new(&gpu, &scene)?;
//! let samples = ViewSamples::new(&gpu, 1280, 720)?;
//! let visibility = samples.visibility_target(&gpu)?.create_view(&Default::default());
//!
//! // Any technique by its id, here with a setting of its own.
//! let config: Config = serde_json::from_str(r#"{ "technique": "filter/pcf-grid", "side": 5 }"#)?;
//! let mut shadows = config.build(&gpu)?;
//!
//! let frame =
//!     Frame { samples: &samples, light: &light, casters: &meshes, origin: meshes.origin() };
//! let mut encoder = gpu.device.create_command_encoder(&Default::default());
//! let mut recorder = Recorder::new(&mut encoder);
//! meshes.encode_view_samples(&gpu, &mut recorder, &camera, &depth, &samples);
//! shadows.prepare(&gpu, &frame)?;
//! shadows.encode(&gpu, &frame, &mut recorder, &visibility)?;
//! gpu.queue.submit([encoder.finish()]);
//! # Ok(())
//! # }
//! ```

mod expectation;

use antumbra_gpu::{Gpu, GpuError, Technique};
use serde::{Deserialize, Serialize};

pub use antumbra_gpu as gpu;
pub use antumbra_map as map;
pub use antumbra_scene as scene;
pub use expectation::Expectation;

#[cfg(feature = "filter")]
pub use antumbra_filter as filter;

use antumbra_map::{MapConfig, MapTechnique};

/// Any technique, with its settings. In serialised form the technique's id is the tag:
/// `{"technique": "filter/pcf-grid", "side": 5}`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "technique")]
#[non_exhaustive]
pub enum Config {
    /// The plain shadow map.
    #[serde(rename = "map/plain")]
    Plain(Plain),
    /// Regular PCF.
    #[cfg(feature = "filter")]
    #[serde(rename = "filter/pcf-grid")]
    PcfGrid(antumbra_filter::PcfGrid),
    /// Bilinear comparison in hardware.
    #[cfg(feature = "filter")]
    #[serde(rename = "filter/pcf-hardware")]
    PcfHardware(antumbra_filter::PcfHardware),
    /// A grid of bilinear taps.
    #[cfg(feature = "filter")]
    #[serde(rename = "filter/pcf-bilinear-grid")]
    PcfBilinearGrid(antumbra_filter::PcfBilinearGrid),
    /// Castano's kernels.
    #[cfg(feature = "filter")]
    #[serde(rename = "filter/pcf-castano")]
    PcfCastano(antumbra_filter::PcfCastano),
    /// A turned Poisson disc.
    #[cfg(feature = "filter")]
    #[serde(rename = "filter/pcf-poisson")]
    PcfPoisson(antumbra_filter::PcfPoisson),
}

/// The plain shadow map: one texel, one comparison (Williams 1978).
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Plain {
    /// The shadow map.
    pub map: MapConfig,
}

/// Every technique with its published defaults.
#[must_use]
pub fn catalogue() -> Vec<Config> {
    vec![
        Config::Plain(Plain::default()),
        #[cfg(feature = "filter")]
        Config::PcfHardware(Default::default()),
        #[cfg(feature = "filter")]
        Config::PcfGrid(Default::default()),
        #[cfg(feature = "filter")]
        Config::PcfBilinearGrid(Default::default()),
        #[cfg(feature = "filter")]
        Config::PcfCastano(Default::default()),
        #[cfg(feature = "filter")]
        Config::PcfPoisson(Default::default()),
    ]
}

impl Config {
    /// The technique's id, `family/name`.
    #[must_use]
    pub fn id(&self) -> &'static str {
        match self {
            Self::Plain(_) => "map/plain",
            #[cfg(feature = "filter")]
            Self::PcfGrid(_) => "filter/pcf-grid",
            #[cfg(feature = "filter")]
            Self::PcfHardware(_) => "filter/pcf-hardware",
            #[cfg(feature = "filter")]
            Self::PcfBilinearGrid(_) => "filter/pcf-bilinear-grid",
            #[cfg(feature = "filter")]
            Self::PcfCastano(_) => "filter/pcf-castano",
            #[cfg(feature = "filter")]
            Self::PcfPoisson(_) => "filter/pcf-poisson",
        }
    }

    /// The settings of the shadow map under the technique.
    pub fn map_mut(&mut self) -> &mut MapConfig {
        match self {
            Self::Plain(c) => &mut c.map,
            #[cfg(feature = "filter")]
            Self::PcfGrid(c) => &mut c.map,
            #[cfg(feature = "filter")]
            Self::PcfHardware(c) => &mut c.map,
            #[cfg(feature = "filter")]
            Self::PcfBilinearGrid(c) => &mut c.map,
            #[cfg(feature = "filter")]
            Self::PcfCastano(c) => &mut c.map,
            #[cfg(feature = "filter")]
            Self::PcfPoisson(c) => &mut c.map,
        }
    }

    /// Builds the technique.
    ///
    /// # Errors
    /// A setting out of range or beyond the device's limits; the error says the fix.
    pub fn build(&self, gpu: &Gpu) -> Result<Box<dyn Technique>, GpuError> {
        Ok(match self {
            Self::Plain(c) => Box::new(MapTechnique::plain(gpu, &c.map)?),
            #[cfg(feature = "filter")]
            Self::PcfGrid(c) => Box::new(c.technique(gpu)?),
            #[cfg(feature = "filter")]
            Self::PcfHardware(c) => Box::new(c.technique(gpu)?),
            #[cfg(feature = "filter")]
            Self::PcfBilinearGrid(c) => Box::new(c.technique(gpu)?),
            #[cfg(feature = "filter")]
            Self::PcfCastano(c) => Box::new(c.technique(gpu)?),
            #[cfg(feature = "filter")]
            Self::PcfPoisson(c) => Box::new(c.technique(gpu)?),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_config_survives_its_serialised_form_under_its_id() {
        for config in catalogue() {
            let value = serde_json::to_value(config).expect("configs serialise");
            assert_eq!(value["technique"], config.id(), "the tag is the id");
            let back: Config = serde_json::from_value(value).expect("and come back");
            assert_eq!(back, config, "unchanged");
        }
    }

    #[test]
    fn an_id_alone_gives_the_defaults_and_unknown_fields_are_refused() {
        for config in catalogue() {
            let text = format!(r#"{{ "technique": "{}" }}"#, config.id());
            let parsed: Config = serde_json::from_str(&text).expect("defaults fill the rest");
            assert_eq!(parsed, config, "defaults");
        }
        let wrong = r#"{ "technique": "filter/pcf-grid", "sides": 5 }"#;
        assert!(serde_json::from_str::<Config>(wrong).is_err(), "a misspelt field is an error");
    }
}

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
//! let camera = meshes.view_camera(&camera, samples.size());
//! let frame = Frame {
//!     samples: &samples,
//!     camera: Some(camera),
//!     light: &light,
//!     casters: &meshes,
//!     origin: meshes.origin(),
//! };
//! let mut encoder = gpu.device.create_command_encoder(&Default::default());
//! let mut recorder = Recorder::new(&mut encoder);
//! meshes.encode_view_samples(&gpu, &mut recorder, &camera, &depth, &samples);
//! shadows.prepare(&gpu, &frame)?;
//! shadows.encode(&gpu, &frame, &mut recorder, &visibility)?;
//! gpu.queue.submit([encoder.finish()]);
//! # Ok(())
//! # }
//! ```

use antumbra_gpu::{Expectation, Gpu, GpuError, Technique, TechniqueConfig};
use serde::{Deserialize, Serialize};

pub use antumbra_gpu as gpu;
pub use antumbra_map as map;
pub use antumbra_scene as scene;

#[cfg(feature = "filter")]
pub use antumbra_filter as filter;

#[cfg(feature = "sampling")]
pub use antumbra_sampling as sampling;

#[cfg(feature = "soft")]
pub use antumbra_soft as soft;

#[cfg(feature = "volume")]
pub use antumbra_volume as volume;

/// Makes [`Config`] of a list of techniques, one line each: name, settings and id.
macro_rules! techniques {
    ($($(#[cfg($cfg:meta)])? #[doc = $about:literal] $name:ident($settings:ty) = $id:literal,)*) => {
        /// Any technique, with its settings. In serialised form the technique's id is the tag:
        /// `{"technique": "filter/pcf-grid", "side": 5}`.
        #[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
        #[serde(tag = "technique")]
        #[non_exhaustive]
        pub enum Config {
            $($(#[cfg($cfg)])? #[doc = $about] #[serde(rename = $id)] $name($settings),)*
        }

        /// Every technique with its published defaults.
        #[must_use]
        pub fn catalogue() -> Vec<Config> {
            vec![$($(#[cfg($cfg)])? Config::$name(Default::default()),)*]
        }

        impl Config {
            /// The technique's id, `family/name`.
            #[must_use]
            pub fn id(&self) -> &'static str {
                match self {
                    $($(#[cfg($cfg)])? Self::$name(_) => $id,)*
                }
            }

            /// The technique's settings.
            #[must_use]
            pub fn settings(&self) -> &dyn TechniqueConfig {
                match self {
                    $($(#[cfg($cfg)])? Self::$name(settings) => settings,)*
                }
            }

            /// As [`Config::settings`], to be changed.
            pub fn settings_mut(&mut self) -> &mut dyn TechniqueConfig {
                match self {
                    $($(#[cfg($cfg)])? Self::$name(settings) => settings,)*
                }
            }
        }
    };
}

techniques! {
    /// The plain shadow map.
    Plain(antumbra_map::Plain) = "map/plain",
    /// The far sides of casters in place of the near ones.
    SecondDepth(antumbra_map::SecondDepth) = "map/second-depth",
    /// Halfway between the first two surfaces.
    Midpoint(antumbra_map::Midpoint) = "map/midpoint",
    /// The midpoint, with a limit.
    DualLayers(antumbra_map::DualLayers) = "map/dual-layers",
    /// The receiver's own triangle in the texel.
    PolygonId(antumbra_map::PolygonId) = "map/polygon-id",
    /// The receiver's own object in the texel.
    ObjectId(antumbra_map::ObjectId) = "map/object-id",
    /// The texel's triangle itself.
    TriangleDepth(antumbra_map::TriangleDepth) = "map/triangle-depth",
    /// Spans of depth along the map's rows.
    ScanLines(antumbra_map::ScanLines) = "map/scan-lines",
    /// The hardware's polygon offset.
    SlopeBias(antumbra_map::SlopeBias) = "map/slope-bias",
    /// The receiver moved along its normal.
    NormalOffset(antumbra_map::NormalOffset) = "map/normal-offset",
    /// Casters flattened onto planes.
    Planar(antumbra_map::Planar) = "map/planar",
    /// A mask of the casters, thrown onto planes.
    ShadowTexture(antumbra_map::ShadowTexture) = "map/shadow-texture",
    /// A disc under each body.
    Disc(antumbra_map::DiscShadows) = "map/disc",
    #[cfg(feature = "filter")]
    /// Bilinear comparison in hardware.
    PcfHardware(antumbra_filter::PcfHardware) = "filter/pcf-hardware",
    #[cfg(feature = "filter")]
    /// Regular PCF.
    PcfGrid(antumbra_filter::PcfGrid) = "filter/pcf-grid",
    #[cfg(feature = "filter")]
    /// A grid of bilinear taps.
    PcfBilinearGrid(antumbra_filter::PcfBilinearGrid) = "filter/pcf-bilinear-grid",
    #[cfg(feature = "filter")]
    /// Castano's kernels.
    PcfCastano(antumbra_filter::PcfCastano) = "filter/pcf-castano",
    #[cfg(feature = "filter")]
    /// A turned Poisson disc.
    PcfPoisson(antumbra_filter::PcfPoisson) = "filter/pcf-poisson",
    #[cfg(feature = "filter")]
    /// The cubic B-spline.
    PcfCubic(antumbra_filter::PcfCubic) = "filter/pcf-cubic",
    #[cfg(feature = "filter")]
    /// A disc whose rim is looked at first.
    PcfAdaptive(antumbra_filter::PcfAdaptive) = "filter/pcf-adaptive",
    #[cfg(feature = "filter")]
    /// Taps shared out among neighbouring pixels.
    Interleaved(antumbra_filter::Interleaved) = "filter/interleaved",
    #[cfg(feature = "filter")]
    /// The pixel's footprint in the map.
    PcfFootprint(antumbra_filter::PcfFootprint) = "filter/pcf-footprint",
    #[cfg(feature = "filter")]
    /// The least and the largest depth of a kernel.
    MultipleDepth(antumbra_filter::MultipleDepth) = "filter/multiple-depth",
    #[cfg(feature = "filter")]
    /// Variance shadow maps.
    Vsm(antumbra_filter::Vsm) = "filter/vsm",
    #[cfg(feature = "filter")]
    /// Variance shadow maps of slices of the depth range.
    Lvsm(antumbra_filter::Lvsm) = "filter/lvsm",
    #[cfg(feature = "filter")]
    /// Variance shadow maps over boxes of any size.
    Savsm(antumbra_filter::Savsm) = "filter/savsm",
    #[cfg(feature = "filter")]
    /// Convolution shadow maps.
    Convolution(antumbra_filter::Convolution) = "filter/convolution",
    #[cfg(feature = "filter")]
    /// Blurred depth: what not to do.
    BlurredDepth(antumbra_filter::BlurredDepth) = "filter/blurred-depth",
    #[cfg(feature = "filter")]
    /// Blurred depth, compared softly: a look.
    SoftComparison(antumbra_filter::SoftComparison) = "filter/soft-comparison",
    #[cfg(feature = "filter")]
    /// Exponential shadow maps.
    Esm(antumbra_filter::Esm) = "filter/esm",
    #[cfg(feature = "filter")]
    /// Exponential variance shadow maps.
    Evsm(antumbra_filter::Evsm) = "filter/evsm",
    #[cfg(feature = "filter")]
    /// Moment shadow maps.
    Msm(antumbra_filter::Msm) = "filter/msm",
    #[cfg(feature = "filter")]
    /// Depths as if a power function were their distribution.
    PowerFunction(antumbra_filter::PowerFunction) = "filter/power-function",
    #[cfg(feature = "sampling")]
    /// One map a slice of the view's depths.
    Cascades(antumbra_sampling::Cascades<Box<Config>>) = "sampling/cascades",
    #[cfg(feature = "sampling")]
    /// Cascades measured from what is seen.
    Sdsm(antumbra_sampling::Sdsm<Box<Config>>) = "sampling/sdsm",
    #[cfg(feature = "sampling")]
    /// A map warped so that errors near and far are the same.
    Lispsm(antumbra_sampling::Lispsm<Box<Config>>) = "sampling/lispsm",
    #[cfg(feature = "sampling")]
    /// A map warped so that what is near gets its share.
    Tsm(antumbra_sampling::Tsm<Box<Config>>) = "sampling/tsm",
    #[cfg(feature = "sampling")]
    /// A map warped as the view is.
    Psm(antumbra_sampling::Psm<Box<Config>>) = "sampling/psm",
    #[cfg(feature = "sampling")]
    /// Pages as fine as the view asks for.
    ResolutionMatched(antumbra_sampling::ResolutionMatched<Box<Config>>) = "sampling/matched",
    #[cfg(feature = "sampling")]
    /// The view's samples in place of a map's.
    ViewSampleMapping(antumbra_sampling::ViewSampleMapping) = "sampling/view-samples",
    #[cfg(feature = "soft")]
    /// Percentage-closer soft shadows.
    Pcss(antumbra_soft::Pcss) = "soft/pcss",
    #[cfg(feature = "soft")]
    /// Texels projected back onto the light, their areas added up.
    BackProjection(antumbra_soft::BackProjection) = "soft/back-projection",
    #[cfg(feature = "soft")]
    /// Texels projected back onto the light, as bits for its samples.
    Bitmask(antumbra_soft::Bitmask) = "soft/bitmask",
    #[cfg(feature = "soft")]
    /// Percentage-closer soft shadows from two moments of depth.
    Vssm(antumbra_soft::Vssm) = "soft/vssm",
    #[cfg(feature = "soft")]
    /// The hard shadow, lighter the nearer its border and the farther behind its caster.
    SingleSample(antumbra_soft::SingleSample) = "soft/single-sample",
    #[cfg(feature = "soft")]
    /// The distance to the nearest texel of which the other is true, hidden or lit.
    RadialSearch(antumbra_soft::RadialSearch) = "soft/radial-search",
    #[cfg(feature = "soft")]
    /// Slices of the casters, each blurred as its distance asks.
    OcclusionTextures(antumbra_soft::OcclusionTextures) = "soft/occlusion-textures",
    #[cfg(feature = "volume")]
    /// Each triangle's shadow volume asked whether it contains the sample.
    VolumeTriangle(antumbra_volume::Triangle) = "volume/triangle",
    #[cfg(feature = "volume")]
    /// Shadow volumes counted behind the sample.
    VolumeZFail(antumbra_volume::ZFail) = "volume/z-fail",
    #[cfg(feature = "volume")]
    /// Shadow volumes counted in front of the sample.
    VolumeZPass(antumbra_volume::ZPass) = "volume/z-pass",
    #[cfg(feature = "volume")]
    /// Shadow volumes counted in front of the sample from the eye's own count.
    VolumeCounter(antumbra_volume::EyeCounter) = "volume/counter",
    #[cfg(feature = "volume")]
    /// Shadow volumes counted in front of the sample from the near plane's counts.
    VolumeZpPlus(antumbra_volume::ZpPlus) = "volume/zp-plus",
    #[cfg(feature = "volume")]
    /// Shadow volumes counted in front of the sample or behind it, whichever is safe.
    VolumeAuto(antumbra_volume::Auto) = "volume/auto",
    #[cfg(feature = "volume")]
    /// Shadow volumes of whole meshes, bounded by their silhouettes.
    VolumeSilhouette(antumbra_volume::Silhouette) = "volume/silhouette",
    #[cfg(feature = "volume")]
    /// Translucent casters over any other technique.
    Translucent(antumbra_volume::Translucent<Box<Config>>) = "volume/translucent",
}

impl Config {
    /// Builds the technique.
    ///
    /// # Errors
    /// A setting out of range or beyond the device's limits; the error says the fix.
    pub fn build(&self, gpu: &Gpu) -> Result<Box<dyn Technique>, GpuError> {
        self.settings().build(gpu)
    }

    /// Sets the side of the technique's maps, texels. Without a map there is nothing to set.
    pub fn set_map_size(&mut self, size: u32) {
        self.settings_mut().set_map_size(size);
    }

    /// What theory says of the technique, with these settings, on the hard case of that name; `None` for a
    /// case of which nobody has said.
    #[must_use]
    pub fn expectation(&self, case: &str) -> Option<Expectation> {
        self.settings().expectation(case)
    }
}

/// The plain shadow map.
impl Default for Config {
    fn default() -> Self {
        Self::Plain(antumbra_map::Plain::default())
    }
}

/// So that a technique can be built on any other.
impl TechniqueConfig for Config {
    fn build(&self, gpu: &Gpu) -> Result<Box<dyn Technique>, GpuError> {
        self.settings().build(gpu)
    }

    fn set_map_size(&mut self, size: u32) {
        self.settings_mut().set_map_size(size);
    }

    fn map_size(&self) -> Option<u32> {
        self.settings().map_size()
    }

    fn expectation(&self, case: &str) -> Option<Expectation> {
        self.settings().expectation(case)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_config_survives_its_serialised_form_under_its_id() {
        for config in catalogue() {
            let value = serde_json::to_value(&config).expect("configs serialise");
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

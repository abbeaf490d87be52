//! The shared wgpu context: device, probe, frame inputs, passes with timestamps, readback.
//!
//! Image-based techniques take a *frame* (view samples, a light, casters) and write visibility. The
//! caller owns the device, the command encoder and the submission; [`Gpu`] wraps either an own
//! device ([`Gpu::new`]) or the caller's ([`Gpu::from_device`]).
//!
//! Spaces: everything on the GPU is `f32`, metres, relative to the frame's *origin*, a world position
//! in `f64` ([`antumbra_scene::Scene::origin`]), so that scenes far from the world's origin keep
//! their precision. Clip space is WebGPU's: z in [0, 1], y up; texture v runs down.

mod blur;
mod context;
mod edges;
mod error;
mod expectation;
mod layers;
mod lines;
mod mesh_set;
mod pipeline;
mod probe;
mod pyramid;
mod readback;
mod record;
mod samples;
mod sat;
mod scan;
mod technique;

pub use blur::{Blur, BlurJob, BlurShader, MAX_BLUR_RADIUS, blur_rounding};
pub use context::{Gpu, GpuOptions};
pub use edges::{Body, CasterEdges, EdgeFault, Edges};
pub use error::GpuError;
pub use expectation::Expectation;
pub use layers::Layers;
pub use lines::{Gate, LayerJob};
pub use mesh_set::MeshSet;
pub use pipeline::{BindGroupCache, bind, entries};
pub use probe::{Check, Probe, Verdict, probe};
pub use pyramid::{Anchor, Beyond, Pyramid, PyramidKind};
pub use readback::{read_buffer, read_f32_level, read_f32_texture, read_u32_texture};
pub use record::{PassTime, PassTimes, Recorder, Timer};
pub use samples::{DepthCamera, DepthSamples, SUBPIXEL_STEP, SampleImage, ViewSamples};
pub use sat::{Sat, SatNumbers, SatShader, sat_rounding};
pub use scan::Scan;
pub use technique::{
    CasterBody, CasterClusters, CasterTriangles, Casters, Counters, Drawn, Frame, LightView,
    ListedTriangles, Technique, TechniqueConfig, TranslucentTriangles, ViewCamera, check_light,
    light_view_layout,
};

pub use wgpu;

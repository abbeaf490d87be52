//! Separable filters over layers of array textures, with an encoding and a mean of the caller's.

use antumbra_shaders::{Slot, blur_target, module, source};

use crate::lines::{Gate, JobUniform, LayerJob, Lines, texel_name};
use crate::{Gpu, GpuError, Recorder};

/// One layer to make.
pub type BlurJob = LayerJob;

/// Largest radius, texels: the weights of 63 texels fill the pass's uniform.
pub const MAX_BLUR_RADIUS: u32 = 31;

/// What a [`Blur`] reads, how it averages, and what it writes.
#[derive(Clone, Debug)]
pub struct BlurShader {
    /// Module for the slot `texel`: reads and encodes a texel in the first of the two passes.
    pub texel: &'static str,
    /// Module for the slot `mean` (`gpu::mean::arithmetic`).
    pub mean: &'static str,
    /// What these modules import beyond.
    pub slots: Vec<Slot>,
    /// What is written at the end: `R32Float`, `Rg32Float`, `Rgba32Float`; `Rgba8Unorm` for four channels in [0, 1]
    /// at 8 bits each, or `Rg32Uint` for as many at 16 bits (`pack2x16unorm`).
    pub format: wgpu::TextureFormat,
}

/// A separable filter: two passes a layer, of 2 radius + 1 taps each, through one layer of intermediate
/// results. The work does not depend on what is filtered.
#[derive(Debug)]
pub struct Blur {
    weights: Vec<f32>,
    lines: Lines,
}

/// Layout of `Job` in `gpu/blur.wesl`.
#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
struct Uniform {
    job: JobUniform,
    weights: [f32; 64],
}

impl Blur {
    /// Links and compiles the passes. `weights` are those of the texels from -radius to radius, not negative,
    /// and are scaled to the sum 1.
    ///
    /// # Errors
    /// An even number of weights or more than 63, a negative one, a format that is not one of the five, or a
    /// shader that does not link.
    pub fn new(gpu: &Gpu, shader: &BlurShader, weights: &[f64]) -> Result<Self, GpuError> {
        let sum: f64 = weights.iter().sum();
        let usable = weights.len() % 2 == 1
            && weights.len() / 2 <= MAX_BLUR_RADIUS as usize
            && weights.iter().all(|w| *w >= 0.0)
            && sum > 0.0
            && sum.is_finite();
        if !usable {
            return Err(GpuError::Invalid {
                what: "weights of a blur",
                value: format!("{weights:?}"),
                fix: "use 1, 3, 5 .. 63 numbers >= 0, not all of them 0",
            });
        }
        use wgpu::TextureFormat::{R32Float, Rg32Float, Rg32Uint, Rgba8Unorm, Rgba32Float};
        let between = match shader.format {
            // Rounded once, at the end.
            Rg32Uint | Rgba8Unorm => Rgba32Float,
            R32Float | Rg32Float | Rgba32Float => shader.format,
            other => {
                return Err(GpuError::Invalid {
                    what: "format of a blur",
                    value: format!("{other:?}"),
                    fix: "use R32Float, Rg32Float, Rgba32Float, Rgba8Unorm or Rg32Uint",
                });
            }
        };
        let formats = [between, shader.format];
        let slots = |texel: &'static str, format| {
            let mut slots = shader.slots.clone();
            slots.extend([
                module("texel", texel),
                module("mean", shader.mean),
                source("target", blur_target(texel_name(format))),
                source("blur_config", format!("const RADIUS: i32 = {};", weights.len() / 2)),
            ]);
            slots
        };
        let passes = [slots(shader.texel, formats[0]), slots("gpu::stored_texel", formats[1])];
        let shader = ("blur", "gpu::blur", "blur");
        Ok(Self {
            weights: weights.iter().map(|w| (w / sum) as f32).collect(),
            lines: Lines::new(gpu, shader, passes, formats, size_of::<Uniform>())?,
        })
    }

    /// Makes room for a layer of `size` x `size` texels for each job, and uploads the jobs. `source` is a
    /// `D2Array` view of a texture, of that size unless the texel module takes it otherwise. Allocates nothing when there
    /// is room.
    ///
    /// # Errors
    /// A failed allocation.
    pub fn prepare(
        &mut self,
        gpu: &Gpu,
        source: &wgpu::TextureView,
        size: u32,
        jobs: &[BlurJob],
    ) -> Result<(), GpuError> {
        let mut weights = [0.0; 64];
        weights[..self.weights.len()].copy_from_slice(&self.weights);
        self.lines.prepare(gpu, source, size, jobs, |job| Uniform { job, weights })
    }

    /// Records the jobs of the last [`Blur::prepare`] as one pass called `name`.
    pub fn encode(&self, recorder: &mut Recorder<'_>, name: &'static str) {
        self.lines.encode(recorder, name, workgroups);
    }

    /// As [`Blur::encode`], but where `gate` says that the source is as it was, and the jobs are, layers stay as they are.
    pub fn encode_gated(
        &mut self,
        gpu: &Gpu,
        recorder: &mut Recorder<'_>,
        name: &'static str,
        gate: Option<&Gate>,
    ) {
        self.lines.encode_gated(gpu, recorder, name, workgroups, gate);
    }

    /// The filtered layers, one a job, as a `D2Array` view.
    #[must_use]
    pub fn view(&self) -> Option<&wgpu::TextureView> {
        self.lines.view()
    }

    /// The filtered layers.
    #[must_use]
    pub fn texture(&self) -> Option<&wgpu::Texture> {
        self.lines.texture()
    }

    /// Texels that the recorded jobs write, intermediate ones included; if a gate decides on them, at most.
    #[must_use]
    pub fn texels(&self) -> u64 {
        self.lines.texels()
    }

    /// Texels that the jobs of the last submitted frame wrote. Waits.
    ///
    /// # Errors
    /// A lost device.
    pub fn read_texels(&self, gpu: &Gpu) -> Result<u64, GpuError> {
        self.lines.read_texels(gpu)
    }

    /// Bytes of GPU memory held.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        self.lines.bytes()
    }
}

/// Workgroups of a pass over a layer of `size` texels a side.
fn workgroups(size: u32) -> [u32; 2] {
    [size.div_ceil(64), size]
}

/// Bound, relative to the largest magnitude in the window, on the rounding of a filtered value of a blur
/// with `radius`, in f32. With u = 2^-24, a pass of n taps rounds each weight and each product once and adds
/// n - 1 times: at most (n + 1) u; there are two passes.
#[must_use]
pub fn blur_rounding(radius: u32) -> f64 {
    let taps = f64::from(2 * radius + 1);
    2.0 * (taps + 1.0) * 2f64.powi(-24)
}

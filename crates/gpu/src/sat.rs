//! Summed-area tables (Crow 1984): the sum of any rectangle of texels in four reads, whatever its size.

use antumbra_shaders::{Slot, module, source, table_target};

use crate::lines::{JobUniform, LayerJob, Lines, texel_name};
use crate::{Gpu, GpuError, Recorder};

/// How a table keeps its sums.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SatNumbers {
    /// Values in [0, 1] as integers of so many bits, 1 to 24, summed modulo 2^32. A rectangle's sum, being a difference
    /// of sums, is exact as long as it is itself below 2^32 ([`SatNumbers::fixed`]), however large the table: the only
    /// error is a value's rounding, half a step.
    Fixed {
        /// Bits of a value.
        bits: u32,
    },
    /// Floats. A sum is rounded in proportion to the whole table's ([`sat_rounding`]), and so is a rectangle's however
    /// small it is: values about the middle of their range sum to less.
    Float,
}

impl SatNumbers {
    /// Integers of as many bits as rectangles of up to `side` x `side` texels allow: side² (2^bits - 1) < 2^32.
    #[must_use]
    pub fn fixed(side: u32) -> Self {
        let texels = u64::from(side).pow(2);
        let fits = |bits: &u32| texels.saturating_mul((1 << bits) - 1) < 1 << 32;
        Self::Fixed { bits: (1..=24).rev().find(fits).unwrap_or(1) }
    }

    /// The integer that stands for 1; 1 for floats.
    #[must_use]
    pub fn scale(self) -> f64 {
        match self {
            Self::Fixed { bits } => f64::from((1u32 << bits.clamp(1, 24)) - 1),
            Self::Float => 1.0,
        }
    }
}

/// What a [`Sat`] reads and how it keeps sums.
#[derive(Clone, Debug)]
pub struct SatShader {
    /// Module for the slot `texel`: reads and encodes a texel.
    pub texel: &'static str,
    /// What it imports beyond.
    pub slots: Vec<Slot>,
    /// Channels: 1, 2 or 4.
    pub channels: u32,
    /// How sums are kept.
    pub numbers: SatNumbers,
}

/// Tables over layers of an array texture: texel (x, y) holds the sum of all texels (i, j) with i <= x and j <= y. Two
/// passes a layer, each of two reads and a write a texel.
#[derive(Debug)]
pub struct Sat {
    lines: Lines,
}

impl Sat {
    /// Links and compiles the passes.
    ///
    /// # Errors
    /// A number of channels or of bits out of range, or a shader that does not link.
    pub fn new(gpu: &Gpu, shader: &SatShader) -> Result<Self, GpuError> {
        use wgpu::TextureFormat::{
            R32Float, R32Uint, Rg32Float, Rg32Uint, Rgba32Float, Rgba32Uint,
        };
        let (what, fix) = ("channels of a table", "use 1, 2 or 4");
        let invalid =
            |what, value: u32, fix| GpuError::Invalid { what, value: value.to_string(), fix };
        let [float, fixed] = match shader.channels {
            1 => [R32Float, R32Uint],
            2 => [Rg32Float, Rg32Uint],
            4 => [Rgba32Float, Rgba32Uint],
            other => return Err(invalid(what, other, fix)),
        };
        let (format, numbers) = match shader.numbers {
            SatNumbers::Float => (float, "gpu::sat_float"),
            SatNumbers::Fixed { bits } if (1..=24).contains(&bits) => (fixed, "gpu::sat_fixed"),
            SatNumbers::Fixed { bits } => {
                return Err(invalid("bits of a table's values", bits, "use 1 to 24"));
            }
        };
        let scale = shader.numbers.scale();
        let slots = |summand: &'static str| {
            let mut slots = shader.slots.clone();
            slots.extend([
                module("texel", shader.texel),
                module("numbers", numbers),
                module("summand", summand),
                source("target", table_target(texel_name(format))),
                source("sat_config", format!("const SCALE: f32 = {scale:?};")),
            ]);
            slots
        };
        let passes = [slots("gpu::sat_encoded"), slots("gpu::sat_stored")];
        let shader = ("summed-area table", "gpu::sat", "sum_lines");
        let lines = Lines::new(gpu, shader, passes, [format; 2], size_of::<JobUniform>())?;
        Ok(Self { lines })
    }

    /// Makes room for a table of `size` x `size` texels for each job, and uploads the jobs. `source` is a `D2Array`
    /// view of a texture of that size. Allocates nothing when there is room.
    ///
    /// # Errors
    /// A failed allocation.
    pub fn prepare(
        &mut self,
        gpu: &Gpu,
        source: &wgpu::TextureView,
        size: u32,
        jobs: &[LayerJob],
    ) -> Result<(), GpuError> {
        self.lines.prepare(gpu, source, size, jobs, |job| job)
    }

    /// Records the jobs of the last [`Sat::prepare`] as one pass called `name`.
    pub fn encode(&self, recorder: &mut Recorder<'_>, name: &'static str) {
        // Four lines a workgroup; `gpu/sat.wesl` knows it too.
        self.lines.encode(recorder, name, |size| [size.div_ceil(4), 1]);
    }

    /// The tables, one a job, as a `D2Array` view.
    #[must_use]
    pub fn view(&self) -> Option<&wgpu::TextureView> {
        self.lines.view()
    }

    /// The tables.
    #[must_use]
    pub fn texture(&self) -> Option<&wgpu::Texture> {
        self.lines.texture()
    }

    /// Texels that the recorded jobs write, intermediate ones included.
    #[must_use]
    pub fn texels(&self) -> u64 {
        self.lines.texels()
    }

    /// Bytes of GPU memory held.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        self.lines.bytes()
    }
}

/// Bound on the rounding of a sum in a table of floats of `size` x `size` texels, relative to the sum of magnitudes. A
/// term is added span - 1 times within its thread's span of size / 64 texels, 6 times among 64 threads, and up to span
/// times more after; along each of two axes.
#[must_use]
pub fn sat_rounding(size: u32) -> f64 {
    let span = f64::from(size.div_ceil(64));
    2.0 * (2.0 * span + 5.0) * 2f64.powi(-24)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn integers_have_as_many_bits_as_the_largest_rectangle_leaves() {
        for (side, bits) in [(1, 24), (16, 24), (64, 20), (256, 16), (1024, 12), (100_000, 1)] {
            assert_eq!(SatNumbers::fixed(side), SatNumbers::Fixed { bits }, "side {side}");
        }
    }
}

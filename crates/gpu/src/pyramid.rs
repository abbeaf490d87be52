//! Pyramids over layers of array textures: what windows of 1, 2, 4 .. texels a side hold, at every texel or at every
//! so-many-th. Of means, or of the least and the largest.

use antumbra_shaders::{Slot, blur_target, link, module, source};

use crate::lines::{LayerJob, array_texture, texel_bytes, texel_name, whole_view};
use crate::{BlurShader, Gpu, GpuError, Recorder, bind, entries};

/// Where the window of a texel x at level i of an N-buffer lies, along each axis.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Anchor {
    /// From x to x + 2^i - 1 (Décoret 2005).
    #[default]
    Corner,
    /// From x - 2^(i-1) to x + 2^(i-1) - 1 (the multiscale map of Schwarz, Stamminger 2007): around the corner before the
    /// texel. Of means, windows that reach beyond the border are not exact.
    Middle,
}

/// What lies beyond the border of the image.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Beyond {
    /// The border again.
    #[default]
    Repeat,
    /// Zeros.
    Zero,
}

/// How much of a pyramid is at full resolution.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PyramidKind {
    /// A mipmap: level i has 1 / 2^i of the side, and windows at multiples of 2^i only. 4/3 of the image's memory.
    Mip,
    /// An N-buffer: every level has the image's side. log2 of it, and 1, times the image's memory.
    NBuffer(Anchor, Beyond),
    /// A Y map (Schwarz, Stamminger 2008): the first levels of a mipmap, the last of which is the first of an N-buffer of
    /// its own side.
    YMap {
        /// Levels of the mipmap, at least 1; 1 is an N-buffer.
        mips: u32,
        /// Where the N-buffer's windows lie.
        anchor: Anchor,
        /// What they see beyond the border.
        beyond: Beyond,
    },
}

/// A pyramid for each of several layers.
///
/// Levels of the mipmap part are the mip levels of [`Pyramid::mips`]; those of the N-buffer are layers of
/// [`Pyramid::stack`], `levels` for each job, from layer `levels` x job on. The shader side is `gpu/nbuffer_window.wesl`.
#[derive(Debug)]
pub struct Pyramid {
    kind: PyramidKind,
    format: wgpu::TextureFormat,
    base: wgpu::ComputePipeline,
    halve: wgpu::ComputePipeline,
    widen: wgpu::ComputePipeline,
    stride: u32,
    made: Option<Made>,
    jobs: u32,
}

#[derive(Debug)]
struct Made {
    source: wgpu::TextureView,
    size: u32,
    layers: u32,
    mips: Option<(wgpu::Texture, wgpu::TextureView)>,
    stack: Option<(wgpu::Texture, wgpu::TextureView)>,
    stack_levels: u32,
    uniforms: wgpu::Buffer,
    /// Passes of each job in order.
    passes: Vec<Pass>,
}

#[derive(Clone, Debug)]
struct Pass {
    kind: Kind,
    group: wgpu::BindGroup,
    side: u32,
    /// Index of its uniform, for passes that have one.
    uniform: u32,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Kind {
    Base,
    Halve,
    Widen,
}

/// Layout of `Job` in the shaders.
#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
struct Uniform {
    parameters: [[f32; 4]; 2],
    level: [i32; 4],
}

impl Pyramid {
    /// Links and compiles the passes. Means are of `gpu::mean`: `arithmetic`, or `min_max`, which wants its value in
    /// every channel that it keeps.
    ///
    /// # Errors
    /// A format that is not `R32Float`, `Rg32Float` or `Rgba32Float`, a Y map without a level, or a shader that does not
    /// link.
    pub fn new(gpu: &Gpu, kind: PyramidKind, shader: &BlurShader) -> Result<Self, GpuError> {
        use wgpu::TextureFormat::{R32Float, Rg32Float, Rgba32Float};
        const CS: wgpu::ShaderStages = wgpu::ShaderStages::COMPUTE;
        if !matches!(shader.format, R32Float | Rg32Float | Rgba32Float) {
            return Err(GpuError::Invalid {
                what: "format of a pyramid",
                value: format!("{:?}", shader.format),
                fix: "use R32Float, Rg32Float or Rgba32Float",
            });
        }
        if matches!(kind, PyramidKind::YMap { mips: 0, .. }) {
            let (what, value) = ("levels of a Y map's mipmap", "0".to_owned());
            return Err(GpuError::Invalid { what, value, fix: "use at least 1" });
        }
        let mut slots: Vec<Slot> = shader.slots.clone();
        slots.extend([
            module("texel", shader.texel),
            module("mean", shader.mean),
            source("target", blur_target(texel_name(shader.format))),
        ]);
        let pipeline = |root: &str, entry: &str, uniform: bool| -> Result<_, GpuError> {
            let layout = gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
                label: Some("pyramid"),
                entries: &[
                    entries::texels(0, CS, true),
                    entries::write_array(1, CS, shader.format),
                    entries::dynamic_uniform(2, CS),
                ][..2 + usize::from(uniform)],
            });
            let module = gpu.shader("pyramid", link(root, &slots)?);
            Ok(gpu.compute_pipeline("pyramid", &module, entry, &[&layout]))
        };
        let alignment = gpu.device.limits().min_uniform_buffer_offset_alignment;
        Ok(Self {
            kind,
            format: shader.format,
            base: pipeline("gpu::mip_base", "encode_texels", true)?,
            halve: pipeline("gpu::mip", "halve", false)?,
            widen: pipeline("gpu::nbuffer", "widen", true)?,
            stride: (size_of::<Uniform>() as u32).next_multiple_of(alignment),
            made: None,
            jobs: 0,
        })
    }

    /// Makes room for a pyramid over `size` x `size` texels for each job, and uploads the jobs. `source` is a `D2Array`
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
        let count = jobs.len() as u32;
        let fits = |m: &Made| m.size == size && m.layers >= count && m.source == *source;
        if count > 0 && !self.made.as_ref().is_some_and(fits) {
            // What is kept when only the source is another is not worth its code: a map keeps its texture.
            self.made = None;
            self.made = Some(self.make(gpu, source, size, count)?);
        }
        self.jobs = count;
        let Some(made) = &self.made else { return Ok(()) };
        for (index, job) in jobs.iter().enumerate() {
            let level = [job.source as i32, 0, 0, 0];
            let uniform = Uniform { parameters: job.parameters, level };
            let offset = u64::from(self.stride) * index as u64;
            gpu.queue.write_buffer(&made.uniforms, offset, bytemuck::bytes_of(&uniform));
        }
        Ok(())
    }

    /// Sides of the mip levels that are stored as such, and the side of the stack behind them, if there is one.
    fn sides(&self, size: u32) -> (Vec<u32>, Option<u32>) {
        let side = |level: u32| (size >> level).max(1);
        let all = size.max(1).ilog2() + 1;
        match self.kind {
            PyramidKind::Mip => ((0..all).map(side).collect(), None),
            PyramidKind::NBuffer(..) => (Vec::new(), Some(size)),
            PyramidKind::YMap { mips, .. } => {
                let before = (mips - 1).min(all - 1);
                ((0..before).map(side).collect(), Some(side(before)))
            }
        }
    }

    fn make(
        &self,
        gpu: &Gpu,
        from: &wgpu::TextureView,
        size: u32,
        layers: u32,
    ) -> Result<Made, GpuError> {
        let (mip_sides, stack_side) = self.sides(size);
        let mip_count = mip_sides.len() as u32;
        let mips = match mip_count {
            0 => None,
            count => Some(array_texture(gpu, "mipmap", [size, layers, count], self.format)?),
        };
        let stack_levels = stack_side.map_or(0, |side| side.ilog2() + 1);
        let stack = match stack_side {
            None => None,
            Some(side) => {
                Some(array_texture(gpu, "N-buffer", [side, layers * stack_levels, 1], self.format)?)
            }
        };
        // A uniform for each job, and one for each level of a stack but the first.
        let uniforms = gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("pyramid"),
            size: u64::from(self.stride) * u64::from(layers + stack_levels.max(1) - 1),
            usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let (anchor, beyond) = match self.kind {
            PyramidKind::Mip => (Anchor::Corner, Beyond::Repeat),
            PyramidKind::NBuffer(anchor, beyond) | PyramidKind::YMap { anchor, beyond, .. } => {
                (anchor, beyond)
            }
        };
        for level in 1..stack_levels {
            let zeros = i32::from(beyond == Beyond::Zero);
            let [a, b] = offsets(anchor, level);
            let uniform = Uniform { parameters: [[0.0; 4]; 2], level: [a, b, zeros, 0] };
            let offset = u64::from(self.stride) * u64::from(layers + level - 1);
            gpu.queue.write_buffer(&uniforms, offset, bytemuck::bytes_of(&uniform));
        }
        let group =
            |pipeline: &wgpu::ComputePipeline, [from, to]: [&wgpu::TextureView; 2], uniform| {
                let mut parts = vec![bind::texture(0, from), bind::texture(1, to)];
                if uniform {
                    parts.push(wgpu::BindGroupEntry {
                        binding: 2,
                        resource: wgpu::BindingResource::Buffer(wgpu::BufferBinding {
                            buffer: &uniforms,
                            offset: 0,
                            size: wgpu::BufferSize::new(size_of::<Uniform>() as u64),
                        }),
                    });
                }
                gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
                    label: Some("pyramid"),
                    layout: &pipeline.get_bind_group_layout(0),
                    entries: &parts,
                })
            };
        let mut passes = Vec::new();
        for job in 0..layers {
            // Every level in the order in which they are made: its view and side.
            let mut levels = Vec::new();
            for (level, side) in mip_sides.iter().enumerate() {
                levels.extend(mips.as_ref().map(|t| (one(t, job, level as u32), *side)));
            }
            for level in 0..stack_levels {
                let layer = job * stack_levels + level;
                levels.extend(stack.as_ref().zip(stack_side).map(|(t, s)| (one(t, layer, 0), s)));
            }
            for (level, (to, side)) in levels.iter().enumerate() {
                // The first of a stack behind a mipmap is its next level.
                let (kind, uniform) = match level as u32 {
                    0 => (Kind::Base, job),
                    level if level <= mip_count && level < mip_count + stack_levels.max(1) => {
                        (Kind::Halve, 0)
                    }
                    level => (Kind::Widen, layers + (level - mip_count) - 1),
                };
                let from = if level == 0 { from } else { &levels[level - 1].0 };
                let group = match kind {
                    Kind::Base => group(&self.base, [from, to], true),
                    Kind::Halve => group(&self.halve, [from, to], false),
                    Kind::Widen => group(&self.widen, [from, to], true),
                };
                passes.push(Pass { kind, group, side: *side, uniform });
            }
        }
        let source = from.clone();
        let whole = |texture: wgpu::Texture| {
            let view = whole_view(&texture);
            (texture, view)
        };
        let (mips, stack) = (mips.map(whole), stack.map(whole));
        Ok(Made { source, size, layers, mips, stack, stack_levels, uniforms, passes })
    }

    /// Records the jobs of the last [`Pyramid::prepare`] as one pass called `name`.
    pub fn encode(&self, recorder: &mut Recorder<'_>, name: &'static str) {
        let Some(made) = self.made.as_ref().filter(|_| self.jobs > 0) else { return };
        let each = made.passes.len() / made.layers as usize;
        let mut recorded = recorder.compute_pass(name);
        for pass in &made.passes[..each * self.jobs as usize] {
            let offset = [self.stride * pass.uniform];
            let (pipeline, offsets): (_, &[u32]) = match pass.kind {
                Kind::Base => (&self.base, &offset),
                Kind::Halve => (&self.halve, &[]),
                Kind::Widen => (&self.widen, &offset),
            };
            recorded.set_pipeline(pipeline);
            recorded.set_bind_group(0, &pass.group, offsets);
            let groups = pass.side.div_ceil(8);
            recorded.dispatch_workgroups(groups, groups, 1);
        }
    }

    /// The levels that are a mipmap: a layer for each job.
    #[must_use]
    pub fn mips(&self) -> Option<&wgpu::Texture> {
        self.made.as_ref().and_then(|m| m.mips.as_ref()).map(|(texture, _)| texture)
    }

    /// A `D2Array` view of [`Pyramid::mips`], all levels.
    #[must_use]
    pub fn mips_view(&self) -> Option<&wgpu::TextureView> {
        self.made.as_ref().and_then(|m| m.mips.as_ref()).map(|(_, view)| view)
    }

    /// The levels that are an N-buffer: [`Pyramid::levels`] layers for each job.
    #[must_use]
    pub fn stack(&self) -> Option<&wgpu::Texture> {
        self.made.as_ref().and_then(|m| m.stack.as_ref()).map(|(texture, _)| texture)
    }

    /// A `D2Array` view of [`Pyramid::stack`].
    #[must_use]
    pub fn stack_view(&self) -> Option<&wgpu::TextureView> {
        self.made.as_ref().and_then(|m| m.stack.as_ref()).map(|(_, view)| view)
    }

    /// Levels of the N-buffer.
    #[must_use]
    pub fn levels(&self) -> u32 {
        self.made.as_ref().map_or(0, |m| m.stack_levels)
    }

    /// Texels that the recorded jobs write.
    #[must_use]
    pub fn texels(&self) -> u64 {
        self.made.as_ref().map_or(0, |m| self.texels_of_a_job(m.size) * u64::from(self.jobs))
    }

    fn texels_of_a_job(&self, size: u32) -> u64 {
        let (mips, stack) = self.sides(size);
        let square = |side: u32| u64::from(side).pow(2);
        let levels = |side: u32| u64::from(side.ilog2() + 1);
        mips.into_iter().map(square).sum::<u64>()
            + stack.map_or(0, |side| square(side) * levels(side))
    }

    /// Bytes of GPU memory held.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        self.made.as_ref().map_or(0, |m| {
            let texels = self.texels_of_a_job(m.size) * u64::from(m.layers);
            texels * texel_bytes(self.format) + m.uniforms.size()
        })
    }
}

/// Offsets of the two windows of the level before that make one of `level`, along an axis.
fn offsets(anchor: Anchor, level: u32) -> [i32; 2] {
    match (anchor, level) {
        (Anchor::Corner, _) => [0, 1 << (level - 1)],
        (Anchor::Middle, 1) => [-1, 0],
        (Anchor::Middle, _) => [-(1 << (level - 2)), 1 << (level - 2)],
    }
}

/// One layer of one level, as a `D2Array` view.
fn one(texture: &wgpu::Texture, layer: u32, level: u32) -> wgpu::TextureView {
    texture.create_view(&wgpu::TextureViewDescriptor {
        dimension: Some(wgpu::TextureViewDimension::D2Array),
        base_mip_level: level,
        mip_level_count: Some(1),
        base_array_layer: layer,
        array_layer_count: Some(1),
        ..Default::default()
    })
}

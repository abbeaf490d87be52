//! Separable filters over layers of array textures, with an encoding and a mean of the caller's.

use antumbra_shaders::{Slot, blur_target, link, module, source};

use crate::{Gpu, GpuError, Recorder, bind, entries};

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
    /// What is written at the end: `R32Float`, `Rg32Float`, `Rgba32Float`, or one of `Rg32Uint` for four
    /// channels in [0, 1] at 16 bits each (`pack2x16unorm`).
    pub format: wgpu::TextureFormat,
}

/// One layer to make.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BlurJob {
    /// Layer read.
    pub source: u32,
    /// What the texel module is given as `first` and `second`.
    pub parameters: [[f32; 4]; 2],
}

/// A separable filter: two passes a layer, of 2 radius + 1 taps each, through one layer of intermediate
/// results. The work does not depend on what is filtered.
#[derive(Debug)]
pub struct Blur {
    weights: Vec<f32>,
    format: wgpu::TextureFormat,
    between: wgpu::TextureFormat,
    rows: wgpu::ComputePipeline,
    columns: wgpu::ComputePipeline,
    stride: u32,
    made: Option<Made>,
    jobs: Vec<BlurJob>,
}

#[derive(Debug)]
struct Made {
    source: wgpu::TextureView,
    size: u32,
    layers: u32,
    between: wgpu::Texture,
    output: wgpu::Texture,
    view: wgpu::TextureView,
    uniforms: wgpu::Buffer,
    /// Rows and columns.
    groups: [wgpu::BindGroup; 2],
}

/// Layout of `Job` in `gpu/blur.wesl`.
#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
struct Uniform {
    parameters: [[f32; 4]; 2],
    layers: [i32; 4],
    weights: [f32; 64],
}

impl Blur {
    /// Links and compiles the passes. `weights` are those of the texels from -radius to radius, not negative,
    /// and are scaled to the sum 1.
    ///
    /// # Errors
    /// An even number of weights or more than 63, a negative one, a format that is not one of the four, or a
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
        use wgpu::TextureFormat::{R32Float, Rg32Float, Rg32Uint, Rgba32Float};
        let between = match shader.format {
            Rg32Uint => Rgba32Float,
            R32Float | Rg32Float | Rgba32Float => shader.format,
            other => {
                return Err(GpuError::Invalid {
                    what: "format of a blur",
                    value: format!("{other:?}"),
                    fix: "use R32Float, Rg32Float, Rgba32Float or Rg32Uint",
                });
            }
        };
        let pipeline = |axis: &str, texel: &'static str, format| -> Result<_, GpuError> {
            let radius = weights.len() / 2;
            let config = format!("const RADIUS: i32 = {radius};\nconst AXIS: vec2i = {axis};");
            let mut slots = shader.slots.clone();
            slots.extend([
                module("texel", texel),
                module("mean", shader.mean),
                source("target", blur_target(texel_name(format))),
                source("blur_config", config),
            ]);
            Ok(make_pipeline(gpu, link("gpu::blur", &slots)?, format))
        };
        let rows = pipeline("vec2i(1, 0)", shader.texel, between)?;
        let columns = pipeline("vec2i(0, 1)", "gpu::stored_texel", shader.format)?;
        let alignment = gpu.device.limits().min_uniform_buffer_offset_alignment;
        Ok(Self {
            weights: weights.iter().map(|w| (w / sum) as f32).collect(),
            format: shader.format,
            between,
            rows,
            columns,
            stride: (size_of::<Uniform>() as u32).next_multiple_of(alignment),
            made: None,
            jobs: Vec::new(),
        })
    }

    /// Makes room for a layer of `size` x `size` texels for each job, and uploads the jobs. `source` is a
    /// `D2Array` view of a texture of that size. Allocates nothing when there is room.
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
        let fits = |m: &Made| m.size == size && m.layers as usize >= jobs.len();
        if !jobs.is_empty() && self.made.as_ref().is_none_or(|m| !fits(m) || m.source != *source) {
            let kept = self.made.take().filter(fits);
            self.made = Some(self.make(gpu, source, size, jobs.len() as u32, kept)?);
        }
        self.jobs.clear();
        self.jobs.extend_from_slice(jobs);
        let Some(made) = &self.made else { return Ok(()) };
        let mut weights = [0.0; 64];
        weights[..self.weights.len()].copy_from_slice(&self.weights);
        for (index, job) in jobs.iter().enumerate() {
            let layers = [[job.source as i32, 0, 0, 0], [0, index as i32, 0, 0]];
            for (pass, layers) in layers.into_iter().enumerate() {
                let uniform = Uniform { parameters: job.parameters, layers, weights };
                let offset = u64::from(self.stride) * (2 * index + pass) as u64;
                gpu.queue.write_buffer(&made.uniforms, offset, bytemuck::bytes_of(&uniform));
            }
        }
        Ok(())
    }

    fn make(
        &self,
        gpu: &Gpu,
        source: &wgpu::TextureView,
        size: u32,
        layers: u32,
        kept: Option<Made>,
    ) -> Result<Made, GpuError> {
        let texture = |layers, format| {
            gpu.create_texture(
                "filtered map",
                &wgpu::TextureDescriptor {
                    label: Some("filtered map"),
                    size: wgpu::Extent3d {
                        width: size,
                        height: size,
                        depth_or_array_layers: layers,
                    },
                    mip_level_count: 1,
                    sample_count: 1,
                    dimension: wgpu::TextureDimension::D2,
                    format,
                    usage: wgpu::TextureUsages::STORAGE_BINDING
                        | wgpu::TextureUsages::TEXTURE_BINDING
                        | wgpu::TextureUsages::COPY_SRC,
                    view_formats: &[],
                },
            )
        };
        let (between, output, uniforms, layers) = match kept {
            Some(made) => (made.between, made.output, made.uniforms, made.layers),
            None => {
                let uniforms = gpu.device.create_buffer(&wgpu::BufferDescriptor {
                    label: Some("blur jobs"),
                    size: u64::from(self.stride) * 2 * u64::from(layers),
                    usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
                    mapped_at_creation: false,
                });
                (texture(1, self.between)?, texture(layers, self.format)?, uniforms, layers)
            }
        };
        let array = |texture: &wgpu::Texture| {
            texture.create_view(&wgpu::TextureViewDescriptor {
                dimension: Some(wgpu::TextureViewDimension::D2Array),
                ..Default::default()
            })
        };
        let (middle, view) = (array(&between), array(&output));
        let group = |pipeline: &wgpu::ComputePipeline, from, to| {
            gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("blur"),
                layout: &pipeline.get_bind_group_layout(0),
                entries: &[
                    bind::texture(0, from),
                    bind::texture(1, to),
                    wgpu::BindGroupEntry {
                        binding: 2,
                        resource: wgpu::BindingResource::Buffer(wgpu::BufferBinding {
                            buffer: &uniforms,
                            offset: 0,
                            size: wgpu::BufferSize::new(size_of::<Uniform>() as u64),
                        }),
                    },
                ],
            })
        };
        let groups = [group(&self.rows, source, &middle), group(&self.columns, &middle, &view)];
        Ok(Made { source: source.clone(), size, layers, between, output, view, uniforms, groups })
    }

    /// Records the jobs of the last [`Blur::prepare`] as one pass called `name`.
    pub fn encode(&self, recorder: &mut Recorder<'_>, name: &'static str) {
        let Some(made) = self.made.as_ref().filter(|_| !self.jobs.is_empty()) else { return };
        let mut pass = recorder.compute_pass(name);
        for job in 0..self.jobs.len() as u32 {
            for (index, pipeline) in [&self.rows, &self.columns].into_iter().enumerate() {
                let offset = self.stride * (2 * job + index as u32);
                pass.set_pipeline(pipeline);
                pass.set_bind_group(0, &made.groups[index], &[offset]);
                pass.dispatch_workgroups(made.size.div_ceil(64), made.size, 1);
            }
        }
    }

    /// The filtered layers, one a job, as a `D2Array` view.
    #[must_use]
    pub fn view(&self) -> Option<&wgpu::TextureView> {
        self.made.as_ref().map(|m| &m.view)
    }

    /// The filtered layers.
    #[must_use]
    pub fn texture(&self) -> Option<&wgpu::Texture> {
        self.made.as_ref().map(|m| &m.output)
    }

    /// Texels that the recorded jobs write, intermediate ones included.
    #[must_use]
    pub fn texels(&self) -> u64 {
        let side = self.made.as_ref().map_or(0, |m| u64::from(m.size));
        2 * self.jobs.len() as u64 * side * side
    }

    /// Bytes of GPU memory held.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        let bytes =
            |format: wgpu::TextureFormat| u64::from(format.block_copy_size(None).unwrap_or(0));
        self.made.as_ref().map_or(0, |m| {
            let texels = u64::from(m.size) * u64::from(m.size);
            texels * (u64::from(m.layers) * bytes(self.format) + bytes(self.between))
                + m.uniforms.size()
        })
    }
}

/// Bound, relative to the largest magnitude in the window, on the rounding of a filtered value of a blur
/// with `radius`, in f32. With u = 2^-24, a pass of n taps rounds each weight and each product once and adds
/// n - 1 times: at most (n + 1) u; there are two passes.
#[must_use]
pub fn blur_rounding(radius: u32) -> f64 {
    let taps = f64::from(2 * radius + 1);
    2.0 * (taps + 1.0) * 2f64.powi(-24)
}

/// The format's name in WGSL.
fn texel_name(format: wgpu::TextureFormat) -> &'static str {
    match format {
        wgpu::TextureFormat::R32Float => "r32float",
        wgpu::TextureFormat::Rg32Float => "rg32float",
        wgpu::TextureFormat::Rg32Uint => "rg32uint",
        _ => "rgba32float",
    }
}

fn make_pipeline(gpu: &Gpu, wgsl: String, format: wgpu::TextureFormat) -> wgpu::ComputePipeline {
    const CS: wgpu::ShaderStages = wgpu::ShaderStages::COMPUTE;
    let device = &gpu.device;
    let group = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: Some("blur"),
        entries: &[
            entries::texels(0, CS, true),
            entries::write_array(1, CS, format),
            entries::dynamic_uniform(2, CS),
        ],
    });
    device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: Some("blur"),
        layout: Some(&device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some("blur"),
            bind_group_layouts: &[Some(&group)],
            immediate_size: 0,
        })),
        module: &gpu.shader("blur", wgsl),
        entry_point: Some("blur"),
        compilation_options: Default::default(),
        cache: None,
    })
}

//! Two passes a layer, along rows and then along columns: what separable filters and summed-area tables share.

use antumbra_shaders::{Slot, link, source};

use crate::{Gpu, GpuError, Recorder, bind, entries, read_buffer};

/// One layer to make of a layer of an array texture.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LayerJob {
    /// Layer read.
    pub source: u32,
    /// What the texel module is given as `first` and `second`.
    pub parameters: [[f32; 4]; 2],
}

/// A word that earlier passes of a frame leave on the GPU: 1 where what follows is to be done, 0 where all of it would be as it
/// is.
#[derive(Clone, Debug)]
pub struct Gate {
    /// The buffer, which can be copied from.
    pub buffer: wgpu::Buffer,
    /// Where in it the word is, bytes.
    pub offset: u64,
}

/// A pass along each axis, for each of several layers, through one layer of intermediate results.
#[derive(Debug)]
pub(crate) struct Lines {
    label: &'static str,
    /// Of what lies between the passes, and of what is written at the end.
    formats: [wgpu::TextureFormat; 2],
    pipelines: [wgpu::ComputePipeline; 2],
    stride: u32,
    made: Option<Made>,
    jobs: u32,
    /// The jobs of the last call of `prepare` that had any, and whether layers have yet to be made of them.
    last: Vec<LayerJob>,
    is_due: bool,
    /// Workgroups of the passes of the last frame, if a gate decided on them.
    gated: Option<wgpu::Buffer>,
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

/// The start of every pass's uniform: what it is given of its job.
#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
pub(crate) struct JobUniform {
    parameters: [[f32; 4]; 2],
    /// Layer read, layer written, and its side.
    layers: [i32; 4],
}

impl Lines {
    /// Links `root` twice, with the `slots` of each pass and beside them `axis_config`, a constant AXIS. Binding 0 is
    /// what is read, 1 what is written, 2 the uniform of `uniform` bytes, which begins with a [`JobUniform`].
    pub(crate) fn new(
        gpu: &Gpu,
        (label, root, entry): (&'static str, &'static str, &str),
        slots: [Vec<Slot>; 2],
        formats: [wgpu::TextureFormat; 2],
        uniform: usize,
    ) -> Result<Self, GpuError> {
        let mut wgsl = Vec::new();
        for (mut slots, axis) in slots.into_iter().zip(["vec2i(1, 0)", "vec2i(0, 1)"]) {
            slots.push(source("axis_config", format!("const AXIS: vec2i = {axis};")));
            wgsl.push(link(root, &slots)?);
        }
        let pipeline = |wgsl: &String, reads, writes| {
            const CS: wgpu::ShaderStages = wgpu::ShaderStages::COMPUTE;
            let group = gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
                label: Some(label),
                entries: &[
                    if is_unsigned(reads) {
                        entries::unsigned_array(0, CS)
                    } else {
                        entries::texels(0, CS, true)
                    },
                    entries::write_array(1, CS, writes),
                    entries::dynamic_uniform(2, CS),
                ],
            });
            gpu.compute_pipeline(label, &gpu.shader(label, wgsl.clone()), entry, &[&group])
        };
        let rows = pipeline(&wgsl[0], wgpu::TextureFormat::R32Float, formats[0]);
        let columns = pipeline(&wgsl[1], formats[0], formats[1]);
        let alignment = gpu.device.limits().min_uniform_buffer_offset_alignment;
        Ok(Self {
            label,
            formats,
            pipelines: [rows, columns],
            stride: (uniform as u32).next_multiple_of(alignment),
            made: None,
            jobs: 0,
            last: Vec::new(),
            is_due: false,
            gated: None,
        })
    }

    /// Makes room for a layer of `size` x `size` texels for each job, and uploads the uniforms that `uniform` makes of
    /// the start of one. `source` is a `D2Array` view of a float texture, of that size unless the texel module of the
    /// first pass reads it otherwise. Allocates nothing when there is room.
    pub(crate) fn prepare<U: bytemuck::Pod>(
        &mut self,
        gpu: &Gpu,
        source: &wgpu::TextureView,
        size: u32,
        jobs: &[LayerJob],
        uniform: impl Fn(JobUniform) -> U,
    ) -> Result<(), GpuError> {
        let fits = |m: &Made| m.size == size && m.layers as usize >= jobs.len();
        if !jobs.is_empty() && self.made.as_ref().is_none_or(|m| !fits(m) || m.source != *source) {
            let kept = self.made.take().filter(fits);
            let uniform = size_of::<U>() as u64;
            self.made = Some(self.make(gpu, source, (size, jobs.len() as u32), uniform, kept)?);
            self.is_due = true;
        }
        self.jobs = jobs.len() as u32;
        if !jobs.is_empty() && self.last != jobs {
            self.last.clear();
            self.last.extend_from_slice(jobs);
            self.is_due = true;
        }
        let Some(made) = &self.made else { return Ok(()) };
        for (index, job) in jobs.iter().enumerate() {
            let side = size as i32;
            let layers = [[job.source as i32, 0, side, 0], [0, index as i32, side, 0]];
            for (pass, layers) in layers.into_iter().enumerate() {
                let uniform = uniform(JobUniform { parameters: job.parameters, layers });
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
        (size, layers): (u32, u32),
        uniform: u64,
        kept: Option<Made>,
    ) -> Result<Made, GpuError> {
        let texture = |layers, format| array_texture(gpu, self.label, [size, layers, 1], format);
        let (between, output, uniforms, layers) = match kept {
            Some(made) => (made.between, made.output, made.uniforms, made.layers),
            None => {
                let uniforms = gpu.device.create_buffer(&wgpu::BufferDescriptor {
                    label: Some(self.label),
                    size: u64::from(self.stride) * 2 * u64::from(layers),
                    usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
                    mapped_at_creation: false,
                });
                (texture(1, self.formats[0])?, texture(layers, self.formats[1])?, uniforms, layers)
            }
        };
        let (middle, view) = (whole_view(&between), whole_view(&output));
        let group = |pipeline: &wgpu::ComputePipeline, from, to| {
            gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some(self.label),
                layout: &pipeline.get_bind_group_layout(0),
                entries: &[
                    bind::texture(0, from),
                    bind::texture(1, to),
                    wgpu::BindGroupEntry {
                        binding: 2,
                        resource: wgpu::BindingResource::Buffer(wgpu::BufferBinding {
                            buffer: &uniforms,
                            offset: 0,
                            size: wgpu::BufferSize::new(uniform),
                        }),
                    },
                ],
            })
        };
        let [rows, columns] = &self.pipelines;
        let groups = [group(rows, source, &middle), group(columns, &middle, &view)];
        Ok(Made { source: source.clone(), size, layers, between, output, view, uniforms, groups })
    }

    /// Records the jobs of the last [`Lines::prepare`] as one pass called `name`, each pass of a job with as many
    /// workgroups as `workgroups` says for a side.
    pub(crate) fn encode(
        &self,
        recorder: &mut Recorder<'_>,
        name: &'static str,
        workgroups: impl Fn(u32) -> [u32; 2],
    ) {
        let Some(made) = self.made.as_ref().filter(|_| self.jobs > 0) else { return };
        let [x, y] = workgroups(made.size);
        let mut pass = recorder.compute_pass(name);
        for job in 0..self.jobs {
            for (index, pipeline) in self.pipelines.iter().enumerate() {
                let offset = self.stride * (2 * job + index as u32);
                pass.set_pipeline(pipeline);
                pass.set_bind_group(0, &made.groups[index], &[offset]);
                match &self.gated {
                    None => pass.dispatch_workgroups(x, y, 1),
                    Some(workgroups) => pass.dispatch_workgroups_indirect(workgroups, 0),
                }
            }
        }
    }

    /// As [`Lines::encode`], where `gate` says so, or where the last frame's layers were made of other jobs.
    pub(crate) fn encode_gated(
        &mut self,
        gpu: &Gpu,
        recorder: &mut Recorder<'_>,
        name: &'static str,
        workgroups: impl Fn(u32) -> [u32; 2],
        gate: Option<&Gate>,
    ) {
        let is_due = std::mem::take(&mut self.is_due);
        let Some(gate) = gate.filter(|_| !is_due) else {
            self.gated = None;
            return self.encode(recorder, name, workgroups);
        };
        let size = self.made.as_ref().map_or(0, |made| made.size);
        let [x, y] = workgroups(size);
        let gated = self.gated.get_or_insert_with(|| {
            let usage = wgpu::BufferUsages::INDIRECT | wgpu::BufferUsages::COPY_SRC;
            gpu.buffer("workgroups", bytemuck::bytes_of(&[x, y, 0]), usage)
        });
        // As many in depth as the gate says: one or none.
        recorder.encoder.copy_buffer_to_buffer(&gate.buffer, gate.offset, gated, 8, 4);
        self.encode(recorder, name, workgroups);
    }

    /// Texels that the passes of the last submitted frame wrote. Waits.
    pub(crate) fn read_texels(&self, gpu: &Gpu) -> Result<u64, GpuError> {
        let Some(gated) = &self.gated else { return Ok(self.texels()) };
        let workgroups: Vec<u32> = bytemuck::pod_collect_to_vec(&read_buffer(gpu, gated, 12)?);
        Ok(u64::from(workgroups[2]) * self.texels())
    }

    /// The layers, one a job, as a `D2Array` view.
    pub(crate) fn view(&self) -> Option<&wgpu::TextureView> {
        self.made.as_ref().map(|m| &m.view)
    }

    /// The layers.
    pub(crate) fn texture(&self) -> Option<&wgpu::Texture> {
        self.made.as_ref().map(|m| &m.output)
    }

    /// Texels that the recorded jobs write, intermediate ones included.
    pub(crate) fn texels(&self) -> u64 {
        let side = self.made.as_ref().map_or(0, |m| u64::from(m.size));
        2 * u64::from(self.jobs) * side * side
    }

    /// Bytes of GPU memory held.
    pub(crate) fn bytes(&self) -> u64 {
        let [between, output] = self.formats.map(texel_bytes);
        self.made.as_ref().map_or(0, |m| {
            let texels = u64::from(m.size) * u64::from(m.size);
            texels * (u64::from(m.layers) * output + between) + m.uniforms.size()
        })
    }
}

/// An array texture that compute passes write and read: side, layers and mip levels.
pub(crate) fn array_texture(
    gpu: &Gpu,
    what: &'static str,
    [side, layers, levels]: [u32; 3],
    format: wgpu::TextureFormat,
) -> Result<wgpu::Texture, GpuError> {
    gpu.create_texture(
        what,
        &wgpu::TextureDescriptor {
            label: Some(what),
            size: wgpu::Extent3d { width: side, height: side, depth_or_array_layers: layers },
            mip_level_count: levels,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format,
            usage: wgpu::TextureUsages::STORAGE_BINDING
                | wgpu::TextureUsages::TEXTURE_BINDING
                | wgpu::TextureUsages::COPY_SRC,
            view_formats: &[],
        },
    )
}

/// All of an array texture, as a `D2Array` view.
pub(crate) fn whole_view(texture: &wgpu::Texture) -> wgpu::TextureView {
    texture.create_view(&wgpu::TextureViewDescriptor {
        dimension: Some(wgpu::TextureViewDimension::D2Array),
        ..Default::default()
    })
}

pub(crate) fn texel_bytes(format: wgpu::TextureFormat) -> u64 {
    u64::from(format.block_copy_size(None).unwrap_or(0))
}

pub(crate) fn is_unsigned(format: wgpu::TextureFormat) -> bool {
    use wgpu::TextureFormat::{R32Uint, Rg32Uint, Rgba32Uint};
    matches!(format, R32Uint | Rg32Uint | Rgba32Uint)
}

/// The format's name in WGSL; empty for formats that no pass here writes.
pub(crate) fn texel_name(format: wgpu::TextureFormat) -> &'static str {
    match format {
        wgpu::TextureFormat::R32Float => "r32float",
        wgpu::TextureFormat::Rg32Float => "rg32float",
        wgpu::TextureFormat::Rgba32Float => "rgba32float",
        wgpu::TextureFormat::Rgba8Unorm => "rgba8unorm",
        wgpu::TextureFormat::R32Uint => "r32uint",
        wgpu::TextureFormat::Rg32Uint => "rg32uint",
        wgpu::TextureFormat::Rgba32Uint => "rgba32uint",
        _ => "",
    }
}

//! The shadow-width map: of each texel in shadow, how far it is to the nearest lit one.

use antumbra_gpu::{BindGroupCache, Gpu, GpuError, Recorder, bind, entries};
use antumbra_shaders::{module, source};
use glam::DVec2;

use crate::twin::width::{MAX_DOUBLINGS, Step, passes};
use crate::{SingleSample, Widths};

const CS: wgpu::ShaderStages = wgpu::ShaderStages::COMPUTE;

/// `Step` of `soft/width_steps.wesl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
struct StepData {
    offset: [i32; 2],
    length: f32,
    reach: f32,
}

/// Widths of all layers of a map, from passes over its texels that depend on nothing else: `R32Float`, in the shorter
/// side of a texel, 2^17 where no lit texel was found.
#[derive(Debug)]
pub struct WidthMap {
    widths: Widths,
    neighbours: u32,
    /// Of the pass that reads the map, of those that read widths, and of the last one of Euclidean widths.
    first: wgpu::ComputePipeline,
    others: wgpu::ComputePipeline,
    columns: Option<wgpu::ComputePipeline>,
    group_layout: wgpu::BindGroupLayout,
    /// Index of each pass's first step, `stride` bytes apart.
    firsts: wgpu::Buffer,
    stride: u32,
    made: Option<Made>,
    layers: u32,
    passes: u32,
}

#[derive(Debug)]
struct Made {
    size: u32,
    layers: u32,
    textures: [wgpu::Texture; 2],
    view: wgpu::TextureView,
    steps: wgpu::Buffer,
    /// To either texture, from the map and from the other one.
    from_map: [BindGroupCache<wgpu::TextureView>; 2],
    from_other: [wgpu::BindGroup; 2],
    views: [wgpu::TextureView; 2],
}

impl WidthMap {
    /// Links and compiles the passes.
    ///
    /// # Errors
    /// Settings out of range.
    pub fn new(gpu: &Gpu, config: &SingleSample) -> Result<Self, GpuError> {
        config.validate()?;
        let group_layout = gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("shadow widths"),
            entries: &[
                entries::texels(0, CS, true),
                entries::write_array(1, CS, wgpu::TextureFormat::R32Float),
                entries::storage(2, CS),
                entries::dynamic_uniform(3, CS),
            ],
        });
        let (widths, neighbours) = (config.widths, config.neighbours);
        let steps = table(widths, neighbours, 1, DVec2::ONE).len();
        let constants =
            format!("const STEPS: i32 = {steps};\nconst NEIGHBOURS: i32 = {neighbours};\n");
        let pipeline = |root, below, entry| -> Result<wgpu::ComputePipeline, GpuError> {
            let slots = [module("below", below), source("width_config", constants.clone())];
            let shader = gpu.shader("shadow widths", antumbra_shaders::link(root, &slots)?);
            Ok(gpu.compute_pipeline("shadow widths", &shader, entry, &[&group_layout]))
        };
        let (map, stored) = ("soft::width_of_map", "soft::width_of_widths");
        let (root, entry, steps_a_pass) = match widths {
            Widths::Doubling => ("soft::width_doubling", "double", neighbours),
            Widths::CityBlock | Widths::Euclidean => ("soft::width_sweep", "sweep", 1),
        };
        let is_euclidean = widths == Widths::Euclidean;
        let columns = is_euclidean.then(|| pipeline("soft::width_euclid", stored, "euclid"));
        let stride = gpu.device.limits().min_uniform_buffer_offset_alignment;
        let firsts = gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("shadow widths"),
            size: u64::from(stride * MAX_DOUBLINGS),
            usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        for pass in 0..MAX_DOUBLINGS {
            let first = pass * steps_a_pass;
            gpu.queue.write_buffer(&firsts, (pass * stride).into(), bytemuck::bytes_of(&first));
        }
        Ok(Self {
            widths,
            neighbours,
            first: pipeline(root, map, entry)?,
            others: pipeline(root, stored, entry)?,
            columns: columns.transpose()?,
            group_layout,
            firsts,
            stride,
            made: None,
            layers: 0,
            passes: 0,
        })
    }

    /// Makes room for a layer of `size` x `size` texels for each of `sides`, those of its texels, of which the shorter is
    /// 1, and uploads the steps. `source` is a `D2Array` view of a reversed depth map of that size. Widths of more than
    /// 2^`doublings` - 1 need not be right. Allocates nothing when there is room.
    ///
    /// # Errors
    /// A failed allocation.
    pub fn prepare(
        &mut self,
        gpu: &Gpu,
        source: &wgpu::TextureView,
        size: u32,
        sides: &[DVec2],
        doublings: u32,
    ) -> Result<(), GpuError> {
        self.layers = sides.len() as u32;
        self.passes = match self.widths {
            Widths::Doubling => doublings.clamp(1, MAX_DOUBLINGS),
            Widths::CityBlock => 4,
            Widths::Euclidean => 3,
        };
        if self.layers == 0 {
            return Ok(());
        }
        let tables: Vec<StepData> = sides
            .iter()
            .flat_map(|sides| table(self.widths, self.neighbours, doublings, *sides))
            .collect();
        let fits = |m: &Made| m.size == size && m.layers >= self.layers;
        if !self.made.as_ref().is_some_and(fits) {
            let bytes = size_of_val(tables.as_slice()) as u64;
            self.made = Some(self.make(gpu, size, self.layers, bytes)?);
        }
        let (layout, firsts) = (&self.group_layout, &self.firsts);
        if let Some(Made { steps, from_map, views, .. }) = &mut self.made {
            gpu.queue.write_buffer(steps, 0, bytemuck::cast_slice(&tables));
            // The last pass writes the first texture, whatever their number.
            let to = (self.passes as usize - 1) % 2;
            from_map[to].get(source.clone(), |source| {
                group(gpu, layout, [source, &views[to]], steps, firsts)
            });
        }
        Ok(())
    }

    fn make(&self, gpu: &Gpu, size: u32, layers: u32, bytes: u64) -> Result<Made, GpuError> {
        let texture = || {
            gpu.create_texture(
                "shadow widths",
                &wgpu::TextureDescriptor {
                    label: Some("shadow widths"),
                    size: wgpu::Extent3d {
                        width: size,
                        height: size,
                        depth_or_array_layers: layers,
                    },
                    mip_level_count: 1,
                    sample_count: 1,
                    dimension: wgpu::TextureDimension::D2,
                    format: wgpu::TextureFormat::R32Float,
                    usage: wgpu::TextureUsages::STORAGE_BINDING
                        | wgpu::TextureUsages::TEXTURE_BINDING
                        | wgpu::TextureUsages::COPY_SRC,
                    view_formats: &[],
                },
            )
        };
        let textures = [texture()?, texture()?];
        let views = [0, 1].map(|i: usize| {
            textures[i].create_view(&wgpu::TextureViewDescriptor {
                dimension: Some(wgpu::TextureViewDimension::D2Array),
                ..Default::default()
            })
        });
        let steps = gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("steps"),
            size: bytes,
            usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let from_other = [0, 1].map(|to: usize| {
            group(gpu, &self.group_layout, [&views[1 - to], &views[to]], &steps, &self.firsts)
        });
        let (view, from_map) = (views[0].clone(), Default::default());
        Ok(Made { size, layers, textures, view, steps, from_map, from_other, views })
    }

    /// Records the passes over the source of the last [`WidthMap::prepare`] as one pass called `name`.
    pub fn encode(&self, recorder: &mut Recorder<'_>, name: &'static str) {
        let Some(made) = self.made.as_ref().filter(|_| self.layers > 0) else { return };
        let mut pass = recorder.compute_pass(name);
        for i in 0..self.passes {
            let to = (self.passes - 1 - i) as usize % 2;
            let columns = self.columns.as_ref().filter(|_| i == self.passes - 1);
            let usual = if i == 0 { &self.first } else { &self.others };
            let group = if i == 0 { made.from_map[to].kept() } else { Some(&made.from_other[to]) };
            pass.set_pipeline(columns.unwrap_or(usual));
            pass.set_bind_group(0, group, &[i * self.stride]);
            // A thread a line, or a thread a texel.
            if self.widths == Widths::Doubling || columns.is_some() {
                let side = made.size.div_ceil(8);
                pass.dispatch_workgroups(side, side, self.layers);
            } else {
                pass.dispatch_workgroups(made.size.div_ceil(64), 1, self.layers);
            }
        }
    }

    /// The widths as a `D2Array` view, layer by layer.
    #[must_use]
    pub fn view(&self) -> Option<&wgpu::TextureView> {
        self.made.as_ref().map(|m| &m.view)
    }

    /// The widths.
    #[must_use]
    pub fn texture(&self) -> Option<&wgpu::Texture> {
        self.made.as_ref().map(|m| &m.textures[0])
    }

    /// Passes over each texel that the next encoding records.
    #[must_use]
    pub fn passes(&self) -> u64 {
        if self.layers == 0 { 0 } else { self.passes.into() }
    }

    /// Texels that these write.
    #[must_use]
    pub fn texels(&self) -> u64 {
        let side = self.made.as_ref().map_or(0, |m| u64::from(m.size));
        self.passes() * u64::from(self.layers) * side * side
    }

    /// Bytes of GPU memory held.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        let made =
            |m: &Made| 2 * 4 * u64::from(m.layers) * u64::from(m.size).pow(2) + m.steps.size();
        self.firsts.size() + self.made.as_ref().map_or(0, made)
    }
}

/// The steps of all passes that there may be, in order, and how far these reach.
fn table(widths: Widths, neighbours: u32, doublings: u32, sides: DVec2) -> Vec<StepData> {
    let reach = ((1u32 << doublings.clamp(1, MAX_DOUBLINGS)) - 1) as f32;
    let data = |step: &Step| StepData {
        offset: step.offset.to_array(),
        length: step.length as f32,
        reach,
    };
    passes(widths, neighbours, MAX_DOUBLINGS, sides).iter().flatten().map(data).collect()
}

fn group(
    gpu: &Gpu,
    layout: &wgpu::BindGroupLayout,
    [from, to]: [&wgpu::TextureView; 2],
    steps: &wgpu::Buffer,
    firsts: &wgpu::Buffer,
) -> wgpu::BindGroup {
    gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: Some("shadow widths"),
        layout,
        entries: &[
            bind::texture(0, from),
            bind::texture(1, to),
            bind::buffer(2, steps),
            wgpu::BindGroupEntry {
                binding: 3,
                resource: wgpu::BindingResource::Buffer(wgpu::BufferBinding {
                    buffer: firsts,
                    offset: 0,
                    size: wgpu::BufferSize::new(size_of::<u32>() as u64),
                }),
            },
        ],
    })
}

//! Translucent casters: what they keep of the light that another technique leaves.

use antumbra_gpu::{
    BindGroupCache, Counters, Expectation, Frame, Gpu, GpuError, Recorder, Technique,
    TechniqueConfig, TranslucentTriangles, bind, check_light, entries,
};
use serde::{Deserialize, Serialize};

use crate::Silhouette;
use crate::batches::Batches;
use crate::light::{contact, homogeneous_light};
use crate::triangles::MakeUniform;

/// Shadows of translucent casters (`antumbra_scene::Opacity`) behind those of another technique, which knows opaque ones:
/// each translucent triangle whose shadow volume contains the sample keeps the part of the light that its texture's alpha
/// says where the way to the light goes through (Hasselgren and Akenine-Moeller 2007); parts multiply, in any order to the
/// same bits, as sums of logarithms (Kim, Kim and Turk 2008). No light's image is drawn, and textures of alpha are looked up
/// where the light comes through, whatever the distance.
///
/// One pass over the view samples, whose cost is that of `volume/triangle` for the translucent triangles alone; a frame
/// without any has no pass. Area lights count as their middle.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Translucent<E = Silhouette> {
    /// The technique for opaque casters. Default `volume/silhouette`, in the facade `map/plain`.
    pub of: E,
}

impl<E: Default> Default for Translucent<E> {
    fn default() -> Self {
        Self { of: E::default() }
    }
}

impl<E: TechniqueConfig> TechniqueConfig for Translucent<E> {
    fn build(&self, gpu: &Gpu) -> Result<Box<dyn Technique>, GpuError> {
        let of = self.of.build(gpu)?;
        Ok(Box::new(Weakened { of, sheets: None, count: 0 }))
    }

    fn set_map_size(&mut self, size: u32) {
        self.of.set_map_size(size);
    }

    fn map_size(&self) -> Option<u32> {
        self.of.map_size()
    }

    fn expectation(&self, case: &str) -> Option<Expectation> {
        crate::expectation::translucent(case).or_else(|| self.of.expectation(case))
    }
}

/// The technique of [`Translucent`].
struct Weakened {
    of: Box<dyn Technique>,
    /// Made for the first frame with translucent casters.
    sheets: Option<Sheets>,
    /// Translucent triangles of the prepared frame.
    count: u32,
}

/// The pass over the view samples.
#[derive(Debug)]
struct Sheets {
    pipeline: wgpu::ComputePipeline,
    layouts: [wgpu::BindGroupLayout; 2],
    uniform: wgpu::Buffer,
    batches: Batches,
    group: BindGroupCache<([wgpu::Buffer; 5], [wgpu::TextureView; 3])>,
    textures: BindGroupCache<[wgpu::Buffer; 2]>,
}

const NAME: &str = "volume/translucent";

impl Sheets {
    fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        const CS: wgpu::ShaderStages = wgpu::ShaderStages::COMPUTE;
        let device = &gpu.device;
        let layout = |entries| {
            device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
                label: Some(NAME),
                entries,
            })
        };
        let layouts = [
            layout(&[
                entries::uniform(0, CS),
                entries::storage(1, CS),
                entries::storage(2, CS),
                entries::texels(3, CS, false),
                entries::texels(4, CS, false),
                entries::read_write_texture(5, CS, wgpu::TextureFormat::R32Float),
                entries::storage(6, CS),
                entries::storage(9, CS),
                entries::write_storage(10, CS),
            ]),
            layout(&[entries::storage(0, CS), entries::storage(1, CS)]),
        ];
        let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some(NAME),
            layout: Some(&device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
                label: Some(NAME),
                bind_group_layouts: &[Some(&layouts[0]), Some(&layouts[1])],
                immediate_size: 0,
            })),
            module: &gpu.shader(NAME, antumbra_shaders::link("volume::translucent", &[])?),
            entry_point: Some("weaken"),
            compilation_options: Default::default(),
            cache: None,
        });
        let uniform = device.create_buffer(&wgpu::BufferDescriptor {
            label: Some(NAME),
            size: size_of::<MakeUniform>() as u64,
            usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        Ok(Self {
            pipeline,
            layouts,
            uniform,
            batches: Batches::new(gpu, false)?,
            group: BindGroupCache::default(),
            textures: BindGroupCache::default(),
        })
    }

    fn encode(
        &mut self,
        gpu: &Gpu,
        frame: &Frame<'_>,
        recorder: &mut Recorder<'_>,
        sheets: &TranslucentTriangles<'_>,
        visibility: &wgpu::TextureView,
    ) {
        let samples = frame.samples;
        self.batches.encode(gpu, recorder, &sheets.triangles);
        let [boxes, asked] = self.batches.buffers();
        let triangles = &sheets.triangles;
        let key = (
            [triangles.positions, triangles.indices, sheets.coordinates, boxes, asked]
                .map(Clone::clone),
            [&samples.positions_view, &samples.normals_view, visibility].map(Clone::clone),
        );
        let group = self.group.get(key, |(buffers, [positions, normals, output])| {
            gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some(NAME),
                layout: &self.layouts[0],
                entries: &[
                    bind::buffer(0, &self.uniform),
                    bind::buffer(1, &buffers[0]),
                    bind::buffer(2, &buffers[1]),
                    bind::texture(3, positions),
                    bind::texture(4, normals),
                    bind::texture(5, output),
                    bind::buffer(6, &buffers[2]),
                    bind::buffer(9, &buffers[3]),
                    bind::buffer(10, &buffers[4]),
                ],
            })
        });
        let key = [sheets.textures, sheets.texels].map(Clone::clone);
        let textures = self.textures.get(key, |[textures, texels]| {
            gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some(NAME),
                layout: &self.layouts[1],
                entries: &[bind::buffer(0, textures), bind::buffer(1, texels)],
            })
        });
        let (width, height) = samples.size();
        let mut pass = recorder.compute_pass(NAME);
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, group, &[]);
        pass.set_bind_group(1, textures, &[]);
        pass.dispatch_workgroups(width.div_ceil(8), height.div_ceil(8), 1);
    }
}

impl Technique for Weakened {
    fn prepare(&mut self, gpu: &Gpu, frame: &Frame<'_>) -> Result<(), GpuError> {
        self.of.prepare(gpu, frame)?;
        self.count = frame.casters.translucent().map_or(0, |sheets| sheets.triangles.triangles);
        if self.count == 0 {
            return Ok(());
        }
        check_light(frame.light)?;
        let sheets = match &mut self.sheets {
            Some(made) => made,
            none => none.insert(Sheets::new(gpu)?),
        };
        let light = homogeneous_light(frame);
        sheets.batches.prepare(gpu, self.count, light)?;
        let uniform = MakeUniform {
            light: light.to_array(),
            eye: [0.0, 0.0, 0.0, contact(frame)],
            how: [self.count, 0, 0, 0],
        };
        gpu.queue.write_buffer(&sheets.uniform, 0, bytemuck::bytes_of(&uniform));
        Ok(())
    }

    fn encode(
        &mut self,
        gpu: &Gpu,
        frame: &Frame<'_>,
        recorder: &mut Recorder<'_>,
        visibility: &wgpu::TextureView,
    ) -> Result<(), GpuError> {
        self.of.encode(gpu, frame, recorder, visibility)?;
        if let (Some(sheets), Some(found)) = (&mut self.sheets, frame.casters.translucent())
            && self.count > 0
        {
            sheets.encode(gpu, frame, recorder, &found, visibility);
        }
        Ok(())
    }

    fn counters(&self) -> Counters {
        let mut counters = self.of.counters();
        counters.extend([("translucent_triangles", u64::from(self.count))]);
        counters
    }

    fn read_counters(&self, gpu: &Gpu) -> Result<Counters, GpuError> {
        let mut counters = self.of.read_counters(gpu)?;
        counters.extend([("translucent_triangles", u64::from(self.count))]);
        if let Some(sheets) = self.sheets.as_ref().filter(|_| self.count > 0) {
            counters.extend([("asked_translucent", sheets.batches.read_asked(gpu)?)]);
        }
        Ok(counters)
    }

    fn bytes(&self) -> u64 {
        let sheets = self.sheets.as_ref();
        self.of.bytes() + sheets.map_or(0, |s| s.uniform.size() + s.batches.bytes())
    }
}

//! Asking every triangle's volume whether it contains the sample.

use antumbra_gpu::{
    BindGroupCache, Counters, Expectation, Frame, Gpu, GpuError, Recorder, Technique,
    TechniqueConfig, bind, entries,
};
use serde::{Deserialize, Serialize};

use crate::batches::Batches;
use crate::expectation;
use crate::light::{contact, homogeneous_light, triangles};
use crate::triangles::MakeUniform;

/// Whether any triangle's shadow volume contains the sample (Crow 1977; Fuchs et al. 1985), one plane after the other.
/// The definition of shadow volumes, and the measure of the techniques that count faces: nothing is drawn, so there is
/// no camera, and no pixel to which an edge could be snapped. Tiles of 8 x 8 samples go together through the batches of
/// 64 triangles that a ray from them to the light may meet.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Triangle {
    /// Whether batches of triangles are spared whose box no ray from a tile's samples to the light can meet (after
    /// Sintorn, Kaempe, Olsson and Assarsson 2014); default true. Costs a box for each batch, and changes no bit of the
    /// answer.
    pub culling: bool,
}

impl Default for Triangle {
    fn default() -> Self {
        Self { culling: true }
    }
}

impl TechniqueConfig for Triangle {
    fn build(&self, gpu: &Gpu) -> Result<Box<dyn Technique>, GpuError> {
        Ok(Box::new(Containment::new(gpu, self)?))
    }

    fn expectation(&self, case: &str) -> Option<Expectation> {
        expectation::triangle(case)
    }
}

/// The technique of [`Triangle`].
#[derive(Debug)]
pub struct Containment {
    pipeline: wgpu::ComputePipeline,
    layout: wgpu::BindGroupLayout,
    uniform: wgpu::Buffer,
    batches: Batches,
    group: BindGroupCache<([wgpu::Buffer; 4], [wgpu::TextureView; 3])>,
    prepared: bool,
    counters: Counters,
}

impl Containment {
    fn new(gpu: &Gpu, config: &Triangle) -> Result<Self, GpuError> {
        const CS: wgpu::ShaderStages = wgpu::ShaderStages::COMPUTE;
        let device = &gpu.device;
        let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("volume/triangle"),
            entries: &[
                entries::uniform(0, CS),
                entries::storage(1, CS),
                entries::storage(2, CS),
                entries::texels(3, CS, false),
                entries::texels(4, CS, false),
                entries::write_texture(5, CS, wgpu::TextureFormat::R32Float),
                entries::storage(9, CS),
                entries::write_storage(10, CS),
            ],
        });
        let shader =
            gpu.shader("volume/triangle", antumbra_shaders::link("volume::triangle", &[])?);
        let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some("volume/triangle"),
            layout: Some(&device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
                label: Some("volume/triangle"),
                bind_group_layouts: &[Some(&layout)],
                immediate_size: 0,
            })),
            module: &shader,
            entry_point: Some("ask_triangles"),
            compilation_options: Default::default(),
            cache: None,
        });
        let uniform = device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("volume/triangle"),
            size: size_of::<MakeUniform>() as u64,
            usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        Ok(Self {
            pipeline,
            layout,
            uniform,
            batches: Batches::new(gpu, !config.culling)?,
            group: BindGroupCache::default(),
            prepared: false,
            counters: Counters::new(),
        })
    }
}

impl Technique for Containment {
    fn prepare(&mut self, gpu: &Gpu, frame: &Frame<'_>) -> Result<(), GpuError> {
        let (light, count) = (homogeneous_light(frame), triangles(frame)?.triangles);
        self.batches.prepare(gpu, count, light)?;
        let uniform = MakeUniform {
            light: light.to_array(),
            eye: [0.0, 0.0, 0.0, contact(frame)],
            how: [count, 0, 0, 0],
        };
        gpu.queue.write_buffer(&self.uniform, 0, bytemuck::bytes_of(&uniform));
        self.prepared = true;
        Ok(())
    }

    fn encode(
        &mut self,
        gpu: &Gpu,
        frame: &Frame<'_>,
        recorder: &mut Recorder<'_>,
        visibility: &wgpu::TextureView,
    ) -> Result<(), GpuError> {
        let triangles = triangles(frame)?;
        if !self.prepared {
            return Err(GpuError::Invalid {
                what: "frame",
                value: "not prepared".to_owned(),
                fix: "call `prepare` with this frame before `encode`",
            });
        }
        let samples = frame.samples;
        self.batches.encode(gpu, recorder, &triangles);
        let [boxes, asked] = self.batches.buffers();
        let key = (
            [triangles.positions, triangles.indices, boxes, asked].map(Clone::clone),
            [&samples.positions_view, &samples.normals_view, visibility].map(Clone::clone),
        );
        let group = self.group.get(key, |(buffers, [positions, normals, output])| {
            gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("volume/triangle"),
                layout: &self.layout,
                entries: &[
                    bind::buffer(0, &self.uniform),
                    bind::buffer(1, &buffers[0]),
                    bind::buffer(2, &buffers[1]),
                    bind::texture(3, positions),
                    bind::texture(4, normals),
                    bind::texture(5, output),
                    bind::buffer(9, &buffers[2]),
                    bind::buffer(10, &buffers[3]),
                ],
            })
        });
        let (width, height) = samples.size();
        let mut pass = recorder.compute_pass("volume/triangle");
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, group, &[]);
        pass.dispatch_workgroups(width.div_ceil(8), height.div_ceil(8), 1);
        drop(pass);
        let tiles = u64::from(width.div_ceil(8)) * u64::from(height.div_ceil(8));
        self.counters = Counters::from([
            ("view_samples", u64::from(width) * u64::from(height)),
            ("volumes", triangles.triangles.into()),
            ("tiles", tiles),
        ]);
        Ok(())
    }

    fn counters(&self) -> Counters {
        self.counters.clone()
    }

    fn read_counters(&self, gpu: &Gpu) -> Result<Counters, GpuError> {
        let mut counters = self.counters();
        counters.extend([("asked_batches", self.batches.read_asked(gpu)?)]);
        Ok(counters)
    }

    fn bytes(&self) -> u64 {
        self.uniform.size() + self.batches.bytes()
    }
}

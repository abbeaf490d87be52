//! Planar projected shadows: casters flattened onto planes and drawn from the camera.

use antumbra_gpu::{
    BindGroupCache, Counters, Expectation, Frame, Gpu, GpuError, Recorder, Technique,
    TechniqueConfig, bind, entries,
};
use serde::{Deserialize, Serialize};

use super::plane::{self, Plane, planar_projection};
use super::{
    CastingUniform, MASK, ReceiverUniform, Table, VERTICES, mask_pipeline, mask_target,
    resolve_pipeline, triangles, unprepared,
};

/// Planar projected shadows (Blinn 1988): exact hard shadows on planes, to the camera's own pixels. Cost: all
/// casters drawn once more for each plane; no map.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Planar {
    /// The planes that receive shadows, world space; each costs a pass over all casters. Default none: the floors
    /// among the casters ([`antumbra_gpu::Casters::bodies`]).
    pub planes: Vec<Plane>,
}

impl TechniqueConfig for Planar {
    fn build(&self, gpu: &Gpu) -> Result<Box<dyn Technique>, GpuError> {
        Ok(Box::new(PlanarTechnique::new(gpu, self)?))
    }

    fn expectation(&self, case: &str) -> Option<Expectation> {
        super::expectation::planar(case)
    }
}

/// `Flattening` of `map/planar.wesl`.
#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
struct Flattening {
    clip: [[f32; 4]; 4],
    receiver: ReceiverUniform,
}

/// Planar projected shadows, as a technique.
#[derive(Debug)]
pub struct PlanarTechnique {
    planes: Vec<Plane>,
    draw: wgpu::RenderPipeline,
    resolve: wgpu::ComputePipeline,
    draw_layout: wgpu::BindGroupLayout,
    resolve_layout: wgpu::BindGroupLayout,
    flattenings: Table,
    casting: wgpu::Buffer,
    mask: Option<wgpu::TextureView>,
    draw_group: BindGroupCache<(wgpu::Buffer, [wgpu::TextureView; 2])>,
    resolve_group: BindGroupCache<[wgpu::TextureView; 2]>,
    instances: Option<u32>,
    counters: Counters,
}

impl PlanarTechnique {
    /// Checks the settings and builds the passes.
    ///
    /// # Errors
    /// A plane that is none.
    pub fn new(gpu: &Gpu, config: &Planar) -> Result<Self, GpuError> {
        const CS: wgpu::ShaderStages = wgpu::ShaderStages::COMPUTE;
        const VS_FS: wgpu::ShaderStages = wgpu::ShaderStages::VERTEX_FRAGMENT;
        const FS_CS: wgpu::ShaderStages = wgpu::ShaderStages::FRAGMENT.union(CS);
        plane::validate(&config.planes)?;
        let device = &gpu.device;
        let draw_layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("planar: casters"),
            entries: &[
                entries::storage(0, VS_FS),
                entries::texels(1, FS_CS, false),
                entries::texels(2, FS_CS, false),
            ],
        });
        let resolve_layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("planar: mask"),
            entries: &[
                entries::uniform(0, CS),
                entries::texels(1, CS, false),
                entries::write_texture(2, CS, wgpu::TextureFormat::R32Float),
            ],
        });
        let module = gpu.shader("planar", antumbra_shaders::link("map::planar", &[])?);
        let entry = ("vertex", "fragment");
        let draw = mask_pipeline(gpu, "planar", &module, entry, &[Some(VERTICES)], &draw_layout);
        let groups = [Some(&draw_layout), Some(&resolve_layout)];
        let resolve = resolve_pipeline(gpu, "planar", &module, &groups);
        let casting = gpu.buffer(
            "planar: light",
            bytemuck::bytes_of(&<CastingUniform as bytemuck::Zeroable>::zeroed()),
            wgpu::BufferUsages::UNIFORM,
        );
        Ok(Self {
            planes: config.planes.clone(),
            draw,
            resolve,
            draw_layout,
            resolve_layout,
            flattenings: Table::new(gpu, "planar: planes", wgpu::BufferUsages::STORAGE),
            casting,
            mask: None,
            draw_group: BindGroupCache::default(),
            resolve_group: BindGroupCache::default(),
            instances: None,
            counters: Counters::new(),
        })
    }
}

impl Technique for PlanarTechnique {
    fn prepare(&mut self, gpu: &Gpu, frame: &Frame<'_>) -> Result<(), GpuError> {
        self.instances = None;
        let light = plane::light_vector(frame)?;
        let Some(camera) = frame.camera else {
            return Err(GpuError::Invalid {
                what: "camera of the frame",
                value: "none".to_owned(),
                fix: "give the camera that sees the samples, or choose a shadow texture or a shadow map",
            });
        };
        triangles(frame)?;
        let receivers = plane::receivers(&self.planes, frame, light)?;
        let flattenings: Vec<Flattening> = receivers
            .iter()
            .map(|receiver| Flattening {
                clip: (camera.clip * planar_projection(receiver.plane, light))
                    .as_mat4()
                    .to_cols_array_2d(),
                receiver: ReceiverUniform::new(receiver, 0, 0),
            })
            .collect();
        self.flattenings.write(gpu, &flattenings)?;
        let casting = CastingUniform::new(light, receivers.len());
        gpu.queue.write_buffer(&self.casting, 0, bytemuck::bytes_of(&casting));
        let (width, height) = frame.samples.size();
        if self.mask.as_ref().is_none_or(|m| m.texture().size() != frame.samples.positions.size()) {
            let mask = gpu.create_texture(
                "shadow mask",
                &wgpu::TextureDescriptor {
                    label: Some("planar: mask"),
                    size: wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
                    mip_level_count: 1,
                    sample_count: 1,
                    dimension: wgpu::TextureDimension::D2,
                    format: MASK,
                    usage: wgpu::TextureUsages::RENDER_ATTACHMENT
                        | wgpu::TextureUsages::TEXTURE_BINDING,
                    view_formats: &[],
                },
            )?;
            self.mask = Some(mask.create_view(&Default::default()));
        }
        self.instances = Some(receivers.len() as u32);
        Ok(())
    }

    fn encode(
        &mut self,
        gpu: &Gpu,
        frame: &Frame<'_>,
        recorder: &mut Recorder<'_>,
        visibility: &wgpu::TextureView,
    ) -> Result<(), GpuError> {
        let (Some(instances), Some(mask)) = (self.instances, &self.mask) else {
            return Err(unprepared());
        };
        let casters = triangles(frame)?;
        let device = &gpu.device;
        let samples = [frame.samples.positions_view.clone(), frame.samples.normals_view.clone()];
        let draw_group =
            self.draw_group.get((self.flattenings.buffer.clone(), samples), |(planes, [p, n])| {
                device.create_bind_group(&wgpu::BindGroupDescriptor {
                    label: Some("planar: casters"),
                    layout: &self.draw_layout,
                    entries: &[bind::buffer(0, planes), bind::texture(1, p), bind::texture(2, n)],
                })
            });
        let key = [mask.clone(), visibility.clone()];
        let resolve_group = self.resolve_group.get(key, |[mask, output]| {
            device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("planar: mask"),
                layout: &self.resolve_layout,
                entries: &[
                    bind::buffer(0, &self.casting),
                    bind::texture(1, mask),
                    bind::texture(2, output),
                ],
            })
        });
        let draws = u64::from(instances > 0 && casters.triangles > 0);
        {
            let mut pass = recorder.render_pass("map/planar", &[mask_target(mask, true)], None);
            if draws > 0 {
                pass.set_pipeline(&self.draw);
                pass.set_bind_group(0, draw_group, &[]);
                pass.set_vertex_buffer(0, casters.positions.slice(..));
                pass.set_index_buffer(casters.indices.slice(..), wgpu::IndexFormat::Uint32);
                pass.draw_indexed(0..3 * casters.triangles, 0, 0..instances);
            }
        }
        let (width, height) = frame.samples.size();
        let mut pass = recorder.compute_pass("map/planar_resolve");
        pass.set_pipeline(&self.resolve);
        pass.set_bind_group(0, draw_group, &[]);
        pass.set_bind_group(1, resolve_group, &[]);
        pass.dispatch_workgroups(width.div_ceil(8), height.div_ceil(8), 1);
        self.counters = Counters::from([
            ("planes", u64::from(instances)),
            ("draws", draws),
            ("triangles", draws * u64::from(instances) * u64::from(casters.triangles)),
            ("view_samples", u64::from(width) * u64::from(height)),
        ]);
        Ok(())
    }

    fn counters(&self) -> Counters {
        self.counters.clone()
    }

    fn bytes(&self) -> u64 {
        let mask = self.mask.as_ref().map_or(0, |m| {
            let size = m.texture().size();
            u64::from(size.width) * u64::from(size.height)
        });
        mask + self.flattenings.buffer.size() + self.casting.size()
    }
}

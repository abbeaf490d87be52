//! Shadow textures: masks of the casters as the light sees them, thrown onto planes.

use antumbra_gpu::{
    BindGroupCache, Counters, Expectation, Frame, Gpu, GpuError, Layers, Recorder, Technique,
    TechniqueConfig, bind, entries,
};
use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::plane::{self, Plane};
use super::{
    CastingUniform, MASK, ReceiverUniform, Table, VERTICES, mask_pipeline, mask_target,
    resolve_pipeline, triangles, unprepared,
};
use crate::{Fitting, fit};

/// Widest blur: beyond it a mask of fewer texels does the same.
const MAX_BLUR: f32 = 64.0;

/// Shadow textures (*Real-Time Shadows* 2.1.2; Nagy 2000): a mask of the casters as the light sees them, read where
/// the plane is. A quarter of a depth map's memory, no bias, no self-shadowing, and the mask may be filtered like
/// any picture.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ShadowTexture {
    /// Side of the mask (of one for each plane and face of a cube), texels; 1 to the device's limit (at least
    /// 8192), default 2048. One byte a texel; error falls with the inverse of the side.
    pub size: u32,
    /// The planes that receive shadows, world space; each costs a mask. Default none: the floors among the casters
    /// ([`antumbra_gpu::Casters::bodies`]).
    pub planes: Vec<Plane>,
    /// Whether the mask is interpolated between its texels: a ramp of one texel instead of a staircase. Default
    /// true; costs three fetches more.
    pub linear: bool,
    /// Standard deviation of a Gaussian blur of the mask, texels, 0 to 64, default 0: none. A penumbra of one width
    /// everywhere, also at contacts. Costs two passes over each mask of 6 `blur` + 1 fetches a texel.
    pub blur: f32,
}

impl Default for ShadowTexture {
    fn default() -> Self {
        Self { size: 2048, planes: Vec::new(), linear: true, blur: 0.0 }
    }
}

impl ShadowTexture {
    /// Taps of the blur to either side of a texel: three standard deviations, beyond which lies 0.3 % of the
    /// kernel.
    pub(super) fn blur_radius(&self) -> u32 {
        (3.0 * self.blur).ceil() as u32
    }

    /// Farthest texel centre, per axis, that a sample reads, texels.
    pub(super) fn radius(&self) -> f32 {
        (if self.linear { 1.0 } else { 0.5 }) + self.blur_radius() as f32
    }
}

impl TechniqueConfig for ShadowTexture {
    fn build(&self, gpu: &Gpu) -> Result<Box<dyn Technique>, GpuError> {
        Ok(Box::new(ShadowTextureTechnique::new(gpu, self)?))
    }

    fn set_map_size(&mut self, size: u32) {
        self.size = size;
    }

    fn expectation(&self, case: &str) -> Option<Expectation> {
        super::expectation::shadow_texture(self, case)
    }
}

/// `MaskView` of `map/shadow_texture.wesl`.
#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
struct MaskView {
    clip: [[f32; 4]; 4],
    plane: [f32; 4],
    lookup: [f32; 4],
}

/// `Blur` of `map/mask_blur.wesl`.
#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
struct BlurUniform {
    step: [i32; 2],
    sigma: f32,
    radius: i32,
}

/// Shadow textures, as a technique.
#[derive(Debug)]
pub struct ShadowTextureTechnique {
    config: ShadowTexture,
    cast: wgpu::RenderPipeline,
    resolve: wgpu::ComputePipeline,
    lists_layout: wgpu::BindGroupLayout,
    frame_layout: wgpu::BindGroupLayout,
    casting: wgpu::Buffer,
    views: Table,
    receivers: Table,
    /// As many layers as were ever needed; one texel where none was.
    masks: Layers,
    blur: Option<Blur>,
    lists_group: BindGroupCache<[wgpu::Buffer; 2]>,
    frame_group: BindGroupCache<[wgpu::TextureView; 4]>,
    hull: Vec<DVec3>,
    layers: Option<u32>,
    counters: Counters,
}

/// The blur's passes: from a layer to the scratch texture and back.
#[derive(Debug)]
struct Blur {
    pipeline: wgpu::RenderPipeline,
    layout: wgpu::BindGroupLayout,
    steps: [wgpu::Buffer; 2],
    scratch: Option<wgpu::TextureView>,
    /// Group of the first pass of each layer, and the second pass's.
    groups: Vec<wgpu::BindGroup>,
    back: Option<wgpu::BindGroup>,
}

impl ShadowTextureTechnique {
    /// Checks the settings and builds the passes.
    ///
    /// # Errors
    /// A size beyond the device's limits, a blur out of range, or a plane that is none.
    pub fn new(gpu: &Gpu, config: &ShadowTexture) -> Result<Self, GpuError> {
        const CS: wgpu::ShaderStages = wgpu::ShaderStages::COMPUTE;
        const VS_CS: wgpu::ShaderStages = wgpu::ShaderStages::VERTEX.union(CS);
        validate(gpu, config)?;
        let device = &gpu.device;
        let lists_layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("shadow texture: lists"),
            entries: &[
                entries::uniform(0, CS),
                entries::storage(1, VS_CS),
                entries::storage(2, CS),
            ],
        });
        let frame_layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("shadow texture: frame"),
            entries: &[
                entries::texels(0, CS, false),
                entries::texels(1, CS, false),
                entries::texels(2, CS, true),
                entries::write_texture(3, CS, wgpu::TextureFormat::R32Float),
            ],
        });
        let module =
            gpu.shader("shadow texture", antumbra_shaders::link("map::shadow_texture", &[])?);
        let cast = mask_pipeline(
            gpu,
            "shadow texture",
            &module,
            ("draw", "black"),
            &[Some(VERTICES)],
            &lists_layout,
        );
        let groups = [Some(&lists_layout), Some(&frame_layout)];
        let resolve = resolve_pipeline(gpu, "shadow texture", &module, &groups);
        let casting = gpu.buffer(
            "shadow texture: light",
            bytemuck::bytes_of(&<CastingUniform as bytemuck::Zeroable>::zeroed()),
            wgpu::BufferUsages::UNIFORM,
        );
        Ok(Self {
            config: config.clone(),
            cast,
            resolve,
            lists_layout,
            frame_layout,
            casting,
            views: Table::new(gpu, "shadow texture: views", wgpu::BufferUsages::STORAGE),
            receivers: Table::new(gpu, "shadow texture: planes", wgpu::BufferUsages::STORAGE),
            masks: masks(gpu, 1, 1)?,
            blur: if config.blur > 0.0 { Some(Blur::new(gpu, config)?) } else { None },
            lists_group: BindGroupCache::default(),
            frame_group: BindGroupCache::default(),
            hull: Vec::new(),
            layers: None,
            counters: Counters::new(),
        })
    }

    /// The mask: a layer for each plane and view of the light with casters, 1 lit, 0 dark.
    #[must_use]
    pub fn mask(&self) -> &wgpu::Texture {
        &self.masks.texture
    }
}

fn validate(gpu: &Gpu, config: &ShadowTexture) -> Result<(), GpuError> {
    let limit = gpu.device.limits().max_texture_dimension_2d;
    if config.size == 0 {
        let fix = "use at least 1 texel a side";
        return Err(GpuError::Invalid { what: "map size", value: "0".to_owned(), fix });
    }
    if config.size > limit {
        let asked = config.size.into();
        return Err(GpuError::Limit { what: "map size", asked, limit: limit.into() });
    }
    if !(0.0..=MAX_BLUR).contains(&config.blur) {
        let fix = "use 0 to 64 texels, or a smaller mask";
        return Err(GpuError::Invalid { what: "blur", value: config.blur.to_string(), fix });
    }
    plane::validate(&config.planes)
}

fn masks(gpu: &Gpu, size: u32, count: u32) -> Result<Layers, GpuError> {
    let usage = wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC;
    Layers::new(gpu, "shadow texture", MASK, (size, count), usage)
}

impl Blur {
    fn new(gpu: &Gpu, config: &ShadowTexture) -> Result<Self, GpuError> {
        const FS: wgpu::ShaderStages = wgpu::ShaderStages::FRAGMENT;
        let device = &gpu.device;
        let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("mask blur"),
            entries: &[entries::uniform(0, FS), entries::texels(1, FS, false)],
        });
        let module = gpu.shader("mask blur", antumbra_shaders::link("map::mask_blur", &[])?);
        let entry = ("vertex", "fragment");
        let pipeline = mask_pipeline(gpu, "mask blur", &module, entry, &[], &layout);
        let steps = [[1, 0], [0, 1]].map(|step| {
            let radius = config.blur_radius() as i32;
            let uniform = BlurUniform { step, sigma: config.blur, radius };
            gpu.buffer("mask blur", bytemuck::bytes_of(&uniform), wgpu::BufferUsages::UNIFORM)
        });
        Ok(Self { pipeline, layout, steps, scratch: None, groups: Vec::new(), back: None })
    }

    /// Makes the scratch texture and the bind groups for new masks.
    fn follow(&mut self, gpu: &Gpu, made: &Layers) -> Result<(), GpuError> {
        let size = made.texture.width();
        let scratch = match self.scratch.take() {
            Some(scratch) if scratch.texture().width() == size => scratch,
            _ => masks(gpu, size, 1)?.each.remove(0),
        };
        let group = |step: &wgpu::Buffer, from: &wgpu::TextureView| {
            gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("mask blur"),
                layout: &self.layout,
                entries: &[bind::buffer(0, step), bind::texture(1, from)],
            })
        };
        self.groups = made.each.iter().map(|layer| group(&self.steps[0], layer)).collect();
        self.back = Some(group(&self.steps[1], &scratch));
        self.scratch = Some(scratch);
        Ok(())
    }

    fn encode(&self, recorder: &mut Recorder<'_>, layer: usize, view: &wgpu::TextureView) {
        let (Some(scratch), Some(back)) = (&self.scratch, &self.back) else { return };
        for (group, target) in [(&self.groups[layer], scratch), (back, view)] {
            let targets = [mask_target(target, false)];
            let mut pass = recorder.render_pass("map/mask_blur", &targets, None);
            pass.set_pipeline(&self.pipeline);
            pass.set_bind_group(0, group, &[]);
            pass.draw(0..3, 0..1);
        }
    }
}

impl Technique for ShadowTextureTechnique {
    fn prepare(&mut self, gpu: &Gpu, frame: &Frame<'_>) -> Result<(), GpuError> {
        self.layers = None;
        let light = plane::light_vector(frame)?;
        triangles(frame)?;
        self.hull.clear();
        let hull = &mut self.hull;
        frame.casters.hull(frame.light, &mut |p| hull.push(p));
        // The kernel's radius, and one texel more for the rounding of a sample at the window's border.
        let guard = self.config.radius().ceil() as u32 + 1;
        let fitting = Fitting {
            origin: frame.origin,
            size: self.config.size,
            guard,
            receivers: false,
            grid: 1,
        };
        let fitted = fit(frame.light, &self.hull, &fitting)?;
        let linear = if self.config.linear { 1.0 } else { 0.0 };
        let (mut views, mut receivers) = (Vec::new(), Vec::new());
        for receiver in plane::receivers(&self.config.planes, frame, light)? {
            let first = views.len();
            for clip in fitted.iter().filter_map(|view| view.clip) {
                views.push(MaskView {
                    clip: clip.as_mat4().to_cols_array_2d(),
                    plane: receiver.uniform().0,
                    lookup: [views.len() as f32, linear, 0.0, 0.0],
                });
            }
            receivers.push(ReceiverUniform::new(&receiver, first, views.len() - first));
        }
        self.views.write(gpu, &views)?;
        self.receivers.write(gpu, &receivers)?;
        let casting = CastingUniform::new(light, receivers.len());
        gpu.queue.write_buffer(&self.casting, 0, bytemuck::bytes_of(&casting));
        let have = &self.masks.texture;
        if !views.is_empty()
            && (have.width() != self.config.size
                || have.depth_or_array_layers() < views.len() as u32)
        {
            self.masks = masks(gpu, self.config.size, views.len() as u32)?;
            if let Some(blur) = &mut self.blur {
                blur.follow(gpu, &self.masks)?;
            }
        }
        self.layers = Some(views.len() as u32);
        Ok(())
    }

    fn encode(
        &mut self,
        gpu: &Gpu,
        frame: &Frame<'_>,
        recorder: &mut Recorder<'_>,
        visibility: &wgpu::TextureView,
    ) -> Result<(), GpuError> {
        let layers = self.layers.ok_or_else(unprepared)?;
        let casters = triangles(frame)?;
        let device = &gpu.device;
        let key = [self.views.buffer.clone(), self.receivers.buffer.clone()];
        let lists_group = self.lists_group.get(key, |[views, receivers]| {
            device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("shadow texture: lists"),
                layout: &self.lists_layout,
                entries: &[
                    bind::buffer(0, &self.casting),
                    bind::buffer(1, views),
                    bind::buffer(2, receivers),
                ],
            })
        });
        for layer in 0..layers {
            let view = &self.masks.each[layer as usize];
            {
                let targets = [mask_target(view, true)];
                let mut pass = recorder.render_pass("map/mask", &targets, None);
                pass.set_pipeline(&self.cast);
                pass.set_bind_group(0, lists_group, &[]);
                pass.set_vertex_buffer(0, casters.positions.slice(..));
                pass.set_index_buffer(casters.indices.slice(..), wgpu::IndexFormat::Uint32);
                pass.draw_indexed(0..3 * casters.triangles, 0, layer..layer + 1);
            }
            if let Some(blur) = &self.blur {
                blur.encode(recorder, layer as usize, view);
            }
        }
        let samples = frame.samples;
        let key = [
            samples.positions_view.clone(),
            samples.normals_view.clone(),
            self.masks.whole.clone(),
            visibility.clone(),
        ];
        let frame_group = self.frame_group.get(key, |[positions, normals, mask, output]| {
            device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("shadow texture: frame"),
                layout: &self.frame_layout,
                entries: &[
                    bind::texture(0, positions),
                    bind::texture(1, normals),
                    bind::texture(2, mask),
                    bind::texture(3, output),
                ],
            })
        });
        let (width, height) = samples.size();
        let mut pass = recorder.compute_pass("map/mask_resolve");
        pass.set_pipeline(&self.resolve);
        pass.set_bind_group(0, lists_group, &[]);
        pass.set_bind_group(1, frame_group, &[]);
        pass.dispatch_workgroups(width.div_ceil(8), height.div_ceil(8), 1);
        let count = u64::from(layers);
        let texels = count * u64::from(self.config.size) * u64::from(self.config.size);
        self.counters = Counters::from([
            ("map_passes", count),
            ("map_draws", count),
            ("map_triangles", count * u64::from(casters.triangles)),
            ("map_texels", texels),
            ("view_samples", u64::from(width) * u64::from(height)),
        ]);
        Ok(())
    }

    fn counters(&self) -> Counters {
        self.counters.clone()
    }

    fn bytes(&self) -> u64 {
        let scratch = self.blur.as_ref().and_then(|b| b.scratch.as_ref());
        let scratch = scratch.map_or(0, |s| u64::from(s.texture().width()).pow(2));
        let buffers = self.views.buffer.size() + self.receivers.buffer.size() + self.casting.size();
        self.masks.bytes() + scratch + buffers
    }
}

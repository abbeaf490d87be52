//! What the camera sees as the light sees it, in a map that volumes ask.

use antumbra_gpu::{
    BindGroupCache, CasterEdges, CasterTriangles, Gpu, GpuError, Recorder, ViewSamples, bind,
    entries,
};
use glam::Vec4;

use crate::Savings;
use crate::receivers::storage;
use crate::triangles::dispatch;

/// The map and the passes that make it and ask it; `volume/litmap.wesl`.
#[derive(Debug)]
pub(crate) struct Litmap {
    savings: Savings,
    lay_frames: wgpu::ComputePipeline,
    mark: wgpu::ComputePipeline,
    hide: wgpu::ComputePipeline,
    settle: wgpu::ComputePipeline,
    widen: wgpu::ComputePipeline,
    ask: [wgpu::ComputePipeline; 2],
    /// Of samples, of what hides, of the N-buffer, and of what asks: triangles, bodies.
    layouts: [wgpu::BindGroupLayout; 5],
    settings: wgpu::Buffer,
    /// The level to widen to, at multiples of `stride`.
    steps: wgpu::Buffer,
    stride: u32,
    frames: wgpu::Buffer,
    texels: wgpu::Buffer,
    shape: Shape,
    samples: BindGroupCache<([wgpu::TextureView; 2], wgpu::Buffer)>,
    hidden: BindGroupCache<Vec<wgpu::Buffer>>,
    widened: BindGroupCache<wgpu::Buffer>,
    asking: BindGroupCache<Vec<wgpu::Buffer>>,
    size: (u32, u32),
    asked: [u32; 2],
    strips: [u32; 2],
}

/// Texels a side of a layer, layers, and levels of the N-buffer.
#[derive(Clone, Copy, Debug, Default)]
struct Shape {
    side: u32,
    layers: u32,
    levels: u32,
}

impl Shape {
    fn new(savings: &Savings, light: Vec4) -> Self {
        let (side, layers) =
            if light.w == 0.0 { (savings.litmap, 1) } else { (savings.litmap / 2, 6) };
        // A window as large as the map is four of half its side.
        Self { side, layers, levels: side.ilog2() }
    }

    fn bytes(&self) -> u64 {
        16 * u64::from(self.side).pow(2) * u64::from(self.layers) * u64::from(self.levels)
    }
}

/// The twin of `Settings` in the shader.
#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
struct Settings {
    light: [f32; 4],
    map: [u32; 4],
    view: [u32; 4],
    how: [f32; 4],
    rows: [u32; 4],
}

/// What the map is made for.
#[derive(Clone, Copy)]
pub(crate) struct LitmapRequest<'a> {
    pub(crate) samples: &'a ViewSamples,
    pub(crate) volumes: u32,
    pub(crate) light: Vec4,
    pub(crate) contact: f32,
    /// Edges of the casters, where texels may be hidden.
    pub(crate) edges: u32,
}

/// Words of the frames of six layers, and one of the largest distance of a sample from its surface.
const FRAME_BYTES: u64 = 16 * 6 + 16;
/// Invocations that share an edge: strips of each of its two triangles; `volume/litmap_make.wesl` knows them too.
const SHARING: u32 = 2 * 16;
/// Levels that there are uniforms for: those of the largest map.
const LEVELS: u32 = 12;

impl Litmap {
    /// Builds the passes.
    ///
    /// # Errors
    /// A shader that does not link (a fault of this library).
    pub(crate) fn new(gpu: &Gpu, savings: Savings) -> Result<Self, GpuError> {
        const CS: wgpu::ShaderStages = wgpu::ShaderStages::COMPUTE;
        let layout = |entries: &[wgpu::BindGroupLayoutEntry]| {
            gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
                label: Some("volume/litmap"),
                entries,
            })
        };
        let (read, write) = (|n| entries::storage(n, CS), |n| entries::write_storage(n, CS));
        let uniform = entries::uniform(0, CS);
        let texels = |n| entries::texels(n, CS, false);
        let layouts = [
            layout(&[uniform, texels(1), texels(2), write(3), write(4)]),
            layout(&[uniform, write(3), write(4), read(5), read(6), read(7), read(8), read(9)]),
            layout(&[uniform, write(10), entries::dynamic_uniform(11, CS)]),
            layout(&[uniform, read(1), read(2), write(3), read(4), read(5)]),
            layout(&[uniform, read(1), read(2), write(3), read(6)]),
        ];
        let module =
            |root: &str| Ok::<_, GpuError>(gpu.shader(root, antumbra_shaders::link(root, &[])?));
        let (make, ask) = (module("volume::litmap_make")?, module("volume::litmap_ask")?);
        let [of_samples, of_casters, of_windows, of_triangles, of_bodies] = &layouts;
        let pipeline =
            |module, entry, layout| gpu.compute_pipeline("volume/litmap", module, entry, &[layout]);
        let alignment = gpu.device.limits().min_uniform_buffer_offset_alignment;
        let stride = 16_u32.next_multiple_of(alignment);
        let mut steps = vec![0_u32; (LEVELS * stride / 4) as usize];
        for level in 0..LEVELS {
            steps[(level * stride / 4) as usize] = level;
        }
        let uniforms = wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST;
        Ok(Self {
            savings,
            lay_frames: pipeline(&make, "lay_frames", of_samples),
            mark: pipeline(&make, "mark", of_samples),
            hide: pipeline(&make, "hide", of_casters),
            settle: pipeline(&make, "settle", of_windows),
            widen: pipeline(&make, "widen", of_windows),
            ask: [
                pipeline(&ask, "ask_triangles", of_triangles),
                pipeline(&ask, "ask_bodies", of_bodies),
            ],
            layouts,
            settings: gpu.buffer("litmap", &[0; size_of::<Settings>()], uniforms),
            steps: gpu.buffer("litmap levels", bytemuck::cast_slice(&steps), uniforms),
            stride,
            frames: storage(gpu, "litmap frames", FRAME_BYTES)?,
            texels: storage(gpu, "litmap", 0)?,
            shape: Shape::default(),
            samples: BindGroupCache::default(),
            hidden: BindGroupCache::default(),
            widened: BindGroupCache::default(),
            asking: BindGroupCache::default(),
            size: (0, 0),
            asked: [0; 2],
            strips: [0; 2],
        })
    }

    /// Uploads what the passes need to know, and makes room for the map.
    ///
    /// # Errors
    /// A failed allocation, or more edges than a dispatch takes.
    pub(crate) fn prepare(
        &mut self,
        gpu: &Gpu,
        request: &LitmapRequest<'_>,
    ) -> Result<(), GpuError> {
        let LitmapRequest { samples, volumes, light, contact, edges } = *request;
        self.shape = Shape::new(&self.savings, light);
        if self.texels.size() < self.shape.bytes() {
            self.texels = storage(gpu, "litmap", self.shape.bytes())?;
        }
        self.size = samples.size();
        let (row, strip_row);
        (self.asked, row) = dispatch(gpu, volumes);
        (self.strips, strip_row) = dispatch(gpu, edges.saturating_mul(SHARING));
        let Shape { side, layers, levels } = self.shape;
        let settings = Settings {
            light: light.to_array(),
            map: [side, layers, levels, volumes],
            view: [self.size.0, self.size.1, row, edges],
            how: [contact, self.savings.reach_of_interest(), 0.0, 0.0],
            rows: [strip_row, 0, 0, 0],
        };
        gpu.queue.write_buffer(&self.settings, 0, bytemuck::bytes_of(&settings));
        let views = [&samples.positions_view, &samples.normals_view].map(Clone::clone);
        let group = |layout, entries: &[wgpu::BindGroupEntry<'_>]| {
            gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("volume/litmap"),
                layout,
                entries,
            })
        };
        self.samples.get((views, self.texels.clone()), |([positions, normals], texels)| {
            let entries = [
                bind::buffer(0, &self.settings),
                bind::texture(1, positions),
                bind::texture(2, normals),
                bind::buffer(3, &self.frames),
                bind::buffer(4, texels),
            ];
            group(&self.layouts[0], &entries)
        });
        self.widened.get(self.texels.clone(), |texels| {
            let step = wgpu::BindGroupEntry {
                binding: 11,
                resource: wgpu::BindingResource::Buffer(wgpu::BufferBinding {
                    buffer: &self.steps,
                    offset: 0,
                    size: wgpu::BufferSize::new(16),
                }),
            };
            let entries = [bind::buffer(0, &self.settings), bind::buffer(10, texels), step];
            group(&self.layouts[2], &entries)
        });
        Ok(())
    }

    /// Records the passes: for the volumes of triangles, or with `bodies` for those.
    pub(crate) fn encode(
        &mut self,
        gpu: &Gpu,
        recorder: &mut Recorder<'_>,
        triangles: &CasterTriangles<'_>,
        edges: Option<&CasterEdges>,
        of_bodies: bool,
        limits: &wgpu::Buffer,
    ) {
        recorder.encoder.clear_buffer(&self.frames, 0, None);
        let Shape { side, layers, levels } = self.shape;
        // Levels beyond the first are written whole; the first is the start of each layer's.
        let level = 16 * u64::from(side).pow(2);
        for layer in 0..u64::from(layers) {
            let offset = layer * u64::from(levels) * level;
            recorder.encoder.clear_buffer(&self.texels, offset, Some(level));
        }
        let group = |layout, numbered: &[(u32, &wgpu::Buffer)]| {
            let entries: Vec<_> =
                numbered.iter().map(|(number, buffer)| bind::buffer(*number, buffer)).collect();
            gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("volume/litmap"),
                layout,
                entries: &entries,
            })
        };
        let key = |numbered: &[(u32, &wgpu::Buffer)]| -> Vec<_> {
            numbered.iter().map(|(_, buffer)| (*buffer).clone()).collect()
        };
        let (Some(samples), Some(widened)) = (self.samples.kept(), self.widened.kept()) else {
            return;
        };
        let mut pass = recorder.compute_pass("volume/litmap");
        let (width, height) = self.size;
        for pipeline in [&self.lay_frames, &self.mark] {
            pass.set_pipeline(pipeline);
            pass.set_bind_group(0, samples, &[]);
            pass.dispatch_workgroups(width.div_ceil(16), height.div_ceil(16), 1);
        }
        if let Some(edges) = edges.filter(|_| self.savings.hidden) {
            let bound = [
                (0, &self.settings),
                (3, &self.frames),
                (4, &self.texels),
                (5, triangles.positions),
                (6, triangles.indices),
                (7, &edges.first),
                (8, &edges.uses),
                (9, &edges.vertices),
            ];
            let hidden = self.hidden.get(key(&bound), |_| group(&self.layouts[1], &bound));
            pass.set_pipeline(&self.hide);
            pass.set_bind_group(0, hidden, &[]);
            pass.dispatch_workgroups(self.strips[0], self.strips[1], layers);
        }
        let groups = side.div_ceil(8);
        for level in 0..levels {
            pass.set_pipeline(if level == 0 { &self.settle } else { &self.widen });
            pass.set_bind_group(0, widened, &[level * self.stride]);
            pass.dispatch_workgroups(groups, groups, layers);
        }
        let mut bound =
            vec![(0, &self.settings), (1, &self.frames), (2, &self.texels), (3, limits)];
        match edges.filter(|_| of_bodies) {
            Some(edges) => bound.push((6, &edges.bodies)),
            None => bound.extend([(4, triangles.positions), (5, triangles.indices)]),
        }
        let which = usize::from(of_bodies);
        let asking = self.asking.get(key(&bound), |_| group(&self.layouts[3 + which], &bound));
        pass.set_pipeline(&self.ask[which]);
        pass.set_bind_group(0, asking, &[]);
        pass.dispatch_workgroups(self.asked[0], self.asked[1], 1);
    }

    /// Bytes of GPU memory held.
    pub(crate) fn bytes(&self) -> u64 {
        self.texels.size() + self.frames.size()
    }
}

#[cfg(test)]
mod tests;

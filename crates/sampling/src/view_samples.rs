//! View-sample mapping: a shadow map whose samples are those of the view.

mod expectation;
mod grid;
mod lists;
pub mod twin;

use antumbra_gpu::{
    BindGroupCache, CasterTriangles, Counters, Expectation, Frame, Gpu, GpuError, Recorder, Scan,
    Technique, TechniqueConfig, bind, check_light, entries, read_buffer,
};
use serde::{Deserialize, Serialize};

pub use grid::{Face, Grid};

use grid::GridUniform;
use grid::{BLOCK, Fitter};
use lists::{Extent, Lists, Piece};

/// Exact hard shadows by view-sample mapping, also irregular z-buffer or alias-free shadow maps (Aila, Laine 2004;
/// Johnson, Lee, Burns, Mark 2005), with lists counted, summed and scattered (Sintorn, Eisemann, Assarsson 2008): casters
/// are rasterised over the view samples themselves, sorted into a coarse grid as the light sees them.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ViewSampleMapping {
    /// Buckets a side of the grid, 1 to 1024, default 256; half of it for each face of a light that shines all around.
    /// The picture does not depend on it. Few buckets mean long lists, many mean more rows for each triangle.
    pub buckets: u32,
}

impl Default for ViewSampleMapping {
    fn default() -> Self {
        Self { buckets: 256 }
    }
}

impl TechniqueConfig for ViewSampleMapping {
    fn build(&self, gpu: &Gpu) -> Result<Box<dyn Technique>, GpuError> {
        Ok(Box::new(ViewSampleMap::new(gpu, self)?))
    }

    fn expectation(&self, case: &str) -> Option<Expectation> {
        expectation::view_samples(case)
    }
}

/// The technique of [`ViewSampleMapping`].
#[derive(Debug)]
pub struct ViewSampleMap {
    config: ViewSampleMapping,
    passes: Passes,
    scan: Scan,
    fitter: Fitter,
    uniform: wgpu::Buffer,
    room: wgpu::Buffer,
    lists: Option<Lists>,
    prepared: Option<Prepared>,
    list_group: BindGroupCache<([wgpu::Buffer; 5], [wgpu::TextureView; 3])>,
    caster_group: BindGroupCache<[wgpu::Buffer; 8]>,
    piece_group: BindGroupCache<[wgpu::Buffer; 2]>,
    counters: Counters,
}

#[derive(Debug)]
struct Passes {
    list_layout: wgpu::BindGroupLayout,
    caster_layout: wgpu::BindGroupLayout,
    piece_layout: wgpu::BindGroupLayout,
    count: wgpu::ComputePipeline,
    scatter: wgpu::ComputePipeline,
    resolve: wgpu::ComputePipeline,
    distribute: wgpu::ComputePipeline,
    size_dispatch: wgpu::ComputePipeline,
    test: wgpu::ComputePipeline,
}

/// What `prepare` leaves for `encode`.
#[derive(Debug)]
struct Prepared {
    grid: Grid,
    /// Workgroups over the places for casters.
    groups: [u32; 2],
    /// Triangles, each once for each face that it can cast into.
    casters: u64,
}

/// Invocations of a workgroup over casters.
const GROUP: u32 = 64;

impl Passes {
    fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        const CS: wgpu::ShaderStages = wgpu::ShaderStages::COMPUTE;
        let layout = |label, entries: &[_]| {
            gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
                label: Some(label),
                entries,
            })
        };
        let list_layout = layout(
            "lists of view samples",
            &[
                entries::uniform(0, CS),
                entries::texels(1, CS, false),
                entries::texels(2, CS, false),
                entries::write_storage(3, CS),
                entries::write_storage(4, CS),
                entries::write_storage(5, CS),
                entries::write_storage(6, CS),
                entries::write_storage(7, CS),
                entries::write_texture(8, CS, wgpu::TextureFormat::R32Float),
            ],
        );
        let caster_layout = layout(
            "casters over view samples",
            &[
                entries::uniform(0, CS),
                entries::storage(1, CS),
                entries::storage(2, CS),
                entries::storage(3, CS),
                entries::storage(4, CS),
                entries::write_storage(5, CS),
                entries::storage(6, CS),
                entries::write_storage(7, CS),
                entries::write_storage(8, CS),
            ],
        );
        let piece_layout = layout(
            "pieces",
            &[entries::storage(0, CS), entries::write_storage(1, CS), entries::uniform(2, CS)],
        );
        let shader = |root: &'static str| {
            Ok::<_, GpuError>(gpu.shader(root, antumbra_shaders::link(root, &[])?))
        };
        let lists = shader("sampling::view_samples_lists")?;
        let casters = shader("sampling::view_samples_casters")?;
        let pieces = shader("sampling::view_samples_pieces")?;
        let pipeline = |module, entry, layout: &wgpu::BindGroupLayout| {
            gpu.compute_pipeline("sampling/view-samples", module, entry, &[layout])
        };
        Ok(Self {
            count: pipeline(&lists, "count", &list_layout),
            scatter: pipeline(&lists, "scatter", &list_layout),
            resolve: pipeline(&lists, "resolve", &list_layout),
            distribute: pipeline(&casters, "distribute", &caster_layout),
            test: pipeline(&casters, "test", &caster_layout),
            size_dispatch: pipeline(&pieces, "size_dispatch", &piece_layout),
            list_layout,
            caster_layout,
            piece_layout,
        })
    }
}

impl ViewSampleMap {
    /// Builds the passes.
    ///
    /// # Errors
    /// A grid without buckets or with too many.
    pub fn new(gpu: &Gpu, config: &ViewSampleMapping) -> Result<Self, GpuError> {
        if !(1..=1024).contains(&config.buckets) {
            return Err(GpuError::Invalid {
                what: "buckets a side",
                value: config.buckets.to_string(),
                fix: "use 1 to 1024; the picture does not depend on it",
            });
        }
        let uniform = |label, size: usize| {
            gpu.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(label),
                size: size as u64,
                usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
                mapped_at_creation: false,
            })
        };
        Ok(Self {
            config: *config,
            passes: Passes::new(gpu)?,
            scan: Scan::new(gpu)?,
            fitter: Fitter::new(gpu),
            uniform: uniform("grid", size_of::<GridUniform>()),
            room: uniform("room", 16),
            lists: None,
            prepared: None,
            list_group: BindGroupCache::default(),
            caster_group: BindGroupCache::default(),
            piece_group: BindGroupCache::default(),
            counters: Counters::new(),
        })
    }

    /// The grid of the last prepared frame.
    #[must_use]
    pub fn grid(&self) -> Option<&Grid> {
        self.prepared.as_ref().map(|p| &p.grid)
    }

    fn side(&self, frame: &Frame<'_>) -> u32 {
        use antumbra_scene::Light::{Directional, Spot};
        match frame.light {
            Directional { .. } | Spot { .. } => self.config.buckets,
            _ => self.config.buckets.div_ceil(2),
        }
    }

    fn list_group(
        &mut self,
        gpu: &Gpu,
        frame: &Frame<'_>,
        lists: &Lists,
        visibility: &wgpu::TextureView,
    ) -> wgpu::BindGroup {
        let samples = frame.samples;
        let buffers = [&lists.buckets, &lists.places, &lists.listed, &lists.dark, &lists.state];
        let views = [&samples.positions_view, &samples.normals_view, visibility];
        let key = (buffers.map(Clone::clone), views.map(Clone::clone));
        let group = self.list_group.get(key, |(buffers, [positions, normals, output])| {
            let mut bound = vec![
                bind::buffer(0, &self.uniform),
                bind::texture(1, positions),
                bind::texture(2, normals),
                bind::texture(8, output),
            ];
            bound.extend((3..).zip(buffers).map(|(i, buffer)| bind::buffer(i, buffer)));
            gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("lists of view samples"),
                layout: &self.passes.list_layout,
                entries: &bound,
            })
        });
        group.clone()
    }

    fn caster_group(
        &mut self,
        gpu: &Gpu,
        triangles: &CasterTriangles<'_>,
        lists: &Lists,
    ) -> wgpu::BindGroup {
        let key = [
            triangles.positions,
            triangles.indices,
            &lists.blocks,
            &lists.buckets,
            &lists.pieces,
            &lists.listed,
            &lists.dark,
            &lists.state,
        ]
        .map(Clone::clone);
        let group = self.caster_group.get(key, |buffers| {
            let mut bound = vec![bind::buffer(0, &self.uniform)];
            bound.extend((1..).zip(buffers).map(|(i, buffer)| bind::buffer(i, buffer)));
            gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("casters over view samples"),
                layout: &self.passes.caster_layout,
                entries: &bound,
            })
        });
        group.clone()
    }

    fn piece_group(&mut self, gpu: &Gpu, lists: &Lists) -> wgpu::BindGroup {
        let key = [&lists.state, &lists.groups].map(Clone::clone);
        let group = self.piece_group.get(key, |[state, groups]| {
            gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("pieces"),
                layout: &self.passes.piece_layout,
                entries: &[
                    bind::buffer(0, state),
                    bind::buffer(1, groups),
                    bind::buffer(2, &self.room),
                ],
            })
        });
        group.clone()
    }
}

/// The casters' triangles.
fn triangles<'a>(frame: &Frame<'a>) -> Result<CasterTriangles<'a>, GpuError> {
    frame.casters.triangles().ok_or_else(|| GpuError::Invalid {
        what: "casters",
        value: "without triangles".to_owned(),
        fix: "implement `Casters::triangles`, or use `map/plain`, which needs depth alone",
    })
}

impl Technique for ViewSampleMap {
    fn prepare(&mut self, gpu: &Gpu, frame: &Frame<'_>) -> Result<(), GpuError> {
        self.prepared = None;
        check_light(frame.light)?;
        triangles(frame)?;
        let grid = self.fitter.fit(frame, self.side(frame))?;
        let (width, height) = frame.samples.size();
        let buckets = grid.side * grid.side * grid.faces.len() as u32;
        let blocks = self.fitter.blocks.len() as u32;
        let extent = Extent::new(gpu, width * height, buckets, blocks.max(1), BLOCK);
        let lists = match self.lists.take().filter(|lists| lists.extent.serves(&extent)) {
            Some(kept) => kept,
            None => Lists::new(gpu, extent)?,
        };
        self.scan.prepare(gpu, &lists.buckets, buckets + 1)?;
        let entries = blocks * BLOCK;
        let groups = entries.div_ceil(GROUP);
        let across = groups.min(gpu.device.limits().max_compute_workgroups_per_dimension);
        let groups = [across, if across == 0 { 0 } else { groups.div_ceil(across) }];
        let pieces = lists.extent.pieces;
        let uniform = GridUniform::new(&grid, (width, height), (entries, across * GROUP), pieces);
        gpu.queue.write_buffer(&self.uniform, 0, bytemuck::bytes_of(&uniform));
        gpu.queue.write_buffer(&self.room, 0, bytemuck::bytes_of(&[pieces, 0, 0, 0]));
        gpu.queue.write_buffer(&lists.blocks, 0, bytemuck::cast_slice(&self.fitter.blocks));
        self.lists = Some(lists);
        let casters = self.fitter.blocks.iter().map(|block| u64::from(block[1] % 64)).sum();
        self.prepared = Some(Prepared { grid, groups, casters });
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
        let (width, height) = frame.samples.size();
        let lists = self.lists.take().filter(|lists| lists.extent.pixels == width * height);
        let (Some(prepared), Some(lists)) = (self.prepared.take(), lists) else {
            return Err(GpuError::Invalid {
                what: "frame",
                value: "not prepared".to_owned(),
                fix: "call `prepare` with this frame before `encode`",
            });
        };
        let list_group = self.list_group(gpu, frame, &lists, visibility);
        let caster_group = self.caster_group(gpu, &triangles, &lists);
        let piece_group = self.piece_group(gpu, &lists);
        let passes = &self.passes;
        let [x, y] = prepared.groups;
        let any = x > 0;
        for buffer in [&lists.buckets, &lists.dark, &lists.state] {
            recorder.encoder.clear_buffer(buffer, 0, None);
        }
        let tiles = (width.div_ceil(8), height.div_ceil(8));
        let mut pass = recorder.compute_pass("sampling/lists");
        pass.set_bind_group(0, &list_group, &[]);
        pass.set_pipeline(&passes.count);
        pass.dispatch_workgroups(tiles.0, tiles.1, 1);
        if any {
            self.scan.encode(&mut pass);
            pass.set_bind_group(0, &list_group, &[]);
            pass.set_pipeline(&passes.scatter);
            pass.dispatch_workgroups(tiles.0, tiles.1, 1);
        }
        drop(pass);
        if any {
            let mut pass = recorder.compute_pass("sampling/distribute");
            pass.set_bind_group(0, &caster_group, &[]);
            pass.set_pipeline(&passes.distribute);
            pass.dispatch_workgroups(x, y, 1);
            pass.set_bind_group(0, &piece_group, &[]);
            pass.set_pipeline(&passes.size_dispatch);
            pass.dispatch_workgroups(1, 1, 1);
            drop(pass);
            let mut pass = recorder.compute_pass("sampling/test");
            pass.set_bind_group(0, &caster_group, &[]);
            pass.set_pipeline(&passes.test);
            pass.dispatch_workgroups_indirect(&lists.groups, 0);
        }
        let mut pass = recorder.compute_pass("sampling/resolve");
        pass.set_bind_group(0, &list_group, &[]);
        pass.set_pipeline(&passes.resolve);
        pass.dispatch_workgroups(tiles.0, tiles.1, 1);
        drop(pass);
        let faces = prepared.grid.faces.iter().flatten().count() as u64;
        self.counters = Counters::from([
            ("view_samples", u64::from(width) * u64::from(height)),
            ("buckets", faces * u64::from(prepared.grid.side).pow(2)),
            ("casters", prepared.casters),
        ]);
        (self.prepared, self.lists) = (Some(prepared), Some(lists));
        Ok(())
    }

    fn counters(&self) -> Counters {
        self.counters.clone()
    }

    fn read_counters(&self, gpu: &Gpu) -> Result<Counters, GpuError> {
        let mut counters = self.counters.clone();
        let (Some(lists), Some(prepared)) = (&self.lists, &self.prepared) else {
            return Ok(counters);
        };
        let words = |buffer: &wgpu::Buffer, count: u64| -> Result<Vec<u32>, GpuError> {
            Ok(bytemuck::pod_collect_to_vec(&read_buffer(gpu, buffer, 4 * count)?))
        };
        // Without casters there are no lists, and the buckets are not summed.
        let mut begins = vec![0];
        let mut pieces = Vec::new();
        let mut handed_out = 0;
        if prepared.groups[0] > 0 {
            begins = words(&lists.buckets, u64::from(lists.extent.buckets) + 1)?;
            handed_out = words(&lists.state, 1)?[0];
            let kept = handed_out.min(lists.extent.pieces);
            if kept > 0 {
                let size = size_of::<Piece>() as u64 * u64::from(kept);
                pieces = bytemuck::pod_collect_to_vec(&read_buffer(gpu, &lists.pieces, size)?);
            }
        }
        let lengths = || begins.windows(2).map(|pair| u64::from(pair[1] - pair[0]));
        let sum = |of: fn(&Piece) -> u32| pieces.iter().map(|p| u64::from(of(p))).sum();
        counters.extend([
            ("listed_samples", begins.last().map_or(0, |&all| all.into())),
            ("buckets_occupied", lengths().filter(|&n| n > 0).count() as u64),
            ("longest_list", lengths().max().unwrap_or(0)),
            ("pieces", handed_out.into()),
            ("triangle_buckets", sum(|p| p[2] >> 16)),
            ("tests", sum(|p| p[2] % (1 << 16))),
        ]);
        Ok(counters)
    }

    fn bytes(&self) -> u64 {
        let lists = self.lists.iter().flat_map(Lists::all).map(wgpu::Buffer::size).sum::<u64>();
        self.uniform.size() + self.room.size() + self.scan.bytes() + lists
    }
}

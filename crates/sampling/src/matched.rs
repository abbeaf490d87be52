//! Resolution-matched shadow maps: pages of a virtual map, as fine as the view asks for and no finer.

mod expectation;
mod passes;
mod room;
pub mod twin;
mod window;

use antumbra_gpu::{
    CasterTriangles, Counters, Expectation, Frame, Gpu, GpuError, Recorder, Technique,
    TechniqueConfig, check_light, read_buffer,
};
use antumbra_map::{
    DepthConvention, Estimator, FittedView, MapConfig, MapTechnique, SeenView, ShadowView,
};
use glam::{DMat4, DVec4};
use serde::{Deserialize, Serialize};

use crate::view_samples::{BLOCK, Fitter};
use passes::Passes;
use room::{Atlas, STATE_WORDS, Work};
pub use twin::{Page, Virtual};
pub use window::window;

/// Resolution-matched shadow maps (Lefohn, Sengupta, Owens 2007) for directional and spot lights: each view sample asks for
/// the page of a quadtree whose texels put edges where they belong to within a part of its pixel; only pages that are asked
/// for are drawn, and they are kept until light or casters move, wherever the camera goes. Other lights are served as by `map/plain`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ResolutionMatched {
    /// The atlas that holds the pages, `map.size` texels a side, default 2048; `map.bias`; and the map of other lights.
    /// Where the pages that are asked for do not fit, those of the finest levels become coarser, of as few levels as will
    /// do.
    pub map: MapConfig,
    /// Side of a page, texels: a power of two, 1 to 1024, default 64. It is made smaller where the atlas would be
    /// less than 16 pages wide, and larger where it would be more than 64. Small pages waste less of the atlas and
    /// cost more draws.
    pub page: u32,
    /// Pages a side of the finest level: a power of two, 1 to 1024, default 256. With `page` the resolution at which
    /// requests end: 16 384 texels across all casters by default. Memory: 16 bytes times its square.
    pub table: u32,
    /// Pixels by which a shadow's edge may be displaced: above 0, to 64, default 0.25. Of the samples 0.18 times as many are
    /// wrong, on average, for each pixel of edge a pixel: at 0.25 one in 200 where an edge crosses every ninth pixel. Half of
    /// it takes up to four times the pages, and leaves half of the error.
    pub displacement: f32,
}

impl Default for ResolutionMatched {
    fn default() -> Self {
        Self { map: MapConfig::default(), page: 64, table: 256, displacement: 0.25 }
    }
}

impl ResolutionMatched {
    /// The virtual map of these settings.
    ///
    /// # Errors
    /// A setting out of range.
    pub fn layout(&self) -> Result<Virtual, GpuError> {
        let invalid = |what, value: String, fix| Err(GpuError::Invalid { what, value, fix });
        if !(self.page.is_power_of_two() && self.page <= 1024) {
            let fix = "use a power of two from 1 to 1024";
            return invalid("side of a page", self.page.to_string(), fix);
        }
        if !(self.table.is_power_of_two() && self.table <= 1024) {
            let fix = "use a power of two from 1 to 1024";
            return invalid("pages a side", self.table.to_string(), fix);
        }
        if !(self.displacement > 0.0 && self.displacement <= 64.0) {
            let fix = "use more than 0 and at most 64 pixels; 0.5 keeps edges within their pixel";
            return invalid("displacement", self.displacement.to_string(), fix);
        }
        let size = self.map.size;
        let most = 1 << (size / 16).max(1).ilog2();
        let page = self.page.min(most).max(size.div_ceil(64).next_power_of_two());
        Ok(Virtual { page, table: self.table, row: size / page, rule: self.displacement })
    }
}

impl TechniqueConfig for ResolutionMatched {
    fn build(&self, gpu: &Gpu) -> Result<Box<dyn Technique>, GpuError> {
        Ok(Box::new(MatchedMap::new(gpu, self)?))
    }

    fn set_map_size(&mut self, size: u32) {
        self.map.size = size;
    }

    fn expectation(&self, case: &str) -> Option<Expectation> {
        expectation::matched(self, case)
    }
}

/// The technique of [`ResolutionMatched`].
#[derive(Debug)]
pub struct MatchedMap {
    config: ResolutionMatched,
    map: Virtual,
    /// Serves other lights, and frames without casters.
    around: MapTechnique,
    passes: Passes,
    fitter: Fitter,
    setup: wgpu::Buffer,
    atlas: Option<Atlas>,
    work: Option<Work>,
    /// The window that the pages belong to, and its number.
    window: Option<ShadowView>,
    fit: u32,
    /// Pairs of page and triangle at most.
    room: u32,
    prepared: Option<Prepared>,
    served: bool,
    counters: Counters,
}

/// What `prepare` leaves for `encode`.
#[derive(Clone, Copy, Debug)]
enum Prepared {
    /// Other lights, and frames without casters.
    Around,
    /// Workgroups over the places for casters, and the casters.
    Pages { groups: [u32; 2], casters: u64 },
}

/// Invocations of a workgroup over casters.
const GROUP: u32 = 64;

/// The twin of `Setup` in `sampling/matched.wesl`.
#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
struct SetupUniform {
    view: ShadowView,
    camera: [[f32; 4]; 4],
    pixels: [u32; 4],
    pages: [u32; 4],
    atlas: [u32; 4],
    rule: [f32; 4],
}

impl MatchedMap {
    /// Builds the passes.
    ///
    /// # Errors
    /// A setting out of range, or an atlas beyond the device's limits.
    pub fn new(gpu: &Gpu, config: &ResolutionMatched) -> Result<Self, GpuError> {
        // It checks the size and the bias.
        let around = MapTechnique::plain(gpu, &config.map)?;
        Ok(Self {
            config: *config,
            map: config.layout()?,
            around,
            passes: Passes::new(gpu)?,
            fitter: Fitter::new(gpu),
            setup: gpu.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("setup of pages"),
                size: size_of::<SetupUniform>() as u64,
                usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
                mapped_at_creation: false,
            }),
            atlas: None,
            work: None,
            window: None,
            fit: 0,
            room: u32::MAX,
            prepared: None,
            served: false,
            counters: Counters::new(),
        })
    }

    /// The same with room for at most so many pairs of page and triangle, 1 or more, as on a device with small buffers:
    /// for tests. Pages whose lists have no room are drawn from all casters.
    #[must_use]
    pub fn with_room(self, pairs: u32) -> Self {
        Self { room: pairs.max(1), ..self }
    }

    /// The pages that the view samples of the last encoded frame asked for, before any became coarser. Waits: for tests.
    ///
    /// # Errors
    /// A lost device.
    pub fn read_requests(&self, gpu: &Gpu) -> Result<Vec<Page>, GpuError> {
        let Some(atlas) = self.atlas.as_ref().filter(|_| self.served) else {
            return Ok(Vec::new());
        };
        let bytes = read_buffer(gpu, &atlas.marks, atlas.marks.size())?;
        let marks: Vec<u32> = bytemuck::pod_collect_to_vec(&bytes);
        let asked = (0..).zip(marks).filter(|(_, mark)| mark & 1 != 0);
        Ok(asked.map(|(index, _)| self.map.page_at(index)).collect())
    }

    /// The window of the frame, and the light's direction or place; the casters are listed.
    fn fit(&mut self, frame: &Frame<'_>) -> Option<(DMat4, DVec4)> {
        let hull = self.fitter.hull(frame);
        let view = window(frame.light, hull, frame.origin, self.map.texels())?;
        let FittedView { clip: Some(clip), light } = view else { return None };
        // Whatever the camera sees: pages are to last until it sees something else.
        self.fitter.list(frame, &[SeenView { view, volume: Vec::new(), ends: None }]);
        Some((clip, light))
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

fn unprepared() -> GpuError {
    GpuError::Invalid {
        what: "frame",
        value: "not prepared".to_owned(),
        fix: "call `prepare` with this frame before `encode`",
    }
}

impl Technique for MatchedMap {
    fn prepare(&mut self, gpu: &Gpu, frame: &Frame<'_>) -> Result<(), GpuError> {
        self.prepared = None;
        check_light(frame.light)?;
        let Some((clip, light)) = self.fit(frame) else {
            self.around.prepare(gpu, frame)?;
            self.prepared = Some(Prepared::Around);
            return Ok(());
        };
        triangles(frame)?;
        let map = self.map;
        if self.atlas.is_none() {
            self.atlas = Some(Atlas::new(gpu, &map, &self.passes.slot_layout)?);
        }
        let (width, height) = frame.samples.size();
        let blocks = self.fitter.blocks.len() as u32;
        let work = match self.work.take().filter(|work| work.serves(width * height, blocks)) {
            Some(work) => work,
            None => Work::new(gpu, width * height, blocks, BLOCK)?,
        };
        let bias = &self.config.map.bias;
        let view = ShadowView::new(
            &clip,
            light,
            0,
            DepthConvention::REVERSED_F32,
            bias,
            &Estimator::nearest(),
        );
        // Pages of another window are others.
        if self.window.replace(view) != Some(view) {
            self.fit = self.fit.wrapping_add(1);
        }
        let entries = blocks * BLOCK;
        let groups = entries.div_ceil(GROUP);
        let across = groups.min(gpu.device.limits().max_compute_workgroups_per_dimension);
        let groups = [across, if across == 0 { 0 } else { groups.div_ceil(across) }];
        let camera = frame.camera.map(|camera| camera.clip.as_mat4().to_cols_array_2d());
        let setup = SetupUniform {
            view,
            camera: camera.unwrap_or_default(),
            pixels: [width, height, camera.is_some().into(), across * GROUP],
            pages: [map.page, map.table, map.levels(), map.slots()],
            atlas: [map.row, work.pairs_room.min(self.room), self.fit, entries],
            rule: [map.rule, 0.0, 0.0, 0.0],
        };
        gpu.queue.write_buffer(&self.setup, 0, bytemuck::bytes_of(&setup));
        gpu.queue.write_buffer(&work.blocks, 0, bytemuck::cast_slice(&self.fitter.blocks));
        self.work = Some(work);
        let casters = self.fitter.blocks.iter().map(|block| u64::from(block[1] % 64)).sum();
        self.prepared = Some(Prepared::Pages { groups, casters });
        Ok(())
    }

    fn encode(
        &mut self,
        gpu: &Gpu,
        frame: &Frame<'_>,
        recorder: &mut Recorder<'_>,
        visibility: &wgpu::TextureView,
    ) -> Result<(), GpuError> {
        let (groups, casters) = match self.prepared {
            None => return Err(unprepared()),
            Some(Prepared::Around) => {
                self.around.encode(gpu, frame, recorder, visibility)?;
                self.counters = self.around.counters();
                self.served = false;
                return Ok(());
            }
            Some(Prepared::Pages { groups, casters }) => (groups, casters),
        };
        let triangles = triangles(frame)?;
        let (width, height) = frame.samples.size();
        let (Some(atlas), Some(work)) = (&self.atlas, &self.work) else {
            return Err(unprepared());
        };
        if !work.serves(width * height, 0) {
            return Err(unprepared());
        }
        let (map, samples, passes) = (self.map, frame.samples, &mut self.passes);
        let (positions, normals) = (&samples.positions_view, &samples.normals_view);
        let setup = &self.setup;
        let requests = passes.requests.of(
            gpu,
            [
                setup.into(),
                positions.into(),
                normals.into(),
                (&atlas.marks).into(),
                (&work.requests).into(),
            ],
        );
        let pages = passes.pages.of(
            gpu,
            [
                setup.into(),
                (&atlas.marks).into(),
                (&atlas.held).into(),
                (&atlas.slots).into(),
                (&atlas.state).into(),
                (&atlas.draws).into(),
                (&atlas.wanted).into(),
            ],
        );
        let on_pages = passes.casters.of(
            gpu,
            [
                setup.into(),
                (&atlas.marks).into(),
                (&atlas.held).into(),
                (&atlas.slots).into(),
                (&work.blocks).into(),
                triangles.positions.into(),
                triangles.indices.into(),
                (&work.pairs).into(),
            ],
        );
        let drawing = passes.drawing.of(
            gpu,
            [
                setup.into(),
                (&atlas.slots).into(),
                (&work.pairs).into(),
                (&work.blocks).into(),
                triangles.positions.into(),
                triangles.indices.into(),
            ],
        );
        let lookups = passes.lookups.of(
            gpu,
            [
                setup.into(),
                positions.into(),
                normals.into(),
                visibility.into(),
                (&work.requests).into(),
                (&atlas.held).into(),
                (&atlas.state).into(),
                (&atlas.depth).into(),
            ],
        );
        recorder.encoder.clear_buffer(&atlas.marks, 0, None);
        recorder.encoder.clear_buffer(&atlas.state, 0, None);
        let mut pass = recorder.compute_pass("sampling/requests");
        pass.set_bind_group(0, &requests, &[]);
        pass.set_pipeline(&passes.request);
        pass.dispatch_workgroups(width.div_ceil(8), height.div_ceil(8), 1);
        pass.set_bind_group(0, &pages, &[]);
        pass.set_pipeline(&passes.coarsen);
        pass.dispatch_workgroups(map.page_count().div_ceil(64), 1, 1);
        pass.set_pipeline(&passes.assign);
        pass.dispatch_workgroups(1, 1, 1);
        drop(pass);
        let mut pass = recorder.compute_pass("sampling/casters");
        pass.set_bind_group(0, &on_pages, &[]);
        pass.set_pipeline(&passes.count);
        pass.dispatch_workgroups(groups[0], groups[1], 1);
        pass.set_bind_group(0, &pages, &[]);
        pass.set_pipeline(&passes.plan);
        pass.dispatch_workgroups(1, 1, 1);
        pass.set_bind_group(0, &on_pages, &[]);
        pass.set_pipeline(&passes.list);
        pass.dispatch_workgroups(groups[0], groups[1], 1);
        drop(pass);
        let mut pass = recorder.render_pass(
            "sampling/pages",
            &[],
            Some(wgpu::RenderPassDepthStencilAttachment {
                view: &atlas.depth,
                depth_ops: Some(wgpu::Operations {
                    load: wgpu::LoadOp::Load,
                    store: wgpu::StoreOp::Store,
                }),
                stencil_ops: None,
            }),
        );
        pass.set_bind_group(0, &drawing, &[]);
        pass.set_bind_group(1, &atlas.number, &[0]);
        pass.set_pipeline(&passes.wipe);
        pass.draw(0..6 * map.slots(), 0..1);
        pass.set_pipeline(&passes.draw);
        for slot in 0..map.slots() {
            let [x, y] = [slot % map.row, slot / map.row].map(|i| i * map.page);
            pass.set_viewport(x as f32, y as f32, map.page as f32, map.page as f32, 0.0, 1.0);
            pass.set_scissor_rect(x, y, map.page, map.page);
            pass.set_bind_group(1, &atlas.number, &[slot * atlas.stride]);
            pass.draw_indirect(&atlas.draws, 16 * u64::from(slot));
        }
        drop(pass);
        let mut pass = recorder.compute_pass("sampling/resolve");
        pass.set_bind_group(0, &lookups, &[]);
        pass.set_pipeline(&passes.resolve);
        pass.dispatch_workgroups(width.div_ceil(8), height.div_ceil(8), 1);
        drop(pass);
        let samples = u64::from(width) * u64::from(height);
        self.served = true;
        self.counters = Counters::from([
            ("map_passes", 1),
            ("map_draws", 1 + u64::from(map.slots())),
            ("map_triangles", casters),
            ("view_samples", samples),
            ("fetches", samples),
        ]);
        Ok(())
    }

    fn counters(&self) -> Counters {
        self.counters.clone()
    }

    fn read_counters(&self, gpu: &Gpu) -> Result<Counters, GpuError> {
        let mut counters = self.counters.clone();
        let Some(atlas) = self.atlas.as_ref().filter(|_| self.served) else {
            return Ok(counters);
        };
        let state: Vec<u32> =
            bytemuck::pod_collect_to_vec(&read_buffer(gpu, &atlas.state, 4 * STATE_WORDS)?);
        let finest = state[16];
        counters.extend([
            // As many as view samples ask for, before any became coarser.
            ("pages_requested", state[0].into()),
            ("pages_in_use", state[finest as usize].into()),
            ("pages_clamped", state[17].into()),
            ("pages_rendered", state[18].into()),
            ("pages_reused", state[19].into()),
            ("levels_clamped", finest.into()),
            ("page_triangles", state[20].into()),
            ("pages_without_list", state[21].into()),
        ]);
        Ok(counters)
    }

    fn bytes(&self) -> u64 {
        self.setup.size()
            + self.around.bytes()
            + self.atlas.as_ref().map_or(0, Atlas::bytes)
            + self.work.as_ref().map_or(0, Work::bytes)
    }
}

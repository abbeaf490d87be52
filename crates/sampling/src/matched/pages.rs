//! The passes of a frame: from requests to pages drawn.

use antumbra_gpu::{CasterTriangles, Counters, Frame, Gate, Gpu, GpuError, Recorder, read_buffer};
use antumbra_map::{Refit, Resolve, ShadowMap};

use super::passes::Passes;
use super::room::{Atlas, Work};
use super::{Limits, Page, ResolutionMatched, Virtual};

/// The pages of a virtual shadow map: which are asked for, where they lie in the atlas, and what is drawn of them.
#[derive(Debug)]
pub struct MatchedPages {
    settings: ResolutionMatched<()>,
    limits: Limits,
    faces: u32,
    passes: Passes,
    setup: wgpu::Buffer,
    /// What the lookup binds where there is no page.
    nothing: wgpu::Buffer,
    /// Blocks of casters: first triangle, and number of triangles + 64 times the face.
    blocks: Vec<[u32; 2]>,
    kept: Option<(Virtual, Atlas)>,
    work: Option<Work>,
    /// The windows that the pages belong to, and their number.
    windows: [[[f32; 4]; 4]; FACES],
    fit: u32,
    prepared: Option<Prepared>,
    counters: Counters,
}

/// A page that view samples ask for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Request {
    /// The page.
    pub page: Page,
    /// Samples that ask for it.
    pub samples: u32,
    /// Whether casters lie on it: else it needs no memory.
    pub occupied: bool,
}

/// What `prepare` leaves for `encode`.
#[derive(Clone, Copy, Debug)]
struct Prepared {
    pixels: (u32, u32),
    /// Workgroups over the places for casters.
    groups: [u32; 2],
}

/// Most faces of a light.
const FACES: usize = 6;
/// Triangles of a block of casters; `sampling/matched.wesl` knows it too.
const BLOCK: u32 = 32;
/// Invocations of a workgroup over casters, and over pages.
const GROUP: u32 = 64;
const PAGES_GROUP: u32 = 256;
/// The marks of these names in `sampling/matched.wesl`.
const OCCUPIED: u32 = 4;
const IN_USE: u32 = 8;

/// The word of the state of that name there.
const ANY_DRAWN: u64 = 10;

/// The twin of `Setup` in `sampling/matched.wesl`.
#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
struct SetupUniform {
    camera: [[f32; 4]; 4],
    faces: [[[f32; 4]; 4]; FACES],
    pixels: [u32; 4],
    shape: [u32; 4],
    page: [u32; 4],
    atlas: [u32; 4],
    rule: [f32; 4],
}

impl MatchedPages {
    /// `select` is the module that names a point's face, of so many.
    pub(super) fn new(
        gpu: &Gpu,
        settings: ResolutionMatched<()>,
        limits: Limits,
        (select, faces): (&'static str, u32),
    ) -> Result<Self, GpuError> {
        let buffer = |label, size, usage| {
            gpu.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(label),
                size,
                usage: usage | wgpu::BufferUsages::COPY_DST,
                mapped_at_creation: false,
            })
        };
        let size = size_of::<SetupUniform>() as u64;
        Ok(Self {
            settings,
            limits,
            faces,
            passes: Passes::new(gpu, select)?,
            setup: buffer("setup of pages", size, wgpu::BufferUsages::UNIFORM),
            nothing: buffer("no pages", 16, wgpu::BufferUsages::STORAGE),
            blocks: Vec::new(),
            kept: None,
            work: None,
            windows: Default::default(),
            fit: 0,
            prepared: None,
            counters: Counters::new(),
        })
    }

    /// The virtual map of the last frame with casters, if there was one.
    #[must_use]
    pub fn layout(&self) -> Option<&Virtual> {
        self.kept.as_ref().map(|(map, _)| map)
    }

    /// What the view samples of the last encoded frame asked for, before any became coarser. Waits: for tests.
    ///
    /// # Errors
    /// A lost device.
    pub fn read_requests(&self, gpu: &Gpu) -> Result<Vec<Request>, GpuError> {
        let Some((map, atlas)) = self.kept.as_ref().filter(|_| self.prepared.is_some()) else {
            return Ok(Vec::new());
        };
        let (marks, asked) = (read(gpu, &atlas.marks)?, read(gpu, &atlas.asked)?);
        let asked = (0..).zip(marks.into_iter().zip(asked)).filter(|(_, (_, n))| *n > 0);
        let request = |(index, (mark, samples))| {
            let page = map.page_at(index);
            Request { page, samples, occupied: mark & OCCUPIED != 0 }
        };
        Ok(asked.map(request).collect())
    }

    /// Of each pixel of the last encoded frame the page that is looked up, where it takes one. Waits: for tests.
    ///
    /// # Errors
    /// A lost device.
    pub fn read_lookups(&self, gpu: &Gpu) -> Result<Vec<Option<Page>>, GpuError> {
        let (Some((map, atlas)), Some(work), Some(_)) = (&self.kept, &self.work, self.prepared)
        else {
            return Ok(Vec::new());
        };
        let (marks, requests) = (read(gpu, &atlas.marks)?, read(gpu, &work.requests)?);
        let mark = |page| marks[map.index_of(page) as usize];
        let lookup = |request| {
            let page = Page::from_id(request).filter(|page| mark(*page) & OCCUPIED != 0)?;
            let mut holders = (page.level..map.levels()).map(|level| map.holder(page, level));
            holders.find(|holder| mark(*holder) & IN_USE != 0)
        };
        Ok(requests.into_iter().map(lookup).collect())
    }

    /// Takes note of the casters that lie in a face's window, wherever the camera is.
    fn list_casters(&mut self, frame: &Frame<'_>, map: &ShadowMap) {
        self.blocks.clear();
        let blocks = &mut self.blocks;
        let with_casters = map.views().iter().enumerate().filter(|(_, v)| v.clip.is_some());
        for ((face, _), view) in with_casters.zip(map.light_views(frame)) {
            frame.casters.ranges(&view, &mut |range| {
                let firsts = range.clone().step_by(BLOCK as usize);
                let end = range.end;
                blocks.extend(
                    firsts.map(|first| [first, (end - first).min(BLOCK) + 64 * face as u32]),
                );
            });
        }
    }
}

/// The words of a buffer.
fn read(gpu: &Gpu, buffer: &wgpu::Buffer) -> Result<Vec<u32>, GpuError> {
    Ok(bytemuck::pod_collect_to_vec(&read_buffer(gpu, buffer, buffer.size())?))
}

/// The casters' triangles.
fn triangles<'a>(frame: &Frame<'a>) -> Result<CasterTriangles<'a>, GpuError> {
    frame.casters.triangles().ok_or_else(|| GpuError::Invalid {
        what: "casters",
        value: "without triangles".to_owned(),
        fix: "implement `Casters::triangles`, or use `map/plain`, which needs depth alone",
    })
}

impl Refit for MatchedPages {
    fn prepare(&mut self, gpu: &Gpu, frame: &Frame<'_>, map: &ShadowMap) -> Result<(), GpuError> {
        self.prepared = None;
        if map.views().iter().all(|view| view.clip.is_none()) {
            let none = <SetupUniform as bytemuck::Zeroable>::zeroed();
            gpu.queue.write_buffer(&self.setup, 0, bytemuck::bytes_of(&none));
            let nothing = &self.nothing;
            let bound = [&self.setup, nothing, nothing, nothing];
            self.passes.lookups.of(gpu, bound.map(Into::into));
            return Ok(());
        }
        triangles(frame)?;
        let pages = self.settings.layout(map.size(), map.guard().min(self.limits.border))?;
        if self.kept.as_ref().is_none_or(|(kept, _)| *kept != pages) {
            let atlas = Atlas::new(gpu, &pages, self.faces, &self.passes.slot_layout)?;
            self.kept = Some((pages, atlas));
        }
        self.list_casters(frame, map);
        let (width, height) = frame.samples.size();
        let blocks = self.blocks.len() as u32;
        let work = match self.work.take().filter(|work| work.serves(width * height, blocks)) {
            Some(work) => work,
            None => Work::new(gpu, width * height, blocks, BLOCK)?,
        };
        let mut windows: [[[f32; 4]; 4]; FACES] = Default::default();
        for (window, view) in windows.iter_mut().zip(map.views()) {
            *window = view.clip.unwrap_or_default().as_mat4().to_cols_array_2d();
        }
        // Pages of other windows are others.
        if std::mem::replace(&mut self.windows, windows) != windows {
            self.fit = self.fit.wrapping_add(1);
        }
        let entries = blocks * BLOCK;
        let groups = entries.div_ceil(GROUP);
        let across = groups.min(gpu.device.limits().max_compute_workgroups_per_dimension);
        let groups = [across, if across == 0 { 0 } else { groups.div_ceil(across) }];
        let camera = frame.camera.map(|camera| camera.clip.as_mat4().to_cols_array_2d());
        let setup = SetupUniform {
            camera: camera.unwrap_or_default(),
            faces: windows,
            pixels: [width, height, camera.is_some().into(), across * GROUP],
            shape: [pages.table, pages.page_count(), pages.levels(), self.faces],
            page: [pages.page, pages.border, pages.side(), pages.slots()],
            atlas: [pages.row, work.pairs_room.min(self.limits.pairs), self.fit, entries],
            rule: [pages.rule, 0.0, 0.0, 0.0],
        };
        gpu.queue.write_buffer(&self.setup, 0, bytemuck::bytes_of(&setup));
        gpu.queue.write_buffer(&work.blocks, 0, bytemuck::cast_slice(&self.blocks));
        if let Some((_, atlas)) = &self.kept {
            let bound = [&self.setup, &work.requests, &atlas.held, &atlas.marks];
            self.passes.lookups.of(gpu, bound.map(Into::into));
        }
        self.work = Some(work);
        self.prepared = Some(Prepared { pixels: (width, height), groups });
        Ok(())
    }

    fn group_layout(&self) -> Option<&wgpu::BindGroupLayout> {
        Some(&self.passes.lookups.layout)
    }

    fn group(&self) -> Option<&wgpu::BindGroup> {
        self.passes.lookups.kept()
    }

    fn encode(
        &mut self,
        gpu: &Gpu,
        frame: &Frame<'_>,
        map: &ShadowMap,
        resolve: &Resolve,
        recorder: &mut Recorder<'_>,
    ) {
        self.counters = ["map_passes", "map_draws", "map_triangles"].map(|name| (name, 0)).into();
        let (Some(prepared), Some((pages, atlas)), Some(work), Some(triangles), Some(depth)) = (
            self.prepared.filter(|prepared| prepared.pixels == frame.samples.size()),
            &self.kept,
            &self.work,
            frame.casters.triangles(),
            map.layer_views().first(),
        ) else {
            return;
        };
        let (passes, samples, setup) = (&mut self.passes, frame.samples, &self.setup);
        let requests = passes.requests.of(
            gpu,
            [
                setup.into(),
                (&samples.positions_view).into(),
                (&samples.normals_view).into(),
                (&atlas.marks).into(),
                (&work.requests).into(),
                (&atlas.asked).into(),
                (&atlas.wanted).into(),
                (&atlas.state).into(),
            ],
        );
        let views = passes.views.of(gpu, [resolve.views().into()]);
        let of_pages = [
            setup,
            &atlas.marks,
            &atlas.held,
            &atlas.slots,
            &atlas.state,
            &atlas.draws,
            &atlas.wanted,
            &atlas.asked,
            &atlas.within,
        ];
        let on_pages = passes.pages.of(gpu, of_pages.map(Into::into));
        let of_casters = [
            setup,
            &atlas.marks,
            &atlas.held,
            &atlas.slots,
            &work.blocks,
            triangles.positions,
            triangles.indices,
            &work.pairs,
        ];
        let of_casters = passes.casters.of(gpu, of_casters.map(Into::into));
        let of_drawing = [
            setup,
            &atlas.slots,
            &work.pairs,
            &work.blocks,
            triangles.positions,
            triangles.indices,
        ];
        let of_drawing = passes.drawing.of(gpu, of_drawing.map(Into::into));
        for of_frame in [&atlas.marks, &atlas.asked, &atlas.within, &atlas.state] {
            recorder.encoder.clear_buffer(of_frame, 0, None);
        }
        let (width, height) = prepared.pixels;
        let mut pass = recorder.compute_pass("sampling/requests");
        pass.set_bind_group(0, &requests, &[]);
        pass.set_bind_group(1, &views, &[]);
        pass.set_pipeline(&passes.request);
        pass.dispatch_workgroups(width.div_ceil(8), height.div_ceil(8), 1);
        let [x, y] = prepared.groups;
        pass.set_bind_group(0, &of_casters, &[]);
        pass.set_pipeline(&passes.occupy);
        pass.dispatch_workgroups(x, y, 1);
        pass.set_bind_group(0, &on_pages, &[]);
        let groups = (pages.page_count() * self.faces).div_ceil(PAGES_GROUP);
        pass.set_pipeline(&passes.gather);
        pass.dispatch_workgroups(groups, 1, 1);
        pass.set_pipeline(&passes.weigh);
        pass.dispatch_workgroups(groups, 1, 1);
        pass.set_pipeline(&passes.assign);
        pass.dispatch_workgroups(1, 1, 1);
        drop(pass);
        let mut pass = recorder.compute_pass("sampling/casters");
        pass.set_bind_group(0, &of_casters, &[]);
        pass.set_pipeline(&passes.count);
        pass.dispatch_workgroups(x, y, 1);
        pass.set_bind_group(0, &on_pages, &[]);
        pass.set_pipeline(&passes.plan);
        pass.dispatch_workgroups(1, 1, 1);
        pass.set_bind_group(0, &of_casters, &[]);
        pass.set_pipeline(&passes.list);
        pass.dispatch_workgroups(x, y, 1);
        drop(pass);
        let mut pass = recorder.render_pass(
            "sampling/pages",
            &[],
            Some(wgpu::RenderPassDepthStencilAttachment {
                view: depth,
                depth_ops: Some(wgpu::Operations {
                    load: wgpu::LoadOp::Load,
                    store: wgpu::StoreOp::Store,
                }),
                stencil_ops: None,
            }),
        );
        let all = (pages.row * pages.page) as f32;
        pass.set_viewport(0.0, 0.0, all, all, 0.0, 1.0);
        pass.set_bind_group(0, &of_drawing, &[]);
        pass.set_bind_group(1, &atlas.number, &[0]);
        pass.set_pipeline(&passes.wipe);
        pass.draw(0..6 * pages.slots(), 0..1);
        pass.set_pipeline(&passes.draw);
        // Twice as wide as what the page shows, about its middle; see `Virtual::crop`.
        let wide = 2.0 * pages.side() as f32;
        let before = pages.border as f32 - 0.5 * pages.side() as f32;
        for slot in 0..pages.slots() {
            let [x, y] = [slot % pages.row, slot / pages.row].map(|i| i * pages.page);
            pass.set_viewport(x as f32 + before, y as f32 + before, wide, wide, 0.0, 1.0);
            pass.set_scissor_rect(x, y, pages.page, pages.page);
            pass.set_bind_group(1, &atlas.number, &[slot * atlas.stride]);
            pass.draw_indirect(&atlas.draws, 16 * u64::from(slot));
        }
        drop(pass);
        let casters = self.blocks.iter().map(|block| u64::from(block[1] % 64)).sum();
        self.counters = Counters::from([
            ("map_passes", 1),
            ("map_draws", 1 + u64::from(pages.slots())),
            ("map_triangles", casters),
        ]);
    }

    fn drawn(&self) -> Option<Gate> {
        let (_, atlas) = self.kept.as_ref().filter(|_| self.prepared.is_some())?;
        Some(Gate { buffer: atlas.state.clone(), offset: 4 * ANY_DRAWN })
    }

    fn counters(&self) -> Counters {
        self.counters.clone()
    }

    fn read_counters(&self, gpu: &Gpu) -> Result<Counters, GpuError> {
        let mut counters = self.counters.clone();
        let Some((_, atlas)) = self.kept.as_ref().filter(|_| self.prepared.is_some()) else {
            return Ok(counters);
        };
        let state = read(gpu, &atlas.state)?;
        let names = [
            // As many as view samples ask for, before any became coarser.
            "pages_requested",
            "pages_empty",
            "pages_in_use",
            "pages_clamped",
            "samples_clamped",
            "pages_rendered",
            "pages_reused",
            "pages_without_list",
            "page_triangles",
            "page_rank",
        ];
        counters.extend(names.into_iter().zip(state.into_iter().map(u64::from)));
        Ok(counters)
    }

    fn bytes(&self) -> u64 {
        self.setup.size()
            + self.nothing.size()
            + self.kept.as_ref().map_or(0, |(_, atlas)| atlas.bytes())
            + self.work.as_ref().map_or(0, Work::bytes)
    }
}

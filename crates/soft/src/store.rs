//! What soft shadows read beside the map: the light, and a pyramid of depths.

use antumbra_gpu::{
    BindGroupCache, Counters, Frame, Gpu, GpuError, LayerJob, Recorder, Sat, bind, entries,
    read_buffer,
};
use antumbra_map::{ShadowMap, Store};
use antumbra_scene::Light;
use antumbra_shaders::module;

use crate::facing::{axes, half_sides};
use crate::twin::View;
use crate::window::Window;

const CS: wgpu::ShaderStages = wgpu::ShaderStages::COMPUTE;

/// Most views of a layout that have a layer: a cube's, or those of cascades.
pub(crate) const VIEWS: usize = 8;

/// `AreaView` of `soft/area.wesl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, bytemuck::Pod, bytemuck::Zeroable)]
struct AreaView {
    x: [f32; 4],
    y: [f32; 4],
    z: [f32; 4],
    u: [f32; 4],
    v: [f32; 4],
    depth: [f32; 4],
    centre: [f32; 4],
}

/// `AreaLight` of `soft/area.wesl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, bytemuck::Pod, bytemuck::Zeroable)]
pub(crate) struct AreaLight {
    axes: [[f32; 4]; 3],
    u: [f32; 4],
    v: [f32; 4],
    views: [AreaView; VIEWS],
}

/// The shapes of `soft/area.wesl`, and a sphere's radius.
fn shape(light: &Light) -> (f32, f32) {
    match *light {
        _ if light.is_hard() => (0.0, 0.0),
        Light::Rect { .. } => (1.0, 0.0),
        Light::Sphere { radius, .. } => (3.0, radius as f32),
        _ => (2.0, 0.0),
    }
}

impl AreaView {
    fn new(view: &View, light: &Light) -> Self {
        let with = |v: glam::DVec3, w: f64| v.extend(w).as_vec4().to_array();
        let (kind, radius) = shape(light);
        Self {
            x: with(view.x, view.texels.x),
            y: with(view.y, view.texels.y),
            z: with(view.z, if view.perspective { 1.0 } else { 0.0 }),
            u: with(view.u, f64::from(kind)),
            v: with(view.v, f64::from(radius)),
            depth: [view.a as f32, view.b as f32, view.nearest as f32, 0.0],
            centre: [view.centre.x as f32, view.centre.y as f32, 0.0, 0.0],
        }
    }
}

impl AreaLight {
    pub(crate) fn new(light: &Light, map: &ShadowMap) -> Self {
        let mut all: Self = bytemuck::Zeroable::zeroed();
        if light.is_hard() {
            return all;
        }
        let with = |v: glam::DVec3, w: f32| v.as_vec3().extend(w).to_array();
        let (kind, radius) = shape(light);
        let [u, v] = half_sides(light);
        all.axes = axes(light).map(|axis| with(axis, 0.0));
        (all.u, all.v) = (with(u, kind), with(v, radius));
        let clips = map.views().iter().filter_map(|view| view.clip);
        for (to, clip) in all.views.iter_mut().zip(clips) {
            *to = AreaView::new(&View::new(&clip, f64::from(map.size()), light), light);
        }
        all
    }
}

/// What the bind group holds that may change: the pyramid and the table.
type Bound = [Option<wgpu::TextureView>; 2];

/// The light and its views, the pyramid, the tally, and a table of sums, in bind group 2.
#[derive(Debug)]
pub(crate) struct AreaStore {
    window: Window,
    layout: wgpu::BindGroupLayout,
    light: wgpu::Buffer,
    tally: wgpu::Buffer,
    pyramid: Pyramid,
    table: Option<Table>,
    group: BindGroupCache<Bound>,
    map: Option<wgpu::TextureView>,
    is_hard: bool,
}

/// A summed-area table of the map's linear depth.
#[derive(Debug)]
struct Table {
    sat: Sat,
    jobs: Vec<LayerJob>,
    /// In its place where there is no map.
    nothing: wgpu::TextureView,
}

impl Table {
    fn new(gpu: &Gpu, sat: Sat) -> Result<Self, GpuError> {
        let texture = gpu.create_texture(
            "no table",
            &wgpu::TextureDescriptor {
                label: Some("no table"),
                size: wgpu::Extent3d { width: 1, height: 1, depth_or_array_layers: 1 },
                mip_level_count: 1,
                sample_count: 1,
                dimension: wgpu::TextureDimension::D2,
                format: wgpu::TextureFormat::Rg32Uint,
                usage: wgpu::TextureUsages::TEXTURE_BINDING,
                view_formats: &[],
            },
        )?;
        let nothing = texture.create_view(&wgpu::TextureViewDescriptor {
            dimension: Some(wgpu::TextureViewDimension::D2Array),
            ..Default::default()
        });
        Ok(Self { sat, jobs: Vec::new(), nothing })
    }

    fn prepare(&mut self, gpu: &Gpu, map: &ShadowMap, is_hard: bool) -> Result<(), GpuError> {
        self.jobs.clear();
        let Some(view) = map.view().filter(|_| !is_hard) else { return Ok(()) };
        self.jobs.extend(map.linear_depths().iter().enumerate().map(|(layer, linear)| LayerJob {
            source: layer as u32,
            // All that is drawn is kept where it is.
            parameters: [linear.coefficients.map(|c| c as f32), [0.0, 0.0, 0.0, 1.0]],
        }));
        self.sat.prepare(gpu, view, map.size(), &self.jobs)
    }

    fn view(&self) -> &wgpu::TextureView {
        self.sat.view().unwrap_or(&self.nothing)
    }

    fn texels(&self) -> u64 {
        if self.jobs.is_empty() { 0 } else { self.sat.texels() }
    }
}

impl AreaStore {
    pub(crate) fn new(gpu: &Gpu, window: &Window) -> Result<Self, GpuError> {
        Self::with_table(gpu, window, None)
    }

    /// With a table of integers of two channels of the map's linear depth, for binding 3.
    pub(crate) fn with_table(
        gpu: &Gpu,
        window: &Window,
        table: Option<Sat>,
    ) -> Result<Self, GpuError> {
        window.validate()?;
        let mut all = vec![entries::storage(0, CS)];
        if window.hierarchy {
            all.push(entries::texels(1, CS, true));
        }
        if window.tally {
            all.push(entries::write_storage(2, CS));
        }
        if table.is_some() {
            all.push(entries::unsigned_array(3, CS));
        }
        let layout = gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("area light"),
            entries: &all,
        });
        let zeros = [0u8; size_of::<AreaLight>()];
        let usage = wgpu::BufferUsages::STORAGE;
        Ok(Self {
            window: *window,
            layout,
            light: gpu.buffer("area light", &zeros, usage),
            tally: gpu.buffer("tally", &[0; 16], usage | wgpu::BufferUsages::COPY_SRC),
            pyramid: Pyramid::new(gpu)?,
            table: table.map(|sat| Table::new(gpu, sat)).transpose()?,
            group: BindGroupCache::default(),
            map: None,
            is_hard: true,
        })
    }
}

/// A light with an extent is seen through views that are orthographic for a sun and else keep depth as 1 / distance.
pub(crate) fn refuse_warps(light: &Light, map: &ShadowMap) -> Result<(), GpuError> {
    let is_sun = matches!(light, Light::Directional { .. });
    let row = if is_sun { 3 } else { 2 };
    let clips = map.views().iter().filter_map(|view| view.clip);
    if clips.map(|clip| clip.row(row).truncate()).all(|bent| bent == glam::DVec3::ZERO) {
        return Ok(());
    }
    Err(GpuError::Invalid {
        what: "layout of the map",
        value: "a warped one, under a light with an extent".to_owned(),
        fix: "use one map or cascades, or a light without an extent",
    })
}

impl Store for AreaStore {
    fn prepare(&mut self, gpu: &Gpu, frame: &Frame<'_>, map: &ShadowMap) -> Result<(), GpuError> {
        self.is_hard = frame.light.is_hard();
        if !self.is_hard {
            refuse_warps(frame.light, map)?;
        }
        self.map = map.view().cloned();
        let light = AreaLight::new(frame.light, map);
        gpu.queue.write_buffer(&self.light, 0, bytemuck::bytes_of(&light));
        if self.window.tally {
            gpu.queue.write_buffer(&self.tally, 0, &[0; 16]);
        }
        if self.window.hierarchy {
            self.pyramid.prepare(gpu, map, self.is_hard)?;
        }
        let pyramid = self.pyramid.whole().filter(|_| self.window.hierarchy).cloned();
        if let Some(table) = &mut self.table {
            table.prepare(gpu, map, self.is_hard)?;
        }
        let table = self.table.as_ref().map(|table| table.view().clone());
        self.group.get([pyramid, table], |[pyramid, table]| {
            let mut all = vec![bind::buffer(0, &self.light)];
            all.extend(pyramid.as_ref().map(|view| bind::texture(1, view)));
            all.extend(table.as_ref().map(|view| bind::texture(3, view)));
            if self.window.tally {
                all.push(bind::buffer(2, &self.tally));
            }
            gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("area light"),
                layout: &self.layout,
                entries: &all,
            })
        });
        Ok(())
    }

    fn encode(
        &mut self,
        _gpu: &Gpu,
        _frame: &Frame<'_>,
        map: &ShadowMap,
        recorder: &mut Recorder<'_>,
    ) -> Result<(), GpuError> {
        if self.window.hierarchy && !self.is_hard && self.map.is_some() {
            self.pyramid.encode(map, recorder);
        }
        if let Some(table) = self.table.as_ref().filter(|table| !table.jobs.is_empty()) {
            table.sat.encode(recorder, "soft/sum");
        }
        Ok(())
    }

    fn group_layout(&self) -> Option<&wgpu::BindGroupLayout> {
        Some(&self.layout)
    }

    fn group(&self) -> Option<&wgpu::BindGroup> {
        self.group.kept()
    }

    fn needs_receivers(&self) -> bool {
        self.table.is_some()
    }

    fn view(&self) -> Option<&wgpu::TextureView> {
        self.map.as_ref()
    }

    fn counters(&self) -> Counters {
        let pyramid = if self.is_hard { 0 } else { self.pyramid.texels };
        let texels = pyramid + self.table.as_ref().map_or(0, Table::texels);
        Counters::from([("store_texels", texels)])
    }

    fn read_counters(&self, gpu: &Gpu) -> Result<Counters, GpuError> {
        let mut counters = self.counters();
        if self.window.tally {
            let counts: Vec<u32> =
                bytemuck::pod_collect_to_vec(&read_buffer(gpu, &self.tally, 16)?);
            let names = ["samples_lit", "samples_dark", "samples_penumbra", "occluders"];
            counters.extend(names.into_iter().zip(counts.into_iter().map(u64::from)));
        }
        Ok(counters)
    }

    fn bytes(&self) -> u64 {
        let table = self.table.as_ref().map_or(0, |table| table.sat.bytes());
        self.light.size() + self.tally.size() + self.pyramid.bytes + table
    }
}

/// Greatest and least depths of each layer of a map, level by level: a mip chain of `Rg32Float`.
#[derive(Debug)]
struct Pyramid {
    layout: wgpu::BindGroupLayout,
    from_map: wgpu::ComputePipeline,
    from_level: wgpu::ComputePipeline,
    levels: Option<Levels>,
    bytes: u64,
    texels: u64,
}

#[derive(Debug)]
struct Levels {
    texture: wgpu::Texture,
    whole: wgpu::TextureView,
    each: Vec<wgpu::TextureView>,
    groups: BindGroupCache<wgpu::TextureView>,
    above: Vec<wgpu::BindGroup>,
}

impl Pyramid {
    fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        let layout = gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("depth pyramid"),
            entries: &[
                entries::texels(0, CS, true),
                entries::write_array(1, CS, wgpu::TextureFormat::Rg32Float),
            ],
        });
        let pipeline = |below| -> Result<wgpu::ComputePipeline, GpuError> {
            let linked = antumbra_shaders::link("soft::pyramid", &[module("below", below)])?;
            let shader = gpu.shader("depth pyramid", linked);
            Ok(gpu.compute_pipeline("depth pyramid", &shader, "level", &[&layout]))
        };
        Ok(Self {
            from_map: pipeline("soft::below_map")?,
            from_level: pipeline("soft::below_level")?,
            layout,
            levels: None,
            bytes: 0,
            texels: 0,
        })
    }

    fn whole(&self) -> Option<&wgpu::TextureView> {
        self.levels.as_ref().map(|levels| &levels.whole)
    }

    /// Makes room for a map; for one without casters, or if `is_hard`, a texel that nobody reads.
    fn prepare(&mut self, gpu: &Gpu, map: &ShadowMap, is_hard: bool) -> Result<(), GpuError> {
        let texture = map.texture().filter(|_| !is_hard);
        let layers = texture.map_or(1, wgpu::Texture::depth_or_array_layers);
        let side = texture.map_or(1, |t| t.width().next_power_of_two().max(2) / 2);
        let fits = |levels: &&mut Levels| {
            levels.texture.width() >= side && levels.texture.depth_or_array_layers() >= layers
        };
        if self.levels.as_mut().filter(fits).is_none() {
            let levels = Levels::new(gpu, &self.layout, side, layers)?;
            self.texels = (0..levels.each.len()).map(|l| u64::from(side >> l).pow(2)).sum::<u64>();
            self.texels *= u64::from(layers);
            self.bytes = 8 * self.texels;
            self.levels = Some(levels);
        }
        if let (Some(levels), Some(view)) = (&mut self.levels, map.view().filter(|_| !is_hard)) {
            let first = levels.each[0].clone();
            levels.groups.get(view.clone(), |view| group(gpu, &self.layout, view, &first));
        }
        Ok(())
    }

    fn encode(&mut self, map: &ShadowMap, recorder: &mut Recorder<'_>) {
        let Some(levels) = &self.levels else { return };
        let layers = map.views().iter().filter(|view| view.clip.is_some()).count() as u32;
        let mut pass = recorder.compute_pass("soft/pyramid");
        let groups = levels.groups.kept().into_iter().chain(&levels.above);
        for (level, group) in groups.enumerate() {
            pass.set_pipeline(if level == 0 { &self.from_map } else { &self.from_level });
            pass.set_bind_group(0, group, &[]);
            let side = (levels.texture.width() >> level).max(1).div_ceil(8);
            pass.dispatch_workgroups(side, side, layers);
        }
    }
}

impl Levels {
    fn new(
        gpu: &Gpu,
        layout: &wgpu::BindGroupLayout,
        side: u32,
        layers: u32,
    ) -> Result<Self, GpuError> {
        let count = side.ilog2() + 1;
        let texture = gpu.create_texture(
            "depth pyramid",
            &wgpu::TextureDescriptor {
                label: Some("depth pyramid"),
                size: wgpu::Extent3d { width: side, height: side, depth_or_array_layers: layers },
                mip_level_count: count,
                sample_count: 1,
                dimension: wgpu::TextureDimension::D2,
                format: wgpu::TextureFormat::Rg32Float,
                usage: wgpu::TextureUsages::STORAGE_BINDING | wgpu::TextureUsages::TEXTURE_BINDING,
                view_formats: &[],
            },
        )?;
        let view = |base_mip_level, mip_level_count| {
            texture.create_view(&wgpu::TextureViewDescriptor {
                label: Some("depth pyramid"),
                dimension: Some(wgpu::TextureViewDimension::D2Array),
                base_mip_level,
                mip_level_count: Some(mip_level_count),
                ..Default::default()
            })
        };
        let each: Vec<_> = (0..count).map(|level| view(level, 1)).collect();
        let above = each.windows(2).map(|pair| group(gpu, layout, &pair[0], &pair[1])).collect();
        let (whole, groups) = (view(0, count), BindGroupCache::default());
        Ok(Self { whole, each, groups, above, texture })
    }
}

fn group(
    gpu: &Gpu,
    layout: &wgpu::BindGroupLayout,
    below: &wgpu::TextureView,
    level: &wgpu::TextureView,
) -> wgpu::BindGroup {
    gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: Some("depth pyramid"),
        layout,
        entries: &[bind::texture(0, below), bind::texture(1, level)],
    })
}

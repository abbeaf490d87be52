//! What soft shadows read beside the map: the light, bounds of depths, sums of them, and deeper layers.

use antumbra_gpu::{
    BindGroupCache, Counters, Frame, Gpu, GpuError, Recorder, Sat, bind, entries, read_buffer,
};
use antumbra_map::{ShadowMap, Store};
use antumbra_scene::Light;

use crate::bounding::Bounding;
use crate::deeper::Deeper;
use crate::facing::{axes, half_sides};
use crate::named::{self, Named};
use crate::table::Table;
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

/// What only some techniques have beside the map.
#[derive(Default)]
pub(crate) struct Beside<'a> {
    /// A table of integers of two channels of the map's linear depth.
    pub(crate) table: Option<Sat>,
    /// Surfaces along each ray; 0 and 1 are the map alone.
    pub(crate) layers: u32,
    /// What the cells of the light emit, for `soft/emitted.wesl`.
    pub(crate) emission: Option<&'a [f32]>,
    /// The tables of `soft/pattern_mask.wesl`.
    pub(crate) pattern: Option<&'a [[u32; 4]]>,
}

/// What the bind group holds that may change: the pyramid in bindings 1 and 4, the table in 3, deeper layers in 5 to 7; and
/// named triangles.
type Bound = ([Option<wgpu::TextureView>; 6], Option<named::Bound>);

const BOUND: [u32; 6] = [1, 4, 3, 5, 6, 7];

/// Binding of the emission.
const EMISSION: u32 = 8;

/// Binding of a pattern of samples.
const PATTERN: u32 = 9;

/// The light and its views, the pyramid, the tally, a table of sums, deeper layers, an emission and a pattern, in bind group 2.
#[derive(Debug)]
pub(crate) struct AreaStore {
    window: Window,
    layout: wgpu::BindGroupLayout,
    light: wgpu::Buffer,
    tally: wgpu::Buffer,
    bounding: Option<Bounding>,
    table: Option<Table>,
    deeper: Option<Deeper>,
    emission: Option<wgpu::Buffer>,
    pattern: Option<wgpu::Buffer>,
    named: Option<Named>,
    group: BindGroupCache<Bound>,
    map: Option<wgpu::TextureView>,
    is_hard: bool,
}

impl AreaStore {
    pub(crate) fn new(gpu: &Gpu, window: &Window) -> Result<Self, GpuError> {
        Self::with(gpu, window, Beside::default())
    }

    pub(crate) fn with(gpu: &Gpu, window: &Window, beside: Beside<'_>) -> Result<Self, GpuError> {
        let Beside { table, layers, emission, pattern } = beside;
        window.validate()?;
        let bounding = Bounding::new(gpu, window.hierarchy)?;
        let mut all = vec![entries::storage(0, CS)];
        all.extend(bounding.iter().flat_map(Bounding::entries));
        if window.tally {
            all.push(entries::write_storage(2, CS));
        }
        if table.is_some() {
            all.push(entries::unsigned_array(3, CS));
        }
        let deeper = Deeper::new(gpu, layers)?;
        all.extend(deeper.iter().flat_map(|_| Deeper::entries()));
        all.extend(emission.map(|_| entries::storage(EMISSION, CS)));
        all.extend(pattern.map(|_| entries::storage(PATTERN, CS)));
        let named = Named::new(gpu, window.reach)?;
        all.extend(named.iter().flat_map(|_| Named::entries()));
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
            bounding,
            table: table.map(|sat| Table::new(gpu, sat)).transpose()?,
            deeper,
            emission: emission.map(|e| gpu.buffer("emission", bytemuck::cast_slice(e), usage)),
            pattern: pattern.map(|p| gpu.buffer("pattern", bytemuck::cast_slice(p), usage)),
            named,
            group: BindGroupCache::default(),
            map: None,
            is_hard: true,
        })
    }

    fn bound(&self) -> [Option<wgpu::TextureView>; 6] {
        let [pyramid, stack] = self.bounding.as_ref().map_or([None, None], Bounding::views);
        let table = self.table.as_ref().map(|table| table.view().clone());
        let [second, third, fourth] =
            self.deeper.as_ref().map_or([None, None, None], |deeper| deeper.views().map(Some));
        [pyramid, stack, table, second, third, fourth]
    }
}

/// An image lies on a rectangle or a disc: a sphere shows every receiver another side, and a sun has no sides.
fn refuse_images(light: &Light) -> Result<(), GpuError> {
    if light.is_hard() || matches!(light, Light::Rect { .. } | Light::Disc { .. }) {
        return Ok(());
    }
    Err(GpuError::Invalid {
        what: "emission",
        value: format!("one of a {} light", light.kind().name()),
        fix: "use a rectangle or a disc, whose sides say where an image lies, or no emission",
    })
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
        if self.emission.is_some() {
            refuse_images(frame.light)?;
        }
        self.map = map.view().cloned();
        let light = AreaLight::new(frame.light, map);
        gpu.queue.write_buffer(&self.light, 0, bytemuck::bytes_of(&light));
        if self.window.tally {
            gpu.queue.write_buffer(&self.tally, 0, &[0; 16]);
        }
        if let Some(bounding) = &mut self.bounding {
            bounding.prepare(gpu, map, self.is_hard)?;
        }
        if let Some(table) = &mut self.table {
            table.prepare(gpu, map, self.is_hard)?;
        }
        if let Some(deeper) = &mut self.deeper {
            deeper.prepare(gpu, frame, map)?;
        }
        let named = self.named.as_mut().map(|named| named.prepare(gpu, frame, map)).transpose()?;
        self.group.get((self.bound(), named), |(bound, named)| {
            let mut all = vec![bind::buffer(0, &self.light)];
            for (binding, view) in BOUND.iter().zip(bound) {
                all.extend(view.as_ref().map(|view| bind::texture(*binding, view)));
            }
            if self.window.tally {
                all.push(bind::buffer(2, &self.tally));
            }
            all.extend(self.emission.iter().map(|emission| bind::buffer(EMISSION, emission)));
            all.extend(named.iter().flat_map(Named::bind));
            all.extend(self.pattern.iter().map(|pattern| bind::buffer(PATTERN, pattern)));
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
        gpu: &Gpu,
        frame: &Frame<'_>,
        map: &ShadowMap,
        recorder: &mut Recorder<'_>,
    ) -> Result<(), GpuError> {
        if let Some(named) = &mut self.named {
            named.encode(gpu, frame, map, recorder)?;
        }
        if let Some(deeper) = &mut self.deeper {
            deeper.encode(gpu, frame, map, recorder)?;
        }
        if let Some(bounding) = &self.bounding {
            bounding.encode(recorder);
        }
        if let Some(table) = &self.table {
            table.encode(recorder);
        }
        Ok(())
    }

    fn group_layout(&self) -> Option<&wgpu::BindGroupLayout> {
        Some(&self.layout)
    }

    fn group(&self) -> Option<&wgpu::BindGroup> {
        self.group.kept()
    }

    fn draws(&self) -> bool {
        self.named.is_some()
    }

    fn needs_receivers(&self) -> bool {
        self.table.is_some()
    }

    fn view(&self) -> Option<&wgpu::TextureView> {
        self.map.as_ref()
    }

    fn counters(&self) -> Counters {
        let texels = self.bounding.as_ref().map_or(0, Bounding::texels)
            + self.table.as_ref().map_or(0, Table::texels);
        let mut counters = self.named.as_ref().map_or_else(Counters::new, Named::counters);
        counters.extend(self.deeper.iter().flat_map(Deeper::counters));
        counters.insert("store_texels", texels);
        counters
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
        self.light.size()
            + self.tally.size()
            + self.bounding.as_ref().map_or(0, Bounding::bytes)
            + self.table.as_ref().map_or(0, Table::bytes)
            + self.named.as_ref().map_or(0, Named::bytes)
            + self.deeper.as_ref().map_or(0, Deeper::bytes)
            + self.emission.as_ref().map_or(0, wgpu::Buffer::size)
            + self.pattern.as_ref().map_or(0, wgpu::Buffer::size)
    }
}

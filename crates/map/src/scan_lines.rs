//! Shadow maps kept as spans of linear depth along their rows (Arvo, Hirvikorpi 2005): storage without loss beyond a
//! stated tolerance, for lights that stand still.
//!
//! A polygon's depth is linear along a row of texels, so a row is as many spans as it meets visible polygons. Each row
//! is cut by one thread, twice: to count its spans, and, when prefix sums have said where they go, to write them. Depth
//! is only ever moved away from the light: no receiver gets into false shadow by it, and one that is nearer to its
//! caster than the tolerance may be lit.

use antumbra_gpu::{
    BindGroupCache, Counters, Expectation, Frame, Gpu, GpuError, Recorder, Scan, Technique,
    TechniqueConfig, bind, entries, read_buffer,
};
use antumbra_shaders::module;
use serde::{Deserialize, Serialize};

use crate::{Estimator, MapConfig, MapTechnique, ShadowMap, Store, expectation};

/// The plain shadow map from spans (Arvo, Hirvikorpi 2005).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ScanLines {
    /// The shadow map.
    pub map: MapConfig,
    /// How far from the light a span may move what was drawn: a share of the depth range in parallel light, of the
    /// distance under other lights. 0 to 0.01, default 2^-16, the step of 16-bit depth. Below 2^-19 spans end where
    /// rounding asks for it; at 0 depth is kept bit by bit, and only where nothing was drawn are texels joined.
    pub tolerance: f32,
    /// Spans a row for which there is room, as a mean over all rows, 1 to 16384, default 64. 12 bytes each. Rows beyond
    /// the room are looked up in the depth map.
    pub room: u32,
}

impl Default for ScanLines {
    fn default() -> Self {
        Self { map: MapConfig::default(), tolerance: 2f32.powi(-16), room: 64 }
    }
}

impl ScanLines {
    /// The estimator: that of the plain map, with spans in the place of the depth store.
    #[must_use]
    pub fn estimator() -> Estimator {
        let mut estimator = Estimator::nearest();
        estimator.slots.push(module("common::depth_map", "map::scan_line_map"));
        estimator
    }
}

impl TechniqueConfig for ScanLines {
    fn build(&self, gpu: &Gpu) -> Result<Box<dyn Technique>, GpuError> {
        let store = Box::new(ScanLineStore::new(gpu, self)?);
        let estimator = Self::estimator();
        Ok(Box::new(MapTechnique::with_store(gpu, &self.map, estimator, store)?))
    }

    fn set_map_size(&mut self, size: u32) {
        self.map.size = size;
    }

    fn expectation(&self, case: &str) -> Option<Expectation> {
        let plain = expectation(&self.map, &Estimator::nearest(), case)?;
        Some(match (case, plain) {
            // A floor point x from the foot of a wall lies x sqrt 2 behind it along the light, and a texel of floor is 2 m
            // over the map's side; the depth range is less than 5.6 m.
            ("HC-04 thin wall" | "HC-05 cube", Expectation::Holds { bound }) => {
                let lit = 5.6 * f64::from(self.tolerance) / std::f64::consts::SQRT_2;
                Expectation::Holds { bound: bound + lit * f64::from(self.map.size) / 2.0 }
            }
            (_, plain) => plain,
        })
    }
}

/// A run of texels along a row, with linear depth; `Span` of `map/span.wesl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
pub struct Span {
    /// Its first texel.
    pub start: u32,
    /// Depth there.
    pub depth: f32,
    /// Change of depth a texel.
    pub slope: f32,
}

/// The store of spans. The depth map stays, to be drawn and for the rows that do not fit.
#[derive(Debug)]
pub struct ScanLineStore {
    config: ScanLines,
    count: wgpu::ComputePipeline,
    write: wgpu::ComputePipeline,
    scan: Scan,
    cut_layout: wgpu::BindGroupLayout,
    cut_group: BindGroupCache<wgpu::TextureView>,
    read_layout: wgpu::BindGroupLayout,
    kept: Option<Kept>,
    map: Option<wgpu::TextureView>,
    counters: Counters,
}

/// Room for the rows of a number of layers.
#[derive(Debug)]
struct Kept {
    layers: u32,
    rows: u32,
    bands: wgpu::Buffer,
    lines: wgpu::Buffer,
    spans: wgpu::Buffer,
    group: wgpu::BindGroup,
}

impl ScanLineStore {
    /// Checks the settings and builds the passes.
    ///
    /// # Errors
    /// A setting out of range.
    pub fn new(gpu: &Gpu, config: &ScanLines) -> Result<Self, GpuError> {
        const CS: wgpu::ShaderStages = wgpu::ShaderStages::COMPUTE;
        if !(0.0..=0.01).contains(&config.tolerance) {
            let value = config.tolerance.to_string();
            return Err(GpuError::Invalid { what: "tolerance", value, fix: "use 0 to 0.01" });
        }
        if !(1..=16384).contains(&config.room) {
            let value = config.room.to_string();
            return Err(GpuError::Invalid { what: "room", value, fix: "use 1 to 16384 spans" });
        }
        let layout = |label, entries: &[_]| {
            let descriptor = wgpu::BindGroupLayoutDescriptor { label: Some(label), entries };
            gpu.device.create_bind_group_layout(&descriptor)
        };
        let cut_layout = layout(
            "scan lines",
            &[
                entries::texels(0, CS, true),
                entries::storage(1, CS),
                entries::write_storage(2, CS),
                entries::write_storage(3, CS),
            ],
        );
        let read_layout =
            layout("scan lines to look up", &[entries::storage(0, CS), entries::storage(1, CS)]);
        let shader = gpu.shader("scan lines", antumbra_shaders::link("map::scan_lines", &[])?);
        let pipeline = |entry| gpu.compute_pipeline("scan lines", &shader, entry, &[&cut_layout]);
        Ok(Self {
            config: *config,
            count: pipeline("count"),
            write: pipeline("write"),
            scan: Scan::new(gpu)?,
            cut_layout,
            cut_group: BindGroupCache::default(),
            read_layout,
            kept: None,
            map: None,
            counters: Counters::new(),
        })
    }

    /// The number of each row's first span, and of all; and the spans, as far as there was room. Waits.
    ///
    /// # Errors
    /// A lost device.
    pub fn read(&self, gpu: &Gpu) -> Result<(Vec<u32>, Vec<Span>), GpuError> {
        let Some(kept) = &self.kept else { return Ok((Vec::new(), Vec::new())) };
        let lines = read_buffer(gpu, &kept.lines, kept.lines.size())?;
        let spans = read_buffer(gpu, &kept.spans, kept.spans.size())?;
        Ok((
            lines.chunks_exact(4).map(bytemuck::pod_read_unaligned).collect(),
            spans.chunks_exact(12).map(bytemuck::pod_read_unaligned).collect(),
        ))
    }
}

impl Kept {
    fn new(
        gpu: &Gpu,
        layers: u32,
        size: u32,
        room: u32,
        layout: &wgpu::BindGroupLayout,
    ) -> Result<Self, GpuError> {
        use wgpu::BufferUsages as Usages;
        let rows = layers * size;
        let asked = u64::from(rows) * u64::from(room) * size_of::<Span>() as u64;
        let limits = gpu.device.limits();
        let limit = limits.max_storage_buffer_binding_size.min(limits.max_buffer_size);
        if asked > limit {
            return Err(GpuError::Limit { what: "bytes of spans", asked, limit });
        }
        let buffer = |label, size, usage| {
            gpu.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(label),
                size,
                usage: usage | Usages::STORAGE,
                mapped_at_creation: false,
            })
        };
        let bands = buffer("bands of depth", u64::from(layers) * 16, Usages::COPY_DST);
        let lines = buffer("scan lines", (u64::from(rows) + 1) * 4, Usages::COPY_SRC);
        let spans = buffer("spans", asked, Usages::COPY_SRC);
        let group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("scan lines to look up"),
            layout,
            entries: &[bind::buffer(0, &lines), bind::buffer(1, &spans)],
        });
        Ok(Self { layers, rows, bands, lines, spans, group })
    }
}

impl Store for ScanLineStore {
    fn prepare(&mut self, gpu: &Gpu, _frame: &Frame<'_>, map: &ShadowMap) -> Result<(), GpuError> {
        // The pass needs some buffers even when no view reads them.
        let (layers, side) = match map.layer_views().len() as u32 {
            0 => (1, 1),
            layers => (layers, map.size()),
        };
        if self.kept.as_ref().is_none_or(|k| k.rows < layers * side) {
            let made = Kept::new(gpu, layers, side, self.config.room, &self.read_layout)?;
            self.scan.prepare(gpu, &made.lines, made.rows + 1)?;
            self.cut_group = BindGroupCache::default();
            self.kept = Some(made);
        }
        self.map = map.view().cloned();
        if let Some(kept) = &self.kept {
            let tolerance = self.config.tolerance;
            let views = map.views().iter().filter(|view| view.clip.is_some());
            let mut bands: Vec<[f32; 4]> = views
                .map(|view| match view.light.w {
                    0.0 => [tolerance, 0.0, 1.0, 0.0],
                    _ => [0.0, tolerance, 1.0, 0.0],
                })
                .collect();
            // Layers that are not in use.
            bands.resize(kept.layers as usize, [0.0; 4]);
            gpu.queue.write_buffer(&kept.bands, 0, bytemuck::cast_slice(&bands));
        }
        Ok(())
    }

    fn encode(
        &mut self,
        gpu: &Gpu,
        _frame: &Frame<'_>,
        _map: &ShadowMap,
        recorder: &mut Recorder<'_>,
    ) -> Result<(), GpuError> {
        self.counters.clear();
        let (Some(map), Some(kept)) = (&self.map, &self.kept) else {
            return Ok(());
        };
        let group = self.cut_group.get(map.clone(), |map| {
            gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("scan lines"),
                layout: &self.cut_layout,
                entries: &[
                    bind::texture(0, map),
                    bind::buffer(1, &kept.bands),
                    bind::buffer(2, &kept.lines),
                    bind::buffer(3, &kept.spans),
                ],
            })
        });
        let groups = kept.rows.div_ceil(64);
        let mut pass = recorder.compute_pass("map/scan_lines");
        pass.set_pipeline(&self.count);
        pass.set_bind_group(0, group, &[]);
        pass.dispatch_workgroups(groups, 1, 1);
        self.scan.encode(&mut pass);
        pass.set_pipeline(&self.write);
        pass.set_bind_group(0, group, &[]);
        pass.dispatch_workgroups(groups, 1, 1);
        self.counters.insert("store_rows", kept.rows.into());
        Ok(())
    }

    fn group_layout(&self) -> Option<&wgpu::BindGroupLayout> {
        Some(&self.read_layout)
    }

    fn group(&self) -> Option<&wgpu::BindGroup> {
        self.kept.as_ref().map(|kept| &kept.group)
    }

    fn view(&self) -> Option<&wgpu::TextureView> {
        self.map.as_ref()
    }

    fn counters(&self) -> Counters {
        self.counters.clone()
    }

    /// With the number of spans, and the bytes that a light which stands still needs of all that is held here.
    fn read_counters(&self, gpu: &Gpu) -> Result<Counters, GpuError> {
        let mut counters = self.counters();
        if let Some(kept) = self.kept.as_ref().filter(|_| self.map.is_some()) {
            let (lines, _) = self.read(gpu)?;
            let spans = lines.last().map_or(0, |n| u64::from(*n));
            counters.insert("spans", spans);
            counters.insert("span_bytes", spans * size_of::<Span>() as u64 + kept.lines.size());
        }
        Ok(counters)
    }

    fn bytes(&self) -> u64 {
        let kept = self.kept.as_ref();
        let buffers = kept.map_or(0, |k| k.bands.size() + k.lines.size() + k.spans.size());
        buffers + self.scan.bytes()
    }
}

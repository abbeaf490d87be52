//! The depth texture of a light and the passes that fill it.

use antumbra_gpu::{
    CasterClusters, Counters, Drawn, Frame, Gate, Gpu, GpuError, Layers, LightView,
    ListedTriangles, Recorder, light_view_layout,
};
use glam::{DVec3, DVec4, Mat4};

use crate::chart_pass::{ChartPass, triangles_of};
use crate::receiver_mask::ReceiverMask;
use crate::{
    Arrange, BodyBoxes, CasterDepth, DepthConvention, Drawing, FittedView, Fitting, LinearDepth,
    SeenView, Sight,
};

/// Fitted views of a light and the depth map that holds them, one layer a view with casters.
#[derive(Debug)]
pub struct ShadowMap {
    size: u32,
    guard: u32,
    grid: u32,
    draws_receivers: bool,
    arrange: Box<dyn Arrange>,
    matrices: Matrices,
    stride: u32,
    charts: Option<ChartPass>,
    layers: Option<Layers>,
    views: Vec<FittedView>,
    linear: Vec<LinearDepth>,
    volumes: Vec<Vec<DVec4>>,
    hull: Vec<DVec3>,
    boxes: BodyBoxes,
    counters: Counters,
    drawn: Option<Gate>,
}

/// The matrices of the views, for their depth passes.
#[derive(Debug)]
struct Matrices {
    buffer: wgpu::Buffer,
    group: wgpu::BindGroup,
    capacity: usize,
}

/// Whether casters are drawn from their triangles into charts of directions.
fn is_chart(drawing: Drawing) -> bool {
    matches!(drawing, Drawing::Traced | Drawing::Warped)
}

/// Room for the views of a cube; layouts of more make more.
const USUAL_VIEWS: usize = 6;

impl ShadowMap {
    /// Format of the map.
    pub const FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Depth32Float;

    /// A map with layers of `size` x `size` texels and a guard band of `guard` texels, whose views `arrange` fits.
    ///
    /// # Errors
    /// A size of zero or beyond the device's limit.
    pub fn new(
        gpu: &Gpu,
        size: u32,
        guard: u32,
        arrange: Box<dyn Arrange>,
    ) -> Result<Self, GpuError> {
        let limits = gpu.device.limits();
        let limit = limits.max_texture_dimension_2d;
        if size == 0 {
            let fix = "use at least 1 texel a side";
            return Err(GpuError::Invalid { what: "map size", value: size.to_string(), fix });
        }
        if size > limit {
            return Err(GpuError::Limit {
                what: "map size",
                asked: size.into(),
                limit: limit.into(),
            });
        }
        let stride = limits.min_uniform_buffer_offset_alignment.max(size_of::<Mat4>() as u32);
        let matrices = Matrices::new(gpu, stride, USUAL_VIEWS);
        Ok(Self {
            size,
            guard,
            grid: 1,
            draws_receivers: false,
            arrange,
            matrices,
            stride,
            charts: None,
            layers: None,
            views: Vec::new(),
            linear: Vec::new(),
            volumes: Vec::new(),
            hull: Vec::new(),
            boxes: BodyBoxes::default(),
            counters: Counters::new(),
            drawn: None,
        })
    }

    /// Where the GPU alone knows whether this frame's passes draw any texel: stores that are made of the map stay as they are
    /// in frames that draw none.
    #[must_use]
    pub fn drawn(&self) -> Option<&Gate> {
        self.drawn.as_ref()
    }

    pub(crate) fn set_drawn(&mut self, drawn: Option<Gate>) {
        self.drawn = drawn;
    }

    /// Has surfaces that cast no shadow drawn too, for stores that average depth.
    #[must_use]
    pub fn with_receivers(self, receivers: bool) -> Self {
        Self { draws_receivers: receivers, ..self }
    }

    /// Has windows that follow the camera move in multiples of `grid` texels, for stores of larger ones.
    #[must_use]
    pub fn with_grid(self, grid: u32) -> Self {
        Self { grid, ..self }
    }

    /// The same map, with views that the arrangement fits which `arrange` makes of the present one.
    ///
    /// # Errors
    /// That of `arrange`.
    pub fn rearranged(
        self,
        arrange: impl FnOnce(Box<dyn Arrange>) -> Result<Box<dyn Arrange>, GpuError>,
    ) -> Result<Self, GpuError> {
        Ok(Self { arrange: arrange(self.arrange)?, ..self })
    }

    /// Fits the views to the frame's casters, or to those of them that can shadow what its camera sees, uploads their
    /// matrices, and makes the layers that they need.
    ///
    /// # Errors
    /// A light that cannot be fitted, or a failed allocation.
    pub fn prepare(&mut self, gpu: &Gpu, frame: &Frame<'_>) -> Result<(), GpuError> {
        self.hull.clear();
        let hull = &mut self.hull;
        frame.casters.hull(frame.light, &mut |p| hull.push(p));
        let fitting = Fitting {
            origin: frame.origin,
            size: self.size,
            guard: self.guard,
            receivers: self.draws_receivers,
            grid: self.grid,
        };
        let region = self.boxes.visible_region(frame);
        let sight = region.as_ref().map(|region| Sight { region, casters: self.boxes.casters() });
        let seen = self.arrange.fit(frame, &self.hull, sight.as_ref(), &fitting)?;
        self.measure_depth(frame, &seen);
        (self.views, self.volumes) =
            seen.into_iter().map(|SeenView { view, volume, .. }| (view, volume)).unzip();
        let drawn = self.views.iter().filter(|v| v.clip.is_some()).count();
        if drawn > self.matrices.capacity {
            self.matrices = Matrices::new(gpu, self.stride, drawn);
        }
        for (layer, clip) in self.views.iter().filter_map(|v| v.clip).enumerate() {
            let offset = layer as u64 * u64::from(self.stride);
            let matrix = clip.as_mat4().to_cols_array();
            gpu.queue.write_buffer(&self.matrices.buffer, offset, bytemuck::bytes_of(&matrix));
        }
        let in_pages = self.arrange.layout(frame.light).drawing == Drawing::Pages;
        let needed = if in_pages { drawn.min(1) } else { drawn };
        self.linear.truncate(needed);
        self.prepare_charts(gpu, frame, needed)?;
        // Layers are kept when fewer are needed, so that a light that flits in and out allocates once.
        if self.layers.as_ref().is_none_or(|l| l.each.len() < needed) && needed > 0 {
            self.layers = Some(depth_layers(gpu, self.size, needed as u32)?);
        }
        Ok(())
    }

    /// Linear depth over the casters that matter, layer by layer.
    fn measure_depth(&mut self, frame: &Frame<'_>, seen: &[SeenView]) {
        for point in &mut self.hull {
            *point -= frame.origin;
        }
        let convention = DepthConvention::REVERSED_F32;
        let is_curved = is_chart(self.arrange.layout(frame.light).drawing);
        let linear = |SeenView { view, ends, .. }: &SeenView| {
            let clip = view.clip?;
            let linear = match ends {
                Some(ends) if self.draws_receivers => {
                    return Some(LinearDepth::between(&clip, ends, convention));
                }
                Some(ends) => LinearDepth::new(&clip, ends, convention),
                None if is_curved => {
                    LinearDepth::radial(clip.w_axis.w, view.light.truncate(), &self.hull)
                }
                None => LinearDepth::new(&clip, &self.hull, convention),
            };
            Some(if self.draws_receivers { linear.with_receivers() } else { linear })
        };
        self.linear = seen.iter().filter_map(linear).collect();
    }

    /// The depth pass of a layout that is drawn by its own, from the casters' triangles.
    fn prepare_charts(
        &mut self,
        gpu: &Gpu,
        frame: &Frame<'_>,
        needed: usize,
    ) -> Result<(), GpuError> {
        let layout = self.arrange.layout(frame.light);
        if !is_chart(layout.drawing) || needed == 0 {
            self.charts = self.charts.take().filter(|_| is_chart(layout.drawing));
            return Ok(());
        }
        let triangles = triangles_of(frame.casters)?;
        let charts = match self.charts.take().filter(|pass| pass.serves(&layout)) {
            Some(pass) => pass,
            None => ChartPass::new(gpu, &layout)?,
        };
        self.charts.insert(charts).bind(gpu, &triangles, &self.matrices.buffer);
        Ok(())
    }

    /// Records one depth pass for each view with casters.
    pub fn encode(&mut self, frame: &Frame<'_>, recorder: &mut Recorder<'_>) {
        let charts = self.charts.take();
        self.encode_by(frame, recorder, |view, pass| match (&charts, frame.casters.triangles()) {
            (Some(charts), Some(triangles)) => charts.draw(&triangles, view.offset, pass),
            _ => frame.casters.draw(view, pass),
        });
        self.charts = charts;
    }

    /// As [`ShadowMap::encode`], but draws the casters' triangles by `depth`.
    ///
    /// # Errors
    /// Casters that keep their triangles to themselves.
    pub fn encode_triangles(
        &mut self,
        frame: &Frame<'_>,
        recorder: &mut Recorder<'_>,
        depth: &CasterDepth,
    ) -> Result<(), GpuError> {
        let triangles = crate::caster_depth::triangles(frame.casters)?;
        self.encode_by(frame, recorder, |view, pass| {
            depth.draw(frame.casters, &triangles, view, pass)
        });
        Ok(())
    }

    /// As [`ShadowMap::encode`], but draws those of `clusters` only that `mask` lists.
    pub(crate) fn encode_masked(
        &mut self,
        gpu: &Gpu,
        frame: &Frame<'_>,
        recorder: &mut Recorder<'_>,
        mask: &mut ReceiverMask,
        clusters: &CasterClusters<'_>,
    ) {
        let clear = DepthConvention::REVERSED_F32.clear();
        let (mut passes, mut draws) = (0, 0);
        for (number, (view, layer)) in self.light_views(frame).zip(self.layer_views()).enumerate() {
            let list = mask.encode_list(gpu, recorder, number as u32, self.matrices(), clusters);
            let mut pass = recorder.depth_pass("map/depth", layer, clear);
            if let Some((indices, list, offset)) = list {
                let list = ListedTriangles { indices, draws: list, offset };
                draws += frame.casters.draw_listed(&view, &list, &mut pass);
            }
            passes += 1;
        }
        self.count(passes, draws, None);
    }

    /// Takes note of the work done; without `triangles`, of which only the GPU knows.
    fn count(&mut self, passes: u64, draws: u64, triangles: Option<u64>) {
        let texels = passes * u64::from(self.size) * u64::from(self.size);
        self.counters = Counters::from([
            ("map_passes", passes),
            ("map_draws", draws),
            ("map_texels", texels),
            ("map_lights_skipped", u64::from(passes == 0)),
        ]);
        if let Some(triangles) = triangles {
            self.counters.insert("map_triangles", triangles);
        }
    }

    fn encode_by(
        &mut self,
        frame: &Frame<'_>,
        recorder: &mut Recorder<'_>,
        draw: impl Fn(&LightView<'_>, &mut wgpu::RenderPass<'_>) -> Drawn,
    ) {
        let clear = DepthConvention::REVERSED_F32.clear();
        let (mut passes, mut draws, mut triangles) = (0, 0, 0);
        for (view, layer) in self.light_views(frame).zip(self.layer_views()) {
            let mut pass = recorder.depth_pass("map/depth", layer, clear);
            let drawn = draw(&view, &mut pass);
            passes += 1;
            draws += drawn.draws;
            triangles += drawn.triangles;
        }
        self.count(passes, draws, Some(triangles));
    }

    /// Who fits the views.
    #[must_use]
    pub fn arrange(&self) -> &dyn Arrange {
        self.arrange.as_ref()
    }

    /// The matrices that layers are drawn by, and the bytes from one to the next; usages `UNIFORM`, `STORAGE`,
    /// `COPY_DST` and `COPY_SRC`.
    #[must_use]
    pub fn matrices(&self) -> (&wgpu::Buffer, u32) {
        (&self.matrices.buffer, self.stride)
    }

    /// Width of the band around casters that stays free of them, texels.
    #[must_use]
    pub fn guard(&self) -> u32 {
        self.guard
    }

    /// Corners around all casters of the last frame, relative to its origin.
    #[must_use]
    pub fn hull(&self) -> &[DVec3] {
        &self.hull
    }

    /// The views with casters, in the order of their layers, for drawing into them.
    pub fn light_views<'a>(&'a self, frame: &Frame<'a>) -> impl Iterator<Item = LightView<'a>> {
        let (light, origin) = (frame.light, frame.origin);
        let views = self.views.iter().zip(&self.volumes);
        let clips = views.filter_map(|(view, volume)| Some((view.clip?, volume)));
        clips.enumerate().map(move |(index, (clip, volume))| LightView {
            clip: clip.as_mat4(),
            bind_group: &self.matrices.group,
            offset: index as u32 * self.stride,
            format: Self::FORMAT,
            order: DepthConvention::REVERSED_F32.order(),
            light,
            origin,
            volume,
            receivers: self.draws_receivers,
        })
    }

    /// Each layer of the map as a `D2` view.
    #[must_use]
    pub fn layer_views(&self) -> &[wgpu::TextureView] {
        self.layers.as_ref().map_or(&[], |l| &l.each)
    }

    /// The fitted views, in the layout's order. A view with a matrix has a layer; layers are numbered in
    /// the order of those views.
    #[must_use]
    pub fn views(&self) -> &[FittedView] {
        &self.views
    }

    /// Linear depth over the casters, layer by layer of those in use.
    #[must_use]
    pub fn linear_depths(&self) -> &[LinearDepth] {
        &self.linear
    }

    /// The map as a `D2Array` view, or `None` where no view has a caster.
    #[must_use]
    pub fn view(&self) -> Option<&wgpu::TextureView> {
        let any = self.views.iter().any(|v| v.clip.is_some());
        self.layers.as_ref().filter(|_| any).map(|l| &l.whole)
    }

    /// The map itself, once it has been needed.
    #[must_use]
    pub fn texture(&self) -> Option<&wgpu::Texture> {
        self.layers.as_ref().map(|l| &l.texture)
    }

    /// Side of a layer, texels.
    #[must_use]
    pub fn size(&self) -> u32 {
        self.size
    }

    /// Work of the last [`ShadowMap::encode`].
    #[must_use]
    pub fn counters(&self) -> &Counters {
        &self.counters
    }

    /// Bytes of GPU memory held.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        self.layers.as_ref().map_or(0, Layers::bytes) + self.matrices.buffer.size()
    }
}

impl Matrices {
    fn new(gpu: &Gpu, stride: u32, capacity: usize) -> Self {
        let buffer = gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("light views"),
            size: u64::from(stride) * capacity as u64,
            usage: wgpu::BufferUsages::UNIFORM
                | wgpu::BufferUsages::STORAGE
                | wgpu::BufferUsages::COPY_DST
                | wgpu::BufferUsages::COPY_SRC,
            mapped_at_creation: false,
        });
        let group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("light views"),
            layout: &light_view_layout(&gpu.device),
            entries: &[wgpu::BindGroupEntry {
                binding: 0,
                resource: wgpu::BindingResource::Buffer(wgpu::BufferBinding {
                    buffer: &buffer,
                    offset: 0,
                    size: wgpu::BufferSize::new(size_of::<Mat4>() as u64),
                }),
            }],
        });
        Self { buffer, group, capacity }
    }
}

/// Layers of depth as a map's.
pub(crate) fn depth_layers(gpu: &Gpu, size: u32, count: u32) -> Result<Layers, GpuError> {
    let usage = wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC;
    Layers::new(gpu, "shadow map", ShadowMap::FORMAT, (size, count), usage)
}

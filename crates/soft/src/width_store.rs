//! What single-sample soft shadows read beside the map: the light, widths, and perhaps the casters' far sides.

use antumbra_gpu::{
    BindGroupCache, Counters, Frame, Gpu, GpuError, Layers, LightView, Recorder, bind, entries,
    light_view_layout,
};
use antumbra_map::{DepthConvention, ShadowMap, Store};
use antumbra_scene::{Bounds, Light};
use glam::{BVec3, DMat4, DVec2, DVec3, Mat4};

use crate::store::{AreaLight, VIEWS, refuse_warps};
use crate::twin::View;
use crate::twin::width::doublings_for;
use crate::{SingleSample, WidthMap};

const CS: wgpu::ShaderStages = wgpu::ShaderStages::COMPUTE;

/// The light and its views, widths, and far sides, in bind group 2.
#[derive(Debug)]
pub(crate) struct WidthStore {
    config: SingleSample,
    layout: wgpu::BindGroupLayout,
    light: wgpu::Buffer,
    widths: WidthMap,
    far: Option<FarSides>,
    nothing: wgpu::TextureView,
    group: BindGroupCache<[wgpu::TextureView; 2]>,
    map: Option<wgpu::TextureView>,
    is_hard: bool,
    counters: Counters,
}

impl WidthStore {
    pub(crate) fn new(gpu: &Gpu, config: &SingleSample) -> Result<Self, GpuError> {
        let mut all = vec![entries::storage(0, CS), entries::texels(1, CS, true)];
        if config.back {
            all.push(entries::texels(2, CS, true));
        }
        let layout = gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("shadow widths"),
            entries: &all,
        });
        let light = [0; size_of::<AreaLight>()];
        Ok(Self {
            config: *config,
            layout,
            light: gpu.buffer("area light", &light, wgpu::BufferUsages::STORAGE),
            widths: WidthMap::new(gpu, config)?,
            far: config.back.then(|| FarSides::new(gpu)),
            nothing: depth_layers(gpu, 1, 1)?.whole,
            group: BindGroupCache::default(),
            map: None,
            is_hard: true,
            counters: Counters::new(),
        })
    }

    /// As many doublings as the widest penumbra of any view needs.
    fn doublings(&self, views: &[(DMat4, View)], receivers: Option<[DVec3; 2]>, size: u32) -> u32 {
        if self.config.doublings > 0 {
            return self.config.doublings;
        }
        // Where the function has fallen to 0.
        let share = (1.0 + f64::from(self.config.bias)) / f64::from(self.config.scale);
        let widest = |(clip, view): &(DMat4, View)| {
            share * widest_half(clip, view, receivers, f64::from(size))
        };
        let widest = views.iter().map(widest).fold(0.0, f64::max);
        doublings_for(widest, size, self.config.neighbours)
    }
}

/// The widest half of a penumbra in a view, shorter sides of a texel: of the nearest occluder for the farthest receiver. The
/// corners around all receivers are relative to the frame's origin; where there are none receivers may be anywhere.
fn widest_half(clip: &DMat4, view: &View, receivers: Option<[DVec3; 2]>, size: f64) -> f64 {
    // Depth is reversed: 1 at the nearest occluder, a infinitely far in perspective.
    let last = match receivers {
        Some([lo, hi]) => (0..8)
            .map(|i| DVec3::select(BVec3::new(i & 1 > 0, i & 2 > 0, i & 4 > 0), hi, lo))
            .map(|corner| *clip * corner.extend(1.0))
            .filter(|c| c.w > 0.0)
            .map(|c| c.z / c.w)
            .fold(view.nearest, f64::min),
        None if view.perspective => view.a,
        None => return f64::INFINITY,
    };
    let depth = view.nearest - last;
    if view.u.z == 0.0 && view.v.z == 0.0 && view.radius == 0.0 {
        return view.seen(view.centre, last).half_penumbra(depth);
    }
    // A light that is not level is seen wider beside the axis, by less than the square of the secant.
    let corner = view.centre.abs().max((DVec2::splat(size) - view.centre).abs());
    let slope = (corner / view.texels).length_squared();
    let radius = (view.u.length() * view.v.length()).sqrt().max(view.radius);
    view.texels.max_element() / view.b * radius * (1.0 + slope) * depth
}

/// Corners of a box around all that receives, relative to the frame's origin, where that is known.
fn around_receivers(frame: &Frame<'_>) -> Option<[DVec3; 2]> {
    let mut all = Bounds::EMPTY;
    let known = frame.casters.bodies(&mut |body| all = all.union(body.bounds));
    (known && !all.is_empty()).then(|| [all.min - frame.origin, all.max - frame.origin])
}

impl Store for WidthStore {
    fn prepare(&mut self, gpu: &Gpu, frame: &Frame<'_>, map: &ShadowMap) -> Result<(), GpuError> {
        self.is_hard = frame.light.is_hard();
        if !self.is_hard {
            refuse_warps(frame.light, map)?;
        }
        let light = AreaLight::new(frame.light, map);
        gpu.queue.write_buffer(&self.light, 0, bytemuck::bytes_of(&light));
        let views = views(frame.light, map);
        let sides: Vec<DVec2> =
            views.iter().map(|(_, v)| v.texels.max_element() / v.texels).collect();
        let doublings = self.doublings(&views, around_receivers(frame), map.size());
        self.map = map.view().cloned();
        if let Some(map_view) = &self.map {
            self.widths.prepare(gpu, map_view, map.size(), &sides, doublings)?;
        }
        if let Some(far) = &mut self.far {
            far.prepare(gpu, map, self.is_hard)?;
        }
        let kept = |view: Option<&wgpu::TextureView>| {
            view.filter(|_| !self.is_hard).unwrap_or(&self.nothing).clone()
        };
        let widths = kept(self.widths.view());
        let far = kept(self.far.as_ref().and_then(FarSides::view));
        self.group.get([widths, far], |[widths, far]| {
            let mut all = vec![bind::buffer(0, &self.light), bind::texture(1, widths)];
            if self.config.back {
                all.push(bind::texture(2, far));
            }
            gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("shadow widths"),
                layout: &self.layout,
                entries: &all,
            })
        });
        Ok(())
    }

    fn encode(
        &mut self,
        _gpu: &Gpu,
        frame: &Frame<'_>,
        map: &ShadowMap,
        recorder: &mut Recorder<'_>,
    ) -> Result<(), GpuError> {
        self.counters = Counters::from([("store_passes", 0), ("store_texels", 0)]);
        if self.is_hard || self.map.is_none() {
            return Ok(());
        }
        self.widths.encode(recorder, "soft/widths");
        self.counters.insert("store_passes", self.widths.passes());
        self.counters.insert("store_texels", self.widths.texels());
        if let Some(far) = &self.far {
            let triangles = far.encode(frame, map, recorder);
            self.counters.insert("far_side_triangles", triangles);
        }
        Ok(())
    }

    fn group_layout(&self) -> Option<&wgpu::BindGroupLayout> {
        Some(&self.layout)
    }

    fn group(&self) -> Option<&wgpu::BindGroup> {
        self.group.kept()
    }

    fn view(&self) -> Option<&wgpu::TextureView> {
        self.map.as_ref()
    }

    fn counters(&self) -> Counters {
        self.counters.clone()
    }

    fn bytes(&self) -> u64 {
        self.light.size() + self.widths.bytes() + self.far.as_ref().map_or(0, FarSides::bytes)
    }
}

/// The views with casters; none of a light without an extent.
fn views(light: &Light, map: &ShadowMap) -> Vec<(DMat4, View)> {
    let clips = map.views().iter().filter_map(|view| view.clip).take(VIEWS);
    let view = |clip: DMat4| (clip, View::new(&clip, f64::from(map.size()), light));
    clips.filter(|_| !light.is_hard()).map(view).collect()
}

/// The farthest surface of each texel: casters drawn with depth 1 - d, so that the nearest by that is the farthest.
#[derive(Debug)]
struct FarSides {
    matrices: wgpu::Buffer,
    matrix_group: wgpu::BindGroup,
    stride: u32,
    drawn: Vec<Mat4>,
    layers: Option<Layers>,
}

impl FarSides {
    fn new(gpu: &Gpu) -> Self {
        let alignment = gpu.device.limits().min_uniform_buffer_offset_alignment;
        let stride = alignment.max(size_of::<Mat4>() as u32);
        let matrices = gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("far sides"),
            size: u64::from(stride) * VIEWS as u64,
            usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let matrix_group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("far sides"),
            layout: &light_view_layout(&gpu.device),
            entries: &[wgpu::BindGroupEntry {
                binding: 0,
                resource: wgpu::BindingResource::Buffer(wgpu::BufferBinding {
                    buffer: &matrices,
                    offset: 0,
                    size: wgpu::BufferSize::new(size_of::<Mat4>() as u64),
                }),
            }],
        });
        Self { matrices, matrix_group, stride, drawn: Vec::new(), layers: None }
    }

    fn prepare(&mut self, gpu: &Gpu, map: &ShadowMap, is_hard: bool) -> Result<(), GpuError> {
        self.drawn.clear();
        if is_hard {
            return Ok(());
        }
        for (i, clip) in map.views().iter().filter_map(|v| v.clip).take(VIEWS).enumerate() {
            let depth = clip.row(3) - clip.row(2);
            let turned = DMat4::from_cols(clip.row(0), clip.row(1), depth, clip.row(3)).transpose();
            let (turned, offset) = (turned.as_mat4(), i as u64 * u64::from(self.stride));
            let columns = turned.to_cols_array();
            gpu.queue.write_buffer(&self.matrices, offset, bytemuck::bytes_of(&columns));
            self.drawn.push(turned);
        }
        let needed = self.drawn.len();
        if needed > 0 && !self.layers.as_ref().is_some_and(|l| l.has_room(map.size(), needed)) {
            self.layers = Some(depth_layers(gpu, map.size(), needed as u32)?);
        }
        Ok(())
    }

    /// Records the passes and gives the number of triangles drawn.
    fn encode(&self, frame: &Frame<'_>, map: &ShadowMap, recorder: &mut Recorder<'_>) -> u64 {
        let Some(layers) = &self.layers else { return 0 };
        let convention = DepthConvention::REVERSED_F32;
        let mut triangles = 0;
        let views = map.light_views(frame).zip(&self.drawn).zip(&layers.each);
        for (i, ((view, clip), layer)) in views.enumerate() {
            let mut pass = recorder.depth_pass("soft/far-sides", layer, convention.clear());
            let (bind_group, offset) = (&self.matrix_group, i as u32 * self.stride);
            let view = LightView { clip: *clip, bind_group, offset, ..view };
            triangles += frame.casters.draw(&view, &mut pass).triangles;
        }
        triangles
    }

    fn view(&self) -> Option<&wgpu::TextureView> {
        self.layers.as_ref().map(|layers| &layers.whole)
    }

    fn bytes(&self) -> u64 {
        self.layers.as_ref().map_or(0, Layers::bytes) + self.matrices.size()
    }
}

fn depth_layers(gpu: &Gpu, size: u32, count: u32) -> Result<Layers, GpuError> {
    let usage = wgpu::TextureUsages::RENDER_ATTACHMENT;
    Layers::new(gpu, "far sides", ShadowMap::FORMAT, (size, count), usage)
}

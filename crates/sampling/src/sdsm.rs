//! Sample distribution shadow maps.

use antumbra_gpu::{
    BindGroupCache, Expectation, Frame, Gpu, GpuError, Recorder, Technique, TechniqueConfig, bind,
    entries,
};
use antumbra_map::{
    Arrange, Drawing, Fitting, Layout, Plain, Refit, Resolve, SeenView, ShadowMap, Sight, basis,
    fit_seen,
};
use antumbra_scene::Light;
use antumbra_shaders::{module, source};
use glam::{DVec2, DVec3, DVec4};
use serde::{Deserialize, Serialize};

use crate::cascade_fit::{no_view, span};
use crate::{Eye, over_map};

/// Sample distribution shadow maps (Lauritzen, Salvi, Lefohn 2011): cascades whose slices and windows are measured, on
/// the GPU, from the view samples themselves. Nothing is read back: matrices are made where they are used.
///
/// Each window holds the samples of its slice that casters may shadow, and no more than a texel's step beyond. Serves
/// directional light and perspective cameras; otherwise everything is as without cascades.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Sdsm<E = Plain> {
    /// The technique over the maps, by default the plain test.
    pub of: E,
    /// Number of cascades, 1 to 8, default 4. Memory and depth passes grow with it.
    pub count: u32,
    /// Cuts between clusters of depths, by k-means in 1024 logarithmic bins, instead of logarithmically from the
    /// nearest to the farthest sample. Default false. Where depths have a gap, as between what is held in the hand
    /// and a landscape, no cascade is spent on it.
    pub clusters: bool,
    /// Share of a map's half width at its end over which it hands over to the next, 0 to 0.5, default 0.1.
    pub blend: f32,
    /// Draws into each cascade those clusters of triangles only that reach its window, chosen on the GPU since the CPU does
    /// not know the windows; default true. Visibility does not change by a bit. Costs a pass over the clusters a cascade,
    /// and room for the indices of all triangles; without it every cascade draws all casters that matter for what is seen.
    /// For casters in clusters ([`antumbra_gpu::Casters::clusters`]).
    pub cull: bool,
    /// Lets the last slices, as many as leave the least error, share their maps out in tiles of what they see together;
    /// default true. A slice of the depths of a landscape seen from above is as wide as all of it. The error is the mean
    /// displacement of an edge in pixels: a texel's sides, divided by the depth, over all samples.
    pub tiles: bool,
}

impl<E: Default> Default for Sdsm<E> {
    fn default() -> Self {
        Self { of: E::default(), count: 4, clusters: false, blend: 0.1, cull: true, tiles: true }
    }
}

impl<E> Sdsm<E> {
    /// Fits by samples what is lit directionally, and everything else by `others`.
    ///
    /// # Errors
    /// A setting out of range.
    pub fn arrange(&self, others: Box<dyn Arrange>) -> Result<Box<dyn Arrange>, GpuError> {
        if !(1..=8).contains(&self.count) {
            let (value, fix) = (self.count.to_string(), "use 1 to 8");
            return Err(GpuError::Invalid { what: "number of cascades", value, fix });
        }
        if !(0.0..=0.5).contains(&self.blend) {
            let fix = "use 0 to 0.5 of a cascade";
            return Err(GpuError::Invalid { what: "blend", value: self.blend.to_string(), fix });
        }
        let &Self { of: _, count, clusters, blend, cull, tiles } = self;
        let settings = Sdsm { of: (), count, clusters, blend, cull, tiles };
        Ok(Box::new(Measuring { settings, others }))
    }
}

impl<E: TechniqueConfig> TechniqueConfig for Sdsm<E> {
    fn build(&self, gpu: &Gpu) -> Result<Box<dyn Technique>, GpuError> {
        over_map(gpu, &self.of, |others| self.arrange(others))
    }

    fn set_map_size(&mut self, size: u32) {
        self.of.set_map_size(size);
    }

    fn expectation(&self, case: &str) -> Option<Expectation> {
        self.of.expectation(case)
    }
}

/// The arrangement.
#[derive(Debug)]
struct Measuring {
    settings: Sdsm<()>,
    others: Box<dyn Arrange>,
}

impl Arrange for Measuring {
    fn layout(&self, light: &Light) -> Layout {
        if !matches!(light, Light::Directional { .. }) {
            return self.others.layout(light);
        }
        let count = self.settings.count;
        Layout {
            slots: vec![
                module("layout", "sampling::cascade_by_map"),
                module("map::shadow", "sampling::cascade_shadow"),
                module("map::looked_up", "sampling::cascade_looked_up"),
                source("cascades", format!("const CASCADES: i32 = {count};")),
            ],
            views: count as usize + 1,
            drawing: Drawing::Matrix,
        }
    }

    /// As a single map; where samples can be measured, once for each cascade.
    fn fit(
        &self,
        frame: &Frame<'_>,
        hull: &[DVec3],
        sight: Option<&Sight<'_>>,
        fitting: &Fitting,
    ) -> Result<Vec<SeenView>, GpuError> {
        if !matches!(frame.light, Light::Directional { .. }) {
            return self.others.fit(frame, hull, sight, fitting);
        }
        let whole = fit_seen(frame.light, hull, sight, fitting)?;
        let light = whole[0].view.light;
        let measured =
            frame.camera.as_ref().and_then(Eye::new).is_some() && fitting.usable() >= 1.0;
        let mut views = whole;
        let border = if measured {
            views = vec![views[0].clone(); self.settings.count as usize];
            let border = 1.0 - 2.0 * f64::from(fitting.guard) / f64::from(fitting.size);
            let band = (f64::from(self.settings.blend) * border).max(1e-6);
            DVec4::new(border, 1.0 / band, self.others.spread(frame.light), f64::from(f32::MAX))
        } else {
            views.resize(self.settings.count as usize, no_view(light));
            DVec4::new(1.0, f64::from(f32::MAX), 0.0, 0.0)
        };
        views.push(no_view(border));
        Ok(views)
    }

    fn refit(&self, gpu: &Gpu, light: &Light) -> Result<Option<Box<dyn Refit>>, GpuError> {
        if !matches!(light, Light::Directional { .. }) {
            return self.others.refit(gpu, light);
        }
        Ok(Some(Box::new(Passes::new(gpu, self.settings)?)))
    }
}

/// `Fit` of `sampling/sdsm.wesl`.
#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
struct Fit {
    plane: [f32; 4],
    right: [f32; 4],
    up: [f32; 4],
    casters: [f32; 4],
    depths: [f32; 4],
    count: u32,
    clusters: u32,
    stride: u32,
    tiles: u32,
}

/// Bytes of `Measured` in `sampling/sdsm.wesl`.
const MEASURED: u64 = 4 * (2 + 32 + 8 + 8 + 1024);

/// The passes that measure samples and make matrices of them.
#[derive(Debug)]
struct Passes {
    settings: Sdsm<()>,
    /// In order, and whether each takes a thread a sample.
    pipelines: [(wgpu::ComputePipeline, bool); 5],
    layout: wgpu::BindGroupLayout,
    /// What is uploaded and what is measured, once there was something to measure.
    buffers: Option<[wgpu::Buffer; 2]>,
    group: BindGroupCache<(wgpu::TextureView, wgpu::Buffer, wgpu::Buffer)>,
    active: bool,
}

impl Passes {
    fn new(gpu: &Gpu, settings: Sdsm<()>) -> Result<Self, GpuError> {
        const CS: wgpu::ShaderStages = wgpu::ShaderStages::COMPUTE;
        let device = &gpu.device;
        let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("sample distribution"),
            entries: &[
                entries::uniform(0, CS),
                entries::texels(1, CS, false),
                entries::write_storage(2, CS),
                entries::write_storage(3, CS),
                entries::write_storage(4, CS),
            ],
        });
        let shader =
            gpu.shader("sample distribution", antumbra_shaders::link("sampling::sdsm", &[])?);
        let pipelines = [
            ("clear", false),
            ("measure_depths", true),
            ("split", false),
            ("measure_bounds", true),
            ("fit_windows", false),
        ]
        .map(|(entry, samples)| {
            (gpu.compute_pipeline("sample distribution", &shader, entry, &[&layout]), samples)
        });
        Ok(Self {
            settings,
            pipelines,
            layout,
            buffers: None,
            group: BindGroupCache::default(),
            active: false,
        })
    }
}

fn buffers(gpu: &Gpu) -> [wgpu::Buffer; 2] {
    let buffer = |label, size, usage| {
        gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some(label),
            size,
            usage,
            mapped_at_creation: false,
        })
    };
    let uniform = wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST;
    [
        buffer("sample distribution: fit", size_of::<Fit>() as u64, uniform),
        buffer("measured samples", MEASURED, wgpu::BufferUsages::STORAGE),
    ]
}

impl Refit for Passes {
    fn prepare(&mut self, gpu: &Gpu, frame: &Frame<'_>, map: &ShadowMap) -> Result<(), GpuError> {
        let eye = frame.camera.as_ref().and_then(Eye::new);
        // Without a layer there is nothing to fit.
        let Some(eye) = eye.filter(|_| {
            map.views().first().is_some_and(|v| v.clip.is_some())
                && f64::from(map.size()) > 2.0 * f64::from(map.guard()) + 1.0
        }) else {
            self.active = false;
            return Ok(());
        };
        self.active = true;
        let to_light = frame.light.towards(frame.origin, DVec2::splat(0.5)).normalize();
        let rows = basis(to_light);
        let along = |i: usize| span(map.hull().iter().map(|p| rows.row(i).dot(*p)));
        let (s, t) = (along(0), along(1));
        let casters = map.hull().iter().map(|p| p.distance(eye.position)).fold(0.0, f64::max);
        // Samples beyond these depths count as at them. Receivers may be farther than casters, but what is shadowed
        // is seldom farther by more than twice.
        let mut far = 2.0 * casters;
        frame.casters.bodies(&mut |body| {
            let corners = body.bounds.corners().map(|p| (p - frame.origin).distance(eye.position));
            far = corners.into_iter().fold(far, f64::max);
        });
        let far = far.min(eye.far).max(eye.near * 2.0);
        let farthest = map.hull().iter().map(|p| p.length()).fold(s.1 - s.0, f64::max);
        let least = (farthest * 2f64.powi(-20)).max(f64::from(f32::MIN_POSITIVE));
        let size = f64::from(map.size());
        let usable = size - 2.0 * f64::from(map.guard()) - 1.0;
        let plane = eye.half_space(0.0, true);
        let fit = Fit {
            plane: plane.as_vec4().to_array(),
            right: rows.row(0).extend(map.guard().into()).as_vec4().to_array(),
            up: rows.row(1).extend(size).as_vec4().to_array(),
            casters: [s.0, t.0, s.1, t.1].map(|v| v as f32),
            depths: [eye.near, far, least, usable].map(|v| v as f32),
            count: self.settings.count,
            clusters: self.settings.clusters.into(),
            stride: map.matrices().1 / 16,
            tiles: self.settings.tiles.into(),
        };
        let [uploaded, _] = self.buffers.get_or_insert_with(|| buffers(gpu));
        gpu.queue.write_buffer(uploaded, 0, bytemuck::bytes_of(&fit));
        Ok(())
    }

    fn encode(
        &mut self,
        gpu: &Gpu,
        frame: &Frame<'_>,
        map: &ShadowMap,
        resolve: &Resolve,
        recorder: &mut Recorder<'_>,
    ) {
        let Some([fit, measured]) = self.buffers.as_ref().filter(|_| self.active) else { return };
        let key = (
            frame.samples.positions_view.clone(),
            resolve.views().clone(),
            map.matrices().0.clone(),
        );
        let layout = &self.layout;
        let group = self.group.get(key, |(positions, views, matrices)| {
            gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("sample distribution"),
                layout,
                entries: &[
                    bind::buffer(0, fit),
                    bind::texture(1, positions),
                    bind::buffer(2, measured),
                    bind::buffer(3, views),
                    bind::buffer(4, matrices),
                ],
            })
        });
        let (width, height) = frame.samples.size();
        let mut pass = recorder.compute_pass("sampling/sdsm");
        pass.set_bind_group(0, group, &[]);
        for (pipeline, samples) in &self.pipelines {
            pass.set_pipeline(pipeline);
            let groups = if *samples { (width.div_ceil(16), height.div_ceil(16)) } else { (1, 1) };
            pass.dispatch_workgroups(groups.0, groups.1, 1);
        }
    }

    fn culls(&self) -> bool {
        self.settings.cull
    }

    fn bytes(&self) -> u64 {
        self.buffers.iter().flatten().map(wgpu::Buffer::size).sum()
    }
}

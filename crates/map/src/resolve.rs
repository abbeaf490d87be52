//! Visibility of view samples through a depth map: a layout and an estimator, linked.

use antumbra_gpu::{BindGroupCache, Gpu, GpuError, Recorder, ViewSamples, bind, entries};

use crate::{DepthConvention, Estimator, Layout, MapRead, ShadowView};

/// The compute pass from view samples to visibility, for one layout and one estimator.
///
/// The depth map may be anyone's: a `D2Array` view of a depth texture (depth aspect), described by one
/// [`ShadowView`] for each view of the layout. An estimator over a store reads the store's view instead.
#[derive(Debug)]
pub struct Resolve {
    pipeline: wgpu::ComputePipeline,
    frame_layout: wgpu::BindGroupLayout,
    map_layout: wgpu::BindGroupLayout,
    sampler: wgpu::Sampler,
    views: wgpu::Buffer,
    views_of_layout: usize,
    frame_group: BindGroupCache<[wgpu::TextureView; 3]>,
    map_group: BindGroupCache<wgpu::TextureView>,
    group: Option<wgpu::BindGroup>,
    layout_group: Option<wgpu::BindGroup>,
}

impl Resolve {
    /// Links and compiles the pass.
    ///
    /// # Errors
    /// An estimator or a layout whose shader does not link.
    pub fn new(
        gpu: &Gpu,
        layout: &Layout,
        estimator: &Estimator,
        convention: DepthConvention,
    ) -> Result<Self, GpuError> {
        Self::with_group(gpu, layout, estimator, convention, None)
    }

    /// As [`Resolve::new`], for an estimator that reads more than its map: what `group` says, in bind group 2
    /// ([`Resolve::set_group`]).
    ///
    /// # Errors
    /// As [`Resolve::new`].
    pub fn with_group(
        gpu: &Gpu,
        layout: &Layout,
        estimator: &Estimator,
        convention: DepthConvention,
        group: Option<&wgpu::BindGroupLayout>,
    ) -> Result<Self, GpuError> {
        Self::with_groups(gpu, layout, estimator, convention, [group, None])
    }

    /// As [`Resolve::with_group`], for a layout that reads more than its views, too: bind groups 2 and 3
    /// ([`Resolve::set_group`], [`Resolve::set_layout_group`]).
    ///
    /// # Errors
    /// As [`Resolve::new`].
    pub fn with_groups(
        gpu: &Gpu,
        layout: &Layout,
        estimator: &Estimator,
        convention: DepthConvention,
        [group, layout_group]: [Option<&wgpu::BindGroupLayout>; 2],
    ) -> Result<Self, GpuError> {
        const CS: wgpu::ShaderStages = wgpu::ShaderStages::COMPUTE;
        let device = &gpu.device;
        let frame_layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("resolve: frame"),
            entries: &[
                entries::texels(0, CS, false),
                entries::texels(1, CS, false),
                entries::write_texture(2, CS, wgpu::TextureFormat::R32Float),
            ],
        });
        let map = match estimator.read {
            MapRead::Comparison => entries::depth_array(1, CS),
            MapRead::Texels | MapRead::Gathered => entries::texels(1, CS, true),
            MapRead::Unsigned => entries::unsigned_array(1, CS),
        };
        let (sampling, compare) = match estimator.read {
            MapRead::Gathered => (entries::nearest_sampler(2, CS), None),
            _ => (entries::comparison_sampler(2, CS), Some(convention.compare())),
        };
        let map_layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("resolve: map"),
            entries: &[entries::storage(0, CS), map, sampling],
        });
        let groups = [Some(&frame_layout), Some(&map_layout), group, layout_group];
        let used = groups.iter().rposition(Option::is_some).map_or(0, |last| last + 1);
        let mut slots = estimator.slots.clone();
        slots.extend(layout.slots.iter().cloned());
        let shader = gpu.shader("resolve", antumbra_shaders::link("map::resolve", &slots)?);
        let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some("resolve"),
            layout: Some(&device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
                label: Some("resolve"),
                bind_group_layouts: &groups[..used],
                immediate_size: 0,
            })),
            module: &shader,
            entry_point: Some("resolve"),
            compilation_options: Default::default(),
            cache: None,
        });
        let filter = match estimator.read {
            MapRead::Gathered => wgpu::FilterMode::Nearest,
            _ => wgpu::FilterMode::Linear,
        };
        let sampler = device.create_sampler(&wgpu::SamplerDescriptor {
            label: Some("shadow map"),
            mag_filter: filter,
            min_filter: filter,
            compare,
            ..Default::default()
        });
        let views = device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("shadow views"),
            size: (layout.views * size_of::<ShadowView>()) as u64,
            usage: wgpu::BufferUsages::STORAGE
                | wgpu::BufferUsages::COPY_DST
                | wgpu::BufferUsages::COPY_SRC,
            mapped_at_creation: false,
        });
        Ok(Self {
            pipeline,
            frame_layout,
            map_layout,
            sampler,
            views,
            views_of_layout: layout.views,
            frame_group: BindGroupCache::default(),
            map_group: BindGroupCache::default(),
            group: None,
            layout_group: None,
        })
    }

    /// Uploads the views of this frame.
    ///
    /// # Errors
    /// A number of views that is not the layout's.
    pub fn set_views(&self, gpu: &Gpu, views: &[ShadowView]) -> Result<(), GpuError> {
        if views.len() != self.views_of_layout {
            return Err(GpuError::Invalid {
                what: "number of shadow views",
                value: views.len().to_string(),
                fix: "give as many views as the layout has",
            });
        }
        gpu.queue.write_buffer(&self.views, 0, bytemuck::cast_slice(views));
        Ok(())
    }

    /// The views as the shader has them, an array of [`ShadowView`]; usages `STORAGE`, `COPY_DST` and `COPY_SRC`.
    #[must_use]
    pub fn views(&self) -> &wgpu::Buffer {
        &self.views
    }

    /// Sets what the estimator reads beside its map, from now on.
    pub fn set_group(&mut self, group: Option<&wgpu::BindGroup>) {
        self.group = group.cloned();
    }

    /// Sets what the layout reads beside its views, from now on.
    pub fn set_layout_group(&mut self, group: Option<&wgpu::BindGroup>) {
        self.layout_group = group.cloned();
    }

    /// Records the pass: visibility of `samples` through `map` into `visibility` (`R32Float`, storage).
    pub fn encode(
        &mut self,
        gpu: &Gpu,
        recorder: &mut Recorder<'_>,
        samples: &ViewSamples,
        map: &wgpu::TextureView,
        visibility: &wgpu::TextureView,
    ) {
        let device = &gpu.device;
        let key =
            [samples.positions_view.clone(), samples.normals_view.clone(), visibility.clone()];
        let frame_group = self.frame_group.get(key, |[positions, normals, output]| {
            device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("resolve: frame"),
                layout: &self.frame_layout,
                entries: &[
                    bind::texture(0, positions),
                    bind::texture(1, normals),
                    bind::texture(2, output),
                ],
            })
        });
        let map_group = self.map_group.get(map.clone(), |map| {
            device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("resolve: map"),
                layout: &self.map_layout,
                entries: &[
                    bind::buffer(0, &self.views),
                    bind::texture(1, map),
                    bind::sampler(2, &self.sampler),
                ],
            })
        });
        let (width, height) = samples.size();
        let mut pass = recorder.compute_pass("map/resolve");
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, frame_group, &[]);
        pass.set_bind_group(1, map_group, &[]);
        if let Some(group) = &self.group {
            pass.set_bind_group(2, group, &[]);
        }
        if let Some(group) = &self.layout_group {
            pass.set_bind_group(3, group, &[]);
        }
        pass.dispatch_workgroups(width.div_ceil(8), height.div_ceil(8), 1);
    }
}

//! Visibility of view samples through a depth map: a layout and an estimator, linked.

use antumbra_gpu::{BindGroupCache, Gpu, GpuError, Recorder, ViewSamples, bind, entries};
use antumbra_shaders::module;

use crate::{DepthConvention, Estimator, Layout, ShadowView};

/// The compute pass from view samples to visibility, for one layout and one estimator.
///
/// The depth map may be anyone's: a `D2Array` view of a depth texture (depth aspect), described by one
/// [`ShadowView`] for each view of the layout.
#[derive(Debug)]
pub struct Resolve {
    pipeline: wgpu::ComputePipeline,
    frame_layout: wgpu::BindGroupLayout,
    map_layout: wgpu::BindGroupLayout,
    sampler: wgpu::Sampler,
    views: wgpu::Buffer,
    layout: Layout,
    frame_group: BindGroupCache<[wgpu::TextureView; 3]>,
    map_group: BindGroupCache<wgpu::TextureView>,
}

impl Resolve {
    /// Links and compiles the pass.
    ///
    /// # Errors
    /// An estimator whose shader does not link.
    pub fn new(
        gpu: &Gpu,
        layout: Layout,
        estimator: &Estimator,
        convention: DepthConvention,
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
        let map = if estimator.comparison_sampler {
            entries::depth_array(1, CS)
        } else {
            entries::texels(1, CS, true)
        };
        let map_layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("resolve: map"),
            entries: &[entries::storage(0, CS), map, entries::comparison_sampler(2, CS)],
        });
        let mut slots = estimator.slots.clone();
        slots.push(module("layout", layout.module()));
        let shader = gpu.shader("resolve", antumbra_shaders::link("map::resolve", &slots)?);
        let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some("resolve"),
            layout: Some(&device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
                label: Some("resolve"),
                bind_group_layouts: &[Some(&frame_layout), Some(&map_layout)],
                immediate_size: 0,
            })),
            module: &shader,
            entry_point: Some("resolve"),
            compilation_options: Default::default(),
            cache: None,
        });
        let sampler = device.create_sampler(&wgpu::SamplerDescriptor {
            label: Some("shadow comparison"),
            mag_filter: wgpu::FilterMode::Linear,
            min_filter: wgpu::FilterMode::Linear,
            compare: Some(convention.compare()),
            ..Default::default()
        });
        let views = device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("shadow views"),
            size: (layout.views() * size_of::<ShadowView>()) as u64,
            usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        Ok(Self {
            pipeline,
            frame_layout,
            map_layout,
            sampler,
            views,
            layout,
            frame_group: BindGroupCache::default(),
            map_group: BindGroupCache::default(),
        })
    }

    /// Uploads the views of this frame.
    ///
    /// # Errors
    /// A number of views that is not the layout's.
    pub fn set_views(&self, gpu: &Gpu, views: &[ShadowView]) -> Result<(), GpuError> {
        if views.len() != self.layout.views() {
            return Err(GpuError::Invalid {
                what: "number of shadow views",
                value: views.len().to_string(),
                fix: "give one view for a single layout, six for a cube",
            });
        }
        gpu.queue.write_buffer(&self.views, 0, bytemuck::cast_slice(views));
        Ok(())
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
        pass.dispatch_workgroups(width.div_ceil(8), height.div_ceil(8), 1);
    }
}

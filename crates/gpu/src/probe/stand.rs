//! What the checks of the probe are made of: drawing into tiny depth textures, and reading values.

use std::num::NonZeroU32;

use crate::{Gpu, GpuError, bind, read_buffer};

/// A device, and the probe's shader.
pub(super) struct Stand<'a> {
    pub(super) gpu: &'a Gpu,
    wgsl: String,
}

/// How triangles are drawn.
#[derive(Clone)]
pub(super) struct Draw<'a> {
    pub(super) load: wgpu::LoadOp<f32>,
    pub(super) compare: wgpu::CompareFunction,
    pub(super) unclipped: bool,
    pub(super) views: Option<NonZeroU32>,
    pub(super) stamps: Option<wgpu::RenderPassTimestampWrites<'a>>,
}

impl Default for Draw<'_> {
    /// As the library draws: reversed depth.
    fn default() -> Self {
        Self {
            load: wgpu::LoadOp::Clear(0.0),
            compare: wgpu::CompareFunction::Greater,
            unclipped: false,
            views: None,
            stamps: None,
        }
    }
}

/// A corner in clip space.
pub(super) type Corner = [f32; 4];

/// Two triangles over a rectangle of a target of `size`, given in pixels from its upper left corner.
pub(super) fn quad(size: [u32; 2], x: [f32; 2], y: [f32; 2], z: f32) -> [Corner; 6] {
    quad_of(size, [[x[0], y[0], z], [x[1], y[0], z], [x[0], y[1], z], [x[1], y[1], z]])
}

/// Two triangles with the corners upper left, upper right, lower left, lower right: pixels and depth.
pub(super) fn quad_of(size: [u32; 2], corners: [[f32; 3]; 4]) -> [Corner; 6] {
    let [a, b, c, d] = corners
        .map(|[x, y, z]| [x / size[0] as f32 * 2.0 - 1.0, 1.0 - y / size[1] as f32 * 2.0, z, 1.0]);
    [a, b, d, a, d, c]
}

impl<'a> Stand<'a> {
    pub(super) fn new(gpu: &'a Gpu) -> Result<Self, GpuError> {
        Ok(Self { gpu, wgsl: antumbra_shaders::link("gpu::probe", &[])? })
    }

    /// A texture for every use that the checks make of it.
    pub(super) fn texture(
        &self,
        format: wgpu::TextureFormat,
        size: [u32; 2],
        layers: u32,
    ) -> Result<wgpu::Texture, GpuError> {
        use wgpu::TextureUsages as Usage;
        let more = if format.is_depth_stencil_format() {
            Usage::RENDER_ATTACHMENT
        } else {
            Usage::STORAGE_BINDING | Usage::COPY_DST
        };
        self.gpu.create_texture(
            "probe",
            &wgpu::TextureDescriptor {
                label: Some("probe"),
                size: wgpu::Extent3d {
                    width: size[0],
                    height: size[1],
                    depth_or_array_layers: layers,
                },
                mip_level_count: 1,
                sample_count: 1,
                dimension: wgpu::TextureDimension::D2,
                format,
                usage: Usage::TEXTURE_BINDING | Usage::COPY_SRC | more,
                view_formats: &[],
            },
        )
    }

    /// A depth texture of the format that the library draws.
    pub(super) fn depth(&self, size: [u32; 2], layers: u32) -> Result<wgpu::Texture, GpuError> {
        self.texture(wgpu::TextureFormat::Depth32Float, size, layers)
    }

    /// Draws triangles into `target` and submits; without any it only loads or clears.
    pub(super) fn draw(&self, target: &wgpu::TextureView, corners: &[Corner], how: &Draw<'_>) {
        let device = &self.gpu.device;
        let module = self.gpu.shader("probe", self.wgsl.clone());
        let pipeline = device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some("probe"),
            layout: None,
            vertex: wgpu::VertexState {
                module: &module,
                entry_point: Some("draw"),
                compilation_options: Default::default(),
                buffers: &[Some(wgpu::VertexBufferLayout {
                    array_stride: 16,
                    step_mode: wgpu::VertexStepMode::Vertex,
                    attributes: &wgpu::vertex_attr_array![0 => Float32x4],
                })],
            },
            primitive: wgpu::PrimitiveState {
                unclipped_depth: how.unclipped,
                ..Default::default()
            },
            depth_stencil: Some(wgpu::DepthStencilState {
                format: wgpu::TextureFormat::Depth32Float,
                depth_write_enabled: Some(true),
                depth_compare: Some(how.compare),
                stencil: Default::default(),
                bias: Default::default(),
            }),
            multisample: Default::default(),
            fragment: None,
            multiview_mask: how.views,
            cache: None,
        });
        let vertices = (!corners.is_empty()).then(|| {
            let bytes = bytemuck::cast_slice(corners);
            self.gpu.buffer("probe", bytes, wgpu::BufferUsages::VERTEX)
        });
        let mut encoder = device.create_command_encoder(&Default::default());
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("probe"),
            color_attachments: &[],
            depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                view: target,
                depth_ops: Some(wgpu::Operations { load: how.load, store: wgpu::StoreOp::Store }),
                stencil_ops: None,
            }),
            timestamp_writes: how.stamps.clone(),
            multiview_mask: how.views,
            ..Default::default()
        });
        if let Some(vertices) = vertices {
            pass.set_pipeline(&pipeline);
            pass.set_vertex_buffer(0, vertices.slice(..));
            pass.draw(0..corners.len() as u32, 0..1);
        }
        drop(pass);
        self.gpu.queue.submit([encoder.finish()]);
    }

    /// All texels of all layers by `textureLoad`, as the library reads depth.
    pub(super) fn load(&self, texture: &wgpu::Texture) -> Result<Vec<f32>, GpuError> {
        let size = texture.size();
        let count = size.width * size.height * size.depth_or_array_layers;
        let view = whole(texture);
        let groups = [size.width, size.height, size.depth_or_array_layers];
        self.compute("load", None, &[bind::texture(2, &view)], groups, count)
    }

    /// One value for each place: the entry point `entry` with the resources at bindings 2 and 3.
    pub(super) fn at_places(
        &self,
        entry: &str,
        places: &[[f32; 4]],
        resources: &[wgpu::BindGroupEntry<'_>],
    ) -> Result<Vec<f32>, GpuError> {
        let count = places.len() as u32;
        self.compute(entry, Some(places), resources, [count, 1, 1], count)
    }

    /// Stores one value a texel by `textureStore`.
    pub(super) fn store(&self, texture: &wgpu::Texture, values: &[f32]) {
        let places: Vec<[f32; 4]> = values.iter().map(|v| [0.0, 0.0, *v, 0.0]).collect();
        let view = texture.create_view(&Default::default());
        let size = texture.size();
        let groups = [size.width, size.height, 1];
        self.dispatch("store", None, Some(&places), &[bind::texture(2, &view)], groups);
    }

    fn compute(
        &self,
        entry: &str,
        places: Option<&[[f32; 4]]>,
        resources: &[wgpu::BindGroupEntry<'_>],
        groups: [u32; 3],
        count: u32,
    ) -> Result<Vec<f32>, GpuError> {
        let size = u64::from(count) * 4;
        let values = self.gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("probe"),
            size,
            usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC,
            mapped_at_creation: false,
        });
        self.dispatch(entry, Some(&values), places, resources, groups);
        let bytes = read_buffer(self.gpu, &values, size)?;
        Ok(bytemuck::pod_collect_to_vec(&bytes))
    }

    fn dispatch(
        &self,
        entry: &str,
        values: Option<&wgpu::Buffer>,
        places: Option<&[[f32; 4]]>,
        resources: &[wgpu::BindGroupEntry<'_>],
        [x, y, z]: [u32; 3],
    ) {
        let device = &self.gpu.device;
        let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some("probe"),
            layout: None,
            module: &self.gpu.shader("probe", self.wgsl.clone()),
            entry_point: Some(entry),
            compilation_options: Default::default(),
            cache: None,
        });
        let places = places.map(|places| {
            let bytes = bytemuck::cast_slice(places);
            self.gpu.buffer("probe", bytes, wgpu::BufferUsages::STORAGE)
        });
        let mut entries = resources.to_vec();
        entries.extend(values.map(|b| bind::buffer(0, b)));
        entries.extend(places.as_ref().map(|b| bind::buffer(1, b)));
        let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("probe"),
            layout: &pipeline.get_bind_group_layout(0),
            entries: &entries,
        });
        let mut encoder = device.create_command_encoder(&Default::default());
        let mut pass = encoder.begin_compute_pass(&Default::default());
        pass.set_pipeline(&pipeline);
        pass.set_bind_group(0, &group, &[]);
        pass.dispatch_workgroups(x, y, z);
        drop(pass);
        self.gpu.queue.submit([encoder.finish()]);
    }
}

/// View of one layer, to draw into.
pub(super) fn layer(texture: &wgpu::Texture, index: u32) -> wgpu::TextureView {
    texture.create_view(&wgpu::TextureViewDescriptor {
        dimension: Some(wgpu::TextureViewDimension::D2),
        base_array_layer: index,
        array_layer_count: Some(1),
        ..Default::default()
    })
}

/// View of all layers, to read from.
pub(super) fn whole(texture: &wgpu::Texture) -> wgpu::TextureView {
    texture.create_view(&wgpu::TextureViewDescriptor {
        dimension: Some(wgpu::TextureViewDimension::D2Array),
        ..Default::default()
    })
}

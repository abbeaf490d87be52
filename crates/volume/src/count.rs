//! The passes that draw faces of volumes, count them at each view sample, and turn counts into visibility.

use antumbra_gpu::{
    BindGroupCache, CasterTriangles, Gpu, GpuError, Recorder, ViewSamples, bind, entries,
};
use glam::Vec4;
use serde::{Deserialize, Serialize};

use crate::VolumeFaces;
use crate::light::Perspective;

/// What counts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Counter {
    /// A 32-bit integer a sample, in a buffer that fragments add to: 4 bytes a sample and an atomic addition a
    /// face. Exact up to 2^31 volumes. Fragments that write to buffers are beyond WebGPU's compatibility mode.
    #[default]
    Wide,
    /// The stencil buffer, by fixed function (Heidmann 1991): a byte a sample. It counts modulo 256, so that a
    /// sample in a multiple of 256 volumes is lit.
    Stencil,
}

/// Counters for the samples of a view, and the passes that fill and read them.
#[derive(Debug)]
pub(crate) struct Counting {
    counter: Counter,
    sides: wgpu::RenderPipeline,
    near_caps: wgpu::RenderPipeline,
    far_caps: wgpu::RenderPipeline,
    cast_caps: wgpu::RenderPipeline,
    draw_layout: wgpu::BindGroupLayout,
    resolve: wgpu::ComputePipeline,
    resolve_layout: wgpu::BindGroupLayout,
    view: wgpu::Buffer,
    base: wgpu::Buffer,
    target: Option<Target>,
    draw_group: BindGroupCache<(Vec<wgpu::Buffer>, [wgpu::TextureView; 2])>,
    resolve_group: BindGroupCache<(wgpu::Buffer, [wgpu::TextureView; 4])>,
}

/// Counters of a view's size.
#[derive(Debug)]
struct Target {
    size: (u32, u32),
    counts: wgpu::Buffer,
    stencil: wgpu::TextureView,
}

#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
struct ViewUniform {
    clip: [[f32; 4]; 4],
    light: [f32; 4],
    how: [f32; 4],
    eye: [f32; 4],
    cast: [[f32; 4]; 4],
}

/// What one counting pass draws.
#[derive(Clone, Copy)]
pub(crate) struct Draw<'a> {
    pub(crate) triangles: CasterTriangles<'a>,
    pub(crate) faces: &'a VolumeFaces,
    pub(crate) samples: &'a ViewSamples,
    pub(crate) near_caps: bool,
    pub(crate) far_caps: bool,
    /// Whether to start from the number of volumes at each pixel's point of the near plane.
    pub(crate) cast_caps: bool,
}

const FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Stencil8;

impl Counting {
    /// Builds the passes.
    ///
    /// # Errors
    /// A shader that does not link (a fault of this library).
    pub(crate) fn new(gpu: &Gpu, counter: Counter) -> Result<Self, GpuError> {
        let device = &gpu.device;
        let draw_layout = draw_layout(gpu);
        let module = gpu.shader("volume count", antumbra_shaders::link("volume::count", &[])?);
        let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some("volume count"),
            bind_group_layouts: &[Some(&draw_layout)],
            immediate_size: 0,
        });
        let pipeline = |vertex, [wide, stencil]: [&'static str; 2], both_add| {
            let fragment = if counter == Counter::Wide { wide } else { stencil };
            let stencil = stencil_state(counter, both_add);
            faces_pipeline(gpu, &module, &layout, stencil, vertex, fragment)
        };
        let resolve_layout = resolve_layout(gpu);
        let shader = gpu.shader("volume resolve", antumbra_shaders::link("volume::resolve", &[])?);
        let resolve = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some("volume resolve"),
            layout: Some(&device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
                label: Some("volume resolve"),
                bind_group_layouts: &[Some(&resolve_layout)],
                immediate_size: 0,
            })),
            module: &shader,
            entry_point: Some(match counter {
                Counter::Wide => "from_counts",
                Counter::Stencil => "from_stencil",
            }),
            compilation_options: Default::default(),
            cache: None,
        });
        let buffer = |label, size: usize, usage| {
            device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(label),
                size: size as u64,
                usage: usage | wgpu::BufferUsages::COPY_DST,
                mapped_at_creation: false,
            })
        };
        Ok(Self {
            counter,
            sides: pipeline("side", ["add_side", "keep_side"], false),
            near_caps: pipeline("near_cap", ["add_near_cap", "keep_near_cap"], false),
            far_caps: pipeline("far_cap", ["add_far_cap", "keep_far_cap"], false),
            cast_caps: pipeline("cast_cap", ["add_cast_cap", "keep_far_cap"], true),
            draw_layout,
            resolve,
            resolve_layout,
            view: buffer("volume view", size_of::<ViewUniform>(), wgpu::BufferUsages::UNIFORM),
            base: buffer("volume base", 4, wgpu::BufferUsages::STORAGE),
            target: None,
            draw_group: BindGroupCache::default(),
            resolve_group: BindGroupCache::default(),
        })
    }

    /// Uploads the view and makes counters of its size. Faces are cut off at `near`, w in clip space; 0 cuts off only
    /// what is behind the eye.
    ///
    /// # Errors
    /// A failed allocation.
    pub(crate) fn prepare(
        &mut self,
        gpu: &Gpu,
        samples: &ViewSamples,
        view: &Perspective,
        light: Vec4,
        near: f64,
    ) -> Result<(), GpuError> {
        let corners = VolumeFaces::side_corners(light.w == 0.0);
        let uniform = ViewUniform {
            clip: view.camera.clip.as_mat4().to_cols_array_2d(),
            light: light.to_array(),
            how: [view.handedness, near as f32, corners as f32, view.aside(samples.size()) as f32],
            eye: view.camera.eye.as_vec3().extend(1.0).to_array(),
            cast: view.cast(light.as_dvec4()).as_mat4().to_cols_array_2d(),
        };
        gpu.queue.write_buffer(&self.view, 0, bytemuck::bytes_of(&uniform));
        if self.target.as_ref().is_none_or(|t| t.size != samples.size()) {
            self.target = Some(Target::new(gpu, samples.size(), self.counter)?);
        }
        Ok(())
    }

    /// The buffer with the number, one `i32`, that is added to all counts. Zero unless somebody writes it.
    pub(crate) fn base(&self) -> &wgpu::Buffer {
        &self.base
    }

    /// The counters, where they are wide, once prepared: one `i32` a sample, row by row.
    pub(crate) fn counts(&self) -> Option<&wgpu::Buffer> {
        self.target.as_ref().filter(|_| self.counter == Counter::Wide).map(|t| &t.counts)
    }

    /// Records the passes from faces to `visibility`.
    ///
    /// # Errors
    /// A view that was not prepared.
    pub(crate) fn encode(
        &mut self,
        gpu: &Gpu,
        recorder: &mut Recorder<'_>,
        draw: &Draw<'_>,
        visibility: &wgpu::TextureView,
    ) -> Result<(), GpuError> {
        let Some(target) = self.target.as_ref().filter(|t| t.size == draw.samples.size()) else {
            return Err(GpuError::Invalid {
                what: "frame",
                value: "not prepared".to_owned(),
                fix: "call `prepare` with this frame before `encode`",
            });
        };
        recorder.encoder.clear_buffer(&target.counts, 0, None);
        let samples = draw.samples;
        let buffers = vec![
            draw.triangles.positions.clone(),
            draw.triangles.indices.clone(),
            draw.faces.sides.clone(),
            draw.faces.caps.clone(),
            target.counts.clone(),
        ];
        let textures = [samples.positions_view.clone(), samples.normals_view.clone()];
        let group = self.draw_group.get((buffers, textures), |(buffers, textures)| {
            gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("volume count"),
                layout: &self.draw_layout,
                entries: &[
                    bind::buffer(0, &self.view),
                    bind::buffer(1, &buffers[0]),
                    bind::buffer(2, &buffers[1]),
                    bind::buffer(3, &buffers[2]),
                    bind::buffer(4, &buffers[3]),
                    bind::texture(5, &textures[0]),
                    bind::texture(6, &textures[1]),
                    bind::buffer(7, &buffers[4]),
                ],
            })
        });
        let attachment = wgpu::RenderPassDepthStencilAttachment {
            view: &target.stencil,
            depth_ops: None,
            stencil_ops: Some(wgpu::Operations {
                load: wgpu::LoadOp::Clear(0),
                store: match self.counter {
                    Counter::Wide => wgpu::StoreOp::Discard,
                    Counter::Stencil => wgpu::StoreOp::Store,
                },
            }),
        };
        let mut pass = recorder.render_pass("volume/count", &[], Some(attachment));
        pass.set_bind_group(0, group, &[]);
        let draws = &draw.faces.draws;
        if draw.cast_caps {
            pass.set_pipeline(&self.cast_caps);
            pass.draw_indirect(draws, VolumeFaces::CAP_DRAW);
        }
        pass.set_pipeline(&self.sides);
        pass.draw_indirect(draws, 0);
        if draw.near_caps {
            pass.set_pipeline(&self.near_caps);
            pass.draw_indirect(draws, VolumeFaces::CAP_DRAW);
        }
        if draw.far_caps {
            pass.set_pipeline(&self.far_caps);
            pass.draw_indirect(draws, VolumeFaces::CAP_DRAW);
        }
        drop(pass);
        let [positions, normals] = [&samples.positions_view, &samples.normals_view];
        let textures = [positions, normals, &target.stencil, visibility].map(Clone::clone);
        let key = (target.counts.clone(), textures);
        let group =
            self.resolve_group.get(key, |(counts, [positions, normals, stencil, output])| {
                gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
                    label: Some("volume resolve"),
                    layout: &self.resolve_layout,
                    entries: &[
                        bind::buffer(0, &self.view),
                        bind::texture(1, positions),
                        bind::texture(2, normals),
                        bind::buffer(3, counts),
                        bind::buffer(4, &self.base),
                        bind::texture(5, stencil),
                        bind::texture(6, output),
                    ],
                })
            });
        let (width, height) = target.size;
        let mut pass = recorder.compute_pass("volume/resolve");
        pass.set_pipeline(&self.resolve);
        pass.set_bind_group(0, group, &[]);
        pass.dispatch_workgroups(width.div_ceil(8), height.div_ceil(8), 1);
        Ok(())
    }

    /// Bytes of the counters.
    pub(crate) fn bytes(&self) -> u64 {
        let texels = |t: &Target| u64::from(t.size.0) * u64::from(t.size.1);
        self.target.as_ref().map_or(0, |t| t.counts.size() + texels(t))
    }
}

impl Target {
    fn new(gpu: &Gpu, size: (u32, u32), counter: Counter) -> Result<Self, GpuError> {
        let texels = u64::from(size.0) * u64::from(size.1);
        let counts = gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("volume counts"),
            // The stencil needs none; four bytes that nothing counts in.
            size: if counter == Counter::Wide { 4 * texels } else { 4 },
            usage: wgpu::BufferUsages::STORAGE
                | wgpu::BufferUsages::COPY_DST
                | wgpu::BufferUsages::COPY_SRC,
            mapped_at_creation: false,
        });
        // A render pass needs an attachment of the view's size also where buffers count.
        let stencil = gpu.create_texture(
            "volume stencil",
            &wgpu::TextureDescriptor {
                label: Some("volume stencil"),
                size: wgpu::Extent3d { width: size.0, height: size.1, depth_or_array_layers: 1 },
                mip_level_count: 1,
                sample_count: 1,
                dimension: wgpu::TextureDimension::D2,
                format: FORMAT,
                usage: wgpu::TextureUsages::RENDER_ATTACHMENT
                    | wgpu::TextureUsages::TEXTURE_BINDING,
                view_formats: &[],
            },
        )?;
        Ok(Self { size, counts, stencil: stencil.create_view(&Default::default()) })
    }
}

fn draw_layout(gpu: &Gpu) -> wgpu::BindGroupLayout {
    const VS: wgpu::ShaderStages = wgpu::ShaderStages::VERTEX;
    const FS: wgpu::ShaderStages = wgpu::ShaderStages::FRAGMENT;
    gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: Some("volume count"),
        entries: &[
            entries::uniform(0, VS | FS),
            entries::storage(1, VS),
            entries::storage(2, VS),
            entries::storage(3, VS),
            entries::storage(4, VS),
            entries::texels(5, FS, false),
            entries::texels(6, FS, false),
            entries::write_storage(7, FS),
        ],
    })
}

fn resolve_layout(gpu: &Gpu) -> wgpu::BindGroupLayout {
    const CS: wgpu::ShaderStages = wgpu::ShaderStages::COMPUTE;
    gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: Some("volume resolve"),
        entries: &[
            entries::uniform(0, CS),
            entries::texels(1, CS, false),
            entries::texels(2, CS, false),
            entries::storage(3, CS),
            entries::storage(4, CS),
            entries::integers(5, CS),
            entries::write_texture(6, CS, wgpu::TextureFormat::R32Float),
        ],
    })
}

/// What a face does to the stencil: see `reversed` in the shader.
fn stencil_state(counter: Counter, both_add: bool) -> wgpu::StencilState {
    use wgpu::StencilOperation::{DecrementWrap, IncrementWrap};
    if counter == Counter::Wide {
        return wgpu::StencilState::default();
    }
    // Wrapping, so that the order does not matter.
    let step = |pass_op| wgpu::StencilFaceState {
        compare: wgpu::CompareFunction::Always,
        pass_op,
        ..wgpu::StencilFaceState::IGNORE
    };
    wgpu::StencilState {
        front: step(if both_add { IncrementWrap } else { DecrementWrap }),
        back: step(IncrementWrap),
        read_mask: 0xff,
        write_mask: 0xff,
    }
}

fn faces_pipeline(
    gpu: &Gpu,
    module: &wgpu::ShaderModule,
    layout: &wgpu::PipelineLayout,
    stencil: wgpu::StencilState,
    vertex: &'static str,
    fragment: &'static str,
) -> wgpu::RenderPipeline {
    gpu.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some(vertex),
        layout: Some(layout),
        vertex: wgpu::VertexState {
            module,
            entry_point: Some(vertex),
            compilation_options: Default::default(),
            buffers: &[],
        },
        primitive: wgpu::PrimitiveState::default(),
        depth_stencil: Some(wgpu::DepthStencilState {
            format: FORMAT,
            depth_write_enabled: None,
            depth_compare: None,
            stencil,
            bias: Default::default(),
        }),
        multisample: Default::default(),
        fragment: Some(wgpu::FragmentState {
            module,
            entry_point: Some(fragment),
            compilation_options: Default::default(),
            targets: &[],
        }),
        multiview_mask: None,
        cache: None,
    })
}

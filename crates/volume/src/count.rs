//! The passes that draw faces of volumes, count them at each view sample, and turn counts into visibility.

use antumbra_gpu::{
    BindGroupCache, CasterTriangles, Counters, Gpu, GpuError, Recorder, ViewSamples, bind,
    read_buffer,
};
use antumbra_shaders::{link, module};
use glam::Vec4;
use serde::{Deserialize, Serialize};

use crate::doubtful::Doubtful;
use crate::light::Viewer;
use crate::reach::scissor;
use crate::{Savings, VolumeFaces};
use pipelines::{draw_layout, faces_pipeline, resolve_layout, stencil_state};

mod pipelines;

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
    savings: Savings,
    sides: wgpu::RenderPipeline,
    near_caps: wgpu::RenderPipeline,
    far_caps: wgpu::RenderPipeline,
    cast_caps: wgpu::RenderPipeline,
    draw_layout: wgpu::BindGroupLayout,
    resolve: wgpu::ComputePipeline,
    resolve_layout: wgpu::BindGroupLayout,
    view: wgpu::Buffer,
    /// The number of volumes that contain the eye, and whether rounding decides of one: see `volume/eye.wesl`.
    eye_count: wgpu::Buffer,
    zero: wgpu::Buffer,
    /// In the place of volumes' limits where there are none.
    unlimited: wgpu::Buffer,
    doubtful: Doubtful,
    /// The pixels that the light may reach: x, y, width and height.
    scissor: [u32; 4],
    target: Option<Target>,
    draw_group: BindGroupCache<(Vec<wgpu::Buffer>, [wgpu::TextureView; 2])>,
    resolve_group: BindGroupCache<([wgpu::Buffer; 2], [wgpu::TextureView; 4])>,
}

/// Counters of a view's size.
#[derive(Debug)]
struct Target {
    size: (u32, u32),
    counts: wgpu::Buffer,
    /// Fragments of each pixel, where they are counted.
    tally: wgpu::Buffer,
    stencil: wgpu::TextureView,
    doubts: wgpu::Texture,
    doubts_view: wgpu::TextureView,
}

#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
struct ViewUniform {
    rows: [[f32; 4]; 3],
    light: [f32; 4],
    eye: [f32; 4],
    begin: [f32; 4],
    how: [f32; 4],
    cast: [[f32; 4]; 4],
}

/// What is counted for.
#[derive(Clone, Copy)]
pub(crate) struct Request<'a> {
    pub(crate) samples: &'a ViewSamples,
    pub(crate) view: Viewer,
    pub(crate) light: Vec4,
    /// w of the plane from which on faces in front of samples count, 0 for all after the eye.
    pub(crate) near: f64,
    pub(crate) eye: Eye,
    /// Height above a sample up to which what covers it touches it, metres.
    pub(crate) contact: f32,
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
    pub(crate) eye: Eye,
    /// Where volumes have to be drawn, if savings ask for it.
    pub(crate) limits: Option<&'a wgpu::Buffer>,
}

/// What the number of volumes that contain the eye is to the counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Eye {
    /// Nothing.
    Apart,
    /// What they are short of.
    Missing,
    /// What they are short of, and what is added to them.
    Added,
}

const STENCIL: wgpu::TextureFormat = wgpu::TextureFormat::Stencil8;
const DOUBTS: wgpu::TextureFormat = wgpu::TextureFormat::R8Unorm;

impl Counting {
    /// Builds the passes.
    ///
    /// # Errors
    /// Savings that are none, or a shader that does not link (a fault of this library).
    pub(crate) fn new(gpu: &Gpu, counter: Counter, savings: Savings) -> Result<Self, GpuError> {
        savings.check()?;
        let device = &gpu.device;
        let draw_layout = draw_layout(gpu);
        let mut slots = Vec::new();
        if !savings.limits() {
            slots.push(module("volume::limits", "volume::no_limits"));
        }
        if !savings.tally {
            slots.push(module("volume::tally", "volume::no_tally"));
        }
        let module = gpu.shader("volume count", link("volume::count", &slots)?);
        let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some("volume count"),
            bind_group_layouts: &[Some(&draw_layout)],
            immediate_size: 0,
        });
        let pipeline = |vertex, [wide, stencil]: [&'static str; 2]| {
            let fragment = if counter == Counter::Wide { wide } else { stencil };
            let stencil = stencil_state(counter);
            faces_pipeline(gpu, &module, &layout, stencil, vertex, fragment)
        };
        let resolve_layout = resolve_layout(gpu);
        let shader = gpu.shader("volume resolve", link("volume::resolve", &[])?);
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
            savings,
            sides: pipeline("side", ["add_face", "keep_face"]),
            near_caps: pipeline("near_cap", ["add_face", "keep_face"]),
            far_caps: pipeline("far_cap", ["add_face", "keep_face"]),
            cast_caps: pipeline("cast_cap", ["add_cast_cap", "keep_cast_cap"]),
            draw_layout,
            resolve,
            resolve_layout,
            view: buffer("volume view", size_of::<ViewUniform>(), wgpu::BufferUsages::UNIFORM),
            eye_count: buffer("volumes around the eye", 8, wgpu::BufferUsages::STORAGE),
            zero: buffer("no volumes around the eye", 8, wgpu::BufferUsages::STORAGE),
            unlimited: buffer("no limits of volumes", 16, wgpu::BufferUsages::STORAGE),
            doubtful: Doubtful::new(gpu)?,
            scissor: [0; 4],
            target: None,
            draw_group: BindGroupCache::default(),
            resolve_group: BindGroupCache::default(),
        })
    }

    /// Uploads the view and makes counters of its size. Of faces in front of samples those count that are beyond
    /// `near`, w in clip space; with 0 all after the eye.
    ///
    /// # Errors
    /// A failed allocation.
    pub(crate) fn prepare(
        &mut self,
        gpu: &Gpu,
        request: &Request<'_>,
        triangles: u32,
    ) -> Result<(), GpuError> {
        let Request { samples, view, light, near, eye, contact } = *request;
        let uniform = ViewUniform {
            rows: view.rows(),
            light: light.to_array(),
            eye: view.eye.as_vec4().to_array(),
            begin: view.camera.eye.as_vec3().extend(1.0).to_array(),
            how: [near as f32, contact, self.savings.instances() as f32, self.savings.reach()],
            cast: view.cast(light.as_dvec4()).as_mat4().to_cols_array_2d(),
        };
        let (width, height) = samples.size();
        self.scissor = match self.savings.reach {
            Some(reach) if light.w != 0.0 => {
                scissor(light.truncate().as_dvec3(), reach, view.camera.clip, (width, height))
            }
            _ => [0, 0, width, height],
        };
        gpu.queue.write_buffer(&self.view, 0, bytemuck::bytes_of(&uniform));
        self.doubtful.prepare(gpu, triangles, light, eye, self.counter, contact)?;
        if self.target.as_ref().is_none_or(|t| t.size != samples.size()) {
            self.target = Some(Target::new(gpu, samples.size(), self.counter, self.savings.tally)?);
        }
        Ok(())
    }

    /// The buffer for the number of volumes that contain the eye, two `i32`. Zero unless somebody writes it.
    pub(crate) fn eye_count(&self) -> &wgpu::Buffer {
        &self.eye_count
    }

    /// How many samples of the last submitted frame were in doubt, and how many batches of triangles tiles of them asked.
    /// Waits.
    ///
    /// # Errors
    /// A lost device.
    pub(crate) fn read_counters(&self, gpu: &Gpu) -> Result<Counters, GpuError> {
        let asked = self.doubtful.batches.read_asked(gpu)?;
        let mut counters = Counters::from([
            ("doubtful_samples", self.read_doubts(gpu)?),
            ("asked_batches", asked),
        ]);
        counters.extend(self.read_fragments(gpu)?.map(|count| ("volume_fragments", count)));
        Ok(counters)
    }

    fn read_doubts(&self, gpu: &Gpu) -> Result<u64, GpuError> {
        let Some(target) = &self.target else { return Ok(0) };
        let (width, height) = target.size;
        // Rows in buffers begin at multiples of 256 bytes.
        let row = width.next_multiple_of(256);
        let size = u64::from(row) * u64::from(height);
        let buffer = gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("volume doubts"),
            size,
            usage: wgpu::BufferUsages::COPY_SRC | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        encoder.copy_texture_to_buffer(
            target.doubts.as_image_copy(),
            wgpu::TexelCopyBufferInfo {
                buffer: &buffer,
                layout: wgpu::TexelCopyBufferLayout {
                    offset: 0,
                    bytes_per_row: Some(row),
                    rows_per_image: None,
                },
            },
            target.doubts.size(),
        );
        gpu.queue.submit([encoder.finish()]);
        let bytes = read_buffer(gpu, &buffer, size)?;
        let rows = bytes.chunks(row as usize).map(|row| &row[..width as usize]);
        Ok(rows.flatten().filter(|doubt| **doubt != 0).count() as u64)
    }

    /// The counters, where they are wide, once prepared: one `i32` a sample, row by row.
    pub(crate) fn counts(&self) -> Option<&wgpu::Buffer> {
        self.target.as_ref().filter(|_| self.counter == Counter::Wide).map(|t| &t.counts)
    }

    /// How many fragments faces had in the last submitted frame, where they are counted. Waits.
    ///
    /// # Errors
    /// A lost device.
    fn read_fragments(&self, gpu: &Gpu) -> Result<Option<u64>, GpuError> {
        let Some(target) = self.target.as_ref().filter(|_| self.savings.tally) else {
            return Ok(None);
        };
        let bytes = read_buffer(gpu, &target.tally, target.tally.size())?;
        let pixels: Vec<u32> = bytemuck::pod_collect_to_vec(&bytes);
        Ok(Some(pixels.into_iter().map(u64::from).sum()))
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
        recorder.encoder.clear_buffer(&target.tally, 0, None);
        let samples = draw.samples;
        let buffers = vec![
            draw.triangles.positions.clone(),
            draw.triangles.indices.clone(),
            draw.faces.sides.clone(),
            draw.faces.caps.clone(),
            target.counts.clone(),
            draw.limits.unwrap_or(&self.unlimited).clone(),
            target.tally.clone(),
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
                    bind::buffer(8, &buffers[5]),
                    bind::buffer(9, &buffers[6]),
                ],
            })
        });
        let stencil = wgpu::RenderPassDepthStencilAttachment {
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
        let doubts = wgpu::RenderPassColorAttachment {
            view: &target.doubts_view,
            depth_slice: None,
            resolve_target: None,
            ops: wgpu::Operations {
                load: wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT),
                store: wgpu::StoreOp::Store,
            },
        };
        let mut pass = recorder.render_pass("volume/count", &[Some(doubts)], Some(stencil));
        pass.set_bind_group(0, group, &[]);
        let [x, y, width, height] = self.scissor;
        pass.set_scissor_rect(x, y, width, height);
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
        let base = if draw.eye == Eye::Added { &self.eye_count } else { &self.zero };
        let key = ([&target.counts, base].map(Clone::clone), textures);
        let group = self.resolve_group.get(
            key,
            |([counts, base], [positions, normals, stencil, output])| {
                gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
                    label: Some("volume resolve"),
                    layout: &self.resolve_layout,
                    entries: &[
                        bind::buffer(0, &self.view),
                        bind::texture(1, positions),
                        bind::texture(2, normals),
                        bind::buffer(3, counts),
                        bind::buffer(4, base),
                        bind::texture(5, stencil),
                        bind::texture(6, output),
                    ],
                })
            },
        );
        let (width, height) = target.size;
        let mut pass = recorder.compute_pass("volume/resolve");
        pass.set_pipeline(&self.resolve);
        pass.set_bind_group(0, group, &[]);
        pass.dispatch_workgroups(width.div_ceil(8), height.div_ceil(8), 1);
        drop(pass);
        let buffers = [&target.counts, &self.eye_count];
        let views = [&target.doubts_view, visibility];
        self.doubtful.encode(gpu, recorder, &draw.triangles, samples, buffers, views);
        Ok(())
    }

    /// Bytes of the counters.
    pub(crate) fn bytes(&self) -> u64 {
        let texels = |t: &Target| u64::from(t.size.0) * u64::from(t.size.1);
        let counters =
            self.target.as_ref().map_or(0, |t| t.counts.size() + t.tally.size() + 2 * texels(t));
        counters + self.doubtful.batches.bytes()
    }
}

impl Target {
    fn new(gpu: &Gpu, size: (u32, u32), counter: Counter, tally: bool) -> Result<Self, GpuError> {
        let texels = u64::from(size.0) * u64::from(size.1);
        let buffer = |label, wanted| {
            gpu.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(label),
                // Where none is wanted, four bytes that nothing counts in.
                size: if wanted { 4 * texels } else { 4 },
                usage: wgpu::BufferUsages::STORAGE
                    | wgpu::BufferUsages::COPY_DST
                    | wgpu::BufferUsages::COPY_SRC,
                mapped_at_creation: false,
            })
        };
        let counts = buffer("volume counts", counter == Counter::Wide);
        let tally = buffer("volume fragments", tally);
        let texture = |label, format, usage| {
            gpu.create_texture(
                label,
                &wgpu::TextureDescriptor {
                    label: Some(label),
                    size: wgpu::Extent3d {
                        width: size.0,
                        height: size.1,
                        depth_or_array_layers: 1,
                    },
                    mip_level_count: 1,
                    sample_count: 1,
                    dimension: wgpu::TextureDimension::D2,
                    format,
                    usage: wgpu::TextureUsages::RENDER_ATTACHMENT
                        | wgpu::TextureUsages::TEXTURE_BINDING
                        | usage,
                    view_formats: &[],
                },
            )
        };
        let stencil = texture("volume stencil", STENCIL, wgpu::TextureUsages::empty())?;
        let doubts = texture("volume doubts", DOUBTS, wgpu::TextureUsages::COPY_SRC)?;
        let [stencil, doubts_view] =
            [&stencil, &doubts].map(|t| t.create_view(&Default::default()));
        Ok(Self { size, counts, tally, stencil, doubts, doubts_view })
    }
}

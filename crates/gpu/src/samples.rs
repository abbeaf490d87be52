//! View samples: what the camera sees at each pixel.

use glam::{DVec3, Vec3};

use crate::{Gpu, GpuError, Recorder, ViewCamera, bind, entries, read_f32_texture};

/// Position and geometric normal of the surface behind each pixel, on the GPU.
///
/// `positions`, `Rgba32Float`: xyz relative to the frame's origin, metres; w = 0 where the pixel shows no
/// surface, 2 + the number of the surface's object ([`crate::CasterTriangles::objects`]) where that is known,
/// else 1. `normals`, `Rgba32Float`: xyz the unit geometric normal on the viewer's side; w a
/// bound on the position's distance from the true surface, metres (0 for positions on the surface).
#[derive(Clone, Debug)]
pub struct ViewSamples {
    /// Positions.
    pub positions: wgpu::Texture,
    /// Normals.
    pub normals: wgpu::Texture,
    /// View of `positions`.
    pub positions_view: wgpu::TextureView,
    /// View of `normals`.
    pub normals_view: wgpu::TextureView,
}

/// View samples read back to the CPU, row by row from the top.
#[derive(Clone, Debug, PartialEq)]
pub struct SampleImage {
    /// Pixels a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Positions relative to the frame's origin, metres.
    pub positions: Vec<Vec3>,
    /// Unit geometric normals on the viewer's side; zero where there is no surface.
    pub normals: Vec<Vec3>,
}

impl ViewSamples {
    /// Format of both textures.
    pub const FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba32Float;

    /// Room for `width` x `height` samples.
    ///
    /// # Errors
    /// A size of zero or beyond the device's limit, or a failed allocation.
    pub fn new(gpu: &Gpu, width: u32, height: u32) -> Result<Self, GpuError> {
        let make = |label| {
            gpu.create_texture(
                "view size",
                &wgpu::TextureDescriptor {
                    label: Some(label),
                    size: wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
                    mip_level_count: 1,
                    sample_count: 1,
                    dimension: wgpu::TextureDimension::D2,
                    format: Self::FORMAT,
                    usage: wgpu::TextureUsages::RENDER_ATTACHMENT
                        | wgpu::TextureUsages::STORAGE_BINDING
                        | wgpu::TextureUsages::TEXTURE_BINDING
                        | wgpu::TextureUsages::COPY_DST
                        | wgpu::TextureUsages::COPY_SRC,
                    view_formats: &[],
                },
            )
        };
        let (positions, normals) = (make("view positions")?, make("view normals")?);
        let (positions_view, normals_view) =
            (positions.create_view(&Default::default()), normals.create_view(&Default::default()));
        Ok(Self { positions, normals, positions_view, normals_view })
    }

    /// Width and height, pixels.
    #[must_use]
    pub fn size(&self) -> (u32, u32) {
        (self.positions.width(), self.positions.height())
    }

    /// An `R32Float` texture of the samples' size that a technique can write and that can be read back.
    ///
    /// # Errors
    /// A failed allocation.
    pub fn visibility_target(&self, gpu: &Gpu) -> Result<wgpu::Texture, GpuError> {
        let (width, height) = self.size();
        gpu.create_texture(
            "visibility",
            &wgpu::TextureDescriptor {
                label: Some("visibility"),
                size: wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
                mip_level_count: 1,
                sample_count: 1,
                dimension: wgpu::TextureDimension::D2,
                format: wgpu::TextureFormat::R32Float,
                usage: wgpu::TextureUsages::STORAGE_BINDING
                    | wgpu::TextureUsages::TEXTURE_BINDING
                    | wgpu::TextureUsages::COPY_SRC,
                view_formats: &[],
            },
        )
    }

    /// Writes samples made on the CPU: positions relative to the frame's origin and unit normals, zero
    /// where there is no surface; row by row.
    ///
    /// # Errors
    /// Lists that do not have one entry a pixel.
    pub fn write(&self, gpu: &Gpu, positions: &[Vec3], normals: &[Vec3]) -> Result<(), GpuError> {
        self.write_with_objects(gpu, positions, normals, &vec![None; positions.len()])
    }

    /// As [`ViewSamples::write`], with the number of each sample's object where it is known.
    ///
    /// # Errors
    /// Lists that do not have one entry a pixel.
    pub fn write_with_objects(
        &self,
        gpu: &Gpu,
        positions: &[Vec3],
        normals: &[Vec3],
        objects: &[Option<u32>],
    ) -> Result<(), GpuError> {
        let (width, height) = self.size();
        let count = width as usize * height as usize;
        if positions.len() != count || normals.len() != count || objects.len() != count {
            return Err(GpuError::Invalid {
                what: "number of view samples",
                value: format!("{} positions, {} normals", positions.len(), normals.len()),
                fix: "give one position and one normal a pixel",
            });
        }
        let there = |n: &Vec3, object: &Option<u32>| match object {
            _ if *n == Vec3::ZERO => 0.0,
            None => 1.0,
            Some(object) => 2.0 + *object as f32,
        };
        let samples = positions.iter().zip(normals).zip(objects);
        let p: Vec<f32> =
            samples.flat_map(|((p, n), object)| [p.x, p.y, p.z, there(n, object)]).collect();
        let n: Vec<f32> = normals.iter().flat_map(|n| [n.x, n.y, n.z, 0.0]).collect();
        for (texture, data) in [(&self.positions, p), (&self.normals, n)] {
            gpu.queue.write_texture(
                texture.as_image_copy(),
                bytemuck::cast_slice(&data),
                wgpu::TexelCopyBufferLayout {
                    offset: 0,
                    bytes_per_row: Some(16 * width),
                    rows_per_image: None,
                },
                texture.size(),
            );
        }
        Ok(())
    }

    /// Reads all samples back. Waits.
    ///
    /// # Errors
    /// A lost device.
    pub fn read(&self, gpu: &Gpu) -> Result<SampleImage, GpuError> {
        let (width, height) = self.size();
        let xyz = |texture| -> Result<Vec<Vec3>, GpuError> {
            let texels = read_f32_texture(gpu, texture, 0)?;
            Ok(texels.chunks_exact(4).map(|t| Vec3::new(t[0], t[1], t[2])).collect())
        };
        Ok(SampleImage {
            width,
            height,
            positions: xyz(&self.positions)?,
            normals: xyz(&self.normals)?,
        })
    }
}

/// Makes view samples from a depth buffer that the application already has.
#[derive(Debug)]
pub struct DepthSamples {
    pipeline: wgpu::ComputePipeline,
    layout: wgpu::BindGroupLayout,
    uniform: wgpu::Buffer,
    no_normals: wgpu::TextureView,
}

#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
struct UnprojectUniform {
    world: [[f32; 4]; 4],
    eye: [f32; 4],
    depth: [f32; 4],
}

/// The camera behind a depth buffer.
#[derive(Clone, Copy, Debug)]
pub struct DepthCamera {
    /// The camera.
    pub view: ViewCamera,
    /// Depth of pixels that show no surface.
    pub background: f32,
}

impl DepthSamples {
    /// Builds the pass.
    ///
    /// # Errors
    /// A shader that does not link (a fault of this library).
    pub fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        const CS: wgpu::ShaderStages = wgpu::ShaderStages::COMPUTE;
        let device = &gpu.device;
        let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("unproject"),
            entries: &[
                entries::uniform(0, CS),
                entries::texels(1, CS, false),
                entries::texels(2, CS, false),
                entries::write_texture(3, CS, ViewSamples::FORMAT),
                entries::write_texture(4, CS, ViewSamples::FORMAT),
            ],
        });
        let module = gpu.shader("unproject", antumbra_shaders::link("gpu::unproject", &[])?);
        let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some("unproject"),
            layout: Some(&device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
                label: Some("unproject"),
                bind_group_layouts: &[Some(&layout)],
                immediate_size: 0,
            })),
            module: &module,
            entry_point: Some("unproject"),
            compilation_options: Default::default(),
            cache: None,
        });
        let uniform = device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("unproject"),
            size: size_of::<UnprojectUniform>() as u64,
            usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let no_normals = device
            .create_texture(&wgpu::TextureDescriptor {
                label: Some("no normals"),
                size: wgpu::Extent3d { width: 1, height: 1, depth_or_array_layers: 1 },
                mip_level_count: 1,
                sample_count: 1,
                dimension: wgpu::TextureDimension::D2,
                format: wgpu::TextureFormat::Rgba32Float,
                usage: wgpu::TextureUsages::TEXTURE_BINDING,
                view_formats: &[],
            })
            .create_view(&Default::default());
        Ok(Self { pipeline, layout, uniform, no_normals })
    }

    /// Records the pass: `depth` (single-sampled, depth aspect) and, where there are any, geometric
    /// `normals` (xyz, relative to the world's axes, any length) become `samples`. Without normals
    /// they are taken from neighbouring pixels, which is wrong on faces less than three pixels wide.
    ///
    /// # Errors
    /// A camera matrix that cannot be inverted.
    pub fn encode(
        &self,
        gpu: &Gpu,
        recorder: &mut Recorder<'_>,
        camera: &DepthCamera,
        depth: &wgpu::TextureView,
        normals: Option<&wgpu::TextureView>,
        samples: &ViewSamples,
    ) -> Result<(), GpuError> {
        let ViewCamera { clip, eye } = camera.view;
        let world = clip.inverse();
        if !world.is_finite() {
            return Err(GpuError::Invalid {
                what: "camera matrix",
                value: format!("{clip}"),
                fix: "give an invertible matrix",
            });
        }
        let (width, height) = samples.size();
        // Angle between the centres of the two middle pixels.
        let ray = |x: f64| {
            let p = world.project_point3(DVec3::new(x, 0.0, 0.5));
            (p - eye).normalize_or_zero()
        };
        let pixel_angle = ray(0.0).angle_between(ray(2.0 / f64::from(width.max(1))));
        let uniform = UnprojectUniform {
            world: world.as_mat4().to_cols_array_2d(),
            eye: eye.as_vec3().extend(pixel_angle as f32).to_array(),
            depth: [
                camera.background,
                SUBPIXEL_STEP,
                f32::EPSILON,
                if normals.is_some() { 1.0 } else { 0.0 },
            ],
        };
        gpu.queue.write_buffer(&self.uniform, 0, bytemuck::bytes_of(&uniform));
        let group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("unproject"),
            layout: &self.layout,
            entries: &[
                bind::buffer(0, &self.uniform),
                bind::texture(1, depth),
                bind::texture(2, normals.unwrap_or(&self.no_normals)),
                bind::texture(3, &samples.positions_view),
                bind::texture(4, &samples.normals_view),
            ],
        });
        let mut pass = recorder.compute_pass("gpu/unproject");
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &group, &[]);
        pass.dispatch_workgroups(width.div_ceil(8), height.div_ceil(8), 1);
        Ok(())
    }
}

/// Sub-pixel grid to which rasterisers snap vertices: eight fractional bits, which Direct3D requires
/// and Vulkan and Metal implementations have. A vertex moves by at most half a step by rounding, a
/// whole one by truncation; the whole one is taken.
pub const SUBPIXEL_STEP: f32 = 1.0 / 256.0;

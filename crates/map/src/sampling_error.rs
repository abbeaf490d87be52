//! How many pixels a texel of a shadow map spans: a picture of its sampling error, over any layout.

use antumbra_gpu::{
    BindGroupCache, Gpu, GpuError, Recorder, ViewCamera, ViewSamples, bind, entries,
};
use glam::{DMat2, DMat4, DVec2, DVec3, DVec4};

use crate::{Bias, DepthConvention, Estimator, FittedView, Layout, ShadowView};

/// The pass that measures, for each view sample, the sides of a texel in pixels (*Real-Time Shadows* 3.2.1). Where
/// both are at most 1 the map samples at least as finely as the screen; their maximum is the sampling error.
#[derive(Debug)]
pub struct SamplingError {
    pipeline: wgpu::ComputePipeline,
    layout: Layout,
    samples_layout: wgpu::BindGroupLayout,
    screen: wgpu::Buffer,
    views: wgpu::Buffer,
    samples: BindGroupCache<[wgpu::TextureView; 3]>,
    views_group: wgpu::BindGroup,
}

/// `Screen` of `map/sampling_error.wesl`.
#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
struct Screen {
    clip: [[f32; 4]; 4],
    pixels: [f32; 2],
    texels: f32,
    unused: f32,
}

impl SamplingError {
    /// Format of the output: r the length of a texel's side along s, g that along t, in pixels; 0 where the map is
    /// not looked up, [`SamplingError::LONGEST`] at most.
    pub const FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rg32Float;

    /// Longest side reported, pixels; that on a receiver edge-on to the light has no bound.
    pub const LONGEST: f32 = 1e4;

    /// Links and compiles the pass.
    ///
    /// # Errors
    /// A shader that does not link (a fault of this library).
    pub fn new(gpu: &Gpu, layout: Layout) -> Result<Self, GpuError> {
        const CS: wgpu::ShaderStages = wgpu::ShaderStages::COMPUTE;
        let device = &gpu.device;
        let samples_layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("sampling error: samples"),
            entries: &[
                entries::uniform(0, CS),
                entries::texels(1, CS, false),
                entries::texels(2, CS, false),
                entries::write_texture(3, CS, Self::FORMAT),
            ],
        });
        let views_layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("sampling error: views"),
            entries: &[entries::storage(0, CS)],
        });
        let linked = antumbra_shaders::link("map::sampling_error", &layout.slots)?;
        let shader = gpu.shader("sampling error", linked);
        let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some("sampling error"),
            layout: Some(&device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
                label: Some("sampling error"),
                bind_group_layouts: &[Some(&samples_layout), Some(&views_layout)],
                immediate_size: 0,
            })),
            module: &shader,
            entry_point: Some("measure"),
            compilation_options: Default::default(),
            cache: None,
        });
        let buffer = |label, size, usage| {
            device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(label),
                size,
                usage: usage | wgpu::BufferUsages::COPY_DST,
                mapped_at_creation: false,
            })
        };
        let views = (layout.views * size_of::<ShadowView>()) as u64;
        let views = buffer("measured views", views, wgpu::BufferUsages::STORAGE);
        let views_group = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("sampling error: views"),
            layout: &views_layout,
            entries: &[bind::buffer(0, &views)],
        });
        Ok(Self {
            pipeline,
            layout,
            samples_layout,
            screen: buffer("screen", size_of::<Screen>() as u64, wgpu::BufferUsages::UNIFORM),
            views,
            samples: BindGroupCache::default(),
            views_group,
        })
    }

    /// A texture that the pass can write and that can be read back, of the samples' size.
    ///
    /// # Errors
    /// A failed allocation.
    pub fn target(gpu: &Gpu, samples: &ViewSamples) -> Result<wgpu::Texture, GpuError> {
        gpu.create_texture(
            "sampling error",
            &wgpu::TextureDescriptor {
                label: Some("sampling error"),
                size: samples.positions.size(),
                mip_level_count: 1,
                sample_count: 1,
                dimension: wgpu::TextureDimension::D2,
                format: Self::FORMAT,
                usage: wgpu::TextureUsages::STORAGE_BINDING
                    | wgpu::TextureUsages::TEXTURE_BINDING
                    | wgpu::TextureUsages::COPY_SRC,
                view_formats: &[],
            },
        )
    }

    /// Records the pass: texels of a map of `size` a side, fitted as `views`, on the screen of `camera`, at `samples`,
    /// into `output` (of [`SamplingError::FORMAT`], storage).
    ///
    /// # Errors
    /// A number of views that is not the layout's.
    #[expect(clippy::too_many_arguments, reason = "one input each")]
    pub fn encode(
        &mut self,
        gpu: &Gpu,
        recorder: &mut Recorder<'_>,
        camera: &ViewCamera,
        samples: &ViewSamples,
        views: &[FittedView],
        size: u32,
        output: &wgpu::TextureView,
    ) -> Result<(), GpuError> {
        if views.len() != self.layout.views {
            return Err(GpuError::Invalid {
                what: "number of fitted views",
                value: views.len().to_string(),
                fix: "give the views that were fitted for the layout of this pass",
            });
        }
        // Biases are no matter here, nor is the layer.
        let (bias, nearest) = (Bias::default(), Estimator::nearest());
        let view = |view: &FittedView| match &view.clip {
            None => ShadowView::empty(view.light),
            Some(clip) => {
                ShadowView::new(clip, view.light, 0, DepthConvention::REVERSED_F32, &bias, &nearest)
            }
        };
        let views: Vec<ShadowView> = views.iter().map(view).collect();
        gpu.queue.write_buffer(&self.views, 0, bytemuck::cast_slice(&views));
        let (width, height) = samples.size();
        let screen = Screen {
            clip: camera.clip.as_mat4().to_cols_array_2d(),
            pixels: [width as f32, height as f32],
            texels: size as f32,
            unused: 0.0,
        };
        gpu.queue.write_buffer(&self.screen, 0, bytemuck::bytes_of(&screen));
        let key = [samples.positions_view.clone(), samples.normals_view.clone(), output.clone()];
        let group = self.samples.get(key, |[positions, normals, output]| {
            gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("sampling error: samples"),
                layout: &self.samples_layout,
                entries: &[
                    bind::buffer(0, &self.screen),
                    bind::texture(1, positions),
                    bind::texture(2, normals),
                    bind::texture(3, output),
                ],
            })
        });
        let mut pass = recorder.compute_pass("map/sampling_error");
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, group, &[]);
        pass.set_bind_group(1, &self.views_group, &[]);
        pass.dispatch_workgroups(width.div_ceil(8), height.div_ceil(8), 1);
        Ok(())
    }
}

/// A texel on the screen: the Jacobian J of pixels with respect to texels at a view sample, in f64.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TexelOnScreen {
    /// Columns: the texel's sides along s and t, in pixels; x to the right, y downwards.
    pub jacobian: DMat2,
}

impl TexelOnScreen {
    /// The texel of a map of `texels` a side under the matrix `light_clip` on the screen of `pixels` under
    /// `camera_clip`, at the point `p` of a surface with unit normal `n`. Not finite where the surface is edge-on to
    /// the light.
    #[must_use]
    pub fn new(
        camera_clip: &DMat4,
        pixels: DVec2,
        light_clip: &DMat4,
        texels: f64,
        p: DVec3,
        n: DVec3,
    ) -> Self {
        let (u, v) = n.any_orthonormal_pair();
        let moves = |clip: &DMat4, size: DVec2| {
            let c = *clip * p.extend(1.0);
            let along = |d: DVec3| {
                let e: DVec4 = *clip * d.extend(0.0);
                let ndc = (e.truncate() - c.truncate() / c.w * e.w) / c.w;
                ndc.truncate() * DVec2::new(0.5, -0.5) * size
            };
            DMat2::from_cols(along(u), along(v))
        };
        let (a, b) = (moves(camera_clip, pixels), moves(light_clip, DVec2::splat(texels)));
        Self { jacobian: a * b.inverse() }
    }

    /// Lengths of the texel's sides along s and t, pixels.
    #[must_use]
    pub fn sides(&self) -> DVec2 {
        DVec2::new(self.jacobian.x_axis.length(), self.jacobian.y_axis.length())
    }

    /// The sampling error: the longer side, pixels. At most 1 where the map is at least as fine as the screen.
    #[must_use]
    pub fn error(&self) -> f64 {
        self.sides().max_element()
    }

    /// Length of the texel in the direction in which it is longest, pixels: the larger singular value of J.
    #[must_use]
    pub fn longest(&self) -> f64 {
        let j = self.jacobian;
        let squares = j.x_axis.length_squared() + j.y_axis.length_squared();
        let det = j.determinant().abs();
        (0.5 * (squares + (squares * squares - 4.0 * det * det).max(0.0).sqrt())).sqrt()
    }

    /// Area of the texel, square pixels.
    #[must_use]
    pub fn area(&self) -> f64 {
        self.jacobian.determinant().abs()
    }
}

#[cfg(test)]
mod tests {
    use antumbra_scene::Camera;

    use super::*;

    /// J by differences: the plane's points under the edges of a pixel, put into the map.
    fn by_differences(
        camera: &DMat4,
        pixels: DVec2,
        light: &DMat4,
        texels: f64,
        p: DVec3,
        n: DVec3,
    ) -> DMat2 {
        let picture = |clip: &DMat4, q: DVec3, size: DVec2| {
            (DVec2::splat(0.5) + DVec2::new(0.5, -0.5) * clip.project_point3(q).truncate()) * size
        };
        let inverse = camera.inverse();
        let step = 1e-4;
        let center = picture(camera, p, pixels);
        let texel_under = |at: DVec2| {
            let ndc = (at / pixels - 0.5) * DVec2::new(2.0, -2.0);
            let (a, b) =
                (inverse.project_point3(ndc.extend(0.9)), inverse.project_point3(ndc.extend(0.1)));
            let hit = a + (b - a) * (n.dot(p - a) / n.dot(b - a));
            picture(light, hit, DVec2::splat(texels))
        };
        let change = |d: DVec2| {
            (texel_under(center + d * step) - texel_under(center - d * step)) / (2.0 * step)
        };
        DMat2::from_cols(change(DVec2::X), change(DVec2::Y)).inverse()
    }

    #[test]
    fn the_jacobian_is_that_of_differences() {
        let camera = Camera {
            eye: DVec3::new(1.0, 2.0, 5.0),
            target: DVec3::ZERO,
            up: DVec3::Y,
            fov_y: 0.9,
            near: 0.1,
        };
        let camera = camera.view_projection(DVec3::ZERO, 1.5);
        let light = Camera {
            eye: DVec3::new(-4.0, 6.0, 1.0),
            target: DVec3::new(0.2, 0.0, -0.1),
            up: DVec3::Y,
            fov_y: 0.7,
            near: 0.5,
        };
        let light = light.view_projection(DVec3::ZERO, 1.0);
        let pixels = DVec2::new(600.0, 400.0);
        let mut compared = 0;
        for i in 0..200 {
            let number =
                |k: i32| 2.0 * (f64::from(3 * i + k + 1) * 0.618_033_988_749_894_9).fract() - 1.0;
            let p = DVec3::new(number(0), number(1), number(2)) * 0.8;
            let n = DVec3::new(number(2) * 0.5, 1.0, 0.6 + number(0) * 0.4).normalize();
            let texel = TexelOnScreen::new(&camera, pixels, &light, 1024.0, p, n);
            let expected = by_differences(&camera, pixels, &light, 1024.0, p, n);
            // Central differences over 2e-4 pixels: 1e-16 of 1000 texels over the step is 1e-9.
            let off = (texel.jacobian - expected)
                .x_axis
                .length()
                .max((texel.jacobian - expected).y_axis.length());
            assert!(off <= 1e-5 * texel.error(), "point {i}: {texel:?}, not {expected}");
            let longest = (0..3600)
                .map(|k| {
                    let d = DVec2::from_angle(std::f64::consts::PI * f64::from(k) / 3600.0);
                    (texel.jacobian * d).length()
                })
                .fold(0.0, f64::max);
            assert!((texel.longest() - longest).abs() <= 1e-5 * longest, "point {i}: longest");
            let sides = texel.sides();
            assert!(texel.area() <= sides.x * sides.y * (1.0 + 1e-12), "point {i}: area");
            assert!(
                texel.error() <= texel.longest() * (1.0 + 1e-12),
                "point {i}: a side is one direction"
            );
            compared += 1;
        }
        assert_eq!(compared, 200, "all points");
    }
}

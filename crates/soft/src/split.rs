//! A rectangle of light cut into parts.

use antumbra_gpu::{
    BindGroupCache, Counters, Frame, Gpu, GpuError, Recorder, Technique, bind, entries,
};
use antumbra_scene::Light;
use glam::DVec3;

const CS: wgpu::ShaderStages = wgpu::ShaderStages::COMPUTE;

/// A technique for each part of a rectangle of light, with maps of its own from the part's centre (Assarsson et al. 2003; Yang
/// et al. 2009): what the light's centre does not see, another part's may. Parts are as large as each other, so that the
/// light's visibility is the mean of theirs. Other lights, and a rectangle without an extent, are not cut.
pub(crate) struct Split {
    counts: [u32; 2],
    parts: Vec<Box<dyn Technique>>,
    lights: Vec<Light>,
    layout: wgpu::BindGroupLayout,
    pipeline: wgpu::ComputePipeline,
    images: Option<Images>,
    group: BindGroupCache<[wgpu::TextureView; 2]>,
}

/// What each part says.
struct Images {
    texture: wgpu::Texture,
    all: wgpu::TextureView,
    each: Vec<wgpu::TextureView>,
}

impl Split {
    /// `counts` parts along the two sides, of which `part` makes each technique.
    ///
    /// # Errors
    /// Those of `part`, or a shader that does not link (a fault of this library).
    pub(crate) fn new(
        gpu: &Gpu,
        counts: [u32; 2],
        part: impl Fn() -> Result<Box<dyn Technique>, GpuError>,
    ) -> Result<Self, GpuError> {
        let layout = gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("parts"),
            entries: &[
                entries::texels(0, CS, true),
                entries::write_texture(1, CS, wgpu::TextureFormat::R32Float),
            ],
        });
        let module = gpu.shader("parts", antumbra_shaders::link("soft::mean_of_parts", &[])?);
        let pipeline = gpu.compute_pipeline("parts", &module, "main", &[&layout]);
        let parts = (0..counts[0] * counts[1]).map(|_| part()).collect::<Result<_, _>>()?;
        let (lights, images, group) = (Vec::new(), None, BindGroupCache::default());
        Ok(Self { counts, parts, lights, layout, pipeline, images, group })
    }

    /// Room for what each part says of that many samples.
    fn make_room(&mut self, gpu: &Gpu, (width, height): (u32, u32)) -> Result<(), GpuError> {
        let fits = |i: &Images| (i.texture.width(), i.texture.height()) == (width, height);
        if self.images.as_ref().is_some_and(fits) {
            return Ok(());
        }
        let layers = self.parts.len() as u32;
        let texture = gpu.create_texture(
            "visibility of parts",
            &wgpu::TextureDescriptor {
                label: Some("visibility of parts"),
                size: wgpu::Extent3d { width, height, depth_or_array_layers: layers },
                mip_level_count: 1,
                sample_count: 1,
                dimension: wgpu::TextureDimension::D2,
                format: wgpu::TextureFormat::R32Float,
                usage: wgpu::TextureUsages::STORAGE_BINDING | wgpu::TextureUsages::TEXTURE_BINDING,
                view_formats: &[],
            },
        )?;
        let view = |base_array_layer, count, dimension| {
            texture.create_view(&wgpu::TextureViewDescriptor {
                dimension: Some(dimension),
                base_array_layer,
                array_layer_count: Some(count),
                ..Default::default()
            })
        };
        let all = view(0, layers, wgpu::TextureViewDimension::D2Array);
        let each = (0..layers).map(|i| view(i, 1, wgpu::TextureViewDimension::D2)).collect();
        self.images = Some(Images { texture, all, each });
        Ok(())
    }

    /// The parts that had a light in the last frame.
    fn used(&self) -> impl Iterator<Item = &dyn Technique> {
        self.parts.iter().take(self.lights.len()).map(AsRef::as_ref)
    }
}

/// The frame under a part of its light.
fn under<'a>(frame: &Frame<'a>, light: &'a Light) -> Frame<'a> {
    let Frame { samples, camera, light: _, casters, origin } = *frame;
    Frame { samples, camera, light, casters, origin }
}

/// The parts of a rectangle with an extent; other lights as they are.
fn parts_of(light: &Light, [across, along]: [u32; 2]) -> Vec<Light> {
    let Light::Rect { center, half_u, half_v } = *light else { return vec![*light] };
    if light.is_hard() {
        return vec![*light];
    }
    let middle = |half: DVec3, k: u32, count: u32| {
        half * ((2.0 * f64::from(k) + 1.0) / f64::from(count) - 1.0)
    };
    let part = |i: u32| Light::Rect {
        center: center + middle(half_u, i % across, across) + middle(half_v, i / across, along),
        half_u: half_u / f64::from(across),
        half_v: half_v / f64::from(along),
    };
    (0..across * along).map(part).collect()
}

fn sum(all: impl Iterator<Item = Counters>) -> Counters {
    all.flatten().fold(Counters::new(), |mut sums, (name, count)| {
        *sums.entry(name).or_default() += count;
        sums
    })
}

impl Technique for Split {
    fn prepare(&mut self, gpu: &Gpu, frame: &Frame<'_>) -> Result<(), GpuError> {
        self.lights = parts_of(frame.light, self.counts);
        if self.lights.len() > 1 {
            self.make_room(gpu, frame.samples.size())?;
        }
        for (part, light) in self.parts.iter_mut().zip(&self.lights) {
            part.prepare(gpu, &under(frame, light))?;
        }
        Ok(())
    }

    fn encode(
        &mut self,
        gpu: &Gpu,
        frame: &Frame<'_>,
        recorder: &mut Recorder<'_>,
        visibility: &wgpu::TextureView,
    ) -> Result<(), GpuError> {
        let images = self.images.as_ref().filter(|_| self.lights.len() > 1);
        let Some(images) = images else {
            return self.parts[0].encode(gpu, frame, recorder, visibility);
        };
        for ((part, light), image) in self.parts.iter_mut().zip(&self.lights).zip(&images.each) {
            part.encode(gpu, &under(frame, light), recorder, image)?;
        }
        let key = [images.all.clone(), visibility.clone()];
        let group = self.group.get(key, |[parts, output]| {
            gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("parts"),
                layout: &self.layout,
                entries: &[bind::texture(0, parts), bind::texture(1, output)],
            })
        });
        let (width, height) = frame.samples.size();
        let mut pass = recorder.compute_pass("soft/parts");
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, group, &[]);
        pass.dispatch_workgroups(width.div_ceil(8), height.div_ceil(8), 1);
        Ok(())
    }

    fn counters(&self) -> Counters {
        sum(self.used().map(Technique::counters))
    }

    fn read_counters(&self, gpu: &Gpu) -> Result<Counters, GpuError> {
        let all: Vec<Counters> =
            self.used().map(|p| p.read_counters(gpu)).collect::<Result<_, _>>()?;
        Ok(sum(all.into_iter()))
    }

    fn bytes(&self) -> u64 {
        let image = |i: &Images| 4 * u64::from(i.texture.width()) * u64::from(i.texture.height());
        let images = self.images.as_ref().map_or(0, image) * self.parts.len() as u64;
        self.parts.iter().map(|part| part.bytes()).sum::<u64>() + images
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_of_a_rectangle_tile_it_and_other_lights_are_whole() {
        let (center, half_u, half_v) = (DVec3::ONE, DVec3::X * 3.0, DVec3::Z * 2.0);
        let whole = Light::Rect { center, half_u, half_v };
        let parts = parts_of(&whole, [3, 2]);
        let mut corners: Vec<[i32; 2]> = parts
            .iter()
            .map(|part| {
                let Light::Rect { center, half_u, half_v } = *part else { return [0; 2] };
                assert_eq!((half_u, half_v), (DVec3::X, DVec3::Z), "of one size");
                let low = center - half_u - half_v;
                assert_eq!(low.y, 1.0, "in the light's plane");
                [low.x.round() as i32, low.z.round() as i32]
            })
            .collect();
        corners.sort_unstable();
        let expected: Vec<[i32; 2]> =
            [-2, 0, 2].into_iter().flat_map(|x| [-1, 1].map(|z| [x, z])).collect();
        assert_eq!(corners, expected, "low corners");
        let sphere = Light::Sphere { center, radius: 1.0 };
        assert_eq!(parts_of(&sphere, [3, 2]), [sphere], "a sphere");
    }
}

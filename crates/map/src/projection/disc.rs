//! Disc shadows: a dark disc under each body.

use antumbra_gpu::{
    BindGroupCache, CasterBody, Counters, Expectation, Frame, Gpu, GpuError, Recorder, Technique,
    TechniqueConfig, bind, entries,
};
use glam::{DVec3, DVec4};
use serde::{Deserialize, Serialize};

use super::plane::{self, Plane, Receiver};
use super::{CastingUniform, ReceiverUniform, Table, resolve_pipeline, unprepared};

/// Disc shadows: under each body a dark disc on each plane, of the body's bounds alone (*Real-Time Shadows* 1.2). A
/// cue for where things stand, at a cost that does not depend on triangles: view samples on a plane times bodies.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct DiscShadows {
    /// The planes that receive shadows, world space. Default none: the floors among the casters
    /// ([`antumbra_gpu::Casters::bodies`]).
    pub planes: Vec<Plane>,
    /// 1 minus the visibility under a body that touches the plane, 0 to 1, default 1.
    pub opacity: f32,
    /// Share of the disc within which it is fully dark, 0 to just below 1, default 0.5: a soft border looks more
    /// like a shadow (Kersten, Mamassian, Knill 1997).
    pub inner: f32,
    /// Growth of the radius per height of the body above the plane, both in metres: >= 0, default 0. A light that
    /// appears 2 a wide spreads a shadow by tan a.
    pub growth: f32,
    /// Loss of darkness with height: the opacity is divided by 1 + `fade` times the height in radii. >= 0, default
    /// 0.
    pub fade: f32,
}

impl Default for DiscShadows {
    fn default() -> Self {
        Self { planes: Vec::new(), opacity: 1.0, inner: 0.5, growth: 0.0, fade: 0.0 }
    }
}

impl DiscShadows {
    fn validate(&self) -> Result<(), GpuError> {
        plane::validate(&self.planes)?;
        let invalid =
            |what, value: f32, fix| Err(GpuError::Invalid { what, value: value.to_string(), fix });
        if !(0.0..=1.0).contains(&self.opacity) {
            return invalid("opacity", self.opacity, "use a number from 0 to 1");
        }
        if !(0.0..1.0).contains(&self.inner) {
            return invalid("inner", self.inner, "use a share of the radius from 0 to below 1");
        }
        for (what, value) in [("growth", self.growth), ("fade", self.fade)] {
            if !(value.is_finite() && value >= 0.0) {
                return invalid(what, value, "use a finite number of at least 0");
            }
        }
        Ok(())
    }

    /// The shadow of `body` on `plane` (xyz unit normal, w offset) from `light` (a position, w = 1, or a direction
    /// towards it, w = 0), all in one space; `None` where the body throws none: below the plane, or not below the
    /// light.
    ///
    /// The body stands for a ball: its centre is cast along the light's ray, and its radius grows as similar
    /// triangles do under a positional light. The radius is that of the circle with the area of the ellipse in the
    /// box's outline on the plane.
    #[must_use]
    pub fn disc(&self, body: &CasterBody<'_>, plane: DVec4, light: DVec4) -> Option<Disc> {
        let (normal, center) = (plane.truncate(), body.bounds.center());
        let height = plane.dot(center.extend(1.0));
        let above = plane.dot(light);
        // Fourth coordinate of the projection: what lies not below the light throws nothing.
        let w = above - light.w * height;
        if body.bounds.is_empty() || height <= 0.0 || w <= 0.0 {
            return None;
        }
        let half = 0.5 * (body.bounds.max - body.bounds.min);
        let (u, v) = normal.any_orthonormal_pair();
        let along = |axis: DVec3| axis.abs().dot(half);
        let radius = (along(u) * along(v)).sqrt();
        let gap = (height - along(normal)).max(0.0);
        let cast = (above * center - height * light.truncate()) / w;
        let grown = radius * above / w + f64::from(self.growth) * gap;
        let fade = if radius > 0.0 { f64::from(self.fade) * gap / radius } else { 0.0 };
        let opacity = f64::from(self.opacity) / (1.0 + fade);
        Some(Disc { center: cast, radius: grown, opacity }).filter(|disc| disc.radius > 0.0)
    }
}

/// The shadow of a body on a plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Disc {
    /// Centre, metres.
    pub center: DVec3,
    /// Radius, metres.
    pub radius: f64,
    /// 1 minus the visibility at the centre.
    pub opacity: f64,
}

impl TechniqueConfig for DiscShadows {
    fn build(&self, gpu: &Gpu) -> Result<Box<dyn Technique>, GpuError> {
        Ok(Box::new(DiscTechnique::new(gpu, self)?))
    }

    fn expectation(&self, case: &str) -> Option<Expectation> {
        super::expectation::disc(case)
    }
}

/// `Disc` of `map/disc.wesl`.
#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
struct DiscUniform {
    center: [f32; 3],
    radius: f32,
    opacity: f32,
    inner: f32,
    unused: [f32; 2],
}

/// Disc shadows, as a technique.
#[derive(Debug)]
pub struct DiscTechnique {
    config: DiscShadows,
    resolve: wgpu::ComputePipeline,
    lists_layout: wgpu::BindGroupLayout,
    frame_layout: wgpu::BindGroupLayout,
    casting: wgpu::Buffer,
    receivers: Table,
    discs: Table,
    lists_group: BindGroupCache<[wgpu::Buffer; 2]>,
    frame_group: BindGroupCache<[wgpu::TextureView; 3]>,
    prepared: bool,
    counters: Counters,
}

impl DiscTechnique {
    /// Checks the settings and builds the pass.
    ///
    /// # Errors
    /// A setting out of range, or a plane that is none.
    pub fn new(gpu: &Gpu, config: &DiscShadows) -> Result<Self, GpuError> {
        const CS: wgpu::ShaderStages = wgpu::ShaderStages::COMPUTE;
        config.validate()?;
        let device = &gpu.device;
        let lists_layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("disc: lists"),
            entries: &[entries::uniform(0, CS), entries::storage(1, CS), entries::storage(2, CS)],
        });
        let frame_layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("disc: frame"),
            entries: &[
                entries::texels(0, CS, false),
                entries::texels(1, CS, false),
                entries::write_texture(2, CS, wgpu::TextureFormat::R32Float),
            ],
        });
        let module = gpu.shader("disc", antumbra_shaders::link("map::disc", &[])?);
        let groups = [Some(&lists_layout), Some(&frame_layout)];
        let resolve = resolve_pipeline(gpu, "disc", &module, &groups);
        let casting = gpu.buffer(
            "disc: light",
            bytemuck::bytes_of(&<CastingUniform as bytemuck::Zeroable>::zeroed()),
            wgpu::BufferUsages::UNIFORM,
        );
        Ok(Self {
            config: config.clone(),
            resolve,
            lists_layout,
            frame_layout,
            casting,
            receivers: Table::new(gpu, "disc: planes", wgpu::BufferUsages::STORAGE),
            discs: Table::new(gpu, "disc: discs", wgpu::BufferUsages::STORAGE),
            lists_group: BindGroupCache::default(),
            frame_group: BindGroupCache::default(),
            prepared: false,
            counters: Counters::new(),
        })
    }

    /// The discs of all bodies on one plane.
    fn discs_on(
        &self,
        frame: &Frame<'_>,
        receiver: &Receiver,
        light: DVec4,
        discs: &mut Vec<DiscUniform>,
    ) {
        let origin = frame.origin;
        frame.casters.bodies(&mut |body| {
            // A floor under the light shadows nothing that stands on it.
            let relative = |floor: DVec4| floor + DVec4::W * floor.truncate().dot(origin);
            if body.floor.is_some_and(|floor| relative(floor).dot(light) >= 0.0) {
                return;
            }
            let mut body = *body;
            body.bounds.min -= origin;
            body.bounds.max -= origin;
            if let Some(disc) = self.config.disc(&body, receiver.plane, light) {
                discs.push(DiscUniform {
                    center: disc.center.as_vec3().to_array(),
                    radius: disc.radius as f32,
                    opacity: disc.opacity as f32,
                    inner: self.config.inner,
                    unused: [0.0; 2],
                });
            }
        });
    }
}

impl Technique for DiscTechnique {
    fn prepare(&mut self, gpu: &Gpu, frame: &Frame<'_>) -> Result<(), GpuError> {
        self.prepared = false;
        let light = plane::light_vector(frame)?;
        let (mut receivers, mut discs) = (Vec::new(), Vec::new());
        for receiver in plane::receivers(&self.config.planes, frame, light)? {
            let first = discs.len();
            self.discs_on(frame, &receiver, light, &mut discs);
            receivers.push(ReceiverUniform::new(&receiver, first, discs.len() - first));
        }
        self.receivers.write(gpu, &receivers)?;
        self.discs.write(gpu, &discs)?;
        let casting = CastingUniform::new(light, receivers.len());
        gpu.queue.write_buffer(&self.casting, 0, bytemuck::bytes_of(&casting));
        let (width, height) = frame.samples.size();
        self.counters = Counters::from([
            ("planes", receivers.len() as u64),
            ("discs", discs.len() as u64),
            ("view_samples", u64::from(width) * u64::from(height)),
        ]);
        self.prepared = true;
        Ok(())
    }

    fn encode(
        &mut self,
        gpu: &Gpu,
        frame: &Frame<'_>,
        recorder: &mut Recorder<'_>,
        visibility: &wgpu::TextureView,
    ) -> Result<(), GpuError> {
        if !self.prepared {
            return Err(unprepared());
        }
        let device = &gpu.device;
        let key = [self.receivers.buffer.clone(), self.discs.buffer.clone()];
        let lists_group = self.lists_group.get(key, |[receivers, discs]| {
            device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("disc: lists"),
                layout: &self.lists_layout,
                entries: &[
                    bind::buffer(0, &self.casting),
                    bind::buffer(1, receivers),
                    bind::buffer(2, discs),
                ],
            })
        });
        let samples = frame.samples;
        let key =
            [samples.positions_view.clone(), samples.normals_view.clone(), visibility.clone()];
        let frame_group = self.frame_group.get(key, |[positions, normals, output]| {
            device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("disc: frame"),
                layout: &self.frame_layout,
                entries: &[
                    bind::texture(0, positions),
                    bind::texture(1, normals),
                    bind::texture(2, output),
                ],
            })
        });
        let (width, height) = samples.size();
        let mut pass = recorder.compute_pass("map/disc");
        pass.set_pipeline(&self.resolve);
        pass.set_bind_group(0, lists_group, &[]);
        pass.set_bind_group(1, frame_group, &[]);
        pass.dispatch_workgroups(width.div_ceil(8), height.div_ceil(8), 1);
        Ok(())
    }

    fn counters(&self) -> Counters {
        self.counters.clone()
    }

    fn bytes(&self) -> u64 {
        self.receivers.buffer.size() + self.discs.buffer.size() + self.casting.size()
    }
}

#[cfg(test)]
mod tests {
    use antumbra_scene::Bounds;

    use super::*;

    fn ball(center: DVec3, radius: f64) -> CasterBody<'static> {
        let bounds = Bounds { min: center - radius, max: center + radius };
        CasterBody { bounds, parts: &[], floor: None }
    }

    #[test]
    fn a_ball_casts_a_disc_of_its_radius_along_the_light() {
        let config = DiscShadows::default();
        let slanting = DVec4::new(1.0, 1.0, 0.0, 0.0) / std::f64::consts::SQRT_2;
        let body = ball(DVec3::new(0.0, 2.0, 0.0), 0.5);
        let disc = config.disc(&body, DVec4::Y, slanting).expect("a shadow");
        assert!(disc.center.abs_diff_eq(DVec3::new(-2.0, 0.0, 0.0), 1e-12), "{disc:?}");
        assert!((disc.radius - 0.5).abs() < 1e-12 && disc.opacity == 1.0, "{disc:?}");
        // From 6 m up, what hangs at 2 m casts 6 / 4 of its size.
        let disc = config.disc(&body, DVec4::Y, DVec4::new(0.0, 6.0, 0.0, 1.0)).expect("a shadow");
        assert!((disc.radius - 0.75).abs() < 1e-12, "{disc:?}");
    }

    #[test]
    fn bodies_above_the_light_or_below_the_plane_cast_nothing() {
        let config = DiscShadows::default();
        let light = DVec4::new(0.0, 1.0, 0.0, 1.0);
        for height in [1.0, 2.0, 0.0, -1.0] {
            let body = ball(DVec3::new(0.3, height, 0.0), 0.1);
            assert_eq!(config.disc(&body, DVec4::Y, light), None, "at {height} m");
        }
    }

    #[test]
    fn a_disc_changes_continuously_as_its_body_rises() {
        let config = DiscShadows { growth: 0.3, fade: 0.4, opacity: 0.9, ..DiscShadows::default() };
        let light = DVec4::new(0.3, 1.0, 0.1, 0.0).normalize();
        let step = 1e-4;
        let at = |i: i32| {
            let body = ball(DVec3::Y * (0.2 + f64::from(i) * step), 0.5);
            config.disc(&body, DVec4::Y, light).expect("a shadow")
        };
        for i in 0..20_000 {
            let (a, b) = (at(i), at(i + 1));
            // The centre moves by the light's slope times the step, the radius by the growth, and the opacity by
            // at most its fade a radius.
            assert!(a.center.distance(b.center) <= 0.32 * step, "centre at step {i}");
            assert!((a.radius - b.radius).abs() <= 0.31 * step, "radius at step {i}");
            assert!(
                (a.opacity - b.opacity).abs() <= 0.9 * 0.41 / 0.5 * step,
                "opacity at step {i}"
            );
            assert!(b.opacity <= a.opacity && b.radius >= a.radius, "order at step {i}");
        }
    }

    #[test]
    fn settings_out_of_range_are_refused() {
        let usual = DiscShadows::default();
        for bad in [
            DiscShadows { opacity: 1.1, ..usual.clone() },
            DiscShadows { opacity: f32::NAN, ..usual.clone() },
            DiscShadows { inner: 1.0, ..usual.clone() },
            DiscShadows { growth: -0.1, ..usual.clone() },
            DiscShadows { fade: f32::INFINITY, ..usual.clone() },
        ] {
            assert!(matches!(bad.validate(), Err(GpuError::Invalid { .. })), "{bad:?} passed");
        }
        assert_eq!(usual.validate(), Ok(()), "the defaults");
    }
}

//! Shadow volumes counted from the camera, as a technique.

use antumbra_gpu::{Counters, Frame, Gpu, GpuError, Recorder, Technique};

use crate::clamp::{Clamp, ClampRequest};
use crate::count::{Counter, Counting, Draw, Eye, Request};
use crate::cull::Cull;
use crate::light::{Viewer, contact, homogeneous_light, triangles, viewer};
use crate::triangles::{Method, TriangleFaces, TrianglePass};
use crate::{Savings, VolumeFaces};

/// How a [`VolumeTechnique`] counts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Counted {
    pub(crate) counter: Counter,
    pub(crate) method: Method,
    pub(crate) near_caps: bool,
    pub(crate) start: Start,
    /// Whether volumes that contain nothing in view are left away; not for counts in front of samples alone, from
    /// which the eye's own may not be left away.
    pub(crate) culling: bool,
    pub(crate) savings: Savings,
}

impl Counted {
    /// What the eye's own count is to the samples'.
    fn eye(&self) -> Eye {
        match self.start {
            Start::Eye => Eye::Added,
            Start::Zero if self.method == Method::InFront => Eye::Missing,
            Start::Zero | Start::NearPlane => Eye::Apart,
        }
    }
}

/// From which number the count in front of samples starts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Start {
    /// 0.
    Zero,
    /// The number of volumes that contain the eye.
    Eye,
    /// The number of volumes at each pixel's point of the near plane.
    NearPlane,
}

/// Volumes of the casters' triangles, drawn from the camera and counted at each view sample.
#[derive(Debug)]
pub struct VolumeTechnique {
    how: Counted,
    producer: TriangleFaces,
    faces: Option<VolumeFaces>,
    counting: Counting,
    eye: Option<TrianglePass>,
    cull: Option<Cull>,
    clamp: Option<Clamp>,
    counters: Counters,
}

impl VolumeTechnique {
    pub(crate) fn new(gpu: &Gpu, how: Counted) -> Result<Self, GpuError> {
        let eye = match how.eye() {
            Eye::Added | Eye::Missing => {
                Some(TrianglePass::new(gpu, "volume/eye", "volume::eye", "count_eye", 1)?)
            }
            Eye::Apart => None,
        };
        // Limits leave away too what the plain pass would.
        let limits = how.savings.limits();
        Ok(Self {
            how,
            eye,
            cull: if how.culling && !limits { Some(Cull::new(gpu)?) } else { None },
            clamp: if limits { Some(Clamp::new(gpu, how.savings)?) } else { None },
            producer: TriangleFaces::new(gpu)?,
            faces: None,
            counting: Counting::new(gpu, how.counter, how.savings)?,
            counters: Counters::new(),
        })
    }

    /// The counters behind the last visibility, where they are wide: one `i32` a view sample, row by row.
    #[must_use]
    pub fn counts(&self) -> Option<&wgpu::Buffer> {
        self.counting.counts()
    }

    /// The faces of the last frame.
    #[must_use]
    pub fn faces(&self) -> Option<&VolumeFaces> {
        self.faces.as_ref()
    }
}

/// w of the near plane.
///
/// # Errors
/// Parallel lines of sight.
fn near_plane(view: &Viewer) -> Result<f64, GpuError> {
    if view.eye.w == 0.0 {
        return Err(GpuError::Invalid {
            what: "camera",
            value: "orthographic".to_owned(),
            fix: "use a perspective camera, or `volume/counter`, which does without the near plane",
        });
    }
    Ok(view.near)
}

impl Technique for VolumeTechnique {
    fn prepare(&mut self, gpu: &Gpu, frame: &Frame<'_>) -> Result<(), GpuError> {
        let triangles = triangles(frame)?;
        let view = viewer(frame)?;
        let eye = view.eye.as_vec4();
        let light = homogeneous_light(frame);
        let method = self.how.method;
        self.producer.prepare(gpu, &triangles, light, eye, method, &mut self.faces)?;
        let contact = contact(frame);
        if let Some(cull) = &mut self.cull {
            let reach = self.how.savings.reach_of_interest();
            cull.prepare(gpu, frame.samples, triangles.triangles, light, reach)?;
        }
        if let (Some(clamp), Some(faces)) = (&mut self.clamp, &self.faces) {
            let count = triangles.triangles;
            faces.set_draws(gpu, 3 * count, count, self.how.savings.instances());
            let (samples, volumes) = (frame.samples, triangles.triangles);
            let edges = self.how.savings.edges(gpu, frame)?;
            clamp.prepare(gpu, &ClampRequest { samples, volumes, light, eye, contact, edges })?;
        }
        if let Some(pass) = &mut self.eye {
            pass.prepare(gpu, triangles.triangles, light, eye, method.number());
        }
        let near = if self.how.start == Start::NearPlane { near_plane(&view)? } else { 0.0 };
        let request =
            Request { samples: frame.samples, view, light, near, eye: self.how.eye(), contact };
        self.counting.prepare(gpu, &request, triangles.triangles)
    }

    fn encode(
        &mut self,
        gpu: &Gpu,
        frame: &Frame<'_>,
        recorder: &mut Recorder<'_>,
        visibility: &wgpu::TextureView,
    ) -> Result<(), GpuError> {
        let triangles = triangles(frame)?;
        let Some(faces) = self.faces.as_ref().filter(|f| f.holds(&triangles)) else {
            return Err(GpuError::Invalid {
                what: "frame",
                value: "not prepared".to_owned(),
                fix: "call `prepare` with this frame before `encode`",
            });
        };
        self.producer.encode(gpu, recorder, &triangles, faces);
        if let Some(cull) = &mut self.cull {
            cull.encode(gpu, recorder, &triangles, faces);
        }
        if let Some(clamp) = &mut self.clamp {
            let edges = self.how.savings.edges(gpu, frame)?;
            clamp.encode_triangles(gpu, recorder, &triangles, edges, faces);
        }
        if let Some(eye) = &mut self.eye {
            recorder.encoder.clear_buffer(self.counting.eye_count(), 0, None);
            eye.encode(gpu, recorder, &triangles, &[self.counting.eye_count()]);
        }
        // Under parallel light a volume narrows to a point at infinity.
        let at_infinity = self.how.method != Method::InFront && frame.light.position().is_some();
        let far_caps = at_infinity || self.how.savings.far;
        let draw = Draw {
            triangles,
            faces,
            samples: frame.samples,
            // What begins later is to be closed there.
            near_caps: self.how.near_caps || self.how.savings.near,
            far_caps,
            cast_caps: self.how.start == Start::NearPlane,
            eye: self.how.eye(),
            limits: self.clamp.as_ref().map(Clamp::limits),
        };
        self.counting.encode(gpu, recorder, &draw, visibility)?;
        let (width, height) = frame.samples.size();
        let count = u64::from(triangles.triangles);
        let caps = [draw.near_caps, draw.far_caps, draw.cast_caps].map(u64::from);
        self.counters = Counters::from([
            ("volumes", count),
            ("volume_sides", 3 * count),
            ("volume_caps", caps.iter().sum::<u64>() * count),
            ("view_samples", u64::from(width) * u64::from(height)),
        ]);
        Ok(())
    }

    fn counters(&self) -> Counters {
        self.counters.clone()
    }

    fn read_counters(&self, gpu: &Gpu) -> Result<Counters, GpuError> {
        let mut counters = self.counters();
        counters.extend(self.counting.read_counters(gpu)?);
        if let Some(cull) = &self.cull {
            counters.extend([("casting_volumes", cull.read_left(gpu)?)]);
        }
        if let Some(clamp) = &self.clamp {
            counters.extend(clamp.read_counters(gpu)?);
        }
        Ok(counters)
    }

    fn bytes(&self) -> u64 {
        let faces = self.faces.as_ref().map_or(0, VolumeFaces::bytes);
        let clamp = self.clamp.as_ref().map_or(0, Clamp::bytes);
        self.counting.bytes() + faces + clamp + self.cull.as_ref().map_or(0, Cull::bytes)
    }
}

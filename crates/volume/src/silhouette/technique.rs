//! Volumes by silhouettes, counted from the camera, as a technique.

use antumbra_gpu::{
    Counters, Expectation, Frame, Gpu, GpuError, Recorder, Technique, TechniqueConfig,
};
use serde::{Deserialize, Serialize};

use super::{FaceRequest, Meshes, Silhouettes, expectation};
use crate::clamp::{Clamp, ClampRequest};
use crate::count::{Counting, Draw, Eye, Request};
use crate::light::{contact, edges, homogeneous_light, triangles, viewer};
use crate::{Counter, Method, Savings, VolumeFaces};

/// Shadow volumes by silhouettes: of the sides of all triangles' volumes only those that do not cancel.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Silhouette {
    /// What is known of the casters' meshes; default nothing.
    pub meshes: Meshes,
    /// Which faces of a volume are counted; default those behind the sample. To choose costs a few tests a
    /// triangle and saves the far caps of volumes that the eye is outside of.
    pub method: Counted,
    /// What counts; default wide. With the stencil, a side that counts twice is drawn twice.
    pub counter: Counter,
    /// Whether bodies that shadow nothing in view are left away (after Lloyd, Wendt, Govindaraju and Manocha 2004
    /// and Decoret 2005); default true. Costs a reduction of the view samples and a few sphere tests a body, and
    /// changes no bit of the answer.
    pub culling: bool,
    /// What of volumes is not drawn since it decides nothing; default none.
    pub savings: Savings,
}

impl Default for Silhouette {
    fn default() -> Self {
        Self {
            meshes: Meshes::default(),
            method: Counted::default(),
            counter: Counter::default(),
            culling: true,
            savings: Savings::default(),
        }
    }
}

/// Which faces of a volume are counted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Counted {
    /// Those behind the sample (z-fail).
    #[default]
    Behind,
    /// Those in front of the sample for volumes that certainly do not contain the eye, those behind it for the
    /// others.
    Choose,
}

impl Silhouette {
    /// The technique itself, for reading its lists.
    ///
    /// # Errors
    /// A shader that does not link (a fault of this library).
    pub fn technique(&self, gpu: &Gpu) -> Result<SilhouetteTechnique, GpuError> {
        Ok(SilhouetteTechnique {
            config: *self,
            silhouettes: Silhouettes::new(gpu, self.meshes)?,
            faces: None,
            counting: Counting::new(gpu, self.counter, self.savings)?,
            clamp: if self.savings.limits() { Some(Clamp::new(gpu, self.savings)?) } else { None },
            counters: Counters::new(),
        })
    }
}

impl TechniqueConfig for Silhouette {
    fn build(&self, gpu: &Gpu) -> Result<Box<dyn Technique>, GpuError> {
        Ok(Box::new(self.technique(gpu)?))
    }

    fn expectation(&self, case: &str) -> Option<Expectation> {
        expectation::expectation(self, case)
    }
}

/// Volumes by silhouettes, drawn from the camera and counted at each view sample.
#[derive(Debug)]
pub struct SilhouetteTechnique {
    config: Silhouette,
    silhouettes: Silhouettes,
    faces: Option<VolumeFaces>,
    counting: Counting,
    clamp: Option<Clamp>,
    counters: Counters,
}

impl SilhouetteTechnique {
    /// What makes the faces.
    #[must_use]
    pub fn silhouettes(&self) -> &Silhouettes {
        &self.silhouettes
    }

    /// The faces of the last frame.
    #[must_use]
    pub fn faces(&self) -> Option<&VolumeFaces> {
        self.faces.as_ref()
    }

    /// The counters behind the last visibility, where they are wide: one `i32` a view sample, row by row.
    #[must_use]
    pub fn counts(&self) -> Option<&wgpu::Buffer> {
        self.counting.counts()
    }
}

const USE_TRIANGLES: &str = "implement `Casters::edges` with `CasterEdges`, or use `volume/z-fail`";

impl Technique for SilhouetteTechnique {
    fn prepare(&mut self, gpu: &Gpu, frame: &Frame<'_>) -> Result<(), GpuError> {
        let triangles = triangles(frame)?;
        let view = viewer(frame)?;
        let light = homogeneous_light(frame);
        let request = FaceRequest {
            light,
            eye: view.eye.as_vec4(),
            method: match self.config.method {
                Counted::Behind => Method::Behind,
                Counted::Choose => Method::Choose,
            },
            by_ones: self.config.counter == Counter::Stencil,
            receivers: self.config.culling.then_some(frame.samples),
            savings: self.config.savings,
        };
        let edges = edges(gpu, frame, USE_TRIANGLES)?;
        self.silhouettes.prepare(gpu, &triangles, edges, &request, &mut self.faces)?;
        let (eye, contact) = (view.eye.as_vec4(), contact(frame));
        if let Some(clamp) = &mut self.clamp {
            let (samples, volumes) = (frame.samples, edges.body_count);
            let edges = Some(edges);
            clamp.prepare(gpu, &ClampRequest { samples, volumes, light, eye, contact, edges })?;
        }
        let request =
            Request { samples: frame.samples, view, light, near: 0.0, eye: Eye::Apart, contact };
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
        if let Some(clamp) = &mut self.clamp {
            clamp.encode_bodies(gpu, recorder, &triangles, edges(gpu, frame, USE_TRIANGLES)?);
        }
        self.silhouettes.encode(recorder)?;
        let draw = Draw {
            triangles,
            faces,
            samples: frame.samples,
            near_caps: true,
            // Under parallel light a volume narrows to a point at infinity.
            far_caps: frame.light.position().is_some() || self.config.savings.far,
            cast_caps: false,
            eye: Eye::Apart,
            limits: self.clamp.as_ref().map(Clamp::limits),
        };
        self.counting.encode(gpu, recorder, &draw, visibility)?;
        let (width, height) = frame.samples.size();
        let edges = edges(gpu, frame, USE_TRIANGLES)?;
        self.counters = Counters::from([
            ("triangles", triangles.triangles.into()),
            ("edges", edges.count.into()),
            ("bodies", edges.body_count.into()),
            ("view_samples", u64::from(width) * u64::from(height)),
        ]);
        Ok(())
    }

    fn counters(&self) -> Counters {
        self.counters.clone()
    }

    fn read_counters(&self, gpu: &Gpu) -> Result<Counters, GpuError> {
        let mut counters = self.counters();
        let [sides, caps, bodies] = self.silhouettes.read_sizes(gpu)?;
        counters.extend([
            ("volume_sides", sides),
            ("volume_caps", caps),
            ("casting_bodies", bodies),
        ]);
        if let Some(clamp) = &self.clamp {
            counters.extend(clamp.read_counters(gpu)?);
        }
        counters.extend(self.counting.read_counters(gpu)?);
        Ok(counters)
    }

    fn bytes(&self) -> u64 {
        let faces = self.faces.as_ref().map_or(0, VolumeFaces::bytes);
        let clamp = self.clamp.as_ref().map_or(0, Clamp::bytes);
        self.silhouettes.bytes() + self.counting.bytes() + faces + clamp
    }
}

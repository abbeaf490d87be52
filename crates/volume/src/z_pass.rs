//! Counting in front of the sample (z-pass): right where the eye is lit.

use antumbra_gpu::{Expectation, Gpu, GpuError, Technique, TechniqueConfig};
use serde::{Deserialize, Serialize};

use crate::technique::{Counted, Start, VolumeTechnique};
use crate::triangles::Method;
use crate::{Counter, Savings, expectation};

/// Shadow volumes counted between eye and sample (Crow 1977; Heidmann 1991): how many more volumes contain the sample
/// than contain the eye. That is right where no volume contains the eye; elsewhere the picture is wrong as a whole.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ZPass {
    /// What counts; default wide.
    pub counter: Counter,
    /// Whether to draw the casters' triangles too, which close the volumes at the light's end; default false, as
    /// published: they cost a triangle a volume. Without them a caster that the camera does not see, or sees only
    /// before its near plane, shadows wrongly.
    pub near_caps: bool,
    /// What of volumes is not drawn since it decides nothing, but of those that may contain the eye; default none.
    pub savings: Savings,
}

impl ZPass {
    /// The technique itself, for reading its counts.
    ///
    /// # Errors
    /// A shader that does not link (a fault of this library).
    pub fn technique(&self, gpu: &Gpu) -> Result<VolumeTechnique, GpuError> {
        let how = Counted {
            counter: self.counter,
            method: Method::InFront,
            near_caps: self.near_caps,
            start: Start::Zero,
            culling: false,
            savings: self.savings,
        };
        VolumeTechnique::new(gpu, how)
    }
}

impl TechniqueConfig for ZPass {
    fn build(&self, gpu: &Gpu) -> Result<Box<dyn Technique>, GpuError> {
        Ok(Box::new(self.technique(gpu)?))
    }

    fn expectation(&self, case: &str) -> Option<Expectation> {
        expectation::z_pass(self.counter, self.near_caps, case)
    }
}

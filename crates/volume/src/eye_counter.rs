//! Counting in front of the sample from the eye's own count (++ZP).

use antumbra_gpu::{Expectation, Gpu, GpuError, Technique, TechniqueConfig};
use serde::{Deserialize, Serialize};

use crate::technique::{Counted, Start, VolumeTechnique};
use crate::triangles::Method;
use crate::{Counter, Savings, expectation};

/// Shadow volumes counted between eye and sample, and added to the number of volumes that contain the eye, which a
/// compute pass finds (++ZP, *Real-Time Shadows* 2.4.5). Faces are cut off at the eye and not at the near plane, so
/// that one number serves the whole picture. Wrong as a whole where the eye lies in a volume's side within rounding.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct EyeCounter {
    /// What counts; default wide.
    pub counter: Counter,
    /// What of volumes is not drawn since it decides nothing, but of those that may contain the eye; default none.
    pub savings: Savings,
}

impl EyeCounter {
    /// The technique itself, for reading its counts.
    ///
    /// # Errors
    /// A shader that does not link (a fault of this library).
    pub fn technique(&self, gpu: &Gpu) -> Result<VolumeTechnique, GpuError> {
        let how = Counted {
            counter: self.counter,
            method: Method::InFront,
            near_caps: true,
            start: Start::Eye,
            culling: false,
            savings: self.savings,
        };
        VolumeTechnique::new(gpu, how)
    }
}

impl TechniqueConfig for EyeCounter {
    fn build(&self, gpu: &Gpu) -> Result<Box<dyn Technique>, GpuError> {
        Ok(Box::new(self.technique(gpu)?))
    }

    fn expectation(&self, case: &str) -> Option<Expectation> {
        expectation::eye_counter(self.counter, case)
    }
}

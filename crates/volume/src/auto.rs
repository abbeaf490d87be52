//! Choosing for each volume how to count it.

use antumbra_gpu::{Expectation, Gpu, GpuError, Technique, TechniqueConfig};
use serde::{Deserialize, Serialize};

use crate::technique::{Counted, Start, VolumeTechnique};
use crate::triangles::Method;
use crate::{Counter, expectation};

/// Shadow volumes counted in front of the sample where they certainly do not contain the eye, and behind it where they
/// may: both count the volumes that contain the sample, so that they may be mixed (Everitt and Kilgard 2002). Saves
/// the far caps of the former.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Auto {
    /// What counts; default wide.
    pub counter: Counter,
}

impl Auto {
    /// The technique itself, for reading its counts.
    ///
    /// # Errors
    /// A shader that does not link (a fault of this library).
    pub fn technique(&self, gpu: &Gpu) -> Result<VolumeTechnique, GpuError> {
        let how = Counted {
            counter: self.counter,
            method: Method::Choose,
            near_caps: true,
            start: Start::Zero,
        };
        VolumeTechnique::new(gpu, how)
    }
}

impl TechniqueConfig for Auto {
    fn build(&self, gpu: &Gpu) -> Result<Box<dyn Technique>, GpuError> {
        Ok(Box::new(self.technique(gpu)?))
    }

    fn expectation(&self, case: &str) -> Option<Expectation> {
        expectation::z_fail(self.counter, case)
    }
}

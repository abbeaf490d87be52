//! Counting behind the sample (z-fail): right wherever the eye is.

use antumbra_gpu::{Expectation, Gpu, GpuError, Technique, TechniqueConfig};
use serde::{Deserialize, Serialize};

use crate::technique::{Counted, Start, VolumeTechnique};
use crate::triangles::Method;
use crate::{Counter, expectation};

/// Shadow volumes counted behind the sample, up to infinity (Bilodeau and Songy 1998; Carmack 2000): the number of
/// volumes that contain the sample, wherever the eye is and whatever the near plane cuts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ZFail {
    /// What counts; default wide.
    pub counter: Counter,
}

impl ZFail {
    /// The technique itself, for reading its counts.
    ///
    /// # Errors
    /// A shader that does not link (a fault of this library).
    pub fn technique(&self, gpu: &Gpu) -> Result<VolumeTechnique, GpuError> {
        let how = Counted {
            counter: self.counter,
            method: Method::Behind,
            near_caps: true,
            start: Start::Zero,
        };
        VolumeTechnique::new(gpu, how)
    }
}

impl TechniqueConfig for ZFail {
    fn build(&self, gpu: &Gpu) -> Result<Box<dyn Technique>, GpuError> {
        Ok(Box::new(self.technique(gpu)?))
    }

    fn expectation(&self, case: &str) -> Option<Expectation> {
        expectation::z_fail(self.counter, case)
    }
}

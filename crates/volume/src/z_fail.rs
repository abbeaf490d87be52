//! Counting behind the sample (z-fail): right wherever the eye is.

use antumbra_gpu::{Expectation, Gpu, GpuError, Technique, TechniqueConfig};
use serde::{Deserialize, Serialize};

use crate::technique::{Counted, Start, VolumeTechnique};
use crate::triangles::Method;
use crate::{Counter, Savings, expectation};

/// Shadow volumes counted behind the sample, up to infinity (Bilodeau and Songy 1998; Carmack 2000): the number of
/// volumes that contain the sample, wherever the eye is and whatever the near plane cuts.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ZFail {
    /// What counts; default wide.
    pub counter: Counter,
    /// Whether volumes that contain nothing in view are left away (after Lloyd, Wendt, Govindaraju and Manocha 2004 and
    /// Decoret 2005); default true. Costs a reduction of the view samples and a few sphere tests a triangle, and
    /// changes no bit of the answer.
    pub culling: bool,
    /// What of volumes is not drawn since it decides nothing; default [`Savings::WINDOW`].
    pub savings: Savings,
}

impl Default for ZFail {
    fn default() -> Self {
        Self { counter: Counter::default(), culling: true, savings: Savings::WINDOW }
    }
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
            culling: self.culling,
            savings: self.savings,
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

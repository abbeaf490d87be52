//! Counting in front of the sample from the near plane's counts (ZP+).

use antumbra_gpu::{Expectation, Gpu, GpuError, Technique, TechniqueConfig};
use serde::{Deserialize, Serialize};

use crate::technique::{Counted, Start, VolumeTechnique};
use crate::triangles::Method;
use crate::{Counter, Savings, expectation};

/// Shadow volumes counted between near plane and sample, and added to the number of volumes at each pixel's point of
/// the near plane, found by drawing the casters from the light onto it (Hornus, Hoberock, Lefebvre and Hart 2005).
/// The two drawings cut casters in different arithmetic, which leaves wrong pixels where a volume's boundary crosses
/// the near plane; a light in the near plane has no such drawing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ZpPlus {
    /// What counts; default wide.
    pub counter: Counter,
}

impl ZpPlus {
    /// The technique itself, for reading its counts.
    ///
    /// # Errors
    /// A shader that does not link (a fault of this library).
    pub fn technique(&self, gpu: &Gpu) -> Result<VolumeTechnique, GpuError> {
        let how = Counted {
            counter: self.counter,
            method: Method::InFront,
            near_caps: true,
            start: Start::NearPlane,
            culling: false,
            // Each pixel counts from its own point of the near plane, where no volume may be left away.
            savings: Savings::default(),
        };
        VolumeTechnique::new(gpu, how)
    }
}

impl TechniqueConfig for ZpPlus {
    fn build(&self, gpu: &Gpu) -> Result<Box<dyn Technique>, GpuError> {
        Ok(Box::new(self.technique(gpu)?))
    }

    fn expectation(&self, case: &str) -> Option<Expectation> {
        expectation::zp_plus(self.counter, case)
    }
}

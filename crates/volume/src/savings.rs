//! What may be saved of the cost of drawing volumes without a bit of the answer changing.

use antumbra_gpu::GpuError;
use serde::{Deserialize, Serialize};

/// Which parts of volumes are not drawn, since they decide nothing. None changes a bit of visibility. `window`, `near` and `far` cost a pass that asks for every volume (of a
/// triangle, or of a body) the boxes around 16 x 16 view samples, and 16 bytes a volume.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Savings {
    /// Whether a volume is drawn only in the part of the picture whose samples may be in it; default false.
    pub window: bool,
    /// Into how many slices such a part may fall, with nothing drawn between them (discrete clamping: Lloyd, Wendt,
    /// Govindaraju and Manocha 2004); 1 to 16, default 1. Each costs six vertices a face.
    pub slices: u32,
    /// Whether volumes begin only shortly before the first samples that may be in them (continuous clamping); default false.
    pub near: bool,
    /// Whether volumes end shortly behind the last samples that may be in them; default false. Costs a cap a triangle.
    pub far: bool,
    /// Whether to count the fragments of faces, as `volume_fragments`; default false. Costs an atomic addition each, and
    /// 4 bytes a sample.
    pub tally: bool,
}

impl Default for Savings {
    fn default() -> Self {
        Self { window: false, slices: 1, near: false, far: false, tally: false }
    }
}

impl Savings {
    /// What of volumes a triangle saves both fill and time on every scene measured, and is their default.
    pub const WINDOW: Self =
        Self { window: true, slices: 1, near: false, far: false, tally: false };

    /// All that saves on the street of the tests. Slices there save a hundredth of volumes of triangles, and cost more than
    /// they save of silhouettes.
    pub const ALL: Self = Self { window: true, slices: 1, near: true, far: true, tally: false };

    /// Whether volumes have limits.
    pub(crate) fn limits(&self) -> bool {
        self.window || self.near || self.far
    }

    /// # Errors
    /// A number out of range.
    pub(crate) fn check(&self) -> Result<(), GpuError> {
        if !(1..=16).contains(&self.slices) {
            let (what, value) = ("slices of a volume", self.slices.to_string());
            return Err(GpuError::Invalid { what, value, fix: "use 1 to 16" });
        }
        Ok(())
    }

    /// Draws of a face.
    pub(crate) fn instances(&self) -> u32 {
        if self.window { self.slices } else { 1 }
    }
}

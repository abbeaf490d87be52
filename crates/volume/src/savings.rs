//! What may be saved of the cost of drawing volumes without a bit of the answer changing.

use antumbra_gpu::GpuError;
use serde::{Deserialize, Serialize};

/// Which parts of volumes are not drawn, since they decide nothing. None changes a bit of visibility, but for `range`, which
/// leaves samples lit that the light does not reach. `window`, `near` and `far` cost a pass that asks for every volume (of a
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
    /// Distance from a lamp in metres up to which its light matters, for attenuation: sqrt(I / e) for an intensity I and
    /// half of a display's step e. Samples beyond it are given as lit, and ask for no shadow. Default none; nothing to
    /// parallel light.
    pub range: Option<f64>,
    /// Whether to count the fragments of faces, as `volume_fragments`; default false. Costs an atomic addition each, and
    /// 4 bytes a sample.
    pub tally: bool,
}

impl Default for Savings {
    fn default() -> Self {
        Self { window: false, slices: 1, near: false, far: false, range: None, tally: false }
    }
}

impl Savings {
    /// All that changes nothing.
    pub const ALL: Self =
        Self { window: true, slices: 4, near: true, far: true, range: None, tally: false };

    /// Whether volumes have limits.
    pub(crate) fn limits(&self) -> bool {
        self.window || self.near || self.far
    }

    /// # Errors
    /// A number out of range.
    pub(crate) fn check(&self) -> Result<(), GpuError> {
        let invalid = |what, value: String, fix| Err(GpuError::Invalid { what, value, fix });
        if !(1..=16).contains(&self.slices) {
            return invalid("slices of a volume", self.slices.to_string(), "use 1 to 16");
        }
        match self.range {
            Some(range) if !(range > 0.0 && range.is_finite()) => {
                let fix = "give metres above 0, or none for a light that reaches everything";
                invalid("range of the light", range.to_string(), fix)
            }
            _ => Ok(()),
        }
    }

    /// Draws of a face.
    pub(crate) fn instances(&self) -> u32 {
        if self.window { self.slices } else { 1 }
    }

    /// Square of the range for shaders, 0 for none.
    pub(crate) fn range_squared(&self) -> f32 {
        self.range.map_or(0.0, |range| (range * range) as f32)
    }
}

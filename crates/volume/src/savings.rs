//! What may be saved of the cost of drawing volumes without a bit of the answer changing.

use antumbra_gpu::{CasterEdges, Frame, Gpu, GpuError};
use serde::{Deserialize, Serialize};

use crate::light::edges;

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
    /// Texels a side of a map from the light that keeps what the camera sees there (litmap: Decoret 2005), which volumes ask for
    /// all of the above; under a lamp six maps of half the side. A power of two from 16 to 1024, or 0 for none, the
    /// default. Costs 16 bytes a texel and level of its N-buffer (9 MiB for 256), and some lookups a volume.
    pub litmap: u32,
    /// Whether volumes are left away whose casters are hidden from the light by others (CC shadow volumes: Lloyd et al.
    /// 2004), as far as the litmap resolves it; default false. Needs casters with edges, and costs a few lines a texel
    /// that they cover. Counts are then of fewer volumes, and 0 where they were: before an eye in shadow, where the
    /// counts of `volume/z-pass` are wrong, they are wrong in another way.
    pub hidden: bool,
    /// How far a lamp reaches, metres; default without end. Samples farther from it count as lit, and volumes are cut off
    /// beyond (attenuation limits: Lengyel 2002; McGuire et al. 2003); see [`crate::reach`].
    pub reach: Option<f64>,
    /// Whether to count the fragments of faces, as `volume_fragments`; default false. Costs an atomic addition each, and
    /// 4 bytes a sample.
    pub tally: bool,
}

impl Default for Savings {
    fn default() -> Self {
        Self {
            window: false,
            slices: 1,
            near: false,
            far: false,
            litmap: 0,
            hidden: false,
            reach: None,
            tally: false,
        }
    }
}

impl Savings {
    /// What of volumes a triangle saves both fill and time on every scene measured, and is their default.
    pub const WINDOW: Self = Self {
        window: true,
        slices: 1,
        near: false,
        far: false,
        litmap: 0,
        hidden: false,
        reach: None,
        tally: false,
    };

    /// All that saves on the street of the tests. Slices there save a hundredth of volumes of triangles, and cost more than
    /// they save of silhouettes.
    pub const ALL: Self = Self { near: true, far: true, litmap: 256, hidden: true, ..Self::WINDOW };

    /// Whether volumes have limits.
    pub(crate) fn limits(&self) -> bool {
        self.window || self.near || self.far || self.litmap > 0
    }

    /// # Errors
    /// A number out of range.
    pub(crate) fn check(&self) -> Result<(), GpuError> {
        if !(1..=16).contains(&self.slices) {
            let (what, value) = ("slices of a volume", self.slices.to_string());
            return Err(GpuError::Invalid { what, value, fix: "use 1 to 16" });
        }
        let side = self.litmap;
        if side != 0 && !(side.is_power_of_two() && (16..=1024).contains(&side)) {
            let (what, value) = ("texels a side of a litmap", side.to_string());
            return Err(GpuError::Invalid {
                what,
                value,
                fix: "use a power of two from 16 to 1024, or 0",
            });
        }
        if self.hidden && side == 0 {
            let (what, value) = ("hidden casters", "without a litmap".to_owned());
            return Err(GpuError::Invalid { what, value, fix: "set `litmap`, to 256 for example" });
        }
        if let Some(reach) = self.reach.filter(|r| !(*r > 0.0 && r.is_finite())) {
            let (what, value) = ("reach of a light", reach.to_string());
            return Err(GpuError::Invalid { what, value, fix: "give metres above 0, or none" });
        }
        Ok(())
    }

    /// The light's reach, metres; 0 without end.
    pub(crate) fn reach(&self) -> f32 {
        self.reach.unwrap_or(0.0) as f32
    }

    /// A little more than the reach, so that rounding leaves no sample away that is within it.
    pub(crate) fn reach_of_interest(&self) -> f32 {
        self.reach() * (1.0 + 1.0 / 1024.0)
    }

    /// The casters' edges, where hidden ones are left away.
    pub(crate) fn edges<'a>(
        &self,
        gpu: &Gpu,
        frame: &Frame<'a>,
    ) -> Result<Option<&'a CasterEdges>, GpuError> {
        let fix = "implement `Casters::edges` with `CasterEdges`, or leave `savings.hidden` out";
        if self.hidden { edges(gpu, frame, fix).map(Some) } else { Ok(None) }
    }

    /// Draws of a face.
    pub(crate) fn instances(&self) -> u32 {
        if self.window { self.slices } else { 1 }
    }
}

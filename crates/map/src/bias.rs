//! Depth bias, derived rather than tuned.

use antumbra_gpu::GpuError;
use serde::{Deserialize, Serialize};

/// How far a receiver is moved towards the light before it is compared.
///
/// The slack of a comparison is `constant * rounding + slope * (|dz/ds| + |dz/dt|) * reach`, where
/// `rounding` bounds the rounding of both transforms, of the rasteriser's interpolation and of the store,
/// (s, t) are texels, and `reach` is how far, in texels, a compared texel's centre can lie from the point
/// whose depth is its reference, plus the rasteriser's sub-texel step. With the receiver's plane that
/// distance is 0 for estimators that read texels one by one; without it, it is the kernel's radius. So 1
/// is right for every map size, light and kernel, and there is nothing to tune; other values exist to
/// study what happens without. On top of it come the cone, and, for those who want them, what renderers set
/// by hand: a constant in metres and an offset along the normal.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Bias {
    /// Gives each texel the depth that the receiver's plane has at its centre (Schueler 2005; Isidoro
    /// 2006) instead of the receiver's own. Default true. Costs two multiply-adds a tap.
    pub receiver_plane: bool,
    /// Factor on the slope term, >= 0, default 1; 0 brings back acne on slopes, 2 doubles the leak at
    /// contacts.
    pub slope: f32,
    /// Slope of the bias cone, metres of depth a metre to the side, relative to the receiver's plane (Burley
    /// 2006): a texel that is nearer to the light by less is the receiver's own surface, bent, not a caster
    /// above it. >= 0, default 2, the slope between the two sides of a right-angled crease that the light
    /// meets evenly: where it meets one side at angle a the sides differ by tan a + 1 / tan a, which is least,
    /// 2, at 45 degrees. For receivers that the light meets at more than that the cone widens in this proportion.
    /// 0 darkens creases, kerbs and paint on roads within the kernel's radius; the leak at a
    /// contact grows by half the cone's slope times the kernel's radius.
    pub cone: f32,
    /// Factor on the rounding term, >= 0, default 1.
    pub constant: f32,
    /// Moves the receiver towards the light by so many metres of light depth, >= 0, default 0: the constant bias
    /// of old. On a floor lit at the elevation a it opens a gap of `metres` cos a less the caster's thickness.
    pub metres: f32,
    /// Moves the receiver along its normal by so many sides of a texel times the sine of the angle between the
    /// normal and the map's axis, >= 0, default 0 (Holbert 2011). [`crate::NormalOffset`] says how much replaces
    /// `receiver_plane`; a shadow's edge moves by up to as much.
    pub normal: f32,
}

impl Default for Bias {
    fn default() -> Self {
        Self {
            receiver_plane: true,
            slope: 1.0,
            cone: 2.0,
            constant: 1.0,
            metres: 0.0,
            normal: 0.0,
        }
    }
}

impl Bias {
    /// No bias at all: half of every sloped receiver is in false shadow. A control for tests.
    pub const NONE: Self = Self {
        receiver_plane: false,
        slope: 0.0,
        cone: 0.0,
        constant: 0.0,
        metres: 0.0,
        normal: 0.0,
    };

    /// The bound on rounding alone: for maps that keep a receiver from being compared with its own surface.
    pub const ROUNDING: Self = Self { constant: 1.0, ..Self::NONE };

    /// # Errors
    /// A factor that is negative or not finite.
    pub(crate) fn validate(&self) -> Result<(), GpuError> {
        let factors = [
            ("bias.slope", self.slope),
            ("bias.cone", self.cone),
            ("bias.constant", self.constant),
            ("bias.metres", self.metres),
            ("bias.normal", self.normal),
        ];
        for (what, value) in factors {
            if !(value.is_finite() && value >= 0.0) {
                let fix = "use a finite number of at least 0; the default is the derived bias";
                return Err(GpuError::Invalid { what, value: value.to_string(), fix });
            }
        }
        Ok(())
    }
}

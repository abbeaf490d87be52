//! View samples, and what became of each of them in a comparison.

use glam::Vec3;
use serde::{Deserialize, Serialize};

/// A point of a visible surface at which shadow is evaluated.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ViewSample {
    /// Position in metres, relative to `Triangles::origin`.
    pub position: Vec3,
    /// Unit geometric normal on the viewer's side; zero where the view shows no surface.
    pub normal: Vec3,
}

/// Whether a sample enters the error figures, and if not, why.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SampleClass {
    /// Enters every figure.
    Counted,
    /// The geometric normal faces away from the whole light; counted apart.
    FacingAway,
    /// Outside the light's cone or its one-sided emission: no shadow is defined there.
    OutsideLight,
    /// So near the shadow boundary that rounding decides the truth; counted apart.
    Tie,
    /// The view shows no surface.
    Missing,
}

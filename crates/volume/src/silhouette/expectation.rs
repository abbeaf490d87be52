//! What theory says of silhouettes on each hard case.
//!
//! The cases and their numbers are those of `antumbra_measure::stability::CASES`; a case is right at 0.

use antumbra_gpu::Expectation::{self, Refuses};

use super::{Meshes, Silhouette};

/// What theory says, on the hard case named `case`; `None` for a case that is not known here.
pub(super) fn expectation(config: &Silhouette, case: &str) -> Option<Expectation> {
    // Faces are fewer, and count what those of all triangles count.
    let usual = crate::expectation::z_fail(config.counter, case)?;
    let lone = case.starts_with("lone receivers");
    let manifold = !(case.starts_with("HC-19") || case.starts_with("HC-20"));
    Some(match (config.meshes, usual) {
        (_, Refuses { because }) => Refuses { because },
        (Meshes::Watertight, _) if !lone => {
            Refuses { because: "the scene has meshes that are not closed" }
        }
        (Meshes::Manifold, _) if !manifold => {
            Refuses { because: "the scene has a mesh that is no manifold" }
        }
        (_, usual) => usual,
    })
}

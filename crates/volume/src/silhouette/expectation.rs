//! What theory says of silhouettes on each hard case.
//!
//! The cases and their numbers are those of `antumbra_measure::stability::CASES`; a case is right at 0.

use antumbra_gpu::Expectation;

use super::{Meshes, Silhouette};

/// What theory says, on the hard case named `case`; `None` for a case that is not known here.
pub(super) fn expectation(config: &Silhouette, case: &str) -> Option<Expectation> {
    use Expectation::{Holds, Refuses};
    let without_camera = Refuses {
        because: "faces are counted along lines of sight, and the case's samples are seen by no camera",
    };
    let mesh_is = |fits: bool, holds: Expectation| match config.meshes {
        Meshes::Watertight if !fits => {
            Refuses { because: "the scene has meshes that are not closed" }
        }
        _ => holds,
    };
    let exact = Holds { bound: 0.0 };
    // Positions are rounded to 2^-24 of at most 20 m, corner by corner; three of them and the sample's move an edge by
    // less than 1e-5 m, against texels of at least 2 m / 4096.
    let edge = Holds { bound: 1e-5 / (2.0 / 4096.0) };
    Some(match case {
        "lone receivers, directional" | "lone receivers, spot" | "lone receivers, point" => exact,
        // Near caps have a sample in their plane on the light's side.
        "HC-03 grazing plane" | "HC-03 grazing plane, diagonal" => mesh_is(false, exact),
        // All f32 positions are relative to an origin near the scene.
        "HC-14 far from the origin" => mesh_is(false, exact),
        "HC-19 three and four triangles on an edge" | "HC-20 winding without a side" => {
            match config.meshes {
                Meshes::Manifold => Refuses { because: "the scene has a mesh that is no manifold" },
                _ => mesh_is(false, edge),
            }
        }
        "HC-22 vertex on an edge" => mesh_is(false, edge),
        "HC-01 A, point light"
        | "HC-01 B, sun overhead"
        | "HC-01 C, slanting sun"
        | "HC-01 B, turned 30 degrees"
        | "HC-02 light amid the caster"
        | "HC-04 thin wall"
        | "HC-05 cube"
        | "HC-13 depth precision"
        | "HC-13 depth precision, near caster"
        | "HC-31 wire below a texel"
        | "HC-40 casters out of view" => without_camera,
        _ => return None,
    })
}

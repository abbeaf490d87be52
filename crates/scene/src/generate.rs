//! Generated scenes: easy ones with a closed-form answer, and hard ones that techniques fail on.
//!
//! Every scene brings a camera and at least a directional light, and is the same at every call on
//! one machine; the sines and cosines in it are the platform's. Numbers are metres and radians.
//! Where a scene has a case number (HC-01 and so on), its numbers are those of that case and tests
//! rely on them.

mod basic;
mod built;
mod cut;
mod nature;
mod panes;
mod random;
pub mod shapes;
mod thin;
mod topology;

use glam::DVec3;

use crate::{Camera, Scene};

pub use basic::{
    DiscOverPlane, HalfPlaneOverPlane, RectOverPlane, SphereOverPlane, cube_on_floor,
    disc_over_plane, grazing_plane, half_plane_over_plane, rectangle_over_plane, sphere_over_plane,
    thin_wall,
};
pub use built::{hall, street};
pub use cut::{LeafCard, checker_card, leaf_card};
pub use nature::{Grass, Hair, Terrain, Tree, grass, hair, terrain, tree};
pub use panes::{PANES, panes, stained_glass};
pub use thin::{THICKNESSES, ThinCasters, fence, wires};
pub use topology::{moebius, non_manifold, pages, poles, t_junction, two_storeys, unorientable};

/// A scene's name, the function that makes it, and what it tests.
pub type Entry = (&'static str, fn() -> Scene, &'static str);

/// All generated scenes but the convex ones, those with holes and those that let light through.
pub const ALL: &[Entry] = &[
    (
        "half-plane",
        || half_plane_over_plane(&HalfPlaneOverPlane::default()),
        "one straight shadow edge; closed form for every light",
    ),
    (
        "rectangle",
        || rectangle_over_plane(&RectOverPlane::default()),
        "HC-01: the baseline; closed form for every light, four corners",
    ),
    (
        "disc",
        || disc_over_plane(&DiscOverPlane::default()),
        "a round shadow edge without a preferred direction",
    ),
    (
        "sphere",
        || sphere_over_plane(&SphereOverPlane::default()),
        "HC-08: a curved caster; acne and light leaks along its terminator",
    ),
    (
        "grazing-plane",
        || grazing_plane(0.0),
        "HC-03: a receiver lit at 5 degrees along a map axis; all lit, acne without slope bias",
    ),
    (
        "grazing-plane-diagonal",
        || grazing_plane(std::f64::consts::FRAC_PI_4),
        "HC-03: the same at 45 degrees to the axes",
    ),
    ("thin-wall", thin_wall, "HC-04: contact of a wall thinner than a bias; leak at its foot"),
    ("cube", cube_on_floor, "HC-05: contact of a closed body; leak of back-face maps"),
    (
        "fence",
        || fence(&ThinCasters::default(), &THICKNESSES),
        "pickets of 0.3 to 3 texels side by side; mean shadow of each panel 1/2 seen from far",
    ),
    (
        "wires",
        || wires(&ThinCasters::default(), &THICKNESSES),
        "wires of 0.3 to 3 texels at 30 degrees to the axes; continuous thin lines",
    ),
    ("tree", || tree(&Tree::default()), "layered casters at many depths, small leaves"),
    ("grass", || grass(&Grass::default()), "dense thin casters that shadow each other"),
    ("hair", || hair(&Hair::default()), "ribbons thinner than texels, in layers over a receiver"),
    ("terrain", || terrain(&Terrain::default()), "one large mesh, its own caster and receiver"),
    ("hall", hall, "a closed room with columns and arches, lit through openings in the roof"),
    ("non-manifold", non_manifold, "HC-19: three and four triangles on one edge; silhouettes"),
    ("unorientable", unorientable, "HC-20: triangles wound against each other; a Moebius strip"),
    ("street", street, "a depth range of hundreds of metres from a low camera; cascades"),
];

/// Lone convex bodies without anything else. No point of their surface that faces a light is
/// shadowed, so every shadowed sample that does is acne.
pub const CONVEX: &[Entry] = &[
    ("convex-sphere", || basic::lone(shapes::icosphere(4, 1.0)), "acne on a curved surface"),
    (
        "convex-cube",
        || basic::lone(shapes::cuboid(-DVec3::ONE, DVec3::ONE)),
        "acne on faces along the axes",
    ),
    ("convex-tetrahedron", || basic::lone(shapes::tetrahedron(1.0)), "acne on few, sharp edges"),
    (
        "convex-cylinder",
        || basic::lone(shapes::cylinder(1.0, 2.0, 48)),
        "acne on a surface curved one way",
    ),
];

/// Casters with holes, which only techniques that have casters drawn see.
pub const CUT_OUT: &[Entry] = &[
    (
        "leaf-card",
        || leaf_card(&LeafCard::default()),
        "a card of which a disc is there; closed form for every light",
    ),
    (
        "checker-card",
        || checker_card(64),
        "HC-35: a card of which every other square is there; mean shadow 1/2",
    ),
];

/// Casters that let a part of the light through, which `volume/translucent` alone looks for.
pub const TRANSLUCENT: &[Entry] = &[
    ("panes", panes, "HC-36: one to ten sheets that each halve the light"),
    ("stained-glass", stained_glass, "a window of many opacities; a ball and a bottle behind it"),
];

/// The scene of that name, of [`ALL`], [`CONVEX`], [`CUT_OUT`] or [`TRANSLUCENT`].
#[must_use]
pub fn by_name(name: &str) -> Option<Scene> {
    let mut entries = ALL.iter().chain(CONVEX).chain(CUT_OUT).chain(TRANSLUCENT);
    entries.find(|entry| entry.0 == name).map(|entry| (entry.1)())
}

/// A scene of that name, without anything in it.
fn empty(name: &str) -> Scene {
    Scene { name: name.to_owned(), ..Scene::default() }
}

/// A camera with a vertical field of view of 45 degrees, upright.
fn look(eye: [f64; 3], target: [f64; 3], near: f64) -> Camera {
    Camera {
        eye: DVec3::from_array(eye),
        target: DVec3::from_array(target),
        up: DVec3::Y,
        fov_y: std::f64::consts::FRAC_PI_4,
        near,
    }
}

#[cfg(test)]
mod tests;

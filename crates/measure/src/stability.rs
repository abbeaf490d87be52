//! The hard cases: scenes on which shadow techniques are known to fail, each with one number that says how
//! badly.
//!
//! A [`Case`] knows nothing of techniques. What a technique is expected to score stands with the
//! techniques (`antumbra::Config::expectation`).
//!
//! Lengths are counted in texels of an *ideal map*: `map_size` of them a side over exactly the boxes around
//! the casters, as the light sees them; where they are not square, the longer side counts. A technique
//! whose map covers more is held to a bound that says so.

mod acne;
mod area;
mod bodies;
mod cutout;
mod edge;
mod known;
mod line;
mod motion;
mod panes;
mod sampled;
mod seams;
mod seen;
mod storeys;
mod topology;
mod viewed;

use antumbra_gpu::{Gpu, Technique};
use antumbra_scene::{LightKind, generate};

pub use seams::{EdgeError, Seams};

use crate::MeasureError;

/// A hard case: a scene, and the number by which to judge a technique on it.
#[derive(Clone, Copy, Debug)]
pub struct Case {
    /// Name, unique.
    pub name: &'static str,
    /// Whose business it is.
    pub kind: Kind,
    /// What it tests.
    pub about: &'static str,
    /// What its number is, with the unit. 0 is always right.
    pub number: &'static str,
    measure: fn(&Gpu, &mut dyn Technique, u32) -> Result<f64, MeasureError>,
}

/// What a hard case asks of a technique.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// The shadow of a light without extent: asked of all.
    HardShadow,
    /// That a lone receiver stays lit: asked of all.
    SelfShadowing,
    /// That a map's texels go where the camera needs them: asked of what arranges maps.
    Placement,
    /// The shadow of a light with an extent: asked of soft shadows.
    AreaLight,
    /// That casters let light through: asked of what looks for such casters.
    Translucency,
}

impl Case {
    /// Runs `technique`, whose maps have `map_size` texels a side, and gives the case's number. NaN, which
    /// meets no expectation, where there was nothing to judge.
    ///
    /// # Errors
    /// A case that the technique or the device refuses, or an answer that is no visibility.
    pub fn measure(
        &self,
        gpu: &Gpu,
        technique: &mut dyn Technique,
        map_size: u32,
    ) -> Result<f64, MeasureError> {
        (self.measure)(gpu, technique, map_size)
    }

    /// The case of that name, of [`CASES`].
    #[must_use]
    pub fn by_name(name: &str) -> Option<&'static Self> {
        CASES.iter().find(|case| case.name == name)
    }
}

const FALSE_SHADOW: &str = "share of the samples facing the light that are not fully lit";
const FARTHEST: &str = "distance of the farthest wrong sample from the shadow's edge, texels";
const GAP: &str = "lit strip between caster and shadow, texels";
const EXCESS: &str = "error beside a seam beyond that elsewhere, as a share of it";
const EXPLAINED: &str =
    "largest error of visibility beyond that of a caster larger or smaller by a 64th of the map";
const FLICKER: &str = "largest second difference of the error over three frames";
const WRONG: &str = "share of wrong samples, none of them near a shadow's edge";

/// All hard cases.
pub const CASES: &[Case] = &[
    Case {
        name: "lone receivers, directional",
        kind: Kind::SelfShadowing,
        about: "nothing shadows a convex body that stands alone (sphere, cube, tetrahedron, cylinder)",
        number: FALSE_SHADOW,
        measure: |gpu, technique, _| acne::lone_receivers(gpu, technique, LightKind::Directional),
    },
    Case {
        name: "lone receivers, spot",
        kind: Kind::SelfShadowing,
        about: "the same in perspective: depth is no longer affine in distance",
        number: FALSE_SHADOW,
        measure: |gpu, technique, _| acne::lone_receivers(gpu, technique, LightKind::Spot),
    },
    Case {
        name: "lone receivers, point",
        kind: Kind::SelfShadowing,
        about: "the same across the seams of a cube map",
        number: FALSE_SHADOW,
        measure: |gpu, technique, _| acne::lone_receivers(gpu, technique, LightKind::Point),
    },
    Case {
        name: "HC-01 A, point light",
        kind: Kind::HardShadow,
        about: "a level square shadows a floor: nothing is wrong but at the shadow's edge",
        number: FARTHEST,
        measure: |gpu, technique, size| edge::square(2, size).farthest_wrong(gpu, technique),
    },
    Case {
        name: "HC-01 B, sun overhead",
        kind: Kind::HardShadow,
        about: "the same in parallel light",
        number: FARTHEST,
        measure: |gpu, technique, size| edge::square(1, size).farthest_wrong(gpu, technique),
    },
    Case {
        name: "HC-01 C, slanting sun",
        kind: Kind::HardShadow,
        about: "the same in parallel light at 45 degrees",
        number: FARTHEST,
        measure: |gpu, technique, size| edge::square(0, size).farthest_wrong(gpu, technique),
    },
    Case {
        name: "HC-01 B, turned 30 degrees",
        kind: Kind::HardShadow,
        about: "the same with edges that cross the texels' rows at all phases",
        number: FARTHEST,
        measure: |gpu, technique, size| edge::turned_square(size).farthest_wrong(gpu, technique),
    },
    Case {
        name: "HC-02 light amid the caster",
        kind: Kind::HardShadow,
        about: "of a triangle that reaches above the light, only what lies below casts on the floor",
        number: FARTHEST,
        measure: |gpu, technique, size| edge::rising_triangle(size).farthest_wrong(gpu, technique),
    },
    Case {
        name: "HC-03 grazing plane",
        kind: Kind::SelfShadowing,
        about: "a lone floor lit at 5 degrees: across a texel its depth changes by 11 times the texel's side",
        number: FALSE_SHADOW,
        measure: |gpu, technique, _| acne::grazing_plane(gpu, technique, 0.0),
    },
    Case {
        name: "HC-03 grazing plane, diagonal",
        kind: Kind::SelfShadowing,
        about: "the same at 45 degrees to the floor's sides",
        number: FALSE_SHADOW,
        measure: |gpu, technique, _| {
            acne::grazing_plane(gpu, technique, std::f64::consts::FRAC_PI_4)
        },
    },
    Case {
        name: "HC-04 thin wall",
        kind: Kind::HardShadow,
        about: "a wall of 1 cm keeps the shadow at its foot: what a bias opens there is a leak",
        number: GAP,
        measure: line::thin_wall,
    },
    Case {
        name: "HC-05 cube",
        kind: Kind::HardShadow,
        about: "a closed body keeps the shadow at its foot, for maps of back faces too",
        number: GAP,
        measure: line::cube,
    },
    Case {
        name: "HC-06 open sheet",
        kind: Kind::HardShadow,
        about: "a single sheet that shows the light its front casts a shadow like any other",
        number: WRONG,
        measure: |gpu, technique, _| known::sheet().wrong_share(gpu, technique),
    },
    Case {
        name: "HC-07 post under a lid",
        kind: Kind::HardShadow,
        about: "a post a tenth of a texel thick, which no texel shows, stands in the shadow of a sheet",
        number: WRONG,
        measure: |gpu, technique, size| known::post_under_lid(size).wrong_share(gpu, technique),
    },
    Case {
        name: "HC-08 sphere's limb",
        kind: Kind::HardShadow,
        about: "the lit half of a sphere is lit up to the limb, where front and back converge",
        number: "distance from the limb of the farthest sample not fully lit, texels",
        measure: bodies::limb,
    },
    Case {
        name: "HC-09 boxes in each other",
        kind: Kind::HardShadow,
        about: "two boxes that run into each other: layers that belong to neither alone",
        number: WRONG,
        measure: bodies::interpenetrating,
    },
    Case {
        name: "HC-10 triangles below a texel",
        kind: Kind::HardShadow,
        about: "a lone floor with eight triangles a texel",
        number: FALSE_SHADOW,
        measure: bodies::fine_floor,
    },
    Case {
        name: "HC-11 seams of a cube",
        kind: Kind::HardShadow,
        about: "shadow edges across the edges between a cube map's faces are no worse than elsewhere",
        number: EXCESS,
        measure: |gpu, technique, size| seams::excess(gpu, technique, size, Seams::Cube),
    },
    Case {
        name: "HC-11 seams of a tetrahedron",
        kind: Kind::HardShadow,
        about: "shadow edges across the edges between a tetrahedron's faces are no worse than elsewhere",
        number: EXCESS,
        measure: |gpu, technique, size| seams::excess(gpu, technique, size, Seams::Tetrahedron),
    },
    Case {
        name: "HC-11 seams of an isocube",
        kind: Kind::HardShadow,
        about: "shadow edges across the edges between an isocube's charts are no worse than elsewhere",
        number: EXCESS,
        measure: |gpu, technique, size| seams::excess(gpu, technique, size, Seams::Isocube),
    },
    Case {
        name: "HC-11 seams of a paraboloid",
        kind: Kind::HardShadow,
        about: "shadow edges across the rim on which two paraboloids meet are no worse than elsewhere",
        number: EXCESS,
        measure: |gpu, technique, size| seams::excess(gpu, technique, size, Seams::Paraboloid),
    },
    Case {
        name: "HC-12 two triangles below the light",
        kind: Kind::HardShadow,
        about: "a square of 40 m, 1 m below a point light, in two triangles: edges of 90 degrees",
        number: WRONG,
        measure: |gpu, technique, _| known::wide_square().wrong_share(gpu, technique),
    },
    Case {
        name: "HC-13 depth precision",
        kind: Kind::HardShadow,
        about: "two plates 500 m from a spot light, 5 cm apart: 1 part in 10000 of the distance",
        number: WRONG,
        measure: |gpu, technique, size| known::plates(false, size).wrong_share(gpu, technique),
    },
    Case {
        name: "HC-13 depth precision, near caster",
        kind: Kind::HardShadow,
        about: "the same with a caster 0.1 m from the light and one 1000 m off: nothing to fit to",
        number: WRONG,
        measure: |gpu, technique, size| known::plates(true, size).wrong_share(gpu, technique),
    },
    Case {
        name: "HC-14 far from the origin",
        kind: Kind::HardShadow,
        about: "HC-01 and HC-03 moved by 1e5 m along x and z look the same as at the origin",
        number: "share of samples that the move changes",
        measure: |gpu, technique, _| acne::moved(gpu, technique),
    },
    Case {
        name: "HC-02 in view",
        kind: Kind::HardShadow,
        about: "HC-02 at the pixels of a camera, one a texel, for techniques that draw from it",
        number: FARTHEST,
        measure: seen::rising_triangle,
    },
    Case {
        name: "HC-22 T-junction",
        kind: Kind::HardShadow,
        about: "a plate of one quad beside two: no light comes through where their corners meet its edge",
        number: "share of the samples deep in shadow that are not fully dark",
        measure: seen::t_junction,
    },
    Case {
        name: "HC-23 light at the eye",
        kind: Kind::HardShadow,
        about: "a point light at the camera's eye, and on its near plane, over the square of HC-01",
        number: FARTHEST,
        measure: seen::light_at_the_eye,
    },
    Case {
        name: "HC-24 light at a vertex",
        kind: Kind::HardShadow,
        about: "a light at a corner of a plate, in the plate's plane, hides nothing from the floor below",
        number: FALSE_SHADOW,
        measure: |gpu, technique, _| seen::light_at_a_vertex(gpu, technique),
    },
    Case {
        name: "HC-24 light in a cube",
        kind: Kind::HardShadow,
        about: "a light in a closed cube lights nothing outside",
        number: "share of the floor's samples that are lit",
        measure: |gpu, technique, _| seen::light_in_a_cube(gpu, technique),
    },
    Case {
        name: "HC-24 light on the floor",
        kind: Kind::HardShadow,
        about: "a light a micrometre above the floor, below every caster, lights all of it",
        number: FALSE_SHADOW,
        measure: |gpu, technique, _| seen::light_on_the_floor(gpu, technique),
    },
    Case {
        name: "HC-25 caster out of sight",
        kind: Kind::HardShadow,
        about: "the square of HC-01 under its three lights, seen from above through the square itself",
        number: FARTHEST,
        measure: seen::through_the_caster,
    },
    Case {
        name: "HC-19 three and four triangles on an edge",
        kind: Kind::HardShadow,
        about: "silhouettes of meshes that are no manifolds have edges that count once, twice or not at all",
        number: FARTHEST,
        measure: |gpu, technique, size| {
            topology::farthest_wrong(gpu, technique, &generate::non_manifold(), size)
        },
    },
    Case {
        name: "HC-20 winding without a side",
        kind: Kind::HardShadow,
        about: "a square wound against itself and a Moebius strip have no front",
        number: FARTHEST,
        measure: |gpu, technique, size| {
            topology::farthest_wrong(gpu, technique, &generate::unorientable(), size)
        },
    },
    Case {
        name: "HC-22 vertex on an edge",
        kind: Kind::HardShadow,
        about: "a vertex in the middle of another quad's edge, 1e-7 m off it: a crack of no width",
        number: FARTHEST,
        measure: |gpu, technique, size| {
            topology::farthest_wrong(gpu, technique, &generate::t_junction(1e-7), size)
        },
    },
    Case {
        name: "HC-15 eye in shadow",
        kind: Kind::HardShadow,
        about: "the eye stands in the shadow of a plate 10 m wide and sees its edge on the floor",
        number: WRONG,
        measure: viewed::eye_in_shadow,
    },
    Case {
        name: "HC-16 boundary near the eye",
        kind: Kind::HardShadow,
        about: "the eye stands 1 mm or 5 cm beside a shadow's boundary, which crosses the near plane",
        number: "largest share of wrong samples of 8 pictures, none of them near a shadow's edge",
        measure: |gpu, technique, size| viewed::boundary_at_eye(gpu, technique, size, false),
    },
    Case {
        name: "HC-16 boundary through the eye",
        kind: Kind::HardShadow,
        about: "the same with the eye exactly on the boundary",
        number: "largest share of wrong samples of 2 pictures, none of them near a shadow's edge",
        measure: |gpu, technique, size| viewed::boundary_at_eye(gpu, technique, size, true),
    },
    Case {
        name: "HC-17 beyond the far plane",
        kind: Kind::HardShadow,
        about: "a shadow falls on a wall just before the far plane; what makes it goes on beyond",
        number: FARTHEST,
        measure: viewed::beyond_far_plane,
    },
    Case {
        name: "HC-18 sheets",
        kind: Kind::HardShadow,
        about: "stacks of 255, 257 and 300 sheets over a floor",
        number: WRONG,
        measure: |gpu, technique, size| viewed::sheets(gpu, technique, size, &[255, 257, 300]),
    },
    Case {
        name: "HC-18 256 sheets",
        kind: Kind::HardShadow,
        about: "a stack of 256 sheets over a floor: one more than a byte can count",
        number: WRONG,
        measure: |gpu, technique, size| viewed::sheets(gpu, technique, size, &[256]),
    },
    Case {
        name: "HC-21 light in the plane",
        kind: Kind::HardShadow,
        about: "a lamp in a triangle's plane, and slivers of 0.1 mm that it sees all but edge-on: no shadow",
        number: WRONG,
        measure: |gpu, technique, _| viewed::light_in_plane(gpu, technique),
    },
    Case {
        name: "HC-23 lamp at the eye, in view",
        kind: Kind::HardShadow,
        about: "a lamp at the eye shows no shadow",
        number: FARTHEST,
        measure: |gpu, technique, size| viewed::light_at_eye(gpu, technique, size, false),
    },
    Case {
        name: "HC-23 light in the near plane",
        kind: Kind::HardShadow,
        about: "a lamp in the camera's near plane, beside the axis",
        number: FARTHEST,
        measure: |gpu, technique, size| viewed::light_at_eye(gpu, technique, size, true),
    },
    Case {
        name: "HC-24 lamp in a cube, in view",
        kind: Kind::HardShadow,
        about: "a lamp in a closed cube leaves the world outside dark",
        number: WRONG,
        measure: |gpu, technique, _| viewed::light_in_geometry(gpu, technique, true),
    },
    Case {
        name: "HC-24 light at a corner",
        kind: Kind::HardShadow,
        about: "a lamp at the very corner of a triangle, which has no shadow then",
        number: WRONG,
        measure: |gpu, technique, _| viewed::light_in_geometry(gpu, technique, false),
    },
    Case {
        name: "HC-25 caster not seen",
        kind: Kind::HardShadow,
        about: "the camera looks through a plate that its near plane cuts off: the shadow is there all the same",
        number: WRONG,
        measure: viewed::caster_not_seen,
    },
    Case {
        name: "HC-28 downstairs",
        kind: Kind::HardShadow,
        about: "a thousand cubes on the floor below are nothing to the shadows under a lamp upstairs",
        number: "share of the samples upstairs that the cubes change",
        measure: |gpu, technique, _| storeys::downstairs(gpu, technique),
    },
    Case {
        name: "HC-31 wire below a texel",
        kind: Kind::HardShadow,
        about: "a wire of 0.4 texels across the texels' rows at 30 degrees",
        number: "mean visibility under the wire's axis",
        measure: line::wire,
    },
    Case {
        name: "HC-35 checker",
        kind: Kind::HardShadow,
        about: "a card of which every other square is there, each of 64 texels",
        number: WRONG,
        measure: cutout::cells,
    },
    Case {
        name: "HC-35 checker of texels",
        kind: Kind::HardShadow,
        about: "the same with squares of a texel: half of the light comes through",
        number: "distance of the mean visibility from a half",
        measure: cutout::mean,
    },
    Case {
        name: "HC-36 panes",
        kind: Kind::Translucency,
        about: "one to ten sheets that each halve the light, and one that lets a thousandth through",
        number: "largest distance of visibility from what the sheets let through",
        measure: |gpu, technique, _| panes::below(gpu, technique),
    },
    Case {
        name: "HC-38 depth along a long edge",
        kind: Kind::HardShadow,
        about: "a quad from 1 m to 9 m from a spot light hides a plate: depth is not linear along its edges",
        number: WRONG,
        measure: |gpu, technique, _| known::long_edge().wrong_share(gpu, technique),
    },
    Case {
        name: "HC-39 creeping camera",
        kind: Kind::HardShadow,
        about: "the camera moves by 3 mm a frame over a field of boxes, and no shadow does",
        number: "largest mean change of visibility from one frame to the next",
        measure: |gpu, technique, _| motion::creeping_camera(gpu, technique),
    },
    Case {
        name: "K1 plates of one size",
        kind: Kind::Placement,
        about: "plates from 4 m to 91 m, each as large on the screen as the others, above a floor",
        number: FARTHEST,
        measure: sampled::constant_plates,
    },
    Case {
        name: "K2 tilted suns",
        kind: Kind::Placement,
        about: "the same under suns from behind the camera and before it, down to 5 degrees",
        number: FARTHEST,
        measure: sampled::tilted_suns,
    },
    Case {
        name: "K3 light along the view",
        kind: Kind::Placement,
        about: "a plate before a wall with the sun at the viewer's back: the view's axis is a point in the map",
        number: WRONG,
        measure: sampled::light_along_the_view,
    },
    Case {
        name: "K4 facing wall",
        kind: Kind::Placement,
        about: "a wall half a degree off the light, under a plate of 2 cm: 115 times a texel's side down the wall",
        number: FARTHEST,
        measure: sampled::facing_wall,
    },
    Case {
        name: "K4 side wall",
        kind: Kind::Placement,
        about: "the same for a wall that runs away from the viewer, under a plate of 1.5 cm",
        number: FARTHEST,
        measure: sampled::side_wall,
    },
    Case {
        name: "K5 far fence",
        kind: Kind::Placement,
        about: "bars of 2 cm every 10 cm, 80 m away: four fifths of the light come through",
        number: "distance of the mean visibility from four fifths",
        measure: |gpu, technique, _| sampled::far_fence(gpu, technique),
    },
    Case {
        name: "K6 skyline",
        kind: Kind::Placement,
        about: "as the viewer walks past a wall with a gap, towers 900 m off come into view and go",
        number: FARTHEST,
        measure: sampled::skyline,
    },
    Case {
        name: "K7 slab behind the camera",
        kind: Kind::Placement,
        about: "a slab 300 m up and 150 m behind the camera shadows the floor before it",
        number: WRONG,
        measure: sampled::slab_behind,
    },
    Case {
        name: "K7 crossing triangle",
        kind: Kind::Placement,
        about: "a triangle of 1 km crosses the eye's plane and all depths of the view",
        number: WRONG,
        measure: sampled::crossing_triangle,
    },
    Case {
        name: "K8 spot lights in view",
        kind: Kind::Placement,
        about: "spot lights that shine at the viewer, from behind, away ahead and down from above",
        number: WRONG,
        measure: sampled::spots,
    },
    Case {
        name: "K9 nothing in view",
        kind: Kind::Placement,
        about: "no receiver in view, and then one pixel of one",
        number: WRONG,
        measure: |gpu, technique, _| sampled::nothing_in_view(gpu, technique),
    },
    Case {
        name: "K10 flat depth",
        kind: Kind::Placement,
        about: "one wall fills the picture: a range of depths without length",
        number: WRONG,
        measure: sampled::flat_depth,
    },
    Case {
        name: "K11 gap of depths",
        kind: Kind::Placement,
        about: "a thing in the hand, and a landscape from 400 m on",
        number: FARTHEST,
        measure: sampled::depth_gap,
    },
    Case {
        name: "K14 eight thousand kilometres",
        kind: Kind::Placement,
        about: "K1 moved by 2^20 m and 2^23 m along x and z looks the same as at the origin",
        number: "share of samples that the move changes",
        measure: |gpu, technique, _| sampled::far_away(gpu, technique),
    },
    Case {
        name: "K15 turning camera",
        kind: Kind::Placement,
        about: "as HC-39, with a camera that turns by a hundredth of a degree a frame",
        number: "largest mean change of visibility from one frame to the next",
        measure: |gpu, technique, _| motion::turning_camera(gpu, technique),
    },
    Case {
        name: "K16 pile-up",
        kind: Kind::Placement,
        about: "light along a wall: its samples, a quarter of the picture, fall into one column of the map",
        number: FARTHEST,
        measure: sampled::pile_up,
    },
    Case {
        name: "K17 edge across splits",
        kind: Kind::Placement,
        about: "a straight edge runs away from the eye through all depths",
        number: FARTHEST,
        measure: sampled::edge_across_splits,
    },
    Case {
        name: "K18 fan",
        kind: Kind::Placement,
        about: "64 triangles around a vertex leave no crack, whichever way the sun turns",
        number: "largest share of lit samples of 6 suns",
        measure: |gpu, technique, _| sampled::fan(gpu, technique),
    },
    Case {
        name: "K19 odd triangles",
        kind: Kind::Placement,
        about: "triangles that are points, lines, there three times, or edge-on to the sun",
        number: FARTHEST,
        measure: sampled::odd_triangles,
    },
    Case {
        name: "K20 long horizon",
        kind: Kind::Placement,
        about: "a near plane of 10 cm, and plates to 8 km",
        number: FARTHEST,
        measure: sampled::long_horizon,
    },
    Case {
        name: "HC-40 casters out of view",
        kind: Kind::HardShadow,
        about: "cubes behind the camera and 30 m above it shadow the floor in view",
        number: WRONG,
        measure: |gpu, technique, _| known::cubes_out_of_view().wrong_share(gpu, technique),
    },
    Case {
        name: "area light of no size",
        kind: Kind::AreaLight,
        about: "a rectangle, a disc and a sphere of no size cast the hard shadow of HC-01",
        number: FARTHEST,
        measure: area::of_no_size,
    },
    Case {
        name: "area light of any size",
        kind: Kind::AreaLight,
        about: "a square over a floor, under square lights from 2 mm to 200 m a side",
        number: EXPLAINED,
        measure: |gpu, technique, _| area::of_any_size(gpu, technique),
    },
    Case {
        name: "area light, contact",
        kind: Kind::AreaLight,
        about: "a box on the floor keeps its penumbra at its foot",
        number: EXPLAINED,
        measure: |gpu, technique, _| area::contact(gpu, technique),
    },
    Case {
        name: "area light, caster at it",
        kind: Kind::AreaLight,
        about: "a plate a tenth of a millimetre before a light hides all of it",
        number: "mean visibility",
        measure: |gpu, technique, _| area::at_the_light(gpu, technique),
    },
    Case {
        name: "area light, passing ball",
        kind: Kind::AreaLight,
        about: "a ball near the light passes before a plate, which hides other parts of the light",
        number: FLICKER,
        measure: |gpu, technique, _| area::passing_ball(gpu, technique),
    },
    Case {
        name: "area light, sinking plate",
        kind: Kind::AreaLight,
        about: "a plate sinks by 1/60 m a frame: edges move through texels, slices and levels",
        number: FLICKER,
        measure: |gpu, technique, _| area::sinking_plate(gpu, technique),
    },
];

/// The first `count` points of the sequence of Roberts ("The Unreasonable Effectiveness of Quasirandom
/// Sequences", 2018) in the unit cube: multiples of the powers of 1 / g, g^4 = g + 1, modulo 1.
fn unit_cube(count: usize) -> impl Iterator<Item = [f64; 3]> {
    const INVERSE_G: f64 = 0.819_172_513_396_164_4;
    (1..=count).map(|i| [1, 2, 3].map(|power| (i as f64 * INVERSE_G.powi(power)).fract()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_unique() {
        for case in CASES {
            let same = CASES.iter().filter(|other| other.name == case.name).count();
            assert_eq!(same, 1, "{}", case.name);
            assert!(Case::by_name(case.name).is_some(), "{} is found", case.name);
        }
    }
}

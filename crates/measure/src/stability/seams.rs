//! HC-11: bodies around a point light, on the seams of a layout, and receivers around them near both the shadow's
//! edge and the seam.

use std::f64::consts::{FRAC_PI_4, TAU};
use std::ops::Range;

use antumbra_gpu::{Gpu, Technique};
use antumbra_reference::{TruthOptions, ViewSample};
use antumbra_scene::generate::shapes;
use antumbra_scene::{Light, Scene};
use glam::{DAffine3, DQuat, DVec3};

use super::unit_cube;
use crate::{MeasureError, Stage};

/// Bodies: spheres of 5 cm, 2 m from the light.
const BODIES: usize = 96;
const RADIUS: f64 = 0.05;
const DISTANCE: f64 = 2.0;
/// Receivers at each edge, facing the light, and their distance from it, metres.
const AROUND: usize = 128;
const RECEIVERS: f64 = 5.0;

/// Places on a seam: unit directions, each with a unit direction in which the seam goes on.
type Seam = Vec<(DVec3, DVec3)>;

/// Where the views of a layout around a point light meet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Seams {
    /// The edges of a cube.
    Cube,
    /// The edges of a tetrahedron.
    Tetrahedron,
    /// The rims of an isocube's caps, at two thirds of the height, and the seams of the belt between them.
    Isocube,
    /// The rim of two paraboloids: the horizon.
    Paraboloid,
}

/// Sums over receivers near shadows' edges.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct EdgeError {
    /// Of the error of visibility.
    pub found: f64,
    /// Of what the error was expected to be proportional to.
    pub due: f64,
}

impl Seams {
    /// The error beside the seam, and the same receivers' around the same bodies turned to where no seam runs along
    /// them. `due`, of a receiver's unit direction from the light and the unit normal of the shadow's edge
    /// next to it, is what the error is expected to be proportional to: 1, or the size of the layout's texels there.
    ///
    /// # Errors
    /// A technique or a device that refuses.
    pub fn errors(
        self,
        gpu: &Gpu,
        technique: &mut dyn Technique,
        map_size: u32,
        due: impl Fn(DVec3, DVec3) -> f64,
    ) -> Result<[EdgeError; 2], MeasureError> {
        let edges = self.edges(map_size);
        let turn = DQuat::from_axis_angle(DVec3::new(1.0, 2.0, 3.0).normalize(), 1.0);
        let turned = edges.iter().map(|edge| edge.turned(turn));
        let mut scene = Scene::default();
        let mut all = Vec::new();
        for edge in edges.iter().copied().chain(turned) {
            scene.add(
                shapes::icosphere(1, RADIUS),
                DAffine3::from_translation(edge.body * DISTANCE),
            );
            all.extend(edge.receivers(map_size));
        }
        let origin = scene.origin();
        let sample = |r: &Receiver| ViewSample {
            position: (RECEIVERS * r.ray - origin).as_vec3(),
            normal: -r.ray.as_vec3(),
        };
        let points: Vec<ViewSample> = all.iter().map(sample).collect();
        let light = Light::Point { position: DVec3::ZERO };
        let stage = Stage::at_points(gpu, &scene, &points)?;
        let truth = stage.truth(&light, &TruthOptions::default());
        let shot = stage.shoot(gpu, &light, technique, 0)?;
        let sum = |range: Range<usize>| {
            range.fold(EdgeError::default(), |sum, i| EdgeError {
                found: sum.found + f64::from((shot.visibility[i] - truth.visibility[i]).abs()),
                due: sum.due + due(all[i].ray, all[i].across),
            })
        };
        Ok([sum(0..all.len() / 2), sum(all.len() / 2..all.len())])
    }

    /// Bodies whose shadows' edges cross the seam, and as many whose edges run along it, within a texel.
    fn edges(self, map_size: u32) -> Vec<Edge> {
        let seam = match self {
            Self::Cube => of_a_cube(),
            Self::Tetrahedron => of_a_tetrahedron(),
            Self::Isocube => of_an_isocube(),
            Self::Paraboloid => of_a_paraboloid(),
        };
        let (rim, texel) = ((RADIUS / DISTANCE).asin(), texel(map_size));
        let edge = |(i, (place, along)): (usize, (DVec3, DVec3))| {
            let sign = if i / 2 % 2 == 0 { 1.0 } else { -1.0 };
            let at = |x: f64, towards: DVec3| place * x.cos() + towards * x.sin();
            let aside = sign * place.cross(along);
            if i % 2 == 0 {
                Edge { body: place, at: at(rim, sign * along), across: sign * along }
            } else {
                let off = texel * (2.0 * golden(i) - 1.0);
                Edge { body: at(off - rim, aside), at: at(off, aside), across: aside }
            }
        };
        seam.into_iter().enumerate().map(edge).collect()
    }
}

/// The edge of a body's shadow next to a seam.
#[derive(Clone, Copy)]
struct Edge {
    /// Direction of the body.
    body: DVec3,
    /// A direction on the edge.
    at: DVec3,
    /// Unit normal of the edge.
    across: DVec3,
}

impl Edge {
    fn turned(&self, by: DQuat) -> Self {
        Self { body: by * self.body, at: by * self.at, across: by * self.across }
    }

    /// Receivers within three texels of the edge to both sides and within one of `at` along it.
    fn receivers(&self, map_size: u32) -> impl Iterator<Item = Receiver> {
        let Self { at, across, .. } = *self;
        let (texel, beside) = (texel(map_size), at.cross(across));
        unit_cube(AROUND).map(move |[a, b, _]| {
            let (x, y) = (3.0 * texel * (2.0 * a - 1.0), texel * (2.0 * b - 1.0));
            Receiver { ray: (at + x * across + y * beside).normalize(), across }
        })
    }
}

/// A point near the edge of a body's shadow.
struct Receiver {
    /// Unit direction from the light.
    ray: DVec3,
    /// Unit normal of the shadow's edge.
    across: DVec3,
}

/// How wide a texel is in the middle of a cube's face, radians.
fn texel(map_size: u32) -> f64 {
    2.0 / f64::from(map_size)
}

/// The edges of a cube.
fn of_a_cube() -> Seam {
    let axes = [DVec3::X, DVec3::Y, DVec3::Z];
    let at = |i: usize| {
        let (edge, share) = (i / 8, staggered(i % 8, 8, i / 8));
        let along = axes[edge % 3];
        let sign = |bit: usize| if (edge / 3) >> bit & 1 == 0 { 1.0 } else { -1.0 };
        let across = sign(0) * axes[(edge + 1) % 3] + sign(1) * axes[(edge + 2) % 3];
        on_arc(across - along, across + along, share)
    };
    (0..BODIES).map(at).collect()
}

/// The edges of a tetrahedron.
fn of_a_tetrahedron() -> Seam {
    let corners = [
        DVec3::new(-1.0, -1.0, -1.0),
        DVec3::new(1.0, 1.0, -1.0),
        DVec3::new(1.0, -1.0, 1.0),
        DVec3::new(-1.0, 1.0, 1.0),
    ];
    const EDGES: [(usize, usize); 6] = [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)];
    let at = |i: usize| {
        let (a, b) = EDGES[i / 16];
        on_arc(corners[a], corners[b], staggered(i % 16, 16, i / 16))
    };
    (0..BODIES).map(at).collect()
}

/// An isocube's rims, then the seams of its belt.
fn of_an_isocube() -> Seam {
    let at = |i: usize| {
        if i < BODIES / 2 {
            let (sin, cos) = (TAU * staggered(i / 2, BODIES / 4, i)).sin_cos();
            let height = if i.is_multiple_of(2) { 2.0 / 3.0 } else { -2.0 / 3.0 };
            let level = (1.0_f64 - height * height).sqrt();
            return (DVec3::new(level * cos, height, level * sin), DVec3::new(-sin, 0.0, cos));
        }
        let (quarter, share) = (i % 4, staggered(i / 4 - BODIES / 8, BODIES / 8, i));
        let (sin, cos) = (FRAC_PI_4 * (2.0 * quarter as f64 + 1.0)).sin_cos();
        let height = 2.0 / 3.0 * (2.0 * share - 1.0);
        let (out, level) = (DVec3::new(cos, 0.0, sin), (1.0 - height * height).sqrt());
        (level * out + height * DVec3::Y, level * DVec3::Y - height * out)
    };
    (0..BODIES).map(at).collect()
}

/// The horizon, on which an odd number of bodies stands so close that there is no room to stagger them.
fn of_a_paraboloid() -> Seam {
    let at = |i: usize| {
        let (sin, cos) = (TAU * (i as f64 + 0.5) / (BODIES - 1) as f64).sin_cos();
        (DVec3::new(cos, 0.0, sin), DVec3::new(-sin, 0.0, cos))
    };
    (0..BODIES - 1).map(at).collect()
}

/// The middle of part `i` of `count` of the unit interval, moved by up to an eighth of the part.
///
/// The views of a layout are mirror images of one another. At places that are so too, a shadow's edge meets texels in the same
/// few ways on all of them, and the mean error is one of a dozen draws instead of hundreds.
fn staggered(i: usize, count: usize, turn: usize) -> f64 {
    (i as f64 + 0.375 + 0.25 * golden(turn)) / count as f64
}

/// Multiple `i` of the golden section, modulo 1.
fn golden(i: usize) -> f64 {
    (i as f64 * 0.618_033_988_749_894_9).fract()
}

/// A point on the arc from `a` to `b`, and the arc's direction there.
fn on_arc(a: DVec3, b: DVec3, share: f64) -> (DVec3, DVec3) {
    let p = a.lerp(b, share).normalize();
    (p, (b - a).reject_from_normalized(p).normalize())
}

/// By what share the error beside the seam is larger than elsewhere; 0 where it is not.
pub(super) fn excess(
    gpu: &Gpu,
    technique: &mut dyn Technique,
    map_size: u32,
    seams: Seams,
) -> Result<f64, MeasureError> {
    let [at_seam, elsewhere] = seams.errors(gpu, technique, map_size, |_, _| 1.0)?;
    // No error at all is no excess, and one at the seam alone is beyond comparison.
    Ok(if elsewhere.found > 0.0 {
        (at_seam.found / elsewhere.found - 1.0).max(0.0)
    } else if at_seam.found == 0.0 {
        0.0
    } else {
        f64::NAN
    })
}

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
/// Receivers around each body, 5 m from the light and facing it.
const AROUND: usize = 128;

/// Places on a seam: unit directions, each with a unit direction in which the seam goes on.
type Seam = Vec<(DVec3, DVec3)>;

/// The edges of a cube.
pub(super) fn of_a_cube() -> Seam {
    let axes = [DVec3::X, DVec3::Y, DVec3::Z];
    let at = |i: usize| {
        let (edge, share) = (i / 8, spread(i % 8, 8));
        let along = axes[edge % 3];
        let sign = |bit: usize| if (edge / 3) >> bit & 1 == 0 { 1.0 } else { -1.0 };
        let across = sign(0) * axes[(edge + 1) % 3] + sign(1) * axes[(edge + 2) % 3];
        on_arc(across - along, across + along, share)
    };
    (0..BODIES).map(at).collect()
}

/// The edges of a tetrahedron.
pub(super) fn of_a_tetrahedron() -> Seam {
    let corners = [
        DVec3::new(-1.0, -1.0, -1.0),
        DVec3::new(1.0, 1.0, -1.0),
        DVec3::new(1.0, -1.0, 1.0),
        DVec3::new(-1.0, 1.0, 1.0),
    ];
    const EDGES: [(usize, usize); 6] = [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)];
    let at = |i: usize| {
        let (a, b) = EDGES[i / 16];
        on_arc(corners[a], corners[b], spread(i % 16, 16))
    };
    (0..BODIES).map(at).collect()
}

/// The rims of an isocube's caps, at two thirds of the height, and the seams of the belt between them.
pub(super) fn of_an_isocube() -> Seam {
    let at = |i: usize| {
        if i < BODIES / 2 {
            let (sin, cos) = (TAU * spread(i / 2, BODIES / 4)).sin_cos();
            let height = if i.is_multiple_of(2) { 2.0 / 3.0 } else { -2.0 / 3.0 };
            let level = (1.0_f64 - height * height).sqrt();
            return (DVec3::new(level * cos, height, level * sin), DVec3::new(-sin, 0.0, cos));
        }
        let (quarter, share) = (i % 4, spread(i / 4 - BODIES / 8, BODIES / 8));
        let (sin, cos) = (FRAC_PI_4 * (2.0 * quarter as f64 + 1.0)).sin_cos();
        let height = 2.0 / 3.0 * (2.0 * share - 1.0);
        let (out, level) = (DVec3::new(cos, 0.0, sin), (1.0 - height * height).sqrt());
        (level * out + height * DVec3::Y, level * DVec3::Y - height * out)
    };
    (0..BODIES).map(at).collect()
}

/// The rim of two paraboloids: the horizon.
pub(super) fn of_a_paraboloid() -> Seam {
    let at = |i: usize| {
        let (sin, cos) = (TAU * spread(i, BODIES)).sin_cos();
        (DVec3::new(cos, 0.0, sin), DVec3::new(-sin, 0.0, cos))
    };
    (0..BODIES).map(at).collect()
}

/// The middle of part `i` of `count` of the unit interval.
fn spread(i: usize, count: usize) -> f64 {
    (i as f64 + 0.5) / count as f64
}

/// A point on the arc from `a` to `b`, and the arc's direction there.
fn on_arc(a: DVec3, b: DVec3, share: f64) -> (DVec3, DVec3) {
    let p = a.lerp(b, share).normalize();
    (p, (b - a).reject_from_normalized(p).normalize())
}

/// By what share the error within a texel of the seam is larger than the same receivers' error around the same
/// bodies turned to where no seam runs along them; 0 where it is not.
pub(super) fn excess(
    gpu: &Gpu,
    technique: &mut dyn Technique,
    map_size: u32,
    seam: &Seam,
) -> Result<f64, MeasureError> {
    let turn = DQuat::from_axis_angle(DVec3::new(1.0, 2.0, 3.0).normalize(), 1.0);
    let turned: Seam = seam.iter().map(|(p, along)| (turn * *p, turn * *along)).collect();
    let mut scene = Scene::default();
    for (direction, _) in seam.iter().chain(&turned) {
        let place = DAffine3::from_translation(*direction * DISTANCE);
        scene.add(shapes::icosphere(1, RADIUS), place);
    }
    let mut points = receivers(seam, map_size, scene.origin());
    let count = points.len();
    points.extend(receivers(&turned, map_size, scene.origin()));
    let light = Light::Point { position: DVec3::ZERO };
    let stage = Stage::at_points(gpu, &scene, &points)?;
    let truth = stage.truth(&light, &TruthOptions::default());
    let shot = stage.shoot(gpu, &light, technique, 0)?;
    let error = |range: Range<usize>| {
        let pairs = shot.visibility[range.clone()].iter().zip(&truth.visibility[range]);
        pairs.map(|(a, b)| f64::from((a - b).abs())).sum::<f64>()
    };
    let (at_seam, elsewhere) = (error(0..count), error(count..2 * count));
    // Where both kinds of receivers are there, no error at all is no excess. An error at the seam alone is beyond
    // comparison.
    let shadowed = truth.visibility.iter().filter(|v| **v == 0.0).count();
    let is_telling = shadowed > 0 && shadowed < truth.visibility.len();
    Ok(if elsewhere > 0.0 {
        (at_seam / elsewhere - 1.0).max(0.0)
    } else if at_seam == 0.0 && is_telling {
        0.0
    } else {
        f64::NAN
    })
}

/// Receivers within three texels of the bodies' rims, where the seam crosses them, and within one of the seam.
fn receivers(seam: &Seam, map_size: u32, origin: DVec3) -> Vec<ViewSample> {
    // In the middle of a cube's face a texel is this wide, radians.
    let texel = 2.0 / f64::from(map_size);
    let rim = (RADIUS / DISTANCE).asin();
    let around = |(direction, along): &(DVec3, DVec3)| {
        let (direction, along) = (*direction, *along);
        let aside = direction.cross(along);
        unit_cube(AROUND).map(move |[a, b, c]| {
            let sign = if c < 0.5 { 1.0 } else { -1.0 };
            let x = sign * (rim + 3.0 * texel * (2.0 * a - 1.0));
            let ray = (direction + x * along + texel * (2.0 * b - 1.0) * aside).normalize();
            ViewSample { position: (5.0 * ray - origin).as_vec3(), normal: -ray.as_vec3() }
        })
    };
    seam.iter().flat_map(around).collect()
}

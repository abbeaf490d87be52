//! How far a point is from the edge of a hard shadow.

use antumbra_scene::Light;
use glam::DVec3;

use super::{Facing, Occluder, edges};
use crate::closed::emitter::Emitter;

/// How far `p` (world space, metres) may move before the centre of the light changes between hidden
/// and seen: positive in shadow, negative in light, metres.
///
/// To first order in the distance, and a lower bound of it: where the ray meets the occluder's plane
/// at the angle theta (from its normal), a movement of `p` by e moves the meeting point by at most
/// `e / cos theta`. The value is the meeting point's distance from the occluder's edge times
/// `cos theta`; on the occluder's far side from the light it is the distance from `p` to the
/// occluder; in shadow it is at most the distance of `p` from the occluder's plane.
#[must_use]
pub fn shadow_margin(occluder: &Occluder, light: &Light, p: DVec3) -> f64 {
    let emitter = Emitter::new(light, p);
    let facing = Facing::new(occluder, p);
    let towards = emitter.center;
    let reach = facing.normal.dot(towards);
    let crosses = facing.distance > 0.0
        && if emitter.infinite { reach > 0.0 } else { reach > facing.distance };
    if !crosses {
        // The plane is reached, and with it the shadow, only through the occluder itself.
        let foot = p + facing.normal * facing.distance;
        let beside = (-edge_distance(occluder, foot)).max(0.0);
        return -beside.hypot(facing.distance);
    }
    let cosine = reach / towards.length();
    let inside = edge_distance(occluder, p + towards * (facing.distance / reach)) * cosine;
    inside.min(facing.distance)
}

/// Whether `p` lies within `tolerance` metres of the edge of the hard shadow of the light's centre,
/// by [`shadow_margin`]: a computation whose positions are uncertain by that much may decide either
/// way there. For a relative tolerance, multiply it by the size of the scene.
#[must_use]
pub fn is_tie(occluder: &Occluder, light: &Light, p: DVec3, tolerance: f64) -> bool {
    shadow_margin(occluder, light, p).abs() <= tolerance
}

/// Distance of a point of the occluder's plane from the occluder's boundary, positive inside.
fn edge_distance(occluder: &Occluder, point: DVec3) -> f64 {
    let (origin, normal) = occluder.plane();
    match occluder {
        Occluder::HalfPlane { inward, .. } => {
            let inward = inward.reject_from_normalized(normal).normalize_or_zero();
            inward.dot(point - origin)
        }
        Occluder::Disc { center, radius, .. } => radius - point.distance(*center),
        Occluder::ConvexPolygon(corners) => {
            let inside = edges(corners).all(|(a, b)| normal.cross(b - a).dot(point - a) >= 0.0);
            let nearest = edges(corners)
                .map(|(a, b)| {
                    let along = b - a;
                    let t = (point - a).dot(along) / along.length_squared();
                    point.distance(a + along * if t.is_nan() { 0.0 } else { t.clamp(0.0, 1.0) })
                })
                .fold(f64::INFINITY, f64::min);
            if inside { nearest } else { -nearest }
        }
    }
}

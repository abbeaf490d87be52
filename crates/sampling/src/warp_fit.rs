//! Fits a map that is warped towards the eye (*Real-Time Shadows* 4.2).

use antumbra_map::{Fitting, Needed, Sight, basis};
use antumbra_scene::Light;
use glam::{DMat3, DMat4, DVec2, DVec3, DVec4};

use crate::Eye;
use crate::storage::Body;
use crate::warp::{Line, Rule, unwarp};

/// A light as it projects before it is warped.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Shine {
    /// Parallel; depths, along the unit vector towards the light, of the near and the far end.
    Parallel { to_light: DVec3, depths: (f64, f64) },
    /// From a position, relative to the origin, around the axis opposite to `back`.
    From { position: DVec3, back: DVec3 },
}

/// A fitted warp.
#[derive(Clone, Debug)]
pub(crate) struct Warped {
    /// The matrix.
    pub(crate) clip: DMat4,
    /// Half-spaces that hold what it has to show.
    pub(crate) volume: Vec<DVec4>,
    /// The receivers that may be shadowed.
    pub(crate) body: Body,
    light: DVec4,
    eye: Eye,
}

impl Warped {
    /// Whether it needs fewer texels than the map with the matrix `uniform`.
    pub(crate) fn is_better_than(&self, uniform: &DMat4) -> bool {
        let storage = |clip| self.body.storage(clip, self.light, &self.eye);
        storage(&self.clip) < storage(uniform)
    }
}

/// The least sine of the angle between view axis and light, and the least length of the view axis in the map of a
/// positional light, that give the map a direction: 1 degree.
const LEAST_AXIS: f64 = 0.0175;

/// The least distance of receivers from a positional light, as a share of the largest, that is warped: nearer ones
/// have no place in its plane.
const LEAST_SHARE: f64 = 1.0 / 1024.0;

/// A map's plane turned so that t goes away from the eye.
struct Plane {
    shine: Shine,
    right: DVec3,
    up: DVec3,
    back: DVec3,
    /// Place of the eye, or of the view's axis, along s.
    middle: f64,
}

impl Plane {
    /// `None` where the view axis is (almost) a point in the map.
    fn new(shine: Shine, eye: &Eye, farthest: f64) -> Option<Self> {
        let back = match shine {
            Shine::Parallel { to_light, .. } => to_light,
            Shine::From { back, .. } => back,
        };
        let rows = basis(back);
        let turned = |axis: DVec2| {
            let up = (rows.row(0) * axis.x + rows.row(1) * axis.y).normalize();
            (axis.length() >= LEAST_AXIS && up.is_finite()).then(|| (up.cross(back), up))
        };
        match shine {
            Shine::Parallel { .. } => {
                let (right, up) = turned((rows * eye.forward).truncate())?;
                Some(Self { shine, right, up, back, middle: right.dot(eye.position) })
            }
            Shine::From { position, .. } => {
                // The view axis in front of the light, in the light's plane.
                let (mut a, mut b) = (
                    rows * (eye.position - position),
                    rows * (eye.position - position + eye.forward * farthest),
                );
                let least = LEAST_SHARE * (-a.z).max(-b.z);
                if least <= 0.0 {
                    return None;
                }
                let cut =
                    |from: DVec3, to: DVec3| from.lerp(to, (-least - from.z) / (to.z - from.z));
                if -a.z < least {
                    a = cut(a, b);
                } else if -b.z < least {
                    b = cut(b, a);
                }
                let (a, b) = (a.truncate() / -a.z, b.truncate() / -b.z);
                let (right, up) = turned(b - a)?;
                let local = DVec2::new(rows.row(0).dot(right), rows.row(1).dot(right));
                Some(Self { shine, right, up, back, middle: local.dot(a) })
            }
        }
    }

    /// Linear forms of a point: along s, along t, and the divisor.
    fn forms(&self) -> [DVec4; 3] {
        match self.shine {
            Shine::Parallel { .. } => [self.right.extend(0.0), self.up.extend(0.0), DVec4::W],
            Shine::From { position, .. } => {
                [self.right, self.up, -self.back].map(|d| d.extend(-d.dot(position)))
            }
        }
    }

    fn light(&self) -> DVec4 {
        match self.shine {
            Shine::Parallel { to_light, .. } => to_light.extend(0.0),
            Shine::From { position, .. } => position.extend(1.0),
        }
    }

    /// (s, t) of each point; `None` if one is not in front of the light.
    fn places(&self, points: &[DVec3]) -> Option<Vec<DVec2>> {
        let [s, t, w] = self.forms();
        let divisors: Vec<f64> = points.iter().map(|p| w.dot(p.extend(1.0))).collect();
        let farthest = divisors.iter().copied().fold(0.0, f64::max);
        let place = |(p, w): (&DVec3, &f64)| {
            let p = p.extend(1.0);
            (*w > LEAST_SHARE * farthest).then(|| DVec2::new(s.dot(p), t.dot(p)) / *w)
        };
        points.iter().zip(&divisors).map(place).collect()
    }

    /// The half-spaces whose points lie between the places `lo` and `hi`.
    fn column(&self, lo: DVec2, hi: DVec2) -> Vec<DVec4> {
        let [s, t, w] = self.forms();
        [s - lo.x * w, hi.x * w - s, t - lo.y * w, hi.y * w - t]
            .into_iter()
            .map(|plane| plane / plane.truncate().length())
            .filter(|plane| plane.is_finite())
            .collect()
    }
}

fn bounds(places: &[DVec2]) -> (DVec2, DVec2) {
    let none = (DVec2::INFINITY, DVec2::NEG_INFINITY);
    places.iter().fold(none, |(lo, hi), p| (lo.min(*p), hi.max(*p)))
}

/// The map for receivers within the half-spaces `cone`, warped by the strength that `rule` gives, or with `guarded` by
/// that of a few weaker ones that needs the fewest texels. `None` where there is nothing to shadow or no warp.
#[expect(clippy::too_many_arguments, reason = "one input each")]
pub(crate) fn warped(
    light: &Light,
    shine: Shine,
    cone: &[DVec4],
    eye: &Eye,
    sight: &Sight<'_>,
    fitting: &Fitting,
    rule: &Rule,
    guarded: bool,
) -> Option<Warped> {
    let farthest = sight.region.corners().map(|p| eye.depth(p)).fold(0.0, f64::max);
    let plane = Plane::new(shine, eye, farthest)?;
    // How much larger than a uniform texel a warped one can be is not known before the strength is.
    let ratio = (farthest / eye.near).max(1.0).sqrt();
    let margin = |points: &[DVec3]| match (shine, plane.places(points)) {
        (Shine::Parallel { .. }, Some(places)) => {
            let (lo, hi) = bounds(&places);
            ratio * (hi - lo).max_element() / fitting.usable()
        }
        (Shine::From { position, .. }, Some(places)) => {
            let (lo, hi) = bounds(&places);
            let far = points.iter().map(|p| p.distance(position)).fold(0.0, f64::max);
            ratio * far * (hi - lo).max_element() / fitting.usable()
        }
        (_, None) => 0.0,
    };
    let all = sight.needed(light, cone, margin, fitting)?;
    // Receivers beside everything that casts are lit without a map.
    let mut column = cone.to_vec();
    if let Some(casters) = plane.places(&all.casters) {
        let (lo, hi) = bounds(&casters);
        column.extend(plane.column(lo, hi));
    }
    let needed = sight.needed(light, &column, margin, fitting)?;
    let places = plane.places(&needed.receivers)?;
    let (lo, hi) = bounds(&places);
    if hi.y <= lo.y {
        return None;
    }
    let line = line(&plane, eye, &needed.receivers, lo.y, hi.y);
    let body = Body::new(&needed.receivers);
    let matrix = |e: f64| matrix(&plane, e, &needed, &places, (lo.y, hi.y), fitting);
    let strengths = if guarded { rule.trials(&line) } else { vec![rule.strength(&line)] };
    let clip = strengths
        .into_iter()
        .filter_map(matrix)
        .map(|clip| (clip, body.storage(&clip, plane.light(), eye)))
        .min_by(|a, b| a.1.total_cmp(&b.1))
        .map(|(clip, _)| clip)?;
    let Needed { volume, .. } = needed;
    Some(Warped { clip, volume, body, light: plane.light(), eye: *eye })
}

/// What a rule goes by: a line parallel to the map through the nearest receiver, from the map's near side at `t0` to
/// its far side at `t1`.
fn line(plane: &Plane, eye: &Eye, receivers: &[DVec3], t0: f64, t1: f64) -> Line {
    let depths = receivers.iter().map(|p| eye.depth(*p));
    let (near, far) = depths.fold((f64::INFINITY, 0.0_f64), |(lo, hi), z| (lo.min(z), hi.max(z)));
    let near = near.max(eye.near);
    // How much farther from the eye the line gets on its way over the map.
    let rise = match plane.shine {
        Shine::Parallel { .. } => (t1 - t0) * eye.forward.dot(plane.up),
        Shine::From { position, .. } => {
            // At the distance from the light at which the ray at its beginning is as far from the eye as the nearest
            // receiver; where it never is, that of the receivers' middle.
            let ray = plane.right * plane.middle + plane.up * t0 - plane.back;
            let distance = (near - eye.depth(position)) / eye.forward.dot(ray);
            let center = receivers.iter().sum::<DVec3>() / receivers.len() as f64;
            let usual = -plane.back.dot(center - position);
            let distance = if distance > 0.0 && distance.is_finite() { distance } else { usual };
            (t1 - t0) * distance * eye.forward.dot(plane.up)
        }
    };
    let towards = match plane.shine {
        Shine::Parallel { to_light, .. } => to_light,
        Shine::From { position, .. } => (position
            - receivers.iter().sum::<DVec3>() / receivers.len() as f64)
            .normalize_or(plane.back),
    };
    let tilt = eye.forward.cross(towards).length().atan2(eye.forward.dot(towards).abs());
    let upper = 0.5 * (eye.corners[2] + eye.corners[3]);
    let half_fov = upper.angle_between(eye.forward);
    Line { ends: (near, near + rise), seen: (near, far), tilt, half_fov }
}

/// The matrix of a warp of strength `e` over the places from t0 to t1; `None` if it is not finite.
fn matrix(
    plane: &Plane,
    e: f64,
    needed: &Needed,
    places: &[DVec2],
    (t0, t1): (f64, f64),
    fitting: &Fitting,
) -> Option<DMat4> {
    let [s, t, w] = plane.forms();
    let length = t1 - t0;
    // x: place along the map from 0 to 1, times the divisor; the warped divisor is 1 + e x.
    let x = (t - t0 * w) / length;
    let divisor = w + e * x;
    let across = |p: &DVec2| (p.x - plane.middle) / (1.0 + e * (p.y - t0) / length);
    let (lo, hi) = places
        .iter()
        .map(across)
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), v| (lo.min(v), hi.max(v)));
    // A set of no width still needs a window: 2^-20 of the map's length, or of its distance from the middle.
    let least = length.max(lo.abs()).max(hi.abs()) * 2f64.powi(-20);
    let (center, half) = (0.5 * (lo + hi), (0.5 * (hi - lo)).max(least));
    // Within the guard band.
    let size = f64::from(fitting.size);
    let inner = (size - 2.0 * f64::from(fitting.guard)) / size;
    let row_x = ((s - plane.middle * w) - center * divisor) * (inner / half);
    let row_y = (2.0 * (1.0 + e) * x - divisor) * inner;
    // The divisor at the map's lower border, where it is least.
    let border = 0.5 - 0.5 / inner;
    let least = 1.0 + e * unwarp(e, border);
    let row_z = match plane.shine {
        Shine::Parallel { depths: (near, far), .. } => {
            // Between 0 and 1 over the least divisor.
            plane.back.extend(-far) * (least / (near - far))
        }
        Shine::From { .. } => {
            let divisors = needed.casters.iter().map(|p| divisor.dot(p.extend(1.0)));
            let (nearest, farthest) =
                divisors.fold((f64::INFINITY, 0.0_f64), |(lo, hi), w| (lo.min(w), hi.max(w)));
            // Reversed infinite depth, as of a map that is not warped.
            let near = (nearest * (1.0 - 2f64.powi(-8))).max(farthest / 16384.0);
            DVec4::W * near
        }
    };
    let clip = DMat4::from_cols(row_x, row_y, row_z, divisor).transpose();
    // As the shader gets it.
    (clip.as_mat4().is_finite() && clip.determinant() != 0.0).then_some(clip)
}

/// The half-spaces of the pyramid, `tan_limit` wide to either side, around the axis opposite to `back`.
pub(crate) fn pyramid(position: DVec3, back: DVec3, tan_limit: f64) -> Vec<DVec4> {
    let rows: DMat3 = basis(back);
    let (a, b) = (rows.row(0), rows.row(1));
    [a, -a, b, -b]
        .map(|aside| {
            let normal = (aside - back * tan_limit).normalize();
            normal.extend(-normal.dot(position))
        })
        .to_vec()
}

#[cfg(test)]
mod tests;

//! Closed-form visibility behind flat, convex occluders, in `f64`.
//!
//! The light seen from a point `p` is a flat shape: a unit square or a unit disc in its own
//! parameters (s, t), with points `d(s, t) = c + s u + t v` relative to `p`. A segment from `p` to
//! `d` meets a planar occluder with edge (a, b), both relative to `p`, on the inner side of that
//! edge exactly if `d . (a x b) >= 0`, and it reaches the occluder's plane `n . x = D` exactly if
//! `n . d > D > 0`. All of these are *affine* in (s, t). What a convex polygon hides is therefore the
//! light's square or disc cut by straight lines, and its area is exact; a disc hides the inside of a
//! conic, whose area is elementary too (`conic`). Nothing is projected, so that no case is special:
//! occluders partly behind `p`, partly behind the light, or with `p` in the plane of the light.
//!
//! The definition of visibility is that of Hasenfratz, Lapierre, Holzschuch and Sillion (2003): the
//! share of the light's area whose open segment to `p` meets no occluder.

mod area;
mod conic;
mod emitter;
mod margin;

use antumbra_scene::Light;
use glam::DVec3;

use area::{Line, Polygon};
use emitter::{Emitter, Shape};
pub use margin::{is_tie, shadow_margin};

/// Shares of a light below this are rounding: areas are sums of at most some hundred terms of order
/// one, each good to 2⁻⁵⁰ or better. Visibilities this near to 0 and 1 are returned as 0 and 1.
const ACCURACY: f64 = 1.0 / (1_u64 << 40) as f64;

/// A flat, opaque occluder without thickness, world space, metres.
#[derive(Clone, Debug, PartialEq)]
pub enum Occluder {
    /// One side of a line in a plane.
    HalfPlane {
        /// A point of the edge.
        point: DVec3,
        /// Normal of the plane, of any length and either sign.
        normal: DVec3,
        /// Points from the edge into the occluder; only its part in the plane counts.
        inward: DVec3,
    },
    /// A convex polygon in one plane, its corners in order, either way round. Fewer than three
    /// corners hide nothing.
    ConvexPolygon(Vec<DVec3>),
    /// A disc.
    Disc {
        /// Centre.
        center: DVec3,
        /// Normal of its plane, of any length and either sign.
        normal: DVec3,
        /// Radius, >= 0.
        radius: f64,
    },
}

impl Occluder {
    /// A rectangle from its centre and two orthogonal half sides, metres.
    #[must_use]
    pub fn rectangle(center: DVec3, half_u: DVec3, half_v: DVec3) -> Self {
        Self::ConvexPolygon(vec![
            center - half_u - half_v,
            center + half_u - half_v,
            center + half_u + half_v,
            center - half_u + half_v,
        ])
    }

    fn is_finite(&self) -> bool {
        match self {
            Self::HalfPlane { point, normal, inward } => {
                point.is_finite() && normal.is_finite() && inward.is_finite()
            }
            Self::ConvexPolygon(corners) => corners.iter().all(|corner| corner.is_finite()),
            Self::Disc { center, normal, radius } => {
                center.is_finite() && normal.is_finite() && radius.is_finite()
            }
        }
    }

    /// A point of the occluder's plane and the plane's unit normal (zero for a degenerate shape).
    fn plane(&self) -> (DVec3, DVec3) {
        match self {
            Self::HalfPlane { point, normal, .. } => (*point, normal.normalize_or_zero()),
            Self::Disc { center, normal, .. } => (*center, normal.normalize_or_zero()),
            Self::ConvexPolygon(corners) => {
                // Newell's sum over a fan is twice the area vector; corners relative to the first
                // keep it exact far from the origin.
                let o = corners.first().copied().unwrap_or_default();
                let sum: DVec3 = edges(corners).map(|(a, b)| (a - o).cross(b - o)).sum();
                (o, sum.normalize_or_zero())
            }
        }
    }
}

/// The occluder's plane as seen from `p`: `normal . d == distance` with `distance >= 0`, and whether
/// the normal had to be turned for that.
struct Facing {
    normal: DVec3,
    distance: f64,
    turned: bool,
}

impl Facing {
    fn new(occluder: &Occluder, p: DVec3) -> Self {
        let (point, normal) = occluder.plane();
        let distance = normal.dot(point - p);
        let turned = distance < 0.0;
        let sign = if turned { -1.0 } else { 1.0 };
        Self { normal: normal * sign, distance: distance * sign, turned }
    }
}

/// The share of the light's area that `p` (world space, metres) sees past the occluder, in [0, 1].
///
/// Uniform over the light's area: the disc facing `p` for a sphere, the disc of directions for a wide
/// sun, as in [`Light::towards`]; 0 or 1 for a light without extent. A spot light is not limited to
/// its cone. Rays that graze an edge count as blocked. An occluder whose plane contains `p` hides
/// nothing. Exact but for rounding: within 2e-12 where the geometry relative to `p` is. NaN if any
/// input is not finite.
#[must_use]
pub fn visibility(occluder: &Occluder, light: &Light, p: DVec3) -> f64 {
    share(std::slice::from_ref(occluder), light, p, None)
}

/// As [`visibility`], for a receiver with the given normal (not zero): the part of the light below
/// the receiver's tangent plane counts as not visible.
#[must_use]
pub fn visibility_above_horizon(
    occluder: &Occluder,
    light: &Light,
    p: DVec3,
    normal: DVec3,
) -> f64 {
    share(std::slice::from_ref(occluder), light, p, Some(normal))
}

/// The share of the light's area that `p` sees past several occluders together, which visibilities
/// past each alone do not determine; `None` for an extended light behind more than one disc, whose
/// overlap has no such closed form here.
///
/// By inclusion and exclusion: the cost doubles with every occluder that overlaps all others as seen
/// from `p`.
#[must_use]
pub fn joint_visibility(occluders: &[Occluder], light: &Light, p: DVec3) -> Option<f64> {
    let discs = occluders.iter().filter(|o| matches!(o, Occluder::Disc { .. })).count();
    (discs <= 1 || light.is_hard()).then(|| share(occluders, light, p, None))
}

fn share(occluders: &[Occluder], light: &Light, p: DVec3, horizon: Option<DVec3>) -> f64 {
    let emitter = Emitter::new(light, p);
    let finite = emitter.is_finite()
        && occluders.iter().all(Occluder::is_finite)
        && horizon.is_none_or(DVec3::is_finite);
    if !finite {
        return f64::NAN;
    }
    let above = horizon.map(|normal| emitter.line(normal, 0.0));
    let hidden: Vec<HiddenBy> =
        occluders.iter().filter_map(|occluder| HiddenBy::new(occluder, &emitter, p)).collect();
    if emitter.shape == Shape::Point {
        let seen = above.is_none_or(|line| line.at(0.0, 0.0) > 0.0);
        return if seen && !hidden.iter().any(HiddenBy::has_centre) { 1.0 } else { 0.0 };
    }
    let mut lit = Polygon::square();
    if let Some(above) = above {
        lit.clip(above);
    }
    let visible = emitter.shape.area_within(&lit) - union_area(&lit, None, &hidden, emitter.shape);
    let share = visible / emitter.shape.area();
    if share < ACCURACY {
        0.0
    } else if share > 1.0 - ACCURACY {
        1.0
    } else {
        share
    }
}

/// Area of a light's shape within `region`, within the conic of `disc` if there is one, that is
/// hidden by any of `hidden`: what each hides, less what those before it hide of that already.
fn union_area(
    region: &Polygon,
    disc: Option<conic::Hidden>,
    hidden: &[HiddenBy],
    shape: Shape,
) -> f64 {
    hidden
        .iter()
        .enumerate()
        .map(|(i, by)| {
            let mut region = region.clone();
            for &line in &by.lines {
                region.clip(line);
            }
            if region.0.is_empty() {
                return 0.0;
            }
            let disc = by.disc.or(disc);
            let own = match disc {
                Some(disc) => disc.area(&region, shape),
                None => shape.area_within(&region),
            };
            own - union_area(&region, disc, &hidden[..i], shape)
        })
        .sum()
}

/// The conditions, in the light's parameters, under which a point of the light is hidden.
struct HiddenBy {
    lines: Vec<Line>,
    disc: Option<conic::Hidden>,
}

impl HiddenBy {
    /// Whether the light's centre is hidden.
    fn has_centre(&self) -> bool {
        self.lines.iter().all(|line| line.at(0.0, 0.0) >= 0.0)
            && self.disc.is_none_or(|disc| disc.contains(0.0, 0.0))
    }

    /// `None` where the occluder hides nothing.
    fn new(occluder: &Occluder, emitter: &Emitter, p: DVec3) -> Option<Self> {
        let Facing { normal, distance, turned } = Facing::new(occluder, p);
        if distance == 0.0 {
            return None;
        }
        // The light's point lies beyond the plane.
        let beyond = emitter.line(normal, if emitter.infinite { 0.0 } else { -distance });
        if emitter.shape == Shape::Point && beyond.at(0.0, 0.0) <= 0.0 {
            return None;
        }
        let mut lines = vec![beyond];
        // The plane through p and the edge (a, b), its positive side inwards.
        let sign = if turned { -1.0 } else { 1.0 };
        let mut disc = None;
        match occluder {
            Occluder::HalfPlane { point, inward, .. } => {
                // `normal x along` points inwards.
                let along = inward.cross(normal);
                if along == DVec3::ZERO {
                    return None;
                }
                lines.push(emitter.line((*point - p).cross(along), 0.0));
            }
            Occluder::ConvexPolygon(corners) => lines.extend(
                edges(corners)
                    .map(|(a, b)| (a - p).cross(b - a) * sign)
                    .map(|side| emitter.line(side, 0.0)),
            ),
            Occluder::Disc { center, radius, .. } => {
                disc = Some(conic::Hidden::new(emitter, normal, distance, *center - p, *radius));
            }
        }
        Some(Self { lines, disc })
    }
}

/// The edges of a closed polygon, as pairs of its corners.
fn edges(corners: &[DVec3]) -> impl Iterator<Item = (DVec3, DVec3)> {
    corners.iter().copied().zip(corners.iter().copied().cycle().skip(1))
}

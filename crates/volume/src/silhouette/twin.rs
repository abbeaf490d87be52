//! Silhouettes in f64: the truth of `volume/silhouettes.wesl` in tests.
//!
//! A light is (position, 1) or (unit direction towards it, 0), as in the shader.

use antumbra_gpu::Edges;
use glam::{DVec3, DVec4};

/// Six times the signed volume of the tetrahedron between a triangle and the light; of a directional light,
/// twice the triangle's area times the cosine. > 0 where the light sees it counter-clockwise.
#[must_use]
pub fn determinant(light: DVec4, [a, b, c]: [DVec3; 3]) -> f64 {
    (b - a).cross(c - a).dot(light.truncate() - light.w * a)
}

/// What bounds the rounding of [`determinant`] when multiplied with the unit roundoff and the 8 of `facing` in
/// `common/containment.wesl`: the sum of the magnitudes of its products.
#[must_use]
pub fn magnitude(light: DVec4, [a, b, c]: [DVec3; 3]) -> f64 {
    let (p, q, t) = ((b - a).abs(), (c - a).abs(), (light.truncate() - light.w * a).abs());
    let cross = DVec3::new(p.y * q.z + p.z * q.y, p.z * q.x + p.x * q.z, p.x * q.y + p.y * q.x);
    cross.dot(t)
}

/// For each edge, how often it is in the boundary of all triangles, each turned so that its front shows the
/// light: `sides` has +1, -1 or 0 for each.
#[must_use]
pub fn weights(edges: &Edges, sides: &[i32]) -> Vec<i32> {
    let turned =
        |(triangle, back): (usize, bool)| if back { -sides[triangle] } else { sides[triangle] };
    (0..edges.len()).map(|edge| edges.uses_of(edge).map(turned).sum()).collect()
}

/// By how much the number of shadow volumes that one is in changes, 1, -1 or 0, on the way from `from` to `to`
/// through the side face over the edge from `a` to `b`: all that the light's rays through the edge reach behind
/// it. Inside is the side of a triangle that runs along the edge and shows the light its front.
#[must_use]
pub fn side_crossing(light: DVec4, [a, b]: [DVec3; 2], from: DVec3, to: DVec3) -> i32 {
    let edge = b - a;
    let down = light.w * a - light.truncate();
    let outward = down.cross(edge);
    let (before, after) = (outward.dot(from - a), outward.dot(to - a));
    if (before > 0.0) == (after > 0.0) {
        return 0;
    }
    // Where the way meets the plane: a + x edge + y down. A ray through the edge's point at s runs along
    // down + w s edge, so that at y it is at x = s (1 + w y).
    let q = from.lerp(to, before / (before - after)) - a;
    let square = outward.length_squared();
    let x = down.cross(q).dot(outward) / square;
    let y = q.cross(edge).dot(outward) / square;
    let hit = y >= 0.0 && x >= 0.0 && x <= 1.0 + light.w * y;
    i32::from(hit) * if after > 0.0 { -1 } else { 1 }
}

/// As [`side_crossing`], through the triangle itself; `side` is which side it shows the light.
#[must_use]
pub fn cap_crossing(side: i32, [a, b, c]: [DVec3; 3], from: DVec3, to: DVec3) -> i32 {
    let normal = (b - a).cross(c - a);
    let front = f64::from(side) * normal;
    let (before, after) = (front.dot(from - a), front.dot(to - a));
    if (before > 0.0) == (after > 0.0) {
        return 0;
    }
    let q = from.lerp(to, before / (before - after));
    let inner = |u: DVec3, v: DVec3| (v - u).cross(q - u).dot(normal) >= 0.0;
    let hit = inner(a, b) && inner(b, c) && inner(c, a);
    i32::from(hit) * if after > 0.0 { -1 } else { 1 }
}

/// Whether `p` lies in the shadow volume of a triangle, by the planes through its edges and the light and its
/// own (Crow 1977; Fuchs et al. 1985).
#[must_use]
pub fn contains(light: DVec4, corners: [DVec3; 3], p: DVec3) -> bool {
    let side = determinant(light, corners);
    if side == 0.0 {
        return false;
    }
    let [a, b, c] = corners;
    let normal = (b - a).cross(c - a);
    let behind = side.signum() * normal.dot(p - a) < 0.0;
    // Away from the light at the edge, the edge, and the point: positive where the point is to the left.
    let left = |u: DVec3, v: DVec3| {
        let down = light.w * u - light.truncate();
        side.signum() * (v - u).cross(down).dot(p - u) >= 0.0
    };
    behind && left(a, b) && left(b, c) && left(c, a)
}

/// Whether a ray from something in the box `receiver` (lowest corner, highest corner) to the light may meet something
/// in the box `caster`: whether the box around all such rays meets it, and the spheres around the two, larger than
/// those by the factor `larger`, overlap as the light sees them.
#[must_use]
pub fn may_shadow(light: DVec4, caster: [DVec3; 2], receiver: [DVec3; 2], larger: f64) -> bool {
    let sphere =
        |[low, high]: [DVec3; 2]| (0.5 * (low + high), 0.5 * (high - low).length() * larger);
    let ((c, s), (r, t)) = (sphere(caster), sphere(receiver));
    let towards = light.truncate();
    let (mut low, mut high) = (receiver[0].min(towards), receiver[1].max(towards));
    if light.w == 0.0 {
        low = DVec3::select(towards.cmplt(DVec3::ZERO), DVec3::NEG_INFINITY, receiver[0]);
        high = DVec3::select(towards.cmpgt(DVec3::ZERO), DVec3::INFINITY, receiver[1]);
    }
    if caster[0].cmpgt(high).any() || caster[1].cmplt(low).any() {
        return false;
    }
    if light.w == 0.0 {
        return (c - r).cross(towards).length() <= s + t;
    }
    let (u, v) = (c - towards, r - towards);
    if u.length() <= s || v.length() <= t {
        return true;
    }
    u.angle_between(v) <= (s / u.length()).asin() + (t / v.length()).asin()
}

//! The points of a receiver's plane that the texels of its kernel show.

use antumbra_map::FittedView;
use glam::{DMat2, DMat4, DVec2, DVec3};

/// The view of the map in which a point lies: the only one, or the cube's face.
pub(crate) fn view_of(views: &[FittedView], p: DVec3) -> Option<&FittedView> {
    let index = if views.len() == 1 {
        0
    } else {
        let from = p - views[0].light.truncate();
        let axis = from.abs().max_position();
        2 * axis + usize::from(from[axis] < 0.0)
    };
    views.get(index)
}

/// Texel coordinates of `p` in a map of `size` texels a side.
pub(crate) fn texel(clip: &DMat4, p: DVec3, size: u32) -> DVec2 {
    let ndc = clip.project_point3(p);
    (DVec2::splat(0.5) + DVec2::new(0.5, -0.5) * ndc.truncate()) * f64::from(size)
}

/// Centres of the texels that a kernel of `side` x `side` compares at `t`.
pub(crate) fn centers(t: DVec2, side: i32) -> impl Iterator<Item = DVec2> {
    let first = (t - 0.5 * f64::from(side - 1)).floor() + 0.5;
    (0..side * side).map(move |i| first + DVec2::new(f64::from(i % side), f64::from(i / side)))
}

/// The point of the plane through `p` with normal `n` that the map of `size` texels a side shows at `center`.
pub(crate) fn on_plane(clip: &DMat4, (p, n): (DVec3, DVec3), center: DVec2, size: u32) -> DVec3 {
    let (u, v) = n.any_orthonormal_pair();
    let mut q = p;
    // Newton's steps: affine for parallel light, and a texel is small beside the distance of a lamp.
    for _ in 0..4 {
        let t = texel(clip, q, size);
        let step = 1e-4 * (1.0 + p.length());
        let column = |d: DVec3| (texel(clip, q + d * step, size) - t) / step;
        let by = DMat2::from_cols(column(u), column(v)).inverse() * (center - t);
        q += u * by.x + v * by.y;
    }
    q
}

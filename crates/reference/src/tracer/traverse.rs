//! A ray through the tree: conservative boxes, exact triangles.
//!
//! **Triangles** (Woop, Benthin and Wald 2013, "Watertight Ray/Triangle Intersection"). The ray's
//! origin moves to zero and a shear turns its direction into the axis in which it is longest, here
//! called z; a triangle is met where the projected triangle contains (0, 0), which the signs of three
//! edge functions a b - c d tell. Rounding is monotonic, so the `f32` value of an edge function
//! either has the sign of the exact value or is 0; where it is 0 the sign is found in `f64`, in which
//! the products of `f32` are exact. So the answer is that of exact arithmetic on the sheared corners.
//! The sheared corner depends on the corner alone, whichever triangle it belongs to: what is a closed
//! surface in space stays one in projection, and no ray slips between neighbours.
//!
//! **The depth** z = (U Az + V Bz + W Cz) / (U + V + W) loses digits on a triangle seen edge-on. `f32`
//! decides where its bound of error allows, `f64` otherwise.
//!
//! **Boxes** must contain whatever the triangle test accepts. With u = 2^-24, M the largest coordinate
//! of the scene and o of the origin (absolute values), and D <= M + o any difference of the two:
//! the shear displaces a corner by at most 2 u D + 3 u D in projection and u D in z; the box's
//! planes are met at fma(b, 1/d, -o/d), with two roundings in 1/d (2 u D), two in o/d (2 u o) and one
//! of the sum (u D). Together less than 10 u (M + o). Every box is made larger by 16 u (M + o), which
//! is folded into the ray's origin (as Woop et al. do) and costs nothing per node; the principle of
//! moving interval ends outwards is that of Ize 2013, "Robust BVH Ray Traversal".

use std::mem::MaybeUninit;

use glam::Vec3A;

use super::Ray;
use super::build::{LEAF, Packet, Tree, WIDTH};
use super::cut::Surface;
use super::lanes::Lanes;

/// Unit roundoff of `f32`.
pub(crate) const U: f32 = 1.0 / (1 << 24) as f32;

/// Stack entries kept without allocation.
const SMALL_STACK: usize = 384;

/// Below this, 2^-90, an `f32` may have lost more to underflow (2^-149 an operation) than to rounding.
const SMALLEST: f32 = f32::from_bits((127 - 90) << 23);

/// U + V + W below this, 2^82, times a depth (at most 2^44, see [`super::LARGEST_COORDINATE`]) is finite.
const LARGEST: f32 = f32::from_bits((127 + 82) << 23);

/// A ray as the kernels want it. "z" is the axis in which it is longest, x and y the next two.
struct Prepared {
    axes: [usize; 3],
    /// Origin, in the order x, y, z.
    origin: [f32; 3],
    /// dx / dz and dy / dz.
    shear: [f32; 2],
    /// 1 or -1: the sign of dz.
    sign: f32,
    /// The ray's end as a distance in z, positive.
    depth: f32,
    /// Rows of [`super::build::Node::planes`] that the ray meets first, by world axis.
    near: [usize; 3],
    /// 1 / d in units of depth, by world axis.
    inverse: [f32; 3],
    /// -(o + error) / d for the planes met first, by world axis.
    near_offset: [f32; 3],
    /// -(o - error) / d for the planes met last, by world axis.
    far_offset: [f32; 3],
    /// Largest error of a box plane, metres.
    error: f32,
}

impl Prepared {
    /// `None` for a ray that cannot meet anything: of no length, or not finite.
    #[inline(always)]
    fn new(ray: &Ray, extent: f32) -> Option<Self> {
        let (origin, direction) = (Vec3A::from(ray.origin), Vec3A::from(ray.direction));
        let (o, d) = (ray.origin.to_array(), ray.direction.to_array());
        let size = d.map(f32::abs);
        // Without branches, which random rays would mispredict.
        let first = usize::from(size[0] <= size[1]);
        let z = if size[first] > size[2] { first } else { 2 };
        let [x, y] = [[1, 2], [2, 0], [0, 1]][z];
        let dz = d[z];
        let finite = origin.is_finite() && direction.is_finite();
        if dz == 0.0 || !finite || ray.t_max.is_nan() || ray.t_max <= 0.0 {
            return None;
        }
        let reach = extent + origin.abs().max_element();
        let error = 16.0 * U * reach;
        // No corner is deeper than `reach`; four times that keeps the products below finite.
        let depth = ray.t_max * dz.abs();
        let depth = if depth < 4.0 * reach { depth } else { 4.0 * reach };
        // A slope of 2^-60 instead of 0 moves the ray by less than u^2 of its length.
        let slope = direction / dz.abs();
        let flattest = Vec3A::splat(f32::from_bits((127 - 60) << 23));
        let inverse = 1.0 / slope.abs().max(flattest).copysign(slope);
        let outwards = Vec3A::splat(error).copysign(inverse);
        let sign = 1.0_f32.copysign(dz);
        let slope = slope.to_array();
        let negative = inverse.is_negative_bitmask();
        Some(Self {
            axes: [x, y, z],
            origin: [o[x], o[y], o[z]],
            shear: [slope[x] * sign, slope[y] * sign],
            sign,
            depth,
            near: std::array::from_fn(|axis| 2 * axis + (negative >> axis & 1) as usize),
            inverse: inverse.to_array(),
            near_offset: (-(origin + outwards) * inverse).to_array(),
            far_offset: (-(origin - outwards) * inverse).to_array(),
            error,
        })
    }
}

/// What to do with the triangles met.
pub(super) trait Visitor {
    /// Told before anything is met: the ray's end as a depth.
    #[inline(always)]
    fn begin(&mut self, _end: f32) {}
    /// A triangle met at `depth` (z, exact to `f32`), at the mean of its corners with these weights, whose sum is not 0;
    /// returns the depth up to which to go on, or 0 to end. Only called if [`Visitor::DEPTHS`].
    fn meet(&mut self, triangle: u32, depth: f64, weights: [f64; 3]) -> f32;
    /// Whether triangles and depths matter, and not only that something was met.
    const DEPTHS: bool;
    /// Whether triangles have holes.
    type Surface: Surface;
    /// Where these are.
    fn surface(&self) -> Self::Surface;
}

/// Whether anything is met, with every triangle met shown to `visitor` if it wants them.
#[inline(always)]
pub(super) fn one<L: Lanes, V: Visitor>(
    tree: &Tree,
    ray: &Ray,
    extent: f32,
    visitor: &mut V,
) -> bool {
    Prepared::new(ray, extent).is_some_and(|ray| from_root::<L, V>(tree, &ray, visitor))
}

/// Which of the rays meet anything.
///
/// Eight rays are prepared before the first of them is traced: their divisions overlap, while at the
/// end of a ray, which no processor foresees, there is nothing to overlap them with.
#[inline(always)]
pub(super) fn each<L: Lanes, S: Surface>(
    tree: &Tree,
    rays: &[Ray],
    extent: f32,
    surface: S,
    blocked: &mut [bool],
) {
    const AHEAD: usize = 8;
    for (rays, blocked) in rays.chunks(AHEAD).zip(blocked.chunks_mut(AHEAD)) {
        let mut prepared = [const { None }; AHEAD];
        for (ray, prepared) in rays.iter().zip(&mut prepared) {
            *prepared = Prepared::new(ray, extent);
        }
        for (ray, blocked) in prepared.iter().zip(blocked) {
            *blocked = ray
                .as_ref()
                .is_some_and(|ray| from_root::<L, _>(tree, ray, &mut super::Any(surface)));
        }
    }
}

#[inline(always)]
fn from_root<L: Lanes, V: Visitor>(tree: &Tree, ray: &Prepared, visitor: &mut V) -> bool {
    let mut small = [const { MaybeUninit::<u32>::uninit() }; SMALL_STACK];
    if tree.stack <= SMALL_STACK {
        descend::<L, V>(tree, ray, visitor, &mut small)
    } else {
        let mut large = vec![MaybeUninit::<u32>::uninit(); tree.stack];
        descend::<L, V>(tree, ray, visitor, &mut large)
    }
}

#[inline(always)]
fn descend<L: Lanes, V: Visitor>(
    tree: &Tree,
    ray: &Prepared,
    visitor: &mut V,
    stack: &mut [MaybeUninit<u32>],
) -> bool {
    if tree.nodes.is_empty() {
        return false;
    }
    let inverse = ray.inverse.map(L::splat);
    let near_offset = ray.near_offset.map(L::splat);
    let far_offset = ray.far_offset.map(L::splat);
    let mut depth = ray.depth;
    visitor.begin(depth);
    let mut found = false;
    let mut used = 0;
    let mut current = 0;
    loop {
        if current & LEAF == 0 {
            let node = &tree.nodes[current as usize];
            let meet_plane = |axis: usize| {
                let row = ray.near[axis];
                let near = L::load(&node.planes[row]).mul_add(inverse[axis], near_offset[axis]);
                let far = L::load(&node.planes[row ^ 1]).mul_add(inverse[axis], far_offset[axis]);
                (near, far)
            };
            let (x, y, z) = (meet_plane(0), meet_plane(1), meet_plane(2));
            // A box is met within `error` of where exact arithmetic meets it, also in depth.
            let end = L::splat(depth * (1.0 + 16.0 * U) + ray.error);
            let near = x.0.max(y.0).max(z.0.max(L::splat(0.0)));
            let far = x.1.min(y.1).min(z.1.min(end));
            let mask = near.le(far);
            let out: &mut [MaybeUninit<u32>; WIDTH] =
                (&mut stack[used..used + WIDTH]).try_into().expect("eight entries");
            // SAFETY: `MaybeUninit<u32>` has the layout of `u32`, and `compress` only writes.
            let out = unsafe { &mut *std::ptr::from_mut(out).cast::<[u32; WIDTH]>() };
            L::compress(&node.children, mask, out);
            if mask != 0 {
                // The last child comes next. Read from the node, it is there earlier than from the
                // stack.
                used += mask.count_ones() as usize - 1;
                current = node.children[mask.ilog2() as usize];
                continue;
            }
        } else {
            let packet = &tree.packets[(current & !LEAF) as usize];
            let (mut sure, mut unsure) = meet::<L>(packet, ray, depth);
            if V::Surface::CUT && !V::DEPTHS {
                // Holes are looked for where no whole triangle is met for sure.
                let is_cut = |lane| visitor.surface().is_cut(packet.triangles[lane]);
                let cut = (0..WIDTH).fold(0, |mask, lane| mask | u32::from(is_cut(lane)) << lane);
                unsure |= sure & cut;
                sure &= !cut;
            }
            if V::DEPTHS {
                unsure |= sure;
                sure = 0;
            }
            if sure != 0 {
                return true;
            }
            while unsure != 0 {
                let lane = unsure.trailing_zeros() as usize;
                unsure &= unsure - 1;
                if let Some((z, weights)) = meet_exactly(packet, lane, ray)
                    && z < f64::from(depth)
                    && visitor.surface().is_there(packet.triangles[lane], weights)
                {
                    if !V::DEPTHS {
                        return true;
                    }
                    found = true;
                    depth = visitor.meet(packet.triangles[lane], z, weights);
                    if depth <= 0.0 {
                        return true;
                    }
                }
            }
        }
        if used == 0 {
            return found;
        }
        used -= 1;
        // SAFETY: every entry below `used` was written by `compress`.
        current = unsafe { stack[used].assume_init() };
    }
}

/// The lanes of a packet that the ray meets, and those for which `f32` cannot tell.
#[inline(always)]
fn meet<L: Lanes>(packet: &Packet, ray: &Prepared, depth: f32) -> (u32, u32) {
    let [kx, ky, kz] = ray.axes;
    let [x, y, z] = [&packet.corners[kx], &packet.corners[ky], &packet.corners[kz]];
    let [ox, oy, oz] = ray.origin.map(L::splat);
    let [sx, sy] = ray.shear.map(L::splat);
    let corner = |i: usize| {
        let cz = L::load(&z[i]).sub(oz);
        let cx = sx.neg_mul_add(cz, L::load(&x[i]).sub(ox));
        let cy = sy.neg_mul_add(cz, L::load(&y[i]).sub(oy));
        (cx, cy, cz)
    };
    let (ax, ay, az) = corner(0);
    let (bx, by, bz) = corner(1);
    let (cx, cy, cz) = corner(2);
    // No fused operation here: both triangles at an edge must get the same number.
    let u = cx.mul(by).sub(cy.mul(bx));
    let v = ax.mul(cy).sub(ay.mul(cx));
    let w = bx.mul(ay).sub(by.mul(ax));
    // A lane stays unless one edge function is above 0 and another one below.
    let zero = L::splat(0.0);
    let lowest = u.min(v).min(w);
    let highest = u.max(v).max(w);
    let outside = lowest.lt(zero) & zero.lt(highest);
    let inside = !outside & 255;
    if inside == 0 {
        return (0, 0);
    }
    // Where all have one sign, T = U Az + V Bz + W Cz and det = U + V + W give the depth T / det. With
    // m = max |x| max |y| and r = max |z|, U, V and W err by 4 u m each; T by 28 u m r and det by 22 u m,
    // the sums' own roundings included; depth * det by another 6 u m depth.
    let det = u.add(v).add(w);
    let t = u.mul(az).add(v.mul(bz)).add(w.mul(cz)).flip(L::splat(ray.sign)).flip(det);
    let det = det.abs();
    let m = ax.abs().max(bx.abs()).max(cx.abs()).mul(ay.abs().max(by.abs()).max(cy.abs()));
    let r = az.abs().max(bz.abs()).max(cz.abs());
    let end = L::splat(depth);
    let error = L::splat(32.0 * U);
    let error_t = m.mul(r).mul(error);
    let error_gap = m.mul(end).mul(error).add(error_t);
    let gap = end.mul(det).sub(t);
    let certain = inside
        & zero.lt(lowest.abs().min(highest.abs()))
        & L::splat(SMALLEST).le(error_t)
        & L::splat(SMALLEST).le(det)
        & det.le(L::splat(LARGEST));
    let sure = certain & error_t.le(t) & error_gap.le(gap);
    let missed = certain & (t.le(zero.sub(error_t)) | gap.le(zero.sub(error_gap)));
    (sure, inside & !sure & !missed)
}

/// The depth at which the ray meets the triangle in front of its origin, if it does: exact signs, and
/// a depth to about 2^-50 of the corners' extent over the sine of the angle to the triangle's plane. With the corners'
/// weights there.
#[cold]
fn meet_exactly(packet: &Packet, lane: usize, ray: &Prepared) -> Option<(f64, [f64; 3])> {
    let [kx, ky, kz] = ray.axes;
    let corner = |i: usize| {
        let z = packet.corners[kz][i][lane] - ray.origin[2];
        let x = (-ray.shear[0]).mul_add(z, packet.corners[kx][i][lane] - ray.origin[0]);
        let y = (-ray.shear[1]).mul_add(z, packet.corners[ky][i][lane] - ray.origin[1]);
        [x, y, z].map(f64::from)
    };
    let [a, b, c] = [corner(0), corner(1), corner(2)];
    let u = c[0] * b[1] - c[1] * b[0];
    let v = a[0] * c[1] - a[1] * c[0];
    let w = b[0] * a[1] - b[1] * a[0];
    let det = u + v + w;
    if (u < 0.0 || v < 0.0 || w < 0.0) && (u > 0.0 || v > 0.0 || w > 0.0) || det == 0.0 {
        return None;
    }
    let z = (u * a[2] + v * b[2] + w * c[2]) / det * f64::from(ray.sign);
    (z > 0.0).then_some((z, [u, v, w]))
}

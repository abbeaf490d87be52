//! `soft/vssm.wesl` and `soft/strips.wesl`: shadows from moments. Without the pyramid.

use glam::{DVec2, IVec2};

use super::techniques::{Map, Receiver};
use super::{LEAST, Seen};
use crate::Vssm;

/// `chebyshev` of `filter/chebyshev.wesl`.
#[must_use]
pub fn chebyshev([mean, square]: [f64; 2], least: f64, z: f64) -> f64 {
    if z <= mean {
        return 1.0;
    }
    let variance = (square - mean * mean).max(least);
    variance / (variance + (z - mean).powi(2))
}

/// The share of a window that is nearer than `z`, and its mean depth, as two moments say; `None` where the window's mean is
/// not nearer, and they say nothing.
#[must_use]
pub fn blockers(moments: [f64; 2], least: f64, z: f64) -> Option<(f64, f64)> {
    let lit = chebyshev(moments, least, z);
    (z > moments[0]).then(|| (1.0 - lit, (moments[0] - lit * z) / (1.0 - lit)))
}

/// `strip` of `soft/strips.wesl`: low and high corner.
#[must_use]
pub fn strip(light: &Seen, k: u32, n: u32) -> [DVec2; 2] {
    if n == 1 {
        return [light.lo, light.hi];
    }
    let (from, to) = (f64::from(k) / f64::from(n), f64::from(k + 1) / f64::from(n));
    let at = |t: f64| light.lo.y + t * (light.hi.y - light.lo.y);
    let (bottom, top) = (at(from), at(to));
    if light.round {
        let rows = light.shape.transpose();
        let (xx, yy) = (rows.x_axis.length_squared(), rows.y_axis.length_squared());
        let xy = rows.x_axis.dot(rows.y_axis);
        let stretch = 1.0 / (1.0 - light.tilt.length()).max(LEAST);
        let middle = stretch * (from + to - 1.0) * xy / yy.sqrt();
        let below = |t: f64| {
            let y = 2.0 * t - 1.0;
            0.5 * (y * (1.0 - y * y).max(0.0).sqrt() + y.asin())
        };
        let chord = (below(to) - below(from)) / (2.0 * (to - from));
        let half = stretch * (xx - xy * xy / yy).max(0.0).sqrt() * chord;
        return [DVec2::new(middle - half, bottom), DVec2::new(middle + half, top)];
    }
    let y = 0.5 * (bottom + top);
    let corners = [(1.0, 1.0), (1.0, -1.0), (-1.0, -1.0), (-1.0, 1.0)]
        .map(|(x, y)| light.on_plane(DVec2::new(x, y)));
    let crossings = (0..4).filter_map(|i| {
        let (p, q) = (corners[i], corners[(i + 1) % 4]);
        ((p.y <= y) != (q.y <= y)).then(|| p.x + (y - p.y) / (q.y - p.y) * (q.x - p.x))
    });
    let ends = crossings.fold((light.hi.x, light.lo.x), |(lo, hi), x| (lo.min(x), hi.max(x)));
    [DVec2::new(ends.0.min(ends.1), bottom), DVec2::new(ends.0.max(ends.1), top)]
}

/// A map with its table, and linear depth (x d + y) / (z d + w).
pub struct Table<'a> {
    /// The map.
    pub map: Map<'a>,
    /// Coefficients of linear depth.
    pub linear: [f64; 4],
    /// The integer that stands for 1.
    pub scale: f64,
    /// Sums before each texel and one more, an axis.
    sums: Vec<[f64; 2]>,
}

/// What a window hides, and the integral of its depth about the middle.
#[derive(Clone, Copy, Debug, Default)]
struct Share {
    hidden: f64,
    depth: f64,
    valid: bool,
    inside: f64,
}

impl<'a> Table<'a> {
    /// The table of a map.
    #[must_use]
    pub fn new(map: Map<'a>, linear: [f64; 4], scale: f64) -> Self {
        let side = map.size as usize + 1;
        let mut table = Self { map, linear, scale, sums: vec![[0.0; 2]; side * side] };
        for y in 1..side {
            for x in 1..side {
                let z = table.of_depth((table.map.depth)(x as i32 - 1, y as i32 - 1));
                let texel = [z, (2.0 * z - 1.0).powi(2)].map(|v| (v * scale).round());
                let at = |x: usize, y: usize| table.sums[y * side + x];
                let (left, up, both) = (at(x - 1, y), at(x, y - 1), at(x - 1, y - 1));
                table.sums[y * side + x] = [0, 1].map(|i| texel[i] + left[i] + up[i] - both[i]);
            }
        }
        table
    }

    /// The sums as the shader has them: up to and with each texel, modulo 2^32.
    #[must_use]
    pub fn integers(&self) -> Vec<[u32; 2]> {
        let side = self.map.size as usize;
        let sum = |i: usize| self.sums[(i / side + 1) * (side + 1) + i % side + 1];
        (0..side * side).map(|i| sum(i).map(|s| (s as u64) as u32)).collect()
    }

    fn of_depth(&self, d: f64) -> f64 {
        let [x, y, z, w] = self.linear;
        if d <= 0.0 || z * d + w <= 0.0 {
            return 1.0;
        }
        ((x * d + y) / (z * d + w)).clamp(0.0, 1.0)
    }

    fn to_depth(&self, linear: f64) -> f64 {
        let [x, y, z, w] = self.linear;
        (y - linear * w) / (linear * z - x)
    }

    /// Moments about the middle of the box from `lo` to `hi`, texels that its sides cut counted in part.
    #[must_use]
    pub fn moments(&self, lo: DVec2, hi: DVec2) -> [f64; 2] {
        let side = self.map.size as usize + 1;
        let before = |x: f64, y: f64| {
            let (i, j) = (x.floor().min(side as f64 - 2.0), y.floor().min(side as f64 - 2.0));
            let (f, g) = (x - i, y - j);
            let at = |dx: usize, dy: usize| self.sums[(j as usize + dy) * side + i as usize + dx];
            [0, 1].map(|k| {
                (1.0 - g) * ((1.0 - f) * at(0, 0)[k] + f * at(1, 0)[k])
                    + g * ((1.0 - f) * at(0, 1)[k] + f * at(1, 1)[k])
            })
        };
        let [a, b, c, d] =
            [before(lo.x, lo.y), before(hi.x, lo.y), before(lo.x, hi.y), before(hi.x, hi.y)];
        let area = (hi - lo).element_product() * self.scale;
        let mean = [0, 1].map(|k| (d[k] - b[k] - c[k] + a[k]) / area);
        [mean[0] - 0.5, 0.25 * mean[1]]
    }

    /// `visibility` of `soft/vssm.wesl`; `rounding` is what its store may round.
    #[must_use]
    pub fn visibility(&self, receiver: &Receiver, config: &Vssm, rounding: f64) -> f64 {
        let light = &receiver.light;
        let nearest = light.view.nearest;
        let [lo, hi] = light.window(nearest);
        let size = DVec2::splat(f64::from(self.map.size));
        if nearest <= light.depth || hi.cmple(DVec2::ZERO).any() || lo.cmpge(size).any() {
            return 1.0;
        }
        let through = |depth| self.seen_through(receiver, config, rounding, depth);
        let found = through(nearest);
        if found.hidden <= 1e-4 * found.inside {
            return 1.0;
        }
        let linear = (found.depth / found.hidden + 0.5).max(self.of_depth(nearest));
        let depth = self.to_depth(linear);
        1.0 - through(depth.clamp(light.depth, nearest)).hidden
    }

    fn seen_through(&self, receiver: &Receiver, config: &Vssm, rounding: f64, depth: f64) -> Share {
        let light = &receiver.light;
        let scale = light.scale * (depth - light.depth).max(0.0);
        let rows = if light.is_box { 1 } else { config.strips };
        let (mut all, mut total) = (Share::default(), 0.0);
        for row in 0..rows {
            let l = strip(light, row, rows);
            let weight = (l[1] - l[0]).element_product().max(1e-30);
            let corners = l.map(|l| light.texel + l * scale);
            let mut share = self.bounded(receiver, config, rounding, corners);
            if !share.valid {
                let rows = if light.is_box { config.parts } else { 1 };
                let size = DVec2::splat(f64::from(self.map.size));
                let cut = corners.map(|corner| corner.clamp(DVec2::ZERO, size));
                let inside = share.inside;
                let of = self.divided(receiver, config, rounding, cut, rows);
                let (hidden, depth) = (inside * of.hidden, inside * of.depth);
                share = Share { hidden, depth, inside, ..share };
            }
            all.hidden += weight * share.hidden;
            all.depth += weight * share.depth;
            all.inside += weight * share.inside;
            total += weight;
        }
        Share {
            hidden: (all.hidden / total).clamp(0.0, 1.0),
            depth: all.depth / total,
            inside: all.inside / total,
            valid: true,
        }
    }

    fn divided(
        &self,
        receiver: &Receiver,
        config: &Vssm,
        rounding: f64,
        [lo, hi]: [DVec2; 2],
        rows: u32,
    ) -> Share {
        let side = (hi - lo) / DVec2::new(f64::from(config.parts), f64::from(rows));
        let n = config.parts * rows;
        let mut all = Share::default();
        for i in 0..n {
            let column = DVec2::new(f64::from(i % config.parts), f64::from(i / config.parts));
            let from = lo + column * side;
            let part = [from, from + side];
            let mut share = self.bounded(receiver, config, rounding, part);
            if !share.valid {
                share = self.four_texels(receiver, 0.5 * (part[0] + part[1]));
            }
            all.hidden += share.hidden / f64::from(n);
            all.depth += share.depth / f64::from(n);
        }
        all
    }

    fn bounded(
        &self,
        receiver: &Receiver,
        config: &Vssm,
        rounding: f64,
        [first, last]: [DVec2; 2],
    ) -> Share {
        let size = DVec2::splat(f64::from(self.map.size));
        let (lo, hi) = (first.clamp(DVec2::ZERO, size), last.clamp(DVec2::ZERO, size));
        let all = (last - first).max(DVec2::splat(1e-6));
        let clipped = (hi - lo).max(DVec2::ZERO) / all;
        let whole = |all: f64, clipped: f64| if all < 1e-3 { 1.0 } else { clipped };
        let inside = whole(all.x, clipped.x) * whole(all.y, clipped.y);
        let nothing = Share { valid: true, ..Share::default() };
        let off = last.cmplt(DVec2::ZERO).any() || first.cmpgt(size).any();
        if inside <= 0.0 || off {
            return nothing;
        }
        let half = (0.5 * (hi - lo)).max(DVec2::splat(0.501));
        let middle = (0.5 * (lo + hi)).clamp(half, (size - half).max(half));
        let (lo, hi) = (middle - half, middle + half);
        let mean = self.moments(lo, hi);
        let plane = receiver.depth + receiver.gradient.dot(centroid(lo, hi) - receiver.light.texel);
        let rise = (half.min(DVec2::ONE) * receiver.cone).length();
        let d = plane.max(receiver.depth) + rise;
        let [x, y, z, w] = self.linear;
        let z = (x * d + y) / (z * d + w) - rounding;
        let z = if z > 1.0 { 1.0 - rounding } else { z } - 0.5;
        let lit = chebyshev(mean, f64::from(config.deviation).powi(2), z);
        Share {
            hidden: inside * (1.0 - lit),
            depth: inside * (mean[0] - lit * z),
            valid: z > mean[0],
            inside,
        }
    }

    fn four_texels(&self, receiver: &Receiver, center: DVec2) -> Share {
        // WGSL rounds halves to even.
        let round = |v: f64| v.round_ties_even() as i32;
        let first = IVec2::new(round(center.x), round(center.y)) - 1;
        let mut all = Share::default();
        for i in 0..4 {
            let texel = first + IVec2::new(i & 1, i >> 1);
            if texel.min_element() < 0 || texel.max_element() >= self.map.size {
                continue;
            }
            let stored = (self.map.depth)(texel.x, texel.y);
            if receiver.blocks(texel, stored) {
                all.hidden += 0.25;
                all.depth += 0.25 * (self.of_depth(stored) - 0.5);
            }
        }
        all
    }
}

/// Mean of the centres of the texels of a box, each weighted by its part inside.
fn centroid(lo: DVec2, hi: DVec2) -> DVec2 {
    let axis = |lo: f64, hi: f64| {
        let (mut sum, mut i) = (0.0, lo.floor());
        while i < hi {
            sum += (hi.min(i + 1.0) - lo.max(i)) * (i + 0.5);
            i += 1.0;
        }
        sum / (hi - lo)
    };
    DVec2::new(axis(lo.x, hi.x), axis(lo.y, hi.y))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// SplitMix64 (Steele, Lea, Flood 2014).
    fn random(state: &mut u64) -> f64 {
        *state = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = *state;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 * 0.5f64.powi(53)
    }

    fn moments(parts: &[(f64, f64)]) -> [f64; 2] {
        let sum = |power: i32| parts.iter().map(|(share, z)| share * z.powi(power)).sum();
        [sum(1), sum(2)]
    }

    #[test]
    fn blockers_of_one_depth_before_a_receivers_own_are_found_exactly() {
        for share in [0.1, 0.5, 0.9] {
            let both = moments(&[(share, 4.0), (1.0 - share, 10.0)]);
            let (hidden, depth) = blockers(both, 1e-12, 10.0).expect("the mean is nearer");
            assert!(
                (hidden - share).abs() < 1e-9 && (depth - 4.0).abs() < 1e-9,
                "{hidden} {depth}"
            );
        }
        // The receiver before the mean: nothing is known.
        assert_eq!(blockers(moments(&[(0.5, 4.0), (0.5, 100.0)]), 1e-12, 10.0), None);
    }

    #[test]
    fn blockers_of_two_depths_seem_nearer_and_fewer_than_they_are() {
        // All hidden: 30 % at 2 and 70 % at 8, whose mean is 6.2.
        let (_, depth) = blockers(moments(&[(0.3, 2.0), (0.7, 8.0)]), 1e-12, 10.0).expect("nearer");
        assert!((depth - 4.21).abs() < 0.005, "{depth}");
        // With a slit of 5 % to a receiver at 10: 0.372 and not 0.05.
        let slit = moments(&[(0.3, 2.0), (0.65, 8.0), (0.05, 10.0)]);
        let lit = chebyshev(slit, 1e-12, 10.0);
        assert!((lit - 0.372).abs() < 0.0005, "{lit}");
        let mut state = 1;
        for _ in 0..10_000 {
            let (a, b) = (10.0 * random(&mut state), 10.0 * random(&mut state));
            let (f, g) = (random(&mut state), random(&mut state));
            let (f, g) = (f * g, (1.0 - f) * g);
            let all = moments(&[(f, a), (g, b), (1.0 - f - g, 10.0)]);
            let Some((hidden, depth)) = blockers(all, 0.0, 10.0) else { continue };
            let truth = (f * a + g * b) / (f + g);
            assert!(depth <= truth + 1e-6, "{depth}, not {truth}");
            assert!(hidden <= f + g + 1e-9, "{hidden}, not {}", f + g);
        }
    }
}

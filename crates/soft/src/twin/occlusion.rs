//! `soft/occlusion.wesl`: where slices lie and what they leave of the light.

use glam::{DVec2, DVec3};

use crate::{Fusion, Placement};

/// Far planes of `count` slices of the depths from `near` to `far`, as distances from the light's plane along the view, for a
/// receiver mostly at `receiver`, which lies beyond `far`, and a camera that looks at the depths `seen`, if any.
///
/// An edge of an occluder that is moved by e towards the receiver moves on the light by at most e z_p / (z (z_p - z)), or
/// e / (z_p - z) in parallel light. Steps of equal error are uniform in the integral of that factor.
#[must_use]
pub fn planes(
    (near, far): (f64, f64),
    receiver: f64,
    count: u32,
    placement: Placement,
    seen: &[f64],
    parallel: bool,
) -> Vec<f64> {
    let error = |z: f64| {
        if parallel { -(receiver - z).ln() } else { (z / (receiver - z)).ln() }
    };
    let inverse = |g: f64| {
        if parallel { receiver - (-g).exp() } else { receiver / (1.0 + (-g).exp()) }
    };
    let at = |t: f64| match placement {
        Placement::Seen if !seen.is_empty() => before_what_is_seen((near, far), seen, count, t),
        Placement::Uniform | Placement::Seen => near + t * (far - near),
        Placement::Error => {
            let (from, to) = (error(near), error(far));
            inverse(from + t * (to - from))
        }
    };
    let inner = (1..count).map(|k| at(f64::from(k) / f64::from(count)));
    inner.chain([far]).collect()
}

/// Where the share t of all planes lies before, half of which are at equal distances, and half, for each depth that is seen,
/// within as much before it as one of `count` equal slices is thick.
fn before_what_is_seen((near, far): (f64, f64), seen: &[f64], count: u32, t: f64) -> f64 {
    let range = far - near;
    let reach = range / f64::from(count);
    let share = |z: f64| {
        let each =
            seen.iter().map(|at| ((z - at.clamp(near + reach, far)) / reach + 1.0).clamp(0.0, 1.0));
        0.5 * (z - near) / range + 0.5 * each.sum::<f64>() / seen.len() as f64
    };
    let (mut low, mut high) = (near, far);
    // To 2^-24 of the range.
    for _ in 0..24 {
        let middle = 0.5 * (low + high);
        if share(middle) < t { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

/// Slices parallel to a rectangle in perspective, or to a square sun.
pub struct Slices<'a> {
    /// Their far planes.
    pub planes: &'a [f64],
    /// Before the first.
    pub near: f64,
    /// Half sides of the light, or tangents of the sun's half angle.
    pub half: DVec2,
    /// Whether light is parallel.
    pub parallel: bool,
    /// Fade, in slices.
    pub fade: f64,
    /// How slices are put together.
    pub fusion: Fusion,
    /// The covered share of the box around a point of slice k's plane, with those half sides.
    pub covered: &'a dyn Fn(usize, DVec2, DVec2) -> f64,
}

impl Slices<'_> {
    /// Visibility of a point, z away from the light.
    #[must_use]
    pub fn visibility(&self, p: DVec3) -> f64 {
        let mut left: f64 = 1.0;
        for (k, plane) in self.planes.iter().enumerate() {
            let gap = p.z - plane;
            if gap <= 0.0 {
                break;
            }
            let (center, reach) = if self.parallel {
                (p.truncate(), gap)
            } else {
                (p.truncate() * plane / p.z, gap / p.z)
            };
            let hidden = (self.covered)(k, center, self.half * reach);
            let over = self.fade * fade_length(self.near, self.planes, k);
            let weight = if over > 0.0 { (gap / over).min(1.0) } else { 1.0 };
            match self.fusion {
                Fusion::Product => left *= 1.0 - weight * hidden,
                Fusion::Sum => left -= weight * hidden,
                Fusion::Max => left = left.min(1.0 - weight * hidden),
            }
        }
        left.clamp(0.0, 1.0)
    }
}

/// Thickness of the slice behind plane k, or of the last one.
pub(crate) fn fade_length(near: f64, planes: &[f64], k: usize) -> f64 {
    match planes.get(k + 1) {
        Some(next) => next - planes[k],
        None => planes[k] - if k > 0 { planes[k - 1] } else { near },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slices_of_equal_error_are_so_and_lie_denser_at_the_floor() {
        for parallel in [false, true] {
            let found = planes((4.0, 9.5), 10.0, 8, Placement::Error, &[], parallel);
            assert!((found[7] - 9.5).abs() < 1e-12, "{found:?}");
            // The factor, integrated over each slice.
            let error = |z: f64| if parallel { 1.0 / (10.0 - z) } else { 10.0 / (z * (10.0 - z)) };
            let mut each = Vec::new();
            let mut from = 4.0;
            for to in &found {
                let n = 2000;
                let step = (to - from) / f64::from(n);
                let sum: f64 = (0..n).map(|i| error(from + (f64::from(i) + 0.5) * step)).sum();
                each.push(sum * step);
                from = *to;
            }
            for e in &each {
                // The midpoint rule's error falls with the square of the step.
                assert!((e - each[0]).abs() < 1e-5, "{each:?}");
            }
            assert!(found[7] - found[6] < 0.5 * (found[1] - found[0]), "{found:?}");
            let uniform = planes((4.0, 9.5), 10.0, 8, Placement::Uniform, &[], parallel);
            assert!((uniform[1] - uniform[0] - 5.5 / 8.0).abs() < 1e-12, "{uniform:?}");
            let blind = planes((4.0, 9.5), 10.0, 8, Placement::Seen, &[], parallel);
            assert_eq!(blind, uniform, "without a camera");
        }
    }

    #[test]
    fn slices_are_thin_before_what_is_seen_and_nowhere_thicker_than_two() {
        for seen in [vec![6.0], vec![4.1, 9.4], vec![2.0], vec![30.0; 5]] {
            let found = planes((4.0, 9.5), 10.0, 8, Placement::Seen, &seen, false);
            let uniform = 5.5 / 8.0;
            let mut from = 4.0;
            for to in &found {
                let thickness = to - from;
                assert!(thickness > 0.1 * uniform, "{seen:?}: {found:?}");
                assert!(thickness < 2.0 * uniform + 1e-6, "{seen:?}: {found:?}");
                from = *to;
            }
            assert_eq!(found[7], 9.5, "the last one ends where casters do");
        }
        // Half of the eight lie before the one depth that is seen, within a slice.
        let found = planes((4.0, 9.5), 10.0, 8, Placement::Seen, &[6.0], false);
        let before = found.iter().filter(|z| (6.0 - 5.5 / 8.0..=6.0).contains(*z)).count();
        assert!(before >= 4, "{found:?}");
    }

    /// Visibility of the point (x, 0, 10) behind strips that are endless in y: from, to and depth of each, seen from `d`
    /// behind the light.
    fn behind(strips: &[(f64, f64, f64)], planes: &[f64], d: f64, fusion: Fusion, x: f64) -> f64 {
        let covered = |k: usize, center: DVec2, half: DVec2| {
            let near = if k == 0 { 0.0 } else { planes[k - 1] };
            let of = |(from, to, z): &(f64, f64, f64)| {
                if *z <= near || *z > planes[k] {
                    return 0.0;
                }
                let onto = (planes[k] + d) / (z + d);
                let (lo, hi) = (center.x - half.x, center.x + half.x);
                ((to * onto).min(hi) - (from * onto).max(lo)).max(0.0) / (hi - lo)
            };
            strips.iter().map(of).sum::<f64>().min(1.0)
        };
        let slices = Slices {
            planes,
            near: 0.0,
            half: DVec2::ONE,
            parallel: false,
            fade: 0.0,
            fusion,
            covered: &covered,
        };
        slices.visibility(DVec3::new(x, 0.0, 10.0))
    }

    #[test]
    fn fusion_gives_what_each_rule_says_of_two_half_planes() {
        let same = [(-50.0, 0.0, 4.0), (-50.0, 0.0, 6.0)];
        let opposite = [(-50.0, 0.0, 4.0), (0.0, 50.0, 6.0)];
        let at = |strips: &[_], fusion| behind(strips, &[4.0, 6.0], 3.0, fusion, 0.0);
        // The truth is 0.5 and 0.
        for strips in [same, opposite] {
            assert_eq!(at(&strips, Fusion::Product), 0.25);
            assert_eq!(at(&strips, Fusion::Sum), 0.0);
            assert_eq!(at(&strips, Fusion::Max), 0.5);
        }
    }

    #[test]
    fn more_slices_of_one_body_leave_less_and_less_light() {
        // A column |x| <= 0.5 from z = 2 to 8, filled, seen from 3 behind the light: as wide in a slice as its nearest part is
        // when flattened. The truth at x = 2 is 0.4375.
        let left = |count: u32| {
            let planes = planes((1.0, 9.0), 10.0, count, Placement::Uniform, &[], false);
            let covered = |k: usize, center: DVec2, half: DVec2| {
                let top = if k == 0 { 1.0 } else { planes[k - 1] };
                let (from, to) = (f64::max(top, 2.0), f64::min(planes[k], 8.0));
                let wide = 0.5 * (planes[k] + 3.0) / (from + 3.0);
                let shared = wide.min(center.x + half.x) - f64::max(-wide, center.x - half.x);
                if from < to { shared.max(0.0) / (2.0 * half.x) } else { 0.0 }
            };
            let slices = Slices {
                planes: &planes,
                near: 1.0,
                half: DVec2::ONE,
                parallel: false,
                fade: 0.0,
                fusion: Fusion::Product,
                covered: &covered,
            };
            slices.visibility(DVec3::new(2.0, 0.0, 10.0))
        };
        for (count, expected) in [(4, 0.417), (8, 0.316), (16, 0.090), (32, 0.007)] {
            let found = left(count);
            assert!((found - expected).abs() < 0.0006, "{count} slices: {found}");
        }
    }

    #[test]
    fn one_strip_on_a_plane_is_exact_and_off_it_errs_by_a_slice_at_most() {
        let mut worst: f64 = 0.0;
        for i in 0..200 {
            let x = -2.0 + 0.02 * f64::from(i);
            let truth = |z: f64| {
                let edge = |e: f64| ((10.0 * e - z * x) / (10.0 - z)).clamp(-1.0, 1.0);
                1.0 - 0.5 * (edge(0.4) - edge(-0.3))
            };
            let on = behind(&[(-0.3, 0.4, 6.0)], &[6.0], 3.0, Fusion::Product, x);
            assert!((on - truth(6.0)).abs() < 1e-12, "at {x}: {on}");
            let planes = planes((4.0, 9.0), 10.0, 8, Placement::Uniform, &[], false);
            let off = behind(&[(-0.3, 0.4, 5.7)], &planes, 3.0, Fusion::Product, x);
            worst = worst.max((off - truth(5.7)).abs());
        }
        // 5.7 lies in the slice to 5.875; each of two edges moves by at most e z_p / (z (z_p - z)) of a light of width 2,
        // times the distance of 2 between the points that are moved.
        let bound = 2.0 * 0.175 * 10.0 / (5.7 * (10.0 - 5.875));
        assert!(worst > 0.005 && worst < bound, "{worst}, at most {bound}");
    }
}

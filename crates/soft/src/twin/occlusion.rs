//! `soft/occlusion.wesl`: where slices lie and what they leave of the light.

use glam::{DVec2, DVec3};

use crate::{Fusion, Placement};

/// Far planes of `count` slices of the depths from `near` to `far`, as distances from the light's plane along the view, for a
/// camera that looks at the depths `seen`, or, where it is not known, a receiver mostly at `receiver`, which lies beyond `far`.
#[must_use]
pub fn planes(
    (near, far): (f64, f64),
    receiver: f64,
    count: u32,
    placement: Placement,
    seen: &[f64],
    parallel: bool,
) -> Vec<f64> {
    let shares = (1..count).map(|k| f64::from(k) / f64::from(count));
    let uniform = |t: f64| near + t * (far - near);
    let inner: Vec<f64> = match placement {
        Placement::Seen if !seen.is_empty() => {
            shares.map(|t| before_what_is_seen((near, far), seen, count, t)).collect()
        }
        Placement::Uniform | Placement::Seen => shares.map(uniform).collect(),
        Placement::Error => {
            let receivers = if seen.is_empty() { &[receiver] } else { seen };
            let before = summed(&densities_of_least_error((near, far), receivers, count, parallel));
            shares.map(|t| uniform(crossing(&before, t))).collect()
        }
    };
    inner.into_iter().chain([far]).collect()
}

/// How far the edge of an occluder at z moves on the light, in widths of it and for each metre that it is moved towards a
/// receiver at the depth r, at most. In parallel light half as far, but as much as leaves it out where it is moved by r - z.
fn shift(z: f64, r: f64, parallel: bool) -> f64 {
    if parallel { 1.0 / (r - z) } else { r / (z * (r - z)) }
}

/// Cells of the depths from near to far in which the density of planes is constant.
const CELLS: usize = 256;

/// How densely planes lie in each cell, relatively, for the least mean square error: over occluders at whatever depth and the
/// receivers behind them.
///
/// In slices d thick an occluder is moved by e from 0 to d, which errs by min(1, s e) for a receiver with the shift s: that
/// squared is f(s d) = (s d)^2 / 3 in the mean, or 1 - 2 / (3 s d) where s d > 1. Of the densities l = 1 / d whose integral is
/// given, that with the least mean of f(s / l) has the same derivative by l everywhere: mean(min(1 / s, s^2 / l^3)) = m.
/// Where nothing is beyond help that is l^3 = mean(s^2) / m, the law of quantisers of many steps (Bennett 1948; Panter, Dite
/// 1951). Occluders so close to their receivers that they are left out whatever is done weigh less than that by l / s and more.
fn densities_of_least_error(
    (near, far): (f64, f64),
    receivers: &[f64],
    count: u32,
    parallel: bool,
) -> Vec<f64> {
    /// Receivers that stand for all: of as many equal shares of them the middle ones.
    const MOST: usize = 32;
    /// Each cell's density is multiplied by the root of how much its derivative is too large: most is done after ten.
    const STEPS: usize = 16;
    let mut sorted = receivers.to_vec();
    sorted.sort_by(f64::total_cmp);
    let kept = sorted.len().min(MOST);
    let kept: Vec<f64> =
        (0..kept).map(|i| sorted[(2 * i + 1) * sorted.len() / (2 * kept)]).collect();
    let cell = (far - near) / CELLS as f64;
    let even = f64::from(count) / (far - near);
    let shifts: Vec<Vec<f64>> = (0..CELLS)
        .map(|i| near + (i as f64 + 0.5) * cell)
        .map(|z| kept.iter().filter(|r| **r > z).map(|r| shift(z, *r, parallel)).collect())
        .collect();
    let mut densities = vec![even; CELLS];
    for _ in 0..STEPS {
        for (density, shifts) in densities.iter_mut().zip(&shifts) {
            let cubed = density.powi(3);
            *density = shifts.iter().map(|s| (cubed / s).min(s * s)).sum::<f64>().cbrt();
        }
        let mean = densities.iter().sum::<f64>() / CELLS as f64;
        if mean <= 0.0 {
            return vec![even; CELLS];
        }
        densities.iter_mut().for_each(|density| *density *= even / mean);
    }
    densities
}

/// Share of the sum of `values` that lies before each, and 1.
fn summed(values: &[f64]) -> Vec<f64> {
    let sum: f64 = values.iter().sum();
    let mut before = vec![0.0];
    before.extend(values.iter().scan(0.0, |all, value| {
        *all += value / sum;
        Some(*all)
    }));
    before
}

/// Where the piecewise linear `rising`, over [0, 1], reaches `t`.
fn crossing(rising: &[f64], t: f64) -> f64 {
    let i = rising.partition_point(|v| *v < t).clamp(1, rising.len() - 1);
    let part = (t - rising[i - 1]) / (rising[i] - rising[i - 1]).max(f64::MIN_POSITIVE);
    (i as f64 - 1.0 + part.clamp(0.0, 1.0)) / (rising.len() - 1) as f64
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

    /// Mean square error, by the model of [`densities_of_least_error`], of slices with those planes. Occluders in the slice of
    /// their receiver are left out.
    fn modelled(near: f64, planes: &[f64], receivers: &[f64], parallel: bool) -> f64 {
        const STEPS: usize = 4000;
        let far = planes[planes.len() - 1];
        let (mut sum, mut count) = (0.0, 0.0);
        for i in 0..STEPS {
            let z = near + (far - near) * (i as f64 + 0.5) / STEPS as f64;
            let onto = planes[planes.partition_point(|plane| *plane < z)];
            for r in receivers.iter().filter(|r| **r > z) {
                let error = if onto < *r { shift(z, *r, parallel) * (onto - z) } else { 1.0 };
                sum += error.min(1.0).powi(2);
                count += 1.0;
            }
        }
        sum / count
    }

    #[test]
    fn error_driven_slices_err_less_than_others_and_many_of_them_least() {
        let spread: Vec<f64> = (0..40).map(|i| 5.0 + 0.1 * f64::from(i)).collect();
        for receivers in [vec![10.0], vec![7.0; 256], vec![5.0, 9.0], spread] {
            for parallel in [false, true] {
                for count in [8, 16, 32, 256] {
                    let of = |placement| {
                        let found =
                            planes((4.0, 9.5), 10.0, count, placement, &receivers, parallel);
                        assert!(found.is_sorted() && found[0] > 4.0, "{found:?}");
                        assert_eq!(
                            found[count as usize - 1],
                            9.5,
                            "the last one ends where casters do"
                        );
                        modelled(4.0, &found, &receivers, parallel)
                    };
                    let [error, uniform, seen] =
                        [Placement::Error, Placement::Uniform, Placement::Seen].map(of);
                    let name = format!("{count} before {receivers:?}, {parallel}");
                    assert!(error < uniform, "{name}: {error}, equal ones {uniform}");
                    // It is a law of many steps: of 8 the denser ones before what is seen may be better by a few per cent.
                    let least = if count == 256 { seen } else { 1.05 * seen };
                    assert!(error < least, "{name}: {error}, before what is seen {seen}");
                }
            }
        }
        // Of one floor steps of equal shift, uniform in ln(z / (r - z)), have the smallest largest error instead.
        let (from, to) = ((4.0 / 6.0_f64).ln(), (9.5 / 0.5_f64).ln());
        let equal: Vec<f64> = (1..=8)
            .map(|k| 10.0 / (1.0 + (-(from + f64::from(k) / 8.0 * (to - from))).exp()))
            .collect();
        let found = planes((4.0, 9.5), 10.0, 8, Placement::Error, &[], false);
        let [found, equal] = [&found, &equal].map(|planes| modelled(4.0, planes, &[10.0], false));
        assert!(found < equal, "{found}, in equal shifts {equal}");
    }

    #[test]
    fn without_a_camera_equal_slices_are_so() {
        for parallel in [false, true] {
            let uniform = planes((4.0, 9.5), 10.0, 8, Placement::Uniform, &[], parallel);
            assert!((uniform[1] - uniform[0] - 5.5 / 8.0).abs() < 1e-12, "{uniform:?}");
            let blind = planes((4.0, 9.5), 10.0, 8, Placement::Seen, &[], parallel);
            assert_eq!(blind, uniform, "without a camera");
            // Receivers that casters are behind of tell nothing.
            let behind = planes((4.0, 9.5), 10.0, 8, Placement::Error, &[1.0; 9], parallel);
            let same = behind.iter().zip(&uniform).all(|(a, b)| (a - b).abs() < 1e-12);
            assert!(same, "{behind:?}");
        }
    }

    #[test]
    fn planes_creep_as_what_is_seen_changes() {
        // Half of the planes' density is that of equal slices: where k of n rays meet something else, the share of planes before
        // any depth changes by k / 2n at most, and no plane moves farther than k / n of all depths.
        let mut seen: Vec<f64> = (0..256).map(|i| 4.5 + 0.02 * f64::from(i % 250)).collect();
        let mut before = planes((4.0, 9.5), 10.0, 8, Placement::Seen, &seen, false);
        let mut worst: f64 = 0.0;
        for frame in 0..64 {
            let changed = 1 + frame % 7;
            for i in 0..changed {
                let ray = (frame * 37 + i * 11) % 256;
                seen[ray] = 4.2 + 5.2 * ((frame * 5 + i * 3) % 16) as f64 / 16.0;
            }
            let after = planes((4.0, 9.5), 10.0, 8, Placement::Seen, &seen, false);
            let moved = before.iter().zip(&after).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            // And by the precision to which they are found, twice.
            let bound = 5.5 * (changed as f64 / 256.0 + 2.0 / f64::from(1 << 24));
            assert!(moved <= bound, "frame {frame}: by {moved}, at most {bound}");
            worst = worst.max(moved / bound);
            before = after;
        }
        assert!(worst > 0.1, "planes stood still: {worst}");
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

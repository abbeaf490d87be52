//! `soft/coverage.wesl`: how much of the light a quadrilateral hides.

use std::f64::consts::PI;

use glam::DVec2;

/// `quad_share`.
#[must_use]
pub fn quad_share(round: bool, corners: [DVec2; 4]) -> f64 {
    let edge = if round { in_disc } else { in_square };
    let sum: f64 = (0..4).map(|i| edge(corners[i], corners[(i + 1) % 4])).sum();
    (sum.abs() / if round { PI } else { 4.0 }).min(1.0)
}

/// `in_square`.
#[must_use]
pub fn in_square(p: DVec2, q: DVec2) -> f64 {
    let (from_x, to_x) = (p.x.clamp(-1.0, 1.0), q.x.clamp(-1.0, 1.0));
    let width = to_x - from_x;
    if width == 0.0 {
        return 0.0;
    }
    let slope = (q.y - p.y) / (q.x - p.x);
    let (from_y, to_y) = (p.y + slope * (from_x - p.x), p.y + slope * (to_x - p.x));
    let rise = to_y - from_y;
    if rise.abs() < 1e-7 {
        return width * ((0.5 * (from_y + to_y)).clamp(-1.0, 1.0) + 1.0);
    }
    width * ((clamped_integral(to_y) - clamped_integral(from_y)) / rise + 1.0)
}

fn clamped_integral(y: f64) -> f64 {
    if y.abs() <= 1.0 { 0.5 * y * y } else { y.abs() - 0.5 }
}

/// `in_disc`.
#[must_use]
pub fn in_disc(p: DVec2, q: DVec2) -> f64 {
    let along = q - p;
    let a = along.length_squared();
    if a < 1e-20 {
        return 0.0;
    }
    let (b, c) = (p.dot(along), p.length_squared() - 1.0);
    let root = b * b - a * c;
    if root <= 0.0 {
        return sector(p, q);
    }
    let d = root.sqrt();
    let enter = p + ((-b - d) / a).clamp(0.0, 1.0) * along;
    let leave = p + ((-b + d) / a).clamp(0.0, 1.0) * along;
    sector(p, enter) + 0.5 * enter.perp_dot(leave) + sector(leave, q)
}

fn sector(p: DVec2, q: DVec2) -> f64 {
    0.5 * p.perp_dot(q).atan2(p.dot(q))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Random numbers in [-1, 1): SplitMix64 (Steele, Lea, Flood 2014).
    fn random(state: &mut u64) -> f64 {
        *state = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = *state;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 * 0.5f64.powi(52) - 1.0
    }

    fn holds(corners: &[DVec2; 4], s: DVec2) -> bool {
        // Even-odd: the quadrilaterals are convex.
        (0..4).fold(false, |inside, i| {
            let (p, q) = (corners[i], corners[(i + 1) % 4]);
            let crosses =
                (p.y > s.y) != (q.y > s.y) && s.x < p.x + (s.y - p.y) / (q.y - p.y) * (q.x - p.x);
            inside != crosses
        })
    }

    #[test]
    fn shares_of_random_quadrilaterals_are_those_of_a_fine_grid() {
        const SIDE: u32 = 400;
        let mut state = 7;
        for round in [false, true] {
            for trial in 0..60 {
                // Sheared and turned rectangles of all sizes, about, across and off the light.
                let size = 10f64.powf(random(&mut state));
                let centre = 1.5 * DVec2::new(random(&mut state), random(&mut state));
                let u = size * DVec2::new(random(&mut state), random(&mut state));
                let v = size * DVec2::new(random(&mut state), random(&mut state));
                let corners = [centre - u - v, centre + u - v, centre + u + v, centre - u + v];
                let (mut all, mut hidden) = (0u32, 0u32);
                for i in 0..SIDE * SIDE {
                    let unit = |k: u32| (f64::from(k) + 0.5) * 2.0 / f64::from(SIDE) - 1.0;
                    let s = DVec2::new(unit(i % SIDE), unit(i / SIDE));
                    if !round || s.length_squared() <= 1.0 {
                        all += 1;
                        hidden += u32::from(holds(&corners, s));
                    }
                }
                let grid = f64::from(hidden) / f64::from(all);
                let exact = quad_share(round, corners);
                // Five edges cross at most 2 SIDE cells each, of which each is off by half: at random, so by the root.
                // Measured against 10 cells' worth of a side.
                let bound = 10.0 / f64::from(SIDE);
                assert!((grid - exact).abs() < bound, "trial {trial}, {round}: {grid}, {exact}");
            }
        }
    }

    #[test]
    fn a_quadrilateral_that_holds_the_light_hides_all_and_a_grid_of_them_too() {
        for round in [false, true] {
            let whole = [(-2.0, -2.0), (3.0, -2.0), (3.0, 2.0), (-2.0, 2.0)];
            let share = quad_share(round, whole.map(|(x, y)| DVec2::new(x, y)));
            assert!((share - 1.0).abs() < 1e-12, "{share}");
            let mut sum = 0.0;
            for i in 0..100 {
                let lo = DVec2::new(f64::from(i % 10), f64::from(i / 10)) * 0.25 - 1.2;
                let hi = lo + 0.25;
                sum += quad_share(round, [lo, DVec2::new(hi.x, lo.y), hi, DVec2::new(lo.x, hi.y)]);
            }
            assert!((sum - 1.0).abs() < 1e-12, "{sum}");
        }
    }
}

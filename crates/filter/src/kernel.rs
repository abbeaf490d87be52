//! Filter kernels: the Rust twins of `filter/kernel/*.wesl`, in f64, and Poisson discs.
//!
//! A separable kernel covers `texels` texels an axis. With `start = t - offset`, `first = floor(start)` and
//! `fraction = start - first` for a sample at the continuous texel coordinate `t`, texel `first + i` has
//! weight `weight(i, fraction)`; weights add to 1.

/// A separable kernel, one axis of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Separable {
    /// `side` nearest texels of equal weight.
    Box {
        /// Texels an axis.
        side: u32,
    },
    /// `side` bilinear taps one texel apart.
    Tent {
        /// Taps an axis.
        side: u32,
    },
    /// The cubic B-spline, 4 texels.
    Cubic,
    /// Castano's kernel of `side` = 3, 5 or 7 texels (2013).
    Castano {
        /// Texels of the kernel at a texel's centre.
        side: u32,
    },
}

impl Separable {
    /// Texels an axis.
    #[must_use]
    pub fn texels(self) -> u32 {
        match self {
            Self::Box { side } => side,
            Self::Tent { side } | Self::Castano { side } => side + 1,
            Self::Cubic => 4,
        }
    }

    /// Distance from the sample back to where the first texel's number is taken, texels.
    #[must_use]
    pub fn offset(self) -> f64 {
        match self {
            Self::Box { side } => 0.5 * (f64::from(side) - 1.0),
            Self::Tent { side } | Self::Castano { side } => 0.5 * f64::from(side),
            Self::Cubic => 1.5,
        }
    }

    /// Weight of texel `i` of the kernel; `fraction` in [0, 1).
    #[must_use]
    pub fn weight(self, i: u32, fraction: f64) -> f64 {
        match self {
            Self::Box { side } => 1.0 / f64::from(side),
            Self::Tent { side } => {
                let inner = if i == 0 { 1.0 - fraction } else { 1.0 };
                (if i == side { fraction } else { inner }) / f64::from(side)
            }
            Self::Cubic => {
                let a = if i < 2 { 1.0 - fraction } else { fraction };
                if i == 0 || i == 3 {
                    a.powi(3) / 6.0
                } else {
                    (1.0 + 3.0 * a + 3.0 * a.powi(2) - 3.0 * a.powi(3)) / 6.0
                }
            }
            Self::Castano { side } => {
                let core = antumbra_shaders::castano_core(side).unwrap_or(&[]);
                let at = |k: i64| {
                    usize::try_from(k).ok().and_then(|k| core.get(k)).map_or(0.0, |v| f64::from(*v))
                };
                let sum: i32 = core.iter().sum();
                let i = i64::from(i);
                ((1.0 - fraction) * at(i) + fraction * at(i - 1)) / f64::from(sum)
            }
        }
    }

    /// Largest distance from the sample to the centre of a texel of the kernel, texels.
    #[must_use]
    pub fn radius(self) -> f64 {
        0.5 * f64::from(self.texels())
    }
}

/// `count` points in the unit disc that keep far from one another: Mitchell's best-candidate algorithm
/// (1991), from a fixed seed, so that every build gives the same points.
#[must_use]
pub fn poisson_disc(count: u32) -> Vec<[f32; 2]> {
    let mut unit = unit_numbers();
    let mut point = move || {
        let (radius, angle) = (unit().sqrt(), std::f64::consts::TAU * unit());
        [(radius * angle.cos()) as f32, (radius * angle.sin()) as f32]
    };
    let mut points: Vec<[f32; 2]> = Vec::new();
    for placed in 0..count {
        let nearest = |c: &[f32; 2]| {
            let squares = points.iter().map(|p| (p[0] - c[0]).powi(2) + (p[1] - c[1]).powi(2));
            squares.fold(f32::INFINITY, f32::min)
        };
        // Candidates grow with the points placed, as the paper asks for.
        let mut best = point();
        for _ in 0..16 * placed {
            let candidate = point();
            if nearest(&candidate) > nearest(&best) {
                best = candidate;
            }
        }
        points.push(best);
    }
    points
}

/// `side`² points in the unit disc, outermost first: the middles of a grid's cells, each moved within its cell from
/// a fixed seed, with one axis of the grid around the disc and the square root of the other outwards, so that
/// each point stands for the same area (Uralsky 2005).
#[must_use]
pub fn stratified_disc(side: u32) -> Vec<[f32; 2]> {
    let mut unit = unit_numbers();
    let mut polar: Vec<[f64; 2]> = (0..side * side)
        .map(|i| {
            let cell = |k: u32, jitter: f64| (f64::from(k) + jitter) / f64::from(side);
            let (along, outward) = (unit(), unit());
            [cell(i / side, outward).sqrt(), std::f64::consts::TAU * cell(i % side, along)]
        })
        .collect();
    polar.sort_by(|a, b| b[0].total_cmp(&a[0]));
    polar.iter().map(|[r, angle]| [(r * angle.cos()) as f32, (r * angle.sin()) as f32]).collect()
}

/// SplitMix64 (Steele, Lea, Flood 2014) from a fixed seed, as numbers in [0, 1).
fn unit_numbers() -> impl FnMut() -> f64 {
    let mut state = 0x0061_6E74_756D_6272_u64;
    move || {
        state = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = state;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 * (0.5f64).powi(53)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const KERNELS: [Separable; 9] = [
        Separable::Cubic,
        Separable::Box { side: 1 },
        Separable::Box { side: 2 },
        Separable::Box { side: 7 },
        Separable::Tent { side: 1 },
        Separable::Tent { side: 4 },
        Separable::Castano { side: 3 },
        Separable::Castano { side: 5 },
        Separable::Castano { side: 7 },
    ];

    fn profile(kernel: Separable, t: f64) -> f64 {
        // Weight of the texels left of 0 for a sample at t: the response to a straight edge.
        let start = t - kernel.offset();
        let first = start.floor();
        (0..kernel.texels())
            .filter(|&i| first + f64::from(i) < 0.0)
            .map(|i| kernel.weight(i, start - first))
            .sum()
    }

    #[test]
    fn weights_add_to_one_and_are_not_negative() {
        for kernel in KERNELS {
            for step in 0..1000 {
                let fraction = f64::from(step) / 1000.0;
                let weights: Vec<f64> =
                    (0..kernel.texels()).map(|i| kernel.weight(i, fraction)).collect();
                let sum: f64 = weights.iter().sum();
                assert!((sum - 1.0).abs() < 1e-14, "{kernel:?} at {fraction}: {sum}");
                assert!(weights.iter().all(|w| *w >= 0.0), "{kernel:?} has a negative weight");
            }
        }
    }

    #[test]
    fn kernels_are_symmetric() {
        for kernel in KERNELS {
            for step in 1..100 {
                // Off the texel grid, where the box kernel jumps.
                let t = f64::from(step) * 0.0731;
                let (right, left) = (profile(kernel, t), profile(kernel, -t));
                assert!((right + left - 1.0).abs() < 1e-12, "{kernel:?} at {t}: {right} + {left}");
            }
        }
    }

    #[test]
    fn edge_responses_are_as_steep_as_published() {
        // Largest slope a texel: bilinear 1, tent 1/n, cubic 3/4 (the quadratic B-spline's peak), Castano 1/2, 1/3, 4/13.
        for (kernel, slope) in [
            (Separable::Tent { side: 1 }, 1.0),
            (Separable::Tent { side: 4 }, 0.25),
            (Separable::Cubic, 0.75),
            (Separable::Castano { side: 3 }, 0.5),
            (Separable::Castano { side: 5 }, 1.0 / 3.0),
            (Separable::Castano { side: 7 }, 4.0 / 13.0),
        ] {
            let h = 1e-3;
            let steepest = (-5000..5000)
                .map(|k| f64::from(k) * h)
                .map(|t| (profile(kernel, t) - profile(kernel, t + h)) / h)
                .fold(0.0, f64::max);
            // A difference quotient is off by h² times a sixth of the curvature, 2 at most.
            assert!((steepest - slope).abs() < 1e-6, "{kernel:?}: {steepest}");
        }
    }

    #[test]
    fn castano_kernels_at_a_texel_centre_are_the_published_integers() {
        for (side, integers) in
            [(3, vec![1, 2, 1]), (5, vec![1, 3, 4, 3, 1]), (7, vec![1, 5, 12, 16, 12, 5, 1])]
        {
            let sum: i32 = integers.iter().sum();
            for (i, value) in integers.iter().enumerate() {
                let weight = Separable::Castano { side }.weight(i as u32, 0.0);
                assert_eq!(weight, f64::from(*value) / f64::from(sum), "side {side}, texel {i}");
            }
        }
    }

    #[test]
    fn the_cubic_kernel_approximates_and_its_second_derivative_has_no_jump() {
        // A single texel never reaches 1: (2/3)^2.
        let centre = Separable::Cubic.weight(1, 0.0);
        assert!((centre - 2.0 / 3.0).abs() < 1e-15, "weight {centre} at a texel's centre");
        // The profile's slope is the quadratic B-spline, whose own slope changes by at most 2 a texel, and never jumps.
        let h = 1e-3;
        let at = |k: i32| profile(Separable::Cubic, f64::from(k) * h);
        let second = |k: i32| (at(k + 1) - 2.0 * at(k) + at(k - 1)) / (h * h);
        for k in -2500..2500 {
            let jump = (second(k + 1) - second(k)).abs();
            assert!(jump <= 2.1 * h, "a jump of {jump} at {}", f64::from(k) * h);
        }
    }

    #[test]
    fn stratified_points_cover_the_disc_evenly_outermost_first() {
        for side in [2, 4, 8] {
            let points = stratified_disc(side);
            let radii: Vec<f32> = points.iter().map(|p| p[0].hypot(p[1])).collect();
            assert_eq!(points.len(), (side * side) as usize, "number of points");
            assert!(radii.windows(2).all(|r| r[0] >= r[1]) && radii[0] <= 1.0, "{radii:?}");
            // A ring of cells holds `side` points: the k-th from outside lies within the ring's area.
            for (i, r) in radii.iter().enumerate() {
                let ring = side - 1 - i as u32 / side;
                let share = |k: u32| (f64::from(k) / f64::from(side)).sqrt() as f32;
                assert!((share(ring)..=share(ring + 1) + 1e-6).contains(r), "point {i} at {r}");
            }
        }
    }

    #[test]
    fn poisson_points_keep_apart_and_stay_in_the_disc() {
        for count in [1, 12, 32, 64] {
            let points = poisson_disc(count);
            assert_eq!(points.len(), count as usize, "number of points");
            let mut least = f32::INFINITY;
            for (i, p) in points.iter().enumerate() {
                assert!(p[0].hypot(p[1]) <= 1.0, "{p:?} lies outside the disc");
                for q in &points[..i] {
                    least = least.min((p[0] - q[0]).hypot(p[1] - q[1]));
                }
            }
            // A hexagonal packing would reach sqrt(2 pi / (sqrt(3) n)); independent points come within
            // about 1/n. Half of the packing's distance separates the two for all counts here.
            let packing = (std::f32::consts::TAU / (3f32.sqrt() * count as f32)).sqrt();
            assert!(least > 0.5 * packing, "{count} points come within {least} of {packing}");
        }
    }
}

//! Where the view's depth range is cut into slices.

use antumbra_gpu::GpuError;
use serde::{Deserialize, Serialize};

/// How the depth range of the view is cut.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "by", rename_all = "kebab-case", deny_unknown_fields)]
pub enum Splits {
    /// Ends in one ratio (Lloyd et al. 2006), so that all slices have the same perspective error: the least that a
    /// number of slices can have. Spends slices on the first metres before the eye, where there often is nothing.
    Logarithmic,
    /// Between logarithmic and even splits (Zhang et al. 2006).
    Practical {
        /// Share of the logarithmic ones, 0 to 1, published 0.5.
        weight: f64,
    },
    /// Logarithmic from a depth beyond the near plane (Lloyd 2007); the first slice goes on to the near plane.
    PseudoNear {
        /// Depth from which on the splits are ideal, metres, > 0; the near plane's where it is nearer than that.
        near: f64,
    },
}

impl Default for Splits {
    fn default() -> Self {
        Self::Practical { weight: 0.5 }
    }
}

impl Splits {
    /// The ends of `count` slices from `near` to `far` (0 < near < far), `near` and `far` among them, ascending.
    #[must_use]
    pub fn ends(&self, near: f64, far: f64, count: u32) -> Vec<f64> {
        let share = |i: u32| f64::from(i) / f64::from(count);
        let logarithmic = |from: f64, i: u32| from * ((far / from).ln() * share(i)).exp();
        let end = |i: u32| match *self {
            _ if i == 0 => near,
            _ if i == count => far,
            Self::Logarithmic => logarithmic(near, i),
            // With the uniform term that the published formula means: near + share (far - near).
            Self::Practical { weight } => {
                weight * logarithmic(near, i) + (1.0 - weight) * (near + share(i) * (far - near))
            }
            Self::PseudoNear { near: pseudo } => logarithmic(pseudo.clamp(near, far), i),
        };
        (0..=count).map(end).collect()
    }

    pub(crate) fn validate(&self) -> Result<(), GpuError> {
        let (what, value, valid, fix) = match *self {
            Self::Logarithmic => return Ok(()),
            Self::Practical { weight } => {
                ("weight of the splits", weight, (0.0..=1.0).contains(&weight), "use 0 to 1")
            }
            Self::PseudoNear { near } => {
                let valid = near > 0.0 && near.is_finite();
                ("pseudo near plane", near, valid, "use a distance in metres, greater than 0")
            }
        };
        if valid { Ok(()) } else { Err(GpuError::Invalid { what, value: value.to_string(), fix }) }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn all() -> [Splits; 5] {
        [
            Splits::Logarithmic,
            Splits::Practical { weight: 0.0 },
            Splits::Practical { weight: 0.5 },
            Splits::Practical { weight: 1.0 },
            Splits::PseudoNear { near: 3.0 },
        ]
    }

    #[test]
    fn four_slices_from_1_to_100_end_where_published_formulas_say() {
        for (splits, expected) in [
            (Splits::Logarithmic, [1.0, 3.16228, 10.0, 31.6228, 100.0]),
            (Splits::default(), [1.0, 14.4561, 30.25, 53.4364, 100.0]),
            (Splits::Practical { weight: 0.0 }, [1.0, 25.75, 50.5, 75.25, 100.0]),
            (Splits::Practical { weight: 1.0 }, [1.0, 3.16228, 10.0, 31.6228, 100.0]),
            (Splits::PseudoNear { near: 1.0 }, [1.0, 3.16228, 10.0, 31.6228, 100.0]),
        ] {
            let ends = splits.ends(1.0, 100.0, 4);
            for (end, expected) in ends.iter().zip(expected) {
                assert!((end / expected - 1.0).abs() < 5e-6, "{splits:?}: {ends:?}");
            }
        }
    }

    #[test]
    fn a_pseudo_near_plane_keeps_one_ratio_beyond_the_first_slice() {
        let ends = Splits::PseudoNear { near: 5.0 }.ends(0.1, 1000.0, 5);
        let ratio = 200_f64.powf(0.2);
        assert_eq!(ends[0], 0.1, "the near plane");
        for pair in ends[1..].windows(2) {
            assert!((pair[1] / pair[0] - ratio).abs() < 1e-12 * ratio, "{ends:?}");
        }
        // Out of range, the near plane and the far one stand for it.
        let low = Splits::PseudoNear { near: 0.01 }.ends(0.1, 1000.0, 5);
        assert_eq!(low, Splits::Logarithmic.ends(0.1, 1000.0, 5), "nearer than near");
        let beyond = Splits::PseudoNear { near: 1e9 }.ends(0.1, 1000.0, 3);
        assert_eq!(beyond, [0.1, 1000.0, 1000.0, 1000.0], "slices of no depth, but in order");
    }

    proptest! {
        #[test]
        fn ends_ascend_from_near_to_far(
            near in 1e-3..1e3f64, ratio in 1.0..1e6f64, count in 1..9u32, which in 0..5usize,
        ) {
            let far = near * ratio;
            let ends = all()[which].ends(near, far, count);
            prop_assert_eq!((ends[0], ends[count as usize]), (near, far));
            // Each is off by a few roundings.
            prop_assert!(ends.windows(2).all(|p| p[1] >= p[0] * (1.0 - 1e-14)), "{:?}", ends);
        }

        #[test]
        fn logarithmic_ends_are_in_one_ratio(near in 1e-3..1e3f64, ratio in 1.0..1e6f64, count in 1..9u32) {
            let ends = Splits::Logarithmic.ends(near, near * ratio, count);
            let each = ratio.powf(1.0 / f64::from(count));
            for pair in ends.windows(2) {
                prop_assert!((pair[1] / pair[0] / each - 1.0).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn settings_out_of_range_are_refused() {
        for splits in [
            Splits::Practical { weight: 1.5 },
            Splits::Practical { weight: f64::NAN },
            Splits::PseudoNear { near: 0.0 },
            Splits::PseudoNear { near: f64::INFINITY },
        ] {
            assert!(splits.validate().is_err(), "{splits:?}");
        }
        assert!(all().iter().all(|s| s.validate().is_ok()), "these are in range");
    }
}

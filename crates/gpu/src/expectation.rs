//! What theory says of a technique on a hard case.

/// What theory says of a technique on a hard case, whose number is 0 where the technique is right.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Expectation {
    /// The technique copes.
    Holds {
        /// Largest number that the case may give.
        bound: f64,
    },
    /// The technique fails, and by how much is known. To do better is as unexpected as to do worse: then
    /// the expectation, or the measurement, is wrong.
    KnownLimit {
        /// Smallest number that the case may give.
        at_least: f64,
        /// Largest number that the case may give.
        at_most: f64,
        /// Why, in one sentence.
        because: &'static str,
    },
    /// The technique does not serve such a scene, and answers with an error.
    Refuses {
        /// Why, in one sentence.
        because: &'static str,
    },
}

impl Expectation {
    /// Whether `measured` is as expected; NaN never is.
    #[must_use]
    pub fn is_met_by(&self, measured: f64) -> bool {
        match *self {
            Self::Holds { bound } => measured <= bound,
            Self::KnownLimit { at_least, at_most, .. } => (at_least..=at_most).contains(&measured),
            Self::Refuses { .. } => false,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn more_than_the_bound_less_than_the_limit_and_nan_are_not_as_expected() {
        let holds = Expectation::Holds { bound: 1.0 };
        assert!(holds.is_met_by(0.0) && holds.is_met_by(1.0), "within the bound");
        assert!(!holds.is_met_by(1.1) && !holds.is_met_by(f64::NAN), "an unexpected failure");
        let limit = Expectation::KnownLimit { at_least: 0.5, at_most: 0.7, because: "a test" };
        assert!(limit.is_met_by(0.5) && limit.is_met_by(0.7), "within the limits");
        assert!(!limit.is_met_by(0.4), "an unexpected success");
        assert!(!limit.is_met_by(0.8) && !limit.is_met_by(f64::NAN), "an unexpected failure");
        let refuses = Expectation::Refuses { because: "a test" };
        assert!(!refuses.is_met_by(0.0), "an answer where an error is expected");
    }
}

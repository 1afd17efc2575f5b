//! What keeps an estimate from being what its term is called.

use std::fmt;

use crate::terms;
use crate::terms::term::Class;

/// Standard deviations below zero from which a sign counts.
const CERTAIN: f64 = 2.0;

/// What keeps an estimate from being what its term is called.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Note {
    /// A coefficient of load is negative, and no joint gives against its load: the term has
    /// absorbed something else, whatever it did to the residual.
    UnphysicalSign,
}

impl fmt::Display for Note {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::UnphysicalSign => {
                "unphysical sign: stands for something else, not for a compliance"
            }
        })
    }
}

impl Note {
    /// What must be noted of an estimate of a term.
    #[must_use]
    pub fn of(term: &str, value: f64, sd: Option<f64>) -> Option<Self> {
        let load = terms::find(term).is_ok_and(|t| t.info().class == Class::Load);
        let below = |sd: f64| sd > 0.0 && value < -CERTAIN * sd;
        (load && sd.is_some_and(below)).then_some(Self::UnphysicalSign)
    }

    /// The note as a sentence about one estimate, `value ± sd unit` of `name`.
    #[must_use]
    pub fn sentence(self, name: &str, value: f64, sd: f64, unit: &str) -> String {
        match self {
            Self::UnphysicalSign => format!(
                "{name}: the coefficient is negative, {value:.1e} ± {sd:.0e} {unit}; a joint \
                 cannot give against its load, so it stands for something else here and is no \
                 stiffness"
            ),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_a_load_that_is_surely_negative_is_noted() {
        let found = Note::of("sag", -3.0, Some(1.0));
        assert_eq!(found, Some(Note::UnphysicalSign));
        for (term, value, sd) in [
            ("sag", -1.0, Some(1.0)),
            ("sag", 3.0, Some(1.0)),
            ("sag", -3.0, None),
            ("offset", -3.0, Some(1.0)),
        ] {
            assert_eq!(Note::of(term, value, sd), None);
        }
    }
}

//! What keeps an estimate from being what its term is called.

use std::fmt;

use crate::estimate::directions::ParameterReport;
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

#[cfg(feature = "serde")]
impl serde::Serialize for Note {
    fn serialize<S: serde::Serializer>(&self, s: S) -> Result<S::Ok, S::Error> {
        s.collect_str(self)
    }
}

impl ParameterReport {
    /// The same parameter with what must be noted of it.
    #[must_use]
    pub fn noted(mut self) -> Self {
        let load = terms::find(&self.term).is_ok_and(|t| t.info().class == Class::Load);
        let below = |sd: f64| sd > 0.0 && self.value < -CERTAIN * sd;
        self.note = (load && self.sd.is_some_and(below)).then_some(Note::UnphysicalSign);
        self
    }

    /// The note as a sentence about this parameter, for a list of warnings.
    #[must_use]
    pub fn remark(&self) -> Option<String> {
        let Self { term, target, value, unit, .. } = self;
        let sd = self.sd?;
        self.note.map(|note| match note {
            Note::UnphysicalSign => format!(
                "{term} {target}: the coefficient is negative, {value:.1e} ± {sd:.0e} {unit}; a \
                 joint cannot give against its load, so it stands for something else here and is \
                 no stiffness"
            ),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parameter(term: &str, value: f64, sd: Option<f64>) -> ParameterReport {
        ParameterReport {
            term: term.into(),
            target: "arm1".into(),
            place: None,
            name: "c".into(),
            value,
            sd,
            unit: "rad".into(),
            note: None,
        }
    }

    #[test]
    fn only_a_load_that_is_surely_negative_is_noted() {
        let noted = |term, value, sd| parameter(term, value, sd).noted();
        let found = noted("sag", -3.0, Some(1.0));
        assert_eq!(found.note, Some(Note::UnphysicalSign));
        assert!(found.remark().is_some_and(|text| text.starts_with("sag arm1: the coefficient")));
        for sound in [
            noted("sag", -1.0, Some(1.0)),
            noted("sag", 3.0, Some(1.0)),
            noted("sag", -3.0, None),
            noted("offset", -3.0, Some(1.0)),
        ] {
            assert_eq!((sound.note, sound.remark()), (None, None));
        }
    }
}

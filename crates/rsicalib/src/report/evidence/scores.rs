//! Scores of all candidates, for bars.

use crate::diagnosis::score::scored::Scored;
use crate::estimate::Observations;
use crate::estimate::directions::place;
use crate::model::Instance;
use crate::report::document::Name;
use crate::report::evidence::shapes::Score;

/// Name of a term at its target, as results have it.
pub fn name(observations: &Observations, instance: &Instance) -> Name {
    let info = instance.term.info();
    Name {
        term: info.id.into(),
        class: info.class,
        target: instance.target.name(&observations.mechanism),
        place: place(observations, instance),
        label: instance.target.label(&observations.mechanism),
    }
}

/// Scores of a search, as results have them.
pub fn scores(small: &Observations, scored: &[Scored], chosen: &[Instance]) -> Vec<Score> {
    let score = |s: &Scored| Score {
        effect: name(small, &s.instance),
        score: s.score,
        charged: s.charged(),
        dof: s.width,
        p_value: s.corrected.min(1.0),
        chosen: chosen.contains(&s.instance),
    };
    scored.iter().map(score).collect()
}

//! Scores of all candidates, for bars.

use crate::diagnosis::score::scored::Scored;
use crate::estimate::Observations;
use crate::model::Instance;
use crate::report::evidence::shapes::Score;
use crate::report::trace_report::Place;

/// Scores of a search, as results have them.
pub fn scores(small: &Observations, scored: &[Scored], chosen: &[Instance]) -> Vec<Score> {
    let score = |s: &Scored| Score {
        effect: Place::of(small, &s.instance),
        score: s.score,
        charged: s.charged(),
        dof: s.width,
        p_value: s.corrected.min(1.0),
        chosen: chosen.contains(&s.instance),
    };
    scored.iter().map(score).collect()
}

//! Scores of all candidates, for bars.

use crate::Error;
use crate::diagnosis::options::SearchOptions;
use crate::diagnosis::score::scan::scan;
use crate::diagnosis::trace::Traced;
use crate::estimate::directions::place;
use crate::estimate::{Fit, Observations};
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
    }
}

/// Scores of everything that a fit lacks, best first; of each term at each target its best place.
///
/// # Errors
///
/// As [`scan`].
pub fn scores(
    traced: &Traced,
    search: &SearchOptions,
    fit: &Fit,
    chosen: &[Instance],
) -> Result<Vec<Score>, Error> {
    let mut scored = scan(&traced.small, fit, &traced.judge, &search.without)?;
    scored.sort_by(|a, b| b.charged().total_cmp(&a.charged()));
    let mut seen = std::collections::HashSet::new();
    scored.retain(|s| seen.insert((s.instance.term.info().id, s.instance.target)));
    let score = |s: &crate::diagnosis::score::scored::Scored| Score {
        effect: name(&traced.small, &s.instance),
        score: s.score,
        charged: s.charged(),
        dof: s.width,
        p_value: s.corrected.min(1.0),
        chosen: chosen.contains(&s.instance),
    };
    Ok(scored.iter().map(score).collect())
}

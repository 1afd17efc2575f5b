//! Closes the loop: from the residual to the effect that the model lacks.
//!
//! ```text
//! fit → score every candidate → refit the best → keep it → again
//! ```
//!
//! until nothing scores; after each addition a look back, at what is no longer
//! needed, and in the end at what another effect, or two others, explain better.
//! Samples of a held pose are averaged for the search, whose noise is then known;
//! the answer is fitted to all of them.

use crate::Error;
use crate::diagnosis::isolation::Alone;
use crate::diagnosis::score::places;
use crate::diagnosis::score::scored::{self, Judge, Scored, whole_pose};
use crate::diagnosis::stepwise::search::{Pursued, Step, pursue_all};
use crate::diagnosis::stepwise::state::Hunt;
use crate::estimate::{Fit, Session, fit};
use crate::model::Instance;
use crate::screening::converter;
use crate::screening::excluded::Excluded;
use crate::screening::sound::sound;

pub use crate::diagnosis::options::{LEFT, Search};
pub use crate::diagnosis::stepwise::state::cost;

/// One effect that was found.
#[derive(Debug, Clone)]
pub struct Found {
    /// The effect.
    pub instance: Instance,
    /// Probability of its score by chance, corrected for the places looked at.
    pub p_value: f64,
    /// What fits as well.
    pub also: Vec<Instance>,
    /// The search's fit without it.
    pub without: Fit,
}

/// What the search found.
#[derive(Debug, Clone)]
pub struct Traced {
    /// The fit of all samples, as asked for.
    pub before: Fit,
    /// The fit of all samples with what was found.
    pub after: Fit,
    /// The session, bad samples left out.
    pub session: Session,
    /// The search's own session: one sample for each held pose.
    pub small: Session,
    /// The last fit of the search.
    pub last: Fit,
    /// Effects, in the order in which they were found.
    pub found: Vec<Found>,
    /// Readings that are wrong.
    pub excluded: Vec<Excluded>,
    /// The best that is left, whether or not it is above chance.
    pub left: Option<Scored>,
    /// What is at fault alone, where the catalogue does not explain it all.
    pub alone: Option<Alone>,
    /// How scores were judged.
    pub judge: Judge,
}

/// Traces the residual of a session.
///
/// # Errors
///
/// As [`fit`].
pub fn trace(session: &Session, search: &Search) -> Result<Traced, Error> {
    let mut session = session.clone();
    let base = session.instances()?;
    let before = fit(&session, base.clone(), None)?;
    let (clean, mut excluded) = sound(&mut session, &before)?;
    let mut hunt = Hunt::new(&session, &clean, search)?;
    let mut start = fit(&hunt.small, base, Some(&clean))?;
    hunt.rescale(&mut start)?;
    let (pursued, alone) = pursue_all(&mut hunt, &start)?;
    let Pursued { current, found, poses, wrong, left, .. } = pursued;
    excluded.extend(poses.iter().map(|step| hunt.excluded(step)));
    excluded.extend(wrong.into_iter().map(|(scored, blame)| match whole_pose(&scored.instance) {
        Some(_) => hunt.excluded(&scored),
        None => hunt.bad_reading(&scored.instance, blame),
    }));
    let mut steps = Vec::new();
    for Step { scored: Scored { instance, corrected, .. }, also, blame, without } in found {
        if scored::is_data(&instance) {
            excluded.push(hunt.bad_reading(&instance, blame));
        } else {
            steps.push(Found { instance, p_value: corrected, also, without });
        }
    }
    for pose in excluded.iter().filter(|e| e.row.is_none() && e.channel.is_none()) {
        for row in
            pose.pose.map(|p| session.readings.rows_of_poses()[p].clone()).unwrap_or_default()
        {
            session.weights[row] = 0.0;
        }
    }
    let after = if current.model.instances.len() == clean.model.instances.len()
        && excluded.is_empty()
    {
        clean.clone()
    } else {
        let from = expand(&clean, &current);
        converter::seen_by(&before, fit(&session, current.model.instances.clone(), Some(&from))?)
    };
    let judge = hunt.judge(&current);
    let small = hunt.small;
    let found = steps;
    Ok(Traced { before, after, session, small, last: current, found, excluded, left, alone, judge })
}

/// True where some reading scores as bad, were the model right.
///
/// # Errors
///
/// As [`fit`].
pub fn looks_bad(session: &Session, full: &Fit) -> Result<bool, Error> {
    let search = Search::default();
    let mut hunt = Hunt::new(session, full, &search)?;
    let mut small = fit(&hunt.small, full.model.instances.clone(), Some(full))?;
    hunt.rescale(&mut small)?;
    let scored = places::bad_readings(&hunt.small, &small, &hunt.judge(&small))?;
    Ok(scored.iter().any(|s| s.corrected <= search.alpha))
}

/// A fit to start from: the parameters of the search, the noise of all samples.
fn expand(clean: &Fit, current: &Fit) -> Fit {
    Fit { noise: clean.noise.clone(), ..current.clone() }
}

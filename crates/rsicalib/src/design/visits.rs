//! When the poses of a plan are visited, and from where: rows of a pose change on the way where
//! explanations differ in what time or the direction of approach does.

use crate::Error;
use crate::design::candidates::Candidates;
use crate::design::choice::{Choice, least};
use crate::design::contest::{Contest, logarithm};
use crate::design::linearised::{Linearised, Whitened};
use crate::design::purpose::Purpose;
use crate::design::rivals::{Side, of_each, select, tells};
use crate::estimate::Observations;
use crate::model::Instance;
use crate::terms::term::{Needs, Placed};

/// A pause, as a share of the session.
pub(crate) const PAUSE: f64 = 0.5;

/// A pause must make (96) smaller by this factor, against the best pose without it.
const WORTH: f64 = 0.7;

/// Pauses in a plan at the most.
const PAUSES: usize = 2;

/// One visit of a plan.
pub(crate) struct Step {
    pub(crate) candidate: usize,
    pub(crate) wait: f64,
    pub(crate) purpose: Purpose,
}

/// When poses are visited.
pub(crate) struct Visits<'a> {
    session: &'a Observations,
    /// Rows change on the way.
    pub(crate) dynamic: bool,
    /// Explanations differ in what time does.
    pub(crate) timed: bool,
    /// Time from pose to pose, in sessions.
    pace: f64,
}

impl<'a> Visits<'a> {
    /// After a session whose explanations differ in `own`.
    pub(crate) fn new(session: &'a Observations, own: &[Instance]) -> Self {
        let of_way =
            |i: &Instance| i.term.needs().iter().any(|n| *n != Needs::Motion && n.of_way());
        let passes =
            |i: &Instance| i.term.info().needs == Needs::Order && i.term.placed() == Placed::Once;
        let timed = own.iter().any(passes) && session.readings.timed;
        Self {
            session,
            dynamic: timed || own.iter().any(of_way),
            timed,
            pace: 1.0 / (session.readings.poses().max(2) - 1) as f64,
        }
    }

    /// Rows of all candidates as the visit of number `step`, after pauses of so many sessions.
    pub(crate) fn rows(
        &self,
        at: &Linearised<'_>,
        found: &Candidates,
        step: usize,
        waited: f64,
        from: &[f64],
    ) -> Result<Whitened, Error> {
        let mut readings = at.readings(&found.table)?;
        let time = 1.0 + (step + 1) as f64 * self.pace + waited;
        readings.set_times(&vec![time; found.len()], self.session.readings.poses());
        readings.set_approach(from);
        at.rows(&readings)
    }

    /// Rows of the visits of a plan, in their order.
    pub(crate) fn visited(
        &self,
        at: &Linearised<'_>,
        planned: &Candidates,
        steps: &[Step],
    ) -> Result<Whitened, Error> {
        let mut readings = at.readings(&planned.table)?;
        let mut waited = 0.0;
        let mut times = Vec::with_capacity(steps.len());
        for (k, step) in steps.iter().enumerate() {
            waited += step.wait;
            times.push(1.0 + (k + 1) as f64 * self.pace + waited);
        }
        readings.set_times(&times, self.session.readings.poses());
        at.rows(&readings)
    }
}

/// Pose by pose where time or the direction of approach matters: the rows change on the way.
pub(crate) struct Turns<'a> {
    pub(crate) at: &'a Linearised<'a>,
    pub(crate) sides: &'a [&'a Side<'a>],
    /// Numbers of the rivals of `sides`.
    pub(crate) kept: &'a [usize],
    pub(crate) found: &'a Candidates,
    pub(crate) visits: &'a Visits<'a>,
}

impl Turns<'_> {
    pub(crate) fn decide(
        &self,
        contest: &mut Contest,
        first: Whitened,
        choice: &Choice,
    ) -> Result<Vec<Step>, Error> {
        let Self { at, sides, kept, found, visits } = self;
        let mut steps: Vec<Step> = Vec::new();
        let mut taken: Vec<usize> = Vec::new();
        let (mut waited, mut pauses) = (0.0, 0);
        let mut first = Some(first);
        for step in 0..choice.poses.min(found.len()) {
            let from = taken.last().map_or(&choice.from[..], |&k| found.row(k));
            let now = match first.take() {
                Some(rows) => rows,
                None => visits.rows(at, found, step, waited, from)?,
            };
            let best_of = |rows: &[Whitened]| {
                least(found.len(), &taken, |k| {
                    let way = choice.way * found.distance(from, found.row(k));
                    logarithm(contest.criterion_with(&of_each(rows, k))) + way
                })
            };
            let rows = select(&now, sides);
            let (score, best) = best_of(&rows);
            let mut next = (0.0, best, rows);
            if visits.timed && pauses < PAUSES {
                let later = visits.rows(at, found, step, waited + PAUSE, from)?;
                let later = select(&later, sides);
                let (after, other) = best_of(&later);
                if after < score + f64::ln(WORTH) {
                    next = (PAUSE, other, later);
                }
            }
            let (wait, candidate, rows) = next;
            waited += wait;
            pauses += usize::from(wait > 0.0);
            let own = of_each(&rows, candidate);
            let gains = contest.gains(&own);
            contest.visit(&own);
            taken.push(candidate);
            steps.push(Step { candidate, wait, purpose: tells(&gains, kept, contest) });
        }
        Ok(steps)
    }
}

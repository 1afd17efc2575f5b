//! Poses to visit after a session: those that decide between its explanations, or those that make
//! the platform more certain.

use faer::Mat;

use crate::Error;
use crate::apply::change::PlatformRms;
use crate::design::candidates::{Candidates, Space, Within, check_counts, workspace};
use crate::design::choice::{Choice, refined};
use crate::design::contest::{Contest, Field};
use crate::design::criterion::Criterion;
use crate::design::forecast::decides;
use crate::design::hidden::{WorstHidden, with_priors, worst_hidden};
use crate::design::linearised::{Linearised, Whitened};
use crate::design::moments::{Moments, moments, moments_of_absent};
use crate::design::precision::{Known, Precision};
use crate::design::purpose::{Purpose, poses_to_decide, worth};
pub use crate::design::rivals::Explained;
use crate::design::rivals::{Side, contest_of, merge, most_telling, of_each, select, tells};
use crate::design::visits::{PAUSE, Step, Turns, Visits};
use crate::diagnosis::averaged::Averaged;
use crate::diagnosis::options::SearchOptions;
use crate::diagnosis::score::candidates::absent;
use crate::estimate::{Fit, Observations, fit, with_conventions};
use crate::model::{Instance, parse};
use crate::numerics::random::Random;
use crate::numerics::symmetric::{Unseen, invert};
use crate::readings::Table;

/// How poses are chosen.
#[derive(Debug, Clone, PartialEq)]
pub struct FurtherOptions {
    /// Number of poses to visit.
    pub poses: usize,
    /// What is made small; where not given, what is open is decided, or else the platform made
    /// certain.
    pub criterion: Option<Criterion>,
    /// Box of the candidates; the mechanism's own workspace by default, else its joint limits.
    pub within: Option<Within>,
    /// Number of candidates that are drawn; those out of reach are left out.
    pub candidates: usize,
    /// Readings of poses that are struck off, row by row.
    pub off: Vec<f64>,
    /// Readings of the pose in which the mechanism stands; the last of the session by default.
    pub from: Option<Vec<f64>>,
    /// Weight of the way to the next pose, in units of `ln` of what is made small, for a way
    /// through all that the channels go through.
    pub way: f64,
    /// Same seed, same plan.
    pub seed: u64,
}

impl Default for FurtherOptions {
    fn default() -> Self {
        Self {
            poses: 12,
            criterion: None,
            within: None,
            candidates: 2000,
            off: Vec::new(),
            from: None,
            way: 0.0,
            seed: 0,
        }
    }
}

/// What is to be expected of a plan.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Forecast {
    /// Probability that the explanation that is right is decided for; none where nothing is open.
    pub decides: Option<f64>,
    /// The least `λ` of two explanations.
    pub least_lambda: Option<f64>,
    /// Standard deviation of the platform, of the carried point without one, over the workspace by
    /// the parameters, root mean square of components, before and after. What no pose could show is
    /// held; not a number where these poses do not show something that others would.
    pub platform_sd: [PlatformRms; 2],
    /// The worst effect that could be there unseen, before and after.
    pub worst_hidden: [Option<WorstHidden>; 2],
}

/// Poses to visit after a session.
#[derive(Debug, Clone, PartialEq)]
pub struct Further {
    /// What was made small.
    pub criterion: Criterion,
    /// Platform poses, in the order of the visits; empty without a platform.
    pub poses: Vec<[f64; 6]>,
    /// Readings to expect, and the keys of unknown points.
    pub table: Table,
    /// Pause before each pose, as a share of the session.
    pub waits: Vec<f64>,
    /// What each pose is visited for.
    pub purposes: Vec<Purpose>,
    /// Of each pose, whether it is worth a visit.
    pub worth: Vec<bool>,
    /// How many poses like those that are worth a visit would be a decision; none where nothing is told apart.
    pub needed: Option<f64>,
    /// Explanations that no pose tells from another one: pairs of numbers.
    pub merged: Vec<[usize; 2]>,
    /// `λ_ab` of the plan, rival by rival of those that are not merged; with their numbers.
    pub lambda: (Vec<usize>, Vec<f64>),
    /// What is to be expected.
    pub forecast: Forecast,
    /// Candidates that were within reach.
    pub reached: usize,
}

/// Poses from which the platform is judged.
const JUDGED: usize = 48;

/// Candidates that are looked at again for each pose where time or direction matters.
const AGAIN: usize = 400;

/// Share of a channel's limits that a pose keeps from each end: a hand misses the pose. Effects of a
/// sensor differ most at the ends of what it goes through, so that more costs information.
const FROM_LIMITS: f64 = 0.02;

/// Chooses poses to visit after a session.
///
/// `rivals` are the explanations of the session, the best first; none: its terms explain it.
///
/// # Errors
///
/// [`Error::Option`] for numbers that cannot be used and for a box out of reach, otherwise as
/// [`fit`].
pub fn further(
    observations: &Observations,
    rivals: &[Explained],
    options: &FurtherOptions,
) -> Result<Further, Error> {
    check(observations, options)?;
    let only = [Explained { probability: 1.0, ..Explained::default() }];
    let rivals = if rivals.is_empty() { &only[..] } else { rivals };
    let Fitted { session, fits, all, own } = fit_rivals(observations, rivals)?;
    let at = Linearised::new(&session, &fits[0], &all, &own)?;

    let mut random = Random::new(options.seed);
    let within = workspace(&session.mechanism, options.within).ok();
    let space = Space { at: &at, within, off: &options.off, from_limits: FROM_LIMITS };
    let mut found = space.draw(options.candidates, &mut random)?;
    let reached = found.len();
    let visits = Visits::new(&session, &own);
    let last = || session.readings.row(session.readings.samples - 1).to_vec();
    let choice = Choice {
        poses: options.poses,
        from: options.from.clone().unwrap_or_else(last),
        way: options.way,
        sweeps: 1,
        again: false,
    };
    let rows_of = |found: &Candidates| visits.rows(&at, found, 0, 0.0, &choice.from);
    let judged = found.some(&(0..found.len().min(JUDGED)).collect::<Vec<_>>());

    let old = at.session();
    let mut sides: Vec<Side<'_>> = fits.iter().map(|f| Side::of(&at, f, &old)).collect();
    let mut rows = rows_of(&found)?;
    sides.iter_mut().for_each(|side| side.hold(&rows));
    let mut contest = contest_of(rivals, &sides);
    let later = match visits.timed {
        true => Some(visits.rows(&at, &found, 0, PAUSE, &choice.from)?),
        false => None,
    };
    let (kept, merged) = merge(&mut contest, &sides, &rows, later.as_ref());
    let sides: Vec<&Side<'_>> = kept.iter().map(|&k| &sides[k]).collect();
    // Of belts nothing is carried whose place a plan could make certain.
    let carries = session.mechanism.points.iter().any(|point| point.chain.is_some());
    let criterion = criterion_of(options, kept.len(), carries)?;
    let moments = moments(&at, &old.gram(), &judged)?;
    let best = sides[0];

    let steps = if criterion == Criterion::Decide && visits.dynamic {
        if found.len() > AGAIN {
            let chosen = most_telling(&contest, &select(&rows, &sides), AGAIN);
            found = found.some(&chosen);
            rows = rows_of(&found)?;
        }
        let turns = Turns { at: &at, sides: &sides, kept: &kept, found: &found, visits: &visits };
        turns.decide(&mut contest, rows, &choice)?
    } else {
        let omega = criterion.omega(&at, &found, || Ok(moments.position.clone()))?;
        let omega = omega.map(|m| submatrix(&m, &best.columns));
        let precision = Precision::new(&best.information, omega);
        let choose = |rows: &Whitened, found: &Candidates, _: &[usize]| {
            let rows = select(rows, &sides);
            match criterion {
                Criterion::Decide => choice.of(Field::new(&contest, &rows), found, &[]),
                _ => choice.of(Known { precision: precision.clone(), rows: &rows[0] }, found, &[]),
            }
        };
        let chosen;
        (found, rows, chosen) =
            refined(choose, rows_of, (found, rows), &[Vec::new()], &space, &mut random)?;
        let platform = submatrix(&moments.position, &best.columns);
        let told = Told { criterion, kept: &kept, best, platform: &platform };
        told.steps(&select(&rows, &sides), chosen, &mut contest, precision)
    };

    let chosen: Vec<usize> = steps.iter().map(|s| s.candidate).collect();
    let planned = found.some(&chosen);
    let new = visits.visited(&at, &planned, &steps)?;
    let columns: Vec<&[usize]> = sides.iter().map(|s| &s.columns[..]).collect();
    let forecast = Forecast {
        decides: (kept.len() > 1).then(|| decides(&contest.rivals, &columns, &new)),
        least_lambda: (kept.len() > 1).then(|| contest.least()),
        platform_sd: platform_sd(best, &new, &moments).map(|sd| PlatformRms {
            position: if carries { sd.position } else { f64::NAN },
            orientation: if planned.poses.is_empty() { f64::NAN } else { sd.orientation },
        }),
        worst_hidden: hidden(&session, &fits[kept[0]], &visits, &planned, &steps, &judged)?,
    };
    let m = kept.len();
    let lambda = (0..m * m).map(|ab| contest.lambda(ab / m, ab % m)).collect();
    let purposes: Vec<Purpose> = steps.iter().map(|s| s.purpose.clone()).collect();
    let worth = worth(&purposes);
    let visits = worth.iter().filter(|worth| **worth).count();
    Ok(Further {
        criterion,
        poses: planned.poses.clone(),
        table: planned.table,
        waits: steps.iter().map(|s| s.wait).collect(),
        purposes,
        needed: poses_to_decide(visits, forecast.least_lambda),
        worth,
        merged,
        lambda: (kept, lambda),
        forecast,
        reached,
    })
}

/// The explanations of a session, each with its fit.
struct Fitted {
    /// The session as a search sees it.
    session: Observations,
    fits: Vec<Fit>,
    /// The effects of all explanations, and those that not all share.
    all: Vec<Instance>,
    own: Vec<Instance>,
}

fn fit_rivals(observations: &Observations, rivals: &[Explained]) -> Result<Fitted, Error> {
    let base = observations.instances()?;
    let effects: Vec<Vec<Instance>> = rivals
        .iter()
        .map(|r| parse(&observations.mechanism, &observations.readings, &r.effects))
        .collect::<Result<_, _>>()?;
    let with = |effects: &[Instance]| -> Vec<Instance> {
        let more = effects.iter().filter(|e| !base.contains(e));
        base.iter().chain(more).copied().collect()
    };
    let whole = fit(observations, with(&effects[0]), None)?;
    let mut session = Averaged::new(observations, &whole, &SearchOptions::default())?.small;
    // A search stops where χ² hardly falls: along the valley between two shapes of a curve that is
    // far from the minimum, and λ lives on the difference.
    session.options.lm = observations.options.lm.clone();
    let fits: Vec<Fit> = effects
        .iter()
        .map(|effects| Ok(with_conventions(&session, fit(&session, with(effects), Some(&whole))?)))
        .collect::<Result<_, _>>()?;
    let all: Vec<Instance> = effects.concat();
    let shared = |e: &Instance| effects.iter().all(|of| of.contains(e));
    let own = all.iter().filter(|e| !shared(e)).copied().collect();
    Ok(Fitted { session, fits, all, own })
}

/// What poses are chosen by, of so many explanations that they can tell apart.
fn criterion_of(
    options: &FurtherOptions,
    explanations: usize,
    carries: bool,
) -> Result<Criterion, Error> {
    let criterion = options.criterion.unwrap_or(match explanations {
        1 if carries => Criterion::Platform,
        1 => Criterion::Volume,
        _ => Criterion::Decide,
    });
    if criterion == Criterion::Decide && explanations < 2 {
        let found = "one explanation that poses can tell from others";
        let expected = "a result that leaves something open; else platform";
        return Err(Error::option("criterion", found, expected));
    }
    Ok(criterion)
}

/// What each chosen pose is for.
struct Told<'a> {
    criterion: Criterion,
    /// Numbers of the explanations.
    kept: &'a [usize],
    best: &'a Side<'a>,
    /// How the platform moves with the parameters of the best.
    platform: &'a Mat<f64>,
}

impl Told<'_> {
    fn steps(
        &self,
        rows: &[Whitened],
        chosen: Vec<usize>,
        contest: &mut Contest,
        mut precision: Precision,
    ) -> Vec<Step> {
        let sd = |known: &Mat<f64>| known_sd(known, &self.best.held, self.platform);
        let mut step = |k: usize| {
            let own = of_each(rows, k);
            let gains = contest.gains(&own);
            contest.visit(&own);
            let (known, measure) = (precision.information.clone(), precision.measure());
            precision.visit(own[0]);
            let purpose = match self.criterion {
                Criterion::Decide => tells(&gains, self.kept, contest),
                Criterion::Platform => {
                    Purpose::Platform { before: sd(&known), after: sd(&precision.information) }
                }
                _ => Purpose::Falls { times: (precision.measure() - measure).exp() },
            };
            Step { candidate: k, wait: 0.0, purpose }
        };
        chosen.into_iter().map(&mut step).collect()
    }
}

fn submatrix(m: &Mat<f64>, columns: &[usize]) -> Mat<f64> {
    let n = columns.len();
    Mat::from_fn(n, n, |i, j| m[(columns[i], columns[j])])
}

/// Standard deviation of the platform before and after.
fn platform_sd(side: &Side<'_>, new: &Whitened, moments: &Moments) -> [PlatformRms; 2] {
    let after = &side.information + new.select(&side.columns).gram();
    let of = |information: &Mat<f64>| {
        let rms = |m: &Mat<f64>| known_sd(information, &side.held, &submatrix(m, &side.columns));
        PlatformRms { position: rms(&moments.position), orientation: rms(&moments.orientation) }
    };
    [of(&side.information), of(&after)]
}

/// `√tr Ω C`, what is held left out; not a number where some other direction that matters to `Ω` is
/// not known at all.
fn known_sd(information: &Mat<f64>, held: &Unseen, omega: &Mat<f64>) -> f64 {
    if Unseen::of(information).matters(omega) {
        return f64::NAN;
    }
    let (n, covariance) = (information.nrows(), invert(information).0);
    let all: f64 =
        (0..n * n).map(|ij| covariance[(ij / n, ij % n)] * omega[(ij % n, ij / n)]).sum();
    (all - held.trace(omega)).max(0.0).sqrt()
}

/// The worst hidden effect before and after the plan; none without a platform.
fn hidden(
    session: &Observations,
    best: &Fit,
    visits: &Visits<'_>,
    planned: &Candidates,
    steps: &[Step],
    judged: &Candidates,
) -> Result<[Option<WorstHidden>; 2], Error> {
    if planned.poses.is_empty() {
        return Ok([None, None]);
    }
    let named: Vec<Instance> =
        absent(session, best, &[]).into_iter().filter(|i| !i.term.info().penalised).collect();
    let at = Linearised::new(session, best, &named, &[])?;
    let old = at.session();
    let side = Side::of(&at, best, &old);
    let before = with_priors(&old, &side.priors, &side.columns);
    let after = &before + visits.visited(&at, planned, steps)?.gram();
    let some: Vec<usize> = (0..judged.len()).step_by(2).collect();
    let moments = moments_of_absent(&at, &old.gram(), (best, &named), &judged.some(&some))?;
    let worst = |gram: &Mat<f64>| {
        worst_hidden(&session.mechanism, &at.model, &named, gram, &side.columns, &moments)
    };
    Ok([worst(&before), worst(&after)])
}

fn check(observations: &Observations, options: &FurtherOptions) -> Result<(), Error> {
    let channels = observations.mechanism.channels.len();
    check_counts(&[("poses", options.poses), ("candidates", options.candidates)])?;
    Error::same("off", options.off.len(), options.off.len().next_multiple_of(channels))?;
    options.from.as_ref().map_or(Ok(()), |from| Error::same("from", from.len(), channels))
}

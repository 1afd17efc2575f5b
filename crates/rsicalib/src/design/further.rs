//! Poses to visit after a session: those that decide between its explanations, or those that make
//! the platform more certain.

use faer::Mat;

use crate::Error;
use crate::apply::change::PlatformRms;
use crate::apply::poses::poses_of;
use crate::design::contest::{Contest, DECIDED, Field, Rival};
use crate::design::exchange::Criterion;
use crate::design::forecast::decides;
use crate::design::hidden::{WorstHidden, with_priors, worst_hidden};
use crate::design::linearised::{Linearised, Whitened};
use crate::design::moments::{Moments, PoseSlopes, moments_of, slopes_of};
use crate::design::plan::{Within, workspace};
use crate::design::precision::Precision;
use crate::design::purpose::{Purpose, poses_to_decide, worth};
use crate::design::reachable::{Reachable, around, reachable};
use crate::diagnosis::averaged::Averaged;
use crate::diagnosis::options::SearchOptions;
use crate::diagnosis::score::candidates::absent;
use crate::estimate::{Fit, Observations, fit, with_conventions};
use crate::model::{Instance, Model, Want, Workspace, parse};
use crate::numerics::random::Random;
use crate::numerics::symmetric::{Unseen, invert};
use crate::numerics::workers;
use crate::readings::{Readings, Table};
use crate::terms::term::{Needs, Placed, Role};

/// An explanation of the session.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Explained {
    /// Its effects, as `curvature@a22`, beside the terms of the session.
    pub effects: Vec<String>,
    /// Penalised χ².
    pub chi2: f64,
    /// Probability among the explanations.
    pub probability: f64,
}

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

/// Chosen poses are refined among poses around them, within these shares of the box.
const CLOSER: [f64; 3] = [0.15, 0.05, 0.02];

/// Poses around all chosen ones in a round.
const AROUND: usize = 400;

/// A pause, as a share of the session.
const PAUSE: f64 = 0.5;

/// A pause must make (96) smaller by this factor, against the best pose without it.
const WORTH: f64 = 0.7;

/// Pauses in a plan at the most.
const PAUSES: usize = 2;

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
    let search = SearchOptions::default();
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
    let mut session = Averaged::new(observations, &whole, &search)?.small;
    // A search stops where χ² hardly falls: along the valley between two shapes of a curve that is
    // far from the minimum, and λ lives on the difference.
    session.options.lm = observations.options.lm.clone();
    let fits: Vec<Fit> = effects
        .iter()
        .map(|effects| Ok(with_conventions(&session, fit(&session, with(effects), Some(&whole))?)))
        .collect::<Result<_, _>>()?;
    let all: Vec<Instance> = effects.concat();
    let shared = |e: &Instance| effects.iter().all(|of| of.contains(e));
    let own: Vec<Instance> = all.iter().filter(|e| !shared(e)).copied().collect();
    let at = Linearised::new(&session, &fits[0], &all, &own)?;

    let mut random = Random::new(options.seed);
    let within = workspace(&session.mechanism, options.within).ok();
    let mut found =
        reachable(&at, &session.readings, within, options.candidates, &options.off, &mut random)?;
    let reached = found.len();
    let visits = Visits::new(&session, &own, options);
    let judged = found.some(&(0..found.len().min(JUDGED)).collect::<Vec<_>>());

    let old = at.session();
    let mut sides: Vec<Side<'_>> = fits.iter().map(|f| Side::of(&at, f, &old)).collect();
    let mut rows = visits.rows(&at, &found, 0, 0.0, visits.start())?;
    sides.iter_mut().for_each(|side| side.hold(&rows));
    let mut contest = contest_of(rivals, &sides);
    let later = match visits.timed {
        true => Some(visits.rows(&at, &found, 0, PAUSE, visits.start())?),
        false => None,
    };
    let (kept, merged) = merge(&mut contest, &sides, &rows, later.as_ref());
    let sides: Vec<&Side<'_>> = kept.iter().map(|&k| &sides[k]).collect();
    // Of belts nothing is carried whose place a plan could make certain.
    let carries = session.mechanism.points.iter().any(|point| point.chain.is_some());
    let criterion = options.criterion.unwrap_or(match kept.len() {
        1 if carries => Criterion::Platform,
        1 => Criterion::Volume,
        _ => Criterion::Decide,
    });
    if criterion == Criterion::Decide && kept.len() < 2 {
        let found = "one explanation that poses can tell from others";
        let expected = "a result that leaves something open; else platform";
        return Err(Error::option("criterion", found, expected));
    }
    let moments = moments(&at, &session, &judged)?;
    let best = sides[0];
    let omega = omega_of(criterion, &at, &found, &moments);
    let mut precision =
        Precision::new(&best.information, omega.map(|m| submatrix(&m, &best.columns)));
    let platform = submatrix(&moments.position, &best.columns);

    let mut steps: Vec<Step> = Vec::with_capacity(options.poses);
    if criterion == Criterion::Decide && visits.dynamic {
        if found.len() > AGAIN {
            let chosen = most_telling(&contest, &select(&rows, &sides), AGAIN);
            found = found.some(&chosen);
            rows = visits.rows(&at, &found, 0, 0.0, visits.start())?;
        }
        let turns = Turns { at: &at, sides: &sides, kept: &kept, found: &found, visits: &visits };
        steps = turns.decide(&mut contest, rows, options)?;
    } else if criterion == Criterion::Decide {
        let choose = |rows: &Whitened, found: &Reachable| {
            decide(&contest, &select(rows, &sides), found, &visits, options)
        };
        let chosen;
        (found, rows, chosen) =
            refined(choose, (found, rows), (&at, within), &visits, options, &mut random)?;
        let selected = select(&rows, &sides);
        for k in chosen {
            let gains = contest.gains(&of_each(&selected, k));
            contest.visit(&of_each(&selected, k));
            steps.push(Step { candidate: k, wait: 0.0, purpose: tells(&gains, &kept, &contest) });
        }
    } else {
        let choose = |rows: &Whitened, found: &Reachable| {
            make_certain(&precision, &rows.select(&best.columns), found, &visits, options)
        };
        let chosen;
        (found, rows, chosen) =
            refined(choose, (found, rows), (&at, within), &visits, options, &mut random)?;
        let selected = rows.select(&best.columns);
        let mut known = best.information.clone();
        for k in chosen {
            let sd = |known: &Mat<f64>| known_sd(known, &best.held, &platform);
            let (before, measure) = (sd(&known), precision.measure());
            precision.visit(selected.of(k));
            known += gram_of(selected.of(k), best.columns.len());
            let purpose = match criterion {
                Criterion::Platform => Purpose::Platform { before, after: sd(&known) },
                _ => Purpose::Falls { times: (precision.measure() - measure).exp() },
            };
            steps.push(Step { candidate: k, wait: 0.0, purpose });
            let others = select(&rows, &sides);
            contest.visit(&of_each(&others, k));
        }
    }

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

/// One visit of a plan.
struct Step {
    candidate: usize,
    wait: f64,
    purpose: Purpose,
}

/// An explanation, linear at the common point.
struct Side<'a> {
    fit: &'a Fit,
    columns: Vec<usize>,
    theta: Vec<f64>,
    /// Of the session and of priors.
    information: Mat<f64>,
    /// Of priors.
    priors: Mat<f64>,
    /// What no pose could show.
    held: Unseen,
}

impl<'a> Side<'a> {
    fn of(at: &Linearised<'_>, fit: &'a Fit, old: &Whitened) -> Self {
        let columns = at.columns_of(&fit.model);
        let theta = columns.iter().zip(&fit.beta).map(|(&c, b)| b - at.beta[c]).collect();
        let n = columns.len();
        let mut priors = Mat::zeros(n, n);
        for prior in &fit.priors {
            let slopes = prior.slopes(&fit.beta);
            for &(i, a) in &slopes {
                for &(j, b) in &slopes {
                    priors[(i, j)] += a * b;
                }
            }
        }
        let held = Unseen::of(&Mat::identity(n, n));
        let information = Mat::zeros(n, n);
        let mut side = Self { fit, columns, theta, information, priors, held };
        side.information = side.told(old) + &side.priors;
        side
    }

    /// What rows tell. What noise and play seem to tell of conventions is nothing that more poses could add to;
    /// and the rows of all explanations are those at one point, at which the loops of one may stay open.
    fn told(&self, rows: &Whitened) -> Mat<f64> {
        self.fit.conventions.out_of(rows.select(&self.columns).gram())
    }

    /// Holds what neither the session nor any of these poses tells, such as the place of the whole:
    /// a plan for it would be made of rounding.
    fn hold(&mut self, rows: &Whitened) {
        self.held = Unseen::of(&(&self.information + self.told(rows)));
        self.information += self.held.holds.transpose() * &self.held.holds;
    }
}

fn contest_of(rivals: &[Explained], sides: &[Side<'_>]) -> Contest {
    let one = |(r, s): (&Explained, &Side<'_>)| Rival {
        theta: s.theta.clone(),
        information: s.information.clone(),
        probability: r.probability,
        chi2: r.chi2,
    };
    Contest::new(rivals.iter().zip(sides).map(one).collect())
}

/// Leaves of rivals that no pose tells apart the likelier one, with the probability of both: the
/// numbers of those that are left, and pairs of the merged one and the one that it is merged with.
/// All candidates are visited `now`, and `later` after a pause where time matters.
fn merge(
    contest: &mut Contest,
    sides: &[Side<'_>],
    now: &Whitened,
    later: Option<&Whitened>,
) -> (Vec<usize>, Vec<[usize; 2]>) {
    let mut probed = contest.clone();
    for rows in std::iter::once(now).chain(later) {
        let each: Vec<Whitened> = sides.iter().map(|s| rows.select(&s.columns)).collect();
        for k in 0..rows.len() {
            probed.visit(&of_each(&each, k));
        }
    }
    let mut rivals = contest.rivals.clone();
    let mut kept: Vec<usize> = Vec::new();
    let mut merged = Vec::new();
    for b in 0..sides.len() {
        // One may imitate the other but not the other way round: then the truth can be told. Of those that all
        // candidates together do not decide between, one is left.
        let same = |&a: &usize| probed.lambda(a, b).max(probed.lambda(b, a)) < DECIDED;
        match kept.iter().copied().find(same) {
            Some(a) => {
                rivals[a].probability += rivals[b].probability;
                merged.push([b, a]);
            }
            None => kept.push(b),
        }
    }
    *contest = Contest::new(kept.iter().map(|&k| rivals[k].clone()).collect());
    (kept, merged)
}

fn select(rows: &Whitened, sides: &[&Side<'_>]) -> Vec<Whitened> {
    sides.iter().map(|s| rows.select(&s.columns)).collect()
}

fn of_each(rows: &[Whitened], candidate: usize) -> Vec<&[f64]> {
    rows.iter().map(|r| r.of(candidate)).collect()
}

/// The pair whose `λ` grows most in what (96) weighs.
fn tells(gains: &[f64], kept: &[usize], contest: &Contest) -> Purpose {
    let m = kept.len();
    let weight = |ab: usize| {
        let (a, b) = (ab / m, ab % m);
        let both = contest.rivals[a].probability * contest.rivals[b].probability;
        both.sqrt() * gains[ab] * (-contest.lambda(a, b) / 8.0).exp()
    };
    let pairs = (0..m * m).filter(|ab| ab / m != ab % m);
    let best = pairs.max_by(|x, y| weight(*x).total_cmp(&weight(*y))).unwrap_or_default();
    Purpose::Tells { apart: [kept[best / m], kept[best % m]], gain: gains[best] }
}

/// The candidates with the least (96), each alone.
fn most_telling(contest: &Contest, rows: &[Whitened], count: usize) -> Vec<usize> {
    let field = Field::new(contest, rows);
    let score = |k: usize| field.criterion(contest, k);
    let mut scored: Vec<(f64, usize)> = workers::map(0..field.len(), |k| (score(k), k));
    scored.sort_by(|a, b| a.0.total_cmp(&b.0));
    scored.into_iter().take(count).map(|(_, k)| k).collect()
}

/// The candidate with the least score, of those not taken; ties to the first.
fn least(count: usize, taken: &[usize], score: impl Fn(usize) -> f64 + Sync) -> (f64, usize) {
    let open = (0..count).filter(|k| !taken.contains(k));
    let scored = workers::map(open, |k| (score(k), k)).into_iter();
    let first = |a: (f64, usize), b: (f64, usize)| match b.0.total_cmp(&a.0).then(b.1.cmp(&a.1)) {
        std::cmp::Ordering::Less => b,
        _ => a,
    };
    scored.fold((f64::INFINITY, usize::MAX), first)
}

/// Poses, their rows, and those that are chosen: from all candidates, then from others around the
/// chosen ones, round by round, where that is better.
fn refined(
    choose: impl Fn(&Whitened, &Reachable) -> (Vec<usize>, f64),
    (mut found, mut rows): (Reachable, Whitened),
    (at, within): (&Linearised<'_>, Option<Within>),
    visits: &Visits<'_>,
    options: &FurtherOptions,
    random: &mut Random,
) -> Result<(Reachable, Whitened, Vec<usize>), Error> {
    let (mut chosen, mut score) = choose(&rows, &found);
    for share in CLOSER {
        let best = found.some(&chosen);
        let each = (share, AROUND.div_ceil(chosen.len()));
        let readings = &visits.session.readings;
        let Some(near) = around(at, readings, within, &best, each, &options.off, random)? else {
            break;
        };
        let rows_near = visits.rows(at, &near, 0, 0.0, visits.start())?;
        let (other, better) = choose(&rows_near, &near);
        if better < score {
            (found, rows, chosen, score) = (near, rows_near, other, better);
        }
    }
    Ok((found, rows, chosen))
}

/// Greedy choice with one round of exchange, for (96); in an order of short ways, with `ln` of (96)
/// and the weight of the way.
fn decide(
    contest: &Contest,
    rows: &[Whitened],
    found: &Reachable,
    visits: &Visits<'_>,
    options: &FurtherOptions,
) -> (Vec<usize>, f64) {
    let mut contest = contest.clone();
    let mut field = Field::new(&contest, rows);
    let mut chosen: Vec<usize> = Vec::with_capacity(options.poses);
    for _ in 0..options.poses.min(found.len()) {
        let from = chosen.last().map_or_else(|| visits.start(), |&k| found.row(k).to_vec());
        let (_, best) = least(field.len(), &chosen, |k| {
            let way = options.way * found.distance(&from, found.row(k));
            field.criterion(&contest, k).max(1e-300).ln() + way
        });
        field.update(&contest.visit(&field.rows_of(best)));
        chosen.push(best);
    }
    for place in exchanged(&chosen) {
        let now = chosen[place];
        field.update(&contest.leave(&field.rows_of(now)));
        let others: Vec<usize> = chosen.iter().copied().filter(|&k| k != now).collect();
        let (score, best) = least(field.len(), &others, |k| field.criterion(&contest, k));
        let better = score < field.criterion(&contest, now) * (1.0 - 1e-9);
        chosen[place] = if better { best } else { now };
        field.update(&contest.visit(&field.rows_of(chosen[place])));
    }
    let (order, way) = found.tour(chosen, &visits.start());
    (order, contest.criterion().max(1e-300).ln() + options.way * way)
}

/// Greedy choice with one round of exchange, for a variance; in an order of short ways, with its
/// measure and the weight of the way.
fn make_certain(
    precision: &Precision,
    rows: &Whitened,
    found: &Reachable,
    visits: &Visits<'_>,
    options: &FurtherOptions,
) -> (Vec<usize>, f64) {
    let after = |chosen: &[usize]| {
        let mut precision = precision.clone();
        chosen.iter().for_each(|&k| precision.visit(rows.of(k)));
        precision
    };
    let mut now = precision.clone();
    let mut chosen: Vec<usize> = Vec::with_capacity(options.poses);
    for _ in 0..options.poses.min(found.len()) {
        let from = chosen.last().map_or_else(|| visits.start(), |&k| found.row(k).to_vec());
        let (_, best) = least(rows.len(), &chosen, |k| {
            now.measure_with(rows.of(k)) + options.way * found.distance(&from, found.row(k))
        });
        now.visit(rows.of(best));
        chosen.push(best);
    }
    for place in exchanged(&chosen) {
        let own = chosen[place];
        let others: Vec<usize> = chosen.iter().copied().filter(|&k| k != own).collect();
        let rest = after(&others);
        let (score, best) = least(rows.len(), &others, |k| rest.measure_with(rows.of(k)));
        if score < rest.measure_with(rows.of(own)) - 1e-9 {
            chosen[place] = best;
        }
    }
    let measure = after(&chosen).measure();
    let (order, way) = found.tour(chosen, &visits.start());
    (order, measure + options.way * way)
}

/// Places of an exchange: a single pose was chosen from all, with its way.
fn exchanged(chosen: &[usize]) -> std::ops::Range<usize> {
    if chosen.len() > 1 { 0..chosen.len() } else { 0..0 }
}

/// Pose by pose where time or the direction of approach matters: the rows change on the way.
struct Turns<'a> {
    at: &'a Linearised<'a>,
    sides: &'a [&'a Side<'a>],
    /// Numbers of the rivals of `sides`.
    kept: &'a [usize],
    found: &'a Reachable,
    visits: &'a Visits<'a>,
}

impl Turns<'_> {
    fn decide(
        &self,
        contest: &mut Contest,
        first: Whitened,
        options: &FurtherOptions,
    ) -> Result<Vec<Step>, Error> {
        let Self { at, sides, kept, found, visits } = self;
        let mut steps: Vec<Step> = Vec::new();
        let mut taken: Vec<usize> = Vec::new();
        let (mut waited, mut pauses) = (0.0, 0);
        let mut first = Some(first);
        for step in 0..options.poses.min(found.len()) {
            let from =
                steps.last().map_or_else(|| visits.start(), |s| found.row(s.candidate).to_vec());
            let now = match first.take() {
                Some(rows) => rows,
                None => visits.rows(at, found, step, waited, from.clone())?,
            };
            let best_of = |rows: &[Whitened]| {
                least(found.len(), &taken, |k| {
                    let way = options.way * found.distance(&from, found.row(k));
                    contest.criterion_with(&of_each(rows, k)).max(1e-300).ln() + way
                })
            };
            let rows = select(&now, sides);
            let (score, best) = best_of(&rows);
            let mut choice = (0.0, best, rows);
            if visits.timed && pauses < PAUSES {
                let later = visits.rows(at, found, step, waited + PAUSE, from.clone())?;
                let later = select(&later, sides);
                let (after, other) = best_of(&later);
                if after < score + f64::ln(WORTH) {
                    choice = (PAUSE, other, later);
                }
            }
            let (wait, candidate, rows) = choice;
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

/// When poses are visited, and from where.
struct Visits<'a> {
    session: &'a Observations,
    from: Option<&'a [f64]>,
    /// Rows change on the way.
    dynamic: bool,
    /// Explanations differ in what time does.
    timed: bool,
    /// Time from pose to pose, in sessions.
    pace: f64,
}

impl<'a> Visits<'a> {
    fn new(session: &'a Observations, own: &[Instance], options: &'a FurtherOptions) -> Self {
        let of_way =
            |i: &Instance| i.term.needs().iter().any(|n| *n != Needs::Motion && n.of_way());
        let passes =
            |i: &Instance| i.term.info().needs == Needs::Order && i.term.placed() == Placed::Once;
        let timed = own.iter().any(passes) && session.readings.timed;
        Self {
            session,
            from: options.from.as_deref(),
            dynamic: timed || own.iter().any(of_way),
            timed,
            pace: 1.0 / (session.readings.poses().max(2) - 1) as f64,
        }
    }

    /// Readings of the pose in which the mechanism stands.
    fn start(&self) -> Vec<f64> {
        let readings = &self.session.readings;
        self.from.map_or_else(|| readings.row(readings.samples - 1).to_vec(), <[f64]>::to_vec)
    }

    /// Rows of all candidates as the visit of number `step`, after pauses of so many sessions.
    fn rows(
        &self,
        at: &Linearised<'_>,
        found: &Reachable,
        step: usize,
        waited: f64,
        from: Vec<f64>,
    ) -> Result<Whitened, Error> {
        let mut readings = self.readings(found)?;
        let time = 1.0 + (step + 1) as f64 * self.pace + waited;
        readings.set_times(&vec![time; found.len()], self.session.readings.poses());
        readings.set_approach(&from);
        at.rows(&readings)
    }

    /// Readings of the visits of a plan, in their order.
    fn planned(&self, planned: &Reachable, steps: &[Step]) -> Result<Readings, Error> {
        let mut readings = self.readings(planned)?;
        let mut waited = 0.0;
        let mut times = Vec::with_capacity(steps.len());
        for (k, step) in steps.iter().enumerate() {
            waited += step.wait;
            times.push(1.0 + (k + 1) as f64 * self.pace + waited);
        }
        readings.set_times(&times, self.session.readings.poses());
        Ok(readings)
    }

    fn visited(
        &self,
        at: &Linearised<'_>,
        planned: &Reachable,
        steps: &[Step],
    ) -> Result<Whitened, Error> {
        at.rows(&self.planned(planned, steps)?)
    }

    fn readings(&self, found: &Reachable) -> Result<Readings, Error> {
        Readings::beside(&self.session.mechanism, found.table.clone(), &self.session.readings)
    }
}

/// Mean products of the derivatives of the platform, or of the carried points without one, by all
/// parameters, over some poses.
fn moments(
    at: &Linearised<'_>,
    session: &Observations,
    judged: &Reachable,
) -> Result<Moments, Error> {
    let steps = steps_of(at);
    let all: Vec<usize> = (0..at.model.parameters).collect();
    let (columns, slopes) = slopes(at, &all, &steps, session, judged)?;
    Ok(moments_of(&slopes, &columns, at.model.parameters))
}

/// The same for a model of many absent effects, each in a small model of its own: what one does
/// does not depend on the others while they are absent.
fn moments_of_absent(
    at: &Linearised<'_>,
    (best, named): (&Fit, &[Instance]),
    session: &Observations,
    judged: &Reachable,
) -> Result<Moments, Error> {
    let steps = steps_of(at);
    let one = |effect: &[Instance]| {
        let small = Linearised::new(session, best, effect, &[])?;
        let columns = at.columns_of(&small.model);
        let own = columns.iter().map(|&c| steps[c]).collect::<Vec<_>>();
        let own_terms = best.model.term_parameters..small.model.term_parameters;
        let some: Vec<usize> = match effect.is_empty() {
            true => (0..columns.len()).collect(),
            false => own_terms.collect(),
        };
        let (found, slopes) = slopes(&small, &some, &own, session, judged)?;
        Ok((found.iter().map(|&k| columns[k]).collect::<Vec<_>>(), slopes))
    };
    let effects = named.iter().map(std::slice::from_ref).chain([&[][..]]);
    let found: Vec<_> = workers::map(effects, one).into_iter().collect::<Result<_, Error>>()?;
    let (columns, slopes): (Vec<_>, Vec<_>) = found.into_iter().unzip();
    Ok(moments_of(&slopes.concat(), &columns.concat(), at.model.parameters))
}

/// Steps that the session would hardly notice: linear, and far above rounding.
fn steps_of(at: &Linearised<'_>) -> Vec<f64> {
    let information = at.session().gram();
    let step = |column: usize| {
        let size = information[(column, column)].max(0.0).sqrt();
        if size > 0.0 { 1.0 / size } else { 1e-6 }
    };
    (0..at.model.parameters).map(step).collect()
}

/// Derivatives by some parameters of a model, of those that act on these poses: their numbers, and
/// the derivatives over the poses.
fn slopes(
    at: &Linearised<'_>,
    some: &[usize],
    steps: &[f64],
    session: &Observations,
    judged: &Reachable,
) -> Result<(Vec<usize>, Vec<PoseSlopes>), Error> {
    let readings = Readings::beside(&session.mechanism, judged.table.clone(), &session.readings)?;
    let (model, columns) = at.under(&session.mechanism, &readings)?;
    let beta = at.beta_of(&columns);
    let platform = !judged.poses.is_empty();
    let place = |beta: &[f64]| -> Vec<[f64; 6]> {
        match platform {
            true => poses_of(&model, &readings, beta, &at.noise),
            false => carried(&model, &readings, beta),
        }
    };
    let acting = (0..columns.len()).filter(|&own| some.contains(&columns[own]));
    let acting: Vec<(usize, f64)> = acting.map(|own| (own, steps[columns[own]])).collect();
    let found = acting.iter().map(|&(own, _)| columns[own]).collect();
    Ok((found, slopes_of(&beta, &acting, place)))
}

/// Places of the first carried point that a closure holds, row by row.
fn carried(model: &Model, readings: &Readings, beta: &[f64]) -> Vec<[f64; 6]> {
    let mut out = vec![[0.0; 6]; readings.samples];
    let mut ws = Workspace::default();
    let points = &model.mechanism.points;
    let tip = (0..points.len()).find(|&p| points[p].chain.is_some());
    for (block, meta) in readings.blocks().iter().enumerate() {
        let want = Want { x: false, a: false };
        model.evaluate(readings, block, readings.raw(block), beta, want, &mut ws);
        let Some(at) = tip.and_then(|p| model.points(&ws, beta)[p]) else { continue };
        for (lane, &row) in meta.rows.iter().enumerate().take(meta.live) {
            (0..3).for_each(|i| out[row][i] = at[i].0[lane]);
        }
    }
    out
}

/// `Ω` of a criterion among all parameters; none for the volume.
fn omega_of(
    criterion: Criterion,
    at: &Linearised<'_>,
    found: &Reachable,
    moments: &Moments,
) -> Option<Mat<f64>> {
    let n = at.model.parameters;
    let channels = found.channels;
    // Readings at which the joint coordinates count, from the centre of each channel.
    let readings = |c: usize| -> Vec<f64> {
        let centre = at.model.scales[c].centre;
        match criterion {
            Criterion::Offsets => vec![-centre],
            _ => (0..found.len()).map(|k| found.row(k)[c] - centre).collect(),
        }
    };
    match criterion {
        Criterion::Volume => None,
        Criterion::Platform | Criterion::Decide => Some(moments.position.clone()),
        Criterion::Offsets | Criterion::Joints => {
            let mut omega = Mat::zeros(n, n);
            for c in 0..channels {
                let Some(offset) = at.model.column(Role::Offset, c) else { continue };
                let a = readings(c);
                let count = a.len() as f64;
                omega[(offset, offset)] = 1.0;
                if let Some(gain) = at.model.column(Role::Gain, c) {
                    let mean = a.iter().sum::<f64>() / count;
                    omega[(offset, gain)] = mean;
                    omega[(gain, offset)] = mean;
                    omega[(gain, gain)] = a.iter().map(|a| a * a).sum::<f64>() / count;
                }
            }
            Some(omega)
        }
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

/// `WᵀW` of the rows of one pose.
fn gram_of(rows: &[f64], n: usize) -> Mat<f64> {
    let w = Mat::from_fn(rows.len().checked_div(n).unwrap_or(0), n, |e, i| rows[e * n + i]);
    w.transpose() * &w
}

/// The worst hidden effect before and after the plan; none without a platform.
fn hidden(
    session: &Observations,
    best: &Fit,
    visits: &Visits<'_>,
    planned: &Reachable,
    steps: &[Step],
    judged: &Reachable,
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
    let moments = moments_of_absent(&at, (best, &named), session, &judged.some(&some))?;
    let worst = |gram: &Mat<f64>| {
        worst_hidden(&session.mechanism, &at.model, &named, gram, &side.columns, &moments)
    };
    Ok([worst(&before), worst(&after)])
}

fn check(observations: &Observations, options: &FurtherOptions) -> Result<(), Error> {
    let channels = observations.mechanism.channels.len();
    for (name, value) in [("poses", options.poses), ("candidates", options.candidates)] {
        if !(1..=1_000_000).contains(&value) {
            return Err(Error::option(name, value, "at least 1 and at most 1000000"));
        }
    }
    Error::same("off", options.off.len(), options.off.len().next_multiple_of(channels))?;
    options.from.as_ref().map_or(Ok(()), |from| Error::same("from", from.len(), channels))
}

//! Two sessions of one device: what has changed between them.
//!
//! The readings of the later session are tested under the calibration of the earlier one, whose
//! uncertainty is part of the test: (102) with an onset before the first row. Each change that is
//! found joins the parameters that are not known, and the others are tested beside it. Two changes at once
//! can look like a third: so each is chosen again beside those that were found with it.

use crate::numerics::order::Ends;
use std::sync::Arc;

use nalgebra::{DMatrix, DVector};

use crate::Error;
use crate::apply::change::PlatformRms;
use crate::apply::earlier::Applied;
use crate::estimate::on_closures::means_under;
use crate::estimate::{Noise, Observations};
use crate::mechanism::{Mechanism, Target};
use crate::model::Spec;
use crate::monitor::alarm::Change;
use crate::monitor::any_angle::{Turned, nearest_turn};
use crate::monitor::covariance::inverse;
use crate::monitor::far::LINEAR;
use crate::monitor::platform::Seen;
use crate::monitor::rows::Rows;
use crate::monitor::score::Score;
use crate::monitor::state::State;
use crate::monitor::thresholds::{as_chi2, log_tail};
use crate::monitor::watched::{Watched, changes};
use crate::monitor::windows::{Sums, Windows};
use crate::numerics::credible_set::AS_WELL;
use crate::numerics::distributions::{chi2_tail, f_tail};
use crate::numerics::lanes::WIDTH;
use crate::numerics::order;
use crate::readings::Readings;

/// Probability that chance alone makes any change of a device.
pub const CHANGED_LEVEL: f64 = 0.01;

/// Most changes that are looked for.
pub(super) const MOST_CHANGES: usize = 4;

/// Linearisations about the estimate of a change.
pub(super) const LINEARISATIONS: usize = 4;

/// Rows by which a joint that has turned far is looked for.
const SOME: usize = 48;

/// Standard deviation, in typical sizes, of what is not known.
const UNKNOWN: f64 = 1e3;

/// A later session against an earlier calibration.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
#[non_exhaustive]
pub struct Comparison {
    /// χ² of the later poses under the earlier calibration, its uncertainty counted in, per
    /// degree of freedom.
    pub chi2_per_dof: f64,
    /// Probability of more by chance.
    pub p_value: f64,
    /// Misclosure of the later poses, each the mean of its samples, under the earlier calibration,
    /// length units.
    pub rms_misclosure: f64,
    /// What has changed, the most certain first.
    pub changes: Vec<Found>,
    /// Probability of more by chance than these changes leave.
    pub left: f64,
    /// True where parameters are compared, and those of the later session do not close its loops: they are wrong by
    /// what is left, in directions that nobody knows, and what has changed is not told.
    pub open: bool,
}

/// A change between two sessions.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
#[non_exhaustive]
pub struct Found {
    /// Id of the term.
    pub term: String,
    /// What it acts on.
    pub target: String,
    /// How large: the value of a single parameter, or the length of a displacement.
    pub size: f64,
    /// Standard deviation of the size.
    pub sd: f64,
    /// Unit of the size.
    pub unit: String,
    /// All parameters of the change.
    pub parameters: Vec<Change>,
    /// Probability of such a change by chance, for any of the candidates.
    pub p_value: f64,
    /// What it does to the platform in the later session; none without a platform.
    pub platform_rms: Option<PlatformRms>,
    /// Changes that these readings cannot tell from it: term and target.
    pub also_fits: Vec<[String; 2]>,
}

/// The noise that a later session is judged by.
#[derive(Debug, Clone, PartialEq)]
pub struct Judged {
    /// Of a reading, and of the closures.
    pub noise: Noise,
    /// Variance of a pose's mean over that of independent samples.
    pub inflation: f64,
    /// Degrees of freedom of the noise; infinite where it was declared.
    pub dof: f64,
}

/// A pass over all rows.
struct Pass {
    state: State,
    now: Sums,
    chi2: f64,
}

/// What has changed.
struct Told {
    /// The sums at the estimates.
    pass: Pass,
    changes: Vec<Named>,
    /// A joint that has turned far, and what might have changed in its place.
    far: Option<Turned>,
    instead: Vec<[String; 2]>,
    /// What changes are counted from: as before, but where a joint has turned to.
    was: Vec<f64>,
}

/// The later session: one row for each held pose, the mean of its samples, or each row of a
/// recording.
struct Session<'a> {
    judged: &'a Judged,
    rows: Arc<Readings>,
    used: Vec<usize>,
    /// Samples of each row.
    samples: Vec<f64>,
}

/// A candidate, and what speaks for it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Ranked {
    pub(super) candidate: usize,
    /// By how much `χ²` falls.
    pub(super) fit: f64,
    /// Logarithm of the probability of that by chance.
    pub(super) log_p: f64,
    /// That probability for any of the candidates.
    pub(super) p_value: f64,
}

/// A change that is named.
pub(super) struct Named {
    pub(super) candidate: usize,
    pub(super) p_value: f64,
    pub(super) also_fits: Vec<[String; 2]>,
}

impl Ranked {
    /// True where the readings cannot tell this candidate from `named`.
    fn ties(&self, named: &Self) -> bool {
        self.fit > named.fit - AS_WELL || 2.0 * (self.log_p - named.log_p) < AS_WELL
    }
}

impl Named {
    /// The first of these, with those that the readings cannot tell from it; none where chance makes as much.
    pub(super) fn first(ranked: &[Ranked], name: impl Fn(usize) -> [String; 2]) -> Option<Self> {
        let best = ranked.first().filter(|best| best.p_value < CHANGED_LEVEL)?;
        let ties = ranked[1..].iter().filter(|one| one.ties(best));
        let also_fits = ties.map(|one| name(one.candidate)).collect();
        Some(Self { candidate: best.candidate, p_value: best.p_value.min(1.0), also_fits })
    }
}

impl Judged {
    /// Probability of a larger `χ²` of so many degrees of freedom by chance.
    pub(super) fn p_value(&self, chi2: f64, count: f64) -> f64 {
        let dof = self.dof;
        if dof.is_finite() { f_tail(chi2 / count, count, dof) } else { chi2_tail(chi2, count) }
    }

    /// Logarithm of the probability of a larger statistic by chance.
    pub(super) fn log_p(&self, statistic: f64, rank: usize) -> f64 {
        let dof = self.dof;
        let statistic = if dof.is_finite() { as_chi2(statistic, dof) } else { statistic };
        log_tail(statistic, rank as f64)
    }
}

/// Chooses each change again beside the others, until none is another; one beside which chance makes as much
/// is no change. One that is left alone stays: what was dropped may be likelier where nothing stands beside it. The
/// rounds are bounded, should two choices alternate.
pub(super) fn choose_again(
    changes: &mut Vec<Named>,
    mut beside: impl FnMut(&[Named]) -> Option<Named>,
) {
    let mut same = 0;
    for _ in 0..MOST_CHANGES * MOST_CHANGES {
        if same == changes.len() || changes.len() == 1 {
            break;
        }
        let one = changes.remove(0);
        let again = beside(changes);
        let as_before = again.as_ref().is_some_and(|again| again.candidate == one.candidate);
        same = if as_before { same + 1 } else { 0 };
        changes.extend(again);
    }
}

/// What has changed since the calibration `earlier`, whose parameters have this covariance, row
/// by row: tested on the readings of a later session and their noise.
///
/// # Errors
///
/// As [`super::Monitor::new`].
pub fn compare(
    earlier: &Applied,
    covariance: Option<&[f64]>,
    observations: &Observations,
    judged: &Judged,
) -> Result<Comparison, Error> {
    let noise = &judged.noise;
    let mechanism = &observations.mechanism;
    let mut watched = Watched::new(mechanism, earlier, covariance, candidates(mechanism), &[])?;
    let session = Session::of(observations, judged, &watched)?;
    let mut seen = Seen::new(mechanism.channels.len());
    session.used.iter().for_each(|&row| seen.see(session.rows.row(row).iter().copied()));
    let count = session.used.len() as f64 * watched.under.model.equations() as f64;

    let before = watched.at.clone();
    let rms_misclosure = session.misclosure(&watched);
    let pass = session.pass(&watched, &before, &watched.prior.clone());
    let (chi2_per_dof, p_value) = (pass.chi2 / count, judged.p_value(pass.chi2, count));
    let prior = watched.prior.clone();
    let Told { pass, mut changes, far, instead, was } = session.told(&mut watched, pass, p_value);
    watched.prior = prior;
    let told = changes.iter().map(|one| watched.candidates[one.candidate].columns.len());
    let told = told.sum::<usize>() + usize::from(far.is_some());
    let left = judged.p_value(pass.chi2, (count - told as f64).max(1.0));
    order::ascending(&mut changes, |a| a.p_value);
    let turned = far.iter().flat_map(|one| watched.candidates[one.candidate].columns.clone());
    let changed: Vec<usize> = columns_of(&watched, &changes).into_iter().chain(turned).collect();
    let found = changes.into_iter().map(|Named { candidate: k, p_value, also_fits }| {
        let (values, covariance, alone) = difference(&watched, &pass, &was, &changed, k);
        let candidate = &watched.candidates[k];
        let (parameters, [size, sd], unit) = candidate.changes(&values, &covariance);
        let [term, target] = name(&watched, k);
        let platform_rms = seen.change(&watched, noise, &was, &alone);
        Found { term, target, size, sd, unit, parameters, p_value, platform_rms, also_fits }
    });
    let far = far.map(|Turned { candidate, shift, sd, .. }| {
        let ([term, target], own) = (name(&watched, candidate), &watched.candidates[candidate]);
        let (parameter, unit) = own.parameters[0].clone();
        let (size, sd) = match own.columns[0] < pass.state.size {
            true => {
                let (more, covariance, _) = difference(&watched, &pass, &was, &changed, candidate);
                let scale = watched.scale[own.columns[0]];
                (shift + more[0] * scale, covariance[(0, 0)].sqrt() * scale)
            }
            false => (shift, sd),
        };
        let change = Change { name: parameter.into(), value: size, sd, unit: unit.clone() };
        let platform_rms = seen.change(&watched, noise, &before, &was);
        let (parameters, also_fits) = (vec![change], instead);
        Found { term, target, size, sd, unit, parameters, p_value, platform_rms, also_fits }
    });
    let changes = far.into_iter().chain(found).collect();
    Ok(Comparison { chi2_per_dof, p_value, rms_misclosure, changes, left, open: false })
}

/// Positions of the parameters of some changes.
fn columns_of(watched: &Watched, changes: &[Named]) -> Vec<usize> {
    let of = |one: &Named| watched.candidates[one.candidate].columns.clone();
    changes.iter().flat_map(of).collect()
}

/// Those of the changes that are beyond all proportion.
fn absurd_of(watched: &Watched, pass: &Pass, was: &[f64], changes: &[Named]) -> Vec<usize> {
    let changed = columns_of(watched, changes);
    let absurd = |one: &usize| {
        let (values, ..) = difference(watched, pass, was, &changed, *one);
        watched.candidates[*one].is_absurd(&values)
    };
    changes.iter().map(|one| one.candidate).filter(absurd).collect()
}

/// What may have changed: as at work, and the gain of a sensor.
fn candidates(mechanism: &Mechanism) -> Vec<Spec> {
    let gain = |c| Spec {
        term: "gain".into(),
        target: Some(Target::Channel(c).name(mechanism)),
        place: None,
    };
    let mut all = changes(mechanism);
    all.extend((0..mechanism.channels.len()).map(gain));
    all
}

fn name(watched: &Watched, candidate: usize) -> [String; 2] {
    let Spec { term, target, .. } = &watched.candidates[candidate].spec;
    [term.clone(), target.clone().unwrap_or_default()]
}

impl<'a> Session<'a> {
    fn of(
        observations: &Observations,
        judged: &'a Judged,
        watched: &Watched,
    ) -> Result<Self, Error> {
        let Observations { readings, mechanism, weights, .. } = observations;
        let (rows, samples) = match readings.held {
            true => {
                let under = (&watched.under.model, &watched.at[..]);
                let all = (&**readings, &weights[..]);
                let (poses, samples) = means_under(mechanism, all, under, &judged.noise)?;
                (Arc::new(poses), samples)
            }
            false => (Arc::clone(readings), weights.clone()),
        };
        let used = (0..rows.samples).filter(|&row| samples[row] > 0.0).collect();
        Ok(Self { judged, rows, used, samples })
    }

    /// The joint that explains the session best by another offset, looked for in some of the rows; none where none turns.
    fn turned(&self, watched: &mut Watched) -> Option<Turned> {
        let some = self.used.iter().step_by(self.used.len().div_ceil(SOME).max(1));
        let own = Self {
            judged: self.judged,
            rows: Arc::clone(&self.rows),
            used: some.copied().collect(),
            samples: self.samples.clone(),
        };
        let best = watched.turning().into_iter().map(|candidate| {
            let column = watched.order[watched.candidates[candidate].columns[0]];
            (nearest_turn(&mut own.about(watched, column)), candidate)
        });
        let ((_, shift), candidate) = best.least_by(|a| a.0.0)?;
        let position = watched.candidates[candidate].columns[0];
        let (column, step) = (watched.order[position], watched.scale[position]);
        Some(Turned::at(candidate, shift, &mut self.about(watched, column), step))
    }

    /// Counts from where a joint has turned to, and gives the sums about that.
    fn take(&self, watched: &mut Watched, was: &mut Vec<f64>, turned: Turned) -> Pass {
        let mut prior = std::mem::take(&mut watched.prior);
        turned.go_on(watched, &mut prior);
        // How far is estimated again beside what else has changed: a sensor that was replaced has another gain, too.
        let (position, size) =
            (watched.candidates[turned.candidate].columns[0], prior.len().isqrt());
        if position < size {
            prior[position * (size + 1)] += UNKNOWN.powi(2);
        }
        watched.prior = prior;
        was.clone_from(&watched.at);
        self.settle(watched, was, &[])
    }

    /// `χ²` by how far one parameter is moved from where it is, and known there as well as before.
    fn about(&self, watched: &mut Watched, column: usize) -> impl FnMut(f64) -> f64 {
        let was = watched.at[column];
        move |shift| {
            watched.at[column] = was + shift;
            let chi2 = self.pass(watched, &watched.at.clone(), &watched.prior.clone()).chi2;
            watched.at[column] = was;
            chi2
        }
    }

    /// Sums over all rows about the present parameters, `prior` holding about `was`.
    fn pass(&self, watched: &Watched, was: &[f64], prior: &[f64]) -> Pass {
        let width = watched.order.len();
        let k = watched.under.model.equations();
        let mut rows = Rows::new(watched, &self.judged.noise);
        let mut state = State::new(prior.to_vec(), watched.uncertain, width, k);
        for (position, mean) in state.mean.iter_mut().enumerate() {
            let column = watched.order[position];
            *mean = (was[column] - watched.at[column]) / watched.scale[position];
        }
        let mut windows = Windows::new(width, 1, watched.tested());
        let mut chi2 = 0.0;
        let (mut r, mut g) = (vec![0.0; k], vec![0.0; k * width]);
        for used in self.used.chunks(WIDTH) {
            self.put(&mut rows, used);
            rows.linearise(watched, 0);
            for (lane, &row) in used.iter().enumerate() {
                rows.read(lane, watched, 0, &mut r, &mut g);
                let more = (self.samples[row] / self.judged.inflation).sqrt();
                r.iter_mut().chain(&mut g).for_each(|v| *v *= more);
                chi2 += state.compare(&r, &g, width);
                state.absorb();
                windows.add(&r, &g, 0, None);
            }
        }
        Pass { state, now: windows.now, chi2 }
    }

    /// The state at the estimates of some changes.
    fn settle(&self, watched: &mut Watched, was: &[f64], changes: &[Named]) -> Pass {
        let prior = freed(watched, changes);
        let mut pass = self.pass(watched, was, &prior);
        centre(watched, &mut pass);
        for _ in 1..LINEARISATIONS {
            pass = self.pass(watched, was, &prior);
            centre(watched, &mut pass);
        }
        pass
    }

    /// What has changed, where no change leaves this `pass`, more than which chance makes with probability `p_value`.
    fn told(&self, watched: &mut Watched, mut pass: Pass, p_value: f64) -> Told {
        let (mut was, first) = (watched.at.clone(), pass.chi2);
        let turned = (p_value <= CHANGED_LEVEL).then(|| self.turned(watched)).flatten();
        let hardly = |one: &Turned| one.squares <= LINEAR * LINEAR * first;
        // What has turned far is taken as it is: the others are linearised about it.
        let mut far = turned.filter(|one| one.shift.abs() > LINEAR && hardly(one));
        let (mut instead, mut none) = (Vec::new(), Vec::new());
        if let Some(one) = far {
            pass = self.take(watched, &mut was, one);
            none.push(one.candidate);
        }
        let mut changes: Vec<Named>;
        loop {
            (pass, changes) = self.search(watched, &was, pass, none.clone());
            // Where a sensor was replaced, a link as long as the whole may seem to close the loops.
            let absurd = absurd_of(watched, &pass, &was, &changes);
            if absurd.is_empty() {
                break;
            }
            none.extend(absurd);
            watched.at.clone_from(&was);
            pass = self.settle(watched, &was, &[]);
        }
        // About the earlier session a bent link may look more like a joint that has turned than the joint itself.
        if let (None, Some(one), [named]) = (far, turned, &changes[..])
            && named.candidate != one.candidate
            && one.squares < pass.chi2 + AS_WELL
        {
            let own = name(watched, one.candidate);
            instead.push(name(watched, named.candidate));
            instead.extend(named.also_fits.iter().filter(|other| **other != own).cloned());
            changes.clear();
            watched.at.clone_from(&was);
            pass = self.take(watched, &mut was, one);
            far = Some(one);
        }
        Told { pass, changes, far, instead, was }
    }

    /// Changes, the most certain first, none of some candidates; and the state at their estimates.
    fn search(
        &self,
        watched: &mut Watched,
        was: &[f64],
        mut pass: Pass,
        none: Vec<usize>,
    ) -> (Pass, Vec<Named>) {
        let (mut changes, mut tried) = (Vec::new(), none.clone());
        for _ in 0..MOST_CHANGES {
            let ranked = self.ranked(watched, &pass, &tried);
            let Some(best) = Named::first(&ranked, |one| name(watched, one)) else { break };
            tried.push(best.candidate);
            changes.push(best);
            pass = self.choose_again(watched, was, &mut changes, &none);
            tried.extend(changes.iter().map(|one| one.candidate));
        }
        (pass, changes)
    }

    /// Chooses each change again, and gives the state at the estimates of those that are left.
    fn choose_again(
        &self,
        watched: &mut Watched,
        was: &[f64],
        changes: &mut Vec<Named>,
        none: &[usize],
    ) -> Pass {
        choose_again(changes, |others| {
            let pass = self.settle(watched, was, others);
            let taken = others.iter().map(|other| other.candidate).chain(none.iter().copied());
            let taken: Vec<usize> = taken.collect();
            let ranked = self.ranked(watched, &pass, &taken);
            Named::first(&ranked, |candidate| name(watched, candidate))
        });
        self.settle(watched, was, changes)
    }

    /// Candidates by how improbable they are by chance.
    fn ranked(&self, watched: &Watched, pass: &Pass, tried: &[usize]) -> Vec<Ranked> {
        let mut score = Score::new(watched.order.len());
        let none = Sums::new(watched.order.len());
        let tests = watched.candidates.len() as f64;
        let mut ranked = Vec::new();
        for (number, candidate) in watched.candidates.iter().enumerate() {
            let (fit, rank) = score.test(&candidate.columns, &pass.state, &pass.now, &none);
            if rank > 0 && !tried.contains(&number) {
                let log_p = self.judged.log_p(fit, rank);
                let p_value = log_p.exp() * tests;
                ranked.push(Ranked { candidate: number, fit, log_p, p_value });
            }
        }
        order::ascending(&mut ranked, |a| a.log_p);
        ranked
    }

    /// Puts rows into the first lanes.
    fn put(&self, rows: &mut Rows, used: &[usize]) {
        used.iter().enumerate().for_each(|(lane, &row)| rows.put(lane, self.rows.row(row)));
        let samples: Vec<f64> = used.iter().map(|&row| self.samples[row]).collect();
        rows.seat(&samples);
    }

    /// Misclosure of the rows under the present parameters.
    fn misclosure(&self, watched: &Watched) -> f64 {
        let lengths = watched.under.model.lengths();
        let mut rows = Rows::new(watched, &self.judged.noise);
        let mut squares = 0.0;
        for used in self.used.chunks(WIDTH) {
            self.put(&mut rows, used);
            squares += rows.misclosure(watched, &lengths, used.len());
        }
        (squares / (self.used.len() * lengths.len()).max(1) as f64).sqrt()
    }
}

/// Covariance beforehand, row by row, if the parameters of these changes are not known.
fn freed(watched: &mut Watched, changes: &[Named]) -> Vec<f64> {
    let known = watched.prior.len().isqrt();
    for change in changes {
        for i in 0..watched.candidates[change.candidate].columns.len() {
            let column = watched.candidates[change.candidate].columns[i];
            if column >= watched.uncertain {
                watched.join(column);
            }
        }
    }
    let m = watched.uncertain;
    let mut wider = vec![0.0; m * m];
    for (i, row) in watched.prior.chunks_exact(known.max(1)).enumerate() {
        wider[i * m..i * m + known].copy_from_slice(row);
    }
    for &column in changes.iter().flat_map(|c| &watched.candidates[c.candidate].columns) {
        wider[column * m + column] += UNKNOWN.powi(2);
    }
    wider
}

/// Puts the mean of the state into the parameters.
fn centre(watched: &mut Watched, pass: &mut Pass) {
    for (position, mean) in pass.state.mean.iter_mut().enumerate() {
        watched.at[watched.order[position]] += *mean * watched.scale[position];
        *mean = 0.0;
    }
}

/// Change of a candidate's parameters since before, with its covariance, in units of
/// [`Watched::scale`]; and all parameters with that change alone.
///
/// Of what has changed, `S`, the readings tell where it is. Where it was is what the earlier result says, and what
/// the others, `R`, tell of that, which are where they were:
///
/// ```text
/// δ = d_S - B d_R,    B = C_SR C_RR⁻¹,    cov δ = [I -B] P [I -B]ᵀ + C_SS - B C_RS              (179)
/// ```
///
/// with `d` from the earlier estimates, `C` their covariance, and `P` that of the state.
fn difference(
    watched: &Watched,
    pass: &Pass,
    was: &[f64],
    changed: &[usize],
    candidate: usize,
) -> (DVector<f64>, DMatrix<f64>, Vec<f64>) {
    let known = watched.prior.len().isqrt();
    let own = &watched.candidates[candidate].columns;
    let rest: Vec<usize> = (0..known).filter(|k| !changed.contains(k)).collect();
    let earlier = |rows: &[usize], columns: &[usize]| {
        DMatrix::from_fn(rows.len(), columns.len(), |i, j| match rows[i].max(columns[j]) < known {
            true => watched.prior[rows[i] * known + columns[j]],
            false => 0.0,
        })
    };
    let by = earlier(own, &rest) * inverse(&earlier(&rest, &rest)).0;
    let all = [&own[..], &rest].concat();
    let moved = DVector::from_fn(all.len(), |i, _| {
        let column = watched.order[all[i]];
        (watched.at[column] - was[column]) / watched.scale[all[i]]
    });
    let m = pass.state.size;
    let now =
        DMatrix::from_fn(all.len(), all.len(), |i, j| pass.state.covariance[all[i] * m + all[j]]);
    let (q, r) = (own.len(), rest.len());
    let mut less = DMatrix::identity(q, q + r);
    less.columns_mut(q, r).copy_from(&-&by);
    let values = &less * moved;
    let before = earlier(own, own) - &by * earlier(&rest, own);
    let covariance = &less * now * less.transpose() + before;
    let mut alone = was.to_vec();
    for (i, &position) in own.iter().enumerate() {
        alone[watched.order[position]] += values[i] * watched.scale[position];
    }
    (values, covariance, alone)
}

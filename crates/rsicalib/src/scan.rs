//! Scores of every effect that a model lacks, from one linearisation.
//!
//! A candidate with columns `Z` of the whitened Jacobian is projected off what is
//! already fitted, `X`, and scored against the residual `r`:
//!
//! ```text
//! M = ZᵀZ - ZᵀX (XᵀX)⁻¹ XᵀZ,    u = Zᵀr - ZᵀX (XᵀX)⁻¹ Xᵀr                 (71)
//! T = uᵀ M⁻¹ u  ~  χ²(rank M)                                              (72)
//! ```
//!
//! `T` is by how much χ² would fall to first order. A free shape, held by its
//! typical size, has `M + Λ` in place of `M`, and fewer degrees of freedom.
//!
//! Bad readings and slips are thousands of candidates of one column each; their
//! columns are those of the readings, `L⁻¹A`, in one pose or from one pose on, so
//! running sums score them all.

use faer::{Mat, Side};

use crate::fit::Fit;
use crate::lanes::Lanes;
use crate::model::{Instance, Model, Target, places, provided, targets};
use crate::objective::{Implicit, Noise, Part};
use crate::session::Session;
use crate::sums::{Own, add_all, add_line};
use crate::terms::{ALL, Class, Term, find};
use crate::{Error, stats};

/// Kinds of candidates that share an error budget.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Family {
    /// Named effects: a hundred or so.
    Named,
    /// A free shape: of each channel over its reading and over time, of all over time.
    Free,
    /// A jump of one channel at one time: as many as poses and channels.
    Slip,
    /// A wrong reading: likewise.
    Bad,
}

/// A candidate with its score.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scored {
    /// The candidate; a whole pose is `bad_reading` at [`Target::All`].
    pub instance: Instance,
    /// Its family.
    pub family: Family,
    /// `T` of (72).
    pub score: f64,
    /// Its degrees of freedom.
    pub width: f64,
    /// Probability of a larger score by chance, this candidate alone.
    pub p_value: f64,
    /// Places looked at in its family, over the family's share of the error budget.
    pub places: f64,
    /// `p_value` times `places`.
    pub corrected: f64,
}

/// Charge for each parameter, in units of χ².
pub const CHARGE: f64 = 4.0;

impl Scored {
    fn of(
        instance: Instance,
        family: Family,
        score: f64,
        width: f64,
        p_value: f64,
        tests: f64,
    ) -> Self {
        let places = tests / share(family);
        Self { instance, family, score, width, p_value, places, corrected: p_value * places }
    }

    /// What is left of the score after its parameters and its places are paid for.
    #[must_use]
    pub fn charged(&self) -> f64 {
        self.score - CHARGE * self.width - 2.0 * self.places.ln().max(0.0)
    }
}

/// Share of the error budget that each family has.
const SHARES: [(Family, f64); 4] =
    [(Family::Named, 0.62), (Family::Free, 0.08), (Family::Slip, 0.12), (Family::Bad, 0.18)];

/// How scores are judged.
#[derive(Debug, Clone, Copy)]
pub struct Judge {
    /// Degrees of freedom of the noise; infinite where it is known.
    pub noise_dof: f64,
    /// Degrees of freedom of the residual where nothing else gives the noise.
    pub residual_dof: Option<f64>,
}

impl Judge {
    /// Probability of a score of `width` degrees of freedom or more by chance.
    #[must_use]
    pub fn p_value(&self, score: f64, width: f64) -> f64 {
        match self.residual_dof {
            None => stats::f_tail(score / width, width, self.noise_dof),
            Some(dof) => {
                let left = ((dof - score) / (dof - width).max(1.0)).max(1e-12);
                stats::f_tail(score / width / left, width, (dof - width).max(1.0))
            }
        }
    }
}

impl Judge {
    /// Probability of a fit's lack of fit by chance; none where only the fit gives
    /// the noise.
    #[must_use]
    pub fn lack_of_fit(&self, fit: &Fit) -> Option<f64> {
        (self.residual_dof.is_none() && fit.dof >= 1.0)
            .then(|| stats::f_tail(fit.chi2 / fit.dof, fit.dof, self.noise_dof))
    }
}

/// Named and free candidates that mechanism and readings allow.
#[must_use]
pub fn candidates(session: &Session, fit: &Fit, without: &[String]) -> Vec<Instance> {
    let (mechanism, readings) = (&session.mechanism, &session.readings);
    let mut all = Vec::new();
    for term in ALL.iter().copied() {
        let info = term.info();
        if term.searched()
            || info.broad
            || without.iter().any(|w| w == info.id)
            || provided(term, mechanism, readings).is_err()
        {
            continue;
        }
        for target in targets(term, mechanism) {
            if !meaningful(session, fit, term, target) {
                continue;
            }
            let channel = if let Target::Channel(c) = target { c } else { 0 };
            for place in places(term, mechanism, readings, channel) {
                let instance = Instance { term, target, place };
                if !fit.model.instances.contains(&instance) {
                    all.push(instance);
                }
            }
        }
    }
    all
}

/// False where a term would repeat another: a body that carries no joint has no axis
/// to tilt, before the first joint the base tilts, a frame that is free as a whole is
/// longer by itself, where nothing is fixed to the base a single chain has none, and a
/// free shape is any shape.
fn meaningful(session: &Session, fit: &Fit, term: &dyn Term, target: Target) -> bool {
    let (mechanism, id) = (&session.mechanism, term.info().id);
    if has_free_shape(fit, term, target) {
        return false;
    }
    match target {
        Target::Row(chain, row) => {
            let rows = &mechanism.chains[chain].rows;
            let first = rows.iter().position(|r| r.channel.is_some()).unwrap_or(0);
            let last = rows.iter().rposition(|r| r.channel.is_some()).unwrap_or(0);
            let free = fit.model.instances.iter();
            let mut free = free.filter(|i| i.target == target && i.term.info().broad);
            free.next().is_none() && (id != "joint_tilt" || (row >= first && row < last))
        }
        Target::Chain(_) => !(id.starts_with("base_") && mechanism.floats()),
        _ => true,
    }
}

/// True where any shape over what this term runs over is fitted to its target.
#[must_use]
pub fn has_free_shape(fit: &Fit, term: &dyn Term, target: Target) -> bool {
    let mut instances = fit.model.instances.iter();
    let free = |i: &Instance| i.target == target && i.term.info().penalised;
    term.over().is_some() && instances.any(|i| free(i) && i.term.over() == term.over())
}

/// Sums for (71) over all candidates.
struct Sums {
    /// `Zᵀr`.
    gradient: Vec<Lanes>,
    /// `ZᵀX` of the terms, candidate column by candidate column.
    cross: Vec<Lanes>,
    /// `ZᵀZ` of each candidate, full square.
    square: Vec<Lanes>,
    /// `Xᵀr` of the terms.
    base: Vec<Lanes>,
    /// `Xᵀr` of the unknown points of each group, and `XᵀX`, `XᵀZ` column by column.
    own: Vec<Own>,
}

impl Sums {
    /// Adds a block, of whose columns the first `base` are fitted, the candidates'
    /// next, and those of the unknown points last.
    #[inline(always)]
    fn add(&mut self, group: usize, widths: &[usize], w: &[Lanes], x: &[Lanes]) {
        let (base, extra, columns) = (self.base.len(), self.gradient.len(), x.len() / w.len());
        for i in 0..base {
            add_line(&mut [], &mut self.base[i], w, x, columns, i);
        }
        for (i, gradient) in self.gradient.iter_mut().enumerate() {
            let line = &mut self.cross[i * base..(i + 1) * base];
            add_line(line, gradient, w, x, columns, base + i);
        }
        if columns > base + extra {
            let (points, others) = (columns - base - extra, base + extra);
            let own = Own::of(&mut self.own, group, points, points * others);
            for (c, gradient) in own.gradient.iter_mut().enumerate() {
                let line = &mut own.gram[c * others..(c + 1) * others];
                add_line(line, gradient, w, x, columns, others + c);
            }
        }
        for row in x.chunks_exact(columns) {
            let (mut at, mut first) = (0, base);
            for &width in widths {
                for i in 0..width {
                    for j in 0..width {
                        self.square[at] += row[first + i] * row[first + j];
                        at += 1;
                    }
                }
                first += width;
            }
        }
    }

    fn merge(&mut self, other: &Self) {
        add_all(&mut self.gradient, &other.gradient);
        add_all(&mut self.cross, &other.cross);
        add_all(&mut self.square, &other.square);
        add_all(&mut self.base, &other.base);
        Own::merge(&mut self.own, &other.own);
    }
}

/// Scores every candidate at a fit.
///
/// # Errors
///
/// As [`Model::new`].
pub fn scan(
    session: &Session,
    fit: &Fit,
    judge: &Judge,
    without: &[String],
) -> Result<Vec<Scored>, Error> {
    let named = candidates(session, fit, without);
    let (inverse, ..) = crate::fit::invert(&fit.gram);
    let mut scored = scan_named(session, fit, judge, &inverse, &named)?;
    scored.extend(scan_places(session, fit, judge, &inverse, without)?);
    Ok(scored)
}

/// Projected normal equations (71) of one candidate.
#[derive(Debug, Clone)]
pub struct Projected {
    /// The candidate.
    pub instance: Instance,
    /// `M`.
    pub square: Mat<f64>,
    /// `ZᵀZ` before the projection.
    pub raw: Vec<f64>,
    /// `u`.
    pub gradient: Vec<f64>,
    /// Typical size of each of its parameters.
    pub typical: Vec<f64>,
    /// `(XᵀX)⁻¹ XᵀZ`: how the fitted parameters absorb it, with a minus.
    pub absorbed: Mat<f64>,
}

/// Eq. (71) for named candidates.
///
/// # Errors
///
/// As [`Model::new`].
pub fn project(
    session: &Session,
    fit: &Fit,
    inverse: &Mat<f64>,
    named: &[Instance],
) -> Result<Vec<Projected>, Error> {
    let mut instances = fit.model.instances.clone();
    let base = fit.model.term_parameters;
    instances.extend_from_slice(named);
    let model = Model::about(&session.mechanism, &session.readings, instances, &session.centre)?;
    let widths: Vec<usize> = named.iter().map(Instance::width).collect();
    let extra: usize = widths.iter().sum();
    let nuisance = model.parameters - model.term_parameters;
    let n = base + nuisance;
    let mut beta = model.nominal();
    beta[..base].copy_from_slice(&fit.beta[..base]);
    beta[base + extra..].copy_from_slice(&fit.beta[base..]);

    let part = Part { model: &model, readings: &session.readings, weights: Some(&session.weights) };
    let noise = Noise { sigma: fit.noise.sigma.clone(), play: fit.noise.play };
    let problem = Implicit::new(vec![(part, noise)], &[]);
    let squares: usize = widths.iter().map(|w| w * w).sum();
    let zero = || Sums {
        gradient: vec![Lanes::ZERO; extra],
        cross: vec![Lanes::ZERO; extra * base],
        square: vec![Lanes::ZERO; squares],
        base: vec![Lanes::ZERO; base],
        own: Vec::new(),
    };
    let visit =
        |sums: &mut Sums, group: usize, w: &[Lanes], x: &[Lanes]| sums.add(group, &widths, w, x);
    let sums = problem.sweep(&beta, zero, visit, |a, b| a.merge(&b)).unwrap_or_else(zero);

    let mut cross = Mat::from_fn(n, extra, |j, i| match j < base {
        true => sums.cross[i * base + j].sum(),
        false => 0.0,
    });
    let mut base_gradient: Vec<f64> = sums.base.iter().map(|s| s.sum()).collect();
    base_gradient.resize(n, 0.0);
    for own in &sums.own {
        let others = base + extra;
        let parameters = &model.columns()[own.group][others..];
        for (c, parameter) in parameters.iter().enumerate() {
            let row = parameter - extra;
            base_gradient[row] += own.gradient[c].sum();
            for i in 0..extra {
                cross[(row, i)] += own.gram[c * others + base + i].sum();
            }
        }
    }
    let all_absorbed = inverse * &cross;

    // Priors pull on what is fitted: at the minimum their pull balances Xᵀr.
    for prior in &fit.priors {
        for (column, slope) in prior.slopes(&fit.beta) {
            base_gradient[column] += slope * prior.off(&fit.beta);
        }
    }
    let (mut at, mut first) = (0, 0);
    let mut projected = Vec::with_capacity(named.len());
    for (instance, &width) in named.iter().zip(&widths) {
        let cross = cross.subcols(first, width);
        let absorbed = all_absorbed.subcols(first, width).to_owned();
        let raw = Mat::from_fn(width, width, |i, j| sums.square[at + i * width + j].sum());
        let square = &raw - cross.transpose() * &absorbed;
        let gradient = (0..width)
            .map(|i| {
                let pull: f64 = (0..n).map(|j| absorbed[(j, i)] * base_gradient[j]).sum();
                -(sums.gradient[first + i].sum() - pull)
            })
            .collect();
        let raw = (0..width).map(|i| raw[(i, i)]).collect();
        let typical = crate::terms::typical(&session.mechanism, instance.term, instance.target);
        projected.push(Projected { instance: *instance, square, raw, gradient, typical, absorbed });
        at += width * width;
        first += width;
    }
    Ok(projected)
}

fn scan_named(
    session: &Session,
    fit: &Fit,
    judge: &Judge,
    inverse: &Mat<f64>,
    named: &[Instance],
) -> Result<Vec<Scored>, Error> {
    let family = |i: &Instance| if i.term.info().penalised { Family::Free } else { Family::Named };
    let count = |f: Family| named.iter().filter(|i| family(i) == f).count() as f64;
    let places = [count(Family::Named), count(Family::Free)];
    let mut scored = Vec::with_capacity(named.len());
    for candidate in project(session, fit, inverse, named)? {
        let family = family(&candidate.instance);
        let (score, width, p_value) = judge_projected(&candidate, judge);
        if width > 0.0 {
            let places = places[usize::from(family == Family::Free)];
            scored.push(Scored::of(candidate.instance, family, score, width, p_value, places));
        }
    }
    Ok(scored)
}

fn share(family: Family) -> f64 {
    SHARES.iter().find(|(f, _)| *f == family).map_or(1.0, |(_, share)| *share)
}

/// Fraction of a column's length that must be left after the projection.
const VISIBLE: f64 = 1e-8;

/// Eq. (72) for one candidate: score, degrees of freedom, probability.
fn judge_projected(candidate: &Projected, judge: &Judge) -> (f64, f64, f64) {
    let d = candidate.gradient.len();
    let info = candidate.instance.term.info();
    let typical = &candidate.typical;
    // In units of the columns before the projection, so that rank is told apart.
    let norm: Vec<f64> = candidate.raw.iter().map(|r| r.max(f64::MIN_POSITIVE).sqrt()).collect();
    let held = |i: usize| {
        if info.penalised { (typical[i] * norm[i]).powi(-2) } else { 0.0 }
    };
    let square = Mat::from_fn(d, d, |i, j| {
        candidate.square[(i, j)] / (norm[i] * norm[j]) + if i == j { held(i) } else { 0.0 }
    });
    let Ok(eigen) = square.self_adjoint_eigen(Side::Lower) else { return (0.0, 0.0, 1.0) };
    let (values, vectors) = (eigen.S().column_vector(), eigen.U());
    let (mut score, mut width, mut second) = (0.0, 0.0, 0.0);
    for k in 0..d {
        if values[k] < VISIBLE {
            continue;
        }
        let along: f64 = (0..d).map(|i| vectors[(i, k)] * candidate.gradient[i] / norm[i]).sum();
        score += along * along / values[k];
        // Share of this direction that is data and not prior.
        let prior: f64 = (0..d).map(|i| vectors[(i, k)].powi(2) * held(i)).sum();
        let data = 1.0 - (prior / values[k]).min(1.0);
        width += data;
        second += data * data;
    }
    if width < 1e-6 {
        return (0.0, 0.0, 1.0);
    }
    // Satterthwaite: a weighted sum of χ² as one with fewer degrees of freedom.
    let scale = second / width;
    let dof = width / scale;
    (score, width, judge.p_value(score / scale, dof))
}

/// At most this many times are tried for a slip of one channel.
const MOST_TIMES: usize = 256;

/// Share of a column of one pose that must be left after the projection.
const SEEN: f64 = 1e-3;

/// One candidate of one column: `Zᵀr`, `ZᵀZ`, `ZᵀX`, and `ZᵀX (XᵀX)⁻¹`.
#[derive(Clone)]
struct Column {
    r: f64,
    zz: f64,
    zx: Vec<f64>,
    absorbed: Vec<f64>,
}

impl Column {
    fn new(n: usize) -> Self {
        Self { r: 0.0, zz: 0.0, zx: vec![0.0; n], absorbed: Vec::new() }
    }

    fn projected(mut self, inverse: &[f64]) -> Self {
        let along = |row: &[f64]| dot(row, &self.zx);
        self.absorbed = inverse.chunks_exact(self.zx.len().max(1)).map(along).collect();
        self
    }

    /// `M` of (71).
    fn left(&self) -> f64 {
        self.zz - dot(&self.zx, &self.absorbed)
    }

    /// `T` of (72); none where nothing of the column is left.
    fn score(&self) -> Option<f64> {
        let left = self.left();
        (left > SEEN * self.zz).then(|| self.r * self.r / left)
    }
}

pub(crate) fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Angles between the projected columns of a slip at one time and at the next.
///
/// The later column is part of the earlier one, so `ZᵢᵀZⱼ` is its own square.
fn turns(times: &[(usize, Column)]) -> Vec<f64> {
    let angle = |later: &Column, earlier: &Column| {
        let shared = later.zz - dot(&later.zx, &earlier.absorbed);
        let cosine = shared / (later.left() * earlier.left()).max(f64::MIN_POSITIVE).sqrt();
        cosine.clamp(-1.0, 1.0).acos()
    };
    times.windows(2).map(|pair| angle(&pair[0].1, &pair[1].1)).collect()
}

/// Scores of one degree of freedom below this are never named, at however few times.
const SURPRISE: f64 = 4.0;

/// Number of independent tests that tests one after another amount to, at a score:
/// neighbours score alike. Efron's length heuristic (Biometrika 84, 1997).
fn declumped(turns: &[f64], score: f64) -> f64 {
    let half = 0.5 * score.max(0.0).sqrt();
    let new = |turn: &f64| 2.0 * stats::normal_cdf(half * turn) - 1.0;
    1.0 + turns.iter().map(new).sum::<f64>()
}

/// Scores bad readings and bad poses alone.
///
/// # Errors
///
/// As [`Model::new`].
pub fn bad_readings(session: &Session, fit: &Fit, judge: &Judge) -> Result<Vec<Scored>, Error> {
    let (inverse, ..) = crate::fit::invert(&fit.gram);
    scan_places(session, fit, judge, &inverse, &["slip".to_owned()])
}

/// Scores bad readings, bad poses and slips by running sums over poses.
fn scan_places(
    session: &Session,
    fit: &Fit,
    judge: &Judge,
    inverse: &Mat<f64>,
    without: &[String],
) -> Result<Vec<Scored>, Error> {
    let (readings, n, c) = (&session.readings, fit.model.parameters, session.readings.channels);
    let part = Part { model: &fit.model, readings, weights: Some(&session.weights) };
    let noise = Noise { sigma: fit.noise.sigma.clone(), play: fit.noise.play };
    let residuals = Implicit::new(vec![(part, noise)], &[]).residuals(&fit.beta, true);
    let k = residuals.equations;
    let allowed = |id: &str| !without.iter().any(|w| w == id);
    let (slip, bad) = (find("slip")?, find("bad_reading")?);
    let has = |instance: &Instance| fit.model.instances.contains(instance);
    let rows = readings.rows_of_poses();
    let live: Vec<usize> =
        (0..rows.len()).filter(|&p| rows[p].iter().any(|&r| session.weights[r] > 0.0)).collect();
    let mut scored = Vec::new();
    let flat: Vec<f64> = (0..n * n).map(|i| inverse[(i / n, i % n)]).collect();
    let mut keep = |instance: Instance, family, places: f64, score: Option<f64>| {
        if let Some(score) = score.filter(|_| !has(&instance)) {
            let p_value = judge.p_value(score, 1.0);
            scored.push(Scored::of(instance, family, score, 1.0, p_value, places));
        }
    };
    let tests_bad = (live.len() * (c + 1)) as f64;
    let stride = live.len().div_ceil(MOST_TIMES).max(1);
    let slips =
        allowed("slip") && crate::model::provided(slip, &session.mechanism, readings).is_ok();
    let live_rows: Vec<Vec<usize>> = live
        .iter()
        .map(|&p| rows[p].iter().copied().filter(|&r| session.weights[r] > 0.0).collect())
        .collect();
    let fitted = |rows: &[usize]| {
        Mat::from_fn(rows.len() * k, n, |e, j| {
            residuals.by_parameter[(rows[e / k] * k + e % k) * n + j]
        })
    };
    // What the fit absorbs of any column of one pose: X (XᵀX)⁻¹ Xᵀ there.
    let hats: Vec<Mat<f64>> = live_rows
        .iter()
        .map(|rows| {
            let x = fitted(rows);
            &x * (inverse * x.transpose())
        })
        .collect();
    for channel in 0..c {
        let target = Target::Channel(channel);
        let (mut after, mut times) = (Column::new(n), Vec::new());
        for (order, &pose) in live.iter().enumerate().rev() {
            let (mut z, mut r) = (Vec::new(), 0.0);
            for &row in &live_rows[order] {
                for e in 0..k {
                    let value = residuals.by_reading[(row * k + e) * c + channel];
                    z.push(value);
                    r += value * residuals.whitened[row * k + e];
                }
            }
            let zz = dot(&z, &z);
            if allowed("bad_reading") {
                let instance = Instance { term: bad, target, place: pose };
                let left = zz - form(&hats[order], &z);
                let score = (left > SEEN * zz).then(|| r * r / left);
                keep(instance, Family::Bad, tests_bad, score);
            }
            if !slips {
                continue;
            }
            after.r += r;
            after.zz += zz;
            for (e, z) in z.iter().enumerate() {
                let first = (live_rows[order][e / k] * k + e % k) * n;
                let x = &residuals.by_parameter[first..first + n];
                after.zx.iter_mut().zip(x).for_each(|(s, x)| *s += z * x);
            }
            if order > 0 && order % stride == 0 {
                times.push((pose, after.clone().projected(&flat)));
            }
        }
        let turns = turns(&times);
        for (pose, column) in &times {
            let instance = Instance { term: slip, target, place: *pose };
            let score = column.score();
            // What is no surprise at one time is none at many: only surprises are paid for.
            let rare = score.is_some_and(|score| score > SURPRISE);
            let times =
                if rare { declumped(&turns, score.unwrap_or(0.0)) } else { times.len() as f64 };
            keep(instance, Family::Slip, c as f64 * times, score);
        }
    }
    if allowed("bad_reading") && readings.held {
        for (order, &pose) in live.iter().enumerate() {
            let row = rows[pose][0];
            if rows[pose].len() > 1 {
                continue; // repeats: a pose is judged where it is averaged
            }
            let r = &residuals.whitened[row * k..(row + 1) * k];
            let Some((score, width)) = left_out(&hats[order], r) else { continue };
            let p_value = judge.p_value(score, width);
            let instance = Instance { term: bad, target: Target::All, place: pose };
            scored.push(Scored::of(instance, Family::Bad, score, width, p_value, tests_bad));
        }
    }
    Ok(scored)
}

/// By how much χ² falls where all equations of a pose are left out, and how many those
/// are that the others judge: `rᵀ (I - H)⁻¹ r` where `H`, what the fit absorbs there, is not 1.
fn left_out(hat: &Mat<f64>, r: &[f64]) -> Option<(f64, f64)> {
    let left = Mat::<f64>::identity(r.len(), r.len()) - hat;
    let eigen = left.self_adjoint_eigen(Side::Lower).ok()?;
    let (values, vectors) = (eigen.S().column_vector(), eigen.U());
    let (mut score, mut width) = (0.0, 0.0);
    for k in (0..r.len()).filter(|&k| values[k] > SEEN) {
        let along: f64 = r.iter().enumerate().map(|(e, r)| vectors[(e, k)] * r).sum();
        score += along * along / values[k];
        width += 1.0;
    }
    (width > 0.0).then_some((score, width))
}

/// `zᵀ m z` of a symmetric matrix.
fn form(m: &Mat<f64>, z: &[f64]) -> f64 {
    z.iter().enumerate().map(|(j, value)| value * dot(m.col_as_slice(j), z)).sum()
}

/// True for terms whose class says that a reading is wrong, not the device.
#[must_use]
pub fn is_data(instance: &Instance) -> bool {
    instance.term.info().class == Class::Data
}

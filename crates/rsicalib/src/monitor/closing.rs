//! Whether the loops close under a result, in readings that it has not seen.
//!
//! A result that was edited, or that is of another device, opens its loops. With the whitened misclosures
//! `w` of all samples, `X` their derivatives and `P₀` the covariance of the parameters,
//!
//! ```text
//! P = (P₀⁻¹ + XᵀX)⁻¹,    μ = -P Xᵀw
//! T = μᵀ (P₀ - P)⁺ μ ~ χ²(rank (P₀ - P))                                      (107)
//! ```
//!
//! if the result holds. A result whose parameters cannot be moved to where the loops close leaves much of
//! `w + X μ` in every sample: the median over the samples is compared with chance, as a bad reading or two
//! do not speak against a result.

use crate::numerics::order;
use nalgebra::{DMatrix, DVector};

use crate::Error;
use crate::apply::earlier::{Applied, Under};
use crate::estimate::on_closures::means_under;
use crate::estimate::settle::Room;
use crate::estimate::{Implicit, Part, Residuals};
use crate::mechanism::Mechanism;
use crate::model::Want;
use crate::monitor::thresholds::{as_chi2, log_tail};
use crate::monitor::watched::internal_covariance;
use crate::numerics::distributions::f_tail;
use crate::readings::Table;

/// Directions of which the readings tell less than this share are not compared.
const TOLD: f64 = 1e-3;

/// Poses that are compared at the most, evenly spread: enough to tell, and soon done.
const MOST: usize = 200;

/// Probability that the loops of a sound device are called open: of a million uses one.
const OPEN_BY_CHANCE: f64 = 1e-6;

stated! {
    /// By so many times misclosure does not differ between poses of a session and others: the arms by
    /// which a joint moves a closure differ by less.
    pub(crate) fn times_open() -> f64 = 5.0;
}

/// How large the noise of a result is.
#[derive(Debug, Clone, Copy)]
pub struct Scale {
    /// Variance of its residual over that of its noise.
    pub residual: f64,
    /// Degrees of freedom of the noise; none where it was declared.
    pub dof: Option<f64>,
    /// Correlation of neighbouring samples.
    pub correlation: f64,
}

/// How the loops close under a result.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct Closing {
    /// Misclosure, root mean square in units of length.
    pub rms_misclosure: f64,
    /// What the noise makes of it: a result whose sensors are all too steep, or too noisy, explains
    /// any misclosure.
    pub expected_rms: f64,
    /// Probability of more by chance, if the result holds.
    pub p_value: f64,
    /// Probability of as little in the closure that closes best, if the noise of the result holds: a sensor that is
    /// said to be noisier than it is hardly counts where poses come from.
    pub p_quieter: f64,
}

/// Loops that do not close under a result as in its own session.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OpenLoops {
    /// Misclosure, root mean square in units of length.
    pub rms_misclosure: f64,
    /// The same in the session of the result, where it is known.
    pub own: Option<f64>,
    /// Probability of more by chance, if the result holds.
    pub p_value: f64,
}

impl Closing {
    /// Loops that are open, beside the misclosure of the result's own session where it is known.
    #[must_use]
    pub fn open(&self, own: Option<f64>) -> Option<OpenLoops> {
        let Self { rms_misclosure, p_value, .. } = *self;
        // What is not finite is not below anything.
        let closed =
            p_value >= OPEN_BY_CHANCE && own.is_none_or(|own| rms_misclosure < times_open() * own);
        (!closed).then_some(OpenLoops { rms_misclosure, own, p_value })
    }

    /// True where a closure closes better than the noise of the result lets it.
    #[must_use]
    pub fn quieter(&self) -> bool {
        self.p_quieter < OPEN_BY_CHANCE
    }

    /// True where the noise of a result makes more of the loops than its own session had.
    #[must_use]
    pub fn expects_more_than(&self, own: f64) -> bool {
        let within = self.expected_rms < times_open() * own;
        !within
    }
}

/// The readings that are compared: of 200 poses at the most.
#[derive(Debug)]
pub struct SomePoses {
    table: Table,
    /// True where these are all there are.
    whole: bool,
}

impl SomePoses {
    /// Those of so many samples with these labels of poses; every sample is a pose where there are none. `take`
    /// makes the table of the rows that it is given, or of all.
    pub fn of(
        pose: Option<&[i64]>,
        samples: usize,
        take: impl FnOnce(Option<&[usize]>) -> Table,
    ) -> Self {
        let begins = |row: &usize| pose.is_none_or(|p| *row == 0 || p[*row] != p[*row - 1]);
        let poses = (0..samples).filter(begins).count();
        if poses <= MOST {
            return Self { table: take(None), whole: true };
        }
        let starts: Vec<usize> = (0..samples).filter(begins).chain([samples]).collect();
        let spread = (0..MOST).map(|k| k * poses / MOST);
        let rows: Vec<usize> = spread.flat_map(|k| starts[k]..starts[k + 1]).collect();
        Self { table: take(Some(&rows)), whole: false }
    }

    /// Those of a table that has been checked, of a mechanism with so many channels.
    #[must_use]
    pub fn of_table(table: &Table, channels: usize) -> Self {
        let samples = table.values.len() / channels.max(1);
        let take = |rows: &[usize]| table.some(channels, rows);
        Self::of(table.pose.as_deref(), samples, |rows| rows.map_or_else(|| table.clone(), take))
    }
}

/// How the loops close under a result in the rows of a table that are `counted`, root mean square over all closures
/// [length unit]; none where no row counts, where no closure is of lengths, and where something is unknown beside the
/// terms, which these rows need not have touched.
///
/// # Errors
///
/// As [`crate::apply::earlier::platform_poses`]; [`Error::Shape`] unless each row is counted or not.
pub fn rms_misclosure(
    mechanism: &Mechanism,
    applied: &Applied,
    table: Table,
    counted: &[bool],
) -> Result<Option<f64>, Error> {
    let under = Under::new(mechanism, applied, table, &[])?;
    let (model, readings) = (&under.model, &under.readings);
    Error::same("counted rows", counted.len(), readings.samples)?;
    let unknown = model.parameters > model.term_parameters || model.pose_unknowns() > 0;
    if unknown || !model.is_of_lengths() || !counted.contains(&true) {
        return Ok(None);
    }
    let weights: Vec<f64> = counted.iter().map(|counted| f64::from(*counted)).collect();
    let part = Part { model, readings, weights: Some(&weights) };
    Ok(Some(part.rms_misclosure(&under.internal(&under.values))))
}

/// Compares readings with a result whose parameters have this covariance, row by row. Samples that touch
/// an unknown place which the result does not have say nothing. None where no others are left, where the readings
/// lack what a term needs, for terms that need the samples in between where only some of many are compared,
/// and for shapes of a surface, whose extent is that of the session.
///
/// # Errors
///
/// As [`crate::readings::Readings::new`]; [`Error::Shape`] for a result or a covariance of another size.
pub fn closing(
    mechanism: &Mechanism,
    applied: &Applied,
    covariance: Option<&[f64]>,
    readings: SomePoses,
    Scale { residual, dof, correlation }: Scale,
) -> Result<Option<Closing>, Error> {
    let SomePoses { table, whole } = readings;
    let mut under = match Under::new(mechanism, applied, table, &[]) {
        Err(Error::Missing { .. } | Error::Context { .. }) => return Ok(None),
        under => under?,
    };
    let closures = &under.model.closures;
    let shaped = closures.iter().any(|closure| !closure.shapes.is_empty());
    let out_of_order = !whole && under.model.instances.iter().any(|i| i.term.is_of_way());
    let used = compared(&under);
    if used.is_empty() || closures.is_empty() || shaped || out_of_order {
        return Ok(None);
    }
    let beta = under.internal(&under.values);
    let noise = under.noise.clone();
    let part = Part { model: &under.model, readings: &under.readings, weights: None };
    let samples = Loops::of(&Implicit::of(part, noise), &under, &beta, &used);
    let used = match under.readings.held {
        true => {
            average(mechanism, &mut under, &beta)?;
            compared(&under)
        }
        false => used,
    };
    let part = Part { model: &under.model, readings: &under.readings, weights: None };
    let problem = Implicit::of(part, under.noise.clone());
    let [rms_misclosure, expected_rms] = Loops::of(&problem, &under, &beta, &used).rms();
    let prior = internal_covariance(&under, covariance)?;
    let (shift, left) = moved(&problem.residuals(&beta, true), &used, &prior);
    let tail = |statistic: f64, rank: usize| {
        let statistic = statistic / residual.max(1.0);
        let statistic = dof.map_or(statistic, |dof| as_chi2(statistic, dof));
        if statistic.is_finite() { log_tail(statistic, rank as f64).exp() } else { 0.0 }
    };
    let shifted = if shift.rank > 0 { tail(shift.statistic, shift.rank) } else { 1.0 };
    let told = |row: &usize| under.model.told(&under.readings, *row);
    let mut open: Vec<f64> = left.iter().zip(&used).map(|(w, row)| tail(*w, told(row))).collect();
    order::sort(&mut open);
    let p_value = (2.0 * shifted.min(open[open.len() / 2])).min(1.0);
    let independent = ((1.0 - correlation) / (1.0 + correlation)).clamp(0.0, 1.0);
    let p_quieter = samples.p_quieter(residual.min(1.0), independent, dof);
    Ok(Some(Closing { rms_misclosure, expected_rms, p_value, p_quieter }))
}

/// Takes the mean of each pose for its samples.
///
/// In the mean of `n` samples the part of the noise that all share stays whole, and an `n`-th of the rest. How
/// much is shared is not known here: the variance is taken to fall by √n.
fn average(mechanism: &Mechanism, under: &mut Under, beta: &[f64]) -> Result<(), Error> {
    let Under { model, readings, noise, .. } = under;
    let samples = readings.samples;
    let all = (&*readings, &vec![1.0; samples][..]);
    let (means, _) = means_under(mechanism, all, (model, beta), noise)?;
    let less = (means.samples as f64 / samples as f64).powf(0.25);
    noise.sigma.iter_mut().for_each(|sigma| *sigma *= less);
    *readings = means;
    Ok(())
}

/// Rows that are compared: those in which everything unknown is the result's.
fn compared(under: &Under) -> Vec<usize> {
    let Under { model, readings, columns, .. } = under;
    let found = |column: &usize| {
        *column < model.term_parameters || columns.iter().any(|own| own.contains(column))
    };
    let known: Vec<bool> = model.columns().iter().map(|own| own.iter().all(found)).collect();
    let mut used: Vec<usize> = Vec::new();
    for meta in readings.blocks().iter().filter(|meta| known[meta.group]) {
        used.extend(meta.rows[..meta.live].iter().filter(|row| model.told(readings, **row) > 0));
    }
    used.sort_unstable();
    used
}

/// What some rows leave open of each equation, and what the noise makes of it, in units of length.
#[derive(Debug, Clone, Default)]
struct Loops {
    /// Squares of the misclosure, and variances, summed over the rows in which the equation holds.
    sums: Vec<[f64; 2]>,
    /// Rows in which it holds.
    rows: Vec<usize>,
    /// Whether the samples of a pose share a draw of its noise.
    shared: Vec<bool>,
}

impl Loops {
    fn of(problem: &Implicit<'_>, under: &Under, beta: &[f64], used: &[usize]) -> Self {
        let Under { model, readings, .. } = under;
        let lengths = model.lengths();
        let numbers = model.closures.iter().flat_map(|c| vec![c.number; c.equations()]);
        let numbers: Vec<usize> = numbers.collect();
        let counts = |row: usize| used.binary_search(&row).is_ok();
        let look = |sums: &mut Vec<[f64; 2]>, block: usize, room: &mut Room| {
            sums.resize(numbers.len(), [0.0; 2]);
            let meta = &readings.blocks()[block];
            let rows = (0..meta.live).map(|lane| (lane, meta.rows[lane]));
            let variances = room.variances();
            let bare = Want { x: false, a: false };
            model.evaluate(readings, block, readings.raw(block), beta, bare, &mut room.ws);
            for (lane, row) in rows.filter(|(_, row)| counts(*row)) {
                for (e, sum) in sums.iter_mut().enumerate() {
                    if readings.holding.holds(row, numbers[e]) {
                        sum[0] += (room.ws.f[e].0[lane] * lengths[e]).powi(2);
                        sum[1] += variances[e].0[lane] * lengths[e] * lengths[e];
                    }
                }
            }
        };
        let sums = problem.over_blocks(beta, counts, look, |all: &mut Vec<[f64; 2]>, part| {
            all.resize(numbers.len(), [0.0; 2]);
            all.iter_mut().zip(part).for_each(|(sum, more)| (0..2).for_each(|k| sum[k] += more[k]));
        });
        let held = |number: &usize| {
            used.iter().filter(|row| readings.holding.holds(**row, *number)).count()
        };
        let play = under.noise.of_closures(model).of_seating;
        Self {
            sums,
            rows: numbers.iter().map(held).collect(),
            shared: play.iter().map(|v| *v > 0.0).collect(),
        }
    }

    /// Root mean squares of the misclosure, and of what the noise makes of it.
    fn rms(&self) -> [f64; 2] {
        let rows = self.rows.iter().sum::<usize>().max(1) as f64;
        let rms = |k: usize| (self.sums.iter().map(|sum| sum[k]).sum::<f64>() / rows).sqrt();
        [rms(0), rms(1)]
    }

    /// Probability that one of the equations closes as well as the best of them beside its noise, which is
    /// known by so many degrees of freedom, where this share of the samples is independent.
    ///
    /// Closures that sit with play are left out, since their samples are one draw, and those that no row
    /// touches.
    fn p_quieter(&self, scale: f64, independent: f64, dof: Option<f64>) -> f64 {
        let counted = |e: usize| self.rows[e] as f64 * independent;
        let own = (0..self.sums.len()).filter(|e| !self.shared[*e] && counted(*e) > 0.0);
        let chance = |e: usize| {
            let ([square, variance], count) = (self.sums[e], counted(e));
            1.0 - f_tail(square / (variance * scale), count, dof.unwrap_or(f64::INFINITY))
        };
        let tests = own.clone().count().max(1) as f64;
        (own.map(chance).fold(1.0, f64::min) * tests).min(1.0)
    }
}

/// How far readings move the estimate of a result, in units of its own uncertainty.
struct Shift {
    /// `T` of (107).
    statistic: f64,
    /// Its degrees of freedom.
    rank: usize,
}

/// How far some rows move a result that is this uncertain, and the squares of what is then left in each.
fn moved(here: &Residuals, used: &[usize], prior: &DMatrix<f64>) -> (Shift, Vec<f64>) {
    let (k, p) = (here.equations, prior.nrows());
    let rows = || used.iter().flat_map(|row| row * k..(row + 1) * k);
    let w = DVector::from_iterator(used.len() * k, rows().map(|e| here.whitened[e]));
    let x = rows().flat_map(|e| &here.by_parameter[e * p..(e + 1) * p]).copied();
    let x = DMatrix::from_row_iterator(used.len() * k, p, x);
    let open = || vec![f64::INFINITY; used.len()];
    if x.iter().chain(&w).chain(prior).any(|v| !v.is_finite()) {
        return (Shift { statistic: f64::INFINITY, rank: 1 }, open());
    }

    let squares = |w: &DVector<f64>| {
        w.as_slice().chunks_exact(k).map(|w| w.iter().map(|w| w * w).sum()).collect()
    };
    // In units in which P₀ is 1, so that each direction is told by a share h/(1 + h) from 0 to 1.
    let units = root(prior);
    if units.ncols() == 0 {
        return (Shift { statistic: 0.0, rank: 0 }, squares(&w));
    }
    let along = &x * &units;
    let told = (along.transpose() * &along).symmetric_eigen();
    let pull = told.eigenvectors.transpose() * (along.transpose() * &w);
    let (mut statistic, mut rank) = (0.0, 0);
    let mut mu = DVector::zeros(pull.len());
    for (n, (&h, &pull)) in told.eigenvalues.iter().zip(&pull).enumerate() {
        let h = h.max(0.0);
        mu[n] = -pull / (1.0 + h);
        if h / (1.0 + h) > TOLD {
            statistic += pull * pull / (h * (1.0 + h));
            rank += 1;
        }
    }
    let left = w + along * (told.eigenvectors * mu);
    (Shift { statistic, rank }, squares(&left))
}

/// `U` with `U Uᵀ` a covariance, one column for each direction that is uncertain.
fn root(covariance: &DMatrix<f64>) -> DMatrix<f64> {
    let size = covariance.nrows();
    let scale = |i: usize| covariance[(i, i)].max(0.0).sqrt();
    let uncertain: Vec<usize> = (0..size).filter(|&i| scale(i) > 0.0).collect();
    let n = uncertain.len();
    if n == 0 {
        return DMatrix::zeros(size, 0);
    }
    let at = |i: usize, j: usize| covariance[(uncertain[i], uncertain[j])];
    let own = DMatrix::from_fn(n, n, |i, j| at(i, j) / (scale(uncertain[i]) * scale(uncertain[j])));
    let own = own.symmetric_eigen();
    let kept: Vec<usize> = (0..n).filter(|&k| own.eigenvalues[k] > 1e-12 * n as f64).collect();
    let mut units = DMatrix::zeros(size, kept.len());
    for (i, (column, &k)) in (0..n).flat_map(|i| kept.iter().enumerate().map(move |k| (i, k))) {
        let row = uncertain[i];
        units[(row, column)] = scale(row) * own.eigenvectors[(i, k)] * own.eigenvalues[k].sqrt();
    }
    units
}

#[cfg(test)]
mod tests {
    use super::{Applied, Error, Loops, Mechanism, Table, rms_misclosure};
    use crate::apply::earlier::{Reported, points};
    use crate::design::within_limits::within_limits;

    #[test]
    fn misclosure_is_that_of_the_distances_between_carried_points() -> Result<(), Error> {
        let rsi = Mechanism::rsi();
        let value = rsi.channels[4].offset + 1e-3;
        let off = Reported { spec: "offset@a22".into(), name: "offset".into(), value };
        let applied = Applied { parameters: vec![off], ..Applied::declared(&rsi) };
        let table = Table { values: within_limits(&rsi, 20, 3)?, ..Table::default() };
        // The first row is not counted.
        let counted: Vec<bool> = (0..table.values.len() / 9).map(|row| row > 0).collect();
        let found = rms_misclosure(&rsi, &applied, table.clone(), &counted)?;
        // Witness: where the chains carry the wrists, which are 1.5 √3 apart.
        let at = points(&rsi, &applied, table)?;
        let long = |a: &[f64; 3], b: &[f64; 3]| {
            (0..3).map(|k| (a[k] - b[k]).powi(2)).sum::<f64>().sqrt() - 1.5 * 3.0_f64.sqrt()
        };
        let of = |(i, j): (usize, usize)| {
            at[i].iter().zip(&at[j]).skip(1).map(|(a, b)| long(a, b).powi(2))
        };
        let squares: Vec<f64> = [(0, 1), (1, 2), (0, 2)].into_iter().flat_map(of).collect();
        let expected = (squares.iter().sum::<f64>() / squares.len() as f64).sqrt();
        // Of squares of distances: the error over twice the distance, a thousandth here.
        assert!(
            found.is_some_and(|rms| (rms / expected - 1.0).abs() < 2e-3),
            "{found:?} {expected}"
        );
        Ok(())
    }

    #[test]
    fn a_closure_that_no_row_touches_is_not_quiet() {
        // The table of χ²: of 10 degrees of freedom 1 in 100 is below 2.558.
        let sums = vec![[2.558, 10.0], [0.0, 0.0]];
        let loops = |shared| Loops { sums: sums.clone(), rows: vec![10, 0], shared };
        let chance = |shared| loops(shared).p_quieter(1.0, 1.0, None);
        assert!((chance(vec![false, false]) - 0.01).abs() < 1e-5);
        assert_eq!(chance(vec![true, false]), 1.0);
    }
}

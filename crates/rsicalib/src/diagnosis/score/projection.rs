//! Scores of named effects and free shapes: (71) and (72) from one sweep over the readings.

use faer::Mat;

use crate::Error;
use crate::diagnosis::price::{Said, mean};
use crate::diagnosis::score::scored::{Family, Judge, Scored};
use crate::estimate::{Fit, Implicit, Observations, Part, carry_over};
use crate::model::{Instance, Model};
use crate::numerics::lanes::Lanes;
use crate::numerics::normal_equations::{Own, add_all, add_line};
use crate::numerics::symmetric::{VISIBLE, eigenvalues};

/// ScoreSums for (71) over all candidates.
struct ScoreSums {
    /// `Zᵀr`.
    gradient: Vec<Lanes>,
    /// `ZᵀX` of the terms, candidate column by candidate column.
    cross: Vec<Lanes>,
    /// `ZᵀZ` of each block of candidates, full square, of which the upper half is filled.
    square: Vec<Lanes>,
    /// Rows of `Z` of which `ZᵀZ` has no products yet.
    waiting: Vec<Lanes>,
    /// `Xᵀr` of the terms.
    base: Vec<Lanes>,
    /// `XᵀX` of the terms, line by line, of which the lower half is filled.
    gram: Vec<Lanes>,
    /// `Xᵀr` of the unknown points of each group, and of `XᵀX`, `XᵀZ` a line for each of their columns.
    own: Vec<Own>,
}

impl ScoreSums {
    /// Adds a block, of whose columns the first `base` are fitted, the candidates'
    /// next, and those of the unknown points last.
    #[inline(always)]
    fn add(&mut self, group: usize, blocks: &[usize], w: &[Lanes], x: &[Lanes]) {
        let (base, extra, columns) = (self.base.len(), self.gradient.len(), x.len() / w.len());
        for i in 0..base {
            let line = &mut self.gram[i * base..][..=i];
            add_line(line, &mut self.base[i], w, x, columns, i);
        }
        for (i, gradient) in self.gradient.iter_mut().enumerate() {
            let line = &mut self.cross[i * base..(i + 1) * base];
            add_line(line, gradient, w, x, columns, base + i);
        }
        if columns > base + extra {
            let (points, others) = (columns - base - extra, base + extra);
            let own = Own::of(&mut self.own, group, points, points * columns);
            for (c, gradient) in own.gradient.iter_mut().enumerate() {
                let line = &mut own.gram[c * columns..][..=others + c];
                add_line(line, gradient, w, x, columns, others + c);
            }
        }
        for row in x.chunks_exact(columns) {
            self.waiting.extend_from_slice(&row[base..base + extra]);
        }
        if self.waiting.len() >= WAITING * extra {
            self.multiply(blocks);
        }
    }

    /// Adds the products of the rows that wait to `ZᵀZ`: each sum is in the cache once for all of them.
    #[inline(always)]
    fn multiply(&mut self, blocks: &[usize]) {
        let extra = self.gradient.len();
        let (mut at, mut first) = (0, 0);
        for &width in blocks {
            let square = &mut self.square[at..at + width * width];
            let whole = width / TILE * TILE;
            for i in (0..whole).step_by(TILE) {
                for j in (i..whole).step_by(TILE) {
                    add_tile(square, width, &self.waiting, extra, first, i, j);
                }
            }
            for j in whole..width {
                for i in 0..=j {
                    let mut sum = square[i * width + j];
                    for row in self.waiting.chunks_exact(extra) {
                        sum = row[first + i].mul_add(row[first + j], sum);
                    }
                    square[i * width + j] = sum;
                }
            }
            at += width * width;
            first += width;
        }
        self.waiting.clear();
    }

    /// Adds other sums, of which no row waits.
    fn merge(&mut self, other: &Self) {
        add_all(&mut self.gradient, &other.gradient);
        add_all(&mut self.cross, &other.cross);
        add_all(&mut self.square, &other.square);
        add_all(&mut self.base, &other.base);
        add_all(&mut self.gram, &other.gram);
        Own::merge(&mut self.own, &other.own);
    }
}

/// Rows of `Z` that wait for their products: of a thousand candidates they fill a cache of 2 MB.
const WAITING: usize = 24;

/// Sums that are worked on at once, along each side: they stay in registers.
const TILE: usize = 4;

/// Adds the products of some columns from `i` on with some from `j` on.
#[inline(always)]
fn add_tile(
    square: &mut [Lanes],
    width: usize,
    rows: &[Lanes],
    extra: usize,
    first: usize,
    i: usize,
    j: usize,
) {
    let mut sums = [[Lanes::ZERO; TILE]; TILE];
    for (k, sums) in sums.iter_mut().enumerate() {
        sums.copy_from_slice(&square[(i + k) * width + j..][..TILE]);
    }
    for row in rows.chunks_exact(extra) {
        let (left, right) = (&row[first + i..][..TILE], &row[first + j..][..TILE]);
        for (sums, left) in sums.iter_mut().zip(left) {
            for (sum, right) in sums.iter_mut().zip(right) {
                *sum = left.mul_add(*right, *sum);
            }
        }
    }
    for (k, sums) in sums.iter().enumerate() {
        square[(i + k) * width + j..][..TILE].copy_from_slice(sums);
    }
}

/// Projected normal equations (71) of one candidate, or of several together.
#[derive(Debug, Clone)]
pub struct Projected {
    /// `M`.
    pub square: Mat<f64>,
    /// `ZᵀZ` before the projection, its diagonal.
    pub raw: Vec<f64>,
    /// `u`.
    pub gradient: Vec<f64>,
    /// `(XᵀX)⁻¹ XᵀZ`: how the fitted parameters absorb it, with a minus.
    pub absorbed: Mat<f64>,
}

/// Eq. (71) for named candidates, each by itself.
///
/// # Errors
///
/// As [`Model::new`].
pub fn project(
    observations: &Observations,
    fit: &Fit,
    named: &[Instance],
) -> Result<Vec<Projected>, Error> {
    let widths: Vec<usize> = named.iter().map(Instance::width).collect();
    project_blocks(observations, fit, named, &widths)
}

/// Eq. (71) for named candidates in blocks of so many columns: of candidates of different
/// blocks no products are taken.
///
/// `XᵀX` is that of this linearisation. That of the fit is of readings settled by a step less, some
/// millionths of a standard deviation away, and where all equations of a pose nearly repeat each other
/// the projection takes more than that for what `X` leaves.
///
/// # Errors
///
/// As [`Model::new`].
pub fn project_blocks(
    observations: &Observations,
    fit: &Fit,
    named: &[Instance],
    blocks: &[usize],
) -> Result<Vec<Projected>, Error> {
    let model = observations.model_beside(&fit.model, named)?;
    let sums = score_sums(observations, fit, &model, blocks);
    let Products { cross, gram, mut gradient } = Products::of(fit, &model, &sums);
    let all_absorbed = fit.inverse_of(gram) * &cross;
    // Priors pull on what is fitted: at the minimum their pull balances Xᵀr.
    for prior in &fit.priors {
        for (column, slope) in prior.slopes(&fit.beta) {
            gradient[column] += slope * prior.off(&fit.beta);
        }
    }
    let (mut at, mut first) = (0, 0);
    let mut projected = Vec::with_capacity(blocks.len());
    for &width in blocks {
        let cross = cross.subcols(first, width);
        let absorbed = all_absorbed.subcols(first, width).to_owned();
        let raw =
            Mat::from_fn(width, width, |i, j| sums.square[at + i.min(j) * width + i.max(j)].sum());
        let square = &raw - cross.transpose() * &absorbed;
        let own = (0..width).map(|i| {
            let pull: f64 = gradient.iter().enumerate().map(|(j, g)| absorbed[(j, i)] * g).sum();
            -(sums.gradient[first + i].sum() - pull)
        });
        let gradient = own.collect();
        let raw = (0..width).map(|i| raw[(i, i)]).collect();
        projected.push(Projected { square, raw, gradient, absorbed });
        at += width * width;
        first += width;
    }
    Ok(projected)
}

/// `Xᵀr` and products of columns in blocks of so many, over all samples.
fn score_sums(
    observations: &Observations,
    fit: &Fit,
    model: &Model,
    blocks: &[usize],
) -> ScoreSums {
    let base = fit.model.term_parameters;
    let extra: usize = blocks.iter().sum();
    let (readings, weights) = (&observations.readings, Some(&observations.weights[..]));
    let part = Part { model, readings, weights };
    let settled = fit.adjusted_of(readings);
    let problem = Implicit::of(part, fit.assumed()).from(settled.map(<[_]>::to_vec));
    let squares: usize = blocks.iter().map(|w| w * w).sum();
    let zero = || ScoreSums {
        gradient: vec![Lanes::ZERO; extra],
        cross: vec![Lanes::ZERO; extra * base],
        square: vec![Lanes::ZERO; squares],
        waiting: Vec::new(),
        base: vec![Lanes::ZERO; base],
        gram: vec![Lanes::ZERO; base * base],
        own: Vec::new(),
    };
    let sums = problem.sweep(
        (&fit.model, &fit.beta),
        &carry_over(fit, model),
        zero,
        #[inline(always)]
        |sums: &mut ScoreSums, group, w, x| sums.add(group, blocks, w, x),
        #[inline(always)]
        |sums: &mut ScoreSums| sums.multiply(blocks),
        |a, b| a.merge(&b),
    );
    sums.unwrap_or_else(zero)
}

/// Sums over all samples of the parameters of a fit, what is unknown included.
struct Products {
    /// With each candidate's columns.
    cross: Mat<f64>,
    /// `XᵀX`.
    gram: Mat<f64>,
    /// `Xᵀr`.
    gradient: Vec<f64>,
}

impl Products {
    /// `model` is that of the fit with the candidates.
    fn of(fit: &Fit, model: &Model, sums: &ScoreSums) -> Self {
        let (base, extra) = (fit.model.term_parameters, sums.gradient.len());
        let n = base + model.parameters - model.term_parameters;
        let mut cross = Mat::from_fn(n, extra, |j, i| match j < base {
            true => sums.cross[i * base + j].sum(),
            false => 0.0,
        });
        let mut gradient: Vec<f64> = sums.base.iter().map(|s| s.sum()).collect();
        gradient.resize(n, 0.0);
        let mut gram = Mat::from_fn(n, n, |i, j| match i.max(j) < base {
            true => sums.gram[i.max(j) * base + i.min(j)].sum(),
            false => 0.0,
        });
        for own in &sums.own {
            let others = base + extra;
            let parameters = &model.columns()[own.group][others..];
            for (c, parameter) in parameters.iter().enumerate() {
                let row = parameter - extra;
                gradient[row] += own.gradient[c].sum();
                let line = &own.gram[c * (others + parameters.len())..];
                for i in 0..extra {
                    cross[(row, i)] += line[base + i].sum();
                }
                let points = parameters[..=c].iter().zip(others..).map(|(p, i)| (p - extra, i));
                for (column, i) in (0..base).map(|i| (i, i)).chain(points) {
                    gram[(row, column)] += line[i].sum();
                    gram[(column, row)] = gram[(row, column)];
                }
            }
        }
        Self { cross, gram, gradient }
    }
}

/// Scores of named candidates, (72), and of free shapes.
///
/// # Errors
///
/// As [`project`].
pub fn score(
    observations: &Observations,
    fit: &Fit,
    judge: &Judge,
    named: &[Instance],
) -> Result<Vec<Scored>, Error> {
    let projected = project(observations, fit, named)?;
    Ok(score_of(&fit.model, judge, named, &projected))
}

/// (72) of candidates with their projected normal equations.
pub fn score_of(
    model: &Model,
    judge: &Judge,
    named: &[Instance],
    projected: &[Projected],
) -> Vec<Scored> {
    let family = |i: &Instance| if i.term.info().penalised { Family::Free } else { Family::Named };
    let count = |f: Family| named.iter().filter(|i| family(i) == f).count() as f64;
    let places = [count(Family::Named), count(Family::Free)];
    let mut scored = Vec::with_capacity(named.len());
    for (instance, candidate) in named.iter().zip(projected) {
        let (score, width, p_value) = judge_projected(model, *instance, candidate, judge);
        if width > 0.0 {
            let family = family(instance);
            let places = places[usize::from(family == Family::Free)];
            let mut one = Scored::of(*instance, family, score, width, p_value, places);
            if family == Family::Free {
                one.charge = judge.said.fall(score)
                    + evidence(model, *instance, candidate, &judge.said, score);
            }
            scored.push(one);
        }
    }
    scored
}

/// Directions of a candidate that the fitted parameters do not absorb.
pub(crate) fn visible(candidate: &Projected) -> usize {
    let norm = norms(candidate);
    let d = norm.len();
    let square = Mat::from_fn(d, d, |i, j| candidate.square[(i, j)] / (norm[i] * norm[j]));
    let values = eigenvalues(square.as_ref()).map_or_else(Vec::new, |(values, _)| values);
    values.into_iter().filter(|value| *value >= VISIBLE).count()
}

/// Lengths of the columns before the projection: in these units rank is told apart.
fn norms(candidate: &Projected) -> Vec<f64> {
    candidate.raw.iter().map(|r| r.max(f64::MIN_POSITIVE).sqrt()).collect()
}

/// Eq. (72) for one candidate: score, degrees of freedom, probability.
fn judge_projected(
    model: &Model,
    instance: Instance,
    candidate: &Projected,
    judge: &Judge,
) -> (f64, f64, f64) {
    let d = candidate.gradient.len();
    let info = instance.term.info();
    let typical = model.typical_at(instance.term, instance.target);
    let norm = norms(candidate);
    let held = |i: usize| {
        if info.penalised { (typical[i] * norm[i]).powi(-2) } else { 0.0 }
    };
    let square = Mat::from_fn(d, d, |i, j| {
        candidate.square[(i, j)] / (norm[i] * norm[j]) + if i == j { held(i) } else { 0.0 }
    });
    let Some((values, vectors)) = eigenvalues(square.as_ref()) else { return (0.0, 0.0, 1.0) };
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

/// Amplitudes of a free shape that are averaged over: halvings of its typical sizes.
const HALVINGS: i32 = 12;

/// `-2 ln` of the marginal likelihood of a free shape over that of none, its amplitude any of
/// [`HALVINGS`] of its typical sizes:
///
/// ```text
/// -2 ln L(τ) = Σ ln(1 + τ² m_k) + data(χ² - R) - data(χ²),    R = Σ τ² u_k² / (1 + τ² m_k)       (117)
/// ```
///
/// with the eigenvalues `m_k` of `M` in typical sizes, and `u` along their directions, in units of the noise
/// as large as it may be beside a shape of this score.
fn evidence(
    model: &Model,
    instance: Instance,
    candidate: &Projected,
    said: &Said,
    score: f64,
) -> f64 {
    let d = candidate.gradient.len();
    let typical = model.typical_at(instance.term, instance.target);
    let square = Mat::from_fn(d, d, |i, j| candidate.square[(i, j)] * typical[i] * typical[j]);
    let gradient: Vec<f64> = candidate.gradient.iter().zip(&typical).map(|(u, t)| u * t).collect();
    let raw: Vec<f64> = candidate.raw.iter().zip(&typical).map(|(r, t)| r * t * t).collect();
    averaged(&square, &gradient, &raw, said, score)
}

/// (117) of `M` and `u` in typical sizes, and the diagonal of `ZᵀZ`: a direction that is fitted already
/// tells nothing.
fn averaged(square: &Mat<f64>, gradient: &[f64], raw: &[f64], said: &Said, score: f64) -> f64 {
    let Some((values, vectors)) = eigenvalues(square.as_ref()) else { return 0.0 };
    let d = gradient.len();
    let along = |k: usize| (0..d).map(|i| vectors[(i, k)] * gradient[i]).sum::<f64>();
    let whole = |k: usize| (0..d).map(|i| vectors[(i, k)].powi(2) * raw[i]).sum::<f64>();
    let seen = (0..d).filter(|k| values[*k] > VISIBLE * whole(*k));
    let pairs: Vec<[f64; 2]> = seen.map(|k| [values[k], along(k).powi(2)]).collect();
    let scale = said.scale(score);
    let of = |tau2: f64| -> f64 {
        let tau2 = scale * tau2;
        let volume: f64 = pairs.iter().map(|[m, _]| (tau2 * m).ln_1p()).sum();
        let fall: f64 = pairs.iter().map(|[m, square]| tau2 * square / (1.0 + tau2 * m)).sum();
        volume - said.fall(fall)
    };
    mean((0..HALVINGS).map(|k| (of(0.25_f64.powi(k)), 1.0)))
}

#[cfg(test)]
mod tests {
    use faer::Mat;
    use nalgebra::{DMatrix, DVector};

    use super::{HALVINGS, averaged};
    use crate::diagnosis::price::{Data, Said, Scale};

    #[test]
    fn a_free_shape_costs_what_the_density_of_the_residuals_says() {
        let odd = |i: usize, j: usize| ((1 + i * i + 7 * i * j + j) as f64).sin();
        let z = DMatrix::from_fn(14, 3, |i, j| 3.0 * odd(i, j));
        let r = DVector::from_fn(14, |i, _| 2.0 * odd(i, 7) + z[(i, 1)]);
        let (m, u) = (z.transpose() * &z, z.transpose() * &r);
        let raw: Vec<f64> = m.diagonal().iter().copied().collect();
        let data = Data { scale: Scale::Known(f64::INFINITY), dof: 14.0 };
        let said = Said { data, chi2: r.norm_squared(), larger_noise: true };
        let square = Mat::from_fn(3, 3, |i, j| m[(i, j)]);
        let got = averaged(&square, u.as_slice(), &raw, &said, 0.0);
        // By the inverse and the determinant of the whole covariance, at each amplitude.
        let ratios = (0..HALVINGS).map(|k| {
            let cover = DMatrix::identity(14, 14) + &z * z.transpose() * 0.25_f64.powi(k);
            let log = cover.determinant().ln();
            let inverse = cover.try_inverse().expect("an inverse");
            (-0.5 * (log + (r.transpose() * inverse * &r)[(0, 0)] - r.norm_squared())).exp()
        });
        let wanted = -2.0 * (ratios.sum::<f64>() / f64::from(HALVINGS)).ln();
        assert!((got - wanted).abs() < 1e-9 * wanted.abs(), "{got} for {wanted}");
    }
}

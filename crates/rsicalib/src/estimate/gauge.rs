//! Directions that no reading could ever show, told from those that other poses could tell.
//!
//! The data leave the combinations `N` of the parameters open. At random configurations of the same
//! device, in which the loops are closed at the estimates, those are conventions that stay open:
//!
//! ```text
//! N c with  X_g N c = 0  and  P X_t N c = 0                               (112)
//! ```
//!
//! with `X_g` at the unknown points that were touched, `X_t` the columns of the device at unknown
//! points elsewhere, and `P` the projection that leaves the places of these free. A turn of an arm
//! about its first axis, together with all that it touches, is such a direction: a drawing says
//! where the first joint is at zero, and no reading does.

use faer::linalg::solvers::Svd;
use faer::{Mat, Side};

use crate::Error;
use crate::estimate::conventions::foreign;
use crate::estimate::fitted::Fit;
use crate::estimate::observations::Observations;
use crate::model::Model;
use crate::model::configurations::Configurations;
use crate::numerics::random::Random;
use crate::numerics::rank::eliminated;
use crate::readings::Readings;

/// Relative eigenvalues of a Gram matrix with unit columns below this are zero.
pub(crate) const NOTHING: f64 = 1e-11;

/// A convention shows less than this part of what its parameters would, did they not cancel: the
/// root of [`NOTHING`], which is how well the data tell a direction, with room for condition; less than
/// ten times the part that the misclosure is of the machine, where that is more.
const SHOWN: f64 = 1e-4;

/// The part of a direction that a parameter must have to take part in it.
const PART: f64 = 1e-3;

/// Combinations of parameters that data leave open, as columns.
#[derive(Debug, Clone)]
pub(crate) struct Parted {
    /// No reading could show these.
    pub conventions: Mat<f64>,
    /// Other poses could tell these.
    pub open: Mat<f64>,
}

/// Parts what the data of a fit leave open, by (112); everything is for other poses to tell where
/// no random configurations are found that close.
///
/// `kept` are the parameters that count.
pub(crate) fn parted(observations: &Observations, fit: &Fit, kept: &[usize]) -> Parted {
    let left = left_open(&fit.gram, kept);
    if left.ncols() == 0 {
        return Parted { conventions: left.clone(), open: left };
    }
    // Only what acts in all poses alike acts at random configurations as it does here.
    let foreign = foreign(&fit.model);
    let own: Vec<usize> = (0..left.ncols())
        .filter(|&k| {
            let largest = (0..left.nrows()).map(|i| left[(i, k)].abs()).fold(0.0, f64::max);
            foreign.iter().all(|&i| left[(i, k)].abs() <= PART * largest)
        })
        .collect();
    let columns =
        |wanted: &[usize]| Mat::from_fn(left.nrows(), wanted.len(), |i, k| left[(i, wanted[k])]);
    let candidates = columns(&own);
    let Ok(Some(Parted { conventions: blind, open: seen })) =
        unseen(observations, fit, &candidates)
    else {
        return Parted { conventions: Mat::zeros(left.nrows(), 0), open: left };
    };
    let others: Vec<usize> = (0..left.ncols()).filter(|k| !own.contains(k)).collect();
    let others = columns(&others);
    let open = Mat::from_fn(left.nrows(), seen.ncols() + others.ncols(), |i, k| {
        if k < seen.ncols() { seen[(i, k)] } else { others[(i, k - seen.ncols())] }
    });
    Parted { conventions: blind, open }
}

/// Combinations of parameters that a Gram matrix leaves open, in the parameters' units.
fn left_open(gram: &Mat<f64>, kept: &[usize]) -> Mat<f64> {
    let n = gram.nrows();
    let norms: Vec<f64> = (0..n).map(|i| gram[(i, i)].max(0.0).sqrt()).collect();
    let seen = |i: &usize| norms[*i] > 0.0 && norms[*i].is_finite();
    let (live, absent): (Vec<usize>, Vec<usize>) = kept.iter().partition(|i| seen(i));
    let mut columns: Vec<Vec<f64>> =
        absent.iter().map(|&p| (0..n).map(|i| f64::from(u8::from(i == p))).collect()).collect();
    let unit = Mat::from_fn(live.len(), live.len(), |i, j| {
        gram[(live[i], live[j])] / (norms[live[i]] * norms[live[j]])
    });
    if let (Some(last), Ok(eigen)) =
        (live.len().checked_sub(1), unit.self_adjoint_eigen(Side::Lower))
    {
        let (values, vectors) = (eigen.S().column_vector(), eigen.U());
        for k in (0..live.len()).filter(|&k| values[k] < NOTHING * values[last]) {
            let mut column = vec![0.0; n];
            live.iter().enumerate().for_each(|(i, &p)| column[p] = vectors[(i, k)] / norms[p]);
            columns.push(column);
        }
    }
    Mat::from_fn(n, columns.len(), |i, k| columns[k][i])
}

/// Combinations of `candidates` that no reading shows, and the others; none where that cannot be
/// told.
fn unseen(
    observations: &Observations,
    fit: &Fit,
    candidates: &Mat<f64>,
) -> Result<Option<Parted>, Error> {
    let m = candidates.ncols();
    if m == 0 {
        return Ok(Some(Parted { conventions: candidates.clone(), open: candidates.clone() }));
    }
    let mut random = Random::new(0);
    let touched =
        Configurations::of_keys(&observations.mechanism, observations.readings.groups.clone());
    let mut shown = vec![at(&touched, fit, candidates, 4 + m, &mut random, false)?];
    if !fit.model.unknowns.is_empty() {
        let elsewhere = Configurations::new(&observations.mechanism, &mut random)?;
        shown.push(at(&elsewhere, fit, candidates, 6 + m, &mut random, true)?);
    }
    let rows: usize = shown.iter().flatten().map(|one| one.0.nrows()).sum();
    let mut all = Mat::zeros(rows, m);
    let mut by = vec![0.0_f64; m];
    let mut first = 0;
    for (y, most) in shown.into_iter().flatten() {
        for k in 0..m {
            by[k] = by[k].max(most[k]);
            (0..y.nrows()).for_each(|i| all[(first + i, k)] = y[(i, k)]);
        }
        first += y.nrows();
    }
    if rows < m {
        return Ok(None);
    }
    let by: Vec<f64> = by.iter().map(|b| if *b > 0.0 { b.recip() } else { 1.0 }).collect();
    let y = Mat::from_fn(rows, m, |i, k| all[(i, k)] * by[k]);
    let Ok(svd) = Svd::new_thin(y.as_ref()) else { return Ok(None) };
    let (values, v) = (svd.S().column_vector(), svd.V());
    let shown = SHOWN.max(10.0 * fit.rms_misclosure / touched.reach());
    let (seen, blind): (Vec<usize>, Vec<usize>) = (0..m).partition(|&k| values[k] > shown);
    let made = |wanted: &[usize]| {
        Mat::from_fn(candidates.nrows(), wanted.len(), |i, k| {
            (0..m).map(|j| candidates[(i, j)] * by[j] * v[(j, wanted[k])]).sum()
        })
    };
    Ok(Some(Parted { conventions: made(&blind), open: made(&seen) }))
}

/// What each direction does to the closures of random configurations, and what its parameters would
/// do if they did not cancel.
type Shown = Option<(Mat<f64>, Vec<f64>)>;

/// (112) at configurations of these unknown points; `elsewhere`: at points that were not touched,
/// whose places are free.
fn at(
    configurations: &Configurations,
    fit: &Fit,
    directions: &Mat<f64>,
    each: usize,
    random: &mut Random,
    elsewhere: bool,
) -> Result<Shown, Error> {
    let under = |readings: &Readings| {
        let model = Model::like(&fit.model, configurations.mechanism(), readings)?;
        let mut beta = if elsewhere { configurations.nominal(&model) } else { model.nominal() };
        let terms = model.term_parameters;
        beta[..terms].copy_from_slice(&fit.beta[..terms]);
        for (own, there) in same_points(fit, &model).filter(|_| !elsewhere) {
            beta[own] = fit.beta[there];
        }
        Ok((model, beta))
    };
    let readings = configurations.closed_by(each, random, &under)?;
    let (model, beta) = under(&readings)?;
    let x = configurations.slopes(&model, &readings, &beta);
    let (terms, m) = (model.term_parameters, directions.ncols());
    let mut own = Mat::zeros(model.parameters, m);
    for k in 0..m {
        (0..terms).for_each(|i| own[(i, k)] = directions[(i, k)]);
        for (here, there) in same_points(fit, &model).filter(|_| !elsewhere) {
            own[(here, k)] = directions[(there, k)];
        }
    }
    let norms: Vec<f64> = x.col_iter().map(|column| column.norm_l2()).collect();
    let most =
        (0..m).map(|k| norms.iter().enumerate().map(|(i, n)| n * own[(i, k)].abs()).sum::<f64>());
    let most: Vec<f64> = most.collect();
    let y = &x * &own;
    let unknown = match elsewhere {
        true => x.subcols(terms, model.parameters - terms).to_owned(),
        false => Mat::zeros(x.nrows(), 0),
    };
    Ok(eliminated(y, &unknown).map(|y| (y, most)))
}

/// Parameters of the unknown points that a model shares with a fit: of both.
fn same_points<'a>(fit: &'a Fit, model: &'a Model) -> impl Iterator<Item = (usize, usize)> + 'a {
    model.unknowns.iter().flat_map(|one| {
        let same = fit.model.unknowns.iter().find(|u| u.thing == one.thing && u.keys == one.keys);
        let first = |there: usize, k: usize| {
            (model.term_parameters + one.first + k, fit.model.term_parameters + there + k)
        };
        same.into_iter().flat_map(move |there| (0..one.width).map(move |k| first(there.first, k)))
    })
}

//! Scores of what may stand in place of a fitted effect, at the fit with it.
//!
//! Where an effect is large the fit without it is bent far off, and what explains as much may score
//! little there. At the fit with it, the effect's columns `O`, projected off the other ones, have the square `S`
//! and its parameters the values `b`. Without it, to first order, χ² is larger by `bᵀSb`, and of that, and of
//! the rest, a candidate in its place explains
//!
//! ```text
//! M' = M + AᵀSA,    u' = u + AᵀSb,    T' = u'ᵀ M'⁻¹ u'                              (119)
//! ```
//!
//! with `M` and `u` of (71) beside the effect, and `A` the share of a candidate that the effect absorbs.

use faer::Mat;

use crate::Error;
use crate::diagnosis::score::candidates::candidates;
use crate::diagnosis::score::projection::{Projected, project, score_of};
use crate::diagnosis::score::scored::{Judge, Scored};
use crate::estimate::{Fit, Observations};
use crate::model::Instance;
use crate::numerics::symmetric::invert;

/// By how much χ² rises without a fitted effect, to first order, and the scores of named effects and
/// free shapes in its place.
///
/// # Errors
///
/// As [`project`].
pub fn instead(
    observations: &Observations,
    fit: &Fit,
    own: &Instance,
    judge: &Judge,
    without: &[String],
) -> Result<(f64, Vec<Scored>), Error> {
    let model = &fit.model;
    let Some(at) = model.instances.iter().position(|i| i == own) else {
        return Ok((0.0, Vec::new()));
    };
    let (first, width) = (model.first[at], own.width());
    let inverse = fit.inverse();
    let variance = inverse.submatrix(first, first, width, width).to_owned();
    let (square, ..) = invert(&variance);
    let values = Mat::from_fn(width, 1, |i, _| fit.beta[first + i]);
    let pull = &square * &values;
    let named = candidates(observations, fit, without);
    let mut projected = project(observations, fit, &inverse, &named)?;
    for candidate in &mut projected {
        candidate.add(first, &square, &pull);
    }
    let rise = (values.transpose() * &pull)[(0, 0)];
    let without = Judge { said: judge.said.raised(rise), ..*judge };
    Ok((rise, score_of(observations, &without, &named, &projected)))
}

impl Projected {
    /// Without what parameters from number `first` on absorb.
    fn add(&mut self, first: usize, square: &Mat<f64>, pull: &Mat<f64>) {
        let width = self.gradient.len();
        let own = self.absorbed.submatrix(first, 0, square.nrows(), width);
        self.square += own.transpose() * square * own;
        let pull = own.transpose() * pull;
        (0..width).for_each(|i| self.gradient[i] += pull[(i, 0)]);
    }
}

#[cfg(test)]
mod tests {
    use faer::Mat;
    use nalgebra::{DMatrix, DVector};

    use crate::diagnosis::score::projection::Projected;

    /// What is left of columns, or of a residual, after least squares of others.
    fn off(x: &DMatrix<f64>, of: &DMatrix<f64>) -> DMatrix<f64> {
        let inverse = (x.transpose() * x).try_inverse().expect("an inverse");
        of - x * inverse * x.transpose() * of
    }

    #[test]
    fn what_stands_in_its_place_explains_what_least_squares_without_it_say() {
        let odd = |i: usize, j: usize| ((1 + i * i + 7 * i * j + 3 * j) as f64).sin();
        let all = DMatrix::from_fn(20, 4, odd);
        let z = DMatrix::from_fn(20, 2, |i, j| odd(i, j + 11) + all[(i, 2)]);
        let y = DMatrix::from_fn(20, 1, |i, _| odd(i, 5) + 2.0 * all[(i, 2)] - all[(i, 3)]);
        // Beside the effect, whose columns are the last two.
        let inverse = (all.transpose() * &all).try_inverse().expect("an inverse");
        let beta = &inverse * all.transpose() * &y;
        let absorbed = &inverse * all.transpose() * &z;
        let (zs, r) = (off(&all, &z), off(&all, &y));
        let faer = |m: &DMatrix<f64>| Mat::from_fn(m.nrows(), m.ncols(), |i, j| m[(i, j)]);
        let mut candidate = Projected {
            square: faer(&(zs.transpose() * &zs)),
            raw: vec![1.0; 2],
            gradient: (zs.transpose() * &r).as_slice().to_vec(),
            absorbed: faer(&absorbed),
        };
        let square = inverse.view((2, 2), (2, 2)).into_owned().try_inverse().expect("an inverse");
        let pull = &square * beta.rows(2, 2);
        candidate.add(2, &faer(&square), &faer(&pull));
        // Without the effect from the start.
        let base = all.columns(0, 2).into_owned();
        let (zs, r) = (off(&base, &z), off(&base, &y));
        let (square, gradient) =
            (zs.transpose() * &zs, DVector::from((zs.transpose() * &r).column(0)));
        for i in 0..2 {
            for j in 0..2 {
                assert!((candidate.square[(i, j)] - square[(i, j)]).abs() < 1e-12);
            }
            assert!((candidate.gradient[i] - gradient[i]).abs() < 1e-12);
        }
        let rise = (beta.rows(2, 2).transpose() * pull)[(0, 0)];
        let wanted = r.norm_squared() - off(&all, &y).norm_squared();
        assert!((rise - wanted).abs() < 1e-12 * wanted, "{rise} for {wanted}");
    }
}

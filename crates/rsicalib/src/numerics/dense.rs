//! A least-squares problem given by its residuals and their Jacobian.

use faer::Mat;
use faer::linalg::solvers::Qr;

use crate::numerics::linearization::{Curvature, Linearization, Problem};

/// A problem given by its residuals and their Jacobian.
#[derive(Debug, Clone)]
pub struct Dense<R, J> {
    residuals: usize,
    parameters: usize,
    residual: R,
    jacobian: J,
}

impl<R, J> Dense<R, J>
where
    R: Fn(&[f64], &mut [f64]),
    J: Fn(&[f64], &mut [f64]),
{
    /// `m` residuals of `n` parameters. `residual(x, r)` fills `m` numbers; `jacobian(x, j)` fills
    /// `m × n` numbers, column by column.
    pub const fn new(m: usize, n: usize, residual: R, jacobian: J) -> Self {
        Self { residuals: m, parameters: n, residual, jacobian }
    }
}

impl<R, J> Problem for Dense<R, J>
where
    R: Fn(&[f64], &mut [f64]),
    J: Fn(&[f64], &mut [f64]),
{
    fn parameters(&self) -> usize {
        self.parameters
    }

    fn linearize(&self, x: &[f64]) -> Linearization {
        let (m, n) = (self.residuals, self.parameters);
        let mut r = vec![0.0; m];
        (self.residual)(x, &mut r);
        let cost = 0.5 * r.iter().map(|r| r * r).sum::<f64>();
        let mut j = vec![0.0; m * n];
        (self.jacobian)(x, &mut j);
        let cost = if j.iter().all(|v| v.is_finite()) { cost } else { f64::NAN };
        let column = |k: usize| &j[k * m..(k + 1) * m];
        let gradient: Vec<f64> =
            (0..n).map(|k| column(k).iter().zip(&r).map(|(j, r)| j * r).sum()).collect();
        if !cost.is_finite() || m == 0 || n == 0 {
            let curvature = Curvature::Gram(Mat::zeros(n, n));
            return Linearization { cost, gradient, curvature, islands: Vec::new() };
        }
        let j = Mat::from_fn(m, n, |row, col| j[col * m + row]);
        let qr = Qr::new(j.as_ref());
        let factor = qr.thin_R().to_owned();
        let rhs = Mat::from_fn(m, 1, |i, _| r[i]);
        let qtr = qr.compute_thin_Q().transpose() * rhs;
        let qtr = (0..qtr.nrows()).map(|i| qtr[(i, 0)]).collect();
        let curvature = Curvature::Factor(factor, qtr);
        Linearization { cost, gradient, curvature, islands: Vec::new() }
    }
}

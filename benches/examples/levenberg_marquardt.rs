//! A worker of `python benches/peers`: the `levenberg-marquardt` crate on the residual and the
//! Jacobian of [`Paper`]. The protocol is that of `problem.h`.
#![expect(clippy::unwrap_used, reason = "a bench stops at a mistake")]

use std::cell::Cell;
use std::io::BufRead;
use std::time::{Duration, Instant};

use levenberg_marquardt::{LeastSquaresProblem, LevenbergMarquardt};
use nalgebra::{DMatrix, DVector, Dyn, Owned};
use rsicalib::Mechanism;
use rsicalib::estimate::paper::Paper;

fn main() {
    let mut lines = std::io::stdin().lock().lines().map(|line| line.unwrap());
    let numbers: Vec<f64> =
        lines.next().unwrap().split_whitespace().map(|word| word.parse().unwrap()).collect();
    let (start, counts) = numbers[1..].split_at(18);
    let mechanism = Mechanism::rsi();
    let solver = LevenbergMarquardt::new().with_xtol(1e-8).with_ftol(1e-15).with_gtol(1e-15);
    for line in lines {
        let end = Instant::now() + Duration::from_secs_f64(line.trim().parse().unwrap());
        let mut best = f64::INFINITY;
        let found = loop {
            let before = Instant::now();
            let paper = Paper::new(&mechanism, counts).unwrap();
            let x = DVector::from_column_slice(start);
            let (found, _) = solver.minimize(Rival { paper, x, linearizations: Cell::new(0) });
            best = best.min(before.elapsed().as_secs_f64());
            if Instant::now() > end {
                break found;
            }
        };
        let x: Vec<String> = found.x.iter().map(f64::to_string).collect();
        println!("{best:e} {} {}", found.linearizations.get(), x.join(" "));
    }
}

struct Rival {
    paper: Paper,
    x: DVector<f64>,
    linearizations: Cell<usize>,
}

impl LeastSquaresProblem<f64, Dyn, Dyn> for Rival {
    type ResidualStorage = Owned<f64, Dyn>;
    type JacobianStorage = Owned<f64, Dyn, Dyn>;
    type ParameterStorage = Owned<f64, Dyn>;

    fn set_params(&mut self, x: &DVector<f64>) {
        self.x.copy_from(x);
    }

    fn params(&self) -> DVector<f64> {
        self.x.clone()
    }

    fn residuals(&self) -> Option<DVector<f64>> {
        let x = self.x.as_slice();
        Some(DVector::from_vec(self.paper.misclosure(&x[..9], &x[9..]).ok()?))
    }

    fn jacobian(&self) -> Option<DMatrix<f64>> {
        self.linearizations.set(self.linearizations.get() + 1);
        let x = self.x.as_slice();
        let j = self.paper.jacobian(&x[..9], &x[9..]).ok()?;
        Some(DMatrix::from_row_slice(j.len() / 18, 18, &j))
    }
}

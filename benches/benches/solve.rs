//! A whole algebraic fit from the nominal start, by number of poses.
//!
//! The rival is the `levenberg-marquardt` crate on the same residual and Jacobian.

use divan::{Bencher, black_box};
use levenberg_marquardt::{LeastSquaresProblem, LevenbergMarquardt};
use nalgebra::{DMatrix, DVector, Dyn, Owned};
use rsicalib::estimate::paper::Paper;
use rsicalib::numerics::lm::SolverOptions;
use rsicalib_benches::hand_controller;

fn main() {
    divan::main();
}

const POSES: [usize; 3] = [12, 200, 2_000];

#[divan::bench(args = POSES)]
fn rsicalib(bencher: Bencher, poses: usize) {
    let device = hand_controller(poses);
    let (offsets, gains) = device.nominal();
    let options = SolverOptions { xtol: 1e-10, ..SolverOptions::default() };
    agrees(poses);
    bencher.bench_local(|| {
        let paper = Paper::new(&device.mechanism, black_box(&device.counts)).unwrap();
        paper.minimize(&offsets, &gains, &options).unwrap()
    });
}

/// The rival: the same functions under another crate's solver.
#[divan::bench(args = POSES)]
fn levenberg_marquardt_crate(bencher: Bencher, poses: usize) {
    let device = hand_controller(poses);
    let rival = Rival::new(&device);
    let solver = LevenbergMarquardt::new().with_xtol(1e-10);
    bencher.bench_local(|| solver.minimize(black_box(rival.clone())));
}

/// The answer is checked before it is timed.
fn agrees(poses: usize) {
    let device = hand_controller(poses);
    let (offsets, gains) = device.nominal();
    let paper = Paper::new(&device.mechanism, &device.counts).unwrap();
    let ours = paper
        .minimize(&offsets, &gains, &SolverOptions { xtol: 1e-12, ..SolverOptions::default() })
        .unwrap();
    let (rival, _) = LevenbergMarquardt::new().with_xtol(1e-12).minimize(Rival::new(&device));
    for (a, b) in ours.offsets.iter().chain(&ours.gains).zip(rival.x.iter()) {
        assert!((a - b).abs() <= 1e-8 * a.abs(), "{a} {b}");
    }
}

#[derive(Clone)]
struct Rival {
    paper: Paper,
    x: DVector<f64>,
}

impl Rival {
    fn new(device: &rsicalib_benches::Device) -> Self {
        let (offsets, gains) = device.nominal();
        let x = DVector::from_iterator(18, offsets.into_iter().chain(gains));
        Self { paper: Paper::new(&device.mechanism, &device.counts).unwrap(), x }
    }
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
        let x = self.x.as_slice();
        let j = self.paper.jacobian(&x[..9], &x[9..]).ok()?;
        Some(DMatrix::from_row_slice(j.len() / 18, 18, &j))
    }
}

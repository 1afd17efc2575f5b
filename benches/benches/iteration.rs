//! One linearisation of the parameters' terms at offsets and gains, per number of poses: the implicit
//! loop (51) against the paper's least squares (11), and the hand controller against a serial arm.
#![expect(clippy::unwrap_used, reason = "a bench stops at a mistake")]

use divan::{Bencher, black_box};
use rsicalib::estimate::{Algebraic, Implicit, Noise, Part};
use rsicalib::model::{Model, Want, Workspace};
use rsicalib::numerics::linearization::Problem;
use rsicalib::{Observations, fit};
use rsicalib_benches::{arm, hand_controller};

fn main() {
    divan::main();
}

const POSES: [usize; 3] = [24, 96, 512];

/// The model of a session, and two parameters a tenth of a standard deviation apart: those of two
/// iterations of a fit.
fn fitted(session: &Observations) -> (Model, [Vec<f64>; 2]) {
    let found = fit(session, session.instances().unwrap(), None).unwrap();
    let sd = |k: usize| found.covariance[(k, k)].sqrt();
    let other = found.beta.iter().enumerate().map(|(k, beta)| beta + 0.1 * sd(k)).collect();
    (Model::clone(&found.model), [found.beta, other])
}

fn linearize(bencher: Bencher, problem: &impl Problem, betas: &[Vec<f64>; 2]) {
    let mut turn = 0;
    bencher.bench_local(|| {
        turn = 1 - turn;
        problem.linearize(black_box(&betas[turn]))
    });
}

/// Readings settle anew at each, as in a fit.
#[divan::bench(args = POSES)]
fn implicit_loop(bencher: Bencher, poses: usize) {
    let session = hand_controller(poses).session();
    let (model, betas) = fitted(&session);
    let part = Part { model: &model, readings: &session.readings, weights: None };
    let noise = Noise::declared(vec![1.0; 9]);
    linearize(bencher, &Implicit::new(vec![(part, noise)], &[]), &betas);
}

/// The rival: the implicit loop may take 2.5 times as long.
#[divan::bench(args = POSES)]
fn algebraic(bencher: Bencher, poses: usize) {
    let session = hand_controller(poses).session();
    let (model, betas) = fitted(&session);
    let part = Part { model: &model, readings: &session.readings, weights: None };
    linearize(bencher, &Algebraic::new(part, &[]), &betas);
}

/// One evaluation, with derivatives by parameters and readings.
fn evaluate(bencher: Bencher, session: &Observations) {
    let instances = session.instances().unwrap();
    let model = Model::new(&session.mechanism, &session.readings, instances).unwrap();
    let beta = vec![1e-3; model.parameters];
    let mut ws = Workspace::default();
    bencher.bench_local(|| {
        for block in 0..session.readings.blocks().len() {
            let (a, want) = (session.readings.raw(block), Want { x: true, a: true });
            model.evaluate(&session.readings, block, a, black_box(&beta), want, &mut ws);
        }
    });
}

/// Nine joints, three chains of three.
#[divan::bench(args = POSES)]
fn evaluation_of_nine_joints(bencher: Bencher, poses: usize) {
    evaluate(bencher, &hand_controller(poses).session());
}

/// Seven joints in one chain: of each joint it may take four times as long.
#[divan::bench(args = POSES)]
fn evaluation_of_an_arm(bencher: Bencher, poses: usize) {
    evaluate(bencher, &arm(7, poses));
}

//! One linearisation of the paper's problem, by number of poses: analytic
//! derivatives against central differences of the same misclosure.
#![expect(clippy::unwrap_used, reason = "a bench stops at a mistake")]

use divan::{Bencher, black_box};
use rsicalib::estimate::paper::Paper;
use rsicalib_benches::hand_controller;

fn main() {
    divan::main();
}

const POSES: [usize; 3] = [12, 500, 5_000];

#[divan::bench(args = POSES)]
fn normal_equations(bencher: Bencher, poses: usize) {
    let device = hand_controller(poses);
    let paper = Paper::new(&device.mechanism, &device.counts).unwrap();
    let (offsets, gains) = device.nominal();
    bencher.bench_local(|| paper.linearization(black_box(&offsets), &gains).unwrap());
}

#[divan::bench(args = POSES)]
fn analytic_jacobian(bencher: Bencher, poses: usize) {
    let device = hand_controller(poses);
    let paper = Paper::new(&device.mechanism, &device.counts).unwrap();
    let (offsets, gains) = device.nominal();
    bencher.bench_local(|| paper.jacobian(black_box(&offsets), &gains).unwrap());
}

/// The rival: what the analytic Jacobian has to beat.
#[divan::bench(args = POSES)]
fn central_differences(bencher: Bencher, poses: usize) {
    let device = hand_controller(poses);
    let paper = Paper::new(&device.mechanism, &device.counts).unwrap();
    let (offsets, gains) = device.nominal();
    let start: Vec<f64> = offsets.into_iter().chain(gains).collect();
    bencher.bench_local(|| {
        let mut columns = Vec::with_capacity(18);
        for i in 0..18 {
            let step = 1e-6 * start[i].abs();
            let at = |sign: f64| {
                let mut x = start.clone();
                x[i] += sign * step;
                paper.misclosure(&x[..9], &x[9..]).unwrap()
            };
            let (up, down) = (at(1.0), at(-1.0));
            columns.push(
                up.iter().zip(&down).map(|(u, d)| (u - d) / (2.0 * step)).collect::<Vec<_>>(),
            );
        }
        black_box(columns)
    });
}

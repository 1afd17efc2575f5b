//! A whole fit with its statistics: maximum likelihood against the paper's least squares.

use divan::{Bencher, black_box};
use rsicalib::estimate::Method;
use rsicalib::fit;
use rsicalib_benches::hand_controller;

fn main() {
    divan::main();
}

const POSES: [usize; 3] = [24, 192, 4_000];

#[expect(clippy::unwrap_used, reason = "a bench stops at a mistake")]
fn run(bencher: Bencher, poses: usize, method: Method) {
    let mut session = hand_controller(poses).session();
    session.options.method = method;
    let instances = session.instances().unwrap();
    bencher.bench_local(|| fit(black_box(&session), instances.clone(), None).unwrap());
}

#[divan::bench(args = POSES)]
fn implicit_loop(bencher: Bencher, poses: usize) {
    run(bencher, poses, Method::ImplicitLoop);
}

/// The rival: the objective of the paper, same statistics behind it.
#[divan::bench(args = POSES)]
fn algebraic(bencher: Bencher, poses: usize) {
    run(bencher, poses, Method::Algebraic);
}

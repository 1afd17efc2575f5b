//! Levenberg–Marquardt against NIST's certified minima, and against what goes wrong.

use std::sync::atomic::{AtomicUsize, Ordering};

use crate::nist::{self, Strd, digits};
use rsicalib::numerics::dense::Dense;
use rsicalib::numerics::lm::{self, Outcome, SolverOptions, Termination};

/// Tight enough for six digits of the slowest problem (Bennett5).
fn tight() -> SolverOptions {
    SolverOptions {
        gtol: 1e-12,
        xtol: 1e-12,
        ftol: 1e-15,
        max_iterations: 2000,
        ..SolverOptions::default()
    }
}

// --- NIST StRD -----------------------------------------------------------

/// The problems and starts (from 1) on which MINPACK itself fails, as `nist/minpack.py` found:
/// from there it steps on to a plateau, `b2 = 88`, where no residual depends on `b2` any more.
const MINPACK_FAILS: [(&str, usize); 1] = [("BoxBOD", 1)];

/// The digits that two correct solvers share of the residual sum of squares.
///
/// Lanczos1's data were computed from the model and rounded to 13 digits: its residuals are
/// 9e-14, and a double's rounding of `y`, of three exponentials and of their sum is up to 1e-15
/// of that. The sum of squares then errs by up to `2 · 1e-15 / 9e-14`, or 2.5 %.
fn digits_of_rss(problem: &Strd) -> f64 {
    match problem.name {
        "Lanczos1" => -(0.025_f64).log10(),
        _ => 6.0,
    }
}

fn solve(problem: &Strd, start: &[f64]) -> Outcome {
    let dense = Dense::new(
        problem.rows(),
        problem.parameters(),
        |b: &[f64], r: &mut [f64]| problem.residuals(b, r),
        |b: &[f64], j: &mut [f64]| problem.jacobian(b, j),
    );
    lm::minimize(&dense, start, &tight())
}

/// Runs all problems from the starts that MINPACK manages, and fails with all complaints at once.
fn check_all(complaints: impl Fn(&Strd, &Outcome) -> Vec<String>) {
    let mut all = Vec::new();
    for problem in &nist::ALL {
        for (start, number) in problem.starts.iter().zip(1..) {
            if MINPACK_FAILS.contains(&(problem.name, number)) {
                continue;
            }
            let outcome = solve(problem, start);
            for complaint in complaints(problem, &outcome) {
                all.push(format!(
                    "{} from start {number}, {:?} after {}: {complaint}",
                    problem.name, outcome.termination, outcome.iterations
                ));
            }
        }
    }
    assert!(all.is_empty(), "\n{}", all.join("\n"));
}

#[test]
fn a_step_that_promises_less_than_is_looked_for_ends_the_search_before_it() {
    let misra = nist::ALL.iter().find(|problem| problem.name == "Misra1a").expect("listed");
    for start in misra.starts {
        let exact = solve(misra, start);
        let options = SolverOptions { ptol: 1e-3 * exact.cost, ..tight() };
        let dense = Dense::new(
            misra.rows(),
            misra.parameters(),
            |b: &[f64], r: &mut [f64]| misra.residuals(b, r),
            |b: &[f64], j: &mut [f64]| misra.jacobian(b, j),
        );
        let outcome = lm::minimize(&dense, start, &options);
        assert_eq!(outcome.termination, Termination::Cost);
        assert!(outcome.iterations < exact.iterations);
        // Near the minimum the promise is what is left, to a part of it.
        assert!(outcome.cost < (1.0 + 2e-3) * exact.cost);
    }
}

/// As an earlier fit may leave parameters that nothing has moved.
#[test]
fn a_start_of_nearly_nothing_is_as_good_as_zero() {
    let line = Dense::new(
        5,
        2,
        |b: &[f64], r: &mut [f64]| {
            r.iter_mut().zip(0..).for_each(|(r, i)| *r = b[0] + b[1] * f64::from(i) - 7.0);
        },
        |_: &[f64], j: &mut [f64]| {
            j.copy_from_slice(&[1.0, 1.0, 1.0, 1.0, 1.0, 0.0, 1.0, 2.0, 3.0, 4.0]);
        },
    );
    let outcome = lm::minimize(&line, &[1e-57, -1e-57], &tight());
    assert!((outcome.x[0] - 7.0).abs() < 1e-12 && outcome.x[1].abs() < 1e-12, "{:?}", outcome.x);
}

/// A complaint for each number that has fewer than `needed` of its certified digits.
fn disagreements(what: &str, found: &[f64], certified: &[f64], needed: f64) -> Vec<String> {
    found
        .iter()
        .zip(certified)
        .zip(1..)
        .filter(|((found, certified), _)| digits(**found, **certified) < needed)
        .map(|((found, certified), k)| format!("{what}{k} is {found:e}, certified {certified:e}"))
        .collect()
}

#[test]
fn the_certified_parameters_are_found_from_both_starts() {
    check_all(|problem, outcome| disagreements("b", &outcome.x, problem.certified, 6.0));
}

#[test]
fn the_certified_sums_of_squares_are_found_from_both_starts() {
    check_all(|problem, outcome| {
        let found = [2.0 * outcome.cost];
        disagreements("rss", &found, &[problem.rss], digits_of_rss(problem))
    });
}

#[test]
fn the_certified_standard_deviations_follow_from_the_covariance() {
    check_all(|problem, outcome| {
        let Some(covariance) = outcome.linearization.covariance() else {
            return vec!["there is no covariance".into()];
        };
        let freedom = (problem.rows() - problem.parameters()) as f64;
        let residual_sd = match problem.name {
            // Rounding, as argued above: the covariance alone is compared.
            "Lanczos1" => problem.residual_sd,
            _ => (2.0 * outcome.cost / freedom).sqrt(),
        };
        let found: Vec<f64> =
            (0..problem.parameters()).map(|k| residual_sd * covariance[(k, k)].sqrt()).collect();
        disagreements("sd of b", &found, problem.sd, 5.0)
    });
}

#[test]
fn nist_problems_end_converged_from_both_starts() {
    check_all(|_, outcome| match outcome.termination.converged() {
        true => vec![],
        false => vec!["has not converged".into()],
    });
}

#[test]
fn a_start_minpack_fails_on_still_ends_with_finite_numbers() {
    for (name, number) in MINPACK_FAILS {
        let problem = nist::ALL.iter().find(|problem| problem.name == name);
        let problem = problem.expect("a name from NIST");
        let outcome = solve(problem, problem.starts[number - 1]);
        assert!(outcome.x.iter().all(|b| b.is_finite()), "{name}");
        assert!(outcome.cost.is_finite(), "{name}");
    }
}

/// Not the solver's: the figures and the models, before anything is fitted.
///
/// The parameters are certified to 11 digits, and the sum is stationary in them: what their
/// rounding adds is its square. Nine digits leave room for the doubles' own rounding of
/// residuals that are a thousandth of the response, or less. Lanczos1 is left out: eleven digits
/// of its parameters move its residuals by more than their own size.
#[test]
fn nist_models_have_the_certified_sums_of_squares_at_the_certified_parameters() {
    for problem in nist::ALL.iter().filter(|p| p.name != "Lanczos1") {
        let mut r = vec![0.0; problem.rows()];
        problem.residuals(problem.certified, &mut r);
        let rss: f64 = r.iter().map(|r| r * r).sum();
        let freedom = (problem.rows() - problem.parameters()) as f64;
        let residual_sd = (rss / freedom).sqrt();
        assert!(digits(rss, problem.rss) > 9.0, "{}: {rss:e}", problem.name);
        assert!(
            digits(residual_sd, problem.residual_sd) > 9.0,
            "{}: {residual_sd:e}",
            problem.name
        );
    }
}

/// Not the solver's: the derivatives it is given.
///
/// A central difference over `h = ∛ε |b|` errs by about `ε^⅔ = 4e-11` of the largest value for a
/// model that bends over its own size, and by its square for one that bends over a hundredth of
/// it (the peaks): 1e-6 of the column's largest entry, and of what rounding of the model leaves
/// after division by `h`.
#[test]
fn nist_derivatives_match_central_differences() {
    for problem in &nist::ALL {
        let (m, n) = (problem.rows(), problem.parameters());
        for b in [problem.starts[0], problem.starts[1], problem.certified] {
            let mut jacobian = vec![0.0; m * n];
            problem.jacobian(b, &mut jacobian);
            let mut value = vec![0.0; m];
            problem.residuals(b, &mut value);
            let largest = problem
                .data
                .iter()
                .zip(&value)
                .map(|((y, _), r)| (r + (problem.response)(*y)).abs())
                .fold(0.0, f64::max);
            for k in 0..n {
                let h = f64::EPSILON.cbrt() * b[k].abs();
                let at = |sign: f64| {
                    let mut moved = b.to_vec();
                    moved[k] += sign * h;
                    let mut r = vec![0.0; m];
                    problem.residuals(&moved, &mut r);
                    (moved[k], r)
                };
                let ((high, after), (low, before)) = (at(1.0), at(-1.0));
                let column = &jacobian[k * m..][..m];
                let scale = column.iter().fold(0.0, |scale, g| f64::max(scale, g.abs()));
                let tolerance = 1e-6 * scale + 10.0 * f64::EPSILON * largest / h;
                for row in 0..m {
                    let difference = (after[row] - before[row]) / (high - low);
                    assert!(
                        (column[row] - difference).abs() <= tolerance,
                        "{}: row {row} by b{}: {:e}, by differences {difference:e}",
                        problem.name,
                        k + 1,
                        column[row],
                    );
                }
            }
        }
    }
}

// --- What goes wrong -----------------------------------------------------

/// Rosenbrock's valley; its minimum is zero, at (1, 1).
fn rosenbrock(start: [f64; 2], options: &SolverOptions) -> Outcome {
    let valley = Dense::new(
        2,
        2,
        |x: &[f64], r: &mut [f64]| {
            r[0] = 10.0 * (x[1] - x[0] * x[0]);
            r[1] = 1.0 - x[0];
        },
        |x: &[f64], j: &mut [f64]| j.copy_from_slice(&[-20.0 * x[0], -1.0, 10.0, 0.0]),
    );
    lm::minimize(&valley, &start, options)
}

#[test]
fn survives_nan_residuals_at_a_trial_step() {
    // ln x + 2 = 0 from x = 10: the undamped step leads to x = -33, where there is no logarithm.
    let undefined = AtomicUsize::new(0);
    let problem = Dense::new(
        1,
        1,
        |x: &[f64], r: &mut [f64]| {
            r[0] = x[0].ln() + 2.0;
            undefined.fetch_add(usize::from(r[0].is_nan()), Ordering::Relaxed);
        },
        |x: &[f64], j: &mut [f64]| j[0] = 1.0 / x[0],
    );
    let outcome = lm::minimize(&problem, &[10.0], &tight());
    assert!(outcome.termination.converged(), "{:?}", outcome.termination);
    // The residual is zero to a rounding of 2, which moves x by as much of itself.
    assert!(digits(outcome.x[0], (-2.0_f64).exp()) > 14.0, "{:?}", outcome.x);
    assert!(undefined.load(Ordering::Relaxed) > 0, "the problem is too easy");
}

#[test]
fn survives_infinite_residuals_at_a_trial_step() {
    // 1 - 1e-3 exp x = 0 from x = -5: the undamped step leads to x = 1e5, where exp overflows.
    let problem = Dense::new(
        1,
        1,
        |x: &[f64], r: &mut [f64]| r[0] = 1.0 - 1e-3 * x[0].exp(),
        |x: &[f64], j: &mut [f64]| j[0] = -1e-3 * x[0].exp(),
    );
    let outcome = lm::minimize(&problem, &[-5.0], &tight());
    assert!(outcome.termination.converged(), "{:?}", outcome.termination);
    assert!(digits(outcome.x[0], 1e3_f64.ln()) > 14.0, "{:?}", outcome.x);
}

#[test]
fn survives_a_rank_deficient_jacobian() {
    // Only x0 + x1 is seen: a line of minima, x0 + x1 = 3.
    let problem = Dense::new(
        3,
        2,
        |x: &[f64], r: &mut [f64]| {
            for (r, y) in r.iter_mut().zip([2.0, 3.0, 4.0]) {
                *r = x[0] + x[1] - y;
            }
        },
        |_: &[f64], j: &mut [f64]| j.fill(1.0),
    );
    let outcome = lm::minimize(&problem, &[5.0, 7.0], &tight());
    assert!(outcome.termination.converged(), "{:?}", outcome.termination);
    // xtol, compared with an x of the size of the start.
    assert!((outcome.x[0] + outcome.x[1] - 3.0).abs() < 1e-10, "{:?}", outcome.x);
    // ½ (1 + 0 + 1), quadratic in what x lacks.
    assert!((outcome.cost - 1.0).abs() < 1e-14, "{}", outcome.cost);
    assert!(outcome.linearization.covariance().is_none());
}

#[test]
fn survives_a_parameter_that_nothing_depends_on_and_leaves_it_alone() {
    let problem = Dense::new(
        2,
        2,
        |x: &[f64], r: &mut [f64]| r.copy_from_slice(&[x[0] - 2.0, x[0] - 4.0]),
        |_: &[f64], j: &mut [f64]| j.copy_from_slice(&[1.0, 1.0, 0.0, 0.0]),
    );
    let outcome = lm::minimize(&problem, &[0.0, 7.0], &tight());
    assert!(outcome.termination.converged(), "{:?}", outcome.termination);
    assert!((outcome.x[0] - 3.0).abs() < 1e-10, "{:?}", outcome.x);
    // Nothing pulls it; what is left is the rounding of steps that are hardly damped.
    assert!((outcome.x[1] - 7.0).abs() < 1e-10, "{:?}", outcome.x);
    assert!(outcome.linearization.covariance().is_none());
}

#[test]
fn survives_a_start_at_the_minimum_and_stays_there() {
    let problem = Dense::new(
        2,
        1,
        |x: &[f64], r: &mut [f64]| r.copy_from_slice(&[x[0] - 1.0, x[0] + 1.0]),
        |_: &[f64], j: &mut [f64]| j.fill(1.0),
    );
    let outcome = lm::minimize(&problem, &[0.0], &SolverOptions::default());
    assert!(outcome.termination.converged(), "{:?}", outcome.termination);
    assert!(outcome.iterations <= 1, "{}", outcome.iterations);
    assert_eq!(outcome.x, [0.0]);
    assert_eq!(outcome.cost, 1.0);
}

#[test]
fn survives_a_start_at_a_minimum_of_zero() {
    // Every tolerance that is relative to the cost or to the residuals divides by zero here.
    let outcome = rosenbrock([1.0, 1.0], &SolverOptions::default());
    assert!(outcome.termination.converged(), "{:?}", outcome.termination);
    assert_eq!(outcome.x, [1.0, 1.0]);
    assert_eq!(outcome.cost, 0.0);
}

#[test]
fn survives_residuals_that_vanish_at_the_minimum() {
    let outcome = rosenbrock([-1.2, 1.0], &tight());
    assert!(outcome.termination.converged(), "{:?}", outcome.termination);
    for x in &outcome.x {
        // The last step is below xtol, and steps shrink quadratically.
        assert!((x - 1.0).abs() < 1e-12, "{:?}", outcome.x);
    }
    // 10 · 1e-12 · 2 at most remains of either residual.
    assert!(outcome.cost < 1e-21, "{}", outcome.cost);
}

#[test]
fn survives_a_minimum_at_infinity() {
    type Function = fn(f64) -> f64;
    let descents: [(&str, Function, Function); 2] =
        [("exp(-x)", |x| (-x).exp(), |x| -(-x).exp()), ("1/x", |x| 1.0 / x, |x| -1.0 / (x * x))];
    for (name, value, derivative) in descents {
        // Beside a residual that stays, and alone: then the cost goes to zero as well.
        for stays in [1.0, 0.0] {
            let problem = Dense::new(
                2,
                1,
                |x: &[f64], r: &mut [f64]| r.copy_from_slice(&[value(x[0]), stays]),
                |x: &[f64], j: &mut [f64]| j.copy_from_slice(&[derivative(x[0]), 0.0]),
            );
            let outcome = lm::minimize(&problem, &[1.0], &SolverOptions::default());
            let text = format!("{name}, {stays}: {:?}", outcome.termination);
            assert_ne!(outcome.termination, Termination::NotFinite, "{text}");
            assert!(outcome.x[0].is_finite(), "{text}");
            assert!(outcome.x[0] > 5.0, "{text} at {:e}", outcome.x[0]);
            assert!(outcome.cost >= 0.5 * stays, "{text}");
            assert!(
                outcome.cost < 0.5 * (stays + value(5.0).powi(2)),
                "{text}, cost {:e}",
                outcome.cost
            );
        }
    }
}

#[test]
fn survives_a_start_without_residuals_and_says_so() {
    for hole in [f64::NAN, f64::INFINITY] {
        let problem = Dense::new(
            2,
            1,
            |x: &[f64], r: &mut [f64]| r.copy_from_slice(&[x[0], hole]),
            |_: &[f64], j: &mut [f64]| j.copy_from_slice(&[1.0, 0.0]),
        );
        let outcome = lm::minimize(&problem, &[3.0], &SolverOptions::default());
        assert_eq!(outcome.termination, Termination::NotFinite, "{hole}");
        assert_eq!(outcome.x, [3.0], "{hole}");
        assert_eq!(outcome.iterations, 0, "{hole}");
    }
}

#[test]
fn survives_a_start_without_derivatives_and_says_so() {
    // √x at zero: a residual, but an infinite derivative.
    let problem = Dense::new(
        1,
        1,
        |x: &[f64], r: &mut [f64]| r[0] = x[0].sqrt() - 1.0,
        |x: &[f64], j: &mut [f64]| j[0] = 0.5 / x[0].sqrt(),
    );
    let outcome = lm::minimize(&problem, &[0.0], &SolverOptions::default());
    assert_eq!(outcome.termination, Termination::NotFinite);
    assert_eq!(outcome.x, [0.0]);
}

#[test]
fn survives_running_out_of_iterations_and_keeps_the_best_so_far() {
    let start = [-1.2, 1.0];
    let mut cost = f64::INFINITY;
    // Far from enough: it takes more than a dozen steps along the valley.
    for max_iterations in 0..5 {
        let options = SolverOptions { max_iterations, ..tight() };
        let outcome = rosenbrock(start, &options);
        assert_eq!(outcome.termination, Termination::MaxIterations);
        assert_eq!(outcome.iterations, max_iterations);
        assert!(outcome.cost <= cost, "{} after {cost}", outcome.cost);
        cost = outcome.cost;
        if max_iterations == 0 {
            assert_eq!(outcome.x, start);
        }
    }
}

#[test]
fn the_same_problem_gives_the_same_bits_twice() {
    for problem in &nist::ALL {
        let (one, two) = (solve(problem, problem.starts[1]), solve(problem, problem.starts[1]));
        assert_eq!(one.x, two.x, "{}", problem.name);
        assert_eq!(one.cost.to_bits(), two.cost.to_bits(), "{}", problem.name);
    }
}

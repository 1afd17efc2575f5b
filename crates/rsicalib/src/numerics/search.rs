//! Searches along one variable.

/// Golden section for the highest value of a function between two ends: where, and the value.
#[must_use]
pub fn highest(f: impl Fn(f64) -> f64, [mut low, mut high]: [f64; 2]) -> (f64, f64) {
    let golden = 0.5 * (5.0_f64.sqrt() - 1.0);
    let inner = |low: f64, high: f64| [high - golden * (high - low), low + golden * (high - low)];
    let [mut a, mut b] = inner(low, high);
    let (mut at_a, mut at_b) = (f(a), f(b));
    for _ in 0..STEPS {
        if at_a > at_b {
            (high, b, at_b) = (b, a, at_a);
            a = inner(low, high)[0];
            at_a = f(a);
        } else {
            (low, a, at_a) = (a, b, at_b);
            b = inner(low, high)[1];
            at_b = f(b);
        }
    }
    if at_a > at_b { (a, at_a) } else { (b, at_b) }
}

/// Where a property ends between a value that has it and a bound. The property is looked for in
/// growing steps first, since it may hold again far away; the bound where it never ends.
#[must_use]
pub fn edge(holds: impl Fn(f64) -> bool, from: f64, to: f64) -> f64 {
    let step = |k: i32| from + (to - from) * 0.5_f64.powi(k);
    let Some(first) = (0..=STEPS as i32).rev().find(|&k| !holds(step(k))) else { return to };
    let (mut inside, mut outside) =
        (if first == STEPS as i32 { from } else { step(first + 1) }, step(first));
    for _ in 0..STEPS {
        let middle = 0.5 * (inside + outside);
        if holds(middle) { inside = middle } else { outside = middle }
    }
    0.5 * (inside + outside)
}

/// Halvings, or so: an interval is then a part in 100,000 of what it was.
const STEPS: usize = 24;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_parabola_is_highest_at_its_vertex_and_positive_between_its_roots() {
        let f = |x: f64| 2.0 - (x - 0.7).powi(2);
        let (at, value) = highest(f, [-1.0, 3.0]);
        assert!((at - 0.7).abs() < 1e-4 && (value - 2.0).abs() < 1e-8);
        let root = edge(|x| f(x) > 0.0, 0.7, 9.0);
        assert!((root - (0.7 + 2.0_f64.sqrt())).abs() < 1e-4);
        assert_eq!(edge(|x| f(x) > 0.0, 0.7, 1.0), 1.0);
    }
}

//! Operations in the order in which they are computed.

use crate::numerics::formula::graph::{Func, Graph, Id, Op, Pair};
use crate::numerics::lanes::Lanes;

/// One step; each writes the next register, `SinCos` the next two.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Step {
    Op(Op),
    SinCos(usize),
}

/// What some results of a graph need, in order.
#[derive(Debug, Clone, PartialEq)]
pub struct Program {
    steps: Vec<Step>,
    results: Vec<usize>,
    registers: usize,
}

impl Program {
    /// The program for some results.
    #[must_use]
    pub fn new(graph: &Graph, results: &[Id]) -> Self {
        let needed = graph.needed(results);
        let angle = |id: Id| match graph.ops[id] {
            Op::Apply(function @ (Func::Sin | Func::Cos), a) => Some((function, a)),
            _ => None,
        };
        let mut register = vec![usize::MAX; graph.ops.len()];
        let (mut steps, mut registers) = (Vec::with_capacity(needed.len()), 0);
        for &id in &needed {
            if register[id] != usize::MAX {
                continue;
            }
            if let Some((function, a)) = angle(id)
                && let Some(&other) = needed
                    .iter()
                    .find(|o| angle(**o).is_some_and(|(its, b)| its != function && a == b))
            {
                let (sin, cos) = if function == Func::Sin { (id, other) } else { (other, id) };
                (register[sin], register[cos]) = (registers, registers + 1);
                steps.push(Step::SinCos(register[a]));
                registers += 2;
                continue;
            }
            steps.push(Step::Op(match graph.ops[id] {
                op @ (Op::Constant(_) | Op::Input(_)) => op,
                Op::Negative(a) => Op::Negative(register[a]),
                Op::Apply(function, a) => Op::Apply(function, register[a]),
                Op::Whole(a, n) => Op::Whole(register[a], n),
                Op::Pair(pair, a, b) => Op::Pair(pair, register[a], register[b]),
            }));
            register[id] = registers;
            registers += 1;
        }
        Self { steps, results: results.iter().map(|&id| register[id]).collect(), registers }
    }

    /// Number of results.
    #[must_use]
    pub fn len(&self) -> usize {
        self.results.len()
    }

    /// True where there is no result.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.results.is_empty()
    }

    /// Computes the results at eight samples; `input` gives the inputs by their numbers.
    #[inline(always)]
    pub fn run(&self, input: impl Fn(usize) -> Lanes, out: &mut [Lanes]) {
        // Room on the stack: what is cleared for each call is no more than is needed.
        match self.registers {
            0..=8 => self.run_in(&mut [Lanes::ZERO; 8], input, out),
            9..=16 => self.run_in(&mut [Lanes::ZERO; 16], input, out),
            17..=32 => self.run_in(&mut [Lanes::ZERO; 32], input, out),
            n => self.run_in(&mut vec![Lanes::ZERO; n], input, out),
        }
    }

    /// The first result at eight samples; zero where there is no result.
    #[inline(always)]
    pub fn value(&self, input: impl Fn(usize) -> Lanes) -> Lanes {
        let mut out = [Lanes::ZERO];
        self.run(input, &mut out);
        out[0]
    }

    #[inline(always)]
    fn run_in(&self, registers: &mut [Lanes], input: impl Fn(usize) -> Lanes, out: &mut [Lanes]) {
        let mut next = 0;
        for step in &self.steps {
            match *step {
                Step::SinCos(a) => {
                    (registers[next], registers[next + 1]) = registers[a].sin_cos();
                    next += 1;
                }
                Step::Op(Op::Input(number)) => registers[next] = input(number),
                Step::Op(op) => registers[next] = compute(op, registers),
            }
            next += 1;
        }
        for (out, &register) in out.iter_mut().zip(&self.results) {
            *out = registers[register];
        }
    }
}

#[inline(always)]
fn compute(op: Op, registers: &[Lanes]) -> Lanes {
    match op {
        Op::Constant(value) => Lanes::splat(value),
        Op::Input(_) => Lanes::ZERO,
        Op::Negative(a) => -registers[a],
        Op::Whole(a, 2) => registers[a] * registers[a],
        Op::Whole(a, 3) => registers[a] * registers[a] * registers[a],
        Op::Whole(a, n) => registers[a].map(|x| x.powi(n)),
        Op::Apply(Func::Sin, a) => registers[a].sin_cos().0,
        Op::Apply(Func::Cos, a) => registers[a].sin_cos().1,
        Op::Apply(Func::Sqrt, a) => registers[a].sqrt(),
        Op::Apply(Func::Abs, a) => registers[a].map(f64::abs),
        Op::Apply(function, a) => registers[a].map(|x| function.at(x)),
        Op::Pair(Pair::Add, a, b) => registers[a] + registers[b],
        Op::Pair(Pair::Sub, a, b) => registers[a] - registers[b],
        Op::Pair(Pair::Mul, a, b) => registers[a] * registers[b],
        Op::Pair(Pair::Div, a, b) => registers[a] / registers[b],
        Op::Pair(pair, a, b) => registers[a].zip(registers[b], |a, b| pair.at(a, b)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numerics::formula::parse::{Misread, parse};

    const NAMES: [&str; 3] = ["x", "y", "z"];

    fn read(text: &str) -> Result<(Graph, Id), Misread> {
        let mut graph = Graph::default();
        let mut input = |name: &str, index: Option<&str>| match index.map(str::parse::<usize>) {
            Some(Ok(index)) if name == "q" && (1..=3).contains(&index) => Ok(index - 1),
            Some(_) => Err("q[1]".into()),
            _ => NAMES.iter().position(|n| *n == name).ok_or_else(|| "x, y, z, q[1]".into()),
        };
        let id = parse(text, &mut graph, &mut input)?;
        Ok((graph, id))
    }

    fn value(text: &str, at: [f64; 3]) -> f64 {
        let (graph, id) = read(text).expect(text);
        Program::new(&graph, &[id]).value(|k| Lanes::splat(at[k])).0[0]
    }

    #[test]
    fn operators_bind_as_on_paper() {
        let at = [2.0, 3.0, 5.0];
        for (text, expected) in [
            ("1 + 2*x", 5.0),
            ("-x^2", -4.0),
            ("2^-1 + x**2", 4.5),
            ("2^3^2", 512.0),
            ("z - y - x", 0.0),
            ("z/y/x", 5.0 / 6.0),
            ("(x + y)*z", 25.0),
            ("1.5e1 + .5E-1", 15.05),
            ("x + - -y", 5.0),
            ("q[1] + q[ 3 ]", 7.0),
            ("max(x, y) - min(y, x)", 1.0),
            ("step(x - 2) + sign(-y)", 0.0),
            ("pi", std::f64::consts::PI),
            ("floor(z/x)", 2.0),
        ] {
            assert!((value(text, at) - expected).abs() < 1e-14, "{text}: {}", value(text, at));
        }
    }

    #[test]
    fn a_wrong_formula_is_refused_at_its_place() {
        for (text, at, found) in [
            ("a*sin(3*x)", 1, "\"a\""),
            ("x + ", 5, "the end of the formula"),
            ("x + ) y", 5, "')'"),
            ("x y", 3, "'y'"),
            ("2*cot(x)", 3, "function \"cot\""),
            ("sin(x", 6, "the end of the formula"),
            ("min(x)", 6, "')'"),
            ("q[x]", 1, "\"q[x]\""),
            ("q[9]", 1, "\"q[9]\""),
            ("1.2.3", 1, "\"1.2.3\""),
            ("x ° y", 3, "'°'"),
            ("", 1, "the end of the formula"),
        ] {
            let misread = read(text).expect_err(text);
            assert_eq!((misread.at, misread.found.as_str()), (at, found), "{text}");
            assert!(!misread.expected.is_empty());
        }
        assert!(read(&"(".repeat(500)).is_err());
        assert!(read(&"2^".repeat(300)).is_err());
        assert!(read(&format!("x{}", " + x".repeat(4000))).is_err());
    }

    #[test]
    fn derivatives_match_differences() {
        let at = [0.37, -0.61, 0.83];
        for text in [
            "x*y*z + x/y - z",
            "sin(3*x)*cos(y) + tan(z)",
            "asin(x) + acos(y) + atan(z*x)",
            "sinh(x) + cosh(y) + tanh(z)",
            "exp(-x*y) + ln(z) + sqrt(x)",
            "abs(y)*x + sign(y)*z",
            "x^3 - y^-2 + z^2.5",
            "x^z + (2 + y)^x",
            "min(x, y)*z + max(x*y, z)",
            "atan2(x, y) + atan2(z, x)",
            "step(y)*x + floor(z)*x + (-x)",
            "(x + y)^2/(1 + z^2)",
        ] {
            let (mut graph, id) = read(text).expect(text);
            for k in 0..3 {
                let slope = graph.derivative(id, k);
                let program = Program::new(&graph, &[slope]);
                let found = program.value(|k| Lanes::splat(at[k])).0[0];
                // Central differences of fourth order: h⁴ = 1e-12, and rounding 1e-16/h.
                let off = |h: f64| {
                    let mut near = at;
                    near[k] += h;
                    value(text, near)
                };
                let h = 1e-3;
                let difference =
                    (8.0 * (off(h) - off(-h)) - (off(2.0 * h) - off(-2.0 * h))) / (12.0 * h);
                assert!((found - difference).abs() < 1e-9, "{text} by {k}: {found} {difference}");
            }
        }
    }

    #[test]
    fn long_formulas_have_room() {
        let text: Vec<String> = (1..60).map(|n| format!("sin({n}*x)")).collect();
        let expected: f64 = (1..60).map(|n| (f64::from(n) * 0.3).sin()).sum();
        assert!((value(&text.join(" + "), [0.3, 0.0, 0.0]) - expected).abs() < 1e-12);
    }

    #[test]
    fn sine_and_cosine_of_one_angle_are_one_step() {
        let (mut graph, id) = read("y*sin(3*x) + z*cos(3*x)").expect("a formula");
        let slope = graph.derivative(id, 0);
        let program = Program::new(&graph, &[id, slope]);
        let pairs = program.steps.iter().filter(|s| matches!(s, Step::SinCos(_))).count();
        assert_eq!(pairs, 1);
    }
}

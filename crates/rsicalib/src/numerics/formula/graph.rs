//! Operations and their derivatives.

/// Number of an operation.
pub type Id = usize;

/// A function of one argument.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Func {
    Sin,
    Cos,
    Tan,
    Asin,
    Acos,
    Atan,
    Sinh,
    Cosh,
    Tanh,
    Exp,
    Ln,
    Sqrt,
    Abs,
    Sign,
    Step,
    Floor,
}

impl Func {
    /// What they are called. `sign(0)` is 0; `step` is 1 where its argument is not negative.
    pub(super) const NAMES: [(&'static str, Self); 16] = [
        ("sin", Self::Sin),
        ("cos", Self::Cos),
        ("tan", Self::Tan),
        ("asin", Self::Asin),
        ("acos", Self::Acos),
        ("atan", Self::Atan),
        ("sinh", Self::Sinh),
        ("cosh", Self::Cosh),
        ("tanh", Self::Tanh),
        ("exp", Self::Exp),
        ("ln", Self::Ln),
        ("sqrt", Self::Sqrt),
        ("abs", Self::Abs),
        ("sign", Self::Sign),
        ("step", Self::Step),
        ("floor", Self::Floor),
    ];

    pub(super) fn named(name: &str) -> Option<Self> {
        Self::NAMES.iter().find(|(known, _)| *known == name).map(|(_, f)| *f)
    }

    /// The value at one number.
    pub(super) fn at(self, x: f64) -> f64 {
        match self {
            Self::Sin => x.sin(),
            Self::Cos => x.cos(),
            Self::Tan => x.tan(),
            Self::Asin => x.asin(),
            Self::Acos => x.acos(),
            Self::Atan => x.atan(),
            Self::Sinh => x.sinh(),
            Self::Cosh => x.cosh(),
            Self::Tanh => x.tanh(),
            Self::Exp => x.exp(),
            Self::Ln => x.ln(),
            Self::Sqrt => x.sqrt(),
            Self::Abs => x.abs(),
            Self::Sign => f64::from(i8::from(x > 0.0) - i8::from(x < 0.0)),
            Self::Step => f64::from(u8::from(x >= 0.0)),
            Self::Floor => x.floor(),
        }
    }
}

/// A function of two arguments.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Pair {
    Add,
    Sub,
    Mul,
    Div,
    Power,
    Min,
    Max,
    Atan2,
}

impl Pair {
    /// Those that are called by a name.
    pub(super) const NAMES: [(&'static str, Self); 3] =
        [("min", Self::Min), ("max", Self::Max), ("atan2", Self::Atan2)];

    pub(super) fn named(name: &str) -> Option<Self> {
        Self::NAMES.iter().find(|(known, _)| *known == name).map(|(_, p)| *p)
    }

    /// The value at two numbers.
    #[inline(always)]
    pub(super) fn at(self, a: f64, b: f64) -> f64 {
        match self {
            Self::Add => a + b,
            Self::Sub => a - b,
            Self::Mul => a * b,
            Self::Div => a / b,
            Self::Power => a.powf(b),
            Self::Min => a.min(b),
            Self::Max => a.max(b),
            Self::Atan2 => a.atan2(b),
        }
    }
}

/// An operation on earlier ones.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Op {
    Constant(f64),
    Input(usize),
    Negative(Id),
    Apply(Func, Id),
    Whole(Id, i32),
    Pair(Pair, Id, Id),
}

/// A list of operations, each on earlier ones.
#[derive(Debug, Clone, Default)]
pub struct Graph {
    pub(super) ops: Vec<Op>,
}

impl Graph {
    /// An operation, which is there once.
    fn push(&mut self, op: Op) -> Id {
        self.ops.iter().position(|known| *known == op).unwrap_or_else(|| {
            self.ops.push(op);
            self.ops.len() - 1
        })
    }

    /// A number.
    pub fn constant(&mut self, value: f64) -> Id {
        self.push(Op::Constant(value))
    }

    /// An input.
    pub fn input(&mut self, number: usize) -> Id {
        self.push(Op::Input(number))
    }

    /// `a + b`
    pub fn sum(&mut self, a: Id, b: Id) -> Id {
        self.pair(Pair::Add, a, b)
    }

    /// `a b`
    pub fn product(&mut self, a: Id, b: Id) -> Id {
        self.pair(Pair::Mul, a, b)
    }

    fn value(&self, id: Id) -> Option<f64> {
        if let Op::Constant(value) = self.ops[id] { Some(value) } else { None }
    }

    /// True where it is zero whatever the inputs are.
    #[must_use]
    pub fn is_zero(&self, id: Id) -> bool {
        self.value(id) == Some(0.0)
    }

    /// The inputs that an operation depends on, ascending.
    #[must_use]
    pub fn inputs(&self, id: Id) -> Vec<usize> {
        let needed = self.needed(&[id]);
        let mut inputs: Vec<usize> = needed
            .into_iter()
            .filter_map(|id| if let Op::Input(k) = self.ops[id] { Some(k) } else { None })
            .collect();
        inputs.sort_unstable();
        inputs
    }

    /// The operations that some results need, in order.
    pub(super) fn needed(&self, results: &[Id]) -> Vec<Id> {
        let mut needed = vec![false; self.ops.len()];
        results.iter().for_each(|&id| needed[id] = true);
        for id in (0..self.ops.len()).rev() {
            if needed[id] {
                match self.ops[id] {
                    Op::Constant(_) | Op::Input(_) => {}
                    Op::Negative(a) | Op::Apply(_, a) | Op::Whole(a, _) => needed[a] = true,
                    Op::Pair(_, a, b) => (needed[a], needed[b]) = (true, true),
                }
            }
        }
        (0..self.ops.len()).filter(|id| needed[*id]).collect()
    }

    pub(super) fn negative(&mut self, a: Id) -> Id {
        match self.ops[a] {
            Op::Constant(value) => self.constant(-value),
            Op::Negative(inner) => inner,
            _ => self.push(Op::Negative(a)),
        }
    }

    pub(super) fn apply(&mut self, function: Func, a: Id) -> Id {
        match self.value(a) {
            Some(value) => self.constant(function.at(value)),
            None => self.push(Op::Apply(function, a)),
        }
    }

    pub(super) fn pair(&mut self, pair: Pair, a: Id, b: Id) -> Id {
        match (pair, self.value(a), self.value(b)) {
            (_, Some(x), Some(y)) => self.constant(pair.at(x, y)),
            (Pair::Add, Some(0.0), _) => b,
            (Pair::Add | Pair::Sub, _, Some(0.0)) => a,
            (Pair::Sub, Some(0.0), _) => self.negative(b),
            (Pair::Mul | Pair::Div, Some(0.0), _) | (Pair::Mul, _, Some(0.0)) => self.constant(0.0),
            (Pair::Mul, Some(1.0), _) => b,
            (Pair::Mul | Pair::Div, _, Some(1.0)) => a,
            _ => self.push(Op::Pair(pair, a, b)),
        }
    }

    pub(super) fn power(&mut self, a: Id, b: Id) -> Id {
        let whole = self.value(b).filter(|n| n.fract() == 0.0 && n.abs() <= 64.0);
        match whole {
            Some(0.0) => self.constant(1.0),
            Some(1.0) => a,
            #[expect(clippy::cast_possible_truncation, reason = "a whole number up to 64")]
            Some(n) => match self.value(a) {
                Some(value) => self.constant(value.powi(n as i32)),
                None => self.push(Op::Whole(a, n as i32)),
            },
            None => self.pair(Pair::Power, a, b),
        }
    }

    /// An operation with the first `zeros` inputs at zero, in a graph of its own.
    ///
    /// A function of what is left is an input there, and may be any number: a law that acts at a
    /// few places acts wherever `step`, `max` or `exp` let it.
    #[must_use]
    pub(crate) fn at_zero(&self, id: Id, zeros: usize) -> (Self, Id) {
        let inputs = self.ops.iter().map(|op| if let Op::Input(k) = op { k + 1 } else { 0 });
        let first = inputs.max().unwrap_or_default();
        let (mut rest, mut free): (Self, Vec<Op>) = (Self::default(), Vec::new());
        let mut now = vec![0; id + 1];
        for k in self.needed(&[id]) {
            let new = match self.ops[k] {
                Op::Input(number) if number < zeros => rest.constant(0.0),
                Op::Constant(_) | Op::Input(_) => rest.push(self.ops[k]),
                Op::Negative(a) => rest.negative(now[a]),
                Op::Apply(function, a) => rest.apply(function, now[a]),
                Op::Whole(a, n) => {
                    let exponent = rest.constant(f64::from(n));
                    rest.power(now[a], exponent)
                }
                Op::Pair(pair, a, b) => rest.pair(pair, now[a], now[b]),
            };
            let known = rest.ops[new];
            now[k] = match known {
                Op::Apply(..) | Op::Pair(Pair::Min | Pair::Max | Pair::Atan2 | Pair::Power, ..) => {
                    let place = free.iter().position(|op| *op == known).unwrap_or_else(|| {
                        free.push(known);
                        free.len() - 1
                    });
                    rest.input(first + place)
                }
                _ => new,
            };
        }
        (rest, now[id])
    }

    /// The derivative of an operation by an input.
    ///
    /// Where a function has a corner or a step (`abs`, `min`, `step`, `floor`), the derivative is
    /// that of one side.
    pub fn derivative(&mut self, id: Id, input: usize) -> Id {
        let zero = self.constant(0.0);
        let mut slopes = vec![zero; id + 1];
        for k in self.needed(&[id]) {
            slopes[k] = match self.ops[k] {
                Op::Constant(_) => zero,
                Op::Input(number) => self.constant(if number == input { 1.0 } else { 0.0 }),
                Op::Negative(a) => self.negative(slopes[a]),
                Op::Apply(..) | Op::Whole(..) | Op::Pair(..) => self.chain(k, &slopes),
            };
        }
        slopes[id]
    }

    /// The chain rule at one operation.
    fn chain(&mut self, k: Id, slopes: &[Id]) -> Id {
        let zero = |graph: &Self, a: Id| graph.is_zero(slopes[a]);
        match self.ops[k] {
            Op::Apply(_, a) | Op::Whole(a, _) if zero(self, a) => slopes[a],
            Op::Apply(function, a) => {
                let outer = self.outer(function, a, k);
                self.pair(Pair::Mul, outer, slopes[a])
            }
            Op::Whole(a, n) => {
                let (factor, exponent) =
                    (self.constant(f64::from(n)), self.constant(f64::from(n - 1)));
                let power = self.power(a, exponent);
                let outer = self.pair(Pair::Mul, factor, power);
                self.pair(Pair::Mul, outer, slopes[a])
            }
            Op::Pair(pair, a, b) => self.chain_of_pair(pair, [a, b], k, slopes),
            Op::Constant(_) | Op::Input(_) | Op::Negative(_) => self.constant(0.0),
        }
    }

    /// Derivative of a function at `a`, where its value is `value`.
    fn outer(&mut self, function: Func, a: Id, value: Id) -> Id {
        let one = self.constant(1.0);
        let square = |graph: &mut Self, x: Id| graph.pair(Pair::Mul, x, x);
        match function {
            Func::Sin => self.apply(Func::Cos, a),
            Func::Cos => {
                let sin = self.apply(Func::Sin, a);
                self.negative(sin)
            }
            Func::Tan => {
                let tan = square(self, value);
                self.pair(Pair::Add, one, tan)
            }
            Func::Asin | Func::Acos => {
                let square = square(self, a);
                let left = self.pair(Pair::Sub, one, square);
                let root = self.apply(Func::Sqrt, left);
                let slope = self.pair(Pair::Div, one, root);
                if function == Func::Asin { slope } else { self.negative(slope) }
            }
            Func::Atan => {
                let square = square(self, a);
                let sum = self.pair(Pair::Add, one, square);
                self.pair(Pair::Div, one, sum)
            }
            Func::Sinh => self.apply(Func::Cosh, a),
            Func::Cosh => self.apply(Func::Sinh, a),
            Func::Tanh => {
                let square = square(self, value);
                self.pair(Pair::Sub, one, square)
            }
            Func::Exp => value,
            Func::Ln => self.pair(Pair::Div, one, a),
            Func::Sqrt => {
                let half = self.constant(0.5);
                self.pair(Pair::Div, half, value)
            }
            Func::Abs => self.apply(Func::Sign, a),
            Func::Sign | Func::Step | Func::Floor => self.constant(0.0),
        }
    }

    fn chain_of_pair(&mut self, pair: Pair, [a, b]: [Id; 2], k: Id, slopes: &[Id]) -> Id {
        let (da, db) = (slopes[a], slopes[b]);
        match pair {
            Pair::Add | Pair::Sub => self.pair(pair, da, db),
            Pair::Mul => {
                let (left, right) = (self.pair(Pair::Mul, da, b), self.pair(Pair::Mul, a, db));
                self.pair(Pair::Add, left, right)
            }
            Pair::Div => {
                let through = self.pair(Pair::Mul, k, db);
                let left = self.pair(Pair::Sub, da, through);
                self.pair(Pair::Div, left, b)
            }
            Pair::Power => {
                let one = self.constant(1.0);
                let less = self.pair(Pair::Sub, b, one);
                let base = self.pair(Pair::Power, a, less);
                let base = self.pair(Pair::Mul, base, b);
                let base = self.pair(Pair::Mul, base, da);
                if self.is_zero(db) {
                    return base;
                }
                // Of a base of zero what is multiplied by the logarithm is zero.
                let least = self.constant(f64::MIN_POSITIVE);
                let above = self.pair(Pair::Max, a, least);
                let log = self.apply(Func::Ln, above);
                let exponent = self.pair(Pair::Mul, k, log);
                let exponent = self.pair(Pair::Mul, exponent, db);
                self.pair(Pair::Add, base, exponent)
            }
            Pair::Min | Pair::Max => {
                // 1 where the first is taken.
                let apart = match pair {
                    Pair::Min => self.pair(Pair::Sub, b, a),
                    _ => self.pair(Pair::Sub, a, b),
                };
                let first = self.apply(Func::Step, apart);
                let change = self.pair(Pair::Sub, da, db);
                let change = self.pair(Pair::Mul, first, change);
                self.pair(Pair::Add, change, db)
            }
            Pair::Atan2 => {
                let (aa, bb) = (self.pair(Pair::Mul, a, a), self.pair(Pair::Mul, b, b));
                let norm = self.pair(Pair::Add, aa, bb);
                let (left, right) = (self.pair(Pair::Mul, b, da), self.pair(Pair::Mul, a, db));
                let turn = self.pair(Pair::Sub, left, right);
                self.pair(Pair::Div, turn, norm)
            }
        }
    }
}

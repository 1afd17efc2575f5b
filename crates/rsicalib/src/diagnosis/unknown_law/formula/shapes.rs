//! Products of a factor of each variable, as formulas write them.

use std::f64::consts::{FRAC_PI_2, TAU};

use crate::readings::way::{Memory, Visits, widths};
use crate::text::significant;

stated! {
    /// Powers, and orders of waves, up to this one.
    fn highest_order() -> usize = 3;
    /// Places of steps and bends: so many parts of what a variable spans.
    fn parts_of_formulas() -> usize = 8;
}

/// Decays of what grows from zero: these parts of the largest.
const DECAYS: [f64; 3] = [0.05, 0.15, 0.5];

/// Digits of a number in a formula.
const DIGITS: usize = 4;

/// The smallest and the largest value of a variable.
pub(super) type Span = [f64; 2];

/// A variable as formulas write it, with its value in each sample.
#[derive(Default)]
pub(super) struct Named {
    pub(super) text: String,
    pub(super) values: Vec<f64>,
    /// The coordinate of a joint, of which there are waves.
    pub(super) moves: bool,
    /// An angle: its waves may be of whole orders.
    pub(super) turns: bool,
    /// True where `x |x|` is tried: its sign is that of a force or of a motion.
    pub(super) signed: bool,
    /// Time or a path: from zero on, of which there are decays.
    pub(super) grows: bool,
    /// The way of a channel, of which there are plays; it has no other shapes.
    pub(super) way: Option<Visits>,
}

impl Named {
    pub(super) fn span(&self) -> Span {
        let low = self.values.iter().copied().fold(f64::INFINITY, f64::min);
        [low, self.values.iter().copied().fold(f64::NEG_INFINITY, f64::max)]
    }

    /// A function of it, sample by sample.
    fn of(&self, shape: Shape) -> Vec<f64> {
        match (shape, &self.way) {
            (Shape::Play { width }, Some(way)) => way.remembered(Memory::Play { width }),
            _ => self.values.iter().map(|x| shape.at(*x)).collect(),
        }
    }

    /// True for a direction, which has three values: of its powers there is one.
    fn is_sign(&self) -> bool {
        self.values.iter().all(|v| *v == v.signum() || *v == 0.0)
    }
}

/// A function of one variable.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Shape {
    /// `(x - from)^power`
    Power { power: i32, from: f64 },
    /// `x |x|`
    Signed,
    /// `sin(order x + phase)`
    Wave { order: f64, phase: f64 },
    /// `exp(-x/length)`
    Decay { length: f64 },
    /// One beyond a place, zero before.
    Step { at: f64 },
    /// `max(x - at, 0)`
    Bend { at: f64 },
    /// `tanh((x - at)/width)`, which saturates.
    Saturation { at: f64, width: f64 },
    /// `1/(x - from)`, from beyond what the variable spans.
    Ratio { from: f64 },
    /// `play[x, width]`, of a way.
    Play { width: f64 },
}

impl Shape {
    fn at(self, x: f64) -> f64 {
        match self {
            Self::Power { power, from } => (x - from).powi(power),
            Self::Signed => x * x.abs(),
            Self::Wave { order, phase } => (order * x + phase).sin(),
            Self::Decay { length } => (-x / length).exp(),
            Self::Step { at } => f64::from(u8::from(x >= at)),
            Self::Bend { at } => (x - at).max(0.0),
            Self::Saturation { at, width } => ((x - at) / width).tanh(),
            Self::Ratio { from } => (x - from).recip(),
            Self::Play { .. } => f64::NAN,
        }
    }

    /// As it is written, of a variable.
    fn text(self, x: &str) -> String {
        match self {
            Self::Power { power: 1, from } => less(x, from, true),
            Self::Power { power, from } => format!("{}^{power}", less(x, from, true)),
            Self::Signed => format!("{x}*abs({x})"),
            Self::Wave { order, phase } if phase == FRAC_PI_2 => {
                format!("cos({})", times(order, x))
            }
            Self::Wave { order, phase } => {
                format!("sin({})", less(&times(order, x), -phase, false))
            }
            Self::Decay { length } => format!("exp(-{x}/{})", significant(length, DIGITS)),
            Self::Step { at } => format!("step({})", less(x, at, false)),
            Self::Bend { at } => format!("max({}, 0)", less(x, at, false)),
            Self::Saturation { at, width } => {
                format!("tanh({}/{})", less(x, at, true), significant(width, DIGITS))
            }
            Self::Ratio { from } => format!("1/{}", less(x, from, true)),
            Self::Play { width } => format!("play[{x}, {}]", significant(width, DIGITS)),
        }
    }

    fn kind(self) -> i32 {
        match self {
            Self::Power { power, .. } => power,
            Self::Signed => -6,
            Self::Wave { .. } => -1,
            Self::Decay { .. } => -2,
            Self::Step { .. } => -3,
            Self::Bend { .. } => -4,
            Self::Play { .. } => -5,
            Self::Saturation { .. } => -7,
            Self::Ratio { .. } => -8,
        }
    }

    /// Numbers inside it, each with the range in which it is searched.
    pub(super) fn inner(self, [low, high]: &Span) -> Vec<(f64, [f64; 2])> {
        let part = (high - low) / parts_of_formulas() as f64;
        let apart = 0.5 * TAU / (high - low);
        match self {
            Self::Power { from, .. } => vec![(from, [*low, *high])],
            Self::Signed => Vec::new(),
            // Half a wave over what the variable spans to either side, and a period of phases.
            Self::Wave { order, phase } => vec![
                (order, [(order - apart).max(0.5 * order), order + apart]),
                (phase, [phase - FRAC_PI_2, phase + FRAC_PI_2]),
            ],
            Self::Decay { length } => vec![(length, [length / 3.0, 3.0 * length])],
            Self::Step { at } | Self::Bend { at } => vec![(at, [at - part, at + part])],
            Self::Saturation { at, width } => {
                vec![(at, [*low, *high]), (width, [width / 3.0, 3.0 * width])]
            }
            Self::Ratio { from } if from < *low => {
                vec![(from, [3.0 * low - 2.0 * high, low - part])]
            }
            Self::Ratio { from } => vec![(from, [high + part, 3.0 * high - 2.0 * low])],
            Self::Play { width } => vec![(width, [0.5 * width, (2.0 * width).min(high - low)])],
        }
    }

    /// The same with another number inside, as it is written. A wave of another order is the same in the
    /// middle of what its variable spans.
    pub(super) fn with(self, which: usize, value: f64, [low, high]: &Span) -> Self {
        let value = written(value);
        match self {
            Self::Power { power, .. } => Self::Power { power, from: value },
            Self::Signed => self,
            Self::Wave { order, phase } if which == 0 => {
                let phase = phase + 0.5 * (order - value) * (low + high);
                Self::Wave { order: value, phase: written(phase.rem_euclid(TAU)) }
            }
            Self::Wave { order, .. } => Self::Wave { order, phase: written(value.rem_euclid(TAU)) },
            Self::Decay { .. } => Self::Decay { length: value },
            Self::Step { .. } => Self::Step { at: value },
            Self::Bend { .. } => Self::Bend { at: value },
            Self::Saturation { width, .. } if which == 0 => Self::Saturation { at: value, width },
            Self::Saturation { at, .. } => Self::Saturation { at, width: value },
            Self::Ratio { .. } => Self::Ratio { from: value },
            Self::Play { .. } => Self::Play { width: value },
        }
    }
}

/// A number as a formula has it.
fn written(value: f64) -> f64 {
    significant(value, DIGITS).parse().unwrap_or(value)
}

/// `x - value`, in parentheses on request.
fn less(x: &str, value: f64, whole: bool) -> String {
    if value == 0.0 {
        return x.into();
    }
    let sign = if value < 0.0 { '+' } else { '-' };
    let text = format!("{x} {sign} {}", significant(value.abs(), DIGITS));
    if whole { format!("({text})") } else { text }
}

/// `order x`
fn times(order: f64, x: &str) -> String {
    if order == 1.0 { x.into() } else { format!("{}*{x}", significant(order, DIGITS)) }
}

/// A factor of each of some variables.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Product(pub(super) Vec<(usize, Shape)>);

/// A variable, and a shape of it whatever the numbers inside.
pub(super) type Kind = (usize, i32);

impl Product {
    /// What is the same in all samples.
    pub(super) fn constant() -> Self {
        Self(Vec::new())
    }

    pub(super) fn kinds(&self) -> Vec<Kind> {
        self.0.iter().map(|(v, shape)| (*v, shape.kind())).collect()
    }

    pub(super) fn text(&self, named: &[Named]) -> String {
        let each = self.0.iter().map(|(v, shape)| shape.text(&named[*v].text));
        each.collect::<Vec<_>>().join("*")
    }

    /// Its value in each sample.
    pub(super) fn values(&self, named: &[Named]) -> Vec<f64> {
        let of = |(v, shape): &(usize, Shape)| named[*v].of(*shape);
        let one = vec![1.0; named[0].values.len()];
        self.0
            .iter()
            .map(of)
            .fold(one, |product, f| product.iter().zip(&f).map(|(a, b)| a * b).collect())
    }
}

/// Products of a factor of each of up to two variables, and factors of one of them.
pub(super) fn products(named: &[Named]) -> Vec<Product> {
    let of = |v: usize, alone: bool| shapes(&named[v], alone).into_iter().map(move |s| (v, s));
    let mut out = Vec::new();
    if named.len() == 2 {
        out.extend(of(0, false).flat_map(|a| of(1, false).map(move |b| Product(vec![a, b]))));
    }
    out.extend((0..named.len()).flat_map(|v| of(v, true)).map(|one| Product(vec![one])));
    out
}

/// Functions of one variable. Powers in a product are taken from the middle of what the variable spans:
/// from elsewhere they are sums of more of them.
///
/// Where a variable stands alone, those from zero are tried too.
fn shapes(x: &Named, alone: bool) -> Vec<Shape> {
    let [low, high] = x.span();
    if x.way.is_some() {
        return widths([low, high]).map(|width| Shape::Play { width: written(width) }).collect();
    }
    if x.is_sign() {
        return vec![Shape::Power { power: 1, from: 0.0 }];
    }
    let middle = written(0.5 * (low + high));
    let from = if alone { 0.0 } else { middle };
    let powers = 1..=highest_order() as i32;
    let mut out: Vec<Shape> = powers.clone().map(|power| Shape::Power { power, from }).collect();
    if alone {
        let from = middle;
        out.extend(powers.skip(1).map(|power| Shape::Power { power, from }));
    }
    if x.signed {
        out.push(Shape::Signed);
    }
    for number in (1..=highest_order()).map(|number| number as f64) {
        let phases = [0.0, FRAC_PI_2];
        if x.turns {
            out.extend(phases.map(|phase| Shape::Wave { order: number, phase }));
        }
        // So many waves over what it spans.
        let order = written(TAU * number / (high - low));
        let at_middle = |phase: f64| written((phase - order * middle).rem_euclid(TAU));
        if x.moves {
            out.extend(phases.map(|phase| Shape::Wave { order, phase: at_middle(phase) }));
        }
    }
    if x.grows {
        out.extend(DECAYS.map(|part| Shape::Decay { length: written(part * high) }));
    }
    let part = (high - low) / parts_of_formulas() as f64;
    let places = [low + 2.0 * part, middle, high - 2.0 * part];
    out.extend(places.map(|at| Shape::Saturation { at: written(at), width: written(part) }));
    out.extend(
        [low, high]
            .map(|end| Shape::Ratio { from: written(end + 2.0 * part.copysign(end - middle)) }),
    );
    for part in 1..parts_of_formulas() {
        let at = written(low + (high - low) * part as f64 / parts_of_formulas() as f64);
        out.extend([Shape::Step { at }, Shape::Bend { at }]);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::{Named, Product, products};
    use crate::numerics::formula::{Graph, Program, parse};
    use crate::numerics::lanes::Lanes;

    fn angle(text: &str) -> Named {
        let values = (0..9).map(|p| (p as f64 - 2.0) / 4.0).collect();
        Named {
            text: text.into(),
            values,
            turns: true,
            moves: true,
            signed: true,
            ..Named::default()
        }
    }

    /// A formula is read as the value that it was made with.
    #[test]
    fn texts_say_what_the_values_are() {
        let named = [angle("x"), Named { grows: true, ..angle("y") }];
        for product in products(&named) {
            let inner = |f: &(usize, super::Shape)| f.1.inner(&named[f.0].span()).len();
            let moved = Product(
                product
                    .0
                    .iter()
                    .map(|f| {
                        (
                            f.0,
                            (0..inner(f)).fold(f.1, |s, k| {
                                s.with(k, 0.3 + 0.07 * k as f64, &named[f.0].span())
                            }),
                        )
                    })
                    .collect(),
            );
            for one in [product, moved] {
                let text = one.text(&named);
                let mut graph = Graph::default();
                let mut input = |name: &str, _: Option<&str>| Ok(usize::from(name == "y"));
                let value = parse(&text, &mut graph, &mut input).expect("a formula");
                let program = Program::new(&graph, &[value]);
                for (p, expected) in one.values(&named).iter().enumerate() {
                    let found = program.value(|k| Lanes::splat(named[k].values[p])).0[0];
                    assert!(
                        (found - expected).abs() <= 1e-13 * (1.0 + expected.abs()),
                        "{text}: {found} for {expected}"
                    );
                }
            }
        }
    }
}

//! Which law: a formula that does as well as a smooth function, by (156).
//!
//! Formulas are sums of few products of a factor of each variable: powers, waves of whole orders of an
//! angle, a step and a bend at one of a few places, decays of time. The columns `Z` of a sum follow from
//! (71), so that none is refitted: with `T = uᵀ M⁻¹ u` for its `K` columns, among `N_K` such sums
//!
//! ```text
//! price = data(χ² - T) - data(χ²) + charge(K, T) + 2 ln N_K + 2 ln 3           (156)
//! ```
//!
//! beside the price (115) of the smooth function. What it finds is a [`Law`], as users write them.

use std::collections::BTreeMap;

use nalgebra::{DMatrix, DVector};

use crate::diagnosis::price::{Data, charge};
use crate::diagnosis::unknown_law::evidence::{Basis, Errors};
use crate::diagnosis::unknown_law::variables::Quantity;
use crate::estimate::at_fit::AtFit;
use crate::mechanism::{Class, Law, Mechanism, Per};
use crate::model::{Model, Want, Workspace};
use crate::numerics::lanes::Lanes;
use crate::text::significant;

/// Id of what is found, with a number where the mechanism has such a law already.
const FOUND: &str = "found_law";

/// Products in a sum, at the most.
const MOST: usize = 3;

/// Sums of fewer products that are extended by every further one, cheapest first: a limit of time.
const EXTENDED: usize = 40;

/// Powers, and orders of waves, up to this one.
const ORDER: usize = 3;

/// Places of steps and bends: so many parts of what a variable spans.
const PARTS: usize = 8;

/// Decays of time: these parts of a session.
const DECAYS: [f64; 3] = [0.05, 0.15, 0.5];

/// Part of a column's length that is left beside what is fitted, below which it is rounding.
const SMALL: f64 = 1e-6;

/// A law with what these data tell of its parameters.
#[derive(Debug, Clone, PartialEq)]
pub struct Written {
    /// The law, its parameters as typical sizes.
    pub law: Law,
    /// Estimates and their standard deviations, in the order of the law's parameters.
    pub values: Vec<[f64; 2]>,
    /// Its price, (156).
    pub price: f64,
    /// Its probability among all formulas and the smooth function.
    pub probability: f64,
}

/// A variable as formulas write it, with its value in each sample.
struct Named {
    text: String,
    values: Vec<f64>,
    /// An angle, of which there are waves.
    turns: bool,
    time: bool,
}

/// A function of one variable.
struct Factor {
    text: String,
    values: Vec<f64>,
}

/// A sum of products, by their numbers.
struct Sum {
    of: Vec<usize>,
    fall: f64,
    price: f64,
}

/// The formula that explains the errors of a channel best, over some variables; none where formulas do
/// not know these, or where no product shows. `smooth` is the price (115) of a smooth function of them.
pub(super) fn written(
    at: &AtFit,
    rows: &[usize],
    channel: usize,
    quantities: &[Quantity],
    errors: &Errors,
    (data, chi2, smooth): (&Data, f64, f64),
) -> Option<Written> {
    let mechanism = &at.observations.mechanism;
    let named: Option<Vec<Named>> =
        quantities.iter().map(|quantity| name(at, rows, channel, *quantity)).collect();
    let products = products(&named?);
    let m = products.len();
    if m == 0 {
        return None;
    }
    let gain = mechanism.channels[channel].gain;
    let values = (0..rows.len()).flat_map(|p| products.iter().map(move |f| f.values[p] / gain));
    let basis = Basis { degrees: vec![1.0; m], values: values.collect() };
    let plain = plain(errors, &basis);
    let (square, gradient) = errors.normal(&basis);
    let shows: Vec<usize> =
        (0..m).filter(|&j| square[(j, j)] > SMALL * plain[j] && plain[j] > 0.0).collect();
    let sums = sums(&shows, &square, &gradient, &|fall, width| {
        let less = data.of((chi2 - fall).max(0.0)) - data.of(chi2);
        less + charge(width as f64, fall)
            + 2.0 * choices(shows.len(), width).ln()
            + 2.0 * (MOST as f64).ln()
    });
    let best = sums.iter().min_by(|a, b| a.price.total_cmp(&b.price))?;
    let weight = |price: f64| (-0.5 * (price - best.price)).exp();
    let all: f64 = sums.iter().map(|sum| weight(sum.price)).sum::<f64>() + weight(smooth);
    let (estimate, inverse) = solved(&best.of, &square, &gradient)?;
    // A law corrects what the errors are.
    let values: Vec<[f64; 2]> =
        (0..best.of.len()).map(|k| [-estimate[k], inverse[(k, k)].max(0.0).sqrt()]).collect();
    let terms: Vec<&Factor> = best.of.iter().map(|&j| &products[j]).collect();
    let law = law(free_id(mechanism), &terms, &values);
    law.formula().ok()?;
    Some(Written { law, values, price: best.price, probability: 1.0 / all })
}

/// An id that no law of a mechanism has.
fn free_id(mechanism: &Mechanism) -> String {
    let taken = |id: &String| mechanism.laws.iter().any(|law| law.id == *id);
    let numbered = (2..).map(|k| format!("{FOUND}_{k}"));
    std::iter::once(FOUND.to_owned()).chain(numbered).find(|id| !taken(id)).unwrap_or_default()
}

/// The law of a sum.
fn law(id: String, terms: &[&Factor], values: &[[f64; 2]]) -> Law {
    let names: Vec<String> = (1..=terms.len()).map(|k| format!("c{k}")).collect();
    let products = names.iter().zip(terms).map(|(c, factor)| format!("{c}*{}", factor.text));
    let sizes = names.iter().zip(values).map(|(c, value)| (c.clone(), value[0].abs()));
    Law {
        id,
        class: Class::Sensor,
        per: Per::Channel,
        parameters: sizes.collect::<BTreeMap<String, f64>>(),
        correction: Some(products.collect::<Vec<_>>().join(" + ")),
        moves: None,
        amount: None,
        doc: String::new(),
    }
}

/// A quantity by the name that formulas of a channel have for it; none where they have none.
fn name(at: &AtFit, rows: &[usize], channel: usize, quantity: Quantity) -> Option<Named> {
    let observations = at.observations;
    let (mechanism, readings) = (&observations.mechanism, &observations.readings);
    let lanes = readings.lane_of_rows();
    let of = |value: &dyn Fn(usize, usize) -> f64| -> Vec<f64> {
        rows.iter().map(|&row| value(lanes[row].0, lanes[row].1)).collect()
    };
    let plain = |text: &str, values| Named { text: text.into(), values, turns: false, time: false };
    Some(match quantity {
        Quantity::Theta(c) => {
            let coordinates = coordinates(at, c);
            let values = of(&|block, lane| coordinates[block].0[lane]);
            let turns = mechanism.moves_joint(c) && !mechanism.slides(c);
            let text = format!("theta[{}]", mechanism.channels[c].name);
            Named { text, values, turns, time: false }
        }
        Quantity::Time => {
            let values = of(&|block, lane| readings.blocks()[block].time.0[lane]);
            Named { time: true, ..plain("t", values) }
        }
        Quantity::Temperature => {
            plain("temperature", of(&|block, lane| readings.blocks()[block].temperature.0[lane]))
        }
        // Of drives in closed loops `torque` is another, (46).
        Quantity::Torque(c) if c == channel && !mechanism.tells_of_drives() => {
            let torques = Model::torques(mechanism, readings, |b| at.settled(b)).ok()?;
            plain("torque", of(&|block, lane| torques[block][c].0[lane]))
        }
        Quantity::Direction(c) if c == channel => {
            plain("direction", of(&|block, lane| readings.approach(block)[c].0[lane]))
        }
        Quantity::Velocity(c) if c == channel => {
            plain("velocity", of(&|block, lane| readings.velocity(block)[c].0[lane]))
        }
        Quantity::Column(k) => {
            let name = mechanism.value_columns().swap_remove(k);
            let declared = mechanism.columns.iter().any(|column| column.name == name);
            let values = declared.then(|| of(&|block, lane| readings.columns(block)[k].0[lane]))?;
            plain(&name, values)
        }
        _ => return None,
    })
}

/// Coordinates of a channel as the fit has them, block by block.
fn coordinates(at: &AtFit, channel: usize) -> Vec<Lanes> {
    let readings = &at.observations.readings;
    let (want, mut ws) = (Want { x: false, a: false }, Workspace::default());
    let blocks = (0..readings.blocks().len()).map(|block| {
        at.fit.model.evaluate(readings, block, at.settled(block), &at.fit.beta, want, &mut ws);
        ws.angles[channel]
    });
    blocks.collect()
}

/// Products of a factor of each variable, and factors of one of them.
fn products(named: &[Named]) -> Vec<Factor> {
    let of: Vec<Vec<Factor>> = named.iter().map(factors).collect();
    let mut out: Vec<Factor> = Vec::new();
    if let [one, other] = &of[..] {
        out.extend(one.iter().flat_map(|a| other.iter().map(move |b| times(a, b))));
    }
    out.extend(of.into_iter().flatten());
    out
}

fn times(a: &Factor, b: &Factor) -> Factor {
    let values = a.values.iter().zip(&b.values).map(|(a, b)| a * b).collect();
    Factor { text: format!("{}*{}", a.text, b.text), values }
}

/// Functions of one variable.
fn factors(named: &Named) -> Vec<Factor> {
    let Named { text, values, turns, time } = named;
    let of = |text: String, f: &dyn Fn(f64) -> f64| Factor {
        text,
        values: values.iter().map(|v| f(*v)).collect(),
    };
    let mut out = vec![of(text.clone(), &|v| v)];
    let low = values.iter().copied().fold(f64::INFINITY, f64::min);
    let high = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    // A direction has three values: of its powers there is one.
    if values.iter().all(|v| *v == v.signum() || *v == 0.0) {
        return out;
    }
    for power in 2..=ORDER {
        out.push(of(format!("{text}^{power}"), &|v| v.powi(power as i32)));
    }
    if *turns {
        for order in 1..=ORDER {
            let k = order as f64;
            let inside = if order == 1 { text.clone() } else { format!("{order}*{text}") };
            out.push(of(format!("sin({inside})"), &|v| (k * v).sin()));
            out.push(of(format!("cos({inside})"), &|v| (k * v).cos()));
        }
    }
    for decay in DECAYS.iter().filter(|_| *time) {
        out.push(of(format!("exp(-{text}/{decay})"), &|v| (-v / decay).exp()));
    }
    for part in 1..PARTS {
        let place = low + (high - low) * part as f64 / PARTS as f64;
        // As it is written.
        let written = significant(place, 3);
        let Ok(place) = written.parse::<f64>() else { continue };
        let past = if place < 0.0 {
            format!("{text} + {}", significant(-place, 3))
        } else {
            format!("{text} - {written}")
        };
        out.push(of(format!("step({past})"), &|v| f64::from(u8::from(v >= place))));
        out.push(of(format!("max({past}, 0)"), &|v| (v - place).max(0.0)));
    }
    out
}

/// `Σ a²` of each column, before what is fitted takes its part.
fn plain(errors: &Errors, basis: &Basis) -> Vec<f64> {
    let m = basis.degrees.len();
    let mut out = vec![0.0; m];
    for (values, square) in basis.values.chunks_exact(m).zip(&errors.square) {
        out.iter_mut().zip(values).for_each(|(sum, v)| *sum += v * v * square);
    }
    out
}

/// Sums of the columns that show: all of one and of two, and the cheapest of these with one more.
fn sums(
    shows: &[usize],
    square: &DMatrix<f64>,
    gradient: &DVector<f64>,
    price: &dyn Fn(f64, usize) -> f64,
) -> Vec<Sum> {
    let one = |of: Vec<usize>| -> Option<Sum> {
        let fall = fall(&of, square, gradient)?;
        Some(Sum { price: price(fall, of.len()), fall, of })
    };
    let mut all: Vec<Sum> = shows.iter().filter_map(|&j| one(vec![j])).collect();
    let pairs =
        shows.iter().enumerate().flat_map(|(k, &i)| shows[..k].iter().map(move |&j| [j, i]));
    all.extend(pairs.filter_map(|pair| one(pair.to_vec())));
    for width in 3..=MOST {
        let mut best: Vec<&Sum> = all.iter().filter(|sum| sum.of.len() == width - 1).collect();
        best.sort_by(|a, b| b.fall.total_cmp(&a.fall));
        best.truncate(EXTENDED);
        let longer = best.iter().flat_map(|sum| {
            let others = shows.iter().filter(|j| !sum.of.contains(j));
            others.map(|&j| sum.of.iter().copied().chain([j]).collect::<Vec<usize>>())
        });
        let longer: Vec<Sum> = longer.filter_map(one).collect();
        all.extend(longer);
    }
    all
}

/// `uᵀ M⁻¹ u` of up to [`MOST`] columns; none where they are alike.
fn fall(of: &[usize], square: &DMatrix<f64>, gradient: &DVector<f64>) -> Option<f64> {
    // Cholesky's factor in units of each column, with the right-hand side below. Nothing is
    // allocated: it is done for each pair.
    let (mut l, mut long) = ([[0.0_f64; MOST + 1]; MOST], [0.0_f64; MOST]);
    let mut fall = 0.0;
    for (k, &j) in of.iter().enumerate() {
        long[k] = square[(j, j)].sqrt();
        let taken: [f64; MOST + 1] =
            std::array::from_fn(|other| (0..k).map(|c| l[c][other] * l[c][k]).sum());
        let pivot = 1.0 - taken[k];
        if pivot.is_nan() || pivot < SMALL {
            return None;
        }
        for (other, &i) in of.iter().enumerate().skip(k + 1) {
            let unit = square[(j.min(i), j.max(i))] / (long[k] * square[(i, i)].sqrt());
            l[k][other] = (unit - taken[other]) / pivot.sqrt();
        }
        l[k][MOST] = (gradient[j] / long[k] - taken[MOST]) / pivot.sqrt();
        fall += l[k][MOST].powi(2);
    }
    Some(fall)
}

/// `M⁻¹ u` and `M⁻¹` of some columns; none where they are alike.
fn solved(
    of: &[usize],
    square: &DMatrix<f64>,
    gradient: &DVector<f64>,
) -> Option<(DVector<f64>, DMatrix<f64>)> {
    let k = of.len();
    let long: Vec<f64> = of.iter().map(|&j| square[(j, j)].sqrt()).collect();
    // In units of each column: a power of an angle and one of a length differ by orders.
    let unit = DMatrix::from_fn(k, k, |i, j| square[(of[i], of[j])] / (long[i] * long[j]));
    let root = unit.cholesky()?;
    if root.l_dirty().diagonal().iter().any(|d| d * d < SMALL) {
        return None;
    }
    let right = DVector::from_fn(k, |i, _| gradient[of[i]] / long[i]);
    let estimate = root.solve(&right);
    let inverse = root.inverse();
    Some((
        DVector::from_fn(k, |i, _| estimate[i] / long[i]),
        DMatrix::from_fn(k, k, |i, j| inverse[(i, j)] / (long[i] * long[j])),
    ))
}

/// In how many ways `k` of `n` can be chosen.
fn choices(n: usize, k: usize) -> f64 {
    (0..k).map(|i| (n - i) as f64 / (i + 1) as f64).product::<f64>().max(1.0)
}

#[cfg(test)]
mod tests {
    use nalgebra::{DMatrix, DVector};

    use super::{fall, solved};

    #[test]
    fn a_fall_is_that_of_the_inverse() {
        let z = DMatrix::from_fn(9, 4, |i, j| ((i * i + 3 * i * j + j) as f64).sin());
        let (square, gradient) =
            (z.transpose() * &z, DVector::from_fn(4, |j, _| (j as f64 + 0.3).cos()));
        for of in [&[2][..], &[3, 1], &[0, 2, 3]] {
            let (own, inverse) = solved(of, &square, &gradient).unwrap();
            let u = DVector::from_fn(of.len(), |k, _| gradient[of[k]]);
            let expected = (u.transpose() * &inverse * &u)[(0, 0)];
            assert!((own.dot(&u) - expected).abs() < 1e-12 * expected);
            assert!((fall(of, &square, &gradient).unwrap() - expected).abs() < 1e-12 * expected);
        }
        let same = DMatrix::from_fn(9, 2, |i, j| ((i * i) as f64).sin() * (j + 1) as f64);
        assert!(fall(&[0, 1], &(same.transpose() * &same), &gradient).is_none());
    }
}

//! Which law: a formula that does as well as a smooth function, by (156).
//!
//! Formulas are sums of few products of a factor of each variable: powers from a place, waves of an angle,
//! steps and bends at a place, what saturates, ratios, decays of time. The columns `Z` of a sum follow from (71), so that
//! none is refitted: with `T = uᵀ M⁻¹ u` for its `K` columns, among `N_K` such sums of a few places and whole orders
//!
//! ```text
//! price = data(χ² - T) - data(χ²) + charge(K + R, T) + 2 ln N_K + 2 ln 3           (156)
//! ```
//!
//! beside the price (115) of the smooth function. Then `R` of the places, orders, phases and lengths inside
//! the cheapest sums are moved, each for the price of a parameter. What it finds is a [`Law`], as users write
//! them.

mod refined;
mod shapes;
mod sums;

use crate::numerics::order::Ends;
use std::cell::RefCell;
use std::collections::BTreeMap;

use nalgebra::{DMatrix, DVector};

use crate::diagnosis::price::{Data, charge, less};
use crate::diagnosis::unknown_law::evidence::{Column, Errors};
use crate::diagnosis::unknown_law::formula::refined::refine;
use crate::diagnosis::unknown_law::formula::shapes::{Kind, Named, Product, Span, products};
pub(super) use crate::diagnosis::unknown_law::formula::sums::SMALL;
use crate::diagnosis::unknown_law::formula::sums::{MOST, Sum, choices, fall, solved, sums};
use crate::diagnosis::unknown_law::variables::Quantity;
use crate::diagnosis::unknown_law::whose::Whose;
use crate::estimate::at_fit::AtFit;
use crate::mechanism::{Law, Mechanism, Target};
use crate::model::{Model, Want, Workspace};
use crate::numerics::lanes::Lanes;
use crate::numerics::order;
use crate::numerics::search::edge;
use crate::readings::way::Memory;

/// Id of what is found, with a number where the mechanism has such a law already.
const FOUND: &str = "found_law";

/// Sums of each width whose numbers are moved, the best first: a limit of time.
const MOVED: usize = 10;

/// Prices beyond the least by which a sum is of no account: by `e⁻²⁰` as likely.
const NO_ACCOUNT: f64 = 40.0;

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

/// The formula that explains the errors of a place best, over some variables; none where formulas do
/// not know these, or where no product shows. `smooth` is the price (115) of a smooth function of them; `errors` may
/// be beside an error that is the same in all samples, and `plain` are not.
pub(super) fn written(
    at: &AtFit,
    rows: &[usize],
    whose: &Whose,
    quantities: &[Quantity],
    [errors, plain]: [&Errors; 2],
    (data, chi2, smooth): (&Data, f64, f64),
) -> Option<Written> {
    let mechanism = &at.observations.mechanism;
    let named: Option<Vec<Named>> =
        quantities.iter().map(|quantity| name(at, rows, whose, *quantity)).collect();
    let named = named?;
    let products = products(&named);
    let gain = whose.gain(mechanism);
    let columns = Columns { named: &named, errors, gain, last: RefCell::default() };
    let (square, gradient, shows) = columns.of(&products);
    let [constant, paid] = errors.constant.unwrap_or_default();
    let lower = |fall: f64| data.of(less(chi2, constant + fall)) - data.of(chi2);
    let price = |fall: f64, width: usize, moved: usize| {
        lower(fall)
            + paid
            + charge((width + moved) as f64, fall)
            + 2.0 * choices(shows.len(), width).ln()
            + 2.0 * (MOST as f64).ln()
    };
    let sums = sums(&shows, &square, &gradient);
    let spans: Vec<Span> = named.iter().map(Named::span).collect();
    let refined = unlike(&sums, &products).into_iter().map(|sum| {
        let own: Vec<Product> = sum.of.iter().map(|&j| products[j].clone()).collect();
        refine(own, &spans, sum.fall, &|of| columns.fall(of), &|fall, moved| {
            price(fall, sum.of.len(), moved)
        })
    });
    let best = refined.least_by(|a| a.price)?;
    let weight = |price: f64| (-0.5 * (price - best.price)).exp();
    let most = sums.iter().map(|sum| sum.fall).fold(0.0, f64::max);
    // Nearly all sums are far less likely: they are not priced.
    let far = |fall: f64, width: usize| price(fall, width, 0) > best.price + NO_ACCOUNT;
    let counts: Vec<f64> =
        (0..=MOST).map(|width| edge(|fall| far(fall, width), 0.0, most)).collect();
    let counted = sums.iter().filter(|sum| sum.fall >= counts[sum.of.len()]);
    let of_sums = counted.map(|sum| weight(price(sum.fall, sum.of.len(), 0)));
    let own = if best.moved == 0 { 0.0 } else { 1.0 };
    let all = of_sums.sum::<f64>() + weight(smooth) + own;
    let mut products = best.products;
    products.extend(errors.constant.map(|_| Product::constant()));
    let (square, gradient, _) = Columns { errors: plain, ..columns }.of(&products);
    let which: Vec<usize> = (0..products.len()).collect();
    let (estimate, inverse) = solved(&which, &square, &gradient)?;
    // A law corrects what the errors are.
    let values: Vec<[f64; 2]> =
        which.iter().map(|&k| [-estimate[k], inverse[(k, k)].max(0.0).sqrt()]).collect();
    let texts: Vec<String> = products.iter().map(|one| one.text(&named)).collect();
    let law = law(free_id(mechanism), whose, &texts, &values);
    law.formula().ok()?;
    Some(Written { law, values, price: best.price, probability: 1.0 / all })
}

/// The best sums of each width, of which no two have the same shapes.
fn unlike<'a>(sums: &'a [Sum], products: &[Product]) -> Vec<&'a Sum> {
    let mut best: BTreeMap<Vec<Vec<Kind>>, &Sum> = BTreeMap::new();
    for sum in sums {
        let mut kinds: Vec<Vec<Kind>> = sum.of.iter().map(|&j| products[j].kinds()).collect();
        kinds.sort();
        let own = best.entry(kinds).or_insert(sum);
        if sum.fall > own.fall {
            *own = sum;
        }
    }
    let mut best: Vec<&Sum> = best.into_values().collect();
    order::descending(&mut best, |a| a.fall);
    let of =
        |width: usize| best.iter().copied().filter(move |sum| sum.of.len() == width).take(MOVED);
    (1..=MOST).flat_map(of).collect()
}

/// Products as columns of a fit, in the unit of readings.
struct Columns<'a> {
    named: &'a [Named],
    errors: &'a Errors,
    gain: f64,
    /// Columns of the last sum: the next sum shares most of them.
    last: RefCell<Vec<(Product, Column)>>,
}

impl Columns<'_> {
    /// `M`, `u` and the columns that show beside what is fitted.
    fn of(&self, products: &[Product]) -> (DMatrix<f64>, DVector<f64>, Vec<usize>) {
        let m = products.len();
        let each: Vec<Vec<f64>> = products.iter().map(|one| one.values(self.named)).collect();
        let samples = self.errors.square.len();
        let values = (0..samples).flat_map(|p| each.iter().map(move |of| of[p] / self.gain));
        let (square, gradient) = self.errors.normal_of(m, values.collect());
        // `Σ a²`, before what is fitted takes its part.
        let plain = |of: &[f64]| -> f64 {
            let each = of.iter().zip(&self.errors.square);
            each.map(|(v, square)| (v / self.gain).powi(2) * square).sum()
        };
        let shows = (0..m).filter(|&j| shows(square[(j, j)], plain(&each[j]))).collect();
        (square, gradient, shows)
    }

    /// By how much χ² falls with a sum of these; none where they do not show, or are alike.
    fn fall(&self, products: &[Product]) -> Option<f64> {
        let mut last = self.last.take();
        let kept = |one: &Product, last: &mut Vec<(Product, Column)>| {
            let at = last.iter().position(|(product, _)| product == one)?;
            Some(last.swap_remove(at))
        };
        let own = |one: &Product| {
            let values = one.values(self.named).iter().map(|v| v / self.gain).collect();
            (one.clone(), self.errors.column(values))
        };
        let of: Vec<(Product, Column)> =
            products.iter().map(|one| kept(one, &mut last).unwrap_or_else(|| own(one))).collect();
        let m = of.len();
        let square = DMatrix::from_fn(m, m, |i, j| {
            if i <= j { self.errors.entry(&of[i].1, &of[j].1) } else { 0.0 }
        });
        let gradient = DVector::from_fn(m, |j, _| of[j].1.along);
        let all_show = (0..m).all(|j| shows(square[(j, j)], of[j].1.plain));
        self.last.replace(of);
        let all: Vec<usize> = (0..m).collect();
        all_show.then(|| fall(&all, &square, &gradient))?
    }
}

/// True where a part of a column is left beside what is fitted that is no rounding of the whole.
fn shows(left: f64, plain: f64) -> bool {
    left > SMALL * plain
}

/// An id that no law of a mechanism has.
fn free_id(mechanism: &Mechanism) -> String {
    let taken = |id: &String| mechanism.laws.iter().any(|law| law.id == *id);
    let numbered = (2..).map(|k| format!("{FOUND}_{k}"));
    std::iter::once(FOUND.to_owned()).chain(numbered).find(|id| !taken(id)).unwrap_or_default()
}

/// The law of a sum.
fn law(id: String, whose: &Whose, products: &[String], values: &[[f64; 2]]) -> Law {
    let names: Vec<String> = (1..=products.len()).map(|k| format!("c{k}")).collect();
    let products = names.iter().zip(products).map(|(c, product)| match product.is_empty() {
        true => c.clone(),
        false => format!("{c}*{product}"),
    });
    let sizes = names.iter().zip(values).map(|(c, value)| (c.clone(), value[0].abs()));
    let text = products.collect::<Vec<_>>().join(" + ");
    whose.law(id, text, sizes.collect::<BTreeMap<String, f64>>())
}

/// A quantity by the name that formulas of a place have for it; none where they have none.
fn name(at: &AtFit, rows: &[usize], whose: &Whose, quantity: Quantity) -> Option<Named> {
    let observations = at.observations;
    let (mechanism, readings) = (&observations.mechanism, &observations.readings);
    let lanes = readings.lane_of_rows();
    let of = |value: &dyn Fn(usize, usize) -> f64| -> Vec<f64> {
        rows.iter().map(|&row| value(lanes[row].0, lanes[row].1)).collect()
    };
    let own = |c: usize| whose.target == Target::Channel(c);
    let plain = |text: &str, values| Named { text: text.into(), values, ..Named::default() };
    let theta = |c: usize| {
        let coordinates = coordinates(at, c);
        of(&|block, lane| coordinates[block].0[lane])
    };
    // Of readings as the fit settles them: what is as good as a line is then a gain, and not the noise of readings.
    let visits =
        |c: usize| readings.visits(c).at_rows(rows).settled(&theta(c), mechanism.channels[c].gain);
    let of_channel = |what: &str, c: usize| format!("{what}[{}]", mechanism.channels[c].name);
    Some(match quantity {
        Quantity::Theta(c) => {
            let turns = mechanism.moves_joint(c) && !mechanism.slides(c);
            Named { turns, moves: true, ..plain(&of_channel("theta", c), theta(c)) }
        }
        Quantity::Time => {
            let values = of(&|block, lane| readings.blocks()[block].time.0[lane]);
            Named { grows: true, ..plain("t", values) }
        }
        Quantity::Temperature => {
            plain("temperature", of(&|block, lane| readings.blocks()[block].temperature.0[lane]))
        }
        // Of drives in closed loops `torque` is another, (46).
        Quantity::Torque(c) if mechanism.moves_joint(c) && !mechanism.tells_of_drives() => {
            let torques = Model::torques(mechanism, readings, |b| at.settled(b)).ok()?;
            let other = of_channel("torque", c);
            let text = if own(c) { "torque" } else { &other };
            Named { signed: true, ..plain(text, of(&|block, lane| torques[block][c].0[lane])) }
        }
        Quantity::Direction(c) if own(c) => {
            plain("direction", of(&|block, lane| readings.approach(block)[c].0[lane]))
        }
        Quantity::Velocity(c) if own(c) => {
            let values = of(&|block, lane| readings.velocity(block)[c].0[lane]);
            Named { signed: true, ..plain("velocity", values) }
        }
        Quantity::Travelled(c) => {
            let values = visits(c).remembered(Memory::Travelled);
            Named { grows: true, ..plain(&of_channel("travelled", c), values) }
        }
        Quantity::SinceTurn(c) => {
            let values = visits(c).remembered(Memory::SinceTurn);
            Named { signed: true, ..plain(&of_channel("since_turn", c), values) }
        }
        Quantity::Play(c) => {
            let (name, visits) = (&mechanism.channels[c].name, visits(c));
            Named { way: Some(visits.clone()), ..plain(name, visits.places()) }
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnosis::unknown_law::evidence::tests::errors;
    use crate::diagnosis::unknown_law::formula::shapes::Shape;

    #[test]
    fn a_sum_falls_as_much_with_columns_that_are_kept() {
        let n = 12;
        let (errors, ..) = errors(n);
        let values = (0..n).map(|p| (0.9 * p as f64 + 0.3).sin()).collect();
        let named = [Named { moves: true, values, ..Named::default() }];
        let columns =
            Columns { named: &named, errors: &errors, gain: 0.5, last: RefCell::default() };
        let wave = |order: f64| Product(vec![(0, Shape::Wave { order, phase: 0.3 })]);
        for orders in [&[1.0, 2.0][..], &[1.0, 3.0], &[3.0, 1.7, 2.0], &[2.0], &[1.7, 3.0, 2.0]] {
            let of: Vec<Product> = orders.iter().copied().map(wave).collect();
            let (square, gradient, shows) = columns.of(&of);
            let expected = fall(&shows, &square, &gradient).expect("they are unlike");
            let found = columns.fall(&of).expect("they are unlike");
            // Sums of a dozen products, and columns that are alike to some parts in a thousand.
            assert!((found - expected).abs() < 1e-9 * expected, "{orders:?}");
            assert_eq!(columns.fall(&[wave(1.0), wave(1.0)]), None);
        }
    }
}

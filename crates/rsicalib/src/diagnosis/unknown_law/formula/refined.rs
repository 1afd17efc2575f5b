//! Numbers inside the products of a sum, moved to where it explains most.

use crate::diagnosis::unknown_law::formula::shapes::{Product, Span};
use crate::numerics::search::highest;

/// Values of a number that are tried, evenly over its range, before what is about the best of them.
const TRIED: usize = 8;

stated! {
    /// How often all numbers are moved in turn, at the most.
    fn sweeps() -> usize = 3;
}

/// A sum with what it costs.
pub(super) struct Refined {
    pub(super) products: Vec<Product>,
    pub(super) price: f64,
    /// Numbers inside it that were moved.
    pub(super) moved: usize,
}

/// Moves the numbers inside a sum by which χ² falls by `fall`, one after the other, where its price with
/// one more number falls too.
pub(super) fn refine(
    products: Vec<Product>,
    spans: &[Span],
    start: f64,
    fall: &dyn Fn(&[Product]) -> Option<f64>,
    price: &dyn Fn(f64, usize) -> f64,
) -> Refined {
    let mut best = Refined { price: price(start, 0), products, moved: 0 };
    let mut moved: Vec<(usize, usize, usize)> = Vec::new();
    for _ in 0..sweeps() {
        let before = best.price;
        for place in places(&best.products, spans) {
            let more = usize::from(!moved.contains(&place));
            let (product, factor, which) = place;
            let (variable, shape) = best.products[product].0[factor];
            let with = |value: f64| {
                let mut changed = best.products.clone();
                changed[product].0[factor].1 = shape.with(which, value);
                changed
            };
            let costs = |value: f64| {
                fall(&with(value)).map_or(f64::INFINITY, |fall| price(fall, best.moved + more))
            };
            let (_, range) = shape.inner(&spans[variable])[which];
            let value = cheapest(range, &costs);
            let least = costs(value);
            if least < best.price {
                best = Refined { products: with(value), price: least, moved: best.moved + more };
                if more == 1 {
                    moved.push(place);
                }
            }
        }
        if before - best.price < 0.1 {
            break;
        }
    }
    best
}

/// Every number inside some products: of which product, factor, and which of its own.
fn places(products: &[Product], spans: &[Span]) -> Vec<(usize, usize, usize)> {
    let of = |(p, product): (usize, &Product)| {
        let each = product.0.iter().enumerate().flat_map(move |(f, (v, shape))| {
            (0..shape.inner(&spans[*v]).len()).map(move |k| (p, f, k))
        });
        each.collect::<Vec<_>>()
    };
    products.iter().enumerate().flat_map(of).collect()
}

/// The value within a range that costs least: the best of a grid, and what is about it.
fn cheapest([low, high]: [f64; 2], price: &dyn Fn(f64) -> f64) -> f64 {
    let step = (high - low) / TRIED as f64;
    let grid = (0..=TRIED).map(|k| low + step * k as f64).map(|value| (price(value), value));
    let Some((least, best)) = grid.min_by(|a, b| a.0.total_cmp(&b.0)) else { return low };
    let (about, found) = highest(|value| -price(value), [best - step, best + step]);
    if -found < least { about } else { best }
}

#[cfg(test)]
mod tests {
    use super::refine;
    use crate::diagnosis::unknown_law::formula::shapes::{Product, Shape};

    /// An order that is 1.23 with a fall of 100, less by 1,000 times the square of what it is off.
    fn fall(products: &[Product]) -> Option<f64> {
        let Shape::Wave { order, .. } = products[0].0[0].1 else { return None };
        Some(100.0 - 1000.0 * (order - 1.23_f64).powi(2))
    }

    #[test]
    fn a_number_moves_where_it_pays_and_no_other_does() {
        let wave = Shape::Wave { order: 1.0, phase: 0.0 };
        let start = vec![Product(vec![(0, wave)])];
        let of = |charge: f64| {
            let price = |fall: f64, moved: usize| charge * moved as f64 - fall;
            refine(start.clone(), &[[-1.0, 1.0]], 100.0 - 52.9, &fall, &price)
        };
        let moved = of(5.0);
        let Shape::Wave { order, phase } = moved.products[0].0[0].1 else { panic!("a wave") };
        // As formulas write numbers, with four digits: half of the last of them costs 3e-4 at the most.
        assert!((order - 1.23).abs() <= 5e-4 && phase == 0.0, "{order}, {phase}");
        assert_eq!(moved.moved, 1);
        assert!((moved.price - (5.0 - 100.0)).abs() < 1e-3);
        // By moving it 52.9 can be won.
        assert_eq!(of(53.0).products, start);
        assert_eq!(of(53.0).moved, 0);
    }
}

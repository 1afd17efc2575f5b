//! Numbers inside the products of a sum, moved to where it explains most.

use crate::diagnosis::unknown_law::formula::shapes::{Product, Span};
use crate::numerics::order::Ends;
use crate::numerics::search::highest;

/// Values of a number that are tried, evenly over its range, before what is about the best of them.
const TRIED: usize = 8;

/// A search for numbers ends where the price falls by less: of two formulas one is then likelier by a twentieth at
/// the most, e^.05.
const SETTLED: f64 = 0.1;

/// How far a search looks along the way that it came, in parts of that way: no price depends on it, only how many
/// rounds are needed.
const FARTHER: f64 = 4.0;

/// A sum with what it costs.
#[derive(Clone)]
pub(super) struct Refined {
    pub(super) products: Vec<Product>,
    pub(super) price: f64,
    /// Numbers inside it that were moved.
    pub(super) moved: usize,
}

/// A number inside some products: of which product, of which factor, and which of its own.
type Place = (usize, usize, usize);

/// Moves the numbers inside a sum by which χ² falls by `fall`: the one that pays most by its price, then
/// those that were moved in turn, until no further one pays.
pub(super) fn refine(
    products: Vec<Product>,
    spans: &[Span],
    start: f64,
    fall: &dyn Fn(&[Product]) -> Option<f64>,
    price: &dyn Fn(f64, usize) -> f64,
) -> Refined {
    let moves = Moves { spans, fall, price };
    let mut best = Refined { price: price(start, 0), products, moved: 0 };
    let mut moved: Vec<Place> = Vec::new();
    loop {
        let places = places(&best.products, spans).into_iter().filter(|p| !moved.contains(p));
        let each = places.map(|place| (moves.along(&best, place, best.moved + 1), place));
        let Some((next, place)) = each.least_by(|a| a.0.price) else {
            break;
        };
        if next.price >= best.price {
            break;
        }
        moved.push(place);
        best = moves.settled(next, &moved);
    }
    best
}

/// What sums cost, with their numbers moved.
struct Moves<'a> {
    spans: &'a [Span],
    fall: &'a dyn Fn(&[Product]) -> Option<f64>,
    price: &'a dyn Fn(f64, usize) -> f64,
}

impl Moves<'_> {
    fn of(&self, products: Vec<Product>, moved: usize) -> Refined {
        let fall = (self.fall)(&products);
        Refined {
            price: fall.map_or(f64::INFINITY, |fall| (self.price)(fall, moved)),
            products,
            moved,
        }
    }

    /// One number where the sum costs least.
    fn along(&self, from: &Refined, place: Place, moved: usize) -> Refined {
        let (_, range) = self.number(&from.products, place);
        let at = |value: f64| self.of(self.with(&from.products, place, value), moved);
        at(cheapest(range, &|value| at(value).price))
    }

    /// All numbers that were moved, in turn and along the way that they came together, until none pays.
    fn settled(&self, mut best: Refined, moved: &[Place]) -> Refined {
        loop {
            let before = best.clone();
            for &place in moved {
                let next = self.along(&best, place, best.moved);
                if next.price < best.price {
                    best = next;
                }
            }
            let farther = |part: f64| {
                let products = moved.iter().fold(best.products.clone(), |products, &place| {
                    let [from, to] = [&before, &best].map(|of| self.number(&of.products, place).0);
                    self.with(&products, place, to + part * (to - from))
                });
                self.of(products, best.moved)
            };
            if moved.len() > 1 {
                let (part, _) = highest(|part| -farther(part).price, [0.0, FARTHER]);
                let next = farther(part);
                if next.price < best.price {
                    best = next;
                }
            }
            let fell = before.price - best.price;
            if fell.is_nan() || fell < SETTLED {
                return best;
            }
        }
    }

    fn number(&self, products: &[Product], (product, factor, which): Place) -> (f64, Span) {
        let (variable, shape) = products[product].0[factor];
        shape.inner(&self.spans[variable])[which]
    }

    /// With another number, which stays within its range.
    fn with(
        &self,
        products: &[Product],
        (product, factor, which): Place,
        value: f64,
    ) -> Vec<Product> {
        let mut changed = products.to_vec();
        let (variable, shape) = changed[product].0[factor];
        let (_, [low, high]) = self.number(products, (product, factor, which));
        let value = value.max(low).min(high);
        changed[product].0[factor].1 = shape.with(which, value, &self.spans[variable]);
        changed
    }
}

/// Every number inside some products.
fn places(products: &[Product], spans: &[Span]) -> Vec<Place> {
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
    let Some((least, best)) = grid.least_by(|a| a.0) else { return low };
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

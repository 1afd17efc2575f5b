//! Numbers inside the products of a sum, moved to where it explains most.

use crate::diagnosis::unknown_law::formula::shapes::{Product, Span};

/// Values of a number that are tried, evenly over its range, and then about the best of them.
const TRIED: usize = 8;

/// How often the range is halved about the best.
const HALVED: usize = 7;

/// How often all numbers are moved in turn.
const SWEEPS: usize = 3;

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
    for _ in 0..SWEEPS {
        let before = best.price;
        for place in places(&best.products, spans) {
            let more = usize::from(!moved.contains(&place));
            let at = |value: f64| -> Option<(f64, Vec<Product>)> {
                let mut changed = best.products.clone();
                let (product, factor, which) = place;
                let shape = &mut changed[product].0[factor].1;
                *shape = shape.with(which, value);
                Some((price(fall(&changed)?, best.moved + more), changed))
            };
            let (product, factor, which) = place;
            let (variable, shape) = best.products[product].0[factor];
            let (_, range) = shape.inner(&spans[variable])[which];
            let Some((cheapest, changed)) = cheapest(range, &at) else { continue };
            if cheapest < best.price {
                best = Refined { products: changed, price: cheapest, moved: best.moved + more };
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

/// What costs least within a range: on a grid, then by halves about the best.
fn cheapest<T>([low, high]: [f64; 2], at: &dyn Fn(f64) -> Option<(f64, T)>) -> Option<(f64, T)> {
    let mut best: Option<(f64, f64, T)> = None;
    let consider = |value: f64, best: &mut Option<(f64, f64, T)>| {
        if let Some((price, what)) = at(value)
            && best.as_ref().is_none_or(|(least, ..)| price < *least)
        {
            *best = Some((price, value, what));
        }
    };
    let step = (high - low) / TRIED as f64;
    (0..=TRIED).for_each(|k| consider(low + step * k as f64, &mut best));
    let mut half = step;
    for _ in 0..HALVED {
        half *= 0.5;
        let middle = best.as_ref()?.1;
        consider(middle - half, &mut best);
        consider(middle + half, &mut best);
    }
    best.map(|(price, _, what)| (price, what))
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
        // An eighth of the range, halved seven times: 1/1024 of it, which costs .001 at the most.
        assert!((order - 1.23).abs() <= 1.0 / 1024.0 && phase == 0.0, "{order}, {phase}");
        assert_eq!(moved.moved, 1);
        assert!((moved.price - (5.0 - 100.0)).abs() < 1e-3);
        // By moving it 52.9 can be won.
        assert_eq!(of(53.0).products, start);
        assert_eq!(of(53.0).moved, 0);
    }
}

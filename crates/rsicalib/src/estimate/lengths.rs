//! One length of a drawing in another unit than the others: a link in metres among millimetres.

use crate::Error;
use crate::estimate::miswired::{Again, closing};
use crate::estimate::objective::Noise;
use crate::estimate::observations::Observations;
use crate::estimate::suspicion::{Closes, Measure, Suspicion};
use crate::mechanism::{Mechanism, Value};
use crate::numerics::order;
use crate::numerics::order::Ends;

/// Units of length in each other.
pub(crate) const UNITS: [f64; 5] = [10.0, 25.4, 100.0 / 2.54, 100.0, 1000.0];

/// A length is among others that is at most so many times the longest of them, and not so many times
/// shorter than the shortest. It says which fits are tried, and judges nothing.
const AMONG: f64 = 2.0;

/// Fewer lengths than this tell nothing of one that stands apart.
const FEW: usize = 4;

/// Every length that is drawn, and not zero.
fn drawn(mechanism: &mut Mechanism) -> Vec<(Measure, f64)> {
    let rows = mechanism.chains.iter().enumerate();
    let of_row = |chain: usize, row: usize| {
        let along = (0..3).map(move |axis| Measure::Along { chain, row, axis });
        [Measure::A { chain, row }, Measure::D { chain, row }].into_iter().chain(along)
    };
    let rows =
        rows.flat_map(|(chain, it)| (0..it.rows.len()).flat_map(move |row| of_row(chain, row)));
    let at = |point: usize| (0..3).map(move |axis| Measure::At { point, axis });
    let points = (0..mechanism.points.len()).flat_map(at);
    let distances = (0..mechanism.closures.len()).map(|closure| Measure::Distance { closure });
    let all: Vec<Measure> = rows.chain(points).chain(distances).collect();
    let sized = |measure: Measure| Some((measure, *place(mechanism, measure)?));
    all.into_iter().filter_map(sized).filter(|(_, size)| *size != 0.0).collect()
}

/// Where a length stands in a drawing.
fn place(mechanism: &mut Mechanism, measure: Measure) -> Option<&mut f64> {
    match measure {
        Measure::A { chain, row } => Some(&mut mechanism.chains[chain].rows[row].a),
        Measure::D { chain, row } => Some(&mut mechanism.chains[chain].rows[row].d),
        Measure::Along { chain, row, axis } => {
            Some(&mut mechanism.chains[chain].rows[row].xyz[axis])
        }
        Measure::At { point, axis } => Some(&mut mechanism.points[point].at.as_mut()?[axis]),
        Measure::Distance { closure } => match mechanism.closures[closure].value.as_mut()? {
            Value::Known(value) => Some(value),
            Value::Column(_) => None,
        },
    }
}

/// The shortest and the longest length, and by what either would be among the others.
fn apart(lengths: &[(Measure, f64)]) -> Vec<(Measure, f64, f64)> {
    let mut sorted = lengths.to_vec();
    order::ascending(&mut sorted, |a| a.1.abs());
    let mut out = Vec::new();
    for (own, others) in [
        (sorted.first(), sorted.get(1..)),
        (sorted.last(), sorted.get(..sorted.len().saturating_sub(1))),
    ] {
        let (Some(&(measure, size)), Some([(_, low), .., (_, high)])) = (own, others) else {
            continue;
        };
        let among = low.abs() / AMONG..=high.abs() * AMONG;
        if among.contains(&size.abs()) {
            continue;
        }
        let times = UNITS.into_iter().flat_map(|unit| [unit, 1.0 / unit]);
        let right = times.filter(|times| among.contains(&(size * times).abs()));
        out.extend(right.map(|times| (measure, size, times)));
    }
    out
}

/// The length with which the loop closes in another unit, and by far not as it is declared: `left` is
/// χ² per degree of freedom by a `noise`, and `refit` a fit of other observations.
pub(crate) fn in_other_unit(
    observations: &Observations,
    noise: &Noise,
    left: f64,
    refit: impl Fn(&Observations) -> Result<Again, Error>,
) -> Option<Suspicion> {
    let limit = closing(observations, left)?;
    let lengths = drawn(&mut observations.mechanism.clone());
    if lengths.len() < FEW {
        return None;
    }
    let tried = apart(&lengths).into_iter().filter_map(|(at, declared, times)| {
        let mut mechanism = observations.mechanism.clone();
        *place(&mut mechanism, at)? *= times;
        let table = observations.readings.table.clone();
        let with = Again::of(observations, (&mechanism, table), noise, &refit)?.left;
        let closes = Closes { with, declared: left };
        (with < limit).then_some((with, Suspicion::Length { at, size: declared, times, closes }))
    });
    tried.least_by(|a| a.0).map(|(_, suspicion)| suspicion)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_stands_apart_is_tried_where_it_would_be_among_the_others() {
        let at = |row: usize| Measure::A { chain: 0, row };
        let of = |sizes: [f64; 4]| -> Vec<(Measure, f64)> {
            sizes.into_iter().enumerate().map(|(row, size)| (at(row), size)).collect()
        };
        let tried = |sizes| -> Vec<(Measure, f64)> {
            apart(&of(sizes)).into_iter().map(|(at, _, times)| (at, times)).collect()
        };
        assert!(tried([160.0, 425.0, 390.0, 130.0]).is_empty());
        let metres = tried([160.0, -0.39, 200.0, 130.0]);
        assert!(metres.contains(&(at(1), 1000.0)));
        assert!(metres.iter().all(|(_, times)| *times > 1.0));
        assert!(tried([0.16, 425.0, 0.39, 0.13]).contains(&(at(1), 1.0 / 1000.0)));
        assert!(tried([160.0, 16.7, 390.0, 130.0]).contains(&(at(1), 25.4)));
    }
}

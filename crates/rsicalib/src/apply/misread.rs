//! Known poses in another unit or frame, or in another order than their readings.

use crate::estimate::lengths::UNITS;
use crate::numerics::order::Ends;

/// A known pose, and where it was found.
pub(crate) type Pair = ([f64; 6], [f64; 6]);

/// What makes known poses agree with a calibration that they contradict.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Misread {
    /// Their angles are degrees.
    Degrees,
    /// Their lengths are so many times those of the mechanism.
    Lengths(f64),
    /// They are those of an instrument that stands elsewhere.
    Moved,
    /// Each is that of other readings.
    Order,
}

/// By how many times an error must fall, and how many times smaller than the spread of the poses it
/// must be then: an order of magnitude. Three coordinates of two poses that have nothing to do with
/// each other are so near once in some 10⁶.
const DECISIVE: f64 = 10.0;

/// Most poses whose order is looked at: the time grows with their square.
const MOST_POSES: usize = 1000;

/// How pairs of known and found poses were misread, where something makes them agree by far better;
/// `errors` gives root mean square errors of positions and of orientations, and `moved` that of positions after the
/// best rigid motion, where none was asked for.
pub(crate) fn misread(
    pairs: &[Pair],
    errors: impl Fn(&[Pair]) -> (f64, Option<f64>),
    moved: Option<f64>,
) -> Option<Misread> {
    if pairs.len() < 2 {
        return None;
    }
    let (positions, turns) = (|pairs: &[Pair]| errors(pairs).0, |pairs: &[Pair]| errors(pairs).1);
    let (now, spread) = (positions(pairs), spread_of(pairs, 0));
    let decides = |then: f64, now: f64, spread: f64| then * DECISIVE < now.min(spread);
    let scaled = |at: usize, times: f64| -> Vec<Pair> {
        let mut pairs = pairs.to_vec();
        pairs
            .iter_mut()
            .for_each(|(known, _)| known[at..at + 3].iter_mut().for_each(|v| *v /= times));
        pairs
    };
    let times = UNITS.into_iter().flat_map(|unit| [unit, 1.0 / unit]);
    let lengths = times.map(|times| (positions(&scaled(0, times)), times));
    let best = lengths.least_by(|a| a.0);
    if let Some((_, times)) = best.filter(|(then, _)| decides(*then, now, spread)) {
        return Some(Misread::Lengths(times));
    }
    let degrees = turns(pairs).zip(turns(&scaled(3, 1.0_f64.to_degrees())));
    if degrees.is_some_and(|(now, then)| decides(then, now, spread_of(pairs, 3))) {
        return Some(Misread::Degrees);
    }
    // Three places agree with any three after a motion, four almost never.
    if pairs.len() > 3 && moved.is_some_and(|then| decides(then, now, spread)) {
        return Some(Misread::Moved);
    }
    let other = in_other_order(pairs).filter(|_| moved.is_some())?;
    decides(positions(&other), now, spread).then_some(Misread::Order)
}

/// Root mean square of three coordinates of found poses about their mean, from one on.
fn spread_of(pairs: &[Pair], at: usize) -> f64 {
    let n = pairs.len() as f64;
    let variance = |k: usize| {
        let mean = pairs.iter().map(|(_, found)| found[k]).sum::<f64>() / n;
        pairs.iter().map(|(_, found)| (found[k] - mean).powi(2)).sum::<f64>() / n
    };
    ((at..at + 3).map(variance).sum::<f64>() / 3.0).sqrt()
}

/// Every known pose beside the found one that is nearest; none where two have the same one.
fn in_other_order(pairs: &[Pair]) -> Option<Vec<Pair>> {
    let far = |known: &[f64; 6], found: &[f64; 6]| -> f64 {
        known.iter().zip(found).take(3).map(|(k, f)| (k - f).powi(2)).sum()
    };
    let mut taken = vec![pairs.len() > MOST_POSES; pairs.len()];
    pairs
        .iter()
        .map(|(known, _)| {
            let distances = pairs.iter().map(|(_, found)| far(known, found)).enumerate();
            let (nearest, _) = distances.least_by(|a| a.1)?;
            let free = !std::mem::replace(&mut taken[nearest], true);
            free.then_some((*known, pairs[nearest].1))
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::apply::check::error_of;
    use crate::numerics::random::Random;

    fn misread(pairs: &[Pair]) -> Option<Misread> {
        let errors = |pairs: &[Pair]| {
            let check = error_of(pairs, false);
            (check.position_rms, check.orientation_rms)
        };
        super::misread(pairs, errors, Some(error_of(pairs, true).position_rms))
    }

    /// Poses within 3 length units and 0.3 rad, found with a thousandth of that as noise.
    fn pairs(change: impl Fn([f64; 6]) -> [f64; 6]) -> Vec<Pair> {
        let mut random = Random::new(5);
        let mut draw = |size: f64| random.uniform(-size, size);
        (0..12)
            .map(|_| {
                let found: [f64; 6] = std::array::from_fn(|i| draw(if i < 3 { 3.0 } else { 0.3 }));
                let known =
                    std::array::from_fn(|i| found[i] + draw(if i < 3 { 3e-3 } else { 3e-4 }));
                (change(known), found)
            })
            .collect()
    }

    #[test]
    fn another_unit_is_told() {
        let with =
            |times: [f64; 2]| misread(&pairs(|p| std::array::from_fn(|i| p[i] * times[i / 3])));
        assert_eq!(with([1.0, 1.0]), None);
        assert_eq!(with([25.4, 1.0]), Some(Misread::Lengths(25.4)));
        assert_eq!(with([0.001, 1.0]), Some(Misread::Lengths(0.001)));
        assert_eq!(with([1.0, 1.0_f64.to_degrees()]), Some(Misread::Degrees));
        // A factor that is no unit's.
        assert_eq!(with([3.0, 1.0]), None);
    }

    #[test]
    fn another_order_and_another_place_are_told() {
        let all = pairs(|p| p);
        let rolled =
            |n: usize| -> Vec<Pair> { (0..12).map(|k| (all[(k + n) % 12].0, all[k].1)).collect() };
        assert_eq!(misread(&rolled(0)), None);
        assert_eq!(misread(&rolled(1)), Some(Misread::Order));
        // An instrument that stands far away: its lengths over a thousand are all the same place.
        let away = pairs(|p| [p[0] + 5000.0, p[1], p[2], p[3], p[4], p[5]]);
        assert_eq!(misread(&away), Some(Misread::Moved));
        assert_eq!(misread(&away[..3]), None);
        assert_eq!(misread(&all[..1]), None);
    }
}

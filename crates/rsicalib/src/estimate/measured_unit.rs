//! Lengths that channels read in another unit than the drawing.
//!
//! A belt is about as long as the frame is wide. Where loops do not close, and the lengths of all channels, or of one beside
//! the others, are so far from that as units are apart, they are in another unit: no fit is needed to see it.

use nalgebra::Vector3;

use crate::estimate::lengths::UNITS;
use crate::estimate::miswired::{DECISIVE, closing};
use crate::estimate::objective::Noise;
use crate::estimate::observations::Observations;
use crate::estimate::suspicion::Suspicion;
use crate::numerics::median::median;
use crate::numerics::order::Ends;

/// Lengths are alike that differ by no more than this factor: a sled may hang near one of its anchors.
const ALIKE: f64 = 4.0;

/// Channels that look as if they read another unit of length, where loops do not close as declared, or lengths are so
/// short that they close by their noise and play: `left` is χ² per degree of freedom by a `noise`.
pub(crate) fn in_other_unit(
    observations: &Observations,
    noise: &Noise,
    left: f64,
) -> Option<Suspicion> {
    let mechanism = &observations.mechanism;
    let measures =
        |c: &usize| mechanism.measures(*c) && mechanism.channels[*c].unit == mechanism.length_unit;
    let channels: Vec<usize> = (0..mechanism.channels.len()).filter(measures).collect();
    let size = |&c: &usize| {
        let rows = 0..observations.readings.samples;
        let length = |row: usize| mechanism.channels[c].angle(observations.readings.row(row)[c]);
        median(rows.map(|row| length(row).abs()).collect())
    };
    let sizes: Vec<f64> = channels.iter().map(size).collect();
    let usual = median(sizes.clone());
    let plays = mechanism.closures.iter().filter_map(|closure| closure.noise);
    let noises = channels.iter().map(|&c| noise.sigma[c] * mechanism.channels[c].gain.abs());
    let loose = plays.chain(noises).fold(0.0, f64::max);
    if usual > DECISIVE * loose {
        closing(observations, left)?;
    }
    if let Some(times) = meant(usual, 0.5 * widest(observations)?) {
        return Some(Suspicion::MeasuredInUnit { channels, times });
    }
    let mut apart =
        channels.iter().zip(&sizes).filter_map(|(&c, &own)| Some((c, meant(own, usual)?)));
    match (apart.next(), apart.next()) {
        (Some((channel, times)), None) if sizes.len() > 2 => {
            Some(Suspicion::MeasuredInUnit { channels: vec![channel], times })
        }
        _ => None,
    }
}

/// The largest distance between points that are drawn.
fn widest(observations: &Observations) -> Option<f64> {
    let drawn = observations.mechanism.points.iter().filter(|point| point.chain.is_none());
    let drawn: Vec<Vector3<f64>> = drawn.filter_map(|point| point.at.map(Vector3::from)).collect();
    let each = drawn.iter().enumerate();
    let pairs = each.flat_map(|(k, a)| drawn[..k].iter().map(move |b| (a - b).norm()));
    pairs.greatest_by(|distance| *distance).filter(|distance| *distance > 0.0)
}

/// The unit in which a length is like another one; none where it is so as it is, or in no unit.
fn meant(own: f64, usual: f64) -> Option<f64> {
    let off = |times: f64| (own * times / usual).ln().abs();
    if own == 0.0 || off(1.0) < 2.0 * ALIKE.ln() {
        return None;
    }
    let units = UNITS.into_iter().flat_map(|unit| [unit, 1.0 / unit]);
    units.least_by(|times| off(*times)).filter(|times| off(*times) < ALIKE.ln())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_length_is_meant_in_the_unit_in_which_it_is_like_the_others() {
        assert_eq!(meant(1.5, 1500.0), Some(1000.0));
        assert_eq!(meant(59.0, 1500.0), Some(25.4));
        assert_eq!(meant(1500.0, 1.7), Some(1e-3));
        // As it is, and in no unit.
        assert_eq!(meant(700.0, 1500.0), None);
        assert_eq!(meant(1e-9, 1500.0), None);
        assert_eq!(meant(0.0, 1500.0), None);
    }
}

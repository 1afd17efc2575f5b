//! Readings as electronics take them, again and again in one pose: noise, rounding, ends of range.
//!
//! ```text
//! mean of   clip(round(a + sigma z_s))   over the samples s,    z_s ~ N(0, 1)
//! ```

use crate::Error;
use crate::mechanism::{Channel, Mechanism};
use crate::numerics::lanes::{Lanes, WIDTH, dispatch};
use crate::numerics::normals::Normals;

/// What the electronics of a channel do to a reading.
#[derive(Clone, Copy)]
struct Electronics {
    counts: bool,
    range: [f64; 2],
}

impl Electronics {
    fn of(channel: &Channel) -> Self {
        let range = channel.range.unwrap_or([f64::NEG_INFINITY, f64::INFINITY]);
        Self { counts: channel.counts(), range }
    }
}

/// Means of so many samples of readings `exact`, which are held: row by row, one of each channel.
/// The noise of a sample has standard deviation `sigma`, in readings. Samples are drawn in pairs: an
/// odd one is a pair of which one is not used.
///
/// # Errors
///
/// [`Error::Shape`] where a row is not whole.
pub fn means_of_samples(
    mechanism: &Mechanism,
    exact: &[f64],
    sigma: f64,
    samples: usize,
    seed: u64,
) -> Result<Vec<f64>, Error> {
    let channels: Vec<Electronics> = mechanism.channels.iter().map(Electronics::of).collect();
    Error::same("exact", exact.len(), exact.len().next_multiple_of(channels.len().max(1)))?;
    let (mut means, mut normals) = (vec![0.0; exact.len()], Normals::new(seed));
    let mut of_channels = channels.iter().copied().cycle();
    for (means, exact) in means.chunks_mut(WIDTH).zip(exact.chunks(WIDTH)) {
        // The last reading fills up the last block.
        let at = Lanes(std::array::from_fn(|lane| exact[lane.min(exact.len() - 1)]));
        let mut of = [channels[0]; WIDTH];
        of.iter_mut().zip(of_channels.by_ref().take(exact.len())).for_each(|(of, c)| *of = c);
        let sums = dispatch(
            #[inline(always)]
            || sums(&mut normals, at, &of, sigma, samples),
        );
        means.iter_mut().zip(sums.0).for_each(|(mean, sum)| *mean = sum / samples as f64);
    }
    Ok(means)
}

/// Sums of the samples of eight readings.
#[inline(always)]
fn sums(
    normals: &mut Normals,
    exact: Lanes,
    of: &[Electronics; WIDTH],
    sigma: f64,
    samples: usize,
) -> Lanes {
    let mut sum = Lanes::ZERO;
    for first in (0..samples).step_by(2) {
        for z in normals.pair().into_iter().take(samples - first) {
            let noisy = exact + z * sigma;
            for ((sum, noisy), of) in sum.0.iter_mut().zip(noisy.0).zip(of) {
                let [low, high] = of.range;
                let read = if of.counts { noisy.round_ties_even() } else { noisy };
                *sum += read.max(low).min(high);
            }
        }
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::means_of_samples;
    use crate::mechanism::Mechanism;

    /// Mean and variance of a clipped and rounded normal number: sums over its codes.
    fn moments(exact: f64, sigma: f64) -> (f64, f64) {
        use crate::numerics::distributions::normal_cdf;
        let codes = (exact - 12.0 * sigma) as i64..=(exact + 12.0 * sigma) as i64;
        let below = |edge: f64| normal_cdf((edge - exact) / sigma);
        let share = |code: i64| below(code as f64 + 0.5) - below(code as f64 - 0.5);
        let code = |code: i64| (code as f64).clamp(0.0, 4095.0);
        let mean: f64 = codes.clone().map(|c| share(c) * code(c)).sum();
        (mean, codes.map(|c| share(c) * (code(c) - mean).powi(2)).sum())
    }

    #[test]
    fn means_have_the_moments_of_rounded_normal_numbers() -> Result<(), crate::Error> {
        let mut rsi = Mechanism::rsi();
        rsi.channels.iter_mut().for_each(|c| c.range = Some([0.0, 4095.0]));
        for (exact, sigma, samples) in [(1000.3, 0.2, 4), (2000.5, 1.0, 7), (1.0, 3.0, 100)] {
            let rows = 3000;
            let means = means_of_samples(&rsi, &vec![exact; 9 * rows], sigma, samples, 5)?;
            let n = means.len() as f64;
            let mean = means.iter().sum::<f64>() / n;
            let variance = means.iter().map(|m| (m - mean).powi(2)).sum::<f64>() / n;
            let (expected, of_one) = moments(exact, sigma);
            let of_mean = of_one / samples as f64;
            assert!((mean - expected).abs() < 4.0 * (of_mean / n).sqrt(), "{mean} {expected}");
            // Standard error of a variance, of a distribution no heavier than a few counts: 5 %.
            assert!((variance / of_mean - 1.0).abs() < 0.05, "{variance} {of_mean}");
        }
        Ok(())
    }

    #[test]
    fn a_channel_that_does_not_count_is_not_rounded_and_a_seed_repeats() -> Result<(), crate::Error>
    {
        let mut rsi = Mechanism::rsi();
        rsi.channels[1].unit = "rad".into();
        let exact = [100.25; 18];
        let means = means_of_samples(&rsi, &exact, 1e-3, 1, 3)?;
        assert_eq!(means, means_of_samples(&rsi, &exact, 1e-3, 1, 3)?);
        for row in means.chunks(9) {
            assert!(row[1] != 100.25 && (row[1] - 100.25).abs() < 1e-2);
            assert!(row.iter().enumerate().all(|(c, mean)| c == 1 || *mean == 100.0));
        }
        assert!(means_of_samples(&rsi, &exact[1..], 1.0, 1, 3).is_err());
        Ok(())
    }
}

//! Random numbers from a seed: the same on every machine, whatever the number of threads.
//!
//! SplitMix64 (Steele, Lea & Flood 2014): a counter that passes through a mixing function.
//! Good enough to draw poses and configurations; not for cryptography.

/// What the counter advances by.
pub(crate) const STEP: u64 = 0x9E37_79B9_7F4A_7C15;

/// The mixing function.
#[inline(always)]
pub(crate) const fn mixed(counter: u64) -> u64 {
    let z = (counter ^ (counter >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}

/// A stream of random numbers.
#[derive(Debug, Clone)]
pub struct Random(u64);

impl Random {
    /// The stream of a seed.
    #[must_use]
    pub const fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// The next 64 bits.
    pub const fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(STEP);
        mixed(self.0)
    }

    /// A number between `low` and `high`, uniformly.
    pub fn uniform(&mut self, low: f64, high: f64) -> f64 {
        let unit = (self.bits() >> 11) as f64 / (1_u64 << 53) as f64;
        low + unit * (high - low)
    }

    /// True as often as false.
    pub const fn coin(&mut self) -> bool {
        self.bits() >> 63 == 1
    }

    /// A number below `n`, or zero for `n = 0`.
    pub const fn below(&mut self, n: usize) -> usize {
        // The upper half of a product: the bias is n / 2⁶⁴.
        ((self.bits() as u128 * n as u128) >> 64) as usize
    }

    /// So many of the numbers below `n`: each at most once, unless there are too few.
    pub fn choose(&mut self, count: usize, n: usize) -> Vec<usize> {
        if count > n {
            return (0..count).map(|_| self.below(n)).collect();
        }
        let mut all: Vec<usize> = (0..n).collect();
        for k in 0..count {
            let other = k + self.below(n - k);
            all.swap(k, other);
        }
        all.truncate(count);
        all
    }
}

#[cfg(test)]
mod tests {
    use super::Random;

    #[test]
    fn the_stream_is_that_of_the_published_generator() {
        // Reference outputs of splitmix64.c (Vigna) for the seed 1234567.
        let mut random = Random::new(1_234_567);
        let found: [u64; 3] = std::array::from_fn(|_| random.bits());
        assert_eq!(
            found,
            [6_457_827_717_110_365_317, 3_203_168_211_198_807_973, 9_817_491_932_198_370_423]
        );
    }

    #[test]
    fn a_choice_repeats_nothing_unless_there_are_too_few() {
        let mut chosen = Random::new(1).choose(50, 60);
        chosen.sort_unstable();
        chosen.dedup();
        assert_eq!(chosen.len(), 50);
        assert!(chosen.iter().all(|&k| k < 60));
        assert_eq!(Random::new(1).choose(7, 2).len(), 7);
    }

    #[test]
    fn numbers_stay_between_their_ends() {
        let mut random = Random::new(2);
        let drawn: Vec<f64> = (0..10_000).map(|_| random.uniform(-1.0, 3.0)).collect();
        assert!(drawn.iter().all(|v| (-1.0..3.0).contains(v)));
        // Mean 1 with standard deviation 4 / √12 / 100.
        assert!((drawn.iter().sum::<f64>() / 1e4 - 1.0).abs() < 5.0 * 0.0116);
    }
}

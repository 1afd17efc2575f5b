//! Normal numbers from a seed, eight at a time.
//!
//! Box & Muller (1958): of `u` and `v`, uniform between 0 and 1,
//!
//! ```text
//! z = √(-2 ln u) (cos 2πv, sin 2πv)
//! ```
//!
//! are two independent normal numbers.

use std::f64::consts::TAU;

use crate::numerics::lanes::{Lanes, WIDTH};
use crate::numerics::random::{STEP, mixed};

/// A stream of normal numbers: the bits of [`Random`](crate::numerics::random::Random), in its order.
#[derive(Debug, Clone)]
pub struct Normals([u64; WIDTH]);

impl Normals {
    /// The stream of a seed.
    #[must_use]
    pub fn new(seed: u64) -> Self {
        Self(std::array::from_fn(|lane| seed.wrapping_add(STEP.wrapping_mul(lane as u64 + 1))))
    }

    /// Eight uniform numbers in `(0, 1]`.
    #[inline(always)]
    fn uniform(&mut self) -> Lanes {
        let mut out = Lanes::ZERO;
        for (counter, out) in self.0.iter_mut().zip(&mut out.0) {
            // 52 bits behind the exponent of 1.
            let above_one = f64::from_bits(ONE | (mixed(*counter) >> 12));
            *out = 2.0 - above_one;
            *counter = counter.wrapping_add(STEP.wrapping_mul(WIDTH as u64));
        }
        out
    }

    /// Twice eight normal numbers.
    #[inline(always)]
    pub fn pair(&mut self) -> [Lanes; 2] {
        let radius = (ln(self.uniform()) * -2.0).sqrt();
        let (sin, cos) = (self.uniform() * TAU).sin_cos_as_compiled();
        [radius * cos, radius * sin]
    }
}

/// The bits of 1.
const ONE: u64 = 0x3FF0_0000_0000_0000;

/// Natural logarithms of positive normal numbers, to one unit in the last place.
///
/// fdlibm's `__ieee754_log`: `x = 2ᵏ (1 + f)` with `1 + f` between √½ and √2, and a minimax
/// polynomial of `s = f/(2 + f)`.
#[inline(always)]
fn ln(x: Lanes) -> Lanes {
    const ROOT_HALF: u64 = 0x3FE6_A09E_0000_0000;
    const MANTISSA: u64 = 0x000F_FFFF_FFFF_FFFF;
    /// The bits of 2⁵², whose last bit is 1.
    const WHOLE: u64 = 0x4330_0000_0000_0000;
    const LN_2: [f64; 2] = [6.931_471_803_691_238e-1, 1.908_214_929_270_587_7e-10];
    const ODD: [f64; 4] = [
        6.666_666_666_666_735e-1,
        2.857_142_874_366_239e-1,
        1.818_357_216_161_805e-1,
        1.479_819_860_511_658_6e-1,
    ];
    const EVEN: [f64; 3] =
        [3.999_999_999_940_942e-1, 2.222_219_843_214_978_4e-1, 1.531_383_769_920_937_3e-1];
    let (mut k, mut f) = (Lanes::ZERO, Lanes::ZERO);
    for i in 0..WIDTH {
        let bits = x.0[i].to_bits() + (ONE - ROOT_HALF);
        k.0[i] = f64::from_bits(WHOLE | (bits >> 52)) - (4_503_599_627_370_496.0 + 1023.0);
        f.0[i] = f64::from_bits((bits & MANTISSA) + ROOT_HALF) - 1.0;
    }
    let s = f / (f + Lanes::splat(2.0));
    let z = s * s;
    let w = z * z;
    let [a, b, c, d] = ODD.map(Lanes::splat);
    let odd = w.mul_add(w.mul_add(w.mul_add(d, c), b), a);
    let [a, b, c] = EVEN.map(Lanes::splat);
    let even = w.mul_add(w.mul_add(c, b), a);
    let r = w.mul_add(even, z * odd);
    let half = f * f * 0.5;
    k * LN_2[0] - ((half - (s * (half + r) + k * LN_2[1])) - f)
}

#[cfg(test)]
mod tests {
    use super::{Normals, ln};
    use crate::numerics::lanes::{Lanes, WIDTH};
    use crate::numerics::random::Random;

    #[test]
    fn logarithms_agree_with_the_standard_library() {
        for k in 1..20_000_i32 {
            let x = Lanes(std::array::from_fn(|i| f64::from(k) * 5e-5 + 1e-6 * i as f64));
            let found = ln(x);
            for i in 0..WIDTH {
                let wanted = x.0[i].ln();
                assert!(
                    (found.0[i] - wanted).abs() <= 2.0 * f64::EPSILON * wanted.abs(),
                    "{}",
                    x.0[i]
                );
            }
        }
        assert_eq!(ln(Lanes::ONE), Lanes::ZERO);
        assert!((ln(Lanes::splat(f64::EPSILON)).0[0] - f64::EPSILON.ln()).abs() < 1e-13);
    }

    #[test]
    fn bits_are_those_of_the_stream_in_its_order() {
        let (mut normals, mut random) = (Normals::new(7), Random::new(7));
        for _ in 0..3 {
            for found in normals.uniform().0 {
                let unit = (random.bits() >> 12) as f64 / (1_u64 << 52) as f64;
                assert_eq!(found, 1.0 - unit);
            }
        }
    }

    #[test]
    fn numbers_are_normal_and_independent() {
        let (mut normals, pairs) = (Normals::new(1995), 20_000);
        // Sums of z, z², z³, z⁴ and z₁ z₂ over 320,000 numbers, and of those beyond 3.
        let (mut sums, mut products, mut beyond) = ([0.0; 4], 0.0, 0.0);
        for _ in 0..pairs {
            let both = normals.pair();
            for lane in 0..WIDTH {
                products += both[0].0[lane] * both[1].0[lane];
                for z in both.map(|z| z.0[lane]) {
                    let powers = [z, z.powi(2), z.powi(3), z.powi(4)];
                    sums.iter_mut().zip(powers).for_each(|(sum, power)| *sum += power);
                    beyond += f64::from(u8::from(z.abs() > 3.0));
                }
            }
        }
        let n = (2 * WIDTH * pairs) as f64;
        // Means of a normal number's powers, and their variances: E z²ᵏ = (2k - 1)!!.
        let expected = [(0.0, 1.0), (1.0, 2.0), (0.0, 15.0), (3.0, 96.0)];
        for (sum, (mean, variance)) in sums.iter().zip(expected) {
            let off = (sum / n - mean) / f64::sqrt(variance / n);
            assert!(off.abs() < 4.0, "{off} standard deviations from {mean}");
        }
        assert!((products / (0.5 * n).sqrt()).abs() < 4.0);
        // P(|z| > 3)
        let rare = 0.002_699_796_063_260_207;
        assert!(((beyond - n * rare) / (n * rare).sqrt()).abs() < 4.0);
    }
}

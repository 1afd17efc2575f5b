//! Vector lanes: arithmetic on eight samples at once.
//!
//! A [`Lanes`] is one scalar of eight samples. Loops over the eight values compile to vector
//! instructions of the width that [`dispatch`] finds at run time, so a binary that is built for
//! plain x86-64 uses AVX2 on a processor with AVX2.

use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub, SubAssign};

/// Samples in one block.
pub const WIDTH: usize = 8;

/// One scalar of [`WIDTH`] samples.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(align(64))]
pub struct Lanes(pub [f64; WIDTH]);

/// Runs `kernel` with the widest vector instructions of this processor; a program that is compiled for AVX2 and
/// FMA runs with what it is compiled for.
///
/// Only functions that are `#[inline(always)]` are compiled with these instructions.
#[inline(always)]
pub fn dispatch<R>(kernel: impl FnOnce() -> R) -> R {
    if cfg!(all(target_feature = "avx2", target_feature = "fma")) {
        return kernel();
    }
    // pulp has AVX-512 too, by a feature that compiles faer's kernels once more for it as well:
    // minutes of a build, for matrices that are small here.
    #[cfg(target_arch = "x86_64")]
    if is_x86_feature_detected!("avx512f")
        && is_x86_feature_detected!("avx512bw")
        && is_x86_feature_detected!("avx512dq")
        && is_x86_feature_detected!("avx512vl")
        && is_x86_feature_detected!("avx2")
        && is_x86_feature_detected!("fma")
    {
        #[expect(unsafe_code, reason = "the one place where instructions are chosen at run time")]
        // SAFETY: the processor has every feature that the function is compiled with.
        return unsafe { with_avx512(kernel) };
    }
    pulp::Arch::new().dispatch(kernel)
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx2,fma")]
fn with_avx512<R>(kernel: impl FnOnce() -> R) -> R {
    kernel()
}

/// `w ← L⁻¹ w` in every lane, of a lower triangle row by row.
#[inline(always)]
pub(crate) fn solve_lower(l: &[Lanes], w: &mut [Lanes]) {
    let n = w.len();
    for i in 0..n {
        for m in 0..i {
            let known = w[m];
            w[i] -= l[i * n + m] * known;
        }
        w[i] = w[i] / l[i * n + i];
    }
}

/// `w ← L⁻ᵀ w`, likewise.
#[inline(always)]
pub(crate) fn solve_transposed(l: &[Lanes], w: &mut [Lanes]) {
    let n = w.len();
    for i in (0..n).rev() {
        for m in i + 1..n {
            let known = w[m];
            w[i] -= l[m * n + i] * known;
        }
        w[i] = w[i] / l[i * n + i];
    }
}

impl Lanes {
    /// Zero in every lane.
    pub const ZERO: Self = Self([0.0; WIDTH]);
    /// One in every lane.
    pub const ONE: Self = Self([1.0; WIDTH]);

    /// The same value in every lane.
    #[inline(always)]
    #[must_use]
    pub const fn splat(value: f64) -> Self {
        Self([value; WIDTH])
    }

    /// Applies `f` to each lane.
    #[inline(always)]
    #[must_use]
    pub fn map(self, f: impl Fn(f64) -> f64) -> Self {
        // A plain loop: `array::from_fn` is left half scalar by the compiler.
        let mut out = self;
        for value in &mut out.0 {
            *value = f(*value);
        }
        out
    }

    /// Applies `f` to each pair of lanes.
    #[inline(always)]
    #[must_use]
    pub fn zip(self, other: Self, f: impl Fn(f64, f64) -> f64) -> Self {
        let mut out = self;
        for (a, b) in out.0.iter_mut().zip(&other.0) {
            *a = f(*a, *b);
        }
        out
    }

    /// `self * b + c` with one rounding, the same on every processor.
    ///
    /// For code that [`dispatch`] compiles: an x86 processor without the instruction, and code
    /// compiled for one, calls the standard library for each lane.
    #[inline(always)]
    #[must_use]
    pub fn mul_add(self, b: Self, c: Self) -> Self {
        let mut out = self;
        for i in 0..WIDTH {
            out.0[i] = self.0[i].mul_add(b.0[i], c.0[i]);
        }
        out
    }

    /// Square root.
    #[inline(always)]
    #[must_use]
    pub fn sqrt(self) -> Self {
        self.map(f64::sqrt)
    }

    /// Sum over the lanes, by halves.
    #[inline(always)]
    #[must_use]
    pub fn sum(self) -> f64 {
        let [a, b, c, d, e, f, g, h] = self.0;
        ((a + e) + (c + g)) + ((b + f) + (d + h))
    }

    /// Sum over the lanes of each of four values.
    #[inline(always)]
    #[must_use]
    pub fn sums([a, b, c, d]: &[Self; 4]) -> [f64; 4] {
        let half = |v: &Self| [v.0[0] + v.0[4], v.0[1] + v.0[5], v.0[2] + v.0[6], v.0[3] + v.0[7]];
        let (a, b, c, d) = (half(a), half(b), half(c), half(d));
        let e = [a[0] + a[1], b[0] + b[1], a[2] + a[3], b[2] + b[3]];
        let f = [c[0] + c[1], d[0] + d[1], c[2] + c[3], d[2] + d[3]];
        [e[0] + e[2], e[1] + e[3], f[0] + f[2], f[1] + f[3]]
    }

    /// Sine and cosine, each to two units in the last place.
    #[must_use]
    pub fn sin_cos(self) -> (Self, Self) {
        dispatch(
            #[inline(always)]
            || self.sin_cos_as_compiled(),
        )
    }

    /// [`Lanes::sin_cos`] with the instructions that the caller is compiled for.
    ///
    /// Cody and Waite's reduction by multiples of π/2 in three parts, then the
    /// minimax polynomials of fdlibm's kernels on ±π/4. Angles beyond 1e5 rad
    /// are computed by the standard library.
    #[inline(always)]
    pub(crate) fn sin_cos_as_compiled(self) -> (Self, Self) {
        if self.0.iter().any(|x| x.abs() > 1e5) {
            return (self.map(f64::sin), self.map(f64::cos));
        }
        // Adding 1.5·2^52 rounds to an integer, whose low bits are the quadrant.
        const ROUND: f64 = 6_755_399_441_055_744.0;
        const HALF_PI: [f64; 3] =
            [1.570_796_326_734_125_6, 6.077_100_506_303_966e-11, 2.022_266_248_795_950_6e-21];
        let shifted = self.map(|x| x * std::f64::consts::FRAC_2_PI + ROUND);
        let turns = shifted.map(|x| x - ROUND);
        let r = turns.mul_add(Self::splat(-HALF_PI[0]), self);
        let r = turns.mul_add(Self::splat(-HALF_PI[1]), r);
        let r = turns.mul_add(Self::splat(-HALF_PI[2]), r);
        let (s, c) = sin_cos_reduced(r);

        let mut sin = [0.0; WIDTH];
        let mut cos = [0.0; WIDTH];
        for i in 0..WIDTH {
            let quadrant = shifted.0[i].to_bits();
            let swap = (quadrant & 1).wrapping_neg();
            let (sb, cb) = (s.0[i].to_bits(), c.0[i].to_bits());
            let sin_sign = (quadrant & 2) << 62;
            let cos_sign = (quadrant.wrapping_add(1) & 2) << 62;
            sin[i] = f64::from_bits(((sb & !swap) | (cb & swap)) ^ sin_sign);
            cos[i] = f64::from_bits(((cb & !swap) | (sb & swap)) ^ cos_sign);
        }
        (Self(sin), Self(cos))
    }
}

/// fdlibm's `__kernel_sin` and `__kernel_cos`, for `|r| <= π/4`.
#[inline(always)]
fn sin_cos_reduced(r: Lanes) -> (Lanes, Lanes) {
    const S: [f64; 6] = [
        -1.666_666_666_666_663_2e-1,
        8.333_333_333_322_49e-3,
        -1.984_126_982_985_795e-4,
        2.755_731_370_707_006_8e-6,
        -2.505_076_025_340_686_3e-8,
        1.589_690_995_211_55e-10,
    ];
    const C: [f64; 6] = [
        4.166_666_666_666_66e-2,
        -1.388_888_888_887_411e-3,
        2.480_158_728_947_673e-5,
        -2.755_731_435_139_066_3e-7,
        2.087_572_321_298_175e-9,
        -1.135_964_755_778_819_5e-11,
    ];
    let z = r * r;
    let sin = (r * z).mul_add(horner(z, &S), r);
    let cos = (z * z).mul_add(horner(z, &C), z.mul_add(Lanes::splat(-0.5), Lanes::ONE));
    (sin, cos)
}

#[inline(always)]
fn horner(z: Lanes, coefficients: &[f64; 6]) -> Lanes {
    let mut sum = Lanes::splat(coefficients[5]);
    for i in (0..5).rev() {
        sum = sum.mul_add(z, Lanes::splat(coefficients[i]));
    }
    sum
}

macro_rules! lanewise {
    ($($trait:ident $method:ident $op:tt),*) => {$(
        impl $trait for Lanes {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                self.zip(other, |a, b| a $op b)
            }
        }
        impl $trait<f64> for Lanes {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: f64) -> Self {
                self.map(|a| a $op other)
            }
        }
    )*};
}

lanewise!(Add add +, Sub sub -, Mul mul *, Div div /);

impl Neg for Lanes {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        self.map(|a| -a)
    }
}

impl AddAssign for Lanes {
    #[inline(always)]
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl SubAssign for Lanes {
    #[inline(always)]
    fn sub_assign(&mut self, other: Self) {
        *self = *self - other;
    }
}

impl Default for Lanes {
    fn default() -> Self {
        Self::ZERO
    }
}

/// A vector of three lanes, in base coordinates unless a function says otherwise.
pub type Vec3 = [Lanes; 3];

/// `a · b`
#[inline(always)]
#[must_use]
pub fn dot(a: &Vec3, b: &Vec3) -> Lanes {
    a[0].mul_add(b[0], a[1].mul_add(b[1], a[2] * b[2]))
}

/// `a × b`
#[inline(always)]
#[must_use]
pub fn cross(a: &Vec3, b: &Vec3) -> Vec3 {
    let minor = |i: usize, j: usize| a[i].mul_add(b[j], -(a[j] * b[i]));
    [minor(1, 2), minor(2, 0), minor(0, 1)]
}

/// `a - b`
#[inline(always)]
#[must_use]
pub fn minus(a: &Vec3, b: &Vec3) -> Vec3 {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::array::from_fn;

    #[test]
    fn sine_and_cosine_agree_with_the_standard_library() {
        // Rounding of the reduced argument and of six fused terms: 4 ulp of 1.
        for k in -20_000..20_000_i32 {
            let x = Lanes(from_fn(|i| f64::from(k) * 0.011 + i as f64 * 0.37));
            let (s, c) = x.sin_cos();
            for i in 0..WIDTH {
                assert!((s.0[i] - x.0[i].sin()).abs() < 1e-15, "sin {}", x.0[i]);
                assert!((c.0[i] - x.0[i].cos()).abs() < 1e-15, "cos {}", x.0[i]);
            }
        }
    }

    #[test]
    fn far_and_undefined_angles_do_what_the_standard_library_does() {
        let x = Lanes([1e9, -3e12, f64::NAN, 0.0, -0.0, 1e5, 99_999.5, 2.0]);
        let (s, c) = x.sin_cos();
        for i in 0..WIDTH {
            assert!(s.0[i].is_nan() == x.0[i].is_nan() && c.0[i].is_nan() == x.0[i].is_nan());
            assert!(x.0[i].is_nan() || (s.0[i] - x.0[i].sin()).abs() < 1e-11);
        }
    }

    #[test]
    fn sums_of_four_are_the_sums_of_each() {
        let four: [Lanes; 4] = from_fn(|q| Lanes(from_fn(|lane| (10 * q + lane * lane) as f64)));
        // Whole numbers add up without rounding: 8·10 q + 0² + … + 7².
        assert_eq!(Lanes::sums(&four), from_fn(|q| (80 * q + 140) as f64));
        assert_eq!(four.map(Lanes::sum), Lanes::sums(&four));
    }
}

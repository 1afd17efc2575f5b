//! The price of an explanation: what the readings say of it, and what its parts cost.
//!
//! ```text
//! price = data(χ²) + Σ (charge - 2 ln prior(kind) + 2 ln places) - 2 ln (3/2 · ¼^(effects - 1))   (113)
//! ```
//!
//! The last term is zero where nothing is wrong.
//!
//! Minus twice the logarithm of a probability, but for a constant: differences of prices are what
//! everything is decided by. With a noise that is known by `ν` degrees of freedom, and `d`
//! equations that the model which was asked for leaves, the marginal likelihood over the scale of
//! the noise gives
//!
//! ```text
//! data(χ²) = (ν + d) ln(1 + χ²/ν)   repeats tell the noise; χ² where ν is infinite
//!          = d ln χ²                the fit alone tells it
//!          = d (1 + ln(χ²/d))       it is declared, nothing bears it out, and χ² > d; else χ²  (114)
//!          = d (1 + ln(χ²/d))       the same, where it is a bound, and χ² > d; else d
//! ```
//!
//! The last two are the likelihood at the best scale of 1 or more: a declared noise may be too small.
//! It is a bound where an explanation leaves less of it than chance allows: then it is no noise that
//! differs from pose to pose, but what its author allows a loop to be open, and what explains a part
//! of that explains nothing that was asked for.

use std::sync::LazyLock;

/// Kinds of candidates, each with its prior.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Family {
    /// Named effects: a hundred or so.
    Named,
    /// A free shape: of each channel over its reading and over time, of all over time.
    Free,
    /// A jump of one channel at one time: as many as poses and channels.
    Slip,
    /// An error of one sensor at one order: as many as orders and sensors.
    Periodic,
    /// A move of one body at one time: as many as poses and bodies.
    Moved,
    /// A wrong reading: likewise.
    Bad,
}

stated! {
    /// Probability of an effect, one item being there: of its places all are as likely.
    fn prior_of_named() -> f64 = 0.54;
    /// The same of a periodic error.
    fn prior_of_periodic() -> f64 = 0.04;
    /// The same of a free shape.
    fn prior_of_free() -> f64 = 0.08;
    /// The same of a slip, and of a move.
    fn prior_of_once() -> f64 = 0.08;
    /// The same of a wrong reading.
    fn prior_of_bad() -> f64 = 0.18;
    /// How much likelier one effect is than none, before there are readings.
    fn one_or_none() -> f64 = 1.5;
    /// Probability that there is one more effect, where there is one.
    fn more() -> f64 = 0.25;
    /// Amplitudes that an effect may have: doublings of that which noise alone would give it.
    fn amplitudes() -> i32 = 12;
}

/// The prior of a kind of item.
#[must_use]
pub fn prior(kind: Family) -> f64 {
    match kind {
        Family::Named => prior_of_named(),
        Family::Periodic => prior_of_periodic(),
        Family::Free => prior_of_free(),
        Family::Slip | Family::Moved => prior_of_once(),
        Family::Bad => prior_of_bad(),
    }
}

/// What an effect beside another costs more than the first.
#[must_use]
fn another() -> f64 {
    -2.0 * more().ln()
}

/// What so many effects cost, for their number alone.
#[must_use]
pub fn of_number(effects: usize) -> f64 {
    match effects {
        0 => 0.0,
        _ => another() * (effects - 1) as f64 - 2.0 * one_or_none().ln(),
    }
}

/// The least score that pays for `k` parameters of the first effect, at these places.
#[must_use]
pub fn least_of_first(k: f64, places: f64) -> f64 {
    least_that_pays(k, places / one_or_none())
}

/// What the places cost where an item could have been, over its prior.
#[must_use]
pub fn of_places(places: f64) -> f64 {
    2.0 * places.ln().max(0.0)
}

/// The least score that pays for `k` parameters at these places, over the prior.
#[must_use]
pub fn least_that_pays(k: f64, places: f64) -> f64 {
    let pays = |score: f64| score - charge(k, score) > of_places(places);
    let (mut low, mut high) = (0.0, 1.0);
    while !pays(high) {
        (low, high) = (high, 2.0 * high);
    }
    for _ in 0..50 {
        let middle = 0.5 * (low + high);
        if pays(middle) { high = middle } else { low = middle }
    }
    high
}

/// What `k` parameters cost of which `χ²` falls by a score `T`: their marginal likelihood, any amplitude
/// being as likely beforehand,
///
/// ```text
/// charge = T - 2 ln mean exp(-½ (k ln(1 + g) - T g/(1 + g))),    g = 1, 4, 16, …               (118)
/// ```
///
/// where the parameters are normal with `g` times the covariance of their estimates.
#[must_use]
pub fn charge(k: f64, score: f64) -> f64 {
    let of = |&[volume, told]: &[f64; 2]| (k * volume - score * told, 1.0);
    score + mean(AMPLITUDES.iter().map(of))
}

/// `ln(1 + g)` and `g/(1 + g)` of each amplitude: a search asks for prices by the hundred thousand.
static AMPLITUDES: LazyLock<Vec<[f64; 2]>> = LazyLock::new(|| {
    let of = |g: f64| [g.ln_1p(), g / (1.0 + g)];
    (0..amplitudes()).map(|j| of(4.0_f64.powi(j))).collect()
});

/// Prices that differ by less are one: only rounding decides between them.
const ALIKE: f64 = 1e-3;

/// A price by which explanations are sorted. What costs the same stays in the order in which it was found, on every
/// processor.
pub(crate) fn in_steps(price: f64) -> f64 {
    (price / ALIKE).round()
}

/// `-2 ln` of the mean of `exp(-price/2)`, each with its weight.
pub fn mean(prices: impl Iterator<Item = (f64, f64)> + Clone) -> f64 {
    let least = prices.clone().map(|(price, _)| price).fold(f64::INFINITY, f64::min);
    let (mut sum, mut all) = (0.0, 0.0);
    for (price, weight) in prices {
        sum += weight * (0.5 * (least - price)).exp();
        all += weight;
    }
    least - 2.0 * (sum / all).ln()
}

/// What tells the scale of the noise.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Scale {
    /// Repeats, by so many degrees of freedom; or a declaration that is borne out.
    Known(f64),
    /// A declaration that nothing bears out.
    Declared,
    /// A declaration of which an explanation has left less than chance allows.
    Bound,
    /// The fit alone.
    Fitted,
}

/// What readings say of an explanation, by its χ².
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Data {
    /// What tells the scale of the noise.
    pub scale: Scale,
    /// Equations that the model which was asked for leaves, `d`: the same for all explanations.
    pub dof: f64,
}

impl Data {
    /// `data(χ²)` of (114).
    #[must_use]
    pub fn of(&self, chi2: f64) -> f64 {
        let d = self.dof.max(1.0);
        match self.scale {
            _ if chi2.is_nan() => f64::NAN,
            Scale::Known(nu) if nu.is_finite() => (nu + d) * (chi2 / nu).ln_1p(),
            Scale::Declared | Scale::Bound if chi2 > d => d * (1.0 + (chi2 / d).ln()),
            Scale::Bound => d,
            Scale::Known(_) | Scale::Declared => chi2,
            Scale::Fitted => d * chi2.max(f64::MIN_POSITIVE).ln(),
        }
    }

    /// By how much that falls for each unit of χ²: the variance of the noise over what it may really be, and 1 where
    /// it is no larger.
    fn slope(&self, chi2: f64) -> f64 {
        let d = self.dof.max(1.0);
        match self.scale {
            Scale::Known(nu) if nu.is_finite() => (nu + d) / (nu + chi2),
            Scale::Declared | Scale::Bound if chi2 > d => d / chi2,
            Scale::Known(_) | Scale::Declared | Scale::Bound => 1.0,
            Scale::Fitted => d / chi2.max(f64::MIN_POSITIVE),
        }
    }

    /// By how much that falls where χ² does by a score.
    #[must_use]
    pub fn fall(&self, chi2: f64, score: f64) -> f64 {
        self.of(chi2) - self.of(less(chi2, score))
    }
}

/// What is left of χ² where a part falls: not less than nothing; a part that is no number leaves none.
#[must_use]
pub fn less(chi2: f64, fall: f64) -> f64 {
    (chi2 - fall).clamp(0.0, f64::INFINITY)
}

/// What readings say of a fit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Said {
    /// What they say of any.
    pub data: Data,
    /// Its χ².
    pub chi2: f64,
    /// Whether the noise may be larger than it is known.
    pub larger_noise: bool,
}

impl Said {
    /// By how much it falls where χ² does by a score.
    #[must_use]
    pub fn fall(&self, score: f64) -> f64 {
        self.data.fall(self.chi2, score)
    }

    /// The variance of the noise over what it may really be, were so much of χ² explained.
    #[must_use]
    pub fn scale(&self, score: f64) -> f64 {
        match self.larger_noise {
            true => self.data.slope(less(self.chi2, score)),
            false => 1.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{Data, Scale, in_steps};
    use crate::numerics::order;

    #[test]
    fn an_explanation_without_a_number_has_no_price() {
        let all = [Scale::Known(9.0), Scale::Known(f64::INFINITY), Scale::Declared, Scale::Bound];
        for scale in all.into_iter().chain([Scale::Fitted]) {
            let data = Data { scale, dof: 9.0 };
            assert!(data.of(f64::NAN).is_nan() && data.fall(40.0, f64::NAN).is_nan(), "{scale:?}");
            assert!(data.fall(40.0, 50.0).is_finite(), "{scale:?}");
        }
    }

    #[test]
    fn what_rounding_alone_tells_apart_stays_in_its_order() {
        let mut prices =
            [(3.0, 'a'), (1.0 + 1e-12, 'b'), (1.0, 'c'), (1.0 - 1e-12, 'd'), (0.9, 'e')];
        order::ascending(&mut prices, |a| in_steps(a.0));
        assert_eq!(prices.map(|(_, name)| name), ['e', 'b', 'c', 'd', 'a']);
    }

    /// `-2 ln ∫ N(χ²; s²) p(s²) ds²` by Simpson's rule over the logarithm of the scale, where repeats
    /// give the variance `s²` by `nu` degrees of freedom.
    fn marginal(chi2: f64, nu: f64, d: f64) -> f64 {
        let log = |x: f64| -0.5 * (d + nu) * x - 0.5 * (chi2 + nu) * (-x).exp();
        let n = 4000;
        let (low, high) = (-4.0, 6.0);
        let step = (high - low) / f64::from(n);
        let peak = (0..=n).map(|k| log(low + step * f64::from(k))).fold(f64::MIN, f64::max);
        let weight = |k: i32| match k {
            0 => 1.0,
            k if k == n => 1.0,
            k if k % 2 == 1 => 4.0,
            _ => 2.0,
        };
        let sum: f64 =
            (0..=n).map(|k| weight(k) * (log(low + step * f64::from(k)) - peak).exp()).sum();
        -2.0 * (peak + (sum * step / 3.0).ln())
    }

    #[test]
    fn parameters_cost_what_their_marginal_likelihood_says() {
        // One parameter z with an estimate of 5 standard deviations: ∫ N(5; z, 1) N(z; 0, g) dz over
        // N(5; 0, 1), by Simpson's rule, averaged over the amplitudes.
        let ratio = |g: f64| -> f64 {
            let n = 20_000;
            let (low, high) = (-60.0, 60.0);
            let step = (high - low) / f64::from(n);
            let at = |z: f64| (-0.5 * ((5.0 - z).powi(2) - 25.0 + z * z / g)).exp();
            let weight = |k: i32| if k == 0 || k == n { 1.0 } else { 2.0 * f64::from(1 + k % 2) };
            let sum: f64 = (0..=n).map(|k| weight(k) * at(low + step * f64::from(k))).sum();
            sum * step / 3.0 / (std::f64::consts::TAU * g).sqrt()
        };
        let all: f64 = (0..super::amplitudes()).map(|j| ratio(4.0_f64.powi(j))).sum();
        let wanted = 25.0 - 2.0 * (all / f64::from(super::amplitudes())).ln();
        let got = super::charge(1.0, 25.0);
        assert!((got - wanted).abs() < 1e-6 * wanted, "{got} for {wanted}");
    }

    #[test]
    fn the_least_score_that_pays_is_where_the_likelihood_ratio_is_the_number_of_places() {
        for (k, places) in [(1.0, 200.0), (3.0, 2000.0)] {
            let score = super::least_that_pays(k, places);
            // The mean likelihood ratio over the amplitudes, written out.
            let ratio = |g: f64| (1.0 + g).powf(-0.5 * k) * (0.5 * score * g / (1.0 + g)).exp();
            let all: f64 = (0..super::amplitudes()).map(|j| ratio(4.0_f64.powi(j))).sum();
            let mean = all / f64::from(super::amplitudes());
            assert!((mean - places).abs() < 1e-6 * places, "{mean} for {places}");
        }
    }

    #[test]
    fn an_estimated_noise_is_integrated_out() {
        for (nu, d) in [(12.0, 40.0), (300.0, 120.0)] {
            let data = Data { scale: Scale::Known(nu), dof: d };
            let wanted = marginal(1.7 * d, nu, d) - marginal(1.1 * d, nu, d);
            let got = data.of(1.7 * d) - data.of(1.1 * d);
            assert!((got - wanted).abs() < 1e-6 * wanted, "{got} for {wanted}");
        }
    }

    #[test]
    fn a_known_noise_gives_chi2_and_all_limits_meet() {
        let of = |scale, chi2| Data { scale, dof: 50.0 }.of(chi2);
        let fall = |scale| of(scale, 90.0) - of(scale, 60.0);
        assert!((fall(Scale::Known(f64::INFINITY)) - 30.0).abs() < 1e-12);
        assert!((fall(Scale::Known(1e9)) - 30.0).abs() < 1e-5);
        // No repeats: the fit alone tells the noise.
        let alone = |nu: f64| (nu + 50.0) * f64::ln((nu + 90.0) / (nu + 60.0));
        assert!((fall(Scale::Fitted) - alone(0.0)).abs() < 1e-12);
        assert!((fall(Scale::Declared) - alone(0.0)).abs() < 1e-12);
        // Where a declared noise leaves no more than it should, it is taken as known.
        assert!((of(Scale::Declared, 48.0) - of(Scale::Declared, 40.0) - 8.0).abs() < 1e-12);
        for scale in [Scale::Declared, Scale::Bound] {
            let (below, above) = (of(scale, 50.0), of(scale, 50.0 + 1e-9));
            assert!((above - below).abs() < 1e-8);
        }
        // Below a bound nothing is gained.
        assert!((of(Scale::Bound, 48.0) - of(Scale::Bound, 40.0)).abs() < 1e-12);
    }
}

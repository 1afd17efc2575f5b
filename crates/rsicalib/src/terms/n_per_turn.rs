//! [`NPerTurn`].

use crate::mechanism::Mechanism;
use crate::numerics::lanes::Lanes;
use crate::terms::term::{Acts, ORDER_STEP, ORDERS, Placed, Sensor, Site, Term};

term! {
    /// Error of a sensor that repeats many times per turn.
    ///
    /// Adds `a sin(nφ) + b cos(nφ)` to the joint coordinate, where `φ` is the nominal angle of the
    /// sensor from the middle of its range: teeth of a gear or a belt, poles, turns of a winding. What
    /// has no turn, a length or a share of a range, goes round once over what its readings span: the
    /// pitch of a screw, a drum that is not round. A trace searches for the order `n`, from 3 to 100,
    /// which need not be whole: the order of the place, and `detune` beside that order; faster waves
    /// it does not find. The p-value is corrected for the number of orders. Where another order
    /// explains a session as well, the effect is named and not applied.
    NPerTurn("n_per_turn", Sensor, per Channel, needs Nothing) {
        a: "rad" ~ 1e-3,
        b: "rad" ~ 1e-3,
        detune: "1/turn" ~ 0.1,
    } acts Acts::Sensor(&Self)
}

impl Term for NPerTurn {
    fn placed(&self) -> Placed {
        Placed::AtOrder
    }

    fn places(&self, _mechanism: &Mechanism, _channel: usize, _poses: usize) -> Vec<usize> {
        ORDERS.collect()
    }
}

impl Sensor for NPerTurn {
    fn correction(&self, p: &[f64], site: &Site) -> Lanes {
        let (sin, cos) = (site.psi() * order(p, site)).sin_cos();
        sin * p[0] + cos * p[1]
    }

    fn partials(&self, p: &[f64], site: &Site, out: &mut [Lanes]) {
        let psi = site.psi();
        let (sin, cos) = (psi * order(p, site)).sin_cos();
        out[0] = sin;
        out[1] = cos;
        out[2] = (cos * p[0] - sin * p[1]) * psi;
    }

    fn slope(&self, p: &[f64], site: &Site) -> Lanes {
        let n = order(p, site);
        let (sin, cos) = (site.psi() * n).sin_cos();
        (cos * p[0] - sin * p[1]) * (n * site.scale().turn)
    }
}

/// `n`
fn order(p: &[f64], site: &Site) -> f64 {
    ORDER_STEP * site.place as f64 + p[2]
}

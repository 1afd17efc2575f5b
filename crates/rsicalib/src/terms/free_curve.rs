//! [`FreeCurve`].

use crate::numerics::lanes::Lanes;
use crate::terms::term::{Acts, Sensor, Site, Term};
use crate::terms::waves;

term! {
    /// A smooth error of a sensor, of any shape.
    ///
    /// Adds `Σ_k c_k cos(k π s)` to the joint angle, where `s` runs from 0 to 1
    /// over the readings that occur; beyond them the curve stays as it is at their
    /// edge. Each coefficient is held by its typical size, which falls as `k⁻²`: the
    /// cosine form of a cubic smoothing spline.
    FreeCurve("free_curve", Sensor, per Channel, needs Nothing, penalised) {
        c1: "rad" ~ 0.02,
        c2: "rad" ~ 0.02,
        c3: "rad" ~ 0.008_9,
        c4: "rad" ~ 0.005,
        c5: "rad" ~ 0.003_2,
        c6: "rad" ~ 0.002_2,
        c7: "rad" ~ 0.001_6,
        c8: "rad" ~ 0.001_25,
    } acts Acts::Sensor(&Self)
}

impl Term for FreeCurve {}

impl Sensor for FreeCurve {
    fn correction(&self, p: &[f64], site: &Site) -> Lanes {
        waves::sum(p, along(site))
    }

    fn partials(&self, _p: &[f64], site: &Site, out: &mut [Lanes]) {
        waves::each(along(site), out);
    }

    fn slope(&self, p: &[f64], site: &Site) -> Lanes {
        waves::slope(p, along(site)) * per_reading(site)
    }
}

/// `s`, within 0 to 1 where the curve is held: the waves are level at both ends.
fn along(site: &Site) -> Lanes {
    let along = (site.reading() - Lanes::splat(site.scale().span[0])) * per_reading(site);
    if site.scale().held { along.map(|s| s.clamp(0.0, 1.0)) } else { along }
}

fn per_reading(site: &Site) -> f64 {
    let [low, high] = site.scale().span;
    if high > low { 1.0 / (high - low) } else { 0.0 }
}

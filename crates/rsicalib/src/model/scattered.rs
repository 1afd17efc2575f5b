//! Random places for what is unknown, where the tips of chains can touch it.

use nalgebra::Vector3;

use crate::model::compiled::Model;
use crate::model::ends::End;
use crate::model::thing::Thing;
use crate::model::workspace::{Want, Workspace};
use crate::numerics::random::Random;
use crate::readings::Readings;

/// Part of the reach by which what is drawn in part may be elsewhere: a rank is asked of these places, so
/// that any size does from which loops still close.
const ASIDE: f64 = 0.3;

/// Puts each unknown point where the first of these readings touches it, or at its distance from there;
/// each unknown plane or line through such a point, turned at random; and each unknown frame anywhere.
///
/// What a drawing places in part is moved aside. `reach` is the size of the mechanism.
pub(crate) fn scatter(
    model: &Model,
    readings: &Readings,
    reach: f64,
    random: &mut Random,
    beta: &mut [f64],
) {
    let touched = touched(model, readings, reach, beta);
    for (number, unknown) in model.unknowns.iter().enumerate() {
        let first = model.term_parameters + unknown.first;
        let mut any = |size: f64| random.uniform(-size, size);
        let (at, away) = touched[number].unwrap_or((Vector3::zeros(), reach));
        let own = match unknown.thing {
            Thing::Point(p) if model.mechanism.points[p].frees().contains(&false) => {
                let aside = |drawn: &f64| drawn + any(ASIDE * reach);
                beta[first..][..unknown.width].iter().map(aside).collect()
            }
            Thing::Point(_) => {
                let direction = Vector3::new(any(1.0), any(1.0), any(1.0)).normalize();
                let place = if away > 0.0 { at + away * direction } else { at };
                place.as_slice().to_vec()
            }
            Thing::Plane(_) | Thing::Line(_) => {
                let tilts = [any(1.0), any(1.0)];
                unknown.thing.through(&model.axes[number], tilts, &at)
            }
            Thing::Frame(_) => {
                let size = |k: usize| if k < 3 { reach } else { 1.0 };
                (0..6).map(|k| any(size(k))).collect()
            }
        };
        beta[first..][..unknown.width].copy_from_slice(&own);
    }
}

/// For each unknown the other end of its first closure in the first sample that has it, and how far
/// from there it is.
fn touched(
    model: &Model,
    readings: &Readings,
    reach: f64,
    beta: &[f64],
) -> Vec<Option<(Vector3<f64>, f64)>> {
    let mut found = vec![None; model.unknowns.len()];
    let mut ws = Workspace::default();
    for (block, meta) in readings.blocks().iter().enumerate() {
        let want = Want { x: false, a: false };
        model.evaluate(readings, block, readings.raw(block), beta, want, &mut ws);
        for closure in &model.closures {
            let [one, other] = &closure.ends;
            let of = match (closure.on, one, other) {
                (Some(on), ..) => Some((on, one)),
                (_, End::Unknown(number, ..), end) | (_, end, End::Unknown(number, ..)) => {
                    Some((*number, end))
                }
                _ => None,
            };
            let Some((number, end)) = of else { continue };
            let at = model.end_point(end, meta.group, readings.columns(block), beta, &ws);
            let away = match (closure.kind.has_value(), closure.channel) {
                (false, _) => 0.0,
                (true, None) => closure.value,
                (true, Some(_)) => 0.5 * reach,
            };
            found[model.owned[number].numbers[meta.group]]
                .get_or_insert((Vector3::from(at.map(|x| x.0[0])), away));
        }
    }
    found
}

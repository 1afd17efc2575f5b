//! The residual against a variable of the configuration, for effects that are no law of one
//! variable: lengths, axes, closures, loads of a whole chain.

use crate::estimate::angles::Angles;
use crate::estimate::{Fit, Observations};
use crate::mechanism::Target;
use crate::model::Instance;
use crate::report::evidence::shapes::Against;
use crate::report::evidence::thinned::some;

/// Equations in which an effect explains less than this share of what it explains in the one it
/// acts on most are not drawn.
const ACTS: f64 = 0.1;

/// Residuals without an effect, and what it explains of them, against the joint that it is at, or
/// against the number of the pose.
pub fn against(
    observations: &Observations,
    instance: &Instance,
    without: &Fit,
    with: &Fit,
) -> Against {
    let k = with.residuals.equations;
    let (before, after) = (&without.residuals.whitened, &with.residuals.whitened);
    let samples = observations.readings.samples;
    let joint = joint_at(observations, instance.target);
    let angles = Angles::of(&observations.readings, &with.model, &with.beta);
    let variable = |row: usize| match joint {
        Some(channel) => angles.at(row, channel),
        None => observations.readings.pose[row] as f64 + 1.0,
    };
    let live: Vec<usize> = (0..samples).filter(|&row| observations.weights[row] > 0.0).collect();
    let explained = |e: usize| {
        live.iter()
            .map(|row| (before[row * k + e] - after[row * k + e]).powi(2))
            .sum::<f64>()
            .sqrt()
    };
    let shares: Vec<f64> = (0..k).map(explained).collect();
    let most = shares.iter().copied().fold(0.0, f64::max);
    let drawn = (0..k).filter(|&e| shares[e] >= ACTS * most);
    let dots = drawn.flat_map(|e| live.iter().map(move |&row| (row, row * k + e)));
    let dots = dots.map(|(row, i)| [variable(row), before[i], before[i] - after[i]]).collect();
    let mechanism = &observations.mechanism;
    let (over, unit) = match joint {
        Some(c) if mechanism.slides(c) => ("position of", mechanism.length_unit.as_str()),
        Some(_) => ("angle of", "rad"),
        None => ("pose, in the order of the readings", ""),
    };
    let over = match joint {
        Some(c) => format!("{over} {}", mechanism.channels[c].name),
        None => over.into(),
    };
    Against { over, unit: unit.into(), dots: some(dots) }
}

/// The joint whose coordinate a geometry term turns with: that of its row, or the last before it;
/// of a chain the first.
fn joint_at(observations: &Observations, target: Target) -> Option<usize> {
    let mechanism = &observations.mechanism;
    let channel = |chain: usize, row: usize| {
        let name = mechanism.chains[chain].rows[row].channel.as_ref()?;
        mechanism.channel_index(name).ok()
    };
    match target {
        Target::Channel(c) => Some(c),
        Target::Chain(chain) => mechanism.channels_of(chain).first().copied(),
        Target::Row(chain, row) => (0..=row).rev().find_map(|row| channel(chain, row)),
        Target::All | Target::Closure(_) | Target::Place(_) => None,
        shared => mechanism.parts(shared).first().and_then(|part| joint_at(observations, *part)),
    }
}

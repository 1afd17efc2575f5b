//! Anchors that are found shaped as drawn, but for two of them that are exchanged.
//!
//! Distances to anchors that are unknown close their loops with any of their channels exchanged: the anchors then have
//! each other's names. What tells is the drawing. With `|p_i - p_j|` between anchors as they are found, and `D_ij` as they
//! are drawn, which no motion of the whole changes and no mirror,
//!
//! ```text
//! U(π) = Σ_{i<j} (|p_π(i) - p_π(j)| - D_ij)²                                          (173)
//! ```
//!
//! must be by far less with two of them exchanged than as they are named.

use crate::estimate::fitted::Fit;
use crate::estimate::mirrors::place;
use crate::estimate::miswired::DECISIVE;
use crate::estimate::suspicion::Suspicion;
use crate::mechanism::Mechanism;
use crate::model::Thing;
use crate::numerics::order;

/// An anchor: the channel that reads the distance to it, and where it is drawn and found.
struct Anchor {
    channel: usize,
    drawn: [f64; 3],
    found: [f64; 3],
}

/// Channels that look exchanged, two or another two; none where the anchors are shaped as they are drawn, or are not with any two of
/// them exchanged.
pub(crate) fn exchanged(fit: &Fit) -> Option<Suspicion> {
    let anchors = anchors(fit);
    let n = anchors.len();
    let off = |order: &[usize]| -> f64 {
        let one = |i: usize, j: usize| {
            let found = apart(&anchors[order[i]].found, &anchors[order[j]].found);
            (found - apart(&anchors[i].drawn, &anchors[j].drawn)).powi(2)
        };
        (0..n).flat_map(|j| (0..j).map(move |i| one(i, j))).sum()
    };
    let named: Vec<usize> = (0..n).collect();
    let pairs = (0..n).flat_map(|j| (0..j).map(move |i| [i, j]));
    let with = |[i, j]: [usize; 2]| {
        let mut order = named.clone();
        order.swap(i, j);
        (off(&order), [i, j])
    };
    let declared = off(&named);
    let mut likely: Vec<(f64, [usize; 2])> = pairs.map(with).collect();
    likely.retain(|(with, _)| *with < declared / DECISIVE);
    order::ascending(&mut likely, |a| a.0);
    let (least, _) = *likely.first()?;
    let pairs = (n * (n - 1)) as f64 / 2.0;
    Some(Suspicion::Unlike {
        channels: likely.iter().map(|(_, pair)| pair.map(|k| anchors[k].channel)).collect(),
        off: (declared / pairs).sqrt(),
        with: (least / pairs).sqrt(),
    })
}

/// The anchors of distances that channels read, each of one of them, where the fit finds any.
fn anchors(fit: &Fit) -> Vec<Anchor> {
    let mechanism = &fit.model.mechanism;
    let anchor = |closure: usize| {
        let own = &mechanism.closures[closure];
        let channel = mechanism.channel_index(own.channel.as_ref()?).ok()?;
        let name = &own.between[mechanism.standing_end(closure)?];
        let point = mechanism.points.iter().position(|point| point.name == *name)?;
        let drawn = mechanism.points[point].at?;
        let unknown = fit.model.unknowns.iter().position(|u| u.thing == Thing::Point(point));
        let found = unknown.map_or(drawn, |number| place(fit, number, &fit.beta));
        is_alone(mechanism, name).then_some((unknown.is_some(), Anchor { channel, drawn, found }))
    };
    let all: Vec<(bool, Anchor)> = (0..mechanism.closures.len()).filter_map(anchor).collect();
    let any = all.iter().any(|(unknown, _)| *unknown);
    if any { all.into_iter().map(|(_, anchor)| anchor).collect() } else { Vec::new() }
}

/// True for an anchor of one distance, in one place.
fn is_alone(mechanism: &Mechanism, name: &String) -> bool {
    let ends = mechanism.closures.iter().filter(|closure| closure.between.contains(name));
    let point = mechanism.points.iter().find(|point| point.name == *name);
    ends.count() == 1 && point.is_some_and(|point| point.keys().is_empty() && point.frame.is_none())
}

fn apart(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
}

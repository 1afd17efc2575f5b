//! Readings in another unit than the one that is declared.

use std::f64::consts::TAU;

use crate::mechanism::Channel;
use crate::screening::raw::rows::{Raw, SESSION, ends};
use crate::screening::raw::suspect::Suspect;

/// Part of their range that all channels together never stay within: a session moves its joints.
const NARROW: f64 = 0.01;

/// Decimals within a hundredth of the range where whole counts are declared.
pub(super) fn other_units(raw: &Raw<'_>) -> Vec<Suspect> {
    let of = |(c, own): (usize, &Channel)| (own.counts() && own.range.is_some()).then_some(c);
    let channels: Vec<usize> = raw.channels.iter().enumerate().filter_map(of).collect();
    if channels.is_empty() || raw.poses.len() < SESSION {
        return Vec::new();
    }
    let values = || channels.iter().flat_map(|&c| raw.column(c));
    let [low, high] = ends(values());
    let part = |&c: &usize| (high - low) / whole_way(&raw.channels[c]);
    let part = channels.iter().map(part).fold(0.0, f64::max);
    let whole = values().filter(|v| v.fract() == 0.0).count();
    // Channels that never change say nothing of their unit.
    if part == 0.0 || part > NARROW || 2 * whole > channels.len() * raw.rows() {
        return Vec::new();
    }
    vec![Suspect::Units { channels, low, high, part }]
}

/// What a channel reads from end to end; a turn, or no end, where it has no range.
pub(super) fn whole_way(channel: &Channel) -> f64 {
    let turns = channel.counts() || channel.is_in_degrees() || channel.unit == "rad";
    match channel.range {
        Some([low, high]) => high - low,
        None if turns => TAU / channel.gain.abs(),
        None => f64::INFINITY,
    }
}

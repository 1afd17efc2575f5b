//! Channels that stand still, faults of converters, ends of ranges.

use crate::numerics::order;
use crate::screening::converter::of_codes;
use crate::screening::fault::FaultKind;
use crate::screening::raw::rows::{Raw, SESSION};
use crate::screening::raw::suspect::Suspect;

/// Different readings of a channel that moves.
const MOVES: usize = 20;

/// Channels that stand still while another one clearly does not.
pub(super) fn constant_channels(raw: &Raw<'_>) -> Vec<Suspect> {
    if raw.poses.len() < SESSION {
        return Vec::new();
    }
    let first = raw.row(0);
    let stands = |&c: &usize| raw.column(c).all(|v| v == first[c]);
    let still: Vec<usize> = (0..raw.channels.len()).filter(stands).collect();
    let moves = |c: usize| {
        let mut readings: Vec<f64> = raw.column(c).collect();
        order::sort(&mut readings);
        readings.dedup();
        readings.len() >= MOVES.min(raw.poses.len())
    };
    if still.is_empty() || !(0..raw.channels.len()).any(moves) {
        return Vec::new(); // not a session of different poses
    }
    still.into_iter().map(|channel| Suspect::Constant { channel, reads: first[channel] }).collect()
}

/// Codes as at a wall, and bits that keep one value; channels with the same bits are one entry.
pub(super) fn faults_of_converters(raw: &Raw<'_>) -> Vec<Suspect> {
    let numbered = raw.poses.iter().enumerate();
    let pose: Vec<usize> = numbered.flat_map(|(p, rows)| rows.clone().map(move |_| p)).collect();
    let (mut clipped, mut stuck) = (Vec::new(), Vec::<(Vec<(u32, bool)>, Vec<usize>)>::new());
    for fault in of_codes(raw.values, &raw.counts(), &pose, raw.held) {
        let channel = fault.channel;
        match fault.kind {
            FaultKind::Clipped { at, poses } => {
                let rows = poses.into_iter().map(|p| raw.poses[p].start).collect();
                clipped.push(Suspect::Clipped { channel, at, rows });
            }
            FaultKind::StuckBits(bits) => match stuck.iter_mut().find(|(own, _)| *own == bits) {
                Some((_, channels)) => channels.push(channel),
                None => stuck.push((bits, vec![channel])),
            },
        }
    }
    let alike = stuck.into_iter().map(|(bits, channels)| Suspect::StuckBit { channels, bits });
    clipped.into_iter().chain(alike).collect()
}

/// Readings at the very ends of a channel's range, where the truth may lie beyond.
pub(super) fn ends_of_ranges(raw: &Raw<'_>) -> Vec<Suspect> {
    let ends = |(channel, of): (usize, &crate::mechanism::Channel)| {
        let ends = of.range.into_iter().flatten();
        ends.map(move |end| (channel, end))
    };
    let at = |(channel, end): (usize, f64)| {
        let column = raw.column(channel).enumerate();
        let rows: Vec<usize> = column.filter(|(_, v)| *v == end).map(|(row, _)| row).collect();
        (!rows.is_empty()).then_some(Suspect::EndOfRange { channel, end, rows })
    };
    raw.channels.iter().enumerate().flat_map(ends).filter_map(at).collect()
}

//! Rows and poses that are copies of others.

use std::collections::HashMap;

use crate::numerics::distributions::log_factorial;
use crate::readings::doubled::doubled;
use crate::readings::runs_of;
use crate::screening::converter::RARE;
use crate::screening::raw::rows::Raw;
use crate::screening::raw::suspect::Suspect;

/// Rows that do not repeat the one before, from which on it is known what is usual.
const FRESH: usize = 20;

/// A row and the one before, of one pose or recording.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Pair {
    /// Of two poses.
    Apart,
    /// Equal in every channel.
    Stale,
    /// Different in some channels, or in half of them and more.
    Fresh { busy: bool },
}

/// Rows that repeat the one before in every channel, amid rows that do not.
pub(super) fn stale_rows(raw: &Raw<'_>) -> Vec<Suspect> {
    let doubled =
        if raw.held { doubled(raw.values, &raw.counts(), &rows_of(raw)) } else { Vec::new() };
    if !doubled.is_empty() {
        return vec![Suspect::StaleRows { rows: doubled }];
    }
    let channels = raw.channels.len();
    let pairs = pairs(raw);
    let count = |of: &dyn Fn(&Pair) -> bool| pairs.iter().filter(|pair| of(pair)).count();
    let (stale, busy) = (count(&is_stale), count(&|pair| *pair == Pair::Fresh { busy: true }));
    let fresh = count(&|pair| matches!(pair, Pair::Fresh { .. }));
    if stale == 0 || fresh < FRESH || 2 * busy < fresh {
        return Vec::new(); // nothing repeats, or repeating is nothing unusual here
    }
    // Channels that repeat by chance do so independently: as many whole rows as this would.
    let mut same = vec![0_usize; channels];
    for (row, _) in pairs.iter().enumerate().filter(|(_, p)| matches!(p, Pair::Fresh { .. })) {
        let both = raw.row(row).iter().zip(raw.row(row + 1));
        same.iter_mut().zip(both).for_each(|(same, (a, b))| *same += usize::from(a == b));
    }
    let by_chance: f64 = same.iter().map(|&n| n as f64 / fresh as f64).product();
    let expected = (stale + fresh) as f64 * by_chance;
    // A device that stands still repeats rows, and slows down before.
    let beside =
        |pair: Option<&Pair>| matches!(pair, None | Some(Pair::Apart | Pair::Fresh { busy: true }));
    let is_stale: Vec<bool> = pairs.iter().map(is_stale).collect();
    let runs = runs_of(&is_stale).into_iter().filter(|run| {
        let before = run.start.checked_sub(1).and_then(|pair| pairs.get(pair));
        is_stale[run.start] && beside(before) && beside(pairs.get(run.end))
    });
    let rows: Vec<usize> = runs.flatten().map(|pair| pair + 1).collect();
    let m = rows.len();
    let log = m as f64 * expected.max(f64::MIN_POSITIVE).ln() - log_factorial(m as u64);
    if m == 0 || log >= RARE.ln() { Vec::new() } else { vec![Suspect::StaleRows { rows }] }
}

/// The rows of each pose.
fn rows_of(raw: &Raw<'_>) -> Vec<Vec<usize>> {
    raw.poses.iter().map(|rows| rows.clone().collect()).collect()
}

/// Each row but the first with the one before.
fn pairs(raw: &Raw<'_>) -> Vec<Pair> {
    let mut begins = vec![false; raw.rows()];
    if raw.held {
        raw.poses.iter().for_each(|pose| begins[pose.start] = true);
    }
    let pair = |row: usize| {
        let both = raw.row(row - 1).iter().zip(raw.row(row));
        let same = both.filter(|(a, b)| a == b).count();
        match begins[row] {
            true => Pair::Apart,
            false if same == raw.channels.len() => Pair::Stale,
            false => Pair::Fresh { busy: 2 * same <= raw.channels.len() },
        }
    };
    (1..raw.rows()).map(pair).collect()
}

/// Held poses whose samples are, one by one, those of another pose.
pub(super) fn copied_poses(raw: &Raw<'_>) -> Vec<Suspect> {
    let mut seen = HashMap::new();
    let poses = if raw.held { &*raw.poses } else { &[] };
    let copied = poses.iter().filter_map(|pose| {
        let block = raw.block(pose);
        // Without noise, a pose visited twice does read the same.
        block.chunks_exact(raw.channels.len()).find(|row| *row != raw.row(pose.start))?;
        let bits: Vec<u64> = block.iter().map(|v| v.to_bits()).collect();
        let of = *seen.entry(bits).or_insert(pose.start);
        (of != pose.start).then_some(Suspect::CopiedPose { row: pose.start, of })
    });
    copied.collect()
}

fn is_stale(pair: &Pair) -> bool {
    *pair == Pair::Stale
}

//! Chains and distances that are drawn alike, and what they share.

use crate::closures::ClosureKind;
use crate::mechanism::drawing::{Chain, Closure, Mechanism, Row};
use crate::mechanism::target::{Target, bits};

/// Numbers of drawings that differ by less than this, in parts of the larger, are the same.
pub(super) const SAME: f64 = 1e-6;

/// Sensors whose nominal gains, and distances whose values, differ by less than this, in parts, may be of
/// one make.
pub(super) const MAKE: f64 = 0.1;

impl Mechanism {
    /// Chains that are drawn alike, but for where they stand: groups of two or more.
    ///
    /// Their rows from the first sensed joint on are the same.
    #[must_use]
    pub fn alike(&self) -> Vec<Vec<usize>> {
        let mut groups: Vec<Vec<usize>> = Vec::new();
        for c in 0..self.chains.len() {
            let same = |group: &&mut Vec<usize>| alike(&self.chains[group[0]], &self.chains[c]);
            match groups.iter_mut().find(same) {
                Some(group) => group.push(c),
                None => groups.push(vec![c]),
            }
        }
        groups.retain(|group| group.len() > 1);
        groups
    }

    /// The group that a chain is the first of; empty where it is not.
    fn group_of(&self, first: usize) -> Vec<usize> {
        let same = |c: &usize| alike(&self.chains[first], &self.chains[*c]);
        let group: Vec<usize> = (0..self.chains.len()).filter(same).collect();
        if group.len() > 1 && group[0] == first { group } else { Vec::new() }
    }

    /// The targets that a target stands for: one of each chain for a shared one, else itself.
    #[doc(hidden)]
    #[must_use]
    pub fn parts(&self, target: Target) -> Vec<Target> {
        match target {
            Target::EachChain(first) => {
                self.group_of(first).into_iter().map(Target::Chain).collect()
            }
            Target::EachRow(first, row) => {
                self.group_of(first).into_iter().map(|c| Target::Row(c, row)).collect()
            }
            Target::EachJoint(first, joint) => {
                let channel = |c: usize| self.channels_of(c).get(joint).copied();
                let channels = self.group_of(first).into_iter().filter_map(channel);
                channels.map(Target::Channel).collect()
            }
            Target::EachClosure(first) => {
                self.made_as(first).into_iter().map(Target::Closure).collect()
            }
            Target::Together(channels) => bits(channels).map(Target::Channel).collect(),
            single => vec![single],
        }
    }

    /// True where a target stands for another among its [`Mechanism::parts`].
    pub(crate) fn has_part(&self, target: Target, part: Target) -> bool {
        match (target, part) {
            (Target::EachChain(first), Target::Chain(c)) => self.group_of(first).contains(&c),
            (Target::EachRow(first, row), Target::Row(c, own)) => {
                row == own && self.group_of(first).contains(&c)
            }
            (Target::EachJoint(..) | Target::Together(_), Target::Channel(_)) => {
                self.parts(target).contains(&part)
            }
            (Target::EachClosure(first), Target::Closure(k)) => self.made_as(first).contains(&k),
            _ => target == part,
        }
    }

    /// Distances that may be of one make, as the rods of a delta printer: groups of two or more.
    ///
    /// Their values are known, and within a tenth of that of the first.
    #[doc(hidden)]
    #[must_use]
    pub fn distances_alike(&self) -> Vec<Vec<usize>> {
        let mut groups: Vec<(f64, Vec<usize>)> = Vec::new();
        for (k, closure) in self.closures.iter().enumerate() {
            let Some(value) = self.made_length(closure) else { continue };
            match groups.iter_mut().find(|(first, _)| close(*first, value, MAKE)) {
                Some((_, group)) => group.push(k),
                None => groups.push((value, vec![k])),
            }
        }
        let groups = groups.into_iter().map(|(_, group)| group);
        groups.filter(|group| group.len() > 1).collect()
    }

    /// The length of a part that was made: a known distance that readings see. What lies between two places
    /// was measured there.
    fn made_length(&self, closure: &Closure) -> Option<f64> {
        let made = closure.kind == ClosureKind::Distance && !self.is_link(closure);
        closure.value.as_ref().filter(|_| made)?.known()
    }

    /// The distances of one make that this one is the first of; none where it is not.
    fn made_as(&self, first: usize) -> Vec<usize> {
        let mut groups = self.distances_alike().into_iter();
        groups.find(|group| group[0] == first).unwrap_or_default()
    }

    /// Targets of all chains of a group: the chains, their rows, and their joints; and all distances of one
    /// make.
    ///
    /// A row before the first joint is one where it differs in nothing but the angle at which
    /// its chain stands.
    #[doc(hidden)]
    #[must_use]
    pub fn shared_targets(&self) -> Vec<Target> {
        let mut targets = Vec::new();
        for group in self.alike() {
            let (first, chain) = (group[0], &self.chains[group[0]]);
            targets.push(Target::EachChain(first));
            let everywhere = |row: &usize| {
                group.iter().all(|&c| {
                    let other = self.chains[c].rows.get(*row);
                    other.is_some_and(|other| same_row(other, &chain.rows[*row], false))
                })
            };
            // Chains that begin with other rows number theirs differently.
            let rows = (0..chain.rows.len()).filter(everywhere);
            targets.extend(rows.map(|row| Target::EachRow(first, row)));
            let joints = self.channels_of(first).len();
            targets.extend((0..joints).map(|joint| Target::EachJoint(first, joint)));
        }
        let made = self.distances_alike().into_iter();
        targets.extend(made.map(|group| Target::EachClosure(group[0])));
        targets.extend(self.lengths_together());
        targets
    }

    /// Channels that come by one way, and are late together where they are late: those of each chain,
    /// and those that stand second in `equal` closures, as a follower's do.
    #[doc(hidden)]
    #[must_use]
    pub fn sides(&self) -> Vec<Target> {
        let chains = (0..self.chains.len()).map(|chain| self.channels_of(chain));
        let mut followers: Vec<usize> = self.equal_channels().iter().map(|pair| pair[1]).collect();
        followers.sort_unstable();
        followers.dedup();
        let several = chains.chain([followers]).filter(|channels| channels.len() > 1);
        several.filter_map(Target::together).collect()
    }

    /// True for a channel that stands first in every closure that reads it, as a leader's do: what is late is
    /// said of those that follow.
    pub(crate) fn leads(&self, channel: usize) -> bool {
        let own = &self.channels[channel].name;
        let mut read = self.closures.iter().filter(|c| c.between.contains(own)).peekable();
        let first = |c: &Closure| c.is_of_channels() && c.between[0] == *own;
        !self.moves_joint(channel) && read.peek().is_some() && read.all(first)
    }

    /// The channel that a channel is to be equal to, as a follower to its leader.
    pub(crate) fn leader_of(&self, channel: usize) -> Option<usize> {
        let pairs = self.equal_channels().into_iter();
        pairs.filter(|pair| pair[1] == channel).map(|pair| pair[0]).next()
    }

    /// Every two channels that a closure holds equal, the leader first.
    pub(crate) fn equal_channels(&self) -> Vec<[usize; 2]> {
        let equal = self.closures.iter().filter(|closure| closure.is_of_channels());
        let number = |name: &String| self.channel_index(name).ok();
        let pair = |c: &Closure| Some([number(&c.between[0])?, number(&c.between[1])?]);
        equal.filter_map(pair).collect()
    }

    /// True for two channels that a closure holds equal.
    pub(crate) fn are_equal(&self, a: usize, b: usize) -> bool {
        a != b && self.made_equal(a).contains(&b)
    }

    /// The channels that read lengths, two by two, and all of them.
    fn lengths_together(&self) -> Vec<Target> {
        let all = self.measuring();
        if all.len() < 2 {
            return Vec::new();
        }
        let pair = |(i, a): (usize, &usize)| {
            let a = *a;
            all[i + 1..].iter().map(move |b| [a, *b]).collect::<Vec<_>>()
        };
        let pairs = all.iter().enumerate().flat_map(pair).map(|pair| pair.to_vec());
        let mut sets: Vec<Target> =
            pairs.chain([all.clone()]).filter_map(Target::together).collect();
        sets.dedup();
        sets
    }
}

/// True for chains with the same rows from the first sensed joint on.
fn alike(a: &Chain, b: &Chain) -> bool {
    let from = |chain: &Chain| chain.rows.iter().position(|r| r.channel.is_some());
    let (Some(i), Some(j)) = (from(a), from(b)) else { return false };
    let (a, b) = (&a.rows[i..], &b.rows[j..]);
    a.len() == b.len() && a.iter().zip(b).enumerate().all(|(k, (a, b))| same_row(a, b, k > 0))
}

/// True for the same rows; `turned` says whether the fixed angle before the joint counts.
fn same_row(a: &Row, b: &Row, turned: bool) -> bool {
    let numbers = |row: &Row| {
        let own = [row.d, row.a, row.alpha, row.mass.unwrap_or(-1.0)];
        own.into_iter().chain(row.xyz).chain(row.rpy).chain(row.com)
    };
    a.channel.is_some() == b.channel.is_some()
        && a.joint == b.joint
        && a.ratio == b.ratio
        && (!turned || close(a.theta, b.theta, SAME))
        && numbers(a).zip(numbers(b)).all(|(a, b)| close(a, b, SAME))
}

pub(super) fn close(a: f64, b: f64, share: f64) -> bool {
    (a - b).abs() <= share * a.abs().max(b.abs()).max(SAME * share)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mechanism::drawing::Value;

    #[test]
    fn arms_of_the_hand_controller_share_rows_joints_and_themselves_and_so_do_sides_of_its_handle()
    {
        let mechanism = Mechanism::rsi();
        assert_eq!(mechanism.alike(), [[0, 1, 2]]);
        let names: Vec<String> =
            mechanism.shared_targets().iter().map(|t| t.name(&mechanism)).collect();
        let expected =
            ["each", "each/1", "each/2", "each/3", "each/4", "each.1", "each.2", "each.3", "each"];
        assert_eq!(names, expected);
        assert_eq!(mechanism.channels_at(Target::EachJoint(0, 1)), [1, 4, 7]);
        assert!(mechanism.one_make(Target::EachJoint(0, 1)));
    }

    #[test]
    fn a_part_is_what_is_among_the_parts() {
        let mut mechanism = Mechanism::rsi();
        mechanism.chains[1].rows[1].a += 0.01;
        let channels = (0..9).map(Target::Channel);
        let rows = (0..3).flat_map(|c| (0..4).map(move |row| Target::Row(c, row)));
        let whole = (0..3).map(Target::Chain).chain((0..3).map(Target::Closure));
        let single: Vec<Target> = channels.chain(rows).chain(whole).chain([Target::All]).collect();
        for target in mechanism.shared_targets().into_iter().chain(single.clone()) {
            let parts = mechanism.parts(target);
            for &one in &single {
                assert_eq!(mechanism.has_part(target, one), parts.contains(&one));
            }
        }
    }

    #[test]
    fn a_chain_of_other_length_is_not_alike() {
        let mut mechanism = Mechanism::rsi();
        mechanism.chains[1].rows[1].a += 0.01;
        assert_eq!(mechanism.alike(), [[0, 2]]);
        assert_eq!(mechanism.parts(Target::EachRow(0, 1)), [Target::Row(0, 1), Target::Row(2, 1)]);
        mechanism.chains[2].rows[3].alpha += 0.01;
        assert!(mechanism.alike().is_empty());
        assert_eq!(mechanism.shared_targets(), [Target::EachClosure(0)]);
    }

    #[test]
    fn where_a_chain_stands_does_not_matter_but_its_first_row_is_then_its_own() {
        let mut mechanism = Mechanism::rsi();
        mechanism.chains[1].rows[0].a += 0.5;
        let names: Vec<String> =
            mechanism.shared_targets().iter().map(|t| t.name(&mechanism)).collect();
        assert!(names.contains(&"each/2".into()) && !names.contains(&"each/1".into()));
    }

    #[test]
    fn distances_of_one_make_are_those_of_nearly_the_same_known_value() {
        let groups = |change: &dyn Fn(&mut Mechanism)| {
            let mut mechanism = Mechanism::rsi();
            change(&mut mechanism);
            let shared = mechanism.distances_alike();
            let names = shared.iter().map(|g| Target::EachClosure(g[0]).name(&mechanism));
            (shared.clone(), names.collect::<Vec<_>>())
        };
        let side =
            Mechanism::rsi().closures[0].value.as_ref().and_then(Value::known).unwrap_or(0.0);
        let is = |k: usize, value: f64| {
            move |m: &mut Mechanism| m.closures[k].value = Some(Value::Known(value))
        };
        let of = |group: &[usize]| (vec![group.to_vec()], vec!["each".to_owned()]);
        assert_eq!(groups(&|_| {}), of(&[0, 1, 2]));
        assert_eq!(groups(&is(1, 1.05 * side)), of(&[0, 1, 2]));
        assert_eq!(groups(&is(1, 1.2 * side)), of(&[0, 2]));
        assert_eq!(groups(&is(0, 1.2 * side)), of(&[1, 2]));
        // What a channel or another instrument reads was not made.
        let column = |m: &mut Mechanism| m.closures[1].value = Some(Value::Column("l".into()));
        assert_eq!(groups(&column), of(&[0, 2]));
        let channel = |m: &mut Mechanism| {
            (m.closures[1].value, m.closures[1].channel) = (None, Some("a11".into()));
        };
        assert_eq!(groups(&channel), of(&[0, 2]));
        let touching = |m: &mut Mechanism| m.closures[1].kind = ClosureKind::Touch;
        assert_eq!(groups(&touching), of(&[0, 2]));
        let two_kinds = |m: &mut Mechanism| {
            let other = |c: &Closure| Closure { value: Some(Value::Known(9.0)), ..c.clone() };
            let more: Vec<Closure> = m.closures[..2].iter().map(other).collect();
            m.closures.extend(more);
        };
        let named = vec!["each".to_owned(), format!("each({})", Mechanism::rsi().closures[0].name)];
        assert_eq!(groups(&two_kinds), (vec![vec![0, 1, 2], vec![3, 4]], named));
    }

    #[test]
    fn lengths_of_one_make_are_the_scale_where_no_other_is_known() {
        let mut mechanism =
            Mechanism { closures: Mechanism::rsi().closures, ..Mechanism::default() };
        assert!(mechanism.has_scale() && mechanism.has_scale_beside(&[0, 1]));
        assert!(!mechanism.has_scale_beside(&[0, 1, 2]));
        mechanism.chains = Mechanism::rsi().chains;
        assert!(mechanism.has_scale_beside(&[0, 1, 2]));
    }

    #[test]
    fn a_second_group_is_named_by_its_first_chain() {
        let mut mechanism = Mechanism::rsi();
        let mut more = mechanism.chains[1..].to_vec();
        for chain in &mut more {
            chain.name += "b";
            chain.rows[1].a += 1.0;
        }
        mechanism.chains.extend(more);
        let names: Vec<String> =
            mechanism.shared_targets().iter().map(|t| t.name(&mechanism)).collect();
        assert!(names.contains(&"each(arm2b)/2".into()) && names.contains(&"each/2".into()));
    }
}

//! Which levels nest, which cross, and which are no levels of their own.

use std::collections::HashMap;

/// Groups of units in levels. A rank is a level that is told apart from the others: the units, levels
/// that nest from small to large groups, then those that cross.
#[derive(Debug)]
pub(super) struct Grouping {
    /// Number of groups of each level that was given, and the level that has the same ones.
    pub(super) given: Vec<(usize, Option<usize>)>,
    /// The rank of each level that was given.
    pub(super) place: Vec<Option<usize>>,
    /// For each rank that nests the group in which each group of the rank below is; the first has a
    /// group for each unit.
    pub(super) nested: Vec<Vec<usize>>,
    /// For each rank that crosses the group in which each of the largest nested groups is.
    pub(super) crossed: Vec<Vec<usize>>,
    /// The group of each unit, by rank.
    pub(super) of_unit: Vec<Vec<usize>>,
    /// Number of groups, by rank.
    pub(super) counts: Vec<usize>,
}

impl Grouping {
    /// `levels` says for each level in which group each unit is.
    pub(super) fn new(units: usize, levels: &[Vec<usize>]) -> Self {
        let each: Vec<usize> = (0..units).collect();
        let mut kinds: Vec<(Vec<usize>, usize)> = vec![(each.clone(), units)];
        let (mut given, mut apart) = (Vec::new(), Vec::new());
        for level in levels {
            let (groups, count) = numbered(level);
            let same = kinds.iter().position(|kind| kind.0 == groups);
            given.push((count, same.filter(|_| count > 1)));
            apart.push((count > 1 && same.is_none()).then_some(kinds.len()));
            kinds.push((groups, count));
        }
        let mut order: Vec<usize> = apart.iter().flatten().copied().collect();
        order.sort_by_key(|&k| std::cmp::Reverse(kinds[k].1));
        let (mut nested, mut crossing) = (vec![each], Vec::new());
        let mut ranks = vec![0];
        for (n, &k) in order.iter().enumerate() {
            let larger = |&other: &usize| within(&kinds[k].0, &kinds[other].0);
            if crossing.is_empty() && order[n + 1..].iter().all(larger) {
                let last = ranks[ranks.len() - 1];
                nested.push(above(&kinds[last].0, &kinds[k].0));
                ranks.push(k);
            } else {
                crossing.push(k);
            }
        }
        let last = ranks[ranks.len() - 1];
        let crossed = crossing.iter().map(|&k| above(&kinds[last].0, &kinds[k].0)).collect();
        ranks.extend(&crossing);
        let place = apart.iter().map(|k| k.and_then(|k| ranks.iter().position(|&r| r == k)));
        let place = place.collect();
        let counts = ranks.iter().map(|&k| kinds[k].1).collect();
        let of_unit = ranks.iter().map(|&k| std::mem::take(&mut kinds[k].0)).collect();
        Self { given, place, nested, crossed, of_unit, counts }
    }

    /// Number of ranks that nest.
    pub(super) fn depth(&self) -> usize {
        self.nested.len()
    }

    /// Number of groups of ranks that cross.
    pub(super) fn crossing(&self) -> usize {
        self.counts[self.depth()..].iter().sum()
    }
}

/// Groups numbered in the order in which they come, and how many there are.
fn numbered(groups: &[usize]) -> (Vec<usize>, usize) {
    let mut seen = HashMap::new();
    let number = |group: &usize| {
        let next = seen.len();
        *seen.entry(*group).or_insert(next)
    };
    (groups.iter().map(number).collect(), seen.len())
}

/// True where each of `groups` is in one of `larger`.
fn within(groups: &[usize], larger: &[usize]) -> bool {
    let mut of = HashMap::new();
    groups.iter().zip(larger).all(|(group, more)| of.entry(group).or_insert(more) == &more)
}

/// The group of `larger` in which each of `groups` is, by its number.
fn above(groups: &[usize], larger: &[usize]) -> Vec<usize> {
    let mut of = vec![0; groups.iter().max().map_or(0, |m| m + 1)];
    groups.iter().zip(larger).for_each(|(&group, &more)| of[group] = more);
    of
}

#[cfg(test)]
mod tests {
    use super::Grouping;

    #[test]
    fn levels_nest_from_small_to_large_groups_in_whichever_order_they_are_given() {
        let devices = vec![7, 7, 5, 5, 9, 9, 2, 2];
        let batches = vec![1, 1, 1, 1, 0, 0, 0, 0];
        for (levels, place) in [
            ([devices.clone(), batches.clone()], [Some(1), Some(2)]),
            ([batches.clone(), devices.clone()], [Some(2), Some(1)]),
        ] {
            let found = Grouping::new(8, &levels);
            assert_eq!(found.place, place);
            assert_eq!(found.counts, [8, 4, 2]);
            assert_eq!(found.nested[1], [0, 0, 1, 1, 2, 2, 3, 3]);
            assert_eq!(found.nested[2], [0, 0, 1, 1]);
            assert_eq!(found.crossing(), 0);
        }
    }

    #[test]
    fn what_has_the_same_groups_or_one_group_is_no_level() {
        let pairs = vec![0, 0, 1, 1];
        let levels = [pairs, vec![4, 3, 2, 1], vec![5, 5, 3, 3], vec![8; 4]];
        let found = Grouping::new(4, &levels);
        assert_eq!(found.given, [(2, None), (4, Some(0)), (2, Some(1)), (1, None)]);
        assert_eq!(found.place, [Some(1), None, None, None]);
        assert_eq!(found.counts, [4, 2]);
    }

    #[test]
    fn levels_that_cross_are_above_what_nests_in_both() {
        let sessions = vec![0, 0, 1, 1, 2, 2, 3, 3];
        let (arms, tools) = (vec![0, 0, 0, 0, 1, 1, 1, 1], vec![0, 0, 1, 1, 0, 0, 1, 1]);
        let found = Grouping::new(8, &[arms, tools, sessions]);
        assert_eq!(found.depth(), 2);
        assert_eq!(found.counts, [8, 4, 2, 2]);
        assert_eq!(found.crossed, [[0, 0, 1, 1], [0, 1, 0, 1]]);
        assert_eq!(found.place, [Some(2), Some(3), Some(1)]);
    }
}

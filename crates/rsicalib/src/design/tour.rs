//! An order of visits.

/// An order in which the next pose is never far, the nearest each time; and the length of the way.
///
/// `left` are the numbers of the poses, `at` says where one is, and `start` is where the way begins.
pub(crate) fn tour<'a>(
    mut left: Vec<usize>,
    start: &'a [f64],
    at: impl Fn(usize) -> &'a [f64],
    distance: impl Fn(&[f64], &[f64]) -> f64,
) -> (Vec<usize>, f64) {
    let (mut here, mut way) = (start, 0.0);
    let mut tour = Vec::with_capacity(left.len());
    left.sort_unstable(); // of two that are as near, the earlier candidate
    while !left.is_empty() {
        let far = |i: usize| distance(here, at(left[i]));
        let nearest = (1..left.len()).fold(0, |best, i| if far(i) < far(best) { i } else { best });
        way += far(nearest);
        let next = left.remove(nearest);
        here = at(next);
        tour.push(next);
    }
    (tour, way)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_comes_next_and_the_way_is_what_was_gone() {
        let places = [[5.0], [1.0], [-2.0], [1.5]];
        let distance = |a: &[f64], b: &[f64]| (a[0] - b[0]).abs();
        let (order, way) = tour(vec![3, 0, 2, 1], &[0.0], |k| &places[k], distance);
        // 0 → 1 → 1.5 → 5, which is as near as -2 and the earlier candidate → -2.
        assert_eq!(order, [1, 3, 0, 2]);
        assert_eq!(way, 1.0 + 0.5 + 3.5 + 7.0);
    }
}

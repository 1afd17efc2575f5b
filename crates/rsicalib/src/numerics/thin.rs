//! Some of many, evenly spread.

/// The golden ratio's part: of all numbers its multiples, without their whole turns, come nearest to no pattern.
const GOLDEN: f64 = 0.618_033_988_749_895;

/// Places of some of `count`, ascending, at most `most` of them: all, or one of each stretch of as many neighbours.
///
/// Which of a stretch it is differs from stretch to stretch. Every n-th of a motion that repeats itself would show
/// the same few of its places again and again.
pub(crate) fn spread(count: usize, most: usize) -> impl Iterator<Item = usize> {
    let stride = count.div_ceil(most.max(1)).max(1);
    let of_stretch = move |k: usize| {
        let first = k * stride;
        let size = stride.min(count - first);
        first + ((k as f64 * GOLDEN).fract() * size as f64) as usize
    };
    (0..count.div_ceil(stride)).map(of_stretch)
}

/// Points of the unit cube of so many dimensions, one after the other, that leave no part of it empty for long: the
/// additive recurrence of Roberts.
pub(crate) fn scattered(dimensions: usize) -> impl Iterator<Item = Vec<f64>> {
    let root = generalised_golden(dimensions);
    let alpha: Vec<f64> = (1..=dimensions).map(|d| root.powi(-(d as i32))).collect();
    (1..).map(move |n| alpha.iter().map(|a| (0.5 + a * f64::from(n)).fract()).collect())
}

/// The root of `x^(d+1) = x + 1`.
fn generalised_golden(dimensions: usize) -> f64 {
    let mut x: f64 = 1.5;
    for _ in 0..60 {
        x = (1.0 + x).powf(1.0 / (dimensions as f64 + 1.0));
    }
    x
}

#[cfg(test)]
mod tests {
    use std::collections::HashSet;

    use super::spread;

    #[test]
    fn few_stay_as_they_are() {
        assert!(spread(7, 7).eq(0..7));
        assert_eq!(spread(0, 7).count(), 0);
    }

    #[test]
    fn many_become_one_of_each_stretch() {
        let some: Vec<usize> = spread(1001, 150).collect();
        // By hand: stretches of ⌈1001/150⌉ = 7, which are 143.
        assert!(some.iter().enumerate().all(|(k, place)| place / 7 == k));
        assert_eq!(some.len(), 143);
    }

    #[test]
    fn no_cycle_hides_its_places() {
        // 19,200 rows in strides of 128: in a cycle of 48 every 128th is one of three places.
        for cycle in [2, 3, 16, 48, 64, 96, 128] {
            let seen: HashSet<usize> = spread(19_200, 150).map(|row| row % cycle).collect();
            // Of 150 drawn from as many as 128 places at random 88 differ, more of fewer.
            assert!(2 * seen.len() > cycle, "{} of {cycle}", seen.len());
        }
    }
}

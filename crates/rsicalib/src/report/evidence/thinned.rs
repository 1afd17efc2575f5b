//! Dots of a picture, so many that they can be told apart.

/// Most dots of one picture.
pub const MOST_DOTS: usize = 600;

/// Rows in groups of neighbours, at most [`MOST_DOTS`] of them: the groups, and the size of one.
pub fn grouped<T: Copy>(rows: &[T]) -> (impl Iterator<Item = &[T]>, u64) {
    let size = rows.len().div_ceil(MOST_DOTS).max(1);
    (rows.chunks(size), size as u64)
}

/// Every n-th row, so that at most [`MOST_DOTS`] are left.
pub fn some<T: Copy>(rows: Vec<T>) -> Vec<T> {
    let stride = rows.len().div_ceil(MOST_DOTS).max(1);
    rows.into_iter().step_by(stride).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn few_rows_stay_as_they_are_and_many_become_few_without_a_loss() {
        let few: Vec<usize> = (0..MOST_DOTS).collect();
        assert_eq!(grouped(&few).1, 1);
        assert_eq!(some(few.clone()), few);
        let many: Vec<usize> = (0..10 * MOST_DOTS + 1).collect();
        let (groups, size) = grouped(&many);
        let groups: Vec<&[usize]> = groups.collect();
        assert!(groups.len() <= MOST_DOTS && groups.iter().all(|g| g.len() as u64 <= size));
        assert_eq!(groups.concat(), many);
        assert!(some(many).len() <= MOST_DOTS);
    }
}

//! Unknown points: placements, known distances between them, and starting positions.

use crate::mechanism::Value;
use crate::model::compiled::{End, Model};
use crate::model::evaluation::{Want, Workspace};
use crate::model::prior::Prior;
use crate::readings::Readings;

impl Model {
    /// Number of the placement of every sample; `None` for a mechanism without unknown points.
    /// Unknown points that known distances link belong to one placement.
    #[must_use]
    pub fn placements(&self, readings: &Readings) -> Option<Vec<usize>> {
        let points = self.unknown.first()?;
        let mut root: Vec<usize> = (0..self.unknown_names.len()).collect();
        for link in self.links() {
            if let Prior::Apart { points: [a, b], .. } = link {
                let [a, b] = [a, b].map(|c| root[(c - self.term_parameters) / 3]);
                root.iter_mut().filter(|r| **r == b).for_each(|r| *r = a);
            }
        }
        let mut of_row = vec![0; readings.samples];
        for block in readings.blocks() {
            for &row in &block.rows[..block.live] {
                of_row[row] = root[points[block.group]];
            }
        }
        Some(of_row)
    }

    /// Known distances between unknown points of one group, as priors.
    #[must_use]
    pub fn links(&self) -> Vec<Prior> {
        let mut links = Vec::new();
        for closure in self.mechanism.closures.iter().filter(|c| self.mechanism.is_link(c)) {
            let Some(Value::Known(value)) = closure.value else { continue };
            let sd = closure.sd.or(closure.noise).unwrap_or(1e-3 * value);
            let ends = closure.between.each_ref().map(|end| self.mechanism.unknown_end(end));
            let [Some((a, fixed_a)), Some((b, fixed_b))] = ends else { continue };
            for (i, (first, keys_a)) in self.unknown_points.iter().enumerate() {
                for (j, (second, keys_b)) in self.unknown_points.iter().enumerate() {
                    let (mine, theirs) =
                        (self.free_keys(a, keys_a, &fixed_a), self.free_keys(b, keys_b, &fixed_b));
                    if i != j && *first == a && *second == b && mine.is_some() && mine == theirs {
                        let points = [i, j].map(|k| self.term_parameters + 3 * k);
                        links.push(Prior::Apart { points, value, sd });
                    }
                }
            }
        }
        links
    }

    /// Columns and values of an unknown point that are not fixed; `None` for a point with other
    /// values in the fixed columns.
    fn free_keys<'a>(
        &'a self,
        point: usize,
        keys: &'a [String],
        fixed: &[(usize, String)],
    ) -> Option<Vec<(&'a String, &'a String)>> {
        let columns = self.mechanism.points[point].keys();
        if fixed.iter().any(|(k, value)| keys.get(*k) != Some(value)) {
            return None;
        }
        let free = |k: &usize| fixed.iter().all(|(f, _)| f != k);
        let mut rest: Vec<_> =
            (0..keys.len()).filter(free).map(|k| (&columns[k], &keys[k])).collect();
        rest.sort();
        Some(rest)
    }

    /// Sets each unknown point to the mean of the positions at which chains touch it. `beta` holds
    /// one number per parameter.
    pub fn place_unknowns(&self, readings: &Readings, beta: &mut [f64]) {
        let mut sums = vec![[0.0; 4]; self.unknown_names.len()];
        let mut ws = Workspace::default();
        for (block, meta) in readings.blocks().iter().enumerate() {
            let want = Want { x: false, a: false };
            self.evaluate(readings, block, readings.raw(block), beta, want, &mut ws);
            for closure in &self.closures {
                let (touching, point) = match closure.ends {
                    [End::Unknown(point), other] | [other, End::Unknown(point)] => (other, point),
                    _ => continue,
                };
                if !closure.kind.facts().is_vector() || matches!(touching, End::Unknown(_)) {
                    continue;
                }
                let at = self.end_point(&touching, meta.group, beta, &ws.postures);
                let sum = &mut sums[self.unknown[point][meta.group]];
                for lane in 0..meta.live {
                    for axis in 0..3 {
                        sum[axis] += at[axis].0[lane];
                    }
                    sum[3] += 1.0;
                }
            }
        }
        for (k, sum) in sums.iter().enumerate().filter(|(_, s)| s[3] > 0.0) {
            for axis in 0..3 {
                beta[self.term_parameters + 3 * k + axis] = sum[axis] / sum[3];
            }
        }
    }

    /// First parameters of the unknown points that no sample with a weight above zero touches.
    /// `weights` holds one number per sample.
    #[must_use]
    pub fn untouched(&self, readings: &Readings, weights: &[f64]) -> Vec<usize> {
        let mut touched = vec![false; self.unknown_names.len()];
        for block in readings.blocks() {
            if block.rows[..block.live].iter().any(|&r| weights[r] > 0.0) {
                self.unknown.iter().for_each(|of_group| touched[of_group[block.group]] = true);
            }
        }
        let left = touched.iter().enumerate().filter(|(_, touched)| !**touched);
        left.map(|(k, _)| self.term_parameters + 3 * k).collect()
    }
}

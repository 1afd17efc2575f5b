//! The error of the calibration, estimated sample by sample: a Kalman filter that stands still.

use nalgebra::{DMatrix, DVector};

/// Mean and covariance of the error of the calibration, in units of [`super::watched::Watched::scale`].
#[derive(Debug, Clone)]
pub(crate) struct State {
    /// Number of columns that take part: the first of all.
    pub(crate) size: usize,
    /// Mean.
    pub(crate) mean: Vec<f64>,
    /// Covariance, row by row, `size` entries each.
    pub(crate) covariance: Vec<f64>,
    /// `L⁻¹ G P`, equation by equation, with `L Lᵀ = 1 + G P Gᵀ`.
    gains: Vec<f64>,
    /// Whitened innovation.
    innovation: Vec<f64>,
}

impl State {
    /// Mean and covariance of all columns.
    pub(crate) fn all(&self) -> (DVector<f64>, DMatrix<f64>) {
        let covariance = DMatrix::from_row_slice(self.size, self.size, &self.covariance);
        (DVector::from_column_slice(&self.mean), covariance)
    }

    /// A state of mean zero; `most` is the largest size that it may reach.
    pub(crate) fn new(covariance: Vec<f64>, size: usize, most: usize, equations: usize) -> Self {
        let mut own = Self {
            size,
            mean: Vec::with_capacity(most),
            covariance: Vec::with_capacity(most * most),
            gains: vec![0.0; most * equations],
            innovation: vec![0.0; equations],
        };
        own.mean.resize(size, 0.0);
        own.covariance.extend(covariance);
        own
    }

    /// Mean and covariance of a state of another size: `mean` may be shorter, and is zero beyond.
    pub(crate) fn set(&mut self, mean: &[f64], covariance: &DMatrix<f64>) {
        self.size = covariance.nrows();
        self.mean.clear();
        self.mean.extend(mean);
        self.mean.resize(self.size, 0.0);
        self.covariance.clear();
        // Symmetric, so the order of rows and columns is the same.
        self.covariance.extend(covariance.iter());
    }

    /// Counts a parameter from where its rate has moved it after some rows.
    pub(crate) fn move_on(&mut self, base: usize, rate: usize, rows: f64) {
        let m = self.size;
        if base >= m || rate >= m {
            return;
        }
        self.mean[base] += rows * self.mean[rate];
        for k in 0..m {
            self.covariance[base * m + k] += rows * self.covariance[rate * m + k];
        }
        for row in self.covariance.chunks_exact_mut(m) {
            row[base] += rows * row[rate];
        }
    }

    /// Compares a sample `r` with what is expected, `G` having `width` entries a row: the squared
    /// innovation in units of its covariance, `χ²` of as many degrees of freedom as equations.
    #[inline(always)]
    pub(crate) fn compare(&mut self, r: &[f64], g: &[f64], width: usize) -> f64 {
        let (m, k) = (self.size, r.len());
        for (row, gain) in g.chunks_exact(width).zip(self.gains.chunks_exact_mut(m.max(1))) {
            product(&row[..m], &self.covariance, gain);
        }
        let mut squared = 0.0;
        for i in 0..k {
            let row = &g[i * width..i * width + m];
            let (above, here) = self.gains.split_at_mut(i * m);
            let gain = &mut here[..m];
            let mut variance = 1.0 + dot(row, gain);
            let mut e = r[i] - dot(row, &self.mean);
            for (known, above) in self.innovation.iter().zip(above.chunks_exact(m.max(1))) {
                // `Gᵢ (L⁻¹ G P)ⱼ` is `Lᵢⱼ`, the rows before this one being whitened already.
                let factor = dot(row, above);
                variance -= factor * factor;
                e -= factor * known;
                axpy(-factor, above, gain);
            }
            let inverse = 1.0 / variance.max(f64::MIN_POSITIVE).sqrt();
            gain.iter_mut().for_each(|g| *g *= inverse);
            self.innovation[i] = e * inverse;
            squared += self.innovation[i].powi(2);
        }
        squared
    }

    /// Takes over the sample of the last comparison.
    #[inline(always)]
    pub(crate) fn absorb(&mut self) {
        let m = self.size;
        for (i, e) in self.innovation.iter().enumerate() {
            let gain = &self.gains[i * m..(i + 1) * m];
            axpy(*e, gain, &mut self.mean);
            for (factor, row) in gain.iter().zip(self.covariance.chunks_exact_mut(m.max(1))) {
                axpy(-*factor, gain, row);
            }
        }
    }
}

/// `y += a x`
#[inline(always)]
pub(crate) fn axpy(a: f64, x: &[f64], y: &mut [f64]) {
    for (y, x) in y.iter_mut().zip(x) {
        *y += a * x;
    }
}

/// `y = Σ xₖ rowₖ` of a matrix row by row, in blocks of columns whose sums stay in registers. The order
/// of each sum is that of the rows; the last block begins within the one before.
#[inline(always)]
pub(crate) fn product(x: &[f64], rows: &[f64], y: &mut [f64]) {
    const BLOCK: usize = 8;
    let m = y.len();
    if m < BLOCK {
        y.fill(0.0);
        x.iter().zip(rows.chunks_exact(m.max(1))).for_each(|(x, row)| axpy(*x, row, y));
        return;
    }
    for begin in (0..m).step_by(BLOCK).map(|begin| begin.min(m - BLOCK)) {
        let mut sums = [0.0; BLOCK];
        for (x, row) in x.iter().zip(rows.chunks_exact(m)) {
            axpy(*x, &row[begin..begin + BLOCK], &mut sums);
        }
        y[begin..begin + BLOCK].copy_from_slice(&sums);
    }
}

/// `xᵀ y`, in four running sums that the compiler keeps in one vector.
#[inline(always)]
pub(crate) fn dot(x: &[f64], y: &[f64]) -> f64 {
    let n = x.len().min(y.len());
    let (x, y) = (&x[..n], &y[..n]);
    let mut sums = [0.0; 4];
    let (heads, tails) = (x.chunks_exact(4), y.chunks_exact(4));
    let rest: f64 = heads.remainder().iter().zip(tails.remainder()).map(|(a, b)| a * b).sum();
    for (a, b) in heads.zip(tails) {
        for i in 0..4 {
            sums[i] += a[i] * b[i];
        }
    }
    sums[0] + sums[1] + sums[2] + sums[3] + rest
}

#[cfg(test)]
mod tests {
    use super::product;

    #[test]
    fn a_product_in_blocks_is_the_sum_of_the_rows() {
        for m in 0..30_u32 {
            // Whole numbers: exact in any order.
            let x: Vec<f64> = (0..m).map(|k| f64::from(k * 7 % 5) - 2.0).collect();
            let rows: Vec<f64> = (0..m * m).map(|k| f64::from(k * k % 11) - 5.0).collect();
            let mut y = vec![f64::NAN; m as usize];
            product(&x, &rows, &mut y);
            for (column, found) in y.iter().enumerate() {
                let row = |k: usize| rows[k * m as usize + column];
                let sum: f64 = x.iter().enumerate().map(|(k, x)| x * row(k)).sum();
                assert_eq!(*found, sum, "{m} {column}");
            }
        }
    }
}

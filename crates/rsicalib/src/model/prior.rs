//! What is known without readings.

/// What is known without readings, to a standard deviation `sd`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Prior {
    /// A parameter has this mean.
    Parameter {
        /// The parameter.
        column: usize,
        /// Its expectation.
        mean: f64,
        /// How far it may be from it.
        sd: f64,
    },
    /// Two unknown points are this far apart.
    Apart {
        /// First parameter of each point.
        points: [usize; 2],
        /// Their distance.
        value: f64,
        /// How well it is known.
        sd: f64,
    },
}

impl Prior {
    /// How far parameters `x` are off, in standard deviations.
    #[must_use]
    pub fn off(&self, x: &[f64]) -> f64 {
        match *self {
            Self::Parameter { column, mean, sd } => (x[column] - mean) / sd,
            Self::Apart { points: [a, b], value, sd } => (apart(x, a, b).1 - value) / sd,
        }
    }

    /// Derivatives of [`Prior::off`] by the parameters that it depends on.
    #[must_use]
    pub fn slopes(&self, x: &[f64]) -> Vec<(usize, f64)> {
        match *self {
            Self::Parameter { column, sd, .. } => vec![(column, 1.0 / sd)],
            Self::Apart { points: [a, b], sd, .. } => {
                let (d, length) = apart(x, a, b);
                let along = |k: usize| d[k] / length.max(f64::MIN_POSITIVE) / sd;
                (0..3).flat_map(|k| [(a + k, along(k)), (b + k, -along(k))]).collect()
            }
        }
    }
}

/// Difference and distance of two points among the parameters.
fn apart(x: &[f64], a: usize, b: usize) -> ([f64; 3], f64) {
    let d = std::array::from_fn(|k| x[a + k] - x[b + k]);
    (d, d.iter().map(|d| d * d).sum::<f64>().sqrt())
}

//! Priors: knowledge of the parameters without readings.

use faer::Mat;

/// Knowledge of the parameters without readings, with standard deviation `sd`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Prior {
    /// A parameter has this mean.
    Parameter {
        /// The parameter.
        column: usize,
        /// Expectation of the parameter, in its unit.
        mean: f64,
        /// Standard deviation, in the unit of the parameter.
        sd: f64,
    },
    /// Two unknown points are this far apart.
    Apart {
        /// First parameter of each point.
        points: [usize; 2],
        /// Distance of the points, in length units.
        value: f64,
        /// Standard deviation of the distance, in length units.
        sd: f64,
    },
    /// An unknown point has this coordinate along a direction.
    Along {
        /// First parameter of the point.
        point: usize,
        /// The direction, a unit vector.
        direction: [f64; 3],
        /// The coordinate, in length units.
        mean: f64,
        /// Standard deviation of the coordinate, in length units.
        sd: f64,
    },
}

/// Adds what an observation with these slopes tells to a Gram matrix.
pub(crate) fn add_squares(gram: &mut Mat<f64>, slopes: &[(usize, f64)]) {
    for &(i, slope) in slopes {
        slopes.iter().for_each(|&(j, other)| gram[(i, j)] += slope * other);
    }
}

impl Prior {
    /// Deviation of the parameters `x` from the prior, in standard deviations.
    ///
    /// # Panics
    ///
    /// Where `x` is shorter than the prior's parameters need.
    #[must_use]
    pub fn off(&self, x: &[f64]) -> f64 {
        match *self {
            Self::Parameter { column, mean, sd } => (x[column] - mean) / sd,
            Self::Apart { points: [a, b], value, sd } => (apart(x, a, b).1 - value) / sd,
            Self::Along { point, direction, mean, sd } => {
                let along: f64 = (0..3).map(|k| direction[k] * x[point + k]).sum();
                (along - mean) / sd
            }
        }
    }

    /// The standard deviation.
    #[must_use]
    pub fn sd(&self) -> f64 {
        match *self {
            Self::Parameter { sd, .. } | Self::Apart { sd, .. } | Self::Along { sd, .. } => sd,
        }
    }

    /// Pairs of a parameter and the derivative of [`Prior::off`] by that parameter.
    ///
    /// # Panics
    ///
    /// As [`Prior::off`].
    #[must_use]
    pub fn slopes(&self, x: &[f64]) -> Vec<(usize, f64)> {
        match *self {
            Self::Parameter { column, sd, .. } => vec![(column, 1.0 / sd)],
            Self::Apart { points: [a, b], sd, .. } => {
                let (d, length) = apart(x, a, b);
                let along = |k: usize| d[k] / length.max(f64::MIN_POSITIVE) / sd;
                (0..3).flat_map(|k| [(a + k, along(k)), (b + k, -along(k))]).collect()
            }
            Self::Along { point, direction, sd, .. } => {
                (0..3).map(|k| (point + k, direction[k] / sd)).collect()
            }
        }
    }
}

/// Difference and distance of two points among the parameters.
fn apart(x: &[f64], a: usize, b: usize) -> ([f64; 3], f64) {
    let d = std::array::from_fn(|k| x[a + k] - x[b + k]);
    (d, d.iter().map(|d| d * d).sum::<f64>().sqrt())
}

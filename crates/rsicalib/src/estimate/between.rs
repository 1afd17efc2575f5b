//! What changes from group to group of a session: placements, or sessions.

use faer::Mat;

use crate::numerics::component::Component;

/// What tells groups apart.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "document", derive(schemars::JsonSchema))]
#[cfg_attr(feature = "serde", serde(rename_all = "snake_case"))]
#[non_exhaustive]
pub enum Grouping {
    /// Placements: what is touched was moved.
    Placement,
    /// Sessions: files that were given together.
    Session,
}

/// What changes from group to group of a session.
#[derive(Debug, Clone)]
pub struct Between {
    /// What tells the groups apart.
    pub grouping: Grouping,
    /// Names of the groups.
    pub groups: Vec<String>,
    /// Columns of the parameters that change, and their typical sizes.
    pub changing: Vec<(usize, f64)>,
    /// How much they change, in typical sizes.
    pub component: Component,
    /// Covariance of the parameters, as means over groups (132).
    pub covariance: Mat<f64>,
    /// One half of the groups against the other.
    pub halves: Option<Halves>,
}

/// Estimates of one half of the groups against those of the other.
#[derive(Debug, Clone)]
pub struct Halves {
    /// Numbers of the groups of each half.
    pub groups: [Vec<usize>; 2],
    /// Difference of the parameters.
    pub difference: Vec<f64>,
    /// Covariance of the difference by what is within groups.
    pub within: Mat<f64>,
    /// The same with the component.
    pub between: Mat<f64>,
    /// True where each half has a component of its own, so that the difference takes no part in it.
    pub own: bool,
}

impl Between {
    /// Standard deviation from group to group of each parameter; zero for those that do not change.
    #[must_use]
    pub fn shifts(&self) -> Vec<f64> {
        let mut shifts = vec![0.0; self.covariance.nrows()];
        for (column, typical) in &self.changing {
            shifts[*column] = self.component.variance.sqrt() * typical;
        }
        shifts
    }

    /// Covariance of the parameters of another group (132).
    #[must_use]
    pub fn elsewhere(&self) -> Mat<f64> {
        let shifts = self.shifts();
        let n = shifts.len();
        Mat::from_fn(n, n, |i, j| {
            self.covariance[(i, j)] + if i == j { shifts[i] * shifts[i] } else { 0.0 }
        })
    }
}

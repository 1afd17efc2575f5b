//! Scores of every effect that a model lacks, from one linearisation.
//!
//! A candidate with columns `Z` of the whitened Jacobian is projected off what is
//! already fitted, `X`, and scored against the residual `r`:
//!
//! ```text
//! M = ZᵀZ - ZᵀX (XᵀX)⁻¹ XᵀZ,    u = Zᵀr - ZᵀX (XᵀX)⁻¹ Xᵀr                 (71)
//! T = uᵀ M⁻¹ u  ~  χ²(rank M)                                              (72)
//! ```
//!
//! `T` is by how much χ² would fall to first order. A free shape, held by its
//! typical size, has `M + Λ` in place of `M`, and fewer degrees of freedom.
//!
//! Bad readings and slips are thousands of candidates of one column each; their
//! columns are those of the readings, `L⁻¹A`, in one pose or from one pose on, so
//! running sums score them all.

use crate::Error;
use crate::diagnosis::options::SearchOptions;
use crate::diagnosis::score::bodies::Bodies;
use crate::diagnosis::score::candidates::candidates;
use crate::diagnosis::score::scored::{Judge, Scored};
use crate::diagnosis::score::{periodic, places, projection};
use crate::estimate::at_fit::AtFit;
use crate::estimate::{Fit, Observations};
use crate::numerics::workers;

/// Scores every candidate at a fit.
///
/// # Errors
///
/// As [`Observations::model`].
pub fn scan(
    observations: &Observations,
    fit: &Fit,
    judge: &Judge,
    search: &SearchOptions,
) -> Result<Vec<Scored>, Error> {
    observations.options.progress.step()?;
    let without = &search.without;
    let at = AtFit::new(observations, fit);
    let named = candidates(observations, fit, without);
    let by_terms = || projection::score(observations, fit, judge, &named);
    let by_columns = || -> Result<_, Error> {
        let mut scored = places::score(&at, judge, without)?;
        scored.extend(periodic::score(&at, judge, without));
        scored.extend(Bodies::new(&at, search)?.score(judge));
        Ok(scored)
    };
    // The two halves take about as long as each other.
    let (scored, more) = workers::both(by_terms, by_columns);
    Ok([scored?, more?].concat())
}

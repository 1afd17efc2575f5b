//! Errors of a surface and errors of what touches it, beside small errors of everything drawn.
//!
//! A curve of one joint and a bend of the surface that it touches do nearly the same, and neither is all
//! that a real arm has: then what decides between them is what both leave. Let everything that is drawn be
//! off by a part `τ` of its typical size; what a fit leaves of the columns `Z` of these, `M` and `u` of (71)
//! in typical sizes, explains
//!
//! ```text
//! R = τ² uᵀ (1 + τ² M)⁻¹ u                                                         (116)
//! ```
//!
//! of its χ². The price of each is that of `χ² - R`, and `ln det(1 + τ² M)` with it, as in (131), at the
//! `τ` that is likeliest beside it. Without structure `τ` is 0, and nothing changes.

use faer::Mat;

use crate::Error;
use crate::diagnosis::averaged::{Averaged, cost};
use crate::diagnosis::options::Rule;
use crate::diagnosis::score::candidates::candidates;
use crate::diagnosis::score::projection::project_blocks;
use crate::diagnosis::score::scored::{Family, Scored, is_data};
use crate::diagnosis::search::admissible::physical;
use crate::estimate::Fit;
use crate::model::Instance;
use crate::numerics::component::Contrasts;
use crate::numerics::credible_set::AS_WELL;
use crate::terms::targets::typical;
use crate::terms::term::{Acts, Class};

/// Others that are refitted at the most.
const MOST_OTHERS: usize = 8;

impl Averaged<'_> {
    /// Errors of surfaces that explain as much as an effect of a sensor or a link does, were everything
    /// drawn a little off, or the other way round; what was found after the effect is of that.
    ///
    /// # Errors
    ///
    /// As [`crate::estimate::fit`].
    pub(crate) fn beside_tolerances(
        &self,
        current: &Fit,
        found: &[Scored],
        index: usize,
        scored: &[Scored],
    ) -> Result<Vec<Scored>, Error> {
        let own = found[index];
        let of_surface = is_of_surface(&own);
        let other = |s: &&Scored| if of_surface { is_drawn(s) } else { is_of_surface(s) };
        let new = |s: &&Scored| found.iter().all(|f| f.instance != s.instance);
        let mut others: Vec<Scored> = scored.iter().filter(other).filter(new).copied().collect();
        others.sort_by(|a, b| b.charged().total_cmp(&a.charged()));
        others.truncate(MOST_OTHERS);
        let concerned = of_surface || (is_drawn(&own) && !is_data(&own.instance));
        if others.is_empty() || !concerned || !self.search.uses(Rule::Tolerances) {
            return Ok(Vec::new());
        }
        // Where no surface is touched there is none to be at fault.
        if !self.small.mechanism.touches_surfaces() {
            return Ok(Vec::new());
        }
        let later: Vec<Instance> = found[index..].iter().map(|s| s.instance).collect();
        let without = self.without(current, &later)?;
        let named = self.with(&without, &[own.instance])?;
        let Some(mine) = self.contrasts(&named)? else { return Ok(Vec::new()) };
        let price = |contrasts: &Contrasts, s: &Scored| {
            contrasts.likeliest(|chi2| self.data_of(chi2)) + s.paid()
        };
        let limit = price(&mine, &own) + AS_WELL;
        let mut as_well = Vec::new();
        for candidate in others {
            let refit = self.with(&without, &[candidate.instance])?;
            let sensible = self.sensible(&without, &refit) && physical(&refit, &candidate.instance);
            let its = if sensible { self.contrasts(&refit)? } else { None };
            if its.is_some_and(|its| price(&its, &candidate) <= limit) {
                as_well.push(candidate);
            }
        }
        Ok(as_well)
    }

    /// What a fit leaves of small errors of everything drawn, in their typical sizes.
    fn contrasts(&self, fit: &Fit) -> Result<Option<Contrasts>, Error> {
        let mut all = candidates(&self.small, fit, &self.search.without);
        all.retain(|i| {
            let info = i.term.info();
            let drawn = matches!(info.class, Class::Sensor | Class::Geometry);
            // Where a tool sits is mounted, not drawn.
            let mounted = i.term.moves_tool();
            drawn && !mounted && !info.penalised && !info.law && !i.target.is_shared()
        });
        let width = all.iter().map(Instance::width).sum();
        let inverse = fit.inverse();
        let together = project_blocks(&self.small, fit, &inverse, &all, &[width])?;
        let Some(projected) = together.first() else { return Ok(None) };
        let mechanism = &self.small.mechanism;
        let size: Vec<f64> =
            all.iter().flat_map(|i| typical(mechanism, i.term, i.target)).collect();
        let square =
            Mat::from_fn(width, width, |i, j| projected.square[(i, j)] * size[i] * size[j]);
        let gradient: Vec<f64> =
            projected.gradient.iter().zip(&size).map(|(u, size)| u * size).collect();
        Ok(Contrasts::of(square.as_ref(), &gradient, [cost(fit), fit.dof, 1.0]))
    }
}

/// True for a lasting error of one thing that is drawn.
pub(super) fn is_drawn(scored: &Scored) -> bool {
    let info = scored.instance.term.info();
    let drawn = matches!(info.class, Class::Sensor | Class::Geometry);
    drawn && scored.family == Family::Named
}

/// True for a lasting error of a surface.
pub(super) fn is_of_surface(scored: &Scored) -> bool {
    let surface = matches!(scored.instance.term.acts(), Acts::Surface(_));
    surface && scored.family == Family::Named
}

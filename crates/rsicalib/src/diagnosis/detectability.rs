//! What could be there unseen: how large each absent effect would have to be to be seen,
//! and what it would do to the platform meanwhile.

use faer::{Mat, Side};

use crate::Error;
use crate::apply::change::{Movable, PlatformRms};
use crate::apply::unseen::Unseen;
use crate::diagnosis::left_open::{Open, weigh};
use crate::diagnosis::options::SearchOptions;
use crate::diagnosis::price::least_of_first;
use crate::diagnosis::score::candidates;
use crate::diagnosis::score::projection::{Projected, project};
use crate::diagnosis::score::scored::named_places;
use crate::diagnosis::trace::Traced;
use crate::estimate::carry_over;
use crate::estimate::directions::{as_reported, place, unit};
use crate::model::Instance;
use crate::numerics::symmetric::VISIBLE;
use crate::numerics::workers;

/// How large an absent effect would have to be to be seen, and what it would do meanwhile.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(rename = "Hidden")
)]
#[cfg_attr(feature = "document", derive(schemars::JsonSchema))]
pub struct Detectability {
    /// Id of the term.
    pub term: String,
    /// What the term belongs to.
    pub target: String,
    /// Size that would have been seen in four sessions of five.
    pub detectable: Option<f64>,
    /// Unit of the size.
    pub unit: String,
    /// What an effect of that size does to the platform.
    #[cfg_attr(feature = "serde", serde(default))]
    pub platform_rms: Option<PlatformRms>,
    /// Where a searched term would act: another channel.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub place: Option<String>,
    /// What people call the target.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub label: Option<String>,
    /// What the session leaves open of it.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub unseen: Option<Unseen>,
}

/// Noncentrality of an effect of typical size below which it is none: it would take a million
/// typical sizes to be seen, or it is rounding, as where chains are moved all together.
const NOTHING: f64 = 1e-11;

/// Standard deviations by which an effect is beyond what pays that pays in four sessions of five.
const FOUR_OF_FIVE: f64 = 0.84;

/// Standard deviations of an effect that pays in four sessions of five, one of so many candidates.
pub(crate) fn seen_at(candidates: usize) -> f64 {
    least_of_first(1.0, named_places(candidates as f64)).sqrt() + FOUR_OF_FIVE
}

/// The direction of an effect that is hardest to see among those that can be, and how large the effect
/// must be along it to be seen.
pub(crate) struct Hardest {
    /// Of length 1, in typical sizes.
    pub direction: Vec<f64>,
    /// In typical sizes.
    pub size: f64,
}

impl Hardest {
    /// Of an effect with this information, in typical sizes, of which there was `whole` before the fitted
    /// parameters absorbed their part, seen at so many standard deviations; none where nothing of
    /// it can be.
    pub(crate) fn of(square: &Mat<f64>, whole: f64, seen: f64) -> Option<Self> {
        let eigen = square.self_adjoint_eigen(Side::Lower).ok()?;
        let value = eigen.S().column_vector()[0];
        let visible = value > (VISIBLE * whole).max(NOTHING);
        visible.then(|| Self {
            direction: (0..square.nrows()).map(|i| eigen.U()[(i, 0)]).collect(),
            size: (seen.powi(2) / value).sqrt(),
        })
    }
}

/// How large each absent effect would have to be to be seen, and what it would do.
///
/// # Errors
///
/// As [`crate::diagnosis::trace::trace`].
pub fn could_hide(traced: &Traced, search: &SearchOptions) -> Result<Vec<Detectability>, Error> {
    let (observations, last) = (&traced.small, &traced.last);
    let named: Vec<Instance> = candidates::absent(observations, last, &search.without)
        .into_iter()
        .filter(|i| !i.term.info().penalised)
        .collect();
    let inverse = last.inverse();
    let projected = project(observations, last, &inverse, &named)?;
    let base = last.model.term_parameters;
    let model = observations.model_beside(&last.model, &named)?;
    let first = &model.first[last.model.instances.len()..];
    let extra = model.term_parameters - base;
    let beta = carry_over(last, &model);
    let (_, to_reported) = as_reported(last);
    let platform = Movable::new(observations, &model, &beta, &last.assumed())?;
    let seen = seen_at(named.len());
    let of_one = |((instance, candidate), first): ((&Instance, Projected), &usize)| {
        let info = instance.term.info();
        let d = info.parameters.len();
        let typical =
            crate::terms::targets::typical(&observations.mechanism, instance.term, instance.target);
        let square = Mat::from_fn(d, d, |i, j| candidate.square[(i, j)] * typical[i] * typical[j]);
        let raw: f64 = (0..d).map(|i| candidate.raw[i] * typical[i] * typical[i]).sum();
        let hardest = Hardest::of(&square, raw, seen);
        let direction = hardest.map(|it| -> Vec<f64> {
            (0..d).map(|i| it.direction[i] * typical[i] * it.size).collect()
        });
        let largest = |all: &Vec<f64>| all.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
        let moves = |direction: &[f64]| {
            // What the fitted parameters absorb of it, they move the platform by as well.
            let absorbed = (0..last.beta.len()).map(|i| {
                let by: f64 = (0..d).map(|k| candidate.absorbed[(i, k)] * direction[k]).sum();
                (if i < base { i } else { i + extra }, -by)
            });
            let own = direction.iter().enumerate().map(|(k, by)| (first + k, *by));
            let change: Vec<_> = own.chain(absorbed).collect();
            platform.as_ref().map(|platform| platform.by(&change))
        };
        let platform_rms = direction.as_deref().and_then(&moves);
        let open = Open::of(&candidate, &typical)?;
        let size = open.size(|direction| moves(direction).map(|rms| rms.position));
        let unseen = open.unseen(&to_reported, &candidate.absorbed, base);
        let found = Detectability {
            unseen: Some(unseen),
            term: info.id.into(),
            target: instance.target.name(&observations.mechanism),
            place: place(observations, instance),
            detectable: direction.as_ref().map(largest),
            unit: unit(observations, instance, info.parameters[0].unit),
            platform_rms,
            label: instance.target.label(&observations.mechanism),
        };
        Some((found, size))
    };
    let all = named.iter().zip(projected).zip(first);
    let (mut hidden, sizes): (Vec<Detectability>, Vec<Option<f64>>) =
        workers::map(all, of_one).into_iter().flatten().unzip();
    weigh(hidden.iter_mut().map(|h| &mut h.unseen), &sizes);
    hidden.sort_by(|a, b| {
        let of = |h: &Detectability| h.platform_rms.map_or(0.0, |p| p.position);
        of(b).total_cmp(&of(a))
    });
    Ok(hidden)
}

//! What could be there unseen: how large each absent effect would have to be to be seen,
//! and what it would do to the platform meanwhile.

use std::sync::OnceLock;

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
use crate::estimate::conventions::{OPENED, OtherConfigurations};
use crate::estimate::directions::{as_reported, place, unit};
use crate::estimate::{Fit, Observations, carry_over, conventions_of, other_configurations};
use crate::model::Instance;
use crate::numerics::order;
use crate::numerics::rank::Spaces;
use crate::numerics::symmetric::{VISIBLE, eigenvalues};
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

/// Directions of an effect that some reading could tell, each of typical size: a column for each; none where there
/// is none. What no reading could tell is as drawn, whether a model has a parameter of it or not.
fn units<'a>(
    observations: &Observations,
    fit: &Fit,
    effect: Instance,
    candidate: &Projected,
    room: &dyn Fn() -> Option<&'a OtherConfigurations>,
) -> Option<Mat<f64>> {
    let typical = fit.model.typical_at(effect.term, effect.target);
    let d = typical.len();
    let all = Mat::from_fn(d, d, |i, j| if i == j { typical[i] } else { 0.0 });
    let weak = weak(fit, candidate);
    if weak.is_empty() {
        return Some(all);
    }
    // Configurations take as long to close as all else here.
    let lost = conventions_of(observations, fit, effect, room()).unwrap_or(0).min(weak.len());
    let lost = Mat::from_fn(lost, d, |k, i| weak[k][i] / typical[i]);
    let told = Spaces::of(&lost)?.null;
    (told.ncols() > 0).then(|| all * told)
}

/// Directions of a candidate of which the session tells next to nothing once all that is fitted follows, the weakest first.
fn weak(fit: &Fit, candidate: &Projected) -> Vec<Vec<f64>> {
    let d = candidate.raw.len();
    // What moves no reading is no direction that is lost: it is listed, and seen at no size.
    let moves = |i: usize| candidate.raw[i] > 0.0;
    let length: Vec<f64> =
        (0..d).map(|i| if moves(i) { candidate.raw[i].sqrt() } else { 1.0 }).collect();
    let square = Mat::from_fn(d, d, |i, j| match moves(i) && moves(j) {
        true => candidate.square[(i, j)] / (length[i] * length[j]),
        false => f64::from(u8::from(i == j)),
    });
    let Some((values, vectors)) = eigenvalues(square.as_ref()) else { return Vec::new() };
    let along = |k: usize| -> Vec<f64> { (0..d).map(|i| vectors[(i, k)] / length[i]).collect() };
    let follows = |v: &[f64], i: usize| -> f64 {
        let by: f64 = v.iter().zip(candidate.absorbed.row(i).iter()).map(|(v, by)| v * by).sum();
        by * by * fit.gram[(i, i)]
    };
    let told = |(value, v): &(f64, Vec<f64>)| {
        let follow: f64 = (0..fit.gram.nrows()).map(|i| follows(v, i)).sum();
        value / (1.0 + follow) < OPENED
    };
    let ways = values.iter().enumerate().map(|(k, value)| (*value, along(k)));
    ways.filter(told).map(|(_, v)| v).collect()
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
    let projected = project(observations, last, &named)?;
    let base = last.model.term_parameters;
    let model = observations.model_beside(&last.model, &named)?;
    let first = &model.first[last.model.instances.len()..];
    let extra = model.term_parameters - base;
    let beta = carry_over(last, &model);
    let (_, to_reported) = as_reported(last);
    let platform = Movable::new(observations, &model, &beta, &last.assumed())?;
    let seen = seen_at(named.len());
    let closed = OnceLock::new();
    let widest = named.iter().map(Instance::width).max().unwrap_or(0);
    let room = || closed.get_or_init(|| other_configurations(observations, last, widest)).as_ref();
    let of_one = |((instance, candidate), first): ((&Instance, Projected), &usize)| {
        let info = instance.term.info();
        let d = info.parameters.len();
        let units = units(observations, last, *instance, &candidate, &room)?;
        let square = units.transpose() * &candidate.square * &units;
        let share = |i: usize| candidate.raw[i] * units.row(i).squared_norm_l2();
        let hardest = Hardest::of(&square, (0..d).map(share).sum(), seen);
        let direction = hardest.map(|it| -> Vec<f64> {
            let along = |i: usize| units.row(i).iter().zip(&it.direction).map(|(u, v)| u * v);
            (0..d).map(|i| along(i).sum::<f64>() * it.size).collect()
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
        let open = Open::of(&candidate, &units)?;
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
    order::descending(&mut hidden, |h| h.platform_rms.map_or(0.0, |p| p.position));
    Ok(hidden)
}

//! What a trace says, in the shape of the JSON.

use crate::check::{Check, check, error_of, some_poses};
use crate::excluded::Excluded;
use crate::fit::{Fit, fit};
use crate::leftover::whereabouts;
use crate::model::{Instance, Model, Target};
use crate::objective::{Implicit, Noise, Part};
use crate::result::{
    Estimates, FitReport, HeldOut, ParameterReport, estimates, place, reported, unit,
};
use crate::scan::{self, dot, project};
use crate::session::Session;
use crate::terms::{Acts, Class, Scale, Site};
use crate::trace::{Found, LEFT, Search, Traced, cost, trace};
use crate::{Error, Table, lanes::Lanes, stats};

/// Known poses, for the error before and after.
#[derive(Debug, Clone)]
pub struct Known {
    /// Readings in them.
    pub table: Table,
    /// The poses, row by row.
    pub poses: Vec<[f64; 6]>,
    /// True where they are known up to a rigid motion of the instrument.
    pub align: bool,
}

/// A term at a target.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Place {
    /// Id of the term.
    pub term: String,
    /// Where the fault lies.
    pub class: Class,
    /// What it belongs to.
    pub target: String,
    /// Where a searched term acts.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
    pub place: Option<String>,
}

/// Root mean square of what an effect does to the platform, by component.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct PlatformRms {
    /// Length units.
    pub position: f64,
    /// rad.
    pub orientation: f64,
}

/// One effect that was found.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct StepReport {
    /// The effect.
    #[cfg_attr(feature = "serde", serde(flatten))]
    pub effect: Place,
    /// Probability by chance, corrected for the places looked at.
    pub p_value: f64,
    /// By how much χ² would rise without it.
    pub chi2_rise: f64,
    /// Its parameters.
    pub parameters: Vec<ParameterReport>,
    /// What these poses cannot tell from it.
    pub also_fits: Vec<Place>,
    /// What it does to the platform.
    pub platform_rms: Option<PlatformRms>,
    /// Reading and correction, where it is a curve.
    pub curve: Option<Vec<[f64; 2]>>,
    /// Standard deviation of each correction of the curve.
    pub curve_sd: Option<Vec<f64>>,
    /// Error on poses left out, with this effect and those before it.
    pub held_out: Option<HeldOut>,
}

/// A reading that was left out.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct ExcludedReport {
    /// Label of the pose; none for a whole placement.
    pub pose: Option<i64>,
    /// Sample of the pose, counted from 1; none: all of them.
    pub sample: Option<i64>,
    /// Keys of its unknown points.
    pub group: Option<String>,
    /// The chain at fault.
    pub chain: Option<String>,
    /// The channel at fault.
    pub channel: Option<String>,
    /// How many samples that are.
    pub samples: usize,
    /// Why.
    pub reason: String,
}

/// The calibration with the readings that were left out.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct WithExcluded {
    /// How well it fits.
    pub fit: FitReport,
    /// Its parameters.
    pub parameters: Vec<ParameterReport>,
}

/// What is left.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Unexplained {
    /// Probability of the residual by chance.
    pub p_value: Option<f64>,
    /// Where the structure is.
    pub target: Option<String>,
    /// In words.
    pub text: String,
}

/// An effect that could be there unseen.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Hidden {
    /// Id of the term.
    pub term: String,
    /// What it would belong to.
    pub target: String,
    /// Size that would have been seen in four sessions of five.
    pub detectable: Option<f64>,
    /// Its unit.
    pub unit: String,
    /// What that size would do to the platform.
    pub platform_rms: Option<PlatformRms>,
}

/// The result of a trace.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct TraceReport {
    /// `adequate`, `explained`, `partly_explained`, `unexplained` or `undetermined`.
    pub verdict: &'static str,
    /// Suspicious things.
    pub warnings: Vec<String>,
    /// Readings left out.
    pub excluded: Vec<ExcludedReport>,
    /// The fit as asked for with them.
    pub with_excluded: Option<WithExcluded>,
    /// The fit as asked for.
    pub before: FitReport,
    /// Effects found.
    pub steps: Vec<StepReport>,
    /// The fit with them.
    pub after: FitReport,
    /// What is left.
    pub unexplained: Unexplained,
    /// What could be there unseen, worst first.
    pub could_hide: Vec<Hidden>,
    /// Noise, parameters, covariance and the rest, of the fit after.
    #[cfg_attr(feature = "serde", serde(flatten))]
    pub estimates: Estimates,
    /// Residual of each pose in units of its noise, equation by equation, before.
    pub before_residuals: Vec<Vec<f64>>,
    /// The same after.
    pub after_residuals: Vec<Vec<f64>>,
}

/// Traces a session and reports.
///
/// # Errors
///
/// As [`trace`] and [`check`].
pub fn report(
    session: &Session,
    search: &Search,
    known: Option<&Known>,
) -> Result<TraceReport, Error> {
    let traced = trace(session, search)?;
    let small_before =
        fit(&traced.small, traced.before.model.instances.clone(), Some(&traced.last))?;
    let mut before = FitReport::of(&traced.before);
    let mut after = FitReport::of(&traced.after);
    if let Some(known) = known {
        before.check = Some(check(session, &traced.before, &known.table, &known.poses, false)?);
        after.check =
            Some(check(&traced.session, &traced.after, &known.table, &known.poses, false)?);
        if known.align {
            before.aligned =
                Some(check(session, &traced.before, &known.table, &known.poses, true)?);
            after.aligned =
                Some(check(&traced.session, &traced.after, &known.table, &known.poses, true)?);
        }
    }
    before.held_out = held_out(&traced.small, &small_before);
    let steps = traced
        .found
        .iter()
        .enumerate()
        .map(|(k, found)| step(&traced, &small_before, k, found))
        .collect::<Result<Vec<_>, _>>()?;
    after.held_out = match steps.last() {
        Some(last) => last.held_out,
        None => held_out(&traced.small, &traced.last),
    };
    let unexplained = unexplained(&traced, &steps);
    let verdict = verdict(&traced, &unexplained);
    let with_excluded = (!traced.excluded.is_empty()).then(|| WithExcluded {
        fit: before.clone(),
        parameters: estimates(session, &traced.before).parameters,
    });
    let estimates = estimates(&traced.session, &traced.after);
    Ok(TraceReport {
        verdict,
        warnings: traced.before.warnings.clone(),
        excluded: traced.excluded.iter().map(|e| excluded(&traced.session, e)).collect(),
        with_excluded,
        before,
        steps,
        after,
        unexplained,
        could_hide: could_hide(&traced, search)?,
        estimates,
        before_residuals: by_pose(&traced.small, &small_before),
        after_residuals: by_pose(&traced.small, &traced.last),
    })
}

fn verdict(traced: &Traced, left: &Unexplained) -> &'static str {
    let after = &traced.after;
    if !after.termination.converged() || !after.plausible {
        return "undetermined";
    }
    let quiet = left.p_value.is_none_or(|p| p > LEFT) && left.target.is_none();
    match (traced.found.is_empty(), quiet) {
        (true, true) => "adequate",
        (false, true) => "explained",
        (false, false) => "partly_explained",
        (true, false) => "unexplained",
    }
}

fn effect(session: &Session, instance: &Instance) -> Place {
    let info = instance.term.info();
    Place {
        term: info.id.into(),
        class: info.class,
        target: instance.target.name(&session.mechanism),
        place: place(session, instance),
    }
}

fn step(
    traced: &Traced,
    small_before: &Fit,
    index: usize,
    found: &Found,
) -> Result<StepReport, Error> {
    let session = &traced.session;
    let after = &traced.after;
    let info = found.instance.term.info();
    let (values, covariance) = reported(after);
    let first = after
        .model
        .instances
        .iter()
        .position(|i| *i == found.instance)
        .map_or(0, |k| after.model.first[k]);
    let parameters = info.parameters.iter().enumerate().map(|(k, p)| ParameterReport {
        term: info.id.into(),
        target: found.instance.target.name(&session.mechanism),
        place: place(session, &found.instance),
        name: p.name.into(),
        value: values[first + k],
        sd: (!after.unknowable[first + k])
            .then(|| covariance[(first + k, first + k)].max(0.0).sqrt()),
        unit: unit(session, &found.instance, p.unit),
    });
    let curve = curve(traced, &found.instance, first);
    // What it does to the platform: the search's fit with it against the one without.
    let fewer: Vec<Instance> =
        traced.last.model.instances.iter().copied().filter(|i| *i != found.instance).collect();
    let without = fit(&traced.small, fewer, Some(&traced.last))?;
    let platform_rms = platform_difference(&traced.small, &without, &traced.last);
    // Held out with this effect and those found before it.
    let base = small_before.model.instances.iter().copied();
    let bad = traced.last.model.instances.iter().copied().filter(scan::is_data);
    let up_to = traced.found[..=index].iter().map(|f| f.instance);
    let instances: Vec<Instance> = base.chain(bad).chain(up_to).collect();
    let fitted = fit(&traced.small, instances, Some(&traced.last))?;
    Ok(StepReport {
        effect: effect(session, &found.instance),
        p_value: found.p_value.min(1.0),
        chi2_rise: cost(&without) - cost(&traced.last),
        parameters: parameters.collect(),
        also_fits: found.also.iter().map(|i| effect(session, i)).collect(),
        platform_rms,
        held_out: held_out(&traced.small, &fitted),
        curve_sd: curve.as_ref().map(|c| c.iter().map(|p| p[2]).collect()),
        curve: curve.map(|c| c.into_iter().map(|p| [p[0], p[1]]).collect()),
    })
}

/// Correction of a sensor term over the readings that occur, with its deviation.
fn curve(traced: &Traced, instance: &Instance, first: usize) -> Option<Vec<[f64; 3]>> {
    let Acts::Sensor(term) = instance.term.acts() else { return None };
    let Target::Channel(channel) = instance.target else { return None };
    if instance.term.info().needs != crate::terms::Needs::Nothing {
        return None;
    }
    let after = &traced.after;
    let scales: &[Scale] = &after.model.scales;
    let [low, high] = scales[channel].span;
    let width = instance.width();
    let p = &after.beta[first..first + width];
    let mut out = vec![Lanes::ZERO; width];
    let points = 33;
    let curve = (0..points).map(|i| {
        let reading = low + (high - low) * f64::from(i) / f64::from(points - 1);
        let readings = vec![Lanes::splat(reading); scales.len()];
        let still = vec![Lanes::ZERO; scales.len()];
        let site = Site {
            readings: &readings,
            channel,
            scales,
            time: Lanes::ZERO,
            temperature: Lanes::ZERO,
            approach: &still,
            velocity: &still,
            pose: Lanes::ZERO,
            place: instance.place,
        };
        term.partials(p, &site, &mut out);
        let mut variance = 0.0;
        for i in 0..width {
            for j in 0..width {
                variance += out[i].0[0] * out[j].0[0] * after.covariance[(first + i, first + j)];
            }
        }
        [reading, term.correction(p, &site).0[0], variance.max(0.0).sqrt()]
    });
    Some(curve.collect())
}

/// Blocks of a long recording in which the platform is looked at.
const LOOKS: usize = 16;

/// Platform poses of a fit, with their rows; none without a platform.
type Poses = Option<Vec<(usize, [f64; 6])>>;

fn platform(session: &Session, model: &Model, beta: &[f64], noise: &Noise) -> Poses {
    let stride = session.readings.blocks().len().div_ceil(LOOKS);
    (!session.mechanism.platform.is_empty())
        .then(|| some_poses(model, &session.readings, beta, &noise.sigma, noise.play, stride))
}

fn noise_of(fit: &Fit) -> Noise {
    Noise { sigma: fit.noise.sigma.clone(), play: fit.noise.play }
}

fn platform_difference(session: &Session, a: &Fit, b: &Fit) -> Option<PlatformRms> {
    let pa = platform(session, &a.model, &a.beta, &noise_of(a))?;
    let pb = platform(session, &b.model, &b.beta, &noise_of(b))?;
    Some(difference(session, &pa, &pb))
}

fn difference(session: &Session, a: &[(usize, [f64; 6])], b: &[(usize, [f64; 6])]) -> PlatformRms {
    let counts = |row: usize| session.weights[row] > 0.0;
    let pairs: Vec<_> =
        a.iter().zip(b).filter(|(a, _)| counts(a.0)).map(|(a, b)| (a.1, b.1)).collect();
    let Check { position_rms, orientation_rms, .. } = error_of(&pairs, false);
    PlatformRms { position: position_rms, orientation: orientation_rms }
}

/// Folds of the cross-validation.
const FOLDS: usize = 6;

/// Error on whole poses left out in blocks of time, everything refitted without them.
#[must_use]
pub fn held_out(session: &Session, full: &Fit) -> Option<HeldOut> {
    let poses = session.readings.poses();
    let rows = session.readings.rows_of_poses();
    let (mut chi2, mut square, mut equations) = (0.0, 0.0, 0.0);
    for fold in 0..FOLDS.min(poses) {
        let out = poses * fold / FOLDS.min(poses)..poses * (fold + 1) / FOLDS.min(poses);
        let mut training = session.clone();
        for row in out.clone().flat_map(|p| &rows[p]) {
            training.weights[*row] = 0.0;
        }
        let trained = fit(&training, full.model.instances.clone(), Some(full)).ok()?;
        let part = Part {
            model: &trained.model,
            readings: &session.readings,
            weights: Some(&session.weights),
        };
        // A point that was left out whole is where the others' terms touch it.
        let (mut beta, mut placed) = (trained.beta.clone(), trained.beta.clone());
        trained.model.place_unknowns(&session.readings, &mut placed);
        for first in trained.model.untouched(&session.readings, &training.weights) {
            beta[first..first + 3].copy_from_slice(&placed[first..first + 3]);
        }
        let problem = Implicit::new(vec![(part, noise_of(full))], &[]);
        let residuals = problem.residuals(&beta, false);
        let k = residuals.equations;
        for row in out.flat_map(|p| rows[p].clone()).filter(|&r| session.weights[r] > 0.0) {
            chi2 += residuals.whitened[row * k..(row + 1) * k].iter().map(|r| r * r).sum::<f64>();
            square += residuals.lengths[row * k..(row + 1) * k].iter().map(|r| r * r).sum::<f64>();
            equations += k as f64;
        }
    }
    (equations > 0.0).then(|| HeldOut {
        chi2_per_dof: chi2 / equations,
        rms_misclosure: (square / equations).sqrt(),
    })
}

/// Whitened residuals pose by pose, in the order of the poses.
fn by_pose(session: &Session, fit: &Fit) -> Vec<Vec<f64>> {
    let k = fit.residuals.equations;
    let rows = session.readings.rows_of_poses();
    rows.iter().map(|r| fit.residuals.whitened[r[0] * k..(r[0] + 1) * k].to_vec()).collect()
}

/// A reading that was left out, as users call it.
#[must_use]
pub fn excluded(session: &Session, excluded: &Excluded) -> ExcludedReport {
    let Session { readings, mechanism, .. } = session;
    let rows = readings.rows_of_poses();
    let first = excluded.pose.map(|p| rows[p][0]).or(excluded.placement);
    let keys =
        first.map(|row| readings.table.keys.iter().map(|k| k[row].as_str()).collect::<Vec<_>>());
    let sample = |pose: usize| {
        excluded.row.and_then(|row| rows[pose].iter().position(|r| *r == row)).map(|s| s as i64 + 1)
    };
    ExcludedReport {
        pose: excluded.pose.map(|p| readings.labels[p]),
        sample: excluded.pose.and_then(sample),
        // A whole placement is named by its first key, a sample by all of them.
        group: keys
            .filter(|k| !k.is_empty())
            .map(|k| if excluded.pose.is_some() { k.join(", ") } else { k[0].into() }),
        chain: excluded.chain.map(|c| mechanism.chains[c].name.clone()),
        channel: excluded.channel.map(|c| mechanism.channels[c].name.clone()),
        samples: excluded.samples,
        reason: excluded.reason.clone(),
    }
}

/// Whether what is left is noise, and if not, where it is.
fn unexplained(traced: &Traced, steps: &[StepReport]) -> Unexplained {
    let last = &traced.last;
    let p_value = traced.judge.lack_of_fit(last);
    let quiet = p_value.is_none_or(|p| p > LEFT);
    if let Some(faint) = doubtful(steps).filter(|_| quiet) {
        return faint_beside_others(p_value, faint);
    }
    if quiet {
        let text = match p_value {
            Some(_) => format!("nothing left above the noise{}", nearest(traced)),
            None => {
                "lack of fit cannot be judged: record each pose several times, or declare the noise"
                    .into()
            }
        };
        return Unexplained { p_value, target: None, text };
    }
    let (target, text) = locate(traced);
    Unexplained { p_value, target: Some(target), text }
}

/// An effect beside others that χ² would not rise by this much without is doubtful: where
/// the catalogue lacks the effect, several of its terms make it up between them, the
/// last of them faint. Measured: docs/decisions/0004.
const FAINT: f64 = 40.0;

/// The faintest of several effects, if it is doubtful.
fn doubtful(steps: &[StepReport]) -> Option<&StepReport> {
    let faintest = steps.iter().min_by(|a, b| a.chi2_rise.total_cmp(&b.chi2_rise))?;
    (steps.len() > 1 && faintest.chi2_rise < FAINT).then_some(faintest)
}

fn faint_beside_others(p_value: Option<f64>, faint: &StepReport) -> Unexplained {
    let Place { term, target, .. } = &faint.effect;
    let text = format!(
        "nothing left above the noise, but {term} of {target} is faint beside the others (χ² would rise \
         by {:.0} without it): together they may stand for one effect that the catalogue lacks. \
         Record more poses, and see whether all of them are found again.",
        faint.chi2_rise
    );
    Unexplained { p_value, target: Some(target.clone()), text }
}

/// The effect that came nearest to being named, where chance makes such a one in less
/// than half of all sessions.
fn nearest(traced: &Traced) -> String {
    let near = traced.left.filter(|s| s.corrected < 0.5 && !scan::is_data(&s.instance));
    near.map_or(String::new(), |s| {
        let (id, target) = (s.instance.term.info().id, s.instance.target);
        let target = target.name(&traced.session.mechanism);
        format!(
            "; nearest to it is {id} of {target}, as chance makes one with p = {:.2}",
            s.corrected
        )
    })
}

/// Share of what a chain takes up that one of its channels must take up alone to
/// be the one at fault.
const ALONE: f64 = 0.6;
/// The same where an effect was named at another of its channels: two that are
/// wrong may be one fault of what they carry.
const ALONE_BESIDE: f64 = 0.85;

/// The channel, or the chain, whose readings could best take up what is left, pose
/// by pose: what it takes up beyond what it would take up of noise.
fn locate(traced: &Traced) -> (String, String) {
    let mechanism = &traced.small.mechanism;
    let excess = |channels: &[usize]| {
        let (taken, dimensions) = taken_up(traced, channels);
        taken - dimensions
    };
    let best = |scores: &[f64]| (0..scores.len()).max_by(|&a, &b| scores[a].total_cmp(&scores[b]));
    let of_chain: Vec<Vec<usize>> =
        (0..mechanism.chains.len()).map(|c| mechanism.channels_of(c)).collect();
    let chains: Vec<f64> = of_chain.iter().map(|channels| excess(channels)).collect();
    let chain = best(&chains).unwrap_or(0);
    let channels: Vec<f64> = of_chain[chain].iter().map(|&c| excess(&[c])).collect();
    let channel = best(&channels).unwrap_or(0);
    let beside = traced.found.iter().any(|found| match found.instance.target {
        Target::Channel(c) => c != of_chain[chain][channel] && of_chain[chain].contains(&c),
        _ => false,
    });
    let needed = if beside { ALONE_BESIDE } else { ALONE };
    let alone = channels.get(channel).is_some_and(|e| *e >= needed * chains[chain]);
    let (name, what) = if alone {
        let name = &mechanism.channels[of_chain[chain][channel]].name;
        (name.clone(), format!("errors of {name}"))
    } else {
        let name = &mechanism.chains[chain].name;
        (name.clone(), format!("errors of several joints of {name}, or of its tip,"))
    };
    let everything: Vec<usize> = (0..mechanism.channels.len()).collect();
    let share = 100.0 * if alone { channels[channel] } else { chains[chain] } / excess(&everything);
    let places = of_chain[chain].get(channel).map(|&c| whereabouts(traced, c)).unwrap_or_default();
    let places = if places.is_empty() { places } else { format!(" ({places})") };
    let text = format!(
        "structure is left that no effect of the catalogue explains; {what} would take up {:.0} % of it{places}. \
         Record more poses that move {name} through its range, alone, slowly, in both directions.",
        share.clamp(0.0, 100.0)
    );
    (name, text)
}

/// χ² of what is left that errors of these channels, free in each pose, would take
/// up, and in how many dimensions.
fn taken_up(traced: &Traced, channels: &[usize]) -> (f64, f64) {
    let (session, residuals) = (&traced.small, &traced.last.residuals);
    let (k, c) = (residuals.equations, session.readings.channels);
    let (mut taken, mut dimensions) = (0.0, 0.0);
    for row in (0..session.readings.samples).filter(|&r| session.weights[r] > 0.0) {
        let r = &residuals.whitened[row * k..(row + 1) * k];
        let mut basis: Vec<Vec<f64>> = Vec::new();
        for &channel in channels {
            let column: Vec<f64> =
                (0..k).map(|e| residuals.by_reading[(row * k + e) * c + channel]).collect();
            let mut rest = column.clone();
            for known in &basis {
                let along = dot(known, &rest);
                rest.iter_mut().zip(known).for_each(|(r, k)| *r -= along * k);
            }
            let length = dot(&rest, &rest).sqrt();
            if length > 1e-6 * dot(&column, &column).sqrt() {
                basis.push(rest.iter().map(|v| v / length).collect());
            }
        }
        taken += basis.iter().map(|b| dot(b, r).powi(2)).sum::<f64>();
        dimensions += basis.len() as f64;
    }
    (taken, dimensions)
}

/// How large each absent effect would have to be to be seen, and what it would do.
fn could_hide(traced: &Traced, search: &Search) -> Result<Vec<Hidden>, Error> {
    let (session, last) = (&traced.small, &traced.last);
    let named: Vec<Instance> = scan::candidates(session, last, &search.without)
        .into_iter()
        .filter(|i| !i.term.info().penalised)
        .collect();
    let (inverse, ..) = crate::fit::invert(&last.gram);
    let projected = project(session, last, &inverse, &named)?;
    let places = named.len() as f64;
    let noise = noise_of(last);
    let here = platform(session, &last.model, &last.beta, &noise);
    let mut hidden = Vec::with_capacity(named.len());
    for candidate in projected {
        let info = candidate.instance.term.info();
        let d = info.parameters.len();
        // Noncentrality that is seen in four sessions of five, at the corrected level.
        let z = stats::normal_quantile(1.0 - 0.5 * search.alpha / places) + 0.84;
        let wanted = z * z;
        // The direction, in typical sizes, that is hardest to see among those that can be.
        let typical = &candidate.typical;
        let square =
            faer::Mat::from_fn(d, d, |i, j| candidate.square[(i, j)] * typical[i] * typical[j]);
        let Ok(eigen) = square.self_adjoint_eigen(faer::Side::Lower) else { continue };
        let raw: f64 = (0..d).map(|i| candidate.raw[i] * typical[i] * typical[i]).sum();
        let value = eigen.S().column_vector()[0];
        let visible = value > 1e-8 * raw;
        let size = if visible { (wanted / value).sqrt() } else { f64::NAN };
        let direction: Vec<f64> = (0..d).map(|i| eigen.U()[(i, 0)] * typical[i] * size).collect();
        let largest = direction.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
        let platform_rms = match (&here, visible) {
            (Some(here), true) => {
                let with = with_effect(
                    session,
                    last,
                    &candidate.instance,
                    &direction,
                    &candidate.absorbed,
                )?;
                platform(session, &with.0, &with.1, &noise)
                    .map(|there| difference(session, here, &there))
            }
            _ => None,
        };
        hidden.push(Hidden {
            term: info.id.into(),
            target: candidate.instance.target.name(&session.mechanism),
            detectable: visible.then_some(largest),
            unit: unit(session, &candidate.instance, info.parameters[0].unit),
            platform_rms,
        });
    }
    hidden.sort_by(|a, b| {
        let of = |h: &Hidden| h.platform_rms.map_or(0.0, |p| p.position);
        of(b).total_cmp(&of(a))
    });
    Ok(hidden)
}

/// A model with one more effect of a given size, the rest having absorbed what it can.
fn with_effect(
    session: &Session,
    fit: &Fit,
    instance: &Instance,
    size: &[f64],
    absorbed: &faer::Mat<f64>,
) -> Result<(Model, Vec<f64>), Error> {
    let mut instances = fit.model.instances.clone();
    instances.push(*instance);
    let model = Model::about(&session.mechanism, &session.readings, instances, &session.centre)?;
    let base = fit.model.term_parameters;
    let mut beta = model.nominal();
    for (i, value) in fit.beta.iter().enumerate() {
        let moved: f64 = size.iter().enumerate().map(|(k, s)| absorbed[(i, k)] * s).sum();
        let at = if i < base { i } else { i + size.len() };
        beta[at] = value - moved;
    }
    beta[base..base + size.len()].copy_from_slice(size);
    Ok((model, beta))
}

//! A trace, reported: what it found, what data in which that was not found say of it, and the verdict.

use std::f64::consts::TAU;

use crate::Error;
use crate::apply::change::{PlatformRms, apart, platform_difference};
use crate::apply::check::CheckReadings;
use crate::diagnosis::curve::curve;
use crate::diagnosis::curve_law::curve_law;
use crate::diagnosis::detectability::could_hide;
use crate::diagnosis::elsewhere::{Elsewhere, NotApplied, elsewhere};
use crate::diagnosis::held_out::{HeldOut, held_out, held_out_rows};
use crate::diagnosis::localisation::{Residual, residual};
use crate::diagnosis::options::SearchOptions;
use crate::diagnosis::plausibility::{Absurdity, absurdities};
use crate::diagnosis::score::candidates::{changes_scale, differ_by_scale};
use crate::diagnosis::score::scored;
use crate::diagnosis::search::rivals::{self, UNKNOWN_NOISE};
use crate::diagnosis::trace::{Explanation, Found, Traced, trace};
use crate::diagnosis::unknown_law::{UNKNOWN_LAW, UnknownLaw};
use crate::diagnosis::verdict::{self, Compared, Determined, Evidence, Judgement, Verdict};
use crate::estimate::directions::{directions, reported, unit};
use crate::estimate::progress::{Job, Progress, Stage};
use crate::estimate::{Fit, Note, Observations, fit, with_groups};
use crate::mechanism::Target;
use crate::model::Instance;
use crate::monitor::closing::OpenLoops;
use crate::numerics::order;
use crate::report::beside::{Beside, GroupsReport};
use crate::report::by_pose::by_pose;
use crate::report::result::{self, Estimates, FitReport, WithExcluded, estimates, excluded};
use crate::report::trace_report::{
    FoundLaw, Left, Place, RivalReport, StepParameter, StepReport, TraceReport, Unexplained,
};
use crate::report::{warned, words};
use crate::terms::term::{Class, Needs, ORDER_STEP, Placed};

/// Traces a session and reports.
///
/// # Errors
///
/// As [`trace`], [`crate::apply::check::check`] and [`Beside::groups`].
pub fn report(
    observations: &Observations,
    search: &SearchOptions,
    beside: Option<&Beside>,
) -> Result<TraceReport, Error> {
    Ok(traced(observations, search, beside)?.0)
}

/// Traces a session; what the search found stands beside the report.
///
/// # Errors
///
/// As [`report`].
pub fn traced(
    observations: &Observations,
    search: &SearchOptions,
    beside: Option<&Beside>,
) -> Result<(TraceReport, Traced), Error> {
    let progress = &observations.options.progress;
    progress.begin(Job::Trace);
    let mut traced = trace(observations, search)?;
    progress.enter(Stage::HeldOut);
    let trial = Trial::of(&traced, search)?;
    let [before, after] = fits(observations, &traced, &trial, beside)?;
    let judged = Judged::of(observations, &traced, &trial, [&before, &after], beside)?;
    let Judged { absurd, nominal, groups, open_loops, estimates, judgement } = judged;
    let rivals = rivals_of(&traced);
    let steps = traced.found.iter().zip(&trial.not_applied).zip(&trial.held_out);
    let steps = steps.map(|((found, not_applied), held_out)| StepReport {
        held_out: *held_out,
        ..step((&traced, &rivals), found, *not_applied)
    });
    let steps: Vec<StepReport> = steps.collect();
    let with_excluded = (!traced.excluded.is_empty()).then(|| WithExcluded {
        fit: before.clone(),
        parameters: result::parameters(observations, &traced.before),
    });
    let Judgement { verdict, reasons } = judgement;
    let sd = estimates.predicted.as_ref().map(|predicted| predicted.position_sd);
    let unexplained = unexplained(observations, &traced, &trial.residual, verdict, sd);
    progress.enter(Stage::Detectability);
    let could_hide = could_hide(&traced, search)?;
    // By known poses a result that leaves something says how large its errors are.
    let leaves = matches!(verdict, Verdict::PartlyExplained | Verdict::Unexplained);
    let of_known = beside.and_then(|beside| beside.known.as_ref());
    let known = of_known.filter(|_| leaves);
    let report = TraceReport {
        verdict,
        reasons,
        implausible: warned::implausible(&traced.observations, &absurd),
        warnings: warned::warnings(observations, &traced.before, &traced.after)
            .into_iter()
            .chain(warned::as_drawn(&traced))
            .chain(warned::unread(&traced))
            .chain(warned::known_poses(observations, after.aligned.or(after.check)))
            .chain(warned::clocks(&traced.observations, &trial.applied, of_known))
            .chain(open_loops.map(|open| warned::open_loops(&observations.mechanism, &open)))
            .collect(),
        excluded: traced
            .excluded
            .iter()
            .map(|e| excluded(&traced.observations, &traced.after, e))
            .collect(),
        with_excluded,
        before,
        steps,
        elsewhere: trial.elsewhere,
        rivals,
        after,
        nominal,
        groups,
        unexplained,
        could_hide,
        check_readings: known.map(|known| CheckReadings::of(&observations.mechanism, known)),
        estimates,
        before_residuals: match &traced.stretches {
            Some(_) => by_pose(&traced.observations, &traced.before),
            None => by_pose(&traced.small, &trial.before),
        },
        after_residuals: by_pose(traced.answer().0, traced.answer().1),
    };
    // Whoever listened has been told that the job is done.
    for session in [&mut traced.observations, &mut traced.small] {
        session.options.progress = Progress::default();
    }
    Ok((report, traced))
}

/// What data that an effect was not found in say of it, and which effects are applied.
struct Trial {
    /// The fit of the search without the effects.
    before: Fit,
    /// What is left beside them.
    residual: Residual,
    /// Error on poses left out in turn, with each effect and those found before it.
    held_out: Vec<Option<HeldOut>>,
    /// The same without effects.
    held_out_before: Option<HeldOut>,
    /// The same with all beside that without.
    compared: Option<Compared>,
    elsewhere: Option<Elsewhere>,
    /// Of each effect why it is not applied.
    not_applied: Vec<Option<NotApplied>>,
    /// The fit of the session with those that are.
    applied: Fit,
}

impl Trial {
    fn of(traced: &Traced, search: &SearchOptions) -> Result<Self, Error> {
        let asked = traced.before.model.instances.clone();
        let before = fit(&traced.small, asked, Some(&traced.last))?;
        let rises: Vec<f64> = traced.found.iter().map(|found| found.rise).collect();
        let residual = residual(traced, &rises);
        let held_out = held_out_with(traced, &before)?;
        let held_out_before = left_out(traced, &before, &traced.before);
        let both = held_out_before.zip(held_out.last().copied().flatten());
        let compared = both.map(|(before, after)| compared(traced, &before, &after));
        let (elsewhere, not_applied) = elsewhere(traced, search, &residual).unzip();
        let elsewhere = elsewhere.flatten();
        let worse = compared.is_some_and(|compared| compared.worse());
        let not_applied = not_applied.unwrap_or_else(|| in_one_session(traced, search, worse));
        let applies: Vec<bool> = not_applied.iter().map(Option::is_none).collect();
        let applied = applied(traced, &applies)?;
        Ok(Self {
            before,
            residual,
            held_out,
            held_out_before,
            compared,
            elsewhere,
            not_applied,
            applied,
        })
    }

    /// True where all that was found is applied.
    fn applies_all(&self) -> bool {
        self.not_applied.iter().all(Option::is_none)
    }

    /// The effects that are applied: what is not is no part of what is used.
    fn used<'a>(&'a self, traced: &'a Traced) -> impl Iterator<Item = Instance> + 'a {
        let each = traced.found.iter().zip(&self.not_applied);
        each.filter(|(_, why)| why.is_none()).map(|(found, _)| found.instance)
    }
}

/// The fit as asked for, and the fit with what is applied, by known poses and by poses left out in turn.
fn fits(
    observations: &Observations,
    traced: &Traced,
    trial: &Trial,
    beside: Option<&Beside>,
) -> Result<[FitReport; 2], Error> {
    let (mut before, mut after) = (FitReport::of(&traced.before), FitReport::of(&traced.after));
    if let Some(known) = beside.and_then(|beside| beside.known.as_ref()) {
        known.judge(observations, &traced.before, &mut before)?;
        known.judge(&traced.observations, &trial.applied, &mut after)?;
    }
    before.held_out = trial.held_out_before;
    after.held_out = match trial.held_out.last() {
        Some(last) => *last,
        None if traced.last.model.instances == trial.before.model.instances => before.held_out,
        None => left_out(traced, &traced.last, &traced.after),
    };
    Ok([before, after])
}

/// The verdict, and the evidence for it that a report shows.
struct Judged {
    absurd: Vec<Absurdity>,
    nominal: Option<FitReport>,
    groups: Option<GroupsReport>,
    open_loops: Option<OpenLoops>,
    estimates: Estimates,
    judgement: Judgement,
}

impl Judged {
    fn of(
        observations: &Observations,
        traced: &Traced,
        trial: &Trial,
        [before, after]: [&FitReport; 2],
        beside: Option<&Beside>,
    ) -> Result<Self, Error> {
        let last = (&traced.observations, &trial.applied);
        let absurd = absurdities(last.0, last.1, &trial.used(traced).collect::<Vec<_>>());
        let of_all = directions(&traced.observations, &traced.after);
        let own = (!trial.applies_all()).then(|| directions(last.0, last.1));
        let mut estimates = estimates(last.0, last.1, own.as_ref().unwrap_or(&of_all));
        let found: Vec<Instance> = traced.found.iter().map(|found| found.instance).collect();
        let beside_found = of_all.beside(&traced.observations, &found);
        let determined = Determined::of(&traced.after, &beside_found);
        let nominal = beside.map(Beside::nominal).transpose()?.flatten();
        let all = Some((observations, &traced.before));
        let groups = beside.map(|beside| beside.groups(last, all)).transpose()?.flatten();
        let [groups_declared, groups_before] =
            groups.as_ref().map(GroupsReport::compared).unwrap_or_default();
        let open_loops = Beside::open_loops(beside, determined, last, &estimates, after.checked())?;
        let judgement = verdict::judge(&Evidence {
            determined,
            absurd: !absurd.is_empty(),
            open: absurd.iter().any(Absurdity::is_of_readings),
            p_value: traced.p_value,
            chi2_per_dof: after.chi2_per_dof(),
            mistaken: traced.mistaken || traced.after.is_unlike_drawn(),
            loose: traced.after.is_loose(),
            found: !traced.found.is_empty(),
            doubtful: matches!(trial.residual, Residual::Doubtful(_) | Residual::UnknownLaw(_)),
            held_out: after.held_out,
            held_out_before: trial.compared,
            predicted: estimates.beforehand(),
            contradicted: traced.after.contradicts_knowledge(),
            open_loops,
            check: after.checked(),
            check_declared: nominal.as_ref().and_then(|nominal| after.beside(nominal)),
            check_before: after.beside(before),
            groups: groups.as_ref().and_then(GroupsReport::expected),
            groups_declared,
            groups_before,
        });
        estimates.say_what_is_left(&traced.observations, &traced.after);
        Ok(Self { absurd, nominal, groups, open_loops, estimates, judgement })
    }
}

/// What is left, in words, and the law that it seems to follow; `sd` is what is predicted of positions.
fn unexplained(
    observations: &Observations,
    traced: &Traced,
    residual: &Residual,
    verdict: Verdict,
    sd: Option<f64>,
) -> Unexplained {
    let (mechanism, small) = (&observations.mechanism, &traced.small.mechanism);
    let (target, left) = words::residual(mechanism, residual);
    let target = match (residual, &traced.isolated) {
        (Residual::Doubtful(_), Some(isolated)) => Some(isolated.target.name(mechanism)),
        _ => target,
    };
    let another = sd.and_then(|sd| Some((rivals::elsewhere(&traced.rivals, sd)?, sd)));
    let another = another.map(|((rival, apart), sd)| words::another(small, rival, apart, sd));
    let unknown = traced.unknown.as_ref().filter(|law| law.ties());
    let law = unknown.map(|law| words::unknown_law(small, law));
    let sound = matches!(verdict, Verdict::Adequate | Verdict::Unjudged);
    let something = !traced.found.is_empty() || !sound;
    let untried = words::not_looked_for(&observations.readings).filter(|_| something);
    let said: Vec<String> = another.into_iter().chain([left]).chain(law).chain(untried).collect();
    Unexplained {
        p_value: traced.p_value,
        target,
        text: words::sentences(&said),
        kind: Some(Left::of(residual)),
        depends_on: unknown.map(|law| law.depends_on.clone()).unwrap_or_default(),
        also_of: unknown
            .into_iter()
            .flat_map(|law| law.targets().split_off(1))
            .map(|target| target.name(mechanism))
            .collect(),
        law: unknown.and_then(|law| FoundLaw::of(mechanism, law)),
    }
}

/// Which effects are not applied of one session that has no blocks: those of which a law takes the place, and all where
/// poses left out in turn are worse with them.
fn in_one_session(traced: &Traced, search: &SearchOptions, worse: bool) -> Vec<Option<NotApplied>> {
    let why = |found: &Found| match traced.undone(found) {
        _ if search.apply_all => None,
        true => Some(NotApplied::Law),
        false if worse => Some(NotApplied::NoHelp),
        false => traced.order_is_open(found).then_some(NotApplied::Order),
    };
    traced.found.iter().map(why).collect()
}

/// Error on poses left out in turn, with each effect and those found before it.
fn held_out_with(traced: &Traced, before: &Fit) -> Result<Vec<Option<HeldOut>>, Error> {
    let asked = before.model.instances.iter().copied();
    let base = asked.filter(|i| !traced.offsets.contains(i));
    let bad = traced.last.model.instances.iter().copied().filter(scored::is_data);
    let base: Vec<Instance> = base.chain(bad).collect();
    let with = |last: usize| {
        let found = traced.found[..=last].iter().map(|f| f.instance);
        let instances = base.iter().copied().chain(found).collect();
        let fitted = fit(&traced.small, instances, Some(&traced.last))?;
        Ok(left_out(traced, &fitted, &traced.after))
    };
    (0..traced.found.len()).map(with).collect()
}

/// The fit with the effects that are applied.
fn applied(traced: &Traced, applies: &[bool]) -> Result<Fit, Error> {
    if applies.iter().all(|applies| *applies) {
        return Ok(traced.after.clone());
    }
    let not: Vec<Instance> = (traced.found.iter().zip(applies))
        .filter(|(_, applies)| !**applies)
        .map(|(found, _)| traced.in_all(&found.instance))
        .collect();
    let left = traced.after.model.instances.iter().copied().filter(|i| !not.contains(i));
    let fitted = fit(&traced.observations, left.collect(), Some(&traced.after))?;
    Ok(with_groups(fitted, &traced.observations))
}

/// Error on poses left out in turn, by a fit of the search, with the noise of a fit of the session.
fn left_out(traced: &Traced, fitted: &Fit, of_all: &Fit) -> Option<HeldOut> {
    match &traced.stretches {
        Some(stretches) => {
            let small = (&traced.small, fitted);
            held_out_rows(
                stretches,
                small,
                (&traced.observations, &of_all.assumed()),
                &traced.judge,
            )
        }
        None => held_out(&traced.small, fitted, &traced.judge),
    }
}

/// Error on poses left out in turn, with the effects found and without: χ² is a mean of squares,
/// whose relative deviation is twice that of the root.
fn compared(traced: &Traced, before: &HeldOut, after: &HeldOut) -> Compared {
    let equations = traced.last.residuals.equations * traced.answer().0.readings.poses();
    let errors = 0.25 * equations as f64;
    Compared::of_errors(after.chi2_per_dof, before.chi2_per_dof, errors)
}

fn rival(observations: &Observations, explanation: &Explanation) -> RivalReport {
    let effects = explanation.effects.iter().map(|i| Place::of(observations, i));
    let noise = explanation.noise.map(|at| no_term(observations, UNKNOWN_NOISE, at));
    RivalReport {
        terms: effects.chain(noise).collect(),
        chi2_penalised: explanation.chi2,
        probability: explanation.probability,
    }
}

/// The explanations that are nearly as good as the best, a law that no term has among them; none where
/// nothing is to be explained.
fn rivals_of(traced: &Traced) -> Vec<RivalReport> {
    if !traced.lacks_something() {
        return Vec::new();
    }
    let mut all: Vec<RivalReport> = traced.rivals.iter().map(|e| rival(&traced.small, e)).collect();
    if let Some(law) = &traced.unknown {
        if all.is_empty() {
            // Of what was asked for alone: readings that are wrong, or nothing.
            let chi2_penalised = law.price - law.behind;
            all.push(RivalReport { terms: Vec::new(), chi2_penalised, probability: 0.0 });
        }
        let terms = with_law(traced, law);
        all.push(RivalReport { terms, chi2_penalised: law.price, probability: 0.0 });
        order::ascending(&mut all, |a| a.chi2_penalised);
        let least = all[0].chi2_penalised;
        let likely = |one: &RivalReport| (0.5 * (least - one.chi2_penalised)).exp();
        let sum: f64 = all.iter().map(likely).sum();
        all.iter_mut().for_each(|one| one.probability = likely(one) / sum);
    }
    all
}

/// A law that no term has, with the effects that stay beside it.
pub(crate) fn with_law(traced: &Traced, law: &UnknownLaw) -> Vec<Place> {
    let kept = traced.found.iter().map(|found| found.instance);
    let kept = kept.filter(|i| !law.replaces.contains(i));
    let kept = kept.map(|i| Place::of(&traced.small, &i));
    kept.chain([no_term(&traced.small, UNKNOWN_LAW, law.whose.target)]).collect()
}

/// What no term has, as an effect.
fn no_term(observations: &Observations, id: &str, target: Target) -> Place {
    Place {
        term: id.into(),
        class: match target {
            Target::Channel(_) => Class::Sensor,
            Target::Closure(_) => Class::Closure,
            _ => Class::Geometry,
        },
        target: target.name(&observations.mechanism),
        place: None,
        label: target.label(&observations.mechanism),
    }
}

/// How long a wave is of an error that repeats along what has no turn, by its parameters; none of other effects.
fn wavelength(fit: &Fit, effect: &Instance, parameters: &[f64]) -> Option<f64> {
    let &Instance { target: Target::Channel(channel), term, place } = effect else { return None };
    if term.placed() != Placed::AtOrder || fit.model.mechanism.goes_round(channel) {
        return None;
    }
    let scale = &fit.model.scales[channel];
    let order = ORDER_STEP * place as f64 + parameters[2];
    Some((TAU * scale.gain / (order * scale.turn)).abs())
}

/// What is reported of an effect, but for the poses left out in turn.
fn step(
    (traced, rivals): (&Traced, &[RivalReport]),
    found: &Found,
    not_applied: Option<NotApplied>,
) -> StepReport {
    let observations = &traced.observations;
    let after = &traced.after;
    let info = found.instance.term.info();
    let (values, covariance) = reported(after);
    let own = traced.in_all(&found.instance);
    let first =
        after.model.instances.iter().position(|i| *i == own).map_or(0, |k| after.model.first[k]);
    let parameters = info.parameters.iter().enumerate().map(|(k, p)| {
        let (value, sd) = (values[first + k], covariance[(first + k, first + k)].max(0.0).sqrt());
        let sd = (!after.unknowable[first + k]).then_some(sd);
        let note = Note::of(info.id, value, sd).map(|note| note.to_string());
        let unit = unit(observations, &found.instance, p.unit);
        StepParameter { name: p.name.into(), value, sd, unit, note }
    });
    let curve = curve(after, &found.instance, first);
    let unknown = traced.unknown.iter().filter(|law| law.ties());
    let unknown = unknown.filter(|law| law.replaces.contains(&found.instance));
    let unknown = unknown.flat_map(UnknownLaw::targets);
    let unknown = unknown.map(|target| no_term(&traced.small, UNKNOWN_LAW, target));
    // What it does to the platform, or to what the chains carry: the search's fit with it against the
    // one without.
    let (small, without, last) = (&traced.small, &found.without, &traced.last);
    let of_points = || apart(small, without, last).map(PlatformRms::of_points);
    let platform_rms = platform_difference(small, without, last).or_else(of_points);
    let Place { term, class, target, place, label } = Place::of(observations, &own);
    let points = curve.as_ref().map_or(&[][..], |c| &c.points);
    let named = Place::of(&traced.small, &found.instance);
    let with = rivals.iter().filter(|rival| rival.terms.contains(&named));
    let probability = with.map(|rival| rival.probability).sum();
    let also = found.also.iter().map(|i| Place::of(&traced.small, i));
    let also_fits: Vec<Place> = also.chain(unknown).collect();
    let ties = !also_fits.is_empty();
    StepReport {
        term,
        class,
        target,
        place,
        label,
        wavelength: wavelength(after, &own, &values[first..]),
        applied: not_applied.is_none(),
        not_applied,
        probability: (!rivals.is_empty()).then_some(probability),
        p_value: found.p_value,
        chi2_rise: Some(found.rise),
        parameters: parameters.collect(),
        also_fits,
        needs_length: changes_scale(&observations.mechanism, &found.instance)
            || found
                .also
                .iter()
                .any(|other| differ_by_scale(&observations.mechanism, &found.instance, other)),
        needs_repeats: ties
            && std::iter::once(&found.instance).chain(&found.also).any(|i| {
                i.term.needs().contains(&Needs::Order) || i.term.placed() == Placed::AtPose
            }),
        platform_rms,
        held_out: None,
        curve_law: curve_law(&traced.small, &found.without, &traced.judge, &found.instance),
        curve_over: curve.as_ref().map(|c| c.over),
        curve_unit: curve.as_ref().map(|c| c.unit.clone()),
        curve_sd: points.iter().map(|p| p[2]).collect(),
        curve: points.iter().map(|p| [p[0], p[1]]).collect(),
    }
}

//! What a trace says, in the shape of the JSON.

use crate::Error;
use crate::apply::change::{PlatformRms, apart, platform_difference};
use crate::apply::check::CheckReadings;
use crate::diagnosis::curve::curve;
use crate::diagnosis::curve_law::{CurveLaw, curve_law};
use crate::diagnosis::detectability::{Detectability, could_hide};
use crate::diagnosis::elsewhere::{Elsewhere, NotApplied, elsewhere};
use crate::diagnosis::held_out::{HeldOut, held_out, held_out_rows};
use crate::diagnosis::localisation::{Residual, residual};
use crate::diagnosis::options::SearchOptions;
use crate::diagnosis::plausibility::{Absurdity, absurdities};
use crate::diagnosis::score::candidates::differ_by_scale;
use crate::diagnosis::score::scored;
use crate::diagnosis::search::rivals::{self, UNKNOWN_NOISE};
use crate::diagnosis::trace::{Explanation, Found, Traced, trace};
use crate::diagnosis::unknown_law::{DependsOn, UNKNOWN_LAW, UnknownLaw};
use crate::diagnosis::verdict::{self, Compared, Determined, Evidence, Judgement, Reason, Verdict};
use crate::estimate::directions::{directions, place, reported, unit};
use crate::estimate::progress::{Job, Progress, Stage};
use crate::estimate::{Fit, Implicit, Note, Observations, Part, fit, with_groups};
use crate::mechanism::{Mechanism, Target};
use crate::model::Instance;
#[cfg(feature = "serde")]
use crate::numerics::nullable;
use crate::report::beside::{Beside, GroupsReport};
use crate::report::result::{
    self, Estimates, ExcludedReport, FitReport, WithExcluded, estimates, excluded,
};
use crate::report::warned::{self, Warned};
use crate::report::words;
use crate::terms::term::{Class, Over};

/// A term at its target.
#[derive(Debug, Clone, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename = "Name"))]
#[cfg_attr(feature = "document", derive(schemars::JsonSchema))]
pub struct Place {
    /// Id of the term.
    pub term: String,
    /// Where the fault lies.
    pub class: Class,
    /// What the term belongs to.
    pub target: String,
    /// Where a searched term acts.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub place: Option<String>,
    /// What people call the target.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub label: Option<String>,
}

impl Place {
    /// Name of an instance, as results have it.
    #[must_use]
    pub fn of(observations: &Observations, instance: &Instance) -> Self {
        let info = instance.term.info();
        Self {
            term: info.id.into(),
            class: info.class,
            target: instance.target.name(&observations.mechanism),
            place: place(observations, instance),
            label: instance.target.label(&observations.mechanism),
        }
    }
}

/// A parameter of a term that was found missing.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "document", derive(schemars::JsonSchema))]
pub struct StepParameter {
    /// Name of the parameter.
    pub name: String,
    /// The estimate.
    #[cfg_attr(feature = "serde", serde(default = "nullable::unknown", with = "nullable"))]
    #[cfg_attr(feature = "document", schemars(!default, with = "Option<f64>"))]
    pub value: f64,
    /// Standard deviation.
    pub sd: Option<f64>,
    /// Unit of both.
    pub unit: String,
    /// As in `Parameter`.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub note: Option<String>,
}

/// Effects of results of earlier versions are all applied.
#[cfg(feature = "serde")]
fn yes() -> bool {
    true
}

/// A missing term that was found.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename = "Step"))]
#[cfg_attr(feature = "document", derive(schemars::JsonSchema))]
pub struct StepReport {
    /// Id of the term.
    pub term: String,
    /// Where the fault lies.
    pub class: Class,
    /// What the term belongs to.
    pub target: String,
    /// Probability by chance, corrected for the places looked at.
    #[cfg_attr(feature = "serde", serde(default = "nullable::unknown", with = "nullable"))]
    #[cfg_attr(feature = "document", schemars(!default, with = "Option<f64>"))]
    pub p_value: f64,
    /// False where the effect is named, and no part of `parameters`.
    #[cfg_attr(feature = "serde", serde(default = "yes"))]
    pub applied: bool,
    /// Why it is not applied.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub not_applied: Option<NotApplied>,
    /// Probability of the explanations with this effect among `rivals`; null where there are none.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub probability: Option<f64>,
    /// By how much χ² would rise without the term.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub chi2_rise: Option<f64>,
    /// Estimates.
    #[cfg_attr(feature = "serde", serde(default))]
    pub parameters: Vec<StepParameter>,
    /// Where a searched term acts.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub place: Option<String>,
    /// What people call the target.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub label: Option<String>,
    /// Terms that these poses cannot tell from this one.
    #[cfg_attr(feature = "serde", serde(default))]
    pub also_fits: Vec<Place>,
    /// True where one of these differs from this term by the size of the whole: a length that is known would tell
    /// them apart, no pose does.
    #[cfg_attr(feature = "serde", serde(default))]
    pub needs_length: bool,
    /// What the term did to the platform pose, the other parameters having absorbed what they can.
    #[cfg_attr(feature = "serde", serde(default))]
    pub platform_rms: Option<PlatformRms>,
    /// Rows of reading and correction, in `curve_unit`; see `curve_over`.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Vec::is_empty"))]
    pub curve: Vec<[f64; 2]>,
    /// Standard deviation of each correction.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Vec::is_empty"))]
    pub curve_sd: Vec<f64>,
    /// `reading`, or `time`: rows are then time, 0 to 1 over the session, and correction.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub curve_over: Option<Over>,
    /// Unit of the corrections: `rad`, the unit of length for a joint that slides, or `1` for a
    /// fraction of all readings.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub curve_unit: Option<String>,
    /// The closed form behind a free curve, for the readings or times that occur.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub curve_law: Option<CurveLaw>,
    /// Error on poses left out, with this effect and those before.
    #[cfg_attr(feature = "serde", serde(default))]
    pub held_out: Option<HeldOut>,
}

/// Effects that explain a session together, nearly as well as the best do.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(rename = "Rival")
)]
#[cfg_attr(feature = "document", derive(schemars::JsonSchema))]
pub struct RivalReport {
    /// The effects: `unknown_law` is a law that no term has, `unknown_noise` errors that follow none.
    pub terms: Vec<Place>,
    /// Price of the explanation: χ² by the noise that may be, with what its effects, their places and wrong
    /// readings cost.
    pub chi2_penalised: f64,
    /// Probability among the explanations that are listed.
    pub probability: f64,
}

/// What is left when nothing scores any more.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "document", derive(schemars::JsonSchema))]
pub struct Unexplained {
    /// Probability of the residual by chance.
    pub p_value: Option<f64>,
    /// Where the structure is.
    pub target: Option<String>,
    /// What is left, in words.
    pub text: String,
    /// What it is; null in results of earlier versions.
    #[cfg_attr(feature = "serde", serde(default))]
    pub kind: Option<Left>,
    /// What the likeliest law that no term has depends on, where it ties with what was found, or
    /// something is left.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Vec::is_empty"))]
    pub depends_on: Vec<DependsOn>,
    /// Other targets of which such a law fits as well, the likeliest first.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Vec::is_empty"))]
    pub also_of: Vec<String>,
    /// A formula that fits as well as that law, within 6 in price.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub law: Option<FoundLaw>,
}

/// A formula for the errors of a channel, a link or a closure, which no term has.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "document", derive(schemars::JsonSchema))]
pub struct FoundLaw {
    /// The channel, the row of a chain or the closure.
    pub target: String,
    /// The correction of its coordinate or value, or by how much its frame moves, as a mechanism file
    /// writes it.
    pub formula: String,
    /// Its parameters.
    pub parameters: Vec<FormulaParameter>,
    /// Its probability among all formulas that were weighed and the smooth function.
    pub probability: f64,
    /// Lines for the mechanism file that make it a term.
    pub term: String,
}

/// A parameter of a formula.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "document", derive(schemars::JsonSchema))]
pub struct FormulaParameter {
    /// Its name in the formula.
    pub name: String,
    /// The estimate, to first order.
    pub value: f64,
    /// Standard deviation.
    pub sd: f64,
}

impl FoundLaw {
    fn of(mechanism: &Mechanism, law: &UnknownLaw) -> Option<Self> {
        let written = law.written.as_ref()?;
        let parameters = written.law.parameters.keys().zip(&written.values);
        Some(Self {
            target: law.whose.target.name(mechanism),
            formula: written.law.text().1.to_owned(),
            parameters: parameters
                .map(|(name, [value, sd])| FormulaParameter {
                    name: name.clone(),
                    value: *value,
                    sd: *sd,
                })
                .collect(),
            probability: written.probability,
            term: words::as_term(&written.law),
        })
    }
}

/// What is left after a trace.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "document", derive(schemars::JsonSchema))]
#[cfg_attr(feature = "serde", serde(rename_all = "snake_case"))]
#[non_exhaustive]
pub enum Left {
    /// No more than noise.
    Noise,
    /// Nothing but the fit gives the noise: it cannot be judged.
    Unjudged,
    /// No more than noise, but what was found may stand for another effect.
    Doubtful,
    /// Errors of the target alone, by a law that no term has.
    OneTarget,
    /// The noise is larger than it was declared.
    DeclaredNoise,
    /// More than noise, of several.
    Structure,
    /// A kind of a later version.
    #[cfg_attr(feature = "serde", serde(other))]
    Other,
}

impl Left {
    fn of(residual: &Residual) -> Self {
        match residual {
            Residual::Noise { .. } => Self::Noise,
            Residual::Unjudged { .. } => Self::Unjudged,
            Residual::Doubtful(_) | Residual::UnknownLaw(_) => Self::Doubtful,
            Residual::Isolated { .. } | Residual::Follows(_) => Self::OneTarget,
            Residual::Louder { .. } => Self::DeclaredNoise,
            Residual::Structure(_) => Self::Structure,
        }
    }
}

/// The result of a trace.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct TraceReport {
    /// The verdict.
    pub verdict: Verdict,
    /// Why it is not better; the first says most.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Vec::is_empty"))]
    pub reasons: Vec<Reason>,
    /// What is absurd beside the size of the mechanism.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Vec::is_empty"))]
    pub implausible: Vec<Warned>,
    /// Suspicious things.
    pub warnings: Vec<Warned>,
    /// Readings left out.
    pub excluded: Vec<ExcludedReport>,
    /// The fit as asked for with them.
    pub with_excluded: Option<WithExcluded>,
    /// The fit as asked for.
    pub before: FitReport,
    /// Effects found.
    pub steps: Vec<StepReport>,
    /// What the effects do to predictions elsewhere.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
    pub elsewhere: Option<Elsewhere>,
    /// Explanations that are nearly as good as the best, itself included; the best first.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Vec::is_empty"))]
    pub rivals: Vec<RivalReport>,
    /// The fit with them.
    pub after: FitReport,
    /// The known poses with the mechanism as it is declared.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
    pub nominal: Option<FitReport>,
    /// How well points that are touched are repeated.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
    pub groups: Option<GroupsReport>,
    /// What is left.
    pub unexplained: Unexplained,
    /// What could be there unseen, worst first.
    pub could_hide: Vec<Detectability>,
    /// Readings in the known poses, where something is left.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
    pub check_readings: Option<CheckReadings>,
    /// Noise, parameters, covariance and the rest, of the fit after.
    #[cfg_attr(feature = "serde", serde(flatten))]
    pub estimates: Estimates,
    /// Residual of each pose in units of its noise, pose by pose, equation by equation, before.
    #[cfg_attr(feature = "serde", serde(skip))]
    pub before_residuals: Vec<f64>,
    /// The same after.
    #[cfg_attr(feature = "serde", serde(skip))]
    pub after_residuals: Vec<f64>,
}

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
    let small_before =
        fit(&traced.small, traced.before.model.instances.clone(), Some(&traced.last))?;
    let rises: Vec<f64> = traced.found.iter().map(|found| found.rise).collect();
    let residual = residual(&traced, &rises);
    let held_out = held_out_with(&traced, &small_before)?;
    let held_out_before = left_out(&traced, &small_before, &traced.before);
    let held = held_out_before.zip(held_out.last().copied().flatten());
    let held = held.map(|(before, after)| compared(&traced, &before, &after));
    let (elsewhere, not_applied) = elsewhere(&traced, search, &residual).unzip();
    let worse = held.is_some_and(|held| held.worse());
    let not_applied = not_applied.unwrap_or_else(|| in_one_session(&traced, search, worse));
    let applies: Vec<bool> = not_applied.iter().map(Option::is_none).collect();
    let applied = applied(&traced, &applies)?;
    let mut before = FitReport::of(&traced.before);
    let mut after = FitReport::of(&traced.after);
    if let Some(known) = beside.and_then(|beside| beside.known.as_ref()) {
        known.judge(observations, &traced.before, &mut before)?;
        known.judge(&traced.observations, &applied, &mut after)?;
    }
    before.held_out = held_out_before;
    let rivals = rivals_of(&traced);
    let steps = traced.found.iter().zip(&not_applied).zip(&held_out);
    let steps: Vec<StepReport> = steps
        .map(|((found, not_applied), held_out)| StepReport {
            held_out: *held_out,
            ..step((&traced, &rivals), found, *not_applied)
        })
        .collect();
    after.held_out = match held_out.last() {
        Some(last) => *last,
        None if traced.last.model.instances == small_before.model.instances => before.held_out,
        None => left_out(&traced, &traced.last, &traced.after),
    };
    let found: Vec<Instance> = traced.found.iter().map(|f| f.instance).collect();
    // What is not applied is no part of what is used.
    let used = found.iter().zip(&applies).filter(|(_, applies)| **applies).map(|(i, _)| *i);
    let absurd = absurdities(&traced.observations, &applied, &used.collect::<Vec<_>>());
    let directions = directions(&traced.observations, &traced.after);
    let p_value = traced.p_value;
    let nominal = beside.map(Beside::nominal).transpose()?.flatten();
    let groups = beside
        .map(|beside| {
            let all = (observations, &traced.before);
            beside.groups((&traced.observations, &applied), Some(all))
        })
        .transpose()?
        .flatten();
    let own = match applies.iter().all(|applies| *applies) {
        true => None,
        false => Some(self::directions(&traced.observations, &applied)),
    };
    let mut estimates =
        estimates(&traced.observations, &applied, own.as_ref().unwrap_or(&directions));
    let sd = estimates.predicted.as_ref().map(|predicted| predicted.position_sd);
    let another = sd.and_then(|sd| Some((rivals::elsewhere(&traced.rivals, sd)?, sd)));
    let determined = directions.beside(&traced.observations, &found);
    let determined = Determined::of(&traced.after, &determined);
    let last = (&traced.observations, &applied);
    let open_loops = Beside::open_loops(beside, determined, last, &estimates, after.checked())?;
    let [groups_declared, groups_before] =
        groups.as_ref().map(GroupsReport::compared).unwrap_or_default();
    let Judgement { verdict, reasons } = verdict::judge(&Evidence {
        determined,
        absurd: !absurd.is_empty(),
        open: absurd.iter().any(Absurdity::is_of_readings),
        p_value,
        chi2_per_dof: after.chi2_per_dof(),
        loose: traced.after.is_loose(),
        found: !traced.found.is_empty(),
        doubtful: matches!(residual, Residual::Doubtful(_) | Residual::UnknownLaw(_)),
        held_out: after.held_out,
        held_out_before: held,
        predicted: estimates.beforehand(),
        contradicted: traced.after.contradicts_knowledge(),
        open_loops,
        check: after.checked(),
        check_declared: nominal.as_ref().and_then(|nominal| after.beside(nominal)),
        check_before: after.beside(&before),
        groups: groups.as_ref().and_then(GroupsReport::expected),
        groups_declared,
        groups_before,
    });
    estimates.say_what_is_left(&traced.observations, &traced.after);
    let with_excluded = (!traced.excluded.is_empty()).then(|| WithExcluded {
        fit: before.clone(),
        parameters: result::parameters(observations, &traced.before),
    });
    let (target, text) = words::residual(&observations.mechanism, &residual);
    let target = match (&residual, &traced.isolated) {
        (Residual::Doubtful(_), Some(isolated)) => {
            Some(isolated.target.name(&observations.mechanism))
        }
        _ => target,
    };
    let other = |((rival, apart), sd)| words::another(&traced.small.mechanism, rival, apart, sd);
    let unknown = traced.unknown.as_ref().filter(|law| law.ties());
    let law = unknown.map(|law| words::unknown_law(&traced.small.mechanism, law));
    let sound = matches!(verdict, Verdict::Adequate | Verdict::Unjudged);
    let something = !traced.found.is_empty() || !sound;
    let untried = words::not_looked_for(&observations.readings).filter(|_| something);
    let said = another.map(other).into_iter().chain([text]).chain(law).chain(untried);
    let said: Vec<String> = said.collect();
    let text = words::sentences(&said);
    progress.enter(Stage::Detectability);
    let hidden = could_hide(&traced, search)?;
    // By known poses a result that leaves something says how large its errors are.
    let leaves = matches!(verdict, Verdict::PartlyExplained | Verdict::Unexplained);
    let known = beside.and_then(|beside| beside.known.as_ref()).filter(|_| leaves);
    let report = TraceReport {
        verdict,
        reasons,
        implausible: warned::implausible(&traced.observations, &absurd),
        warnings: warned::warnings(observations, &traced.before, &traced.after)
            .into_iter()
            .chain(warned::as_drawn(&traced))
            .chain(warned::unread(&traced))
            .chain(warned::known_poses(observations, after.aligned.or(after.check)))
            .chain(open_loops.map(|open| warned::open_loops(&observations.mechanism, &open)))
            .collect(),
        excluded: traced.excluded.iter().map(|e| excluded(&traced.observations, e)).collect(),
        with_excluded,
        before,
        steps,
        elsewhere,
        rivals,
        after,
        nominal,
        groups,
        unexplained: Unexplained {
            p_value,
            target,
            text,
            kind: Some(Left::of(&residual)),
            depends_on: unknown.map(|law| law.depends_on.clone()).unwrap_or_default(),
            also_of: unknown
                .into_iter()
                .flat_map(|law| law.targets().split_off(1))
                .map(|target| target.name(&observations.mechanism))
                .collect(),
            law: unknown.and_then(|law| FoundLaw::of(&observations.mechanism, law)),
        },
        could_hide: hidden,
        check_readings: known.map(|known| CheckReadings::of(&observations.mechanism, known)),
        estimates,
        before_residuals: match &traced.stretches {
            Some(_) => by_pose(&traced.observations, &traced.before),
            None => by_pose(&traced.small, &small_before),
        },
        after_residuals: by_pose(traced.answer().0, traced.answer().1),
    };
    // Whoever listened has been told that the job is done.
    for session in [&mut traced.observations, &mut traced.small] {
        session.options.progress = Progress::default();
    }
    Ok((report, traced))
}

/// Which effects are not applied of one session that has no blocks: those of which a law takes the place, and all where
/// poses left out in turn are worse with them.
fn in_one_session(traced: &Traced, search: &SearchOptions, worse: bool) -> Vec<Option<NotApplied>> {
    let why = |found: &Found| match traced.undone(found) {
        _ if search.apply_all => None,
        true => Some(NotApplied::Law),
        false => worse.then_some(NotApplied::NoHelp),
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
    Compared { found: after.chi2_per_dof, other: before.chi2_per_dof, errors }
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
        all.sort_by(|a, b| a.chi2_penalised.total_cmp(&b.chi2_penalised));
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
    StepReport {
        term,
        class,
        target,
        place,
        label,
        applied: not_applied.is_none(),
        not_applied,
        probability: (!rivals.is_empty()).then_some(probability),
        p_value: found.p_value.min(1.0),
        chi2_rise: Some(found.rise),
        parameters: parameters.collect(),
        also_fits: found.also.iter().map(|i| Place::of(&traced.small, i)).chain(unknown).collect(),
        needs_length: found
            .also
            .iter()
            .any(|other| differ_by_scale(&observations.mechanism, &found.instance, other)),
        platform_rms,
        held_out: None,
        curve_law: curve_law(&traced.small, &found.without, &traced.judge, &found.instance),
        curve_over: curve.as_ref().map(|c| c.over),
        curve_unit: curve.as_ref().map(|c| c.unit.clone()),
        curve_sd: points.iter().map(|p| p[2]).collect(),
        curve: points.iter().map(|p| [p[0], p[1]]).collect(),
    }
}

/// Whitened residuals pose by pose, in the order of the poses, equation by equation. What was left
/// out has the residual that it would have with the weight of the others.
pub(crate) fn by_pose(observations: &Observations, fit: &Fit) -> Vec<f64> {
    let k = fit.residuals.equations;
    let out = |row: &usize| observations.weights[*row] <= 0.0;
    let readings = &observations.readings;
    let mut first = vec![usize::MAX; readings.poses()];
    for (row, &pose) in readings.pose.iter().enumerate() {
        first[pose] = first[pose].min(row);
    }
    let part = Part { model: &fit.model, readings, weights: None };
    let all = first.iter().any(out).then(|| {
        Implicit::of(part, fit.assumed()).residuals_keeping(&fit.beta, false, Some(&[])).whitened
    });
    let of = |row: &usize| match &all {
        Some(all) if out(row) => &all[row * k..(row + 1) * k],
        _ => &fit.residuals.whitened[row * k..(row + 1) * k],
    };
    let mut found = Vec::with_capacity(k * first.len());
    first.iter().for_each(|row| found.extend_from_slice(of(row)));
    found
}

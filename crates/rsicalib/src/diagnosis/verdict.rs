//! The verdict: one function that is given everything that a verdict rests on, and that nothing
//! after it changes.

use crate::apply::accuracy::KNOWN;
use crate::apply::check::Check;
use crate::diagnosis::held_out::HeldOut;
use crate::diagnosis::options::LEVEL;
use crate::estimate::Fit;
use crate::estimate::directions::Directions;
use crate::monitor::closing::OpenLoops;
use crate::numerics::distributions::chi2_quantile;

/// What is said of a calibration, in one word.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "document", derive(schemars::JsonSchema))]
#[cfg_attr(feature = "serde", serde(rename_all = "snake_case"))]
pub enum Verdict {
    /// Nothing is missing: what is left is noise.
    Adequate,
    /// Something was missing and is found: what is left is noise.
    Explained,
    /// Something was missing and is found, and something is left or in doubt.
    PartlyExplained,
    /// Something is left that nothing explains.
    Unexplained,
    /// The data cannot determine what was asked.
    Undetermined,
    /// A calibration, and nothing to judge it by.
    Unjudged,
    /// A calibration that is absurd beside the size of the mechanism.
    Implausible,
}

impl Verdict {
    /// Every verdict.
    pub const ALL: [Self; 7] = [
        Self::Adequate,
        Self::Explained,
        Self::PartlyExplained,
        Self::Unexplained,
        Self::Undetermined,
        Self::Unjudged,
        Self::Implausible,
    ];

    /// What scripts call the verdict.
    #[must_use]
    pub fn id(self) -> &'static str {
        match self {
            Self::Adequate => "adequate",
            Self::Explained => "explained",
            Self::PartlyExplained => "partly_explained",
            Self::Unexplained => "unexplained",
            Self::Undetermined => "undetermined",
            Self::Unjudged => "unjudged",
            Self::Implausible => "implausible",
        }
    }

    /// What the command exits with: 0 usable, 3 undetermined, 4 a residual is left or absurd.
    #[must_use]
    pub fn exit_code(self) -> u8 {
        match self {
            Self::Adequate | Self::Explained | Self::Unjudged => 0,
            Self::Undetermined => 3,
            Self::PartlyExplained | Self::Unexplained | Self::Implausible => 4,
        }
    }
}

/// Whether data determine what a fit was asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Determined {
    /// They do.
    Yes,
    /// No calculation could begin, or there is none.
    #[default]
    Nothing,
    /// An unknown frame was not found: whatever is left says nothing of the device.
    Lost,
    /// The solver did not end at a minimum in which every joint moves.
    NotConverged,
    /// No start led to a fit in which every joint moves: that loops close where it ended is no
    /// evidence, unless known poses tell more.
    NoStart,
    /// Nothing is left to check the parameters with.
    NothingLeft,
    /// Directions are left that other poses could tell.
    Unobservable,
}

impl Determined {
    /// Of a fit, whose data cannot tell these directions.
    #[must_use]
    pub fn of(fit: &Fit, directions: &Directions) -> Self {
        match () {
            () if fit.is_lost() => Self::Lost,
            // Along an open direction iterations run out: the direction is the reason.
            () if !directions.unobservable.is_empty() && fit.dof >= 1.0 => Self::Unobservable,
            () if !fit.converged() => Self::NotConverged,
            () if !fit.has_start() && !fit.p_value.is_some_and(|p| p <= LEVEL) => Self::NoStart,
            () if fit.dof < 1.0 => Self::NothingLeft,
            () => Self::Yes,
        }
    }
}

/// How far off something is under a calibration, and under another one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Compared {
    /// Under the calibration.
    pub found: f64,
    /// Under the other one.
    pub other: f64,
    /// So many times as much as under the other one may be chance.
    pub chance: f64,
}

impl Compared {
    /// Means or root mean squares of so many errors: chance are two relative standard deviations of such a root.
    #[must_use]
    pub fn of_errors(found: f64, other: f64, errors: f64) -> Self {
        Self { found, other, chance: 1.0 + 2.0 / (2.0 * errors.max(1.0)).sqrt() }
    }

    /// Positions of known poses under a calibration and under another: χ² of (110), were the first predicted to
    /// be off by as much as the other is. All of these errors share those of the parameters, so that they
    /// are as many as its degrees of freedom; noise of the known poses is in both.
    #[must_use]
    pub fn of(found: &Check, other: &Check) -> Self {
        let all = 3.0 * found.poses as f64;
        let errors =
            found.predicted.map_or(all, |predicted| predicted.dof.clamp(1.0, all.max(1.0)));
        let chance = (chi2_quantile(KNOWN, errors) / errors).sqrt();
        Self { found: found.position_rms, other: other.position_rms, chance }
    }

    /// True where the first is off by more than chance makes it.
    #[must_use]
    pub fn worse(&self) -> bool {
        self.found > self.other * WORSE.max(self.chance)
    }
}

/// So many times what was left before may be left on poses that a fit has not seen: the same noise is in both.
/// What is applied is promised to be no worse there than by this.
pub const WORSE: f64 = 1.05;

/// What a verdict rests on.
#[derive(Debug, Clone, Copy, Default)]
pub struct Evidence {
    /// Whether the data determine what was asked.
    pub determined: Determined,
    /// True where something is absurd beside the size of the mechanism.
    pub absurd: bool,
    /// True where that is how far loops stay open, or the noise: whatever else these readings determine,
    /// they are not of this mechanism.
    pub open: bool,
    /// Probability of the residual by chance; none where nothing judges it.
    pub p_value: Option<f64>,
    /// χ² of the residual per degree of freedom.
    pub chi2_per_dof: Option<f64>,
    /// True where the loop closes with a mistake undone, and by far not as declared, or where what is found is shaped as
    /// drawn with two names exchanged, and by far not as declared.
    pub mistaken: bool,
    /// True where nothing like the noise that judges it is there.
    pub loose: bool,
    /// True where effects were found.
    pub found: bool,
    /// True where the effects found may stand for another, or, where there are none, a law that no term
    /// has is likelier than chance.
    pub doubtful: bool,
    /// Error on poses left out in turn.
    pub held_out: Option<HeldOut>,
    /// The same, beside the error without the effects found.
    pub held_out_before: Option<Compared>,
    /// Predicted error at the poses of the session, beside that of the parameters as they are known
    /// without readings.
    pub predicted: Option<[f64; 2]>,
    /// True where the readings contradict what is declared as known without them.
    pub contradicted: bool,
    /// Loops of the known poses that do not close as those of the session do.
    pub open_loops: Option<OpenLoops>,
    /// Error on known poses.
    pub check: Option<Check>,
    /// The same, beside the mechanism as it is declared.
    pub check_declared: Option<Compared>,
    /// The same, beside the fit without the effects found.
    pub check_before: Option<Compared>,
    /// Error on groups that were not fitted, beside that on the fitted ones and what the parameters add.
    pub groups: Option<Compared>,
    /// The same, beside the mechanism as it is declared.
    pub groups_declared: Option<Compared>,
    /// The same, beside the fit without the effects found.
    pub groups_before: Option<Compared>,
}

impl Evidence {
    /// True where positions are predicted to err by no less than before there were readings, by a noise and by
    /// knowledge that these bear out.
    fn tells_nothing(&self) -> bool {
        let no_less = self.predicted.is_some_and(|[sd, before]| sd >= before);
        no_less && !self.loose && !self.contradicted
    }
}

/// A reason of a verdict that is not good.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "document", derive(schemars::JsonSchema))]
#[cfg_attr(feature = "serde", serde(rename_all = "snake_case"))]
pub enum Why {
    /// No calculation could begin.
    Nothing,
    /// The solver did not end at a minimum in which every joint moves.
    NotConverged,
    /// Nothing is left to check the parameters with.
    NothingLeft,
    /// Directions are left that other poses could tell.
    Unobservable,
    /// Positions are predicted to err by no less than before there were readings.
    Predicted,
    /// Something is absurd beside the size of the mechanism.
    Absurd,
    /// The loop closes with a mistake of wires, columns or units undone, and by far not as declared: no effect was looked for.
    Mistake,
    /// More is left than chance leaves.
    Residual,
    /// The effects found may stand for another that no term has.
    Doubtful,
    /// No more is left than chance leaves, but a law that no term has is likelier than chance.
    UnknownLaw,
    /// Loops of the known poses do not close as those of the session do.
    OpenLoops,
    /// Known poses are off by more than the calibration predicts.
    Check,
    /// Known orientations are off by more than the calibration predicts, and positions are not.
    CheckOrientation,
    /// One of the known poses is off by more than the calibration predicts of it.
    CheckPose,
    /// One of the known orientations is, and its position is off by less of what is predicted.
    CheckPoseOrientation,
    /// Known poses are off by more than with the mechanism as it is declared.
    CheckDeclared,
    /// Positions are predicted to err by no less than before there were readings, and known poses are off by
    /// no less than with the mechanism as it is declared.
    PredictedDeclared,
    /// Known poses are off by more than without the effects found.
    CheckBefore,
    /// Poses left out in turn are off by more than the fit predicts.
    HeldOut,
    /// Poses left out in turn are off by more than without the effects found.
    HeldOutBefore,
    /// Groups that were not fitted are off by more than the fitted ones and the parameters let expect.
    Groups,
    /// Groups that were not fitted are off by more than with the mechanism as it is declared.
    GroupsDeclared,
    /// Groups that were not fitted are off by more than without the effects found.
    GroupsBefore,
}

/// A reason of a verdict, with its numbers.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "document", derive(schemars::JsonSchema))]
pub struct Reason {
    /// What it is.
    pub kind: Why,
    /// What was found: an error, or χ² per degree of freedom.
    #[cfg_attr(feature = "serde", serde(default))]
    pub found: Option<f64>,
    /// What was expected in its place.
    #[cfg_attr(feature = "serde", serde(default))]
    pub expected: Option<f64>,
    /// Probability of more by chance.
    #[cfg_attr(feature = "serde", serde(default))]
    pub p_value: Option<f64>,
    /// Label of the known pose that is off alone.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub pose: Option<i64>,
}

impl Reason {
    fn of(kind: Why) -> Self {
        Self { kind, found: None, expected: None, p_value: None, pose: None }
    }

    fn worse(kind: Why, compared: Option<Compared>) -> Option<Self> {
        let Compared { found, other, .. } = compared.filter(Compared::worse)?;
        Some(Self { found: Some(found), expected: Some(other), ..Self::of(kind) })
    }

    fn beyond(
        kind: Why,
        level: f64,
        [found, expected]: [f64; 2],
        p_value: Option<f64>,
    ) -> Option<Self> {
        let p_value = p_value.filter(|p| *p <= level)?;
        let (found, expected) = (Some(found), Some(expected));
        Some(Self { found, expected, p_value: Some(p_value), ..Self::of(kind) })
    }
}

/// A verdict with its reasons, the first of which says most; none where all is well.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Judgement {
    /// The verdict.
    pub verdict: Verdict,
    /// Why it is not better.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Vec::is_empty"))]
    pub reasons: Vec<Reason>,
}

/// The verdict on a calibration or a trace, by everything that is known of it.
///
/// Loops that stay open come first, then what is undetermined, then effects that are absurd. Readings that
/// tell no more of where things are than the drawing does determine nothing, unless known poses tell more. What known poses, groups that were not fitted and
/// poses left out in turn contradict is not adequate, nor explained, whatever the residual is;
/// without a contradiction what nothing judges is unjudged. So is what a noise judges that is many times too
/// large, and what it predicts says nothing.
#[must_use]
pub fn judge(evidence: &Evidence) -> Judgement {
    let mistake = || evidence.mistaken.then(|| Reason::of(Why::Mistake));
    let one = |verdict, kind| {
        let reasons = std::iter::once(Reason::of(kind)).chain(mistake()).collect();
        Judgement { verdict, reasons }
    };
    match evidence.determined {
        Determined::Nothing => return one(Verdict::Undetermined, Why::Nothing),
        Determined::Lost => return one(Verdict::Undetermined, Why::NotConverged),
        _ if evidence.open => return one(Verdict::Implausible, Why::Absurd),
        Determined::Yes if evidence.absurd => return one(Verdict::Implausible, Why::Absurd),
        Determined::NoStart if against(evidence).is_empty() => {
            return one(Verdict::Undetermined, Why::NotConverged);
        }
        Determined::Yes | Determined::NoStart => {}
        Determined::NotConverged => return one(Verdict::Undetermined, Why::NotConverged),
        Determined::NothingLeft => return one(Verdict::Undetermined, Why::NothingLeft),
        Determined::Unobservable => return one(Verdict::Undetermined, Why::Unobservable),
    }
    let mut reasons = against(evidence);
    reasons.splice(0..0, mistake());
    // What known poses show comes before what is predicted; so does what is left. Nothing is measured against knowledge
    // that the readings contradict.
    if let Some([found, expected]) = evidence.predicted.filter(|_| evidence.tells_nothing())
        && evidence.check.is_none()
        && reasons.is_empty()
    {
        let (found, expected) = (Some(found), Some(expected));
        let reason = Reason { found, expected, ..Reason::of(Why::Predicted) };
        return Judgement { verdict: Verdict::Undetermined, reasons: vec![reason] };
    }
    let judged = evidence.p_value.filter(|_| !evidence.loose);
    let verdict = match (reasons.is_empty(), evidence.found, judged) {
        (true, _, None) => Verdict::Unjudged,
        (true, false, _) => Verdict::Adequate,
        (true, true, _) => Verdict::Explained,
        (false, true, _) => Verdict::PartlyExplained,
        (false, false, _) => Verdict::Unexplained,
    };
    Judgement { verdict, reasons }
}

/// The verdict on lines through so many known poses, eq. (13), by the error of known ones that were
/// not used, that of the mechanism as it is declared, and how their loops close.
#[must_use]
pub fn open_loop(
    poses: usize,
    check: Option<Check>,
    nominal: Option<Check>,
    open_loops: Option<OpenLoops>,
) -> Judgement {
    judge(&Evidence {
        determined: match poses {
            0 => Determined::Nothing,
            // Two poses give each line, and a third one its scatter.
            1..=2 => Determined::NothingLeft,
            _ => Determined::Yes,
        },
        check,
        open_loops,
        check_declared: check.zip(nominal).map(|(check, nominal)| Compared::of(&check, &nominal)),
        ..Evidence::default()
    })
}

/// What speaks against a calibration that is determined.
fn against(evidence: &Evidence) -> Vec<Reason> {
    let found = |compared: Option<Compared>| compared.filter(|_| evidence.found);
    let check = evidence.check.and_then(|check| {
        let predicted = check.predicted?;
        let positions = [check.position_rms, predicted.position_sd];
        let turns = check.orientation_rms.zip(predicted.orientation_sd).map(<[f64; 2]>::from);
        let [found, other] = positions;
        let off = Compared::of_errors(found, other, 3.0 * check.poses as f64).worse();
        let (kind, numbers) = match turns {
            Some(turns) if !off => (Why::CheckOrientation, turns),
            _ => (Why::Check, positions),
        };
        Reason::beyond(kind, KNOWN, numbers, Some(predicted.p_value))
    });
    let predicted = evidence.check.and_then(|check| check.predicted);
    // All of them are off where one is off by enough: then that one is said.
    let alone = predicted.and_then(|it| it.alone());
    let check = check.filter(|_| alone.is_none());
    let of_one = predicted.and_then(|it| it.worst).and_then(|worst| {
        let (numbers, turned) = worst.numbers();
        let kind = if turned { Why::CheckPoseOrientation } else { Why::CheckPose };
        let reason = Reason::beyond(kind, KNOWN, numbers, Some(worst.p_value))?;
        Some(Reason { pose: worst.pose, ..reason })
    });
    // Known poses that happen to be no worse vouch for no others where readings tell no more than the drawing does.
    let known = evidence.check_declared.filter(|it| it.found >= it.other);
    let predicted_declared = known.filter(|_| evidence.tells_nothing()).and_then(|it| {
        let (found, expected) = (Some(predicted?.position_sd), Some(it.other));
        Some(Reason { found, expected, ..Reason::of(Why::PredictedDeclared) })
    });
    // Known poses all share the errors of the parameters: what is off by no more than these predict
    // says nothing of an effect.
    // What is off by more than that is no longer off by chance of the parameters.
    let check_before = found(evidence.check_before).filter(|_| check.is_some());
    let check_before = check_before
        .zip(evidence.check)
        .map(|(it, known)| Compared::of_errors(it.found, it.other, 3.0 * known.poses as f64));
    let held_out = evidence.held_out.and_then(|it| {
        let numbers = [it.chi2_per_dof, evidence.chi2_per_dof?];
        Reason::beyond(Why::HeldOut, LEVEL, numbers, it.p_value)
    });
    let residual = evidence.p_value.filter(|p| *p <= LEVEL);
    let residual = residual.map(|p| Reason { p_value: Some(p), ..Reason::of(Why::Residual) });
    let doubtful = if evidence.found { Why::Doubtful } else { Why::UnknownLaw };
    let declared = Reason::worse(Why::CheckDeclared, evidence.check_declared);
    let open_loops = evidence.open_loops.map(|OpenLoops { rms_misclosure, own, p_value }| Reason {
        found: Some(rms_misclosure),
        expected: own,
        p_value: Some(p_value),
        ..Reason::of(Why::OpenLoops)
    });
    [
        open_loops,
        declared.or(predicted_declared),
        check.or(of_one),
        Reason::worse(Why::CheckBefore, check_before),
        Reason::worse(Why::GroupsDeclared, evidence.groups_declared),
        Reason::worse(Why::GroupsBefore, found(evidence.groups_before)),
        Reason::worse(Why::Groups, evidence.groups),
        residual,
        held_out,
        Reason::worse(Why::HeldOutBefore, found(evidence.held_out_before)),
        evidence.doubtful.then(|| Reason::of(doubtful)),
    ]
    .into_iter()
    .flatten()
    .collect()
}

/// Standard deviations by which something must have changed for an update.
const SURE: f64 = 3.0;

/// True where a new calibration is worth more than an earlier one: something has changed for sure,
/// by `changes` and their standard deviations, and the loops close better under it, poses left out
/// in turn.
#[must_use]
pub fn worth_an_update(
    mut changes: impl Iterator<Item = (f64, f64)>,
    rms_before: f64,
    rms_after: Option<f64>,
) -> bool {
    let sure = changes.any(|(by, sd)| by.abs() >= SURE * sd);
    sure && rms_after.is_some_and(|after| after < rms_before)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::apply::accuracy::Expected;

    fn clean() -> Evidence {
        let determined = Determined::Yes;
        Evidence { determined, p_value: Some(0.5), ..Evidence::default() }
    }

    fn said(evidence: &Evidence) -> (Verdict, Vec<Why>) {
        let Judgement { verdict, reasons } = judge(evidence);
        (verdict, reasons.iter().map(|reason| reason.kind).collect())
    }

    fn worse() -> Option<Compared> {
        Some(Compared::of_errors(2.0, 1.0, 300.0))
    }

    #[test]
    fn nothing_against_it_is_adequate_explained_or_unjudged() {
        assert_eq!(said(&clean()), (Verdict::Adequate, vec![]));
        assert_eq!(said(&Evidence { found: true, ..clean() }), (Verdict::Explained, vec![]));
        assert_eq!(said(&Evidence { p_value: None, ..clean() }), (Verdict::Unjudged, vec![]));
        assert_eq!(said(&Evidence::default()), (Verdict::Undetermined, vec![Why::Nothing]));
        let loose = Evidence { p_value: Some(1.0), loose: true, ..clean() };
        assert_eq!(said(&loose), (Verdict::Unjudged, vec![]));
        let far = Evidence { predicted: Some([2.0, 1.0]), ..loose };
        assert_eq!(said(&far), (Verdict::Unjudged, vec![]));
        assert_eq!(said(&Evidence { loose: false, ..far }).0, Verdict::Undetermined);
        assert_eq!(said(&Evidence { check_declared: worse(), ..far }).0, Verdict::Unexplained);
    }

    #[test]
    fn loops_that_stay_open_say_more_than_what_is_undetermined() {
        for determined in [Determined::NotConverged, Determined::NoStart, Determined::Unobservable]
        {
            let open = Evidence { determined, absurd: true, open: true, ..clean() };
            assert_eq!(said(&open), (Verdict::Implausible, vec![Why::Absurd]));
            // An effect is as large as that along a direction that nothing tells.
            let effect = Evidence { open: false, p_value: None, ..open };
            assert_eq!(said(&effect).0, Verdict::Undetermined);
        }
        for determined in [Determined::Nothing, Determined::Lost] {
            let begun = Evidence { determined, absurd: true, open: true, ..clean() };
            assert_eq!(said(&begun).0, Verdict::Undetermined);
        }
    }

    #[test]
    fn each_look_has_its_level() {
        let at = |p| said(&Evidence { p_value: Some(p), ..clean() });
        assert_eq!(at(0.99 * LEVEL), (Verdict::Unexplained, vec![Why::Residual]));
        assert_eq!(at(1.01 * LEVEL).0, Verdict::Adequate);
    }

    #[test]
    fn what_the_fit_has_not_seen_contradicts_it() {
        let declared = Evidence { check_declared: worse(), ..clean() };
        assert_eq!(said(&declared), (Verdict::Unexplained, vec![Why::CheckDeclared]));
        let unjudged = Evidence { p_value: None, ..declared };
        assert_eq!(said(&unjudged), (Verdict::Unexplained, vec![Why::CheckDeclared]));
        let groups = Evidence { groups_before: worse(), ..clean() };
        // Without an effect there is no fit before it.
        assert_eq!(said(&groups).0, Verdict::Adequate);
        let found = Evidence { found: true, ..groups };
        assert_eq!(said(&found), (Verdict::PartlyExplained, vec![Why::GroupsBefore]));
    }

    #[test]
    fn readings_that_tell_less_than_the_drawing_determine_nothing() {
        let evidence = Evidence { predicted: Some([62.0, 30.0]), ..clean() };
        assert_eq!(said(&evidence), (Verdict::Undetermined, vec![Why::Predicted]));
        let reason = judge(&evidence).reasons[0];
        assert_eq!((reason.found, reason.expected), (Some(62.0), Some(30.0)));
        // Where more is left than noise, what is predicted of it says little.
        let left = Evidence { p_value: Some(0.1 * LEVEL), ..evidence };
        assert_eq!(said(&left), (Verdict::Unexplained, vec![Why::Residual]));
        let better = Evidence { predicted: Some([20.0, 30.0]), ..clean() };
        assert_eq!(said(&better), (Verdict::Adequate, vec![]));
    }

    #[test]
    fn three_known_poses_that_are_no_better_do_not_vouch_for_what_is_predicted() {
        let expected = Expected {
            position_sd: 62.0,
            orientation_sd: None,
            chi2: 1.0,
            dof: 2.0,
            p_value: 0.9,
            worst: None,
        };
        let of = |position_rms, other| Evidence {
            predicted: Some([62.0, 30.0]),
            check: Some(Check { position_rms, predicted: Some(expected), ..known() }),
            check_declared: Some(Compared::of_errors(position_rms, other, 9.0)),
            ..clean()
        };
        assert_eq!(said(&of(6.0, 5.0)), (Verdict::Unexplained, vec![Why::PredictedDeclared]));
        // Known poses that are better off speak for the calibration.
        assert_eq!(said(&of(3.0, 5.0)), (Verdict::Adequate, vec![]));
        assert_eq!(said(&of(60.0, 5.0)), (Verdict::Unexplained, vec![Why::CheckDeclared]));
    }

    fn known() -> Check {
        Check {
            poses: 3,
            position_rms: 0.0,
            orientation_rms: None,
            largest: None,
            predicted: None,
            misread: None,
        }
    }

    #[test]
    fn what_is_off_by_no_more_than_noise_is_not_worse() {
        let of = |found, errors| Compared::of_errors(found, 1.0, errors).worse();
        // Two relative deviations of a root mean square of 50 errors are a fifth.
        assert_eq!([of(1.19, 50.0), of(1.21, 50.0)], [false, true]);
        assert_eq!([of(1.04, 1e6), of(1.06, 1e6)], [false, true]);
    }

    #[test]
    fn known_poses_that_share_the_errors_of_parameters_are_few() {
        let of = |position_rms, dof| {
            let expected = Expected {
                position_sd: 0.08,
                orientation_sd: None,
                chi2: 1.0,
                dof,
                p_value: 0.9,
                worst: None,
            };
            let found = Check { poses: 40, position_rms, predicted: Some(expected), ..known() };
            let drawn = Check { poses: 40, position_rms: 0.036, ..known() };
            Compared::of(&found, &drawn).worse()
        };
        // By SciPy, χ² of 4 degrees of freedom exceeds 17.33 once in 600, and that of 100 exceeds 146.6.
        assert_eq!([of(2.07 * 0.036, 4.0), of(2.09 * 0.036, 4.0)], [false, true]);
        assert_eq!([of(1.20 * 0.036, 100.0), of(1.22 * 0.036, 100.0)], [false, true]);
    }
}

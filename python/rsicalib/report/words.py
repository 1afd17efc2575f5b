"""What a result says, in words: the same in the terminal and in the report."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Literal, NamedTuple

from rsicalib.facts.shapes import (
    CalibrationShape,
    CurveLaw,
    Excluded,
    FitQuality,
    Name,
    Parameter,
    Reason,
    ResultShape,
    Rms,
    Step,
    StepParameter,
    TraceShape,
)
from rsicalib.facts.warned import MISTAKES
from rsicalib.io.builtin import DEFAULT
from rsicalib.plain_text import SMALLEST, counted
from rsicalib.units import HALF_95, in_thousandths, with_unit

NO_TERM = {"unknown_law": "a law that no term has", "unknown_noise": "errors that follow no law"}
"""Ids of what may explain a session and is no term, in words."""

OPEN = ("unexplained", "partly_explained")
"""Verdicts whose advice describes what is left."""

NOT_APPLIED = {
    "no_help": "what was left out in turn is predicted no better with it",
    "law": "a law that no term has is likelier in its place, or as likely and of one session",
    "shape": "one placement does not tell a curve without a law for others",
    "leaves": "something is left over, and one placement does not tell whether it holds at others",
    "may_stand": "one placement does not tell it from an error of what is touched, or what sees it",
    "as_well": "without it this one placement is explained about as well",
    "order": "waves of another length explain it as well: more places of it in between would tell",
}
"""Why an effect is named, and no part of the parameters."""

WORDS = {
    "sensor": "sensor {target}",
    "electronics": "the electronics",
    "closure": "closure {target}",
}


def number(value: float | None, digits: int = 3) -> str:
    """A number in a few digits; a dash where it is not known."""
    if value is None or not math.isfinite(value):
        return "–"
    if value == 0.0:
        return "0"
    if abs(value) >= 10.0**digits and abs(value) < 1e6:
        return f"{value:.0f}"
    if 1e-3 <= abs(value) < 1e6:
        return f"{value:.{max(0, digits - 1 - math.floor(math.log10(abs(value))))}f}"
    return f"{value:.{digits - 1}e}"


def count_words(value: float | None) -> str:
    """Degrees of freedom: a whole number is written as one."""
    whole = value is not None and math.isfinite(value) and value == round(value)
    return f"{value:.0f}" if whole else number(value)


ROUNDING = 1e-14
"""A parameter below it is what is left of numbers of one to a hundred that are one."""


def plus_minus(value: float | None, half: float | None) -> tuple[str, str]:
    """A value and its half width, both to two digits of the half width."""
    if value is None:
        return "–", "–"
    if half is None or not math.isfinite(half) or half <= 0.0:
        return number(0.0 if abs(value) < ROUNDING else value, 6), "–"
    places = 1 - math.floor(math.log10(half))
    if places > 7 or max(abs(value), half) >= 1e6:
        return f"{value:.6e}", f"{half:.1e}"
    return f"{value:z.{max(places, 0)}f}", f"{half:.{max(places, 0)}f}"


EVEN = 0.1
"""Two sides of an interval that differ by less are shown as one: half a width has two digits."""


def with_bounds(parameter: Parameter, times: float = 1.0) -> tuple[str, str]:
    """A value and its 95 %: half a width, or from where to where, if the sides differ."""
    value, ends = parameter.value, parameter.interval
    if value is None or ends is None:
        return plus_minus(None if value is None else times * value, None)
    below, above = (times * abs(end - value) for end in ends)
    narrow, wide = sorted((below, above))
    if parameter.profile is None or wide - narrow <= EVEN * narrow:
        return plus_minus(times * value, 0.5 * (below + above))
    if math.isinf(narrow):
        return plus_minus(times * value, None)
    shown = plus_minus(times * value, narrow)[0]
    low, high = (plus_minus(times * end, narrow)[0] for end in ends)
    if math.isinf(below):
        return shown, f"up to {high}"
    return shown, f"from {low}" if math.isinf(above) else f"{low} to {high}"


def name_of(term: str) -> str:
    """A term's id as people read it."""
    return NO_TERM.get(term) or term.replace("_", " ")


def percent(p: float) -> str:
    """A probability as people read it; what is not certain is not called so."""
    if 0.0 < p < 0.01:
        return "< 1 %"
    return "> 99 %" if 0.99 < p < 1.0 else f"{100 * p:.0f} %"


def parameter_name(term: str, name: str) -> str:
    """A parameter of a term as people read it: `gain`, `curvature c2`."""
    return name_of(term) if name == term else f"{name_of(term)} {name}"


def target_words(klass: str, target: str) -> str:
    """Where a fault lies: `sensor a22`, `sensors tl and tr`, `each sensor`."""
    if klass == "sensor" and target == "each":
        return "each sensor"
    if klass == "sensor" and "+" in target:
        return f"sensors {listed_words(target.split('+'))}"
    if klass == "closure" and target == "each":
        return "all closures of one make"
    if klass == "closure" and target.startswith("each("):
        return f"all closures of the make of {target.removeprefix('each(').removesuffix(')')}"
    if target.startswith("each/"):
        return f"row {target.removeprefix('each/')} of each chain"
    if target.startswith("each."):
        number_of = target.removeprefix("each.")
        return f"{'sensors at ' * (klass == 'sensor')}joint {number_of} of each chain"
    return WORDS.get(klass, "{target}").format(target=target)


def labelled(target: str, label: str | None) -> str:
    """A target, and what people call it: `a22 (elbow of arm 2)`."""
    return f"{target} ({label})" if label else target


def subject(step: Step | Name) -> str:
    """A missing effect: `curvature of sensor a22 (elbow of arm 2)`."""
    at = f" (at {step.place})" if step.place else ""
    if isinstance(step, Step) and step.wavelength is not None:
        at = f" ({waves_words(step)})"
    where = labelled(target_words(step.klass, step.target), step.label)
    what = name_of(step.term) + "," * (step.term in NO_TERM)
    return f"{what} of {where}{at}"


def missing_words(result: TraceShape) -> tuple[str, bool]:
    """What was missing, and whether that is several.

    Where a law that no term has is likelier than an effect that was found, the law stands for
    that effect.
    """

    def of(step: Step) -> str:
        law = next((n for n in step.also_fits if n.term == "unknown_law"), None)
        if law is None or step.not_applied != "law" or (step.probability or 0.0) >= 0.5:
            return subject(step)
        return f"a law of {labelled(target_words('', law.target), law.label)} that no term has"

    missing = list(dict.fromkeys(of(step) for step in result.steps))
    return listed_words(missing), len(missing) > 1


def listed_words(items: Sequence[str]) -> str:
    """Words one after the other: `a, b and c`."""
    return items[0] if len(items) == 1 else f"{', '.join(items[:-1])} and {items[-1]}"


def either_words(items: Sequence[str]) -> str:
    """Words of which one holds: `a, b or c`."""
    return items[0] if len(items) == 1 else f"{', '.join(items[:-1])} or {items[-1]}"


def place_words(result: TraceShape) -> str:
    """Where something is left: ` at a33`; empty where it is everywhere, or nothing is."""
    target = None if result.unexplained is None else result.unexplained.target
    return "" if target in (None, "all") else f" at {target}"


def judged_words(fit: FitQuality) -> str:
    """How well a fit is judged to be: χ², and what chance gives."""
    if fit.p_value is None:
        return "lack of fit cannot be judged"
    p = p_is(fit.p_value)
    return f"χ² {number(fit.chi2)} for {count_words(fit.dof)} degrees of freedom, {p}"


def probability(p: float | None) -> str:
    """A p-value: below what a double can hold it is not zero."""
    return f"< {SMALLEST:g}" if p is not None and p < SMALLEST else number(p, 2)


def p_is(p: float | None) -> str:
    """`p = 0.03`, `p < 1e-99`."""
    words = probability(p)
    return f"p {words}" if words.startswith("<") else f"p = {words}"


def predicted_words(result: ResultShape) -> str:
    """The error that a calibration predicts of itself, as a sentence; empty where it cannot."""
    error = result.predicted
    if error is None:
        return ""
    where = f"{number(error.position_sd, 2)} {result.length_unit}"
    if error.orientation_sd is not None:
        what, where = "the platform", f"{where} and {number(error.orientation_sd, 2)} rad"
    else:
        what = "carried points"
    but = ", without what is not observable" if result.unobservable else ""
    return (
        f"at the poses of this session {what} should be right to {where} (one standard "
        f"deviation{but}). "
    )


def quality(result: ResultShape) -> FitQuality:
    """How well the final model fits."""
    if isinstance(result, TraceShape):
        return result.after
    if isinstance(result, CalibrationShape):
        return result.fit
    raise TypeError(f"found {type(result).__name__}, expected a calibration or a trace")


def _lack(result: ResultShape) -> str:
    """What keeps readings from telling what was asked; no convention does."""
    reason = next(iter(result.reasons), None)
    if reason is not None and reason.kind == "predicted":
        what = _carried(result)
        size, drawn = (
            f"{number(v, 2)} {result.length_unit}" for v in (reason.found, reason.expected)
        )
        return f"{what} predicted to err by {size}, and by {drawn} without any readings"
    lost = any(reason.kind in ("nothing_left", "unobservable") for reason in result.reasons)
    told = next(iter(result.unobservable), result.termination)
    return told if lost or not result.parameters else result.termination


def _carried(result: ResultShape) -> str:
    """What errors are predicted of, as the subject of a sentence."""
    placed = result.predicted is not None and result.predicted.orientation_sd is not None
    return "the platform is" if placed else "carried points are"


def moved_words(rms: Rms) -> str:
    """What an effect moves: the platform, or points without an orientation."""
    return "carried points" if rms.orientation is None else "the platform"


def sentence(result: ResultShape) -> str:
    """The verdict."""
    fit = quality(result)
    judged = judged_words(fit)
    if result.verdict == "undetermined":
        why = _lack(result)
        left = "" if fit.p_value is None else f" What is left: {judged}."
        return f"Undetermined: these readings cannot determine what was asked ({why}).{left}"
    if result.verdict == "implausible":
        first = next(iter(result.implausible), None)
        why = "something is out of all proportion" if first is None else first.text
        return f"Implausible{_found(result)}: {why} ({judged})."
    against = _elsewhere(result)
    if result.verdict == "unexplained" and against and against[0] == result.reasons[0]:
        return f"Contradicted: {reason_words(result, against[0])}. What is left: {judged}."
    if isinstance(result, CalibrationShape) and result.method == "fixture":
        return "Calibrated open loop, from known poses: a straight line for each channel."
    if result.verdict == "unjudged":
        found = _found(result)
        why = "" if fit.p_value is None else " (the declared noise is too large)"
        return f"Unjudged: a calibration{found}, and nothing to judge it by{why}: {judged}."
    if result.verdict in OPEN and (mistake := mistaken(result)):
        return f"{capital(name_of(result.verdict))}: {mistake} ({judged})."
    if isinstance(result, TraceShape) and result.steps:
        missing, several = missing_words(result)
        were = "were" if several else "was"
        if result.verdict == "explained":
            yet = _yet(result)
            unused = [subject(step) for step in result.steps if not step.applied]
            aside = f" Not applied: {listed_words(unused)}." if unused else ""
            noise = f"what is left is noise ({judged})"
            return f"Explained{yet}: {missing} {were} missing; {noise}.{aside}"
        more = any(reason.kind == "residual" for reason in result.reasons)
        leave = "leave" if several else "leaves"
        leave += " more than noise" if more else " no more than noise"
        if against:
            why = reason_words(result, against[0])
            if against[0].kind not in ("check_pose", "check_pose_orientation"):
                why = f"what was found does not hold elsewhere: {why}"
            return f"Partly explained: {why}. {capital(missing)} {leave} ({judged})."
        if more:
            where = f"something is left{place_words(result)}"
            return f"Partly explained: {missing} {were} missing, and {where} ({judged})."
        return (
            f"Partly explained: {missing} {leave} ({judged}), but may stand for an effect that no "
            "term has."
        )
    if result.verdict == "unexplained":
        if isinstance(result, TraceShape):
            where = place_words(result)
            if result.reasons and result.reasons[0].kind == "unknown_law":
                law = f"a law that no term has,{where}, is likelier than chance"
                return f"Unexplained: {law}, though no more is left than noise ({judged})."
            return f"Unexplained: no known effect explains what is left{where} ({judged})."
        return f"The residual is significant ({judged}): the model lacks something."
    # Readings of a converter whose bits are stuck stay.
    count = sum(it.samples or 1 for it in result.excluded if not _stays(it))
    out = "" if not count else f" without {counted(count, 'bad sample')}"
    return f"Adequate{_yet(result)}: what is left{out} is the noise of the readings ({judged})."


def mistaken(result: ResultShape) -> str:
    """The mistake for which a trace looked for no effect, in words; empty where there is none."""
    if all(reason.kind != "mistake" for reason in result.reasons):
        return ""
    for warning in result.warnings:
        if warning.kind in MISTAKES and warning.target is not None:
            of = warning.target.split("+")
            return f"{listed_words(of)} {MISTAKES[warning.kind][len(of) > 1]}"
    return ""


FAR = 10.0
"""Predicted errors of what is carried that are more often the misclosure are said at once."""


def _yet(result: ResultShape) -> str:
    """That loops which close do not make what is carried right; empty where nothing says so."""
    error, fit = result.predicted, quality(result)
    gap_size = fit.rms_misclosure
    if error is None or gap_size is None or fit.misclosure_unit not in (None, result.length_unit):
        return ""
    if not error.position_sd > FAR * gap_size:
        return ""
    what = _carried(result)
    size, gap = number(error.position_sd, 2), number(gap_size, 2)
    unit = result.length_unit
    return f", yet {what} predicted to err by {size} {unit} beside a misclosure of {gap} {unit}"


def _found(result: ResultShape) -> str:
    """What a trace found, where nothing judges it: ` with curvature of sensor a22`."""
    if not isinstance(result, TraceShape) or not result.steps:
        return ""
    return f" with {missing_words(result)[0]}"


def noise_words(result: ResultShape) -> str:
    """How large the noise is, and where from."""
    if result.noise is None or not result.noise.sigma:
        return "not known"
    unit = result.noise.unit
    by_unit: dict[str, dict[str, float]] = {}
    for name, sigma in result.noise.sigma.items():
        by_unit.setdefault(unit.get(name, ""), {})[name] = sigma
    sizes = listed_words([_sizes(sigma, of) for of, sigma in by_unit.items()])
    dof = "" if result.noise.dof is None else f", {result.noise.dof:.0f} degrees of freedom"
    return f"{sizes} per sample ({result.noise.source}{dof})"


def _sizes(sigma: Mapping[str, float], unit: str) -> str:
    """The usual size and those apart from it, or the smallest and the largest."""
    usual, times = Counter(sigma.values()).most_common(1)[0]
    low, high = number(min(sigma.values())), number(max(sigma.values()))
    if low == high:
        return with_unit(low, unit)
    if 2 * times <= len(sigma):
        return with_unit(f"{low} … {high}", unit)
    apart = [f"{number(value)} in {name}" for name, value in sigma.items() if value != usual]
    return f"{with_unit(number(usual), unit)}, but {listed_words(apart)},"


class ErrorRow(NamedTuple):
    """One measure of the error, before and after, in words."""

    kind: Literal["chi2", "p_value", "misclosure", "held_out", "position", "orientation", "touched"]
    name: str
    before: str | None
    """None where it is not known."""
    after: str | None
    at: str = ""
    """Where it was measured: `20 check poses`."""

    @property
    def cells(self) -> tuple[str, str, str]:
        """What a table shows."""
        return self.name, self.before or number(None), self.after or number(None)


def comparison(result: ResultShape) -> tuple[tuple[str, str], list[ErrorRow]]:
    """The error before and after: two headings, and rows."""
    nothing = FitQuality(None, None, None, None)
    after, heads = quality(result), ("as declared", "calibrated")
    before = result.nominal or nothing
    if isinstance(result, TraceShape):
        before = result.before if result.steps or result.excluded else nothing
        heads = ("before", "after")
    elif result.with_excluded is not None:
        before, heads = result.with_excluded.fit, ("all readings", "left out")
    unit = result.length_unit

    def both(of: Callable[[FitQuality], str | None]) -> tuple[str | None, str | None]:
        return of(before), of(after)

    def ratio(fit: FitQuality) -> str | None:
        return None if fit.chi2 is None else f"{number(fit.chi2)} / {count_words(fit.dof)}"

    def chance(fit: FitQuality) -> str | None:
        return None if fit.p_value is None else probability(fit.p_value)

    def held_out(fit: FitQuality) -> str | None:
        return None if fit.held_out is None else _known(fit.held_out.chi2_per_dof)

    misclosures = both(lambda fit: _known(fit.rms_misclosure))
    rows = [
        ErrorRow("chi2", "χ² / degrees of freedom", *both(ratio)),
        ErrorRow("p_value", "p-value", *both(chance)),
        ErrorRow("misclosure", f"misclosure, rms [{misclosure_unit(result)}]", *misclosures),
        ErrorRow("held_out", "held-out χ² per degree of freedom", *both(held_out)),
    ]
    for key, words in (("check", ""), ("aligned", ", aligned")):
        old, new = getattr(before, key), getattr(after, key)
        if new is None:
            continue
        poses = f"{counted(new.poses, 'check pose')}{words}"
        off = [_known(c.position_rms) if c else None for c in (old, new)]
        turned = [_known(c.orientation_rms) if c else None for c in (old, new)]
        rows.append(ErrorRow("position", f"position, {poses} [{unit}]", off[0], off[1], poses))
        rows.append(
            ErrorRow("orientation", f"orientation, {poses} [rad]", turned[0], turned[1], poses)
        )
    rows += _touched(result)
    return heads, [row for row in rows if row.before is not None or row.after is not None]


def misclosure_unit(result: ResultShape) -> str:
    """Of length, or of the coordinates that a machine without lengths makes equal."""
    return quality(result).misclosure_unit or result.length_unit


def _known(value: float | None) -> str | None:
    return number(value) if value is not None and math.isfinite(value) else None


def not_applied(step: Step) -> str:
    """Why an effect is named, and no part of the parameters."""
    why = NOT_APPLIED.get(step.not_applied or "")
    return f"not applied: {why}" if why else "not applied"


def elsewhere_words(result: TraceShape) -> str:
    """What the effects do to predictions on what was left out."""
    found = result.elsewhere
    if found is None:
        return ""
    groups = found.kind == "groups"
    what = "halves of the placements or sessions" if groups else "parts of the workspace"
    applied = [step.applied for step in result.steps]
    errors = [(found.applied, "what is applied")] if any(applied) else []
    if found.found is not None and not all(applied):
        errors.append((found.found, "all that was found"))
    with_effects = [f"{number(error, 3)} with {which}" for error, which in errors]
    without = f"{number(found.without, 3)} {found.unit} without any effect"
    again = (
        []
        if found.again is None
        else [f"{number(found.again, 3)} with what is found again without them"]
    )
    return f"closures of {found.blocks} {what} that were left out in turn err by " + ", ".join(
        [without, *with_effects, *again]
    )


def between_words(result: ResultShape) -> str:
    """What changes from group to group, and one half of the groups against the other."""
    between = result.between
    if between is None:
        return ""
    what = f"{len(between.groups)} {between.kind}s"
    low, high = (number(v, 2) for v in between.interval)
    of = "typical sizes of offsets and touched places"
    if between.sd == 0:
        words = f"{what} do not differ, or by less than {high} {of} ({p_is(between.p_value)})"
    else:
        sd = number(between.sd, 2)
        words = f"{what} differ by {sd} {of} ({low} to {high}, {p_is(between.p_value)})"
    halves = between.halves
    if halves is None:
        return words
    unit = result.length_unit
    own = "" if halves.own else ", told by all of them"
    return (
        f"{words}; half of them against the rest: carried points differ by "
        f"{number(halves.difference, 2)} {unit}, predicted {number(halves.between, 2)}{own} "
        f"({number(halves.within, 2)} within), χ² per parameter "
        f"{number(halves.chi2_between, 2)} ({number(halves.chi2_within, 2)} within)"
    )


def _touched(result: ResultShape) -> list[ErrorRow]:
    """How far carried points are from where they touch, in groups that were fitted, and others."""
    groups = result.groups
    if groups is None or (
        isinstance(result, CalibrationShape) and result.with_excluded is not None
    ):
        return []
    traced = isinstance(result, TraceShape)
    old = (groups.before_fitted, groups.before_others) if traced else None
    old = old or (groups.nominal_fitted, groups.nominal_others)
    names = (f"at what it touches, {which} [{groups.unit}]" for which in ("fitted", "other groups"))
    return [
        ErrorRow("touched", name, _known(before), _known(after))
        for name, before, after in zip(names, old, (groups.fitted, groups.others), strict=True)
    ]


def size_words(step: Step) -> str:
    """How large an effect is, with 95 %."""
    if len(step.parameters) > 3 and step.curve:
        times, unit = in_thousandths(step.curve_unit)
        largest = times * max(abs(row[1]) for row in step.curve)
        return f"a curve of up to {with_unit(number(largest, 2), unit)}"
    sizes = ", ".join(f"{p.name} = {value_words(p)}" for p in step.parameters)
    return sizes if step.wavelength is None else f"{sizes}; {waves_words(step)}"


def waves_words(step: Step) -> str:
    """How long the waves are of an error that repeats along a length: `waves of 590 mm`."""
    return f"waves of {with_unit(number(step.wavelength), step.parameters[0].unit)}"


def value_words(parameter: StepParameter) -> str:
    """An estimate with its interval of 95 %, and its unit."""
    sd = parameter.sd
    value, half = plus_minus(parameter.value, None if sd is None else HALF_95 * sd)
    return with_unit(f"{value} ± {half}", parameter.unit)


def longer_words(parameter: StepParameter) -> str:
    """How much longer something is, or shorter: `longer by 0.5 ± 0.02 mm`."""
    value = parameter.value
    if value is None or value >= 0.0:
        return f"longer by {value_words(parameter)}"
    return f"shorter by {value_words(replace(parameter, value=-value))}"


def law_words(law: CurveLaw) -> str:
    """Which closed form a free curve is, with its shape and the intervals of 95 %."""
    if law.form is None:
        return law.text
    within = [" to ".join(map(number, p.interval)) for p in law.parameters]
    numbers = ", ".join(
        f"{p.name} = {with_unit(f'{number(p.value)} ({ends})', p.unit)}"
        for p, ends in zip(law.parameters, within, strict=True)
    )
    others = f"; {', '.join(map(name_of, law.also_fits))} would do as well" if law.also_fits else ""
    return f"the curve {law.text} ({name_of(law.form)}): {numbers}{others}"


def left_out(result: ResultShape) -> list[str]:
    """Which readings were left out, and why."""
    return [excluded_words(entry) for entry in result.excluded if not _stays(entry)]


def noisier(result: ResultShape) -> list[str]:
    """Which readings stay and count as noisier, and why."""
    return [excluded_words(entry) for entry in result.excluded if _stays(entry)]


def _stays(entry: Excluded) -> bool:
    return entry.kind == "stuck_bits"


def excluded_words(entry: Excluded) -> str:
    """Which reading was left out, and why."""
    places: list[tuple[str, int | str | None]]
    places = [("session", entry.session), ("pose", entry.pose), ("sample", entry.sample)]
    places += [("group", entry.group), ("", entry.chain), ("", entry.channel)]
    where = " ".join(f"{word} {place}".strip() for word, place in places if place is not None)
    return f"{where}: {entry.reason}"


class Kept(NamedTuple):
    """Where a result stands: by it advice says how the result is used."""

    file: str | None = None
    """Its file; None of a result that is in memory alone, where it is used from Python."""
    first: str = ""
    """What makes the file, where it is not there."""

    def used(self, result: ResultShape, verb: str, data: str) -> str:
        """How a verb uses the result: as a command, or as a call. No full stop is copied with it.

        Examples
        --------
        >>> Kept().used(None, "forward", "READINGS")
        'rsicalib.forward(readings, calibration=found)'
        """
        if self.file is None:
            return f"rsicalib.{verb}({data.lower()}, calibration=found)"
        file = f'"{self.file}"' if " " in self.file else self.file
        return f"{self.first}rsicalib {verb} {data}{_given(result)} --calibration {file}"


IN_PYTHON = Kept()


def advice(result: ResultShape, kept: Kept = IN_PYTHON) -> list[str]:
    """What to do, or to measure, next."""
    out = []
    fit = quality(result)
    if result.verdict in (*OPEN, "implausible") and (mistake := mistaken(result)):
        return [f"Do not use it. See to the warning first ({mistake}), then trace again."]
    warned = any(warning.kind in MISTAKES for warning in result.warnings)
    if warned:
        out.append("See to the warning first, then trace again.")
    elif result.verdict in ("adequate", "explained"):
        out.append(f"{_use(result)}: {kept.used(result, 'forward', 'READINGS')}")
    # Where nothing was fitted, what is lacking says what to do.
    if result.verdict == "undetermined" and result.parameters and not warned:
        less = (
            f"leave out --terms {listed_words(result.too_many)}"
            if result.too_many
            else ("fewer --terms")
        )
        out.append(
            "Record more poses, and more different ones, or declare what is known: "
            f"--rest, {less}, `sd` in the mechanism."
        )
    if result.verdict == "implausible":
        out += _implausible(result)
    against = _elsewhere(result)
    left = not against or any(reason.kind in TRACED for reason in result.reasons)
    if result.verdict == "unexplained" and isinstance(result, CalibrationShape) and left:
        out.append("Find what is missing: rsicalib trace, with the same files.")
    again = kept.used(result, "calibrate", "CHECK")
    out += list(dict.fromkeys(ADVICE[reason.kind].format(again=again) for reason in against))
    if result.verdict == "unjudged" and result.method != "fixture":
        seated = result.noise is not None and result.noise.seating is not None
        out.append(
            "To judge the fit, declare how well what is touched holds its place: `noise` of the "
            "closure in the mechanism file."
            if seated
            else "To judge the fit, declare noise and play no larger than the readings show them: "
            "a larger one hides what is wrong."
            if fit.p_value is not None
            else "To judge the fit, hold each pose for a few samples (the same number in column "
            "`pose`), or declare the noise with --noise."
        )
    if isinstance(result, TraceShape) and result.verdict != "implausible":
        out += _next_measurement(result)
    if fit.check is None and result.verdict != "implausible":
        said = f": {predicted}" if (predicted := predicted_words(result)) else ". "
        out.append(
            f"Closure is not accuracy{said}Give poses known from elsewhere "
            "with --check to see the error."
        )
    return out


def _given(result: ResultShape) -> str:
    """The option of a command that says the mechanism of a result; the default needs none."""
    return "" if result.mechanism == DEFAULT else " --mechanism FILE"


def _use(result: ResultShape) -> str:
    """What a calibration gives where it is used, with what was found and is no part of it."""
    steps = result.steps if isinstance(result, TraceShape) else ()
    left = [subject(s) for s in steps if not s.applied]
    if not left:
        return "Use it"
    if len(left) == len(steps):
        return "Use it as the calibration without what was found (--apply-all applies that)"
    many = "is" if len(left) == 1 else "are"
    return (
        f"Use it, but {listed_words(left)} {many} not applied (--apply-all applies what was found)"
    )


TRACED = ("residual", "check", "check_orientation")
"""Reasons of a verdict that a trace may explain."""

ADVICE = {
    "open_loops": "The mechanism is not what it was in the session, or the check readings are of "
    "another one. To see what has changed: {again}",
    "check": "Check poses are off by more than predicted: record poses like them, and see whether "
    "the known poses are as good as they are taken for (--check-noise says how good).",
    "check_orientation": "Check poses are turned by more than predicted: see whether the known "
    "orientations are as good as they are taken for (--check-noise-angle says how good).",
    "check_declared": "Do not use it: known poses are better off with the mechanism as it is "
    "declared. Record more poses, from all of the workspace, or fit fewer --terms.",
    "predicted_declared": "Do not use it: known poses are no better off than with the mechanism as "
    "it is declared, and others may be far worse. Record more poses, from all of the workspace, or "
    "fit fewer --terms.",
    "check_pose": "One check pose is off by itself: see whether it stands beside its own readings, "
    "and whether the arm was pushed there.",
    "check_pose_orientation": "One check pose is turned by itself: see whether it stands beside "
    "its own readings, and whether its orientation was read right.",
    "check_before": "What was found makes known poses worse: record more poses, and see whether it "
    "is found again.",
    "groups_declared": "Do not use it: other groups are better off with the mechanism as it is "
    "declared. Fit more groups together, or fewer --terms.",
    "groups_before": "What was found does not hold elsewhere: fit more groups together.",
    "groups": "The calibration does not hold in other groups: trace the residual of all groups "
    "together, and see whether what was touched or the arm has changed between them.",
    "held_out": "Poses that are left out fit worse than the others predict: record more poses, "
    "from all of the workspace.",
    "held_out_before": "Poses that are left out fit worse with what was found: record more poses, "
    "and see whether it is found again.",
}
"""What to do where readings that a fit has not seen speak against it, by the kind of reason;
`again` is how check readings are compared with the result."""


def _implausible(result: ResultShape) -> list[str]:
    """What to look at where something is out of all proportion: readings, units, drawing."""
    steps = result.steps if isinstance(result, TraceShape) else ()
    labelled = any(p.term == "unknown_point" and "[" in p.target for p in result.parameters)
    labels = ["Check the labels: rows with one text in `at` or `group` must touch one place."]
    if steps:
        return labels * labelled + [
            f"Do not use it. What was found ({listed_words([subject(s) for s in steps])}) may "
            "stand for something else: measure it by itself, or leave the term out with --without."
        ]
    return [
        "Do not use it. Check the wiring and the order of the columns: each channel must move its "
        "own joint, in the direction that the mechanism declares.",
        "Check the units: lengths, radians or degrees, gain and range of each channel.",
        "Check the drawing: rsicalib mechanism FILE shows what is declared; compare a length and "
        "an angle with the machine.",
        *labels * labelled,
    ]


def _elsewhere(result: ResultShape) -> list[Reason]:
    """What readings say against a result that its fit has not seen."""
    return [reason for reason in result.reasons if reason.kind in ADVICE]


def reason_words(result: ResultShape, reason: Reason) -> str:
    """What readings say that a fit has not seen, with the numbers."""
    what, than = REASONS[reason.kind]
    what = what.format(pose="" if reason.pose is None else f" {reason.pose}")
    turned = dict.fromkeys(("check_orientation", "check_pose_orientation"), " rad")
    units = {"held_out": "", "held_out_before": "", **turned}
    unit = units.get(reason.kind, f" {result.length_unit}")
    beside = "" if reason.expected is None else f"; {number(reason.expected)}{unit} {than}"
    p = "" if reason.p_value is None else f" ({p_is(reason.p_value)})"
    return f"{what} {number(reason.found)}{unit}{beside}{p}"


REASONS = {
    "open_loops": ("loops of the check readings have a misclosure of", "was expected"),
    "check": ("check poses are off by", "is predicted"),
    "check_orientation": ("check poses are turned by", "is predicted"),
    "check_pose": ("check pose{pose} alone is off by", "is predicted"),
    "check_pose_orientation": ("check pose{pose} alone is turned by", "is predicted"),
    "check_declared": ("check poses are off by", "with the mechanism as it is declared"),
    "predicted_declared": (
        "check poses are predicted to be off by",
        "is their error with the mechanism as it is declared",
    ),
    "check_before": ("check poses are off by", "without what was found"),
    "groups_declared": (
        "groups that were not fitted close to",
        "with the mechanism as it is declared",
    ),
    "groups_before": ("groups that were not fitted close to", "without what was found"),
    "groups": (
        "groups that were not fitted close to",
        "by the fitted ones and the predicted errors",
    ),
    "held_out": ("poses left out in turn have a χ² per equation of", "is fitted"),
    "held_out_before": (
        "poses left out in turn have a χ² per equation of",
        "without what was found",
    ),
}
"""What is off, and what the expected figure is, by the kind of reason."""


def capital(text: str) -> str:
    """The text with a capital letter."""
    return text[:1].upper() + text[1:]


def not_tried(result: TraceShape) -> list[str]:
    """Terms that are no candidates, by what the readings or the mechanism lack for them."""
    by_need: dict[str, list[str]] = {}
    for term, needs in result.not_candidates.items():
        by_need.setdefault(needs, []).append(name_of(term))
    return [f"{', '.join(names)} (missing: {needs})" for needs, names in by_need.items()]


MEASURED_LENGTH = (
    "measure a distance between two places that stand still, and declare it "
    "(a `[[closure]]` between them with that `value`)"
)
"""What tells the size of the whole, where readings of lengths alone do not."""


def _next_measurement(result: TraceShape) -> list[str]:
    out = []
    for step in result.steps:
        if not step.also_fits:
            if step.needs_length:
                how_large = f"{name_of(step.term)} of {target_words('', step.target)} leaves open"
                out.append(
                    f"{capital(how_large)} how large the whole is, and no pose tells it: "
                    f"{MEASURED_LENGTH}."
                )
            continue
        others = [
            subject(n) if n.target != step.target else name_of(n.term) for n in step.also_fits
        ]
        sensors = step.target.split("+")
        how = {
            "sensor": f"move {listed_words(sensors)} over more of "
            + ("its range" if len(sensors) == 1 else "their ranges"),
            "electronics": "visit the same poses again later, and in another order",
        }.get(step.klass, f"visit poses that differ more at {step.target}")
        if step.needs_repeats:
            how = "visit the first poses once more at the end"
        if step.needs_length:
            how = f"{MEASURED_LENGTH}; no pose tells the size of the whole"
        out.append(
            f"To tell {name_of(step.term)} of {listed_words(sensors)} from "
            f"{listed_words(others[:3])}: {how}."
        )
    left = result.unexplained
    if result.verdict in OPEN and left is not None and left.kind != "noise":
        out.append(f"What is left: {left.text}")
    costs = [(h.platform_rms.position or 0.0, h) for h in result.could_hide if h.platform_rms]
    if costs:
        cost, worst = max(costs, key=lambda pair: pair[0])
        at = f" at {worst.place}" if worst.place else ""
        what = f"{name_of(worst.term)} of {target_words('', worst.target)}{at}"
        out.append(
            f"What could still hide costs up to {number(cost, 2)} {result.length_unit} ({what}): "
            "poses at the edges of the workspace show it best."
        )
    return out

"""The HTML report: one file, no network, light and dark, readable when printed."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from pathlib import Path

from rsicalib.facts.shapes import Evidence, Parameter, ResultShape, Step, TraceShape
from rsicalib.facts.verdicts import EXIT_CODES
from rsicalib.plain_text import counted
from rsicalib.report.certainty import certainty_html
from rsicalib.report.checks import noise_figure, reliability_figure, reliability_rows
from rsicalib.report.effects import effect_figures, scores_figure, scores_words
from rsicalib.report.figure import STYLE, Figure, data_element, whole
from rsicalib.report.mechanism import mechanism_figure
from rsicalib.report.plain import plain_words
from rsicalib.report.residuals import Dots, dots_of, normal_figure, residual_figure
from rsicalib.report.scene import scene_of
from rsicalib.report.switches import switchboard_html
from rsicalib.report.words import (
    IN_PYTHON,
    OPEN,
    Kept,
    advice,
    between_words,
    capital,
    comparison,
    elsewhere_words,
    judged_words,
    labelled,
    law_words,
    left_out,
    moved_words,
    name_of,
    noise_words,
    noisier,
    not_applied,
    not_tried,
    number,
    p_is,
    parameter_name,
    place_words,
    plus_minus,
    quality,
    sentence,
    size_words,
    subject,
    target_words,
    with_bounds,
)
from rsicalib.report.workspace import workspace_figure
from rsicalib.units import HALF_95, with_unit

FEW = 3
"""Sentences of a list that are not folded."""

SCRIPT = "".join(
    f"{Path(__file__).with_name(name).read_text(encoding='utf-8')}\n"
    for name in ("pictures.js", "turn.js", "script.js")
)
"""Scripts of every page; each does nothing where the page has nothing for it."""


def html(
    result: ResultShape,
    evidence: Evidence | None = None,
    target: float | None = None,
    kept: Kept = IN_PYTHON,
) -> str:
    """Write the report as one HTML file that needs no network.

    Parameters
    ----------
    result : Calibration or Trace
        What was found.
    evidence : Evidence, optional
        What the pictures are drawn from; there are fewer without it.
    target : float, optional
        Standard deviation of what is carried that is aimed at [length unit].
    kept : Kept, optional
        Where the result stands; in memory where not given.

    Returns
    -------
    str
        The document.
    """
    if is_garbage(result):
        parts = [
            _garbage(result, kept),
            _warnings(result),
            _folded("How it was computed", _about(result)),
        ]
        return document(f"{result.mechanism}: {result.verdict}", parts, _whose(result))
    calm = result.verdict == "adequate" and not result.excluded and not result.warnings
    parts = [
        _residuals(result, evidence),
        _found(result, evidence) if isinstance(result, TraceShape) else "",
        _switchboard(result, evidence),
        _workspace(result, evidence, target),
        _excluded(result),
        _moved(result),
        _parameters(result),
        _readings(result, evidence),
        _hidden(result) if isinstance(result, TraceShape) else "",
        _warnings(result),
        _about(result),
    ]
    # Where nothing is the matter the first screen says it all.
    if calm:
        parts.insert(0, section(*_errors(result)))
        parts = [_folded("Everything else: errors, residuals, workspace, parameters", *parts)]
    first = _first_screen(result, evidence, kept, calm=calm)
    title = f"{result.mechanism}: {result.verdict or 'calibrated'}"
    return document(title, [first, *parts], _whose(result))


def mechanism_page(result: ResultShape, evidence: Evidence) -> str:
    """Write a page of the mechanism alone, which turns by itself until it is held.

    Parameters
    ----------
    result, evidence
        As in `html`.

    Returns
    -------
    str
        The document; empty where nothing is carried.
    """
    figure = mechanism_figure(result, evidence, dots_of(result, evidence))
    if figure is None:
        return ""
    drawn = figure.html().replace('<figure id="mechanism"', '<figure id="mechanism" data-moving', 1)
    title = f"{result.mechanism} in its poses"
    parts = [f"<h1>{escape(title)}</h1>", _headline(result, evidence), drawn]
    return document(title, parts)


def figures(
    result: ResultShape, evidence: Evidence | None = None, target: float | None = None
) -> dict[str, str]:
    """Every figure of the report as an SVG file, by name.

    Parameters
    ----------
    result : Calibration or Trace
        What was found.
    evidence, target : optional
        As in `html`.

    Returns
    -------
    dict of str to str
        Name without an ending, and the text of the file.
    """
    if is_garbage(result):
        return {}
    found = [residual_figure(result, evidence), normal_figure(result)]
    if isinstance(result, TraceShape):
        found += _effects(result, evidence)
    if evidence is not None:
        found.append(mechanism_figure(result, evidence, dots_of(result, evidence)))
        found.append(workspace_figure(result, evidence, target))
        if evidence.reliability is not None:
            found.append(reliability_figure(result, evidence.reliability))
    found.append(_noise(result))
    return {figure.name: figure.svg() for figure in found if figure is not None}


def document(title: str, parts: Iterable[str], running: str = "") -> str:
    """A page of these parts; `running` stands at the top of each sheet that is printed."""
    body = "\n".join(part for part in parts if part)
    script = f"<script>\n{SCRIPT}</script>\n"
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(title)}</title>\n<style>\n{STYLE}{_sheet(running)}</style>\n</head>\n"
        f"<body>\n<main>\n{body}\n</main>\n{script}</body>\n</html>\n"
    )


def _sheet(running: str) -> str:
    """The head of a printed sheet; no text in it can end the string or the element."""
    if not running:
        return ""
    text = "".join(c if c.isalnum() or c in " .-:" else f"\\{ord(c):x} " for c in running)
    number = 'counter(page) " / " counter(pages)'
    return (
        f'@page {{ margin: 16mm 15mm 12mm; @top-left {{ content: "{text}"; font-size: 8pt; }} '
        f"@top-right {{ content: {number}; font-size: 8pt; }} }}\n"
    )


def table(
    heads: Sequence[str],
    rows: Iterable[Sequence[str]],
    text: int = 1,
    words: str = "",
    *,
    long: str | None = None,
    links: Mapping[str, str] | None = None,
    wide: bool = False,
) -> str:
    """A table: the first `text` columns are words, `long` one of sentences, the others numbers;
    cells that are in `links` lead there. A `wide` one is not printed in two columns.
    """

    def cells(row: Sequence[str], tag: str) -> str:
        kinds = ["" if k < text else ' class="n"' for k in range(len(row))]
        if long in heads:
            kinds[heads.index(long)] = ' class="long"'
        out = []
        for k, (kind, cell) in enumerate(zip(kinds, row, strict=True)):
            own = tag if cell else "td"  # a head without words is none
            shown = whole(escape(cell)) if k < text or heads[k] == long else _number(cell)
            if links and k == 0 and cell in links:
                shown = f'<a href="{escape(links[cell])}">{shown}</a>'
            out.append(f"<{own}{kind}>{shown}</{own}>")
        return "".join(out)

    body = "\n".join(f"<tr>{cells(row, 'td')}</tr>" for row in rows)
    head = f"<thead><tr>{cells(heads, 'th')}</tr></thead>"
    named = f' role="region" aria-label="{escape(words)}" tabindex="0"' if words else ""
    kind = "scroll wide" if wide else "scroll"
    return f'<div class="{kind}"{named}><table>{head}\n<tbody>\n{body}\n</tbody></table></div>'


def _number(cell: str) -> str:
    """A cell with numbers: where it is too wide, a line begins with what is between two of them."""
    return re.sub("(?<=[±…]) | (?=%)", "\u00a0", escape(cell))


def section(title: str, *parts: str) -> str:
    """A titled section; nothing where there is nothing in it."""
    inner = "\n".join(part for part in parts if part)
    return f"<section><h2>{escape(title)}</h2>\n{inner}</section>" if inner else ""


def listed(items: Iterable[str], kind: str = "") -> str:
    """A list of sentences."""
    inner = "\n".join(f"<li>{whole(escape(item))}</li>" for item in items)
    return f"<ul{f' class={kind}' if kind else ''}>\n{inner}\n</ul>" if inner else ""


def _said(text: str) -> str:
    """A paragraph of plain words."""
    return f"<p>{whole(escape(text))}</p>"


def pictures(found: Iterable[Figure | None]) -> str:
    """Figures side by side where there is room."""
    inner = "\n".join(figure.html() for figure in found if figure is not None)
    return f'<div class="pictures">{inner}</div>' if inner else ""


def _folded(title: str, *parts: str) -> str:
    inner = "\n".join(part for part in parts if part)
    return f"<details><summary>{escape(title)}</summary>\n{inner}</details>" if inner else ""


def _said_first(result: ResultShape, evidence: Evidence | None, experts: str = "") -> str:
    """What is the matter, in words for people and for experts, and how sure that is."""
    good = "good" if EXIT_CODES[result.verdict] == 0 else "bad"
    parts = [
        f"<h1>{escape(_whose(result))}</h1>",
        f'<p class="verdict {good}">{whole(escape(plain_words(result, evidence)))}</p>',
        certainty_html(result, evidence),
        f'<p class="experts">{whole(escape(experts or sentence(result)))}</p>',
        f"<p>{escape(result.note)}</p>" if result.note else "",
    ]
    return "\n".join(parts)


def _next(result: ResultShape, kept: Kept) -> str:
    advised = _heading("What to do next", listed(advice(result, kept), "next"))
    return f'{advised}\n<p class="faint">{whole(escape(_data(result)))}</p>'


def _garbage(result: ResultShape, kept: Kept) -> str:
    """The first screen of readings that are not of this mechanism: why, and nothing else."""
    steps = result.steps if isinstance(result, TraceShape) else ()
    # The list beside it says why.
    experts = "" if steps else f"Implausible: {judged_words(quality(result))}."
    return (
        f'<header class="first"><div class="said">{_said_first(result, None, experts)}</div>\n'
        f'<div class="hero">{_why_garbage(result)}\n{_next(result, kept)}</div></header>'
    )


def _first_screen(result: ResultShape, evidence: Evidence | None, kept: Kept, *, calm: bool) -> str:
    figure = mechanism_figure(result, evidence, dots_of(result, evidence)) if evidence else None
    said = _said_first(result, evidence)
    more = ("" if calm else _heading(*_errors(result)) + "\n") + _next(result, kept)
    if figure is None:
        return f"<header>{said}\n{more}</header>"
    return (
        f'<header class="first"><div class="said">{said}</div>\n'
        f'<div class="hero">{_headline(result, evidence)}{figure.html()}</div>\n'
        f'<div class="more">{more}</div></header>'
    )


def _headline(result: ResultShape, evidence: Evidence | None) -> str:
    """The error at known poses, in figures that are read first; `script.js` shows that of what is
    chosen.
    """
    (_, rows), unit = comparison(result), result.length_unit
    row = next((row for row in rows if row.kind == "position"), None)
    if row is None:
        return ""
    first, drawn = row.before, ""
    steps = result.steps if isinstance(result, TraceShape) else ()
    if not any(step.applied for step in steps):
        first = None  # nothing has changed since
    elif first is None and (error := _as_drawn(evidence)):
        first, drawn = error, " as drawn"
    old = "" if first is None else f"<del>{escape(first)}</del>{drawn} → "
    kept = "" if all(step.applied for step in steps) else " data-kept"
    now = f"<strong data-now{kept}>{escape(row.cells[2])}</strong> {escape(unit)}"
    return f'<p class="headline">{old}{now} <span>off at {escape(row.at)} (rms)</span></p>'


def _as_drawn(evidence: Evidence | None) -> str:
    """Error at known poses with the mechanism as it is declared, rms of components."""
    known = evidence.drawing.known if evidence is not None and evidence.drawing else ()
    off = [b - a for k in known for a, b in zip(k.at, k.before, strict=True)]
    size = math.sqrt(sum(v * v for v in off) / len(off)) if off else 0.0
    return number(size) if math.isfinite(size) and size > 0.0 else ""


def _whose(result: ResultShape) -> str:
    """What was calibrated, and when."""
    named = [result.device, result.valid_from]
    return f"Calibration of {result.mechanism}" + "".join(f" · {n}" for n in named if n)


def is_garbage(result: ResultShape) -> bool:
    """True where the readings are not of this mechanism: what is drawn of them means nothing."""
    return result.verdict == "implausible"


def _why_garbage(result: ResultShape) -> str:
    return _heading("Why it cannot be used", listed(why.text for why in result.implausible))


def _residuals(result: ResultShape, evidence: Evidence | None) -> str:
    figure = residual_figure(result, evidence)
    dots = dots_of(result, evidence)
    if figure is None:
        return ""
    named = ""
    if evidence is not None and dots is not None and dots.size == 1 and evidence.readings:
        data = {"poses": _readings_of(evidence, dots)}
        named = '<p id="pose-words" hidden></p>' + data_element("poses-data", data)
    drawn = pictures([figure, normal_figure(result)])
    return section("What is left, pose by pose", drawn, named)


def _readings_of(evidence: Evidence, dots: Dots) -> list[str]:
    """The readings of each pose, as they are shown where it is pointed at."""
    return [
        f"{label}: "
        + ", ".join(
            f"{name} {number(value, 5)}" for name, value in zip(evidence.channels, row, strict=True)
        )
        for label, row in zip(dots.labels, evidence.readings, strict=False)
    ]


def _heading(title: str, inner: str) -> str:
    return f"<h2>{escape(title)}</h2>\n{inner}" if inner else ""


def _data(result: ResultShape) -> str:
    readings = result.readings
    names = [re.split(r"[/\\]", file)[-1] for file in readings.files]
    files = f" {'Files' if len(names) > 1 else 'File'}: {', '.join(names)}." if names else ""
    between = between_words(result)
    groups = f"Between groups: {between}. " if between else ""
    taken = f"{counted(readings.poses, 'pose')}, {counted(readings.samples, 'sample')}"
    return (
        f"{taken}. Noise {noise_words(result)}. {groups}"
        f"Unit of length {result.length_unit}, of angles rad.{files}"
    )


def _errors(result: ResultShape) -> tuple[str, str]:
    """Title and table of the error; of one column where nothing has changed it."""
    heads, rows = comparison(result)
    title = "Error before and after"
    if not rows:
        return title, ""
    kept = ""
    if isinstance(result, TraceShape) and not all(step.applied for step in result.steps):
        words = "What was found is not applied to positions: check poses err as they did before."
        kept = f'\n<p class="faint">{words}</p>' * any(row.at for row in rows)
    if all(row.before is None for row in rows):
        alone = [row.cells[::2] for row in rows]
        return "Error", table(["", "calibrated"], alone, words="error")
    return title, table(["", *heads], [row.cells for row in rows], words=title.lower()) + kept


def _effects(result: TraceShape, evidence: Evidence | None) -> list[Figure | None]:
    """Figures of all effects, in their order."""
    found: list[Figure | None] = []
    for k, step in enumerate(result.steps):
        found += effect_figures(step, evidence, k)
    if evidence is not None and not result.steps:
        found.append(scores_figure(evidence.left, "left-scores"))
    return found


def _found(result: TraceShape, evidence: Evidence | None) -> str:
    parts = []
    for k, step in enumerate(result.steps):
        parts.append(f"<h3>{whole(escape(f'{subject(step)}: {size_words(step)}'))}</h3>")
        parts.append(_said(_cost(step, result.length_unit)))
        parts += [] if step.applied else [f"<p>{capital(not_applied(step))}.</p>"]
        parts.append(pictures(effect_figures(step, evidence, k)))
    if words := elsewhere_words(result):
        parts.append(_said(f"{capital(words)}."))
    if result.unexplained is not None:
        left = result.unexplained
        p = "" if left.p_value is None else f" ({p_is(left.p_value)})"
        told = f"What is left{place_words(result)} is described under “What to do next”"
        said = told if result.verdict in OPEN else capital(left.text).rstrip(".")
        parts.append(_said(f"{said}{p}."))
    if evidence is not None and not result.steps:
        drawn = scores_figure(evidence.left, "left-scores")
        said = _said(scores_words(evidence.left)) if evidence.left else ""
        parts.append(pictures([drawn]) if drawn else said)
    return section("What was found", *parts)


def _cost(step: Step, unit: str) -> str:
    out = f"Chance lets χ² rise so much without it with {p_is(step.p_value)}. "
    if step.platform_rms is not None:
        rms = step.platform_rms
        turned = "" if rms.orientation is None else f" and {number(rms.orientation, 2)} rad"
        out += (
            f"It moved {moved_words(rms)} by {number(rms.position, 2)} {unit}{turned} (rms), after "
            "the other parameters had absorbed what they can. "
        )
    if step.also_fits:
        names = ", ".join(subject(n) for n in step.also_fits)
        out += f"These poses cannot tell it from: {names}. "
    if step.curve_law is not None:
        words = law_words(step.curve_law)
        out += f"{words[0].upper()}{words[1:]}, for the readings and times that occur."
    return out.strip()


def _switchboard(result: ResultShape, evidence: Evidence | None) -> str:
    dots = dots_of(result, evidence)
    if evidence is None or dots is None or not (evidence.switchboard or evidence.hypotheses):
        return ""
    scene = scene_of(result, evidence)
    return section(
        "What if it were something else?", switchboard_html(result, evidence, dots, scene)
    )


def _workspace(result: ResultShape, evidence: Evidence | None, target: float | None) -> str:
    if evidence is None:
        return ""
    return section("Over the workspace", pictures([workspace_figure(result, evidence, target)]))


def _excluded(result: ResultShape) -> str:
    skipped = [f"line {s.line}, {s.column}: {s.reason}" for s in result.readings.skipped]
    out = section("Readings left out", listed([*left_out(result), *skipped]))
    return out + section("Readings that count as noisier", listed(noisier(result)))


def _moved(result: ResultShape) -> str:
    if result.moved is None:
        return ""
    rows = [
        (
            parameter_name(m.term, m.name),
            m.target,
            number(m.before, 6),
            number(m.after, 6),
            number(m.sd, 2),
            m.unit,
        )
        for m in result.moved
    ]
    heads = ("term", "target", "before", "after", "sd of the difference", "unit")
    found = (
        table(heads, rows, 2, "parameters that moved")
        if rows
        else "<p>No parameter moved beyond both uncertainties.</p>"
    )
    update = "" if result.update is None else f"<p>{escape(capital(result.update.text))}.</p>"
    return section("Against the earlier calibration", update, found)


def _parameters(result: ResultShape) -> str:
    whole = result.with_excluded.parameters if result.with_excluded else ()
    before = {(p.spec, p.name): p for p in whole}
    superseding = any(p.earlier is not None for p in result.parameters)
    heads = ["target", "parameter", "value", "± 95 %", "unit"]
    grouped = any(p.sd_between is not None for p in result.parameters)
    heads += [f"± 95 % between {result.between.kind}s"] if grouped and result.between else []
    heads += ["earlier", "change [σ]"] * superseding
    heads += ["with what was left out"] * bool(whole)
    rows = []
    for p in result.parameters:
        value, half = with_bounds(p)
        name = parameter_name(p.term, p.name)
        target = labelled(p.target, result.labels.get(p.target))
        times = dict.fromkeys(p.place_interval or ())
        within = f" ({' to '.join(times)})" if len(times) > 1 else ""
        target = target if p.place is None else f"{target} at {p.place}{within}"
        old = before.get((p.spec, p.name))
        all_readings = plus_minus(old.value, old.sd)[0] if old else "–"
        earlier = _earlier(p) if superseding else ()
        wide = plus_minus(p.value, None if p.sd_between is None else HALF_95 * p.sd_between)[1]
        earlier = (*([wide] * (grouped and result.between is not None)), *earlier)
        rows.append((target, name, value, half, p.unit, *earlier, *[all_readings] * bool(whole)))
    found = table(heads, rows, 2, "parameters") if rows else ""
    if superseding:
        found += (
            '<p class="faint">The change is in standard deviations of the difference, by both '
            "uncertainties: between -2 and 2 it is what chance does.</p>"
        )
    notes = listed(f"Not determined: {text}" for text in result.unobservable)
    weak = listed(f"Weak: {text}" for text in result.weak)
    if len(result.weak) > FEW:
        weak = _folded(f"{len(result.weak)} combinations that the readings hardly tell", weak)
    folded = (
        _folded(f"{counted(len(rows), 'parameter')} with their 95 % intervals", found)
        if rows
        else ""
    )
    return section("Parameters", folded, notes, weak)


def _earlier(p: Parameter) -> tuple[str, str]:
    """The earlier value, as exact as the new one, and the change in units of both uncertainties."""
    if p.earlier is None:
        return "–", "–"
    known = plus_minus(p.earlier.value, None if p.sd is None else HALF_95 * p.sd)[0]
    return known, "–" if p.change is None else f"{p.change:+z.1f}"


def _noise(result: ResultShape) -> Figure | None:
    """The noise of the channels, where it differs: bars of one length show nothing."""
    noise = result.noise
    differs = noise is not None and len(set(noise.sigma.values())) > 1
    return noise_figure(noise) if noise is not None and differs else None


def _readings(result: ResultShape, evidence: Evidence | None) -> str:
    drawn: list[Figure | None] = []
    drawn.append(_noise(result))
    rows = ""
    found = evidence.reliability if evidence else None
    if found is not None:
        drawn.append(reliability_figure(result, found))
        heads = ("channel", "usual", "largest", "external, largest", "unchecked poses")
        rows = table(heads, reliability_rows(result, found), 1, "reliability by channel")
        rows = _folded("Minimum detectable error and external reliability by channel", rows)
        rows += (
            '<p class="faint">After Baarda: an error of the channel\'s mean reading in one pose is '
            "seen from the detectable size on, at the level 0.001 in four sessions of five, in the "
            "channel's unit. External reliability is what an error just below that size does to "
            "the worst-hit combination of parameters, in its standard deviations.</p>"
        )
    return section("Readings", pictures(drawn), rows)


def _hidden(result: TraceShape) -> str:
    shown = result.could_hide[:12]
    known = [h.platform_rms for h in shown if h.platform_rms is not None]
    costs = 2 if any(rms.orientation is not None for rms in known) else min(len(known), 1)
    rows = []
    for h in shown:
        rms = h.platform_rms
        cost = ("–", "–") if rms is None else (number(rms.position, 2), number(rms.orientation, 2))
        size = with_unit(number(h.detectable, 2), h.unit)
        size = "not seen at any size" if h.detectable is None else size
        target = labelled(target_words("", h.target), h.label)
        target = target if h.place is None else f"{target} at {h.place}"
        rows.append((name_of(h.term), target, size, *cost[:costs]))
    heads = ["effect", "target", "seen from"]
    heads += [f"position [{result.length_unit}]", "orientation [rad]"][:costs]
    note = "How large an absent effect would have to be to be seen in these poses"
    note += (
        f", and what it would do to {moved_words(known[0])} meanwhile: the costliest first."
        if known
        else "."
    )
    found = table(heads, rows, 2, "what could hide")
    return section("What could hide", f"<p>{note}</p>", found) if rows else ""


def _warnings(result: ResultShape) -> str:
    return section("Warnings", listed(map(str, result.warnings)))


def _about(result: ResultShape) -> str:
    starts = len(result.starts)
    begun = f"{counted(starts, 'start')}; " * bool(starts)
    items = [
        f"rsicalib {result.version}, method {result.method}",
        f"condition number {number(result.condition)}; {begun}{result.termination}",
    ]
    if result.noise is not None and result.noise.correlation is not None:
        items.append(f"correlation of neighbouring samples {number(result.noise.correlation, 2)}")
    if isinstance(result, TraceShape):
        items += [f"not tried: {words}" for words in not_tried(result)]
    code = f"<code>{escape(result.readings.sha256)}</code>"
    digest = f'<p class="faint">SHA-256 of the readings {code}</p>'
    return section("How", f'<div class="faint">{listed(items)}</div>', digest)

"""The HTML report: one file, no network, light and dark, readable when printed."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape

import numpy as np

from rsicalib.report import svg
from rsicalib.report.words import (
    advice,
    comparison,
    curve_unit,
    excluded_words,
    name_of,
    noise_words,
    number,
    p_is,
    plus_minus,
    quality,
    sentence,
    size_words,
    subject,
)
from rsicalib.shapes import ResultShape, Step, TraceShape
from rsicalib.verdicts import EXIT_CODES

__all__ = ["html", "residual_figure"]

STYLE = """
:root { color-scheme: light dark; --ink: #1c1c1a; --paper: #fdfdfb; --faint: #6d6d66;
  --rule: #dcdcd4; --accent: #1f5f8b; --soft: #1f5f8b26; --good: #2e6b3a; --bad: #a33b20; }
@media (prefers-color-scheme: dark) { :root { --ink: #e6e6e0; --paper: #171816; --faint: #9a9a92;
  --rule: #363732; --accent: #7db8e0; --soft: #7db8e033; --good: #86c493; --bad: #ec9176; } }
* { box-sizing: border-box; }
body { margin: 0 auto; padding: 2.5rem 1.25rem 4rem; max-width: 50rem; background: var(--paper);
  color: var(--ink); font: 16px/1.55 Charter, "Bitstream Charter", Georgia, serif; }
h1 { font-size: 1.05rem; font-weight: normal; color: var(--faint); margin: 0 0 .6rem; }
h2 { font-size: 1.15rem; margin: 2.6rem 0 .6rem; padding-top: .7rem;
  border-top: 1px solid var(--rule); }
p.verdict { font-size: 1.5rem; line-height: 1.35; margin: 0 0 1rem; padding-left: .9rem; }
p.good { border-left: .25rem solid var(--good); } p.bad { border-left: .25rem solid var(--bad); }
p, li { max-width: 42rem; }
.faint, figcaption { color: var(--faint); font-size: .9rem; }
table { border-collapse: collapse; width: 100%; font-size: .92rem;
  font-variant-numeric: tabular-nums; }
th { font-weight: normal; color: var(--faint); text-align: left; }
th, td { padding: .22rem .7rem .22rem 0; border-bottom: 1px solid var(--rule);
  vertical-align: top; }
td.n, th.n { text-align: right; white-space: nowrap; }
.wide { overflow-x: auto; }
figure { margin: 1rem 0; } svg { width: 100%; height: auto; display: block; }
svg text { font: 12px ui-sans-serif, system-ui, sans-serif; fill: var(--faint); }
svg text.title { font-size: 13px; fill: var(--ink); }
svg .grid { stroke: var(--rule); } svg .zero, svg .axis { stroke: var(--faint); }
svg .dot { fill: var(--accent); fill-opacity: .75; } svg .noise, svg .band { fill: var(--soft); }
svg .curve { fill: none; stroke: var(--accent); stroke-width: 2; }
code { font: .88em ui-monospace, monospace; overflow-wrap: anywhere; }
@media print { body { font-size: 11pt; padding: 0; max-width: none; } h2 { break-after: avoid; }
  figure, tr { break-inside: avoid; } }
"""

MOST_DOTS = 300
"""A longer recording is drawn in blocks."""


def html(result: ResultShape) -> str:
    """Write the report as one HTML file that needs no network.

    Parameters
    ----------
    result : Calibration or Trace
        What was found.

    Returns
    -------
    str
        The document.
    """
    good = "good" if EXIT_CODES[result.verdict] == 0 else "bad"
    parts = [
        f"<h1>Calibration of {escape(result.mechanism)}</h1>",
        f'<p class="verdict {good}">{escape(sentence(result))}</p>',
        f'<p class="faint">{escape(_data(result))}</p>',
        _errors(result),
        _residuals(result),
    ]
    if isinstance(result, TraceShape):
        parts.append(_found(result))
    parts += [_excluded(result), _moved(result), _parameters(result)]
    if isinstance(result, TraceShape):
        parts.append(_hidden(result))
    parts += [_next(result), _warnings(result), _about(result)]
    body = "\n".join(part for part in parts if part)
    title = escape(f"{result.mechanism}: {result.verdict or 'calibrated'}")
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{title}</title>\n<style>{STYLE}</style>\n</head>\n<body>\n{body}\n</body>\n</html>\n"
    )


def residual_figure(result: ResultShape) -> str:
    """Draw the residual of every pose in units of noise, before and after; empty if not known."""
    panels = [
        (title, _blocks(rows))
        for title, rows in (("before", result.before_residuals), ("after", result.after_residuals))
        if rows is not None and rows.size
    ]
    if len(panels) == 1:
        panels = [("every closure of every pose", panels[0][1])]
    count = len(panels[0][1]) if panels else 0
    whole = count == result.readings.poses
    words = "pose, in the order of the readings" if whole else "block of the recording"
    return svg.residuals(panels, words) if panels else ""


def _blocks(rows: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> list[list[float]]:
    """Residuals of blocks of rows, still in units of noise."""
    size = -(-len(rows) // MOST_DOTS)
    if size == 1:
        return np.asarray(rows).tolist()  # type: ignore[no-any-return]
    starts = np.arange(0, len(rows), size)
    sizes = np.diff(np.append(starts, len(rows)))
    return (np.add.reduceat(rows, starts, axis=0) / np.sqrt(sizes)[:, None]).tolist()  # type: ignore[no-any-return]


def _table(heads: Sequence[str], rows: Iterable[Sequence[str]], text: int = 1) -> str:
    """A table whose first `text` columns are words, the others numbers."""

    def cells(row: Sequence[str], tag: str) -> str:
        kinds = ["" if k < text else ' class="n"' for k in range(len(row))]
        return "".join(
            f"<{tag}{kind}>{escape(cell)}</{tag}>" for kind, cell in zip(kinds, row, strict=True)
        )

    body = "\n".join(f"<tr>{cells(row, 'td')}</tr>" for row in rows)
    head = f"<thead><tr>{cells(heads, 'th')}</tr></thead>"
    return f'<div class="wide"><table>{head}\n<tbody>\n{body}\n</tbody></table></div>'


def _section(title: str, *parts: str) -> str:
    inner = "\n".join(part for part in parts if part)
    return f"<h2>{escape(title)}</h2>\n{inner}" if inner else ""


def _list(items: Iterable[str]) -> str:
    inner = "\n".join(f"<li>{escape(item)}</li>" for item in items)
    return f"<ul>\n{inner}\n</ul>" if inner else ""


def _data(result: ResultShape) -> str:
    readings = result.readings
    return (
        f"{readings.poses} poses, {readings.samples} samples. Noise {noise_words(result)}. "
        f"Unit of length {result.length_unit}, of angles rad."
    )


def _errors(result: ResultShape) -> str:
    heads, rows = comparison(result)
    note = (
        ""
        if quality(result).check
        else (
            '<p class="faint">Closure is not accuracy: no known poses were given, so the error of '
            "the platform is not known.</p>"
        )
    )
    return _section("Error before and after", _table(["", *heads], rows) if rows else "", note)


def _residuals(result: ResultShape) -> str:
    figure = residual_figure(result)
    if not figure:
        return ""
    caption = (
        "Each dot is one closure of one pose; the band is ± 2 σ, where 95 % belong if nothing "
        "is missing."
    )
    return _section(
        "Residual in units of noise",
        f"<figure>{figure}<figcaption>{escape(caption)}</figcaption></figure>",
    )


def _found(result: TraceShape) -> str:
    parts = []
    for step in result.steps:
        parts.append(f"<p><strong>{escape(subject(step))}</strong>: {escape(size_words(step))}.")
        parts.append(escape(_cost(step, result.length_unit)) + "</p>")
        if step.curve:
            words = f"correction of {step.target}, with its 95 % band"
            over = f"reading of {step.target}"
            if step.curve_over == "time":
                over = "time, 0 to 1 over the session"
            figure = svg.band_curve(
                step.curve,
                step.curve_sd,
                escape(words),
                escape(over),
                f"correction [{curve_unit(step)}]",
            )
            parts.append(f"<figure>{figure}</figure>")
    if result.unexplained is not None:
        left = result.unexplained
        p = "" if left.p_value is None else f" ({p_is(left.p_value)})"
        parts.append(f"<p>Left over: {escape(left.text)}{escape(p)}.</p>")
    return _section("What was found", *parts)


def _cost(step: Step, unit: str) -> str:
    out = f"Its score is one that chance gives with {p_is(step.p_value)}. "
    if step.platform_rms is not None:
        rms = step.platform_rms
        out += (
            f"It moved the platform by {number(rms.position, 2)} {unit} and "
            f"{number(rms.orientation, 2)} rad (rms), after the other parameters had absorbed "
            "what they can. "
        )
    if step.also_fits:
        names = ", ".join(subject(n) for n in step.also_fits)
        out += f"These poses cannot tell it from: {names}."
    return out.strip()


def _excluded(result: ResultShape) -> str:
    skipped = [f"line {s.line}, {s.column}: {s.reason}" for s in result.readings.skipped]
    return _section("Readings left out", _list([*map(excluded_words, result.excluded), *skipped]))


def _moved(result: ResultShape) -> str:
    if result.moved is None:
        return ""
    rows = [
        (
            f"{name_of(m.term)} {m.name}",
            m.target,
            number(m.before, 6),
            number(m.after, 6),
            number(m.sd, 2),
            m.unit,
        )
        for m in result.moved
    ]
    heads = ("term", "target", "before", "after", "sd of the difference", "unit")
    table = (
        _table(heads, rows, 2) if rows else "<p>No parameter moved beyond both uncertainties.</p>"
    )
    return _section("Against the earlier calibration", table)


def _parameters(result: ResultShape) -> str:
    whole = result.with_excluded.parameters if result.with_excluded else ()
    before = {(p.spec, p.name): p for p in whole}
    heads = ["target", "parameter", "value", "± 95 %", "unit"]
    heads += ["with what was left out"] * bool(whole)
    rows = []
    for p in result.parameters:
        value, half = plus_minus(p.value, None if p.sd is None else 1.96 * p.sd)
        name = name_of(p.term) if p.name == p.term else f"{name_of(p.term)} {p.name}"
        target = p.target if p.place is None else f"{p.target} at {p.place}"
        old = before.get((p.spec, p.name))
        all_readings = plus_minus(old.value, old.sd)[0] if old else "–"
        rows.append((target, name, value, half, p.unit, *[all_readings] * bool(whole)))
    table = _table(heads, rows, 2) if rows else ""
    notes = [f"Not determined: {text}" for text in result.unobservable]
    notes += [f"Weak: {text}" for text in result.weak]
    return _section("Parameters", table, _list(notes))


def _hidden(result: TraceShape) -> str:
    rows = []
    for h in result.could_hide[:12]:
        rms = h.platform_rms
        cost = ("–", "–") if rms is None else (number(rms.position, 2), number(rms.orientation, 2))
        rows.append((name_of(h.term), h.target, f"{number(h.detectable, 2)} {h.unit}", *cost))
    heads = (
        "effect",
        "target",
        "seen from",
        f"position [{result.length_unit}]",
        "orientation [rad]",
    )
    note = (
        "How large an absent effect would have to be to be seen in these poses, and what it would "
        "do to the platform meanwhile: the costliest first."
    )
    return _section("What could hide", f"<p>{note}</p>", _table(heads, rows, 2)) if rows else ""


def _next(result: ResultShape) -> str:
    return _section("What to do next", _list(advice(result)))


def _warnings(result: ResultShape) -> str:
    return _section("Warnings", _list(result.warnings))


def _about(result: ResultShape) -> str:
    starts = len(result.starts)
    items = [
        f"rsicalib {result.version}, method {result.method}",
        f"condition number {number(result.condition)}; {starts} start{'s' * (starts != 1)}; "
        f"{result.termination}",
    ]
    if result.noise is not None and result.noise.correlation is not None:
        items.append(f"correlation of neighbouring samples {number(result.noise.correlation, 2)}")
    if isinstance(result, TraceShape):
        items += [f"not tried, for lack of a {needs}: {names}" for needs, names in _lacking(result)]
    code = f"<code>{escape(result.readings.sha256)}</code>"
    digest = f'<p class="faint">SHA-256 of the readings {code}</p>'
    return _section("How", f'<div class="faint">{_list(items)}</div>', digest)


def _lacking(result: TraceShape) -> list[tuple[str, str]]:
    """What is lacking, and the terms that need it."""
    by_need: dict[str, list[str]] = {}
    for term, needs in result.not_candidates.items():
        by_need.setdefault(needs, []).append(name_of(term))
    return [(needs, ", ".join(names)) for needs, names in by_need.items()]

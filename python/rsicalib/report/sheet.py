"""The sheet of a certificate, which a quality department files: one printed page."""

from __future__ import annotations

from html import escape

from rsicalib.facts.certified import CertificateShape
from rsicalib.report.figure import Figure
from rsicalib.report.page import document, listed, section, table
from rsicalib.report.svg import WIDE, Axis, Canvas, ticks
from rsicalib.report.words import number


def sheet(found: CertificateShape) -> str:
    """The page, which needs no network.

    Parameters
    ----------
    found : CertificateShape
        What it says.

    Returns
    -------
    str
        HTML: the decision, what it is of, the budget, conditions, data, and room to sign.
    """
    good = "good" if found.decision == "within" else "bad"
    first = "".join(
        [
            "<div><h1>Certificate</h1>",
            f'<p class="verdict {good}">{escape(found.decided)}</p>',
            listed(found.reasons),
            _of(found),
            "</div>",
        ]
    )
    drawn = _figure(found)
    poses = f"<p><code>rsicalib {escape(found.decides)}</code></p>" if found.decides else ""
    rests = section("What it rests on", listed(found.rests_on))
    outside = section("What it does not cover", listed(found.not_covered))
    data = [f"SHA-256 of the readings: {found.data_sha256}", *found.files]
    parts = [
        f'<header class="pictures">{first}{drawn.html() if drawn else ""}</header>',
        section("Poses that may decide it", poses),
        section("Uncertainty", _budget(found)),
        section("Known errors", _known(found)),
        section("Conditions", listed(found.conditions)),
        f'<div class="pictures">{rests}{outside}</div>',
        section("Data", listed(data)),
        '<p class="signed"><span>Date</span><span>Name</span><span>Signature</span></p>',
    ]
    inner = "\n".join(part for part in parts if part)
    title = f"Certificate: {found.device or found.mechanism}: {found.decision}"
    return document(title, [f'<div class="sheet">{inner}</div>'])


def _of(found: CertificateShape) -> str:
    """What the certificate is of."""
    rows = [
        ("device", found.device or "not named"),
        ("mechanism", found.mechanism),
        ("parameters valid from", found.valid_from or "not stated"),
        ("verdict of the result", found.verdict.replace("_", " ")),
        (f"limit of the {found.quantity} error", f"{found.limit:g} {found.unit}"),
    ]
    if found.uncertainty is not None:
        expanded = f"{number(found.uncertainty.expanded)} {found.unit}"
        rows.append((f"U, {100 * found.confidence:g} %", expanded))
    rows += [
        (f"known error: {one.source}", f"{number(one.error)} {found.unit}") for one in found.known
    ]
    return table(("", ""), rows, 2, "what the certificate is of")


def _figure(found: CertificateShape) -> Figure | None:
    """Limit, expanded uncertainty and known errors on one scale."""
    if found.uncertainty is None:
        return None
    expanded, limit = found.uncertainty.expanded, found.limit
    applied = sum(one.error for one in found.known if one.expanded is None)
    rows = [(f"U: {number(expanded)}", applied, applied + expanded)]
    if applied:
        rows.insert(0, (f"effects not applied: {number(applied)}", 0.0, applied))
    else:
        rows = [(rows[0][0], 0.0, expanded)]
    for one in found.known:
        if one.expanded is not None:
            low, high = max(one.error - one.expanded, 0.0), one.error + one.expanded
            words = f"{one.source}: {number(one.error)} ± {number(one.expanded)}"
            rows.append((words, low, high))
    most = 1.08 * max(limit, *(high for _, _, high in rows))

    def draw(width: float) -> str:
        height = 44.0 * len(rows) + 62.0
        canvas = Canvas(width, height)
        across = Axis(0.0, most, 8.0, width - 14.0)
        floor = height - 34.0
        for k, (words, low, high) in enumerate(rows):
            top = 22.0 + 44.0 * k
            canvas.text(across.start, top + 10.0, words, kind="label")
            canvas.rect(across(low), top + 16.0, across(high) - across(low), 14.0, "chosen")
        canvas.line(across.start, floor, across.end, floor, "axis")
        for value in ticks(0.0, most, 6 if width >= WIDE else 3):
            canvas.line(across(value), floor, across(value), floor + 4.0, "axis")
            canvas.text(across(value), floor + 16.0, f"{value:g}", anchor="middle")
        canvas.line(across(limit), 14.0, across(limit), floor, "way before")
        anchor = "end" if across(limit) > width / 2 else "start"
        canvas.text(across(limit), 10.0, f"limit {limit:g} {found.unit}", anchor=anchor)
        words = f"largest {found.quantity} error [{found.unit}]"
        canvas.text((across.start + across.end) / 2, floor + 31.0, words, anchor="middle")
        return canvas.svg(f"limit {limit:g}, {', '.join(words for words, _, _ in rows)}")

    caption = (
        "Within: known error and U end before the limit. Not within: a known error, less its own "
        "uncertainty, begins beyond the limit. Else undecided (ISO 14253-1)."
    )
    return Figure("decision", draw, caption)


def _budget(found: CertificateShape) -> str:
    whole = found.uncertainty
    if whole is None:
        return ""
    words = (
        f"<p>With a probability of {100 * found.confidence:g} %, the largest error of "
        f"{whole.places} places, each read once, is not beyond U = "
        f"{escape(f'{number(whole.expanded)} {found.unit}')} (median {number(whole.median)}). "
        f"At the place that is known least u = {number(whole.u)}, degrees of freedom "
        f"{_dof(whole.dof)}; U / u = {number(whole.coverage_factor)}. The squares of the standard "
        "uncertainties u add up.</p>"
    )
    heads = ("source", "distribution", "size", "sensitivity", "degrees", f"u [{found.unit}]")
    rows = [
        (
            one.words,
            one.distribution,
            "–" if one.size is None else f"{number(one.size)} {one.size_unit or ''}".strip(),
            number(one.sensitivity),
            _dof(one.dof),
            number(one.u),
        )
        for one in whole.budget
    ]
    return words + table(heads, rows, 2, "budget of uncertainty")


def _known(found: CertificateShape) -> str:
    if not found.known:
        return "<p>None: no known poses were given, and every effect found is applied.</p>"
    heads = ("source", "poses", f"error [{found.unit}]", "its U")
    rows = [
        (one.source, str(one.poses), number(one.error), number(one.expanded)) for one in found.known
    ]
    return table(heads, rows, 1, "known errors")


def _dof(dof: float | None) -> str:
    return "∞" if dof is None else number(dof)

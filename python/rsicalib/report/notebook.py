"""How a notebook shows a result: verdict, error, what to do next, parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

from rsicalib.facts.shapes import ResultShape, TraceShape
from rsicalib.facts.verdicts import EXIT_CODES
from rsicalib.plain_text import counted
from rsicalib.report.words import advice, comparison, sentence, size_words, subject
from rsicalib.tabular import html_table


def result_html(result: ResultShape, parameters: Mapping[str, Sequence[Any]]) -> str:
    """Write a result for a notebook; text from files is escaped.

    Parameters
    ----------
    result : Calibration or Trace
        What was found.
    parameters : mapping of str to sequence
        Columns of its parameters.

    Returns
    -------
    str
        One `<div>`, which takes the colours of the page around it.
    """
    colour = "#2e6b3a" if EXIT_CODES.get(result.verdict) == 0 else "#a33b20"
    bar = f"border-left:4px solid {colour};padding-left:.7em;max-width:60em"
    parts = [f'<p style="{bar}"><b>{escape(sentence(result))}</b></p>']
    data = result.readings
    words = f"{result.mechanism}: {counted(data.poses, 'pose')}, {counted(data.samples, 'sample')}"
    parts.append(f"<p>{escape(words)}</p>")
    if isinstance(result, TraceShape) and result.steps:
        found = [f"{escape(subject(s))}: {escape(size_words(s))}" for s in result.steps]
        parts.append(f"<ul>{''.join(f'<li>{line}</li>' for line in found)}</ul>")
    heads, rows = comparison(result)
    if rows:
        columns = zip(*(row.cells for row in rows), strict=True)
        parts.append(html_table(dict(zip(("", *heads), columns, strict=True))))
    following = advice(result)
    if following:
        parts.append(
            f"<p>Next:</p><ul>{''.join(f'<li>{escape(line)}</li>' for line in following)}</ul>"
        )
    if parameters["name"]:
        count = len(parameters["name"])
        title = f"<summary>{counted(count, 'parameter')}</summary>"
        parts.append(f"<details>{title}{html_table(parameters)}</details>")
    return f"<div>{''.join(parts)}</div>"

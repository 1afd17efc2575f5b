"""The grid of a history: every parameter in its own standard deviations, events marked."""

from __future__ import annotations

import re

import numpy as np

from rsicalib.report.past import History, Jump, Past, Series

DATES = tuple(f"20{20 + k // 4}-{1 + 3 * (k % 4):02d}-01" for k in range(8))


def series(target: str, values: list[float], jumps: tuple[Jump, ...] = ()) -> Series:
    sd = (0.001,) * len(DATES)
    numbers = tuple(values)
    return Series("gain", target, "gain", "rad", DATES, numbers, sd, 0.0, 1.0, 0.5, jumps=jumps)


def test_a_row_has_its_distances_and_an_event_its_line() -> None:
    rng = np.random.default_rng(0)
    still = (1.0 + 0.001 * rng.standard_normal(8)).tolist()
    moved = [1.0] * 3 + [1.02] * 5
    jump = Jump(DATES[3], 0.02, 0.0005, told=True)
    history = History(
        device="no. 7",
        mechanism="rsi",
        length_unit="in",
        results=tuple(
            Past(f"{k}.json", date, "adequate", (), "new <pot>" if k == 3 else None)
            for k, date in enumerate(DATES)
        ),
        parameters=(series("a11", still), series("a12", moved, (jump,))),
        session_only=(),
        left_out=(),
    )
    page = history.page()
    wide = re.search(r'<figure id="sparklines"><div class="desk">(.*?)</div>', page, re.S)
    assert wide is not None
    said = re.findall(r"gain@(a1\d), [\d-]+: \S+ rad, (\S+) sd", wide[1])
    expected = [("a11", v) for v in still] + [("a12", v) for v in moved]
    middle = {"a11": np.median(still), "a12": np.median(moved)}
    assert said == [(at, f"{(v - middle[at]) / 0.001:+.1f}") for at, v in expected]
    assert wide[1].count('class="law jump"') == 1
    assert ">new &lt;pot&gt;</text>" in wide[1] and "<pot>" not in page

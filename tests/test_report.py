"""Reports: what they say, that they need no network, and that they hold for any result."""

from __future__ import annotations

import dataclasses
import re
import xml.etree.ElementTree as ET
from html.parser import HTMLParser

import numpy as np
import pytest

import rsicalib
from rsicalib import DEMO, Trace
from rsicalib.records import plain, to_json
from rsicalib.report import svg
from rsicalib.report.page import residual_figure
from rsicalib.report.words import noise_words, number, plus_minus, sentence
from rsicalib.results import Result
from rsicalib.shapes import Excluded, Noise, Unexplained

READINGS, REST, CHECK = (DEMO / f"{name}.csv" for name in ("readings", "rest", "check"))


@pytest.fixture(scope="module")
def traced() -> Trace:
    return rsicalib.demo()


def results() -> list[Result]:
    whole = rsicalib.load_readings(READINGS)
    return [
        rsicalib.demo(),
        rsicalib.calibrate(READINGS),
        rsicalib.calibrate(READINGS, rest=REST, check=CHECK, align=True),
        rsicalib.calibrate(READINGS, calibration=rsicalib.calibrate(READINGS)),
        rsicalib.calibrate(whole.select(whole.pose < 5)),
        rsicalib.trace(whole.select((whole.pose < 5) & (whole.sample == 1))),
        rsicalib.trace(whole.select(whole.sample == 1)),
        rsicalib.fixture(CHECK, check=CHECK),
    ]


class Balance(HTMLParser):
    """Every element is closed in its turn, and nothing is fetched from elsewhere."""

    EMPTY = ("meta", "line", "rect", "circle", "polygon", "polyline")

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        assert not {"src", "href", "srcset"} & {name for name, _ in attrs}
        assert tag not in ("script", "link", "img", "iframe")
        if tag not in self.EMPTY:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        if tag not in self.EMPTY:
            assert self.open.pop() == tag


@pytest.mark.parametrize("number", range(8))
def test_every_kind_of_result_has_a_report_and_a_summary(number: int) -> None:
    result = results()[number]
    page = result.report()
    reader = Balance()
    reader.feed(page)
    assert reader.open == []
    assert "nan" not in re.sub(r"<[^>]*>", " ", page).lower().split()
    assert "url(" not in page and "@import" not in page
    lines = result.summary().splitlines()
    assert len(lines) <= 25
    assert max(map(len, lines)) <= 100
    assert sentence(result).split()[0] in lines[0]


def test_the_report_says_all_that_was_promised(traced: Trace) -> None:
    page = traced.report()
    for title in (
        "Error before and after",
        "Residual in units of noise",
        "What was found",
        "Parameters",
        "What could hide",
        "What to do next",
    ):
        assert f"<h2>{title}</h2>" in page
    assert page.count("<svg") == 2
    assert "curvature of sensor a22" in page
    assert "prefers-color-scheme: dark" in page and "@media print" in page


def test_a_dot_is_drawn_for_every_closure_of_every_pose(traced: Trace) -> None:
    root = ET.fromstring(residual_figure(traced))
    dots = [e for e in root.iter() if e.get("class") == "dot"]
    assert len(dots) == 2 * 48 * 3


def test_a_recording_is_drawn_in_blocks_that_keep_their_size_in_units_of_noise(
    traced: Trace,
) -> None:
    rng = np.random.default_rng(0)
    noise = rng.normal(size=(4000, 3))
    long = dataclasses.replace(traced, before_residuals=noise, after_residuals=noise)
    root = ET.fromstring(residual_figure(long))
    dots = [e for e in root.iter() if e.get("class") == "dot"]
    assert 2 * 250 * 3 < len(dots) <= 2 * 300 * 3


def test_names_from_a_file_cannot_break_the_page(traced: Trace) -> None:
    bad = Excluded(3, None, "<b>", None, "a&b", '"<script>"')
    page = dataclasses.replace(
        traced, excluded=(bad,), warnings=("<i>",), mechanism="<u>", unobservable=("<s>",)
    ).report()
    Balance().feed(page)
    for tag in ("<b>", "<script>", "<i>", "<u>", "<s>"):
        assert tag not in page


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0"),
        (None, "–"),
        (float("nan"), "–"),
        (1.0, "1.00"),
        (-0.01234, "-0.0123"),
        (125.4, "125"),
        (2982.0, "2982"),
        (1.6e-7, "1.60e-07"),
        (0.0009996, "1.00e-03"),
    ],
)
def test_numbers_have_three_digits(value: float | None, text: str) -> None:
    assert number(value) == text


def test_a_value_has_as_many_digits_as_its_uncertainty_allows() -> None:
    assert plus_minus(3.38714, 0.00412) == ("3.3871", "0.0041")
    assert plus_minus(1234.5, 12.0) == ("1234", "12")
    assert plus_minus(3.38714, None) == ("3.38714", "–")
    assert plus_minus(None, 1.0) == ("–", "–")


def test_a_noisy_channel_is_named_beside_what_is_usual(traced: Trace) -> None:
    sigma = {"a11": 1.04, "a12": 1.04, "a13": 4.1}
    noise = Noise("misclosure of repeats, by channel", sigma, 100.0, 0.0)
    words = noise_words(dataclasses.replace(traced, noise=noise))
    assert words.startswith("1.04 count per sample, a13 4.10 (misclosure of repeats, by channel")
    apart = Noise("declared", {"a11": 1.0, "a12": 2.0}, None, None)
    assert noise_words(dataclasses.replace(traced, noise=apart)).startswith("1.00 … 2.00 count")


@pytest.mark.parametrize(
    ("p", "words"), [(0.0, "something is left at a22"), (1e-5, "is left"), (0.3, "may stand")]
)
def test_what_is_partly_explained_leaves_structure_or_only_doubt(
    traced: Trace, p: float, words: str
) -> None:
    left = Unexplained(p_value=p, target="a22", text="")
    said = sentence(dataclasses.replace(traced, verdict="partly_explained", unexplained=left))
    assert words in said


def test_ticks_are_round_and_lie_within_the_bounds() -> None:
    rng = np.random.default_rng(1)
    for low, width in zip(rng.normal(size=200), np.exp(rng.uniform(-9, 9, 200)), strict=True):
        found = svg.ticks(low, low + width)
        assert 1 <= len(found) <= 7
        assert min(found) >= low - 1e-9 * width and max(found) <= low + width * (1 + 1e-9)


def test_json_has_null_for_what_is_not_known() -> None:
    values = {"a": float("nan"), "b": np.float64("inf"), "c": np.array([1.0, np.nan]), "d": (1,)}
    assert plain(values) == {"a": None, "b": None, "c": [1.0, None], "d": [1]}
    assert to_json(values) == '{"a": null, "b": null, "c": [1.0, null], "d": [1]}\n'

"""Options that cannot be used: one kind of error, which says what was found and expected."""

from __future__ import annotations

import argparse
import inspect
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import rsicalib
from rsicalib import DEMO, InputError
from rsicalib.cli.parser import make_parser
from rsicalib.options import number

READINGS = DEMO / "readings.csv"


def calibrate(**options: Any) -> Callable[[], Any]:
    return lambda: rsicalib.calibrate(READINGS, **options)


def trace(**options: Any) -> Callable[[], Any]:
    return lambda: rsicalib.trace(READINGS, **options)


def verbs() -> dict[str, Callable[..., Any]]:
    """Public functions, and classes that take numbers when they are made."""
    found: dict[str, Callable[..., Any]] = {}
    for name in rsicalib.__all__:
        one = getattr(rsicalib, name)
        if inspect.isfunction(one):
            found[name] = one
        elif name == "Monitor":
            found[name] = one.__init__
    return found


def numbers_of(verb: Callable[..., Any]) -> dict[str, str]:
    """The arguments of a verb that are numbers, and their annotations."""
    kinds = {n: str(p.annotation) for n, p in inspect.signature(verb).parameters.items()}
    return {n: k for n, k in kinds.items() if k.removesuffix(" | None") in ("int", "float")}


NO_NUMBERS = [10**400, -(10**30), math.nan, math.inf, "x", "١٢", True, [1], b"1", 1j, 1e308]


@pytest.mark.parametrize("verb", [name for name, verb in verbs().items() if numbers_of(verb)])
def test_no_verb_takes_what_is_no_number_of_its_own(verb: str) -> None:
    call = verbs()[verb]
    needed = [
        n
        for n, p in inspect.signature(call).parameters.items()
        if p.default is inspect.Parameter.empty
    ]
    for name, kind in numbers_of(call).items():
        bad: list[Any] = [*NO_NUMBERS, *([2.5] if "int" in kind else [])]
        for value in [*bad, *([] if "None" in kind else [None])]:
            # Numbers are checked before anything else: the other arguments are not looked at.
            with pytest.raises(InputError) as caught:
                call(**{**dict.fromkeys(needed), name: value})
            assert name in str(caught.value) and "found" in str(caught.value)
            assert len(str(caught.value)) < 200


def test_no_option_of_the_command_takes_what_is_no_number_of_its_own() -> None:
    parser = make_parser()
    verbs_of = next(a for a in parser._actions if hasattr(a, "choices") and a.dest == "verb")
    seen = 0
    assert isinstance(verbs_of.choices, dict)
    for name, verb in verbs_of.choices.items():
        for action in verb._actions:
            if action.type in (int, float):
                raise AssertionError(f"{name} {action.option_strings}: no bounds")
            if getattr(action.type, "__module__", "") != "rsicalib.options":
                continue
            seen += 1
            for word in ("9" * 200, "1e999", "nan", "1_0", "١٢", "x" * 5000, "-3"):
                with pytest.raises(argparse.ArgumentTypeError, match=r"found .* expected"):
                    action.type(word)
    assert seen >= 15


VALUES: dict[str, tuple[Callable[[], Any], str]] = {
    "no terms": (calibrate(terms=[]), "terms: found none"),
    "no closures": (calibrate(closures=[]), "closures: found none"),
    "no groups": (calibrate(fit_groups=[]), "fit_groups: found none"),
    "no noise": (calibrate(noise=0.0), "noise: found 0.0, expected a number above 0"),
    "noise that is NaN": (calibrate(noise=math.nan), "found nan"),
    "infinite noise": (calibrate(noise={"a11": math.inf}), "found"),
    "no starts": (calibrate(starts=0), "starts: found 0, expected 1 to"),
    "no iterations": (calibrate(max_iterations=-1), "max_iterations: found -1"),
    "no precision": (calibrate(xtol=0.0), "xtol: found 0.0, expected a number above 0"),
    "xtol above 1": (calibrate(xtol=2.0), "xtol: found 2"),
    "an unknown method": (calibrate(method="guess"), "implicit_loop or algebraic"),
    "an unknown candidate": (trace(without=["nonsense"]), 'no term "nonsense"'),
    "no candidates": (trace(without=[]), "without: found none"),
    "a negative seed": (trace(seed=-1), "seed: found -1, expected 0 to"),
    "a huge seed": (lambda: rsicalib.simulate(seed=2**70), "seed: found"),
    "no poses": (lambda: rsicalib.simulate(poses=0), "poses: found 0, expected 1 to"),
    "more poses than fit": (
        lambda: rsicalib.simulate(poses=10**7, samples=10**3),
        "expected at most 10,000,000 samples",
    ),
    "negative noise": (lambda: rsicalib.simulate(noise=-1.0), "noise: found -1"),
    "a plan's seed": (lambda: rsicalib.plan(seed=-1), "seed: found -1"),
    "no workers": (lambda: rsicalib.paper(2, workers=0), "workers: found 0, expected 1 to"),
    "no trials": (lambda: rsicalib.paper(0), "trials: found 0, expected 2 to"),
    "no path": (lambda: rsicalib.load_readings(""), "'': found no such file"),
}


@pytest.mark.parametrize("kind", VALUES)
def test_a_value_that_cannot_be_used_is_refused(kind: str) -> None:
    job, words = VALUES[kind]
    with pytest.raises(InputError) as caught:
        job()
    assert words in str(caught.value)
    assert not isinstance(caught.value, TypeError)


TYPES: dict[str, Callable[[], Any]] = {
    "readings": lambda: rsicalib.calibrate(5),  # type: ignore[arg-type]
    "a list of numbers": lambda: rsicalib.calibrate([5]),  # type: ignore[list-item]
    "no readings": lambda: rsicalib.calibrate(None),  # type: ignore[arg-type]
    "rest": calibrate(rest=5),
    "check": calibrate(check=5),
    "mechanism": calibrate(mechanism=5),
    "calibration": calibrate(calibration=5),
    "terms as one text": calibrate(terms="offset"),
    "terms as a number": calibrate(terms=5),
    "a term that is a number": calibrate(terms=[5]),
    "closures": calibrate(closures="wrist1-wrist2"),
    "noise as text": calibrate(noise="x"),
    "noise as a list": calibrate(noise=[1.0]),
    "noise as a truth value": calibrate(noise=True),
    "a seed as text": trace(seed="x"),
    "poses as text": lambda: rsicalib.simulate(poses="x"),  # type: ignore[arg-type]
    "poses as a fraction": lambda: rsicalib.simulate(poses=1.5),  # type: ignore[arg-type]
    "trials as text": lambda: rsicalib.paper("2"),  # type: ignore[arg-type]
    "a method that is no text": calibrate(method=5),
    "a device that is no text": calibrate(device=5),
    "a date that is none": calibrate(date=5),
    "a switch as text": calibrate(align="x"),
    "a switch as a number": trace(apply_all=1),
    "poses of the inverse": lambda: rsicalib.inverse("x"),
}


@pytest.mark.parametrize("kind", TYPES)
def test_a_value_of_the_wrong_type_is_a_type_error_too(kind: str) -> None:
    with pytest.raises(InputError) as caught:
        TYPES[kind]()
    assert isinstance(caught.value, TypeError | ValueError)
    assert "found" in str(caught.value) and "expected" in str(caught.value)


@pytest.mark.parametrize("name", ["method", "device", "date", "align", "skip_bad_rows"])
def test_what_is_no_text_and_no_switch_is_refused_by_its_name(name: str) -> None:
    with pytest.raises(TypeError, match=f"{name}: found 5, expected"):
        calibrate(**{name: 5})()


def test_poses_that_are_no_numbers_are_refused() -> None:
    with pytest.raises(InputError, match="finite"):
        rsicalib.inverse(np.full((1, 6), np.nan))


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("calibrate", "r.csv", "--terms", ""), "--terms"),
        (("calibrate", "r.csv", "--closures", ","), "--closures"),
        (("calibrate", "r.csv", "--seed", "-1"), "--seed"),
        (("calibrate", "r.csv", "--out", ""), "--out"),
        (("trace", "r.csv", "--seed", "9" * 30), "--seed"),
        (("simulate", ""), "OUT"),
        (("plan", "--seed", "x"), "--seed"),
    ],
)
def test_the_command_refuses_them_by_their_option(words: tuple[str, ...], message: str) -> None:
    with pytest.raises(InputError, match=message):
        make_parser().parse_args(words)


@pytest.mark.parametrize("kind", [np.float16, np.float32, np.float64, np.int32])
def test_numbers_of_numpy_are_numbers(kind: type[np.generic]) -> None:
    """The upper end of a bound was cast to the narrow kind, with a warning of overflow."""
    found = number("target", kind(1))  # type: ignore[call-arg]
    assert (type(found), found) == (float, 1.0)
    with pytest.raises(InputError, match="expected a length above 0"):
        number("target", kind(-1))  # type: ignore[call-arg]

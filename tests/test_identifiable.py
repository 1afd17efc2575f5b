"""What can be known is counted before there are readings."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import rsicalib
from rsicalib.io.mechanisms import read_mechanism
from rsicalib.planning.identifiability import COMPLETE, identifiable
from tests.machines import files
from tests.machines.trials import MACHINES

EXAMPLES = Path(__file__).parents[1] / "examples"


def test_of_the_57_parameters_of_the_hand_controller_50_can_be_known() -> None:
    """Nine joints of four parameters, nine points, nine gains, three distances: 57. The loops
    hide the place of the whole (6) and its size (1)."""
    found = identifiable("rsi", COMPLETE)
    assert (found.minimal, found.known) == (57, 50)
    assert found.hidden == (
        "where the whole stands in its base (6)",
        "its size: declare one length that is known (1)",
    )


def test_the_model_of_the_paper_can_be_known_whole() -> None:
    found = identifiable("rsi")
    assert (found.parameters, found.minimal, found.known) == (18, 18, 18)
    assert found.hidden == ()


def test_terms_of_what_closures_end_at_are_refused() -> None:
    with pytest.raises(rsicalib.InputError, match="anchor_position"):
        identifiable(EXAMPLES / "draw_wire.toml", ["offset", "anchor_position"])


def test_the_counts_do_not_depend_on_the_draw() -> None:
    path = EXAMPLES / "draw_wire.toml"
    found = {identifiable(path, COMPLETE, seed=seed).to_dict()["known"] for seed in range(3)}
    assert len(found) == 1


@pytest.mark.parametrize("name", ["plane", "line", "tracker"])
def test_of_an_arm_at_what_stands_anywhere_the_first_offset_is_hidden(name: str) -> None:
    """Six offsets; with the first the whole turns, what it touches with it."""
    document = MACHINES[name](np.random.default_rng(1)).mechanism
    found = identifiable(rsicalib.load_mechanism(files.toml(document)), ["offset"])
    assert (found.parameters, found.minimal, found.known) == (6, 6, 5)


@pytest.mark.parametrize(
    ("name", "minimal", "known"),
    [
        # 4 per joint, the point, a gain per joint, the bar; turning about the ball on the
        # table (3) is not seen, nor the size of all
        ("ball_bar", 24 + 3 + 6 + 1, 30),
        # the wire's column measures: the size is known
        ("draw_wire", 24 + 3 + 6 + 1, 31),
        # three points fix a frame: 4 per joint and 6, twice; six bars; as one body it may stand
        # anywhere; both scales are known, since the points on the grippers are
        ("two_arms", 2 * (24 + 6 + 6) + 6, 72),
    ],
)
def test_examples_with_complete_geometry(name: str, minimal: int, known: int) -> None:
    found = identifiable(EXAMPLES / f"{name}.toml", COMPLETE)
    assert (found.minimal, found.known) == (minimal, known)


def test_a_joint_that_turns_about_the_ball_is_not_seen() -> None:
    mechanism = read_mechanism(EXAMPLES / "ball_bar.toml")
    mechanism["point"][0]["at"] = [0.0, 0.0, 120.0]  # on the last axis
    loaded = rsicalib.Mechanism.from_dict(mechanism)
    found = identifiable(loaded, ["offset"])
    assert (found.parameters, found.known) == (6, 5)


def test_loops_that_cannot_be_closed_are_refused() -> None:
    mechanism = read_mechanism(EXAMPLES / "ball_bar.toml")
    mechanism["closure"][0]["value"] = 6000.0
    loaded = rsicalib.Mechanism.from_dict(mechanism)
    with pytest.raises(rsicalib.InputError, match="configurations"):
        identifiable(loaded)

"""One run of the reproduction: the numbers, the device and the options that its tables share."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from rsicalib import _core
from rsicalib._core import Mechanism
from rsicalib.arrays import FloatArray
from rsicalib.poses.devices import Device
from rsicalib.reproduction.printed import Printed
from rsicalib.reproduction.trials import Draws, Progress, rms

NOISE = 1.0
"""Counts of noise assumed where section IV is simulated; Table IX starts there."""


@dataclass(frozen=True)
class Study:
    """What every table of one run needs.

    Attributes
    ----------
    printed : Printed
        Numbers of the paper.
    trials, seed : int
        Number of trials of every simulated cell, and their seed.
    say : callable
        Called with what is being computed, trials done, and trials in all.
    workers : int or None
        Threads; as many as there are cores where None.
    """

    printed: Printed
    trials: int
    seed: int
    say: Callable[[str, int, int], None]
    workers: int | None

    @property
    def numbers(self) -> Mapping[str, Any]:
        """The paper's file of numbers."""
        return self.printed.numbers

    @property
    def device(self) -> Device:
        """The device that is exactly parameter set I."""
        return self.printed.sets["I"]

    @property
    def mechanism(self) -> Mechanism:
        """The hand controller."""
        return self.device.mechanism

    @property
    def placement(self) -> tuple[float, float]:
        """Standard deviation of where the hand puts the handle, section IV-C: in, rad."""
        error = self.numbers["poses"]["placement_error_rms"]
        return float(error["position_in"]), float(error["orientation_rad"])

    def draws(self, what: str, trials: int | None = None) -> Draws:
        """Draw the trials of one experiment, whose progress is passed on under this name."""
        told: Progress = lambda done, of: self.say(what, done, of)  # noqa: E731
        return Draws(trials or self.trials, self.seed, told, self.workers)


def pose_errors(
    offsets: FloatArray, gains: FloatArray, readings: FloatArray, poses: FloatArray
) -> list[float]:
    """Table VI: rms of joint angles, orientation and position on known poses."""
    angles = readings * gains + offsets
    found = _core.rsi_poses(np.ascontiguousarray(angles)) - poses
    turn = (found[:, 3:] + np.pi) % (2 * np.pi) - np.pi
    return [rms(angles - _core.rsi_angles(poses)), rms(turn), rms(found[:, :3])]

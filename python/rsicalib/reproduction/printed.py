"""The numbers that the paper prints, in arrays, and the devices that its parameters make."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.resources import files
from typing import Any

import numpy as np

from rsicalib._core import Mechanism
from rsicalib.arrays import FloatArray
from rsicalib.poses.devices import Device, nominal_device


@dataclass(frozen=True)
class Printed:
    """What the paper prints, in arrays, and the devices that its parameters make.

    Attributes
    ----------
    numbers : mapping
        The file `reproduction/tables.toml`.
    fixture_printed, fixture, closed_loop : ndarray, shape (12, 6)
        Table II as printed and corrected, Table III.
    nominal : Device
        Nominal offsets and gains.
    sets : dict of str to Device
        Parameter sets I, II, III of Tables IV and V.
    """

    numbers: Mapping[str, Any]
    fixture_printed: FloatArray
    fixture: FloatArray
    closed_loop: FloatArray
    nominal: Device
    sets: dict[str, Device]


def printed_numbers() -> Printed:
    """What the paper prints, from the file that comes with the package.

    Returns
    -------
    Printed
        In arrays, pose 3 of Table II corrected beside the table as printed.
    """
    text = files("rsicalib.reproduction").joinpath("tables.toml").read_text(encoding="utf-8")
    numbers = tomllib.loads(text)

    def poses(name: str) -> FloatArray:
        return np.array(numbers["poses"][name], dtype=np.float64) * ([1] * 3 + [np.pi] * 3)

    fixture = poses("fixture_printed")
    fixture[2, 2] = fixture[3, 2]
    mechanism = Mechanism.rsi()
    sets = {
        name: Device(
            mechanism,
            np.array(numbers["offsets"][name], dtype=np.float64).ravel(),
            np.array(numbers["gains"][name], dtype=np.float64).ravel() * 1e-3,
        )
        for name in ("I", "II", "III")
    }
    return Printed(
        numbers,
        poses("fixture_printed"),
        fixture,
        poses("closed_loop"),
        nominal_device(mechanism),
        sets,
    )

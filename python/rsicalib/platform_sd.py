"""How well a calibration knows the platform, all over its workspace: the verb `workspace`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import numpy as np

from rsicalib.arrays import FloatArray
from rsicalib.devices import Device, Within, draw_poses
from rsicalib.errors import InputError
from rsicalib.io.readings import Readings
from rsicalib.kinematics import forward_sd
from rsicalib.measures import parameters_of
from rsicalib.plots import on_axes, scatter
from rsicalib.records import Record
from rsicalib.tabular import Tabular
from rsicalib.work.arguments import CalibrationArg, MechanismArg, open_mechanism

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["View", "Workspace", "workspace"]

POSE = ("x", "y", "z", "rx", "ry", "rz")

View: TypeAlias = Literal["xy", "xz", "yz"]
"""The plane that `plot` looks at."""


@dataclass(frozen=True, repr=False)
class Workspace(Tabular, Record):
    """Standard deviation of the platform's pose over its workspace.

    Attributes
    ----------
    mechanism, length_unit : str
        Name of the mechanism, and the unit of x, y, z.
    poses : ndarray, shape (n, 6)
        `x y z` [length unit], `rx ry rz` [rad].
    sd : ndarray, shape (n, 6)
        Standard deviations of the same: of the calibration alone, the noise of a reading not
        counted.
    """

    mechanism: str
    length_unit: str
    poses: FloatArray
    sd: FloatArray

    @property
    def position_sd(self) -> FloatArray:
        """Root mean square over x, y and z of every pose, shape (n,) [length unit]."""
        out: FloatArray = np.sqrt(np.mean(self.sd[:, :3] ** 2, axis=1))
        return out

    @property
    def orientation_sd(self) -> FloatArray:
        """Root mean square over rx, ry and rz of every pose, shape (n,) [rad]."""
        out: FloatArray = np.sqrt(np.mean(self.sd[:, 3:] ** 2, axis=1))
        return out

    def plot(self, view: View = "xz", *, ax: Axes | None = None) -> Axes:
        """Draw the positions, coloured by `position_sd`; needs matplotlib (`rsicalib[plot]`).

        Parameters
        ----------
        view : {"xz", "xy", "yz"}
            The plane that is looked at.
        ax : Axes, optional
            Where to; a new figure where not given.

        Returns
        -------
        Axes
            With a colour bar beside it.

        Raises
        ------
        ValueError
            There is no such view.
        """
        if view not in ("xy", "xz", "yz"):
            raise ValueError(f"found {view!r}, expected 'xy', 'xz' or 'yz'")
        across, up = ("xyz".index(letter) for letter in view)
        names = [f"{letter} [{self.length_unit}]" for letter in view]
        names.append(f"sd of the position [{self.length_unit}]")
        x, y = self.poses[:, across], self.poses[:, up]
        return scatter(on_axes(ax, figsize=(6, 5)), x, y, self.position_sd, names)

    def _table(self) -> dict[str, Any]:
        columns = {name: self.poses[:, k] for k, name in enumerate(POSE)}
        return {**columns, **{f"sd_{name}": self.sd[:, k] for k, name in enumerate(POSE)}}

    def __repr__(self) -> str:
        low, high = np.min(self.position_sd), np.max(self.position_sd)
        return (
            f"<Workspace of {self.mechanism!r}: {len(self.poses)} poses, sd of the position "
            f"{low:.2g} to {high:.2g} {self.length_unit}>"
        )


def workspace(
    calibration: CalibrationArg,
    mechanism: MechanismArg = "rsi",
    *,
    poses: int = 500,
    within: Within | None = None,
    seed: int = 0,
) -> Workspace:
    """Find how well a calibration knows the platform's pose all over the workspace.

    Parameters
    ----------
    calibration : path, Calibration or Trace
        A result with the covariance of its parameters.
    mechanism : str, path, mapping or Mechanism
        With a platform.
    poses : int
        Number of poses, drawn within reach, joint limits and ranges.
    within : six pairs, optional
        Lowest and highest x, y, z [length unit], rx, ry, rz [rad]; for the hand controller
        ±3 in, z -5.7 to -0.3, ±30°.
    seed : int
        Same seed, same poses.

    Returns
    -------
    Workspace
        Poses and standard deviations.

    Raises
    ------
    InputError
        The mechanism has no platform, or its box is unknown or out of reach.

    See Also
    --------
    rsicalib.plan : poses that make it better.

    Examples
    --------
    >>> import rsicalib
    >>> found = rsicalib.calibrate(rsicalib.DEMO / "readings.csv", rest=rsicalib.DEMO / "rest.csv")
    >>> workspace(found, poses=50).poses.shape
    (50, 6)
    """
    opened = open_mechanism(mechanism)
    if poses < 1:
        raise InputError(f"poses: found {poses}, expected at least 1")
    if not opened.to_dict().get("platform"):
        raise InputError(f"found {opened.name!r} without a platform, expected one with it")
    device = Device(opened, *parameters_of(calibration, opened))
    drawn, exact = draw_poses(device, poses, np.random.default_rng(seed), within=within)
    sd = forward_sd(Readings.from_arrays(opened, exact), opened, calibration)
    return Workspace(opened.name, opened.length_unit, drawn, sd)

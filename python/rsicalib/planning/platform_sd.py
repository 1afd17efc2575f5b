"""How well a calibration knows what is carried, all over its workspace: the verb `workspace`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import numpy as np

from rsicalib import _core, options
from rsicalib._core import Mechanism
from rsicalib.arrays import Alike, FloatArray
from rsicalib.errors import InputError
from rsicalib.facts.records import Record
from rsicalib.io.cells import POSE
from rsicalib.plain_text import counted
from rsicalib.planning.measures import parameters_of
from rsicalib.plots import on_axes, scatter
from rsicalib.poses.devices import Device, Within, draw_poses
from rsicalib.poses.kinematics import forward_sd
from rsicalib.poses.places import held_at, places
from rsicalib.results.result import Result
from rsicalib.tabular import Tabular
from rsicalib.work.applying import as_applied
from rsicalib.work.arguments import (
    CalibrationArg,
    MechanismArg,
    earlier_result,
    open_mechanism,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes


View: TypeAlias = Literal["xy", "xz", "yz"]
"""The plane that `plot` looks at."""


class Workspace(Alike, Tabular, Record, eq=False, repr=False):
    """Standard deviation of what a mechanism carries, over its workspace.

    Attributes
    ----------
    mechanism, length_unit : str
        Name of the mechanism, and the unit of x, y, z.
    poses : ndarray, shape (n, 6)
        `x y z` [length unit], `rx ry rz` [rad] of the platform. Of a mechanism without one,
        shape (n, 3 k): `x y z` of each of the `k` points that its chains carry.
    sd : ndarray, in the shape of `poses`
        Standard deviations of the same: of the calibration alone, the noise of a reading not
        counted.
    names : tuple of str
        Names of the columns of both: `x … rz`, or `ball.x ball.y ball.z`.
    """

    mechanism: str
    length_unit: str
    poses: FloatArray
    sd: FloatArray
    names: tuple[str, ...] = POSE

    @property
    def _posed(self) -> bool:
        return self.names == POSE

    def _points(self, of: FloatArray) -> FloatArray:
        """Positions, or their deviations, point by point: shape (n, k, 3)."""
        out: FloatArray = of[:, :3][:, None] if self._posed else of.reshape(len(of), -1, 3)
        return out

    @property
    def position_sd(self) -> FloatArray:
        """Root mean square over x, y and z of every pose and point, shape (n,) [length unit]."""
        out: FloatArray = np.sqrt(np.mean(self._points(self.sd) ** 2, axis=(1, 2)))
        return out

    @property
    def orientation_sd(self) -> FloatArray:
        """Root mean square over rx, ry and rz, shape (n,) [rad]; NaN without a platform."""
        if not self._posed:
            return np.full(len(self.poses), np.nan)
        out: FloatArray = np.sqrt(np.mean(self.sd[:, 3:] ** 2, axis=1))
        return out

    def plot(self, view: View = "xz", *, ax: Axes | None = None) -> Axes:
        """Draw the positions, coloured by their sd; needs matplotlib (`rsicalib[plot]`).

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
        places = self._points(self.poses).reshape(-1, 3)
        size = np.sqrt(np.mean(self._points(self.sd) ** 2, axis=2)).ravel()
        axes = on_axes(ax, figsize=(6, 5))
        return scatter(axes, places[:, across], places[:, up], size, names)

    def _table(self) -> dict[str, Any]:
        columns = {name: self.poses[:, k] for k, name in enumerate(self.names)}
        return {**columns, **{f"sd_{name}": self.sd[:, k] for k, name in enumerate(self.names)}}

    def __repr__(self) -> str:
        low, high = np.min(self.position_sd), np.max(self.position_sd)
        return (
            f"<Workspace of {self.mechanism!r}: {counted(len(self.poses), 'pose')}, "
            f"sd of the position {low:.2g} to {high:.2g} {self.length_unit}>"
        )


@options.checked
def workspace(
    calibration: CalibrationArg,
    mechanism: MechanismArg = "rsi",
    *,
    poses: int = 500,
    within: Within | None = None,
    seed: int = 0,
) -> Workspace:
    """Find how well a calibration knows what is carried, all over the workspace.

    Poses of a platform are drawn within a box, where one is given or declared. Else configurations
    are drawn within the limits of the joints: closures between points that chains carry hold in
    them; sockets, bars and other things that the chains touch in the base do not.

    Parameters
    ----------
    calibration : path, Calibration or Trace
        A result with the covariance of its parameters.
    mechanism : str, path, mapping or Mechanism
        With a platform, or with points on its chains.
    poses : int
        Number of poses, drawn within reach, joint limits and ranges.
    within : six pairs, optional
        Lowest and highest x, y, z [length unit], rx, ry, rz [rad] of a platform; where not given
        `[workspace]` of the mechanism, for the hand controller ±3 in, z -5.7 to -0.3, ±30°.
    seed : int
        Same seed, same poses.

    Returns
    -------
    Workspace
        Poses and standard deviations.

    Raises
    ------
    InputError
        Nothing is carried, the box is out of reach, or loops do not close within the limits of the
        joints.

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
    opened = open_mechanism(mechanism, calibration)
    if within is not None and not opened.to_dict().get("platform"):
        raise InputError(f"within: found {opened.name!r} without a platform, expected one")
    if within is None and not _boxed(opened):
        return _within_limits(calibration, opened, poses, seed)
    result, opened = earlier_result(calibration, opened)
    device = Device(opened, *parameters_of(result, opened))
    drawn, exact = draw_poses(device, poses, np.random.default_rng(seed), within=within)
    sd = forward_sd(held_at(result, opened, exact), opened, result)
    return Workspace(opened.name, opened.length_unit, drawn, sd)


def readings_at_work(
    result: Result, mechanism: Mechanism, count: int, seed: int
) -> tuple[FloatArray, bool]:
    """Exact readings under a result, of shape (n, C), and whether they are of a workspace.

    Poses of a platform that has one; else configurations within the limits of the joints.
    """
    if _boxed(mechanism):
        device = Device(mechanism, *parameters_of(result, mechanism))
        return draw_poses(device, count, np.random.default_rng(seed))[1], True
    sensors = _core.calibrated_sensors(mechanism, as_applied(result, mechanism))
    return _core.within_limits(sensors, count, seed=seed), False


def _boxed(mechanism: Mechanism) -> bool:
    """Whether a workspace of its platform is declared."""
    drawn = mechanism.to_dict()
    return bool(drawn.get("platform") and drawn.get("workspace"))


def _within_limits(
    calibration: CalibrationArg, mechanism: Mechanism, poses: int, seed: int
) -> Workspace:
    """A platform, or points that chains carry, in configurations within the limits of joints."""
    result, mechanism = earlier_result(calibration, mechanism)
    values, _ = readings_at_work(result, mechanism, poses, seed)
    found = places(held_at(result, mechanism, values), mechanism, result)
    sd = np.full_like(found.values, np.nan) if found.sd is None else found.sd
    return Workspace(mechanism.name, mechanism.length_unit, found.values, sd, found.names)

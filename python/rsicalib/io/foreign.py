"""Machines in the words of other programs: what to do with a file that is given as a mechanism."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

from rsicalib.io.urdf_tree import how_to_expand, refuse

HEAD = 1 << 14
"""Bytes at the head of a file that tell what it is."""

EXPECTED = "a mechanism file (TOML), or a model of MuJoCo (MJCF)"
COMMENT = re.compile(rb"<!--.*?-->", re.DOTALL)
COMPILED = b"\x00MJB"
EXPORT = "Export it from its program as URDF or MJCF."


def _urdf(file: str) -> str:
    name = Path(file).name
    return (
        "It does not say what closes. Write a mechanism file with a [[chain]] that has "
        f'urdf = "{name}", base and tip, a [[point]] on it, and a [[closure]]'
    )


FOREIGN: dict[str, tuple[re.Pattern[bytes], Callable[[str], str]]] = {
    "a xacro": (re.compile(rb"<xacro:|<[^<>]*\sxacro:[\w.-]+\s*="), how_to_expand),
    "a robot description (URDF)": (re.compile(rb"<robot\b"), _urdf),
    "a description of Gazebo (SDF)": (re.compile(rb"<sdf\b"), lambda _: EXPORT),
    "a stage of USD": (re.compile(rb"\A#usda|\APXR-USDC"), lambda _: EXPORT),
    "a compiled model of MuJoCo": (
        re.compile(rb"\A" + re.escape(COMPILED)),
        lambda _: "Save it as XML: mujoco.mj_saveLastXML",
    ),
    "JSON": (re.compile(rb"\A\s*\{\s*[\"}]"), lambda _: "Results and sessions are no mechanisms"),
}
"""By what a message calls it: what its head has in it, and what to do."""


def refuse_foreign(file: str) -> None:
    """Refuse a file that another program reads as a machine, and say what to do with it.

    Raises
    ------
    InputError
        Its head tells what it is.
    """
    with open(file, "rb") as source:
        head = COMMENT.sub(b"", source.read(HEAD))
    if Path(file).suffix.lower() == ".mjb":  # its bytes differ from version to version
        head = COMPILED
    for words, (looks, hint) in FOREIGN.items():
        if looks.search(head):
            refuse(file, "mechanism", found=words, expected=EXPECTED, hint=hint(file))

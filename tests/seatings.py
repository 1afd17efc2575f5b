"""Arms that put a ball into a cone, by the hundred: how often a clean one is flagged, and coverage.

`python -m tests.seatings --arms 200` prints, for an arm in DH rows and the same arm from a URDF,
with the noise of its encoders declared and without, how many clean arms are called otherwise than
adequate, the mean of χ² over its degrees of freedom, and how many 95 % intervals of the offsets of
joints 2 to 6 hold the truth. 40 seatings of 8 samples each; the readings are from `tests/cone.py`.
`--rows` and `--noise` choose one of the four, `--first` continues.
"""

from __future__ import annotations

import argparse
import tempfile
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np

import rsicalib
from tests import cone

SIGMA, PLAY = 2e-5, 0.02
JOINT = """<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>
<origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="0 0 1"/>
<limit lower="{low}" upper="{high}" effort="1" velocity="1"/></joint>
"""


def urdf() -> str:
    """The arm as a URDF, in metres: what stands behind a joint is the origin of the next."""
    links = [f"l{k}" for k in range(7)] + ["ball_link"]
    text = "".join(f'<link name="{name}"/>\n' for name in links)
    behind = [(0.0, 0.0, 0.0), *cone.ROWS]
    for k, (d, a, alpha) in enumerate(behind):
        low, high = cone.LIMITS[k] if k < 6 else (0.0, 0.0)
        text += JOINT.format(
            name=f"q{k + 1}",
            kind="revolute" if k < 6 else "fixed",
            parent=links[k],
            child=links[k + 1],
            xyz=f"{a / 1000} 0 {d / 1000}",
            rpy=f"{alpha} 0 0",
            low=low,
            high=high,
        )
    return f'<robot name="arm">\n{text}</robot>\n'


def mechanism(folder: Path, noise: float | None, from_urdf: bool) -> rsicalib.Mechanism:
    """The mechanism, its chain in DH rows or from a URDF."""
    text = cone.mechanism(noise, PLAY)
    if from_urdf:
        (folder / "arm.urdf").write_text(urdf(), encoding="utf-8")
        joints = ", ".join(f'q{k} = "q{k}"' for k in range(1, 7))
        start = text.index("dh = [")
        end = text.index("\n", start)
        chain = f'urdf = "arm.urdf"\nbase = "l0"\ntip = "ball_link"\nchannels = {{{joints}}}'
        text = text[:start] + chain + text[end:]
        text = text.replace('length_unit = "mm"', 'length_unit = "m"')
        text = text.replace("at = [40.0, 0.0, 120.0]", "at = [0.04, 0.0, 0.12]")
        text = text.replace(f"noise = {PLAY}\n", f"noise = {PLAY / 1000}\n")
    path = folder / "arm.toml"
    path.write_text(text, encoding="utf-8")
    return rsicalib.load_mechanism(path)


def main(arguments: Sequence[str] | None = None) -> None:
    """Print a line for each kind of arm."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--arms", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1000)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--rows", choices=["dh", "urdf"], nargs="+", default=["dh", "urdf"])
    parser.add_argument(
        "--noise", choices=["undeclared", "declared"], nargs="+", default=["undeclared", "declared"]
    )
    options = parser.parse_args(arguments)
    first = options.seed + options.first
    for from_urdf in (rows == "urdf" for rows in options.rows):
        for noise in (SIGMA if word == "declared" else None for word in options.noise):
            verdicts: Counter[str] = Counter()
            ratios, inside = [], []
            with tempfile.TemporaryDirectory() as folder:
                own = mechanism(Path(folder), noise, from_urdf)
                for seed in range(first, first + options.arms):
                    found = rsicalib.calibrate(cone.session(seed).table, own)
                    verdicts[found.verdict] += 1
                    assert found.fit.chi2 is not None and found.fit.dof is not None
                    ratios.append(found.fit.chi2 / found.fit.dof)
                    for p in found.parameters:
                        if p.term == "offset" and p.target != "q1" and p.sd:
                            off = p.value - cone.OFFSETS[int(p.target[1:]) - 1]
                            inside.append(abs(off) < 1.96 * p.sd)
            name = "URDF" if from_urdf else "DH rows"
            declared = "declared" if noise else "not declared"
            print(
                f"{name}, noise {declared}: {dict(verdicts)}, chi2/dof {np.mean(ratios):.3f}, "
                f"coverage {100.0 * np.mean(inside):.1f} % of {len(inside)}",
                flush=True,
            )


if __name__ == "__main__":
    main()

"""Pages of sessions of eleven kinds: `python -m tests.pages --out FOLDER` writes them to look at.

With chromium it also photographs each at the widths of a phone, a tablet and a desk, and prints it.
"""

from __future__ import annotations

import argparse
import json
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from functools import cache, partial
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

import rsicalib
from rsicalib import DEMO, Trace
from tests import person
from tests.blind import effects as catalogue
from tests.blind import trials as blind
from tests.blind.effects import Effect
from tests.families import trials as families
from tests.machines import files as machine_files
from tests.machines import trials as machines
from tests.population.production import Production, frame

WIDTHS = (360, 768, 1280)
"""Of a phone, a tablet and a desk [px]."""
MOST = 16000
"""Height of a photograph at most [px]: what a browser draws at once."""
FLEET = 60
"""Devices of the fleet."""


def effect(term: str, target: str | None = None, seed: int = 0) -> Effect:
    """One effect of the simulator."""
    kinds = {kind.term: kind for kind in (*catalogue.CATALOGUE, *catalogue.OUTSIDE)}
    rng = np.random.default_rng(seed)
    return kinds[term].draw(rng) if target is None else kinds[term].draw(rng, target)


def blind_session(*present: Effect, exactly: float, seed: int = 0, moving: bool = False) -> Trace:
    """A traced session of the hand controller with effects."""
    it = blind.given(blind.staged([11, seed], *present, exactly=exactly, moving=moving))
    return rsicalib.trace(it.readings, rest=it.rest, check=it.check)


def good() -> Trace:
    """A device without an effect."""
    made = rsicalib.simulate(seed=1)
    return rsicalib.trace(made.readings, rest=made.rest, check=made.check)


def shared() -> Trace:
    """Three forearms that are too long by the same 0.4 %."""
    values = rsicalib.Mechanism.rsi().to_dict()
    for chain in values["chain"]:
        for row in chain["dh"]:
            if "channel" in row and row.get("a") == 3.2:
                row["a"] = 3.2128
    made = rsicalib.simulate(mechanism=rsicalib.Mechanism.from_dict(values), seed=5)
    return rsicalib.trace(made.readings, rest=made.rest, check=made.check)


def garbage() -> Trace:
    """Readings that are of no mechanism."""
    table = rsicalib.load_readings(DEMO / "readings.csv")
    random = np.random.default_rng(3).integers(0, 4096, table.values.shape)
    mechanism = rsicalib.load_mechanism("rsi")
    readings = rsicalib.Readings.from_arrays(mechanism, random, pose=table.pose)
    return rsicalib.trace(readings)


def sockets() -> Trace:
    """An arm that touches sockets, with an effect."""
    case = families.make("sockets", "single", 1, 8)
    mechanism = rsicalib.Mechanism.from_toml(families.toml(case.device))
    return rsicalib.trace(families.readings_of(mechanism, case.session), mechanism)


def belts() -> Trace:
    """A sled on belts, one of which has another length."""
    case = machines.make("belts", "effect", 1, 8)
    with tempfile.TemporaryDirectory() as folder:
        return rsicalib.trace(*machine_files.write(case.machine, case.read, Path(folder)))


KINDS: dict[str, Callable[[], Trace]] = {
    "good": good,
    "bent": rsicalib.demo,
    "shared": shared,
    "tie": lambda: blind_session(effect("once_per_turn", "a12"), exactly=60.0, seed=2),
    "partly": lambda: blind_session(effect("random_walk", "a12", 5), exactly=400.0, seed=5),
    "unexplained": lambda: blind_session(effect("handle_play", seed=4), exactly=400.0, seed=4),
    "garbage": garbage,
    "recording": lambda: blind_session(
        effect("curvature", "a31"), exactly=400.0, seed=6, moving=True
    ),
    "sockets": sockets,
    "belts": belts,
}
"""How each session is traced."""

SESSIONS = {name: cache(kind) for name, kind in KINDS.items()}
"""Of every session the trace, computed once."""


def fleet() -> str:
    """The page of devices of one design, whose forearms are all too long."""
    made, _ = frame(Production(design={"length@4": 0.01}), FLEET, 3)
    columns = {name: np.asarray(cells).tolist() for name, cells in made.frame.items()}
    columns["device"] = [f"no. {k + 1}" for k in columns["device"]]
    with tempfile.TemporaryDirectory() as folder:
        data, out = Path(folder) / "data.csv", Path(folder) / "out"
        rows = zip(*columns.values(), strict=True)
        lines = [",".join(columns), *(",".join(map(str, row)) for row in rows)]
        data.write_text("\n".join(lines), encoding="utf-8")
        rsicalib.fleet(data, out=out)
        return (out / "fleet.html").read_text(encoding="utf-8")


@cache
def guided() -> dict[str, dict[str, Any]]:
    """What the guide shows: on the way to a pose, a channel that is lost, and at the end."""
    shown: dict[str, dict[str, Any]] = {}

    def see(state: dict[str, Any]) -> bool:
        if state["taken"] == 5 and state["pose"] is not None and state["phase"] == "move":
            shown.setdefault("guide-next", state)
        return False

    with tempfile.TemporaryDirectory() as folder:
        session, _ = person.guided(person.drawn(3), Path(folder) / "a", 0.003, see)
        shown["guide-done"] = session.state()
        lost = person.drawn(3)
        lost.lost = 7

        def wrong(state: dict[str, Any]) -> bool:
            lost = any(trouble["target"] == "a32" for trouble in state["troubles"])
            seen = lost and state["phase"] in ("move", "hold")
            if seen:
                shown.setdefault("guide-trouble", state)
            return seen

        person.guided(lost, Path(folder) / "b", 0.003, wrong)
    return shown


def guide_page(name: str) -> str:
    """The page of the guide in a state, as its server sends it."""
    whole = files("rsicalib.guide").joinpath("page.html").read_text(encoding="utf-8")
    state = json.dumps(guided()[name]).replace("<", "\\u003c")
    return whole.replace("/* the state at first */", state)


GUIDED = ("guide-next", "guide-trouble", "guide-done")
"""States of the guide that are shown."""


def pages() -> dict[str, Callable[[], str]]:
    """Every page, by the name of its session."""

    def report(make: Callable[[], Trace]) -> Callable[[], str]:
        return lambda: make().report(target=0.002)

    return {
        **{name: report(make) for name, make in SESSIONS.items()},
        "fleet": fleet,
        **{name: partial(guide_page, name) for name in GUIDED},
    }


def photograph(browser: str, file: Path) -> None:
    """Pictures of a page at every width, and the sheets that are printed."""
    still = [browser, "--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars"]
    with tempfile.TemporaryDirectory() as profile:
        still += [f"--user-data-dir={profile}"]

        def take(*options: str) -> str:
            command = [*still, *options, file.as_uri()]
            done = subprocess.run(command, check=True, capture_output=True, timeout=120)
            return done.stdout.decode()

        for width in WIDTHS:
            to = file.with_name(f"{file.stem}-{width}.png")
            take(f"--window-size={width},{MOST}", f"--screenshot={to}")
        take("--no-pdf-header-footer", f"--print-to-pdf={file.with_suffix('.pdf')}")


def main() -> int:
    """Write the pages."""
    parser = argparse.ArgumentParser(description="pages of sessions of eleven kinds")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--only", nargs="*", choices=pages())
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    browser = shutil.which("chromium") or shutil.which("google-chrome")
    every = pages()
    for name in args.only or every:
        file = args.out / f"{name}.html"
        file.write_text(every[name](), encoding="utf-8")
        print(f"{file}: {file.stat().st_size / 1e3:.0f} kB", flush=True)
        if browser is not None:
            photograph(browser, file)
    return 0


if __name__ == "__main__":
    sys.exit(main())

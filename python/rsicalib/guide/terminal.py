"""The same page in the terminal."""

from __future__ import annotations

import math
import sys
from typing import Any, TextIO

from rsicalib.plain_text import counted

WIDTH = 40


class Screen:
    """Shows the state: drawn again on a terminal, line by line where it is none."""

    def __init__(self, out: TextIO | None = None, quiet: bool = False) -> None:
        self.out = sys.stderr if out is None else out
        self.live = not quiet and self.out.isatty()
        self.quiet = quiet
        self._said: list[str] = []

    def show(self, state: dict[str, Any]) -> None:
        """Show a state."""
        if self.quiet:
            return
        if self.live:
            self.out.write("\x1b[H\x1b[2J" + "\n".join(screen(state)) + "\n")
            self.out.flush()
            return
        news = [state["note"], *_troubles(state)]
        if state["phase"] in ("move", "think") and (state["pose"] is not None or state["touch"]):
            news.append(f"{headline(state)}: {place(state)}  {state['why']}")
        if state["done"]:
            news.append(f"{ended(state)}: {size(state['sd'], state['unit'])}{_after(state)}")
        for line in news:
            if line and line not in self._said[-20:]:
                print(line, file=self.out, flush=True)
                self._said.append(line)


def screen(state: dict[str, Any]) -> list[str]:
    """All lines of the page."""
    unit = state["unit"]
    if state["done"]:
        # Done is said only where nothing is wrong.
        big = BIG_DONE if state["order"]["word"] == "done" else ("", f"  {ended(state)}")
        lines = [*big, "", f"  {size(state['sd'], unit)}{_after(state)}", ""]
    else:
        lines = [headline(state), place(state), state["why"], ""]
        lines += [bar(channel) for channel in state["channels"]]
        held = round(WIDTH * state["hold"])
        lines += ["", f"{'still':6s} [{'#' * held}{' ' * (WIDTH - held)}]", state["message"], ""]
    lines.append(
        f"{counted(state['taken'], 'pose')}, {state['held_out']} kept out   platform "
        f"{size(state['sd'], unit)} (target {size(state['target'], unit)})"
    )
    if state["largest"] is not None:
        lines.append(f"a single reading errs by {size(state['largest'], unit)} at most (95 %)")
    if state["closure"] is not None:
        fitted, kept = (size(state[k], unit) for k in ("closure_fitted", "closure"))
        lines.append(f"closure: fitted {fitted}, kept out {kept}")
    if state["named"]:
        lines.append("found: " + ", ".join(state["named"]))
    if state["open"]:
        lines.append("still open: " + " | ".join(one["text"] for one in state["open"]))
    return [*lines, *_troubles(state), state["note"]]


def _troubles(state: dict[str, Any]) -> list[str]:
    return [f"! {trouble['text']}" for trouble in state["troubles"]]


def ended(state: dict[str, Any]) -> str:
    """How a session has ended: `DONE`, or what is wrong."""
    return "DONE" if state["order"]["word"] == "done" else headline(state)


def _after(state: dict[str, Any]) -> str:
    return f" after {counted(state['taken'], 'pose')}"


def headline(state: dict[str, Any]) -> str:
    """What to do now."""
    if state["order"]["word"] == "stop":
        return f"STOP: {state['order']['text']}"
    if state["phase"] == "wait":
        return "Waiting for samples"
    if state["repeat"]:
        return f"Pose {state['repeat']} once more"
    if state["phase"] == "think":
        return "Choosing the next pose"
    if state["wait_s"] > 0:
        return f"Pose {state['next']}: first wait {math.ceil(state['wait_s'] / 60)} min"
    return f"{'Hold still:' if state['phase'] == 'hold' else 'Go to'} pose {state['next']}"


def place(state: dict[str, Any]) -> str:
    """Where the next pose is."""
    if state["pose"] is None:
        return str(state["touch"])
    x, y, z, *turns = state["pose"]
    rx, ry, rz = (math.degrees(v) for v in turns)
    return f"x {x:.1f} y {y:.1f} z {z:.1f} {state['unit']}  rx {rx:.0f}° ry {ry:.0f}° rz {rz:.0f}°"


def bar(channel: dict[str, Any]) -> str:
    """Where a channel is, and where it should be."""
    now, want = channel["now"], channel["want"]
    label = f"  {channel['label']}" if channel["label"] else ""
    known = [v for v in (now, want) if v is not None]
    if not known:
        return f"{channel['name']:6s}{label}"
    loose = channel["loose"]
    low = min(known) - 4 * loose if channel["low"] is None else channel["low"]
    high = max(known) + 4 * loose if channel["high"] is None else channel["high"]

    def at(value: float) -> int:
        share = (value - low) / (high - low) if high > low else 0.5
        return int(min(WIDTH - 1, max(0, share * WIDTH)))

    track = ["·"] * WIDTH
    if want is not None:
        track[at(want)] = "|"
    if now is not None:
        track[at(now)] = "O"
    off = "" if now is None or want is None else f"{want - now:+.4g}"
    mark = " ok" if off and abs(want - now) < loose else ""
    return f"{channel['name']:6s} [{''.join(track)}] {off}{mark}{label}"


def size(value: float | None, unit: str) -> str:
    """A length in words."""
    return "?" if value is None else f"{value:.2g} {unit}"


BIG_DONE = (
    "",
    "  ######    #####   ##   ##  #######",
    "  ##   ##  ##   ##  ###  ##  ##",
    "  ##   ##  ##   ##  #### ##  #####",
    "  ##   ##  ##   ##  ## ####  ##",
    "  ######    #####   ##   ##  #######",
)

"""Figures of the readings: noise by channel, and what a wrong one would have to be to be seen."""

from __future__ import annotations

from rsicalib.facts.shapes import Noise, Reliability, ResultShape
from rsicalib.report.figure import Figure
from rsicalib.report.svg import WIDE, Canvas, fitted, width_of
from rsicalib.report.words import listed_words, number
from rsicalib.units import with_unit


def noise_figure(noise: Noise) -> Figure:
    """Draw the standard deviation of a sample of each channel as a bar; one scale for each unit."""
    names = list(noise.sigma)
    largest: dict[str, float] = {}
    for name, sigma in noise.sigma.items():
        unit = noise.unit.get(name, "")
        largest[unit] = max(sigma, largest.get(unit, 0.0))

    def draw(width: float) -> str:
        left = 90.0
        room = width - left - 110.0
        canvas = Canvas(width, 20.0 * len(names) + 8.0)
        for k, name in enumerate(names):
            y, sigma, unit = 4.0 + 20.0 * k, noise.sigma[name], noise.unit.get(name, "")
            canvas.text(left - 6.0, y + 12.0, fitted(name, left - 8.0), anchor="end")
            long = room * sigma / (largest[unit] or 1.0)
            canvas.rect(left, y, long, 15.0, "bar", f"{name}: {sigma}")
            canvas.text(left + long + 4.0, y + 12.0, with_unit(number(sigma), unit))
        return canvas.svg("noise of each channel")

    known = "as declared" if noise.kind == "declared" else f"from the {noise.source}"
    alike = "the others of its unit" if len(largest) > 1 else "the others"
    caption = (
        f"Standard deviation of one sample of each channel, rounding included, {known}. "
        f"A channel far above {alike} is a sensor or a wire to look at."
    )
    return Figure("noise", draw, caption)


def reliability_rows(result: ResultShape, found: Reliability) -> list[tuple[str, ...]]:
    """Channel by channel: usual and largest detectable error, largest external reliability."""
    rows: list[tuple[str, ...]] = []
    names = list(result.noise.sigma) if result.noise else []
    for name, errors, harm in zip(names, found.detectable, found.external, strict=False):
        known = sorted(e for e in errors if e is not None)
        worst = [h for h in harm if h is not None]
        blind = sum(e is None for e in errors)
        rows.append(
            (
                name,
                number(known[len(known) // 2]) if known else "–",
                number(known[-1]) if known else "–",
                number(max(worst)) if worst else "–",
                str(blind),
            )
        )
    return rows


def reliability_figure(result: ResultShape, found: Reliability) -> Figure | None:
    """Draw the minimum detectable error of every channel in every pose as a map.

    Colours are beside what is usual for channels of the same unit.
    """
    names = list(result.noise.sigma) if result.noise else []
    own = [result.noise.unit.get(name, "") for name in names] if result.noise else []
    known: dict[str, list[float]] = {}
    for unit, errors in zip(own, found.detectable, strict=False):
        known.setdefault(unit, []).extend(e for e in errors if e is not None)
    middle = {unit: sorted(errors)[len(errors) // 2] for unit, errors in known.items() if errors}
    if not names or not middle or len(names) != len(found.detectable):
        return None

    def draw(width: float) -> str:
        left = 90.0 if width == WIDE else 60.0
        poses = len(found.detectable[0])
        size = (width - left - 8.0) / max(poses, 1)
        canvas = Canvas(width, 18.0 * len(names) + 40.0)
        for c, name in enumerate(names):
            canvas.text(left - 6.0, 18.0 * c + 13.0, fitted(name, left - 8.0), anchor="end")
            for p, (error, harm) in enumerate(
                zip(found.detectable[c], found.external[c], strict=True)
            ):
                said = f"{name}, pose {p + 1} in order: "
                said += "none" if error is None else with_unit(number(error), own[c])
                said += f", external reliability {number(harm)}"
                kind = f"level{_level(error, middle.get(own[c], 1.0))}"
                canvas.rect(left + size * p, 18.0 * c, size + 0.3, 17.0, kind, said, p=p)
        y = 18.0 * len(names) + 14.0
        canvas.text(left, y, "pose, in the order of the readings", kind="label")
        words = ("half", "usual", "2 ×", "4 ×", "none")
        long = [14.0 + width_of(label) for label in words]
        gap = (width - left - sum(long)) / len(words)
        for k, label in enumerate(words):
            x = left + sum(long[:k]) + gap * k
            canvas.rect(x, y + 8.0, 11.0, 11.0, f"level{k}")
            canvas.text(x + 14.0, y + 18.0, label)
        return canvas.svg("minimum detectable error by channel and pose")

    usual = listed_words([with_unit(number(size), unit) for unit, size in middle.items()])
    caption = (
        f"Minimum detectable error of each channel in each pose; {usual} is usual, and “none” is "
        "checked by no other reading. Strong colours are readings that few others check: an error "
        "there passes unseen."
    )
    return Figure("reliability", draw, caption)


def _level(error: float | None, middle: float) -> int:
    """Shade of a cell, 0 to 4."""
    if error is None:
        return 4
    return sum(error > middle * times for times in (0.7, 1.4, 2.8))

"""Digest of the numbers of a result that poses come from: edited ones have another."""

from __future__ import annotations

import hashlib
import json
from typing import Any

from rsicalib._core import Mechanism
from rsicalib.facts.records import plain
from rsicalib.facts.shapes import ResultShape


def digest_of_numbers(result: ResultShape) -> str:
    """SHA-256 of what poses and their standard deviations come from.

    Words, verdicts and figures of the session do not count, nor how numbers are written.
    """
    noise, loops = result.noise, result.misclosure
    parts = {
        "mechanism": [result.mechanism, result.length_unit],
        "parameters": [[p.term, p.target, p.place, p.name, p.value] for p in result.parameters],
        "covariance": result.covariance,
        "noise": None if noise is None else [noise.sigma, noise.closures],
        "reference": result.reference,
        "misclosure": None if loops is None else loops.rms,
        "laws": [law.to_dict() for law in result.laws],
    }
    text = json.dumps(_as_floats(plain(parts)), sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()


DRAWN = ("channel", "chain", "point", "closure", "platform", "gravity")
"""What a mechanism file says of the machine itself; what stands around it may be known or not."""

KNOWN = ("label", "range", "limits", "noise", "sd")
"""What says how well that is known, how far it goes or what people call it."""


def digest_of_drawing(mechanism: Mechanism) -> str:
    """SHA-256 of how a mechanism is drawn: two with one name may be two machines.

    Of points those that chains carry, and of closures those with a length. Noise, ranges, terms and
    what people call things do not count.
    """
    for known, digest in _KEPT:
        if known is mechanism:
            return digest
    drawn = mechanism.to_dict()
    parts = {key: _without_known(plain(drawn[key])) for key in DRAWN if key in drawn}
    for key, own in (("point", "chain"), ("closure", "value")):
        parts[key] = [one for one in parts.get(key, []) if one.get(own) is not None]
    text = json.dumps(_as_floats(parts), sort_keys=True)
    digest = hashlib.sha256(text.encode()).hexdigest()
    _KEPT[:] = [(mechanism, digest)]
    return digest


_KEPT: list[tuple[Mechanism, str]] = []
"""The last mechanism and its digest: a fleet asks for the same one at every device."""


def _without_known(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _without_known(own) for key, own in value.items() if key not in KNOWN}
    return [_without_known(own) for own in value] if isinstance(value, list | tuple) else value


def _as_floats(value: Any) -> Any:
    """The same with every number as a float: whoever writes 3 for 3.0 edits nothing."""
    if isinstance(value, dict):
        return {key: _as_floats(own) for key, own in value.items()}
    if isinstance(value, list):
        return [_as_floats(own) for own in value]
    return float(value) if isinstance(value, int) and not isinstance(value, bool) else value

"""The address of a page as a square that a phone reads."""

from __future__ import annotations

import importlib
import io
from typing import Any

from rsicalib.plain_text import installed_by


def square(text: str) -> str:
    """A QR code in half blocks for a terminal; how to have one, where none can be made."""
    try:
        # By name: an optional dependency.
        qrcode: Any = importlib.import_module("qrcode")
    except ImportError:
        return f"for a square that a phone reads: {installed_by('phone')}"
    code = qrcode.QRCode(border=2)
    code.add_data(text)
    out = io.StringIO()
    code.print_ascii(out=out, invert=True)
    return out.getvalue().rstrip("\n")

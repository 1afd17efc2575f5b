"""Lines of a file or of a pipe as they arrive, and what stands between their cells."""

from __future__ import annotations

import itertools
import os
import re
import time
import zlib
from collections.abc import Iterator

from rsicalib.errors import InputError
from rsicalib.io.csv_text import COMMENT, decimal_mark, delimiter_of, rows_of_text
from rsicalib.io.sources import LONGEST_LINE, WHOLE, decoded

CHUNK = 1 << 16
"""Bytes that are read at a time, at most: what a pipe holds is taken as soon as it is there."""

POLL_S = 0.05
"""Between two looks at a file that grows."""

END = re.compile(rb"\n|\r(?=[^\n])")
"""What the first line ends with."""

GZIP = 16 + zlib.MAX_WBITS
"""How zlib calls the format of gzip files."""

EXPECTED = "a header with a column for each channel, then one line per sample"


def parts_of(descriptor: int, label: str, follow: bool) -> Iterator[list[bytes]]:
    """Lines that are not empty, some at a time; the last one as it ends.

    A file whose first line ends in a carriage return alone, as on old Macs, has such lines.
    """
    rest, at, end = b"", 0, b""
    unpacked = _Unpacked(label)
    while True:
        chunk = os.read(descriptor, CHUNK)
        at += len(chunk)
        if not chunk and follow:
            if os.fstat(descriptor).st_size < at:
                found, expected = "less than was read of it", "a file that grows"
                raise InputError.at(label, found, expected)
            time.sleep(POLL_S)
            continue
        text = unpacked.more(chunk)
        if not end and (first := END.search(rest + text)):
            end = first[0]
        *lines, rest = (rest + text).split(end or b"\n") if chunk else (rest, b"")
        if len(rest) > LONGEST_LINE:
            found = f"a line of more than {LONGEST_LINE:,} bytes"
            raise InputError.at(label, found, "one line per sample")
        lines = [line for line in lines if line.strip()]
        if lines:
            yield lines
        if not chunk:
            return


def header_of(parts: Iterator[list[bytes]], label: str) -> tuple[str, int, Iterator[list[bytes]]]:
    """The first line that is no comment, its number, and what stands below it."""
    number = 0
    for lines in parts:
        for k, line in enumerate(lines, 1):
            number += 1
            header = decoded(line, label)
            if not header.startswith(COMMENT):
                return header, number, itertools.chain([lines[k:]] if lines[k:] else [], parts)
    raise InputError.at(label, "comments alone", EXPECTED, line=number)


class Marks:
    """What stands between cells, and before decimals: as where a file is read as a whole."""

    def __init__(self, header: str, label: str, line: int) -> None:
        self._label = label
        self._line = line
        self._delimiter = delimiter_of(header)
        self._decimal = "." if self._delimiter == "," else None
        self.names = [name.strip() for name in self._rows(header)[0]]

    def plain(self, lines: list[bytes]) -> list[bytes]:
        """The same lines with commas between cells, points before decimals, and no quotes."""
        if self._delimiter == "," and not any(b'"' in line for line in lines):
            return lines
        rows = [self._cells(line.decode("utf-8", "replace")) for line in lines]
        if self._decimal is None and any("," in c or "." in c for row in rows for c in row):
            numbers = itertools.count(self._line)
            self._decimal = decimal_mark([self.names, *rows], numbers, self._label)
        self._line += len(lines)
        # A comma that stands before no decimals makes its cell text, and parts no cells.
        comma = "." if self._decimal == "," else " "
        return [",".join(cell.replace(",", comma) for cell in row).encode() for row in rows]

    def _cells(self, line: str) -> list[str]:
        """Cells of a line; none where it is no line of CSV."""
        try:
            return self._rows(line)[0]
        except InputError:
            return []

    def _rows(self, line: str) -> list[list[str]]:
        rows, _ = rows_of_text(line.rstrip("\r"), self._label, self._delimiter, self._line - 1)
        return rows if len(rows) == 1 else [[]]


class _Unpacked:
    """Bytes as they were before gzip packed them, where it did."""

    def __init__(self, label: str) -> None:
        self._label = label
        self._packed: bool | None = None
        self._member = zlib.decompressobj(GZIP)

    def more(self, chunk: bytes) -> bytes:
        """What the next bytes hold; none at the end."""
        if self._packed is None:
            self._packed = chunk.startswith(b"\x1f\x8b")
        if not self._packed:
            return chunk
        if not chunk:
            self._ended()
        text = b""
        try:
            while chunk:
                if self._member.eof:  # files of gzip may stand one behind another
                    self._member = zlib.decompressobj(GZIP)
                text += self._member.decompress(chunk)
                chunk = self._member.unused_data
        except zlib.error as error:
            raise self._damaged(str(error)) from None
        return text

    def _ended(self) -> None:
        if not self._member.eof:
            raise self._damaged("it ends before its end")

    def _damaged(self, why: str) -> InputError:
        return InputError.at(self._label, f"a gzip file that is damaged ({why})", WHOLE)

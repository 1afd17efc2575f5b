"""Readings that are in memory already: data frames, arrays, dictionaries of columns."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence
from typing import Any, Protocol, TypeAlias, TypeGuard

import numpy as np
import numpy.typing as npt

from rsicalib.errors import InputError, InputTypeError
from rsicalib.io.extras import needed
from rsicalib.io.tables import Table, table_of_arrays, uncast
from rsicalib.io.times import TIME, dates_of

Cells: TypeAlias = Sequence[Any] | npt.NDArray[Any]
Columns: TypeAlias = dict[str, Cells]

EXPECTED = "a path, readings, a data frame, an array, or a dictionary of columns"

SOURCE = "data in memory"
"""What messages call them."""


class ArrowStream(Protocol):
    """A data frame that offers its columns as an Arrow stream."""

    def __arrow_c_stream__(self, requested_schema: object | None = None) -> object:
        """A capsule with the stream."""


class Interchange(Protocol):
    """A data frame of the interchange protocol."""

    def __dataframe__(self, nan_as_null: bool = False, allow_copy: bool = True) -> Any:
        """The frame, for other libraries."""


FrameArg: TypeAlias = ArrowStream | Interchange
"""A data frame of a library."""

ArraysArg: TypeAlias = Mapping[str, npt.ArrayLike] | npt.NDArray[Any]
"""A table that no library made."""

TableArg: TypeAlias = FrameArg | ArraysArg
"""One table in memory."""


def is_frame(given: object) -> TypeGuard[FrameArg]:
    """Whether this is a data frame of a library."""
    return any(hasattr(given, name) for name in ("__arrow_c_stream__", "__dataframe__"))


def in_memory(given: object) -> bool:
    """Whether this is one table: a data frame, an array, or a dictionary of columns."""
    return isinstance(given, np.ndarray | Mapping) or is_frame(given)


def as_table(given: Any) -> Any:
    """Rows as plain lists of numbers, or as dictionaries, as one table; anything else as it is.

    Raises
    ------
    InputError
        Rows that are dictionaries differ in their names.
    InputTypeError
        It is what was read from a file, or the open file, in the place of its path; or one column.
    """
    if isinstance(given, str):
        if "\n" in given:
            raise InputTypeError("readings: found the text of a file, expected its path")
        return given
    if isinstance(given, bytes | bytearray) or hasattr(given, "readline"):
        raise InputTypeError(f"readings: found {_kind(given)}, expected {EXPECTED}")
    if in_memory(given):
        if not isinstance(given, np.ndarray) and getattr(given, "ndim", 2) == 1:
            raise InputTypeError(f"readings: found {_kind(given)}, expected {EXPECTED}")
        return given
    if not isinstance(given, list | tuple) or not given:
        return given
    if all(isinstance(row, Mapping) and not any(map(_holds, row.values())) for row in given):
        names = list(given[0])
        if odd := next((n for row in given for n in row.keys() ^ given[0].keys()), None):
            found, expected = f"rows with and without {odd!r}", "the same names in all rows"
            raise InputError.at(SOURCE, found, expected)
        return {str(name): [row[name] for row in given] for name in names}
    if all(isinstance(row, list | tuple) and row and all(map(_number, row)) for row in given):
        if len({len(row) for row in given}) > 1:
            raise InputTypeError(f"readings: found rows of unlike lengths, expected {EXPECTED}")
        return np.asarray(given)
    return given


def _kind(given: object) -> str:
    return f"a value of type {type(given).__name__}"


def _holds(cell: object) -> bool:
    """Whether a cell holds several values, as a column does."""
    return np.ndim(cell) > 0 if isinstance(cell, list | tuple | np.ndarray) else False


def _number(cell: object) -> bool:
    return isinstance(cell, int | float | np.number)


def table_in_memory(given: object, channels: Sequence[str], source: str = SOURCE) -> Table:
    """A table from memory; an array has the columns of the channels, in their order.

    Parameters
    ----------
    given : data frame, mapping of str to array_like, or array_like of shape (n, C) or (C,)
        A data frame is anything with `__arrow_c_stream__` or `__dataframe__`: of pandas, polars,
        pyarrow and others.
    channels : sequence of str
        Names for the columns of an array.
    source : str
        What messages call it.

    Raises
    ------
    InputError
        The columns are not of one length, or of a type that holds neither numbers nor text.
    """
    given = as_table(given)
    if isinstance(given, np.ndarray | Sequence):
        try:
            given = uncast(given)
        except ValueError:
            found = f"{_kind(given)} whose entries differ in length"
            raise InputTypeError(f"readings: found {found}, expected {EXPECTED}") from None
        given = given[np.newaxis] if given.ndim == 1 else given  # one reading
        return table_of_arrays([(list(channels), given)], source)
    if not in_memory(given):
        raise InputTypeError(f"readings: found {given!r}, expected {EXPECTED}")
    columns = columns_of(given)
    if not columns:
        raise InputError.at(source, "no columns", "one for each channel")
    blocks: list[tuple[Sequence[str], object]] = [
        ([str(name)], cells) for name, cells in columns.items()
    ]
    return table_of_arrays(blocks, source)


def columns_of(frame: Any) -> Columns:
    """Columns of a table by name, each of length n: arrays of numbers, or lists.

    pandas, Polars, pyarrow and plain mappings are told apart by what they have; pyarrow is needed
    for the others alone.

    Raises
    ------
    InputError
        It is no such table, a name stands twice, or the columns differ in length.
    """
    if isinstance(frame, Mapping):
        names, cells = list(map(str, frame)), list(frame.values())
    elif hasattr(frame, "schema") and hasattr(frame, "num_rows"):  # pyarrow
        names = list(frame.schema.names)
        cells = [_arrow(frame.column(i)) for i in range(len(names))]
    elif hasattr(frame, "columns"):  # pandas, Polars
        frame = _with_index(frame)
        names = list(map(str, frame.columns))
        _refuse_doubled(names)
        cells = [frame[name] for name in frame.columns]
    elif is_frame(frame):
        return columns_of(_as_arrow(frame))
    else:
        expected = "a data frame, or a mapping of names to arrays"
        raise InputTypeError(f"found {type(frame).__name__}, expected {expected}")
    _refuse_doubled(names)
    columns = {name: _plain(column) for name, column in zip(names, cells, strict=True)}
    if len({len(column) for column in columns.values()}) > 1:
        sizes = ", ".join(f"{name}: {len(column)}" for name, column in columns.items())
        raise InputError(f"found columns of different lengths ({sizes}), expected one length")
    return columns


def frame_of(like: Any, columns: Mapping[str, Cells]) -> Any:
    """Columns as a table of the kind of `like`; a mapping where that cannot be made of columns."""
    if hasattr(like, "schema") and hasattr(like, "num_rows"):  # pyarrow
        return type(like).from_pydict(columns)
    if hasattr(like, "columns"):  # pandas, Polars, and others with such a constructor
        with contextlib.suppress(TypeError):
            return type(like)(columns)
    return dict(columns)


def _with_index(frame: Any) -> Any:
    """A frame of pandas with the levels of its index that have a name as columns.

    Dates without a name are the times of the rows.
    """
    if _is_of_dates(frame):
        frame = frame.rename_axis(TIME)
    names = [n for n in getattr(getattr(frame, "index", None), "names", ()) if n is not None]
    if not names:
        return frame
    _refuse_doubled([*map(str, names), *map(str, frame.columns)])
    unnamed = [k for k, name in enumerate(frame.index.names) if name is None]
    return (frame.reset_index(level=unnamed, drop=True) if unnamed else frame).reset_index()


def _is_of_dates(frame: Any) -> bool:
    """Whether the index has no name and holds dates, beside no column of times."""
    index = getattr(frame, "index", None)
    if getattr(index, "name", "") is not None or TIME in frame.columns:
        return False
    return getattr(getattr(index, "dtype", None), "kind", "") in ("m", "M")


def _as_arrow(frame: Any) -> Any:
    what = f"a {type(frame).__name__}"
    if hasattr(frame, "__arrow_c_stream__"):
        return needed("pyarrow", SOURCE, what).table(frame)
    return needed("pyarrow.interchange", SOURCE, what).from_dataframe(frame)


def _arrow(column: Any) -> Any:
    return column.to_pylist() if column.null_count else column.to_numpy(zero_copy_only=False)


def _plain(cells: Any) -> Cells:
    """Numbers stay an array; text and objects become a list, None where nothing is known."""
    array = uncast(cells.to_numpy() if hasattr(cells, "to_numpy") else cells)
    if array.ndim != 1:
        raise InputError.at(SOURCE, f"a column of shape {array.shape}", "(n,)")
    if array.dtype.kind in "iuf":
        return array
    dates = dates_of(array)
    if dates is not None:
        return dates
    if array.dtype.kind != "U":
        try:
            array = cells.to_numpy(dtype=object, na_value=None)  # pandas: NA is no value
        except (AttributeError, TypeError):
            array = array.astype(object)
    return array.tolist()  # type: ignore[no-any-return]


def _refuse_doubled(names: list[str]) -> None:
    for name in names:
        if names.count(name) > 1:
            found = f"{names.count(name)} columns of this name"
            raise InputError.at(SOURCE, found, "one", column=name)

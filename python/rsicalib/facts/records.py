"""Values in the shape of the JSON: frozen dataclasses, to and from plain dictionaries."""

from __future__ import annotations

import dataclasses
import json
import math
import types
from collections.abc import Callable, Mapping
from functools import cache, partial
from typing import (
    TYPE_CHECKING,
    Any,
    ClassVar,
    Self,
    TypeAlias,
    Union,
    dataclass_transform,
    get_args,
    get_origin,
    get_type_hints,
)

import numpy as np
import numpy.typing as npt

from rsicalib.errors import ResultError
from rsicalib.labels import Labelled
from rsicalib.plain_text import encodable

OMIT: dict[str, Any] = {"omit": (None, [], {})}
"""Metadata of a field that does not stand in the JSON where it is None or empty."""
IF_KNOWN: dict[str, Any] = {"omit": (None,)}
"""Metadata of a field that does not stand in the JSON where it is None."""
NOT_WRITTEN: dict[str, Any] = {"written": False}
"""Metadata of a field that never stands in the JSON."""


@dataclass_transform(frozen_default=True, field_specifiers=(dataclasses.field,))
class Record:
    """A frozen dataclass that is read from, and written to, plain dictionaries.

    Keys that a class does not know are ignored, so that results of later
    versions can be read; None and NaN are the same: not known.

    Whatever is derived from it is such a dataclass; what else `dataclass` is to know stands
    in the line of the class: `class Noise(Record, eq=False)`.
    """

    if TYPE_CHECKING:  # `dataclass` writes it
        __dataclass_fields__: ClassVar[dict[str, dataclasses.Field[Any]]]

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__()
        dataclasses.dataclass(frozen=True, **options)(cls)

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Self:
        """Read a record, and the records in it.

        Parameters
        ----------
        data : mapping
            As `to_dict` writes it.

        Returns
        -------
        Self
            Of this class.

        Raises
        ------
        KeyError
            Something that has no default is missing.
        """
        return cls(**{n: read(data[key]) for n, key, read in _fields(cls) if key in data})  # type: ignore[arg-type]

    def to_dict(self) -> dict[str, Any]:
        """Write the record as plain values: dictionaries, lists, numbers, text, None.

        Returns
        -------
        dict
            Keys in the order of the fields.
        """
        out = {}
        for name, key, omit in _written(type(self)):  # type: ignore[arg-type]
            value = plain(getattr(self, name))
            if value not in omit:
                out[key] = value
        return out


def plain(value: Any) -> Any:
    """Turn records, tuples and arrays into what JSON has; NaN and infinity into None."""
    if type(value) is float:  # most values are one
        return value if math.isfinite(value) else None
    if isinstance(value, Record):
        return value.to_dict()
    if isinstance(value, Mapping):
        return {encodable(str(key)): plain(v) for key, v in value.items()}
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, list | tuple):
        return [plain(v) for v in value]
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if isinstance(value, str):
        return encodable(value)
    return value


def to_json(value: Any) -> str:
    """Write plain values as JSON that people can read: one entry of a list to a line."""
    return _lines(plain(value), "") + "\n"


_flat = json.JSONEncoder(ensure_ascii=False, allow_nan=False).encode


def _lines(value: Any, indent: str) -> str:
    if not isinstance(value, dict | list) or not value:
        return _flat(value)
    if isinstance(value, list) and all(isinstance(v, int | float) for v in value):
        return _flat(value)
    inner = indent + "  "
    if isinstance(value, dict):
        first, last = "{}"
        items = [f"{_flat(k)}: {_lines(v, inner)}" for k, v in value.items()]
    else:
        first, last = "[]"
        items = [_lines(v, inner) for v in value]
    # What fits into a line with what stands around it fits into one alone.
    short = len(indent) + sum(map(len, items)) + 2 * len(items) <= 160
    if short and not any("\n" in item for item in items):
        return first + ", ".join(items) + last
    return f"{first}\n" + ",\n".join(inner + item for item in items) + f"\n{indent}{last}"


Reader: TypeAlias = Callable[[Any], Any]


@cache
def _written(cls: type[Record]) -> tuple[tuple[str, str, Any], ...]:
    """Name and key of each field that is written, and the values with which it is not."""
    fields = [f for f in dataclasses.fields(cls) if f.metadata.get("written", True)]
    return tuple(
        (f.name, f.metadata.get("key", f.name), f.metadata.get("omit", ())) for f in fields
    )


@cache
def _fields(cls: type[Record]) -> tuple[tuple[str, str, Reader], ...]:
    """Name, key and reader of each field."""
    kinds = get_type_hints(cls)
    fields = dataclasses.fields(cls)
    return tuple((f.name, f.metadata.get("key", f.name), _reader(kinds[f.name])) for f in fields)


@cache
def _reader(kind: Any) -> Reader:
    """What reads a value as its annotation says: a record, a tuple of them, an array."""
    if get_origin(kind) in (Union, types.UnionType):
        return _reader(next(k for k in get_args(kind) if k is not type(None)))
    if isinstance(kind, type) and issubclass(kind, Record):
        return partial(_record, kind)
    if get_origin(kind) is tuple:
        return partial(_tuple, _reader(get_args(kind)[0]))
    if kind is Labelled:
        return _labelled
    if get_origin(kind) in (np.ndarray, npt.NDArray):  # an alias from numpy 2.5 on
        return _array
    return _as_it_is


def _record(kind: type[Record], value: Any) -> Any:
    return value if value is None or isinstance(value, kind) else kind.from_dict(value)


def _tuple(read: Reader, value: Any) -> Any:
    if read is _as_it_is:
        return None if value is None else tuple(value)
    return None if value is None else tuple(map(read, value))


def _array(value: Any) -> Any:
    if value is None:
        return None
    if isinstance(value, np.ndarray) and value.dtype == np.float64 and not value.flags.writeable:
        return value  # of the core, which keeps none of its own
    try:
        array = np.array(value, dtype=np.float64)  # None becomes NaN
    except ValueError:
        expected = "numbers, in rows of one length"
        raise ResultError("a table of numbers", "rows of unlike lengths", expected) from None
    array.flags.writeable = False
    return array


def _labelled(value: Any) -> Any:
    array = _array(value)
    return None if array is None else array.view(Labelled)  # the names are not known here


def _as_it_is(value: Any) -> Any:
    return value

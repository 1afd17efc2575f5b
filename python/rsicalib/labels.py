"""Matrices whose rows and columns have names."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
import numpy.typing as npt

from rsicalib.plain_text import meant
from rsicalib.tabular import Tabular, html_table

if TYPE_CHECKING:
    _Base = npt.NDArray[np.float64]
else:
    _Base = np.ndarray


class Labelled(_Base, Tabular):
    """A square matrix with a name for each row, and the same name for its column.

    An array in all else: slices and results of arithmetic are plain arrays. In a data frame the
    names are the index and the columns.

    Attributes
    ----------
    names : tuple of str
        Names of the rows, in their order.

    Examples
    --------
    >>> m = Labelled.of([[4.0, 1.0], [1.0, 9.0]], ["gain@a11", "offset@a11"])
    >>> float(m["gain@a11", "offset@a11"])
    1.0
    >>> m["gain@a11"]
    array([4., 1.])
    >>> m[["offset@a11"]]
    array([[9.]])
    """

    ROWS: ClassVar[str | None] = "name"

    names: tuple[str, ...]

    @classmethod
    def of(cls, values: npt.ArrayLike, names: Sequence[str]) -> Labelled:
        """Name the rows of a matrix, which is then read-only.

        Parameters
        ----------
        values : array_like, shape (n, n)
            The matrix.
        names : sequence of str
            `n` different names; none where they are not known.

        Returns
        -------
        Labelled
            A view of the matrix where that is possible.

        Raises
        ------
        ValueError
            There is not one name for each row.
        """
        array = np.asarray(values, dtype=np.float64)
        if array.size and names and array.shape != (len(names), len(names)):
            raise ValueError(f"found shape {array.shape}, expected {len(names)} rows and columns")
        out = array.view(cls)
        out.names = tuple(names)
        out.flags.writeable = False
        return out

    @property
    def correlation(self) -> Labelled:
        """The matrix divided by the roots of its diagonal: ones there, NaN where it is zero."""
        sd = np.sqrt(np.diagonal(np.asarray(self)))
        with np.errstate(invalid="ignore", divide="ignore"):
            return Labelled.of(np.asarray(self) / np.outer(sd, sd), self.names)

    def __array_finalize__(self, of: Any) -> None:
        same = getattr(of, "shape", None) == self.shape
        self.names = getattr(of, "names", ()) if same else ()

    def __array_wrap__(self, array: Any, *more: Any, **how: Any) -> Any:
        return np.asarray(array)[()] if np.ndim(array) == 0 else np.asarray(array)

    def __getitem__(self, key: Any) -> Any:
        if isinstance(key, str):
            return np.asarray(self)[self._row(key)]
        if isinstance(key, tuple) and any(isinstance(k, str) for k in key):
            rows = tuple(self._row(k) if isinstance(k, str) else k for k in key)
            return np.asarray(self)[rows]
        if isinstance(key, list) and key and all(isinstance(k, str) for k in key):
            rows_of = [self._row(k) for k in key]
            return np.asarray(self)[np.ix_(rows_of, rows_of)]
        return np.asarray(self)[key]

    def _row(self, name: str) -> int:
        try:
            return self.names.index(name)
        except ValueError:
            near = meant(name, self.names)
            there = ", ".join(self.names)
            raise KeyError(f"no row {name!r}{near}; there are {there}") from None

    def __reduce__(self) -> Any:
        return Labelled.of, (np.array(self), self.names)

    def __deepcopy__(self, memo: Any) -> Labelled:
        return Labelled.of(np.array(self), self.names)

    def _table(self) -> dict[str, Any]:
        columns = {name: np.asarray(self)[:, k] for k, name in enumerate(self.names)}
        return {"name": self.names, **columns}

    def _repr_html_(self) -> str | None:
        # What is no matrix of these rows any more is shown as any array.
        square = self.shape == (len(self.names),) * 2
        return html_table(self._table()) if square and self.names else None

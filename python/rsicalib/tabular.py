"""What is a table at heart: as a data frame, and as HTML in a notebook."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from html import escape
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from rsicalib.plain_text import installed_by

if TYPE_CHECKING:
    import pandas
    import polars


MOST_ROWS = 60
"""A longer table is cut in the middle where it is shown."""


def data_frame(columns: Mapping[str, Any], index: str | None = None) -> pandas.DataFrame:
    """Make a data frame of columns.

    Parameters
    ----------
    columns : mapping of str to sequence
        Columns of one length, in their order.
    index : str, optional
        The column that names the rows.

    Returns
    -------
    pandas.DataFrame
        With copies of the columns.

    Raises
    ------
    ImportError
        pandas is not installed.
    """
    try:
        import pandas
    except ImportError as error:
        raise ImportError(f"a data frame needs pandas: {installed_by('pandas')}") from error
    frame = pandas.DataFrame({name: list(cells) for name, cells in columns.items()})
    return frame if index is None else frame.set_index(index)


def polars_frame(columns: Mapping[str, Any]) -> polars.DataFrame:
    """Make a data frame of Polars of columns of one length.

    Raises
    ------
    ImportError
        Polars is not installed.
    """
    try:
        import polars
    except ImportError as error:
        raise ImportError("a data frame of Polars needs it: pip install polars") from error
    return polars.DataFrame({name: list(cells) for name, cells in columns.items()})


def html_table(columns: Mapping[str, Any], caption: str = "") -> str:
    """Write columns as an HTML table; text is escaped, numbers have six digits.

    Parameters
    ----------
    columns : mapping of str to sequence
        Columns of one length, in their order.
    caption : str
        A line above the table.

    Returns
    -------
    str
        A `<table>` element, cut in the middle where it is long.
    """
    rows = list(zip(*columns.values(), strict=True))
    cut = len(rows) > MOST_ROWS
    shown = [*rows[: MOST_ROWS // 2], *rows[-MOST_ROWS // 2 :]] if cut else rows
    lines = [_row(row) for row in shown]
    if cut:
        words = f"… {len(rows) - len(shown)} more rows …"
        lines.insert(MOST_ROWS // 2, f'<tr><td colspan="{len(columns)}">{words}</td></tr>')
    head = "".join(f"<th>{escape(name)}</th>" for name in columns)
    title = f"<caption>{escape(caption)}</caption>" if caption else ""
    body = "\n".join(lines)
    return f"<table>{title}<thead><tr>{head}</tr></thead>\n<tbody>\n{body}\n</tbody></table>"


def _row(cells: Iterable[Any]) -> str:
    return f"<tr>{''.join(map(_cell, cells))}</tr>"


def _cell(value: Any) -> str:
    if value is None or (isinstance(value, float) and np.isnan(value)):
        return '<td style="text-align:right">–</td>'
    if isinstance(value, float | np.floating):
        return f'<td style="text-align:right">{float(value):.6g}</td>'
    if isinstance(value, int | np.integer) and not isinstance(value, bool):
        return f'<td style="text-align:right">{int(value)}</td>'
    return f'<td style="text-align:left">{escape(str(value))}</td>'


class Tabular:
    """A value that is a table: `_table` says which columns, `ROWS` which of them names the rows."""

    ROWS: ClassVar[str | None] = None

    def _table(self) -> Mapping[str, Any]:
        raise NotImplementedError

    def to_dataframe(self) -> pandas.DataFrame:
        """Make a data frame; needs pandas (`pip install 'rsicalib[pandas]'`).

        Returns
        -------
        pandas.DataFrame
            One row for each entry.
        """
        return data_frame(self._table(), self.ROWS)

    def to_polars(self) -> polars.DataFrame:
        """Make a data frame of Polars (`pip install polars`).

        Returns
        -------
        polars.DataFrame
            One row for each entry; what names the rows is a column.
        """
        return polars_frame(self._table())

    def _repr_html_(self) -> str | None:
        return html_table(self._table(), repr(self))


class Told:
    """A value that is told in a few lines: `text` says them."""

    def text(self) -> str:
        """What there is to say."""
        raise NotImplementedError

    def _repr_html_(self) -> str:
        return f"<pre>{escape(self.text())}</pre>"

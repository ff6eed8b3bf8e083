"""What `simyard.results` returns: a table of episodes."""

from dataclasses import dataclass
from importlib.util import find_spec
from itertools import islice
from typing import TYPE_CHECKING, Any, cast

from simyard.answer.html import MOST_ROWS, badge, block, heading, table, text
from specs.base import Fault
from specs.errors import DocumentError

if TYPE_CHECKING:
    import pandas as pd
    import polars as pl
    import pyarrow as pa

# What a reader looks at first, of the three dozen columns.
_FIRST = ("index", "world", "seed", "success", "outcome", "outcome_reason", "path_length_m")
_VARIABLE = "env_"
_MOST_COLUMNS = 10
_CELL = 60


@dataclass(frozen=True, eq=False, repr=False)
class Results:
    """The episodes of a batch, a row each; whatever reads Arrow reads it as it is, such as DuckDB and Polars.

    Attributes:
        batch: Its id.
        table: The rows, as an Arrow table.
    """

    batch: str
    table: "pa.Table"

    def to_arrow(self) -> "pa.Table":
        """Returns the rows as an Arrow table."""
        return self.table

    def to_pandas(self) -> "pd.DataFrame":
        """Returns the rows as a data frame of pandas.

        Raises:
            DocumentError: pandas is not installed.
        """
        _require("pandas")
        return self.table.to_pandas()

    def to_polars(self) -> "pl.DataFrame":
        """Returns the rows as a data frame of Polars.

        Raises:
            DocumentError: Polars is not installed.
        """
        _require("polars")
        import polars  # noqa: PLC0415 - an extra

        return polars.DataFrame(cast("Any", self.table))

    @property
    def columns(self) -> tuple[str, ...]:
        """The names of the columns."""
        return tuple(self.table.column_names)

    def __len__(self) -> int:
        """Returns how many episodes there are."""
        return self.table.num_rows

    def __arrow_c_stream__(self, requested_schema: object = None) -> object:
        """Returns the rows for whatever reads Arrow."""
        return self.table.__arrow_c_stream__(requested_schema)

    def __repr__(self) -> str:
        """Returns its batch and its size."""
        return f"<Results of {self.batch}: {len(self):,} episodes, {len(self.columns)} columns>"

    def _repr_html_(self) -> str:
        shown = self._shown()
        rows = (tuple(_cell(name, row[name]) for name in shown) for row in islice(self._rows(shown), MOST_ROWS))
        size = f"{len(self):,} episodes, {len(self.columns)} columns"
        return block(heading(self.batch, text(size)), table(shown, rows, len(self), "; to_pandas() has all"))

    def _shown(self) -> tuple[str, ...]:
        variables = [name for name in self.columns if name.startswith(_VARIABLE)]
        wanted = [name for name in _FIRST if name in self.columns] + variables
        return tuple((wanted or list(self.columns))[:_MOST_COLUMNS])

    def _rows(self, columns: tuple[str, ...]) -> list[dict[str, Any]]:
        return self.table.select(list(columns)).slice(0, MOST_ROWS).to_pylist()


def _cell(name: str, value: object) -> str:
    if name == "success":
        return badge("none" if value is None else "passed" if value else "failed")
    return text("" if value is None else f"{value:.4g}" if isinstance(value, float) else value, _CELL)


def _require(library: str) -> None:
    if find_spec(library) is None:
        allowed = f"run pip install 'simyard[{library}]'; without it, .table is an Arrow table"
        raise DocumentError(
            [Fault(path=f"to_{library}()", value=f"{library} is not installed", allowed=allowed)], "simyard"
        )

# ruff: noqa: ANN401 - a stub for a package without types says Any where it does not know
from io import BytesIO
from pathlib import Path
from typing import Any

from pyarrow import Table

def write_table(table: Table, where: Path | str, **kwargs: Any) -> None: ...
def read_table(source: Path | str | BytesIO, **kwargs: Any) -> Table: ...
def __getattr__(name: str) -> Any: ...  # pyright: ignore[reportIncompleteStub] - incomplete on purpose

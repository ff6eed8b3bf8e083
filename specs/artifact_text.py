"""Text of strangers for Prefect's pages, which read Markdown and HTML in artifacts, and links in cells of tables."""

import re
from collections.abc import Iterable, Mapping

from pydantic import JsonValue

from specs.terminal_text import terminal_line

_ACTIVE = re.compile(r"([\\`*_{}\[\]<>()#+!|~&])")
# A cell is shown as it stands but for these: a link, a picture, an element of HTML.
_ACTIVE_IN_CELL = re.compile(r"([`\[\]<>|])")


def escape_markdown(text: str) -> str:
    """Returns the text with what Markdown or HTML would take for more than text escaped, in one line."""
    return _ACTIVE.sub(r"\\\1", terminal_line(text))


def table_rows(rows: Iterable[Mapping[str, JsonValue]]) -> list[dict[str, JsonValue]]:
    """Returns rows for an artifact that is a table: each cell one line of text, and neither link nor HTML."""
    return [{name: _cell(value) for name, value in row.items()} for row in rows]


def _cell(value: JsonValue) -> JsonValue:
    return _ACTIVE_IN_CELL.sub(r"\\\1", terminal_line(value)) if isinstance(value, str) else value

"""Text of strangers for Prefect's pages: keys of artifacts, and what these show as Markdown, as HTML, in tables."""

import hashlib
import re
from collections.abc import Iterable, Mapping

from pydantic import JsonValue

from specs.terminal_text import terminal_line

_ACTIVE = re.compile(r"([\\`*_{}\[\]<>()#+!|~&])")
# A cell is shown as it stands but for these: a link, a picture, an element of HTML.
_ACTIVE_IN_CELL = re.compile(r"([`\[\]<>|])")
_PLAIN_NAME = re.compile(r"[a-z0-9]+(-[a-z0-9]+)*")
_LONGEST_NAME = 48


def artifact_key(document: str, what: str) -> str:
    """Returns the key under which Prefect keeps the history of an artifact; no two names of documents share one.

    A key has lower-case letters, digits and dashes. Two dashes part the document's name from the rest. A name that is
    long, or has other characters, is cut and changed, and its digest stands behind it, between two dashes and two.

    Args:
        document: The document's name; empty for what belongs to no document.
        what: What the artifact shows, such as ``batch-results``: words with single dashes between them.
    """
    if not document:
        return what
    if _PLAIN_NAME.fullmatch(document) and len(document) <= _LONGEST_NAME:
        return f"{document}--{what}"
    shown = re.sub(r"[^a-z0-9]+", "-", document.lower())[:_LONGEST_NAME].strip("-") or "document"
    return f"{shown}--{hashlib.sha256(document.encode()).hexdigest()[:16]}--{what}"


def escape_markdown(text: str) -> str:
    """Returns the text with what Markdown or HTML would take for more than text escaped, in one line."""
    return _ACTIVE.sub(r"\\\1", terminal_line(text))


def table_rows(rows: Iterable[Mapping[str, JsonValue]]) -> list[dict[str, JsonValue]]:
    """Returns rows for an artifact that is a table: each cell one line of text, and neither link nor HTML."""
    return [{name: _cell(value) for name, value in row.items()} for row in rows]


def _cell(value: JsonValue) -> JsonValue:
    return _ACTIVE_IN_CELL.sub(r"\\\1", terminal_line(value)) if isinstance(value, str) else value

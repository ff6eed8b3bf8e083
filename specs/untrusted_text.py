"""Text of strangers for terminals, pages and CI, without what steers a terminal or what Markdown and HTML obey."""

import hashlib
import re
from collections.abc import Iterable, Mapping

from pydantic import JsonValue

# What steers a terminal (C0 but tab and newline, C1), turns text around, or cannot be seen: the categories Cc, Cf, Zl,
# Zp and Cs of Unicode 15.
_UNSEEN = re.compile(
    "[\x00-\x08\x0b-\x1f\x7f-\x9f\xad\u0600-\u0605\u061c\u06dd\u070f\u0890\u0891\u08e2\u180e\u200b-\u200f"
    "\u2028-\u202e\u2060-\u206f\ufeff\ufff9-\ufffb\ud800-\udfff\U000110bd\U000110cd\U00013430-\U0001343f"
    "\U0001bca0-\U0001bca3\U0001d173-\U0001d17a\U000e0001\U000e0020-\U000e007f]"
)
_ACTIVE = re.compile(r"([\\`*_{}\[\]<>()#+!|~&])")
# A cell is shown as it stands but for these: a link, a picture, an element of HTML.
_ACTIVE_IN_CELL = re.compile(r"([`\[\]<>|])")
# What XML cannot hold, and what turns the direction of the text around it.
_UNFIT = re.compile("[^\t\n\r\x20-\x7e\xa0-\u2029\u202f-\u2065\u206a-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
_PLAIN_NAME = re.compile(r"[a-z0-9]+(-[a-z0-9]+)*")
_LONGEST_NAME = 48


def terminal_text(text: str) -> str:
    """Returns a text without the characters that steer a terminal; tabs and ends of lines stay."""
    return _UNSEEN.sub("", text)


def terminal_line(text: str) -> str:
    """Returns a text as one line of a terminal, which nobody takes for several."""
    return " ".join(terminal_text(text).split())


def without_commands(text: str) -> str:
    """Returns a text in which GitHub's runner finds no workflow command, whatever stands before it on its line.

    The runner obeys lines that begin with two colons, after spaces, and ``##[`` wherever it stands.
    """
    return text.replace("::", ": :").replace("##[", "## [")


def terminal_json(text: str) -> str:
    """Returns JSON that means the same, with the characters that steer a terminal written as escapes."""
    return _UNSEEN.sub(lambda found: _escaped(found[0]), text)


def _escaped(character: str) -> str:
    units = character.encode("utf-16-be", "surrogatepass")
    return "".join(f"\\u{units[at]:02x}{units[at + 1]:02x}" for at in range(0, len(units), 2))


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


def xml_text(text: str) -> str:
    """Returns the text with a sign in the place of each character that XML cannot hold, or that turns text around."""
    return _UNFIT.sub("\ufffd", text)


def code_span(text: str, most: int = 300) -> str:
    """Returns the text as code in one line of Markdown, also in a table; nothing in it is a link, a name or HTML.

    GitHub makes links of addresses, of ``@name`` and of ``#7`` even where they are escaped, but not in code. What would
    end the code or the cell is shown as what looks like it: a backquote as a quote, a bar as a broken bar.

    Args:
        text: Of anybody.
        most: Characters; what is longer is cut off with an ellipsis.
    """
    line = xml_text(terminal_line(text)).replace("`", "'").replace("|", "\u00a6")
    shown = line if len(line) <= most else f"{line[: most - 1]}…"
    return f"`{shown}`" if shown else ""


def table_rows(rows: Iterable[Mapping[str, JsonValue]]) -> list[dict[str, JsonValue]]:
    """Returns rows for an artifact that is a table: each cell one line of text, and neither link nor HTML."""
    return [{name: _cell(value) for name, value in row.items()} for row in rows]


def _cell(value: JsonValue) -> JsonValue:
    return _ACTIVE_IN_CELL.sub(r"\\\1", terminal_line(value)) if isinstance(value, str) else value

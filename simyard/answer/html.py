"""The HTML that a notebook is shown: escaped, of a bounded size, without styles or scripts that reach its page.

Colours are the notebook's own, light or dark, but for the badges and drawings, which bring their ground along. A
drawing is an image, because the styles of an SVG in the page would change all others there.
"""

import base64
from collections.abc import Iterable, Sequence
from html import escape
from itertools import islice
from urllib.parse import urlsplit

from specs.untrusted_text import terminal_text

MOST_ROWS = 24
_LONGEST = 300
_MOST_PICTURE_BYTES = 4 << 20
_LINKED = frozenset({"http", "https", "file"})
_GROUNDS = {"green": "#18713a", "red": "#b3261e", "amber": "#8a5300", "grey": "#5a6068"}
_GREEN = frozenset({"PASS", "Completed", "Succeeded", "passed", "the same", "NO WORSE", "InSync"})
_AMBER = frozenset({"INCONCLUSIVE", "PartialFailed", "Skipped", "Pending", "Running", "InProgress", "higher", "lower"})
_CELL = "text-align:left;vertical-align:top;padding:2px 14px 2px 0;border:0"


class Html(str):
    """Text that is HTML already; every other text is escaped."""

    __slots__ = ()


def text(value: object, longest: int = _LONGEST) -> Html:
    """Returns a text as HTML, without characters that nobody sees, cut to a length."""
    seen = terminal_text(str(value))
    return Html(escape(seen if len(seen) <= longest else f"{seen[: longest - 1]}\u2026"))


def badge(word: str) -> Html:
    """Returns a verdict or a status on a coloured ground."""
    color = "green" if word in _GREEN else "amber" if word in _AMBER else "grey" if word == "none" else "red"
    style = f"background:{_GROUNDS[color]};color:#fff;padding:1px 8px;border-radius:9px;font-weight:600"
    return Html(f'<span style="{style}">{text(word, 40)}</span>')


def link(url: str, label: str = "") -> Html:
    """Returns a link; of what no browser opens, such as an object of S3, or no eye sees whole, the text alone."""
    if urlsplit(url).scheme not in _LINKED or terminal_text(url) != url:
        return text(f"{label}: {url}" if label else url)
    return Html(f'<a href="{escape(url)}" target="_blank" rel="noopener">{text(label or url)}</a>')


def heading(title: str, *beside: str) -> Html:
    """Returns a line in bold, and what stands beside it."""
    return Html(" ".join((f"<strong>{text(title)}</strong>", *map(_html, beside))))


def table(headings: Sequence[str], rows: Iterable[Sequence[object]], total: int, note: str = "") -> Html:
    """Returns a table of the first rows.

    Args:
        headings: Of the columns.
        rows: Their cells; what is no ``Html`` is escaped.
        total: How many rows there are.
        note: What to do to see the others.
    """
    shown = [tuple(_html(cell) for cell in row) for row in islice(rows, MOST_ROWS)]
    head = "".join(f'<th style="{_CELL};opacity:.7">{text(each)}</th>' for each in headings)
    body = "".join(_row(cells) for cells in shown)
    left = total - len(shown)
    more = paragraph(f"and {left:,} more{note}") if left > 0 else ""
    style = "border-collapse:collapse;margin:4px 0;color:inherit;background:none"
    return Html(f'<table style="{style}"><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>{more}')


def paragraph(what: str) -> Html:
    """Returns a paragraph."""
    return Html(f'<p style="margin:4px 0">{_html(what)}</p>')


def picture(svg: str, alt: str, width: int) -> Html:
    """Returns a drawing as an image of so many pixels at most; of one that is too large, what it would show."""
    body = svg.encode()
    if len(body) > _MOST_PICTURE_BYTES:
        return paragraph(f"{alt}: a drawing of {len(body) >> 20} MiB, which is too large for a notebook")
    style = f"max-width:min(100%,{width}px);height:auto;background:#fff;border-radius:4px"
    source = f"data:image/svg+xml;base64,{base64.b64encode(body).decode()}"
    return Html(f'<img alt="{text(alt)}" style="{style}" src="{source}">')


def block(*parts: str) -> str:
    """Returns parts as one HTML element."""
    return f'<div style="line-height:1.45;max-width:1100px">{"".join(map(_html, parts))}</div>'


def _row(cells: Sequence[str]) -> str:
    return "<tr>" + "".join(f'<td style="{_CELL}">{cell}</td>' for cell in cells) + "</tr>"


def _html(value: object) -> Html:
    return value if isinstance(value, Html) else text(value)

"""Markdown in blocks, of which as many are taken as a page may have bytes."""

from collections.abc import Iterable, Sequence

_REST = "_The rest is left out: it would be longer than the page may be._"


def bounded_page(blocks: Iterable[str], most_bytes: int) -> str:
    """Returns blocks with empty lines between them; from the first that has no room, a sentence instead.

    No block is cut, so that none ends in the middle of a table or of code.

    Args:
        blocks: Each Markdown that can stand alone; empty ones are left out.
        most_bytes: In UTF-8, which no characters exceed either.
    """
    page, room = "", most_bytes - len(f"{_REST}\n".encode())
    for block in filter(None, blocks):
        more = f"{block}\n\n"
        if len(page.encode()) + len(more.encode()) > room:
            return f"{page}{_REST}\n" if room > 0 else ""
        page += more
    return page


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Returns a table; its cells are Markdown already. Empty if it has no rows."""
    lines = [_line(row) for row in rows]
    return "\n".join([_line(head), _line(["---"] * len(head)), *lines]) if lines else ""


def details(summary: str, body: str) -> str:
    """Returns a part of a page that is folded until somebody opens it; empty if there is nothing in it."""
    return f"<details><summary>{summary}</summary>\n\n{body}\n\n</details>" if body else ""


def _line(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"

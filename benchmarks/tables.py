"""Tables that read well in a terminal and are Markdown, and their place in a document."""

from collections.abc import Sequence


def markdown(rows: Sequence[Sequence[str]]) -> str:
    """Returns a Markdown table, padded so that columns line up; the first row is its head, the first column text."""
    widths = [max(3, *(len(row[column]) for row in rows)) for column in range(len(rows[0]))]
    padded = [
        [cell.rjust(width) if n else cell.ljust(width) for n, (cell, width) in enumerate(zip(row, widths, strict=True))]
        for row in rows
    ]
    rule = ["-" * widths[0], *("-" * (width - 1) + ":" for width in widths[1:])]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in [padded[0], rule, *padded[1:]])


def with_tables(document: str, name: str, tables: str) -> str:
    """Returns a document with what stands between ``<!-- name -->`` and ``<!-- end of name -->`` replaced.

    Raises:
        ValueError: The document has no such place, or several.
    """
    begin, end = f"<!-- {name} -->", f"<!-- end of {name} -->"
    if (document.count(begin), document.count(end)) != (1, 1):
        raise ValueError(f"the document needs one {begin} and one {end}")
    before, _, rest = document.partition(begin)
    return f"{before}{begin}\n\n{tables}\n\n{end}{rest.partition(end)[2]}"

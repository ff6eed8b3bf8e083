"""Markdown as a page reads it: which texts stand in code, and what is a link, an element, or plain text."""

from collections.abc import Iterator
from typing import NamedTuple

from markdown_it import MarkdownIt
from markdown_it.token import Token


class MarkdownParts(NamedTuple):
    """What a page of Markdown holds.

    Attributes:
        code: Texts in code.
        plain: Other texts.
        html: Elements of HTML.
        links: How many links and pictures there are.
        cells: How many cells each row of a table has, table by table.
    """

    code: list[str]
    plain: list[str]
    html: list[str]
    links: int
    rows: list[int]


def markdown_parts(page: str) -> MarkdownParts:
    """Returns what a page holds, as CommonMark with GitHub's tables reads it."""
    tokens = list(_flat(MarkdownIt("commonmark").enable("table").parse(page)))
    rows: list[int] = []
    for token in tokens:
        if token.type == "tr_open":
            rows.append(0)
        elif token.type in {"td_open", "th_open"}:
            rows[-1] += 1
    return MarkdownParts(
        code=[token.content for token in tokens if token.type == "code_inline"],
        plain=[token.content for token in tokens if token.type == "text" and token.content],
        html=[token.content for token in tokens if token.type in {"html_block", "html_inline"}],
        links=sum(token.type in {"link_open", "image"} for token in tokens),
        rows=rows,
    )


def _flat(tokens: list[Token]) -> Iterator[Token]:
    for token in tokens:
        yield token
        yield from _flat(token.children or [])

"""Finds intervals of rates that nothing says the worlds of, in texts, in Markdown and in pages."""

import re
from html.parser import HTMLParser

# 91.2 to 98.0 %, 0.912 to 0.980, +1.2 to +3.4; what fell from 95.0 to 87.2 % is a change.
_INTERVAL = re.compile(r"(?<!from )(?<!\d)(?<!\.)[+-]?\d+\.\d+ to [+-]?\d+\.\d+")
_WHERE = re.compile(
    r"in (?:these [\d,]+|this 1|no|that|those) worlds?\b|in worlds like th|in it alone|own worlds", re.IGNORECASE
)
_BLOCKS = ("table", "p", "dd", "desc", "li", "text")


def intervals(text: str) -> int:
    """Returns how many intervals a text has."""
    return len(_INTERVAL.findall(_plain(text)))


def without_estimand(text: str) -> list[str]:
    """Returns the blocks of a text or of Markdown that have an interval and do not say in which worlds.

    A table may be spoken for by what stands directly before or after it.
    """
    blocks = [block for block in re.split(r"\n\s*\n", _plain(text)) if block.strip()]
    beside = ["", *blocks, ""]
    said = [block if not block.startswith("|") else " ".join(beside[at : at + 3]) for at, block in enumerate(blocks)]
    return [block for block, all_said in zip(blocks, said, strict=True) if _is_bare(block, all_said)]


def blocks_without_estimand(page: bytes) -> list[str]:
    """Returns the blocks of a page (tables with their captions, paragraphs, descriptions) that are so."""
    parser = _Blocks()
    parser.feed(page.decode())
    parser.close()
    return [text for text in map(_plain, parser.found) if _is_bare(text, text)]


def _plain(text: str) -> str:
    return text.replace("\u00a0", " ").replace("\\", "")


def _is_bare(block: str, said: str) -> bool:
    return bool(_INTERVAL.search(block)) and not _WHERE.search(said)


class _Blocks(HTMLParser):
    """Collects the texts of blocks, of which the outermost counts."""

    def __init__(self) -> None:
        super().__init__()
        self.found: list[str] = []
        self._open: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:  # noqa: ARG002 - as inherited
        if tag in _BLOCKS:
            if not self._open:
                self.found.append("")
            self._open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        if self._open and tag == self._open[-1]:
            self._open.pop()

    def handle_data(self, data: str) -> None:
        if self._open:
            self.found[-1] += data
        else:
            self.found.append(data)

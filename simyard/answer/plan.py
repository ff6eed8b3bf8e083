"""What `simyard.plan` returns."""

from dataclasses import dataclass

from simyard.answer.html import Html, block, heading, text

_MOST_LINES = 400
_LONGEST = 2_000


@dataclass(frozen=True)
class Plan:
    """What a run of a document would do.

    Attributes:
        name: The document's.
        lines: What `simyard plan` prints.
    """

    name: str
    lines: tuple[str, ...]

    def __str__(self) -> str:
        """Returns the lines as a text."""
        return "\n".join(self.lines)

    def __repr__(self) -> str:
        """Returns its name and size."""
        return f"<Plan {self.name!r}: {len(self.lines)} lines; print() shows them>"

    def _repr_html_(self) -> str:
        shown = "\n".join(text(line, _LONGEST) for line in self.lines[:_MOST_LINES])
        left = len(self.lines) - _MOST_LINES
        more = f"\nand {left:,} lines more" if left > 0 else ""
        style = "font-family:monospace;white-space:pre-wrap;background:none;color:inherit;margin:4px 0"
        return block(heading(f"Plan of {self.name}"), Html(f'<pre style="{style}">{shown}{more}</pre>'))

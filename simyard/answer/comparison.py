"""What `simyard.compare` returns."""

from dataclasses import dataclass

from simyard.answer.html import badge, block, heading, paragraph, table, text
from tasks.results.compare.comparison_svg import flip_text
from tasks.results.compare.comparison_verdict import Comparison as Found
from tasks.results.compare.comparison_verdict import ComparisonAnswer


@dataclass(frozen=True, repr=False)
class Comparison:
    """Two batches over the episodes that both have.

    Attributes:
        found: The rates, the pairs that came out differently, the interval of the difference.
        sentence: The answer and its figures.
        notes: What was not compared, and what is not the same.
    """

    found: Found
    sentence: str
    notes: tuple[str, ...]

    @property
    def answer(self) -> ComparisonAnswer:
        """NO WORSE, WORSE or INCONCLUSIVE: the second batch, beside the first."""
        return self.found.answer

    def __repr__(self) -> str:
        """Returns the two batches and the answer."""
        return f"<Comparison of {self.found.first} and {self.found.second}: {self.sentence}>"

    def _repr_html_(self) -> str:
        pairs = self.found.pairs
        rates = [
            (name, f"{passed} of {pairs.pairs}", f"{passed / pairs.pairs:.3f}")
            for name, passed in ((self.found.first, pairs.first_passed), (self.found.second, pairs.second_passed))
        ]
        flips = [(badge("gained" if each.gained else "lost"), flip_text(each)) for each in pairs.flips]
        return block(
            heading("Comparison", badge(self.answer), text(self.sentence.removeprefix(f"{self.answer}: "))),
            table(("batch", "passed", f"rate {self.found.where()}"), rates, len(rates)),
            *((table(("flip", "episode"), flips, len(flips)),) if flips else ()),
            *map(paragraph, self.notes),
        )

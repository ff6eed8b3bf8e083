"""What `simyard.gate` returns."""

from dataclasses import dataclass

from flows.batch.judge_again import LaterVerdict
from simyard.answer.html import badge, block, heading, link, paragraph, table
from specs.data.run_report import Verdict


@dataclass(frozen=True, repr=False)
class Judgement:
    """A later answer of a gate on a batch; it ships nothing.

    Attributes:
        found: The verdict, each rule's answer, the counts, and where the evidence is.
    """

    found: LaterVerdict

    @property
    def verdict(self) -> Verdict:
        """The gate's answer."""
        return self.found.verdict

    @property
    def passed(self) -> bool:
        """Whether it is PASS."""
        return self.verdict == "PASS"

    def __repr__(self) -> str:
        """Returns the batch, the answer and why."""
        return f"<Judgement of {self.found.batch}: {self.found.lines()[0]}>"

    def _repr_html_(self) -> str:
        rules = self.found.rules
        rows = ((each.title, badge(each.verdict), each.sentence.removeprefix(f"{each.verdict}: ")) for each in rules)
        return block(
            heading("Gate", badge(self.verdict), self.found.batch),
            table(("rule", "verdict", "why"), rows, len(rules)),
            *map(paragraph, (*self.found.warnings, *filter(None, [self.found.notice]))),
            paragraph(link(self.found.evidence.url, "the evidence")),
            paragraph("a later judgement ships nothing: to deploy, run the document"),
        )

"""What `simyard.report` returns."""

from dataclasses import dataclass, field

from simyard.answer.html import Html, badge, block, heading, link, paragraph, table, text
from tasks.results.report.rows import RateTable
from tasks.results.report.view import ReportView


@dataclass(frozen=True, eq=False, repr=False)
class Report:
    """The report of a batch: one HTML page that needs nothing but itself.

    Attributes:
        url: Where it was written.
        page: Its bytes.
        view: All that it shows, as data.
        notice: What whoever reads it should know of the batch; empty if nothing.
    """

    url: str
    page: bytes = field(repr=False)
    view: ReportView = field(repr=False)
    notice: str = ""

    @property
    def verdict(self) -> str | None:
        """The gate's answer; None where nobody judged."""
        return self.view.facts.judgement.verdict if self.view.facts.judgement else None

    def __repr__(self) -> str:
        """Returns its batch, its answer and where it is."""
        answer = f"{self.verdict or 'not judged'}, {self.view.whole.counts} passed"
        return f"<Report of {self.view.facts.batch}: {answer}, {self.url}>"

    def _repr_html_(self) -> str:
        view = self.view
        answer = badge(self.verdict) if self.verdict else text(f"{view.facts.status}, not judged")
        parts = [
            heading(view.title, answer),
            paragraph(view.sentence),
            paragraph(f"{view.whole.counts} passed: {view.judged.text}"),
            paragraph(" ".join(view.like_these.sentences())),
            self._rules(),
            self._reasons(),
            paragraph(f"{view.family.sentence()}." if view.family.size else ""),
            *(_rates(each) for column in view.columns for each in column),
            paragraph(self.notice),
            paragraph(Html(f"{link(self.url, 'the whole report')} <code>{text(self.url)}</code>")),
        ]
        return block(*(part for part in parts if part not in ("", paragraph(""))))

    def _rules(self) -> Html:
        rules = self.view.rules
        rows = ((each.name, badge(each.verdict), each.sentence) for each in rules)
        return table(("rule", "verdict", "why"), rows, len(rules)) if rules else Html()

    def _reasons(self) -> Html:
        reasons = self.view.reasons
        rows = ((each.reason, each.count, each.share, each.sample) for each in reasons)
        return table(("why not", "episodes", "share", "the first says"), rows, len(reasons)) if reasons else Html()


def _rates(rates: RateTable) -> Html:
    why = any(each.why for each in rates.rows)
    rows = ((each.label, each.counts, each.rate, each.interval, *((each.why,) if why else ())) for each in rates.rows)
    headings = (f"{rates.caption}, {rates.where}", "passed", "rate", "interval", *(("why not",) if why else ()))
    return table(headings, rows, len(rates.rows) + rates.left_out, "; the page has them")

"""What `simyard.trend` returns."""

from dataclasses import dataclass

from simyard.answer.html import Html, badge, block, heading, paragraph, table, text
from tasks.results.trend.view import Alarm, NightRow, TrendView

_NIGHTS, _ALARMS = 24, 12
_HEADINGS = ("night", "counted", "worlds", "rate in its own worlds", "95 % interval", "")


@dataclass(frozen=True, repr=False)
class Trend:
    """A document's rates night by night.

    Attributes:
        view: All that the page of `simyard trend` shows, as data.
        page: That page, as bytes of HTML.
    """

    view: TrendView
    page: bytes

    @property
    def nights(self) -> tuple[NightRow, ...]:
        """The nights, the newest first."""
        return self.view.rows

    @property
    def alarms(self) -> tuple[Alarm, ...]:
        """Where a rate changed, with the bundle that it began with."""
        return self.view.alarms

    def __repr__(self) -> str:
        """Returns the document, and how many nights and changes there are."""
        view = self.view
        return f"<Trend of {view.document!r}: {view.words}, {view.nights} nights, {len(view.alarms)} changes>"

    def _repr_html_(self) -> str:
        rows = (_cells(each) for each in self.nights[:_NIGHTS])
        return block(
            heading(self.view.document, text(self.view.words), text(self.view.chosen)),
            *(
                paragraph(Html(f"{badge('lower' if each.fell else 'higher')} {text(each.sentence)}"))
                for each in self.alarms[:_ALARMS]
            ),
            table(_HEADINGS, rows, self.view.nights, " nights; .page has them"),
            *map(paragraph, filter(None, [self.view.notice])),
        )


def _cells(row: NightRow) -> tuple[str, ...]:
    if row.rate is None or row.lower is None or row.upper is None:
        return row.day, "", "", "", "", row.note
    interval = f"{100 * row.lower:.1f} to {100 * row.upper:.1f} %"
    return row.day, f"{row.passed} of {row.episodes}", str(row.worlds), f"{100 * row.rate:.1f} %", interval, row.note

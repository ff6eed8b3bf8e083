"""What `simyard.results`, `report`, `gate`, `search`, `compare` and `replay` return."""

import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from importlib.util import find_spec
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from flows.batch.replay_episode import JobReplay
from flows.batch.search_batch import SearchResult
from flows.pipeline.judge_again import LaterVerdict
from simyard.answer.html import MOST_ROWS, Html, badge, block, heading, link, paragraph, picture, table, text
from specs.data.run_report import Verdict
from specs.errors import DocumentError
from tasks.results.batch_comparison import Comparison as Found
from tasks.results.batch_comparison import ComparisonAnswer, flip_text
from tasks.results.playback.playback import ColumnDeviation
from tasks.results.report.rate_tables import RateTable
from tasks.results.report.report_view import ReportView
from tasks.results.statistics.found_failures import BatchSearch, FoundFailure

if TYPE_CHECKING:
    import pandas as pd
    import polars as pl
    import pyarrow as pa

# What a reader looks at first, of the three dozen columns.
_FIRST = ("index", "world", "seed", "success", "outcome", "outcome_reason", "path_length_m")
_VARIABLE = "env_"
_MOST_COLUMNS = 10
_CELL = 60
_WIDTH = 760


@dataclass(frozen=True, eq=False, repr=False)
class Results:
    """The episodes of a batch, a row each; whatever reads Arrow reads it as it is, such as DuckDB and Polars.

    Attributes:
        batch: Its id.
        table: The rows, as an Arrow table.
    """

    batch: str
    table: "pa.Table"

    def to_arrow(self) -> "pa.Table":
        """Returns the rows as an Arrow table."""
        return self.table

    def to_pandas(self) -> "pd.DataFrame":
        """Returns the rows as a data frame of pandas.

        Raises:
            DocumentError: pandas is not installed.
        """
        _require("pandas")
        return self.table.to_pandas()

    def to_polars(self) -> "pl.DataFrame":
        """Returns the rows as a data frame of Polars.

        Raises:
            DocumentError: Polars is not installed.
        """
        _require("polars")
        import polars  # noqa: PLC0415 - an extra

        return polars.DataFrame(cast("Any", self.table))

    @property
    def columns(self) -> tuple[str, ...]:
        """The names of the columns."""
        return tuple(self.table.column_names)

    def __len__(self) -> int:
        """Returns how many episodes there are."""
        return self.table.num_rows

    def __arrow_c_stream__(self, requested_schema: object = None) -> object:
        """Returns the rows for whatever reads Arrow."""
        return self.table.__arrow_c_stream__(requested_schema)

    def __repr__(self) -> str:
        """Returns its batch and its size."""
        return f"<Results of {self.batch}: {len(self):,} episodes, {len(self.columns)} columns>"

    def _repr_html_(self) -> str:
        shown = self._shown()
        rows = (tuple(_cell(name, row[name]) for name in shown) for row in islice(self._rows(shown), MOST_ROWS))
        size = f"{len(self):,} episodes, {len(self.columns)} columns"
        return block(heading(self.batch, text(size)), table(shown, rows, len(self), "; to_pandas() has all"))

    def _shown(self) -> tuple[str, ...]:
        variables = [name for name in self.columns if name.startswith(_VARIABLE)]
        wanted = [name for name in _FIRST if name in self.columns] + variables
        return tuple((wanted or list(self.columns))[:_MOST_COLUMNS])

    def _rows(self, columns: tuple[str, ...]) -> list[dict[str, Any]]:
        return self.table.select(list(columns)).slice(0, MOST_ROWS).to_pylist()


def _cell(name: str, value: object) -> str:
    if name == "success":
        return badge("none" if value is None else "passed" if value else "failed")
    return text("" if value is None else f"{value:.4g}" if isinstance(value, float) else value, _CELL)


def _require(library: str) -> None:
    if find_spec(library) is None:
        allowed = f"run pip install 'simyard[{library}]'; without it, .table is an Arrow table"
        raise DocumentError.of(f"to_{library}()", f"{library} is not installed", allowed, source="simyard")


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


@dataclass(frozen=True, repr=False)
class SearchAnswer:
    """How probable a failure is, and failures that were found.

    Attributes:
        result: The batch, the probability, its interval, how it was found, and the failures.
    """

    result: SearchResult

    @property
    def found(self) -> BatchSearch:
        """What the search found."""
        return self.result.found

    @property
    def probability(self) -> float:
        """The estimate."""
        return self.found.probability.estimate

    @property
    def interval(self) -> tuple[float, float]:
        """Its lower and its upper end."""
        return self.found.probability.interval.lower, self.found.probability.interval.upper

    @property
    def failures(self) -> tuple[FoundFailure, ...]:
        """Episodes that failed and fail again, unlike each other, with world, seed and variables."""
        return self.found.failures

    @property
    def sentence(self) -> str:
        """The probability, its interval, what it took and how it was found."""
        return self.found.probability.sentence

    def __repr__(self) -> str:
        """Returns the batch and the sentence."""
        return f"<SearchAnswer of {self.found.batch}: {self.sentence}>"

    def _repr_html_(self) -> str:
        rows = (
            (
                each.reason,
                each.world,
                each.seed,
                ", ".join(f"{name}={value}" for name, value in each.environment.items()),
                each.on_reference,
                each.alike,
            )
            for each in self.found.numbered
        )
        headings = ("failure", "world", "seed", "variables", "on C MuJoCo", "alike")
        return block(
            heading("Search", self.found.batch),
            paragraph(self.sentence),
            table(headings, rows, len(self.found.numbered)),
            paragraph(self.found.findings),
            paragraph(self.found.causes.sentence),
        )


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


@dataclass(frozen=True, eq=False, repr=False)
class Replay:
    """An episode that was simulated once more.

    Attributes:
        episode: What came of it: the world, how it ended, each column beside the recorded one, what the robot did.
    """

    episode: JobReplay

    @property
    def same(self) -> bool:
        """Whether nothing deviates from what was recorded, not in the last bit."""
        return self.episode.same

    @property
    def ending(self) -> str:
        """How it ended, in a word or two."""
        return self.episode.ending

    @property
    def deviations(self) -> tuple[ColumnDeviation, ...]:
        """The columns that deviate, each beside the recorded one."""
        return tuple(each for each in self.episode.deviations if not each.same)

    def save(
        self, folder: str | os.PathLike[str], *, mcap: bool | None = None, video: bool = False, bags: Sequence[str] = ()
    ) -> list[Path]:
        """Writes what `simyard replay` writes into a folder, and returns the files; none if it could not start.

        Args:
            folder: Made if it is not there.
            mcap: Whether to write `replay.mcap` for Foxglove; None means if `simyard[mcap]` is installed.
            video: Whether to write `replay.mp4`.
            bags: What to write for ROS's tools: `rosbag`, `mcap-ros1`, `rosbag2`.

        Raises:
            DocumentError: There is no such format, or what writes it is not installed.
        """
        from flows.batch.replay_episode import wanted_files, write_files  # noqa: PLC0415 - only where it is written

        return write_files(self.episode, Path(folder), wanted_files(mcap=mcap, video=video, bags=bags))

    def __repr__(self) -> str:
        """Returns its job, how it ended, and whether it is the same."""
        return f"<Replay {self.episode.job}: {self.ending}, {self._answer()}>"

    def _repr_svg_(self) -> str | None:
        """Returns the episode as an animated drawing; None for one that could not start."""
        from tasks.export.drawing.floor_plan import floor_plan_svg  # noqa: PLC0415 - only where it is drawn
        from tasks.results.playback.plan_drawings import replay_svg  # noqa: PLC0415 - same

        played, world = self.episode.playback, self.episode.world
        return None if played is None else replay_svg(floor_plan_svg(world), played, world.footprint)

    def _repr_html_(self) -> str:
        drawing = self._repr_svg_()
        alt = f"The episode {self.episode.job}, played on the floor plan of its world"
        shown = picture(drawing, alt, _WIDTH) if drawing else paragraph("it could not start: there is nothing to see")
        answer = badge("the same" if self.same else "deviates")
        return block(heading(self.episode.job, text(self.ending), answer), self._deviations(), paragraph(shown))

    def _answer(self) -> str:
        apart = len(self.deviations)
        return f"{apart} of {len(self.episode.deviations)} columns deviate" if apart else "the same to the last bit"

    def _deviations(self) -> Html:
        if self.same:
            return Html()
        rows = ((each.column, each.unit, each.recorded, each.replayed) for each in self.deviations)
        found = table(("column", "unit", "recorded", "replayed"), rows, len(self.deviations))
        return Html(found + "".join(paragraph(f"may be why: {cause}") for cause in self.episode.causes))

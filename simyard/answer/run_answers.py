"""What `simyard.plan`, `simyard.run`, `simyard.trend` and `simyard.worlds` return."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import overload

from simyard.answer.html import Html, badge, block, heading, link, paragraph, picture, table, text
from specs.data.run_report import PipelineReport, StageReport, Verdict
from specs.data.world import World as WorldDocument
from specs.errors import PipelineNotPassed
from tasks.results.trend.trend_view import Alarm, NightRow, TrendView

_MOST_LINES = 400
_LONGEST = 2_000
_BATCH = "simulationBatch"
_GENERATION = "worldGeneration"
_NIGHTS, _ALARMS = 24, 12
_HEADINGS = ("night", "counted", "worlds", "rate in its own worlds", "95 % interval", "")
_PLAN_WIDTH, _SHEET_WIDTH = 760, 1040
_SHOWN = 24


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


@dataclass(frozen=True)
class Run:
    """A run of a document that came to its end.

    Attributes:
        report: What each stage came to, and where its artefacts lie.
        store: URL of the store that has it.
    """

    report: PipelineReport
    store: str

    @property
    def id(self) -> str:
        """The run's id."""
        return self.report.run

    @property
    def passed(self) -> bool:
        """Whether nothing that was asked for was refused; True, too, where nothing was asked for."""
        return self.report.passed

    @property
    def verdict(self) -> Verdict | None:
        """The gate's answer; None for a document without a gate."""
        return self.report.verdict

    @property
    def shipped(self) -> bool | None:
        """Whether a deployment succeeded; None for a document without one."""
        return self.report.shipped

    @property
    def stages(self) -> tuple[StageReport, ...]:
        """What each stage came to."""
        return self.report.stages

    @property
    def batch(self) -> str | None:
        """The ARN of its simulation job batch; None for a document without one."""
        return self._arn(_BATCH)

    @property
    def generation(self) -> str | None:
        """The ARN of its world generation job; None for a document without one."""
        return self._arn(_GENERATION)

    def require_passed(self) -> "Run":
        """Returns the run if it passed, for a program that shall not go on otherwise.

        Raises:
            PipelineNotPassed: It did not.
        """
        if not self.passed:
            raise PipelineNotPassed(self.report)
        return self

    def __repr__(self) -> str:
        """Returns its document, its answer and its id."""
        shipped = {True: ", shipped", False: ", not shipped", None: ""}[self.shipped]
        return f"<Run {self.report.name!r} {self.id}: {self._answer()}{shipped}>"

    def _repr_html_(self) -> str:
        answer = badge(self._answer())
        rows = ((each.name, badge(each.status), each.summary, f"{each.seconds:.1f}") for each in self.stages)
        found = table(("stage", "status", "what came of it", "seconds"), rows, len(self.stages))
        return block(heading(self.report.name, answer, text(self.id)), *self._alarms(), found, *self._links())

    def _answer(self) -> str:
        if self.verdict or not self.passed:
            return self.verdict or "not passed"
        return "passed" if self.shipped or self.batch is None else "nobody judged its batch"

    def _arn(self, stage: str) -> str | None:
        return next((each.arn for each in self.stages if each.name == stage and each.arn), None)

    def _alarms(self) -> Iterator[Html]:
        for stage in self.stages:
            if "alarm" in stage.facts:
                yield paragraph(Html(f"<strong>{text(stage.facts['alarm'])}</strong>"))

    def _links(self) -> Iterator[Html]:
        artefacts = [each for stage in self.stages for each in stage.artefacts]
        if artefacts:
            rows = ((each.label, link(each.url)) for each in artefacts)
            yield table(("artefact", "where"), rows, len(artefacts))


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


@dataclass(frozen=True)
class World:
    """A world.

    Attributes:
        name: `<generation>/<world>`, as documents name it.
        document: All that is known of it: rooms, walls, doors, furniture, lights, its certificate.
    """

    name: str
    document: WorldDocument

    def __repr__(self) -> str:
        """Returns its name and its size."""
        return f"<World {self.name!r}: {_facts(self.document)}>"

    def _repr_svg_(self) -> str:
        from tasks.export.drawing.floor_plan import floor_plan_svg  # noqa: PLC0415 - only where it is drawn

        return floor_plan_svg(self.document)

    def _repr_html_(self) -> str:
        drawing = picture(self._repr_svg_(), f"The floor plan of {self.name}", _PLAN_WIDTH)
        return block(heading(self.name, text(_facts(self.document))), paragraph(drawing))


@dataclass(frozen=True, eq=False)
class Worlds(Sequence[World]):
    """Worlds in their order, each read when it is asked for.

    Attributes:
        title: What they have in common.
        names: `<generation>/<world>` of each.
        rejected: Why others could not be made, a sentence each.
    """

    title: str
    names: tuple[str, ...]
    rejected: tuple[str, ...] = ()
    _read: Callable[[str], WorldDocument] = field(repr=False, kw_only=True)

    @overload
    def __getitem__(self, index: int) -> World: ...

    @overload
    def __getitem__(self, index: slice) -> "Worlds": ...

    def __getitem__(self, index: "int | slice") -> "World | Worlds":
        """Returns a world by its position, or some of them."""
        if isinstance(index, slice):
            return Worlds(self.title, self.names[index], self.rejected, _read=self._read)
        name = self.names[index]
        return World(name, self._read(name))

    def __len__(self) -> int:
        """Returns how many there are."""
        return len(self.names)

    def __iter__(self) -> Iterator[World]:
        """Yields each world."""
        return (World(name, self._read(name)) for name in self.names)

    def __repr__(self) -> str:
        """Returns what they have in common, and how many there are."""
        return f"<Worlds {self.title!r}: {len(self)}>"

    def _repr_html_(self) -> str:
        if not self.names:
            return block(heading(self.title), paragraph("no worlds"))
        alt = f"A sheet of {min(_SHOWN, len(self))} of {len(self)} worlds"
        return block(picture(self._sheet, alt, _SHEET_WIDTH), *map(paragraph, self.rejected[:3]))

    @cached_property
    def _sheet(self) -> str:
        from tasks.export.picture.contact_sheet import contact_sheet_svg  # noqa: PLC0415 - only where it is drawn

        shown = [self._read(name) for name in self.names[:_SHOWN]]
        return contact_sheet_svg(shown, title=self.title, total=len(self))


def _facts(world: WorldDocument) -> str:
    box = world.footprint
    size = f"{box.x_max_m - box.x_min_m:.1f} x {box.y_max_m - box.y_min_m:.1f} m"
    if world.source is not None:
        number = sum(len(piece.solids) for piece in world.furniture) + len(world.walls)
        return f"imported from {world.source.file}, {number} solids, {size}"
    unmet = len(world.certificate.unmet)
    wishes = f"{unmet} of {len(world.certificate.wishes)} wishes unmet" if unmet else "every wish met"
    rooms = "1 room" if len(world.rooms) == 1 else f"{len(world.rooms)} rooms"
    return f"{rooms}, {len(world.furniture)} pieces, {size}, {wishes}"

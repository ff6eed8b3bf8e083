"""What `simyard.run` returns."""

from collections.abc import Iterator
from dataclasses import dataclass

from simyard.answer.html import Html, badge, block, heading, link, paragraph, table, text
from specs.data.run_report import PipelineReport, StageReport, Verdict
from specs.errors import PipelineNotPassed

_BATCH = "simulationBatch"
_GENERATION = "worldGeneration"


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
        return self.verdict or ("passed" if self.passed else "not passed")

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

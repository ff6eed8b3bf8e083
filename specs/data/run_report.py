"""What a pipeline run tells at its end: each stage, where its artefacts lie, and the answer."""

from typing import Literal

from pydantic import Field, JsonValue

from specs.base import Spec
from specs.field_types import FilteredPage

StageName = Literal["worlds", "worldGeneration", "worldExport", "simulationBatch", "search", "gate", "deployment"]
Verdict = Literal["PASS", "FAIL", "INCONCLUSIVE"]


class Artefact(Spec):
    """Something that a stage left behind, and where."""

    label: str
    url: str


class StageReport(Spec):
    """One stage of a run.

    Attributes:
        name: The document's section.
        arn: The job, or empty for the search, the gate and imported worlds, which have none.
        status: The job's RoboMaker status, or the gate's verdict.
        summary: One line for a person.
        seconds: Wall time in this process; not part of any result table.
        artefacts: Where to look.
        facts: The stage's own numbers.
    """

    name: StageName
    arn: str
    status: str
    summary: str
    seconds: float
    artefacts: tuple[Artefact, ...] = ()
    facts: dict[str, JsonValue] = Field(default_factory=dict)


class PipelineReport(Spec):
    """A whole run.

    Attributes:
        run: The run's id; the same document run again after a crash has the same one.
        verdict: The gate's answer, or None for a document without a gate.
        shipped: Whether a deployment succeeded; None for a document without one.
    """

    run: str
    name: str
    stages: tuple[StageReport, ...]
    verdict: Verdict | None = None
    shipped: bool | None = None

    @property
    def passed(self) -> bool:
        """Whether nothing that was asked for was refused: the run's red or green."""
        return self.verdict in (None, "PASS") and self.shipped in (None, True)

    @property
    def undecided(self) -> bool:
        """Whether the gate had too few episodes to say anything: neither red nor green."""
        return self.verdict == "INCONCLUSIVE"


class RunSummary(Spec):
    """A run of a document in a list; a kind that RoboMaker did not have, named as it would have named it."""

    arn: str
    name: str
    status: str
    createdAt: float
    verdict: Verdict | None = None
    failureReason: str | None = None


class ListPipelineRunsRequest(FilteredPage):
    """Asks for the runs of documents."""


class ListPipelineRunsResponse(Spec):
    """A page of runs of documents."""

    runSummaries: tuple[RunSummary, ...]
    nextToken: str | None = None

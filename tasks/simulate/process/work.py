"""What the process that simulates is asked, and what it answers."""

from typing import Annotated, Literal

from pydantic import Field, TypeAdapter

from specs.base import Spec
from specs.data.episode import EpisodeRequest, EpisodeResult
from specs.field_types import TagMap
from specs.robomaker.simulation import SimulationJobErrorCode
from tasks.simulate.chunk.timings import ChunkTiming
from tasks.simulate.lane.recording_choice import RecordingChoice
from tasks.simulate.plan.chunks import Chunk, ProgramKey
from tasks.simulate.process.sent_log import SentTopic


class SentWorlds(Spec):
    """What changes in the worlds that the process keeps from one question to the next.

    Attributes:
        new: Documents of worlds that it does not have, by name.
        gone: Names of worlds that it need not keep.
    """

    new: dict[str, str]
    gone: tuple[str, ...] = ()


class LanesWork(Spec):
    """Episodes to simulate: those of a chunk.

    Attributes:
        numbers: The chunk's number, and those of the chunks that are going to be asked for after it, in their order.
        new: Those of these chunks that no question before this one named, or that have other episodes since.
        bundles: Unpacked folders of the applications, by digest.
        timed_as: Program to remember the time for.
        rate_hz: How many samples a simulated second to tell; None if nobody records.
        recorded: Which episodes of the first chunk to tell samples of; None means all.
    """

    kind: Literal["lanes"] = "lanes"
    numbers: tuple[int, ...]
    new: tuple[Chunk, ...]
    worlds: SentWorlds
    bundles: dict[str, str]
    lanes: int
    engine: str
    timed_as: ProgramKey | None = None
    rate_hz: float | None = None
    recorded: RecordingChoice | None = None


class AuditedEpisode(Spec):
    """An episode to audit, as ``tasks.simulate.audit.audit_sample`` has it."""

    request: EpisodeRequest
    row: EpisodeResult
    weight: float


class AuditWork(Spec):
    """A sample to audit."""

    kind: Literal["audit"] = "audit"
    sample: tuple[AuditedEpisode, ...]
    worlds: SentWorlds
    bundles: dict[str, str]
    lanes: int
    engine: str
    drawn: int


class AgainWork(Spec):
    """An episode to drive again."""

    kind: Literal["again"] = "again"
    request: EpisodeRequest
    worlds: SentWorlds
    bundles: dict[str, str]
    lanes: int
    engine: str
    rate_hz: float


Work = Annotated[LanesWork | AuditWork | AgainWork, Field(discriminator="kind")]
WORK: TypeAdapter[LanesWork | AuditWork | AgainWork] = TypeAdapter(Work)


class RememberedTiming(Spec):
    """What a chunk of a program took; remembered by whoever may write to the cache folder."""

    program: ProgramKey
    timing: ChunkTiming


class Ready(Spec):
    """The process is there."""

    kind: Literal["ready"] = "ready"


class Progress(Spec):
    """So many episodes are done."""

    kind: Literal["progress"] = "progress"
    done: int


class Compiles(Spec):
    """A program that no process has kept is compiled, until the next answer."""

    kind: Literal["compiles"] = "compiles"


class RecordingBegins(Spec):
    """So many lanes are recorded, with control steps of that length."""

    kind: Literal["recording-begins"] = "recording-begins"
    lanes: int
    control_s: float


class Samples(Spec):
    """A slice was recorded; its arrays follow, and how many steps each lane has done."""

    kind: Literal["samples"] = "samples"
    steps: int


class RecordingEnds(Spec):
    """The lanes have ended; their rows, in their order, follow as an array of bytes, and how, as others."""

    kind: Literal["recording-ends"] = "recording-ends"


class Rows(Spec):
    """The rows that were asked for, but for those that recordings ended with; they follow as an array of bytes.

    The bytes are those of ``specs.data.column_bytes``, whose reader believes nothing.

    Attributes:
        tags: What applications gave to their jobs, by the index of the episode.
    """

    kind: Literal["rows"] = "rows"
    timings: tuple[RememberedTiming, ...] = ()
    tags: dict[int, TagMap] = Field(default_factory=dict[int, TagMap])


class Audited(Spec):
    """The report of an audit, as JSON."""

    kind: Literal["audited"] = "audited"
    report: str
    timings: tuple[RememberedTiming, ...] = ()


class Again(Spec):
    """An episode that was driven again.

    Attributes:
        arrived_m, radius_m, heights_m, mount, lidar_height_m, range_m: Its setting, whose arrays follow; None for an
            episode that could not start.
        columns: Names of the samples' arrays, which follow: those of each step, then those of the recording.
        topics: Of what its ROS nodes heard and said, whose arrays follow at the end; None where there were none.
    """

    kind: Literal["again"] = "again"
    row: EpisodeResult
    started: bool
    arrived_m: float | None = None
    radius_m: float = 0.0
    heights_m: tuple[float, float] = (0.0, 0.0)
    mount: tuple[float, float, float] = (0.0, 0.0, 0.0)
    lidar_height_m: float = 0.0
    range_m: float = 0.0
    columns: tuple[str, ...] = ()
    topics: tuple[SentTopic, ...] | None = None


class Crashed(Spec):
    """An application crashed, and with it all that was asked."""

    kind: Literal["crashed"] = "crashed"
    code: SimulationJobErrorCode
    reason: str


class NoMemory(Spec):
    """There is not enough memory for what was asked."""

    kind: Literal["no-memory"] = "no-memory"
    text: str


class Defect(Spec):
    """Something else went wrong: a defect of Simyard's, which no application caused.

    Attributes:
        text: The exception with its traceback.
    """

    kind: Literal["defect"] = "defect"
    text: str


Answer = (
    Ready
    | Progress
    | Compiles
    | RecordingBegins
    | Samples
    | RecordingEnds
    | Rows
    | Audited
    | Again
    | Crashed
    | NoMemory
    | Defect
)
ANSWER: TypeAdapter[Answer] = TypeAdapter(Annotated[Answer, Field(discriminator="kind")])

"""The protocol between a run and the process that simulates for it: what is asked and answered, and how it is sent.

A message is JSON, and arrays as their bytes. Nothing is unpickled: the process has run strangers' code, so that its
messages are read as data of a known form, and refused otherwise.
"""

import json
import math
import socket
import struct
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Annotated, Literal, NamedTuple

import numpy as np
from pydantic import Field, JsonValue, TypeAdapter

from specs.base import Spec
from specs.bundle_files import Topic
from specs.data.episode import EpisodeRequest, EpisodeResult
from specs.errors import SimyardError
from specs.field_types import TagMap
from specs.robomaker.simulation import SimulationJobErrorCode
from tasks.ros.bag.message_log import Channel, LogEntry, MessageLog
from tasks.simulate.chunk.byproducts import ChunkTiming
from tasks.simulate.lane.recording import RecordingChoice
from tasks.simulate.plan.chunks import Chunk

# Far more than the rows of the largest chunk, or than the samples of one of its slices.
_JSON_BYTES, _ARRAY_BYTES, _ARRAYS = 1 << 30, 1 << 32, 64
_LENGTHS = struct.Struct("<QQ")
_KINDS = "biuf"
Document = Mapping[str, JsonValue]


class MessageRefused(SimyardError):  # noqa: N818 - a state
    """A message is not of the form that messages have."""


class Message(NamedTuple):
    """A message.

    Attributes:
        document: What it says.
        arrays: What goes with it.
    """

    document: dict[str, JsonValue]
    arrays: tuple[np.ndarray, ...] = ()


def send(connection: socket.socket, document: Document | str, arrays: Sequence[np.ndarray] = ()) -> None:
    """Sends a message; returns when the kernel has it.

    Args:
        connection: To the other side.
        document: What it says, or the JSON of that: pydantic writes it in a seventh of the time.
        arrays: What goes with it.

    Raises:
        OSError: The other side is gone.
    """
    whole = [np.asarray(array, order="C") for array in arrays]
    forms = [{"dtype": array.dtype.str, "shape": list(array.shape)} for array in whole]
    said = document if isinstance(document, str) else json.dumps(dict(document), separators=(",", ":"))
    body = f'{{"arrays":{json.dumps(forms)},"document":{said}}}'.encode()
    connection.sendall(_LENGTHS.pack(len(body), sum(array.nbytes for array in whole)) + body)
    for array in whole:
        if array.nbytes:
            connection.sendall(memoryview(array.reshape(-1).view(np.uint8).data))


def receive(connection: socket.socket) -> Message:
    """Returns the next message.

    Raises:
        MessageRefused: It is none.
        EOFError: The other side is gone.
        OSError: It is gone, or says nothing within the connection's timeout.
    """
    json_bytes, array_bytes = _LENGTHS.unpack(_exactly(connection, _LENGTHS.size))
    if json_bytes > _JSON_BYTES or array_bytes > _ARRAY_BYTES:
        raise MessageRefused(f"a message of {json_bytes} and {array_bytes} bytes: at most {_JSON_BYTES}")
    try:
        head = json.loads(_exactly(connection, json_bytes))
        forms = [(np.dtype(form["dtype"]), tuple(int(side) for side in form["shape"])) for form in head["arrays"]]
        document = dict(head["document"])
    except (ValueError, TypeError, KeyError, RecursionError) as exc:
        raise MessageRefused(f"a message that is none: {type(exc).__name__}") from exc
    _check_forms(forms, array_bytes)
    rest = memoryview(_exactly(connection, array_bytes))
    arrays: list[np.ndarray] = []
    for dtype, shape in forms:
        size = math.prod(shape) * dtype.itemsize
        arrays.append(np.frombuffer(rest[:size], dtype).reshape(shape))
        rest = rest[size:]
    return Message(document, tuple(arrays))


def _check_forms(forms: Sequence[tuple[np.dtype, tuple[int, ...]]], array_bytes: int) -> None:
    if len(forms) > _ARRAYS or any(dtype.kind not in _KINDS or min(shape, default=0) < 0 for dtype, shape in forms):
        raise MessageRefused("a message with arrays that are no numbers")
    if sum(math.prod(shape) * dtype.itemsize for dtype, shape in forms) != array_bytes:
        raise MessageRefused("a message whose arrays have other lengths than it says")


def _exactly(connection: socket.socket, length: int) -> bytearray:
    buffer = bytearray(length)
    view, done = memoryview(buffer), 0
    while done < length:
        count = connection.recv_into(view[done:], min(length - done, 1 << 20))
        if not count:
            raise EOFError("the other side is gone")
        done += count
    return buffer


LOG_ARRAYS = 4


class SentTopic(Spec):
    """A topic of a log, as ``Channel`` has it; its type is one that ROS brings along."""

    topic: Topic
    kind: str
    latched: bool


def log_parts(log: MessageLog) -> tuple[tuple[SentTopic, ...], list[np.ndarray]]:
    """Returns a log's topics, and its messages as ``LOG_ARRAYS`` arrays: times, topics' numbers, lengths, bytes."""
    numbers = {channel.topic: number for number, channel in enumerate(log.channels)}
    topics = tuple(SentTopic(topic=each.topic, kind=each.kind, latched=each.latched) for each in log.channels)
    entries = tuple(log.entries)
    arrays = [
        np.array([entry.time_ns for entry in entries], np.int64),
        np.array([numbers[entry.topic] for entry in entries], np.int32),
        np.array([len(entry.body) for entry in entries], np.int64),
        np.frombuffer(b"".join(entry.body for entry in entries), np.uint8),
    ]
    return topics, arrays


def log_of(topics: Sequence[SentTopic], arrays: Sequence[np.ndarray]) -> MessageLog:
    """Returns the log whose parts came.

    Raises:
        MessageRefused: They are not those of a log.
    """
    times, numbers, lengths, body = arrays
    ends = np.concatenate([[0], np.cumsum(lengths)])
    sound = len(times) == len(numbers) == len(lengths) and not np.any(lengths < 0) and ends[-1] == len(body)
    if not sound or np.any((numbers < 0) | (numbers >= len(topics))):
        raise MessageRefused(f"a log of {len(times)} messages and {len(body)} bytes, whose parts do not fit together")
    whole, spans = body.tobytes(), pairwise(ends.tolist())
    entries = (
        LogEntry(int(time_ns), topics[number].topic, whole[begin:end])
        for time_ns, number, (begin, end) in zip(times, numbers, spans, strict=True)
    )
    return MessageLog(tuple(Channel(each.topic, each.kind, latched=each.latched) for each in topics), tuple(entries))


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
    rate_hz: float | None = None
    recorded: RecordingChoice | None = None


class AuditWork(Spec):
    """Episodes of a sample to drive again.

    Attributes:
        here: Those that their own engine drives.
        others: Those that C MuJoCo drives.
        control: Whether C MuJoCo shall drive them from a micrometre beside instead, and nobody the first.
    """

    kind: Literal["audit"] = "audit"
    here: tuple[EpisodeRequest, ...]
    others: tuple[EpisodeRequest, ...]
    worlds: SentWorlds
    bundles: dict[str, str]
    lanes: int
    engine: str
    control: bool = False


class ReplayWork(Spec):
    """An episode to drive again."""

    kind: Literal["again"] = "again"
    request: EpisodeRequest
    worlds: SentWorlds
    bundles: dict[str, str]
    lanes: int
    engine: str
    rate_hz: float


Work = Annotated[LanesWork | AuditWork | ReplayWork, Field(discriminator="kind")]
WORK: TypeAdapter[LanesWork | AuditWork | ReplayWork] = TypeAdapter(Work)


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
    timings: tuple[ChunkTiming, ...] = ()
    tags: dict[int, TagMap] = Field(default_factory=dict[int, TagMap])


class Audited(Spec):
    """Episodes that an audit drove; what came of each drive follows as ``DRIVE_ARRAYS`` arrays.

    Attributes:
        why: Why C MuJoCo drove none; empty if it did, or had nothing to drive.
    """

    kind: Literal["audited"] = "audited"
    why: str = ""
    timings: tuple[ChunkTiming, ...] = ()


class Replayed(Spec):
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
    | Replayed
    | Crashed
    | NoMemory
    | Defect
)
ANSWER: TypeAdapter[Answer] = TypeAdapter(Annotated[Answer, Field(discriminator="kind")])

"""The protocol between a run and the process that simulates for it: what is asked and answered, and how it is sent.

A message is JSON, and arrays as their bytes. Nothing is unpickled: the process has run strangers' code, so that its
messages are read as data of a known form, of no more than what was asked for can take, and refused otherwise.
"""

import json
import math
import socket
import struct
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Annotated, Literal, NamedTuple, Protocol

import numpy as np
from pydantic import Field, JsonValue, TypeAdapter

from specs.base import Spec
from specs.bundle_files import ColorCameraDeclaration, DepthCameraDeclaration
from specs.data.episode import CONTROL_S, EpisodeRequest, EpisodeResult
from specs.errors import SimyardError
from specs.field_types import TagMap
from specs.robomaker.simulation import SimulationJobErrorCode
from specs.ros_robot import Topic
from tasks.ros.bag.message_log import Channel, LogEntry, MessageLog
from tasks.simulate.chunk.byproducts import ChunkTiming
from tasks.simulate.lane.recording import RecordingChoice, sample_stride
from tasks.simulate.plan.chunks import SLICE_STEPS, Chunk, most_steps

_ARRAYS = 64
# What comes at a time; no more is asked for than comes, whatever was announced.
_PIECE_BYTES = 1 << 18
# Of an answer's document: a text of 32 KiB in JSON, times of chunks; and of each episode its tags (TagMap).
TEXT_CHARACTERS = 32 << 10
_JSON_BYTES, _JSON_BYTES_EACH = 1 << 20, 50 * (128 + 256 + 8)
# Values in it, of which each takes some hundred bytes of memory, however short it is in JSON.
_VALUES, _VALUES_EACH = 1 << 16, 4 * 50
# Of the sides of arrays: a bundle's lidar has no more rays (specs.bundle_files), and no robot so many of the others.
LONGEST_SIDES = {"rays": 4096, "velocity": 4096, "controls": 4096, "goals": 1 << 16}
WIDEST = 8
_STEP_BYTES = WIDEST * (8 + LONGEST_SIDES["rays"] + LONGEST_SIDES["velocity"] + LONGEST_SIDES["controls"])
_END_BYTES = _STEP_BYTES + 2 * WIDEST * LONGEST_SIDES["goals"]
# Of an episode's row, but for what it has of each step: a reason, metrics, rooms. And of a world's map in a log.
_ROW_BYTES, _MAP_BYTES = 64 << 10, 64 << 20
FILM_BYTES = 64 << 20
"""Of the pictures that a replay takes again with a camera; of each episode one at least."""
_LENGTHS = struct.Struct("<QQ")
_KINDS = "biuf"
Document = Mapping[str, JsonValue]


class MessageRefused(SimyardError):  # noqa: N818 - a state
    """A message is not of the form that messages have."""


class Bounds(NamedTuple):
    """What a message has at most.

    Attributes:
        json_bytes: Of its document.
        values: In its document.
        array_bytes: Of its arrays.
    """

    json_bytes: int
    values: int
    array_bytes: int


QUESTION = Bounds(1 << 32, 1 << 32, 0)
"""Of a question, which the run asks: the process that simulates believes it."""
READY = Bounds(_JSON_BYTES, _VALUES, 0)
"""Of an answer before the first question."""


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


class Source(Protocol):
    """What is read of a connection."""

    def recv(self, most: int, /) -> bytes:
        """Returns what has come, of that length at most; nothing of a connection that has ended."""
        ...


def receive(connection: Source, most: Bounds) -> Message:
    """Returns the next message.

    Args:
        connection: To the other side.
        most: What it may have; of one that announces more nothing is read.

    Raises:
        MessageRefused: It is none.
        EOFError: The other side is gone.
        OSError: It is gone, or says nothing within the connection's timeout.
    """
    json_bytes, array_bytes = _LENGTHS.unpack(_exactly(connection, _LENGTHS.size))
    if json_bytes > most.json_bytes or array_bytes > most.array_bytes:
        allowed = f"at most {most.json_bytes:,} and {most.array_bytes:,} were asked for"
        raise MessageRefused(f"a message of {json_bytes:,} and {array_bytes:,} bytes: {allowed}")
    body = _exactly(connection, json_bytes)
    if (values := sum(map(body.count, (b",", b"[", b"{")))) > most.values:
        raise MessageRefused(f"a message of {values:,} values: at most {most.values:,} were asked for")
    try:
        head = json.loads(body)
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


def _exactly(connection: Source, length: int) -> bytearray:
    buffer = bytearray()
    while len(buffer) < length:  # it grows with what comes, not with what was announced
        piece = connection.recv(min(length - len(buffer), _PIECE_BYTES))
        if not piece:
            raise EOFError("the other side is gone")
        buffer += piece
    return buffer


LOG_ARRAYS = 4
PICTURE_ARRAYS = 3
"""Of one camera: control steps at which it took pictures, the pictures' lengths, and all of their bytes."""
# A robot has a dozen, and the command that drives it (tasks.ros.lockstep.robot_topics).
_TOPICS = 64


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


def log_of(topics: Sequence[SentTopic], arrays: Sequence[np.ndarray], steps: int) -> MessageLog:
    """Returns the log whose parts came.

    Args:
        topics: Of its messages.
        arrays: As ``log_parts`` has them.
        steps: How many control steps the episode had at most; a topic has one message in each, and one before.

    Raises:
        MessageRefused: They are not those of a log.
    """
    times, numbers, lengths, body = arrays
    ends = np.concatenate([[0], np.cumsum(lengths)])
    sound = len(times) == len(numbers) == len(lengths) and not np.any(lengths < 0) and ends[-1] == len(body)
    sound = sound and len(topics) <= _TOPICS and len(times) <= len(topics) * (steps + 1)
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
    """An episode to drive again.

    Attributes:
        beside: The other robots that share its world.
    """

    kind: Literal["again"] = "again"
    request: EpisodeRequest
    beside: tuple[EpisodeRequest, ...] = ()
    worlds: SentWorlds
    bundles: dict[str, str]
    lanes: int
    engine: str
    rate_hz: float


class PicturesWork(Spec):
    """Pictures to take again of what a robot's cameras saw.

    Attributes:
        steps, poses: At which control steps it is known where the robot was (x m, y m, yaw rad): some of all.
        people_m: Where people were then (x, y); none of an episode without.
        boxes_m: Where boxes stood then; likewise.
        pictures_hz: How many of each camera's pictures a simulated second to take at most.
    """

    kind: Literal["pictures"] = "pictures"
    request: EpisodeRequest
    worlds: SentWorlds
    bundles: dict[str, str]
    lanes: int
    engine: str
    steps: tuple[int, ...]
    poses: tuple[tuple[float, float, float], ...]
    people_m: tuple[tuple[tuple[float, float], ...], ...]
    boxes_m: tuple[tuple[tuple[float, float], ...], ...]
    pictures_hz: float


Question = LanesWork | AuditWork | ReplayWork | PicturesWork
WORK: TypeAdapter[Question] = TypeAdapter(Annotated[Question, Field(discriminator="kind")])


def answer_bounds(work: Question, chunk: Sequence[EpisodeRequest] = ()) -> Bounds:
    """Returns what an answer to a question has at most.

    Args:
        work: The question.
        chunk: Of one for lanes: the episodes of its first chunk.
    """
    match work:
        case LanesWork():
            steps, lanes = most_steps(chunk), max(work.lanes, len(chunk))
            samples = 0 if work.rate_hz is None else 2 + SLICE_STEPS // sample_stride(work.rate_hz, CONTROL_S)
            return _bounds(len(chunk), steps, lanes * max(samples * _STEP_BYTES, _END_BYTES * (samples > 0)))
        case AuditWork():
            requests = (*work.here, *work.others) * 2  # a control drives them in two directions
            return _bounds(len(requests), most_steps(requests), WIDEST * most_steps(requests) * len(requests))
        case ReplayWork():
            steps = most_steps([work.request])
            return _bounds(1, steps, 3 * steps * _STEP_BYTES + _END_BYTES + _MAP_BYTES + 2 * FILM_BYTES)
        case PicturesWork():
            return _bounds(1, len(work.steps), 2 * FILM_BYTES)


def _bounds(episodes: int, steps: int, array_bytes: int) -> Bounds:
    """Returns bounds of rows, each with up to a number for each step, and of arrays beside them."""
    return Bounds(
        _JSON_BYTES + episodes * _JSON_BYTES_EACH,
        _VALUES + episodes * _VALUES_EACH + steps,
        (1 << 20) + episodes * (_ROW_BYTES + WIDEST * steps) + array_bytes,
    )


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
        arrived_m, radius_m, heights_m, mount, lidar_height_m, range_m, camera, color_camera: Its setting, whose arrays
            follow; None for an episode that could not start.
        columns: Names of the samples' arrays, which follow: those of each step, then those of the recording.
        topics: Of what its ROS nodes heard and said, whose arrays follow at the end; None where there were none.
        gl: Which GL drew what its colour camera saw; empty if none did.
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
    camera: DepthCameraDeclaration | None = None
    color_camera: ColorCameraDeclaration | None = None
    columns: tuple[str, ...] = ()
    topics: tuple[SentTopic, ...] | None = None
    gl: Annotated[str, Field(max_length=200, pattern="^[ -~]*$")] = ""


class Pictures(Spec):
    """What a robot's cameras saw; of the depth camera and then of the colour camera ``PICTURE_ARRAYS`` arrays follow.

    Attributes:
        depth, color: The cameras; None for a robot without.
        why: Why nothing was drawn in colour; empty if it was, or had not to be.
    """

    kind: Literal["pictures"] = "pictures"
    depth: DepthCameraDeclaration | None = None
    color: ColorCameraDeclaration | None = None
    why: str = ""


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
        reason: The exception alone, such as ``ImportError: no module``.
        text: The same with its traceback and its notes, of which JAX adds one to each.
    """

    kind: Literal["defect"] = "defect"
    reason: str
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
    | Pictures
    | Crashed
    | NoMemory
    | Defect
)
ANSWER: TypeAdapter[Answer] = TypeAdapter(Annotated[Answer, Field(discriminator="kind")])

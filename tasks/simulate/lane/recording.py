"""Records what lanes do: samples while they run, given out for the episodes that are kept.

A recorder keeps samples of each slice of control steps, and how lanes end, in memory up to a size, beyond it in one
unnamed file. The run asks which episodes are recorded, and the process that simulates sends no others.
"""

import tempfile
import weakref
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from typing import IO, NamedTuple, Protocol

import numpy as np
from jaxtyping import Bool, Float, Float32, Int

from specs.base import Spec
from specs.data.episode import EpisodeResult
from specs.data.episode_columns import EpisodeColumns


class RecordingChoice(Spec):
    """Which of some episodes are recorded, if they come to an end.

    Attributes:
        always: Indices of those that are, however they end.
        failed: Whether others are that fail.
    """

    always: tuple[int, ...] = ()
    failed: bool = False

    def chosen(self, rows: EpisodeColumns) -> Bool[np.ndarray, " rows"]:
        """Returns which of these episodes are recorded."""
        chosen = np.isin(rows.index, self.always)
        if self.failed:
            chosen |= rows.says("status", "Failed") | rows.says("outcome", "Failed")
        return chosen & ~rows.says("status", "Canceled")


# Of the control rate; at less, an episode of two weeks would have two samples.
_LEAST_RATE = 1e-8


class Steps(Protocol):
    """What is recorded of a slice of control steps, (lanes, steps) first; as ``StepRecord``."""

    @property
    def pose(self) -> object:
        """Returns poses at the steps' ends."""
        ...

    @property
    def velocity(self) -> object:
        """Returns velocities at the steps' ends."""
        ...

    @property
    def goal_index(self) -> object:
        """Returns goals to go to at the steps' ends."""
        ...

    @property
    def control(self) -> object:
        """Returns controls during the steps."""
        ...

    @property
    def ranges_m(self) -> object:
        """Returns scans at the steps' beginnings."""
        ...

    @property
    def impulse_ns(self) -> object:
        """Returns contact impulses during the steps."""
        ...

    @property
    def people_m(self) -> object:
        """Returns where people are at the steps' ends; None in lanes without."""
        ...

    @property
    def robots_m(self) -> object:
        """Returns where other robots are then; None in lanes without."""
        ...

    @property
    def boxes_m(self) -> object:
        """Returns where boxes stand in the steps; None in lanes without."""
        ...


class Ends(NamedTuple):
    """How the lanes ended, for lanes in their order.

    Attributes:
        steps: Control steps that were done.
        crashed: Whether a step after those was begun, and went wrong.
        goals_m: Where each lane's robot should go, in order; its last goal again where other lanes have more.
        lidars: Each robot's lidar: where it is mounted (x m, y m, yaw rad), the height of its plane and its range (m),
            the direction of its first ray and the turn from one to the next (rad).
        people_start_m, people_m: Where people began and ended; of lanes without, none.
        robots_start_m, robots_m: The same of other robots.
        boxes_start_m, boxes_m: The same of boxes.
    """

    steps: Int[np.ndarray, "lanes"]
    crashed: Bool[np.ndarray, "lanes"]
    start: Float[np.ndarray, "lanes 3"]
    pose: Float[np.ndarray, "lanes 3"]
    velocity: Float[np.ndarray, "lanes 3"]
    goal_index: Int[np.ndarray, "lanes"]
    goals_m: Float[np.ndarray, "lanes goals 2"]
    lidars: Float[np.ndarray, "lanes 7"]
    people_start_m: Float[np.ndarray, "lanes people 2"]
    people_m: Float[np.ndarray, "lanes people 2"]
    robots_start_m: Float[np.ndarray, "lanes robots 2"]
    robots_m: Float[np.ndarray, "lanes robots 2"]
    boxes_start_m: Float[np.ndarray, "lanes boxes 2"]
    boxes_m: Float[np.ndarray, "lanes boxes 2"]


class SliceSamples(NamedTuple):
    """What is kept of a slice of control steps, lanes first.

    Attributes:
        steps: How many control steps the slice has.
        pose, velocity, goal_index: At the ends of the steps before which a sample is due.
        control, ranges_m: Of the steps for which a sample is due.
        last_control, last_ranges_m: Of each lane's last step in the slice.
        impulse_ns: Of every step.
        people_m, robots_m, boxes_m: As the poses; of lanes without people, other robots or boxes, none.
    """

    steps: int
    pose: np.ndarray
    velocity: np.ndarray
    goal_index: np.ndarray
    control: np.ndarray
    ranges_m: np.ndarray
    last_control: np.ndarray
    last_ranges_m: np.ndarray
    impulse_ns: np.ndarray
    people_m: np.ndarray
    robots_m: np.ndarray
    boxes_m: np.ndarray


def sample_stride(rate_hz: float, control_s: float) -> int:
    """Returns how many control steps lie between samples at a rate, made a whole fraction of the control rate."""
    return max(1, round(1.0 / max(rate_hz * control_s, _LEAST_RATE)))


def slice_samples(
    slice_: Steps, steps: Int[np.ndarray, "lanes"], *, lanes: int, before: int, stride: int
) -> SliceSamples:
    """Returns what is kept of a slice.

    Args:
        slice_: Its control steps.
        steps: How many control steps each lane has done by its end.
        lanes: How many lanes hold episodes.
        before: Control steps of the slices before.
        stride: Control steps from a sample to the next.
    """
    impulse = np.asarray(slice_.impulse_ns)[:lanes]
    length = impulse.shape[1]
    numbers = np.arange(before, before + length)
    begun, ended = np.flatnonzero(numbers % stride == 0), np.flatnonzero((numbers + 1) % stride == 0)
    # Where a lane came to its end, wherever in the slice: what it had decided when it crashed.
    last = np.clip(steps[:lanes] - before, 0, length - 1)
    control, ranges_m = np.asarray(slice_.control)[:lanes], np.asarray(slice_.ranges_m)[:lanes]
    every = np.arange(lanes)
    nobody = np.zeros((lanes, length, 0, 2), np.float32)
    movers_m = (nobody if each is None else np.asarray(each) for each in (getattr(slice_, name) for name in _MOVERS))
    people_m, robots_m, boxes_m = (each[:lanes, ended] for each in movers_m)
    return SliceSamples(
        steps=length,
        pose=np.asarray(slice_.pose)[:lanes, ended],
        velocity=np.asarray(slice_.velocity)[:lanes, ended],
        goal_index=np.asarray(slice_.goal_index)[:lanes, ended],
        control=control[:, begun],
        ranges_m=ranges_m[:, begun],
        last_control=control[every, last],
        last_ranges_m=ranges_m[every, last],
        impulse_ns=impulse.astype(np.float32),
        people_m=people_m,
        robots_m=robots_m,
        boxes_m=boxes_m,
    )


class StoredArray(NamedTuple):
    """An array that was kept.

    Attributes:
        array: The array, if it is in memory.
        offset: Where it begins in the file, if it is there.
    """

    array: np.ndarray | None
    dtype: np.dtype
    shape: tuple[int, ...]
    offset: int = 0

    @property
    def row_bytes(self) -> int:
        """Returns the bytes of one entry along its first axis."""
        return int(np.prod(self.shape[1:], dtype=np.int64)) * self.dtype.itemsize


class ArrayStore:
    """Keeps arrays."""

    def __init__(self, memory_bytes: int) -> None:
        """Begins with none.

        Args:
            memory_bytes: How much may stay in memory.
        """
        self._left_bytes = memory_bytes
        self._file: IO[bytes] | None = None
        self._written_bytes = 0
        self._mapped: np.ndarray | None = None

    def keep(self, array: np.ndarray) -> StoredArray:
        """Returns what to ask for the array with later."""
        whole = np.ascontiguousarray(array)
        if whole.nbytes <= self._left_bytes:
            self._left_bytes -= whole.nbytes
            return StoredArray(whole, whole.dtype, whole.shape)
        self._left_bytes = 0  # what comes later is not put before it
        if self._file is None:
            self._file = tempfile.TemporaryFile(prefix="simyard-recording-")  # noqa: SIM115 - closed with this
            weakref.finalize(self, self._file.close)
        offset = self._written_bytes
        self._file.write(whole.data if whole.size else b"")
        self._written_bytes += whole.nbytes
        self._mapped = None
        return StoredArray(None, whole.dtype, whole.shape, offset)

    def get(self, kept: StoredArray) -> np.ndarray:
        """Returns an array that was kept; it must not be written to."""
        if kept.array is not None:
            return kept.array
        count = int(np.prod(kept.shape, dtype=np.int64))
        if not count or self._file is None:
            return np.empty(kept.shape, kept.dtype)
        if self._mapped is None:
            self._file.flush()
            self._mapped = np.memmap(self._file, np.uint8, "r")
        held = self._mapped[kept.offset : kept.offset + count * kept.dtype.itemsize]
        return held.view(kept.dtype).reshape(kept.shape)


Columns = Mapping[str, np.ndarray]
Rows = Sequence[EpisodeResult] | EpisodeColumns
# Of results, which episodes' samples are kept; one answer stands for all.
Wanted = Callable[[EpisodeColumns], Bool[np.ndarray, " rows"] | bool]
# Samples of a usual chunk stay in memory, whatever parts it is run in; those of long episodes lie in a file that nobody
# sees.
_MEMORY_BYTES = 256 << 20
_PART_BYTES = 32 << 20
_MOVERS = ("people_m", "robots_m", "boxes_m")


# A sample is the state at the beginning of a control step and what happened in it: where the robot was and how it
# moved, the scan it saw then, the control that was decided on it, and what contacts pushed the robot with until the
# next sample. The last sample of an episode is the state in which it ended.
class LaneRecorder(Protocol):
    """Whoever is told what lanes do: a recorder, or what tells a recorder in another process."""

    def begin(self, lanes: int, control_s: float) -> None:
        """Prepares for so many lanes that hold episodes, and control steps of that length."""
        ...

    def keep(self, slice_: Steps, steps: Int[np.ndarray, "lanes"]) -> None:
        """Is given a slice, and the control steps that each lane has done by its end; -1 if it had ended before."""
        ...

    def end(self, ends: Ends, rows: Rows) -> None:
        """Is told how the lanes ended."""
        ...


class SampleRecorder(LaneRecorder, Protocol):
    """A recorder that also takes samples that others made of the lanes."""

    @property
    def rate_hz(self) -> float:
        """Returns how many samples a simulated second are wanted."""
        ...

    def wants(self, rows: EpisodeColumns) -> Bool[np.ndarray, " rows"]:
        """Returns which episodes it keeps, by their results; of others nothing need be told."""
        ...

    def add(self, samples: SliceSamples, steps: Int[np.ndarray, "lanes"]) -> None:
        """Is given a slice's samples instead of the slice."""
        ...


def sample_memory() -> ArrayStore:
    """Returns what holds the samples of a chunk; recorders that share it stay within its size together."""
    return ArrayStore(_MEMORY_BYTES)


class Recorder:
    """The samples of a chunk's lanes, of one run of a program's lanes or of several, one after the other."""

    def __init__(self, rate_hz: float, wanted: Wanted, memory: ArrayStore | None = None) -> None:
        """Begins without samples.

        Args:
            rate_hz: Samples in a simulated second; made a whole fraction of the control rate.
            wanted: Which episodes are kept, by their results.
            memory: Holds the samples; by default what no other recorder shares.
        """
        self.rate_hz = rate_hz
        self._wanted = wanted
        self._overflow = memory or sample_memory()
        self._runs: list[_RunSamples] = []

    def begin(self, lanes: int, control_s: float) -> None:
        """Prepares for the lanes of another run.

        Args:
            lanes: How many hold episodes.
            control_s: Length of a control step.
        """
        self._runs.append(_RunSamples(lanes, control_s, sample_stride(self.rate_hz, control_s), self._overflow))

    def keep(self, slice_: Steps, steps: Int[np.ndarray, "lanes"]) -> None:
        """Keeps the samples of a slice.

        Args:
            slice_: Its control steps.
            steps: How many control steps each lane has done by its end; below 0 if it had ended before.
        """
        run = self._runs[-1]
        self.add(slice_samples(slice_, steps, lanes=run.lanes, before=run.steps, stride=run.stride), np.asarray(steps))

    def add(self, samples: SliceSamples, steps: Int[np.ndarray, "lanes"]) -> None:
        """Adds the samples of a slice.

        Args:
            samples: As ``slice_samples`` makes them with this recorder's rate.
            steps: How many control steps each lane has done by the slice's end; below 0 if it had ended before.
        """
        self._runs[-1].add(samples, steps)

    def end(self, ends: Ends, rows: Rows) -> None:
        """Says how the lanes of the last run ended.

        Args:
            ends: Of all lanes.
            rows: The lanes' results, in their order.
        """
        columns = EpisodeColumns.of(rows)
        lanes = np.flatnonzero(self.wants(columns))
        self._runs[-1].end(ends, list(zip(lanes.tolist(), columns.index[lanes].tolist(), strict=True)))

    def wants(self, rows: EpisodeColumns) -> Bool[np.ndarray, " rows"]:
        """Returns which episodes are kept, by their results."""
        return np.broadcast_to(self._wanted(rows), len(rows))

    @property
    def untouched(self) -> bool:
        """Returns whether nothing was recorded yet."""
        return not self._runs

    @property
    def episodes(self) -> list[int]:
        """Returns the indices of the episodes that are kept."""
        return [index for run in self._runs for _, index in run.kept]

    def parts(self, unwanted: Collection[int] = ()) -> Iterator[Columns]:
        """Yields the samples of the kept episodes, some episodes at a time, as columns of equal length.

        Those of the indices ``unwanted`` are left out. The columns are ``index``, ``t_s``, ``pose``, ``velocity``,
        ``goal_index``, ``acted`` (whether a control was decided), ``control``, ``ranges_m`` and ``impulse_ns``; and
        ``goal_m``, where the goal is, ``lidar``, as ``Ends.lidars`` has it, ``people_m``, ``robots_m`` and ``boxes_m``.
        """
        for run in self._runs:
            yield from run.parts(unwanted)


class _RunSamples:
    """The samples of one run of a program's lanes."""

    def __init__(self, lanes: int, control_s: float, stride: int, overflow: ArrayStore) -> None:
        self.lanes, self.stride, self.steps = lanes, stride, 0
        self.kept: list[tuple[int, int]] = []
        names = ("pose", "velocity", "goal_index", "control", "ranges_m", "impulse_ns", *_MOVERS)
        self._blocks: dict[str, list[StoredArray]] = {name: [] for name in names}
        self._last: dict[str, np.ndarray] = {}
        self._ends: Ends | None = None
        self._control_s, self._overflow = control_s, overflow

    def add(self, samples: SliceSamples, steps: Int[np.ndarray, "lanes"]) -> None:
        for name in self._blocks:
            self._add(name, getattr(samples, name))
        self._note_last("control", samples.last_control, steps)
        self._note_last("ranges_m", samples.last_ranges_m, steps)
        self.steps += samples.steps

    def end(self, ends: Ends, kept: list[tuple[int, int]]) -> None:
        self._ends, self.kept = ends, kept

    def parts(self, unwanted: Collection[int]) -> Iterator[Columns]:
        wanted = [(lane, index) for lane, index in self.kept if index not in unwanted]
        if not wanted or self._ends is None:
            return
        each = 1 + sum(kept.row_bytes for blocks in self._blocks.values() for kept in blocks)
        at_once = max(1, _PART_BYTES // each)
        for first in range(0, len(wanted), at_once):
            group = wanted[first : first + at_once]
            lanes = np.array([lane for lane, _ in group])
            yield self._columns(lanes, np.array([index for _, index in group]), self._ends)

    def _note_last(self, name: str, found: np.ndarray, steps: Int[np.ndarray, "lanes"]) -> None:
        """Keeps what was last of each lane; of a lane that had ended before this slice, what was noted then."""
        if name not in self._last:
            self._last[name] = found.copy()
            return
        moving = steps[: self.lanes] >= self.steps
        self._last[name][moving] = found[moving]

    def _add(self, name: str, block: np.ndarray) -> None:
        self._blocks[name].append(self._overflow.keep(block))

    def _of(self, name: str, lanes: np.ndarray) -> list[np.ndarray]:
        """Returns what was added under a name, of some lanes."""
        return [self._overflow.get(kept)[lanes] for kept in self._blocks[name]]

    def _columns(self, lanes: np.ndarray, indices: np.ndarray, ends: Ends) -> Columns:
        """Returns the samples of some lanes. Slot j of a lane is its step j times the stride; behind them its end."""
        steps = ends.steps[lanes]
        # A longer stride than any episode gives the same samples, and needs no room.
        stride = min(self.stride, max(1, int(steps.max())))
        final = -(-steps // stride)
        slots = np.arange(int(final.max()) + 1)
        number = np.minimum(slots * stride, steps[:, None])
        there = slots <= final[:, None]
        at_end = slots == final[:, None]
        acted = np.where(at_end, ends.crashed[lanes][:, None], there)
        names = ("pose", "velocity", "goal_index", *_MOVERS)
        states = {name: self._states(name, lanes, ends, at_end) for name in names}
        actions = {name: self._actions(name, lanes, at_end) for name in ("control", "ranges_m")}
        columns = {
            "index": np.broadcast_to(indices[:, None], there.shape),
            "t_s": np.round(number * self._control_s, 6),
            **states,
            "acted": acted,
            **actions,
            "impulse_ns": self._impulses(lanes, steps, len(slots), stride),
            "goal_m": _chosen(ends.goals_m[lanes], states["goal_index"]),
            "lidar": np.broadcast_to(ends.lidars[lanes][:, None], (*there.shape, ends.lidars.shape[1])),
        }
        return {name: values[there] for name, values in columns.items()}

    def _states(self, name: str, lanes: np.ndarray, ends: Ends, at_end: Bool[np.ndarray, "lanes slots"]) -> np.ndarray:
        final = getattr(ends, name)[lanes]
        movers = (ends.people_start_m, ends.robots_start_m, ends.boxes_start_m)
        started = {"pose": ends.start, **dict(zip(_MOVERS, movers, strict=True))}
        begun = started.get(name)
        first = np.zeros_like(final) if begun is None else begun[lanes].astype(final.dtype)
        slots = _fitted([first[:, None], *self._of(name, lanes)], at_end.shape[1])
        slots[at_end] = final
        return slots

    def _actions(self, name: str, lanes: np.ndarray, at_end: Bool[np.ndarray, "lanes slots"]) -> np.ndarray:
        slots = _fitted(self._of(name, lanes), at_end.shape[1])
        slots[at_end] = self._last[name][lanes]
        return slots

    def _impulses(
        self, lanes: np.ndarray, steps: Int[np.ndarray, "lanes"], slots: int, stride: int
    ) -> Float32[np.ndarray, "lanes slots"]:
        """Returns what contacts pushed with from each sample to the next."""
        every = _fitted(self._of("impulse_ns", lanes), slots * stride)
        every[np.arange(every.shape[1]) >= steps[:, None]] = 0.0
        return every.reshape(len(lanes), slots, stride).sum(2, dtype=np.float32)


def _chosen(goals_m: Float[np.ndarray, "lanes goals 2"], index: Int[np.ndarray, "lanes slots"]) -> np.ndarray:
    """Returns the goal of each slot; after the last goal that one."""
    chosen = np.minimum(index, goals_m.shape[1] - 1).astype(np.intp)
    return np.take_along_axis(goals_m, chosen[:, :, None], axis=1)


def _fitted(blocks: Sequence[np.ndarray], slots: int) -> np.ndarray:
    """Returns blocks side by side in the second axis, cut or filled up with zeros to so many slots."""
    together = np.concatenate(blocks, axis=1)[:, :slots]
    missing = slots - together.shape[1]
    filling = np.zeros((together.shape[0], max(missing, 0), *together.shape[2:]), together.dtype)
    return np.concatenate([together, filling], axis=1)

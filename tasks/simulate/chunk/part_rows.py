"""What becomes of a part of a chunk whose episodes drive in lanes that others leave: its rows, and its recording.

Its episodes begin when a lane is free, each at another time. A recorder is told of them as if they had begun together.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Float32, Int

from specs.data.episode import CONTROL_S
from specs.data.episode_columns import EpisodeColumns
from tasks.simulate.chunk.run_rows import lane_ends
from tasks.simulate.devices import device_kind
from tasks.simulate.engine.program import Program
from tasks.simulate.lane.lane_state import LaneState
from tasks.simulate.lane.recording import SampleRecorder
from tasks.simulate.lane.result_rows import Ended, finished_rows, stopped_row
from tasks.simulate.lane.samples import SliceSamples
from tasks.simulate.lane.staging import Lane, with_shortest_paths
from tasks.simulate.plan.chunks import SLICE_STEPS

Poses = Sequence[Float32[np.ndarray, "lanes steps 3"]]


class LaneEnd(NamedTuple):
    """How an episode ended.

    Attributes:
        place: The lane that it was in.
        state: All lanes' states then, on the host.
        poses: Of all lanes, since the episode began.
    """

    place: int
    state: LaneState
    poses: Poses


class _Block(NamedTuple):
    """Samples of one slice of those episodes that began together."""

    positions: Int[np.ndarray, "lanes"]
    steps: Int[np.ndarray, "lanes"]
    samples: SliceSamples


@dataclass(eq=False)
class PartRows:
    """The episodes of a chunk that have arrays of the same shapes, on their way.

    Attributes:
        program: That drives them.
        lanes: The episodes, as they were placed; their shortest ways are measured later.
        waiting: Those that ended and have no rows yet, by position.
        kept_bytes: Of the samples that are kept.
    """

    program: Program
    lanes: list[Lane]
    waiting: dict[int, LaneEnd] = field(default_factory=dict[int, LaneEnd], init=False)
    kept_bytes: int = field(default=0, init=False)
    _ends: dict[int, LaneEnd] = field(default_factory=dict[int, LaneEnd], init=False)
    _rows: list[EpisodeColumns] = field(default_factory=list[EpisodeColumns], init=False)
    _blocks: list[list[_Block]] = field(default_factory=list[list[_Block]], init=False)
    _unmeasured: dict[str, list[int]] = field(default_factory=dict[str, list[int]], init=False)

    def __post_init__(self) -> None:
        """Notes which episodes are in the same world."""
        for position, lane in enumerate(self.lanes):
            self._unmeasured.setdefault(lane.request.world, []).append(position)

    @property
    def measured(self) -> bool:
        """Returns whether all shortest ways are known."""
        return not self._unmeasured

    def measure_some(self) -> None:
        """Measures the shortest ways in one world, if any are not known; together they cost less."""
        if self._unmeasured:
            self._measure(next(iter(self._unmeasured)))

    def _measure(self, world: str) -> None:
        positions = self._unmeasured.pop(world, None)
        if positions:
            lanes = with_shortest_paths([self.lanes[position] for position in positions])
            for position, lane in zip(positions, lanes, strict=True):
                self.lanes[position] = lane

    @property
    def ended(self) -> int:
        """Returns how many episodes have ended."""
        return len(self._ends)

    def end(self, position: int, end: LaneEnd) -> None:
        """Notes how an episode ended; its row is made later."""
        self._ends[position] = self.waiting[position] = end

    def make_rows(self) -> None:
        """Makes the rows of some episodes that wait for them, which ended in the same slice."""
        state = next(iter(self.waiting.values())).state
        together = [position for position, end in self.waiting.items() if end.state is state]
        for world in dict.fromkeys(self.lanes[position].request.world for position in together):
            self._measure(world)
        ends = [self.waiting.pop(position) for position in together]
        ended = [
            Ended(self.lanes[position], end.place, len(end.poses)) for position, end in zip(together, ends, strict=True)
        ]
        poses = max((end.poses for end in ends), key=len)
        device = device_kind()
        self._rows.append(finished_rows(ended, state, poses, engine=self.program.engine, device=device))

    def keep(
        self, age: int, positions: Int[np.ndarray, "lanes"], steps: Int[np.ndarray, "lanes"], samples: SliceSamples
    ) -> None:
        """Keeps samples of episodes that are equally old.

        Args:
            age: How many slices they did before.
            positions: The episodes'.
            steps: How many control steps each has done by the slice's end.
            samples: As a recorder wants them.
        """
        while len(self._blocks) <= age:
            self._blocks.append([])
        self._blocks[age].append(_Block(positions, steps, samples))
        self.kept_bytes += sum(array.nbytes for array in samples[1:])

    def all_rows(self) -> EpisodeColumns:
        """Returns the rows of all episodes, in their order; those that have not ended are Canceled."""
        while self.waiting:
            self.make_rows()
        left = [stopped_row(lane.request) for place, lane in enumerate(self.lanes) if place not in self._ends]
        rows = EpisodeColumns.join([*self._rows, EpisodeColumns.of(left)])
        return rows.at(np.array([lane.request.index for lane in self.lanes], np.int64))

    def tell(self, recorder: SampleRecorder, rows: EpisodeColumns) -> None:
        """Tells a recorder what the episodes did that it keeps, and how they ended."""
        told = np.flatnonzero(recorder.wants(rows))
        if not len(told):
            self._blocks, self.kept_bytes = [], 0
            return
        recorder.begin(len(told), CONTROL_S)
        for age, blocks in enumerate(self._blocks):
            samples, steps = _together(blocks, told)
            recorder.add(samples, steps)
            self._blocks[age] = []
        self.kept_bytes = 0
        if self._ends:
            lanes = [self.lanes[position] for position in told.tolist()]
            recorder.end(lane_ends(lanes, self._last_states(told.tolist())), rows.take(told))

    def _last_states(self, told: Sequence[int]) -> LaneState:
        """Returns the last states of some episodes, in their order; zeros for one that has not ended."""
        together: dict[int, list[tuple[int, int]]] = {}
        for place, position in enumerate(told):
            if (end := self._ends.get(position)) is not None:
                together.setdefault(id(end.state), []).append((place, position))
        some = next(iter(self._ends.values())).state

        def blank(leaf: Any) -> np.ndarray:  # noqa: ANN401 - of a tree
            return np.zeros((len(told), *leaf.shape[1:]), leaf.dtype)

        found = jax.tree.map(blank, some)
        into = jax.tree.leaves(found)
        for ended in together.values():
            places, ends = [place for place, _ in ended], [self._ends[position] for _, position in ended]
            for leaf, source in zip(into, jax.tree.leaves(ends[0].state), strict=True):
                leaf[places] = source[[end.place for end in ends]]
        return found


def _together(
    blocks: Sequence[_Block], told: Int[np.ndarray, "lanes"]
) -> tuple[SliceSamples, Int[np.ndarray, "lanes"]]:
    """Returns the samples of some lanes of a slice, and their steps: below 0 for one that had ended before."""
    steps = np.full(len(told), -1, np.int32)
    first = blocks[0].samples
    arrays = [np.zeros((len(told), *array.shape[1:]), array.dtype) for array in first[1:]]
    for positions, done, samples in blocks:
        some = np.isin(positions, told)
        places = np.searchsorted(told, positions[some])
        steps[places] = done[some]
        for array, found in zip(arrays, samples[1:], strict=True):
            array[places] = found[some]
    return SliceSamples(SLICE_STEPS, *arrays), steps

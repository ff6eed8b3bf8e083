"""The lanes of one compiled program, filled with other episodes as soon as theirs are done.

While a slice is computed, the host has time for other work: ``dispatch`` begins a slice, ``collect`` waits for it.
"""

from collections import Counter, deque
from collections.abc import Generator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float32, Int

from specs.data.episode import EpisodeResult
from tasks.simulate.chunk.part_rows import LaneEnd, PartRows
from tasks.simulate.chunk.placed_chunk import PlacedChunk
from tasks.simulate.engine.compiled_program import CompiledProgram
from tasks.simulate.engine.program import lane_sharding, put_lanes
from tasks.simulate.lane.lane_state import LaneInputs, LaneState, StepRecord
from tasks.simulate.lane.samples import slice_samples
from tasks.simulate.lane.staging import Lane, stack_lanes
from tasks.simulate.plan.chunks import Chunk

# What a robot is taken to drive at, to guess which episodes last: those that begin late let other lanes rest.
_USUAL_M_S = 0.5


class LaneSetting(NamedTuple):
    """What chunks share that are under way together.

    Attributes:
        bundles: Unpacked folders of the applications, by digest.
        lanes: How many lanes every chunk is padded to.
        engine: ``auto``, or the engine that must run them.
        rate_hz: Samples a simulated second; None if nothing is recorded.
    """

    bundles: Mapping[str, Path]
    lanes: int
    engine: str
    rate_hz: float | None


class Waiting(NamedTuple):
    """An episode that waits for a lane."""

    part: PartRows
    position: int


class _Driving(NamedTuple):
    """An episode in a lane, and the slice in which it began."""

    part: PartRows
    position: int
    since: int


class _Fresh(NamedTuple):
    """Episodes that begin together in the next lanes that are free, each device's share after the other's."""

    episodes: list[Waiting | None]
    inputs: LaneInputs


class LaneStream:
    """The lanes of a program, and the episodes that wait for them."""

    def __init__(self, program: CompiledProgram, stride: int | None) -> None:
        """Begins without episodes.

        Args:
            program: Whose lanes they are.
            stride: Control steps from a sample to the next; None if nothing is recorded.
        """
        self.program = program
        self._stride = stride
        self._waiting = deque[Waiting]()
        self._fresh: _Fresh | None = None
        self._driving: list[_Driving | None] = [None] * program.lanes
        self._held: tuple[LaneInputs, LaneState] | None = None
        self._record: StepRecord | None = None
        self._poses = deque[Float32[np.ndarray, "lanes steps 3"]]()
        self._slices = 0

    @property
    def busy(self) -> int:
        """Returns how many lanes hold episodes."""
        return sum(each is not None for each in self._driving)

    @property
    def left(self) -> int:
        """Returns how many episodes drive, or wait for a lane."""
        fresh = sum(each is not None for each in self._fresh.episodes) if self._fresh else 0
        return self.busy + len(self._waiting) + fresh

    def add(self, part: PartRows) -> None:
        """Lets the episodes of a part wait for lanes, behind those that do; the longest first."""
        self._waiting.extend(Waiting(part, position) for position in longest_first(part.lanes))

    def fill(self) -> None:
        """Puts episodes that wait into lanes that are free, if there are enough of them on each device."""
        while self._fresh or self._waiting:
            if self._held is not None and not self._enough_free():
                return
            self.prepare()
            fresh, self._fresh = self._fresh, None
            if fresh is None:
                return
            self._put(fresh)

    def prepare(self) -> None:
        """Makes ready what the next lanes that are free begin with."""
        if self._fresh is not None or not self._waiting:
            return
        devices, together = self.program.mesh.size, self.program.refill.together
        some = [self._waiting.popleft() for _ in range(min(devices * together, len(self._waiting)))]
        # One after the other goes to another device.
        shares = [some[device::devices] for device in range(devices)]
        episodes = [each for share in shares for each in [*share, *[None] * (together - len(share))]]
        lanes = [(each or some[0]).part.lanes[(each or some[0]).position] for each in episodes]
        inputs = stack_lanes(lanes, self.program.applications.names, len(lanes))
        alive = jnp.asarray([each is not None for each in episodes])
        self._fresh = _Fresh(episodes, put_lanes(self.program.mesh, inputs._replace(alive=alive)))

    def dispatch(self) -> None:
        """Begins a slice."""
        if self._held is None:
            raise RuntimeError("no lane was filled")
        if self._record is not None:
            raise RuntimeError("the slice before was not collected")
        inputs, state = self._held
        state, self._record = self.program.advance(inputs, state)
        self._held = inputs, state

    @property
    def computing(self) -> bool:
        """Returns whether a slice is on its way whose end is still to come."""
        pose: Any = None if self._record is None else self._record.pose
        return pose is not None and not pose.is_ready()

    @property
    def filled(self) -> bool:
        """Returns whether its lanes were filled once, so that its program is there."""
        return self._held is not None

    @property
    def begun(self) -> bool:
        """Returns whether a slice was begun that is not collected."""
        return self._record is not None

    def collect(self) -> list[Waiting]:
        """Waits for the slice; returns the episodes that ended in it."""
        if self._record is None or self._held is None:
            return []
        record, self._record = self._record, None
        state = self._held[1]
        done = np.asarray(state.done)
        self._poses.append(np.asarray(record.pose))
        self._slices += 1
        if self._stride is not None:
            self._sample(record, np.asarray(state.step), self._stride)
        places = [place for place, each in enumerate(self._driving) if each is not None and done[place]]
        return self._ended(places, state) if places else []

    def _ended(self, places: Sequence[int], state: LaneState) -> list[Waiting]:
        host = jax.device_get(state._replace(controller=None, scenario=None))
        ended: list[Waiting] = []
        poses = list(self._poses)
        for place in places:
            each = self._driving[place]
            if each is not None:
                slices = self._slices - each.since
                each.part.end(each.position, LaneEnd(place, host, poses[len(poses) - slices :]))
                ended.append(Waiting(each.part, each.position))
                self._driving[place] = None
        oldest = min((each.since for each in self._driving if each is not None), default=self._slices)
        while len(self._poses) > self._slices - oldest:
            self._poses.popleft()
        return ended

    def _sample(self, record: StepRecord, steps: Int[np.ndarray, "lanes"], stride: int) -> None:
        """Keeps samples of the slice, of those together that are in one part and equally old."""
        groups: dict[tuple[PartRows, int], list[int]] = {}
        for place, each in enumerate(self._driving):
            if each is not None:
                groups.setdefault((each.part, self._slices - 1 - each.since), []).append(place)
        host: Any = jax.device_get(record)
        for (part, age), places in groups.items():
            some = jax.tree.map(lambda array, at=places: array[at], host)
            done, length = steps[places], host.impulse_ns.shape[1]
            samples = slice_samples(some, done, lanes=len(places), before=age * length, stride=stride)
            positions = [each.position for place in places if (each := self._driving[place]) is not None]
            part.keep(age, np.array(positions), done, samples)

    def _free(self) -> list[list[int]]:
        """Returns the free lanes of each device, counted on it from 0."""
        devices = self.program.mesh.size
        each = self.program.lanes // devices
        return [
            [place for place in range(each) if self._driving[device * each + place] is None]
            for device in range(devices)
        ]

    def _enough_free(self) -> bool:
        return min(map(len, self._free())) >= self.program.refill.together

    def _put(self, fresh: _Fresh) -> None:
        refill, devices = self.program.refill, self.program.mesh.size
        each = self.program.lanes // devices
        first = self._held is None
        held = self._held or refill.blank(fresh.inputs)
        places: list[int] = []
        for device, free in enumerate(self._free()):
            share = fresh.episodes[device * refill.together : (device + 1) * refill.together]
            for place, episode in zip(free, share, strict=False):
                places.append(place if episode is not None or first else each)
                if episode is not None:
                    self._driving[device * each + place] = _Driving(*episode, self._slices)
        at = jax.device_put(np.array(places, np.int32), lane_sharding(self.program.mesh))
        held = refill.fill(held[0], held[1], fresh.inputs, at)
        self._held = refill.spread(*held) if first else held


@dataclass(eq=False)
class ChunkOnItsWay:
    """A chunk that is placed, or is being so, and its episodes.

    Attributes:
        steps: Of placing it; None when all are done.
        placed: Whether its episodes drive, or wait for lanes.
        failed: Rows of episodes that cannot begin.
        parts: The others, each with the lanes that it waits for; empty until they are known.
    """

    chunk: Chunk
    steps: Generator[None, None, PlacedChunk] | None
    placed: bool = False
    failed: list[EpisodeResult] = field(default_factory=list[EpisodeResult])
    parts: list[tuple[PartRows, LaneStream]] = field(default_factory=list[tuple[PartRows, LaneStream]])

    @property
    def ended(self) -> int:
        """Returns how many episodes have ended, or never begin."""
        return len(self.failed) + sum(part.ended for part, _ in self.parts)

    @property
    def measured(self) -> bool:
        """Returns whether all shortest ways are known of the episodes that wait for lanes."""
        return all(part.measured for part, _ in self.parts)

    @property
    def fits_into_free_lanes(self) -> bool:
        """Returns whether all episodes begin at once, so that their order is nothing to wait for."""
        episodes = Counter[LaneStream]()
        for part, stream in self.parts:
            episodes[stream] += len(part.lanes)
        return all(stream.left + count <= stream.program.lanes for stream, count in episodes.items())

    def measure_some(self) -> None:
        """Measures the shortest ways in one world, if any are not known."""
        part = next((part for part, _ in self.parts if not part.measured), None)
        if part is not None:
            part.measure_some()

    def wait_for_lanes(self) -> None:
        """Lets the episodes wait for lanes, behind those that do."""
        self.placed = True
        for part, stream in self.parts:
            stream.add(part)


def longest_first(lanes: Sequence[Lane]) -> list[int]:
    """Returns the places of episodes, those first that may last longest; equal ones in their order."""
    expected_s = [_expected_s(lane) for lane in lanes]
    return sorted(range(len(lanes)), key=lambda position: -expected_s[position])


def _expected_s(lane: Lane) -> float:
    """Returns how long an episode may last; one without a way that is known, until its time is up."""
    most_s = lane.request.duration_s
    return most_s if lane.shortest_path_m is None else min(most_s, lane.shortest_path_m / _USUAL_M_S)

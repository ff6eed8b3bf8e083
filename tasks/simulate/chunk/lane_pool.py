"""The lanes of one compiled program, and the episodes of a chunk that drive in them.

A lane is filled with another episode as soon as its own is done. Episodes of a group, which have arrays of the same
shapes, so begin each at another time; a recorder is told of them as if they had begun together. While a slice is
computed, the host has time for other work: ``dispatch`` begins a slice, ``collect`` waits for it.
"""

import contextlib
from collections import Counter, deque
from collections.abc import Generator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float32, Int

from specs.data.episode import CONTROL_S, EpisodeResult
from specs.data.episode_columns import EpisodeColumns
from tasks.simulate.chunk.byproducts import give_tags
from tasks.simulate.chunk.chunk_placement import PlacedChunk
from tasks.simulate.devices import device_kind
from tasks.simulate.engines.compiled_program import CompiledProgram
from tasks.simulate.engines.program import Program, Run, lane_sharding, put_lanes
from tasks.simulate.host.controllers import BlamesCrashes, HostControllers, JudgesJobs, TagsJobs, TellsMetrics
from tasks.simulate.host.ros_judge import judged_row
from tasks.simulate.lane.control_step import NO_CRASH, LaneInputs, LaneState, StepRecord
from tasks.simulate.lane.lane_boxes import BoxesInputs, begin_boxes, box_places_m
from tasks.simulate.lane.recording import Ends, SampleRecorder, SliceSamples, slice_samples
from tasks.simulate.lane.result_rows import Ended, finished_rows, stopped_row, withdrawn_row
from tasks.simulate.lane.staging import Lane, filled_up, stack_lanes, with_shortest_paths
from tasks.simulate.plan.chunks import SLICE_STEPS, Chunk
from tasks.simulate.sensors.lidar import Lidar, ray_angles


@contextlib.contextmanager
def open_run(run: Run) -> Generator[Run]:
    """Gives a run, and ends its controllers on the host afterwards, whatever happened."""
    try:
        yield run
    finally:
        if run.host is not None:
            run.host.close()


def lane_row(  # noqa: PLR0917 - a lane of a run
    program: Program,
    host: HostControllers | None,
    lane: Lane,
    position: int,
    state: LaneState,
    poses: Sequence[Float32[np.ndarray, "lanes steps 3"]],
) -> EpisodeResult:
    """Returns the row of a lane that is done, with what drove it; the tags that it gave to its job are given on.

    Args:
        program: That ran it.
        host: Controllers on the host, which may know why it crashed, or that it asked for its end.
        lane: The episode.
        position: The lane's position in the chunk.
        state: All lanes' states, on the host.
        poses: The slices' poses at the ends of their control steps.
    """
    ended = [Ended(lane, position, len(poses))]
    (row,) = finished_rows(ended, state, poses, hull=program.hull, engine=program.engine, device=device_kind())
    if host is None:
        return row
    if isinstance(host, TagsJobs):
        give_tags(lane.request.index, host.tags(position))
    row = row.model_copy(update=host.measures(position))
    if isinstance(host, TellsMetrics) and (measured := host.metrics(position)):
        row = row.model_copy(update={"metrics": {**row.metrics, **measured}})
    if position in host.crashes:
        code = {"failure_code": host.failure_code(position)} if isinstance(host, BlamesCrashes) else {}
        return row.model_copy(update={"failure_reason": host.crashes[position], **code})
    judgement = host.judgement(position) if isinstance(host, JudgesJobs) else None
    if position in host.cancelled and (judgement is None or judgement.passed is None):
        return withdrawn_row(lane.request)
    return judged_row(row, judgement) if judgement else row


def lane_ends(lanes: Sequence[Lane], state: LaneState) -> Ends:
    """Returns how lanes ended, for their recorder."""
    most_goals = max(len(lane.placement.goals_m) for lane in lanes)
    nobody = boxes_start_m = boxes_m = np.zeros((len(lanes), 0, 2), np.float32)
    some = [lane.boxes for lane in lanes if lane.boxes is not None]
    if state.boxes is not None and some:
        boxes: BoxesInputs = jax.tree.map(lambda *each: np.stack(each), *map(BoxesInputs._make, some))
        starts_m = np.stack([lane.placement.start[:2] for lane in lanes]).astype(np.float32)
        boxes_start_m = box_places_m(boxes, begin_boxes(boxes, starts_m, np), np)
        boxes_m = box_places_m(boxes, np.asarray(state.boxes)[: len(lanes)], np)
    return Ends(
        steps=np.asarray(state.step),
        crashed=np.asarray(state.crash) != NO_CRASH,
        start=np.stack([lane.placement.start for lane in lanes]),
        pose=np.asarray(state.body.qpos),
        velocity=np.asarray(state.body.qvel),
        goal_index=np.asarray(state.goal_index),
        goals_m=np.stack([filled_up(lane.placement.goals_m, most_goals) for lane in lanes]),
        lidars=np.array([_lidar_numbers(lane.lidar) for lane in lanes]),
        people_start_m=np.stack([nobody[0] if lane.people is None else lane.people.place_m for lane in lanes]),
        people_m=nobody if state.people is None else np.asarray(state.people.place_m)[: len(lanes)],
        robots_start_m=np.stack([nobody[0] if lane.robots is None else lane.robots.start_m for lane in lanes]),
        robots_m=nobody if state.robots is None else np.asarray(state.robots.place_m)[: len(lanes)],
        boxes_start_m=boxes_start_m,
        boxes_m=boxes_m,
    )


def _lidar_numbers(lidar: Lidar) -> tuple[float, ...]:
    """Returns a lidar as ``Ends.lidars`` has it."""
    angles = ray_angles(lidar).astype(np.float64)
    first_rad = float(angles[0]) if len(angles) else 0.0
    step_rad = float(angles[-1] - angles[0]) / (len(angles) - 1) if len(angles) > 1 else 0.0
    mount = (float(lidar.x_m), float(lidar.y_m), float(lidar.yaw_rad))
    return (*mount, lidar.height_m, lidar.range_m, first_rad, step_rad)


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


class _SampleBlock(NamedTuple):
    """Samples of one slice of those episodes that began together."""

    positions: Int[np.ndarray, "lanes"]
    steps: Int[np.ndarray, "lanes"]
    samples: SliceSamples


@dataclass(eq=False)
class EpisodeGroup:
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
    _blocks: list[list[_SampleBlock]] = field(default_factory=list[list[_SampleBlock]], init=False)
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
        hull, engine = self.program.hull, self.program.engine
        self._rows.append(finished_rows(ended, state, poses, hull=hull, engine=engine, device=device))

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
        self._blocks[age].append(_SampleBlock(positions, steps, samples))
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
            samples, steps = _joined_samples(blocks, told)
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


def _joined_samples(
    blocks: Sequence[_SampleBlock], told: Int[np.ndarray, "lanes"]
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

    part: EpisodeGroup
    position: int


class _Driving(NamedTuple):
    """An episode in a lane, and the slice in which it began."""

    part: EpisodeGroup
    position: int
    since: int


class _NextEpisodes(NamedTuple):
    """Episodes that begin together in the next lanes that are free, each device's share after the other's."""

    episodes: list[Waiting | None]
    inputs: LaneInputs


class LanePool:
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
        self._fresh: _NextEpisodes | None = None
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

    def add(self, part: EpisodeGroup) -> None:
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
        self._fresh = _NextEpisodes(episodes, put_lanes(self.program.mesh, inputs._replace(alive=alive)))

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
        groups: dict[tuple[EpisodeGroup, int], list[int]] = {}
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

    def _put(self, fresh: _NextEpisodes) -> None:
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
class PendingChunk:
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
    parts: list[tuple[EpisodeGroup, LanePool]] = field(default_factory=list[tuple[EpisodeGroup, LanePool]])

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
        episodes = Counter[LanePool]()
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

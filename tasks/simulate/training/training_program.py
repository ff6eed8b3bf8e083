"""The program of a task: its robot on a compiled engine, its pool of episodes, and the lanes that a trainer steps.

A control step of all lanes begins episodes that ended anew. A lane takes the same steps as in a batch: the engine
drives, the lane judges and senses. What comes besides is the draw of the next episode, a copy of its inputs out of the
pool, and a reward. From the host, actions go in, and NumPy arrays come out of each control step.
"""

import functools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh, NamedSharding, PartitionSpec
from jaxtyping import Array, Bool, Float, Float32, Int, UInt8, UInt32

from specs.bundle_files import ColorCameraDeclaration
from specs.data.episode import CONTROL_S, ApplicationLaunch, EpisodeRequest
from specs.data.world import World
from tasks.simulate.application.bundle_code import load_factory
from tasks.simulate.application.contract import TIMEOUT, Observation, Verdict
from tasks.simulate.application.mjcf_check import RobotRefused
from tasks.simulate.engines.mjx.mjx_engine import mjx_mechanics
from tasks.simulate.engines.planar.planar_engine import planar_mechanics
from tasks.simulate.engines.program import (
    LaneTransfer,
    PackedLanes,
    lane_mesh,
    pack_lane,
    padded_lanes,
    strong_types,
    unpack_lane,
    with_stand_in,
)
from tasks.simulate.host.controllers import HOST_KINDS, HostBundle
from tasks.simulate.host.declaration import ROBOT_FILE, controller_kind, load_controller
from tasks.simulate.lane.chunk_applications import Applications
from tasks.simulate.lane.control_step import (
    Decision,
    LaneInputs,
    LaneState,
    Mechanics,
    finish_step,
    observe,
    truth_after,
)
from tasks.simulate.plan.chunks import split_environment
from tasks.simulate.sensors.sensor import seed_words
from tasks.simulate.sensors.sensor_table import Sensors, read_color_camera, read_sensors
from tasks.simulate.training.episode_pool import EpisodePool, StagedPool, WayFields, stage_pool, way_left_m
from tasks.simulate.training.lane_colors import ColorTask, LaneColors
from tasks.simulate.training.training_spaces import (
    COLOR,
    ActionMap,
    FieldBounds,
    Reward,
    Transition,
    action_map,
    control_of,
    default_fields,
    field_bounds,
    observed_fields,
    progress,
)

_AXIS = "lanes"
Actions = Float[Array, "lanes actions"]
# A lane's reward, whether it terminated and was truncated, how its episode stands, then what it sees: one array, which
# is one way to the host.
Rows = Float[Array, "lanes numbers"]


class TrainingState(NamedTuple):
    """All lanes between two steps, lanes first; on the devices.

    Attributes:
        inputs: Of the lanes' episodes, copied from the pool.
        state: As in a batch.
        observed: What the robots sense now.
        seed: Each lane's own, as ``seed_words``.
        turn: Which episode of the lane's seed it is, from 0.
        episode: Which of the pool.
    """

    inputs: LaneInputs
    state: LaneState
    observed: Observation
    seed: UInt32[Array, "lanes 2"]
    turn: Int[Array, "lanes"]
    episode: Int[Array, "lanes"]


# Each array that a compiled call takes or gives costs microseconds: 46 of them a tenth of a step of 1,024 lanes.
PackedTraining = PackedLanes[TrainingState]


class Renewal(NamedTuple):
    """Which lanes begin anew, lanes first.

    Attributes:
        marked: Whether a lane does.
        fresh: Whether it begins the first episode of another seed.
        seed: That seed, as ``seed_words``.
    """

    marked: Bool[Array, "lanes"]
    fresh: Bool[Array, "lanes"]
    seed: UInt32[Array, "lanes 2"]


class Standing(NamedTuple):
    """How lanes' episodes stand, lanes first, as numbers of a row; on the devices or in NumPy.

    Attributes:
        reason, goal_index, step: As in ``LaneState``.
        path_length_m, collisions: As in ``Tally``.
        pose: The true one.
        episode: Which of the pool.
    """

    reason: Any
    goal_index: Any
    step: Any
    path_length_m: Any
    collisions: Any
    pose: Any
    episode: Any


@dataclass(frozen=True, eq=False)
class LaneKernels:
    """What all lanes share: a robot on an engine, its applications, and what a trainer sees and pays.

    Attributes:
        applications: With a stand-in for the controller: actions drive.
        autoreset: Whether a lane that is done begins its next episode in the step after.
    """

    mechanics: Mechanics
    applications: Applications
    actions: ActionMap
    bounds: Mapping[str, FieldBounds]
    reward: Reward
    autoreset: bool


@dataclass(frozen=True, eq=False)
class VectorProgram:
    """The compiled functions.

    Attributes:
        blank: Returns lanes that have not begun; those beyond the count never will.
        renew: Returns lanes with the marked ones begun anew, those with a new seed at its first episode, and all
            observations; the lanes given are used up.
        step: Returns lanes a control step later, and what it gives; the lanes given are used up.
    """

    mesh: Mesh
    blank: Callable[[EpisodePool, Bool[Array, "lanes"]], PackedTraining]
    renew: Callable[[EpisodePool, PackedTraining, Renewal], tuple[PackedTraining, Rows]]
    step: Callable[[EpisodePool, PackedTraining, Actions], tuple[PackedTraining, Rows]]


def vector_program(kernels: LaneKernels, mesh: Mesh) -> VectorProgram:
    """Returns the compiled functions of some lanes; compiles nothing yet.

    Args:
        kernels: What all lanes share.
        mesh: The devices, each of which has the whole pool.
    """
    whole, share = PartitionSpec(), PartitionSpec(_AXIS)

    def split(kernel: Callable[..., object], arguments: int) -> Callable[..., object]:
        specs = (whole, *[share] * (arguments - 1))
        return jax.shard_map(
            functools.partial(kernel, kernels), mesh=mesh, in_specs=specs, out_specs=share, check_vma=False
        )

    return VectorProgram(
        mesh=mesh,
        blank=jax.jit(split(_blank, 2)),
        renew=jax.jit(split(_renew, 3), donate_argnums=1),
        step=jax.jit(split(_step, 3), donate_argnums=1),
    )


def _blank(kernels: LaneKernels, pool: EpisodePool, alive: Bool[Array, "lanes"]) -> PackedTraining:
    lanes = alive.shape[0]
    first = jax.tree.map(lambda each: jnp.repeat(each[:1], lanes, axis=0), pool.inputs)
    inputs = first._replace(alive=alive)
    state = jax.vmap(functools.partial(_begin, kernels))(inputs)
    observed = jax.vmap(functools.partial(observe, kernels.applications))(inputs, state)
    nothing = jnp.zeros(lanes, jnp.int32)
    return _packed(TrainingState(inputs, state, observed, jnp.zeros((lanes, 2), jnp.uint32), nothing, nothing))


def _renew(
    kernels: LaneKernels, pool: EpisodePool, packed: PackedTraining, renewal: Renewal
) -> tuple[PackedTraining, Rows]:
    lanes, (marked, fresh, seed) = _unpacked(packed), renewal
    lanes = lanes._replace(seed=jnp.where(fresh[:, None], seed, lanes.seed), turn=jnp.where(fresh, -1, lanes.turn))
    begun = _begun(kernels, pool, lanes, marked & lanes.inputs.alive)
    observed = jax.vmap(functools.partial(observe, kernels.applications))(begun.inputs, begun.state)
    after = begun._replace(observed=observed)
    return _packed(after), _rows(kernels, after, jnp.zeros((marked.shape[0], 3)))


def _step(
    kernels: LaneKernels, pool: EpisodePool, packed: PackedTraining, actions: Actions
) -> tuple[PackedTraining, Rows]:
    lanes = _unpacked(packed)
    over = lanes.state.done & lanes.inputs.alive
    if kernels.autoreset:
        lanes = _begun(kernels, pool, lanes, over)
    step_lane = functools.partial(_step_lane, kernels, pool.ways)
    state, observed, reward = jax.vmap(step_lane)(lanes, actions, over)
    late = state.done & (state.reason == TIMEOUT)
    after = lanes._replace(state=state, observed=observed)
    return _packed(after), _rows(kernels, after, jnp.stack([reward, state.done & ~late, late], axis=1))


def _step_lane(
    kernels: LaneKernels, ways: WayFields, lane: TrainingState, action: Float[Array, "actions"], over: Bool[Array, ""]
) -> tuple[LaneState, Observation, Float[Array, ""]]:
    """Returns one lane a control step later, and what the step was worth; one that was over does not move in it."""
    inputs, before = lane.inputs, lane.state
    control = control_of(kernels.actions, action)
    motion = kernels.mechanics.drive_delayed(inputs, before, control)
    decided = Decision(before.controller, control, lane.observed.ranges_m)
    moved, _ = finish_step(kernels.applications, inputs, before, decided, motion)
    state = _either(over, before, moved)
    after = observe(kernels.applications, inputs, state)
    goal = lane.observed.goal_index
    transition = Transition(
        before=lane.observed,
        after=after,
        control=control,
        truth=truth_after(inputs, motion, moved.step),
        verdict=Verdict(moved.goal_index, moved.done, moved.reason),
        way_before_m=way_left_m(ways, lane.episode, goal, before.body.qpos[:2]),
        way_after_m=way_left_m(ways, lane.episode, goal, moved.body.qpos[:2]),
    )
    worth = jnp.asarray(kernels.reward(transition), jnp.float32)
    return state, after, jnp.where(over, 0.0, worth)


def _begin(kernels: LaneKernels, inputs: LaneInputs) -> LaneState:
    return strong_types(kernels.mechanics.begin(kernels.applications, inputs))


def _begun(
    kernels: LaneKernels, pool: EpisodePool, lanes: TrainingState, marked: Bool[Array, "lanes"]
) -> TrainingState:
    """Returns lanes, the marked ones at the beginning of the next episode of their seed; what they sense is to come."""
    turn = jnp.where(marked, lanes.turn + 1, lanes.turn)
    episodes = pool.inputs.start.shape[0]
    drawn = jax.vmap(functools.partial(_draw, episodes))(lanes.seed, turn)
    episode = jnp.where(marked, drawn, lanes.episode)
    inputs = _copied(pool.inputs, lanes.inputs, marked, episode)
    state = _either(marked, jax.vmap(functools.partial(_begin, kernels))(inputs), lanes.state)
    return TrainingState(inputs, state, lanes.observed, lanes.seed, turn, episode)


def _draw(episodes: int, seed: UInt32[Array, "2"], turn: Int[Array, ""]) -> Int[Array, ""]:
    """Returns which episode of the pool is the turn-th of a seed; it depends on nothing else."""
    key = jax.random.wrap_key_data(seed, impl="threefry2x32")
    return jax.random.randint(jax.random.fold_in(key, turn), (), 0, episodes, jnp.int32)


def _copied(
    pool: LaneInputs, inputs: LaneInputs, marked: Bool[Array, "lanes"], episode: Int[Array, "lanes"]
) -> LaneInputs:
    """Returns the inputs with those of the marked lanes copied from the pool, one lane after the other.

    A handful of lanes ends in a step: what is copied is little, and the others are not touched.
    """
    order = jnp.nonzero(marked, size=marked.shape[0], fill_value=0)[0]

    def copy(place: Array, filled: LaneInputs) -> LaneInputs:
        lane = order[place]

        def put(into: Array, given: Array) -> Array:
            own = jax.lax.dynamic_index_in_dim(given, episode[lane], 0, keepdims=False)
            return jax.lax.dynamic_update_index_in_dim(into, own, lane, 0)

        return jax.tree.map(put, filled, pool)

    return jax.lax.fori_loop(0, jnp.count_nonzero(marked), copy, inputs)


def _seen(kernels: LaneKernels, observed: Observation) -> Float[Array, "lanes seen"]:
    """Returns what trainers see, one field's numbers after another's."""
    fields = jax.vmap(functools.partial(observed_fields, kernels.bounds))(observed)
    if not fields:
        return jnp.zeros((observed.time_s.shape[0], 0))
    return jnp.concatenate([fields[name].reshape(observed.time_s.shape[0], -1) for name in kernels.bounds], axis=1)


def _rows(kernels: LaneKernels, lanes: TrainingState, given: Float[Array, "lanes 3"]) -> Rows:
    """Returns what goes to the host: what a step gave, how the episodes stand, and what is seen."""
    state = lanes.state
    totals, pose = state.totals, state.body.qpos
    standing = Standing(
        state.reason, state.goal_index, state.step, totals.path_length_m, totals.collisions, pose, lanes.episode
    )
    columns = [jnp.asarray(each, jnp.float32).reshape(given.shape[0], -1) for each in standing]
    return jnp.concatenate([given, *columns, _seen(kernels, lanes.observed)], axis=1)


def _packed(lanes: TrainingState) -> PackedTraining:
    return jax.vmap(pack_lane)(lanes)


def _unpacked(packed: PackedTraining) -> TrainingState:
    return jax.vmap(unpack_lane)(packed)


def _either(choose: Bool[Array, "*lanes"], yes: LaneState, no: LaneState) -> LaneState:
    """Returns one of two states, lane by lane."""

    def pick(one: Array, other: Array) -> Array:
        shaped = choose.reshape(choose.shape + (1,) * (one.ndim - choose.ndim))
        return jnp.where(shaped, one, other.astype(one.dtype))

    return jax.tree.map(pick, yes, no)


TrainingEngine = Literal["auto", "planar", "mjx"]
# Engines whose step is compiled, fastest first: C MuJoCo steps lanes one by one on the host.
_MECHANICS: Mapping[str, Callable[[Path], Mechanics]] = {"planar": planar_mechanics, "mjx": mjx_mechanics}
_PROGRAMS_KEPT = 8


@dataclass(frozen=True)
class Task:
    """What is trained on; two tasks are the same if their bundles' digests, episodes and worlds are.

    Attributes:
        robot: Folder of the robot's bundle.
        scenario: Folder of the scenario's.
        requests: The pool's episodes, which share a program; their launches name the packages in the bundles.
        worlds: Of the episodes, with their names.
        sensors: An object with the robot's sensors as attributes; None for those that its application declares.
    """

    robot: Path
    scenario: Path
    requests: tuple[EpisodeRequest, ...]
    worlds: tuple[tuple[str, World], ...]
    sensors: object | None = None

    def __hash__(self) -> int:
        """Returns a hash of what tells tasks apart at once."""
        return hash((self.robot, self.scenario, len(self.requests), tuple(name for name, _ in self.worlds)))


class View(NamedTuple):
    """What a trainer sees, gives and is paid.

    Attributes:
        fields: Of the observation; None for what a reactive controller needs.
        normalized: Whether actions go from -1 to 1.
        reward: A function in JAX of one lane's step.
    """

    fields: tuple[str, ...] | None = None
    normalized: bool = True
    reward: Reward = progress


@dataclass(frozen=True, eq=False)
class TrainingProgram:
    """All that lanes share with those of another environment of the same task.

    Attributes:
        lanes: How many there are at least, so that they fill whole vectors on each device.
        colors: What the host draws of the robot's colour camera; None if nobody sees it.
    """

    pool: StagedPool
    sensors: Sensors
    actions: ActionMap
    bounds: Mapping[str, FieldBounds]
    compiled: VectorProgram
    lanes: int
    colors: ColorTask | None


def training_program(
    task: Task, view: View, count: int, *, autoreset: bool, engine: TrainingEngine = "auto"
) -> TrainingProgram:
    """Returns the program of a task; compiles nothing yet.

    Args:
        task: What is trained on.
        view: What a trainer sees, gives and is paid.
        count: How many lanes.
        autoreset: Whether a lane that is done begins its next episode in the step after.
        engine: One that is compiled; ``auto`` for the first that can represent the robot.

    Raises:
        BundleCrash: An application does not import, or its scenario finds no start and goals.
        RobotRefused: No engine that is compiled can represent the robot.
        DocumentError: The robot's observation has no such field, or it has nothing to drive it with.
    """
    return _program(task, view, padded_lanes(count, lane_mesh().size), autoreset, engine)


@functools.lru_cache(maxsize=_PROGRAMS_KEPT)
def _program(task: Task, view: View, lanes: int, autoreset: bool, engine: TrainingEngine) -> TrainingProgram:  # noqa: FBT001 - a part of a key
    """Returns a program; kept, so that environments of one task share a pool and a compilation."""
    robot = task.robot / ROBOT_FILE
    mechanics = _mechanics(robot, engine)
    applications, camera = _applications(task, mechanics.actuators)
    pool = stage_pool(applications, robot, mechanics.hull, task.requests, dict(task.worlds))
    joints = mechanics.first_body(jnp.zeros(3)).joints
    actions = action_map(robot, normalized=view.normalized)
    fields = default_fields(applications.sensors, camera) if view.fields is None else view.fields
    bounds = field_bounds(fields, applications.sensors, joints, pool.bounds, camera)
    sensed = {name: each for name, each in bounds.items() if name != COLOR}
    kernels = LaneKernels(mechanics, applications, actions, sensed, view.reward, autoreset)
    compiled = vector_program(kernels, lane_mesh())
    colors = ColorTask(camera, pool.requests, dict(task.worlds), robot) if camera and COLOR in bounds else None
    return TrainingProgram(pool, applications.sensors, actions, bounds, compiled, lanes, colors)


def _mechanics(robot: Path, engine: TrainingEngine) -> Mechanics:
    refusals: list[str] = []
    for name in _MECHANICS if engine == "auto" else (engine,):
        try:
            return _MECHANICS[name](robot)
        except RobotRefused as refused:
            refusals.append(str(refused))
    raise RobotRefused("\n".join(dict.fromkeys(refusals)))


def _applications(task: Task, actuators: int) -> tuple[Applications, ColorCameraDeclaration | None]:
    """Returns the applications, with a stand-in for the controller that has its sensors, and its colour camera."""
    first = task.requests[0]
    numbers, texts = split_environment(first.environment)
    make_scenario = load_factory(task.scenario, first.scenario, "scenario", "SimulationApplicationCrash")
    declare = (lambda _: task.sensors) if task.sensors is not None else _declaration(task.robot, first.robot)
    variables = {**texts, **{name: jnp.float32(value) for name, value in numbers.items()}}
    sensors, camera = read_sensors(declare, variables), read_color_camera(declare, variables)
    names = tuple(sorted(numbers))
    return with_stand_in(Applications(declare, make_scenario, texts, names, sensors), actuators, host=True), camera


def _declaration(folder: Path, launch: ApplicationLaunch) -> Callable[..., object]:
    """Returns what makes an object with a robot application's sensors, however it is driven."""
    bundle = HostBundle(folder, launch)
    kind = controller_kind(folder, launch)
    if kind in HOST_KINDS:
        return HOST_KINDS[kind](bundle).declare
    return load_controller(folder, launch, "controller")


# A reward and two flags, and how the episode stands, go before what is seen.
_GIVEN, _FIRST = 3, 12


class LaneStep(NamedTuple):
    """What a step gives, lanes first; arrays of the caller's own."""

    observation: dict[str, np.ndarray]
    reward: Float32[np.ndarray, "lanes"]
    terminated: Bool[np.ndarray, "lanes"]
    truncated: Bool[np.ndarray, "lanes"]


class EpisodeEnds(NamedTuple):
    """How episodes stand, lanes first; fields as in EpisodeResult."""

    reason: Int[np.ndarray, "lanes"]
    goals_reached: Int[np.ndarray, "lanes"]
    simulated_s: np.ndarray
    path_length_m: np.ndarray
    collisions: Int[np.ndarray, "lanes"]
    pose: np.ndarray


class TrainingLanes:
    """Lanes that a trainer steps.

    Attributes:
        program: What they share with others of the same task.
        count: How many there are.
    """

    def __init__(self, program: TrainingProgram, count: int) -> None:
        self.program, self.count = program, count
        mesh = program.compiled.mesh
        self._transfer = LaneTransfer(mesh)
        self._pool = jax.device_put(program.pool.arrays, NamedSharding(mesh, PartitionSpec()))
        self._lanes: PackedTraining = program.compiled.blank(self._pool, self._put(np.ones(count, bool)))
        self._first, self._seen = np.zeros((count, _FIRST), np.float32), np.zeros((count, 0), np.float32)
        self._colors = program.colors and LaneColors(program.colors, count)

    def reset(self, marked: Bool[np.ndarray, "lanes"], seeds: Sequence[int | None]) -> dict[str, np.ndarray]:
        """Begins the next episodes of some lanes, and returns all lanes' observations.

        Args:
            marked: Which lanes.
            seeds: A new seed for a lane, whose first episode it then begins; None for one that goes on.
        """
        fresh, words = np.zeros(self.count, bool), np.zeros((self.count, 2), np.uint32)
        for lane, seed in enumerate(seeds):
            if seed is not None and marked[lane]:
                fresh[lane], words[lane] = True, seed_words(int(seed))
        renewal = Renewal(self._put(marked), self._put(fresh), self._put(words))
        self._lanes, rows = self.program.compiled.renew(self._pool, self._lanes, renewal)
        self._keep(rows)
        return self._fields()

    def step(self, actions: Float32[np.ndarray, "lanes actions"]) -> LaneStep:
        """Drives all lanes a control step, and returns what it gives.

        Args:
            actions: Finite numbers.
        """
        self._lanes, rows = self.program.compiled.step(self._pool, self._lanes, self._put(actions))
        self._keep(rows)
        reward, terminated, truncated = self._first[:, :_GIVEN].T
        return LaneStep(self._fields(), reward.copy(), terminated > 0.0, truncated > 0.0)

    def ends(self) -> EpisodeEnds:
        """Returns how the lanes' episodes stand."""
        standing = self._standing()
        return EpisodeEnds(
            reason=standing.reason.astype(np.int32),
            goals_reached=standing.goal_index.astype(np.int32),
            simulated_s=np.round(standing.step.astype(np.int32) * CONTROL_S, 6),
            path_length_m=standing.path_length_m.copy(),
            collisions=standing.collisions.astype(np.int32),
            pose=standing.pose.copy(),
        )

    def episodes(self) -> Int[np.ndarray, "lanes"]:
        """Returns which episode of the pool each lane is in."""
        return self._standing().episode.astype(np.int32)

    def _put(self, array: np.ndarray) -> jax.Array:
        """Returns an array on the devices, with nothing for the lanes that only fill them."""
        whole = np.zeros((self.program.lanes, *array.shape[1:]), array.dtype)
        whole[: len(array)] = array
        return self._transfer.put(whole)

    def _keep(self, rows: jax.Array) -> None:
        # Copies: what an array on the host's own devices shows is used up by the next step.
        shares = self._transfer.fetch(rows)
        self._first = np.concatenate([share[:, :_FIRST] for share in shares])[: self.count]
        self._seen = np.concatenate([share[:, _FIRST:] for share in shares])[: self.count]

    def _standing(self) -> Standing:
        reason, goal, step, way_m, collisions, *pose, episode = self._first[:, _GIVEN:].T
        return Standing(reason, goal, step, way_m, collisions, np.stack(pose, axis=1), episode)

    def _fields(self) -> dict[str, np.ndarray]:
        fields: dict[str, np.ndarray] = {}
        begin = 0
        for name, bounds in self.program.bounds.items():
            if name == COLOR:
                fields[name] = self._pictures()
                continue
            end = begin + bounds.low.size
            fields[name] = self._seen[:, begin:end].reshape(self.count, *bounds.low.shape)
            begin = end
        return fields

    def _pictures(self) -> UInt8[np.ndarray, "lanes rows columns 3"]:
        assert self._colors is not None  # noqa: S101 - a program that has their bounds has them
        standing = self._standing()
        return self._colors.shown(standing.step.astype(np.int32), standing.pose, standing.episode.astype(np.int32))

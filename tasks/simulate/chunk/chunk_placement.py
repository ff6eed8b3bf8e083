"""Places a chunk's episodes: their program, their lanes, and which lanes have arrays of the same shapes.

What an application gets is of its own episode alone: its map, its goals, what its scenario gave. A compiled program has
one shape for each, so episodes of other shapes are a part of their own, run after one another
(docs/decisions/0019-arrays-of-ones-own.md).

Before lanes of such a form run, the applications are checked: once for each form and each set of numbers, on a machine.
To trace them takes a third of a second, and says the same each time.
"""

import functools
import math
import weakref
from collections.abc import Generator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from specs.data.episode import ApplicationLaunch, EpisodeRequest, EpisodeResult, Failure, failed_result
from specs.data.physics import varied_people
from specs.data.world import World
from tasks.simulate.application.bundle_code import BundleCrash, load_factory
from tasks.simulate.application.contract import Placement, Scenario
from tasks.simulate.application.mjcf_check import RobotRefused
from tasks.simulate.chunk.robot_starts import RobotsRefused, placed_robots, robots_inputs
from tasks.simulate.devices import device_kind
from tasks.simulate.engines.engine_table import ENGINES, ENGINES_OF_SEVERAL, choose_engine
from tasks.simulate.engines.program import Program, lane_mesh, padded_lanes
from tasks.simulate.engines.program_cache import applications_identity
from tasks.simulate.geometry.box_places import BoxesRefused, HostBoxes, host_boxes
from tasks.simulate.geometry.walks import HostPeople, PeopleRefused, walks_in
from tasks.simulate.geometry.world_arrays import WorldArrays, arrays_of_worlds
from tasks.simulate.host.controllers import HOST_KINDS, HostBundle
from tasks.simulate.host.declaration import ROBOT_FILE, controller_kind, load_controller
from tasks.simulate.host.ros_judge import until_judged
from tasks.simulate.lane.chunk_applications import Applications, check_robot, check_scenario
from tasks.simulate.lane.control_step import LaneInputs
from tasks.simulate.lane.staging import Lane, stack_lanes, with_shortest_paths
from tasks.simulate.plan.chunks import split_environment, without_job_variables
from tasks.simulate.sensors.depth_camera import seen_hull_m
from tasks.simulate.sensors.sensor_table import read_sensors

_PROGRAMS_KEPT = 8
_NUMBERS_KEPT = 1024
# A part that fits into a quarter of the lanes takes no more: halves would spare less time than their programs take to
# load, and idle lanes cost as much as others.
_NARROW = 4
Shape = tuple[object, ...]


class PlacedChunk(NamedTuple):
    """Episodes of one program that have a start and goals.

    Attributes:
        program: With as many lanes as the chunk has.
        parts: The episodes that can run, those together whose arrays have the same shapes.
        rows: Of the episodes that cannot.
        worlds: At least theirs.
    """

    program: Program
    parts: list[list[Lane]]
    rows: list[EpisodeResult]
    worlds: Mapping[str, World]


def place_chunk(
    requests: Sequence[EpisodeRequest],
    worlds: Mapping[str, World],
    bundles: Mapping[str, Path],
    *,
    lanes: int,
    engine: str = "auto",
) -> PlacedChunk:
    """Returns episodes of one program with their starts, their goals and the lengths of their shortest ways.

    Args:
        requests: Episodes that share a program, at least one.
        worlds: At least theirs.
        bundles: Unpacked folders of their applications, by digest.
        lanes: At least so many has the program.
        engine: ``auto``, or the engine that must run them.

    Raises:
        BundleCrash: The applications do not import, or the engine refuses the robot.
    """
    steps = placing(requests, worlds, bundles, lanes=lanes, engine=engine)
    while True:
        try:
            next(steps)
        except StopIteration as end:
            placed: PlacedChunk = end.value
            return placed._replace(parts=[with_shortest_paths(part) for part in placed.parts])


def placing(
    requests: Sequence[EpisodeRequest],
    worlds: Mapping[str, World],
    bundles: Mapping[str, Path],
    *,
    lanes: int,
    engine: str = "auto",
) -> Generator[None, None, PlacedChunk]:
    """Returns what ``place_chunk`` does but for the ways; yields after each piece of work, for others between."""
    program = program_of(requests[0], bundles, lanes, engine)
    if requests[0].robots and program.engine not in ENGINES_OF_SEVERAL:
        raise BundleCrash("SimulationApplicationCrash", f"robots: {requests[0].robots}: {program.engine} has one alone")
    used = {name: worlds[name] for name in dict.fromkeys(request.world for request in requests)}
    yield
    applications = program.applications
    world_arrays = arrays_of_worlds(used, program.hull, applications.lidar.height_m, scenes=applications.looks)
    yield
    robot = bundles[requests[0].robot.digest] / ROBOT_FILE
    placed, rows = yield from _place_all(program, robot, requests, used, world_arrays)
    return PlacedChunk(program, alike(placed), rows, used)


def part_program(
    placed: PlacedChunk, part: Sequence[Lane], bundles: Mapping[str, Path], *, lanes: int, engine: str
) -> Program:
    """Returns the program for a part of a chunk: the chunk's, or one of a quarter of the lanes if they are enough.

    How many lanes there are changes no row (docs/decisions/0004-lanes-a-multiple-of-eight.md).
    """
    if len(placed.parts) == 1 or len(part) > lanes // _NARROW:
        return placed.program
    return program_of(part[0].request, bundles, lanes // _NARROW, engine)


def alike(lanes: Sequence[Lane]) -> list[list[Lane]]:
    """Returns lanes in groups whose arrays have the same shapes, in the order of their first."""
    groups: dict[Shape, list[Lane]] = {}
    for lane in lanes:
        groups.setdefault(_shape(lane), []).append(lane)
    return list(groups.values())


_NOWHERE = Placement(np.zeros(3), np.zeros((1, 2)))


def _shape(lane: Lane) -> Shape:
    """Returns the shapes of all that an episode's applications get of it, and the types of what may have any.

    And whether its world has prisms: the others run in programs without them, and no bit hangs on what is beside them.
    """
    placement, arrays = lane.placement, lane.arrays
    prisms = [part.prisms for part in (arrays.contact_obstacles, arrays.lidar_outlines, arrays.scene) if part]
    given = tuple((array.shape, array.dtype.str) for array in placement.given)
    people = lane.people and tuple(array.shape for array in jax.tree.leaves(lane.people))
    floor = lane.arrays.floor.clearance_m.shape
    return (floor, placement.goals_m.shape, given, people, lane.boxes is None, *map(len, prisms))


def lane_forms(lane: Lane) -> tuple[object, ...]:
    """Returns the shapes of all arrays of a lane, and the types of what may have any."""
    own = lane.arrays
    others = (*(own.scene or ()), *(lane.people or ()), *(lane.boxes or ()))
    arrays = (*own.contact_obstacles, *own.lidar_outlines, *own.floor, *others, lane.placement.goals_m)
    given = tuple((array.shape, array.dtype.str) for array in lane.placement.given)
    return (*(array.shape for array in jax.tree.leaves(arrays) if hasattr(array, "shape")), given)


def program_of(request: EpisodeRequest, bundles: Mapping[str, Path], lanes: int, engine: str) -> Program:
    """Returns the program for episodes like one; kept, so that chunks share one.

    Raises:
        BundleCrash: The applications do not import, or the engine refuses the robot.
    """
    lanes = _whole_lanes(lanes, request.sharing)
    numbers, texts = split_environment(without_job_variables(request.environment))
    folders = (bundles[request.robot.digest], bundles[request.scenario.digest])
    environment = (tuple(sorted(numbers)), tuple(sorted(texts.items())))
    return _program((request.robot, request.scenario), folders, environment, lanes, engine)


def _whole_lanes(lanes: int, robots: int) -> int:
    """Returns lanes enough that robots which share a world are on one device, in whole vectors."""
    if robots == 1:
        return lanes
    devices = lane_mesh().size
    return padded_lanes(lanes, devices * robots // math.gcd(robots, padded_lanes(1, 1)))


@functools.lru_cache(maxsize=_PROGRAMS_KEPT)
def _program(
    launches: tuple[ApplicationLaunch, ApplicationLaunch],
    folders: tuple[Path, Path],
    environment: tuple[tuple[str, ...], tuple[tuple[str, str], ...]],
    lanes: int,
    engine: str,
) -> Program:
    """Returns the program of two applications; kept, so that a batch's chunks share one compilation.

    Raises:
        BundleCrash: An application does not import, or its robot is refused.
    """
    (robot, scenario), (names, texts) = launches, environment
    judge = HostBundle(folders[1], scenario) if scenario.starts_nodes else None
    bundle = HostBundle(folders[0], robot, judge)
    kind = controller_kind(folders[0], robot)
    if judge and controller_kind(folders[1], scenario) != kind:
        why = f"its nodes are not of that ROS which those of {robot.name} are of"
        raise BundleCrash("SimulationApplicationCrash", f"{scenario.name}: {why}")
    host = HOST_KINDS[kind](bundle) if kind in HOST_KINDS else None
    make_controller = host.declare if host else load_controller(folders[0], robot, "controller")
    load_scenario = functools.partial(load_factory, folders[1], scenario, "scenario", "SimulationApplicationCrash")
    make_scenario = until_judged if judge else load_scenario()
    sensors = read_sensors(make_controller, {**dict(texts), **dict.fromkeys(names, jnp.ones(()))})
    identity = applications_identity(launches, folders, names, dict(texts))
    applications = Applications(make_controller, make_scenario, dict(texts), names, sensors, identity)
    try:
        choice = choose_engine(engine, bundle.robot, kind, device_kind())
        return ENGINES[choice.engine].load(bundle.robot, applications, lanes, host)
    except RobotRefused as refused:
        raise BundleCrash("RobotApplicationCrash", f"{robot.name}: {refused}") from refused


def _place_all(
    program: Program,
    robot: Path,
    requests: Sequence[EpisodeRequest],
    worlds: Mapping[str, World],
    world_arrays: Mapping[str, WorldArrays],
) -> Generator[None, None, tuple[list[Lane], list[EpisodeResult]]]:
    """Returns the episodes that have a start and goals, and rows for those whose scenario failed to give them."""
    placed: list[Lane] = []
    rows: list[EpisodeResult] = []
    for together in worlds_shared(requests):
        world = together[0].world
        try:
            lanes = _placed_together(program, robot, together, worlds[world], world_arrays[world])
        except BundleCrash as crash:
            rows += [failed_result(request.index, crash.failure) for request in together]
        except (PeopleRefused, BoxesRefused, RobotsRefused) as narrow:
            failure = Failure("InvalidInput", str(narrow))
            rows += [failed_result(request.index, failure) for request in together]
        else:
            placed += lanes
        yield
    return placed, rows


def worlds_shared(requests: Sequence[EpisodeRequest]) -> list[list[EpisodeRequest]]:
    """Returns episodes, those together whose robots share a world.

    Raises:
        ValueError: One of those that share it is not there.
    """
    groups: dict[int, list[EpisodeRequest]] = {}
    for request in requests:
        groups.setdefault(request.index - request.number, []).append(request)
    for first, group in groups.items():
        if [request.number for request in group] != [*range(group[0].sharing)]:
            raise ValueError(f"episode {first}: not all of its {group[0].robots} robots, in their order")
    return list(groups.values())


def _placed_together(
    program: Program, robot: Path, requests: Sequence[EpisodeRequest], world: World, arrays: WorldArrays
) -> list[Lane]:
    """Returns the lanes of the robots that share a world; of most episodes, of the one that is alone in it.

    Raises:
        BundleCrash: The scenario raises, or what it gives cannot be.
        PeopleRefused: There is no room for people.
        BoxesRefused: There is none for a box on the robot's way.
        RobotsRefused: There is none for so many robots.
    """
    lanes: list[Lane] = []
    scenarios: list[Scenario] = []
    for request in requests:
        numbers, texts = split_environment(request.environment)
        environment = {**texts, **{name: _on_device(value.hex()) for name, value in numbers.items()}}
        sensors = program.applications.episode_sensors(environment)
        scenarios.append(program.applications.placing_scenario(environment))
        camera = sensors.depth_camera
        lane = Lane(request, arrays, _NOWHERE, lidar=sensors.lidar, camera=camera)
        lanes.append(lane)
    placements = placed_robots(scenarios, requests, world, arrays, program.hull)
    inputs = robots_inputs(placements, program.hull) if len(requests) > 1 else [None]
    people = _people(requests[0], world, placements, program)
    found = [
        lane._replace(
            placement=placement,
            people=people,
            hull_depth_m=seen_hull_m(lane.camera, robot),
            boxes=_boxes(lane, placement, program),
            robots=others,
        )
        for lane, placement, others in zip(lanes, placements, inputs, strict=True)
    ]
    if len({_shape(lane) for lane in found}) > 1:
        raise RobotsRefused(f"robots: {len(requests)}: their scenario gives them different numbers of goals or arrays")
    return found


def _people(
    request: EpisodeRequest, world: World, placements: Sequence[Placement], program: Program
) -> HostPeople | None:
    """Returns who walks about in an episode, or in the one that several robots share.

    Raises:
        PeopleRefused: The world has no room for them.
    """
    people = varied_people(request.people, request.environment)
    if people is None:
        return None
    starts_m = np.stack([placement.start[:2] for placement in placements])
    return walks_in(world).people(people, request.seed, starts_m, program.hull.radius_m)


def _boxes(lane: Lane, placement: Placement, program: Program) -> HostBoxes | None:
    """Returns what is put into the world of an episode.

    Raises:
        BoxesRefused: There is no room for a box on the robot's way.
    """
    asked = lane.request.boxes
    if asked is None:
        return None
    return host_boxes(asked, lane.request.seed, placement, lane.arrays.ways, program.hull)


@functools.lru_cache(maxsize=_NUMBERS_KEPT)
def _on_device(number: str) -> jax.Array:
    """Returns a number, as ``float.hex`` writes it; kept, since the episodes of a batch have few values."""
    return jnp.float32(float.fromhex(number))


_checked_forms: "weakref.WeakKeyDictionary[Applications, set[object]]" = weakref.WeakKeyDictionary()


def check_applications(program: Program, lane: Lane) -> None:
    """Traces a program's applications with what they get of a lane, unless they were with such a one.

    Raises:
        BundleCrash: They raise, or answer what they must not.
    """
    one: LaneInputs = jax.tree.map(
        lambda array: jnp.asarray(array[0]), stack_lanes([lane], program.applications.names, 1)
    )
    forms = tuple((array.shape, str(array.dtype)) for array in (one.floor.clearance_m, one.goals_m, *one.given))
    known, key = _checked_forms.setdefault(program.applications, set()), (forms, np.asarray(one.numbers).tobytes())
    if key in known:
        return
    shapes, numbers = (one.floor, one.goals_m, one.given), np.asarray(one.numbers).tolist()
    if not program.cache.passed("applications", shapes, numbers):
        joints = program.body().joints
        check_robot(program.applications, one.floor, one.goals_m, one.numbers, program.actuators, joints=joints)
        check_scenario(program.applications, one.goals_m, one.numbers, one.given)
        program.cache.note_passed("applications", shapes, numbers)
    known.add(key)

"""Stages episodes on the host: draws starts and goals, finds shortest ways, stacks everything lane by lane."""

import hashlib
import inspect
from collections import OrderedDict
from collections.abc import Sequence
from typing import Any, NamedTuple, cast

import jax
import numpy as np
from jaxtyping import Bool, Float32, Float64, Int
from scipy import ndimage

from specs.data.episode import CONTROL_S, EpisodeRequest
from specs.data.physics import VariedStart, control_delay_steps, physical_factors, varied_goals, varied_start
from specs.data.world import World
from tasks.simulate.application.bundle_code import BundleCrash, CrashCode, call_bundle
from tasks.simulate.application.contract import FloorMap, HostMap, Placement, Scenario
from tasks.simulate.application.robot_model import Hull
from tasks.simulate.geometry.box_places import HostBoxes
from tasks.simulate.geometry.depth_picture import DepthScene
from tasks.simulate.geometry.hull_distance import LaneObstacles
from tasks.simulate.geometry.lidar_scan import LidarOutlines
from tasks.simulate.geometry.shortest_path import Ways, shortest_paths_m
from tasks.simulate.geometry.walks import HostPeople
from tasks.simulate.geometry.world_arrays import WorldArrays
from tasks.simulate.lane.control_step import LaneInputs
from tasks.simulate.lane.lane_boxes import BoxesInputs
from tasks.simulate.lane.shared_world import RobotsInputs
from tasks.simulate.lane.walkers import PeopleInputs
from tasks.simulate.plan.chunks import split_environment
from tasks.simulate.sensors.depth_camera import DepthCamera
from tasks.simulate.sensors.lidar import NO_LIDAR, Lidar
from tasks.simulate.sensors.sensor import seed_words

_SCENARIO: CrashCode = "SimulationApplicationCrash"
# Episodes that differ in a swept value alone have the same task, and are chunks apart. A hundred bytes or two each.
_TASKS_KNOWN = 1 << 16
_known_m: OrderedDict[bytes, float] = OrderedDict()
# Which cells of a floor a hull gets to from which; with each floor, so that no other one has its number meanwhile.
_FLOORS_KNOWN = 64
_known_parts: OrderedDict[tuple[int, float], tuple[np.ndarray, np.ndarray, np.ndarray]] = OrderedDict()


class Lane(NamedTuple):
    """An episode that can run.

    Attributes:
        shortest_path_m: None where there is none, or where it was not measured yet.
        lidar, camera: The robot's in this episode.
        hull_depth_m: What the camera sees of its own robot; None for one that sees nothing of it.
        people: Who walks about; None for nobody.
        robots: Who else drives in its world; None for a robot that is alone.
        boxes: What is put into its world; None for nothing.
    """

    request: EpisodeRequest
    arrays: WorldArrays
    placement: Placement
    shortest_path_m: float | None = None
    lidar: Lidar = NO_LIDAR
    camera: DepthCamera | None = None
    hull_depth_m: Float32[np.ndarray, "*cameras rows columns"] | None = None
    people: HostPeople | None = None
    robots: RobotsInputs | None = None
    boxes: HostBoxes | None = None


def place(
    scenario: Scenario,
    request: EpisodeRequest,
    world: World,
    arrays: WorldArrays,
    hull: Hull,
    *,
    rng: np.random.Generator | None = None,
) -> Placement:
    """Returns where an episode starts and which goals it has, drawn by its seed; its variables may move them.

    Args:
        scenario: Draws them.
        request: The episode.
        world: Where.
        arrays: The same as arrays.
        hull: The robot's.
        rng: What draws instead of the episode's seed.

    Raises:
        BundleCrash: The scenario raises, or returns no finite start, or no goal, or no distance to arrive at; or the
            robot has no room to begin elsewhere; or variables move goals that the scenario draws by the seed alone.
    """
    rng, shares = rng or np.random.default_rng(request.own_seed), varied_goals(request.environment)
    draw: Any = scenario.place
    if shares and "shares" not in call_bundle(_SCENARIO, "scenario.place", inspect.signature, draw).parameters:
        raise BundleCrash(_SCENARIO, "goals: scenario.place has no argument shares: it draws goals by the seed alone")
    given = {"shares": shares} if shares else {}
    drawn = call_bundle(_SCENARIO, "scenario.place", draw, world, arrays.floor, hull.radius_m, rng, **given)
    placement, varied = checked_placement(scenario, drawn), varied_start(request.environment)
    if varied is None:
        return placement
    return placement._replace(start=_varied(placement.start, varied, arrays.floor, hull))


def _varied(
    start: Float64[np.ndarray, "3"], varied: VariedStart, floor: HostMap, hull: Hull
) -> Float64[np.ndarray, "3"]:
    """Returns a start with what an episode's variables say of it; one share without the other is of the middle.

    A share is that of cells in the order of their columns, and then of a column's in the order of its rows: so all of
    the floor is as likely where both are uniform, and a little more of a share is a little further.

    Raises:
        BundleCrash: There is no room to begin.
    """
    start = start.copy()
    if varied.yaw_rad is not None:
        start[2] = varied.yaw_rad
    if varied.x_share is None and varied.y_share is None:
        return start
    x_share, y_share = (0.5 if each is None else each for each in (varied.x_share, varied.y_share))
    cells = np.argwhere(reached_cells(floor, start, hull).T)
    if not len(cells):
        raise BundleCrash(_SCENARIO, "start: the world has no room for the robot to begin in")
    column = cells[_at(x_share, len(cells)), 0]
    own = cells[cells[:, 0] == column]
    start[:2] = floor.origin_m.astype(np.float64) + float(floor.cell_m) * own[_at(y_share, len(own))]
    return start


def _at(share: float, count: int) -> int:
    return min(int(share * count), count - 1)


# Beside the circle around a hull where it begins.
_ROOM_M = 0.05


def reached_cells(floor: HostMap, start: Float64[np.ndarray, "3"], hull: Hull) -> Bool[np.ndarray, "rows columns"]:
    """Returns in which cells of a floor a robot has room, of those it gets to from the one nearest to a start."""
    parts, cells = _parts(floor, hull)
    if not len(cells):
        return np.zeros(parts.shape, np.bool_)
    away = cells[:, ::-1] - (start[:2] - floor.origin_m) / floor.cell_m
    return parts == parts[tuple(cells[np.argmin((away**2).sum(1))])]


def _parts(floor: HostMap, hull: Hull) -> tuple[Int[np.ndarray, "rows columns"], Int[np.ndarray, "cells 2"]]:
    """Returns which part of a floor each cell is of, 0 for none, and the cells of all parts; of a world, once."""
    key = (id(floor.clearance_m), hull.radius_m)
    if key not in _known_parts:
        free = floor.clearance_m >= hull.radius_m + _ROOM_M
        parts, _ = cast("tuple[np.ndarray, int]", ndimage.label(free, structure=np.ones((3, 3))))
        _known_parts[key] = floor.clearance_m, parts, np.argwhere(free)
        while len(_known_parts) > _FLOORS_KNOWN:
            _known_parts.popitem(last=False)
    _known_parts.move_to_end(key)
    return _known_parts[key][1:]


def checked_placement(scenario: Scenario, drawn: Placement) -> Placement:
    """Returns what a scenario has drawn, as arrays.

    Raises:
        BundleCrash: It is no finite start, or no goal, or no distance to arrive at.
    """
    code = _SCENARIO
    start = call_bundle(code, "scenario.place", np.asarray, drawn.start, np.float64)
    goals = call_bundle(code, "scenario.place", np.asarray, drawn.goals_m, np.float64)
    given = call_bundle(code, "scenario.place", lambda: tuple(np.asarray(each) for each in getattr(drawn, "given", ())))
    if start.shape != (3,) or goals.ndim != 2 or goals.shape[1] != 2 or not len(goals):
        raise BundleCrash(code, f"scenario.place: start {start.shape} and goals {goals.shape}, not (3,) and (1+, 2)")
    if not (np.isfinite(start).all() and np.isfinite(goals).all()):
        raise BundleCrash(code, "scenario.place: start or goals are not finite")
    return Placement(start, goals, given, _arrived_m(scenario))


def _arrived_m(scenario: Scenario) -> float | None:
    arrived = getattr(scenario, "arrived_m", 0.0)
    if arrived is None:
        return None
    code = _SCENARIO
    arrived_m = call_bundle(code, "scenario.arrived_m", float, arrived)
    if not (np.isfinite(arrived_m) and arrived_m >= 0.0):
        raise BundleCrash(code, f"scenario.arrived_m: {arrived_m}: must be a distance of at least 0, or None")
    return arrived_m


def with_shortest_paths(lanes: Sequence[Lane]) -> list[Lane]:
    """Returns the episodes with the length of their shortest ways, None where there is none; equal tasks count once."""
    keys = [_task_key(lane.arrays.ways, lane.placement) for lane in lanes]
    new = {
        key: (lane.arrays.ways, lane.placement)
        for key, lane in zip(keys, lanes, strict=True)
        if lane.placement.arrived_m is not None and key not in _known_m
    }
    ways, placements = [each for each, _ in new.values()], [placement for _, placement in new.values()]
    found_m = shortest_paths_m(ways, placements, [placement.arrived_m or 0.0 for placement in placements])
    _known_m.update(zip(new, found_m.tolist(), strict=True))
    found = [lane._replace(shortest_path_m=_length(_known_m.get(key))) for lane, key in zip(lanes, keys, strict=True)]
    while len(_known_m) > _TASKS_KNOWN:
        _known_m.popitem(last=False)
    return found


def _length(found_m: float | None) -> float | None:
    """Returns a length; None for a way that there is not, or that nobody asked for."""
    return found_m if found_m is not None and np.isfinite(found_m) else None


def moved_lane(lane: Lane, beside_m: tuple[float, float]) -> Lane:
    """Returns a lane whose robot starts beside where the scenario puts it; all else stays.

    Args:
        lane: The episode.
        beside_m: How far (x, y). Less than single precision tells apart is taken for one unit in the last place.
    """
    start = np.array(lane.placement.start, np.float64)
    for axis, shift_m in enumerate(beside_m):
        before = np.float32(start[axis])
        if shift_m and np.float32(start[axis] + shift_m) == before:
            start[axis] = np.nextafter(before, np.float32(np.copysign(np.inf, shift_m)))
        else:
            start[axis] += shift_m
    return lane._replace(placement=lane.placement._replace(start=start))


def stack_lanes(lanes: Sequence[Lane], names: Sequence[str], count: int) -> LaneInputs:
    """Returns the inputs of ``count`` lanes, lanes first; those beyond the episodes repeat the first, and rest.

    They are NumPy's: what is computed on a device would be compiled, for each array.

    Args:
        lanes: The episodes, at least one and at most ``count``.
        names: The numeric environment variables, in the program's order.
        count: The program's lanes.
    """
    filled = [*lanes, *[lanes[0]] * (count - len(lanes))]
    floors = [lane.arrays.floor for lane in filled]
    most_goals = max(len(lane.placement.goals_m) for lane in filled)
    numbers = [[split_environment(lane.request.environment)[0][name] for name in names] for lane in filled]
    return LaneInputs(
        obstacles=LaneObstacles(
            *(_stacked(kind) for kind in zip(*(lane.arrays.contact_obstacles for lane in filled), strict=True))
        ),
        lidar_outlines=LidarOutlines(
            *(_canonical(each) for each in zip(*(lane.arrays.lidar_outlines for lane in filled), strict=True))
        ),
        floor=FloorMap(*(_stacked(field) for field in zip(*floors, strict=True))),
        start=_stacked([lane.placement.start for lane in filled]),
        goals_m=_stacked([filled_up(lane.placement.goals_m, most_goals) for lane in filled]),
        given=tuple(_canonical(arrays) for arrays in zip(*(lane.placement.given for lane in filled), strict=True)),
        seed=_canonical([seed_words(lane.request.own_seed) for lane in filled]),
        numbers=_stacked([np.asarray(each, np.float32) for each in numbers]),
        last_step=_canonical([np.int32(last_step(lane.request)) for lane in filled]),
        alive=_canonical([np.bool_(place < len(lanes)) for place in range(count)]),
        scene=_stacked_scenes([lane.arrays.scene for lane in filled]),
        hull_depth_m=_stacked_hulls([lane.hull_depth_m for lane in filled]),
        people=_stacked_people([lane.people for lane in filled]),
        robots=_stacked_robots([lane.robots for lane in filled]),
        boxes=_stacked_boxes([lane.boxes for lane in filled]),
        physics=_stacked_physics([physical_factors(lane.request.environment) for lane in filled]),
        delay_steps=_stacked_delays([control_delay_steps(lane.request.environment) for lane in filled]),
    )


def _stacked_physics(factors: Sequence[tuple[float, float, float] | None]) -> Any:  # noqa: ANN401 - as _stacked
    some = [np.asarray(each) for each in factors if each is not None]
    return _stacked(some) if some else None


def _stacked_delays(steps: Sequence[int | None]) -> Any:  # noqa: ANN401 - as _stacked
    some = [np.int32(each) for each in steps if each is not None]
    return _canonical(some) if some else None


def _stacked_hulls(pictures: Sequence[Float32[np.ndarray, "*cameras rows columns"] | None]) -> Any:  # noqa: ANN401 - as _stacked
    some = [picture for picture in pictures if picture is not None]
    return _stacked(some) if some else None


def _stacked_scenes(scenes: Sequence[DepthScene | None]) -> DepthScene | None:
    some = [scene for scene in scenes if scene is not None]
    return DepthScene(*map(_stacked, zip(*some, strict=True))) if some else None


def _stacked_people(people: Sequence[HostPeople | None]) -> PeopleInputs | None:
    some = [each for each in people if each is not None]
    return PeopleInputs(*jax.tree.map(lambda *each: _canonical(each), *some)) if some else None


def _stacked_robots(robots: Sequence[RobotsInputs | None]) -> RobotsInputs | None:
    some = [each for each in robots if each is not None]
    return RobotsInputs(*map(_stacked, zip(*some, strict=True))) if some else None


def _stacked_boxes(boxes: Sequence[HostBoxes | None]) -> BoxesInputs | None:
    some = [each for each in boxes if each is not None]
    return BoxesInputs(*map(_canonical, zip(*some, strict=True))) if some else None


def last_step(request: EpisodeRequest) -> int:
    """Returns how many control steps fit an episode's duration; at least 1."""
    return max(1, round(request.duration_s / CONTROL_S))


def _stacked(arrays: Sequence[np.ndarray]) -> Any:  # noqa: ANN401 - NumPy's, which JAX takes for its own
    return np.stack(arrays).astype(np.float32)


def _canonical(arrays: Sequence[np.ndarray | np.generic]) -> Any:  # noqa: ANN401 - likewise
    """Returns arrays as one, of the type that JAX has for theirs."""
    stacked = np.stack(arrays)
    return stacked.astype(jax.dtypes.canonicalize_dtype(stacked.dtype))


def filled_up(goals_m: Float64[np.ndarray, "goals 2"], count: int) -> Float64[np.ndarray, "count 2"]:
    """Returns the goals, the last one repeated until there are as many as in the lane that has most.

    In a batch all lanes that run together have as many; in a pool for training they may not.
    """
    return np.concatenate([goals_m, np.repeat(goals_m[-1:], count - len(goals_m), axis=0)])


def _task_key(ways: Ways, placement: Placement) -> bytes:
    digest = hashlib.sha256(f"{ways.number} ".encode())
    digest.update(placement.start.tobytes() + placement.goals_m.tobytes() + repr(placement.arrived_m).encode())
    return digest.digest()

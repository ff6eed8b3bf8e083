"""The pool of episodes that lanes draw from: staged on the host once, so that a reset is a copy on the device.

An episode of the pool is one of a batch: a world and a seed, which draws its start, its goals and its sensors' noise.

A reward for progress is made of the way that is left to a goal, from everywhere on a world's map. Lengths are those of
ways over the map's cells, straight and diagonal (E. W. Dijkstra, A Note on Two Problems in Connexion with Graphs,
1959): up to 8 % longer than the shortest way. Cells that a hull cannot stand in have the way from the nearest one that
it can, and how far that is.
"""

import logging
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple, cast

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int, UInt16
from scipy import ndimage, sparse
from scipy.sparse import csgraph

from specs.data.episode import EpisodeRequest
from specs.data.world import World
from tasks.simulate.application.bundle_code import BundleCrash
from tasks.simulate.application.contract import HostMap
from tasks.simulate.application.robot_model import Hull
from tasks.simulate.geometry.depth_picture import pad_scenes
from tasks.simulate.geometry.lidar_scan import pad_lidar_outlines
from tasks.simulate.geometry.obstacles import pad_obstacles
from tasks.simulate.geometry.world_arrays import WorldArrays, arrays_of_worlds
from tasks.simulate.lane.chunk_applications import Applications
from tasks.simulate.lane.control_step import LaneInputs
from tasks.simulate.lane.staging import Lane, place, stack_lanes
from tasks.simulate.plan.chunks import split_environment
from tasks.simulate.sensors.depth_camera import seen_hull_m
from tasks.simulate.training.training_spaces import EpisodeBounds

# A robot may stand where a cell's centre has this much less than its radius: cells are 0.1 m wide.
_SLACK_M = 0.05
_MM_PER_M = 1000.0
# 65.5 m, kept in whole millimetres: half the memory of floats, and finer than any control step.
_MOST_MM = 2**16 - 1
# To the right, up, and both diagonals; the way back is the same.
_STEPS = ((0, 1), (1, 0), (1, 1), (1, -1))
Nearest = tuple[Float[np.ndarray, "rows columns"], Int[np.ndarray, "2 rows columns"]]


class WayFields(NamedTuple):
    """The way left in each cell, for the goals of each episode of a pool.

    Attributes:
        left_mm: In millimetres; behind a grid's last row and column there is nothing that is looked at.
        origin_m, cell_m: The grids, as the maps'.
        cells: How many a side of each grid.
    """

    left_mm: UInt16[jax.Array, "episodes goals rows columns"]
    origin_m: Float[jax.Array, "episodes 2"]
    cell_m: Float[jax.Array, "episodes"]
    cells: Int[jax.Array, "episodes"]


def ways_left_mm(
    floor: HostMap, goals_m: Sequence[Float[np.ndarray, "2"]], radius_m: float
) -> UInt16[np.ndarray, "goals rows columns"]:
    """Returns the way that is left to each goal, in each cell of a map.

    Args:
        floor: The map.
        goals_m: Places (x, y).
        radius_m: Of the robot's hull.
    """
    free = floor.clearance_m >= max(radius_m - _SLACK_M, 1e-6)
    if not free.any():
        return np.full((len(goals_m), *free.shape), _MOST_MM, np.uint16)
    graph, node = _graph(free, float(floor.cell_m))
    starts = [_nearest_node(floor, free, node, goal_m) for goal_m in goals_m]
    found = np.atleast_2d(csgraph.dijkstra(graph, directed=False, indices=starts))
    return np.stack([_filled(free, lengths_m, float(floor.cell_m)) for lengths_m in found])


def way_left_m(
    ways: WayFields, episode: Int[jax.Array, ""], goal: Int[jax.Array, ""], place_m: Float[jax.Array, "2"]
) -> Float[jax.Array, ""]:
    """Returns the way that is left from a place, between the four cells around it.

    Args:
        ways: Of the pool.
        episode: Which of its episodes.
        goal: Which of its goals.
        place_m: The place (x, y).
    """
    at = (place_m - ways.origin_m[episode]) / ways.cell_m[episode]
    low = jnp.clip(jnp.floor(at), 0.0, ways.cells[episode] - 2.0)
    share = jnp.clip(at - low, 0.0, 1.0)
    column, row = low.astype(jnp.int32)

    def left(up: int, right: int) -> Float[jax.Array, ""]:
        return ways.left_mm[episode, goal, row + up, column + right].astype(jnp.float32) / _MM_PER_M

    below = left(0, 0) + share[0] * (left(0, 1) - left(0, 0))
    above = left(1, 0) + share[0] * (left(1, 1) - left(1, 0))
    return below + share[1] * (above - below)


def _graph(free: Bool[np.ndarray, "rows columns"], cell_m: float) -> tuple[sparse.csr_array, np.ndarray]:
    """Returns the graph of free cells, and the number of each cell's node."""
    node = np.full(free.shape, -1)
    node[free] = np.arange(np.count_nonzero(free))
    ends: list[np.ndarray] = []
    for up, right in _STEPS:
        rows, columns = free.shape
        one = node[: rows - up, max(0, -right) : columns - max(0, right)]
        other = node[up:, max(0, right) : columns - max(0, -right)]
        both = (one >= 0) & (other >= 0)
        length_m = cell_m * np.hypot(up, right)
        ends.append(np.stack([one[both], other[both], np.full(np.count_nonzero(both), length_m)]))
    one, other, length_m = np.concatenate(ends, axis=1)
    count = int(node.max()) + 1
    places = (one.astype(np.int32), other.astype(np.int32))
    return sparse.csr_array((length_m, places), shape=(count, count)), node


def _nearest_node(
    floor: HostMap, free: Bool[np.ndarray, "rows columns"], node: np.ndarray, goal_m: Float[np.ndarray, "2"]
) -> int:
    rows, columns = np.nonzero(free)
    column, row = (goal_m - floor.origin_m) / floor.cell_m
    nearest = int(np.argmin((rows - row) ** 2 + (columns - column) ** 2))
    return int(node[rows[nearest], columns[nearest]])


def _filled(
    free: Bool[np.ndarray, "rows columns"], lengths_m: Float[np.ndarray, "nodes"], cell_m: float
) -> UInt16[np.ndarray, "rows columns"]:
    """Returns the lengths on the grid; cells from which no way leads have that of the nearest one, and to there."""
    left_m = np.full(free.shape, np.inf)
    left_m[free] = lengths_m
    reached = np.isfinite(left_m)
    away, nearest = cast("Nearest", ndimage.distance_transform_edt(~reached, return_indices=True))
    whole_m = left_m[nearest[0], nearest[1]] + cell_m * away
    return np.minimum(np.rint(whole_m * _MM_PER_M), _MOST_MM).astype(np.uint16)


log = logging.getLogger(__name__)
# Beyond a world's faces: a robot that leaves it is stopped before it gets that far.
_MARGIN_M = 1.0


class EpisodePool(NamedTuple):
    """Episodes as arrays, episodes first; a pytree, so that it is handed to a compiled step.

    Attributes:
        inputs: As lanes have them, with a map of one cell: nothing that is compiled for training looks at it.
        ways: The way left to each goal.
    """

    inputs: LaneInputs
    ways: WayFields


class StagedPool(NamedTuple):
    """A pool, and what the host knows of it.

    Attributes:
        arrays: The pool.
        requests: The episodes, in the pool's order.
        goals: How many goals each has.
        bounds: Of what is observed in them.
    """

    arrays: EpisodePool
    requests: tuple[EpisodeRequest, ...]
    goals: tuple[int, ...]
    bounds: EpisodeBounds


def stage_pool(
    applications: Applications, robot: Path, hull: Hull, requests: Sequence[EpisodeRequest], worlds: Mapping[str, World]
) -> StagedPool:
    """Returns a pool of episodes.

    Args:
        applications: Robot and scenario.
        robot: The ``robot.xml``.
        hull: The robot's.
        requests: The episodes, at least one; those whose scenario finds no start or goals are left out.
        worlds: At least theirs.

    Raises:
        BundleCrash: The scenario finds a start and goals for none of them, or gives arrays of other shapes in some.
    """
    used = {name: worlds[name] for name in dict.fromkeys(request.world for request in requests)}
    world_arrays = arrays_of_worlds(used, hull, applications.lidar.height_m, scenes=applications.looks)
    lanes = _placed(applications, hull, requests, used, world_arrays, robot=robot)
    _require_same_given(lanes)
    ways = _ways(lanes, hull)
    small = _of_one_form([lane.arrays for lane in lanes])
    small = [lane._replace(arrays=arrays) for lane, arrays in zip(lanes, small, strict=True)]
    inputs = jax.tree.map(jnp.asarray, stack_lanes(small, applications.names, len(small)))
    goals = tuple(len(lane.placement.goals_m) for lane in lanes)
    bounds = EpisodeBounds(max(lane.request.duration_s for lane in lanes), max(goals), _reach_m(lanes))
    return StagedPool(EpisodePool(inputs, ways), tuple(lane.request for lane in lanes), goals, bounds)


def _placed(
    applications: Applications,
    hull: Hull,
    requests: Sequence[EpisodeRequest],
    worlds: Mapping[str, World],
    world_arrays: Mapping[str, WorldArrays],
    *,
    robot: Path,
) -> list[Lane]:
    lanes: list[Lane] = []
    crashes: list[BundleCrash] = []
    for request in requests:
        numbers, texts = split_environment(request.environment)
        environment = {**texts, **{name: jnp.float32(each) for name, each in numbers.items()}}
        scenario = applications.placing_scenario(environment)
        camera = applications.sensors.depth_camera
        if camera and any(each.sees_robot for each in camera.every):
            camera = applications.episode_sensors(environment).depth_camera
        try:
            placement = place(scenario, request, worlds[request.world], world_arrays[request.world], hull)
        except BundleCrash as crash:
            crashes.append(crash)
        else:
            seen_m = seen_hull_m(camera, robot)
            lanes.append(Lane(request, world_arrays[request.world], placement, hull_depth_m=seen_m))
    if not lanes:
        raise crashes[0]
    if crashes:
        log.warning("%d of %d episodes are left out, the first: %s", len(crashes), len(requests), crashes[0])
    return lanes


def _of_one_form(worlds_arrays: Sequence[WorldArrays]) -> list[WorldArrays]:
    """Returns arrays with maps of one cell, and places for prisms in all worlds if some have them."""
    contacts = pad_obstacles(arrays.contact_obstacles for arrays in worlds_arrays)
    outlines = pad_lidar_outlines(arrays.lidar_outlines for arrays in worlds_arrays)
    given = [arrays.scene for arrays in worlds_arrays if arrays.scene is not None]
    scenes = pad_scenes(given) or [None] * len(worlds_arrays)
    return [
        arrays._replace(floor=_one_cell(arrays.floor), contact_obstacles=one, lidar_outlines=other, scene=scene)
        for arrays, one, other, scene in zip(worlds_arrays, contacts, outlines, scenes, strict=True)
    ]


def _require_same_given(lanes: Sequence[Lane]) -> None:
    """Refuses what a batch runs one after the other: here one program has all episodes in its lanes."""
    first, *others = ([(each.shape, each.dtype.name) for each in lane.placement.given] for lane in lanes)
    other = next((each for each in others if each != first), None)
    if other is not None:
        raise BundleCrash(
            "SimulationApplicationCrash",
            f"scenario.place: given of {first} and of {other}: to train, give arrays of the same shapes in all worlds",
        )


def _ways(lanes: Sequence[Lane], hull: Hull) -> WayFields:
    """Returns the ways of all episodes; those in one world are found together."""
    most = max(len(lane.placement.goals_m) for lane in lanes)
    cells = [len(lane.arrays.floor.clearance_m) for lane in lanes]
    left = np.zeros((len(lanes), most, max(cells), max(cells)), np.uint16)
    for world in dict.fromkeys(lane.request.world for lane in lanes):
        own = [(number, lane) for number, lane in enumerate(lanes) if lane.request.world == world]
        goals = [(number, goal) for number, lane in own for goal in range(len(lane.placement.goals_m))]
        places = [lanes[number].placement.goals_m[goal] for number, goal in goals]
        for (number, goal), found in zip(
            goals, ways_left_mm(own[0][1].arrays.floor, places, hull.radius_m), strict=True
        ):
            left[number, goal:, : cells[number], : cells[number]] = found  # a goal that only fills up is the last again
    floors = [lane.arrays.floor for lane in lanes]
    return WayFields(
        jnp.asarray(left),
        jnp.asarray(np.stack([floor.origin_m for floor in floors])),
        jnp.asarray(np.stack([floor.cell_m for floor in floors])),
        jnp.asarray(cells, jnp.int32),
    )


def _one_cell(floor: HostMap) -> HostMap:
    return floor._replace(clearance_m=np.zeros((1, 1), np.float32))


def _reach_m(lanes: Sequence[Lane]) -> float:
    bounds = max(float(np.abs(lane.arrays.floor.bounds_m).max()) for lane in lanes)
    goals = max(float(np.abs(lane.placement.goals_m).max()) for lane in lanes)
    return float(np.ceil(max(bounds, goals) + _MARGIN_M))

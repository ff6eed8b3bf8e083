"""The pool of episodes that lanes draw from: staged on the host once, so that a reset is a copy on the device.

An episode of the pool is one of a batch: a world and a seed, which draws its start, its goals and its sensors' noise.
"""

import logging
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from specs.data.episode import EpisodeRequest
from specs.data.world import World
from tasks.simulate.application.code import BundleCrash
from tasks.simulate.application.contract import HostMap
from tasks.simulate.application.robot_mjcf import Hull
from tasks.simulate.lane.calls import Applications
from tasks.simulate.lane.lane_state import LaneInputs
from tasks.simulate.lane.staging import Lane, place, stack_lanes
from tasks.simulate.plan.chunks import split_environment
from tasks.simulate.surroundings.stages import Stage, stage_worlds
from tasks.simulate.training.observation import EpisodeBounds
from tasks.simulate.training.way_field import WayFields, ways_left_mm

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
    applications: Applications, hull: Hull, requests: Sequence[EpisodeRequest], worlds: Mapping[str, World]
) -> StagedPool:
    """Returns a pool of episodes.

    Args:
        applications: Robot and scenario.
        hull: The robot's.
        requests: The episodes, at least one; those whose scenario finds no start or goals are left out.
        worlds: At least theirs.

    Raises:
        BundleCrash: The scenario finds a start and goals for none of them, or gives arrays of other shapes in some.
    """
    used = {name: worlds[name] for name in dict.fromkeys(request.world for request in requests)}
    stages = stage_worlds(used, hull, applications.lidar.height_m)
    lanes = _placed(applications, hull, requests, used, stages)
    _require_same_given(lanes)
    ways = _ways(lanes, hull)
    small = [lane._replace(stage=lane.stage._replace(floor=_one_cell(lane.stage.floor))) for lane in lanes]
    inputs = jax.tree.map(jnp.asarray, stack_lanes(small, applications.names, len(small)))
    goals = tuple(len(lane.placement.goals_m) for lane in lanes)
    bounds = EpisodeBounds(max(lane.request.duration_s for lane in lanes), max(goals), _reach_m(lanes))
    return StagedPool(EpisodePool(inputs, ways), tuple(lane.request for lane in lanes), goals, bounds)


def _placed(
    applications: Applications,
    hull: Hull,
    requests: Sequence[EpisodeRequest],
    worlds: Mapping[str, World],
    stages: Mapping[str, Stage],
) -> list[Lane]:
    lanes: list[Lane] = []
    crashes: list[BundleCrash] = []
    for request in requests:
        numbers, texts = split_environment(request.environment)
        scenario = applications.placing_scenario(
            {**texts, **{name: jnp.float32(each) for name, each in numbers.items()}}
        )
        try:
            placement = place(scenario, request, worlds[request.world], stages[request.world], hull)
        except BundleCrash as crash:
            crashes.append(crash)
        else:
            lanes.append(Lane(request, stages[request.world], placement, None))
    if not lanes:
        raise crashes[0]
    if crashes:
        log.warning("%d of %d episodes are left out, the first: %s", len(crashes), len(requests), crashes[0])
    return lanes


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
    cells = [len(lane.stage.floor.clearance_m) for lane in lanes]
    left = np.zeros((len(lanes), most, max(cells), max(cells)), np.uint16)
    for world in dict.fromkeys(lane.request.world for lane in lanes):
        own = [(number, lane) for number, lane in enumerate(lanes) if lane.request.world == world]
        goals = [(number, goal) for number, lane in own for goal in range(len(lane.placement.goals_m))]
        places = [lanes[number].placement.goals_m[goal] for number, goal in goals]
        for (number, goal), found in zip(
            goals, ways_left_mm(own[0][1].stage.floor, places, hull.radius_m), strict=True
        ):
            left[number, goal:, : cells[number], : cells[number]] = found  # a goal that only fills up is the last again
    floors = [lane.stage.floor for lane in lanes]
    return WayFields(
        jnp.asarray(left),
        jnp.asarray(np.stack([floor.origin_m for floor in floors])),
        jnp.asarray(np.stack([floor.cell_m for floor in floors])),
        jnp.asarray(cells, jnp.int32),
    )


def _one_cell(floor: HostMap) -> HostMap:
    return floor._replace(clearance_m=np.zeros((1, 1), np.float32))


def _reach_m(lanes: Sequence[Lane]) -> float:
    bounds = max(float(np.abs(lane.stage.floor.bounds_m).max()) for lane in lanes)
    goals = max(float(np.abs(lane.placement.goals_m).max()) for lane in lanes)
    return float(np.ceil(max(bounds, goals) + _MARGIN_M))


def pool_bytes(pool: EpisodePool) -> int:
    """Returns how much memory a pool takes on each device."""
    return sum(leaf.nbytes for leaf in jax.tree.leaves(pool))

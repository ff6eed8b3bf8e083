"""Where the robots of a world begin that share it: each where its scenario puts it, if that is apart from the others.

A scenario may say it of all of them (``place_robots``). One that does not is shown a world that begins somewhere else
for each robot that would begin in another one; who draws its start by itself begins there all the same. Goals are drawn
again while the last one is where another robot is to stand at last: some scenarios have no other.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float64

from specs.data.episode import EpisodeRequest
from specs.data.physics import OF_GOALS, OF_START, varied_goals, varied_start
from specs.data.world import Start, World
from tasks.simulate.application.bundle_code import BundleCrash, call_bundle
from tasks.simulate.application.contract import HostMap, Placement, Scenario
from tasks.simulate.application.robot_model import Hull
from tasks.simulate.geometry.world_arrays import WorldArrays
from tasks.simulate.lane.shared_world import RobotsInputs
from tasks.simulate.lane.staging import checked_placement, place, reached_cells

# Between the circles around two hulls where they begin, and where they are to stand at last.
APART_M = 0.3
ATTEMPTS = 16
_STREAM = 0x726F626F7473


class RobotsRefused(ValueError):  # noqa: N818 - an episode
    """A world cannot have the robots that are asked for."""


def placed_robots(
    scenarios: Sequence[Scenario], requests: Sequence[EpisodeRequest], world: World, arrays: WorldArrays, hull: Hull
) -> list[Placement]:
    """Returns where the robots of a world begin, and their goals; most worlds have one.

    Args:
        scenarios: Each robot's.
        requests: Of each, in the order of their numbers.
        world: Theirs.
        arrays: The same as arrays.
        hull: Of each.

    Raises:
        BundleCrash: A scenario raises, or returns what cannot be.
        RobotsRefused: There is no room for so many, or variables would give all of them the same goals.
    """
    if len(requests) > 1 and varied_goals(requests[0].environment):
        raise RobotsRefused(
            f"robots: {len(requests)}: nothing of {', '.join(OF_GOALS)}: each robot has goals of its own"
        )
    if len(requests) > 1 and (found := _given(scenarios[0], requests, world, arrays, hull)) is not None:
        return found
    found = list[Placement]()
    for scenario, request in zip(scenarios, requests, strict=True):
        found.append(_drawn(scenario, request, found, world, arrays, hull))
    return found


def _drawn(  # noqa: PLR0917 - as of ``place``, and who is there already
    scenario: Scenario,
    request: EpisodeRequest,
    others: Sequence[Placement],
    world: World,
    arrays: WorldArrays,
    hull: Hull,
) -> Placement:
    """Returns where the next robot begins, and its goals.

    Raises:
        BundleCrash: Its scenario raises, or returns what cannot be.
        RobotsRefused: There is no room for it.
    """
    seed, starts = request.own_seed, [other.start for other in others]
    rng = np.random.default_rng(seed)
    draws = np.random.Generator(np.random.Philox(key=[seed % (1 << 64), _STREAM]))

    def draw() -> Placement:
        own = place(scenario, request, world, arrays, hull, rng=rng)
        if _apart(own.start, starts, hull):
            return own
        begins = _start_beside(arrays.floor, starts, hull, draws)
        if begins is None:
            room = f"{world.name} has room for {len(others)} of them to begin in"
            raise RobotsRefused(f"robots: {request.robots}: {room}")
        own = place(scenario, request, world.model_copy(update={"start": begins}), arrays, hull, rng=rng)
        if _apart(own.start, starts, hull):
            return own
        return own._replace(start=np.array([begins.x_m, begins.y_m, begins.yaw_rad]))

    own = draw()
    for _ in range(ATTEMPTS - 1):
        if own.arrived_m is None or _apart(own.goals_m[-1], [other.goals_m[-1] for other in others], hull):
            break
        own = draw()
    return own


def _given(
    scenario: Scenario, requests: Sequence[EpisodeRequest], world: World, arrays: WorldArrays, hull: Hull
) -> list[Placement] | None:
    """Returns where a scenario puts all robots of a world; None if it speaks of one alone.

    Raises:
        BundleCrash: It raises, or does not give one for each.
        RobotsRefused: Some begin in one another, or variables say that they begin elsewhere.
    """
    place_robots = getattr(scenario, "place_robots", None)
    if place_robots is None:
        return None
    if varied_start(requests[0].environment) is not None:
        elsewhere = f"nothing of {', '.join(OF_START)}; scenario.place_robots says where all of them begin"
        raise RobotsRefused(f"robots: {len(requests)}: {elsewhere}")
    name, code, rng = "scenario.place_robots", "SimulationApplicationCrash", np.random.default_rng(requests[0].seed)
    drawn = call_bundle(code, name, place_robots, world, arrays.floor, hull.radius_m, rng, len(requests))
    found = [checked_placement(scenario, each) for each in call_bundle(code, name, list, drawn)]
    if len(found) != len(requests):
        raise BundleCrash(code, f"{name}: returned {len(found)} placements, not {len(requests)}")
    for number, own in enumerate(found):
        if any(np.hypot(*(own.start[:2] - other.start[:2])) < 2 * hull.radius_m for other in found[:number]):
            raise RobotsRefused(f"robots: {len(requests)}: scenario.place_robots: number {number} begins in another")
    return found


def _apart(own: Float64[np.ndarray, "..."], others: Sequence[Float64[np.ndarray, "..."]], hull: Hull) -> bool:
    """Returns whether a place, or a pose, is apart from others."""
    least_m = 2 * hull.radius_m + APART_M
    return all(np.hypot(*(own[:2] - other[:2])) >= least_m for other in others)


def _start_beside(
    floor: HostMap, starts: Sequence[Float64[np.ndarray, "3"]], hull: Hull, draws: np.random.Generator
) -> Start | None:
    """Returns a place that the first robot gets to, apart from where others begin; None if there is none."""
    rows, columns = np.nonzero(reached_cells(floor, starts[0], hull))
    points = floor.origin_m.astype(np.float64) + float(floor.cell_m) * np.stack([columns, rows], axis=1)
    free = points[_all_apart(points, starts, 2 * hull.radius_m + APART_M)]
    if not len(free):
        return None
    x_m, y_m = free[int(draws.integers(len(free)))].tolist()
    return Start(x_m=x_m, y_m=y_m, yaw_rad=float(draws.uniform(-np.pi, np.pi)))


def _all_apart(
    points: Float64[np.ndarray, "points 2"], starts: Sequence[Float64[np.ndarray, "3"]], least_m: float
) -> np.ndarray:
    return np.all([np.hypot(*(points - start[:2]).T) >= least_m for start in starts], axis=0)


def robots_inputs(placements: Sequence[Placement], hull: Hull) -> list[RobotsInputs]:
    """Returns of each robot what it is told of the others."""
    starts = np.stack([each.start[:2] for each in placements]).astype(np.float32)
    others = len(placements) - 1
    low_m, high_m, radius_m = (np.full(others, each, np.float32) for each in (hull.low_m, hull.high_m, hull.radius_m))
    return [
        RobotsInputs(np.delete(starts, number, axis=0), radius_m, low_m, high_m, np.float32(hull.radius_m))
        for number in range(len(placements))
    ]

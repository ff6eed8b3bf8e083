"""Shortest way on the floor for a disc: the length that a driven path is compared with."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float32, Float64

from tasks.simulate.contract import HostMap, Placement
from tasks.simulate.floor_map import cell_of

_DIAGONAL = float(np.sqrt(2.0))
# The grid rounds positions by up to half a cell's diagonal: a centre that touches nothing may lie in such a cell.
_SLACK_CELLS = 0.71
# However coarse the grid, a cell whose centre lies in a solid is closed.
_INSIDE_M = 1e-6


def shortest_paths_m(
    floors: Sequence[HostMap], placements: Sequence[Placement], hull_radius_m: float
) -> Float64[np.ndarray, "lanes"]:
    """Returns each lane's shortest length from its start through its goals in order; infinite where there is no way.

    Distances are those of the eight-connected grid, at most 8 % above the Euclidean ones.
    """
    legs = [
        (lane, start, goal)
        for lane, placement in enumerate(placements)
        for start, goal in zip([placement.start[:2], *placement.goals_m], placement.goals_m, strict=False)
    ]
    total = np.zeros(len(placements))
    if not legs:
        return total
    fields = _distances([floors[lane] for lane, _, _ in legs], [goal for _, _, goal in legs], hull_radius_m)
    for leg, (lane, start, _) in enumerate(legs):
        total[lane] += fields[(*cell_of(floors[lane], start), leg)]
    return total


def _distances(
    floors: Sequence[HostMap], goals: Sequence[Float64[np.ndarray, "2"]], hull_radius_m: float
) -> Float32[np.ndarray, "rows columns legs"]:
    """Returns the distance of every cell to its leg's goal, by sweeping until nothing changes (fast sweeping)."""
    cell_m = np.array([float(floor.cell_m) for floor in floors])
    fits_m = np.maximum(hull_radius_m - _SLACK_CELLS * cell_m, _INSIDE_M)
    # Legs last: a sweep then works on long stretches of neighbouring numbers, whichever way it goes.
    blocked = np.stack([floor.clearance_m for floor in floors], axis=-1) < fits_m
    distance = np.full(blocked.shape, np.inf, np.float32)
    for leg, (floor, goal) in enumerate(zip(floors, goals, strict=True)):
        distance[(*cell_of(floor, goal), leg)] = 0.0
    free = np.asarray(~blocked.all(axis=-1))
    rows, columns = _extent(free), _extent(free.T)
    open_distance, open_blocked = distance[rows, columns], blocked[rows, columns]
    before = np.empty_like(open_distance)
    while not np.array_equal(before, open_distance):
        before = open_distance.copy()
        for axes in ((0, 1, 2), (1, 0, 2)):
            _sweep(open_distance.transpose(axes), open_blocked.transpose(axes))
    return distance * cell_m.astype(np.float32)


def _extent(free: Bool[np.ndarray, "lines cells"]) -> slice:
    """Returns the lines from the first with a free cell to the last."""
    found = np.flatnonzero(free.sum(axis=1))
    return slice(found[0], found[-1] + 1) if len(found) else slice(0, 0)


def _sweep(distance: Float32[np.ndarray, "lines cells legs"], blocked: Bool[np.ndarray, "lines cells legs"]) -> None:
    """Lowers the distances in place, line by line, down and up again."""
    count = len(distance)
    for line, previous in [*((k, k - 1) for k in range(1, count)), *((k, k + 1) for k in reversed(range(count - 1)))]:
        near = distance[previous]
        diagonal = near + np.float32(_DIAGONAL)
        best = near + np.float32(1.0)
        np.minimum(best[1:], diagonal[:-1], out=best[1:])
        np.minimum(best[:-1], diagonal[1:], out=best[:-1])
        best[blocked[line]] = np.inf
        np.minimum(distance[line], best, out=distance[line])

"""Shortest way on the floor for a disc: the length that a driven path is compared with."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float64

from tasks.simulate.contract import HostMap, Placement
from tasks.simulate.floor_map import cell_of

_DIAGONAL = float(np.sqrt(2.0))
# The grid rounds positions by up to half a cell's diagonal: a centre that touches nothing may lie in such a cell.
_SLACK_CELLS = 0.71


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
    for (lane, start, _), field in zip(legs, fields, strict=True):
        total[lane] += field[cell_of(floors[lane], start)]
    return total


def _distances(
    floors: Sequence[HostMap], goals: Sequence[Float64[np.ndarray, "2"]], hull_radius_m: float
) -> Float64[np.ndarray, "legs rows columns"]:
    """Returns the distance of every cell to its leg's goal, by sweeping until nothing changes (fast sweeping)."""
    cell_m = np.array([float(floor.cell_m) for floor in floors])
    fits_m = hull_radius_m - _SLACK_CELLS * cell_m
    blocked = np.stack([floor.clearance_m for floor in floors]) < fits_m[:, None, None]
    distance = np.full(blocked.shape, np.inf)
    for leg, (floor, goal) in enumerate(zip(floors, goals, strict=True)):
        distance[(leg, *cell_of(floor, goal))] = 0.0
    before = np.empty_like(distance)
    while not np.array_equal(before, distance):
        before = distance.copy()
        for axes in ((1, 0, 2), (2, 0, 1)):
            _sweep(distance.transpose(axes), blocked.transpose(axes))
    return distance * cell_m[:, None, None]


def _sweep(distance: Float64[np.ndarray, "lines legs cells"], blocked: Bool[np.ndarray, "lines legs cells"]) -> None:
    """Lowers the distances in place, line by line, down and up again."""
    count = len(distance)
    for line, previous in [*((k, k - 1) for k in range(1, count)), *((k, k + 1) for k in reversed(range(count - 1)))]:
        near = distance[previous]
        best = near + 1.0
        np.minimum(best[:, 1:], near[:, :-1] + _DIAGONAL, out=best[:, 1:])
        np.minimum(best[:, :-1], near[:, 1:] + _DIAGONAL, out=best[:, :-1])
        best[blocked[line]] = np.inf
        np.minimum(distance[line], best, out=distance[line])

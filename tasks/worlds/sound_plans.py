"""Floor plans that a robot gets about in with their doors open.

A plan is drawn for its walls alone; that wide leaves, standing open, take a narrow way shows only when they hang.
"""

from functools import lru_cache

from tasks.worlds.brief import Brief
from tasks.worlds.clearance import measure_clearance, reaches_room
from tasks.worlds.doors import hang_doors
from tasks.worlds.floorplan import FloorPlan, plan_floor
from tasks.worlds.walls import build_walls

_REDRAWS = 4
_GREY = (0.5, 0.5, 0.5)


@lru_cache(maxsize=64)
def sound_plan(brief: Brief, seed: int, floorplan_index: int) -> FloorPlan:
    """Returns the first plan drawn that its open doors leave passable, else the last: its certificate tells.

    Raises:
        WorldRejected: InvalidInput, as ``plan_floor`` says.
    """
    plan = plan_floor(brief, seed, floorplan_index)
    for redraw in range(1, _REDRAWS):
        if brief.doors is None or _passable(brief, plan):
            return plan
        plan = plan_floor(brief, seed, floorplan_index, redraw)
    return plan


def _passable(brief: Brief, plan: FloorPlan) -> bool:
    walls = build_walls(plan, brief.ceiling_height_m, [_GREY] * len(plan.cells))
    leaves = [way.leaf("leaf", 100.0, _GREY) for way in hang_doors(brief, plan)]
    clearance = measure_clearance(plan.footprint, [*walls, *leaves])
    reached = clearance.reached(brief.robot_radius_m)
    return all(reaches_room(reached, clearance, floor, brief.robot_radius_m) for floor in plan.floors)

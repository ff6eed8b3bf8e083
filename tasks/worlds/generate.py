"""One world from a template, a seed and two indices: a pure function.

A floor plan is drawn for its walls alone. Whether wide doors, standing open, block a narrow way shows only when they
hang: such a plan is drawn again.
"""

from collections.abc import Sequence
from functools import lru_cache

from specs.data.world import ROBOT_RADIUS_M, Light, Passage, Rectangle, Room, Window, World
from specs.template.body import TemplateBody, template_digest
from tasks.worlds.certificate import broken_guarantees, certify
from tasks.worlds.floorplan.doors import build_doors, hang_doors, open_leaves
from tasks.worlds.floorplan.floorplan import FloorPlan, build_walls, plan_floor
from tasks.worlds.floorplan.scoring import WALL_M
from tasks.worlds.floorplan.search import WorldRejected
from tasks.worlds.furnishing.furnish import InteriorKey, furnish_interior
from tasks.worlds.geometry import Box, bounds_grid, reaches_room, rounded
from tasks.worlds.materials import Surfaces, draw_surfaces
from tasks.worlds.resolved_template import ResolvedTemplate, resolve_template
from tasks.worlds.streams import doors_stream, materials_stream
from tasks.worlds.survey import survey

_REDRAWS = 4
_GREY = (0.5, 0.5, 0.5)


@lru_cache(maxsize=64)
def sound_plan(resolved: ResolvedTemplate, seed: int, floorplan_index: int) -> FloorPlan:
    """Returns the first plan drawn that its open doors leave passable, else the last: its certificate tells.

    Raises:
        WorldRejected: InvalidInput, as ``plan_floor`` says.
    """
    plan = plan_floor(resolved, seed, floorplan_index)
    for redraw in range(1, _REDRAWS):
        if resolved.doors is None or _is_passable(resolved, plan):
            return plan
        plan = plan_floor(resolved, seed, floorplan_index, redraw)
    return plan


def _is_passable(resolved: ResolvedTemplate, plan: FloorPlan) -> bool:
    walls = build_walls(plan, resolved.ceiling_height_m, [_GREY] * len(plan.cells))
    leaves = [way.leaf("leaf", 100.0, _GREY) for way in hang_doors(resolved, plan)]
    grid = bounds_grid(plan.footprint, [*walls, *leaves])
    reached = grid.reached(resolved.robot_radius_m)
    return all(reaches_room(reached, grid, floor, resolved.robot_radius_m) for floor in plan.floors)


GENERATOR = "simyard-4"
"""Changes whenever the same template, seed and indices would give another world."""
_LIGHT_DROP_M = 0.1
# A world that breaks a guarantee is drawn again, with the next sub-seed.
_SUB_SEEDS = 5


def world_name(floorplan_index: int, interior_index: int) -> str:
    """Returns the name of a world in its generation."""
    return f"world-{floorplan_index}-{interior_index}"


def generate_world(
    template: TemplateBody,
    *,
    seed: int,
    generation: str,
    floorplan_index: int,
    interior_index: int,
    robot_radius_m: float = ROBOT_RADIUS_M,
) -> World:
    """Returns one world; all interiors of a floor plan share its rooms, passages and start.

    Args:
        template: What the world shall be like.
        seed: At least 0; with the indices it decides the world, whatever else is generated.
        generation: Name of the generation job, which goes into the world and nowhere else.
        floorplan_index: From 1.
        interior_index: From 1.
        robot_radius_m: Every room is reachable for a robot of this radius; doorways are made wide enough for it.

    Raises:
        WorldRejected: InvalidInput when the template's rooms cannot be laid out, InternalServiceError when the
            finished world breaks a guarantee with every sub-seed.
    """
    resolved, digest = _read(_Same(template), robot_radius_m)
    broken: tuple[str, ...] = ()
    for sub_seed in range(_SUB_SEEDS):
        draw = InteriorKey(seed, floorplan_index, interior_index, sub_seed)
        world = _draw_world(resolved, draw, generation, digest)
        broken = broken_guarantees(world.certificate)
        if not broken:
            return world
    name = world_name(floorplan_index, interior_index)
    raise WorldRejected("InternalServiceError", f"{name}, tried {_SUB_SEEDS} times: {'; '.join(broken)}")


class _Same:
    """A template that is the same only as itself: to look into two for what they share takes as long as to read one."""

    def __init__(self, template: TemplateBody) -> None:
        self.template = template

    def __eq__(self, other: object) -> bool:
        """Returns whether the other one holds the same object."""
        return isinstance(other, _Same) and other.template is self.template

    def __hash__(self) -> int:
        """Returns what goes with that."""
        return id(self.template)


@lru_cache(maxsize=8)
def _read(same: _Same, robot_radius_m: float) -> tuple[ResolvedTemplate, str]:
    """Returns what a template asks for, and its digest; all worlds of a job share them."""
    return resolve_template(same.template, robot_radius_m), template_digest(same.template)


def _draw_world(resolved: ResolvedTemplate, draw: InteriorKey, generation: str, digest: str) -> World:
    """Returns the world of one sub-seed, whatever it keeps of its guarantees."""
    indices = (draw.seed, draw.floorplan_index, draw.interior_index)
    plan = sound_plan(resolved, draw.seed, draw.floorplan_index)
    surfaces = draw_surfaces(resolved, materials_stream(*indices))
    walls = build_walls(plan, resolved.ceiling_height_m, [each.walls.color for each in surfaces])
    doors = build_doors(resolved, plan, doors_stream(*indices, draw.sub_seed))
    rooms, passages = _rooms(resolved, plan, surfaces), _passages(resolved, plan)
    furniture = furnish_interior(resolved, plan, [*walls, *open_leaves(doors, passages)], draw)
    surveyed = survey(rooms, passages, walls, furniture, doors, radius_m=resolved.robot_radius_m)
    return World(
        generator=GENERATOR,
        template_digest=digest,
        seed=draw.seed,
        sub_seed=draw.sub_seed,
        generation=generation,
        name=world_name(draw.floorplan_index, draw.interior_index),
        floorplan_index=draw.floorplan_index,
        interior_index=draw.interior_index,
        ceiling_height_m=rounded(resolved.ceiling_height_m),
        wall_thickness_m=WALL_M,
        footprint=_rectangle(plan.footprint),
        rooms=rooms,
        passages=passages,
        walls=walls,
        doors=doors,
        windows=_windows(resolved, plan),
        furniture=furniture,
        lights=_lights(plan, resolved.ceiling_height_m),
        map=surveyed.as_set.occupancy(),
        certificate=certify(
            resolved, rooms, passages, walls=walls, furniture=furniture, doors=doors, surveyed=surveyed
        ),
    )


def _rooms(resolved: ResolvedTemplate, plan: FloorPlan, surfaces: Sequence[Surfaces]) -> tuple[Room, ...]:
    return tuple(
        Room(
            name=wish.name,
            type=wish.type,
            floor=_rectangle(floor),
            flooring=surface.flooring,
            walls=surface.walls,
        )
        for wish, floor, surface in zip(resolved.rooms, plan.floors, surfaces, strict=True)
    )


def _passages(resolved: ResolvedTemplate, plan: FloorPlan) -> tuple[Passage, ...]:
    return tuple(
        Passage(
            rooms=(resolved.rooms[gap.rooms[0]].name, resolved.rooms[gap.rooms[1]].name),
            kind=gap.kind,
            center_m=(rounded(gap.center[0]), rounded(gap.center[1])),
            width_m=rounded(gap.width),
            along=gap.along,
            desired=gap.desired,
        )
        for gap in plan.gaps
    )


def _windows(resolved: ResolvedTemplate, plan: FloorPlan) -> tuple[Window, ...]:
    return tuple(
        Window(
            room=resolved.rooms[pane.room].name,
            center_m=(rounded(pane.center[0]), rounded(pane.center[1])),
            width_m=rounded(pane.width),
            along=pane.along,
            bottom_m=rounded(pane.bottom),
            top_m=rounded(pane.top),
        )
        for pane in plan.windows
    )


def _lights(plan: FloorPlan, ceiling_height_m: float) -> tuple[Light, ...]:
    height = rounded(ceiling_height_m - _LIGHT_DROP_M)
    centers = (floor.center for floor in plan.floors)
    return tuple(Light(position_m=(rounded(x), rounded(y), height)) for x, y in centers)


def _rectangle(box: Box) -> Rectangle:
    x_min, y_min, x_max, y_max = (rounded(side) for side in box)
    return Rectangle(x_min_m=x_min, y_min_m=y_min, x_max_m=x_max, y_max_m=y_max)

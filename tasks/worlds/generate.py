"""One world from a template, a seed and two indices: a pure function."""

from collections.abc import Sequence

from specs.template import TemplateBody, template_digest
from specs.world import Light, Passage, Rectangle, Room, World
from tasks.worlds.brief import Brief, brief_of
from tasks.worlds.certificate import broken_guarantees, certify
from tasks.worlds.floorplan import FloorPlan, plan_floor
from tasks.worlds.geometry import Box, rounded
from tasks.worlds.interior import Draw, furnish_interior, unfurnished_wishes
from tasks.worlds.materials import Surfaces, draw_surfaces
from tasks.worlds.rejection import WorldRejected
from tasks.worlds.scoring import WALL_M
from tasks.worlds.walls import build_walls

GENERATOR = "simyard-slicing-1"
"""Changes whenever the same template, seed and indices would give another world."""
_LIGHT_DROP_M = 0.1


def world_name(floorplan_index: int, interior_index: int) -> str:
    """Returns the name of a world in its generation."""
    return f"world-{floorplan_index}-{interior_index}"


def generate_world(
    template: TemplateBody, *, seed: int, generation: str, floorplan_index: int, interior_index: int
) -> World:
    """Returns one world; all interiors of a floor plan share its rooms, passages and start.

    Args:
        template: What the world shall be like.
        seed: At least 0; with the indices it decides the world, whatever else is generated.
        generation: Name of the generation job, which goes into the world and nowhere else.
        floorplan_index: From 1.
        interior_index: From 1.

    Raises:
        WorldRejected: InvalidInput when the template's rooms cannot be laid out, InternalServiceError when the
            finished world breaks a guarantee.
    """
    brief = brief_of(template)
    draw = Draw(seed, floorplan_index, interior_index)
    plan = plan_floor(brief, seed, floorplan_index)
    surfaces, unknown_materials = draw_surfaces(
        brief, seed=seed, floorplan_index=floorplan_index, interior_index=interior_index
    )
    walls = build_walls(plan, brief.ceiling_height_m, [each.wall_color for each in surfaces])
    furniture = furnish_interior(brief, plan, walls, draw)
    rooms, passages = _rooms(brief, plan, surfaces), _passages(brief, plan)
    unmet = (*plan.unmet, *unknown_materials, *unfurnished_wishes(brief, furniture))
    world = World(
        generator=GENERATOR,
        template_digest=template_digest(template),
        seed=seed,
        generation=generation,
        name=world_name(floorplan_index, interior_index),
        floorplan_index=floorplan_index,
        interior_index=interior_index,
        ceiling_height_m=rounded(brief.ceiling_height_m),
        wall_thickness_m=WALL_M,
        footprint=_rectangle(plan.footprint),
        rooms=rooms,
        passages=passages,
        walls=walls,
        furniture=furniture,
        lights=_lights(plan, brief.ceiling_height_m),
        certificate=certify(brief, rooms, passages, walls, furniture, unmet=unmet),
    )
    return _guaranteed(world)


def _guaranteed(world: World) -> World:
    broken = broken_guarantees(world.certificate)
    if broken:
        raise WorldRejected("InternalServiceError", f"{world.name}: {'; '.join(broken)}")
    return world


def _rooms(brief: Brief, plan: FloorPlan, surfaces: Sequence[Surfaces]) -> tuple[Room, ...]:
    return tuple(
        Room(
            name=wish.name,
            type=wish.type,
            floor=_rectangle(floor),
            floor_material=surface.floor,
            floor_color=surface.floor_color,
            wall_material=surface.wall,
        )
        for wish, floor, surface in zip(brief.rooms, plan.floors, surfaces, strict=True)
    )


def _passages(brief: Brief, plan: FloorPlan) -> tuple[Passage, ...]:
    return tuple(
        Passage(
            rooms=(brief.rooms[gap.rooms[0]].name, brief.rooms[gap.rooms[1]].name),
            kind=gap.kind,
            center_m=(rounded(gap.center[0]), rounded(gap.center[1])),
            width_m=rounded(gap.width),
            along=gap.along,
            desired=gap.desired,
        )
        for gap in plan.gaps
    )


def _lights(plan: FloorPlan, ceiling_height_m: float) -> tuple[Light, ...]:
    height = rounded(ceiling_height_m - _LIGHT_DROP_M)
    centers = (floor.center for floor in plan.floors)
    return tuple(Light(position_m=(rounded(x), rounded(y), height)) for x, y in centers)


def _rectangle(box: Box) -> Rectangle:
    x_min, y_min, x_max, y_max = (rounded(side) for side in box)
    return Rectangle(x_min_m=x_min, y_min_m=y_min, x_max_m=x_max, y_max_m=y_max)

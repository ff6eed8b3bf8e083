"""Worlds drawn by hand, for tests that must not depend on the generator.

The apartment: a living room (west, with the origin) and a kitchen (east), a doorway with a lintel between them.
"""

from hypothesis import strategies as st

from specs.data.world import (
    Certificate,
    Color,
    Finish,
    Furniture,
    Light,
    OccupancyMap,
    Passage,
    Pattern,
    Rectangle,
    Room,
    Solid,
    Wish,
    World,
)

WALL_M = 0.1
CEILING_M = 2.6
PAINT = (0.9, 0.9, 0.88)

names = st.text(st.characters(exclude_categories=("Cs",)), min_size=1, max_size=40)
colors = st.tuples(*[st.floats(0.0, 1.0)] * 3)


def apartment(
    *,
    generation: str = "wgj-0000000000000001",
    name: str = "world-1-1",
    room_names: tuple[str, str] = ("Living room", "Kitchen"),
    unmet: tuple[str, ...] = (),
) -> World:
    """Returns a two-room apartment of 9.3 x 4.2 m that holds every kind of element once."""
    return World(
        generator="tests/worlds_factory",
        template_digest="0" * 64,
        seed=7,
        generation=generation,
        name=name,
        floorplan_index=1,
        interior_index=1,
        ceiling_height_m=CEILING_M,
        wall_thickness_m=WALL_M,
        footprint=Rectangle(x_min_m=-2.6, y_min_m=-2.1, x_max_m=6.7, y_max_m=2.1),
        rooms=rooms(room_names),
        passages=(
            Passage(rooms=room_names, kind="Doorway", center_m=(2.55, 0.5), width_m=0.9, along="y", desired=True),
        ),
        walls=walls(),
        furniture=furniture(room_names),
        lights=(Light(position_m=(0.0, 0.0, 2.5)), Light(position_m=(4.6, 0.0, 2.5))),
        certificate=Certificate(
            origin_clear_radius_m=1.05,
            reachable_robot_radius_m=0.41,
            narrowest_passage_m=0.9,
            free_floor_share=0.86,
            area_error_mean=0.012,
            overlaps=0,
            guaranteed_robot_radius_m=0.25,
            doors_as_set_robot_radius_m=0.41,
            wishes=tuple(
                Wish(kind="walls", subject=subject, wished="Brick", found="Tiles", met=False) for subject in unmet
            ),
        ),
        map=OccupancyMap(resolution_m=4.2, origin_m=(-2.6, -2.1), columns=3, rows=1, runs=(2, 1)),
    )


def finish(material: str, pattern: Pattern, color: Color) -> Finish:
    """Returns a covering whose joints are a little darker."""
    darker = tuple(round(0.8 * channel, 6) for channel in color)
    return Finish(
        material=material, pattern=pattern, color=color, accent=(darker[0], darker[1], darker[2]), repeat_m=(0.4, 0.2)
    )


def rooms(room_names: tuple[str, str]) -> tuple[Room, ...]:
    """Returns the two rooms."""
    living, kitchen = room_names
    return (
        Room(
            name=living,
            type="Living",
            floor=Rectangle(x_min_m=-2.5, y_min_m=-2.0, x_max_m=2.5, y_max_m=2.0),
            flooring=finish("Floorboards", "planks", (0.72, 0.53, 0.34)),
            walls=finish("Wall paint", "plain", (0.9, 0.9, 0.88)),
        ),
        Room(
            name=kitchen,
            type="Kitchen",
            floor=Rectangle(x_min_m=2.6, y_min_m=-2.0, x_max_m=6.6, y_max_m=2.0),
            flooring=finish("Tiles", "tiles", (0.82, 0.84, 0.86)),
            walls=finish("Tiles", "tiles", (0.9, 0.93, 0.94)),
        ),
    )


def box(
    name: str, low: tuple[float, float, float], high: tuple[float, float, float], color: tuple[float, ...]
) -> Solid:
    """Returns the box between two corners."""
    center = tuple(round((a + b) / 2, 6) for a, b in zip(low, high, strict=True))
    half = tuple(round((b - a) / 2, 6) for a, b in zip(low, high, strict=True))
    return Solid.model_validate(
        {"name": name, "shape": "box", "center_m": center, "half_extents_m": half, "yaw_rad": 0.0, "color": color}
    )


def walls() -> tuple[Solid, ...]:
    """Returns the outer walls, the two parts of the inner one, and the lintel above the doorway."""
    return (
        box("wall-1", (-2.6, -2.1, 0.0), (6.7, -2.0, CEILING_M), PAINT),
        box("wall-2", (-2.6, 2.0, 0.0), (6.7, 2.1, CEILING_M), PAINT),
        box("wall-3", (-2.6, -2.0, 0.0), (-2.5, 2.0, CEILING_M), PAINT),
        box("wall-4", (6.6, -2.0, 0.0), (6.7, 2.0, CEILING_M), PAINT),
        box("wall-5", (2.5, -2.0, 0.0), (2.6, 0.05, CEILING_M), PAINT),
        box("wall-6", (2.5, 0.95, 0.0), (2.6, 2.0, CEILING_M), PAINT),
        box("wall-7", (2.5, 0.05, 2.05), (2.6, 0.95, CEILING_M), PAINT),
    )


def furniture(room_names: tuple[str, str]) -> tuple[Furniture, ...]:
    """Returns a sofa of two boxes, a floor lamp (cylinders) and a turned dining table."""
    living, kitchen = room_names
    sofa = (
        box("sofa-1/seat", (-1.0, -2.0, 0.0), (1.0, -1.1, 0.45), (0.3, 0.4, 0.55)),
        box("sofa-1/back", (-1.0, -2.0, 0.45), (1.0, -1.8, 0.85), (0.28, 0.37, 0.5)),
    )
    lamp = tuple(
        Solid(
            name=f"lamp-1/{part}",
            shape="cylinder",
            center_m=(-2.1, 1.6, height / 2),
            half_extents_m=(radius, radius, height / 2),
            yaw_rad=0.0,
            color=(0.2, 0.2, 0.2),
        )
        for part, radius, height in (("foot", 0.2, 0.04), ("pole", 0.02, 1.5))
    )
    table = Solid(
        name="table-1/top",
        shape="box",
        center_m=(5.2, -0.8, 0.37),
        half_extents_m=(0.7, 0.4, 0.37),
        yaw_rad=0.4,
        color=(0.5, 0.35, 0.2),
    )
    return (
        Furniture(name="sofa-1", model_type="Sofas", room=living, center_m=(0.0, -1.55), yaw_rad=0.0, solids=sofa),
        Furniture(name="lamp-1", model_type="FloorLamps", room=living, center_m=(-2.1, 1.6), yaw_rad=0.0, solids=lamp),
        Furniture(
            name="table-1",
            model_type="DiningTables",
            room=kitchen,
            center_m=(5.2, -0.8),
            yaw_rad=0.4,
            solids=(table,),
        ),
    )


@st.composite
def apartments(draw: st.DrawFn) -> World:
    """Draws the apartment with any names that JSON can hold and any floor colours."""
    living, kitchen = draw(st.lists(names, min_size=2, max_size=2, unique=True))
    world = apartment(room_names=(living, kitchen), unmet=tuple(draw(st.lists(names, max_size=3))))
    painted = tuple(
        room.model_copy(update={"flooring": finish("Tiles", "tiles", draw(colors))}) for room in world.rooms
    )
    pieces = tuple(piece.model_copy(update={"name": draw(names)}) for piece in world.furniture)
    return world.model_copy(update={"rooms": painted, "furniture": pieces})

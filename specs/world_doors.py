"""A world's doors as RoboMaker's ``world_description.json`` and DescribeWorld tell them."""

from pydantic import JsonValue

from specs.world import World


def world_description(world: World) -> dict[str, JsonValue]:
    """Returns what RoboMaker's ``world_description.json`` is for: the doors, by the names that exports use.

    The guide says that doors are listed and prints no example, so the keys are Simyard's own.
    """
    doors: list[JsonValue] = []
    for door in world.doors:
        passage = world.passages[door.passage]
        doors.append(
            {
                "name": door.name,
                "rooms": list(passage.rooms),
                "opensInto": door.opens_into,
                "hinge": {"x": door.hinge_m[0], "y": door.hinge_m[1]},
                "width": passage.width_m,
                "closedYaw": door.closed_yaw_rad,
                "openYaw": door.open_yaw_rad,
                "openPercent": door.open_percent,
            }
        )
    return {"world": world.name, "doors": doors}

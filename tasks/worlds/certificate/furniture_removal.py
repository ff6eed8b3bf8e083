"""A world with less furniture, measured anew: what is left of a world when a failure is narrowed down."""

from collections.abc import Collection

from specs.data.world import Certificate, Wish, World
from specs.template.body import TemplateBody
from tasks.worlds.brief import Brief, RoomWish, brief_of
from tasks.worlds.certificate.certificate import certify, survey
from tasks.worlds.geometry.clearance import occupancy

SHRUNK = "shrunk"
"""What the generator of such a world is called after the name of the one that made it."""
_ABOUT_FURNITURE = ("furniture", "density")


def keep_furniture(world: World, kept: Collection[str], template: TemplateBody | None) -> World:
    """Returns a world with some of its furniture, with a map and a certificate of its own.

    The certificate is measured on the geometry that is left. Beside the template's wishes it has one about the pieces
    that were taken out, which is not met: nobody shall take the world for one that was generated so.

    Args:
        world: Any world.
        kept: Names of the pieces to keep.
        template: What the world was made from; None where that is not known. Wishes about furniture are then left out.
    """
    furniture = tuple(piece for piece in world.furniture if piece.name in kept)
    surveyed = survey(world.rooms, world.passages, world.walls, furniture, world.doors)
    measured = certify(
        _brief_as_built(world) if template is None else brief_of(template, world.certificate.guaranteed_robot_radius_m),
        world.rooms,
        world.passages,
        walls=world.walls,
        furniture=furniture,
        doors=world.doors,
        surveyed=surveyed,
    )
    certificate = measured if template is not None else _keep_other_wishes(measured, world.certificate)
    taken = Wish(
        kind="furniture",
        subject="all rooms",
        wished=f"{len(world.furniture)} as generated",
        found=f"{len(furniture)} left",
        met=len(furniture) == len(world.furniture),
    )
    return world.model_copy(
        update={
            "generator": world.generator if world.generator.endswith(SHRUNK) else f"{world.generator}-{SHRUNK}",
            "furniture": furniture,
            "map": occupancy(surveyed.as_set),
            "certificate": certificate.model_copy(update={"wishes": (*certificate.wishes, taken)}),
        }
    )


def _keep_other_wishes(measured: Certificate, before: Certificate) -> Certificate:
    """Returns what was measured, with what an earlier certificate says of wishes that furniture has no part in."""
    wishes = tuple(wish for wish in before.wishes if wish.kind not in _ABOUT_FURNITURE)
    return measured.model_copy(update={"area_error_mean": before.area_error_mean, "wishes": wishes})


def _brief_as_built(world: World) -> Brief:
    """Returns a brief that asks for the rooms as they are, to measure with where nobody knows what was asked for."""
    return Brief(
        footprint_aspect=1.0,
        ceiling_height_m=world.ceiling_height_m,
        rooms=tuple(
            RoomWish(
                name=room.name,
                type=room.type,
                area_m2=(room.floor.x_max_m - room.floor.x_min_m) * (room.floor.y_max_m - room.floor.y_min_m),
                aspect=1.0,
                floorings=(),
                walls=(),
                furniture=None,
                density="Moderate",
            )
            for room in world.rooms
        ),
        connections=(),
        robot_radius_m=world.certificate.guaranteed_robot_radius_m,
    )

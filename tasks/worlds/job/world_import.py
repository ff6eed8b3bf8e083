"""A world's document put into a store by hand, such as that of a regression case in a repository."""

from pathlib import Path

from pydantic import ValidationError

from specs.base import Fault
from specs.data.world import World
from specs.errors import DocumentError, ObjectExists
from tasks.storage.base.store import Store
from tasks.storage.worlds import decode_world, encode_world, write_world
from tasks.worlds.certificate.furniture_removal import keep_furniture

_MEASURED = (
    "origin_clear_radius_m",
    "reachable_robot_radius_m",
    "doors_as_set_robot_radius_m",
    "narrowest_passage_m",
    "free_floor_share",
    "overlaps",
)


def add_world(store: Store, file: Path) -> str:
    """Returns ``<generation>/<world>`` of a world that is in the store now; the same one may be there already.

    Args:
        store: Where it goes.
        file: The world's document.

    Raises:
        DocumentError: It is no world, its certificate or its map is not that of its geometry, or another world of
            that name is there.
    """
    try:
        world = decode_world(file.read_bytes())
    except (OSError, ValidationError) as exc:
        raise _fault(
            file, str(exc).splitlines()[0], "the document of a world, which this version of Simyard wrote"
        ) from exc
    if wrong := _wrong_fields(world):
        raise _fault(file, ", ".join(wrong), "what is measured on the world's geometry")
    reference = f"{world.generation}/{world.name}"
    try:
        write_world(store, reference, encode_world(world))
    except ObjectExists as exc:
        raise _fault(file, reference, "a name that no other world has there") from exc
    return reference


def _wrong_fields(world: World) -> list[str]:
    """Returns what a world's document says of it and is not so."""
    measured = keep_furniture(world, {piece.name for piece in world.furniture}, None)
    said, found = world.certificate, measured.certificate
    wrong = [f"certificate.{name}" for name in _MEASURED if getattr(said, name) != getattr(found, name)]
    return [*wrong, *(["map"] if measured.map != world.map else [])]


def _fault(file: Path, value: str, allowed: str) -> DocumentError:
    return DocumentError([Fault(path=str(file), value=value, allowed=allowed)], source="simyard")

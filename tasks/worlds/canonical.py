"""Worlds as bytes: one canonical JSON form, so that equal worlds are equal bytes on any machine."""

from specs.digests import canonical_json
from specs.world import World


def encode_world(world: World) -> bytes:
    """Returns the canonical JSON of a world; decoding it gives the same world, whose floats were rounded when made."""
    return canonical_json(world.model_dump(mode="json"))


def decode_world(body: bytes) -> World:
    """Returns the world that the bytes hold.

    Raises:
        pydantic.ValidationError: They hold something else.
    """
    return World.model_validate_json(body)

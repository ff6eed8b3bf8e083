"""Worlds as bytes: one canonical JSON form, so that equal worlds are equal bytes on any machine.

Worlds as the store has them.
"""

from pydantic import ValidationError

from specs.base import Fault
from specs.data.world import World
from specs.digest import canonical_json
from specs.errors import DocumentError, ObjectNotFound, ResourceNotFound
from tasks.storage.base.keys import world_key
from tasks.storage.base.store import Store


def encode_world(world: World) -> bytes:
    """Returns the canonical JSON of a world; decoding it gives the same world, whose floats were rounded when made."""
    return canonical_json(world.model_dump(mode="json"))


def decode_world(body: bytes) -> World:
    """Returns the world that the bytes hold.

    Raises:
        pydantic.ValidationError: They hold something else.
    """
    return World.model_validate_json(body)


SOURCE = "CreateWorldExportJob"


def read_world(store: Store, reference: str, source: str = SOURCE) -> World:
    """Returns a world, by ``<generation>/<world>``.

    Args:
        store: Where it is.
        reference: Which one.
        source: Who asks, for the error.

    Raises:
        ResourceNotFound: There is no such world.
        DocumentError: What is there was not written by this version of Simyard.
    """
    generation, name = reference.split("/")
    try:
        body = store.get(world_key(generation, name)).body
    except ObjectNotFound as exc:
        fault = Fault(path="worlds", value=reference, allowed=f"a world in {store.url}; see simyard list worlds")
        raise ResourceNotFound([fault], source=source) from exc
    try:
        return World.model_validate_json(body)
    except ValidationError as exc:
        fault = Fault(path="worlds", value=reference, allowed="a world that this version of Simyard wrote")
        raise DocumentError([fault], source=store.url) from exc

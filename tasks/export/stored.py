"""Worlds as the store has them."""

from pydantic import ValidationError

from specs.base import Fault
from specs.errors import DocumentError, ObjectNotFound, ResourceNotFound
from specs.world import World
from tasks.storage.keys import world_key
from tasks.storage.store import Store

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

"""Worlds in the store: their one canonical form as bytes, and the one place that reads and writes them.

Equal worlds are equal bytes on any machine. A reference is ``<generation>/<world>``.
"""

import hashlib

from pydantic import ValidationError

from specs.arn import absence
from specs.base import Fault
from specs.data.world import World
from specs.digest import canonical_json
from specs.errors import DocumentError, ObjectNotFound, ResourceNotFound, WorldChanged
from tasks.storage.base.encoding import create_once
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


def reference_key(reference: str) -> str:
    """Returns the key of a world.

    Raises:
        DocumentError: The reference is none.
    """
    generation, _, name = reference.partition("/")
    return world_key(generation, name)


def world_bytes(store: Store, reference: str) -> bytes:
    """Returns the document of a world, whatever it is.

    Raises:
        ObjectNotFound: There is no such world.
    """
    return store.get(reference_key(reference)).body


def pinned_world_bytes(store: Store, reference: str, sha256: str) -> bytes:
    """Returns the document of a world that has the digest.

    Raises:
        ObjectNotFound: There is no such world.
        WorldChanged: It has another digest.
    """
    body = world_bytes(store, reference)
    if hashlib.sha256(body).hexdigest() != sha256:
        raise WorldChanged(reference)
    return body


def read_world(store: Store, reference: str, source: str) -> World:
    """Returns a world.

    Args:
        store: Where it is.
        reference: Which one.
        source: Who asks, for the error.

    Raises:
        ResourceNotFound: There is no such world.
        DocumentError: What is there was not written by this version of Simyard.
    """
    try:
        return decode_world(world_bytes(store, reference))
    except ObjectNotFound as exc:
        fault = Fault(path="worlds", value=reference, allowed=absence(["world"], store.url))
        raise ResourceNotFound([fault], source=source) from exc
    except ValidationError as exc:
        fault = Fault(path="worlds", value=reference, allowed="a world that this version of Simyard wrote")
        raise DocumentError([fault], source=store.url) from exc


def write_world(store: Store, reference: str, body: bytes) -> None:
    """Puts the document of a world into the store; the same one may be there already.

    Raises:
        ObjectExists: Another one is there.
    """
    create_once(store, reference_key(reference), body)

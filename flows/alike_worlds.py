"""Which worlds are the same, whatever their generation is called: each run of a document generates its own."""

import hashlib
from collections.abc import Iterable

from specs.errors import ObjectNotFound
from specs.world import World
from tasks.storage.keys import world_key
from tasks.storage.store import Store


def alike_worlds(store: Store, references: Iterable[str]) -> dict[str, str]:
    """Returns a digest of all of each world but what its generation was called, by ``<generation>/<world>``.

    Worlds that are gone are left out.

    Args:
        store: Where they are.
        references: Which ones.
    """
    found: dict[str, str] = {}
    for reference in dict.fromkeys(references):
        generation, _, name = reference.partition("/")
        try:
            body = store.get(world_key(generation, name)).body
        except ObjectNotFound:
            continue
        bare = World.model_validate_json(body).model_copy(update={"generation": ""})
        found[reference] = hashlib.sha256(bare.model_dump_json().encode()).hexdigest()
    return found

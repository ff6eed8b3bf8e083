"""Worlds that are made by whoever has the time, and kept in the store under the names that their job knows."""

from collections.abc import Callable, Sequence

from tasks.storage.base.keys import world_key, worlds_prefix
from tasks.storage.base.store import Store
from tasks.storage.worlds import write_world
from tasks.worlds.generate import world_name
from tasks.worlds.job.production import Indices, Order, WorldOutcome, make


def make_and_keep(
    store: Store, order: Order, indices: Sequence[Indices], going: Callable[[], bool]
) -> list[WorldOutcome]:
    """Returns the worlds that cannot be; all others are kept in the store, unless nobody wants them any more.

    Args:
        store: Where worlds lie.
        order: What the worlds have in common.
        indices: Floor plan and interior of each world.
        going: Whether the next one is still wanted; asked before each.

    Raises:
        ObjectExists: A world in the store is not what this version of Simyard makes.
    """
    rejected: list[WorldOutcome] = []
    for each in indices:
        if not going():
            break
        made = make(order, each)
        if made.code is None:
            write_world(store, f"{order.generation}/{world_name(*each)}", made.document.encode())
        else:
            rejected.append(made)
    return rejected


def missing_worlds(store: Store, generation: str, indices: Sequence[Indices]) -> list[Indices]:
    """Returns those worlds of a generation job that the store does not have."""
    there = set(store.keys(worlds_prefix(generation)))
    return [each for each in indices if world_key(generation, world_name(*each)) not in there]

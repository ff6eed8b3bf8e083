"""Makes some worlds of a generation again, drawn after the fact, and compares them with what a batch drove in."""

import hashlib
from collections.abc import Mapping, Sequence
from random import Random, SystemRandom

from specs.robomaker.world_jobs import CreateWorldGenerationJobRequest
from tasks.worlds.generate import world_name
from tasks.worlds.job.job import world_indices
from tasks.worlds.job.production import Indices, Order, produce

MOST_REMADE = 64


def world_changes(
    order: Order,
    request: CreateWorldGenerationJobRequest,
    worlds: Sequence[str],
    digests: Mapping[str, str],
    *,
    first: Indices = (1, 1),
    most: int = MOST_REMADE,
    draw: Random | None = None,
) -> list[str]:
    """Returns which worlds are not those that the template gives, one line each.

    Args:
        order: Template, seed and generation.
        request: How many worlds were asked for.
        worlds: ``<generation>/<world>`` of each world that there is said to be.
        digests: SHA-256 of each world's document, as they are driven in.
        first: Floor plan and interior of the job's first world.
        most: How many worlds are made again; all, if there are no more.
        draw: Draws them; unpredictable, if not given.
    """
    indices = world_indices(request, first)
    names = [f"{order.generation}/{world_name(*each)}" for each in indices]
    if list(worlds) != [name for name in names if name in set(worlds)]:
        return [f"the record of {order.generation} names worlds that it was not asked for: {list(worlds)!r:.200}"]
    places = sorted((draw or SystemRandom()).sample(range(len(indices)), min(most, len(indices))))
    changes: list[str] = []
    for place, made in zip(places, produce(order, [indices[place] for place in places]), strict=True):
        name = names[place]
        computed = hashlib.sha256(made.document.encode()).hexdigest() if made.code is None else "none"
        found = digests.get(name, "none") if name in set(worlds) else "none"
        if found != computed:
            changes.append(f"world {name} has the SHA-256 {found}; the template gives {computed}")
    return changes

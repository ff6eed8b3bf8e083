"""Where robots are apart from all obstacles, and the order in which the others are looked at again.

A control step is driven first as if there were no obstacle. Where the robot then was everywhere further from its start
than no obstacle is near, nothing touched it, and the step stands. The lanes that may have touched something are driven
again among obstacles, a few together.
"""

from collections.abc import Callable
from typing import TypeVar

import jax
import jax.numpy as jnp
from jaxtyping import Bool

Given = TypeVar("Given")
Lanes = TypeVar("Lanes")
# Driven again together: with fewer, the calls cost more than the work; with more, sound lanes fill up the last ones.
_TOGETHER = 32


def mended(
    first: Lanes, sound: Bool[jax.Array, "lanes"], again: Callable[[Given], Lanes], given: Given, lanes: int
) -> Lanes:
    """Returns what was found for all lanes, with those that are not sound found again.

    Args:
        first: What was found, lanes first.
        sound: The lanes for which it stands.
        again: Finds the same for some lanes.
        given: What it finds it from, lanes first.
        lanes: How many there are.
    """
    together = min(lanes, _TOGETHER)
    order, wrong = jnp.argsort(sound, stable=True), jnp.sum(~sound)

    def more(carry: tuple[jax.Array, Lanes]) -> jax.Array:
        return carry[0] < wrong

    def some(carry: tuple[jax.Array, Lanes]) -> tuple[jax.Array, Lanes]:
        begin, found = carry
        chosen = jax.lax.dynamic_slice(order, (begin,), (together,))
        better = again(jax.tree.map(lambda array: array[chosen], given))

        def put(old: jax.Array, new: jax.Array) -> jax.Array:
            keep = sound[chosen].reshape(-1, *[1] * (old.ndim - 1))
            return old.at[chosen].set(jnp.where(keep, old[chosen], new), unique_indices=True)

        return begin + together, jax.tree.map(put, found, better)

    _, found = jax.lax.while_loop(more, some, (jnp.zeros((), wrong.dtype), first))
    return found

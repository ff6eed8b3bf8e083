"""Work on as few of a window's obstacles as the lanes need, decided while running.

A branch on one lane's number, mapped over lanes, would do the work of both sides; so the number of the lane that needs
most decides for all.
"""

from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Int

from tasks.simulate.devices import rounds_each_operation
from tasks.simulate.engines.planar.planar_algebra import Planar, Scalar

# A physics step is compiled for as many obstacles as this, and for all in the window.
FEW = (0, 1, 3)
# Any tree of arrays of a lane.
Tree = Any


def among_fewest(work: Callable[[int, Tree], Tree], counts: Sequence[int]) -> Callable[[Int[Array, ""], Tree], Tree]:
    """Returns a function of how many obstacles a lane needs, and of what it is given.

    Args:
        work: What is done with the first so many obstacles; it must give the same with more of them than are needed.
        counts: The numbers that it is compiled for, ascending; a lane needs at most the last one.
    """

    def of_lanes(most: Int[Array, "lanes"], given: Tree) -> Tree:
        steps = [jax.vmap(lambda each, count=count: work(count, each)) for count in counts]
        return jax.lax.switch((jnp.array(counts) < most.max()).sum(dtype=jnp.int32), steps, given)

    @jax.custom_batching.custom_vmap
    def one(most: Int[Array, ""], given: Tree) -> Tree:
        lanes = jax.tree.map(lambda array: array[None], (most, given))
        return jax.tree.map(lambda array: array[0], of_lanes(*lanes))

    @one.def_vmap
    def _(lanes: int, mapped: Sequence[Any], *given: Any) -> tuple[Tree, Tree]:  # noqa: ANN401 - JAX's own form
        def repeated(array: Array, is_mapped: bool) -> Array:  # noqa: FBT001 - JAX's own form
            return array if is_mapped else jnp.broadcast_to(array, (lanes, *jnp.shape(array)))

        found = of_lanes(*jax.tree.map(repeated, given, tuple(mapped)))
        return found, jax.tree.map(lambda _: True, found)

    return one


def few_counts(total: int) -> tuple[int, ...]:
    """Returns how many of a window's obstacles work is compiled for.

    Only all of them where programs may fuse products and sums: each count has its own rounding there, and a lane's last
    bits would hang on its neighbours.

    Args:
        total: In the window.
    """
    return (*(each for each in FEW if each < total), total) if rounds_each_operation() else (total,)


def need(free_m: Sequence[Scalar], moved: Planar, before: Planar) -> Int[Array, ""]:
    """Returns how many of the obstacles must be looked at so that no other can push.

    What does not push adds zeros to what the solver sums up. They change nothing, but for the sign of an acceleration
    that is -0 already: then all obstacles are needed.

    Args:
        free_m: How far the robot can go from where the control step began, and not touch each obstacle.
        moved: How far it went.
        before: Its acceleration in the physics step before.
    """
    gone_m = jnp.sqrt(moved.x**2 + moved.y**2)
    count = jnp.int32(0)
    for place, each in enumerate(free_m, 1):
        count = jnp.where(gone_m < each, count, place)
    negative = [(part == 0.0) & jnp.signbit(part) for part in before]
    return jnp.where(negative[0] | negative[1] | negative[2], len(free_m), count)

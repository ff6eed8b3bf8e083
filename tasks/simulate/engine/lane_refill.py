"""Puts episodes into lanes of a compiled program whose episodes are done, while the others go on.

A few lanes are begun together, in a program of as many, and written over what was in lanes that are free: the others
are not touched. What a lane begins with does not depend on how many begin beside it
(docs/decisions/0004-lanes-a-multiple-of-eight.md), so neither does its row
(docs/decisions/0038-lanes-that-are-refilled.md).
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh
from jaxtyping import Int

from tasks.simulate.engine.kept_program.keeper import ProgramKeeper
from tasks.simulate.engine.program import lane_sharding, split_over
from tasks.simulate.lane.lane_state import LaneInputs, LaneState

# Of a device's lanes, so many begin together. Fewer rest less, and cost more calls.
_SHARE = 8
_LANES_A_VECTOR = 8
Places = Int[jax.Array, "fresh"]
Occupied = tuple[LaneInputs, LaneState]


class LaneRefill(NamedTuple):
    """How a program's lanes are filled.

    Attributes:
        together: So many lanes of each device begin together.
        blank: Returns what all lanes hold before any was filled, for the inputs of those that are filled first.
        spread: Returns lanes of which only the first on each device were filled: the others rest, and repeat those.
        fill: Returns inputs and state of all lanes, those at the places filled anew. Places are counted on each device
            from 0; one beyond its lanes drops what was meant for it. What was given of the lanes is used up.
    """

    together: int
    blank: Callable[[LaneInputs], Occupied]
    fill: Callable[[LaneInputs, LaneState, LaneInputs, Places], Occupied]
    spread: Callable[[LaneInputs, LaneState], Occupied]


def lane_refill(mesh: Mesh, lanes: int, begin: Callable[[LaneInputs], LaneState], keeper: ProgramKeeper) -> LaneRefill:
    """Returns how lanes are filled; compiles nothing yet.

    Args:
        mesh: The devices.
        lanes: Of the program, on all devices.
        begin: Returns the state of one device's lanes before their first control step.
        keeper: Of the program's functions.
    """

    def fill(inputs: LaneInputs, state: LaneState, fresh: LaneInputs, places: Places) -> Occupied:
        new = (fresh, begin(fresh))
        return jax.tree.map(lambda old, some: old.at[places].set(some, mode="drop"), (inputs, state), new)

    together = lanes_together(lanes // mesh.size)
    begun = jax.jit(keeper.kept("begin", split_over(mesh, begin, 1)))

    def blank(fresh: LaneInputs) -> Occupied:
        forms = (fresh, jax.eval_shape(begun, fresh))
        # Of NumPy: those of JAX are compiled, for each shape.
        zeros = jax.tree.map(lambda form: np.zeros((lanes, *form.shape[1:]), form.dtype), forms)
        return jax.device_put(zeros, lane_sharding(mesh))

    def spread(inputs: LaneInputs, state: LaneState) -> Occupied:
        every = jnp.arange(state.done.shape[0])
        inputs, state = jax.tree.map(lambda array: array[every % together], (inputs, state))
        return inputs, state._replace(done=state.done | (every >= together))

    return LaneRefill(
        together=together,
        blank=blank,
        fill=jax.jit(keeper.kept("fill", split_over(mesh, fill, 4)), donate_argnums=(0, 1)),
        spread=jax.jit(keeper.kept("spread", split_over(mesh, spread, 2))),
    )


def lanes_together(lanes: int) -> int:
    """Returns how many lanes of a device that has so many begin together: whole vectors, as all programs have."""
    return -(-max(1, lanes // _SHARE) // _LANES_A_VECTOR) * _LANES_A_VECTOR

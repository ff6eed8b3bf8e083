"""A lane's state whose applications' own types are sealed: at the edge of a program they are plain tuples of arrays.

What is kept of a program must not name types of an application, which another process may not have, or has otherwise.
"""

import functools
from typing import Any, TypeVar

import jax

from tasks.simulate.lane.calls import Applications
from tasks.simulate.lane.lane_state import LaneInputs, LaneState

Tree = TypeVar("Tree")
# Of programs and shapes in one process.
_FORMS_KEPT = 32


def sealed(state: LaneState) -> LaneState:
    """Returns a state whose applications' states are tuples of their arrays, in JAX's order."""
    return state._replace(
        controller=tuple(jax.tree.leaves(state.controller)), scenario=tuple(jax.tree.leaves(state.scenario))
    )


def opened(applications: Applications, inputs: LaneInputs, state: LaneState) -> LaneState:
    """Returns the state that was sealed, its applications' states as they have them.

    Args:
        applications: Their beginnings are traced, to see what they keep.
        inputs: One lane's; shapes are enough.
        state: Of one lane, or of many.
    """
    leaves, structure = jax.tree.flatten(inputs)
    forms = _forms(applications, structure, tuple((leaf.shape, leaf.dtype) for leaf in leaves))
    whole = [
        jax.tree.unflatten(form, jax.tree.leaves(each))
        for form, each in zip(forms, (state.controller, state.scenario), strict=True)
    ]
    return state._replace(controller=whole[0], scenario=whole[1])


def one_lane(tree: Tree) -> Tree:
    """Returns the shapes of one lane's arrays, of many lanes'."""
    return jax.tree.map(lambda array: jax.ShapeDtypeStruct(array.shape[1:], array.dtype), tree)


@functools.lru_cache(maxsize=_FORMS_KEPT)
def _forms(applications: Applications, structure: Any, shapes: tuple[Any, ...]) -> tuple[Any, Any]:  # noqa: ANN401 - JAX's own
    """Returns the forms of what the controller and the scenario begin with."""

    def begin(inputs: LaneInputs) -> tuple[object, object]:
        controller = applications.controller(inputs.numbers).init(inputs.floor, inputs.goals_m)
        return controller, applications.scenario(inputs.numbers).init(inputs.start, inputs.goals_m, *inputs.given)

    inputs = jax.tree.unflatten(structure, [jax.ShapeDtypeStruct(*shape) for shape in shapes])
    controller, scenario = jax.eval_shape(begin, inputs)
    return jax.tree.structure(controller), jax.tree.structure(scenario)

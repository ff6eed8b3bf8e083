"""The schema of a tree of arrays as text, so that arrays can be put together again where nothing was traced.

A tree is made of what Simyard and Python have: named tuples of ``tasks.simulate``, tuples, lists, dictionaries, and
None. What is cached of a program must not name types of an application, which another process may not have, or has
otherwise: at the edge of a program the applications' states are flat tuples of arrays.
"""

import functools
import importlib
import json
from collections.abc import Callable, Iterator, Sequence
from typing import Any, TypeVar

import jax

from tasks.simulate.lane.chunk_applications import Applications
from tasks.simulate.lane.control_step import LaneInputs, LaneState

_OWN = "tasks.simulate."
_DICT_KEYS = (str, int)


class UnknownPytree(TypeError):  # noqa: N818 - a state
    """A tree holds what is no tuple, list or dictionary of Simyard's."""


def schema_of(structure: Any) -> str:  # noqa: ANN401 - JAX gives its class no type that pyright knows
    """Returns the form of a tree as text.

    Raises:
        FormUnknown: It holds a type that no text stands for.
    """
    numbered = jax.tree.unflatten(structure, range(structure.num_leaves))
    return json.dumps(_described(numbered), separators=(",", ":"))


def pytree_of(form: str, leaves: Sequence[object]) -> Any:  # noqa: ANN401 - whatever tree it was
    """Returns a tree of that form with these leaves.

    Raises:
        FormUnknown: The text is no form, or has other leaves.
    """
    try:
        count = iter(range(len(leaves)))
        tree = _built(json.loads(form), leaves, count)
    except (ValueError, TypeError, LookupError, AttributeError, ImportError) as exc:
        raise UnknownPytree(form) from exc
    if next(count, None) is not None:
        raise UnknownPytree(form)
    return tree


def _described(node: Any) -> object:  # noqa: ANN401 - a node of any tree
    if node is None or type(node) is int:
        return node
    if type(node) in {tuple, list}:
        return [type(node).__name__, *map(_described, node)]
    if type(node) is dict and all(type(key) in _DICT_KEYS for key in node):
        return ["dict", *([key, _described(value)] for key, value in node.items())]
    kind: Any = type(node)
    if issubclass(kind, tuple) and kind.__module__.startswith(_OWN) and hasattr(kind, "_fields"):
        return [f"{kind.__module__}:{kind.__qualname__}", *map(_described, node)]
    raise UnknownPytree(kind.__name__)


def _built(node: Any, leaves: Sequence[object], count: Iterator[int]) -> Any:  # noqa: ANN401 - a node of any tree
    if node is None:
        return None
    if isinstance(node, int):
        next(count)
        return leaves[node]
    name, *parts = node
    if name == "dict":
        return {key: _built(value, leaves, count) for key, value in parts}
    built = [_built(part, leaves, count) for part in parts]
    return {"tuple": tuple, "list": list}[name](built) if ":" not in name else _own_type(name)(*built)


def _own_type(name: str) -> Callable[..., object]:
    module, _, within = name.partition(":")
    if not module.startswith(_OWN):
        raise UnknownPytree(name)
    kind = getattr(importlib.import_module(module), within)
    if not (isinstance(kind, type) and issubclass(kind, tuple) and hasattr(kind, "_fields")):
        raise UnknownPytree(name)
    return kind


Tree = TypeVar("Tree")
# Of programs and shapes in one process.
_FORMS_KEPT = 32


def flatten_state(state: LaneState) -> LaneState:
    """Returns a state whose applications' states are tuples of their arrays, in JAX's order."""
    return state._replace(
        controller=tuple(jax.tree.leaves(state.controller)), scenario=tuple(jax.tree.leaves(state.scenario))
    )


def unflatten_state(applications: Applications, inputs: LaneInputs, state: LaneState) -> LaneState:
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

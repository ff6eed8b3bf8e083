"""The form of a tree of arrays as text, so that arrays can be put together again where nothing was traced.

A tree is made of what Simyard and Python have: named tuples of ``tasks.simulate``, tuples, lists, dictionaries, and
None. What an application's own types hold is sealed before (``sealed_state``).
"""

import importlib
import json
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import jax

_OWN = "tasks.simulate."
_DICT_KEYS = (str, int)


class FormUnknown(TypeError):  # noqa: N818 - a state
    """A tree holds what is no tuple, list or dictionary of Simyard's."""


def form_text(structure: Any) -> str:  # noqa: ANN401 - JAX gives its class no type that pyright knows
    """Returns the form of a tree as text.

    Raises:
        FormUnknown: It holds a type that no text stands for.
    """
    numbered = jax.tree.unflatten(structure, range(structure.num_leaves))
    return json.dumps(_described(numbered), separators=(",", ":"))


def tree_of(form: str, leaves: Sequence[object]) -> Any:  # noqa: ANN401 - whatever tree it was
    """Returns a tree of that form with these leaves.

    Raises:
        FormUnknown: The text is no form, or has other leaves.
    """
    try:
        count = iter(range(len(leaves)))
        tree = _built(json.loads(form), leaves, count)
    except (ValueError, TypeError, LookupError, AttributeError, ImportError) as exc:
        raise FormUnknown(form) from exc
    if next(count, None) is not None:
        raise FormUnknown(form)
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
    raise FormUnknown(kind.__name__)


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
        raise FormUnknown(name)
    kind = getattr(importlib.import_module(module), within)
    if not (isinstance(kind, type) and issubclass(kind, tuple) and hasattr(kind, "_fields")):
        raise FormUnknown(name)
    return kind

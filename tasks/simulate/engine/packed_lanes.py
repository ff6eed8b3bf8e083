"""Lanes' arrays as a few: each array that a compiled call takes or gives costs microseconds, however small it is.

What is small goes into one row of words for each lane, bit for bit; what is large stays an array of its own, which a
call that is given it may change in place.
"""

import math
from dataclasses import dataclass
from functools import partial
from typing import Any, Generic, NamedTuple, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import UInt32

Tree = TypeVar("Tree")
# Of one lane: a copy of so many numbers costs less than an array more.
_SMALL = 64
_WORDS = (jnp.dtype("float32"), jnp.dtype("int32"), jnp.dtype("uint32"))
_FLAG = jnp.dtype("bool")


class _Leaf(NamedTuple):
    """An array of one lane.

    Attributes:
        small: Whether it is among the words.
    """

    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    small: bool


@dataclass(frozen=True)
class _Form:
    structure: Any
    leaves: tuple[_Leaf, ...]

    def __hash__(self) -> int:
        # Each call asks for it; that of all leaves would take as long as to pass the arrays.
        return hash(self.structure)


@partial(jax.tree_util.register_dataclass, data_fields=["words", "large"], meta_fields=["form"])
@dataclass(frozen=True)
class PackedLanes(Generic[Tree]):
    """A tree of arrays; of one lane, or lanes first.

    Attributes:
        words: All that is small.
        large: The other arrays.
        form: What the tree was.
    """

    words: UInt32[jax.Array, "*lanes words"]
    large: list[jax.Array]
    form: _Form


def pack_lane(tree: Tree) -> PackedLanes[Tree]:
    """Returns one lane's tree of arrays as a few arrays."""
    arrays, structure = jax.tree.flatten(tree)
    leaves = tuple(_leaf(array) for array in arrays)
    words = [_words(array) for array, leaf in zip(arrays, leaves, strict=True) if leaf.small]
    large = [array for array, leaf in zip(arrays, leaves, strict=True) if not leaf.small]
    return PackedLanes(jnp.concatenate([jnp.zeros(0, jnp.uint32), *words]), large, _Form(structure, leaves))


def unpack_lane(packed: PackedLanes[Tree]) -> Tree:
    """Returns the tree of one lane, the same bits."""
    arrays: list[jax.Array] = []
    place, large = 0, iter(packed.large)
    for leaf in packed.form.leaves:
        size = math.prod(leaf.shape)
        arrays.append(_array(packed.words[place : place + size], leaf) if leaf.small else next(large))
        place += size if leaf.small else 0
    return jax.tree.unflatten(packed.form.structure, arrays)


def _leaf(array: jax.Array) -> _Leaf:
    # Whatever is no plain number, such as a key, stays as it is.
    small = array.dtype in {*_WORDS, _FLAG} and array.size <= _SMALL
    return _Leaf(array.shape, array.dtype, small)


def _words(array: jax.Array) -> UInt32[jax.Array, "words"]:
    flat = jnp.ravel(array)
    return flat.astype(jnp.uint32) if array.dtype == _FLAG else jax.lax.bitcast_convert_type(flat, jnp.uint32)


def _array(words: UInt32[jax.Array, "words"], leaf: _Leaf) -> jax.Array:
    flat = words != 0 if leaf.dtype == _FLAG else jax.lax.bitcast_convert_type(words, leaf.dtype)
    return flat.reshape(leaf.shape)

"""Makes Arrow arrays of cells from the memory that NumPy holds: without an object an entry, and without a copy.

``pyarrow.array`` imports pandas to learn what it was given, and looks at each value.
"""

import itertools
from collections.abc import Sequence
from typing import cast

import numpy as np
import pyarrow as pa
from jaxtyping import Bool, Int

from specs.data.cells import Cells

_DTYPES = {pa.int32(): np.int32, pa.int64(): np.int64, pa.float64(): np.float64}


def arrow_array(cells: Cells, kind: pa.DataType) -> pa.Array:
    """Returns cells as Arrow has them.

    Args:
        cells: A column's.
        kind: Its Arrow type: a number, text or bool, or a list or map of them.

    Raises:
        ValueError: A number is none of that type.
    """
    if cells.lengths is None:
        return _flat(cells, kind)
    if not pa.types.is_map(kind):
        return _lists(cells.ends(), _flat(cells, cast("pa.ListType", kind).value_type), kind)
    found = cast("pa.MapType", kind)
    names = _flat(Cells(codes=cells.codes, labels=cells.labels), found.key_type)
    return _maps(cells.ends(), names, _flat(Cells(numbers=cells.numbers), found.item_type), found)


def arrow_mask(where: Bool[np.ndarray, " rows"]) -> pa.Array:
    """Returns which rows are meant, as Arrow filters by them."""
    return pa.Array.from_buffers(pa.bool_(), len(where), [None, _bits(where)])


def _flat(cells: Cells, kind: pa.DataType) -> pa.Array:
    """Returns one value an entry."""
    if cells.numbers is not None:
        return _numbers(cells.numbers, kind, cells.there)
    labels = _labels(cells.labels, kind)
    return labels if cells.codes is None else labels.take(_numbers(cells.codes, pa.int64()))


def _numbers(numbers: np.ndarray, kind: pa.DataType, there: Bool[np.ndarray, " rows"] | None = None) -> pa.Array:
    missing = None if there is None or there.all() else _bits(there)
    with np.errstate(invalid="ignore"):  # what is no integer is found below
        held = np.ascontiguousarray(numbers, _DTYPES[kind])
    other = held.dtype.kind == "i" and held.dtype != numbers.dtype
    if other and ((held != numbers) & (True if there is None else there)).any():
        raise ValueError(f"a number that is no {kind}")
    return pa.Array.from_buffers(kind, len(held), [missing, _memory(held)])


def _labels(labels: Sequence[object], kind: pa.DataType) -> pa.Array:
    """Returns what entries share; None where they have no value."""
    if pa.types.is_string(kind):
        return _texts(cast("Sequence[str]", labels))
    if pa.types.is_map(kind):
        return _mappings(cast("Sequence[Sequence[tuple[str, str]]]", labels), cast("pa.MapType", kind))
    there = np.array([label is not None for label in labels], np.bool_)
    if pa.types.is_boolean(kind):
        truth = _bits(np.array([label is True for label in labels], np.bool_))
        return pa.Array.from_buffers(kind, len(labels), [_bits(there), truth])
    return _numbers(np.array([0 if label is None else label for label in labels]), kind, there)


def _texts(texts: Sequence[str]) -> pa.Array:
    whole = "".join(texts)
    encoded = whole.encode()
    sizes = map(len, texts) if len(encoded) == len(whole) else (len(text.encode()) for text in texts)
    ends = np.fromiter(itertools.accumulate(sizes, initial=0), np.int32, len(texts) + 1)
    return pa.Array.from_buffers(pa.string(), len(texts), [None, _memory(ends), pa.py_buffer(encoded)])


def _mappings(labels: Sequence[Sequence[tuple[str, str]]], kind: pa.MapType) -> pa.Array:
    pairs = list(itertools.chain.from_iterable(labels))
    names, values = (_texts([pair[part] for pair in pairs]) for part in (0, 1))
    ends = np.fromiter(itertools.accumulate(map(len, labels), initial=0), np.int64, len(labels) + 1)
    return _maps(ends, names, values, kind)


def _maps(ends: Int[np.ndarray, " bounds"], names: pa.Array, values: pa.Array, kind: pa.MapType) -> pa.Array:
    entry = pa.struct([kind.key_field, kind.item_field])
    entries = pa.Array.from_buffers(entry, len(names), [None], children=[names, values])
    return _lists(ends, entries, kind)


def _lists(ends: Int[np.ndarray, " bounds"], entries: pa.Array, kind: pa.DataType) -> pa.Array:
    """Returns a row of entries between each two bounds."""
    return pa.Array.from_buffers(kind, len(ends) - 1, [None, _memory(ends.astype(np.int32))], children=[entries])


def _bits(where: Bool[np.ndarray, " rows"]) -> pa.Buffer:
    return _memory(np.packbits(where, bitorder="little"))


def _memory(array: np.ndarray) -> pa.Buffer:
    """Returns the memory of an array, which it keeps."""
    return pa.py_buffer(array)

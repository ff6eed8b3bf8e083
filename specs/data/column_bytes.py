"""Columns of results as bytes: a line of JSON that says what follows, and numbers in the shortest form that is exact.

Equal results have equal bytes. Who reads them believes nothing: not a size, not a code, not a text that a field cannot
have (docs/decisions/0040).
"""

from collections.abc import Iterator
from functools import cache, lru_cache
from typing import Annotated, Literal, cast

import numpy as np
from pydantic import Field, TypeAdapter

from specs.base import Spec
from specs.data.episode import EpisodeResult
from specs.data.episode_columns import RESULT_KINDS, CellKind, Cells, EpisodeColumns, canonical_cells

# Far more than a chunk has, and few enough for a column of one repeated value to be harmless.
_MOST_ROWS = 1 << 16
_INTS: tuple[tuple[str, type[np.signedinteger]], ...] = (("i1", np.int8), ("i2", np.int16), ("i4", np.int32))
_BEYOND = 1 << 31
# Chunk after chunk says the same of its fields.
_KNOWN_TEXTS = 256
_LEAVES = ("lengths", "codes", "numbers", "there")
# An equals sign says that one value stands for all rows.
_Form = Literal["i1", "i2", "i4", "f4", "f8", "=i1", "=i2", "=i4", "=f4", "=f8"]
_DTYPES = {form: np.dtype(f"<{form.strip('=')}") for form in ("i1", "i2", "i4", "f4", "f8")}


class _Column(Spec):
    """The forms of a column's arrays, in the order of their bytes, and its texts."""

    labels: tuple[str, ...] | None = None
    lengths: _Form | None = None
    codes: _Form | None = None
    numbers: _Form | None = None
    there: _Form | None = None


class _Head(Spec):
    """What stands in the first line."""

    rows: Annotated[int, Field(ge=0, le=_MOST_ROWS)]
    columns: dict[str, _Column]


def encode_columns(columns: EpisodeColumns) -> bytes:
    """Returns the bytes of results; of equal ones the same.

    Raises:
        OverflowError: A count has more than 32 bits.
    """
    heads: dict[str, _Column] = {}
    bodies: list[bytes] = []
    for name, given in columns.cells.items():
        cells = canonical_cells(given)
        forms: dict[str, str] = {}
        for leaf, array in _arrays(cells):
            alone = leaf == "lengths" or not RESULT_KINDS[name].many
            forms[leaf], body = _encoded(array, alone=alone)
            bodies.append(body)
        labels = None if cells.codes is None else cells.labels
        heads[name] = _Column.model_validate({"labels": labels, **forms})
    head = _Head(rows=columns.size, columns=heads).model_dump_json(exclude_none=True)
    return b"".join([head.encode(), b"\n", *bodies])


def decode_columns(body: bytes) -> EpisodeColumns:
    """Returns the results that bytes hold.

    Raises:
        ValueError: They hold none.
    """
    line, _, rest = body.partition(b"\n")
    head = _Head.model_validate_json(line)
    if not head.columns.keys() <= RESULT_KINDS.keys():
        raise ValueError("columns that no result has")
    reader = _Reader(rest, head.rows)
    with np.errstate(invalid="ignore"):  # of strangers' numbers that are none
        found = {name: _decoded(RESULT_KINDS[name], name, column, reader) for name, column in head.columns.items()}
    reader.require_end()
    return EpisodeColumns.with_defaults(found, head.rows)


class _Reader:
    """Reads arrays one after the other."""

    def __init__(self, body: bytes, rows: int) -> None:
        self.rows = rows
        self._body, self._at = body, 0

    def counts(self, form: str, size: int, *, below: int = _BEYOND, alone: bool = True) -> np.ndarray:
        """Returns the next array of counts, which are 0 or more and below another one."""
        found = self._next(form, size, alone=alone)
        low, high = _bounds(found)
        if len(found) and not 0 <= low <= high < below:
            raise ValueError("a count beyond what there is")
        return _whole(found, size, np.int64)

    def numbers(self, form: str, size: int, dtype: type[np.generic], *, alone: bool) -> np.ndarray:
        """Returns the next array of numbers; a field's whole ones are counts."""
        found = self._next(form, size, alone=alone)
        if found.dtype.kind == "i" and _bounds(found)[0] < 0:
            raise ValueError("a count below 0")
        return _whole(found, size, dtype)

    def _next(self, form: str, size: int, *, alone: bool) -> np.ndarray:
        """Returns what stands there; one value stands for all where there is one a row."""
        if form[0] == "=":
            if not alone:
                raise ValueError("one value for all entries of lists")
            form, size = form[1:], min(size, 1)
        dtype, at = _DTYPES[form], self._at
        self._at += size * dtype.itemsize
        if self._at > len(self._body):
            raise ValueError("less bytes than the first line says")
        return np.frombuffer(self._body, dtype, size, at) if size else np.zeros(0, dtype)

    def require_end(self) -> None:
        """Lets bytes pass that have all been read."""
        if self._at != len(self._body):
            raise ValueError("more bytes than the first line says")


def _decoded(kind: CellKind, name: str, column: _Column, reader: _Reader) -> Cells:
    forms = column.lengths, column.codes, column.numbers, column.there
    _check_forms(kind, forms, has_labels=column.labels is not None)
    lengths, size, labels = None, reader.rows, column.labels or ()
    if column.lengths:
        lengths = reader.counts(column.lengths, reader.rows)
        size = int(lengths.sum())
    codes = reader.counts(column.codes, size, below=len(labels), alone=not kind.many) if column.codes else None
    if len(set(labels)) < len(labels):  # else a name could come twice in a row under two codes
        raise ValueError("a text twice")
    if labels and _choices(name):
        _check_choices(name, labels)
    numbers = None
    if column.numbers:
        dtype = np.int64 if kind.number == "int" else np.float64
        numbers = reader.numbers(column.numbers, size * kind.width, dtype, alone=not kind.many)
        numbers = numbers.reshape(-1, kind.width) if kind.width > 1 else numbers
    there = reader.counts(column.there, size, below=2).astype(np.bool_) if column.there else None
    if codes is not None and lengths is not None and numbers is not None:
        _require_names_once(codes, lengths, len(labels))
    return Cells(numbers, codes, labels, lengths, there)


def _require_names_once(codes: np.ndarray, lengths: np.ndarray, labels: int) -> None:
    """Lets rows of named numbers pass in which no name comes twice."""
    if not len(codes):
        return
    named = np.repeat(np.arange(len(lengths)), lengths) * labels + codes
    if len(np.unique(named)) != len(named):
        raise ValueError("a name twice in a row")


@cache
def _check_forms(kind: CellKind, forms: tuple[str | None, ...], *, has_labels: bool) -> None:
    """Lets the forms of a field's arrays pass, given in the order of the arrays."""
    lengths, codes, numbers, there = forms
    if (bool(codes), has_labels, bool(numbers), bool(lengths)) != (kind.text, kind.text, bool(kind.number), kind.many):
        raise ValueError("a column with other arrays than its field has")
    if there and not kind.optional:
        raise ValueError("a column that lacks values")
    for form, is_float in ((lengths, False), (codes, False), (numbers, kind.number == "float"), (there, False)):
        if form and form.strip("=").startswith("f") != is_float:
            raise ValueError("an array of the wrong type")


@lru_cache(_KNOWN_TEXTS)
def _check_choices(name: str, labels: tuple[str, ...]) -> None:
    """Lets the texts pass of a field that may have a few alone."""
    cast("TypeAdapter[tuple[object, ...]]", _choices(name)).validate_python(labels)


@cache
def _choices(name: str) -> TypeAdapter[tuple[object, ...]] | None:
    """Returns what lets only those texts pass that a field may have; None if it may have any."""
    annotation: object = EpisodeResult.model_fields[name].annotation
    if annotation is str or RESULT_KINDS[name].many:
        return None
    return TypeAdapter(tuple[annotation, ...])  # pyright: ignore[reportInvalidTypeForm] - a field's type


def _bounds(found: np.ndarray) -> tuple[int, int]:
    """Returns the least and the largest of some counts; 0 of none."""
    if len(found) > 1:
        return np.minimum.reduce(found), np.maximum.reduce(found)  # a third of the time of the array's own methods
    alone = found.item() if len(found) else 0
    return alone, alone


def _whole(found: np.ndarray, size: int, dtype: type[np.generic]) -> np.ndarray:
    """Returns numbers of a type, one of them as often as there are entries."""
    if len(found) == size:
        return found.astype(dtype)
    whole = np.empty(size, dtype)
    whole.fill(found[0])
    return whole


def _arrays(cells: Cells) -> Iterator[tuple[str, np.ndarray]]:
    for leaf in _LEAVES:
        array = getattr(cells, leaf)
        if array is not None:
            yield leaf, array.reshape(-1)


def _encoded(array: np.ndarray, *, alone: bool) -> tuple[str, bytes]:
    """Returns the shortest exact form of an array, and its bytes; one value for all rows that are the same."""
    if array.dtype.kind == "f":
        form, whole = _short_floats(array)
    else:
        form, whole = _short_ints(array)
    body = np.ascontiguousarray(whole, _DTYPES[form]).tobytes()
    width = _DTYPES[form].itemsize
    if alone and len(array) > 1 and body == body[:width] * len(array):
        return f"={form}", body[:width]
    return form, body


def _short_floats(array: np.ndarray) -> tuple[str, np.ndarray]:
    with np.errstate(over="ignore", invalid="ignore"):
        short = array.astype(np.float32)
        again = short.astype(np.float64)
    return ("f4", short) if again.tobytes() == array.tobytes() else ("f8", array)


def _short_ints(array: np.ndarray) -> tuple[str, np.ndarray]:
    low, high = int(array.min(initial=0)), int(array.max(initial=0))
    for form, dtype in _INTS:
        bounds = np.iinfo(dtype)
        if bounds.min <= low and high <= bounds.max:
            return form, array.astype(dtype)
    raise OverflowError(f"{low} to {high}: at most 32 bits")

"""The fields of a result as cells: the kind of each follows from its type."""

import itertools
from collections.abc import Mapping, Sequence
from typing import Literal, NamedTuple, cast

import numpy as np

from specs.data.cells import Cells, label_cells
from specs.data.episode import EpisodeResult


class Kind(NamedTuple):
    """What a field holds.

    Attributes:
        number: Of what its numbers are, or nothing.
        text: Whether it holds texts: alone, or as names of its numbers.
        many: Whether a row has any number of entries.
        width: How many numbers an entry has.
        optional: Whether a row may have none.
    """

    number: Literal["", "int", "float"] = ""
    text: bool = False
    many: bool = False
    width: int = 1
    optional: bool = False


_KINDS: tuple[tuple[object, Kind], ...] = (
    (int, Kind("int")),
    (int | None, Kind("int", optional=True)),
    (float, Kind("float")),
    (float | None, Kind("float", optional=True)),
    (tuple[float, ...], Kind("float", many=True)),
    (tuple[str, ...], Kind(text=True, many=True)),
    (dict[str, float], Kind("float", text=True, many=True)),
    (tuple[tuple[float, float, float, float], ...], Kind("float", many=True, width=4)),
)


def _kind(annotation: object) -> Kind:
    return next((kind for known, kind in _KINDS if known == annotation), Kind(text=True))


RESULT_KINDS: Mapping[str, Kind] = {
    name: _kind(field.annotation) for name, field in EpisodeResult.model_fields.items()
}  # fmt: skip


def field_cells(kind: Kind, values: Sequence[object]) -> Cells:
    """Returns the values of a field as cells."""
    if not kind.many:
        return label_cells(values) if kind.text else _numbers(kind, values)
    entries = cast("Sequence[Sequence[object]]", values)
    lengths = [len(each) for each in entries]
    cells = label_cells(list(itertools.chain.from_iterable(entries)), lengths) if kind.text else Cells()
    if kind.number:
        inner = (cast("dict[str, float]", each).values() for each in entries) if kind.text else entries
        flat = np.array(list(itertools.chain.from_iterable(inner)), np.float64)
        cells = cells._replace(numbers=flat.reshape(-1, kind.width) if kind.width > 1 else flat)
    return cells._replace(lengths=np.array(lengths, np.int64))


def _numbers(kind: Kind, values: Sequence[object]) -> Cells:
    dtype = np.int64 if kind.number == "int" else np.float64
    if None not in values:
        return Cells(numbers=np.array(values, dtype))
    filled = np.array([0 if value is None else value for value in values], dtype)
    return Cells(numbers=filled, there=np.array([value is not None for value in values], np.bool_))


def field_values(kind: Kind, cells: Cells, size: int) -> Sequence[object]:
    """Returns the value of each row."""
    labels = [] if cells.codes is None else [cells.labels[code] for code in cells.codes.tolist()]
    numbers: list[object] = [] if cells.numbers is None else cells.numbers.tolist()
    if not kind.many:
        if cells.there is None:
            return labels if kind.text else numbers
        return [number if there else None for number, there in zip(numbers, cells.there.tolist(), strict=True)]
    ends = cells.ends().tolist()
    bounds = list(itertools.pairwise(ends))[:size]
    if kind.text and kind.number:
        return [dict(zip(labels[low:high], numbers[low:high], strict=True)) for low, high in bounds]
    flat = labels if kind.text else numbers
    return [tuple(flat[low:high]) for low, high in bounds]

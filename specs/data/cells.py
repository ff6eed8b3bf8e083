"""Columns of cells: numbers, texts or lists of them, held as arrays instead of an object a row."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

# A table of so many places a row costs less than sorting the rows.
_DENSE = 8

Numbers = Float[np.ndarray, " entries"] | Int[np.ndarray, " entries"] | Float[np.ndarray, "entries 4"]


class Cells(NamedTuple):
    """What a column holds.

    Attributes:
        numbers: Of all rows' entries, one after the other; None in a column without numbers.
        codes: Which label each entry has; None in a column without labels.
        labels: Texts, or what else entries share.
        lengths: How many entries each row has; None where each has one.
        there: Which rows have a value; None if all have.
    """

    numbers: Numbers | None = None
    codes: Int[np.ndarray, " entries"] | None = None
    labels: tuple[object, ...] = ()
    lengths: Int[np.ndarray, " rows"] | None = None
    there: Bool[np.ndarray, " rows"] | None = None

    def take(self, rows: Int[np.ndarray, " taken"]) -> "Cells":
        """Returns the cells of some rows, in their order."""
        entries = rows if self.lengths is None else _entries(self.lengths, rows)
        return Cells(
            numbers=None if self.numbers is None else self.numbers[entries],
            codes=None if self.codes is None else self.codes[entries],
            labels=self.labels,
            lengths=None if self.lengths is None else self.lengths[rows],
            there=None if self.there is None else self.there[rows],
        )

    def ends(self) -> Int[np.ndarray, " bounds"]:
        """Returns where the entries of each row of lists begin, and at the end how many there are."""
        lengths = np.zeros(0, np.int64) if self.lengths is None else self.lengths
        return np.concatenate([np.zeros(1, np.int64), np.cumsum(lengths, dtype=np.int64)])


def canonical_cells(cells: Cells) -> Cells:
    """Returns a column whose arrays follow from its values alone: labels once each, as they come; 0 where none is."""
    there = None if cells.there is None or cells.there.all() else cells.there
    numbers = cells.numbers if there is None or cells.numbers is None else np.where(there, cells.numbers, 0)
    if cells.codes is None:
        return cells._replace(numbers=numbers, there=there)
    used, first = np.unique(cells.codes, return_index=True)
    labels = [cells.labels[code] for code in used[np.argsort(first)].tolist()]
    if tuple(labels) == cells.labels and len(set(labels)) == len(labels):
        return cells._replace(numbers=numbers, there=there)
    place = {label: number for number, label in enumerate(dict.fromkeys(labels))}
    known = np.array([place.get(label, 0) for label in cells.labels], np.int64)
    return cells._replace(numbers=numbers, there=there, codes=known[cells.codes], labels=tuple(place))


def join_cells(parts: Sequence[Cells], rows: Sequence[int]) -> Cells:
    """Returns columns one below the other; a single one is returned as it is.

    Args:
        parts: Columns of one kind, at least one.
        rows: How many rows each has.
    """
    if len(parts) == 1:
        return parts[0]
    first, same = parts[0], all(part.labels == parts[0].labels for part in parts)
    labels = first.labels if same else tuple(dict.fromkeys(label for part in parts for label in part.labels))
    place = {label: number for number, label in enumerate(labels)}
    coded = [part.codes if same or part.codes is None else _coded(place, part.labels)[part.codes] for part in parts]
    return Cells(
        numbers=_joined([part.numbers for part in parts]),
        codes=_joined(coded),
        labels=labels,
        lengths=_joined([part.lengths for part in parts]),
        there=None if all(part.there is None for part in parts) else _presence(parts, rows),
    )


def _presence(parts: Sequence[Cells], rows: Sequence[int]) -> Bool[np.ndarray, " rows"]:
    """Returns which rows have a value."""
    known = [np.ones(n, np.bool_) if part.there is None else part.there for part, n in zip(parts, rows, strict=True)]
    return np.concatenate(known)


def _joined(parts: Sequence[np.ndarray | None]) -> np.ndarray | None:
    found = [part for part in parts if part is not None]
    return np.concatenate(found) if found else None


def label_cells(values: Sequence[object], lengths: Sequence[int] | None = None) -> Cells:
    """Returns a column of labels, each held once, in the order in which they come.

    Args:
        values: Of all entries.
        lengths: How many entries each row has; None for one.
    """
    place: dict[object, int] = {}
    codes = np.array([place.setdefault(value, len(place)) for value in values], np.int64)
    return Cells(codes=codes, labels=tuple(place), lengths=None if lengths is None else np.array(lengths, np.int64))


def distinct(columns: Sequence[Int[np.ndarray, " rows"]]) -> tuple[list[int], Int[np.ndarray, " rows"]]:
    """Returns the first row of each combination of codes, in the order in which they come, and each row's combination.

    Args:
        columns: Codes; at least one column.
    """
    first_column, *others = [column if column.min(initial=0) >= 0 else _compact(column)[0] for column in columns]
    joined, size = first_column, int(first_column.max(initial=0)) + 1
    for column in others:
        width = int(column.max(initial=0)) + 1
        if size * width > _DENSE * len(joined):
            joined, size = _compact(joined)
        joined, size = (joined * width + column, size * width) if width > 1 else (joined, size)
    if size > _DENSE * len(joined):
        joined, size = _compact(joined)
    # What is assigned last stays: the first row of each.
    first = np.full(size, -1)
    first[joined[::-1]] = np.arange(len(joined))[::-1]
    used = np.flatnonzero(first >= 0)
    used = used[np.argsort(first[used], kind="stable")]
    place = np.zeros(size, np.int64)
    place[used] = np.arange(len(used))
    return first[used].tolist(), place[joined]


def _compact(codes: Int[np.ndarray, " rows"]) -> tuple[Int[np.ndarray, " rows"], int]:
    """Returns codes of which none is left out, in the same order, and how many there are."""
    used, dense = np.unique(codes, return_inverse=True)
    return dense, len(used)


def _entries(lengths: Int[np.ndarray, " rows"], rows: Int[np.ndarray, " taken"]) -> Int[np.ndarray, " entries"]:
    starts, taken = np.cumsum(lengths) - lengths, lengths[rows]
    before = np.cumsum(taken) - taken
    return np.repeat(starts[rows] - before, taken) + np.arange(int(taken.sum()))


def _coded(place: dict[object, int], labels: Sequence[object]) -> Int[np.ndarray, " labels"]:
    return np.array([place[label] for label in labels], np.int64)

"""Episodes as columns: requests and results held as arrays instead of an object a row.

A column has cells: numbers, texts or lists of them.
"""

import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal, NamedTuple, Self, TypeVar, cast

import numpy as np
from jaxtyping import Bool, Float, Int

from specs.data.episode import EpisodeRequest, EpisodeResult

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


def distinct_cells(columns: Sequence[Int[np.ndarray, " rows"]]) -> tuple[list[int], Int[np.ndarray, " rows"]]:
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


class CellKind(NamedTuple):
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


_KINDS: tuple[tuple[object, CellKind], ...] = (
    (int, CellKind("int")),
    (int | None, CellKind("int", optional=True)),
    (float, CellKind("float")),
    (float | None, CellKind("float", optional=True)),
    (tuple[float, ...], CellKind("float", many=True)),
    (tuple[str, ...], CellKind(text=True, many=True)),
    (dict[str, float], CellKind("float", text=True, many=True)),
    (tuple[tuple[float, float, float, float], ...], CellKind("float", many=True, width=4)),
)


def _kind(annotation: object) -> CellKind:
    return next((kind for known, kind in _KINDS if known == annotation), CellKind(text=True))


RESULT_KINDS: Mapping[str, CellKind] = {
    name: _kind(field.annotation) for name, field in EpisodeResult.model_fields.items()
}  # fmt: skip


def field_cells(kind: CellKind, values: Sequence[object]) -> Cells:
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


def _numbers(kind: CellKind, values: Sequence[object]) -> Cells:
    dtype = np.int64 if kind.number == "int" else np.float64
    if None not in values:
        return Cells(numbers=np.array(values, dtype))
    filled = np.array([0 if value is None else value for value in values], dtype)
    return Cells(numbers=filled, there=np.array([value is not None for value in values], np.bool_))


def field_values(kind: CellKind, cells: Cells, size: int) -> Sequence[object]:
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


_ENDING = ("status", "outcome", "failure_code", "outcome_reason")


# A result's columns are the fields of ``EpisodeResult``; the kind of each follows from the field's type. Rows are
# made only of those that somebody looks at.
@dataclass(frozen=True, eq=False)
class EpisodeColumns:
    """Results of some episodes.

    Attributes:
        cells: By the field of ``EpisodeResult``.
        size: How many episodes.
    """

    cells: Mapping[str, Cells]
    size: int

    @classmethod
    def of(cls, rows: "Sequence[EpisodeResult] | EpisodeColumns") -> "EpisodeColumns":
        """Returns rows as columns.

        Raises:
            OverflowError: A number has more than 64 bits.
        """
        if isinstance(rows, EpisodeColumns):
            return rows
        columns = {name: [getattr(row, name) for row in rows] for name in RESULT_KINDS}
        return cls({name: field_cells(RESULT_KINDS[name], column) for name, column in columns.items()}, len(rows))

    @classmethod
    def with_defaults(cls, cells: Mapping[str, Cells], size: int) -> "EpisodeColumns":
        """Returns columns, and of fields that they lack those of the defaults.

        Raises:
            ValueError: One has none.
        """
        missing = {name: EpisodeResult.model_fields[name] for name in RESULT_KINDS.keys() - cells.keys()}
        if any(field.is_required() for field in missing.values()):
            raise ValueError("a column is missing")
        values = {name: field.get_default(call_default_factory=True) for name, field in missing.items()}
        found = {name: field_cells(RESULT_KINDS[name], [value] * size) for name, value in values.items()} | dict(cells)
        return cls({name: found[name] for name in RESULT_KINDS}, size)

    @classmethod
    def join(cls, parts: "Sequence[EpisodeColumns]") -> "EpisodeColumns":
        """Returns episodes one after the other."""
        if not parts:
            return cls.of([])
        sizes = [part.size for part in parts]
        return cls({name: join_cells([part.cells[name] for part in parts], sizes) for name in RESULT_KINDS}, sum(sizes))

    @cached_property
    def index(self) -> Int[np.ndarray, " rows"]:
        """Returns the episodes' positions in their batch."""
        return self.numbers("index").astype(np.int64)

    def numbers(self, name: str) -> np.ndarray:
        """Returns the numbers of a field that has them."""
        return cast("np.ndarray", self.cells[name].numbers)

    def codes(self, name: str) -> Int[np.ndarray, " entries"]:
        """Returns the codes of a field of texts."""
        return cast("np.ndarray", self.cells[name].codes)

    def labels(self, name: str) -> tuple[str, ...]:
        """Returns the texts of a field of texts, in no order, that some episode has."""
        cells = self.cells[name]
        return tuple(str(cells.labels[code]) for code in np.unique(self.codes(name)).tolist())

    def take(self, rows: Int[np.ndarray, " taken"]) -> "EpisodeColumns":
        """Returns some of the episodes, in the order of the rows."""
        return EpisodeColumns({name: cells.take(rows) for name, cells in self.cells.items()}, len(rows))

    def says(self, name: str, text: str) -> Bool[np.ndarray, " rows"]:
        """Returns which episodes have a text in a field that has one."""
        return np.array([label == text for label in self.cells[name].labels], np.bool_)[self.codes(name)]

    def marked(self, name: str, where: Bool[np.ndarray, " rows"], text: str) -> "EpisodeColumns":
        """Returns the episodes, some of them with another text in a field."""
        cells = self.cells[name]
        changed = cells._replace(
            codes=np.where(where, len(cells.labels), self.codes(name)), labels=(*cells.labels, text)
        )
        return EpisodeColumns({**self.cells, name: canonical_cells(changed)}, self.size)

    def renewed(self, later: "EpisodeColumns") -> "EpisodeColumns":
        """Returns the episodes, each as some others have it that have one of its index, in ascending order of these."""
        if not later.size and (np.diff(self.index) > 0).all():
            return self
        both = EpisodeColumns.join([later, self])
        return both.take(np.unique(both.index, return_index=True)[1])

    def at(self, index: Int[np.ndarray, " rows"]) -> "EpisodeColumns":
        """Returns the episodes at some positions in their batch.

        Raises:
            ValueError: One is not there.
        """
        if np.array_equal(self.index, index):
            return self
        order = np.argsort(self.index, kind="stable")
        place = np.searchsorted(self.index[order], index)
        if len(index) and (place.max() >= self.size or (self.index[order[place]] != index).any()):
            raise ValueError("results of other episodes")
        return self.take(order[place])

    def renumbered(self, index: Int[np.ndarray, " rows"]) -> "EpisodeColumns":
        """Returns the same episodes with other positions in their batch."""
        return EpisodeColumns({**self.cells, "index": Cells(numbers=index)}, self.size)

    def rows(self) -> list[EpisodeResult]:
        """Returns the episodes as rows."""
        return [EpisodeResult.model_validate(row) for row in self.fields()]

    def fields(self) -> Iterator[dict[str, Any]]:
        """Yields the fields of each row."""
        columns = [field_values(RESULT_KINDS[name], cells, self.size) for name, cells in self.cells.items()]
        return (dict(zip(self.cells, values, strict=True)) for values in zip(*columns, strict=True))

    @cached_property
    def endings(self) -> tuple[list[EpisodeResult], Int[np.ndarray, " rows"]]:
        """Returns an episode of each way to end, in the order in which they come, and which way each episode ended.

        They are as they stand here, whatever they say: who reads a chunk has checked them.
        """
        first, codes = distinct_cells([self.codes(name) for name in _ENDING])
        ways = self.take(np.array(first, np.int64))
        return [EpisodeResult.model_construct(**row) for row in ways.fields()], codes

    def of_ending(self, value: Callable[[EpisodeResult], object]) -> Cells:
        """Returns a column of something that follows from how an episode ended."""
        ways, codes = self.endings
        return Cells(codes=codes, labels=tuple(map(value, ways)))

    def __len__(self) -> int:
        """Returns how many episodes there are."""
        return self.size

    def __iter__(self) -> Iterator[EpisodeResult]:
        """Yields the episodes as rows."""
        return iter(self.rows())


@dataclass(frozen=True, eq=False)
class RequestColumns:
    """What was asked of some episodes.

    Attributes:
        index: Positions in the batch.
        seeds: Of each.
        worlds: Of each, as labels.
        launches: Requests that stand for all that differ from them in index, seed and world alone.
        launch: Which of them stands for each episode.
    """

    index: Int[np.ndarray, " rows"]
    seeds: Int[np.ndarray, " rows"]
    worlds: Cells
    launches: tuple[EpisodeRequest, ...]
    launch: Int[np.ndarray, " rows"]

    @classmethod
    def of(cls, requests: "Sequence[EpisodeRequest] | RequestColumns") -> "RequestColumns":
        """Returns requests as columns."""
        if isinstance(requests, RequestColumns):
            return requests
        place: dict[tuple[object, ...], int] = {}
        alike = [place.setdefault(_shared(each), len(place)) for each in requests]
        launches = dict(zip(reversed(alike), reversed(requests), strict=True))
        return cls(
            index=np.array([each.index for each in requests], np.int64),
            seeds=np.array([each.seed for each in requests], np.int64),
            worlds=label_cells([each.world for each in requests]),
            launches=tuple(launches[number] for number in range(len(place))),
            launch=np.array(alike, np.int64),
        )

    def take(self, rows: Int[np.ndarray, " taken"]) -> Self:
        """Returns some of the requests, in the order of the rows."""
        return type(self)(
            self.index[rows], self.seeds[rows], self.worlds.take(rows), self.launches, self.launch[rows]
        )  # fmt: skip

    def number_cells(self, name: Literal["index", "seeds"]) -> Cells:
        """Returns a column of positions in the batch, or of seeds."""
        return Cells(numbers=self.index if name == "index" else self.seeds)

    def named(self, prefix: str) -> Cells:
        """Returns a column of names: what they begin with, and each position in the batch."""
        return Cells(labels=tuple([f"{prefix}{index}" for index in self.index.tolist()]))

    def shared(self, value: Callable[[EpisodeRequest], object]) -> Cells:
        """Returns a column of what depends on neither index, seed nor world."""
        return Cells(codes=self.launch, labels=tuple(map(value, self.launches)))

    def __len__(self) -> int:
        """Returns how many requests there are."""
        return len(self.index)

    def __iter__(self) -> Iterator[EpisodeRequest]:
        """Yields the requests as rows."""
        codes = cast("np.ndarray", self.worlds.codes)
        columns = (self.index.tolist(), self.seeds.tolist(), codes.tolist(), self.launch.tolist())
        for index, seed, world, launch in zip(*columns, strict=True):
            asked = {"index": index, "seed": seed, "world": self.worlds.labels[world]}
            yield self.launches[launch].model_copy(update=asked)


_Columns = TypeVar("_Columns", RequestColumns, EpisodeColumns)


def pair_columns(
    requests: Sequence[EpisodeRequest] | RequestColumns, results: Sequence[EpisodeResult] | EpisodeColumns
) -> tuple[RequestColumns, EpisodeColumns]:
    """Returns requests and their results in the order of their indices.

    Raises:
        ValueError: An index comes twice, or a request has no result or the reverse.
    """
    asked, answered = RequestColumns.of(requests), EpisodeColumns.of(results)
    order, found = np.argsort(asked.index, kind="stable"), np.argsort(answered.index, kind="stable")
    ours, theirs = asked.index[order], answered.index[found]
    if len(ours) != len(theirs) or (ours != theirs).any() or (np.diff(ours) == 0).any():
        lone = np.setxor1d(ours, theirs)[:5].tolist()
        raise ValueError(
            f"{len(ours)} requests and {len(theirs)} results do not pair up; the first indices without a partner "
            f"are {lone}"
        )
    return _ordered(asked, order), _ordered(answered, found)


def _ordered(columns: _Columns, order: Int[np.ndarray, " rows"]) -> _Columns:
    return columns if (np.diff(order) == 1).all() else columns.take(order)


def _shared(request: EpisodeRequest) -> tuple[object, ...]:
    environment = tuple(request.environment.items())
    return request.robot, request.scenario, environment, request.duration_s, request.failure_behavior, request.number

"""Episodes as columns: their results as a chunk keeps them, and what was asked, without an object a row.

A result's columns are the fields of ``EpisodeResult``; the kind of each follows from the field's type. Rows are made
only of those that somebody looks at.
"""

import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal, NamedTuple, Self, TypeVar, cast

import numpy as np
from jaxtyping import Int

from specs.data.cells import Cells, distinct, join_cells, label_cells
from specs.data.episode import EpisodeRequest, EpisodeResult

_ENDING = ("status", "outcome", "failure_code", "outcome_reason")


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

    def renumbered(self, index: Int[np.ndarray, " rows"]) -> "EpisodeColumns":
        """Returns the same episodes with other positions in their batch."""
        return EpisodeColumns({**self.cells, "index": Cells(numbers=index)}, self.size)

    def rows(self) -> list[EpisodeResult]:
        """Returns the episodes as rows."""
        return [EpisodeResult.model_validate(row) for row in self.fields()]

    def fields(self) -> Iterator[dict[str, Any]]:
        """Yields the fields of each row."""
        columns = [_values(RESULT_KINDS[name], cells, self.size) for name, cells in self.cells.items()]
        return (dict(zip(self.cells, values, strict=True)) for values in zip(*columns, strict=True))

    @cached_property
    def endings(self) -> tuple[list[EpisodeResult], Int[np.ndarray, " rows"]]:
        """Returns an episode of each way to end, in the order in which they come, and which way each episode ended.

        They are as they stand here, whatever they say: who reads a chunk has checked them.
        """
        first, codes = distinct([self.codes(name) for name in _ENDING])
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

    def named(self, name: Callable[[int], str]) -> Cells:
        """Returns a column of names, made from each position in the batch."""
        return Cells(labels=tuple(map(name, self.index.tolist())))

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
    return request.robot, request.scenario, environment, request.duration_s, request.failure_behavior


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


def _values(kind: Kind, cells: Cells, size: int) -> Sequence[object]:
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

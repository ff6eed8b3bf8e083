"""Episodes as columns: their results as a chunk keeps them, and what was asked, without an object a row.

A result's columns are the fields of ``EpisodeResult``; the kind of each follows from the field's type. Rows are made
only of those that somebody looks at.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal, Self, TypeVar, cast

import numpy as np
from jaxtyping import Bool, Int

from specs.data.cells import Cells, canonical_cells, distinct, join_cells, label_cells
from specs.data.episode import EpisodeRequest, EpisodeResult
from specs.data.field_cells import RESULT_KINDS, field_cells, field_values

_ENDING = ("status", "outcome", "failure_code", "outcome_reason")


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
    return request.robot, request.scenario, environment, request.duration_s, request.failure_behavior

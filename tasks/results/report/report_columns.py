"""Reads a batch's tables as columns, and counts episodes by world, application, variable or room.

Narrow columns are read whole, wide ones only for the rows that are shown.
"""

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import cast

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
from jaxtyping import Float, Int

from specs.data.world import FloorZone, Room, World
from tasks.results.statistics.batch_summary import Ending, EpisodeGroup, count_endings
from tasks.results.statistics.room_coverage import ROOM_COLUMNS, RoomCoverage, table_coverage
from tasks.results.tables.history_rows import NOT_SET, Labels

PASSED, FAILED, CANCELED = 1, 0, -1
_COUNTED = ("world", "success", "environment", "final_x_m", "final_y_m")
_DIGEST, _DIGITS = "robot_digest", 12
_PEOPLE = "people"
_LAUNCHED = (
    *("robot_application", "robot_version", "robot_launch_file"),
    *("simulation_application", "simulation_version", "simulation_launch_file"),
)
_LISTED = (
    *("index", "world", "seed", "reason", "failure_reason", "simulated_s", "environment"),
    *("goals_reached", "goals_total", "final_x_m", "final_y_m", "late", "stray", "recording"),
)
# Of episodes of an hour these are some 60 MB.
_ROWS_AT_ONCE = 512
_WAY = ("trajectory_x_m", "trajectory_y_m")


@dataclass(frozen=True)
class Episodes:
    """The columns of ``results.parquet`` that a report counts.

    Attributes:
        outcome: PASSED, FAILED or CANCELED.
        world: In which world.
        application: Which robot application in which scenario.
        robot: SHA-256 of which robot application.
        final_m: Where it ended (x m, y m).
        variables: The value of each environment variable that was asked for.
    """

    outcome: Int[np.ndarray, " rows"]
    world: Labels
    application: Labels
    robot: Labels
    final_m: Float[np.ndarray, "rows 2"]
    variables: Mapping[str, Labels]


@dataclass(frozen=True)
class FailedEpisode:
    """An episode that did not pass, as a report lists it."""

    row: int
    index: int
    world: str
    seed: int
    reason: str
    failure_reason: str
    simulated_s: float
    goals_reached: int
    goals_total: int
    final_m: tuple[float, float]
    environment: Mapping[str, str]
    late: int | None
    stray: int | None
    recording: str


@dataclass(frozen=True)
class Failures:
    """The columns of ``failures.parquet`` that a report counts; `read_rows` gives rows of it.

    Attributes:
        table: Its narrow columns.
        world: In which world.
        reason: Why it did not pass.
        final_m: Where it ended (x m, y m).
    """

    table: pa.Table
    world: Labels
    reason: Labels
    final_m: Float[np.ndarray, "rows 2"]

    def read_rows(self, rows: Sequence[int]) -> list[FailedEpisode]:
        """Returns what is known of some failures."""
        found = self.table.take(pa.array(rows, pa.int64())).to_pylist()
        return [_failure(row, values) for row, values in zip(rows, found, strict=True)]


def read_episodes(path: Path, variables: Sequence[str]) -> Episodes:
    """Returns what is counted of ``results.parquet``.

    Args:
        path: The file.
        variables: Environment variables whose values are wanted.
    """
    table = pq.read_table(path, columns=[*_COUNTED, *_LAUNCHED, _DIGEST])
    success = table.column("success").cast(pa.int8()).fill_null(CANCELED)
    return Episodes(
        outcome=success.to_numpy().astype(np.int64),
        world=_labels(table.column("world")),
        application=_applications(table),
        robot=_labels(table.column(_DIGEST)),
        final_m=_points(table, "final_x_m", "final_y_m"),
        variables={name: _labels(_variable_values(table.column("environment"), name)) for name in variables},
    )


def read_coverage(path: Path) -> RoomCoverage | None:
    """Returns the rooms that robots were in, by ``results.parquet``; None if no episode started."""
    return table_coverage(pq.read_table(path, columns=list(ROOM_COLUMNS)))


def read_people(path: Path) -> tuple[int, ...]:
    """Returns how many people walked in an episode of ``results.parquet``, each number once, the least first."""
    if _PEOPLE not in pq.read_schema(path).names:  # tables were written before there were people
        return ()
    counts = pq.read_table(path, columns=[_PEOPLE]).column(_PEOPLE).unique().drop_null()
    return tuple(sorted(cast("list[int]", counts.to_pylist())))


def read_failures(path: Path) -> Failures:
    """Returns what is counted of ``failures.parquet``."""
    table = pq.read_table(path, columns=list(_LISTED))
    return Failures(
        table=table,
        world=_labels(table.column("world")),
        reason=_labels(table.column("reason")),
        final_m=_points(table, "final_x_m", "final_y_m"),
    )


def read_ways(path: Path, rows: Sequence[int]) -> dict[int, Float[np.ndarray, "poses 2"]]:
    """Returns where some failures went (x m, y m), by row; of the others no more is held in memory than some."""
    file, found, first = pq.ParquetFile(path), dict[int, Float[np.ndarray, "poses 2"]](), 0
    for group in range(file.num_row_groups):
        count = file.metadata.row_group(group).num_rows
        if any(first <= row < first + count for row in rows):
            found.update(_ways(file, group, first, frozenset(rows)))
        first += count
    return found


def _ways(
    file: pq.ParquetFile, group: int, first: int, rows: frozenset[int]
) -> Iterator[tuple[int, Float[np.ndarray, "poses 2"]]]:
    for batch in file.iter_batches(_ROWS_AT_ONCE, row_groups=[group], columns=list(_WAY)):
        wanted = [row for row in range(first, first + batch.num_rows) if row in rows]
        for row in wanted:
            x_m, y_m = (batch.column(name)[row - first].values.to_numpy() for name in _WAY)
            yield row, np.stack([x_m, y_m], axis=1)
        first += batch.num_rows


def _applications(table: pa.Table) -> Labels:
    """Returns each episode's applications, such as ``courier 1 go_to_goal in delivery 1 rooms``.

    Builds of one version are told apart by the beginning of their digests.
    """
    robot, scenario = (
        _joined([table.column(name).cast(pa.string()) for name in names], " ")
        for names in (_LAUNCHED[:3], _LAUNCHED[3:])
    )
    cut = pc.SliceOptions(0, _DIGITS)
    bundle = _joined(
        [robot, pc.call_function("utf8_slice_codeunits", [table.column(_DIGEST).cast(pa.string())], cut)], " "
    )
    if len(bundle.unique()) > len(robot.unique()):
        robot = bundle
    return _labels(_joined([robot, scenario], " in "))


def _joined(columns: Sequence[pa.ChunkedArray], between: str) -> pa.ChunkedArray:
    return pc.call_function("binary_join_element_wise", [*columns, between])


def _variable_values(words: pa.ChunkedArray, name: str) -> pa.ChunkedArray:
    return pc.call_function("map_lookup", [words], pc.MapLookupOptions(name, "first"))  # pyright: ignore[reportAttributeAccessIssue] - stubs


def _labels(column: pa.ChunkedArray) -> Labels:
    encoded = column.cast(pa.string()).fill_null(NOT_SET).combine_chunks().dictionary_encode()
    encoded = encoded.chunk(0) if isinstance(encoded, pa.ChunkedArray) else encoded
    names = cast("list[str]", encoded.dictionary.to_pylist())
    return Labels(tuple(names), encoded.indices.to_numpy(zero_copy_only=False).astype(np.int64))


def _points(table: pa.Table, x: str, y: str) -> Float[np.ndarray, "rows 2"]:
    return np.stack([table.column(x).to_numpy(), table.column(y).to_numpy()], axis=1)


def _failure(row: int, values: Mapping[str, object]) -> FailedEpisode:
    known = {name: value for name, value in values.items() if name not in {"environment", "final_x_m", "final_y_m"}}
    final_m = (cast("float", values["final_x_m"]), cast("float", values["final_y_m"]))
    environment = dict(cast("list[tuple[str, str]]", values["environment"]))
    return FailedEpisode(row=row, final_m=final_m, environment=environment, **known)  # pyright: ignore[reportArgumentType] - as the schema says


BETWEEN = "between rooms"
UNKNOWN = "not known"


@dataclass(frozen=True)
class DrivenWorlds:
    """A batch's worlds, as far as they can be read.

    Attributes:
        rooms: The rooms of each, or its zones, by ``<generation>/<name>``.
        load: Gives all of one of them; a batch has too many to hold them all.
        starts_m: Where a robot starts in those in which it is not the origin.
    """

    rooms: Mapping[str, Sequence[Room] | Sequence[FloorZone]]
    load: Callable[[str], World]
    starts_m: Mapping[str, tuple[float, float]] = field(default_factory=dict[str, tuple[float, float]])


def start_rooms(episodes: Episodes, worlds: DrivenWorlds) -> Labels:
    """Returns the type of the room that each episode starts in: the one around its world's start; a zone's name."""
    rooms, starts_m = worlds.rooms, worlds.starts_m
    kinds = [
        _room_types(rooms[name], np.array([starts_m.get(name, (0.0, 0.0))]))[0] if name in rooms else UNKNOWN
        for name in _names(episodes)
    ]
    return _as_labels(np.array(kinds, object)[episodes.world.codes])


def end_rooms(episodes: Episodes, worlds: DrivenWorlds) -> Labels:
    """Returns the type of the room that each episode ended in, or the zone's name; a doorway belongs to none."""
    found = np.full(len(episodes.outcome), UNKNOWN, object)
    order = np.argsort(episodes.world.codes, kind="stable")
    counts = np.bincount(episodes.world.codes, minlength=len(_names(episodes)))
    for name, end, count in zip(_names(episodes), np.cumsum(counts), counts, strict=True):
        rows = order[end - count : end]
        if name in worlds.rooms:
            found[rows] = _room_types(worlds.rooms[name], episodes.final_m[rows])
    return _as_labels(found)


def _names(episodes: Episodes) -> tuple[str, ...]:
    return episodes.world.names


def _room_types(rooms: Sequence[Room] | Sequence[FloorZone], points_m: Float[np.ndarray, "points 2"]) -> np.ndarray:
    found = np.full(len(points_m), BETWEEN, object)
    for room in rooms:
        found[room.holds(*points_m.T)] = room.type if isinstance(room, Room) else room.name
    return found


def _as_labels(names: np.ndarray) -> Labels:
    known, codes = np.unique(names.astype(str), return_inverse=True)
    kept: Int[np.ndarray, " rows"] = codes.astype(np.int64)
    return Labels(tuple(str(name) for name in known), kept)


def total_group(episodes: Episodes, confidence: float, looks: int) -> EpisodeGroup:
    """Returns all episodes as one group; arguments as for `group_episodes`."""
    labels = Labels(("all episodes",), np.zeros(len(episodes.outcome), np.int64))
    (group,) = group_episodes(episodes, labels, confidence, looks)
    return group


def group_episodes(episodes: Episodes, labels: Labels, confidence: float, looks: int) -> list[EpisodeGroup]:
    """Returns a group a label, in the labels' order, without their reasons.

    Args:
        episodes: The batch.
        labels: Which group each episode belongs to.
        confidence: Of each group's interval by itself.
        looks: At how many looks the batch might have been ended; 0 of one that was driven to its end.
    """
    kinds = {
        Ending(success, failed_job=False): _count(labels, episodes.outcome == code)
        for success, code in ((True, PASSED), (False, FAILED), (None, CANCELED))
    }
    return [
        EpisodeGroup.of_counts(
            label, count_endings({kind: counts[number] for kind, counts in kinds.items()}), confidence, looks=looks
        )
        for number, label in enumerate(labels.names)
    ]


def counts_by_world(episodes: Episodes, digests: Collection[str] = ()) -> tuple[list[int], list[int]]:
    """Returns of each world how many episodes passed, and how many came to an end.

    Args:
        episodes: The batch.
        digests: Robot applications whose episodes are meant; of none, all are.
    """
    codes = [code for code, name in enumerate(episodes.robot.names) if not digests or name in digests]
    meant = np.isin(episodes.robot.codes, codes)
    passed = _count(episodes.world, meant & (episodes.outcome == PASSED))
    return passed, _count(episodes.world, meant & (episodes.outcome != CANCELED))


def reasons_by_world(failures: Failures) -> dict[str, tuple[tuple[str, int], ...]]:
    """Returns why episodes did not pass, by world, most frequent first."""
    worlds, kinds = len(failures.world.names), len(failures.reason.names)
    both = failures.world.codes * kinds + failures.reason.codes
    counts = np.bincount(both, minlength=worlds * kinds).reshape(worlds, kinds)
    return {
        world: _most_frequent(zip(failures.reason.names, row.tolist(), strict=True))
        for world, row in zip(failures.world.names, counts, strict=True)
    }


def reasons(failures: Failures) -> tuple[tuple[str, int], ...]:
    """Returns why episodes did not pass, most frequent first."""
    counts = np.bincount(failures.reason.codes, minlength=len(failures.reason.names))
    return _most_frequent(zip(failures.reason.names, counts.tolist(), strict=True))


def _most_frequent(counts: Iterable[tuple[str, int]]) -> tuple[tuple[str, int], ...]:
    return tuple(sorted((pair for pair in counts if pair[1]), key=lambda pair: (-pair[1], pair[0])))


def _count(labels: Labels, rows: np.ndarray) -> list[int]:
    return np.bincount(labels.codes[rows], minlength=len(labels.names)).tolist()

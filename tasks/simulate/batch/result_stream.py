"""The results of a batch in the order of its jobs, some at a time, so that a large batch fits into memory.

What the jobs were asked for comes as columns, computed from the layout without an object a row. A batch that is stopped
while nobody works on it is given up here: its unfinished chunks are committed as Canceled.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from specs.data.episode import EpisodeResult, unfinished_result
from specs.data.episode_columns import Cells, EpisodeColumns, RequestColumns, distinct_cells
from specs.errors import ObjectNotFound
from tasks.simulate.batch.batch_record import STOP_CODES, OpenBatch, StopCode, canceled_jobs, canceled_row
from tasks.simulate.batch.chunk_store import chunk_numbers, commit_missing, committed_columns, counted_columns
from tasks.simulate.plan.episode_layout import Layout

# Some 40 MB if all of them failed and left long trajectories; as many as a row group of a table.
PART_EPISODES = 8192
# Each part of a shuffled batch is spread over all of its chunks, which are read again for the next one.
SHUFFLED_PART_EPISODES = 16_384


def result_parts(batch: OpenBatch, status: str) -> Iterator[tuple[RequestColumns, EpisodeColumns]]:
    """Yields a batch's episodes by index, some at a time, and a result for each.

    Episodes of a batch that was stopped before they began are Canceled.

    Args:
        batch: The batch.
        status: Its status; a batch that was stopped is not judged, so that its chunks are taken as they are.

    Raises:
        ObjectNotFound: A chunk of a batch that was not stopped is not committed.
        StageFailed: Nobody vouches for a chunk of a batch that was not stopped.
    """
    code = STOP_CODES.get(status, "")
    size = SHUFFLED_PART_EPISODES if batch.plan.shuffled else PART_EPISODES
    last: dict[int, EpisodeColumns | None] = {}
    for first in range(0, batch.layout.episodes, size):
        end = min(first + size, batch.layout.episodes)
        yield request_columns(batch.layout, first, end), _results(batch, first, end, code, last)


def _results(
    batch: OpenBatch, first: int, end: int, code: StopCode, last: dict[int, EpisodeColumns | None]
) -> EpisodeColumns:
    """Returns the results of a stretch of episodes; ``last`` keeps the one chunk that the next stretch begins in."""
    found: list[EpisodeColumns] = []
    for number in batch.layout.chunks_between(first, end):
        columns = last.get(number) or _columns(batch, number, code)
        last.clear()
        last[number] = columns
        if columns is None and not code:
            raise ObjectNotFound(f"{batch.store.url}: chunk {number} of {batch.id} is not committed")
        if columns is not None:
            inside = (columns.index >= first) & (columns.index < end)
            found.append(columns if inside.all() else columns.take(np.flatnonzero(inside)))
    return _in_order(found, first, end, code)


def _in_order(found: Sequence[EpisodeColumns], first: int, end: int, code: StopCode) -> EpisodeColumns:
    """Returns a result for each index: the last that says it, or that it was canceled."""
    rows = EpisodeColumns.join(found)
    place = np.full(end - first, -1)
    place[rows.index - first] = np.arange(len(rows))
    missing = np.flatnonzero(place < 0)
    if len(missing):
        place[missing] = len(rows) + np.arange(len(missing))
        canceled = EpisodeColumns.of([canceled_row(index, code) for index in (missing + first).tolist()])
        rows = EpisodeColumns.join([rows, canceled])
    return rows if np.array_equal(place, np.arange(len(rows))) else rows.take(place)


def _columns(batch: OpenBatch, number: int, code: StopCode) -> EpisodeColumns | None:
    if code:
        return committed_columns(batch.store, batch.id, number)
    return counted_columns(batch.store, batch.id, number, batch.authenticator)


def give_up(batch: OpenBatch) -> None:
    """Commits the chunks that were begun and have no end: their episodes are Canceled.

    From then on a process that was only paused, and still simulates one of them, comes too late: a chunk is committed
    once. What was never begun needs no row, for who looks at the batch's record begins nothing any more.

    Args:
        batch: In a state that stops it; its claim is held.
    """
    record = batch.record()
    code, alone = STOP_CODES[record.status], canceled_jobs(record)
    chunks = chunk_numbers(batch.store, batch.id)
    for number in sorted(chunks.begun - chunks.committed):
        rows = [_row(request.index, code, alone) for request in batch.layout.chunk(number).requests]
        commit_missing(batch.store, batch.id, number, rows, batch.authenticator)


def _row(index: int, code: StopCode, alone: frozenset[int]) -> EpisodeResult:
    if index in alone:
        return unfinished_result(index, "Canceled", failure_code="", failure_reason="the job was canceled")
    return canceled_row(index, code)


def request_columns(layout: Layout, first: int, end: int) -> RequestColumns:
    """Returns the episodes from ``first`` to before ``end``.

    Args:
        layout: The batch's.
        first: Position of the first one.
        end: Position after the last one.
    """
    plan, offsets, index = layout.plan, np.array(layout.offsets), np.arange(first, end)
    template = np.searchsorted(offsets, index, side="right") - 1
    rest, turn = np.divmod(index - offsets[template], layout.turns)
    seed, number = np.divmod(turn, plan.sharing)
    world, setting = np.divmod(rest, layout.settings)
    worlds = [plan.worlds_of(asked) for asked in plan.templates]
    place = {name: number for number, name in enumerate(dict.fromkeys(name for names in worlds for name in names))}
    codes = np.array([place[name] for names in worlds for name in names], np.int64)
    starts = np.cumsum([0, *map(len, worlds)])
    own = np.array([-1 if asked.seed is None else asked.seed for asked in plan.templates], np.int64)
    launches, launch = distinct_cells([template, setting, number])
    return RequestColumns(
        index=index,
        seeds=np.where(own[template] < 0, np.array(plan.seeds, np.int64)[seed], own[template]),
        worlds=Cells(codes=codes[starts[template] + world], labels=tuple(place)),
        launches=tuple(layout.request(first + row) for row in launches),
        launch=launch,
    )

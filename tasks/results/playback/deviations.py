"""Compares a replay with what was recorded, column by column, to the last bit."""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import cast

import pyarrow as pa

from specs.base import Spec
from specs.data.episode import EpisodeRequest, EpisodeResult, success
from tasks.results.tables.tables import failures_table, results_table

# Says where the recording lies, and nothing of what happened.
_PLACE = "recording"


class ColumnDeviation(Spec):
    """One column of what was recorded, beside the same column of the replay.

    Attributes:
        column: Its name; ``recording.`` and a name for one of the recording.
        unit: Its unit, or empty.
        recorded: Its value for a person; of a recording how many samples there are.
        replayed: The same of the replay.
        same: Whether all of it is the same, to the last bit.
        most: The largest difference of two numbers; infinite where there is no such thing, as between two words.
    """

    column: str
    unit: str
    recorded: str
    replayed: str
    same: bool
    most: float


def row_deviations(
    recorded: pa.Table, batch_id: str, request: EpisodeRequest, row: EpisodeResult
) -> list[ColumnDeviation]:
    """Returns each column of an episode's row beside the replay's.

    Args:
        recorded: The row of results.parquet or failures.parquet. Columns that this version does not know are left out.
        batch_id: The batch.
        request: What the episode was asked for.
        row: What came of it this time.
    """
    table = failures_table if "trajectory_t_s" in recorded.column_names and success(row) is False else results_table
    again = table(batch_id, [request], [row])
    names = [name for name in recorded.column_names if name != _PLACE and name in again.column_names]
    return [_deviation(name, name, recorded, again) for name in names]


def recording_deviations(recorded: pa.Table, again: pa.Table) -> list[ColumnDeviation]:
    """Returns each column of an episode's recording beside the replay's."""
    names = [name for name in recorded.column_names if name in again.column_names]
    return [_deviation(f"recording.{name}", name, recorded, again) for name in names]


def _deviation(shown: str, name: str, recorded: pa.Table, again: pa.Table) -> ColumnDeviation:
    before, after = recorded.column(name).to_pylist(), again.column(name).to_pylist()
    metadata = cast("Mapping[bytes, bytes]", again.schema.field(name).metadata or {})
    # As text, so that -0.0 is not 0.0, and what is no number is itself.
    same = repr(before) == repr(after)
    return ColumnDeviation(
        column=shown,
        unit=metadata.get(b"unit", b"").decode(),
        recorded=_text(before),
        replayed=_text(after),
        same=same,
        most=0.0 if same else _largest_difference(before, after),
    )


def _text(values: Sequence[object]) -> str:
    if len(values) != 1:
        return f"{len(values)} samples"
    value = values[0]
    if isinstance(value, list):
        number = len(cast("list[object]", value))
        return f"{number} value" if number == 1 else f"{number} values"
    return f"{value:.9g}" if isinstance(value, float) else str(value)


def _largest_difference(before: object, after: object) -> float:
    """Returns the largest difference of two numbers at the same place; infinite if the rest is not the same."""
    apart = [abs(one - other) for one, other in _pairs(before, after)]
    return max((each if not math.isnan(each) else math.inf for each in apart), default=math.inf)


def _pairs(before: object, after: object) -> Iterator[tuple[float, float]]:
    if isinstance(before, list | tuple) and isinstance(after, list | tuple):
        ours, theirs = cast("Sequence[object]", before), cast("Sequence[object]", after)
        yield from _paired_items(ours, theirs) if len(ours) == len(theirs) else [(0.0, math.inf)]
    elif isinstance(before, int | float) and isinstance(after, int | float) and not isinstance(before, bool):
        yield before, after
    elif before != after:
        yield 0.0, math.inf


def _paired_items(before: Iterable[object], after: Iterable[object]) -> Iterator[tuple[float, float]]:
    for one, other in zip(before, after, strict=True):
        yield from _pairs(one, other)

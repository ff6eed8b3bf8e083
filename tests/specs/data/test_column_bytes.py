"""Results keep their bits as columns, equal ones have equal bytes, and bytes of strangers are read and not believed."""

import json
import math
from collections.abc import Callable
from contextlib import suppress

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from specs.data.column_bytes import decode_columns, encode_columns
from specs.data.episode import EpisodeRequest, EpisodeResult
from specs.data.episode_columns import RESULT_KINDS, EpisodeColumns, RequestColumns, pair_columns
from tests.factories.episodes import canceled, collided, crashed, episodes, passed, request

ROWS = [passed(0), collided(1), crashed(2), canceled(3)]
FULL = passed(4).model_copy(
    update={
        "shortest_path_m": None,
        "spl": None,
        "late": 3,
        "odometry_error_m": 0.1,
        "min_clearance_m": math.nan,
        "energy_j": -0.0,
        "impulse_ns": math.inf,
        "goal_times_s": (0.05, 0.1),
        "metrics": {"turns": 2.0, "bumps": 0.1},
        "rooms_entered": ("Hall", "Kitchen", "Hall"),
        "failure_reason": 'umlaut ä, a line\nand a quote "',
    }
)


def again(rows: list[EpisodeResult]) -> list[EpisodeResult]:
    return decode_columns(encode_columns(EpisodeColumns.of(rows))).rows()


@given(episodes())
def test_rows_come_back_as_they_were(drawn: tuple[list[EpisodeRequest], list[EpisodeResult]]):
    rows = [*drawn[1]]
    assert list(map(repr, again(rows))) == list(map(repr, rows))


@given(st.lists(st.floats(), min_size=1, max_size=5), st.lists(st.dictionaries(st.text(), st.floats())))
def test_each_bit_of_a_number_and_each_name_comes_back(numbers: list[float], metrics: list[dict[str, float]]):
    rows = [FULL.model_copy(update={"energy_j": each}) for each in numbers]
    rows += [FULL.model_copy(update={"metrics": each}) for each in metrics]
    assert list(map(repr, again(rows))) == list(map(repr, rows))


@pytest.mark.parametrize("name", ["rooms_total", "goals_reached", "collisions", "late"])
def test_what_is_counted_is_not_below_0(name: str):
    columns = EpisodeColumns.of([passed(0), FULL.model_copy(update={name: -100})])
    with pytest.raises(ValueError, match="below 0"):
        decode_columns(encode_columns(columns))


def test_equal_results_have_equal_bytes_whatever_they_were_made_of():
    whole = EpisodeColumns.of([*ROWS, FULL])
    joined = EpisodeColumns.join([EpisodeColumns.of(ROWS), EpisodeColumns.of([FULL])])
    assert encode_columns(joined) == encode_columns(whole)
    assert encode_columns(decode_columns(encode_columns(whole))) == encode_columns(whole)


def test_labels_that_nobody_has_or_that_come_twice_and_numbers_that_are_not_there_change_no_byte():
    whole = EpisodeColumns.of([*ROWS, FULL])
    cells = dict(whole.cells)
    labels = cells["status"].labels
    cells["status"] = cells["status"]._replace(codes=whole.codes("status") + 1, labels=("Canceled", *labels, "Failed"))
    lacking = ~np.asarray(cells["spl"].there)
    cells["spl"] = cells["spl"]._replace(numbers=np.where(lacking, 7.0, whole.numbers("spl")))
    cells["energy_j"] = cells["energy_j"]._replace(there=np.ones(len(whole), np.bool_))
    assert encode_columns(EpisodeColumns(cells, len(whole))) == encode_columns(whole)
    assert encode_columns(whole.take(np.arange(1, 3))) == encode_columns(EpisodeColumns.of(ROWS[1:3]))


def test_a_name_twice_in_a_row_is_refused():
    columns = EpisodeColumns.of([FULL])
    twice = columns.cells["metrics"]._replace(labels=("turns", "turns"), codes=np.zeros(2, np.int64))
    with pytest.raises(ValueError, match="a name twice in a row"):
        decode_columns(encode_columns(EpisodeColumns({**columns.cells, "metrics": twice}, 1)))


def test_rows_that_are_renewed_marked_and_put_in_order_are_those_that_were_asked_for():
    columns = EpisodeColumns.of([collided(2), passed(0), crashed(1)])
    renewed = columns.renewed(EpisodeColumns.of([passed(2)]))
    assert renewed.rows() == [passed(0), crashed(1), passed(2)]
    assert renewed.at(np.array([2, 0])).rows() == [passed(2), passed(0)]
    marked = columns.marked("recording", ~columns.says("status", "Completed"), "000000.parquet").rows()
    assert [row.recording for row in marked] == ["", "", "000000.parquet"]
    for other in ([0, 3], [5], [-1]):
        with pytest.raises(ValueError, match="results of other episodes"):
            columns.at(np.array(other))


def test_columns_without_rows_come_back():
    assert again([]) == []


def test_every_field_of_a_result_has_its_kind():
    assert RESULT_KINDS.keys() == EpisodeResult.model_fields.keys()
    assert {name for name, kind in RESULT_KINDS.items() if kind.optional} == {
        name
        for name, field in EpisodeResult.model_fields.items()
        if type(None) in getattr(field.annotation, "__args__", ())
    }


def test_a_column_that_an_older_version_lacks_has_the_default():
    whole = EpisodeColumns.of(ROWS)
    older = EpisodeColumns({name: cells for name, cells in whole.cells.items() if name != "metrics"}, len(whole))
    assert decode_columns(encode_columns(older)).rows() == ROWS


def changed(body: bytes, change: Callable[[dict[str, object]], None]) -> bytes:
    line, _, rest = body.partition(b"\n")
    head = json.loads(line)
    change(head)
    return json.dumps(head).encode() + b"\n" + rest


def _set(name: str, **values: object) -> Callable[[dict[str, object]], None]:
    def change(head: dict[str, object]) -> None:
        head["columns"][name].update(values)  # pyright: ignore[reportIndexIssue] - JSON

    return change


@pytest.mark.parametrize(
    "change",
    [
        _set("status", labels=["Finished"]),
        _set("status", labels=[]),
        _set("outcome_reason", labels=["", "tired"]),
        _set("status", labels=["Completed", "Completed", "Failed", "Canceled"]),
        _set("metrics", labels=["turns", "turns"]),
        _set("status", labels=None),
        _set("status", codes="f4"),
        _set("path_length_m", numbers="i4"),
        _set("path_length_m", there="=i1"),
        _set("path_length_m", numbers="object"),
        _set("trajectory", numbers="=f4"),
        _set("rooms_entered", codes="=i1"),
        _set("trajectory", lengths="=i1"),
        _set("index", lengths="=i1"),
        lambda head: head.update(rows=6),
        lambda head: head.update(rows=-1),
        lambda head: head.update(rows=1 << 40),
        lambda head: head.update(more=1),
        lambda head: head["columns"].update(bonus={"numbers": "=f8"}),  # pyright: ignore[reportAttributeAccessIssue]
        lambda head: head["columns"].pop("status"),  # pyright: ignore[reportAttributeAccessIssue]
    ],
)
def test_what_a_stranger_writes_is_refused(change: Callable[[dict[str, object]], None]):
    body = encode_columns(EpisodeColumns.of([*ROWS, FULL]))
    with pytest.raises(ValueError):  # noqa: PT011 - each says something else
        decode_columns(changed(body, change))


def test_no_changed_byte_ends_the_process():
    whole = encode_columns(EpisodeColumns.of([*ROWS, FULL]))
    for place in range(0, len(whole), 7):
        changed = whole[:place] + bytes([whole[place] ^ 0xA5]) + whole[place + 1 :]
        for read in (changed, whole[:place]):
            with suppress(ValueError):
                decode_columns(read).rows()


def test_requests_come_back_and_share_what_only_index_seed_and_world_tell_apart():
    asked = [
        request(index, seed=index, world=f"w/{index % 2}", environment={"A": str(index // 4)}) for index in range(8)
    ]
    columns = RequestColumns.of(asked)
    assert [*columns] == asked
    assert len(columns.launches) == 2


def test_pairs_come_in_the_order_of_their_indices():
    asked, answered = pair_columns([request(index) for index in (2, 0, 1)], [passed(1), collided(2), crashed(0)])
    assert [each.index for each in asked] == [0, 1, 2]
    assert [row.index for row in answered] == [0, 1, 2]

"""Whole episodes of the shipped courier and delivery, and what their rows say."""

import functools
import logging
from pathlib import Path

import jax
import numpy as np
import pytest

from specs.data.episode import EpisodeResult
from specs.data.world import World
from tasks.simulate.chunk.byproducts import recall_timings
from tasks.simulate.plan.chunks import Chunk, program_key
from tests.factories.simulations import delivery, pushing, simulate_lanes
from tests.factories.worlds import PAINT, box
from tests.simulate.conftest import FOLDERS, LANES, PUSHER_LANES, Simulate

GOALS = 2
COMPILED = "Finished XLA compilation"


@pytest.fixture(scope="module")
def rows(deliver: Simulate) -> list[EpisodeResult]:
    return deliver([delivery(k, world=f"hand/apartment-{k % 4}", seed=100 + k) for k in range(LANES)])


@pytest.mark.long
def test_the_courier_delivers_in_cluttered_apartments(rows: list[EpisodeResult]):
    assert sum(row.outcome == "Passed" for row in rows) >= LANES - 1


def test_rows_come_in_the_order_of_the_requests(rows: list[EpisodeResult]):
    assert [row.index for row in rows] == list(range(LANES))


def test_what_is_passed_reached_all_goals_and_hit_nothing(rows: list[EpisodeResult]):
    for row in (row for row in rows if row.outcome == "Passed"):
        assert (row.status, row.failure_code, row.outcome_reason) == ("Completed", "", "")
        assert row.goals_reached == row.goals_total == GOALS
        assert row.simulated_s < 60.0
        assert row.min_clearance_m > 0.0
        assert row.trajectory == ()


def test_a_path_is_longer_than_the_shortest_by_what_spl_says(rows: list[EpisodeResult]):
    for row in (row for row in rows if row.outcome == "Passed"):
        assert row.shortest_path_m is not None
        assert row.shortest_path_m < row.path_length_m < 1.5 * row.shortest_path_m
        assert row.spl == row.shortest_path_m / row.path_length_m


def test_goals_are_reached_one_after_the_other(rows: list[EpisodeResult]):
    for row in (row for row in rows if row.outcome == "Passed"):
        first, last = row.goal_times_s
        assert 0.0 < first < last == row.simulated_s


def test_a_robot_that_touches_nothing_gets_no_impulse(rows: list[EpisodeResult]):
    for row in rows:
        assert (row.impulse_ns == 0.0) == (row.max_impulse_ns == 0.0) == (row.collisions == 0)
        assert row.max_impulse_ns <= row.impulse_ns


@pytest.mark.long
def test_episodes_with_more_goals_run_beside_those_with_fewer(deliver: Simulate, rows: list[EpisodeResult]):
    mixed = [
        delivery(k, world="hand/apartment-0", seed=100, duration_s=2.0).model_copy(
            update={"environment": {"MAX_SPEED": "0.6", "GOALS": goals}}
        )
        for k, goals in enumerate(["2", "3", "2"])
    ]
    found = deliver(mixed)
    assert [row.goals_total for row in found] == [2, 3, 2]
    assert found[0].model_copy(update={"index": 2}) == found[2]
    assert found[0] == deliver(mixed[:1])[0]


def test_a_delivery_to_other_rooms_enters_them(rows: list[EpisodeResult]):
    for row in (row for row in rows if row.outcome == "Passed"):
        assert row.rooms_entered == ("Living room", "Kitchen")
        assert (row.rooms_total, row.rooms_unreachable) == (2, ())
        assert row.goals_reachable == GOALS


def test_a_delivery_behind_a_shut_door_stays_in_its_room(deliver: Simulate, apartments: dict[str, World]):
    world = apartments["hand/apartment-0"]
    leaf = box("leaf", (2.5, 0.05, 0.0), (2.6, 0.95, 2.0), PAINT)
    shut = {"hand/shut": world.model_copy(update={"walls": (*world.walls, leaf)})}
    (row,) = deliver([delivery(0, world="hand/shut", seed=100)], shut)
    assert row.outcome == "Passed"
    assert (row.rooms_entered, row.rooms_unreachable) == (("Living room",), ("Kitchen",))


def test_driving_costs_energy(rows: list[EpisodeResult]):
    # 2 kg brought to 0.6 m/s hold 0.36 J.
    assert all(row.energy_j > 0.3 for row in rows)


def test_another_world_compiles_nothing(
    deliver: Simulate, apartments: dict[str, World], rows: list[EpisodeResult], caplog: pytest.LogCaptureFixture
):
    worlds = {**apartments, "hand/another": apartments["hand/apartment-0"]}
    with jax.log_compiles(), caplog.at_level(logging.WARNING, logger="jax"):
        again = deliver([delivery(0, world="hand/another", seed=100)], worlds=worlds)
        compiled = [record.message for record in caplog.records if COMPILED in record.message]
        jax.jit(lambda x: 3 * x)(1.0)
    assert again == rows[:1]
    assert not compiled
    assert any(COMPILED in record.message for record in caplog.records)  # JAX still says so in these words


def test_numbers_of_rows_are_finite(rows: list[EpisodeResult]):
    for row in rows:
        numbers = [value for value in row.model_dump().values() if isinstance(value, float)]
        assert np.isfinite(numbers).all()


def test_progress_counts_the_episodes_that_are_done(pens: dict[str, World]):
    told: list[int] = []
    chunk = Chunk(number=0, requests=(pushing(0, world="hand/pen-0", duration_s=1.0), pushing(1, world="hand/pen-0")))
    simulate_lanes(chunk, pens, FOLDERS, lanes=PUSHER_LANES, should_stop=lambda: False, progress=told.append)
    assert told == sorted(told)
    assert (told[0], told[-1]) == (1, 2)


def test_what_a_chunk_took_is_remembered_for_the_program_that_plans_know(
    pens: dict[str, World], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setenv("SIMYARD_CACHE", str(tmp_path))
    chunk = Chunk(number=0, requests=(pushing(0, world="hand/pen-0"),))
    ran = functools.partial(simulate_lanes, chunk, pens, FOLDERS, lanes=PUSHER_LANES, should_stop=lambda: False)
    ran(timed_as=("planned",))
    assert len(recall_timings(("planned",))) == 1
    assert recall_timings(program_key(chunk.requests[0])) == []
    ran()
    assert len(recall_timings(program_key(chunk.requests[0]))) == 1

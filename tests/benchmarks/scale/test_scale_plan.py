"""The simulated cluster: what it must agree with where the answer is known."""

import numpy as np
import pytest

from benchmarks.scale import scale_plan
from benchmarks.scale.scale_costs import Costs
from benchmarks.scale.scale_plan import Cluster, first_to_break, plan_table, simulate

FREE = Costs(
    writes=4, reads=6, chunk_bytes=1, record_bytes=1, rows_per_s=1e12, row_bytes=1, driver_s=0, worker_s=0, server_s=0
)


@pytest.fixture(autouse=True)
def steady(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scale_plan, "_SPREAD", 0.0)
    monkeypatch.setattr(scale_plan, "_RECLAIMED_AN_HOUR", 1e-9)


def rng() -> np.random.Generator:
    return np.random.default_rng(1)


def test_workers_that_cost_nothing_beside_episodes_share_them_evenly() -> None:
    made = simulate(Cluster(10, 1000, 4.0), FREE, rng())
    assert made.episodes_s == pytest.approx(400.0, rel=0.05)
    assert made.busy == pytest.approx(1.0, rel=0.05)
    assert (made.writes, made.reads, made.lost) == (4000, 6000, 0)


def test_what_a_task_run_takes_of_a_worker_is_paid_for_each_piece() -> None:
    made = simulate(Cluster(1, 300, 1.0), FREE._replace(worker_s=5.0), rng())
    assert made.episodes_s == pytest.approx(300.0 + 5.0 * made.task_runs)
    assert made.task_runs < 40  # pieces of fifteen seconds


def test_a_flow_that_does_one_thing_at_a_time_holds_up_all_workers() -> None:
    made = simulate(Cluster(1000, 5000, 15.0), FREE._replace(driver_s=1.0), rng())
    assert made.episodes_s >= made.task_runs
    assert made.driver == pytest.approx(1.0, rel=0.05)
    assert "the flow's process" in first_to_break(made)


def test_what_a_reclaimed_worker_had_is_done_by_another(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scale_plan, "_RECLAIMED_AN_HOUR", 60.0)  # one a minute
    made = simulate(Cluster(10, 1000, 4.0), FREE, rng())
    assert made.lost > 20
    assert made.busy * 10 * made.episodes_s == pytest.approx(4000.0)
    assert made.episodes_s > 420.0


@pytest.mark.parametrize(
    ("cost", "broken"),
    [
        (FREE._replace(rows_per_s=1000.0), "writing the tables"),
        (FREE._replace(server_s=100.0), "Prefect's server"),
        (FREE._replace(writes=1e9), "S3, writing"),
        (FREE._replace(reads=1e9), "S3, reading"),
    ],
)
def test_what_is_nearest_to_its_limit_is_named(cost: Costs, broken: str) -> None:
    assert broken in first_to_break(simulate(Cluster(10, 100, 4.0), cost, rng()))


def test_the_table_has_a_row_for_each_number_of_workers(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scale_plan, "EPISODES", 25_600)
    assert plan_table(FREE).count("\n") == 1 + 2 * 4

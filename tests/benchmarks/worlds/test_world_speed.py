"""The speed figures of world generation are put together as they say."""

import os

import pytest

from benchmarks.worlds.world_memory import measure_memory
from benchmarks.worlds.world_speed import STAGES, WORKERS, Case, Rate, _cores, measure_rate, measure_stages
from benchmarks.worlds.world_tables import speed_table
from benchmarks.worlds.world_templates import AIMS_PER_S, SPEED_TEMPLATES
from tasks.worlds import generate

pytestmark = pytest.mark.long


def test_stages_add_up_and_leave_the_generator_as_it_was() -> None:
    before = {name: getattr(generate, name) for names in STAGES.values() for name in names}
    spent_ms = measure_stages("default-one-living-room", 2, 4)
    whole = spent_ms.pop("all")
    assert list(spent_ms) == ["plan", "interior", "certificate", "rest", "encoding"]
    assert all(ms > 0 for ms in spent_ms.values())
    assert sum(spent_ms.values()) == pytest.approx(whole)
    assert before == {name: getattr(generate, name) for names in STAGES.values() for name in names}


def test_a_rate_is_measured_on_whole_batches() -> None:
    rate = measure_rate(Case("default-one-living-room", 10, 1), seed=1, seconds=0.01)
    assert rate.per_s > 0
    assert rate.start_s >= 0


def test_the_table_shows_medians_range_and_ratio() -> None:
    one = [Rate(per_s, 0.1, 10.0) for per_s in (90.0, 100.0, 130.0)]
    two = [Rate(per_s, 0.4, 1.0) for per_s in (150.0, 190.0, 200.0)]
    rates = {
        Case(name, interiors, workers): one if workers == 1 else two
        for name in SPEED_TEMPLATES
        for interiors in (1, 10)
        for workers in WORKERS
    }
    first = [cell.strip() for cell in speed_table(rates).splitlines()[2].strip("|").split("|")]
    assert first == ["two-rooms", "1", "100", "10.0", "190", "150-200", "1.90", "0.4", f"{AIMS_PER_S['two-rooms']}"]


def test_a_job_is_measured_in_a_process_of_its_own() -> None:
    figures = measure_memory(20)
    assert figures.worlds == 20
    assert figures.stored_mb > 20 * 0.005
    assert min(figures.job_mb, figures.worker_mb) > 20.0


def test_cores_are_lent_and_given_back() -> None:
    before = os.sched_getaffinity(0)
    with _cores(1):
        assert len(os.sched_getaffinity(0)) == 1
    assert os.sched_getaffinity(0) == before

"""The audit drives a sample again on C MuJoCo, and finds what is wrong with rows."""

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from specs.episode import EpisodeRequest, EpisodeResult
from specs.world import World
from tasks.simulate.audit import AuditReport, audit, audited_positions
from tasks.simulate.chunks import plan_chunks
from tasks.simulate.runner import simulate_chunk
from tests.simulate.conftest import PUSHER_LANES, Simulate
from tests.simulate_factory import FOLDERS, delivery, pushing

REQUESTS = [delivery(k, world=f"hand/apartment-{k % 4}", seed=k, duration_s=20.0) for k in range(12)]


@pytest.fixture(scope="module")
def rows(deliver: Simulate) -> list[EpisodeResult]:
    return deliver(REQUESTS)


@pytest.fixture(scope="module")
def report(rows: list[EpisodeResult], apartments: dict[str, World]) -> AuditReport:
    found = audit(REQUESTS, rows, apartments, FOLDERS, lanes=8)
    assert found is not None
    return found


def test_sound_rows_pass(report: AuditReport):
    assert (report.engine, report.reference, report.lanes) == ("planar", "mujoco", 8)
    assert (report.flips, report.flip_rate, report.unreproduced) == ((), 0.0, ())
    assert report.final.max_m < 1e-3
    assert report.way.median_m <= report.way.p90_m <= report.way.max_m < 1e-3
    assert report.way.max_m > 0.0


@pytest.mark.parametrize(
    "wrong",
    [
        {"final_x_m": 0.123},
        {"outcome": "Failed", "outcome_reason": "collision"},
        {"energy_j": 1e-6},
        {"goals_reached": 1},
    ],
)
def test_a_wrong_row_is_found(rows: list[EpisodeResult], apartments: dict[str, World], wrong: dict[str, object]):
    tampered = [row.model_copy(update=wrong) if row.index == 5 else row for row in rows]
    found = audit(REQUESTS[4:7], tampered[4:7], apartments, FOLDERS, lanes=8)
    assert found is not None
    assert found.unreproduced == (5,)
    if "outcome" in wrong:
        assert [(flip.index, flip.row, flip.reference) for flip in found.flips] == [(5, "collision", "Passed")]
        assert found.flip_rate == pytest.approx(1 / 3)
    if "final_x_m" in wrong:
        assert found.final.max_m > 0.1


def test_rows_that_mujoco_made_are_those_that_it_makes_again(pens: dict[str, World]):
    requests = [pushing(k, world=f"hand/pen-{k % 3}", seed=k) for k in range(4)]
    found = audit(requests, _mujoco(requests, pens), pens, FOLDERS, lanes=4, engine="mujoco")
    assert found is not None
    assert (found.engine, found.way.max_m, found.unreproduced) == ("mujoco", 0.0, ())


def test_what_was_never_driven_is_not_audited(push: Simulate, pens: dict[str, World]):
    requests = [pushing(0, world="hand/lost"), pushing(1, world="hand/pen-0", launch="raising")]
    assert audit(requests, push(requests), pens, FOLDERS) is None


@given(st.integers(1, 100_000), st.integers(1, 64))
def test_the_sample_is_spread_from_the_first_to_the_last(episodes: int, lanes: int):
    positions = audited_positions(episodes, lanes)
    assert len(positions) == min(lanes, episodes)
    assert positions[0] == 0
    assert positions[-1] == episodes - 1 or lanes == 1
    gaps = {after - before for before, after in itertools.pairwise(positions)}
    assert not gaps or max(gaps) - min(gaps) <= 1


def _mujoco(requests: list[EpisodeRequest], worlds: dict[str, World]) -> list[EpisodeResult]:
    (chunk,) = plan_chunks(requests, PUSHER_LANES)
    return simulate_chunk(chunk, worlds, FOLDERS, lanes=PUSHER_LANES, engine="mujoco", should_stop=lambda: False)

"""The engines agree: the same small batch, 64 episodes in four apartments, forced onto each of them."""

import numpy as np
import pytest

from specs.data.episode import EpisodeResult
from specs.data.world import World
from tasks.simulate.plan.chunks import plan_chunks
from tests.factories.simulations import FOLDERS, delivery, simulate_lanes, with_prisms, with_wedges

EPISODES = 64
REQUESTS = [
    delivery(k, world=f"hand/apartment-{k % 4}", seed=1000 + k, speed=("0.4", "0.8")[k % 2], duration_s=30.0)
    for k in range(EPISODES)
]


pytestmark = pytest.mark.long


def run(engine: str, worlds: dict[str, World]) -> list[EpisodeResult]:
    (chunk,) = plan_chunks(REQUESTS, EPISODES)
    return simulate_lanes(chunk, worlds, FOLDERS, lanes=EPISODES, engine=engine, should_stop=lambda: False)


def among_prisms(worlds: dict[str, World]) -> dict[str, World]:
    """Returns worlds of which all furniture and all walls are prisms."""
    return {name: with_prisms(with_wedges(world, k)) for k, (name, world) in enumerate(worlds.items())}


_CHANGES = {"as they are": dict[str, World], "of prisms": among_prisms}


@pytest.fixture(scope="module", params=["as they are", pytest.param("of prisms", marks=pytest.mark.long)])
def worlds(request: pytest.FixtureRequest, apartments: dict[str, World]) -> dict[str, World]:
    return _CHANGES[request.param](apartments)


@pytest.fixture(scope="module")
def reference(worlds: dict[str, World]) -> list[EpisodeResult]:
    return run("mujoco", worlds)


@pytest.fixture(scope="module", params=["planar", pytest.param("mjx", marks=pytest.mark.soak)])
def rows(request: pytest.FixtureRequest, worlds: dict[str, World]) -> list[EpisodeResult]:
    return run(request.param, worlds)


def test_a_box_written_as_a_prism_is_driven_by_as_a_box(apartments: dict[str, World]):
    boxes, prisms = (run("planar", each) for each in (apartments, {k: with_prisms(w) for k, w in apartments.items()}))
    assert [row.outcome for row in boxes] == [row.outcome for row in prisms]
    for name in ("path_length_m", "min_clearance_m", "final_x_m", "final_y_m"):
        ours, theirs = (np.array([getattr(row, name) for row in each]) for each in (boxes, prisms))
        assert np.quantile(np.abs(ours - theirs), 0.9) < 1e-5, name


def test_less_than_one_outcome_in_a_hundred_flips(rows: list[EpisodeResult], reference: list[EpisodeResult]):
    flips = [
        row.index
        for row, other in zip(rows, reference, strict=True)
        if (row.outcome, row.outcome_reason, row.goals_reached)
        != (other.outcome, other.outcome_reason, other.goals_reached)
    ]
    assert len(flips) < 0.01 * EPISODES
    assert 0 < sum(row.outcome == "Passed" for row in reference) <= EPISODES


def test_figures_agree(rows: list[EpisodeResult], reference: list[EpisodeResult]):
    for name in ("simulated_s", "path_length_m", "min_clearance_m", "energy_j", "impulse_ns", "final_x_m", "final_y_m"):
        ours, theirs = (np.array([getattr(row, name) for row in each]) for each in (rows, reference))
        assert np.quantile(np.abs(ours - theirs), 0.9) < 1e-3, name

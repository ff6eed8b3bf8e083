"""The windowed, batched engine drives as C MuJoCo does among all solids of the world."""

import jax
import numpy as np
import pytest

from specs.data.world import World
from tasks.simulate.chunk.chunk_simulation import ready_chunk
from tests.factories.simulations import FAULTY, FOLDERS, pushing, with_prisms, with_wedges
from tests.simulate.conftest import PUSHER_LANES
from tests.simulate.reference import reference_model, replay

pytestmark = pytest.mark.long

SLICES = 8  # ten simulated seconds


@pytest.fixture(scope="module", params=["boxes", "prisms"])
def deviations_m(request: pytest.FixtureRequest, pens: dict[str, World]) -> np.ndarray:
    """How far from C each lane ever was, for robots that drive blindly and bump into things."""
    if request.param == "prisms":
        pens = {name: with_prisms(with_wedges(world, k)) for k, (name, world) in enumerate(pens.items())}
    requests = [pushing(k, world=f"hand/pen-{k % 3}", seed=k, duration_s=60.0) for k in range(3 * PUSHER_LANES)]
    models = {name: reference_model(FOLDERS[FAULTY] / "robot.xml", world) for name, world in pens.items()}
    found: list[float] = []
    for first in range(0, len(requests), PUSHER_LANES):
        ready = ready_chunk(requests[first : first + PUSHER_LANES], pens, FOLDERS, lanes=PUSHER_LANES, engine="mjx")
        lanes, run = ready.lanes, ready.run
        assert run is not None
        state, records = run.begin(), []
        for _ in range(SLICES):
            state, record = run.advance(state)
            records.append(jax.device_get(record))
        poses = np.concatenate([record.pose for record in records], axis=1)
        controls = np.concatenate([record.control for record in records], axis=1)
        assert (np.asarray(state.totals.collisions)[: len(lanes)] > 0).sum() >= len(lanes) // 2
        for k, lane in enumerate(lanes):
            theirs = replay(models[lane.request.world], lane.placement.start, controls[k])
            found.append(float(np.hypot(*(poses[k] - theirs)[:, :2].T).max()))
    return np.array(found)


def test_the_median_deviation_over_ten_seconds_is_below_ten_micrometres(deviations_m: np.ndarray):
    assert np.median(deviations_m) < 1e-5


def test_nine_lanes_of_ten_stay_within_a_tenth_of_a_millimetre(deviations_m: np.ndarray):
    assert np.quantile(deviations_m, 0.9) < 1e-4

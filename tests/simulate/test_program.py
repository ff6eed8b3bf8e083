"""How lanes are laid out on devices."""

from hypothesis import given
from hypothesis import strategies as st

from specs.episode import EpisodeResult
from tasks.simulate.chunks import plan_chunks
from tasks.simulate.program import padded_lanes
from tasks.simulate.runner import simulate_chunk
from tests.simulate.conftest import PUSHER_LANES, Simulate
from tests.simulate_factory import FOLDERS, pen, pushing


@given(st.integers(1, 5000), st.integers(1, 64))
def test_every_device_gets_the_same_whole_vectors_of_lanes(lanes: int, devices: int):
    padded = padded_lanes(lanes, devices)
    assert lanes <= padded < lanes + 8 * devices
    assert padded % (8 * devices) == 0


def test_the_lane_count_changes_no_result(push: Simulate):
    world = {"hand/pen-0": pen(4.5, 0)}
    requests = [pushing(k, world="hand/pen-0", seed=k) for k in range(5)]
    in_small_chunks: list[EpisodeResult] = [
        row
        for chunk in plan_chunks(requests, 3)
        for row in simulate_chunk(chunk, world, FOLDERS, lanes=3, should_stop=lambda: False)
    ]
    assert PUSHER_LANES != 3
    assert in_small_chunks == push(requests, worlds=world)

"""The episodes of a search: how many lanes they are driven with, and which piece of a step each worker has."""

import pytest

from flows.batch.search_episodes import _lanes, shared_out
from tasks.storage.base.store import Store
from tests.factories.planned_batches import begun


@pytest.mark.parametrize(
    ("batch_lanes", "episodes", "lanes"),
    [(16, 2, 16), (16, 40, 64), (16, 100, 256), (256, 2, 64), (256, 100, 256), (512, 500, 512), (48, 64, 64)],
)
def test_a_step_has_the_lanes_of_few_programs(batch_lanes: int, episodes: int, lanes: int):
    assert _lanes(batch_lanes, episodes) == lanes


@pytest.mark.parametrize(
    ("episodes", "workers", "sizes"),
    [(20, 2, [20]), (64, 8, [64]), (200, 2, [100, 100]), (200, 8, [64, 64, 64, 8]), (600, 2, [256, 256, 88])],
)
def test_pieces_of_a_step_are_few_and_fit_the_lanes(file_store: Store, episodes: int, workers: int, sizes: list[int]):
    batch = begun(file_store)
    requests = [batch.layout.request(0).model_copy(update={"seed": seed}) for seed in range(episodes)]
    pieces = shared_out(batch, requests, workers)
    assert [len(piece) for piece in pieces] == sizes
    assert [request for piece in pieces for request in piece] == requests

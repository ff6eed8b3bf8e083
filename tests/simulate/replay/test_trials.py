"""Trials of an episode, as many at a time as fit."""

from collections.abc import Mapping
from types import SimpleNamespace
from typing import Any

import pytest

from specs.data.episode import EpisodeResult, Failure, failed_result
from specs.data.world import World
from tasks.simulate.plan.chunks import Chunk
from tasks.simulate.replay import smallest_case
from tasks.simulate.replay.smallest_case import Trial, simulate_trials
from tests.factories.simulations import FOLDERS, delivery, hall


class Noted:
    """Lanes that note how many episodes each chunk has."""

    def __init__(self, **_: object) -> None:
        self.sizes: list[int] = []

    def simulate(self, chunk: Chunk, _worlds: Mapping[str, World]) -> list[EpisodeResult]:
        self.sizes.append(len(chunk.requests))
        return [failed_result(each.index, Failure("InternalServiceError", "noted")) for each in chunk.requests]


@pytest.mark.parametrize(("holds", "sizes"), [(3, [3, 3, 1]), (None, [5, 2]), (100, [5, 2])])
def test_trials_are_split_as_the_machine_holds_them(
    monkeypatch: pytest.MonkeyPatch, holds: int | None, sizes: list[int]
):
    lanes = Noted()
    monkeypatch.setattr(smallest_case, "ConfinedLanes", lambda **_: lanes)
    monkeypatch.setattr(smallest_case, "batch_mounts", lambda _: SimpleNamespace(resolved=lambda request: request))
    monkeypatch.setattr(smallest_case, "most_lanes", lambda _requests, _bundles: holds)
    batch: Any = SimpleNamespace(plan=SimpleNamespace(lanes=5, engine="auto"))
    world = hall(2.0)
    tried = [Trial(world, seed) for seed in range(7)]
    endings = simulate_trials(batch, delivery(0, world="hand/one"), tried, FOLDERS)
    assert [ending.row.index for ending in endings] == list(range(7))
    assert lanes.sizes == sizes
    assert {ending.goal_m for ending in endings} == {None}  # nothing was recorded

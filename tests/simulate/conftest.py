"""Programs compiled once and shared: two for the whole folder, since each takes ten seconds."""

from collections.abc import Callable, Sequence
from pathlib import Path

import pytest

from specs.data.episode import EpisodeRequest, EpisodeResult
from specs.data.world import World
from tasks.simulate.plan.chunks import plan_chunks
from tasks.storage.base.store import Store
from tasks.storage.buckets import open_bucket
from tests.factories.data_buckets import ONE
from tests.factories.simulations import FOLDERS, cluttered, pen, simulate_lanes

LANES = 32
PUSHER_LANES = 8
Simulate = Callable[..., list[EpisodeResult]]


@pytest.fixture(scope="session")
def apartments() -> dict[str, World]:
    """Four cluttered apartments of two rooms."""
    return {f"hand/apartment-{seed}": cluttered(seed) for seed in range(4)}


@pytest.fixture(scope="session")
def pens() -> dict[str, World]:
    """Three small rooms in which a robot that does not look bumps into things."""
    return {f"hand/pen-{seed}": pen(4.5, seed) for seed in range(3)}


@pytest.fixture(scope="session")
def deliver(apartments: dict[str, World]) -> Simulate:
    """Runs courier episodes in the apartments, in chunks of 32 lanes."""

    def run(requests: Sequence[EpisodeRequest], worlds: dict[str, World] | None = None) -> list[EpisodeResult]:
        return _run(requests, worlds or apartments, LANES)

    return run


@pytest.fixture(scope="session")
def push(pens: dict[str, World]) -> Simulate:
    """Runs the pushing robot in the pens, in chunks of 8 lanes."""

    def run(
        requests: Sequence[EpisodeRequest],
        worlds: dict[str, World] | None = None,
        should_stop: Callable[[], bool] = lambda: False,
    ) -> list[EpisodeResult]:
        return _run(requests, worlds or pens, PUSHER_LANES, should_stop)

    return run


def _run(
    requests: Sequence[EpisodeRequest],
    worlds: dict[str, World],
    lanes: int,
    should_stop: Callable[[], bool] = lambda: False,
) -> list[EpisodeResult]:
    return [
        row
        for chunk in plan_chunks(requests, lanes)
        for row in simulate_lanes(chunk, worlds, FOLDERS, lanes=lanes, should_stop=should_stop)
    ]


@pytest.fixture
def bucket(file_store: Store, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Store:
    """A bucket with two maps; fetched files go to a cache of the test's own."""
    monkeypatch.setenv("SIMYARD_CACHE", str(tmp_path / "cache"))
    found = open_bucket(file_store, "maps-bucket")
    found.put("maps/one.yaml", ONE)
    found.put("maps/deep/two.yaml", b"two")
    found.put("mapsakes.txt", b"none of them")
    return found

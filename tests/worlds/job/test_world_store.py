"""Worlds that somebody else makes: kept under the names that their job knows, and told in its record as its own."""

from collections.abc import Callable, Mapping, Sequence

import pytest

from specs.errors import StoreError
from tasks.storage.base.keys import world_key
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import advance
from tasks.worlds.floorplan.search import WorldRejected
from tasks.worlds.job import generation_job, production
from tasks.worlds.job.generation_job import make_and_keep, missing_worlds
from tasks.worlds.job.production import Indices, Order, WorldOutcome
from tests.worlds.job.test_job import BODY, Progress, run, worlds_of

ORDER = Order(template=BODY, seed=7, generation="wgj-1", robot_radius_m=0.2)
TWO: list[Indices] = [(1, 1), (1, 2)]


def always() -> bool:
    return True


class Elsewhere:
    """Workers that come to all of a job's worlds, or to the first so many."""

    def __init__(self, store: Store, most: int = 1000) -> None:
        self.asked: list[Indices] = []
        self._store, self._most = store, most

    def __call__(
        self, order: Order, indices: Sequence[Indices], *, going: Callable[[], bool], done: Callable[[int], None]
    ) -> Mapping[Indices, WorldOutcome]:
        self.asked = [*indices]
        rejected = make_and_keep(self._store, order, indices[: self._most], going)
        done(min(self._most, len(indices)))
        return {each.indices: each for each in rejected}


def test_worlds_made_elsewhere_are_those_that_the_job_itself_makes(file_store: Store, s3_store: Store) -> None:
    elsewhere, progress = Elsewhere(s3_store, most=3), Progress()
    own = run(file_store, 2, 2)
    record = run(s3_store, 2, 2, progress=progress, elsewhere=elsewhere)
    assert elsewhere.asked == [(1, 1), (1, 2), (2, 1), (2, 2)]
    assert record.status == "Completed"
    assert worlds_of(s3_store, record) == worlds_of(file_store, own)
    assert progress.seen[0] == (3, 4)
    assert progress.seen[-1] == (4, 4)


def test_a_job_goes_on_where_workers_were_when_it_was_killed(file_store: Store) -> None:
    first = Elsewhere(file_store, most=1)
    with pytest.raises(KeyboardInterrupt):
        run(file_store, 1, 3, progress=Progress(dies_after=1), elsewhere=first)
    second = Elsewhere(file_store)
    record = run(file_store, 1, 3, elsewhere=second)
    assert (first.asked, second.asked) == ([(1, 1), (1, 2), (1, 3)], [(1, 2), (1, 3)])
    assert len(worlds_of(file_store, record)) == 3


def test_worlds_that_cannot_be_made_elsewhere_are_counted_and_not_tried_again(
    file_store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    tried: list[object] = []
    generate_world = production.generate_world

    def failing(template: object, **which: object) -> object:
        tried.append(which["interior_index"])
        if which["interior_index"] == 2:
            raise WorldRejected("InternalServiceError", "no room for a bed")
        return generate_world(BODY, **which)  # pyright: ignore[reportArgumentType]

    monkeypatch.setattr(production, "generate_world", failing)
    record = run(file_store, 1, 3, elsewhere=Elsewhere(file_store))
    assert (record.status, record.detail["failures"]) == (
        "PartialFailed",
        {"InternalServiceError": {"count": 1, "sample_reason": "no room for a bed"}},
    )
    assert tried == [1, 2, 3]


def test_a_job_that_is_canceled_while_workers_make_its_worlds_keeps_them(
    file_store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Canceled(Elsewhere):
        def __call__(
            self, order: Order, indices: Sequence[Indices], *, going: Callable[[], bool], done: Callable[[int], None]
        ) -> Mapping[Indices, WorldOutcome]:
            made = super().__call__(order, indices, going=going, done=done)
            advance(file_store, generation_job.KIND, order.generation, "Canceling")
            return made

    monkeypatch.setattr(generation_job, "_LOOK_EVERY_S", 0.0)
    record = run(file_store, 1, 3, elsewhere=Canceled(file_store, 2))
    assert record.status == "Canceled"
    assert missing_worlds(file_store, record.id, [(1, 1), (1, 2), (1, 3)]) == [(1, 3)]


def test_nothing_more_is_made_once_nobody_wants_it(file_store: Store) -> None:
    wanted = iter([True, False])
    make_and_keep(file_store, ORDER, TWO, lambda: next(wanted))
    assert missing_worlds(file_store, "wgj-1", TWO) == [(1, 2)]


def test_a_world_is_kept_once_however_often_it_is_made(file_store: Store) -> None:
    make_and_keep(file_store, ORDER, TWO[:1], always)
    mark = file_store.mark(world_key("wgj-1", "world-1-1"))
    make_and_keep(file_store, ORDER, TWO[:1], always)
    assert file_store.mark(world_key("wgj-1", "world-1-1")) == mark


def test_a_world_of_another_version_under_its_name_is_refused(file_store: Store) -> None:
    file_store.create(world_key("wgj-1", "world-1-1"), b"{}")
    with pytest.raises(StoreError, match="something else"):
        make_and_keep(file_store, ORDER, TWO, always)

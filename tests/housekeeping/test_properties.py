"""Whatever a store went through: after a gc every record that is left has what it needs, and nothing else can go."""

from collections.abc import Callable, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tasks.housekeeping.gc import Ages
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import JobRecord
from tasks.storage.store_url import open_store
from tests.housekeeping.yard import Yard, freed

_STEPS = ("generate", "export", "drive", "judge", "publish", "unpublish", "deploy", "lose", "gc", "run")


class Step(NamedTuple):
    """Something that happens: to which of those that it can happen to, and in which of two ways."""

    what: str
    which: int
    flag: bool


steps = st.lists(
    st.builds(Step, st.sampled_from(_STEPS), st.integers(min_value=0, max_value=5), st.booleans()),
    min_size=1,
    max_size=25,
)


class _Life:
    """A store that goes through steps; a step that has nothing to act on does nothing."""

    def __init__(self, store: Store, cache: Path) -> None:
        self.yard, self._cache = Yard(store), cache
        self._generations: list[JobRecord] = []
        self._batches: list[tuple[JobRecord, str, str]] = []
        self._jobs: list[JobRecord] = []
        self._digests: list[str] = []

    def go(self, number: int, step: Step) -> None:
        act: dict[str, Callable[[str, Step], object]] = {
            "generate": self._generate,
            "export": self._export,
            "drive": self._drive,
            "judge": self._judge,
            "publish": self._publish,
            "unpublish": self._unpublish,
            "deploy": self._deploy,
            "lose": self._lose,
            "gc": self._gc,
            "run": self._run,
        }
        act[step.what](f"step-{number}", step)

    def _keep(self, record: JobRecord) -> JobRecord:
        self._jobs.append(record)
        return record

    def _run(self, name: str, step: Step) -> None:
        names = [record.id for record in self._jobs[-2:]]
        self._keep(self.yard.job("pipeline-run", name, {"names": [*names]}, set(), ended=step.flag))

    def _unpublish(self, _name: str, step: Step) -> None:
        self.yard.unpublish(f"app-{step.which % 2}")

    def _generate(self, name: str, step: Step) -> None:
        self._generations.append(self._keep(self.yard.generation(name, ended=step.flag)))

    def _export(self, name: str, step: Step) -> None:
        if self._generations:
            generation = self._generations[step.which % len(self._generations)]
            self._keep(self.yard.export(name, generation.id, ended=step.flag))

    def _drive(self, name: str, step: Step) -> None:
        if self._generations and self._digests:
            generation = self._generations[step.which % len(self._generations)].id
            digest = self._digests[step.which % len(self._digests)]
            batch = self._keep(self.yard.batch(name, generation, digest, ended=step.flag))
            self._batches.append((batch, generation, digest))

    def _judge(self, _name: str, step: Step) -> None:
        if self._batches:
            batch, generation, digest = self._batches[step.which % len(self._batches)]
            self.yard.judge(batch.id, generation, digest)

    def _publish(self, _name: str, step: Step) -> None:
        self._digests.append(
            self.yard.publish(f"app-{step.which % 2}", f"bundle {step.which} {step.flag}".encode()).digest
        )

    def _deploy(self, name: str, step: Step) -> None:
        if self._digests:
            self._keep(self.yard.deploy(name, self._digests[step.which % len(self._digests)]))

    def _lose(self, _name: str, step: Step) -> None:
        if self._jobs:
            self.yard.lose(self._jobs[step.which % len(self._jobs)])

    def _gc(self, _name: str, step: Step) -> None:
        self.check(forget=step.flag)

    def check(self, *, forget: bool) -> None:
        """Runs a gc, and asserts what one promises."""
        ages = Ages(grace_s=0.0, ended_s=0.0 if forget else None)
        before = set(self.yard.store.keys(""))
        records = {key for key in before if key.startswith(("jobs/", "applications/", "robots/", "results/"))}
        told = self.yard.gc(self._cache, ages, remove=False)
        assert freed(self.yard.gc(self._cache, ages)) == freed(told)
        after = set(self.yard.store.keys(""))
        assert self.yard.missing(before) == set()
        lost = {key for key in records - after if not key.endswith("/audit-begun.json")}
        assert not lost or forget
        assert all(key.startswith("jobs/") and not key.startswith("jobs/pipeline-run/") for key in lost)
        assert freed(self.yard.gc(self._cache, ages)) == {}
        assert set(self.yard.store.keys("")) == after
        assert [key for key in after if self._is_litter(key, after)] == []

    def _is_litter(self, key: str, after: set[str]) -> bool:
        """Returns whether it is a chunk or a bundle that no record needs, by what the yard knows of records."""
        needed = set[str]().union(*(needs for record, needs in self.yard.needs.items() if record in after))
        return key.startswith(("chunks/", "bundles/")) and key not in needed


def live(store: Store, cache: Path, life: Sequence[Step]) -> None:
    found = _Life(store, cache)
    for number, step in enumerate(life):
        found.go(number, step)
    found.check(forget=False)
    found.check(forget=True)


@given(life=steps)
@settings(max_examples=12)
def test_every_record_that_is_left_has_what_it_needs_and_a_second_gc_frees_nothing(life: list[Step]) -> None:
    with TemporaryDirectory() as folder:
        live(open_store((Path(folder) / "store").as_uri()), Path(folder) / "cache", life)


@given(life=steps)
@settings(max_examples=1, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_the_same_holds_on_a_real_server(s3_url: Callable[[], str], tmp_path: Path, life: list[Step]) -> None:
    live(open_store(s3_url()), tmp_path, life)


@pytest.mark.soak
@given(life=steps)
@settings(max_examples=200)
def test_the_same_holds_for_many_lives(life: list[Step]) -> None:
    with TemporaryDirectory() as folder:
        live(open_store((Path(folder) / "store").as_uri()), Path(folder) / "cache", life)

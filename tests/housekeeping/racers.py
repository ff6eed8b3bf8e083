"""What child processes do while others collect garbage: they make things, name them, and delete the names."""

import random
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory

from specs.robomaker.bundle import Version
from tasks.housekeeping.job import Ages
from tasks.storage.jobs.records import JobRecord
from tasks.storage.store_url import open_store
from tests.housekeeping.yard import Yard, freed
from tests.servers.racers import wait_for_all

_DAY_S = 86400.0


@dataclass
class YardNotes:
    """What a process did.

    Attributes:
        needs: What each record that it made needs, by the record's key.
        late: Records that took longer to name things than the grace promises to wait.
        freed: How many objects of each kind its gcs have removed.
        operations: How many things it made, named or deleted; or how many gcs it ran.
    """

    needs: dict[str, set[str]] = field(default_factory=dict[str, set[str]])
    late: set[str] = field(default_factory=set[str])
    freed: Counter[str] = field(default_factory=Counter[str])
    operations: int = 0


def race_gc(url: str, role: str, seconds: float, grace_s: float) -> YardNotes:
    """Collects garbage again and again in the roles ``gc ahead`` and ``gc behind``, else lives in the store."""
    if role.startswith("gc"):
        return _collect(url, role, seconds, grace_s)
    life = _Life(url, role, grace_s)
    wait_for_all()
    end_s = time.monotonic() + seconds
    while time.monotonic() < end_s:
        life.step()
    life.notes.needs = life.yard.needs
    return life.notes


def _collect(url: str, role: str, seconds: float, grace_s: float) -> YardNotes:
    """Runs gc after gc on a machine whose own clock is a day wrong."""
    yard, notes, real = Yard(open_store(url)), YardNotes(), time.time
    wrong_s = _DAY_S if role == "gc ahead" else -_DAY_S
    time.time = lambda: real() + wrong_s
    ages = Ages(grace_s=grace_s, ended_s=None if role == "gc ahead" else 4 * grace_s)
    wait_for_all()
    end_s = time.monotonic() + seconds
    with TemporaryDirectory() as cache:
        while time.monotonic() < end_s:
            notes.freed.update(freed(yard.gc(Path(cache), ages)))
            notes.operations += 1
    return notes


class _Life:
    """A life in which the bundles are those of other lives too, and jobs are lost and made again."""

    def __init__(self, url: str, me: str, grace_s: float) -> None:
        self.yard, self.notes = Yard(open_store(url)), YardNotes()
        self._chance, self._me, self._grace_s = random.Random(me), me, grace_s  # noqa: S311 - no secret depends on it
        self._batches: list[tuple[JobRecord, str, str]] = []
        self._jobs: list[JobRecord] = []
        self._published: dict[str, Version] = {}
        self._lost: list[str] = []

    def step(self) -> None:
        steps = (
            self._publish,
            self._publish,
            self._unpublish,
            self._batch,
            self._judge,
            self._deploy,
            self._lose,
            self._make_again,
        )
        before, begun_s = set(self.yard.needs), time.monotonic()
        step: Callable[[str], str] = self._chance.choice(steps)
        named = step(f"{self._me}-{self.notes.operations}")
        self.notes.operations += 1
        new = ({named} if named else set[str]()) | (set(self.yard.needs) - before)
        if time.monotonic() - begun_s > self._grace_s / 2:
            self.notes.late |= new
        else:
            self.notes.late -= {named}

    def _publish(self, _name: str) -> str:
        name, body = f"{self._me}-app{self._chance.randrange(2)}", f"bundle {self._chance.randrange(4)}".encode()
        self._published[name] = self.yard.publish(name, body)
        return f"applications/robot-application/{name}.json"

    def _unpublish(self, _name: str) -> str:
        if not self._published:
            return ""
        name = self._chance.choice(sorted(self._published))
        del self._published[name]
        self.yard.unpublish(name)
        return ""

    def _batch(self, name: str) -> str:
        if self._published:
            digest = self._chance.choice(sorted(self._published.items()))[1].digest
            generation = self.yard.generation(f"{name}-worlds")
            batch = self.yard.batch(f"{name}-batch", generation.id, digest)
            self._jobs += [generation, batch]
            self._batches.append((batch, generation.id, digest))
        return ""

    def _judge(self, _name: str) -> str:
        if not self._batches:
            return ""
        batch, generation, digest = self._batches.pop()
        return self.yard.judge(batch.id, generation, digest)

    def _deploy(self, name: str) -> str:
        if self._published:
            self.yard.deploy(name, self._chance.choice(sorted(self._published.items()))[1].digest)
        return ""

    def _lose(self, name: str) -> str:
        if self._jobs:
            lost = self._jobs.pop(self._chance.randrange(len(self._jobs)))
            self._batches = [each for each in self._batches if lost.id not in (each[0].id, each[1])]
            self.yard.lose(lost)
        self._lost.append(f"{name}-again")
        self.yard.lose(self.yard.generation(self._lost[-1]))
        return ""

    def _make_again(self, _name: str) -> str:
        """Asks again for a job whose record is gone, and which a gc is about to clear away."""
        if self._lost:
            self._jobs.append(self.yard.generation(self._lost.pop(0)))
        return ""

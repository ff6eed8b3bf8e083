"""What child processes do while others collect garbage: they make things, name them, and delete the names."""

import random
import time
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory

from specs.robomaker.bundle import Version
from tasks.housekeeping.gc import Ages
from tasks.housekeeping.machine import remove_entry, unused_entries
from tasks.storage.jobs.records import JobRecord
from tasks.storage.store_url import open_store
from tests.housekeeping.yard import Yard, freed
from tests.servers.racers import wait_for_all

_DAY_S = 86400.0
# A gc lists all records before it removes what a job left, so its time grows with the square of what the lives made.
_STEPS_OF_A_LIFE = 300


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
    while time.monotonic() < end_s and life.notes.operations < _STEPS_OF_A_LIFE:
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
        self._made_s: dict[str, float] = {}
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
        self.notes.late -= {named}
        if time.monotonic() - begun_s > self._grace_s / 2:
            self.notes.late |= new

    def _publish(self, _name: str) -> str:
        name, body = f"{self._me}-app{self._chance.randrange(2)}", f"bundle {self._chance.randrange(12)}".encode()
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
            self._made_s[batch.id] = time.monotonic()
        return ""

    def _judge(self, _name: str) -> str:
        """Judges the newest batch, as the run does that made it and names it; none so old that it may be forgotten."""
        if not self._batches:
            return ""
        batch, generation, digest = self._batches.pop()
        if time.monotonic() - self._made_s[batch.id] > self._grace_s:
            return ""
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


def race_cache(cache: str, role: str, seconds: float) -> Counter[str]:
    """Clears a cache again and again, or fills it; returns how many entries were made, or went, or stayed.

    What a filler has made goes whole or not at all, and a file that it writes over is never what it was before.
    """
    wait_for_all()
    end_s, done = time.monotonic() + seconds, Counter[str]()
    while time.monotonic() < end_s:
        if role == "gc":
            done.update("went" if remove_entry(entry) else "stayed" for entry in unused_entries(Path(cache), 0.0))
            continue
        done["made"] += 1
        _fill(Path(cache, "bundles"), f"{role}-{done['made']}")
        _write_over(Path(cache, "timings", role), done)
    return done


def _fill(folder: Path, name: str) -> None:
    """Makes a folder of folders, read-only as those of data are, which appears whole."""
    new = folder / f".{name}.tmp"
    with suppress(FileNotFoundError):  # a gc takes what is being made for what a killed process left
        for number in range(5):
            (new / str(number)).mkdir(parents=True)
            (new / str(number) / "file").write_bytes(b"1")
            (new / str(number)).chmod(0o555)
        new.rename(folder / name)


def _write_over(path: Path, done: Counter[str]) -> None:
    """Writes a number over the one before; what is read afterwards is that one, or nothing."""
    new = path.with_name(f".{path.name}.new")
    with suppress(FileNotFoundError):
        new.write_text(str(done["made"]))
        new.replace(path)
        found = path.read_text()
        if found != str(done["made"]):
            done["older"] += 1

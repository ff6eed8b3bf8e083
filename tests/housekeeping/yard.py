"""Stores with jobs, applications, robots and evidence in them, made as the program makes them, and what each needs."""

import hashlib
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import cast

from pydantic import JsonValue

from specs.errors import StoreError
from specs.job_kinds import JobKind
from specs.robomaker.bundle import Application, Build, Version
from tasks.applications.versions import change, with_version
from tasks.housekeeping.gc import Ages, GcReport, collect_garbage
from tasks.storage.base.keys import (
    bundle_key,
    chunk_key,
    claim_key,
    job_key,
    output_key,
    result_key,
    token_key,
    world_key,
)
from tasks.storage.base.store import Store
from tasks.storage.jobs.claim import hold_claim
from tasks.storage.jobs.records import JobRecord, advance, submit

NOW = Ages(grace_s=0.0)
_ENDED: Mapping[JobKind, str] = {
    "world-generation-job": "Completed",
    "world-export-job": "Completed",
    "simulation-job-batch": "Completed",
    "deployment-job": "Succeeded",
    "pipeline-run": "Completed",
}


@dataclass
class Yard:
    """A store, and what each of its records needs to be described, replayed and deployed.

    Attributes:
        needs: Keys by the key of the record that needs them.
    """

    store: Store
    needs: dict[str, set[str]] = field(default_factory=dict[str, set[str]])

    def job(
        self, kind: JobKind, token: str, request: Mapping[str, JsonValue], needs: set[str], *, ended: bool = True
    ) -> JobRecord:
        record = submit(self.store, kind, dict(request), token)
        with hold_claim(self.store, claim_key(kind, record.id)):
            pass
        if ended:
            record = advance(self.store, kind, record.id, _ENDED[kind], detail={"by": token})
        key = job_key(kind, record.id)
        self.needs[key] = {token_key(kind, token), claim_key(kind, record.id), *needs}
        return record

    def generation(self, token: str, *, ended: bool = True) -> JobRecord:
        made = self.job("world-generation-job", token, {"template": "t"}, set(), ended=ended)
        self.needs[job_key(made.kind, made.id)] |= {self._put(key) for key in worlds_of(made.id)}
        return made

    def export(self, token: str, generation: str, *, ended: bool = True) -> JobRecord:
        made = self.job(
            "world-export-job", token, {"worlds": [f"{generation}/w1"]}, {*worlds_of(generation)}, ended=ended
        )
        self.needs[job_key(made.kind, made.id)] |= {self._put(f"buckets/out/some/place/{made.id}.zip")}
        return made

    def batch(self, token: str, generation: str, digest: str, *, ended: bool = True) -> JobRecord:
        launch: JsonValue = {"digest": digest}
        templates: list[JsonValue] = [{"robot": launch, "scenario": launch}]
        plan: JsonValue = {"templates": templates, "world_digests": dict.fromkeys(names_of(generation), "0" * 64)}
        made = self.job("simulation-job-batch", token, {"plan": plan}, {*worlds_of(generation)}, ended=ended)
        own = {chunk_key(made.id, 0), *results_of(made.id)}
        self.needs[job_key(made.kind, made.id)] |= {self._put(key) for key in own} | {bundle_key(digest)}
        return made

    def judge(self, batch: str, generation: str, digest: str) -> str:
        evidence = {"batch": batch, "robots": [{"digest": digest}], "simulations": [], "worlds": {}}
        evidence["worlds"] = dict.fromkeys(names_of(generation), "0" * 64)
        key = result_key(batch, "evidence.json")
        self.store.put(key, json.dumps(evidence).encode())
        self.needs[key] = {bundle_key(digest), *worlds_of(generation), *results_of(batch)}
        return key

    def publish(self, name: str, body: bytes) -> Version:
        digest = hashlib.sha256(body).hexdigest()
        self.store.put(bundle_key(digest), body)
        build = Build(architecture="X86_64", digest=digest, size_bytes=len(body))

        def step(before: Application | None, number: int) -> Application:
            found = before or Application(kind="robot-application", name=name, versions=())
            return with_version(found, [build], whole=True, shipped=False, number=number)

        made = change(self.store, "robot-application", name, step)
        self.needs[f"applications/robot-application/{name}.json"] = {bundle_key(each.digest) for each in made.versions}
        return next(version for version in made.versions if version.digest == digest)

    def unpublish(self, name: str) -> None:
        def step(before: Application | None, _number: int) -> Application:
            found = before or Application(kind="robot-application", name=name, versions=())
            return found.model_copy(update={"versions": (), "deleted": True})

        change(self.store, "robot-application", name, step)
        self.needs[f"applications/robot-application/{name}.json"] = set()

    def deploy(self, token: str, digest: str) -> JobRecord:
        plan = {"digest": digest, "builds": {}}
        made = self.job("deployment-job", token, {"plan": cast("JsonValue", plan)}, {bundle_key(digest)})
        desired = {"robot": f"robot-{token}", "deployment": made.id, "digest": digest}
        key = f"robots/robot-{token}/desired.json"
        self.store.put(key, json.dumps(desired).encode())
        self.needs[key] = {bundle_key(digest)}
        return made

    def lose(self, record: JobRecord) -> None:
        self.store.delete(job_key(record.kind, record.id))

    def gc(self, cache: Path, ages: Ages = NOW, *, remove: bool = True) -> GcReport:
        return collect_garbage(self.store, cache, ages, remove=remove)

    def missing(self, before: set[str]) -> set[str]:
        """Returns what a record that is there needs and that was there before."""
        there = set(self.store.keys(""))
        needed = (needs for record, needs in self.needs.items() if record in there)
        return (set[str]().union(*needed) & before) - there

    def _put(self, key: str) -> str:
        self.store.put(key, key.encode())
        return key


def names_of(generation: str) -> list[str]:
    return [f"{generation}/w1", f"{generation}/w2"]


def worlds_of(generation: str) -> list[str]:
    return [world_key(generation, "w1"), world_key(generation, "w2")]


def results_of(batch: str) -> list[str]:
    names = (f"{batch}/results.parquet", f"{batch}/report.html", f"recordings/{batch}/000000.parquet")
    return [f"buckets/out/{output_key('nightly', name)}" for name in names]


def freed(report: GcReport) -> dict[str, int]:
    """Returns how many objects of each kind can go, or went."""
    return {row.kind: row.objects for row in report.freed}


class Meddled:
    """A store whose clock is ahead, and where something happens right before a call for a key, or in its place."""

    def __init__(self, store: Store, *, later_s: float = 0.0) -> None:
        self._store, self._later_s = store, later_s
        self._meanwhile: dict[tuple[str, str], Callable[[], object]] = {}
        self._instead: dict[tuple[str, str], Callable[[], object]] = {}

    def before(self, method: str, key: str, action: Callable[[], object]) -> None:
        self._meanwhile[method, key] = action

    def instead(self, method: str, key: str, action: Callable[[], object]) -> None:
        self._instead[method, key] = action

    def now_s(self) -> float:
        return self._store.now_s() + self._later_s

    def __getattr__(self, name: str) -> object:
        found = getattr(self._store, name)
        if not callable(found):
            return found

        def called(*arguments: object, **named: object) -> object:
            first = arguments[0] if arguments else ""
            place = name, str(getattr(first, "key", first))
            if action := self._meanwhile.pop(place, None):
                action()
            if action := self._instead.pop(place, None):
                return action()
            return found(*arguments, **named)

        return called


class Mortal:
    """A store whose process dies at one of its writes: that one and all later ones never arrive."""

    _WRITES = frozenset({"create", "replace", "put", "delete", "delete_unchanged", "discard", "upload"})

    def __init__(self, store: Store, writes: int) -> None:
        self._store, self._left = store, writes

    def __getattr__(self, name: str) -> object:
        found = getattr(self._store, name)
        if name not in self._WRITES:
            return found

        def called(*arguments: object, **named: object) -> object:
            self._left -= 1
            if self._left < 0:
                raise StoreError("killed")
            return found(*arguments, **named)

        return called


def later(store: Store, seconds: float) -> Store:
    """Returns the store as it is seen so much later."""
    return cast("Store", Meddled(store, later_s=seconds))

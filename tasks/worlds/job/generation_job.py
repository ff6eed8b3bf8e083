"""A world generation job: submitted once, resumed after any death, its worlds immutable objects in the store.

Some worlds of a job can be made again, drawn after the fact, and compared with what a batch drove in.
"""

import hashlib
import logging
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from random import Random, SystemRandom
from typing import Protocol

from pydantic import JsonValue

from specs.base import canonical_document, canonical_json
from specs.data.world import ROBOT_RADIUS_M
from specs.errors import StoreError
from specs.job_kinds import JobKind
from specs.robomaker.failure_codes import WorldGenerationJobErrorCode
from specs.robomaker.world_jobs import CreateWorldGenerationJobRequest
from specs.settings import MAX_WORLDS
from specs.template.body import TemplateBody, template_digest
from tasks.storage.base.keys import claim_key, template_key, world_key, worlds_prefix
from tasks.storage.base.store import Store, create_once
from tasks.storage.jobs.claim import Claim, hold_claim
from tasks.storage.jobs.records import JobRecord, advance, is_terminal, read, submit
from tasks.storage.worlds import write_world
from tasks.worlds.generate import world_name
from tasks.worlds.job.production import Indices, Order, WorldOutcome, make, produce

KIND: JobKind = "world-generation-job"
_REASON_LENGTH = 1024
_LOOK_EVERY_S = 1.0
_log = logging.getLogger(__name__)
MOST_REMADE = 64


def make_and_keep(
    store: Store, order: Order, indices: Sequence[Indices], going: Callable[[], bool]
) -> list[WorldOutcome]:
    """Returns the worlds that cannot be; all others are kept in the store, unless nobody wants them any more.

    Args:
        store: Where worlds lie.
        order: What the worlds have in common.
        indices: Floor plan and interior of each world.
        going: Whether the next one is still wanted; asked before each.

    Raises:
        ObjectExists: A world in the store is not what this version of Simyard makes.
    """
    rejected: list[WorldOutcome] = []
    for each in indices:
        if not going():
            break
        made = make(order, each)
        if made.code is None:
            write_world(store, f"{order.generation}/{world_name(*each)}", made.document.encode())
        else:
            rejected.append(made)
    return rejected


def missing_worlds(store: Store, generation: str, indices: Sequence[Indices]) -> list[Indices]:
    """Returns those worlds of a generation job that the store does not have."""
    there = set(store.keys(worlds_prefix(generation)))
    return [each for each in indices if world_key(generation, world_name(*each)) not in there]


class RemoteWorldMaker(Protocol):
    """Workers that make worlds and keep them in the store (``tasks.worlds.job.generation_job``)."""

    def __call__(
        self, order: Order, indices: Sequence[Indices], *, going: Callable[[], bool], done: Callable[[int], None]
    ) -> Mapping[Indices, WorldOutcome]:
        """Returns the worlds that cannot be, once all others are kept or nobody wants them any more.

        Args:
            order: What the worlds have in common.
            indices: Floor plan and interior of each world.
            going: Whether anything more is wanted.
            done: Told of more that are kept, or cannot be, and how many they are.
        """
        ...


@dataclass
class _JobOutcome:
    """What has come of a job so far: references of its worlds, and failures by code with one sample reason."""

    worlds: list[str] = field(default_factory=list[str])
    failures: dict[WorldGenerationJobErrorCode, tuple[int, str]] = field(
        default_factory=dict[WorldGenerationJobErrorCode, tuple[int, str]]
    )
    canceled: bool = False

    def failed(self, code: WorldGenerationJobErrorCode, reason: str) -> None:
        """Counts one world that could not be generated."""
        count, sample = self.failures.get(code, (0, reason))
        self.failures[code] = (count + 1, sample)

    def detail(self) -> dict[str, JsonValue]:
        """Returns the record's view of it."""
        failures: dict[str, JsonValue] = {
            code: {"count": count, "sample_reason": reason[:_REASON_LENGTH]}
            for code, (count, reason) in sorted(self.failures.items())
        }
        return {"worlds": list(self.worlds), "failures": failures}


def run_generation_job(
    store: Store,
    request: CreateWorldGenerationJobRequest,
    template: TemplateBody,
    *,
    seed: int,
    token: str,
    progress: Callable[[int, int], None],
    robot_radius_m: float = ROBOT_RADIUS_M,
    first: Indices = (1, 1),
    most: int | None = None,
    workers: int | None = None,
    remote: RemoteWorldMaker | None = None,
) -> JobRecord:
    """Returns the job's terminal record, having generated the worlds that were missing.

    Args:
        store: Where worlds and records lie.
        request: What is asked for; its counts default to 1.
        template: The template that the request names.
        seed: At least 0; together with template and robot radius it belongs to the request.
        token: The client request token.
        progress: Called with worlds finished and worlds in all.
        robot_radius_m: Radius of the robot that every room shall be reachable for.
        first: Floor plan and interior of the first world, where other jobs make those before; they belong to the
            request likewise.
        most: How many worlds it may make; what this machine allows, if left out.
        workers: Processes that make worlds; None for as many as pay. The worlds do not depend on it.
        remote: Workers of a cluster that make them instead, where there are any.

    Raises:
        IdempotentParameterMismatch: The token was used with another request, template, seed or radius.
        StoreError: Another process took the job over, or a world in the store is not what this job generates.
        WorkerDied: A process that made worlds was killed; running the job again goes on.
    """
    digest = template_digest(template)
    own: dict[str, JsonValue] = {"seed": seed, "templateDigest": digest}
    if robot_radius_m != ROBOT_RADIUS_M:
        own["robotRadius"] = robot_radius_m
    if first != (1, 1):
        own["first"] = list(first)
    record = submit(store, KIND, {**canonical_document(request), **own}, token)
    if is_terminal(record):
        return record
    with hold_claim(store, claim_key(KIND, record.id)) as claim:
        record = read(store, KIND, record.id)
        if is_terminal(record):
            return record
        floorplans, interiors = _counts(request)
        most = most or MAX_WORLDS.value()
        if min(floorplans, interiors) < 1 or floorplans * interiors > most:
            return _refuse(store, record, floorplans, interiors, most)
        # Under its digest, so that what a job used can be read however the template changes.
        create_once(store, template_key(digest), canonical_json(canonical_document(template)))
        if record.status != "Canceling":
            detail: dict[str, JsonValue] = {"template_digest": digest, "seed": seed}
            advance(store, KIND, record.id, "Running", detail=detail, only_from={"Pending", "Running"})
        order = Order(template=template, seed=seed, generation=record.id, robot_radius_m=robot_radius_m)
        indices = world_indices(request, first)
        watch = _Watch(store, record, claim)
        rejected = _make_remotely(watch, order, indices, progress, remote) if remote else {}
        return _end(store, record, _make_all(watch, order, indices, progress, workers, rejected=rejected))


@dataclass
class _Watch:
    """Whether a job may go on: it is still this process's, and nobody cancels it."""

    store: Store
    record: JobRecord
    claim: Claim
    next_look_s: float = 0.0
    stopped: bool = False

    def canceled(self) -> bool:
        """Returns whether the job is to be canceled, looking at its record at most once a second.

        Raises:
            StoreError: Another process took the job over.
        """
        if self.claim.lost:
            raise StoreError(f"{self.record.arn}: another process took this job over; it will finish it")
        if not self.stopped and time.monotonic() >= self.next_look_s:
            self.next_look_s = time.monotonic() + _LOOK_EVERY_S
            self.stopped = read(self.store, KIND, self.record.id).status == "Canceling"
        return self.stopped


def _make_remotely(
    watch: _Watch,
    order: Order,
    indices: Sequence[Indices],
    progress: Callable[[int, int], None],
    remote: RemoteWorldMaker,
) -> Mapping[Indices, WorldOutcome]:
    missing, total = missing_worlds(watch.store, order.generation, indices), len(indices)
    made = total - len(missing)

    def done(more: int) -> None:
        nonlocal made
        made += more
        progress(made, total)

    return remote(order, missing, going=lambda: not watch.canceled(), done=done)


def _make_all(
    watch: _Watch,
    order: Order,
    indices: Sequence[Indices],
    progress: Callable[[int, int], None],
    workers: int | None,
    *,
    rejected: Mapping[Indices, WorldOutcome],
) -> _JobOutcome:
    """Returns what came of all worlds of the job, in order; those in the store were created whole, by this job."""
    finished, total = _JobOutcome(), len(indices)
    missing = [each for each in missing_worlds(watch.store, order.generation, indices) if each not in rejected]
    to_make, known = set(missing), total - len(missing)
    with closing(produce(order, missing, workers)) as products:
        for done, each in enumerate(indices):
            progress(max(done, known), total)
            if watch.canceled():
                finished.canceled = True
                return finished
            reference = f"{order.generation}/{world_name(*each)}"
            made = next(products) if each in to_make else rejected.get(each)
            if made is not None and made.code is not None:
                _log.warning("%s: %s: %s", order.generation, made.code, made.reason)
                finished.failed(made.code, made.reason)
                continue
            if made is not None:
                write_world(watch.store, reference, made.document.encode())
            finished.worlds.append(reference)
    progress(total, total)
    return finished


def world_indices(request: CreateWorldGenerationJobRequest, first: Indices) -> list[Indices]:
    """Returns floor plan and interior of each world that a request asks for, from the first one on, in order."""
    floorplans, interiors = _counts(request)
    return [(first[0] + plan, first[1] + interior) for plan in range(floorplans) for interior in range(interiors)]


def _counts(request: CreateWorldGenerationJobRequest) -> tuple[int, int]:
    wanted = request.worldCount.floorplanCount, request.worldCount.interiorCountPerFloorplan
    return 1 if wanted[0] is None else wanted[0], 1 if wanted[1] is None else wanted[1]


def _refuse(store: Store, record: JobRecord, floorplans: int, interiors: int, most: int) -> JobRecord:
    """Fails the job rather than the call for a count that is out of range (docs/reference/robomaker.md, section 5)."""
    reason = (
        f"{floorplans} floor plans x {interiors} interiors are {floorplans * interiors} worlds; "
        f"a job makes 1 to {most} (SIMYARD_MAX_WORLDS raises it)"
    )
    detail = _JobOutcome().detail()
    code: WorldGenerationJobErrorCode = "AllWorldGenerationFailed"
    return advance(store, KIND, record.id, "Failed", failure_code=code, failure_reason=reason, detail=detail)


def _end(store: Store, record: JobRecord, finished: _JobOutcome) -> JobRecord:
    detail = finished.detail()
    if finished.canceled:
        return advance(store, KIND, record.id, "Canceled", detail=detail)
    if not finished.failures:
        return advance(store, KIND, record.id, "Completed", detail=detail)
    if finished.worlds:
        return advance(store, KIND, record.id, "PartialFailed", detail=detail)
    reason = next(reason for _, reason in finished.failures.values())[:_REASON_LENGTH]
    code: WorldGenerationJobErrorCode = "AllWorldGenerationFailed"
    return advance(store, KIND, record.id, "Failed", failure_code=code, failure_reason=reason, detail=detail)


def world_changes(
    order: Order,
    request: CreateWorldGenerationJobRequest,
    worlds: Sequence[str],
    digests: Mapping[str, str],
    *,
    first: Indices = (1, 1),
    most: int = MOST_REMADE,
    draw: Random | None = None,
) -> list[str]:
    """Returns which worlds are not those that the template gives, one line each.

    Args:
        order: Template, seed and generation.
        request: How many worlds were asked for.
        worlds: ``<generation>/<world>`` of each world that there is said to be.
        digests: SHA-256 of each world's document, as they are driven in.
        first: Floor plan and interior of the job's first world.
        most: How many worlds are made again; all, if there are no more.
        draw: Draws them; unpredictable, if not given.
    """
    indices = world_indices(request, first)
    names = [f"{order.generation}/{world_name(*each)}" for each in indices]
    if list(worlds) != [name for name in names if name in set(worlds)]:
        return [f"the record of {order.generation} names worlds that it was not asked for: {list(worlds)!r:.200}"]
    places = sorted((draw or SystemRandom()).sample(range(len(indices)), min(most, len(indices))))
    changes: list[str] = []
    for place, made in zip(places, produce(order, [indices[place] for place in places]), strict=True):
        name = names[place]
        computed = hashlib.sha256(made.document.encode()).hexdigest() if made.code is None else "none"
        found = digests.get(name, "none") if name in set(worlds) else "none"
        if found != computed:
            changes.append(f"world {name} has the SHA-256 {found}; the template gives {computed}")
    return changes

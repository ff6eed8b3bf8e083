"""A world generation job: submitted once, resumed after any death, its worlds immutable objects in the store."""

import logging
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

from pydantic import JsonValue

from specs.digests import canonical_document, canonical_json
from specs.errors import ObjectExists, StoreError
from specs.template import TemplateBody, template_digest
from specs.world_jobs import MAX_WORLDS_OF_JOB, CreateWorldGenerationJobRequest
from tasks.storage.claim import Claim, claimed
from tasks.storage.keys import claim_key, template_key, world_key
from tasks.storage.records import JobKind, JobRecord, advance, is_terminal, read, submit
from tasks.storage.store import Store
from tasks.worlds.canonical import encode_world
from tasks.worlds.generate import generate_world, world_name
from tasks.worlds.rejection import WorldRejected

KIND: JobKind = "world-generation-job"
_REASON_LENGTH = 1024
_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class _Job:
    """What one run of a job works with."""

    store: Store
    record: JobRecord
    template: TemplateBody
    seed: int


@dataclass
class _Finished:
    """What has come of a job so far: references of its worlds, and failures by code with one sample reason."""

    worlds: list[str] = field(default_factory=list[str])
    failures: dict[str, tuple[int, str]] = field(default_factory=dict[str, tuple[int, str]])

    def failed(self, rejected: WorldRejected) -> None:
        """Counts one world that could not be generated."""
        count, sample = self.failures.get(rejected.code, (0, rejected.reason))
        self.failures[rejected.code] = (count + 1, sample)

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
) -> JobRecord:
    """Returns the job's terminal record, having generated the worlds that were missing.

    Args:
        store: Where worlds and records lie.
        request: What is asked for; its counts default to 1.
        template: The template that the request names.
        seed: At least 0; together with the template it belongs to the request.
        token: The client request token.
        progress: Called with worlds finished and worlds in all.

    Raises:
        IdempotentParameterMismatch: The token was used with another request, template or seed.
        StoreError: Another process took the job over, or a world in the store is not what this job generates.
    """
    digest = template_digest(template)
    asked: dict[str, JsonValue] = {**canonical_document(request), "seed": seed, "templateDigest": digest}
    record = submit(store, KIND, asked, token)
    if is_terminal(record):
        return record
    with claimed(store, claim_key(KIND, record.id)) as claim:
        record = read(store, KIND, record.id)
        if is_terminal(record):
            return record
        floorplans, interiors = _counts(request)
        if min(floorplans, interiors) < 1 or floorplans * interiors > MAX_WORLDS_OF_JOB:
            return _refuse(store, record, floorplans, interiors)
        _keep_template(store, template, digest)
        advance(store, KIND, record.id, "Running", detail={"template_digest": digest, "seed": seed})
        job = _Job(store, record, template, seed)
        return _end(store, record, _make_all(job, claim, floorplans, interiors, progress))


def _make_all(
    job: _Job, claim: Claim, floorplans: int, interiors: int, progress: Callable[[int, int], None]
) -> _Finished:
    """Returns what came of all worlds of the job, one after the other."""
    finished, total = _Finished(), floorplans * interiors
    for done, (floorplan_index, interior_index) in enumerate(_indices(floorplans, interiors)):
        progress(done, total)
        if claim.lost:
            raise StoreError(f"{job.record.arn}: another process took this job over; it will finish it")
        try:
            finished.worlds.append(_make(job, floorplan_index, interior_index))
        except WorldRejected as rejected:
            _log.warning("%s: %s", job.record.id, rejected)
            finished.failed(rejected)
    progress(total, total)
    return finished


def _counts(request: CreateWorldGenerationJobRequest) -> tuple[int, int]:
    wanted = request.worldCount.floorplanCount, request.worldCount.interiorCountPerFloorplan
    return 1 if wanted[0] is None else wanted[0], 1 if wanted[1] is None else wanted[1]


def _indices(floorplans: int, interiors: int) -> Iterator[tuple[int, int]]:
    return ((plan, interior) for plan in range(1, floorplans + 1) for interior in range(1, interiors + 1))


def _refuse(store: Store, record: JobRecord, floorplans: int, interiors: int) -> JobRecord:
    """Fails the job rather than the call for a count that is out of range (semantics 5)."""
    reason = (
        f"{floorplans} floor plans x {interiors} interiors are {floorplans * interiors} worlds; "
        f"a job makes 1 to {MAX_WORLDS_OF_JOB}"
    )
    detail = _Finished().detail()
    code = "AllWorldGenerationFailed"
    return advance(store, KIND, record.id, "Failed", failure_code=code, failure_reason=reason, detail=detail)


def _keep_template(store: Store, template: TemplateBody, digest: str) -> None:
    """Keeps the body under its digest, so that what a job used can be read however the template changes."""
    _create_once(store, template_key(digest), canonical_json(canonical_document(template)))


def _make(job: _Job, floorplan_index: int, interior_index: int) -> str:
    """Returns a world's reference, the world being in the store; one that is there was created whole, by this job.

    Raises:
        WorldRejected: It cannot be generated.
    """
    generation, name = job.record.id, world_name(floorplan_index, interior_index)
    key = world_key(generation, name)
    if not job.store.exists(key):
        world = generate_world(
            job.template,
            seed=job.seed,
            generation=generation,
            floorplan_index=floorplan_index,
            interior_index=interior_index,
        )
        _create_once(job.store, key, encode_world(world))
    return f"{generation}/{name}"


def _create_once(store: Store, key: str, body: bytes) -> None:
    """Creates an object, or finds it there with the same bytes.

    Raises:
        StoreError: It is there with other bytes.
    """
    try:
        store.create(key, body)
    except ObjectExists as exc:
        if store.get(key).body != body:
            raise StoreError(f"{store.url}: {key} holds something else than this version of Simyard makes") from exc


def _end(store: Store, record: JobRecord, finished: _Finished) -> JobRecord:
    detail = finished.detail()
    if not finished.failures:
        return advance(store, KIND, record.id, "Completed", detail=detail)
    if finished.worlds:
        return advance(store, KIND, record.id, "PartialFailed", detail=detail)
    reason = next(reason for _, reason in finished.failures.values())[:_REASON_LENGTH]
    code = "AllWorldGenerationFailed"
    return advance(store, KIND, record.id, "Failed", failure_code=code, failure_reason=reason, detail=detail)

"""An export job: worlds out of the store, one zip and the floor plans into a bucket.

The keys of everything that is written come from the job's id and the bytes from the worlds alone, so a job that was
killed anywhere is simply done again over itself.
"""

import logging
import tempfile
from collections.abc import Callable, Collection, Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

from pydantic import JsonValue

from specs.arn import parse_reference
from specs.base import Fault
from specs.digests import canonical_document
from specs.errors import DocumentError, SimyardError, StoreError
from specs.pipeline_worlds import WorldFormat
from specs.world import World
from specs.world_jobs import CreateWorldExportJobRequest
from tasks.export.bundle import write_zip
from tasks.export.failures import failure_code, failure_reason
from tasks.export.installed import require_writable
from tasks.export.stored import SOURCE, read_world
from tasks.export.svg import floor_plan_svg
from tasks.export.uploading import put, upload
from tasks.storage.buckets import open_bucket
from tasks.storage.claim import claimed
from tasks.storage.keys import claim_key, output_key
from tasks.storage.records import JobKind, JobRecord, advance, is_terminal, read, submit
from tasks.storage.store import Store

KIND: JobKind = "world-export-job"
_STOPPED = frozenset({"Canceling", "Canceled"})
Progress = Callable[[int, int], None]

_log = logging.getLogger(__name__)


def run_export_job(
    store: Store,
    request: CreateWorldExportJobRequest,
    *,
    formats: Collection[WorldFormat],
    token: str,
    progress: Progress,
) -> JobRecord:
    """Returns the record of the export job, ended: Completed, Failed or Canceled.

    Args:
        store: Where the worlds and the record are.
        request: RoboMaker's request; its worlds are ARNs or ``<generation>/<world>``.
        formats: What each world is written as; part of what the token stands for.
        token: The client request token.
        progress: Told how many of how many worlds are written.

    Raises:
        IdempotentParameterMismatch: The token came with another request before.
        StoreError: The store itself, which holds the record, cannot be written; the job can be run again.
    """
    document: dict[str, JsonValue] = {**canonical_document(request), "formats": [*sorted(set(formats))]}
    job = submit(store, KIND, document, token).id
    with claimed(store, claim_key(KIND, job)):
        record = read(store, KIND, job)
        if is_terminal(record):
            return record
        if record.status == "Canceling":
            return advance(store, KIND, job, "Canceled")
        if record.status == "Pending":
            advance(store, KIND, job, "Running", only_from={"Pending"})
        return _worked_off(store, request, formats, job, progress)


class _Canceling(Exception):  # noqa: N818 - a state
    """Somebody cancelled the job; what it had sent is removed as this passes ``_nothing_left``."""


def _worked_off(
    store: Store,
    request: CreateWorldExportJobRequest,
    formats: Collection[WorldFormat],
    job: str,
    progress: Progress,
) -> JobRecord:
    try:
        return _export(store, request, formats, job, progress)
    except _Canceling:
        return advance(store, KIND, job, "Canceled")
    except SimyardError as exc:
        _log.warning("export %s failed: %s", job, exc)
        return advance(store, KIND, job, "Failed", failure_code=failure_code(exc), failure_reason=failure_reason(exc))


def _go_on(store: Store, job: str) -> None:
    if read(store, KIND, job).status in _STOPPED:
        raise _Canceling


def _completed(store: Store, job: str, detail: dict[str, JsonValue]) -> JobRecord:
    record = advance(store, KIND, job, "Completed", detail=detail, only_from={"Running"})
    if record.status in _STOPPED:
        raise _Canceling
    return record


def _export(
    store: Store,
    request: CreateWorldExportJobRequest,
    formats: Collection[WorldFormat],
    job: str,
    progress: Progress,
) -> JobRecord:
    require_writable(formats, SOURCE)
    references = _references(request.worlds)
    bucket = open_bucket(store, request.outputLocation.s3Bucket or "")
    prefix = request.outputLocation.s3Prefix
    zip_key = output_key(prefix, f"{job}.zip")
    plan_keys = {each: output_key(prefix, f"{job}/{_plan_name(each, references)}") for each in references}
    plans: dict[str, str] = {}

    def read_worlds() -> Iterator[World]:
        for number, reference in enumerate(references, start=1):
            _go_on(store, job)
            world = read_world(store, reference)
            if "svg" in formats:
                plans[plan_keys[reference]] = floor_plan_svg(world)
            yield world
            progress(number, len(references))

    with tempfile.TemporaryDirectory(prefix="simyard-export-") as folder, _nothing_left(bucket, zip_key, plan_keys):
        target = Path(folder) / f"{job}.zip"
        sha256 = write_zip(read_worlds(), formats, target)
        for key, plan in plans.items():
            _go_on(store, job)
            put(bucket, key, plan.encode())
        _go_on(store, job)
        upload(bucket, zip_key, target)  # last: where it lies, all lies
        urls: list[JsonValue] = [f"{bucket.url}/{key}" for key in plans]
        return _completed(store, job, {"zip": f"{bucket.url}/{zip_key}", "svg": urls, "sha256": sha256})


@contextmanager
def _nothing_left(bucket: Store, zip_key: str, plan_keys: Mapping[str, str]) -> Generator[None]:
    """Removes what this run or one that was killed has sent, the zip first, when the job turns out cancelled."""
    try:
        yield
    except _Canceling:
        try:
            for key in (zip_key, *plan_keys.values()):
                bucket.delete(key)
        except StoreError as exc:
            # To remove is a permission of its own; the job is cancelled all the same.
            _log.warning("what a cancelled export had sent stays: %s", exc)
        raise


def _references(worlds: Sequence[str]) -> list[str]:
    """Returns each world once as ``<generation>/<world>``, sorted, so that the order asked for changes no byte."""
    faults: list[Fault] = []
    found: set[str] = set()
    for number, text in enumerate(worlds):
        try:
            reference = parse_reference(text)
        except ValueError as exc:
            faults.append(Fault(path=f"worlds[{number}]", value=text, allowed=str(exc)))
            continue
        if reference.kind not in (None, "world") or reference.path.count("/") != 1:
            faults.append(
                Fault(path=f"worlds[{number}]", value=text, allowed="a world: <generation>/<world> or its ARN")
            )
        found.add(reference.path)
    if faults:
        raise DocumentError(faults, source=SOURCE)
    return sorted(found)


def _plan_name(reference: str, references: Sequence[str]) -> str:
    """Returns ``<world>.svg``, below the generation's name where the job has worlds of several."""
    generations = {other.split("/")[0] for other in references}
    return f"{reference if len(generations) > 1 else reference.split('/')[1]}.svg"

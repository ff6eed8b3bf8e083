"""An export job: worlds out of the store, one zip and the floor plans into a bucket.

The keys of everything that is written come from the job's id and the bytes from the worlds alone, so a job that was
killed anywhere is simply done again over itself.
"""

import logging
import random
import tempfile
import time
from collections.abc import Callable, Collection, Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from pydantic import JsonValue

from specs.arn import parse_reference
from specs.base import Fault, canonical_document
from specs.errors import BucketNotFound, DocumentError, SimyardError, StoreDamaged, StoreError, StoreUnreachable
from specs.job_kinds import JobKind
from specs.pipeline.world_sections import WorldFormat
from specs.robomaker.world_jobs import CreateWorldExportJobRequest
from tasks.export.format.formats import require_writable
from tasks.export.job.export_answers import failure_code, failure_reason, is_outage
from tasks.export.job.world_files import SOURCE, WorldFiles, drop_parts, kept_part, world_files, write_zip
from tasks.storage.base.keys import claim_key, output_key
from tasks.storage.base.store import Store
from tasks.storage.buckets import open_bucket
from tasks.storage.jobs.claim import hold_claim
from tasks.storage.jobs.records import JobRecord, advance, is_terminal, read, submit
from tasks.storage.worlds import read_world

_WAITS_S = (1.0, 3.0, 9.0)
_log = logging.getLogger(__name__)


def upload(bucket: Store, key: str, source: Path) -> None:
    """Uploads a file whose key nobody else writes; tries again while the bucket does not answer or damages it.

    What earlier uploads of the key have left is swept away first: parts that nobody sees are paid for.

    Raises:
        StoreError: What went wrong the last time.
    """
    try:
        bucket.sweep(key)
    except StoreError as exc:
        # To list unfinished uploads is a permission of its own, and not every server can; whether one may write is
        # told by writing.
        _log.warning("what broken uploads have left stays: %s", exc)
    _patiently(lambda: bucket.upload(key, source))


def put(bucket: Store, key: str, body: bytes) -> None:
    """Writes a small object; tries again while the bucket does not answer.

    Raises:
        StoreError: What went wrong the last time.
    """
    _patiently(lambda: bucket.put(key, body))


def _patiently(write: Callable[[], object]) -> None:
    for wait_s in _WAITS_S:
        try:
            write()
        except BucketNotFound:
            raise
        except (StoreDamaged, StoreUnreachable) as exc:
            # Spread, so that a hundred exports that failed together do not come back together.
            spread_s = wait_s * random.SystemRandom().uniform(0.5, 1.5)
            _log.warning("%s; trying again in %.1f s", exc, spread_s)
            time.sleep(spread_s)
        else:
            return
    write()


KIND: JobKind = "world-export-job"
_STOPPED = frozenset({"Canceling", "Canceled"})
Progress = Callable[[int, int], None]


class ExportWorkers(Protocol):
    """Workers that keep the files of worlds in the store (``world_files``), as many as they come to."""

    def __call__(
        self,
        job: str,
        references: Sequence[str],
        formats: Collection[WorldFormat],
        *,
        going: Callable[[], bool],
        done: Callable[[int], None],
    ) -> None:
        """Returns once all are kept, or nobody wants them any more.

        Args:
            job: The export job.
            references: ``<generation>/<world>`` of each world.
            formats: What each is written as.
            going: Whether anything more is wanted.
            done: Told of more that are kept, and how many they are.
        """
        ...


def run_export_job(
    store: Store,
    request: CreateWorldExportJobRequest,
    *,
    formats: Collection[WorldFormat],
    token: str,
    progress: Progress,
    elsewhere: ExportWorkers | None = None,
) -> JobRecord:
    """Returns the record of the export job, ended: Completed, Failed or Canceled.

    Args:
        store: Where the worlds and the record are.
        request: RoboMaker's request; its worlds are ARNs or ``<generation>/<world>``.
        formats: What each world is written as; part of what the token stands for.
        token: The client request token.
        progress: Told how many of how many worlds are written.
        elsewhere: Workers who write what worlds become, where there are any; the zip is the same bytes.

    Raises:
        IdempotentParameterMismatch: The token came with another request before.
        StoreError: The store itself, which holds the record, cannot be written, or the bucket does not answer; the job
            can be run again.
    """
    document: dict[str, JsonValue] = {**canonical_document(request), "formats": [*sorted(set(formats))]}
    job = submit(store, KIND, document, token).id
    with hold_claim(store, claim_key(KIND, job)):
        record = read(store, KIND, job)
        if is_terminal(record):
            return record
        record = _work_off(_Work(store, request, formats, job, progress, elsewhere), record)
        _drop_kept_parts(store, job)
        return record


class _Canceling(Exception):  # noqa: N818 - a state
    """Somebody cancelled the job; what it had sent is removed as this passes ``_nothing_left``."""


@dataclass(frozen=True)
class _Work:
    store: Store
    request: CreateWorldExportJobRequest
    formats: Collection[WorldFormat]
    job: str
    progress: Progress
    elsewhere: ExportWorkers | None

    def goes_on(self) -> bool:
        return read(self.store, KIND, self.job).status not in _STOPPED

    def checked(self) -> None:
        if not self.goes_on():
            raise _Canceling


def _work_off(work: _Work, record: JobRecord) -> JobRecord:
    store, job = work.store, work.job
    if record.status == "Canceling":
        return advance(store, KIND, job, "Canceled")
    if record.status == "Pending":
        advance(store, KIND, job, "Running", only_from={"Pending"})
    try:
        return _export(work)
    except _Canceling:
        return advance(store, KIND, job, "Canceled")
    except SimyardError as exc:
        if is_outage(exc):
            raise
        _log.warning("export %s failed: %s", job, exc)
        return advance(store, KIND, job, "Failed", failure_code=failure_code(exc), failure_reason=failure_reason(exc))


def _complete(store: Store, job: str, detail: dict[str, JsonValue]) -> JobRecord:
    record = advance(store, KIND, job, "Completed", detail=detail, only_from={"Running"})
    if record.status in _STOPPED:
        raise _Canceling
    return record


def _export(work: _Work) -> JobRecord:
    require_writable(work.formats, SOURCE)
    references = _references(work.request.worlds)
    bucket = open_bucket(work.store, work.request.outputLocation.s3Bucket or "")
    prefix = work.request.outputLocation.s3Prefix
    zip_key = output_key(prefix, f"{work.job}.zip")
    plan_keys = {each: output_key(prefix, f"{work.job}/{_plan_name(each, references)}") for each in references}
    plans: dict[str, bytes] = {}
    with tempfile.TemporaryDirectory(prefix="simyard-export-") as folder, _nothing_left(bucket, zip_key, plan_keys):
        target = Path(folder) / f"{work.job}.zip"
        sha256 = write_zip(_parts(work, references, plans), work.formats, target)
        for reference, plan in plans.items():
            work.checked()
            put(bucket, plan_keys[reference], plan)
        work.checked()
        upload(bucket, zip_key, target)  # last: where it lies, all lies
        urls: list[JsonValue] = [f"{bucket.url}/{plan_keys[each]}" for each in plans]
        return _complete(work.store, work.job, {"zip": f"{bucket.url}/{zip_key}", "svg": urls, "sha256": sha256})


def _parts(work: _Work, references: Sequence[str], plans: dict[str, bytes]) -> Iterator[WorldFiles]:
    """Yields what each world becomes, made by workers where there are any, and sets its plan aside."""
    total, made = len(references), 0

    def done(more: int) -> None:
        nonlocal made
        made += more
        work.progress(made, total)

    if work.elsewhere:
        work.elsewhere(work.job, references, work.formats, going=work.goes_on, done=done)
    for number, reference in enumerate(references, start=1):
        work.checked()
        part = kept_part(work.store, work.job, reference) if work.elsewhere else None
        part = part or world_files(read_world(work.store, reference, SOURCE), work.formats)
        if "svg" in work.formats:
            plans[reference] = part.files[f"svg/{reference}.svg"]
        yield part
        work.progress(max(made, number), total)


def _drop_kept_parts(store: Store, job: str) -> None:
    try:
        drop_parts(store, job)
    except StoreError as exc:  # the job has ended, and `simyard gc` comes by
        _log.warning("what workers made for %s stays: %s", job, exc)


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

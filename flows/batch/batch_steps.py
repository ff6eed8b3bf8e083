"""The steps of a batch: plain functions of data, each of which may run in another process, on another machine.

They join what simulates to what keeps results, so that they belong to no single capability. What a step needs of the
store it reads there; what it makes is in the store when it returns. Between chunks `SequentialStop` ends a batch whose
gate is certain.
"""

import functools
from collections.abc import Callable, Generator, Iterable
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

from pydantic import JsonValue

from flows.batch.batch_end import RecordedEpisodes, write_tables_of
from specs.data.episode import EpisodeResult, Failure
from specs.data.parity_audit import audit_report
from specs.errors import BucketNotFound, BundleRefused, ResourceNotFound, StageFailed, StoreAccessDenied, StoreError
from specs.field_types import OutputLocation
from specs.pipeline.gate_section import Gate
from tasks.applications.registry import BUNDLE_ERRORS, bundle_failure, resolve
from tasks.applications.step import unpack_application
from tasks.progress.listener import report_progress, stage_progress
from tasks.results.gate.gate_verdict import InterimGate
from tasks.results.statistics.batch_summary import summary_note, summary_rows
from tasks.results.tables.recordings import write_output
from tasks.simulate.audit.audit_run import write_audit
from tasks.simulate.batch.batch_record import OpenBatch, leave_out, load_batch
from tasks.simulate.batch.chunk_run import ChunkEnd, ChunkRunner, coming_chunks, run_chunk, tag_jobs
from tasks.simulate.batch.chunk_store import counted_chunk
from tasks.simulate.lane.recording import Columns
from tasks.storage.jobs.authenticator import BatchAuthenticator
from tasks.storage.store_url import open_store

EPISODES, AUDIT = "Episodes", "Audit (driven twice)"


class BatchTables(NamedTuple):
    """What a batch's tables say.

    Attributes:
        detail: Where they lie and what they add up to, for the batch's record.
        rows: Their summary, a row a line, as `tasks.results.statistics.batch_summary.summary_rows` has it.
        note: What its intervals are.
    """

    detail: dict[str, JsonValue]
    rows: list[tuple[str, ...]]
    note: str


def simulate_chunk(
    store_url: str,
    batch: str,
    number: int,
    *,
    location: OutputLocation,
    lanes: int,
    left_s: float,
    spent_s: float,
    done: int = 0,
    ahead: tuple[int, ...] = (),
    authenticator: BatchAuthenticator | None = None,
) -> ChunkEnd:
    """Returns how a chunk ended, its results being committed; one that was committed before is not simulated again.

    Args:
        store_url: Where the batch's record, worlds, bundles and chunks are.
        batch: The batch's id.
        number: The chunk's.
        location: The batch's output location.
        lanes: How many lanes fit into memory, as far as is known.
        left_s: Wall seconds that the batch has left; lanes that need longer are cancelled.
        spent_s: Wall seconds that were spent on the batch before.
        done: Episodes of the chunks before, for whoever listens to progress.
        ahead: The chunks that this process is going to be asked for next: while this one drives, they are made ready,
            and their episodes begin as soon as lanes are free.
        authenticator: Authenticates the results on a worker; None on a machine of the owner.
    """
    work = load_batch(open_store(store_url), batch, authenticator)
    bundles = _bundles(work)
    episodes = RecordedEpisodes(work, location, bundles.folders)

    def record(chunk: int, parts: Iterable[Columns]) -> str:
        with _output_to(location):
            return episodes.write(chunk, parts)

    def progress(finished: int) -> None:
        report_progress(EPISODES, done + finished, work.layout.episodes)

    tagged = functools.partial(tag_jobs, work)
    coming = coming_chunks(work, ahead, bundles.failures)
    runner = ChunkRunner(bundles.folders, work.plan.engine, work.plan.recordings.rateHz, progress, tagged, coming)
    ended = run_chunk(
        work,
        number,
        runner.run,
        record if work.plan.records() else None,
        unusable=bundles.failures,
        lanes=lanes,
        left_s=left_s,
        spent_s=spent_s,
    )
    if printed := "".join(runner.printed):
        with _output_to(location):
            write_output(store_url, location, batch, number, printed)
    return ended


def write_tables(store_url: str, batch: str, status: str, location: OutputLocation) -> BatchTables:
    """Returns what a batch's tables say, which are written over what may be there.

    Args:
        store_url: The store that the output location's bucket belongs to.
        batch: The batch's id; every chunk that was begun is committed.
        status: That it ends in.
        location: Where the tables go.
    """
    work = load_batch(open_store(store_url), batch)
    with _output_to(location):
        detail, tally = write_tables_of(work, location, status)
    found = tally.summary()
    return BatchTables(detail, summary_rows(found), summary_note(found))


def audit_batch(
    store_url: str, batch: str, location: OutputLocation, chunks: int | None = None
) -> dict[str, JsonValue]:
    """Returns what the batch's record says of its audit.

    Args:
        store_url: Where the batch's record, worlds and chunks are.
        batch: The batch's id; all its chunks are committed, or so many as are audited.
        location: The batch's output location.
        chunks: How many chunks a batch has driven that may be ended now; None of one that has ended.
    """
    work, progress = load_batch(open_store(store_url), batch), stage_progress(AUDIT)
    lanes = min(work.plan.audit, work.layout.episodes)
    folders = _bundles(work).folders
    progress(0, 2 * lanes)
    with _output_to(location):
        return write_audit(work, folders, location, lambda done: progress(done, 2 * lanes), chunks=chunks)


@contextmanager
def _output_to(location: OutputLocation) -> Generator[None, None, None]:
    """Ends a batch whose output is refused inside the block for good; while a bucket is away, it can be continued.

    Raises:
        StageFailed: There is no such bucket, or it must not be written.
    """
    try:
        yield
    except (StoreAccessDenied, BucketNotFound) as exc:
        remedy = "let this machine's credentials write there, or name another bucket, and run the document again"
        why = f"the output bucket {location.s3Bucket} refuses what is written: {exc}: {remedy}"
        raise StageFailed("BadPermissionsS3Output", why) from exc


class Bundles(NamedTuple):
    """The applications of a batch on this machine, by digest.

    Attributes:
        folders: Where each is unpacked.
        failures: Why jobs fail that need one of the others.
    """

    folders: dict[str, Path]
    failures: dict[str, Failure]


def _bundles(batch: OpenBatch) -> Bundles:
    """Returns the applications of a batch; each is unpacked once on a machine."""
    found = Bundles({}, {})
    for digest in batch.plan.digests():
        try:
            found.folders[digest] = unpack_application(batch.store.url, digest)
        except BUNDLE_ERRORS as exc:
            found.failures[digest] = unusable_bundle(batch, digest, exc)
    return found


def unusable_bundle(batch: OpenBatch, digest: str, error: BundleRefused | StoreError) -> Failure:
    """Returns why jobs of a batch fail that need a bundle which cannot be unpacked.

    Raises:
        StoreAccessDenied: It is not the bundle that is refused.
    """
    kind, launch = next(use for use in batch.plan.launches() if use[1].digest == digest)
    return bundle_failure(batch.store, kind, f"{launch.name} version {launch.version}", digest, error)


class SequentialStop:
    """Looks at a batch after each chunk, in their order: a batch that is continued ends where it would have.

    Where two versions take turns on the same episodes, it looks after each second chunk. A PASS that an audit of the
    episodes so far gives reason to doubt ends nothing, nor does a later one: the batch goes on to its end, or to a
    FAIL, since more episodes may stand the doubt.

    Attributes:
        detail: What the batch's record says of its early end; empty if there was none.
        audit: What it says of the audit that let a PASS end it; empty if there was none.
    """

    def __init__(
        self, batch: OpenBatch, gate: Gate | None, audited: Callable[[int], dict[str, JsonValue]] | None = None
    ) -> None:
        """Begins to look, at a batch whose gate asks for it and whose plan allows it.

        Args:
            batch: The batch.
            gate: What its document asks for.
            audited: Audits so many chunks; None for a batch whose end is known.
        """
        self.detail: dict[str, JsonValue] = {}
        self.audit: dict[str, JsonValue] = {}
        self._audited, self._doubted = audited if batch.plan.audit else None, False
        self._batch, self._paired = batch, batch.plan.shuffled == "pairs"
        self._other, self._first = "", list[EpisodeResult]()
        if gate and self._paired:
            self._other = _compared_with(batch, gate)
        self._gate = gate if batch.plan.shuffled and (self._other or not self._paired) else None
        self._answer = InterimGate(self._gate, batch.layout.looks(), paired=self._paired) if self._gate else None

    def ends_before(self, number: int) -> bool:
        """Returns whether the gate is certain after the chunks before that one; if so, the rest is left out."""
        if self._answer is None or self._gate is None or number == 0 or not self._counted(number - 1, self._answer):
            return False
        answer = self._answer.answer()
        if answer is None or (answer == "PASS" and not self._stands(number, self._answer)):
            return False
        left_out, ended = leave_out(self._batch, number), self._answer.episodes()
        were = "was" if left_out == 1 else "were"
        after = f"{ended} episodes of each version" if self._paired else f"{ended} episodes"
        sentence = f"the gate was certain of {answer} after {after}, so that {left_out} {were} left out"
        self.detail["stopped_early"] = {
            "gate": self._gate.model_dump(mode="json"),
            "verdict": answer,
            "sentence": sentence,
            "episodes": ended,
            "left_out": left_out,
            **self._looks(),
        }
        return True

    def _stands(self, number: int, answer: InterimGate) -> bool:
        """Returns whether a PASS stands what an audit of the chunks before that one says; it is made once."""
        if self._audited and not self._doubted:
            found = self._audited(number)
            self._doubted = not answer.stands(audit_report(found))
            self.audit = {} if self._doubted else found
        return not self._doubted

    def _looks(self) -> dict[str, JsonValue]:
        """Returns after how many episodes the gate was asked; of a batch of before there is nothing to say."""
        looks = self._batch.layout.looks()
        return {"looks": list(looks)} if looks else {}

    def _counted(self, number: int, answer: InterimGate) -> bool:
        """Counts a chunk; returns whether the gate may be asked now."""
        rows = list(counted_chunk(self._batch.store, self._batch.id, number, self._batch.authenticator) or ())
        if not self._paired:
            answer.add(rows)
            return True
        if number % 2 == 0:
            self._first = rows
            return False
        other_now = self._batch.layout.chunk(number).requests[0].robot.digest == self._other
        answer.add(*(self._first, rows) if other_now else (rows, self._first))
        return True


def _compared_with(batch: OpenBatch, gate: Gate) -> str:
    """Returns the digest of the version that the gate compares with, if the batch drives it; else nothing."""
    robots = [template.robot for template in batch.plan.templates]
    if gate.noWorseThan is None or len({robot.name for robot in robots}) != 1:
        return ""
    try:
        digest = resolve(batch.store, "robot-application", robots[0].name, gate.noWorseThan.applicationVersion).digest
    except ResourceNotFound:
        return ""
    return digest if digest in {robot.digest for robot in robots} else ""

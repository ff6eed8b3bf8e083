"""Audits a batch after its last chunk. What goes wrong in the audit is written into its report.

Processes drive the sample again, each the episodes of one robot; what they drove is compared here. It depends on the
batch alone, so that an audit whose process died is simply made again. One that keeps killing its process, for want of
memory, is given up: the batch would never end.
"""

import hashlib
import logging
from collections import ChainMap
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from pydantic import JsonValue

from specs.base import Spec
from specs.data.episode import CONTROL_HZ, EpisodeRequest
from specs.data.parity_audit import AuditReport
from specs.data.world import World
from specs.field_types import OutputLocation
from tasks.simulate.application.bundle_code import BundleCrash, crash_code
from tasks.simulate.audit.audit_report import (
    DRIVE_ARRAYS,
    AuditDrives,
    Driven,
    DrivenEpisode,
    audit_report,
    not_run,
    received_drive,
)
from tasks.simulate.audit.audit_sample import SampledEpisode, draw_sample
from tasks.simulate.batch.batch_record import OpenBatch
from tasks.simulate.batch.chunk_run import batch_mounts, load_worlds
from tasks.simulate.batch.chunk_store import counted_chunk
from tasks.simulate.batch.provenance import another_gl
from tasks.simulate.chunk.byproducts import collect_timings
from tasks.simulate.devices import device_kind
from tasks.simulate.engines.engine_table import ENGINES, REFERENCE
from tasks.simulate.sandbox.process_pool import ask_exclusive
from tasks.simulate.sandbox.protocol import Answer, Audited, AuditWork, Crashed, NoMemory, Progress
from tasks.simulate.sandbox.simulator import Simulator, SimulatorEnded
from tasks.storage.base.keys import output_key, result_key
from tasks.storage.base.store import encode_document, find_document
from tasks.storage.buckets import open_bucket


def ask_audit(
    sample: Sequence[SampledEpisode],
    worlds: Mapping[str, World],
    bundles: Mapping[str, Path],
    *,
    lanes: int,
    engine: str = "auto",
    drawn: int = 0,
    progress: Callable[[int], None] = lambda _: None,
) -> AuditReport:
    """Returns what driving a sample again shows.

    The episodes of each robot are driven in a process that has no other one's code, and compared here.

    Args:
        sample: At least one episode.
        worlds: At least those of the sample.
        bundles: Unpacked folders of the applications, by digest.
        lanes: Of a program.
        engine: What the batch asked for.
        drawn: How many episodes were to be audited, if more than the sample: worlds may be gone.
        progress: Told how many of two drives for each episode are done, or will not be made.

    Raises:
        BundleCrash: An application that made rows before now fails.
        MemoryError: There is not enough memory for so many lanes.
        SimulatorEnded: The process ended over it, or answered what is no drive.
    """
    ask = _Drives(worlds, bundles, lanes, engine)
    groups: dict[frozenset[str], list[SampledEpisode]] = {}
    for each in sample:
        groups.setdefault(each.request.bundles, []).append(each)
    ours, theirs, why, done = dict[int, DrivenEpisode](), dict[int, DrivenEpisode](), "", 0
    for group in groups.values():
        found = ask.drives(group, lambda part, before=done: progress(before + part))
        ours, theirs, why = {**ours, **found.ours}, {**theirs, **found.theirs}, why or found.why
        done += 2 * len(group)
    progress(2 * len(sample))

    def control() -> Sequence[Driven]:
        again = [[each.request for each in group if each.row.index in theirs] for group in groups.values()]
        drives = [ask.control(requests) for requests in again if requests]
        return [dict(ChainMap(*map(dict, parts))) for parts in zip(*drives, strict=True)] if all(drives) else []

    return audit_report(sample, AuditDrives(ours, theirs, why), control, drawn)


class _Drives(NamedTuple):
    """Asks processes to drive episodes, each for the episodes of one robot."""

    worlds: Mapping[str, World]
    bundles: Mapping[str, Path]
    lanes: int
    engine: str

    def drives(self, group: Sequence[SampledEpisode], progress: Callable[[int], None]) -> AuditDrives:
        """Returns what drives of some episodes made of them."""
        here = tuple(each.request for each in group if each.row.device == device_kind())
        others = tuple(each.request for each in group if each.row.engine != REFERENCE)
        (ours, theirs), why = self._ask(here, others, [here, others], progress)
        return AuditDrives(ours, theirs, why)

    def control(self, requests: Sequence[EpisodeRequest]) -> Sequence[Driven]:
        """Returns what C MuJoCo makes of episodes from a micrometre beside, in each direction; nothing if it cannot."""
        found, _ = self._ask((), tuple(requests), [requests] * 2, lambda _: None, control=True)
        return found

    def _ask(
        self,
        here: tuple[EpisodeRequest, ...],
        others: tuple[EpisodeRequest, ...],
        drives: Sequence[Sequence[EpisodeRequest]],
        progress: Callable[[int], None],
        *,
        control: bool = False,
    ) -> tuple[list[Driven], str]:
        used = dict.fromkeys(request.world for request in (*here, *others))
        digests = {digest for request in (*here, *others) for digest in request.bundles}
        folders = {digest: folder for digest, folder in self.bundles.items() if digest in digests}

        def hear(answer: Answer, _: tuple[np.ndarray, ...]) -> None:
            if isinstance(answer, Progress):
                progress(answer.done)

        def question(process: Simulator) -> AuditWork:
            return AuditWork(
                here=here,
                others=others,
                worlds=process.sent_worlds({name: self.worlds[name] for name in used}),
                bundles={digest: str(folder) for digest, folder in folders.items()},
                lanes=self.lanes,
                engine=self.engine,
                control=control,
            )

        last, arrays = ask_exclusive(folders, question, hear)
        match last:
            case Audited() as audited:
                return _received(arrays, drives, control=control), audited.why
            case Crashed() as crashed:
                raise BundleCrash(crash_code(crashed.code), crashed.reason)
            case NoMemory() as lack:
                raise MemoryError(lack.text)
            case other:
                raise SimulatorEnded(f"it answered {other.kind!r} to an audit", None, "", killed="limit")


def _received(
    arrays: Sequence[np.ndarray], drives: Sequence[Sequence[EpisodeRequest]], *, control: bool
) -> list[Driven]:
    """Returns the drives that a process sent: as many as it was asked for, or none of a control.

    Raises:
        SimulatorEnded: It sent anything else.
    """
    if control and not arrays:
        return []
    try:
        parts = [arrays[k : k + DRIVE_ARRAYS] for k in range(0, len(arrays), DRIVE_ARRAYS)]
        return [
            received_drive(part, [request.index for request in asked])
            for part, asked in zip(parts, drives, strict=True)
        ]
    except ValueError as exc:
        raise SimulatorEnded(f"it answered what is no answer: {exc}", None, "", killed="limit") from exc


logger = logging.getLogger(__name__)
AUDIT_FILE = "audit.json"
_BEGUN_FILE = "audit-begun.json"
_MOST_ATTEMPTS = 4
# What a program of the audit's own lanes takes, to compile or to load: the batch's is there already
# (docs/decisions/0034-stages-at-a-time.md), and is worth idle lanes that take less. With 256 lanes, of which 32 are
# audited, that is so up to 248 simulated seconds of `planar`, and up to 14 of `mujoco`.
_PROGRAM_S = 5.0
AuditProgress = Callable[[int], None]


class _Begun(Spec):
    """How often a batch's audit was begun; more than once when the process that made it died."""

    attempts: int


def write_audit(
    batch: OpenBatch,
    bundles: Mapping[str, Path],
    location: OutputLocation,
    progress: AuditProgress = lambda _: None,
    *,
    chunks: int | None = None,
) -> dict[str, JsonValue]:
    """Returns what a batch's record says of its audit.

    That is ``audit``, the report; ``audit_url``, where it lies beside the tables; and its SHA-256 by its file's name in
    ``sha256s``.

    Args:
        batch: All its chunks are committed, or so many as are audited.
        bundles: Unpacked folders of the applications, by digest.
        location: The batch's output location.
        progress: Told how many episodes were driven again, out of two for each lane.
        chunks: How many chunks a batch has driven that may be ended now; None of one that has ended.
    """
    attempts = _begin(batch)
    if attempts > _MOST_ATTEMPTS:
        report = not_run(f"its process died {_MOST_ATTEMPTS} times")
    else:
        report = _audited(batch, bundles, progress, chunks)
    logger.info("the audit of %s says %s: %s", batch.id, report.verdict, report.sentence)
    bucket = open_bucket(batch.store, location.s3Bucket or "")
    key = output_key(location.s3Prefix, f"{batch.id}/{AUDIT_FILE}")
    body = encode_document(report)
    bucket.put(key, body)
    return {**_said(report), "audit_url": f"{bucket.url}/{key}"}


def audit_again(batch: OpenBatch, bundles: Mapping[str, Path], chunks: int | None = None) -> dict[str, JsonValue]:
    """Returns what a batch's record has to say of its audit, which is made anew; nothing is written.

    Args:
        batch: All its chunks are committed, or so many as are audited.
        bundles: Unpacked folders of the applications, by digest.
        chunks: As for `write_audit`.
    """
    return _said(_audited(batch, bundles, lambda _: None, chunks))


def _said(report: AuditReport) -> dict[str, JsonValue]:
    digests: dict[str, JsonValue] = {AUDIT_FILE: hashlib.sha256(encode_document(report)).hexdigest()}
    return {"audit": report.model_dump(mode="json"), "sha256s": digests}


def _audited(
    batch: OpenBatch, bundles: Mapping[str, Path], progress: AuditProgress, chunks: int | None = None
) -> AuditReport:
    found = draw_sample(
        batch.layout,
        lambda number: counted_chunk(batch.store, batch.id, number, batch.authenticator) or (),
        batch.plan.audit,
        chunks=chunks,
    )
    worlds, missing = load_worlds(batch, [each.request for each in found])
    mounted = batch_mounts(batch)
    missing |= {f"data of {k}": why for k, each in enumerate(found) if (why := mounted.failure(each.request))}
    sample = [
        each._replace(request=mounted.resolved(each.request))
        for each in found
        if each.request.world in worlds and not mounted.failure(each.request)
    ]
    if not sample:
        return not_run(str(next(iter(missing.values()), "no episode was driven to an end")))

    def drive(lanes: int) -> AuditReport:
        engine, drawn = batch.plan.engine, len(found)
        return ask_audit(sample, worlds, bundles, lanes=lanes, engine=engine, drawn=drawn, progress=progress)

    try:
        with collect_timings() as timings:
            report = _driven_fitting(batch, sample, drive)
        # Another GL that draws the same changes nothing: whoever recounts the batch with one gets the same report.
        gl = next((each.gl for each in timings if each.gl and report.unreproduced), "")
        other = another_gl(batch.record(), gl)
        return report.model_copy(update={"sentence": f"{report.sentence}; {other}"}) if other else report
    except BundleCrash as crash:
        return not_run(str(crash))
    except SimulatorEnded as ended:
        return not_run(ended.reason)
    except MemoryError as exc:
        return not_run(f"out of memory: {exc}")


def _driven_fitting(
    batch: OpenBatch, sample: Sequence[SampledEpisode], drive: Callable[[int], AuditReport]
) -> AuditReport:
    """Returns the report, driven with the batch's lanes where that is quick and they fit into memory.

    How many lanes there are changes no row (docs/decisions/0004-lanes-a-multiple-of-eight.md).
    """
    few = min(batch.plan.audit, batch.plan.lanes)
    if few < batch.plan.lanes and _idle_s(sample, batch.plan.lanes - few) < _PROGRAM_S:
        try:
            return drive(batch.plan.lanes)
        except (MemoryError, SimulatorEnded) as lack:  # its chunks may have gone on with fewer as well
            if isinstance(lack, SimulatorEnded) and not lack.out_of_memory:
                raise
            logger.warning("the audit of %s goes on with %d lanes: out of memory: %s", batch.id, few, lack)
    return drive(few)


def _idle_s(sample: Sequence[SampledEpisode], lanes: int) -> float:
    """Returns what lanes cost that stay idle until the sample's longest episode has ended: as much as others."""
    engines = {each.row.engine for each in sample}
    step_s = max((each.cost.lane_step_s for name, each in ENGINES.items() if name in engines), default=0.0)
    return lanes * step_s * CONTROL_HZ * max(each.row.simulated_s for each in sample)


def _begin(batch: OpenBatch) -> int:
    """Returns how often the audit was begun, this time included."""
    key = result_key(batch.id, _BEGUN_FILE)
    before = find_document(batch.store, key, _Begun)
    attempts = 1 + (before.attempts if before else 0)
    batch.store.put(key, encode_document(_Begun(attempts=attempts)))
    return attempts

"""An audit in another process is not ended by chunks that this process worked on besides."""

import hashlib
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
from pydantic import JsonValue

from specs.data.episode import EpisodeRequest
from specs.data.parity_audit import AuditReport
from specs.data.world import World
from specs.field_types import OutputLocation
from specs.robomaker.simulation import DataSourceConfig
from tasks.simulate.application.bundle_code import BundleCrash
from tasks.simulate.audit import audit_run
from tasks.simulate.audit.audit_report import DrivenEpisode, drive_arrays, not_run, received_drive, with_verdict
from tasks.simulate.audit.audit_run import ask_audit, write_audit
from tasks.simulate.audit.audit_sample import SampledEpisode, draw_sample
from tasks.simulate.batch.batch_record import OpenBatch
from tasks.simulate.batch.chunk_run import run_chunk
from tasks.simulate.batch.provenance import note_gl
from tasks.simulate.chunk.byproducts import ChunkTiming, note_timing
from tasks.simulate.data.data_sources import DATA_PREFIX
from tasks.simulate.data.mounts import pin_source
from tasks.simulate.devices import device_kind
from tasks.simulate.sandbox.protocol import Audited, AuditWork
from tasks.simulate.sandbox.simulator import SimulatorEnded, Told
from tasks.storage.base.store import Store
from tasks.storage.buckets import open_bucket
from tests.factories.episodes import passed, request
from tests.factories.planned_batches import begun, mixed, plan, template
from tests.factories.simulations import PUSHER
from tests.factories.worlds import apartment
from tests.simulate.ending_simulators import ended, use_simulators

NOTHING: Told = (Audited(), (*drive_arrays({}), *drive_arrays({})))


def drive(index: int) -> DrivenEpisode:
    return DrivenEpisode(passed(index).engine, passed(index), np.arange(6, dtype=np.float32).reshape(3, 2))


def sampled(asked: EpisodeRequest) -> SampledEpisode:
    """Returns an episode that this machine's kind of device drove."""
    return SampledEpisode(asked, passed(asked.index).model_copy(update={"device": device_kind()}), 1.0)


def asked_audit() -> AuditReport:
    asked = request(0)
    return ask_audit([sampled(asked)], {asked.world: apartment()}, {}, lanes=8)


def test_an_audit_whose_process_ended_beside_chunks_ahead_is_asked_once_more(monkeypatch: pytest.MonkeyPatch):
    asked = use_simulators(monkeypatch, [ended(beside_others=True), NOTHING])
    assert asked_audit().unreproduced == (0,)
    assert asked[0] == asked[1]


def test_each_robots_episodes_are_driven_in_a_process_of_their_own(monkeypatch: pytest.MonkeyPatch):
    asked = cast("list[AuditWork]", use_simulators(monkeypatch, [NOTHING, NOTHING]))
    ours = request(0)
    others = [each.model_copy(update={"robot": PUSHER}) for each in (request(1), request(2))]
    sample = [sampled(each) for each in (others[0], ours, others[1])]
    folders = {digest: Path(digest) for each in sample for digest in each.request.bundles}
    told: list[int] = []
    found = ask_audit(sample, {ours.world: apartment()}, folders, lanes=8, progress=told.append)
    assert [[each.index for each in work.here] for work in asked] == [[1, 2], [0]]
    assert [work.bundles.keys() for work in asked] == [others[0].bundles, ours.bundles]
    assert (found.unreproduced, told[-1]) == ((1, 0, 2), 6)


@pytest.mark.parametrize(
    "arrays",
    [
        (),
        drive_arrays({}),
        [*drive_arrays({}), np.zeros(0), np.zeros(0), np.zeros(0)],
        [*drive_arrays({7: drive(7)}), *drive_arrays({})],
        [*drive_arrays({0: drive(0)})[:1], np.array([5]), np.zeros((3, 2), np.float32), *drive_arrays({})],
        [*drive_arrays({0: drive(0)})[:2], np.full((3, 2), np.nan, np.float32), *drive_arrays({})],
    ],
)
def test_what_is_no_drive_is_refused(monkeypatch: pytest.MonkeyPatch, arrays: Sequence[np.ndarray]):
    use_simulators(monkeypatch, [(Audited(), tuple(arrays))])
    with pytest.raises(SimulatorEnded, match="it answered what is no answer"):
        asked_audit()


def test_a_drive_comes_out_as_it_went_in():
    sent = {3: drive(3), 1: drive(1)}
    found = received_drive(drive_arrays(sent), [1, 2, 3])
    assert [(k, each.row, each.places_m.tolist()) for k, each in found.items()] == [
        (k, each.row, each.places_m.tolist()) for k, each in sent.items()
    ]


@pytest.mark.parametrize("ends", [[False], [True, False], [True, True]])
def test_an_audit_that_ends_its_process_itself_is_given_up(monkeypatch: pytest.MonkeyPatch, ends: list[bool]):
    asked = use_simulators(monkeypatch, [ended(beside_others=each) for each in ends])
    with pytest.raises(SimulatorEnded, match="exit code 3"):
        asked_audit()
    assert len(asked) == len(ends)


PLACE = OutputLocation(s3Bucket="results", s3Prefix="nightly")
LANES, AUDITED = 256, 32
Calls = list[Sequence[SampledEpisode]]


@pytest.fixture
def audited(monkeypatch: pytest.MonkeyPatch) -> Calls:
    """Replaces the driving: every sample is sound."""
    calls: Calls = []

    def sound(sample: Sequence[SampledEpisode], *_: object, drawn: int, **__: object) -> AuditReport:
        calls.append(sample)
        count = len(sample)
        return with_verdict(AuditReport(verdict="NOT RUN", sentence="", sampled=drawn, lanes=count, compared=count))

    monkeypatch.setattr(audit_run, "ask_audit", sound)
    return calls


@pytest.fixture
def batch(file_store: Store) -> OpenBatch:
    """Returns a batch with all its chunks committed."""
    made = begun(file_store, plan(file_store))
    for number in range(made.layout.chunks):
        run_chunk(made, number, mixed, lanes=4, left_s=3600.0)
    return made


@pytest.fixture
def wide(file_store: Store) -> OpenBatch:
    """Returns a batch of many more lanes than are audited, likewise."""
    made = begun(file_store, plan(file_store, lanes=LANES, audit=AUDITED))
    run_chunk(made, 0, mixed, lanes=LANES, left_s=3600.0)
    return made


def report(detail: dict[str, JsonValue]) -> AuditReport:
    return AuditReport.model_validate(detail["audit"])


def test_the_report_lies_beside_the_tables(batch: OpenBatch, audited: Calls):
    detail = write_audit(batch, {}, PLACE)
    folder = f"{batch.store.url}/buckets/results/nightly/{batch.id}"
    assert detail["audit_url"] == f"{folder}/audit.json"
    written = Path(str(detail["audit_url"]).removeprefix("file://")).read_bytes()
    assert AuditReport.model_validate_json(written) == report(detail)
    assert detail["sha256s"] == {"audit.json": hashlib.sha256(written).hexdigest()}
    assert report(detail).verdict == "SOUND"
    assert [each.request.index for each in audited[0]] == [0, 1, 2, 3, 4, 5]


@pytest.mark.parametrize("unreproduced", [(), (1,)])
def test_a_report_says_that_another_gl_drew_the_pictures_where_rows_are_not_made_again(
    batch: OpenBatch, audited: Calls, monkeypatch: pytest.MonkeyPatch, unreproduced: tuple[int, ...]
):
    sound = audit_run.ask_audit

    def drawn(*args: Any, **options: Any) -> AuditReport:  # noqa: ANN401 - as it is asked
        note_timing(ChunkTiming(lanes=4, ready_s=0, compile_s=0, slices=1, slices_s=0, peak_bytes=0, gl="egl: one"))
        return sound(*args, **options).model_copy(update={"unreproduced": unreproduced})

    before = report(write_audit(batch, {}, PLACE)).sentence
    note_gl(batch, "osmesa: two")
    monkeypatch.setattr(audit_run, "ask_audit", drawn)
    told = "; its pictures were drawn by osmesa: two, and now are by egl: one" if unreproduced else ""
    assert report(write_audit(batch, {}, PLACE)).sentence == before + told
    assert len(audited) == 2


def test_an_audit_whose_process_died_is_made_again_and_then_given_up(
    batch: OpenBatch, audited: Calls, monkeypatch: pytest.MonkeyPatch
):
    first = write_audit(batch, {}, PLACE)

    def dies(*_: object, **__: object) -> AuditReport:
        raise KeyboardInterrupt

    with monkeypatch.context() as broken:
        broken.setattr(audit_run, "ask_audit", dies)
        for _ in range(2):
            with pytest.raises(KeyboardInterrupt):
                write_audit(batch, {}, PLACE)
    assert write_audit(batch, {}, PLACE) == first
    assert report(write_audit(batch, {}, PLACE)).sentence == "not run: its process died 4 times"
    assert len(audited) == 2


@pytest.mark.parametrize(
    ("error", "why"),
    [
        (BundleCrash("RobotApplicationCrash", "no module x"), "not run: RobotApplicationCrash: no module x"),
        (MemoryError("9 GB"), "not run: out of memory: 9 GB"),
        (SimulatorEnded("the process ended with exit code 3", None, ""), "not run: the process ended with exit code 3"),
    ],
)
def test_what_keeps_an_audit_from_running_is_data(
    batch: OpenBatch, monkeypatch: pytest.MonkeyPatch, error: Exception, why: str
):
    def fails(*_: object, **__: object) -> AuditReport:
        raise error

    monkeypatch.setattr(audit_run, "ask_audit", fails)
    found = report(write_audit(batch, {}, PLACE))
    assert (found.verdict, found.sentence) == ("NOT RUN", why)


def killed() -> SimulatorEnded:
    """Returns the end of a process as the kernel ends one for want of memory."""
    return SimulatorEnded("the process was ended by signal 9", None, "", status=-9)


@pytest.mark.parametrize("lack", [MemoryError("9 GB"), killed()])
def test_lanes_that_do_not_fit_into_memory_are_tried_once_more_with_those_of_the_audit(
    wide: OpenBatch, monkeypatch: pytest.MonkeyPatch, lack: Exception
):
    tried = lanes_tried(monkeypatch, lack, fitting=AUDITED)
    assert report(write_audit(wide, {}, PLACE)).sentence == "not run: a test says so"
    assert tried == [LANES, AUDITED]


def test_lanes_of_the_audit_that_do_not_fit_either_are_the_last_that_are_tried(
    wide: OpenBatch, monkeypatch: pytest.MonkeyPatch
):
    tried = lanes_tried(monkeypatch, MemoryError("9 GB"), fitting=0)
    assert report(write_audit(wide, {}, PLACE)).sentence == "not run: out of memory: 9 GB"
    assert tried == [LANES, AUDITED]


def test_a_process_that_ended_for_another_reason_is_not_followed_by_one_with_fewer_lanes(
    wide: OpenBatch, monkeypatch: pytest.MonkeyPatch
):
    tried = lanes_tried(monkeypatch, SimulatorEnded("the process ended with exit code 3", None, ""), fitting=0)
    write_audit(wide, {}, PLACE)
    assert tried == [LANES]


@pytest.mark.parametrize(
    ("engine", "simulated_s", "lanes"),
    [
        ("planar", 60.0, LANES),
        ("planar", 3600.0, AUDITED),
        ("mjx", 10.0, LANES),
        ("mjx", 60.0, LANES),
        ("mjx", 600.0, AUDITED),
        ("mujoco", 60.0, AUDITED),
    ],
)
def test_idle_lanes_that_would_take_longer_than_another_program_are_left_out(
    wide: OpenBatch, monkeypatch: pytest.MonkeyPatch, engine: str, simulated_s: float, lanes: int
):
    def long(*given: object, **more: object) -> list[SampledEpisode]:
        found = draw_sample(*given, **more)  # pyright: ignore[reportArgumentType]
        update = {"engine": engine, "simulated_s": simulated_s}
        return [each._replace(row=each.row.model_copy(update=update)) for each in found]

    monkeypatch.setattr(audit_run, "draw_sample", long)
    tried = lanes_tried(monkeypatch, MemoryError(), fitting=LANES)
    write_audit(wide, {}, PLACE)
    assert tried == [lanes]


def lanes_tried(monkeypatch: pytest.MonkeyPatch, lack: Exception, *, fitting: int) -> list[int]:
    """Returns with how many lanes audits are driven, of which only so many fit."""
    tried: list[int] = []

    def driven(*_: object, lanes: int, **__: object) -> AuditReport:
        tried.append(lanes)
        if lanes > fitting:
            raise lack
        return not_run("a test says so")

    monkeypatch.setattr(audit_run, "ask_audit", driven)
    return tried


def test_a_defect_is_not_called_data(batch: OpenBatch, monkeypatch: pytest.MonkeyPatch):
    def fails(*_: object, **__: object) -> AuditReport:
        raise RuntimeError("a defect")

    monkeypatch.setattr(audit_run, "ask_audit", fails)
    with pytest.raises(RuntimeError, match="a defect"):
        write_audit(batch, {}, PLACE)


def test_worlds_that_are_gone_leave_the_others(batch: OpenBatch, audited: Calls, monkeypatch: pytest.MonkeyPatch):
    gone = {"g/w0"}

    def some(_: OpenBatch, requests: Iterable[EpisodeRequest]) -> tuple[dict[str, World], dict[str, str]]:
        asked = {request.world for request in requests}
        return {name: apartment() for name in asked - gone}, dict.fromkeys(asked & gone, "it does not exist")

    monkeypatch.setattr(audit_run, "load_worlds", some)
    assert report(write_audit(batch, {}, PLACE)).verdict == "SOUND"
    assert {each.request.world for each in audited[0]} == {"g/w1"}
    gone.add("g/w1")
    assert report(write_audit(batch, {}, PLACE)).sentence == "not run: it does not exist"


def test_it_reads_the_data_sources_that_the_batch_read(
    file_store: Store, audited: Calls, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
):
    monkeypatch.setenv("SIMYARD_CACHE", str(tmp_path / "cache"))
    open_bucket(file_store, "data").put("map", b"content")
    asked = DataSourceConfig.model_validate({"name": "maps", "s3Bucket": "data", "s3Keys": ["map"]})
    source = pin_source(file_store, tmp_path / "cache" / "data", asked)
    reading = template(environment={"DATA_SOURCE_MAPS": f"{DATA_PREFIX}{source.digest}"})
    made = begun(file_store, plan(file_store, templates=(reading,), data_sources={source.digest: source}))
    for number in range(made.layout.chunks):
        run_chunk(made, number, mixed, lanes=4, left_s=3600.0)
    write_audit(made, {}, PLACE)
    folders = {Path(each.request.environment["DATA_SOURCE_MAPS"]) for each in audited[0]}
    assert {(folder / "map").read_bytes() for folder in folders} == {b"content"}

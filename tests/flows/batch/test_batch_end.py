"""Bags lie beside recordings: of the episodes that are recorded, in the formats that are asked for, none of others."""

import os
import re
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from urllib.parse import urlsplit

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import typer
from pydantic import JsonValue
from typer.testing import CliRunner

from flows.batch.batch_end import (
    RecordedEpisodes,
    bags_url,
    bags_written,
    close_if_stopped,
    close_with_tables,
    local_copy,
    with_audit,
    write_report_page,
)
from flows.cli.batch_commands import report
from flows.pipeline.batch_run import run_batch
from flows.pipeline.stage_report import batch_report
from flows.resources.kinds import cancel_resource, describe_resource, list_resources
from specs.data.episode import EpisodeResult
from specs.errors import BucketNotFound, DocumentError, ResourceNotFound, StageFailed
from specs.field_types import BagFormat, OutputLocation
from specs.pipeline.simulation_section import Recordings
from tasks.results.playback import replay_formats
from tasks.results.report.report_page import stored_worlds
from tasks.simulate.batch.batch_jobs import cancel_batch, cancel_job
from tasks.simulate.batch.batch_record import OpenBatch, complete, time_out
from tasks.simulate.batch.chunk_run import ChunkPart, run_chunk
from tasks.simulate.batch.chunk_store import begin_chunk, committed_chunk
from tasks.simulate.lane.recording import Columns
from tasks.storage.base.keys import claim_key, world_key
from tasks.storage.base.store import Store
from tasks.storage.buckets import open_bucket
from tasks.storage.jobs.records import JobRecord
from tests.factories.lively_claims import hold_lively_claim
from tests.factories.planned_batches import all_pass, begun, mixed, plan, put_world, template
from tests.factories.reports import facts
from tests.factories.simulations import REPOSITORY, ROBOT

WHERE = OutputLocation(s3Bucket="results", s3Prefix="nightly")
FOLDERS = {ROBOT.digest: REPOSITORY / "applications/courier"}


def samples(*indices: int) -> Columns:
    """Returns three samples of each of some episodes, as a recorder gives them."""
    rows = 3 * len(indices)
    still = np.zeros((rows, 3), np.float32)
    return {
        "index": np.repeat(np.array(indices), 3),
        "t_s": np.tile([0.0, 0.1, 0.2], len(indices)),
        "pose": still,
        "velocity": still,
        "goal_index": np.zeros(rows, np.int32),
        "acted": np.tile([True, True, False], len(indices)),
        "control": still,
        "ranges_m": np.ones((rows, 4), np.float32),
        "impulse_ns": np.zeros(rows, np.float32),
        "goal_m": np.ones((rows, 2)),
        "lidar": np.tile([0.1, 0.0, 0.0, 0.2, 6.0, -0.5, 0.25], (rows, 1)),
    }


def recording(store: Store, bags: Iterable[BagFormat] | None, **changes: object) -> OpenBatch:
    asked = Recordings(episodes="all", bags=None if bags is None else tuple(bags))
    return begun(store, plan(store, recordings=asked, **changes))


def written(batch: OpenBatch) -> list[str]:
    return open_bucket(batch.store, "results").keys(f"nightly/bags/{batch.id}")


def test_each_recorded_episode_has_its_files_beside_its_recording(file_store: Store):
    batch = recording(file_store, ["rosbag", "mcap-ros1", "rosbag2"])
    assert RecordedEpisodes(batch, WHERE, FOLDERS).write(0, [samples(0, 1), samples(3)]) == "000000.parquet"
    folder = f"nightly/bags/{batch.id}"
    assert written(batch) == sorted(
        f"{folder}/{name}"
        for index in ("000000", "000001", "000003")
        for name in (
            f"{index}-ros1.mcap",
            f"{index}-rosbag2/{index}-rosbag2_0.mcap",
            f"{index}-rosbag2/metadata.yaml",
            f"{index}.bag",
        )
    )
    assert bags_url(batch, WHERE).endswith(f"results/{folder}")


def test_the_bag_of_who_is_cancelled_while_it_is_written_goes(file_store: Store):
    batch = recording(file_store, ["rosbag"])
    episodes = RecordedEpisodes(batch, WHERE, FOLDERS)
    episodes.write(0, [samples(0, 1)])
    episodes.write(0, [samples(1)])
    assert [Path(key).name for key in written(batch)] == ["000001.bag"]


def test_the_same_samples_are_the_same_bytes_on_any_attempt(file_store: Store):
    batch = recording(file_store, ["rosbag", "rosbag2"])
    bucket = open_bucket(batch.store, "results")
    RecordedEpisodes(batch, WHERE, FOLDERS).write(0, [samples(0)])
    before = {key: bucket.get(key).body for key in written(batch)}
    RecordedEpisodes(batch, WHERE, FOLDERS).write(0, [samples(0)])
    assert {key: bucket.get(key).body for key in written(batch)} == before


def test_a_request_that_records_all_topics_gets_a_rosbag_as_robomaker_wrote_one(file_store: Store):
    old = (template(record=True), template())
    batch = recording(file_store, None, templates=old)
    both = [batch.layout.request(index).index for index in range(batch.layout.episodes)]
    first = [index for index in both if batch.layout.template_of(index) == 0]
    RecordedEpisodes(batch, WHERE, FOLDERS).write(0, [samples(*both[:4], *both[-2:])])
    names = {int(Path(key).stem) for key in written(batch)}
    assert names == {*both[:4], *both[-2:]} & set(first)
    assert names


def test_an_empty_list_means_no_bags_whatever_a_request_says(file_store: Store):
    batch = recording(file_store, [], templates=(template(record=True),))
    RecordedEpisodes(batch, WHERE, FOLDERS).write(0, [samples(0)])
    assert written(batch) == []
    assert not bags_written(batch)


def test_an_old_request_does_not_fail_for_want_of_an_extra(file_store: Store, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(replay_formats, "find_spec", lambda _: None)
    batch = recording(file_store, None, templates=(template(record=True),))
    assert RecordedEpisodes(batch, WHERE, FOLDERS).write(0, [samples(0)]) == "000000.parquet"
    assert written(batch) == []


def test_bags_that_a_document_asks_for_are_refused_without_what_writes_them(
    file_store: Store, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(replay_formats, "find_spec", lambda _: None)
    with pytest.raises(DocumentError, match=r"simulationBatch.recordings.bags: rosbag: .*simyard\[ros\]"):
        RecordedEpisodes(recording(file_store, ["rosbag"]), WHERE, FOLDERS).write(0, [samples(0)])


BATCH = "simulation-job-batch"


@pytest.fixture
def left(file_store: Store) -> OpenBatch:
    """Six jobs in chunks of two: the first chunk is committed, the second was begun, the third was not."""
    batch = begun(file_store, plan(file_store, lanes=2))
    run_chunk(batch, 0, all_pass, lanes=2, left_s=3600.0)
    begin_chunk(file_store, batch.id, 1, 0.0)
    return batch


def results(batch: OpenBatch) -> pa.Table:
    key = str(batch.record().detail["results_url"]).removeprefix(batch.store.url + "/")
    return pq.read_table(pa.BufferReader(batch.store.get(key).body))


def test_cancelling_a_batch_that_nobody_works_on_closes_it_with_the_rows_of_what_was_done(left: OpenBatch):
    cancel_job(left.store, f"{left.id}/3")
    cancel_resource(left.store, left.record().arn)
    assert left.record().status == "Canceled"
    table = results(left)
    assert table.column("status").to_pylist() == ["Completed"] * 2 + ["Canceled"] * 4
    assert table.column("failure_code").to_pylist() == ["", "", "BatchCanceled", "", "BatchCanceled", "BatchCanceled"]


ASK: dict[str, Callable[[Store, str], object]] = {
    "describe": describe_resource,
    "describe job": lambda store, arn: describe_resource(store, f"{arn.replace(BATCH, 'simulation-job')}/0"),
    "list": lambda store, _: list_resources(store, "simulation-job-batches"),
    "list jobs": lambda store, _: list_resources(store, "simulation-jobs"),
}


@pytest.mark.parametrize("ask", list(ASK))
def test_whoever_asks_about_a_batch_that_was_stopped_and_left_finds_it_ended(left: OpenBatch, ask: str):
    time_out(left)
    ASK[ask](left.store, left.record().arn)
    assert left.record().status == "TimedOut"
    assert results(left).num_rows == 6


def test_cancelling_again_closes_a_batch_whose_process_died_before_it_could(left: OpenBatch):
    cancel_batch(left.store, left.id)
    cancel_resource(left.store, left.record().arn)
    assert left.record().status == "Canceled"


def test_a_batch_that_somebody_works_on_is_left_to_him(left: OpenBatch):
    cancel_batch(left.store, left.id)
    with hold_lively_claim(left.store, claim_key(BATCH, left.id)):
        assert close_if_stopped(left.store, left.id).status == "Canceling"
    assert close_if_stopped(left.store, left.id).status == "Canceled"


def test_a_batch_that_nobody_stopped_is_left_to_be_continued(left: OpenBatch):
    assert close_if_stopped(left.store, left.id).status == "InProgress"
    assert describe_resource(left.store, left.record().arn).model_dump()["status"] == "InProgress"


def test_a_process_that_was_paused_meanwhile_cannot_commit_what_was_given_up(left: OpenBatch):
    cancel_batch(left.store, left.id)

    def slow(part: ChunkPart) -> list[EpisodeResult]:
        close_if_stopped(left.store, left.id)
        return all_pass(part)

    assert run_chunk(left, 1, slow, lanes=2, left_s=3600.0).episodes == 2
    assert {row.status for row in committed_chunk(left.store, left.id, 1) or ()} == {"Canceled"}
    assert results(left).column("status").to_pylist()[2:4] == ["Canceled"] * 2


def test_a_batch_that_cannot_be_closed_is_told_as_it_stands_and_keeps_no_other_from_being_told(
    left: OpenBatch, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
):
    other = begun(left.store, name="other")
    cancel_batch(left.store, left.id)

    def gone(*_: object, **__: object) -> None:
        raise BucketNotFound("there is no bucket results")

    with monkeypatch.context() as broken:
        broken.setattr("flows.batch.batch_end.write_batch_tables", gone)
        told = {
            each.model_dump()["arn"]: each.model_dump()["status"] for each in list_resources(left.store, f"{BATCH}es")
        }
        assert told == {left.record().arn: "Canceling", other.record().arn: "InProgress"}
        assert describe_resource(left.store, left.record().arn).model_dump()["status"] == "Canceling"
    assert f"batch {left.id} was stopped and cannot be closed: there is no bucket results" in caplog.text
    assert describe_resource(left.store, left.record().arn).model_dump()["status"] == "Canceled"


def test_a_settled_batch_cannot_be_cancelled_again(left: OpenBatch, tmp_path: Path):
    cancel_resource(left.store, left.record().arn)
    before = left.record()
    with pytest.raises(DocumentError, match="this one is Canceled"):
        cancel_resource(left.store, before.arn)
    assert left.record() == before


@pytest.mark.long
def test_on_s3_it_is_the_same(s3_store: Store):
    batch = begun(s3_store, plan(s3_store, lanes=2))
    run_chunk(batch, 0, all_pass, lanes=2, left_s=3600.0)
    cancel_resource(s3_store, batch.record().arn)
    assert batch.record().status == "Canceled"
    assert results(batch).column("status").to_pylist() == ["Completed"] * 2 + ["Canceled"] * 4


def test_of_many_that_ask_at_once_one_closes_it_and_all_see_the_same_end(left: OpenBatch):
    cancel_batch(left.store, left.id)
    with ThreadPoolExecutor(4) as askers:
        list(askers.map(lambda _: close_if_stopped(left.store, left.id), range(4)))
    end = left.record()
    assert end.status == "Canceled"
    assert close_if_stopped(left.store, left.id) == end


def test_a_process_that_waited_for_a_batch_that_was_closed_meanwhile_does_nothing(left: OpenBatch):
    cancel_resource(left.store, left.record().arn)
    before = left.record()
    assert run_batch(left.store, left.id, OutputLocation(s3Bucket="results")) == before
    assert committed_chunk(left.store, left.id, 2) is None


def test_the_audit_is_one_of_the_files_that_evidence_hashes():
    detail: dict[str, JsonValue] = {"passed": 1, "sha256s": {"results.parquet": "a"}}
    audited: dict[str, JsonValue] = {"audit_url": "file:///x", "sha256s": {"audit.json": "b"}}
    digests = {"results.parquet": "a", "audit.json": "b"}
    assert with_audit(detail, audited) == {"passed": 1, "audit_url": "file:///x", "sha256s": digests}
    assert with_audit(detail, {}) == detail


@pytest.mark.parametrize("exc", [ZeroDivisionError("no such page"), StageFailed("MismatchedEtag", "no such page")])
def test_a_report_that_cannot_be_written_keeps_no_batch_from_its_end(
    left: OpenBatch, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture, exc: Exception
):
    def fails(*_: object) -> None:
        raise exc

    monkeypatch.setattr("flows.batch.batch_end.report_page", fails)
    cancel_resource(left.store, left.record().arn)
    record = left.record()
    assert record.status == "Canceled"
    assert "report_url" not in record.detail
    assert str(record.detail["report_failed"]).endswith("no such page")
    assert "no report was written" in caplog.text
    assert results(left).num_rows == 6
    stage = batch_report(record, 1.0)
    assert stage.facts["alarm"] == f"There is no report: {record.detail['report_failed']}"


def closed(store: Store) -> JobRecord:
    """Returns a batch of six jobs, some of them failed, with its tables and its report."""
    batch = begun(store)
    for number in range(batch.layout.chunks):
        run_chunk(batch, number, mixed, lanes=4, left_s=3600.0)
    complete(batch)
    return close_with_tables(OpenBatch(store, batch.id, batch.layout))


def page(url: str) -> bytes:
    return Path(urlsplit(url).path).read_bytes()


def test_a_batch_has_its_report_beside_its_tables_when_it_is_closed(file_store: Store):
    record = closed(file_store)
    url = str(record.detail["report_url"])
    assert url == str(record.detail["results_url"]).replace("results.parquet", "report.html")
    assert b"Not judged" in page(url)


def test_it_is_made_again_to_the_byte_by_every_name_of_the_batch(file_store: Store):
    record = closed(file_store)
    url = str(record.detail["report_url"])
    before = page(url)
    job = f"{record.arn.replace('simulation-job-batch', 'simulation-job')}/3"
    for name in (record.id, record.arn, job):
        Path(urlsplit(url).path).unlink()
        assert write_report_page(file_store, name, None).url == url
        assert page(url) == before


def test_beside_the_tables_links_are_relative_and_elsewhere_they_are_not(file_store: Store, tmp_path: Path):
    record = closed(file_store)
    elsewhere = write_report_page(file_store, record.id, tmp_path / "new" / "folder" / "batch.html")
    assert (tmp_path / "new" / "folder" / "batch.html").read_bytes() == elsewhere.page
    assert b'href="results.parquet"' in page(str(record.detail["report_url"]))
    assert f'href="{record.detail["results_url"]}"'.encode() in elsewhere.page


def test_every_relative_link_leads_to_a_file(file_store: Store):
    url = str(closed(file_store).detail["report_url"])
    links = re.findall(rb'<dt><a href="([^"]+parquet)"', page(url))
    assert [(Path(urlsplit(url).path).parent / link.decode()).is_file() for link in links] == [True, True]


def test_on_s3_the_page_lies_there_and_a_browser_gets_a_copy(s3_store: Store):
    record = closed(s3_store)
    place = write_report_page(s3_store, record.arn, None)
    key = place.url.removeprefix(s3_store.url + "/")
    assert s3_store.get(key).body == place.page
    assert local_copy(place).read_bytes() == place.page


def test_a_page_in_a_folder_is_opened_where_it_is(file_store: Store):
    place = write_report_page(file_store, closed(file_store).id, None)
    assert local_copy(place).as_uri() == place.url


def test_a_batch_that_has_not_ended_is_refused(file_store: Store):
    with pytest.raises(DocumentError, match="this one is InProgress: its tables come when it ends"):
        write_report_page(file_store, begun(file_store).id, None)


@pytest.mark.parametrize(
    "name", ["simb-0123456789abcdef", "arn:simyard:pipeline-run:0123456789ab:run-0123456789abcdef"]
)
def test_what_does_not_exist_is_said_not_to(file_store: Store, name: str):
    with pytest.raises(ResourceNotFound):
        write_report_page(file_store, name, None)


@pytest.mark.parametrize("name", ["arn:simyard:world:0123456789ab:g/w0", "arn:simyard:nothing:0123456789ab:x"])
def test_what_is_no_batch_is_refused(file_store: Store, name: str):
    with pytest.raises(DocumentError, match="arn"):
        write_report_page(file_store, name, None)


def test_a_world_that_changed_since_the_batch_is_not_drawn(file_store: Store, caplog: pytest.LogCaptureFixture):
    digests = {name: put_world(file_store, name) for name in ("g/w0", "g/w1", "g/w2")}
    file_store.put(world_key("g", "w1"), file_store.get(world_key("g", "w1")).body + b" ")
    file_store.delete(world_key("g", "w2"))
    assert list(stored_worlds(file_store, facts(worlds=digests)).rooms) == ["g/w0"]
    assert "world g/w1 is left out of the report: it is not the one that the batch ran in" in caplog.text
    assert "world g/w2 is left out of the report" in caplog.text


@pytest.mark.parametrize("browser", [True, False])
def test_the_command_prints_where_the_page_is_and_opens_it_or_says_that_nothing_here_does(
    file_store: Store,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
    *,
    browser: bool,
):
    opener = tmp_path / "xdg-open"
    opener.write_text(f"#!/bin/sh\necho $1 > {tmp_path}/opened\necho no method >&2\nexit {0 if browser else 3}\n")
    opener.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")
    app = typer.Typer()
    app.command()(report)
    record = closed(file_store)
    done = CliRunner().invoke(app, [record.arn, "--open", "--store", file_store.url])
    url = str(record.detail["report_url"])
    assert (done.exit_code, done.stdout.strip(), (tmp_path / "opened").read_text().strip()) == (0, url, url)
    path = url.removeprefix("file://")
    said = "" if browser else f"no browser opens on this machine: open {path} in one elsewhere"
    assert (done.stderr.strip(), capfd.readouterr().err) == (said, "")


@pytest.mark.parametrize("name", ["results", "failures"])
def test_tables_that_are_not_what_the_batch_wrote_are_not_reported_on(file_store: Store, name: str):
    record = closed(file_store)
    path = Path(urlsplit(str(record.detail[f"{name}_url"])).path)
    path.write_bytes(path.read_bytes()[:-9])
    with pytest.raises(StageFailed, match=rf"MismatchedEtag: .*{name}\.parquet is not what the batch wrote"):
        write_report_page(file_store, record.id, None)

"""`simyard report`: the same page as the batch left, from any name of the batch, wherever it is to lie."""

import re
from pathlib import Path
from urllib.parse import urlsplit

import pytest
import typer
from typer.testing import CliRunner

from flows.batch.batch_end import close_with_tables, local_copy, write_report_page
from flows.cli.batch_commands import report
from specs.errors import DocumentError, ResourceNotFound, StageFailed
from tasks.results.report.report_page import stored_worlds
from tasks.simulate.batch.batch_record import OpenBatch, complete
from tasks.simulate.batch.chunk_run import run_chunk
from tasks.storage.base.keys import world_key
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import JobRecord
from tests.factories.planned_batches import begun, mixed, put_world
from tests.factories.reports import facts


def closed(store: Store) -> JobRecord:
    """Returns a batch of six jobs, some of them failed, with its tables and its report."""
    batch = begun(store)
    for number in range(batch.layout.chunks):
        run_chunk(batch, number, mixed, lanes=4, left_s=9.0)
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


def test_the_command_prints_where_the_page_is_and_opens_it(file_store: Store, monkeypatch: pytest.MonkeyPatch):
    opened: list[str] = []
    monkeypatch.setattr(typer, "launch", opened.append)
    app = typer.Typer()
    app.command()(report)
    record = closed(file_store)
    done = CliRunner().invoke(app, [record.arn, "--open", "--store", file_store.url])
    assert done.output.strip() == record.detail["report_url"]
    assert opened == [record.detail["report_url"]]


@pytest.mark.parametrize("name", ["results", "failures"])
def test_tables_that_are_not_what_the_batch_wrote_are_not_reported_on(file_store: Store, name: str):
    record = closed(file_store)
    path = Path(urlsplit(str(record.detail[f"{name}_url"])).path)
    path.write_bytes(path.read_bytes()[:-9])
    with pytest.raises(StageFailed, match=rf"MismatchedEtag: .*{name}\.parquet is not what the batch wrote"):
        write_report_page(file_store, record.id, None)

"""Events of jobs on a real Prefect server, and the example automations, whose messages come to a listener on this
machine: with a block for Slack or mail they would go there, and nothing else is different.
"""

import json
import os
import subprocess
import sys
import time
from collections.abc import Generator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread
from typing import Any

import httpx
import pytest
import yaml

from flows.prefect.flow_runs import AWAITING
from tasks.server.health import authorization
from tasks.simulate.batch.metrics import metric_rows, recorded_metrics
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import read, records, submit
from tasks.storage.jobs.runs import jobs_of
from tasks.storage.store_url import open_store
from tests.flows.batch.stored_nights import stored_night
from tests.integration.runs import ROOT
from tests.servers.eventually import eventually

pytestmark = pytest.mark.integration

EXAMPLE = ROOT / "examples/automations/what-went-wrong.yaml"
FALLS = ROOT / "examples/automations/rate-fell.yaml"
HEARTBEATS = ROOT / "examples/automations/lost-heartbeats.yaml"
# A flow as a worker runs it: the same job is told of again after its end, as by a process that was thought dead.
FLOW = """
import sys
from prefect import flow
from flows.prefect.prefect_events import announce_changes, _announce
from tasks.storage.store_url import open_store
from tasks.storage.jobs.records import advance
from tasks.storage.jobs.records import JobTransition

@flow
def failing(store: str, batch: str) -> None:
    with announce_changes():
        at = open_store(store)
        advance(at, "simulation-job-batch", batch, "InProgress")
        code = "InternalServiceError"
        record = advance(at, "simulation-job-batch", batch, "Failed", failure_code=code, failure_reason="why")
        _announce(JobTransition(record.kind, record.arn, "InProgress", "Failed", code, "again"))

failing(*sys.argv[1:])
"""
# The end of a run's batch, as a stage has it.
TREND = """
import sys
from prefect import flow
from flows.prefect.prefect_events import announce_alarm
from flows.batch.trend_history import write_trend_of_run
from tasks.storage.jobs.records import read
from tasks.storage.store_url import open_store

@flow
def trend(store: str, run: str, batch: str) -> None:
    at = open_store(store)
    written = write_trend_of_run(at, read(at, "pipeline-run", run), read(at, "simulation-job-batch", batch))
    for alarm in written.alarms:
        announce_alarm(alarm, written.url)

trend(*sys.argv[1:])
"""
BLOCK = """
import sys
from prefect.blocks.notifications import CustomWebhookNotificationBlock

message = {"subject": "{{subject}}", "body": "{{body}}"}
print(CustomWebhookNotificationBlock(name="here", url=sys.argv[1], json_data=message).save("simyard", overwrite=True))
"""


@pytest.fixture
def messages() -> Generator[tuple[str, list[dict[str, str]]], None, None]:
    """Yields the URL of a listener on this machine, and what was posted to it."""
    found: list[dict[str, str]] = []

    class Listener(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            found.append(json.loads(self.rfile.read(int(self.headers["Content-Length"]))))
            self.send_response(200)
            self.end_headers()

        def log_message(self, format: str, *args: object) -> None:  # noqa: A002 - the name that http.server has
            """Says nothing."""

    with ThreadingHTTPServer(("127.0.0.1", 0), Listener) as server:
        Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}/", found
        server.shutdown()


@pytest.mark.long
def test_the_example_tells_of_a_batch_that_failed_and_once(
    prefect_server: str, tmp_path: Path, messages: tuple[str, list[dict[str, str]]]
) -> None:
    url, found = messages
    file = tmp_path / "automations.yaml"
    file.write_text(EXAMPLE.read_text().replace("BLOCK", python(BLOCK, url).split()[-1]))
    run(str(Path(sys.executable).with_name("prefect")), "automation", "create", "--from-file", str(file))
    store = open_store((tmp_path / "store").as_uri())
    batch = submit(store, "simulation-job-batch", {}, "one")

    python(FLOW, store.url, batch.id)

    eventually(lambda: found)
    failed = read(store, batch.kind, batch.id)
    eventually(lambda: len(events_about(prefect_server, store)) >= 2)
    told = events_about(prefect_server, store)
    assert sorted(each["event"] for each in told) == [
        "simyard.simulation-batch.Failed",
        "simyard.simulation-batch.InProgress",
    ]
    assert {each["resource"]["prefect.resource.id"] for each in told} == {failed.arn}
    assert all("flow-run" in [each["prefect.resource.role"] for each in event["related"]] for event in told)
    assert found == [
        {"subject": "simyard.simulation-batch.Failed", "body": f"InternalServiceError why\nJob: {failed.arn}"},
    ]


@pytest.mark.soak
@pytest.mark.usefixtures("prefect_server")
def test_the_example_tells_of_a_rate_that_fell_and_once(
    file_store: Store, tmp_path: Path, messages: tuple[str, list[dict[str, str]]]
) -> None:
    url, found = messages
    file = tmp_path / "automations.yaml"
    file.write_text(FALLS.read_text().replace("BLOCK", python(BLOCK, url).split()[-1]))
    run(str(Path(sys.executable).with_name("prefect")), "automation", "create", "--from-file", str(file))
    *_, (last, batch) = [
        stored_night(file_store, tmp_path, number, failures) for number, failures in enumerate((0, 0, 40))
    ]

    python(TREND, file_store.url, last.id, batch.id)
    python(TREND, file_store.url, last.id, batch.id)  # as a run that goes on after its process was killed

    eventually(lambda: found)
    time.sleep(5.0)  # for a second message, if one came
    assert [each["subject"] for each in found] == ["simyard.trend.Fell"]
    folder = str(batch.detail["results_url"]).rsplit("/", 2)[0]
    lines = found[0]["body"].splitlines()
    assert lines[0].startswith("All episodes: the rate fell from 100.0 to 50.0 %.")
    assert lines[1:] == [f"Began with: {batch.arn}", f"Page: {folder}/trends/nightly.html"]


@pytest.mark.usefixtures("prefect_server")
def test_prefect_takes_the_automation_for_lost_heartbeats_which_spares_who_waits() -> None:
    expected = yaml.safe_load(HEARTBEATS.read_text())["automations"][0]["trigger"]["expect"]
    assert f"prefect.flow-run.{AWAITING}" in expected
    prefect = str(Path(sys.executable).with_name("prefect"))
    made = run(prefect, "automation", "create", "--from-file", str(HEARTBEATS)).split()[-1]
    # At once: this server's flow runs send a heartbeat in 180 s only, and the other tests need them.
    run(prefect, "--no-prompt", "automation", "delete", "--id", made)


def test_a_run_tells_each_change_of_its_jobs_and_its_verdict_once(prefect_server: str, small_run: Path) -> None:
    store = open_store((small_run / ".simyard").as_uri())
    # Other tests may have run more documents on the same store.
    first = min(records(store, "pipeline-run"), key=lambda run: run.created_at_s)
    ours = {first.arn, *(read(store, kind, job).arn for kind, job in jobs_of(first))}

    def told_of_it() -> list[str]:
        found = events_about(prefect_server, store)
        return sorted(each["event"] for each in found if each["resource"]["prefect.resource.id"] in ours)

    eventually(lambda: len(told_of_it()) >= 13)  # the server takes its time
    told = told_of_it()
    assert told == [
        "simyard.deployment.InProgress",
        "simyard.deployment.Preparing",
        "simyard.deployment.Succeeded",
        "simyard.gate.PASS",
        "simyard.pipeline.Completed",
        "simyard.pipeline.Running",
        "simyard.simulation-batch.Completed",
        "simyard.simulation-batch.Completing",
        "simyard.simulation-batch.InProgress",
        "simyard.world-export.Completed",
        "simyard.world-export.Running",
        "simyard.world-generation.Completed",
        "simyard.world-generation.Running",
    ]


def test_a_batch_leaves_its_figures_in_its_record_and_on_its_page(prefect_server: str, small_run: Path) -> None:
    (batch,) = records(open_store((small_run / ".simyard").as_uri()), "simulation-job-batch")
    figures = recorded_metrics(batch)
    assert figures is not None
    assert (figures.workers, figures.chunks, figures.simulated_s > 0.0, figures.drive_s > 0.0) == (1, 2, True, True)
    asked = {"artifacts": {"key": {"any_": ["apartment-regression--batch-metrics"]}}, "sort": "CREATED_DESC"}
    shown = httpx.post(f"{prefect_server}/artifacts/filter", json=asked, headers=said_password()).json()
    # The first batch of another store has the same id, and another test may have told this server of one.
    found = [json.loads(each["data"]) for each in shown if batch.id in each["description"]]
    assert found.count(metric_rows(figures)) == 1


def said_password() -> dict[str, str]:
    """Returns the header by which the tests' server is asked."""
    return authorization(os.environ["PREFECT_API_AUTH_STRING"])


def events_about(api_url: str, store: Store) -> list[dict[str, Any]]:
    """Returns the server's events about the jobs of a store."""
    ours = {job.arn for kind in ("simulation-job-batch", "pipeline-run") for job in records(store, kind)}
    place = next(iter(ours)).split(":")[3]
    asked = {"filter": {"event": {"prefix": ["simyard."]}, "order": "ASC"}, "limit": 50}
    page = httpx.post(f"{api_url}/events/filter", json=asked, headers=said_password()).json()
    found: list[dict[str, Any]] = page["events"]
    while page["next_page"]:
        page = httpx.get(page["next_page"], headers=said_password()).json()
        found += page["events"]
    return [each for each in found if each["resource"]["prefect.resource.id"].split(":")[3] == place]


def python(code: str, *arguments: str) -> str:
    return run(sys.executable, "-c", code, *arguments)


def run(*command: str) -> str:
    ended = subprocess.run(command, cwd=ROOT, env=os.environ, capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stdout + ended.stderr
    return ended.stdout

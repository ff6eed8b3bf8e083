"""A run from wherever Python calls it: a script, a running event loop, a thread, a flow of somebody else's."""

import asyncio
import json
import logging
import os
import subprocess
import sys
from collections.abc import Generator
from pathlib import Path
from threading import Thread
from typing import Any

import pytest
from prefect import flow
from prefect.settings import PREFECT_API_AUTH_STRING, PREFECT_API_URL, temporary_settings

import simyard
from flows.pipeline import world_imports
from flows.pipeline.world_imports import ImportedWorld, import_world
from simyard import run_call as server_module
from simyard.answer.run_answers import Run
from specs.errors import DocumentError, StageFailed
from specs.pipeline.world_sections import WorldImport
from tasks.storage.jobs.records import read
from tasks.storage.store_url import open_store
from tests.factories.gateway.answering_server import NOBODY
from tests.factories.ros_maps import write_map
from tests.repository import ROOT

DOCUMENT = ROOT / "examples/worlds-only.yaml"
TWICE = """
import json, os, warnings
warnings.simplefilter("error")
import simyard
for store in ("one", "two"):
    run = simyard.run({document!r}, store=store)
    print(json.dumps([run.passed, "PREFECT_API_URL" in os.environ]))
"""


@pytest.fixture
def here(tmp_path: Path, prefect_server: str) -> Generator[Path, None, None]:
    """A folder for a store, with a server that answers."""
    assert prefect_server
    yield tmp_path / "store"
    assert server_module.holders == []


def ran(store: Path) -> Run:
    run = simyard.run(DOCUMENT, store=store)
    assert run.passed
    assert read(open_store(run.store), "pipeline-run", run.id).detail["flow_run"]
    return run


@pytest.mark.integration
@pytest.mark.long
def test_a_script_gets_a_run_and_its_console_stays_quiet(here: Path, capfd: pytest.CaptureFixture[str]):
    ran(here)
    assert capfd.readouterr() == ("", "")


@pytest.mark.integration
@pytest.mark.long
def test_a_building_is_read_once(here: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    write_map(tmp_path, ("#" * 40, *("#" + "." * 38 + "#",) * 40, "#" * 40))
    read_files: list[Path] = []

    def noted(asked: WorldImport, base: Path, path: str = "") -> ImportedWorld:
        read_files.append(base / asked.source)
        return import_world(asked, base, path)

    monkeypatch.setattr(world_imports, "import_world", noted)
    source = tmp_path / "map.yaml"
    document = {"name": "own", "worlds": [{"name": "hall", "source": str(source), "start": [2.0, 3.0, 0.0]}]}
    assert simyard.run(document, store=here).passed
    assert read_files == [source]


@pytest.mark.integration
@pytest.mark.long
def test_a_running_loop_is_held_up_and_goes_on(here: Path):
    async def notebook() -> tuple[Run, Run]:
        return ran(here), await asyncio.to_thread(ran, here)

    first, second = asyncio.run(notebook())
    assert first.id != second.id


@pytest.mark.integration
@pytest.mark.long
def test_threads_share_the_server_and_the_run(here: Path):
    found: list[Run] = []
    threads = [Thread(target=lambda: found.append(ran(here))) for _ in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(found) == 2


@pytest.mark.integration
@pytest.mark.long
def test_a_flow_of_ones_own_has_it_as_a_sub_flow_and_keeps_its_log(here: Path, caplog: pytest.LogCaptureFixture):
    @flow
    def own() -> str:
        return ran(here).id

    settings: dict[Any, str] = {PREFECT_API_URL: os.environ["PREFECT_API_URL"]}
    settings[PREFECT_API_AUTH_STRING] = os.environ["PREFECT_API_AUTH_STRING"]
    with temporary_settings(settings), caplog.at_level(logging.INFO):
        assert own().startswith("run-")
    assert any("subflow run 'two-worlds'" in each.getMessage() for each in caplog.records)


def test_a_document_with_faults_is_refused_before_there_is_a_server(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(server_module.Holder, "start", pytest.fail)
    document: dict[str, Any] = {
        "name": "n",
        "worldExport": {"worlds": ["g/w"], "outputLocation": {"s3Bucket": "bucket"}},
    }
    with pytest.raises(DocumentError, match="g/w"):
        simyard.run(document, store=tmp_path)


def test_a_server_that_does_not_answer_is_told_and_is_not_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("PREFECT_API_URL", NOBODY)
    monkeypatch.setattr("flows.prefect.prefect_server.succeeds_within", lambda question: question())
    with pytest.raises(StageFailed, match="no Prefect server answers"):
        simyard.run(DOCUMENT, store=tmp_path)
    assert server_module.holders == []


@pytest.mark.integration
@pytest.mark.soak
def test_a_process_without_a_server_starts_one_for_each_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    for name in ("PREFECT_API_URL", "PREFECT_API_AUTH_STRING"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("PREFECT_HOME", str(tmp_path / "home"))
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    script = TWICE.format(document=str(DOCUMENT))
    done = subprocess.run([sys.executable, "-c", script], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert [json.loads(line) for line in done.stdout.splitlines()] == [[True, False]] * 2, done.stderr
    assert done.stderr == ""

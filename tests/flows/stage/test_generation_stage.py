"""A section of more worlds than one job makes: several jobs, one list of worlds, the same worlds."""

import hashlib
from pathlib import Path
from typing import Any, cast

import pytest
from pydantic import JsonValue

from flows.pipeline.pipeline import world_generation
from flows.pipeline.recount import section_world_changes
from flows.pipeline.stage_report import generation_report
from specs.pipeline.world_sections import WorldGeneration
from specs.settings import MAX_WORLDS
from tasks.storage.base.keys import job_key, world_key
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import read, submit
from tasks.storage.jobs.runs import jobs_of, stage_token, worlds_of_job
from tasks.storage.store_url import open_store
from tests.integration.runs import finished, small_document, tables, write_document
from tests.repository import ROOT

SECTION = WorldGeneration.model_validate(
    {"template": "two-rooms.json", "worldCount": {"floorplanCount": 3}, "seed": 7, "worldTags": {"site": "test"}}
)
BASE = str(ROOT / "examples/templates")


def made(store: Store, monkeypatch: pytest.MonkeyPatch, most: int, token: str) -> list[tuple[str, bytes]]:
    monkeypatch.setenv(MAX_WORLDS.variable, str(most))
    record = world_generation(SECTION, store.url, BASE, token)
    worlds = [*cast("list[str]", record.detail["worlds"])]
    return [(world, store.get(world_key(*world.split("/"))).body) for world in worlds]


def test_a_world_is_the_same_whichever_job_makes_it(file_store: Store, monkeypatch: pytest.MonkeyPatch):
    several, one = made(file_store, monkeypatch, 2, "a"), made(file_store, monkeypatch, 3, "b")
    assert [world.split("/")[1] for world, _ in several] == ["world-1-1", "world-2-1", "world-3-1"]
    assert len({world.split("/")[0] for world, _ in several}) == 2
    bare = [[body.replace(world.split("/")[0].encode(), b"") for world, body in found] for found in (several, one)]
    assert bare[0] == bare[1]


def test_a_section_that_was_cut_between_two_jobs_goes_on_with_the_second(
    file_store: Store, monkeypatch: pytest.MonkeyPatch
):
    whole = made(file_store, monkeypatch, 2, "c")
    second = whole[-1][0].split("/")[0]
    for key in (job_key("world-generation-job", second), world_key(*whole[-1][0].split("/"))):
        file_store.delete(key)
    assert made(file_store, monkeypatch, 2, "c") == whole


def test_a_run_knows_all_its_generation_jobs_so_that_they_can_be_cancelled_and_kept(
    file_store: Store, monkeypatch: pytest.MonkeyPatch
):
    spec: dict[str, JsonValue] = {"worldGeneration": SECTION.model_dump(mode="json", exclude_none=True)}
    run = submit(file_store, "pipeline-run", {"flow": "pipeline", "spec": spec}, "run")
    found = made(file_store, monkeypatch, 2, stage_token(run, "worlds"))
    run = read(file_store, "pipeline-run", run.id)
    assert [job for _, job in jobs_of(run)] == list(dict.fromkeys(world.split("/")[0] for world, _ in found))


@pytest.mark.parametrize(("begun", "here"), [(2, 50), (3, 1)])
def test_a_run_goes_on_with_the_jobs_that_another_machine_began(
    file_store: Store, monkeypatch: pytest.MonkeyPatch, begun: int, here: int
):
    run = submit(file_store, "pipeline-run", {"flow": "pipeline"}, "run")
    monkeypatch.setenv(MAX_WORLDS.variable, str(begun))
    token = stage_token(run, "worlds")
    assert worlds_of_job(file_store, token) == begun
    found = made(file_store, monkeypatch, here, token)
    assert len({world.split("/")[0] for world, _ in found}) == -(-3 // begun)


def test_the_stage_is_reported_once_with_all_its_worlds(file_store: Store, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv(MAX_WORLDS.variable, "2")
    record = world_generation(SECTION, file_store.url, BASE, "d")
    report = generation_report(record, file_store, 1.0)
    assert (report.status, report.summary.split(";")[0]) == ("Completed", "3 worlds")
    assert [artefact.label for artefact in report.artefacts] == ["worlds"] * 2 + ["contact sheet"] * 2


def test_worlds_that_several_jobs_made_are_recounted_job_by_job(file_store: Store, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv(MAX_WORLDS.variable, "2")
    run = submit(file_store, "pipeline-run", {}, "run")
    found = made(file_store, monkeypatch, 2, stage_token(run, "worlds"))
    digests = {world: hashlib.sha256(body).hexdigest() for world, body in found}
    named = [world for world, _ in found]
    assert section_world_changes(SECTION, named, digests, store=file_store, base=BASE, run=run) == []
    (line,) = section_world_changes(
        SECTION, named, digests | {named[2]: "0" * 64}, store=file_store, base=BASE, run=run
    )
    assert line.startswith(f"world {named[2]} has the SHA-256 000")
    (line,) = section_world_changes(SECTION, [*named, "wgj-1/world-1-1"], digests, store=file_store, base=BASE, run=run)
    assert line.startswith("the run names worlds of generations that it did not ask for")


@pytest.mark.long
def test_a_run_drives_one_batch_through_the_worlds_of_two_jobs(tmp_path: Path):
    whole = cast("dict[str, Any]", small_document())
    document = {key: value for key, value in whole.items() if key not in {"worldExport", "deployment", "gate"}}
    document["worldGeneration"]["worldCount"] = {"floorplanCount": 3}
    document["simulationBatch"]["matrix"]["seeds"] = 1
    batch = document["simulationBatch"]
    batch["matrix"]["environmentVariables"] = {"MAX_SPEED": ["0.6"]}
    batch["batchPolicy"]["maxConcurrency"] = 4
    batch["recordings"], batch["audit"] = {"episodes": "none"}, {"lanes": 0}
    batch["createSimulationJobRequests"][0]["maxJobDurationInSeconds"] = 5
    file, url = write_document(tmp_path, document), (tmp_path / "store").as_uri()
    ended = finished("run", str(file), "--direct", "--store", url, SIMYARD_MAX_WORLDS="2")
    assert ended.returncode == 0, ended.stdout + ended.stderr
    rows = tables(open_store(url))["results"]
    assert rows.num_rows == len(set(rows.column("world").to_pylist())) == 3

"""The agents of a demonstration begin when the batch's last episode has ended, and not before."""

import hashlib
from collections.abc import Callable, Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, cast

import pytest
from pydantic import JsonValue

from flows.batch.batch_steps import AUDIT, EPISODES
from flows.pipeline import batch_run, pipeline
from flows.pipeline.batch_run import robots_in_reserve
from flows.pipeline.orchestrator import Reports
from flows.pipeline.pipeline import _judge_and_deploy, simulation_batch, world_export, world_generation
from flows.pipeline.recount import section_world_changes
from flows.pipeline.references import ParsedRun
from flows.pipeline.stage_report import generation_report
from specs.data.run_report import StageReport
from specs.errors import DocumentError, StageFailed
from specs.pipeline.document import PipelineSpec
from specs.pipeline.world_sections import WorldExport, WorldGeneration
from specs.settings import MAX_WORLDS
from tasks.documents.pipeline_file import read_pipeline
from tasks.progress.listener import listen_to_progress, report_progress
from tasks.storage.base.keys import job_key, world_key
from tasks.storage.base.store import Store, encode_document
from tasks.storage.jobs.records import read, records, submit
from tasks.storage.jobs.runs import jobs_of, stage_token, worlds_of_job
from tasks.storage.store_url import open_store
from tests.factories.planned_batches import begun as begun_batch
from tests.factories.planned_batches import plan
from tests.integration.runs import finished, small_document, tables, write_document
from tests.repository import ROOT


@pytest.fixture
def begun(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The fleets whose agents were begun."""
    found: list[str] = []

    @contextmanager
    def reserve(_store: Store, section: object) -> Generator[Callable[[], None], None, None]:
        yield lambda: found.append(section.fleet.name)  # type: ignore[attr-defined]

    monkeypatch.setattr(batch_run, "robot_reserve", reserve)
    return found


@pytest.fixture
def spec() -> PipelineSpec:
    """The quickstart."""
    return read_pipeline(ROOT / "examples/quickstart.yaml")


def test_they_begin_when_the_last_episode_has_ended(begun: list[str], spec: PipelineSpec, file_store: Store):
    with robots_in_reserve(spec, file_store):
        report_progress(EPISODES, 383, 384)
        report_progress(AUDIT, 64, 64)
        assert begun == []
        report_progress(EPISODES, 384, 384)

    assert begun == ["couriers"]


def test_whoever_listens_to_progress_hears_of_it(begun: list[str], spec: PipelineSpec, file_store: Store):
    heard: list[tuple[str, int, int]] = []
    with listen_to_progress(lambda *told: heard.append(told)), robots_in_reserve(spec, file_store):
        report_progress(EPISODES, 1, 2)

    assert heard == [(EPISODES, 1, 2)]
    assert begun == []


def test_a_run_whose_batch_has_ended_before_begins_them_itself(begun: list[str], spec: PipelineSpec, file_store: Store):
    with robots_in_reserve(spec, file_store) as begin:
        begin()

    assert begun == ["couriers"]


def test_a_document_without_a_deployment_begins_none(begun: list[str], spec: PipelineSpec, file_store: Store):
    with robots_in_reserve(spec.model_copy(update={"deployment": None}), file_store) as begin:
        report_progress(EPISODES, 1, 1)
        begin()

    assert begun == []


SIMULATED = StageReport(name="simulationBatch", arn="", status="Completed", summary="", seconds=0.0)
JUDGED = StageReport(name="gate", arn="", status="PASS", summary="", seconds=0.0)
DEPLOYED = StageReport(name="deployment", arn="", status="Succeeded", summary="", seconds=0.0)
Fails = Callable[[str, Exception], None]


@pytest.fixture
def fails(monkeypatch: pytest.MonkeyPatch) -> Fails:
    """Makes a step fail; without that all steps come to their ends."""

    def let_fail(name: str, failure: Exception) -> None:
        def fail(*_: object) -> None:
            raise failure

        monkeypatch.setattr(pipeline, name, fail)

    answers = {
        "authenticated_batch": lambda _work, batch: batch,
        "judge": lambda *_: (JUDGED,),
        "require_not_canceled": lambda *_: None,
        "deploy": lambda *_: (DEPLOYED,),
        "show_trend": lambda stages, *_: stages,
        "show_verdict": lambda stages, *_: stages,
    }
    for name, answer in answers.items():
        monkeypatch.setattr(pipeline, name, answer)
    return let_fail


def came_of(store: Store) -> tuple[Reports, Reports, Reports]:
    spec, record = read_pipeline(ROOT / "examples/quickstart.yaml"), begun_batch(store).record()
    return _judge_and_deploy(ParsedRun(spec, ".", store, record), record, (SIMULATED,))


def test_a_batch_whose_plan_was_edited_is_not_driven_on(file_store: Store, monkeypatch: pytest.MonkeyPatch):
    def end(*_: object) -> None:
        raise StageFailed("InternalServiceError", "killed")

    monkeypatch.setattr(pipeline, "run_batch", end)
    monkeypatch.setattr(pipeline, "batch_plan", lambda *_: plan(file_store))
    section = read_pipeline(ROOT / "examples/quickstart.yaml").simulationBatch
    assert section
    with monkeypatch.context() as first:
        first.setattr(pipeline, "require_plan", end)  # or this process would remember the plan
        with pytest.raises(StageFailed, match="killed"):
            simulation_batch(section, None, file_store.url, None, "run-batch")
    (batch,) = records(file_store, "simulation-job-batch")
    edited = batch.model_copy(deep=True)
    cast("Any", edited.request)["plan"]["templates"][0]["duration_s"] = 600.0
    file_store.put(job_key(batch.kind, batch.id), encode_document(edited))
    with pytest.raises(StageFailed, match=r"says the plan \w+; the document's plan is"):
        simulation_batch(section, None, file_store.url, None, "run-batch")


@pytest.mark.parametrize(("shows", "stage"), [("show_verdict", 1), ("show_trend", 0)])
def test_a_page_that_prefect_does_not_take_is_an_alarm_and_the_deployment_is_told_as_it_ended(
    file_store: Store, fails: Fails, shows: str, stage: int
):
    fails(shows, RuntimeError("the server\nsays 500"))
    found = came_of(file_store)
    assert found[2] == (DEPLOYED,)
    alarm = "What came of it could not be shown: RuntimeError: the server says 500"
    assert [[each.facts.get("alarm") for each in part] for part in found[:2]] == [
        [alarm if place == stage else None] for place in range(2)
    ]


def test_a_deployment_that_fails_is_told_though_the_verdict_could_not_be_shown(file_store: Store, fails: Fails):
    fails("show_verdict", RuntimeError("the server says 500"))
    fails("deploy", StageFailed("DeploymentFailed", "a robot was lost"))
    with pytest.raises(StageFailed, match="a robot was lost"):
        came_of(file_store)


@pytest.mark.parametrize("worlds", [None, []])
def test_all_worlds_of_a_run_that_has_none_are_a_fault_and_no_record(file_store: Store, worlds: list[str] | None):
    section = WorldExport.model_validate({"outputLocation": {"s3Bucket": "worlds"}, "formats": ["mjcf"]})
    with pytest.raises(DocumentError, match=r"worlds: none: <generation>/<world>"):
        world_export(section, worlds, file_store.url)
    assert [*records(file_store, "pipeline-run")] == []


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
    monkeypatch.setenv(MAX_WORLDS.variable, "50")  # of the machine that asks
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
    monkeypatch.setenv(MAX_WORLDS.variable, "50")  # of the machine that counts
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

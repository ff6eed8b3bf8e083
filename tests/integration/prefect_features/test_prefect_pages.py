"""Prefect's pages of a run, in Chromium: its stages, its progress while it goes on, its tables, the form for the next.

Where SIMYARD_PICTURES names a folder, the pictures of docs/operate/operations.md are taken anew into it.
"""

import json
import os
import re
import subprocess
from collections.abc import Generator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
import yaml

from tests.integration.runs import finished, simyard, small_document, write_document
from tests.integration.stopped.operated import asked, commands, prefect, until
from tests.repository import ROOT
from tests.servers.chromium import Page, browsing
from tests.servers.prefect_pages import complaints, painted, pictured, say_password, shown, turned_to

pytestmark = pytest.mark.integration
NAME = "nightly-in-pages"
TABLES = {
    "pipeline-report": ("worldGeneration", "simulationBatch", "PASS", "2 of 2 robots run courier 1"),
    "batch-results": ("640", "MAX_SPEED=0.4", "world-2-1", "interval"),
    "batch-metrics": ("physics steps", "real time", "compiling"),
    "deployment-robots": ("couriers-1", "couriers-2", "InSync"),
    "batch-report": ("✅ PASS", "all episodes", "report.html"),
    "worlds": ("2 worlds of", "contact-sheet.svg"),
    "gate": ("✅ PASS", "evidence.json"),
}


@dataclass(frozen=True)
class Watched:
    """A run that somebody watches.

    Attributes:
        api_url: Of the server.
        pages: Where its pages begin.
        process: ``simyard run``.
    """

    api_url: str
    pages: str
    process: "subprocess.Popen[str]"

    def flow_run(self, part: str = "") -> dict[str, Any]:
        """Returns the flow run of the pipeline, or of a stage of it, such as ``batch``; waits until it has begun."""
        whole = until(lambda: self._found({"name": {"any_": [NAME]}}))
        if not part:
            return whole
        inner = {"parent_flow_run_id": {"any_": [whole["id"]]}, "name": {"like_": f"-{part}"}}
        return until(lambda: self._found(inner))

    def artifacts(self) -> dict[str, dict[str, Any]]:
        """Returns what the run and its stages have left so far, by key."""
        wanted = {"flow_runs": {"parent_flow_run_id": {"any_": [self.flow_run()["id"]]}}}
        runs = [self.flow_run()["id"], *(run["id"] for run in asked(self.api_url, "/flow_runs/filter", wanted))]
        found = asked(self.api_url, "/artifacts/filter", {"artifacts": {"flow_run_id": {"any_": runs}}})
        return {each["key"].removeprefix(f"{NAME}--"): each for each in found if each["key"]}

    def end(self) -> None:
        """Returns when the run has ended well."""
        assert self.process.wait() == 0

    def _found(self, wanted: dict[str, Any]) -> dict[str, Any] | None:
        return next(iter(asked(self.api_url, "/flow_runs/filter", {"flow_runs": wanted})), None)


@pytest.fixture(scope="module")
def watched(prefect_server: str, tmp_path_factory: pytest.TempPathFactory) -> Generator[Watched]:
    """A run of 640 episodes, which lasts a minute; it goes on while the first test looks."""
    document = small_document(name=NAME)
    document["simulationBatch"]["matrix"]["seeds"] = 160  # pyright: ignore[reportIndexIssue]
    folder = tmp_path_factory.mktemp("watched")
    file = write_document(folder, document)
    process = simyard("run", str(file), "--store", (folder / "store").as_uri())
    try:
        yield Watched(prefect_server, prefect_server.removesuffix("/api"), process)
    finally:
        process.kill()
        process.communicate()


@pytest.fixture
def page(tmp_path: Path) -> Generator[Page]:
    """A page of somebody who has said the password; found without complaint in the end."""
    with browsing(tmp_path) as opened:
        say_password(opened, os.environ["PREFECT_API_AUTH_STRING"])
        yield opened
        assert complaints(opened) == []


@pytest.mark.soak
def test_the_page_of_the_batch_shows_how_far_it_is(watched: Watched, page: Page):
    batch = watched.flow_run("batch")
    progress = until(lambda: _begun(watched.artifacts().get("episodes-progress")))

    seen = shown(page, f"{watched.pages}/runs/flow-run/{batch['id']}", "Parent Run")
    listed = turned_to(page, "Artifacts", f"{NAME}--episodes-progress")
    graph_px = painted(page, "Running")
    pictured(page, "progress")
    told = shown(page, f"{watched.pages}/artifacts/artifact/{progress['id']}", "Progress:")

    assert "Running" in seen
    assert "PROGRESS" in listed
    assert graph_px > 500, "the graph has no bar of what runs"
    (percent,) = re.findall(r"Progress: (\d+)%", told)
    assert 0 < int(percent) < 100


@pytest.mark.soak
def test_the_page_of_the_run_shows_its_stages_and_what_they_left(watched: Watched, page: Page):
    watched.end()

    seen = shown(page, f"{watched.pages}/runs/flow-run/{watched.flow_run()['id']}", "Completed", height=1060)
    stages = turned_to(page, "Subflow Runs", "-deployment")
    tasks = turned_to(page, "Task Runs", "judge")
    left = turned_to(page, "Artifacts", f"{NAME}--pipeline-report")
    graph_px = painted(page, "Completed")
    pictured(page, "run")

    assert NAME in seen
    assert all(f"-{part}" in stages for part in ("worlds", "export", "batch", "deployment"))
    assert "No task runs" not in tasks
    assert all(key in left for key in ("pipeline-report", "batch-report", "batch-picture", "gate"))
    assert graph_px > 5000, "the graph has no bars"


@pytest.mark.soak
@pytest.mark.parametrize("key", TABLES)
def test_what_a_stage_left_has_a_page(watched: Watched, page: Page, key: str):
    watched.end()
    artifact = watched.artifacts()[key]

    seen = shown(page, f"{watched.pages}/artifacts/artifact/{artifact['id']}", "Show raw data")
    if key == "batch-results":
        pictured(page, "artifacts")

    assert [text for text in TABLES[key] if text not in seen] == []


@pytest.mark.soak
def test_the_logs_of_the_run_tell_its_story_and_its_state_what_came_of_it(watched: Watched, page: Page):
    watched.end()

    seen = shown(page, f"{watched.pages}/runs/flow-run/{watched.flow_run()['id']}", "Completed", height=1500)
    logs = turned_to(page, "Logs", "the gate begins")
    pictured(page, "logs")
    details = turned_to(page, "Details", "State Message")

    assert NAME in seen
    assert "the simulation batch is Completed after" in logs
    assert "PASS, shipped: 2 worlds" in details


@pytest.mark.soak
def test_the_history_of_an_artifact_is_that_of_one_document(watched: Watched, page: Page, tmp_path: Path):
    watched.end()
    of_others = [("small", small_document(name=f"{NAME}-too")), ("again", small_document(name=NAME))]
    for folder, document in of_others:
        (tmp_path / folder).mkdir()
        file = write_document(tmp_path / folder, document)
        assert finished("run", str(file), "--store", (tmp_path / folder / "store").as_uri()).returncode == 0
    key = f"{NAME}--batch-results"
    versions = [each["id"][:8] for each in _versions(watched.api_url, key)]

    seen = shown(page, f"{watched.pages}/artifacts/key/{key}", versions[-1], height=700)
    pictured(page, "history")

    assert len(versions) == 2
    assert [version for version in versions if version not in seen] == []


@pytest.mark.soak
def test_an_asset_is_an_event_with_what_it_was_made_of(watched: Watched, page: Page):
    watched.end()
    wanted = {"event": {"name": ["prefect.asset.materialization.succeeded"]}, "order": "DESC"}
    name = watched.artifacts()["batch-results"]["description"].replace("Results", "results")

    def found() -> dict[str, Any] | None:
        events = asked(watched.api_url, "/events/filter", {"filter": wanted, "limit": 50})["events"]
        return next((each for each in events if each["resource"].get("prefect.resource.name") == name), None)

    event = until(found)
    resource = event["resource"]["prefect.resource.id"]
    seen = shown(page, f"{watched.pages}/events/event/{event['occurred'][:10]}/{event['id']}", resource, height=800)
    pictured(page, "asset")

    assert "Asset materialization succeeded" in seen
    sources = [each["prefect.resource.id"] for each in event["related"] if each["prefect.resource.role"] == "asset"]
    assert len(sources) == 3
    assert [source for source in sources if source not in seen] == []


@pytest.mark.soak
def test_the_form_of_a_deployment_shows_its_document_field_by_field_or_as_a_file(prefect_server: str, page: Page):
    (_, *create_pool), (_, *deploy) = commands("docs/operate/operations.md", "deployments")
    prefect({}, *create_pool, "--overwrite")  # other tests of the session may have made it
    prefect({}, *deploy)
    document = yaml.safe_load((ROOT / "examples/quickstart.yaml").read_text())
    written = ("--name", "written-out", "--pool", "local", "--params", json.dumps({"spec": document}))
    prefect({}, "--no-prompt", "deploy", "simyard.flow.pipeline", *written)
    written_out = asked(prefect_server, "/deployments/name/pipeline/written-out")
    pages = prefect_server.removesuffix("/api")

    form = shown(page, f"{pages}/deployments/deployment/{written_out['id']}/run", "Robot radius", height=1200)
    pictured(page, "form")

    for text in ("World generation", "Every room is reachable for a robot of this radius", "Success rate"):
        assert text in form
    assert "Its path, from the base" in form


def test_no_task_has_an_input_that_prefects_pages_cannot_show(prefect_server: str, small_run: Path):
    """Where one has a flow run as its input, the page of a run shows no task runs."""
    tasks = asked(prefect_server, "/task_runs/filter", {})
    judging = [task for task in tasks if task["name"] == "judge"]
    kinds = {given["input_type"] for task in tasks for each in task["task_inputs"].values() for given in each}

    assert judging
    assert kinds <= {"task_run", "parameter", "constant"}


def _versions(api_url: str, key: str) -> list[dict[str, Any]]:
    return asked(api_url, "/artifacts/filter", {"artifacts": {"key": {"any_": [key]}}, "sort": "CREATED_DESC"})


def _begun(progress: dict[str, Any] | None) -> dict[str, Any] | None:
    return progress if progress and float(progress["data"]) > 5 else None

"""examples/ci: the workflows' own lines, run in a clone; and docs/guide/ci.md says what they and the report hold."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any, cast

import pytest
import yaml
from junitparser import JUnitXml

from specs.base import Spec
from tasks.results.ci.full_report import CountedBatch, FullReport, GateReport, GroupReport, RunFailure, WorldReport
from tests.repository import ROOT

TEXT = (ROOT / "docs/guide/ci.md").read_text()
GITHUB, GITLAB = (yaml.safe_load((ROOT / "examples/ci" / name).read_text()) for name in ("github.yml", "gitlab-ci.yml"))
STEPS = cast("list[dict[str, Any]]", GITHUB["jobs"]["simulate"]["steps"])
# They need a service, or download; the rest is run below.
NOT_RUN = {
    "actions/checkout",
    "actions/setup-python",
    "actions/cache",
    "actions/upload-artifact",
    "Install Simyard",
    "Comment",
}
DOCUMENT = """
name: small
worldGeneration: {template: examples/templates/two-rooms.json, worldCount: {floorplanCount: 1}, seed: 7}
simulationBatch:
  outputLocation: {s3Bucket: results, s3Prefix: small}
  audit: {lanes: 0}
  matrix: {worlds: all, seeds: 4}
  createSimulationJobRequests:
    - maxJobDurationInSeconds: 2
      robotApplications: [{application: courier, launchConfig: {packageName: courier, launchFile: go_to_goal}}]
      simulationApplications: [{application: delivery, launchConfig: {packageName: delivery, launchFile: rooms}}]
gate: {collisionRate: {atMost: 0.9, confidence: 0.5}}
"""


@pytest.fixture(scope="module")
def clone(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Returns a folder like a clone in which Simyard is installed."""
    folder = tmp_path_factory.mktemp("clone")
    (folder / ".venv").symlink_to(sys.prefix)
    for name in ("examples", "applications"):
        (folder / name).symlink_to(ROOT / name)
    (folder / "small.yaml").write_text(DOCUMENT)
    return folder


def _shell(lines: str, folder: Path, **variables: str) -> subprocess.CompletedProcess[str]:
    """Runs lines as both runners do."""
    environment = {**os.environ, "DOCUMENT": "small.yaml", "MARGIN": "0.02", **variables}
    environment.pop("SIMYARD_STORE", None)
    return subprocess.run(
        ["bash", "-eo", "pipefail", "-c", lines],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )


def _name(step: dict[str, Any]) -> str:
    return str(step["uses"]).partition("@")[0] if "uses" in step else str(step["name"])


def _is_run(step: dict[str, Any], event: str) -> bool:
    wanted = str(step.get("if", ""))
    other = {"push": "pull_request", "pull_request": "push"}[event]
    return f"event_name == '{other}'" not in wanted


def _github(folder: Path, event: str) -> dict[str, subprocess.CompletedProcess[str]]:
    """Runs the steps of an event one after another, as the runner does, and returns what came of each by its name."""
    (folder / "env").write_text("")
    given = {"GITHUB_ACTIONS": "true", "GITHUB_ENV": str(folder / "env"), "GITHUB_WORKSPACE": str(folder)}
    done: dict[str, subprocess.CompletedProcess[str]] = {}
    for step in STEPS:
        if _name(step).removesuffix("/restore").removesuffix("/save") in NOT_RUN or not _is_run(step, event):
            continue
        found = dict(line.split("=", 1) for line in (folder / "env").read_text().splitlines())
        summary = folder / f"summary-{event}.md"
        done[step["name"]] = _shell(step["run"], folder, GITHUB_STEP_SUMMARY=str(summary), **given, **found)
    return done


@pytest.mark.long
@pytest.mark.integration
@pytest.mark.usefixtures("prefect_server")
def test_the_steps_of_github_run_on_a_push_and_then_on_a_pull_request(clone: Path):
    pushed = _github(clone, "push")
    assert {name: done.returncode for name, done in pushed.items()} == {
        "Run the document": 0,
        "Write the report": 0,
        "Note the batch of main": 0,
    }, [done.stderr for done in pushed.values()]
    assert JUnitXml.fromfile(str(clone / "reports/junit.xml")).failures == 0
    assert "<!doctype html>" in (clone / "reports/report.html").read_text().lower()
    assert "## ✅ Passed: `small`" in (clone / "summary-push.md").read_text()
    asked = _github(clone, "pull_request")
    assert {name: done.returncode for name, done in asked.items()} == {
        "Run the document": 0,
        "Write the report": 0,
        "Compare with main": 0,
    }, [done.stderr for done in asked.values()]
    # Four pairs say nothing about a margin of two points.
    assert "::warning::too few pairs" in asked["Compare with main"].stdout
    assert "❔ INCONCLUSIVE" in (clone / "reports/comment.md").read_text()
    assert "❔ INCONCLUSIVE" in (clone / "summary-pull_request.md").read_text()


@pytest.mark.long
@pytest.mark.integration
@pytest.mark.usefixtures("prefect_server")
def test_the_lines_of_gitlab_run_on_main_and_then_in_a_merge_request(clone: Path):
    shutil.rmtree(clone / "reports", ignore_errors=True)
    for job, code in (("main", 0), ("merge-request", 4)):
        script = "\n".join(GITLAB[job]["script"])
        done = _shell(script, clone, GITLAB_CI="true", COMMENT_TOKEN="")
        assert done.returncode == code, done.stderr  # four pairs say nothing about a margin of two points
    assert code in GITLAB[".simulate"]["allow_failure"]["exit_codes"]
    assert (clone / GITLAB[".simulate"]["artifacts"]["reports"]["junit"]).exists()
    assert "❔ INCONCLUSIVE" in (clone / "reports/comment.md").read_text()


@pytest.mark.long
@pytest.mark.integration
@pytest.mark.usefixtures("prefect_server")
def test_the_commands_of_the_page_run(clone: Path):
    first, second = re.findall(r"^```sh\n(.*?)^```$", TEXT, re.DOTALL | re.MULTILINE)
    ran = _shell(first, clone)
    assert ran.returncode == 0, ran.stderr
    report = FullReport.model_validate_json((clone / "run.json").read_text())
    assert (report.document, report.verdict) == ("own-robot", "PASS")
    compared = _shell(second, clone)
    assert compared.returncode == 0, compared.stderr
    assert "## ✅ NO WORSE" in compared.stdout


def test_no_line_has_an_expression_in_it_that_a_stranger_can_fill():
    assert [step["run"] for step in STEPS if "${{" in step.get("run", "")] == []


def test_no_cache_holds_the_folder_with_the_key():
    kept = [step["with"]["path"] for step in STEPS if "actions/cache" in step.get("uses", "")]
    kept += [path for job in ("main", "merge-request") for cache in GITLAB[job]["cache"] for path in cache["paths"]]
    assert set(kept) == {".simyard", ".pip"}


def test_the_page_names_each_step_that_is_not_run_here():
    told = set(re.findall(r"`([^`]+)`", TEXT.split("are not run:")[1].split("\n\n")[0]))
    assert told == NOT_RUN | {"before_script", "curl"}


@pytest.mark.parametrize("model", [FullReport, GateReport, CountedBatch, WorldReport, GroupReport, RunFailure])
def test_every_field_of_the_json_document_is_explained(model: type[Spec]):
    names = re.findall(rf"^\| `{model.__name__}` \| `(\w+)` \|", TEXT, re.MULTILINE)
    assert names == list(model.model_fields)

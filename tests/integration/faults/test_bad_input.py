"""Bad input: one clear message, exit code 2 or 3, and nothing left that a later run trips over."""

import copy
import json
import os
import stat
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml

from tests.integration.runs import finished, small_document, write_document
from tests.repository import ROOT

Change = Callable[[dict[str, Any]], None]


def _unknown_key(document: dict[str, Any]) -> None:
    document["simulationBatch"]["matrix"]["sedes"] = 3


def _wrong_enum(document: dict[str, Any]) -> None:
    document["simulationBatch"]["createSimulationJobRequests"][0]["failureBehavior"] = "Explode"


def _contradictory_connections(document: dict[str, Any]) -> None:
    template = json.loads((ROOT / "examples/templates/two-rooms.json").read_text())
    rooms = ["Living room", "Dining room"]
    template["Buildings"][0]["Floors"][0]["Floorplan"]["DesiredConnections"] = [
        {"Location": rooms, "ConnectionType": "Opening"},
        {"Location": rooms, "ConnectionType": "Doorway"},
    ]
    document["worldGeneration"]["template"] = template


def _too_many_worlds(document: dict[str, Any]) -> None:
    document["worldGeneration"]["worldCount"] = {"floorplanCount": 200, "interiorCountPerFloorplan": 100}


def _missing_template(document: dict[str, Any]) -> None:
    document["worldGeneration"]["template"] = "templates/nowhere.json"


def _unknown_application(document: dict[str, Any]) -> None:
    request = document["simulationBatch"]["createSimulationJobRequests"][0]
    request["robotApplications"][0]["application"] = "nobody"


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (_unknown_key, ("simulationBatch.matrix.sedes", "seeds")),
        (_wrong_enum, ("failureBehavior", "Explode", "Continue")),
        (_contradictory_connections, ("DesiredConnections", "Opening", "Doorway")),
        (_too_many_worlds, ("20000", "10000")),
        (_missing_template, ("worldGeneration.template", "nowhere.json")),
        (_unknown_application, ("application", "nobody")),
    ],
)
def test_a_bad_document_is_refused_before_anything_runs(tmp_path: Path, change: Change, words: tuple[str, ...]):
    document = copy.deepcopy(small_document())
    change(document)
    file = write_document(tmp_path, document)
    result = finished("plan", str(file), "--store", (tmp_path / "store").as_uri())
    assert result.returncode == 2
    assert "Traceback" not in result.stderr
    assert result.stderr.count(" fault\n") == 1
    assert all(word in result.stderr for word in words), result.stderr
    assert not [*tmp_path.glob("store/jobs/*"), *tmp_path.glob("store/worlds/*")]


@pytest.mark.integration
def test_run_refuses_a_bad_document_like_plan_does(tmp_path: Path, prefect_server: str):
    document = small_document()
    document["unknown"] = 1
    file = write_document(tmp_path, document)
    result = finished("run", str(file), "--store", (tmp_path / "store").as_uri())
    assert (result.returncode, "unknown" in result.stderr, "Traceback" in result.stderr) == (2, True, False)


def test_an_unreachable_store_is_told_within_seconds(tmp_path: Path):
    file = write_document(tmp_path, small_document())
    result = finished(
        "run",
        str(file),
        "--store",
        "s3://nowhere/prefix",
        AWS_ENDPOINT_URL_S3="http://127.0.0.1:9",
        AWS_ACCESS_KEY_ID="key",
        AWS_SECRET_ACCESS_KEY="secret",  # noqa: S106 - nothing listens there
        AWS_EC2_METADATA_DISABLED="true",
    )
    assert result.returncode == 3
    assert "Traceback" not in result.stderr
    assert "127.0.0.1:9" in result.stderr or "nowhere" in result.stderr


def test_a_prefect_server_that_is_not_there_is_told_and_is_no_verdict(tmp_path: Path):
    file = write_document(tmp_path, small_document())
    api_url = "http://127.0.0.1:9/api"
    result = finished("run", str(file), "--store", (tmp_path / "store").as_uri(), PREFECT_API_URL=api_url)
    assert result.returncode == 3
    assert result.stderr.count("\n") == 1
    assert f"no Prefect server answers at PREFECT_API_URL={api_url}; unset it, or simyard up" in result.stderr


@pytest.mark.parametrize(
    ("option", "value", "word"), [("--output", "/nonexistent/x.svg", "No such file"), ("--seed", "-1", "equal to 0")]
)
def test_a_preview_refuses_a_bad_option(tmp_path: Path, option: str, value: str, word: str):
    write_document(tmp_path, {})
    options = {"--output": str(tmp_path / "x.svg"), "--store": (tmp_path / "store").as_uri(), option: value}
    template = str(tmp_path / "templates/two-rooms.json")
    result = finished("world", "preview", template, *(f"{name}={given}" for name, given in options.items()))
    assert result.returncode == 2
    assert "Traceback" not in result.stderr
    assert option in result.stderr
    assert word in result.stderr


@pytest.mark.parametrize("command", [("list", "worlds"), ("describe", "arn:simyard:world:a:b/c")])
def test_looking_into_a_store_that_is_not_there_makes_none(tmp_path: Path, command: tuple[str, ...]):
    store = tmp_path / "store"
    result = finished(*command, "--store", store.as_uri())
    assert result.returncode == 3
    assert f"no store there: {store.as_uri()}" in result.stderr
    assert not store.exists()


@pytest.mark.long
@pytest.mark.integration
def test_after_a_read_only_output_folder_is_opened_the_same_command_succeeds(tmp_path: Path, prefect_server: str):
    document = small_document()
    for section in ("simulationBatch", "gate", "deployment"):
        del document[section]
    file = write_document(tmp_path, document)
    store = tmp_path / "store"
    buckets = store / "buckets"
    buckets.mkdir(parents=True)
    command = ("run", str(file), "--store", store.as_uri())
    with _read_only(buckets):
        refused = finished(*command)
    assert refused.returncode == 3, refused
    assert "AccessDenied" in refused.stderr
    assert "Traceback" not in refused.stderr
    assert finished(*command).returncode == 0
    assert len([*buckets.rglob("*.zip")]) == 1


class _read_only:  # noqa: N801 - reads as a word in a with statement
    """Makes a folder one that nobody can write to, root included where the file system allows it."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def __enter__(self) -> None:
        if os.geteuid() != 0:
            self.folder.chmod(stat.S_IRUSR | stat.S_IXUSR)
        elif subprocess.run(["chattr", "+i", str(self.folder)], check=False, capture_output=True).returncode:
            pytest.skip("root writes everywhere, and this file system has no immutable folders")

    def __exit__(self, *exc: object) -> None:
        if os.geteuid() != 0:
            self.folder.chmod(stat.S_IRWXU)
        else:
            subprocess.run(["chattr", "-i", str(self.folder)], check=True)


def test_the_example_is_valid_as_it_stands():
    example = ROOT / "examples/quickstart.yaml"
    assert finished("validate", str(example)).returncode == 0
    assert yaml.safe_load(example.read_text())["name"] == "apartment-regression"

"""`simyard run --direct`: the same records as with a server, and no Prefect."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from tasks.storage.jobs.records import records
from tasks.storage.store_url import open_store
from tests.integration.runs import JOB_KINDS, finished, simyard, small_document, write_document
from tests.repository import ROOT
from tests.servers.eventually import eventually

_WORLDS = ROOT / "examples/worlds-only.yaml"
_MODULES = """
import json, sys
from flows.cli.shell import app
try:
    app(sys.argv[1:])
except SystemExit as exc:
    assert not exc.code, exc.code
print(json.dumps(sorted({name.partition(".")[0] for name in sys.modules})))
"""


def statuses(folder: Path) -> dict[str, list[tuple[str, str]]]:
    if not (folder / "store.json").exists():
        return {kind: [] for kind in JOB_KINDS}
    store = open_store(folder.as_uri())
    return {kind: [(each.id, each.status) for each in records(store, kind)] for kind in JOB_KINDS}


@pytest.mark.long
@pytest.mark.integration
def test_worlds_are_made_without_prefect_and_without_a_simulator(tmp_path: Path):
    command = [sys.executable, "-c", _MODULES, "run", "--direct", str(_WORLDS), "--store", tmp_path.as_uri()]
    done = subprocess.run(command, capture_output=True, text=True, timeout=200, check=False)
    assert done.returncode == 0, done.stderr
    loaded = set(json.loads(done.stdout.splitlines()[-1]))
    assert loaded & {"prefect", "jax", "fastapi", "sqlalchemy"} == set()
    assert "Done" in done.stdout


@pytest.mark.integration
@pytest.mark.long
@pytest.mark.parametrize("first", ["--direct", ""], ids=["killed directly", "killed with a server"])
def test_either_way_continues_what_the_other_began(first: str, tmp_path: Path):
    file = write_document(tmp_path, {name: part for name, part in small_document().items() if name != "deployment"})
    store, second = tmp_path / "store", "" if first else "--direct"
    killed = simyard("run", *first.split(), str(file), "--store", store.as_uri())
    assert eventually(lambda: "Completed" in {status for _, status in statuses(store)["world-export-job"]}, 100.0)
    killed.kill()
    killed.communicate()
    began = statuses(store)
    done = finished("run", *second.split(), str(file), "--store", store.as_uri())
    assert done.returncode == 0, done.stderr
    ended = statuses(store)
    assert {kind: len(found) for kind, found in ended.items()} == {
        "world-generation-job": 1,
        "world-export-job": 1,
        "simulation-job-batch": 1,
        "deployment-job": 0,
        "pipeline-run": 1,
    }
    assert {status for found in ended.values() for _, status in found} == {"Completed"}
    assert [each for each, _ in began["pipeline-run"]] == [each for each, _ in ended["pipeline-run"]]


@pytest.mark.integration
def test_workers_of_a_cluster_are_refused_with_what_to_do(tmp_path: Path):
    done = finished("run", "--direct", str(_WORLDS), "--store", tmp_path.as_uri(), SIMYARD_WORKERS="dask:2")
    assert done.returncode == 2
    assert "SIMYARD_WORKERS" in done.stderr
    assert "--direct" in done.stderr

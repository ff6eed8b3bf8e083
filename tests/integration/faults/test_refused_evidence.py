"""A run that is killed between its gate and its deployment, and continued when something has changed, ships nothing."""

import json
from pathlib import Path

import pytest

from tests.integration.runs import finished, kill_when, simyard, small_document, write_document

pytestmark = [pytest.mark.integration, pytest.mark.timeout(280)]


@pytest.mark.long
def test_all_changed_files_are_named_by_the_run_that_goes_on(tmp_path: Path):
    gate = {"successRate": {"atLeast": 0.5}, "collisionRate": {"atMost": 0.6}, "stopEarly": True}
    file = write_document(tmp_path, small_document(gate=gate))
    store = tmp_path / "store"
    command = ("run", str(file), "--store", store.as_uri())
    kill_when(simyard(*command), lambda: any(store.glob("results/*/evidence.json")))
    world = sorted(store.glob("worlds/*/world-*.json"))[0]
    world.write_bytes(world.read_bytes().replace(b"0", b"1", 1))
    (failures,) = store.glob("buckets/*/**/failures.parquet")
    (audit,) = store.glob("buckets/*/**/audit.json")
    failures.write_bytes(failures.read_bytes()[:-8])  # no reader can make anything of it
    audit.write_bytes(audit.read_bytes() + b" ")
    result = finished(*command)
    assert result.returncode == 1, result.stderr
    told = " ".join(result.stdout.split())
    assert "Refused" in told
    assert f"worlds/{world.parent.name}/{world.name}, has changed" in told
    assert f"{audit.parent.name}/audit.json has changed" in told
    assert f"{failures.parent.name}/failures.parquet has changed" in told
    assert told.count("There is no new report: MismatchedEtag:") == 1
    assert not any(store.glob("robots/*/desired.json"))
    (evidence,) = store.glob("results/*/evidence.json")
    assert json.loads(evidence.read_bytes())["left_out"] == 16  # it was certain after the first of two chunks

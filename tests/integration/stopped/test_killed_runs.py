"""`kill -9` of `simyard run` in each stage, then the same command: nothing lost, nothing twice."""

from pathlib import Path

import pytest

from tasks.storage.store_url import open_store
from tests.integration.runs import (
    JOB_KINDS,
    audit,
    finished,
    jobs,
    kill_when,
    recordings,
    simyard,
    small_document,
    tables,
    worlds,
    write_document,
)

pytestmark = [pytest.mark.integration, pytest.mark.timeout(280)]

# What a store holds while a stage is under way. The gate's window is between the batch's audit and its evidence.
_STAGES = {
    "world generation": "worlds/*/*.json",
    "world export": "jobs/world-export-job/*.json",
    "simulation": "chunks/*/000000.json",
    "audit": "results/*/audit-begun.json",
    "gate": "buckets/results/nightly/*/audit.json",
    "deployment": "robots/*/desired.json",
}


@pytest.mark.long
@pytest.mark.parametrize(
    "stages",
    [
        pytest.param(("simulation", "deployment"), id="two"),
        pytest.param(tuple(_STAGES), id="all", marks=pytest.mark.soak),
    ],
)
def test_a_run_killed_in_every_stage_ends_like_an_unbroken_one(
    stages: tuple[str, ...], tmp_path: Path, small_run: Path
):
    file = write_document(tmp_path, small_document())
    broken = tmp_path / "broken"
    command = ("run", str(file), "--store", broken.as_uri())
    for trace in map(_STAGES.__getitem__, stages):
        kill_when(simyard(*command), lambda trace=trace: any(broken.glob(trace)))
    result = finished(*command)
    assert result.returncode == 0, result.stderr
    ours, theirs = open_store(broken.as_uri()), open_store((small_run / ".simyard").as_uri())
    assert {kind: len(found) for kind, found in jobs(ours).items()} == dict.fromkeys(JOB_KINDS, 1)
    assert [[job.id for job in found] for found in jobs(ours).values()] == [
        [job.id for job in found] for found in jobs(theirs).values()
    ]
    assert tables(ours)["results"].num_rows == 32
    assert all(tables(ours)[name].equals(table) for name, table in tables(theirs).items())
    assert worlds(ours) == worlds(theirs)
    assert recordings(ours) == recordings(theirs)
    assert audit(ours) == audit(theirs)
    assert list(recordings(ours)) == ["/000000.parquet", "/000001.parquet"]

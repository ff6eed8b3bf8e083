"""Forges what a gate is answered from, after a run whose gate said FAIL, and has the owner run the document again.

That nothing ships without a gate's answer is tested where it is decided: tests/flows/gate/test_shipment.py. Forged
worlds: tests/worlds/job/test_generation_job.py. Each attack's docstring says what the attacker does, and what stops it.
"""

import hashlib
import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from specs.data.column_bytes import encode_columns
from specs.data.episode import EpisodeResult
from specs.data.episode_columns import EpisodeColumns
from tasks.simulate.batch.chunk_store import results_in
from tasks.storage.jobs.authenticator import MAC_LENGTH
from tests.attacks.conftest import Owner, Writer
from tests.integration.runs import small_document, write_document

pytestmark = [pytest.mark.integration, pytest.mark.timeout(280)]

# What an honest run left in a store of that kind: all attacks of a kind begin there.
_LEFT: dict[str, dict[str, bytes]] = {}


class Judged:
    """A store in which the document was run once; its robots had two seconds, so that none came to its goal."""

    def __init__(self, owner: Owner, writer: Writer) -> None:
        """Runs the document, or has what that leaves."""
        self.owner, self.writer = owner, writer
        document: Any = small_document(gate={"successRate": {"atLeast": 0.5}})
        del document["worldExport"]
        document["simulationBatch"]["audit"] = {"lanes": 0}
        del document["simulationBatch"]["recordings"]
        document["simulationBatch"]["createSimulationJobRequests"][0]["maxJobDurationInSeconds"] = 2
        document["deployment"]["fleet"]["localAgents"] = 1
        self._file = write_document(owner.folder, document)
        kind = owner.url.partition(":")[0]
        if kind not in _LEFT:
            ended = self.run()
            assert "FAIL" in ended, ended
            _LEFT[kind] = {key: writer.get(key) for key in writer.keys("")}
        else:
            # Keys for robots of this machine are kept by the store's id, and another attack may have had them signed.
            shutil.rmtree(Path(owner.environment["SIMYARD_CACHE"]) / "keys", ignore_errors=True)
            for key, body in _LEFT[kind].items():
                writer.put(key, body)

    def run(self) -> str:
        """Returns what the owner's command says, without line breaks, and how it ended."""
        ended = self.owner.simyard("run", str(self._file))
        return f"{' '.join(ended.stdout.split())} exit code {ended.returncode}"

    def record(self, kind: str) -> dict[str, Any]:
        """Returns the only record of a kind."""
        return json.loads(self.writer.get(self._key(kind)))

    def edit(self, kind: str, change: Callable[[dict[str, Any]], None]) -> None:
        """Changes the only record of a kind."""
        record = self.record(kind)
        change(record)
        self.writer.put(self._key(kind), json.dumps(record).encode())

    def reopen(self, *, without_answer: bool = True) -> None:
        """Lets the run go on: the owner's next command continues it."""

        def change(run: dict[str, Any]) -> None:
            run.update(status="Running", failure_code="", failure_reason="")
            run["detail"].pop("report", None)
            if without_answer:
                run["detail"].pop("gate")

        self.edit("pipeline-run", change)

    def rows(self, chunk: str) -> list[dict[str, Any]]:
        """Returns the rows of a chunk."""
        return [row.model_dump(mode="json") for row in results_in(self.writer.get(chunk)).rows()]

    def nothing_shipped(self) -> bool:
        """Returns whether no robot was asked to run anything."""
        return not any(key.endswith("/desired.json") for key in self.writer.keys("robots/"))

    def _key(self, kind: str) -> str:
        (key,) = self.writer.keys(f"jobs/{kind}/")
        return key


@pytest.fixture
def judged(owner: Owner, writer: Writer) -> Judged:
    return Judged(owner, writer)


def passed(row: dict[str, Any]) -> dict[str, Any]:
    """Returns a row as if its episode had passed."""
    return {**row, "outcome": "Passed", "outcome_reason": "", "goals_reached": row["goals_total"], "trajectory": []}


def job_id(prefix: str, kind: str, token: str) -> str:
    """Returns the id that a job will have; anybody can compute it."""
    return f"{prefix}-{hashlib.sha256(f'{kind}|{token}'.encode()).hexdigest()[:16]}"


def pass_all(batch: dict[str, Any]) -> None:
    """Lets the record of a batch say that all episodes passed."""
    counts = batch["detail"]["counts"]
    counts.update(successes=counts["episodes"], failed_jobs=0)


def as_rows(rows: list[dict[str, Any]]) -> bytes:
    """Returns a chunk as the oldest version wrote it, which nobody vouched for."""
    return json.dumps(rows).encode()


def as_columns(rows: list[dict[str, Any]]) -> bytes:
    """Returns a chunk as this version writes it, with a mark that the attacker made up."""
    columns = encode_columns(EpisodeColumns.of([EpisodeResult.model_validate(row) for row in rows]))
    return b'{"mac":"' + b"0" * MAC_LENGTH + b'"}\n' + columns


@pytest.mark.parametrize("form", [as_rows, as_columns])
def test_chunks_that_were_forged_beforehand_are_not_counted(
    judged: Judged, form: Callable[[list[dict[str, Any]]], bytes]
) -> None:
    """Writes chunks full of passes under the id of the next run's batch | nobody vouches for them, so they are
    simulated anew and compared, and the run ends naming the chunk and its rows."""
    run = judged.record("pipeline-run")
    token, _, number = str(run["token"]).rpartition("-")
    following = job_id("run", "pipeline-run", f"{token}-{int(number) + 1}")
    batch = job_id("simb", "simulation-job-batch", f"{following}-batch")
    chunks = [key for key in judged.writer.keys("chunks/") if "started" not in key]
    names = [f"chunks/{batch}/{chunk.rpartition('/')[2]}" for chunk in chunks]
    for chunk, name in zip(chunks, names, strict=True):
        judged.writer.put(name, form([passed(row) for row in judged.rows(chunk)]))
    told = judged.run()
    assert judged.nothing_shipped(), told
    assert names[0] in told
    assert "outcome 'Passed', computed 'Failed'" in told
    assert told.endswith("exit code 3")


def test_counts_that_were_edited_are_not_judged_by(judged: Judged) -> None:
    """Raises the counts in the batch's record | the record's seal breaks, the batch is counted again from its chunks,
    and the run ends naming both counts."""
    judged.edit("simulation-job-batch", pass_all)
    judged.reopen()
    told = judged.run()
    assert judged.nothing_shipped(), told
    assert "says counts" in told
    assert told.endswith("exit code 3")


def test_tables_that_were_edited_with_their_digests_are_not_judged_by(judged: Judged) -> None:
    """Lets all rows of results.parquet pass, with digests and counts in the record to match | the tables are made again
    from the chunks that the owner vouches for, and have other digests."""
    (key,) = (key for key in judged.writer.keys("buckets/") if key.endswith("/results.parquet"))
    table = pq.read_table(pa.BufferReader(judged.writer.get(key)))
    place = table.schema.get_field_index("success")
    forged = pa.array([True] * table.num_rows, pa.bool_())
    sink = pa.BufferOutputStream()
    pq.write_table(table.set_column(place, table.schema.field(place), forged), sink)
    body = sink.getvalue().to_pybytes()
    judged.writer.put(key, body)
    computed = judged.record("simulation-job-batch")["detail"]["sha256s"]["results.parquet"]

    def change(batch: dict[str, Any]) -> None:
        pass_all(batch)
        batch["detail"]["sha256s"]["results.parquet"] = hashlib.sha256(body).hexdigest()

    judged.edit("simulation-job-batch", change)
    judged.reopen()
    told = judged.run()
    assert judged.nothing_shipped(), told
    assert f"'results.parquet': '{computed}" in told.partition("computed: ")[2]
    assert told.endswith("exit code 3")


def test_a_verdict_that_was_edited_ships_nothing(judged: Judged) -> None:
    """Turns FAIL into PASS in the run's record and in the evidence, digests to match | the answer's seal breaks, the
    gate judges again, and the run ends naming both answers."""
    (key,) = (key for key in judged.writer.keys("results/") if key.endswith("/evidence.json"))
    evidence = json.loads(judged.writer.get(key)) | {"verdict": "PASS"}
    body = json.dumps(evidence, sort_keys=True, separators=(",", ":"), ensure_ascii=False).encode()
    judged.writer.put(key, body)
    judged.reopen(without_answer=False)

    def change(run: dict[str, Any]) -> None:
        run["detail"]["gate"].update(verdict="PASS", evidence=hashlib.sha256(body).hexdigest())

    judged.edit("pipeline-run", change)
    told = judged.run()
    assert judged.nothing_shipped(), told
    assert "says the verdict PASS" in told
    assert told.endswith("exit code 3")


def test_a_plan_that_was_edited_is_not_simulated(judged: Judged) -> None:
    """Gives the robots sixty seconds instead of two in the plan of a batch that goes on | the plan is made again from
    the document and compared before anything is simulated."""

    def change(batch: dict[str, Any]) -> None:
        batch.update(status="InProgress")
        batch["detail"] = {}
        batch["request"]["plan"]["templates"][0]["duration_s"] = 60.0

    judged.edit("simulation-job-batch", change)
    for key in judged.writer.keys("chunks/"):
        judged.writer.delete(key)
    judged.reopen()
    told = judged.run()
    assert judged.nothing_shipped(), told
    assert "says the plan " in told
    assert told.endswith("exit code 3")

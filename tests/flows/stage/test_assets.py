"""What jobs have made, and of what: URLs in the store, figures, and nothing for a job that made nothing."""

from collections.abc import Mapping
from pathlib import Path

import pytest

from flows.pipeline.run_gate import GateAnswer
from flows.pipeline.stage_report import evidence_of, made_by
from specs.job_kinds import JobKind
from tasks.storage.base.keys import bundle_key
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import JobRecord, advance, submit
from tasks.storage.jobs.runs import stage_token
from tests.factories.judged_batches import courier, delivery, ended

LAUNCH = {"packageName": "courier", "launchFile": "run.sh"}
PLAN = {"fleet": "couriers", "application": "courier", "version": 3, "digest": "a" * 64, "launch": LAUNCH}
ROLL_OUT = {**PLAN, "environments": {"r1": {}, "r2": {}}, "at_once": 1, "failures": 1, "timeout_s": 9.0}
PROGRESS = {"r1": {"status": "InSync"}, "r2": {"status": "NoResponse"}}


def job(store: Store, kind: JobKind, status: str, detail: Mapping[str, object], **request: object) -> JobRecord:
    """Returns a job that ended with that status."""
    made = submit(store, kind, request, "one")  # pyright: ignore[reportArgumentType]
    return advance(store, kind, made.id, status, detail=detail)  # pyright: ignore[reportArgumentType]


def generation(store: Store, status: str, worlds: list[str]) -> JobRecord:
    facts = {"failures": {"InvalidInput": {"count": 2}}, "template_digest": "t", "seed": 7}
    return job(store, "world-generation-job", status, {"worlds": worlds, **facts})


@pytest.mark.parametrize("status", ["Completed", "PartialFailed"])
def test_the_worlds_of_a_generation_are_one_asset(file_store: Store, status: str):
    record = generation(file_store, status, ["g/w1", "g/w2"])
    made = made_by(file_store, record)
    assert made is not None
    assert made.asset.url == f"{file_store.url}/worlds/{record.id}"
    assert made.facts == {"worlds": 2, "failed": 2, "template": "t", "seed": 7, "job": record.arn}


@pytest.mark.parametrize("status", ["Failed", "Canceled", "Running"])
def test_a_job_that_made_nothing_leaves_nothing(file_store: Store, status: str):
    assert made_by(file_store, generation(file_store, status, ["g/w1"])) is None
    assert made_by(file_store, generation(file_store, "Completed", [])) is None


def test_a_zip_is_made_of_the_generations_of_its_worlds_each_once(file_store: Store):
    worlds = [f"arn:simyard:world:s:{each}" for each in ("g1/w1", "g1/w2", "g2/w1")]
    detail = {"zip": "file:///b/e.zip", "sha256": "5"}
    record = job(file_store, "world-export-job", "Completed", detail, worlds=worlds, formats=["svg"])
    made = made_by(file_store, record)
    assert made is not None
    assert made.asset.url == "file:///b/e.zip"
    assert [each.url for each in made.sources] == [f"{file_store.url}/worlds/{each}" for each in ("g1", "g2")]
    assert made.facts == {"worlds": 3, "formats": ["svg"], "sha256": "5", "job": record.arn}


def test_tables_are_made_of_worlds_and_bundles_and_the_evidence_of_tables(file_store: Store, tmp_path: Path):
    robot, scenario = courier(file_store, tmp_path, "one"), delivery(file_store, tmp_path)
    batch = ended(file_store, robot, scenario=scenario)
    tables = made_by(file_store, batch)
    answer = GateAnswer(batch=batch.id, verdict="PASS", sentence="PASS: 8", evidence_url="file:///e", evidence="0" * 64)
    evidence = evidence_of(file_store, answer)

    assert tables is not None
    assert tables.asset.url == batch.detail["results_url"]
    bundles = [f"{file_store.url}/{bundle_key(each.digest)}" for each in (robot, scenario)]
    assert [each.url for each in tables.sources] == [f"{file_store.url}/worlds/g", *bundles]
    assert (tables.facts["episodes"], tables.facts["passed"]) == (80, 80)
    assert (evidence.asset.url, evidence.sources) == ("file:///e", (tables.asset,))
    assert (evidence.facts["verdict"], evidence.facts["sha256"]) == ("PASS", "0" * 64)


def test_a_roll_out_of_a_document_is_made_of_the_bundle_and_the_evidence(file_store: Store):
    answer = {"batch": "b", "verdict": "PASS", "sentence": "s", "evidence_url": "file:///e", "evidence": "0" * 64}
    run = job(file_store, "pipeline-run", "Running", {"gate": answer})
    record = job(file_store, "deployment-job", "Succeeded", {"plan": ROLL_OUT, "progress": PROGRESS})

    made = made_by(file_store, record, stage_token(run, "deployment"))
    alone = made_by(file_store, record)

    assert made is not None
    assert alone is not None
    assert made.asset == (f"{file_store.url}/jobs/deployment-job/{record.id}.json", "courier 3 on couriers")
    bundle = f"{file_store.url}/{bundle_key('a' * 64)}"
    assert [each.url for each in made.sources] == [bundle, "file:///e"]
    assert [each.url for each in alone.sources] == [bundle]
    assert (made.facts["robots"], made.facts["inSync"]) == (2, 1)


def test_a_roll_out_that_failed_leaves_nothing(file_store: Store):
    record = job(file_store, "deployment-job", "Failed", {"plan": ROLL_OUT, "progress": PROGRESS})
    assert made_by(file_store, record) is None

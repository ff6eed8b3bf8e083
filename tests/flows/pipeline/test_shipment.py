"""Nothing is shipped unless all that the gate saw is as it was, to the byte; what has changed is named."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import cast

import pytest

from flows.pipeline.pipeline import deploy, judge
from flows.pipeline.references import ParsedRun, Resolved
from flows.pipeline.run_gate import evidence_changes, gate_answer, read_gate_answer, shippable, withdraw_deployment
from specs.data.run_report import StageReport
from tasks.applications.registry import resolve
from tasks.results.gate.evidence import read_evidence
from tasks.results.gate.shipped_builds import Shipment, shipment_of
from tasks.simulate.batch.batch_record import plan_of
from tasks.storage.base.keys import application_key, bundle_key, result_key, world_key
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import JobRecord, advance, job_id, read, submit
from tasks.storage.jobs.runs import stage_token
from tests.factories.judged_batches import courier, delivery, document, ended, run_of
from tests.factories.planned_batches import mixed

PIPELINE = document({"successRate": {"atLeast": 0.9}, "collisionRate": {"atMost": 0.1}})


class Shop:
    """A run whose gate has passed, and a deployment that only notes that it was asked for."""

    def __init__(self, store: Store, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr("flows.pipeline.pipeline.deployment_sync", self._ship)
        monkeypatch.setattr("flows.pipeline.pipeline.recount_changes", lambda *_: [])  # these rows were not simulated
        self.shipped: list[dict[str, str]] = []
        self.store, self.robot = store, courier(store, folder, "one")
        self.batch = ended(store, self.robot, scenario=delivery(store, folder))
        self.run = run_of(store)
        (self.gate,) = judge(self.work(), self.batch)

    def work(self, ships: Shipment | None = None) -> ParsedRun:
        return ParsedRun(PIPELINE, ".", self.store, self.run, Resolved(ships=ships))

    def deploy(self) -> StageReport:
        (report,) = deploy(self.work(), self.batch)
        return report

    def key(self, url: str) -> str:
        return str(self.batch.detail[url]).removeprefix(self.store.url + "/")

    def _ship(self, _section: object, _store: str, tested: dict[str, str], *_: object, **__: object) -> JobRecord:
        self.shipped.append(tested)
        return submit(self.store, "deployment-job", {}, "shipped")


@pytest.fixture
def shop(file_store: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Shop:
    return Shop(file_store, tmp_path, monkeypatch)


def flip(store: Store, key: str) -> None:
    """Changes one bit in the middle of an object."""
    body = bytearray(store.get(key).body)
    body[len(body) // 2] ^= 1
    store.put(key, bytes(body))


OBJECTS: dict[str, Callable[[Shop], str]] = {
    "bundle of courier version 1": lambda shop: bundle_key(shop.robot.digest),
    "bundle of delivery version 1": lambda shop: bundle_key(plan_of(shop.batch).templates[0].scenario.digest),
    "world g/w1": lambda _: world_key("g", "w1"),
    "results.parquet": lambda shop: shop.key("results_url"),
    "failures.parquet": lambda shop: shop.key("failures_url"),
    "evidence.json": lambda shop: result_key(shop.batch.id, "evidence.json"),
}


def test_what_is_as_the_gate_saw_it_is_shipped(shop: Shop):
    assert shop.gate.status == "PASS"
    shop.deploy()
    assert shop.shipped == [{"courier": shop.robot.digest}]


@pytest.mark.parametrize("name", list(OBJECTS))
def test_one_changed_bit_is_refused_by_name_and_by_nothing_else(shop: Shop, name: str):
    key = OBJECTS[name](shop)
    flip(shop.store, key)
    report = shop.deploy()
    assert (report.status, shop.shipped) == ("Refused", [])
    assert f"{key}" in report.summary
    assert name in report.summary
    assert "has changed: its SHA-256 is " in report.summary
    others = [other for other in OBJECTS if other not in {name, "results.parquet", "failures.parquet"}]
    assert not [other for other in others if f"{other}," in report.summary]
    assert str(report.facts["alarm"]).startswith("The deployment was refused: ")


@pytest.mark.parametrize("name", list(OBJECTS))
def test_what_is_gone_is_refused_by_name(shop: Shop, name: str):
    shop.store.delete(OBJECTS[name](shop))
    report = shop.deploy()
    assert (report.status, shop.shipped) == ("Refused", [])
    assert name in report.summary
    assert "is gone" in report.summary


def test_a_build_that_was_added_since_the_run_began_is_refused(shop: Shop):
    version = resolve(shop.store, "robot-application", "courier")
    assert PIPELINE.deployment
    settled = shipment_of(PIPELINE.deployment, version)
    key = application_key("robot-application", "courier")
    added = [{"architecture": "ARM64", "digest": "f" * 64, "size_bytes": 1}]
    application = json.loads(shop.store.get(key).body)
    application["versions"][0]["builds"] = added
    shop.store.put(key, json.dumps(application).encode())
    (report,) = deploy(shop.work(settled), shop.batch)
    assert (report.status, shop.shipped) == ("Refused", [])
    assert f"courier version 1 for ARM64 is {'f' * 64} now; when the run began it was not there" in report.summary


def test_all_that_has_changed_is_named_at_once(shop: Shop):
    flip(shop.store, world_key("g", "w0"))
    flip(shop.store, bundle_key(shop.robot.digest))
    summary = shop.deploy().summary
    assert "world g/w0" in summary
    assert "bundle of courier version 1" in summary


def test_a_run_that_goes_on_does_not_judge_again_and_mends_no_evidence(shop: Shop):
    before = read_gate_answer(shop.store, shop.run)
    key = OBJECTS["evidence.json"](shop)
    flip(shop.store, key)
    assert PIPELINE.gate
    assert gate_answer(PIPELINE.gate, shop.batch, shop.store, shop.run) == before
    assert shop.deploy().status == "Refused"
    assert "evidence.json has changed" in shop.deploy().summary


def test_evidence_is_about_one_bundle_and_no_other(shop: Shop, tmp_path: Path):
    other = courier(shop.store, tmp_path, "two")
    (line,) = evidence_changes(other.digest, shop.store, shop.run)
    assert line.startswith(f"the bundle that is to be shipped is {other.digest}; the evidence of {shop.batch.id} is")
    assert f"courier version 1 ({shop.robot.digest})" in line


def test_evidence_that_does_not_pass_ships_nothing(file_store: Store, tmp_path: Path):
    robot, run = courier(file_store, tmp_path, "one"), run_of(file_store)
    batch = ended(file_store, robot, scenario=delivery(file_store, tmp_path), simulate=mixed)
    assert judge(ParsedRun(PIPELINE, ".", file_store, run), batch)[0].status == "FAIL"
    assert evidence_changes(robot.digest, file_store, run) == [f"the evidence of {batch.id} says FAIL"]


def test_without_a_gate_there_is_nothing_to_hold_against(file_store: Store):
    assert evidence_changes("0" * 64, file_store, run_of(file_store), gated=False) == []


def test_a_gate_that_has_not_answered_ships_nothing(file_store: Store):
    run = run_of(file_store)
    (line,) = evidence_changes("0" * 64, file_store, run)
    assert line.endswith(f"{run.id}.json says no gate's answer, and the document has a gate")


def test_the_version_that_was_compared_with_is_not_what_is_shipped(file_store: Store, tmp_path: Path):
    old, new = (courier(file_store, tmp_path, text) for text in ("old", "new"))
    batch = ended(file_store, new, old, scenario=delivery(file_store, tmp_path))
    run, gate = run_of(file_store), document({"noWorseThan": {"applicationVersion": "1", "margin": 0.06}})
    assert judge(ParsedRun(gate, ".", file_store, run), batch)[0].status == "PASS"
    assert shippable(batch, file_store, run) == {"courier": new.digest}
    assert evidence_changes(new.digest, file_store, run) == []
    assert "the evidence of" in evidence_changes(old.digest, file_store, run)[0]


def test_the_results_that_were_compared_with_are_held_against_the_evidence_too(file_store: Store, tmp_path: Path):
    scenario = delivery(file_store, tmp_path)
    old, new = (courier(file_store, tmp_path, text) for text in ("old", "new"))
    before = ended(file_store, old, scenario=scenario, name="before")
    batch = ended(file_store, new, scenario=scenario, name="now")
    run, gate = run_of(file_store), document({"noWorseThan": {"applicationVersion": "1", "margin": 0.06}})
    assert judge(ParsedRun(gate, ".", file_store, run), batch)[0].status == "PASS"
    evidence = read_evidence(file_store, batch.id)
    assert evidence.baseline
    assert evidence.baseline.sha256 == cast("dict[str, str]", before.detail["sha256s"])["results.parquet"]
    flip(file_store, str(before.detail["results_url"]).removeprefix(file_store.url + "/"))
    (line,) = evidence_changes(new.digest, file_store, run)
    assert f"{before.id}/results.parquet has changed" in line


def test_a_deployment_that_was_under_way_is_withdrawn(shop: Shop):
    token = stage_token(shop.run, "deployment")
    job = submit(shop.store, "deployment-job", {}, token)
    advance(shop.store, "deployment-job", job.id, "InProgress")
    flip(shop.store, world_key("g", "w0"))
    shop.deploy()
    assert read(shop.store, "deployment-job", job_id("deployment-job", token)).status == "Canceled"
    withdraw_deployment(shop.store, "no such token")

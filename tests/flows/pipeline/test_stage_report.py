"""What is told of a run, to the process that ran it and to one that waited for it."""

import io
from collections.abc import Mapping
from pathlib import Path
from typing import cast

import pytest
from pydantic import JsonValue
from rich.console import Console

from flows.cli.terminal import show_report
from flows.pipeline.run_gate import GateAnswer
from flows.pipeline.stage_report import (
    batch_report,
    deployment_report,
    evidence_of,
    gate_report,
    generation_report,
    made_by,
    recorded_report,
    require_an_end,
    run_with_alarm,
    with_alarm,
)
from specs.base import canonical_document, canonical_json
from specs.data.run_report import PipelineReport, StageReport, Verdict
from specs.errors import DocumentError, ObjectCorrupt, StageFailed
from specs.job_kinds import JobKind
from specs.robomaker.failure_codes import JobFailureCode
from tasks.simulate.audit.audit_report import not_run
from tasks.storage.base.keys import bundle_key, contact_sheet_key, world_key
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import JobRecord, advance, submit
from tasks.storage.jobs.runs import stage_token
from tests.factories.judged_batches import courier, delivery, ended
from tests.factories.worlds import apartment


def _ended(
    store: Store,
    kind: JobKind,
    status: str,
    detail: dict[str, JsonValue],
    *,
    failure_code: JobFailureCode = "",
    failure_reason: str = "",
) -> JobRecord:
    record = submit(store, kind, {}, "tok")
    return advance(
        store, kind, record.id, status, detail=detail, failure_code=failure_code, failure_reason=failure_reason
    )


def test_who_waited_is_told_the_report_of_the_run(file_store: Store):
    stage = StageReport(name="gate", arn="", status="PASS", summary="PASS: 9 of 9", seconds=0.5)
    report = PipelineReport(run="run-1", name="nightly", stages=(stage,), verdict="PASS")
    run = _ended(file_store, "pipeline-run", "Completed", {"report": report.model_dump(mode="json")})
    assert recorded_report(run) == report


def test_who_waited_for_a_refused_document_is_refused_too(file_store: Store):
    run = _ended(file_store, "pipeline-run", "Failed", {"refused": True}, failure_reason="no such fleet")
    with pytest.raises(DocumentError, match="no such fleet"):
        recorded_report(run)


def test_who_waited_for_a_stage_that_failed_is_told_its_code(file_store: Store):
    run = _ended(file_store, "pipeline-run", "Failed", {}, failure_code="AccessDenied", failure_reason="read-only")
    with pytest.raises(StageFailed, match="AccessDenied: read-only"):
        recorded_report(run)


def test_a_partial_generation_says_how_many_worlds_failed(file_store: Store):
    failures: dict[str, JsonValue] = {"InvalidInput": {"count": 2, "sample_reason": "too small"}}
    record = _ended(file_store, "world-generation-job", "PartialFailed", {"worlds": ["g/a"], "failures": failures})
    assert generation_report(record, file_store, 1.0).summary == "1 world, 2 failed"


def test_worlds_tell_which_wishes_they_do_not_fulfil_and_where_the_sheet_is(file_store: Store):
    worlds: list[JsonValue] = []
    for name in ("a", "b"):
        world = apartment(generation="g", name=name, unmet=("Sofa: 0, wished 1",))
        file_store.create(world_key("g", name), canonical_json(canonical_document(world)))
        worlds.append(f"g/{name}")
    record = _ended(file_store, "world-generation-job", "Completed", {"worlds": worlds})
    file_store.create(contact_sheet_key(record.id), b"<svg/>")
    stage = generation_report(record, file_store, 1.0)
    assert stage.summary.startswith("2 worlds; 2 wishes not fulfilled: Sofa: 0, wished 1")
    assert stage.artefacts[1].url == f"{file_store.url}/{contact_sheet_key(record.id)}"
    console = Console(file=io.StringIO(), width=200, record=True)
    show_report(PipelineReport(run="run-1", name="worlds", stages=(stage,)), console)
    assert "Done, but wishes of the template that its worlds do not fulfil: 2;" in console.export_text()


@pytest.mark.parametrize(("radius_m", "fits"), [(0.08, "one of 0.08 m does"), (0.0, "some doors are shut")])
def test_worlds_tell_that_their_doors_as_set_may_keep_a_robot_out(file_store: Store, radius_m: float, fits: str):
    world = apartment(generation="g", name="a")
    shut = world.certificate.model_copy(update={"doors_as_set_robot_radius_m": radius_m})
    world = world.model_copy(update={"certificate": shut})
    file_store.create(world_key("g", "a"), canonical_json(canonical_document(world)))
    record = _ended(file_store, "world-generation-job", "Completed", {"worlds": ["g/a"]})
    summary = generation_report(record, file_store, 1.0).summary
    radius = f"{world.certificate.guaranteed_robot_radius_m:.2f} m"
    assert summary.endswith(f"a robot of {radius} radius may not get into every room of 1 world: {fits}")


def test_a_batch_tells_passes_and_where_its_tables_lie(file_store: Store):
    detail: dict[str, JsonValue] = {
        "passed": 3,
        "episodes": 4,
        "simulated_s": 61.5,
        "worlds_driven": 2,
        "results_url": "file:///r",
        "failures_url": "file:///f",
    }
    stage = batch_report(_ended(file_store, "simulation-job-batch", "Completed", detail), 2.0)
    assert stage.summary.startswith("3 of 4 episodes passed in these 2 worlds, 62 simulated seconds")
    assert [artefact.url for artefact in stage.artefacts] == ["file:///r", "file:///f"]


def test_a_deployment_says_who_runs_what_and_what_stopped_it(file_store: Store):
    progress: dict[str, JsonValue] = {
        "r1": {"status": "InSync"},
        "r2": {"status": "Failed", "step": "Launching", "runs": "courier 1", "started_at_s": 1.0},
    }
    plan: dict[str, JsonValue] = {"application": "courier", "version": 2}
    runs = "1 of 2 robots runs courier 2 (r1), 1 runs courier 1"
    record = _ended(
        file_store,
        "deployment-job",
        "Failed",
        {"progress": progress, "plan": plan},
        failure_code="FailureThresholdBreached",
        failure_reason=f"{runs}; went back to courier 1: r2; 1 of 2 robots failed",
    )
    stage = deployment_report(record, 1.0)
    assert stage.summary == f"{runs}; went back to courier 1: r2; FailureThresholdBreached: 1 of 2 robots failed"
    console = Console(file=io.StringIO(), width=200, record=True)
    show_report(PipelineReport(run="run-1", name="nightly", stages=(stage,), shipped=False), console)
    assert f"The deployment failed: {runs}." in console.export_text()


@pytest.mark.parametrize(
    ("status", "said"),
    [
        ("NoResponse", "Done, and 1 of 2 robots runs courier 2 (r1): as many"),
        ("InSync", "everything that was"),
    ],
)
def test_a_deployment_that_succeeded_without_a_robot_says_so(file_store: Store, status: str, said: str):
    progress: dict[str, JsonValue] = {"r1": {"status": "InSync"}, "r2": {"status": status, "started_at_s": 1.0}}
    plan: dict[str, JsonValue] = {"application": "courier", "version": 2}
    record = _ended(file_store, "deployment-job", "Succeeded", {"progress": progress, "plan": plan})
    stage = deployment_report(record, 1.0)
    console = Console(file=io.StringIO(), width=200, record=True)
    show_report(PipelineReport(run="run-1", name="nightly", stages=(stage,), shipped=True), console)
    shown = console.export_text()
    assert said in shown
    assert ("no answer in time, will take it when back: r2" in stage.summary) == (status == "NoResponse")


@pytest.mark.parametrize(
    ("verdict", "shipped", "passed"),
    [
        ("PASS", True, True),
        ("PASS", None, True),
        (None, True, True),
        ("FAIL", None, False),
        ("INCONCLUSIVE", None, False),
        ("PASS", False, False),
    ],
)
def test_a_run_passed_when_nothing_that_was_asked_for_was_refused(
    *, verdict: Verdict | None, shipped: bool | None, passed: bool
):
    report = PipelineReport(run="run-1", name="nightly", stages=(), verdict=verdict, shipped=shipped)
    assert report.passed is passed


def test_a_batch_tells_all_its_reasons_and_samples_of_the_most_frequent(file_store: Store):
    why: list[JsonValue] = [
        {"reason": "RobotApplicationCrash", "episodes": 8, "sample": "no module go_to_gaol"},
        {"reason": "timeout", "episodes": 2, "sample": ""},
        {"reason": "collision", "episodes": 1, "sample": "of the third"},
    ]
    detail: dict[str, JsonValue] = {
        "passed": 0,
        "episodes": 11,
        "simulated_s": 0.0,
        "results_url": "file:///r",
        "failures_url": "file:///f",
        "why_not": why,
    }
    summary = batch_report(_ended(file_store, "simulation-job-batch", "Completed", detail), 2.0).summary
    assert summary.endswith("; 8 x RobotApplicationCrash: no module go_to_gaol; 2 x timeout; 1 x collision")


# Such a run ended with "Done." and exit code 0.
def test_a_batch_without_an_episode_that_came_to_its_end_is_a_stage_that_failed(file_store: Store):
    batch = _ended(file_store, "simulation-job-batch", "Completed", {})

    def crashed(*why: JsonValue) -> JobRecord:
        return batch.model_copy(update={"detail": {"passed": 0, "episodes": 11, "why_not": [*why]}})

    most: JsonValue = {"reason": "RobotApplicationCrash", "episodes": 8, "sample": "no module go_to_gaol"}
    with pytest.raises(StageFailed, match=r"RobotApplicationCrash: all 11 .*: no module go_to_gaol"):
        require_an_end(crashed(most, {"reason": "InternalServiceError", "episodes": 3, "sample": ""}))
    require_an_end(crashed(most, {"reason": "timeout", "episodes": 3, "sample": ""}))
    require_an_end(crashed())


@pytest.mark.parametrize(
    ("verdict", "alarms"), [("SOUND", False), ("NOT COMPARED", False), ("SUSPECT", True), ("NOT RUN", True)]
)
def test_an_audit_is_told_and_raises_its_alarm(file_store: Store, *, verdict: str, alarms: bool):
    sentence = not_run("1 of 4 rows").sentence if verdict == "NOT RUN" else "1 of 4 rows"
    detail: dict[str, JsonValue] = {
        "passed": 4,
        "episodes": 4,
        "simulated_s": 61.5,
        "worlds_driven": 2,
        "results_url": "file:///r",
        "audit_url": "file:///a",
        "audit": {"verdict": verdict, "sentence": sentence, "unreproduced": [2]},
    }
    stage = batch_report(_ended(file_store, "simulation-job-batch", "Completed", detail), 2.0)
    assert stage.summary.endswith(f"; audit {verdict}: 1 of 4 rows")
    assert [artefact.label for artefact in stage.artefacts] == ["results", "audit"]
    assert stage.facts["audit"] == detail["audit"]
    console = Console(file=io.StringIO(), width=200)
    show_report(PipelineReport(run="run-1", name="n", stages=(stage,)), console)
    shown = cast("io.StringIO", console.file).getvalue()
    assert (f"The parity audit is {verdict}: 1 of 4 rows" in shown) is alarms


def test_a_second_alarm_stands_beside_the_first_and_none_is_told_twice():
    stage = StageReport(name="gate", arn="", status="PASS", summary="PASS: 9 of 9", seconds=0.5)
    for alarm in ("no page", "no picture", "no page"):
        stage = with_alarm(stage, alarm)
    assert stage.facts["alarm"] == "no page\nno picture"
    report = PipelineReport(run="run-1", name="n", stages=(stage, stage.model_copy(update={"facts": {}})))
    assert run_with_alarm(report, "no picture") == report
    assert run_with_alarm(report, "no disk").stages[1].facts == {"alarm": "no disk"}


@pytest.mark.parametrize(("trust", "alarms"), [("unsigned", 1), ("signed by 0123", 0)])
def test_a_deployment_that_nobody_vouched_for_says_so_in_red(file_store: Store, trust: str, alarms: int):
    stage = deployment_report(_ended(file_store, "deployment-job", "Succeeded", {"trust": trust}), 1.0)
    console = Console(file=io.StringIO(), width=200, record=True)
    show_report(PipelineReport(run="run-1", name="nightly", stages=(stage,), verdict="PASS"), console)
    assert console.export_text().count("UNSIGNED: nobody's key vouches for this deployment") == alarms
    assert stage.summary.endswith("UNSIGNED") == bool(alarms)


def test_what_came_of_a_stage_is_shown_as_it_is():
    stage = StageReport(name="gate", arn="", status="FAIL", summary="KeyError: box[bold]", seconds=0.5)
    console = Console(file=io.StringIO(), width=200)
    show_report(PipelineReport(run="run-1", name="nightly", stages=(stage,), verdict="FAIL"), console)
    assert "KeyError: box[bold]" in cast("io.StringIO", console.file).getvalue()


def test_the_gates_verdict_is_told_once():
    report = gate_report("FAIL", "FAIL: of 2 rules, 1 says FAIL, 1 says PASS\nFAIL: few\nPASS: none", "file:///e", 0.5)
    assert report.summary == "of 2 rules, 1 says FAIL, 1 says PASS\nFAIL: few\nPASS: none"


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


@pytest.mark.parametrize(
    "change",
    [
        {"stopped_early": {}},
        {"stopped_early": {"episodes": 3}},
        {"stopped_early": "early"},
        {"audit": {"verdict": "SOUND"}},
        {"why_not": [{}]},
        {"rooms": {"worlds": "many"}},
        {"simulated_s": "long"},
    ],
)
def test_a_record_that_somebody_else_has_written_is_named_as_that(file_store: Store, change: dict[str, JsonValue]):
    detail: dict[str, JsonValue] = {"passed": 3, "episodes": 4, "simulated_s": 61.5, "worlds_driven": 2, **change}
    record = _ended(file_store, "simulation-job-batch", "Completed", detail)
    with pytest.raises(ObjectCorrupt, match="was not written by this version of Simyard") as caught:
        batch_report(record, 2.0)
    assert record.arn in str(caught.value)


def test_a_path_in_a_summary_is_folded_and_not_cut():
    path = "/" + "a-log-of-a-robot" * 6
    console = Console(file=io.StringIO(), width=80)
    stage = StageReport(name="deployment", arn="", status="Failed", summary=f"its output is in {path}", seconds=0.5)
    show_report(PipelineReport(run="run-1", name="n", stages=(stage,)), console)
    rows = cast("io.StringIO", console.file).getvalue().splitlines()
    assert path in "".join(row.split("│")[3].strip() for row in rows if row.startswith("│"))

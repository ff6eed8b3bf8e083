"""JUnit files, read back by a JUnit parser and held against a schema: whatever a run was, and whoever named it."""

from functools import cache
from typing import TYPE_CHECKING
from xml.etree import ElementTree as ET

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from junitparser import Error, Failure, JUnitXml, Skipped, TestCase

from tasks.results.ci.full_report import FullReport, RunFailure
from tasks.results.ci.junit import junit_xml
from tasks.results.ci.seed_groups import GroupRules
from tests.factories.episodes import canceled, crashed, passed, request
from tests.repository import ROOT
from tests.results.ci.full_reports import HOSTILE, counted, failed_report, full_report, rule, stage
from tests.results.estimands import intervals, without_estimand

if TYPE_CHECKING:
    from xmlschema import XMLSchema


@cache
def _schema() -> "XMLSchema":
    import xmlschema  # noqa: PLC0415 - slow to import, for this module alone

    return xmlschema.XMLSchema(str(ROOT / "tests/data/junit.xsd"))


def _parsed(report: FullReport) -> dict[str, dict[str, TestCase]]:
    """Returns the cases by suite and name, having checked the file."""
    body = junit_xml(report)
    root = ET.fromstring(body)  # noqa: S314 - our own document
    _schema().validate(root)
    _check_counts(root)
    return {str(suite.name): {str(case.name): case for case in suite} for suite in JUnitXml.fromstring(body)}


def _check_counts(root: ET.Element) -> None:
    for each in (root, *root.iter("testsuite")):
        cases = list(each.iter("testcase"))
        found = {
            "tests": len(cases),
            **{
                name: sum(case.find(kind) is not None for case in cases)
                for name, kind in (("failures", "failure"), ("errors", "error"), ("skipped", "skipped"))
            },
        }
        assert {name: int(each.get(name, "-1")) for name in found} == found
        assert float(each.get("time", "-1")) == pytest.approx(sum(float(case.get("time", "nan")) for case in cases))


def test_a_world_is_a_suite_and_a_group_of_episodes_a_case():
    suites = _parsed(full_report())
    assert list(suites) == ["run", "gate", "world-1-1", "world-2-1"]
    (case,) = suites["world-1-1"].values()
    assert case.name == "courier go_to_goal in delivery rooms, MAX_SPEED=0.3"
    assert case.classname == "nightly.world-1-1"


def test_a_failed_case_has_counts_reasons_and_replay_commands():
    case = _parsed(full_report())["world-2-1"]["courier go_to_goal in delivery rooms, MAX_SPEED=0.6"]
    (said,) = case.result
    assert isinstance(said, Error)
    assert said.message == "0 of 4 episodes passed: 2 x RobotApplicationCrash, 2 x collision"
    assert "simyard replay arn:simyard:simulation-job:0123456789ab:simb-1/" in (said.text or "")


def test_a_case_says_of_which_world_its_rate_is_and_how_many_intervals_there_are():
    text = junit_xml(full_report()).decode().replace("\u00a0", " ")
    together = "2 intervals of groups; all 2 hold together in 95 % of such batches"
    assert f"6 of 6 episodes passed: 100.0 % in this 1 world (interval 48.1 to 100.0 %; {together})" in text
    assert "by itself: 95 % interval 60.9 to 100.0 % in this 1 world" in text
    assert intervals(text) == 4
    assert without_estimand(text.replace("\n", "\n\n")) == []


def test_code_that_failed_is_an_error_and_an_episode_that_did_not_pass_a_failure():
    results = [
        type(each) for suite in _parsed(full_report()).values() for case in suite.values() for each in case.result
    ]
    assert results == [Failure, Failure, Error]


def test_rules_are_cases_and_inconclusive_is_a_failure_that_says_so():
    gate = _parsed(full_report())["gate"]
    assert {name: (case.result[0].type, case.result[0].message) for name, case in gate.items()} == {
        "successRate": ("FAIL", "FAIL: 5 of 10 episodes passed"),
        "collisionRate": ("INCONCLUSIVE", "INCONCLUSIVE: 5 of 10 episodes passed"),
    }


def test_a_run_that_passed_has_no_failure_and_no_error():
    asked, results = [request(0), request(1, seed=1)], [passed(0), crashed(1)]
    gate = full_report().gate
    assert gate
    report = full_report(
        answer="PASSED",
        verdict="PASS",
        gate=gate.model_copy(update={"verdict": "PASS", "rules": (rule("PASS"),)}),
        batch=counted(asked, results, GroupRules(verdict="PASS", bar=0.9)),
    )
    suites = _parsed(report)
    assert [each for suite in suites.values() for case in suite.values() for each in case.result] == []
    (case,) = suites["world-1-1"].values()
    assert "the gate is about all episodes together" in (case.system_out or "")
    assert "simyard replay" in (case.system_out or "")


def test_a_stage_that_failed_is_an_error_after_those_that_ended():
    run = _parsed(failed_report())["run"]
    assert [(name, [type(each) for each in case.result]) for name, case in run.items()] == [
        ("worldGeneration", []),
        ("worldExport", [Error]),
    ]


def test_a_deployment_that_was_skipped_is_skipped_and_one_that_failed_a_failure():
    stages = (stage(name="deployment", status="Skipped"), stage(name="worldExport", status="Failed"))
    run = _parsed(full_report(stages=stages))["run"]
    assert [type(each) for case in run.values() for each in case.result] == [Skipped, Failure]


def test_a_canceled_group_is_skipped():
    (case,) = _parsed(full_report(batch=counted([request(0)], [canceled(0)])))["world-1-1"].values()
    assert [type(each) for each in case.result] == [Skipped]


def test_what_could_not_be_read_is_an_error():
    run = _parsed(full_report(problems=("the tables are gone",)))["run"]
    assert run["report"].result[0].message == "the tables are gone"


def test_groups_that_are_not_listed_are_a_failed_case_if_one_of_them_failed():
    batch = counted().model_copy(update={"left_out": 7, "left_out_failed": 2})
    (case,) = _parsed(full_report(batch=batch))["other worlds"].values()
    assert case.result[0].message == "2 of 7 groups more are not as they should be"


@settings(max_examples=20)
@example(HOSTILE)
@given(st.text())
def test_no_text_breaks_it(text: str):
    worlds = [request(0, world=f"g/{text or 'w'}")]
    explained = [crashed(0).model_copy(update={"failure_reason": text})]
    failure = RunFailure(code="InternalServiceError", reason=text, arn=text)
    gate = full_report().gate
    assert gate
    report = full_report(
        document=text or "d",
        batch=counted(worlds, explained),
        gate=gate.model_copy(update={"rules": (rule("FAIL", sentence=text),)}),
        stages=(stage(summary=text, facts={"alarm": text}),),
        failure=failure,
        problems=(text,),
    )
    assert len(JUnitXml.fromstring(junit_xml(report))) == 3


def test_the_same_report_gives_the_same_bytes():
    assert junit_xml(full_report()) == junit_xml(full_report())


def test_a_stage_that_failed_is_one_case():
    failed = failed_report()
    ended = stage(name="worldExport", status="Failed")
    body = junit_xml(failed.model_copy(update={"stages": (*failed.stages, ended)}))
    assert body.count(b'<testcase name="worldExport"') == 1

"""Annotations as GitHub's runner reads them: as many as it shows, and no order but the ones that were meant."""

import re

from hypothesis import example, given, settings
from hypothesis import strategies as st

from tasks.results.ci.github import Annotation, workflow_command, workflow_commands
from tests.factories.episodes import collided, request
from tests.results.ci.full_reports import HOSTILE, counted, failed_report, full_report, rule, stage


def _read(line: str) -> tuple[str, dict[str, str], str]:
    """Returns command, properties and message of a line, as the runner takes it apart (ActionCommand.cs)."""
    found = re.fullmatch(r"::(\w+)(?: ([^:]*))?::(.*)", line)
    assert found, line
    pairs = [part.partition("=") for part in (found[2] or "").split(",") if part]
    return found[1], {name: _unescaped(value) for name, _, value in pairs}, _unescaped(found[3])


def _unescaped(text: str) -> str:
    for escape, sign in (("%2C", ","), ("%3A", ":"), ("%0A", "\n"), ("%0D", "\r"), ("%25", "%")):
        text = text.replace(escape, sign)
    return text


def test_a_rule_that_fails_is_an_error_and_an_inconclusive_one_a_warning():
    found = [_read(line) for line in workflow_commands(full_report(), "documents/nightly.yaml")]
    assert [(command, parts["title"]) for command, parts, _ in found[:2]] == [
        ("error", "nightly: successRate"),
        ("warning", "nightly: collisionRate"),
    ]
    assert {parts["file"] for _, parts, _ in found} == {"documents/nightly.yaml"}


def test_a_failed_group_is_a_warning_with_its_replay_command():
    *_, (command, parts, message) = [_read(line) for line in workflow_commands(full_report(), "")]
    assert (command, parts["title"]) == (
        "warning",
        "world-2-1: courier go_to_goal in delivery rooms, MAX_SPEED=0.6",
    )
    assert message.startswith("0 of 4 episodes passed: 2 x RobotApplicationCrash, 2 x collision; simyard replay arn:")


def test_a_stage_that_failed_is_an_error():
    (found,) = [_read(line) for line in workflow_commands(failed_report(), "")]
    assert found == ("error", {"title": "nightly: worldExport"}, "nobody answers")


def test_there_are_no_more_of_a_kind_than_github_shows():
    asked = [request(index, world=f"g/{index}") for index in range(30)]
    rules = tuple(rule("FAIL", f"quantiles[{number}]") for number in range(30))
    gate = full_report().gate
    assert gate
    report = full_report(
        gate=gate.model_copy(update={"rules": rules}),
        batch=counted(asked, [collided(index) for index in range(30)]),
        stages=(stage(facts={"alarm": "look"}),),
    )
    lines = workflow_commands(report, "")
    assert [sum(line.startswith(f"::{kind} ") for line in lines) for kind in ("error", "warning")] == [10, 10]
    assert "21 more" in lines[9]


@settings(max_examples=50)
@example(HOSTILE, HOSTILE, HOSTILE)
@given(st.text(), st.text(), st.text())
def test_no_text_makes_another_command(title: str, message: str, file: str):
    line = workflow_command(Annotation("error", title, message), file)
    assert len(line.splitlines()) == 1
    command, parts, _ = _read(line)
    assert command == "error"
    assert set(parts) <= {"file", "line", "title"}


def test_a_percent_sign_is_not_read_as_the_end_of_a_line():
    assert workflow_command(Annotation("error", "a", "b%0A::error::c")) == "::error title=a::b%250A::error::c"

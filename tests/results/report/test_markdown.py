"""The report in short: what Prefect's pages show, and no name that becomes markup there."""

from pathlib import Path

from specs.untrusted_text import escape_markdown
from tasks.results.report.batch_facts import Judgement
from tasks.results.report.report_page import report_markdown
from tests.factories.episodes import crashed, passed, request
from tests.factories.reports import view
from tests.results.estimands import intervals, without_estimand

URL = "file:///tmp/report.html"


def test_it_begins_with_the_verdict_and_ends_with_where_the_page_is(tmp_path: Path):
    text = report_markdown(view(tmp_path), URL)
    assert text.startswith("# ❌ FAIL\n\nFAIL: too few passed\n\n60.0")
    assert text.endswith(f"Report: {URL}")


def test_every_line_of_its_table_has_as_many_cells(tmp_path: Path):
    lines = [line for line in report_markdown(view(tmp_path), URL).splitlines() if line.startswith("|")]
    assert len(lines) > 5
    assert {line.count(" | ") for line in lines} == {4}


def test_it_says_when_nobody_judged_and_when_nothing_failed(tmp_path: Path):
    text = report_markdown(view(tmp_path, [], [], judgement=None), URL)
    assert "# Not judged" in text
    assert "No failures." in text


def test_it_warns_of_rooms_that_the_robot_was_kept_out_of(tmp_path: Path):
    known = {"rooms_entered": ("Hall", "Attic"), "rooms_unreachable": ("<b>",), "rooms_total": 3}
    kept_out = passed(0).model_copy(update=known)
    text = report_markdown(view(tmp_path, [request(0)], [kept_out]), URL)
    assert "Rooms entered: 2 of 3." in text
    assert "- ⚠️ The robot cannot get to 1 of 3 rooms" in text
    assert "<b>" not in text


def test_no_name_becomes_markup(tmp_path: Path):
    evil = "<b>|[x](y)`\n# z"
    failed = crashed(0).model_copy(update={"failure_code": evil})
    text = report_markdown(view(tmp_path, [request(0)], [failed], name=evil), URL)
    assert "<b>" not in text
    assert "[x](y)" not in text
    assert "\n# z" not in text
    assert escape_markdown("a_b | c") == "a\\_b \\| c"


def test_several_rules_are_a_list_under_what_they_come_to(tmp_path: Path):
    told = Judgement(verdict="FAIL", sentence="FAIL: of 2 rules\nFAIL: few\nPASS: none", at_least=0.9, confidence=0.95)
    text = report_markdown(view(tmp_path, judgement=told), URL)
    assert text.startswith("# ❌ FAIL\n\nFAIL: of 2 rules\n- FAIL: few\n- PASS: none\n\n60.0")


def test_it_says_how_many_intervals_it_shows_and_of_which_worlds_each_is(tmp_path: Path):
    text = report_markdown(view(tmp_path), URL)
    assert "4 intervals of groups; all 4 hold together in 95 % of such reports" in text
    assert intervals(text) == 4 + 3
    assert without_estimand(text) == []

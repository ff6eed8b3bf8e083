"""Outcome reasons: one table has them all, with the codes that scenarios return and a mark to draw each with."""

from typing import get_args

from specs.data.outcomes import MARKS, OTHER_MARK, OUTCOME_REASONS, REASON_CODES, OutcomeReason, mark_of
from tests.repository import ROOT


def test_the_table_has_every_reason_that_a_result_may_have():
    assert get_args(OutcomeReason) == REASON_CODES


def test_every_reason_says_what_happened():
    assert all(reason.meaning.endswith(".") for reason in OUTCOME_REASONS)


def test_the_codes_that_a_scenario_may_return_are_documented():
    told = " ".join((ROOT / "docs/guide/applications.md").read_text().split())
    codes = [f"{code} {name}" for code, name in enumerate(REASON_CODES) if name not in {"", "crash"}]
    assert f"0 done and passed, {', '.join(codes)}." in told


def test_what_is_no_outcome_is_drawn_with_the_mark_for_anything_else():
    assert mark_of("RobotApplicationCrash") == mark_of("crash") == MARKS[-1] == OTHER_MARK
    assert mark_of("stuck").name == "stuck"

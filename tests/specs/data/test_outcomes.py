"""How an episode ended: reasons, marks and tags."""

from typing import get_args

from specs.data.episode import unfinished_result
from specs.data.outcomes import (
    MARKS,
    MOST_OWN_TAGS,
    OTHER_MARK,
    OUTCOME,
    OUTCOME_REASONS,
    REASON,
    REASON_CODES,
    OutcomeReason,
    failed_tags,
    is_reserved,
    mark_of,
    outcome_tags,
    with_outcome,
)
from tests.factories.episodes import collided, crashed, passed
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


def test_a_job_that_did_not_pass_says_failed_and_why():
    assert outcome_tags(passed(0)) == {OUTCOME: "Passed"}
    assert outcome_tags(collided(0)) == {OUTCOME: "Failed", REASON: "collision"}
    assert outcome_tags(crashed(0)) == {OUTCOME: "Failed", REASON: "RobotApplicationCrash"}


def test_a_cancelled_job_has_no_outcome():
    assert outcome_tags(unfinished_result(0, "Canceled", failure_code="", failure_reason="")) == {}


def test_a_resource_has_no_more_tags_than_robomakers():
    own = {f"t{number:02}": "" for number in range(50)}
    told = with_outcome(own, failed_tags("crash"))
    assert len(told) == 50
    assert told[OUTCOME] == "Failed"
    assert len(with_outcome(dict([*own.items()][:MOST_OWN_TAGS]), failed_tags("crash"))) == MOST_OWN_TAGS + 2


def test_the_outcome_wins_over_a_tag_of_the_same_key():
    assert with_outcome({OUTCOME: "Passed", "a": "b"}, failed_tags("crash"))[OUTCOME] == "Failed"


def test_simyards_own_keys_are_reserved_however_they_are_written():
    assert [is_reserved(key) for key in (OUTCOME, "Simyard:x", "simyard", "my:simyard:x")] == [True, True, False, False]

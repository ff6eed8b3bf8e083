"""The outcome of a simulation job as tags."""

from specs.data.episode import unfinished_result
from specs.data.outcomes import MOST_OWN_TAGS, OUTCOME, REASON, failed_tags, is_reserved, outcome_tags, with_outcome
from tests.factories.episodes import collided, crashed, passed


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

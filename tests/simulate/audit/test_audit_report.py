"""What an audit says of its numbers: when it is alarmed, and that it never passes for more than it is."""

import pytest

from tasks.simulate.audit.audit_report import (
    ApartQuantiles,
    AuditFlipRate,
    AuditReport,
    AuditVerdict,
    not_run,
    with_verdict,
)

WAY = ApartQuantiles(median_m=1e-6, p90_m=3e-6, max_m=1e-5)


def report(**changes: object) -> AuditReport:
    base = AuditReport(
        verdict="NOT RUN", sentence="", lanes=16, compared=16, way=WAY, spread=AuditFlipRate(lanes=16, flips=0)
    )
    return with_verdict(base.model_copy(update=changes))


@pytest.mark.parametrize(
    ("changes", "verdict"),
    [
        ({}, "SOUND"),
        ({"spread": AuditFlipRate(lanes=16, flips=1)}, "SOUND"),
        ({"spread": AuditFlipRate(lanes=16, flips=2)}, "SUSPECT"),
        ({"spread": AuditFlipRate(lanes=4, flips=1)}, "SOUND"),
        ({"spread": AuditFlipRate(lanes=4, flips=2)}, "SUSPECT"),
        ({"failed": AuditFlipRate(lanes=1, flips=1)}, "SOUND"),
        ({"unflipped": ApartQuantiles(median_m=1e-6, p90_m=0.06, max_m=0.07)}, "SUSPECT"),
        ({"unflipped": ApartQuantiles(median_m=1e-6, p90_m=0.04, max_m=9.0)}, "SOUND"),
        ({"way": ApartQuantiles(median_m=1e-6, p90_m=3.0, max_m=9.0)}, "SOUND"),
        ({"compared": 8}, "SOUND"),
        ({"compared": 7}, "NOT COMPARED"),
        ({"compared": 7, "spread": AuditFlipRate(lanes=7, flips=2)}, "SUSPECT"),
        ({"sampled": 33}, "NOT COMPARED"),
        ({"failed": AuditFlipRate(lanes=8, flips=2)}, "SOUND"),
        ({"failed": AuditFlipRate(lanes=8, flips=3)}, "SUSPECT"),
        ({"unreproduced": (7,)}, "SUSPECT"),
        ({"ros": 16, "unlocked": (3,)}, "SOUND"),
        ({"ros": 16, "unlocked": (3,), "unreproduced": (3,)}, "SUSPECT"),
        ({"compared": 0}, "NOT COMPARED"),
        ({"compared": 0, "unreproduced": (7,)}, "SUSPECT"),
    ],
)
def test_alarm_is_raised_for_what_is_wrong_and_nothing_is_called_sound_that_was_hardly_compared(
    changes: dict[str, object], verdict: AuditVerdict
):
    assert report(**changes).verdict == verdict


def test_the_sentence_has_the_numbers():
    found = report(spread=AuditFlipRate(lanes=10, flips=1), failed=AuditFlipRate(lanes=6, flips=1))
    assert found.sentence == "16 lanes on C MuJoCo: 1 of 10 outcomes flipped, 1 of 6 failed ones, p90 3e-06 m apart"
    alarmed = report(unreproduced=(3, 9))
    assert alarmed.sentence.startswith("2 of 16 rows are not what their engine makes of them (3, 9); ")
    apart = report(unflipped=ApartQuantiles(median_m=0.1, p90_m=0.25, max_m=0.3))
    assert apart.sentence.startswith("robots with the same outcome are apart from C MuJoCo's by 0.25 m (p90); ")
    assert report(compared=4).sentence.endswith("; no more than 4 of the 16 drawn could be compared")


def test_episodes_without_lock_step_are_named_even_if_their_rows_are_the_same():
    sentence = report(compared=0, ros=6, unlocked=(3, 9)).sentence
    assert sentence == (
        "lock-step did not hold in 2 of 6 episodes (3, 9): they may differ another time; "
        "16 of 16 rows were the same when driven again; not compared"
    )


def test_a_comparison_of_an_engine_with_itself_is_none():
    found = with_verdict(AuditReport(verdict="NOT RUN", sentence="", lanes=4), "the rows were made by mujoco")
    assert (found.verdict, found.sentence) == (
        "NOT COMPARED",
        "4 of 4 rows were the same when driven again; not compared: the rows were made by mujoco",
    )


def test_what_could_not_be_audited_says_why_in_a_line():
    assert not_run("out of memory:\n 9 GB").sentence == "not run: out of memory: 9 GB"


def test_a_rate_of_no_lanes_is_no_rate():
    assert AuditFlipRate(lanes=0, flips=0).rate is None
    assert not AuditFlipRate(lanes=0, flips=0).exceeds(0.01)
    assert AuditFlipRate(lanes=8, flips=2).rate == 0.25

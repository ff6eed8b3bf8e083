"""What an audit says of its numbers: when it is alarmed, and that it never passes for more than it is."""

import json

import pytest

from tasks.simulate.audit.audit_report import (
    FAILED_FLIP_LIMIT,
    FLIP_LIMIT,
    ApartQuantiles,
    AuditControl,
    AuditReport,
    AuditVerdict,
    Flip,
    FlipShare,
    exceeds,
    needs_control,
    not_run,
    with_verdict,
)

WAY = ApartQuantiles(median_m=1e-6, p90_m=3e-6, max_m=1e-5)
FAR = ApartQuantiles(median_m=1e-6, p90_m=0.06, max_m=0.07)


def share(flips: int, lanes: int, chaotic: int = 0, chance: float | None = 0.01) -> FlipShare:
    return FlipShare(lanes=lanes, flips=flips, chaotic=chaotic, lower=0.01, upper=0.2, chance=chance)


def control(calm: int = 20, parted: int = 0) -> AuditControl:
    found = AuditControl(lanes=32, drives=2, flips=0, rate=0.0, lower=0.0, upper=0.1, way=WAY)
    return found.model_copy(update={"calm": calm, "parted": parted})


def report(**changes: object) -> AuditReport:
    base = AuditReport(verdict="NOT RUN", sentence="", lanes=32, compared=32, way=WAY, false_passes=share(0, 24))
    return with_verdict(base.model_copy(update=changes))


@pytest.mark.parametrize(
    ("changes", "verdict"),
    [
        ({}, "SOUND"),
        ({"false_passes": share(1, 24)}, "SOUND"),
        ({"false_passes": share(2, 24)}, "SUSPECT"),
        ({"false_passes": share(2, 24, chance=None)}, "SUSPECT"),
        ({"false_passes": share(2, 24, chaotic=1)}, "SOUND"),
        ({"false_passes": share(2, 24, chance=0.2)}, "SOUND"),
        ({"false_passes": share(2, 192)}, "SOUND"),
        ({"missed_contacts": share(2, 24)}, "SUSPECT"),
        ({"false_alarms": share(2, 8)}, "SOUND"),
        ({"false_alarms": share(3, 8)}, "SUSPECT"),
        ({"false_alarms": share(8, 8, chance=0.3)}, "SOUND"),
        ({"unflipped": FAR}, "SUSPECT"),
        ({"unflipped": FAR, "control": control()}, "SOUND"),
        ({"unflipped": FAR, "control": control(20, 2)}, "SUSPECT"),
        ({"unflipped": FAR, "control": control(21, 2)}, "SOUND"),
        ({"unflipped": FAR, "control": control(3, 1)}, "SOUND"),
        ({"unflipped": FAR, "control": control(0)}, "SOUND"),
        ({"unflipped": ApartQuantiles(median_m=1e-6, p90_m=0.04, max_m=9.0)}, "SOUND"),
        ({"way": ApartQuantiles(median_m=1e-6, p90_m=3.0, max_m=9.0)}, "SOUND"),
        ({"compared": 16}, "SOUND"),
        ({"compared": 15}, "NOT COMPARED"),
        ({"compared": 15, "false_passes": share(2, 15)}, "SUSPECT"),
        ({"sampled": 65}, "NOT COMPARED"),
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


@pytest.mark.parametrize(
    ("flips", "lanes", "limit"), [(2, 24, FLIP_LIMIT), (2, 32, FLIP_LIMIT), (3, 8, FAILED_FLIP_LIMIT)]
)
def test_an_alarm_needs_more_flips_than_chance_gives(flips: int, lanes: int, limit: float):
    assert exceeds(share(flips, lanes), limit)
    assert not exceeds(share(flips - 1, lanes), limit)
    assert not exceeds(share(flips, lanes, chaotic=1), limit)


def test_a_control_is_made_where_something_has_to_be_explained():
    flip = Flip(index=1, row="Passed", reference="collision")
    assert not needs_control(report())
    assert not needs_control(report(others=(flip,)))
    assert needs_control(report(flips=(flip,)))
    assert needs_control(report(missed_contacts=share(1, 32)))
    assert needs_control(report(unflipped=FAR))


def test_the_sentence_has_the_numbers():
    flip = Flip(index=1, row="Passed", reference="collision", chaotic=True)
    found = report(false_passes=share(1, 24, 1), false_alarms=share(0, 8), flips=(flip,), control=control())
    assert found.sentence == (
        "32 lanes on C MuJoCo: 1 of 24 passes fail there (1.0 to 20.0 %), 0 of 8 failures pass there (1.0 to 20.0 %); "
        "1 of 1 flips is of a lane that C MuJoCo itself flips; p90 3e-06 m apart"
    )
    alarmed = report(unreproduced=(3, 9))
    assert alarmed.sentence.startswith("2 of 32 rows are not what their engine makes of them (3, 9); ")
    apart = report(unflipped=ApartQuantiles(median_m=0.1, p90_m=0.25, max_m=0.3))
    assert apart.sentence.startswith("robots with the same outcome are apart from C MuJoCo's by 0.25 m (p90); ")
    assert report(compared=4).sentence.endswith("; no more than 4 of the 32 drawn could be compared")
    passing = report(false_passes=share(2, 24)).sentence
    assert passing.startswith("episodes pass that fail on C MuJoCo, more often than a micrometre explains; ")


def test_episodes_without_lock_step_are_named_even_if_their_rows_are_the_same():
    sentence = report(compared=0, ros=6, unlocked=(3, 9)).sentence
    assert sentence == (
        "lock-step did not hold in 2 of 6 episodes (3, 9): they may differ another time; "
        "32 of 32 rows were the same when driven again; not compared"
    )


def test_a_comparison_of_an_engine_with_itself_is_none():
    found = with_verdict(AuditReport(verdict="NOT RUN", sentence="", lanes=4), "the rows were made by mujoco")
    assert (found.verdict, found.sentence) == (
        "NOT COMPARED",
        "4 of 4 rows were the same when driven again; not compared: the rows were made by mujoco",
    )


def test_what_could_not_be_audited_says_why_in_a_line():
    assert not_run("out of memory:\n 9 GB").sentence == "not run: out of memory: 9 GB"


def test_a_report_of_an_older_version_is_still_one():
    old = {
        "verdict": "SOUND",
        "sentence": "16 lanes on C MuJoCo: 0 of 15 outcomes flipped",
        "lanes": 16,
        "compared": 16,
        "spread": {"lanes": 15, "flips": 0},
        "failed": {"lanes": 1, "flips": 0},
        "flips": [{"index": 3, "row": "timeout", "reference": "collision"}],
    }
    found = AuditReport.model_validate_json(json.dumps(old))
    assert found.spread
    assert (found.spread.lanes, found.flips[0].chaotic, found.false_passes.lanes) == (15, None, 0)

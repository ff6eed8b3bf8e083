"""Estimates of an audit: weighted by what lanes stand for, exact where there is a formula, and chaos is not error."""

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from specs.data.parity_audit import ApartQuantiles, AuditControl, AuditReport, AuditVerdict, Flip, FlipShare
from tasks.simulate.audit.audit_report import (
    FAILED_FLIP_LIMIT,
    FLIP_LIMIT,
    ComparedLane,
    Ending,
    chance_of,
    exceeds,
    flip_share,
    needs_control,
    not_run,
    own_rate,
    share_bounds,
    total_share,
    with_verdict,
)

PASS, FAIL = Ending(passed=True, touched=False), Ending(passed=False, touched=True)


def passed(ending: Ending) -> bool:
    return ending.passed


def failed(ending: Ending) -> bool:
    return not ending.passed


def lane(row: Ending, reference: Ending, *disturbed: Ending, weight: float = 1.0) -> ComparedLane:
    return ComparedLane(0, weight, row, reference, disturbed)


def test_a_flip_that_c_mujoco_makes_by_itself_is_chaotic():
    lanes = [lane(PASS, PASS, PASS, PASS), lane(PASS, FAIL, FAIL, PASS), lane(PASS, FAIL, FAIL, FAIL)]
    found = flip_share(lanes, passed)
    assert (found.lanes, found.flips, found.chaotic, found.unexplained) == (3, 2, 1, 1)
    assert found.rate == pytest.approx(2 / 3)
    assert found.beyond == pytest.approx(1 / 3)


def test_directions_are_counted_apart():
    lanes = [lane(PASS, FAIL), lane(FAIL, PASS), lane(FAIL, PASS), lane(FAIL, FAIL)]
    assert flip_share(lanes, passed).text() == "1 of 1"
    assert flip_share(lanes, failed).text() == "2 of 3"
    assert flip_share(lanes, passed).chance is None


@pytest.mark.parametrize(("flips", "lanes", "lower", "upper"), [(0, 24, 0.0, 0.142473), (1, 10, 0.002529, 0.445016)])
def test_equal_weights_give_the_exact_interval(flips: int, lanes: int, lower: float, upper: float):
    assert share_bounds(flips / lanes, lanes, 0.95) == pytest.approx((lower, upper), abs=1e-6)


def test_unequal_weights_count_for_fewer_lanes():
    lanes = [lane(PASS, PASS, weight=weight) for weight in (1.0, 1.0, 1.0, 9.0)]
    assert flip_share(lanes, passed).effective == pytest.approx(144 / 84)


def test_the_total_weights_strata_by_their_episodes():
    strata = [
        flip_share([lane(PASS, PASS, weight=30.0)] * 12, passed),
        flip_share([lane(FAIL, PASS, weight=2.0), lane(FAIL, FAIL, weight=2.0)], failed),
    ]
    found = total_share(strata)
    assert found.rate == pytest.approx(2 / 364)
    assert found.lower < 2 / 364 < found.upper < strata[0].upper + 4 / 364


def test_of_nothing_nothing_is_said():
    assert (flip_share([], passed).rate, total_share([FlipShare()]).rate, total_share([]).upper) == (None, None, 1.0)


def test_c_mujoco_against_itself_counts_all_pairs():
    lanes = [lane(PASS, PASS, PASS, FAIL, weight=3.0), lane(PASS, PASS, PASS, PASS, weight=1.0)]
    assert own_rate(lanes) == pytest.approx(0.75 * 2 / 3)


def test_an_engine_that_alone_differs_is_not_one_of_them():
    clean = [lane(PASS, FAIL, FAIL, FAIL)]
    steady = [lane(PASS, PASS, PASS, PASS)] * 20
    assert chance_of([*clean, *steady], passed) == pytest.approx(1 / 4)
    assert chance_of([*clean * 3, *steady], passed) == pytest.approx(1 / 64)


def test_chaos_in_other_lanes_explains_a_flip():
    flips = [lane(PASS, FAIL, FAIL, FAIL)] * 2
    chaos = [lane(PASS, FAIL, PASS, PASS), lane(FAIL, PASS, FAIL, PASS), lane(FAIL, PASS, PASS, PASS)]
    assert chance_of([*flips, *chaos * 4], passed) > 0.2 > chance_of(flips, passed)


def test_failures_that_were_drawn_because_they_are_rare_blame_nobody():
    """Of failures that any drive has now and then, nearly all pass when they are driven again."""
    rare = [lane(FAIL, PASS, PASS, PASS, weight=1.0)] * 4
    others = [lane(PASS, PASS, PASS, PASS, weight=40.0)] * 24
    assert chance_of([*rare, *others], failed) > 0.5


@given(st.lists(st.sampled_from(list(itertools.product((PASS, FAIL), repeat=4))), max_size=12))
def test_the_chance_is_a_probability(drives: list[tuple[Ending, ...]]):
    lanes = [lane(*each) for each in drives]
    assert 0.0 <= chance_of(lanes, passed) <= 1.0 + 1e-12


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
    told = report(unreproduced=(3,), differing=("spl", "energy_j")).sentence
    assert told.startswith("1 of 32 rows are not what their engine makes of them (3), in spl, energy_j: simyard replay")
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

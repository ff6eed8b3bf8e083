"""The engine's part in a gate's doubt: none without a reason, joined with the rate's own where there is one."""

import pytest
from pydantic import JsonValue

from specs.pipeline.gate_section import CollisionRate, FlipRate, SuccessRate
from tasks.results.gate.gate_verdict import engine_doubt, with_engine_doubt
from tasks.results.gate.rules.rule import RuleVerdict
from tasks.results.statistics.intervals import wilson

SUCCESS = SuccessRate(atLeast=0.9)
COLLISIONS = CollisionRate(atMost=0.05)


def audit(flips: int, chaotic: int = 0, chance: float | None = 0.03, lanes: int = 24) -> dict[str, JsonValue]:
    share: dict[str, JsonValue] = {
        "lanes": lanes,
        "flips": flips,
        "chaotic": chaotic,
        "episodes": 370.0,
        "effective": float(lanes),
        "beyond": (flips - chaotic) / lanes,
        "chance": chance,
    }
    return {"verdict": "SOUND", "false_passes": share, "missed_contacts": share}


def success(passed: int, n: int = 384) -> RuleVerdict:
    bounds = wilson(passed, n, 0.95)
    sentence = f"PASS: {passed} of {n} episodes passed"
    return RuleVerdict(
        rule="successRate",
        verdict="PASS",
        sentence=sentence,
        estimate=passed / n,
        lower=bounds.lower,
        upper=bounds.upper,
    )


@pytest.mark.parametrize(
    "found",
    [None, {"verdict": "NOT RUN"}, audit(0), audit(2, 2), audit(1, chance=0.4), {"spread": {"lanes": 8, "flips": 2}}],
)
def test_without_a_reason_there_is_no_doubt(found: dict[str, JsonValue] | None):
    assert engine_doubt(found, "false_passes", 0.95) is None
    assert with_engine_doubt(success(380), SUCCESS, found) == success(380)


def test_a_pass_that_fails_on_the_reference_leaves_the_answer_open():
    found = with_engine_doubt(success(380), SUCCESS, audit(2))
    assert found.verdict == "INCONCLUSIVE"
    assert found.lower
    assert found.lower < 0.75
    assert found.upper == success(380).upper
    assert found.sentence == (
        "INCONCLUSIVE: 380 of 384 episodes passed; up to 26.7 points of these passes may be the engine's: "
        "2 of 24 audited passes fail on C MuJoCo, and no micrometre explains it"
    )


def test_an_answer_that_stands_the_doubt_stays_and_says_it():
    found = with_engine_doubt(success(380), SUCCESS, audit(1, lanes=256))
    assert found.verdict == "PASS"
    assert "up to 2.1 points of these passes may be the engine's" in found.sentence
    assert found.facts["engine_doubt"] == pytest.approx(0.0115, abs=1e-4)


def test_more_audited_lanes_make_less_doubt():
    lows = [with_engine_doubt(success(384), SUCCESS, audit(1, lanes=lanes)).lower or 0.0 for lanes in (24, 64, 256)]
    assert lows[0] < lows[1] < lows[2]


def test_doubt_without_a_control_counts():
    assert engine_doubt(audit(1, chance=None), "false_passes", 0.95) is not None


def test_contacts_that_the_engine_missed_raise_the_bound_of_collisions():
    bounds = wilson(0, 384, 0.95)
    answer = RuleVerdict(
        rule="collisionRate", verdict="PASS", sentence="PASS: none", estimate=0.0, lower=0.0, upper=bounds.upper
    )
    found = with_engine_doubt(answer, COLLISIONS, audit(1))
    assert found.upper
    assert found.upper > 0.2
    assert (found.verdict, found.lower) == ("INCONCLUSIVE", 0.0)
    assert "points more may collide on C MuJoCo" in found.sentence


def test_no_other_answer_changes():
    for changed in (
        success(300).model_copy(update={"verdict": "FAIL"}),
        success(300).model_copy(update={"lower": None}),
    ):
        assert with_engine_doubt(changed, SUCCESS, audit(5)) == changed
    assert with_engine_doubt(success(300), FlipRate(atMost=0.1), audit(5)) == success(300)

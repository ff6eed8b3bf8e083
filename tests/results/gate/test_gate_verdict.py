"""The gate: what its rules answer on a batch, at a look before its end, and where the engine is in doubt."""

import pyarrow as pa
import pytest
from hypothesis import given
from hypothesis import strategies as st

from specs.data.parity_audit import AuditReport, AuditVerdict, FlipShare
from specs.data.run_report import Verdict
from specs.pipeline.gate_section import RULES, SEQUENTIAL_RULES, CollisionRate, FlipRate, Gate, SuccessRate
from tasks.results.gate.gate_verdict import (
    GATE_RULES,
    GateVerdict,
    InterimGate,
    columns_needed,
    count_rows,
    engine_doubt,
    judge,
    with_engine_doubt,
)
from tasks.results.gate.rules.rule import Completeness, GateMaterial, RuleVerdict
from tasks.results.gate.version_pairs import PairCounts
from tasks.results.statistics.intervals import wilson
from tasks.results.tables.episode_tables import results_table
from tests.factories.episodes import batch, canceled, collided, counted, crashed, passed, request

GATE = Gate(successRate=SuccessRate(atLeast=0.9, confidence=0.95))
RANK = {"FAIL": 0, "INCONCLUSIVE": 1, "PASS": 2}

few = st.integers(0, 60)
rules = st.builds(SuccessRate, atLeast=st.floats(0, 1, exclude_max=True), confidence=st.floats(0.5, 0.9999))


def gate(**rules: object) -> Gate:
    return Gate.model_validate(rules)


def judged(successes: int, failures: int, cancels: int = 0, *, rule: Gate = GATE, missing: int = 0) -> GateVerdict:
    counts = counted(batch(successes, failures, cancels))
    return judge(rule, GateMaterial(counts, Completeness(canceled=cancels, missing=missing)))


def rows(successes: int, failures: int, crashes: int = 0, **columns: object) -> GateMaterial:
    """Returns a batch of episodes that passed, collided, or whose job failed before it touched anything."""
    kinds = [passed] * successes + [collided] * failures + [crashed] * crashes
    results = [kind(index).model_copy(update=columns) for index, kind in enumerate(kinds)]
    table = results_table("simb-1", [request(index) for index in range(len(kinds))], results)
    return GateMaterial(counted(results), rows=table)


@pytest.mark.parametrize(
    ("successes", "failures", "verdict"),
    [(128, 0, "PASS"), (126, 2, "PASS"), (118, 10, "INCONCLUSIVE"), (10, 0, "INCONCLUSIVE"), (90, 38, "FAIL")],
)
def test_the_interval_decides(successes: int, failures: int, verdict: str):
    assert judged(successes, failures).verdict == verdict


def test_the_sentence_gives_the_numbers():
    assert judged(126, 2).sentence == (
        "PASS: 126 of 128 episodes passed (98.4 %, 95 % interval 94.4 to 99.6 %); at least 90 % asked for"
    )


def test_a_job_whose_robot_crashed_counts_as_not_successful():
    verdict = judge(GATE, rows(50, 0, 50))
    assert verdict.verdict == "FAIL"
    assert (verdict.counts.successes, verdict.counts.failed_jobs) == (50, 50)


def test_a_canceled_episode_makes_a_pass_inconclusive():
    verdict = judged(128, 0, cancels=1)
    assert verdict.verdict == "INCONCLUSIVE"
    assert (verdict.counts.episodes, verdict.counts.canceled) == (128, 1)
    assert verdict.sentence.endswith("; 1 canceled")


def test_a_missing_episode_makes_a_pass_inconclusive():
    assert judged(128, 0, missing=1).verdict == "INCONCLUSIVE"


def test_a_canceled_episode_does_not_excuse_a_failure():
    assert judged(10, 100, cancels=1).verdict == "FAIL"


@pytest.mark.parametrize("cancels", [0, 3])
def test_no_counted_episode_is_inconclusive_whatever_is_asked(cancels: int):
    verdict = judged(0, 0, cancels, rule=gate(successRate={"atLeast": 0.0}))
    assert (verdict.verdict, verdict.rules[0].estimate) == ("INCONCLUSIVE", None)


@given(few, few.filter(bool), few, rules)
def test_one_more_success_never_worsens_the_verdict(successes: int, failures: int, cancels: int, rule: SuccessRate):
    before = judged(successes, failures, cancels, rule=Gate(successRate=rule))
    after = judged(successes + 1, failures - 1, cancels, rule=Gate(successRate=rule))
    assert RANK[after.verdict] >= RANK[before.verdict]


@given(few, few, rules)
def test_a_pass_is_above_the_bar_and_a_fail_below_it(successes: int, failures: int, rule: SuccessRate):
    verdict = judged(successes, failures, rule=Gate(successRate=rule))
    rate = verdict.rules[0].estimate or 0.0
    if verdict.verdict == "PASS":
        assert rate >= rule.atLeast
    if verdict.verdict == "FAIL":
        assert rate < rule.atLeast


def test_few_enough_collisions_pass_and_too_many_fail():
    rule = gate(collisionRate={"atMost": 0.1})
    assert judge(rule, rows(128, 2)).verdict == "PASS"
    assert judge(rule, rows(100, 10)).verdict == "INCONCLUSIVE"
    assert judge(rule, rows(60, 40)).verdict == "FAIL"


def test_a_job_that_failed_might_have_collided_and_might_not():
    rule = gate(collisionRate={"atMost": 0.1})
    assert judge(rule, rows(120, 0, 0)).verdict == "PASS"
    verdict = judge(rule, rows(80, 0, 40))
    assert verdict.verdict == "INCONCLUSIVE"
    assert "collisions in 0 of 120 episodes in this one world, 40 more of jobs that failed" in verdict.sentence


def test_a_quantile_passes_when_its_interval_is_within_the_bar():
    rule = gate(quantiles=[{"column": "min_clearance_m", "quantile": 0.05, "atLeast": 0.1}])
    assert judge(rule, rows(73, 0)).verdict == "PASS"  # all of them have 0.11 m
    assert judge(rule, rows(71, 0)).verdict == "INCONCLUSIVE"  # too few to say where the lowest 5 % begin
    assert judge(rule, rows(71, 0, min_clearance_m=0.09)).verdict == "FAIL"


def test_a_quantile_from_above_is_the_same_the_other_way_round():
    rule = gate(quantiles=[{"column": "simulated_s", "quantile": 0.95, "atMost": 40.0}])
    assert judge(rule, rows(73, 0)).verdict == "PASS"
    assert judge(rule, rows(71, 0)).verdict == "INCONCLUSIVE"
    assert judge(rule, rows(71, 0, simulated_s=41.0)).verdict == "FAIL"


def test_values_that_are_not_known_speak_against_whoever_needs_them():
    rule = gate(quantiles=[{"column": "spl", "quantile": 0.5, "atLeast": 0.5}])
    assert judge(rule, rows(40, 0, 10)).verdict == "PASS"
    assert judge(rule, rows(25, 0, 25)).verdict == "INCONCLUSIVE"
    assert judge(rule, rows(30, 0, spl=None)).verdict == "INCONCLUSIVE"


def test_what_a_scenario_measures_by_itself_is_a_column_too():
    rule = gate(quantiles=[{"column": "metrics.parcels", "quantile": 0.5, "atLeast": 2}])
    assert judge(rule, rows(20, 0, metrics={"parcels": 3.0})).verdict == "PASS"
    why = "nothing to tell metrics.parcels by: unknown in 20 (20 without a value) of 20 episodes"
    assert judge(rule, rows(20, 0, metrics={})).sentence == f"INCONCLUSIVE: {why}"


def test_a_value_of_an_episode_that_did_not_pass_is_not_said_to_be_missing():
    rule = gate(quantiles=[{"column": "simulated_s", "quantile": 0.9, "atMost": 40}])
    why = "nothing to tell simulated_s by: unknown in 48 (48 did not pass) of 48 episodes"
    assert judge(rule, rows(0, 48)).sentence == f"INCONCLUSIVE: {why}"
    some = judge(rule, rows(25, 70, 5)).sentence
    assert (
        "100 episodes in this one world, unknown in 75 (70 did not pass, 5 crashed by the robot's own code), is" in some
    )


@pytest.mark.parametrize(
    ("gains", "losses", "verdict"), [(3, 2, "PASS"), (5, 12, "INCONCLUSIVE"), (0, 60, "FAIL"), (0, 0, "PASS")]
)
def test_a_version_is_no_worse_when_the_interval_of_the_difference_is_above_the_margin(
    gains: int, losses: int, verdict: str
):
    material = GateMaterial(counted(batch(300, 0)), pairs=PairCounts(n=300, gains=gains, losses=losses, unpaired=0))
    assert judge(gate(noWorseThan={"applicationVersion": "1", "margin": 0.03}), material).verdict == verdict


def test_without_another_version_to_compare_with_nothing_passes():
    material = GateMaterial(counted(batch(9, 0)), pairs="no batch drove version 1")
    verdict = judge(gate(noWorseThan={"applicationVersion": "1", "margin": 0.03}), material)
    assert verdict.sentence == "INCONCLUSIVE: no batch drove version 1"


def audit(verdict: AuditVerdict, unreproduced: tuple[int, ...] = ()) -> GateMaterial:
    share = FlipShare(lanes=24, episodes=9.0, effective=24.0, rate=0.0, beyond=0.0)
    report = AuditReport(verdict=verdict, sentence="as it went", false_passes=share, unreproduced=unreproduced)
    return GateMaterial(counted(batch(9, 0)), audit=report)


def test_an_audit_that_was_not_made_or_not_sound_lets_nothing_pass():
    rule = gate(maxOutcomeFlipRate={"atMost": 0.2})
    assert judge(rule, GateMaterial(counted(batch(9, 0)))).sentence == "INCONCLUSIVE: the batch was not audited"
    assert judge(rule, audit("SOUND")).verdict == "PASS"
    assert judge(rule, audit("NOT COMPARED")).verdict == "INCONCLUSIVE"
    assert judge(rule, audit("SUSPECT", unreproduced=(3,))).verdict == "INCONCLUSIVE"


def test_of_several_rules_each_has_its_sentence_and_the_worst_decides():
    both = gate(successRate={"atLeast": 0.9}, collisionRate={"atMost": 0.01})
    verdict = judge(both, rows(128, 2))
    assert [(rule.rule, rule.verdict) for rule in verdict.rules] == [
        ("successRate", "PASS"),
        ("collisionRate", "INCONCLUSIVE"),
    ]
    assert verdict.verdict == "INCONCLUSIVE"
    head, first, second = verdict.sentence.split("\n")
    assert head == "INCONCLUSIVE: of 2 rules, 1 says INCONCLUSIVE, 1 says PASS"
    assert (first, second) == (verdict.rules[1].sentence, verdict.rules[0].sentence)
    assert judge(both, rows(0, 99)).verdict == "FAIL"
    assert judge(both, rows(500, 0)).verdict == "PASS"


def test_a_quantile_is_called_by_its_column():
    rule = gate(quantiles=[{"column": "min_clearance_m", "quantile": 0.5, "atLeast": 0.1}])
    for material in (rows(80, 0), rows(0, 0)):
        (found,) = judge(rule, material).rules
        assert (found.rule, found.title) == ("quantiles[0]", "quantile of min_clearance_m")
    assert judge(gate(collisionRate={"atMost": 0.1}), rows(80, 0)).rules[0].title == "collisionRate"


def test_a_batch_that_may_be_ended_early_is_judged_by_what_holds_at_any_look():
    counts = counted(batch(38, 0))
    fixed = judge(GATE, GateMaterial(counts))
    looked = judge(GATE, GateMaterial(counts, Completeness(looks=(38, 76))))
    assert (fixed.verdict, looked.verdict) == ("PASS", "INCONCLUSIVE")
    assert "95 % interval at any look" in looked.sentence


def test_episodes_that_were_not_needed_any_more_do_not_stand_in_the_way():
    counts = counted(batch(64, 0, cancels=64))
    verdict = judge(GATE, GateMaterial(counts, Completeness(left_out=64, looks=(64, 128))))
    assert verdict.verdict == "PASS"
    assert verdict.sentence.endswith("; 64 not needed any more")


def test_a_rule_that_needs_the_whole_batch_does_not_pass_on_a_part_of_it():
    rule = gate(quantiles=[{"column": "min_clearance_m", "quantile": 0.5, "atLeast": 0.1}])
    whole = rows(80, 0)
    assert judge(rule, whole).verdict == "PASS"
    part = GateMaterial(whole.counts, Completeness(left_out=5, looks=(80, 85)), rows=whole.rows)
    assert judge(rule, part).verdict == "INCONCLUSIVE"


def test_only_what_the_rules_look_at_is_read():
    assert columns_needed(gate(maxOutcomeFlipRate={"atMost": 0.5})) == []
    asked = gate(quantiles=[{"column": "spl", "quantile": 0.5, "atLeast": 1}], collisionRate={"atMost": 0.5})
    assert columns_needed(asked) == [
        "robot_digest",
        "status",
        "success",
        "world",
        "failure_code",
        "collisions",
        "outcome",
        "spl",
    ]


def test_rows_are_counted_as_the_batch_counts_them():
    results = [passed(0), collided(1), crashed(2), canceled(3), passed(4)]
    table = results_table("simb-1", [request(index) for index in range(5)], results)
    assert isinstance(table, pa.Table)
    assert count_rows(table) == counted(results)


def test_every_rule_of_the_document_is_judged_in_its_order():
    assert tuple(rule.name for rule in GATE_RULES) == RULES
    assert set(SEQUENTIAL_RULES) == {"successRate", "noWorseThan", "collisionRate"}


SUCCESS = SuccessRate(atLeast=0.9)
COLLISIONS = CollisionRate(atMost=0.05)


def doubted_audit(flips: int, chaotic: int = 0, chance: float | None = 0.03, lanes: int = 24) -> AuditReport:
    share = FlipShare(
        lanes=lanes,
        flips=flips,
        chaotic=chaotic,
        episodes=370.0,
        effective=float(lanes),
        rate=flips / lanes,
        beyond=(flips - chaotic) / lanes,
        chance=chance,
    )
    return AuditReport(verdict="SOUND", sentence="", false_passes=share, missed_contacts=share)


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
    [
        None,
        AuditReport(verdict="NOT RUN", sentence="not run"),
        doubted_audit(0),
        doubted_audit(2, 2),
        doubted_audit(1, chance=0.4),
    ],
)
def test_without_a_reason_there_is_no_doubt(found: AuditReport | None):
    assert engine_doubt(found, "false_passes", 0.95) is None
    assert with_engine_doubt(success(380), SUCCESS, found) == success(380)


def test_a_pass_that_fails_on_the_reference_leaves_the_answer_open():
    found = with_engine_doubt(success(380), SUCCESS, doubted_audit(2))
    assert found.verdict == "INCONCLUSIVE"
    assert found.lower
    assert found.lower < 0.75
    assert found.upper == success(380).upper
    assert found.sentence == (
        "INCONCLUSIVE: 380 of 384 episodes passed; up to 26.7 points of these passes may be the engine's: "
        "2 of 24 audited passes fail on C MuJoCo, and no micrometre explains it"
    )


def test_an_answer_that_stands_the_doubt_stays_and_says_it():
    found = with_engine_doubt(success(380), SUCCESS, doubted_audit(1, lanes=256))
    assert found.verdict == "PASS"
    assert "up to 2.1 points of these passes may be the engine's" in found.sentence
    assert found.facts["engine_doubt"] == pytest.approx(0.0115, abs=1e-4)


def test_more_audited_lanes_make_less_doubt():
    lows = [
        with_engine_doubt(success(384), SUCCESS, doubted_audit(1, lanes=lanes)).lower or 0.0 for lanes in (24, 64, 256)
    ]
    assert lows[0] < lows[1] < lows[2]


def test_doubt_without_a_control_counts():
    assert engine_doubt(doubted_audit(1, chance=None), "false_passes", 0.95) is not None


def test_contacts_that_the_engine_missed_raise_the_bound_of_collisions():
    bounds = wilson(0, 384, 0.95)
    answer = RuleVerdict(
        rule="collisionRate", verdict="PASS", sentence="PASS: none", estimate=0.0, lower=0.0, upper=bounds.upper
    )
    found = with_engine_doubt(answer, COLLISIONS, doubted_audit(1))
    assert found.upper
    assert found.upper > 0.2
    assert (found.verdict, found.lower) == ("INCONCLUSIVE", 0.0)
    assert "points more may collide on C MuJoCo" in found.sentence


def test_no_other_answer_changes():
    for changed in (
        success(300).model_copy(update={"verdict": "FAIL"}),
        success(300).model_copy(update={"lower": None}),
    ):
        assert with_engine_doubt(changed, SUCCESS, doubted_audit(5)) == changed
    assert with_engine_doubt(success(300), FlipRate(atMost=0.1), doubted_audit(5)) == success(300)


Rules = dict[str, object]


def answer(rules: Rules, successes: int, failures: int = 0, *, crashes: int = 0, cancels: int = 0) -> Verdict | None:
    early = InterimGate(Gate.model_validate({"stopEarly": True, **rules}), tuple(range(20, 261, 20)))
    early.add(batch(successes, failures))
    early.add([crashed(number) for number in range(crashes)])
    early.add([canceled(number) for number in range(cancels)])
    assert early.episodes() == successes + failures + crashes
    return early.answer()


RATE: Rules = {"successRate": {"atLeast": 0.9}}
TOUCH: Rules = {"collisionRate": {"atMost": 0.1}}


@pytest.mark.parametrize(
    ("successes", "failures", "expected"),
    [(30, 0, None), (60, 0, "PASS"), (57, 3, None), (40, 20, "FAIL"), (0, 0, None)],
)
def test_a_success_rate_is_certain_when_its_interval_at_the_look_is_clear_of_the_bar(
    successes: int, failures: int, expected: Verdict | None
):
    assert answer(RATE, successes, failures) == expected


def test_a_canceled_episode_keeps_a_pass_open_and_does_not_excuse_a_failure():
    assert answer(RATE, 60, cancels=1) is None
    assert answer(RATE, 20, 40, cancels=1) == "FAIL"


def test_all_rules_have_to_pass_and_one_has_to_fail():
    assert answer({**RATE, **TOUCH}, 60) == "PASS"
    assert answer({**RATE, **TOUCH}, 59, crashes=3) is None
    assert answer({"successRate": {"atLeast": 0.5}, **TOUCH}, 100, 60) == "FAIL"


def test_a_job_that_failed_might_have_collided():
    assert answer(TOUCH, 60) == "PASS"
    assert answer(TOUCH, 30, crashes=30) is None


def test_a_rule_that_needs_the_whole_batch_keeps_a_pass_open_and_not_a_failure():
    more: Rules = {**RATE, "quantiles": [{"column": "spl", "quantile": 0.5, "atLeast": 0.5}]}
    assert answer(more, 200) is None
    assert answer(more, 20, 60) == "FAIL"

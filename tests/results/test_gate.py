"""The gate: PASS and FAIL need proof, and what is missing never helps."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from specs.pipeline_simulation import SuccessRate
from tasks.results.gate import episodes_needed, judge
from tests.episodes_factory import batch, counted, crashed

RULE = SuccessRate(atLeast=0.9, confidence=0.95)
RANK = {"FAIL": 0, "INCONCLUSIVE": 1, "PASS": 2}

few = st.integers(0, 60)
rules = st.builds(SuccessRate, atLeast=st.floats(0, 1, exclude_max=True), confidence=st.floats(0.5, 0.9999))


@pytest.mark.parametrize(
    ("successes", "failures", "verdict"),
    [(128, 0, "PASS"), (126, 2, "PASS"), (118, 10, "INCONCLUSIVE"), (10, 0, "INCONCLUSIVE"), (90, 38, "FAIL")],
)
def test_the_interval_decides(successes: int, failures: int, verdict: str):
    assert judge(counted(batch(successes, failures)), RULE).verdict == verdict


def test_the_sentence_gives_the_numbers():
    assert judge(counted(batch(126, 2)), RULE).sentence == (
        "PASS: 126 of 128 episodes passed (98.4 %, 95 % interval 94.4 to 99.6 %); at least 90 % asked for"
    )


def test_a_job_that_failed_counts_as_not_successful():
    verdict = judge(counted([*batch(50, 0), *(crashed(50 + number) for number in range(50))]), RULE)
    assert verdict.verdict == "FAIL"
    assert (verdict.numbers.successes, verdict.numbers.failed_jobs) == (50, 50)


def test_a_canceled_episode_makes_a_pass_inconclusive():
    verdict = judge(counted(batch(128, 0, cancels=1)), RULE)
    assert verdict.verdict == "INCONCLUSIVE"
    assert (verdict.numbers.episodes, verdict.numbers.canceled) == (128, 1)
    assert verdict.sentence.endswith("; 1 canceled")


def test_a_missing_episode_makes_a_pass_inconclusive():
    assert judge(counted(batch(128, 0)), RULE, missing=1).verdict == "INCONCLUSIVE"


def test_a_canceled_episode_does_not_excuse_a_failure():
    assert judge(counted(batch(10, 100, cancels=1)), RULE).verdict == "FAIL"


@pytest.mark.parametrize("cancels", [0, 3])
def test_no_counted_episode_is_inconclusive_whatever_is_asked(cancels: int):
    verdict = judge(counted(batch(0, 0, cancels)), SuccessRate(atLeast=0.0))
    assert (verdict.verdict, verdict.numbers.rate) == ("INCONCLUSIVE", None)


@given(few, few.filter(bool), few, rules)
def test_one_more_success_never_worsens_the_verdict(successes: int, failures: int, cancels: int, rule: SuccessRate):
    before = judge(counted(batch(successes, failures, cancels)), rule)
    after = judge(counted(batch(successes + 1, failures - 1, cancels)), rule)
    assert RANK[after.verdict] >= RANK[before.verdict]


@given(few, few, rules)
def test_a_pass_is_above_the_bar_and_a_fail_below_it(successes: int, failures: int, rule: SuccessRate):
    verdict = judge(counted(batch(successes, failures)), rule)
    if verdict.verdict == "PASS":
        assert (verdict.numbers.rate or 0.0) >= rule.atLeast
    if verdict.verdict == "FAIL":
        assert (verdict.numbers.rate or 0.0) < rule.atLeast


@pytest.mark.parametrize(("bar", "rate"), [(0.9, 1.0), (0.9, 0.95), (0.5, 0.7), (0.99, 0.999), (0.0, 0.5)])
def test_the_episodes_needed_pass_and_a_few_less_do_not(bar: float, rate: float):
    needed = episodes_needed(bar, 0.95, rate)
    assert needed is not None
    rule = SuccessRate(atLeast=bar)

    def verdict(n: int) -> str:
        successes = int(rate * n + 1e-9)
        return judge(counted(batch(successes, n - successes)), rule).verdict

    assert verdict(needed) == "PASS"
    assert all(verdict(n) != "PASS" for n in range(max(1, needed - 5), needed))


@pytest.mark.parametrize(("bar", "rate"), [(1.0, 1.0), (0.9, 0.9), (0.9, 0.5)])
def test_no_number_of_episodes_shows_what_is_not_so(bar: float, rate: float):
    assert episodes_needed(bar, 0.95, rate) is None

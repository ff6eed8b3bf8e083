"""A gate that is certain early answers what it will answer in the end, and only then."""

import pytest

from specs.data.run_report import Verdict
from specs.pipeline.gate_section import Gate
from tasks.results.gate.gate_verdict import InterimGate
from tests.factories.episodes import batch, canceled, crashed

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

"""The rule about rare failures: the whole interval at most the bar, or above it."""

import pytest

from specs.data.run_report import Verdict
from specs.pipeline.gate_section import FailureBar, Gate
from tasks.results.gate.gate_verdict import false_pass_chance, judge
from tasks.results.gate.rules.rare_failure import RARE_FAILURE
from tasks.results.gate.rules.rule import GateMaterial, PlannedEpisodes
from tasks.results.statistics.intervals import Interval
from tasks.results.statistics.rare_failures import FailureProbability
from tests.factories.episodes import batch, counted


def material(lower: float, upper: float, highest: float | None = None) -> GateMaterial:
    rare = FailureProbability(
        estimate=0.001,
        interval=Interval(lower=lower, upper=upper),
        highest=highest or upper,
        method="splitting",
        why="rare",
        episodes=20_000,
    )
    return GateMaterial(counted(batch(9, 0)), rare=rare)


@pytest.mark.parametrize(
    ("lower", "upper", "verdict"),
    [
        (0.0005, 0.001, "PASS"),
        (0.0005, 0.0011, "INCONCLUSIVE"),
        (0.001, 0.002, "INCONCLUSIVE"),
        (0.0011, 0.002, "FAIL"),
    ],
)
def test_the_whole_interval_decides(lower: float, upper: float, verdict: Verdict):
    gate = Gate(failureProbability=FailureBar(atMost=0.001))
    found = judge(gate, material(lower, upper))
    assert found.verdict == verdict
    assert (found.rules[0].lower, found.rules[0].upper, found.rules[0].counted) == (lower, upper, 20_000)
    assert found.sentence.endswith("at most 0.001 asked for")
    assert false_pass_chance(gate) == 0.025


@pytest.mark.parametrize(
    ("announced", "highest", "verdict"),
    [(False, 0.001, "PASS"), (False, 0.0011, "INCONCLUSIVE"), (True, 0.0011, "PASS")],
)
def test_failures_that_nothing_announces_count_unless_it_is_said_that_there_are_none(
    *, announced: bool, highest: float, verdict: Verdict
):
    gate = Gate(failureProbability=FailureBar(atMost=0.001, announced=announced))
    found = judge(gate, material(0.0005, 0.0009, highest))
    assert found.verdict == verdict
    assert found.rules[0].upper == (0.0009 if announced else highest)
    assert "at most 0.001 if there are failures that nothing announces" in found.sentence or highest > 0.001


def test_a_batch_that_nobody_searched_is_inconclusive():
    answer = RARE_FAILURE.judge(FailureBar(atMost=0.001), GateMaterial(counted(batch(9, 0))), "failureProbability")
    assert answer.sentence == (
        "INCONCLUSIVE: the batch was not searched: a run of its document says how rare failures are"
    )


def test_a_plan_says_how_many_draws_without_a_failure_would_do():
    asked = FailureBar(atMost=0.001)
    told = [*RARE_FAILURE.plan(asked, PlannedEpisodes(16, 16, 0, searched=20_000))]
    assert told[1] == "if no plain draw fails, 3,688 are needed: the search's 20,000 are ENOUGH"
    assert [*RARE_FAILURE.plan(asked, PlannedEpisodes(16, 16, 0, searched=1_000))][1].endswith("NOT ENOUGH")

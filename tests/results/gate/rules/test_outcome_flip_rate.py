"""The rule about outcomes that flip: strata weighted as the batch."""

import pytest

from specs.data.parity_audit import AuditReport, FlipShare
from specs.pipeline.gate_section import FlipRate
from tasks.results.gate.rules.outcome_flip_rate import OUTCOME_FLIP_RATE
from tasks.results.gate.rules.rule import GateMaterial, RuleVerdict
from tasks.results.statistics.batch_summary import EpisodeCounts
from tests.factories.episodes import batch, counted

Stratum = tuple[int, int, float]  # lanes, flips, episodes


def share(lanes: int, flips: int, episodes: float) -> FlipShare:
    if not lanes:
        return FlipShare()
    return FlipShare(lanes=lanes, flips=flips, episodes=episodes, effective=float(lanes), rate=flips / lanes)


def judged(passes: Stratum, failures: Stratum, at_most: float = 0.2) -> RuleVerdict:
    audit = AuditReport(verdict="SOUND", sentence="", false_passes=share(*passes), false_alarms=share(*failures))
    return OUTCOME_FLIP_RATE.judge(FlipRate(atMost=at_most), GateMaterial(_counts(), audit=audit), "maxOutcomeFlipRate")


def _counts() -> EpisodeCounts:
    return counted(batch(9, 0))


def test_flips_of_rare_failures_count_for_what_there_is_of_them():
    found = judged((24, 0, 376.0), (8, 4, 8.0))
    assert found.estimate == pytest.approx(4 / 384)
    assert (found.verdict, found.method, found.counted) == ("PASS", "stratified exact", 32)
    assert "0 of 24 passes that fail there, 4 of 8 failures that pass there" in found.sentence
    assert judged((24, 0, 192.0), (8, 4, 192.0)).verdict == "INCONCLUSIVE"


def test_too_few_lanes_are_inconclusive():
    assert judged((12, 0, 384.0), (0, 0, 0.0)).verdict == "INCONCLUSIVE"
    assert judged((17, 0, 384.0), (0, 0, 0.0)).verdict == "PASS"
    assert judged((0, 0, 0.0), (0, 0, 0.0)).sentence == "INCONCLUSIVE: the audit compared no episode"


def test_many_flips_fail():
    assert judged((24, 12, 360.0), (8, 4, 24.0)).verdict == "FAIL"

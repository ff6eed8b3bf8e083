"""How likely an audit finds an engine's error, how often it blames chaos, and what its doubt does to a gate.

``python -m benchmarks.simulation.audit`` prints the tables of docs/guide/audit.md, all by simulation of batches whose
episodes have a chance to pass on each engine; no physics is driven. Batches have 384 episodes of which 95 % pass unless
it says otherwise.
"""

import argparse
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from benchmarks.harness import markdown
from specs.data.parity_audit import AuditReport, FlipShare
from specs.pipeline.gate_section import SuccessRate
from tasks.results.gate.gate_verdict import with_engine_doubt
from tasks.results.gate.rules.rule import RuleVerdict
from tasks.results.statistics.intervals import wilson
from tasks.simulate.audit.audit_drive import DISTURBANCES_M
from tasks.simulate.audit.audit_report import (
    CHANCE,
    FAILED_FLIP_LIMIT,
    FLIP_LIMIT,
    ComparedLane,
    Ending,
    exceeds,
    flip_share,
)
from tasks.simulate.audit.audit_sample import failed_lanes, plan_picks, stretches

EPISODES, LANES, LANES_BEFORE = 384, 32, 16
_SIZES = (LANES, 128)
_BAR = 0.9


class Population(NamedTuple):
    """What a batch's episodes are like.

    Attributes:
        passes: The chance that an episode passes, where nothing is chaotic.
        chaotic: The share of episodes that are chaotic: each drive of them passes by itself half of the time.
        false_passes: The chance that an episode that fails on C MuJoCo passes on the batch's engine, as a share of all
            that pass there.
    """

    passes: float
    chaotic: float = 0.0
    false_passes: float = 0.0


class Batch(NamedTuple):
    """A batch's episodes: whether each passes on its engine, and on each drive of C MuJoCo (drives, episodes)."""

    rows: np.ndarray
    drives: np.ndarray


def drawn_batch(rng: np.random.Generator, what: Population, episodes: int = EPISODES) -> Batch:
    """Returns a batch drawn from a population."""
    truth = rng.random(episodes) < what.passes
    drives = np.repeat(truth[None], 2 + len(DISTURBANCES_M), axis=0)
    chaotic = rng.random(episodes) < what.chaotic
    drives[:, chaotic] = rng.random((len(drives), int(chaotic.sum()))) < 0.5
    rows = drives[0].copy()
    wrong = rows & ~chaotic & (rng.random(episodes) < what.false_passes)
    drives[1:, wrong] = False
    return Batch(rows, drives[1:])


def audited(batch: Batch, lanes: int, seed: str) -> list[ComparedLane]:
    """Returns the lanes that an audit of so many draws from a batch, as ``audit_sample`` does of its members."""
    pick, found = plan_picks(seed), list[ComparedLane]()
    members = {passed: np.flatnonzero(batch.rows == passed) for passed in (True, False)}
    failed = min(len(members[False]), max(failed_lanes(lanes), lanes - len(members[True])))
    counts = {False: failed, True: min(len(members[True]), lanes - failed)}
    for passed, own in members.items():
        for k, stretch in enumerate(stretches(len(own), counts[passed])):
            episode = int(own[stretch[pick(f"{passed}/{k}", len(stretch))]])
            reference, *disturbed = (_ending(drive[episode]) for drive in batch.drives)
            found.append(
                ComparedLane(episode, float(len(stretch)), _ending(batch.rows[episode]), reference, tuple(disturbed))
            )
    return found


def _ending(passed: np.bool_) -> Ending:
    return Ending(passed=bool(passed), touched=False)


def passes_share(lanes: Sequence[ComparedLane]) -> FlipShare:
    """Returns the false passes of an audit."""
    return flip_share(lanes, lambda ending: ending.passed)


def alarms(lanes: Sequence[ComparedLane]) -> bool:
    """Returns whether an audit is SUSPECT by its flips of success."""
    alarm_share = flip_share(lanes, lambda ending: not ending.passed)
    return any(
        exceeds(share, limit) and share.chance is not None and share.chance < CHANCE
        for share, limit in ((passes_share(lanes), FLIP_LIMIT), (alarm_share, FAILED_FLIP_LIMIT))
    )


def found_before(batch: Batch, rng: np.random.Generator) -> tuple[int, bool]:
    """Returns how many false passes the audit before saw, and whether it was SUSPECT by flips.

    Half of its 16 lanes went to failed episodes, if there were so many; two flips of the others were an alarm, or three
    of eight failed ones.
    """
    failed = np.flatnonzero(~batch.rows)
    chosen = rng.choice(failed, min(len(failed), LANES_BEFORE // 2), replace=False)
    spread = rng.choice(len(batch.rows), LANES_BEFORE - len(chosen), replace=False)
    flips = batch.rows != batch.drives[0]
    seen = int((flips & batch.rows)[spread].sum())
    return seen, bool(flips[spread].sum() >= 2 or flips[chosen].sum() >= 3)


def detection(rng: np.random.Generator, repeats: int) -> None:
    """Prints how likely false passes are seen, and raise the alarm, before and now."""
    rows: list[list[str]] = []
    for rate in (0.0, 0.01, 0.02, 0.05, 0.1):
        before, now = np.zeros(2), np.zeros((len(_SIZES), 2))
        for k in range(repeats):
            batch = drawn_batch(rng, Population(0.95, false_passes=rate))
            seen, alarm = found_before(batch, rng)
            before += (seen > 0, alarm)
            for turn, size in enumerate(_SIZES):
                lanes = audited(batch, size, f"{rate}/{k}")
                now[turn] += (passes_share(lanes).flips > 0, alarms(lanes))
        rows.append([f"{100 * rate:g} %", *(f"{100 * each / repeats:.0f} %" for each in (*before, *now.ravel()))])
    heads = [f"{what}, {lanes}" for lanes in ("before", *_SIZES) for what in ("seen", "alarm")]
    heads = ["false passes", *heads]
    print(markdown([heads, *rows]))


def blame(rng: np.random.Generator, repeats: int) -> None:
    """Prints how often a batch without an engine's error is SUSPECT, and how often its gate has a doubt."""
    rows: list[list[str]] = []
    for passes, chaotic in ((0.95, 0.0), (0.95, 0.02), (0.95, 0.1), (0.8, 0.3), (0.5, 0.5), (0.5, 1.0)):
        before = now = doubted = 0
        for k in range(repeats):
            batch = drawn_batch(rng, Population(passes, chaotic=chaotic))
            before += found_before(batch, rng)[1]
            lanes = audited(batch, LANES, f"{passes}/{chaotic}/{k}")
            now += alarms(lanes)
            doubted += _doubts(lanes)
        share = [f"{100 * each / repeats:.1f} %" for each in (before, now, doubted)]
        rows.append([f"{100 * passes:g} %", f"{100 * chaotic:g} %", *share])
    heads = ["calm ones pass", "chaotic", "SUSPECT, before", "SUSPECT, now", "gate doubts, now"]
    print(markdown([heads, *rows]))


def _doubts(lanes: Sequence[ComparedLane]) -> bool:
    answer = RuleVerdict(rule="successRate", verdict="PASS", sentence="PASS", estimate=1.0, lower=0.99, upper=1.0)
    return _doubted(answer, lanes) != answer


def _doubted(answer: RuleVerdict, lanes: Sequence[ComparedLane]) -> RuleVerdict:
    audit = AuditReport(verdict="SOUND", sentence="", false_passes=passes_share(lanes))
    return with_engine_doubt(answer, SuccessRate(atLeast=_BAR), audit)


def gates(rng: np.random.Generator, repeats: int) -> None:
    """Prints how often a gate at 90 % passes, by what passes on C MuJoCo, with each rule of doubt."""
    rows: list[list[str]] = []
    cases = [(0.9, 0.0), (0.9, 0.02), (0.9, 0.05), (0.9, 0.1), (0.95, 0.0), (0.95, 0.01), (0.98, 0.0), (0.98, 0.01)]
    rules: list[Callable[[RuleVerdict, Sequence[ComparedLane]], bool]] = [_no_doubt, _worst_case, _this_rule]
    for on_reference, rate in cases:
        passed = np.zeros(len(rules))
        for k in range(repeats):
            batch = drawn_batch(rng, Population(on_reference / (1.0 - rate), false_passes=rate))
            count = int(batch.rows.sum())
            bounds = wilson(count, EPISODES, 0.95)
            if bounds.lower < _BAR:
                continue
            answer = RuleVerdict(
                rule="successRate",
                verdict="PASS",
                sentence="PASS",
                estimate=count / EPISODES,
                lower=bounds.lower,
                upper=bounds.upper,
            )
            lanes = audited(batch, LANES, f"{on_reference}/{rate}/{k}")
            passed += [rule(answer, lanes) for rule in rules]
        shares = [f"{100 * each / repeats:.1f} %" for each in passed]
        rows.append([f"{100 * on_reference:g} %", f"{100 * rate:g} %", *shares])
    heads = ["pass on C MuJoCo", "false passes", "PASS without doubt", "worst case taken off", "this rule"]
    print(markdown([heads, *rows]))


def _no_doubt(answer: RuleVerdict, lanes: Sequence[ComparedLane]) -> bool:  # noqa: ARG001 - one of the rules
    return answer.verdict == "PASS"


def _worst_case(answer: RuleVerdict, lanes: Sequence[ComparedLane]) -> bool:
    return (answer.lower or 0.0) * (1.0 - passes_share(lanes).upper) >= _BAR


def _this_rule(answer: RuleVerdict, lanes: Sequence[ComparedLane]) -> bool:
    return _doubted(answer, lanes).verdict == "PASS"


def main() -> None:
    """Prints the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=1000)
    repeats = parser.parse_args().repeats
    rng = np.random.default_rng(18)
    for table in (detection, blame, gates):
        table(rng, repeats)
        print()


if __name__ == "__main__":
    main()

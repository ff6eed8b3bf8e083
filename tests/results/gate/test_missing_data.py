"""What is missing never helps: each rule, in each direction, with every failure code in place of any known episode."""

from collections.abc import Iterator, Sequence
from functools import cache
from itertools import product
from typing import NamedTuple, get_args

import pytest

from specs.data.episode import EpisodeResult, unfinished_result
from specs.pipeline.gate_section import RULES, Gate
from specs.robomaker.simulation import SimulationJobErrorCode
from tasks.results.gate.gate_verdict import judge
from tasks.results.gate.missing_data import ASSUMED, ROBOTS_OWN, Gap, codes_of, gap_of
from tasks.results.gate.rules.rule import Completeness, GateMaterial
from tasks.results.gate.version_pairs import Drive, Drives, count_pairs
from tasks.results.tables.episode_tables import results_table
from tests.factories.episodes import collided, counted, passed, request

CODES = get_args(SimulationJobErrorCode)


class Loss(NamedTuple):
    """How an episode gets lost: with a status and a code, or without a row."""

    status: str
    code: str = ""

    @property
    def blames_the_robot(self) -> bool:
        return self.status == "Failed" and self.code in ROBOTS_OWN


LOSSES = (
    *(Loss("Failed", code) for code in CODES),
    *(Loss("Canceled", code) for code in ("", "BatchTimedOut", "BatchCanceled")),
    Loss("no row"),
)
KINDS = (Loss("Failed", "RobotApplicationCrash"), Loss("Failed", "InvalidS3Resource"), Loss("Canceled"), Loss("no row"))


def stuck(index: int) -> EpisodeResult:
    """Returns an episode that ended at once, unharmed and without having driven."""
    short = {"simulated_s": 1.0, "path_length_m": 0.1, "energy_j": 1.0, "min_clearance_m": 0.9, "spl": 0.0}
    return passed(index).model_copy(
        update={"outcome": "Failed", "outcome_reason": "stuck", "metrics": {"waits": 0.0}, **short}
    )


def slow(index: int) -> EpisodeResult:
    """Returns an episode that passed late and close to a wall."""
    return passed(index).model_copy(
        update={"simulated_s": 59.0, "min_clearance_m": 0.01, "spl": 0.2, "metrics": {"waits": 30.0}}
    )


def usual(index: int) -> EpisodeResult:
    return passed(index).model_copy(update={"metrics": {"waits": 2.0}})


def lost(index: int, loss: Loss) -> EpisodeResult | None:
    """Returns the row of a job that never ran; None where it has none."""
    if loss.status == "no row":
        return None
    made = unfinished_result(index, "Failed", failure_code="", failure_reason="")
    return made.model_copy(update={"status": loss.status, "failure_code": loss.code})


def material(results: Sequence[EpisodeResult], loss: Loss | None, places: Sequence[int], worlds: int) -> GateMaterial:
    """Returns a batch of which some episodes got lost."""
    gone = set(places) if loss else set[int]()
    rows = [lost(each.index, loss) if loss and each.index in gone else each for each in results]
    kept = [row for row in rows if row]
    asked = [request(row.index, world=f"g/w{row.index % worlds}", seed=row.index) for row in kept]
    counts = counted(kept)
    lacks = Completeness(canceled=counts.canceled, missing=len(rows) - len(kept))
    return GateMaterial(counts, lacks, rows=results_table("simb-1", asked, kept))


def drives(results: Sequence[EpisodeResult], loss: Loss | None = None, places: Sequence[int] = ()) -> Drives:
    rows = [lost(each.index, loss) if loss and each.index in places else each for each in results]
    return {
        row.index: Drive(
            f"w{row.index % 3}",
            None if row.status == "Canceled" else row.status == "Completed" and row.outcome == "Passed",
            row.status,
            row.failure_code,
        )
        for row in rows
        if row
    }


def rule(**sections: object) -> Gate:
    return Gate.model_validate(sections)


# Of each rule three bars: the batch below passes one, fails one, and is in between at one.
BATCH = [usual(k) if k < 60 else (slow(k) if k < 68 else (collided(k) if k < 76 else stuck(k))) for k in range(84)]
QUANTILES: tuple[tuple[str, dict[str, object], tuple[float, float, float]], ...] = (
    ("simulated_s", {"atMost": 43}, (0.5, 0.7, 0.95)),
    ("simulated_s", {"atLeast": 20}, (0.5, 0.1, 0.01)),
    ("min_clearance_m", {"atLeast": 0.1}, (0.5, 0.2, 0.02)),
    ("min_clearance_m", {"atMost": 0.5}, (0.5, 0.9, 0.99)),
    ("spl", {"atLeast": 0.5}, (0.5, 0.25, 0.1)),
    ("metrics.waits", {"atMost": 10}, (0.5, 0.8, 0.97)),
    ("metrics.waits", {"atLeast": 1}, (0.5, 0.1, 0.02)),
    ("path_length_m", {"atMost": 20, "failed": "worst"}, (0.5, 0.8, 0.95)),
)
GATES = [
    rule(
        successRate={"atLeast": (0.6, 0.8, 0.95)[level]},
        collisionRate={"atMost": (0.3, 0.1, 0.02)[level]},
        quantiles=[{"column": column, **bar, "quantile": shares[level]} for column, bar, shares in QUANTILES],
    )
    for level in range(3)
]
PLACES = {"passed": (0, 1, 2), "slow": (60, 61, 62), "collided": (68, 69, 70), "stuck": (76, 77, 78)}
NO_WORSE = [rule(noWorseThan={"applicationVersion": "1", "margin": margin}) for margin in (0.3, 0.12, 0.01)]
NEW, OLD = (
    [*map(passed, range(50)), *map(collided, range(50, 60))],
    [*map(passed, range(56)), *map(collided, range(56, 60))],
)


def verdict(gate: Gate, found: GateMaterial) -> str:
    return judge(gate, found).verdict


def verdicts(found: GateMaterial) -> dict[str, str]:
    """Returns the answer of each rule, by its bar."""
    return {
        f"{level} {each.rule}": each.verdict for level, gate in enumerate(GATES) for each in judge(gate, found).rules
    }


WHOLE = cache(lambda: verdicts(material(BATCH, None, (), 3)))


def helps(before: str, after: str, loss: Loss) -> bool:
    """Returns whether a loss made a verdict better than it was, or worse by no fault of the robot."""
    better = after == "PASS" and before != "PASS"
    return better or (after == "FAIL" and before != "FAIL" and not loss.blames_the_robot)


def broken(losses: Sequence[Loss], counts: Sequence[int]) -> Iterator[tuple[str, str, Loss]]:
    """Yields the rules that a loss helps."""
    for (kind, places), count, loss in product(PLACES.items(), counts, losses):
        after = verdicts(material(BATCH, loss, places[:count], 3))
        yield from ((each, kind, loss) for each, before in WHOLE().items() if helps(before, after[each], loss))


def broken_pairs(losses: Sequence[Loss]) -> Iterator[tuple[Gate, object, Loss]]:
    """Yields the comparisons that a loss of either version's episodes helps."""
    counts = counted(NEW)
    for gate, loss, place, ours in product(NO_WORSE, losses, (0, 52, 58), (True, False)):
        if loss.status == "no row" and not ours:
            continue  # the other version was not asked for it
        before = verdict(gate, GateMaterial(counts, pairs=count_pairs(drives(NEW), drives(OLD))))
        places = (place, place + 1)
        new, old = (drives(NEW, loss, places), drives(OLD)) if ours else (drives(NEW), drives(OLD, loss, places))
        lacks = Completeness(
            canceled=2 * (ours and loss.status == "Canceled"), missing=2 * (ours and loss.status == "no row")
        )
        if helps(before, verdict(gate, GateMaterial(counts, lacks, pairs=count_pairs(new, old))), loss):
            yield gate, (place, ours), loss


def test_every_failure_code_is_the_robots_own_or_not():
    assert {code: gap_of("Failed", code) for code in CODES} == {
        code: "robot" if code.startswith("RobotApplication") and "Version" not in code else "elsewhere"
        for code in CODES
    }
    assert sorted([*codes_of("robot"), *codes_of("elsewhere")]) == sorted(CODES)
    assert gap_of("Completed", "") is None
    assert {gap_of("Canceled", code) for code in ("", *CODES)} == {"canceled"}


def test_the_table_has_every_rule_of_a_document_that_counts_episodes():
    assert set(RULES) - set(ASSUMED) == {"maxOutcomeFlipRate", "failureProbability"}
    for assumed in ASSUMED.values():
        assert {"robot", "elsewhere", "canceled", "left out"} <= assumed.keys() <= set(get_args(Gap))


def test_no_assumption_of_the_table_helps():
    for name, assumed in ASSUMED.items():
        for gap, (proof, blame) in assumed.items():
            own = gap in {"robot", "not passed", "left out"}
            assert proof in {"worst", "blocks"} or (gap == "left out" and proof == "uncounted"), (name, gap)
            assert blame == "best" or own, (name, gap)


def test_each_rule_passes_at_one_bar_and_not_at_another():
    found = WHOLE()
    for name in {each.partition(" ")[2] for each in found}:
        answers = {found[f"{level} {name}"] for level in range(3)}
        assert "PASS" in answers, name
        assert len(answers) > 1, name
    assert set(found.values()) == {"PASS", "INCONCLUSIVE", "FAIL"}
    pairs = GateMaterial(counted(NEW), pairs=count_pairs(drives(NEW), drives(OLD)))
    assert [verdict(gate, pairs) for gate in NO_WORSE] == ["PASS", "INCONCLUSIVE", "FAIL"]


def test_no_rule_is_helped_by_an_episode_that_got_lost():
    assert list(broken(KINDS, (1, 3))) == []


def test_no_comparison_is_helped_by_an_episode_of_either_version_that_got_lost():
    assert list(broken_pairs(KINDS)) == []


@pytest.mark.long
def test_no_rule_is_helped_whatever_the_failure_code():
    others = [loss for loss in LOSSES if loss not in KINDS]
    assert list(broken(others, (3,))) == []
    assert list(broken_pairs(others)) == []

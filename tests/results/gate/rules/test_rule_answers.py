"""Rates say in which worlds they hold, and what is missing never helps."""

from collections.abc import Hashable, Sequence
from random import Random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from specs.data.episode import EpisodeResult
from specs.pipeline.gate_section import Gate
from tasks.results.gate.gate_verdict import GateVerdict, judge
from tasks.results.gate.rules.rule import Completeness, GateMaterial, PlannedEpisodes, Share
from tasks.results.gate.rules.rule_answers import cuts, rate_interval_over_worlds, worth_line
from tasks.results.gate.version_pairs import Drive, count_pairs
from tasks.results.statistics.over_worlds import rate_over_worlds
from tasks.results.tables.episode_tables import results_table
from tests.factories.episodes import canceled, collided, counted, crashed, passed, request

HERE: dict[str, object] = {"successRate": {"atLeast": 0.5}}
LIKE: dict[str, object] = {"successRate": {"atLeast": 0.5, "over": "worlds"}}
ANY_RULE = [
    LIKE,
    {"collisionRate": {"atMost": 0.5, "over": "worlds"}},
    {"quantiles": [{"column": "simulated_s", "quantile": 0.5, "atMost": 40, "over": "worlds"}]},
]


def batch(
    worlds: Sequence[Sequence[EpisodeResult]], *, alike: bool = False, left_out: int = 0, looks: tuple[int, ...] = ()
) -> GateMaterial:
    """Returns a batch by worlds; alike ones were generated in two generations, and have the same content."""
    rows = [each for world in worlds for each in world]
    names = [f"g{number}/w" for number, world in enumerate(worlds) for _ in world]
    results = [row.model_copy(update={"index": at}) for at, row in enumerate(rows)]
    asked = [request(at, world=name, seed=at) for at, name in enumerate(names)]
    counts = counted(results)
    known = dict.fromkeys(names, "same") if alike else {}
    found = Completeness(canceled=counts.canceled - left_out, left_out=left_out, looks=looks)
    return GateMaterial(counts, found, rows=results_table("simb-1", asked, results), worlds=known)


def world(successes: int, failures: int, lost: int = 0, cancels: int = 0) -> list[EpisodeResult]:
    none = crashed(0).model_copy(update={"failure_code": "InternalServiceError"})
    return [passed(0)] * successes + [collided(0)] * failures + [none] * lost + [canceled(0)] * cancels


def judged(rules: dict[str, object], found: GateMaterial) -> GateVerdict:
    return judge(Gate.model_validate(rules), found)


def test_a_rate_says_in_which_worlds_it_holds():
    eight = batch([world(11, 1)] * 8)
    assert "88 of 96 episodes passed in these 8 worlds (91.7 %, 95 % interval 84.4 to" in judged(HERE, eight).sentence
    assert "88 of 96 episodes passed in worlds like these 8 (91.7 %" in judged(LIKE, eight).sentence
    assert "12 of 12 episodes passed in this one world (" in judged(HERE, batch([world(12, 0)])).sentence
    clearance: dict[str, object] = {"quantiles": [{"column": "min_clearance_m", "quantile": 0.5, "atLeast": 0.1}]}
    assert "over 96 episodes in these 8 worlds" in judged(clearance, eight).sentence


def test_the_evidence_holds_correlation_and_design_effect_where_they_are_known():
    unlike = judged(HERE, batch([world(12, 0)] * 6 + [world(0, 12)] * 2)).rules[0]
    assert unlike.facts["worlds"] == 8
    assert unlike.facts["icc"] == pytest.approx(1.0)
    assert unlike.facts["design_effect"] == pytest.approx(12.0)
    assert "icc" not in judged(HERE, batch([world(12, 0)] * 8)).rules[0].facts


def test_where_worlds_differ_a_lot_it_says_what_holds_in_worlds_like_them():
    counts = [12, 12, 12, 12, 12, 12, 2, 11]
    sentence = judged(HERE, batch([world(passes, 12 - passes) for passes in counts])).sentence
    interval = rate_over_worlds(counts, [12] * 8, 0.95)
    assert f"; in worlds like these: {100 * interval.lower:.0f}"[:-1] in sentence
    assert "like these" not in judged(HERE, batch([world(11, 1)] * 8)).sentence


def test_worlds_that_differ_are_less_sure_over_worlds():
    unlike = batch([world(12, 0)] * 6 + [world(0, 12)] * 2)
    assert judged(HERE, unlike).verdict == "PASS"
    assert judged(LIKE, unlike).verdict == "INCONCLUSIVE"
    assert judged(LIKE, batch([world(11, 1)] * 8)).verdict == "PASS"


@pytest.mark.parametrize("rules", ANY_RULE)
def test_one_world_generated_twice_is_one_world(rules: dict[str, object]):
    assert judged(rules, batch([world(40, 0)] * 2, alike=True)).sentence.startswith("INCONCLUSIVE: 1 world")
    assert judged(rules, batch([world(40, 0)])).sentence.startswith("INCONCLUSIVE: 1 world")


@pytest.mark.parametrize("rules", ANY_RULE)
def test_a_batch_that_may_have_been_ended_by_its_numbers_says_nothing_of_other_worlds(rules: dict[str, object]):
    ended = batch([world(12, 0, cancels=1)] * 8, looks=(96, 104), left_out=8)
    assert "run the document again without stopEarly" in judged(rules, ended).sentence


@pytest.mark.parametrize("rules", ANY_RULE)
def test_without_worlds_in_the_rows_nothing_is_said_of_others(rules: dict[str, object]):
    found = batch([world(12, 0)] * 8)
    assert found.rows is not None
    bare = GateMaterial(found.counts, found.lacks, rows=found.rows.drop_columns(["world"]))
    assert "do not say in which worlds" in judged(rules, bare).sentence


@pytest.mark.parametrize("rules", ANY_RULE)
def test_a_canceled_episode_lets_no_rule_over_worlds_pass(rules: dict[str, object]):
    assert judged(rules, batch([world(24, 0)] * 12)).verdict == "PASS"
    assert judged(rules, batch([world(24, 0)] * 11 + [world(23, 0, cancels=1)])).verdict == "INCONCLUSIVE"


def test_a_comparison_over_worlds_counts_worlds():
    new: dict[Hashable, Drive] = {k: Drive(f"w{k % 8}", k >= 24, "Completed", "") for k in range(240)}
    old: dict[Hashable, Drive] = {k: Drive(f"w{k % 8}", k >= 0, "Completed", "") for k in range(240)}
    rule: dict[str, object] = {"noWorseThan": {"applicationVersion": "1", "margin": 0.2, "over": "worlds"}}
    found = judged(rule, GateMaterial(counted([]), pairs=count_pairs(new, old)))
    assert found.verdict == "PASS"
    assert "on the same 240 episodes in worlds like these 8, 0 that failed" in found.sentence
    one: dict[Hashable, Drive] = {key: each._replace(world="w") for key, each in new.items()}
    why = judged(rule, GateMaterial(counted([]), pairs=count_pairs(one, old))).sentence
    assert why.startswith("INCONCLUSIVE: 1 world")


def test_unknown_episodes_go_to_no_world_then_to_the_highest_ones_then_to_all():
    assert list(cuts([2, 0, 1], [0.1, 0.9, 0.5])) == [
        [False, False, False],
        [False, False, True],
        [True, False, True],
    ]
    assert len(list(cuts([1] * 500, [0.5] * 500))) <= 17


shares = st.lists(st.tuples(st.integers(0, 6), st.integers(0, 2), st.integers(0, 6)), min_size=2, max_size=5)


@settings(max_examples=25)
@given(shares, st.randoms(use_true_random=False))
def test_whatever_the_unknown_episodes_were_their_interval_is_within(found: list[tuple[int, int, int]], random: Random):
    worlds = [Share(shown, unknown, shown + unknown + rest) for shown, unknown, rest in found if shown + unknown + rest]
    if len(worlds) < 2:
        return
    whole = rate_interval_over_worlds(worlds, 0.95)
    guess = [share.shown + random.randint(0, share.unknown) for share in worlds]
    one = rate_over_worlds(guess, [share.n for share in worlds], 0.95)
    assert whole.lower <= one.lower + 2e-3
    assert one.upper - 2e-3 <= whole.upper


def test_an_unknown_value_is_also_tried_as_what_makes_worlds_differ_most():
    near, lost = passed(0).model_copy(update={"min_clearance_m": 0.05}), world(0, 0, lost=1)
    far = passed(0).model_copy(update={"min_clearance_m": 0.5})
    counts = [(0, 4), (4, 1), (0, 2), (0, 4), (0, 1), (0, 1), (0, 0), (2, 0)]
    found = batch([[near] * close + lost * gone + [far] * (12 - close - gone) for close, gone in counts])
    asked = {"column": "min_clearance_m", "quantile": 0.4, "atLeast": 0.1, "over": "worlds"}
    assert judged({"quantiles": [asked]}, found).verdict == "INCONCLUSIVE"


@pytest.mark.parametrize(("icc", "said"), [(2.1e-17, "0"), (0.0, "0"), (0.05, "0.05"), (0.123, "0.12"), (None, "0.05")])
def test_a_correlation_of_rounding_is_none(icc: float | None, said: str) -> None:
    planned = PlannedEpisodes(episodes=64, pairs=0, audited=0, worlds=8, icc=icc)
    assert worth_line(planned).endswith(f"at an ICC of {said}")

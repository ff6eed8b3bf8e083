"""Two batches: episodes are paired by what they were asked for, whatever order or generation they come from."""

from collections.abc import Sequence

import pytest

from specs.data.episode import EpisodeRequest, EpisodeResult
from tasks.results.batch_comparison import CommonEpisodes, compare_tables, comparison, comparison_answer
from tasks.results.tables.episode_tables import results_table
from tests.factories.episodes import ROBOT, SCENARIO, canceled, collided, crashed, passed, request
from tests.results.estimands import without_estimand

Row = tuple[EpisodeRequest, EpisodeResult]


def _pairs(first: Sequence[Row], second: Sequence[Row], identities: dict[str, str] | None = None) -> CommonEpisodes:
    one, other = (results_table("b", [row[0] for row in rows], [row[1] for row in rows]) for rows in (first, second))
    return compare_tables(one, other, identities or {}, identities or {})


def test_episodes_are_paired_by_world_seed_and_environment_in_any_order():
    first = [
        (request(0, world="g/a", seed=1), passed(0)),
        (request(1, world="g/a", seed=2), collided(1)),
        (request(2, world="g/a", seed=2, environment={"MAX_SPEED": "0.6"}), passed(2)),
    ]
    second = [
        (request(0, world="g/a", seed=2, environment={"MAX_SPEED": "0.6"}), crashed(0)),
        (request(1, world="g/a", seed=2), passed(1)),
        (request(2, world="g/a", seed=1), passed(2)),
    ]
    found = _pairs(first, second)
    assert (found.pairs, found.first_passed, found.second_passed, found.gains, found.losses) == (3, 2, 2, 1, 1)
    lost, gained = found.flips
    assert (lost.first, lost.second, lost.before, lost.after) == (2, 0, "", "RobotApplicationCrash")
    assert lost.environment == {"MAX_SPEED": "0.6"}
    assert (gained.first, gained.second, gained.before, gained.after) == (1, 1, "collision", "")


def test_worlds_of_two_generations_are_the_same_if_they_are_alike():
    first, second = [(request(0, world="g1/a"), passed(0))], [(request(0, world="g2/a"), collided(0))]
    assert _pairs(first, second).pairs == 0
    (flip,) = _pairs(first, second, {"g1/a": "same", "g2/a": "same"}).flips
    assert flip.world == "g2/a"
    assert _pairs(first, second, {"g1/a": "one", "g2/a": "other"}).pairs == 0


def test_who_is_alone_or_canceled_is_left_out_and_counted():
    first = [(request(0, seed=0), passed(0)), (request(1, seed=1), passed(1)), (request(2, seed=2), passed(2))]
    second = [(request(0, seed=1), canceled(0)), (request(1, seed=2), passed(1)), (request(2, seed=7), passed(2))]
    found = _pairs(first, second)
    assert (found.pairs, found.first_alone, found.second_alone, found.canceled) == (1, 1, 1, 1)


def test_episodes_of_several_durations_and_scenarios_are_paired_by_these_and_not_by_their_turn():
    def row(index: int, duration_s: float, scenario: str, result: EpisodeResult) -> Row:
        launch = SCENARIO.model_copy(update={"digest": scenario * 64})
        asked = request(index).model_copy(update={"duration_s": duration_s, "scenario": launch})
        return asked, result

    first = [row(0, 30.0, "b", passed(0)), row(1, 60.0, "b", collided(1)), row(2, 60.0, "c", passed(2))]
    second = [row(0, 60.0, "c", passed(0)), row(1, 60.0, "b", collided(1)), row(2, 30.0, "b", passed(2))]
    found = _pairs(first, second)
    assert (found.pairs, found.flips, found.first_alone, found.second_alone) == (3, (), 0, 0)


def test_what_only_one_batch_was_asked_for_is_named():
    first = [
        (request(0, seed=1, environment={"V": "0.4"}), passed(0)),
        (request(1, environment={"V": "0.6"}), passed(1)),
    ]
    second = [(request(0, environment={"V": "0.4"}), passed(0)), (request(1, environment={"V": "0.7"}), passed(1))]
    assert _pairs(first, second).apart == (
        "V: 0.6 only in the first; 0.7 only in the second",
        "seeds: 1 only in the first",
    )
    assert _pairs(first, first).apart == ()
    assert (
        _pairs([(request(0), passed(0))], second).apart[0]
        == "V: (not set) only in the first; 0.4, 0.7 only in the second"
    )
    assert _pairs([(request(0, world="g/a"), passed(0))], [(request(0, world="g/b"), passed(0))]).apart == (
        "worlds: 1 only in the first; 1 only in the second",
    )


def test_equal_requests_are_paired_one_by_one():
    first = [(request(0), passed(0)), (request(1), collided(1))]
    second = [(request(0), passed(0)), (request(1), passed(1)), (request(2), passed(2))]
    found = _pairs(first, second)
    assert (found.pairs, found.gains, found.second_alone) == (2, 1, 1)


def _by(name: str, index: int, **changes: object) -> EpisodeRequest:
    robot = ROBOT.model_copy(update={"name": name, **changes})
    return request(index).model_copy(update={"robot": robot})


def test_a_robot_of_another_name_is_compared_where_it_is_the_only_one():
    found = _pairs([(_by("old", 0), collided(0))], [(_by("new", 0, version="2", digest="e" * 64), passed(0))])
    assert found.gains == 1
    assert found.origins == (
        "robot_application: old -> new",
        "robot_version: 1 -> 2",
        "robot_digest: aaaaaaaaaaaa -> eeeeeeeeeeee",
    )


def test_several_robots_are_told_apart_by_their_names():
    first = [(_by("tall", 0), passed(0)), (_by("small", 1), collided(1))]
    second = [(_by("small", 0), collided(0)), (_by("tall", 1), passed(1))]
    found = _pairs(first, second)
    assert (found.pairs, found.flips) == (2, ())


def _counted(gains: int, losses: int, agreed: int) -> CommonEpisodes:
    both = [(passed, passed)] * agreed + [(collided, passed)] * gains + [(passed, collided)] * losses
    first = [(request(index, seed=index), kind(index)) for index, (kind, _) in enumerate(both)]
    second = [(request(index, seed=index), kind(index)) for index, (_, kind) in enumerate(both)]
    return _pairs(first, second)


@pytest.mark.parametrize(
    ("gains", "losses", "agreed", "margin", "answer"),
    [
        (0, 0, 400, 0.02, "NO WORSE"),
        (0, 0, 20, 0.02, "INCONCLUSIVE"),  # too few to be sure
        (0, 0, 20, 0.3, "NO WORSE"),
        (0, 40, 160, 0.02, "WORSE"),
        (40, 0, 160, 0.02, "NO WORSE"),
        (3, 5, 192, 0.02, "INCONCLUSIVE"),
    ],
)
def test_the_answer_follows_from_interval_and_margin(gains: int, losses: int, agreed: int, margin: float, answer: str):
    found = comparison("a", "b", _counted(gains, losses, agreed), margin=margin, confidence=0.95)
    assert found.answer == answer
    assert found.difference == pytest.approx((gains - losses) / (gains + losses + agreed))
    assert found.interval.lower <= found.difference <= found.interval.upper


def test_worlds_that_changed_alone_leave_the_answer_for_worlds_like_these_open():
    rows = [(f"g/{world}", seed) for world in range(8) for seed in range(48)]
    first = [(request(at, world=world, seed=seed), passed(at)) for at, (world, seed) in enumerate(rows)]
    second = [
        (asked, collided(at) if asked.world == "g/0" and asked.seed < 12 else passed(at))
        for at, (asked, _) in enumerate(first)
    ]
    found = comparison("a", "b", _pairs(first, second), margin=0.06, confidence=0.95)
    assert [(each.pairs, each.gains, each.losses) for each in found.pairs.by_world] == [(48, 0, 12), *[(48, 0, 0)] * 7]
    assert (found.answer, found.answer_over_worlds) == ("NO WORSE", "INCONCLUSIVE")
    answer = comparison_answer(found)
    assert ") in these 8 worlds, margin 0.06, McNemar" in answer
    assert "; in worlds like these 8 the answer would be INCONCLUSIVE (-" in answer
    assert without_estimand(answer) == []


def test_one_world_says_nothing_of_others():
    found = comparison("a", "b", _counted(3, 5, 192), margin=0.02, confidence=0.95)
    assert (found.over_worlds, found.answer_over_worlds) == (None, None)
    assert "in this 1 world, margin" in comparison_answer(found)
    assert f"in worlds like this 1 nothing is said: {found.refused}" in comparison_answer(found)

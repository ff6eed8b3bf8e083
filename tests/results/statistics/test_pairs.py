"""The same episode of two versions: world by content, seed, scenario, variables and duration."""

import pytest

from specs.data.episode import EpisodeRequest, EpisodeResult
from tasks.results.statistics.pairs import PairCounts, count_pairs, outcomes
from tasks.results.tables.tables import results_table
from tests.factories.episodes import ROBOT, SCENARIO, canceled, collided, passed, request

WORLDS = {"wgj-1/world-1-1": "c" * 64, "wgj-2/again": "c" * 64, "wgj-1/other": "d" * 64}
OTHER_SCENARIO = SCENARIO.model_copy(update={"digest": "e" * 64})


def found(*episodes: tuple[EpisodeRequest, EpisodeResult]):
    table = results_table("simb-1", [each[0] for each in episodes], [each[1] for each in episodes])
    return outcomes(table, WORLDS, [ROBOT.digest])


def test_gains_and_losses_are_counted_over_the_episodes_that_both_have():
    new = found(*((request(k, seed=k), passed(k) if k % 2 else collided(k)) for k in range(6)))
    old = found(*((request(k, seed=k), passed(k) if k < 2 else collided(k)) for k in range(5)))
    assert count_pairs(new, old) == PairCounts(n=5, gains=1, losses=1, unpaired=1)


@pytest.mark.parametrize(
    ("change", "same"),
    [
        ({"world": "wgj-2/again"}, True),
        ({"robot": ROBOT.model_copy(update={"launch_file": "renamed"})}, True),
        ({"world": "wgj-1/other"}, False),
        ({"seed": 1}, False),
        ({"environment": {"MAX_SPEED": "0.3"}}, False),
        ({"duration_s": 61.0}, False),
        ({"scenario": OTHER_SCENARIO}, False),
        ({"scenario": SCENARIO.model_copy(update={"launch_file": "other"})}, False),
    ],
)
def test_what_is_asked_of_the_robot_makes_the_episode(change: dict[str, object], same: bool):  # noqa: FBT001
    other = request(0).model_copy(update=change)
    assert count_pairs(found((request(0), passed(0))), found((other, passed(0)))).n == int(same)


def test_canceled_episodes_and_other_robots_are_left_out():
    other = request(2).model_copy(update={"robot": ROBOT.model_copy(update={"digest": "9" * 64})})
    assert found((request(0), canceled(0)), (other, passed(2))) == {}


def test_equal_requests_are_paired_by_their_turn():
    new = found((request(0), passed(0)), (request(1), collided(1)))
    old = found((request(0), collided(0)), (request(1), collided(1)))
    assert count_pairs(new, old) == PairCounts(n=2, gains=1, losses=0, unpaired=0)


def test_a_canceled_one_of_equal_requests_keeps_its_turn():
    new = found((request(0), canceled(0)), (request(1), collided(1)))
    old = found((request(0), collided(0)), (request(1), passed(1)))
    assert count_pairs(new, old) == PairCounts(n=1, gains=0, losses=1, unpaired=0)

"""The same episode of two versions, and what they came to on it, whatever is missing of either."""

import pytest

from specs.data.episode import EpisodeRequest, EpisodeResult
from tasks.results.gate.version_pairs import PairCounts, both_ended, count_pairs, drives
from tasks.results.tables.episode_tables import results_table
from tests.factories.episodes import ROBOT, SCENARIO, canceled, collided, crashed, passed, request

WORLDS = {"wgj-1/world-1-1": "c" * 64, "wgj-2/again": "c" * 64, "wgj-1/other": "d" * 64}
OTHER_SCENARIO = SCENARIO.model_copy(update={"digest": "e" * 64})


def found(*episodes: tuple[EpisodeRequest, EpisodeResult]):
    table = results_table("simb-1", [each[0] for each in episodes], [each[1] for each in episodes])
    return drives(table, WORLDS, [ROBOT.digest])


def seen(counts: PairCounts) -> tuple[int, int, int, int]:
    return counts.n, counts.gains, counts.losses, counts.unpaired


def test_gains_and_losses_are_counted_over_the_episodes_that_both_have():
    new = found(*((request(k, seed=k), passed(k) if k % 2 else collided(k)) for k in range(6)))
    old = found(*((request(k, seed=k), passed(k) if k < 2 else collided(k)) for k in range(5)))
    assert seen(count_pairs(new, old)) == (5, 1, 1, 1)


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
    new, old = found((request(0), passed(0))), found((other, passed(0)))
    assert (count_pairs(new, old).n, both_ended(new, old)) == (int(same), same)


def test_other_robots_are_left_out():
    other = request(2).model_copy(update={"robot": ROBOT.model_copy(update={"digest": "9" * 64})})
    assert len(found((request(0), passed(0)), (other, passed(2)))) == 1


def test_equal_requests_are_paired_by_their_turn():
    new = found((request(0), passed(0)), (request(1), collided(1)))
    old = found((request(0), collided(0)), (request(1), collided(1)))
    assert seen(count_pairs(new, old)) == (2, 1, 0, 0)


def test_a_canceled_one_of_equal_requests_keeps_its_turn():
    new = found((request(0), canceled(0)), (request(1), collided(1)))
    old = found((request(0), collided(0)), (request(1), passed(1)))
    counts = count_pairs(new, old)
    assert (seen(counts), counts.total().canceled) == ((1, 0, 1, 0), 1)
    assert not both_ended(found((request(0), canceled(0))), old)


def test_a_job_of_the_other_version_that_failed_passed_at_the_worst_and_failed_at_the_best():
    new = found((request(0), passed(0)), (request(1), collided(1)))
    old = found((request(0), crashed(0)), (request(1), crashed(1)))
    every = count_pairs(new, old).total()
    assert (every.gains, every.losses) == (0, 1)
    assert (every.gains_at_best, every.losses_at_best) == (1, 0)


def test_pairs_of_one_world_stand_together():
    worlds = ("wgj-1/world-1-1", "wgj-2/again", "wgj-1/other")
    new = found(*((request(k, seed=k, world=world), passed(k)) for k, world in enumerate(worlds)))
    assert [world.n for world in count_pairs(new, new).worlds] == [2, 1]

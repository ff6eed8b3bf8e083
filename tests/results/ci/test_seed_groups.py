"""Groups of episodes: what they are called, when they are failed, which episodes stand for them."""

import pytest

from tasks.results.ci import seed_groups
from tasks.results.ci.full_report import CountedBatch, GroupReport
from tasks.results.ci.seed_groups import GroupRules
from tasks.results.statistics.intervals import IntervalFamily, share_alone
from tests.factories.episodes import ROBOT, canceled, collided, crashed, passed, request
from tests.results.ci.full_reports import JOB_ARN, RULES, counted


def _groups(batch: CountedBatch) -> list[GroupReport]:
    return [group for world in batch.worlds for group in world.groups]


def _half(rules: GroupRules) -> GroupReport:
    """Returns the group of four episodes of which two passed."""
    batch = counted(
        [request(index, seed=index) for index in range(4)],
        [passed(0), collided(1), collided(2), passed(3)],
        rules,
    )
    (group,) = _groups(batch)
    return group


def test_every_episode_is_in_one_group():
    batch = counted()
    assert sum(group.episodes + group.canceled for group in _groups(batch)) == 12
    assert (batch.episodes, batch.passed, batch.canceled) == (10, 6, 2)


def test_a_group_is_one_world_and_one_setting_of_variables():
    asked = [request(index, seed=index // 2, environment={"SPEED": str(index % 2), "SAME": "1"}) for index in range(8)]
    batch = counted(asked, [passed(index) for index in range(8)])
    assert [(group.name, group.episodes) for group in _groups(batch)] == [
        ("courier go_to_goal in delivery rooms, SPEED=0", 4),
        ("courier go_to_goal in delivery rooms, SPEED=1", 4),
    ]


def test_versions_are_named_where_there_are_several_so_that_names_stay_from_night_to_night():
    newer = ROBOT.model_copy(update={"version": "2", "digest": "c" * 64})
    asked = [request(0), request(1).model_copy(update={"robot": newer})]
    names = [group.name for group in _groups(counted(asked, [passed(0), passed(1)]))]
    assert "robot_version=1" in names[0]
    assert "robot_version=2" in names[1]


def test_a_variable_that_is_called_like_a_column_is_told_apart():
    asked = [request(index, environment={"robot_version": str(index)}) for index in range(2)]
    assert [group.name for group in _groups(counted(asked, [passed(0), passed(1)]))] == [
        "courier go_to_goal in delivery rooms, robot_version=0",
        "courier go_to_goal in delivery rooms, robot_version=1",
    ]


@pytest.mark.parametrize("looks", [0, 8])
def test_a_group_has_an_interval_of_its_own_and_one_that_holds_together_with_those_of_all_others(looks: int):
    batch = counted(rules=GroupRules(looks=looks))
    assert batch.intervals == len([group for group in _groups(batch) if group.episodes]) == 2
    family = IntervalFamily(size=2, confidence=0.95, looks=looks)
    for group in _groups(batch):
        assert group.interval == share_alone(group.passed, group.episodes, 0.95, looks)
        assert group.together == family.interval(group.passed, group.episodes)


def test_groups_that_are_left_out_count_among_the_intervals(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(seed_groups, "MOST_GROUPS", 1)
    assert (len(_groups(counted())), counted().intervals) == (1, 2)


def test_of_worlds_like_these_all_episodes_of_a_world_count_together():
    asked = [request(index, environment={"SPEED": str(index % 2)}) for index in range(4)]
    asked += [request(index, world="wgj-1/other") for index in range(4, 8)]
    batch = counted(asked, [*map(passed, range(4)), *map(collided, range(4, 8))])
    assert (batch.like_these.spread.worlds, batch.like_these.spread.icc, batch.where()) == (2, 1.0, "in these 2 worlds")
    early = counted(asked, [passed(index) for index in range(8)], GroupRules(looks=8))
    assert early.like_these.refused == "the batch might have ended early"


def test_worlds_of_one_generation_are_named_without_it():
    assert [world.label for world in counted().worlds] == ["world-1-1", "world-2-1"]
    two = counted([request(0, world="a/w"), request(1, world="b/w")], [passed(0), passed(1)])
    assert [world.label for world in two.worlds] == ["a/w", "b/w"]


@pytest.mark.parametrize(
    ("rules", "state"),
    [
        (GroupRules(), "failed"),
        (GroupRules(verdict="FAIL", bar=0.9), "failed"),
        (GroupRules(verdict="FAIL", bar=0.5), "passed"),
        (GroupRules(verdict="INCONCLUSIVE", bar=0.9), "failed"),
        (GroupRules(verdict="PASS", bar=0.9), "passed"),
        (GroupRules(verdict="FAIL", bar=0.9, compared_with=(ROBOT.digest,)), "passed"),
    ],
)
def test_a_group_below_the_bar_is_failed_unless_the_gate_passes(rules: GroupRules, state: str):
    assert _half(rules).state == state


def test_a_group_that_passes_below_the_bar_says_why():
    assert "the gate is about all episodes" in _half(GroupRules(verdict="PASS", bar=0.9)).note


def test_failed_code_is_an_error_and_canceled_episodes_are_skipped():
    states = [
        _groups(counted([request(0)], [result]))[0].state
        for result in (crashed(0), collided(0), canceled(0), passed(0))
    ]
    assert states == ["error", "failed", "skipped", "passed"]


def test_examples_are_of_each_reason_first_and_can_be_replayed():
    results = [collided(0), collided(1).model_copy(update={"goals_reached": 0}), collided(2), crashed(3)]
    rules = RULES._replace(store_option="--store s3://b/p")
    (group,) = _groups(counted([request(index, seed=index) for index in range(4)], results, rules))
    assert [(each.reason, each.seed) for each in group.examples] == [
        ("collision", 1),  # came least far
        ("RobotApplicationCrash", 3),
        ("collision", 0),
    ]
    assert group.examples[0].replay == f"simyard replay {JOB_ARN}simb-1/1 --store s3://b/p"
    assert [(each.reason, each.episodes) for each in group.reasons] == [("collision", 3), ("RobotApplicationCrash", 1)]


def test_of_very_many_groups_the_failed_ones_are_listed_and_the_others_counted(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(seed_groups, "MOST_GROUPS", 2)
    asked = [request(index, world=f"g/{index}") for index in range(5)]
    batch = counted(asked, [passed(0), passed(1), collided(2), passed(3), collided(4)])
    assert [world.label for world in batch.worlds] == ["2", "4"]
    assert (batch.left_out, batch.left_out_failed, batch.episodes) == (3, 0, 5)


def test_a_batch_without_episodes_has_no_groups():
    batch = counted([], [])
    assert (batch.worlds, batch.rate) == ((), None)

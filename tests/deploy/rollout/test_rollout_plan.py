from collections.abc import Mapping
from dataclasses import replace
from random import Random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tasks.deploy.rollout.rollout_plan import Limits, Move, Phase, limits, next_move


class SimulatedFleet:
    """Robots that take their time, fail, or stay silent until a timeout, as a fault model draws them."""

    def __init__(self, robots: int, failing: float, silent: float, dice: Random) -> None:
        self.phases = {f"r{number}": Phase.WAITING for number in range(robots)}
        self.started: list[str] = []
        self.most_at_once = 0
        self._left = {name: dice.randint(0, 4) for name in self.phases}
        self._fails = {name: dice.random() < failing or dice.random() < silent for name in self.phases}

    def apply(self, move: Move) -> None:
        self.started += move.start
        self.phases |= dict.fromkeys(move.start, Phase.IN_FLIGHT) | dict.fromkeys(move.abort, Phase.ABORTED)
        self.most_at_once = max(self.most_at_once, self.count(Phase.IN_FLIGHT))

    def pass_time(self) -> None:
        for name, phase in self.phases.items():
            if phase is Phase.IN_FLIGHT and self._left[name] == 0:
                self.phases[name] = Phase.FAILED if self._fails[name] else Phase.IN_SYNC
            elif phase is Phase.IN_FLIGHT:
                self._left[name] -= 1

    def count(self, phase: Phase) -> int:
        return sum(each is phase for each in self.phases.values())


@pytest.mark.long
@settings(max_examples=1000, deadline=None)
@given(
    robots=st.integers(1, 120),
    concurrent_percent=st.integers(1, 100),
    threshold_percent=st.integers(1, 100),
    failing=st.floats(0, 1),
    silent=st.floats(0, 0.3),
    canaries=st.integers(0, 5),
    least_ended=st.integers(0, 130),
    seed=st.integers(0, 2**32),
)
def test_a_random_fleet_never_exceeds_its_limits_and_always_ends(
    *,
    robots: int,
    concurrent_percent: int,
    threshold_percent: int,
    failing: float,
    silent: float,
    canaries: int,
    least_ended: int,
    seed: int,
) -> None:
    bounds = replace(
        limits(robots, concurrent_percent=concurrent_percent, threshold_percent=threshold_percent),
        canaries=canaries,
        least_ended=least_ended,
    )
    fleet = SimulatedFleet(robots, failing, silent, Random(seed))  # noqa: S311 - a fault model, no secret

    verdict = None
    for _ in range(20 * robots):
        failed = fleet.count(Phase.FAILED)
        move = next_move(fleet.phases, bounds)
        fleet.apply(move)
        ended = failed + fleet.count(Phase.IN_SYNC)
        assert failed < bounds.failures or ended < bounds.least_ended or not move.start
        if (verdict := move.verdict) is not None:
            break
        fleet.pass_time()

    bad_canary = Phase.FAILED in [fleet.phases[name] for name in list(fleet.phases)[: bounds.canaries]]
    stopped = bad_canary or fleet.count(Phase.FAILED) >= bounds.failures
    assert verdict == ("Failed" if stopped else "Succeeded")
    if bad_canary:
        assert len(fleet.started) <= bounds.canaries
    assert fleet.most_at_once <= max(1, robots * concurrent_percent // 100)
    assert len(fleet.started) == len(set(fleet.started))
    assert fleet.count(Phase.WAITING) == fleet.count(Phase.IN_FLIGHT) == 0
    assert fleet.count(Phase.FAILED) < max(bounds.failures, bounds.least_ended) + bounds.at_once
    assert verdict == "Failed" or fleet.count(Phase.ABORTED) == 0


@given(
    phases=st.dictionaries(st.text("abc", min_size=1, max_size=3), st.sampled_from(Phase), max_size=12),
    at_once=st.integers(1, 12),
    failures=st.integers(1, 12),
)
def test_every_state_of_a_fleet_has_a_next_move(phases: Mapping[str, Phase], at_once: int, failures: int) -> None:
    move = next_move(phases, Limits(at_once, failures))

    in_flight = sum(phase is Phase.IN_FLIGHT for phase in phases.values())
    assert move.verdict or move.start or in_flight > 0
    assert all(phases[robot] is Phase.WAITING for robot in move.start + move.abort)
    assert in_flight + len(move.start) <= max(at_once, in_flight)
    assert not (move.start and move.abort)


@pytest.mark.parametrize(
    ("robots", "concurrent", "threshold", "expected"),
    [
        (200, 10, 100, Limits(20, 200)),  # docs/reference/robomaker.md, section 8: 10 % of 200 is 20
        (5, 1, 1, Limits(1, 1)),
        (5, 40, 60, Limits(2, 3)),
        (3, 50, 50, Limits(1, 2)),
        (1, 100, 100, Limits(1, 1)),
    ],
)
def test_percentages_become_robots(robots: int, concurrent: int, threshold: int, expected: Limits) -> None:
    assert limits(robots, concurrent_percent=concurrent, threshold_percent=threshold) == expected


def test_robots_start_in_the_order_of_the_fleet() -> None:
    assert next_move(dict.fromkeys(["z", "a", "m"], Phase.WAITING), Limits(2, 1)).start == ("z", "a")


def test_those_in_flight_finish_after_the_threshold_and_the_rest_is_left_alone() -> None:
    phases = {"a": Phase.FAILED, "b": Phase.IN_FLIGHT, "c": Phase.WAITING}

    assert next_move(phases, Limits(2, 1)) == Move(abort=("c",), why="threshold")


def test_a_roll_out_that_failed_everywhere_fails_at_a_threshold_of_all() -> None:
    assert next_move(
        dict.fromkeys("abc", Phase.FAILED), limits(3, concurrent_percent=100, threshold_percent=100)
    ) == Move(verdict="Failed", why="threshold")


def test_a_roll_out_that_was_stopped_stays_stopped_when_a_silent_robot_comes_back() -> None:
    phases = {"came back": Phase.IN_SYNC, "left out": Phase.ABORTED, "waiting": Phase.WAITING}

    assert next_move(phases, Limits(1, 1)) == Move(abort=("waiting",), verdict="Failed", why="threshold")


def test_canaries_go_alone_and_the_others_wait_for_all_of_them() -> None:
    bounds = Limits(at_once=3, failures=4, canaries=2)
    fleet = dict.fromkeys("abcde", Phase.WAITING)

    assert next_move(fleet, bounds).start == ("a", "b")
    assert next_move({**fleet, "a": Phase.IN_SYNC, "b": Phase.IN_FLIGHT}, bounds) == Move()
    assert next_move({**fleet, "a": Phase.IN_SYNC, "b": Phase.IN_SYNC}, bounds).start == ("c", "d", "e")


def test_one_failed_canary_stops_everything() -> None:
    phases = {"a": Phase.FAILED, "b": Phase.WAITING, "c": Phase.WAITING}

    assert next_move(phases, Limits(1, 3, canaries=1)) == Move(abort=("b", "c"), verdict="Failed", why="canary")


def test_failures_count_once_enough_robots_have_ended() -> None:
    bounds = Limits(at_once=1, failures=1, least_ended=3)

    assert next_move({"a": Phase.FAILED, "b": Phase.WAITING, "c": Phase.WAITING}, bounds).start == ("b",)
    assert next_move({"a": Phase.FAILED, "b": Phase.IN_SYNC, "c": Phase.FAILED, "d": Phase.WAITING}, bounds) == Move(
        abort=("d",), verdict="Failed", why="threshold"
    )


def test_a_fleet_smaller_than_the_least_number_is_still_judged() -> None:
    assert next_move({"a": Phase.FAILED}, Limits(1, 1, least_ended=9)).verdict == "Failed"


def test_a_paused_roll_out_starts_nobody_and_goes_on_where_it_was() -> None:
    phases = {"a": Phase.IN_SYNC, "b": Phase.WAITING}

    assert next_move(phases, Limits(1, 1), "pause") == Move()
    assert next_move(phases, Limits(1, 1), "go").start == ("b",)
    assert next_move({"a": Phase.IN_SYNC}, Limits(1, 1), "pause").verdict == "Succeeded"


def test_a_canceled_roll_out_lets_those_in_flight_finish_and_leaves_the_rest_alone() -> None:
    phases = {"a": Phase.IN_FLIGHT, "b": Phase.WAITING}

    assert next_move(phases, Limits(1, 1), "cancel") == Move(abort=("b",), why="canceled")
    ended = {"a": Phase.IN_SYNC, "b": Phase.ABORTED}
    assert next_move(ended, Limits(1, 1), "cancel") == Move(verdict="Canceled", why="canceled")


def test_a_fleet_whose_time_is_over_fails_unless_all_had_their_turn() -> None:
    waiting = {"a": Phase.IN_SYNC, "b": Phase.WAITING}

    assert next_move(waiting, Limits(1, 1), "time out") == Move(abort=("b",), verdict="Failed", why="time")
    assert next_move({"a": Phase.IN_SYNC}, Limits(1, 1), "time out").verdict == "Succeeded"

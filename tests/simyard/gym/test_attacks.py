"""What people do to an environment that they should not: each answer says what is wrong, and the next call works."""

import os
import pickle
from typing import Any, cast

import numpy as np
import pytest
from gymnasium import error
from gymnasium.vector import AutoresetMode

from simyard.gym import SimyardVectorEnv
from specs.errors import DocumentError
from tests.factories.simulations import cluttered, pen

STILL = np.zeros((3, 2), np.float32)


@pytest.fixture
def env(options: dict[str, Any]) -> SimyardVectorEnv:
    return SimyardVectorEnv(3, **options, autoreset_mode=AutoresetMode.DISABLED)


@pytest.mark.parametrize(
    ("actions", "words"),
    [
        (np.full((3, 2), np.nan, np.float32), r"actions\[0, 0\]: nan: must be a finite number"),
        (np.array([[0, 0], [0, 0], [0, np.inf]]), r"actions\[2, 1\]: inf"),
        (np.zeros((2, 2)), r"shape \(2, 2\): must be real numbers, \(3, 2\)"),
        (np.zeros((3, 2), complex), "complex128"),
        ("forward", "must be real numbers"),
        (None, "must be real numbers"),
    ],
)
def test_a_wrong_action_is_refused_and_changes_nothing(env: SimyardVectorEnv, actions: object, words: str):
    env.reset(seed=4)
    with pytest.raises(error.InvalidAction, match=words):
        env.step(cast("np.ndarray", actions))
    again = env.step(STILL)[0]["ranges_m"]
    env.reset(seed=4)
    assert np.array_equal(again, env.step(STILL)[0]["ranges_m"])


def test_an_action_beyond_its_space_is_clipped(env: SimyardVectorEnv):
    env.reset(seed=4)
    beyond = env.step(STILL + 50)[0]["goal_robot_m"]
    env.reset(seed=4)
    assert np.array_equal(beyond, env.step(STILL + 1)[0]["goal_robot_m"])


def test_a_step_before_the_first_reset_is_refused(env: SimyardVectorEnv):
    with pytest.raises(error.ResetNeeded, match="call reset first"):
        env.step(STILL)


def test_without_autoreset_a_step_of_what_is_over_is_refused(env: SimyardVectorEnv):
    env.reset(seed=0)
    for _ in range(20):
        env.step(STILL)
    with pytest.raises(error.ResetNeeded, match="sub-environment 0 is over"):
        env.step(STILL)


@pytest.mark.parametrize("mask", [np.zeros(3, bool), np.ones(2, bool), np.ones(3), [True] * 3])
def test_a_mask_that_is_none_is_refused(env: SimyardVectorEnv, mask: object):
    env.reset(seed=0)
    with pytest.raises(error.Error, match="must be a NumPy array of 3 bools"):
        env.reset(options={"reset_mask": mask})


@pytest.mark.parametrize("seed", [-1, [1, 2], [1, 2, -3]])
def test_a_seed_that_is_none_is_refused(env: SimyardVectorEnv, seed: object):
    with pytest.raises(error.Error):
        env.reset(seed=cast("int", seed))


def test_two_environments_at_once_do_not_disturb_each_other(options: dict[str, Any], env: SimyardVectorEnv):
    other = SimyardVectorEnv(3, **options, autoreset_mode=AutoresetMode.DISABLED)
    env.reset(seed=1)
    alone = [env.step(STILL + 0.3)[0]["ranges_m"] for _ in range(6)]
    env.reset(seed=1)
    other.reset(seed=2)
    for seen in alone:
        other.step(STILL - 0.5)
        assert np.array_equal(env.step(STILL + 0.3)[0]["ranges_m"], seen)


def test_a_pickled_one_begins_anew_with_the_same_episodes(env: SimyardVectorEnv):
    env.reset(seed=6)
    again = pickle.loads(pickle.dumps(env))  # noqa: S301 - our own bytes
    assert np.array_equal(again.reset(seed=6)[0]["ranges_m"], env.reset(seed=6)[0]["ranges_m"])


def test_it_closes_twice_and_then_steps_no_more(env: SimyardVectorEnv):
    env.reset(seed=0)
    env.close()
    env.close()
    with pytest.raises(error.ClosedEnvironmentError):
        env.step(STILL)


def test_another_process_is_told_to_make_its_own(env: SimyardVectorEnv, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(os, "getpid", lambda: -1)
    with pytest.raises(error.Error, match="does not survive a fork"):
        env.reset(seed=0)


@pytest.mark.long
def test_worlds_of_different_sizes_go_together():
    env = SimyardVectorEnv(8, worlds=[cluttered(0), pen(4.5, 1)], seeds=4, environment={"GOALS": "1"})
    _, infos = env.reset(seed=0)
    assert len(set(infos["world"])) == 2
    assert np.isfinite(env.step(np.full((8, 2), 0.5))[1]).all()


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"robot": "no-such-robot"}, "robot: 'no-such-robot'"),
        ({"sensors": {"radar": {}}}, "sensors: 'radar'"),
        ({"sensors": {"lidar": {"rays": 0}}}, "rays"),
        ({"sensors": {"depth_camera": {"mjcf": "eye"}}}, "'eye': no camera of robot.xml"),
        ({"sensors": {"depth_camera": [{"columns": 8}, {}]}}, "depth_camera: .* each camera of a list has one"),
        ({"seeds": 0}, "seeds: 0"),
        ({"seeds": [-1]}, "seeds:"),
        ({"duration_s": 0.0}, "duration_s: 0.0"),
        ({"worlds": []}, "worlds:"),
        ({"actions": "torques"}, "actions: 'torques'"),
        ({"colour": "red"}, "colour: 'red'"),
        ({"launch": "courier"}, "launch: 'courier'"),
    ],
)
def test_a_wrong_option_is_refused_by_its_name(options: dict[str, Any], wrong: dict[str, Any], words: str):
    with pytest.raises(DocumentError, match=words):
        SimyardVectorEnv(3, **{**options, **wrong})


@pytest.mark.long
def test_a_field_that_the_robot_has_not_is_refused_with_those_that_it_has(options: dict[str, Any]):
    with pytest.raises(DocumentError, match=r"'smell'.*ranges_m, goal_robot_m"):
        SimyardVectorEnv(3, **options, observation=["smell"])

"""Many robots in one compiled call: the same as Gymnasium's own vectors of single environments."""

from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from gymnasium.wrappers.vector import NormalizeObservation, RecordEpisodeStatistics

from simyard.gym import SimyardEnv, SimyardVectorEnv
from tasks.simulate.geometry.depth_picture import View
from tasks.simulate.geometry.hull_picture import Mount, hull_picture
from tests.factories.simulations import COURIER, FOLDERS

STEPS = 45
SLOW = pytest.param(AutoresetMode.NEXT_STEP, marks=pytest.mark.long)


@pytest.fixture
def vector(options: dict[str, Any]) -> SimyardVectorEnv:
    return SimyardVectorEnv(3, **options, autoreset_mode=AutoresetMode.SAME_STEP, flatten=True)


def actions(seed: int) -> np.ndarray:
    drawn = np.random.default_rng(seed).uniform(-1.0, 1.0, (STEPS, 3, 2)).astype(np.float32)
    drawn[..., 0] = np.abs(drawn[..., 0])
    return drawn


def require_same(one: object, other: object) -> None:
    """Checks that two answers are the same, with the same types."""
    assert type(one) is type(other)
    if isinstance(one, dict) and isinstance(other, dict):
        assert one.keys() == other.keys()
        for key in one:
            require_same(one[key], other[key])
    elif isinstance(one, np.ndarray) and isinstance(other, np.ndarray) and one.dtype != object:
        assert one.dtype == other.dtype
        assert np.array_equal(one, other)
    elif isinstance(one, tuple | np.ndarray) and isinstance(other, tuple | np.ndarray):
        for each, beside in zip(one, other, strict=True):
            require_same(each, beside)
    else:
        assert one == other


@pytest.mark.parametrize("mode", [AutoresetMode.SAME_STEP, AutoresetMode.DISABLED, SLOW])
def test_a_vector_does_what_gymnasiums_vector_of_single_environments_does(mode: AutoresetMode, options: dict[str, Any]):
    own = SimyardVectorEnv(3, **options, autoreset_mode=mode)
    beside = SyncVectorEnv([lambda: SimyardEnv(**options)] * 3, autoreset_mode=mode)
    require_same(own.reset(seed=5), beside.reset(seed=5))
    for action in actions(0):
        answer = own.step(action)
        require_same(answer, beside.step(action))
        over = answer[2] | answer[3]
        if mode is AutoresetMode.DISABLED and over.any():
            own_again = own.reset(options={"reset_mask": over.copy()})
            require_same(own_again, beside.reset(options={"reset_mask": over.copy()}))


@pytest.mark.long
def test_the_same_seeds_give_the_same_bits_however_many_robots_there_are(options: dict[str, Any]):
    few, many = (SimyardVectorEnv(count, **options) for count in (3, 40))
    require_same(few.reset(seed=9)[0]["ranges_m"], many.reset(seed=9)[0]["ranges_m"][:3])
    for action in actions(1):
        wide = np.concatenate([action, np.full((37, 2), 0.5, np.float32)])
        one, other = few.step(action), many.step(wide)
        require_same(one[0]["ranges_m"], other[0]["ranges_m"][:3])
        require_same(one[1], other[1][:3])


@pytest.mark.long
def test_pictures_are_observations_and_the_same_bits_however_many_robots_there_are(options: dict[str, Any]):
    camera = {"columns": 16, "rows": 12, "rate_hz": 10, "sigma_m_per_m2": 0.01}
    declared = {"depth_camera": camera, "wheel_encoders": {}, "compass": {}, "cliff_sensors": {}, "gps": {}}
    others = ("ticks", "field_ut", "cliff_m", "gps_m")
    sees: Any = {"sensors": declared, "observation": ("depth_m", *others)}
    few, many = (SimyardVectorEnv(count, **options, **sees) for count in (1, 9))
    spaces: Any = few.single_observation_space
    assert [spaces[name].shape for name in others] == [(2,), (3,), (3,), (3,)]
    assert spaces["depth_m"] == gymnasium.spaces.Box(0.0, 10.0, (12, 16), np.float32)
    one, other = few.reset(seed=9)[0]["depth_m"], many.reset(seed=9)[0]["depth_m"]
    require_same(one, other[:1])
    for action in actions(1)[:30]:
        one = few.step(action[:1])[0]["depth_m"]
        other = many.step(np.concatenate([action[:1], np.full((8, 2), 0.5, np.float32)]))[0]["depth_m"]
        require_same(one, other[:1])
    assert len(np.unique(one)) > 20


@pytest.mark.long
def test_a_trainers_pictures_show_the_robot_itself_if_declared(options: dict[str, Any]):
    camera = {"columns": 16, "rows": 12, "x_m": -0.4, "z_m": 0.3, "pitch_rad": 0.2}
    seen: list[Any] = []
    for declared in (camera, {**camera, "sees_robot": True}):
        sees: Any = {"sensors": {"depth_camera": declared}, "observation": ("depth_m",)}
        seen.append(SimyardVectorEnv(2, **options, **sees).reset(seed=9)[0]["depth_m"])
    own_m = hull_picture(FOLDERS[COURIER] / "robot.xml", View(16, 12, 1.2, 0.2, 10.0), Mount(-0.4, 0.0, 0.3, 0.0))
    assert 20 < (own_m < 10.0).sum() < own_m.size
    np.testing.assert_array_equal(seen[1], np.minimum(seen[0], own_m))
    assert (seen[1] < seen[0]).any()


def test_a_reset_of_some_leaves_the_others_where_they_are(vector: SimyardVectorEnv):
    vector.reset(seed=[7, 8, 9])
    before = [vector.step(action)[0] for action in actions(2)[:5]][-1]
    seen, infos = vector.reset(seed=[70, 80, 90], options={"reset_mask": np.array([False, True, False])})
    assert np.array_equal(seen[[0, 2]], before[[0, 2]])
    assert infos["_seed"].tolist() == [False, True, False]
    fresh, _ = vector.reset(seed=[1, 80, 1])
    assert np.array_equal(seen[1], fresh[1])


@pytest.mark.long
def test_gymnasiums_wrappers_of_vectors_take_it(options: dict[str, Any]):
    env = gymnasium.make_vec("simyard/Delivery-v0", num_envs=3, flatten=True, **options)
    wrapped = NormalizeObservation(RecordEpisodeStatistics(env))
    wrapped.reset(seed=1)
    ended = [wrapped.step(action)[4] for action in actions(3)]
    lengths = [info["episode"]["l"] for info in ended if "episode" in info]
    assert max(length.max() for length in lengths) == 20


@pytest.mark.long
def test_a_reward_of_ones_own_is_paid(options: dict[str, Any]):
    env = SimyardVectorEnv(3, **options, autoreset_mode="Disabled", reward=lambda step: step.after.time_s * 2.0)
    env.reset(seed=0)
    assert env.step(np.zeros((3, 2), np.float32))[1].tolist() == pytest.approx([0.1] * 3)

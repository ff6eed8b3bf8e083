"""Environments of robots that see colours, and of stacks: what is trained on is what a batch shows a network."""

import shutil
from pathlib import Path
from typing import Any, cast

import gymnasium
import numpy as np
import onnx
import pytest
import yaml
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from gymnasium.wrappers import FrameStackObservation
from onnx import helper, numpy_helper

from simyard.gym import SimyardEnv, SimyardVectorEnv
from specs.data.episode import ApplicationLaunch, EpisodeRequest, EpisodeResult
from specs.errors import DocumentError, SimyardError
from tasks.render.camera_pool import open_cameras
from tasks.simulate.host.onnx_policy import LaneNetwork
from tasks.simulate.host.policy_check import check_policy
from tasks.simulate.plan.chunks import Chunk
from tests.factories.simulations import COURIER, DELIVERY, FOLDERS, SCENARIO, cluttered, simulate_lanes
from tests.servers.tools import skip_or_fail
from tests.simyard.gym.test_vector_env import actions, require_same

LANES, FRAMES = 8, 3
CAMERA = {"columns": 16, "rows": 12, "rate_hz": 10.0, "latency_steps": 1, "light_spread": 0.3, "noise": 0.05}
PARTS = [{"field": "color", "scale": 1 / 255, "frames": FRAMES}, {"field": "goal_robot_m", "frames": FRAMES}]
SHOWN = FRAMES * (3 * 16 * 12 + 2)
DIGEST = "9" * 64


@pytest.fixture(scope="module")
def gl() -> None:
    try:
        with open_cameras(1):
            pass
    except SimyardError as exc:
        skip_or_fail(str(exc))


@pytest.fixture
def bundle(tmp_path: Path) -> Path:
    """Returns a bundle whose network drives by the noise of what it sees, and by what it saw before."""
    (tmp_path / "seer").mkdir()
    shutil.copy(FOLDERS[COURIER] / "robot.xml", tmp_path / "robot.xml")
    declared = {"color_camera": CAMERA, "inputs": [{"parts": PARTS}], "output": {"kind": "action"}}
    (tmp_path / "seer" / "seer.yaml").write_text(yaml.safe_dump(declared))
    weights = np.random.default_rng(3).normal(0.0, 0.2, (SHOWN, 2)).astype(np.float32)
    ends = [("shown", SHOWN), ("action", 2)]
    taken, given = (helper.make_tensor_value_info(name, onnx.TensorProto.FLOAT, ["n", size]) for name, size in ends)
    nodes = [helper.make_node("MatMul", ["shown", "w"], ["x"]), helper.make_node("Tanh", ["x"], ["action"])]
    graph = helper.make_graph(nodes, "seer", [taken], [given], [numpy_helper.from_array(weights, "w")])
    made = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    onnx.save(made, tmp_path / "seer" / "seer.onnx")
    return tmp_path


def in_a_batch(bundle: Path, worlds: dict[str, Any], duration_s: float) -> dict[tuple[str, int], EpisodeResult]:
    robot = ApplicationLaunch(name="s", version="1", digest=DIGEST, package="seer", launch_file="seer.onnx")
    places = [(world, seed) for world in worlds for seed in range(LANES // 2)]
    requests = tuple(
        EpisodeRequest(
            index=index,
            world=world,
            seed=seed,
            robot=robot,
            scenario=SCENARIO,
            environment={"GOALS": "1"},
            duration_s=duration_s,
        )
        for index, (world, seed) in enumerate(places)
    )
    folders = {DIGEST: bundle, DELIVERY: FOLDERS[DELIVERY]}
    rows = simulate_lanes(
        Chunk(number=0, requests=requests), worlds, folders, lanes=LANES, engine="planar", should_stop=lambda: False
    )
    return {places[row.index]: row for row in rows}


@pytest.mark.long
@pytest.mark.usefixtures("gl")
def test_a_network_of_stacked_pictures_has_the_same_episodes_in_training_as_in_a_batch(bundle: Path):
    drawn = [cluttered(seed) for seed in range(2)]
    worlds = {f"{each.generation}/{each.name}": each for each in drawn}
    rows = in_a_batch(bundle, worlds, 3.0)
    asked: dict[str, Any] = {"worlds": drawn, "seeds": list(range(LANES // 2)), "environment": {"GOALS": "1"}}
    asked |= {"robot": bundle, "launch": "seer/seer.onnx", "observation": ("color", "goal_robot_m"), "duration_s": 3.0}
    envs = SimyardVectorEnv(LANES, **asked, frames=FRAMES, autoreset_mode="SameStep")
    network = LaneNetwork(check_policy(bundle, "seer/seer.onnx"), LANES)
    seen, infos = envs.reset(seed=5)
    episodes = [(str(world), int(seed)) for world, seed in zip(infos["world"], infos["seed"], strict=True)]
    ended = dict[tuple[str, int], tuple[object, ...]]()
    for _ in range(3 * 60):
        color = (seen["color"].astype(np.float32) * np.float32(1 / 255)).reshape(LANES, -1)
        shown = np.concatenate([color, seen["goal_robot_m"].reshape(LANES, -1)], axis=1)
        seen, _, _, _, infos = envs.step(network.answer([shown], []).output)
        for lane in np.flatnonzero(infos.get("_final_info", [])).tolist():
            final = infos["final_info"]
            whole = tuple(final[name][lane] for name in ("reason", "simulated_s", "path_length_m", "collisions"))
            assert ended.setdefault(episodes[lane], whole) == whole
            episodes[lane] = (str(infos["world"][lane]), int(infos["seed"][lane]))
    assert len(ended) > LANES / 2
    figures = {
        place: (row.outcome_reason, row.simulated_s, row.path_length_m, row.collisions) for place, row in rows.items()
    }
    assert {place: figures[place] for place in ended} == ended
    assert len({row[2] for row in ended.values()}) == len(ended)


@pytest.mark.long
@pytest.mark.usefixtures("gl")
@pytest.mark.parametrize("mode", [AutoresetMode.SAME_STEP, AutoresetMode.NEXT_STEP])
def test_pictures_in_colour_are_bytes_and_the_same_alone_as_beside_others(mode: AutoresetMode, options: dict[str, Any]):
    sees: Any = {"sensors": {"color_camera": CAMERA}}
    own = SimyardVectorEnv(3, **options, **sees, autoreset_mode=mode)
    spaces: Any = own.single_observation_space
    assert spaces["color"] == gymnasium.spaces.Box(0, 255, (12, 16, 3), np.uint8)
    assert list(spaces) == ["color", "goal_robot_m"]
    beside = SyncVectorEnv([lambda: SimyardEnv(**options, **sees)] * 3, autoreset_mode=mode)
    require_same(own.reset(seed=5), beside.reset(seed=5))
    pictures = set[bytes]()
    for action in actions(0)[:30]:
        answer = own.step(action)
        require_same(answer, beside.step(action))
        assert answer[0] in own.observation_space
        pictures.add(answer[0]["color"].tobytes())
    assert len(pictures) > 10
    flat = SimyardVectorEnv(3, **options, **sees, flatten=True, observation=("goal_robot_m", "color"))
    seen, whole = flat.reset(seed=5)[0], own.reset(seed=5)[0]
    for action in actions(0)[:4]:
        seen, whole = flat.step(action)[0], own.step(action)[0]
    assert np.array_equal(seen[:, 2:], whole["color"].reshape(3, -1))
    assert np.array_equal(seen[:, :2], whole["goal_robot_m"])
    assert seen in flat.observation_space


@pytest.mark.parametrize("flatten", [False, True])
@pytest.mark.parametrize(
    "mode", [AutoresetMode.SAME_STEP, pytest.param(AutoresetMode.NEXT_STEP, marks=pytest.mark.long)]
)
def test_a_stack_is_that_of_gymnasiums_wrapper(mode: AutoresetMode, flatten: bool, options: dict[str, Any]):  # noqa: FBT001 - a case
    own = SimyardVectorEnv(3, **options, frames=FRAMES, flatten=flatten, autoreset_mode=mode)

    def one() -> gymnasium.Env[Any, Any]:
        return FrameStackObservation(SimyardEnv(**options, flatten=flatten), FRAMES)

    beside = SyncVectorEnv([one] * 3, autoreset_mode=mode)
    assert own.single_observation_space == beside.single_observation_space
    require_same(own.reset(seed=5), beside.reset(seed=5))
    for action in actions(0):
        require_same(own.step(action), beside.step(action))


def test_a_stack_of_one_robot_or_of_many_is_the_same(options: dict[str, Any]):
    alone, many = SimyardEnv(**options, frames=FRAMES), SimyardVectorEnv(3, **options, frames=FRAMES)
    first, before = alone.reset(seed=5)[0], many.reset(seed=5)[0]
    for action in actions(0)[:5]:
        require_same(first, {name: each[0] for name, each in before.items()})
        first, before = alone.step(action[0])[0], many.step(action)[0]
    before["goal_robot_m"][:] = 7.0
    assert many.step(actions(0)[5])[0]["goal_robot_m"][:, :2].max() < 7.0, "what was given is the caller's own"


def test_a_reset_of_some_begins_their_stacks_alone(options: dict[str, Any]):
    envs = SimyardVectorEnv(3, **options, frames=FRAMES)
    envs.reset(seed=5)
    before = [envs.step(action)[0] for action in actions(2)[:5]][-1]["goal_robot_m"]
    seen = envs.reset(seed=[1, 9, 1], options={"reset_mask": np.array([False, True, False])})[0]["goal_robot_m"]
    assert np.array_equal(seen[[0, 2]], before[[0, 2]])
    assert len(np.unique(seen[1], axis=0)) == 1
    assert len(np.unique(seen[0], axis=0)) == FRAMES


@pytest.mark.parametrize("frames", [0, 65, 2.0, True, "3"])
def test_a_number_of_frames_that_cannot_be_is_refused(frames: object, options: dict[str, Any]):
    with pytest.raises(DocumentError, match=r"frames: .*: a whole number from 1 to 64"):
        SimyardVectorEnv(3, **options, frames=cast("Any", frames))


def test_a_camera_that_cannot_be_is_refused(options: dict[str, Any]):
    with pytest.raises(DocumentError, match=r"color_camera\.columns"):
        SimyardVectorEnv(3, **options, sensors={"color_camera": {"columns": 0}})


@pytest.mark.long
@pytest.mark.usefixtures("gl")
def test_cameras_of_a_list_show_what_each_alone_shows(options: dict[str, Any]):
    front, rear = {**CAMERA, "noise": 0.0}, {**CAMERA, "noise": 0.0, "yaw_rad": 3.0}
    depth = {"columns": 8, "rows": 6}
    listed: Any = {
        "color_camera": [{**front, "name": "front"}, {**rear, "name": "rear"}],
        "depth_camera": [{**depth, "name": "front"}, {**depth, "name": "rear", "yaw_rad": 3.0}],
    }
    both = SimyardVectorEnv(2, **options, sensors=listed)
    spaces: Any = both.single_observation_space
    assert (spaces["color"].shape, spaces["depth_m"].shape) == ((2, 12, 16, 3), (2, 6, 8))
    alone = [
        SimyardVectorEnv(2, **options, sensors={"color_camera": color, "depth_camera": {**depth, "yaw_rad": yaw_rad}})
        for color, yaw_rad in ((front, 0.0), (rear, 3.0))
    ]
    for envs in (both, *alone):
        envs.reset(seed=5)
    for action in actions(0)[:5]:
        seen, *each = (envs.step(action[:2])[0] for envs in (both, *alone))
        for name in ("color", "depth_m"):
            np.testing.assert_array_equal(seen[name], np.stack([one[name] for one in each], axis=1))
        assert (seen["depth_m"][:, 0] != seen["depth_m"][:, 1]).any()

"""What is trained is what is gated: a policy's episodes in a trainer's lanes are those of a batch, bit for bit."""

import inspect
import shutil
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from specs.data.episode import ApplicationLaunch, EpisodeRequest, EpisodeResult
from specs.data.world import World
from tasks.simulate.application.contract import REASONS
from tasks.simulate.plan.chunks import Chunk
from tasks.simulate.training.training_program import Task, TrainingLanes, View, training_program
from tests.factories.simulations import COURIER, DELIVERY, FOLDERS, SCENARIO, cluttered, simulate_lanes

BUNDLE = "9" * 64
EPISODES = 12
# The noise of its lidar is the episode's.
CODE = """
import numpy as np
from numpy.typing import NDArray

jax = False
Floats = NDArray[np.float32]


class Lidar:
    rays, range_m, height_m, sigma_m, dropout = 16, 6.0, 0.2, 0.02, 0.05


class Reactive:
    lidar = Lidar()

    def reset(self, floors, goals_m):
        pass

    def step(self, observed):
        return np.pad(decide(observed.ranges_m, observed.goal_robot_m), ((0, 0), (0, 1)))


def controllers(environments):
    return Reactive()
"""
Floats = NDArray[np.float32]


def decide(ranges_m: Floats, goal_robot_m: Floats) -> Floats:
    near = np.float32(0.1) / np.maximum(ranges_m, np.float32(0.05))
    push = (near[:, 9:16] - near[:, 1:8]).sum(axis=1, dtype=np.float32)
    left, apart = goal_robot_m[:, 1], np.abs(goal_robot_m).sum(axis=1, dtype=np.float32)
    turn = np.float32(2.0) * left / (apart + np.float32(0.1)) + push
    ahead = np.minimum(ranges_m[:, [15, 0, 1]].min(axis=1), np.float32(0.9)) - np.float32(0.35)
    return np.stack([ahead, np.clip(turn, np.float32(-2.0), np.float32(2.0))], axis=1)


@pytest.fixture
def bundle(tmp_path: Path) -> Path:
    (tmp_path / "reactive").mkdir()
    (tmp_path / "reactive" / "reactive.py").write_text(f"{CODE}\n\n{inspect.getsource(decide)}")
    shutil.copy(FOLDERS[COURIER] / "robot.xml", tmp_path / "robot.xml")
    return tmp_path


def requests(worlds: dict[str, World]) -> tuple[EpisodeRequest, ...]:
    robot = ApplicationLaunch(name="r", version="1", digest=BUNDLE, package="reactive", launch_file="reactive")
    names = list(worlds)
    return tuple(
        EpisodeRequest(
            index=index,
            world=names[index % len(names)],
            seed=index // len(names),
            robot=robot,
            scenario=SCENARIO,
            environment={"GOALS": "1"},
            duration_s=20.0,
        )
        for index in range(EPISODES)
    )


def in_a_batch(bundle: Path, worlds: dict[str, World]) -> list[EpisodeResult]:
    folders = {BUNDLE: bundle, DELIVERY: FOLDERS[DELIVERY]}
    chunk = Chunk(number=0, requests=requests(worlds))
    return simulate_lanes(chunk, worlds, folders, lanes=EPISODES, engine="planar", should_stop=lambda: False)


def figures(row: EpisodeResult) -> tuple[object, ...]:
    ended = (row.final_x_m, row.final_y_m, row.final_yaw_rad, row.path_length_m)
    return (row.outcome_reason, row.goals_reached, row.simulated_s, row.collisions, *ended)


@pytest.mark.long
def test_a_policy_has_the_same_episodes_in_training_as_in_a_batch(bundle: Path):
    worlds = {f"hand/apartment-{seed}": cluttered(seed) for seed in range(3)}
    rows = {row.index: figures(row) for row in in_a_batch(bundle, worlds)}
    asked = requests(worlds)
    task = Task(bundle, FOLDERS[DELIVERY], asked, tuple(worlds.items()))
    lanes = TrainingLanes(training_program(task, View(normalized=False), 24, autoreset=True), 24)
    seen = lanes.reset(np.ones(24, bool), list(range(24)))
    ended: dict[int, tuple[object, ...]] = {}
    for _ in range(2 * 400):
        result = lanes.step(decide(seen["ranges_m"], seen["goal_robot_m"]))
        seen, ends, episodes = result.observation, lanes.ends(), lanes.episodes()
        for lane in np.flatnonzero(result.terminated | result.truncated).tolist():
            pose = tuple(map(float, ends.pose[lane]))
            known = (REASONS[ends.reason[lane]], int(ends.goals_reached[lane]), float(ends.simulated_s[lane]))
            whole = (*known, int(ends.collisions[lane]), *pose, float(ends.path_length_m[lane]))
            assert ended.setdefault(int(episodes[lane]), whole) == whole
    assert len(ended) > EPISODES / 2
    assert {index: rows[index] for index in ended} == ended
    assert len({row[0] for row in rows.values()}) > 1

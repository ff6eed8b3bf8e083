"""Steps a second of a vector environment, beside Gymnasium's vectors of C MuJoCo and, where it is installed, IR-SIM.

`python -m benchmarks.training.vector_env`. Each does its own: Simyard's robots have furniture around them, a lidar, a
verdict and resets; Gymnasium's have a base with as many rays in a room of boxes (``mj_ray``), or nothing but a
pendulum; IR-SIM's have a lidar in a room of boxes. They take turns, so that what else the machine does slows all alike.
"""

import argparse
import importlib.util
import itertools
import os
import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import gymnasium
import mujoco
import numpy as np
from gymnasium import spaces
from gymnasium.vector import AsyncVectorEnv, SyncVectorEnv

from simyard.gym import SimyardVectorEnv

RAYS, RANGE_M, BOXES, CONTROL_STEPS = 32, 10.0, 24, 10
PLACES = [(float(x), float(y)) for x in (-4, -2, 2, 4) for y in (-4, -2, 0, 2, 4)] + [(0.0, 2.5), (0.0, -2.5)]


class MuJoCoRobot(gymnasium.Env[np.ndarray, np.ndarray]):
    """The courier's base in a room of boxes, with rays cast by MuJoCo, as one would write it."""

    def __init__(self) -> None:
        """Makes it."""
        boxes = "".join(f'<geom type="box" pos="{x} {y} .5" size=".3 .3 .5"/>' for x, y in PLACES)
        sides = ((5, 0, 0.1, 5), (-5, 0, 0.1, 5), (0, 5, 5, 0.1), (0, -5, 5, 0.1))
        walls = "".join(f'<geom type="box" pos="{x} {y} 1" size="{a} {b} 1"/>' for x, y, a, b in sides)
        self.model = mujoco.MjModel.from_xml_string(
            f'<mujoco><option timestep="0.005"/><worldbody>{walls}{boxes}<body name="base" pos="0 0 .2">'
            '<joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 1 0"/><joint type="hinge" axis="0 0 1"/>'
            '<geom type="sphere" size=".18" mass="2" condim="1"/><site name="drive"/></body></worldbody><actuator>'
            '<velocity site="drive" gear="1 0 0 0 0 0" kv="40" ctrlrange="-1 1"/>'
            '<velocity site="drive" gear="0 0 0 0 0 1" kv="1" ctrlrange="-3 3"/></actuator></mujoco>'
        )
        self.data = mujoco.MjData(self.model)
        self.observation_space = spaces.Box(0.0, RANGE_M, (RAYS + 2,), np.float32)
        self.action_space = spaces.Box(-1.0, 1.0, (2,), np.float32)
        self._angles = 2 * np.pi * np.arange(RAYS) / RAYS
        self._ranges, self._hit = np.zeros(RAYS), np.zeros(RAYS, np.int32)

    def reset(self, *, seed: int | None = None, options: object = None) -> tuple[np.ndarray, dict[str, object]]:  # noqa: ARG002 - Gymnasium's form
        """Begins an episode."""
        super().reset(seed=seed)
        mujoco.mj_resetData(self.model, self.data)
        mujoco.mj_forward(self.model, self.data)
        return self._seen(), {}

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, object]]:
        """Drives a control step."""
        self.data.ctrl[:] = action
        mujoco.mj_step(self.model, self.data, CONTROL_STEPS)
        return self._seen(), 0.0, False, bool(self.data.time > 30.0), {}

    def _seen(self) -> np.ndarray:
        turn = self.data.qpos[2] + self._angles
        rays = np.stack([np.cos(turn), np.sin(turn), np.zeros(RAYS)], axis=1).ravel()
        place = np.array([*self.data.qpos[:2], 0.2])
        mujoco.mj_multiRay(self.model, self.data, place, rays, None, 1, 1, self._hit, self._ranges, None, RAYS, RANGE_M)
        ranges = np.where(self._ranges < 0.0, RANGE_M, self._ranges)
        return np.concatenate([ranges, self.data.qpos[:2]]).astype(np.float32)


class Stepped(NamedTuple):
    """What is measured.

    Attributes:
        robots: Control steps of so many in one call.
    """

    told: str
    robots: int
    step: Callable[[], object]
    close: Callable[[], object]


def stepped_vector(told: str, envs: gymnasium.vector.VectorEnv) -> Stepped:
    """Returns a vector with actions drawn before."""
    envs.reset(seed=0)
    actions = itertools.cycle([envs.action_space.sample() for _ in range(16)])
    return Stepped(told, envs.num_envs, lambda: envs.step(next(actions)), envs.close)


def stepped_irsim(folder: Path) -> Stepped:
    """Returns IR-SIM with one robot."""
    import irsim  # noqa: PLC0415 - where it is installed  # pyright: ignore[reportMissingImports]

    boxes = "\n".join(
        f"  - shape: {{name: rectangle, length: 0.6, width: 0.6}}\n    state: [{x + 5}, {y + 5}, 0]" for x, y in PLACES
    )
    world = (
        "world: {height: 10, width: 10, step_time: 0.05, control_mode: auto}\nrobot:\n  - kinematics: {name: diff}\n"
        "    shape: {name: circle, radius: 0.18}\n    state: [5, 5, 0]\n    behavior: {name: dash}\n    sensors:\n"
        f"      - {{name: lidar2d, range_min: 0, range_max: {RANGE_M}, angle_range: 6.28, number: {RAYS}}}\n"
        f"obstacle:\n{boxes}\n"
    )
    path = folder / "room.yaml"
    path.write_text(world)
    env = irsim.make(str(path), headless=True, log_level="ERROR")
    action = np.array([[0.1], [0.5]])
    return Stepped(f"IR-SIM, 1 robot, {RAYS} rays", 1, lambda: (env.step(action), env.get_lidar_scan()), env.end)


def all_stepped(folder: Path) -> list[Stepped]:
    """Returns what is measured, as far as it is installed: the vector that all are held against first."""
    lidar = {"lidar": {"rays": RAYS, "range_m": RANGE_M}}
    makers = [MuJoCoRobot] * 16
    there = [
        stepped_vector(f"Simyard, {robots} robots, {RAYS} rays", SimyardVectorEnv(robots, sensors=lidar, flatten=True))
        for robots in (1024, 256)
    ]
    there.append(stepped_vector(f"Gymnasium SyncVectorEnv, 16 MuJoCo robots, {RAYS} rays", SyncVectorEnv(makers)))
    apart = AsyncVectorEnv(makers, context="spawn")
    there.append(stepped_vector(f"Gymnasium AsyncVectorEnv, 16 MuJoCo robots, {RAYS} rays", apart))
    if importlib.util.find_spec("imageio"):  # which Gymnasium's own robots need
        pendulum = gymnasium.make_vec("InvertedPendulum-v5", 16, vectorization_mode="sync")
        there.append(stepped_vector("Gymnasium InvertedPendulum-v5, sync, 16, no rays", pendulum))
    if importlib.util.find_spec("irsim"):
        there.append(stepped_irsim(folder))
    return there


def steps_a_second(stepped: Stepped, seconds: float) -> float:
    """Returns control steps a second of all robots."""
    began, count = time.perf_counter(), 0
    while time.perf_counter() - began < seconds:
        stepped.step()
        count += stepped.robots
    return count / (time.perf_counter() - began)


def main() -> None:
    """Prints the table."""
    asked = argparse.ArgumentParser(description=__doc__)
    asked.add_argument("--turns", type=int, default=7)
    asked.add_argument("--seconds", type=float, default=2.0, help="of a turn")
    given = asked.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        there = all_stepped(Path(folder))
        for each in there:
            each.step(), each.step()  # pyright: ignore[reportUnusedExpression] - what compiles is not measured
        turns = [[steps_a_second(each, given.seconds) for each in there] for _ in range(given.turns)]
        for each in there:
            each.close()
    first = statistics.median(turn[0] for turn in turns)
    for place, each in enumerate(there):
        rates = [turn[place] for turn in turns]
        median = statistics.median(rates)
        spread = f"{min(rates):>9,.0f} to {max(rates):>9,.0f}"
        print(f"{each.told:<58} {median:>9,.0f} steps/s, {spread} {first / median:>7.1f} x")
    print(f"load {os.getloadavg()[0]:.1f}")


if __name__ == "__main__":
    main()

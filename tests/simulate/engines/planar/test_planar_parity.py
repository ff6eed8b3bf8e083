"""Ten seconds among posts, blocks and walls: the planar engine ends where C MuJoCo does with all solids of the world.

Contact is chaotic: C itself, begun a micrometre to the side, ends 0.3 mm off at worst in these pens. So most robots are
held to a bound here, and each control step by itself, from C's own states, to a far narrower one.
"""

from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np
import pytest

from specs.data.episode import CONTROL_S
from specs.data.world import World
from tasks.simulate.engines.planar.planar_robot import PlanarRobot
from tasks.simulate.geometry.obstacles import obstacles, pad_obstacles
from tests.factories.planar import CAPSULE, ROUGH, Obstacles, Parts, drive_planar, read, write_robot
from tests.factories.simulations import pen, with_prisms, with_wedges
from tests.simulate.reference import reference_model

pytestmark = pytest.mark.long

STEPS = 200
LANES = 48
WORLDS = [pen(4.5, seed) for seed in range(4)]
EMPTY = [pen(40.0, 9).model_copy(update={"furniture": ()})]
ARM = """<geom name="arm" type="capsule" size="0.1 0.05" pos="-0.14 0.03 0" mass="1" condim="3" friction="0.3"/>"""
# Prisms of 3 to 8 corners, and walls that are prisms, too.
WEDGED = [with_prisms(with_wedges(world, number)) for number, world in enumerate(WORLDS)]
ROBOTS: dict[str, Parts] = {
    "sphere": {},
    "rough capsule": {**CAPSULE, **ROUGH},
    "two discs off the axis": {"hull/size": "0.15", "hull/pos": "0.08 0.02 0", "more": ARM},
    "sphere among prisms": {},
    "rough sphere among prisms": ROUGH,
}


class Drives(NamedTuple):
    """Robots that were driven blindly: poses of the engine and of C, (lanes, steps, 3).

    Attributes:
        contact_share: Of C's physics steps, for each lane.
        control_step_m: How far apart a single control step ends that begins in C's state.
    """

    ours: np.ndarray
    theirs: np.ndarray
    contact_share: np.ndarray
    control_step_m: np.ndarray

    def deviations_m(self) -> np.ndarray:
        """Returns how far apart each lane ever was."""
        return np.hypot(*np.moveaxis(self.ours - self.theirs, -1, 0)[:2]).max(axis=1)


def wandering(seed: int) -> np.ndarray:
    """Returns controls that wander, (steps, lanes, 3)."""
    rng = np.random.default_rng(seed)
    drift, found = rng.normal(0.0, 1.0, (LANES, 2)), []
    for _ in range(STEPS):
        drift = 0.95 * drift + rng.normal(0.0, 0.31, (LANES, 2))
        found.append(np.stack([0.5 + 0.3 * drift[:, 0], 0.8 * drift[:, 1], np.zeros(LANES)], axis=1))
    return np.array(found, np.float32)


def in_c(model: mujoco.MjModel, start: np.ndarray, controls: np.ndarray) -> tuple[np.ndarray, float]:
    """Returns one robot's states before and after each control step, (steps + 1, 6), and its share of contact."""
    data = mujoco.MjData(model)
    data.qpos[:3] = start
    states, touching, steps = [np.r_[data.qpos, data.qvel]], 0, round(CONTROL_S / model.opt.timestep)
    for control in controls:
        data.ctrl[:] = control
        for _ in range(steps):
            mujoco.mj_step(model, data)
            touching += data.ncon > 0
        states.append(np.r_[data.qpos, data.qvel])
    return np.array(states), touching / (steps * len(controls))


def surroundings(robot: PlanarRobot, worlds: list[World], lanes: int) -> Obstacles:
    """Returns each lane's obstacles; lanes take the worlds in turn."""
    near = pad_obstacles([obstacles(world, robot.hull.low_m, robot.hull.high_m) for world in worlds])
    turn = [near[lane % len(worlds)] for lane in range(lanes)]
    return Obstacles(*(np.stack(kind) for kind in zip(*turn, strict=True)))


def driven(path: Path, worlds: list[World]) -> Drives:
    """Returns robots that wander through worlds, on the engine and in C."""
    robot, rng = read(path), np.random.default_rng(5)
    controls = wandering(3)
    starts = np.column_stack([rng.uniform(-0.2, 0.2, (LANES, 2)), rng.uniform(-3.0, 3.0, LANES)]).astype(np.float32)
    around = surroundings(robot, worlds, LANES)
    ours = drive_planar(robot, around, starts, controls)
    models = [reference_model(path, world) for world in worlds]
    in_c_too = [in_c(models[k % len(worlds)], starts[k], controls[:, k]) for k in range(LANES)]
    states = np.stack([each for each, _ in in_c_too], axis=1)
    again = drive_planar(robot, around, starts, controls, states[:-1]).body.qpos
    return Drives(
        ours=np.swapaxes(ours.body.qpos, 0, 1),
        theirs=np.swapaxes(states[1:, :, :3], 0, 1),
        contact_share=np.array([share for _, share in in_c_too]),
        control_step_m=np.abs(again - states[1:, :, :3])[..., :2].max(axis=-1),
    )


@pytest.fixture(
    scope="module",
    params=["sphere", *(pytest.param(name, marks=pytest.mark.long) for name in ROBOTS if name != "sphere")],
)
def bumping(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Drives:
    """Each robot in the pens."""
    worlds = WEDGED if "prisms" in request.param else WORLDS
    return driven(write_robot(tmp_path_factory.mktemp("robot"), ROBOTS[request.param]), worlds)


def test_robots_bump_into_things(bumping: Drives):
    assert np.median(bumping.contact_share) > 0.2


def test_the_median_deviation_is_below_five_micrometres(bumping: Drives):
    assert np.median(bumping.deviations_m()) < 5e-6


def test_nine_robots_of_ten_stay_within_a_tenth_of_a_millimetre(bumping: Drives):
    assert np.quantile(bumping.deviations_m(), 0.9) < 1e-4


def test_robots_in_heavy_contact_deviate_no_more(bumping: Drives):
    heavy = bumping.contact_share > 0.3
    assert heavy.sum() >= 8
    assert np.quantile(bumping.deviations_m()[heavy], 0.9) < 1e-4


def test_a_control_step_ends_within_a_micrometre_of_cs(bumping: Drives):
    """But for touches that begin a step sooner or later, by the last bit of a distance."""
    assert np.quantile(bumping.control_step_m, 0.999) < 1e-6


def test_robots_that_touch_nothing_stay_within_ten_micrometres(tmp_path: Path):
    free = driven(write_robot(tmp_path, {}), EMPTY)
    assert not free.contact_share.any()
    assert free.deviations_m().max() < 1e-5

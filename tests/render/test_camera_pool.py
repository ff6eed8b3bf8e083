"""Cameras on robots: depth, solids and colours of what they see, drawn by processes of their own."""

import itertools
import math
import os
import signal
import subprocess
import time
from collections.abc import Generator, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext
from pathlib import Path
from tempfile import TemporaryFile
from threading import Event
from types import SimpleNamespace
from typing import Any

import mujoco
import numpy as np
import pytest

from specs.bundle_files import ColorCameraDeclaration
from specs.data.robot_shape import RobotPart
from specs.data.world import Solid, World, solids
from specs.errors import SimyardError
from tasks.export.format.mjcf import add_solid_geom
from tasks.render import camera_pool
from tasks.render.camera_pool import CameraPool, Shot, open_cameras
from tasks.render.camera_scene import FLOOR, camera_scene
from tasks.render.gl_process import DrawingFailed, GlProcess
from tests.factories.own_worlds import walled_hall
from tests.factories.worlds import apartment
from tests.servers.tools import skip_or_fail

CAMERA = ColorCameraDeclaration(columns=64, rows=48, fov_rad=1.2, z_m=0.4, x_m=0.1, pitch_rad=0.1, yaw_rad=0.05)
CEILING_M = apartment().ceiling_height_m
RED = (1.0, 0.0, 0.0)
TIP = ((0.0, 0.0, 0.0), (0.02, 0.0, 0.0), (0.0, 0.02, 0.0), (0.0, 0.0, 0.05))


def furnished() -> World:
    """Returns the apartment with a turned box, a cylinder and a prism on the floor around the origin."""
    box = Solid(
        name="box", shape="box", center_m=(0.9, 0.4, 0.3), half_extents_m=(0.2, 0.1, 0.3), yaw_rad=0.7, color=RED
    )
    round_one = box.model_copy(
        update={"name": "round", "shape": "cylinder", "center_m": (-0.9, 0.6, 0.25), "half_extents_m": (0.3, 0.3, 0.25)}
    )
    prism = Solid(
        name="prism",
        shape="prism",
        center_m=(0.2, -1.1, 0.4),
        half_extents_m=(0.3, 0.2, 0.4),
        yaw_rad=-0.4,
        color=(0.1, 0.2, 0.9),
        outline_m=((-0.3, -0.2), (0.3, -0.2), (0.0, 0.2)),
    )
    return apartment().model_copy(update={"version": "2", "walls": (*apartment().walls, box, round_one, prism)})


@pytest.fixture(scope="module")
def cameras() -> Generator[CameraPool, None, None]:
    try:
        with open_cameras(2) as pool:
            pool.add("plain", furnished(), CAMERA)
            yield pool
    except SimyardError as exc:
        if "no GL is there" not in str(exc):
            raise
        skip_or_fail(str(exc))


def poses(count: int) -> list[Shot]:
    """Returns where a robot stands in the living room, turned anyhow."""
    rng = np.random.default_rng(7)
    drawn = zip(
        rng.uniform(-0.4, 0.4, (count, 2)).tolist(), rng.uniform(-math.pi, math.pi, count).tolist(), strict=True
    )
    return [Shot("plain", x_m, y_m, yaw_rad, seed=number) for number, ((x_m, y_m), yaw_rad) in enumerate(drawn)]


class Rays:
    """A world's solids, and the rays of CAMERA's pixels: MuJoCo's own, against shapes that are no meshes."""

    def __init__(self, world: World) -> None:
        spec = mujoco.MjSpec()
        for solid in solids(world):
            add_solid_geom(spec, solid, 0)
        for name, z_m in (("floor", -1.0), ("ceiling", CEILING_M + 1.0)):
            spec.worldbody.add_geom(name=name, type=mujoco.mjtGeom.mjGEOM_BOX, pos=[0, 0, z_m], size=[50, 50, 1])
        self._model = spec.compile()
        self.names = [self._model.geom(number).name for number in range(self._model.ngeom)]
        self._data = mujoco.MjData(self._model)
        mujoco.mj_forward(self._model, self._data)

    def depths(self, shot: Shot) -> tuple[np.ndarray, np.ndarray]:
        """Returns how far ahead each pixel's ray hits something, and which geom."""
        yaw_rad, tilt_rad = shot.yaw_rad + CAMERA.yaw_rad, CAMERA.pitch_rad
        cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
        turn = np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1.0]])
        tilt = np.array(
            [[math.cos(tilt_rad), 0, math.sin(tilt_rad)], [0, 1, 0], [-math.sin(tilt_rad), 0, math.cos(tilt_rad)]]
        )
        focal_px = CAMERA.columns / 2 / math.tan(CAMERA.fov_rad / 2)
        left = -(np.arange(CAMERA.columns) + 0.5 - CAMERA.columns / 2) / focal_px
        up = -(np.arange(CAMERA.rows) + 0.5 - CAMERA.rows / 2) / focal_px
        ahead = np.stack([np.ones((len(up), len(left))), *np.meshgrid(left, up)], axis=-1).reshape(-1, 3)
        lengths = np.linalg.norm(ahead, axis=1)
        directions = (ahead / lengths[:, None]) @ (turn @ tilt).T
        cos, sin = math.cos(shot.yaw_rad), math.sin(shot.yaw_rad)
        place = np.array([shot.x_m + cos * CAMERA.x_m, shot.y_m + sin * CAMERA.x_m, CAMERA.z_m])
        hit, away_m = np.zeros(len(ahead), np.int32), np.zeros(len(ahead))
        mujoco.mj_multiRay(
            self._model, self._data, place, directions.ravel(), None, 1, -1, hit, away_m, None, len(ahead), 200.0
        )
        return (away_m / lengths).reshape(CAMERA.rows, CAMERA.columns), hit.reshape(CAMERA.rows, CAMERA.columns)


def without_edges(hit: np.ndarray) -> np.ndarray:
    """Returns which pixels see what all their neighbours see."""
    wide = np.pad(hit, 1, mode="edge")
    rows, columns = hit.shape
    beside = [wide[1 + y : 1 + y + rows, 1 + x : 1 + x + columns] for y, x in itertools.product((-1, 0, 1), repeat=2)]
    return np.all([each == hit for each in beside], axis=0)


def test_depths_are_those_of_rays_within_a_millimetre_and_numbers_name_the_solid(cameras: CameraPool):
    shots, rays = poses(40), Rays(furnished())
    names = [*(solid.name for solid in solids(furnished())), "floor", "ceiling"]
    assert rays.names == names
    inner, seen = 0, set[str]()
    for shot, depth_m, number in zip(shots, *cameras.depth_and_solids(shots), strict=True):
        exact_m, hit = rays.depths(shot)
        kept = without_edges(hit)
        np.testing.assert_array_equal(number[kept], hit[kept])
        # A facet of a cylinder is as near as its circle straight ahead, and anywhere at its rim.
        straight = kept & (hit != names.index("round"))
        np.testing.assert_allclose(depth_m[straight], exact_m[straight], rtol=0.0, atol=1e-3)
        assert np.median(np.abs(depth_m - exact_m)[kept]) < 1e-4
        inner += int(kept.sum())
        seen |= {names[each] for each in np.unique(number)}
    assert {"box", "round", "prism", "floor", "ceiling"} <= seen
    assert inner > 0.8 * len(shots) * CAMERA.rows * CAMERA.columns


def test_the_corners_of_a_box_are_where_the_focal_length_says(cameras: CameraPool):
    shot = Shot("plain", -0.4, 0.3, 0.0)
    _, numbers = cameras.depth_and_solids([shot])
    box = next(solid for solid in solids(furnished()) if solid.name == "box")
    rows, columns = np.nonzero(numbers[0] == [solid.name for solid in solids(furnished())].index("box"))
    cos, sin = math.cos(box.yaw_rad), math.sin(box.yaw_rad)
    focal_px = CAMERA.columns / 2 / math.tan(CAMERA.fov_rad / 2)
    across: list[float] = []
    down: list[float] = []
    for u, v, w in itertools.product((-1, 1), repeat=3):
        x = box.center_m[0] + u * box.half_extents_m[0] * cos - v * box.half_extents_m[1] * sin - shot.x_m - CAMERA.x_m
        y = box.center_m[1] + u * box.half_extents_m[0] * sin + v * box.half_extents_m[1] * cos - shot.y_m
        z = box.center_m[2] + w * box.half_extents_m[2] - CAMERA.z_m
        turned = math.cos(CAMERA.yaw_rad) * x + math.sin(CAMERA.yaw_rad) * y
        left = math.cos(CAMERA.yaw_rad) * y - math.sin(CAMERA.yaw_rad) * x
        ahead = math.cos(CAMERA.pitch_rad) * turned - math.sin(CAMERA.pitch_rad) * z
        up = math.sin(CAMERA.pitch_rad) * turned + math.cos(CAMERA.pitch_rad) * z
        across.append(CAMERA.columns / 2 - focal_px * left / ahead)
        down.append(CAMERA.rows / 2 - focal_px * up / ahead)
    assert columns.min() == pytest.approx(min(across), abs=1.0)
    assert columns.max() + 1 == pytest.approx(max(across), abs=1.0)
    assert rows.min() == pytest.approx(min(down), abs=1.0)
    assert rows.max() + 1 == pytest.approx(max(down), abs=1.0)


def test_a_picture_is_the_same_bytes_alone_and_beside_others_whoever_draws_it(cameras: CameraPool):
    errors = {"light_spread": 0.3, "tint_spread": 0.2, "light_tilt_rad": 0.6, "exposure_spread": 0.1}
    rough = CAMERA.model_copy(update={**errors, "blur_px": 0.7, "noise": 0.02})
    cameras.add("rough", furnished(), rough)
    shots = [shot._replace(key=key) for shot in poses(4) for key in ("rough", "plain")]
    together = cameras.color(shots)
    assert together.shape == (8, 48, 64, 3)
    for shot, picture in zip(shots, together, strict=True):
        np.testing.assert_array_equal(cameras.color([shot])[0], picture)
    np.testing.assert_array_equal(cameras.color(shots[::-1])[::-1], together)
    other = cameras.color([shots[0]._replace(seed=99), shots[0]._replace(number=1), shots[1]._replace(seed=99)])
    differs = (other[:2] != together[0]).mean(axis=(1, 2, 3))
    assert differs.min() > 0.3, "another episode has another light, and each picture its noise"
    np.testing.assert_array_equal(other[2], together[1])  # without spread there is one light
    one, another = cameras.color([shots[0]._replace(seed=(1 << 63) + number) for number in (5, 6)])
    assert (one != another).mean() > 0.3, "all 64 bits of a seed count"


def test_cameras_that_were_forgotten_draw_the_same(cameras: CameraPool, monkeypatch: pytest.MonkeyPatch):
    cameras.add("high", furnished(), CAMERA.model_copy(update={"z_m": 0.8}))
    shots = [shot._replace(key=key) for shot in poses(2) for key in ("plain", "high")]
    before = cameras.color(shots)
    monkeypatch.setattr(camera_pool, "_WORLDS_KEPT", 1)
    np.testing.assert_array_equal(cameras.color(shots), before)


@pytest.mark.long
def test_a_process_that_was_killed_is_started_again_and_draws_the_same(cameras: CameraPool):
    shots = poses(6)
    before = cameras.color(shots)
    for pid in cameras.pids:
        os.kill(pid, signal.SIGKILL)
    np.testing.assert_array_equal(cameras.color(shots), before)


def test_from_within_a_solid_its_inside_is_seen(cameras: CameraPool):
    cameras.add("low", furnished(), CAMERA.model_copy(update={"z_m": 0.2}))
    depth_m, numbers = cameras.depth_and_solids([Shot("low", -0.95, 0.6, 0.3)])
    names = [*(solid.name for solid in solids(furnished())), "floor", "ceiling"]
    assert {names[number] for number in np.unique(numbers)} <= {"round", "floor"}
    assert depth_m.max() < 0.7


def test_a_box_has_its_colour(cameras: CameraPool):
    shots = [Shot("plain", -0.4, 0.3, 0.0)]
    _, numbers = cameras.depth_and_solids(shots)
    box = numbers[0] == [solid.name for solid in solids(furnished())].index("box")
    red, green, blue = cameras.color(shots)[0][box].T
    assert red.min() > 80
    assert max(green.max(), blue.max()) == 0


def test_processes_that_stand_are_the_same_for_whoever_asks_next(monkeypatch: pytest.MonkeyPatch):
    started: list[Any] = []

    def start() -> Any:  # noqa: ANN401 - as the pool has it
        started.append(SimpleNamespace(process=SimpleNamespace(gl="none", pid=len(started), close=lambda: None)))
        return started[-1]

    monkeypatch.setattr(camera_pool, "_Drawer", start)
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0, 1, 2})
    monkeypatch.setenv("MUJOCO_GL", "one of this test")
    assert [len(camera_pool.standing_cameras(most).pids) for most in (1, 2, 1, 9)] == [1, 2, 1, 3]
    assert len(started) == 3


def test_a_process_that_could_not_be_started_again_is_started_for_whoever_asks_next(monkeypatch: pytest.MonkeyPatch):
    with subprocess.Popen(["true"], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as ended, TemporaryFile() as said:
        sound = SimpleNamespace(gl="none", pid=0, ask=lambda _what, _line, length: bytes(length), close=lambda: None)
        starts: Iterator[Any] = iter([GlProcess(ended, "none", said), None, sound])
        monkeypatch.setattr(camera_pool, "start_gl_process", lambda *_, **__: next(starts))
        monkeypatch.setenv("MUJOCO_GL", "another one of this test")
        for room in (False, True):
            pool = camera_pool.standing_cameras(1)
            pool.add("plain", furnished(), CAMERA)
            with nullcontext() if room else pytest.raises(DrawingFailed, match="no GL is there"):
                assert len(pool.color(poses(1))) == 1


def test_it_sees_its_own_robot_where_that_stands_if_it_was_given(cameras: CameraPool):
    arm = RobotPart(
        kind="box",
        size=(0.05, 0.02, 0.02),
        position_m=(0.4, 0.1, 0.4),
        turn=(math.cos(0.2), 0.0, 0.0, math.sin(0.2)),
        color=(0.0, 1.0, 0.0, 1.0),
        outline_m=(),
        top_m=0.42,
    )
    level = CAMERA.model_copy(update={"pitch_rad": 0.0, "yaw_rad": 0.0})
    cameras.add("alone", furnished(), level)
    cameras.add("armed", furnished(), level, (arm, arm.model_copy(update={"kind": "mesh", "vertices_m": TIP})))
    shots = poses(3)
    alone, armed = (cameras.color([shot._replace(key=key) for shot in shots]) for key in ("alone", "armed"))
    for without, seen in zip(alone, armed, strict=True):
        own = (without != seen).any(axis=2)
        red, green, blue = seen[own].T
        assert green.min() > 80, "it has its colour"
        assert max(red.max(), blue.max()) == 0
        np.testing.assert_array_equal(own, (alone[0] != armed[0]).any(axis=2))  # it goes where the camera goes
        # 0.3 m ahead of the camera, 0.1 m to the left of its axis, and the tip above it.
        rows, columns = np.nonzero(own)
        focal_px = CAMERA.columns / 2 / math.tan(CAMERA.fov_rad / 2)
        assert columns.mean() == pytest.approx(CAMERA.columns / 2 - focal_px * 0.1 / 0.3, abs=3.0)
        assert rows.max() - CAMERA.rows / 2 == pytest.approx(focal_px * 0.02 / 0.25, abs=1.5)


def test_its_processes_end_with_the_block(cameras: CameraPool, monkeypatch: pytest.MonkeyPatch):
    del cameras  # only asked for so that the test is skipped where there is no GL
    monkeypatch.setenv("MUJOCO_GL", "disable")  # as a process that simulates has it
    with open_cameras(1) as pool:
        (pid,) = pool.pids
        assert Path(f"/proc/{pid}").exists()
    assert not Path(f"/proc/{pid}").exists()


@pytest.mark.long
def test_a_process_that_ends_twice_is_an_error_that_says_why(cameras: CameraPool):
    twice = furnished().model_copy(update={"walls": (), "doors": (), "furniture": (), "ceiling_height_m": math.nan})
    cameras.add("broken", twice, CAMERA)
    with pytest.raises(
        SimyardError,
        match=r"(?s)a camera's picture failed.*: twice, at the same pictures, with (egl|osmesa): .*; set MUJOCO_GL",
    ):
        cameras.color([Shot("broken", 0.0, 0.0, 0.0)])
    assert cameras.color(poses(2)).any()


def test_without_gl_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("MUJOCO_GL", "nonsense")
    with (
        pytest.raises(SimyardError, match=r"no camera's picture: no GL is there .*apt-get install libosmesa6"),
        open_cameras(1),
    ):
        pytest.fail("there is no GL")


def test_an_imported_hall_has_no_ceiling_as_for_a_depth_camera():
    assert camera_scene(walled_hall(), 8, 8).names[-1] == FLOOR


def test_where_one_process_fails_the_others_are_waited_for():
    failed, ended = Event(), list[str]()

    def fail(*_: object) -> bytes:
        failed.set()
        raise SimyardError("it hangs")

    def draw(*_: object) -> bytes:
        failed.wait()
        time.sleep(0.2)
        ended.append("other")
        return bytes(CAMERA.rows * CAMERA.columns * 3)

    drawers: Any = [SimpleNamespace(process=SimpleNamespace(gl="none"), draw=each) for each in (fail, draw)]
    with ThreadPoolExecutor(2) as executor:
        pool = CameraPool(drawers, executor)
        pool.add("plain", furnished(), CAMERA)
        with pytest.raises(SimyardError, match="it hangs"):
            pool.color(poses(2))
        assert ended == ["other"]

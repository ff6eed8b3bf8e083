"""What a depth camera sees of a world, and what MuJoCo's own rays measure."""

import jax
import numpy as np
import pytest
from jaxtyping import Float

from tasks.simulate.geometry.depth_picture import DepthScene, View, depth_picture, depth_scene, pad_scenes
from tasks.simulate.geometry.obstacles import PARKING_M
from tests.factories.simulations import COURIER, FOLDERS, cluttered, with_prisms, with_wedges
from tests.simulate.reference import reference_depths, visible_model

LEVEL = View(columns=16, rows=12, fov_rad=1.2, pitch_rad=0.0, range_m=8.0)
HIGH_M = 0.5


def scene(*boxes: tuple[float, ...], ceiling_m: float = 2.5) -> DepthScene:
    """Returns a scene of boxes: x, y, lowest, highest, half x, half y, cos yaw, sin yaw."""
    kinds = (np.array(given, np.float32).reshape(-1, n) for given, n in ((boxes, 8), ((), 5), ((), 29)))
    return pad_scenes([DepthScene(*kinds, ceiling_m=np.array([ceiling_m], np.float32))])[0]


def taken(seen: DepthScene, view: View, *eyes: tuple[float, ...]) -> Float[np.ndarray, "eyes rows columns"]:
    pictures = jax.jit(lambda seen, eyes: jax.lax.map(lambda eye: depth_picture(seen, eye, view), eyes))
    return np.asarray(pictures(seen, np.array(eyes, np.float32)))


def test_a_level_camera_sees_wall_floor_and_ceiling_where_they_are():
    (found,) = taken(scene((3.1, 0.0, 0.0, 9.0, 0.1, 50.0, 1.0, 0.0)), LEVEL, (1.0, 0.0, HIGH_M, 0.0))
    down = (np.arange(LEVEL.rows) + 0.5 - LEVEL.rows / 2) / LEVEL.focal_px
    wanted = np.minimum(np.where(down > 0, HIGH_M / np.abs(down), (2.5 - HIGH_M) / np.abs(down)), 2.0)
    np.testing.assert_allclose(found, np.broadcast_to(wanted[:, None], found.shape), rtol=1e-5)


def test_what_lies_to_the_left_stands_to_the_left_of_the_picture_and_what_is_far_is_not_there():
    post = (2.0, 0.5, 0.0, 9.0, 0.2, 0.2, 1.0, 0.0)
    (found,) = taken(scene(post, ceiling_m=1e6), LEVEL, (0.0, 0.0, HIGH_M, 0.0))
    middle = found[LEVEL.rows // 2 - 1]
    near = np.flatnonzero(middle < LEVEL.range_m)
    assert len(near) > 0
    assert near.max() < LEVEL.columns // 2
    assert middle[-1] == np.float32(LEVEL.range_m)


def test_worlds_are_filled_up_with_what_no_camera_sees():
    one, other = pad_scenes([depth_scene(cluttered(0)), depth_scene(cluttered(1))])
    assert [each.shape for each in one] == [each.shape for each in other]
    assert len(one.boxes) == 128
    assert one.boxes[-1, 0] == PARKING_M
    assert one.prisms.shape == (0, 29)


_WORLDS = {
    "boxes and cylinders": cluttered,
    "prisms": lambda seed: with_wedges(cluttered(seed), seed),
    "boxes as prisms": lambda seed: with_prisms(cluttered(seed)),
}
POSES = 24


@pytest.mark.long
@pytest.mark.parametrize("pitch_rad", [0.0, 0.5, -0.3])
@pytest.mark.parametrize("kind", _WORLDS)
def test_every_pixel_off_the_edges_is_within_a_millimetre_of_mujocos_ray(kind: str, pitch_rad: float):
    world = _WORLDS[kind](7)
    view = View(columns=48, rows=36, fov_rad=1.3, pitch_rad=pitch_rad, range_m=10.0)
    model, rng = visible_model(FOLDERS[COURIER] / "robot.xml", world), np.random.default_rng(3)
    eyes = np.column_stack(
        [rng.uniform(-0.9, 0.9, (POSES, 2)), rng.uniform(0.1, 1.2, POSES), rng.uniform(-4, 4, POSES)]
    )
    found = taken(pad_scenes([depth_scene(world)])[0], view, *map(tuple, eyes))
    wanted = np.array([reference_depths(model, view, eye) for eye in eyes.astype(np.float32).astype(np.float64)])
    off = np.abs(found - wanted) > 1e-3
    assert off.mean() < 2e-4
    # Where they differ, one of both meets what the other passes by: an edge.
    edges = np.zeros_like(off)
    for axis in (1, 2):
        for way in (-1, 1):
            edges |= np.abs(np.roll(wanted, way, axis) - wanted) > 0.01
    assert not (off & ~edges).any()

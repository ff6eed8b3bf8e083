"""Pictures of depth: when they are taken, when they arrive, how they err, and that no lane's hangs on another's."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Float

from tasks.simulate.application.contract import Body, Motion
from tasks.simulate.geometry.depth_picture import depth_scene, pad_scenes
from tasks.simulate.sensors import depth_camera
from tasks.simulate.sensors.depth_camera import DEPTH_CAMERA, DepthCamera, noisy_depths
from tasks.simulate.sensors.sensor import Drive, Situation, seed_words
from tests.factories.simulations import cluttered

CAMERA = DepthCamera(columns=12, rows=8, fov_rad=1.2, range_m=8.0, z_m=0.3)
TRUE_M = jnp.tile(jnp.linspace(0.5, 8.0, 200), (100, 1))
SEED, STEP = jnp.asarray(seed_words(7)), jnp.int32(11)
STEPS = 9
MANY = 16


def reported(**errors: float) -> Float[np.ndarray, "rows columns"]:
    return np.asarray(noisy_depths(TRUE_M, CAMERA.view, errors, SEED, STEP))


def test_without_errors_depths_are_the_same_bits():
    np.testing.assert_array_equal(reported(), TRUE_M)


def test_noise_grows_with_the_square_of_the_depth():
    off = reported(sigma_m_per_m2=0.002) - TRUE_M
    near, far = off[:, 13].std(), off[:, 93].std()  # 0.99 m and 4.00 m
    assert near == pytest.approx(0.002, rel=0.3)
    assert far == pytest.approx(0.032, rel=0.3)


def test_disparity_comes_in_steps():
    focal_px, baseline_m, disparity_px = CAMERA.view.focal_px, 0.05, 0.125
    found = reported(baseline_m=baseline_m, disparity_px=disparity_px)[0, :-1]
    steps = focal_px * baseline_m / found / disparity_px
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-3)
    assert len(np.unique(found)) < 20


def test_what_is_lost_sees_nothing():
    found = reported(dropout=0.2)
    lost = found[:, :-1] == CAMERA.range_m
    assert lost.mean() == pytest.approx(0.2, abs=0.01)
    assert (found == TRUE_M)[:, :-1][~lost].all()


def test_edges_are_lost_and_nothing_beside_them():
    depth_m = jnp.full((8, 12), 2.0).at[2:5, 3:7].set(1.0)
    found = np.asarray(noisy_depths(depth_m, CAMERA.view, {"edge_dropout": 1.0, "edge_share": 0.1}, SEED, STEP))
    lost = found == CAMERA.range_m
    inside = np.zeros((8, 12), bool)
    inside[3, 4:6] = True
    rim = np.zeros((8, 12), bool)
    rim[1:6, 3:7] = rim[2:5, 2:8] = True
    np.testing.assert_array_equal(lost, rim & ~inside)


@pytest.mark.parametrize(
    ("rate_hz", "latency_steps", "stride", "slots"),
    [
        (0.0, 0, 1, 1),
        (10.0, 0, 2, 1),
        (10.0, 3, 2, 3),
        (20.0, 2, 1, 3),
        (7.0, 4, 3, 3),
        (0.5, 5, 40, 2),
        (1e-320, 0, 2**30, 1),
    ],
)
def test_rates_are_whole_fractions_and_what_is_on_its_way_is_kept(
    rate_hz: float, latency_steps: int, stride: int, slots: int
):
    camera = CAMERA._replace(rate_hz=rate_hz, latency_steps=latency_steps)
    assert (camera.pace.stride, camera.pace.slots) == (stride, slots)


def driven(camera: DepthCamera, lanes: int, first: int = 0) -> Float[np.ndarray, "lanes steps rows columns"]:
    """Returns what robots see that turn where they stand, each faster than the one before, begun at other steps."""
    worlds = pad_scenes([depth_scene(cluttered(k)) for k in range(MANY)])
    scenes: Any = jax.tree.map(lambda *each: jnp.stack(each[first : first + lanes]), *worlds)

    def situation(lane: jax.Array, step: jax.Array, scene: Any) -> Situation:  # noqa: ANN401 - a scene
        pose = jnp.stack([0.1 * lane % 0.5, 0.0 * lane, (0.1 + 0.01 * lane) * step])
        body = Body(pose, jnp.zeros(3), jnp.zeros(0), jnp.zeros(0))
        none: Any = None
        return Situation(body, none, jnp.asarray(seed_words(3)), step, scene)

    def lane_of(lane: jax.Array, scene: Any) -> jax.Array:  # noqa: ANN401 - a scene
        def advance(pictures: jax.Array, step: jax.Array) -> tuple[jax.Array, jax.Array]:
            now = situation(lane, step, scene)
            seen = DEPTH_CAMERA.observe(camera, camera, pictures, now)["depth_m"]
            work: Any = None
            motion = Motion(situation(lane, step + 1, scene).body, work, jnp.zeros(()))
            return DEPTH_CAMERA.feel(camera, camera, pictures, Drive(now, motion)), seen

        begun = DEPTH_CAMERA.begin(camera, camera, situation(lane, jnp.int32(0), scene))
        # Lanes whose episodes began elsewhere in time take their pictures at other steps than those beside them.
        waited = jax.lax.fori_loop(0, lane.astype(jnp.int32) % 3, lambda k, kept: advance(kept, k)[0], begun)
        return jax.lax.scan(advance, waited, lane.astype(jnp.int32) % 3 + jnp.arange(STEPS))[1]

    numbers = jnp.arange(first, first + lanes, dtype=jnp.float32)
    return np.asarray(jax.jit(jax.vmap(lane_of))(numbers, scenes))


@pytest.mark.long
def test_pictures_come_at_their_rate_and_arrive_late():
    every = driven(CAMERA, 1)[0]
    slow = driven(CAMERA._replace(rate_hz=7.0, latency_steps=2), 1)[0]
    assert (slow[:2] == np.float32(CAMERA.range_m)).all()
    for step in range(2, STEPS):
        np.testing.assert_array_equal(slow[step], every[(step - 2) // 3 * 3])
    assert len({picture.tobytes() for picture in every}) == STEPS


@pytest.mark.long
def test_a_lanes_pictures_are_the_same_bytes_alone_and_beside_others():
    camera = CAMERA._replace(rate_hz=10.0, latency_steps=1, sigma_m_per_m2=0.01, edge_dropout=0.5, dropout=0.01)
    together = driven(camera, MANY)
    assert driven(camera, 8, first=8).tobytes() == together[8:].tobytes()
    assert driven(camera, 1, first=5).tobytes() == together[5].tobytes()


@pytest.mark.long
def test_lanes_that_a_gpu_takes_at_once_see_the_same(monkeypatch: pytest.MonkeyPatch):
    camera = CAMERA._replace(rate_hz=10.0, latency_steps=1)
    monkeypatch.setattr(depth_camera, "device_kind", lambda: "gpu")
    at_once = driven(camera, MANY)
    monkeypatch.undo()
    np.testing.assert_allclose(at_once, driven(camera, MANY), atol=1e-5)


@pytest.mark.long
def test_cameras_of_a_list_see_what_each_alone_sees_with_errors_of_its_own():
    camera = CAMERA._replace(rate_hz=10.0, latency_steps=1, name="front")
    rear = camera._replace(name="rear", yaw_rad=3.0, pitch_rad=0.2, x_m=-0.1)
    noisy = {"sigma_m_per_m2": 0.01, "dropout": 0.05}
    both = driven(camera._replace(others=(rear, camera)), 2)
    assert both.shape == (2, STEPS, 3, 8, 12)
    for place, each in enumerate((camera, rear, camera)):
        np.testing.assert_array_equal(both[:, :, place], driven(each, 2))
    erring = driven(camera._replace(**noisy, others=(rear, camera._replace(**noisy))), 2)
    np.testing.assert_array_equal(erring[:, :, 0], driven(camera._replace(**noisy), 2))
    assert (erring[:, 2:, 2] != erring[:, 2:, 0]).mean() > 0.3

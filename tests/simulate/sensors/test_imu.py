"""What an inertial measurement unit reads: as MuJoCo's, where it is mounted, with the noise that is declared."""

from typing import Any

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from jaxtyping import Float

from specs.data.episode import CONTROL_S
from tasks.simulate.application.contract import Body, FreeJoints
from tasks.simulate.sensors.imu import COMPASS, Compass, Imu, ImuMemory, noisy, true_readings
from tasks.simulate.sensors.sensor import Situation, seed_words

G = 9.81
SEED = jnp.asarray(seed_words(5))
STEPS = 4000


def planar(pose: tuple[float, float, float], velocity: tuple[float, float, float]) -> Body:
    return Body(jnp.array(pose), jnp.array(velocity), jnp.zeros(0), jnp.zeros(3))


def test_a_robot_at_rest_feels_what_holds_it_up():
    still = planar((1.0, 2.0, 3.0), (0.0, 0.0, 0.0))
    np.testing.assert_allclose(true_readings(Imu(x_m=0.5), still, still), [0, 0, 0, 0, 0, G], atol=1e-6)


@pytest.mark.parametrize(
    ("mount", "force"),
    [(Imu(), (0.0, 1.0)), (Imu(x_m=0.25), (-1.0, 1.0)), (Imu(yaw_rad=np.pi / 2), (1.0, 0.0))],
    ids=["on the axis", "ahead of it", "turned to the left"],
)
def test_a_robot_in_a_curve_feels_it_where_the_unit_is_mounted_as_it_is_turned(mount: Imu, force: tuple[float, float]):
    speed_m_s, turn_rad_s = 0.5, 2.0
    before, after = (
        planar((0.0, 0.0, at), (speed_m_s * np.cos(at), speed_m_s * np.sin(at), turn_rad_s))
        for at in (0.3, 0.3 + turn_rad_s * CONTROL_S)
    )
    found = true_readings(mount, before, after)
    np.testing.assert_allclose(found[:3], [0.0, 0.0, turn_rad_s])
    np.testing.assert_allclose(found[3:], [*force, G], rtol=2e-3, atol=1e-4)


TUMBLING = """
<mujoco>
  <option timestep="0.005"/>
  <worldbody>
    <body name="base" pos="0 0 2">
      <freejoint/>
      <geom type="box" size="0.3 0.2 0.1" mass="2"/>
      <site name="unit" pos="0.1 -0.05 0.02"/>
    </body>
  </worldbody>
  <sensor><gyro site="unit"/><accelerometer site="unit"/></sensor>
</mujoco>
"""


def test_a_tumbling_base_reads_as_mujocos_gyroscope_and_accelerometer():
    model = mujoco.MjModel.from_xml_string(TUMBLING)
    data = mujoco.MjData(model)
    data.qvel[:] = (0.3, -0.2, 1.0, 0.8, -0.6, 1.2)
    data.xfrc_applied[1, :3] = (4.0, -3.0, 25.0)
    mount = Imu(x_m=0.1, y_m=-0.05, z_m=0.02)
    read = jax.jit(lambda before, after: true_readings(mount, before, after))
    for _ in range(8):
        before = body_of(data)
        felt: list[np.ndarray] = []
        for _ in range(round(CONTROL_S / model.opt.timestep)):
            mujoco.mj_step(model, data)
            felt.append(data.sensordata[3:].copy())  # of the state that the step began with
        mujoco.mj_forward(model, data)
        found = np.asarray(read(before, body_of(data)))
        np.testing.assert_array_equal(found[:3], data.sensordata[:3].astype(np.float32))
        np.testing.assert_allclose(found[3:], np.mean(felt, axis=0), atol=0.03)


def test_a_base_that_is_pushed_at_random_reads_as_mujocos_at_each_step():
    model = mujoco.MjModel.from_xml_string(TUMBLING)
    mount, rng = Imu(x_m=0.1, y_m=-0.05, z_m=0.02), np.random.default_rng(0)
    read = jax.jit(lambda before, after: true_readings(mount, before, after))
    off = list[np.ndarray]()
    for _ in range(10):
        data = mujoco.MjData(model)
        data.qvel[:] = rng.uniform(-1.0, 1.0, 6)
        for _ in range(20):
            data.xfrc_applied[1] = [0.0, 0.0, 2 * G, 0.0, 0.0, 0.0] + rng.uniform(-1, 1, 6) * np.repeat([20.0, 0.1], 3)
            before, felt = body_of(data), list[np.ndarray]()
            for _ in range(round(CONTROL_S / model.opt.timestep)):
                mujoco.mj_step(model, data)
                felt.append(data.sensordata[3:].copy())
            mujoco.mj_forward(model, data)
            found = np.asarray(read(before, body_of(data)))
            np.testing.assert_array_equal(found[:3], data.sensordata[:3].astype(np.float32))
            off.append(found[3:] - np.mean(felt, axis=0))
    assert np.abs(off).max() < 0.1
    assert np.median(np.abs(off)) < 0.015


def body_of(data: mujoco.MjData) -> Body:
    qpos, qvel = (jnp.asarray(np.array(each, np.float32)) for each in (data.qpos, data.qvel))
    return Body(jnp.zeros(3), jnp.zeros(3), jnp.zeros(0), jnp.zeros(0), FreeJoints(qpos, qvel))


def read_still(imu: Imu) -> Float[np.ndarray, "steps 6"]:
    """Returns by how much a unit errs that does not move."""
    true = jnp.array([0.0, 0.0, 0.5, 0.0, 0.0, G])

    def advance(walked: jax.Array, step: jax.Array) -> tuple[jax.Array, jax.Array]:
        found: ImuMemory = noisy(imu, true, walked, SEED, step)
        return found.walked, found.readings

    return np.asarray(jax.jit(lambda: jax.lax.scan(advance, jnp.zeros(6), jnp.arange(STEPS))[1])() - true)


def allan_deviation(errors: Float[np.ndarray, "steps 6"], together: int) -> Float[np.ndarray, "6"]:
    """Returns the Allan deviation of readings over so many control steps."""
    means = errors[: len(errors) // together * together].reshape(-1, together, 6).mean(axis=1)
    return np.sqrt(0.5 * (np.diff(means, axis=0) ** 2).mean(axis=0))


def test_white_noise_has_the_declared_deviation_and_averages_out():
    errors = read_still(Imu(gyro_sigma_rad_s=0.01, force_sigma_m_s2=0.2))
    wanted = np.repeat([0.01, 0.2], 3)
    np.testing.assert_allclose(allan_deviation(errors, 1), wanted, rtol=0.1)
    np.testing.assert_allclose(allan_deviation(errors, 16), wanted / 4, rtol=0.25)


def test_zeros_walk_as_far_as_declared():
    errors = read_still(Imu(gyro_walk_rad_s=0.01, force_walk_m_s2=0.2))
    second = round(1 / CONTROL_S)
    np.testing.assert_allclose((errors[second:] - errors[:-second]).std(axis=0), np.repeat([0.01, 0.2], 3), rtol=0.25)


def test_an_axis_has_one_scale_in_an_episode():
    errors = read_still(Imu(scale_share=0.05))
    assert (errors == errors[0]).all()
    assert 0.0 < abs(errors[0, 2]) < 0.1


def field_ut(compass: Compass, body: Body, step: int = 0) -> Float[np.ndarray, "3"]:
    none: Any = None
    return np.asarray(COMPASS.observe(compass, compass, (), Situation(body, none, SEED, jnp.int32(step)))["field_ut"])


def test_a_compass_feels_the_field_along_the_robots_axes_however_it_leans():
    # Facing west, north is to the right of it.
    west = field_ut(Compass(), planar((0.0, 0.0, np.pi), (0.0, 0.0, 0.0)))
    np.testing.assert_allclose(west, [0.0, -20.0, -45.0], atol=1e-4)
    lying = FreeJoints(jnp.array([0, 0, 0, np.sqrt(0.5), np.sqrt(0.5), 0, 0], jnp.float32), jnp.zeros(6))
    rolled = planar((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))._replace(joints=lying)
    np.testing.assert_allclose(field_ut(Compass(north_rad=0.0), rolled), [20.0, -45.0, 0.0], atol=1e-4)


def test_what_iron_adds_stays_and_noise_is_each_readings_own():
    ahead, still = planar((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)), Compass(bias_ut=3.0)
    true, first, second = (field_ut(each, ahead, step) for each, step in ((Compass(), 0), (still, 0), (still, 1)))
    assert (first == second).all()
    assert (first != true).all()
    assert (field_ut(still._replace(sigma_ut=0.1), ahead, 1) != second).all()

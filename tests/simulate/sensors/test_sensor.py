"""Noise is the episode's and the step's own, and as large as declared."""

from typing import Any, cast

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tasks.simulate.application.contract import Body, FreeJoints, Motion
from tasks.simulate.sensors.gps import GPS, Gps
from tasks.simulate.sensors.lidar import Lidar, noisy_ranges
from tasks.simulate.sensors.odometry import WHEEL_ENCODERS, Odometry, WheelEncoders, believed_pose
from tasks.simulate.sensors.sensor import Drive, Situation, seed_words, step_key
from tasks.simulate.sensors.sensor_table import SENSORS

pytestmark = pytest.mark.long

QUIET = Lidar(rays=64, range_m=8.0, height_m=0.2)
NOISY = QUIET._replace(sigma_m=0.02, sigma_share=0.01, dropout=0.1)
RANGES = jnp.linspace(0.1, 7.0, 64)
SEED = jnp.asarray(seed_words(7))
STEP = jnp.int32(11)
DRIFT = Odometry(sigma_m_per_m=0.05, sigma_rad_per_m=0.02, sigma_rad_per_rad=0.03)
MANY = 4000


def over_steps(lidar: Lidar, ranges: jax.Array = RANGES) -> np.ndarray:
    scan = jax.jit(jax.vmap(lambda step: noisy_ranges(ranges, lidar, SEED, step)))
    return np.asarray(scan(jnp.arange(MANY)))


def test_without_noise_ranges_are_the_same_bits():
    assert noisy_ranges(RANGES, QUIET, SEED, STEP) is RANGES


def test_noise_that_is_traced_and_zero_changes_no_bit():
    traced = jax.jit(
        lambda zero: noisy_ranges(RANGES, QUIET._replace(sigma_m=zero, dropout=zero, resolution_m=zero), SEED, STEP)
    )
    np.testing.assert_array_equal(traced(0.0), RANGES)


def test_a_lanes_noise_is_the_same_bits_wherever_it_stands():
    seeds = jnp.asarray(np.stack([seed_words(seed) for seed in range(32)]))
    scan = jax.jit(jax.vmap(lambda seed: noisy_ranges(RANGES, NOISY, seed, STEP)))
    together = scan(seeds)
    np.testing.assert_array_equal(scan(seeds[::-1])[::-1], together)
    np.testing.assert_array_equal(scan(seeds[8:16]), together[8:16])
    assert len(np.unique(np.asarray(together).sum(axis=1))) == 32


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**63 - 1), st.integers(0, 2**63 - 1), st.integers(0, 10_000), st.integers(0, 10_000))
def test_keys_differ_in_seed_sensor_and_step(seed: int, other: int, step: int, later: int):
    def key(seed: int, step: int, stream: int = 0) -> tuple[int, ...]:
        drawn = step_key(jnp.asarray(seed_words(seed)), stream, jnp.int32(step))
        return tuple(np.asarray(jax.random.key_data(drawn)).tolist())

    assert (key(seed, step) == key(other, step)) == (seed == other)
    assert (key(seed, step) == key(seed, later)) == (step == later)
    noises = [key(seed, step, stream) for each in SENSORS for stream in each.streams]
    assert len(set(noises)) == len(noises)


def test_the_spread_is_the_constant_part_and_the_share_of_the_distance():
    errors = over_steps(NOISY._replace(dropout=0.0)) - np.asarray(RANGES)
    np.testing.assert_allclose(errors.std(axis=0), 0.02 + 0.01 * np.asarray(RANGES), rtol=0.06)
    assert np.abs(errors.mean(axis=0)).max() < 0.01


def test_dropouts_report_the_range_as_often_as_declared():
    lost = over_steps(QUIET._replace(dropout=0.1)) == QUIET.range_m
    assert lost.mean() == pytest.approx(0.1, abs=0.003)
    assert lost.mean(axis=0).std() < 0.01


def test_noise_never_leaves_what_a_lidar_can_report():
    found = over_steps(NOISY._replace(sigma_m=3.0))
    assert found.min() == 0.0
    assert found.max() == QUIET.range_m


def test_what_sees_nothing_stays_so():
    nothing = jnp.full(64, QUIET.range_m)
    np.testing.assert_array_equal(over_steps(NOISY._replace(sigma_m=1.0), nothing), QUIET.range_m)


def test_ranges_are_rounded_to_the_resolution():
    found = noisy_ranges(RANGES, QUIET._replace(resolution_m=0.05), SEED, STEP)
    np.testing.assert_allclose(np.asarray(found) / 0.05, np.round(np.asarray(RANGES) / 0.05), atol=1e-4)


def driven(odometry: Odometry, poses: np.ndarray, seeds: int) -> np.ndarray:
    """Returns what robots of different seeds believe at the end of a way."""

    def one(seed: jax.Array) -> jax.Array:
        def step(believed: jax.Array, k: jax.Array) -> tuple[jax.Array, None]:
            way = jnp.asarray(poses, jnp.float32)
            return believed_pose(believed, way[k], way[k + 1], odometry, seed=seed, step=k), None

        return jax.lax.scan(step, jnp.asarray(poses[0], jnp.float32), jnp.arange(len(poses) - 1))[0]

    words = jnp.asarray(np.stack([seed_words(seed) for seed in range(seeds)]))
    return np.asarray(jax.jit(jax.vmap(one))(words))


def straight(steps: int, length_m: float) -> np.ndarray:
    return np.linspace([1.0, 2.0, 0.5], [1.0 + length_m * np.cos(0.5), 2.0 + length_m * np.sin(0.5), 0.5], steps + 1)


def test_exact_odometry_believes_the_truth():
    loop = np.stack([np.cos(np.arange(100) / 9), np.sin(np.arange(100) / 7), np.arange(100) / 10], axis=1)
    np.testing.assert_allclose(driven(Odometry(), loop, 1)[0], loop[-1], atol=1e-4)


@pytest.mark.parametrize("steps", [40, 160])
def test_drift_depends_on_the_way_and_not_on_its_steps(steps: int):
    ends = driven(Odometry(sigma_m_per_m=0.05), straight(steps, 4.0), 2000)
    along = (ends[:, :2] - [1.0, 2.0]) @ [np.cos(0.5), np.sin(0.5)]
    assert along.std() == pytest.approx(0.05 * 2.0, rel=0.08)


def test_the_heading_drifts_with_way_and_turn():
    turning = straight(100, 4.0)
    turning[:, 2] += np.linspace(0.0, 9.0, 101)
    ends = driven(Odometry(sigma_rad_per_m=0.02, sigma_rad_per_rad=0.03), turning, 2000)
    assert ends[:, 2].std() == pytest.approx(np.hypot(0.02 * 2.0, 0.03 * 3.0), rel=0.08)


def test_a_robot_at_rest_does_not_drift():
    still = np.tile([1.0, 2.0, 0.5], (50, 1))
    np.testing.assert_allclose(driven(DRIFT, still, 1)[0], still[0], atol=1e-6)


def at(pose: jax.Array, seed: jax.Array, step: Any) -> Situation:  # noqa: ANN401 - a number or an array
    none: Any = None
    return Situation(Body(pose, jnp.zeros(3), none, none), none, seed, jnp.asarray(step, jnp.int32))


def rolled_m(wheels: WheelEncoders, poses: np.ndarray, seeds: int) -> np.ndarray:
    """Returns how far the wheels of robots of different seeds have rolled at the end of a way, by their counts."""
    way, none = jnp.asarray(poses, jnp.float32), cast("Any", None)

    def one(seed: jax.Array) -> jax.Array:
        def step(memory: Any, k: jax.Array) -> tuple[Any, None]:  # noqa: ANN401 - the sensor's own
            drive = Drive(at(way[k], seed, k), Motion(at(way[k + 1], seed, k).body, none, none))
            return WHEEL_ENCODERS.feel(wheels, wheels, memory, drive), None

        begun = WHEEL_ENCODERS.begin(wheels, wheels, at(way[0], seed, 0))
        memory = jax.lax.scan(step, begun, jnp.arange(len(poses) - 1))[0]
        return WHEEL_ENCODERS.observe(wheels, wheels, memory, at(way[-1], seed, 0))["ticks"]

    words = jnp.asarray(np.stack([seed_words(seed) for seed in range(seeds)]))
    return np.asarray(jax.jit(jax.vmap(one))(words)) * float(wheels.tick_m)


def test_wheels_count_what_they_roll_in_a_curve_and_backwards():
    wheels, turn = WheelEncoders(track_m=0.4, tick_m=1e-4), np.linspace(0.0, np.pi, 101)
    # Half a turn to the left, on a circle of 1 m.
    curve = np.stack([np.sin(turn), 1.0 - np.cos(turn), turn], axis=1)
    np.testing.assert_allclose(rolled_m(wheels, curve, 1)[0], [0.8 * np.pi, 1.2 * np.pi], atol=1e-3)
    np.testing.assert_allclose(rolled_m(wheels, curve[::-1], 1)[0], [-0.8 * np.pi, -1.2 * np.pi], atol=1e-3)
    # Of a step that turns by much, the chord: it goes ahead as it faces in the middle of the step.
    chords_m, apart_m = 4 * 2.0 * np.sin(np.pi / 8), 0.2 * np.pi
    coarse_m = rolled_m(wheels, curve[::25], 1)[0]
    np.testing.assert_allclose(coarse_m, [chords_m - apart_m, chords_m + apart_m], atol=1e-3)


def test_wheels_err_by_their_way_and_by_their_size():
    four_m = straight(80, 4.0)
    slips = rolled_m(WheelEncoders(tick_m=1e-4, sigma_m_per_m=0.05), four_m, 2000)
    np.testing.assert_allclose(slips.std(axis=0), 0.05 * 2.0, rtol=0.08)
    sizes = rolled_m(WheelEncoders(tick_m=1e-4, scale_share=0.01), four_m, 2000)
    np.testing.assert_allclose(sizes.std(axis=0), 0.01 * 4.0, rtol=0.08)
    assert abs(np.corrcoef(sizes.T)[0, 1]) < 0.1


def test_a_receiver_tells_where_its_antenna_is_with_noise_and_slow_drift():
    facing_north = jnp.array([3.0, 4.0, np.pi / 2])
    true = GPS.observe(
        Gps(x_m=0.5), Gps(x_m=0.5), GPS.begin(Gps(), Gps(), at(facing_north, SEED, 0)), at(facing_north, SEED, 0)
    )
    np.testing.assert_allclose(true["gps_m"], [3.0, 4.5, 0.0], atol=1e-6)

    # Of a robot that fell on its nose, what was 1 m above its axis is 1 m ahead of that.
    upright = FreeJoints(jnp.array([3.0, 4.0, 0.2, 1.0, 0.0, 0.0, 0.0]), jnp.zeros(6))
    fallen = upright._replace(qpos=upright.qpos.at[3:].set(jnp.array([np.sqrt(0.5), 0.0, np.sqrt(0.5), 0.0])))
    mast, now = Gps(z_m=1.2), at(jnp.array([3.0, 4.0, 0.0]), SEED, 0)
    stood, lies = (now._replace(body=now.body._replace(joints=each)) for each in (upright, fallen))
    sky = GPS.begin(mast, mast, stood)
    told = [GPS.observe(mast, mast, sky, each)["gps_m"] for each in (stood, lies)]
    np.testing.assert_allclose(told, [[3.0, 4.0, 1.2], [4.0, 4.0, 0.2]], atol=1e-6)

    def errors(gps: Gps) -> np.ndarray:
        def step(memory: Any, k: jax.Array) -> tuple[Any, jax.Array]:  # noqa: ANN401 - the sensor's own
            now = at(jnp.zeros(3), SEED, k)
            seen = GPS.observe(gps, gps, memory, now)["gps_m"]
            return GPS.feel(gps, gps, memory, Drive(now, Motion(now.body, cast("Any", None), cast("Any", None)))), seen

        begun = GPS.begin(gps, gps, at(jnp.zeros(3), SEED, 0))
        return np.asarray(jax.jit(lambda: jax.lax.scan(step, begun, jnp.arange(MANY))[1])())

    np.testing.assert_allclose(errors(Gps(sigma_m=1.5)).std(axis=0), [1.5, 1.5, 3.0], rtol=0.05)
    drift = errors(Gps(drift_m=2.0, drift_s=0.2))
    np.testing.assert_allclose(drift.std(axis=0), [2.0, 2.0, 4.0], rtol=0.1)
    # That is four control steps: so much later a share of 1/e is left.
    np.testing.assert_allclose([np.corrcoef(each[4:], each[:-4])[0, 1] for each in drift.T], np.exp(-1), atol=0.1)

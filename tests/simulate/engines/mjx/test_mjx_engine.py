"""The lanes that may have touched something are found again, and no others."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tasks.simulate.engines.mjx.mjx_engine import recompute_lanes, unroll_small_matrices


@pytest.mark.parametrize("lanes", [3, 8, 40, 100])
@pytest.mark.parametrize("share", [0.0, 0.1, 1.0])
def test_what_is_not_sound_is_found_again(lanes: int, share: float):
    given = jnp.arange(lanes, dtype=jnp.float32)
    sound = jnp.asarray(np.random.default_rng(lanes).uniform(size=lanes) >= share)
    found = jax.jit(lambda first, sound: recompute_lanes(first, sound, lambda each: -each, given, lanes))(given, sound)
    np.testing.assert_array_equal(found, jnp.where(sound, given, -given))


def test_lanes_are_found_again_a_few_together_until_none_is_left():
    calls: list[int] = []

    def again(each: jax.Array) -> jax.Array:
        jax.debug.callback(lambda: calls.append(len(each)))
        return each

    given = jnp.arange(100.0)
    jax.block_until_ready(recompute_lanes(given, given >= 40.0, again, given, 100))
    jax.effects_barrier()
    assert calls == [32, 32]


MATRIX = np.array([[4.0, 1.0, 0.5], [1.0, 3.0, 0.2], [0.5, 0.2, 2.0]], np.float32)
RIGHT = np.array([1.0, -2.0, 0.5], np.float32)


def solved(matrix: jax.Array, right: jax.Array) -> jax.Array:
    return jax.scipy.linalg.cho_solve(jax.scipy.linalg.cho_factor(matrix), right)


def multiplied(matrix: jax.Array, right: jax.Array) -> jax.Array:
    return jnp.einsum("ij,kj,k->ki", matrix, jnp.tile(matrix, (4, 1)), jnp.tile(right, 4))


def looped(matrix: jax.Array, right: jax.Array) -> jax.Array:
    last, each = jax.lax.scan(lambda x, _: (matrix @ x / 5.0, x), right, None, length=3)
    halved = jax.lax.while_loop(lambda x: jnp.sum(x**2) > 1.0, lambda x: matrix @ x / 8.0, right)
    return jax.lax.cond(last[0] > 0.0, lambda x: matrix @ x, lambda x: x @ matrix, halved) + each.sum(axis=0)


@pytest.mark.parametrize("function", [solved, multiplied, looped])
def test_it_gives_what_the_library_gives(function: Callable[[jax.Array, jax.Array], jax.Array]):
    found, expected = (
        each(jnp.asarray(MATRIX), jnp.asarray(RIGHT)) for each in (unroll_small_matrices(function), function)
    )
    np.testing.assert_allclose(found, expected, rtol=2e-6)


@pytest.mark.parametrize("function", [solved, multiplied, looped])
def test_no_library_is_called(function: Callable[[jax.Array, jax.Array], jax.Array]):
    text = str(jax.make_jaxpr(unroll_small_matrices(function))(jnp.asarray(MATRIX), jnp.asarray(RIGHT)))
    assert not [name for name in ("dot_general", "cholesky", "triangular_solve") if name in text]


def test_a_lane_has_the_same_bits_whatever_lanes_are_beside_it():
    rng = np.random.default_rng(0)
    matrices = MATRIX + 0.1 * rng.standard_normal((40, 1, 1)).astype(np.float32) * np.eye(3, dtype=np.float32)
    rights = rng.standard_normal((40, 3)).astype(np.float32)
    run = jax.jit(jax.vmap(unroll_small_matrices(solved)))
    whole = np.asarray(run(matrices, rights))
    np.testing.assert_array_equal(run(matrices[16:24], rights[16:24]), whole[16:24])

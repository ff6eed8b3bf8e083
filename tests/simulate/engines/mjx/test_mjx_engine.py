"""The lanes that may have touched something are found again, and no others."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tasks.simulate.engines.mjx.mjx_engine import recompute_lanes


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

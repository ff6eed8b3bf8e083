"""Noise that belongs to an episode's seed, a sensor and a control step, and to nothing else.

Keys are counted, not carried: what a lane draws does not depend on the lanes beside it, on how it got to that step, or
on the engine.
"""

import jax
import numpy as np
from jaxtyping import Array, Int, Key, UInt32

Seed = UInt32[Array, "2"]
_WORD = 32


def seed_words(seed: int) -> UInt32[np.ndarray, "2"]:
    """Returns an episode's seed as the two words that ``step_key`` begins with; its lowest 64 bits count."""
    return np.array([(seed >> _WORD) & 0xFFFFFFFF, seed & 0xFFFFFFFF], np.uint32)


def step_key(seed: Seed, stream: int, step: Int[Array, ""]) -> Key[Array, ""]:
    """Returns the key of a sensor at a control step.

    Args:
        seed: The episode's.
        stream: Number of the sensor's noise; no other noise has it.
        step: The control step.
    """
    # Named, since JAX's default is a setting of the process.
    key = jax.random.wrap_key_data(seed, impl="threefry2x32")
    return jax.random.fold_in(jax.random.fold_in(key, stream), step)

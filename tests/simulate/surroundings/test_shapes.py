"""Array shapes are written in types, and this folder's tests check them."""

import jax.numpy as jnp
import jaxtyping
import numpy as np
import pytest

from tasks.simulate.geometry.lidar_scan import LidarOutlines, scan_ranges

NOTHING = LidarOutlines(jnp.zeros((8, 4)), jnp.zeros((8, 6)), jnp.zeros((8, 3)), jnp.zeros(3, jnp.int32))


def test_an_array_of_the_wrong_shape_is_refused_in_tests():
    with pytest.raises(jaxtyping.TypeCheckError):
        scan_ranges(NOTHING, jnp.zeros(4), np.zeros(8, np.float32), 1.0)

"""Array shapes are written in types, and this folder's tests check them."""

import jax.numpy as jnp
import jaxtyping
import pytest

from tasks.simulate.lidar import scan_ranges


def test_an_array_of_the_wrong_shape_is_refused_in_tests():
    with pytest.raises(jaxtyping.TypeCheckError):
        scan_ranges(jnp.zeros((4, 7)), jnp.zeros((1, 5)), jnp.zeros(3), 8, 1.0)

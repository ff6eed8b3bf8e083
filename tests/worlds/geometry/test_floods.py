"""A flood reaches what a library that labels cells finds to hang together."""

import numpy as np
import pytest
from jaxtyping import Bool
from scipy import ndimage

from tasks.worlds.geometry import flood


def bits(grid: Bool[np.ndarray, "x y"]) -> int:
    return sum(1 << int(cell) for cell in np.flatnonzero(grid))


@pytest.mark.parametrize("shape", [(1, 4), (12, 9), (40, 51), (130, 140)])
@pytest.mark.parametrize("free_share", [0.45, 0.6, 0.75, 1.0])
def test_a_flood_reaches_what_hangs_together(shape: tuple[int, int], free_share: float) -> None:
    draws = np.random.default_rng(shape[0])
    free = draws.random(shape) <= free_share
    free[:, -1] = False  # the last of each row is never free
    labels = np.zeros(shape, dtype=np.int32)
    ndimage.label(free, output=labels)
    for start in draws.permutation(np.argwhere(free))[:5].tolist():
        part = labels == labels[tuple(start)]
        alone = np.zeros_like(free)
        alone[tuple(start)] = True
        assert flood(bits(alone), bits(free), shape[1]) == bits(part)


def test_a_long_way_around_corners_is_walked_to_its_end() -> None:
    free = np.ones((41, 42), dtype=bool)
    free[:, -1] = False
    free[1::4, :-2] = False
    free[3::4, 1:] = False
    assert flood(1, bits(free), 42) == bits(free)


def test_no_start_reaches_nothing() -> None:
    assert flood(0, 0b0110, 4) == 0

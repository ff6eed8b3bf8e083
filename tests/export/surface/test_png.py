"""What is encoded is decoded again."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from tasks.export.surface.textures import encode_indexed, encode_rgb
from tests.export.png_reader import decoded


@given(st.integers(1, 9), st.integers(1, 9), st.integers(0, 99))
def test_a_picture_comes_back_pixel_by_pixel(rows: int, columns: int, seed: int):
    pixels = np.random.default_rng(seed).integers(0, 256, (rows, columns, 3), dtype=np.uint8)
    np.testing.assert_array_equal(decoded(encode_rgb(pixels)), pixels)


def test_an_indexed_picture_has_the_colours_of_its_palette():
    palette = np.array([[0, 10, 20], [255, 0, 7]], np.uint8)
    pixels = np.array([[0, 1, 1], [1, 0, 0]], np.uint8)
    np.testing.assert_array_equal(decoded(encode_indexed(pixels, palette)), palette[pixels])

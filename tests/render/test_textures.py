"""Textures repeat without a seam, have the colours of their finish, and are the same bytes wherever they are made."""

import hashlib
from typing import get_args

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import ndimage

from specs.data.world import Color, Finish, Pattern
from tasks.render.textures import TILINGS, encode_indexed, encode_rgb, texture_of
from tests.export.png_reader import decoded

PATTERNS: tuple[Pattern, ...] = get_args(Pattern)
COLOR, ACCENT = (0.8, 0.6, 0.4), (0.5, 0.4, 0.3)


def finish(pattern: Pattern, accent: Color = ACCENT) -> Finish:
    return Finish(material="any", pattern=pattern, color=COLOR, accent=accent, repeat_m=(0.4, 0.1))


def pixels(pattern: Pattern) -> np.ndarray:
    texture = texture_of(finish(pattern))
    assert texture is not None
    return decoded(texture.png).astype(float)


def test_every_pattern_can_be_drawn():
    assert set(TILINGS) == set(PATTERNS)


def test_a_surface_of_one_colour_needs_no_texture():
    assert texture_of(finish("plain", accent=COLOR)) is None


@pytest.mark.parametrize("pattern", PATTERNS)
def test_the_colours_lie_on_the_line_through_colour_and_accent(pattern: Pattern):
    shares = (pixels(pattern) / 255 - COLOR) / (np.array(ACCENT) - COLOR)
    np.testing.assert_allclose(shares, shares[:, :, :1].repeat(3, axis=2), atol=0.03)
    assert -0.45 < shares.min() < shares.max() < 1.45


@pytest.mark.parametrize("pattern", PATTERNS)
def test_most_of_a_surface_is_nearer_to_its_colour_than_to_its_accent(pattern: Pattern):
    shares = (pixels(pattern)[:, :, 0] / 255 - COLOR[0]) / (ACCENT[0] - COLOR[0])
    assert np.mean(shares) < 0.51


@pytest.mark.parametrize("pattern", PATTERNS)
@pytest.mark.parametrize("axis", [0, 1])
def test_a_texture_goes_over_into_itself_at_its_edges(pattern: Pattern, axis: int):
    picture = pixels(pattern)[:, :, 0]
    steps = np.abs(np.diff(picture, axis=axis, append=np.take(picture, [0], axis)))
    across = np.mean(np.take(steps, -1, axis))
    # No sharper than the sharpest line within: a joint may well lie at the edge, a break may not.
    assert across <= np.mean(steps, axis=1 - axis).max() + 1e-9


def test_a_texture_is_a_whole_number_of_units_large():
    planks, parquet = texture_of(finish("planks")), texture_of(finish("parquet"))
    assert planks is not None
    assert parquet is not None
    assert planks.extent_m == (0.8, 0.8)
    assert parquet.extent_m == (0.8, 0.8)


def test_every_stave_of_the_parquet_is_four_times_as_long_as_wide():
    picture = np.tile(pixels("parquet")[:, :, 0], (3, 3))
    joint = (picture / 255 - COLOR[0]) / (ACCENT[0] - COLOR[0]) > 1.1
    staves = np.zeros(joint.shape, np.int32)
    ndimage.label(~joint, output=staves)
    inner = np.unique(staves[256:512, 256:512])
    boxes = [box for number, box in enumerate(ndimage.find_objects(staves), start=1) if number in inner]
    # 32 pixels a width, of which the joint takes one.
    assert {tuple(side.stop - side.start for side in box) for box in boxes} == {(31, 127), (127, 31)}


@pytest.mark.parametrize("pattern", PATTERNS)
def test_a_texture_is_small(pattern: Pattern):
    texture = texture_of(finish(pattern))
    assert texture is not None
    assert len(texture.png) < 40_000


def test_the_pixels_are_the_same_on_any_machine():
    digest = hashlib.sha256()
    for pattern in PATTERNS:
        digest.update(pixels(pattern).astype(np.uint8).tobytes())
    assert digest.hexdigest()[:16] == "32a60e388b743e46"


@given(st.integers(1, 9), st.integers(1, 9), st.integers(0, 99))
def test_a_picture_comes_back_pixel_by_pixel(rows: int, columns: int, seed: int):
    pixels = np.random.default_rng(seed).integers(0, 256, (rows, columns, 3), dtype=np.uint8)
    np.testing.assert_array_equal(decoded(encode_rgb(pixels)), pixels)


def test_an_indexed_picture_has_the_colours_of_its_palette():
    palette = np.array([[0, 10, 20], [255, 0, 7]], np.uint8)
    pixels = np.array([[0, 1, 1], [1, 0, 0]], np.uint8)
    np.testing.assert_array_equal(decoded(encode_indexed(pixels, palette)), palette[pixels])

"""A covering as Wavefront OBJ has the sheet's corners, and its picture upright and as big as it is."""

import numpy as np
import pytest
from jaxtyping import Float64

from tasks.export.format.sdf import obj
from tasks.export.surface.sheets import FLOOR_PREFIX, Covering, sheets
from tasks.export.surface.textures import texture_of
from tests.factories.worlds import apartment

WORLD = apartment()
SHEETS = [sheet for sheet in sheets(WORLD) if texture_of(sheet.finish)]


def values(sheet: Covering, keyword: str) -> Float64[np.ndarray, "lines values"]:
    """Returns the numbers of all lines that begin with the keyword."""
    lines = [line.split() for line in obj(sheet).decode().splitlines()]
    return np.array([[float(word) for word in words[1:]] for words in lines if words[0] == keyword])


def faces(sheet: Covering) -> list[list[tuple[int, int]]]:
    """Returns for each triangle which corner, and which place in the picture, each of its corners is."""
    lines = [line.split() for line in obj(sheet).decode().splitlines()]
    pairs = [[word.split("/") for word in words[1:]] for words in lines if words[0] == "f"]
    return [[(int(corner) - 1, int(place) - 1) for corner, place in triangle] for triangle in pairs]


@pytest.mark.parametrize("sheet", SHEETS, ids=lambda sheet: sheet.name)
def test_triangles_are_the_sheets_in_its_order_of_corners(sheet: Covering):
    np.testing.assert_allclose(values(sheet, "v"), sheet.vertices_m, atol=1e-6)
    assert faces(sheet) == [[(corner, corner) for corner in triangle] for triangle in sheet.triangles.tolist()]


@pytest.mark.parametrize("sheet", SHEETS, ids=lambda sheet: sheet.name)
def test_pictures_stand_upright_and_have_their_size(sheet: Covering):
    texture = texture_of(sheet.finish)
    assert texture is not None
    corners, along_and_up = values(sheet, "v"), values(sheet, "vt") * texture.extent_m
    if sheet.name.startswith(FLOOR_PREFIX):
        np.testing.assert_allclose(along_and_up, corners[:, :2] - corners[:, :2].min(axis=0), atol=2e-5)
    else:
        np.testing.assert_allclose(along_and_up[:, 1], corners[:, 2], atol=2e-5)

"""Many worlds in three dimensions, in one picture."""

from collections.abc import Iterator

import numpy as np
import pytest

from specs.data.world import World
from tasks.export.picture.renderer import CAPTION_LINE, open_renderer, render_sheet_png
from tests.export.png_reader import decoded
from tests.factories.worlds import apartment
from tests.servers.tools import skip_or_fail

pytestmark = pytest.mark.long


@pytest.fixture(scope="module", autouse=True)
def _gl() -> None:
    with open_renderer(16, 16, 1) as render:
        if render is None:
            skip_or_fail("neither EGL nor OSMesa works here: apt-get install libosmesa6")


def test_worlds_stand_side_by_side_with_something_to_see_in_each():
    file = render_sheet_png([apartment(), apartment(name="world-2-1")])
    assert file is not None
    sheet = decoded(file)
    left, right = sheet[:, : sheet.shape[1] // 2], sheet[:, sheet.shape[1] // 2 :]
    assert left.std() > 10.0
    assert right.std() > 10.0
    assert sheet.shape[1] > sheet.shape[0]


def test_no_more_worlds_are_read_than_asked_for():
    def one_more() -> Iterator[World]:
        yield apartment()
        pytest.fail("a world was read that is not rendered")

    assert render_sheet_png(one_more(), most=1) is not None


def test_a_caption_is_written_below_its_picture():
    with open_renderer(200, 150, 1) as render:
        assert render is not None
        plain, named = render(apartment(), ()), render(apartment(), ("world-1-1", "36.0 m2"))
    text = named[-2 * CAPTION_LINE :]
    assert plain.shape == named.shape
    assert np.all(text[:, -8:] == 255)
    for line in (text[:CAPTION_LINE], text[CAPTION_LINE:]):
        assert line.min() < 100


def test_without_gl_there_is_no_sheet(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("MUJOCO_GL", "nonsense")
    assert render_sheet_png([apartment()]) is None


def test_a_sheet_without_worlds_is_refused():
    with pytest.raises(ValueError, match="needs a world"):
        render_sheet_png([])

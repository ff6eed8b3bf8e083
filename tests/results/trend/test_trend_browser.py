"""The trend's page in a real browser: it loads nothing, fits every window, and can be read without a mouse."""

import json
from collections.abc import Iterator

import pytest

from tasks.results.trend.trend_view import trend_page
from tests.results.trend.histories import history
from tests.results.trend.test_trend_view import view
from tests.servers.chromium import Page, browsing

pytestmark = pytest.mark.integration


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    """The page, opened."""
    folder = tmp_path_factory.mktemp("chromium")
    file = folder / "trend.html"
    file.write_bytes(trend_page(view(history(60, drop_at=45))))
    with browsing(folder) as page:
        page.open(file.as_uri())
        yield page


def test_it_asks_for_nothing_and_complains_of_nothing(browser: Page):
    assert [url.rpartition("/")[2] for url in browser.requests] == ["trend.html"]
    assert browser.complaints == []


@pytest.mark.parametrize(("width", "dark"), [(320, False), (390, True), (1280, False), (1280, True)])
def test_it_fits_every_window(width: int, dark: bool, browser: Page):  # noqa: FBT001 - a parameter
    browser.look(width=width, height=844, dark=dark)
    assert browser.run("document.documentElement.scrollWidth") == width
    ground = browser.run("getComputedStyle(document.body).backgroundColor")
    assert ground == ("rgb(18, 22, 27)" if dark else "rgb(246, 247, 249)")
    assert browser.run("document.querySelector('.whole .plot').getBoundingClientRect().height > 200") is True


def test_every_night_can_be_reached_by_keyboard_in_the_table_and_by_ear_in_the_chart(browser: Page):
    reachable = "[...document.querySelectorAll('td a')].filter(link => link.tabIndex === 0).length"
    assert browser.run(reachable) == 60
    assert browser.run("document.querySelectorAll('.one[aria-label]').length") == 60
    words = browser.run("document.querySelector('.whole desc').textContent")
    assert isinstance(words, str)
    assert words.startswith("60 nights from ")
    assert "the rate fell" in words


def test_a_night_under_the_mouse_says_what_it_was(browser: Page):
    browser.look(width=1280, height=844)
    browser.run("document.querySelector('.whole').scrollIntoView({block: 'center'})")
    box = "JSON.stringify(document.querySelectorAll('.one .area')[10].getBoundingClientRect())"
    place = json.loads(str(browser.run(box)))
    x, y = place["x"] + place["width"] / 2, place["y"] + place["height"] / 2
    browser.call("Input.dispatchMouseEvent", type="mouseMoved", x=x, y=y)
    shown = "getComputedStyle(document.querySelectorAll('.one .tip')[{}]).visibility"
    assert [browser.run(shown.format(at)) for at in (9, 10, 11)] == ["hidden", "visible", "hidden"]

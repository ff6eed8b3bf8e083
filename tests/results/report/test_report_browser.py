"""The page in a real browser: it loads nothing, complains of nothing, fits every window, and can be read by ear."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import cast

import pytest

from tasks.results.report.report_page import report_page
from tests.factories.reports import view
from tests.results.report.test_report_page import hostile
from tests.servers.chromium import Page, browsing

pytestmark = pytest.mark.integration


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    """An empty page."""
    with browsing(tmp_path_factory.mktemp("chromium")) as page:
        yield page


def shown(browser: Page, folder: Path, page: bytes, *, width: int = 1280, dark: bool = False) -> str:
    """Returns the URL of the page, which is open then, nothing being noted of the one before."""
    file = folder / "report.html"
    file.write_bytes(page)
    browser.requests.clear()
    browser.complaints.clear()
    browser.look(width=width, height=844, dark=dark)
    browser.open(file.as_uri())
    return file.as_uri()


def usual(folder: Path) -> bytes:
    return report_page(view(folder))


def test_the_page_asks_for_nothing_and_complains_of_nothing(browser: Page, tmp_path: Path):
    url = shown(browser, tmp_path, report_page(view(tmp_path)))
    assert browser.requests == [url]
    assert browser.complaints == []


def test_names_that_are_attacks_do_nothing(browser: Page, tmp_path: Path):
    url = shown(browser, tmp_path, hostile(tmp_path))
    assert browser.requests == [url]
    assert browser.complaints == []
    assert browser.run("document.scripts.length + document.images.length") == 0


@pytest.mark.parametrize("make", [usual, hostile])
@pytest.mark.parametrize("width", [320, 390, 768, 1280])
def test_the_page_never_scrolls_sideways(make: Callable[[Path], bytes], width: int, browser: Page, tmp_path: Path):
    shown(browser, tmp_path, make(tmp_path), width=width)
    assert browser.run("document.documentElement.scrollWidth") == width


def test_it_is_dark_for_who_prefers_that(browser: Page, tmp_path: Path):
    ground = "getComputedStyle(document.body).backgroundColor"
    page = report_page(view(tmp_path))
    shown(browser, tmp_path, page)
    assert browser.run(ground) == "rgb(246, 247, 249)"
    shown(browser, tmp_path, page, dark=True)
    assert browser.run(ground) == "rgb(18, 22, 27)"


def test_the_first_key_leads_to_what_skips_the_navigation(browser: Page, tmp_path: Path):
    shown(browser, tmp_path, report_page(view(tmp_path)))
    for kind in ("keyDown", "keyUp"):
        browser.call("Input.dispatchKeyEvent", type=kind, key="Tab", code="Tab", windowsVirtualKeyCode=9)
    assert browser.run("document.activeElement.textContent") == "Skip to the verdict"
    assert cast("float", browser.run("document.activeElement.getBoundingClientRect().left")) >= 0


def test_every_picture_table_and_link_has_a_name_for_who_hears_the_page(browser: Page, tmp_path: Path):
    shown(browser, tmp_path, report_page(view(tmp_path)))
    browser.call("Accessibility.enable")
    nodes = cast("list[dict[str, dict[str, str]]]", browser.call("Accessibility.getFullAXTree")["nodes"])
    heard = [node for node in nodes if not node.get("ignored") and "role" in node]
    named = [node for node in heard if node["role"]["value"] in {"image", "table", "link", "heading", "img"}]
    assert len(named) > 15
    assert [node["role"] for node in named if not node.get("name", {}).get("value")] == []


def test_it_prints(browser: Page, tmp_path: Path):
    shown(browser, tmp_path, report_page(view(tmp_path)), dark=True)
    browser.call("Emulation.setEmulatedMedia", media="print")
    assert browser.run("getComputedStyle(document.body).backgroundColor") == "rgb(255, 255, 255)"
    assert browser.run("getComputedStyle(document.querySelector('nav')).display") == "none"
    browser.call("Emulation.setEmulatedMedia", media="")

"""The pages in a real browser, from a real `simyard serve`: signed in by a key, without one attack that works."""

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple, cast
from urllib.request import urlopen

import pytest

from tasks.gateway.access.access_keys import read_keys
from tasks.storage.store_url import open_store
from tests.factories.gateway.shown_store import ATTACK, Shown, shown_store
from tests.servers.chromium import Page, browsing
from tests.servers.eventually import eventually
from tests.servers.ports import free_port

pytestmark = [pytest.mark.integration, pytest.mark.long]
LONG = f"{ATTACK} {'W' * 300}"


class Served(NamedTuple):
    """A store that is served, and the key that it was begun with."""

    url: str
    key_id: str
    secret: str
    shown: Shown


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """A store in which every text is an attack, and a line longer than any window, behind the command."""
    folder = tmp_path_factory.mktemp("served")
    shown = shown_store(open_store((folder / "store").as_uri()), LONG)
    url = f"http://127.0.0.1:{free_port()}"
    command = [sys.executable, "-m", "simyard", "serve", "--workers", "0", "--port", url.rpartition(":")[2]]
    environment = {**os.environ, "SIMYARD_STORE": (folder / "store").as_uri(), "PREFECT_HOME": str(folder)}
    output = folder / "output"
    with output.open("wb") as file:
        environment["SIMYARD_ACCESS_FILE"] = str(folder / "keys")
        process = subprocess.Popen(command, stdout=file, stderr=file, env=environment)
    try:
        _await(url, process, output)
        (key,) = read_keys(folder / "keys").values()
        yield Served(url, key.key_id, key.secret, shown)
    finally:
        process.terminate()
        process.wait()


def _await(url: str, process: subprocess.Popen[bytes], output: Path) -> None:
    while process.poll() is None:
        try:
            with urlopen(f"{url}/ping"):  # noqa: S310 - its own server
                return
        except OSError:
            time.sleep(0.1)
    raise RuntimeError(output.read_text())


@pytest.fixture(scope="module")
def browser(served: Served, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    """A browser that has signed in by the form."""
    with browsing(tmp_path_factory.mktemp("chromium")) as page:
        page.look(width=1280, height=844)
        page.open(f"{served.url}/fleets")
        assert page.run("location.pathname") == "/sign-in"
        page.run(f"key.value = '{served.key_id}'; secret.value = '{served.secret}'")
        submit(page)
        assert page.run("location.pathname") == "/fleets"
        assert page.complaints == []
        yield page


def submit(page: Page) -> None:
    """Sends the form of the page with the Enter key, and waits for the next page."""
    page.run("document.querySelector('form').secret.focus()")
    for kind in ("keyDown", "keyUp"):
        page.call("Input.dispatchKeyEvent", type=kind, key="Enter", code="Enter", windowsVirtualKeyCode=13, text="\r")
    arrive(page, "/fleets")


def arrive(page: Page, path: str) -> None:
    """Waits until the page with that path is there."""
    eventually(lambda: page.holds(f"location.pathname == '{path}' && document.readyState == 'complete'"))


def show(page: Page, url: str, *, width: int = 1280, dark: bool = False) -> None:
    page.requests.clear()
    page.complaints.clear()
    page.look(width=width, height=844, dark=dark)
    page.open(f"{url}{'&' if '?' in url else '?'}still=1")


def test_every_page_asks_nobody_else_and_complains_of_nothing(browser: Page, served: Served):
    for path in served.shown.pages:
        show(browser, f"{served.url}{path}")
        assert [each for each in browser.requests if not each.startswith((f"{served.url}/", "data:"))] == [], path
        assert browser.complaints == [], path


def test_no_text_of_the_store_runs_or_loads(browser: Page, served: Served):
    for path in served.shown.pages:
        show(browser, f"{served.url}{path}")
        assert browser.run("document.scripts.length") == 0, path
        assert cast("str", browser.run("document.title")).endswith(" - Simyard"), path
        assert browser.run("[...document.images].every(each => each.complete && each.naturalWidth > 0)"), path


@pytest.mark.parametrize("width", [320, 390, 768, 1280])
def test_no_page_scrolls_sideways(width: int, browser: Page, served: Served):
    for path in served.shown.pages:
        show(browser, f"{served.url}{path}", width=width)
        assert browser.run("document.documentElement.scrollWidth") == width, path


def test_it_is_dark_for_who_prefers_that(browser: Page, served: Served):
    ground = "getComputedStyle(document.body).backgroundColor"
    show(browser, served.url + "/")
    assert browser.run(ground) == "rgb(246, 247, 249)"
    show(browser, served.url + "/", dark=True)
    assert browser.run(ground) == "rgb(18, 22, 27)"


def test_every_picture_table_link_and_field_has_a_name_for_who_hears_the_page(browser: Page, served: Served):
    browser.call("Accessibility.enable")
    for width in (390, 1280):
        for path in ("/", f"/batches/{served.shown.batch}", f"/worlds/{served.shown.generation}/world-1-1"):
            show(browser, f"{served.url}{path}", width=width)
            nodes = cast("list[dict[str, dict[str, str]]]", browser.call("Accessibility.getFullAXTree")["nodes"])
            heard = [node for node in nodes if not node.get("ignored") and "role" in node]
            roles = {"image", "img", "table", "link", "heading", "button", "textbox", "navigation"}
            named = [node for node in heard if node["role"]["value"] in roles]
            assert {"table", "heading", "columnheader"} <= {node["role"]["value"] for node in heard}, (path, width)
            assert [node["role"] for node in named if not node.get("name", {}).get("value")] == [], (path, width)


def test_the_first_key_leads_to_what_skips_the_navigation(browser: Page, served: Served):
    show(browser, served.url + "/")
    for kind in ("keyDown", "keyUp"):
        browser.call("Input.dispatchKeyEvent", type=kind, key="Tab", code="Tab", windowsVirtualKeyCode=9)
    assert browser.run("document.activeElement.textContent") == "Skip to the content"


def test_the_session_is_out_of_reach_of_scripts(browser: Page, served: Served):
    show(browser, served.url + "/")
    assert browser.run("document.cookie") == ""


def test_a_report_is_shown_without_script_and_without_the_session_and_its_links_lead_back(
    browser: Page, served: Served
):
    browser.complaints.clear()
    path = f"/batches/{served.shown.batch}/report.html"
    browser.call("Page.navigate", url=f"{served.url}{path}")
    arrive(browser, path)
    assert browser.run("document.title") == "report"
    assert browser.run("self.origin") == "null"
    refused = " ".join(browser.complaints)
    assert "Blocked script execution" in refused
    assert f"Loading the image '{served.url}/fleets' violates" in refused
    browser.run("document.querySelector('button').click()")
    browser.run("document.querySelector('a').click()")
    # A page that goes on by itself stands between them: no browser sends the cookie with a link of another origin.
    eventually(lambda: browser.holds("document.querySelector('h1')?.textContent == 'Batches'"))


def test_who_signs_out_sees_nothing_any_more(served: Served, tmp_path: Path):
    with browsing(tmp_path) as page:
        page.open(f"{served.url}/fleets")
        page.run(f"key.value = '{served.key_id}'; secret.value = '{served.secret}'")
        submit(page)
        page.run("document.querySelector('.out button').click()")
        arrive(page, "/sign-in")
        page.open(f"{served.url}/fleets")
        assert page.run("location.pathname") == "/sign-in"

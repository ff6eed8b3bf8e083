"""Prefect's pages in Chromium: what stands on them, what they complain of, and pictures of them for the documents."""

import io
import json
import os
import re
from pathlib import Path
from typing import cast

from PIL import Image

from tests.integration.stopped.operated import until
from tests.servers.chromium import Page

_SETTLED_S = 3.0
_SIDES = "box.left, box.top, box.right, box.bottom"
_QUALITY = 85
# Icons that Prefect 3.8.8 asks for and does not ship: its own, and that of a run whose state it does not know yet.
_MISSING = ("/favicon.ico", "/ico/undefined.svg")


def shown(page: Page, url: str, text: str, *, height: int = 900) -> str:
    """Returns what stands on a page of Prefect's once some text is there.

    Args:
        page: Of the browser.
        url: What to open.
        text: That is there when the page is.
        height: Of the window, in CSS pixels.
    """
    page.look(width=1280, height=height)
    page.open(url)
    return waited_for(page, text)


def say_password(page: Page, password: str) -> None:
    """Has every page find the password where Prefect's own page of it leaves it."""
    source = f"localStorage.setItem('prefect-password', btoa({json.dumps(password)}))"
    page.call("Page.addScriptToEvaluateOnNewDocument", source=source)


def turned_to(page: Page, tab: str, text: str) -> str:
    """Returns what stands on a page once one of its tabs is chosen and shows some text.

    A tab named in the URL is forgotten: the page has fewer tabs until it knows the run's state.
    """
    chosen = f"(tab => tab && (tab.click(), true))([...document.querySelectorAll('.p-tab')].find({_named(tab)}))"
    until(lambda: page.run(chosen))
    return waited_for(page, text)


def waited_for(page: Page, text: str) -> str:
    """Returns what stands on a page once some text is there, and what is drawn after it."""
    until(lambda: text in _text(page))
    page.run(f"new Promise(done => setTimeout(done, {1000 * _SETTLED_S}))")
    return _text(page)


def painted(page: Page, badge: str) -> int:
    """Returns how many pixels of the graph of a run have the colour of a badge on the page, such as ``Completed``."""
    found = f"[...document.querySelectorAll('[class*=state--]')].find({_named(badge)})"
    colour = str(page.run(f"getComputedStyle({found}).backgroundColor"))
    wanted = tuple(int(part) for part in re.findall(r"\d+", colour)[:3])
    box = cast(
        "list[float]", page.run(f"(box => [{_SIDES}])(document.querySelector('canvas').getBoundingClientRect())")
    )
    left, top, right, bottom = (round(side) for side in box)
    graph = _picture(page).crop((left, top, right, bottom))
    return sum(count for count, pixel in graph.getcolors(graph.width * graph.height) or [] if pixel == wanted)


def pictured(page: Page, name: str) -> None:
    """Writes ``prefect-<name>.jpg``, what the window shows, into the folder that SIMYARD_PICTURES names, if it does."""
    folder = os.environ.get("SIMYARD_PICTURES")
    if folder:
        _picture(page).save(Path(folder) / f"prefect-{name}.jpg", quality=_QUALITY, optimize=True)


def complaints(page: Page) -> list[str]:
    """Returns the errors that the pages complained of, but for icons that Prefect does not ship."""
    page.run("0")  # what the browser has told since is noted with the answer
    bad = [each for each in page.complaints if _is_error(cast("dict[str, object]", json.loads(each)))]
    return [each for each in bad if not any(name in each for name in _MISSING)]


def _is_error(told: dict[str, object]) -> bool:
    entry = cast("dict[str, str]", told.get("entry", {}))
    return "exceptionDetails" in told or told.get("type") == "error" or entry.get("level") == "error"


def _named(text: str) -> str:
    return f"each => each.innerText.trim() === {json.dumps(text)}"


def _picture(page: Page) -> Image.Image:
    return Image.open(io.BytesIO(page.picture(whole=False))).convert("RGB")


def _text(page: Page) -> str:
    return str(page.run("document.body.innerText"))

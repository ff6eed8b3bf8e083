"""Prefect's pages in Chromium: what stands on them, what they complain of, and pictures of them for the documents."""

import io
import os
import time
from pathlib import Path

from PIL import Image

from tests.report.chromium import Page

_WIDTH = 1280
_PATIENCE_S = 120.0
_SETTLED_S = 5.0


def shown(page: Page, url: str, text: str, name: str, *, height: int = 1000) -> str:
    """Returns what stands on a page of Prefect's once some text is there; pictured if SIMYARD_PICTURES says where.

    Args:
        page: Of the browser.
        url: What to open.
        text: That is there when the page is.
        name: Of the picture: ``prefect-<name>.jpg``.
        height: Of the window, in CSS pixels.
    """
    page.look(width=_WIDTH, height=height)
    page.open(url)
    deadline_s = time.monotonic() + _PATIENCE_S
    while text not in (found := str(page.run(_TEXT))):
        assert time.monotonic() < deadline_s, f"no {text!r} on {url}: {found[:2000]}"
        time.sleep(0.5)
    time.sleep(_SETTLED_S)  # what is drawn after it: graphs, editors
    folder = os.environ.get("SIMYARD_PICTURES")
    if folder:
        picture = Image.open(io.BytesIO(page.picture(whole=False))).convert("RGB")
        picture.save(Path(folder) / f"prefect-{name}.jpg", quality=80, optimize=True)
    return str(page.run(_TEXT))


def complaints(page: Page) -> list[str]:
    """Returns what the pages complained of, but for the icon that Prefect does not ship."""
    bad = [each for each in page.complaints if '"level": "error"' in each or "exceptionDetails" in each]
    return [each for each in bad if "/favicon.ico" not in each]


_TEXT = "document.body.innerText"

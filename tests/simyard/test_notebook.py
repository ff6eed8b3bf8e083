"""The notebook of the first hour: run by a real kernel, made a page, and read in a real browser, light and dark."""

import json
import os
import shutil
from pathlib import Path
from typing import Any, cast

import nbformat
import pytest
from nbclient import NotebookClient

from tests.repository import ROOT
from tests.servers.chromium import browsing

NOTEBOOK = ROOT / "examples/notebook/first-hour.ipynb"
# Of the text of each cell of our tables, and of the badges, the contrast with what is behind it (WCAG 2.1).
CONTRAST = """
(() => {
  const light = colour => {
    const parts = colour.match(/[\\d.]+/g).slice(0, 3).map(part => part / 255);
    const linear = parts.map(part => part <= 0.03928 ? part / 12.92 : ((part + 0.055) / 1.055) ** 2.4);
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2];
  };
  const ground = element => {
    for (let at = element; at; at = at.parentElement) {
      const colour = getComputedStyle(at).backgroundColor;
      if (colour !== "rgba(0, 0, 0, 0)") return colour;
    }
    return "rgb(255, 255, 255)";
  };
  const shown = [...document.querySelectorAll(".jp-OutputArea td, .jp-OutputArea span, .jp-OutputArea p")];
  return shown.filter(each => each.innerText.trim()).map(each => {
    const [a, b] = [light(getComputedStyle(each).color), light(ground(each))].sort((x, y) => y - x);
    return [(a + 0.05) / (b + 0.05), each.innerText.slice(0, 60)];
  }).sort((x, y) => x[0] - y[0]);
})()
"""


def test_no_output_is_committed():
    cells = json.loads(NOTEBOOK.read_text())["cells"]
    assert [cell for cell in cells if cell.get("outputs") or cell.get("execution_count")] == []


@pytest.fixture(scope="module")
def ran(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """The notebook, run in a folder that is no checkout."""
    folder = tmp_path_factory.mktemp("notebook") / "examples"
    shutil.copytree(ROOT / "examples", folder)
    notebook: Any = nbformat.read(folder / "notebook/first-hour.ipynb", 4)  # pyright: ignore[reportUnknownMemberType]
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", str(ROOT))
        patch.delenv("SIMYARD_STORE", raising=False)
        resources = {"metadata": {"path": str(folder / "notebook")}}
        NotebookClient(notebook, kernel_name="python3", timeout=None, resources=resources).execute()
    return notebook


@pytest.mark.soak
@pytest.mark.integration
def test_every_cell_shows_what_it_returns_and_prints_nothing(ran: dict[str, Any]):
    outputs = [cell["outputs"] for cell in ran["cells"] if cell["cell_type"] == "code"]
    assert [len(each) for each in outputs] == [0, *[1] * (len(outputs) - 1)]
    assert {each[0]["output_type"] for each in outputs[1:]} == {"execute_result"}
    assert [each for each in outputs[1:] if "text/html" not in each[0]["data"]] == []
    assert sum("image/svg+xml" in each[0]["data"] for each in outputs[1:]) == 2


@pytest.mark.soak
@pytest.mark.integration
@pytest.mark.parametrize("theme", ["light", "dark"])
def test_a_browser_shows_it_legibly_and_without_complaint(ran: dict[str, Any], tmp_path: Path, theme: str):
    from nbconvert import HTMLExporter  # noqa: PLC0415 - slow to import, for this test alone

    exporter = HTMLExporter(theme=theme, mathjax_url="", require_js_url="", jquery_url="")
    body, _ = exporter.from_notebook_node(cast("Any", ran))
    (tmp_path / "page.html").write_text(body)
    with browsing(tmp_path) as page:
        page.look(width=1100, height=1400, dark=theme == "dark")
        page.open((tmp_path / "page.html").as_uri())
        contrasts: Any = page.run(CONTRAST)
        drawn = page.run("[...document.querySelectorAll('.jp-OutputArea img')].map(each => each.naturalWidth)")
        wide = page.run("document.documentElement.scrollWidth")
        if folder := os.environ.get("SIMYARD_PICTURES"):
            Path(folder, f"notebook-{theme}.png").write_bytes(page.picture())
    assert len(contrasts) > 60
    assert contrasts[0][0] >= 4.5, contrasts[:3]
    assert isinstance(drawn, list)
    assert len(drawn) == 3
    assert min(drawn) > 300
    assert wide == 1100
    assert [each for each in page.complaints if "Content" not in each and "data:" not in each] == []

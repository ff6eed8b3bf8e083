"""docs/guide/export.md: its document runs, its table names every format, its Python opens what came out."""

import re
import subprocess
import sys
import zipfile
from pathlib import Path
from typing import get_args

import pytest
import yaml

from specs.pipeline.document import PipelineSpec
from specs.pipeline.world_sections import FORMATS, WorldExport
from specs.robomaker.world_jobs import WorldExportJobErrorCode
from specs.template.body import template_body
from tasks.export.format.formats import EXPORT_FORMATS
from tasks.export.job.world_files import write_zip
from tasks.worlds.generate import generate_world
from tests.repository import ROOT

DOCUMENT = (ROOT / "docs/guide/export.md").read_text()


def block(language: str) -> str:
    (found,) = re.findall(rf"^```{language}\n(.*?)^```$", DOCUMENT, flags=re.MULTILINE | re.DOTALL)
    return found


def first_cells(heading: str) -> list[str]:
    """Returns the first cells of the table with that head."""
    table = DOCUMENT.split(f"| {heading} |")[1].split("\n\n")[0]
    return [line.split("|")[1].split()[0].strip("`") for line in table.splitlines()[2:]]


@pytest.fixture(scope="module")
def unpacked(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("unpacked")
    template = template_body(yaml.safe_load((ROOT / "examples/templates/two-rooms.json").read_text()))
    world = generate_world(template, seed=1, generation="wgj-1", floorplan_index=1, interior_index=1)
    write_zip([world], FORMATS, folder / "worlds.zip")
    with zipfile.ZipFile(folder / "worlds.zip") as bundle:
        bundle.extractall(folder)
    return folder


def test_the_document_is_a_pipeline():
    spec = PipelineSpec.model_validate(yaml.safe_load(block("yaml")))
    assert spec.worldExport is not None
    assert set(spec.worldExport.formats) == set(FORMATS) - {"world"}


def test_the_table_names_every_format_and_the_defaults_are_the_defaults():
    assert sorted(first_cells("format | in the zip | for | needs")) == sorted(FORMATS)
    (said,) = re.findall(r"Without `formats` it writes (.*)\.", DOCUMENT)
    assert set(re.findall(r"`(\w+)`", said)) == set(WorldExport.model_fields["formats"].default)


def test_the_table_says_what_opens_a_format_and_what_must_be_installed():
    table = DOCUMENT.split("| format | in the zip | for | needs |")[1].split("\n\n")[0]
    rows = {row.split("`")[1]: row for row in table.splitlines()[2:]}
    for name, each in EXPORT_FORMATS.items():
        assert f"| {each.opened_by}" in rows[name]
        assert (f"`simyard[{name}]`" in rows[name]) == bool(each.needs)


def test_every_place_that_the_table_names_is_in_the_zip(unpacked: Path):
    places = DOCUMENT.split("| format | in the zip")[1].split("\n\n")[0]
    for name in re.findall(r"`([\w/<>.]+/[\w/<>.]*)`", places):
        pattern = re.sub(r"<\w+>", "*", name.rstrip("./"))
        assert list(unpacked.glob(pattern)) or list(unpacked.glob(f"*/*/*/{pattern}")), name


def test_the_python_opens_what_came_out(unpacked: Path):
    done = subprocess.run(
        [sys.executable, "-c", block("python")], cwd=unpacked, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert all(int(number) > 20 for number in done.stdout.split())


def test_the_codes_are_robomakers():
    assert set(first_cells("code | when")) <= set(get_args(WorldExportJobErrorCode))


def test_the_picture_is_there():
    for picture in re.findall(r"!\[.*\]\((.*)\)", DOCUMENT):
        assert (ROOT / "docs/guide" / picture).stat().st_size > 10_000

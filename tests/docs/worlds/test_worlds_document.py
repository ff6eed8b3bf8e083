"""docs/guide/worlds.md says what the generator does: its certificate, its words, its figures' places."""

import json
import re

import pytest

from benchmarks.worlds.world_quality import TEMPLATES
from benchmarks.worlds.world_templates import SPEED_TEMPLATES
from flows.pipeline.world_imports import import_lines
from flows.preview.world_preview import read_import_options
from specs.data.world import Certificate
from specs.pipeline.world_sections import WorldImport
from specs.template.body import template_body
from tasks.storage.worlds import decode_world
from tasks.worlds.certificate import AREA_TOLERANCE, ASPECT_TOLERANCE
from tasks.worlds.generate import generate_world
from tasks.worlds.importer.import_process import import_source
from tasks.worlds.materials import FLOORINGS, WALLS
from tasks.worlds.resolved_template import FREE_FLOOR
from tests.repository import ROOT

DOCUMENT = (ROOT / "docs/guide/worlds.md").read_text()


def first_cells(text: str) -> list[str]:
    """Returns the first cell of each row of the tables in a text."""
    return [line.split("|")[1].strip(" `") for line in text.splitlines() if line.startswith("|")]


def between(begin: str, end: str) -> str:
    return DOCUMENT.split(begin)[1].split(end)[0]


def test_the_certificate_shown_is_that_of_the_world_in_the_preview():
    shown = json.loads(between("<!-- certificate -->\n\n```json\n", "```\n\n<!-- end of certificate -->"))
    template, seed = re.findall(r"world preview (\S+) --seed (\d+)", DOCUMENT)[0]
    body = template_body(json.loads((ROOT / template).read_text()))
    world = generate_world(body, seed=int(seed), generation="preview", floorplan_index=1, interior_index=1)
    assert shown == json.loads(world.certificate.model_dump_json())


def test_every_field_of_the_certificate_is_explained():
    explained = first_cells(between("## What is guaranteed", "## What is best effort"))
    assert explained == ["field", "---", *Certificate.model_fields]


def test_the_densities_are_those_that_certificates_go_by():
    for density, (least, most) in FREE_FLOOR.items():
        assert f"| {density} | {100 * least:.0f} to {100 * most:.0f} % |" in DOCUMENT


def test_the_tolerances_are_those_that_certificates_go_by():
    assert f"areas within {100 * AREA_TOLERANCE:.0f} %, proportions within {100 * ASPECT_TOLERANCE:.0f} %" in DOCUMENT


@pytest.mark.parametrize("names", [FLOORINGS, WALLS], ids=["floorings", "walls"])
def test_every_material_is_named(names: dict[str, object]):
    *most, last = names
    assert f"{', '.join(most)} and {last}" in DOCUMENT.replace("\n", " ")


def test_the_quality_tables_have_a_row_for_every_template():
    rows = first_cells(between("<!-- quality -->", "<!-- end of quality -->"))
    assert [name for name in rows if name in TEMPLATES] == [*TEMPLATES] * 3


def test_the_import_report_shown_is_that_of_the_map_in_the_examples():
    source, height_m, start = re.findall(r"world import (\S+) --wall-height (\S+) --start=(\S+)", DOCUMENT)[0]
    asked = read_import_options({"source": str(ROOT / source), "wallHeight": float(height_m), "start": start})
    world = decode_world(import_source(asked).world.encode())
    shown = between("<!-- import report -->\n\n```text\n", "```\n\n<!-- end of import report -->")
    assert shown.splitlines() == [*import_lines(world)]


def test_every_field_of_an_import_is_explained():
    named = first_cells(between("| field of `worlds` | option |", "- **The frame is that of the source.**"))
    varied = first_cells(between("### Your building, fifty times", "What moves stands on the floor"))
    assert [name for name in (*named, *varied) if name.isalpha() and name != "field"] == [*WorldImport.model_fields]


def test_the_speed_table_has_its_templates():
    rows = first_cells(between("<!-- speed -->", "<!-- end of speed -->"))
    assert [name for name in rows if name in SPEED_TEMPLATES] == [name for name in SPEED_TEMPLATES for _ in (1, 10)] * 2

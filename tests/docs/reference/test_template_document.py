"""docs/reference/templates.md says what the code gives: its keys, furniture, pictures, examples and commands."""

import re
import subprocess
import sys
from pathlib import Path
from typing import get_args

import pytest
from typer.testing import CliRunner

from flows.cli.shell import app
from specs.errors import DocumentError
from specs.template.body import TemplateBody
from specs.template.interior import ModelType
from tasks.documents.parse import parse
from tasks.documents.source_text import decode_source_text
from tasks.worlds.certificate import broken_guarantees
from tasks.worlds.furniture.catalogue import CATALOGUE
from tasks.worlds.generate import generate_world
from tasks.worlds.materials import FLOORINGS, WALLS
from tests.docs.template_notes import NOTES
from tests.docs.template_page import EXAMPLES, FURNITURE, PAGE, PICTURES, example, keys, lists, note_of, pictures
from tests.docs.tree import between
from tests.repository import ROOT

DOCUMENT = PAGE.read_text()
COMMAND = ".venv/bin/python -m tests.docs.template_page writes it"
MISTAKEN = """
Buildings:
- Floors:
  - Furniture: {}
    Floorplan:
      Rooms:
      - {Type: kitchen, Name: Kitchen, DesiredShape: {Area: 12 m2}}
"""


@pytest.mark.parametrize("name", ["keys", "meanings", "furniture"])
def test_a_list_is_what_the_code_gives(name: str):
    assert between(DOCUMENT, name) == lists()[name], COMMAND


def test_every_key_has_a_note_and_every_note_a_key():
    assert {note_of(key) for key in keys()} == set(NOTES)


def test_every_picture_is_what_the_code_draws_and_there_is_no_other():
    drawn = pictures()
    assert set(drawn) == {*FURNITURE.iterdir(), *PICTURES.iterdir()}, COMMAND
    assert [path.name for path, drawing in drawn.items() if path.read_text() != drawing] == [], COMMAND


def test_every_kind_of_furniture_has_its_picture_in_the_page():
    shown = re.findall(r"pictures/furniture/(\w+)\.svg", DOCUMENT)
    assert sorted(shown) == sorted(CATALOGUE)
    assert len(shown) == len(get_args(ModelType))


@pytest.mark.parametrize(("key", "names"), [("Flooring", FLOORINGS), ("Walls", WALLS)])
def test_every_material_is_named(key: str, names: dict[str, object]):
    assert f"| `{key}` | {', '.join(names)} |" in DOCUMENT


def test_the_refusal_is_what_such_a_template_gets():
    with pytest.raises(DocumentError) as caught:
        parse(TemplateBody, decode_source_text(MISTAKEN.encode(), "mistaken.yaml"), "mistaken.yaml")
    assert between(DOCUMENT, "refusal") == f"```text\n{caught.value}\n```\n"


@pytest.mark.parametrize("name", EXAMPLES)
def test_an_example_gives_certified_worlds_that_meet_its_wishes(name: str):
    for seed in (1, 2):
        world = generate_world(example(name), seed=seed, generation="g", floorplan_index=1, interior_index=1)
        assert broken_guarantees(world.certificate) == ()
        assert world.certificate.wishes
        assert world.certificate.unmet == ()


def test_the_examples_show_every_part_of_a_template():
    written = "".join((ROOT / f"examples/templates/{name}.yaml").read_text() for name in EXAMPLES)
    unused = {key[-1] for key in keys()} - set(re.findall(r"\w+", written))
    assert unused == {"Footprint", "DesiredAspectRatio", "OriginalName"}


@pytest.mark.long
def test_every_command_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    for name, target in ((".venv", Path(sys.prefix)), ("examples", ROOT / "examples")):
        (tmp_path / name).symlink_to(target)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MUJOCO_GL", "nonsense")
    for block in re.findall(r"^```sh\n(.*?)^```$", DOCUMENT, re.DOTALL | re.MULTILINE):
        done = subprocess.run(["bash", "-euc", block], capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
    files = {path.name for path in (tmp_path / ".simyard").iterdir()}
    assert {"home.yaml", "home.svg", "furniture", "flats.svg", "office.svg"} <= files
    assert sorted((tmp_path / ".simyard/furniture").iterdir())[0].name == "BarCabinets.svg"


def test_a_template_alone_is_validated_too():
    file = ROOT / "examples/templates/studio.yaml"
    done = CliRunner().invoke(app, ["validate", str(file)], catch_exceptions=False)
    assert done.stdout == f"{file}: a template of version 1 with 1 room: valid\n"

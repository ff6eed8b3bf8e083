"""What a beginner is told of a template with a fault: where it is, what stands there, and how it is written."""

import pytest

from specs.errors import DocumentError
from specs.template.body import TemplateBody
from tasks.documents.parse import parse
from tests.documents.beginners_templates import BEGINNERS, Body
from tests.repository import ROOT

TABLE = ROOT / "tests/documents/template_faults.txt"


def told(body: Body) -> list[str]:
    """Returns the faults of a template, a line each."""
    with pytest.raises(DocumentError) as caught:
        parse(TemplateBody, body)
    return [str(fault) for fault in caught.value.faults]


def recorded() -> dict[str, list[str]]:
    """Returns what stands in the table, by case."""
    cases = TABLE.read_text().strip().split("\n\n")
    return {name: lines for name, *lines in (case.splitlines() for case in cases)}


def test_every_case_stands_in_the_table_and_no_other():
    assert list(recorded()) == list(BEGINNERS)


@pytest.mark.parametrize("name", BEGINNERS)
def test_a_beginner_is_told_what_the_table_says(name: str):
    assert told(BEGINNERS[name]) == recorded()[name]


def test_a_key_in_other_capitals_does_not_hide_what_is_below_it():
    floor: Body = {"floorplan": {"rooms": [{"type": "Attic", "name": "A"}]}, "interior": {"wals": {}}}
    places = [line.split(": ")[0].rpartition(".")[2] for line in told({"buildings": [{"floors": [floor]}]})]
    assert places == ["buildings", "floors", "floorplan", "interior", "rooms", "wals", "type", "name", "Type"]


def test_what_is_moved_in_thought_never_covers_what_stands_there():
    body: Body = {"Rooms": [], "Buildings": [{"Floors": [{"Floorplan": {"Rooms": [{"Type": "Attic", "Name": "A"}]}}]}]}
    assert {line.split(": ")[0] for line in told(body)} == {"Rooms", "Buildings[0].Floors[0].Floorplan.Rooms[0].Type"}


def test_the_document_that_was_read_is_left_as_it_is():
    body: Body = {"buildings": [], "Rooms": []}
    told(body)
    assert body == {"buildings": [], "Rooms": []}

"""docs/guide/from-robomaker.md: its table has every operation once, its tags are the program's."""

import re

import yaml

from specs.data.outcomes import MOST_OWN_TAGS, OUTCOME, REASON
from specs.robomaker.operations import OPERATIONS
from tests.repository import ROOT

PAGE = (ROOT / "docs/guide/from-robomaker.md").read_text()
TABLE = PAGE.partition("## The 57 operations")[2]


def test_the_table_has_each_operation_once_in_the_order_of_the_interface():
    assert re.findall(r"^\| ([A-Z]\w+) \| .+ \|$", TABLE, re.MULTILINE) == list(OPERATIONS)


def test_the_tags_of_an_outcome_are_the_programs():
    assert re.findall(r"^\| `(simyard:[\w-]+)` \|", PAGE, re.MULTILINE) == [OUTCOME, REASON]
    assert f"leave {MOST_OWN_TAGS} of 50" in PAGE


def test_the_script_has_a_fleet_of_its_own():
    """The agents of a document's fleet end with its run: a deployment to that fleet as well would wait for them."""
    documents = [yaml.safe_load(path.read_text()) for path in sorted((ROOT / "examples").glob("*.yaml"))]
    fleets = [each["deployment"]["fleet"]["name"] for each in documents if "deployment" in each]
    script = (ROOT / "examples/from-robomaker/template_to_fleet.py").read_text()
    assert fleets
    assert not set(fleets) & set(re.findall(r'create_fleet\(name="([\w-]+)"\)', script))

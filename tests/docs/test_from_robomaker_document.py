"""docs/guide/from-robomaker.md: its table has every operation once, its tags are the program's."""

import re

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

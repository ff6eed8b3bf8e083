"""docs/guide/prefect.md: every example is in its table, every link leads somewhere, and no example is left out."""

import re

from tests.repository import ROOT

DOCUMENT = ROOT / "docs/guide/prefect.md"
TEXT = DOCUMENT.read_text()
EXAMPLES = sorted(path.name for path in (ROOT / "examples/prefect").glob("*.py"))


def test_every_example_is_in_the_table():
    assert sorted(set(re.findall(r"examples/prefect/(\w+\.py)", TEXT))) == EXAMPLES


def test_every_example_is_run_by_the_test_that_the_page_names():
    test, _ = re.findall(r"`(tests/\S+\.py)`", TEXT)
    run = (ROOT / test).read_text()
    assert [name for name in EXAMPLES if name.removesuffix(".py") not in run] == []

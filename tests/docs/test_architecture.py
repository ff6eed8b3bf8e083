"""docs/architecture.md leads through the house that there is, and the house keeps its own rules."""

import re
from collections import Counter
from pathlib import Path

import pytest

from tests.docs.tree import PAGE, between, first_line, lists, packages
from tests.repository import ROOT

ARCHITECTURE = PAGE.read_text()
CONTRIBUTING = (ROOT / "CONTRIBUTING.md").read_text()
ADDED = (
    "furniture type",
    "results column",
    "gate rule",
    "outcome reason",
    "job kind",
    "engine",
    "failure code",
    "sensor",
)
HOUSES = ("specs", "tasks", "flows", "simyard", "tests", "benchmarks")
PRODUCT = ("specs", "tasks", "flows", "simyard")
MOST_LINES = 620
MOST_FOLDERS = 4  # tasks/simulate/engines/planar
EVERY_CAPABILITY_HAS = frozenset({"step", "task"})
# The field's own words, and things rather than deeds.
# `reaping` is the name under which people deploy the flow.
ING = frozenset({"scoring", "slicing", "staging", "recording", "encoding", "keyring", "delta_debugging", "reaping"})
TERMS = """
agent; application; ARN; batch; bucket; bundle; chunk; claim; deployment; desired state;
engine; episode; evidence; failure code; fleet; gate; generation; job; lane; outcome; plan; program;
record; reported state; resolved template; robot; rollout; rule; run; scenario; stage; store; template; verdict;
version; wave; world
"""


def modules() -> list[Path]:
    """Every module that is no ``__init__``, relative to the root; not those of bundles that tests drive."""
    found = (path.relative_to(ROOT) for house in HOUSES for path in sorted((ROOT / house).rglob("*.py")))
    return [path for path in found if path.name != "__init__.py" and "bundles" not in path.parts]


def product_modules() -> list[Path]:
    """Those that are neither tests nor benchmarks."""
    return [path for path in modules() if path.parts[0] in PRODUCT]


def section(heading: str) -> str:
    return ARCHITECTURE.split(f"\n## {heading}\n")[1].split("\n## ", maxsplit=1)[0]


def terms() -> list[str]:
    return re.findall(r"^- \*\*(.+?)\*\*: ", section("Glossary"), re.MULTILINE)


def test_every_module_that_the_page_names_is_there():
    named = re.findall(r"`((?:specs|tasks|flows|simyard|tests)/[\w/]+\.py)`", ARCHITECTURE)
    assert len(named) > 60
    assert [path for path in named if not (ROOT / path).is_file()] == []


def test_every_path_that_the_recipes_name_is_there():
    named = re.findall(r"`((?:specs|tasks|flows|simyard|tests)/[\w/.-]+)`", CONTRIBUTING)
    assert len(named) > 20
    assert [path for path in named if not (ROOT / path).exists()] == []


@pytest.mark.parametrize("thing", [*ADDED, "export format"])
def test_a_thing_that_people_add_has_a_recipe_of_at_most_five_lines(thing: str):
    _, recipe = re.split(rf"^## How to add an? {thing}\n\n", CONTRIBUTING, flags=re.MULTILINE)
    lines = recipe.split("\n## ", maxsplit=1)[0].strip().splitlines()
    assert 1 <= len(lines) <= 5


@pytest.mark.parametrize("heading", ["The life of an episode", "The life of a world", "The life of an update"])
def test_the_steps_of_a_life_are_counted_and_name_modules(heading: str):
    steps = re.findall(r"^(\d+)\. (.*)$", section(heading), re.MULTILINE)
    assert [int(number) for number, _ in steps] == list(range(1, len(steps) + 1))
    assert [text for _, text in steps if not re.match(r"`[\w/]+\.py`", text)] == []


@pytest.mark.parametrize("name", ["tree", "layers", "keys", "house"])
def test_the_page_has_the_folders_layers_and_keys_that_the_code_has(name: str):
    assert between(ARCHITECTURE, name) == lists()[name], "python -m tests.docs.tree writes it anew"


def test_every_term_of_the_glossary_is_there_once_and_they_are_sorted():
    assert [term for term, count in Counter(terms()).items() if count > 1] == []
    assert terms() == sorted(terms(), key=str.casefold)
    assert {term.strip() for term in TERMS.split(";")} - set(terms()) == set()


def test_each_folder_says_in_one_line_what_lives_there_and_who_may_import_it():
    lines = {package: first_line(package) for package in packages()}
    assert [str(path) for path, line in lines.items() if not re.search(r"\S\. .+ imports? it\.$", line)] == []


def test_a_module_is_one_topic_that_is_read_in_one_go():
    sizes = {str(path): len((ROOT / path).read_text().splitlines()) for path in product_modules()}
    assert {path: size for path, size in sizes.items() if size > MOST_LINES} == {}


def test_no_folder_lies_deeper_than_two_below_a_capability():
    assert [str(path) for path in packages() if len(path.parts) > MOST_FOLDERS] == []


def test_a_name_is_one_module_s():
    stems = Counter(path.stem for path in product_modules() if path.stem not in EVERY_CAPABILITY_HAS)
    assert {stem: count for stem, count in stems.items() if count > 1} == {}


def test_modules_are_named_with_nouns_and_verbs():
    names = (path.stem.removeprefix("test_") for path in modules())
    assert sorted({name for name in names if name.removeprefix("test_") not in ING and name.endswith("ing")}) == []

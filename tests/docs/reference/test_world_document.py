"""docs/reference/world-format.md says what specs/data/world.py holds: every document, every field, its type."""

import re
from types import NoneType, UnionType
from typing import Literal, Union, get_args, get_origin

import pytest

from specs.base import Spec
from specs.data.world import WORLD_VERSION, World
from tests.repository import ROOT

DOCUMENT = (ROOT / "docs/reference/world-format.md").read_text()
WORDS: dict[object, str] = {float: "number", int: "integer", str: "text", bool: "boolean", NoneType: "null"}


def inside(annotation: object) -> set[type[Spec]]:
    """Returns the documents that a type mentions, and those inside them."""
    if isinstance(annotation, type) and issubclass(annotation, Spec):
        found = {annotation}
        for field in annotation.model_fields.values():
            found |= inside(field.annotation)
        return found
    return {each for part in get_args(annotation) for each in inside(part)}


def words(annotation: object) -> str:
    """Returns a type as the document writes it."""
    origin, parts = get_origin(annotation), get_args(annotation)
    if origin is Literal:
        return ", ".join(f'"{part}"' for part in parts)
    if origin in (Union, UnionType):
        return " or ".join(words(part) for part in parts)
    if origin is tuple:
        return f"list of {words(parts[0])}" if parts[-1] is Ellipsis else f"[{', '.join(map(words, parts))}]"
    if isinstance(annotation, type) and issubclass(annotation, Spec):
        return f"[{annotation.__name__}](#{annotation.__name__.lower()})"
    return WORDS[annotation]


def documented(heading: str) -> list[tuple[str, str]]:
    """Returns field and type of each row under a heading, every one of which has a meaning."""
    section = DOCUMENT.split(f"\n## {heading}\n")[1].split("\n## ")[0]
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in section.split("\n") if line[:3] == "| `"]
    assert all(len(row) == 3 and row[2] for row in rows)
    return [(row[0].strip("`"), row[1]) for row in rows]


MODELS = sorted(inside(World), key=lambda model: model.__name__)


@pytest.mark.parametrize("model", MODELS, ids=lambda model: model.__name__)
def test_every_field_is_documented_with_its_type(model: type[Spec]) -> None:
    fields = [(name, words(field.annotation)) for name, field in model.model_fields.items()]
    assert documented(model.__name__) == fields


def test_every_document_has_a_section_and_no_other_has() -> None:
    assert sorted(re.findall(r"^## (\w+)$", DOCUMENT, re.MULTILINE)) == [model.__name__ for model in MODELS]


def test_the_version_is_documented() -> None:
    assert f"version {WORLD_VERSION} of the format" in DOCUMENT

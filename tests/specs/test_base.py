"""The base of every document, and its digest."""

import copy
import json
import math

import pytest
from pydantic import JsonValue, ValidationError

from specs.base import canonical_document, canonical_json, digest, without_absent
from specs.data.world import Solid
from specs.field_types import OutputLocation
from specs.pipeline.gate_section import Gate

FIELDS: dict[str, object] = {
    "name": "table_top",
    "shape": "box",
    "center_m": (1.0, 2.0, 0.7),
    "half_extents_m": (0.4, 0.4, 0.02),
    "yaw_rad": 0.0,
    "color": (0.5, 0.5, 0.5),
    "outline_m": None,
}


def test_a_document_without_checks_is_the_one_with_checks() -> None:
    checked, unchecked = Solid.model_validate(FIELDS), Solid.unchecked(dict(FIELDS))
    assert unchecked == checked
    assert hash(unchecked) == hash(checked)
    assert unchecked.model_dump_json() == checked.model_dump_json()
    assert unchecked.model_dump(exclude_unset=True) == checked.model_dump(exclude_unset=True)
    assert copy.deepcopy(unchecked) == checked


def test_a_copy_of_it_leaves_it_as_it_is() -> None:
    unchecked = Solid.unchecked(dict(FIELDS))
    assert unchecked.model_copy(update={"name": "leg"}).name == "leg"
    assert unchecked.name == "table_top"
    assert unchecked.model_fields_set == set(FIELDS)


def test_nobody_changes_it() -> None:
    with pytest.raises(ValidationError, match="frozen"):
        setattr(Solid.unchecked(dict(FIELDS)), "name", "leg")  # noqa: B010 - the type checker refuses an assignment


def test_canonical_json_is_sorted_compact_and_utf_8():
    assert canonical_json({"b": 1, "a": ["ü", None]}) == '{"a":["ü",null],"b":1}'.encode()


def test_canonical_json_reads_back_as_it_was():
    document = {"a": {"c": [1, 2.5, True]}, "b": "x"}

    assert json.loads(canonical_json(document)) == document  # pyright: ignore[reportArgumentType] - JSON, as a literal


def test_what_json_has_no_words_for_is_refused():
    with pytest.raises(ValueError, match="not JSON compliant"):
        canonical_json({"a": math.nan})


def test_absent_fields_do_not_count():
    assert canonical_document(OutputLocation(s3Bucket="abc", s3Prefix=None)) == {"s3Bucket": "abc"}
    assert digest(OutputLocation(s3Bucket="abc")) == digest(OutputLocation(s3Bucket="abc", s3Prefix=None))
    assert len(digest(OutputLocation())) == 64


def test_a_gate_that_an_older_version_noted_is_the_same_without_its_absent_fields():
    gate = Gate.model_validate({"successRate": {"atLeast": 0.9}, "stopEarly": True})
    noted: dict[str, JsonValue] = {
        "successRate": {"atLeast": 0.9, "confidence": 0.95},  # there was no over yet
        "noWorseThan": None,
        "stopEarly": True,
    }
    assert without_absent(noted) == without_absent(gate.model_dump(mode="json")) == canonical_document(gate)
    assert without_absent([{"a": None}, None, 1]) == [{}, None, 1]

"""Documents made of fields that are known to be right are those that a check of the fields gives."""

import copy

import pytest
from pydantic import ValidationError

from specs.data.world import Solid

FIELDS: dict[str, object] = {
    "name": "table_top",
    "shape": "box",
    "center_m": (1.0, 2.0, 0.7),
    "half_extents_m": (0.4, 0.4, 0.02),
    "yaw_rad": 0.0,
    "color": (0.5, 0.5, 0.5),
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

"""The models against RoboMaker's published interface, field by field."""

from collections.abc import Callable, Iterator
from typing import Any

import pytest

from tests.specs.contract_forms import (
    FIELD_RULINGS,
    RULINGS,
    SHARED_FIELDS,
    Contract,
    contract,
    differences,
    models,
    reachable,
)

OPERATIONS = [*contract()["operations"]]


@pytest.mark.parametrize("operation", OPERATIONS)
def test_an_operation_is_modelled_exactly_as_the_contract_has_it(operation: str):
    document = contract()

    found = differences(document, reachable(document, [operation]))

    assert found == []


def test_requests_and_responses_of_every_operation_are_modelled():
    operations = contract()["operations"]

    names = {operations[name][side] for name in OPERATIONS for side in ("input", "output")}

    assert names <= models().keys()


def test_every_document_class_is_a_shape_of_the_contract():
    shapes = contract()["shapes"]

    unknown = {name for name in models() if shapes.get(name, {}).get("type") != "structure"}

    assert unknown == SHARED_FIELDS


def test_every_ruling_departs_from_a_bound_that_the_contract_has():
    shapes = contract()["shapes"]

    for name, ruling in RULINGS.items():
        assert ruling.items().isdisjoint({key: shapes[name].get(key) for key in ruling}.items())
    for (name, field), ruling in FIELD_RULINGS.items():
        stated = shapes[shapes[name]["fields"][field]["shape"]]
        assert ruling.items().isdisjoint({key: stated.get(key) for key in ruling}.items())


def test_fields_say_the_same_as_their_shapes():
    document = contract()
    for shape in document["shapes"].values():
        for field in shape.get("fields", {}).values():
            for key in ("type", "min", "max", "pattern", "enum", "item", "key", "value"):
                assert field.get(key) == document["shapes"][field["shape"]].get(key)


def test_a_field_that_the_contract_adds_is_missed():
    document = contract()
    document["shapes"]["WorldCount"]["fields"]["cellarCount"] = {"shape": "Integer", "required": False}

    assert len(differences(document, ["WorldCount"])) == 1


def test_a_shape_that_the_contract_adds_is_missed():
    document = contract()
    document["shapes"]["Cellar"] = {"type": "structure", "fields": {}}

    assert differences(document, ["Cellar"]) == ["Cellar: not modelled"]


def test_every_single_change_of_the_contract_is_noticed():
    names = reachable(contract(), OPERATIONS)
    unnoticed = [what for what, document in _changed_contracts(names) if not differences(document, names)]

    assert unnoticed == []


def _changed_contracts(names: list[str]) -> Iterator[tuple[str, Contract]]:
    """Yields the contract with one field dropped, required or not, or one bound, pattern or enum changed."""
    document = contract()
    shapes = document["shapes"]
    for name in names:
        fields = shapes[name].get("fields", {})
        for field in list(fields):
            kept = fields.pop(field)
            yield f"{name} without {field}", document
            fields[field] = {**kept, "required": not kept["required"]}
            yield f"{name}.{field} required {not kept['required']}", document
            fields[field] = kept
    for name in sorted(_leaves(shapes, names)):
        for key, change in _CHANGES.items():
            if shapes[name].get(key) is not None and key not in RULINGS.get(name, {}):
                kept = shapes[name][key]
                shapes[name][key] = change(kept)
                yield f"{name} with {key} {shapes[name][key]}", document
                shapes[name][key] = kept


_CHANGES: dict[str, Callable[[Any], object]] = {
    "min": lambda value: value + 1,
    "max": lambda value: value - 1,
    "pattern": lambda value: f"{value}x",
    "enum": lambda value: value[1:],
}


def _leaves(shapes: dict[str, Any], names: list[str]) -> set[str]:
    pending = [field["shape"] for name in names for field in shapes[name].get("fields", {}).values()]
    seen: set[str] = set()
    while pending:
        name = pending.pop()
        if name not in seen and shapes[name]["type"] != "structure":
            seen.add(name)
            pending.extend(shapes[name][side] for side in ("item", "key", "value") if side in shapes[name])
    return seen

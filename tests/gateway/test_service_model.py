"""The model that SDKs get against RoboMaker's published interface, shape by shape."""

import json
import re
from pathlib import Path
from typing import Any

import pytest

from tasks.gateway.service_model import paginators, service_model, write_model
from tests.specs.contract_forms import FIELD_RULINGS, RULINGS, contract
from tests.specs.own_words import robomakers_pattern, robomakers_words

MODEL = service_model()
STATED = contract()
STRUCTURES = sorted(name for name, shape in STATED["shapes"].items() if shape["type"] == "structure")
LISTS = {name: ruling for name, ruling in RULINGS.items() if STATED["shapes"][name]["type"] == "list"}
"""Rulings on lengths; bounds that only RoboMaker's prose has are checked by the server, as they were."""
NUMBERS = {"long": "integer"}


def stated(name: str, ruling: dict[str, int | None]) -> Any:  # noqa: ANN401 - JSON
    """A shape of the contract with all below it, scalars by what they are and not by their names."""
    shape: dict[str, Any] = {**STATED["shapes"][name], **LISTS.get(name, {}), **ruling}
    if shape["type"] == "structure":
        return name
    below = {side: stated(shape[side], {}) for side in ("item", "key", "value") if side in shape}
    kind = NUMBERS.get(shape["type"], shape["type"])
    return {"type": kind, **bounds(shape), **below}


def modelled(name: str) -> Any:  # noqa: ANN401 - same
    shape = MODEL["shapes"][name]
    if shape["type"] == "structure":
        return name
    below = {side: modelled(shape[side]["shape"]) for side in ("key", "value") if side in shape}
    if "member" in shape:
        below["item"] = modelled(shape["member"]["shape"])
    return {"type": shape["type"], **bounds(shape), **below}


def bounds(shape: dict[str, Any]) -> dict[str, Any]:
    # Nothing is shorter than empty: a minimum of 0 and none are the same; of numbers, zero counts.
    low = shape.get("min")
    words, pattern = shape.get("enum"), shape.get("pattern")
    return {
        "min": low if shape["type"] in {"integer", "long", "float"} else low or None,
        "max": shape.get("max"),
        "pattern": pattern and robomakers_pattern(pattern),
        "enum": words and robomakers_words(words),
    }


@pytest.mark.parametrize("name", STRUCTURES)
def test_a_structure_is_modelled_exactly_as_the_contract_has_it(name: str):
    shape, known = MODEL["shapes"][name], STATED["shapes"][name]

    assert set(shape.get("required", [])) == set(known["required"])
    assert {field: modelled(below["shape"]) for field, below in shape["members"].items()} == {
        field: stated(below["shape"], FIELD_RULINGS.get((name, field), {})) for field, below in known["fields"].items()
    }
    for field, below in known["fields"].items():
        for key in ("location", "locationName", "idempotencyToken", "deprecated"):
            assert shape["members"][field].get(key) == below.get(key), (field, key)


def test_the_operations_are_those_of_the_contract():
    assert MODEL["operations"].keys() == STATED["operations"].keys()
    for name, operation in MODEL["operations"].items():
        known = STATED["operations"][name]
        assert operation["http"] == {"method": known["method"], "requestUri": known["path"]}
        assert (operation["input"]["shape"], operation["output"]["shape"]) == (known["input"], known["output"])
        assert {each["shape"] for each in operation["errors"]} == {each["shape"] for each in known["errors"]}


def test_exceptions_have_the_contracts_status():
    for name, known in STATED["shapes"].items():
        if known.get("exception"):
            assert MODEL["shapes"][name]["exception"]
            assert MODEL["shapes"][name]["error"]["httpStatusCode"] == known["httpStatus"]


def test_the_paginators_are_those_of_the_contract():
    known = {name: each["pagination"] for name, each in STATED["operations"].items() if each.get("pagination")}

    assert paginators()["pagination"] == known


def test_every_shape_that_is_named_is_there_and_every_shape_is_named():
    named = set(re.findall(r'"shape": "(\w+)"', json.dumps(MODEL)))

    assert named == MODEL["shapes"].keys()


def test_every_operation_and_structure_is_documented_in_words_of_our_own():
    shapes = [shape for shape in MODEL["shapes"].values() if shape["type"] == "structure"]

    for each in (MODEL, *MODEL["operations"].values(), *shapes):
        assert re.fullmatch(r"(<p>\S.*\.</p>)+", each["documentation"]), each


def test_writing_replaces_an_older_model(tmp_path: Path):
    (tmp_path / "robomaker/2018-06-29").mkdir(parents=True)
    (tmp_path / "robomaker/2018-06-29/service-2.json").write_text("{")

    written = write_model(tmp_path)

    assert [path.name for path in written] == ["service-2.json", "paginators-1.json"]
    assert json.loads(written[0].read_text()) == MODEL

"""The contract and the models, both brought into one form that can be compared."""

import importlib
import json
from collections.abc import Iterator, Mapping
from functools import cache
from typing import Any

from specs.base import Spec
from tests.repository import ROOT
from tests.specs.own_words import robomakers_pattern, robomakers_words

DATA = ROOT / "tests" / "data"
MODULES = (
    "specs.field_types",
    "specs.robomaker.applications",
    "specs.robomaker.deployment",
    "specs.robomaker.deployment",
    "specs.robomaker.simulation",
    "specs.robomaker.simulation",
    "specs.robomaker.simulation_descriptions",
    "specs.robomaker.shared_operations",
    "specs.robomaker.world_jobs",
    "specs.robomaker.world_jobs",
)
SHARED_FIELDS = {
    "ApplicationAnswer",
    "ApplicationUse",
    "ApplicationVersionAnswer",
    "ApplicationsPage",
    "BatchedJobSettings",
    "CreateApplicationVersionRequest",
    "DeleteApplicationRequest",
    "FilteredPage",
    "JobSettings",
    "Page",
}
"""Classes that only hold what several shapes have in common."""

RULINGS: dict[str, dict[str, int | None]] = {
    # docs/reference/robomaker.md, section 4: a batch of 1000 is not truncated to 100
    "SimulationJobSummaries": {"max": None},
    "Robots": {"max": None},  # the same: a fleet of 1001 robots can be described
    "Filters": {"max": 3},  # docs/reference/robomaker.md, section 9: accept three
    "BatchTimeoutInSeconds": {"min": 1, "max": 1_209_600},
    "MaxConcurrency": {"min": 1, "max": 1_000_000},
    "DeploymentTimeout": {"min": 60, "max": 604_800},
}
"""Bounds that docs/reference/robomaker.md sets otherwise than the interface, or takes from its prose."""

FIELD_RULINGS: dict[tuple[str, str], dict[str, int | None]] = {
    # docs/reference/robomaker.md, section 5: the list of a request keeps its bound
    ("FinishedWorldsSummary", "succeededWorlds"): {"max": None},
    # docs/reference/robomaker.md, section 4: a matrix makes more than a request has entries
    ("StartSimulationJobBatchResponse", "pendingRequests"): {"max": None},
    ("DescribeSimulationJobBatchResponse", "pendingRequests"): {"max": None},
}
"""The same for one field of a shape that others have, too."""

_TYPES = {
    "string": "string",
    "integer": "integer",
    "long": "integer",
    "float": "number",
    "timestamp": "number",
    "boolean": "boolean",
}
Form = dict[str, Any]
Contract = dict[str, Any]


@cache
def contract_text() -> str:
    """The contract's JSON."""
    return (DATA / "contract.json").read_text()


def contract() -> Contract:
    """A fresh copy of the contract, free to be changed."""
    return json.loads(contract_text())


@cache
def models() -> dict[str, type[Spec]]:
    """Every document class of the modules that model RoboMaker, by name."""
    found = [importlib.import_module(name) for name in MODULES]
    return {
        name: value
        for module in found
        for name, value in vars(module).items()
        if isinstance(value, type) and issubclass(value, Spec) and value.__module__ == module.__name__
    }


@cache
def modelled(name: str) -> Mapping[str, Form]:
    """The fields of a model in the common form."""
    schema = models()[name].model_json_schema()
    assert schema["additionalProperties"] is False
    required = schema.get("required", [])
    return {field: _field(below, required=field in required) for field, below in schema.get("properties", {}).items()}


def stated(document: Contract, name: str) -> dict[str, Form]:
    """The fields of a structure in the contract in the common form."""
    fields: dict[str, Form] = document["shapes"][name].get("fields", {})
    return {
        field: {
            "required": below["required"],
            "deprecated": bool(below.get("deprecated")),
            "type": _stated_type(document, below["shape"], FIELD_RULINGS.get((name, field), {})),
        }
        for field, below in fields.items()
    }


def reachable(document: Contract, operations: list[str]) -> list[str]:
    """Every structure that the requests and answers of some operations consist of."""
    shapes: dict[str, Any] = document["shapes"]
    pending = [document["operations"][name][side] for name in operations for side in ("input", "output")]
    seen: dict[str, None] = {}
    while pending:
        name = pending.pop()
        if name not in seen:
            seen[name] = None
            pending.extend(_below(shapes[name]))
    return [name for name in seen if shapes[name]["type"] == "structure"]


def differences(document: Contract, names: list[str]) -> list[str]:
    """What the models say differently from the contract, one line each."""
    return [line for name in names for line in _differences(document, name)]


def _differences(document: Contract, name: str) -> Iterator[str]:
    if name not in models():
        yield f"{name}: not modelled"
        return
    expected, found = stated(document, name), modelled(name)
    for field in sorted(expected.keys() | found.keys()):
        if expected.get(field) != found.get(field):
            yield f"{name}.{field}: the contract says {expected.get(field)}, the model {found.get(field)}"


def _below(shape: dict[str, Any]) -> list[str]:
    fields = [field["shape"] for field in shape.get("fields", {}).values()]
    return fields + [shape[side] for side in ("item", "key", "value") if side in shape]


def _stated_type(document: Contract, name: str, ruling: Mapping[str, int | None] | None = None) -> Form:
    shape: dict[str, Any] = {**document["shapes"][name], **RULINGS.get(name, {}), **(ruling or {})}
    match shape["type"]:
        case "structure":
            return {"structure": name}
        case "list":
            return {**_size(shape), "list": _stated_type(document, shape["item"])}
        case "map":
            key, value = _stated_type(document, shape["key"]), _stated_type(document, shape["value"])
            return {**_size(shape), "map": [key, value]}
        case scalar:
            bounds = _size(shape) if scalar == "string" else {"min": shape.get("min"), "max": shape.get("max")}
            return {"scalar": _TYPES[scalar], **bounds, "pattern": shape.get("pattern"), "enum": shape.get("enum")}


def _size(shape: dict[str, Any]) -> Form:
    # Nothing is shorter than empty: a minimum of 0 and none are the same.
    return {"min": shape.get("min") or None, "max": shape.get("max")}


def _field(schema: Form, *, required: bool) -> Form:
    options = [option for option in schema.get("anyOf", [schema]) if option.get("type") != "null"]
    assert len(options) == 1
    return {"required": required, "deprecated": schema.get("deprecated", False), "type": _modelled_type(options[0])}


def _modelled_type(schema: Form) -> Form:
    if "$ref" in schema:
        return {"structure": schema["$ref"].rpartition("/")[2]}
    if schema["type"] == "array":
        size = {"min": schema.get("minItems") or None, "max": schema.get("maxItems")}
        return {**size, "list": _modelled_type(schema["items"])}
    if schema["type"] == "object":
        ((pattern, value),) = schema["patternProperties"].items()
        key = _modelled_type({"type": "string", "pattern": pattern, **schema["propertyNames"]})
        size = {"min": schema.get("minProperties") or None, "max": schema.get("maxProperties")}
        return {**size, "map": [key, _modelled_type(value)]}
    return _modelled_scalar(schema)


def _modelled_scalar(schema: Form) -> Form:
    enum = schema.get("enum", [schema["const"]] if "const" in schema else None)
    enum = enum and robomakers_words(enum)
    pattern = schema.get("pattern")
    if pattern is not None:
        assert pattern.startswith("^(?:")
        assert pattern.endswith(")$")
        pattern = robomakers_pattern(pattern[4:-2])
    if schema["type"] == "string":
        size = {"min": schema.get("minLength") or None, "max": schema.get("maxLength")}
    else:
        size = {"min": schema.get("minimum"), "max": schema.get("maximum")}
    return {"scalar": schema["type"], **size, "pattern": pattern, "enum": enum}

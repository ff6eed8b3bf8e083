"""What Prefect's pages make a form of: fields named in words, explained, bounded, and refused where they are here."""

import json
import re
from collections.abc import Iterator
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest
import yaml
from prefect.utilities.callables import parameter_schema
from prefect.utilities.schema_tools.validation import is_valid
from pydantic import ValidationError

from specs.base import Spec, attribute_docs, words
from specs.pipeline.document import PipelineSpec
from tests.repository import ROOT

DEPLOYMENTS = yaml.safe_load((ROOT / "prefect.yaml").read_text())["deployments"]
ENTRYPOINTS = sorted({each["entrypoint"] for each in DEPLOYMENTS})
BOUNDLESS = {
    ("QuantileRule", "atLeast"),
    ("QuantileRule", "atMost"),
    ("Normal", "mean"),
    ("Normal", "sd"),
    ("Normal", "atLeast"),
    ("Normal", "atMost"),
    ("PipelineWorldCount", "floorplanCount"),
    ("PipelineWorldCount", "interiorCountPerFloorplan"),
}
"""What may be any number; how many worlds are too many, a setting says."""
Schema = dict[str, Any]
DOCUMENT = yaml.safe_load((ROOT / "examples/quickstart.yaml").read_text())


@cache
def shown(entrypoint: str) -> Schema:
    """What `prefect deploy` stores."""
    module, _, name = entrypoint.rpartition(".")
    return parameter_schema(getattr(import_module(module), name)).model_dump_for_openapi()


def fields(schema: Schema) -> Iterator[tuple[str, str, Schema]]:
    """Every field of every document that a parameter consists of."""
    for name, below in schema.get("definitions", {}).items():
        for field, described in below.get("properties", {}).items():
            yield name, field, described


def in_words(title: str) -> bool:
    return not re.search(r"[a-z][A-Z]|_", re.sub("RoboMaker|MuJoCo", "", title))


def accepted(document: object) -> bool:
    try:
        PipelineSpec.model_validate(document)
    except ValidationError:
        return False
    return True


def changed(path: str, value: object) -> dict[str, Any]:
    """The quickstart with one field set, or left out for `...`."""
    document = json.loads(json.dumps(DOCUMENT))
    *above, last = (int(key) if key.isdigit() else key for key in path.split("."))
    inner = document
    for key in above:
        inner = inner[key]
    if value is ...:
        del inner[last]
    else:
        inner[last] = value
    return document


@pytest.mark.parametrize("entrypoint", ENTRYPOINTS)
def test_every_field_of_a_form_has_a_title_in_words_and_a_description(entrypoint: str):
    schema = shown(entrypoint)
    found = [*fields(schema), *(("", name, below) for name, below in schema["properties"].items())]

    assert [(name, field) for name, field, below in found if not below.get("description")] == []
    assert [below["title"] for _, _, below in found if not in_words(below["title"])] == []
    assert [name for name, below in schema["definitions"].items() if not in_words(below["title"])] == []


@pytest.mark.parametrize("entrypoint", ENTRYPOINTS)
def test_every_number_of_a_form_has_its_bounds(entrypoint: str):
    bounds = ({"minimum", "exclusiveMinimum"}, {"maximum", "exclusiveMaximum"})
    loose = {
        (name, field)
        for name, field, below in fields(shown(entrypoint))
        for option in (below, below.get("items", {}), *below.get("anyOf", ()))
        if option.get("type") in ("integer", "number") and not all(bound & option.keys() for bound in bounds)
    }

    assert loose <= BOUNDLESS


@pytest.mark.parametrize(
    ("model", "field", "told"),
    [
        ("WorldGeneration", "robotRadius", "From 0.05 to 0.6."),
        ("PipelineWorldCount", "floorplanCount", "From 1."),
        ("Matrix", "seeds", "From 1 to 10,000."),
        ("SuccessRate", "atLeast", "From 0 to below 1."),
        ("CollisionRate", "atMost", "Above 0, below 1."),
    ],
)
def test_a_form_tells_the_bounds_in_words(model: str, field: str, told: str):
    described = shown("flows.prefect.flows.pipeline")["definitions"][model]["properties"][field]["description"]
    assert described.endswith(f" {told}")


@pytest.mark.parametrize("entrypoint", ENTRYPOINTS)
def test_the_order_of_the_fields_is_told_because_postgresql_forgets_it(entrypoint: str):
    for below in shown(entrypoint)["definitions"].values():
        positions = [field["position"] for field in below.get("properties", {}).values()]
        assert positions == list(range(len(positions)))


@pytest.mark.parametrize("entrypoint", ENTRYPOINTS)
def test_there_is_no_choice_that_the_form_cannot_show(entrypoint: str):
    assert "oneOf" not in json.dumps(shown(entrypoint))
    for _, _, below in fields(shown(entrypoint)):
        assert all("$ref" in option or option["title"] for option in below.get("anyOf", ()))


def test_a_field_is_explained_in_one_place_only():
    twice = [
        (model.__name__, name)
        for model in _models(Spec)
        for name, field in model.model_fields.items()
        if field.description and name in attribute_docs(model)
    ]

    assert twice == []


def test_an_attribute_that_is_explained_exists():
    for model in _models(Spec):
        assert attribute_docs(model).keys() <= model.model_fields.keys()


@pytest.mark.parametrize(
    ("name", "title"),
    [
        ("worldCount", "World count"),
        ("streamUI", "Stream UI"),
        ("vpcConfig", "VPC config"),
        ("VPCConfig", "VPC config"),
        ("s3Bucket", "S3 bucket"),
        ("enableOnPublicIp", "Enable on public IP"),
        ("PipelineWorldCount", "Pipeline world count"),
        ("Name", "Name"),
        ("x", "X"),
    ],
)
def test_names_become_words(name: str, title: str):
    assert words(name) == title


@pytest.mark.parametrize("file", sorted((ROOT / "examples").glob("*.yaml")), ids=lambda file: file.name)
def test_the_server_takes_every_example(file: Path):
    document = yaml.safe_load(file.read_text())
    assert accepted(document)
    assert is_valid({"spec": document}, shown("flows.prefect.flows.pipeline"))


@pytest.mark.parametrize(
    ("path", "value"),
    [
        ("gate", None),
        ("gate", ...),
        ("gate.quantiles", None),
        ("gate", {"collisionRate": {"atMost": 0.05}, "stopEarly": True}),
        ("gate.stopEarly", None),
        ("worldExport.iamRole", None),
        ("worldExport.worlds", ["wgj-0123456789abcdef/world-1-1"]),
        ("worldGeneration.template", {"Version": "1"}),
        ("worldGeneration.template", {"Version": "2", "Buildings": [{"Floors": [{}]}]}),
        ("worldGeneration.tags", {"night": "1"}),
        ("worldGeneration.robotRadius", 0.6),
        ("simulationBatch.batchPolicy.timeoutInSeconds", None),
        ("simulationBatch.batchPolicy.timeoutInSeconds", 1_209_600),
        ("simulationBatch.matrix.seeds", [1, 2, 3]),
        ("simulationBatch.matrix.environmentVariables", {}),
        ("simulationBatch.createSimulationJobRequests.0.failureBehavior", None),
        ("simulationBatch.createSimulationJobRequests.0.compute", {"simulationUnitLimit": 15}),
        ("deployment.fleet", "couriers"),
        ("deployment.deploymentConfig", None),
        ("deployment.deploymentConfig.robotDeploymentTimeoutInSeconds", 60),
    ],
)
def test_what_a_document_may_say_the_server_takes(path: str, value: object):
    document = changed(path, value)
    assert accepted(document)
    assert is_valid({"spec": document}, shown("flows.prefect.flows.pipeline"))


@pytest.mark.parametrize(
    ("path", "value"),
    [
        ("name", "two words"),
        ("name", ...),
        ("nothing", 1),
        ("gate.successRate.atLeast", 1),
        ("gate.stopEarly", "yes"),
        ("worldExport.formats", []),
        ("worldExport.worlds", "some"),
        ("worldGeneration.template", 1),
        ("worldGeneration.template", {"Version": "3"}),
        ("worldGeneration.robotRadius", 0.61),
        ("simulationBatch.batchPolicy.timeoutInSeconds", 1_209_601),
        ("simulationBatch.batchPolicy.timeoutInSeconds", "900"),
        ("simulationBatch.matrix.seeds", 0),
        ("simulationBatch.matrix.environmentVariables", {"MAX_SPEED": []}),
        ("simulationBatch.createSimulationJobRequests.0.maxJobDurationInSeconds", 0),
        ("deployment.fleet", {"name": "couriers", "localAgents": 21}),
        ("deployment.deploymentConfig.robotDeploymentTimeoutInSeconds", 59),
    ],
)
def test_what_a_document_may_not_say_the_server_refuses(path: str, value: object):
    document = changed(path, value)
    assert not accepted(document)
    assert not is_valid({"spec": document}, shown("flows.prefect.flows.pipeline"))


def _models(base: type[Spec]) -> Iterator[type[Spec]]:
    for model in base.__subclasses__():
        yield model
        yield from _models(model)

"""A store with a secret in it is refused before Prefect makes a run of it, by every flow, and not repeated."""

import inspect
import os
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest
import yaml
from prefect import Flow
from prefect.settings import PREFECT_API_AUTH_STRING, PREFECT_API_URL, temporary_settings
from prefect.utilities.callables import parameter_schema
from prefect.utilities.schema_tools.validation import ValidationError, validate

from flows.prefect.flows import pipeline, simulation_batch, world_generation
from flows.prefect.parameters import store_at, with_document
from specs.errors import DocumentError
from specs.pipeline.document import PipelineSpec
from specs.pipeline.world_sections import WorldGeneration
from tasks.storage.jobs.records import read
from tasks.storage.store_url import open_store
from tests.repository import ROOT

ENTRYPOINTS = sorted(
    {each["entrypoint"] for each in yaml.safe_load((ROOT / "prefect.yaml").read_text())["deployments"]}
)
SECRETS = [
    "s3://key:hunter2@bucket/prefix",
    "https://user:hunter2@host/folder",
    "s3://hunter2@bucket",
    "s3://key:hunter2/hunter2@bucket/prefix",
    "s3://bucket/prefix?secret_key=hunter2",
    "s3://bucket/prefix?X-Amz-Signature=hunter2",
    "file:///folder?a=b&Token=hunter2",
]


def loaded(entrypoint: str) -> Flow[..., object]:
    module, _, name = entrypoint.rpartition(".")
    return getattr(import_module(module), name)


@cache
def schema(name: str) -> dict[str, Any]:
    """Returns what a server checks the parameters of a flow by."""
    return parameter_schema(getattr(import_module("flows.prefect.flows"), name)).model_dump_for_openapi()


def refused_store(flow: Flow[..., object], store: str) -> str:
    with pytest.raises(DocumentError) as told:
        flow.serialize_parameters({"store": store})
    with pytest.raises(DocumentError):
        flow.validate_parameters({"store": store})
    return str(told.value)


@pytest.mark.parametrize("entrypoint", ENTRYPOINTS)
@pytest.mark.parametrize("store", SECRETS)
def test_a_call_with_a_secret_makes_no_run(entrypoint: str, store: str):
    assert "hunter2" not in refused_store(loaded(entrypoint), store)


@pytest.mark.parametrize("entrypoint", ENTRYPOINTS)
@pytest.mark.parametrize("store", SECRETS)
def test_the_schema_that_the_server_checks_refuses_a_secret_and_does_not_repeat_it(entrypoint: str, store: str):
    with pytest.raises(ValidationError, match="for field 'store'") as told:
        validate({"store": store}, schema(entrypoint.rpartition(".")[2]), raise_on_error=True, ignore_required=True)
    assert "hunter2" not in str(told.value)


@pytest.mark.parametrize("entrypoint", ENTRYPOINTS)
@pytest.mark.parametrize(
    "store",
    [
        None,
        "s3://bucket/prefix",
        "file:///home/a%20b@c/keys=1",
        "file:///a:b/c",
        "block://s3-bucket/team",
        "block://aws-credentials/t/b",
    ],
)
def test_a_store_without_a_secret_is_taken(entrypoint: str, store: str | None):
    given = {"store": store}
    validate(given, schema(entrypoint.rpartition(".")[2]), raise_on_error=True, ignore_required=True)
    assert loaded(entrypoint).serialize_parameters(given) == given


def test_a_flow_with_other_options_refuses_the_same():
    refused_store(loaded(ENTRYPOINTS[0]).with_options(retries=1), SECRETS[0])


@pytest.mark.parametrize("url", ["s3://bucket/prefix", "file:///folder", None])
def test_a_url_stays_as_it_is(url: str | None, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.delenv("SIMYARD_STORE", raising=False)
    assert store_at(url) == url


@pytest.mark.parametrize(
    "reference",
    [
        "block://",
        "block://s3-bucket",
        "block://s3-bucket/name/more",
        "block://aws-credentials/name",
        "block://gcs-bucket/name",
    ],
)
def test_another_form_is_refused_with_those_that_are_known(reference: str):
    with pytest.raises(DocumentError, match="block://s3-bucket/NAME, or block://aws-credentials/NAME/bucket/prefix"):
        store_at(reference)


EXAMPLE = {"document": "worlds-only.yaml"}
FLOWS = ("pipeline", "world_generation", "world_export", "simulation_batch", "deployment_sync")


def refused(parameters: dict[str, object]) -> str:
    with pytest.raises(DocumentError) as told:
        pipeline.validate_parameters(parameters)
    return str(told.value)


@pytest.mark.parametrize("name", FLOWS)
def test_the_server_takes_a_file_for_a_document(name: str):
    validate({"spec": {"document": "examples/quickstart.yaml"}}, schema(name), raise_on_error=True)


@pytest.mark.parametrize("spec", [yaml.safe_load((ROOT / "examples/quickstart.yaml").read_text()), EXAMPLE])
def test_a_deployment_may_have_either_when_it_is_made(spec: object):
    validate({"spec": spec}, schema("pipeline"), raise_on_error=True, ignore_required=True)


@pytest.mark.parametrize(
    ("spec", "told"),
    [
        ({"document": 1}, "'spec.document'. Failure reason: 1 is not of type 'string'"),
        ({"document": "a.yaml", "name": "n"}, "'spec'. Failure reason: Additional properties are not allowed ('name'"),
        ({"name": "n", "nothing": 1}, "Additional properties are not allowed ('nothing' was unexpected)"),
        ({"name": "n", "worldGeneration": {"template": "t", "worldCount": {"floorplanCount": 0}}}, "floorplanCount"),
    ],
)
def test_the_server_speaks_of_what_was_meant_and_not_of_either(spec: object, told: str):
    with pytest.raises(ValidationError) as said:
        validate({"spec": spec}, schema("pipeline"), raise_on_error=True)
    assert told in str(said.value)


def test_the_server_takes_the_words_of_a_search_and_no_others():
    over: dict[str, object] = {"start": "anywhere", "worlds": "all", "MAX_SPEED": {"uniform": [0, 1]}}
    document: dict[str, object] = {"name": "searched", "search": {"over": over}}
    validate({"spec": document}, schema("pipeline"), raise_on_error=True)
    document["search"] = {"over": {"start": "somewhere"}}
    with pytest.raises(ValidationError, match="somewhere"):
        validate({"spec": document}, schema("pipeline"), raise_on_error=True)


def test_a_file_becomes_the_document_and_its_folder_the_base(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(ROOT)
    given = {"spec": {"document": "examples/worlds-only.yaml"}, "store": None, "base": "."}
    validated = pipeline.validate_parameters(given)
    assert isinstance(validated["spec"], PipelineSpec)
    assert (validated["spec"].name, validated["base"]) == ("two-worlds", "examples")


def test_a_path_starts_from_the_base():
    validated = pipeline.validate_parameters({"spec": EXAMPLE, "base": str(ROOT / "examples")})
    assert Path(validated["base"]) == ROOT / "examples"


def test_without_a_base_the_file_still_gives_one(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(ROOT)
    assert pipeline.validate_parameters({"spec": {"document": "examples/worlds-only.yaml"}})["base"] == "examples"


def test_a_stage_takes_its_section_of_the_file():
    validated = world_generation.validate_parameters({"spec": EXAMPLE, "base": str(ROOT / "examples")})
    assert isinstance(validated["spec"], WorldGeneration)


def test_a_section_that_the_file_has_not_is_told():
    file = str(ROOT / "examples/worlds-only.yaml")
    with pytest.raises(DocumentError, match="simulationBatch: missing: a section, which this flow runs"):
        simulation_batch.validate_parameters({"spec": {"document": file}})


def test_a_missing_file_is_a_fault_that_names_where_it_was_looked_for(tmp_path: Path):
    said = refused({"spec": {"document": "none.yaml"}, "base": str(tmp_path)})
    assert f"spec.document: 'none.yaml': a document on this machine; {tmp_path / 'none.yaml'} is no file" in said


def test_all_faults_of_the_file_are_told(tmp_path: Path):
    (tmp_path / "bad.yaml").write_text("name: two words\nnothing: 1\nworldGeneration: {template: none.json}\n")
    said = refused({"spec": {"document": "bad.yaml"}, "base": str(tmp_path)})
    assert [field for field in ("name", "nothing", "worldCount", "none.json") if field not in said] == []


@pytest.mark.parametrize(
    "content",
    [
        "hunter2",
        "root:$6$hunter2:19000:0:99999:7:::\n",
        "-----BEGIN PRIVATE KEY-----\nhunter2\n-----END PRIVATE KEY-----\n",
        "PASSWORD=hunter2\n",
        "password: hunter2\n",
        "name: hunter 2\nusers: [{token: hunter2}]\n",
        "[hunter2]",
    ],
)
def test_a_file_that_is_no_document_is_refused_without_a_word_of_what_it_holds(tmp_path: Path, content: str):
    (tmp_path / "credentials").write_text(content)
    said = refused({"spec": {"document": "credentials"}, "base": str(tmp_path)})
    assert f"{tmp_path / 'credentials'}: 1 fault\n  document: no document of Simyard's: " in said
    assert "worldGeneration" in said
    assert "hunter" not in said


@pytest.mark.parametrize("spec", [{"document": "a.yaml", "name": "n"}, {"document": 1}, {"document": ""}])
def test_what_names_a_file_and_more_is_refused(spec: dict[str, object]):
    assert refused({"spec": spec}).startswith("spec: 1 fault")


def test_a_document_is_left_as_it_is():
    given = {"spec": {"name": "n", "worldExport": {}}, "base": "."}
    assert with_document(pipeline.fn, given) is given


def test_a_flow_that_says_nothing_of_files_is_left_alone():
    def own(spec: dict[str, str]) -> None: ...

    given = {"spec": EXAMPLE}
    assert with_document(own, given) is given
    assert "spec" in inspect.signature(own).parameters


def test_a_password_is_refused_before_the_file_is_read():
    with pytest.raises(DocumentError, match="a URL with a secret in it"):
        pipeline.validate_parameters({"spec": {"document": "none.yaml"}, "store": "s3://key:hunter2@bucket"})


@pytest.mark.integration
@pytest.mark.long
def test_the_content_decides_which_run_it_is(prefect_server: str, tmp_path: Path):
    file, store = tmp_path / "night.yaml", (tmp_path / "store").as_uri()
    text = (ROOT / "examples/worlds-only.yaml").read_text().replace("templates/", f"{ROOT}/examples/templates/")
    settings: dict[Any, str] = {
        PREFECT_API_URL: prefect_server,
        PREFECT_API_AUTH_STRING: os.environ["PREFECT_API_AUTH_STRING"],
    }
    runs: list[str] = []
    with temporary_settings(settings):
        for content in (text, f"# tonight\n{text}", text.replace("seed: 3", "seed: 4")):
            file.write_text(content)
            named: Any = {"document": file.name}
            runs.append(pipeline(named, store=store, base=str(tmp_path)).run)
    assert len(set(runs)) == 3
    described = [_spec_digest(store, run) for run in runs]
    assert described[0] == described[1] != described[2]


def _spec_digest(store: str, run: str) -> object:
    return read(open_store(store), "pipeline-run", run).request_digest

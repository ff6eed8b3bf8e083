"""A store with a secret in it is refused before Prefect makes a run of it, by every flow, and not repeated."""

from importlib import import_module

import pytest
import yaml
from prefect import Flow
from prefect.utilities.callables import parameter_schema
from prefect.utilities.schema_tools.validation import ValidationError, validate

from specs.errors import DocumentError
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


def refused(flow: Flow[..., object], store: str) -> str:
    with pytest.raises(DocumentError) as told:
        flow.serialize_parameters({"store": store})
    with pytest.raises(DocumentError):
        flow.validate_parameters({"store": store})
    return str(told.value)


@pytest.mark.parametrize("entrypoint", ENTRYPOINTS)
@pytest.mark.parametrize("store", SECRETS)
def test_a_call_with_a_secret_makes_no_run(entrypoint: str, store: str):
    assert "hunter2" not in refused(loaded(entrypoint), store)


@pytest.mark.parametrize("entrypoint", ENTRYPOINTS)
@pytest.mark.parametrize("store", SECRETS)
def test_the_schema_that_the_server_checks_refuses_a_secret_and_does_not_repeat_it(entrypoint: str, store: str):
    schema = parameter_schema(loaded(entrypoint)).model_dump_for_openapi()
    with pytest.raises(ValidationError, match="for field 'store'") as told:
        validate({"store": store}, schema, raise_on_error=True, ignore_required=True)
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
    schema = parameter_schema(loaded(entrypoint)).model_dump_for_openapi()
    given = {"store": store}
    validate(given, schema, raise_on_error=True, ignore_required=True)
    assert loaded(entrypoint).serialize_parameters(given) == given


def test_a_flow_with_other_options_refuses_the_same():
    refused(loaded(ENTRYPOINTS[0]).with_options(retries=1), SECRETS[0])

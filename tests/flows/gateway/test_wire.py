"""Every request and answer there can be, through botocore's serializer, the application, and botocore's parser."""

from collections.abc import Generator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest
from botocore.client import BaseClient
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from flows.gateway.gateway import Gateway
from specs.arn import ArnForm
from specs.base import Spec
from specs.robomaker.operations import OPERATIONS, shapes
from tasks.gateway.rest_json import with_arns
from tasks.storage.store_url import open_store, store_id
from tests.factories.gateway.robomaker_client import client_of, running_application
from tests.factories.strategies import shape

OWN_ARNS = st.sampled_from(
    ["arn:simyard:robot:another:one", "arn:simyard:simulation-job:x:simb-0123456789abcdef/12", "arn:aws:iam::1:role/x"]
)


class Echo:
    """Answers every operation with what a test puts there, and keeps what it was asked."""

    def __init__(self) -> None:
        self.answer: Spec | None = None
        self.request: Spec | None = None

    def handle(self, _gateway: Gateway, request: Spec) -> Spec:
        assert self.answer
        self.request = request
        return self.answer


@pytest.fixture(scope="module")
def echo() -> Echo:
    return Echo()


@pytest.fixture(scope="module")
def form(store_folder: Path) -> ArnForm:
    return ArnForm(store_id(open_store(store_folder.as_uri())), "us-west-2")


@pytest.fixture(scope="module")
def store_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("wire") / "store"


@pytest.fixture(scope="module")
def client(echo: Echo, store_folder: Path) -> Generator[BaseClient]:
    store = open_store(store_folder.as_uri())
    with running_application(store, dict.fromkeys(OPERATIONS, echo.handle)) as send:
        yield client_of(send, store_folder.parent / "models")


FEW = settings(max_examples=3, suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow])
MANY = settings(FEW, max_examples=40)


@pytest.mark.parametrize("name", OPERATIONS)
@FEW
@given(data=st.data())
def test_requests_arrive_and_answers_are_parsed_whole(
    data: st.DataObject, name: str, echo: Echo, client: BaseClient, form: ArnForm
):
    exchange(data, name, echo, client, form)


@pytest.mark.long
@pytest.mark.parametrize("name", OPERATIONS)
@MANY
@given(data=st.data())
def test_many_requests_arrive_and_answers_are_parsed_whole(
    data: st.DataObject, name: str, echo: Echo, client: BaseClient, form: ArnForm
):
    exchange(data, name, echo, client, form)


def exchange(data: st.DataObject, name: str, echo: Echo, client: BaseClient, form: ArnForm) -> None:
    asked, answered = shapes()[OPERATIONS[name].request], shapes()[OPERATIONS[name].answer]
    arns = data.draw(OWN_ARNS)
    sent = with_arns(data.draw(shape(asked.__name__)), asked, lambda _: arns)
    echo.answer = answered.model_validate(with_arns(data.draw(shape(answered.__name__)), answered, lambda _: arns))

    parsed = client._make_api_call(name, sent)  # pyright: ignore[reportAttributeAccessIssue, reportUnknownVariableType]

    expected = asked.model_validate(with_arns(sent, asked, form.own))
    token = getattr(echo.request, "clientRequestToken", None)  # botocore fills one in
    assert echo.request == expected.model_copy(update={"clientRequestToken": token} if token else {})
    document = echo.answer.model_dump(mode="json", exclude_none=True)
    del parsed["ResponseMetadata"]
    assert plain(parsed) == plain(with_arns(document, answered, form.robomakers))


def plain(value: Any) -> Any:  # noqa: ANN401 - JSON
    """Parsed data with times as numbers, and numbers as botocore's times have them, to the microsecond."""
    if isinstance(value, datetime):
        value = value.timestamp()
    if isinstance(value, dict):
        return {key: plain(below) for key, below in value.items()}
    if isinstance(value, list):
        return [plain(below) for below in value]
    return datetime.fromtimestamp(value, UTC).timestamp() if isinstance(value, float) else value

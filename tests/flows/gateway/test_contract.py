"""RoboMaker's contract, operation by operation: requests arrive, answers are parsed, errors are documented."""

import json
from collections.abc import Generator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest
from botocore.client import BaseClient
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from flows.gateway.gateway import Gateway
from specs.arn import KINDS, ArnForm, ResourceKind, arn
from specs.base import Spec
from specs.robomaker.operations import OPERATIONS, STATUSES, document_shapes
from tasks.applications.registry import publish_bundle
from tasks.deploy.fleet.fleet_registry import create_fleet, create_robot, register_robot
from tasks.gateway.rest_json import with_arns
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import job_id
from tasks.storage.store_url import open_store, store_id
from tests.factories.gateway.robomaker_client import Send, client_of, request_of, running_application
from tests.factories.planned_batches import begun, put_world
from tests.factories.strategies import shape
from tests.repository import ROOT

OWN_ARNS = st.sampled_from(
    ["arn:simyard:robot:another:one", "arn:simyard:simulation-job:x:simb-0123456789abcdef/12", "arn:aws:iam::1:role/x"]
)
FEW = settings(max_examples=3, suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow])
MANY = settings(FEW, max_examples=40)
BATCH = job_id("simulation-job-batch", "tok")
THERE: dict[ResourceKind, str] = {
    "robot-application": "courier",
    "simulation-application": "delivery",
    "world": "g/w0",
    "deployment-fleet": "aisle",
    "robot": "r2",
    "simulation-job-batch": BATCH,
    "simulation-job": f"{BATCH}/0",
}
STRANGE = [
    "arn:",
    "arn:aws:iam::1:role/x",
    "arn:simyard:robot",
    "arn:simyard:robot:x:../..",
    "arn:aws:robomaker:a:b:world",
]
SETTINGS = settings(
    max_examples=2,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow, HealthCheck.data_too_large],
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


@pytest.mark.parametrize("name", OPERATIONS)
@FEW
@given(data=st.data())
def test_requests_arrive_and_answers_are_parsed_whole(
    data: st.DataObject, name: str, echo: Echo, client: BaseClient, form: ArnForm
):
    exchange_by_sdk(data, name, echo, client, form)


@pytest.mark.long
@pytest.mark.parametrize("name", OPERATIONS)
@MANY
@given(data=st.data())
def test_many_requests_arrive_and_answers_are_parsed_whole(
    data: st.DataObject, name: str, echo: Echo, client: BaseClient, form: ArnForm
):
    exchange_by_sdk(data, name, echo, client, form)


def exchange_by_sdk(data: st.DataObject, name: str, echo: Echo, client: BaseClient, form: ArnForm) -> None:
    asked, answered = document_shapes()[OPERATIONS[name].request], document_shapes()[OPERATIONS[name].answer]
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


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Store:
    """A store with something of most kinds."""
    made = open_store((tmp_path_factory.mktemp("every") / "store").as_uri())
    publish_bundle(made, "robot-application", "courier", ROOT / "applications/courier")
    publish_bundle(made, "simulation-application", "delivery", ROOT / "applications/delivery")
    put_world(made, "g/w0")
    create_fleet(made, "aisle")
    create_robot(made, "r2", "X86_64")
    register_robot(made, "aisle", "r2")
    begun(made)
    return made


@pytest.fixture(scope="module")
def send(store: Store) -> Generator[Send]:
    with running_application(store) as sending:
        yield sending


def arns(store: Store) -> st.SearchStrategy[str]:
    own = store_id(store)
    there = [arn(kind, own, path) for kind, path in THERE.items()]
    there += [arn(kind, own, "missing-1") for kind in KINDS]
    return st.sampled_from([*there, *map(ArnForm(own, "eu-west-1").robomakers, there), *STRANGE])


@pytest.mark.parametrize("name", OPERATIONS)
@SETTINGS
@given(data=st.data())
def test_an_operation_answers_its_shape_or_a_documented_error(data: st.DataObject, name: str, store: Store, send: Send):
    exchange(data, name, store, send)


@pytest.mark.long
@pytest.mark.parametrize("name", OPERATIONS)
@settings(SETTINGS, max_examples=25)
@given(data=st.data())
def test_an_operation_asked_much_answers_its_shape_or_a_documented_error(
    data: st.DataObject, name: str, store: Store, send: Send
):
    exchange(data, name, store, send)


def exchange(data: st.DataObject, name: str, store: Store, send: Send) -> None:
    operation, asked = OPERATIONS[name], document_shapes()[OPERATIONS[name].request]
    named = data.draw(st.lists(arns(store), min_size=1, max_size=3))
    request = with_arns(data.draw(shape(asked.__name__)), asked, lambda text: named[len(text) % len(named)])

    answer = send(*request_of(operation, request))

    if answer.status == 200:
        document_shapes()[operation.answer].model_validate_json(answer.body)
    else:
        known = {f"{error}Exception": STATUSES.get(error, 400) for error in operation.errors}
        assert known.get(answer.error) == answer.status, answer
        assert answer.status < 500, answer
        message = json.loads(answer.body)["message"]
        assert message
        assert str(Path(store.url.removeprefix("file://"))) not in message

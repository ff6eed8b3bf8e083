"""Every operation, asked anything that its request may say, answers its shape or an error that is documented for it."""

import json
from collections.abc import Generator
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from specs.arn import KINDS, ArnForm, ResourceKind, arn
from specs.robomaker.operations import OPERATIONS, STATUSES, shapes
from tasks.applications.registry import publish_bundle
from tasks.deploy.fleet.fleet_registry import create_fleet, create_robot, register_robot
from tasks.gateway.rest_json import with_arns
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import job_id
from tasks.storage.store_url import open_store, store_id
from tests.factories.gateway.robomaker_client import Send, request_of, running_application
from tests.factories.planned_batches import begun, put_world
from tests.factories.strategies import shape
from tests.repository import ROOT

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
    operation, asked = OPERATIONS[name], shapes()[OPERATIONS[name].request]
    named = data.draw(st.lists(arns(store), min_size=1, max_size=3))
    request = with_arns(data.draw(shape(asked.__name__)), asked, lambda text: named[len(text) % len(named)])

    answer = send(*request_of(operation, request))

    if answer.status == 200:
        shapes()[operation.answer].model_validate_json(answer.body)
    else:
        known = {f"{error}Exception": STATUSES.get(error, 400) for error in operation.errors}
        assert known.get(answer.error) == answer.status, answer
        assert answer.status < 500, answer
        message = json.loads(answer.body)["message"]
        assert message
        assert str(Path(store.url.removeprefix("file://"))) not in message

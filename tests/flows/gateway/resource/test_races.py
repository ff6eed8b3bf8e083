"""Calls at once, on a folder and on a real S3 server."""

from collections.abc import Callable
from threading import Barrier, Thread

import pytest

from specs.errors import LimitExceeded, ResourceAlreadyExists
from tasks.storage.base.store import Store
from tasks.storage.templates import named_templates
from tests.flows.gateway.jobs.asked import TEMPLATE, Asked
from tests.flows.gateway.resource.test_tags import BORN, a_robot, a_robot_application, a_template, a_world

MANY = 6


def at_once(act: Callable[[int], object]) -> None:
    """Does something as often as there are threads, all at the same time."""
    start = Barrier(MANY)

    def one(number: int) -> None:
        start.wait()
        act(number)

    threads = [Thread(target=one, args=(number,)) for number in range(MANY)]
    for each in threads:
        each.start()
    for each in threads:
        each.join()


@pytest.mark.long
@pytest.mark.parametrize("make", [a_robot, a_robot_application, a_template, a_world])
def test_none_of_many_gateways_loses_a_tag(make: Callable[[Asked], str], store: Store) -> None:
    resource = make(Asked(store))
    at_once(lambda number: Asked(store).call("TagResource", resourceArn=resource, tags={f"k{number}": str(number)}))
    found = Asked(store).call("ListTagsForResource", resourceArn=resource)["tags"]
    assert found == {**BORN, **{f"k{number}": str(number) for number in range(MANY)}}


@pytest.mark.long
def test_of_many_templates_of_one_name_one_is_made(store: Store) -> None:
    made: list[str] = []

    def create(_: int) -> None:
        try:
            made.append(Asked(store).call("CreateWorldTemplate", name="flat", templateBody=TEMPLATE.read_text())["arn"])
        except ResourceAlreadyExists:
            return

    at_once(create)
    assert [Asked(store).arn("world-template", each.id) for each in named_templates(store)] == made
    assert len(made) == 1


@pytest.mark.long
def test_one_gateway_never_exceeds_a_quota(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SIMYARD_MAX_FLEETS", "2")
    refused: list[int] = []

    def create(number: int) -> None:
        try:
            Asked(store).call("CreateFleet", name=f"f{number}")
        except LimitExceeded:
            refused.append(number)

    at_once(create)
    assert len(refused) == MANY - 2
    assert len(store.keys("fleets")) == 2

import json
from concurrent.futures import ThreadPoolExecutor
from functools import partial

import pytest

from specs.errors import DocumentError, ResourceNotFound, StoreError
from tasks.deploy.fleet.fleet_registry import (
    create_fleet,
    create_robot,
    deregister_robot,
    fleets,
    members,
    read_desired,
    read_fleet,
    read_reported,
    read_robot,
    register_robot,
    robots,
)
from tasks.deploy.fleet.states import Reported
from tasks.deploy.rollout.controller import ask_robot
from tasks.storage.base.keys import desired_key, reported_key
from tasks.storage.base.store import Store, encode_document
from tests.deploy.yard import desired_state

# Sequences grow from the milliseconds of this on.
_desired = partial(desired_state, issued_at_s=1.0)
GARBAGE = [b"", b"{", b"[]", b"\xff\xfe", b'{"robot": "r1"}', b"9" * 5000, b" " * ((1 << 20) + 1)]


def test_a_fleet_that_is_made_twice_is_one_fleet(file_store: Store) -> None:
    first = create_fleet(file_store, "couriers", {"site": "hall"})

    assert create_fleet(file_store, "couriers") == first
    assert fleets(file_store) == [first]


@pytest.mark.parametrize(
    "reference",
    [
        "couriers",
        "arn:simyard:deployment-fleet:0123456789ab:couriers",
        "arn:aws:robomaker:us-west-2:111111111111:deployment-fleet/couriers/1551203485821",
    ],
)
def test_a_fleet_is_found_by_name_and_by_either_arn(reference: str, file_store: Store) -> None:
    fleet = create_fleet(file_store, "couriers")

    assert read_fleet(file_store, reference) == fleet


@pytest.mark.parametrize("reference", ["nobody", "arn:simyard:robot:0123456789ab:couriers", "arn:nonsense"])
def test_what_is_no_fleet_is_missing(reference: str, file_store: Store) -> None:
    create_fleet(file_store, "couriers")

    with pytest.raises(ResourceNotFound):
        read_fleet(file_store, reference)


def test_a_robot_belongs_to_one_fleet(file_store: Store) -> None:
    for fleet in ("couriers", "cleaners"):
        create_fleet(file_store, fleet)
    create_robot(file_store, "r1")
    register_robot(file_store, "couriers", "r1")

    with pytest.raises(DocumentError, match="it is in couriers"):
        register_robot(file_store, "cleaners", "r1")

    assert register_robot(file_store, "couriers", "r1").fleet == "couriers"


def test_of_fleets_that_register_a_robot_at_once_one_gets_it(file_store: Store) -> None:
    names = [f"fleet-{number}" for number in range(6)]
    for name in names:
        create_fleet(file_store, name)
    create_robot(file_store, "r1")

    def register(fleet: str) -> bool:
        try:
            return register_robot(file_store, fleet, "r1").fleet == fleet
        except DocumentError:
            return False

    with ThreadPoolExecutor(6) as pool:
        assert sum(pool.map(register, names)) == 1


def test_members_are_a_fleets_robots_in_the_order_they_were_made(file_store: Store) -> None:
    create_fleet(file_store, "couriers")
    for name in ("z", "a", "loner"):
        create_robot(file_store, name)
    for name in ("a", "z"):
        register_robot(file_store, "couriers", name)

    assert [robot.name for robot in members(file_store, "couriers")] == ["z", "a"]
    assert [robot.name for robot in robots(file_store)] == ["z", "a", "loner"]


def test_a_robot_that_left_its_fleet_may_join_another(file_store: Store) -> None:
    for fleet in ("couriers", "cleaners"):
        create_fleet(file_store, fleet)
    create_robot(file_store, "r1")
    register_robot(file_store, "couriers", "r1")

    deregister_robot(file_store, "r1")

    assert members(file_store, "couriers") == []
    assert register_robot(file_store, "cleaners", "r1").fleet == "cleaners"


def test_a_robot_nobody_made_is_missing(file_store: Store) -> None:
    with pytest.raises(ResourceNotFound):
        read_robot(file_store, "r1")


def test_asking_twice_for_one_deployment_asks_once(file_store: Store) -> None:
    first = ask_robot(file_store, _desired(deployment="dep-1", epoch=1))
    again = ask_robot(file_store, _desired(deployment="dep-1", epoch=2))

    assert again == first
    assert read_desired(file_store, "r1")[0] == first


def test_who_was_replaced_asks_nobody(file_store: Store) -> None:
    first = ask_robot(file_store, _desired(deployment="dep-1", epoch=2))

    with pytest.raises(StoreError, match="epoch 2"):
        ask_robot(file_store, _desired(deployment="dep-1", epoch=1))
    with pytest.raises(StoreError, match="lost"):
        ask_robot(file_store, _desired(deployment="dep-2"), check=_lost)

    assert read_desired(file_store, "r1")[0] == first


def _lost() -> None:
    raise StoreError("the claim is lost")


def test_the_sequence_grows_with_every_deployment_also_while_the_clock_stands(file_store: Store) -> None:
    sequences = [
        ask_robot(file_store, _desired(deployment=deployment)).sequence
        for deployment in ("dep-1", "dep-2", "dep-2", "dep-3")
    ]

    assert sequences == [1000, 1001, 1001, 1002]


@pytest.mark.parametrize("body", GARBAGE)
def test_garbage_asks_nothing_of_a_robot_and_is_written_over_by_who_asks(
    body: bytes, store: Store, caplog: pytest.LogCaptureFixture
) -> None:
    store.put(desired_key("r1"), body)
    assert read_desired(store, "r1")[0] is None

    asked = ask_robot(store, _desired(deployment="dep-1"))

    assert (asked.sequence, read_desired(store, "r1")[0]) == (1000, asked)
    assert [each for each in caplog.messages if "robots/r1/desired.json" in each]


@pytest.mark.parametrize("body", GARBAGE)
def test_a_robot_whose_report_is_garbage_is_without_news(
    body: bytes, file_store: Store, caplog: pytest.LogCaptureFixture
) -> None:
    file_store.put(reported_key("r1"), body)

    assert [read_reported(file_store, "r1") for _ in range(3)] == [None] * 3
    assert ask_robot(file_store, _desired(deployment="dep-1")).sequence == 1000
    assert len([each for each in caplog.messages if "r1 is without news" in each]) == 1, "told once"


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("percent_done", "1e308"),
        ("percent_done", "NaN"),
        ("percent_done", "-1"),
        ("sequence", "-1"),
        ("sequence", "9" * 30),
        ("started_at_s", "NaN"),
        ("finished_at_s", "1e300"),
        ("finished_at_s", "Infinity"),
        ("failure_reason", '"' + "x" * 2000 + '"'),
    ],
)
def test_a_report_with_a_number_that_nobody_can_count_with_is_none(field: str, value: str, file_store: Store) -> None:
    document = json.loads(encode_document(_reported(sequence=4)))
    document[field] = "HERE"
    file_store.put(reported_key("r1"), json.dumps(document).replace('"HERE"', value).encode())

    assert read_reported(file_store, "r1") is None


def _reported(sequence: int) -> Reported:
    return Reported(
        robot="r1",
        deployment="dep-0",
        sequence=sequence,
        boot_id="b",
        status="InSync",
        step="Finished",
        started_at_s=1.0,
    )

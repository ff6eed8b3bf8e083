"""Calls whose line the log of actions did not take."""

import json

from flows.gateway.application import Calls, no_page
from flows.gateway.gateway import Gateway
from flows.gateway.handlers import HANDLERS
from specs.errors import StoreError
from specs.robomaker.operations import OPERATIONS
from tasks.deploy.fleet.fleet_registry import fleets
from tasks.gateway.access.guard import Call, LoopbackGuard, loopback_hosts
from tasks.gateway.rest_json import HttpAnswer, HttpRequest
from tasks.storage.base.store import Store
from tests.factories.gateway.robomaker_client import HOST


def _refuse(_call: Call) -> None:
    raise StoreError("file:///somewhere: no space left")


def _answer(store: Store, operation: str, members: dict[str, str]) -> HttpAnswer:
    guard = LoopbackGuard(loopback_hosts(8600))
    calls = Calls(Gateway(store, lambda: None), HANDLERS, guard, no_page, _refuse)
    path, body = OPERATIONS[operation].path, json.dumps(members).encode()
    return calls.answer(HttpRequest("POST", path, "", (("host", HOST),), body, "127.0.0.1", "r"))


def test_a_change_without_a_line_in_the_log_is_said_to_be_done(file_store: Store):
    answer = _answer(file_store, "CreateFleet", {"name": "aisle"})

    assert answer.status == 500
    assert "it was done" in json.loads(answer.body)["message"]
    assert [fleet.name for fleet in fleets(file_store)] == ["aisle"]


def test_a_refusal_without_a_line_in_the_log_stays_the_refusal(file_store: Store):
    answer = _answer(file_store, "CreateFleet", {"name": "no name!"})

    assert (answer.status, answer.error) == (400, "InvalidParameterException")

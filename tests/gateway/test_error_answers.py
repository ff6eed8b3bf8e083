"""What a client is told of an error: a documented name, and no place on this machine."""

import json
from pathlib import Path

import pytest

from specs import errors
from specs.arn import ArnForm, arn
from specs.base import Fault
from specs.robomaker.operations import OPERATIONS
from tasks.gateway.rest_json import ErrorAnswers

STORE = "file:///srv/secret place/store"
ANSWERS = ErrorAnswers(ArnForm("id", "us-west-2"), STORE)
FAULT = Fault(path="fleet", value="'aisle'", allowed="a fleet")


def document_error(kind: type[errors.DocumentError], allowed: str = "a fleet") -> errors.DocumentError:
    return kind([FAULT.model_copy(update={"allowed": allowed})])


@pytest.mark.parametrize(
    ("kind", "name"),
    [
        (errors.DocumentError, "InvalidParameter"),
        (errors.ResourceNotFound, "ResourceNotFound"),
        (errors.LimitExceeded, "LimitExceeded"),
        (errors.IdempotentParameterMismatch, "IdempotentParameterMismatch"),
        (errors.ConcurrentDeployment, "ConcurrentDeployment"),
    ],
)
def test_what_is_wrong_with_a_request_has_robomakers_name(kind: type[errors.DocumentError], name: str):
    answer = ANSWERS.answer(OPERATIONS["CreateDeploymentJob"], document_error(kind))

    assert (answer.status, answer.error) == (400, f"{name}Exception")
    assert json.loads(answer.body) == {"message": "fleet: 'aisle': a fleet"}


def test_a_taken_name_is_told():
    answer = ANSWERS.answer(OPERATIONS["CreateRobot"], document_error(errors.ResourceAlreadyExists))
    assert answer.error == "ResourceAlreadyExistsException"


@pytest.mark.parametrize(
    ("exc", "error", "status"),
    [
        (errors.StoreThrottled(f"{STORE} says slow down"), "ThrottlingException", 400),
        (errors.StoreAway(f"{STORE} does not answer"), "ServiceUnavailableException", 503),
        (errors.StoreAccessDenied(f"{STORE} refuses"), "InternalServerException", 500),
        (errors.StageFailed("X", f"in {STORE}/x"), "InternalServerException", 500),
        (ValueError(f"{STORE}/x"), "InternalServerException", 500),
    ],
)
def test_what_is_wrong_with_the_service_shows_no_place(exc: Exception, error: str, status: int):
    answer = ANSWERS.answer(OPERATIONS["CreateSimulationJob"], exc)

    assert (answer.status, answer.error) == (status, error)
    assert b"secret" not in answer.body


def test_an_error_that_an_operation_does_not_document_becomes_one_that_it_does():
    described = OPERATIONS["DescribeSimulationJobBatch"]

    assert ANSWERS.answer(described, errors.StoreThrottled("x")).error == "InternalServerException"
    assert ANSWERS.answer(described, errors.StoreAway("x")).error == "InternalServerException"
    assert ANSWERS.answer(described, document_error(errors.LimitExceeded)).error == "InvalidParameterException"


@pytest.mark.parametrize("place", [STORE, "/srv/secret place/store", "file:///else/secret", f"{Path.cwd()}/secret"])
def test_a_message_about_a_document_shows_no_place(place: str):
    exc = document_error(errors.ResourceNotFound, f"not in the store {place}; simyard list fleets")

    answer = ANSWERS.answer(OPERATIONS["DescribeFleet"], exc)

    message = json.loads(answer.body)["message"]
    assert message.startswith("fleet: 'aisle': not in the store")
    assert place not in message


def test_arns_in_messages_have_robomakers_form_and_messages_end():
    exc = document_error(errors.DocumentError, f"not {arn('robot', 'id', 'r2')}, {'x' * 10_000}")

    message = json.loads(ANSWERS.answer(OPERATIONS["DescribeFleet"], exc).body)["message"]

    assert "arn:aws:robomaker:us-west-2:" in message
    assert len(message) <= 4000

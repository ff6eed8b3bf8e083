"""ARNs, errors and places in requests and answers."""

import json
from pathlib import Path

import pytest
from pydantic import JsonValue

from specs import errors
from specs.arn import ArnForm, arn
from specs.base import Fault
from specs.robomaker.deployment import DescribeFleetRequest, DescribeFleetResponse
from specs.robomaker.operations import OPERATIONS
from specs.robomaker.simulation import BatchDescribeSimulationJobRequest, StartSimulationJobBatchRequest
from tasks.gateway.rest_json import (
    MOST_VALUES,
    ErrorAnswers,
    HttpRequest,
    request_members,
    route,
    with_arns,
    without_places,
)

STORE = "file:///srv/secret place/store"
ANSWERS = ErrorAnswers(ArnForm("id", "us-west-2"), STORE)
FAULT = Fault(path="fleet", value="'aisle'", allowed="a fleet")


def changed(text: str) -> str:
    return f"new {text}"


def test_arns_of_fields_lists_and_parts_are_changed():
    fleet = {"arn": "arn:1", "robots": [{"arn": "arn:2", "lastDeploymentJob": "arn:3"}, {"name": "arn:4"}]}

    assert with_arns(fleet, DescribeFleetResponse, changed) == {
        "arn": "new arn:1",
        "robots": [{"arn": "new arn:2", "lastDeploymentJob": "new arn:3"}, {"name": "arn:4"}],
    }
    jobs = with_arns({"jobs": ["arn:1", "arn:2"]}, BatchDescribeSimulationJobRequest, changed)
    assert jobs == {"jobs": ["new arn:1", "new arn:2"]}


def test_texts_that_look_like_an_arn_stay():
    config: dict[str, JsonValue] = {
        "application": "arn:1",
        "launchConfig": {"environmentVariables": {"A": "arn:2"}},
        "worldConfigs": [{"world": "arn:3"}],
    }
    entry: dict[str, JsonValue] = {
        "iamRole": "arn:aws:iam::1:role/x",
        "simulationApplications": [config],
    }
    request = {"createSimulationJobRequests": [entry], "tags": {"arn:4": "arn:5"}}

    found = with_arns(request, StartSimulationJobBatchRequest, lambda text: text[-1])

    use = {**config, "application": "1", "worldConfigs": [{"world": "3"}]}
    assert found == {
        "createSimulationJobRequests": [{**entry, "simulationApplications": [use]}],
        "tags": {"arn:4": "arn:5"},
    }


def test_data_of_the_wrong_shape_stays_for_the_check_that_follows():
    for wrong in ({"robots": "arn:1"}, {"robots": [3, None, ["arn:2"]]}, {"arn": {"arn": 1}}, {"arn": 4}, {"x": "arn"}):
        assert with_arns(wrong, DescribeFleetResponse, str) == wrong


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


@pytest.mark.parametrize("place", [f"the store {STORE}", STORE, "/srv/secret place/store", "file:///else/bucket"])
def test_a_text_names_the_store_and_not_where_it_lies(place: str):
    assert without_places(f"{place}; no such bucket", STORE) == "the store; no such bucket"


def test_a_text_without_a_place_stays():
    text = "the robot fell over: /opt/app/run.sh, s3://results"
    assert without_places(text, STORE) == text


def members(body: bytes) -> dict[str, JsonValue]:
    request = HttpRequest("POST", "/describeFleet", "", (), body)
    return request_members(route(request), request, DescribeFleetRequest)


@pytest.mark.parametrize("value", [b"[]", b"{}", b"0", b'"a"'])
def test_a_body_of_more_values_than_any_request_has_is_refused_unparsed(value: bytes):
    with pytest.raises(errors.DocumentError, match="too many values"):
        members(b'{"fleet": [' + b",".join([value] * (2 * MOST_VALUES)) + b"] and no JSON")


@pytest.mark.parametrize("end", ['"}', "\\", ""])
def test_marks_in_texts_are_no_values(end: str):
    body = b'{"fleet": "' + b',[{\\"' * MOST_VALUES + end.encode()
    if end == '"}':
        assert members(body) == {"fleet": ',[{"' * MOST_VALUES}
    else:
        with pytest.raises(errors.DocumentError, match="one JSON object"):
            members(body)

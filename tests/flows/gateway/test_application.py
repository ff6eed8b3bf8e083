"""Requests that no SDK sends are refused with one of RoboMaker's errors, never with a 500; and calls without a line."""

import json
from collections.abc import Generator

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from flows.gateway.application import Calls, no_page
from flows.gateway.gateway import Gateway
from flows.gateway.handlers import HANDLERS
from specs.base import Spec
from specs.errors import StoreError
from specs.robomaker.operations import OPERATIONS, document_shapes
from specs.robomaker.shared_operations import ListTagsForResourceRequest
from tasks.deploy.fleet.fleet_registry import fleets
from tasks.gateway.access.guard import Call, LoopbackGuard, loopback_hosts
from tasks.gateway.rest_json import HttpAnswer, HttpRequest
from tasks.storage.base.store import Store
from tasks.storage.store_url import open_store
from tests.factories.gateway.robomaker_client import HOST, Send, running_application

QUICK = settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
ARN = "arn:aws:robomaker:us-west-2:123456789012:deployment-fleet/aisle"
JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(),
    lambda below: st.lists(below, max_size=3) | st.dictionaries(st.text(max_size=9), below, max_size=3),
    max_leaves=8,
)
ASKED: list[Spec] = []
BODIES = {
    "cut off": b'{"fleet": "arn:x',
    "not JSON": b"fleet=arn:x",
    "a list": b'["arn:x"]',
    "a number": b"3",
    "two documents": b'{"fleet": "arn:x"}{}',
    "a key twice": b'{"fleet": "arn:x", "fleet": "arn:y"}',
    "not a number": b'{"fleet": NaN}',
    "infinity": b'{"fleet": -Infinity}',
    "a huge number": b'{"fleet": ' + b"9" * 100_000 + b"}",
    "a number of 65 bits": b'{"fleet": 18446744073709551616}',
    "a large number": b'{"fleet": 1e999}',
    "UTF-16": '{"fleet": "arn:x"}'.encode("utf-16"),
    "a byte order mark": b'\xef\xbb\xbf{"fleet": "arn:x"}',
    "Latin-1": b'{"fleet": "arn:\xe9"}',
    "half a surrogate": b'{"fleet": "arn:\\ud800"}',
    "half a surrogate as a key": b'{"\\ud800": "arn:x", "fleet": "arn:x"}',
    "deep lists": b'{"fleet": ' + b"[" * 100_000 + b"]" * 100_000 + b"}",
    "deep objects": b'{"fleet":' * 5000 + b"1" + b"}" * 5000,
    "rather deep": b'{"fleet": ' + b"[" * 40 + b"]" * 40 + b"}",
    "more values than any request has": b'{"fleet": [' + b"0," * 30_000 + b"0]}",
    "compressed": b"\x1f\x8b\x08\x00\x00\x00\x00\x00",
    "nothing": b"",
    "null": b'{"fleet": null}',
    "an unknown member": b'{"fleet": "arn:x", "fleets": 1}',
}


def answer_nothing(_gateway: Gateway, request: Spec) -> Spec:
    ASKED.append(request)
    return document_shapes()["TagResourceResponse"]()


@pytest.fixture(scope="module")
def send(tmp_path_factory: pytest.TempPathFactory) -> Generator[Send]:
    store = open_store((tmp_path_factory.mktemp("malformed") / "store").as_uri())
    with running_application(store, dict.fromkeys(OPERATIONS, answer_nothing)) as sending:
        yield sending


def assert_refused(answer: HttpAnswer) -> str:
    assert (answer.status, answer.error) == (400, "InvalidParameterException"), answer
    return json.loads(answer.body)["message"]


@pytest.mark.parametrize("body", BODIES.values(), ids=BODIES)
def test_a_body_that_is_no_request_is_refused_in_a_sentence(body: bytes, send: Send):
    message = assert_refused(send("POST", "/describeFleet", body))
    assert message
    assert len(message) < 500


@pytest.mark.parametrize("number", [2**63, -(2**63) - 1, 10**30])
def test_numbers_have_at_most_64_bits(number: int, send: Send):
    assert "64 bits" in assert_refused(send("POST", "/listFleets", json.dumps({"maxResults": number}).encode()))


@pytest.mark.parametrize("body", [b"", b" \n", b"{}", b'{"nextToken": null}'])
def test_what_is_null_or_left_out_is_absent(body: bytes, send: Send):
    assert send("POST", "/listFleets", body).status == 200


@pytest.mark.parametrize("content_type", ["", "application/x-amz-json-1.1", "application/octet-stream", "x" * 5000])
def test_what_no_form_of_a_page_sends_is_read_whatever_its_content_type(content_type: str, send: Send):
    headers = (("host", HOST), ("content-type", content_type))
    assert send("POST", "/listFleets", b"{}", headers).status == 200


@pytest.mark.parametrize(
    ("method", "path"),
    [
        ("GET", "/listFleets"),
        ("PUT", "/listFleets"),
        ("POST", "/ListFleets"),
        ("POST", "/listFleets/"),
        ("POST", "//listFleets"),
        ("POST", "/%6cistFleets"),
        ("POST", "/../listFleets"),
        ("PATCH", "/tags/arn"),
        ("POST", "/tags"),
        ("BREW", "/" + "a" * 60_000),
        ("POST", "/\xff\x00"),
    ],
)
def test_an_unknown_method_or_path_is_404(method: str, path: str, send: Send):
    answer = send(method, path)
    assert (answer.status, answer.error) == (404, "UnknownOperationException")
    assert len(answer.body) < 2500


@pytest.mark.parametrize("path", [ARN.replace("/", "%2F").replace(":", "%3A"), ARN, f"{ARN}%2F1551211803228"])
def test_an_arn_in_the_path_is_understood_however_it_is_encoded(path: str, send: Send):
    assert send("GET", f"/tags/{path}").status == 200
    request = ASKED[-1]
    assert isinstance(request, ListTagsForResourceRequest)
    assert request.resourceArn.startswith("arn:simyard:deployment-fleet:")
    assert request.resourceArn.endswith(":aisle")


@pytest.mark.parametrize("path", ["", "%", "%zz", "%ff%fe", "%0A", "arn%253Ax", "%C0%AF..%2f..%2fetc", "a" * 60_000])
def test_a_path_that_names_no_resource_is_refused(path: str, send: Send):
    assert_refused(send("GET", f"/tags/{path}"))


@pytest.mark.parametrize("query", ["", "tagKeys=", "tagKeys=%ff", "tagKeys=a&tagKeys=aws:b", "&&=;%", "tagKeys[]=a"])
def test_no_query_is_a_defect(query: str, send: Send):
    answer = send("DELETE", f"/tags/{ARN}?{query}")
    assert answer.status in {200, 400}, answer


def test_ping_answers_whoever_asks_and_says_nothing(send: Send):
    answer = send("GET", "/ping", b"", ())
    assert (answer.status, answer.body) == (200, b"{}")


def test_a_body_that_is_too_large_is_413(send: Send):
    assert send("POST", "/listFleets", b" " * ((8 << 20) + 1)).status == 413


@pytest.mark.parametrize(
    "headers", [(), (("host", "evil.example"),), (("host", HOST), ("origin", "https://evil.example"))]
)
def test_without_signatures_a_page_of_a_browser_gets_nowhere(headers: tuple[tuple[str, str], ...], send: Send):
    answer = send("POST", "/listFleets", b"{}", headers)
    assert (answer.status, answer.error) == (403, "AccessDeniedException")


@QUICK
@given(name=st.sampled_from(sorted(OPERATIONS)), document=JSON)
def test_any_json_is_answered(name: str, document: object, send: Send):
    operation = OPERATIONS[name]
    answer = send(operation.method, operation.path, json.dumps(document).encode())
    assert answer.status in {200, 400}, answer


@QUICK
@given(data=st.data())
def test_json_under_the_right_names_is_answered(data: st.DataObject, send: Send):
    operation = OPERATIONS[data.draw(st.sampled_from(sorted(OPERATIONS)))]
    fields = dict.fromkeys(document_shapes()[operation.request].model_fields, JSON)
    document = data.draw(st.fixed_dictionaries({}, optional=fields))
    answer = send(operation.method, operation.path, json.dumps(document).encode())
    assert answer.status in {200, 400}, answer


@QUICK
@given(name=st.sampled_from(sorted(OPERATIONS)), body=st.binary(max_size=200), query=st.text("a=&%;+", max_size=9))
def test_any_bytes_are_answered(name: str, body: bytes, query: str, send: Send):
    operation = OPERATIONS[name]
    answer = send(operation.method, f"{operation.path}?{query}", body)
    assert answer.status in {200, 400}, answer


def _refuse(_call: Call) -> None:
    raise StoreError("file:///somewhere: no space left")


def _answer(store: Store, operation: str, members: dict[str, str]) -> HttpAnswer:
    guard = LoopbackGuard(loopback_hosts(8600))
    calls = Calls(Gateway(store, lambda: None), HANDLERS, guard, no_page, _refuse)
    path, body = OPERATIONS[operation].path, json.dumps(members).encode()
    return calls.answer(calls.admit(HttpRequest("POST", path, "", (("host", HOST),), body, "127.0.0.1", "r")))


def test_a_change_without_a_line_in_the_log_is_said_to_be_done(file_store: Store):
    answer = _answer(file_store, "CreateFleet", {"name": "aisle"})

    assert answer.status == 500
    assert "it was done" in json.loads(answer.body)["message"]
    assert [fleet.name for fleet in fleets(file_store)] == ["aisle"]


def test_a_refusal_without_a_line_in_the_log_stays_the_refusal(file_store: Store):
    answer = _answer(file_store, "CreateFleet", {"name": "no name!"})

    assert (answer.status, answer.error) == (400, "InvalidParameterException")

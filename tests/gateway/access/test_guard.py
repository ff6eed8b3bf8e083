"""Who gets in: by signature, or from this machine; never from a page of another site."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from specs.arn import ArnForm
from specs.errors import AccessRefused
from specs.robomaker.operations import OPERATIONS, document_shapes
from tasks.gateway.access.access_keys import AccessKey, KeyFile, add_key, revoke_key
from tasks.gateway.access.action_log import ActionLog, actions, record_call
from tasks.gateway.access.guard import (
    Call,
    Caller,
    LoopbackGuard,
    SignedGuard,
    is_loopback,
    loopback_hosts,
    refuse_other_pages,
)
from tasks.gateway.rest_json import HttpAnswer, HttpRequest
from tasks.storage.base.store import Store
from tasks.storage.store_url import open_store
from tests.gateway.signed_requests import changed, now_s, signed_request

CREATE, DESCRIBE = OPERATIONS["CreateFleet"], OPERATIONS["DescribeFleet"]
HERE = "127.0.0.1:8600"


@pytest.fixture
def keys(tmp_path: Path) -> Path:
    return tmp_path / "keys"


@pytest.fixture
def folder_store(tmp_path: Path) -> Store:
    return open_store((tmp_path / "store").as_uri())


@pytest.fixture
def key(keys: Path) -> AccessKey:
    return add_key(keys, "ci", ["read", "deploy"], ["deployment-fleet/home"])


@pytest.fixture
def guard(keys: Path, key: AccessKey) -> SignedGuard:
    return SignedGuard(KeyFile(keys), "store", lambda _kind, _path: "")


def by(key: AccessKey) -> HttpRequest:
    return signed_request(secret=key.secret, key_id=key.key_id)


def code(answer: object) -> str:
    return answer.error if isinstance(answer, HttpAnswer) else ""


def test_the_owner_of_a_key_gets_in(guard: SignedGuard, key: AccessKey) -> None:
    request = by(key)
    assert guard.refuse_head(request, CREATE) is None
    assert guard.admit(request, CREATE) == Caller(key.key_id, "ci")


@pytest.mark.parametrize("name", ["CreateFleet", "CreateSimulationJob", "TagResource"])
def test_a_change_is_admitted_once_and_a_look_as_often_as_it_is_asked(
    guard: SignedGuard, key: AccessKey, name: str
) -> None:
    request = by(key)
    assert isinstance(guard.admit(request, OPERATIONS[name]), Caller)
    assert code(guard.admit(request, OPERATIONS[name])) == "ThrottlingException"
    look = by(key)
    assert all(isinstance(guard.admit(look, DESCRIBE), Caller) for _ in range(2))


def test_a_forged_signature_uses_up_none(guard: SignedGuard, key: AccessKey) -> None:
    request = by(key)
    assert code(guard.admit(replace(request, body=b"{ }"), CREATE)) == "InvalidSignatureException"
    assert isinstance(guard.admit(request, CREATE), Caller)


@pytest.mark.parametrize("name", ["authorization", "x-amz-date"])
def test_the_head_alone_is_enough_to_refuse(guard: SignedGuard, key: AccessKey, name: str) -> None:
    assert guard.refuse_head(changed(by(key), **{name: None}), CREATE) is not None


def test_an_unknown_key_is_refused_by_its_head(guard: SignedGuard) -> None:
    assert code(guard.refuse_head(signed_request(key_id="NOBODY"), CREATE)) == "UnrecognizedClientException"


def test_a_page_of_another_site_is_refused_though_it_is_signed(guard: SignedGuard, key: AccessKey) -> None:
    request = changed(by(key), origin="http://evil.example")
    assert code(guard.refuse_head(request, CREATE)) == "AccessDeniedException"
    assert code(guard.admit(request, CREATE)) == "AccessDeniedException"


def test_a_browser_reaches_the_page_without_a_signature(guard: SignedGuard) -> None:
    request = HttpRequest("GET", "/", "", (("host", "127.0.0.1:8600"),), b"")
    assert guard.admit(request, None) == Caller()


def test_limits_are_checked(guard: SignedGuard, key: AccessKey) -> None:
    shape = document_shapes()["CreateFleetRequest"]
    caller = Caller(key.key_id, "ci")
    assert guard.permit(caller, CREATE, shape.model_validate({"name": "home"})) is None
    assert code(guard.permit(caller, CREATE, shape.model_validate({"name": "other"}))) == "AccessDeniedException"


def test_whoever_was_let_in_without_a_key_may_do_nothing(guard: SignedGuard) -> None:
    document = document_shapes()["CreateFleetRequest"].model_validate({"name": "home"})
    assert code(guard.permit(Caller(), CREATE, document)) == "UnrecognizedClientException"


def test_a_key_that_is_revoked_meanwhile_may_do_nothing(guard: SignedGuard, key: AccessKey, keys: Path) -> None:
    document = document_shapes()["CreateFleetRequest"].model_validate({"name": "home"})
    revoke_key(keys, "ci")
    assert code(guard.permit(Caller(key.key_id, "ci"), CREATE, document)) == "UnrecognizedClientException"


def test_nobody_gets_in_while_the_keys_cannot_be_trusted(guard: SignedGuard, key: AccessKey, keys: Path) -> None:
    keys.chmod(0o644)
    answer = guard.admit(by(key), CREATE)
    assert code(answer) == "InternalServerException"
    assert isinstance(answer, HttpAnswer)
    assert str(keys) not in answer.body.decode()


def test_without_signatures_only_names_of_this_machine_get_in() -> None:
    guard = LoopbackGuard(loopback_hosts(8600))
    request = HttpRequest("POST", "/createFleet", "", (("host", "localhost:8600"),), b"{}")
    assert guard.admit(request, CREATE) == Caller()
    assert code(guard.admit(changed(request, host="evil.example:8600"), CREATE)) == "AccessDeniedException"


def called(operation: str | None, answer: HttpAnswer, *, is_in: bool = True) -> Call:
    request = replace(signed_request(), id="r-1")
    name = OPERATIONS[operation] if operation else None
    return Call(request, answer, 0.0, Caller("KEY", "ci") if is_in else None, name)


@pytest.mark.parametrize(
    ("call", "outcomes"),
    [
        (called("CreateFleet", HttpAnswer(200, b'{"arn": "arn:made"}')), ["done"]),
        (called("CreateFleet", HttpAnswer(400, b"{}", error="LimitExceededException")), ["LimitExceededException"]),
        (called("DescribeFleet", HttpAnswer(200, b"{}")), []),
        (called("DescribeFleet", HttpAnswer(400, b"{}", error="ResourceNotFoundException")), []),
        (called("DescribeFleet", HttpAnswer(403, b"{}", error="AccessDeniedException")), ["AccessDeniedException"]),
        (called("DescribeFleet", HttpAnswer(403, b"{}", error="X"), is_in=False), ["X"]),
        (called(None, HttpAnswer(403, b"<html>", "text/html")), ["refused"]),
        (called(None, HttpAnswer(404, b"{}", error="UnknownOperationException")), []),
    ],
)
def test_changes_and_refusals_are_written_down(folder_store: Store, call: Call, outcomes: list[str]) -> None:
    record_call(ActionLog(folder_store, 90), call)
    lines = [json.loads(line) for line in actions(folder_store, 2, now_s())]
    assert [line["outcome"] for line in lines] == outcomes
    assert all(line["request"] == "r-1" for line in lines)


def test_the_line_has_what_was_made_and_what_it_was_about(folder_store: Store) -> None:
    document = document_shapes()["CreateFleetRequest"].model_validate({"name": "home"})
    made = replace(called("CreateFleet", HttpAnswer(200, b'{"arn": "arn:made"}')), document=document)
    record_call(ActionLog(folder_store, 90), made)
    record_call(ActionLog(folder_store, 90), called("CreateFleet", HttpAnswer(403, b"{}", error="X"), is_in=False))
    first, second = (json.loads(line) for line in actions(folder_store, 2, now_s()))
    assert (first["key"], first["name"], first["arns"]) == ("KEY", "ci", ["arn:made"])
    assert (second["key"], second["name"]) == ("SIMYARDTEST000000001", "")


def test_all_arns_of_a_line_have_the_form_that_clients_see(folder_store: Store) -> None:
    form = ArnForm("5f5eb623a2b4", "us-west-2")
    fleet = "arn:simyard:deployment-fleet:5f5eb623a2b4:home"
    document = document_shapes()["SyncDeploymentJobRequest"].model_validate({"fleet": fleet, "clientRequestToken": "t"})
    made = form.robomakers("arn:simyard:deployment-job:5f5eb623a2b4:dep-1")
    call = called("SyncDeploymentJob", HttpAnswer(200, json.dumps({"arn": made}).encode()))
    record_call(ActionLog(folder_store, 90), replace(call, document=document), form.robomakers)
    (line,) = (json.loads(each) for each in actions(folder_store, 2, now_s()))
    assert line["arns"] == [form.robomakers(fleet), made]
    assert all(each.startswith("arn:aws:robomaker:us-west-2:") for each in line["arns"])


def request(*headers: tuple[str, str], method: str = "POST", body: bytes = b"{}") -> HttpRequest:
    named = headers if any(name == "host" for name, _ in headers) else (("host", HERE), *headers)
    return HttpRequest(method, "/createFleet", "", named, body)


@pytest.mark.parametrize("host", ["127.0.0.1:8600", "localhost:8600", "[::1]:8600", "LOCALHOST:8600"])
def test_programs_of_this_machine_pass(host: str) -> None:
    refuse_other_pages(request(("host", host)), operation=True, hosts=loopback_hosts(8600))


@pytest.mark.parametrize(
    "host", ["", "evil.example", "evil.example:8600", "127.0.0.1", "127.0.0.1:80", "localhost.evil:8600", "127.1:8600"]
)
def test_another_name_for_this_address_is_refused(host: str) -> None:
    with pytest.raises(AccessRefused, match="asked for by"):
        refuse_other_pages(request(("host", host)), operation=True, hosts=loopback_hosts(8600))


@pytest.mark.parametrize(
    "headers",
    [
        [("origin", "http://evil.example")],
        [("origin", "null")],
        [("origin", "")],
        [("origin", "http://127.0.0.1:9000")],
        [("origin", f"http://{HERE}"), ("origin", "http://evil.example")],
        [("sec-fetch-site", "cross-site")],
        [("sec-fetch-site", "same-site")],
        [("sec-fetch-site", "cross-site"), ("sec-fetch-mode", "navigate")],
        [("sec-fetch-site", "none"), ("sec-fetch-site", "cross-site")],
        [("host", HERE), ("host", "evil.example")],
    ],
)
@pytest.mark.parametrize("method", ["GET", "POST", "DELETE"])
def test_a_page_of_another_site_is_refused(headers: list[tuple[str, str]], method: str) -> None:
    with pytest.raises(AccessRefused):
        refuse_other_pages(request(*headers, method=method), operation=True)


@pytest.mark.parametrize(
    "headers", [[], [("origin", f"http://{HERE}"), ("sec-fetch-site", "same-origin")], [("sec-fetch-site", "none")]]
)
def test_an_own_page_passes(headers: list[tuple[str, str]]) -> None:
    refuse_other_pages(request(*headers), operation=True, hosts=loopback_hosts(8600))


@pytest.mark.parametrize(("method", "passes"), [("GET", True), ("POST", False)])
def test_a_link_to_a_page_may_be_followed(method: str, passes: bool) -> None:  # noqa: FBT001 - a case
    asked = request(("sec-fetch-site", "cross-site"), ("sec-fetch-mode", "navigate"), method=method)
    if passes:
        refuse_other_pages(asked, operation=False)
    else:
        with pytest.raises(AccessRefused):
            refuse_other_pages(asked, operation=False)


@pytest.mark.parametrize(
    ("host", "own"),
    [
        ("127.0.0.1", True),
        ("127.8.8.8", True),
        ("::1", True),
        ("localhost", True),
        ("0.0.0.0", False),  # noqa: S104
        ("::", False),
        ("10.0.0.1", False),
        ("localhost.example", False),
        ("", False),
    ],
)
def test_only_this_machine_reaches_loopback(host: str, own: bool) -> None:  # noqa: FBT001 - a case
    assert is_loopback(host) is own

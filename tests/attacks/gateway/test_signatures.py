"""Requests that nobody signed so, against a gateway that runs: refused, written down, and the store is as it was."""

import json
import time
from collections.abc import Iterator
from dataclasses import replace
from urllib.parse import quote

import pytest

from tasks.gateway.access.access_keys import revoke_key
from tasks.gateway.access.action_log import actions
from tasks.gateway.rest_json import HttpRequest
from tasks.storage.store_url import open_store
from tests.attacks.gateway.served import NOBODY, Served, served
from tests.gateway.signed_requests import changed, header

pytestmark = [pytest.mark.integration, pytest.mark.long]


@pytest.fixture(scope="module")
def gateway(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    with served(tmp_path_factory.mktemp("signed") / "s") as found:
        yield found


def fleets(gateway: Served) -> set[str]:
    return {path.stem for path in (gateway.store / "fleets").glob("*.json")}


def create(name: str) -> bytes:
    return json.dumps({"name": name}).encode()


def forged(request: HttpRequest) -> Iterator[HttpRequest]:
    text = header(request, "authorization")
    yield changed(request, authorization=None)
    yield changed(request, authorization=text[:-1] + ("0" if text[-1] != "0" else "1"))
    yield changed(request, authorization=text[:-1])
    yield changed(request, authorization=text[: len(text) // 2])
    yield changed(request, authorization=text.upper())
    yield changed(request, authorization=text.replace("SignedHeaders=host;", "SignedHeaders="))
    yield changed(request, x_amz_date="20260101T000000Z")
    yield changed(request, x_amz_content_sha256="UNSIGNED-PAYLOAD")
    yield changed(request, **{"x-amz-security-token": "token"})
    yield changed(request, host="evil.example")
    yield replace(request, body=create("forged-2"))
    yield replace(request, body=request.body + b" ")
    yield replace(request, query="a=b")
    yield replace(request, raw_path="/create%46leet")
    yield replace(request, raw_path="/./createFleet")
    yield replace(request, raw_path="//createFleet")
    yield replace(changed(request, authorization=None), query=f"X-Amz-Signature={text[-64:]}")


def test_what_was_forged_changes_nothing(gateway: Served) -> None:
    for request in forged(gateway.signed("/createFleet", create("forged"))):
        status, _ = gateway.send(request)
        assert status in {400, 403, 404}
    assert not {name for name in fleets(gateway) if name.startswith("forged")}
    assert gateway.answers()


def test_a_change_is_taken_once(gateway: Served) -> None:
    request = gateway.signed("/createFleet", create("once"))
    assert gateway.send(request)[0] == 200
    gateway.send(gateway.signed("/deleteFleet", json.dumps({"fleet": _arn("once")}).encode()))
    refusals = {(400, "ThrottlingException"), (403, "InvalidSignatureException")}  # in the same second, and later
    assert gateway.send(request) in refusals
    assert "once" not in fleets(gateway)


def test_an_arn_of_a_path_is_not_taken_in_another_encoding(gateway: Served) -> None:
    gateway.send(gateway.signed("/createFleet", create("tagged")))
    request = gateway.signed(f"/tags/{quote(_arn('tagged'), safe='')}", b"", method="GET")
    assert gateway.send(request)[0] == 200
    assert gateway.send(request, raw_path=f"/tags/{quote(_arn('tagged'), safe=':')}")[0] == 403
    assert gateway.send(request, raw_path=f"/tags/{_arn('tagged')}")[0] == 403


def test_a_key_of_one_fleet_changes_no_other(gateway: Served) -> None:
    for name in ("mine", "theirs"):
        gateway.send(gateway.signed("/createFleet", create(name)))
    key = gateway.key("limited", "deploy", "read", on=("deployment-fleet/mine",))
    theirs = json.dumps({"fleet": _arn("theirs")}).encode()
    for call in ("deleteFleet", "describeFleet"):
        assert gateway.send(gateway.signed(f"/{call}", theirs, key)) == (403, "AccessDeniedException")
    tags = gateway.signed(f"/tags/{quote(_arn('theirs'), safe='')}", b'{"tags": {"a": "b"}}', key)
    assert gateway.send(tags) == (403, "AccessDeniedException")
    assert gateway.send(gateway.signed("/describeFleet", json.dumps({"fleet": _arn("mine")}).encode(), key))[0] == 200
    assert "theirs" in fleets(gateway)


def test_a_key_that_reads_changes_nothing_and_a_revoked_one_does_nothing(gateway: Served) -> None:
    key = gateway.key("reader", "read")
    assert gateway.send(gateway.signed("/describeFleet", NOBODY, key)) == (400, "ResourceNotFoundException")
    assert gateway.send(gateway.signed("/createFleet", create("read"), key)) == (403, "AccessDeniedException")
    revoke_key(gateway.keys, "reader")
    assert gateway.send(gateway.signed("/describeFleet", NOBODY, key)) == (403, "UnrecognizedClientException")


def test_who_did_what_is_in_the_store_and_no_secret(gateway: Served) -> None:
    gateway.send(gateway.signed("/createFleet", create("logged")))
    gateway.send(changed(gateway.signed("/createFleet", create("unlogged")), authorization=None))
    gateway.send(gateway.signed("/deleteFleet", NOBODY))
    lines = [json.loads(line) for line in actions(open_store(gateway.store.as_uri()), 2, time.time())]
    done = [line for line in lines if any("fleet/logged" in arn for arn in line["arns"])]
    assert [(line["name"], line["operation"], line["outcome"]) for line in done] == [("default", "CreateFleet", "done")]
    assert "MissingAuthenticationTokenException" in {line["outcome"] for line in lines}
    forms = {arn.split("/")[0].split(":")[1] for line in lines for arn in line["arns"] if arn.startswith("arn:")}
    assert forms == {"aws"}
    assert gateway.owner.secret not in json.dumps(lines)


def _arn(fleet: str) -> str:
    return f"arn:aws:robomaker:us-west-2:123456789012:deployment-fleet/{fleet}"

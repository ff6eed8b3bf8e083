"""Whether a Prefect server answers: past proxies, behind keys, and when it is busy."""

import socket

import pytest

from tasks.server.health import (
    accepts,
    is_answering,
    is_healthy,
    is_listening,
    speaks_prefect,
    succeeds_within,
    url_without_password,
)
from tests.factories.gateway.answering_server import NOBODY, answering


def test_nothing_listening_is_not_healthy():
    assert not is_healthy(NOBODY)
    assert not is_answering(NOBODY)


def test_a_url_that_is_none_is_not_healthy():
    assert not is_healthy("prefect")


@pytest.mark.parametrize("variable", ["http_proxy", "HTTP_PROXY"])
def test_a_local_server_is_asked_past_the_proxy(monkeypatch: pytest.MonkeyPatch, variable: str):
    monkeypatch.setenv(variable, "http://127.0.0.1:9")
    with answering() as api_url:
        assert is_healthy(api_url)


@pytest.mark.parametrize(("status", "there"), [(200, True), (401, True), (404, True), (500, False), (503, False)])
def test_a_server_that_wants_a_key_is_there_and_a_gateway_without_one_is_not(status: int, there: bool):  # noqa: FBT001
    with answering(status) as api_url:
        assert is_answering(api_url) == there
        assert is_healthy(api_url) == (status == 200)


def test_a_busy_server_is_asked_again():
    answers = iter([False, False, True])
    assert succeeds_within(lambda: next(answers), for_s=60.0, pause_s=0.0)


def test_asking_often_comes_to_an_end():
    assert not succeeds_within(lambda: False, for_s=0.0)


def test_a_password_is_not_shown():
    assert url_without_password("https://me:canary@host/api") == "https://***@host/api"


def test_a_server_that_is_silent_is_still_listening_and_one_that_ended_is_not():
    with socket.socket() as silent:
        silent.bind(("127.0.0.1", 0))
        silent.listen()
        url = f"http://127.0.0.1:{silent.getsockname()[1]}/api"
        assert is_listening(url)
        assert accepts(url)
        assert not is_answering(url, timeout_s=0.2)
    assert not is_listening(url)
    assert not accepts(url)


@pytest.mark.parametrize(
    ("status", "body", "speaks"),
    [
        (200, b"true", True),
        (200, b"<!doctype html>", False),
        (404, b'{"detail":"Not Found"}', False),
        (302, b"", False),
        (401, b"", True),
        (403, b"", True),
        (503, b"", True),
    ],
)
def test_what_answers_as_no_server_of_prefects_does_is_told_from_one_that_is_in_trouble(
    status: int, body: bytes, *, speaks: bool
):
    with answering(status, body) as api_url:
        assert speaks_prefect(api_url) is speaks
    assert speaks_prefect(NOBODY)

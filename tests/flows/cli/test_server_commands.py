"""The commands of `simyard access`, and what `simyard serve` refuses before it listens."""

import json
import shlex
import time
from pathlib import Path
from types import SimpleNamespace

import pytest
from typer.testing import CliRunner, Result

from flows.cli import server_commands
from flows.cli.shell import app
from flows.gateway.application import Calls
from flows.gateway.gateway import Gateway
from flows.gateway.handlers import HANDLERS
from flows.gateway.serve import Auth
from specs.errors import DocumentError
from tasks.deploy.fleet.fleet_registry import fleets
from tasks.gateway.access.access_keys import read_keys
from tasks.gateway.access.action_log import actions
from tasks.storage.store_url import open_store
from tests.gateway.signed_requests import changed, signed_request


@pytest.fixture
def keys(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("SIMYARD_ACCESS_FILE", str(tmp_path / "keys"))
    monkeypatch.setenv("SIMYARD_STORE", (tmp_path / "store").as_uri())
    monkeypatch.delenv("AWS_ENDPOINT_URL_ROBOMAKER", raising=False)
    return tmp_path / "keys"


def typed(*words: str) -> Result:
    return CliRunner().invoke(app, words, catch_exceptions=False)


def test_a_key_is_made_and_its_lines_are_for_a_shell(keys: Path) -> None:
    told = typed("access", "add", "ci", "--right", "read", "--right", "simulate", "--url", "https://here:1")
    (key,) = read_keys(keys).values()
    said = [shlex.split(line, comments=True) for line in told.output.splitlines()]
    assert ["export", f"AWS_ACCESS_KEY_ID={key.key_id}"] in said
    assert ["export", f"AWS_SECRET_ACCESS_KEY={key.secret}"] in said
    assert ["export", "AWS_ENDPOINT_URL_ROBOMAKER=https://here:1"] in said
    assert key.rights == {"read", "simulate"}


def test_the_list_shows_limits_and_no_secret(keys: Path) -> None:
    typed("access", "add", "ci", "--right", "read", "--on", "robot/*", "--on", "world/a")
    told = typed("access", "list").output
    (key,) = read_keys(keys).values()
    assert "robot/* world/a" in told
    assert key.key_id in told
    assert key.secret not in told


def test_the_lines_of_a_key_can_be_had_again(keys: Path) -> None:
    made = typed("access", "add", "ci", "--right", "read").output
    assert typed("access", "export", "ci").output == made


@pytest.mark.usefixtures("keys")
def test_a_revoked_key_is_gone() -> None:
    typed("access", "add", "ci", "--right", "read")
    assert "revoked ci" in typed("access", "revoke", "ci").output
    assert "ci" not in typed("access", "list").output


@pytest.mark.usefixtures("keys")
def test_a_right_that_is_none_is_refused() -> None:
    with pytest.raises(DocumentError, match="some of read, simulate, deploy"):
        typed("access", "add", "ci", "--right", "admin")


@pytest.mark.usefixtures("keys")
@pytest.mark.parametrize(
    ("options", "why"),
    [
        (["--host", "0.0.0.0", "--unsigned"], "would be let in"),  # noqa: S104
        (["--host", "gateway.example", "--unsigned", "--without-tls"], "would be let in"),
        (["--host", "0.0.0.0"], "--without-tls"),  # noqa: S104
        (["--host", "::"], "--without-tls"),
        (["--host", "localhost.example"], "--without-tls"),
        (["--tls-key", "key.pem"], "both or neither"),
    ],
)
def test_it_does_not_listen_where_strangers_could_reach_it_unprotected(options: list[str], why: str) -> None:
    with pytest.raises(DocumentError, match=why):
        typed("serve", *options)


def test_a_file_of_keys_that_others_can_read_is_refused_at_the_start(keys: Path) -> None:
    typed("access", "add", "ci", "--right", "read")
    keys.chmod(0o644)
    with pytest.raises(DocumentError, match="chmod 600"):
        typed("serve")


@pytest.mark.usefixtures("keys")
def test_a_model_without_a_folder_is_not_silently_nothing() -> None:
    with pytest.raises(DocumentError, match="with --model"):
        typed("serve", "--model-only")


@pytest.mark.parametrize("is_terminal", [True, False])
def test_the_first_start_shows_the_secret_on_a_terminal_alone(
    keys: Path, monkeypatch: pytest.MonkeyPatch, *, is_terminal: bool
) -> None:
    others = keys.with_name("other keys")
    monkeypatch.setattr(server_commands, "serve_store", lambda *_: None)
    monkeypatch.setattr("flows.queue.supervisor.LOGGERS", ())  # who serves logs from then on: these tests go on
    monkeypatch.setattr(server_commands, "sys", SimpleNamespace(stdout=SimpleNamespace(isatty=lambda: is_terminal)))
    told = typed("serve", "--workers", "0", "--port", "8931", "--access-keys", str(others)).output
    (key,) = read_keys(others).values()
    assert (key.secret in told) == is_terminal
    if not is_terminal:
        (command,) = [line.removeprefix("# simyard ") for line in told.splitlines() if line.startswith("# simyard ")]
        made = typed(*shlex.split(command)).output
        assert key.secret in made
        assert "http://127.0.0.1:8931" in made


def test_what_it_serves_asks_for_signatures_and_rights_and_writes_down_who_came(
    keys: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    met: list[Auth] = []
    monkeypatch.setattr(server_commands, "serve_store", lambda _store, auth, *_: met.append(auth))
    monkeypatch.setattr("flows.queue.supervisor.LOGGERS", ())  # who serves logs from then on: these tests go on
    typed("access", "add", "ci", "--right", "read")
    typed("access", "add", "all", "--right", "deploy")
    typed("serve", "--workers", "0")
    store = open_store((tmp_path / "store").as_uri())
    (auth,) = met
    calls = Calls(Gateway(store, lambda: None), HANDLERS, *auth[:-1], reader=auth.reader)
    reads, deploys = (
        signed_request(body=b'{"name": "aisle"}', secret=key.secret, key_id=key.key_id)
        for key in read_keys(keys).values()
    )

    asked = (changed(deploys, authorization=None), reads, deploys, deploys)
    *refused, made, again = [calls.answer(calls.admit(request)) for request in asked]

    assert [answer.error for answer in refused] == ["MissingAuthenticationTokenException", "AccessDeniedException"]
    assert (made.status, again.status) == (200, 400)
    assert [fleet.name for fleet in fleets(store)] == ["aisle"]
    lines = [json.loads(line) for line in actions(store, 1, time.time())]
    assert [line["name"] for line in lines] == ["", "ci", "all", ""]

"""`simyard fleet agent-kit`."""

from pathlib import Path

import pytest
from typer.testing import CliRunner

from flows.cli.shell import app
from specs.errors import DocumentError
from tasks.deploy.trust.keyring import ROOT_FILE
from tasks.deploy.trust.repository import init_keys
from tasks.storage.store_url import open_store


@pytest.fixture
def yard(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("SIMYARD_STORE", (tmp_path / "store").as_uri())
    monkeypatch.delenv("SIMYARD_KEYS", raising=False)
    monkeypatch.chdir(tmp_path)
    init_keys(open_store(), tmp_path / "keys")
    return tmp_path


def test_the_kit_has_the_root_of_trust_of_the_keys(yard: Path) -> None:
    done = CliRunner().invoke(app, ["fleet", "agent-kit", "kit", "--keys", "keys"])

    assert done.exit_code == 0, done.output
    assert (yard / "kit/root.json").read_bytes() == (yard / "keys" / ROOT_FILE).read_bytes()
    assert (yard / "store").as_uri() in (yard / "kit/agent.env").read_text()
    assert not list((yard / "kit").glob("*.pem"))


def test_a_kit_without_keys_must_be_asked_for_by_name(yard: Path) -> None:
    refused = CliRunner().invoke(app, ["fleet", "agent-kit", "kit"])

    assert isinstance(refused.exception, DocumentError)
    assert "--unsigned" in str(refused.exception)
    assert not (yard / "kit").exists()
    assert CliRunner().invoke(app, ["fleet", "agent-kit", "kit", "--unsigned"]).exit_code == 0
    assert not (yard / "kit/root.json").exists()

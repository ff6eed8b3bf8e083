"""Settings of a machine are read from the environment, or refused with what is allowed."""

from pathlib import Path

import pytest

from specs.errors import DocumentError
from specs.settings import MAX_WORLDS, SERVER_WAIT, WORKERS, Workers, access_file, chosen_workers


def test_the_limit_is_robomakers_unless_a_team_raises_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("SIMYARD_MAX_WORLDS", raising=False)
    assert MAX_WORLDS.value() == 50
    monkeypatch.setenv("SIMYARD_MAX_WORLDS", "10000")
    assert MAX_WORLDS.value() == 10000


@pytest.mark.parametrize("text", ["many", "0", "-3", "1e4", "\u0663"])
def test_what_is_no_number_of_worlds_is_refused(text: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SIMYARD_MAX_WORLDS", text)
    with pytest.raises(DocumentError, match="SIMYARD_MAX_WORLDS"):
        MAX_WORLDS.value()


def test_a_server_is_waited_for_as_long_as_is_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("SIMYARD_SERVER_WAIT", raising=False)
    assert SERVER_WAIT.value() == 90
    monkeypatch.setenv("SIMYARD_SERVER_WAIT", "5")
    assert SERVER_WAIT.value() == 5


@pytest.mark.parametrize(
    ("text", "workers"),
    [
        ("", None),
        ("dask", Workers(kind="dask")),
        ("ray", Workers(kind="ray")),
        ("dask:2", Workers(kind="dask", count=2)),
        ("ray:16", Workers(kind="ray", count=16)),
        ("tcp://10.0.0.7:8786", Workers(kind="dask", address="tcp://10.0.0.7:8786")),
        ("tls://scheduler.dask:8786", Workers(kind="dask", address="tls://scheduler.dask:8786")),
        ("ray://head:10001", Workers(kind="ray", address="ray://head:10001")),
    ],
)
def test_a_kind_a_count_or_an_address_says_where(
    text: str, workers: Workers | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(WORKERS, text)
    assert chosen_workers() == workers


@pytest.mark.parametrize("text", ["dask:0", "spark", "dask:two", "http://head:8786", "tcp://head", "dask:2 ray:2"])
def test_anything_else_is_refused_with_what_there_is(text: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(WORKERS, text)
    with pytest.raises(DocumentError, match=r"SIMYARD_WORKERS.*tcp://host:8786"):
        chosen_workers()


def test_keys_of_clients_are_in_the_folder_for_settings(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("SIMYARD_ACCESS_FILE", raising=False)
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    assert access_file() == tmp_path / "simyard" / "access-keys"
    monkeypatch.setenv("SIMYARD_ACCESS_FILE", str(tmp_path / "mine"))
    assert access_file() == tmp_path / "mine"

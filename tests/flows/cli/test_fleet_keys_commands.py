"""The keys that vouch for deployments, on the command line."""

from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from flows.cli.shell import app
from specs.errors import DocumentError
from tasks.storage.base.store import Store


def _keys(store: Store, *arguments: str, **environment: str) -> Result:
    argv = ["fleet", "keys", *arguments, "--store", store.url]
    return CliRunner().invoke(app, argv, catch_exceptions=False, env=environment)


def _shown(store: Store, folder: Path) -> dict[str, tuple[str, str]]:
    lines = [line.split() for line in _keys(store, "show", "--keys", str(folder)).output.splitlines()]
    return {role: (key, " ".join(rest)) for role, key, _, _, *rest in lines}


def test_keys_are_made_and_shown(file_store: Store, tmp_path: Path) -> None:
    folder = tmp_path / "keys"
    told = _keys(file_store, "init", "--keys", str(folder)).output

    assert told.startswith(f"{folder / 'root.json'}: give it to each robot")
    shown = _shown(file_store, folder)
    assert sorted(shown) == ["deployer", "root", "snapshot", "targets", "timestamp"]
    assert {where for _, where in shown.values()} == {"here"}
    assert "PRIVATE" not in told


def test_keys_are_named_by_the_environment_too(file_store: Store, tmp_path: Path) -> None:
    assert _keys(file_store, "init", SIMYARD_KEYS=str(tmp_path / "keys")).exit_code == 0
    assert _keys(file_store, "renew", SIMYARD_KEYS=str(tmp_path / "keys")).output == "renewed\n"


def test_keys_are_replaced_by_role(file_store: Store, tmp_path: Path) -> None:
    folder = tmp_path / "keys"
    _keys(file_store, "init", "--keys", str(folder))
    before = _shown(file_store, folder)

    _keys(file_store, "rotate", "deployer", "timestamp", "--keys", str(folder))

    after = _shown(file_store, folder)
    assert {role for role in after if after[role] != before[role]} == {"deployer", "timestamp"}


def test_nothing_is_replaced_where_one_role_does_not_exist(file_store: Store, tmp_path: Path) -> None:
    folder = tmp_path / "keys"
    _keys(file_store, "init", "--keys", str(folder))
    before = _shown(file_store, folder)

    with pytest.raises(DocumentError, match="captain"):
        _keys(file_store, "rotate", "deployer", "captain", "--keys", str(folder))

    assert _shown(file_store, folder) == before


def test_keys_that_are_kept_elsewhere_are_shown_so(file_store: Store, tmp_path: Path) -> None:
    folder = tmp_path / "keys"
    _keys(file_store, "init", "--keys", str(folder))
    for path in folder.glob("root-*.pem"):
        path.unlink()

    assert _shown(file_store, folder)["root"][1] == "not here"

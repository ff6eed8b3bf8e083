"""Housekeeping on the command line."""

import json
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from flows.cli.shell import app
from specs.errors import DocumentError
from tasks.storage.base.store import Store
from tests.housekeeping.yard import Yard


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An old file in this machine's cache, whose folder is returned."""
    folder = tmp_path / "cache"
    (folder / "programs").mkdir(parents=True)
    (folder / "programs/old").write_bytes(b"x" * 2048)
    monkeypatch.setenv("SIMYARD_CACHE", str(folder))
    return folder


def gc(store: Store, *arguments: str) -> Result:
    words = ["gc", "--store", store.url, "--grace", "0s", "--unused", "0s", *arguments]
    return CliRunner().invoke(app, words, catch_exceptions=False)


def lost(store: Store) -> Store:
    """Returns the store with the worlds of a job whose record is gone."""
    Yard(store).lose(Yard(store).generation("lost"))
    return store


def test_it_tells_kinds_objects_bytes_and_reasons_and_removes_nothing(file_store: Store, cache: Path) -> None:
    before = lost(file_store).keys("")
    told = " ".join(gc(file_store).output.split())
    assert "of jobs without a record" in told
    assert "of this machine's cache" in told
    assert "to free: 5 objects" in told
    assert (file_store.keys(""), (cache / "programs/old").exists()) == (before, True)


def test_with_yes_it_removes_and_then_nothing_is_left_to_free(file_store: Store, cache: Path) -> None:
    assert "freed: 5 objects" in gc(lost(file_store), "--yes").output
    left = ["store.json"]
    assert (file_store.keys(""), (cache / "programs/old").exists()) == (left, False)
    assert gc(file_store, "--yes").output == "freed: 0 objects, 0 B\n"


def test_json_has_all_of_it(file_store: Store) -> None:
    report = json.loads(gc(lost(file_store), "--json").output)
    assert (report["store"], report["removed"], report["unread"]) == (file_store.url, False, [])
    worlds = {"kind": "worlds", "objects": 2, "bytes": 70, "why": "of jobs without a record"}
    assert worlds in report["freed"]
    assert report["cache"] == [
        {"kind": "compiled programs", "objects": 1, "bytes": 2048, "why": "that nobody has used for long"}
    ]


def test_a_record_that_cannot_be_read_is_named_and_ends_it_with_3(file_store: Store) -> None:
    file_store.put("applications/robot-application/courier.json", b"{")
    done = gc(file_store, "--yes")
    assert done.exit_code == 3
    assert "applications/robot-application/courier.json cannot be read" in done.stderr
    assert "bundles" in done.stderr


@pytest.mark.parametrize("option", ["--grace", "--older-than", "--unused"])
def test_an_age_without_a_unit_is_refused(file_store: Store, option: str) -> None:
    with pytest.raises(DocumentError, match=f"{option}.*such as 24h"):
        gc(file_store, option, "30")


def test_a_store_that_is_not_there_is_not_made(tmp_path: Path) -> None:
    words = ["gc", "--store", (tmp_path / "none").as_uri()]
    assert CliRunner().invoke(app, words).exit_code != 0
    assert not (tmp_path / "none").exists()


def test_it_loads_no_simulator_no_prefect_and_no_tables(file_store: Store) -> None:
    heavy = "jax prefect mujoco pyarrow fsspec numpy scipy"
    code = (
        "import sys\nfrom typer.testing import CliRunner\nfrom flows.cli.shell import app\n"
        f"done = CliRunner().invoke(app, ['gc', '--yes', '--store', {file_store.url!r}], catch_exceptions=False)\n"
        f"print(done.exit_code, [name for name in {heavy.split()!r} if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "0 []\n"


def test_reap_of_a_store_without_jobs_does_not_say_that_somebody_works(file_store: Store):
    answer = CliRunner().invoke(app, ["reap", "--store", file_store.url])
    assert answer.stdout == "no job is under way\n"


def test_the_version_is_that_of_the_package():
    assert CliRunner().invoke(app, ["--version"]).stdout == f"simyard {version('simyard')}\n"

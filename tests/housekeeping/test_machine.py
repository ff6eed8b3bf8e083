"""`simyard gc --machine`: what is certainly Simyard's goes, and nothing else on the machine."""

import os
import pwd
import re
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest
from typer.testing import CliRunner

from flows.cli.shell import app
from specs.errors import DocumentError
from tasks.housekeeping.cache_garbage import remove_entry, unused_entries
from tasks.housekeeping.machine import MachineReport, clean_machine

DIGEST = "0123456789abcdef" * 4
OURS = (
    f"bundles/{DIGEST}/files/robot.xml",
    f"programs/{DIGEST[:32]}/jit_step-{DIGEST}-cache",
    f"data/objects/{DIGEST}",
    f"engines/{DIGEST}.json",
    "agents/0123456789ab/r1/state.json",
    "prefect/prefect.db",
    "prefect/storage/result",
    "prefect-01234567/server-12.log",
)
OTHERS = (
    "bundles/photos/one.jpg",
    "programs/vim",
    "data/thesis.txt",
    "notes/today.md",
    "prefect/profiles.toml",
    "keys/0123456789ab/root-1.pem",
    "owner/key",
)


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A home folder, and a folder for temporary files, with what Simyard leaves and what others do."""
    folder = tmp_path / "home"
    for name in (*OURS, *OTHERS):
        path = folder / ".cache/simyard" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(name)
    (folder / ".prefect").mkdir()
    (folder / ".prefect/profiles.toml").write_text("active = 'x'")
    monkeypatch.setattr(tempfile, "gettempdir", lambda: str(tmp_path / "tmp"))
    monkeypatch.delenv("PREFECT_HOME", raising=False)
    (tmp_path / "tmp").mkdir()
    return folder


def cleaned(home: Path, *, remove: bool = True) -> MachineReport:
    return clean_machine(home / ".cache/simyard", home, remove=remove)


def there(folder: Path) -> set[str]:
    return {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file() or path.is_symlink()}


def test_what_is_simyards_goes_and_all_else_stays(home: Path):
    told = cleaned(home, remove=False)
    assert there(home / ".cache/simyard") == {*OURS, *OTHERS}
    done = cleaned(home)
    assert there(home / ".cache/simyard") == set(OTHERS)
    assert (home / ".prefect/profiles.toml").is_file()
    assert told.rows == done.rows
    why = {row.place.removeprefix(f"{home}/"): row.fate for row in done.rows if not row.goes}
    assert why[".prefect"] == "stays: Prefect's own, which other programs may use"
    assert why[".cache/simyard/keys"] == "stays: keys, which cannot be made again"
    assert why[".cache/simyard/notes"] == why[".cache/simyard/bundles/photos"] == "stays: not known to be Simyard's"


def test_a_cache_that_holds_nothing_else_is_gone_as_a_whole_and_a_second_time_does_nothing(home: Path):
    for name in OTHERS:
        (home / ".cache/simyard" / name).unlink()
    for name in ("bundles/photos", "notes", "keys/0123456789ab", "keys", "owner"):
        (home / ".cache/simyard" / name).rmdir()
    assert cleaned(home).rows
    assert not (home / ".cache/simyard").exists()
    assert [row.what for row in cleaned(home).rows] == ["Prefect"]


def test_nothing_behind_a_link_is_touched(home: Path, tmp_path: Path):
    outside = tmp_path / "outside"
    (outside / DIGEST).mkdir(parents=True)
    (outside / DIGEST / "precious").write_text("1")
    (outside / DIGEST).chmod(0o700)
    cache = home / ".cache/simyard"
    (cache / "bundles" / ("f" * 64)).symlink_to(outside / DIGEST)
    (cache / "bundles" / DIGEST / "files/out").symlink_to(outside)
    (cache / "timings").symlink_to(outside)
    (cache / "prefect-ffffffff").symlink_to(outside)
    done = cleaned(home)
    assert (outside / DIGEST / "precious").read_text() == "1"
    assert (outside / DIGEST).stat().st_mode & 0o777 == 0o700
    assert {Path(row.place).name for row in done.rows if row.fate == "stays: a link"} == {
        "f" * 64,
        "timings",
        "prefect-ffffffff",
    }
    assert (cache / "timings").is_symlink()


@pytest.mark.parametrize("where", ["/", ".", "..", ".cache", "../tmp"])
def test_a_variable_that_names_a_folder_of_others_is_refused(home: Path, where: str):
    with pytest.raises(DocumentError, match="a folder of Simyard alone"):
        clean_machine(home / where, home, remove=True)
    assert there(home / ".cache/simyard") == {*OURS, *OTHERS}


def test_a_cache_folder_that_is_a_link_is_refused(home: Path):
    (home / "link").symlink_to(home / ".cache/simyard")
    with pytest.raises(DocumentError, match="a folder of Simyard alone"):
        clean_machine(home / "link", home, remove=True)


@pytest.mark.skipif(os.geteuid() != 0 and os.environ.get("CI") != "true", reason="only root can give files away")
def test_files_of_another_account_stay(home: Path):
    given = home / ".cache/simyard/engines" / f"{DIGEST}.json"
    os.chown(given, 65534, 65534)
    assert [row.owner for row in cleaned(home).rows if row.fate == "stays: of another account"] == ["nobody"]
    assert given.is_file()


def test_what_commands_left_for_a_day_goes_and_no_name_that_only_looks_so(home: Path, tmp_path: Path):
    names = ("simyard-export-ab12cd34", "simyard-export-young_12", "simyard-notes", "simyard-export-ab12cd34.bak")
    for name in names:
        (tmp_path / "tmp" / name).mkdir()
        if "young" not in name:
            os.utime(tmp_path / "tmp" / name, (1, 1))
    cleaned(home)
    assert {path.name for path in (tmp_path / "tmp").iterdir()} == set(names[1:])


def test_a_process_that_uses_the_cache_keeps_it_and_is_named(home: Path):
    code = "import time; print(flush=True); time.sleep(600)"
    command = [sys.executable, "-c", code, "tasks.deploy.robot.agent"]
    with subprocess.Popen(command, env={"HOME": str(home)}, stdout=subprocess.PIPE) as agent:
        assert agent.stdout
        agent.stdout.readline()
        with pytest.raises(DocumentError, match=rf"end first: robot agent \(process {agent.pid}\)"):
            cleaned(home)
        assert there(home / ".cache/simyard") == {*OURS, *OTHERS}
        other = home.parent / "other"
        other.mkdir()
        assert [row for row in cleaned(other).rows if row.what != "Prefect"] == []  # it uses another cache
        agent.kill()
    assert cleaned(home).removed


def test_the_nightly_housekeeping_removes_a_link_and_leaves_what_it_leads_to(tmp_path: Path):
    outside, cache = tmp_path / "outside", tmp_path / "cache"
    outside.mkdir(mode=0o700)
    (outside / "precious").write_text("1")
    (cache / "bundles").mkdir(parents=True)
    (cache / "bundles" / DIGEST).symlink_to(outside)
    for entry in unused_entries(cache, -1.0):
        assert remove_entry(entry)
    assert (outside / "precious").read_text() == "1"
    assert outside.stat().st_mode & 0o777 == 0o700
    assert list((cache / "bundles").iterdir()) == []


def test_the_command_tells_and_removes_without_a_store(home: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("HOME", str(home))
    monkeypatch.delenv("SIMYARD_CACHE", raising=False)
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    told, done = (CliRunner().invoke(app, ["gc", "--machine", *more]) for more in ((), ("--yes",)))
    assert (told.exit_code, done.exit_code) == (0, 0), (told, done)
    owner = pwd.getpwuid(os.geteuid()).pw_name
    cache = f"{home}/.cache/simyard"
    assert f"{owner}  bundles: {cache}/bundles/{DIGEST}\n" in told.stdout
    assert f"{owner}  unknown: {cache}/notes (not known to be Simyard's)" in told.stdout
    assert "would go with --yes" in told.stdout
    assert re.search(rf"^gone .* bundles: {cache}/bundles/{DIGEST}$", done.stdout, re.MULTILINE)
    assert there(home / ".cache/simyard") == set(OTHERS)

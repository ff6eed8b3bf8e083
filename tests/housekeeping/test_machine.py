"""What Simyard has left on this machine: what goes, what stays and why, and what nobody uses any more."""

import json
import os
import pwd
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

import pytest
from typer.testing import CliRunner

from flows.cli.shell import app
from specs.errors import DocumentError
from tasks.housekeeping import machine
from tasks.housekeeping.machine import (
    CacheEntry,
    MachineReport,
    clean_machine,
    processes_of,
    remove_entry,
    remove_path,
    unused_entries,
)
from tasks.storage.jobs.claim import process_of
from tests.repository import ROOT

_DAY_S = 86400.0


def cached(cache: Path, name: str, *, days: float) -> Path:
    """Returns a file that was written and read last so many days ago, with the folders that it made."""
    path = cache / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(b"12345")
    age(path, days)
    top = path.parent
    while top != cache:
        age(top, days)
        top = top.parent
    return path


def age(path: Path, days: float) -> None:
    then_s = path.stat().st_ctime - days * _DAY_S
    os.utime(path, (then_s, then_s))


def found(cache: Path) -> list[tuple[str, str]]:
    return [(entry.what, entry.path.name) for entry in unused_entries(cache, 30 * _DAY_S)]


def test_each_kind_of_temporary_folder_is_known_once_a_killed_command_has_left_one():
    made = re.compile(r'TemporaryDirectory\(prefix="(simyard-\w+-)"')
    files = [path for name in ("flows", "simyard", "tasks") for path in (ROOT / name).rglob("*.py")]
    prefixes = {prefix for path in files for prefix in made.findall(path.read_text())}
    assert "simyard-bundle-" in prefixes
    known = machine._TEMP  # pyright: ignore[reportPrivateUsage]
    assert [each for each in sorted(prefixes) if not known.fullmatch(f"{each}ab12cd34")] == []


@pytest.mark.parametrize(
    "folder", ["programs", "bundles/digest", "data/objects", "data/mounts/digest/files", "engines", "timings"]
)
def test_what_nobody_has_used_for_long_goes_with_all_that_is_in_it(tmp_path: Path, folder: str) -> None:
    path = cached(tmp_path, f"{folder}/file", days=31)
    (entry,) = unused_entries(tmp_path, 30 * _DAY_S)
    assert entry.size_bytes == 5
    assert remove_entry(entry)
    assert not path.exists()
    assert list(entry.path.parent.iterdir()) == []


def test_what_was_written_or_read_lately_stays(tmp_path: Path) -> None:
    old = cached(tmp_path, "bundles/read/package/file", days=40)
    os.utime(old, (old.stat().st_ctime, old.stat().st_mtime))
    cached(tmp_path, "bundles/written/package/file", days=2)
    assert found(tmp_path) == []


@pytest.mark.parametrize("name", ["keys/store/root.pem", "agents/store/robot/state.json", "prefect/prefect.db", "mine"])
def test_keys_robots_prefect_and_what_is_not_known_stay(tmp_path: Path, name: str) -> None:
    cached(tmp_path, name, days=400)
    assert found(tmp_path) == []


def test_what_killed_processes_left_in_it_goes_too(tmp_path: Path) -> None:
    cached(tmp_path, "bundles/.download-x/bundle.tar", days=31)
    cached(tmp_path, "data/mounts/.digest.0.tmp/files/a", days=31)
    assert [what for what, _ in found(tmp_path)] == ["unpacked bundles", "data mounts"]


def test_folders_that_are_read_only_are_removed(tmp_path: Path) -> None:
    path = cached(tmp_path, "data/mounts/digest/files/a", days=31)
    path.chmod(0o444)
    path.parent.chmod(0o555)
    (entry,) = unused_entries(tmp_path, 30 * _DAY_S)
    assert remove_entry(entry)
    assert not entry.path.exists()


def test_what_was_used_since_it_was_seen_stays(tmp_path: Path) -> None:
    path = cached(tmp_path, "bundles/digest/file", days=31)
    (entry,) = unused_entries(tmp_path, 30 * _DAY_S)
    os.utime(path)
    assert not remove_entry(entry)
    assert path.read_bytes() == b"12345"


def test_what_another_gc_has_removed_is_gone(tmp_path: Path) -> None:
    assert remove_entry(CacheEntry(tmp_path / "bundles/none", "unpacked bundles", 0, 0.0))


def test_no_cache_has_nothing_to_spare(tmp_path: Path) -> None:
    assert unused_entries(tmp_path / "none", 0.0) == []


def test_a_file_that_is_written_anew_before_the_old_one_is_put_back_stays(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = cached(tmp_path, "timings/machine", days=31)
    (entry,) = unused_entries(tmp_path, 30 * _DAY_S)
    os.utime(path)
    seen = machine.CacheEntry(path, entry.what, 5, entry.used_s + 1.0)

    def written_anew(_aside: Path, _what: str) -> CacheEntry:
        path.write_bytes(b"newer")
        return seen

    monkeypatch.setattr(machine, "_seen", written_anew)
    assert not remove_entry(entry)
    assert path.read_bytes() == b"newer"
    assert list(path.parent.iterdir()) == [path]


def test_a_folder_that_another_gc_takes_away_meanwhile_is_gone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    cached(tmp_path, "bundles/digest/file", days=31)
    (entry,) = unused_entries(tmp_path, 30 * _DAY_S)
    real = shutil.rmtree

    def taken_away(path: Path, **options: object) -> None:
        path.rename(path.with_name(".gc-another"))
        real(path, **options)  # pyright: ignore[reportArgumentType, reportCallIssue] - passed on as it came

    monkeypatch.setattr(machine.shutil, "rmtree", taken_away)
    assert remove_entry(entry)
    assert not entry.path.exists()


DIGEST = "0123456789abcdef" * 4
OURS = (
    "trends/0123456789abcdef.json",
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


@contextmanager
def living(code: str, *arguments: str, **environment: str) -> Generator[subprocess.Popen[bytes], None, None]:
    """A process that has run some code and lives until the end of the block."""
    command = [sys.executable, "-c", f"{code}; import time; print(flush=True); time.sleep(600)", *arguments]
    with subprocess.Popen(command, env=environment, stdout=subprocess.PIPE) as process:
        assert process.stdout
        process.stdout.readline()
        try:
            yield process
        finally:
            process.kill()


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


def test_a_file_that_images_share_counts_once(home: Path):
    images = home / ".cache/simyard/images"
    for name in (DIGEST, DIGEST[::-1]):
        (images / name / "files").mkdir(parents=True)
    (images / DIGEST / "files/libc.so").write_bytes(b"1" * 1000)
    (images / DIGEST[::-1] / "files/libc.so").hardlink_to(images / DIGEST / "files/libc.so")
    assert [row.bytes for row in cleaned(home, remove=False).rows if row.what == "images"] == [500, 500]


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
        (tmp_path / "tmp" / name).mkdir(mode=0o700)  # as tempfile makes them
        if "young" not in name:
            os.utime(tmp_path / "tmp" / name, (1, 1))
    cleaned(home)
    assert {path.name for path in (tmp_path / "tmp").iterdir()} == set(names[1:])


def test_a_process_that_uses_the_cache_keeps_it_and_is_named(home: Path):
    with living("1", "tasks.deploy.robot.agent", HOME=str(home)) as agent:
        with pytest.raises(DocumentError, match=rf"end first: robot agent \(process {agent.pid}\)"):
            cleaned(home)
        assert there(home / ".cache/simyard") == {*OURS, *OTHERS}
        other = home.parent / "other"
        other.mkdir()
        assert [row for row in cleaned(other).rows if row.what != "Prefect"] == []  # it uses another cache
    assert cleaned(home).removed


def programs() -> list[str]:
    """Returns the modules that are started as programs of their own, but for the shell."""
    paths = [path for top in ("tasks", "flows") for path in sorted((ROOT / top).rglob("*.py"))]
    started = [path for path in paths if 'if __name__ == "__main__":' in path.read_text()]
    return [path.relative_to(ROOT).with_suffix("").as_posix().replace("/", ".") for path in started]


@pytest.mark.parametrize("program", programs())
def test_every_program_of_simyard_keeps_the_cache_that_it_uses(home: Path, program: str):
    with living("1", program, HOME=str(home)) as process:
        assert [each.pid for each in processes_of(home / ".cache/simyard")] == [process.pid]


def test_a_folder_for_the_public_and_one_in_use_only_look_like_a_commands(home: Path, tmp_path: Path):
    (tmp_path / "tmp/simyard-report-november").mkdir(mode=0o755)
    (tmp_path / "tmp/simyard-source-notes123").touch(mode=0o600)
    (tmp_path / "tmp/simyard-recordings-ab12cd34/deep").mkdir(parents=True)
    (tmp_path / "tmp/simyard-recordings-ab12cd34").chmod(0o700)
    (tmp_path / "tmp/simyard-recordings-ab12cd34/deep/recording").touch()  # just now, by who works there
    for name in ("simyard-report-november", "simyard-source-notes123", "simyard-recordings-ab12cd34"):
        os.utime(tmp_path / "tmp" / name, (1, 1))
    before = there(tmp_path / "tmp")
    cleaned(home)
    assert there(tmp_path / "tmp") == before
    assert len(list((tmp_path / "tmp").iterdir())) == 3


def test_hidden_files_that_simyard_does_not_write_stay(home: Path):
    cache = home / ".cache/simyard"
    for name in ("bundles/.git", "data/objects/.env", "engines/.gitignore"):
        (cache / name).parent.mkdir(parents=True, exist_ok=True)
        (cache / name).touch()
    (cache / "bundles" / f".{DIGEST}.0123abcd.tmp").touch()
    cleaned(home)
    assert there(cache) == {*OTHERS, "bundles/.git", "data/objects/.env", "engines/.gitignore"}


def test_a_cache_that_is_named_from_the_working_directory_goes_too(home: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(home)
    clean_machine(Path(".cache/simyard"), home, remove=True)
    assert there(home / ".cache/simyard") == set(OTHERS)


def test_a_store_is_no_cache_although_its_bundles_are_named_alike(home: Path):
    store = home / "work/.simyard"
    (store / "bundles").mkdir(parents=True)
    (store / "bundles" / DIGEST).write_text("the only copy")
    (store / "store.json").write_text("{}")
    with pytest.raises(DocumentError, match="store"):
        clean_machine(store, home, remove=True)
    assert unused_entries(store, -1.0) == []
    assert there(store) == {f"bundles/{DIGEST}", "store.json"}


def test_an_empty_folder_that_is_not_simyards_stays(home: Path):
    (home / "empty").mkdir()
    (home / "other/data").mkdir(parents=True)
    clean_machine(home / "empty", home, remove=True)
    clean_machine(home / "other", home, remove=True)
    assert (home / "empty").is_dir()
    assert (home / "other/data").is_dir()


def test_the_home_that_the_user_chose_for_prefect_stays(home: Path, monkeypatch: pytest.MonkeyPatch):
    cache = home / ".cache/simyard"
    monkeypatch.setenv("PREFECT_HOME", str(cache / "prefect-01234567" / ".." / "prefect"))
    cleaned(home)
    assert "prefect/prefect.db" in there(cache)
    assert "prefect-01234567/server-12.log" not in there(cache)


@pytest.mark.skipif(os.geteuid() != 0 and os.environ.get("CI") != "true", reason="only root can give files away")
def test_a_folder_with_a_file_of_another_account_stays_as_a_whole(home: Path):
    given = home / ".cache/simyard/bundles" / DIGEST / "files/robot.xml"
    os.chown(given, 65534, 65534)
    (row,) = [row for row in cleaned(home).rows if Path(row.place).name == DIGEST and row.what == "bundles"]
    assert row.fate == "stays: of another account, in part"
    assert given.is_file()


def test_what_is_mounted_below_the_cache_stays(home: Path, tmp_path: Path):
    (tmp_path / "photos").mkdir()
    (tmp_path / "photos/one.jpg").touch()
    cache = home / ".cache/simyard"
    (cache / "bundles" / DIGEST / "a b").mkdir()
    (cache / "timings").mkdir()
    (tmp_path / "photos" / f"{DIGEST}.json").touch()
    code = (
        "import tempfile; from pathlib import Path; from tasks.housekeeping.machine import clean_machine;"
        f"tempfile.tempdir = {str(tmp_path / 'tmp')!r};"
        f"clean_machine(Path({str(cache)!r}), Path({str(home)!r}), remove=True)"
    )
    mount = 'mount --bind "$0" "$1" && mount --bind "$0" "$2" && exec "$3" -c "$4"'
    places = (tmp_path / "photos", cache / "bundles" / DIGEST / "a b", cache / "timings", sys.executable, code)
    shell = ["unshare", "--map-root-user", "--mount", "sh", "-c", mount, *map(str, places)]
    done = subprocess.run(
        shell, env={**os.environ, "PYTHONPATH": str(ROOT)}, capture_output=True, text=True, check=False
    )
    if re.search("Operation not permitted|Permission denied", done.stderr):
        pytest.skip("this machine lets nobody mount")
    assert done.returncode == 0, done.stderr
    assert there(tmp_path / "photos") == {"one.jpg", f"{DIGEST}.json"}
    assert (cache / "bundles" / DIGEST / "files/robot.xml").is_file()


def test_what_cannot_be_removed_is_told_and_the_rest_goes(home: Path, monkeypatch: pytest.MonkeyPatch):
    def refuse(path: Path) -> None:
        if path.name == DIGEST:
            raise PermissionError(13, "Permission denied", str(path))
        remove_path(path)

    monkeypatch.setattr("tasks.housekeeping.machine.remove_path", refuse)
    done = cleaned(home)
    told = [row.fate for row in done.rows if Path(row.place).name == DIGEST]
    assert told == ["stays: cannot be removed: Permission denied"] * 2
    assert {name for name in there(home / ".cache/simyard") if DIGEST not in name} == set(OTHERS)


def test_a_copy_of_a_cache_does_not_end_the_server_of_the_original(home: Path, tmp_path: Path):
    cache, copy = home / ".cache/simyard", tmp_path / "copy"
    original = {"HOME": str(home), "PREFECT_HOME": str(cache / "prefect")}
    with living("1", "tasks.server.guarded_server", **original) as server:
        process = process_of(server.pid).model_dump()
        note = {"api_url": "http://127.0.0.1:1/api", "pid": server.pid, "log": "", "process": process}
        (cache / "prefect/kept.json").write_text(json.dumps(note))
        shutil.copytree(cache, copy)
        clean_machine(copy, home, remove=True)
        assert server.poll() is None
        assert there(copy) == set(OTHERS)
        assert cleaned(home).rows[0].place == f"process {server.pid}"
        assert server.wait()


def test_the_database_of_a_server_on_another_machine_stays(home: Path):
    process = {"host": "another", "pid": 1, "started": "1"}
    note = {"api_url": "http://127.0.0.1:1/api", "pid": 1, "log": "", "process": process}
    (home / ".cache/simyard/prefect/kept.json").write_text(json.dumps(note))
    cleaned(home)
    assert "prefect/prefect.db" in there(home / ".cache/simyard")


def test_a_program_with_a_file_of_the_cache_open_keeps_it(home: Path):
    opened = home / ".cache/simyard/bundles" / DIGEST / "files/robot.xml"
    with (
        living(f"file = open({str(opened)!r})") as program,
        pytest.raises(DocumentError, match=rf"end first: .*python.* \(process {program.pid}\)"),
    ):
        cleaned(home)


def test_the_command_started_as_a_module_keeps_it_too(home: Path):
    (home / "simyard.py").write_text("import time; print(flush=True); time.sleep(600)")
    command = [sys.executable, "-m", "simyard", "run"]
    with subprocess.Popen(command, cwd=home, env={"HOME": str(home)}, stdout=subprocess.PIPE) as run:
        assert run.stdout
        run.stdout.readline()
        try:
            with pytest.raises(DocumentError, match=rf"end first: simyard .*\(process {run.pid}\)"):
                cleaned(home)
        finally:
            run.kill()


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
